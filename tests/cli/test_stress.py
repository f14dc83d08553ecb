"""`dobc stress`: what breaks first, and runs under a stress that is given."""

import json
import re
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from problem_texts import RING

from dobc_design import load_trajectory, simulate
from dobc_design.simulation.stress import Failure, Stress, stress_to_json


@pytest.fixture
def dobc(command_line):
    """Run the command line in an empty folder: exit code, standard output, standard error."""
    return partial(command_line, "stress")


@pytest.mark.parametrize(
    ("arguments", "key"),
    [
        (("paper-fixed", "--fail", "3"), "--fail"),
        (("paper-fixed", "--fail", "3@1:melt"), "--fail"),
        (("paper-fixed", "--fail", "99@1"), "--fail"),
        (("paper-fixed", "--loss", "2"), "--loss"),
        (("paper-fixed", "--period", "-1"), "--period"),
        (("paper-fixed", "--noise", "nan"), "--noise"),
        (("paper-fixed", "--saturation", "0"), "--saturation"),
        (("paper-fixed", "--worst", "--noise", "1"), "--worst"),
        (("paper-fixed", "--runs", 2), "--runs"),
        (("paper-fixed", "--observer", "off"), "--observer"),
        (("paper-fixed", "--noise", "1", "--out", "file"), "--out"),
        (("paper-fixed", "--noise", "1", "--out", "--json"), "--out"),
    ],
)
def test_a_mistake_is_named_by_its_key_and_nothing_is_written(dobc, arguments, key: str):
    Path("file").write_text("", encoding="utf-8")
    code, out, _ = dobc(*arguments, "--json")
    assert code == 2
    assert json.loads(out)["error"]["key"] == key
    assert [path.name for path in Path().iterdir()] == ["file"]


def test_runs_without_a_stress_are_told_what_to_add_and_that_works(dobc):
    _, out, _ = dobc("clock-sync", "--runs", 2, "--json")
    cure = json.loads(out)["error"]["cure"]
    assert cure == "Add one, such as --noise 0.1, or leave --runs out."
    code, out, _ = dobc("clock-sync", "--runs", 2, "--t-final", 1, "--noise", 0.1, "--json")
    assert code == 0
    assert json.loads(out)["runs"] == 2


def test_a_stress_of_size_zero_is_a_run_without_one(dobc):
    code, out, _ = dobc("paper-fixed", "--t-final", 1, "--noise", 0, "--json")
    document = json.loads(out)
    assert code == 0
    assert document["final_error"]["max"] == simulate("paper-fixed", t_final=1).final_error
    assert "breaking" not in document


def test_the_worst_is_what_the_problem_bounds(dobc):
    Path("ring.toml").write_text(f"{RING}[uncertainty]\nmeasurement = 0.1\n", encoding="utf-8")
    code, out, _ = dobc("ring.toml", "--worst", "--t-final", 1)
    assert code == 0
    assert "measurement noise of at most 0.1" in out


@pytest.mark.usefixtures("undrawn")
def test_stress_options_reach_the_run_and_are_said(dobc):
    options = (
        "--noise 0.01 --saturation 4 --period 0.05 --loss 0.1 --disturbance 0.1 --fail 3@1 "
        "--fail 4@1.5:freeze"
    )
    code, out, _ = dobc("paper-fixed", "--t-final", 2, *options.split(" "), "--out", "here")
    assert code == 0
    assert "agent 4 fails at 1.5 s (freeze)" in out
    stored = load_trajectory("here/trajectory.npz")
    failures = (Failure(agent="3", time=1.0), Failure(agent="4", time=1.5, kind="freeze"))
    stress = Stress(
        noise=0.01, saturation=4, period=0.05, loss=0.1, disturbance=0.1, failures=failures
    )
    assert stored.stress == stress_to_json(stress)
    assert np.array_equal(stored.x, simulate("paper-fixed", t_final=2, stress=stress).x)


def test_what_breaks_first_is_one_table_one_figure_and_one_document(dobc, proved, monkeypatch):
    from dobc_design.simulation import breaking as room

    monkeypatch.setattr(room, "OPTIONS", ("noise", "period"))
    monkeypatch.setattr(room, "BISECTIONS", 5)
    code, out, _ = dobc(
        "ring.toml", "--t-final", 1.5, "--certificate", proved, "--out", "here", "--json"
    )
    document = json.loads(out)
    breaking = document["breaking"]
    assert code == 0
    assert set(document) >= {
        "runs",
        "diverged",
        "final_error",
        "settling_time",
        "decay_rate",
        "files",
    }
    assert (
        [each["option"] for each in breaking["sweeps"]] == breaking["order"] == ["noise", "period"]
    )
    assert (
        0
        < breaking["period"]["certified"]
        < breaking["period"]["converges"]
        < breaking["period"]["fails"]
    )
    assert sorted(path.name for path in Path("here").iterdir()) == ["breaking.svg", "summary.json"]
    assert json.loads(Path("here/summary.json").read_text("utf-8")) == document
    assert "longest that works" in Path("here/breaking.svg").read_text("utf-8")
    assert dobc("ring.toml", "--t-final", 1.5, "--out", "here")[0] == 2
    monkeypatch.setattr(room, "OPTIONS", ("period",))
    _, out, _ = dobc("ring.toml", "--t-final", 1.5, "--certificate", proved)
    assert re.search(
        r"Sampling period: converges at 0\.25\d* s, no longer at 0\.25\d* s; certified up to 0\.13",
        out,
    )


def test_a_run_that_no_certificate_is_about_gets_a_note_in_place_of_a_bound(dobc, proved):
    code, out, _ = dobc(
        "ring.toml", "--t-final", 1, "--noise", 0.1, "--certificate", proved, "--json"
    )
    document = json.loads(out)
    assert code == 0
    assert document["certified"] is None
    assert "No certified bound: no certificate is about a loop under stress." in document["notes"]
