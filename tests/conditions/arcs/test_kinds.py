"""Arc-wise certificates of every kind of problem that they know, and what they refuse by name.

Runs from the boundary of what is proved are the oracle: they integrate the problem as it is stated.
"""

from dataclasses import replace
from fractions import Fraction
from functools import cache
from typing import Any

import numpy as np
import pytest
from arc_wise import on_the_boundary, radius_of, searched
from networks import around, linked

from dobc_design import Check, Dynamics, Exosystem, Network, Observer, Problem, falsify
from dobc_design.conditions.arcs.claim import ArcWise
from dobc_design.conditions.arcs.decide import confirm, obstacle, why_not
from dobc_design.conditions.case import Case
from dobc_design.conditions.domain import NEAR_TARGET, Ball, Box
from dobc_design.loop.make import loop_of
from dobc_design.loop.pairs import rows_of

F = Fraction
SINES: dict[str, Any] = {"arcs": around(3), "n": 3, "coupling": "sin(y)"}
HARMONIC = Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]])
SEEN = {"exosystem": HARMONIC, "observer": Observer(W=[["16/5"], ["12/5"]])}
W = ((F(16, 5),), (F(12, 5),))
LOOSE = Network.from_arcs([[1, 2]], arrow="listens_to", optional=[[2, 1]])
SIGNED = Network.from_arcs(
    [[2, 1, -1], [1, 3], [3, 2]], arrow="listens_to", agents=3, negative="opposes"
)
POST = Network.from_arcs(
    [[1, "post", 3], [1, 2], [2, 1], [2, "post"]], arrow="listens_to", fixed=["post"]
)
MODES = {"A": [[1, 2], [2, 3]], "B": [[3, 1, "1/2"], [2, 1]]}

SOME = {"A": {1: 2, 2: 2, 3: 2}, "B": {1: 3, 2: 3, 3: 2}}
LIMITED = {"limit": 2, "saturates": True}
WATCHED_STARTS = {"initial_states": ["-1/2", "1/2"], "initial_disturbance": "1/20"}


def sines(**given: Any) -> Problem:
    return linked(**SINES | given)


def problems() -> dict[str, Problem]:
    planar = [[3, 1], [0, 3]]
    two = {"target": [0, 0], "gains": {1: planar, 2: 3, 3: 3}}
    inside = {"initial_states": ["-1/2", "1/2"]}
    return {
        "one pin": sines(gains={1: 3}),
        "two modes": sines(arcs=MODES, gains=2),
        "arcs that come and go": Problem(network=LOOSE, coupling="sin(y)", gains=2),
        "pins of single modes": sines(arcs=MODES, gains=None, mode_gains=SOME),
        "pins that are cut": sines(gains=3, actuators=LIMITED, region=inside),
        "a formation": sines(gains={1: 3}, offsets={1: 1, 2: -2}),
        "two components": sines(**two),
        "nodes with f": sines(gains=3, dynamics=Dynamics(f=["x - x**3"])),
        "nodes with A": sines(gains=3, dynamics=Dynamics(A=[[1]])),
        "a leader in a box": sines(
            gains=3,
            dynamics=Dynamics(f=["x**3/100 - x"]),
            leader={"initial": ["-1/2", "1/2"], "stays_in": [-1, 1]},
        ),
        "opponents": Problem(network=SIGNED, coupling="sin(y)", gains=2),
        "a fixed node": Problem(network=POST, coupling="tanh(y)", fixed={"post": 1}),
        "agreement": linked([[1, 2], [2, 1], [2, 3], [3, 1]], 3, "sin(y)", goal="agreement"),
        "agreement with a root": linked([[2, 1], [3, 2], [2, 3]], 3, "sin(y)", goal="agreement"),
        "exceptions": sines(gains={1: 3}, exceptions={(1, 2): "tanh(2*y) - y/3"}),
    }


PROBLEMS = problems()


@cache
def proved(name: str) -> Check:
    return searched(PROBLEMS[name])


Error = np.ndarray  # (..., n)


def ring(e: Error) -> Error:
    return np.sin(np.roll(e, -1, axis=-1) - e)


def opposed(e: Error) -> Error:
    x, y, z = np.moveaxis(e, -1, 0)
    return np.stack([np.sin(z - x), np.sin(-x - y), np.sin(y - z)], axis=-1) - 2 * e


def held(e: Error) -> Error:
    x, y = np.moveaxis(e, -1, 0)
    return np.stack([3 * np.tanh(-x) + np.tanh(y - x), np.tanh(x - y) + np.tanh(-y)], axis=-1)


ORDERED = ((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1))


