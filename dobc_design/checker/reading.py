"""Strict readers of the two files: whatever is not on the format page is refused.

A shape says what a part of a file has to be. It is a dict of keys ("key?" may be absent and is then
None), a list with the shape of all items, a tuple with the shape of each item, a function that
reads the part or refuses it, or None for what is not judged.
"""

import base64
import binascii
import decimal
import json
import math
import re
import struct
import time
from collections.abc import Callable, Iterable
from contextvars import ContextVar
from fractions import Fraction
from functools import partial
from types import SimpleNamespace
from typing import Any

MAX_BYTES, MAX_DIGITS = 16 * 2**20, 10_000  # of a file; characters of one number
# of the common denominator of a vector; of P, and of a designed W
VECTOR_BITS, MATRIX_BITS = 2**16, 2**14
UNSIGNED = r"[0-9]+(?:\.[0-9]+)?(?:[eE][+-]?0*(?:[0-3]?[0-9]{1,2}|400))?"  # exponents up to 400

RATIONAL = rf"([+-]?{UNSIGNED})|([+-]?[0-9]+)/([+-]?0*[1-9][0-9]*)"


class Refused(Exception):
    """A file that is not what the format page describes, or a claim that is not shown."""


class OutOfTime(Exception):
    """The time that was given is over; nothing is said about the claim at hand."""


UNTIL: ContextVar[float] = ContextVar("until", default=math.inf)  # of time.monotonic


def still() -> None:
    """Go on only while there is time: what may take long calls it over and over."""
    if time.monotonic() > UNTIL.get():
        raise OutOfTime


def need(condition: bool, message: str) -> None:
    """Refuse unless the condition holds: every check of the whole program is a call of this
    function."""
    still()
    if not condition:
        raise Refused(message)


def document(data: bytes, kind: str) -> dict[str, Any]:
    """The JSON object of a file."""
    need(len(data) <= MAX_BYTES, f"the file is larger than {MAX_BYTES} bytes")
    try:
        value = json.loads(
            data.decode(),
            object_pairs_hook=once,
            parse_float=decimal.Decimal,
            parse_constant=rational,
        )
    except (ValueError, ArithmeticError, RecursionError):
        raise Refused("the file is no JSON in UTF-8, or nested too deeply") from None
    need(type(value) is dict and value.get("format") == kind, f"the file is no {kind}")
    known = 2 if kind == "dobc-problem" and "dynamics" in value else 1
    modes = value.get("modes") if kind == "dobc-problem" else None
    known = (
        3
        if type(modes) is list and any(type(x) is dict and "optional" in x for x in modes)
        else known
    )
    known = 4 if kind == "dobc-problem" and leaves_agents(value) else known
    need(
        type(value.get("version")) is int and value["version"] == known,
        f"the version is not {known}",
    )
    return dict(value)


def leaves_agents(problem: dict[str, Any]) -> bool:
    """Whether there are groups of agents with exosystems, and agents in none of them."""
    exosystem, labels = problem.get("exosystem"), problem.get("labels")
    groups = exosystem.get("groups") if type(exosystem) is dict else None
    if type(groups) is not list or type(labels) is not list:
        return False
    lists = [group.get("agents") for group in groups if type(group) is dict]
    return sum(len(agents) for agents in lists if type(agents) is list) < len(labels)


def as_hashed(source: dict[str, Any]) -> bytes:
    """The form of problem.json whose hash a certificate names: sorted keys, no blanks, and a line
    end."""

    def no_decimal(number: Any) -> Any:
        raise Refused(f"{number} is no text")  # rationals are texts there

    text = json.dumps(
        source, sort_keys=True, ensure_ascii=False, separators=(",", ":"), default=no_decimal
    )
    return text.encode("utf-8", "surrogatepass") + b"\n"


def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """An object, whose keys must differ."""
    need(len(dict(pairs)) == len(pairs), "a key stands there twice")
    return dict(pairs)


