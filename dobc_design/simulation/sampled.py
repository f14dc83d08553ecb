"""The loop with everything computed at the multiples of a period T and held between: solved exactly, step by step.

At k T every agent computes v_k = couplings + input and holds it; between samples x' = v_k + d, which is integrated in
closed form.  The observer is the exact discretisation: with Ad = exp(A T) and the mean output
Cd = C (1/T) int_0^T exp(A s) ds, the measured mean (x_(k+1) - x_k)/T - v_k is Cd xi_k exactly, and

    xihat_(k+1) = Ad xihat_k + L ((x_(k+1) - x_k)/T - v_k - Cd xihat_k),     dhat_k = Cd xihat_k.

So eps_(k+1) = (Ad - L Cd) eps_k, free of the network as (17) is, and the mean of d - dhat over a period is Cd eps_k.
L = int_0^T exp((A - W C) s) ds W, unless it is given.  Between samples d - dhat keeps a ripple that shrinks with T.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from dobc_design.errors import ShapeError, SpecError
from dobc_design.simulation.agents import Agents, Outcome
from dobc_design.simulation.air import Links
from dobc_design.simulation.field import Loop, applied
from dobc_design.simulation.integrate import FARTHEST
from dobc_design.simulation.starts import Start
from dobc_design.simulation.switches import Array

LinksAt = Callable[[float, Array], Links]
Progress = Callable[[float], None]
MOST_SAMPLES = 1_000_000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Discrete:
    """The discretised exosystem and observer.  Shapes: Ad (q, q), Cd (m, q), L (q, m), or (n, q, m)."""

    Ad: Array
    Cd: Array
    L: Array

    @property
    def error(self) -> Array:
        """Ad - L Cd, (q, q), or (n, q, q): the observer's error from one sample to the next."""
        return self.Ad - self.L @ self.Cd


def discretised(loop: Loop, period: float, gain: Array | None = None) -> Discrete:
    """Discretise the observer exactly over ``period`` in s.  Raises: ShapeError for a gain that does not fit."""
    q, m = loop.q, loop.m
    mean = integral(loop.A, period)[1] / period
    if gain is None:
        gain = integral(loop.F, period)[1] @ loop.W
    elif loop.own is not None:
        raise SpecError(
            "sampled_gain is one gain for all agents, and the groups of exosystem.groups have different ones.",
            key="sampled_gain",
            cure="Leave it out: the W of every group is discretised.",
        )
    elif gain.shape != (q, m):
        raise ShapeError(
            f"sampled_gain must have shape ({q}, {m}), one row per exosystem state; got {gain.shape}.",
            key="sampled_gain",
            cure="design_observer(problem, period=...).W has it.",
        )
    return Discrete(Ad=integral(loop.A, period)[0], Cd=loop.C @ mean, L=gain)


def integral(A: Array, times: float | Array) -> tuple[Array, Array]:
    """exp(A t) and its integral from 0 to t, (..., q, q) each (Van Loan 1978)."""
    q = len(A)
    block = np.zeros((2 * q, 2 * q))
    block[:q, :q], block[:q, q:] = A, np.eye(q)
    both = (
        expm(block * np.asarray(times, dtype=np.float64)[..., None, None]) if q else np.zeros((*np.shape(times), 0, 0))
    )
    return both[..., :q, :q], both[..., :q, q:]


def sample_instants(period: float, horizon: float, *, name: str = "period") -> Array:
    """The multiples of ``period``, the argument ``name``, up to the horizon, in s.  Raises: SpecError for too many."""
    count = horizon / period
    if count > MOST_SAMPLES:
        raise SpecError(
            f"{count:.3g} {'samples' if name == 'period' else 'exchanges'} are too many, at most {MOST_SAMPLES} are"
            " simulated.",
            key=name,
            cure=f"Choose a longer {name} or a shorter horizon.",
        )
    instants = period * np.arange(int(count) + 2)
    return np.asarray(instants[instants <= horizon], dtype=np.float64)


def run_sampled(
    loop: Loop, agents: Agents, start: Start, times: Array, links_at: LinksAt, *, progress: Progress | None = None
) -> Outcome:
    """Step from sample to sample and put down the state at ``times`` (from 0 to the horizon).

    ``links_at`` gives the arcs at a sample from its time and x.  Raises: SpecError for too many samples.
    """
    return _Stepper(loop, agents, start, times, links_at, progress or (lambda part: None)).run()


