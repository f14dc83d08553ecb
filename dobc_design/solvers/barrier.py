"""Analytic centres and linear objectives over matrix inequalities in one symmetric unknown Y and
some scalars.

Every block is F(Y, x) = F0 - L Y R' - R Y L' + sum x_k U_k signs_k U_k' + sum x_k M_k > 0.
Newton's method on -log det uses the structure of Y: fractions of a second for a Lur'e inequality
that takes a general solver minutes.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from dobc_design._checks import noun, put
from dobc_design.exact.matrix import Array
from dobc_design.exact.work import spend

Indices = NDArray[np.intp]

CENTRED: Final = 0.1  # Newton decrement at which a point counts as the centre
MOST_STEPS: Final = 60
STEP: Final = 20  # steps of work for one of Newton's
BLOCK: Final = 5  # more for each block
CUBES: Final = 20_000  # and cubed rows for one more
# Added to the scaled Hessian, in turn, where rounding leaves it indefinite near the boundary.
_RIDGES: Final = (1e-14, 1e-11, 1e-8)


@noun(eq=False)
class Basis:
    """Which symmetric Y (n, n) are allowed: entries (rows, columns) above."""

    n: int
    rows: Indices
    columns: Indices
    weights: Array = field(init=False, repr=False)  # each entry beside the diagonal counts twice

    def __post_init__(self) -> None:
        put(self, weights=np.where(self.rows == self.columns, 0.5, 1.0))

    @property
    def size(self) -> int:
        return len(self.rows)

    def matrix(self, y: Array) -> Array:
        Y = np.zeros((self.n, self.n))
        Y[self.rows, self.columns] = y
        Y[self.columns, self.rows] = y
        return Y

    def unknowns(self, Y: Array) -> Array:
        """The numbers that ``matrix`` makes Y of."""
        return np.asarray(Y[self.rows, self.columns])

    def traces(self, M: Array) -> Array:
        """tr(E M) for every unit matrix E of the basis, M any (n, n)."""
        i, j = self.rows, self.columns
        both = M[i, j] + M[j, i]
        return both * self.weights

    def products(self, M: Array, N: Array) -> Array:
        """p_i q_j + p_j q_i of every unit matrix (i, j) and column p of M, q of N: p'E q, (size,
        columns)."""
        i = self.rows
        j = self.columns
        both = M[i] * N[j] + M[j] * N[i]
        return both * self.weights[:, None]

    def quadratic(self, *pairs: tuple[Array, Array]) -> Array:
        """The sum of tr(M E N E') over the pairs (M, N), for all pairs of unit matrices E, E',
        (size, size)."""
        i = self.rows
        j = self.columns
        total = np.zeros((len(i), len(i)))
        for M, N in pairs:
            # E and E' have two entries each: four products of entries of M and of N.
            for first, second in ((i, j), (j, i)):
                rows_of_M = M.T.take(first, 0)
                rows_of_N = N.take(second, 0)
                for left, right in ((j, i), (i, j)):
                    product = rows_of_M.take(left, 1)
                    product *= rows_of_N.take(right, 1)
                    total += product
        total *= self.weights[:, None]
        total *= self.weights
        return total


def make_basis(n: int, shape: str) -> Basis:
    """The basis of a shape: "diagonal" or "full"."""
    if shape == "full":
        rows, columns = np.triu_indices(n)
        return Basis(n=n, rows=rows, columns=columns)
    places = np.arange(n)
    return Basis(n=n, rows=places, columns=places)


@noun(eq=False)
class Block:
    """One matrix inequality F > 0 of N rows; see above.  ``plain``: a multiple of Y that is added
    (then N = n, and Y occurs in no other way). ``sides``: L and R (N, n), or None where Y does not
    occur.  ``columns`` (N, k), ``signs`` (k,), ``scalars`` (k,): which scalar multiplies which
    column; ``dense``: scalar -> M_k (N, N)."""

    constant: Array
    plain: float = 0.0
    sides: tuple[Array, Array] | None = None
    columns: tuple[Array, Array, Indices] | None = None  # with their signs and scalars
    dense: Mapping[int, Array] = field(default_factory=dict)

    def value(self, Y: Array, x: Array) -> Array:
        """F(Y, x), (N, N)."""
        F = self.constant + self.plain * Y if self.plain else self.constant.copy()
        if self.sides is not None:
            product = self.sides[0] @ Y @ self.sides[1].T
            F -= product + product.T
        if self.columns is not None:
            U, signs, scalars = self.columns
            F += (U * (signs * x[scalars])) @ U.T
        for k, M in self.dense.items():
            F += x[k] * M
        return F


@noun(eq=False)
class Inequalities:
    """Blocks, and bounds ``limits`` (bounds,) - ``forms`` (bounds, basis.size) y > 0 on Y;
    ``count`` of scalars, of which those at the places ``positive`` are > 0."""

    basis: Basis
    blocks: tuple[Block, ...]
    count: int
    positive: Indices = field(default_factory=lambda: np.zeros(0, np.intp))
    forms: Array | None = None
    limits: Array = field(default_factory=lambda: np.zeros(0))

    def split(self, point: Array) -> tuple[Array, Array]:
        """Y and the scalars of a point."""
        size = self.basis.size
        return self.basis.matrix(point[:size]), point[size:]

    def join(self, Y: Array, scalars: Sequence[float] | Array) -> Array:
        """The point of Y and the scalars."""
        unknowns = self.basis.unknowns(Y)
        return np.concatenate([unknowns, np.asarray(scalars, dtype=float)])

    def barrier(self, point: Array) -> float:
        """-log det of all blocks and bounds; inf outside."""
        Y, x = self.split(point)
        room = self._room(point)
        if not np.all(room > 0):
            return math.inf
        total = -float(np.sum(np.log(room)))
        for block in self.blocks:
            F = block.value(Y, x)
            if not np.all(np.isfinite(F)):
                return math.inf
            try:
                factor = np.linalg.cholesky((F + F.T) / 2)
            except np.linalg.LinAlgError:
                return math.inf
            total -= 2 * float(np.sum(np.log(np.diag(factor))))
        return total

    def _room(self, point: Array) -> Array:
        """What has to be > 0: the positive scalars, then what the bounds leave."""
        size = self.basis.size
        positive = point[size:][self.positive]
        if self.forms is None:
            return positive
        return np.concatenate([positive, self.limits - self.forms @ point[:size]])

    def holds(self, point: Array) -> bool:
        """Whether the point lies inside."""
        return math.isfinite(self.barrier(point))

    def derivatives(self, point: Array) -> tuple[Array, Array]:
        """Gradient and Hessian of the barrier at a point inside."""
        size = self.basis.size
        length = size + self.count
        gradient = np.zeros(length)
        hessian = np.zeros((length, length))
        Y, x = self.split(point)
        room = self._room(point)
        places = size + self.positive
        positive = room[: len(places)]
        gradient[places] -= 1 / positive
        hessian[places, places] += 1 / positive**2
        if self.forms is not None:
            scaled = self.forms / room[len(places) :, None]
            gradient[:size] += np.sum(scaled, axis=0)
            hessian[:size, :size] += scaled.T @ scaled
        for block in self.blocks:
            inverse = np.linalg.inv(block.value(Y, x))
            G = np.asarray(inverse, dtype=np.float64)
            _add_block(block, self.basis, G, gradient, hessian)
        return gradient, hessian


def centre(
    problem: Inequalities,
    point: Array,
    *,
    cost: Array | None = None,
    stop: Callable[[Array], bool] | None = None,
) -> Array:
    """Minimise cost'x + barrier by Newton steps, halved as needed, from inside or until ``stop``:
    the best point."""
    if cost is None:
        cost = np.zeros(len(point))
    value = float(cost @ point) + problem.barrier(point)
    # A step costs the third power of the unknowns and of the rows of every block.
    cubes = len(point) ** 3 + sum(len(block.constant) ** 3 for block in problem.blocks)
    work = STEP + BLOCK * len(problem.blocks) + cubes // CUBES
    for _ in range(MOST_STEPS):
        if stop is not None and stop(point):
            break
        spend(work)
        gradient, hessian = problem.derivatives(point)
        step = _solve(hessian, gradient + cost)
        if step is None:
            break
        decrement = float((gradient + cost) @ step)
        if not decrement > CENTRED**2:
            break
        for halvings in range(24):  # until the value falls
            trial = 0.5**halvings
            candidate = point - trial * step
            after = float(cost @ candidate) + problem.barrier(candidate)
            if after < value - 1e-3 * trial * decrement:
                break
        else:
            break
        point = candidate
        value = after
    return point


def minimise(
    problem: Inequalities,
    point: Array,
    cost: Array,
    *,
    accuracy: float = 1e-4,
    stop: Callable[[Array], bool] | None = None,
    hopeless: float = math.inf,
) -> Array:
    """Follow the central path of cost'x from inside until the gap is ``accuracy`` |cost'x|, or
    ``stop`` holds, or it cannot come below ``hopeless``.  A point inside."""
    order = len(problem.positive) + len(problem.limits)
    order += sum(len(block.constant) for block in problem.blocks)
    gradient, _ = problem.derivatives(point)
    size = float(cost @ cost)
    weight = 1.0
    if size:  # where the first centre is about the point itself
        weight = max(1e-3, min(1e6, abs(float(gradient @ cost)) / size))
    for _ in range(40):
        point = centre(problem, point, cost=weight * cost, stop=stop)
        if stop is not None and stop(point):
            break
        value = float(cost @ point)
        gap = order / weight  # the optimum is at least value - gap
        if gap <= accuracy * max(1e-9, abs(value)) or value - gap > hopeless:
            break
        weight *= 8
    return point


def _solve(hessian: Array, gradient: Array) -> Array | None:
    """The Newton step, scaled to a unit diagonal."""
    root = np.sqrt(np.maximum(np.diag(hessian), 1e-300))
    # next to an edge; what is infinite has no factor or gives no finite step
    with np.errstate(over="ignore"):
        scaled = hessian / root[:, None] / root
    for ridge in _RIDGES:
        scaled[np.diag_indices_from(scaled)] += ridge
        try:
            factor: Any = linalg.cho_factor(scaled, lower=True, check_finite=False)
        except (linalg.LinAlgError, ValueError):
            continue
        solved = linalg.cho_solve(factor, gradient / root, check_finite=False)
        step = np.asarray(solved / root)
        return step if bool(np.all(np.isfinite(step))) else None
    return None


def _add_block(block: Block, basis: Basis, G: Array, gradient: Array, hessian: Array) -> None:
    """Add what -log det F gives, G = F^-1."""
    size = basis.size
    if block.plain:
        gradient[:size] -= block.plain * basis.traces(G)
        hessian[:size, :size] += block.plain**2 * basis.quadratic((G, G))
    if block.sides is not None:
        L, R = block.sides
        GL = G @ L
        GR = G @ R
        b = R.T @ GL
        pairs = (b, b), (L.T @ GL, R.T @ GR)
        gradient[:size] += 2 * basis.traces(b)
        hessian[:size, :size] += 2 * basis.quadratic(*pairs)
    if block.columns is not None:
        _add_columns(block, block.columns, basis, G, gradient, hessian)
    for k, M in block.dense.items():
        row = size + k
        GMG = G @ M @ G
        gradient[row] -= float(np.sum(G * M))
        for other, N in block.dense.items():
            hessian[row, size + other] += float(np.sum(GMG * N))
        if block.sides is None and not block.plain:
            continue
        if block.sides is None:
            cross = basis.traces(block.plain * GMG)
        else:
            L, R = block.sides
            cross = basis.traces(-2 * (R.T @ GMG @ L))
        hessian[:size, row] += cross
        hessian[row, :size] += cross


def _add_columns(
    block: Block,
    columns: tuple[Array, Array, Indices],
    basis: Basis,
    G: Array,
    gradient: Array,
    hessian: Array,
) -> None:
    """The scalars that multiply columns: gradient, Hessian among themselves, with Y and with dense
    scalars."""
    U, signs, scalars = columns
    size = basis.size
    GU = G @ U
    table = U.T @ GU
    rows = size + scalars
    add = _each_once if len(set(scalars.tolist())) == len(scalars) else np.add.at
    add(gradient, rows, -signs * np.diag(table))
    squares = table**2 * signs[:, None] * signs
    add(hessian, np.ix_(rows, rows), squares)
    if block.sides is not None:
        L, R = block.sides
        cross = -2 * basis.products(L.T @ GU, R.T @ GU) * signs
        summed = np.zeros((size, hessian.shape[0]))
        add(summed.T, rows, cross.T)
        hessian[:size] += summed
        hessian[:, :size] += summed.T
    for k, M in block.dense.items():
        cross_k = np.sum(GU * (M @ GU), axis=0) * signs
        add(hessian[size + k], rows, cross_k)
        add(hessian[:, size + k], rows, cross_k)


def _each_once(total: Array, places: Any, values: Array) -> None:
    """What ``np.add.at`` does, in less time: where several columns belong to one scalar, += would
    take the last of them."""
    total[places] += values
