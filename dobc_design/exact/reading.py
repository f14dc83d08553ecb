"""Reading values that users give into exact ones: numbers, vectors, matrices.

Both the file reader and the Python constructors go through here, so that 3.2 means 16/5 in both and
an error names the same key.
"""

from __future__ import annotations

import reprlib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from dobc_design._show.text import visible
from dobc_design.errors import misshapen, wrong

from .matrix import Matrix, Vector
from .number import number_text, parse_number

Names = Sequence[str]  # labels of agents, names of modes
Texts = tuple[str, ...]
Table = Mapping[str, Any]
Document = dict[str, Any]  # of JSON or TOML

LONGEST_SHOWN = 60
MOST_NAMES = 12  # that a message lists

_SHORT = reprlib.Repr()
_SHORT.maxstring = _SHORT.maxother = _SHORT.maxlong = LONGEST_SHOWN


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


def is_text(value: object) -> bool:
    """Tell whether ``value`` was given as text, and not as a number of a file."""
    return isinstance(value, str) and not isinstance(value, NumberText)


def read_matrix(
    value: Any, key: str, *, shape: tuple[int, int] | None = None, because: str = ""
) -> Matrix:
    """Read a matrix given by rows, exactly; ``because`` says why the ``shape``.  Raises:
    ShapeError; SpecError."""
    # Rows of arrays are read like lists that somebody typed.
    rows = value.tolist() if isinstance(value, np.ndarray) else value
    example = "For example [[1, 0], [0, 1]]; a column is [[1], [2]]."
    if not is_list(rows) or not rows or not all(is_list(row) for row in rows):
        what = f"must be a matrix, given as a list of rows; got {shown(value)}."
        raise misshapen(key, what, example)
    width = len(rows[0])
    if width == 0:
        raise misshapen(
            f"{key}[0]",
            "must hold at least one number; got an empty row.",
            example,
        )
    for position, row in enumerate(rows):
        if len(row) != width:
            what = (
                f"must have {counted(width, 'number')}, as many as the first row; got {len(row)}."
            )
            raise misshapen(f"{key}[{position}]", what, "Make all rows equally long.")
    if shape is not None:
        check_shape(rows, key, shape, because)
    numbered = enumerate(map(enumerate, rows))
    return tuple(
        tuple(parse_number(entry, f"{key}[{i}][{j}]") for j, entry in row) for i, row in numbered
    )


def check_shape(matrix: Matrix, key: str, shape: tuple[int, int], because: str) -> None:
    """Refuse a matrix of another shape; ``because`` says why this one.  Raises: ShapeError."""
    got = (len(matrix), len(matrix[0]))
    if got != shape:
        what = f"must have shape {shape}{because and f', {because}'}; got shape {got}."
        raise misshapen(key, what, f"Give {rows_of(shape)}.")


def read_vector(value: Any, key: str, *, length: int, because: str) -> Vector:
    """Read ``length`` numbers; a single number stands for all components."""
    if not is_list(value):
        return (parse_number(value, key),) * length
    if len(value) != length:
        numbers = counted(length, "number")
        what = f"must have {numbers}, {because}; got {len(value)}."
        raise misshapen(key, what, f"Give a list of {numbers}.")
    return tuple(parse_number(entry, f"{key}[{i}]") for i, entry in enumerate(value))


def shown(value: object) -> str:
    """Show what was given, cut to a length that fits in a sentence; nothing in it can move a
    cursor."""
    # A repr of any length would hide the sentence that it stands in.
    try:
        text = _SHORT.repr(value)
    except ValueError:  # a whole number with more digits than Python prints
        text = "a number of thousands of digits"
    return text if len(text) <= LONGEST_SHOWN else text[: LONGEST_SHOWN - 3] + "..."


def named(text: str) -> str:
    """Show a label, a name or a key without quotes: cut, and unprintable characters as escapes."""
    cut = visible(text[: LONGEST_SHOWN + 1])
    return cut if len(cut) <= LONGEST_SHOWN else cut[: LONGEST_SHOWN - 3] + "..."


