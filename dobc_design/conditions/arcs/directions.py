"""Whether the term of an arc is nonnegative on its disc: float arithmetic with outward bounds.

Theory, section 20.  An arc i <- j with the numbers a, b asks on d_i x^2 + d_j y^2 <= rho^2 for

    a x^2 + b y^2 - 2 d_i w x h(y - x) >= 0

With h(y - x) = g (y - x) both sides scale with the length of (x, y), so that only directions are
subdivided, and g is any secant gain of h as far out as the disc reaches in that direction.  What
remains on a piece is a quadratic polynomial with one of the ends of g.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from dobc_design._checks import noun
from dobc_design.conditions.separable.large import GainTable, down, up
from dobc_design.exact.matrix import Array
from dobc_design.exact.work import spend
from dobc_design.problem.network import BoolArray, IndexArray

FIRST = 32  # pieces of each half of the directions, to begin with
NARROWEST = 2.0**-22
PIECES = 6000  # of one arc, at most
TOGETHER = 4096  # arcs that are looked at at once


@noun(eq=False)
class Terms:
    """Arcs with one coupling in floats: the numbers a, b of the claim, the pull 2 d_i w, and d of
    the agent and of the one that it hears; each from below, the pull from above as well."""

    a: Array
    b: Array
    pull: Array
    strongest: Array
    own: Array
    other: Array

    def some(self, place: IndexArray) -> Terms:
        """Those at these places."""
        return Terms(**{name: getattr(self, name)[place] for name in TERMS})


TERMS = ("a", "b", "pull", "strongest", "own", "other")


class Half(NamedTuple):
    """Directions (x, y) by one number s >= 0: the polynomial alpha s^2 + beta s + gamma that has to
    be nonnegative from below, and how far |y - x| may be on a piece."""

    end: float
    polynomial: Callable[..., tuple[Array, Array, Array]]
    reach: Callable[..., Array]


def _at_most(t: Terms, gain: Array) -> Array:
    """At most pull gain."""
    return down(np.where(gain >= 0, t.pull, t.strongest) * gain)


# x = 1, y = 1 - s, s in [0, 2]: a + b (1 - s)^2 + c s with c = 2 d w g, least where g is
def _towards_agent(t: Terms, least: Array, most: Array) -> tuple[Array, Array, Array]:
    c = _at_most(t, least)
    return t.b, down(c - 2 * t.b), down(t.a + t.b)


def _reach_agent(t: Terms, s0: Array, s1: Array, rho: float) -> Array:
    # |1 - s| is smallest at an end, or is 0 in between
    near = np.where((s0 <= 1) & (s1 >= 1), 0.0, np.minimum(np.abs(1 - s0), np.abs(1 - s1)))
    return _over(rho * s1, down(t.own + down(t.other * down(near * near))))


# x = -s, y = 1, s in [0, 1]: a s^2 + b + c s (1 + s)
def _apart(t: Terms, least: Array, most: Array) -> tuple[Array, Array, Array]:
    c = _at_most(t, least)
    return down(t.a + c), c, t.b


def _reach_apart(t: Terms, s0: Array, s1: Array, rho: float) -> Array:
    return _over(rho * (1 + s1), down(down(t.own * down(s0 * s0)) + t.other))


# x = s, y = 1, s in [0, 1]: a s^2 + b - c s (1 - s), least where g is largest
def _towards_other(t: Terms, least: Array, most: Array) -> tuple[Array, Array, Array]:
    c = -_at_most(t, -most)
    return down(t.a + c), -c, t.b


def _reach_other(t: Terms, s0: Array, s1: Array, rho: float) -> Array:
    return _over(rho * (1 - s0), down(down(t.own * down(s0 * s0)) + t.other))


def _over(length: Array, square: Array) -> Array:
    """At least length / sqrt(square)."""
    root = down(np.sqrt(square))
    # No root is trusted: one that is not below is made smaller until it is.
    root = np.where(up(root * root) <= square, root, root * (1 - 2.0**-40))
    return np.where(up(root * root) <= square, up(up(length) / root), np.inf)


HALVES = (
    Half(2.0, _towards_agent, _reach_agent),
    Half(1.0, _apart, _reach_apart),
    Half(1.0, _towards_other, _reach_other),
)


def at_least(alpha: Array, beta: Array, gamma: Array, s0: Array, s1: Array) -> Array:
    """A lower bound of alpha s^2 + beta s + gamma on [s0, s1], s0 >= 0."""
    ends = np.minimum(_at(alpha, beta, gamma, s0), _at(alpha, beta, gamma, s1))
    bottom = down(4 * alpha)
    with np.errstate(divide="ignore", invalid="ignore"):
        lowest = down(gamma - up(up(beta * beta) / bottom))
    lowest = np.where(bottom > 0, lowest, -np.inf)
    # the lowest point may lie inside
    outside = (up(2 * alpha * s1) + beta < 0) | (down(2 * alpha * s0) + beta > 0)
    inside = (alpha > 0) & ~outside
    return np.where(inside, np.minimum(ends, lowest), ends)


def _at(alpha: Array, beta: Array, gamma: Array, s: Array) -> Array:
    return down(down(down(down(alpha * s) + beta) * s) + gamma)


def open_arcs(terms: Terms, table: GainTable, rho: Fraction) -> BoolArray:
    """Which arcs are not shown to take at most their numbers on their discs.  Raises:
    WorkLimitError."""
    far = float(up(np.array(float(rho))))
    found = np.zeros(len(terms.a), dtype=bool)
    for first in range(0, len(terms.a), TOGETHER):
        place = np.arange(first, min(first + TOGETHER, len(terms.a)))
        for half in HALVES:
            found[place] |= _fails(terms.some(place), table, far, half)
    return found


def gains_within(table: GainTable, far: Array) -> tuple[Array, Array]:
    """Bounds of g on [-far, far]: of whole cells, and at the ends where g turns in none of their
    cells."""
    # at least the cell before that of far, however both are rounded
    inner = np.maximum(far - (1 - 2.0**-20) * table.width, 0.0)
    whole = table.over(-inner, inner)
    least, most = whole.least, whole.most
    for end in (far, -far):
        cell = table.cell(end)
        low, high = table.at(end)
        _, highest, falls, rises = (table.ranges[k, 0, cell] for k in range(4))
        turns = (falls > 0) & (rises > 0) | (far <= table.width)
        least = np.minimum(least, np.where(turns, -table.ranges[0, 0, cell], low))
        most = np.maximum(most, np.where(turns, highest, high))
    return least, most


def _fails(terms: Terms, table: GainTable, rho: float, half: Half) -> BoolArray:
    """Which arcs are not shown on a half of the directions."""
    count = len(terms.a)
    bad = np.zeros(count, dtype=bool)
    pieces = np.zeros(count, dtype=np.int64)
    cuts = np.linspace(0, half.end, FIRST + 1)
    arc = np.repeat(np.arange(count), FIRST)
    s0 = np.tile(cuts[:-1], count)
    s1 = np.tile(cuts[1:], count)
    while len(arc):
        spend(1 + len(arc) // 10_000)
        np.add.at(pieces, arc, 1)
        some = terms.some(arc)
        # The table reaches as far as the discs do.
        far = np.minimum(half.reach(some, s0, s1, rho), table.radius)
        alpha, beta, gamma = half.polynomial(some, *gains_within(table, far))
        shown = at_least(alpha, beta, gamma, s0, s1) >= 0
        # A narrow piece, or one of very many, decides.
        narrow = (s1 - s0 <= NARROWEST) | (pieces[arc] > PIECES)
        bad[arc[~shown & narrow]] = True
        left = ~shown & ~bad[arc]
        arc, s0, s1 = arc[left], s0[left], s1[left]
        middle = (s0 + s1) / 2
        arc = np.concatenate([arc, arc])
        s0, s1 = np.concatenate([s0, middle]), np.concatenate([middle, s1])
    return bad
