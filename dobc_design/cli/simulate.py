"""``dobc simulate``: runs of the closed loop as the problem states it."""

from __future__ import annotations

from dobc_design.cli import output
from dobc_design.cli.options import in_groups
from dobc_design.cli.runs import Answer, Runs, make_runs


@in_groups
def simulate(file: output.File, runs: Runs, answer: Answer) -> None:
    """Simulate runs of the closed loop; the exit code is 0 even if a run diverges."""
    make_runs(file, runs, answer)
