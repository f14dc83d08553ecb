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

Object = dict[str, Any]  # of JSON, or its shape
MAX_BYTES = 16 * 2**20  # of a file
MAX_DIGITS = 10_000  # characters of one number
VECTOR_BITS = 2**16  # of the common denominator of a vector
MATRIX_BITS = 2**14  # of that of P, and of a designed W
UNSIGNED = r"[0-9]+(?:\.[0-9]+)?(?:[eE][+-]?0*(?:[0-3]?[0-9]{1,2}|400))?"  # exponents up to 400
RATIONAL = rf"([+-]?{UNSIGNED})|([+-]?[0-9]+)/([+-]?0*[1-9][0-9]*)"


#: A problem that has one of them is of version 4.
NEW_KEYS = ("goal", "fixed", "negative", "readings", "processor", "time")


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


# --- A file as a whole
def document(data: bytes, kind: str) -> Object:
    """The JSON object of a file."""
    # before anything is read: JSON of any size would be read for minutes
    need(len(data) <= MAX_BYTES, f"the file is larger than {MAX_BYTES} bytes")
    try:
        # decimals are kept as they are written; a double would be another number
        value = json.loads(
            data.decode(),
            object_pairs_hook=once,
            parse_float=decimal.Decimal,
            parse_constant=rational,
        )
    except (ValueError, ArithmeticError, RecursionError):
        raise Refused("the file is no JSON in UTF-8, or nested too deeply") from None
    need(type(value) is dict and value.get("format") == kind, f"the file is no {kind}")
    known = version_of(value) if kind == "dobc-problem" else 1
    # True == 1, so that the type is asked as well
    right = type(value.get("version")) is int and value["version"] == known
    need(right, f"the version is not {known}")
    return dict(value)


def version_of(problem: Object) -> int:
    """The version that a problem file has to have: one that an older checker refuses, where this
    would take it for a problem without the new key."""
    if any(key in problem for key in NEW_KEYS):
        return 4
    if leaves_agents(problem) or in_a_mode(problem, "gains"):
        return 4
    actuators = problem.get("actuators")
    if type(actuators) is dict and not actuators.keys().isdisjoint(("saturates", "delay")):
        return 4
    for name, key in (("uncertainty", "bands"), ("dynamics", "H")):
        table = problem.get(name)
        if type(table) is dict and key in table:
            return 4
    if in_a_mode(problem, "optional"):
        return 3
    if "dynamics" in problem:
        return 2
    return 1


def in_a_mode(problem: Object, key: str) -> bool:
    """Whether a mode has this key."""
    modes = problem.get("modes")
    return type(modes) is list and any(type(mode) is dict and key in mode for mode in modes)


def leaves_agents(problem: Object) -> bool:
    """Whether there are groups of agents with exosystems, and agents in none of them."""
    exosystem = problem.get("exosystem")
    labels = problem.get("labels")
    groups = exosystem.get("groups") if type(exosystem) is dict else None
    if type(groups) is not list or type(labels) is not list:
        return False
    lists = [group.get("agents") for group in groups if type(group) is dict]
    return sum(len(agents) for agents in lists if type(agents) is list) < len(labels)


def as_hashed(source: Object) -> bytes:
    """The form of problem.json whose hash a certificate names: sorted keys, no blanks, and a line
    end."""

    def no_decimal(number: Any) -> Any:
        raise Refused(f"{number} is no text")  # rationals are texts there

    # nothing is written anew: a number that is spelled in another way has another hash
    text = json.dumps(
        source, sort_keys=True, ensure_ascii=False, separators=(",", ":"), default=no_decimal
    )
    return text.encode("utf-8", "surrogatepass") + b"\n"


def once(pairs: list[tuple[str, Any]]) -> Object:
    """An object, whose keys must differ."""
    need(len(dict(pairs)) == len(pairs), "a key stands there twice")
    return dict(pairs)


# --- Its parts, by their shapes
def read(value: Any, shape: Any) -> Any:
    """The value, if it has the shape, with Fractions for rationals and attributes for keys."""
    if isinstance(shape, dict):
        return read_object(value, shape)
    if isinstance(shape, list):
        need(type(value) is list, "there is something else than a list")
        return [read(item, shape[0]) for item in value]
    if isinstance(shape, tuple):
        return read_items(value, shape)
    if shape is None:
        return value
    return shape(value)


