"""SciPy's integrators, restarted at every switch: no step crosses one.

A run ends at its horizon, or where it diverged; what is valid up to there is kept, with the reason in words.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.integrate import DOP853, Radau

from dobc_design.simulation.stiffness import StiffnessTest

Array = NDArray[np.float64]
Derivative = Callable[[float, Array], Array]
Progress = Callable[[float], None]

FARTHEST = 1e9  # an error so many times its start (or 1, if that is larger) counts as divergence
GROWTH = 1.5  # of the error since the last sample: a run that ends early keeps the steps at which it grew so much
LEAST_IMPLICIT = 1e-8  # the implicit method has order 5: a finer tolerance would cost very many steps


class Patterned(Protocol):
    """What knows which derivative depends on which state; asked by the implicit method only."""

    @property
    def pattern(self) -> sp.csr_array:
        """Square, nonzero where there is a dependence."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Segment:
    """One stretch without a switch: the derivative, the end in s, and what may end it earlier.

    ``change`` gets the step's begin, its end and the state in between as a function of time; it returns the instant
    of a switch that depends on the state, or None.  ``system.pattern`` marks what a derivative depends on.
    """

    derivative: Derivative
    end: float
    system: Patterned
    change: Callable[[float, float, Callable[[float], Array]], float | None] | None = None


class Plan(Protocol):
    """What is to be integrated."""

    def segment(self, time: float, state: Array) -> Segment:
        """The stretch that begins here."""

    def error(self, state: Array) -> float:
        """|e|_inf of a state."""


@dataclass(slots=True, kw_only=True, eq=False)
class Run:
    """Times (T,) and states (T, N); ``reason`` says why a run ended early, "" if it did not."""

    times: Array
    states: Array
    reason: str = ""
    method: str = ""
    notes: list[str] = field(default_factory=list)
    evaluations: int = 0


class _Samples:
    """Collects the states at the asked times."""

    def __init__(self, times: Array, start: Array) -> None:
        self.times = times
        self.states = np.empty((len(times), len(start)))
        self.states[0] = start
        self.done = 1

    def take(self, solver: Any, until: float) -> None:
        """Those up to ``until`` in the step that the solver has just made."""
        count = int(np.searchsorted(self.times, until, side="right"))
        if count > self.done:
            exact = self.times[self.done : count] == solver.t
            self.states[self.done : count] = solver.dense_output()(self.times[self.done : count]).T
            self.states[self.done : count][exact] = solver.y
            self.done = count


def integrate(
    plan: Plan, start: Array, times: Array, *, tolerance: float, implicit: bool, progress: Progress | None = None
) -> Run:
    """Integrate from ``start`` at 0 and sample at ``times``, which begin with 0 and end with the horizon.

    ``tolerance`` is the relative one; the absolute one is a hundredth of it.
    """
    worker = _Worker(plan, start, times, tolerance=tolerance, implicit=implicit, progress=progress)
    return worker.run()


