"""A chain of certificates, decided exactly: every stage, every hand-over, the starts and the tolerance.

The statement and its proof are in ``claim``.  Exponentials are enclosed, everything else is rational.  Also the noun
that ``certify_settling`` returns: it evaluates what was proved, with outward rounding.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Final, overload

import numpy as np
from numpy.typing import NDArray

from dobc_design._show.cards import Card, Shown
from dobc_design._show.text import significant_away_from_zero, significant_towards_zero
from dobc_design.conditions.quadratic.claim import Lure
from dobc_design.conditions.quadratic.decide import diagonal_of_inverse, differences, eigenvalue_bound, verify_lure
from dobc_design.conditions.quadratic.sectors import relied_differences
from dobc_design.conditions.schedule.claim import QUADRATIC, SEPARABLE, ZERO, Stage, Staging
from dobc_design.conditions.separable.claim import Separable
from dobc_design.conditions.separable.decide import composite_rate, verify_composite
from dobc_design.errors import SpecError
from dobc_design.exact.definite import decide_positive_semidefinite
from dobc_design.exact.interval import Interval, exp
from dobc_design.exact.matrix import Matrix, multiply
from dobc_design.exact.number import float_above
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

Array = NDArray[np.float64]

#: exp(-x) of a larger x is enclosed by 0 and the value here.
FARTHEST: Final = 40_000


@dataclass(frozen=True, slots=True, kw_only=True)
class StagingAnswer:
    """Whether a Staging holds, and why; where it fails: the stage (from 0) and the step.  Steps: "certificate",
    "observer", "height", "diagonal", "start", "stretch", "noise", "guard", "factor", "level", "tolerance"."""

    verdict: Verdict
    reason: str
    stage: int | None = None
    step: str = ""


def _at_least(step: str, claimed: Fraction, least: Interval, words: str) -> StagingAnswer:
    refuted = Verdict.REFUTED if claimed < least.lo else Verdict.UNDECIDED
    return StagingAnswer(verdict=Verdict.PROVED if claimed >= least.hi else refuted, reason=words, step=step)


def _fact(step: str, holds: bool, words: str) -> StagingAnswer:
    return StagingAnswer(verdict=Verdict.PROVED if holds else Verdict.REFUTED, reason=words, step=step)


def verify_staging(problem: Problem, W: Matrix | None, staging: Staging) -> StagingAnswer:
    """Decide a claimed settling time with all its stages, for the gain W (q, m); None without an exosystem.  PROVED:
    |e(t)|_inf <= tolerance for all t >= time from every start |e|_inf <= radius, |eps_i| <= disturbance, and every
    stage's bound holds from its start on, for arbitrary switching.  REFUTED says that these numbers fail."""
    for k in range(len(staging.stages)):
        for need in _needs(problem, W, staging, k):
            if need.verdict is not Verdict.PROVED:
                return replace(need, stage=k, reason=f"stage {k + 1}: {need.reason}")
    return StagingAnswer(verdict=Verdict.PROVED, reason=proved_reason(staging))


def _needs(problem: Problem, W: Matrix | None, staging: Staging, k: int) -> Iterator[StagingAnswer]:
    """What has to hold of stage ``k``, in turn; none is looked at unless all before are proved."""
    stage, certificate = staging.stages[k], staging.stages[k].certificate
    if isinstance(certificate, Separable):
        answer = verify_composite(problem, W, certificate)
        yield StagingAnswer(verdict=answer.verdict, reason=answer.reason, step="certificate")
    else:
        yield _fact("certificate", certificate.rate > 0, "its rate must be > 0.")
        decision = verify_lure(problem, certificate)
        yield StagingAnswer(verdict=decision.verdict, reason=decision.reason, step="certificate")
    if not problem.groups:
        yield _fact("observer", not stage.noise, "without an [exosystem] there is no observer error.")
    elif isinstance(certificate, Lure):  # it is about the W of its own pair; a max-separable one is decided with W
        P, Q = certificate.P, certificate.Q
        given = P is not None and Q is not None and W is not None
        words = "with an [exosystem] the certificate needs the observer's pair P, Q and a gain W."
        yield _fact("observer", given, words)
        same = P is not None and W is not None and multiply(P, W) == Q
        yield _fact("observer", same, "its pair (P, Q) belongs to another W: Q must equal P W.")
    yield from _own(stage)
    yield from _taking_over(problem, staging.stages[k - 1], stage) if k else _starting(problem, stage, staging)
    if k == len(staging.stages) - 1:
        words = "the last stage does not bring |e|_inf down to the tolerance by the time claimed."
        yield _at_least("tolerance", staging.tolerance, decayed(stage, staging.time) * stage.height, words)


