"""What is varied: an axis is one key (or several that go together) and its values, listed, ranged
or drawn.

    pinning.gains.1=1:5:9                    nine values, evenly spaced, both ends included, exact
    observer.rate=1e-2:10:7:log              seven values, evenly spaced ratios
    coupling.h=exp(y)-1+y,tanh(y)            these two
    pinning.gains.1,pinning.gains.6=1,5      both keys get the same value
    region.initial_disturbance=~uniform(0,1) drawn anew for every sample

Draws: uniform(a, b), loguniform(a, b), normal(mean, deviation), integers(a, b), choice(x, y, ...).
A drawn number is rounded to six significant digits, so that every case can be typed into a file.
Draw number k of an axis depends on the seed, the axis and k alone: every point of the grid sees the
same draws, and more samples keep the first ones.

A key is a path in a problem file: names between dots, places of lists, from 0, in brackets:
``exosystem.A[0][1]``, ``pinning.gains."s 1"``.  A value is a number (3.2, 9/16), a list, an inline
table, text in quotes, the word none (the key is left out), or text as it stands.  Every value has
one text, and reading that text gives the value.
"""

import copy
import json
import math
import re
from collections.abc import Iterator, Mapping
from fractions import Fraction
from random import Random
from statistics import NormalDist
from typing import Any

import numpy as np

from dobc_design._checks import noun
from dobc_design.errors import Mistakes, SpecError, about, refused
from dobc_design.exact.number import number_text, parse_number, typed_number
from dobc_design.exact.reading import Document, Names, NumberText, Table, Texts, is_list, shown
from dobc_design.problem.load import parse_toml
from dobc_design.problem.network import one_form

Path = tuple[str | int, ...]
Over = Table | Names  # key -> values, or KEY=VALUES

MOST_VALUES = 1_000_000
LONGEST = 500  # characters of the keys of an axis
DIGITS = 6  # of drawn numbers and of those with even ratios
NONE = "none"
KINDS = ("uniform", "loguniform", "normal", "integers", "choice")
_PLAIN = r"""[^\s."'\[\],=]+"""
_NAME = rf"""(?:{_PLAIN}|"(?:[^"\\]|\\.)*")"""
_PATH = rf"{_NAME}(?:\.{_NAME}|\[\d{{1,9}}\])*"
_KEYS = re.compile(rf"\s*{_PATH}\s*(?:,\s*{_PATH}\s*)*")
_STEP = re.compile(rf"({_NAME})|\[(\d+)\]")
_ASSIGNED = re.compile(r'((?:[^"=]|"[^"]*")*)=(.*)', re.DOTALL)
_RANGE = re.compile(r"([^:,(\[{]+):([^:,(\[{]+):([0-9]{1,9})(:log)?")
_DRAW = re.compile(r"~\s*([a-z]+)\s*\((.*)\)")
_WHOLE = re.compile(r"[+-]?[0-9]{1,200}")
_NUMBER = re.compile(r"[+-]?[0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]+)?")
_PAIRS = {"(": ")", "[": "]", "{": "}"}
_EXAMPLE = "For example pinning.gains.1, coupling.h or exosystem.A[0][1]."
_CURE = "For example 1:5:9, a list such as 1,2,5, or ~uniform(0,1)."


@noun
class Draw:
    """A distribution: its kind, its numbers as text, or for "choice" the values."""

    kind: str
    arguments: Texts

    def value(self, seed: int, axis: str, sample: int) -> str:
        arguments = self.arguments
        kind = self.kind
        u = Random(f"{seed}|{axis}|{sample}").random()
        # One number in [0, 1) for each draw, so that distributions can be compared draw by draw.
        if kind == "choice":
            return arguments[int(u * len(arguments))]
        a, b = (Fraction(text) for text in arguments)
        if kind == "integers":
            return str(int(a) + int(u * (int(b) - int(a) + 1)))
        if kind == "loguniform":
            return _rounded(math.exp(math.log(a) + u * (math.log(b) - math.log(a))))
        if kind == "normal":
            inside = min(max(u, 2.0**-53), 1 - 2.0**-53)  # at 0 and 1 it is infinite
            return _rounded(NormalDist(float(a), float(b)).inv_cdf(inside))
        return _rounded(float(a) + u * float(b - a))


