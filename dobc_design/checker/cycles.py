"""schedule: weights that move from mode to mode, for signals that keep the guarantee of the
problem; or the graphs alone, where couplings rise."""

from bisect import bisect_right
from collections.abc import Collection, Iterator, Sequence
from fractions import Fraction
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

from .claims import Case
from .consensus import closed_sets, jacobian
from .coordinates import RowsOfCoordinates, far, inverse
from .curves import Curve, Curves, Term, at_once, both_faces, on_pieces
from .guarantee import Phase
from .intervals import Exact, by_decimal, enclosed
from .loop import Loop, Timing, reach
from .matrices import ONE, ZERO, Matrix, Vector, combined, norm, paired
from .quadratic import gains_shape, read_ranges
from .reading import Object, matrix, maybe, need, rational, read, still, weights
from .sampled import BITS, exponential, multiplied
from .saturation import to_target
from .separable import composite, frame, known_late, observed, spread, starts

NEAR = 2.0**-60
TIMES = 2000  # of a tube at most
HALVINGS = 12  # of a segment
LONGEST = Fraction(16_000)

Ends = tuple[Vector, Vector]
INSTANT = Timing(ZERO, ZERO, ZERO, 0, ZERO, False, False)


def schedule(case: Case, check: Any) -> Any:
    """N = max |e_i| / v_i(t) falls from phase to phase at the rate, or the graphs alone show that
    all errors decay; or errors grow from round to round."""
    if check.verdict == "refuted":
        grows(case, check)
        return None
    exact = read_cycles(case, check.exact, "T" in (check.exact or {}))
    readable = exact.rate is not None if exact.T else case.single
    need(readable, "a coupling is a list, or nodes are curved, or T has no weights")
    need(exact.phases or not exact.late, "the graphs alone are about readings of the same instant")
    claims_rate(check, exact)
    keeps(case, exact)
    begun = []
    # a claim about the graphs alone has no phases
    turns = case.guarantee.phases if exact.phases else []
    for turn, each in paired(turns, exact.phases):
        if turn.first:
            begun.append(spread(frame(exact), each.v[0]))
    inside(case, check, exact, max(begun, default=ONE))
    return exact


def claims_rate(check: Any, exact: Any) -> None:
    """The rate of the check is at most that of its exact values, and there where this is."""
    both_or_none = (check.rate is None) == (exact.rate is None)
    need(both_or_none, "it claims a rate that it does not have, or has one")
    allowed = check.rate is None or 0 < check.rate <= exact.rate
    need(allowed, "the rate is not between 0 and that of the claim")


def read_cycles(case: Case, value: Any, turned: bool = False) -> Any:
    """Read weights that move from mode to mode, phase by phase; none where the graphs alone are
    claimed.  ``turned``: in coordinates."""
    size = case.size if turned else case.n
    phase = {"times": [rational], "v": [partial(weights, size)]}
    shape: Object = {"rate": maybe(rational), "rho": maybe(rational), "phases": [phase]}
    shape |= {"late?": true}
    shape |= observed(case)
    if turned:
        shape |= {"T": matrix(case.m, case.m), "ranges": gains_shape(case.m)}
    exact = read(value, shape)
    if not turned:
        exact.T = None
    for each in exact.phases:
        need(0 < len(each.times) == len(each.v) <= TIMES, "there are no times, or too many")
    return exact


def true(value: Any) -> bool:
    """What is true where it stands at all."""
    need(value is True, "it is neither true nor left out")
    return True


