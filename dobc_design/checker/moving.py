"""Rows of boxes that move: for settling times and for weights that move from mode to mode."""

from collections.abc import Iterator
from fractions import Fraction
from typing import Any, NamedTuple

from .expressions import Coupling
from .files import Problem
from .intervals import by_decimal, enclosed, negative, times, total
from .matrices import ZERO
from .separable import Curve, Term, on_pieces, supremum

TIMES = 2000  # of a tube at most
HALVINGS = 12  # of a segment
LONGEST = Fraction(16_000)

Box = list[Fraction]


class Face(NamedTuple):
    """A face of the box, the one across, and its speed, on a part of a segment: at its two ends."""

    own: tuple[Box, Box]
    other: tuple[Box, Box]
    speed: Box


def fading(x: Fraction) -> Fraction:
    """An upper bound of exp(-x) for x >= 0; beyond LONGEST it is not followed: it is smaller."""
    return by_decimal("exp", (-min(x, LONGEST),) * 2)[1]


def shown(
    p: Problem,
    arcs: Any,
    i: int,
    face: Face,
    loads: tuple[Fraction, Fraction],
    curves: dict[tuple[Coupling, bool], Curve],
    mirrored: bool,
    halvings: int,
    rho: Fraction = ZERO,
) -> bool:
    """Whether a row holds on a part of a segment, whole or in halves: what drives e_i outward on the face is at most
    the speed of the face; with ``rho`` for the box times every s of (0, rho]."""
    held = min(p.least_gain(i) * box[i] for box in face.own)
    room, terms, slopes = held + face.speed[i] - max(loads), list[Term](), ZERO
    for arc in arcs:
        step = max(own[arc.j] - own[i] for own in face.own)
        reach = max(other[arc.j] + own[i] for own, other in zip(face.own, face.other, strict=True))
        p_side, q_side = ((enclosed(x)[1],) * 2 for x in (max(reach, -step), step))
        terms.append((curves[arc.coupling, mirrored], enclosed(arc.w), p_side, q_side))
        slopes += arc.w * max(g * x for g in arc.coupling.slope(0, 0) for x in (step, -reach))
    if all(arc.coupling.straight for arc in arcs):
        holds = slopes <= room
    elif rho:
        holds = on_pieces(terms, enclosed(room), (0.0, 0.0), enclosed(rho)[1])
    else:
        most = [(w, supremum(curve, low, high, 1.0, 1.0).at(1.0)) for curve, w, low, high in terms]
        holds = total([negative(enclosed(room)), *(times(w, (x, x)) for w, x in most)])[1] <= 0
    if holds:
        return True
    if not halvings:
        return False
    return all(shown(p, arcs, i, *part, curves, mirrored, halvings - 1, rho) for part in halves(face, loads))


def halves(face: Face, loads: tuple[Fraction, Fraction]) -> Iterator[tuple[Face, tuple[Fraction, Fraction]]]:
    """The two halves of a part of a segment."""
    own, other = ([(a + b) / 2 for a, b in zip(*ends, strict=True)] for ends in (face.own, face.other))
    load = sum(loads, ZERO) / 2
    yield Face((face.own[0], own), (face.other[0], other), face.speed), (loads[0], load)
    yield Face((own, face.own[1]), (other, face.other[1]), face.speed), (load, loads[1])
