"""Arguments of simulations: numbers that were given, or a message that says what they must be."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dobc_design.errors import ShapeError, SpecError

Array = NDArray[np.float64]


def positive(value: Any, name: str, *, what: str = "a number > 0", example: str = "0.5") -> float:
    """Return ``value`` as a finite float > 0.  Raises: SpecError."""
    number = _float(value)
    if not (math.isfinite(number) and number > 0):
        raise SpecError(
            f"{name} must be {what}, within the range of floats; got {str(value)[:40]}.",
            key=name,
            cure=f"For example {example}.",
        )
    return number


def seconds(value: Any, name: str, *, example: str = "0.5") -> float:
    """Return a time > 0 in s.  Raises: SpecError."""
    return positive(value, name, what="a time > 0 in s", example=example)


def not_negative(value: Any, name: str) -> float:
    """Return a finite float >= 0.  Raises: SpecError."""
    number = _float(value)
    if not (math.isfinite(number) and number >= 0):
        raise SpecError(f"{name} must be a number >= 0; got {str(value)[:40]}.", key=name, cure="For example 0.1.")
    return number


def whole(value: Any, name: str, *, least: int) -> int:
    """Return a whole number >= ``least``.  Raises: SpecError."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < least:
        raise SpecError(
            f"{name} must be a whole number >= {least}; got {str(value)[:40]}.",
            key=name,
            cure=f"For example {max(least, 10)}.",
        )
    return int(value)


def finite_array(value: Any, name: str, *, shape: tuple[int, ...], because: str) -> Array:
    """Return ``value`` as a new float array of this shape, all entries finite.

    Raises: ShapeError for another shape, SpecError for what is no number or not finite, naming the entry.
    """
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise SpecError(
            f"{name} must be an array of numbers; got {str(value)[:40]}.", key=name, cure=f"Give shape {shape}."
        ) from None
    if array.shape != shape:
        raise ShapeError(
            f"{name} must have shape {shape}, {because}; got shape {array.shape}.", key=name, cure=f"Give {because}."
        )
    wrong = np.argwhere(~np.isfinite(array))
    if len(wrong):
        place = tuple(int(i) for i in wrong[0])
        names = ("row", "column") if len(place) > 1 else ("entry",)
        where = ", ".join(f"{what} {i + 1}" for what, i in zip(names, place, strict=False))
        raise SpecError(f"{name} must be finite; {where} is {array[place]}.", key=name, cure="Correct that entry.")
    return array


def _float(value: Any) -> float:
    if isinstance(value, bool):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.inf
    except (TypeError, ValueError):
        return math.nan
