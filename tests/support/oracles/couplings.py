"""Couplings for the oracle of regional checks: read by SymPy, evaluated by NumPy and by mpmath at
200 bits.

Suprema over intervals are taken at end points and turning points; each of these is a point of the
interval, so that what they contradict is false whatever was missed in between.
"""

from fractions import Fraction
from functools import cache
from typing import Any

import flint
import mpmath
import numpy as np
import sympy as sp
from couplings import PRINTER, names

GRID = 4001
MANY = 400
FINE = Fraction(1, 10**40)  # what 200 bits leave, relative to the terms


def exact(text: Any) -> Fraction:
    top, _, bottom = str(text).strip().partition("/")
    return Fraction(top) / Fraction(bottom or "1")


def mp(x: Any) -> Any:
    """A Fraction, a float or an mpmath number at the working precision."""
    if isinstance(x, Fraction):
        return mpmath.mpf(x.numerator) / x.denominator
    return mpmath.mpf(x)


def rational(rows: Any) -> Any:
    """A matrix of flint's rationals."""
    rows_exact = [[fmpq(exact(x)) for x in row] for row in rows]
    return flint.fmpq_mat(rows_exact)


def fmpq(x: Fraction) -> Any:
    return flint.fmpq(x.numerator, x.denominator)


def diagonal(values: Any) -> Any:
    values = list(values)
    diagonal_rows = [
        [x if i == j else flint.fmpq(0) for j in range(len(values))] for i, x in enumerate(values)
    ]
    return flint.fmpq_mat(diagonal_rows)


def positive(M: Any, *, strict: bool = True) -> bool:
    """A symmetric matrix is definite (semidefinite) iff the signs in its characteristic polynomial
    alternate."""
    if M.transpose() != M:
        return False
    coefficients = enumerate(M.charpoly().coeffs())
    signs = [(-1) ** (M.nrows() - k) * c for k, c in coefficients]
    return all(c > 0 if strict else c >= 0 for c in signs)


def top(M: Any) -> Any:
    """The largest eigenvalue of a symmetric rational matrix, by mpmath."""
    rows = []
    for row in M.tolist():
        rows.append([mp(exact(str(x))) for x in row])
    if rows:
        return max(mpmath.eigsy(mpmath.matrix(rows), eigvals_only=True))
    return mpmath.mpf(0)


