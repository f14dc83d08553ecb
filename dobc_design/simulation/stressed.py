"""The full loop under a stress in continuous time: what ``plans`` integrate, with restarts at every exchange.

The state is [x; xi; z] as in ``field``.  Between two exchanges everything is smooth but for saturation, which the step
size control deals with.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from dobc_design.problem.arrays import ArcGroup
from dobc_design.simulation.agents import Agents, Outcome
from dobc_design.simulation.air import Links
from dobc_design.simulation.field import Loop, full_pattern
from dobc_design.simulation.integrate import Progress, Segment, integrate
from dobc_design.simulation.plans import Full, Moving, Scheduled
from dobc_design.simulation.starts import Start
from dobc_design.simulation.switches import Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Part:
    """One graph of the stressed loop."""

    loop: Loop
    links: Links

    @property
    def pattern(self) -> sp.csr_array:
        """Which derivative may depend on which state."""
        return full_pattern(self.loop, self.links.groups)


class Stressed(Full):
    """The loop as printed, with what ``agents`` make of it."""

    def __init__(self, loop: Loop, agents: Agents) -> None:
        super().__init__(loop)
        self.agents = agents

    def make(self, groups: Sequence[ArcGroup]) -> Segment:
        """The derivative on these arcs; its end is set by the plan."""
        loop, agents = self.loop, self.agents
        links = Links(groups, loop.n, loop.m)

        def derivative(time: float, state: Array) -> Array:
            _, xi, _ = loop.split(state)
            e, xihat = self.known(state)
            u = agents.control(e, xihat @ loop.C.T)
            felt = links.felt(e, agents.heard(links, e)) + u
            z_dot = xihat @ loop.F.T - loop.correction(felt)
            x_dot = felt + xi @ loop.C.T
            if agents.stress.disturbance:
                x_dot = x_dot + agents.extra(time)
            return np.concatenate([x_dot.ravel(), (xi @ loop.A.T).ravel(), z_dot.ravel()])

        return Segment(derivative=derivative, end=np.inf, system=Part(loop=loop, links=links))

    def known(self, state: Array) -> tuple[Array, Array]:
        """What the agents know at a state: measured errors (n, m) and xihat (n, q)."""
        x, _, z = self.loop.split(state)
        measured = x + self.agents.noise
        return measured - self.loop.goal, z + self.loop.correction(measured)


class Interrupted:
    """A plan that also stops at exchanges and failures, and lets them happen there."""

    def __init__(self, plan: Scheduled | Moving, system: Stressed) -> None:
        self.plan, self.system, self.agents = plan, system, system.agents
        self.error = system.error
        self.spacing, self.count = self.agents.stress.draws, 0
        self.failures = sorted(failure.time for failure in self.agents.failing.values())

    def segment(self, time: float, state: Array) -> Segment:
        """The stretch that begins here, up to the next switch, exchange or failure."""
        agents, base = self.agents, self.plan.segment(time, state)
        due = self.spacing is not None and self.count * self.spacing <= time
        if due:
            agents.measure(time)
        e, xihat = self.system.known(state)
        agents.fail(time, e, xihat @ self.system.loop.C.T)
        if agents.stress.exchanges is not None and isinstance(base.system, Part):
            if due:
                agents.air.exchange(base.system.links, agents.spoken(e))
            agents.air.tune(base.system.links)
        end = min([base.end, *(each for each in self.failures if each > time)])
        if self.spacing is not None:
            while self.count * self.spacing <= time:
                self.count += 1
            end = min(end, self.count * self.spacing)
        return Segment(derivative=base.derivative, end=end, system=base.system, change=base.change)


def run_continuously(
    plan: Scheduled | Moving,
    system: Stressed,
    start: Start,
    times: Array,
    *,
    tolerance: float,
    implicit: bool,
    progress: Progress | None = None,
) -> Outcome:
    """Integrate ``plan``, whose parts ``system`` made, and put down what happened at ``times``."""
    loop, agents = system.loop, system.agents
    z = start.xihat - loop.correction(start.x)
    flat = np.concatenate([start.x.ravel(), start.xi.ravel(), z.ravel()])
    run = integrate(Interrupted(plan, system), flat, times, tolerance=tolerance, implicit=implicit, progress=progress)
    x, xi, z = (part.copy() for part in loop.split(run.states))
    measured = x + agents.noise_at(run.times)
    xihat = z + loop.correction(measured)
    dhat = xihat @ loop.C.T if agents.heeds else np.zeros_like(x)
    return Outcome(
        times=run.times,
        x=x,
        xi=xi,
        xihat=xihat if agents.heeds else np.zeros_like(xihat),
        dhat=dhat,
        u=agents.applied(run.times, measured - loop.goal, dhat),
        reason=run.reason,
        method=run.method,
        evaluations=run.evaluations,
        notes=tuple(run.notes),
    )
