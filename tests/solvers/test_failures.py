"""Solvers that fail in every way they can: no exception gets out, and certify decides without
them."""

from __future__ import annotations

from fractions import Fraction
from types import SimpleNamespace

import clarabel
import numpy as np
import pytest
from certified import without_region
from simulated_runs import HARMONIC, PRINTED

import dobc_design as dd
from dobc_design import Verdict
from dobc_design.conditions.consensus import propose as estimates
from dobc_design.conditions.consensus.claim import reduced
from dobc_design.conditions.observer import propose
from dobc_design.conditions.observer.propose import propose_pairs
from dobc_design.solvers import conic
from dobc_design.solvers.conic import solve_directly
from dobc_design.solvers.program import Program, Solution, is_solver_failure


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
    return SimpleNamespace(status=status, x=x, z=[0.0] * 90, obj_val=value)


OUTCOMES = {
    "raises": RuntimeError("out of luck"),
    "panics": PanicException("index out of bounds"),
    "nan": answer("NumericalError", [float("nan")] * 5),
    "infinite": answer("Solved", [float("inf")] * 5),
    "infeasible": answer("PrimalInfeasible", [1.0] * 5),
    "almost infeasible": answer("AlmostPrimalInfeasible", [1.0] * 5),
    "unbounded": answer("DualInfeasible", [1.0] * 5),
    "without value": answer("InsufficientProgress", [1.0] * 5, float("nan")),
    "too short": answer("Solved", [1.0]),
    "empty": answer("Solved", []),
    "no list": answer("Solved", None),
    "ragged": answer("Solved", [[1.0], [1.0, 2.0]]),
    "words": answer("Solved", ["a"] * 5),
    "no objective": answer("Solved", [1.0] * 5, None),
    "another object": object(),
}
# These look like answers; only exact arithmetic can tell that they are none.
LIES = {
    "zeros": answer("Solved", [0.0] * 30),
    "negative": answer("Solved", [-1.0] * 30),
    "huge": answer("Solved", [1e308] * 30),
    "tiny": answer("Solved", [5e-324] * 30),
    "mixed": answer("Solved", [(-1.0) ** k * 10.0 ** (7 * k - 60) for k in range(30)]),
    "out of time": answer("MaxTime", [1.0] * 30),
}


def decided(problem: dd.Problem, verdict: Verdict = Verdict.PROVED) -> dd.Certificate:
    """Its certificate, which has this verdict and is confirmed."""
    certificate = dd.certify(problem)
    assert certificate.verdict is verdict
    assert dd.verify(certificate, problem).holds
    return certificate


RING = [[1, 2], [2, 3], [3, 1]]


def printed(modes: dict[str, list[list[int]]]) -> dd.Problem:
    """Three agents with the paper's coupling and its observer, P and Q."""
    network = dd.Network.from_arcs(modes, arrow="listens_to", agents=3)
    observer = dd.load_problem("paper-switching").observer
    given = {"gains": {1: 5}, "exosystem": HARMONIC, "observer": observer}
    return dd.Problem(network=network, coupling="exp(y) - 1 + y", **given)


def notes_of(certificate: dd.Certificate) -> str:
    return "\n".join(certificate.claims.notes)


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


@pytest.mark.parametrize("error", [KeyboardInterrupt(), SystemExit(1), MemoryError()])
def test_what_is_not_the_solvers_own_failure_goes_on(monkeypatch, program, error):
    monkeypatch.setattr(clarabel, "DefaultSolver", Failing(error))
    assert not is_solver_failure(error)
    with pytest.raises(type(error)):
        solve_directly(program)


FEW = ("raises", "huge")


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=() if name in FEW else pytest.mark.slow) for name in OUTCOMES | LIES],
)
def test_certify_proves_without_its_solvers(monkeypatch, name, cycle):
    """The last rung is an exact Lyapunov equation, scaled up: no solver is needed for a proof."""
    monkeypatch.setattr(clarabel, "DefaultSolver", Failing((OUTCOMES | LIES)[name]))
    one_mode = printed({"a": RING})
    reversed_ring = [arc[::-1] for arc in RING]
    two_modes = printed({"a": RING, "b": reversed_ring})
    for problem in (
        one_mode,
        two_modes,
        cycle(4),
    ):
        decided(problem)