def keeps(case: Case, exact: Any) -> None:
    """V = N + kappa E never rises and, with weights, falls at the rate over each phase."""
    every = [x for each in exact.phases for v in each.v for x in v]
    decays(case, exact, exact.rate or ZERO, min(every, default=ONE))
    need(not case.agrees or exact.rate is None, "of so many agents the pairs are not looked at")
    need(not exact.late or case.timing is not None, "the problem says nothing of readings")
    timing = moving_late(case) if exact.late else INSTANT
    if exact.rate is None:
        need(not timing.event, "weights of 1 leave no room for an event")
        need(not exact.phases, "it has weights and no rate")
        rises(case, exact.rho)
        # one mode alone stays on for ever
        alone = [tuple(case.modes)] if len(case.modes) == 1 else case.guarantee.cycles()
        for cycle in alone:
            reached(case, cycle)
        return

    turns = case.guarantee.phases
    need(len(exact.phases) == len(turns), "there are not weights for every phase")
    need(not (timing.late and exact.T), "late readings are not known in coordinates")
    old = before(turns, exact, timing)
    every += [x * louder(timing, exact.rate) for x in [max(every), *map(max, old)]]
    if exact.T:
        need(not case.gap, "coordinates are those of an error from one target")
        turned = in_coordinates(case, exact)
    else:
        most = (exact.rho or ONE) * max(every)
        if case.gap:
            rises(case, most, strictly=False)
        width = enclosed(2 * most)[1]
        curves: dict[str, Curves] = {}
        for mode in {turn.mode for turn in turns}:
            heard = {arc.coupling for arc in case.modes[mode]}
            curves[mode] = both_faces(heard, -width, width)
    for turn, each, past in zip(turns, exact.phases, old, strict=True):
        need(each.times[0] == 0, "times do not begin at 0")
        need(all(a < b for a, b in pairwise(each.times)), "times do not rise")
        # from then on the phase may end at any time
        need(turn.shortest in each.times, "the shortest time is not among the times")
        need(turn.longest in (None, each.times[-1]), "the times do not end with the longest one")
        handed(turn, each, [exact.phases[k].v[0] for k in turn.following], exact.rate)
        if exact.T:
            falls_turned(turned, turn, each, exact.rate)
        else:
            falls(case, turn, each, exact, curves[turn.mode], timing, past)


def moving_late(case: Case) -> Timing:
    """The readings of the problem, if they are known where boxes or weights move."""
    timing: Timing | None = case.timing
    if timing is None:
        return INSTANT
    known_late(case, timing)
    plant = case.uncertainty
    exact = plant is None or not (plant.weights or plant.gains)
    seen = all(residual.sensed is None for residual in case.residuals)
    need(exact and seen and to_target(case), "such errors, outputs or nodes are not known late")
    other = timing.period or timing.own_delay or timing.ahead
    need(not other, "what is held, acts late or knows itself late is not known")
    return timing


def louder(timing: Timing, rate: Fraction) -> Fraction:
    """How much larger a reading may be of what falls at a rate."""
    return (1 + timing.event) * growth(rate * timing.delay)


def read_from(times: Vector, time: Fraction, timing: Timing) -> int:
    """The place of the last time that is not after what is read from ``time`` on."""
    return max(0, bisect_right(times, time - timing.delay) - 1)


def largest(vectors: Sequence[Vector]) -> Vector:
    """Entry by entry."""
    return [max(column) for column in zip(*vectors, strict=True)]


def heard_of(boxes: Sequence[Vector], times: Vector, k: int, timing: Timing) -> Ends:
    """What is read at the two ends of the k-th segment: if late, the largest at both."""
    if not timing.late:
        return boxes[k], boxes[k + 1]
    far = largest(boxes[read_from(times, times[k], timing) : k + 2])
    return ([x * (1 + timing.event) for x in far],) * 2


def before(turns: list[Phase], exact: Any, timing: Timing) -> list[Vector]:
    """For each phase the largest weights that are read of those before, as parts of N when it
    begins."""
    found = [each.v[0] for each in exact.phases]
    for turn, each in paired(turns, exact.phases) if timing.late else ():
        need(turn.shortest >= timing.delay, "a phase is shorter than readings are old")
        for k in range(read_from(each.times, turn.shortest, timing), len(each.times) - 1):
            end = each.times[k + 1] + timing.delay
            if turn.longest is not None:
                end = min(end, turn.longest)
            need(exact.rate * end <= LONGEST, "a phase is too long")
            old = [x * growth(exact.rate * end) for x in largest(each.v[k : k + 2])]
            for q in turn.following:
                found[q] = largest([found[q], old])
    return found


