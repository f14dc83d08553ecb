"""Max-separable certificates in coordinates z = T x: known answers, twins, runs from the boundary,
an oracle."""

from contextlib import nullcontext
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from certified import few_coordinates, only
from scipy.integrate import solve_ivp

from dobc_design import Dynamics, Exosystem, Network, Problem, Verdict, certify, falsify, verify
from dobc_design.conditions.check import Check
from dobc_design.conditions.coverage import read_region
from dobc_design.conditions.domain import EVERYWHERE, NEAR_TARGET
from dobc_design.conditions.separable.claim import Separable
from dobc_design.conditions.separable.coordinates import enclosed_ranges, reaches, slowest_row
from dobc_design.conditions.separable.decide import covers, verify_composite
from dobc_design.conditions.separable.propose_coordinates import Agents, Rows, _rounded
from dobc_design.conditions.separable.stage import separable_stage
from dobc_design.errors import ShapeError
from dobc_design.exact.matrix import to_float
from dobc_design.loop.make import loop_of

F = Fraction
ONE = F(1)
T = ((ONE, F(0)), (ONE, ONE / 2))
PROVED, UNDECIDED = Verdict.PROVED, Verdict.UNDECIDED


def forced(*f: str) -> Dynamics:
    """p'' = f + input."""
    B = [[0], [1]]
    return Dynamics(f=list(f), B=B)


PENDULUM = forced("x2", "-sin(x1) - 4*x2")


def agents(
    n: int = 6, c: object = 8, h: object = "tanh(y1)", pins: int = 3, reach: object = 1, **given
) -> Problem:
    """p'' = sum h(p_j - p_i) - c p' on a ring that hears both neighbours; every so many-th agent
    has k = 1."""
    arcs = []
    for i in range(n):
        next_agent = (i + 1) % n + 1
        forward = [i + 1, next_agent]
        backward = [i + 1, (i - 1) % n + 1]
        arcs += [forward, backward]
    gains = {i: [[1, 0]] for i in range(1, n + 1, pins)}
    dynamics = Dynamics(A=[[0, 1], [0, -F(c)]], B=[[0], [1]])
    parts = {
        "network": Network.from_arcs(arcs, arrow="listens_to", agents=n),
        "coupling": h,
        "gains": gains,
        "dynamics": dynamics,
    }
    if reach is not None:
        parts["region"] = {"initial_states": [f"-{reach}", f"{reach}"]}
    return Problem(**parts | given)


def pair(c: object = 3, h: str = "y1", k: object = 1, **given) -> Problem:
    """The example of the cases for the second program: 2 hears 1, 1 has k."""
    arcs = [[2, 1]]
    network = Network.from_arcs(arcs, arrow="listens_to", agents=2)
    gains = {1: [[k, 0]]}
    return agents(c=c, h=h, network=network, gains=gains, reach=None, **given)


def rationals(*values: object) -> tuple[Fraction, ...]:
    return tuple(map(F, values))


#: Of two agents, by component.
V = rationals(4, 3, 8, 7)
FLATTER = rationals(4, 3, 16, 14)
#: z_2' = -z_2 + (1 - (g + k)/2) z_1 + g/2 z_1j.
BY_HAND = [
    (pair(), V, F(1, 7)),
    (pair(), FLATTER, F(1, 4)),
    (pair(c=4), V, F(0)),
    (pair(k=3), V, F(1, 7)),
    # 1 - k/2 < 0: not cooperative any more, |1 - k/2| counts
    (pair(k=4), V, F(-1, 3)),
    (pair(dynamics=forced("x2", "-x1 - 3*x2")), V, F(1, 4)),
]


@pytest.mark.parametrize(("problem", "v", "rate"), BY_HAND)
def test_the_slowest_rows_that_a_hand_finds(problem, v, rate):
    loop = loop_of(problem)
    ranges = enclosed_ranges(loop, T, v, None)
    assert slowest_row(loop, T, v, ranges).rate == rate


