"""`dobc sweep`: one document, files that can be gone on with, and clusters."""

import json
import math
import os
import signal
import sys
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import pytest
from problem_texts import CHAIN
from processes import axes, children, finish, kill, lines, start, wait_for, without_times, words_of

from dobc_design.sweeps.result import SweepResult
from dobc_design.sweeps.running import sweep


@pytest.fixture
def dobc(command_line):
    """Run the command line in a folder with chain.toml: exit code, standard output, standard
    error."""
    Path("chain.toml").write_text(CHAIN, encoding="utf-8")
    return partial(command_line, "sweep")


def test_the_document_counts_outcomes_and_a_second_run_does_nothing_again(dobc):
    options = ("chain.toml", "pinning.gains.3=0:4:3", "coupling.h=y,y+1", "--jobs", 1)
    code, out, err = dobc(*options, "--json")
    document = json.loads(out)
    assert (code, err) == (0, "")
    assert document["cases"] == 6
    assert document["resumed"] == 0
    assert document["out"] == "chain-sweep"
    assert document["outcomes"] == {"proved": 2, "refuted": 1, "failed": 3}
    assert document["failures"][0]["values"] == {"pinning.gains.3": "0", "coupling.h": "y+1"}
    assert "must vanish" in document["failures"][0]["error"]["message"]
    for file in document["files"]:
        assert Path(file).exists()
    names = {Path(file).name for file in document["files"]}
    assert names >= {"sweep.json", "results.jsonl", "results.csv", "sweep.svg"}
    journal = Path("chain-sweep/results.jsonl").read_bytes()
    again = json.loads(dobc(*options, "--json")[1])
    assert again["resumed"] == 6
    assert again["outcomes"] == document["outcomes"]
    assert Path("chain-sweep/results.jsonl").read_bytes() == journal


def test_numbers_from_1e_300_to_1e300_are_drawn_side_by_side_or_a_note_says_why_not(
    dobc, monkeypatch
):
    """A rate at a pin's gain of 1e300 is still a number; along the axis such gains have no common
    scale."""
    options = (
        "chain.toml",
        "pinning.gains.3=1e-300,1,1e300",
        "coupling.h=y,2*y",
        "--jobs",
        1,
    )
    code, out, err = dobc(*options, "--json")
    assert code == 0, err
    assert Path("chain-sweep/sweep.svg").exists()
    assert json.loads(out)["notes"] == []
    assert "1e300" in Path("chain-sweep/sweep.svg").read_text("utf-8")
    monkeypatch.setattr(SweepResult, "plot", lambda self: math.exp(1000))
    code, out, err = dobc(*options)
    assert code == 0, err
    assert "No figure: Matplotlib cannot draw these numbers (math range error)." in out
    assert not Path("chain-sweep/sweep.svg").exists()


@pytest.mark.usefixtures("undrawn")
def test_words_name_the_range_of_every_number_and_the_first_failures(dobc):
    code, out, _ = dobc(
        "chain.toml", "pinning.gains.3=1:4:2", "coupling.h=y,y+1", "--jobs", 1, "--out", "here"
    )
    assert code == 0
    assert "4 cases of pinning.gains.3, coupling.h: 2 proved, 2 failed" in out
    assert "certified rate in 1/s" in out
    assert 'coupling.h "y+1" must vanish at y = 0 but equals 1; did you mean "y"?' in out
    assert "wrote here/results.csv" in out


@pytest.mark.usefixtures("undrawn")
def test_verbose_tells_every_tenth_part_and_quiet_nothing(dobc):
    code, out, err = dobc("chain.toml", "pinning.gains.3=1:4:20", "--jobs", 1, "-v")
    told = err.splitlines()
    assert code == 0
    assert len(told) == 11
    assert told[0] == "0 of 20 cases"
    assert told[-1] == "20 of 20 cases"
    assert out
    assert dobc("chain.toml", "pinning.gains.3=1:4:2", "--jobs", 1, "--out", "quiet", "-q")[1:] == (
        "",
        "",
    )


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("coupling.h",), "KEY=VALUES"),
        (("coupling.h=y+1",), "must vanish"),
        (("pinning.gain.3=1",), 'did you mean "gains"?'),
        (("coupling.h=~choice(y)",), "--samples 100"),
        (("coupling.h=y", "--task", "dream"), "task must be one of"),
        (("coupling.h=y", "--out", "chain.toml"), "is not a folder"),
        ((), "Missing argument"),
    ],
)
def test_a_mistake_is_one_message_and_nothing_is_written(dobc, options, words):
    code, out, err = dobc("chain.toml", *options)
    assert (code, out) == (2, "")
    assert words in err
    assert [path.name for path in Path().iterdir()] == ["chain.toml"]


def test_without_dask_the_message_says_what_to_install(dobc, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    code, _, err = dobc("chain.toml", "coupling.h=y", "--cluster", "local")
    assert (code, "dobc_design[cluster]" in err, "dobc doctor" in err) == (2, True, True)


@pytest.mark.slow
@pytest.mark.skipif(
    find_spec("distributed") is None, reason="needs Dask: install dobc_design[cluster]"
)
@pytest.mark.skipif(not Path("/proc").exists(), reason="workers are found through /proc")
def test_dask_workers_that_are_killed_cost_nothing(tmp_path):
    """The cases that it had are done by others; the journal has each case once, equal to a serial
    run."""
    file = tmp_path / "chain.toml"
    out = tmp_path / "out"
    count = 60
    file.write_text(CHAIN, encoding="utf-8")
    driver = start(file, out, "--jobs", "2", "--cluster", "local", "--json", count=count)
    try:
        wait_for(out, 5, driver)
        workers = [pid for pid in children(driver.pid) if "spawn_main" in words_of(pid)]
        assert len(workers) == 2
        for worker in workers:  # both of them, so that nothing lives on in the memory of one
            os.kill(worker, signal.SIGKILL)
            wait_for(out, len(lines(out)) + 10, driver)
        code, printed, said = finish(driver)
    finally:
        kill(driver)
    assert (code, said) == (0, "")
    assert json.loads(printed)["cases"] == count
    found = lines(out)
    assert sorted(line["case"] for line in found) == list(range(count))
    values = [text for text in axes(count) if not text.startswith("--")][:3]
    serial = sweep(file, values, samples=count // 20, seed=3, jobs=1)
    assert without_times(found) == without_times(list(serial.lines))
