"""Leaders: the target as a solution s of s' = A s, or s' = f(s), the dynamics of the agents without
their inputs.

e_i = x_i - s - offset_i obeys the same equation for every s where the dynamics are linear.  Of f
only f(s + e) - f(s) enters, whose slopes are bounded over a box that s never leaves (theory,
section 13).
"""

from collections.abc import Iterator
from fractions import Fraction
from functools import lru_cache
from math import ceil, floor, log10
from typing import Any

from dobc_design._checks import later, noun
from dobc_design._show.cards import Shown
from dobc_design.coupling.tree import IntervalAlgebra, Node, evaluate
from dobc_design.errors import wrong
from dobc_design.exact.interval import Box, Interval, UndefinedError
from dobc_design.exact.number import number_text
from dobc_design.exact.reading import is_list, keyed

from .dynamics import Dynamics, expressions_of
from .region import Pairs, read_pairs

_MOST_PIECES = 1000  # of a face, on which the sign of a component of f is decided
_MOST_MOVES = 80  # of the faces, each by an eighth of the width
_PART = 8


@noun
class Leader(Shown):
    """The target moves: it is a solution s of s' = A s, or f(s), of the [dynamics].  Agents that
    are pinned know s.

    ``initial``: lo_c <= s_c(0) <= hi_c, m pairs.  ``stays_in``: m pairs, with f only, a box that s
    never leaves; it is looked for where it is not given, and proved in both cases.
    """

    initial: Pairs
    stays_in: Pairs | None = later()


def read_leader(value: Any, *, dynamics: Dynamics | None) -> Leader | None:
    """Read the [leader] table.  Raises: SpecError naming the key."""
    if value is None:
        return None
    if dynamics is None:
        raise wrong(
            "leader",
            "needs [dynamics]: a leader moves as agents do without inputs, and those with x' = "
            "u then stand still.",
            "For a target that moves at constant speed make the speed a state: in "
            "[dynamics] A = [[0, 1], [0, 0]] and "
            'B = [[0], [1]], in [coupling] an h of both states such as h = "10*y1 + '
            '10*y2", and in [leader] initial = '
            "[[0, 0], [1, 1]], position and speed. For a target that stands still write "
            "target in place of [leader].",
        )
    given, kept = keyed(value, ("initial", "stays_in"), key="leader")
    initial = _read_box(given, "leader.initial", dynamics.dimension)
    if kept is None:
        return Leader(initial=initial)
    if dynamics.A is not None:
        raise wrong(
            "leader.stays_in",
            "is for agents with f only.",
            "Leave it out: with A the errors do not depend on where the leader is.",
        )
    stays_in = _read_box(kept, "leader.stays_in", dynamics.dimension)
    if not all(a <= lo and hi <= b for (lo, hi), (a, b) in zip(initial, stays_in, strict=True)):
        raise wrong(
            "leader.stays_in",
            "must hold leader.initial, where the leader starts.",
            "Make it larger.",
        )
    return Leader(initial=initial, stays_in=stays_in)


def _read_box(value: Any, key: str, m: int) -> Pairs:
    """m pairs; a number stands for a point, and for m = 1 one pair for itself."""
    alone = not is_list(value) or (m == 1 and len(value) == 2 and not any(map(is_list, value)))
    rows = [each if is_list(each) else [each, each] for each in ([value] if alone else value)]
    return read_pairs(rows, key=key, dimension=m)


@lru_cache(maxsize=64)
def enclosure(dynamics: Dynamics, leader: Leader) -> Box | None:
    """A box with ``initial`` that no solution of s' = f(s) leaves, proved: the given one, or one
    that is found with the faces of ``initial`` moved outwards; None if that is not shown, or not
    found."""
    if leader.stays_in is not None:
        box = _box(leader.stays_in)
        return None if any(open_faces(dynamics, box)) else box
    box = _box(leader.initial)
    for _ in range(_MOST_MOVES):
        faces = list(open_faces(dynamics, box))
        if not faces:
            return box
        sides = list(box)
        for c, upper in faces:
            # A face moves by a part of the width, to a round number, as a person would write.
            step = max(sides[c].width, abs(sides[c].midpoint) / 10, Fraction(1, 100)) / _PART
            unit = Fraction(10) ** floor(log10(step))
            farther = (
                ceil((sides[c].hi + step) / unit) if upper else floor((sides[c].lo - step) / unit)
            )
            sides[c] = sides[c].hull(Interval.point(farther * unit))
        box = tuple(sides)
    return None


def enclosed(leader: Leader | None, dynamics: Dynamics | None) -> Leader | None:
    """The leader with the box that it stays in, where slopes of f move with it and a box is given
    or found."""
    if leader is None or dynamics is None or leader.stays_in:
        return leader
    target = (Fraction(0),) * dynamics.dimension  # beside which a leader moves
    if dynamics.about(target)[1] is None:
        return leader
    box = enclosure(dynamics, leader)
    if box is None:
        return leader
    return Leader(initial=leader.initial, stays_in=tuple((x.lo, x.hi) for x in box))


def open_faces(dynamics: Dynamics, box: Box) -> Iterator[tuple[int, bool]]:
    """The faces (component, whether it is the upper one) on which f is not shown to point inwards
    or along them.

    Without one no solution leaves the box (Nagumo), if f is Lipschitz near it: what uses the box
    bounds the slopes of f on more than it."""
    for c, each in enumerate(expressions_of(dynamics)):
        for upper, end in ((False, box[c].lo), (True, box[c].hi)):
            if not _points_inwards(
                each.node, (*box[:c], Interval.point(end), *box[c + 1 :]), -1 if upper else 1
            ):
                yield c, upper


def _points_inwards(node: Node, face: Box, sign: int) -> bool:
    """Whether sign times an expression is at least 0 on a box, proved by parts."""
    parts, pieces = [face], 0
    while parts:
        part = parts.pop()
        if _least(node, part, sign) >= 0:
            continue
        pieces += 1
        # If the sign is wrong at a point, no finer division can prove it.
        middle = tuple(Interval.point(x.midpoint) for x in part)
        widest = max(range(len(part)), key=[x.width for x in part].__getitem__)
        if pieces > _MOST_PIECES or not part[widest].width or _least(node, middle, sign) < 0:
            return False
        parts += [(*part[:widest], half, *part[widest + 1 :]) for half in part[widest].halves()]
    return True


def _least(node: Node, part: Box, sign: int) -> Fraction:
    try:
        value: Interval = evaluate(node, part, IntervalAlgebra()) * sign
    except UndefinedError:
        return Fraction(-1)
    return value.lo


def not_enclosed(dynamics: Dynamics, leader: Leader) -> str:
    """Why there is no box, as a sentence."""
    if leader.stays_in is None:
        return "the leader's solution could not be enclosed in a box; give [leader] stays_in."
    c, upper = next(open_faces(dynamics, _box(leader.stays_in)))
    face = f"x{c + 1} = {number_text(leader.stays_in[c][upper])}"
    return (
        f"[leader] stays_in is not shown to be invariant: on its face {face} f may point outwards."
    )


def _box(pairs: Pairs) -> Box:
    return tuple(Interval(lo, hi) for lo, hi in pairs)
