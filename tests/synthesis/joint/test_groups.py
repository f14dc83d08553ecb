"""Designs where agents have different exosystems: a W for every group, judged by NumPy and by both
checkers."""

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from networks import CONSTANT, HIDDEN, ring

import dobc_design as dd
from dobc_design import Exosystem, Group, Observer, Problem, Verdict, load_problem
from dobc_design.errors import SpecError
from dobc_design.exact.matrix import to_float
from dobc_design.problem.changes import changed_file, changed_problem, gain_changes

SINE = Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]])
# the second state decays at 1/2, whatever W is
SLOW = Exosystem(A=[[0, 0], [0, "-1/2"]], C=[[1, 0]])
REGION = {"initial_states": [-1, 1], "initial_disturbance": "1/10"}
FILE = """\
name = "mixed"
[network]
agents = 3
arrow = "listens_to"
modes.G = [[1, 2], [2, 3], [3, 1]]
[coupling]
h = "y"
[exosystem]          # of agent 3
A = [[0]]
C = [[1]]
[[exosystem.groups]]
agents = [2, 1]
A = [[0, 2], [-2, 0]]   # a sine
C = [[1, 0]]
P = [[1, 0], [0, 1]]
W = [[9], [9]]
[observer]
W = [[77]]
P = [[1]]
"""


def mixed(first: Exosystem = SINE, other: Exosystem = CONSTANT, **changes: object) -> Problem:
    """Three agents on a ring: 1 and 2 feel the first exosystem, 3 the other."""
    first_group = Group(agents=[1, 2], exosystem=first)
    second_group = Group(agents=[3], exosystem=other)
    groups = [first_group, second_group]
    return ring(3, **{"groups": groups} | changes)


def decay(exosystem: Exosystem, W: object) -> float:
    """-max Re of the eigenvalues of A - W C."""
    error = to_float(exosystem.A) - to_float(W) @ to_float(exosystem.C)
    return -float(np.max(np.linalg.eigvals(error).real))


def test_every_group_gets_a_gain_of_its_own_that_meets_the_request():
    """A = 0, C = 1: the rate is W itself."""
    found = dd.design_observer(mixed(), rate="3/2")
    assert found.verdict is Verdict.PROVED
    sine = found.groups["1"].W
    constant = found.groups["3"].W
    assert constant == ((Fraction(3, 2),),)
    assert decay(SINE, sine) >= 1.5
    third = (0, Fraction(3, 2))
    assert ((*sine[0], 0), (*sine[1], 0), third) == found.W
    for key, worst in (("rate", min), ("gain", max)):
        expected = worst(each.measures[key] for each in found.groups.values())
        assert found.measures[key] == expected
    assert "Group of agent 3" in str(found)
    assert set(found.to_json()["groups"]) == {"1", "3"}


def test_what_one_group_cannot_do_is_refuted_and_all_groups_meet_the_nearest_request():
    """A state that decays at 1/2, whatever W; a harmonic of 2 rad/s that is followed with a gain of
    2 at least."""
    slow = dd.design_observer(mixed(other=SLOW), rate="0.51")
    loud = dd.design_observer(mixed(), noise="1.9")
    for found, group in ((slow, 3), (loud, 1)):
        assert found.verdict is Verdict.REFUTED
        assert found.reason.startswith(f"group of agent {group}: ")
    assert slow.nearest.request.rate == Fraction(1, 2)
    assert loud.nearest.request.noise[0].bound > 2
    first, other = (slow.nearest.groups[name].W for name in ("1", "3"))
    assert min(decay(SINE, first), decay(SLOW, other)) >= 0.5 - 1e-9
    answer = dd.design_observer(mixed(other=SLOW), rate="1/2")
    assert answer.verdict is Verdict.PROVED


@pytest.mark.parametrize("region", [None, pytest.param(REGION, marks=pytest.mark.slow)])
def test_a_whole_design_gives_every_group_its_gain_and_both_checkers_agree(region):
    problem = mixed(region=region)
    found = dd.design(problem, digits=2, rate="1/10")
    assert found.verdict is Verdict.PROVED
    answer = [group.observer.W is not None for group in found.problem.groups]
    assert answer == [True, True]
    again = dd.verify(found.certificate, found.problem)
    assert again.holds is True
    assert again.verdict == Verdict.PROVED
    assert "Observer of the group of agent 1: W = " in str(found)


def test_an_undetectable_group_is_named_and_refused_for_good_only_if_its_reduction_is_declined():
    problem = mixed(other=HIDDEN)
    found = dd.design(problem)
    assert found.verdict is Verdict.UNDECIDED
    assert "group of agent 3" in found.reason
    assert "A = [[0]]" in found.reason
    declined = dd.design(problem, reduce=False)
    assert declined.verdict == Verdict.REFUTED
    assert declined.binding == "reduce"


def test_gains_over_the_region_of_the_file_leave_room_for_the_observers_of_all_groups():
    given = mixed(region=REGION, coupling="tanh(y)")
    W = ((4, 0), (2, 0), (0, 2))
    changes = gain_changes(given, W)
    problem = changed_problem(given, changes)
    found = dd.design_pinning(problem, rate="1/10", region=True)
    assert found.verdict is Verdict.PROVED
    assert found.certificate.rho > 1
    assert dd.certify(found.problem).verdict is Verdict.PROVED


def test_the_gains_of_all_groups_are_written_where_they_stand_and_comments_stay(tmp_path: Path):
    (tmp_path / "mixed.toml").write_text(FILE, encoding="utf-8")
    problem = load_problem(tmp_path / "mixed.toml")
    W = ((4, 0), (2, 0), (0, 2))
    changes = gain_changes(problem, W)
    text = changed_file(problem, changes, text=FILE, folder=tmp_path)
    assert "# of agent 3" in text
    assert "# a sine" in text
    for old in ("77", "9", "P = "):
        assert old not in text
    (tmp_path / "new.toml").write_text(text, encoding="utf-8")
    first, other = load_problem(tmp_path / "new.toml").groups
    W = [[4], [2]]
    assert first.observer == Observer(W=W)
    assert other.observer == Observer(W=[[2]])
    removed = changed_problem(problem, gain_changes(problem, None))
    found = [group.observer for group in removed.groups]
    assert found == [Observer(), Observer()]


def test_a_gain_that_mixes_groups_is_refused():
    W = ((4, 1), (2, 0), (0, 2))
    with pytest.raises(SpecError, match="block diagonal"):
        gain_changes(mixed(), W)
