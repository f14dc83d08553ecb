"""Proposals of W, pins and gains for one request, rounded: over the region asked for, or near the consensus.

Every group that listens to nobody outside gets a pin (without one nothing can work); further pins go where the region
allows the largest rate.  What is left of a network without its pins is compared quickly, by the slowest direction of
J + J', and the best few by the rows of the region itself.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from typing import Any

from dobc_design.conditions.consensus.network import name_agents
from dobc_design.conditions.consensus.pinning import fastest_rate, network_blocks
from dobc_design.conditions.coverage import asked_radius
from dobc_design.conditions.numbers import claimed
from dobc_design.conditions.separable.claim import acts_by_component
from dobc_design.exact.reading import counted
from dobc_design.problem.changes import typed_number, value_text
from dobc_design.problem.problem import Problem
from dobc_design.synthesis.joint.claim import DesignRequest
from dobc_design.synthesis.observer.claim import ObserverDesign, ObserverRequest
from dobc_design.synthesis.observer.search import search_groups
from dobc_design.synthesis.pinning.claim import FEWEST, PinningDesign, PinningRequest, Structure, typed_gains
from dobc_design.synthesis.pinning.propose_regions import RegionGains, RegionSearch
from dobc_design.synthesis.pinning.search import search_pinning
from dobc_design.verdict import Verdict

SPEEDS = (1, 2, 4)  # of the observer, in units of the slowest that is worth trying
MARGIN = 3  # how much faster than the rate asked the observer is to be
PADS = (Fraction(1005, 1000), Fraction(102, 100), Fraction(11, 10), Fraction(3, 2))  # faster than asked, tried in turn
START = Fraction(1, 10**6)  # of the largest slope: a rate that every network which can do at all can do
COMFORT = Fraction(3, 4)  # of the fastest rate: beyond, one more pin saves very large gains
FALLBACKS = (Fraction(1, 2), Fraction(9, 10))  # parts of the fastest rate near the consensus, where rows do not apply
HALF = Fraction(1, 2)  # of the fastest rate: what is aimed at where none is asked for
ENOUGH, NEARLY = 0.6, 0.95  # of the fastest rate with any observer: slower ones are left out; where more is aimed at
SMALL = Fraction(1, 10**4)  # the radius of a region that is one point
LOOKED_AT = ((60, 60), (400, 12), (10**9, 3))  # agents compared quickly in one step, by the size of the network
CLOSER = 4  # of these compared by the rows of the region
EXCHANGES = 120  # quick comparisons spent on exchanges of the first set
ONE_BY_ONE = 4  # pins more than needed that are tried one by one; then twice as many each time
DECISIVE = 1.02  # rates that are closer than this do not decide
SHOWN = 6  # gains in a sentence
BUYS = 3  # agents in the sentence on what a further pin buys
Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Ground:
    """One request and its problem without W and gains; ``changes`` took the exosystem's hidden part out.

    ``part``: of the fastest rate, what is aimed at where no rate is asked for.
    """

    problem: Problem
    request: DesignRequest
    progress: Progress
    changes: Mapping[str, Any]
    decisions: tuple[str, ...]
    structure: Structure
    part: Fraction
    observers: list[ObserverDesign | None]

    def every_observer(self) -> Iterator[ObserverDesign | None]:
        """All gains worth trying, slow ones first, each designed when it is first asked for; None where none is needed.

        The first may be without a W: then it says why there is none.
        """
        if not self.observers:
            self.observers.append(self._first_observer() if self.problem.groups else None)
        first = self.observers[0]
        yield first
        if first is None or first.W is None:
            return
        for place, speed in enumerate(SPEEDS):
            if place == len(self.observers):
                rate = claimed(float(f"{float(_pace(first) * speed):.3g}"))
                self.progress("designing a faster observer")
                faster = observer_at(self.problem, self.request, rate) if rate > 0 else None
                if faster is None or faster.W is None:
                    return
                self.observers.append(faster)
            if place:
                yield self.observers[place]

    def pinning(self, rate: Fraction, agents: Sequence[int], pins: int | str | None = None) -> PinningDesign:
        """The cheapest gains on these agents near the consensus."""
        request = PinningRequest(
            rate=rate,
            allowed=tuple(agents),
            costs=(Fraction(1),) * self.problem.n,
            caps=self.request.caps,
            pins=pins,
            digits=self.request.digits,
        )
        return search_pinning(self.problem, request, self.progress)

    def _first_observer(self) -> ObserverDesign:
        """The slowest observer worth trying: of the usual rate, or faster than the rate asked for."""
        self.progress("designing the observer")
        first, asked = observer_at(self.problem, self.request, None), self.request.rate
        if asked is None or first.W is None or _pace(first) >= MARGIN * asked:
            return first
        for rate in (MARGIN * asked, asked * Fraction(101, 100)):
            first = observer_at(self.problem, self.request, rate)
            if first.W is not None:
                break
        return first


@dataclass(frozen=True, slots=True, kw_only=True)
class Proposal:
    """W and gains (1/s, rounded) meant for the rate ``aim`` (1/s), with what is to be said of them."""

    observer: ObserverDesign | None
    gains: Mapping[int, Fraction]
    aim: float
    decisions: tuple[str, ...]
    prices: tuple[str, ...]


def observer_at(problem: Problem, request: DesignRequest, rate: Fraction | None) -> ObserverDesign:
    """A W for every group within the request's bounds on noise; without a ``rate`` (1/s) for that of the file."""
    rate = problem.joint_observer.rate if rate is None else rate
    return search_groups(problem.groups, ObserverRequest(rate=rate, noise=request.noise, digits=request.digits))


