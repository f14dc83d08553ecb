"""The max-separable certificate's rows: what is proved, and its twin that just fails."""

from dataclasses import replace
from fractions import Fraction
from random import Random

import numpy as np
import pytest
from networks import (
    MONOTONE,
    TURNING,
    cycle,
    fractions,
    listening,
    loop_by_hand,
    pair,
    random_network,
    random_problem,
    sampled_rows,
)
from scipy.optimize import linprog

from dobc_design import Exosystem, Network, Observer, Problem, Verdict, load_problem
from dobc_design.conditions.separable.claim import (
    FACES,
    ErrorBound,
    Row,
    Separable,
    Term,
    is_stuck,
    rows,
    stuck_agents,
)
from dobc_design.conditions.separable.decide import (
    FaceRow,
    composite_rate,
    coupling_profiles,
    covers,
    error_bound_obstacle,
    lower_bound,
    upper_bound,
    verify_composite,
    verify_separable,
)
from dobc_design.conditions.separable.large import (
    arc_rows,
    float_kinds,
    gain_table,
    open_rows,
    turning,
)
from dobc_design.conditions.separable.propose import propose_separable, rounded_vectors
from dobc_design.conditions.separable.propose_limits import largest_rate
from dobc_design.coupling.enclosures import Curve, profile
from dobc_design.errors import ShapeError, SpecError
from dobc_design.exact.floats import Floats
from dobc_design.exact.interval import Interval
from dobc_design.loop.make import loop_of

F = Fraction
ONES = (F(1),) * 10


def verdict(problem: Problem, v, alpha, rho) -> Verdict:
    rho = None if rho is None else F(rho)
    return verify_separable(loop_of(problem), Separable(v=v, alpha=F(alpha), rho=rho)).verdict


@pytest.mark.parametrize("rho", [1, 10, 250])
def test_all_pinned_with_five_has_rate_five_for_every_radius(rho: int):
    """Theory, known answers: v = 1, exactly 5 and nothing above."""
    problem = cycle(gains=5)
    assert largest_rate(loop_of(problem), ONES, rho=F(rho)) == 5
    assert verdict(problem, ONES, 5, rho) is Verdict.PROVED
    assert verdict(problem, ONES, F(5) + F(1, 10**30), rho) is Verdict.REFUTED


# Found by the design for one pin k = 5 on the directed 10-cycle, min v = 1; rates of the theory.
ONE_PIN = [
    (1, (1, 2.4694, 2.2292, 2.0136, 1.8198, 1.6454, 1.4884, 1.3469, 1.2193, 1.104), 0.184),
    (4, (1, 1.7183, 1.616, 1.5204, 1.4309, 1.3471, 1.2685, 1.1949, 1.1258, 1.0609), 0.108),
    (
        10,
        (1, 1.38398, 1.33417, 1.28639, 1.24039, 1.19627, 1.15387, 1.11307, 1.07386, 1.03625),
        0.064,
    ),
]


@pytest.mark.parametrize(("rho", "v", "rate"), ONE_PIN)
def test_one_pin_has_the_rates_of_the_theory(rho: int, v, rate: float):
    """Theory, known answers, within 1 %; 1 % more, or a larger radius, is refuted at the face
    shown."""
    problem, v = cycle(), fractions(*v)
    alpha = largest_rate(loop_of(problem), v, rho=F(rho))
    assert alpha == pytest.approx(rate, rel=0.01)
    assert verdict(problem, v, alpha, rho) is Verdict.PROVED
    assert verdict(problem, v, alpha * F(101, 100), rho) is Verdict.REFUTED
    beyond = verify_separable(loop_of(problem), Separable(v=v, alpha=alpha, rho=F(rho) * F(11, 10)))
    assert (beyond.verdict, beyond.face) == (Verdict.REFUTED, "upper")
    assert rho < beyond.s <= F(rho) * F(11, 10)
    assert verdict(problem, (*v[:4], v[4] * F(98, 100), *v[5:]), alpha, rho) is Verdict.REFUTED


