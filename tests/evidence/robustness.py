"""Kills, interrupts and broken input, counted: what ``tests/robustness`` shows, with the full
counts."""

import signal
import tempfile
import time
from pathlib import Path

from broken_input import TARGETS, Target, as_text, defect, mutants
from evidence.row import Row
from processes import Outcome, interrupt_certify, kill_certify, kill_writers


def kills(count: int, seed: int) -> Row:
    """kill -9 of certify, with its report; half of them aim at its writing."""
    with tempfile.TemporaryDirectory() as folder:
        outcome = kill_certify(count, seed, Path(folder), report=True)
    return _row(
        "kill -9 of `dobc certify`: each file whole, old or new, and verify accepts it",
        count,
        outcome,
    )


def writers(count: int, seed: int) -> Row:
    """kill -9 of a loop that only writes."""
    with tempfile.TemporaryDirectory() as folder:
        outcome = kill_writers(count, seed, Path(folder))
    return _row("kill -9 of a loop that replaces three files: each whole", count, outcome)


def interrupts(count: int, seed: int) -> Row:
    """SIGINT, and a third as many SIGTERM, from the first line of the program on."""
    total = Outcome()
    for number, times in ((signal.SIGINT, count), (signal.SIGTERM, max(1, count // 3))):
        with tempfile.TemporaryDirectory() as folder:
            outcome = interrupt_certify(times, seed, Path(folder), number=number, report=True)
        total.counts += outcome.counts
        total.wrong += outcome.wrong
    times = total.counts["interrupted"]
    return _row(
        "Ctrl-C and SIGTERM of `dobc certify`: 130 or 143, no traceback, a whole set of files",
        times,
        total,
    )


def _row(what: str, count: int, outcome: Outcome) -> Row:
    counts = ", ".join(f"{number} {name}" for name, number in sorted(outcome.counts.items()))
    return Row(what, count, outcome.wrong, [counts])


def fuzz(seconds: int, seed: int) -> Row:
    """Mutants for every reader in turn, for so many seconds of CPU time; the seed fixes their
    order."""
    streams = {target.name: mutants(target, seed) for target in TARGETS}
    counts = dict.fromkeys(streams, 0)
    accepted = dict.fromkeys(streams, 0)
    failures: list[str] = []
    started = time.process_time()
    while time.process_time() - started < seconds:
        for target in TARGETS:
            taken: list[bool] = []
            counting = Target(
                name=target.name,
                run=lambda data, t=target, taken=taken: taken.append(t.run(data)),
                seeds=target.seeds,
            )
            end = time.process_time() + min(1.0, seconds / len(TARGETS))
            while time.process_time() < end:
                data = next(streams[target.name])
                wrong = defect(counting, data)
                counts[target.name] += 1
                failures += [f"{target.name}: {wrong}: {as_text(data)}"] if wrong else []
            accepted[target.name] += sum(taken)
    spent = time.process_time() - started
    notes = [f"{name}: {counts[name]} inputs, {accepted[name]} of them read" for name in counts]
    what = "broken input for every reader: no crash, no hang over 2 s, no traceback"
    return Row(
        what, sum(counts.values()), failures, [f"{spent:.0f} s of CPU time", *notes], least=1000
    )
