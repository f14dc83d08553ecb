"""Sparse matrices decided by a vector: v > 0 with M v > 0 for Z-matrices, a direction p with p'Mp
<= 0 against.

A Z-matrix (no positive entry beside the diagonal) is positive definite iff such a v exists (theory,
sections 3 and 8). For other signs the same is asked with -|m_ij| beside the diagonal: enough, not
necessary. Finding v is floating point and may fail; checking it is exact. Time per step and memory
are linear in the entries.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Final

import numpy as np

from dobc_design._checks import noun
from dobc_design.exact.matrix import Array

from .symmetric import (
    DENOMINATOR_BITS,
    IntegerSymmetric,
    Places,
    Rows,
    Symmetric,
    both_triangles,
    in_integers,
    signs_of_product,
)

Floats = Array

# Bits of the largest entry of v, tried in turn: short vectors make short certificates, and the last
# loses nothing.
_VECTOR_BITS: Final = (16, 31, 61)
# Bits kept of a direction; whoever multiplies it out rounds it further.
_DIRECTION_BITS: Final = 60
# Conjugate gradients stop here: a ring held at one node needs half as many steps as it has nodes.
_MOST_STEPS: Final = 100_000
# Entries and vectors from which on products of floats keep all their digits.
_SMALLEST: Final = 2.0**-500
# Curvature of a direction, relative to the scaled matrix, that doubles cannot tell from 0.
_FLAT: Final = 1e-15


@noun
class Found:
    """A vector that proves M definite, or directions of a kind, as integers, that may refute it."""

    vector: tuple[int, ...] | None = None
    directions: tuple[list[int], ...] = ()
    kind: str = "search direction of conjugate gradients"


def proves(M: Symmetric, vector: Sequence[int], *, strict: bool = True) -> bool:
    """Tell, exactly, whether integers v > 0 prove M > 0 (strict) or M >= 0: m_ii v_i > sum |m_ij|
    v_j, or >=."""
    if len(vector) != M.size or any(x <= 0 for x in vector):
        return False
    rows = both_triangles(_weakened(M))
    if rows is None:
        return M.size == 0
    kind = np.int64 if max(vector) < 1 << 62 else object
    v = np.array(vector, dtype=kind)
    signs = signs_of_product(_comparison(rows), v)
    return bool((signs >= int(strict)).all())


@noun(eq=False)
class FloatRows:
    """A matrix made ready for ``bound``: its diagonal ``own`` (n,), rounded up, and ``sizes`` of
    what is above it at (``rows``, ``columns``), so far up that every rounding in the sums of both
    its rows is covered."""

    own: Floats
    largest: float  # of |own|
    rows: Places
    columns: Places
    sizes: Floats

    def bound(self, vector: Floats) -> float:
        """Return an upper bound of the largest eigenvalue: the largest (m_ii v_i + sum |m_ij| v_j)
        / v_i; v > 0 (n,). It is rounded up, and inf where floats do not hold it.  Source: theory,
        section 8, for any signs."""
        if len(vector) != len(self.own) or not len(vector) or not vector.min() > _SMALLEST:
            return math.inf
        with np.errstate(over="ignore", invalid="ignore"):
            # In place, because these are the longest arrays of a large network.
            heard = vector[self.columns]
            heard *= self.sizes
            sums = np.bincount(self.rows, weights=heard, minlength=len(vector))
            total: Floats = sums.astype(np.float64, copy=False)  # without an arc they are integers
            heard = vector[self.rows]
            heard *= self.sizes
            total += np.bincount(self.columns, weights=heard, minlength=len(vector))
            total /= vector
            total += self.own
            # The last sum is off by half a unit of its terms: the diagonal, and what is at most
            # this sum without it.
            most = float(total.max())
        largest = most + (2 * self.largest + abs(most)) * 2.0**-51
        return largest if math.isfinite(largest) else math.inf


def float_rows(M: IntegerSymmetric) -> FloatRows | None:
    """Return M made ready; None where floats do not hold an entry, or products with it could lose
    digits."""
    values = _in_floats(M)
    if values is None or (len(values) and np.abs(values).min() < _SMALLEST):
        return None
    on = M.rows == M.columns
    diagonal = values[on]
    own = np.zeros(M.size)
    own[M.rows[on]] = diagonal + np.abs(diagonal) * 2.0**-50
    largest = float(np.abs(own).max(initial=0.0))
    i = M.rows[~on]
    j = M.columns[~on]
    counts = np.bincount(i, minlength=M.size) + np.bincount(j, minlength=M.size)
    # An entry is off by 3 half units, its product and the sums by one each; this factor and the
    # quotient by one more.
    roundings = np.maximum(counts[i], counts[j]) + 8
    slack = 1 + roundings.astype(np.float64) * 2.0**-52
    sizes = np.abs(values[~on]) * slack
    return FloatRows(own=own, largest=largest, rows=i, columns=j, sizes=sizes)


def row_bound(M: IntegerSymmetric, vector: Floats) -> float:
    """Return ``FloatRows.bound`` of M; inf where there is none."""
    ready = float_rows(M)
    return math.inf if ready is None else ready.bound(vector)


def _in_floats(M: IntegerSymmetric) -> Floats | None:
    """The entries, each within three half units of itself; None where one is beyond the floats."""
    try:
        if M.values.dtype != object:
            return M.values.astype(np.float64) / float(M.denominator)
        return np.array([x / M.denominator for x in M.values.tolist()], dtype=np.float64)
    except OverflowError:
        return None


def is_z_matrix(M: Symmetric) -> bool:
    """Tell whether every entry beside the diagonal is <= 0."""
    if isinstance(M, IntegerSymmetric):
        return bool((M.values[M.rows != M.columns] < 0).all())
    return all(i == j or value < 0 for (i, j), value in M.entries.items())


def search(M: Symmetric, *, strict: bool) -> Found:
    """Look for a vector that proves M > 0 (strict) or M >= 0, checked exactly, or directions that
    may refute."""
    rows = both_triangles(_weakened(M))
    if rows is None:
        return Found()
    diagonal = rows.values[rows.rows == rows.columns]
    if len(diagonal) < M.size or not (diagonal > 0).all():
        return Found()  # elimination finds the bad entry at its first glance
    compared = _comparison(rows)
    least = int(strict)
    signs = signs_of_product(compared, np.ones(M.size, dtype=np.int64))
    if (signs >= least).all():
        return Found(vector=(1,) * M.size)
    z_matrix = is_z_matrix(M)
    if z_matrix:
        group = _unheld(rows, signs, strict=strict)
        if group is not None:
            return Found(directions=(group,), kind="a group of rows whose sums are all <= 0")
    x, p = _conjugate_gradients(compared)
    if x is not None and (x > 0).all():
        for bits in _VECTOR_BITS:
            v = _rounded(x, bits)
            if (v > 0).all() and (signs_of_product(compared, v) >= least).all():
                return Found(vector=tuple(v.tolist()))
    if not z_matrix:  # p'Mp counts with the signs that the entries have
        x, p = _conjugate_gradients(rows)
    return Found(directions=tuple(_directions(x, p, z_matrix=z_matrix)))


def _weakened(M: Symmetric) -> IntegerSymmetric:
    """Return M in integers, exactly or with every entry rounded to where domination is harder."""
    exact = in_integers(M)
    if exact is not None:
        return exact
    # The diagonal keeps as many bits as a common denominator may have.
    positive = (x for (i, j), x in M.entries.items() if i == j and x > 0)
    smallest = min(positive, default=Fraction(1))
    lift = max(0, smallest.denominator.bit_length() - smallest.numerator.bit_length())
    return IntegerSymmetric.weakened(M, bits=DENOMINATOR_BITS + lift)


def _comparison(rows: Rows) -> Rows:
    """The same matrix with -|m_ij| beside the diagonal."""
    on = rows.rows == rows.columns
    values = np.where(on, rows.values, -np.abs(rows.values))
    return replace(rows, values=values)


def _unheld(rows: Rows, signs: Places, *, strict: bool) -> list[int] | None:
    """The indicator of the smallest connected group whose row sums are all <= 0 (if not strict: one
    < 0), if any."""
    labels = _components(rows)
    sizes = np.bincount(labels, minlength=len(labels))
    unheld = sizes > 0
    unheld[labels[signs > 0]] = False
    if not strict:
        unheld &= np.isin(np.arange(len(labels)), labels[signs < 0])
    groups = np.flatnonzero(unheld)
    if not len(groups):
        return None
    smallest = groups[np.argmin(sizes[groups])]
    return [int(x) for x in labels == smallest]


def _components(rows: Rows) -> Places:
    """Return for every row the number of its connected component, in the order of their first
    rows."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    size = len(rows.starts)
    entries = len(rows.columns)
    starts = np.append(rows.starts, entries)
    graph = csr_array((np.ones(entries), rows.columns, starts), shape=(size, size))
    _, labels = connected_components(graph, directed=False)
    return np.asarray(labels, dtype=np.int64)