def _pace(observer: ObserverDesign) -> Fraction:
    return claimed(observer.measures.get("rate", 0.0))


def region_search(problem: Problem, observer: ObserverDesign | None) -> RegionSearch:
    """The rows of the region asked for, or next to the consensus, of a problem without gains."""
    region = problem.region
    radius = max(asked_radius(problem)) if region is not None else Fraction(0)
    disturbance = Fraction(0) if region is None else region.initial_disturbance or Fraction(0)
    W = None if observer is None else observer.W
    return RegionSearch(problem, W, radius=radius or SMALL, disturbance=disturbance)


def of_region(ground: Ground) -> Iterator[Proposal]:
    """Pins and gains with which max-separable rows cover the region; then what near the consensus would do."""
    problem, request = ground.problem, ground.request
    if not acts_by_component(problem):
        yield from of_consensus(ground)
        return
    searches: dict[int, RegionSearch] = {}

    def search_with(observer: ObserverDesign | None) -> RegionSearch:
        return searches.setdefault(id(observer), region_search(problem, observer))

    most = len(request.allowed) if request.pins is None else request.pins
    first = search_with(next(ground.every_observer()))
    for pinned in pin_sets(ground.structure, request.allowed, search=first, caps=request.caps, most=most):
        ground.progress(f"looking for gains on {counted(len(pinned), 'agent')}")
        observers = ground.every_observer()
        if request.rate is None:  # from the slowest on that does not hold the network back
            every = list(observers)
            reached = [search_with(each).fastest(pinned, request.caps, coarse=True) for each in every]
            enough = ENOUGH if ground.part <= HALF else NEARLY
            first_place = next(place for place, rate in enumerate(reached) if rate >= enough * max(reached))
            observers = iter(every[first_place:])
        for observer in observers:
            yield from _over_region(ground, observer, search_with(observer), pinned)


def _over_region(
    ground: Ground, observer: ObserverDesign | None, search: RegionSearch, pinned: Sequence[int]
) -> Iterator[Proposal]:
    request, problem = ground.request, ground.problem
    if request.rate is not None and search.holds(pinned, request.caps, float(request.rate), coarse=True) is None:
        return
    fastest = search.fastest(pinned, request.caps)
    target = float(request.rate) if request.rate is not None else float(ground.part) * fastest
    more = request.pins is None and len(pinned) < len(request.allowed)
    if not 0 < target < fastest * (float(COMFORT) if more else 1.0):
        return
    for pad in PADS:
        rate = min(target * float(pad), (target + fastest) / 2)
        found = search.smallest(pinned, request.caps, rate)
        if found is None:
            return
        gains = typed_gains(found.gains, digits=request.digits, caps=request.caps)
        yield Proposal(
            observer=observer,
            gains=gains,
            aim=target,
            decisions=_decisions(ground, observer, gains, pinned),
            prices=tuple(price_words(problem, found, request.allowed, request.caps)),
        )


def of_consensus(ground: Ground) -> Iterator[Proposal]:
    """The cheapest gains for V = e'e near the consensus."""
    request, agents = ground.request, ground.request.allowed
    if request.rate is None:
        agents, rates = _slow_start(ground)
    else:
        rates = [request.rate * pad for pad in PADS]
    for observer in ground.every_observer():
        for rate in rates:
            ground.progress("looking for gains near the consensus")
            found = ground.pinning(rate, agents, request.pins or FEWEST)
            if found.verdict is not Verdict.PROVED:
                break
            gains = {ground.problem.network.index[label]: k for label, k in found.gains.items()}
            yield Proposal(
                observer=observer,
                gains=gains,
                aim=float(rate),
                decisions=_decisions(ground, observer, gains, tuple(gains)),
                prices=(*found.prices, *found.ties),
            )


