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
from dobc_design.conditions.case import Case
from dobc_design.conditions.check import Check, Values
from dobc_design.conditions.coverage import read_region
from dobc_design.conditions.domain import NEAR_TARGET, Box
from dobc_design.conditions.margins import decide, stage
from dobc_design.conditions.margins.stage import margins_stage
from dobc_design.conditions.separable.claim import Errors, Separable, rows
from dobc_design.conditions.separable.coordinates import enclosed_ranges
from dobc_design.conditions.separable.decide import verify_separable
from dobc_design.conditions.separable.propose_limits import largest_rate
from dobc_design.exact.number import number_text
from dobc_design.loop.make import loop_of
from dobc_design.loop.saturation import _amplitude, largest_disturbance
from dobc_design.problem.canonical import canonical_bytes
from dobc_design.problem.exosystems import Exosystem, constant, harmonics, ramp, total

F = Fraction
PROVED, UNDECIDED = Verdict.PROVED, Verdict.UNDECIDED
#: Two agents that hear each other, with the observer of the paper.
TWO = cycle(2, exosystem=harmonics([2]), observer=Observer(W=[["16/5"], ["12/5"]]))
WIDE = {"initial_states": [-4, 4], "initial_disturbance": "1/2"}
SMALL = {"initial_states": ["-0.1", "0.1"], "initial_disturbance": "0.05"}


def found(problem: Problem, id: str) -> Check:
    """The check, which both programs have confirmed: certify withdraws what the second one
    refuses."""
    check = certified(problem).check(id)
    assert "second checker" not in check.reason
    return check


def margins(problem: Problem, beside: Problem) -> list[Check]:
    """What the stage says beside the checks of a problem that differs in its errors only."""
    W = problem.observer.W
    asked = read_region(loop_of(problem), W, domain=NEAR_TARGET, everything=False)
    return margins_stage(asked, certified(beside).checks, str)


def tolerance(problem: Problem, *, beside: Problem) -> Check:
    (check,) = margins(problem, beside)
    return check


def chain(h: str = "y", **more: object) -> Problem:
    """2 hears 1, which is pinned with k = 2; 1 hears 2 as well."""
    arcs = [[2, 1], [1, 2]]
    return listening(arcs, h, n=2, gains={1: 2}, target=0, **more)


def alone(gain: object = 3, **more: object) -> Problem:
    """One agent, which hears nobody."""
    settings = {"target": 0, **more}
    return listening([], "y", n=1, gains={1: gain}, **settings)


def accepted(problem: Problem, checks: list[Check]) -> tuple[bool, bool]:
    """Whether the package and the second checker accept these checks in place of those of the
    certificate."""
    claims = replace(certified(problem).claims, checks=tuple(checks))
    own = recheck(claims, problem).holds
    second = examine(certificate_bytes(claims), canonical_bytes(problem))
    return own, all(holds for holds, _ in second)


def changed(problem: Problem, id: str, **exact: object) -> tuple[bool, bool]:
    """Whether both accept other exact values of the check."""
    checks = list(certified(problem).checks)
    for place, check in enumerate(checks):
        if check.id == id and exact:
            values = json.loads(json.dumps(check.exact))
            checks[place] = replace(check, claim=Values(values | exact))
    return accepted(problem, checks)


def verdict_of(problem: Problem, claim: Separable, errors: Errors) -> Verdict:
    return verify_separable(loop_of(problem), claim, errors=errors).verdict


def test_every_arc_takes_its_worse_end():
    """h = y, v = (1, 2), w = 1, k = 2: rows (1 + d) - 2 (1 - g) and -(1 - d) 1 <= -alpha v."""
    problem = chain()
    v = (F(1), F(2))
    claim = Separable(v=v, alpha=F("0.4"), rho=None)
    errors = Errors(F(1, 5), F(1, 10))
    found_rows = rows(loop_of(problem), claim.v, errors=errors)
    first, second = (row for row, _ in found_rows)
    assert first.own == 1
    assert first.pull == F(9, 5)
    answer = [(term.weight, term.step) for term in first.terms]
    expected = [(F(6, 5), 1)]
    assert answer == expected
    assert second.own == 2
    answer = [(term.weight, term.step) for term in second.terms]
    first_row = (F(4, 5), -1)
    second_row = (F(2, 5), 0)
    expected = [first_row, second_row]
    assert answer == expected
    # min(9/5 - 6/5, 4/5 / 2)
    answer = largest_rate(loop_of(problem), claim.v, rho=None, errors=errors)
    assert answer == claim.alpha
    assert verdict_of(problem, claim, errors) is PROVED
    faster = replace(claim, alpha=F("0.4001"))
    assert verdict_of(problem, faster, errors) is Verdict.REFUTED


#: Arcs (listener, speaker, weight) of three agents.
ARCS = ((2, 1, F(1)), (2, 3, F(1, 2)), (3, 1, F(1)))


