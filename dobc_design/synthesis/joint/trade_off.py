"""Trade-offs: one limit of a design in terms of another, as the points of a curve."""

import math
from dataclasses import replace
from fractions import Fraction

from dobc_design._checks import noun
from dobc_design.conditions.coverage import Progress
from dobc_design.conditions.numbers import claimed
from dobc_design.errors import SpecError
from dobc_design.exact.reading import one_of, whole_number
from dobc_design.problem.changes import changed_problem
from dobc_design.problem.problem import Problem
from dobc_design.synthesis.observer.claim import ObserverDesign
from dobc_design.synthesis.pinning.decide import structure_of

from .claim import AXES, Design, DesignRequest, TradeOff, TradePoint
from .pins import PinSets
from .search import attempt, observer_at, region_search

SLOWEST, QUICKEST = 0.25, 4.0  # rates of a curve, of the design's own or of its observer's
FASTEST = 1.9  # of a design that aims at half of the fastest rate


def trade_off_of(
    problem: Problem,
    request: DesignRequest,
    curve: str,
    *,
    design: Design | None,
    points: int,
    progress: Progress,
) -> TradeOff:
    """The curve of that name.  Raises: SpecError for another name or number of points, and where
    there is no curve."""
    _check_curve(problem, curve, points)
    bare = changed_problem(problem, {"pinning.gains": None})
    own = design
    if design is None and curve == "gain":
        own = attempt(bare, request, progress)
    observer = None if own is None else own.observer
    # Rows over a region, and the curve of noise, need a W in any case.
    if observer is None and bare.groups:
        observer = observer_at(bare, request, None)
    ground = Curve(problem=bare, request=request, count=points, progress=progress)
    if curve == "gain" and own is not None:
        found = ground.gains(own)
    elif curve == "pins":
        found = ground.pins(observer)
    else:
        found = ground.noise(observer)
    return TradeOff(
        name=problem.name,
        curve=curve,
        points=tuple(found),
        chosen=None if design is None else _chosen(curve, design, observer),
        design=own,
    )


def _check_curve(problem: Problem, curve: str, points: int) -> None:
    """Raises: SpecError where there is no such curve, or not with so many points."""
    one_of(curve, AXES, "curve", '"gain" is the sum of the gains against the rate.')
    whole_number(points, "points", least=2, most=200, cure="Ten are a good choice.")
    if curve == "noise" and not problem.groups:
        text = "the noise curve needs an exosystem: without one there is no observer."
        raise SpecError(text, key="curve", cure='Ask for "gain" or "pins".')


def _chosen(curve: str, design: Design, observer: ObserverDesign | None) -> TradePoint | None:
    """Where a design lies on the curve."""
    if curve == "noise" and observer is not None:
        return next(iter(_noise_point(observer)), None)
    if not design.rate or design.cost is None:
        return None
    pinned = tuple(design.gains)
    if curve == "gain":
        return TradePoint(x=design.rate, y=float(design.cost), pinned=pinned, proved=True)
    return TradePoint(x=float(len(pinned)), y=design.rate, pinned=pinned, proved=True)


@noun
class Curve:
    """What the points of a curve share: a problem without gains, the limits, about how many."""

    problem: Problem
    request: DesignRequest
    count: int
    progress: Progress

    def gains(self, own: Design) -> list[TradePoint]:
        """Designs for many rates, all with the pins of one."""
        index = self.problem.network.index
        pinned = tuple(sorted(index[label] for label in own.gains)) or self.request.allowed
        found = list[TradePoint]()
        for rate in _spread(own.rate or 0.0, FASTEST, self.count):
            asked = replace(self.request, rate=rate, allowed=pinned)
            each = attempt(self.problem, asked, self.progress)
            if each.is_proved and each.cost is not None:
                cost = float(each.cost)
                point = TradePoint(x=float(rate), y=cost, pinned=tuple(each.gains), proved=True)
                found.append(point)
        return found

    def pins(self, observer: ObserverDesign | None) -> list[TradePoint]:
        """The rate that gains approach on growing sets of agents, as floating point sees it."""
        request = self.request
        labels = self.problem.network.labels
        structure = structure_of(self.problem, request.allowed)
        if structure.unmet is not None:
            text = "allowed must leave every group that listens to nobody outside an agent to pin."
            cure = "dobc_design.design says which agents are missing."
            raise SpecError(text, key="allowed", cure=cure)
        search = region_search(self.problem, request, observer)
        most = len(request.allowed) if request.pins is None else request.pins
        most = min(most, len(structure.agents) + self.count - 1)
        sets = PinSets(structure=structure, allowed=request.allowed, search=search)
        found = list[TradePoint]()
        for pinned in sets.growing(most, one_by_one=True):
            self.progress(f"{len(pinned)} pinned agents")
            rate = search.fastest(pinned)
            if 0 < rate < math.inf:
                names = tuple(labels[i] for i in pinned)
                found.append(TradePoint(x=float(len(pinned)), y=rate, pinned=names))
        return found

    def noise(self, observer: ObserverDesign | None) -> list[TradePoint]:
        """Observers for many rates: how they pass on noise."""
        pace = 1.0 if observer is None else observer.measures.get("rate", 1.0)
        found = list[TradePoint]()
        for rate in _spread(pace, QUICKEST, self.count):
            found += _noise_point(observer_at(self.problem, self.request, rate))
        return sorted(found, key=lambda point: point.x)


def _noise_point(observer: ObserverDesign) -> list[TradePoint]:
    pace = observer.measures.get("rate")
    noise = observer.measures.get("hinf measurement")
    if noise is None or pace is None:
        return []
    return [TradePoint(x=pace, y=noise, proved=True)]


def _spread(middle: float, last: float, count: int) -> list[Fraction]:
    """Rates (1/s) of four digits around one; none around 0."""
    if middle <= 0:
        return []
    parts = (SLOWEST + (last - SLOWEST) * k / (count - 1) for k in range(count))
    return [claimed(float(f"{middle * part:.4g}")) for part in parts]
