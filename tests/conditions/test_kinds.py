"""What `dobc explain` says of each condition: the question first, then every letter defined."""

import re

import pytest

from dobc_design.conditions.kinds import KINDS, LETTERS

#: Short words, the x of (x), the time, and indices.
WORDS = {*"axtijpq", "in", "of", "is", "to", "on", "as", "by", "it", "or", "an", "no", "at", "Re"}


@pytest.mark.parametrize("id", KINDS)
def test_an_explanation_begins_with_a_question_in_plain_words(id):
    means = KINDS[id].means
    assert "?" in means or "." in means
    assert not re.search(r"[_^(){}=<>]", means)


@pytest.mark.parametrize("id", KINDS)
def test_every_letter_of_a_condition_is_defined(id):
    """Letters are single, or have an index or a case that no word has."""
    kind = KINDS[id]
    words = re.findall(r"[A-Za-z]\w*", kind.plain)
    letters = {word for word in words if len(word) == 1 or "_" in word} - WORDS
    said = {word for word in letters if re.search(rf"\b{word}\b (a bound|>= 0|is)", kind.plain)}
    assert letters - said <= set(kind.letters) | {"sum_j", "sum_q", "bounds_i", "lambda_max"}


def test_every_definition_is_used_by_some_condition():
    used = {letter for kind in KINDS.values() for letter in kind.letters}
    assert set(LETTERS) <= used


def test_a_letter_that_means_something_else_in_one_condition_is_defined_there():
    """T is a delay elsewhere; in the circle criterion it holds the multipliers of the arcs."""
    assert KINDS["delay"].letters["T"] == LETTERS["T"]
    assert "for each arc" in KINDS["lure"].letters["T"]
    assert "s" not in KINDS["lure"].letters
    assert "s" not in KINDS["theorem2-weighted"].letters
