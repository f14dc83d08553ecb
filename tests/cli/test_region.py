"""`dobc region`: numbers and a picture, exit codes as certify, one document with --json, files
replaced together."""

import json
from functools import partial
from pathlib import Path

import pytest
from certified import certify_once
from problem_texts import listening_pair_text

from dobc_design.certificate.certificate import Certificate
from dobc_design.certification import certify as certification
from dobc_design.falsification import falsify as falsification
from dobc_design.falsification.falsify import Searched, search_beside

SINES = """\
name = "sines"
[network]
agents = 3
arrow = "listens_to"
[network.modes]
G = [[2, 1], [3, 2], [1, 3]]
[coupling]
h = "sin(y)"
[pinning]
gains = { 1 = 1 }
"""
ASKED = f"{SINES}[region]\ninitial_states = [-HALF, HALF]\n"
LOOSE = (
    SINES.replace("{ 1 = 1 }", "{}")
    .replace("agents = 3", "agents = 2")
    .replace(", [3, 2], [1, 3]", ", [1, 2]")
)


def search_briefly(certificate: Certificate, *, progress: object) -> Searched:
    return search_beside(certificate, runs=20)


@pytest.fixture
def dobc(command_line, tmp_path, monkeypatch):
    """Run the command line in an empty folder: exit code, standard output, standard error."""
    monkeypatch.setattr(certification, "certify", certify_once)
    monkeypatch.setattr(falsification, "falsify", search_briefly)
    (tmp_path / "free.toml").write_text(SINES.replace("sin(y)", "tanh(y)"), encoding="utf-8")
    (tmp_path / "near.toml").write_text(ASKED.replace("HALF", "0.5"), encoding="utf-8")
    (tmp_path / "far.toml").write_text(ASKED.replace("HALF", "2"), encoding="utf-8")
    (tmp_path / "pair.toml").write_text(listening_pair_text(5), encoding="utf-8")
    (tmp_path / "loose.toml").write_text(LOOSE.replace("sin(y)", "y"), encoding="utf-8")
    return partial(command_line, "region")


def test_a_region_that_is_proved_leaves_with_0_and_writes_numbers_and_picture(dobc, tmp_path: Path):
    code, out, _ = dobc("near.toml")
    assert code == 0
    assert "sines: PROVED." in out
    assert "Max-separable" in out
    folder = tmp_path / "sines-certificate"
    assert {path.name for path in folder.iterdir()} == {"region.json", "region.svg", "region.png"}
    assert (folder / "region.svg").read_text("utf-8").lstrip().startswith("<?xml")


@pytest.mark.slow
def test_a_region_out_of_reach_leaves_with_3_and_says_how_far_the_proof_goes(dobc):
    """sin pulls back only as far as pi/2 on both sides: the box is near that, never beyond."""
    code, out, _ = dobc("far.toml", "--json", "--out", "there")
    document = json.loads(out)
    assert code == 3
    assert document["verdict"] == "undecided"
    assert document["asked"]["box"] == 2.0
    found = next(each for each in document["regions"] if each["id"] == "max-separable")
    assert 1.5 < found["box"] < 1.5708
    assert not found["covers"]
    assert "does not rise throughout" in found["limit"]
    assert [Path(path).name for path in document["files"]] == [
        "region.json",
        "region.svg",
        "region.png",
    ]


@pytest.mark.usefixtures("undrawn")
def test_the_file_holds_what_json_prints_and_nothing_of_a_search(dobc, tmp_path: Path):
    _, out, _ = dobc("near.toml", "--json", "--out", "there")
    document = json.loads(out)
    document.pop("files")
    assert "searches" not in document
    assert not (tmp_path / "there" / "search.svg").exists()
    assert json.loads((tmp_path / "there" / "region.json").read_text("utf-8")) == document
    assert document["tolerance"] == 0.005
    assert [each["pinned"] for each in document["agents"]] == [True, False, False]


@pytest.mark.slow
def test_where_no_region_is_asked_for_the_largest_box_is_looked_for(dobc):
    code, out, _ = dobc("free.toml")
    assert code == 0
    assert "No region was asked for: the largest that was found is shown." in out
    assert "Max-separable" in out


@pytest.mark.slow
def test_a_search_shows_the_false_equilibria_and_what_is_only_suspect(dobc, tmp_path: Path):
    """2 sin y + y/10 = 0 at y = 3.3077: the agents rest at 1.654 and -1.654."""
    code, out, _ = dobc("pair.toml", "--search")
    assert code == 1
    assert "Proved: in mode G the agents may also rest at |e|∞ ≈ 1.654" in out
    assert "No proof of consensus can include it" in out
    assert "A suspect is a simulated run in floating point. It refutes nothing" in out
    assert (tmp_path / "listening-pair-certificate" / "search.svg").exists()
    _, out, _ = dobc("pair.toml", "--search", "--json")
    region, certified = json.loads(out)["searches"]
    assert region["refutes"]
    assert len(region["proved"]) >= 1
    assert certified["suspects"] == []
    assert certified["refutes"] is False


@pytest.mark.slow
def test_a_settling_time_is_told_with_what_proves_it(dobc):
    code, out, _ = dobc("near.toml", "--settling", "1/50")
    assert code == 0
    assert "it is proved that |e(t)|∞ ≤ 0.02 for all t ≥" in out
    assert "moving box" in out and "max-separable" in out
    _, out, _ = dobc("near.toml", "--settling", "1/50", "--json")
    document = json.loads(out)
    assert document["tolerance"] == 0.02
    assert document["settling"]["verdict"] == "proved"


def test_a_tolerance_that_is_no_length_leaves_with_2_and_names_the_option(dobc, command_line):
    for ran in (
        dobc("near.toml", "--settling", "0"),
        command_line("certify", "near.toml", "--settling", "0"),
    ):
        assert (ran[0], "--settling must be > 0" in ran[1] + ran[2]) == (2, True)


@pytest.mark.usefixtures("undrawn")
def test_a_narrow_terminal_has_its_reasons_below_the_table_and_no_number_is_cut(dobc, monkeypatch):
    for columns in (80, 50):
        monkeypatch.setenv("COLUMNS", str(columns))
        _, out, _ = dobc("near.toml")
        assert "…" not in out
        assert columns < 80 or max(map(len, out.split("wrote")[0].splitlines())) <= 80
        assert columns < 80 or "It covers what was asked for; more was not tried." in out


def test_mistakes_leave_with_2_and_write_nothing(dobc, tmp_path: Path):
    (tmp_path / "file").write_text("", encoding="utf-8")
    for arguments, words in (
        (["near.toml", "--out", "file"], "'file' is not a folder."),
        (["near.toml", "--out", "--json"], "--out needs a value"),
        (["nowhere.toml"], "nowhere.toml"),
    ):
        before = set(tmp_path.iterdir())
        code, out, err = dobc(*arguments)
        assert code == 2
        assert before == set(tmp_path.iterdir())
        assert words in out + err
