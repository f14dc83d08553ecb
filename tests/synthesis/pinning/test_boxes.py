"""Gains for a box: closed forms, a geometric program by cvxpy, rows sampled by hand."""

import warnings
from fractions import Fraction
from random import Random

import cvxpy as cp
import numpy as np
import pytest
from networks import cycle, digraph, linear_rate, linked

import dobc_design as dd
from dobc_design import Network, Problem, Verdict
from dobc_design.conditions.separable.decide import covers, verify_composite, verify_separable
from dobc_design.errors import SpecError
from dobc_design.loop.make import loop_of
from dobc_design.problem.changes import changed_problem
from dobc_design.synthesis.pinning import search_regions

RATE = Fraction(1, 10)


def geometric_program(problem: Problem, allowed, rate: float) -> float:
    """The least total gain for h = y: k_i + d_i - rate = the largest posynomial, in cvxpy's own
    geometric form."""
    n = problem.n
    v = cp.Variable(n, pos=True)
    total = cp.Variable(len(allowed), pos=True)
    place = {agent: number for number, agent in enumerate(allowed)}
    limits = []
    offset = 0.0
    for number, arcs in enumerate(problem.network.modes.values()):
        for i in range(n):
            heard = [(j, float(w)) for own, j, w in arcs if own == i]
            room = sum(w for _, w in heard) - rate
            flow = sum((w * v[j] / v[i] for j, w in heard), 0.0)
            if i not in place:
                limits.append(flow <= room)
            else:
                assert room > 0
                assert number == 0 or len(problem.network.modes) == 1
                limits += [flow <= total[place[i]], total[place[i]] >= room]
                offset += room
    objective = cp.Minimize(cp.sum(total))
    program = cp.Problem(objective, limits)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        program.solve(gp=True, solver=cp.CLARABEL)
    return float(program.value) - offset