def test_certify_proves_without_eigenvalues(monkeypatch, cycle):
    """No estimate of lambda_max and no solver: margins are lost, the verdict is not."""
    monkeypatch.setattr(clarabel, "DefaultSolver", Failing(RuntimeError("x")))

    def fail(*arguments: object, **settings: object) -> None:
        raise np.linalg.LinAlgError("x")

    monkeypatch.setattr(estimates.linalg, "eigh", fail)
    assert decided(cycle(4)).check("lemma1").margin == 0


def test_a_problem_beyond_the_floats_is_still_decided(harmonic):
    """Weights of 1e399 and 1e-399: every estimate fails, the exact side does not."""
    arcs = [[1, 2, "1e399"], [2, 1, "1e399"]]
    network = dd.Network.from_arcs(arcs, arrow="listens_to", agents=2)
    gains = {1: "1e-399", 2: 1}
    held = dd.Problem(network=network, coupling="y", gains=gains, exosystem=harmonic)
    certificate = dd.certify(held)
    assert certificate.check("lemma1").verdict is Verdict.PROVED
    assert dd.verify(certificate, held).holds
    free = dd.Problem(network=network, coupling="y", exosystem=harmonic)
    assert dd.certify(free).verdict is Verdict.REFUTED


@pytest.mark.parametrize("bound", [float("nan"), float("inf"), 0.0, 1.0, -1e-300, -1e300, -5e-324])
def test_pairs_are_proposed_for_any_estimate(harmonic, bound):
    """Estimates only steer: whatever they are, the ladder ends with pairs whose Omega0 is
    negative."""
    first = (Fraction(16, 5),)
    second = (Fraction(12, 5),)
    W = (first, second)
    pairs = list(propose_pairs(harmonic, W, bound=bound, decay=1.6))
    assert len(pairs) >= len(propose.LADDER)


def nothing(program: Program, **options: object) -> Solution:
    """A solver that gives up."""
    return Solution(status="failed: nothing")


@pytest.fixture
def without_solvers(monkeypatch):
    monkeypatch.setattr(conic, "solve_directly", nothing)


def test_a_gain_is_found_without_a_solver_if_need_be_by_exact_poles(
    without_solvers, harmonic, monkeypatch
):
    found = propose.design_gain(harmonic)
    assert found.W is not None
    assert "Kalman" in found.note
    faster = propose.design_gain(harmonic, rate=Fraction(20))
    assert faster.W is not None
    assert faster.rate == 20
    monkeypatch.setattr(propose, "_kalman", lambda exosystem, shift=0.0: None)
    found = propose.design_gain(harmonic, rate=Fraction(3))
    assert found.W is not None
    assert found.rate == 3
    assert "exact pole placement" in found.note


def test_the_usual_way_is_not_worth_a_note(cycle):
    notes = notes_of(dd.certify(cycle(4)))
    assert "W was designed (small SDP) for the decay rate" in notes
    assert "Lyapunov" not in notes


def test_the_exact_steps_are_told_in_the_notes(without_solvers, monkeypatch, cycle):
    notes = notes_of(dd.certify(cycle(4)))
    assert "W was designed (Kalman gain)" in notes
    exactly = (
        "P solves a Lyapunov equation exactly, because no proposal of a solver could be proved"
    )
    assert f"{exactly} (the last said: failed: nothing)." in notes
    monkeypatch.setattr(propose, "_kalman", lambda exosystem, shift=0.0: None)
    monkeypatch.setattr(
        "dobc_design.certification.certify.decay_rate", lambda exosystem, W: float("nan")
    )
    notes = notes_of(decided(cycle(4)))
    assert "W was designed (exact pole placement)" in notes
    assert "because there was no estimate to start a solver from." in notes


def test_a_solver_that_runs_out_of_time_is_not_asked_again(monkeypatch, harmonic):
    calls: list[Program] = []

    def slow(program: Program, **options: object) -> Solution:
        calls.append(program)
        return Solution(status="MaxTime")

    monkeypatch.setattr(conic, "solve_directly", slow)
    assert propose.design_gain(harmonic).W is not None
    assert len(calls) == 1


