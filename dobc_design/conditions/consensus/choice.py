"""Which agents to pin besides the present ones: the best single agent, or a small set (theory, section 7).

Gains on a set F can do iff S is positive on the other agents.  Every closed group without a pin needs one; what is
still missing is added greedily, where the slowest direction is heaviest.  Floating point: a proposal.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dobc_design.conditions.consensus.pinning import (
    Blocks,
    fastest_rate,
    looseness,
    lowest_on,
    smallest_gains,
    valid_gains,
)
from dobc_design.conditions.consensus.propose import rows_of
from dobc_design.problem.arrays import closed_groups
from dobc_design.problem.problem import Problem
from dobc_design.solvers.program import Array

CANDIDATES = 200  # agents that are tried one by one, if a try is cheap
FEWEST = 10  # if it is not
LARGE = 500  # agents from which every single try takes a noticeable time
WORK = 10_000_000  # tries times squared size
GREEDY_WORK = 500_000  # looks times squared size of a greedy step
LOOKED_AT = 12  # agents of the slowest direction among which a greedy step chooses, if a look is cheap
NEARLY_ZERO = 1e-9  # relative to the entries of S
ALIKE = 1e-6  # totals that differ by less (relatively) are a tie


@dataclass(frozen=True, slots=True, kw_only=True)
class Single:
    """The best agent to add, and the ``rivals`` that need exactly as little."""

    agent: int
    rivals: tuple[int, ...]


def groups_without_pin(problem: Problem) -> list[tuple[int, ...]]:
    """The smallest sets that listen to nobody outside in one of the modes and hold no pin, each once."""
    pinned = set(problem.pinning.agents)
    found = {
        group: None
        for arcs in problem.network.modes.values()
        for group in closed_groups(problem, [arcs])
        if not pinned & set(group)
    }
    return list(found)


def best_single(
    blocks: Blocks, problem: Problem, *, pins: Sequence[int] = (), progress: Callable[[str], None] | None = None
) -> Single | None:
    """The agent without a pin that, beside ``pins``, needs the smallest total gain; None if no single one can do.

    ``pins``: agents whose gains may be chosen anew; those whose gains stay are part of ``blocks``.
    Where several need no gain at all to speak of (any gain > 0 does), the one that holds the others best.
    """
    totals: dict[int, float] = {}
    candidates = _candidates(blocks, problem)
    for place, agent in enumerate(candidates):
        if progress is not None and place % (1 if problem.n > LARGE else 10) == 0:
            progress(f"looking for the best agent to pin ({place} of {len(candidates)} tried)")
        total = _total(blocks, (*pins, agent))
        if total is not None:
            totals[agent] = total
    if not totals:
        return None
    least = min(totals.values())
    if least <= NEARLY_ZERO * blocks.scale:
        free = [agent for agent, total in totals.items() if total <= NEARLY_ZERO * blocks.scale]
        totals = {agent: looseness(blocks, (*pins, agent)) for agent in free}
        least = min(totals.values())
    alike = [agent for agent, total in totals.items() if total <= least * (1 + ALIKE)]
    return Single(agent=min(alike), rivals=tuple(sorted(alike)[1:]))


def _candidates(blocks: Blocks, problem: Problem) -> list[int]:
    """Agents in every closed group without a pin; of very many those that carry the slowest direction."""
    pins = set(problem.pinning.agents)
    common = set(range(problem.n)) - pins
    for group in groups_without_pin(problem):
        common &= set(group)
    most = _affordable(problem.n)
    if len(common) <= most:
        return sorted(common)
    free = np.array(sorted(set(range(problem.n)) - pins))
    weights = _weights(blocks, free)
    order = free[np.argsort(-np.round(weights / np.max(weights, initial=1e-300), 6), kind="stable")].tolist()
    return [agent for agent in order if agent in common][:most]


def _affordable(size: int) -> int:
    """How many agents to try where each costs one solve of this size."""
    return max(FEWEST, min(CANDIDATES, WORK // max(1, size) ** 2))


def _weights(blocks: Blocks, agents: Array) -> Array:
    """How much each of these agents carries of the slowest direction of the worst block."""
    rows = rows_of(agents, blocks.width)
    vector = min((lowest_on(table, rows) for table in blocks.tables), key=lambda found: found[0])[1]
    weights: Array = np.max(np.abs(vector.reshape(len(agents), blocks.width)), axis=1)
    return weights


def _total(blocks: Blocks, agents: Sequence[int]) -> float | None:
    """The total of gains that suffice: quick, and the least one where there is one Z-matrix."""
    if not blocks.z:
        gains = smallest_gains(blocks, agents)
    else:
        chosen = np.zeros(blocks.agents, dtype=bool)
        chosen[list(agents)] = True
        gains = valid_gains(blocks, chosen, np.ones(blocks.agents))
    return None if gains is None else float(np.sum(gains))


def usual_rate(blocks: Blocks, fastest: float) -> float:
    """A rate (1/s) to ask for where every gain > 0 would do: half of the fastest, or an eighth of the couplings'."""
    if np.isfinite(fastest):
        return fastest / 2
    return blocks.scale / 8 if blocks.scale else 1.0


def small_set(blocks: Blocks, problem: Problem, *, progress: Callable[[str], None] | None = None) -> tuple[int, ...]:
    """Agents to add to the pins so that some gains can do: one of each closed group first, then greedily.

    Never more than are needed of those found: one that can be left out again is left out.
    """
    pins = problem.pinning.agents
    chosen = _one_of_each(blocks, groups_without_pin(problem))
    needed = list(chosen)
    while fastest_rate(blocks, (*pins, *chosen)) <= NEARLY_ZERO * blocks.scale:
        free = np.setdiff1d(np.arange(problem.n), [*pins, *chosen])
        if not len(free):
            break
        if progress is not None:
            progress(f"choosing agents to pin ({len(chosen)} so far)")
        most = max(1, min(LOOKED_AT, GREEDY_WORK // problem.n**2))
        heavy = free[np.argsort(-_weights(blocks, free), kind="stable")][:most].tolist()
        chosen.append(max(heavy, key=lambda agent: fastest_rate(blocks, (*pins, *chosen, agent))))
    for agent in [a for a in chosen if a not in needed]:
        others = [other for other in chosen if other != agent]
        if fastest_rate(blocks, (*pins, *others)) > NEARLY_ZERO * blocks.scale:
            chosen = others
    return tuple(sorted(chosen))


def _one_of_each(blocks: Blocks, groups: Sequence[tuple[int, ...]]) -> list[int]:
    """Agents that hit every group: those in most groups first, among them the one that holds its group best."""
    left = [set(group) for group in groups]
    chosen: list[int] = []
    while left:
        count: dict[int, int] = {}
        for group in left:
            for agent in group:
                count[agent] = count.get(agent, 0) + 1
        most = max(count.values())
        often = sorted(agent for agent, number in count.items() if number == most)
        home = min((group for group in left if group & set(often)), key=lambda group: (len(group), min(group)))
        local = [agent for agent in often if agent in home]
        local = local[: _affordable(len(home))]
        chosen.append(min(local, key=lambda agent: (_loose_inside(blocks, home, agent), agent)))
        left = [group for group in left if chosen[-1] not in group]
    return chosen


def _loose_inside(blocks: Blocks, group: set[int], agent: int) -> float:
    """How loosely the group is held with this agent pinned, about; rounded, so that ties are ties."""
    outside = [other for other in range(blocks.agents) if other not in group]
    value = looseness(blocks, (*outside, agent))
    return value if not np.isfinite(value) or not value else float(f"{value:.9g}")
