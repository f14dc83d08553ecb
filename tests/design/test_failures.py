"""Solvers that fail in every way they can: no exception gets out, and certify decides without them."""

from __future__ import annotations

from fractions import Fraction
from types import SimpleNamespace

import clarabel
import numpy as np
import pytest

import dobc_design as dd
from dobc_design.design import estimates, gain, pair
from dobc_design.design.dense import solve_dense
from dobc_design.design.direct import solve_directly
from dobc_design.design.pair import propose_pairs
from dobc_design.design.program import Program, is_solver_failure, without_values
from dobc_design.spec.exosystem import Exosystem
from dobc_design.theorems.conditions import reduced
from dobc_design.verdict import Verdict


class PanicException(BaseException):
    """What a Rust panic looks like from Python: no Exception."""


class Failing:
    """A solver that raises, or answers as it is told."""

    def __init__(self, outcome: object) -> None:
        self.outcome = outcome

    def __call__(self, *arguments: object) -> Failing:
        return self

    def solve(self) -> object:
        if isinstance(self.outcome, BaseException):
            raise self.outcome
        return self.outcome


def answer(status: str, x: list[float], value: float = 1.0) -> SimpleNamespace:
    return SimpleNamespace(status=status, x=x, obj_val=value)


OUTCOMES = {
    "raises": RuntimeError("out of luck"),
    "panics": PanicException("index out of bounds"),
    "nan": answer("NumericalError", [float("nan")] * 5),
    "infinite": answer("Solved", [float("inf")] * 5),
    "infeasible": answer("PrimalInfeasible", [1.0] * 5),
    "almost infeasible": answer("AlmostPrimalInfeasible", [1.0] * 5),
    "unbounded": answer("DualInfeasible", [1.0] * 5),
    "without value": answer("InsufficientProgress", [1.0] * 5, float("nan")),
}


@pytest.fixture
def program(harmonic) -> Program:
    return Program(pencils=(reduced(Fraction(-1), harmonic),))


@pytest.mark.parametrize("name", OUTCOMES)
def test_a_failing_solver_is_a_solution_without_values(monkeypatch, program, name):
    monkeypatch.setattr(clarabel, "DefaultSolver", Failing(OUTCOMES[name]))
    found = solve_directly(program)
    assert not found.found
    assert found.values == {}
    assert np.isnan(found.objective)
    assert found.status


@pytest.mark.parametrize("error", [RuntimeError("x"), PanicException("x"), ValueError("x"), ZeroDivisionError()])
def test_a_failing_modelling_layer_is_a_solution_without_values(monkeypatch, program, error):
    import cvxpy as cp

    def fail(self: object, **settings: object) -> None:
        raise error

    monkeypatch.setattr(cp.Problem, "solve", fail)
    found = solve_dense(program)
    assert not found.found
    assert found.status == f"failed: {type(error).__name__}"


def test_a_solver_that_is_not_there_is_a_solution_without_values(program):
    assert not solve_dense(program, solver="MOSEK").found


@pytest.mark.parametrize("error", [KeyboardInterrupt(), SystemExit(1), MemoryError()])
def test_what_is_not_the_solvers_own_failure_goes_on(monkeypatch, program, error):
    monkeypatch.setattr(clarabel, "DefaultSolver", Failing(error))
    assert not is_solver_failure(error)
    with pytest.raises(type(error)):
        solve_directly(program)


@pytest.mark.parametrize("bound", ["1e399", "-1e399", "1e300", "-1e300", "1e-320"])
def test_numbers_at_the_ends_of_the_floats_are_no_crash(harmonic, bound):
    for objective in ("size", "margin"):
        found = solve_directly(Program(pencils=(reduced(Fraction(bound), harmonic),), objective=objective))
        assert found.status


@pytest.mark.parametrize("name", OUTCOMES)
def test_certify_proves_without_its_solver(monkeypatch, name, cycle):
    """The last rung is an exact Lyapunov equation, scaled up: no solver is needed for a proof."""
    monkeypatch.setattr(clarabel, "DefaultSolver", Failing(OUTCOMES[name]))
    for problem in (dd.load_problem("paper-fixed"), dd.load_problem("paper-switching"), cycle(4)):
        certificate = dd.certify(problem)
        assert certificate.verdict is Verdict.PROVED
        assert dd.verify(certificate, problem).holds


