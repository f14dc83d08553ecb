"""Many runs side by side: DOP853 on columns, each with its own time, step and switches.

The coefficients are SciPy's, and so are the rules for errors and steps; every run keeps its own
step size, so it ends where it would have ended alone, to the tolerance, and one that diverges
leaves the others in peace.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853

from dobc_design.problem.arrays import Array
from dobc_design.problem.network import IndexArray
from dobc_design.simulation.field import ClosedForm, Loop, Network
from dobc_design.simulation.integrate import FARTHEST
from dobc_design.simulation.switches import Switches

Visit = Callable[[IndexArray, IndexArray, Array], None]
RightHandSide = Callable[[Array, Array], Array]

STAGES, EXTENDED = DOP853.n_stages, DOP853.n_stages + 1 + len(DOP853.C_EXTRA)
EXPONENT = -1 / (DOP853.error_estimator_order + 1)
LEAST_FACTOR, MOST_FACTOR, SAFETY = 0.2, 10.0, 0.9  # those of SciPy
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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
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
        early = np.flatnonzero(self.states >= ESCAPED).tolist()
        return {
            k: f"{words[s]} t = {self.times[k]:.6g} s" if (s := self.states[k]) in words else ""
            for k in early
        }


def padded(switches: Sequence[Switches]) -> tuple[Array, IndexArray]:
    """The instants and modes of all runs, (R, S), padded with inf and 0."""
    shape = (len(switches), 1 + max(map(len, switches)))
    times, modes = np.full(shape, np.inf), np.zeros(shape, dtype=np.int64)
    for row, each in enumerate(switches):
        times[row, : len(each)], modes[row, : len(each)] = each.times, each.modes
    return times, modes


class Stretch:
    """A stretch of time, in s, for runs side by side; those that are still under way have a column
    each.  Shapes: e (N, R) at ``begin``; times and modes of ``switches`` (R, S), padded with inf
    and 0; ``farthest`` (R,), the |e|_inf that counts as divergence; ``steps`` (R,), the first step
    sizes, or None for a guess.  ``most``: steps, tried ones included, after which a run is handed
    back.  ``visit`` sees the samples after the begin, up to the end."""

    def __init__(
        self,
        columns: Columns,
        e: Array,
        samples: Array,
        *,
        begin: float,
        end: float,
        farthest: Array,
        switches: tuple[Array, IndexArray],
        steps: Array | None = None,
        most: int,
        tolerance: float,
        visit: Visit,
    ) -> None:
        self.columns, self.samples, self.visit, self.most, self.first = (
            columns,
            samples,
            visit,
            most,
            steps,
        )
        self.horizon, self.relative, self.absolute = end, tolerance, tolerance / 100
        count = e.shape[1]
        self.ended, self.ended_at = np.full(count, RUNNING), np.full(count, self.horizon)
        self.last_e, self.last_steps = e.copy(), np.zeros(count)
        self.switch_times = np.pad(switches[0], ((0, 0), (0, 1)), constant_values=np.inf)
        self.switch_modes, self.run_of, self.farthest = switches[1], np.arange(count), farthest
        self.y, self.t, self.h = e.copy(), np.full(count, begin), np.zeros(count)
        self.place = (switches[0] <= begin).sum(axis=1) - 1
        self.done = np.searchsorted(samples, self.t, side="right")
        self.steps, self.rejected = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=bool)
        self.arrange()

    def arrange(self) -> None:
        self.mode = self.switch_modes[self.run_of, self.place]
        self.limit = np.minimum(self.switch_times[self.run_of, self.place + 1], self.horizon)

    def run(self) -> Ends:
        with np.errstate(all="ignore"):
            self.K = np.empty((EXTENDED, *self.y.shape))
            self.parts = self.grouped(np.arange(len(self.run_of)))
            self.f = self.derivative(self.y, self.columns.forces(self.t[None], self.run_of)[0])
            self.h = self.first_steps() if self.first is None else self.first.copy()
            wrong = ~np.isfinite(self.f).all(axis=0)
            if wrong.any():
                self.retire(np.where(wrong, COLLAPSED, RUNNING))
            while len(self.run_of):
                self.step()
        return Ends(states=self.ended, times=self.ended_at, e=self.last_e, steps=self.last_steps)

    def step(self) -> None:
        cut = self.h >= self.limit - self.t
        ends = np.where(cut, self.limit, self.t + self.h)
        h = ends - self.t
        new, f_new, norm = self.stages(h, ends)
        good = (norm < 1) & np.isfinite(new).all(axis=0) & np.isfinite(f_new).all(axis=0)
        factor = np.where(norm == 0, MOST_FACTOR, SAFETY * norm**EXPONENT)
        factor = np.where(np.isfinite(factor), factor, LEAST_FACTOR)
        grown = np.clip(factor, LEAST_FACTOR, np.where(self.rejected, 1.0, MOST_FACTOR)) * h
        shrunk = np.clip(factor, LEAST_FACTOR, SAFETY) * h
        self.record(good, h, ends, new, f_new)
        self.h = np.where(good, np.where(cut, np.maximum(self.h, grown), grown), shrunk)
        self.y, self.f = np.where(good, new, self.y), np.where(good, f_new, self.f)
        self.t = np.where(good, ends, self.t)
        self.rejected = ~good
        self.steps += 1
        self.sort_out(good, switched=good & cut & (ends < self.horizon))

    def stages(self, h: Array, ends: Array) -> tuple[Array, Array, Array]:
        """The new states, their derivatives, and the norm of the error, 1 being the tolerance."""
        K, flat = self.K, self.K.reshape(EXTENDED, -1)
        forces = self.columns.forces(
            np.concatenate([self.t + DOP853.C[1:, None] * h, ends[None]]), self.run_of
        )
        K[0] = self.f
        for s in range(1, STAGES):
            y = (DOP853.A[s, :s] @ flat[:s]).reshape(self.y.shape)
            y *= h
            y += self.y
            K[s] = self.derivative(y, forces[s - 1])
        new = (DOP853.B @ flat[:STAGES]).reshape(self.y.shape) * h + self.y
        K[STAGES] = self.derivative(new, forces[STAGES - 1])
        scale = self.absolute + np.maximum(np.abs(self.y), np.abs(new)) * self.relative
        errors = (
            (E @ flat[: STAGES + 1]).reshape(self.y.shape) / scale for E in (DOP853.E5, DOP853.E3)
        )
        fifth, third = (np.square(each).sum(axis=0) for each in errors)
        below = np.sqrt((fifth + 0.01 * third) * len(self.y))
        return (
            new,
            K[STAGES],
            np.where(below == 0, 0.0, h * fifth / np.where(below == 0, 1.0, below)),
        )

    def record(
        self, good: NDArray[np.bool_], h: Array, ends: Array, new: Array, f_new: Array
    ) -> None:
        upto = np.searchsorted(self.samples, ends, side="right")
        chosen = np.flatnonzero(good & (upto > self.done))
        if not len(chosen):
            return
        h, y = h[chosen], self.y[:, chosen]
        F = self.interpolant(chosen, h, new, f_new)
        for offset in range(int((upto - self.done)[chosen].max())):
            there = np.flatnonzero(self.done[chosen] + offset < upto[chosen])
            sample = self.done[chosen[there]] + offset
            part = (self.samples[sample] - self.t[chosen[there]]) / h[there]
            value = np.zeros((len(y), len(there)))
            for i, row in enumerate(F[::-1]):
                value += row[:, there]
                value *= part if i % 2 == 0 else 1 - part
            value += y[:, there]
            at_end = self.samples[sample] == ends[chosen[there]]
            value[:, at_end] = new[:, chosen[there[at_end]]]
            self.visit(sample, self.run_of[chosen[there]], value)
        self.done[chosen] = upto[chosen]

    def interpolant(self, chosen: IndexArray, h: Array, new: Array, f_new: Array) -> Array:
        """SciPy's polynomial of order 7 over the step, for some of the runs: (7, n m, k)."""
        K = self.K if len(chosen) == len(self.run_of) else self.K.take(chosen, axis=2)
        flat, old = K.reshape(EXTENDED, -1), self.y[:, chosen]
        forces = self.columns.forces(
            self.t[chosen] + DOP853.C_EXTRA[:, None] * h, self.run_of[chosen]
        )
        for s, row in enumerate(DOP853.A_EXTRA, start=STAGES + 1):
            y = (row[:s] @ flat[:s]).reshape(old.shape) * h + old
            K[s] = self.derivative(y, forces[s - STAGES - 1], chosen)
        difference = new[:, chosen] - old
        F = np.empty((3 + len(DOP853.D), *old.shape))
        F[0] = difference
        F[1] = h * K[0] - difference
        F[2] = 2 * difference - h * (f_new[:, chosen] + K[0])
        F[3:] = h * (DOP853.D @ flat).reshape(-1, *old.shape)
        return F

    def sort_out(self, good: NDArray[np.bool_], *, switched: NDArray[np.bool_]) -> None:
        """Switch the runs that have come to a switch, and retire those that have ended."""
        if switched.any():
            self.place = self.place + switched
            self.arrange()
            some = np.flatnonzero(switched)
            self.columns.switched(self.run_of[some], self.mode[some])
            self.parts = self.grouped(np.arange(len(self.run_of)))
            forces = self.columns.forces(self.t[None, some], self.run_of[some])
            self.f[:, some] = self.derivative(self.y[:, some], forces[0], some)
        collapsed = ~good & (self.h < 10 * np.spacing(self.t))
        collapsed |= switched & ~np.isfinite(self.f).all(axis=0)
        state = np.where(collapsed, COLLAPSED, RUNNING)
        state = np.where(self.columns.size(self.y) > self.farthest, ESCAPED, state)
        state = np.where((state == RUNNING) & (self.t >= self.horizon), DONE, state)
        state = np.where((state == RUNNING) & (self.steps >= self.most), HANDED_BACK, state)
        if (state != RUNNING).any():
            self.retire(state)

    def retire(self, state: IndexArray) -> None:
        out, keep = state != RUNNING, np.flatnonzero(state == RUNNING)
        self.ended[self.run_of[out]] = state[out]
        self.ended_at[self.run_of[out]] = self.t[out]
        self.last_e[:, self.run_of[out]], self.last_steps[self.run_of[out]] = (
            self.y[:, out],
            self.h[out],
        )
        self.y, self.f = self.y[:, keep], self.f[:, keep]
        for name in (
            "run_of",
            "t",
            "h",
            "place",
            "done",
            "steps",
            "rejected",
            "farthest",
            "mode",
            "limit",
        ):
            setattr(self, name, getattr(self, name)[keep])
        self.K = np.empty((EXTENDED, *self.y.shape))
        self.parts = self.grouped(np.arange(len(keep)))

    def grouped(self, chosen: IndexArray) -> list[tuple[IndexArray, RightHandSide]]:
        """Which of the chosen columns are in which mode, and what they obey there."""
        mode, runs = self.mode[chosen], self.run_of[chosen]
        places = [(int(each), np.flatnonzero(mode == each)) for each in np.unique(mode)]
        return [(columns, self.columns.part(number, runs[columns])) for number, columns in places]

    def derivative(self, y: Array, force: Array, chosen: IndexArray | None = None) -> Array:
        """The derivative of all runs, or of the chosen ones, whose states are y (N, k)."""
        parts = self.parts if chosen is None else self.grouped(chosen)
        if len(parts) == 1:
            return parts[0][1](y, force)
        result = np.empty_like(y)
        for columns, right_hand_side in parts:
            result[:, columns] = right_hand_side(
                y.take(columns, axis=1), force.take(columns, axis=1)
            )
        return result

    def first_steps(self) -> Array:
        """A hundredth of the time in which the state would change by its own size, as SciPy
        begins."""
        scale = self.absolute + np.abs(self.y) * self.relative
        size, speed = (np.sqrt(np.square(a / scale).mean(axis=0)) for a in (self.y, self.f))
        h = np.where(
            (size < 1e-5) | (speed < 1e-5), 1e-6, 0.01 * size / np.where(speed == 0, 1.0, speed)
        )
        return np.minimum(np.where(np.isfinite(h), h, 1e-6), self.horizon)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stack:
    """Calm runs as columns: h(e) - K e + C eps, e (n m, R) and a leader, eps (n, q, R);
    ``networks``: right-hand sides by mode."""

    loop: Loop
    networks: Callable[[int], Network]
    closed: ClosedForm | None
    e: Array
    eps: Array
    switches: tuple[Array, IndexArray]

    def part(self, mode: int, runs: IndexArray) -> RightHandSide:
        network = self.networks(mode)

        def derivative(e: Array, force: Array) -> Array:
            result = network(e)
            result[: len(force)] += force
            return result

        return derivative

    def forces(self, times: Array, runs: IndexArray) -> Array:
        if self.closed is None:
            return np.zeros((len(times), 0, len(runs)))
        states, weights = self.eps.take(runs, axis=2), np.moveaxis(self.closed.many(times), 2, 0)
        total = np.zeros((len(weights), len(states), weights.shape[1], weights.shape[3]))
        for k in range(states.shape[1]):
            total += states[:, k, None, :] * weights[:, None, :, k]
        return total.reshape(len(times), self.loop.n * self.loop.m, len(runs))

    def size(self, y: Array) -> Array:
        return np.asarray(np.abs(y[: self.loop.n * self.loop.m]).max(axis=0, initial=0.0))

    def switched(self, runs: IndexArray, modes: IndexArray) -> None:
        """Nothing is kept from one mode to the next."""

    def integrate(self, times: Array, *, tolerance: float, visit: Visit, most: int = 0) -> Ends:
        """Integrate all runs over ``times`` from 0; ``visit`` gets places of samples and runs (k,),
        and e (n m, k)."""
        runs = np.arange(self.e.shape[1])
        visit(np.zeros_like(runs), runs, self.e)
        stretch = Stretch(
            self,
            self.e,
            times,
            begin=0.0,
            end=float(times[-1]),
            farthest=FARTHEST * np.maximum(1.0, self.size(self.e)),
            switches=self.switches,
            most=most or MOST_STEPS,
            tolerance=tolerance,
            visit=visit,
        )
        return stretch.run()
