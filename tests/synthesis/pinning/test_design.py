"""design_pinning by V = e'e: it is checked again by an oracle of its own, by exhaustive search and
by cvxpy."""

import warnings
from fractions import Fraction
from functools import partial
from itertools import combinations
from math import cos, pi
from random import Random

import cvxpy as cp
import numpy as np
import pytest
from certified import consensus_claims
from networks import digraph, linear_rate, linked, ring, star
from oracles.theorems import Oracle, form, negative_definite
from random_problems import random_problem
from scipy import sparse

import dobc_design as dd
from dobc_design import Network, Problem, Verdict
from dobc_design.conditions.consensus.claim import jacobians_at_consensus, state_theorems
from dobc_design.conditions.consensus.network import Enclosed
from dobc_design.conditions.consensus.pinning import for_rate, network_blocks, smallest_gains
from dobc_design.errors import SpecError
from dobc_design.loop.make import loop_of
from dobc_design.problem.changes import changed_problem
from dobc_design.synthesis.pinning.claim import AskedGains, Limits, _up, read_request
from dobc_design.synthesis.pinning.decide import (
    Ground,
    limit_of,
    reaches,
    slow_direction,
    structure_of,
    too_fast,
)
from dobc_design.synthesis.pinning.propose import make_proposer, slow_directions

design_pinning = partial(dd.design_pinning, conservative=True)


def lambda0(problem: Problem, mode: str):
    """J + J' by the oracle, which has its own Jacobian: Lambda of the problem without gains."""
    return Oracle(changed_problem(problem, {"pinning.gains": None})).lambda_(mode)


def rate_holds(problem: Problem, gains, rate: Fraction) -> bool:
    """Lambda0 - 2 K + 2 rate I < 0 in every mode, by the oracle's own elimination."""
    m = problem.m
    index = problem.network.index
    for mode in problem.network.modes:
        M = [list(row) for row in lambda0(problem, mode)]
        for row in range(len(M)):
            M[row][row] += 2 * rate
        for label, k in gains.items():
            for c in range(m):
                M[index[label] * m + c][index[label] * m + c] -= 2 * k
        if not negative_definite(M):
            return False
    return True


def dual_value(problem: Problem, design, costs, caps) -> Fraction:
    """The value that the exact multipliers of a design prove, multiplied out here; fails where they
    do not fit."""
    m = problem.m
    bound = design.bound
    assert all(y >= 0 and i in caps for i, y in bound.cap_prices.items())
    for label in design.bound_for:
        i = problem.network.index[label]
        load = Fraction(0)
        for _, v in bound.vectors:
            load += squares(v[i * m : (i + 1) * m])
        assert load <= costs[i] + bound.cap_prices.get(i, 0)
    total = Fraction(0)
    for mode, v in bound.vectors:
        total += form(lambda0(problem, mode), v)
        total += 2 * bound.rate * squares(v)
    paid = sum(y * caps[i] for i, y in bound.cap_prices.items())
    return total / 2 - paid


def squares(v) -> Fraction:
    return sum(x * x for x in v)


def reference(tables, allowed, caps=None):
    """The optimum of the semidefinite program by cvxpy and Clarabel, written out dense."""
    n = tables[0].shape[0]
    gains = cp.Variable(len(allowed), bounds=[0, caps])
    place = np.zeros((n, len(allowed)))
    place[allowed, np.arange(len(allowed))] = 1
    limits = []
    for table in tables:
        blocks = [[table.toarray()]]
        held = cp.bmat(blocks) + 2 * cp.diag(place @ gains)
        limits.append(held >> 0)
    objective = cp.Minimize(cp.sum(gains))
    program = cp.Problem(objective, limits)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # "may be inaccurate" at the tolerance asked for
        program.solve(solver=cp.CLARABEL, tol_gap_abs=1e-10, tol_gap_rel=1e-10, tol_feas=1e-10)
    return program.value


