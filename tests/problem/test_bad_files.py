"""Every wrong problem file is refused with its key and a cure, in little time, and nothing is left
behind.

The cases stand in ``tests/support/bad_files.py``; the reader is given each as a file in a folder of
its own.
"""

import time
from fractions import Fraction

import pytest
from bad_files import BAD_FILES, SLIPS, VALID, VALID_BUT_NASTY, listing, write_case

from dobc_design.errors import SpecError
from dobc_design.problem.canonical import canonical_bytes, problem_from_canonical
from dobc_design.problem.load import read_problem_file, read_problem_text
from dobc_design.problem.problem import Problem


@pytest.mark.parametrize("case", BAD_FILES, ids=lambda case: case.id)
def test_a_bad_file_is_refused_by_key_and_in_words(case, tmp_path):
    """Contract: one clear error that names the key, says what it must be and what it was; nothing
    written."""
    path = write_case(case, tmp_path)
    before = listing(tmp_path)
    start = time.process_time()
    with pytest.raises(SpecError) as caught:
        read_problem_file(path)
    spent = time.process_time() - start
    assert listing(tmp_path) == before
    errors = caught.value.errors
    assert 1 <= len(errors) <= 20
    if case.expect_key:
        assert case.expect_key in [error.key for error in errors]
    text = "\n".join(str(error) for error in errors).lower()
    for word in case.expect_words:
        assert word.lower() in text
    for error in errors:
        assert len(str(error)) < 600
        assert str(error).isprintable(), "a message must not move the cursor"
    assert spent < 5


def test_there_are_many_bad_files_and_no_two_share_a_name():
    names = [case.id for case in (*BAD_FILES, *VALID_BUT_NASTY)]
    assert len(BAD_FILES) >= 170
    assert len(SLIPS) >= 25
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("case", VALID_BUT_NASTY, ids=lambda case: case.id)
def test_a_nasty_but_valid_file_loads_and_survives_the_canonical_form(case, tmp_path):
    path = write_case(case, tmp_path)
    before = listing(tmp_path)
    problem = read_problem_file(path)
    assert listing(tmp_path) == before
    assert problem_from_canonical(canonical_bytes(problem)) == problem


@pytest.mark.parametrize("case", SLIPS, ids=lambda case: case.id)
def test_a_slip_is_one_message_that_says_what_to_write(case, tmp_path):
    """One cause, one message: what follows from the slip is not told beside it."""
    with pytest.raises(SpecError) as caught:
        read_problem_file(write_case(case, tmp_path))
    (error,) = caught.value.errors
    assert error.key == case.expect_key
    assert error.cure or "; write " in error.message


def read(text: str, **options: str) -> Problem:
    return read_problem_text(text.encode("utf-8"), folder=None, **options)


def keys_of(text: str) -> list[str | None]:
    with pytest.raises(SpecError) as caught:
        read(text)
    return [error.key for error in caught.value.errors]


def test_the_file_without_mistakes_says_what_it_says():
    problem = read(VALID)
    assert problem.name == "four-agents"
    assert problem.n == 4
    assert problem.m == 1
    assert problem.q == 2
    gains = [k for ((k,),) in problem.pinning.gains.values()]
    assert gains == [5, Fraction(9, 16)]
    offset = Fraction(3, 2)
    assert problem.offsets == {1: (offset,), 3: (-offset,)}
    assert problem.coupling_of(0, 1).texts == ("2*y",)
    assert problem.coupling_of(2, 3).texts == ("exp(y) - 1 + y",)


def test_mistakes_in_different_tables_are_told_at_once():
    text = VALID.replace('h = "exp(y) - 1 + y"', 'h = "exp(y) + y"').replace("[3, 4]", "[3, 11]")
    text = text.replace("dwell = 0.5", "dwell = 0").replace('"12/5"', '"12/0"')
    beside = ["observer.W[1][0]", "switching.dwell", "coupling.h"]
    assert keys_of(text) == ["network.modes.Ga[2]", *beside]
    text = text.replace("[3, 11]", "[3, 4]").replace("seed = 0", "seed = -1")
    assert keys_of(text) == [*beside, "simulation.seed"]


SOUND = """\
[network]
agents = ["a", "b"]
arrow = "listens_to"
modes.G = [["b", "a"]]
[coupling]
h = "y"
[pinning]
gains = { a = 1 }
[exosystem]
A = [[0]]
C = [[1]]
"""


@pytest.mark.parametrize(
    ("old", "new", "keys"),
    [
        (
            '[["b", "a"]]\n[coupling]\nh = "y"\n[pinning]\ngains = { a',
            '[["b", "x"]]\n[coupling]\nh = "1"\n[pinning]\ngains = { z',
            ["network.modes.G[0]", "coupling.h", "pinning.gains.z"],
        ),
        (
            "[exosystem]",
            "[simulation]\nt_final = -5\nseed = -1\nx0 = [1, 2, 3]\n[exosystem]",
            ["simulation.t_final", "simulation.seed", "simulation.x0"],
        ),
        (
            "[exosystem]",
            "[observer]\nW = [[1], [1, 2]]\nP = [[1, 2], [3, 4]]\nrate = -1\n[exosystem]",
            ["observer.W[1]", "observer.P", "observer.rate"],
        ),
        (
            "[exosystem]",
            '[switching]\nguarantee = "x"\nsignal = "y"\n[exosystem]',
            ["switching.guarantee", "switching.signal"],
        ),
    ],
)
def test_every_mistake_of_a_table_is_told_and_a_wrong_arc_hides_none(old, new, keys):
    read(SOUND)
    assert keys_of(SOUND.replace(old, new)) == keys


def test_every_wrong_arc_is_told_up_to_twenty():
    arcs = ", ".join(f"[1, {100 + i}]" for i in range(50))
    text = VALID.replace("[4, 1, 0.5]]", f"[4, 1, 0.5], {arcs}]")
    assert keys_of(text) == [f"network.modes.Ga[{4 + i}]" for i in range(20)]


@pytest.mark.parametrize("name", ["", "x" * 300, "two\nlines"])
def test_a_file_whose_own_name_cannot_name_a_problem_loads_as_problem(name):
    """Only a name that the user typed can be refused."""
    assert read(VALID.replace('name = "four-agents"\n', ""), default_name=name).name == "problem"


def test_a_missing_file_a_folder_and_a_name_with_nul_are_refused(tmp_path):
    with pytest.raises(SpecError, match=r"there is no file 'none\.toml'"):
        read_problem_file(tmp_path / "none.toml")
    with pytest.raises(SpecError, match="is a folder, not a problem file"):
        read_problem_file(tmp_path)
    with pytest.raises(SpecError, match="cannot be read"):
        read_problem_file(tmp_path / "nul\0.toml")
    with pytest.raises(SpecError, match="cannot be read"):
        read_problem_file(tmp_path / ("x" * 5000))
