"""Values as they are typed: exact ranges, lists that respect brackets, draws that can be
repeated."""

import itertools
import re
import statistics
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from dobc_design.errors import SpecError
from dobc_design.exact.number import parse_number
from dobc_design.sweeps.axes import (
    path_text,
    read_axes,
    read_keys,
    read_value,
    split,
    split_axis,
    value_text,
    with_changes,
)


def values(given):
    (axis,) = read_axes({"a.b": given})
    return axis.values


def test_ranges_are_evenly_spaced_and_exact_or_have_even_ratios_and_keep_their_ends():
    expected = ("1", "1.5", "2", "2.5", "3", "3.5", "4", "4.5", "5")
    assert values("1:5:9") == expected
    thirds = values("0:1:4")
    assert thirds == ("0", "1/3", "2/3", "1")
    found_thirds = [Fraction(x) for x in thirds]
    expected_thirds = [Fraction(k, 3) for k in range(4)]
    assert found_thirds == expected_thirds
    assert values("1:-1:3") == ("1", "0", "-1")
    found = values("1/100:10:7:log")
    assert found[0] == "0.01"
    assert found[-1] == "10"
    assert len(found) == 7
    ratios = []
    for a, b in itertools.pairwise(found):
        ratios.append(float(Fraction(b)) / float(Fraction(a)))
    assert max(ratios) / min(ratios) == pytest.approx(1, abs=1e-5)
    for x in found:
        assert len(x.replace(".", "").lstrip("0")) <= 6


NONSENSE = """
    1:5:1 1:1:3 0:5:3:log 1:5:9999999 1,,2 1, f(y y) "a 1,1 ~uniform(1) ~uniform(2,1) ~weird(1,2)
    ~normal(0,0)
    ~integers(0.5,2) ~loguniform(0,1) ~choice() ~x
"""


@pytest.mark.parametrize("text", ["", *NONSENSE.split()])
def test_values_that_mean_nothing_are_refused_with_the_key(text):
    with pytest.raises(SpecError, match=r"^a.b: ") as caught:
        values(text)
    assert caught.value.cure


def test_a_list_is_split_outside_brackets_and_quotes_only():
    listed = ("exp(y)-1+y", "clip(y, -1, 1)", "tanh(y)")
    assert values(",".join(listed)) == listed
    assert values("[[1],[2]],[[16/5],[12/5]]") == ("[[1],[2]]", "[[16/5],[12/5]]")
    assert split('"a,b",c') == ['"a,b"', "c"]


READ = {"5": 5, "-3": -3, "0.5": "0.5", "9/16": "9/16", "none": None, "[]": []}
READ["exp(y)-1+y"] = "exp(y)-1+y"
READ["[[16/5], [2]]"] = [["16/5"], [2]]
READ['"5"'] = "5"
READ["'none'"] = "none"
READ["{ 1 = 5, b = 0.5 }"] = {"1": 5, "b": "0.5"}


@pytest.mark.parametrize(("text", "value"), READ.items())
def test_a_value_is_read_as_a_problem_file_would_hold_it(text, value):
    assert read_value(text) == value


def lists_of(inner):
    return st.lists(inner, min_size=1, max_size=3)


NUMBERS = st.integers(-(10**6), 10**6) | st.fractions(max_denominator=1000)
FLOATS = st.floats(-1e6, 1e6, allow_subnormal=False)
PRINTABLE = st.characters(min_codepoint=32, max_codepoint=126)
TEXTS = st.text(PRINTABLE, min_size=1, max_size=8)


@example(['"\\'])
@given(st.recursive(NUMBERS | FLOATS | TEXTS, lists_of, max_leaves=5))
def test_the_text_of_a_value_reads_back_as_the_value(value):
    """Numbers stay exact, text stays text whatever it looks like."""

    def same(read, given):
        if isinstance(given, list):
            parts = zip(read, given, strict=True)
            return isinstance(read, list) and all(same(a, b) for a, b in parts)
        if isinstance(given, str):
            return read == given
        return parse_number(read, key="x") == parse_number(given, key="x")

    assert same(read_value(value_text(value)), value)


def test_values_from_python_may_be_arrays_lists_and_tables():
    found = values(np.linspace(0, 1, 3))
    expected = ("0", "0.5", "1")
    assert found == expected
    arcs = [[1, 2]]
    assert values([Fraction(1, 3), "tanh(y)", arcs]) == ("1/3", "tanh(y)", "[[1, 2]]")
    read = read_value(values([{"s 1": 0.5, "b": Fraction(1, 3)}])[0])
    assert read == {"s 1": "0.5", "b": "1/3"}
    with pytest.raises(SpecError, match="must be a number, text, list or table"):
        values([True])


def test_draws_depend_on_seed_axis_and_number_and_choices_come_equally_often():
    (axis,) = read_axes(["a=~uniform(0,1)"])
    first = []
    for k in range(50):
        first.append(axis.draw.value(7, axis.name, k))
    assert first == [axis.draw.value(7, axis.name, k) for k in range(50)]
    assert len(set(first)) > 45
    assert first != [axis.draw.value(8, axis.name, k) for k in range(50)]
    assert first != [axis.draw.value(7, "b", k) for k in range(50)]
    (axis,) = read_axes(["h=~choice(y,tanh(y),clip(y,-1,1))"])
    drawn = []
    for k in range(600):
        drawn.append(axis.draw.value(0, "h", k))
    counts = [drawn.count(each) for each in ("y", "tanh(y)", "clip(y,-1,1)")]
    assert sum(counts) == 600
    assert min(counts) > 140


