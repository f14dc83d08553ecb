"""What the max-separable certificate says of late, held, lost and triggered readings (theory,
sections 5, 15 and 17), in one row.

Readings of neighbours.  v_j counts as theta v_j, theta >= (1 + event) exp(rate delay): then
|e_i(t)| <= v_i rho exp(-rate t) is kept (Razumikhin, Halanay).  Without an event no coupling need
rise.

An agent's own readings.  Along s(t) v_i - e_i >= 0 a term with e_i of some time ago is at most its
row plus a (s v_i - e_i) of that time, 0 <= a <= L.  Such delay equations have a positive solution
up to Q sigma <= 1/e, or Q T <= d^d/(d + 1)^(d + 1) at ticks (``Timing.steepest``), Q the sum of w L
and the gain; so up to there they cost nothing.  Held over a period T with d = 0, L bounds the mean
of h' on every way from e_j - s v_i to e_j - e_i, and no coupling need rise; of an arc that comes
and goes within T a part is left, for which both hold.

With the observer, |C eps_i| <= E <= E_0 exp(-beta t): kappa v_min (beta - rate - Q (lag - 1)) >= 1
keeps N <= rho exp(-rate t) - kappa E_0 exp(-beta t), lag = exp(beta sigma), or (1 - T beta)^-d with
rates per tick.

Inputs that act ``ahead`` s late.  Until then |e_i'| = |d_i| <= dbar, so that N rises by ahead dbar
/ v_min at most; let its bound rise as much.  What an agent then reads of that time is as much
nearer to 0, which Q ahead dbar lag more of E_0 stands for.  Time counts from ``ahead`` on.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from functools import cache

from dobc_design.conditions.check import Check, Witness
from dobc_design.conditions.consensus.claim import jacobians_at_consensus, linearisation
from dobc_design.conditions.numbers import read_rational, rounded_down
from dobc_design.conditions.reason import (
    Need,
    first_missing,
    gap_obstacle,
    observer_obstacle,
)
from dobc_design.coupling.enclosures import Profile, slope_bound
from dobc_design.errors import SpecError
from dobc_design.exact.floats import Floats
from dobc_design.exact.interval import Interval, UndefinedError, exp, log, pi, sin, sqrt
from dobc_design.exact.matrix import Matrix, identity, scale, subtract
from dobc_design.exact.number import ONE, ZERO
from dobc_design.exact.polynomial import (
    characteristic_polynomial,
    decide_images,
    disk_image,
    without_repeats,
)
from dobc_design.loop.loop import Loop
from dobc_design.loop.saturation import largest_disturbance
from dobc_design.loop.timing import E, Timing, late_step
from dobc_design.problem.uncertainty import ABSOLUTE

from .claim import (
    FACES,
    DelayBound,
    SamplingBound,
    Separable,
    Term,
    acts_by_component,
    held_gains,
    rows,
    stated_errors,
)
from .decide import (
    SeparableAnswer,
    coupling_profiles,
    covers,
    error_bound_obstacle,
    proved,
    refuted,
    undecided,
    verify_separable,
)
from .large import SLICES, arc_rows, stiffest_row

SHORTEST = Fraction(1, 10**6)  # age of an own reading that is told (s)
_CLOSE = Fraction(1, 1000)
# How much larger than the truth floats may make a sum of slopes: for nine digits of a period, and
# beside a claimed one.
_UNSURE = Fraction(1, 10**12)
_NEAR = Fraction(1, 10**9)
HELD = Timing(period=Fraction(1))  # what a sampling period is looked for with
_MANY_ARCS = 100  # from which on slopes are bounded once on every part of the box


def delay_obstacle(loop: Loop) -> str | None:
    """Why nothing is said of late messages; None where something is."""
    if loop.goals.moves:
        return (
            "does not apply: the leader moves while a message is late, and the proof does not "
            "bound that motion."
        )
    if loop.goal == "differences":
        return (
            "does not apply: agents agree without a target, and a late reading less a state of now "
            "is no difference of states at one time, which is all that the proof bounds."
        )
    return None


def verify_readings(loop: Loop, W: Matrix | None, claim: Separable) -> SeparableAnswer:
    """Decide whether ``claim`` holds with all that the problem says of readings, of a processor and
    of errors of weights and gains: N <= rho exp(-alpha t) - kappa E from every start with N + kappa
    E <= rho; at the ticks, where something is held.  Source: theory, sections 15 and 17."""
    timing = loop.timing or Timing()
    reason = readings_obstacle(loop, W)
    if reason is not None:
        return undecided(reason)
    error = claim.error
    rate = claim.alpha
    if timing.period * max(rate, ZERO if error is None or not timing.sampled else error.beta) >= 1:
        return refuted("a rate is at least 1/T, so that no part of the error would be left.")
    exosystem = loop.joint_exosystem
    if exosystem is not None:
        if W is None or error is None:
            return undecided("with an [exosystem] it needs P, beta, kappa and size.")
        wrong = error_bound_obstacle(exosystem, W, error, timing)
        if wrong is not None:
            return refuted(wrong)
    stretch = timing.stretch(rate)
    answer = verify_separable(loop, claim, stretch=stretch, errors=stated_errors(loop))
    if answer.wrong is not None:
        return answer
    wrong = _own_obstacle(loop, claim, timing)
    if wrong is not None:
        return undecided(wrong)
    return proved("no reading that is late, held or lost as stated leads out of the box.")


MOST_ROWS = 30  # n m up to which eigenvalues are located exactly
EIGENVALUE = "eigenvalue"


def rest_matrix(loop: Loop) -> Matrix | None:
    """M of e' = -M e (n m, n m); None where couplings are curved, modes switch, agents have no
    target, or there are too many."""
    # Agents that fit no two sides have rows of e and -e, which move together: M has eigenvalues
    # that they do not have.
    known = loop.is_linear and not (loop.switches or loop.drift or loop.signed)
    if not known or loop.goal != "target" or loop.size > MOST_ROWS:
        return None
    (mode,) = jacobians_at_consensus(loop).modes
    entries = linearisation(mode, loop.m)
    places = range(loop.size)
    return tuple(tuple(-entries.get((i, j), ZERO) for j in places) for i in places)


def overshoots(loop: Loop, M: Matrix) -> bool:
    """Whether a step, I - T M where all acts at once, has an eigenvalue on or outside the unit
    circle: exact; no answer for many rows."""
    timing = loop.timing or Timing()
    late = timing.ahead // timing.period
    if len(M) * (late + 1) > MOST_ROWS:
        return False
    step = late_step(subtract(identity(len(M)), scale(timing.period, M)), late)
    image = disk_image(characteristic_polynomial(step), centre=ZERO, radius=ONE)
    return not decide_images([image], degree=len(step))[1]


def turns_too_far(loop: Loop, M: Matrix, near: tuple[Fraction, Fraction]) -> bool:
    """Whether M has an eigenvalue mu around ``near`` with |mu| tau > pi/2 - |arg mu|: with the
    delay tau in everything the loop then diverges.  Of n different roots one is within n |p/p'|
    (Laguerre).  Source: Olfati-Saber and Murray 2004."""
    timing = loop.timing or Timing()
    tau = min(timing.delay, timing.own_delay)
    p = derivative = (ZERO, ZERO)
    x, y = near
    polynomial = without_repeats(characteristic_polynomial(M))
    for a in polynomial:
        u, v = derivative
        derivative = (u * x - v * y + p[0], u * y + v * x + p[1])
        p = (p[0] * x - p[1] * y + a, p[0] * y + p[1] * x)
    steep = derivative[0] ** 2 + derivative[1] ** 2
    if not tau or not steep:
        return False
    radius = sqrt(Interval.point((len(polynomial) - 1) ** 2 * (p[0] ** 2 + p[1] ** 2) / steep)).hi
    size = sqrt(Interval.point(x * x + y * y)).lo - radius
    if size <= 0:
        return False
    # |mu| tau is at least ``turn``; below pi/2 the condition is Re mu < |mu| sin(|mu| tau).
    turn = Interval.point(size * tau)
    return turn.lo >= (pi() / 2).hi or x + radius < size * sin(turn).lo


def late_witness_obstacle(loop: Loop, check: Check) -> str | None:
    """None if a refutation by what linear couplings do is confirmed, else what is wrong."""
    if check.rate is not None or check.exact is not None:
        return "a refuted check must claim no rate and no exact values"
    M = rest_matrix(loop)
    timing = loop.timing or Timing()
    witness = check.witness or Witness(kind="")
    if M is None or witness.kind != EIGENVALUE or witness.labels:
        return "it needs linear couplings, one mode, and an eigenvalue as its witness"
    if timing.period:
        shown = overshoots(loop, M) and not witness.values
        return None if shown else "no eigenvalue is outside the unit circle"
    x, y = (read_rational(value) for value in witness.values or ())
    return None if turns_too_far(loop, M, (x, y)) else "it does not diverge around this eigenvalue"


def readings_obstacle(loop: Loop, W: Matrix | None) -> str | None:
    """Why nothing is said of what the problem states of readings; None where something is."""
    timing = loop.timing or Timing()
    plant = loop.uncertainty
    own = timing.own_delay > 0
    held = timing.period > 0
    drifts = timing.ahead > 0 and not loop.is_linear
    unsaid = [] if plant is None else [name for name in ABSOLUTE if getattr(plant, name)]
    if unsaid:  # bands stand in another table
        unsaid.insert(0, "[exosystem]" if unsaid == ["bands"] else "[uncertainty]")
    limited = loop.actuators is not None and bool(loop.actuators.limit) and not loop.saturates
    blind = bool(loop.groups) and plant is not None and not plant.known_to_agents
    needs: list[Need] = [
        (not unsaid, f"{' '.join(unsaid)} is not counted with late readings."),
        (not limited, "the limits of [actuators] are not counted with late readings."),
        (not blind, "observers that do not know the weights are not counted with late readings."),
        (
            loop.drift is None or not (own or held),
            "what agents do by themselves goes on while readings are late or held.",
        ),
        (
            not drifts or largest_disturbance(loop) is not None,
            "how far agents drift before the first input acts is not known: give "
            "actuators.amplitude.",
        ),
    ]
    wrong = first_missing(needs)
    if wrong is not None:
        return f"does not apply: {wrong}"
    if timing.is_late and (reason := delay_obstacle(loop)) is not None:
        return reason
    return observer_obstacle(loop, W) or gap_obstacle(loop)


def covers_late(loop: Loop, claim: Separable, *, radius: Fraction, disturbance: Fraction) -> bool:
    """Whether every start with |e|_inf <= radius and |eps_i| <= disturbance is kept by ``claim``,
    although nothing acts for ``ahead`` s."""
    drift = drift_before(loop)
    if drift and claim.rho is not None:
        rho = claim.rho - drift * more_error(loop, claim)
        if rho <= 0:
            return False
        claim = replace(claim, rho=rho)
        radius += drift
    return covers(claim, radius=radius, disturbance=disturbance)


def drift_before(loop: Loop) -> Fraction:
    """How far the disturbance moves agents before the first input acts; 0 where no bound of it is
    known."""
    ahead = ZERO if loop.timing is None else loop.timing.ahead
    return ahead * max(largest_disturbance(loop) or (ZERO,)) if ahead else ZERO


def more_error(loop: Loop, claim: Separable) -> Fraction:
    """kappa Q lag: what N is kept below by, for every unit of that drift."""
    timing = loop.timing or Timing()
    steep = steepness(loop, claim, timing)
    if claim.error is None or isinstance(steep, str):
        return ZERO
    return claim.error.kappa * steep * timing.lag(claim.error.beta)


def _own_obstacle(loop: Loop, claim: Separable, timing: Timing) -> str | None:
    """Why what an agent knows of itself may lead it out, None if it does not."""
    steep: Fraction | str = ZERO
    if timing.steepest is not None:
        steep = steepness(loop, claim, timing)
    if isinstance(steep, str):
        return steep
    return too_steep(timing, steep) or _too_small(claim, timing, steep)


def too_steep(timing: Timing, steep: Fraction) -> str | None:
    """Why own readings may overshoot, None if they do not; ``steep``: the sum of slopes."""
    most = timing.steepest
    if most is None or steep <= most:
        return None
    return (
        f"slopes and gains of an agent add up to {float(steep):.6g} 1/s; above {float(most):.6g} "
        "1/s it may overshoot before it reads itself again: try a shorter period or own_delay, or "
        "smaller gains."
    )


def _too_small(claim: Separable, timing: Timing, steep: Fraction) -> str | None:
    """Why the observer error can raise V, None if it cannot."""
    error = claim.error
    if error is None:
        return None
    decay = timing.decay(error.beta)
    left = decay - claim.alpha - steep * (timing.lag(error.beta) - 1)
    if error.kappa * claim.least * left >= 1:
        return None
    return "kappa is too small, or the observer too slow for readings that are so late."


def verify_delay(loop: Loop, claim: Separable, bound: DelayBound) -> SeparableAnswer:
    """Decide whether the rows of ``claim`` give ``bound.rate`` for every delay up to
    ``bound.delay``.  With an observer every smaller rate holds, from the time on at which its error
    has become small, up to beta."""
    if min(bound.delay, bound.own_delay, bound.event) < 0 or bound.rate <= 0:
        key = "delay" if bound.rate > 0 else "rate"
        raise SpecError("a delay must be >= 0 and its rate > 0.", key=key)
    if claim.error is not None and bound.rate > claim.error.beta:
        return refuted("the rate exceeds beta, at which the observer error decays.")
    if (reason := delay_obstacle(loop)) is not None:
        return undecided(reason)
    slower = Separable(v=claim.v, alpha=bound.rate, rho=claim.rho, error=claim.error)
    stretch = max(Timing(delay=bound.delay).stretch(bound.rate), 1 + bound.event)
    answer = verify_separable(loop, slower, stretch=stretch)
    if answer.wrong is not None or not bound.own_delay:
        return answer
    wrong = _own_obstacle(loop, slower, Timing(own_delay=bound.own_delay, event=stretch - 1))
    return answer if wrong is None else undecided(wrong)


def with_own_delay(loop: Loop, claim: Separable, bound: DelayBound) -> DelayBound:
    """The same with the largest age, about, of own readings that costs no more, and the event in
    place of the delay."""
    stretch = Timing(delay=bound.delay).stretch(bound.rate)
    late = Timing(own_delay=ONE, event=stretch - 1)
    bound = replace(bound, event=rounded_down(stretch - 1, digits=2))
    slower = replace(claim, alpha=bound.rate)
    steep = steepness(loop, slower, late)
    if isinstance(steep, str) or steep <= 0:
        return bound
    age = (1 / (E * steep)).lo
    error = claim.error
    if error is not None:
        room = error.beta - bound.rate - 1 / (error.kappa * claim.least)
        if room <= 0:
            return bound
        age = min(age, (log(Interval.point(1 + room / steep)) / error.beta).lo)
    # Nobody reads itself sooner than in a microsecond.
    return bound if age < SHORTEST else replace(bound, own_delay=rounded_down(age, digits=2))


def largest_period(loop: Loop, claim: Separable) -> SamplingBound | None:
    """The largest sampling period, about, that is certified by ``claim`` (proved before).  The
    period is at most 1/(sum_j w L_ij + k_cc) of every agent, so that sampling cannot overshoot a
    face. None where the certificate does not apply, or the slopes are not bounded."""

    def has_nine_digits(stiffest: Fraction) -> bool:
        if stiffest <= 0:
            return False
        return rounded_down(1 / stiffest) == rounded_down((1 + _UNSURE) / stiffest)

    found = steepness(loop, claim, HELD, enough=has_nine_digits)
    if isinstance(found, str) or found <= 0:
        return None
    # No search: the largest period is the inverse of that bound.
    period = rounded_down(1 / found)
    if period <= 0:
        return None
    return SamplingBound(period=period, factor=1 - period * claim.alpha)


def verify_sampling(loop: Loop, claim: Separable, bound: SamplingBound) -> SeparableAnswer:
    """Decide whether ``claim`` (proved before) gives ``bound``: no face overshot, and 1 - T alpha
    <= factor < 1."""
    if bound.period <= 0:
        raise SpecError("a sampling period must be > 0.", key="period")
    if bound.factor >= 1 or bound.factor < 1 - bound.period * claim.alpha:
        return refuted("the factor must be < 1 and at least 1 - T alpha.")
    stiffest = steepness(loop, claim, replace(HELD, period=bound.period))
    if isinstance(stiffest, str):
        return undecided(stiffest)
    if bound.period * stiffest > 1:
        return undecided("one step may overshoot a face of the box: try a shorter period.")
    return proved(
        "no step of this length overshoots a face of the box, so that N falls from sample to "
        "sample."
    )


def steepness(
    loop: Loop,
    claim: Separable,
    timing: Timing,
    *,
    enough: Callable[[Fraction], bool] | None = None,
) -> Fraction | str:
    """The largest sum_j w L_ij + k_cc, or why there is none: from floats if that is ``enough``,
    else exactly; without ``enough`` whatever is at most ``timing.steepest`` does.  With the errors
    of weights and gains that the problem states."""
    if (reason := gap_obstacle(loop)) is not None:
        return reason
    if loop.drift is not None:
        return "does not apply: dynamics of the agents themselves are not held between samples."
    if not acts_by_component(loop) or (claim.rho is None and not loop.is_linear):
        return (
            "does not apply: the rows of the max-separable certificate say nothing for this "
            "coupling."
        )
    stretch = timing.stretch(claim.alpha)
    more = 1 + max(stated_errors(loop))
    try:
        profiles = coupling_profiles(loop, claim.v, rho=claim.rho, stretch=stretch)
        if timing.own_delay:
            return _late_obstacle(loop, profiles) or more * _steepest_anywhere(loop, profiles)
        if enough is None:
            most = timing.steepest or ZERO
            found = more * _steepest_anywhere(loop, profiles)
            if found <= most:
                return found

            def enough(found: Fraction) -> bool:
                return found <= most

        rho = claim.rho or ZERO
        arcs = loop.arc_count
        if rho and arcs > _MANY_ARCS:
            arrays = arc_rows(loop, claim.v, held=True, stretch=stretch)
            return more * stiffest_row(arrays, profiles, rho=rho)
        listed = list(rows(loop, claim.v, held=True, stretch=stretch))

        def largest(around: Callable[[Interval], Interval]) -> Fraction:
            mean = _Steepest(profiles, rho, around)
            sums = []
            for row, _ in listed:
                for face in FACES:
                    slopes = (x.weight * mean(x, row.own, face) for x in row.terms)
                    sums.append(row.pull + sum(slopes))
            return more * max(sums)

        with suppress(UndefinedError):
            found = largest(Floats.around)
            if enough(found):
                return found
        return largest(lambda place: place)
    except UndefinedError as error:
        return f"the slopes of the coupling are not bounded there: {error}"


def _late_obstacle(loop: Loop, profiles: Sequence[Profile]) -> str | None:
    """Why own readings may not be late, None if they may."""
    for kind, coupling in zip(profiles, loop.functions, strict=True):
        if not kind.is_nondecreasing:
            return (
                f"does not apply: own readings may be late where couplings rise, and h = "
                f'"{coupling.texts[0]}" is not shown to do so on |y| <= {float(kind.radius):.6g}.'
            )
    kept = loop.pulls.each(is_diagonal)
    if not all(kept.values()):
        return "does not apply: a gain mixes components, and own readings may be late."
    return None


def is_diagonal(k: Matrix) -> bool:
    """Whether a gain acts on every component by itself."""
    return not any(x for c, row in enumerate(k) for x in row[:c] + row[c + 1 :])


def shortest_gap(loop: Loop, claim: Separable) -> Fraction | None:
    """The least time (s) between two broadcasts of an agent that sends when its state has moved by
    event v_i rho exp(-rate t), rounded down; None where readings are held, or a coupling falls or
    has no bounded slope, and with an exosystem, whose error may move it where the threshold is
    next to 0.  It moves by at most nu rho exp(-rate t), so that t exp(rate t) >= event v_i/nu."""
    timing = loop.timing or Timing()
    if timing.period or not timing.event or claim.error is not None:
        return None
    stretch = timing.stretch(claim.alpha)
    try:
        profiles = coupling_profiles(loop, claim.v, rho=claim.rho, stretch=stretch)
        slopes = _largest_slopes(profiles)
    except UndefinedError:
        return None
    if not all(kind.is_nondecreasing for kind in profiles):
        return None
    v = (*claim.v, *(ZERO for _ in loop.fixed))
    # what it knew of itself was larger then
    late = exp(Interval.point(claim.alpha * timing.own_delay)).hi
    more = 1 + max(stated_errors(loop))
    pulls = loop.pulls.each(lambda k: max(sum(map(abs, row)) for row in k))
    most = [late * pulls.get(i, ZERO) * own for i, own in enumerate(claim.v)]
    parts = []
    for arcs in loop.modes.values():
        speeds = list(most)
        for i, j, weight in arcs:
            speeds[i] += weight * slopes[loop.place_of(i, j)] * (stretch * v[j] + late * v[i])
        moving = zip(claim.v, speeds, strict=True)
        parts += [timing.event * own / (more * speed) for own, speed in moving if speed]
    part = min(parts, default=None)
    return None if part is None else (part * exp(Interval.point(-claim.alpha * part))).lo


def _largest_slopes(profiles: Sequence[Profile]) -> list[Fraction]:
    """The largest slope of each coupling as far out as rows look, at least 0.  Raises:
    UndefinedError."""
    return [
        max(ZERO, slope_bound(kind.curve, Interval(-kind.radius, kind.radius), tolerance=_CLOSE))
        for kind in profiles
    ]


def _steepest_anywhere(loop: Loop, profiles: Sequence[Profile]) -> Fraction:
    """The largest sum of slopes and gain.  Raises: UndefinedError."""
    slopes = _largest_slopes(profiles)
    gains = held_gains(loop)
    most = ZERO
    for arcs in loop.modes.values():
        sums = list(gains)
        for i, j, weight in arcs:
            sums[i] += weight * slopes[loop.place_of(i, j)]
        most = max(most, *sums)
    return most


class _Steepest:
    """The largest mean slope, at least 0, of a coupling on the ways that a held step can take; each
    interval once.  A part x of the way from e_j - s v_i lies in s [-reach, step + 2 x v_i], and in
    s [step, step + 2 x v_i] where h is nondecreasing, because e_j = s v_j is then the worst.  The
    mean over x is bounded slice by slice."""

    def __init__(
        self, profiles: Sequence[Profile], rho: Fraction, around: Callable[[Interval], Interval]
    ) -> None:
        self.profiles = profiles
        self.rho = rho  # 0 for linear couplings, which have one slope
        self.around = around  # Floats.around, or nothing done to the interval
        self.on = cache(self._on)

    def __call__(self, term: Term, own: Fraction, face: int) -> Fraction:
        total = ZERO
        for k in range(SLICES):
            end = term.step + 2 * Fraction(k + 1, SLICES) * own
            total += self._largest(term, max(end, ZERO), face)
        return total / SLICES

    def _largest(self, term: Term, end: Fraction, face: int) -> Fraction:
        if self.profiles[term.coupling].is_nondecreasing:
            start = min(term.step, ZERO)
        else:
            start = -term.reach
        return self.on(term.coupling, Interval(self.rho * start, self.rho * end) * face)

    def _on(self, coupling: int, place: Interval) -> Fraction:
        curve = self.profiles[coupling].curve
        return max(slope_bound(curve, self.around(place), tolerance=_CLOSE), ZERO)