def _slow_start(ground: Ground) -> tuple[tuple[int, ...], list[Fraction]]:
    """The agents that do at a very low rate, and the parts of the fastest rate with them."""
    problem, request = ground.problem, ground.request
    blocks = network_blocks(problem)
    scale = Fraction(1) if blocks is None or not blocks.scale else claimed(float(f"{blocks.scale:.1g}"))
    start = ground.pinning(scale * START, request.allowed, request.pins or FEWEST)
    if start.verdict is not Verdict.PROVED:
        return request.allowed, [scale * START]
    pinned = tuple(sorted(problem.network.index[label] for label in start.gains))
    fastest, high = Fraction(0), scale
    for _ in range(24):  # by bisection, since caps and modes are in it; the first steps may lie above
        middle = (fastest + high) / 2 if fastest else high / 2
        if ground.pinning(_short(middle), pinned).verdict is Verdict.PROVED:
            fastest = middle
        else:
            high = middle
        if fastest and high - fastest <= fastest / 20:
            break
    parts = (ground.part, *(part for part in FALLBACKS if part > ground.part and problem.region is not None))
    return pinned, [_short(fastest * part) for part in parts] or [scale * START]


def _decisions(
    ground: Ground, observer: ObserverDesign | None, gains: Mapping[int, Fraction], pinned: Sequence[int]
) -> tuple[str, ...]:
    problem, request = ground.problem, ground.request
    fixed = request.pins is not None and len(pinned) >= request.pins
    return (
        *ground.decisions,
        *([] if observer is None else observer_words(observer)),
        pins_words(problem, ground.structure, sorted(gains), fixed=fixed),
        gains_words(problem, gains, digits=request.digits, part=ground.part if request.rate is None else None),
    )


def _short(rate: Fraction) -> Fraction:
    return claimed(float(f"{float(rate):.3g}"))


def pin_sets(
    structure: Structure,
    allowed: Sequence[int],
    *,
    search: RegionSearch,
    caps: Mapping[int, Fraction],
    most: int,
    one_by_one: bool = False,
) -> Iterator[tuple[int, ...]]:
    """Sets of at most ``most`` allowed agents, growing; each holds the one before it, the last all that are allowed.

    ``one_by_one``: by one agent each time, however many there are.
    """
    blocks = network_blocks(search.problem)

    @cache
    def quick(agents: frozenset[int]) -> float:
        return 0.0 if blocks is None else round(fastest_rate(blocks, agents), 9)

    def best(rest: Sequence[int], others: Sequence[int], first: int) -> int:
        """Of ``others`` the one that allows the fastest rate over the region, besides ``rest``; ``first`` in doubt."""
        order = sorted(others, key=lambda i: (-quick(frozenset([*rest, i])), i))
        found, rate = first, 0.0
        close = order[:CLOSER] if first in order[:CLOSER] else [first, *order[: CLOSER - 1]]
        for agent in sorted(close, key=order.index):
            reached = search.fastest([*rest, agent], caps, coarse=True)
            if reached > rate * DECISIVE:
                found, rate = agent, reached
        return found

    chosen, work = list(structure.agents), 0
    for place, agent in enumerate(chosen):  # each replaced by the best that meets the same groups
        rest = chosen[:place] + chosen[place + 1 :]
        missed = [group for group in structure.groups if not set(group) & set(rest)]
        others = [i for i in allowed if i not in rest and all(i in group for group in missed)]
        if len(others) > 1 and work + len(others) <= EXCHANGES:
            work += len(others)
            chosen[place] = best(rest, others, agent)
    yield tuple(sorted(chosen))
    looked_at = next(count for size, count in LOOKED_AT if search.problem.n <= size)
    wanted, step = len(chosen), 1
    while len(chosen) < min(most, len(allowed)):
        step = 1 if one_by_one or wanted < len(structure.agents) + ONE_BY_ONE else 2 * step
        wanted = min(wanted + step, most, len(allowed))
        while len(chosen) < wanted:
            left = [i for i in allowed if i not in chosen]
            v = search.holds(chosen, caps, 0.0, coarse=True)
            if v is not None:  # whoever is held least has the largest v
                left.sort(key=lambda i, v=v: (-float(v[i]), i))  # type: ignore[misc]
            chosen.append(best(chosen, left[:looked_at], left[0]))
        yield tuple(sorted(chosen))


