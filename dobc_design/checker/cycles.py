"""schedule: weights that move from mode to mode, for signals that keep the guarantee of the
problem; or the graphs alone, where couplings rise."""

from bisect import bisect_right
from collections.abc import Iterable, Iterator
from fractions import Fraction
from functools import partial
from itertools import accumulate, combinations, pairwise
from typing import Any, NamedTuple

from .coordinates import far, gains, inverse, judge, outputs, spread
from .expressions import Coupling
from .files import Certificate, Problem, reach
from .intervals import by_decimal, enclosed, negative, times, total
from .matrices import ZERO
from .quadratic import read_ranges
from .reading import matrix, maybe, need, rational, read, still, text, weights
from .separable import Curve, Curves, Term, composite, observed, on_pieces, starts, supremum

PHASES = 40
ONE = Fraction(1)
NEAR = 2.0**-60
TIMES = 2000  # of a tube at most
HALVINGS = 12  # of a segment
LONGEST = Fraction(16_000)

Box = list[Fraction]


class Phase(NamedTuple):
    """A mode that is on for ``shortest`` to ``longest`` (None: for ever), then a phase of
    ``following``."""

    mode: str
    shortest: Fraction
    longest: Fraction | None
    following: list[int]
    first: bool


def phases(p: Problem) -> list[Phase]:
    """The phases of the guarantee in the problem file."""
    table, modes = p.switching or {}, list(p.modes)
    kind = table.get("guarantee")
    number = {
        key: rational(table[key])
        for key in ("dwell", "period", "longest")
        if table.get(key) is not None
    }
    need(kind in ("dwell", "sequence") and len(modes) > 1, "there is no guarantee")
    if kind == "dwell":
        need(number.get("dwell", ZERO) > 0, "it is not said how long a mode lasts at least")
        others = [[q for q in range(len(modes)) if q != k] for k in range(len(modes))]
        return [
            Phase(mode, number["dwell"], number.get("longest"), others[k], True)
            for k, mode in enumerate(modes)
        ]
    order = read(table.get("sequence"), maybe([text])) or modes
    listed = read(table.get("schedule"), maybe([(rational, text)])) or []
    need(
        "period" in number or ("dwell" in number and not listed),
        "it is not said how long a phase lasts",
    )
    if listed:
        begins, order = [time for time, _ in listed], [mode for _, mode in listed]
        lengths = [b - a for a, b in pairwise([*begins, number["period"] + begins[0]])]
    else:
        lengths = [number["dwell"] if "dwell" in number else number["period"] / len(order)] * len(
            order
        )
    need(set(order) <= set(modes) and min(lengths) > 0, "the sequence is none of modes")
    turns = list(zip(order, lengths, strict=True))
    size = len(turns)  # of the shortest beginning that, over and over, gives the whole
    size = next(k for k in range(1, size + 1) if size % k == 0 and turns[k:] == turns[: size - k])
    return [
        Phase(mode, time, time, [(k + 1) % size], k == 0)
        for k, (mode, time) in enumerate(turns[:size])
    ]


def timed(p: Problem) -> list[Phase]:
    """The phases where it is said which one is on at every time, else none."""
    return (
        phases(p) if len(p.modes) > 1 and (p.switching or {}).get("guarantee") == "sequence" else []
    )


def turn_at(ends: list[Fraction], time: Fraction) -> tuple[int, Fraction, Fraction]:
    """The place of the timed phase that is on from a time on, when it began and when it ends;
    ``ends``: those of the phases of the first round."""
    begun = time - time % ends[-1]
    place = bisect_right(ends, time - begun)
    return place, begun + (ends[place - 1] if place else ZERO), begun + ends[place]


def ends_of(turns: list[Phase]) -> list[Fraction]:
    """When the timed phases of the first round end."""
    return list(accumulate(turn.shortest for turn in turns))


def schedule(case: Certificate, check: Any) -> None:
    """N = max |e_i| / v_i(t) falls from phase to phase at the rate, or the graphs alone show that
    all errors decay; or errors grow from round to round."""
    if check.verdict == "refuted":
        grows(case.problem, check)
        return
    exact = read_cycles(case, check.exact, check.exact is not None and "T" in check.exact)
    plain = not case.problem.nodes and all(h.single for h in case.problem.couplings)
    need(
        exact.rate is not None if exact.T else plain,
        "a coupling is a list, or nodes are curved, or T has no weights",
    )
    need(
        (check.rate is None) == (exact.rate is None),
        "it claims a rate that it does not have, or has one",
    )
    need(
        check.rate is None or 0 < check.rate <= exact.rate,
        "the rate is not between 0 and that of the claim",
    )
    keeps(case, exact)
    turns = zip(phases(case.problem), exact.phases, strict=False)
    begun = [each.v[0] for turn, each in turns if turn.first]
    inside(case, check, exact, max([spread(exact.T or [[ONE]], v) for v in begun], default=ONE))


