"""What agents measure, say and command under a stress: shared by the continuous and the sampled loop.

Random numbers come from streams of their own, so that noise, losses and phases do not depend on each other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dobc_design.simulation.air import Air, Links
from dobc_design.simulation.field import Loop
from dobc_design.simulation.stress import Failure, Stress
from dobc_design.simulation.switches import Array

NOISE, LOSS, PHASE = 2, 3, 4  # streams beside that of the switches


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Outcome:
    """A run under a stress at the times it got to, (T, n, ...); ``reason`` says why it ended early."""

    times: Array
    x: Array
    xi: Array
    xihat: Array
    dhat: Array
    u: Array
    reason: str
    method: str
    evaluations: int
    notes: tuple[str, ...] = ()


class Agents:
    """All agents of one run.  ``heeds`` says whether the estimate is used at all.

    Errors e are measured ones, (n, m): x plus noise, less the goal.
    """

    def __init__(self, loop: Loop, stress: Stress, failing: dict[int, Failure], *, seed: int, heeds: bool) -> None:
        self.loop, self.stress, self.failing, self.heeds = loop, stress, failing, heeds
        self.rng = np.random.default_rng([seed, NOISE])
        self.air = Air(loop.m, stress.loss, np.random.default_rng([seed, LOSS]))
        self.phase = np.random.default_rng([seed, PHASE]).uniform(0, 2 * np.pi, size=(loop.n, loop.m))
        self.noise = np.zeros((loop.n, loop.m))
        self.stopped: dict[int, tuple[Array, Array]] = {}  # what a failed agent commands and says from then on
        self.noise_times: list[float] = []
        self.noises: list[Array] = []

    def measure(self, time: float) -> None:
        """Draw the noise that holds from now on."""
        if self.stress.noise:
            self.noise = self.stress.noise * self.rng.standard_normal(self.noise.shape)
            self.noise_times.append(time)
            self.noises.append(self.noise)

    def noise_at(self, times: Array) -> Array:
        """The noise at each of the times, (T, n, m)."""
        if not self.noises:
            return np.zeros((len(times), *self.noise.shape))
        return np.asarray(np.stack(self.noises)[np.searchsorted(self.noise_times, times, side="right") - 1])

    def fail(self, time: float, e: Array, dhat: Array) -> None:
        """Note what is left of the agents whose time has come."""
        due = [i for i, failure in self.failing.items() if failure.time <= time and i not in self.stopped]
        if not due:
            return
        u = self.control(e, dhat)
        for i in due:
            frozen = self.failing[i].kind == "freeze"
            nothing = np.zeros(self.loop.m)
            self.stopped[i] = (u[i].copy(), e[i].copy()) if frozen else (nothing, nothing + np.nan)

    def spoken(self, e: Array) -> Array:
        """What the others can hear: measured errors, old ones of frozen agents, nan of vanished ones."""
        if not self.stopped:
            return e
        said = e.copy()
        for i, (_, last) in self.stopped.items():
            said[i] = last
        return said

    def heard(self, links: Links, e: Array) -> Array:
        """What arrives on every arc, (arcs, m)."""
        if self.stress.exchanges is None:
            return np.asarray(self.spoken(e)[links.speakers])
        return self.air.values

    def control(self, e: Array, dhat: Array) -> Array:
        """The input that is applied, (19) and what the stress makes of it."""
        u: Array = self.loop.control(e, dhat if self.heeds else np.zeros_like(dhat))
        if self.stress.saturation is not None:
            u = np.asarray(np.clip(u, -self.stress.saturation, self.stress.saturation))
        for i, (last, _) in self.stopped.items():
            u[i] = last
        return u

    def applied(self, times: Array, e: Array, dhat: Array) -> Array:
        """The input at many samples; e and dhat (T, n, m)."""
        u = self.loop.control(e, dhat if self.heeds else np.zeros_like(dhat))
        if self.stress.saturation is not None:
            u = np.asarray(np.clip(u, -self.stress.saturation, self.stress.saturation))
        for i, (last, _) in self.stopped.items():
            u[times >= self.failing[i].time, i] = last
        return u

    def extra(self, time: float | Array) -> Array:
        """The disturbance that no exosystem knows: (n, m), or (T, n, m) for many times."""
        when = np.asarray(time, dtype=np.float64)[..., None, None]
        return np.asarray(self.stress.disturbance * np.sin(self.stress.frequency * when + self.phase))

    def extra_integral(self, begin: float, end: Array) -> Array:
        """Its integral from ``begin`` to each of ``end`` (T,): (T, n, m)."""
        omega, when = self.stress.frequency, np.asarray(end)[:, None, None]
        half = (when - begin) / 2
        # The mean value times the length: no cancellation where omega is small.
        shrink = np.sinc(omega * half / np.pi)
        return np.asarray(self.stress.disturbance * 2 * half * shrink * np.sin(omega * (begin + half) + self.phase))
