"""The largest numbers that given weights v prove: the rate, and the longest delay beside it.

Both are searches.  What they find is what ``decide`` and ``timing`` have proved on the way, up to a
rounding that makes it smaller; a check decides it once more.
"""

import heapq
import math
from bisect import bisect_left
from contextlib import suppress
from fractions import Fraction

import numpy as np

from dobc_design.conditions.numbers import rounded_down
from dobc_design.coupling.enclosures import slope_bound
from dobc_design.exact.floats import Floats
from dobc_design.exact.interval import Interval, UndefinedError
from dobc_design.exact.matrix import Vector
from dobc_design.exact.symmetric import Doubles
from dobc_design.exact.work import spend
from dobc_design.loop.loop import Loop

from .claim import (
    EXACT,
    FACES,
    DelayBound,
    Errors,
    Separable,
    holding_gains,
    rows,
)
from .decide import (
    MOST_LEFT,
    MOST_PIECES,
    FaceRow,
    Many,
    Question,
    ask,
    first_failure,
    in_arrays,
    lower_bound,
    upper_bound,
)
from .large import Piece, open_rows
from .timing import verify_delay

# how far below the largest rate ``largest_rate`` may stop, as a part of it
TOLERANCE = Fraction(1, 10**5)
# below an estimate, where the proof is tried
_PARTS = (1e-8, 1e-6, 1e-5, 1e-4, 3e-4, 1e-3, 1e-2, 0.1, 0.5)
_SAMPLES = (0.0, 0.125, 0.25, 0.5, 0.75, 1.0)  # parts of rho at which a rate is estimated
_SHORTER = 60  # delays that are tried, each half of the one before


def largest_rate(
    loop: Loop, v: Vector | Doubles, *, rho: Fraction | None, errors: Errors = EXACT
) -> Fraction | None:
    """The largest alpha (1/s, nine digits), about, that v is proved to have for all s in (0, rho];
    None if none > 0."""
    question = ask(loop, v, rho=rho, errors=errors)
    if isinstance(question, str):
        return None
    many = in_arrays(question)
    if many is not None:
        return _rate_of_many(question, many)
    rate = _rate_limit(question)
    for row, _ in rows(loop, v, errors=errors):
        for face in FACES:
            on_face = FaceRow(row, face, question.profiles)
            if rho is None:
                found = row.pull - on_face.linear_bound() / row.own
            else:
                found = _row_rate(on_face, rho=rho, enough=rate)
            rate = min(rate, found)
            if rate <= 0:
                return None
    return rounded_down(rate) or None


def _rate_limit(question: Question) -> Fraction:
    """A number that no rate exceeds: the agent with the least v has no more than what its pin is
    worth, since the others pull it outward or not at all."""
    loop = question.loop
    worth = list(holding_gains(loop))
    # Of one mode at a time: a row has the fixed nodes that are heard in it.
    held = [worth]
    for arcs in loop.modes.values() if loop.fixed else ():
        more = list(worth)
        for agent, speaker, weight in arcs.where(arcs.speakers >= loop.n):
            kind = question.profiles[loop.place_of(agent, speaker)]
            steepest = slope_bound(kind.curve, Interval(-kind.radius, kind.radius))
            more[agent] += weight * steepest
        held.append(more)
    return max(map(max, held))


def _rate_of_many(question: Question, many: Many) -> Fraction | None:
    """The same in floats, rates below an estimate one after the other."""
    estimate = estimated_rate(question, many)
    if not (estimate > 0 and math.isfinite(estimate)):
        return None
    for part in _PARTS:
        alpha = rounded_down(Fraction(estimate * (1 - part)))
        left = open_rows(many.arcs, many.kinds, alpha=alpha, rho=question.radius)
        # many rows that are left say that the rate is too large, not that floats are too coarse
        if len(left) > MOST_LEFT * len(question.loop.modes):
            continue
        claim = Separable(v=question.v, alpha=alpha, rho=question.rho)
        if first_failure(question, claim, left) is None:
            return alpha
    return None


def estimated_rate(question: Question, many: Many) -> float:
    """The least rate that a few values of s show: an estimate of the largest that can be proved."""
    arcs = many.arcs
    rho = float(question.radius)
    pulls = np.array(arcs.pulls, dtype=float)
    least = np.inf
    with np.errstate(invalid="ignore", over="ignore"):
        for face in FACES:
            piece = Piece(arcs, face, many.kinds, np.arange(len(pulls)))
            for part in _SAMPLES:
                rates = pulls - piece.at(part * rho) / arcs.own[1]
                least = min(least, float(np.min(rates)))
    return least


def _row_rate(on_face: FaceRow, *, rho: Fraction, enough: Fraction) -> Fraction:
    """A rate alpha for which the row holds, about the part TOLERANCE below the largest; or one
    above ``enough``."""
    row = on_face.row
    whole = Interval(Fraction(0), rho)
    steepest = sum(term.weight * term.reach for term in row.terms) / row.own
    unsure = (row.pull + steepest) / 10**12
    # beyond the floats, or nearer to a number of nine digits than they can tell: exactly
    with suppress(UndefinedError):
        rate = _rate_on(Floats.around(whole), on_face, enough=enough)
        if rate >= enough or rounded_down(rate) == rounded_down(rate + unsure):
            return rate
    return _rate_on(whole, on_face, enough=enough)


def _rate_on(S: Interval, on_face: FaceRow, *, enough: Fraction) -> Fraction:
    """The same with the arithmetic of S: the piece with the largest bound is halved until that is
    about attained at some s."""
    row = on_face.row
    sides = on_face.sides(S)
    price = on_face.price
    count = 0  # which also tells pieces with the same bound apart
    heap = [(-upper_bound(sides, S).hi, count, S)]
    attained = lower_bound(sides, S.ends()[1])
    while True:
        top, _, S = heap[0]
        rate = row.pull + top / row.own
        slack = TOLERANCE * max(abs(row.pull * row.own - attained), row.own * TOLERANCE)
        if rate >= enough or -top - attained <= slack or count >= MOST_PIECES:
            return rate
        spend(2 * price)
        heapq.heappop(heap)
        attained = max(attained, lower_bound(sides, S.middle()))
        for half in S.halves():
            count += 1
            heapq.heappush(heap, (-min(upper_bound(sides, half).hi, -top), count, half))


def longest_delay(loop: Loop, claim: Separable, *, rate: Fraction) -> DelayBound | None:
    """A long delay (s, one digit) for which ``claim`` is proved to keep ``rate`` (1/s); None if
    there is none."""
    delays = [rounded_down(1 / rate, digits=1)]
    while len(delays) < _SHORTER:
        delays.append(rounded_down(delays[-1] / 2, digits=1))
    bounds = [DelayBound(delay=delay, rate=rate) for delay in delays]
    first = bisect_left(
        bounds, True, key=lambda bound: verify_delay(loop, claim, bound).wrong is None
    )
    return bounds[first] if first < len(bounds) else None
