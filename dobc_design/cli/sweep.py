"""``dobc sweep``: a bar with the time left on standard error, tables, a figure and a summary."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from dobc_design._signals import say_on_ending
from dobc_design.cli import output
from dobc_design.errors import DobcError, SpecError

if TYPE_CHECKING:
    from dobc_design.sweeps.result import SweepResult
    from dobc_design.sweeps.running import State

SHOWN = 5  # failed cases that are told
MOST_FAILURES = 100  # that a document holds


def sweep(
    file: str,
    axes: list[str],
    task: str = "certify",
    samples: int | None = None,
    seed: int = 0,
    runs: int = 1,
    everything: bool = False,
    out: Path | None = None,
    jobs: int | None = None,
    cluster: str | None = None,
    time_limit: str | None = None,
    force: bool = False,
    quiet: bool = False,
    verbose: bool = False,
    as_json: bool = False,
) -> None:
    """Certify or simulate a problem for many values of some keys; a stopped sweep can be
    continued."""
    from dobc_design.sweeps import running

    stages = _Bar(quiet=quiet, verbose=verbose)
    name = "" if out is not None else output.load_problem(file).name
    folder = output.results_folder(out, name, suffix="sweep")
    command = shlex.join(["dobc", *sys.argv[1:]])
    # Whoever stops a sweep of hours wants to know that nothing is lost.
    say_on_ending(
        f"Interrupted; the finished cases are kept in {str(folder)!r}. The same command goes "
        f"on with the others:\n  {command}"
    )
    with stages as progress, output.naming_options("sweep"):
        result = running.sweep(
            file,
            axes,
            task=task,
            samples=samples,
            seed=seed,
            runs=runs,
            everything=everything,
            out=folder,
            jobs=jobs,
            cluster=cluster,
            time_limit=time_limit,
            force=force,
            progress=progress,
        )
    files, figure = _files(folder), folder / "sweep.svg"
    note = _draw(result, figure)
    if note is None:
        files.append(figure)
    notes = [] if note is None else [note]
    if as_json:
        document = _document(result, folder, files, resumed=stages.resumed)
        output.print_json(document | {"notes": notes})
    elif not quiet:
        lines = _lines(result, resumed=stages.resumed)
        output.say("\n".join([*lines, *(f"wrote {path}" for path in files), *notes]))


def _draw(result: SweepResult, figure: Path) -> str | None:
    """Draw the figure; where it cannot be drawn, say why, and remove that of an earlier run."""
    from dobc_design.certificate.files import write_atomically

    try:
        write_atomically(figure, result.plot().file("svg"))
    except SpecError as error:  # nothing numeric was varied or found
        note = f"No figure: {error.message}"
    # numbers beyond what the scales of Matplotlib hold
    except (ArithmeticError, ValueError) as error:
        note = f"No figure: Matplotlib cannot draw these numbers ({error})."
    else:
        return None
    figure.unlink(missing_ok=True)
    return note


def _files(folder: Path) -> list[Path]:
    """The tables of a sweep."""
    from dobc_design.sweeps.result import HEAD, LINES

    tables = [folder / "results.csv", folder / "results.parquet"]
    return [folder / HEAD, folder / LINES, *(path for path in tables if path.exists())]


def _document(
    result: SweepResult, folder: Path, files: Sequence[Path], *, resumed: int
) -> output.Document:
    """What --json prints, with at most a hundred of the cases that failed."""
    failures = []
    for line in result.failures[:MOST_FAILURES]:
        values = dict(zip(result.axes, line["values"], strict=True))
        failures.append({"case": line["case"], "values": values, "error": line["error"]})
    plan = result.plan
    return {
        "problem": plan.name,
        "problem_sha256": plan.problem_sha256,
        "task": plan.task.to_json(),
        "axes": [axis.text for axis in plan.axes],
        "cases": len(result),
        "resumed": resumed,
        "outcomes": result.outcomes,
        "failures": failures,
        "out": str(folder),
        "files": [str(path) for path in files],
    }


def _lines(result: SweepResult, *, resumed: int) -> Iterator[str]:
    """What came of the cases, in words."""
    yield str(result)
    if resumed:
        yield f"  {resumed} of the cases were there from before"
    for line in result.failures[:SHOWN]:
        pairs = zip(result.axes, line["values"], strict=True)
        values = ", ".join(f"{name}={value}" for name, value in pairs)
        error = DobcError(line["error"]["message"], cure=line["error"]["cure"])
        yield f"  case {line['case']} ({values}) failed: {error}"
    if len(result.failures) > SHOWN:
        yield f"  ... and {len(result.failures) - SHOWN} more, in the column error"


class _Bar(output.Progress):
    """Progress on standard error: a bar on a terminal; with --verbose ten lines or so; else
    nothing."""

    resumed = 0  # cases that were there from before

    def stage(self, state: State) -> None:
        self.resumed = state.resumed
        # A log of thousands of lines helps nobody.
        tenth = (state.done * 10) // state.total
        if self.moving is not None:
            self.moving(state)
        elif self.verbose and tenth != self.said:
            self.said = tenth
            output.complain(str(state))
