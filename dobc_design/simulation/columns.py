"""Many runs side by side: DOP853 on columns, each with its own time, step and switches.

The coefficients are SciPy's, and so are the rules for errors and steps; every run keeps its own
step size, so it ends where it would have ended alone, to the tolerance, and one that diverges
leaves the others in peace.  One run by itself: ``integrate.py``.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np
from scipy.integrate import DOP853

from dobc_design._checks import noun
from dobc_design.exact.matrix import Array
from dobc_design.problem.network import BoolArray, IndexArray

from .closed_form import ClosedForm
from .field import ClosedLoop, Networks
from .integrate import FARTHEST
from .switches import ModeTable

Visit = Callable[[IndexArray, IndexArray, Array], None]
RightHandSide = Callable[[Array, Array], Array]

STAGES = DOP853.n_stages
EXTENDED = STAGES + 1 + len(DOP853.C_EXTRA)  # with those of the interpolant
EXPONENT = -1 / (DOP853.error_estimator_order + 1)
LEAST_FACTOR, MOST_FACTOR, SAFETY = 0.2, 10.0, 0.9  # those of SciPy
SMALL, SMALL_STEP = 1e-5, 1e-6  # scaled size or speed that says nothing; the first step then, in s
# states n m of the runs of one chunk; some 60 arrays of this size are in use
COLUMN_NUMBERS = 1 << 15
MOST_STEPS = 20_000  # of one run, tried ones included; one that needs more is handed back
RUNNING, DONE, ESCAPED, COLLAPSED, HANDED_BACK = range(5)


class Columns(Protocol):
    """What runs side by side, named by their places, obey.  ``part``: the derivative in a mode, of
    e (N, k) and forces (F, k).  ``forces``: at times (S, k), a column for each run, (S, F, k).
    ``size``: |e|_inf of states (N, k), (k,). ``switched``: runs are in new modes."""

    def part(self, mode: int, runs: IndexArray) -> RightHandSide: ...
    def forces(self, times: Array, runs: IndexArray) -> Array: ...
    def size(self, y: Array) -> Array: ...
    def switched(self, runs: IndexArray, modes: IndexArray) -> None: ...


@noun(eq=False)
class Ends:
    """How every run ended, (R,), when it did, in s, where, e (N, R), and which step it would have
    made next, (R,)."""

    states: IndexArray
    times: Array
    e: Array
    steps: Array

    def reasons(self) -> dict[int, str]:
        """Why runs ended early; "" for those that are handed back."""
        words = {
            ESCAPED: f"|e|_inf exceeded {FARTHEST:.0e} times its start at",
            COLLAPSED: "the step size collapsed or the state overflowed just after",
        }
        found = {}
        for run in np.flatnonzero(self.states >= ESCAPED).tolist():
            why = words.get(int(self.states[run]))
            found[run] = "" if why is None else f"{why} t = {self.times[run]:.6g} s"
        return found


@dataclass(kw_only=True, eq=False)
class March:
    """Runs that are integrated over a stretch of time, from ``begin`` to ``end`` in s, a column
    each.

    Shapes: ``start`` (N, R), the states at ``begin``; ``switches`` of R runs; ``farthest`` (R,),
    the |e|_inf that counts as divergence; ``first`` (R,), the first step sizes, or None for a
    guess.  ``most``: steps, tried ones included, after which a run is handed back.  ``tolerance``
    is relative, the absolute one is a hundredth of it.  ``visit`` sees the states at those of the
    times ``samples`` that come after the begin, up to the end.

    Arrays named in PER_RUN have an entry for each run that is still under way; ``run_of`` says
    which runs these are.
    """

    PER_RUN: ClassVar = ("run_of", "t", "h", "place", "done", "steps", "rejected", "farthest")

    columns: Columns
    start: Array
    begin: float
    end: float
    switches: ModeTable
    farthest: Array
    first: Array | None = None
    most: int
    tolerance: float
    samples: Array
    visit: Visit

    def __post_init__(self) -> None:
        count = self.start.shape[1]
        self.absolute = self.tolerance / 100
        # of all runs: what Ends says of them
        self.ended = np.full(count, RUNNING)
        self.ended_at = np.full(count, self.end)
        self.last_e = self.start.copy()
        self.last_steps = np.zeros(count)
        times = self.switches.times
        # one more that never comes: the switch after the last one
        self.switch_times = np.pad(times, ((0, 0), (0, 1)), constant_values=np.inf)
        # of those under way
        self.run_of = np.arange(count)
        self.y = self.start.copy()
        self.t = np.full(count, self.begin)
        self.h = np.zeros(count)
        # the last switch that is not later than the begin
        self.place = (times <= self.begin).sum(axis=1) - 1
        self.done = np.searchsorted(self.samples, self.t, side="right")
        self.steps = np.zeros(count, dtype=np.int64)
        self.rejected = np.zeros(count, dtype=bool)
        self.K = np.empty((EXTENDED, *self.y.shape))
        self.look_up_modes()

    def look_up_modes(self) -> None:
        """In which modes the runs are, until when, and what they obey there."""
        self.mode = self.switches.modes[self.run_of, self.place]
        self.limit = np.minimum(self.switch_times[self.run_of, self.place + 1], self.end)
        self.parts = self.grouped(np.arange(len(self.run_of)))

    def run(self) -> Ends:
        """Integrate all runs to the end, or to where each of them ends."""
        # Trial steps overflow far from the target; they are rejected.
        with np.errstate(all="ignore"):
            forces = self.columns.forces(self.t[None], self.run_of)
            self.f = self.derivative(self.y, forces[0])
            self.h = self.guessed_steps() if self.first is None else self.first.copy()
            wrong = ~np.isfinite(self.f).all(axis=0)
            if wrong.any():
                self.retire(np.where(wrong, COLLAPSED, RUNNING))
            while len(self.run_of):
                self.step()
        return Ends(states=self.ended, times=self.ended_at, e=self.last_e, steps=self.last_steps)

    def step(self) -> None:
        """Try one step of every run, and keep those that are accurate enough."""
        cut = self.h >= self.limit - self.t
        ends = np.where(cut, self.limit, self.t + self.h)
        h = ends - self.t
        new, f_new = self.stages(h, ends)
        norm = self.error_norm(h, new)
        finite = np.isfinite(new).all(axis=0) & np.isfinite(f_new).all(axis=0)
        good = (norm < 1) & finite
        factor = np.where(norm == 0, MOST_FACTOR, SAFETY * norm**EXPONENT)
        factor = np.where(np.isfinite(factor), factor, LEAST_FACTOR)
        # right after a rejected step none is longer than it
        most = np.where(self.rejected, 1.0, MOST_FACTOR)
        grown = np.clip(factor, LEAST_FACTOR, most) * h
        shrunk = np.clip(factor, LEAST_FACTOR, SAFETY) * h
        self.record(good, h, ends, new, f_new)
        # a step that a switch cut short says nothing against the longer one
        kept = np.where(cut, np.maximum(self.h, grown), grown)
        self.h = np.where(good, kept, shrunk)
        self.y = np.where(good, new, self.y)
        self.f = np.where(good, f_new, self.f)
        self.t = np.where(good, ends, self.t)
        self.rejected = ~good
        self.steps += 1
        self.sort_out(good, switched=good & cut & (ends < self.end))

    def stages(self, h: Array, ends: Array) -> tuple[Array, Array]:
        """The new states and their derivatives; all stages stand in K then."""
        K = self.K
        flat = K.reshape(EXTENDED, -1)
        # of all stages at once: forces depend on time alone
        within = self.t + DOP853.C[1:, None] * h
        forces = self.columns.forces(np.concatenate([within, ends[None]]), self.run_of)
        K[0] = self.f  # the last derivative of a step is the first of the next
        for s in range(1, STAGES):
            y = (DOP853.A[s, :s] @ flat[:s]).reshape(self.y.shape)
            y *= h
            y += self.y
            K[s] = self.derivative(y, forces[s - 1])
        moved = (DOP853.B @ flat[:STAGES]).reshape(self.y.shape)
        new = moved * h + self.y
        K[STAGES] = self.derivative(new, forces[STAGES - 1])
        return new, K[STAGES]

    def error_norm(self, h: Array, new: Array) -> Array:
        """The norm of the error of every run, 1 being the tolerance: from the estimates of orders 5
        and 3, as SciPy combines them."""
        y = self.y
        flat = self.K.reshape(EXTENDED, -1)[: STAGES + 1]
        # of every number by itself: some are large, some small
        scale = self.absolute + np.maximum(np.abs(y), np.abs(new)) * self.tolerance
        of_fifth = (DOP853.E5 @ flat).reshape(y.shape)
        of_third = (DOP853.E3 @ flat).reshape(y.shape)
        fifth = np.square(of_fifth / scale).sum(axis=0)
        third = np.square(of_third / scale).sum(axis=0)
        below = np.sqrt((fifth + 0.01 * third) * len(y))
        exact = below == 0
        return np.where(exact, 0.0, h * fifth / np.where(exact, 1.0, below))

    def record(self, good: BoolArray, h: Array, ends: Array, new: Array, f_new: Array) -> None:
        """Show the samples within the steps that were accepted."""
        done = self.done
        # runs have steps of their own, so that some pass several samples and some none
        upto = np.searchsorted(self.samples, ends, side="right")
        chosen = np.flatnonzero(good & (upto > done))
        if not len(chosen):
            return
        h = h[chosen]
        y = self.y[:, chosen]
        F = self.interpolant(chosen, h, new, f_new)
        # the first sample of every run, then the second of those that have two, ...
        for offset in range(int((upto - done)[chosen].max())):
            there = np.flatnonzero(done[chosen] + offset < upto[chosen])
            own = chosen[there]
            sample = done[own] + offset
            part = (self.samples[sample] - self.t[own]) / h[there]
            value = np.zeros((len(y), len(there)))
            for i, row in enumerate(F[::-1]):
                value += row[:, there]
                value *= part if i % 2 == 0 else 1 - part
            value += y[:, there]
            # there the polynomial is off by rounding, the step is not
            at_end = self.samples[sample] == ends[own]
            value[:, at_end] = new[:, own[at_end]]
            self.visit(sample, self.run_of[own], value)
        done[chosen] = upto[chosen]

    def interpolant(self, chosen: IndexArray, h: Array, new: Array, f_new: Array) -> Array:
        """SciPy's polynomial of order 7 over the step, for some of the runs: (7, n m, k)."""
        # no copy where all runs are asked for
        K = self.K if len(chosen) == len(self.run_of) else self.K.take(chosen, axis=2)
        flat = K.reshape(EXTENDED, -1)
        old = self.y[:, chosen]
        times = self.t[chosen] + DOP853.C_EXTRA[:, None] * h
        forces = self.columns.forces(times, self.run_of[chosen])
        for number, row in enumerate(DOP853.A_EXTRA):
            s = STAGES + 1 + number
            moved = (row[:s] @ flat[:s]).reshape(old.shape)
            K[s] = self.derivative(moved * h + old, forces[number], chosen)
        difference = new[:, chosen] - old
        F = np.empty((3 + len(DOP853.D), *old.shape))
        F[0] = difference
        F[1] = h * K[0] - difference
        F[2] = 2 * difference - h * (f_new[:, chosen] + K[0])
        F[3:] = h * (DOP853.D @ flat).reshape(-1, *old.shape)
        return F

    def sort_out(self, good: BoolArray, *, switched: BoolArray) -> None:
        """Switch the runs that have come to a switch, and retire those that have ended."""
        if switched.any():
            self.switch(switched)
        # SciPy gives up at the same step size
        collapsed = ~good & (self.h < 10 * np.spacing(self.t))
        collapsed |= switched & ~np.isfinite(self.f).all(axis=0)
        escaped = self.columns.size(self.y) > self.farthest
        # where several are true, the last of these counts
        state = np.where(self.steps >= self.most, HANDED_BACK, RUNNING)
        state = np.where(self.t >= self.end, DONE, state)
        state = np.where(collapsed, COLLAPSED, state)
        state = np.where(escaped, ESCAPED, state)
        if (state != RUNNING).any():
            self.retire(state)

    def switch(self, switched: BoolArray) -> None:
        """These runs are in their next mode from now on."""
        self.place = self.place + switched
        some = np.flatnonzero(switched)
        runs = self.run_of[some]
        # first: right-hand sides hold what is kept of the links
        self.columns.switched(runs, self.switches.modes[runs, self.place[some]])
        self.look_up_modes()
        forces = self.columns.forces(self.t[None, some], self.run_of[some])
        self.f[:, some] = self.derivative(self.y[:, some], forces[0], some)

    def retire(self, state: IndexArray) -> None:
        """Put down how runs ended, and go on with the columns of the others."""
        out = state != RUNNING
        # columns that have ended would cost as much as the others
        keep = np.flatnonzero(state == RUNNING)
        runs = self.run_of[out]
        self.ended[runs] = state[out]
        self.ended_at[runs] = self.t[out]
        self.last_e[:, runs] = self.y[:, out]
        self.last_steps[runs] = self.h[out]
        self.y = self.y[:, keep]
        self.f = self.f[:, keep]
        for name in self.PER_RUN:
            setattr(self, name, getattr(self, name)[keep])
        self.K = np.empty((EXTENDED, *self.y.shape))
        self.look_up_modes()

    def grouped(self, chosen: IndexArray) -> list[tuple[IndexArray, RightHandSide]]:
        """Which of the chosen columns are in which mode, and what they obey there."""
        # one right-hand side for all columns of a mode: few calls of NumPy
        mode = self.mode[chosen]
        runs = self.run_of[chosen]
        found = []
        for number in np.unique(mode).tolist():
            columns = np.flatnonzero(mode == number)
            found.append((columns, self.columns.part(number, runs[columns])))
        return found

    def derivative(self, y: Array, force: Array, chosen: IndexArray | None = None) -> Array:
        """The derivative of all runs, or of the chosen ones, whose states are y (N, k)."""
        parts = self.parts if chosen is None else self.grouped(chosen)
        # no copies where all runs are in one mode
        if len(parts) == 1:
            return parts[0][1](y, force)
        result = np.empty_like(y)
        for columns, right_hand_side in parts:
            own = y.take(columns, axis=1)
            result[:, columns] = right_hand_side(own, force.take(columns, axis=1))
        return result

    def guessed_steps(self) -> Array:
        """A hundredth of the time in which the state would change by its own size, as SciPy
        begins."""
        scale = self.absolute + np.abs(self.y) * self.tolerance
        size = np.sqrt(np.square(self.y / scale).mean(axis=0))
        speed = np.sqrt(np.square(self.f / scale).mean(axis=0))
        h = 0.01 * size / np.where(speed == 0, 1.0, speed)
        h = np.where((size < SMALL) | (speed < SMALL), SMALL_STEP, h)
        return np.minimum(np.where(np.isfinite(h), h, SMALL_STEP), self.end)


