"""Certified bounds of |e(t)|_inf over time that follow from proved checks, and the one that belongs
to a simulated run.

Each V of a certificate falls like exp(-rate t) from its largest value over a set of starts, and
|e|_inf is at most a height times V (max-separable) or sqrt(V) (quadratic): theory, sections 2, 4
and 5.  Nothing is decided here.
"""

import json
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from dobc_design._checks import noun, positional
from dobc_design._show.cards import Card, Shown, listed
from dobc_design.conditions.check import Check, Claim
from dobc_design.conditions.consensus.claim import PairFacts
from dobc_design.conditions.coverage import asked_radius
from dobc_design.conditions.domain import EVERYWHERE, Around, Box
from dobc_design.conditions.graphs.claim import Kept
from dobc_design.conditions.kinds import LEMMA
from dobc_design.conditions.margins.decide import Tolerance
from dobc_design.conditions.numbers import claimed
from dobc_design.conditions.quadratic.claim import Quadratic
from dobc_design.conditions.quadratic.decide import diagonal_of_inverse, eigenvalue_bound
from dobc_design.conditions.schedule.checks import settling_of
from dobc_design.conditions.schedule.claim import Cycles, Descent
from dobc_design.conditions.schedule.settling import Settling
from dobc_design.conditions.separable.claim import ReadingsBound, Separable
from dobc_design.conditions.separable.decide import composite_rate
from dobc_design.conditions.stated import (
    LIMIT,
    TOLERANCE,
    knows_readings,
    stated_in,
    table_words,
)
from dobc_design.conditions.weighted.decide import Weighted
from dobc_design.conditions.weighted.network import Alike
from dobc_design.errors import refused, wrong
from dobc_design.exact.interval import Interval, exp
from dobc_design.exact.matrix import Array, Matrix
from dobc_design.exact.number import (
    ZERO,
    Number,
    float_above,
    float_below,
    parse_number,
    root_above,
)
from dobc_design.exact.reading import Table, Texts
from dobc_design.exact.symmetric import SparseSymmetric, largest, least
from dobc_design.loop.guarantee import shortest_period
from dobc_design.loop.loop import Loop
from dobc_design.loop.make import loop_of
from dobc_design.loop.pairs import are_pairs, rows_of
from dobc_design.loop.timing import Timing
from dobc_design.problem.canonical import loop_sha256
from dobc_design.problem.problem import Problem

from .claims import Claims, box_of, claim_of, reading_claims

#: Rows of a full P_e up to which the diagonal of its inverse is computed; beyond, its least
#: eigenvalue is used.
MOST_INVERTED = 40
#: Checks that bound the differences of all pairs of agents.
OF_PAIRS = ("max-separable", "schedule", "settling")
#: Starts count as inside a region when they exceed it by rounding only; floats of a run are what
#: they are.
ROOM = 1 + Fraction(1, 10**12)
#: Of the floats that evaluate height exp(-rate t): a thousand times what they can be off.
IN_HAND = 1e-12
_root = partial(root_above, unit=10**18)


@positional
class Starts:
    """Starts with |e|_inf <= box, |e| <= ball (Euclidean, all agents stacked) and |eps_i| <=
    disturbance."""

    box: Fraction
    ball: Fraction
    disturbance: Fraction


@noun
class Envelope:
    """|e(t)|_inf <= height exp(-rate t) for t >= 0 s, by the check ``id``; height in the unit of x,
    rate in 1/s."""

    id: str
    height: Fraction
    rate: Fraction


@noun
class CertifiedBound(Shown):
    """The least of several proved bounds of |e(t)|_inf, a function of times in s; without any,
    ``reason`` says why."""

    envelopes: tuple[Envelope, ...] = ()
    settling: Settling | None = None
    reason: str = ""

    def _card(self) -> Card:
        text = f"none: {self.reason}"
        if self.sources:
            text = f"of |e(t)|_inf, from {listed(self.sources)}"
        return Card(title="Certified bound", text=text)

    def __repr__(self) -> str:
        return f"<CertifiedBound {self._card().text}>"

    @property
    def sources(self) -> Texts:
        """The ids of the checks it follows from."""
        ids = [each.id for each in self.envelopes]
        if self.settling is not None:
            ids.append("settling")
        return tuple(ids)

    def __call__(self, times: ArrayLike) -> Array:
        """The bound at times >= 0 in s, rounded up, same shape.  Raises: SpecError if there is
        none."""
        t = np.asarray(times, dtype=np.float64)
        if not self.sources:
            raise refused("certificate", "there is no certified bound to evaluate.", self.reason)
        if not (np.isfinite(t).all() and (t >= 0).all()):
            raise refused("times", "times must be finite and >= 0 s.", "Leave out the others.")
        bounds: list[Array] = []
        for each in self.envelopes:
            # A larger height and a smaller rate claim less.
            height = float_above(each.height) * (1 + IN_HAND)
            falling = np.exp(-float_below(each.rate) * t)
            bounds.append(height * falling + np.finfo(float).tiny)  # exp may underflow
        if self.settling is not None:
            bounds.append(self.settling.envelope(t.ravel()).reshape(t.shape))
        return np.asarray(np.minimum.reduce(bounds))