def in_coordinates(case: Case, exact: Any) -> RowsOfCoordinates:
    """What shows rows in coordinates z = T e, for gains that hold as far out as any weights
    reach."""
    S = inverse(exact.T)
    every = [v for each in exact.phases for v in each.v]
    exact.v = [max(column) for column in zip(*every, strict=True)]
    ranges = read_ranges(case, exact, far(case, S, exact))
    return RowsOfCoordinates(case, exact.T, S, ranges)


def falls_turned(rows: RowsOfCoordinates, turn: Phase, each: Any, rate: Fraction) -> None:
    """The rows of a phase in coordinates, at both ends of every segment: rows are convex in the
    weights."""
    for (a, b), (v, w) in paired(pairwise(each.times), pairwise(each.v)):
        load = [x / (b - a) for x in combined(v, -1, w)]
        for box in (v, w):
            rows.hold(box, load, [turn.mode])
    if turn.longest is None:
        last = each.v[-1]
        rows.hold(last, [rate * x for x in last], [turn.mode])


def decays(case: Case, claim: Any, rate: Fraction, least: Fraction = ONE) -> None:
    """The part of the estimation error in V = N + kappa E, with weights of at least ``least``,
    allows the rate."""
    composite(case, claim)
    if case.q:
        large_enough = claim.kappa > 0 and claim.kappa * (claim.beta - rate) * least >= 1
        need(large_enough, "kappa is too small")
    need(
        claim.rho is not None or case.domain == "global",
        "it has no rho, and the couplings are not all linear",
    )


def inside(case: Case, check: Any, claim: Any, most: Fraction = ONE) -> None:
    """V is at most rho at every start; ``most``: the largest N where |e| <= 1."""
    if claim.rho is None:
        need(check.domain == "global", "it has no rho and is not global")
        return
    starts(case, check.domain, "box")
    left = claim.rho - check.domain.radius * most
    noise = ZERO
    if case.q:
        noise = (claim.kappa * check.domain.disturbance) ** 2 * claim.size
    # kappa s sqrt(size) <= left, without a root
    need(left >= 0 and noise <= left**2, "the box leaves the region")


def handed(turn: Phase, each: Any, nexts: list[Vector], rate: Fraction) -> None:
    """v(t) <= exp(-rate t) v'(0) for every t at which the phase may end: the larger end of a
    segment, and the factor of its later one, which is 1 / exp(rate t)."""
    first = each.times.index(turn.shortest)
    # exp is followed up to there
    need(rate * each.times[-1] <= LONGEST, "a phase is too long")
    least = [min(after) for after in zip(*nexts, strict=True)]
    for k in range(first, len(each.times)):
        factor = 1 / growth(rate * each.times[k])
        most = map(max, each.v[max(first, k - 1)], each.v[k])
        need(all(x <= factor * after for x, after in paired(most, least)), "no fall")


def growth(x: Fraction) -> Fraction:
    """An upper bound of exp(x)."""
    return Fraction(by_decimal("exp", (x, x))[1])


def fading(x: Fraction) -> Fraction:
    """An upper bound of exp(-x) for x >= 0; beyond LONGEST it is not followed: it is smaller."""
    return growth(-min(x, LONGEST))


