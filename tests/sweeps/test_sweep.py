"""Sweeps: every case once, failures among them, stopped and resumed; the same whoever computes
it."""

import json
import os
import signal
import time
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import pytest
from problem_texts import CHAIN
from processes import without_times

import dobc_design as dd
from dobc_design import Verdict, load_problem
from dobc_design.errors import SpecError
from dobc_design.sweeps import running
from dobc_design.sweeps.plan import Plan, Task, make_plan
from dobc_design.sweeps.result import Journal
from dobc_design.sweeps.running import LOKY, State, TooLong, outcomes, run_case, sweep, within

OVER = {
    "pinning.gains.3": "0,4",
    "coupling.h": "y,-y,y+1",
    "network.modes.G[0][2]": "~uniform(0.5,2)",
}


@pytest.fixture
def chain(tmp_path) -> Path:
    path = tmp_path / "chain.toml"
    path.write_text(CHAIN, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    path = tmp_path_factory.mktemp("sweep") / "chain.toml"
    path.write_text(CHAIN, encoding="utf-8")
    return sweep(path, OVER, samples=2, jobs=1)


def test_every_case_stands_in_the_journal_as_soon_as_it_is_finished(chain, tmp_path):
    seen = []

    def look(state: State) -> None:
        written = (tmp_path / "out" / "results.jsonl").read_bytes().count(b"\n")
        state_seen = (state.done, written)
        seen.append(state_seen)

    sweep(chain, OVER, samples=1, jobs=1, out=tmp_path / "out", progress=look)
    assert seen == [(k, k) for k in range(7)]


def test_a_sweep_says_of_every_case_what_certify_says_of_the_same_file(chain, result):
    """The oracle is certify on a text in which the values were put by hand."""
    assert len(result) == 2 * 3 * 2
    for row in result.rows[::5]:
        gain = Fraction(str(row["pinning.gains.3"]))
        weight = Fraction(str(row["network.modes.G[0][2]"]))
        text = CHAIN.replace("3 = 5", f'3 = "{gain}"').replace('"y"', f'"{row["coupling.h"]}"')
        chain.write_text(text.replace("[1, 2]", f'[1, 2, "{weight}"]'), encoding="utf-8")
        if row["coupling.h"] == "y+1":
            with pytest.raises(SpecError, match="must vanish"):
                load_problem(chain)
            assert "must vanish" in row["error"]
            continue
        certificate = dd.certify(chain)
        wanted = {
            "verdict": certificate.verdict.value,
            "rate": certificate.rate,
            "reason": certificate.reason,
        }
        assert {name: row[name] for name in wanted} == wanted


def test_simulations_can_be_swept_and_diverging_ones_are_results(tmp_path):
    text = CHAIN + "[region]\ninitial_states = [0, 9]\n[simulation]\nt_final = 5\n"
    (tmp_path / "c.toml").write_text(text, encoding="utf-8")
    found = sweep(tmp_path / "c.toml", ["coupling.h=y,-y**3"], task="simulate", jobs=1)
    assert found.outcomes == {"converged": 1, "diverged": 1}
    run = dd.simulate(tmp_path / "c.toml")
    assert found.rows[0]["final_error"] == run.final_error
    assert found.rows[0]["settling_time"] == run.settling_time()


def test_arcs_from_a_file_are_read_once_and_travel_with_the_cases(tmp_path):
    (tmp_path / "arcs.csv").write_text("1,2\n2,3\n", encoding="utf-8")
    text = CHAIN.replace("G = [[1, 2], [2, 3]]", 'G = { file = "arcs.csv" }')
    (tmp_path / "c.toml").write_text(text, encoding="utf-8")
    plan = make_plan(tmp_path / "c.toml", ["pinning.gains.3=1,2"], task=Task())
    (tmp_path / "arcs.csv").unlink()
    line = run_case(plan, 1)
    assert line["result"]["verdict"] == Verdict.PROVED.value


@pytest.mark.parametrize(
    ("over", "options", "words"),
    [
        ({"pinning.gain.3": "1,2"}, {}, "unknown key"),
        ({"coupling.h": "y+1,y+2"}, {}, "must vanish"),
        ({"coupling.h": "~choice(y)"}, {}, "samples must say how many times coupling.h is drawn"),
        ({"coupling.h": "y"}, {"samples": 3}, "samples must be left out"),
        ({"coupling.h": "y"}, {"task": "dream"}, "task must be one of certify, simulate"),
        ({"coupling.h": "y"}, {"runs": 3}, "runs is for simulations"),
        ({"coupling.h": "y"}, {"task": "simulate", "everything": True}, "is for certify"),
        ({"coupling.h": "y"}, {"jobs": 0}, "jobs must be a whole number"),
        ({"coupling.h": "y"}, {"time_limit": 0}, "time_limit must be a number of seconds > 0"),
        ({"coupling.h": "y"}, {"time_limit": "inf"}, "time_limit must be a number"),
        ({"target": "1:2:2000", "pinning.gains.3": "1:2:2000"}, {}, "these axes give 4000000"),
        ({"coupling.h": "~choice(y)"}, {"samples": 0}, "samples must be a whole number >= 1"),
    ],
)
def test_a_sweep_that_cannot_be_meant_is_refused_before_anything_is_written(
    chain, tmp_path, over, options, words
):
    with pytest.raises(SpecError, match=words):
        sweep(chain, over, out=tmp_path / "out", **options)
    assert not (tmp_path / "out").exists()


def test_a_sweep_that_was_stopped_goes_on_and_ends_like_one_that_was_not(
    chain, tmp_path, result, monkeypatch
):
    out, seen = tmp_path / "out", []

    def stop(state: State) -> None:
        seen.append(state.done)
        if state.done == 7:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sweep(chain, OVER, samples=2, jobs=1, out=out, progress=stop)
    with (out / "results.jsonl").open("ab") as stream:
        stream.write(b'{"case": 3, "id": "torn')  # what a kill in the middle of a write leaves
    count = len((out / "results.jsonl").read_bytes().split(b"\n")) - 1
    assert count == 7
    seen.clear()
    found = sweep(
        chain, OVER, samples=2, jobs=1, out=out, progress=lambda state: seen.append(state.done)
    )
    assert seen == list(range(7, 13)), "nothing is done twice"
    assert without_times(list(found.lines)) == without_times(list(result.lines))
    lines = (out / "results.jsonl").read_bytes().splitlines()
    written = [json.loads(line) for line in lines]
    assert sorted(line["case"] for line in written) == list(range(12))
    seen.clear()
    sweep(chain, OVER, samples=2, jobs=1, out=out, progress=lambda state: seen.append(state.done))
    assert seen == [12]


def test_lines_that_are_broken_or_belong_to_no_case_are_done_again(chain, tmp_path, result):
    out = tmp_path / "out"
    sweep(chain, OVER, samples=2, jobs=1, out=out)
    lines = (out / "results.jsonl").read_bytes().splitlines()
    line = json.loads(lines[4])
    changes = {"values": ["9", "y", "1"]}
    other = line | changes
    cut = json.dumps(other).encode()
    lines[2:5] = [b"\xff garbage", b"[1, 2]", cut]
    (out / "results.jsonl").write_bytes(b"\n".join(lines) + b"\n")
    done: list[int] = []
    found = sweep(
        chain, OVER, samples=2, jobs=1, out=out, progress=lambda state: done.append(state.done)
    )
    assert done[0] == 9
    assert without_times(list(found.lines)) == without_times(list(result.lines))


@pytest.mark.parametrize("change", ["values", "problem", "seed", "task", "samples"])
def test_a_folder_of_another_sweep_is_refused_and_left_alone_unless_forced(chain, tmp_path, change):
    out = tmp_path / "out"
    over = {"coupling.h": "y", "target": "~uniform(0,1)"}
    options = {"samples": 2, "seed": 0, "task": "certify"}
    sweep(chain, over, out=out, jobs=1, **options)
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    if change == "samples":  # by hand, in the file that says what is swept
        (out / "sweep.json").write_bytes(
            before["sweep.json"].replace(b'"samples": 2', b'"samples": 3')
        )
        before["sweep.json"] = (out / "sweep.json").read_bytes()
    elif change == "values":
        over["coupling.h"] = "y,tanh(y)"
    elif change == "problem":
        chain.write_text(CHAIN.replace("3 = 5", "3 = 6"), encoding="utf-8")
    else:
        options |= {"seed": 1} if change == "seed" else {"task": "simulate"}
    with pytest.raises(SpecError, match=f"was made for another sweep, with another .*{change}"):
        sweep(chain, over, out=out, jobs=1, **options)
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before
    again = sweep(chain, over, out=out, jobs=1, force=True, **options)
    assert len(again) == (4 if change == "values" else 2)


@pytest.mark.skipif(os.name == "nt", reason="files are not locked there")
def test_two_at_a_time_in_one_folder_are_refused(chain, tmp_path):
    plan = make_plan(chain, {"coupling.h": "y"}, task=Task())
    with (
        Journal(tmp_path / "out", plan),
        pytest.raises(SpecError, match="another process is at work"),
    ):
        sweep(chain, {"coupling.h": "y"}, out=tmp_path / "out", jobs=1)
    results = sweep(chain, {"coupling.h": "y"}, out=tmp_path / "out", jobs=1)
    assert len(results) == 1


def endless() -> None:
    while True:
        pass


def test_work_over_its_time_is_interrupted_and_work_within_it_is_left_alone():
    with pytest.raises(TooLong):
        within(0.05, endless)
    assert within(60, lambda: 3) == 3
    assert within(None, lambda: 4) == 4


def test_a_case_over_its_time_is_recorded_and_done_again_only_with_more_time(chain, tmp_path):
    class Endless(Task):
        def run(self, problem) -> dict:
            endless()
            return {}

    plan = make_plan(chain, ["target=1,2"], task=Task())
    late = run_case(replace(plan, task=Endless()), 1, 0.05)
    assert late["error"]["kind"] == "time"
    assert "given up after 0.05 s" in late["error"]["message"]
    out = tmp_path / "out"
    with Journal(out, plan) as journal:
        journal.append(run_case(plan, 0))
        journal.append(late)
    outcomes_found = sweep(chain, ["target=1,2"], out=out, time_limit=0.05)
    expected = {"proved": 1, "failed": 1}
    assert outcomes_found.outcomes == expected
    done: list[int] = []
    found = sweep(
        chain, ["target=1,2"], out=out, jobs=1, progress=lambda state: done.append(state.done)
    )
    assert done == [1, 2]
    assert found.outcomes == {"proved": 2}
    outcomes_again = sweep(chain, ["target=1,2"], out=out, jobs=1)
    assert outcomes_again.outcomes == {"proved": 2}


def deadly(chain: Path) -> Plan:
    """Five cases, of which the third kills its worker, the fourth never ends, and the fifth never
    leaves a library."""

    class Deadly:  # not importable in the workers, so it is sent to them as it is
        def prepare(self) -> None: ...

        def to_json(self) -> dict:
            return {}

        def run(self, problem) -> dict:
            if problem.target[0] == 3:
                os.kill(os.getpid(), signal.SIGKILL)
            while problem.target[0] == 4:
                time.sleep(0.1)
            if problem.target[0] == 5:  # in C, where no exception of Python reaches it
                time.sleep(3600)
            return {"verdict": "proved"}

    plan = make_plan(chain, ["target=1:5:5"], task=Task())
    return replace(plan, task=Deadly())


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="signals of Unix")
def test_a_case_that_kills_its_worker_is_recorded_and_the_others_are_done(chain, monkeypatch):
    """The worker of one case is killed, two never end; what was in hand with them is done again."""
    monkeypatch.setattr(running, "GRACE", 1.0)
    all_outcomes = outcomes(deadly(chain), range(5), jobs=2, backend=LOKY, limit=2)
    found = list(all_outcomes)
    assert sorted(line["case"] for line in found) == list(range(5))
    kinds = {}
    for line in found:
        if line["error"]:
            kinds[line["case"]] = line["error"]["kind"]
    assert kinds == {2: "worker", 3: "time", 4: "time"}


def test_a_state_says_itself_in_words():
    partial = State(total=20, done=8, resumed=3, failed=1)
    assert str(partial) == "8 of 20 cases, 3 of them from before, 1 failed"
    complete = State(total=20, done=20, resumed=0, failed=0)
    assert str(complete) == "20 of 20 cases"
