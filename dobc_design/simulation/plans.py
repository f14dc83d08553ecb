"""What is integrated between switches: the errors alone, or the full loop; modes by schedule, or by the state."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from dobc_design.problem.arrays import ArcGroup
from dobc_design.problem.problem import Problem
from dobc_design.simulation.closed_form import ClosedForm
from dobc_design.simulation.field import Loop, field_of, network_of
from dobc_design.simulation.integrate import Segment
from dobc_design.simulation.mobile import LOOKS, Mobile, Record, first_change, groups_of, near
from dobc_design.simulation.switches import Switches

Array = NDArray[np.float64]
IndexArray = NDArray[np.int64]


class Errors:
    """State e, flat (n m,); the observer's error is known in closed form (22)."""

    def __init__(self, loop: Loop, closed: ClosedForm | None, eps0: Array) -> None:
        self.loop, self.closed, self.eps0 = loop, closed, eps0

    def make(self, groups: Sequence[ArcGroup]) -> Segment:
        """The derivative on these arcs; its end is set by the plan."""
        network, closed, eps0 = network_of(self.loop, groups), self.closed, self.eps0
        shape = (self.loop.n, self.loop.m)

        def derivative(time: float, e: Array) -> Array:
            result = network(e)
            if closed is not None:
                result.reshape(shape)[...] += eps0 @ closed.at(time).T
            return result

        return Segment(derivative=derivative, end=np.inf, system=network)

    def error(self, state: Array) -> float:
        """|e|_inf."""
        return float(np.abs(state).max())

    def positions(self, state: Array) -> Array:
        """x (n, m)."""
        return state.reshape(self.loop.n, self.loop.m) + self.loop.goal


class Full:
    """State [x; xi; z]: the loop as printed, the reference."""

    def __init__(self, loop: Loop) -> None:
        self.loop = loop

    def make(self, groups: Sequence[ArcGroup]) -> Segment:
        """The derivative on these arcs; its end is set by the plan."""
        whole = field_of(self.loop, groups)
        return Segment(derivative=whole, end=np.inf, system=whole)

    def error(self, state: Array) -> float:
        """|e|_inf."""
        return float(np.abs(self.positions(state) - self.loop.goal).max())

    def positions(self, state: Array) -> Array:
        """x (n, m)."""
        return self.loop.split(state)[0]


class Scheduled:
    """Modes that are known beforehand; ``groups`` gives the arcs of a mode by its index."""

    def __init__(
        self, system: Errors | Full, switches: Switches, groups: Callable[[int], Sequence[ArcGroup]], horizon: float
    ) -> None:
        self.system, self.switches, self.groups, self.horizon = system, switches, groups, horizon
        self.made: dict[int, Segment] = {}
        self.error = system.error

    def segment(self, time: float, state: Array) -> Segment:
        """The stretch that begins here."""
        place = int(np.searchsorted(self.switches.times, time, side="right"))
        mode = int(self.switches.modes[place - 1])
        if mode not in self.made:
            self.made[mode] = self.system.make(self.groups(mode))
        end = float(self.switches.times[place]) if place < len(self.switches) else self.horizon
        made = self.made[mode]
        return Segment(derivative=made.derivative, end=end, system=made.system)


class Moving:
    """The graph follows from the states; an instant of switching is found to the last bit of the step's polynomial."""

    def __init__(self, system: Errors | Full, signal: Mobile, problem: Problem, horizon: float) -> None:
        self.system, self.signal, self.problem, self.horizon = system, signal, problem, horizon
        self.record = Record(problem.n)
        self.now: IndexArray | None = None
        self.made: dict[int, Segment] = {}
        self.error = system.error

    def segment(self, time: float, state: Array) -> Segment:
        """The stretch that begins here, with the graph of these positions."""
        graph = near(self.signal, self.system.positions(state), self.now)
        if self.now is None or not np.array_equal(graph, self.now):
            self.now = graph
            self.number = self.record.add(time, graph)
            if self.number not in self.made:
                self.made[self.number] = self.system.make(groups_of(self.problem, graph))
        made = self.made[self.number]
        return Segment(derivative=made.derivative, end=self.horizon, system=made.system, change=self.change)

    def change(self, begin: float, end: float, state_at: Callable[[float], Array]) -> float | None:
        """The first instant of the step at which the graph is another one."""
        now = self.now
        if now is None:
            return None

        def graph_at(time: float) -> IndexArray:
            return near(self.signal, self.system.positions(state_at(time)), now)

        return first_change(graph_at, now, np.linspace(begin, end, LOOKS + 1))
