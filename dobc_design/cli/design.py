"""``dobc design``: a designed problem file, and what was decided, in words or as JSON."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dobc_design.cli.output import (
    EXIT,
    PIPED,
    File,
    Json,
    Manner,
    Progress,
    Quiet,
    Verbose,
    answering,
    check_target,
    make_console,
    manner_of,
    print_json,
    require_toml,
    say,
    verdict_line,
    write_file,
)

if TYPE_CHECKING:
    from dobc_design.synthesis.joint.claim import Design, DesignRequest


def design(
    file: File,
    out: Annotated[Path, typer.Option(help="Write the designed problem here, a new .toml file.")],
    rate: Annotated[str | None, typer.Option(help="The certified decay rate to be reached, in 1/s.")] = None,
    pins: Annotated[str | None, typer.Option(help="At most so many pinned agents; default as few as it takes.")] = None,
    max_gain: Annotated[str | None, typer.Option("--max-gain", help="The largest pinning gain, in 1/s.")] = None,
    noise: Annotated[
        str | None, typer.Option(help="Bound on the gain from measurement noise to the estimated disturbance, in 1/s.")
    ] = None,
    allowed: Annotated[
        list[str] | None, typer.Option(help="Labels of agents that may be pinned, with commas; may be repeated.")
    ] = None,
    digits: Annotated[int, typer.Option(help="Significant digits of W and of the gains.")] = 3,
    keep_exosystem: Annotated[
        bool, typer.Option("--keep-exosystem", help="Never put the observable part in the exosystem's place.")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the file of --out.")] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    as_json: Json = False,
) -> None:
    """Design observer gain, pinned agents and gains, proved for the problem; or prove that it is impossible."""
    from dobc_design.problem.changes import changed_file
    from dobc_design.problem.load import load_problem, source_text
    from dobc_design.synthesis import designs

    manner = manner_of(quiet=quiet, verbose=verbose)
    check_target(out, force=force, key="--out")
    require_toml(out, key="--out")
    problem = load_problem(file)
    # A whole number of pins where it is one; anything else is refused where requests are read.
    whole = pins is not None and pins.isascii() and pins.isdigit() and len(pins) < 10
    labels = [label.strip() for text in allowed or () for label in text.split(",") if label.strip()]
    with Progress(manner) as progress:
        found = designs.design(
            problem,
            rate=rate,
            pins=int(pins or "") if whole else pins,
            max_gain=max_gain,
            noise=noise,
            allowed=labels or None,
            digits=digits,
            reduce=not keep_exosystem,
            progress=progress,
        )
    written = None
    if found.verdict.value == "proved":
        text, folder = source_text(file), out.resolve().parent
        new = changed_file(problem, found.changes, text=text, folder=folder, remark="set by dobc design")
        write_file(out, new.encode("utf-8"), key="--out")
        written = str(out)
    if as_json:
        print_json(found.to_json() | {"problem": written})
    elif manner is not Manner.QUIET:
        from rich.text import Text

        console = make_console()
        with answering():
            reason = f"{found.reason[:1].upper()}{found.reason[1:]}"
            console.print(verdict_line(problem.name, found.verdict.value, reason), soft_wrap=console.width == PIPED)
            for line in _lines(found, file=file, out=out):
                console.print(Text(line), soft_wrap=console.width == PIPED or line.startswith("    "))
        if written is not None:
            say(f"\nwrote        {written}\ncertify it   {shlex.join(['dobc', 'certify', written])}")
            if problem.notes:
                say("look at      its notes: they are kept as they were and may speak of what has changed")
    raise typer.Exit(EXIT[found.verdict.value])


def _lines(found: Design, *, file: str, out: Path) -> Iterator[str]:
    if found.decisions or found.prices:
        yield ""
    yield from found.decisions
    yield from found.prices
    if found.binding is not None:
        option = {"max_gain": "max-gain", "reduce": "keep-exosystem"}.get(found.binding, found.binding)
        yield f"\nThe limit that fails: --{option}."
    nearest = found.nearest
    if nearest is not None:
        yield f"\nThe nearest request that was proved possible: {nearest.limits}."
        yield from nearest.decisions
        command = ["dobc", "design", file, "--out", str(out), *_option_texts(nearest.request, nearest.labels)]
        yield f"    {shlex.join(command)}"
    if found.verdict.value != "proved":
        yield "\nNothing was written."


def _option_texts(request: DesignRequest, labels: Sequence[str]) -> list[str]:
    """The options of ``dobc design`` that ask for a request, as far as options can."""
    from dobc_design.problem.changes import typed_number

    words: list[str] = []
    if request.rate is not None:
        words += ["--rate", str(typed_number(request.rate))]
    if request.pins is not None:
        words += ["--pins", str(request.pins)]
    if request.caps:
        words += ["--max-gain", str(typed_number(max(request.caps.values())))]
    if len(request.allowed) < len(labels):
        words += ["--allowed", ",".join(labels[i] for i in request.allowed)]
    for limit in request.noise[:1]:
        words += ["--noise", str(typed_number(limit.bound))]
    if request.digits != 3:
        words += ["--digits", str(request.digits)]
    return words if request.reduce else [*words, "--keep-exosystem"]
