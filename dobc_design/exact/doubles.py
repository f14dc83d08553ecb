"""A long vector of rationals that are doubles, kept in an array: no Python object stands behind an entry."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from typing import overload

import numpy as np
from numpy.typing import NDArray


class Doubles(Sequence[Fraction]):
    """Finite doubles (n,), read as the exact binary fractions that they are.  Never changed."""

    __slots__ = ("array",)

    def __init__(self, array: NDArray[np.float64]) -> None:
        """Raises: ValueError unless the array has one dimension and finite entries."""
        if array.ndim != 1 or not np.all(np.isfinite(array)):
            raise ValueError("a vector of doubles must have one dimension and finite entries.")
        self.array = np.array(array, dtype=np.float64)
        self.array.setflags(write=False)

    def __len__(self) -> int:
        return len(self.array)

    @overload
    def __getitem__(self, place: int) -> Fraction: ...

    @overload
    def __getitem__(self, place: slice) -> tuple[Fraction, ...]: ...

    def __getitem__(self, place: int | slice) -> Fraction | tuple[Fraction, ...]:
        if isinstance(place, slice):
            return tuple(Fraction(x) for x in self.array[place].tolist())
        return Fraction(float(self.array[place]))

    def __iter__(self) -> Iterator[Fraction]:
        return map(Fraction, self.array.tolist())

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Doubles) and np.array_equal(self.array, other.array)

    def __hash__(self) -> int:
        return hash(self.array.tobytes())

    def __repr__(self) -> str:
        return f"Doubles({len(self)} entries)"


def least(v: Sequence[Fraction]) -> Fraction:
    """Return the least of some numbers, at least one."""
    return Fraction(float(v.array.min())) if isinstance(v, Doubles) else min(v)
