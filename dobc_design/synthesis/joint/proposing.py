"""Proposals of W, pins and gains for one request, rounded: over the region asked for, or near the consensus."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from typing import Any

from dobc_design.conditions.consensus.pinning import network_blocks
from dobc_design.conditions.coverage import asked_radius
from dobc_design.conditions.numbers import claimed, shorten
from dobc_design.conditions.separable.claim import acts_by_component
from dobc_design.exact.reading import counted
from dobc_design.problem.changes import changed_problem, gain_changes
from dobc_design.synthesis.joint.ground import Ground, Proposal
from dobc_design.synthesis.joint.pin_sets import pin_sets
from dobc_design.synthesis.joint.request import DesignRequest
from dobc_design.synthesis.joint.words import gains_words, observer_words, pins_words, price_words
from dobc_design.synthesis.observer.claim import ObserverDesign
from dobc_design.synthesis.pinning.design import PinningDesign
from dobc_design.synthesis.pinning.region_gains import RegionSearch
from dobc_design.verdict import Verdict

PADS = (Fraction(1005, 1000), Fraction(102, 100), Fraction(11, 10), Fraction(3, 2))  # faster than asked, tried in turn
START = Fraction(1, 10**6)  # of the largest slope: a rate that every network which can do at all can do
COMFORT = Fraction(3, 4)  # of the fastest rate: beyond, one more pin saves very large gains
FALLBACKS = (Fraction(1, 2), Fraction(9, 10))  # parts of the fastest rate near the consensus, where rows do not apply
HALF = Fraction(1, 2)  # of the fastest rate: what is aimed at where none is asked for
ENOUGH, NEARLY = 0.6, 0.95  # of the fastest rate with any observer: slower ones are left out; where more is aimed at
MOST_AGENTS = 200  # up to which the smallest gains of a region are looked for
SMALL = Fraction(1, 10**4)  # the radius of a region that is one point


def of_region(ground: Ground) -> Iterator[Proposal]:
    """Pins and gains with which max-separable rows cover the region; then what near the consensus would do."""
    problem, request = ground.problem, ground.request
    if not acts_by_component(problem):
        yield from of_consensus(ground)
        return
    region = problem.region
    radius = max(asked_radius(problem)) if region is not None else Fraction(0)
    disturbance = Fraction(0) if region is None else region.initial_disturbance or Fraction(0)
    searches: dict[int, RegionSearch] = {}

    def search_with(observer: ObserverDesign | None) -> RegionSearch:
        if id(observer) not in searches:
            searches[id(observer)] = RegionSearch(
                problem, None if observer is None else observer.W, radius=radius or SMALL, disturbance=disturbance
            )
        return searches[id(observer)]

    most = len(request.allowed) if request.pins is None else request.pins
    first = search_with(ground.observer(0) if problem.groups else None)
    for pinned in pin_sets(
        ground.structure, request.allowed, blocks=network_blocks(problem), search=first, caps=request.caps, most=most
    ):
        ground.tools.progress(f"looking for gains on {counted(len(pinned), 'agent')}")
        observers = ground.gains_of_observers()
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
        gains, bound = _rounded(found.gains, request), ""
        best = _smallest_proved(ground, observer, gains, rate)
        if best is not None:
            gains = {problem.network.index[label]: k for label, k in best.gains.items()}
            bound = f" Gains there with a max-separable proof at {rate:.4g} 1/s cost at least {_least(best)}."
        *said, last = _decisions(ground, observer, gains, pinned)
        yield Proposal(
            observer=observer,
            gains=gains,
            aim=target,
            decisions=(*said, last + bound),
            prices=tuple(price_words(problem, found, request.allowed, request.caps)),
        )


def _smallest_proved(
    ground: Ground, observer: ObserverDesign | None, gains: Mapping[int, Fraction], rate: float
) -> PinningDesign | None:
    """The smallest gains on the same agents for this W and the region, where they are found and cost no more."""
    problem, request = ground.problem, ground.request
    if problem.n > MOST_AGENTS or not gains:
        return None
    if observer is not None and observer.W is not None:
        problem = changed_problem(problem, gain_changes(problem, observer.W))
    labels = problem.network.labels
    found = ground.tools.pinning(
        problem,
        rate=claimed(float(f"{rate:.4g}")),
        region=True,
        allowed=[labels[i] for i in gains],
        max_gain={labels[i]: cap for i, cap in request.caps.items()} or None,
        digits=request.digits,
    )
    cheaper = found.cost is not None and found.cost <= sum(gains.values(), Fraction(0))
    return found if found.verdict is Verdict.PROVED and cheaper else None


def _least(found: PinningDesign) -> str:
    return f"{shorten(found.lower_bound or Fraction(0), digits=4):.4g}"


def of_consensus(ground: Ground) -> Iterator[Proposal]:
    """The cheapest gains for V = e'e near the consensus."""
    problem, request, tools = ground.problem, ground.request, ground.tools
    labels = problem.network.labels
    given: dict[str, Any] = {
        "max_gain": {labels[i]: cap for i, cap in request.caps.items()} or None,
        "digits": request.digits,
    }
    agents = [labels[i] for i in request.allowed]
    rates: list[Fraction] = []
    if request.rate is None:
        agents, rates = _slow_start(ground, agents, given)
    for observer in ground.gains_of_observers():
        for rate in rates or [request.rate * pad for pad in PADS if request.rate is not None]:
            tools.progress("looking for gains near the consensus")
            found = tools.pinning(problem, rate=rate, allowed=agents, pins=request.pins or "fewest", **given)
            if found.verdict is not Verdict.PROVED:
                break
            gains = {problem.network.index[label]: k for label, k in found.gains.items()}
            yield Proposal(
                observer=observer,
                gains=gains,
                aim=float(rate),
                decisions=_decisions(ground, observer, gains, tuple(gains)),
                prices=(*found.prices, *found.ties),
            )


def _slow_start(ground: Ground, agents: list[str], given: Mapping[str, Any]) -> tuple[list[str], list[Fraction]]:
    """The agents that do at a very low rate, and the parts of the fastest rate with them."""
    problem, request, tools = ground.problem, ground.request, ground.tools
    blocks = network_blocks(problem)
    scale = Fraction(1) if blocks is None or not blocks.scale else claimed(float(f"{blocks.scale:.1g}"))
    start = tools.pinning(problem, rate=scale * START, allowed=agents, pins=request.pins or "fewest", **given)
    if start.verdict is not Verdict.PROVED:
        return agents, [scale * START]
    pinned = list(start.gains)
    high = scale
    fastest = Fraction(0)
    for _ in range(24):  # by bisection, since caps and modes are in it; the first steps may lie above
        middle = (fastest + high) / 2 if fastest else high / 2
        if tools.pinning(problem, rate=_short(middle), allowed=pinned, **given).verdict is Verdict.PROVED:
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


def _rounded(gains: Mapping[int, float], request: DesignRequest) -> dict[int, Fraction]:
    """The next numbers of so many digits, or the caps where those are less; gains of 0 are left out."""
    most = max(gains.values(), default=0.0)
    result: dict[int, Fraction] = {}
    for agent, gain in sorted(gains.items()):
        if gain > most * 1e-9:
            unit = Fraction(10) ** (math.floor(math.log10(gain)) - request.digits + 1)
            rounded = math.ceil(Fraction(gain) / unit) * unit
            result[agent] = min(rounded, request.caps.get(agent, rounded))
    return result


def _short(rate: Fraction) -> Fraction:
    return claimed(float(f"{float(rate):.3g}"))
