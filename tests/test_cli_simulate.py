"""`dobc simulate`: the contract's document, files that appear whole, and an answer also when a run diverges."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from dobc_design.cli import main
from dobc_design.simulate.storage import load_trajectory
from dobc_design.simulate.stress import Failure, Stress, stress_from_json
from dobc_design.workflow import simulate

DIVERGING = """\
name = "apart"
[network]
agents = 2
arrow = "listens_to"
[network.modes]
G = [[1, 2]]
[coupling]
h = "-y**3"
[region]
initial_states = [0, 9]
"""


@pytest.fixture
def dobc(capsys, tmp_path, monkeypatch):
    """Run the command line in an empty folder: exit code, standard output, standard error."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments: object) -> tuple[int, str, str]:
        with pytest.raises(SystemExit) as caught:
            main(["simulate", *map(str, arguments)])
        captured = capsys.readouterr()
        assert "Traceback" not in captured.err
        return int(str(caught.value.code)), captured.out, captured.err

    return run


def test_the_document_has_the_keys_of_the_contract_and_nothing_is_written(dobc):
    code, out, err = dobc("paper-fixed", "--t-final", 5, "--json")
    document = json.loads(out)
    assert (code, err) == (0, "")
    assert set(document) >= {"runs", "diverged", "final_error", "settling_time", "decay_rate", "files"}
    assert (document["runs"], document["diverged"], document["files"]) == (1, False, [])
    assert set(document["final_error"]) == set(document["settling_time"]) == {"median", "max"}
    run = simulate("paper-fixed", t_final=5)
    assert document["final_error"] == {"median": run.final_error, "max": run.final_error}
    assert document["decay_rate"]["median"] == run.decay_rate()
    assert list(Path().iterdir()) == []


def test_runs_give_medians_and_maxima_over_the_seeds(dobc):
    code, out, _ = dobc("paper-switching", "--runs", 9, "--seed", 4, "--t-final", 3, "--json")
    document = json.loads(out)
    finals = [simulate("paper-switching", seed=4 + k, t_final=3).final_error for k in range(9)]
    assert code == 0
    assert document["runs"] == 9
    assert document["final_error"]["median"] == pytest.approx(np.median(finals), rel=1e-6)
    assert document["final_error"]["max"] == pytest.approx(max(finals), rel=1e-6)
    assert document["mode"] == "Ga, Gb, Gc, Gd (random, drawn anew every 0.5 s)"


def test_one_run_is_written_as_a_trajectory_that_can_be_read(dobc):
    code, out, _ = dobc("paper-switching", "--t-final", 3, "--out", "here")
    assert code == 0
    names = ["trajectory.npz", "summary.json", "simulation.svg"]
    assert sorted(path.name for path in Path("here").iterdir()) == sorted(names)
    summary = json.loads(Path("here/summary.json").read_text("utf-8"))
    stored = load_trajectory("here/trajectory.npz")
    assert stored.final_error == summary["final_error"]["median"]
    assert np.array_equal(stored.x, simulate("paper-switching", t_final=3).x)
    assert [Path(file) for file in summary["files"]] == [Path("here") / name for name in names]
    assert Path("here/simulation.svg").read_text("utf-8").count("time t in s") == 1
    assert "wrote here" in out


def test_files_are_overwritten_with_force_only(dobc):
    assert dobc("paper-fixed", "--runs", 2, "--t-final", 1, "--out", "here")[0] == 0
    before = Path("here/ensemble.npz").read_bytes()
    code, out, _ = dobc("paper-fixed", "--runs", 3, "--t-final", 1, "--out", "here", "--json")
    error = json.loads(out)["error"]
    assert code == 2
    assert error["key"] == "--out"
    assert "exists already" in error["message"]
    assert "--force" in error["cure"]
    assert Path("here/ensemble.npz").read_bytes() == before
    assert dobc("paper-fixed", "--runs", 3, "--t-final", 1, "--out", "here", "--force")[0] == 0
    with np.load("here/ensemble.npz") as stored:
        assert len(stored["seeds"]) == 3