@noun
class Axis:
    """One key, or several with the same value; its ``values`` as text, or a ``draw``."""

    name: str
    keys: tuple[Path, ...]
    values: Texts = ()
    draw: Draw | None = None

    @property
    def text(self) -> str:
        draw = self.draw
        if draw is not None:
            return f"{self.name}=~{draw.kind}({','.join(draw.arguments)})"
        return f"{self.name}={','.join(self.values)}"


def read_axes(over: Over) -> tuple[Axis, ...]:
    """Axes from texts "KEY=VALUES", or from a mapping key -> values (text as typed, or a
    sequence).  Raises: SpecError that names every wrong axis."""
    given = list(over.items()) if isinstance(over, Mapping) else [split_axis(text) for text in over]
    if not given:
        raise refused(
            "over",
            "nothing is varied: a sweep needs at least one KEY=VALUES.",
            "For example pinning.gains.1=1:5:9.",
        )
    axes = []
    errors = Mistakes()
    for key, values in given:
        try:
            axes.append(_axis(key, values))
        except SpecError as error:
            errors.extend(about(key, each.message, each.cure) for each in error.errors)
    # Of all axes at once, so that a user need not mend them one by one.
    errors.raise_all()
    paths = [path for axis in axes for path in axis.keys]
    if any(path is not other and path == other[: len(path)] for path in paths for other in paths):
        cure = "Put keys that go together on one side: KEY,KEY=VALUES."
        raise refused(
            axes[0].name, "two axes set the same place, and one would undo the other.", cure
        )
    return tuple(axes)


def split_axis(text: str) -> tuple[str, str]:
    """Split "KEY=VALUES" at the first "=" outside quotes.  Raises: SpecError."""
    found = _ASSIGNED.fullmatch(text)
    if found is None:
        cure = "For example pinning.gains.1=1:5:9."
        raise refused(
            text[:60], f"what is varied must be given as KEY=VALUES; got {shown(text)}.", cure
        )
    return found[1].strip(), found[2].strip()


def _axis(key: str, given: Any) -> Axis:
    keys = read_keys(key)
    name = ",".join(path_text(path) for path in keys)
    if isinstance(given, str):
        found = _DRAW.fullmatch(given.strip())
        if found is not None:
            return Axis(name=name, keys=keys, draw=_draw(found[1], found[2]))
        if given.strip().startswith("~"):
            raise SpecError(
                f"{shown(given)} is no draw.", cure=f"~KIND(...), KIND one of {', '.join(KINDS)}."
            )
        values = _listed(given)
    else:
        values = (
            tuple(value_text(each) for each in given) if is_list(given) else (value_text(given),)
        )
    if not values or len(values) > MOST_VALUES:
        raise SpecError(f"there must be 1 to {MOST_VALUES} values; got {len(values)}.", cure=_CURE)
    if len(set(values)) < len(values):
        raise SpecError("a value appears twice.", cure="Name each value once.")
    return Axis(name=name, keys=keys, values=values)


def _listed(text: str) -> Texts:
    found = _RANGE.fullmatch(text.strip())
    if found is None:
        return _readable(text)
    a, b = parse_number(found[1].strip(), "start"), parse_number(found[2].strip(), "end")
    count = int(found[3])
    if count < 2 or a == b or count > MOST_VALUES:
        message = (
            f"START:END:COUNT needs two different ends and a count from 2 to {MOST_VALUES}; "
            f"got {shown(count)}."
        )
        raise SpecError(message, cure=_CURE)
    # Evenly spaced values are exact: 0:1:4 has 1/3.
    if not found[4]:
        return tuple(exact_text(a + (b - a) * k / (count - 1)) for k in range(count))
    if a <= 0 or b <= 0:
        cure = "For example 0.01:10:7:log."
        raise SpecError("START:END:COUNT:log needs ends > 0, because ratios are even.", cure=cure)
    # The ends stay as they were typed; only what lies between is rounded.
    low, step = math.log(a), (math.log(b) - math.log(a)) / (count - 1)
    inner = (_rounded(math.exp(low + step * k)) for k in range(1, count - 1))
    return (exact_text(a), *inner, exact_text(b))


def _readable(text: str) -> Texts:
    """The values between commas; what cannot be read is said before anything runs."""
    values = tuple(split(text))
    for value in values:
        read_value(value)
    return values


