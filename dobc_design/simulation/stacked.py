"""Many calm runs side by side: h(e) - K e + C eps, the observer's errors in closed form.

The arcs are shared: all runs in one mode go through one call of its graph.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dobc_design.simulation.closed_form import ClosedForm
from dobc_design.simulation.columns import Ends, RightHandSide, Stretch, Visit, farthest_of, integrate_stretch
from dobc_design.simulation.field import Loop, Network
from dobc_design.simulation.switches import Array, IndexArray

MOST_STEPS = 20_000  # of one run, tried ones included; one that needs more is handed back


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stack:
    """Runs side by side.  Shapes: e (n m, R); eps (n, q, R); switch_times, switch_modes (R, S), padded with inf and 0.

    ``networks`` gives the right-hand side of a mode by its index.
    """

    loop: Loop
    networks: Callable[[int], Network]
    closed: ClosedForm | None
    e: Array
    eps: Array
    switch_times: Array
    switch_modes: IndexArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Calm:
    """h(e) - K e + C eps: the columns of a stack."""

    stack: Stack

    def part(self, mode: int, runs: IndexArray) -> RightHandSide:
        network = self.stack.networks(mode)

        def derivative(e: Array, force: Array) -> Array:
            result = network(e)
            if len(force):
                result += force
            return result

        return derivative

    def forces(self, times: Array, runs: IndexArray) -> Array:
        """C eps."""
        closed, loop = self.stack.closed, self.stack.loop
        if closed is None:
            return np.zeros((len(times), 0, len(runs)))
        total = outputs(closed.many(times), self.stack.eps.take(runs, axis=2))
        return total.reshape(len(times), loop.n * loop.m, len(runs))

    def switched(self, runs: IndexArray, modes: IndexArray) -> None:
        """Nothing is kept from one mode to the next."""


def integrate_stack(stack: Stack, times: Array, *, tolerance: float, visit: Visit) -> Ends:
    """Integrate all runs over ``times`` (from 0 to the horizon).

    ``visit(sample, run, e)`` gets the places of samples and runs, both (k,), and the errors e (n m, k).
    """
    runs = np.arange(stack.e.shape[1])
    visit(np.zeros_like(runs), runs, stack.e)
    stretch = Stretch(
        columns=_Calm(stack=stack),
        begin=0.0,
        end=float(times[-1]),
        e=stack.e,
        farthest=farthest_of(stack.e),
        switch_times=stack.switch_times,
        switch_modes=stack.switch_modes,
        steps=None,
        most=MOST_STEPS,
    )
    return integrate_stretch(stretch, times, tolerance=tolerance, visit=visit)


def outputs(weights: Array, states: Array) -> Array:
    """C exp(F t) as weights (p, q, S, R) times states (n, q, R): (S, n, p, R)."""
    weights = np.moveaxis(weights, 2, 0)
    total = np.zeros((len(weights), len(states), weights.shape[1], weights.shape[3]))
    for k in range(states.shape[1]):
        total += states[:, k, None, :] * weights[:, None, :, k]
    return total