@pytest.mark.parametrize(
    "seed", [*range(4), *(pytest.param(k, marks=pytest.mark.slow) for k in range(4, 12))]
)
def test_a_claim_is_never_above_what_samples_of_the_field_allow(seed: int):
    """Random problems, monotone couplings or not: no sampled row is positive at a proved rate, some
    is at 1 % more."""
    problem = random_problem(seed, couplings=MONOTONE + TURNING, modes=1 + seed % 2)
    rho = F(1 + seed % 3, 3)
    proposal = propose_separable(loop_of(problem), rho=float(rho))
    if proposal is None:  # nobody holds some agent in one of the modes
        assert stuck_agents(loop_of(problem))
        return
    v = list(rounded_vectors(proposal))[3]
    alpha = largest_rate(loop_of(problem), v, rho=rho)
    assert proposal.rate * 0.99 < alpha < proposal.rate * 1.001
    scales = [float(rho) * s for s in (1e-4, *np.linspace(0, 1, 17)[1:])]
    assert max(sampled_rows(problem, v, s=s, alpha=float(alpha)) for s in scales) <= 1e-9
    assert max(sampled_rows(problem, v, s=s, alpha=1.01 * float(alpha)) for s in scales) > 0


def test_the_counterexample_of_the_theory_is_refused():
    """v = (1, 3/2), rho = 2: nondecreasing on |y| <= rho |v_j - v_i| = 1 is not enough.

    h(-1) = -1 would give e_2' <= -1 at e_2 = 3; but e_1 may be -2, and h(-5) is about 0.
    """
    problem, v = pair("y*exp((1 - y**2)/2)"), fractions(1, 1.5)
    assert profile(Curve(problem.coupling.components[0]), F(99, 100)).is_nondecreasing
    refused = verify_separable(loop_of(problem), Separable(v=v, alpha=F(1, 100), rho=F(2)))
    assert refused.verdict is Verdict.REFUTED
    assert (refused.agent, refused.mode) == (1, "G")
    assert "row of agent 2 in mode G fails at s = " in refused.reason
    # The twin: rho (v_1 + v_2) = 1.  h(-s/2)/s is weakest at the largest s: e^(1/2 - 1/50)/2 =
    # 0.808, divided by v_2.
    assert float(largest_rate(loop_of(problem), v, rho=F(2, 5))) == pytest.approx(
        np.exp(0.48) / 3, rel=1e-6
    )


def test_a_face_that_only_the_lower_row_sees():
    """h = exp(y) - 1 at y < 0 is flatter than at y > 0, so the two faces have different rates."""
    problem, v = pair("exp(y) - 1"), fractions(1, 2)
    # s = 1: upper h(-1) = -(1 - 1/e), so 0.316 with v_2 = 2; s -> 0 (lower): 1/2.
    assert float(largest_rate(loop_of(problem), v, rho=F(1))) == pytest.approx(
        (1 - np.exp(-1)) / 2, rel=1e-6
    )
    answer = verify_separable(loop_of(problem), Separable(v=v, alpha=F("0.32"), rho=F(1)))
    assert (answer.verdict, answer.face) == (Verdict.REFUTED, "upper")
    mirrored = verify_separable(
        loop_of(pair("1 - exp(-y)")), Separable(v=v, alpha=F("0.32"), rho=F(1))
    )
    assert (mirrored.verdict, mirrored.face) == (Verdict.REFUTED, "lower")


@pytest.mark.parametrize(("h", "face"), [("exp(y) - 1", "upper"), ("1 - exp(-y)", "lower")])
def test_the_face_that_floats_leave_open_is_the_one_that_is_decided_exactly(
    monkeypatch, h: str, face: str
):
    monkeypatch.setattr("dobc_design.conditions.separable.decide.MANY_ARCS", 0)
    answer = verify_separable(
        loop_of(pair(h)), Separable(v=fractions(1, 2), alpha=F("0.32"), rho=F(1))
    )
    assert (answer.verdict, answer.face) == (Verdict.REFUTED, face)


@pytest.mark.parametrize("lo", ["9/10", "99/100", "6/5"])
def test_a_coupling_that_turns_within_one_step_counts_with_its_maximum(lo: str):
    """10 (2 y - y^2) is 10 at y = 1 and less at 6/5: 10/s + 100 s^2 = 457/3 at s = 6/5, not 8 +
    144."""
    kinds = [
        profile(Curve(pair(h).coupling.components[0]), F(8))
        for h in ("10*(2*y - y**2)", "100*y**3")
    ]
    row = Row((Term(0, F(1), F(3), F(1)), Term(1, F(1), F(3), F(1))), F(0), F(1))
    for S in (Interval(F(lo), F(6, 5)), Floats.around(Interval(F(lo), F(6, 5)))):
        sides = FaceRow(row, 1, kinds).sides(S)
        assert upper_bound(sides, S).hi >= F(457, 3)
        assert lower_bound(sides, S.ends()[1]) <= F(457, 3) + F(1, 10**9)


