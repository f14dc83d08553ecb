"""The body of ``dobc simulate``: runs, files, and the document that --json prints.

An ensemble of one run is a trajectory.  A run that diverges is an answer, not a failure.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dobc_design.certificate.files import make_folder, write_atomically
from dobc_design.errors import SpecError
from dobc_design.spec.load import load_problem
from dobc_design.workflow import simulate

if TYPE_CHECKING:
    from dobc_design.simulate.ensemble import Ensemble
    from dobc_design.simulate.stress import Stress
    from dobc_design.simulate.trajectory import Trajectory
    from dobc_design.spec.problem import Problem

SUMMARY = "summary.json"
FIGURE, NETWORK = "simulation.svg", "network.html"
MOST_MOVING = 200  # agents whose motion is drawn
SHOWN = 5  # reasons for early ends that are printed


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """What was found: the contract's JSON document, and the same in words."""

    document: dict[str, Any]
    text: str


def run_simulation(
    file: str, *, runs: int | None, seed: int | None, t_final: float | None, mode: str | None, start: str | None,
    stress: Stress | None, out: Path | None, force: bool, progress: Callable[[str], None],
) -> Answer:  # fmt: skip
    """Simulate a problem file, write the results into ``out`` if that is given.

    Raises: SpecError for wrong arguments and for files that are there already (unless ``force``).
    """
    problem = load_problem(file)
    single = runs is None or runs == 1
    name = "trajectory.npz" if single else "ensemble.npz"
    moving = single and problem.m > 1 and problem.n <= MOST_MOVING
    names = (name, SUMMARY, FIGURE, *([NETWORK] if moving else []))
    if out is not None:
        check_folder(out, names, force=force)
    given: dict[str, Any] = {"mode": mode, "t_final": t_final, "seed": seed, "start": start, "stress": stress}
    progress("simulating")
    result = simulate(
        problem, runs=None if single else runs, progress=lambda part: progress(f"simulating, {part:.0%}"), **given
    )
    document = result.summary()
    files: list[str] = []
    if out is not None:
        progress("writing")
        make_folder(out)
        files = [str(out / each) for each in names]
        result.save(out / name, force=force)
        write_atomically(out / FIGURE, result.plot().file("svg"))
        if moving:
            _write_network(result, problem, out / NETWORK)
    document |= {"problem": problem.name, "mode": result.mode, "reasons": _reasons(result), "notes": list(result.notes)}
    if not single:
        document["intervals"] = _intervals(result)
    document["files"] = files
    if out is not None:
        write_atomically(out / SUMMARY, (json.dumps(document, indent=2, ensure_ascii=False) + "\n").encode("utf-8"))
    return Answer(document=document, text=_words(result, document))


def read_stress(
    *, noise: float, disturbance: float, saturation: float | None, period: float | None, loss: float,
    fail: Sequence[str],
) -> Stress | None:  # fmt: skip
    """The stress that the options ask for; None for none.  Raises: SpecError, which names the option."""
    from dobc_design.simulate.stress import Failure, Stress

    failures = []
    for text in fail:
        agent, found, when = text.rpartition("@")
        time, _, kind = when.partition(":")
        try:
            failures.append(Failure(agent=agent, time=float(time if found else "none"), kind=kind or "vanish"))
        except ValueError:  # also a SpecError of Failure
            raise SpecError(
                f"--fail must be LABEL@TIME or LABEL@TIME:freeze; got {text[:40]!r}.", key="--fail",
                cure="For example 3@2.5.",
            ) from None  # fmt: skip
    stress = Stress(
        noise=noise, disturbance=disturbance, saturation=saturation, period=period, loss=loss, failures=tuple(failures)
    )
    return None if stress.is_calm else stress


def check_folder(out: Path, names: tuple[str, ...], *, force: bool) -> None:
    """Refuse a target that is no folder, or that holds one of these files already.  Raises: SpecError."""
    if out.exists() and not out.is_dir():
        raise SpecError(f"{str(out)!r} is not a folder.", key="--out", cure="Choose another with --out.")
    there = [name for name in names if (out / name).exists()]
    if there and not force:
        raise SpecError(
            f"{str(out / there[0])!r} exists already.", key="--out",
            cure="Add --force to replace it, or choose another folder.",
        )  # fmt: skip


def _write_network(result: Any, problem: Problem, place: Path) -> None:
    """The agents in motion, with the arcs of the problem's modes, as a page."""
    from dobc_design.plotting.animation import animation_page

    arcs = {
        mode: list(zip(each.listeners.tolist(), each.speakers.tolist(), strict=True))
        for mode, each in problem.network.modes.items()
    }
    write_atomically(place, animation_page(result, arcs=arcs).encode("utf-8"))


def _reasons(result: Trajectory | Ensemble) -> list[dict[str, Any]]:
    """Why runs ended early, by seed."""
    from dobc_design.simulate.trajectory import Trajectory

    if isinstance(result, Trajectory):
        return [{"seed": result.seed, "reason": result.reason}] if result.diverged else []
    return [{"seed": int(result.seeds[run]), "reason": reason} for run, reason in result.reasons.items()]


def _intervals(result: Any) -> dict[str, Any]:
    """Confidence intervals at 95 %, as lists; null where there are too few runs, or no bound."""
    found = {}
    for name, interval in result.intervals(0.95).items():
        found[name] = None if interval is None or interval[1] == float("inf") else list(interval)
    return found


def _words(result: Trajectory | Ensemble, document: dict[str, Any]) -> str:
    lines = [str(result)]
    for name, title, unit in (
        ("final_error", "final |e|_inf", ""), ("settling_time", "settled to 1 % after", " s"),
        ("decay_rate", "decay rate", " 1/s"),
    ):  # fmt: skip
        values = document[name]
        if document["runs"] == 1:
            lines.append(f"  {title:<22} {_number(values['median'])}{unit}")
        else:
            named = ", ".join(f"{each} {_number(value)}" for each, value in values.items())
            lines.append(f"  {title:<22} {named}{unit}")
    reasons = document["reasons"]
    lines += [f"  seed {each['seed']}: {each['reason']}." for each in reasons[:SHOWN]]
    if len(reasons) > SHOWN:
        lines.append(f"  ... and {len(reasons) - SHOWN} more.")
    lines += [f"  Note: {note}" for note in document["notes"]]
    lines += [f"wrote {file}" for file in document["files"]]
    return "\n".join(lines)


def _number(value: float | None) -> str:
    return "never" if value is None else f"{value:.4g}"
