"""Values of an axis as text: what somebody types after KEY=, and what a document holds for it.

A value is a number (3.2, 9/16), a list in brackets, an inline table in braces, text in quotes, the word none (the
key is left out), or, failing all that, text as it stands: expressions need no quotes.  Every value has one text,
and reading that text gives the value.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from fractions import Fraction
from typing import Any

import numpy as np

from dobc_design.errors import SpecError
from dobc_design.exact.number import number_text, parse_number
from dobc_design.exact.reading import NumberText, is_list, shown
from dobc_design.problem.changes import typed_number
from dobc_design.problem.toml_text import parse_toml

NONE = "none"
_WHOLE = re.compile(r"[+-]?[0-9]{1,200}")
_NUMBER = re.compile(r"[+-]?[0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]+)?")
_PAIRS = {"(": ")", "[": "]", "{": "}"}


def read_value(text: str) -> Any:
    """What a document holds for this text; None for the word none.  Raises: SpecError."""
    text = text.strip()
    if text == NONE:
        return None
    if not text or not text.isprintable():
        raise SpecError(f"a value must be printable text; got {shown(text)}.", key="values", cure="Leave it out.")
    if text.startswith("[") and text.endswith("]"):
        return [read_value(part) for part in split(text[1:-1])]
    if text[0] in "{\"'":
        return parse_toml(f"value = {text}".encode())["value"]
    if _WHOLE.fullmatch(text):
        return int(text)
    return NumberText(text) if _NUMBER.fullmatch(text) else text


def value_text(value: Any) -> str:
    """The text of a value given in Python.  Raises: SpecError for what a problem file cannot hold."""
    if value is None:
        return NONE
    if isinstance(value, np.generic):
        value = value.item()
    if is_list(value):
        entries = value.tolist() if isinstance(value, np.ndarray) else value
        return "[" + ", ".join(value_text(each) for each in entries) + "]"
    if isinstance(value, Mapping):
        pairs = (f"{json.dumps(str(key), ensure_ascii=False)} = {_in_table(each)}" for key, each in value.items())
        return "{ " + ", ".join(pairs) + " }"
    if isinstance(value, str):
        return value if _reads_back(value) else json.dumps(value, ensure_ascii=False)
    if isinstance(value, bool):
        raise SpecError(
            f"a value must be a number, text, list or table; got {value}.", key="values", cure="Use 0 or 1."
        )
    return exact_text(parse_number(value, key="values"))


def exact_text(value: Fraction) -> str:
    """A rational as it is typed: 5, 0.42 or 9/16."""
    typed = typed_number(value)
    return number_text(value) if isinstance(typed, str) or "e" in repr(typed) else str(typed)


def number_of(text: str) -> float | None:
    """The number that a value's text is, or None for other values."""
    try:
        return float(parse_number(text.strip(), key="value"))
    except (SpecError, OverflowError):
        return None


def split(text: str) -> list[str]:
    """The parts between commas that stand outside brackets and quotes; none of them may be empty.

    Raises: SpecError.
    """
    if not text.strip():
        return []
    parts = [part.strip() for part in _parts(text)]
    if not all(parts):
        raise SpecError(
            f"a value is missing between commas in {shown(text)}.", key="values", cure="Drop the comma, or add it."
        )
    return parts


def _parts(text: str) -> Iterator[str]:
    begin, closing, quote = 0, [], ""
    for place, character in enumerate(text):
        if quote:
            quote = "" if character == quote and text[place - 1] != "\\" else quote
        elif character in "\"'":
            quote = character
        elif character in _PAIRS:
            closing.append(_PAIRS[character])
        elif closing and character == closing[-1]:
            closing.pop()
        elif character in ")]}":
            raise _unbalanced(text)
        elif character == "," and not closing:
            yield text[begin:place]
            begin = place + 1
    if closing or quote:
        raise _unbalanced(text)
    yield text[begin:]


def _unbalanced(text: str) -> SpecError:
    return SpecError(
        f"a bracket or quote is left open, or closed too often, in {shown(text)}.", key="values", cure="Close it."
    )


def _in_table(value: Any) -> str:
    """A value inside an inline table, where TOML's rules hold: text and fractions stand in quotes."""
    text = value_text(value)
    bare = isinstance(value, str) or ("/" in text and not is_list(value))
    return json.dumps(value if isinstance(value, str) else text, ensure_ascii=False) if bare else text


def _reads_back(text: str) -> bool:
    """Whether text stands for itself, and not for a number, a list or the word none."""
    try:
        return text == text.strip() and len(split(text)) == 1 and read_value(text) == text
    except SpecError:
        return False
