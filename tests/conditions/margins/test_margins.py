"""Tolerances and inputs: both programs, numbers known in closed form, twins that just fail, corners
simulated."""

import json
from dataclasses import replace
from fractions import Fraction
from itertools import product

import numpy as np
import pytest
from certified import certified
from networks import PAPER, TURNING, cycle, listening

from dobc_design import Observer, Problem, Verdict
from dobc_design.certificate.text import certificate_bytes
from dobc_design.certification.recheck import recheck
from dobc_design.checker.examine import examine
from dobc_design.conditions.check import Check, Values
from dobc_design.conditions.coverage import read_region
from dobc_design.conditions.domain import NEAR_TARGET, Box
from dobc_design.conditions.margins import stage
from dobc_design.conditions.margins.decide import _amplitude, largest_disturbance
from dobc_design.conditions.margins.stage import margins_stage
from dobc_design.conditions.separable.claim import Errors, Separable, rows
from dobc_design.conditions.separable.decide import verify_separable
from dobc_design.conditions.separable.propose_limits import largest_rate
from dobc_design.exact.number import number_text
from dobc_design.loop.make import loop_of
from dobc_design.problem.canonical import canonical_bytes
from dobc_design.problem.exosystems import Exosystem, constant, harmonics, ramp, total

F = Fraction
#: Two agents that hear each other, with the observer of the paper.
TWO = cycle(2, exosystem=harmonics([2]), observer=Observer(W=[["16/5"], ["12/5"]]))
WIDE = {"initial_states": [-4, 4], "initial_disturbance": "1/2"}
SMALL = {"initial_states": ["-0.1", "0.1"], "initial_disturbance": "0.05"}


def found(problem: Problem, id: str) -> Check:
    """The check, which both programs have confirmed: certify withdraws what the second one
    refuses."""
    check = next(check for check in certified(problem).checks if check.id == id)
    assert "second checker" not in check.reason
    return check


def tolerance(problem: Problem, *, beside: Problem) -> Check:
    """What the stage says beside the boxes of a problem that differs in its errors only."""
    asked = read_region(loop_of(problem), problem.observer.W, domain=NEAR_TARGET, everything=False)
    found = margins_stage(asked, list(certified(beside).checks), str)
    return next(check for check in found if check.id == "tolerance")


def chain(h: str = "y", **more: object) -> Problem:
    """2 hears 1, which is pinned with k = 2; 1 hears 2 as well."""
    return listening([[2, 1], [1, 2]], h, n=2, gains={1: 2}, target=0, **more)


def accepted(problem: Problem, checks: tuple[Check, ...], certificate: object) -> tuple[bool, bool]:
    """Whether the package and the second checker accept these checks in place of those of the
    certificate."""
    claims = replace(certificate.claims, checks=checks)
    second = examine(certificate_bytes(claims), canonical_bytes(problem))
    return recheck(claims, problem).holds, all(holds for holds, _ in second)


def changed(problem: Problem, id: str, base: object = None, **exact: object) -> tuple[bool, bool]:
    """Whether both accept other exact values of the check, ``base`` those of max-separable."""
    certificate = certified(problem)
    changes = {id: exact, "max-separable": base or {}}
    checks = tuple(
        replace(check, claim=Values({**json.loads(json.dumps(check.exact)), **changes[check.id]}))
        if changes.get(check.id)
        else check
        for check in certificate.checks
    )
    return accepted(problem, checks, certificate)


def test_every_arc_takes_its_worse_end():
    """h = y, v = (1, 2), w = 1, k = 2: rows (1 + d) - 2 (1 - g) and -(1 - d) 1 <= -alpha v."""
    problem, claim = chain(), Separable(v=(F(1), F(2)), alpha=F(1, 10), rho=None)
    errors = Errors(F(1, 5), F(1, 10))
    terms = {
        row.own: (row.terms, row.pull) for row, _ in rows(loop_of(problem), claim.v, errors=errors)
    }
    assert terms[1][1] == F(9, 5)
    assert [(term.weight, term.step) for term in terms[1][0]] == [(F(6, 5), 1)]
    assert [(term.weight, term.step) for term in terms[2][0]] == [(F(4, 5), -1), (F(2, 5), 0)]
    # min(9/5 - 6/5, 4/5 / 2)
    assert largest_rate(loop_of(problem), claim.v, rho=None, errors=errors) == F(2, 5)
    for alpha, verdict in ((F("0.4"), Verdict.PROVED), (F("0.4001"), Verdict.REFUTED)):
        assert (
            verify_separable(loop_of(problem), replace(claim, alpha=alpha), errors=errors).verdict
            is verdict
        )