class _Worker:
    def __init__(
        self, plan: Plan, start: Array, times: Array, *, tolerance: float, implicit: bool, progress: Progress | None
    ) -> None:
        self.plan, self.state, self.time, self.horizon = plan, start, 0.0, float(times[-1])
        self.samples = _Samples(times, start)
        self.tolerance, self.implicit = tolerance, implicit
        self.report = progress or (lambda part: None)
        self.farthest = FARTHEST * max(1.0, plan.error(start))
        self.step: float | None = None
        self.evaluations = 0
        self.notes: list[str] = []
        self.methods = ["Radau" if implicit else "DOP853"]
        self.rise: list[tuple[float, Array]] = []  # steps since the last sample, each with a larger error
        self.risen = self.farthest / FARTHEST

    def run(self) -> Run:
        self.report(0.0)
        reason = ""
        while self.time < self.horizon and not reason:
            segment = self.plan.segment(self.time, self.state)
            if not np.isfinite(segment.derivative(self.time, self.state)).all():
                reason = f"a coupling overflows or is undefined at t = {self.time:.6g} s"
                break
            reason = self.stretch(segment)
        return self.finish(reason)

    def stretch(self, segment: Segment) -> str:
        """Integrate to the end of the segment, or to the switch that ends it; return why that failed, or ""."""
        solver, stiffness = self.solver(segment), StiffnessTest()
        while self.time < segment.end:
            before, old = solver.t, solver.y
            if not _stepped(solver) or not np.isfinite(solver.y).all():
                self.leave(solver, before, old)
                return f"the step size collapsed or the state overflowed just after t = {before:.6g} s"
            end = solver.t
            if segment.change is not None:
                switch = segment.change(before, end, solver.dense_output())
                if switch is not None:
                    self.samples.take(solver, switch)
                    self.leave(solver, switch, solver.dense_output()(switch) if switch < end else solver.y)
                    return ""
            error = self.plan.error(solver.y)
            if error > self.farthest:
                self.leave(solver, solver.t, solver.y)
                return f"|e|_inf exceeded {FARTHEST:.0e} times its start at t = {self.time:.6g} s"
            self.samples.take(solver, end)
            self.keep(end, solver.y, error)
            self.time, self.state = end, solver.y
            self.report(self.time / self.horizon)
            if not self.implicit and stiffness.is_stiff(solver, segment.end):
                self.turn_implicit()
                self.leave(solver, solver.t, solver.y)
                solver = self.solver(segment)
        self.leave(solver, solver.t, solver.y)
        return ""

    def keep(self, time: float, state: Array, error: float) -> None:
        """Keep a step at which the error has grown, in case the run ends before the next sample."""
        if self.rise and self.rise[-1][0] <= self.samples.times[self.samples.done - 1]:
            self.rise.clear()
        if error > GROWTH * self.risen:
            self.rise.append((time, state))
            self.risen = error

    def solver(self, segment: Segment) -> Any:
        """A solver that starts here and stops exactly at the end of the segment."""
        left = segment.end - self.time
        options: dict[str, Any] = {"first_step": None if self.step is None else min(self.step, left)}
        tolerance, method = self.tolerance, DOP853
        if self.implicit:
            tolerance, method = max(tolerance, LEAST_IMPLICIT), Radau
            options["jac_sparsity"] = segment.system.pattern
        return method(
            segment.derivative, self.time, self.state, segment.end, rtol=tolerance, atol=tolerance / 100, **options
        )

    def leave(self, solver: Any, time: float, state: Array) -> None:
        """Take over where a solver stands, and the step it would have made next."""
        self.time, self.state = time, state
        self.evaluations += solver.nfev
        step = float(solver.h_abs)
        if self.step is not None and solver.t_bound == time:  # the last step was cut short by the switch
            step = max(step, self.step)
        self.step = step if np.isfinite(step) and step > 0 else None

    def turn_implicit(self) -> None:
        self.implicit, self.step = True, None
        self.methods.append("Radau")
        self.notes.append(
            f"The loop turned out to be stiff at t = {self.time:.4g} s: from there on by the implicit method Radau."
        )

    def finish(self, reason: str) -> Run:
        count = self.samples.done
        times, states = self.samples.times[:count], self.samples.states[:count]
        if reason:
            late = [(time, state) for time, state in [*self.rise, (self.time, self.state)] if time > times[-1]]
            late = [each for k, each in enumerate(late) if k == 0 or each[0] > late[k - 1][0]]
            times = np.concatenate([times, [time for time, _ in late]])
            states = np.concatenate([states, *(state[None] for _, state in late)])
        if not reason:
            self.report(1.0)
        return Run(
            times=times.copy(),
            states=states,
            reason=reason,
            method=", then ".join(self.methods),
            notes=self.notes,
            evaluations=self.evaluations,
        )


def _stepped(solver: Any) -> bool:
    """Advance by one accepted step; False if that is impossible."""
    try:
        solver.step()
    except (RuntimeError, ValueError, np.linalg.LinAlgError):  # the implicit method met a Jacobian that is not finite
        return False
    return bool(solver.status != "failed")
