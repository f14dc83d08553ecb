"""``dobc design``: a designed problem file, and what was decided, in words or as JSON."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Exit, Option

from dobc_design.cli import output

if TYPE_CHECKING:
    from dobc_design.problem.problem import Problem
    from dobc_design.synthesis.joint.claim import Design, DesignRequest

DIGITS = 3
MOST_DIGITS = 10  # of a number of pins; a longer one is no number of agents


def design(
    file: output.File,
    out: Annotated[Path, Option(help="Write the designed problem here, a new .toml file.")],
    rate: Annotated[
        str | None,
        Option(metavar="NUMBER", help="The certified decay rate to be reached, in 1/s."),
    ] = None,
    pins: Annotated[
        str | None,
        Option(metavar="NUMBER", help="Largest number of pinned agents; default: the fewest."),
    ] = None,
    max_gain: Annotated[
        str | None,
        Option("--max-gain", metavar="NUMBER", help="The largest pinning gain, in 1/s."),
    ] = None,
    noise: Annotated[
        str | None,
        Option(
            metavar="NUMBER",
            help="Bound on the gain from measurement noise to the estimated disturbance, in 1/s.",
        ),
    ] = None,
    allowed: Annotated[
        list[str] | None,
        Option(
            metavar="LABELS",
            help="Labels of agents that may be pinned, with commas; may be repeated.",
        ),
    ] = None,
    digits: Annotated[int, Option(help="Significant digits of W and of the gains.")] = DIGITS,
    keep_exosystem: Annotated[
        bool,
        Option("--keep-exosystem", help="Never replace the exosystem by its observable part."),
    ] = False,
    conservative: Annotated[
        bool,
        Option(
            "--conservative",
            help="Without a region: gains for V = e'e, not for the true local rate.",
        ),
    ] = False,
    coupling: Annotated[
        bool,
        Option("--coupling", help="Design the coupling, too (agents with [dynamics] only)."),
    ] = False,
    force: Annotated[bool, Option("--force", help="Overwrite the file of --out.")] = False,
    quiet: output.Quiet = False,
    verbose: output.Verbose = False,
    as_json: output.Json = False,
) -> None:
    """Design observer gain, pinned agents and gains with a proof, or prove that the request is
    impossible."""
    from dobc_design.synthesis import designs

    stages = output.Progress(quiet=quiet, verbose=verbose)
    output.check_target(out, force=force, key="--out")
    output.require_toml(out, key="--out")
    problem = output.load_problem(file)
    with stages as progress:
        found = designs.design(
            problem,
            pins=_whole(pins),
            rate=rate,
            max_gain=max_gain,
            noise=noise,
            allowed=_labels(allowed or ()),
            digits=digits,
            reduce=not keep_exosystem,
            conservative=conservative,
            coupling=coupling,
            progress=progress,
        )
    proved = found.verdict.value == "proved"
    # Nothing is written that is not proved.
    if proved:
        _write(found, problem, file, out)
    if as_json:
        output.print_json(found.to_json() | {"problem": str(out) if proved else None})
    elif not quiet:
        _say(found, problem, file, out)
        if proved:
            output.say(f"\nwrote        {output.certify_it(str(out), problem.notes)}")
    raise Exit(output.EXIT[found.verdict.value])


def _whole(pins: str | None) -> Any:
    """A whole number of pins where it is one; anything else is refused where requests are read."""
    if pins is None or not (pins.isascii() and pins.isdigit()) or len(pins) >= MOST_DIGITS:
        return pins
    return int(pins)


def _labels(texts: Iterable[str]) -> list[str] | None:
    """Labels from texts with commas; None where there are none, which allows all agents."""
    labels = [label.strip() for text in texts for label in text.split(",")]
    return [label for label in labels if label] or None


def _write(found: Design, problem: Problem, source: str, out: Path) -> None:
    """Write the designed problem, with the comments of its source."""
    from dobc_design.problem.changes import changed_file
    from dobc_design.problem.load import source_text

    new = changed_file(
        problem,
        found.changes,
        text=source_text(source),
        folder=out.resolve().parent,
        remark="set by dobc design",
    )
    output.write_file(out, new.encode("utf-8"), key="--out")


def _say(found: Design, problem: Problem, file: str, out: Path) -> None:
    """The verdict, and what was decided or would be possible."""
    from rich.text import Text

    reason = f"{found.reason[:1].upper()}{found.reason[1:]}"
    output.show([output.verdict_line(problem.name, found.verdict.value, reason)])
    lines = _lines(found, file=file, out=out)
    # a command is not wrapped
    output.show(line if line.startswith("    ") else Text(line) for line in lines)


def _lines(found: Design, *, file: str, out: Path) -> Iterator[str]:
    if found.decisions or found.prices:
        yield ""
    yield from found.decisions
    yield from found.prices
    if found.binding is not None:
        # Limits have the names of Python; the user typed options.
        own_names = {"max_gain": "max-gain", "reduce": "keep-exosystem"}
        option = own_names.get(found.binding, found.binding)
        yield f"\nThe limit that fails: --{option}."
    nearest = found.nearest
    if nearest is not None:
        yield f"\nThe nearest request that was proved possible: {nearest.limits}."
        yield from nearest.decisions
        # To be typed as it stands, or changed a little.
        options = _option_texts(nearest.request, nearest.labels)
        yield f"    {shlex.join(['dobc', 'design', file, '--out', str(out), *options])}"
    if found.verdict.value != "proved":
        yield "\nNothing was written."


def _option_texts(request: DesignRequest, labels: Sequence[str]) -> list[str]:
    """The options of ``dobc design`` that ask for a request, as far as options can."""
    from dobc_design.problem.changes import typed_number

    given: dict[str, object] = {}
    if request.rate is not None:
        given["--rate"] = typed_number(request.rate)
    if request.pins is not None:
        given["--pins"] = request.pins
    if request.caps:
        given["--max-gain"] = typed_number(max(request.caps.values()))
    if len(request.allowed) < len(labels):
        given["--allowed"] = ",".join(labels[i] for i in request.allowed)
    if request.noise:
        given["--noise"] = typed_number(request.noise[0].bound)
    # What is the default already need not be typed.
    if request.digits != DIGITS:
        given["--digits"] = request.digits
    texts = [text for option, value in given.items() for text in (option, str(value))]
    flags = {
        "--keep-exosystem": not request.reduce,
        "--conservative": request.conservative,
        "--coupling": request.coupling,
    }
    return texts + [flag for flag, wanted in flags.items() if wanted]