def envelopes_of(loop: Loop, claims: Claims, starts: Starts) -> Iterator[Envelope]:
    """Bounds that hold for all of ``starts``, from every proved check whose domain holds them."""
    for check in claims.checks:
        bounds = check.kind.is_consensus or check.kind.role == "safety"
        if check.is_proved and bounds and is_inside(check.domain, starts):
            found = envelope_of(loop, check, claim_of(check, loop, claims.W), starts)
            if found is not None:
                yield found
    lemmas = [check for check in claims.checks if check.kind.is_lemma]
    rates: list[float] = []
    for check in lemmas:
        if check.is_proved and check.domain == EVERYWHERE and check.rate is not None:
            rates.append(check.rate)
    # e'e falls under every signal where Lemma 1 holds in every mode.
    if not loop.groups and lemmas and len(rates) == len(lemmas):
        yield Envelope(id=LEMMA, height=starts.ball, rate=claimed(min(rates)))


def certified_settling(loop: Loop, claims: Claims) -> Settling | None:
    """The settling time that ``claims`` prove, with its envelope; None without one.  Raises:
    CertificateError."""
    with reading_claims():
        found = next((check for check in claims.checks if check.kind.role == "settling"), None)
        if found is None or not found.is_proved:
            return None
        descent = claim_of(found, loop, claims.W)
        if not isinstance(descent, Descent):
            return None
        return settling_of(loop, descent, found.reason)


def is_inside(domain: object, starts: Starts) -> bool:
    """Whether a check with this domain is about these starts; not for one that holds close to the
    target only."""
    # What is proved near the target only names no radius, so that no start is known to lie there.
    if not isinstance(domain, Around):
        return domain == EVERYWHERE
    reach = starts.box if domain.kind == "box" else starts.ball
    if reach > claimed(domain.radius) * ROOM:
        return False
    return starts.disturbance <= claimed(domain.disturbance) * ROOM


def envelope_of(loop: Loop, check: Check, claim: Claim | None, starts: Starts) -> Envelope | None:
    """The bound of one check; None for one that gives none by itself."""
    domain = check.domain
    disturbance = starts.disturbance
    bound = partial(Envelope, id=check.id)
    # Maxima of weights are bounded by the box of the starts, quadratic forms by their ball.
    is_box = isinstance(claim, Separable | ReadingsBound | Cycles | Kept)
    radius = starts.box if is_box else starts.ball
    if isinstance(domain, Around):  # of a run that exceeds the region by rounding
        radius *= ROOM
        disturbance *= ROOM
    if isinstance(claim, Separable | ReadingsBound):
        box = claim.rows if isinstance(claim, ReadingsBound) else claim
        first = radius * box.spread + error_share(box, disturbance)
        rate = composite_rate(box) if box is claim else box.alpha
        return bound(height=first * box.reach, rate=rate)
    if isinstance(claim, Cycles) and claim.rate is not None:
        # V falls at the rate from one phase to the next, and never rises in between.
        first = radius * claim.spread(loop) + error_share(claim, disturbance)
        return bound(height=first * claim.height, rate=claim.rate)
    if isinstance(claim, Quadratic):
        first = eigenvalue_bound(claim.P_e) * radius**2 + _errors(loop, claim.P, disturbance)
        if claim.level is not None and isinstance(domain, Around):  # the level is a bound as well
            first = min(first, claim.level)
        return bound(height=_root(first * tallest(claim.P_e)), rate=claim.rate)
    if isinstance(claim, Kept):
        if claim.kind or claim.rate is None or claim.box is None:
            return None
        return bound(height=radius + error_share(claim.box, disturbance), rate=claim.rate)
    if check.rate is None:
        return None
    square = _square_of_forms(loop, claim, radius, disturbance)
    if square is None:
        return None
    return bound(height=_root(square), rate=claimed(check.rate))


