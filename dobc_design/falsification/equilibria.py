"""Second equilibria inside the region asked for: searched in floating point, proved in ``verify``.

This is what lets ``certify`` refute a region that is too large: one proved equilibrium other than the target in it.
Roots of h(e) - K e: Levenberg and Marquardt's damping around Newton's method, from given points.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from dobc_design.conditions.check import Check
from dobc_design.conditions.equilibrium.claim import LARGEST, Equilibrium
from dobc_design.conditions.equilibrium.decide import enclose_equilibrium, refuting_check
from dobc_design.falsification.starts import (
    CORNERS,
    RANDOM,
    StartSet,
    asked_box,
    constant_signals,
    make_arena,
    run_starts,
    settling_horizon,
)
from dobc_design.model.model import build_model
from dobc_design.problem.arrays import no_gain, pinning_matrix
from dobc_design.problem.problem import Problem
from dobc_design.simulation._arguments import Array

logger = logging.getLogger("dobc_design")
STARTS, LEAST_STARTS = 48, 8  # of each kind: shared among the modes at most, in every mode at least
MOST_ROWS, MOST_ARCS = 1500, 60_000  # starts of one kind times rows, or times arcs: a second or so in all
MOST_PROVED = 4  # roots of one mode for which a proof is tried, the nearest to the target first
TOLERANCE = 1e-6  # of the runs, whose ends are only points to begin with
SAMPLES = 21
STEPS = 60
CLOSE = 1e-11  # |F|_inf of a root, relative to the slopes and to the size of e
AT_TARGET = 1e-4  # |e|_inf below which a root is the target, relative to the farthest point
SAME = 1e-6  # relative distance of roots that are one
MOST_DAMPING = 1e8


def equilibrium_check(problem: Problem, *, seed: int = 0) -> Check | None:
    """Look for a second equilibrium in the region asked for, in every mode; the check that refutes, or None.

    None also without a region, for linear couplings and above 60 rows n m; it never says that there is none.
    Of those proved the one nearest to the target is taken.  The same seed gives the same answer.  A numerical library
    that breaks down costs the answer, never more.
    """
    size = problem.n * problem.m
    if problem.region is None or problem.is_linear or size > LARGEST:
        return None
    try:
        with np.errstate(all="ignore"):
            best = _nearest(problem, seed)
    except (ArithmeticError, RuntimeError, ValueError) as error:
        logger.warning("the search for equilibria failed: %s", error)
        return None
    return None if best is None else refuting_check(problem, best)


def _nearest(problem: Problem, seed: int) -> Equilibrium | None:
    """The nearest proved equilibrium over all modes."""
    arena = make_arena(problem, no_gain(problem))  # eps = 0
    box = asked_box(problem, arena.loop, radius=None, disturbance=0.0)
    rng, count, horizon = np.random.default_rng(seed), _count(problem), settling_horizon(problem)
    best: Equilibrium | None = None
    for number, mode in enumerate(arena.modes):
        e = np.concatenate([box.draw(rng, count, kind)[0] for kind in (CORNERS, RANDOM)], axis=1)
        runs = run_starts(
            arena,
            e,
            np.zeros((problem.n, problem.q, e.shape[1])),
            constant_signals(np.full(e.shape[1], number)),
            horizon=horizon,
            tolerance=TOLERANCE,
            samples=SAMPLES,
        )
        points = [*runs.ends.T[runs.stalled & ~runs.diverged], *e.T]
        for claim in proved_equilibria(problem, mode, points, starts=box, within_region=True, most=1):
            if best is None or _size(claim) < _size(best):
                best = claim
    return best


def proved_equilibria(
    problem: Problem,
    mode: str,
    points: Sequence[Array],
    *,
    starts: StartSet,
    within_region: bool,
    most: int = MOST_PROVED,
) -> list[Equilibrium]:
    """Proved equilibria of one mode that the points lead to, the nearest to the target first.

    Only roots that are starts of the set are looked at, and at most ``most`` are proved.
    """
    roots = [root for root in find_roots(problem, mode, points) if starts.holds(root)]
    roots.sort(key=lambda root: float(np.max(np.abs(root))))
    found: list[Equilibrium] = []
    for root in roots[: max(MOST_PROVED, most)]:
        claim = enclose_equilibrium(problem, mode, root.tolist(), within_region=within_region)
        if claim is not None:
            found.append(claim)
        if len(found) >= most:
            break
    return found


def _count(problem: Problem) -> int:
    """Starts of one kind in one mode."""
    arcs = sum(len(each) for each in problem.network.modes.values())
    shared = min(STARTS, MOST_ROWS // (problem.n * problem.m)) // len(problem.network.modes)
    return max(LEAST_STARTS, min(shared, MOST_ARCS // max(1, arcs)))


def point_of(claim: Equilibrium) -> Array:
    """The middle of the box as floats, (n m,)."""
    return np.array([float(c) for c in claim.middle])


def _size(claim: Equilibrium) -> float:
    return float(np.max(np.abs(point_of(claim))))


class Rest:
    """F(e) = h(e) - K e of one mode and its derivative, from CasADi."""

    def __init__(self, problem: Problem, mode: str) -> None:
        model = build_model(problem, mode, gain=no_gain(problem))  # eps = 0
        self._h, self._jacobian = model.h, model.jacobian
        self._K = np.asarray(pinning_matrix(problem).toarray())

    def value(self, e: Array) -> Array:
        """F(e), (n m,)."""
        return np.asarray(np.asarray(self._h(e)).ravel() - self._K @ e)

    def slope(self, e: Array) -> Array:
        """dF/de, (n m, n m)."""
        found: Any = self._jacobian(e)
        return np.asarray(found.full() - self._K)


def find_roots(problem: Problem, mode: str, points: Sequence[Array]) -> Iterator[Array]:
    """Roots other than the target that the points lead to, each once, as they are found."""
    rest, known = Rest(problem, mode), list[Array]()
    least = AT_TARGET * max((float(np.max(np.abs(point))) for point in points), default=0.0)
    for point in points:
        root = _root(rest, point, least)
        if root is None:
            continue
        if all(np.max(np.abs(root - other)) > SAME * np.max(np.abs(root)) for other in known):
            known.append(root)
            yield root


def _root(rest: Rest, start: Array, least: float) -> Array | None:
    """A root with |e|_inf > ``least``, or None."""
    e, value = start, rest.value(start)
    size, damping = float(np.linalg.norm(value)), 1e-3
    for _ in range(STEPS):
        reach = float(np.max(np.abs(e)))
        if not np.isfinite(size) or reach <= least:
            return None
        J = rest.slope(e)
        if not np.isfinite(J).all():
            return None
        if np.max(np.abs(value)) <= CLOSE * np.abs(J).sum(axis=1).max() * reach:
            return e
        step = _step(J, value, damping * size)
        moved = e - step
        there = rest.value(moved)
        found = float(np.linalg.norm(there))
        if found < size:
            e, value, size, damping = moved, there, found, damping / 5
        elif damping > MOST_DAMPING:
            return None
        else:
            damping *= 5
    return None


def _step(J: Array, value: Array, damping: float) -> Array:
    """(J'J + damping I)^-1 J' value; the damping goes to 0 with the residual, so that the end is Newton's."""
    normal = J.T @ J
    normal[np.diag_indices_from(normal)] += max(damping, 1e-15 * float(np.trace(normal)) / len(normal), 1e-300)
    try:
        return np.asarray(np.linalg.solve(normal, J.T @ value))
    except np.linalg.LinAlgError:
        return np.zeros_like(value)
