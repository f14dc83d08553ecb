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
    return flint.fmpq_mat([[fmpq(exact(x)) for x in row] for row in rows])


def fmpq(x: Fraction) -> Any:
    return flint.fmpq(x.numerator, x.denominator)


def diagonal(values: Any) -> Any:
    values = list(values)
    return flint.fmpq_mat(
        [[x if i == j else flint.fmpq(0) for j in range(len(values))] for i, x in enumerate(values)]
    )


def positive(M: Any, *, strict: bool = True) -> bool:
    """A symmetric matrix is definite (semidefinite) iff the signs in its characteristic polynomial
    alternate."""
    if M.transpose() != M:
        return False
    signs = [(-1) ** (M.nrows() - k) * c for k, c in enumerate(M.charpoly().coeffs())]
    return all(c > 0 if strict else c >= 0 for c in signs)


def top(M: Any) -> Any:
    """The largest eigenvalue of a symmetric rational matrix, by mpmath."""
    rows = [[mp(exact(str(x))) for x in row] for row in M.tolist()]
    if rows:
        return max(mpmath.eigsy(mpmath.matrix(rows), eigvals_only=True))
    return mpmath.mpf(0)


class Curve:
    """One coupling in y alone, and its quotient h(y)/y."""

    def __init__(self, text: str) -> None:
        y = sp.Symbol("y", real=True)
        h = sp.sympify(text, locals=names({"y": y, "y1": y}), rational=True)
        fast = sp.lambdify(y, h, "numpy")
        slow = sp.lambdify(y, h, "mpmath", printer=PRINTER)
        self.true = lambda x: mpmath.mpf(slow(mp(x)))
        self.fast = lambda x: np.asarray(fast(x) + 0 * x, dtype=float)
        self._turns: dict[tuple[float, bool], Any] = {}

    def turns(self, reach: float, *, quotient: bool = False) -> Any:
        """Where h (or h(y)/y) has local extremes on [-reach, reach], as floats."""
        key = (reach, quotient)
        if key not in self._turns:
            half = np.union1d(
                np.linspace(0, reach, GRID), reach * np.geomspace(1e-5, 1, GRID // 4)
            )[1:]
            grid = np.concatenate([-half[::-1], half])
            self._turns[key] = _extremes(
                (lambda x: self.fast(x) / x) if quotient else self.fast, grid
            )
        return self._turns[key]

    def highest(self, lo: Any, hi: Any, face: int, turns: Any) -> Any:
        """sup of face h(face y) over lo <= y <= hi, for arrays lo and hi; infinite where h is
        undefined."""
        inner = np.clip((face * turns)[:, None], lo[None], hi[None])
        values = face * self.fast(face * np.concatenate([lo[None], hi[None], inner]))
        return np.where(np.isfinite(values), values, np.inf).max(axis=0)

    def truly_highest(self, lo: Any, hi: Any, face: int, turns: Any) -> Any:
        """The same for one interval in mpmath numbers."""
        inner = []
        for t in turns:
            inner.append(min(max(mpmath.mpf(face * float(t)), lo), hi))
        return max(face * self.true(face * y) for y in (lo, hi, *inner))

    def gains_within(self, lo: Fraction, hi: Fraction, radius: Fraction) -> bool:
        """Whether h(y)/y lies in [lo, hi] at every sample of 0 < |y| <= radius; kinks and extremes
        are among them."""
        reach = float(radius)
        spots = np.concatenate(
            [self.turns(reach, quotient=True), self.turns(reach), [-1e-12 * reach, 1e-12 * reach]]
        )
        grid = reach * np.linspace(-1, 1, 41)
        edge = mp(radius)
        slack = mp(FINE) * (1 + max(abs(mp(lo)), abs(mp(hi))))
        points = [
            *(mpmath.mpf(float(y)) for y in (*spots, *grid) if 0 < abs(y) < reach),
            edge,
            -edge,
        ]
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
    slopes = [[sp.lambdify(y, sp.diff(part, each), "numpy") for each in y] for part in parts]
    return (
        lambda x: np.array([value(*x) + 0 * x[0] for value in values]),
        lambda x: np.array([[slope(*x) + 0 * x[0] for slope in row] for row in slopes]),
    )


@cache
def is_linear(text: str) -> bool:
    """Whether SymPy's second derivatives vanish; a kink is never linear."""
    variables = {name: sp.Symbol(name, real=True) for name in ("y", "y1", "y2", "y3")}
    h = sp.sympify(text, locals=names(variables), rational=True)
    return not h.has(sp.Abs, sp.Min, sp.Max) and all(
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
        places = np.concatenate([order[: MANY // 2], order[-MANY // 2 :]])
    lo = grid[places - 1].copy()
    hi = grid[places + 1].copy()
    sign = np.where(values[places] >= values[places - 1], 1.0, -1.0)
    for _ in range(90):
        a = lo + (hi - lo) / 3
        b = hi - (hi - lo) / 3
        up = sign * h(a) < sign * h(b)
        lo = np.where(up, a, lo)
        hi = np.where(up, hi, b)
    return (lo + hi) / 2
