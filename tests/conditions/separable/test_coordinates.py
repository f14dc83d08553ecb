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

ONE = Fraction(1)
T = ((ONE, Fraction(0)), (ONE, ONE / 2))
PENDULUM = ["x2", "-sin(x1) - 4*x2"]


def agents(
    n: int = 6, c: object = 8, h: object = "tanh(y1)", pins: int = 3, reach: object = 1, **given
) -> Problem:
    """p'' = sum h(p_j - p_i) - c p' on a ring that hears both neighbours; every so many-th agent
    has k = 1."""
    arcs = [[i + 1, (i + d) % n + 1] for i in range(n) for d in (1, -1)]
    parts = {
        "network": Network.from_arcs(arcs, arrow="listens_to", agents=n),
        "coupling": h,
        "gains": {i: [[1, 0]] for i in range(1, n + 1, pins)},
        "dynamics": Dynamics(A=[[0, 1], [0, -Fraction(c)]], B=[[0], [1]]),
        "region": None if reach is None else {"initial_states": [f"-{reach}", f"{reach}"]},
    }
    return Problem(**parts | given)


def pair(c: object = 3, h: str = "y1", k: object = 1, **given) -> Problem:
    """The example of the cases for the second program: 2 hears 1, 1 has k."""
    network = Network.from_arcs([[2, 1]], arrow="listens_to", agents=2)
    return agents(c=c, h=h, network=network, gains={1: [[k, 0]]}, reach=None, **given)


def claim_of(problem: Problem, v: object, rho: object = None, alpha: object = "1/7") -> Separable:
    own, weights = loop_of(problem), tuple(map(Fraction, v))
    far = None if rho is None else Fraction(rho)
    ranges = enclosed_ranges(own, T, weights, far)
    return Separable(T=T, v=weights, alpha=Fraction(alpha), rho=far, ranges=ranges)


@pytest.mark.parametrize(
    ("problem", "v", "rate"),
    [
        (pair(), (4, 3, 8, 7), Fraction(1, 7)),  # z_2' = -z_2 + (1 - (g + k)/2) z_1 + g/2 z_1j
        (pair(), (4, 3, 16, 14), Fraction(1, 4)),
        (pair(c=4), (4, 3, 8, 7), Fraction(0)),
        (pair(k=3), (4, 3, 8, 7), Fraction(1, 7)),
        # 1 - k/2 < 0: not cooperative any more, |1 - k/2| counts
        (pair(k=4), (4, 3, 8, 7), Fraction(-1, 3)),
        (
            pair(dynamics=Dynamics(f=["x2", "-x1 - 3*x2"], B=[[0], [1]])),
            (4, 3, 8, 7),
            Fraction(1, 4),
        ),
    ],
)
def test_the_slowest_rows_that_a_hand_finds(problem, v, rate):
    own = loop_of(problem)
    found = slowest_row(
        own,
        T,
        tuple(map(Fraction, v)),
        enclosed_ranges(own, T, tuple(map(Fraction, v)), None),
    )
    assert found.rate == rate


@pytest.mark.parametrize("seed", range(12))
def test_rows_are_those_of_the_worst_matrix_at_all_corners_of_the_gains(seed):
    """An oracle: z' = Z z with one gain for each arc and node; the rows of the Metzler matrix that
    bounds Z."""
    r = np.random.default_rng(seed)
    m, nodes = (2, 3)[seed % 2], seed % 3 == 0
    f = ["x2", "-sin(x1) - 4*x2"] if m == 2 else ["x2", "x3 - x1", "-x1 - sin(x2) - 3*x3"]
    A = [[0, 1], [-1, -4]] if m == 2 else [[0, 1, 0], [-1, 0, 1], [-1, -1, -3]]
    own = loop_of(
        Problem(
            network=Network.from_arcs(
                [[1, 2], [2, 3, "3/2"], [3, 1, 2], [1, 3]], arrow="listens_to", agents=3
            ),
            coupling="tanh(y1) + y2",
            gains={1: [r.integers(0, 4, m).tolist()]},
            dynamics=Dynamics(B=[[0]] * (m - 1) + [[1]], **({"f": f} if nodes else {"A": A})),
        )
    )
    turn = tuple(
        tuple(Fraction(int(x), 4) for x in row)
        for row in (4 * np.eye(m) + r.integers(-1, 2, (m, m))).tolist()
    )
    v = tuple(Fraction(int(x), 8) for x in r.integers(4, 20, 3 * m))
    ranges = enclosed_ranges(own, turn, v, Fraction(1, 2))
    X, weights, worst = to_float(turn), np.array(v, dtype=float), np.inf
    S, (arcs,) = np.linalg.inv(X), own.modes.values()
    ends = {
        each.coupling: np.array([[x.floats() for x in row] for row in each.entries])
        for each in ranges
    }
    shared = next(each for place, each in ends.items() if place != own.drift_place)
    for corner in np.ndindex((2,) * (4 + nodes)):
        Z = np.zeros((3 * m, 3 * m))
        for i in range(3):
            F = np.array(A, dtype=float)
            if nodes:
                F = ends[own.drift_place][:, :, corner[4]]
            K = to_float(own.pulls.gains[i]) + np.array(A)
            Z[i * m : i * m + m, i * m : i * m + m] += X @ (F - K) @ S
        for (i, j, w), end in zip(arcs, corner, strict=False):
            G = float(w) * X @ shared[:, :, end] @ S
            Z[i * m : i * m + m, j * m : j * m + m] += G
            Z[i * m : i * m + m, i * m : i * m + m] -= G
        metzler = np.where(np.eye(3 * m, dtype=bool), Z, np.abs(Z))
        worst = min(worst, np.min(-(metzler @ weights) / weights))
    # all gains are 1e-5 wider
    assert worst - 1e-3 <= float(slowest_row(own, turn, v, ranges).rate) <= worst + 1e-9


