"""One run by SciPy's integrators, restarted at every switch: no step crosses one.

A run ends at its horizon, or where it diverged; what is valid up to there is kept, with the reason in words.  An
explicit method takes steps of a few times the fastest time constant, however smooth the solution is.  Where that would
cost very many steps, an implicit one is cheaper: by an estimate before the run, and by Hairer's test while it runs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sp
from scipy.integrate import DOP853, Radau

from dobc_design.problem.arrays import ArcGroup
from dobc_design.simulation._arguments import Array
from dobc_design.simulation.field import ClosedForm, Field, Loop, Network, field_of, network_of
from dobc_design.simulation.switches import Nearby, Switches

Derivative = Callable[[float, Array], Array]
Change = Callable[[float, float, Callable[[float], Array]], float | None]
Progress = Callable[[float], None]

FARTHEST = 1e9  # an error so many times its start (or 1, if that is larger) counts as divergence
GROWTH = 1.5  # of the error since the last sample: a run that ends early keeps the steps at which it grew so much
LEAST_IMPLICIT = 1e-8  # the implicit method has order 5: a finer tolerance would cost very many steps
STIFF = 2e4  # horizon times fastest decay from which on the implicit method is taken at once
BOUNDARY = 6.1  # |h lambda| on the boundary of stability of DOP853 (Hairer, Norsett, Wanner, section IV.2)
PATIENCE = 15  # steps on that boundary after which the loop counts as stiff, if ...
MANY = 3000  # ... so many steps would be left


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stay:
    """The active mode by its index, and until when, in s; ``change`` may end it earlier.

    ``change`` gets the step's begin, its end and x (n, m) in between as a function of time; it returns the instant
    of a switch that depends on the state, or None.
    """

    mode: int
    end: float
    change: Change | None = None


class Scheduled:
    """Modes that are known beforehand; ``groups`` gives the arcs of a mode by its index."""

    def __init__(self, switches: Switches, groups: Callable[[int], Sequence[ArcGroup]], horizon: float) -> None:
        self.switches, self.groups, self.horizon = switches, groups, horizon

    def stay(self, time: float, positions: Array) -> Stay:
        """What begins here."""
        place = int(np.searchsorted(self.switches.times, time, side="right"))
        end = float(self.switches.times[place]) if place < len(self.switches) else self.horizon
        return Stay(mode=int(self.switches.modes[place - 1]), end=end)


class Moving:
    """The graph follows from the state."""

    def __init__(self, nearby: Nearby, horizon: float) -> None:
        self.nearby, self.groups, self.horizon = nearby, nearby.groups, horizon

    @property
    def switches(self) -> Switches:
        """Those that the run has come to."""
        return self.nearby.record.switches()

    def stay(self, time: float, positions: Array) -> Stay:
        """What begins here, with the graph of these positions."""
        return Stay(mode=self.nearby.look(time, positions), end=self.horizon, change=self.nearby.change)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Segment:
    """One stretch without a switch: what is integrated, and until when; ``pattern`` marks what depends on what."""

    derivative: Derivative
    pattern: Callable[[], sp.csr_array]
    stay: Stay


class Plan(Protocol):
    """What is to be integrated."""

    def segment(self, time: float, state: Array) -> Segment:
        """The stretch that begins here."""

    def positions(self, state: Array) -> Array:
        """x (n, m)."""

    def error(self, state: Array) -> float:
        """|e|_inf of a state."""


class Errors:
    """State e, flat (n m,); the observer's error is known in closed form (22)."""

    def __init__(self, loop: Loop, modes: Scheduled | Moving, closed: ClosedForm | None, eps0: Array) -> None:
        self.loop, self.modes, self.closed, self.eps0 = loop, modes, closed, eps0
        self.made: dict[int, Network] = {}

    def segment(self, time: float, state: Array) -> Segment:
        """The stretch that begins here."""
        stay = self.modes.stay(time, self.positions(state))
        if stay.mode not in self.made:
            self.made[stay.mode] = network_of(self.loop, self.modes.groups(stay.mode))
        network, closed, eps0, shape = self.made[stay.mode], self.closed, self.eps0, (self.loop.n, self.loop.m)

        def derivative(time: float, e: Array) -> Array:
            result = network(e)
            if closed is not None:
                result.reshape(shape)[...] += eps0 @ closed.at(time).T
            return result

        return Segment(derivative=derivative, pattern=network.pattern, stay=stay)

    def positions(self, state: Array) -> Array:
        """x (n, m)."""
        return state.reshape(self.loop.n, self.loop.m) + self.loop.goal

    def error(self, state: Array) -> float:
        """|e|_inf."""
        return float(np.abs(state).max())


