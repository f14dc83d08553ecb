"""The body of ``dobc sweep``: a bar with the time left on standard error, tables, a figure and a summary."""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from dobc_design._signals import say_on_ending
from dobc_design.cli.output import Manner, complain, folder_name, print_json, refuse_option, say
from dobc_design.errors import DobcError, SpecError
from dobc_design.sweeps.journal import HEAD, LINES
from dobc_design.sweeps.result import SweepResult
from dobc_design.sweeps.running import State, sweep

FIGURE = "sweep.svg"
SHOWN = 5  # failed cases that are told
EVERY = 10  # lines that --verbose writes on the way: one for every tenth part


def run_sweep(
    file: str,
    axes: Sequence[str],
    *,
    task: str,
    samples: int | None,
    seed: int,
    runs: int,
    everything: bool,
    out: Path | None,
    jobs: int | None,
    cluster: str | None,
    force: bool,
    manner: Manner,
    as_json: bool,
    time_limit: str | None = None,
) -> int:
    """Do the sweep, or go on with it; write its files into ``out``; return the exit code.  Raises: SpecError."""
    if out is not None:
        refuse_option(out, key="--out")
    folder = out if out is not None else _default_folder(file)
    if os.path.lexists(folder) and not folder.is_dir():  # a link to nowhere counts
        raise SpecError(f"{str(folder)!r} is not a folder.", key="--out", cure="Choose another with --out.")
    say_on_ending(_interrupted(folder))
    # joblib's cleaner of shared memory is to do its work without a word when this process is killed.
    os.environ.setdefault("PYTHONWARNINGS", "ignore::UserWarning:joblib.externals.loky.backend.resource_tracker")
    earlier: list[int] = []
    with _Bar(manner) as show:

        def progress(state: State) -> None:
            earlier[:] = [state.resumed]
            show(state)

        result = sweep(
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
    files = [
        folder / HEAD,
        folder / LINES,
        *sorted(folder.glob("results.csv")),
        *sorted(folder.glob("results.parquet")),
    ]
    files += _figure(result, folder)
    resumed = earlier[0] if earlier else 0
    if as_json:
        print_json(_document(result, folder, files, resumed=resumed))
    elif manner is not Manner.QUIET:
        say(_words(result, files, resumed=resumed))
    return 0


def _default_folder(file: str) -> Path:
    from dobc_design.problem.load import load_problem

    return Path(f"{folder_name(load_problem(file).name)}-sweep")


def _interrupted(folder: Path) -> str:
    command = shlex.join(["dobc", *sys.argv[1:]])
    return (
        f"Interrupted; the finished cases are kept in {str(folder)!r}. The same command goes on with the others:"
        f"\n  {command}"
    )


def _figure(result: SweepResult, folder: Path) -> list[Path]:
    """The figure of the sweep, where there is something to be drawn."""
    from dobc_design.certificate.files import write_atomically

    try:
        picture = result.plot().file("svg")
    except SpecError:  # nothing numeric was varied or found
        return []
    write_atomically(folder / FIGURE, picture)
    return [folder / FIGURE]


def _document(result: SweepResult, folder: Path, files: Sequence[Path], *, resumed: int) -> dict[str, Any]:
    failures = [
        {"case": line["case"], "values": dict(zip(result.axes, line["values"], strict=True)), "error": line["error"]}
        for line in result.failures[:100]
    ]
    return {
        "problem": result.plan.name,
        "problem_sha256": result.plan.problem_sha256,
        "task": result.plan.task.to_json(),
        "axes": [axis.text for axis in result.plan.axes],
        "cases": len(result),
        "resumed": resumed,
        "outcomes": result.outcomes,
        "failures": failures,
        "out": str(folder),
        "files": [str(path) for path in files],
    }


def _words(result: SweepResult, files: Sequence[Path], *, resumed: int) -> str:
    lines = [str(result)]
    if resumed:
        lines.append(f"  {resumed} of the cases were there from before")
    for line in result.failures[:SHOWN]:
        values = ", ".join(f"{name}={value}" for name, value in zip(result.axes, line["values"], strict=True))
        error = DobcError(line["error"]["message"], cure=line["error"]["cure"])
        lines.append(f"  case {line['case']} ({values}) failed: {error}")
    if len(result.failures) > SHOWN:
        lines.append(f"  ... and {len(result.failures) - SHOWN} more, in the column error")
    return "\n".join([*lines, *(f"wrote {path}" for path in files)])


class _Bar:
    """Progress on standard error: a bar on a terminal; with --verbose lines; else nothing."""

    def __init__(self, manner: Manner) -> None:
        self.manner = manner
        self.bar: Any = None
        self.task: Any = None
        self.told = -1

    def __enter__(self) -> Callable[[State], None]:
        if self.manner is Manner.NORMAL and sys.stderr is not None and sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

            self.bar = Progress(
                BarColumn(), MofNCompleteColumn(), TextColumn("{task.description}"), console=Console(stderr=True)
            )
            self.bar.start()
            self.task = self.bar.add_task("starting", total=None)
        return self.show

    def show(self, state: State) -> None:
        """Show where the sweep stands."""
        failed = f", {state.failed} failed" if state.failed else ""
        if self.bar is not None:
            self.bar.update(
                self.task, total=state.total, completed=state.done, description=f"{state.time_left}{failed}"
            )
        elif self.manner is Manner.VERBOSE and (state.done * EVERY) // state.total != self.told:
            self.told = (state.done * EVERY) // state.total
            complain(str(state))

    def __exit__(self, *error: object) -> None:
        if self.bar is not None:
            self.bar.stop()
