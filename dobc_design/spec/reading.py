"""Reading values that users give into exact ones: numbers, vectors, matrices.

Both the file reader and the Python constructors go through here, so that 3.2 means 16/5 in both and
an error names the same key.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from dobc_design.errors import ShapeError
from dobc_design.exact.matrix import Matrix, Vector
from dobc_design.exact.number import parse_number


class NumberText(str):
    """A number of a file, kept as the text that was typed (digit separators dropped)."""

    __slots__ = ()

    def __new__(cls, text: str) -> NumberText:
        return super().__new__(cls, text.replace("_", ""))

    def __repr__(self) -> str:
        return str(self)


def is_list(value: object) -> bool:
    """Tell whether ``value`` is a list, tuple or array (and not text)."""
    return isinstance(value, (list, tuple)) or (isinstance(value, np.ndarray) and value.ndim > 0)


def read_matrix(value: Any, *, key: str, shape: tuple[int, int] | None = None, because: str = "") -> Matrix:
    """Read a matrix given by rows, exactly.

    ``shape`` is what it must have, if known; ``because`` says why, and goes into the message.
    Raises: ShapeError for ragged, empty or wrongly shaped input; SpecError for a bad number.
    """
    rows = value.tolist() if isinstance(value, np.ndarray) else value
    if not is_list(rows) or not rows or not all(is_list(row) for row in rows):
        raise ShapeError(
            f"{key} must be a matrix, given as a list of rows; got {shown(value)}.", key=key,
            cure="Write [[1, 0], [0, 1]].",
        )  # fmt: skip
    width = len(rows[0])
    for position, row in enumerate(rows):
        if len(row) != width or width == 0:
            raise ShapeError(
                f"{key}[{position}] must have as many numbers as the first row ({width}, at least 1); got {len(row)}.",
                key=f"{key}[{position}]", cure="Make all rows equally long.",
            )  # fmt: skip
    if shape is not None and (len(rows), width) != shape:
        raise ShapeError(
            f"{key} must have shape {shape}{f', {because}' if because else ''}; got shape ({len(rows)}, {width}).",
            key=key, cure=f"Give {shape[0]} row(s) of {shape[1]} number(s).",
        )  # fmt: skip
    return tuple(
        tuple(parse_number(entry, key=f"{key}[{i}][{j}]") for j, entry in enumerate(row))
        for i, row in enumerate(rows)
    )


def read_vector(value: Any, *, key: str, length: int, because: str) -> Vector:
    """Read ``length`` numbers; a single number stands for all components."""
    if not is_list(value):
        return (parse_number(value, key=key),) * length
    if len(value) != length:
        raise ShapeError(
            f"{key} must have {length} number(s), {because}; got {len(value)}.", key=key,
            cure=f"Give {length}, or one number for all components.",
        )  # fmt: skip
    return tuple(parse_number(entry, key=f"{key}[{i}]") for i, entry in enumerate(value))


def shown(value: object) -> str:
    """Show what was given, cut to a length that fits in a sentence."""
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def scalar_matrix(value: Fraction, size: int) -> Matrix:
    """Return ``value`` times the identity."""
    return tuple(tuple(value if i == j else Fraction(0) for j in range(size)) for i in range(size))


def is_scalar_matrix(matrix: Sequence[Sequence[Fraction]]) -> bool:
    """Tell whether a square matrix is a multiple of the identity."""
    return all(
        entry == (matrix[0][0] if i == j else 0) for i, row in enumerate(matrix) for j, entry in enumerate(row)
    )
