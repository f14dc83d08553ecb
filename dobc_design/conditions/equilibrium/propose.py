"""Candidates for other equilibria: roots of h(e) - K e by Newton's method, and those that are
proved.

Points to begin with come from elsewhere, such as the ends of simulated runs.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from fractions import Fraction
from functools import partial

import numpy as np
from scipy import optimize

from dobc_design.exact.interval import Box, Interval
from dobc_design.exact.matrix import Array, largest_entry
from dobc_design.exact.number import ONE
from dobc_design.exact.work import spend
from dobc_design.loop.loop import Loop
from dobc_design.loop.matrices import pull_matrix
from dobc_design.model.couplings import felt_errors

from .decide import LARGEST, Equilibrium, lies_in_region, why_not

Vectors = Callable[[Array], Array]

MOST_PROVED = 4  # roots of one mode for which a proof is tried, the nearest to the target first
STEPS = 60
CLOSE = 1e-11  # |F|_inf of a root, relative to the slopes and to the size of e
ROOT_WORK = 300  # steps of work for one root
AT_TARGET = 1e-4  # |e|_inf below which a root is the target, relative to the farthest point
SAME = 1e-6  # relative distance of roots that are one

# Half widths tried, as powers of ten of the size of the equilibrium, and the digits of the middle
# beyond them.
HALF_WIDTHS = (6, 8, 10, 4, 3)
EXTRA_DIGITS = 4
BITS = (0, 1, 2, 4, 8, 16)  # of the numbers of a point that is an equilibrium exactly
# of each half width is used by boxes made here: other enclosures may be wider
IN_HAND = Fraction(9, 10)
LEAST = 1e-200  # of |e|_inf of an equilibrium that is looked at


def proved_equilibria(
    loop: Loop,
    mode: str,
    points: Sequence[Array],
    *,
    holds: Callable[[Array], bool],
    within_region: bool = False,
    most: int = MOST_PROVED,
) -> list[Equilibrium]:
    """Proved equilibria of one mode that the points lead to, among those of which ``holds`` is
    true, the nearest to the target first."""
    roots = [root for root in find_roots(loop, mode, points) if holds(root)]
    # The nearest says most about the region.
    roots.sort(key=largest)
    enclose = partial(enclose_equilibrium, loop, mode, within_region=within_region)
    found: list[Equilibrium] = []
    for root in roots[:MOST_PROVED]:
        claim = enclose(root.tolist())
        if claim is not None:
            found.append(claim)
        if len(found) == most:
            break
    if found and found[0].is_point:  # one of many: the farthest shows the most
        farthest = enclose(roots[-1].tolist())
        return found if farthest is None else [farthest]
    return found


def enclose_equilibrium(
    loop: Loop, mode: str, point: Sequence[float], *, within_region: bool = False
) -> Equilibrium | None:
    """A proved box, in the region asked for if ``within_region``, around an equilibrium that
    floating point sees at ``point`` (n m,), or one of short numbers near it; None if none is
    proved.  Half widths are powers of ten, about 1e-6 of |e|_inf first."""
    if len(point) != loop.size or loop.size > LARGEST or not all(map(math.isfinite, point)):
        return None
    if max(map(abs, point)) < LEAST:
        return None
    for box, part in _boxes_around(point):
        claim = Equilibrium(mode=mode, box=box)
        if within_region and not lies_in_region(loop, claim):
            continue
        if why_not(loop, claim, part=part) is None:
            return claim
    return None


def _boxes_around(point: Sequence[float]) -> Iterator[tuple[Box, Fraction]]:
    """Boxes worth a proof, each with the part of its half widths that the proof is to use."""
    exact = [Fraction(x) for x in point]
    size = math.ceil(math.log10(max(map(abs, point))))
    for digits in HALF_WIDTHS:
        half = Fraction(10) ** (size - digits)
        # A short middle keeps the rationals of the proof short.
        unit = Fraction(10) ** (digits + EXTRA_DIGITS - size)
        middle = [Fraction(round(x * unit)) / unit for x in exact]
        yield tuple(Interval(c - half, c + half) for c in middle), IN_HAND
    # one of many, as in a dead zone: some short numbers may be one, too
    farthest = max(map(abs, exact))
    magnitude = farthest.numerator.bit_length() - farthest.denominator.bit_length()
    for bits in BITS:
        unit = Fraction(2) ** (magnitude - bits)
        yield tuple(Interval.point(round(x / unit) * unit) for x in exact), ONE


def point_of(claim: Equilibrium) -> Array:
    """The middle of the box as floats, (n m,)."""
    return np.array([float(c) for c in claim.middle])


def distance_of(claim: Equilibrium) -> float:
    """How far it is from the target, |e|_inf."""
    return largest(point_of(claim))


def largest(e: Array) -> float:
    """|e|_inf."""
    return largest_entry(e)


def find_roots(loop: Loop, mode: str, points: Sequence[Array]) -> Iterator[Array]:
    """Roots other than the target that the points lead to, each once, as they are found."""
    felt = felt_errors(loop, mode)  # eps = 0
    K = pull_matrix(loop).toarray()
    known: list[Array] = []

    def value(e: Array) -> Array:
        return np.asarray(np.asarray(felt.h(e)).ravel() - K @ e)

    def slope(e: Array) -> Array:
        return np.asarray(felt.jacobian(e).full() - K)

    least = AT_TARGET * max(map(largest, points), default=0.0)
    for point in points:
        spend(ROOT_WORK)
        # Points that lead to the target say nothing.
        root = _root(value, slope, point, least)
        if root is None:
            continue
        size = largest_entry(root)
        if all(largest_entry(root - other) > SAME * size for other in known):
            known.append(root)
            yield root


def _root(value: Vectors, slope: Vectors, start: Array, least: float) -> Array | None:
    """A root with |e|_inf > ``least`` of a function with this derivative, or None."""
    # It stops by itself where floats end; what is close is decided below.
    limits = {"maxiter": STEPS, "xtol": 0.0, "ftol": 0.0}
    e = optimize.root(value, start, jac=slope, method="lm", options=limits).x
    steepest = np.abs(slope(e)).sum(axis=1).max()
    reach = largest(e)
    close = largest_entry(value(e)) <= CLOSE * steepest * reach  # never for nan
    return np.asarray(e) if close and least < reach < np.inf else None