@pytest.mark.slow
@pytest.mark.parametrize("h", ["sin(y) + y**2/200", "sin(y) - y**2/200"])
def test_a_maximum_inside_one_interval_counts_where_another_arc_is_worst(h: str):
    """Agent 3 hears 1 (v = 1) and 2 (v = 1/5): at s = 3.75 the first has its maximum inside, at -3
    pi/2."""
    problem = listening([[3, 1], [3, 2]], h, n=3, gains={1: 9, 2: 9, 3: 2}, target=0)
    v, rho = fractions(1, "0.2", 1), F(4)
    alpha = float(largest_rate(loop_of(problem), v, rho=rho))
    scales = np.linspace(0.01, 4, 160)
    assert max(sampled_rows(problem, v, s=s, alpha=alpha) for s in scales) <= 1e-9
    worst = max(scales, key=lambda s: sampled_rows(problem, v, s=s, alpha=alpha))
    assert 3.5 < worst <= 4
    assert max(sampled_rows(problem, v, s=s, alpha=1.001 * alpha) for s in scales) > 0


SINE = fractions(1, 1.0069, 1.0061, 1.0054, 1.0046, 1.0038, 1.0031, 1.0023, 1.0015, 1.0008)


def test_sin_with_one_pin_reaches_beyond_its_monotone_range():
    """Monotone rows stop at rho = pi/4; the general rows go to almost pi/2, and never beyond it."""
    problem = cycle(h="sin(y)")
    assert largest_rate(loop_of(problem), SINE, rho=F("1.56")) > F("0.0006")
    assert largest_rate(loop_of(problem), SINE, rho=F("1.571")) is None
    assert verdict(problem, SINE, F("0.0006"), F("1.56")) is Verdict.PROVED
    assert verdict(problem, SINE, F("0.0006"), F("1.571")) is Verdict.REFUTED


def test_a_coupling_that_turns_at_zero_is_decided_up_to_zero():
    """h = y^2, all pinned, v = 1: the largest h on [-2 s, 0] is 4 s^2, so the rate is 5 - 4 rho."""
    problem = cycle(gains=5, h="y**2")
    alpha = largest_rate(loop_of(problem), ONES, rho=F(1, 2))
    assert 3 - F(1, 10**4) < alpha <= 3
    assert verdict(problem, ONES, alpha, F(1, 2)) is Verdict.PROVED
    assert verdict(problem, ONES, F(3) + F(1, 10**6), F(1, 2)) is Verdict.REFUTED


REPELLING = listening([[2, 1]], "-y/8", n=2, gains=1, target=0)
MATRIX = listening([], "y", n=1, gains={1: [[3, 1], [-1, 2]]}, target=[0, 0])
MIXED = listening(
    [[2, 1], [3, 1, 5]], "y", n=3, exceptions={(1, 0): "2*y"}, gains={1: 10}, target=0
)
HALF = pair("y/2", weight=3)


@pytest.mark.parametrize(
    ("problem", "v", "rho", "rate"),
    [
        (HALF, (1, 1.5), None, "1/2"),  # agent 2 has 3/2 (v_1 - v_2)
        (HALF, (1, 1.5), F(10**6), "1/2"),
        # the worst neighbour is at the opposite face: 1/8 (v_1 + v_2) against k
        (REPELLING, (1, 1), None, "3/4"),
        (REPELLING, (1, 1), F(3), "3/4"),
        (MATRIX, (1,), None, "1"),  # the second component is worth 2 - 1, the first 3 - 1
        # arc (2, 1): 2 (2 - 1)/2; arc (3, 1), weight 5: 5 (10 - 1)/10
        (MIXED, (1, 2, 10), F(1), "1"),
        (MIXED, (1, 2, "1.1"), F(1), "0.454545454"),  # now 5 (1.1 - 1)/1.1
    ],
)
def test_rates_of_linear_couplings_are_those_of_closed_forms(problem, v, rho, rate):
    assert largest_rate(loop_of(problem), fractions(*v), rho=rho) == F(rate)
    assert verdict(problem, fractions(*v), F(rate), rho) is Verdict.PROVED
    assert verdict(problem, fractions(*v), F(rate) + F(1, 10**8), rho) is Verdict.REFUTED