def _draw(kind: str, text: str) -> Draw:
    if kind == "choice" and text.strip():
        return Draw(kind=kind, arguments=_readable(text))
    arguments = tuple(split(text))
    if kind not in KINDS or len(arguments) != 2:
        kinds = (
            "uniform(a,b), loguniform(a,b), normal(mean,deviation), integers(a,b) or "
            "choice(x,y,...)"
        )
        raise SpecError(
            f"a draw must be {kinds}; got {shown(f'{kind}({text})')}.",
            cure="For example ~uniform(0.1,1).",
        )
    a, b = (parse_number(each, f"~{kind}") for each in arguments)
    fits, rule = {
        "normal": (b > 0, "the second number must be > 0"),
        "integers": (a.denominator == b.denominator == 1, "both must be whole numbers"),
        "loguniform": (a > 0, "both must be > 0"),
    }.get(kind, (True, ""))
    if fits and kind != "normal":
        fits, rule = a < b, "the first must be less than the second"
    if not fits:
        raise SpecError(f"~{kind}({text}): {rule}.", cure="For example ~uniform(0.1,1).")
    return Draw(kind=kind, arguments=(str(a), str(b)))


def _rounded(value: float) -> str:
    return exact_text(parse_number(float(f"{value:.{DIGITS}g}"), "values"))


def read_keys(text: str) -> tuple[Path, ...]:
    """The key paths of an axis: one, or several that get the same value, separated by commas.
    Raises: SpecError."""
    if len(text) > LONGEST or _KEYS.fullmatch(text) is None:
        message = (
            f"{shown(text)} is no key of a problem file: write names with dots between, "
            "indices in brackets."
        )
        raise refused(text[:60], message, _EXAMPLE)
    paths = tuple(
        tuple(_step(*step.groups()) for step in _STEP.finditer(path))
        for path in re.findall(_PATH, text)
    )
    if len(set(paths)) < len(paths):
        raise refused(text[:60], f"{shown(text)} names a key twice.", "Name each key once.")
    return paths


def _step(name: str | None, place: str | None) -> str | int:
    if name is None:
        return int(place or 0)
    try:
        # TOML's basic strings escape as JSON's do
        return one_form(json.loads(name) if name.startswith('"') else name)
    except ValueError:
        raise refused("key", f"{shown(name)} is no quoted name.", _EXAMPLE) from None


def path_text(path: Path) -> str:
    """The path as it is typed."""
    text = ""
    for part in path:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            plain = re.fullmatch(_PLAIN, part) is not None
            text += ("." if text else "") + (
                part if plain else json.dumps(part, ensure_ascii=False)
            )
    return text


def with_changes(document: Table, changes: Mapping[Path, Any]) -> Document:
    """A copy of the document with these places set; None removes a key.  Tables on the way are
    made.  Raises: SpecError where a path leads through something that is no table and no list."""
    changed: Document = copy.deepcopy(dict(document))
    for path, value in changes.items():
        _set(changed, path, copy.deepcopy(value))
    return changed


def _set(document: Document, path: Path, value: Any) -> None:
    inner: Any = document
    for depth, part in enumerate(_spelled(inner, each) for each in path[:-1]):
        # A table that is missing on the way is made, for a value to be set in it.
        if isinstance(inner, dict) and isinstance(part, str) and part not in inner:
            if value is None:
                return
            inner[part] = [] if isinstance(path[depth + 1], int) else {}
        _require_place(inner, path, depth)
        inner = inner[part]
    last = _spelled(inner, path[-1])
    # One place beyond the end is a new entry, such as the weight of an arc [a, b].
    if isinstance(inner, list) and last == len(inner) and value is not None:
        inner.append(value)
        return
    _require_place(inner, path, len(path) - 1)
    if value is not None:
        inner[last] = value
    elif not isinstance(inner, dict) or last in inner:
        inner.pop(last)


def _spelled(inner: Any, part: str | int) -> str | int:
    """A key as the file spells it, whose accents may be in another form."""
    known = isinstance(inner, dict) and part not in inner
    return next((key for key in inner if one_form(key) == part), part) if known else part


def _require_place(inner: Any, path: Path, depth: int) -> None:
    """Raise a SpecError unless ``inner`` is a table or a list that can have the part of the path at
    ``depth``."""
    part, so_far = path[depth], path_text(path[:depth])
    if isinstance(inner, dict) and isinstance(part, str):
        return
    if isinstance(inner, list) and isinstance(part, int):
        if part < len(inner):
            return
        problem = f"has {len(inner)} entries, counted from 0; got index {part}"
        cure = "Use an existing index, or the next one."
    else:
        kind = shown(inner)
        if isinstance(inner, dict):
            kind = "a table"
        elif isinstance(inner, list):
            kind = "a list"
        problem = f"is {kind}, which has no {shown(part)}"
        cure = "Give an index, such as [0]." if isinstance(inner, list) else "Name a key of it."
        if not isinstance(inner, (dict, list)):
            cure = f"Vary {so_far} itself, or write it as a table in the problem file."
    raise refused(path_text(path), f"{path_text(path)}: {so_far} {problem}.", cure)


