"""Certified settling times of the paper's examples against simulated runs: no run may cross the envelope."""

from __future__ import annotations

from evidence.row import Row
from settled import compare

from dobc_design.spec.load import load_problem
from dobc_design.workflow import certify_settling

PROBLEMS = ("paper-fixed", "paper-switching")


def run(count: int, seed: int) -> Row:
    """``count`` random starts, shared by the two problems, and corners of their boxes."""
    failures: list[str] = []
    notes = []
    runs = 0
    for name in PROBLEMS:
        problem = load_problem(name)
        settling = certify_settling(problem)
        if settling.time is None or settling.single_time is None:
            failures.append(f"{name}: {settling.reason}")
            continue
        found = compare(problem, settling, runs=max(1, count // len(PROBLEMS)), seed=seed)
        runs += found.runs
        failures += [f"{name}: {text}" for text in found.crossings]
        notes.append(
            f"{name}: certified {settling.time:.1f} s by {len(settling.stages)} stages ({settling.single_time:.1f} s by"
            f" one rate), slowest simulated {found.settled:.1f} s, ratio {settling.time / found.settled:.2f}"
        )
    what = "certified settling times: no simulated run crosses the envelope"
    return Row(what=what, count=runs, failures=tuple(failures), notes=tuple(notes), least=count)
