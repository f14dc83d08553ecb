"""One run by SciPy's integrators, restarted at every switch: no step crosses one.

A run ends at its horizon, or where it diverged; what is valid up to there is kept, with the reason
in words.  A stiff loop is taken over by an implicit method: by an estimate before the run, and by
Hairer's test while it runs.  Many runs side by side: ``columns.py``.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.integrate import DOP853, RK45, Radau

from dobc_design._checks import noun
from dobc_design.errors import wrong
from dobc_design.exact.matrix import Array
from dobc_design.loop.arrays import ArcGroups

from .closed_form import ClosedForm
from .field import ClosedLoop, Network, errors_pattern, network_of
from .mobile import LOOKS, Modes
from .switches import Stay

Derivative = Callable[[float, Array], Array]
Pattern = Callable[[], sp.csr_array]  # which derivative may depend on which state
Progress = Callable[[float], None]


def silent(part: float) -> None:
    """Progress that nobody is told of."""


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
RELAPSE = 6  # steps within it after which those before are forgotten
# a stretch is short as a part of the usual step; the tolerance over it as a part of the usual one
SHORT, CLOSE = 0.5, 0.1
MOST_STEPS = 10_000_000  # of one run: refused as soon as that many are foreseen, ...
LOOK_AHEAD = 5_000  # ... at the pace of the last so many


class Piece(NamedTuple):
    """A stretch without a switch."""

    derivative: Derivative
    pattern: Pattern
    stay: Stay


class Plan(NamedTuple):
    """What is integrated: x (n, m) of a state, and the stretch without a switch that begins at a
    time and state."""

    goal: Array
    positions: Callable[[Array], Array]
    segment: Callable[[float, Array], Piece]
    far: Callable[[Array], Array] = np.abs

    def error(self, state: Array) -> float:
        """|e|_inf of a state."""
        return float(self.far(self.positions(state) - self.goal).max())


def errors(
    loop: ClosedLoop, modes: Modes, closed: ClosedForm | None, eps0: Array, F: Array
) -> Plan:
    """State e, flat (n m,), where the observer's error is known in closed form (22); else [e; eps],
    eps' = F eps (17). Both may die out, while xi and z go on; nor is eps lost in the difference of
    two states that grow.  A leader s stands after e, and positions are relative to it."""
    shape = (loop.n, loop.m)
    cut = loop.size
    rows = loop.rows
    both = loop.q > 0 and closed is None

    def positions(state: Array) -> Array:
        return state[:cut].reshape(shape) + loop.goal

    @cache
    def network(mode: int) -> Network:
        return network_of(loop, modes.groups(mode))

    def derivative(mode: int, time: float, state: Array) -> Array:
        result = network(mode)(state[:rows], time)
        if closed is not None:
            result[:cut].reshape(shape)[...] += eps0 @ closed.at(time).T
        if not both:
            return result
        eps = state[rows:].reshape(loop.n, loop.q)
        result[:cut] += (eps @ loop.C.T).ravel()
        return np.concatenate([result, (eps @ F.T).ravel()])

    def segment(time: float, state: Array) -> Piece:
        stay = modes.stay(time, positions(state))
        groups = network(stay.mode).groups
        pattern = partial(errors_pattern, loop, groups, both=both)
        return Piece(partial(derivative, stay.mode), pattern, stay)

    return Plan(loop.goal, positions, segment, loop.far)


@dataclass(slots=True, kw_only=True, eq=False)
class Run:
    """Times (T,) and states (T, N); ``reason`` says why a run ended early, "" if it did not."""

    times: Array
    states: Array
    reason: str
    method: str
    evaluations: int
    notes: list[str] = field(default_factory=list)


class Samples(NamedTuple):
    """What is seen of the loop: of one run over its times x, d, dhat, u (T, n, m) and xi, xihat (T,
    n, q), or of many at one time, (n, m, R) and (n, q, R).  ``leader``: (T, m) where there is
    one."""

    x: Array
    xi: Array
    xihat: Array
    d: Array
    dhat: Array
    u: Array
    leader: Array | None = None


@noun(eq=False)
class Outcome:
    """How one run went, and its samples."""

    run: Run
    samples: Samples


@dataclass(kw_only=True, eq=False)
class Integration:
    """From ``state`` at 0, sampled at ``times``; ``tolerance`` is relative, the absolute one is a
    hundredth of it."""

    plan: Plan
    state: Array
    times: Array
    tolerance: float
    implicit: bool
    report: Progress

    def __post_init__(self) -> None:
        # where it stands, and the step that comes next
        self.time = 0.0
        self.horizon = float(self.times[-1])
        self.step: float | None = None
        # samples that are done
        self.states = np.empty((len(self.times), len(self.state)))
        self.states[0] = self.state
        self.done = 1
        # steps since the last sample, each with a larger error
        self.risen = max(1.0, self.plan.error(self.state))
        self.farthest = FARTHEST * self.risen
        self.rise: list[tuple[float, Array]] = []
        # effort
        self.evaluations = 0
        self.steps = 0
        self.looked = 0.0
        # signs of stiffness in the present stretch
        self.on_boundary = 0
        self.inside = 0
        self.notes = []
        self.methods = ["DOP853"]
        if self.implicit:
            self.notes.append("The loop is stiff: integrated by the implicit method Radau.")
            self.methods = ["Radau"]

    def run(self) -> Run:
        """To the horizon, or to where the run ends; then also the steps since the last sample at
        which |e| grew."""
        self.report(0.0)
        reason = ""
        while self.time < self.horizon and not reason:
            piece = self.plan.segment(self.time, self.state)
            reason = self.stretch(piece)
        times = self.times[: self.done]
        states = self.states[: self.done]
        if reason:
            # a run that blows up between two samples is to be seen rising
            late = self.late_steps(float(times[-1]))
            times = np.concatenate([times, sorted(late)])
            states = np.concatenate([states, *(late[time][None] for time in sorted(late))])
        else:
            self.report(1.0)
        return Run(
            times=times.copy(),
            states=states,
            reason=reason,
            method=", then ".join(self.methods),
            evaluations=self.evaluations,
            notes=self.notes,
        )

    def late_steps(self, last: float) -> dict[float, Array]:
        """States after the last sample, by time: where |e| grew, and where the run ended."""
        found = {}
        for time, state in [(self.time, self.state), *self.rise[::-1]]:
            if time > last:
                found[time] = state
        return found

    def stretch(self, piece: Piece) -> str:
        """Integrate to the end of the stay, or to the switch that ends it; return why that failed,
        or ""."""
        stay = piece.stay
        solver = self.solver(piece)
        if not np.isfinite(solver.f).all():
            return f"a coupling overflows or is undefined at t = {self.time:.6g} s"
        self.on_boundary = 0
        self.inside = 0
        while self.time < stay.end:
            before, old = solver.t, solver.y
            if not _stepped(solver) or not np.isfinite(solver.y).all():
                self.leave(solver, before, old)
                return (
                    f"the step size collapsed or the state overflowed just after t = {before:.6g} s"
                )
            if self.switched(solver, stay, before):
                return ""
            error = self.plan.error(solver.y)
            if error > self.farthest:
                self.leave(solver, solver.t, solver.y)
                return f"|e|_inf exceeded {FARTHEST:.0e} times its start at t = {self.time:.6g} s"
            self.accept(solver, error)
            self.foresee()
            if not self.implicit and self.is_stiff(solver, stay.end):
                solver = self.become_implicit(solver, piece)
        self.leave(solver, solver.t, solver.y)
        return ""

    def switched(self, solver: Any, stay: Stay, before: float) -> bool:
        """Whether the graph changed within the step that began at ``before``; if so, the run stands
        there."""
        if stay.change is None:
            return False
        states = solver.dense_output()
        looks = np.linspace(before, solver.t, LOOKS + 1)
        switch = stay.change(looks, partial(self.between, states))
        if switch is None:
            return False
        end = solver.t
        self.take(solver, switch)
        self.leave(solver, switch, states(switch) if switch < end else solver.y)
        return True

    def accept(self, solver: Any, error: float) -> None:
        """Keep a step, whose end has this |e|_inf, and its samples."""
        rise = self.rise
        self.take(solver, solver.t)
        # a sample that was passed holds what these steps showed
        if rise and rise[-1][0] <= self.times[self.done - 1]:
            rise.clear()
        if error > GROWTH * self.risen:
            rise.append((solver.t, solver.y))
            self.risen = error
        self.time = solver.t
        self.state = solver.y
        self.report(self.time / self.horizon)

    def become_implicit(self, solver: Any, piece: Piece) -> Any:
        """Go on with the implicit method: its solver from here on."""
        self.leave(solver, solver.t, solver.y)
        self.implicit = True
        self.step = None
        self.methods.append("Radau")
        self.notes.append(
            f"The loop turned out to be stiff at t = {self.time:.4g} s: from there on by the "
            "implicit method Radau."
        )
        return self.solver(piece)

    def foresee(self) -> None:
        """Count a step.  Raises: SpecError if the rest of the run needs too many."""
        self.steps += 1
        # not at every step: the pace of a few says little
        if self.steps % LOOK_AHEAD:
            return
        pace = (self.time - self.looked) / LOOK_AHEAD
        self.looked = self.time
        if self.horizon - self.time > pace * (MOST_STEPS - self.steps):
            message = (
                f"would take more than {MOST_STEPS} steps of the integrator; {self.steps} of "
                f"them led to t = {self.time:.4g} s of {self.horizon:.4g} s."
            )
            raise wrong("t_final", message, "Choose a shorter horizon.")

    def between(self, states: Callable[[float], Array], time: float) -> Array:
        return self.plan.positions(states(time))

    def take(self, solver: Any, until: float) -> None:
        """The samples up to ``until`` in the step that the solver has just made."""
        count = int(np.searchsorted(self.times, until, side="right"))
        if count <= self.done:
            return
        times = self.times[self.done : count]
        states = self.states[self.done : count]
        states[:] = solver.dense_output()(times).T
        states[times == solver.t] = solver.y  # exactly, where a sample is at the end of the step
        self.done = count

    def solver(self, piece: Piece) -> Any:
        """A solver that starts here and stops exactly at the end of the stay."""
        end = piece.stay.end
        step = None if self.step is None else min(self.step, end - self.time)
        tolerance = self.tolerance
        method = DOP853
        # As from one reading to the next: few stages do, more accurate than they have to be.
        if end - self.time < SHORT * (self.step or 0.0):
            method = RK45
            tolerance *= CLOSE
        if self.implicit:
            tolerance = max(tolerance, LEAST_IMPLICIT)
            method = partial(Radau, jac_sparsity=piece.pattern())
        solver = partial(method, piece.derivative, self.time, self.state, end)
        return solver(rtol=tolerance, atol=tolerance / 100, first_step=step)

    def is_stiff(self, solver: Any, end: float) -> bool:
        """Whether many explicit steps ended on the boundary of stability, and much is left to be
        done."""
        step = abs(solver.h_previous or 0.0)
        if (end - solver.t) < MANY * step or not step:
            return False
        # |h lambda|, estimated from two derivatives close to the end of the step
        stages = solver.n_stages
        weighted = solver.K[: stages - 1].T @ solver.A[stages - 1, : stages - 1]
        last = solver.y_old + solver.h_previous * weighted
        distance = float(np.linalg.norm(solver.y - last))
        change = float(np.linalg.norm(solver.f - solver.K[stages - 1]))
        if distance > 0 and step * change > BOUNDARY * distance:
            self.on_boundary += 1
            self.inside = 0
        else:
            self.inside += 1
            if self.inside >= RELAPSE:
                self.on_boundary = 0
        return self.on_boundary >= PATIENCE

    def leave(self, solver: Any, time: float, state: Array) -> None:
        """Take over where a solver stands, and the step it would have made next."""
        self.time = time
        self.state = state
        self.evaluations += solver.nfev
        # the step that the solver proposes for later
        step = float(solver.h_abs)
        # the last step was cut short by the switch
        if self.step is not None and solver.t_bound == time:
            step = max(step, self.step)
        self.step = step if np.isfinite(step) and step > 0 else None


def _stepped(solver: Any) -> bool:
    """Whether the solver made a step."""
    try:
        solver.step()
    # the implicit method met a Jacobian that is not finite
    except (RuntimeError, ValueError, np.linalg.LinAlgError):
        return False
    return bool(solver.status != "failed")


def fastest_decay(loop: ClosedLoop, groups: ArcGroups) -> float:
    """A Gershgorin bound on the fastest decay of e at the consensus, 1/s; at a kink the steeper
    side counts."""
    # the circles of Gershgorin: what pulls an agent, and twice what its arcs can do
    rows = np.asarray(abs(loop.K).sum(axis=1)).reshape(loop.n, loop.m)
    for group in groups:
        steepest = []
        for row in group.coupling.jacobian_at_zero():
            steepness = float(sum(entry.magnitude for entry in row))
            steepest.append(min(1e300, steepness))
        strength = np.bincount(group.listeners, weights=group.weights, minlength=loop.n)
        rows = rows + 2 * strength[:, None] * np.array(steepest)
    return float(rows.max())


def observer_decay(loop: ClosedLoop) -> float:
    """The fastest decay of the observer's error, 1/s."""
    if loop.q == 0 or not np.isfinite(loop.F).all():
        return 0.0
    return float(-np.linalg.eigvals(loop.F).real.min())