def test_one_pin_on_a_linear_cycle_has_its_gain_in_closed_form():
    """h = 2 y on six agents: v grows by 1/(1 - rate/2) from agent to agent, and k = rate - 2 + 2
    v_6."""
    problem = cycle(6, gains={}, h="2*y")
    design = dd.design_pinning(problem, rate=RATE, allowed=[1], region=5, digits=9)
    k = 0.1 - 2 + 2 / (1 - 0.05) ** 5
    assert design.verdict is Verdict.PROVED
    assert float(design.gains["1"]) == pytest.approx(k, rel=1e-6)
    assert float(design.cost) >= k * (1 - 1e-12)
    span = float(max(design.certificate.v))
    assert abs(np.log10(span) + 5 * np.log10(0.95)) < 1e-6
    # sum log(v_j/v_i) = 0: k = rate each
    four = cycle(4, gains={})
    whole = dd.design_pinning(four, rate=RATE, region=2, digits=9)
    assert float(whole.cost) == pytest.approx(0.4, rel=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_linear_gains_are_those_of_the_geometric_program_and_of_the_spectrum(seed):
    """cvxpy's geometric form is the oracle of the cost; A - D - K + rate I has to be stable, and
    just is."""
    r = Random(seed)
    n = r.randint(4, 7)
    problem = digraph(r, n, density=2 / n)
    allowed = sorted(r.sample(range(problem.n), 2))
    labels = [i + 1 for i in allowed]
    design = dd.design_pinning(problem, rate="1/20", allowed=labels, region=1, digits=9)
    if design.verdict is not Verdict.PROVED:
        assert design.verdict is Verdict.REFUTED
        assert linear_rate(problem, dict.fromkeys(allowed, 1e6)) < 0.05
        return
    least = geometric_program(problem, allowed, 0.05)
    assert float(design.cost) == pytest.approx(least, rel=1e-5)
    index = problem.network.index
    gains = {index[label]: float(k) for label, k in design.gains.items()}
    smaller = {i: 0.999 * k for i, k in gains.items()}
    assert linear_rate(problem, gains) >= 0.05 > linear_rate(problem, smaller)


def test_rows_of_the_designed_gains_hold_on_a_grid_and_fail_for_smaller_gains():
    """exp(y) - 1 + y over |e_i| <= 4: both faces of every agent at many s, written out here."""
    design = dd.design_pinning("paper-fixed", rate="1/20", allowed=[1, 6], region=4)
    v = np.array([float(x) for x in design.certificate.v])

    def worst(factor: float) -> float:
        k = np.zeros(10)
        for label, gain in design.gains.items():
            k[int(label) - 1] = factor * float(gain)
        step = v[np.arange(1, 11) % 10] - v  # agent i listens to i + 1
        rows = []
        for s in np.linspace(1e-3, 4, 200):
            for face in (1, -1):
                move = face * s * step
                pull = face * (np.expm1(move) + move) / s
                rows.append(pull - (k - 0.05) * v)
        return float(np.max(rows))

    assert worst(1.0) <= 1e-12
    assert worst(0.99) > 0
    cap = min(design.gains.values()) * Fraction(99, 100)
    weaker = dd.design_pinning("paper-fixed", rate="1/20", allowed=[1, 6], region=4, max_gain=cap)
    assert weaker.verdict is not Verdict.PROVED


def test_the_certificate_of_a_design_is_the_one_that_was_proved():
    arcs = {}
    for seed in range(2):
        graph = digraph(Random(seed), 5, density=0.4)
        arcs[f"G{seed}"] = graph.network.modes["G"]
    network = Network(labels=tuple("12345"), modes=arcs)
    problem = Problem(network=network, coupling="tanh(y)")
    design = dd.design_pinning(problem, rate="1/100", region="1/2")
    found = verify_separable(loop_of(design.problem), design.certificate)
    assert found.verdict is Verdict.PROVED
    assert min(design.certificate.v) == 1
    weaker = {label: k / 2 for label, k in design.gains.items()}
    held = changed_problem(problem, {"pinning.gains": weaker})
    found = verify_separable(loop_of(held), design.certificate)
    assert found.verdict is Verdict.REFUTED


def test_a_rate_that_the_others_cannot_have_is_refuted_by_a_slow_direction():
    """An agent that hears with the gain 2 alone follows with a rate below 2, for every v and
    radius."""
    problem = cycle(2, gains={}, h="2*y")
    design = dd.design_pinning(problem, rate="2.01", allowed=[1], region=1)
    assert design.verdict == Verdict.REFUTED
    assert design.statements[0].kind == "rate"
    assert design.nearest.verdict is Verdict.PROVED
    assert 1 <= design.nearest.rate <= Fraction(201, 200)
    slower = dd.design_pinning(problem, rate="3/2", allowed=[1], region=1)
    assert slower.verdict is Verdict.PROVED
    at_it = dd.design_pinning(problem, rate=2, allowed=[1], region=1)
    assert at_it.verdict is Verdict.UNDECIDED


def test_modes_in_which_no_order_serves_all_are_refuted_whatever_the_gains():
    """2 hears 3 only in one mode, 3 hears 2 only in the other: theory, section 5."""
    modes = {"A": [[2, 1], [3, 2]], "B": [[3, 1], [2, 3]]}
    problem = linked(modes, 3, coupling="tanh(y)")
    design = dd.design_pinning(problem, rate="1/100", allowed=[1], region=1)
    assert design.verdict == Verdict.REFUTED
    assert design.statements[0].kind == "ordering"
    assert "agents 2 and 3" in design.reason
    another = dd.design_pinning(problem, rate="1/100", allowed=[1, 2], region=1)
    assert another.verdict is Verdict.PROVED


@pytest.mark.slow
def test_pins_are_limited_and_the_fewest_are_found():
    one = dd.design_pinning("paper-fixed", rate="1/50", region=2, pins=1)
    assert one.verdict == Verdict.PROVED
    assert len(one.gains) == 1
    arcs = [[1, 2], [2, 1], [3, 4], [4, 3]]
    apart = linked(arcs, 4, coupling="y + y**3")
    few = dd.design_pinning(apart, rate="1/10", region=1, pins="fewest")
    assert few.verdict == Verdict.PROVED
    assert len(few.gains) == 2
    found = [s.verdict for s in few.statements if s.kind == "pins"]
    assert found == [Verdict.PROVED]
    fewer = dd.design_pinning(apart, rate="1/10", region=1, pins=1)
    assert fewer.verdict is Verdict.REFUTED


def test_a_box_that_does_not_hold_the_region_is_no_proof(monkeypatch):
    """Halved weights prove the same rows, and a box of half the size."""
    propose = search_regions.propose_for_box

    def cheaper(*given, **more):
        for v, k in propose(*given, **more):
            yield tuple(x / 2 for x in v), k

    problem = cycle(4, gains={})
    found = dd.design_pinning(problem, rate="1/10", region=1)
    assert found.verdict is Verdict.PROVED
    monkeypatch.setattr(search_regions, "propose_for_box", cheaper)
    found = dd.design_pinning(problem, rate="1/10", region=1)
    assert found.verdict is Verdict.UNDECIDED


@pytest.mark.slow
def test_the_region_of_the_file_leaves_room_for_the_observer():
    """Printed W, |eps_i| <= 1/2: rho is larger than 4, and the composite is proved for the designed
    gains."""
    problem = dd.load_problem("paper-switching")
    design = dd.design_pinning(problem, rate="1/50", region=True, allowed=[1, 6])
    claim = design.certificate
    assert design.verdict is Verdict.PROVED
    assert claim.rho > 4
    found = verify_composite(loop_of(design.problem), problem.observer.W, claim)
    assert found.verdict is Verdict.PROVED
    assert covers(claim, radius=Fraction(4), disturbance=Fraction(1, 2))
    assert not covers(claim, radius=claim.rho, disturbance=Fraction(1, 2))


def test_where_couplings_end_or_mix_components_there_is_no_box_and_no_error():
    problem = cycle(4, gains={}, h="sqrt(1 + y) - 1")
    for region, verdict in ((10, Verdict.UNDECIDED), ("1/10", Verdict.PROVED)):
        design = dd.design_pinning(problem, rate="1/100", region=region, allowed=[1])
        assert design.verdict is verdict
    arcs = [[1, 2], [2, 1]]
    mixing = linked(arcs, coupling=["y1 + y2/2", "y2"])
    design = dd.design_pinning(mixing, rate="1/10", region=1)
    assert design.verdict == Verdict.UNDECIDED
    assert design.statements[0].kind == "method"


@pytest.mark.parametrize(
    ("problem", "region", "words"),
    [
        (cycle(3, gains={}), 0, "region must be > 0"),
        (cycle(3, gains={}), True, "there is none"),
        (cycle(3, gains={}), "wide", "region"),
        ("paper-fixed", True, "below the decay rate of the observer"),
    ],
)
def test_a_wrong_region_is_one_clear_error(problem, region, words):
    with pytest.raises(SpecError, match=words):
        dd.design_pinning(problem, rate=2, region=region)
