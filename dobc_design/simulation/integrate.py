"""One run by SciPy's integrators, restarted at every switch: no step crosses one.

A run ends at its horizon, or where it diverged; what is valid up to there is kept, with the reason
in words.  A stiff loop is taken over by an implicit method: by an estimate before the run, and by
Hairer's test while it runs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.integrate import DOP853, Radau

from dobc_design.errors import wrong
from dobc_design.problem.arrays import ArcGroup, Array
from dobc_design.simulation.field import ClosedForm, Loop, errors_pattern, network_of
from dobc_design.simulation.switches import LOOKS, Modes, Stay

Derivative = Callable[[float, Array], Array]
Pattern = Callable[[], sp.csr_array]  # which derivative may depend on which state
Progress = Callable[[float], None]
Samples = dict[str, Any]  # x, d, dhat, u (T, n, m), xi, xihat (T, n, q) of a run, by name

FARTHEST = 1e9  # an error so many times its start (or 1, if that is larger) counts as divergence
# of the error since the last sample: a run that ends early keeps the steps at which it grew so much
GROWTH = 1.5
# the implicit method has order 5: a finer tolerance would cost very many steps
LEAST_IMPLICIT = 1e-8
STIFF = 2e4  # horizon times fastest decay from which on the implicit method is taken at once
# |h lambda| on the boundary of stability of DOP853 (Hairer, Norsett, Wanner, section IV.2)
BOUNDARY = 6.1
PATIENCE = 15  # steps on that boundary after which the loop counts as stiff, if ...
MANY = 3000  # ... so many steps would be left
MOST_STEPS = 10_000_000  # of one run: refused as soon as that many are foreseen, ...
LOOK_AHEAD = 5_000  # ... at the pace of the last so many

Piece = tuple[Derivative, Pattern, Stay]  # a stretch without a switch


class Plan(NamedTuple):
    """What is integrated: x (n, m) of a state, and the stretch without a switch that begins at a
    time and state."""

    goal: Array
    positions: Callable[[Array], Array]
    segment: Callable[[float, Array], Piece]

    def error(self, state: Array) -> float:
        return float(np.abs(self.positions(state) - self.goal).max())


def errors(loop: Loop, modes: Modes, closed: ClosedForm | None, eps0: Array, F: Array) -> Plan:
    """State e, flat (n m,), where the observer's error is known in closed form (22); else [e; eps],
    eps' = F eps (17). Both may die out, while xi and z go on; nor is eps lost in the difference of
    two states that grow.  A leader s stands after e, and positions are relative to it."""
    shape, cut, rows, both = (
        (loop.n, loop.m),
        loop.n * loop.m,
        loop.rows,
        loop.q > 0 and closed is None,
    )

    def positions(state: Array) -> Array:
        return np.asarray(state[:cut].reshape(shape) + loop.goal)

    @cache
    def made(mode: int) -> tuple[Derivative, Pattern]:
        groups = modes.groups(mode)
        network = network_of(loop, groups)

        def derivative(time: float, state: Array) -> Array:
            result = network(state[:rows])
            if closed is not None:
                result[:cut].reshape(shape)[...] += eps0 @ closed.at(time).T
            if not both:
                return result
            eps = state[rows:].reshape(loop.n, loop.q)
            result[:cut] += (eps @ loop.C.T).ravel()
            return np.concatenate([result, (eps @ F.T).ravel()])

        return derivative, partial(errors_pattern, loop, groups, both=both)

    def segment(time: float, state: Array) -> Piece:
        stay = modes.stay(time, positions(state))
        return *made(stay.mode), stay

    return Plan(loop.goal, positions, segment)


@dataclass(slots=True, kw_only=True, eq=False)
class Run:
    """Times (T,) and states (T, N); ``reason`` says why a run ended early, "" if it did not."""

    times: Array
    states: Array
    reason: str
    method: str
    evaluations: int
    notes: list[str] = field(default_factory=list)


Outcome = tuple[Run, Samples]


class Integration:
    """From ``start`` at 0, sampled at ``times``; ``tolerance`` is relative, the absolute one is a
    hundredth of it."""

    def __init__(
        self,
        plan: Plan,
        start: Array,
        times: Array,
        *,
        tolerance: float,
        implicit: bool,
        progress: Progress | None,
    ) -> None:
        self.plan, self.state, self.time, self.horizon = plan, start, 0.0, float(times[-1])
        self.times, self.states, self.done = times, np.empty((len(times), len(start))), 1
        self.states[0] = start
        self.tolerance, self.implicit = tolerance, implicit
        self.report = progress or (lambda part: None)
        self.risen = max(1.0, plan.error(start))
        self.farthest = FARTHEST * self.risen
        self.step: float | None = None
        self.evaluations, self.steps, self.looked = 0, 0, 0.0
        self.notes = ["The loop is stiff: integrated by the implicit method Radau."] * implicit
        self.methods = ["Radau" if implicit else "DOP853"]
        # steps since the last sample, each with a larger error
        self.rise: list[tuple[float, Array]] = []

    def run(self) -> Run:
        """To the horizon, or to where the run ends; then also the steps since the last sample at
        which |e| grew."""
        self.report(0.0)
        reason = ""
        while self.time < self.horizon and not reason:
            derivative, pattern, stay = self.plan.segment(self.time, self.state)
            if not np.isfinite(derivative(self.time, self.state)).all():
                reason = f"a coupling overflows or is undefined at t = {self.time:.6g} s"
                break
            reason = self.stretch(derivative, pattern, stay)
        times, states, method = (
            self.times[: self.done],
            self.states[: self.done],
            ", then ".join(self.methods),
        )
        if reason:
            late = {
                time: state
                for time, state in [(self.time, self.state), *self.rise[::-1]]
                if time > times[-1]
            }
            times = np.concatenate([times, sorted(late)])
            states = np.concatenate([states, *(late[time][None] for time in sorted(late))])
        else:
            self.report(1.0)
        found: dict[str, Any] = {
            "times": times.copy(),
            "states": states,
            "reason": reason,
            "method": method,
        }
        return Run(**found, evaluations=self.evaluations, notes=self.notes)

    def stretch(self, derivative: Derivative, pattern: Pattern, stay: Stay) -> str:
        """Integrate to the end of the stay, or to the switch that ends it; return why that failed,
        or ""."""
        solver = self.solver(derivative, pattern, stay.end)
        self.on_boundary = self.inside = 0
        while self.time < stay.end:
            before, old = solver.t, solver.y
            if not _stepped(solver) or not np.isfinite(solver.y).all():
                self.leave(solver, before, old)
                return (
                    f"the step size collapsed or the state overflowed just after t = {before:.6g} s"
                )
            end = solver.t
            if stay.change is not None:
                looks, states = np.linspace(before, end, LOOKS + 1), solver.dense_output()
                switch = stay.change(looks, partial(self.between, states))
                if switch is not None:
                    self.take(solver, switch)
                    self.leave(solver, switch, states(switch) if switch < end else solver.y)
                    return ""
            error = self.plan.error(solver.y)
            if error > self.farthest:
                self.leave(solver, solver.t, solver.y)
                return f"|e|_inf exceeded {FARTHEST:.0e} times its start at t = {self.time:.6g} s"
            self.take(solver, end)
            if self.rise and self.rise[-1][0] <= self.times[self.done - 1]:
                self.rise.clear()
            if error > GROWTH * self.risen:
                self.rise.append((end, solver.y))
                self.risen = error
            self.time, self.state = end, solver.y
            self.report(self.time / self.horizon)
            self.foresee()
            if not self.implicit and self.is_stiff(solver, stay.end):
                self.leave(solver, solver.t, solver.y)
                self.implicit, self.step = True, None
                self.methods.append("Radau")
                words = (
                    f"The loop turned out to be stiff at t = {self.time:.4g} s: from there on "
                    "by the"
                )
                self.notes.append(f"{words} implicit method Radau.")
                solver = self.solver(derivative, pattern, stay.end)
        self.leave(solver, solver.t, solver.y)
        return ""

    def foresee(self) -> None:
        """Count a step.  Raises: SpecError if the rest of the run needs too many."""
        self.steps += 1
        if self.steps % LOOK_AHEAD == 0:
            pace, self.looked = (self.time - self.looked) / LOOK_AHEAD, self.time
            if self.horizon - self.time > pace * (MOST_STEPS - self.steps):
                message = (
                    f"would take more than {MOST_STEPS} steps of the integrator; {self.steps} "
                    "of them led"
                )
                message += f" to t = {self.time:.4g} s of {self.horizon:.4g} s."
                raise wrong("t_final", message, "Choose a shorter horizon.")

    def between(self, states: Callable[[float], Array], time: float) -> Array:
        return self.plan.positions(states(time))

    def take(self, solver: Any, until: float) -> None:
        """The samples up to ``until`` in the step that the solver has just made."""
        count = int(np.searchsorted(self.times, until, side="right"))
        if count > self.done:
            exact = self.times[self.done : count] == solver.t
            self.states[self.done : count] = solver.dense_output()(self.times[self.done : count]).T
            self.states[self.done : count][exact] = solver.y
            self.done = count

    def solver(self, derivative: Derivative, pattern: Pattern, end: float) -> Any:
        """A solver that starts here and stops exactly at ``end``."""
        options: dict[str, Any] = {
            "first_step": None if self.step is None else min(self.step, end - self.time)
        }
        tolerance, method = self.tolerance, DOP853
        if self.implicit:
            tolerance, method = max(tolerance, LEAST_IMPLICIT), Radau
            options["jac_sparsity"] = pattern()
        return method(
            derivative, self.time, self.state, end, rtol=tolerance, atol=tolerance / 100, **options
        )

    def is_stiff(self, solver: Any, end: float) -> bool:
        """Whether many explicit steps ended on the boundary of stability, and much is left to be
        done."""
        step = abs(solver.h_previous or 0.0)
        if (end - solver.t) < MANY * step or not step:
            return False
        stages = solver.n_stages
        last = solver.y_old + solver.h_previous * (
            solver.K[: stages - 1].T @ solver.A[stages - 1, : stages - 1]
        )
        distance = float(np.linalg.norm(solver.y - last))
        if (
            distance > 0
            and step * float(np.linalg.norm(solver.f - solver.K[stages - 1])) > BOUNDARY * distance
        ):
            self.on_boundary, self.inside = self.on_boundary + 1, 0
        else:
            self.inside += 1
            self.on_boundary = 0 if self.inside >= 6 else self.on_boundary
        return self.on_boundary >= PATIENCE

    def leave(self, solver: Any, time: float, state: Array) -> None:
        """Take over where a solver stands, and the step it would have made next."""
        self.time, self.state = time, state
        self.evaluations += solver.nfev
        step = float(solver.h_abs)
        # the last step was cut short by the switch
        if self.step is not None and solver.t_bound == time:
            step = max(step, self.step)
        self.step = step if np.isfinite(step) and step > 0 else None


def _stepped(solver: Any) -> bool:
    try:
        solver.step()
    # the implicit method met a Jacobian that is not finite
    except (RuntimeError, ValueError, np.linalg.LinAlgError):
        return False
    return bool(solver.status != "failed")


def fastest_decay(loop: Loop, groups: Sequence[ArcGroup]) -> float:
    """A Gershgorin bound on the fastest decay of e at the consensus, 1/s; at a kink the steeper
    side counts."""
    rows = np.asarray(abs(loop.K).sum(axis=1)).reshape(loop.n, loop.m)
    for group in groups:
        slopes = group.coupling.jacobian_at_zero()
        steepest = np.array(
            [min(1e300, float(sum(entry.magnitude for entry in row))) for row in slopes]
        )
        strength = np.bincount(group.listeners, weights=group.weights, minlength=loop.n)
        rows = rows + 2 * strength[:, None] * steepest
    return float(rows.max())


def observer_decay(loop: Loop) -> float:
    """The fastest decay of the observer's error, 1/s."""
    known = loop.q > 0 and np.isfinite(loop.F).all()
    return float(-np.linalg.eigvals(loop.F).real.min()) if known else 0.0