def read_object(value: Any, shape: Object) -> Any:
    """An object with the keys of the shape, and no other."""
    known = {key.rstrip("?"): part for key, part in shape.items()}
    names = ", ".join(known)
    need(type(value) is dict, "there is something else than an object")
    need(set(value) <= set(known), f"there are other keys than {names}")
    complete = all(key in value for key in shape if key[-1] != "?")
    need(complete, f"one of the keys {names} is missing")
    found = SimpleNamespace(**dict.fromkeys(known))
    for key, part in known.items():
        if key in value:
            setattr(found, key, read(value[key], part))
    return found


def read_items(value: Any, shapes: tuple[Any, ...]) -> list[Any]:
    """A list with as many items as there are shapes."""
    need(type(value) is list, "there is something else than a list")
    count = f"there are {len(value)} things where {len(shapes)} were expected"
    need(len(value) == len(shapes), count)
    return [read(item, part) for item, part in zip(value, shapes, strict=True)]


def one_of(types: tuple[type, ...], value: Any) -> Any:
    """What has one of these types (and is no boolean)."""
    names = " or ".join(kind.__name__ for kind in types)
    need(type(value) in types, f"there is something else than {names}")
    return value


text, an_object, integer = (partial(one_of, (kind,)) for kind in (str, dict, int))


def maybe(part: Any) -> Callable[[Any], Any]:
    """The shape of null, or of what has the given shape."""
    return lambda value: None if value is None else read(value, part)


def index(count: int, value: Any) -> int:
    """An index from 0."""
    in_range = type(value) is int and 0 <= value < count
    need(in_range, f"an integer from 0 to {count - 1} was expected")
    return int(value)


def rational(text: Any) -> Fraction:
    """A rational as the files write it: a quotient of integers or a decimal."""
    short_text = type(text) is str and len(text) <= MAX_DIGITS
    need(short_text, f"a number is no text of at most {MAX_DIGITS} characters")
    need(re.fullmatch(RATIONAL, text) is not None, "a number is not written as it should")
    top, _, bottom = text.partition("/")
    # Decimal reads the digits as they are; the bottom is not 0, as the pattern says
    return Fraction(decimal.Decimal(top)) / Fraction(decimal.Decimal(bottom or "1"))


def json_number(value: Any) -> Fraction:
    """A decimal as the files write it: a number of JSON, which means the text that is written."""
    return rational(str(one_of((int, decimal.Decimal), value)))


def matrix(rows: int, columns: int) -> tuple[tuple[Any, ...], ...]:
    """The shape of a matrix of rationals."""
    return ((rational,) * columns,) * rows


def short(numbers: Iterable[Fraction], limit: int) -> None:
    """Refuse numbers whose common denominator is too long to go on with."""
    # exact sums over a long common denominator would take for ever
    common = 1
    for x in numbers:
        common = math.lcm(common, x.denominator)
        need(
            common.bit_length() <= limit,
            f"numbers have a common denominator of more than {limit} bits",
        )


def short_matrix(X: Iterable[Iterable[Fraction]]) -> None:
    """The same for the entries of a matrix."""
    short((x for row in X for x in row), MATRIX_BITS)


def direction(size: int, value: Any) -> list[Fraction]:
    """A vector that is not 0."""
    v = list(read(value, (rational,) * size))
    short(v, VECTOR_BITS)
    need(any(v), "a vector is 0")
    return v


def weights(size: int, value: Any) -> list[Fraction]:
    """Positive numbers."""
    v = vector(size, value)
    need(min(v, default=0) > 0, "an entry of v is not positive")
    return v


def vector(size: int, value: Any) -> list[Fraction]:
    """Numbers: rationals, or doubles in base64."""
    if type(value) is dict:
        return doubles(size, value)
    v = list(read(value, (rational,) * size))
    short(v, VECTOR_BITS)
    return v


def doubles(size: int, value: Any) -> list[Fraction]:
    """Doubles in base64, each with its exact binary value."""
    data = read(value, {"float64": text}).float64
    try:
        numbers = struct.unpack(f"<{size}d", base64.b64decode(data, validate=True))
    except (binascii.Error, ValueError, struct.error):
        raise Refused(f"a block of doubles does not hold {size} of them in base64") from None
    need(all(map(math.isfinite, numbers)), "an entry of a block of doubles is no number")
    return list(map(Fraction, numbers))


def same(value: Any, expected: Any) -> bool:
    """True if a part of the certificate says what it has to: rationals as numbers, the rest as it
    is."""
    if isinstance(expected, dict):
        if type(value) is not dict or set(value) != set(expected):
            return False
        return all(same(part, expected[key]) for key, part in value.items())
    if isinstance(expected, list):
        if type(value) is not list or len(value) != len(expected):
            return False
        return all(map(same, value, expected))
    # "2/4" and "0.50" are 1/2
    if isinstance(expected, Fraction):
        return rational(value) == expected
    return bool(value == expected)
