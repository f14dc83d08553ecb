"""Proposals for the observer's part of the max-separable certificate: P, beta and kappa (theory,
section 5); no proofs.

A box R with |eps_i| <= s needs rho = R/min v + kappa s sqrt(lambda_max(P)).  For each beta a small
semidefinite program gives the P with the least lambda_max; beta is then searched for the least
kappa sqrt(lambda_max).
"""

import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
from scipy import linalg

from dobc_design._checks import noun
from dobc_design.conditions.consensus.propose import decay_of
from dobc_design.exact.matrix import Array, Matrix, largest_entry, to_float
from dobc_design.exact.number import float_above
from dobc_design.loop.timing import Timing, middle_of, predicted, sampled
from dobc_design.problem.exosystems import Exosystem
from dobc_design.solvers.conic import affine_cone, solve_cones, symmetric_basis
from dobc_design.solvers.program import round_matrix

from .claim import ErrorBound

GRID = 24  # values of beta that are tried at a time
REFINEMENTS = 3  # of the grid, each around the best beta of the one before
LARGEST_PROGRAM = 12  # order up to which semidefinite programs (q^2/2 unknowns) are solved
# What is given away so that rounding cannot cross a constraint that is active; more where P is
# badly conditioned.
SLACKS = tuple(1e-5 * more for more in (1, 10, 100, 1000))
INSIDE = 1e-12  # relative to the entries: eigenvalues that are told from 0
DIGITS = 8
UNIT = 10**6  # beta and kappa have six decimals
FLOOR = 1e-6
NEARLY = 1e-5  # relative to the entries: how far a solver may miss a constraint
LARGEST = 1e100  # entry of a P that is used


def with_kappa(
    error: ErrorBound, *, rate: Fraction | int = 0, least: Fraction | int = 1
) -> ErrorBound:
    """The same error with the kappa for V at this rate (1/s), and weights of at least ``least``;
    rounded up."""
    kappa = 1 / ((error.beta - rate) * least)
    return replace(error, kappa=Fraction(math.ceil(UNIT * kappa), UNIT))


@noun(eq=False)
class _Bound:
    beta: float
    P: Array
    size: float


@noun(eq=False)
class _Pair:
    """The error matrix F (q, q) and output C, in continuous time or, with a ``period``, from tick
    to tick."""

    F: Array
    C: Array
    period: float = 0.0

    @property
    def fastest(self) -> float:
        """The decay rate, per tick where there are ticks."""
        if not self.period:
            return decay_of(self.F)
        largest = largest_entry(np.linalg.eigvals(self.F))
        return (1 - largest) / self.period

    def decay(self, P: Array, beta: float) -> Array:
        """What is >= 0 where P decays at the rate beta."""
        if not self.period:
            return -(self.F.T @ P + P @ self.F) - 2 * beta * P
        left = (1 - self.period * beta) ** 2 * P - self.F.T @ P @ self.F
        return np.asarray(left / self.period)


def _pair(exosystem: Exosystem, W: Matrix, timing: Timing | None) -> _Pair:
    left = to_float(middle_of(predicted(exosystem, timing)))
    if timing is None or not timing.sampled:
        F = to_float(exosystem.A) - to_float(W) @ to_float(exosystem.C)
        return _Pair(F=F, C=left)
    F = to_float(middle_of(sampled(exosystem, timing).error(W, timing.period)))
    return _Pair(F=F, C=left, period=float(timing.period))


def propose_error_bound(
    exosystem: Exosystem, W: Matrix, *, rate: float = 0.0, timing: Timing | None = None
) -> ErrorBound | None:
    """Find P, beta and kappa = 1/(beta - rate) for min v = 1, with kappa sqrt(lambda_max(P)) about
    least.  ``rate`` (1/s) is what V = N + kappa E is to decay with; below the decay rate of A - WC.
    Returns None where no such bound is found (A - WC is not Hurwitz, or slower than ``rate``).
    With a ``timing`` that is sampled the same of the recursion, rates per tick."""
    pair = _pair(exosystem, W, timing)
    fastest = pair.fastest
    if not math.isfinite(fastest) or fastest <= rate:
        return None
    bound_at = _least_bound if len(pair.F) <= LARGEST_PROGRAM else _lyapunov_bound
    low = rate
    high = fastest
    best = None
    # What beta costs may have several valleys, so that a grid looks at it, then a finer one.
    for _ in range(REFINEMENTS):
        betas = np.linspace(low, high, GRID + 2)[1:-1].tolist()
        found = [bound_at(pair, beta) for beta in betas]
        bounds = [bound for bound in (*found, best) if bound is not None]
        if not bounds:
            return None
        best = min(bounds, key=lambda bound: math.sqrt(bound.size) / (bound.beta - rate))
        width = (high - low) / (GRID + 1)
        low = max(rate, best.beta - width)
        high = min(fastest, best.beta + width)
    if best is None:
        return None
    # More is given away until the rounded numbers are inside; exact arithmetic decides later.
    for slack in SLACKS:
        rounded = _rounded(best, rate=rate, slack=slack)
        if rounded is None or _is_inside(pair, rounded):
            return rounded
    return None


