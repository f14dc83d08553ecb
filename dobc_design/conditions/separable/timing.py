"""What a proved max-separable certificate says about delays and sampling (theory, section 5); no
coupling need rise.

Delays.  Agent i uses x_j(t - tau_ij(t)), its own state undelayed, its observer fed the same
received values.  Every start of ``covers`` still converges: while N + E/(beta min v) <= rho nothing
leaves, by the same rows.  If the rows hold with v_j replaced by theta v_j, theta >= exp(lambda
tau), and the rate lambda, then |e_i(t)| <= M v_i exp(-lambda t) is kept for delays up to tau
(Razumikhin, Halanay), once an observer error that decays faster has become small.

Sampling.  Couplings and pinning held over a period T give e_i+ = e_i + T (sum w h - k e_i) + int C
eps.  Let L bound the mean of h' on every way from e_j - s v_i to e_j - e_i, |e_j| <= s v_j, |e_i|
<= s v_i.  If T (sum w L + k_cc) <= 1, the largest e_i+ is that of the face e_i = s v_i, so the rows
give N+ <= (1 - T alpha) N + T max |C eps|/v.  Of an arc that comes and goes within T a part is
left, for which both hold: L is that of the whole.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from fractions import Fraction
from functools import cache

from dobc_design.conditions.numbers import rounded_down
from dobc_design.conditions.reason import gap_obstacle, saturation_obstacle
from dobc_design.coupling.enclosures import Profile, slope_bound
from dobc_design.errors import SpecError
from dobc_design.exact.floats import Floats
from dobc_design.exact.interval import Interval, UndefinedError, exp
from dobc_design.exact.number import ZERO
from dobc_design.loop.loop import Loop

from .claim import (
    FACES,
    DelayBound,
    SamplingBound,
    Separable,
    Term,
    acts_by_component,
    rows,
)
from .decide import (
    SeparableAnswer,
    coupling_profiles,
    proved,
    refuted,
    undecided,
    verify_separable,
)
from .large import SLICES, arc_rows, stiffest_row

_CLOSE = Fraction(1, 1000)
# How much larger than the truth floats may make a sum of slopes: for nine digits of a period, and
# beside a claimed one.
_UNSURE = Fraction(1, 10**12)
_NEAR = Fraction(1, 10**9)
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
            "does not apply: x_l(t - delay) - x_j(t) is no difference of states at one time, which "
            "is all that the proof bounds where agents agree without a target."
        )
    return None


def verify_delay(loop: Loop, claim: Separable, bound: DelayBound) -> SeparableAnswer:
    """Decide whether the rows of ``claim`` give ``bound.rate`` for every delay up to
    ``bound.delay``.  With an observer every smaller rate holds, from the time on at which its error
    has become small, up to beta."""
    if bound.delay < 0 or bound.rate <= 0:
        key = "delay" if bound.delay < 0 else "rate"
        raise SpecError("a delay must be >= 0 and its rate > 0.", key=key)
    if claim.error is not None and bound.rate > claim.error.beta:
        return refuted("the rate exceeds beta, at which the observer error decays.")
    if (reason := delay_obstacle(loop)) is not None:
        return undecided(reason)
    slower = Separable(v=claim.v, alpha=bound.rate, rho=claim.rho, error=claim.error)
    stretch = exp(Interval.point(bound.rate * bound.delay)).hi
    return verify_separable(loop, slower, stretch=stretch)


def largest_period(loop: Loop, claim: Separable) -> SamplingBound | None:
    """The largest sampling period, about, that is certified by ``claim`` (proved before).  The
    period is at most 1/(sum_j w L_ij + k_cc) of every agent, so that sampling cannot overshoot a
    face. None where the certificate does not apply, or the slopes are not bounded."""

    def has_nine_digits(stiffest: Fraction) -> bool:
        if stiffest <= 0:
            return False
        return rounded_down(1 / stiffest) == rounded_down((1 + _UNSURE) / stiffest)

    found = _stiffest(loop, claim, enough=has_nine_digits)
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
    reason = saturation_obstacle(loop)
    if reason is not None:
        return undecided(reason)
    if bound.factor >= 1 or bound.factor < 1 - bound.period * claim.alpha:
        return refuted("the factor must be < 1 and at least 1 - T alpha.")
    stiffest = _stiffest(loop, claim, enough=lambda x: not 1 < bound.period * x <= 1 + _NEAR)
    if isinstance(stiffest, str):
        return undecided(stiffest)
    if bound.period * stiffest > 1:
        return undecided("one step may overshoot a face of the box: try a shorter period.")
    return proved(
        "no step of this length overshoots a face of the box, so that N falls from sample to "
        "sample."
    )


def _stiffest(
    loop: Loop, claim: Separable, *, enough: Callable[[Fraction], bool]
) -> Fraction | str:
    """The largest sum_j w L_ij + k_cc, or why there is none: from floats if that is ``enough``,
    else exactly."""
    if (reason := gap_obstacle(loop)) is not None:
        return reason
    if loop.drift is not None:
        return "does not apply: dynamics of the agents themselves are not held between samples."
    if not acts_by_component(loop) or (claim.rho is None and not loop.is_linear):
        return (
            "does not apply: the rows of the max-separable certificate say nothing for this "
            "coupling."
        )
    try:
        profiles = coupling_profiles(loop, claim.v, rho=claim.rho)
        rho = claim.rho or ZERO
        arcs = sum(map(len, loop.modes.values()))
        if rho and arcs > _MANY_ARCS:
            return stiffest_row(arc_rows(loop, claim.v, held=True), profiles, rho=rho)
        listed = list(rows(loop, claim.v, held=True))

        def largest(around: Callable[[Interval], Interval]) -> Fraction:
            mean = _Steepest(profiles, rho, around)
            sums = []
            for row, _ in listed:
                for face in FACES:
                    slopes = (x.weight * mean(x, row.own, face) for x in row.terms)
                    sums.append(row.pull + sum(slopes))
            return max(sums)

        with suppress(UndefinedError):
            found = largest(Floats.around)
            if enough(found):
                return found
        return largest(lambda place: place)
    except UndefinedError as error:
        return f"the slopes of the coupling are not bounded there: {error}"


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
