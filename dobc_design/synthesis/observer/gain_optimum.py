"""The smallest |W| that puts the spectrum of A - W C into given regions: a smooth program in real factors.

The characteristic polynomial is a product of s^2 + b s + c (and s + c). A closed half plane, disk or cone asks a few
smooth inequalities of each (b, c), also where roots meet, which is where such optima lie and where eigenvalues have no
derivative. Sequential quadratic programming from several starts; a proposal, as everything here.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import comb
from typing import Any

import numpy as np
from scipy import linalg, optimize

from dobc_design.solvers.program import Array
from dobc_design.synthesis.observer.spectral_regions import Cone, Disk, SpectralRegion, common_interval

STARTS = 6  # random ones, beside those that are handed in
FEASIBLE = 1e-7  # residual of a scaled constraint up to which an answer counts
STEPS = 150  # of the quadratic programming
CONTRACTION = 0.98  # starts lie this far inside the regions


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Spectral:
    """A pair (A, C) in floats, observable, and the regions, all in units in which they are near 1."""

    A: Array
    C: Array
    regions: tuple[SpectralRegion, ...]
    time: float  # 1/s, worth 1 here
    weights: Array  # sizes of the coefficients of the characteristic polynomial

    @property
    def quadratics(self) -> int:
        """How many factors s^2 + b s + c there are."""
        return len(self.A) // 2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Optimum:
    """W (q, m) in the pair's own units, and |W|."""

    W: Array
    size: float


def smallest_gain(
    A: Array, C: Array, regions: Sequence[SpectralRegion], *, starts: Sequence[Array] = (), random: int = STARTS
) -> Optimum | None:
    """Look for the W of least |W| (root of the sum of squares) with the spectrum of A - W C in closed regions.

    Shapes: A (q, q), C (m, q), observable, W (q, m). ``starts`` are gains to begin from.
    Returns: the best found, or None.
    """
    if common_interval(tuple(regions)) is None:
        return None
    time = _unit_of_time(A, regions)
    weights = np.array([float(comb(len(A), k)) for k in range(1, len(A) + 1)])
    problem = Spectral(A=A / time, C=C, regions=tuple(regions), time=time, weights=weights)
    best: Optimum | None = None
    for start in _starts(problem, [W / time for W in starts], random):
        found = _solve(problem, start)
        if found is not None and (best is None or found.size < best.size * (1 - 1e-12)):
            best = found
    return best


def _solve(problem: Spectral, start: Array) -> Optimum | None:
    q, m = problem.C.shape[1], problem.C.shape[0]
    gains = q * m
    with np.errstate(all="ignore"):
        scale = max(1.0, float(np.linalg.norm(start[:gains])))
    if not np.isfinite(scale):
        return None
    constraints = [
        {"type": "eq", "fun": lambda x: _mismatch(problem, x), "jac": lambda x: _mismatch_jacobian(problem, x)},
        {"type": "ineq", "fun": lambda x: _inequalities(problem, x)[0], "jac": lambda x: _inequalities(problem, x)[1]},
    ]

    def objective(x: Array) -> tuple[float, Array]:
        gradient = np.zeros_like(x)
        gradient[:gains] = 2 * x[:gains] / scale**2
        return float(x[:gains] @ x[:gains]) / scale**2, gradient

    try:
        with np.errstate(all="ignore"):
            answer = optimize.minimize(
                objective,
                start,
                jac=True,
                method="SLSQP",
                constraints=constraints,
                options={"maxiter": STEPS, "ftol": 1e-14},
            )
            x = np.asarray(answer.x, dtype=float)
            if not np.all(np.isfinite(x)):
                return None
            mismatch, inequalities = _mismatch(problem, x), _inequalities(problem, x)[0]
    except (ValueError, linalg.LinAlgError):
        return None
    if np.max(np.abs(mismatch), initial=0.0) > FEASIBLE or np.min(inequalities, initial=0.0) < -FEASIBLE:
        return None
    W = x[:gains].reshape(q, m) * problem.time
    return Optimum(W=W, size=float(np.linalg.norm(W)))


def _mismatch(problem: Spectral, x: Array) -> Array:
    """Coefficients of det(sI - A + WC) minus those of the product of the factors, each in parts of its size."""
    q, m = problem.C.shape[1], problem.C.shape[0]
    F = problem.A - x[: q * m].reshape(q, m) @ problem.C
    product = _product(_factors(problem, x[q * m :]))
    return np.asarray((_adjugate(F)[0] - product)[1:] / problem.weights, dtype=float)


