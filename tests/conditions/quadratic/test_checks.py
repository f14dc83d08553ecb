"""The check ``lure``: what a certificate holds, read back and decided again; twins just fail."""

import json
import math
from dataclasses import replace
from fractions import Fraction
from functools import partial
from typing import Any

import pytest
from certified import confirmed
from networks import linked
from regional_problems import HARMONIC, PAPER, PAPER_GAIN, identity, is_proved
from texts import exact_matrix

from dobc_design import Observer, Problem, Region, Verdict
from dobc_design.conditions.check import Check, Values
from dobc_design.conditions.coverage import covers, read_region
from dobc_design.conditions.domain import EVERYWHERE, NEAR_TARGET, Ball, Domain
from dobc_design.conditions.quadratic.claim import Lure
from dobc_design.conditions.quadratic.decide import (
    certified_ball,
    lure_check,
    lure_from_json,
)
from dobc_design.conditions.quadratic.propose import design_lure
from dobc_design.conditions.quadratic.sectors import enclose_ranges
from dobc_design.exact.matrix import Matrix, multiply
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.loop.loop import Loop
from dobc_design.loop.make import loop_of

PAIR = exact_matrix("1/2 -1/4; -1/4 1/3")
SMALL = 1 + Fraction(1, 10**6)


def ring(
    n: int = 3,
    *,
    coupling: Any = PAPER,
    gains: Any = 3,
    side: str = "1/2",
    exosystem: Any = None,
    **more: Any,
):
    agents = range(1, n + 1)
    arcs = [[i, i % n + 1] for i in agents]
    sides = ((-Fraction(side), Fraction(side)),)
    states = sides * (2 if isinstance(coupling, list) else 1)
    region = Region(
        initial_states=states,
        initial_disturbance=Fraction(1, 10) if exosystem is not None else None,
    )
    return linked(
        arcs, n, coupling=coupling, gains=gains, exosystem=exosystem, region=region, **more
    )


def by_hand(problem: Problem, *, radius: str = "2", tau: str = "1/4", **changes: Any) -> Lure:
    """P_e = I, one tau for all arcs, the level that fits the radius exactly."""
    r = Fraction(radius)
    modes = problem.network.modes.items()
    P_e = identity(problem.n * problem.m)
    ranges = enclose_ranges(loop_of(problem), radius=r)
    multipliers = {mode: (Fraction(tau),) * len(arcs) for mode, arcs in modes}
    given = {
        "P_e": P_e,
        "ranges": ranges,
        "radius": r,
        "level": r * r / 2,
        "rate": Fraction(1, 10),
        "multipliers": multipliers,
    }
    return Lure(**(given | changes))


def observed() -> tuple[Problem, Lure]:
    """The printed pair, doubled: S = 9/16 (theory, section 9)."""
    problem = ring(10, exosystem=HARMONIC, observer=Observer(W=PAPER_GAIN))
    P = tuple(tuple(2 * x for x in row) for row in PAIR)
    Q = multiply(P, PAPER_GAIN)
    return problem, by_hand(problem, radius="3", tau="0.12", rate=Fraction(0), P=P, Q=Q)


def check_of(problem: Problem, lure: Lure, radius: float, disturbance: float = 0.0) -> Check:
    return checked(loop_of(problem), problem.observer.W, lure, radius, disturbance)


def checked(
    loop: Loop, W: Matrix | None, lure: Lure, radius: float, disturbance: float = 0.0
) -> Check:
    domain = EVERYWHERE if loop.is_linear else NEAR_TARGET
    asked = read_region(loop, W, domain=domain, everything=False)
    return lure_check(replace(asked, disturbance=disturbance), lure, radius=radius)


def refusal(
    problem: Problem, check: Check, *, domain: Domain = NEAR_TARGET, **exact: Any
) -> str | None:
    """What is wrong with a check, or with other exact values in it, after its way through JSON."""
    changed = replace(check, claim=Values({**check.exact, **exact})) if exact else check
    return confirmed(changed, problem, W=problem.observer.W, domain=domain)


def test_the_largest_ball_is_proved_and_confirmed_and_the_next_number_is_not():
    """P_e = I, level 2: the ball is sqrt 2."""
    problem = ring()
    lure = by_hand(problem)
    assert is_proved(problem, lure)
    check = check_of(problem, lure, 1.41421)
    assert check.verdict is Verdict.PROVED
    assert check.rate == 0.1
    assert check.domain == Ball(1.41421, 0.0)
    assert refusal(problem, check) is None
    assert check_of(problem, lure, 1.41422).verdict is Verdict.UNDECIDED
    domain = replace(check.domain, radius=1.41422)
    larger = replace(check, domain=domain)
    assert "not inside" in str(refusal(problem, larger))
    ball = certified_ball(loop_of(problem), lure, disturbance=0.0)
    assert ball == pytest.approx(math.sqrt(2), rel=1e-5)


