"""Optional arcs: any of them may come and go at any time, so a mode stands for every subset."""

import re
from pathlib import Path

import pytest

from dobc_design import Problem, Switching, Verdict, certify
from dobc_design.errors import SpecError
from dobc_design.problem.canonical import canonical_bytes, problem_from_canonical
from dobc_design.problem.load import read_problem_text

HEAD = 'name = "p"\n[network]\nagents = 3\narrow = "sends_to"\n[network.modes]\n'
TAIL = '[coupling]\nh = "y"\n[pinning]\ngains = { 1 = 1 }\n'
G = "G = { arcs = [[1, 2], [2, 3]], optional = [[1, 3, 2], [3, 2]] }\n"
LISTED = """G = [[1, 2], [2, 3], [1, 3, 2], [3, 2]]
"G without optional 1" = [[1, 2], [2, 3], [3, 2]]
"G without optional 2" = [[1, 2], [2, 3], [1, 3, 2]]
"G without optional 1, 2" = [[1, 2], [2, 3]]
"""


def read(modes: str, *, tail: str = TAIL, folder: Path | None = None) -> Problem:
    return read_problem_text((HEAD + modes + tail).encode(), folder=folder)


def test_it_is_the_problem_with_every_subset_listed():
    """So nothing that decides, simulates or designs can overlook one."""
    assert canonical_bytes(read(G)) == canonical_bytes(read(LISTED))


def test_arcs_may_come_from_files(tmp_path: Path):
    (tmp_path / "all.csv").write_text("1,2\n2,3\n")
    (tmp_path / "some.csv").write_text("1,3,2\n3,2\n")
    files = 'G = { arcs = { file = "all.csv" }, optional = { file = "some.csv" } }\n'
    assert canonical_bytes(read(files, folder=tmp_path)) == canonical_bytes(read(G))


def test_beside_another_mode():
    assert list(read(G + "H = [[1, 2], [1, 3]]\n").network.modes)[-1] == "H"


@pytest.mark.parametrize(
    ("modes", "key"),
    [
        ("G = { arcs = [[1, 2]], optional = [] }", "network.modes.G.optional"),
        (f"G = {{ arcs = [], optional = {[[2, 3]] * 7} }}", "network.modes.G.optional"),
        ("G = { arcs = [[1, 2]], optional = [[2, 3], [1, 2, 5]] }", "network.modes.G.optional[1]"),
        ("G = { arcs = [[1, 2]], optional = [[2, 3], [2, 3]] }", "network.modes.G.optional[1]"),
        ("G = { arcs = [[1, 2]], optional = [[2, 9]] }", "network.modes.G.optional[0]"),
        ("G = { arcs = [[1, 2]], optional = [[2, 3]], more = 1 }", "network.modes.G"),
        ("G = { optional = [[2, 3]] }", "network.modes.G"),
        ('G = { arcs = [[1, 2]], optional = [[2, 3]] }\n"G without optional 1" = [[1, 3]]', "network.modes.G"),
        ('"G without optional 1" = [[1, 3]]\nG = { arcs = [[1, 2]], optional = [[2, 3]] }', "network.modes.G"),
    ],
)
def test_what_cannot_be_is_named(modes: str, key: str):
    with pytest.raises(SpecError) as error:
        read(modes + "\n")
    assert key in {each.key for each in error.value.errors}


GUARANTEES = (
    'guarantee = "dwell"\ndwell = 1',
    'guarantee = "sequence"\nsequence = ["G"]\ndwell = 1',
    'signal = "schedule"\nschedule = [[0, "G"]]',
    'guarantee = "markov"\ngenerator = [[-3, 1, 1, 1], [1, -3, 1, 1], [1, 1, -3, 1], [1, 1, 1, -3]]',
)


@pytest.mark.parametrize("switching", GUARANTEES)
def test_no_guarantee_holds_them(switching: str):
    """A guarantee is about the modes of the file, and inside of these the arcs come and go: also in problem.json, and
    where a key is changed later."""
    name = re.findall("guarantee|schedule", switching)[0]
    with pytest.raises(SpecError, match=rf"switching\.{name} must be left out, because there are optional arcs"):
        read(G, tail=f"{TAIL}[switching]\n{switching}\n")
    listed = read(LISTED.replace("without optional", "less"), tail=f"{TAIL}[switching]\n{switching}\n")
    document = canonical_bytes(listed).replace(b"less", b"without optional")
    with pytest.raises(SpecError, match="optional arcs"):
        problem_from_canonical(document)


def test_nor_is_one_added_later():
    with pytest.raises(SpecError, match="optional arcs"):
        Problem(network=read(G).network, coupling="y", switching=Switching(guarantee="dwell", dwell=1))


def test_a_proof_holds_for_every_subset():
    found = certify(read(G))
    assert found.verdict is Verdict.PROVED
    assert len([check for check in found.claims.checks if check.id == "reachability"]) == 4


def test_an_arc_that_may_be_missing_reaches_nobody():
    found = certify(read("G = { arcs = [[1, 2]], optional = [[2, 3]] }\n"))
    assert found.verdict is Verdict.UNDECIDED
    assert "in mode G without optional 1 no pinned agent reaches agent 3" in found.reason


def test_arbitrary_switching_is_no_guarantee():
    tail = f'{TAIL}[switching]\nguarantee = "arbitrary"\nsignal = "random"\ndwell = 1\n'
    assert len(read(G, tail=tail).network.modes) == 4