def read_cycles(case: Certificate, value: Any, turned: bool = False) -> Any:
    """Read weights that move from mode to mode, phase by phase; none where the graphs alone are
    claimed.  ``turned``: in coordinates."""
    p = case.problem
    shape: dict[str, Any] = {"rate": maybe(rational), "rho": maybe(rational)}
    shape["phases"] = [{"times": [rational], "v": [partial(weights, p.n * (p.m if turned else 1))]}]
    exact = read(
        value,
        shape | observed(p) | ({"T": matrix(p.m, p.m), "ranges": gains(p.m)} if turned else {}),
    )
    exact.T = exact.T if turned else None
    need(
        all(0 < len(each.times) == len(each.v) <= TIMES for each in exact.phases),
        "there are no times, or too many",
    )
    return exact


def keeps(case: Certificate, exact: Any) -> None:
    """V = N + kappa E never rises and, with weights, falls at the rate over each phase."""
    p, turns = case.problem, phases(case.problem)
    decays(
        case,
        exact,
        exact.rate or ZERO,
        min([x for each in exact.phases for v in each.v for x in v], default=ONE),
    )
    if exact.rate is None:
        need(not exact.phases, "it has weights and no rate")
        rises(p, p.couplings, exact.rho)
        for cycle in cycles(turns):
            reached(p, cycle)
        return

    need(len(exact.phases) == len(turns), "there are not weights for every phase")
    hold = in_coordinates(case, exact) if exact.T else None
    most = max(x for each in exact.phases for v in each.v for x in v)
    curves = (
        {}
        if hold
        else {mode: curves_of(p, mode, most, exact) for mode in {turn.mode for turn in turns}}
    )
    for turn, each in zip(turns, exact.phases, strict=True):
        need(each.times[0] == 0, "times do not begin at 0")
        need(all(a < b for a, b in pairwise(each.times)), "times do not rise")
        need(turn.shortest in each.times, "the shortest time is not among the times")
        need(turn.longest in (None, each.times[-1]), "the times do not end with the longest one")
        handed(turn, each, [exact.phases[k].v[0] for k in turn.following], exact.rate)
        if hold is None:
            falls(p, turn, each, exact, curves[turn.mode])
            continue
        for (a, b), (v, w) in zip(pairwise(each.times), pairwise(each.v), strict=True):
            for box in (v, w):  # rows are convex in the weights
                hold(box, [(x - y) / (b - a) for x, y in zip(v, w, strict=True)], [turn.mode])
        if turn.longest is None:
            hold(each.v[-1], [exact.rate * x for x in each.v[-1]], [turn.mode])


def in_coordinates(case: Certificate, exact: Any) -> Any:
    """What shows rows in coordinates z = T e, for gains that hold as far out as any weights
    reach."""
    S = inverse(exact.T)
    exact.v = [
        max(column) for column in zip(*(v for each in exact.phases for v in each.v), strict=True)
    ]
    return judge(case, exact, S, read_ranges(case.problem, exact, far(case, S, exact)))


def decays(case: Certificate, claim: Any, rate: Fraction, least: Fraction = ONE) -> None:
    """The part of the estimation error in V = N + kappa E, with weights of at least ``least``,
    allows the rate."""
    p = case.problem
    composite(case, claim, outputs(p, claim.T) if getattr(claim, "T", None) else None)
    need(
        p.q == 0 or (claim.kappa > 0 and claim.kappa * (claim.beta - rate) * least >= 1),
        "kappa is too small",
    )
    need(
        claim.rho is not None or p.domain == "global",
        "it has no rho, and the couplings are not all linear",
    )


def inside(case: Certificate, check: Any, claim: Any, most: Fraction = ONE) -> None:
    """V is at most rho at every start; ``most``: the largest N where |e| <= 1."""
    if claim.rho is None:
        need(check.domain == "global", "it has no rho and is not global")
        return
    starts(case, check.domain, "box")
    left = claim.rho - check.domain.radius * most
    noise = (claim.kappa * check.domain.disturbance) ** 2 * claim.size if case.problem.q else ZERO
    need(left >= 0 and noise <= left**2, "the box leaves the region")