def _directions(x: Floats | None, p: Floats | None, *, z_matrix: bool) -> list[list[int]]:
    """Return what may refute: p, the negative part of x, and x; of Z-matrices |p| and |x|, which
    are never worse."""
    found: list[Floats] = []
    if p is not None:
        found.append(np.abs(p) if z_matrix else p)
    if x is not None and z_matrix:
        found += [np.maximum(-x, 0), np.abs(x)]
    elif x is not None:
        found.append(x)
    return [_rounded(each, _DIRECTION_BITS).tolist() for each in found if each.any()]


def _rounded(x: Floats, bits: int) -> Places:
    """x, times a power of two, in integers of which the largest has so many bits."""
    _, exponent = math.frexp(float(np.abs(x).max()))
    return np.rint(np.ldexp(x, bits - exponent)).astype(np.int64)


def _conjugate_gradients(M: Rows) -> tuple[Floats | None, Floats | None]:
    """Guess x with M x = diag(M), every row met by half, or None; and a direction p if p'Mp is
    about <= 0."""
    longest = max(int(M.values.max()).bit_length(), int(M.values.min()).bit_length())
    values = (M.values >> max(0, longest - 1000)).astype(np.float64)  # which end at 2^1024
    root = np.sqrt(values[M.rows == M.columns])
    if not (root > 0).all():
        return None, None
    with np.errstate(over="ignore", invalid="ignore"):
        x, p = _iterate(M, values, root)
    return _unscaled(x, root), _unscaled(p, root)


def _unscaled(found: Floats | None, root: Floats) -> Floats | None:
    return None if found is None or not np.isfinite(found).all() else found / root


def _iterate(M: Rows, values: Floats, root: Floats) -> tuple[Floats, Floats | None]:
    """Run conjugate gradients on the matrix with unit diagonal; ``root`` is the root of M's
    diagonal."""
    scaled = values / root[M.rows] / root[M.columns]
    x = np.zeros(len(root))
    residual = root.copy()
    direction = root.copy()
    square = float(residual @ residual)
    for _ in range(min(2 * len(root) + 50, _MOST_STEPS)):
        product = np.add.reduceat(scaled * direction[M.columns], M.starts)
        curvature = float(direction @ product)
        if not curvature > _FLAT * float(direction @ direction):
            return x, direction
        step = square / curvature
        x += step * direction
        residual -= step * product
        if (np.abs(residual) <= 0.5 * root).all():
            return x, None
        previous = square
        square = float(residual @ residual)
        direction = residual + square / previous * direction
    return x, direction