def differences(x: Error) -> Error:
    """Of three agents, in the order of pairs."""
    return np.stack([x[..., i] - x[..., j] for i, j in ORDERED], axis=-1)


def agreeing(e: Error) -> Error:
    """x_1 = 0 says what the others are."""
    y, z = -e[..., 0], -e[..., 1]
    return differences(np.stack([np.sin(y), np.sin(-y) + np.sin(z - y), np.sin(-z)], axis=-1))


def led(e: Error) -> Error:
    y, z = np.moveaxis(e, -1, 0)
    return np.stack([np.sin(-y) + np.sin(z - y), np.sin(y - z)], axis=-1)


def cubic(x: Error) -> Error:
    return x**3 / 100 - x


def behind(s: float) -> Any:
    return lambda e: ring(e) - 3 * e + cubic(s + e) - cubic(np.array(s))


BY_HAND: dict[str, list[Any]] = {
    "opponents": [opposed],
    "a fixed node": [held],
    "agreement": [agreeing],
    "agreement with a root": [led],
    "pins that are cut": [lambda e: ring(e) - np.clip(3 * e, -2, 2)],
    "a leader in a box": [behind(s) for s in np.linspace(-1, 1, 9)],
}


@pytest.mark.slow
@pytest.mark.parametrize("name", BY_HAND)
def test_where_no_search_for_failures_helps_v_falls_on_samples_of_its_set(name: str):
    claim = proved(name).claim
    assert isinstance(claim, ArcWise)
    d = np.array([float(x) for x in claim.d])
    if name == "agreement":
        e = differences(np.random.default_rng(0).standard_normal((4000, 3)))
        e *= np.sqrt(float(claim.level) / np.sum(d * e * e, axis=1))[:, None]
    else:
        e = on_the_boundary(d, float(claim.level), 4000, np.random.default_rng(0))
    for share in (1.0, 0.7, 0.2, 1e-3):
        inside = share * e
        fall = 2 * float(claim.rate) * np.sum(d * inside * inside, axis=1)
        for moved in BY_HAND[name]:
            rise = 2 * np.sum(d * inside * moved(inside), axis=1)
            assert np.all(rise <= -fall * (1 - 1e-9))


@pytest.mark.slow  # every run; that nothing larger is claimed is among the fast ones
@pytest.mark.parametrize("name", [name for name in PROBLEMS if name not in BY_HAND])
def test_runs_from_the_boundary_of_what_is_proved_stay_and_are_no_slower(name: str):
    problem = PROBLEMS[name]
    check = proved(name)
    assert radius_of(check) > 0.3
    found = falsify(problem, certified=check, runs=30, seed=7, t_final=6)
    assert found.tried >= 30
    assert not found.suspects


def case_of(problem: Problem, gain: Any = None) -> Case:
    loop = rows_of(loop_of(problem), gain)
    assert loop is not None
    return Case(loop=loop, W=gain, domain=NEAR_TARGET)


@pytest.mark.parametrize("name", PROBLEMS)
def test_what_is_proved_is_confirmed_and_neither_a_larger_set_nor_a_faster_rate_is(name: str):
    case = case_of(PROBLEMS[name])
    check = proved(name)
    assert confirm(check, case) is None
    domain = check.domain
    assert isinstance(domain, Ball | Box)
    larger = replace(check, domain=replace(domain, radius=domain.radius * F(101, 100)))
    assert "not inside" in (confirm(larger, case) or "")
    faster = replace(check, rate=check.rate + F(1, 10**4))
    assert "does not follow" in (confirm(faster, case) or "")


# --- Observers
WATCHED = sines(gains=4, region=WATCHED_STARTS, **SEEN)


def test_with_observers_the_estimation_error_is_part_of_v_and_runs_stay():
    """S = C (-Omega0 - 2 rate P)^-1 C' is worked out by hand for the P of the claim."""
    check = searched(WATCHED, W)
    claim = check.claim
    assert isinstance(claim, ArcWise)
    assert claim.P is not None
    assert isinstance(check.domain, Box)
    assert confirm(check, case_of(WATCHED, W)) is None
    found = falsify(WATCHED, certified=check, runs=60, seed=7, t_final=6)
    assert found.tried >= 60
    assert not found.suspects
    S = schur_by_hand(claim.P, claim.rate)
    left = slack(claim, S)
    assert min(left) >= 0
    # As much more as the least agent has left, and a little: refused.
    taken = S + min(left) + F(1, 10**9)
    loop = loop_of(WATCHED)
    less = replace(claim, P=[[x * S / taken for x in row] for row in claim.P])
    less = replace(less, Q=[[x * S / taken for x in row] for row in claim.Q or ()])
    assert "take more of" in (why_not(loop, less) or "")
    assert why_not(loop, claim) is None