def test_an_irrational_slope_is_enclosed():
    """h = pi y: the rate of agent 2 is pi/3 with v = (1, 3/2)."""
    problem, v = pair("pi*y"), fractions(1, 1.5)
    assert verdict(problem, v, F(104719755, 10**8), None) is Verdict.PROVED
    assert verdict(problem, v, F(104719756, 10**8), None) is Verdict.UNDECIDED
    assert verdict(problem, v, F(104719756, 10**8), 7) is Verdict.REFUTED


def test_every_mode_counts():
    for modes, verdict in (
        ({"A": [[2, 1]]}, Verdict.PROVED),
        ({"A": [[2, 1]], "B": []}, Verdict.REFUTED),
    ):
        problem = listening(modes, "y", n=2, gains={1: 1}, target=0)
        answer = verify_separable(
            loop_of(problem), Separable(v=fractions(1, 2), alpha=F(1, 2), rho=F(1))
        )
        assert answer.verdict is verdict
    assert (answer.mode, answer.agent) == ("B", 1)


VECTORS = Problem(network=pair("y").network, coupling=["y1 + y2", "y2"], gains=1, target=[0, 0])


@pytest.mark.parametrize(
    ("problem", "rho", "why"),
    [
        (
            VECTORS,
            F(1),
            "does not apply: the max-separable certificate is for couplings that act on each",
        ),
        (pair("log(1 + y)"), F(1), "does not apply: log"),
        (pair("tanh(y)"), None, "does not apply: without a radius"),
    ],
)
def test_where_the_rows_do_not_apply_nothing_is_decided(problem, rho, why):
    v = fractions(1, 1.5)
    answer = verify_separable(loop_of(problem), Separable(v=v, alpha=F(1, 9), rho=rho))
    assert answer.verdict is Verdict.UNDECIDED
    assert answer.reason.startswith(why[:16]) and why[16:] in answer.reason
    assert largest_rate(loop_of(problem), v, rho=rho) is None
    assert verdict(pair("log(1 + y)"), v, F(1, 9), F("0.39")) is Verdict.PROVED


@pytest.mark.parametrize(
    ("v", "alpha", "rho"), [((0, 1), 1, 1), ((1, 1), 0, 1), ((1, 1), 1, 0), ((), 1, 1)]
)
def test_a_claim_has_to_be_positive(v, alpha, rho):
    with pytest.raises(SpecError, match="> 0"):
        Separable(v=fractions(*v), alpha=F(alpha), rho=F(rho))
    with pytest.raises(ShapeError, match="v must have 2 entries, one per agent; got 3"):
        verify_separable(loop_of(pair("y")), Separable(v=fractions(1, 1, 1), alpha=F(1), rho=F(1)))


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in (1, 2))])
@pytest.mark.parametrize("dyadic", [True, False])
def test_the_fast_rows_prove_nothing_that_the_exact_ones_do_not(seed: int, dyadic: bool):
    """Row by row, at a rate just below and just above what the worst row allows."""
    problem = random_problem(seed, modes=1, n=12)
    unit = 2**20 if dyadic else 10**6
    v = tuple(F(round((1 + 0.1 * ((5 * i) % 7)) * unit), unit) for i in range(problem.n))
    rho = F(3, 2)
    kinds = coupling_profiles(loop_of(problem), v, rho=rho)
    assert all(kind.is_nondecreasing for kind in kinds)
    arrays = arc_rows(loop_of(problem), v)
    tables = float_kinds(kinds, arrays, rho=rho, cells=64)
    agents = [
        (agent, row)
        for agent in range(problem.n)
        for row, _ in rows(loop_of(problem), v, agents=[agent])
    ]
    for alpha in (F(1, 10), F(1)):
        answers = {
            (i, f): FaceRow(row, f, kinds).decide(alpha=alpha, rho=rho)[0]
            for i, row in agents
            for f in FACES
        }
        failed = {place for place, answer in answers.items() if answer is not Verdict.PROVED}
        left = set(open_rows(arrays, tables, alpha=alpha, rho=rho))
        assert failed <= left
        assert len(left) <= 1.2 * len(failed) + 1


def held_ring(n: int, *, h: str = "sin(y)") -> tuple[Problem, tuple[F, ...]]:
    """Every third agent pinned, both neighbours heard, v = 1 there and 5/4 elsewhere."""
    arcs = [[i + 1, (i + d) % n + 1] for i in range(n) for d in (1, -1)]
    problem = listening(arcs, h, n=n, gains={i + 1: 5 for i in range(0, n, 3)}, target=0)
    return problem, tuple(F(1) if i % 3 == 0 else F(5, 4) for i in range(n))