def proved_reason(staging: Staging) -> str:
    """What a proved chain says, in a sentence."""
    count = len(staging.stages)
    how = "one certificate." if count == 1 else f"{count} certificates in sequence."
    return f"|e(t)|_inf <= {float(staging.tolerance):.4g} for all t >= {float(staging.time):.6g} s, by {how}"


def stage_rate(certificate: Separable | Lure) -> Fraction:
    """The rate (1/s) at which the size of a certificate decays."""
    return composite_rate(certificate) if isinstance(certificate, Separable) else certificate.rate


def decayed(stage: Stage, time: Fraction) -> Interval:
    """Enclose the bound of a stage's size at ``time`` (s), not before its start."""
    return _shrunk(stage.level, stage_rate(stage.certificate), time - stage.start)


def noise_left(stage: Stage, time: Fraction) -> Interval:
    """Enclose the bound of max_i sqrt(eps_i'P eps_i) at ``time`` (s), not before the stage's start."""
    own = stage.certificate
    rate = own.rate if isinstance(own, Lure) else ZERO if own.error is None else own.error.beta
    return _shrunk(stage.noise, rate, time - stage.start)


def guard_limits(problem: Problem, before: Stage, after: Stage) -> Iterator[tuple[Fraction, Fraction]]:
    """Pairs (a, r) such that the guard of ``after`` holds where the size c of ``before`` has c^2 a <= r^2 for each."""
    old, new = before.certificate, after.certificate
    if isinstance(new, Separable):
        if isinstance(old, Separable) and new.rho is not None:
            yield handover_ratio(old, new) ** 2, new.rho
    elif new.radius is not None:
        places, m = relied_differences(problem), problem.m
        if isinstance(old, Separable):
            yield from (((old.v[i // m] + old.v[j // m]) ** 2, new.radius) for i, j in places)
        else:
            yield from ((width, new.radius) for width in differences(old.P_e, places))


def handover_ratio(old: Separable, new: Separable) -> Fraction:
    """The least g with N' <= g N."""
    return max(a / b for a, b in zip(old.v, new.v, strict=True))


def next_level(problem: Problem, before: Stage, after: Stage) -> Interval:
    """Enclose the largest size that ``after`` may have when it takes over; its square where it is quadratic.  Uses the
    noise and stretch of ``after``, not its level."""
    old, new = before.certificate, after.certificate
    c = decayed(before, after.start)
    if isinstance(new, Separable) and isinstance(old, Separable):
        g = handover_ratio(old, new)
        if old.error is None or new.error is None:
            return c * g
        more = max(ZERO, new.error.kappa * after.stretch - g * old.error.kappa)
        most, held = noise_left(before, after.start), c / old.error.kappa
        return c * g + Interval(min(most.lo, held.lo), min(most.hi, held.hi)) * more
    if isinstance(old, Separable):
        m, D = problem.m, after.diagonal or ()
        total = sum((d * old.v[row // m] ** 2 for row, d in enumerate(D)), ZERO)
        return c**2 * total + problem.n * after.noise**2
    factor = after.factor or ZERO
    return c**2 * (factor if observer_matrix(new) is None else max(factor, after.stretch**2))


def _own(stage: Stage) -> Iterator[StagingAnswer]:
    """What a stage claims about its certificate alone."""
    certificate = stage.certificate
    if isinstance(certificate, Separable):
        yield _at_least("height", stage.height, Interval.point(max(certificate.v)), "height must be at least max v.")
        return
    P_e, D = certificate.P_e, stage.diagonal
    tallest = Interval.point(max(diagonal_of_inverse(P_e)))
    yield _at_least("height", stage.height**2, tallest, "height^2 must be at least every diagonal entry of P_e^-1.")
    if D is not None:
        yield _fact("diagonal", len(D) == P_e.size, f"diagonal must have {P_e.size} entries; got {len(D)}.")
        bound = SparseSymmetric(P_e.size, {(i, i): d for i, d in enumerate(D)})
        yield _fact("diagonal", _is_semidefinite(bound + P_e.negated()), "diag(diagonal) - P_e is not semidefinite.")


def _starting(problem: Problem, stage: Stage, staging: Staging) -> Iterator[StagingAnswer]:
    """The starts lie in the first stage's level set, and that lies in its guard."""
    certificate, s = stage.certificate, staging.disturbance
    outside = "its first level set does not contain all starts."
    if isinstance(certificate, Separable):
        room = stage.level - staging.radius / certificate.least
        yield _fact("start", room >= 0, outside)
        error, size = certificate.error, ZERO
        if error is not None:
            size = error.size
            yield _at_least("start", max(room, ZERO) ** 2, Interval.point((error.kappa * s) ** 2 * size), outside)
        inside = certificate.rho is None or stage.level <= certificate.rho
    else:
        size = ZERO if certificate.P is None else eigenvalue_bound(SparseSymmetric.from_dense(certificate.P))
        square = sum(stage.diagonal or (), ZERO) * staging.radius**2 + problem.n * size * s**2
        yield _at_least("start", stage.level**2, Interval.point(square), outside)
        inside = certificate.level is None or stage.level**2 <= certificate.level
    yield _fact("guard", inside, "its first level set reaches beyond the region that its certificate is about.")
    words = "noise is less than the observer error at the start."
    yield _at_least("noise", stage.noise**2, Interval.point(size * s**2), words)


def _taking_over(problem: Problem, before: Stage, after: Stage) -> Iterator[StagingAnswer]:
    """The hand-over at ``after.start``."""
    own, next_ = observer_matrix(before.certificate), observer_matrix(after.certificate)
    if own is not None and next_ is not None:
        gap = SparseSymmetric.from_dense(own).scaled(after.stretch**2) + SparseSymmetric.from_dense(next_).negated()
        yield _fact("stretch", _is_semidefinite(gap), "stretch^2 P (of the stage before) - P is not semidefinite.")
        left = noise_left(before, after.start) * after.stretch
        yield _at_least("noise", after.noise, left, "noise is less than what is left of the observer error.")
    square = decayed(before, after.start) ** 2
    for a, radius in guard_limits(problem, before, after):
        yield _at_least("guard", radius**2, square * a, "when it takes over, what is known does not lie in its region.")
    old, new = before.certificate, after.certificate
    if isinstance(old, Lure) and isinstance(new, Lure):
        gap = old.P_e.scaled(after.factor or ZERO) + new.P_e.negated()
        yield _fact("factor", _is_semidefinite(gap), "factor P_e (of the stage before) - P_e is not semidefinite.")
    level, needed = after.level**2 if after.is_quadratic else after.level, next_level(problem, before, after)
    yield _at_least("level", level, needed, "its level is too small for what is handed over.")


def observer_matrix(certificate: Separable | Lure) -> Matrix | None:
    """P of a certificate; None without an exosystem."""
    if isinstance(certificate, Lure):
        return certificate.P
    return None if certificate.error is None else certificate.error.P


def _shrunk(value: Fraction, rate: Fraction, time: Fraction) -> Interval:
    """Enclose value exp(-rate time) for value, rate, time >= 0."""
    power = rate * time
    if power > FARTHEST:
        return Interval(ZERO, (exp(Interval.point(-FARTHEST)) * value).hi)
    return exp(Interval.point(-power)) * value


def _is_semidefinite(M: SparseSymmetric) -> bool:
    return decide_positive_semidefinite(M).verdict is Verdict.PROVED


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Settling(Shown):
    """A settling time: |e(t)|_inf <= tolerance for all t >= time, from |e(0)|_inf <= radius, |eps_i(0)| <= disturbance.

    PROVED with a ``staging``, for arbitrary switching among the modes; UNDECIDED without one.  ``single``: what one
    certificate for the whole box gives, for comparison; None if none is proved.
    """

    verdict: Verdict
    reason: str
    problem_name: str
    radius: Fraction
    disturbance: Fraction
    tolerance: Fraction
    staging: Staging | None = None
    single: Staging | None = None

    @property
    def time(self) -> float | None:
        """The certified settling time in s, rounded up; None if nothing is proved."""
        return None if self.staging is None else float_above(self.staging.time)

    @property
    def single_time(self) -> float | None:
        """The same with one certificate at one rate, in s, rounded up; None if there is none."""
        return None if self.single is None else float_above(self.single.time)

    @property
    def stages(self) -> tuple[Stage, ...]:
        """The stages in the order in which they take over; empty if nothing is proved."""
        return () if self.staging is None else self.staging.stages

    @overload
    def envelope(self, t: float) -> float: ...

    @overload
    def envelope(self, t: Sequence[float] | Array) -> Array: ...

    def envelope(self, t: float | Sequence[float] | Array) -> float | Array:
        """A bound of |e(t)|_inf, rounded up, at t >= 0 in s: a number or an array of times.  Every stage's bound holds
        from its start on, so the least of them counts; it never rises. Raises: SpecError for a time that is negative or
        not finite, or if nothing is proved."""
        if not self.stages:
            raise SpecError("there is no envelope, because nothing is proved.", key="t", cure=self.reason)
        if isinstance(t, (int, float)):
            return self._bound(float(t))
        return np.array([self._bound(float(each)) for each in t], dtype=np.float64)

    def curve(self, *, until: float | None = None, samples: int = 400) -> tuple[Array, Array]:
        """Times (s) and bounds of |e|_inf, both (samples,), from 0 to ``until`` (the settling time), for plotting."""
        times = np.linspace(0.0, (self.time or 0.0) if until is None else until, samples)
        return times, self.envelope(times)

    def _bound(self, t: float) -> float:
        if not (math.isfinite(t) and t >= 0):
            raise SpecError(f"t must be a time >= 0 in s; got {t}.", key="t")
        when = Fraction(t)
        bounds = (decayed(stage, when).hi * stage.height for stage in self.stages if stage.start <= when)
        return float_above(min(bounds))

    def rows(self) -> list[tuple[str, str, str, str, str]]:
        """The stages as text: number, kind, start (s), bound of |e|_inf there, rate (1/s)."""
        found = []
        for k, stage in enumerate(self.stages):
            kind, start = QUADRATIC if stage.is_quadratic else SEPARABLE, significant_away_from_zero(stage.start, 6)
            bound = significant_away_from_zero(stage.level * stage.height)
            found.append((str(k + 1), kind, start, bound, significant_towards_zero(stage_rate(stage.certificate))))
        return found

    def __repr__(self) -> str:
        lines = [f"Settling of {self.problem_name}: {self.verdict.value}. {self.reason}"]
        if self.single_time is not None and self.time is not None:
            lines.append(f"One certificate for the whole box gives {self.single_time:.6g} s.")
        if self.stages:
            lines += [f"{'stage':>5}  {'certificate':<13}  {'from (s)':>9}  {'|e| <=':>9}  {'rate (1/s)':>10}"]
            lines += [f"{a:>5}  {b:<13}  {c:>9}  {d:>9}  {e:>10}" for a, b, c, d, e in self.rows()]
        return "\n".join(lines)

    def _card(self) -> Card:
        return Card(
            title=f"Settling of {self.problem_name}",
            verdict=self.verdict.value,
            text=self.reason,
            heads=("stage", "certificate", "from (s)", "|e| ≤", "rate (1/s)"),
            rows=self.rows(),
        )