class Full:
    """State [x; xi; z]: the loop as printed, the reference."""

    def __init__(self, loop: Loop, modes: Scheduled | Moving) -> None:
        self.loop, self.modes = loop, modes
        self.made: dict[int, Field] = {}

    def segment(self, time: float, state: Array) -> Segment:
        """The stretch that begins here."""
        stay = self.modes.stay(time, self.positions(state))
        if stay.mode not in self.made:
            self.made[stay.mode] = field_of(self.loop, self.modes.groups(stay.mode))
        field = self.made[stay.mode]
        return Segment(derivative=field, pattern=field.pattern, stay=stay)

    def positions(self, state: Array) -> Array:
        """x (n, m)."""
        return self.loop.split(state)[0]

    def error(self, state: Array) -> float:
        """|e|_inf."""
        return float(np.abs(self.positions(state) - self.loop.goal).max())


@dataclass(slots=True, kw_only=True, eq=False)
class Run:
    """Times (T,) and states (T, N); ``reason`` says why a run ended early, "" if it did not."""

    times: Array
    states: Array
    reason: str = ""
    method: str = ""
    notes: list[str] = field(default_factory=list)
    evaluations: int = 0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Outcome:
    """What became of one run: its samples, x, d, dhat, u (T, n, m), xi, xihat (T, n, q), and why it ended early."""

    times: Array
    x: Array
    xi: Array
    xihat: Array
    d: Array
    dhat: Array
    u: Array
    reason: str
    method: str
    evaluations: int
    notes: tuple[str, ...]


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
        solver, stiffness, stay = self.solver(segment), StiffnessTest(), segment.stay
        while self.time < stay.end:
            before, old = solver.t, solver.y
            if not _stepped(solver) or not np.isfinite(solver.y).all():
                self.leave(solver, before, old)
                return f"the step size collapsed or the state overflowed just after t = {before:.6g} s"
            end = solver.t
            if stay.change is not None:
                switch = stay.change(before, end, partial(self.between, solver.dense_output()))
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
            if not self.implicit and stiffness.is_stiff(solver, stay.end):
                self.turn_implicit()
                self.leave(solver, solver.t, solver.y)
                solver = self.solver(segment)
        self.leave(solver, solver.t, solver.y)
        return ""

    def between(self, states: Callable[[float], Array], time: float) -> Array:
        """x (n, m) within a step."""
        return self.plan.positions(states(time))

    def keep(self, time: float, state: Array, error: float) -> None:
        """Keep a step at which the error has grown, in case the run ends before the next sample."""
        if self.rise and self.rise[-1][0] <= self.samples.times[self.samples.done - 1]:
            self.rise.clear()
        if error > GROWTH * self.risen:
            self.rise.append((time, state))
            self.risen = error

    def solver(self, segment: Segment) -> Any:
        """A solver that starts here and stops exactly at the end of the segment."""
        end = segment.stay.end
        options: dict[str, Any] = {"first_step": None if self.step is None else min(self.step, end - self.time)}
        tolerance, method = self.tolerance, DOP853
        if self.implicit:
            tolerance, method = max(tolerance, LEAST_IMPLICIT), Radau
            options["jac_sparsity"] = segment.pattern()
        return method(segment.derivative, self.time, self.state, end, rtol=tolerance, atol=tolerance / 100, **options)

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


def fastest_decay(loop: Loop, groups: Sequence[ArcGroup]) -> float:
    """A bound on the fastest decay of e at the consensus, 1/s: the largest row sum of |J| + |K| (Gershgorin).

    A coupling with a kink at 0 counts with the steeper side.
    """
    rows = np.asarray(abs(loop.K).sum(axis=1)).reshape(loop.n, loop.m)
    for group in groups:
        slopes = group.coupling.jacobian_at_zero()
        steepest = np.array([min(1e300, float(sum(entry.magnitude for entry in row))) for row in slopes])
        strength = np.bincount(group.listeners, weights=group.weights, minlength=loop.n)
        rows = rows + 2 * strength[:, None] * steepest
    return float(rows.max())


def observer_decay(loop: Loop) -> float:
    """The fastest decay of the observer's error, 1/s."""
    observer = loop.F
    if not loop.q or not np.isfinite(observer).all():
        return 0.0
    return float(-np.linalg.eigvals(observer).real.min())


class StiffnessTest:
    """Counts the steps of an explicit solver that end on the boundary of stability."""

    def __init__(self) -> None:
        self.on_boundary = 0
        self.inside = 0

    def is_stiff(self, solver: Any, end: float) -> bool:
        """Look at the step just taken; True once the loop has shown itself stiff and much is left to be done."""
        if not isinstance(solver, DOP853) or solver.h_previous is None:
            return False
        step = abs(solver.h_previous)
        if (end - solver.t) < MANY * step:
            return False
        stages = solver.n_stages
        last = solver.y_old + solver.h_previous * (solver.K[: stages - 1].T @ solver.A[stages - 1, : stages - 1])
        distance = float(np.linalg.norm(solver.y - last))
        change = float(np.linalg.norm(solver.f - solver.K[stages - 1]))
        if distance > 0 and step * change > BOUNDARY * distance:
            self.on_boundary, self.inside = self.on_boundary + 1, 0
        else:
            self.inside += 1
            self.on_boundary = 0 if self.inside >= 6 else self.on_boundary
        return self.on_boundary >= PATIENCE