FALLING = [
    ("sin(y)", "3/2"),
    *(pytest.param(h, 1, marks=pytest.mark.slow) for h in ("y*exp((1 - y**2)/2)", "-y/8")),
]


@pytest.mark.parametrize(("h", "rho"), FALLING)
def test_rows_in_which_a_coupling_falls_are_decided_alike_by_floats(monkeypatch, h: str, rho):
    """Far beyond the rising range: the same rate, and the same answer just above it, as by rows one
    by one."""
    problem, v = held_ring(9, h=h)
    exact = largest_rate(loop_of(problem), v, rho=F(rho))
    monkeypatch.setattr("dobc_design.conditions.separable.decide.MANY_FALLING", 0)
    floats = largest_rate(loop_of(problem), v, rho=F(rho))
    if exact is None:
        assert floats is None
        return
    assert exact * F(998, 1000) <= floats <= exact * (1 + F(1, 10**5))
    assert verdict(problem, v, floats, rho) is Verdict.PROVED
    assert verdict(problem, v, exact * F(101, 100), rho) is Verdict.REFUTED


SLOW = ("y*exp((1 - y**2)/2)", "y/(1 + y**2)", "-y/8", "sin(y) - y**2/200")


@pytest.mark.parametrize(
    "h", ["sin(y)", "y**2", *(pytest.param(h, marks=pytest.mark.slow) for h in SLOW)]
)
def test_what_a_turning_coupling_gives_at_most_contains_samples(h: str):
    """sup h(s t)/s over -reach <= t <= step for s in a piece, both faces; smooth: nothing but the
    right end counts."""
    problem = pair(h)
    curve, (s, t) = Curve(problem.coupling.components[0]), (0.8, 1.0)
    steps, reaches = np.array([-1.4, -0.5, 0.0, 0.3, 1.0]), np.array([1.5, 2.5, 4.0, 0.9, 5.0])
    kind = profile(curve, F(5))
    f = problem.coupling.numpy_function()
    for face, low in ((1, s), (-1, s), (1, 0.0)):
        found = turning(kind, gain_table(curve.expression, F(5), cells=128), face)
        places = np.linspace(low or 1e-9, t, 21)
        ends = [face * f((face * x * steps)[:, None])[:, 0] / x for x in places]
        right = (np.min(ends, axis=0) - 1e-6, np.max(ends, axis=0) + 1e-6)
        most, smooth = found.largest(steps, reaches, right, low, t)
        largest = np.full(len(steps), -np.inf)
        for x, end in zip(places, ends, strict=True):
            y = np.linspace(-x * reaches, x * steps, 801)
            truth = np.max(face * f((face * y).reshape(-1, 1)).reshape(y.shape), axis=0) / x
            assert np.all(truth <= most + 1e-6)
            assert np.all(truth[smooth] <= end[smooth] + 1e-6)
            largest = np.maximum(largest, truth)
        assert not low or np.all(most - largest <= 0.2 * (1 + np.abs(largest)))


def test_rows_that_look_beyond_their_tables_are_not_proved():
    """Every row would hold with so much room, but beyond the end of its table a coupling may be
    anything."""
    problem = pair("y - y**3/12")
    v, rho = (F(1), F(2)), F(1)
    arcs = arc_rows(loop_of(problem), v)
    profiles = tuple(profile(Curve(each.components[0]), F(9)) for each in problem.couplings)
    near, wide = (float_kinds(profiles, arcs, rho=reach) for reach in (F(1, 8), rho))
    assert near is not None and wide is not None
    looked = open_rows(arcs, near, alpha=F(-1000), rho=rho)
    assert {row for row, _ in looked} == set(np.flatnonzero(np.diff(arcs.start)).tolist()) != set()
    assert open_rows(arcs, wide, alpha=F(-1000), rho=rho) == []


def test_a_large_network_is_decided_by_floats_and_gives_the_rate_of_the_exact_rows():
    """1500 agents in a ring of 2 neighbours: periodic v, so that exact rows are few."""
    (problem, v), rho = held_ring(1500, h="tanh(y)"), F(2)
    # Agents 2 and 3 of each three hear one at 1 and one at 5/4: tanh(s/4)/s, weakest at s = 2.
    truth = np.tanh(0.5) / 2 / 1.25
    alpha = largest_rate(loop_of(problem), v, rho=rho)
    assert truth * 0.999 < alpha <= truth
    assert verdict(problem, v, F(truth) * F(1001, 1000), rho) is Verdict.REFUTED