def shown_number(value: Fraction) -> str:
    """Show an exact number, cut to a length that fits in a sentence."""
    return named(number_text(value))


def counted(number: int, word: str) -> str:
    """Write "1 arc", "2 arcs"."""
    return f"{number} {word}{'' if number == 1 else 's'}"


def some(names: Sequence[str], most: int) -> str:
    """List names, at most so many: "a, b and 3 more"."""
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def rows_of(shape: tuple[int, int]) -> str:
    """Write "2 rows of 1 number"."""
    return f"{counted(shape[0], 'row')} of {counted(shape[1], 'number')}"


def is_scalar_matrix(matrix: Sequence[Sequence[Fraction]]) -> bool:
    """Tell whether a matrix is a multiple of the identity; one that is not square never is."""
    square = all(len(row) == len(matrix) for row in matrix)
    return square and all(
        entry == (matrix[0][0] if i == j else 0)
        for i, row in enumerate(matrix)
        for j, entry in enumerate(row)
    )


def repeated_name(names: Iterable[str]) -> str | None:
    """The first of these names that stands there twice; None without one."""
    return next((name for name, count in Counter(names).items() if count > 1), None)


def json_object(pairs: list[tuple[str, Any]]) -> Document:
    """An object of JSON.  Raises: ValueError where it has a key twice, of which JSON would keep the
    last."""
    result = dict(pairs)
    if len(result) != len(pairs):
        raise ValueError("a field stands there twice")
    return result


def items(value: Any, key: str) -> Iterable[tuple[Any, Any]]:
    """The items of a mapping.  Raises: SpecError for anything else."""
    if not isinstance(value, Mapping):
        raise wrong(key, f"must be a table; got {shown(value)}.", "Give a mapping, as a dict.")
    return value.items()


def keyed(value: Any, keys: Sequence[str], *, key: str) -> list[Any]:
    """What a table, which may have no other keys than these, or a noun has under them; None where
    it has nothing."""
    # A noun that was made in Python stands for its table.
    if type(value).__name__.lower() == key:
        return [getattr(value, name) for name in keys]
    for name, _ in items(value, key):
        if name not in keys:
            cure = f"Known keys: {', '.join(keys)}."
            raise wrong(f"{key}.{named(str(name))}", "is an unknown key.", cure)
    return [value.get(name) for name in keys]


def one_of(value: Any, names: Iterable[str], key: str, cure: str = "Choose one.") -> str:
    """A text that is one of these names.  Raises: SpecError."""
    if isinstance(value, str) and value in names:
        return value
    raise wrong(key, f"must be one of {some([*names], MOST_NAMES)}; got {shown(value)}.", cure)


def whole_number(value: Any, key: str, *, least: int, most: int, cure: str) -> int:
    """An integer from ``least`` to ``most``.  Raises: SpecError."""
    # True and False are integers of Python.
    if isinstance(value, int) and not isinstance(value, bool) and least <= value <= most:
        return value
    raise wrong(key, f"must be an integer from {least} to {most}; got {shown(value)}.", cure)


def flag(value: Any, key: str, cure: str = "For example true.") -> bool:
    """True or false.  Raises: SpecError."""
    # "false" in quotes would be true.
    if isinstance(value, bool):
        return value
    raise wrong(key, f"must be true or false; got {shown(value)}.", cure)


def least_number(
    value: Any, key: str, what: str, cure: str, *, below: Fraction | None = None
) -> Fraction:
    """A number >= 0, and less than ``below`` where that is given; ``what`` it is.  Raises:
    SpecError."""
    number = parse_number(value, key)
    if number < 0 or (below is not None and number >= below):
        raise wrong(key, f"must be {what}; got {shown_number(number)}.", cure)
    return number


def positive_number(value: Any, key: str, unit: str) -> Fraction:
    """Read a number > 0 in ``unit``.  Raises: SpecError."""
    number = parse_number(value, key)
    if number <= 0:
        cure = "Give a positive time." if unit == "s" else "Give a positive number."
        raise wrong(key, f"must be > 0 ({unit}); got {shown_number(number)}.", cure)
    return number
