"""Diagnostics in floating point: spectra, observability, graphs, eigenvalues at the consensus."""

import math
import sys
from fractions import Fraction

import numpy as np
import pytest

from dobc_design import Dynamics, Network, Problem, load_problem
from dobc_design.analysis import analysis as diag
from dobc_design.errors import ShapeError
from dobc_design.exact.matrix import matrix
from dobc_design.exact.observability import decide_observable
from dobc_design.loop.make import loop_of
from dobc_design.model.model import build_model

PAPER_A = matrix([[0, 2], [-2, 0]])
PAPER_C = matrix([[1, 0]])
PAPER_W = matrix([["16/5"], ["12/5"]])


def test_without_a_gain_the_error_does_not_decay():
    no_gain = matrix([[0], [0]])
    result = diag.check_spectrum(PAPER_A, PAPER_C, no_gain)
    assert result.rate == pytest.approx(0)
    assert "does not decay" in str(result)
    # python-control drops states without effect unless told not to.
    nothing = matrix([[0], [0]])
    A = matrix([[0, 0], [0, 0]])
    C = matrix([[0, 0]])
    result = diag.check_spectrum(A, C, nothing)
    assert result.eigenvalues == (0, 0)


def test_random_spectra_agree_with_numpy():
    rng = np.random.default_rng(1)
    for _ in range(20):
        q = rng.integers(1, 6)
        m = rng.integers(1, 4)
        A = rng.integers(-3, 4, (q, q))
        C = rng.integers(-3, 4, (m, q))
        W = rng.integers(-3, 4, (q, m))
        given = []
        for each in (A, C, W):
            given.append(matrix(each.tolist()))
        result = diag.check_spectrum(*given)
        wanted = np.linalg.eigvals(A - W @ C)
        expected_rate = -wanted.real.max()
        assert result.rate == pytest.approx(expected_rate, abs=1e-6)
        found = [s.real for s in result.eigenvalues]
        assert found == sorted(found, reverse=True)
        np.testing.assert_allclose(sum(result.eigenvalues), wanted.sum(), atol=1e-9)


@pytest.mark.parametrize(
    ("check", "given", "message"),
    [
        (
            diag.check_spectrum,
            (PAPER_A, PAPER_C, matrix([[1, 2]])),
            r"W must have shape \(2, 1\), one row per exosystem",
        ),
        (diag.check_spectrum, (PAPER_A, matrix([[1]]), PAPER_W), "C must have 2 columns"),
        (diag.check_observability, (matrix([[0, 1]]), matrix([[1]])), "A must be square"),
        (
            diag.check_observability,
            (PAPER_A, matrix([[1]])),
            "C must have 2 columns, one column per exosystem state",
        ),
    ],
)
def test_shapes_that_do_not_fit_are_refused(check, given, message: str):
    with pytest.raises(ShapeError, match=message):
        check(*given)


def test_the_margins_of_the_papers_pair_are_those_found_by_hand():
    """At +-2i, G = M* M of M = [A - 2i I; C] is [[9, 8i], [-8i, 8]], so the margin squared is (17 -
    sqrt(257))/2."""
    result = diag.check_observability(PAPER_A, PAPER_C)
    wanted = math.sqrt((17 - math.sqrt(257)) / 2)
    margins = [mode.margin for mode in result.modes]
    assert margins == pytest.approx([wanted, wanted])
    assert result.margin == min(margins)
    frequencies = sorted(mode.eigenvalue.imag for mode in result.modes)
    assert frequencies == pytest.approx([-2, 2])


def test_what_is_not_seen_has_margin_zero_and_a_rank_that_overflows_is_unknown():
    """A = [0], C = [0] (theory, known answers)."""
    C = matrix([[0]])
    result = diag.check_observability(C, C)
    assert result.rank == 0
    assert result.margin == 0
    # s^2 + 4 is unobservable (theory, known answers).
    A = matrix([[0, 2, 0, 0], [-2, 0, 0, 0], [0, 0, 0, 2], [0, 0, -2, 0]])
    result = diag.check_observability(A, matrix([[1, 0, 1, 0]]))
    assert result.rank == 2
    assert result.margin < 1e-12
    large = matrix([["1e200", 0, 0], [0, 1, 0], [0, 0, 2]])
    result = diag.check_observability(large, matrix([[1, 1, 1]]))
    assert result.rank is None
    assert result.singular_values == ()
    assert "rank unknown of 3" in str(result)


