"""Showing exact numbers: short ones exactly, long ones rounded, any size without a crash."""

from fractions import Fraction
from typing import Any

import pytest

from dobc_design._show import text as shown
from dobc_design._show.text import latex_matrix, latex_number, latex_text, mathml, significant

SHOWN: list[Any] = [
    (Fraction(16, 5), "3.2"),
    (Fraction(16, 7), r"\frac{16}{7}"),
    (Fraction(-9, 8), "-1.125"),
    (Fraction(7), "7"),
    (Fraction(1, 3**30), r"4.8569\cdot 10^{-15}"),
    (Fraction(10) ** 400, r"1\cdot 10^{400}"),
    (Fraction(-1, 10**400), r"-1\cdot 10^{-400}"),
    (Fraction(10**20000), r"1\cdot 10^{20000}"),
]


@pytest.mark.parametrize(("value", "shown"), SHOWN)
def test_a_rational_is_shown_exactly_if_short_and_rounded_if_long(value: Fraction, shown: str):
    assert latex_number(value) == shown


def test_numbers_are_rounded_for_display_and_bounds_to_the_safe_side():
    assert significant(Fraction(2, 3)) == "0.6667"
    assert significant(0.5823004) == "0.5823"
    assert significant(None) == "–"
    assert shown.significant_away_from_zero(Fraction(2, 3)) == "0.6667"
    assert shown.significant_away_from_zero(Fraction(1, 3), 2) == "0.34"
    assert shown.significant_away_from_zero(0.5, 2) == "0.5"
    assert shown.significant_away_from_zero(None) == "–"
    assert shown.significant_towards_zero(-0.12349999) == "-0.1234"


def test_a_matrix_larger_than_twelve_is_not_shown():
    assert latex_matrix(((Fraction(1),) * 13,)) is None
    assert (
        latex_matrix(((Fraction(1), Fraction(1, 2)),)) == r"\begin{pmatrix} 1 & 0.5 \end{pmatrix}"
    )


def test_user_text_is_escaped_for_latex():
    assert latex_text("uav-1") == r"\text{uav-1}"
    assert latex_text("a_b}") == r"\text{a}\_ \text{b}\}"
    assert latex_text("\\input") == r"\backslash \text{input}"
    assert "<b>" not in mathml(latex_text("<b>"))


def test_a_rate_that_only_says_that_errors_decay_is_shown_as_positive():
    assert shown.rate_text(3e-13) == "> 0"
    assert shown.rate_text(0.25189) == "0.2518"
    assert (shown.rate_text(0.0), shown.rate_text(None)) == ("0", "–")