def _mismatch_jacobian(problem: Spectral, x: Array) -> Array:
    q, m = problem.C.shape[1], problem.C.shape[0]
    F = problem.A - x[: q * m].reshape(q, m) @ problem.C
    jacobian = np.zeros((q, len(x)))
    for k, M in enumerate(_adjugate(F)[1]):
        jacobian[k, : q * m] = (problem.C @ M).T.ravel()
    factors = _factors(problem, x[q * m :])
    column = q * m
    for k, factor in enumerate(factors):
        others = _product([other for j, other in enumerate(factors) if j != k])
        for power in range(len(factor) - 2, -1, -1):  # d/db multiplies by s, d/dc by 1
            first = q - len(others) - power
            jacobian[first : first + len(others), column] -= others
            column += 1
    return np.asarray(jacobian / problem.weights[:, None], dtype=float)


def _adjugate(F: Array) -> tuple[Array, list[Array]]:
    """Coefficients of det(sI - F), and the matrix coefficients of adj(sI - F): Faddeev and LeVerrier."""
    q = len(F)
    coefficients = np.zeros(q + 1)
    coefficients[0] = 1.0
    matrices = []
    M = np.eye(q)
    for k in range(1, q + 1):
        matrices.append(M)
        image = F @ M
        coefficients[k] = -image.trace() / k
        M = image.copy()
        M.flat[:: q + 1] += coefficients[k]
    return coefficients, matrices


def _product(factors: Sequence[Array]) -> Array:
    product: Any = np.ones(1)
    for factor in factors:
        product = np.convolve(product, factor)
    return np.asarray(product, dtype=float)


def _factors(problem: Spectral, parameters: Array) -> list[Array]:
    count = problem.quadratics
    factors = [np.array([1.0, parameters[2 * k], parameters[2 * k + 1]]) for k in range(count)]
    if len(parameters) > 2 * count:
        factors.append(np.array([1.0, parameters[-1]]))
    return factors


def _inequalities(problem: Spectral, x: Array) -> tuple[Array, Array]:
    """All conditions of all factors, each >= 0, and the Jacobian."""
    q, m = problem.C.shape[1], problem.C.shape[0]
    first, count = q * m, problem.quadratics
    values: list[float] = []
    rows: list[Array] = []
    for k in range(count):
        place = first + 2 * k
        for value, by_b, by_c in _of_quadratic(problem, float(x[place]), float(x[place + 1])):
            row = np.zeros(len(x))
            row[place], row[place + 1] = by_b, by_c
            values.append(value)
            rows.append(row)
    if q % 2:
        for sign, offset in _of_linear(problem):
            row = np.zeros(len(x))
            row[-1] = sign
            values.append(sign * float(x[-1]) + offset)
            rows.append(row)
    return np.array(values), np.array(rows).reshape(len(values), len(x))


def _of_quadratic(problem: Spectral, b: float, c: float) -> Iterator[tuple[float, float, float]]:
    """Conditions on s^2 + b s + c, value >= 0, with their derivatives by b and c."""
    for region in problem.regions:
        if isinstance(region, Disk):
            x, r = float(region.centre) / problem.time, float(region.radius) / problem.time
            c1 = (x * x + b * x + c) / r**2  # (x + r w)^2 + b (x + r w) + c = r^2 (w^2 + b1 w + c1)
            yield 1 - c1, -x / r**2, -1 / r**2
            for sign in (1.0, -1.0):
                yield 1 + c1 + sign * (2 * x + b) / r, x / r**2 + sign / r, 1 / r**2
        elif isinstance(region, Cone):
            z = 4 * float(region.damping) ** 2
            yield b, 1.0, 0.0
            yield c, 0.0, 1.0
            yield b * b - z * c, 2 * b, -z
        else:
            limit = region.left_of if region.left_of is not None else region.right_of
            a = float(limit or 0) / problem.time
            sign = 1.0 if region.left_of is not None else -1.0
            yield sign * (b + 2 * a), sign, 0.0
            yield a * a + a * b + c, a, 1.0


def _of_linear(problem: Spectral) -> Iterator[tuple[float, float]]:
    """Conditions sign c + offset >= 0 on s + c."""
    for region in problem.regions:
        low, high = region.real_ends
        if high is not None:  # -c <= high
            yield 1.0, float(high) / problem.time
        if low is not None:
            yield -1.0, -float(low) / problem.time


