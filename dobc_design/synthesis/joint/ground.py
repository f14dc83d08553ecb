"""What a design is made with, and the observer gains for it, each designed when it is first asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from dobc_design.conditions.numbers import claimed
from dobc_design.problem.problem import Problem
from dobc_design.synthesis.joint.designed import Proof
from dobc_design.synthesis.joint.request import DesignRequest
from dobc_design.synthesis.observer.claim import ObserverDesign
from dobc_design.synthesis.pinning.design import PinningDesign
from dobc_design.synthesis.pinning.structure import Structure

SPEEDS = (1, 2, 4)  # of the observer, in units of the slowest that is worth trying
MARGIN = 3  # how much faster than the rate asked the observer is to be


@dataclass(frozen=True, slots=True, kw_only=True)
class Tools:
    """What a design is made with: ``certify(problem, everything=)``, ``observer(problem, rate=, noise=, digits=)`` and
    ``pinning(problem, rate=, region=, allowed=, max_gain=, pins=, digits=)``; ``progress`` is called with what is done.
    """

    certify: Callable[..., Proof]
    observer: Callable[..., ObserverDesign]
    pinning: Callable[..., PinningDesign]
    progress: Callable[[str], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Ground:
    """One request and its problem without W and gains; ``changes`` took the exosystem's hidden part out.

    ``part``: of the fastest rate, what is aimed at where no rate is asked for.
    """

    problem: Problem
    request: DesignRequest
    tools: Tools
    changes: Mapping[str, Any]
    decisions: tuple[str, ...]
    structure: Structure
    part: Fraction
    observers: list[ObserverDesign]

    def observer(self, place: int) -> ObserverDesign | None:
        """The gain number ``place``, slow ones first, each designed when it is first asked for; None if there is none.

        The first may be without a W: then it says why there is none.
        """
        if place == 0 and not self.observers:
            self.observers.append(_first_observer(self))
        while 0 < len(self.observers) <= place and self.observers[0].W is not None:
            faster = _faster_observer(self, SPEEDS[len(self.observers)])
            if faster is None:
                break
            self.observers.append(faster)
        return self.observers[place] if place < len(self.observers) else None

    def gains_of_observers(self) -> Iterator[ObserverDesign | None]:
        """All observers that there are; one None where the problem needs none."""
        if not self.problem.groups:
            yield None
            return
        for place in range(len(SPEEDS)):
            found = self.observer(place)
            if found is None or found.W is None:
                return
            yield found


@dataclass(frozen=True, slots=True, kw_only=True)
class Proposal:
    """W and gains (1/s, rounded) meant for the rate ``aim`` (1/s), with what is to be said of them."""

    observer: ObserverDesign | None
    gains: Mapping[int, Fraction]
    aim: float
    decisions: tuple[str, ...]
    prices: tuple[str, ...]


def _first_observer(ground: Ground) -> ObserverDesign:
    """The slowest observer worth trying: of the usual rate, or faster than the rate asked for."""
    problem, request, tools = ground.problem, ground.request, ground.tools
    tools.progress("designing the observer")
    noise = list(request.noise) or None
    first = tools.observer(problem, rate=None, noise=noise, digits=request.digits)
    if request.rate is None or first.W is None or _pace(first) >= MARGIN * request.rate:
        return first
    for rate in (MARGIN * request.rate, request.rate * Fraction(101, 100)):
        first = tools.observer(problem, rate=rate, noise=noise, digits=request.digits)
        if first.W is not None:
            break
    return first


def _faster_observer(ground: Ground, speed: int) -> ObserverDesign | None:
    """One that is ``speed`` times as fast as the first, where limits and hidden eigenvalues allow it."""
    rate = claimed(float(f"{float(_pace(ground.observers[0]) * speed):.3g}"))
    if rate <= 0:
        return None
    ground.tools.progress("designing a faster observer")
    noise = list(ground.request.noise) or None
    found = ground.tools.observer(ground.problem, rate=rate, noise=noise, digits=ground.request.digits)
    return None if found.W is None else found


def _pace(observer: ObserverDesign) -> Fraction:
    return claimed(observer.measures.get("rate", 0.0))