def random_nodes(r: np.random.Generator, m: int, curved: bool) -> Problem:
    """Three agents with m states, the slopes of whose dynamics are those of ``slopes``."""
    f = ["x2", "-sin(x1) - 4*x2"]
    if m == 3:
        f = ["x2", "x3 - x1", "-x1 - sin(x2) - 3*x3"]
    own = {"f": f} if curved else {"A": slopes(m)}
    arcs = [[1, 2], [2, 3, "3/2"], [3, 1, 2], [1, 3]]
    network = Network.from_arcs(arcs, arrow="listens_to", agents=3)
    drawn = r.integers(0, 4, m)
    gain = [drawn.tolist()]
    gains = {1: gain}
    zeros = [[0]] * (m - 1)
    B = [*zeros, [1]]
    dynamics = Dynamics(B=B, **own)
    return Problem(
        network=network,
        coupling="tanh(y1) + y2",
        gains=gains,
        dynamics=dynamics,
    )


def slopes(m: int) -> list[list[int]]:
    if m == 2:
        return [[0, 1], [-1, -4]]
    return [[0, 1, 0], [-1, 0, 1], [-1, -1, -3]]


def random_turn(r: np.random.Generator, m: int) -> tuple[tuple[Fraction, ...], ...]:
    """Quarters next to the identity."""
    diagonal = 4 * np.eye(m, dtype=int)
    noise = r.integers(-1, 2, (m, m))
    quarters = diagonal + noise
    return tuple(tuple(F(x, 4) for x in row) for row in quarters.tolist())


def metzler_of(loop, X, ends, corner) -> np.ndarray:
    """The Metzler matrix that bounds z' = Z z with one end of the gain for each arc and node."""
    m = loop.m
    S = np.linalg.inv(X)
    (arcs,) = loop.modes.values()
    shared = next(each for place, each in ends.items() if place != loop.drift_place)
    A = np.array(slopes(m), dtype=float)
    shape = (3, m, 3, m)
    Z = np.zeros(shape)
    for i in range(3):
        own = A
        if loop.drift_place is not None:
            own = ends[loop.drift_place][:, :, corner[4]]
        pull = to_float(loop.pulls.gains[i]) + A
        Z[i, :, i, :] += X @ (own - pull) @ S
    for (i, j, w), end in zip(arcs, corner, strict=False):
        G = float(w) * X @ shared[:, :, end] @ S
        Z[i, :, j, :] += G
        Z[i, :, i, :] -= G
    flat = Z.reshape(3 * m, 3 * m)
    condition = np.eye(3 * m, dtype=bool)
    return np.where(condition, flat, np.abs(flat))


@pytest.mark.parametrize("seed", range(12))
def test_rows_are_those_of_the_worst_matrix_at_all_corners_of_the_gains(seed):
    """An oracle: z' = Z z with one gain for each arc and node; the rows of the Metzler matrix that
    bounds Z."""
    r = np.random.default_rng(seed)
    m = (2, 3)[seed % 2]
    curved = seed % 3 == 0
    loop = loop_of(random_nodes(r, m, curved))
    turn = random_turn(r, m)
    drawn = r.integers(4, 20, 3 * m)
    v = tuple(F(int(x), 8) for x in drawn)
    ranges = enclosed_ranges(loop, turn, v, F(1, 2))
    ends = {}
    for each in ranges:
        rows = [[x.floats() for x in row] for row in each.entries]
        ends[each.coupling] = np.array(rows)
    weights = np.array(v, dtype=float)
    worst = np.inf
    for corner in np.ndindex((2,) * (4 + curved)):
        metzler = metzler_of(loop, to_float(turn), ends, corner)
        worst = min(worst, np.min(-(metzler @ weights) / weights))
    found = float(slowest_row(loop, turn, v, ranges).rate)
    # all gains are 1e-5 wider
    assert worst - 1e-3 <= found <= worst + 1e-9


def test_rows_of_many_weights_at_once_are_those_of_one_at_a_time():
    arcs = [[2, 1], [3, 2]]
    optional = [[1, 3]]
    network = Network.from_arcs(arcs, arrow="listens_to", agents=3, optional=optional)
    problem = agents(network=network, gains={1: [[1, 0]]}, dynamics=PENDULUM)
    known = Agents.of(loop_of(problem), most=3)
    r = np.random.default_rng(1)
    turn = r.normal(size=(2, 2))
    v = r.uniform(0.5, 2, (5, 3, 2))
    gains = known.gains_at(turn, v[0], 0.3)
    assert gains is not None
    rows = Rows.of(known, turn, gains)
    each = [rows.chosen(one)[0] for one in v]
    np.testing.assert_allclose(rows.largest(v), each, rtol=1e-12, atol=1e-12)


