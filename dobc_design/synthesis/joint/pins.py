"""Which agents to pin in a whole design: few, so that the region allows fast rates.

Of few agents all sets of a size are compared, as with an observer that makes no error.  Of many,
every group that listens to nobody outside gets a pin; further pins go where the region allows the
largest rate, as the slowest direction of J + J' says of many and the rows of the region of the best
few.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations
from math import comb, inf

from dobc_design.conditions.consensus.pinning import fastest_rate, network_blocks
from dobc_design.loop.make import loop_of
from dobc_design.synthesis.pinning.claim import Structure
from dobc_design.synthesis.pinning.propose_regions import RegionSearch

# agents compared quickly in one step, by the size of the network
LOOKED_AT = ((60, 60), (400, 12), (10**9, 3))
CLOSER = 4  # of these compared by the rows of the region
EXCHANGES = 120  # quick comparisons spent on exchanges of the first set
ONE_BY_ONE = 4  # pins more than needed that are tried one by one; then twice as many each time
FEW = 20  # agents of a network in which sets are compared
COMPARED = 2600  # agents times sets of one size that are all looked at
CLOSEST, PROGRAMS = 8, 20  # of these compared by so many linear programs
DECISIVE = 1.02  # rates that are closer than this do not decide


@dataclass(kw_only=True, eq=False)
class PinSets:
    """Growing sets of ``allowed`` agents, each with the one before it, so that the region allows
    fast rates: every group has a pin, then further agents."""

    structure: Structure
    allowed: Sequence[int]
    search: RegionSearch

    def __post_init__(self) -> None:
        self.blocks = network_blocks(loop_of(self.search.problem))
        # Exchanges and further agents ask for the same sets.
        self.quick = cache(self._quick)

    def growing(self, most: int, *, one_by_one: bool = False) -> Iterator[tuple[int, ...]]:
        """Sets of at most ``most`` agents; ``one_by_one``: one agent more."""
        most = min(most, len(self.allowed))
        chosen = self._first()
        yield tuple(sorted(chosen))
        few = len(self.structure.agents) + ONE_BY_ONE
        wanted = len(chosen)
        step = 1
        while len(chosen) < most:
            step = 1 if one_by_one or wanted < few else 2 * step
            wanted = min(wanted + step, most)
            while len(chosen) < wanted:
                chosen.append(self._next(chosen))
            yield tuple(sorted(chosen))

    def best(self, least: int, most: int, rate: float | None) -> Iterator[tuple[int, ...]]:
        """Sets of ``least`` to ``most`` agents, few first: of each size the best that reach the
        ``rate`` (1/s), the cheapest first (None: the fastest first); growing ones where there are
        too many."""
        n = self.search.problem.n
        most = min(most, len(self.allowed))
        size = max(least, len(self.structure.agents))
        while n <= FEW and size <= most and comb(len(self.allowed), size) * n <= COMPARED:
            yield from self._ranked(size, rate)
            size += 1
        if size <= most:
            yield from (each for each in self.growing(most) if len(each) >= size)

    def _ranked(self, size: int, rate: float | None) -> list[tuple[int, ...]]:
        """The best few of all sets of a size that reach the rate: where these do not do, others
        hardly do."""

        def value(agents: tuple[int, ...], programs: int) -> tuple[float, float, tuple[int, ...]]:
            if rate is None:
                worth = -self.search.fastest(agents, coarse=not programs) or inf
            else:
                worth = self.search.cost(agents, rate, programs=programs)
            # What differs by less than the accuracy is alike.
            return float(f"{worth:.3g}"), -self.quick(frozenset(agents)), agents

        every = sorted(value(agents, 0) for agents in combinations(sorted(self.allowed), size))
        possible = [agents for worth, _, agents in every if worth < inf]
        best = sorted(value(agents, PROGRAMS) for agents in possible[:CLOSEST])
        return [agents for _, _, agents in best[:CLOSER]]

    def _quick(self, agents: frozenset[int]) -> float:
        """The fastest rate near the consensus, by the slowest direction."""
        if self.blocks is None:
            return 0.0
        return round(fastest_rate(self.blocks, agents), 9)

    def _first(self) -> list[int]:
        """One agent of each group, each replaced by the best that meets the same groups."""
        chosen = list(self.structure.agents)
        work = 0
        for place, agent in enumerate(chosen):
            rest = chosen[:place] + chosen[place + 1 :]
            missed = [group for group in self.structure.groups if not set(group) & set(rest)]
            others = list[int]()
            for i in self.allowed:
                if i not in rest and all(i in group for group in missed):
                    others.append(i)
            # a choice of one is none; work bounds the time in large networks
            if len(others) > 1 and work + len(others) <= EXCHANGES:
                work += len(others)
                chosen[place] = self._best(rest, others, agent)
        return chosen

    def _next(self, chosen: Sequence[int]) -> int:
        """A further agent: whoever is held least has the largest v."""
        left = [i for i in self.allowed if i not in chosen]
        v = self.search.holds(chosen, 0.0, coarse=True)
        if v is not None:
            held = v.tolist()
            left.sort(key=lambda i: (-held[i], i))
        looked_at = next(count for size, count in LOOKED_AT if self.search.problem.n <= size)
        return self._best(chosen, left[:looked_at], left[0])

    def _best(self, rest: Sequence[int], others: Sequence[int], first: int) -> int:
        """Of ``others`` the one that allows the fastest rate over the region, besides ``rest``;
        ``first`` in doubt."""
        order = sorted(others, key=lambda i: (-self.quick(frozenset([*rest, i])), i))
        close = order[:CLOSER]
        if first not in close:
            close = sorted([first, *order[: CLOSER - 1]], key=order.index)
        found = first
        rate = 0.0
        for agent in close:
            reached = self.search.fastest([*rest, agent], coarse=True)
            # Rates are approximate: a little more decides nothing.
            if reached > rate * DECISIVE:
                found = agent
                rate = reached
        return found
