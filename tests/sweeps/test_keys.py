"""Key paths: where a value goes in a problem file, and a message that says so where it cannot go."""

from __future__ import annotations

import re

import pytest

from dobc_design.errors import SpecError
from dobc_design.sweeps.axes import path_text, read_keys, split_axis, with_changes


@pytest.mark.parametrize(
    ("text", "paths"),
    [
        ("coupling.h", [("coupling", "h")]),
        ("pinning.gains.1", [("pinning", "gains", "1")]),
        ("exosystem.A[0][12]", [("exosystem", "A", 0, 12)]),
        ('pinning.gains."s 1, north"', [("pinning", "gains", "s 1, north")]),
        ("pinning.gains.1, pinning.gains.6", [("pinning", "gains", "1"), ("pinning", "gains", "6")]),
        ("coupling.exceptions[0].h", [("coupling", "exceptions", 0, "h")]),
        ("target", [("target",)]),
    ],
)
def test_a_path_is_names_between_dots_and_places_in_brackets(text, paths):
    assert list(read_keys(text)) == paths
    assert list(read_keys(",".join(path_text(path) for path in paths))) == paths


@pytest.mark.parametrize("text", ["", ".", "a..b", "[0]", "a.", "a b", "a[x]", "a[-1]", ",a", "a,", 'a."b', "a" * 600])
def test_what_is_no_path_is_refused_with_an_example(text):
    with pytest.raises(SpecError, match=r"is no (key of a problem file|quoted name)") as caught:
        read_keys(text)
    assert "pinning.gains.1" in str(caught.value.cure)


def test_a_key_that_stands_twice_in_an_axis_is_refused():
    with pytest.raises(SpecError, match="names a key twice"):
        read_keys("a.b,a.b")


def test_the_first_equals_sign_outside_quotes_divides_key_and_values():
    assert split_axis("coupling.h=y, tanh(y)") == ("coupling.h", "y, tanh(y)")
    assert split_axis('pinning.gains."a=b"=1') == ('pinning.gains."a=b"', "1")
    with pytest.raises(SpecError, match="KEY=VALUES"):
        split_axis("coupling.h")


DOCUMENT = {"network": {"modes": {"G": [[1, 2], [2, 3]]}}, "pinning": {"gains": 5}, "coupling": {"h": "y"}}


def test_a_change_copies_and_leaves_the_document_as_it_was():
    changed = with_changes(DOCUMENT, {("coupling", "h"): "tanh(y)", ("network", "modes", "G", 1): [3, 1]})
    assert changed["coupling"]["h"] == "tanh(y)"
    assert changed["network"]["modes"]["G"] == [[1, 2], [3, 1]]
    assert DOCUMENT["coupling"]["h"] == "y"
    assert DOCUMENT["network"]["modes"]["G"] == [[1, 2], [2, 3]]


def test_tables_on_the_way_are_made_the_next_place_of_a_list_is_filled_and_none_removes():
    changed = with_changes(
        DOCUMENT, {("observer", "rate"): 2, ("network", "modes", "G", 0, 2): 0.5, ("pinning", "gains"): None}
    )
    assert changed["observer"] == {"rate": 2}
    assert changed["network"]["modes"]["G"][0] == [1, 2, 0.5]
    assert changed["pinning"] == {}
    assert with_changes(DOCUMENT, {("formation", "offsets"): None}) == DOCUMENT


@pytest.mark.parametrize(
    ("path", "words"),
    [
        (("pinning", "gains", "1"), r"pinning.gains is 5, which has no '1'. Vary pinning.gains itself"),
        (("network", "modes", "G", 7, 0), r"G has 2 entries, counted from 0; got place 7"),
        (("network", "modes", "G", 3), r"G has 2 entries"),
        (("network", "modes", "G", "1"), r"is a list, which has no '1'. Name a place"),
        (("coupling", 0), r"coupling is a table, which has no 0"),
    ],
)
def test_a_path_that_leads_nowhere_says_where_it_ends(path, words):
    with pytest.raises(SpecError) as caught:
        with_changes(DOCUMENT, {path: 1})
    assert re.search(words, str(caught.value)), str(caught.value)
