"""Cures for a network that is not held, as proposals: gains on the present pins, one more pin,
several more.

Gains on a set F can do iff S is positive on the other agents (theory, section 7).  Each cure is on
the boundary of what is needed, in floating point; exact arithmetic decides whether the rounded one
cures.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import lru_cache, partial
from typing import Any

import numpy as np
from scipy import sparse

from dobc_design._checks import noun
from dobc_design.conditions import numbers
from dobc_design.conditions.consensus import pinning
from dobc_design.conditions.numbers import bisected
from dobc_design.exact.matrix import Matrix, to_float
from dobc_design.loop.arcs import closed_groups, tied
from dobc_design.loop.loop import Loop

from .pinning import (
    Blocks,
    fastest_rate,
    network_blocks,
    rough_rate,
    smallest_gains,
)
from .propose import Agents, float_lambda, largest_eigenvalue, rows_of

CANDIDATES = 200  # agents that are tried one by one, if a try is cheap
FEWEST = 10  # if it is not
LARGE = 500  # agents from which every single try takes a noticeable time
WORK = 10_000_000  # tries times squared size
GREEDY_WORK = 500_000  # looks times squared size of a greedy step
# agents of the slowest direction among which a greedy step chooses, if a look is cheap
LOOKED_AT = 12
NEARLY = 0.999  # of a rate that is aimed at
NEARLY_ZERO = 1e-9  # relative to the entries of S
ALIKE = 1e-6  # totals that differ by less (relatively) are a tie
# two digits if they ask for at most this much more than is needed, else three
ENOUGH = Fraction(51, 50)
STEPS = 80  # of a bisection

Progress = Callable[[str], None]


@noun
class PinProposal:
    """Gains by agent index, about; which agents are new; the ``rivals`` of a single new one.
    ``keeps``: the present gains stay.  ``smallest``: the least that can do; else the least for half
    of the fastest decay, or where V has weights for the true ``rate`` (1/s), which is slower where
    that would take very large gains."""

    gains: Mapping[int, float]
    added: Agents = ()
    rivals: Agents = ()
    keeps: bool = False
    smallest: bool = True
    rate: float = 0.0

    def rounded(self, *, factor: float = 1.0) -> dict[int, Fraction]:
        """The gains times ``factor``, rounded up to two or three digits."""
        ordered = sorted(self.gains.items())
        return {agent: rounded_up(gain * factor) for agent, gain in ordered if gain > 0}


def rounded_up(value: float | Fraction) -> Fraction:
    """The next number >= value > 0 with two significant digits, or three where two would ask for
    too much."""
    exact = Fraction(value)
    two = numbers.rounded_up(exact, digits=2)
    if two <= exact * ENOUGH:
        return two
    return numbers.rounded_up(exact, digits=3)


def gains_on(blocks: Blocks, agents: Sequence[int], proposal: PinProposal) -> Iterator[PinProposal]:
    """The smallest gains on these agents, then those for half of the fastest decay, as ``proposal``
    says what for."""
    least = smallest_gains(blocks, agents)
    if least is None:
        return
    if float(np.max(least, initial=0.0)) > 1e-9 * blocks.scale:
        yield replace(proposal, gains=dict(enumerate(least.tolist())), smallest=True)
    rate = rough_rate(blocks, agents) / 2
    if not np.isfinite(rate):  # every gain > 0 would do
        rate = blocks.scale / 8 if blocks.scale else 1.0
    faster = smallest_gains(pinning.for_rate(blocks, rate), agents)
    while blocks.weighted and blocks.scale and faster is not None and np.max(faster) > blocks.scale:
        rate /= 2
        faster = smallest_gains(pinning.for_rate(blocks, rate), agents)
    if faster is not None:
        own = numbers.shorten(NEARLY * rate, digits=2) if blocks.weighted else 0.0
        yield replace(proposal, gains=dict(enumerate(faster.tolist())), smallest=False, rate=own)


@lru_cache(maxsize=2)
def _blocks(loop: Loop, *, pins: bool = False) -> Blocks | None:
    """For the true rate where one mode has rising couplings, else for V = e'e."""
    if len(loop.modes) == 1:
        weighted = network_blocks(loop, pins=pins, weighted=True)
        if weighted is not None and weighted.z:
            return weighted
    return network_blocks(loop, pins=pins)


def on_present_pins(loop: Loop) -> Iterator[PinProposal]:
    """New gains on the present pins; nothing if there are none, or no gains on them can do."""
    blocks = _blocks(loop)
    if blocks is not None and loop.pulls.nodes:
        yield from gains_on(blocks, loop.pulls.nodes, PinProposal(gains={}))


