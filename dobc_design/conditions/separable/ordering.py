"""Does one v serve all modes?  For monotone couplings an order of the agents decides it, in time linear in the arcs.

Theory, section 5: let every h be nondecreasing with a secant gain bounded away from 0 on bounded sets.  A common v
exists for every radius iff the agents can be ordered so that in every mode each agent is pinned or hears an earlier
one.  Greedy ordering decides; where it gets stuck, the agents that remain are the witness.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dobc_design.conditions.separable.claim import holding_gains
from dobc_design.problem.problem import Problem


@dataclass(frozen=True, slots=True, kw_only=True)
class Ordering:
    """An order of all agents (indices; several may stand in one rank), or the agents that are stuck.

    ``ranks``: rank of every agent from 0, empty if stuck.  ``stuck``: every agent of this set has a mode in which
    it is not held by its pin and hears nobody outside the set; ``blocking`` names one such mode for each.
    Then no rows with alpha > 0 hold for any v > 0, whatever the couplings: take the agent of the set with the least v.
    """

    ranks: tuple[int, ...]
    stuck: tuple[int, ...]
    blocking: tuple[str, ...]

    @property
    def exists(self) -> bool:
        """Whether an order was found."""
        return not self.stuck


def find_ordering(problem: Problem, *, modes: Sequence[str] | None = None) -> Ordering:
    """Order the agents, or find those that are stuck, for the given modes (default: all).

    "Pinned" means that the pin holds the agent in a row: k_cc - sum_{d != c} |k_cd| > 0 for every component c.
    """
    names = list(problem.network.modes if modes is None else modes)
    pinned = [gain > 0 for gain in holding_gains(problem)]
    listeners = [_listeners(problem, name) for name in names]
    waiting = [0 if held else len(names) for held in pinned]  # modes in which nobody earlier is heard yet
    heard: list[set[int]] = [set() for _ in names]
    ranks = [-1] * problem.n
    front = [agent for agent, count in enumerate(waiting) if not count]
    rank = 0
    while front:
        for agent in front:
            ranks[agent] = rank
        following: list[int] = []
        for number, (start, listener) in enumerate(listeners):
            for agent in front:
                for other in listener[start[agent] : start[agent + 1]]:
                    if ranks[other] < 0 and other not in heard[number]:
                        heard[number].add(other)
                        waiting[other] -= 1
                        if not waiting[other]:
                            following.append(other)
        front, rank = following, rank + 1
    stuck = tuple(agent for agent, place in enumerate(ranks) if place < 0)
    blocking = tuple(next(name for number, name in enumerate(names) if agent not in heard[number]) for agent in stuck)
    return Ordering(ranks=() if stuck else tuple(ranks), stuck=stuck, blocking=blocking)


def is_stuck(problem: Problem, agents: Sequence[int], *, modes: Sequence[str] | None = None) -> bool:
    """Whether every one of these agents has a mode in which it is not pinned and hears nobody outside them."""
    group = set(agents)
    gains = holding_gains(problem)
    open_agents = {agent for agent in group if gains[agent] <= 0}
    free: set[int] = set()
    for name in problem.network.modes if modes is None else modes:
        outside = {i for i, j, _ in problem.network.modes[name] if j not in group}
        free |= open_agents - outside
    return bool(group) and free == group


def _listeners(problem: Problem, mode: str) -> tuple[list[int], list[int]]:
    """Who listens to each agent: agent j is heard by listener[start[j]:start[j + 1]]."""
    arcs = problem.network.modes[mode]
    order = np.argsort(arcs.speakers, kind="stable")
    start = np.searchsorted(arcs.speakers[order], np.arange(problem.n + 1))
    return start.tolist(), arcs.listeners[order].tolist()
