"""Keys of a problem set anew: in memory and in the text of its file, always the same problem."""

import tomllib
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest
from campaigns.certificates import a_problem

from dobc_design.errors import SpecError
from dobc_design.exact.number import parse_number
from dobc_design.problem.canonical import canonical_bytes
from dobc_design.problem.changes import (
    REMARK,
    change_lines,
    changed_file,
    changed_problem,
    changed_text,
    problem_text,
    typed_number,
    value_text,
)
from dobc_design.problem.groups import Observer
from dobc_design.problem.load import (
    builtin_names,
    builtin_text,
    load_problem,
    read_problem_text,
    source_text,
)

TYPED: list[Any] = [
    (5, 5),
    ("42/100", 0.42),
    ("9/16", 0.5625),
    ("1/3", "1/3"),
    ("-16/5", -3.2),
    (0, 0),
    (10**20, 1e20),
    ("1e-7", 1e-07),
]


@pytest.mark.parametrize(("value", "typed"), TYPED)
def test_a_rational_is_written_the_short_way(value, typed):
    assert typed_number(Fraction(value)) == typed
    assert type(typed_number(Fraction(value))) is type(typed)


def test_what_is_written_means_the_same_number():
    for k in range(1, 400):
        values = [Fraction(k, 7), Fraction(k, 1000)]
        power = Fraction(10) ** (k - 200)
        fraction = Fraction(k**12, 3**20)
        values += [power, fraction]
        for value in values:
            assert parse_number(typed_number(value), key="k") == value


CHANGED = """\
target = [1, 2]
[pinning]
gains = { 1 = 5 }
[observer]
W = [[1]]
# remove observer.P"""


def test_changes_are_told_as_a_file_would_hold_them():
    matrix_gain = [[1, -2.5], ["1/3", 1e-07]]
    value = {"1": 0.42, "a b": "9/16", 'é"': matrix_gain}
    assert tomllib.loads(f"x = {value_text(value)}")["x"] == value
    changes: dict[str, Any] = {"pinning.gains": {"1": 5}, "target": [1, 2]}
    changes |= {"observer.W": [[1]], "observer.P": None}
    lines = "\n".join(change_lines(changes))
    assert lines == CHANGED
    assert tomllib.loads(lines)["pinning"] == {"gains": {"1": 5}}
    gains = {str(i): 1 for i in range(1, 31)}
    (_, line) = change_lines({"pinning.gains": gains})
    assert line.endswith("9 = 1, ... }  # 21 more")


TEXT = builtin_text("paper-fixed")
NO_GAIN = {"observer.W": None, "observer.P": None}
NO_DISTURBANCE = {"exosystem": None, "observer": None}
NO_DISTURBANCE |= {"simulation.xi0": None, "region.initial_disturbance": None}
ALL_GAINS: dict[str, Any] = {str(i): 0.5 for i in range(1, 11)}
CHANGES: list[dict[str, Any]] = [{"pinning.gains": {"3": 0.25, "7": "9/16"}}]
CHANGES.append({"pinning.gains": 2})
CHANGES.append({"pinning.gains": ALL_GAINS | {"1": 3}})
CHANGES.append({"observer.W": [[1], [2]], "observer.P": None})
CHANGES += [NO_GAIN, NO_DISTURBANCE]
PINS = "[pinning]\ngains = { 1 = 5, 6 = 5 }              # stand-in, see above"


def read(text, name="problem"):
    return read_problem_text(text.encode("utf-8"), folder=Path(), default_name=name)


@pytest.mark.parametrize("changes", CHANGES)
def test_a_change_of_the_text_and_of_the_problem_are_the_same(changes):
    problem = load_problem("paper-fixed")
    text = changed_text(TEXT, changes)
    assert canonical_bytes(read(text)) == canonical_bytes(changed_problem(problem, changes))
    assert canonical_bytes(changed_problem(problem, changes)) != canonical_bytes(problem)


def test_a_change_that_removes_the_observer_removes_its_gain_too():
    changes = {"observer": None, "observer.W": [[1], [2]]}
    problem = load_problem("paper-fixed")
    assert changed_problem(problem, changes).observer == Observer()
    file = changed_file(problem, changes, text=TEXT, folder=Path())
    assert read(file).observer == Observer()