class Curve:
    """One coupling in y alone, and its quotient h(y)/y."""

    def __init__(self, text: str) -> None:
        y = sp.Symbol("y", real=True)
        names_of_y = names({"y": y, "y1": y})
        h = sp.sympify(text, locals=names_of_y, rational=True)
        fast = sp.lambdify(y, h, "numpy")
        slow = sp.lambdify(y, h, "mpmath", printer=PRINTER)
        self.true = lambda x: mpmath.mpf(slow(mp(x)))
        self.fast = lambda x: np.asarray(fast(x) + 0 * x, dtype=float)
        self._turns: dict[tuple[float, bool], Any] = {}

    def turns(self, reach: float, *, quotient: bool = False) -> Any:
        """Where h (or h(y)/y) has local extremes on [-reach, reach], as floats."""
        key = (reach, quotient)
        if key not in self._turns:
            uniform = np.linspace(0, reach, GRID)
            fine = reach * np.geomspace(1e-5, 1, GRID // 4)
            both = np.union1d(uniform, fine)
            half = both[1:]
            grid = np.concatenate([-half[::-1], half])
            self._turns[key] = _extremes(
                (lambda x: self.fast(x) / x) if quotient else self.fast, grid
            )
        return self._turns[key]

    def highest(self, lo: Any, hi: Any, face: int, turns: Any) -> Any:
        """sup of face h(face y) over lo <= y <= hi, for arrays lo and hi; infinite where h is
        undefined."""
        turning = (face * turns)[:, None]
        inner = np.clip(turning, lo[None], hi[None])
        all_places = [lo[None], hi[None], inner]
        found = face * np.concatenate(all_places)
        values = face * self.fast(found)
        finite = np.where(np.isfinite(values), values, np.inf)
        return finite.max(axis=0)

    def truly_highest(self, lo: Any, hi: Any, face: int, turns: Any) -> Any:
        """The same for one interval in mpmath numbers."""
        inner = []
        for t in turns:
            lower = max(mpmath.mpf(face * float(t)), lo)
            inner.append(min(lower, hi))
        places = (lo, hi, *inner)
        return max(face * self.true(face * y) for y in places)

    def gains_within(self, lo: Fraction, hi: Fraction, radius: Fraction) -> bool:
        """Whether h(y)/y lies in [lo, hi] at every sample of 0 < |y| <= radius; kinks and extremes
        are among them."""
        reach = float(radius)
        turns = self.turns(reach, quotient=True)
        near_zero = [-1e-12 * reach, 1e-12 * reach]
        all_spots = [turns, self.turns(reach), near_zero]
        spots = np.concatenate(all_spots)
        grid = reach * np.linspace(-1, 1, 41)
        edge = mp(radius)
        size = abs(mp(lo))
        largest = max(size, abs(mp(hi)))
        slack = mp(FINE) * (1 + largest)
        candidates = (*spots, *grid)
        points = [*(mpmath.mpf(float(y)) for y in candidates if 0 < abs(y) < reach), edge, -edge]
        return all(mp(lo) - slack <= self.true(y) / y <= mp(hi) + slack for y in points)


@cache
def curve(text: str) -> Curve:
    return Curve(text)


@cache
def field_part(h: tuple[str, ...]) -> tuple[Any, Any]:
    """A list of couplings in y1..ym, and its Jacobian: functions of arrays of shape (m, ...)."""
    m = len(h)
    y = sp.symbols(f"y1:{m + 1}", real=True)
    own = names({f"y{c + 1}": symbol for c, symbol in enumerate(y)})
    parts = [sp.sympify(text, locals=own, rational=True) for text in h]
    values = [sp.lambdify(y, part, "numpy") for part in parts]
    slopes = []
    for part in parts:
        slopes.append([sp.lambdify(y, sp.diff(part, each), "numpy") for each in y])
    return (
        lambda x: np.array([value(*x) + 0 * x[0] for value in values]),
        lambda x: np.array([[slope(*x) + 0 * x[0] for slope in row] for row in slopes]),
    )


@cache
def is_linear(text: str) -> bool:
    """Whether SymPy's second derivatives vanish; a kink is never linear."""
    names_of_y = ("y", "y1", "y2", "y3")
    variables = {name: sp.Symbol(name, real=True) for name in names_of_y}
    h = sp.sympify(text, locals=names(variables), rational=True)
    no_kinks = not h.has(sp.Abs, sp.Min, sp.Max)
    return no_kinks and all(
        sp.simplify(sp.diff(h, a, b)) == 0 for a in h.free_symbols for b in h.free_symbols
    )


def _extremes(h: Any, grid: Any) -> Any:
    """The local extremes between points of a grid, by ternary search, all at once."""
    values = h(grid)
    signs = np.sign(np.diff(values))
    places = np.flatnonzero(signs[:-1] != signs[1:]) + 1  # the ends of plateaus too
    places = places[np.isfinite(values[places])]
    if len(places) > MANY:  # noise of a constant: the lowest and the highest
        order = places[np.argsort(values[places])]
        last = order[-MANY // 2 :]
        chosen = [order[: MANY // 2], last]
        places = np.concatenate(chosen)
    lo = grid[places - 1].copy()
    hi = grid[places + 1].copy()
    rising = values[places] >= values[places - 1]
    sign = np.where(rising, 1.0, -1.0)
    for _ in range(90):
        a = lo + (hi - lo) / 3
        b = hi - (hi - lo) / 3
        up = sign * h(a) < sign * h(b)
        lo = np.where(up, a, lo)
        hi = np.where(up, hi, b)
    return (lo + hi) / 2
