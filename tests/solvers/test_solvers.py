"""The same Program through Clarabel, cvxpy and a second solver; the reduced form; rounding for
readers."""

from fractions import Fraction

import numpy as np
import pytest
from oracles.observers import Margin, reduced_program, solve_dense, solve_reduced
from scipy import sparse

from dobc_design import Exosystem, Network, Problem, Verdict
from dobc_design.conditions.consensus.claim import omega, reduced, state_theorems
from dobc_design.errors import SpecError
from dobc_design.exact.definite import decide_positive_definite
from dobc_design.exact.matrix import from_float, matrix, to_float
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.loop.make import loop_of
from dobc_design.solvers.conic import smat, solve_directly, svec, svec_exact, symmetric_basis
from dobc_design.solvers.program import Program, Solution, round_matrix


def close(a: float, b: float, relative: float = 1e-5) -> bool:
    return abs(a - b) <= relative * abs(b) + 1e-7


def residual(program: Program, values) -> float:
    """The largest eigenvalue over all pencils, at the floats that a solver returned."""
    exact = {}
    for name, value in values.items():
        exact[name] = from_float(value, None)
    tops = []
    for pencil in program.pencils:
        table = to_float(pencil.at(exact).to_dense())
        tops.append(np.linalg.eigvalsh(table)[-1])
    return float(max(tops))


@pytest.mark.parametrize("bound", [-8, -1, Fraction(-1, 10)])
def test_both_ways_to_the_solver_find_the_same_optimum(harmonic, bound):
    program = Program(pencils=(reduced(Fraction(bound), harmonic),))
    direct, modelled = solve_directly(program), solve_dense(program)
    assert direct.status == "Solved"
    assert modelled.status == "optimal"
    assert close(direct.objective, modelled.objective, 1e-6)
    assert residual(program, direct.values) <= 1e-6


def test_the_floor_is_kept(harmonic):
    pencils = (reduced(Fraction(-1), harmonic),)
    program = Program(pencils=pencils, floor=Fraction(2))
    for answer in (solve_directly(program), solve_dense(program)):
        assert np.linalg.eigvalsh(answer.values["P"])[0] >= 2 - 1e-6


def test_an_infeasible_program_gives_no_values(harmonic):
    """Lambda = +I cannot be made negative by P and Q.  (SCS says "optimal_inaccurate": a status is
    an opinion.)"""
    program = Program(pencils=(reduced(Fraction(1), harmonic),))
    for answer in (solve_directly(program), solve_dense(program)):
        assert not answer.found
        assert np.isnan(answer.objective)
        assert "nfeasible" in answer.status


def test_a_feasible_problem_can_have_a_positive_margin(harmonic):
    """Theory, section 2: +0.247 at |Q| <= 1, P <= 10 I, although a pair exists; it says nothing."""
    bound = Fraction(-1, 10)
    pencils = (reduced(bound, harmonic),)
    program = Margin(pencils=pencils, ratio=Fraction(10), radius=Fraction(1))
    assert solve_dense(program).objective > 0
    freer = Margin(pencils=program.pencils, ratio=Fraction(10**4), radius=Fraction(10**4))
    assert solve_dense(freer).objective < 0


@pytest.mark.parametrize("modes", [1, 2, 3, 4])
@pytest.mark.parametrize("m", [1, 2])
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.evidence)])
def test_the_reduced_form_has_the_optimum_of_the_block_lmi(separable, modes, m, seed):
    """Theory, Reduction: equal for m = 1 and for Lambda = Lambda_n (x) I_m."""
    problem = separable(seed, modes=modes, m=m)
    dense = solve_dense(Program(pencils=state_theorems(loop_of(problem)).psi()))
    small = solve_reduced(problem)
    assert small.found == dense.found
    if small.found:
        assert close(small.objective, dense.objective)


def test_some_of_those_problems_have_an_optimum_and_some_have_none(separable):
    problems = []
    for seed in range(4):
        for modes in (1, 4):
            for m in (1, 2):
                problems.append(separable(seed, modes=modes, m=m))
    found = [solve_reduced(problem).found for problem in problems]
    assert True in found
    assert False in found


def test_in_general_the_reduced_form_is_the_stricter_one(cycle):
    """m = 2 with different slopes: lambda_max(Lambda) + lambda_max(S) < 0 is sufficient only."""
    A = [[0, 0], [0, 0]]
    C = [[1, 0], [0, 2]]
    exosystem = Exosystem(A=A, C=C)
    gain = [[2, 0], [0, 40]]
    pins = {1: gain, 2: 3, 3: 3}
    problem = cycle(3, pins=pins, exosystem=exosystem, coupling=["y1", "9*y2"])
    dense = solve_dense(Program(pencils=state_theorems(loop_of(problem)).psi()))
    small = solve_reduced(problem)
    assert small.objective > dense.objective * 1.01