DRAWS = [("~uniform(-1,3)", -1, 3, 1)]  # with their bounds and the median
DRAWS.append(("~loguniform(0.01,100)", 0.01, 100, 1))
DRAWS.append(("~normal(2,0.5)", -1, 5, 2))
DRAWS.append(("~integers(1,9)", 1, 9, 5))


@pytest.mark.parametrize(("text", "low", "high", "middle"), DRAWS)
def test_draws_have_the_distribution_they_are_named_after(text, low, high, middle):
    """Bounds and the median, of 2000 draws; the median's standard error is below a twentieth of
    each spread."""
    (axis,) = read_axes([f"a={text}"])
    drawn = []
    for k in range(2000):
        drawn.append(float(Fraction(axis.draw.value(1, "a", k))))
    assert low <= min(drawn) < max(drawn) <= high
    assert statistics.median(drawn) == pytest.approx(middle, rel=0.2, abs=0.15)


def test_axes_that_undo_each_other_are_refused_and_those_that_go_together_are_not():
    deeper = {"a": "1", "a.b": "2"}
    crossed = {"a.b": "1", "c,a.b": "2"}
    for pair in (deeper, crossed):
        with pytest.raises(SpecError, match="set the same place"):
            read_axes(pair)
    assert len(read_axes({"a.b": "1", "a.c": "2"})) == 2
    with pytest.raises(SpecError, match="nothing is varied"):
        read_axes({})


FIRST = ("pinning", "gains", "1")
PATHS = {"target": [("target",)], "coupling.h": [("coupling", "h")], "pinning.gains.1": [FIRST]}
PATHS["exosystem.A[0][12]"] = [("exosystem", "A", 0, 12)]
PATHS['pinning.gains."s 1, north"'] = [("pinning", "gains", "s 1, north")]
PATHS["pinning.gains.1, pinning.gains.6"] = [FIRST, ("pinning", "gains", "6")]
PATHS["coupling.exceptions[0].h"] = [("coupling", "exceptions", 0, "h")]


@pytest.mark.parametrize(("text", "paths"), PATHS.items())
def test_a_path_is_names_between_dots_and_places_in_brackets(text, paths):
    assert list(read_keys(text)) == paths
    joined = ",".join(path_text(path) for path in paths)
    assert list(read_keys(joined)) == paths


NO_PATHS = ["", ".", "a..b", "[0]", "a.", "a b", "a[x]", "a[-1]", ",a", "a,", 'a."b', "a" * 600]


@pytest.mark.parametrize("text", NO_PATHS)
def test_what_is_no_path_is_refused_with_an_example(text):
    with pytest.raises(SpecError, match=r"is no (key of a problem file|quoted name)") as caught:
        read_keys(text)
    assert "pinning.gains.1" in str(caught.value.cure)
    with pytest.raises(SpecError, match="names a key twice"):
        read_keys("a.b,a.b")


def test_the_first_equals_sign_outside_quotes_divides_key_and_values():
    assert split_axis("coupling.h=y, tanh(y)") == ("coupling.h", "y, tanh(y)")
    assert split_axis('pinning.gains."a=b"=1') == ('pinning.gains."a=b"', "1")
    with pytest.raises(SpecError, match="KEY=VALUES"):
        split_axis("coupling.h")


DOCUMENT = {
    "network": {"modes": {"G": [[1, 2], [2, 3]]}},
    "pinning": {"gains": 5},
    "coupling": {"h": "y"},
}


def test_a_change_copies_and_leaves_the_document_as_it_was():
    arc_path = ("network", "modes", "G", 1)
    changes = {("coupling", "h"): "tanh(y)", arc_path: [3, 1]}
    changed = with_changes(DOCUMENT, changes)
    assert changed["coupling"]["h"] == "tanh(y)"
    arcs = changed["network"]["modes"]["G"]
    expected = [[1, 2], [3, 1]]
    assert arcs == expected
    assert DOCUMENT["coupling"]["h"] == "y"
    arcs_before = DOCUMENT["network"]["modes"]["G"]
    expected_before = [[1, 2], [2, 3]]
    assert arcs_before == expected_before


def test_tables_on_the_way_are_made_the_next_place_of_a_list_is_filled_and_none_removes():
    changes = {("observer", "rate"): 2, ("pinning", "gains"): None}
    changes["network", "modes", "G", 0, 2] = 0.5
    changed = with_changes(DOCUMENT, changes)
    assert changed["observer"] == {"rate": 2}
    arcs_changed = changed["network"]["modes"]["G"]
    expected_arc = [1, 2, 0.5]
    assert arcs_changed[0] == expected_arc
    assert changed["pinning"] == {}
    assert with_changes(DOCUMENT, {("formation", "offsets"): None}) == DOCUMENT


ARCS = ("network", "modes", "G")
NOWHERE = {  # path -> what is said of it
    FIRST: r"pinning.gains is 5, which has no '1'. Vary pinning.gains itself",
    (*ARCS, 7, 0): r"G has 2 entries, counted from 0; got index 7",
    (*ARCS, 3): r"G has 2 entries",
    (*ARCS, "1"): r"is a list, which has no '1'. Give an index",
    ("coupling", 0): r"coupling is a table, which has no 0",
}


@pytest.mark.parametrize(("path", "words"), NOWHERE.items())
def test_a_path_that_leads_nowhere_says_where_it_ends(path, words):
    with pytest.raises(SpecError) as caught:
        with_changes(DOCUMENT, {path: 1})
    assert re.search(words, str(caught.value)), str(caught.value)
