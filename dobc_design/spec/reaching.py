"""Which agents hear a pinned agent, directly or through others: breadth first, linear in the arcs.

Exact, hence also the ground of the reachability verdict.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from dobc_design.spec.arcs import Arcs
from dobc_design.spec.problem import Problem


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
