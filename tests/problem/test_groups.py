"""Groups of agents with an exosystem of their own, and kinds of exosystems, in problem files and in
Python."""

import pickle
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest
from networks import linked

from dobc_design import Exosystem, Problem, exosystems
from dobc_design.description.words import describe, facts
from dobc_design.errors import SpecError
from dobc_design.problem.canonical import (
    canonical_bytes,
    canonical_document,
    problem_from_canonical,
    problem_sha256,
)
from dobc_design.problem.changes import changed_problem, changed_text, problem_text
from dobc_design.problem.groups import (
    Group,
    Observer,
    block_diagonal,
    blocks_of,
    group_blocks,
    group_numbers,
)
from dobc_design.problem.load import read_problem_text

HEAD = """
name = "four"
[network]
agents = 4
arrow = "listens_to"
[network.modes]
G = [[1, 2], [2, 3], [3, 4], [4, 1]]
[coupling]
h = "y"
[pinning]
gains = 3
"""
OSCILLATOR, CONSTANT = Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]]), Exosystem(A=[[0]], C=[[1]])


def read(text: str, *, head: str = HEAD) -> Problem:
    return read_problem_text((head + text).encode(), folder=Path())


TWO = """
[exosystem]
A = [[0, 2], [-2, 0]]
C = [[1, 0]]
[[exosystem.groups]]
agents = [4, 2]
A = [[0]]
C = [[1]]
W = [[2]]
[observer]
W = [["16/5"], ["12/5"]]
"""


def test_agents_in_no_group_have_the_exosystem_and_the_observer_of_the_tables_above():
    problem = read(TWO)
    agents = [group.agents for group in problem.groups]
    expected = [("1", "3"), ("2", "4")]
    assert agents == expected
    assert [group.exosystem for group in problem.groups] == [OSCILLATOR, CONSTANT]
    gains = [group.observer.W for group in problem.groups]
    of_the_first = ((Fraction(16, 5),), (Fraction(12, 5),))
    of_the_second = ((Fraction(2),),)
    assert gains == [of_the_first, of_the_second]
    assert problem.is_grouped
    assert problem.q == 3


def test_without_a_rest_the_tables_above_hold_nothing_but_the_groups_and_the_rate():
    text = """
[[exosystem.groups]]
agents = [1, 2, 3]
kind = "constant"
[[exosystem.groups]]
agents = [4]
kind = "ramp"
[observer]
rate = 2
"""
    problem = read(text)
    assert [group.exosystem.order for group in problem.groups] == [1, 2]
    assert {group.observer.rate for group in problem.groups} == {Fraction(2)}


def test_the_order_of_groups_does_not_matter_and_one_of_all_agents_is_the_plain_problem():
    grouped = read("[[exosystem.groups]]\nagents = [3, 1, 2, 4]\nA = [[0]]\nC = [[1]]\nW = [[2]]\n")
    plain = read("[exosystem]\nA = [[0]]\nC = [[1]]\n[observer]\nW = [[2]]\n")
    assert grouped == plain
    assert problem_sha256(grouped) == problem_sha256(plain)
    assert not grouped.is_grouped
    one = "[[exosystem.groups]]\nagents = [{}]\nA = [[{}]]\nC = [[1]]\n"
    first = read(one.format("1, 2", 0) + one.format("3, 4", -1))
    second = read(one.format("4, 3", -1) + one.format("2, 1", 0))
    assert problem_sha256(first) == problem_sha256(second)
    other_order = one.format("2, 4", -1)
    one_order = one.format("1, 3", 0) + other_order
    assert problem_sha256(first) != problem_sha256(read(one_order))


ONE = "[[exosystem.groups]]\nagents = [2]\nfrequencies = 1\n"


def test_agents_in_no_group_have_no_disturbance_where_all_groups_are_listed():
    problem = read(ONE)
    assert [group.agents for group in problem.groups] == [("2",)]
    assert problem.undisturbed == ("1", "3", "4")
    assert problem.is_grouped
    assert problem.q == 2
    assert "Disturbance of 1, 3, 4: none." in describe(problem)
    assert facts(problem)["undisturbed"] == ["1", "3", "4"]
    assert canonical_document(problem)["version"] == 4


