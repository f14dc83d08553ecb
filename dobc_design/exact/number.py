"""Rational numbers in and out: what a number in a problem means, and its directed rounding to a
float.

A number is read as the decimal text the user sees: 3.2 is 16/5, not the nearest binary fraction.
Text is checked before it is converted, so hostile text (1e99999999) costs nothing. Whatever is
accepted here can be written by ``number_text`` and read back unchanged.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from decimal import Decimal
from fractions import Fraction
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np

from dobc_design.errors import SpecError, wrong

# as a caller gives one; a float means its shortest decimal text
Number = int | float | str | Decimal | Fraction

if TYPE_CHECKING:
    from flint import fmpq, fmpq_mat


def to_fmpq(value: Fraction) -> fmpq:
    """Return the same rational as a flint number."""
    from flint import fmpq

    return fmpq(value.numerator, value.denominator)


def from_fmpq(value: fmpq) -> Fraction:
    """Return the same rational as a Fraction."""
    return Fraction(int(value.p), int(value.q))


def to_fmpq_mat(rows: Sequence[Sequence[Fraction]]) -> fmpq_mat:
    """Return the same matrix, of at least one row, as a flint matrix."""
    from flint import fmpq_mat

    return fmpq_mat(len(rows), len(rows[0]), [to_fmpq(entry) for row in rows for entry in row])


def from_fmpq_mat(matrix: fmpq_mat) -> tuple[tuple[Fraction, ...], ...]:
    """Return the same matrix as a tuple of row tuples."""
    return tuple(tuple(from_fmpq(entry) for entry in row) for row in matrix.tolist())


ZERO: Final = Fraction(0)
ONE: Final = Fraction(1)

MAX_CHARACTERS: Final = 200
MAX_EXPONENT: Final = 400
_DECIMAL: Final = re.compile(r"([+-]?)([0-9]+)(?:\.([0-9]+))?(?:[eE]([+-]?[0-9]+))?")
# What people write behind a number, and what that is times the unit of a key.
_UNITS: Final = {
    "%": ("1/100", ""),
    "ms": ("1/1000", "s"),
    "min": ("60", "s"),
    "s": ("1", "s"),
    "khz": ("1000", "Hz"),
    "hz": ("1", "Hz"),
    "rad/s": ("1", "rad/s"),
    "1/s": ("1", "1/s"),
    "/s": ("1", "1/s"),
    "m": ("1", "m"),
    "m/s": ("1", "m/s"),
    "": ("1", ""),
}
_WITH_UNIT: Final = re.compile(rf"({_DECIMAL.pattern})\s*({'|'.join(_UNITS)})")
_QUOTIENT: Final = re.compile(r"([+-]?[0-9]+)/([+-]?[0-9]+)")
# Longest numerator or denominator that MAX_CHARACTERS with MAX_EXPONENT can spell, in bits.
_MAX_BITS: Final = 2000
# Python refuses to print integers of more digits than this (sys.set_int_max_str_digits).
_PLAIN_BITS: Final = 10_000
_SHORT: Final = 6  # digits of a decimal that is read more easily than a quotient
_EXAMPLES: Final = 'a number such as 3.2, 1e-3 or "9/16"'


def height(value: Fraction) -> int:
    """Return the bits of the longer one of numerator and denominator."""
    return max(value.numerator.bit_length(), value.denominator.bit_length())


def parse_number(value: object, key: str) -> Fraction:
    """Return the exact rational that a number in a problem means.

    Accepts int, Fraction, Decimal, float, NumPy integers and floats (a float means its shortest
    decimal text), and text: an optional sign, digits, an optional fraction part and exponent, or
    a quotient "p/q" of integers; ASCII, at most 200 characters, exponent at most 400 either way.
    Raises: SpecError with ``key`` for anything else, booleans, nan and inf included.
    """
    if isinstance(value, (bool, np.bool_)):
        raise _refusal(key, value, f"must be {_EXAMPLES}, not a boolean")
    if isinstance(value, (int, Fraction)):
        number = Fraction(value)
        bits = height(number)
        if bits > _MAX_BITS or len(number_text(number)) > MAX_CHARACTERS:
            shown = f"a number of {bits} bits" if bits > _MAX_BITS else None
            raise _refusal(key, value, f"must be writable in {MAX_CHARACTERS} characters", shown)
        return number
    if isinstance(value, np.integer):
        return Fraction(int(value))
    if isinstance(value, float):
        # float.__repr__ also for subclasses, whose own repr may be anything.
        return read_text(float.__repr__(value), key=key, given=value)
    if isinstance(value, np.floating):
        return read_text(np.format_float_scientific(value, trim="-"), key=key, given=value)
    if isinstance(value, (str, Decimal)):
        return read_text(str(value), key=key, given=value)
    raise _refusal(key, value, f"must be {_EXAMPLES}")


def number_key(value: object) -> str:
    """A key for dictionaries of numbers as they are given: all multiples of 2^61 - 1 have the same
    hash."""
    if isinstance(value, (int, Fraction)):
        return f"{value.numerator:x}/{value.denominator:x}"
    return repr(value)


def typed_number(value: Fraction) -> int | float | str:
    """A rational as somebody would type it: 5, 0.42, "9/16"; reading it gives the number back."""
    if value.denominator == 1 and abs(value) < 10**15:
        return int(value)
    decimal = nearest(value)
    if math.isfinite(decimal) and Fraction(repr(decimal)) == value:
        return decimal
    return number_text(value)


def number_text(value: Fraction) -> str:
    """Return "16/5", "3", or a decimal ("1e-300") where a quotient would be too long; reading gives
    it back."""
    quotient = quotient_text(value)
    long = height(value) > _PLAIN_BITS
    parts = None if long or len(quotient) <= MAX_CHARACTERS else decimal_parts(abs(value))
    return quotient if parts is None else f"{'-' if value < 0 else ''}{with_exponent(*parts)}"


def decimal_text(value: Fraction) -> str:
    """Return the number as people read it: "3.2" where a short decimal is exact, else "1/3";
    reading gives it back."""
    parts = decimal_parts(abs(value))
    if parts is None or len(parts[0]) > _SHORT or not -_SHORT <= parts[1] <= 0:
        return number_text(value)
    return f"{'-' if value < 0 else ''}{without_exponent(*parts)}"


def decimal_parts(value: Fraction) -> tuple[str, int] | None:
    """Return digits and exponent with value = digits 10^exponent >= 0, no 0 at the end; None if it
    is no decimal."""
    places = MAX_CHARACTERS + MAX_EXPONENT  # no text gives more
    scaled = value * 10**places
    if scaled.denominator != 1:
        return None
    whole = str(scaled.numerator)
    digits = whole.rstrip("0")
    return (digits, len(whole) - len(digits) - places) if digits else ("0", 0)


def without_exponent(digits: str, exponent: int) -> str:
    """Return the number digits 10^exponent in plain digits."""
    if exponent >= 0:
        return digits + "0" * exponent
    digits = digits.zfill(1 - exponent)
    return f"{digits[:exponent]}.{digits[exponent:]}"


def with_exponent(digits: str, exponent: int) -> str:
    """Return the same with an exponent that parse_number takes."""
    limited = max(-MAX_EXPONENT, min(MAX_EXPONENT, exponent))
    return f"{without_exponent(digits, exponent - limited)}e{limited}"


def quotient_text(value: Fraction) -> str:
    """Return "16/5", or "3" for an integer, however long that is: for texts that are compared as
    they are."""
    if height(value) <= _PLAIN_BITS:
        return str(value)
    from flint import fmpz

    numerator = fmpz(value.numerator).str()  # Python itself refuses to print so many digits
    return numerator if value.denominator == 1 else f"{numerator}/{fmpz(value.denominator).str()}"


def root_above(square: Fraction | int, *, unit: int) -> Fraction:
    """Return the least multiple of 1/unit that is not below the root of ``square`` >= 0."""
    # isqrt rounds down: one unit more, unless it is exact.
    wanted = math.ceil(square * unit * unit)
    root = math.isqrt(wanted)
    return Fraction(root + (root * root < wanted), unit)


def root_below(square: Fraction | int, *, unit: int) -> Fraction:
    """Return the largest multiple of 1/unit that is not above the root of ``square`` >= 0."""
    return Fraction(math.isqrt(math.floor(square * unit * unit)), unit)


def float_below(value: Fraction | int) -> float:
    """Return the largest float <= value: the largest finite one, or -inf, on overflow."""
    try:
        nearest = value.numerator / value.denominator
    except OverflowError:
        return -math.inf if value < 0 else math.nextafter(math.inf, 0.0)
    # The quotient is the nearest float: at most one step too high.
    top, bottom = nearest.as_integer_ratio()
    return (
        math.nextafter(nearest, -math.inf)
        if top * value.denominator > value.numerator * bottom
        else nearest + 0.0
    )


def float_above(value: Fraction | int) -> float:
    """Return the smallest float >= value: the most negative finite one, or inf, on overflow."""
    return 0.0 - float_below(-value)


def nearest(x: Fraction) -> float:
    """Return the nearest float, or an infinity beyond them."""
    try:
        return float(x)
    except OverflowError:
        return math.inf if x > 0 else -math.inf


def common_denominator(values: Iterable[Fraction], *, bits: int, start: int = 1) -> int | None:
    """Return the least common multiple of the denominators and ``start``; None as soon as it has
    more than ``bits``."""
    common = start
    for value in values:
        if common % value.denominator:
            common = math.lcm(common, value.denominator)
            if common.bit_length() > bits:
                return None
    return common


def read_text(
    text: str, *, key: str, longest: int = MAX_CHARACTERS, given: object = None
) -> Fraction:
    """The number of a text of at most ``longest`` characters.  Raises: SpecError, which shows what
    was ``given``."""
    refusal = partial(_refusal, key, text if given is None else given)
    # Refused before it is read: long text would cost more than any number is worth.
    if len(text) > longest:
        raise refusal(f"must have at most {longest} characters")
    quotient = _QUOTIENT.fullmatch(text)
    if quotient:
        denominator = _integer(quotient[2])
        if not denominator:
            raise refusal("must have a denominator other than 0")
        return Fraction(_integer(quotient[1]), denominator)
    decimal = _DECIMAL.fullmatch(text)
    if not decimal:
        raise refusal(f"must be {_EXAMPLES}", cure=_number_alone(text, key))
    sign = decimal[1]
    whole = decimal[2]
    part = decimal[3] or ""
    exponent = _integer(decimal[4] or "0")
    # The power of 10 is written out below.
    if abs(exponent) > MAX_EXPONENT:
        raise refusal(f"must have an exponent from -{MAX_EXPONENT} to {MAX_EXPONENT}")
    return Fraction(_integer(sign + whole + part)) * Fraction(10) ** (exponent - len(part))


def _number_alone(text: str, key: str) -> str | None:
    """The cure for a number with its unit, or in the writing of another language."""
    plain = text.replace(",", ".").replace("\u2212", "-")
    found = _WITH_UNIT.fullmatch(plain.strip().lower())
    if not found:
        return None
    factor, unit = _UNITS[found[6]]
    value = decimal_text(read_text(found[1], key=key) * Fraction(factor))
    return f"Write {value}, without the unit, if {key} is in {unit}." if unit else f"Write {value}."


def _integer(digits: str) -> int:
    """An integer of any length: Python itself refuses to read more than 4300 digits at once."""
    if len(digits) <= MAX_CHARACTERS:
        return int(digits)
    from flint import fmpz

    return int(fmpz(digits.removeprefix("+")))


def _refusal(
    key: str, value: object, must: str, shown: str | None = None, cure: str | None = None
) -> SpecError:
    if shown is None:
        try:
            shown = repr(value)
        except ValueError:  # an integer with more digits than Python prints
            shown = type(value).__name__
    shown = shown if len(shown) <= 60 else shown[:57] + "..."
    return wrong(key, f"{must}; got {shown}.", cure)
