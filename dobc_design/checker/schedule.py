"""settling: a box that moves holds every run, and hands over to a certificate near the target.

-lower <= e <= upper at every time of the tube, |C eps_i| <= root(size) disturbance exp(-beta t).
From the end of the tube on the size W of the certificate, V of max-separable or the root of V of
lure, is at most level exp(-pace (t - end)), and |e|_inf at most height W.
"""

from fractions import Fraction
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

from .arcs import decreases, read_claim
from .claims import Case
from .curves import both_faces
from .cycles import (
    INSTANT,
    TIMES,
    MovingRow,
    fading,
    heard_of,
    keeps,
    largest,
    louder,
    moving_late,
    read_cycles,
    read_from,
    rises,
    segment,
)
from .intervals import enclosed
from .loop import Loop
from .matrices import (
    ONE,
    ZERO,
    Vector,
    diagonal,
    identity,
    is_diagonal,
    nonnegative,
    paired,
    plus,
    root,
)
from .quadratic import contained, inside, read_quadratic
from .reading import Object, an_object, need, rational, read, text, weights
from .separable import composite, overshoot, pace, read_separable, rows, starts


def settling(case: Case, check: Any) -> None:
    """The tube holds all starts and its rows hold; its last box lies in the level of what takes
    over, in time."""
    need(check.rate is None, "it has no rate to claim")
    moving_late(case)
    starts(case, check.domain, "box")
    boxes = [partial(weights, case.n)]
    tube: Object = {"times": [rational], "upper": boxes, "lower": boxes}
    if case.q:
        tube |= {"P": ((rational,) * case.q,) * case.q, "beta": rational, "size": rational}
    last = dict.fromkeys(("level", "height", "stretch"), rational)
    last |= {"kind": text, "certificate": an_object}
    shape = {"tolerance": rational, "time": rational, "tube": tube, "last": last}
    exact = read(check.exact, shape)
    moves(case, exact.tube, check.domain)

    # from the end of the tube on another function decays
    elapsed = exact.time - exact.tube.times[-1]
    after = exact.last
    need(elapsed >= 0, "the time is before the end of the tube")
    speed, wait = takes_over(case, exact.tube, after, check.domain)
    fall = fading(speed * max(ZERO, elapsed - wait))
    most = after.height * after.level * fall
    need(most <= exact.tolerance, "the tolerance is not reached by then")


# --- The tube
def noise(case: Case, tube: Any, box: Any, time: Fraction) -> Fraction:
    """An upper bound of |C eps_i| from a time on, and of root(eps_i'P eps_i)."""
    if case.q == 0:
        return ZERO
    start: Fraction = root(tube.size) * box.disturbance
    return start * fading(tube.beta * time)


def moves(case: Case, tube: Any, box: Any) -> None:
    """The first box holds all starts, and no run leaves the boxes that follow."""
    times = tube.times
    count = len(times)
    need(1 <= count <= TIMES and times[0] == 0, "times do not begin at 0, or are too many")
    need(all(a < b for a, b in pairwise(times)), "times do not rise")
    need(len(tube.upper) == len(tube.lower) == count, "there is not one box for each time")
    composite(case, tube)
    need(case.q == 0 or tube.beta > 0, "beta is not positive")
    least = min(tube.upper[0] + tube.lower[0])
    need(least >= box.radius, "the first box does not hold all starts")
    # an entry of a gain beside the diagonal has any sign: it needs the faces alike
    alike = tube.upper == tube.lower
    need(
        alike or (all(map(is_diagonal, case.hold.values())) and not case.signed),
        "gains mix components, or agents oppose others, and the faces are not alike",
    )
    if count == 1:
        return

    most = max(max(face) for face in tube.upper + tube.lower)
    if case.gap:
        rises(case, most, strictly=False)
    timing = case.timing or INSTANT
    width = enclosed(2 * most * louder(timing, ZERO))[1]
    couplings = {arc.coupling for arc in case.arcs}
    curves = both_faces(couplings, -width, width)
    loads = [noise(case, tube, box, time) for time in times]
    sides = ((tube.upper, tube.lower, False), (tube.lower, tube.upper, True))
    for k, (a, b) in enumerate(pairwise(times)):
        on = modes_on(case, a, b)
        for own, other, mirrored in sides:
            ahead, across = (heard_of(side, times, k, timing) for side in (own, other))
            face = segment((own[k], own[k + 1]), ahead, across, b - a, (loads[k], loads[k + 1]))
            for mode in on:
                for i in case.nodes:
                    row = MovingRow(case, mode, i, curves, mirrored)
                    said = f"the row of agent {case.labels[i]} is not shown from {float(a)} s on"
                    need(row.holds(face), said)


def modes_on(loop: Loop, start: Fraction, end: Fraction) -> list[str]:
    """The modes that may be on between two times: the one of the phase, if it is said which."""
    if not loop.guarantee.timed:
        return list(loop.modes)
    turn = loop.guarantee.turn_at(start)
    # one mode for the whole segment, or its rows are not those of the loop
    need(end <= turn.end, "the mode changes between two times")
    return [loop.guarantee.timed[turn.place].mode]