def test_a_group_may_have_no_disturbance_beside_agents_that_share_one():
    none = "[[exosystem.groups]]\nagents = [4, 3]\nnone = true\n"
    shared = "[exosystem]\nconstant = true\n[observer]\nW = [[2]]\nrate = 3\n"
    problem = read(shared + ONE + none)
    agents = [group.agents for group in problem.groups]
    expected = [("1",), ("2",)]
    assert agents == expected
    gains = [group.observer.W for group in problem.groups]
    assert gains == [((Fraction(2),),), None]
    assert {group.observer.rate for group in problem.groups} == {Fraction(3)}
    assert problem.undisturbed == ("3", "4")
    others = "[[exosystem.groups]]\nagents = [1, 3, 4]\nnone = true\n"
    assert problem_sha256(read(ONE + others)) == problem_sha256(read(ONE))
    everybody = "[[exosystem.groups]]\nagents = [1, 2, 3, 4]\nnone = true\n"
    assert read(everybody).groups == ()
    assert problem_sha256(read(everybody)) == problem_sha256(read(""))


MISTAKES: list[Any] = []


def mistake(match: str, text: str) -> None:
    MISTAKES.append((text, match))


mistake(r"groups\[0\]\.none must be true", "agents = [1]\nnone = false")
mistake(r"groups\[0\]\.none stands beside hz", "agents = [1]\nnone = true\nhz = 1")
mistake(
    r"groups\[0\]\.none stands beside A and C", "agents = [1]\nnone = true\nA = [[0]]\nC = [[1]]"
)
mistake(r"groups\[0\]\.none stands beside W", "agents = [1]\nnone = true\nW = [[1]]")
mistake(r"groups\[0\]\.agents must be a list of labels", "agents = []\nnone = true")
mistake(r"groups\[0\]\.agents\[0\].*no agent", "agents = [9]\nnone = true")
mistake(r"groups\[0\]\.agents\[1\].*already", "agents = [1, 1]\nnone = true")
mistake(
    r"agents\[0\].*already", "agents = [1]\nnone = true\n[[exosystem.groups]]\nagents = [1]\nhz = 1"
)
mistake("apply to no agent", "agents = [1, 2, 3, 4]\nnone = true\n[exosystem]\nhz = 1")
mistake(
    r"observer\.W must have shape",
    "agents = [1]\nnone = true\n[exosystem]\nhz = 1\n[observer]\nW = [[1]]",
)
mistake(r"observer\.W.*no disturbance", "agents = [1]\nhz = 1\n[observer]\nW = [[1]]")


@pytest.mark.parametrize(("text", "match"), MISTAKES)
def test_a_mistake_about_agents_without_a_disturbance_is_named(text: str, match: str):
    with pytest.raises(SpecError, match=match):
        read(f"[[exosystem.groups]]\n{text}\n")


def test_a_problem_with_undisturbed_agents_survives_every_way_of_writing_it():
    problem = read(ONE + '[simulation]\nxi0 = [1, "1/2"]\n')
    row = (Fraction(1), Fraction(1, 2))
    assert problem.simulation.xi0 == ((), row, (), ())
    assert read(ONE + '[simulation]\nxi0 = [[], [1, "1/2"], [], []]\n') == problem
    assert problem_from_canonical(canonical_bytes(problem)) == problem
    assert pickle.loads(pickle.dumps(problem)) == problem
    assert problem.replace(name="other").undisturbed == problem.undisturbed
    written = read_problem_text(problem_text(problem).encode(), folder=Path(), default_name="four")
    assert canonical_bytes(written) == canonical_bytes(problem)


