"""Where the fixed nodes of a network are while a run goes on, relative to the middle of the box
that they never leave."""

from collections.abc import Callable

import numpy as np

from dobc_design._checks import noun
from dobc_design.exact.matrix import Array, to_float
from dobc_design.problem.fixed import hull, resting
from dobc_design.problem.problem import Problem

MOTION = (
    "The fixed nodes that move go to and fro between their bounds: as sines in runs with an even "
    "seed, in jumps with an odd one."
)
ROUNDS = 5  # of the first node that moves, in the time of a run; each further one has one more


@noun(eq=False)
class FixedNodes:
    """``middle`` (m,) of the box, and ``slack`` (m,), half of its sides: states in it have no
    error.  ``at``: where the nodes are at a time, (F, m), less the middle; ``moves``: whether that
    depends on it."""

    middle: Array
    slack: Array
    at: Callable[[float], Array]
    moves: bool


def fixed_nodes(problem: Problem, *, horizon: float, seed: int) -> FixedNodes | None:
    """The fixed nodes in the run of one seed; None where agents are not to end between them.  Those
    that move go to and fro between their bounds: with an even seed as a sine, with an odd one they
    jump."""
    if problem.goal != "containment":
        return None
    low, high = to_float(hull(problem.fixed)).T
    middle = (low + high) / 2
    places = np.array([to_float(place) for place in problem.fixed.values()])
    centres = places.mean(axis=2) - middle
    sizes = (places[..., 1] - places[..., 0]) / 2
    moving = [i for i, place in enumerate(problem.fixed.values()) if resting(place) is None]
    rounds = np.zeros(len(places))
    rounds[moving] = ROUNDS + np.arange(len(moving))
    jumps = seed % 2 == 1

    def at(time: float) -> Array:
        waves = np.sin(2 * np.pi * rounds * time / horizon)
        if jumps:
            waves = np.where(waves < 0, -1.0, 1.0)
        return np.asarray(centres + sizes * waves[:, None])

    return FixedNodes(
        middle=middle,
        slack=(high - low) / 2,
        at=at,
        moves=bool(moving),
    )
