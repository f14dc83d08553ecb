"""The nearest possible requests for gains: more agents allowed, more pins, larger caps, a lower rate.

How far each limit is given up is a guess in floating point; the design for it is decided as any other.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction

from dobc_design.conditions.numbers import claimed, shorten
from dobc_design.synthesis.pinning.bound import Ground
from dobc_design.synthesis.pinning.choice import PinningProposals
from dobc_design.synthesis.pinning.request import FEWEST, PinningRequest
from dobc_design.synthesis.pinning.structure import structure_of


def weaker_requests(ground: Ground, proposals: PinningProposals, kind: str | None) -> Iterator[PinningRequest]:
    """Requests with one thing given up as far as needed, what is binding first.

    ``kind``: what the refutation is about, "structure", "pins", "max_gain" or "rate"; None if nothing was refuted.
    """
    request = ground.request
    if kind == "structure":
        structure = structure_of(ground.problem, request.allowed)
        free = set(request.allowed)
        lacking = {i for group in structure.groups if not free & set(group) for i in group}
        request = replace(request, allowed=tuple(sorted(free | lacking)))
        yield request
        yield replace(request, pins=None if request.pins is None else FEWEST)
    if kind == "pins":
        yield replace(request, pins=FEWEST)
    if request.caps and (factor := _factor(request, proposals)) is not None:
        yield replace(request, caps={i: _rounded_up(cap * factor) for i, cap in request.caps.items()})
    fastest = proposals.fastest(request.allowed, 1.0)
    for part in (0.99, 0.9) if 0 < fastest < math.inf else ():
        rate = claimed(shorten(fastest * part, digits=3))
        if 0 < rate < request.rate:
            yield replace(request, rate=rate)
    if len(request.allowed) < ground.problem.n:
        yield replace(request, allowed=tuple(range(ground.problem.n)))


def _factor(request: PinningRequest, proposals: PinningProposals) -> Fraction | None:
    """By how much all caps must grow for the rate, about and a little more; None if that is of no use."""
    low, high, rate = 1.0, 1e6, float(request.rate)
    if not proposals.fastest(request.allowed, high) > rate:
        return None
    while high > low * 1.001:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if proposals.fastest(request.allowed, middle) > rate else (middle, high)
    return Fraction(high * 1.001)


def _rounded_up(value: Fraction) -> Fraction:
    unit = Fraction(10) ** (math.floor(math.log10(value)) - 3)
    return math.ceil(value / unit) * unit