def test_rows_of_many_weights_at_once_are_those_of_one_at_a_time():
    network = Network.from_arcs([[2, 1], [3, 2]], arrow="listens_to", agents=3, optional=[[1, 3]])
    problem = agents(
        h="tanh(y1)",
        network=network,
        gains={1: [[1, 0]]},
        dynamics=Dynamics(f=PENDULUM, B=[[0], [1]]),
    )
    known, r = Agents.of(loop_of(problem), most=3), np.random.default_rng(1)
    T, v = r.normal(size=(2, 2)), r.uniform(0.5, 2, (5, 3, 2))
    gains = known.gains_at(T, v[0], 0.3)
    assert gains is not None
    rows = Rows.of(known, T, gains)
    each = [rows.chosen(one)[0] for one in v]
    np.testing.assert_allclose(rows.largest(v), each, rtol=1e-12, atol=1e-12)


def test_differences_reach_as_far_as_the_weights_say():
    """S = [[1, 0], [-2, 2]]: |e_i| <= rho (v_1, 2 v_1 + 2 v_2), and differences as the sums."""
    own = loop_of(pair(h="tanh(y1)"))
    assert reaches(own, T, tuple(map(Fraction, (4, 3, 8, 7))), Fraction(1, 2)) == {
        0: (6, Fraction(22))
    }


def test_a_claim_is_proved_for_what_it_says_and_not_for_a_little_more():
    """tanh(r)/r >= 3/4 up to r = 1.0 and a little, where r = 12 rho; the last row allows 1/14
    then."""
    problem, v = pair(h="tanh(y1)"), (4, 3, 8, 7)
    own, claim = loop_of(problem), claim_of(pair(h="tanh(y1)"), v, "1/12", "1/14")
    assert verify_composite(own, None, claim).verdict is Verdict.PROVED
    more = [
        replace(claim, alpha=Fraction(1, 12)),
        replace(claim, rho=Fraction(1, 10)),
        replace(claim, rho=None),
    ]
    assert all(verify_composite(own, None, each).verdict is not Verdict.PROVED for each in more)
    assert claim.spread == Fraction(1, 2) and claim.reach == 30
    assert covers(claim, radius=Fraction(1, 6), disturbance=Fraction(0))
    assert not covers(claim, radius=Fraction(1001, 6000), disturbance=Fraction(0))
    with pytest.raises(ShapeError, match="invertible"):
        replace(claim, T=((ONE, ONE), (ONE, ONE)))
    with pytest.raises(ShapeError, match="one entry > 0 per agent, or per component"):
        replace(claim, v=(ONE,) * 3)


@pytest.mark.parametrize(
    ("problem", "verdict"),
    [
        (agents(3, c="7/2", h="y1", reach=None), Verdict.PROVED),
        (agents(3, c=3, h="y1", reach=None, pins=1), Verdict.UNDECIDED),
        (agents(3, c="1/10", h="y1", reach=None), Verdict.UNDECIDED),
        (agents(3, c=4), Verdict.PROVED),
        (agents(3, c=2), Verdict.UNDECIDED),
        (agents(3, h="exp(y1) - 1 + y1"), Verdict.PROVED),
        (agents(3, dynamics=Dynamics(f=PENDULUM, B=[[0], [1]])), Verdict.PROVED),
        (
            agents(
                3, dynamics=Dynamics(f=["x2", "sin(x1)/10 - 8*x2"], B=[[0], [1]]), h="y1", pins=1
            ),
            Verdict.PROVED,
        ),
        (
            agents(
                3, dynamics=Dynamics(f=["x2", "3*sin(x1) - 8*x2"], B=[[0], [1]]), h="y1", pins=1
            ),
            Verdict.UNDECIDED,
        ),
    ],
)
def test_overdamped_agents_are_proved_and_others_are_left_open(problem, verdict):
    """z is cooperative where c^2/4 > 3, the largest degree and gain times the slope: for c >
    3.46."""
    own = loop_of(problem)
    asked = read_region(
        own, None, domain=EVERYWHERE if own.is_linear else NEAR_TARGET, everything=False
    )
    with few_coordinates() if verdict is Verdict.PROVED else nullcontext():
        (check,) = separable_stage(asked, str)
    assert check.verdict is verdict
    if verdict is Verdict.PROVED:
        assert check.claim.T is not None


