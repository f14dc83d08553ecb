"""Designed pinning: the choice of agents and its proved bound against exhaustive search."""

from itertools import combinations
from random import Random

from evidence.row import Row
from networks import digraph

import dobc_design as dd
from dobc_design import Problem, Verdict
from dobc_design.conditions.consensus.pinning import for_rate, network_blocks, smallest_gains
from dobc_design.loop.make import loop_of

AGREE = 1e-6


def choices(count: int, seed: int) -> Row:
    """Networks of at most 12 agents: the agents chosen, their cost and its bound against every
    set."""
    failures = []
    for number in range(count):
        r = Random(seed + number)
        n = r.randint(4, 12)
        problem = digraph(r, n, density=2.5 / n, cycle=False)
        pins = r.randint(1, 3)
        best = _best_of_all(problem, 0.2, pins)
        design = dd.design_pinning(problem, rate="1/5", pins=pins, digits=9, conservative=True)
        if best is None or design.cost is None or design.lower_bound is None:
            if (best is None) is not (design.verdict is Verdict.REFUTED):
                failures.append(
                    f"{seed + number}: {design.verdict.value}, by exhaustive search {best}"
                )
        elif not (best * (1 - AGREE) <= design.lower_bound and design.cost <= best * (1 + AGREE)):
            failures.append(
                f"{seed + number}: cost {float(design.cost):.9g}, by exhaustive search {best:.9g}"
            )
    return Row("agents to pin: as exhaustive search, n to 12, with a proved bound", count, failures)


def _best_of_all(problem: Problem, rate: float, pins: int) -> float | None:
    blocks = for_rate(network_blocks(loop_of(problem)), rate)
    costs = []
    for chosen in combinations(range(problem.n), pins):
        if (gains := smallest_gains(blocks, chosen)) is not None:
            costs.append(float(gains.sum()))
    return min(costs, default=None)
