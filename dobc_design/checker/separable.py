"""max-separable, delay, sampling and readings: N = max |e_ic| / v_i decreases, shown row by row on
every face of a box.

With an exosystem V = N + kappa max sqrt(eps_i'P eps_i) decreases. At the end: equilibrium, another
place of rest.
"""

import math
from collections.abc import Iterable, Iterator
from fractions import Fraction
from functools import cache, partial
from itertools import pairwise
from typing import Any, NamedTuple

from .claims import Case, need_rate
from .consensus import jacobian, omega
from .curves import Curve, Curves, Term, both_faces, on_pieces
from .expressions import Coupling, variables
from .intervals import (
    NOTHING,
    ONE,
    PI,
    Floats,
    added,
    by_decimal,
    dot,
    enclosed,
    hull,
    magnitude,
    negative,
    power,
    times,
    total,
    wave,
)
from .loop import Arc, Loop, Timing
from .matrices import (
    ZERO,
    Matrix,
    Vector,
    characteristic,
    diagonal,
    identity,
    integers,
    is_diagonal,
    is_form,
    nonnegative,
    norm,
    opposite,
    paired,
    plus,
    product,
    root,
    solved,
    transpose,
)
from .reading import (
    Object,
    an_object,
    matrix,
    maybe,
    need,
    rational,
    read,
    same,
    short_matrix,
    text,
    weights,
)
from .sampled import BITS, exponential, inside, shrinks, ticks
from .saturation import amplitude, saturates

EQUATIONS = 60  # of an equilibrium at most
ONCE = Fraction(1)
PLAIN = identity(1)  # T of a claim that is not in coordinates


# --- max-separable
def max_separable(case: Case, check: Any) -> Any:
    """V decreases in the region, at the rate of the check; or no v does."""
    if check.verdict == "refuted":
        stuck(case, check)
        return None
    claim = read_separable(case, check.exact)
    need_rate(check, pace(case, claim), "the rate is not between 0 and what follows")
    contains(case, claim, check.domain)
    rows(case, claim, claim.alpha)
    return claim


def stuck(loop: Loop, check: Any) -> None:
    """Agents each of which has, in some mode, no gain that holds it and hears nobody outside the
    set."""
    witness = read(check.witness, {"kind": text, "labels": [text]})
    a_set = check.exact is None and witness.kind == "agents"
    need(a_set, "it claims a value, or its witness is no set of agents")
    group = set(witness.labels)
    different = group <= set(loop.labels) and 0 < len(group) == len(witness.labels)
    need(different, "the witness names no different agents")
    members = {i for i, label in enumerate(loop.labels) if label in group}
    for i in members:
        inside = False
        for heard in loop.heard.values():
            # arcs that come and go may be away
            inside |= all(arc.loose or arc.j in members for arc in heard[i])
        stays = loop.least_gain(i) <= 0 and inside
        need(stays, "an agent of the witness is held, or hears somebody outside")


def observed(loop: Loop) -> Object:
    """The shape of the observer's part of a claim."""
    if loop.q == 0:
        return {}
    return {"P": matrix(loop.q, loop.q), **dict.fromkeys(("beta", "kappa", "size"), rational)}


def read_separable(case: Case, exact: Any) -> Any:
    """What a max-separable claims: N decays at alpha where N <= rho (null: everywhere); with an
    exosystem, that |C eps_i| <= E = max sqrt(eps_i'P eps_i), which decays at the rate beta."""
    shape = {"v": partial(weights, case.n), "alpha": rational, "rho": maybe(rational)}
    claim = read(exact, shape | observed(case))
    need(case.q == 0 or claim.kappa > 0, "kappa is not positive")
    return claim


def pace(case: Case, claim: Any) -> Fraction:
    """The rate of V that follows: eps adds at most E / min v to N', and -kappa beta E to V'."""
    if case.q == 0:
        return Fraction(claim.alpha)
    second = claim.beta - 1 / (claim.kappa * min(claim.v))
    return Fraction(min(claim.alpha, second))


def contains(case: Case, claim: Any, domain: Any) -> None:
    """The observer's part, and all starts of the domain."""
    composite(case, claim)
    holds_starts(case, claim, domain)