@pytest.mark.parametrize("seed", range(8))
def test_designed_gains_reach_the_rate_and_slightly_smaller_ones_do_not(seed):
    """The oracle decides Lambda < -2 rate I again; the design is within the last digit of the
    boundary."""
    r = Random(seed)
    problem = digraph(r, r.randint(3, 8))
    allowed = [1, 2, 3]
    design = design_pinning(problem, rate="1/10", allowed=allowed, digits=6)
    assert design.verdict is Verdict.PROVED
    assert set(design.gains) <= {"1", "2", "3"}
    rate = Fraction(1, 10)
    assert rate_holds(problem, design.gains, rate)
    smaller = {label: k * Fraction(9999, 10_000) for label, k in design.gains.items()}
    assert not rate_holds(problem, smaller, rate)
    agents = design.problem.pinning.agents
    expected = tuple(int(label) - 1 for label in design.gains)
    assert agents == expected


@pytest.mark.parametrize("seed", range(6))
def test_the_lower_bound_is_weak_duality_multiplied_out_by_hand(seed):
    """1/2 sum (v'(J + J')v + 2 rate v'v) - sum y cap, and nothing feasible is below it."""
    r = Random(seed)
    problem = digraph(r, r.randint(3, 8))
    costs = {label: r.choice((1, 2, "1/2")) for label in problem.network.labels}
    exact = list(map(Fraction, costs.values()))
    free = design_pinning(problem, rate="1/5", cost=costs, digits=9)
    cap = max(free.gains.values()) * Fraction(9, 10)
    design = design_pinning(problem, rate="1/5", cost=costs, max_gain=cap, digits=9)
    all_capped = dict.fromkeys(range(problem.n), cap)
    for each, caps in ((free, {}), (design, all_capped)):
        if each.verdict is not Verdict.PROVED:
            continue
        value = dual_value(problem, each, exact, caps)
        least = each.lower_bound
        assert value >= least > 0
        assert least <= each.cost <= least * (1 + Fraction(1, 10**6))
    assert free.verdict is Verdict.PROVED


def request_of(problem: Problem, **asked):
    return read_request(problem.network.labels, AskedGains(**asked))


def ground_of(problem: Problem, **asked) -> Ground:
    lambdas = {}
    for mode, each in state_theorems(loop_of(problem)).lambdas.items():
        lambdas[mode] = Enclosed(middle=each.constant, deviations=each.deviations)
    return Ground(problem=problem, request=request_of(problem, **asked), lambdas=lambdas)


def test_gains_on_the_boundary_do_not_reach_the_rate_and_larger_ones_do():
    """All pinned with k on a balanced graph: lambda_max(Lambda) = -2 k."""
    half = Fraction(1, 2)
    ground = ground_of(ring(3), rate=half)
    gains = dict.fromkeys(range(3), half)
    assert not reaches(ground, gains)
    more = half + Fraction(1, 10**12)
    assert reaches(ground, dict.fromkeys(range(3), more))


def with_modes(graphs) -> Problem:
    """One problem whose modes are these graphs."""
    modes = {f"G{k}": graph.network.modes["G"] for k, graph in enumerate(graphs)}
    labels = tuple(map(str, range(graphs[0].n)))
    network = Network(labels=labels, modes=modes)
    return Problem(network=network, coupling="y")


@pytest.mark.parametrize("modes", [1, 3])
def test_gains_with_caps_are_those_of_the_semidefinite_program(modes):
    """Closed form with caps for one mode, the conic program with its multipliers for several."""
    r = Random(modes)
    compared = 0
    for _ in range(5):
        n = r.randint(3, 6)
        graphs = [digraph(r, n) for _ in range(modes)]
        problem = with_modes(graphs)
        blocks = for_rate(network_blocks(loop_of(problem)), 0.2)
        allowed = sorted(r.sample(range(n), r.randint(2, n)))
        own = smallest_gains(blocks, allowed)
        if own is None:
            continue
        cap = 0.8 * float(np.max(own))
        request = request_of(problem, rate="1/5", max_gain=Fraction(cap))
        gains, _ = make_proposer(problem, request).relax(allowed, 0.2)
        optimal = reference(blocks.tables, allowed, caps=cap)
        if gains is None:
            assert not np.isfinite(optimal)
            continue
        compared += 1
        assert max(gains) <= cap * (1 + 1e-9)
        assert sum(gains) == pytest.approx(optimal, rel=1e-6)
    assert compared >= 3