def test_the_time_limit_reaches_the_solver(harmonic, monkeypatch):
    """1e-12 s is too short; a gain and a pair are found all the same."""
    program = Program(pencils=(reduced(Fraction(-1), harmonic),))
    assert solve_directly(program, time_limit=1e-12).broken
    monkeypatch.setattr(conic, "TIME_LIMIT", 1e-12)
    found = propose.design_gain(harmonic)
    assert found.W is not None
    first = (Fraction(16, 5),)
    second = (Fraction(12, 5),)
    W = (first, second)
    proposals = propose_pairs(harmonic, W, bound=-0.5, decay=1.6)
    last = list(proposals)[-1]
    assert "Lyapunov" in last[2]


def test_when_every_rung_fails_the_answer_is_undecided_and_says_why(
    without_solvers, monkeypatch, cycle
):
    monkeypatch.setattr(propose, "_kalman", lambda exosystem, shift=0.0: None)
    monkeypatch.setattr(propose, "placed_gains", lambda exosystem, rate: iter(()))
    certificate = decided(cycle(4), Verdict.UNDECIDED)
    notes = notes_of(certificate)
    assert "No W was found for the decay rate" in notes
    assert "nor by exact pole placement" in notes
    assert "W" in certificate.check("hurwitz").reason


def test_a_pair_that_nobody_finds_leaves_the_theorem_undecided(without_solvers, monkeypatch, cycle):
    monkeypatch.setattr(propose, "solve_lyapunov", lambda F, N: None)
    region = {"initial_states": [-1, 1], "initial_disturbance": 0}
    problem = cycle(2).replace(observer=PRINTED, region=region)
    certificate = dd.certify(problem)
    assert certificate.check("lemma1").verdict is Verdict.PROVED
    assert certificate.check("theorem1").verdict is Verdict.UNDECIDED
    assert "no pair (P, Q) was found" in certificate.check("theorem1").reason
    assert certificate.verdict is Verdict.PROVED
    assert certificate.claims.covered_by == "max-separable"
    local = dd.certify(without_region(problem))  # the weighted theorem proposes its P itself
    assert local.check("theorem1").verdict is Verdict.UNDECIDED
    assert local.claims.covered_by == "theorem1-weighted"
    assert dd.verify(certificate, problem).holds


BROKEN_NUMBERS = {
    "raises": np.linalg.LinAlgError("x"),
    "overflows": OverflowError("x"),
    "gives up": RuntimeError("x"),
    "nan": np.array([np.nan]),
    "infinite": np.array([np.inf]),
    "empty": np.array([]),
}


@pytest.mark.parametrize("name", BROKEN_NUMBERS)
def test_eigenvalue_solvers_that_break_change_no_verdict(monkeypatch, name, cycle):
    outcome = BROKEN_NUMBERS[name]

    def broken(*arguments: object, **options: object) -> object:
        if isinstance(outcome, Exception):
            raise outcome
        return outcome

    def broken_pair(*arguments: object, **options: object) -> object:
        return broken(), np.ones((3, 1))

    problem = cycle(2)
    free = cycle(2, pins={})
    monkeypatch.setattr(np.linalg, "eigvals", broken)
    monkeypatch.setattr(np.linalg, "eigvalsh", broken)
    monkeypatch.setattr(estimates.linalg, "eigh", broken_pair)
    for each, verdict in ((problem, Verdict.PROVED), (free, Verdict.REFUTED)):
        decided(each, verdict)


def test_a_singular_p_is_passed_over_and_no_gain_at_all_is_said_in_words(monkeypatch, harmonic):
    P = np.zeros((2, 2))
    Q = np.ones((2, 1))
    values = {"P": P, "Q": Q}
    singular = Solution(status="Solved", objective=0.0, values=values)
    monkeypatch.setattr(conic, "solve_directly", lambda program, **options: singular)
    assert propose.design_gain(harmonic).W is not None
    monkeypatch.setattr(propose, "_candidates", lambda exosystem, rate, kalman: iter(()))
    found = propose.design_gain(harmonic, rate=Fraction(3))
    assert found.W is None
    assert "no W was found for the decay rate 3 1/s" in found.note