def holds_starts(case: Case, claim: Any, domain: Any, drift: Fraction = ZERO) -> None:
    """All starts of the domain, and what is up to ``drift`` farther."""
    if claim.rho is None:
        need(domain == "global" == case.domain, "it has no rho and is not global")
    else:
        starts(case, domain, "box")
        holds_box(claim, domain.radius + drift, domain.disturbance, claim.rho)


def frame(claim: Any) -> Matrix:
    """T of a claim about z = T e."""
    return getattr(claim, "T", None) or PLAIN


def spread(T: Matrix, v: Vector) -> Fraction:
    """The largest N of errors with |e| <= 1."""
    return max(Fraction(sum(map(abs, row))) / min(v[c :: len(T)]) for c, row in enumerate(T))


def composite(case: Case, claim: Any, ahead: Fraction = ZERO) -> None:
    """The observer's part, if there is an exosystem; estimates are predicted by ``ahead``."""
    if case.q == 0:
        return
    P = claim.P
    T = frame(claim)
    C = case.C
    short_matrix(P)
    need(is_form(P), "P > 0 is not shown")
    around = ZERO
    if case.sampled:
        found = ticks(case, case.timing)
        C, around = found.C, found.around
        left = 1 - case.timing.period * claim.beta
        need(left > 0 and shrinks(P, found, left), "beta is not shown")
    else:
        need(nonnegative(opposite(omega(case, P, claim.beta))), "beta is not shown")
    if ahead:
        moved = exponential([[x * ahead for x in row] for row in case.A])
        missed = Fraction(moved.missed, 2**BITS)
        around = around * (norm(moved.middle) + missed) + norm(C) * missed
        C = product(C, moved.middle)
    if T != PLAIN:
        C = product(diagonal([T] * len(case.residuals)), C)  # of z
    for c in C:
        # c'c <= P: then |c eps| <= sqrt(eps'P eps), row by row
        square = product(transpose([c]), [c])
        more = around * (2 * sum(map(abs, c)) + around)
        square = plus(square, more, identity(case.q))
        need(nonnegative(plus(P, -1, square)), "c'c <= P is not shown")
    room = plus(identity(case.q, claim.size), -1, P)
    # size bounds sqrt(eps'P eps) at the start by sqrt(size) s
    need(nonnegative(room), "P <= size I is not shown")


def starts(case: Case, domain: Any, kind: str) -> None:
    """The domain is a box or ball of starts."""
    need(type(domain) is not str and domain.kind == kind, f"the domain is no {kind}")
    there = None not in (domain.radius, domain.disturbance)
    # a box without starts would prove something about none
    need(there and domain.radius > 0 <= domain.disturbance, "it is empty")
    need(case.q > 0 or domain.disturbance == 0, "there is a disturbance, but no exosystem")


def holds_box(claim: Any, radius: Fraction, s: Fraction, level: Fraction) -> None:
    """V <= level at every start of the box."""
    left = level - radius * spread(frame(claim), claim.v)
    # asked by itself: its square would hide the sign
    need(left >= 0, "the box leaves the region")
    # without roots: kappa s sqrt(size) <= left
    noise = (claim.kappa * s) ** 2 * claim.size if s else ZERO
    need(noise <= left**2, "the disturbance leaves the region")


NEAR = Fraction(1, 1024)  # part of rho on which slopes are tried for all of h


# --- rows: sum of w sup {h(y): -s p <= y <= s q} <= s c for all s in (0, rho], with p = v_i + v_j
# and q = v_j - v_i
class Heard(NamedTuple):
    """An arc of a row: its coupling, its weight and v_j; it may be loose."""

    h: Coupling
    w: Fraction
    top: int
    loose: bool


class Row(NamedTuple):
    """The row of an agent: its v, the bound c and its arcs; v and c in one unit. Of a loose arc the
    supremum is taken up to y = 0 at least: there it adds nothing, as if it were absent."""

    own: int
    c: Fraction
    arcs: tuple[Heard, ...]

    def step(self, arc: Heard) -> int:
        """v_j - v_i, or 0 for a loose arc if that is more."""
        step = arc.top - self.own
        if arc.loose:
            return max(step, 0)
        return step


