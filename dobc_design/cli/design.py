"""The body of ``dobc design``: a designed problem file, and what was decided, in words or as JSON."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dobc_design.cli.output import (
    COLOURS,
    EXIT,
    PIPED,
    Manner,
    Progress,
    answering,
    check_target,
    make_console,
    print_json,
    say,
    write_file,
)
from dobc_design.errors import SpecError

if TYPE_CHECKING:
    from rich.console import Console

    from dobc_design.synthesis.joint.claim import Design
    from dobc_design.synthesis.joint.request import DesignRequest

REMARK = "set by dobc design"


def run_design(
    file: str,
    out: Path,
    *,
    rate: str | None,
    pins: str | None,
    max_gain: str | None,
    noise: str | None,
    allowed: Sequence[str],
    digits: int,
    keep_exosystem: bool,
    force: bool,
    manner: Manner,
    as_json: bool,
) -> int:
    """Design for a problem file, write the designed one to ``out`` if it is proved, and return the exit code.

    Raises: SpecError for wrong arguments and a file that is there already (unless ``force``).
    """
    from dobc_design.problem.changes import changed_file
    from dobc_design.problem.load import load_problem, source_text
    from dobc_design.synthesis.designs import design
    from dobc_design.verdict import Verdict

    check_target(out, force=force, key="--out")
    if out.suffix.lower() != ".toml":
        raise SpecError(
            f"--out must name a .toml file; got {str(out)!r}.",
            key="--out",
            cure=f"For example {out.with_suffix('.toml').name}.",
        )
    problem = load_problem(file)
    with Progress(manner) as progress:
        found = design(
            problem,
            rate=rate,
            pins=_count(pins),
            max_gain=max_gain,
            noise=noise,
            allowed=labels_in(allowed),
            digits=digits,
            reduce=not keep_exosystem,
            progress=progress,
        )
    written = None
    if found.verdict is Verdict.PROVED:
        text = changed_file(problem, found.changes, text=source_text(file), folder=out.resolve().parent, remark=REMARK)
        write_file(out, text.encode("utf-8"), key="--out")
        written = str(out)
    if as_json:
        print_json(found.to_json() | {"problem": written})
    elif manner is not Manner.QUIET:
        console = make_console()
        with answering():
            _show(console, found, file=file, out=out, name=problem.name)
        if written is not None:
            say(f"\nwrote        {written}\ncertify it   {shlex.join(['dobc', 'certify', written])}")
            if problem.notes:
                say("look at      its notes: they are kept as they were and may speak of what has changed")
    return EXIT[found.verdict.value]


def labels_in(texts: Sequence[str]) -> list[str] | None:
    """The labels of --allowed: separated by commas, the option given once or several times; None for all agents."""
    labels = [label.strip() for text in texts for label in text.split(",") if label.strip()]
    return labels or None


def option_texts(request: DesignRequest, labels: Sequence[str]) -> list[str]:
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


def _count(pins: str | None) -> Any:
    """A whole number where it is one; anything else is refused where requests are read."""
    return int(pins) if pins is not None and pins.isascii() and pins.isdigit() and len(pins) < 10 else pins


def _show(console: Console, found: Design, *, file: str, out: Path, name: str) -> None:
    from rich.text import Text

    head = Text(f"{name}: ", style="bold")
    head.append(found.verdict.value.upper(), style=COLOURS[found.verdict.value])
    head.append(f". {found.reason[:1].upper()}{found.reason[1:]}", style="not bold")
    console.print(head, soft_wrap=console.width == PIPED)
    for line in _lines(found, file=file, out=out):
        console.print(Text(line), soft_wrap=console.width == PIPED or line.startswith("    "))


def _lines(found: Design, *, file: str, out: Path) -> Iterator[str]:
    if found.decisions or found.prices:
        yield ""
    yield from found.decisions
    yield from found.prices
    if found.binding is not None:
        yield f"\nThe limit that fails: --{_option(found.binding)}."
    nearest = found.nearest
    if nearest is not None:
        from dobc_design.synthesis.joint.claim import NO_LIMITS

        limits = "; ".join(words for _, words in nearest.request.limits(nearest.labels)) or NO_LIMITS
        yield f"\nThe nearest request that was proved possible: {limits}."
        yield from nearest.decisions
        command = ["dobc", "design", file, "--out", str(out), *option_texts(nearest.request, nearest.labels)]
        yield f"    {shlex.join(command)}"
    if found.verdict.value != "proved":
        yield "\nNothing was written."


def _option(binding: str) -> str:
    return {"max_gain": "max-gain", "reduce": "keep-exosystem"}.get(binding, binding)