def schur_by_hand(P: Any, rate: F) -> F:
    """Two by two: C = (1, 0), A - W C = [-16/5 2; -22/5 0]."""
    (p, q), (_, r) = P
    closed = ((F(-16, 5), F(2)), (F(-22, 5), F(0)))
    top = -2 * (p * closed[0][0] + q * closed[1][0]) - 2 * rate * p
    side = -(p * closed[0][1] + q * closed[1][1] + closed[0][0] * q + closed[1][0] * r)
    side -= 2 * rate * q
    end = -2 * (q * closed[0][1] + r * closed[1][1]) - 2 * rate * r
    return end / (top * end - side * side)


def slack(claim: ArcWise, S: F) -> list[F]:
    """Of three agents on a cycle with k = 4: 2 d k - a - b - 2 rate d - d^2 S."""
    left = []
    for i, d in enumerate(claim.d):
        arcs = claim.a["G"][i] + claim.b["G"][(i - 1) % 3]
        left.append(8 * d - arcs - 2 * claim.rate * d - d * d * S)
    return left


def test_two_modes_share_d_and_have_numbers_of_their_own():
    check = proved("two modes")
    claim = check.claim
    assert isinstance(claim, ArcWise)
    assert set(claim.a) == {"A", "B"}
    assert len(claim.d) == 3
    swapped = replace(claim, a={"A": claim.a["B"], "B": claim.a["A"]})
    assert why_not(loop_of(PROBLEMS["two modes"]), swapped)


def test_arcs_that_come_and_go_have_no_negative_numbers():
    loose, sure = (
        proved("arcs that come and go"),
        searched(linked([[1, 2], [2, 1]], 2, "sin(y)", gains=2)),
    )
    assert isinstance(loose.claim, ArcWise)
    assert min(loose.claim.a["G"][1], loose.claim.b["G"][1]) >= 0
    assert radius_of(loose) <= radius_of(sure)


# --- What is refused by name
CROSSED = linked([[1, 2]], 2, ["y1 + y2", "y2"], gains=3, target=[0, 0])
MOVING = sines(gains=3, dynamics=Dynamics(f=["x2", "-x1 - x2"], B=[[0], [1]]), coupling="y1 + y2")
GAP = Problem(
    network=Network.from_arcs([[1, "p"], [2, "q"], [1, 2]], arrow="listens_to", fixed=["p", "q"]),
    coupling="sin(y)",
    goal="containment",
    fixed={"p": 0, "q": 1},
)
REFUSED = {
    "for one function that acts on every component by itself": sines(
        coupling=["sin(y1)", "tanh(y2)"], gains=3, target=[0, 0]
    ),
    "one function that acts on every component by itself": CROSSED,
    "acts on every component by itself.": MOVING,
    "the fixed nodes differ or move": GAP,
    "there is no observer gain W": sines(gains=3, exosystem=HARMONIC),
    "two agents that differ have two estimation errors": linked(
        [[1, 2], [2, 1], [2, 3], [3, 1]], 3, "sin(y)", goal="agreement", **SEEN
    ),
}


@pytest.mark.parametrize("words", REFUSED)
def test_what_does_not_fit_is_refused_by_name(words: str):
    loop = rows_of(loop_of(REFUSED[words]), None)
    assert loop is not None
    assert words in (obstacle(loop, None) or "")


def test_a_refused_problem_confirms_no_claim():
    honest = proved("one pin")
    assert "acts on every component by itself" in (confirm(honest, case_of(CROSSED)) or "")


def test_the_unit_of_the_states_does_not_matter():
    """sin(1e10 y) / 1e10 is sin in a unit that is 1e10 times as large."""
    radii = []
    for unit in (1, 10**10):
        problem = linked(
            [[1, 2], [2, 1]],
            2,
            f"sin({unit}*y)/{unit}",
            gains=3,
            region={"initial_states": [f"-1/{unit}", f"1/{unit}"]},
        )
        radii.append(radius_of(searched(problem)) * unit)
    assert radii[1] == pytest.approx(radii[0])


@pytest.mark.slow
def test_beyond_five_hundred_arcs_weights_are_few_and_prove_a_tree():
    """With d = 1 an agent that three others hear has not enough for all of them."""
    tree = [[i, i // 3 + 1] for i in range(2, 602)]
    check = searched(linked(tree, 601, "sin(y)", gains={1: 3}))
    assert radius_of(check) > 0.04
    assert isinstance(check.claim, ArcWise)
    assert 1 < len(set(map(float, check.claim.d))) < 40