def _square_of_forms(
    loop: Loop, claim: Claim | None, radius: Fraction, disturbance: Fraction
) -> Fraction | None:
    """A bound of |e|_inf^2 where V = e'De + ... or e'(D (x) R)e + ... is at most what it is for
    these starts; None for other claims."""
    if isinstance(claim, Weighted):
        # e'De lies between least(D) |e|^2 and largest(D) |e|^2.
        first = largest(claim.D) * radius**2 + _errors(loop, claim.P, disturbance)
        return first / least(claim.D)
    # What estimation errors add to this V is not bounded here.
    if isinstance(claim, Alike) and claim.weights and not disturbance:
        form = SparseSymmetric.from_dense(claim.R)
        first = largest(claim.weights.D) * eigenvalue_bound(form) * radius**2
        return first * tallest(form) / least(claim.weights.D)
    # V = e'e + sum eps_i'P eps_i of Theorems 1 and 2
    if isinstance(claim, PairFacts):
        return radius**2 + _errors(loop, claim.pair.P, disturbance)
    return None


def error_share(
    claim: Separable | Cycles, disturbance: Fraction, *, unit: int = 10**18
) -> Fraction:
    """What |eps_i| <= disturbance may take of V of weights: kappa s sqrt(size), rounded up to
    1/unit."""
    if claim.error is None:
        return ZERO
    square = (claim.error.kappa * disturbance) ** 2 * claim.error.size
    return root_above(square, unit=unit)


def _errors(loop: Loop, P: Matrix | None, disturbance: Fraction) -> Fraction:
    """What |eps_i| <= disturbance add to a quadratic V at most."""
    if P is None:
        return ZERO
    return loop.n * eigenvalue_bound(SparseSymmetric.from_dense(P)) * disturbance**2


def tallest(P_e: SparseSymmetric) -> Fraction:
    """A bound of the largest e_c^2 where e'P_e e <= 1, P_e > 0: exact for diagonal and for small
    P_e."""
    if P_e.size <= MOST_INVERTED or all(i == j for i, j in P_e.entries):
        return max(diagonal_of_inverse(P_e))
    # 1 / lambda_min bounds every entry of the inverse; lambda_min from an upper bound of
    # ceiling I - P_e.
    ceiling = eigenvalue_bound(P_e)
    least = ceiling - eigenvalue_bound(P_e.negated().shifted(ceiling))
    if least <= 0:
        raise ValueError("P_e is too close to a singular matrix")
    return 1 / least


def starts_of(loop: Loop, radius: Number | None, disturbance: Number | None) -> Starts:
    """Every start with |e|_inf <= radius and |eps_i| <= disturbance; what is None comes from the
    [region].

    Raises: SpecError for a number that is wrong or missing.
    """
    region = loop.starts
    if region is None and (radius is None or (disturbance is None and loop.groups)):
        what = "must be given, because the problem has no [region] that says where it starts."
        key = "radius" if radius is None else "disturbance"
        cure = (
            "Give radius, the largest |e(0)|_inf, and with an [exosystem] disturbance; or a "
            "[region]."
        )
        raise wrong(key, what, cure)
    # Without a radius the whole region counts, the largest side of each component.
    given = None if radius is None else parse_number(radius, "radius")
    sides = asked_radius(loop) if given is None else (given,) * loop.m
    error = ZERO
    if disturbance is not None:
        error = parse_number(disturbance, "disturbance")
    elif region is not None:
        error = region.disturbance or error
    # The sides come first, so that a wrong radius is named before a wrong disturbance.
    if min(sides) < 0 or error < 0 or (error and not loop.groups):
        key = "radius" if min(sides) < 0 else "disturbance"
        what = "must be >= 0, and without an [exosystem] there is no disturbance."
        raise wrong(key, what, "Give another number.")
    square = sum((side * side for side in sides), ZERO)
    return Starts(box=max(sides), ball=_root(loop.n * square), disturbance=error)


def bound_from(loop: Loop, claims: Claims, starts: Starts) -> CertifiedBound:
    """What ``claims``, which are about ``problem``, prove about |e(t)|_inf from all of these
    starts."""
    if loop.estimated:
        return CertifiedBound(reason="it is about estimated states, which are off at the start")
    if loop.timing is not None:
        late = tuple(
            check
            for check in claims.checks
            if knows_readings(check) or check.kind.role == "settling"
        )
        claims = replace(claims, checks=late)
    settling = certified_settling(loop, claims)
    if settling is not None:  # it is about its own box of starts
        outside = starts.box > settling.radius * ROOM
        if outside or starts.disturbance > settling.disturbance * ROOM:
            settling = None
    with reading_claims():
        found = tuple(envelopes_of(loop, claims, starts))
    bound = CertifiedBound(envelopes=found, settling=settling)
    if not bound.sources:
        return CertifiedBound(reason=_nothing(claims, starts))
    return bound if loop.timing is None else _between_samples(loop, loop.timing, bound)