def radius_needed(radius: Fraction, error: ErrorBound | None, disturbance: Fraction) -> Fraction:
    """The rho that covers the box ``radius`` and |eps_i| <= ``disturbance`` with min v = 1; four
    decimals, up."""
    if error is None:
        return radius
    root = math.nextafter(math.sqrt(float_above(error.size)), math.inf)
    needed = radius + error.kappa * disturbance * Fraction(root)
    return Fraction(math.ceil(needed * 10**4), 10**4)


def _rounded(bound: _Bound, *, rate: float, slack: float) -> ErrorBound | None:
    """Rational numbers a little inside the constraints: P larger, beta smaller, kappa and size
    larger."""
    P = round_matrix(bound.P * (1 + slack), DIGITS)
    beta = Fraction(math.floor(bound.beta * (1 - slack) * UNIT), UNIT)
    if beta <= rate:
        return None
    kappa = Fraction(math.ceil((1 + slack) / (float(beta) - rate) * UNIT), UNIT)
    top = float(np.linalg.eigvalsh(to_float(P))[-1])
    size = Fraction(math.ceil(top * (1 + 1e-9) * 10**9), 10**9)
    return ErrorBound(P=P, beta=beta, kappa=kappa, size=size)


def _least_bound(pair: _Pair, beta: float) -> _Bound | None:
    """Minimise t subject to P <= t I, c'c <= P, F' P + P F <= -2 beta P, by Clarabel."""
    q = len(pair.F)
    unit = largest_entry(pair.C) or 1.0
    scaled = replace(pair, C=pair.C / unit)  # so that P is about 1
    basis = symmetric_basis(q)
    none = np.zeros((q, q))
    eye = np.eye(q)
    decay = [pair.decay(M, beta) for M in basis]
    # The unknowns are the entries of P, and t.
    sides = [
        affine_cone([*(-M for M in basis), eye], none),
        affine_cone([*basis, none], -FLOOR * eye),
        affine_cone([*decay, none], none),
        *(affine_cone([*basis, none], -np.outer(c, c)) for c in scaled.C),
    ]
    cost = np.append(np.zeros(len(basis)), 1.0)
    answer = solve_cones(cost, sides)
    P = np.zeros((q, q))
    for x, M in zip(answer.x.tolist(), basis, strict=False):
        P = P + x * M
    if not answer.found or not _nearly_holds(P, scaled, beta):
        return _lyapunov_bound(pair, beta)
    return _Bound(beta=beta, P=unit**2 * P, size=unit**2 * float(np.linalg.eigvalsh(P)[-1]))


def _sides(P: Array, pair: _Pair, beta: float) -> list[Array]:
    """What the constraints want to be >= 0."""
    return [pair.decay(P, beta), *(P - np.outer(c, c) for c in pair.C)]


def _is_inside(pair: _Pair, bound: ErrorBound) -> bool:
    """Whether the rounded numbers satisfy the constraints as far as floats can tell."""
    for side in _sides(to_float(bound.P), pair, float(bound.beta)):
        lowest = np.linalg.eigvalsh(side)[0]
        size = largest_entry(side)
        if not float(lowest) >= INSIDE * size:
            return False
    return True


def _nearly_holds(P: Array, pair: _Pair, beta: float) -> bool:
    """Whether floating point sees the constraints, up to rounding: solvers may say what is not
    so."""
    with np.errstate(all="ignore"):
        size = largest_entry(P)
        room = NEARLY * size * (1 + largest_entry(pair.F) + beta)
        try:
            lowest = [float(np.linalg.eigvalsh(side)[0]) for side in _sides(P, pair, beta)]
        except np.linalg.LinAlgError:
            return False
    return 0 < size < LARGEST and min(lowest) >= -room


def _lyapunov_bound(pair: _Pair, beta: float) -> _Bound | None:
    """Without a solver: P from (F + beta I)'P + P (F + beta I) = -I, as large as c'c <= P asks
    for."""
    eye = np.eye(len(pair.F))
    C = pair.C
    with np.errstate(all="ignore"):
        try:
            if pair.period:
                shrunk = pair.F / (1 - pair.period * beta)
                X = linalg.solve_discrete_lyapunov(shrunk.T, eye)
            else:
                X = linalg.solve_continuous_lyapunov((pair.F + beta * eye).T, -eye)
            # c'c <= a X iff c X^-1 c' <= a
            larger = max((float(c @ np.linalg.solve(X, c)) for c in C), default=0.0)
            P = (X + X.T) / 2 * larger
            values = np.linalg.eigvalsh(P)
        except (ValueError, np.linalg.LinAlgError):
            return None
    if not values[0] > 0 or not math.isfinite(values[-1]):
        return None
    return _Bound(beta=beta, P=P, size=float(values[-1]))
