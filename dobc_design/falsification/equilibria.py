"""Second equilibria inside the region asked for: searched in floating point, proved in ``verify``.

This is what lets ``certify`` refute a region that is too large: one proved equilibrium other than the target in it.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dobc_design.conditions.check import Check
from dobc_design.conditions.equilibrium.claim import LARGEST, Equilibrium
from dobc_design.conditions.equilibrium.decide import enclose_equilibrium, refuting_check
from dobc_design.falsification.newton import find_roots
from dobc_design.falsification.running import constant_signals, make_arena, run_starts, settling_horizon
from dobc_design.falsification.starts import CORNERS, RANDOM, StartSet, asked_box
from dobc_design.problem.arrays import no_gain
from dobc_design.problem.problem import Problem

Array = NDArray[np.float64]

logger = logging.getLogger("dobc_design")
STARTS, LEAST_STARTS = 48, 8  # of each kind: shared among the modes at most, in every mode at least
MOST_ROWS, MOST_ARCS = 1500, 60_000  # starts of one kind times rows, or times arcs: a second or so in all
MOST_PROVED = 4  # roots of one mode for which a proof is tried, the nearest to the target first
TOLERANCE = 1e-6  # of the runs, whose ends are only points to begin with
SAMPLES = 21


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