class Errors(NamedTuple):
    """What the rows have to stand beside the model: relative errors of weights and gains, and a
    load that acts on an agent, from s = ``start`` on."""

    weights: Fraction = ZERO
    gains: Fraction = ZERO
    load: Fraction = ZERO
    start: Fraction = ZERO

    def of(self, arc: Heard) -> Fraction:
        """That of the weight of an arc; one to a node whose error is 0 may be a pin."""
        return self.weights if arc.top else max(self.weights, self.gains)


EXACT = Errors()
Sides = tuple[list[int], list[int], int]  # v_i, v_j, and their unit


def rows(
    case: Case,
    claim: Any,
    alpha: Fraction,
    theta: Fraction = ONCE,
    errors: Errors = EXACT,
    local: bool = False,
) -> None:
    """Both faces of all rows, equal ones once; v_j counts theta times.  ``local``: for slopes at
    the target."""
    weights = stretched(case, claim.v, theta)
    owns, tops, bottom = weights
    found: dict[Row, int] = {}
    for i, heard in case.rows:
        arcs = [Heard(arc.coupling, arc.w, tops[arc.j], arc.loose) for arc in heard]
        # agents whose rows are the same are decided once
        arcs.sort(key=lambda arc: (arc.h.h, *arc[1:]))
        c = (case.least_gain(i, errors.gains) - alpha) * owns[i]
        found.setdefault(Row(owns[i], c, tuple(arcs)), i)

    curves = tables(case, claim.rho, weights)
    if case.gap:
        rising(case, claim.rho or ZERO, weights)
    for row, i in found.items():
        shown = linear_row(row, errors, local)
        if not shown and claim.rho is not None:
            shown = curved_row(row, bottom, claim.rho, curves, errors)
        need(shown, f"the row of agent {case.labels[i]} is not shown")


def stretched(loop: Loop, v: Vector, theta: Fraction) -> Sides:
    """v_i, theta v_j, and their unit."""
    found, bottom = integers(v)
    owns = loop.with_fixed([x * theta.denominator for x in found])
    tops = loop.with_fixed([x * theta.numerator for x in found])
    return owns, tops, bottom * theta.denominator


def rising(loop: Loop, rho: Fraction, weights: Sides) -> None:
    """All couplings rise on |y| <= rho (v_i + v_j) + gap: whatever a node hears from between the
    fixed nodes, or knows of itself, the end of the row is the worst."""
    owns, tops, bottom = weights
    reach: dict[Coupling, int] = {}
    for arc in loop.arcs:
        reach[arc.coupling] = max(reach.get(arc.coupling, 0), owns[arc.i] + tops[arc.j])
    for h, most in reach.items():
        end = enclosed(loop.gap + rho * Fraction(most, bottom))[1]
        cells = Curve(h, False, -end, end).table
        need(all(cell.way == 1 for cell in cells), "a coupling falls as far as rows look")


def tables(loop: Loop, rho: Fraction | None, weights: Sides, wide: bool = False) -> Curves:
    """All couplings, with tables as far as the arcs need them: to rho (v_i + v_j) below, and to rho
    (v_j - v_i) above, or (``wide``) as far as below. ``weights``: v_i, v_j, and their unit."""
    curves: Curves = {}
    if rho is None:
        return curves
    owns, tops, bottom = weights
    found: dict[Coupling, tuple[int, int]] = {}
    for arc in loop.arcs:
        low, high = found.get(arc.coupling, (0, 0))
        own = owns[arc.i]
        top = tops[arc.j]
        found[arc.coupling] = max(low, own + top), max(high, own + top if wide else top - own)
    for h, ends in found.items():
        low_end, high_end = (times(enclosed(rho), enclosed(Fraction(x, bottom)))[1] for x in ends)
        curves |= both_faces([h], -low_end, high_end)
    return curves


def linear_row(row: Row, errors: Errors, local: bool = False) -> bool:
    """True if a row of linear couplings holds, with a load added: its two faces are the same, and s
    does not matter."""
    if not (local or all(arc.h.straight for arc in row.arcs)):
        return False
    return steepest_row(row, errors, [arc.h.slope(0, 0) for arc in row.arcs])


