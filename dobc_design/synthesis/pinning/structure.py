"""The structural minimum of pins: every set that listens to nobody outside, in one of the modes, needs one.

Nobody in such a set S pinned means e_S = c is an equilibrium (theory, section 2).  The smallest ones are the source
components of the condensation of each mode; how few agents meet all of them is decided by exhaustive search.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from dobc_design.problem.problem import Problem
from dobc_design.problem.reaching import closed_groups

MOST_STEPS = 50_000  # of the exhaustive search


@dataclass(frozen=True, slots=True, kw_only=True)
class Structure:
    """``groups``: agent indices, each group needs a pin.  ``least``: no fewer allowed agents meet all groups.

    ``exact``: so many do (``agents`` are such); False where the groups overlap in too many ways.  ``apart``: groups
    without a common agent.  ``unmet``: a group without an allowed agent, or None.
    """

    groups: tuple[tuple[int, ...], ...]
    least: int
    exact: bool
    agents: tuple[int, ...]
    apart: tuple[tuple[int, ...], ...]
    unmet: tuple[int, ...] | None


def structure_of(problem: Problem, allowed: Collection[int]) -> Structure:
    """The groups of all modes and the least number of allowed agents that meet them."""
    found: dict[tuple[int, ...], None] = {}
    for arcs in problem.network.modes.values():
        found |= dict.fromkeys(closed_groups(problem, [arcs]))
    groups = tuple(sorted(found, key=lambda group: (len(group), group)))
    free = set(allowed)
    open_ = [frozenset(group) & free for group in groups]
    unmet = next((group for group, left in zip(groups, open_, strict=True) if not left), None)
    apart = tuple(groups[k] for k in _apart(open_))
    if unmet is not None:
        return Structure(groups=groups, least=len(apart), exact=False, agents=(), apart=apart, unmet=unmet)
    agents, exact = _fewest(open_, len(apart))
    least = len(agents) if exact else len(apart)
    return Structure(groups=groups, least=least, exact=exact, agents=agents, apart=apart, unmet=None)


def packing(groups: Sequence[Collection[int]], inside: Collection[int]) -> int:
    """How many further agents at least meet the groups that ``inside`` does not: groups without a common agent."""
    return len(_apart([frozenset(group) for group in groups if not set(group) & set(inside)]))


def _apart(groups: Sequence[Collection[int]]) -> list[int]:
    used: set[int] = set()
    kept = []
    for k in sorted(range(len(groups)), key=lambda k: (len(groups[k]), k)):
        if not used & set(groups[k]):
            used |= set(groups[k])
            kept.append(k)
    return kept


def _fewest(groups: Sequence[frozenset[int]], least: int) -> tuple[tuple[int, ...], bool]:
    """The smallest set that meets all groups, by search in growing size; False if that was given up."""
    if len(_apart(groups)) == len(groups):
        return tuple(sorted(min(group) for group in groups)), True
    steps = [MOST_STEPS]
    for size in range(least, len(groups) + 1):
        found = _of_size(groups, size, steps)
        if steps[0] <= 0:
            return (), False
        if found is not None:
            return tuple(sorted(found)), True
    return (), False


def _of_size(groups: Sequence[frozenset[int]], size: int, steps: list[int]) -> tuple[int, ...] | None:
    steps[0] -= 1
    if not groups:
        return ()
    if steps[0] <= 0 or len(_apart(groups)) > size:
        return None
    smallest: frozenset[int] = min(groups, key=len)
    for agent in sorted(smallest):
        rest = _of_size([group for group in groups if agent not in group], size - 1, steps)
        if rest is not None:
            return (agent, *rest)
    return None
