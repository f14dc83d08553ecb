"""Every wrong problem file is refused with its key and a cure, in little time, and nothing is left behind.

The cases stand in ``tests/support/bad_files.py``; the reader is given each as a file in a folder of its own.
"""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from bad_files import BAD_FILES, VALID_BUT_NASTY, listing, write_case

from dobc_design.errors import SpecError
from dobc_design.problem.canonical import canonical_bytes, problem_from_canonical
from dobc_design.problem.load import read_problem_file, read_problem_text


@pytest.mark.parametrize("case", BAD_FILES, ids=lambda case: case.id)
def test_a_bad_file_is_refused_by_key_and_in_words(case, tmp_path):
    """Contract: one clear error that names the key, says what it must be and what it was; nothing written."""
    path = write_case(case, tmp_path)
    before, start = listing(tmp_path), time.process_time()
    with pytest.raises(SpecError) as caught:
        read_problem_file(path)
    spent = time.process_time() - start
    assert listing(tmp_path) == before
    errors = caught.value.errors
    assert 1 <= len(errors) <= 20
    if case.expect_key:
        assert case.expect_key in [error.key for error in errors]
    text = "\n".join(str(error) for error in errors).lower()
    for word in case.expect_words:
        assert word.lower() in text
    for error in errors:
        assert len(str(error)) < 600
        assert str(error).isprintable(), "a message must not move the cursor"
    assert spent < 5


def test_there_are_hundreds_of_bad_files_and_no_two_share_a_name():
    names = [case.id for case in (*BAD_FILES, *VALID_BUT_NASTY)]
    assert len(BAD_FILES) >= 350
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("case", VALID_BUT_NASTY, ids=lambda case: case.id)
def test_a_nasty_but_valid_file_loads_and_survives_the_canonical_form(case, tmp_path):
    path = write_case(case, tmp_path)
    before = listing(tmp_path)
    problem = read_problem_file(path)
    assert listing(tmp_path) == before
    assert problem_from_canonical(canonical_bytes(problem)) == problem


# The contract's own example, with arcs in range of its ten agents.
EXAMPLE = """\
schema = 1
name = "paper-fixed"
target = 1.0
[network]
agents = 10
arrow = "listens_to"
[network.modes]
Ga = [[1, 2], [2, 3], [3, 4], [4, 5], [5, 6], [6, 7], [7, 8], [8, 9], [9, 10], [10, 1]]
[coupling]
h = "exp(y) - 1 + y"
[[coupling.exceptions]]
arcs = [[1, 2]]
h = "2*y"
[pinning]
gains = { 1 = 5.0, 6 = "9/16" }
[exosystem]
A = [[0, 2], [-2, 0]]
C = [[1, 0]]
[observer]
W = [["16/5"], ["12/5"]]
P = [["1/2", "-1/4"], ["-1/4", "1/3"]]
rate = 1.0
[formation]
offsets = { 2 = 1.5, 3 = -1.5 }
[region]
initial_states = [0, 5]
initial_disturbance = 0.5
[switching]
signal = "random"
dwell = 0.5
[simulation]
t_final = 20.0
seed = 0
xi0 = ["0.420735492", "0.270151153"]
"""


def test_the_example_of_the_contract_loads():
    problem = read_problem_text(EXAMPLE.encode("utf-8"), folder=None)
    assert (problem.name, problem.n, problem.m, problem.q) == ("paper-fixed", 10, 1, 2)
    assert [str(k[0][0]) for k in problem.pinning.gains.values()] == ["5", "9/16"]
    assert str(problem.observer.rate) == "1"
    assert {i: str(offset[0]) for i, offset in problem.offsets.items()} == {1: "3/2", 2: "-3/2"}
    assert problem.coupling_of(0, 1).texts == ("2*y",)
    assert problem.coupling_of(1, 2).texts == ("exp(y) - 1 + y",)


def test_mistakes_in_different_tables_are_told_at_once():
    text = EXAMPLE.replace('h = "exp(y) - 1 + y"', 'h = "exp(y) + y"').replace("[10, 1]", "[10, 11]")
    text = text.replace("dwell = 0.5", "dwell = 0").replace('"12/5"', '"12/0"')
    with pytest.raises(SpecError) as caught:
        read_problem_text(text.encode("utf-8"), folder=None)
    found = [error.key for error in caught.value.errors]
    assert found == ["network.modes.Ga[9]", "observer.W[1][0]", "switching.dwell"]
    text = text.replace("[10, 11]", "[10, 1]").replace("seed = 0", "seed = -1")
    with pytest.raises(SpecError) as caught:
        read_problem_text(text.encode("utf-8"), folder=None)
    found = [error.key for error in caught.value.errors]
    assert found == ["observer.W[1][0]", "switching.dwell", "coupling.h", "simulation.seed"]


def test_every_wrong_arc_is_told_up_to_twenty():
    arcs = ", ".join(f"[1, {100 + i}]" for i in range(50))
    text = EXAMPLE.replace("[10, 1]]", f"[10, 1], {arcs}]")
    with pytest.raises(SpecError) as caught:
        read_problem_text(text.encode("utf-8"), folder=None)
    assert [error.key for error in caught.value.errors] == [f"network.modes.Ga[{10 + i}]" for i in range(20)]


@pytest.mark.parametrize("name", ["", "x" * 300, "two\nlines"])
def test_a_file_whose_own_name_cannot_name_a_problem_loads_as_problem(name):
    """Only a name that the user typed can be refused."""
    text = EXAMPLE.replace('name = "paper-fixed"\n', "")
    assert read_problem_text(text.encode("utf-8"), folder=None, default_name=name).name == "problem"


def test_a_missing_file_a_folder_and_a_name_with_nul_are_refused(tmp_path):
    with pytest.raises(SpecError, match=r"there is no file 'none\.toml'"):
        read_problem_file(tmp_path / "none.toml")
    with pytest.raises(SpecError, match="is a folder, not a problem file"):
        read_problem_file(tmp_path)
    with pytest.raises(SpecError, match="cannot be read"):
        read_problem_file(tmp_path / "nul\0.toml")
    with pytest.raises(SpecError, match="cannot be read"):
        read_problem_file(tmp_path / ("x" * 5000))


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="this system has no endless device")
def test_an_endless_device_is_refused_and_not_read():
    with pytest.raises(SpecError, match="is a device, not a problem file"):
        read_problem_file(Path("/dev/zero"))