def steepest_row(row: Row, errors: Errors, slopes: Iterable[Any]) -> bool:
    """The same where y times a slope between two bounds is at least every coupling, exactly."""
    left = errors.load
    for arc, both in paired(row.arcs, slopes):
        # a linear function is largest at an end of what y may be
        sides = (row.step(arc), -arc.top - row.own)
        most = max(Fraction(g) * y for g in both for y in sides)
        # a supremum may have any sign: either end of the weight may be the worse one
        weights = (arc.w * (1 - errors.of(arc)), arc.w * (1 + errors.of(arc)))
        left += max(w * most for w in weights)
    return left <= row.c


def steepness(term: Term, s: float) -> Floats:
    """The slopes of a coupling for all smaller s."""
    low, high = (times((s, s), side)[1] for side in (term.p, term.q))
    return term.curve.at((-low, max(0.0, high)))[1]


def curved_row(row: Row, bottom: int, rho: Fraction, curves: Curves, errors: Errors) -> bool:
    """Both faces of a row on pieces of (0, rho], or of [start, rho]; a weight is an interval, so
    that products have the worse end."""
    sizes = [abs(row.c) / bottom, errors.load, *(arc.w for arc in row.arcs)]
    unit = max(Fraction(2**400), *sizes) / 2**400  # for huge ones
    c = enclosed(row.c / bottom / unit)
    load = enclosed(errors.load / unit)

    @cache
    def side(x: int) -> Floats:
        return enclosed(Fraction(x, bottom))

    for mirrored in (False, True):
        terms = []
        for arc in row.arcs:
            ends = [arc.w * (1 + sign * errors.of(arc)) / unit for sign in (-1, 1)]
            # all weights within their errors
            w = hull(*map(enclosed, ends))
            curve = curves[arc.h, mirrored]
            terms.append(Term(curve, w, side(arc.top + row.own), side(row.step(arc))))
        start, near = (enclosed(x)[0] for x in (errors.start, rho * NEAR))
        # there a row may have no room at all, which floating point does not see
        slopes = [steepness(each, near) for each in terms]
        if not errors.load and steepest_row(row, errors, slopes):
            start = near
        if not on_pieces(terms, c, load, enclosed(rho)[1], start):
            return False
    return True


# --- delay and sampling
def beside(case: Case, check: Any) -> Any:
    """The proved max-separable with the same domain."""
    proof = case.proved("max-separable")
    same_domain = proof is not None and proof.domain == check.domain
    need(same_domain, "no max-separable with this domain is proved")
    return read_separable(case, proof.exact)


def delay(case: Case, check: Any) -> Any:
    """The rows hold with theta v_j for v_j: agents may hear each other late."""
    claim = beside(case, check)
    shape = dict.fromkeys(("delay", "rate", "own_delay?", "event?"), rational)
    exact = read(check.exact, shape)
    own = exact.own_delay or ZERO
    event = exact.event or ZERO
    need(min(exact.delay, own, event) >= 0, "a delay is negative")
    need_rate(check, exact.rate, "the rate is not between 0 and that of the rows")
    need(case.q == 0 or exact.rate <= claim.beta, "the rate is larger than that of the observer")
    # readings are late or off, not both
    theta = max(few_bits(growth(exact.delay * exact.rate)), 1 + event)
    rows(case, claim, exact.rate, theta)
    if own:
        need(case.B is None, "dynamics of the agents themselves are not late")
        timing = Timing(exact.delay, own, ZERO, 0, event, False, False)
        know_themselves(case, claim, exact.rate, timing, theta)
    return claim


def growth(x: Fraction) -> Fraction:
    """An upper bound of exp(x)."""
    return by_decimal("exp", (x, x))[1]


def few_bits(theta: Fraction) -> Fraction:
    """Rounded up: a larger theta only makes the rows harder."""
    return Fraction(math.ceil(theta * 2**60), 2**60)


