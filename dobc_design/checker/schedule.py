"""settling: a box that moves holds every run, and hands over to a certificate near the target.

-lower <= e <= upper at every time of the tube, |C eps_i| <= root(size) disturbance exp(-beta t). From the end of the
tube on the size W of the certificate, V of max-separable or the root of V of lure, is at most level exp(-pace (t -
end)), and |e|_inf at most height W.
"""

from collections.abc import Iterator
from fractions import Fraction
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

from .expressions import Coupling
from .files import Certificate, Problem
from .intervals import by_decimal, enclosed, negative, times, total
from .margins import root
from .matrices import ZERO, identity, nonnegative, plus
from .quadratic import contained, inside, read_quadratic
from .reading import an_object, need, rational, read, text, weights
from .separable import Curve, Term, composite, on_pieces, pace, read_separable, rows, starts, supremum

TIMES = 2000  # of a tube at most
HALVINGS = 12  # of a segment
LONGEST = Fraction(16_000)

Box = list[Fraction]


class Face(NamedTuple):
    """A face of the box, the one across, and its speed, on a part of a segment: at its two ends."""

    own: tuple[Box, Box]
    other: tuple[Box, Box]
    speed: Box


def settling(case: Certificate, check: Any) -> None:
    """The tube holds all starts and its rows hold; its last box lies in the level of what takes over, in time."""
    p = case.problem
    need(check.rate is None, "it has no rate to claim")
    starts(case, check.domain, "box")
    tube: dict[str, Any] = {"times": [rational], "upper": [partial(weights, p.n)], "lower": [partial(weights, p.n)]}
    tube |= {"P": ((rational,) * p.q,) * p.q, "beta": rational, "size": rational} if p.q else {}
    last = dict.fromkeys(("level", "height", "stretch"), rational) | {"kind": text, "certificate": an_object}
    exact = read(check.exact, {"tolerance": rational, "time": rational, "tube": tube, "last": last})
    moves(case, exact.tube, check.domain)

    elapsed, after = exact.time - exact.tube.times[-1], exact.last
    need(elapsed >= 0, "the time is before the end of the tube")
    speed = takes_over(case, exact.tube, after, check.domain)
    need(
        after.height * after.level * fading(speed * elapsed) <= exact.tolerance, "the tolerance is not reached by then"
    )


def fading(x: Fraction) -> Fraction:
    """An upper bound of exp(-x) for x >= 0; beyond LONGEST it is not followed: it is smaller."""
    return by_decimal("exp", (-min(x, LONGEST),) * 2)[1]


def noise(case: Certificate, tube: Any, box: Any, time: Fraction) -> Fraction:
    """An upper bound of |C eps_i| from a time on, and of root(eps_i'P eps_i)."""
    return root(tube.size) * box.disturbance * fading(tube.beta * time) if case.problem.q else ZERO


def moves(case: Certificate, tube: Any, box: Any) -> None:
    """The first box holds all starts, and no run leaves the boxes that follow."""
    p, count = case.problem, len(tube.times)
    need(1 <= count <= TIMES and tube.times[0] == 0, "times do not begin at 0, or are too many")
    need(all(a < b for a, b in pairwise(tube.times)), "times do not rise")
    need(len(tube.upper) == len(tube.lower) == count, "there is not one box for each time")
    composite(case, tube)
    need(p.q == 0 or tube.beta > 0, "beta is not positive")
    need(min(tube.upper[0] + tube.lower[0]) >= box.radius, "the first box does not hold all starts")
    mixed = any(x for gain in p.gains.values() for c, row in enumerate(gain) for d, x in enumerate(row) if c != d)
    need(not mixed or tube.upper == tube.lower, "gains mix components, and the faces are not alike")
    if count == 1:
        return

    reach = enclosed(2 * max(x for face in (tube.upper, tube.lower) for x in map(max, face)))[1]
    couplings = {arc.coupling for heard in p.heard.values() for arcs in heard for arc in arcs}
    curves = {(h, mirrored): Curve(h, mirrored, -reach, reach) for h in couplings for mirrored in (False, True)}
    loads = [noise(case, tube, box, time) for time in tube.times]
    for k in range(count - 1):
        length = tube.times[k + 1] - tube.times[k]
        for own, other, mirrored in ((tube.upper, tube.lower, False), (tube.lower, tube.upper, True)):
            speed = [(b - a) / length for a, b in zip(own[k], own[k + 1], strict=True)]
            face = Face((own[k], own[k + 1]), (other[k], other[k + 1]), speed)
            open_rows = [(heard[i], i) for heard in p.heard.values() for i in range(p.n)]
            for arcs, i in open_rows:
                held = shown(p, arcs, i, face, (loads[k], loads[k + 1]), curves, mirrored, HALVINGS)
                need(held, f"the row of agent {p.labels[i]} is not shown from {float(tube.times[k])} s on")


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


def takes_over(case: Certificate, tube: Any, last: Any, box: Any) -> Fraction:
    """The certificate at the end of the tube holds, and the last box lies in its level; its rate."""
    p, quadratic = case.problem, last.kind == "quadratic"
    need(last.kind in ("max-separable", "quadratic"), "the kind is neither max-separable nor quadratic")
    need(last.level > 0 and last.height > 0 and last.stretch > 0, "a size is not positive")
    widths = list(map(max, tube.upper[-1], tube.lower[-1]))
    left = noise(case, tube, box, tube.times[-1])
    if not quadratic:
        claim = read_separable(case, last.certificate)
        need(claim.rho is not None or p.domain == "global", "it has no rho, and the couplings are not all linear")
        composite(case, claim)
        rows(case, claim, claim.alpha, Fraction(1))
        alike = p.q == 0 or (claim.P, claim.beta, claim.size) == (tube.P, tube.beta, tube.size)
        need(alike and last.stretch == 1, "P, beta and size are not those of the tube")
        need(last.height >= max(claim.v), "the height is too small")
        need(claim.rho is None or last.level <= claim.rho, "the level leaves the region")
        size = max(b / v for b, v in zip(widths, claim.v, strict=True)) + (claim.kappa * left if p.q else ZERO)
        need(last.level >= size, "the last box leaves the level")
        speed = pace(case, claim)
    else:
        claim = read_quadratic(case, last.certificate)
        high = all(inside(claim.P_e, z, Fraction(1), last.height) for z in identity(p.n * p.m))
        need(high, "the height is too small")
        contained(p, claim.P_e, last.level**2, claim.radius)
        if p.q:
            gap = plus(plus(identity(p.q, 0), last.stretch**2, tube.P), -1, claim.P)
            need(nonnegative(gap), "P' <= stretch^2 P is not shown")
        wide = [x for x in widths for _ in range(p.m)]
        square = sum(abs(x) * wide[a] * wide[b] for a, row in enumerate(claim.P_e) for b, x in enumerate(row))
        need(last.level**2 >= square + p.n * (last.stretch * left) ** 2, "the last box leaves the level")
        speed = claim.rate
    need(speed > 0, "it does not decrease")
    return Fraction(speed)
