"""Numbers that a certificate claims: floats on the safe side, read back as the decimal text they
show.

Rationals of a certificate may be longer than a number that somebody types: they come out of
arithmetic.

How a rate, a radius or a bound is rounded: ``rounded_down`` and ``rounded_up`` give rationals of a
few digits; a proved rational becomes the number of a check by ``decimal_below`` or
``decimal_above``, which keep it where it has no more digits; a number that was only estimated is
cut by ``shorten``, and ``largest_proved`` tries a few below it.  ``text_below`` and ``text_above``
are for sentences.
"""

import math
from base64 import b64decode, b64encode
from collections.abc import Callable, Iterable, Mapping
from fractions import Fraction
from operator import itemgetter
from typing import Any, TypeVar

import numpy as np

from dobc_design.exact.interval import Interval
from dobc_design.exact.matrix import Array, Matrix, Vector
from dobc_design.exact.number import (
    ZERO,
    common_denominator,
    float_above,
    float_below,
    number_text,
    read_text,
)
from dobc_design.exact.reading import Document
from dobc_design.exact.symmetric import Doubles

Real = TypeVar("Real", float, Fraction)
T = TypeVar("T")

SHRINK = (1e-9, 1e-6, 1e-3, 0.1, 0.5)
LONGEST = 10_000  # characters of a rational in a certificate
VECTOR_BITS = 65_536  # of the common denominator of a vector
MATRIX_BITS = 16_384  # of that of P, and of a designed W
LARGEST = Fraction(10) ** 300  # numbers above are no radii
MANY_AGENTS = 1000  # from which on vectors travel as doubles
_DIGITS = 12  # of a decimal that is rounded up
MOST_HALVINGS = 2000  # of a search that ends by itself: floats have 2100 powers of two


def claimed(value: float) -> Fraction:
    """The exact number a claimed float stands for: its shortest decimal text.  Raises ValueError
    for nan and inf."""
    return Fraction(repr(float(value)))


def shorten(value: float | Fraction, *, digits: int = 9) -> float:
    """Round down to about ``digits`` digits, ``claimed`` of it included; 0.0 for what is not
    positive and finite."""
    if isinstance(value, float) and not math.isfinite(value):
        return 0.0
    below = float_below(Fraction(value))
    if below <= 0:
        return 0.0
    exponent = math.floor(math.log10(below)) - digits + 1
    shorter = float(f"{int(Fraction(below) / Fraction(10) ** exponent)}e{exponent}")
    return shorter if claimed(shorter) <= value else 0.0  # floats below 1e-307 have few digits


def text_below(value: float | Fraction, *, digits: int = 4) -> str:
    """A number > 0 as a sentence shows it, with so many digits, rounded down: a rate that is shown
    is one that is proved, and a float is the decimal that it is claimed as."""
    exact = claimed(value) if isinstance(value, float) else value
    return f"{float(rounded_down(exact, digits=digits)):.{digits}g}"


def text_above(value: Fraction, *, digits: int) -> str:
    """A number >= 0 as a sentence shows it, with so many digits, rounded up: a bound, a cost."""
    return f"{float(rounded_up(value, digits=digits)):.{digits}g}"


def rounded_down(value: Fraction | float, *, digits: int = 9) -> Fraction:
    """A decimal number of ``digits`` digits, at most ``value`` >= 0 and the same if that has no
    more."""
    value = Fraction(value)
    if value <= 0:
        return ZERO
    # Within two powers of ten at first, below: numbers may have thousands of digits.
    size = (value.numerator.bit_length() - value.denominator.bit_length()) * Fraction(30103, 10**5)
    unit = Fraction(10) ** (digits - 3 - math.floor(size))
    while value * unit < 10 ** (digits - 1):
        unit *= 10
    return Fraction(math.floor(value * unit)) / unit


def rounded_up(value: Fraction, *, digits: int) -> Fraction:
    """A decimal number of ``digits`` digits, at least ``value`` >= 0 and the same if that has no
    more."""
    below = rounded_down(value, digits=digits)
    if below == value:
        return below
    return below + Fraction(10) ** (math.floor(math.log10(below)) - digits + 1) if below else below


def decimal_below(value: Fraction) -> float:
    """A decimal number of at most nine digits that does not exceed ``value`` > 0; the same if it
    has no more."""
    found = float(rounded_down(value))
    return found if claimed(found) <= value else shorten(value)


def decimal_above(value: Fraction) -> float:
    """A decimal number >= ``value`` >= 0 of at most twelve digits; those beyond the floats are
    cut."""
    if value <= 0:
        return 0.0
    # No radius is so large; the digits of such numbers take long.
    if value > LARGEST:
        return float(LARGEST)
    unit = Fraction(10) ** (_DIGITS - 1 - len(str(int(value))))
    found = float(math.ceil(value * unit) / unit)
    return (
        found
        if claimed(found) >= value
        else float_above(claimed(found) * (1 + Fraction(1, 10**14)))
    )


