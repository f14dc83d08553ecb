"""The factor of a rate: abs(e(t)) <= factor abs(e(0)) exp(-rate t) + what the estimation error
adds.

The norm is the largest component where V is a weighted maximum, and the Euclidean one where it is a
quadratic form.
"""

import math
from fractions import Fraction
from typing import Any

from .coordinates import inverse, sizes, spread
from .cycles import phases
from .files import Certificate
from .intervals import by_decimal
from .matrices import Matrix, identity, largest, nonnegative, plus
from .quadratic import read_form
from .reading import matrix, need, rational, read, weights

ONE = Fraction(1)
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
        size = case.problem.n * case.problem.m
        forms = [read(P, matrix(size, size)) for P in check.exact["P"].values()]
        shown = conditioned(forms, check.factor**2)
    else:
        shown = check.factor >= least_factor(case, check)
    need(shown, "the factor does not follow")


def least_factor(case: Certificate, check: Any) -> Fraction:
    """The largest N where abs(e) <= 1, times the largest abs(e) where N <= 1 (and times exp(rate t)
    for a schedule)."""
    p, exact = case.problem, check.exact
    if check.id in OF_THE_PAPER or check.id == "safety":
        return ONE
    if check.id == "max-separable":
        return of_weights(case, exact)
    if check.id == "tolerance" and "v" in exact:
        v = weights(p.n, exact["v"])
        return max(v) / min(v)
    if check.id in ("delay", "tolerance"):
        beside = next(
            each for each in case.checks if (each.id, each.verdict) == ("max-separable", "proved")
        )
        late = check.id == "delay" and p.q > 0
        need(
            not late or rational(exact["rate"]) < rational(beside.exact["beta"]),
            "no bound follows at the rate beta",
        )
        return of_weights(case, beside.exact)
    if check.id == "schedule":
        return of_schedule(case, exact)
    need(check.id == "markov" and exact["kind"] == "mean", "no bound follows from this check")
    w = [weights(p.n, each) for each in exact["w"].values()]
    return max(map(sum, w)) / min(map(min, w))


def coordinates(case: Certificate, exact: Any) -> tuple[Matrix, Matrix]:
    """T and its inverse; without T both are 1."""
    if "T" not in exact:
        return [[ONE]], [[ONE]]
    T = read(exact["T"], matrix(case.problem.m, case.problem.m))
    return T, inverse(T)


def of_weights(case: Certificate, exact: Any) -> Fraction:
    """Of a max-separable: max v / min v without T."""
    T, S = coordinates(case, exact)
    v = weights(case.problem.n * len(T), exact["v"])
    return spread(T, v) * max(map(max, sizes(S, v)))


def of_schedule(case: Certificate, exact: Any) -> Fraction:
    """N does not rise within a phase and falls at the rate from one to the next."""
    T, S = coordinates(case, exact)
    size, rate = case.problem.n * len(T), rational(exact["rate"])
    first, heights = ONE * 0, [ONE * 0]
    for turn, each in zip(phases(case.problem), exact["phases"], strict=True):
        v = [weights(size, x) for x in each["v"]]
        if turn.first:
            first = max(first, spread(T, v[0]))
        for k, time in enumerate(map(rational, each["times"])):
            wider = list(map(max, v[max(0, k - 1)], v[k]))
            grown = Fraction(by_decimal("exp", (rate * time,) * 2)[1])
            heights.append(max(map(max, sizes(S, wider))) * grown)
    return first * max(heights)


def follows_from_form(case: Certificate, check: Any) -> bool:
    """Of V = e'De, e'(D (x) R)e or e'P_e e: the factor squared is at least lambda_max /
    lambda_min."""
    p, exact, square = case.problem, check.exact, check.factor**2
    if check.id == "lure":
        return conditioned([read_form(p.n * p.m, exact["P_e"])], square)
    alike = "R" in exact
    D = weights(p.n if alike else p.n * p.m, exact["D"])
    left = square * min(D) / max(D)
    return conditioned([read(exact["R"], matrix(p.m, p.m))], left) if alike else left >= 1


def conditioned(forms: list[Matrix], square: Fraction) -> bool:
    """True if lambda_max of any of these positive definite matrices is at most ``square`` times
    lambda_min of any."""
    plain = all(
        i == j or not x for P in forms for i, row in enumerate(P) for j, x in enumerate(row)
    )
    if plain:
        entries = [P[i][i] for P in forms for i in range(len(P))]
        return max(entries) <= square * min(entries)
    top = max(map(largest, forms))
    return all(nonnegative(plus(P, -top / square, identity(len(P)))) for P in forms)


def time_to_one_percent(check: Any) -> float:
    """After how many seconds the bound is a hundredth of abs(e(0)); for a comparison, in floating
    point."""
    if check.factor is None or not check.rate or check.rate < TINY:
        return math.inf
    return (math.log(100) + math.log(check.factor)) / float(check.rate)
