"""Reasons of verdicts in parts: their text, and what is read back from a text."""

import pytest

from dobc_design.conditions.reason import Reason, read_reason

FULL = Reason(head="no proof reaches the region.", advice="larger gains.", is_open=True)
TEXT = "Undecided: no proof reaches the region. What would help: larger gains."


def test_the_text_says_first_that_nothing_was_decided_and_last_what_would_help():
    assert str(FULL) == TEXT
    assert FULL.told == TEXT.removeprefix("Undecided: ")
    assert str(Reason(head="All agents reach the target.")) == "All agents reach the target."


def test_more_words_come_after_the_advice():
    assert str(FULL.followed_by(" Graphs move.")) == f"{TEXT} Graphs move."
    assert FULL.followed_by(" Graphs move.").head == FULL.head
    assert str(Reason(head="So far.").followed_by(" Graphs move.")) == "So far. Graphs move."


@pytest.mark.parametrize(
    "text",
    [
        TEXT,
        "",
        "Undecided: ",
        "Undecided: time ran out.",
        "Undecided: no. What would help: ",
        "Undecided: no. What would help: more. What would help: less.",
        "All agents reach the target.",
        "What would help: nothing.",
    ],
)
def test_the_parts_that_are_read_have_the_text_that_was_read(text):
    assert str(read_reason(text)) == text


def test_a_stored_text_has_the_parts_that_it_was_made_of():
    assert read_reason(TEXT) == FULL
    assert read_reason("Undecided: so far.") == Reason(head="so far.", is_open=True)
