"""What a region of the spectrum means for the characteristic polynomial, and what it costs in gain.

``images`` maps a region onto the left half plane. ``gain_rows`` are necessary conditions: a real polynomial whose roots
have no positive real part has no coefficient of the wrong sign, and for one output the coefficients are affine in W.
So g'W + a >= 0 for every row, whatever W puts the spectrum into the regions; with multipliers >= 0 this
bounds |W| from below (Farkas). For several outputs the coefficient of the trace is affine, and gives its row.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

from dobc_design.exact.matrix import Matrix, Vector, multiply, subtract, zeros
from dobc_design.exact.observability import observable_reduction
from dobc_design.exact.polynomial import (
    Coefficients,
    characteristic_polynomial,
    cone_image,
    disk_image,
    reflected,
    shifted,
)
from dobc_design.problem.exosystems import Exosystem
from dobc_design.synthesis.observer.spectral_regions import Cone, Disk, SpectralRegion


@dataclass(frozen=True, slots=True, kw_only=True)
class GainRow:
    """gradient . W + constant >= 0 for every W that meets the request; W is read row by row."""

    gradient: Vector
    constant: Fraction


def images(region: SpectralRegion, polynomial: Coefficients) -> tuple[Coefficients, ...]:
    """Polynomials that have no root with positive real part iff the roots of a monic one lie in the closed region."""
    if isinstance(region, Disk):
        return (disk_image(polynomial, centre=region.centre, radius=region.radius),)
    if isinstance(region, Cone):
        return (cone_image(polynomial, damping=region.damping),)
    if region.left_of is not None:
        return (shifted(polynomial, region.left_of),)
    return (reflected(shifted(polynomial, region.right_of or Fraction(0))),)


def gain_rows(exosystem: Exosystem, regions: Sequence[SpectralRegion]) -> tuple[GainRow, ...]:
    """Rows that every W (q, m) with the spectrum of A - W C in the closed regions satisfies, exactly.

    Only the observable part counts, because W does not move the rest.
    """
    A, C, T = observable_reduction(exosystem.A, exosystem.C)
    if not A:
        return ()
    q, m = exosystem.order, exosystem.outputs
    zero = zeros(q, m)

    def polynomial(W: Matrix) -> Coefficients:
        return characteristic_polynomial(subtract(A, multiply(multiply(T, W), C)))

    start = polynomial(zero)
    units = [polynomial(_unit(q, m, i, j)) for i in range(q) for j in range(m)]
    rows: list[GainRow] = []
    for region in regions:
        if m > 1 and isinstance(region, Disk):
            continue
        values = _coefficients(region, start)
        moved = [_coefficients(region, each) for each in units]
        for k in range(len(values)) if m == 1 else (1,):
            gradient = tuple(each[k] - values[k] for each in moved)
            if any(gradient):
                rows.append(GainRow(gradient=gradient, constant=values[k]))
    return tuple(rows)


def _coefficients(region: SpectralRegion, polynomial: Coefficients) -> Coefficients:
    """Affine in the polynomial: of a cone only that it lies in the left half plane."""
    return polynomial if isinstance(region, Cone) else images(region, polynomial)[0]


def _unit(q: int, m: int, i: int, j: int) -> Matrix:
    return tuple(tuple(Fraction(int((r, c) == (i, j))) for c in range(m)) for r in range(q))