def sampling(case: Case, check: Any) -> None:
    """Couplings and gains held over periods: no step overshoots."""
    claim = beside(case, check)
    exact = read(check.exact, {"period": rational, "factor": rational, "certificate?": an_object})
    need(check.rate is None, "it has no rate to claim")
    # the proof holds everything but the estimate; A x goes on in between
    need(case.B is None, "dynamics of the agents themselves are not held")
    if exact.certificate is not None:
        claim = read_separable(case, exact.certificate)
        need(pace(case, claim) > 0, "its own certificate has no rate")
        contains(case, claim, check.domain)
        rows(case, claim, claim.alpha)
    follows = 1 - exact.period * claim.alpha <= exact.factor < 1
    need(follows, "the factor does not follow from the period")

    gentle(case, claim, 1 / exact.period)


def gentle(
    case: Case, claim: Any, most: Fraction, theta: Fraction = ONCE, late: bool = False
) -> None:
    """For every node the slopes of couplings, and its gain, add up to ``most`` at most: their means
    where a step overshoots, or (``late``) the largest as far as rows look."""
    owns, tops, bottom = weights = stretched(case, claim.v, theta)
    curves = tables(case, claim.rho, weights, wide=True)

    @cache
    def slope(h: Coupling, mirrored: bool, own: int, other: int, closely: bool) -> Fraction:
        if not claim.rho:
            return max(ZERO, h.slope(0, 0)[1])
        rho = enclosed(claim.rho)[1]
        curve = curves[h, mirrored]
        if late:
            end = times((rho, rho), enclosed(Fraction(own + other, bottom)))[1]
            return Fraction((curve.steepest if closely else curve.slope)(-end, end))
        return mean_slope(curve, rho, (own, other, bottom), closely)

    def within(i: int, heard: list[Arc], mirrored: bool, closely: bool) -> bool:
        left = max(row[c] for c, row in enumerate(case.gain(i)))
        for arc in heard:
            left += arc.w * slope(arc.coupling, mirrored, owns[i], tops[arc.j], closely)
        # exact: a period of 1 is often the largest
        return bool(left <= most)

    for i, heard in case.rows:
        for mirrored in (False, True):
            # a close look takes longer, and is seldom needed
            shown = any(within(i, heard, mirrored, closely) for closely in (False, True))
            need(shown, f"too long for agent {case.labels[i]}")


def mean_slope(curve: Curve, rho: float, v: tuple[int, int, int], closely: bool) -> Fraction:
    """An upper bound of L: eight slices of x, the supremum of h' over each of the growing
    intervals."""
    own, other, bottom = v

    def scaled(y: int, unit: int) -> Floats:
        return times((rho, rho), enclosed(Fraction(y, unit)))

    # |y| is at most rho (v_i + v_j)
    farthest = scaled(own + other, bottom)[1]
    rises = all(cell.way == 1 for cell in curve.between(-farthest, farthest))
    left = min(scaled(other - own, bottom)[0], 0.0) if rises else -farthest
    slope = 0.0
    mean = ZERO
    for k in range(9):  # k = 0: what holds at x = 0 holds at all
        right = max(0.0, scaled(4 * (other - own) + k * own, 4 * bottom)[1])
        ends = [left + (right - left) * part / 4 for part in range(4)]
        for a, b in pairwise([*ends, right]):
            end = max(a, b)  # rounding may bring them out of order
            slope = max(slope, curve.steepest(a, end) if closely else curve.slope(a, end))
        if k:
            mean += Fraction(slope) / 8
        left = right
    return mean


# --- readings
MOST = 30  # equations whose roots are looked at