class _Stepper:
    def __init__(
        self, loop: Loop, agents: Agents, start: Start, times: Array, links_at: LinksAt, report: Progress
    ) -> None:
        self.loop, self.agents, self.links_at, self.report = loop, agents, links_at, report
        self.period = float(agents.stress.period or 0.0)
        self.instants = sample_instants(self.period, float(times[-1]))
        gain = agents.stress.sampled_gain
        self.discrete = discretised(loop, self.period, None if gain is None else np.asarray(gain))
        self.times, self.owner = times, np.searchsorted(self.instants, times, side="right") - 1
        self.x, self.xi, self.xihat = start.x.copy(), start.xi.copy(), start.xihat.copy()
        n, m, q, size = loop.n, loop.m, loop.q, len(times)
        self.out = {name: np.empty((size, n, m)) for name in ("x", "u", "dhat")}
        self.out |= {name: np.empty((size, n, q)) for name in ("xi", "xihat")}
        self.before, self.held = start.x, np.zeros((n, m))
        self.farthest = FARTHEST * max(1.0, float(np.abs(start.x - loop.goal).max()))

    def run(self) -> Outcome:
        """From the first sample to the last."""
        transition, mean = integral(self.loop.A, self.times - self.instants[self.owner])
        reason, done = "", 0
        for k, instant in enumerate(self.instants.tolist()):
            felt, u, dhat, measured = self.compute(instant)
            last = int(np.searchsorted(self.owner, k, side="right"))
            here = slice(done, last)
            drift = self.xi @ np.swapaxes(mean[here], 1, 2) @ self.loop.C.T
            offsets = (self.times[here] - instant)[:, None, None]
            self.out["x"][here] = self.x + offsets * (felt + u) + drift + self.extra(instant, self.times[here])
            self.out["xi"][here] = self.xi @ np.swapaxes(transition[here], 1, 2)
            self.out["xihat"][here], self.out["u"][here], self.out["dhat"][here] = self.xihat, u, dhat
            if not np.isfinite(self.out["x"][here]).all():
                reason = f"a coupling overflows or is undefined at t = {instant:.6g} s"
                break
            done = last
            if k + 1 < len(self.instants):
                reason = self.step(felt + u, measured, self.instants[k + 1])
                if reason:
                    break
            if k % 64 == 0:
                self.report(instant / float(self.times[-1]))
        self.report(1.0)
        if done == 0:  # the start itself is there, whatever happens next
            self.out["x"][0] = self.x
        keep = slice(0, max(1, done))
        out = {name: values[keep].copy() for name, values in self.out.items()}
        return Outcome(
            times=self.times[keep].copy(),
            reason=reason,
            method=f"exact steps of {self.period:g} s",
            evaluations=len(self.instants),
            x=out["x"],
            xi=out["xi"],
            xihat=out["xihat"],
            dhat=out["dhat"],
            u=out["u"],
        )

    def compute(self, instant: float) -> tuple[Array, Array, Array, Array]:
        """What is held from this sample on: couplings, input, estimate; and the measured state."""
        agents, links = self.agents, self.links_at(instant, self.x)
        agents.measure(instant)
        measured = self.x + agents.noise
        if instant:
            self.observe(measured)
        e, dhat = measured - self.loop.goal, self.xihat @ self.discrete.Cd.T
        agents.fail(instant, e, dhat)
        agents.air.exchange(links, agents.spoken(e))
        return links.felt(e, agents.air.values), agents.control(e, dhat), dhat, measured

    def observe(self, measured: Array) -> None:
        """xihat at this sample, from the one before."""
        discrete = self.discrete
        mean = (measured - self.before) / self.period - self.held
        innovation = mean - self.xihat @ discrete.Cd.T
        self.xihat = self.xihat @ discrete.Ad.T + applied(discrete.L, innovation)

    def step(self, held: Array, measured: Array, until: float) -> str:
        """Go to the next sample; return why that is impossible, or ""."""
        loop, begin = self.loop, until - self.period
        self.before, self.held = measured, held
        self.x = self.x + self.period * (held + self.xi @ self.discrete.Cd.T) + self.extra(begin, np.array([until]))[0]
        self.xi = self.xi @ self.discrete.Ad.T
        if not np.abs(self.x - loop.goal).max() <= self.farthest:
            return f"|e|_inf exceeded {FARTHEST:.0e} times its start at t = {until:.6g} s"
        return ""

    def extra(self, begin: float, ends: Array) -> Array:
        """What the unmodelled disturbance adds to x."""
        if not self.agents.stress.disturbance:
            return np.zeros((len(ends), self.loop.n, self.loop.m))
        return self.agents.extra_integral(begin, ends)
