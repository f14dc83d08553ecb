"""Values as somebody would type them into a problem file, and changes of a file as lines for people to read."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

from dobc_design.exact.matrix import Matrix
from dobc_design.exact.number import number_text
from dobc_design.exact.reading import is_scalar_matrix

INLINE = 10  # labels up to which a table of gains stands in one line


def typed_number(value: Fraction) -> int | float | str:
    """A rational as somebody would type it: 5, 0.42, "9/16"; reading it gives the number back."""
    if value.denominator == 1 and abs(value) < 10**15:
        return int(value)
    try:
        decimal = float(value)
    except OverflowError:
        return number_text(value)
    return decimal if Fraction(repr(decimal)) == value else number_text(value)


def typed_matrix(matrix: Sequence[Sequence[Fraction]]) -> list[list[int | float | str]]:
    """A rational matrix as rows that somebody would type."""
    return [[typed_number(x) for x in row] for row in matrix]


def gain_table(gains: Mapping[int, Matrix], labels: Sequence[str]) -> dict[str, Any]:
    """Gains by agent index as they stand in a file: label -> number, or rows."""
    return {
        labels[i]: typed_number(gain[0][0]) if is_scalar_matrix(gain) else typed_matrix(gain)
        for i, gain in gains.items()
    }


def value_text(value: Any) -> str:
    """A value as it stands in a file, on one line."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(str(key))} = {value_text(each)}" for key, each in value.items()) + " }"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(value_text(each) for each in value) + "]"
    # A number or a text means the same in JSON and in TOML (JSON escapes are TOML escapes).
    return json.dumps(value, ensure_ascii=False)


def change_lines(changes: Mapping[str, Any]) -> list[str]:
    """Changes as lines of a problem file, for people: long tables are cut, what has to go stands in a comment."""
    lines: list[str] = []
    tables = dict.fromkeys(path.split(".")[0] for path, value in changes.items() if value is not None and "." in path)
    lines += [f"{path} = {value_text(x)}" for path, x in changes.items() if "." not in path and x is not None]
    for table in tables:
        lines.append(f"[{table}]")
        for path, value in changes.items():
            if path.startswith(f"{table}.") and value is not None:
                lines.append(f"{path.partition('.')[2]} = {_cut_text(value)}")
    return [*lines, *(f"# remove {path}" for path, value in changes.items() if value is None)]


def _cut_text(value: Any) -> str:
    if not isinstance(value, Mapping) or len(value) <= INLINE:
        return value_text(value)
    first = value_text(dict(list(value.items())[: INLINE - 1]))
    return f"{first.removesuffix(' }')}, ... }}  # {len(value) - INLINE + 1} more"


def _key(name: str) -> str:
    bare = name.isascii() and name.replace("-", "").replace("_", "").isalnum()
    return name if bare else json.dumps(name, ensure_ascii=False)
