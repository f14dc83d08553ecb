"""The points of a trade-off: the same proposals as in a design, at many rates or with many sets of pins.

Rates and gains of a region are what floating point sees; near the consensus, and of observers, they are proved.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise

from dobc_design.conditions.consensus.pinning import fastest_rate, network_blocks
from dobc_design.conditions.coverage import asked_radius
from dobc_design.conditions.numbers import claimed
from dobc_design.conditions.separable.claim import acts_by_component
from dobc_design.errors import SpecError
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.reading import shown
from dobc_design.problem.changes import changed_problem
from dobc_design.problem.problem import Problem
from dobc_design.synthesis.joint.designed import Design
from dobc_design.synthesis.joint.ground import Tools
from dobc_design.synthesis.joint.pin_sets import pin_sets
from dobc_design.synthesis.joint.proposing import SMALL
from dobc_design.synthesis.joint.request import DesignRequest
from dobc_design.synthesis.joint.trade_off import TradeOff, TradePoint
from dobc_design.synthesis.joint.words import price_words
from dobc_design.synthesis.pinning.region_gains import RegionSearch
from dobc_design.synthesis.pinning.structure import structure_of
from dobc_design.verdict import Verdict

CURVES = ("gain", "pins", "noise")
RATE, TOTAL, COUNT = "rate, 1/s", "sum of the gains, 1/s", "pinned agents"
ERROR, NOISE = "decay of the estimate's error, 1/s", "largest gain from noise to dhat, 1/s"
FIRST, LAST = 0.1, 0.95  # parts of the fastest rate between which rates are spread
OBSERVER_LIMITS = 0.85  # of the observer's decay rate: a rate that only a faster observer would raise
SLOWEST, QUICKEST = 0.25, 4.0  # the same for observers, of the design's own


@dataclass(frozen=True, slots=True, kw_only=True)
class Terms:
    """What a curve is drawn for: the problem without gains, the request, W (q, m), the design or None."""

    problem: Problem
    request: DesignRequest
    W: Matrix | None
    design: Design | None
    points: int
    tools: Tools


def trade_off_of(terms: Terms, curve: str) -> TradeOff:
    """The curve of that name.  Raises: SpecError for another name, and for noise without an exosystem."""
    makers: Mapping[str, Callable[[Terms], TradeOff]] = {"gain": _gain_curve, "pins": _pin_curve, "noise": _noise_curve}
    if curve not in makers:
        raise SpecError(
            f"curve must be one of {', '.join(CURVES)}; got {shown(curve)}.",
            key="curve",
            cure='"gain" is the sum of the gains against the rate.',
        )
    return makers[curve](terms)


def read_points(points: object) -> int:
    """How many points a curve has.  Raises: SpecError."""
    if isinstance(points, bool) or not isinstance(points, int) or not 2 <= points <= 200:
        raise SpecError(
            f"points must be an integer from 2 to 200; got {shown(points)}.",
            key="points",
            cure="Ten are a good choice.",
        )
    return points


def _search(terms: Terms) -> RegionSearch | None:
    """The rows of the region asked for; None where the curve is about the consensus."""
    problem = terms.problem
    if problem.region is None or not acts_by_component(problem):
        return None
    bare = changed_problem(problem, {"pinning.gains": None})
    radius = max(asked_radius(problem)) or SMALL
    return RegionSearch(bare, terms.W, radius=radius, disturbance=problem.region.initial_disturbance or Fraction(0))


def _sets(terms: Terms, search: RegionSearch | None) -> Iterator[tuple[int, ...]]:
    request, bare = terms.request, changed_problem(terms.problem, {"pinning.gains": None})
    structure = structure_of(bare, request.allowed)
    if structure.unmet is not None:
        raise SpecError(
            "allowed must leave every group that listens to nobody outside an agent to pin.",
            key="allowed",
            cure="dobc_design.design says which agents are missing.",
        )
    search = search or RegionSearch(bare, None, radius=SMALL, disturbance=Fraction(0))
    most = len(request.allowed) if request.pins is None else request.pins
    yield from pin_sets(
        structure,
        request.allowed,
        blocks=network_blocks(bare),
        search=search,
        caps=request.caps,
        most=most,
        one_by_one=True,
    )


def _gain_curve(terms: Terms) -> TradeOff:
    problem, labels, search = terms.problem, terms.problem.network.labels, _search(terms)
    index = problem.network.index
    pinned = tuple(sorted(index[label] for label in terms.design.gains)) if terms.design is not None else ()
    pinned = pinned or next(_sets(terms, search))
    named = tuple(labels[i] for i in pinned)
    points: list[TradePoint] = []
    said: tuple[str, ...] = ()
    fastest = _fastest(terms, search, pinned)
    for rate in _spread(FIRST * fastest, LAST * fastest, terms.points):
        terms.tools.progress(f"gains for {rate:.3g} 1/s")
        if search is not None:
            found = search.smallest(pinned, terms.request.caps, rate)
            if found is not None:
                points.append(TradePoint(x=rate, y=found.total, pinned=named))
                said = tuple(price_words(problem, found, terms.request.allowed, terms.request.caps))
            continue
        caps = {labels[i]: cap for i, cap in terms.request.caps.items()} or None
        exact = claimed(float(f"{rate:.6g}"))
        own = terms.tools.pinning(problem, rate=exact, allowed=named, max_gain=caps, digits=6)
        if own.verdict is Verdict.PROVED and own.cost is not None:
            points.append(TradePoint(x=rate, y=float(own.cost), pinned=tuple(own.gains), proved=True))
            said = own.prices
    design = terms.design
    chosen = None
    if design is not None and design.rate and design.cost is not None:
        chosen = TradePoint(x=design.rate, y=float(design.cost), pinned=tuple(design.gains), proved=True)
        said = design.prices
    return TradeOff(
        name=problem.name,
        curve="gain",
        x_name=RATE,
        y_name=TOTAL,
        points=tuple(points),
        chosen=chosen,
        sensitivity=said,
    )


def _pin_curve(terms: Terms) -> TradeOff:
    problem, labels, search = terms.problem, terms.problem.network.labels, _search(terms)
    points: list[TradePoint] = []
    for pinned in _sets(terms, search):
        terms.tools.progress(f"{len(pinned)} pinned agents")
        rate = _fastest(terms, search, pinned)
        if rate > 0 and math.isfinite(rate):
            points.append(TradePoint(x=float(len(pinned)), y=rate, pinned=tuple(labels[i] for i in pinned)))
        if len(points) >= terms.points:
            break
    design, chosen = terms.design, None
    if design is not None and design.rate:
        chosen = TradePoint(x=float(len(design.gains)), y=design.rate, pinned=tuple(design.gains), proved=True)
    said = list(_steps(points))
    if search is not None and points and points[-1].y >= OBSERVER_LIMITS * search.decay:
        said.append(f"More pins than that buy nothing: the estimate's error decays at {search.decay:.4g} 1/s only.")
    return TradeOff(
        name=problem.name,
        curve="pins",
        x_name=COUNT,
        y_name=RATE,
        points=tuple(points),
        chosen=chosen,
        sensitivity=tuple(said),
    )


def _steps(points: Sequence[TradePoint]) -> Iterator[str]:
    """What each further pin buys."""
    gains = [(after.y / before.y, before, after) for before, after in pairwise(points)]
    if gains:
        factor, before, after = max(gains, key=lambda each: each[0])
        new = ", ".join(label for label in after.pinned if label not in before.pinned)
        yield (
            f"The step that buys most: from {before.x:g} to {after.x:g} pins, with agent {new} the rate grows"
            f" {factor:.3g} times."
        )


def _noise_curve(terms: Terms) -> TradeOff:
    problem, tools, digits = terms.problem, terms.tools, terms.request.digits
    if not problem.groups:
        raise SpecError(
            "the noise curve needs an exosystem: without one there is no observer.",
            key="curve",
            cure='Ask for "gain" or "pins".',
        )
    own = None if terms.design is None else terms.design.observer
    own = own or tools.observer(problem, rate=None, noise=None, digits=digits)
    middle = own.measures.get("rate", 1.0)
    points: list[TradePoint] = []
    for rate in _spread(SLOWEST * middle, QUICKEST * middle, terms.points):
        tools.progress(f"observer for {rate:.3g} 1/s")
        found = tools.observer(problem, rate=claimed(float(f"{rate:.4g}")), noise=None, digits=digits)
        noise, pace = found.measures.get("hinf measurement"), found.measures.get("rate")
        if noise is not None and pace is not None:
            points.append(TradePoint(x=pace, y=noise, proved=True))
    noise, chosen = own.measures.get("hinf measurement"), None
    if terms.design is not None and noise is not None:
        chosen = TradePoint(x=middle, y=noise, proved=True)
    return TradeOff(
        name=problem.name,
        curve="noise",
        x_name=ERROR,
        y_name=NOISE,
        points=tuple(sorted(points, key=lambda point: point.x)),
        chosen=chosen,
        sensitivity=(),
    )


def _fastest(terms: Terms, search: RegionSearch | None, pinned: Sequence[int]) -> float:
    if search is not None:
        return search.fastest(pinned, terms.request.caps)
    blocks = network_blocks(changed_problem(terms.problem, {"pinning.gains": None}))
    rate = 0.0 if blocks is None else fastest_rate(blocks, pinned)
    caps = [float(terms.request.caps[i]) for i in pinned if i in terms.request.caps]
    return min(rate, max(caps)) if len(caps) == len(pinned) and caps else rate


def _spread(first: float, last: float, count: int) -> list[float]:
    if not 0 < first < last < math.inf:
        return []
    return [first + (last - first) * k / (count - 1) for k in range(count)]