def worst_corner(h: str, v: tuple[F, ...], rho: F) -> F | None:
    """The least rate where all weights are off by 1/5 and gains less by 1/10; None if one corner
    has none."""
    rates = []
    both_ends = (F(4, 5), F(6, 5))
    for ends in product(both_ends, repeat=3):
        arcs_and_ends = zip(ARCS, ends, strict=True)
        arcs = [[i, j, w * end] for (i, j, w), end in arcs_and_ends]
        gains = {1: F(18, 5), 2: F(9, 10)}
        corner = listening(arcs, h, n=3, gains=gains, target=0)
        rates.append(largest_rate(loop_of(corner), v, rho=rho))
    return None if None in rates else min(rates)


@pytest.mark.parametrize("seed", range(6))
def test_rows_with_errors_are_those_of_the_worst_corner(seed: int):
    """Also of couplings that turn, and in the float tables: all corners of one row are tried,
    weights set by hand."""
    h = (*TURNING, PAPER, "tanh(y)")[seed % 5]
    arcs = list(map(list, ARCS))
    gains = {1: 4, 2: 1}
    problem = listening(arcs, h, n=3, gains=gains, target=0)
    v = (F(1), F(6, 5), F(5, 4))
    rho = F(1 + seed % 3, 2)
    errors = Errors(F(1, 5), F(1, 10))
    rate = largest_rate(loop_of(problem), v, rho=rho, errors=errors)
    expected = worst_corner(h, v, rho)
    if expected is None:
        assert rate is None
    else:
        assert float(rate) == pytest.approx(float(expected), rel=1e-3)


@pytest.mark.parametrize("size", [10, 1200])
def test_large_networks_have_the_same_rows(size: int):
    """Above a thousand arcs floats go first: the cycle with v = 1, and its twin."""
    problem = cycle(size, gains=5)
    v = tuple(F(10 + i % 2, 10) for i in range(size))
    errors = Errors(F(1, 10), F(1, 20))
    rate = largest_rate(loop_of(problem), v, rho=F(1), errors=errors)
    expected = 5 * 0.95 - 1.1 * (np.exp(0.1) - 1 + 0.1)
    assert float(rate) == pytest.approx(expected, rel=1e-4)
    alpha = F(expected) * F(999, 1000)
    claim = Separable(v=v, alpha=alpha, rho=F(1))
    assert verdict_of(problem, claim, errors) is PROVED
    alpha = F(expected) * F(1001, 1000)
    faster = replace(claim, alpha=alpha)
    assert verdict_of(problem, faster, errors) is not PROVED


def test_a_table_is_proved_and_a_larger_one_is_not():
    wide = TWO.replace(region=WIDE)
    uncertainty = {"weights": "0.02", "gains": "0.02"}
    near = wide.replace(uncertainty=uncertainty)
    check = found(near, "tolerance")
    assert check.verdict is PROVED
    assert check.domain == Box(4.0, 0.5)
    uncertainty = {"weights": "0.09", "gains": "0.09"}
    more = wide.replace(uncertainty=uncertainty)
    far = tolerance(more, beside=near)
    assert far.verdict is UNDECIDED
    assert "times these errors it is proved" in far.reason


@pytest.mark.parametrize("states", [True, False], ids=["stated", "not stated"])
def test_large_networks_are_asked_for_stated_errors_only(
    states: bool, monkeypatch: pytest.MonkeyPatch
):
    """Deciding one pair of errors is linear in the arcs; looking for the largest takes many."""
    monkeypatch.setattr(stage, "TIMED_ARCS", 1)
    plain = TWO.replace(region=SMALL)
    problem = plain
    if states:
        problem = plain.replace(uncertainty={"weights": "0.01"})
    told = [check.verdict for check in margins(problem, plain)]
    assert told == ([PROVED] if states else [])


def test_without_a_table_the_largest_common_error_is_found():
    check = certified("paper-fixed").check("tolerance")
    weights = check.exact["weights"]
    assert 0.02 < float(F(weights)) < 0.06
    assert weights == check.exact["gains"]
    assert check.rate > 0


@pytest.mark.parametrize(("error", "proved"), [("0.333", True), ("0.334", False)])
def test_at_the_target_entries_of_a_gain_err_each_on_its_own(error: str, proved: bool):
    """k = [[1, 1/2], [1/2, 1]]: 1 - d > (1 + d)/2 iff d < 1/3."""
    gain = [[1, "1/2"], ["1/2", 1]]
    problem = alone(gain, target=[0, 0], uncertainty={"gains": error})
    check = found(problem, "tolerance")
    assert (check.verdict is PROVED) is proved


def test_at_the_target_of_several_modes_one_v_serves_all_corners():
    """Rising couplings: the order of the agents alone decides, so every error below 1 is
    tolerated."""
    modes = {"A": [[2, 1], [3, 2]], "B": [[2, 1], [3, 1]]}
    errors = {"weights": "0.8", "gains": "0.5"}
    stated = {"exosystem": TWO.exosystem, "uncertainty": errors}
    problem = listening(modes, PAPER, n=3, gains={1: 5}, **stated)
    check = found(problem, "tolerance")
    assert check.verdict is PROVED
    assert check.domain == NEAR_TARGET
    assert check.rate is None
    first, second, third = check.exact["v"]
    answer = changed(problem, "tolerance", v=[first, third, second])
    assert answer == (False, False)
    assert changed(problem, "tolerance", alpha="1") == (False, False)
    others = [each for each in certified(problem).checks if each.id != "tolerance"]
    answer = accepted(problem, [*others, check])
    assert answer == (True, True)
    checks = [*others, replace(check, rate=0.001)]
    answer = accepted(problem, checks)
    assert answer == (False, False)


