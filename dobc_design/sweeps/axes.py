"""What is varied: an axis is one key (or several that go together) and its values, listed, ranged or drawn.

    pinning.gains.1=1:5:9                    nine values, evenly spaced, both ends included, exact
    observer.rate=1e-2:10:7:log              seven values, evenly spaced ratios
    coupling.h=exp(y)-1+y,tanh(y)            these two
    pinning.gains.1,pinning.gains.6=1,5      both keys get the same value
    region.initial_disturbance=~uniform(0,1) drawn anew for every sample

Draws: uniform(a, b), loguniform(a, b), normal(mean, deviation), integers(a, b), choice(x, y, ...).  A drawn number is
rounded to six significant digits, so that every case can be typed into a file.  Draw number k of an axis depends on
the seed, the axis and k alone: every point of the grid sees the same draws, and more samples keep the first ones.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from random import Random
from statistics import NormalDist
from typing import Any

from dobc_design.errors import SpecError
from dobc_design.exact.number import parse_number
from dobc_design.exact.reading import is_list, shown
from dobc_design.sweeps.keys import Path, path_text, read_keys, split_axis
from dobc_design.sweeps.values import exact_text, read_value, split, value_text

MOST_VALUES = 1_000_000
DIGITS = 6  # of drawn numbers and of those with even ratios
_RANGE = re.compile(r"([^:,(\[{]+):([^:,(\[{]+):([0-9]{1,9})(:log)?")
_DRAW = re.compile(r"~\s*([a-z]+)\s*\((.*)\)")
_CURE = "For example 1:5:9, a list such as 1,2,5, or ~uniform(0,1)."
KINDS = ("uniform", "loguniform", "normal", "integers", "choice")


@dataclass(frozen=True, slots=True, kw_only=True)
class Draw:
    """A distribution: its kind, its numbers as text, or for "choice" the values."""

    kind: str
    arguments: tuple[str, ...]

    def value(self, seed: int, axis: str, sample: int) -> str:
        """The value of one sample, as text."""
        u = Random(f"{seed}|{axis}|{sample}").random()
        if self.kind == "choice":
            return self.arguments[int(u * len(self.arguments))]
        a, b = (Fraction(text) for text in self.arguments)
        if self.kind == "integers":
            return str(int(a) + int(u * (int(b) - int(a) + 1)))
        if self.kind == "loguniform":
            return _rounded(math.exp(math.log(a) + u * (math.log(b) - math.log(a))))
        if self.kind == "normal":
            return _rounded(NormalDist(float(a), float(b)).inv_cdf(min(max(u, 2.0**-53), 1 - 2.0**-53)))
        return _rounded(float(a) + u * float(b - a))


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """One key, or several with the same value; its ``values`` as text, or a ``draw``."""

    name: str
    keys: tuple[Path, ...]
    values: tuple[str, ...] = ()
    draw: Draw | None = None

    @property
    def text(self) -> str:
        """The axis in a line."""
        if self.draw is not None:
            return f"{self.name}=~{self.draw.kind}({','.join(self.draw.arguments)})"
        return f"{self.name}={','.join(self.values)}"


def read_axes(over: Mapping[str, Any] | Sequence[str]) -> tuple[Axis, ...]:
    """Axes from texts "KEY=VALUES", or from a mapping key -> values (text as typed, or a sequence).

    Raises: SpecError that names every wrong axis.
    """
    given = list(over.items()) if isinstance(over, Mapping) else [split_axis(text) for text in over]
    if not given:
        raise SpecError(
            "nothing is varied: a sweep needs at least one KEY=VALUES.",
            key="over",
            cure="For example pinning.gains.1=1:5:9.",
        )
    axes: list[Axis] = []
    errors: list[SpecError] = []
    for key, values in given:
        try:
            axes.append(_axis(key, values))
        except SpecError as error:
            errors.extend(SpecError(f"{key}: {each.message}", key=key, cure=each.cure) for each in error.errors)
    if errors:
        raise SpecError.several(errors)
    paths = [path for axis in axes for path in axis.keys]
    for path in paths:
        for other in paths:
            if path is not other and path == other[: len(path)]:
                raise SpecError(
                    "two axes set the same place, and one would undo the other.",
                    key=axes[0].name,
                    cure="Put keys that go together on one side: KEY,KEY=VALUES.",
                )
    return tuple(axes)


def _axis(key: str, given: Any) -> Axis:
    keys = read_keys(key)
    name = ",".join(path_text(path) for path in keys)
    if isinstance(given, str):
        found = _DRAW.fullmatch(given.strip())
        if found is not None:
            return Axis(name=name, keys=keys, draw=_draw(found[1], found[2]))
        if given.strip().startswith("~"):
            raise SpecError(f"{shown(given)} is no draw.", cure=f"~KIND(...), KIND one of {', '.join(KINDS)}.")
        values = _listed(given)
    else:
        values = tuple(value_text(each) for each in given) if is_list(given) else (value_text(given),)
    if not values or len(values) > MOST_VALUES:
        raise SpecError(f"there must be 1 to {MOST_VALUES} values; got {len(values)}.", cure=_CURE)
    if len(set(values)) < len(values):
        raise SpecError("a value stands there twice.", cure="Name each value once.")
    return Axis(name=name, keys=keys, values=values)


def _listed(text: str) -> tuple[str, ...]:
    found = _RANGE.fullmatch(text.strip())
    if found is not None:
        return _range(found[1], found[2], int(found[3]), even_ratios=bool(found[4]))
    values = tuple(split(text))
    for value in values:
        read_value(value)  # what cannot be read is said before anything runs
    return values


def _range(first: str, last: str, count: int, *, even_ratios: bool) -> tuple[str, ...]:
    a, b = parse_number(first.strip(), key="start"), parse_number(last.strip(), key="end")
    if count < 2 or a == b or count > MOST_VALUES:
        raise SpecError(
            f"START:END:COUNT needs two different ends and a count from 2 to {MOST_VALUES}; got {shown(count)}.",
            cure=_CURE,
        )
    if not even_ratios:
        return tuple(exact_text(a + (b - a) * k / (count - 1)) for k in range(count))
    if a <= 0 or b <= 0:
        raise SpecError(
            "START:END:COUNT:log needs ends > 0, because ratios are even.", cure="For example 0.01:10:7:log."
        )
    low, step = math.log(a), (math.log(b) - math.log(a)) / (count - 1)
    inner = (_rounded(math.exp(low + step * k)) for k in range(1, count - 1))
    return (exact_text(a), *inner, exact_text(b))


def _draw(kind: str, text: str) -> Draw:
    arguments = tuple(split(text))
    if kind == "choice" and arguments:
        for each in arguments:
            read_value(each)
        return Draw(kind=kind, arguments=arguments)
    if kind not in KINDS or len(arguments) != 2:
        raise SpecError(
            f"a draw must be uniform(a,b), loguniform(a,b), normal(mean,deviation), integers(a,b) or choice(x,y,...);"
            f" got {shown(f'{kind}({text})')}.",
            cure="For example ~uniform(0.1,1).",
        )
    a, b = (parse_number(each, key=f"~{kind}") for each in arguments)
    wrong = (
        "the second number must be > 0"
        if kind == "normal" and b <= 0
        else "both must be whole numbers"
        if kind == "integers" and (a.denominator, b.denominator) != (1, 1)
        else "both must be > 0"
        if kind == "loguniform" and a <= 0
        else "the first must be less than the second"
        if kind != "normal" and a >= b
        else None
    )
    if wrong is not None:
        raise SpecError(f"~{kind}({text}): {wrong}.", cure="For example ~uniform(0.1,1).")
    return Draw(kind=kind, arguments=(str(a), str(b)))


def _rounded(value: float) -> str:
    return exact_text(parse_number(float(f"{value:.{DIGITS}g}"), key="values"))