def test_a_cap_that_binds_is_met_and_has_its_price():
    """One agent needs more than the cap; the others take over."""
    problem = digraph(Random(1), 6)
    free = design_pinning(problem, rate="3/10")
    cap = max(free.gains.values()) * Fraction(4, 5)
    design = design_pinning(problem, rate="3/10", max_gain=cap, digits=9)
    assert max(design.gains.values()) == cap
    assert any(sentence.startswith("Cap of agent") for sentence in design.prices)


def test_the_price_of_the_rate_bounds_every_other_rate():
    """cost(b) >= value + price (b - rate): compared with designs for other rates."""
    problem = digraph(Random(2), 6)
    allowed = [1, 2, 4]
    design = design_pinning(problem, rate="1/5", allowed=allowed, digits=9)
    for rate in ("1/10", "3/20", "21/100", "1/4"):
        other = design_pinning(problem, rate=rate, allowed=[1, 2, 4], digits=9)
        if other.verdict is Verdict.PROVED:
            faster = Fraction(rate) - Fraction(1, 5)
            assert other.cost >= design.bound.value + design.bound.rate_price * faster


def test_a_rate_beyond_the_allowed_agents_is_refuted_with_a_direction_and_a_slower_one_is_proved(
    cycle,
):
    """One pin on the ten-cycle gives less than 2 (1 - cos(pi/10)) / 2 (theory, known answers)."""
    problem = cycle(10, pins={})
    limit = 2 * (1 - cos(pi / 10))
    below, above = (Fraction(f"{limit * part:.6f}") for part in (0.999, 1.001))
    found = design_pinning(problem, rate=below, allowed=[1])
    assert found.verdict is Verdict.PROVED
    design = design_pinning(problem, rate=above, allowed=[1])
    assert design.verdict is Verdict.REFUTED
    shown = design.statements[0].exact["v"].split(", ")
    v = list(map(Fraction, shown))
    assert v[0] == 0
    assert form(lambda0(problem, "G"), v) + 2 * above * squares(v) >= 0
    assert design.nearest.verdict is Verdict.PROVED
    assert 0.98 * limit < design.nearest.rate < limit
    assert rate_holds(problem, design.nearest.gains, design.nearest.rate)


def test_where_no_rate_can_be_had_the_nearest_request_allows_more_agents():
    """3 hears 2 strongly: S on {2, 3} is [[2, -100], [-100, 200]], not positive, whatever 1
    does."""
    arcs = [[2, 1], [3, 2, 100]]
    strong = linked(arcs, 3)
    design = design_pinning(strong, rate="1/10", allowed=[1])
    assert design.verdict is Verdict.REFUTED
    assert design.nearest.verdict is Verdict.PROVED
    assert design.nearest.request.allowed == (0, 1, 2)
    arcs = [[2, 1], [3, 2]]
    gentle = linked(arcs, 3)
    found = design_pinning(gentle, rate="1/10", allowed=[1])
    assert found.verdict is Verdict.PROVED


def test_caps_that_are_too_small_are_refuted_and_the_nearest_request_raises_them(cycle):
    """All pinned on a balanced graph: the rate is at most the cap."""
    problem = cycle(5, pins={})
    design = design_pinning(problem, rate="3/10", max_gain="29/100")
    assert design.verdict == Verdict.REFUTED
    assert design.statements[0].kind == "max_gain"
    assert design.nearest.verdict is Verdict.PROVED
    raised = max(design.nearest.request.caps.values())
    assert Fraction(3, 10) < raised < Fraction(303, 1000)
    assert rate_holds(problem, design.nearest.gains, Fraction(3, 10))
    found = design_pinning(problem, rate="3/10", max_gain="31/100")
    assert found.verdict is Verdict.PROVED


def exhaustive(problem: Problem, rate: float, pins: int):
    """The least cost over all sets of at most so many agents, by trying all: float, or None."""
    blocks = for_rate(network_blocks(loop_of(problem)), rate)
    costs = []
    for chosen in combinations(range(problem.n), pins):
        gains = smallest_gains(blocks, chosen)
        if gains is not None:
            costs.append(float(gains.sum()))
    return min(costs, default=None)