def falls(
    loop: Loop,
    turn: Phase,
    each: Any,
    exact: Any,
    curves: Curves,
    timing: Timing,
    past: Vector,
) -> None:
    """The rows of a phase; where it has no end, at rest at the rate as well."""
    parts = []
    last = each.v[-1]
    times = [-timing.delay, *each.times]
    boxes = [past, *each.v, last]
    for k, (a, b) in enumerate(pairwise(each.times), 1):
        heard = heard_of(boxes, times, k, timing)
        parts.append(segment((boxes[k], boxes[k + 1]), heard, heard, b - a))
    if turn.longest is None:
        far, _ = heard_of(boxes, times, len(each.v), timing)
        far = [x * louder(timing, exact.rate) for x in far]
        parts.append(Face((last, last), (far, far), (far, far), [-exact.rate * x for x in last]))
    rho = exact.rho or ONE
    for face in parts:
        for mirrored in (False, True):
            for i in loop.nodes:
                row = MovingRow(loop, turn.mode, i, curves, mirrored, rho)
                shown = row.holds(face)
                need(shown, f"the row of agent {loop.labels[i]} in mode {turn.mode} is not shown")


def rises(loop: Loop, rho: Fraction | None, strictly: bool = True) -> None:
    """Couplings rise on |y| <= 2 rho + gap, ``strictly`` at 0, and no gain pushes outward."""
    width = enclosed(loop.gap + 2 * (rho or ZERO))[1]
    need(all(loop.least_gain(i) >= 0 for i in loop.nodes), "a gain pushes outward")
    for h in loop.functions:
        curve = Curve(h, False, -width, width)
        # a kink has its slopes on both sides
        slope: Any = curve.at((-NEAR, NEAR))[1][0] if h.kinked else h.slope(0, 0)[0]
        # a dead zone is flat: errors in it do not grow, but do not decay either
        flat = not strictly and (slope >= 0 or not h.straight)
        need(slope > 0 or flat, "a coupling does not rise at the target")
        need(h.straight or all(cell.way == 1 for cell in curve.table), "a coupling may fall")


def reached(loop: Loop, modes: Collection[str]) -> None:
    """Along the arcs of these modes together every agent is reached from one that its gain holds;
    where agents agree, from one of them."""
    if loop.agrees:
        need(len(closed_sets(loop, modes, False)) == 1, "nobody is heard by all others")
        return
    pinned = [i for i in loop.nodes if loop.least_gain(i) > 0] + loop.tied(modes)
    if loop.signed:  # all errors of a set hold each other back, unless its signs balance
        sets = closed_sets(loop.agents, modes, False)
        need(all(each & {*pinned} for each in sets), "a set whose signs balance has no pin")
        return
    found = reach(pinned, loop.edges(modes, False))
    need(len(found) == loop.n, f"modes {', '.join(modes)} do not reach every agent")


# --- Rows of boxes that move, for settling times as well
class Face(NamedTuple):
    """A face of the box, how far neighbours may be ahead of the target on its side and across, its
    speed, and the load on it, on a part of a segment: at its two ends."""

    own: Ends
    ahead: Ends
    across: Ends
    speed: Vector
    loads: Exact = (ZERO, ZERO)


def segment(
    own: Ends, ahead: Ends, across: Ends, length: Fraction, loads: Exact = (ZERO, ZERO)
) -> Face:
    """A face that moves from its start to its end in this time."""
    speed = [x / length for x in combined(own[1], -1, own[0])]
    return Face(own, ahead, across, speed, loads)


def halves(face: Face) -> Iterator[Face]:
    """The two halves of a part of a segment."""
    own, ahead, across = map(between, (face.own, face.ahead, face.across))
    load = sum(face.loads, ZERO) / 2
    sides = (face.own[0], own), (face.ahead[0], ahead), (face.across[0], across)
    yield Face(*sides, face.speed, (face.loads[0], load))
    sides = (own, face.own[1]), (ahead, face.ahead[1]), (across, face.across[1])
    yield Face(*sides, face.speed, (load, face.loads[1]))


def between(ends: Ends) -> Vector:
    """The box in the middle."""
    return [(a + b) / 2 for a, b in paired(*ends)]


def heard(face: Vector, j: int) -> Fraction:
    """How far the face of a node is from its place: not at all where the node is fixed."""
    return face[j] if j < len(face) else ZERO