def readings(case: Case, check: Any) -> Any:
    """The rows hold with readings as late, lost and false as the problem says, no node overshoots,
    and kappa stands what the estimates were off by in the meantime; or linear couplings diverge."""
    timing = case.timing
    need(timing is not None, "the problem says nothing of readings")
    if check.verdict == "refuted":
        diverges(case, check)
        return None
    known_late(case, timing)
    claim = read_separable(case, check.exact)
    T = timing.period
    need_rate(check, claim.alpha, "the rate is not between 0 and that of the rows")
    need(T * claim.alpha < 1, "nothing would be left after a period")
    composite(case, claim, timing.ahead)
    plant = case.uncertainty
    errors = EXACT if plant is None else Errors(plant.weights, plant.gains)
    age = timing.ticks(timing.delay) + timing.lost if T else timing.delay
    theta = (1 + timing.event) * few_bits(grown(timing, claim.alpha, age, T > 0))
    rows(case, claim, claim.alpha, theta, errors)
    drift = ZERO
    if timing.ahead and case.q and claim.rho is not None:
        drift = timing.ahead * max(amplitude(case, i) for i in case.nodes)
    holds_starts(case, claim, check.domain, drift)
    most = None
    if drift:
        # what was read before the first input acted counts as an error of the estimates
        left = claim.rho - (check.domain.radius + drift) / min(claim.v)
        left = left / claim.kappa - check.domain.disturbance * root(claim.size)
        most = left / (drift * stale(timing, claim.beta))
    know_themselves(case, claim, claim.alpha, timing, theta, errors, most)
    return claim


def known_late(case: Case, timing: Timing) -> None:
    """What is not followed together with readings."""
    plant = case.uncertainty
    seen = plant is None or plant.known_to_agents or case.q == 0
    known = seen and (plant is None or not (plant.drift or case.disturbed))
    need(known, "disturbances beside the exosystem are not known with readings")
    limits = case.actuators is not None and case.actuators.limit and not saturates(case)
    need(not limits, "limits of inputs are not known with readings")
    # A x and f go on while readings are held
    alone = case.B is None or not (timing.own_delay or timing.period)
    need(alone, "dynamics of the agents themselves are not held")
    together = not (case.differences or case.leader is not None)
    need(together or not timing.late, "a target that moves on is not known late")


def grown(timing: Timing, rate: Fraction, age: Fraction | int, by_ticks: bool) -> Fraction:
    """An upper bound of what has decayed at a rate for some time, or for some ticks: how much
    larger it was."""
    if not by_ticks:
        return growth(rate * age)
    left = 1 - timing.period * rate
    return power((left, left), -int(age))[1]


def stale(timing: Timing, beta: Fraction) -> Fraction:
    """How much larger the error of the observer was when a node knew itself."""
    age = timing.own_delay
    if timing.period:
        age = timing.ticks(age) * (Fraction(1) if timing.sampled else timing.period)
    return grown(timing, beta, age, timing.sampled)


def know_themselves(
    case: Case,
    claim: Any,
    alpha: Fraction,
    timing: Timing,
    theta: Fraction,
    errors: Errors = EXACT,
    allowed: Fraction | None = None,
) -> None:
    """No node goes too far, although it knows itself late or now and then; slopes and gains add up
    to no more than is ``allowed``."""
    most = overshoot(case, claim, alpha, timing)
    if most is None:
        return
    most = min(most, most if allowed is None else allowed)
    late = timing.own_delay > 0
    if late:
        unmixed(case, claim, theta)
    gentle(case, claim, most / (1 + max(errors.weights, errors.gains)), theta, late)


def overshoot(case: Case, claim: Any, alpha: Fraction, timing: Timing) -> Fraction | None:
    """What slopes and gain of a node may add up to: so much that what it knows of itself does not
    take it too far, nor what its observer was off by then; none where it knows itself."""
    T = timing.period
    d = timing.ticks(timing.own_delay) if T else 0
    most = None
    if T:
        most = Fraction(d**d, (d + 1) ** (d + 1)) / T
    elif timing.own_delay:
        most = by_decimal("exp", (-ONCE, -ONCE))[0] / timing.own_delay
    if case.q == 0:
        return most
    beta = claim.beta
    since = stale(timing, beta) - 1
    decay = beta
    if T and not timing.sampled:
        # within a period the estimates go on
        decay = (1 - growth(-beta * T)) / T
    left = decay - alpha - 1 / (claim.kappa * min(claim.v))
    need(left >= 0, "kappa is too small")
    if most is None or since == 0:
        return most
    return Fraction(min(most, left / since))


def unmixed(case: Case, claim: Any, theta: Fraction) -> None:
    """What pulls a node back does so component by component, and where it is late, not more than it
    is off."""
    held = all(is_diagonal(k) and min(map(min, k)) >= 0 for k in case.hold.values())
    need(held, "a gain that mixes components, or pushes, is late")
    straight = all(arc.coupling.slope(0, 0)[0] >= 0 for arc in case.arcs)
    need(straight, "a coupling falls")
    rising(case, claim.rho or ZERO, stretched(case, claim.v, theta))