def bisected(
    holds: Callable[[Real], bool],
    low: Real,
    high: Real,
    *,
    steps: int = MOST_HALVINGS,
    middle: Callable[[Real, Real], Real] | None = None,
    close: Callable[[Real, Real], bool] | None = None,
) -> tuple[Real, Real]:
    """The interval from ``low``, where something holds, to ``high``, which may be the smaller one,
    cut so many times around where it ceases to, or until its ends are ``close``.  ``middle`` says
    where it is cut; by default it is halved."""
    for _ in range(steps):
        if close is not None and close(low, high):
            break
        place = (low + high) / 2 if middle is None else middle(low, high)
        if holds(place):
            low = place
        else:
            high = place
    return low, high


def last_found(
    find: Callable[[Real, T], T | None],
    found: T,
    low: Real,
    high: Real,
    *,
    steps: int = MOST_HALVINGS,
    middle: Callable[[Real, Real], Real] | None = None,
    close: Callable[[Real, Real], bool] | None = None,
) -> tuple[Real, T]:
    """The last place at which ``bisected`` finds something, and that: from ``found`` at ``low`` on,
    ``find`` is asked with a place and what was found before."""

    def holds(place: Real) -> bool:
        nonlocal found
        there = find(place, found)
        if there is None:
            return False
        found = there
        return True

    last, _ = bisected(holds, low, high, steps=steps, middle=middle, close=close)
    return last, found


def quickly_down(divisor: int) -> Callable[[float, float], float]:
    """Where to cut an interval whose answer may be many powers of ten below its upper end: the end
    over ``divisor`` as long as nothing holds but 0, then the middle."""
    return lambda low, high: (low + high) / 2 if low else high / divisor


def golden_section(f: Callable[[float], float], low: float, high: float, *, steps: int) -> None:
    """Evaluate f at ``steps`` places that close in on its minimum between two ends."""
    part = (math.sqrt(5) - 1) / 2
    left = high - part * (high - low)
    right = low + part * (high - low)
    values = {left: f(left), right: f(right)}
    for _ in range(steps - 2):
        if values[left] <= values[right]:
            high = right
            right = left
            left = high - part * (high - low)
            values[left] = f(left)
        else:
            low = left
            left = right
            right = low + part * (high - low)
            values[right] = f(right)


def soonest(
    find: Callable[[float], tuple[float, T] | None],
    *,
    first: float,
    longest: float,
    least: float,
    steps: int,
) -> list[tuple[float, T]]:
    """What ``find`` gives at rates from ``least`` to ``longest`` (1/s), with its time to one
    percent (s): by a search for the least time, the soonest first.  Rates at which nothing is
    sooner than ``first`` (s), even with the factor 1, are left out."""
    found: list[tuple[float, T]] = []

    def time_at(rate: float) -> float:
        there = find(rate)
        if there is None:
            return math.inf
        found.append(there)
        return there[0]

    shortest = max(math.log(100) / first, least)
    if shortest < longest:
        golden_section(time_at, shortest, longest, steps=steps)
    return sorted(found, key=itemgetter(0))


def follows(rate: float | None, proved: Fraction) -> bool:
    """Whether a claimed rate is > 0 and at most the proved one."""
    return rate is not None and rate > 0 and claimed(rate) <= proved


def time_to_one_percent(rate: float | None, factor: float | None) -> float:
    """After how many seconds factor exp(-rate t) is a hundredth: ln(100 factor) / rate; infinite
    where one is None."""
    if not rate or factor is None:
        # Without a rate nothing is known of when.
        return math.inf
    return (math.log(100) + math.log(factor)) / rate


def largest_proved(estimate: float, holds: Callable[[Fraction], bool]) -> float | None:
    """The first number a little below ``estimate`` for which ``holds`` proves the claim; 0 last;
    None if none."""
    if estimate > 0 and math.isfinite(estimate):
        for part in SHRINK:
            candidate = shorten(estimate * (1 - part))
            if candidate > 0 and holds(claimed(candidate)):
                return candidate
    return 0.0 if holds(ZERO) else None


def read_rational(text: object, *, key: str = "certificate") -> Fraction:
    """Read a rational of a certificate, "-9/8", "3" or "1e-300": text of at most 10000 characters.
    Raises: SpecError or ValueError for anything else, JSON numbers included."""
    if not isinstance(text, str) or len(text) > LONGEST:
        raise ValueError(f"{key} must be a rational as text of at most {LONGEST} characters")
    return read_text(text, key=key, longest=LONGEST)