def problem_of(seed: int) -> Problem:
    r = Random(seed)
    n = r.randint(2, 7)
    network = random_network(r, n=n, modes=r.randint(1, 3), density=r.choice((0.2, 0.35, 0.5)))
    return Problem(
        network=network,
        coupling="y",
        gains={i: 1 for i in range(1, n + 1) if r.random() < 0.3},
        target=0,
    )


def has_common_v(problem: Problem) -> bool:
    """Feasibility of  sum (v_j - v_i) - k_i v_i <= -1,  v >= 1  in every mode; linear h, so scale
    does not matter."""
    rows = [loop_by_hand(problem, mode) for mode in problem.network.modes]
    A, b = np.vstack(rows), -np.ones(problem.n * len(rows))
    answer = linprog(np.ones(problem.n), A_ub=A, b_ub=b, bounds=(1, None), method="highs")
    assert answer.status in (0, 2)
    return answer.status == 0


def test_the_criterion_agrees_with_the_linear_program_on_100_random_graphs():
    """Theory, section 5; both answers occur often."""
    found = []
    for seed in range(100):
        problem = problem_of(seed)
        stuck = stuck_agents(loop_of(problem))
        assert bool(stuck) != has_common_v(problem), seed
        assert bool(stuck) == is_stuck(loop_of(problem), list(stuck)), seed
        found.append(not stuck)
    assert 20 < sum(found) < 80


def of_modes(modes: dict[str, list[list[int]]]) -> Problem:
    return listening(modes, "y", n=3, gains={1: 1}, target=0)


def test_orders_of_modes_that_alternate_of_a_cycle_and_of_matrix_gains():
    """Theory, section 5: 3 hears 2 in mode A, 2 hears the pinned 1 in mode B; the twin has both
    arcs in each."""
    problem = of_modes({"A": [[3, 2]], "B": [[2, 1]]})
    assert stuck_agents(loop_of(problem)) == {1: "A", 2: "A"}
    assert is_stuck(loop_of(problem), (1, 2))
    assert not is_stuck(loop_of(problem), (0, 1, 2))
    assert not stuck_agents(loop_of(of_modes({"A": [[3, 2], [2, 1]], "B": [[2, 1], [3, 1]]})))
    # Component c is worth k_cc - sum |k_cd|.
    assert not stuck_agents(loop_of(cycle(5)))
    assert list(stuck_agents(loop_of(cycle(5, gains={})))) == [0, 1, 2, 3, 4]
    network = Network.from_arcs([[2, 1]], arrow="listens_to", agents=2)
    for corner, stuck in ((1, ()), (2, (0, 1))):
        gain = [[2, corner], [-corner, 2]]
        problem = Problem(network=network, coupling="y", gains={1: gain}, target=[0, 0])
        assert tuple(stuck_agents(loop_of(problem))) == stuck


SWITCHING = load_problem("paper-switching")
W = SWITCHING.observer.W
# Found by the design for the paper's W; five digits.
V = fractions(1, 1.52644, 1.50285, 1.45348, 1.33998, 1, 1.52644, 1.50285, 1.45348, 1.33998)
BOUND = ErrorBound(
    P=((F("1.4005"), F("-0.5035")), (F("-0.5035"), F("0.6347"))),
    beta=F("1.58"),
    kappa=F("0.6333"),
    size=F("1.651"),
)
CLAIM = Separable(v=V, alpha=F("0.0301"), rho=F("4.41"), error=BOUND)


def test_the_papers_own_starts_are_covered_for_arbitrary_switching():
    """Theory, known answers: rho = 4.41, alpha = 0.0301 for all four modes, [0, 5] about 1, |eps|
    <= 1/2."""
    assert verify_composite(loop_of(SWITCHING), W, CLAIM).verdict is Verdict.PROVED
    assert covers(CLAIM, radius=F(4), disturbance=F(1, 2))
    assert float(BOUND.kappa) * 0.5 * np.sqrt(float(BOUND.size)) == pytest.approx(0.406, rel=0.01)