def test_certify_proves_without_eigenvalues(monkeypatch, cycle):
    """No estimate of lambda_max and no solver: margins are lost, the verdict is not."""
    monkeypatch.setattr(clarabel, "DefaultSolver", Failing(RuntimeError("x")))
    monkeypatch.setattr(estimates, "_dense", lambda matrix: None)
    problem = cycle(4)
    certificate = dd.certify(problem)
    assert certificate.verdict is Verdict.PROVED
    assert certificate.check("lemma1").margin == 0
    assert dd.verify(certificate, problem).holds


def test_a_problem_beyond_the_floats_is_still_decided(harmonic):
    """Weights of 1e399 and 1e-399: every estimate fails, the exact side does not."""
    network = dd.Network.from_arcs([[1, 2, "1e399"], [2, 1, "1e399"]], arrow="listens_to", agents=2)
    held = dd.Problem(network=network, coupling="y", gains={1: "1e-399", 2: 1}, exosystem=harmonic)
    certificate = dd.certify(held)
    assert certificate.check("lemma1").verdict is Verdict.PROVED
    assert dd.verify(certificate, held).holds
    free = dd.Problem(network=network, coupling="y", exosystem=harmonic)
    assert dd.certify(free).verdict is Verdict.REFUTED


@pytest.mark.parametrize("bound", [float("nan"), float("inf"), 0.0, 1.0, -1e-300, -1e300, -5e-324])
def test_pairs_are_proposed_for_any_estimate(harmonic, bound):
    """Estimates only steer: whatever they are, the ladder ends with pairs whose Omega0 is negative."""
    W = ((Fraction(16, 5),), (Fraction(12, 5),))
    pairs = list(propose_pairs(harmonic, W, bound=bound, decay=1.6))
    assert len(pairs) >= len(pair.LADDER)


def test_a_gain_is_found_without_a_solver(monkeypatch, harmonic):
    monkeypatch.setattr(gain, "solve_directly", lambda program: without_values("failed", solver="none"))
    found = gain.design_gain(harmonic)
    assert found.W is not None
    assert "Kalman" in found.note
    faster = gain.design_gain(harmonic, rate=Fraction(20))
    assert faster.W is not None
    assert faster.rate == 20


def test_without_any_solver_the_poles_are_placed_exactly(monkeypatch, harmonic):
    monkeypatch.setattr(gain, "solve_directly", lambda program: without_values("failed", solver="none"))
    monkeypatch.setattr(gain, "_kalman", lambda exosystem, shift=0.0: None)
    found = gain.design_gain(harmonic, rate=Fraction(3))
    assert found.W is not None
    assert found.rate == 3
    assert "exact pole placement" in found.note


def test_no_gain_at_all_is_said_in_words(monkeypatch, harmonic):
    monkeypatch.setattr(gain, "_candidates", lambda exosystem, rate, kalman: iter(()))
    found = gain.design_gain(harmonic, rate=Fraction(3))
    assert found.W is None
    assert "no W was found for the decay rate 3 1/s" in found.note


def test_a_singular_p_of_a_solver_is_passed_over(monkeypatch, harmonic):
    broken = solve_directly(Program(pencils=(reduced(Fraction(-1), harmonic),)))
    singular = type(broken)(
        status="Solved", solver="x", objective=0.0, values={"P": np.zeros((2, 2)), "Q": np.ones((2, 1))}
    )
    monkeypatch.setattr(gain, "solve_directly", lambda program: singular)
    assert gain.design_gain(harmonic).W is not None


def test_the_decay_of_numbers_beyond_the_floats_is_not_a_number():
    exosystem = Exosystem(A=[["1e399"]], C=[[1]])
    assert np.isnan(estimates.decay_rate(exosystem, ((Fraction(1),),)))
