"""Sweeps whose drivers and workers are killed on the way: every case once in the end, equal to a
serial run."""

import json
import os
import signal
import tempfile
from importlib.util import find_spec
from pathlib import Path

from evidence.row import Row
from problem_texts import CHAIN
from processes import children, finish, kill, lines, start, wait_for, without_times, words_of

WITH_DASK = 1000  # cases from which on the second part runs on a cluster of Dask


def run(count: int, seed: int) -> Row:
    """The driver is killed after a third, with a torn line; after two thirds a Dask worker, then
    the driver again."""
    failures: list[str] = []
    notes: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "chain.toml"
        serial = Path(folder) / "serial"
        out = Path(folder) / "out"
        file.write_text(CHAIN, encoding="utf-8")
        reference = start(file, serial, "--jobs", "1", "--quiet", count=count)

        first = start(file, out, "--jobs", "2", "--quiet", count=count)
        wait_for(out, count // 3, first)
        kill(first)
        kept = len(lines(out))
        with (out / "results.jsonl").open("ab") as stream:
            stream.write(b'{"case": 1, "id": "to')
        notes.append(f"driver killed after {kept} of {count} cases")
        if count >= WITH_DASK:
            _on_dask(file, out, count, failures, notes)
        last = start(file, out, "--jobs", "2", "--json", count=count)
        code, printed, said = finish(last)
        if code != 0 or said:
            failures.append(f"the last run left with {code}: {said[-300:]}")
        elif json.loads(printed)["resumed"] < kept:
            failures.append("finished cases were lost")

        code, _, said = finish(reference)
        if code != 0:
            failures.append(f"the serial run left with {code}: {said[-300:]}")
        found = lines(out)
        wanted = lines(serial)
        numbers = [line["case"] for line in found]
        if sorted(numbers) != list(range(count)):
            failures.append(f"{len(numbers)} lines for {len(set(numbers))} cases of {count}")
        failures += [
            f"case {a['case']} differs from the serial run"
            for a, b in zip(without_times(found), without_times(wanted), strict=False)
            if a != b
        ]
    outcomes = {
        name: sum(
            1 for line in found if (line["result"] or {"verdict": "failed"})["verdict"] == name
        )
        for name in ("proved", "refuted", "undecided", "failed")
    }
    notes.append(", ".join(f"{number} {name}" for name, number in outcomes.items()))
    what = "cases of a sweep with killed drivers and workers, against a serial run"
    return Row(what, len(numbers), failures, notes, least=count)


def _on_dask(file: Path, out: Path, count: int, failures: list[str], notes: list[str]) -> None:
    """Two thirds of the way a worker is killed, a little later the driver."""
    if find_spec("distributed") is None:
        notes.append("no Dask: install dobc_design[cluster]")
        return
    driver = start(file, out, "--jobs", "2", "--cluster", "local", "--quiet", count=count)
    wait_for(out, count // 2, driver)
    workers = [pid for pid in children(driver.pid) if "spawn_main" in words_of(pid)]
    if not workers:
        failures.append("no Dask worker was found")
        kill(driver)
        return
    os.kill(workers[0], signal.SIGKILL)
    before = len(lines(out))
    wait_for(out, 2 * count // 3, driver)
    if len(lines(out)) <= before:
        failures.append("nothing went on after a Dask worker was killed")
    notes.append(
        f"a Dask worker killed after {before} cases, the driver again after {len(lines(out))}"
    )
    kill(driver)
