"""Claimed numbers: decimal text, rounded towards the weaker claim; rationals of any sensible
length."""

import math
from fractions import Fraction
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dobc_design.checker.reading import Refused, rational, short
from dobc_design.conditions.numbers import (
    LONGEST,
    MATRIX_BITS,
    VECTOR_BITS,
    bisected,
    claimed,
    decimal_above,
    has_short_denominator,
    largest_proved,
    last_found,
    quickly_down,
    read_rational,
    shorten,
    text_above,
    text_below,
)
from dobc_design.errors import SpecError
from dobc_design.exact.number import number_text


@given(st.floats(min_value=0, allow_infinity=False, allow_nan=False))
def test_shorten_never_rounds_up_even_as_decimal_text(value):
    shorter = shorten(value)
    assert claimed(shorter) <= Fraction(value)
    if value > 1e-300:
        assert shorter >= value * (1 - 1e-8)


@given(st.fractions(min_value=0, max_value=10**400))
def test_shorten_takes_rationals_beyond_the_floats(value):
    assert claimed(shorten(value)) <= value


@pytest.mark.parametrize(
    "value", [0.0, -1.0, float("nan"), float("inf"), -float("inf"), 5e-324, Fraction(1, 10**400)]
)
def test_shorten_gives_zero_for_what_cannot_be_claimed(value):
    assert shorten(value) == 0.0 or claimed(shorten(value)) <= value
    assert shorten(-1.0) == shorten(float("inf")) == 0.0


def test_claimed_is_the_text_and_not_the_binary_number():
    assert claimed(0.1) == Fraction(1, 10)
    assert Fraction(0.1) != Fraction(1, 10)
    with pytest.raises(ValueError, match="Invalid literal"):
        claimed(float("nan"))


def test_the_largest_proved_number_lies_just_below_a_good_estimate():
    found = largest_proved(2.0, lambda x: x < 2)
    assert found == pytest.approx(2.0, rel=1e-8)
    found = largest_proved(2.1, lambda x: x < 2)
    assert found == pytest.approx(1.89)
    assert largest_proved(2.0, lambda x: x <= 0) == 0.0
    assert largest_proved(2.0, lambda x: False) is None
    no_answers = (math.nan, -1.0, math.inf)
    found = [largest_proved(x, lambda x: x < 2) for x in no_answers]
    assert found == [0.0] * 3


def test_decimals_are_never_below_what_is_asked():
    for value in (
        "1/3",
        "4",
        "0.1",
        "1e-9",
        "123456789.123456789123",
        "2/7",
        "1e17",
        "99999999999999999999",
    ):
        exact = Fraction(value)
        found = claimed(decimal_above(exact))
        assert exact <= found <= exact * (1 + Fraction(1, 10**9)) + Fraction(1, 10**9)
    numbers = ("4", "0.5", "0.1", "0")
    answer = [decimal_above(Fraction(x)) for x in numbers]
    assert answer == [4.0, 0.5, 0.1, 0.0]


@given(st.fractions())
def test_rationals_read_back_as_they_were_written(value):
    assert read_rational(number_text(value)) == value


@pytest.mark.parametrize("digits", [150, 201, 4299, 4301, 6000])
def test_long_rationals_are_read_in_pieces(digits):
    """Python refuses more than 4300 digits at once."""
    value = Fraction(-(10**digits) - 7, 3**digits)
    assert read_rational(number_text(value)) == value


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("9" * 300 + "e5", (10**300 - 1) * 10**5),
        ("-" + "9" * 300 + "e-0400", Fraction(1 - 10**300, 10**400)),
        ("+0." + "0" * 300 + "5E+1", Fraction(5, 10**300)),
        ("-" + "6" * 300 + "/-" + "3" * 300, 2),
        ("-0." + "0" * 300 + "e7", 0),
    ],
)
def test_long_decimals_follow_the_grammar_of_short_ones(text, value):
    """docs/certificate-format.md: any rational of a certificate may have 10 000 characters."""
    assert read_rational(text) == value
    assert rational(text) == value


@given(st.integers(-(10**320), 10**320), st.integers(-300, 300))
def test_values_beyond_the_floats_read_back_as_they_were_written(digits, exponent):
    value = Fraction(digits) * Fraction(10) ** exponent
    assert read_rational(number_text(value)) == rational(number_text(value)) == value


