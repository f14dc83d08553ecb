"""The factor of a rate: abs(e(t)) <= factor abs(e(0)) exp(-rate t) + what the estimation error
adds.

The norm is the largest component where V is a weighted maximum, and the Euclidean one where it is a
quadratic form.
"""

import math
from fractions import Fraction
from typing import Any

from .claims import Case
from .coordinates import inverse, sizes
from .cycles import growth
from .matrices import (
    ONE,
    ZERO,
    Matrix,
    Vector,
    identity,
    is_diagonal,
    largest,
    nonnegative,
    paired,
    plus,
)
from .reading import need, rational
from .separable import frame, spread

TINY = Fraction(1, 10**300)  # rates below count as none
# V = e'e + ...
OF_THE_PAPER = ("lemma1", "theorem1", "theorem2", "theorem1-printed", "theorem2-printed")
OF_QUADRATIC_FORMS = ("theorem1-weighted", "theorem2-weighted", "lure", "arc-wise")


def bounded(case: Case, check: Any, claim: Any) -> None:
    """The factor that a confirmed check claims, if it does, is at least the one that follows from
    its exact values, which have been read."""
    if check.factor is None:
        return
    rate_of_proof = check.verdict == "proved" and check.rate is not None
    need(rate_of_proof, "a factor belongs to the rate of a proof")
    square = check.factor**2
    if check.id in OF_QUADRATIC_FORMS:
        of_pairs = check.id == "arc-wise"
        need(of_pairs or not case.agrees, "of differences no bound follows from it")
        shown = follows_from_form(check, claim, square)
    elif check.id == "markov" and claim.kind == "mean square":
        shown = conditioned(list(claim.parts.values()), square)
    else:
        shown = check.factor >= least_factor(case, check, claim)
    need(shown, "the factor does not follow")


def least_factor(case: Case, check: Any, claim: Any) -> Fraction:
    """The largest N where abs(e) <= 1, times the largest abs(e) where N <= 1 (and times exp(rate t)
    for a schedule)."""
    if check.id in OF_THE_PAPER or check.id == "safety":
        return ONE
    if check.id == "schedule":
        return of_schedule(case, claim)
    if check.id in ("max-separable", "delay", "readings", "tolerance"):
        if check.id == "delay" and case.q:
            need(rational(check.exact["rate"]) < claim.beta, "no bound follows at the rate beta")
        T = frame(claim)
        before = ONE
        if check.id == "readings":
            # nothing decays before the first input acts, and a disturbance moves nodes
            need(case.q == 0 or case.timing.ahead == 0, "no bound follows where inputs act late")
            before = growth(claim.alpha * case.timing.ahead)
        # max v / min v without T
        return before * spread(T, claim.v) * max(map(max, sizes(inverse(T), claim.v)))
    mean = check.id == "markov" and claim.kind == "mean"
    need(mean, "no bound follows from this check")
    w: list[Vector] = list(claim.parts.values())
    return max(map(sum, w)) / min(map(min, w))


def of_schedule(case: Case, claim: Any) -> Fraction:
    """N does not rise within a phase and falls at the rate from one to the next."""
    T = frame(claim)
    S = inverse(T)
    first = ZERO
    highest = ZERO
    for turn, each in paired(case.guarantee.phases, claim.phases):
        v = each.v
        if turn.first:
            first = max(first, spread(T, v[0]))
        for k, time in enumerate(each.times):
            # of a segment the larger weights, and the later end
            wider = list(map(max, v[max(0, k - 1)], v[k]))
            height = max(map(max, sizes(S, wider))) * growth(claim.rate * time)
            highest = max(highest, height)
    return first * highest


def follows_from_form(check: Any, claim: Any, square: Fraction) -> bool:
    """Of V = e'De, e'(D (x) R)e or e'P_e e: ``square`` is at least lambda_max / lambda_min."""
    if check.id == "lure":
        return conditioned([claim.P_e], square)
    D = claim.d if check.id == "arc-wise" else claim.D
    left = square * min(D) / max(D)
    if "R" in check.exact:
        return conditioned([claim.R], left)
    return bool(left >= 1)


def conditioned(forms: list[Matrix], square: Fraction) -> bool:
    """True if lambda_max of any of these positive definite matrices is at most ``square`` times
    lambda_min of any."""
    if all(map(is_diagonal, forms)):
        entries = [P[i][i] for P in forms for i in range(len(P))]
        return max(entries) <= square * min(entries)
    # an upper bound: with a larger one it is harder to show
    top = max(map(largest, forms))
    return all(nonnegative(plus(P, -top / square, identity(len(P)))) for P in forms)


def time_to_one_percent(check: Any) -> float:
    """After how many seconds the bound is a hundredth of abs(e(0)); for a comparison, in floating
    point."""
    # logarithms of what cannot be divided say nothing
    if check.factor is None or not check.rate or check.rate < TINY:
        return math.inf
    return (math.log(100) + math.log(check.factor)) / float(check.rate)