def test_comments_and_order_stay_a_missing_table_is_added_and_an_empty_one_goes():
    text = changed_file(load_problem("paper-fixed"), CHANGES[0], text=TEXT, folder=Path())
    before = TEXT.splitlines()
    after = text.splitlines()
    assert len(after) == len(before)
    both = zip(before, after, strict=True)
    ((old, new),) = [(a, b) for a, b in both if a != b]
    assert old.split("=")[0].strip() == "gains"
    assert new == 'gains = {3 = 0.25, 7 = "9/16"} # set by dobc certify --apply-fix'
    unpinned = TEXT.replace("[pinning]\ngains = { 1 = 5, 6 = 5 }", "")
    text = changed_text(unpinned, {"pinning.gains": {"1": 1}})
    assert read(text).pinning.agents == (0,)
    assert "[observer]" not in changed_text(TEXT, NO_GAIN)


OTHER_WAYS = ["[pinning.gains]\n1 = 5\n6 = 5", "[pinning]\ngains.1 = 5\ngains.6 = 5"]


@pytest.mark.parametrize("gains", OTHER_WAYS)
@pytest.mark.parametrize("changes", CHANGES[:3])
def test_other_ways_to_write_the_gains_are_changed_too(gains, changes):
    text = TEXT.replace(PINS, gains)
    assert text != TEXT
    problem = load_problem("paper-fixed")
    found = changed_file(problem, changes, text=text, folder=Path())
    assert canonical_bytes(read(found)) == canonical_bytes(changed_problem(problem, changes))


def test_lines_of_a_table_that_say_the_same_stay_with_their_comments():
    kept = ["[pinning.gains]", "1 = 5.0  # the leader", "# two that listen"]
    lines = [*kept, '6 = "5"  # the other half', "3 = 1"]
    text = TEXT.replace(PINS, "\n".join(lines))
    problem = read(text, name="paper-fixed")
    changes = {"pinning.gains": {"1": 5, "6": 7, "9": 0.25}}
    found = changed_file(problem, changes, text=text, folder=Path()).splitlines()
    for line in (*kept, f"6 = 7 # {REMARK}", f"9 = 0.25 # {REMARK}"):
        assert line in found
    assert "3 = 1" not in found


@pytest.mark.parametrize("key", ["network.agents", "pinning", "name", "pinning.gains.1", ""])
def test_keys_that_a_cure_never_sets_are_refused(key):
    with pytest.raises(SpecError, match="is no key that a change may set"):
        changed_problem(load_problem("paper-fixed"), {key: 1})


def test_values_that_the_problem_refuses_are_refused():
    with pytest.raises(SpecError, match=r"pinning\.gains"):
        changed_problem(load_problem("paper-fixed"), {"pinning.gains": {"99": 1}})


@pytest.mark.parametrize("name", builtin_names())
def test_a_built_in_problem_written_whole_is_the_same_problem(name):
    problem = load_problem(name)
    assert canonical_bytes(read(problem_text(problem))) == canonical_bytes(problem)
    assert canonical_bytes(read(source_text(name))) == canonical_bytes(problem)


@pytest.mark.parametrize("seed", range(0, 200, 10))
def test_a_random_problem_written_whole_is_the_same_problem(seed):
    problem = a_problem(seed)
    assert canonical_bytes(read(problem_text(problem))) == canonical_bytes(problem)


def test_arcs_in_a_file_that_is_not_reached_from_the_new_folder_are_written_out(tmp_path):
    (tmp_path / "arcs.csv").write_text("1,2\n2,1\n", encoding="utf-8")
    source = tmp_path / "problem.toml"
    text = """\
name = "n"
[network]
agents = 2
arrow = "listens_to"
[network.modes]
G = { file = "arcs.csv" }
[coupling]
h = "y"
"""
    source.write_text(text, encoding="utf-8")
    text = source_text(source)
    problem = load_problem(source)
    changes = {"pinning.gains": {"1": 1}}
    beside = changed_file(problem, changes, text=text, folder=tmp_path)
    assert "arcs.csv" in beside
    elsewhere = changed_file(problem, changes, text=text, folder=tmp_path / "elsewhere")
    assert "arcs.csv" not in elsewhere
    assert canonical_bytes(read(elsewhere)) == canonical_bytes(changed_problem(problem, changes))


def test_a_json_source_has_no_text_and_a_missing_one_is_an_error(tmp_path):
    assert source_text(tmp_path / "problem.json") is None
    with pytest.raises(SpecError, match="there is no file"):
        source_text(tmp_path / "problem.toml")
