"""The answer to "is M definite?", and the one place where a witness is multiplied out.

A path that looks for a witness (an elimination, an eigenvector, a search direction) is not believed:
``refuted`` rounds its direction to readable integers, evaluates v'Mv exactly, and keeps what refutes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Final, TypeAlias

from dobc_design._show.cards import Shown
from dobc_design.errors import CertificateError
from dobc_design.exact.integers import IntegerSymmetric
from dobc_design.exact.matrix import Vector
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.verdict import Verdict

Symmetric: TypeAlias = SparseSymmetric | IntegerSymmetric

# Roundings tried, in bits of the largest entry, to make a witness readable and sparse.
_WITNESS_BITS: Final = (1, 2, 4, 8, 16, 32, 64)


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Definiteness(Shown):
    """A decision with its proof method, a short sentence that names the path by size and structure.

    Refuted: an integer ``witness`` v and the ``value`` v'Mv, <= 0 against "positive definite" and < 0
    against "positive semidefinite". Proved by a vector: the positive integers v, with M v > 0 (>= 0 for
    "semidefinite"); where M has positive entries beside the diagonal, with those taken as negative.
    """

    verdict: Verdict
    method: str
    witness: Vector | None = None
    value: Fraction | None = None
    vector: tuple[int, ...] | None = None


def proved(method: str, *, vector: tuple[int, ...] | None = None) -> Definiteness:
    """Return the decision PROVED."""
    return Definiteness(verdict=Verdict.PROVED, method=method, vector=vector)


def undecided(method: str) -> Definiteness:
    """Return the decision UNDECIDED; ``method`` says which path gave up."""
    return Definiteness(verdict=Verdict.UNDECIDED, method=method)


def refuted(M: Symmetric, direction: Mapping[int, Fraction], *, strict: bool, method: str) -> Definiteness:
    """Return the decision REFUTED by an integer multiple or rounding of an exact direction, by its entries.

    Raises: CertificateError if it does not refute, which would be a mistake in the path that gave it.
    """
    common = math.lcm(*(x.denominator for x in direction.values()))
    exact = [0] * M.size
    for i, x in direction.items():
        exact[i] = x.numerator * (common // x.denominator)
    decision = first_refuting(M, (*roundings(exact), exact), strict=strict, method=method)
    if decision is None:
        raise CertificateError("the elimination gave a witness that does not refute; nothing is claimed.")
    return decision


def first_refuting(
    M: Symmetric, candidates: Iterable[Sequence[int]], *, strict: bool, method: str
) -> Definiteness | None:
    """Return the decision REFUTED by the first candidate, a vector of integers, that refutes; else None."""
    for candidate in candidates:
        if not any(candidate):
            continue
        witness = _primitive(candidate)
        value = M.quadratic_form(witness)
        if value < 0 or (strict and value == 0):
            return Definiteness(verdict=Verdict.REFUTED, method=method, witness=witness, value=value)
    return None


def roundings(vector: Sequence[int]) -> Iterator[list[int]]:
    """Yield shorter and shorter roundings of integers, the coarsest first; small entries become 0."""
    largest = max((abs(x) for x in vector), default=0)
    for bits in _WITNESS_BITS:
        if largest.bit_length() > bits:
            yield [(2 * x * 2**bits + largest) // (2 * largest) for x in vector]


def _primitive(vector: Sequence[int]) -> Vector:
    """Divide by the common factor and make the first entry that is not 0 positive."""
    factor = math.gcd(*vector) or 1
    if next((x for x in vector if x), 1) < 0:
        factor = -factor
    return tuple(Fraction(x // factor) for x in vector)