SHORT = (
    "1/0",
    "nan",
    "inf",
    "1_000",
    " 1",
    "0x10",
    "",
    "1/2/3",
    "--1",
    "١٢",
    "9_" * 150,
    "٣" * 300,
)
LONG = ("1" * (LONGEST + 1), *("9" * 300 + end for end in ("/0", "e401", "e-401", ".e5", "\n")))


@pytest.mark.parametrize("text", [*SHORT, *LONG])
def test_other_texts_are_refused(text):
    with pytest.raises((SpecError, ValueError), match="must"):
        read_rational(text)


def test_json_numbers_are_no_rationals():
    for value in (1, 1.5, None, True, ["1"], {}):
        with pytest.raises(ValueError, match="must be a rational as text"):
            read_rational(value)


@pytest.mark.parametrize("bits", [VECTOR_BITS, MATRIX_BITS])
def test_both_programs_take_common_denominators_as_long_as_the_format_page_says(bits: int):
    docs = Path(__file__).parents[2] / "docs"
    page = (docs / "certificate-format.md").read_text("utf-8")
    assert f"{bits:,}".replace(",", " ") in page
    smallest = Fraction(1, 2 ** (bits - 1))
    fits = [smallest, Fraction(3, 4)]
    assert has_short_denominator(fits, bits)
    short(fits, bits)
    values = [*fits, Fraction(1, 3)]
    assert not has_short_denominator(values, bits)
    numbers = [*fits, Fraction(1, 3)]
    with pytest.raises(Refused, match="common denominator"):
        short(numbers, bits)


@given(st.fractions(min_value=Fraction(1, 10**6), max_value=10**6), st.sampled_from([3, 4, 6]))
def test_a_sentence_shows_a_number_that_holds(value: Fraction, digits: int):
    below = Fraction(text_below(value, digits=digits))
    above = Fraction(text_above(value, digits=digits))
    assert below <= value <= above
    assert above - below <= value * Fraction(25, 10**digits)


def test_a_sentence_shows_the_decimal_that_a_float_is_claimed_as():
    """The double 0.1475 lies below 1475/10000, which it stands for, as in tables of a sweep."""
    assert Fraction(0.1475) < Fraction("0.1475")
    assert text_below(0.1475) == "0.1475"
    assert text_below(0.14759) == "0.1475"


@pytest.mark.parametrize(("low", "high"), [(0.0, 8.0), (8.0, 0.0)])
def test_a_bisection_halves_from_the_end_that_holds_whichever_is_larger(low: float, high: float):
    """Three halvings of eight leave one."""
    found = bisected(lambda x: abs(x - low) <= 5.5, low, high, steps=3)
    assert found == ((5.0, 6.0) if low < high else (3.0, 2.0))


def test_a_bisection_of_rationals_stays_exact():
    low, high = bisected(lambda x: 3 * x <= 1, Fraction(0), Fraction(1), steps=10)
    assert low <= Fraction(1, 3) < high
    assert high - low == Fraction(1, 2**10)


def test_a_bisection_ends_where_its_ends_are_close():
    asked: list[float] = []

    def holds(x: float) -> bool:
        asked.append(x)
        return x <= 0.3

    low, high = bisected(holds, 0.0, 1.0, close=lambda low, high: high - low <= 0.25)
    assert asked == [0.5, 0.25]
    assert (low, high) == (0.25, 0.5)


def test_what_was_found_last_belongs_to_the_place_and_is_handed_on():
    """Each search starts from what the one before found."""
    starts: list[str] = []

    def find(x: float, before: str) -> str | None:
        starts.append(before)
        return f"at {x}" if x <= 6 else None

    found = last_found(find, "nothing", 0.0, 8.0, steps=3)
    assert found == (6.0, "at 6.0")
    assert starts == ["nothing", "at 4.0", "at 6.0"]


def test_nothing_that_is_found_leaves_what_there_was():
    found = last_found(lambda x, before: None, "nothing", 0.0, 8.0, steps=3)
    assert found == (0.0, "nothing")


def test_an_answer_far_below_the_end_is_met_by_dividing():
    asked: list[float] = []

    def holds(x: float) -> bool:
        asked.append(x)
        return x <= 0.02

    bisected(holds, 0.0, 8.0, steps=5, middle=quickly_down(8))
    assert asked == [1.0, 0.125, 0.015625, 0.0703125, 0.04296875]