@noun(eq=False)
class CalmColumns:
    """Runs without stress as columns: e' = h(e) - K e + C eps, for e (n m, R), a leader's numbers
    after them, and eps (n, q, R) at the start, which is known in closed form; ``networks``: the
    right-hand side without eps by mode."""

    loop: ClosedLoop
    networks: Networks
    closed: ClosedForm | None
    e: Array
    eps: Array
    switches: ModeTable

    def part(self, mode: int, runs: IndexArray) -> RightHandSide:
        network = self.networks(mode)

        def derivative(e: Array, force: Array) -> Array:
            result = network(e)
            result[: len(force)] += force
            return result

        return derivative

    def forces(self, times: Array, runs: IndexArray) -> Array:
        """C exp(F t) eps, (S, n m, k)."""
        if self.closed is None:
            return np.zeros((len(times), 0, len(runs)))
        states = self.eps.take(runs, axis=2)
        weights = np.moveaxis(self.closed.many(times), 2, 0)
        shape = (len(weights), len(states), weights.shape[1], weights.shape[3])
        total = np.zeros(shape)
        for k in range(states.shape[1]):
            total += states[:, k, None, :] * weights[:, None, :, k]
        return total.reshape(len(times), self.loop.size, len(runs))

    def size(self, y: Array) -> Array:
        e = y[: self.loop.size].reshape(self.loop.n, self.loop.m, -1)
        return np.asarray(self.loop.far(e).max(axis=(0, 1), initial=0.0))

    def switched(self, runs: IndexArray, modes: IndexArray) -> None:
        """Nothing is kept from one mode to the next."""

    def integrate(
        self, times: Array, *, tolerance: float, visit: Visit, most: int | None = None
    ) -> Ends:
        """Integrate all runs over ``times`` from 0; ``visit`` gets places of samples and runs (k,),
        and e (n m, k)."""
        e = self.e
        runs = np.arange(e.shape[1])
        visit(np.zeros_like(runs), runs, e)
        march = March(
            columns=self,
            start=e,
            begin=0.0,
            end=float(times[-1]),
            switches=self.switches,
            farthest=FARTHEST * np.maximum(1.0, self.size(e)),
            most=MOST_STEPS if most is None else most,
            tolerance=tolerance,
            samples=times,
            visit=visit,
        )
        return march.run()