class MovingRow(NamedTuple):
    """The row of one agent on faces that move: what drives e_i outward on the face is at most the
    speed of the face; with ``rho`` for the box times every s of (0, rho]."""

    loop: Loop
    mode: str
    i: int
    curves: Curves
    mirrored: bool
    rho: Fraction = ZERO

    def holds(self, face: Face, halvings: int = HALVINGS) -> bool:
        """Whether it holds on a part of a segment, whole or in halves."""
        still()
        if self.holds_whole(face):
            return True
        if not halvings:
            return False
        # a part has tighter bounds: each quantity is at its worst on less
        return all(self.holds(part, halvings - 1) for part in halves(face))

    def holds_whole(self, face: Face) -> bool:
        """Whether it holds with every quantity at its worst on the part."""
        i = self.i
        arcs = self.loop.heard[self.mode][i]
        gain = self.loop.least_gain(i)
        held = min(gain * box[i] for box in face.own)
        room = held + face.speed[i] - max(face.loads)
        terms = []
        slopes = ZERO
        for arc in arcs:
            step = max(heard(ahead, arc.j) - own[i] for ahead, own in paired(face.ahead, face.own))
            if arc.loose:  # up to y = 0 at least
                step = max(ZERO, step)
            both = paired(face.own, face.across)
            reach = max(heard(across, arc.j) + own[i] for own, across in both)
            # a linear one is largest at an end, with the slope at one of its ends
            most = max(g * x for g in arc.coupling.slope(0, 0) for x in (step, -reach))
            slopes += arc.w * most
            low = enclosed(max(reach, -step))[1]
            high = enclosed(step)[1]
            curve = self.curves[arc.coupling, self.mirrored]
            terms.append(Term(curve, enclosed(arc.w), (low, low), (high, high)))
        if all(arc.coupling.straight for arc in arcs):
            return slopes <= room
        if self.rho:
            return on_pieces(terms, enclosed(room), (0.0, 0.0), enclosed(self.rho)[1])
        return at_once(terms, enclosed(room))


# --- Errors that grow from round to round: |tr M^k| > n m, M the linear map of a round
POWER = 64  # the largest k
ROWS = 20
ROUND = 200  # phases
GROWTH = 1000  # of the sum of |J - K| T in the largest row sum


def grows(loop: Loop, check: Any) -> None:
    """The trace of a power of M, the product of exp((J - K) T) over the phases, is larger than M
    can have with eigenvalues of size 1 at most."""
    power = read(check.exact, {"power": rational}).power
    turns = loop.guarantee.timed
    size = loop.size
    # differences of agents depend on each other: what grows need not be such
    need(not loop.differences or loop.fixed == 1, "pairs are not followed here")
    need(not loop.gap, "it is about one target")
    linear = check.witness is None and loop.domain == "global"
    need(linear, "it is about linear couplings, and has no witness")
    need(
        0 < len(turns) <= ROUND and size <= ROWS,
        "so long a round, or so many rows, are not followed here",
    )
    is_whole = power.denominator == 1 and 1 <= power <= POWER
    need(is_whole, "the power is no whole number from 1 on, or too large")
    parts = [(turn.mode, turn.shortest) for turn in turns]
    steps: dict[tuple[str, Fraction], Matrix] = {}
    for mode, time in set(parts):
        steps[mode, time] = [[x * time for x in row] for row in jacobian(loop, mode)]
    # what rounding errors may grow to, as a power of e
    grown = sum(norm(steps[part]) for part in parts)
    need(grown <= GROWTH, "a round is too long")
    known = {part: exponential(X) for part, X in steps.items()}
    whole = known[parts[0]]
    for part in parts[1:]:  # later phases on the left
        whole = multiplied(known[part], whole)
    found = whole
    for _ in range(int(power) - 1):
        found = multiplied(found, whole)
    # |tr M^k| <= n m if all eigenvalues have at most size 1
    trace = abs(sum(found.entries[k][k] for k in range(size)))
    need(trace - size * found.missed > size << BITS, "it is not shown that errors grow")
