"""What a number in a problem means, and its directed rounding."""

import math
import time
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dobc_design.errors import SpecError
from dobc_design.exact import float_above, float_below, number_text, parse_number
from dobc_design.exact.number import decimal_text, root_above, root_below

TEXTS = st.from_regex(
    r"[+-]?[0-9]{1,90}(\.[0-9]{1,90})?([eE][+-]?(400|[0-3]?[0-9]{1,2}))?", fullmatch=True
) | st.from_regex(r"[+-]?[0-9]{1,90}/[+-]?[0-9]{0,90}[1-9]", fullmatch=True)


@pytest.mark.parametrize(
    ("given_value", "meant"),
    [
        (3, Fraction(3)),
        (3.2, Fraction(16, 5)),
        ("3.2", Fraction(16, 5)),
        ("+16/5", Fraction(16, 5)),
        ("-16/-5", Fraction(16, 5)),
        ("1e-400", Fraction(1, 10**400)),
        ("2.50E+1", Fraction(25)),
        (-0.0, Fraction(0)),
        (5e-324, Fraction(5, 10**324)),
        (Decimal("1.10"), Fraction(11, 10)),
        (Decimal("1E+3"), Fraction(1000)),
        (Fraction(2, 6), Fraction(1, 3)),
        *((kind(0.1), Fraction(1, 10)) for kind in (np.float64, np.float32, np.float16)),
        (np.longdouble("0.1"), Fraction(1, 10)),
        (np.int64(-7), Fraction(-7)),
        (np.uint8(200), Fraction(200)),
    ],
)
def test_a_number_means_its_decimal_text(given_value, meant):
    """Contract: 3.2 is 16/5; theory, section 3."""
    assert parse_number(given_value, key="k") == meant


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_float_means_its_shortest_text(x):
    """Independent oracle: Fraction reads repr text by itself."""
    assert parse_number(x, key="k") == Fraction(repr(x))


@settings(max_examples=15)
@given(TEXTS)
def test_accepted_text_means_what_fraction_reads_and_can_be_written_and_read_again(text):
    """Fraction's own parser is the oracle (it takes no sign in a denominator)."""
    if len(text) <= 200:
        p, _, q = text.partition("/")
        number = parse_number(text, key="k")
        assert number == (Fraction(int(p), int(q)) if q else Fraction(text))
        assert parse_number(number_text(number), key="k") == number


NO_NUMBERS = "1_000 1_0.5 0x10 1e 1. .5 --1 1/2/3 1.5/2 inf nan -Infinity ٣ １ 1e5/2 one 1e1.5"


WRONG_TYPES = [True, False, np.True_, None, [1], b"1", 1j, np.array(1.0), object()]
NOT_FINITE = [math.nan, math.inf, -math.inf, np.float64("nan"), np.float32("inf")]
NOT_FINITE += [np.longdouble("inf"), Decimal("NaN"), Decimal("Infinity")]


@pytest.mark.parametrize(
    "bad", ["", " 1", "1 ", "1\n", *NO_NUMBERS.split(), *WRONG_TYPES, *NOT_FINITE]
)
def test_what_is_no_number_is_refused_with_its_key(bad):
    """Contract: ASCII, no booleans, no nan or inf, no underscores in text."""
    with pytest.raises(
        SpecError, match=r"^pinning\.gains\.1 must be a number such as 3\.2"
    ) as caught:
        parse_number(bad, key="pinning.gains.1")
    assert caught.value.key == "pinning.gains.1"


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        ("1e401", "exponent from -400 to 400"),
        ("1e-401", "exponent from -400 to 400"),
        ("1e99999999", "exponent from -400 to 400"),
        ("1e" + "9" * 190, "exponent from -400 to 400"),
        (Decimal("1e99999999"), "exponent from -400 to 400"),
        ("1" * 201, "at most 200 characters"),
        ("1/0", "denominator other than 0"),
        ("0/-0", "denominator other than 0"),
        (10**700, "writable in 200 characters"),
        pytest.param(10**9999, "writable in 200 characters", id="long"),
        (Fraction(1, 3**900), "writable in 200 characters"),
        (int("7" * 201), "writable in 200 characters"),
    ],
)
def test_oversized_numbers_are_refused_at_once(bad, reason):
    """Trap met: parse_float=Fraction hangs on 1e99999999; int() refuses beyond 4300 digits."""
    start = time.process_time()
    with pytest.raises(SpecError, match=f"k must (be|have) .*{reason}; got .{{1,60}}\\.$"):
        parse_number(bad, key="k")
    assert time.process_time() - start < 20