def one_more(loop: Loop, *, progress: Progress | None = None) -> Iterator[PinProposal]:
    """The best agent to add: beside the present gains as they are, then with all gains chosen
    anew."""
    for blocks, pins in _grounds(loop):
        found = best_single(blocks, loop, pins=pins, progress=progress)
        if found:
            proposal = PinProposal(gains={}, added=found[:1], rivals=found[1:], keeps=not pins)
            yield from gains_on(blocks, (*pins, found[0]), proposal)


def several_more(loop: Loop, *, progress: Progress | None = None) -> Iterator[PinProposal]:
    """A small set to add, likewise; last, one gain on every agent, which always does."""
    blocks = _blocks(loop)
    if blocks is None:
        return
    added = small_set(blocks, loop, progress=progress)
    for ground, pins in _grounds(loop):
        proposal = PinProposal(gains={}, added=added, keeps=not pins)
        yield from gains_on(ground, (*pins, *added), proposal)
    # by how much the entries off the diagonal outweigh it, in the worst row (Gershgorin)
    enough = 0.0
    for table in blocks.tables:
        diagonal = table.diagonal()
        rows = np.asarray(abs(table).sum(axis=1)).ravel() - np.abs(diagonal)
        enough = max(enough, float(np.max(rows - diagonal, initial=0.0)))
    gain = max(enough / 2, blocks.scale / 8) * 1.01 or 1.0
    new = tuple(sorted(set(range(loop.n)) - set(loop.pulls.nodes)))
    yield PinProposal(gains=dict.fromkeys(range(loop.n), gain), added=new, smallest=False)


def _grounds(loop: Loop) -> Iterator[tuple[Blocks, Agents]]:
    """What to add to: the present gains as they are; the present pins with gains still to be
    chosen."""
    kept = _blocks(loop, pins=True)
    if kept is not None:
        yield kept, ()
    free = _blocks(loop)
    if free is not None and loop.pulls.nodes:
        yield free, loop.pulls.nodes


def groups_without_pin(loop: Loop) -> list[Agents]:
    """The smallest sets that listen to nobody outside in one of the modes and hold no pin, each
    once."""
    pinned = set(loop.pulls.nodes)
    found = (group for arcs in loop.modes.values() for group in closed_groups(loop, [arcs]))
    return list(dict.fromkeys(group for group in found if not pinned & set(group)))


def best_single(
    blocks: Blocks, loop: Loop, *, pins: Sequence[int] = (), progress: Progress | None = None
) -> Agents:
    """Agents that, beside ``pins`` with new gains, need the smallest total gain (or hold best);
    empty: none can."""
    totals: dict[int, float] = {}
    candidates = _candidates(blocks, loop)
    often = 1 if loop.n > LARGE else 10
    for place, agent in enumerate(candidates):
        if progress is not None and place % often == 0:
            progress(f"looking for the best agent to pin ({place} of {len(candidates)} tried)")
        gains = _some_gains(blocks, (*pins, agent))
        if gains is not None:
            totals[agent] = float(np.sum(gains))
    if not totals:
        return ()
    least = min(totals.values())
    if least <= NEARLY_ZERO * blocks.scale:
        free = [agent for agent, total in totals.items() if total <= NEARLY_ZERO * blocks.scale]
        totals = {agent: pinning.looseness(blocks, (*pins, agent)) for agent in free}
        least = min(totals.values())
    return tuple(sorted(agent for agent, total in totals.items() if total <= least * (1 + ALIKE)))


def _some_gains(blocks: Blocks, agents: Sequence[int]) -> Any:
    """Gains on these agents that do, by the closed form where there is one, which is quick."""
    if not blocks.z:
        return smallest_gains(blocks, agents)
    chosen = np.isin(np.arange(blocks.agents), agents)
    valid = pinning.valid_gains(blocks, chosen, np.ones(blocks.agents))
    return None if valid is None else valid.gains


def _candidates(blocks: Blocks, loop: Loop) -> list[int]:
    """Agents in every closed group without a pin; of very many those that carry the slowest
    direction."""
    unpinned = set(range(loop.n)) - set(loop.pulls.nodes) - tied(loop)
    common = set(unpinned)
    for group in groups_without_pin(loop):
        common &= set(group)
    most = _affordable(loop.n)
    if len(common) <= most:
        return sorted(common)
    free = np.array(sorted(unpinned))
    weights = pinning.slowest_on(blocks, free)
    # Rounded, so that agents that are alike keep their order.
    parts = np.round(weights / np.max(weights, initial=1e-300), 6)
    order = free[np.argsort(-parts, kind="stable")].tolist()
    return [agent for agent in order if agent in common][:most]