@pytest.mark.parametrize("n", [pytest.param(2, marks=pytest.mark.slow), 3])
def test_a_second_solver_agrees(cycle, n):
    """SCS, a first-order method that shares no code with Clarabel."""
    problem = cycle(n)
    pencils = state_theorems(loop_of(problem)).psi()
    second = solve_dense(Program(pencils=pencils), solver="SCS")
    assert second.status in ("optimal", "optimal_inaccurate")
    assert second.objective == pytest.approx(solve_reduced(problem).objective, rel=2e-2, abs=1e-3)


def test_the_optimum_of_the_constant_disturbance_is_known(cycle):
    """A = 0, C = 1, |Lambda| = l: [[-l, 1], [1, -2Q]] <= 0 iff Q >= 1/(2 l), so P = 0 and the
    optimum is 1/(4 l^2)."""
    exosystem = Exosystem(A=[[0]], C=[[1]])
    for l in (Fraction(1, 2), Fraction(2), Fraction(5)):  # noqa: E741 - as in the formula
        answer = solve_directly(Program(pencils=(reduced(-l, exosystem),)))
        expected = float(1 / (4 * l * l))
        assert answer.objective == pytest.approx(expected, rel=1e-6)
        found = answer.values["Q"][0, 0]
        wanted = float(1 / (2 * l))
        assert found == pytest.approx(wanted, rel=1e-4)


def test_the_proposed_pair_proves_the_theorem_after_a_little_slack(cycle, harmonic):
    """The floats of a solution with slack, taken as rationals, satisfy Omega0 < 0 exactly."""
    pencil = reduced(Fraction(-1), harmonic, rate=Fraction(1, 10))
    answer = solve_directly(Program(pencils=(pencil,), floor=Fraction(1)))
    P, Q = (from_float(answer.values[name], 9) for name in ("P", "Q"))
    assert decide_positive_definite(omega(P, Q, harmonic).negated()).verdict is Verdict.PROVED


def test_without_an_exosystem_or_beyond_the_floats_there_is_no_solution(cycle, harmonic):
    arcs = [[1, 2]]
    plain = Problem(network=Network.from_arcs(arcs, arrow="listens_to", agents=2), coupling="y")
    with pytest.raises(SpecError, match=r"needs an \[exosystem\]"):
        solve_reduced(plain)
    network = Network.from_arcs([[1, 2, "1e399"], [2, 1]], arrow="listens_to", agents=2)
    problem = Problem(network=network, coupling="y", gains={1: 1}, exosystem=harmonic)
    assert reduced_program(problem) is None
    assert not solve_reduced(problem).found
    assert not Solution(status="failed").found
    P = [[np.nan]]
    values = {"P": np.array(P)}
    bad = Solution(status="Solved", objective=1.0, values=values)
    assert not bad.found


@pytest.mark.parametrize("size", [1e-300, 1e-9, 1.0, 12345.678, 1e300])
@pytest.mark.parametrize("digits", [1, 3, 6, 15])
def test_the_largest_entry_keeps_its_digits(size, digits):
    entries = [[1.0, -0.123456789012345], [0.987654321012345, 0.0]]
    array = size * np.array(entries)
    exact = round_matrix(array, digits)
    largest = float(np.max(np.abs(array)))
    for row, values in zip(exact, array.tolist(), strict=True):
        for x, value in zip(row, values, strict=True):
            error = abs(float(x) - value)
            allowed = 0.51 * largest * 10.0 ** (1 - digits)
            assert error <= allowed


def test_rounding_is_decimal_and_keeps_symmetry_zero_and_nothing():
    rows = [[0.5, 1 / 3], [1 / 3, 2 / 3]]
    array = np.array(rows)
    first_row = (Fraction(1, 2), Fraction(333, 1000))
    expected = (first_row, (Fraction(333, 1000), Fraction(667, 1000)))
    assert round_matrix(array, 3) == expected
    zeros = round_matrix(np.zeros((2, 1)), 3)
    exact_zeros = ((0,), (0,))
    assert zeros == exact_zeros
    assert round_matrix(np.zeros((0, 0)), 3) == ()


@pytest.mark.parametrize("size", [1, 2, 5])
def test_svec_keeps_inner_products_and_smat_takes_it_back(size):
    """<A, B> = svec(A)'svec(B); Clarabel's order is the upper triangle, column by column."""
    rng = np.random.default_rng(size)
    drawn = rng.standard_normal((2, size, size))
    A, B = (M + M.T for M in drawn)
    by_vectors = svec(A) @ svec(B)
    by_matrices = np.sum(A * B)
    assert by_vectors == pytest.approx(by_matrices)
    assert np.allclose(smat(svec(A)), A)
    assert np.array_equal(svec(sparse.csr_array(A)), svec(A))
    exact = SparseSymmetric.from_dense(matrix(A.tolist()))
    assert np.array_equal(svec_exact(exact), svec(A))
    units = np.stack([svec(unit) for unit in symmetric_basis(size)])
    expected = np.eye(len(units), dtype=bool)
    assert np.array_equal(units != 0, expected)