def test_differences_reach_as_far_as_the_weights_say():
    """S = [[1, 0], [-2, 2]]: |e_i| <= rho (v_1, 2 v_1 + 2 v_2), and differences as the sums."""
    loop = loop_of(pair(h="tanh(y1)"))
    found = reaches(loop, T, V, F(1, 2))
    assert found == {0: (6, 22)}


def test_a_claim_is_proved_for_what_it_says_and_not_for_a_little_more():
    """tanh(r)/r >= 3/4 up to r = 1.0 and a little, where r = 12 rho; the last row allows 1/14
    then."""
    loop = loop_of(pair(h="tanh(y1)"))
    rho = F(1, 12)
    ranges = enclosed_ranges(loop, T, V, rho)
    claim = Separable(T=T, v=V, alpha=F(1, 14), rho=rho, ranges=ranges)
    assert verify_composite(loop, None, claim).verdict is PROVED
    slow = {"alpha": F(1, 12)}
    small = {"rho": F(1, 10)}
    cases = (slow, small, {"rho": None})
    for change in cases:
        more = replace(claim, **change)
        assert verify_composite(loop, None, more).verdict is not PROVED
    assert claim.spread == F(1, 2)
    assert claim.reach == 30
    assert covers(claim, radius=F(1, 6), disturbance=F(0))
    assert not covers(claim, radius=F(1001, 6000), disturbance=F(0))
    with pytest.raises(ShapeError, match="invertible"):
        replace(claim, T=((ONE, ONE), (ONE, ONE)))
    with pytest.raises(ShapeError, match="one entry > 0 per agent, or per component"):
        replace(claim, v=(ONE,) * 3)


def linear(**parts) -> Problem:
    """Three agents that are asked about every start."""
    return agents(3, h="y1", reach=None, **parts)


def nodes(f: str) -> Problem:
    """Three agents that are all pinned, with p'' = f."""
    return agents(3, h="y1", pins=1, dynamics=forced("x2", f))


DAMPED = [
    (linear(c="7/2"), PROVED),
    (linear(c=3, pins=1), UNDECIDED),
    (linear(c="1/10"), UNDECIDED),
    (agents(3, c=4), PROVED),
    (agents(3, c=2), UNDECIDED),
    (agents(3, h="exp(y1) - 1 + y1"), PROVED),
    (agents(3, dynamics=PENDULUM), PROVED),
    (nodes("sin(x1)/10 - 8*x2"), PROVED),
    (nodes("3*sin(x1) - 8*x2"), UNDECIDED),
]


def check_of(problem: Problem) -> Check:
    """What the stage says."""
    loop = loop_of(problem)
    domain = EVERYWHERE if loop.is_linear else NEAR_TARGET
    asked = read_region(loop, None, domain=domain, everything=False)
    (check,) = separable_stage(asked, str)
    return check


@pytest.mark.parametrize(("problem", "verdict"), DAMPED)
def test_overdamped_agents_are_proved_and_others_are_left_open(problem, verdict):
    """z is cooperative where c^2/4 > 3, the largest degree and gain times the slope: for c >
    3.46."""
    with few_coordinates() if verdict is PROVED else nullcontext():
        check = check_of(problem)
    assert check.verdict is verdict
    if verdict is PROVED:
        assert check.claim.T is not None


@pytest.mark.evidence
def test_the_largest_box_is_found_where_the_region_is_too_wide():
    """sin(y)/y > 0 up to y = pi, where differences are twice the errors."""
    check = check_of(agents(h="sin(y1)", reach=10))
    assert check.verdict is PROVED
    assert 0.5 < check.domain.radius < 1.58