def is_writable(P: Matrix, *others: Matrix) -> bool:
    """Whether a certificate can hold P and what follows from it: no entry too long, nor the common
    denominator of P."""
    texts = (number_text(x) for matrix in (P, *others) for row in matrix for x in row)
    return all(len(text) <= LONGEST for text in texts) and is_short(P)


def is_short(matrix: Matrix) -> bool:
    """Whether the entries of a matrix have a common denominator that a certificate may hold."""
    return has_short_denominator((x for row in matrix for x in row), MATRIX_BITS)


def has_short_denominator(values: Iterable[Fraction], limit: int) -> bool:
    """Whether the common denominator has at most ``limit`` bits; stops as soon as it has more."""
    return common_denominator(values, bits=limit) is not None


def doubles_to_json(doubles: Array) -> dict[str, str]:
    """The base64 of little-endian doubles, each of which means exactly what it is."""
    return {"float64": b64encode(doubles.astype("<f8").tobytes()).decode("ascii")}


def doubles_from_json(data: object) -> Array:
    """Read finite doubles back.  Raises: TypeError or ValueError for anything else."""
    if (
        not isinstance(data, dict)
        or set(data) != {"float64"}
        or not isinstance(data["float64"], str)
    ):
        raise TypeError("doubles must be an object with float64, text in base64")
    doubles = np.frombuffer(b64decode(data["float64"], validate=True), dtype="<f8").astype(
        np.float64
    )
    if not np.all(np.isfinite(doubles)):
        raise ValueError("every number must be finite")
    return doubles


def as_json(value: Any) -> Any:
    """A part of a claim as a certificate holds it: rationals as text, sequences as lists, an
    interval as its two ends, nouns by their ``to_json``."""
    if isinstance(value, Fraction):
        return number_text(value)
    if isinstance(value, Interval):
        return [number_text(value.lo), number_text(value.hi)]
    if isinstance(value, Mapping):
        return {name: as_json(each) for name, each in value.items()}
    if isinstance(value, (tuple, list)):
        return list(map(as_json, value))
    return value.to_json() if hasattr(value, "to_json") else value


def fields_to_json(noun: object, *names: str) -> Document:
    """These fields of a noun, in this order.  A vector with an entry for each of very many agents
    travels by ``vector_to_json`` instead."""
    return {name: as_json(getattr(noun, name)) for name in names}


def known_to_json(noun: object, *names: str) -> Document:
    """The same without those that are None: readers refuse null in their place."""
    values = fields_to_json(noun, *names)
    return {name: value for name, value in values.items() if value is not None}


def rational_or_none(data: object) -> Fraction | None:
    """Read a rational or null.  Raises: as ``read_rational``."""
    return None if data is None else read_rational(data)


def positive_from_json(data: object) -> Fraction:
    """Read a rational > 0.  Raises: as ``read_rational``."""
    number = read_rational(data)
    if number <= 0:
        raise ValueError(f"a number must be > 0, got {data}")
    return number


def whole_from_json(data: object) -> int:
    """Read a whole number.  Raises: TypeError for anything else."""
    if type(data) is not int:
        raise TypeError(f"a whole number was expected, got {str(data)[:60]!r}")
    return data


def matrix_from_json(rows: Any) -> Matrix:
    """Read rows of rationals.  Raises: KeyError, TypeError or ValueError for anything else."""
    return tuple(tuple(read_rational(entry) for entry in row) for row in rows)


def form_from_json(rows: Any) -> Matrix:
    """The same for a P, whose entries need a short common denominator."""
    # What is decided of P multiplies its digits.
    P = matrix_from_json(rows)
    if not is_short(P):
        raise ValueError("P needs too long a common denominator")
    return P


def vector_to_json(v: Vector | Doubles) -> list[str] | dict[str, str]:
    """A list of rationals, or for many agents the base64 of little-endian doubles where those are
    exact."""
    # Text of very many numbers takes long to write and to read.
    if len(v) > MANY_AGENTS:
        doubles = v.array if isinstance(v, Doubles) else np.array([float(x) for x in v])
        if isinstance(v, Doubles) or all(
            Fraction(x) == y for x, y in zip(doubles.tolist(), v, strict=True)
        ):
            return doubles_to_json(doubles)
    return [number_text(x) for x in v]


def vector_from_json(data: object, size: int) -> Vector | Doubles:
    """Read ``size`` numbers.  Raises: KeyError, TypeError or ValueError for anything else."""
    v: Vector | Doubles
    if isinstance(data, list):
        v = tuple(read_rational(text) for text in data)
        if not has_short_denominator(v, VECTOR_BITS):
            raise ValueError("the vector needs too long a common denominator")
    else:
        v = Doubles(doubles_from_json(data))
    if len(v) != size:
        raise ValueError(f"expected {size} numbers, got {len(v)}")
    return v