def _starts(problem: Spectral, gains: Sequence[Array], count: int) -> Iterator[Array]:
    """Points to begin from: given gains, A's own eigenvalues moved into the regions, one real point, random ones."""
    q, m = problem.C.shape[1], problem.C.shape[0]
    low, high = _real_part(problem)
    middle = (low + high) / 2
    for W in gains:
        poles = np.linalg.eigvals(problem.A - W @ problem.C)
        yield np.concatenate([W.ravel(), _parameters(_pulled(problem, poles, middle))])
    own: Any = np.linalg.eigvals(problem.A)
    generator = np.random.default_rng(0)
    spectra = [_pulled(problem, own + (high - np.max(own.real)), middle), np.full(q, high), np.full(q, middle)]
    for _ in range(count):
        pull = generator.uniform(low, high) + own - np.mean(own.real) * generator.uniform(0, 1)
        spread = pull + generator.normal(size=q) * 0.3
        spectra.append(_pulled(problem, _paired(spread), middle))
    for spectrum in spectra:
        placed = gain_for_polynomial(problem.A, problem.C, np.real(np.poly(spectrum)), seed=0)
        yield np.concatenate([(np.zeros((q, m)) if placed is None else placed).ravel(), _parameters(spectrum)])


def gain_for_polynomial(A: Array, C: Array, polynomial: Array, *, seed: int) -> Array | None:
    """W with det(sI - A + WC) = polynomial, in floats: Ackermann's formula, outputs mixed at random if several."""
    q, m = C.shape[1], C.shape[0]
    mix = np.ones((1, 1)) if m == 1 else np.random.default_rng(seed).normal(size=(1, m))
    c = mix @ C
    rows = [c]
    for _ in range(q - 1):
        rows.append(rows[-1] @ A)
    value = np.zeros((q, q))
    for x in polynomial:
        value = value @ A + x * np.eye(q)
    try:
        last = np.linalg.solve(np.vstack(rows), np.eye(q)[:, -1:])
    except np.linalg.LinAlgError:
        return None
    W = np.asarray(value @ last @ mix, dtype=float)
    return W if np.all(np.isfinite(W)) else None


def _real_part(problem: Spectral) -> tuple[float, float]:
    """A finite piece of the real axis that all regions share."""
    lows, highs = zip(*(region.real_ends for region in problem.regions), strict=True)
    high = min((float(x) / problem.time for x in highs if x is not None), default=0.0)
    low = max((float(x) / problem.time for x in lows if x is not None), default=high - 1.0)
    return low, high


def _paired(values: Any) -> Any:
    """Make complex numbers into conjugate pairs (the last one real if they are odd in number)."""
    result: list[complex] = []
    for k in range(len(values) // 2):
        z = complex(values[2 * k])
        result += [z, z.conjugate()]
    if len(values) % 2:
        result.append(complex(values[-1].real))
    return np.array(result)


def _pulled(problem: Spectral, poles: Any, middle: float) -> Any:
    """Move each pole towards a common real point until it lies in every region."""
    result = []
    for pole in poles:
        z = complex(pole)
        for _ in range(200):
            if regions_hold(problem.regions, z * problem.time):
                break
            z = middle + CONTRACTION * (z - middle)
        result.append(z)
    return np.array(result)


def regions_hold(regions: Sequence[SpectralRegion], s: complex) -> bool:
    """Whether a point (1/s) lies in all closed regions, in floats."""
    return all(_holds(region, s) for region in regions)


def _holds(region: SpectralRegion, s: complex) -> bool:
    if isinstance(region, Disk):
        return abs(s - float(region.centre)) <= float(region.radius)
    if isinstance(region, Cone):
        return -s.real >= float(region.damping) * abs(s)
    low, high = region.real_ends
    return (high is None or s.real <= float(high)) and (low is None or s.real >= float(low))


def _parameters(poles: Any) -> Array:
    """(b, c) of the pairs, then c of the real one that is left: complex pairs first, reals by size."""
    upper = sorted((z for z in poles if z.imag > 1e-9 * (1 + abs(z))), key=lambda z: (z.real, z.imag))
    reals = sorted((z.real for z in poles if abs(z.imag) <= 1e-9 * (1 + abs(z))), reverse=True)
    result: list[float] = []
    for z in upper:
        result += [-2 * z.real, abs(z) ** 2]
    for k in range(len(reals) // 2):
        result += [-(reals[2 * k] + reals[2 * k + 1]), reals[2 * k] * reals[2 * k + 1]]
    if len(reals) % 2:
        result.append(-reals[-1])
    return np.array(result)


def _unit_of_time(A: Array, regions: Sequence[SpectralRegion]) -> float:
    """A rate near the largest one in play (1/s)."""
    sizes = [abs(float(x)) for region in regions for x in region.real_ends if x is not None]
    return max([1e-300, float(np.max(np.abs(np.linalg.eigvals(A)), initial=0.0)), *sizes])
