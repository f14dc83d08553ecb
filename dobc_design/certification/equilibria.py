"""The stage of the equilibria: is there one other than the target in the region asked for?

Rough runs from the region say where to look, ``conditions/equilibrium/`` proves.  That none is
found says nothing.
"""

from collections.abc import Iterator
from contextlib import suppress

import numpy as np

from dobc_design.conditions.check import Check, surviving
from dobc_design.conditions.equilibrium.decide import LARGEST, Equilibrium, refuting_check
from dobc_design.conditions.equilibrium.propose import distance_of, proved_equilibria
from dobc_design.exact.work import STAGE, WorkLimitError, at_most, spend
from dobc_design.loop.arcs import unreached
from dobc_design.loop.arrays import no_gain
from dobc_design.loop.make import loop_of
from dobc_design.problem.problem import Problem
from dobc_design.simulation.starts import CORNERS, RANDOM, asked_box
from dobc_design.simulation.switches import constant_signals
from dobc_design.simulation.trials import (
    Batch,
    Effort,
    make_arena,
    run_starts,
    settling_horizon,
)

STARTS, LEAST_STARTS = 48, 8  # of each kind: shared among the modes at most, in every mode at least
# starts of one kind times rows, or times arcs: a second or so in all
MOST_ROWS, MOST_ARCS = 1500, 60_000
ROUGH = 1e-6  # tolerance of the runs, whose ends are only points to begin with
# most steps of each, and most steps times characters of the couplings
ROUGH_STEPS, ROUGH_WORK = 3000, 600_000
SAMPLES = 21
RUNS_WORK = 5000  # steps of work for the runs of one mode


def equilibrium_check(problem: Problem) -> Check | None:
    """Look for a second equilibrium in the region asked for; the check that refutes, or None, which
    says nothing.  It takes the work of one stage: of very many modes only the first are looked
    at."""
    loop = loop_of(problem)
    known = loop.starts is not None and loop.drift_place is None and not loop.goals.moves
    if not known or loop.size > LARGEST:
        return None
    best = None
    with surviving("the search for equilibria failed"), np.errstate(all="ignore"):
        best = _nearest(problem)
    return None if best is None else refuting_check(loop, best)


def _nearest(problem: Problem) -> Equilibrium | None:
    """The nearest to the target of those that are found before the work ends."""
    found: list[Equilibrium] = []
    with at_most(STAGE), suppress(WorkLimitError):
        for claim in _in_modes(problem):
            found.append(claim)
    return min(found, key=distance_of, default=None)


def _in_modes(problem: Problem) -> Iterator[Equilibrium]:
    """The nearest proved equilibrium of each mode that has one."""
    loop = loop_of(problem)
    arena = make_arena(problem, no_gain(loop))  # eps = 0
    box = asked_box(problem, arena.loop, disturbance=0.0)
    count = _starts_per_mode(problem)
    length = sum(len(text) for function in loop.functions for text in function.texts)
    effort = Effort(
        horizon=settling_horizon(problem),
        tolerance=ROUGH,
        samples=SAMPLES,
        most=max(1, min(ROUGH_STEPS, ROUGH_WORK // length)),
    )
    # The same starts every time: the same problem has the same answer.
    rng = np.random.default_rng(0)
    for number, mode in enumerate(arena.modes):
        # what rests in such a mode is moved by others: no refutation by the contract
        if not loop.may_stay(mode) or unreached(loop, [loop.modes[mode]]):
            continue
        spend(RUNS_WORK)
        drawn = [box.draw(rng, count, kind)[0] for kind in (CORNERS, RANDOM)]
        e = np.concatenate(drawn, axis=1)
        starts = Batch(
            e=e,
            eps=np.zeros((problem.n, problem.q, 2 * count)),
            switches=constant_signals(np.full(2 * count, number)),
        )
        trials = run_starts(arena, starts, effort)
        # Both where runs come to rest and where they begin: an unstable equilibrium draws no run.
        points = [*trials.resting_points, *e.T]
        yield from proved_equilibria(
            loop, mode, points, holds=box.holds, within_region=True, most=1
        )


def _starts_per_mode(problem: Problem) -> int:
    """How many starts of one kind are run in one mode."""
    modes = problem.network.modes.values()
    arcs = sum(map(len, modes))
    shared = min(STARTS, MOST_ROWS // (problem.n * problem.m)) // len(modes)
    return max(LEAST_STARTS, min(shared, MOST_ARCS // max(1, arcs)))