def _affordable(size: int, *, times: int = 1) -> int:
    """How many agents to try, so many ``times``, where each costs one solve of this size."""
    return max(FEWEST, min(CANDIDATES, WORK // (times * max(1, size) ** 2)))


def small_set(blocks: Blocks, loop: Loop, *, progress: Progress | None) -> Agents:
    """Agents to add to the pins so that some gains can do: one of each closed group, then greedily,
    none in vain."""
    pins = loop.pulls.nodes
    chosen = _one_of_each(blocks, groups_without_pin(loop))
    needed = list(chosen)
    most = max(1, min(LOOKED_AT, GREEDY_WORK // loop.n**2))
    while rough_rate(blocks, (*pins, *chosen)) <= NEARLY_ZERO * blocks.scale:
        free = np.setdiff1d(np.arange(loop.n), [*pins, *chosen])
        if not len(free):
            break
        if progress is not None:
            progress(f"choosing agents to pin ({len(chosen)} so far)")
        weights = pinning.slowest_on(blocks, free)
        heavy = free[np.argsort(-weights, kind="stable")][:most].tolist()
        rates = {agent: fastest_rate(blocks, (*pins, *chosen, agent)) for agent in heavy}
        chosen.append(max(rates, key=rates.__getitem__))
    for agent in [a for a in chosen if a not in needed]:
        others = [other for other in chosen if other != agent]
        if fastest_rate(blocks, (*pins, *others)) > NEARLY_ZERO * blocks.scale:
            chosen = others
    return tuple(sorted(chosen))


def _one_of_each(blocks: Blocks, groups: Sequence[Agents]) -> list[int]:
    """Agents that hit every group: those in most groups first, among them the one that holds its
    group best."""
    left = [set(group) for group in groups]
    chosen: list[int] = []
    while left:
        count = Counter(agent for group in left for agent in group)
        most = max(count.values())
        best = {agent for agent, times in count.items() if times == most}
        homes = [group for group in left if group & best]
        homes.sort(key=lambda group: (len(group), min(group)))
        # groups without common agents do not bear on each other
        for home in homes if most == 1 else homes[:1]:
            chosen.append(_holding_best(blocks, sorted(home), best, times=len(left)))
        left = [group for group in left if group.isdisjoint(chosen)]
    return chosen


def _holding_best(blocks: Blocks, group: Sequence[int], candidates: set[int], *, times: int) -> int:
    """The candidate that, pinned, holds the rest of the group best; ``times``: how many groups
    share the work."""
    rows = rows_of(np.array(group), blocks.width)
    tables = tuple(table[rows][:, rows] for table in blocks.tables)
    inner = replace(blocks, agents=len(group), tables=tables)
    local = [place for place, agent in enumerate(group) if agent in candidates]
    local = local[: _affordable(len(group), times=times)]

    def looseness(place: int) -> tuple[float, int]:
        # Rounded, so that ties are ties.
        return float(f"{pinning.looseness(inner, [place]):.9g}"), place

    return int(group[min(local, key=looseness)])


def _is_enough(table: Any, border: Any, factor: float) -> bool:
    """Whether the table is negative with the border over the factor added."""
    if factor <= 0:
        return False
    found = largest_eigenvalue(sparse.coo_array(table + border / factor))
    return found.value < 0


def scale_needed(loop: Loop, S: Matrix) -> float | None:
    """The factor a beyond which Lambda + I (x) S / a < 0 (theory, section 9), about; None if Lambda
    < 0 fails."""
    block = to_float(S)
    weight = float(np.max(np.linalg.eigvalsh(block), initial=0.0))
    worst = 0.0
    for mode in loop.modes:
        table = sparse.csr_array(float_lambda(loop, mode))
        top = largest_eigenvalue(sparse.coo_array(table)).value
        if not top < 0 or not math.isfinite(weight):
            return None
        needed = weight / -top * (1 + 1e-12)  # with m = 1 and S = s I this is the answer
        if len(block) > 1:
            border = sparse.kron(sparse.eye_array(loop.n), sparse.csr_array(block))
            does = partial(_is_enough, table, border)
            needed, _ = bisected(does, needed, 0.0, steps=STEPS)
        worst = max(worst, needed)
    return worst