def diverges(case: Case, check: Any) -> None:
    """Of e' = -M e with one delay in everything an eigenvalue mu of M has |mu| tau > pi/2 - |arg
    mu|; or a step of T has one that is not inside the unit circle."""
    witness = read(check.witness, {"kind": text, "values": [rational]})
    one = check.exact is None and witness.kind == "eigenvalue"
    need(one, "it claims a value, or its witness is no eigenvalue")
    apart = case.differences or case.gap or case.switches or saturates(case)
    integrators = case.B is None and all(h.straight for h in case.functions)
    need(integrators and not apart, "it is about linear couplings to one target")
    need(case.size <= MOST, "so many eigenvalues are not looked at")
    slopes = jacobian(case, next(iter(case.modes)))
    timing = case.timing
    if timing.period:
        late = timing.ticks(timing.ahead)
        need(case.size * (late + 1) <= MOST, "so many eigenvalues are not looked at")
        found = inside([(c, c) for c in characteristic(late_step(timing.period, slopes, late))])
        need(found is False and not witness.values, "it is not shown that a step overshoots")
        return
    need(len(witness.values) == 2, "an eigenvalue has two parts")
    x, y = witness.values
    off = to_a_root(characteristic(opposite(slopes)), x, y)
    size = by_decimal("sqrt", (x * x + y * y,) * 2)[0] - off
    turn = max(ZERO, size) * min(timing.delay, timing.own_delay)
    # below pi/2: Re mu < |mu| sin(|mu| tau)
    far = 2 * turn >= PI[1] or x + off < size * wave((turn, turn), 0)[0]
    need(turn > 0 and far, "it is not shown to turn too far")


def late_step(T: Fraction, slopes: Matrix, late: int) -> Matrix:
    """x_k+1 = x_k + T slopes x_(k - late), of the states from x_k to x_(k - late)."""
    size = len(slopes)
    whole = identity(size * (late + 1))
    first = [list(row) for row in whole[:size]]
    for row, felt in paired(first, slopes):
        for c, x in enumerate(felt):
            row[size * late + c] += T * x
    return first + whole[: size * late]