@pytest.mark.parametrize(("radius", "inside"), [(0.8660254, False), (0.8660255, True)])
def test_a_ball_covers_a_region_iff_it_holds_its_corners(radius, inside):
    """Side 1/2, three agents: R^2 >= 3/4."""
    problem = ring()
    check = check_of(problem, by_hand(problem), radius)
    assert check.verdict is Verdict.PROVED
    assert covers(loop_of(problem), check, [check]) is inside


def test_with_the_observer_the_disturbance_takes_its_part_of_the_level():
    """R^2 + 10 s^2 (5 + sqrt 10)/6 <= 9/2: s = 1/2 leaves R = 1.04754."""
    problem, lure = observed()
    radius = certified_ball(loop_of(problem), lure, disturbance=0.5)
    taken = 2.5 * (5 + math.sqrt(10)) / 6
    assert radius == pytest.approx(math.sqrt(4.5 - taken), rel=1e-5)
    check = check_of(problem, lure, radius, 0.5)
    assert refusal(problem, check) is None
    domain = replace(check.domain, disturbance=0.50001)
    larger = replace(check, domain=domain)
    assert "not inside" in str(refusal(problem, larger))
    exact = dict(check.exact)
    exact.pop("P")
    changed = replace(check, claim=Values(exact))
    assert "lacks P" in str(refusal(problem, changed))
    small = [["1/8", "-1/16"], ["-1/16", "1/12"]]
    assert "matrix inequality fails" in str(refusal(problem, check, P=small))
    crooked = [["1", "-1/2"], ["-1/3", "2/3"]]
    assert "symmetric" in str(refusal(problem, check, P=crooked))


def test_without_a_level_every_coupling_has_to_be_linear():
    """h = 2 y, all k = 3: everywhere; tanh with the same claim is not shown, and "consensus" is no
    such domain."""
    linear = ring(coupling="2*y")
    ranges = enclose_ranges(loop_of(linear), radius=None)
    multipliers = {"G": (Fraction(0),) * 3}
    lure = by_hand(linear, radius="1", ranges=ranges, multipliers=multipliers)
    check = check_of(linear, replace(lure, radius=None, level=None), 0.0)
    assert check.verdict is Verdict.PROVED
    assert check.domain == EVERYWHERE
    assert refusal(linear, check, domain=EVERYWHERE) is None
    assert "must be global" in str(refusal(linear, check))
    in_ball = replace(check, domain=Ball(1.0, 0.0))
    assert "must be global" in str(refusal(linear, in_ball, domain=EVERYWHERE))
    assert "need a radius" in str(refusal(ring(coupling="2*tanh(y)"), check, domain=EVERYWHERE))
    needless = {"G": ["0", "0", "1"]}
    said = refusal(linear, check, domain=EVERYWHERE, multipliers=needless)
    assert "is not 0" in str(said)


def test_a_list_of_expressions_has_one_channel_for_every_gain():
    """h = (y1 + tanh(y2)/5, y2): off-diagonal gains take part."""
    problem = ring(coupling=["y1 + tanh(y2)/5", "y2"])
    loop = loop_of(problem)
    holds = partial(is_proved, problem)
    lure = design_lure(loop, holds=holds, shape="diagonal", largest=Fraction(3))
    assert lure is not None
    radius = certified_ball(loop, lure, disturbance=0.0)
    check = check_of(problem, lure, radius)
    assert check.verdict is Verdict.PROVED
    assert refusal(problem, check) is None
    gains = [[["1", "1"], ["0.1", "0.2"]], [["0", "0"], ["1", "1"]]]
    ranges = [{"coupling": 0, "gains": gains}]
    assert "not shown" in str(refusal(problem, check, ranges=ranges))


def test_a_claim_comes_back_from_json_as_it_went_in():
    problem, lure = observed()
    coupled = Fraction(-1, 7)
    entries = {**lure.P_e.entries, (0, 3): coupled}
    full = replace(lure, P_e=SparseSymmetric(10, entries), rate=Fraction(2, 9))
    for claim in (lure, full):
        values = json.loads(json.dumps(claim.to_json()))
        assert lure_from_json(values, loop_of(problem), PAPER_GAIN) == claim


def test_without_a_gain_the_check_does_not_apply():
    problem, lure = observed()
    loop = loop_of(problem)
    check = checked(loop, None, lure, 1.0)
    assert check.verdict is Verdict.UNDECIDED
    assert check.reason.startswith("does not apply:")
    assert "does not apply" in str(confirmed(check_of(problem, lure, 1.0), problem))