def test_a_little_more_of_anything_is_refuted():
    """The twins: alpha 1 % larger, rho 1 % larger, v changed by 1 %."""
    changes = (
        {"alpha": CLAIM.alpha * F(101, 100)},
        {"rho": F("4.4541")},
        {"v": (*V[:2], V[2] * F(99, 100), *V[3:])},
    )
    for change in changes:
        assert (
            verify_composite(loop_of(SWITCHING), W, replace(CLAIM, **change)).verdict
            is Verdict.REFUTED
        )
    assert not covers(CLAIM, radius=F("4.01"), disturbance=F(1, 2))
    assert not covers(CLAIM, radius=F(4), disturbance=F("0.52"))


def test_the_row_bound_is_sharp_for_each_row_of_c():
    """c'c <= P for c = (1, 0) iff the Schur complement p11 - p12^2/p22 >= 1; beta = 0.1 leaves room
    elsewhere."""
    exosystem = Exosystem(A=[[-1, 0], [0, -1]], C=[[1, 0]])
    gain = ((F(0),), (F(0),))
    for p11, holds in ((F(2), True), (F(2) - F(1, 10**30), False)):
        bound = ErrorBound(P=((p11, F(1)), (F(1), F(1))), beta=F(1, 10), kappa=F(11), size=F(3))
        assert (error_bound_obstacle(exosystem, gain, bound) is None) is holds
    # C = I and P = I; with the smaller P only the second row fails.
    exosystem = Exosystem(A=[[-1, 0], [0, -1]], C=[[1, 0], [0, 1]])
    gain = ((F(0), F(0)), (F(0), F(0)))
    unit = ((F(1), F(0)), (F(0), F(1)))
    bound = ErrorBound(P=unit, beta=F(1), kappa=F(2), size=F(1))
    assert error_bound_obstacle(exosystem, gain, bound) is None
    small = replace(bound, P=((F(1), F(0)), (F(0), F("0.99"))))
    assert (
        error_bound_obstacle(exosystem, gain, small)
        == "P does not bound row 2 of C: c'c <= P fails."
    )


def test_kappa_has_to_exceed_one_over_beta_min_v():
    edge = 1 / (BOUND.beta * CLAIM.least)
    for kappa, verdict in ((edge, Verdict.REFUTED), (edge * F(1001, 1000), Verdict.PROVED)):
        claim = replace(CLAIM, error=replace(BOUND, kappa=kappa))
        assert verify_composite(loop_of(SWITCHING), W, claim).verdict is verdict
    assert composite_rate(replace(CLAIM, error=replace(BOUND, kappa=2 * edge))) == CLAIM.alpha
    assert (
        0
        < composite_rate(replace(CLAIM, error=replace(BOUND, kappa=edge * F(1001, 1000))))
        < F("0.0016")
    )


def test_without_an_exosystem_v_is_n():
    claim = Separable(v=(F(1),) * 10, alpha=F(5), rho=F(4))
    assert verify_composite(loop_of(cycle(gains=5)), None, claim).verdict is Verdict.PROVED
    assert composite_rate(claim) == 5
    assert covers(claim, radius=F(4), disturbance=F(0))
    assert not covers(claim, radius=F(4) + F(1, 10**20), disturbance=F(0))
    claim = replace(claim, rho=None)  # without a radius everything is covered
    assert verify_composite(loop_of(cycle(gains=5, h="2*y")), None, claim).verdict is Verdict.PROVED
    assert covers(claim, radius=F(10**9), disturbance=F(0))


def test_with_an_exosystem_the_observers_part_is_required():
    for gain, claim in ((None, CLAIM), (W, replace(CLAIM, error=None))):
        assert verify_composite(loop_of(SWITCHING), gain, claim).verdict is Verdict.UNDECIDED
    with pytest.raises(SpecError, match="must be >= 0"):
        covers(CLAIM, radius=F(-1), disturbance=F(0))


def test_an_observer_that_diverges_is_refuted():
    problem = cycle(exosystem=Exosystem(A=[[0]], C=[[1]]), observer=Observer(W=[[-1]]), gains=5)
    bound = ErrorBound(P=((F(1),),), beta=F(1, 10), kappa=F(11), size=F(1))
    claim = Separable(v=(F(1),) * 10, alpha=F(1), rho=F(1), error=bound)
    assert verify_composite(loop_of(problem), problem.observer.W, claim).verdict is Verdict.REFUTED
    assert verify_composite(loop_of(problem), ((F(1),),), claim).verdict is Verdict.PROVED