def test_the_rank_agrees_with_exact_arithmetic_on_small_integers():
    rng = np.random.default_rng(0)
    for _ in range(60):
        q = rng.integers(1, 5)
        m = rng.integers(1, 3)
        drawn_A = rng.integers(-1, 2, size=(q, q))
        A = matrix(drawn_A.tolist())
        drawn_C = rng.integers(-1, 2, size=(m, q))
        C = matrix(drawn_C.tolist())
        assert diag.check_observability(A, C).rank == decide_observable(A, C).rank


def test_diagnostics_do_without_python_control(monkeypatch):
    """Its import would take a third of the time of a report."""
    monkeypatch.setitem(sys.modules, "control", None)
    assert diag.check_observability(PAPER_A, PAPER_C).rank == 2


def listening(arcs, *, agents=None, gains=None) -> Problem:
    network = Network.from_arcs({"G": arcs}, arrow="listens_to", agents=agents)
    return Problem(network=network, coupling="y", gains=gains)


def is_balanced(arcs) -> bool:
    return diag.graph_facts(listening(arcs), "G").balanced


def test_degrees_count_whom_an_agent_hears_and_balance_is_exact():
    arcs = [[1, 2], [1, 3], [2, 3]]
    facts = diag.graph_facts(listening(arcs), "G")
    assert facts.heard == (2, 1, 0)
    assert facts.hearing == (0, 1, 2)
    assert facts.arcs == 3
    # 0.1 + 0.2 is 0.3 here.
    assert is_balanced([[1, 2, 0.1], [1, 3, 0.2], [2, 1, 0.1], [3, 1, "1/5"]])
    assert is_balanced([[1, 2, 0.3], [2, 3, 0.1], [2, 4, 0.2], [3, 1, 0.1], [4, 1, 0.2]])
    assert not is_balanced([[1, 2], [2, 1, 2]])


def names(agents) -> tuple[str, ...]:
    """The labels of the agents for which this is true."""
    return tuple(str(i) for i in np.flatnonzero(agents))


def test_random_graphs_agree_with_the_transitive_closure():
    rng = np.random.default_rng(0)
    for _ in range(50):
        n = int(rng.integers(2, 8))
        drawn = rng.random((n, n)) < 0.25
        others = ~np.eye(n, dtype=bool)
        hears = drawn & others
        pinned = rng.random(n) < 0.3
        arcs = np.argwhere(hears).tolist()
        gains = dict.fromkeys(np.flatnonzero(pinned).tolist(), 1)
        labels = [*range(n)]
        problem = listening(arcs, agents=labels, gains=gains)
        facts = diag.graph_facts(problem, "G")
        # closure[i, j]: i is j, or hears it, if need be through others
        one_step = np.eye(n, dtype=int) + hears
        closure = np.linalg.matrix_power(one_step, n) > 0
        reached = closure[:, pinned].any(axis=1)
        assert facts.unreached == names(~reached)
        mutual = closure & closure.T
        assert set(facts.components) == {names(row) for row in mutual}
        closed = (closure == mutual).all(axis=1)
        assert set(facts.sources) == {names(row) for row in mutual[closed]}
        assert facts.is_strongly_connected is bool(closure.all())


def cycle(gains) -> Problem:
    arcs = []
    for i in range(10):
        arcs.append([i + 1, (i + 1) % 10 + 1])
    network = Network.from_arcs(arcs, arrow="listens_to", agents=10)
    return Problem(network=network, coupling="exp(y) - 1 + y", gains=gains)


def test_the_linearised_loop_is_that_of_the_symbolic_model():
    """J(0) - K by CasADi, a complex vector coupling included."""
    arcs = [[1, 2, 3], [2, 3], [3, 1], [1, 3]]
    network = Network.from_arcs(arcs, arrow="listens_to")
    gains = {"2": [[2, 1], [-1, 1]]}
    problem = Problem(
        network=network,
        coupling=["sin(y1) + y2", "exp(y2) - 1 - y1"],
        target=[0, 0],
        gains=gains,
    )
    spectrum = diag.mode_spectrum(loop_of(problem), "G")
    error_dynamics = build_model(problem).error_dynamics
    step = 1e-6
    columns = []
    for unit in np.eye(6):
        ahead, _ = error_dynamics(step * unit, [])
        back, _ = error_dynamics(-step * unit, [])
        difference = (ahead - back).full().ravel()
        columns.append(difference / (2 * step))
    loop = np.column_stack(columns)
    symmetric = np.linalg.eigvalsh(loop + loop.T)
    np.testing.assert_allclose(spectrum.lambda_eigenvalues, symmetric, atol=1e-8)
    np.testing.assert_allclose(sum(spectrum.loop_eigenvalues), np.trace(loop), atol=1e-8)
    eigenvalues = np.linalg.eigvals(loop)
    expected_rate = -eigenvalues.real.max()
    assert spectrum.decay_rate == pytest.approx(expected_rate, abs=1e-7)