def handed(turn: Phase, each: Any, nexts: list[Box], rate: Fraction) -> None:
    """v(t) <= exp(-rate t) v'(0) for every t at which the phase may end: the larger end of a
    segment, and the factor of its later one, which is 1 / exp(rate t)."""
    first = each.times.index(turn.shortest)
    need(rate * each.times[-1] <= LONGEST, "a phase is too long")
    for k in range(first, len(each.times)):
        factor = 1 / Fraction(by_decimal("exp", (rate * each.times[k],) * 2)[1])
        most = map(max, each.v[max(first, k - 1)], each.v[k])
        need(
            all(
                x <= factor * min(after)
                for x, after in zip(most, zip(*nexts, strict=True), strict=True)
            ),
            "no fall",
        )


def curves_of(p: Problem, mode: str, most: Fraction, exact: Any) -> Curves:
    """The couplings of a mode with tables as far as weights of at most ``most`` need them."""
    width = enclosed(2 * (exact.rho or ONE) * most)[1]
    couplings = {arc.coupling for arcs in p.heard[mode] for arc in arcs}
    return {
        (h, mirrored): Curve(h, mirrored, -width, width)
        for h in couplings
        for mirrored in (False, True)
    }


def falls(p: Problem, turn: Phase, each: Any, exact: Any, curves: Curves) -> None:
    """The rows of a phase; where it has no end, at rest at the rate as well."""
    rho, heard, parts = exact.rho or ONE, p.heard[turn.mode], []
    for (a, b), (v, w) in zip(pairwise(each.times), pairwise(each.v), strict=True):
        parts.append(Face((v, w), (v, w), [(y - x) / (b - a) for x, y in zip(v, w, strict=True)]))
    if turn.longest is None:
        last = each.v[-1]
        parts.append(Face((last, last), (last, last), [-exact.rate * x for x in last]))
    for face in parts:
        for mirrored in (False, True):
            for i in range(p.n):
                holds = shown(p, heard[i], i, face, (ZERO, ZERO), curves, mirrored, HALVINGS, rho)
                need(holds, f"the row of agent {p.labels[i]} in mode {turn.mode} is not shown")


def cycles(turns: list[Phase]) -> list[tuple[str, ...]]:
    """Modes that may be on over and over, and no other; no longer cycle lacks all of them."""
    alone = [(turn.mode,) for turn in turns if turn.longest is None]
    every = tuple(dict.fromkeys(turn.mode for turn in turns))
    return [
        *alone,
        *(
            combinations(every, 2)
            if len(turns) > 1 and all(turn.first for turn in turns)
            else [every]
        ),
    ]


def allowed(p: Problem) -> list[tuple[str, ...]]:
    """All modes, whatever arcs are there, and the cycles that a guarantee allows of at most PHASES
    phases."""
    guaranteed = len(p.modes) > 1 and (p.switching or {}).get("guarantee") in ("dwell", "sequence")
    turns = phases(p) if guaranteed else []
    return [tuple(p.modes), *(cycles(turns) if 0 < len(turns) <= PHASES else [])]


def rises(
    p: Problem, couplings: Iterable[Coupling], rho: Fraction | None, strictly: bool = True
) -> None:
    """Couplings rise on |y| <= 2 rho, ``strictly`` at 0, and no gain pushes outward."""
    width = enclosed(2 * (rho or ZERO))[1]
    need(all(p.least_gain(i) >= 0 for i in range(p.n)), "a gain pushes outward")
    for h in couplings:
        curve = Curve(h, False, -width, width)
        # a kink has its slopes on both sides
        slope = curve.at((-NEAR, NEAR))[1] if h.kinked else h.slope(0, 0)
        flat = not strictly and (slope[0] >= 0 or not h.straight)
        need(slope[0] > 0 or flat, "a coupling does not rise at the target")
        need(h.straight or all(cell.way == 1 for cell in curve.table), "a coupling may fall")


def reached(p: Problem, modes: Iterable[str]) -> None:
    """Along the arcs of these modes together every agent is reached from one that its gain
    holds."""
    pinned = [i for i in range(p.n) if p.least_gain(i) > 0]
    need(
        len(reach(pinned, p.edges(modes, False))) == p.n,
        f"modes {', '.join(modes)} do not reach every agent",
    )