def test_rows_in_coordinates_are_no_proof_that_a_tolerance_rests_on():
    """With T = 1 they are the same rows, but errors of weights are known by component only."""
    region = {"initial_states": [-1, 1]}
    problem = chain("tanh(y)", region=region)
    certificate = certified(problem)
    check = certificate.check("tolerance")
    plain = certificate.check("max-separable")
    loop = loop_of(problem)
    case = Case(loop=loop, W=None, domain=NEAR_TARGET, checks=(plain,))
    assert decide.confirm(check, case) is None
    one = ((F(1),),)
    claim = plain.claim
    ranges = enclosed_ranges(loop, one, claim.v, claim.rho)
    turned = replace(plain, claim=replace(claim, T=one, ranges=ranges))
    wrong = decide.confirm(check, replace(case, checks=(turned,)))
    assert wrong == "it needs a proved max-separable check with its domain"


def test_agents_that_do_not_know_tolerate_less():
    small = TWO.replace(region=SMALL)
    known = small.replace(uncertainty={"weights": "0.04"})
    uncertainty = {"weights": "0.04", "known_to_agents": False}
    unknown = small.replace(uncertainty=uncertainty)
    uncertainty = {"weights": "0.001", "known_to_agents": False}
    less = small.replace(uncertainty=uncertainty)
    assert tolerance(known, beside=less).verdict is PROVED
    assert tolerance(unknown, beside=less).verdict is UNDECIDED
    check = found(less, "tolerance")
    assert check.verdict is PROVED
    eta = F(check.exact["eta"])
    smaller = number_text(eta * F(9, 10))
    answer = changed(less, "tolerance", eta=smaller)
    assert answer == (False, False)
    # kappa eta > alpha
    answer = changed(less, "tolerance", eta=number_text(eta * 100))
    assert answer == (False, False)


def test_kinks_at_the_target_are_not_decided_by_slopes():
    errors = {"weights": "0.1"}
    arcs = [[2, 1]]
    problem = listening(arcs, "y + abs(y)/2", n=2, gains={1: 2}, target=0, uncertainty=errors)
    assert found(problem, "tolerance").reason.startswith("does not apply")


GROWING = Exosystem(A=[[1]], C=[[1]])
FALLING = Exosystem(A=[[-1]], C=[[1]])
#: d'' = -4 d.
SPRING = Exosystem(A=[[0, 1], [-4, 0]], C=[[1, 0]])
#: An exosystem, where it starts, and the bound of |d|.
AMPLITUDES = [
    (harmonics([2]), (3, 4), 5),
    (total(constant(), harmonics([2, 3])), (-1, 3, 4, 0, 1), 7),
    (SPRING, (3, 8), 5),
    (ramp(), (2, 0), 2),
    (ramp(), (2, 1), None),
    (FALLING, (2,), None),
    (GROWING, (2,), None),
]


@pytest.mark.parametrize(("exosystem", "start", "bound"), AMPLITUDES)
def test_amplitudes_of_sums_of_sines(
    exosystem: Exosystem, start: tuple[int, ...], bound: int | None
):
    """sqrt(a^2 + b^2) of every frequency, and constants; what grows or decays has no bound here."""
    assert _amplitude(exosystem, tuple(map(F, start))) == bound


def test_the_largest_input_has_a_closed_form():
    """One agent, k = 3, no coupling, |x| <= 2: |u| = 6 at the start; limits at and below that."""
    region = {"initial_states": [-2, 2]}
    problem = alone(region=region)
    check = found(problem.replace(actuators={"limit": "6.00001"}), "actuators")
    assert check.verdict is PROVED
    input_of_the_first = check.exact["inputs"]["1"]
    assert float(F(input_of_the_first)) == pytest.approx(6, rel=1e-5)
    small = found(problem.replace(actuators={"limit": 3}), "actuators")
    assert small.verdict is UNDECIDED
    assert "from starts with |e_i| <= 1." in small.reason
    assert "gain of at most 1.5" in small.reason
    # undecided claims nothing
    answer = changed(problem.replace(actuators={"limit": 5}), "actuators")
    assert answer == (True, True)


def test_disturbances_without_a_bound_ask_for_the_amplitude():
    simulation = {"xi0": [1, 1]}
    problem = alone(exosystem=ramp(), simulation=simulation, actuators={})
    check = found(problem, "actuators")
    assert "give actuators.amplitude" in check.reason
    bounded = problem.replace(actuators={"amplitude": 2})
    assert largest_disturbance(loop_of(bounded)) == (2,)