def test_a_problem_with_groups_survives_every_way_of_writing_it():
    problem = read(TWO + '[simulation]\nxi0 = [[1, 2], [3], [4, "1/2"], [0]]\n')
    assert problem_from_canonical(canonical_bytes(problem)) == problem
    assert pickle.loads(pickle.dumps(problem)) == problem
    written = read_problem_text(problem_text(problem).encode(), folder=Path(), default_name="four")
    assert canonical_bytes(written) == canonical_bytes(problem)
    second = {"agents": [1, 3], "A": [["0"]], "C": [["1"]], "W": [["2"]], "P": None}
    assert canonical_document(problem)["exosystem"]["groups"][1] == second


def test_pins_of_a_problem_with_groups_can_be_changed_and_its_exosystems_cannot():
    problem = read(TWO)
    changed = changed_problem(problem, {"pinning.gains": {"1": 7}})
    assert changed.groups == problem.groups
    gains = dict(changed.pinning.gains)
    expected = {0: ((Fraction(7),),)}
    assert gains == expected
    text = changed_text(HEAD + TWO, {"pinning.gains": {"1": 7}})
    data = (text or "").encode()
    again = read_problem_text(data, folder=Path())
    assert again.groups == problem.groups
    with pytest.raises(SpecError, match="cannot be changed by key"):
        changed_problem(problem, {"observer.W": [[1]]})


def test_whoever_knows_of_one_exosystem_only_is_refused():
    """No part of the program can take the exosystem of some agents for that of all."""
    problem = read(TWO)
    said = r"exosystem\.groups: this is not available yet"
    for name in ("exosystem", "observer"):
        with pytest.raises(SpecError, match=said) as caught:
            getattr(problem, name)
        assert caught.value.key == "exosystem.groups"


def test_check_says_who_has_which_disturbance():
    said = describe(read(TWO))
    assert "Disturbance of 2, 4: constant." in said
    assert "Observer gain W of 2, 4: given." in said
    shown = facts(read(TWO))["groups"]
    expected = [["1", "3"], ["2", "4"]]
    assert shown == expected
    assert "groups" not in facts(read("[exosystem]\nA = [[0]]\nC = [[1]]\n"))


KINDS: list[Any] = [
    ('kind = "constant"', exosystems.constant()),
    ('kind = "ramp"', exosystems.ramp()),
    ('kind = "harmonics"\nfrequencies = [2, "1/3"]', exosystems.harmonics([2, "1/3"])),
    ('kind = "harmonics"\nfrequencies = 2', exosystems.harmonics(2)),
    ("constant = true", exosystems.constant()),
    ("ramp = true\nconstant = true", exosystems.ramp()),
    ("hz = 0.5", exosystems.harmonics("3.14159265359")),
    (
        "constant = true\nhz = [50, 0.5]\nfrequencies = 2",
        exosystems.total(
            exosystems.constant(), exosystems.harmonics([2, "314.159265359", "3.14159265359"])
        ),
    ),
]


@pytest.mark.parametrize(("kind", "shape"), KINDS)
def test_a_kind_stands_for_the_matrices_of_its_constructor(kind, shape):
    assert read(f"[exosystem]\n{kind}\n").exosystem == shape


MEANINGLESS: list[Any] = []


def meaningless(message: str, text: str) -> None:
    MEANINGLESS.append((text, message))


meaningless("exosystem is empty", "constant = false")
meaningless("exosystem.ramp must be true or false; got 1", "ramp = 1")
meaningless(r"exosystem.hz\[1\] must be between 1e-15 and 1e15 Hz; got 0", "hz = [1, 0]")
meaningless("exosystem.hz must be between", 'hz = "1e-310"')
meaningless("exosystem.hz must be between", 'hz = "1e400"')
meaningless("exosystem.hz must hold at least one number", "constant = true\nhz = []")
meaningless("exosystem.hz cannot stand beside kind", 'kind = "constant"\nhz = [1]')
meaningless("exosystem.constant cannot stand beside kind", 'kind = "ramp"\nconstant = false')
meaningless(r"exosystem.hz\[2\] must differ from exosystem.hz\[0\]", "hz = [1, 2, 1]")
meaningless("exosystem.hz stands beside A and C", "hz = 1\nA = [[0]]\nC = [[1]]")
meaningless(
    "exosystem.hz must differ from exosystem.frequencies, .* are 3.14159",
    "hz = 0.5\nfrequencies = 3.14159265359",
)
meaningless(
    r"For a sine write hz = \[0.5\] or frequencies", 'A = [[0, "2*pi"], ["-2*pi", 0]]\nC = [[1, 0]]'
)
meaningless(
    r"exosystem.groups\[0\].hz must be between", '[[exosystem.groups]]\nagents = [1]\nhz = "-1"'
)