def test_the_largest_numbers_of_the_contract_are_accepted_and_others_named_by_their_type():
    assert parse_number("9" * 200, key="k") == 10**200 - 1
    found = parse_number(int("9" * 200), key="k")
    assert found == 10**200 - 1
    assert parse_number("1e400", key="k") == 10**400
    # repr of a list with a huge integer raises ValueError.
    with pytest.raises(SpecError, match=r"got list\.$"):
        parse_number([10**5000], key="k")


def test_a_short_decimal_is_shown_in_place_of_its_quotient():
    given = "1/2 -16/5 9/16 1/3 0 12000 1/1000000 1/10000000 1234567/10"
    shown = "0.5 -3.2 0.5625 1/3 0 12000 0.000001 1/10000000 1234567/10"
    for text, expected in zip(given.split(), shown.split(), strict=True):
        assert decimal_text(Fraction(text)) == expected


def test_text_of_a_number_of_any_length_is_a_quotient_or_a_decimal():
    """Architecture: number_text gives "16/5"."""
    assert number_text(Fraction(16, 5)) == "16/5"
    assert number_text(Fraction(-3)) == "-3"
    assert number_text(Fraction(0)) == "0"
    assert number_text(Fraction(1, 10**300)) == "1e-300"
    assert number_text(Fraction(1, 3**600)) == f"1/{3**600}"
    assert number_text(Fraction(1, 2**9990)) == f"1/{2**9990}"
    # Witnesses grow beyond the 4300 digits at which Python's int refuses to print.
    text = number_text(Fraction(10**6000 + 1, 7))
    assert text == "1" + "0" * 5999 + "1/7"
    assert number_text(Fraction(10**6000)) == "1" + "0" * 6000


@pytest.mark.parametrize(
    ("given_text", "written"),
    [
        *((text, text) for text in ("1230e400", "0.0025e-400", "-1e400", f"{'7' * 190}.25e-400")),
        *(("-1.25e-399", "-12.5e-400"), ("0.5e-250", "5e-251")),
    ],
)
def test_text_of_a_long_decimal_keeps_to_the_exponents_that_can_be_read(given_text, written):
    """The exponent is clamped at 400 and the point moved instead."""
    number = parse_number(given_text, key="k")
    assert number_text(number) == written
    assert parse_number(written, key="k") == number


@given(st.fractions() | st.floats(allow_nan=False, allow_infinity=False).map(Fraction))
def test_directed_roundings_are_the_neighbouring_floats(x):
    """Largest float <= x and smallest float >= x: equal iff x is a float, else adjacent."""
    below = float_below(x)
    above = float_above(x)
    assert Fraction(below) <= x <= Fraction(above)
    if Fraction(below) == x:
        assert above == below
    else:
        assert math.nextafter(below, math.inf) == above


def test_directed_rounding_at_the_ends_of_the_range():
    largest = math.nextafter(math.inf, 0)
    smallest = 5e-324
    huge = Fraction(10) ** 400
    tiny = Fraction(1, 10**400)
    assert float_below(huge) == largest
    assert float_above(huge) == math.inf
    assert float_below(-huge) == -math.inf
    assert float_above(-huge) == -largest
    assert float_below(tiny) == 0.0
    assert float_above(tiny) == smallest
    assert float_below(-tiny) == -smallest
    assert float_above(-tiny) == 0.0
    assert float_below(Fraction(largest)) == largest
    assert float_above(Fraction(largest)) == largest
    assert float_above(Fraction(largest) + tiny) == math.inf
    found = math.copysign(1, float_above(-tiny))
    assert found == math.copysign(1, float_below(tiny)) == 1


@given(st.fractions(min_value=0), st.integers(1, 10**12))
def test_roots_are_rounded_outwards_to_the_nearest_multiple(square, unit):
    """One unit less is below the root, one more above; squares of multiples come back."""
    low = root_below(square, unit=unit)
    high = root_above(square, unit=unit)
    step = Fraction(1, unit)
    assert low**2 <= square <= high**2
    assert (low + step) ** 2 > square
    assert high == 0 or (high - step) ** 2 < square
    found = root_above(low**2, unit=unit)
    assert found == root_below(low**2, unit=unit) == low
