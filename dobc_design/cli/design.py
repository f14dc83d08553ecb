"""``dobc design``: a designed problem file, and what was decided, in words or as JSON."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from typer import Exit

from dobc_design.cli import output

if TYPE_CHECKING:
    from dobc_design.problem.problem import Problem
    from dobc_design.synthesis.joint.claim import Design, DesignRequest

DIGITS = 3
REMARK = "set by dobc design"
DESIGNED = "-design"  # after the name of the problem, where the designed file gives none
PRICED = 2  # further pins, each of which is a design of its own,
MOST_PRICED = 60  # in networks of at most so many agents
MOST_DIGITS = 10  # of a number of pins; a longer one is no number of agents


def design(
    file: str,
    out: Path | None = None,
    rate: str | None = None,
    pins: str | None = None,
    max_gain: str | None = None,
    noise: str | None = None,
    allowed: list[str] | None = None,
    digits: int = DIGITS,
    keep_exosystem: bool = False,
    conservative: bool = False,
    coupling: bool = False,
    further: int | None = None,
    force: bool = False,
    quiet: bool = False,
    verbose: bool = False,
    as_json: bool = False,
) -> None:
    """Design observer gain, pinned agents and gains with a proof, or prove that the request is
    impossible."""
    from dobc_design.problem.load import load_problem
    from dobc_design.synthesis import designs

    stages = output.Progress(quiet=quiet, verbose=verbose)
    if out is not None:
        output.check_target(out, force=force, key="--out")
        output.require_suffix(out, ".toml", key="--out")
    problem = load_problem(file)  # as it is written
    if further is None:
        further = PRICED if problem.n <= MOST_PRICED else 0
    with stages as progress, output.naming_options("design"):
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
            further=further,
            progress=progress,
        )
    # Nothing is written that is not proved.
    text = _new_text(found, problem, file, out) if found.is_proved else None
    if out is not None and text is not None:
        output.write_file(out, text.encode("utf-8"), key="--out")
    if as_json:
        path = str(out) if out is not None and text is not None else None
        output.print_json(found.to_json() | {"problem": path})
    else:
        if not quiet:
            _say(found, problem, file, out)
        if out is None and text is not None:
            output.say(text.removesuffix("\n"))
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


def _own_name(problem: Problem, out: Path | None) -> str:
    """The name of the designed problem: that of its file, so that its certificate does not take the
    place of the one of ``problem``."""
    from dobc_design.problem.problem import is_name

    taken = output.folder_name(problem.name)
    stem = "" if out is None else out.stem
    if is_name(stem) and output.folder_name(stem) != taken:
        return stem
    return f"{taken[: output.LONGEST_FOLDER - len(DESIGNED)]}{DESIGNED}"


def _new_text(found: Design, problem: Problem, source: str, out: Path | None) -> str:
    """The designed problem, with the comments of its source and where its numbers come from."""
    from dobc_design.problem.changes import changed_file
    from dobc_design.problem.load import source_text

    return changed_file(
        problem,
        found.changes,
        text=source_text(source),
        folder=(out or Path("standard-output")).resolve().parent,
        name=_own_name(problem, out),
        remark=REMARK,
        remarks=dict(_remarks(found)),
    )


def _remarks(found: Design) -> Iterator[tuple[str, str]]:
    """Where W and the gains come from, by path."""
    from dobc_design._show.text import significant_towards_zero
    from dobc_design.exact.number import typed_number
    from dobc_design.problem.changes import GROUP_GAINS

    observer = found.observer
    if observer is not None:
        rate = observer.measures.get("rate")
        decay = f"decay rate at least {significant_towards_zero(rate)} 1/s"
        words = f"{REMARK}: {observer.source}, {decay}"
        yield from ((path, words) for path in ("observer.W", GROUP_GAINS))
    proof = found.certificate
    if proof is not None and found.cost is not None:
        rate_text = significant_towards_zero(found.rate)
        total = f"total gain {typed_number(found.cost)}"
        by = f"certified at {rate_text} 1/s by {proof.covered_by}"
        yield "pinning.gains", f"{REMARK}: {total}, {by}"


def _say(found: Design, problem: Problem, file: str, out: Path | None) -> None:
    """The verdict, and what was decided or would be possible; on standard error where the designed
    file goes to standard output."""
    from rich.text import Text

    reason = f"{found.reason[:1].upper()}{found.reason[1:]}"
    head = output.verdict_line(problem.name, found.verdict.value, reason)
    lines = _lines(found, file=file, out=out)
    if out is None:
        output.complain("\n".join([head.plain, *lines, ""]))
        return
    output.show([head])
    # a command is not wrapped
    output.show(line if line.startswith("    ") else Text(line) for line in lines)
    proof = found.certificate
    if found.is_proved and proof is not None:
        # Without the rate certify looks for what falls to one percent first, which may be slower.
        wrote = output.certify_it(str(out), problem.notes, *proof.claims.options)
        output.say(f"\nwrote        {wrote}")
        name = _own_name(problem, out)
        output.say(f"its name     {name}: its certificate does not replace that of {problem.name}")


def _lines(found: Design, *, file: str, out: Path | None) -> Iterator[str]:
    if found.decisions or found.prices:
        yield ""
    yield from found.decisions
    yield from found.prices
    if found.further:
        yield f"\n{found.pin_table()}"
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
        target = [] if out is None else ["--out", str(out)]
        yield f"    {shlex.join(['dobc', 'design', file, *target, *options])}"
    if not found.is_proved:
        yield "\nNothing was written."


def _option_texts(request: DesignRequest, labels: Sequence[str]) -> list[str]:
    """The options of ``dobc design`` that ask for a request, as far as options can."""
    from dobc_design.exact.number import typed_number

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
