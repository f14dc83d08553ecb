"""Runs of agents whose outputs are measured (``loop.outputs``), in the full loop: zhat = (xhat,
xihat) stands in place of z, and (x at first, xi) in place of xi; of that only xi moves.
"""

from dataclasses import replace

import numpy as np

from dobc_design.exact.matrix import Array
from dobc_design.loop.arrays import Sensed

from .field import ClosedLoop, act


def moved(sensed: Sensed, z: Array, pushed: Array, e: Array) -> Array:
    """zhat' or the next zhat, less the goal as errors e of states are: what moves x is known."""
    missed = e - act(sensed.x, z)
    return act(sensed.pairs.A, z) + act(sensed.entry, pushed) + act(sensed.gain, missed)


def with_disturbances(loop: ClosedLoop) -> ClosedLoop:
    """The loop with the exosystem itself in place of the observer's error."""
    sensed = loop.sensed
    plant = loop.plant
    if sensed is None or plant is None:
        return loop
    A = np.zeros_like(loop.A)
    A[loop.of_xi] = sensed.pairs.A[loop.of_xi]
    return replace(loop, A=A, C=plant.B @ sensed.d, plant=replace(plant, C=sensed.d))
