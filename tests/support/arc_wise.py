"""Arc-wise certificates of problems, and V' along their agents written out in NumPy."""

from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any

import numpy as np
from networks import float_gains

from dobc_design import Check, Network, Problem
from dobc_design.conditions.arcs.claim import ArcWise, form_of
from dobc_design.conditions.arcs.stage import arcs_stage
from dobc_design.conditions.coverage import read_region
from dobc_design.conditions.domain import NEAR_TARGET
from dobc_design.exact.matrix import Matrix
from dobc_design.loop.loop import Loop
from dobc_design.loop.make import loop_of
from dobc_design.loop.pairs import rows_of

ONE = [[1, 2], [2, 1], [2, 3], [3, 2], [3, 4], [4, 3]]
OTHER = [[1, 4], [4, 1], [4, 3], [3, 4], [3, 2], [2, 3]]


def rows(radius: str | None = "4/5", **more: Any) -> Problem:
    """Four agents in a row; two change places, so that no common box exists."""
    network = Network.from_arcs({"one": ONE, "other": OTHER}, arrow="listens_to")
    region = None if radius is None else {"initial_states": [f"-{radius}", radius]}
    return Problem(
        network=network, coupling="sin(y)", gains={1: 3}, target=0, region=region, **more
    )


def searched(problem: Problem, W: Matrix | None = None) -> Check:
    """The check of the stage alone: of the box asked for, else of the largest ball."""
    loop = rows_of(loop_of(problem), W)
    assert loop is not None
    asked = read_region(loop, W, domain=NEAR_TARGET, everything=True)
    (check,) = arcs_stage(asked, lambda text: None)
    return check


def radius_of(check: Check) -> float:
    """Of a proved domain."""
    assert check.is_proved, check.reason
    return float(check.domain.radius)


def claimed(
    loop: Loop, a: Sequence[Any], b: Sequence[Any], *, level: Any, rate: Any, d: Any = None
) -> ArcWise:
    """A claim about a loop with one mode, without observers."""
    (mode,) = loop.modes
    weights = tuple(map(Fraction, d or [1] * loop.n))
    return ArcWise(
        P_e=form_of(loop, weights),
        d=weights,
        a={mode: tuple(map(Fraction, a))},
        b={mode: tuple(map(Fraction, b))},
        level=Fraction(level),
        rate=Fraction(rate),
    )


Motion = Callable[[np.ndarray], np.ndarray]


def motion(problem: Problem, mode: str) -> Motion:
    """e' of rows of errors, (..., n); one component, target at rest, no exosystem, linear pins."""
    n = problem.n
    gains = float_gains(problem)
    arcs = []
    for i, j, w in problem.network.modes[mode]:
        arcs.append((i, j, float(w), problem.coupling_of(i, j).numpy_function()))

    def moved(e: np.ndarray) -> np.ndarray:
        rows = e.reshape(-1, n)
        total = -gains * rows
        for i, j, w, h in arcs:
            total[:, i] += w * h((rows[:, j] - rows[:, i])[:, None])[:, 0]
        return total.reshape(e.shape)

    return moved


def on_the_boundary(d: Any, level: float, count: int, rng: np.random.Generator) -> np.ndarray:
    """Starts with sum d_i e_i^2 = level, (count, n): half in random directions, half of few
    agents."""
    d = np.array([float(x) for x in d])
    e = rng.standard_normal((count, len(d)))
    few = rng.random(e.shape) < min(1.0, 2.5 / len(d))
    few[np.arange(count), rng.integers(len(d), size=count)] = True
    e[1::2] *= few[1::2]
    return e * np.sqrt(level / np.sum(d * e * e, axis=1))[:, None]