@pytest.mark.parametrize("seed", [0, 1, 2, 3, 10])  # 0 and 3 are refuted
def test_the_chosen_agents_are_the_best_of_all_sets(seed):
    """Exhaustive search; the bound over all choices is proved and tight."""
    r = Random(seed)
    problem = digraph(r, r.randint(4, 8), density=0.25, cycle=False)
    pins = r.randint(1, 3)
    best = exhaustive(problem, 0.2, pins)
    design = design_pinning(problem, rate="1/5", pins=pins, digits=9)
    assert (design.verdict is Verdict.REFUTED) is (best is None)
    if best is not None:
        assert len(design.gains) <= pins
        assert float(design.cost) == pytest.approx(best, rel=1e-6)
        assert best * (1 - 1e-6) <= design.lower_bound <= design.cost


@pytest.mark.parametrize("seed", [1, 5, 6])  # 2, 1 and 3 pins
def test_the_fewest_pins_are_those_of_exhaustive_search(seed):
    r = Random(seed)
    problem = digraph(r, r.randint(4, 7), density=0.25, cycle=False)
    least = 1
    while exhaustive(problem, 0.3, least) is None:
        least += 1
    design = design_pinning(problem, rate="3/10", pins="fewest", digits=9)
    assert len(design.gains) == least
    least_cost = exhaustive(problem, 0.3, least)
    assert float(design.cost) == pytest.approx(least_cost, rel=1e-6)
    found = [s.verdict for s in design.statements if s.kind == "pins"]
    assert found == [Verdict.PROVED]
    if least > 1:
        fewer = design_pinning(problem, rate="3/10", pins=least - 1)
        assert fewer.verdict is Verdict.REFUTED
        assert len(fewer.nearest.gains) == least


def test_independent_slow_directions_count_the_pins_that_are_needed(cycle):
    """Six-cycle, rate 5/4: eigenvalues 4 (1 - cos(2 pi k/6)) of S0 below 5/2 are those of k = 0, 1,
    5: three pins."""
    six = cycle(6, pins={})
    design = design_pinning(six, rate="5/4", pins=2)
    assert design.verdict is Verdict.REFUTED
    assert design.statements[0].exact == {"least": "3"}
    found = design_pinning(six, rate="5/4", pins=3)
    assert found.verdict is Verdict.PROVED


def test_every_source_component_needs_a_pin():
    """Two pairs that hear nobody else, and one agent that hears both: two pins, whatever the
    gains."""
    pairs = [[1, 2], [2, 1], [3, 4], [4, 3]]
    arcs = [*pairs, [5, 1], [5, 3]]
    problem = linked(arcs)
    design = design_pinning(problem, rate="1/10", pins=1)
    assert design.verdict == Verdict.REFUTED
    assert design.structural_minimum == 2
    assert design.statements[0].exact["groups"] == "1, 2 | 3, 4"
    assert "agents 1 and 2; agents 3 and 4" in design.reason
    assert len(design.nearest.gains) == 2
    barred = design_pinning(problem, rate="1/10", allowed=[1, 2, 5])
    assert barred.verdict == Verdict.REFUTED
    assert barred.statements[0].kind == "structure"
    assert {"3", "4"} & set(barred.nearest.gains)


def test_groups_of_several_modes_that_overlap_are_met_by_the_fewest_agents():
    """Sources {1, 2}, {2, 3}, {3, 1} of three modes: no single agent meets them, any two do."""
    A = [[1, 2], [2, 1], [3, 1]]
    B = [[2, 3], [3, 2], [1, 2]]
    C = [[3, 1], [1, 3], [2, 3]]
    arcs = {"A": A, "B": B, "C": C}
    problem = linked(arcs)
    structure = structure_of(problem, range(3))
    assert structure.least == 2
    assert structure.exact is True
    assert len(structure.apart) == 1
    found = design_pinning(problem, rate="1/100", pins=1)
    assert found.verdict is Verdict.REFUTED
    found = design_pinning(problem, rate="1/100", pins=2)
    assert found.verdict is Verdict.PROVED