def test_large_problems_and_kinks_at_zero_get_no_eigenvalues():
    arcs = [[1, 2]]
    network = Network.from_arcs(arcs, arrow="listens_to", agents=diag.MAX_DENSE + 1)
    problem = loop_of(Problem(network=network, coupling="y"))
    spectrum = diag.mode_spectrum(problem, "G")
    assert spectrum.lambda_eigenvalues is spectrum.loop_eigenvalues is None
    assert spectrum.lambda_max is spectrum.decay_rate is None
    assert "not computed" in str(spectrum)
    network = Network.from_arcs([[1, 2]], arrow="listens_to")
    bent = Problem(network=network, coupling="y + abs(y)")
    assert diag.mode_spectrum(loop_of(bent), "G").lambda_max is None


@pytest.mark.parametrize(
    ("pins", "weight", "needed"),
    [({1: 3}, 2, 1.399166), ({1: 5, 6: 5}, 2, 0.637488), ({1: 1}, 1, 3.148023)],
)
def test_double_integrators_decay_where_the_criterion_of_second_order_says_so(
    monkeypatch, pins, weight, needed
):
    """Theory, section 13, the directed 10-cycle; at a hundredth more or less than needed."""
    arcs = []
    for i in range(1, 11):
        arcs.append([i, i % 10 + 1, weight])
    network = Network.from_arcs(arcs, arrow="listens_to")
    A = [[0, 1], [0, 0]]
    B = [[0], [1]]
    agents = Dynamics(A=A, B=B)
    for factor in (0.99, 1.01):
        beta = Fraction(math.sqrt(factor * needed)).limit_denominator(10**6)
        gains = {agent: [[k, k * beta]] for agent, k in pins.items()}
        coupling = f"y1 + ({beta})*y2"
        problem = Problem(network=network, dynamics=agents, coupling=coupling, gains=gains)
        found = diag.analyse(problem).modes[0]
        assert found.second_order == pytest.approx((factor * needed, needed), rel=1e-6)
        assert (found.decay_rate > 0) is (factor > 1)
        whole = diag.mode_spectrum(loop_of(problem), "G").loop_eigenvalues
        polynomials = np.poly(found.loop_eigenvalues), np.poly(whole)
        np.testing.assert_allclose(*polynomials, rtol=1e-7, atol=1e-7)
    monkeypatch.setattr(diag, "MAX_DENSE", 10)  # as many agents, but twice the rows
    large = diag.analyse(problem).modes[0]
    assert large.lambda_max is None
    assert large.loop_eigenvalues == found.loop_eigenvalues
    assert f"beta^2/alpha = {1.01 * needed:.4g} has to exceed {needed:.4g}" in str(large)


def test_without_an_exosystem_or_a_gain_there_is_no_spectrum_and_a_gain_can_be_handed_over():
    analysis = diag.analyse(cycle(3))
    assert analysis.observability is analysis.spectrum is None
    problem = load_problem("clock-sync")
    assert diag.analyse(problem).spectrum is None
    analysis = diag.analyse(problem, gain=[[2]])
    assert analysis.spectrum.rate == pytest.approx(2)
    assert analysis.observability.rank == 1
    with pytest.raises(ShapeError, match="gain must have shape"):
        diag.analyse(problem, gain=[[1, 2]])


def test_an_analysis_says_that_it_proves_nothing():
    analysis = diag.analyse(load_problem("paper-fixed"))
    text = str(analysis)
    assert text.startswith("paper-fixed: diagnostics, not proofs\n")
    assert "lambda_max(Lambda) = -0.5823, small errors decay at 0.5099 1/s" in text
    assert "diagnostics, not proofs" in analysis._repr_html_()
