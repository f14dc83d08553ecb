"""Units of the states: what a file may say, where it stands, and that no proof changes by it."""

import json
import re
from fractions import Fraction

import pytest

import dobc_design as dd
from dobc_design.checker.files import Problem as CheckedProblem
from dobc_design.checker.reading import Refused
from dobc_design.description.words import describe, facts
from dobc_design.errors import SpecError
from dobc_design.problem.canonical import canonical_bytes, problem_from_canonical, problem_sha256
from dobc_design.problem.changes import problem_text

FILE = """
units = {units}
target = [1, 0]
[network]
agents = 2
arrow = "listens_to"
modes.G = [[2, 1]]
[coupling]
h = "y"
[pinning]
gains = {{ 1 = 1 }}
[formation]
offsets = {{ 2 = [3, 0] }}
[region]
initial_states = [-1, 2]
"""


def written(folder, units: str) -> dd.Problem:
    path = folder / "own.toml"
    path.write_text(FILE.format(units=units), "utf-8")
    return dd.load_problem(path)


def test_one_unit_is_for_all_components_and_several_are_one_for_each(tmp_path):
    assert written(tmp_path, '"m"').units == ("m", "m")
    mixed = written(tmp_path, '["m", "m/s"]')
    assert mixed.units == ("m", "m/s")
    assert mixed.unit == ""
    assert written(tmp_path, '"m"').unit == "m"


def test_words_have_the_unit_of_each_component(tmp_path):
    said = describe(written(tmp_path, '["m", "m/s"]'))
    assert "2 state components each, in m, m/s, no disturbance." in said
    assert "Target: (1 m, 0 m/s)." in said
    assert "Formation offsets: 2: (3 m, 0 m/s)." in said
    assert "initial states in [-1, 2] m, [-1, 2] m/s." in said
    assert facts(written(tmp_path, '"m"'))["units"] == ["m", "m"]


def test_a_problem_without_units_keeps_its_text_and_its_hash(tmp_path):
    problem = written(tmp_path, '"m"')
    bare = problem.replace(units=None)
    document = json.loads(canonical_bytes(problem))
    assert document.pop("units") == ["m", "m"]
    assert document == json.loads(canonical_bytes(bare))
    assert problem_sha256(bare) != problem_sha256(problem)
    assert "units" not in facts(bare)
    assert "units" not in problem_text(bare)


def test_units_come_back_from_problem_json_from_a_file_and_through_a_change(tmp_path):
    problem = written(tmp_path, '["m", "m/s"]')
    assert problem_from_canonical(canonical_bytes(problem)) == problem
    (tmp_path / "again.toml").write_text(problem_text(problem), "utf-8")
    assert dd.load_problem(tmp_path / "again.toml").units == problem.units
    assert problem.replace(gains={1: 2}).units == problem.units


@pytest.mark.parametrize(
    "units", ["5", "1.5", "true", '""', '"  "', "[]", '["m"]', '["m", 2]', f'"{"x" * 21}"', "{}"]
)
def test_what_is_no_unit_is_refused(tmp_path, units: str):
    wanted = "units must be a text of 1 to 20 printable characters, or 2 of them"
    with pytest.raises(SpecError, match=re.escape(wanted)):
        written(tmp_path, units)


@pytest.mark.parametrize("units", [["m"], "m", ["m", "s", "s"], None, ["m", 2], []])
def test_neither_reader_of_problem_json_takes_units_that_do_not_fit(tmp_path, units):
    document = json.loads(canonical_bytes(written(tmp_path, '"m"')))
    data = json.dumps(document | {"units": units}).encode()
    with pytest.raises(SpecError, match=r"units|an object with the keys"):
        problem_from_canonical(data)
    with pytest.raises(Refused, match=r"."):
        CheckedProblem(data)


def test_the_second_checker_confirms_the_same_proof_with_units_and_without(tmp_path):
    problem = written(tmp_path, '["m", "m/s"]')
    with_units = dd.certify(problem)
    without = dd.certify(problem.replace(units=None))
    assert with_units.verdict is dd.Verdict.PROVED
    assert with_units.rate == without.rate
    checked = dd.verify(with_units, problem)
    assert checked.holds
    assert "accepts every claim" in checked.lone_checker


def test_a_certificate_says_and_draws_sizes_of_errors_in_the_unit_that_all_components_share(
    tmp_path,
):
    problem = written(tmp_path, '"m"').replace(uncertainty={"disturbance": "1/100"})
    certificate = dd.certify(problem)
    bounds = certificate.check("accuracy").exact["bounds"]
    numbers = map(Fraction, bounds.values())
    bound = max(numbers)
    said = re.match(r"All agents end within (\S+) m of the target plus", certificate.reason)
    assert bound <= Fraction(said[1]) < bound * Fraction(101, 100)
    assert certificate.plot().figure.axes[0].get_xlabel().endswith("at the start, in m")
    mixed = dd.certify(problem.replace(units=["m", "m/s"]))
    assert re.match(r"All agents end within \S+ of the target plus", mixed.reason)
    assert mixed.plot().figure.axes[0].get_xlabel().endswith("at the start, in units of x")
