"""The exact values of the check ``lure`` in a certificate, written and read back.

docs/certificate-format.md, "Regions", fixes the form.  Nothing is decided here.
"""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import Any, Final

from dobc_design.conditions.numbers import MATRIX_BITS, VECTOR_BITS, has_short_denominator, is_short, read_rational
from dobc_design.conditions.quadratic.claim import METHODS, Lure, Method
from dobc_design.conditions.quadratic.sectors import GainRange
from dobc_design.conditions.separable.checks import read_object
from dobc_design.exact.interval import Interval
from dobc_design.exact.matrix import Matrix, is_symmetric, multiply
from dobc_design.exact.number import number_text
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.problem.canonical import matrix_text
from dobc_design.problem.problem import Problem

_LURE: Final = ("method", "P_e", "level", "radius", "ranges", "multipliers", "rate")


def lure_to_json(lure: Lure) -> dict[str, Any]:
    """The exact values of a proved lure check."""
    values: dict[str, Any] = {
        "method": lure.method,
        "P_e": [[i, j, number_text(value)] for (i, j), value in sorted(lure.P_e.entries.items())],
        "level": None if lure.level is None else number_text(lure.level),
        "radius": None if lure.radius is None else number_text(lure.radius),
        "ranges": [
            {
                "coupling": each.coupling,
                "gains": [[[number_text(gain.lo), number_text(gain.hi)] for gain in row] for row in each.entries],
            }
            for each in lure.ranges
        ],
        "multipliers": {mode: [number_text(tau) for tau in taus] for mode, taus in lure.multipliers.items()},
        "rate": number_text(lure.rate),
    }
    return values if lure.P is None else values | {"P": matrix_text(lure.P)}


def lure_from_json(values: Mapping[str, Any], problem: Problem, W: Matrix | None) -> Lure:
    """Read them back for this problem and the gain W (q, m).

    Raises: KeyError, TypeError, ValueError, ShapeError or SpecError for anything that cannot be such a claim.
    """
    radius, level = (_number_or_none(values[name]) for name in ("radius", "level"))
    if (radius is None) is not (level is None):
        raise ValueError("radius and level must both be null, or neither")
    if radius is not None and radius <= 0:
        raise ValueError("radius must be > 0")
    P = _pair_matrix(values["P"], problem) if problem.groups else None
    return Lure(
        method=_method(values["method"]),
        P_e=_sparse(values["P_e"], problem.n * problem.m),
        level=level,
        radius=radius,
        ranges=_ranges(values["ranges"], problem, radius),
        multipliers=_multipliers(values, problem),
        rate=read_rational(values["rate"]),
        P=P,
        Q=None if P is None or W is None else multiply(P, W),
    )


def names_of(problem: Problem) -> tuple[str, ...]:
    """The keys of ``exact``."""
    return (*_LURE, "P") if problem.groups else _LURE


def _number_or_none(text: object) -> Fraction | None:
    return None if text is None else read_rational(text)


def _method(name: object) -> Method:
    for method in METHODS:
        if name == method:
            return method
    raise ValueError(f"method must be one of {', '.join(METHODS)}")


def _sparse(rows: object, size: int) -> SparseSymmetric:
    """The nonzero entries [a, b, value], a <= b, each once."""
    if not isinstance(rows, list):
        raise TypeError("P_e must be a list")
    entries: dict[tuple[int, int], Fraction] = {}
    for row in rows:
        i, j, text = row
        if type(i) is not int or type(j) is not int or (i, j) in entries:
            raise ValueError("P_e must list each entry once, with two whole numbers")
        entries[i, j] = read_rational(text)
    if not all(entries.values()) or not has_short_denominator(entries.values(), MATRIX_BITS):
        raise ValueError("an entry of P_e is 0, or they need too long a common denominator")
    return SparseSymmetric(size, entries)


def _ranges(data: object, problem: Problem, radius: Fraction | None) -> tuple[GainRange, ...]:
    if not isinstance(data, list):
        raise TypeError("ranges must be a list")
    found = []
    for each in data:
        values = read_object(each, ("coupling", "gains"))
        if type(values["coupling"]) is not int:
            raise TypeError("coupling must be a whole number")
        entries = tuple(
            tuple(Interval(read_rational(lo), read_rational(hi)) for lo, hi in row) for row in values["gains"]
        )
        found.append(GainRange(coupling=values["coupling"], radius=radius, entries=entries))
    arcs = (arc for mode in problem.network.modes.values() for arc in mode)
    used = {problem.coupling_place(i, j) for i, j, _ in arcs}
    if len(found) != len(used) or {each.coupling for each in found} != used:
        raise ValueError("ranges must name every coupling that an arc has, once")
    return tuple(found)


def _multipliers(values: Mapping[str, Any], problem: Problem) -> dict[str, tuple[Fraction, ...]]:
    names = tuple(problem.network.modes) if values["method"] == "lure" else ()
    taus = read_object(values["multipliers"], names)
    found = {mode: tuple(map(read_rational, taus[mode])) for mode in names}
    if not all(has_short_denominator(each, VECTOR_BITS) for each in found.values()):
        raise ValueError("multipliers need too long a common denominator")
    return found


def _pair_matrix(rows: Any, problem: Problem) -> Matrix:
    P = tuple(tuple(read_rational(entry) for entry in row) for row in rows)
    if len(P) != problem.q or any(len(row) != problem.q for row in P) or not is_symmetric(P) or not is_short(P):
        raise ValueError(f"P must be a symmetric matrix of {problem.q} rows, with a short common denominator")
    return P
