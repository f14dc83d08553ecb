"""What agents compute whose outputs are measured (``loop.outputs``): in the full loop zhat = (xhat,
xihat) stands in place of z, and (0, xi) in place of xi.
"""

from dataclasses import replace

import numpy as np

from dobc_design._checks import noun
from dobc_design.loop.arrays import Sensed
from dobc_design.loop.matrices import Array

from .field import ClosedLoop, act


@noun(eq=False)
class Estimates:
    """zhat' = A zhat + entry (couplings + B u) + W (measured - xhat) of every agent, or the next
    zhat."""

    sensed: Sensed
    A: Array
    entry: Array
    B: Array
    W: Array

    def used(self, measured: Array, z: Array) -> Array:
        """The states that couplings and pins act on."""
        return act(self.sensed.x, z) if self.sensed.estimated else measured

    def after(self, z: Array, felt: Array, u: Array, measured: Array) -> Array:
        """zhat' or the next zhat; states in place of what is measured of them."""
        moved = act(self.A, z) + act(self.entry, felt + act(self.B, u))
        return moved + act(self.W, measured - act(self.sensed.x, z))


def estimates_of(loop: ClosedLoop) -> Estimates | None:
    """Those of a loop; None where all states are measured."""
    sensed = loop.sensed
    plant = loop.plant
    if sensed is None or plant is None:
        return None
    return Estimates(
        sensed=sensed,
        A=sensed.pairs.A,
        entry=sensed.x.T * loop.owned[:, :, None],
        B=plant.B,
        W=sensed.pairs.W @ sensed.H,
    )


def with_disturbances(loop: ClosedLoop) -> ClosedLoop:
    """The loop with the exosystem itself in place of the observer's error."""
    sensed = loop.sensed
    plant = loop.plant
    if sensed is None or plant is None:
        return loop
    A = np.zeros_like(loop.A)
    A[loop.of_xi] = sensed.pairs.A[loop.of_xi]
    return replace(loop, A=A, C=plant.B @ sensed.d, plant=replace(plant, C=sensed.d))
