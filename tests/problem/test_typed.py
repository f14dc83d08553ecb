"""Numbers as people type them, and changes as lines to read."""

from __future__ import annotations

import tomllib
from fractions import Fraction

import pytest

from dobc_design.exact.number import parse_number
from dobc_design.problem.changes import change_lines, typed_number, value_text


@pytest.mark.parametrize(
    ("value", "typed"),
    [
        (5, 5),
        ("42/100", 0.42),
        ("9/16", 0.5625),
        ("1/3", "1/3"),
        ("-16/5", -3.2),
        (0, 0),
        (10**20, 1e20),
        ("1e-7", 1e-07),
    ],
)
def test_a_rational_is_written_the_short_way(value, typed):
    assert typed_number(Fraction(value)) == typed
    assert type(typed_number(Fraction(value))) is type(typed)


def test_what_is_written_means_the_same_number():
    for k in range(1, 400):
        for value in (Fraction(k, 7), Fraction(k, 1000), Fraction(10) ** (k - 200), Fraction(k**12, 3**20)):
            assert parse_number(typed_number(value), key="k") == value


def test_values_are_toml():
    value = {"1": 0.42, "a b": "9/16", 'é"': [[1, -2.5], ["1/3", 1e-07]]}
    assert tomllib.loads(f"x = {value_text(value)}")["x"] == value


def test_changes_are_told_as_a_file_would_hold_them():
    changes = {"pinning.gains": {"1": 5}, "observer.W": [[1]], "observer.P": None, "target": [1, 2]}
    assert change_lines(changes) == [
        "target = [1, 2]",
        "[pinning]",
        "gains = { 1 = 5 }",
        "[observer]",
        "W = [[1]]",
        "# remove observer.P",
    ]
    assert tomllib.loads("\n".join(change_lines(changes)))["pinning"] == {"gains": {"1": 5}}


def test_a_long_table_is_cut_and_says_so():
    (_, line) = change_lines({"pinning.gains": {str(i): 1 for i in range(1, 31)}})
    assert line.endswith("9 = 1, ... }  # 21 more")
