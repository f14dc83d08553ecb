"""Which agents hear a pinned agent, directly or through others: breadth first, linear in the arcs.

Exact, hence also the ground of the reachability verdict.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from dobc_design.problem.network import Arcs
from dobc_design.problem.problem import Problem


def unreached(problem: Problem, arcs: Iterable[Arcs]) -> tuple[int, ...]:
    """Agents to which no information flows from a pinned agent along the arcs of all given modes together."""
    chosen = list(arcs)
    speakers = np.concatenate([a.speakers for a in chosen]) if chosen else np.zeros(0, dtype=np.int64)
    listeners = np.concatenate([a.listeners for a in chosen]) if chosen else np.zeros(0, dtype=np.int64)
    order = np.argsort(speakers, kind="stable")
    heard_by = listeners[order].tolist()
    start = np.searchsorted(speakers[order], np.arange(problem.n + 1)).tolist()
    reached = [False] * problem.n
    stack = list(problem.pinning.agents)
    for agent in stack:
        reached[agent] = True
    while stack:
        agent = stack.pop()
        for listener in heard_by[start[agent] : start[agent + 1]]:
            if not reached[listener]:
                reached[listener] = True
                stack.append(listener)
    return tuple(i for i, yes in enumerate(reached) if not yes)


def unreached_in_union(problem: Problem) -> tuple[int, ...]:
    """Agents that no pinned agent reaches even when the arcs of all modes are put together."""
    return unreached(problem, problem.network.modes.values())


def closed_groups(problem: Problem, arcs: Iterable[Arcs]) -> tuple[tuple[int, ...], ...]:
    """The smallest sets of agents that listen to nobody outside themselves, all given modes together.

    They are the strongly connected components without an arc to another one (Tarjan's algorithm, without
    recursion); every set that listens to nobody outside contains one.
    """
    hears: list[list[int]] = [[] for _ in range(problem.n)]
    for each in arcs:
        for listener, speaker in zip(each.listeners.tolist(), each.speakers.tolist(), strict=True):
            hears[listener].append(speaker)
    number, low = [-1] * problem.n, [0] * problem.n
    group = [-1] * problem.n
    found: list[list[int]] = []
    path: list[int] = []
    count = 0
    for root in range(problem.n):
        work = [(root, 0)] if number[root] < 0 else []
        while work:
            agent, place = work.pop()
            if place == 0:
                number[agent] = low[agent] = count
                count += 1
                path.append(agent)
            for position in range(place, len(hears[agent])):
                other = hears[agent][position]
                if number[other] < 0:
                    work += [(agent, position + 1), (other, 0)]
                    break
                if group[other] < 0:
                    low[agent] = min(low[agent], number[other])
            else:
                if work:
                    parent = work[-1][0]
                    low[parent] = min(low[parent], low[agent])
                if low[agent] == number[agent]:
                    members: list[int] = []
                    while not members or members[-1] != agent:
                        members.append(path.pop())
                        group[members[-1]] = len(found)
                    found.append(members)
    return tuple(
        tuple(sorted(members))
        for place, members in enumerate(found)
        if all(group[other] == place for agent in members for other in hears[agent])
    )
