"""The factor of a rate: abs(e(t)) <= factor abs(e(0)) exp(-rate t) + what the estimation error
adds.

The norm is the largest component where V is a weighted maximum, and the Euclidean one where it is a
quadratic form.
"""

import math
from fractions import Fraction
from typing import Any

from .claims import Certificate
from .coordinates import inverse, sizes, spread
from .cycles import growth
from .matrices import ONE, Matrix, identity, largest, nonnegative, paired, plus
from .quadratic import read_form
from .reading import matrix, need, rational, read, weights

TINY = Fraction(1, 10**300)  # rates below count as none
# V = e'e + ...
OF_THE_PAPER = ("lemma1", "theorem1", "theorem2", "theorem1-printed", "theorem2-printed")
OF_QUADRATIC_FORMS = ("theorem1-weighted", "theorem2-weighted", "lure")


def bounded(case: Certificate, check: Any) -> None:
    """The factor that a confirmed check claims, if it does, is at least the one that follows."""
    if check.factor is None:
        return
    need(
        check.verdict == "proved" and check.rate is not None,
        "a factor belongs to the rate of a proof",
    )
    if check.id in OF_QUADRATIC_FORMS:
        shown = follows_from_form(case, check)
    elif check.id == "markov" and check.exact["kind"] == "mean square":
        size = case.loop.size
        forms = [read(P, matrix(size, size)) for P in check.exact["P"].values()]
        shown = conditioned(forms, check.factor**2)
    else:
        shown = check.factor >= least_factor(case, check)
    need(shown, "the factor does not follow")


def least_factor(case: Certificate, check: Any) -> Fraction:
    """The largest N where abs(e) <= 1, times the largest abs(e) where N <= 1 (and times exp(rate t)
    for a schedule)."""
    exact = check.exact
    if check.id in OF_THE_PAPER or check.id == "safety":
        return ONE
    if check.id == "max-separable":
        return of_weights(case, exact)
    if check.id == "tolerance" and "v" in exact:
        v = weights(case.loop.n, exact["v"])
        return max(v) / min(v)
    if check.id in ("delay", "tolerance"):
        beside = case.proved("max-separable").exact
        if check.id == "delay" and case.loop.q:
            need(
                rational(exact["rate"]) < rational(beside["beta"]),
                "no bound follows at the rate beta",
            )
        return of_weights(case, beside)
    if check.id == "schedule":
        return of_schedule(case, exact)
    mean = check.id == "markov" and exact["kind"] == "mean"
    need(mean, "no bound follows from this check")
    w = [weights(case.loop.n, each) for each in exact["w"].values()]
    return max(map(sum, w)) / min(map(min, w))


def coordinates(case: Certificate, exact: Any) -> tuple[Matrix, Matrix]:
    """T and its inverse; without T both are 1."""
    if "T" not in exact:
        return [[ONE]], [[ONE]]
    T = read(exact["T"], matrix(case.loop.m, case.loop.m))
    return T, inverse(T)


def of_weights(case: Certificate, exact: Any) -> Fraction:
    """Of a max-separable: max v / min v without T."""
    T, S = coordinates(case, exact)
    v = weights(case.loop.n * len(T), exact["v"])
    return spread(T, v) * max(map(max, sizes(S, v)))


def of_schedule(case: Certificate, exact: Any) -> Fraction:
    """N does not rise within a phase and falls at the rate from one to the next."""
    T, S = coordinates(case, exact)
    size = case.loop.n * len(T)
    rate = rational(exact["rate"])
    first = Fraction(0)
    highest = Fraction(0)
    for turn, each in paired(case.loop.guarantee.phases, exact["phases"]):
        v = [weights(size, x) for x in each["v"]]
        if turn.first:
            first = max(first, spread(T, v[0]))
        for k, time in enumerate(each["times"]):
            # of a segment the larger weights, and the later end
            wider = list(map(max, v[max(0, k - 1)], v[k]))
            height = max(map(max, sizes(S, wider))) * growth(rate * rational(time))
            highest = max(highest, height)
    return first * highest


def follows_from_form(case: Certificate, check: Any) -> bool:
    """Of V = e'De, e'(D (x) R)e or e'P_e e: the factor squared is at least lambda_max /
    lambda_min."""
    n = case.loop.n
    m = case.loop.m
    exact = check.exact
    square = check.factor**2
    if check.id == "lure":
        return conditioned([read_form(n * m, exact["P_e"])], square)
    alike = "R" in exact
    D = weights(n if alike else n * m, exact["D"])
    left = square * min(D) / max(D)
    if alike:
        return conditioned([read(exact["R"], matrix(m, m))], left)
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


def is_diagonal(P: Matrix) -> bool:
    """Whether all entries beside the diagonal are 0."""
    return not any(any(row[:i] + row[i + 1 :]) for i, row in enumerate(P))


def time_to_one_percent(check: Any) -> float:
    """After how many seconds the bound is a hundredth of abs(e(0)); for a comparison, in floating
    point."""
    # logarithms of what cannot be divided say nothing
    if check.factor is None or not check.rate or check.rate < TINY:
        return math.inf
    return (math.log(100) + math.log(check.factor)) / float(check.rate)