# --- What takes over
class Maximum(NamedTuple):
    """A function V = max |e_i| / v_i + kappa E that takes over. It falls at ``speed``, but for up
    to ``wait`` not yet."""

    claim: Any
    v: Vector
    highest: Fraction  # the largest weight at any time
    speed: Fraction
    wait: Fraction = ZERO


def takes_over(case: Case, tube: Any, last: Any, box: Any) -> tuple[Fraction, Fraction]:
    """The certificate at the end of the tube holds, and the last box lies in its level; the speed
    at which it decays from there, and after how long."""
    kinds = ("max-separable", "quadratic", "arc-wise", "schedule")
    need(last.kind in kinds, "the kind is not known")
    need(last.level > 0 and last.height > 0 and last.stretch > 0, "a size is not positive")
    instant = last.kind in ("quadratic", "arc-wise")
    need(case.timing is None or not instant, "it is about readings of the same instant")
    # readings may still be those of before
    first = read_from(tube.times, tube.times[-1], case.timing or INSTANT)
    widths = largest([*tube.upper[first:], *tube.lower[first:]])
    left = noise(case, tube, box, tube.times[-1])
    need(last.kind != "quadratic" or not case.signed, "rows have left out the signs")
    if last.kind in ("quadratic", "arc-wise"):
        return form_takes_over(case, tube, last, widths, left)
    if last.kind == "schedule":
        found = moving_weights(case, last, tube.times[-1])
    else:
        found = fixed_weights(case, last)
    claim = found.claim
    own = (claim.P, claim.beta, claim.size) if case.q else ()
    alike = not own or own == (tube.P, tube.beta, tube.size)
    need(alike and last.stretch == 1, "P, beta and size are not those of the tube")
    need(last.height >= found.highest, "the height is too small")
    need(claim.rho is None or last.level <= claim.rho, "the level leaves the region")
    size = max(b / v for b, v in paired(widths, found.v))
    if case.q:
        size += claim.kappa * left
    need(last.level >= size, "the last box leaves the level")
    return found.speed, found.wait


def fixed_weights(case: Case, last: Any) -> Maximum:
    """A max-separable."""
    claim = read_separable(case, last.certificate)
    need(
        claim.rho is not None or case.domain == "global",
        "it has no rho, and the couplings are not all linear",
    )
    composite(case, claim)
    timing = case.timing or INSTANT
    rows(case, claim, claim.alpha, louder(timing, claim.alpha))
    if case.timing is not None:
        # beside it N does not fall at alpha
        overshoot(case, claim, claim.alpha, timing)
    speed = pace(case, claim)
    # the tolerance is reached by decay
    need(speed > 0, "it does not decrease")
    return Maximum(claim, claim.v, max(claim.v), speed)


def moving_weights(case: Case, last: Any, end: Fraction) -> Maximum:
    """A schedule: without phases all weights are 1, and V never rises."""
    claim = read_cycles(case, last.certificate)
    need(bool(claim.late) == (case.timing is not None), "it is not about such readings")
    keeps(case, claim)
    guarantee = case.guarantee
    if not claim.phases:
        return Maximum(claim, [ONE] * case.n, ONE, claim.rate or ZERO)
    need(bool(guarantee.timed), "it is not said which phase is on when the tube ends")
    turn = guarantee.turn_at(end)
    # elsewhere V is another function, which the last box is not compared with
    need(turn.begun == end, "weights that move take over where a phase begins")
    highest = max(x for each in claim.phases for v in each.v for x in v)
    # V falls by the end of a phase, not within it
    wait = max(each.times[-1] for each in claim.phases)
    return Maximum(claim, claim.phases[turn.place].v[0], highest, claim.rate or ZERO, wait)


def form_takes_over(
    case: Case, tube: Any, last: Any, widths: Vector, left: Fraction
) -> tuple[Fraction, Fraction]:
    """A quadratic or arc-wise certificate, W = sqrt(V)."""
    if last.kind == "quadratic":
        claim = read_quadratic(case, last.certificate)
        P_e = claim.P_e
        contained(case, P_e, last.level**2, claim.radius)
    else:
        need(not case.gap, "fixed nodes that differ are not known to it")
        claim = read_claim(case, last.certificate)
        decreases(case, claim)
        P_e = diagonal([identity(case.m, d) for d in claim.d])
        need(last.level**2 <= claim.level, "the level leaves the region")
    units = identity(len(P_e))
    need(all(inside(P_e, z, Fraction(1), last.height) for z in units), "the height is too small")
    if case.q:
        gap = [[last.stretch**2 * x for x in row] for row in tube.P]
        need(nonnegative(plus(gap, -1, claim.P)), "P' <= stretch^2 P is not shown")
    # V is at most its value with all entries of P_e and of e taken by their sizes
    wide = [x for x in widths for _ in range(case.m)]
    square = case.n * (last.stretch * left) ** 2
    for a, row in enumerate(P_e):
        square += sum(abs(x) * wide[a] * wide[b] for b, x in enumerate(row))
    need(last.level**2 >= square, "the last box leaves the level")
    need(claim.rate > 0, "it does not decrease")
    return claim.rate, ZERO