@pytest.mark.parametrize("seed", range(20))
def test_the_structural_minimum_is_the_smallest_hitting_set(seed):
    r = Random(seed)
    n = r.randint(3, 7)
    modes = r.randint(1, 3)
    graphs = [digraph(r, n, density=0.2, cycle=False) for _ in range(modes)]
    problem = with_modes(graphs)
    structure = structure_of(problem, range(n))

    def meets_all(agents) -> bool:
        return all(set(agents) & set(group) for group in structure.groups)

    least = 0
    while not any(map(meets_all, combinations(range(n), least))):
        least += 1
    assert structure.least == least
    assert structure.exact is True
    assert meets_all(structure.agents)


def test_prices_that_are_upper_bounds_are_rounded_up():
    """To the nearest six digits 1.234562 would become 1.23456."""
    assert _up(Fraction("1.234562")) == "1.23457"
    assert _up(Fraction("1/8")) == "0.125"
    assert _up(Fraction(0)) == "0"


def test_ties_are_told(cycle):
    """On the six-cycle every pair of opposite agents costs the same."""
    problem = cycle(6, pins={})
    design = design_pinning(problem, rate="1/10", pins=2)
    first, second = (int(label) for label in design.gains)
    assert (second - first) % 6 == 3
    assert any(sentence.startswith("As good") for sentence in design.ties)
    problem = cycle(6, pins={})
    one = design_pinning(problem, rate="1/10", pins=1)
    assert "would cost the same" in one.ties[0]


def test_irrational_slopes_are_enclosed_and_decided():
    arcs = [[1, 2], [2, 1], [3, 2]]
    problem = linked(arcs, coupling="sqrt(2)*y")
    design = design_pinning(problem, rate="1/10", allowed=[1], digits=6)
    laplacian = np.array([[2, -2, 0], [-2, 2, -1], [0, -1, 2]])
    S = np.sqrt(2) * laplacian - 0.2 * np.eye(3)
    least = reference([sparse.csr_array(S)], [0])
    assert float(design.cost) == pytest.approx(least, rel=1e-4)


@pytest.mark.parametrize(
    ("problem", "allowed"),
    [
        # no Z-matrix: a conic program
        (linked([[1, 2], [2, 3], [3, 1]], coupling=["y1 + y2/2", "y2"]), [1, 2]),
        (dd.load_problem("paper-switching"), [1, 6]),
    ],
)
def test_mixed_components_and_modes_that_share_their_gains_are_designed_and_bounded(
    problem, allowed
):
    design = design_pinning(problem, rate="1/10", allowed=allowed, digits=8)
    assert design.verdict is Verdict.PROVED
    assert rate_holds(problem, design.gains, Fraction(1, 10))
    ones = [Fraction(1)] * problem.n
    assert dual_value(problem, design, ones, {}) >= design.lower_bound
    assert design.gap < 1e-4


def test_certify_proves_the_designed_problem():
    """The paper's cycle: the linearised loop of the design is what Lemma 1 and Theorem 1 ask
    for."""
    design = design_pinning("paper-fixed", rate="1/20", pins=1)
    check = next(check for check in consensus_claims(design.problem).checks if check.id == "lemma1")
    assert check.verdict is Verdict.PROVED
    assert check.rate >= 0.05


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(40))
def test_every_answer_about_a_random_problem_is_true(seed):
    """Vectors, several modes, exceptions, any coupling: PROVED, its bound and REFUTED, by the
    oracle."""
    problem = random_problem(seed)
    r = Random(seed)
    pins = r.randint(1, problem.n)
    allowed = sorted(r.sample(range(problem.n), pins))
    labels = [problem.network.labels[i] for i in allowed]
    cap = r.choice((None, "3/2", 20))
    try:
        design = design_pinning(problem, rate="1/10", allowed=labels, max_gain=cap, digits=6)
    except SpecError:
        return
    exact = all(Oracle(problem).exact_in(mode) for mode in problem.network.modes)
    rate = Fraction(1, 10)
    if design.verdict is Verdict.PROVED:
        for k in design.gains.values():
            assert k <= Fraction(cap or 10**9)
        if exact:
            assert rate_holds(problem, design.gains, rate)
            caps = {} if cap is None else dict.fromkeys(range(problem.n), Fraction(cap))
            costs = [Fraction(1)] * problem.n
            value = dual_value(problem, design, costs, caps)
            assert max(value, 0) >= design.lower_bound
    elif design.verdict is Verdict.REFUTED and exact:
        largest = dict.fromkeys(labels, Fraction(cap or 10**6))
        assert not rate_holds(problem, largest, rate)
    else:
        assert not exact