def to_a_root(p: Vector, x: Fraction, y: Fraction) -> Fraction:
    """How far the root of a polynomial that is next to z = x + i y is from it at most.

    |p^(k)(z)/k! / p(z)| is the size of a sum of products of k different 1/(z - root), so at most
    binomial(n, k)/d^k: a k from 2 on serves near a root that is one several times.
    """
    n = len(p) - 1
    parts = [(c, ZERO) for c in p]
    squares = []  # |p^(k)(z)/k!|^2
    for k in range(n + 1):
        for j in range(1, n + 1 - k):
            (u, v), (a, b) = parts[j - 1 : j + 1]
            parts[j] = (a + u * x - v * y, b + u * y + v * x)
        a, b = parts[n - k]
        squares.append(a * a + b * b)
    if not squares[0]:
        return ZERO
    found = []
    for k in range(1, n + 1):
        if squares[k]:
            power = math.comb(n, k) ** 2 * squares[0] / squares[k]
            # a power of 2 above its root of order 2 k
            found.append(Fraction(2) ** -((-magnitude(power) - 1) // (2 * k)))
    return min(found)


# --- equilibrium: a box that holds one of h(e) - K e other than 0, by the test of Krawczyk
def equilibrium(case: Case, check: Any) -> None:
    """c - Y f(c) + (I - Y F'(X)) (X - c) lies inside X, so that f = 0 somewhere in X; or X is a
    point with f = 0."""
    size = case.size
    need(size <= EQUATIONS, f"an equilibrium is looked at up to {EQUATIONS} equations")
    exact = read(check.exact, {"mode": text, "box": ((rational, rational),) * size})
    box = exact.box
    need(exact.mode in case.modes, "there is no such mode")
    middle = [(lo + hi) / 2 for lo, hi in box]
    witness = {"kind": "start", "values": middle}
    need(same(check.witness, witness), "the witness is not the middle of the box")
    # the target itself is an equilibrium, which refutes nothing
    need(any(lo > 0 or hi < 0 for lo, hi in box), "the box contains the target")
    region = case.exact_region
    if region is not None:
        for k, (lo, hi) in enumerate(box):
            i, c = divmod(k, case.m)
            low, high = region.initial_states[c]
            goal = case.goals[i][c]
            need(low <= lo + goal and hi + goal <= high, "the box leaves the region")
    rests = is_rest(case, exact.mode, box)
    images = krawczyk(case, exact.mode, box, middle)
    for (lo, hi), image in paired(box, images):
        inside = lo < Fraction(image[0]) and Fraction(image[1]) < hi
        need(rests or inside, "no equilibrium is shown in the box")


def is_rest(loop: Loop, mode: str, box: Matrix) -> bool:
    """Whether a box is a point with f = 0, exactly."""
    if any(lo != hi for lo, hi in box):
        return False
    values, _ = forces(loop, mode, box, lambda x: (x, x))
    return not any(map(any, values))


def krawczyk(loop: Loop, mode: str, box: Matrix, middle: Vector) -> Iterator[Floats]:
    """The image c - Y f(c) + (I - Y F'(X)) (X - c) of a box X with the middle c."""
    size = len(box)
    # slopes on the whole box, values in its middle
    _, slopes = forces(loop, mode, box)
    values, _ = forces(loop, mode, [[x, x] for x in middle])
    # about the inverse of the middle slopes: any Y is allowed, so that it may be cut off
    rough = []
    for row in slopes:
        sums = [max(-1e200, min(sum(row.get(k, NOTHING)), 1e200)) for k in range(size)]
        rough.append([Fraction(round(x * 2**30), 2**31) for x in sums])
    Y = solved(rough, identity(size))
    halves = [enclosed((hi - lo) / 2)[1] for lo, hi in box]
    for a in range(size):
        factors = [enclosed(-x) for x in Y[a]]
        rest = {k: [ONE] * (k == a) for k in range(size)}
        for factor, row in paired(factors, slopes):
            for k, slope in row.items():
                rest[k].append(times(factor, slope))
        spread = dot(map(total, rest.values()), ((-half, half) for half in halves))
        yield total([enclosed(middle[a]), dot(factors, values), spread])


def forces(
    loop: Loop, mode: str, e: Matrix, kind: Any = enclosed
) -> tuple[list[Floats], list[dict[int, Floats]]]:
    """h(e) - K e and its slopes for all e in a box, in the numbers of this kind."""
    m = loop.m
    zero = kind(ZERO)
    values = [zero] * len(e)
    slopes: list[dict[int, Floats]] = [{} for _ in e]
    e = [*e, *[[ZERO, ZERO]] * m * loop.fixed]

    def push(row: int, w: Floats, value: Floats) -> None:
        values[row] = added(values[row], times(w, value))

    def lean(row: int, column: int, w: Floats, slope: Floats) -> None:
        slopes[row][column] = added(slopes[row].get(column, zero), times(w, slope))

    for arc in loop.modes[mode]:
        w = kind(arc.w)
        for c in range(m):
            row = arc.i * m + c
            components = [c] if arc.coupling.single else range(m)
            own = [arc.i * m + d for d in components]
            other = [arc.j * m + d for d in components]
            y = []
            for a, b in paired(own, other):
                y.append((kind(e[b][0] - e[a][1])[0], kind(e[b][1] - e[a][0])[1]))
            part = arc.coupling.parts[c % len(arc.coupling.parts)]
            value, found = part.at(*variables(y))
            push(row, w, value)
            for a, b, slope in zip(own, other, found or [zero] * len(y), strict=True):
                if arc.j < loop.n:
                    lean(row, b, w, slope)
                lean(row, a, w, negative(slope))
    for i, k in loop.hold.items():
        for c, gains in enumerate(k):
            for d, gain in enumerate(gains):
                a = i * m + d
                push(i * m + c, kind(-gain), hull(*map(kind, e[a])))
                lean(i * m + c, a, kind(-gain), ONE)
    return values, slopes