def read(value: Any, shape: Any) -> Any:
    """The value, if it has the shape, with Fractions for rationals and attributes for keys."""
    if isinstance(shape, dict):
        known = {key.rstrip("?"): part for key, part in shape.items()}
        need(type(value) is dict, "there is something else than an object")
        need(set(value) <= set(known), f"there are other keys than {', '.join(known)}")
        need(
            all(key in value for key in shape if key[-1] != "?"),
            f"one of the keys {', '.join(known)} is missing",
        )
        return SimpleNamespace(
            **{key: read(value[key], part) if key in value else None for key, part in known.items()}
        )

    if isinstance(shape, list | tuple):
        need(type(value) is list, "there is something else than a list")
        shapes = shape if isinstance(shape, tuple) else shape * len(value)
        need(
            len(value) == len(shapes),
            f"there are {len(value)} things where {len(shapes)} were expected",
        )
        return [read(item, part) for item, part in zip(value, shapes, strict=True)]

    return value if shape is None else shape(value)


def one_of(types: tuple[type, ...], value: Any) -> Any:
    """What has one of these types (and is no boolean)."""
    need(
        type(value) in types,
        f"there is something else than {' or '.join(kind.__name__ for kind in types)}",
    )
    return value


def maybe(part: Any) -> Callable[[Any], Any]:
    """The shape of null, or of what has the given shape."""
    return lambda value: None if value is None else read(value, part)


def index(count: int, value: Any) -> int:
    """An index from 0."""
    need(
        type(value) is int and 0 <= value < count, f"an integer from 0 to {count - 1} was expected"
    )
    return int(value)


def rational(text: Any) -> Fraction:
    """A rational as the files write it: a quotient of integers or a decimal."""
    need(
        type(text) is str and len(text) <= MAX_DIGITS,
        f"a number is no text of at most {MAX_DIGITS} characters",
    )
    need(re.fullmatch(RATIONAL, text) is not None, "a number is not written as it should")
    top, _, bottom = text.partition("/")
    return Fraction(decimal.Decimal(top)) / Fraction(decimal.Decimal(bottom or "1"))


def json_number(value: Any) -> Fraction:
    """A decimal as the files write it: a number of JSON, which means the text that is written."""
    return rational(str(one_of((int, decimal.Decimal), value)))


text, an_object, integer = (partial(one_of, (kind,)) for kind in (str, dict, int))


def matrix(rows: int, columns: int) -> tuple[tuple[Any, ...], ...]:
    """The shape of a matrix of rationals."""
    return ((rational,) * columns,) * rows


def short(numbers: Iterable[Fraction], limit: int) -> None:
    """Refuse numbers whose common denominator is too long to go on with."""
    common = 1
    for x in numbers:
        common = math.lcm(common, x.denominator)
        need(
            common.bit_length() <= limit,
            f"numbers have a common denominator of more than {limit} bits",
        )


def direction(size: int, value: Any) -> list[Fraction]:
    """A vector that is not 0."""
    v = list(read(value, (rational,) * size))
    short(v, VECTOR_BITS)
    need(any(v), "a vector is 0")
    return v


def weights(size: int, value: Any) -> list[Fraction]:
    """Positive numbers: rationals, or doubles in base64."""
    if type(value) is dict:
        data = read(value, {"float64": text}).float64
        try:
            doubles = struct.unpack(f"<{size}d", base64.b64decode(data, validate=True))
        except (binascii.Error, ValueError, struct.error):
            raise Refused(f"a block of doubles does not hold {size} of them in base64") from None
        need(all(0 < x < math.inf for x in doubles), "an entry of v is no positive number")
        return list(map(Fraction, doubles))

    v = direction(size, value)
    need(min(v) > 0, "an entry of v is not positive")
    return v


def same(value: Any, expected: Any) -> bool:
    """True if a part of the certificate says what it has to: rationals as numbers, the rest as it
    is."""
    if isinstance(expected, dict):
        return (
            type(value) is dict
            and set(value) == set(expected)
            and all(same(value[k], expected[k]) for k in value)
        )
    if isinstance(expected, list):
        return (
            type(value) is list and len(value) == len(expected) and all(map(same, value, expected))
        )
    return (
        rational(value) == expected if isinstance(expected, Fraction) else bool(value == expected)
    )
