"""`dobc simulate`: the contract's document, files that appear whole, and an answer also when a run
diverges."""

import json
import re
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from problem_texts import RING
from typer.main import get_command

from dobc_design import load_trajectory, simulate
from dobc_design.cli.main import app
from dobc_design.plotting.look import Sheet

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
def dobc(command_line):
    """Run the command line in an empty folder: exit code, standard output, standard error."""
    return partial(command_line, "simulate")


def test_the_document_has_the_keys_of_the_contract_and_nothing_is_written(dobc):
    code, out, err = dobc("paper-fixed", "--t-final", 5, "--json")
    document = json.loads(out)
    assert (code, err) == (0, "")
    assert set(document) >= {
        "runs",
        "diverged",
        "final_error",
        "settling_time",
        "decay_rate",
        "files",
    }
    assert document["runs"] == 1
    assert document["diverged"] is False
    assert document["files"] == []
    assert set(document["final_error"]) == set(document["settling_time"]) == {"median", "max"}
    run = simulate("paper-fixed", t_final=5)
    assert document["final_error"] == {"median": run.final_error, "max": run.final_error}
    assert document["decay_rate"]["median"] == run.decay_rate()
    assert list(Path().iterdir()) == []


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


@pytest.mark.usefixtures("undrawn")
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


def test_files_change_together_or_not_at_all(dobc, monkeypatch):
    """The figure is drawn before the first file is written, and files of another kind of run do not
    stay beside."""
    monkeypatch.setattr(Sheet, "file", lambda self, kind: b"a figure")
    assert dobc("paper-fixed", "--t-final", 1, "--out", "here")[0] == 0
    before = {path.name: path.read_bytes() for path in Path("here").iterdir()}
    assert "trajectory.npz" in before
    again = ("paper-fixed", "--runs", 3, "--t-final", 1, "--out", "here", "--force")
    monkeypatch.setattr(Sheet, "file", lambda self, kind: 1 / 0)
    assert dobc(*again)[0] == 4
    assert {path.name: path.read_bytes() for path in Path("here").iterdir()} == before
    monkeypatch.setattr(Sheet, "file", lambda self, kind: b"another figure")
    assert dobc(*again)[0] == 0
    assert sorted(path.name for path in Path("here").iterdir()) == [
        "ensemble.npz",
        "simulation.svg",
        "summary.json",
    ]


@pytest.mark.usefixtures("undrawn")
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
    assert "settled to 1 % after   median never, max never\n" in out
    assert "probability of divergence 0." in out
    assert "median final error     no confidence interval" in out


@pytest.mark.parametrize(
    ("arguments", "key"),
    [
        (("paper-fixed", "--t-final", "0"), "--t-final"),
        (("paper-fixed", "--runs", "0"), "--runs"),
        (("paper-fixed", "--seed", "-1"), "--seed"),
        (("paper-fixed", "--mode", "Gz"), "--mode"),
        (("paper-fixed", "--start", "none.csv"), "--start"),
        (("no-such-problem",), "no-such-problem"),
        (("paper-fixed", "--out", "file"), "--out"),
        (("paper-fixed", "--out", "--json"), "--out"),
    ],
)
def test_a_mistake_is_named_by_its_key_and_nothing_is_written(dobc, arguments, key: str):
    Path("file").write_text("", encoding="utf-8")
    code, out, _ = dobc(*arguments, "--json")
    assert code == 2
    assert json.loads(out)["error"]["key"] == key
    assert [path.name for path in Path().iterdir()] == ["file"]


@pytest.mark.usefixtures("undrawn")
def test_a_start_and_a_mode_can_be_given(dobc):
    Path("x.csv").write_text("\n".join(map(str, range(10))), encoding="utf-8")
    code, out, _ = dobc(
        "paper-switching", "--start", "x.csv", "--mode", "Gb", "--t-final", 1, "--out", "here"
    )
    stored = load_trajectory("here/trajectory.npz")
    assert code == 0
    assert stored.x[0].ravel().tolist() == list(range(10))
    assert stored.mode == "Gb"
    assert 'mode "Gb"' in out


FLOCK = """\
name = "flock"
target = [1, 2]
[network]
agents = ["uav-8", "uav-9"]
arrow = "listens_to"
modes.G = [["uav-9", "uav-8"]]
[coupling]
h = "y"
[pinning]
gains = { uav-8 = 2 }
[exosystem]
A = [[0]]
C = [[1], [2]]
"""


def test_agents_that_move_in_space_are_written_as_a_page(dobc, monkeypatch):
    Path("flock.toml").write_text(FLOCK, encoding="utf-8")
    with monkeypatch.context() as own:
        own.setattr(Sheet, "file", lambda self, kind: b"a figure")
        code, out, _ = dobc("flock.toml", "--t-final", 2, "--out", "here")
    assert "Note: No W was given: it was designed." in out
    page = Path("here/network.html").read_text("utf-8")
    assert code == 0
    assert "uav-9" in page
    assert dobc("flock.toml", "--runs", 2, "--t-final", 1, "--out", "many")[0] == 0
    assert not Path("many/network.html").exists()
    assert "5 to 95 %" in Path("many/simulation.svg").read_text("utf-8")


def test_a_certificate_is_drawn_into_the_figure_and_bounds_the_end(dobc, proved):
    code, out, _ = dobc(
        "ring.toml", "--t-final", 2, "--certificate", proved, "--out", "here", "--json"
    )
    document = json.loads(out)
    certified = document["certified"]
    assert code == 0
    assert certified["sources"] == ["max-separable"]
    assert document["final_error"]["max"] < certified["final_error"] < 1
    assert "certified bound on |e|∞" in Path("here/simulation.svg").read_text("utf-8")
    code, out, _ = dobc(
        "ring.toml", "--runs", 3, "--t-final", 2, "--certificate", proved / "certificate.json"
    )
    assert f"final |e|_inf <= {certified['final_error']:.4g}, by max-separable" in out


def test_a_certificate_that_does_not_hold_shows_nothing(dobc, proved):
    """Its rate, raised by hand; and the certificate of one problem beside another."""
    place = proved / "certificate.json"
    text = place.read_text("utf-8")
    claimed = json.loads(text)
    check = next(each for each in claimed["checks"] if each["id"] == "max-separable")
    check["exact"]["alpha"] = "1000"
    check["rate"] = 1000.0
    place.write_text(json.dumps(claimed), encoding="utf-8")
    for problem in ("ring.toml", "other.toml"):
        code, out, _ = dobc(problem, "--certificate", proved, "--out", "here", "--json")
        assert code == 2
        assert json.loads(out)["error"]["key"] == "--certificate"
        assert not Path("here").exists()
        Path("other.toml").write_text(RING.replace("gains = 3", "gains = 4"), encoding="utf-8")
        place.write_text(text, encoding="utf-8")


@pytest.mark.parametrize(
    "option", ["--noise", "--saturation", "--loss", "--fail", "--worst", "--what-breaks-first"]
)
def test_an_option_that_moved_names_the_command_that_has_it_and_that_command_has_it(
    dobc, option: str
):
    code, out, _ = dobc("paper-fixed", option, "1", "--json")
    error = json.loads(out)["error"]
    assert code == 2
    assert error["kind"] == "usage"
    assert error["key"] == option
    written = re.fullmatch(r"Write `dobc (stress) FILE ?(--\w+)?`\.", error["cure"])
    command = get_command(app).commands[written[1]]
    known = {name for each in command.params for name in each.opts}
    assert written[2] in known or (written[2] is None and option == "--what-breaks-first")