def test_a_design_shows_itself_and_long_work_says_what_it_does():
    said = []
    design = design_pinning("paper-fixed", rate="1/20", allowed=[1], progress=said.append)
    assert "proving the gains and their bound" in said
    text = str(design)
    document = design.to_json()
    assert text.startswith("proved: gains on agent 1 reach the rate 1/20")
    assert document["gains"] == {"1": "9191/10000"}
    assert document["lower_bound"] <= document["cost"]
    assert document["structural_minimum"] == 1


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"rate": 0}, "rate must be > 0"),
        ({"rate": 1, "allowed": []}, "allowed must name at least one agent"),
        ({"rate": 1, "allowed": [77]}, "allowed: there is no agent"),
        ({"rate": 1, "allowed": "1"}, "allowed must be a list"),
        ({"rate": 1, "cost": 0}, "cost must be > 0"),
        ({"rate": 1, "cost": {"x": 1}}, "cost: there is no agent"),
        ({"rate": 1, "max_gain": {"1": -1}}, "max_gain.1 must be > 0"),
        ({"rate": 1, "pins": 0}, "pins must be an integer >= 1"),
        ({"rate": 1, "pins": "few"}, "pins must be an integer >= 1"),
        ({"rate": 1, "digits": 0}, "digits must be an integer"),
    ],
)
def test_a_wrong_request_is_one_clear_error(asked, words):
    with pytest.raises(SpecError, match=words):
        design_pinning("paper-fixed", **asked)
    arcs = [[1, 2], [2, 1]]
    kinked = linked(arcs, coupling="abs(y)")
    with pytest.raises(SpecError, match="must have a derivative at the consensus"):
        design_pinning(kinked, rate=1)


@pytest.mark.parametrize("seed", range(20))
def test_no_gains_beat_the_limit_and_large_ones_come_close(seed: int):
    """Against the eigenvalues of random loops with random gains, caps included."""
    r = Random(seed)
    problem = digraph(r, 6, density=0.4, cycle=False, coupling="sin(y)")
    pinned = r.sample(range(6), 3)
    caps = {pinned[0]: Fraction(1, 2)}
    found = slow_direction(jacobians_at_consensus(loop_of(problem)), pinned, caps, slow_directions)
    for _ in range(20):
        gains = {}
        for i in pinned:
            gains[i] = r.uniform(0, 0.5) if i in caps else 10 ** r.uniform(-2, 6)
        assert linear_rate(problem, gains) <= float(found.limit) + 1e-9
    largest = {i: 0.5 if i in caps else 1e9 for i in pinned}
    assert linear_rate(problem, largest) == pytest.approx(float(found.limit), abs=1e-6)


def test_a_direction_that_moves_a_free_agent_or_has_a_negative_entry_shows_nothing():
    mode = jacobians_at_consensus(loop_of(ring(3))).modes[0]

    def limit(*w: int, pinned: tuple[int, ...]) -> Fraction | None:
        return limit_of(mode, 0, w, pinned=pinned, caps={})

    found = limit(1, 0, 0, pinned=(0,))
    assert found is None
    found = limit(1, 0, 0, pinned=(0, 1))
    assert found is None
    found = limit(-1, 0, 2, pinned=(1,))
    assert found is None
    assert limit(0, 0, 0, pinned=()) is None
    found = limit(0, 0, 1, pinned=(0,))
    assert found == 1
    loop = loop_of(ring(3, coupling="-y"))
    turned = jacobians_at_consensus(loop)
    assert slow_direction(turned, (0,), {}, slow_directions) is None


def test_two_pins_of_a_star_are_excluded_above_1_and_not_below():
    """Four leaves return at 1 unless held: six sets, all too slow for 1.01; none of them for 1."""

    def ask(rate: str):
        allowed = (0, 1, 2, 3)
        limits = Limits(rate=Fraction(rate), allowed=allowed, caps={}, pins=2, digits=4)
        return too_fast(star(4), limits, slow_directions)

    refuted = ask("1.01")
    assert refuted.exact["sets"] == "6"
    assert ask("1") is None