@pytest.mark.parametrize("seed", range(6))
def test_rows_with_errors_are_those_of_the_worst_corner(seed: int):
    """Also of couplings that turn, and in the float tables: all corners of one row are tried,
    weights set by hand."""
    h = (*TURNING, PAPER, "tanh(y)")[seed % 5]
    problem = listening([[2, 1], [2, 3, "1/2"], [3, 1]], h, n=3, gains={1: 4, 2: 1}, target=0)
    v, rho, errors = (F(1), F(6, 5), F(5, 4)), F(1 + seed % 3, 2), Errors(F(1, 5), F(1, 10))
    rate = largest_rate(loop_of(problem), v, rho=rho, errors=errors)
    corners = []
    for ends in product((F(4, 5), F(6, 5)), repeat=3):
        arcs = [
            [i, j, w * end]
            for (i, j, w), end in zip([(2, 1, 1), (2, 3, F(1, 2)), (3, 1, 1)], ends, strict=True)
        ]
        corner = listening(arcs, h, n=3, gains={1: F(18, 5), 2: F(9, 10)}, target=0)
        corners.append(largest_rate(loop_of(corner), v, rho=rho))
    if None in corners:
        assert rate is None
    else:
        assert float(rate) == pytest.approx(float(min(corners)), rel=1e-3)


@pytest.mark.parametrize("size", [10, 1200])
def test_large_networks_have_the_same_rows(size: int):
    """Above a thousand arcs floats go first: the cycle with v = 1, and its twin."""
    problem = cycle(size, gains=5)
    v = tuple(F(10 + i % 2, 10) for i in range(size))
    errors = Errors(F(1, 10), F(1, 20))
    rate = largest_rate(loop_of(problem), v, rho=F(1), errors=errors)
    expected = 5 * 0.95 - 1.1 * (np.exp(0.1) - 1 + 0.1)
    assert float(rate) == pytest.approx(expected, rel=1e-4)
    for part, proved in ((F(999, 1000), True), (F(1001, 1000), False)):
        claim = Separable(v=v, alpha=F(expected) * part, rho=F(1))
        assert (
            verify_separable(loop_of(problem), claim, errors=errors).verdict is Verdict.PROVED
        ) is proved


def test_a_table_is_proved_and_a_larger_one_is_not():
    near = TWO.replace(region=WIDE, uncertainty={"weights": "0.02", "gains": "0.02"})
    check = found(near, "tolerance")
    assert check.verdict is Verdict.PROVED
    assert check.domain == Box(4.0, 0.5)
    far = tolerance(
        TWO.replace(region=WIDE, uncertainty={"weights": "0.09", "gains": "0.09"}), beside=near
    )
    assert far.verdict is Verdict.UNDECIDED
    assert "times these errors it is proved" in far.reason


@pytest.mark.parametrize("states", [True, False], ids=["stated", "not stated"])
def test_large_networks_are_asked_for_stated_errors_only(
    states: bool, monkeypatch: pytest.MonkeyPatch
):
    """Deciding one pair of errors is linear in the arcs; looking for the largest takes many."""
    monkeypatch.setattr(stage, "TIMED_ARCS", 1)
    plain = TWO.replace(region=SMALL)
    problem = plain.replace(uncertainty={"weights": "0.01"}) if states else plain
    asked = read_region(loop_of(problem), problem.observer.W, domain=NEAR_TARGET, everything=False)
    told = margins_stage(asked, list(certified(plain).checks), str)
    assert [check.verdict for check in told] == ([Verdict.PROVED] if states else [])


def test_without_a_table_the_largest_common_error_is_found():
    (check,) = (check for check in certified("paper-fixed").checks if check.id == "tolerance")
    assert 0.02 < float(F(check.exact["weights"])) < 0.06
    assert check.exact["weights"] == check.exact["gains"]
    assert check.rate > 0


@pytest.mark.parametrize(("error", "proved"), [("0.333", True), ("0.334", False)])
def test_at_the_target_entries_of_a_gain_err_each_on_its_own(error: str, proved: bool):
    """k = [[1, 1/2], [1/2, 1]]: 1 - d > (1 + d)/2 iff d < 1/3."""
    k = [[1, "1/2"], ["1/2", 1]]
    problem = listening([], "y", n=1, gains={1: k}, target=[0, 0], uncertainty={"gains": error})
    assert (found(problem, "tolerance").verdict is Verdict.PROVED) is proved