@pytest.mark.evidence
def test_no_run_from_the_boundary_leaves_a_proved_set():
    A = [[0, 2], [-2, 0]]
    C = [[1, 0]]
    exosystem = Exosystem(A=A, C=C)
    region = {"initial_states": [-1, 1], "initial_disturbance": "1/10"}
    problem = agents(region=region, exosystem=exosystem)
    certificate = certify(problem)
    assert certificate.covered_by == "max-separable"
    assert verify(certificate, problem).holds
    found = falsify(problem, certified=certificate, runs=60, seed=1)
    assert "boundary of the max-separable set" in str(found)
    assert not found.suspects


def pendulums(_, flat: np.ndarray) -> np.ndarray:
    """Four pendulums in a ring, of which the first and the last are pinned."""
    p, speed = flat.reshape(4, 2).T
    after = np.tanh(np.roll(p, 1) - p)
    before = np.tanh(np.roll(p, -1) - p)
    constant = np.array([1, 0, 0, 1])
    push = after + before - constant * p
    arrays = [speed, push - np.sin(p) - 4 * speed]
    return np.stack(arrays, axis=1).ravel()


@pytest.mark.evidence
def test_pendulums_shrink_in_the_norm_of_the_certificate():
    """SciPy's runs of the equations written out, from 100 corners and points of the boundary."""
    claim = certify(agents(4, dynamics=PENDULUM)).check("max-separable").claim
    v = np.array(claim.v, dtype=float).reshape(4, 2)
    turn = to_float(claim.T)
    rho = float(claim.rho)
    alpha = float(claim.alpha)
    times = [0, 0.01, 0.1, 0.5, 1, 2]
    r = np.random.default_rng(2)
    for k in range(100):
        z = np.sign(r.normal(size=(4, 2))) if k % 2 else r.uniform(-1, 1, (4, 2))
        z = z / np.abs(z).max() * v * rho
        start = z @ np.linalg.inv(turn).T
        run = solve_ivp(pendulums, (0, 2), start.ravel(), rtol=1e-9, atol=1e-12, t_eval=times)
        for time, e in zip(run.t, run.y.T, strict=True):
            turned = e.reshape(4, 2) @ turn.T
            scaled = np.abs(turned) / v
            largest = np.max(scaled)
            assert largest <= rho * np.exp(-alpha * time) * (1 + 1e-7)


@few_coordinates()
def test_without_a_region_a_box_around_the_target_decides_for_many_agents():
    """One mode, couplings that no common R serves (the gains are on the speed, too): only these
    rows prove it."""
    pinned = range(1, 41, 3)
    gains = {i: [[1, 1]] for i in pinned}
    problem = agents(40, reach=None, gains=gains)
    certificate = certify(problem)
    assert certificate.covered_by == "max-separable"
    assert verify(certificate, problem).holds


@pytest.mark.parametrize(("gain", "rate"), [(0, F(-1, 7)), (1, F(1, 4))])
@few_coordinates()
@only(separable_stage)
def test_an_optional_arc_counts_only_where_it_pulls_outward(gain, rate):
    """Without the arc agent 2 has z_2' = -z_2 + (1 - k/2) z_1: 8 - 7 > 0, and with k = 1 4 - 7."""
    optional = [[2, 1]]
    loose = Network.from_arcs([], optional=optional, arrow="listens_to", agents=2)
    gains = {1: [[1, 0]], 2: [[gain, 0]]}
    problem = agents(c=3, h="y1", network=loose, gains=gains, reach=None)
    loop = loop_of(problem)
    ranges = enclosed_ranges(loop, T, V, None)
    assert slowest_row(loop, T, V, ranges).rate == rate
    certificate = certify(problem)
    assert verify(certificate, problem).holds
    is_proved = certificate.check("max-separable").verdict is PROVED
    assert is_proved is bool(gain)


def test_coordinates_have_a_largest_entry_1_and_none_are_those_of_a_singular_matrix():
    rows = [[2.0, 0.0], [1.0, 4.0]]
    found = _rounded(np.array(rows))
    expected = ((1, 0), (F(1, 4), 1))
    assert found == expected
    zero_row = [[0, 0], [1, 2]]
    not_a_number = [[1, np.nan], [0, 1]]
    cases = ([[1, 1], [1, 1]], zero_row, not_a_number, [[1, 0]])
    for singular in cases:
        assert _rounded(np.array(singular, dtype=float)) is None
