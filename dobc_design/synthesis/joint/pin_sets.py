"""Which agents to pin, as proposals: small sets first, the most promising of each size first.

Every group that listens to nobody outside gets a pin (without one nothing can work); further pins go where the
region allows the largest rate.  What is left of a network without its pins is compared quickly, by the slowest
direction of J + J', and the best few by the rows of the region itself.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from fractions import Fraction

from dobc_design.conditions.consensus.pinning import Blocks, fastest_rate
from dobc_design.synthesis.pinning.region_gains import RegionSearch
from dobc_design.synthesis.pinning.structure import Structure

LOOKED_AT = ((60, 60), (400, 12), (10**9, 3))  # agents compared quickly in one step, by the size of the network
CLOSER = 4  # of these compared by the rows of the region
EXCHANGES = 120  # quick comparisons spent on exchanges of the first set
ONE_BY_ONE = 4  # pins more than needed that are tried one by one; then twice as many each time
NEARLY = 1.02  # rates that are closer than this do not decide


def pin_sets(
    structure: Structure,
    allowed: Sequence[int],
    *,
    blocks: Blocks | None,
    search: RegionSearch,
    caps: Mapping[int, Fraction],
    most: int,
    one_by_one: bool = False,
) -> Iterator[tuple[int, ...]]:
    """Sets of at most ``most`` allowed agents, growing; each holds the one before it, the last all that are allowed.

    ``one_by_one``: by one agent each time, however many there are.
    """
    quick = _quick(blocks)
    chosen = _exchanged(list(structure.agents), structure, allowed, quick, search, caps)
    yield tuple(sorted(chosen))
    wanted, step = len(chosen), 1
    while len(chosen) < min(most, len(allowed)):
        step = 1 if one_by_one or wanted < len(structure.agents) + ONE_BY_ONE else 2 * step
        wanted = min(wanted + step, most, len(allowed))
        while len(chosen) < wanted:
            chosen.append(_next(chosen, allowed, quick, search, caps))
        yield tuple(sorted(chosen))


def _quick(blocks: Blocks | None) -> Callable[[Sequence[int]], float]:
    known: dict[tuple[int, ...], float] = {}

    def rate(agents: Sequence[int]) -> float:
        key = tuple(sorted(agents))
        if key not in known:
            known[key] = 0.0 if blocks is None else round(fastest_rate(blocks, key), 9)
        return known[key]

    return rate


def _exchanged(
    chosen: list[int],
    structure: Structure,
    allowed: Sequence[int],
    quick: Callable[[Sequence[int]], float],
    search: RegionSearch,
    caps: Mapping[int, Fraction],
) -> list[int]:
    """The first set, each agent replaced by the best that meets the same groups."""
    work = 0
    for place, agent in enumerate(chosen):
        rest = chosen[:place] + chosen[place + 1 :]
        others = [i for i in allowed if i not in rest and _meets([*rest, i], structure)]
        if len(others) > 1 and work + len(others) <= EXCHANGES:
            work += len(others)
            chosen[place] = _best(rest, others, quick, search, caps, first=agent)
    return chosen


def _next(
    chosen: Sequence[int],
    allowed: Sequence[int],
    quick: Callable[[Sequence[int]], float],
    search: RegionSearch,
    caps: Mapping[int, Fraction],
) -> int:
    left = [i for i in allowed if i not in chosen]
    v = search.holds(chosen, caps, 0.0, coarse=True)
    if v is not None:  # whoever is held least has the largest v
        left.sort(key=lambda i: (-float(v[i]), i))
    size = next(count for most, count in LOOKED_AT if search.problem.n <= most)
    return _best(chosen, left[:size], quick, search, caps, first=left[0])


def _best(
    rest: Sequence[int],
    others: Sequence[int],
    quick: Callable[[Sequence[int]], float],
    search: RegionSearch,
    caps: Mapping[int, Fraction],
    *,
    first: int,
) -> int:
    order = sorted(others, key=lambda i: (-quick([*rest, i]), i))
    best, rate = (first if first in others else order[0]), 0.0
    close = order[:CLOSER] if first in order[:CLOSER] else [first, *order[: CLOSER - 1]]
    for agent in sorted(set(close) & set(others), key=order.index):
        found = search.fastest([*rest, agent], caps, coarse=True)
        if found > rate * NEARLY:
            best, rate = agent, found
    return best


def _meets(chosen: Sequence[int], structure: Structure) -> bool:
    return all(set(group) & set(chosen) for group in structure.groups)
