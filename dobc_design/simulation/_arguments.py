"""Arguments of simulations: numbers that were given, or a message that says what they must be."""

import math
from functools import partial
from typing import Any

import numpy as np

from dobc_design.errors import misshapen, wrong
from dobc_design.exact.matrix import Array

NumberRows = tuple[tuple[float, ...], ...]


def positive(value: Any, name: str, *, what: str = "a number > 0", example: str = "0.5") -> float:
    """Return ``value`` as a finite float > 0.  Raises: SpecError."""
    number = _float(value)
    if not (math.isfinite(number) and number > 0):
        message = f"must be {what}, within the range of floats; got {str(value)[:40]}."
        raise wrong(name, message, f"For example {example}.")
    return number


seconds = partial(positive, what="a time > 0 in s")


def not_negative(value: Any, name: str) -> float:
    """Return a finite float >= 0.  Raises: SpecError."""
    number = _float(value)
    if not (math.isfinite(number) and number >= 0):
        raise wrong(name, f"must be a number >= 0; got {str(value)[:40]}.", "For example 0.1.")
    return number


def whole(value: Any, name: str, *, least: int) -> int:
    """Return a whole number >= ``least``.  Raises: SpecError."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < least:
        message = f"must be a whole number >= {least}; got {str(value)[:40]}."
        raise wrong(name, message, f"For example {max(least, 10)}.")
    return int(value)


def finite_array(value: Any, name: str, *, shape: tuple[int, ...], because: str) -> Array:
    """Return ``value`` as a new finite float array of this shape.  Raises: ShapeError, SpecError
    naming the entry."""
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        message = f"must be an array of numbers; got {str(value)[:40]}."
        raise wrong(name, message, f"Give shape {shape}.") from None
    if array.shape != shape:
        message = f"must have shape {shape}, {because}; got shape {array.shape}."
        raise misshapen(name, message, f"Give {because}.")
    for place in np.argwhere(~np.isfinite(array)).tolist():
        names = ("row", "column") if len(place) > 1 else ("entry",)
        where = ", ".join(f"{what} {i + 1}" for what, i in zip(names, place, strict=False))
        raise wrong(
            name, f"must be finite; {where} is {array[tuple(place)]}.", "Correct that entry."
        )
    return array


def _float(value: Any) -> float:
    """Not a number for what is none, infinite beyond the range of floats."""
    try:
        return math.nan if isinstance(value, bool) else float(value)
    except OverflowError:
        return math.inf
    except (TypeError, ValueError):
        return math.nan
