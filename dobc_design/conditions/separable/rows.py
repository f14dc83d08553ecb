"""Rows of the max-separable certificate, decided for all s in (0, rho] by enclosures and subdivision of s.

Divided by s a row asks  sum_j w phi_j(s) <= (k_i - alpha) v_i  with phi(s) = sup { h(s t)/s : -reach <= t <= step }.
Where h is nondecreasing that is step g(s step), g the secant gain; else h's turning points count as well.
Theory, section 5.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Final

from dobc_design.conditions.separable.claim import Row, Term
from dobc_design.coupling.enclosures import Cell, Profile, jet, secant
from dobc_design.exact.interval import Interval
from dobc_design.verdict import Verdict

# Pieces of (0, rho] looked at per row before the answer is "undecided".
MOST_PIECES: Final = 3000
_ZERO: Final = Fraction(0)


@dataclass(frozen=True, slots=True)
class RowAnswer:
    """Whether a row holds; ``s`` is where it fails (refuted) or could not be decided."""

    verdict: Verdict
    s: Fraction | None = None


def decide_row(row: Row, face: int, profiles: Sequence[Profile], *, alpha: Fraction, rho: Fraction) -> RowAnswer:
    """Decide the row for all s in (0, rho]: proved, refuted at one s, or undecided."""
    limit = (row.gain - alpha) * row.own
    waiting = [Interval(_ZERO, rho)]
    count = 0
    while waiting:
        S = waiting.pop()
        count += 1
        if upper_bound(row, face, profiles, S) <= limit:
            continue
        for s in (S.hi, S.midpoint):
            if lower_bound(row, face, profiles, s) > limit:
                return RowAnswer(Verdict.REFUTED, s)
        if count >= MOST_PIECES:
            return RowAnswer(Verdict.UNDECIDED, S.midpoint)
        waiting += S.halves()
    return RowAnswer(Verdict.PROVED)


def row_rate(
    row: Row, face: int, profiles: Sequence[Profile], *, rho: Fraction, enough: Fraction, tolerance: Fraction
) -> Fraction:
    """A rate alpha for which the row holds, about the part ``tolerance`` below the largest; or one above ``enough``."""
    S = Interval(_ZERO, rho)
    heap = [(-upper_bound(row, face, profiles, S), 0, S)]
    attained = lower_bound(row, face, profiles, rho)
    count = 0
    while True:
        top, _, S = heap[0]
        rate = row.gain + top / row.own
        slack = tolerance * max(abs(row.gain * row.own - attained), row.own * tolerance)
        if rate >= enough or -top - attained <= slack or count >= MOST_PIECES:
            return rate
        heapq.heappop(heap)
        attained = max(attained, lower_bound(row, face, profiles, S.midpoint))
        for half in S.halves():
            count += 1
            heapq.heappush(heap, (-min(upper_bound(row, face, profiles, half), -top), count, half))


def linear_bound(row: Row, face: int, profiles: Sequence[Profile]) -> Fraction:
    """An upper bound of sum w phi for linear couplings, where phi does not depend on s; exact if slopes are."""
    total = _ZERO
    for term in row.terms:
        slope = jet(profiles[term.coupling].curve, Interval.point(0)).slope
        total += term.weight * max((slope * term.step).hi, (slope * -term.reach).hi)
    return total


def upper_bound(row: Row, face: int, profiles: Sequence[Profile], S: Interval) -> Fraction:
    """A bound that sum w phi(s) does not exceed for s in S, s > 0."""
    rising: list[Term] = []
    others = _ZERO
    for term in row.terms:
        if _rises(profiles[term.coupling], face, term, S):
            rising.append(term)
        else:
            others += term.weight * _largest(profiles[term.coupling], face, term, S)
    total, change = Interval.point(0), Interval.point(0)
    smooth = not S.is_point
    for term in rising:
        if not term.step:
            continue
        found = secant(profiles[term.coupling].curve, S * (face * term.step))
        total += found.value * (term.weight * term.step)
        if smooth and found.slope is not None:
            change += found.slope * (face * term.weight * term.step**2)
        else:
            smooth = False
    bound = total.hi
    if smooth and change.lo >= 0:
        bound = min(bound, _at(rising, face, profiles, S.hi).hi)
    elif smooth and change.hi <= 0:
        bound = min(bound, _at(rising, face, profiles, S.lo).hi)
    elif smooth:
        middle = S.midpoint
        bound = min(bound, (_at(rising, face, profiles, middle) + change * (S - middle)).hi)
    return bound + others


def lower_bound(row: Row, face: int, profiles: Sequence[Profile], s: Fraction) -> Fraction:
    """A bound that sum w phi(s) is at least at this s > 0: phi is no less than what h takes at the ends."""
    total = _ZERO
    for term in row.terms:
        kind = profiles[term.coupling]
        ends = [_secant_times(kind, face, t, Interval.point(s)).lo for t in (term.step, -term.reach)]
        inside = (
            cell.values.lo / s if face > 0 else -cell.values.hi / s
            for cell in _turns(kind, face)
            if -s * term.reach <= _mirrored(cell, face).lo and _mirrored(cell, face).hi <= s * term.step
        )
        total += term.weight * max(*ends, *inside)
    return total


def _at(terms: Sequence[Term], face: int, profiles: Sequence[Profile], s: Fraction) -> Interval:
    """Sum of w step g(s step) at one s >= 0."""
    total = Interval.point(0)
    for term in terms:
        total += _secant_times(profiles[term.coupling], face, term.step, Interval.point(s)) * term.weight
    return total


def _secant_times(kind: Profile, face: int, t: Fraction, S: Interval) -> Interval:
    """t g(s t) for s in S, for h or for -h(-y): the value h(s t)/s."""
    return secant(kind.curve, S * (face * t)).value * t if t else Interval.point(0)


def _rises(kind: Profile, face: int, term: Term, S: Interval) -> bool:
    """Whether h (or -h(-y)) is nondecreasing on all of -s reach <= y <= s step, s in S."""
    if kind.is_nondecreasing:
        return True
    asked = _swept(term, S)
    return all(cell.direction > 0 or not _overlap(_mirrored(cell, face), asked) for cell in kind.cells)


def _largest(kind: Profile, face: int, term: Term, S: Interval) -> Fraction:
    """An upper bound of phi on S where h may turn: both ends, and every place where it may have a maximum."""
    whole = Interval(-term.reach, term.step)
    natural = (secant(kind.curve, S * whole * face).value * whole).hi
    if not S.lo and any(_mirrored(cell, face).contains(0) for cell in _turns(kind, face)):
        return natural
    bounds = [_secant_times(kind, face, term.step, S).hi]
    left = Interval(-S.hi * term.reach, -S.lo * term.reach)
    if any(cell.direction < 0 and _overlap(_mirrored(cell, face), left) for cell in kind.cells):
        bounds.append(_secant_times(kind, face, -term.reach, S).hi)
    for cell in _turns(kind, face):
        when = _within(_mirrored(cell, face), term, S)
        if when is not None:
            values = cell.values if face > 0 else -cell.values
            bounds.append((values / when).hi)
    return min(natural, max(bounds))


def _within(place: Interval, term: Term, S: Interval) -> Interval | None:
    """The s > 0 of S for which ``place`` may meet -s reach <= y <= s step; None if there are none."""
    lo, hi = S.lo, S.hi
    if place.lo > 0:
        if term.step <= 0:
            return None
        lo = max(lo, place.lo / term.step)
    elif place.hi < 0:
        lo = max(lo, -place.hi / term.reach)
        if term.step < 0:
            hi = min(hi, place.lo / term.step)
    return Interval(lo, hi) if lo <= hi else None


def _turns(kind: Profile, face: int) -> tuple[Cell, ...]:
    return kind.tops if face > 0 else kind.bottoms


def _mirrored(cell: Cell, face: int) -> Interval:
    return cell.place if face > 0 else -cell.place


def _swept(term: Term, S: Interval) -> Interval:
    ends = (S.lo * term.step, S.hi * term.step)
    return Interval(-S.hi * term.reach, max(ends))


def _overlap(left: Interval, right: Interval) -> bool:
    return left.lo <= right.hi and right.lo <= left.hi
