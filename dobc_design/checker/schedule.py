"""settling: a box that moves holds every run, and hands over to a certificate near the target.

-lower <= e <= upper at every time of the tube, |C eps_i| <= root(size) disturbance exp(-beta t).
From the end of the tube on the size W of the certificate, V of max-separable or the root of V of
lure, is at most level exp(-pace (t - end)), and |e|_inf at most height W.
"""

from fractions import Fraction
from functools import partial
from itertools import pairwise
from typing import Any

from .cycles import (
    HALVINGS,
    TIMES,
    Face,
    ends_of,
    fading,
    keeps,
    read_cycles,
    shown,
    timed,
    turn_at,
)
from .files import Certificate
from .intervals import enclosed
from .matrices import ZERO, identity, nonnegative, plus, root
from .quadratic import contained, inside, read_quadratic
from .reading import an_object, need, rational, read, text, weights
from .separable import Curve, composite, pace, read_separable, rows, starts

ONE = Fraction(1)


def settling(case: Certificate, check: Any) -> None:
    """The tube holds all starts and its rows hold; its last box lies in the level of what takes
    over, in time."""
    p = case.problem
    need(check.rate is None, "it has no rate to claim")
    starts(case, check.domain, "box")
    tube: dict[str, Any] = {
        "times": [rational],
        "upper": [partial(weights, p.n)],
        "lower": [partial(weights, p.n)],
    }
    tube |= {"P": ((rational,) * p.q,) * p.q, "beta": rational, "size": rational} if p.q else {}
    last = dict.fromkeys(("level", "height", "stretch"), rational) | {
        "kind": text,
        "certificate": an_object,
    }
    exact = read(check.exact, {"tolerance": rational, "time": rational, "tube": tube, "last": last})
    moves(case, exact.tube, check.domain)

    elapsed, after = exact.time - exact.tube.times[-1], exact.last
    need(elapsed >= 0, "the time is before the end of the tube")
    speed, wait = takes_over(case, exact.tube, after, check.domain)
    most = after.height * after.level * fading(speed * max(ZERO, elapsed - wait))
    need(most <= exact.tolerance, "the tolerance is not reached by then")


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
    mixed = any(
        x
        for gain in p.gains.values()
        for c, row in enumerate(gain)
        for d, x in enumerate(row)
        if c != d
    )
    need(not mixed or tube.upper == tube.lower, "gains mix components, and the faces are not alike")
    if count == 1:
        return

    reach = enclosed(2 * max(x for face in (tube.upper, tube.lower) for x in map(max, face)))[1]
    couplings = {arc.coupling for heard in p.heard.values() for arcs in heard for arc in arcs}
    curves = {
        (h, mirrored): Curve(h, mirrored, -reach, reach)
        for h in couplings
        for mirrored in (False, True)
    }
    turns = timed(p)
    ends = ends_of(turns)
    loads = [noise(case, tube, box, time) for time in tube.times]
    for k in range(count - 1):
        length, on = tube.times[k + 1] - tube.times[k], list(p.modes)
        if turns:
            place, _, end = turn_at(ends, tube.times[k])
            need(tube.times[k + 1] <= end, "the mode changes between two times")
            on = [turns[place].mode]
        for own, other, mirrored in (
            (tube.upper, tube.lower, False),
            (tube.lower, tube.upper, True),
        ):
            speed = [(b - a) / length for a, b in zip(own[k], own[k + 1], strict=True)]
            face = Face((own[k], own[k + 1]), (other[k], other[k + 1]), speed)
            open_rows = [(p.heard[mode][i], i) for mode in on for i in range(p.n)]
            for arcs, i in open_rows:
                held = shown(p, arcs, i, face, (loads[k], loads[k + 1]), curves, mirrored, HALVINGS)
                need(
                    held,
                    f"the row of agent {p.labels[i]} is not shown from {float(tube.times[k])} s on",
                )


def takes_over(case: Certificate, tube: Any, last: Any, box: Any) -> tuple[Fraction, Fraction]:
    """The certificate at the end of the tube holds, and the last box lies in its level; its rate,
    and for how long it may not decay yet."""
    p, quadratic = case.problem, last.kind == "quadratic"
    need(last.kind in ("max-separable", "quadratic", "schedule"), "the kind is not known")
    need(last.level > 0 and last.height > 0 and last.stretch > 0, "a size is not positive")
    widths = list(map(max, tube.upper[-1], tube.lower[-1]))
    left = noise(case, tube, box, tube.times[-1])
    if not quadratic:
        if last.kind == "schedule":
            claim = read_cycles(case, last.certificate)
            keeps(case, claim)
            highest, v = (
                max((x for each in claim.phases for y in each.v for x in y), default=ONE),
                [ONE] * p.n,
            )
            speed, wait = (
                claim.rate or ZERO,
                max((each.times[-1] for each in claim.phases), default=ZERO),
            )
            if claim.phases:
                turns = timed(p)
                need(bool(turns), "it is not said which phase is on when the tube ends")
                place, begun, _ = turn_at(ends_of(turns), tube.times[-1])
                need(begun == tube.times[-1], "weights that move take over where a phase begins")
                v = claim.phases[place].v[0]
        else:
            claim = read_separable(case, last.certificate)
            need(
                claim.rho is not None or p.domain == "global",
                "it has no rho, and the couplings are not all linear",
            )
            composite(case, claim)
            rows(case, claim, claim.alpha, Fraction(1))
            highest, v, speed, wait = max(claim.v), claim.v, pace(case, claim), ZERO
            need(speed > 0, "it does not decrease")
        alike = p.q == 0 or (claim.P, claim.beta, claim.size) == (tube.P, tube.beta, tube.size)
        need(alike and last.stretch == 1, "P, beta and size are not those of the tube")
        need(last.height >= highest, "the height is too small")
        need(claim.rho is None or last.level <= claim.rho, "the level leaves the region")
        size = max(b / v for b, v in zip(widths, v, strict=True)) + (
            claim.kappa * left if p.q else ZERO
        )
        need(last.level >= size, "the last box leaves the level")
    else:
        claim = read_quadratic(case, last.certificate)
        high = all(inside(claim.P_e, z, Fraction(1), last.height) for z in identity(p.n * p.m))
        need(high, "the height is too small")
        contained(p, claim.P_e, last.level**2, claim.radius)
        if p.q:
            gap = plus(plus(identity(p.q, 0), last.stretch**2, tube.P), -1, claim.P)
            need(nonnegative(gap), "P' <= stretch^2 P is not shown")
        wide = [x for x in widths for _ in range(p.m)]
        square = sum(
            abs(x) * wide[a] * wide[b] for a, row in enumerate(claim.P_e) for b, x in enumerate(row)
        )
        need(
            last.level**2 >= square + p.n * (last.stretch * left) ** 2,
            "the last box leaves the level",
        )
        speed, wait = claim.rate, ZERO
        need(speed > 0, "it does not decrease")
    return Fraction(speed), wait