def _between_samples(loop: Loop, timing: Timing, bound: CertifiedBound) -> CertifiedBound:
    """The same at all times, of what is proved at the samples, where something is held."""
    if (not timing.period or timing.steps) and not timing.ahead:
        return bound
    if loop.groups:
        reason = "it would be about the samples, between which the disturbance leaves a ripple"
        if timing.ahead:
            reason = "the disturbance moves agents before the first input acts"
        return CertifiedBound(reason=reason)
    # What is held leads straight from one sample to the next; what acts late stays until then.
    sizes = []
    for each in bound.envelopes:
        kept = exp(Interval.point(each.rate * (timing.period + timing.ahead))).hi
        sizes.append(replace(each, height=each.height * kept))
    return replace(bound, envelopes=tuple(sizes))


def bound_of_plant(loop: Loop, claims: Claims, starts: Starts) -> CertifiedBound:
    """The same for the plant that the file states: where weights or gains may be off, what
    ``tolerance`` proves; with a limit from starts where ``actuators`` proves that no input exceeds
    it."""
    stated = stated_in(loop)
    if stated.absolute:  # a bound that goes to 0 would be false
        reason = (
            "what [uncertainty] says acts on the plant for ever; the check accuracy has the "
            "errors that remain"
        )
        return CertifiedBound(reason=reason)
    if stated.late:
        return bound_from(loop, claims, starts)
    proved = {check.id: check for check in claims.checks if check.is_proved}
    limit = proved.get(LIMIT)
    tolerance = proved.get(TOLERANCE)
    if stated.limit and (limit is None or not is_inside(limit.domain, starts)):
        reason = "from these starts it is not proved that inputs keep "
        return CertifiedBound(reason=reason + table_words(loop, LIMIT))
    if not stated.relative:
        return bound_from(loop, claims, starts)
    if tolerance is not None and tolerance.rate and is_inside(tolerance.domain, starts):
        with reading_claims():
            height = _height_of(loop, claims, tolerance, starts)
            # Without weights of its own a claim is about the box of max-separable; the limit has
            # to be proved in the box in which errors are tolerated.
            apart = limit is not None and "v" not in (limit.exact or {})
            other_box = stated.limit and apart and "v" in (tolerance.exact or {})
        if height is not None and not other_box:
            found = Envelope(id=TOLERANCE, height=height, rate=claimed(tolerance.rate))
            return CertifiedBound(envelopes=(found,))
    reason = f"from these starts no rate is proved with {table_words(loop, TOLERANCE)}"
    return CertifiedBound(reason=reason)


def _height_of(loop: Loop, claims: Claims, tolerance: Check, starts: Starts) -> Fraction | None:
    """Of |e|_inf under errors of weights and gains: V of the max-separable beside falls, or N of
    weights of its own."""
    claim = claim_of(tolerance, loop, claims.W)
    if isinstance(claim, Tolerance) and claim.v is not None:
        if starts.disturbance:
            return None
        return starts.box * largest(claim.v) / least(claim.v)
    base = box_of(claims.checks, loop, claims.W)
    if base is None:
        return None
    error = error_share(base, starts.disturbance * ROOM)
    return (starts.box * ROOM * base.spread + error) * base.reach


class RunLike(Protocol):
    """See ``Trajectory`` and ``Ensemble`` in ``simulation.trajectory``."""

    @property
    def name(self) -> str: ...
    @property
    def labels(self) -> Texts: ...
    @property
    def signal(self) -> str: ...
    @property
    def stress(self) -> str: ...
    @property
    def observer(self) -> str: ...
    @property
    def loop_sha256(self) -> str: ...
    def start_size(self) -> tuple[float, float, float]: ...