# --- Rows of boxes that move, for settling times as well
# --------------------------------------------------------------
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
    curves: Curves,
    mirrored: bool,
    halvings: int,
    rho: Fraction = ZERO,
) -> bool:
    """Whether a row holds on a part of a segment, whole or in halves: what drives e_i outward on
    the face is at most the speed of the face; with ``rho`` for the box times every s of (0,
    rho]."""
    still()
    held = min(p.least_gain(i) * box[i] for box in face.own)
    room, terms, slopes = held + face.speed[i] - max(loads), list[Term](), ZERO
    for arc in arcs:
        step = max([ZERO] * arc.loose + [own[arc.j] - own[i] for own in face.own])
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
    return all(
        shown(p, arcs, i, *part, curves, mirrored, halvings - 1, rho)
        for part in halves(face, loads)
    )


def halves(
    face: Face, loads: tuple[Fraction, Fraction]
) -> Iterator[tuple[Face, tuple[Fraction, Fraction]]]:
    """The two halves of a part of a segment."""
    own, other = (
        [(a + b) / 2 for a, b in zip(*ends, strict=True)] for ends in (face.own, face.other)
    )
    load = sum(loads, ZERO) / 2
    yield Face((face.own[0], own), (face.other[0], other), face.speed), (loads[0], load)
    yield Face((own, face.own[1]), (other, face.other[1]), face.speed), (load, loads[1])


# --- Errors that grow from round to round: |tr M^k| > n m, M the linear map of a round
# --------------------------------
BITS = 256
# limits, the last of the sum of |J - K| T in the largest row sum
POWER, ROWS, ROUND, GROWTH = 64, 20, 200, 1000

# a matrix in units of 2^-BITS, and a bound of what its rows may miss, in all
Ball = tuple[list[list[int]], int]


def grows(p: Problem, check: Any) -> None:
    """The trace of a power of M, the product of exp((J - K) T) over the phases, is larger than M
    can have with eigenvalues of size 1 at most."""
    power, turns = read(check.exact, {"power": rational}).power, timed(p)
    need(
        check.witness is None and p.domain == "global",
        "it is about linear couplings, and has no witness",
    )
    need(
        0 < len(turns) <= ROUND and p.n * p.m <= ROWS,
        "so long a round, or so many rows, are not followed here",
    )
    need(
        power.denominator == 1 and 1 <= power <= POWER,
        "the power is no whole number from 1 on, or too large",
    )
    parts = [(turn.mode, turn.shortest) for turn in turns]
    sizes = {
        part: [[x * part[1] for x in row] for row in p.jacobian(part[0])] for part in set(parts)
    }
    reach = sum(max(sum(map(abs, row)) for row in sizes[part]) for part in parts)
    need(reach <= GROWTH, "a round is too long")
    known = {part: exponential(X) for part, X in sizes.items()}
    whole = known[parts[0]]
    for part in parts[1:]:
        whole = multiplied(known[part], whole)
    found = whole
    for _ in range(int(power) - 1):
        found = multiplied(found, whole)
    size = p.n * p.m
    trace = abs(sum(found[0][k][k] for k in range(size))) - size * found[1]
    need(trace > size << BITS, "it is not shown that errors grow")


def multiplied(X: Ball, Y: Ball) -> Ball:
    """The product; rounding each entry misses less than one unit."""
    still()
    (x, r), (y, s) = X, Y
    columns = list(zip(*y, strict=True))
    entries = [
        [sum(a * b for a, b in zip(row, column, strict=True)) >> BITS for column in columns]
        for row in x
    ]
    return entries, ((largest_row(x) * s + largest_row(y) * r + r * s) >> BITS) + 1 + len(x)


def largest_row(x: list[list[int]]) -> int:
    """The largest sum of sizes in a row, in units."""
    return max(sum(map(abs, row)) for row in x)


def exponential(X: list[list[Fraction]]) -> Ball:
    """exp(X): its series at X / 2^k with rows of at most 1/4, whose rest is below one unit, squared
    k times."""
    size, halvings = len(X), 0
    while max(sum(map(abs, row)) for row in X) > Fraction(2**halvings, 4):
        halvings += 1
    small: Ball = [[int(x * 2**BITS // 2**halvings) for x in row] for row in X], size
    unit = [[(a == b) << BITS for b in range(size)] for a in range(size)]
    total, missed, term = unit, 1, (unit, 0)
    for k in range(1, BITS // 4):
        rows, r = multiplied(term, small)
        term = [[x // k for x in row] for row in rows], r // k + 1 + size
        total = [
            [a + b for a, b in zip(*both, strict=True)] for both in zip(total, term[0], strict=True)
        ]
        missed += term[1]
    found: Ball = total, missed
    for _ in range(halvings):
        found = multiplied(found, found)
    return found