def read_value(text: str) -> Any:
    """What a document holds for this text; None for the word none.  Raises: SpecError."""
    text = text.strip()
    if text == NONE:
        return None
    if not text or not text.isprintable():
        raise refused(
            "values", f"a value must be printable text; got {shown(text)}.", "Leave it out."
        )
    if text.startswith("[") and text.endswith("]"):
        return [read_value(part) for part in split(text[1:-1])]
    if text[0] in "{\"'":
        return parse_toml(f"value = {text}".encode())["value"]
    if _WHOLE.fullmatch(text):
        return int(text)
    return NumberText(text) if _NUMBER.fullmatch(text) else text


def value_text(value: Any) -> str:
    """The text of a value given in Python.  Raises: SpecError for what a problem file cannot
    hold."""
    if value is None:
        return NONE
    if isinstance(value, np.generic):
        value = value.item()
    if is_list(value):
        entries = value.tolist() if isinstance(value, np.ndarray) else value
        return "[" + ", ".join(value_text(each) for each in entries) + "]"
    if isinstance(value, Mapping):
        pairs = (
            f"{json.dumps(str(key), ensure_ascii=False)} = {_in_table(each)}"
            for key, each in value.items()
        )
        return "{ " + ", ".join(pairs) + " }"
    if isinstance(value, str):
        return value if _reads_back(value) else json.dumps(value, ensure_ascii=False)
    # A bool is an int in Python, and would pass for 0 or 1 below.
    if isinstance(value, bool):
        cure = "Use 0 or 1."
        raise refused(
            "values", f"a value must be a number, text, list or table; got {value}.", cure
        )
    return exact_text(parse_number(value, "values"))


def exact_text(value: Fraction) -> str:
    """A rational as it is typed: 5, 0.42 or 9/16."""
    typed = typed_number(value)
    return number_text(value) if isinstance(typed, str) or "e" in repr(typed) else str(typed)


def number_of(text: str) -> float | None:
    """The number that a value's text is, or None for other values."""
    try:
        return float(parse_number(text.strip(), "value"))
    except (SpecError, OverflowError):
        return None


def split(text: str) -> list[str]:
    """The parts between commas that stand outside brackets and quotes; none of them may be empty.
    Raises: SpecError."""
    parts = [part.strip() for part in _parts(text)] if text.strip() else []
    if not all(parts):
        raise refused(
            "values",
            f"a value is missing between commas in {shown(text)}.",
            "Remove the comma, or add the value.",
        )
    return parts


def _parts(text: str) -> Iterator[str]:
    begin, closing, quote = 0, [], ""
    for place, character in enumerate(text):
        # Inside quotes brackets and commas are text.
        if quote:
            # A quote is text after an odd number of backslashes, which are text by twos.
            slashes = place - len(text[:place].rstrip("\\"))
            quote = "" if character == quote and slashes % 2 == 0 else quote
        elif character in "\"'":
            quote = character
        elif character in _PAIRS:
            closing.append(_PAIRS[character])
        elif character in ")]}":
            if not closing or closing.pop() != character:
                raise _unbalanced(text)
        elif character == "," and not closing:
            yield text[begin:place]
            begin = place + 1
    if closing or quote:
        raise _unbalanced(text)
    yield text[begin:]


def _unbalanced(text: str) -> SpecError:
    message = f"a bracket or quote is left open, or closed too often, in {shown(text)}."
    return refused("values", message, "Close it.")


def _in_table(value: Any) -> str:
    """A value inside an inline table, where TOML's rules hold: text and fractions stand in
    quotes."""
    text = value_text(value)
    # A fraction such as 9/16 is no number of TOML.
    bare = isinstance(value, str) or ("/" in text and not is_list(value))
    return (
        json.dumps(value if isinstance(value, str) else text, ensure_ascii=False) if bare else text
    )


def _reads_back(text: str) -> bool:
    """Whether text stands for itself, and not for a number, a list or the word none."""
    try:
        return text == text.strip() and len(split(text)) == 1 and read_value(text) == text
    except SpecError:
        return False
