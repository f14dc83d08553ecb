"""``dobc stress``: what breaks the closed loop first, or runs under a stress that is given.

A stress is what the theorems leave out; nothing here is a proof.
"""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING, Any, Literal

from dobc_design._checks import noun
from dobc_design.errors import SpecError, refused

from .output import Document, load_problem, naming_options
from .runs import BREAKING, OBSERVER, SUMMARY, Answer, Files, Runs, make_runs

if TYPE_CHECKING:
    from dobc_design.certificate.certificate import Certificate
    from dobc_design.problem.problem import Problem
    from dobc_design.simulation.stress import Failure, Stress


@noun
class Stresses:
    """What acts on the loop; what is not given does not."""

    noise: float | None = None
    disturbance: float | None = None
    saturation: float | None = None
    period: float | None = None
    loss: float | None = None
    fail: list[str] | None = None
    worst: bool = False

    def chosen(self) -> Stress | Literal["worst"] | None:
        """The stress that the options describe; None where none of them is given.  Raises:
        SpecError."""
        from dobc_design.simulation.stress import Stress

        # A stress of 0 was asked for, too: only what is not given means none.
        values = [getattr(self, each.name) for each in fields(self) if each.name != "worst"]
        given = any(value not in (None, []) for value in values)
        if self.worst and given:
            raise refused(
                "--worst",
                "--worst must be the only stress: it takes all of them from the problem.",
                "Leave the others out.",
            )
        if self.worst:
            return "worst"
        if not given:
            return None
        with naming_options("stress"):
            return Stress(
                noise=self.noise or 0.0,
                disturbance=self.disturbance or 0.0,
                saturation=self.saturation,
                period=self.period,
                loss=self.loss or 0.0,
                failures=tuple(map(_failure, self.fail or ())),
            )


#: Options that ``simulate`` had: what to type now.
MOVED = {f"--{each.name}": f"dobc stress FILE --{each.name}" for each in fields(Stresses)}
MOVED["--what-breaks-first"] = "dobc stress FILE"


def stress(file: str, stresses: Stresses, runs: Runs, answer: Answer) -> None:
    """Find what breaks the loop first; with --noise, --saturation, --worst, ... simulate it under
    that stress."""
    chosen = stresses.chosen()
    if chosen is None:
        _break(file, runs, answer)
    else:
        make_runs(file, runs, answer, stress=chosen)


def _break(file: str, runs: Runs, answer: Answer) -> None:
    """Make every stress worse until the loop no longer converges."""
    from dobc_design.simulation.breaking import what_breaks_first
    from dobc_design.simulation.signals import Fixed

    if runs.observer != OBSERVER:
        raise _needs_a_stress("--observer")
    if not runs.single:
        raise _needs_a_stress("--runs")
    names = (BREAKING, SUMMARY)
    with answer.progress() as progress:
        problem = load_problem(file)
        answer.require_free()
        proof = answer.proof(problem, progress)
        progress("what breaks first")
        with naming_options("runs"):
            found = what_breaks_first(
                problem,
                signal=None if runs.mode is None else Fixed(mode=runs.mode),
                start=runs.start,
                t_final=runs.t_final,
                seed=runs.seed,
                certificate=proof,
                progress=lambda part: progress(f"what breaks first, {part:.0%}"),
            )
        document = _document(found, problem, proof)

        def draw() -> Files:
            progress("writing")
            return {BREAKING: found.plot().file("svg")}

        answer.write(document, names, draw)
    answer.say(document, str(found), names)


def _needs_a_stress(option: str) -> SpecError:
    return refused(
        option,
        f"{option} needs a stress: without one every stress is made worse, in runs of its own.",
        f"Add one, such as --noise 0.1, or leave {option} out.",
    )


def _failure(text: str) -> Failure:
    """An agent that fails, as --fail says it.  Raises: SpecError."""
    from dobc_design.simulation.stress import Failure

    # A label may have an @ of its own: the last one counts.
    agent, found, when = text.rpartition("@")
    time, _, kind = when.partition(":")
    try:
        return Failure(agent=agent, time=float(time if found else "none"), kind=kind or "vanish")
    except ValueError:  # also a SpecError of Failure
        raise refused(
            "--fail",
            f"--fail must be LABEL@TIME or LABEL@TIME:freeze; got {text[:40]!r}.",
            "For example 3@2.5.",
        ) from None


def _document(found: Any, problem: Problem, proof: Certificate | None) -> Document:
    """What --json prints of what breaks the loop first, with the certified sampling period
    beside."""
    notes = list(found.calm.notes)
    if proof is not None and found.period is not None and found.period.certified is None:
        notes.append("The certificate proves no sampling period.")
    document: Document = found.calm.summary()
    document |= {"problem": problem.name, "mode": found.calm.mode}
    document |= {"notes": notes, "breaking": found.to_json()}
    return document
