"""Sines of a constant frequency w somewhere in a band, of any phase: what the observers leave of
them.

What acts in place of a disturbance d of the inputs is S d, S = D + C (sI - F)^-1 G (channels), and
what decays. Row by row |S(jw)| is bounded by the gains of the claim: for an entry N/chi of S

    g^2 |chi(jw)|^2 - |N(jw)|^2 >= 0,    a polynomial in x = w^2,

which is so on a part of the band where none of its Bernstein coefficients there is negative. Parts
where one is are halved.
"""

import math
from fractions import Fraction
from itertools import pairwise
from typing import Any

from .channels import Channel
from .matrices import ZERO, Matrix, Vector, characteristic, combined, paired, product, stable
from .reading import need

PARTS = 2000  # of a band


def need_bands(bands: list[Any], channel: Channel, gains: list[Matrix]) -> None:
    """Of every band no more is left than its gains, one for each entry of S, say."""
    need(stable(channel.F), "A - W C is not Hurwitz")
    need(len(bands) == len(gains), "there are not gains for every band")
    chi = characteristic(channel.F)
    entries = numerators(channel, chi)
    for (low, high, _), claimed in paired(bands, gains):
        for row, most in paired(entries, claimed):
            for N, g in paired(row, most):
                need(g >= 0, "a gain is negative")
                rest = combined([g * g * x for x in square(chi)], -1, square(N))
                holds = nonnegative(rest, low * low, high * high)
                need(holds, "more may be left of a sine in a band")


def numerators(channel: Channel, chi: Vector) -> list[list[Vector]]:
    """Those of the entries of S, over chi, highest power first. C adj(sI - F) G has the
    coefficients C (F^k + chi_1 F^(k-1) + ...) G."""
    F = channel.F
    q = len(F)
    powers = []  # C F^k G
    seen = channel.disturbance
    for _ in range(q):
        powers.append(product(channel.C, seen))
        seen = product(F, seen)
    found = []
    for i, line in enumerate(channel.D):
        row = []
        for j, direct in enumerate(line):
            passed = [ZERO]
            for k in range(q):
                passed.append(sum((chi[k - n] * powers[n][i][j] for n in range(k + 1)), ZERO))
            row.append(combined(passed, direct, chi))
        found.append(row)
    return found


def square(polynomial: Vector) -> Vector:
    """|p(jw)|^2 by x = w^2, lowest power first."""
    rising = polynomial[::-1]
    # powers of j turn the signs of every second one of the even and of the odd ones
    even = [x * (-1) ** k for k, x in enumerate(rising[0::2])]
    odd = [x * (-1) ** k for k, x in enumerate(rising[1::2])]
    size = len(polynomial)
    total = [ZERO] * size
    for part, shift in ((even, 0), (odd, 1)):
        for i, x in enumerate(part):
            for j, y in enumerate(part):
                total[i + j + shift] += x * y
    return total


def nonnegative(rising: Vector, low: Fraction, high: Fraction) -> bool:
    """Whether a polynomial, lowest power first, is seen to be >= 0 on [low, high]."""
    todo = [bernstein(rising, low, high)]
    for _ in range(PARTS):
        if not todo:
            return True
        form = todo.pop()
        # the outer coefficients are values
        if min(form[0], form[-1]) < 0:
            return False
        if min(form) < 0:
            todo += halves(form)
    return not todo


def bernstein(rising: Vector, low: Fraction, high: Fraction) -> Vector:
    """The Bernstein coefficients on [low, high]."""
    n = len(rising) - 1
    power = [ZERO] * (n + 1)  # of t, x = low + (high - low) t
    for k, c in enumerate(rising):
        for i in range(k + 1):
            power[i] += c * math.comb(k, i) * low ** (k - i) * (high - low) ** i
    form = []
    for i in range(n + 1):
        parts = (power[k] * Fraction(math.comb(i, k), math.comb(n, k)) for k in range(i + 1))
        form.append(sum(parts, ZERO))
    return form


def halves(form: Vector) -> list[Vector]:
    """Those on both halves (de Casteljau)."""
    left = []
    right = []
    while form:
        left.append(form[0])
        right.append(form[-1])
        form = [(x + y) / 2 for x, y in pairwise(form)]
    return [left, right[::-1]]
