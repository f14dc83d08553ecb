"""What nouns share: how they are made, and shape checks that name the matrix, the shape it must
have and why.

Shape checks look at lengths only, so nested sequences and arrays alike may be given; entries are
not read.
"""

import copyreg
from collections.abc import Sized
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Protocol, TypeVar, dataclass_transform

from .errors import misshapen

T = TypeVar("T")
#: Of a field that problem.json has only where it was given, so that other problems keep their hash.
LATER = {"later": True}


def read_only(mapping: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    """A mapping of a noun, which nobody can change."""
    return MappingProxyType(mapping)


# Python does not pickle them by itself, and worker processes are sent nouns.
copyreg.pickle(MappingProxyType, lambda mapping: (read_only, (dict(mapping),)))


class Rows(Protocol):
    """Anything that has a length and yields rows that have one: nested tuples, 2-D arrays."""

    def __len__(self) -> int: ...
    def __getitem__(self, index: int, /) -> Sized: ...


def require_shape(
    matrix: Rows, shape: tuple[int | None, int | None], *, name: str, because: str = ""
) -> tuple[int, int]:
    """Return the (rows, columns) of a matrix that has the wanted shape; None leaves a side free.

    Raises: ShapeError naming ``name`` as its key, with ``because`` as the reason.
    """
    widths = [len(matrix[i]) for i in range(len(matrix))]
    for number, width in enumerate(widths, start=1):
        if width != widths[0]:
            what = (
                f"must have rows of one length; got {widths[0]} in row 1 and {width} in row "
                f"{number}."
            )
            raise misshapen(name, what)
    got = (len(widths), widths[0] if widths else 0)
    # Nested sequences cannot say how many columns no rows have, so those agree with any number.
    wrong_columns = shape[1] is not None and got[0] > 0 and got[1] != shape[1]
    if (shape[0] is not None and got[0] != shape[0]) or wrong_columns:
        reason = f", {because}" if because else ""
        raise misshapen(name, f"must have {_wanted(shape)}{reason}; got shape {got}.")
    return got


def require_square(matrix: Rows, name: str, because: str = "") -> int:
    """Return the number of rows of a square matrix; raise ShapeError if it is not square."""
    rows, columns = require_shape(matrix, (None, None), name=name)
    if rows != columns:
        reason = f", {because}" if because else ""
        raise misshapen(name, f"must be square{reason}; got shape ({rows}, {columns}).")
    return rows


def _made(cls: type[T] | None, **options: bool) -> Any:
    def made(cls: type[T]) -> type[T]:
        shows_itself = cls.__repr__ is not object.__repr__
        return dataclass(frozen=True, slots=True, repr=not shows_itself, **options)(cls)

    return made if cls is None else made(cls)


@dataclass_transform(frozen_default=True, kw_only_default=True, field_specifiers=(field,))
def noun(cls: type[T] | None = None, *, eq: bool = True) -> Any:
    """Make a class a frozen dataclass with slots, whose fields are given by keyword.  ``eq``:
    whether two with equal fields are equal; else each equals itself only.  A class that shows
    itself (``_show.cards.Shown``) does so in a repr, too."""
    return _made(cls, eq=eq, kw_only=True)


@dataclass_transform(frozen_default=True, field_specifiers=(field,))
def positional(cls: type[T] | None = None, *, eq: bool = True) -> Any:
    """The same for a class whose few fields are given in their order."""
    return _made(cls, eq=eq)


def later() -> Any:
    """A field that problem.json has only where it was given."""
    return field(default=None, metadata=LATER)


def put(made: object, **values: Any) -> None:
    """Set fields of a frozen noun that is being made."""
    for name, value in values.items():
        object.__setattr__(made, name, value)


def _wanted(shape: tuple[int | None, int | None]) -> str:
    if None not in shape:
        return f"shape {shape}"
    number, word = (shape[1], "column") if shape[0] is None else (shape[0], "row")
    return f"{number} {word}" if number == 1 else f"{number} {word}s"