@pytest.mark.evidence
def test_the_largest_box_is_found_where_the_region_is_too_wide():
    """sin(y)/y > 0 up to y = pi, where differences are twice the errors."""
    own = loop_of(agents(h="sin(y1)", reach=10))
    (check,) = separable_stage(read_region(own, None, domain=NEAR_TARGET, everything=False), str)
    assert check.verdict is Verdict.PROVED and 0.5 < check.domain.radius < 1.58


@pytest.mark.evidence
def test_no_run_from_the_boundary_leaves_a_proved_set():
    exosystem = Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]])
    problem = agents(
        region={"initial_states": [-1, 1], "initial_disturbance": "1/10"}, exosystem=exosystem
    )
    certificate = certify(problem)
    assert certificate.covered_by == "max-separable" and verify(certificate, problem).holds
    found = falsify(problem, certified=certificate, runs=60, seed=1)
    assert "boundary of the max-separable set" in str(found) and not found.suspects


@pytest.mark.evidence
def test_pendulums_shrink_in_the_norm_of_the_certificate():
    """SciPy's runs of the equations written out, from 100 corners and points of the boundary."""
    n, problem = 4, agents(4, dynamics=Dynamics(f=PENDULUM, B=[[0], [1]]))
    claim = certify(problem).check("max-separable").claim
    v, turn = np.array(claim.v, dtype=float).reshape(n, 2), to_float(claim.T)

    def slope(_, flat):
        p, speed = flat.reshape(n, 2).T
        push = np.tanh(np.roll(p, 1) - p) + np.tanh(np.roll(p, -1) - p) - np.array([1, 0, 0, 1]) * p
        return np.stack([speed, push - np.sin(p) - 4 * speed], axis=1).ravel()

    r = np.random.default_rng(2)
    for k in range(100):
        z = np.sign(r.normal(size=(n, 2))) if k % 2 else r.uniform(-1, 1, (n, 2))
        e = (z / np.abs(z).max() * v * float(claim.rho)) @ np.linalg.inv(turn).T
        run = solve_ivp(
            slope, (0, 2), e.ravel(), rtol=1e-9, atol=1e-12, t_eval=[0, 0.01, 0.1, 0.5, 1, 2]
        )
        N = [np.max(np.abs(x.reshape(n, 2) @ turn.T) / v) for x in run.y.T]
        assert np.all(
            np.array(N) <= float(claim.rho) * np.exp(-float(claim.alpha) * run.t) * (1 + 1e-7)
        )


@few_coordinates()
def test_without_a_region_a_box_around_the_target_decides_for_many_agents():
    """One mode, couplings that no common R serves (the gains are on the speed, too): only these
    rows prove it."""
    problem = agents(40, reach=None, gains={i: [[1, 1]] for i in range(1, 41, 3)})
    certificate = certify(problem)
    assert certificate.covered_by == "max-separable" and verify(certificate, problem).holds


@pytest.mark.parametrize(("gain", "rate"), [(0, Fraction(-1, 7)), (1, Fraction(1, 4))])
@few_coordinates()
@only(separable_stage)
def test_an_optional_arc_counts_only_where_it_pulls_outward(gain, rate):
    """Without the arc agent 2 has z_2' = -z_2 + (1 - k/2) z_1: 8 - 7 > 0, and with k = 1 4 - 7."""
    loose = Network.from_arcs([], optional=[[2, 1]], arrow="listens_to", agents=2)
    problem = agents(c=3, h="y1", network=loose, gains={1: [[1, 0]], 2: [[gain, 0]]}, reach=None)
    own, v = loop_of(problem), tuple(map(Fraction, (4, 3, 8, 7)))
    assert slowest_row(own, T, v, enclosed_ranges(own, T, v, None)).rate == rate
    certificate = certify(problem)
    assert verify(certificate, problem).holds
    assert (certificate.check("max-separable").verdict is Verdict.PROVED) is bool(gain)


def test_coordinates_have_a_largest_entry_1_and_none_are_those_of_a_singular_matrix():
    assert _rounded(np.array([[2.0, 0.0], [1.0, 4.0]])) == ((1, 0), (Fraction(1, 4), 1))
    for singular in ([[1, 1], [1, 1]], [[0, 0], [1, 2]], [[1, np.nan], [0, 1]], [[1, 0]]):
        assert _rounded(np.array(singular, dtype=float)) is None
