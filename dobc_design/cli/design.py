"""``dobc design``: a designed problem file, and what was decided, in words or as JSON."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dobc_design.cli import output

if TYPE_CHECKING:
    from dobc_design.synthesis.joint.claim import Design, DesignRequest


def design(
    file: output.File,
    out: Annotated[Path, typer.Option(help="Write the designed problem here, a new .toml file.")],
    rate: Annotated[
        str | None, typer.Option(help="The certified decay rate to be reached, in 1/s.")
    ] = None,
    pins: Annotated[
        str | None, typer.Option(help="Largest number of pinned agents; default: the fewest.")
    ] = None,
    max_gain: Annotated[
        str | None, typer.Option("--max-gain", help="The largest pinning gain, in 1/s.")
    ] = None,
    noise: Annotated[
        str | None,
        typer.Option(
            help="Bound on the gain from measurement noise to the estimated disturbance, in 1/s."
        ),
    ] = None,
    allowed: Annotated[
        list[str] | None,
        typer.Option(help="Labels of agents that may be pinned, with commas; may be repeated."),
    ] = None,
    digits: Annotated[int, typer.Option(help="Significant digits of W and of the gains.")] = 3,
    keep_exosystem: Annotated[
        bool,
        typer.Option(
            "--keep-exosystem", help="Never replace the exosystem by its observable part."
        ),
    ] = False,
    conservative: Annotated[
        bool,
        typer.Option(
            "--conservative",
            help="Without a region: gains for V = e'e, not for the true local rate.",
        ),
    ] = False,
    coupling: Annotated[
        bool,
        typer.Option("--coupling", help="Design the coupling, too (agents with [dynamics] only)."),
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the file of --out.")] = False,
    quiet: output.Quiet = False,
    verbose: output.Verbose = False,
    as_json: output.Json = False,
) -> None:
    """Design observer gain, pinned agents and gains with a proof, or prove that the request is
    impossible."""
    from dobc_design.problem.changes import changed_file
    from dobc_design.problem.load import load_problem, source_text
    from dobc_design.synthesis import designs

    stages = output.Progress(quiet=quiet, verbose=verbose)
    output.check_target(out, force=force, key="--out")
    output.require_toml(out, key="--out")
    problem = load_problem(file)
    # A whole number of pins where it is one; anything else is refused where requests are read.
    whole = pins is not None and pins.isascii() and pins.isdigit() and len(pins) < 10
    labels = [label.strip() for text in allowed or () for label in text.split(",") if label.strip()]
    with stages as progress:
        limits: dict[str, Any] = {
            "pins": int(pins or "") if whole else pins,
            "rate": rate,
            "max_gain": max_gain,
            "noise": noise,
            "allowed": labels or None,
        }
        how: dict[str, Any] = {"digits": digits, "reduce": not keep_exosystem, "progress": progress}
        how |= {"conservative": conservative, "coupling": coupling}
        found = designs.design(problem, **limits, **how)
    written = None
    if found.verdict.value == "proved":
        text, folder = source_text(file), out.resolve().parent
        new = changed_file(
            problem, found.changes, text=text, folder=folder, remark="set by dobc design"
        )
        output.write_file(out, new.encode("utf-8"), key="--out")
        written = str(out)
    if as_json:
        output.print_json(found.to_json() | {"problem": written})
    elif not quiet:
        from rich.text import Text

        reason = f"{found.reason[:1].upper()}{found.reason[1:]}"
        output.show([output.verdict_line(problem.name, found.verdict.value, reason)])
        lines = _lines(found, file=file, out=out)
        # a command is not wrapped
        output.show(line if line.startswith("    ") else Text(line) for line in lines)
        if written is not None:
            output.say(f"\nwrote        {output.certify_it(written, problem.notes)}")
    raise typer.Exit(output.EXIT[found.verdict.value])


def _lines(found: Design, *, file: str, out: Path) -> Iterator[str]:
    if found.decisions or found.prices:
        yield ""
    yield from found.decisions
    yield from found.prices
    if found.binding is not None:
        option = {"max_gain": "max-gain", "reduce": "keep-exosystem"}.get(
            found.binding, found.binding
        )
        yield f"\nThe limit that fails: --{option}."
    nearest = found.nearest
    if nearest is not None:
        yield f"\nThe nearest request that was proved possible: {nearest.limits}."
        yield from nearest.decisions
        command = [
            "dobc",
            "design",
            file,
            "--out",
            str(out),
            *_option_texts(nearest.request, nearest.labels),
        ]
        yield f"    {shlex.join(command)}"
    if found.verdict.value != "proved":
        yield "\nNothing was written."


def _option_texts(request: DesignRequest, labels: Sequence[str]) -> list[str]:
    """The options of ``dobc design`` that ask for a request, as far as options can."""
    from dobc_design.problem.changes import typed_number

    given = {
        "--rate": None if request.rate is None else typed_number(request.rate),
        "--pins": request.pins,
        "--max-gain": typed_number(max(request.caps.values())) if request.caps else None,
        "--allowed": ",".join(labels[i] for i in request.allowed)
        if len(request.allowed) < len(labels)
        else None,
        "--noise": typed_number(request.noise[0].bound) if request.noise else None,
        "--digits": None if request.digits == 3 else request.digits,
    }
    words = [
        word
        for option, value in given.items()
        if value is not None
        for word in (option, str(value))
    ]
    flags = {"--keep-exosystem": not request.reduce, "--conservative": request.conservative}
    flags["--coupling"] = request.coupling
    return [*words, *(flag for flag, given in flags.items() if given)]