def certified_bound(problem: Problem, claims: Claims, run: RunLike) -> CertifiedBound:
    """What ``claims``, which are about ``problem``, prove about |e(t)|_inf of a run, or of all runs
    of an ensemble.

    Raises: SpecError for a run of another problem or with another W, CertificateError for claims
    that cannot be read.
    """
    reason = _other_loop(run)
    if reason:
        return CertifiedBound(reason=reason)
    loop = loop_of(problem)
    # Problems made in Python often share a name: the fingerprint tells them apart.
    other = (run.name, run.labels) != (loop.name, loop.labels)
    if other or run.loop_sha256 != loop_sha256(problem, claims.W):
        own = repr(run.name) if other else "another problem of that name, or with another gain W"
        what = (
            f"the run must be one of {loop.name!r}, which the certificate is about; it is "
            f"one of {own}."
        )
        cure = "Certify the problem that was simulated, or simulate this one."
        raise refused("certificate", what, cure)
    box, ball, disturbance = map(Fraction, run.start_size())
    starts = Starts(box=box, ball=ball, disturbance=disturbance)
    if loop.agrees:
        # Errors of a run are the differences of all pairs, which few checks are about.
        rows = rows_of(loop, claims.W)
        if rows is None or not are_pairs(rows):
            return CertifiedBound(reason="it is not about the differences of all pairs")
        claims = replace(claims, checks=tuple(c for c in claims.checks if c.id in OF_PAIRS))
        loop = rows
    bound = bound_from(loop, claims, starts)
    # What rests on a guarantee says nothing about a signal that does not keep it.
    if keeps_guarantee(loop, json.loads(run.signal or "{}")):
        return bound
    found = tuple(each for each in bound.envelopes if each.id != "schedule")
    settling = bound.settling
    if settling is not None and settling.guarantee is not None:
        settling = None
    bound = CertifiedBound(envelopes=found, settling=settling)
    return bound if bound.sources else CertifiedBound(reason=_nothing(claims, starts))


def keeps_guarantee(loop: Loop, signal: Table) -> bool:
    """Whether a signal of simulations, as JSON, is one that a proof by the guarantee of [switching]
    is about."""
    phases = loop.guarantee.phases
    if not phases:
        return True
    kind = signal.get("signal")
    # A signal without an order takes the modes as they stand in the file.
    order = list(signal.get("order") or loop.modes)
    lasting = np.atleast_1d(signal.get("dwell") or 0.0)
    shortest = float(phases[0].shortest)
    longest = float(phases[0].longest or np.inf)
    if loop.guarantee.kind == "sequence":
        each_lasts = np.broadcast_to(lasting, len(order)).tolist()
        turns = list(zip(order, each_lasts, strict=True))
        # A sequence that is written out twice is the same signal.
        once = turns[: shortest_period(turns)]
        stated = [(phase.mode, float(phase.shortest)) for phase in phases]
        return kind == "periodic" and once == stated
    if kind == "periodic":
        following = order[1:] + order[:1]
        repeated = any(a == b for a, b in zip(order, following, strict=True))
        if repeated and longest < np.inf:  # a mode that follows itself lasts longer than its turn
            return False
        return bool(shortest <= lasting.min() and lasting.max() <= longest)
    if kind == "random":
        return bool(shortest <= lasting[0]) and (signal["longest"] or np.inf) <= longest
    return kind == "fixed" and longest == np.inf


def _other_loop(run: RunLike) -> str:
    """Why a run is not one of the loop that certificates are about; "" if it is."""
    if run.stress:
        return "no certificate is about a loop under stress"
    if not run.loop_sha256:
        return (
            "the run does not record of which problem and W it is (too large a network, or an "
            "older file)"
        )
    if run.observer == "off":
        return "certificates are about the loop with its observer, and here it is off"
    if run.signal and json.loads(run.signal).get("signal") == "mobile":
        return (
            "certificates are about the arcs of the modes, and here the graph follows from "
            "positions"
        )
    return ""


def _nothing(claims: Claims, starts: Starts) -> str:
    """Why no check bounds these starts."""
    # A proof under the guarantee that holds these starts lacks a rate, or the signal.
    for check in claims.checks:
        if check.id == "schedule" and check.is_proved:
            if not is_inside(check.domain, starts):
                break
            if check.rate is None:
                return "the proof states no rate"
            return "the proof is not about the signal of the run"
    where = f"|e|_inf = {float(starts.box):.4g} and |eps_i| = {float(starts.disturbance):.4g}"
    regions = [check.domain for check in claims.checks if isinstance(check.domain, Around)]
    if not regions:
        return (
            "the certificate holds for starts that are close enough, and does not say how close; "
            "ask for a [region]"
        )
    most = max(regions, key=lambda domain: (isinstance(domain, Box), domain.radius))
    edge = "|e|_inf" if isinstance(most, Box) else "|e|"
    proved = f"{edge} <= {most.radius:.6g} with |eps_i| <= {most.disturbance:.6g}"
    return f"the run starts outside what is certified: {where}, and proved is {proved}"