def test_a_run_that_diverges_is_an_answer(dobc):
    Path("apart.toml").write_text(DIVERGING, encoding="utf-8")
    code, out, _ = dobc("apart.toml", "--json", "--out", "here")
    document = json.loads(out)
    assert code == 0
    assert document["diverged"] is True
    assert document["settling_time"] == {"median": None, "max": None}
    assert "t = " in document["reasons"][0]["reason"]
    assert load_trajectory("here/trajectory.npz").diverged
    code, out, _ = dobc("apart.toml", "--runs", 8)
    assert code == 0
    assert "... and" in out


@pytest.mark.parametrize(
    ("arguments", "key"),
    [
        (("paper-fixed", "--t-final", "0"), "t_final"), (("paper-fixed", "--t-final", "nan"), "t_final"),
        (("paper-fixed", "--runs", "0"), "runs"), (("paper-fixed", "--seed", "-1"), "seed"),
        (("paper-fixed", "--mode", "Gz"), "mode"), (("paper-fixed", "--start", "none.csv"), "start"),
        (("no-such-problem",), "no-such-problem"), (("paper-fixed", "--out", "file"), "--out"),
        (("paper-fixed", "--out", "--json"), "--out"),
    ],
)  # fmt: skip
def test_a_mistake_is_named_by_its_key_and_nothing_is_written(dobc, arguments, key: str):
    Path("file").write_text("", encoding="utf-8")
    code, out, _ = dobc(*arguments, "--json")
    assert code == 2
    assert json.loads(out)["error"]["key"] == key
    assert [path.name for path in Path().iterdir()] == ["file"]


def test_a_start_and_a_mode_can_be_given(dobc):
    Path("x.csv").write_text("\n".join(map(str, range(10))), encoding="utf-8")
    code, out, _ = dobc("paper-switching", "--start", "x.csv", "--mode", "Gb", "--t-final", 1, "--out", "here")
    stored = load_trajectory("here/trajectory.npz")
    assert code == 0
    assert stored.x[0].ravel().tolist() == list(range(10))
    assert stored.mode == "Gb"
    assert 'mode "Gb"' in out


def test_what_was_chosen_is_said(dobc):
    _, out, _ = dobc("uav-swarm", "--t-final", 1)
    assert "Note: No W was given: it was designed." in out


def test_stress_options_reach_the_run_and_are_said(dobc):
    options = ("--noise", 0.01, "--saturation", 4, "--period", 0.05, "--loss", 0.1, "--disturbance", 0.1)
    code, out, _ = dobc(
        "paper-fixed", "--t-final", 2, *options, "--fail", "3@1", "--fail", "4@1.5:freeze", "--out", "here"
    )
    assert code == 0
    assert "agent 4 fails at 1.5 s (freeze)" in out
    stored = load_trajectory("here/trajectory.npz")
    failures = (Failure(agent="3", time=1.0), Failure(agent="4", time=1.5, kind="freeze"))
    stress = Stress(noise=0.01, saturation=4, period=0.05, loss=0.1, disturbance=0.1, failures=failures)
    assert stress_from_json(stored.stress) == stress
    assert np.array_equal(stored.x, simulate("paper-fixed", t_final=2, stress=stress).x)


@pytest.mark.parametrize(
    ("arguments", "key"),
    [
        (("--fail", "3"), "--fail"), (("--fail", "3@soon"), "--fail"), (("--fail", "3@1:melt"), "--fail"),
        (("--fail", "99@1"), "failures"), (("--loss", "2"), "loss"), (("--period", "-1"), "period"),
        (("--noise", "nan"), "noise"), (("--saturation", "0"), "saturation"),
    ],
)  # fmt: skip
def test_a_wrong_stress_is_named_by_its_key(dobc, arguments, key: str):
    code, out, _ = dobc("paper-fixed", *arguments, "--json")
    assert code == 2
    assert json.loads(out)["error"]["key"] == key


def test_agents_that_move_in_space_are_written_as_a_page(dobc):
    code, _, _ = dobc("uav-swarm", "--t-final", 2, "--out", "here")
    page = Path("here/network.html").read_text("utf-8")
    assert code == 0
    assert "uav-9" in page
    assert dobc("uav-swarm", "--runs", 2, "--t-final", 1, "--out", "many")[0] == 0
    assert not Path("many/network.html").exists()
    assert "5 to 95 %" in Path("many/simulation.svg").read_text("utf-8")