def observer_words(found: ObserverDesign) -> list[str]:
    """W, how fast its error decays, how it came about; a sentence for every group of agents."""
    if not found.groups:
        return [f"Observer: {_gain_words(found)}"]
    return [f"Observer of the group of agent {name}: {_gain_words(each)}" for name, each in found.groups.items()]


def _gain_words(found: ObserverDesign) -> str:
    rows = value_text([[typed_number(x) for x in row] for row in found.W or ()])
    rate, gain = found.measures.get("rate"), found.measures.get("gain")
    noise = found.measures.get("hinf measurement")
    pace = f"the error of the estimate decays at {rate:.4g} 1/s" if rate else "the error of the estimate decays"
    loud = f", noise on the measured x reaches dhat with a gain of at most {noise:.4g} 1/s" if noise else ""
    size = f" |W| = {gain:.4g}." if gain else ""
    return f"W = {rows} ({found.source}): {pace}{loud}.{size}"


def pins_words(problem: Problem, structure: Structure, pinned: Sequence[int], *, fixed: bool) -> str:
    """Which agents are pinned, and why so many."""
    labels = problem.network.labels
    who = name_agents([labels[i] for i in pinned])
    single = len(structure.groups) == 1 and len(structure.groups[0]) == problem.n
    if len(pinned) == structure.least:
        if single:
            why = "one pin has to be: moved together, unpinned agents stay moved. No more were needed"
        elif len(structure.groups) == 1:
            group = [labels[i] for i in structure.groups[0]]
            hears = "listens" if len(group) == 1 else "listen"
            why = f"{name_agents(group)} {hears} to nobody outside, so there has to be a pin"
        else:
            why = f"{len(structure.groups)} groups listen to nobody outside, so fewer pins cannot do"
    elif fixed:
        why = "as many as were allowed"
    else:
        least = f"{structure.least} {'is' if structure.least == 1 else 'are'} the least that the arcs allow"
        why = f"{least}, but with fewer than {len(pinned)} very large gains or no proof were left"
    return f"Pinned: {who}; {why}."


def gains_words(problem: Problem, gains: Mapping[int, Fraction], *, digits: int, part: Fraction | None) -> str:
    """The gains, rounded up, and what they are for."""
    labels = problem.network.labels
    shown = list(gains.items())[:SHOWN]
    each = ", ".join(f"k = {typed_number(k)} for agent {labels[i]}" for i, k in shown)
    more = f" and {len(gains) - len(shown)} more" if len(gains) > len(shown) else ""
    total = f", in total {typed_number(sum(gains.values(), Fraction(0)))}" if len(gains) > 1 else ""
    aim = ""
    if part is not None:
        aim = f" They are meant for {float(part):.0%} of the fastest rate that pins there allow."
    return f"Gains: {each}{more}{total} (1/s), rounded up to {counted(digits, 'digit')}.{aim}"


def price_words(
    problem: Problem, found: RegionGains, allowed: Sequence[int], caps: Mapping[int, Fraction]
) -> list[str]:
    """The multipliers of a design over a region: what more rate costs, and where a further pin buys most."""
    labels, total = problem.network.labels, found.total
    if not total or not found.rate:
        return []
    share = found.rate_price * found.rate / total
    words = [f"Price of the rate: near {found.rate:.4g} 1/s, each 1 % more takes about {share:.3g} % more gain."]
    capped = [i for i in found.gains if i in caps and found.gains[i] >= 0.999 * float(caps[i])]
    if capped:
        words.append(
            f"Price of the caps: {name_agents([labels[i] for i in capped])} stand"
            f"{'s' if len(capped) == 1 else ''} at the largest gain allowed."
        )
    others = [i for i in range(problem.n) if i not in found.gains]
    best = sorted(others, key=lambda i: (-round(float(found.prices[i]), 6), i))[:BUYS]
    if best and found.prices[best[0]] > 1:
        named = ", ".join(f"agent {labels[i]} {found.prices[i]:.3g}" for i in best if found.prices[i] > 1)
        kept = "" if best[0] in set(allowed) else f" (pins there are not allowed on agent {labels[best[0]]})"
        words.append(
            f"Price of so few pins: agent {labels[best[0]]} would buy most. Each 1/s of gain there would save"
            f" about so much elsewhere: {named}{kept}."
        )
    elif others:
        words.append("Price of so few pins: none; a gain on any other agent would cost more than it saves.")
    return words