def test_at_the_target_of_several_modes_one_v_serves_all_corners():
    """Rising couplings: the order of the agents alone decides, so every error below 1 is
    tolerated."""
    modes = {"A": [[2, 1], [3, 2]], "B": [[2, 1], [3, 1]]}
    errors = {"weights": "0.8", "gains": "0.5"}
    problem = listening(
        modes, PAPER, n=3, gains={1: 5}, exosystem=TWO.exosystem, uncertainty=errors
    )
    check = found(problem, "tolerance")
    assert check.verdict is Verdict.PROVED
    assert check.domain == NEAR_TARGET
    assert check.rate is None
    certificate = certified(problem)
    first, second, third = check.exact["v"]
    assert changed(problem, "tolerance", v=[first, third, second]) == (False, False)
    assert changed(problem, "tolerance", alpha="1") == (False, False)
    rated = tuple(
        replace(each, rate=0.001) if each.id == "tolerance" else each for each in certificate.checks
    )
    assert accepted(problem, rated, certificate) == (False, False)


def test_agents_that_do_not_know_tolerate_less():
    known = TWO.replace(region=SMALL, uncertainty={"weights": "0.04"})
    unknown = TWO.replace(region=SMALL, uncertainty={"weights": "0.04", "known_to_agents": False})
    less = TWO.replace(region=SMALL, uncertainty={"weights": "0.001", "known_to_agents": False})
    assert tolerance(known, beside=less).verdict is Verdict.PROVED
    assert tolerance(unknown, beside=less).verdict is Verdict.UNDECIDED
    check = found(less, "tolerance")
    assert check.verdict is Verdict.PROVED
    eta = F(check.exact["eta"])
    assert changed(less, "tolerance", eta=number_text(eta * F(9, 10))) == (False, False)
    # kappa eta > alpha
    assert changed(less, "tolerance", eta=number_text(eta * 100)) == (False, False)


def test_kinks_at_the_target_are_not_decided_by_slopes():
    problem = listening(
        [[2, 1]], "y + abs(y)/2", n=2, gains={1: 2}, target=0, uncertainty={"weights": "0.1"}
    )
    assert found(problem, "tolerance").reason.startswith("does not apply")


@pytest.mark.parametrize(
    ("exosystem", "start", "bound"),
    [
        (harmonics([2]), (3, 4), 5),
        (total(constant(), harmonics([2, 3])), (-1, 3, 4, 0, 1), 7),
        (Exosystem(A=[[0, 1], [-4, 0]], C=[[1, 0]]), (3, 8), 5),
        (ramp(), (2, 0), 2),
        (ramp(), (2, 1), None),
        (Exosystem(A=[[-1]], C=[[1]]), (2,), None),
        (Exosystem(A=[[1]], C=[[1]]), (2,), None),
    ],
)
def test_amplitudes_of_sums_of_sines(
    exosystem: Exosystem, start: tuple[int, ...], bound: int | None
):
    """sqrt(a^2 + b^2) of every frequency, and constants; what grows or decays has no bound here."""
    assert _amplitude(exosystem, tuple(map(F, start))) == bound


def test_the_largest_input_has_a_closed_form():
    """One agent, k = 3, no coupling, |x| <= 2: |u| = 6 at the start; limits at and below that."""
    problem = listening([], "y", n=1, gains={1: 3}, target=0, region={"initial_states": [-2, 2]})
    check = found(problem.replace(actuators={"limit": "6.00001"}), "actuators")
    assert check.verdict is Verdict.PROVED
    assert float(F(check.exact["inputs"]["1"])) == pytest.approx(6, rel=1e-5)
    small = found(problem.replace(actuators={"limit": 3}), "actuators")
    assert small.verdict is Verdict.UNDECIDED
    assert "from starts with |e_i| <= 1." in small.reason
    assert "gain of at most 1.5" in small.reason
    # undecided claims nothing
    assert changed(problem.replace(actuators={"limit": 5}), "actuators") == (True, True)


def test_disturbances_without_a_bound_ask_for_the_amplitude():
    simulation = {"xi0": [1, 1]}
    problem = listening(
        [], "y", n=1, gains={1: 3}, target=0, exosystem=ramp(), simulation=simulation, actuators={}
    )
    check = found(problem, "actuators")
    assert "give actuators.amplitude" in check.reason
    assert largest_disturbance(loop_of(problem.replace(actuators={"amplitude": 2}))) == (2,)
