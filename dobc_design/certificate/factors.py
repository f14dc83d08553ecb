"""The factor that belongs to a rate: |e(t)| <= factor |e(0)| exp(-rate t) + what the estimation
error adds.

It follows from the claim of a proved check alone, in the norm that ``Check.norm`` names: V is
between multiples of |e| (a weighted maximum) or of |e|^2 (a quadratic form), and the factor is the
quotient of the two, or its square root. docs/certificate-claims.md, "Factors", says the same for
every kind of check.
"""

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from functools import partial

from dobc_design.conditions.case import Case
from dobc_design.conditions.check import Check, Claim
from dobc_design.conditions.graphs.claim import Kept
from dobc_design.conditions.margins.decide import Tolerance
from dobc_design.conditions.numbers import claimed, decimal_above
from dobc_design.conditions.quadratic.claim import Quadratic
from dobc_design.conditions.quadratic.decide import condition_bound
from dobc_design.conditions.schedule.claim import Cycles
from dobc_design.conditions.separable.claim import DelayBound, ReadingsBound, Separable
from dobc_design.conditions.weighted.decide import Weighted
from dobc_design.conditions.weighted.network import Alike
from dobc_design.exact.interval import Interval, exp
from dobc_design.exact.number import ONE, ZERO, root_above
from dobc_design.exact.symmetric import Doubles, SparseSymmetric, largest, least
from dobc_design.loop.loop import Loop

from .claims import box_of, claim_of

MOST = Fraction(10) ** 300  # factors above are of no use to anybody
# of a factor with exp in it, for a second program with a wider enclosure
IN_HAND = Fraction(1, 10**9)
_root = partial(root_above, unit=10**12)


def with_factors(case: Case) -> tuple[Check, ...]:
    """The checks of the case; proved ones that have a rate with its factor, rounded up."""
    found: list[Check] = []
    for check in case.checks:
        factor = factor_of(check, case)
        # A check may always claim less: no factor is better than one beyond all use.
        known = factor is not None and factor <= MOST
        found.append(replace(check, factor=decimal_above(factor) if factor and known else None))
    return tuple(found)


def factor_obstacle(check: Check, case: Case) -> str | None:
    """None if the factor of a confirmed check follows from what it claims, or it has none; else
    what is wrong."""
    if check.factor is None:
        return None
    own = factor_of(check, case)
    if own is None:
        return "it claims a factor, and no bound follows from it"
    return None if own <= claimed(check.factor) else f"the factor {check.factor} does not follow"


def factor_of(check: Check, case: Case) -> Fraction | None:
    """The factor of one check of a case; None for one without a rate, and where no bound follows
    from it."""
    if not check.is_proved or not check.rate:
        return None
    # V = e'e is |e|^2 itself, beside what the estimation error adds.
    if check.kind.is_of_paper:
        return ONE
    claim = claim_of(check, case.loop, case.W)
    if isinstance(claim, DelayBound) or (isinstance(claim, Tolerance) and claim.v is None):
        return _of_proof_beside(claim, case)
    return _of_claim(claim, case.loop)


def _of_claim(claim: Claim | None, loop: Loop) -> Fraction | None:
    if isinstance(claim, ReadingsBound):
        # before the first input acts nothing decays, and a disturbance moves agents
        ahead = ZERO if loop.timing is None else loop.timing.ahead
        if not ahead:
            return claim.rows.factor
        if loop.groups:
            return None
        return claim.rows.factor * exp(Interval.point(claim.rows.alpha * ahead)).hi * (1 + IN_HAND)
    if isinstance(claim, Separable):
        return claim.factor
    if isinstance(claim, Tolerance) and claim.v is not None:
        return _ratio(claim.v)
    if isinstance(claim, Cycles):
        return claim.factor(loop) * (1 + IN_HAND)
    if isinstance(claim, Weighted):
        return _root(_ratio(claim.D))
    if isinstance(claim, Alike) and claim.weights:
        return _of_form(SparseSymmetric.from_dense(claim.R), _ratio(claim.weights.D))
    if isinstance(claim, Quadratic):
        return _of_form(claim.P_e)
    if isinstance(claim, Kept):
        return _of_graphs(claim)
    return None


def _of_proof_beside(claim: DelayBound | Tolerance, case: Case) -> Fraction | None:
    """That of the max-separable certificate on which the claim rests.  With an observer a delayed
    loop keeps every rate below that of the claim, and a bound follows only at rates below beta."""
    base = box_of(case.checks, case.loop, case.W)
    if base is None:
        return None
    if isinstance(claim, DelayBound) and base.error is not None and claim.rate >= base.error.beta:
        return None
    return base.factor


def _of_graphs(claim: Kept) -> Fraction | None:
    """Of V = max |e_i|, of E sum w_i |e_i| as a bound of E |e|_inf, and of E e'P e as one of (E
    |e|^2)^(1/2)."""
    if claim.w is not None:
        weights = [tuple(each) for each in claim.w.values()]
        return max(sum(each, ZERO) for each in weights) / min(map(min, weights))
    if claim.P is None:
        return ONE
    forms = [SparseSymmetric.from_dense(P) for P in claim.P.values()]
    # the forms of all modes along one diagonal: its condition is theirs
    blocks = dict[tuple[int, int], Fraction]()
    for number, form in enumerate(forms):
        shift = number * form.size
        blocks |= {(i + shift, j + shift): value for (i, j), value in form.entries.items()}
    return _of_form(SparseSymmetric(len(forms) * forms[0].size, blocks))


def _of_form(form: SparseSymmetric, times: Fraction = ONE) -> Fraction | None:
    """The root of the condition of a quadratic form; ``times``: of weights beside it."""
    condition = condition_bound(form)
    return None if condition is None else _root(times * condition)


def _ratio(v: Sequence[Fraction] | Doubles) -> Fraction:
    return largest(v) / least(v)