@pytest.mark.parametrize(("text", "message"), MEANINGLESS)
def test_a_disturbance_in_words_that_means_nothing_is_refused(text: str, message: str):
    with pytest.raises(SpecError, match=message):
        read(f"[exosystem]\n{text}\n")


def test_a_kind_gives_every_state_component_a_disturbance_of_its_own():
    problem = read('[exosystem]\nkind = "ramp"\n', head="target = [1, 2]\n" + HEAD)
    assert problem.exosystem == exosystems.stacked(exosystems.ramp(), exosystems.ramp())
    text = (
        '[exosystem]\nkind = "constant"\n[[exosystem.groups]]\nagents = [1]\nA = [[0]]\nC = '
        "[[1], [2]]\n"
    )
    assert [group.exosystem.outputs for group in read(text).groups] == [2, 2]


def grouped(*groups: Any, **given: Any) -> Problem:
    arcs = [[1, 2], [2, 1]]
    return linked(arcs, groups=list(groups), **given)


def test_groups_in_python_are_named_by_labels_and_read_like_those_of_a_file():
    observer = Observer(W=[[2]])
    one = Group(agents=[2], exosystem=CONSTANT, observer=observer)
    problem = grouped(one, exosystem=OSCILLATOR)
    assert [group.name for group in problem.groups] == ["1", "2"]

    stranger = Group(agents=[3], exosystem=CONSTANT)
    with pytest.raises(SpecError, match="no agent '3'"):
        grouped(stranger, exosystem=OSCILLATOR)
    with_rate = Group(agents=[2], exosystem=CONSTANT, observer=Observer(rate=1))
    with pytest.raises(SpecError, match="a group has no rate of its own"):
        grouped(with_rate, exosystem=OSCILLATOR)
    with pytest.raises(SpecError, match="groups must be a list of Groups"):
        grouped(CONSTANT, exosystem=OSCILLATOR)
    assert grouped(one).undisturbed == ("1",)


def test_a_p_is_given_for_every_group_or_for_none():
    text = TWO.replace('W = [["16/5"], ["12/5"]]', 'W = [["16/5"], ["12/5"]]\nP = [[1, 0], [0, 1]]')
    said = "P is given for the group of agent '1' and missing for that of agent '2'"
    with pytest.raises(SpecError, match=said):
        read(text)


def exact_matrix(rows: list[list[int]]) -> tuple[tuple[Fraction, ...], ...]:
    return tuple(tuple(map(Fraction, row)) for row in rows)


def test_blocks_come_out_of_the_joint_matrix_and_every_agent_gets_that_of_its_group():
    one = exact_matrix([[1, 2]])
    other = exact_matrix([[3], [4]])
    whole = block_diagonal([one, other])
    assert whole == ((1, 2, 0), (0, 0, 3), (0, 0, 4))
    shapes = [(1, 2), (2, 1)]
    assert blocks_of(whole, shapes) == (one, other)
    coupled = ((1, 2, 5), *whole[1:])
    assert blocks_of(coupled, shapes) is None

    problem = read(TWO)
    S = exact_matrix([[1, 0], [0, 2]])
    blocks = group_blocks(S, len(problem.groups))
    numbers = group_numbers(problem.groups, problem.network.labels)
    found = [blocks[group] for group in numbers]
    expected = [((1,),), ((2,),)]
    assert found == expected * 2
