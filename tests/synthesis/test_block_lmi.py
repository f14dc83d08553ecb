"""The block matrix inequality of Theorems 1 and 2 for cvxpy: what it says, and what is decided of
its answers."""

import cvxpy as cp
import numpy as np
import pytest
from certified import without_region

import dobc_design as dd
from dobc_design import Network, Problem, Verdict
from dobc_design.conditions.consensus.claim import state_theorems
from dobc_design.errors import SpecError
from dobc_design.exact.matrix import from_float, to_float
from dobc_design.loop.make import loop_of


def printed(certificate):
    """The check of the pair that was given."""
    return next(check for check in certificate.checks if check.id.endswith("-printed"))


def reduced_optimum(lmi):
    """The optimum of one agent with Lambda = lambda_max I (theory, Reduction), by cvxpy."""
    exosystem = lmi.stated.exosystem
    A = to_float(exosystem.A)
    C = to_float(exosystem.C)
    q, m = lmi.Q.shape
    P = cp.Variable((q, q), symmetric=True)
    Q = cp.Variable((q, m))
    top = max(lmi.tops.values()) * np.eye(m)
    omega = P @ A + A.T @ P - Q @ C - C.T @ Q.T
    block = cp.bmat([[top, C], [C.T, omega]])
    constraints = [block << -lmi.margin * np.eye(m + q), P >> lmi.floor * np.eye(q)]
    problem = cp.Problem(cp.Minimize(cp.trace(P) + cp.sum_squares(Q)), constraints)
    return problem.solve(solver="CLARABEL")


def test_psi_is_the_matrix_that_is_decided_exactly(separable):
    """(18) written with Kronecker products in floats, against the exact pencil, entry by entry."""
    problem = separable(1, modes=3, m=2)
    lmi = dd.block_lmi(problem)
    q, m = lmi.Q.shape
    rng = np.random.default_rng(3)
    P = rng.integers(-9, 9, (q, q)) / 4
    P = P + P.T
    Q = rng.integers(-9, 9, (q, m)) / 4
    lmi.P.value = P
    lmi.Q.value = Q
    exact = {"P": from_float(P, None), "Q": from_float(Q, None)}
    pencils = state_theorems(loop_of(problem)).psi()
    assert len(pencils) == len(lmi.psi)
    for pencil, psi in zip(pencils, lmi.psi.values(), strict=True):
        whole = to_float(pencil.at(exact).to_dense())
        assert np.allclose(psi.value, whole, rtol=1e-14, atol=1e-14)


@pytest.mark.parametrize("solver", ["CLARABEL", pytest.param("SCS", marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", ["paper-fixed", "paper-switching"])
def test_the_answers_of_two_solvers_are_proved(name, solver):
    lmi = dd.block_lmi(without_region(name))
    lmi.problem().solve(solver=solver)
    check = printed(lmi.certify())
    assert check.verdict is Verdict.PROVED
    assert check.margin > 0.3
    assert "Psi < 0 in floating point" in lmi.status


def test_the_answer_can_be_kept_as_a_problem_that_is_certified_again(tmp_path):
    """W = P^-1 Q and P stand in problem.json, rounded, and prove the same."""
    lmi = dd.block_lmi(dd.load_problem("paper-fixed").replace(region=None))
    with pytest.raises(SpecError, match="no P and Q"):
        lmi.problem_with_gain()
    lmi.problem().solve(solver="CLARABEL")
    found = lmi.problem_with_gain(digits=6)
    assert np.allclose(to_float(found.observer.W), lmi.W, rtol=1e-4)
    assert np.allclose(to_float(found.observer.P), lmi.P.value, rtol=1e-4)
    dd.certify(found).save(tmp_path)
    kept = dd.load_problem(tmp_path / "problem.json")
    assert kept.observer.W == found.observer.W and kept.observer.P == found.observer.P
    assert printed(dd.certify(kept)).verdict is Verdict.PROVED


def test_an_optimal_answer_on_the_border_is_refuted_exactly():
    """All pinned with k = 9/16 makes Psi of the printed P singular (theory, known answers): the
    solver finds Psi <= 0 "optimal"; Psi < 0 fails for a vector that proves it."""
    problem = dd.load_problem("paper-fixed").replace(gains="9/16", region=None)
    P = to_float(problem.observer.P)
    W = to_float(problem.observer.W)
    lmi = dd.block_lmi(problem, margin=0, floor="1/100")
    lmi.problem(more=[lmi.P == P, lmi.Q == P @ W]).solve(solver="CLARABEL")
    assert 'The solver says "optimal"' in lmi.status
    check = printed(lmi.certify(digits=6))
    assert check.verdict is Verdict.REFUTED
    assert check.witness.kind == "vector"


def test_further_constraints_bound_the_gain():
    """|Q| <= b t and P >= t I give |W| = |P^-1 Q| <= b."""
    lmi = dd.block_lmi(without_region("paper-switching"))
    t = cp.Variable()
    eye = np.eye(2)
    lmi.problem(more=[cp.norm(lmi.Q) <= 2 * t, lmi.P >> t * eye]).solve(solver="CLARABEL")
    assert np.linalg.norm(lmi.W) <= 2 + 1e-6
    assert printed(lmi.certify()).verdict is Verdict.PROVED


@pytest.mark.parametrize("modes", [1, 3])
@pytest.mark.parametrize(
    "seed", [0, 1, 2, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (3, 4))]
)
def test_it_is_feasible_iff_lambda_is_negative_and_has_the_optimum_of_the_reduction(
    separable, seed, modes
):
    """Theory, Decision and Reduction: the exosystems here are detectable, so Lambda decides."""
    problem = separable(seed, modes=modes)
    lmi = dd.block_lmi(problem)
    asked = lmi.problem()
    asked.solve(solver="CLARABEL")
    negative = max(lmi.tops.values()) < -1e-9
    assert (lmi.W is not None) == negative
    if not negative:
        return
    assert asked.value == pytest.approx(reduced_optimum(lmi), rel=1e-5)
    assert printed(lmi.certify()).verdict is Verdict.PROVED


def test_what_it_says_before_and_without_an_answer(harmonic):
    """Nobody is pinned: no P and Q exist, and the words do not claim a proof of that."""
    network = Network.from_arcs([[2, 1]], arrow="listens_to", agents=2)
    lmi = dd.block_lmi(Problem(network=network, coupling="y", exosystem=harmonic))
    assert "Not solved yet" in repr(lmi)
    assert lmi.W is None
    with pytest.raises(SpecError, match="no P and Q to decide"):
        lmi.certify()
    lmi.problem().solve(solver="CLARABEL")
    assert lmi.W is None
    assert "That is no proof" in lmi.status


def test_what_cannot_be_one_block_is_refused(cycle):
    alone = Network.from_arcs([], arrow="listens_to", agents=1)
    with pytest.raises(SpecError, match="exosystem"):
        dd.block_lmi(Problem(network=alone, coupling="y"))
    with pytest.raises(SpecError, match="fewer"):
        dd.block_lmi(cycle(201))
    with pytest.raises(SpecError, match="does not apply"):
        dd.block_lmi(cycle(3, coupling="abs(y) * y / 2 + clip(y, -1, 1)"))
    with pytest.raises(SpecError, match="floor"):
        dd.block_lmi(cycle(3), floor=0)
