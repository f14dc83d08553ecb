"""The body of ``dobc simulate``: runs, files, and the document that --json prints.

An ensemble of one run is a trajectory.  A run that diverges is an answer, not a failure.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dobc_design.certificate.certificate import Certificate
from dobc_design.certificate.files import make_folder, write_atomically
from dobc_design.certificate.text import read_claims
from dobc_design.certification.certify import verify
from dobc_design.cli.output import read_certificate
from dobc_design.conditions.observer.propose import observer_gain
from dobc_design.errors import SpecError
from dobc_design.problem.load import load_problem
from dobc_design.simulation.breaking import what_breaks_first
from dobc_design.simulation.signals import Fixed
from dobc_design.simulation.simulations import simulate

if TYPE_CHECKING:
    from dobc_design.certificate.bounds import CertifiedBound
    from dobc_design.problem.problem import Problem
    from dobc_design.simulation.ensemble import Ensemble
    from dobc_design.simulation.stress import Stress
    from dobc_design.simulation.trajectory import Trajectory

SUMMARY = "summary.json"
FIGURE, NETWORK, BREAKING = "simulation.svg", "network.html", "breaking.svg"
MOST_MOVING = 200  # agents whose motion is drawn
SHOWN = 5  # reasons for early ends that are printed


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """What was found: the contract's JSON document, and the same in words."""

    document: dict[str, Any]
    text: str


def run_simulation(
    file: str,
    *,
    runs: int | None,
    seed: int | None,
    t_final: float | None,
    mode: str | None,
    start: str | None,
    observer: str,
    stress: Stress | None,
    out: Path | None,
    force: bool,
    progress: Callable[[str], None],
    certificate: Path | None = None,
) -> Answer:
    """Simulate a problem file, write the results into ``out`` if that is given.

    ``certificate``: what it proves about |e| over time, after it was verified, is drawn into the figure.
    Raises: SpecError for wrong arguments and for files that are there already (unless ``force``).
    """
    problem = load_problem(file)
    single = runs is None or runs == 1
    name = "trajectory.npz" if single else "ensemble.npz"
    moving = single and problem.m > 1 and problem.n <= MOST_MOVING
    names = (name, SUMMARY, FIGURE, *([NETWORK] if moving else []))
    if out is not None:
        check_folder(out, names, force=force)
    given: dict[str, Any] = {
        "mode": mode,
        "t_final": t_final,
        "seed": seed,
        "start": start,
        "observer": observer,
        "stress": stress,
    }
    proof = None if certificate is None else _verified(certificate, problem, progress)
    progress("simulating")
    result = simulate(
        problem, runs=None if single else runs, progress=lambda part: progress(f"simulating, {part:.0%}"), **given
    )
    document = result.summary()
    bound = None if proof is None else proof.envelope(result)
    files: list[str] = []
    if out is not None:
        progress("writing")
        make_folder(out)
        files = [str(out / each) for each in names]
        result.save(out / name, force=force)
        write_atomically(out / FIGURE, result.plot(certificate=proof).file("svg"))
        if moving:
            _write_network(result, problem, out / NETWORK)
    document |= {"problem": problem.name, "mode": result.mode, "reasons": _reasons(result), "notes": list(result.notes)}
    if bound is not None:
        document |= _certified(result, bound)
    if not single:
        document["intervals"] = _intervals(result)
    document["files"] = files
    if out is not None:
        write_atomically(out / SUMMARY, _json(document))
    return Answer(document=document, text=_words(result, document))


def run_breaking(
    file: str,
    *,
    seed: int | None,
    t_final: float | None,
    mode: str | None,
    start: str | None,
    certificate: Path | None,
    out: Path | None,
    force: bool,
    progress: Callable[[str], None],
) -> Answer:
    """Find what breaks the loop of a problem file first; one figure and one table.

    ``certificate``: its sampling period, after it was verified, stands beside the longest one that works.
    Raises: as ``run_simulation``.
    """
    problem = load_problem(file)
    if out is not None:
        check_folder(out, (BREAKING, SUMMARY), force=force)
    proof = None if certificate is None else _verified(certificate, problem, progress)
    progress("what breaks first")
    found = what_breaks_first(
        problem,
        signal=None if mode is None else Fixed(mode=mode),
        start=start,
        t_final=t_final,
        seed=seed,
        certificate=proof,
        progress=lambda part: progress(f"what breaks first, {part:.0%}"),
    )
    calm = found.calm
    notes = list(calm.notes)
    if proof is not None and found.period is not None and found.period.certified is None:
        notes.append("The certificate proves no sampling period.")
    files = [] if out is None else [str(out / BREAKING), str(out / SUMMARY)]
    document = calm.summary() | {
        "problem": problem.name,
        "mode": calm.mode,
        "notes": notes,
        "breaking": found.to_json(),
        "files": files,
    }
    if out is not None:
        progress("writing")
        make_folder(out)
        write_atomically(out / BREAKING, found.plot().file("svg"))
        write_atomically(out / SUMMARY, _json(document))
    lines = [str(found), *(f"  Note: {note}" for note in notes), *(f"wrote {file}" for file in files)]
    return Answer(document=document, text="\n".join(lines))


def refuse_beside_breaking(*, runs: int | None, stress: Stress | None, observer: str) -> None:
    """Refuse options that --what-breaks-first chooses itself.  Raises: SpecError."""
    if stress is not None or runs not in (None, 1) or observer != "closed-form":
        what = "--observer" if observer != "closed-form" else "--runs" if stress is None else "a stress"
        raise SpecError(
            f"{what} must be left out beside --what-breaks-first, which makes one run after another under every stress"
            " by itself.",
            key="--what-breaks-first",
            cure="Leave one of the two out.",
        )


def _verified(place: Path, problem: Problem, progress: Callable[[str], None]) -> Certificate:
    """The certificate at ``place``, every claim decided again.  Raises: SpecError unless all of them hold."""
    progress("verifying the certificate")
    claims = read_claims(read_certificate(place))
    if not verify(claims, problem).holds:
        raise SpecError(
            "the certificate does not hold for this problem, so nothing of it is shown.",
            key="--certificate",
            cure=f"`dobc verify {place}` with --problem says which claim fails.",
        )
    if claims.W is not None and observer_gain(problem) != claims.W:
        raise SpecError(
            "the certificate is about another observer gain W than the one that is designed here.",
            key="--certificate",
            cure="Certify the problem anew, or give the W of the certificate in [observer].",
        )
    return Certificate(problem=problem, claims=claims)


def _certified(result: Trajectory | Ensemble, bound: CertifiedBound) -> dict[str, Any]:
    """What the certificate bounds, for --json; a note where it bounds nothing here."""
    from dobc_design.plotting.look import RESOLVED

    if not bound.sources:
        return {"certified": None, "notes": [*result.notes, f"No certified bound: {bound.reason}."]}
    first, last = (float(x) for x in bound([0.0, result.t_final]))
    found: dict[str, Any] = {"certified": {"sources": list(bound.sources), "final_error": last}}
    if last < RESOLVED * first:
        found["notes"] = [*result.notes, "The certified bound falls below what the integration resolves."]
    return found


def _json(document: dict[str, Any]) -> bytes:
    return (json.dumps(document, indent=2, ensure_ascii=False) + "\n").encode("utf-8")


def read_stress(
    *,
    noise: float,
    disturbance: float,
    saturation: float | None,
    period: float | None,
    loss: float,
    fail: Sequence[str],
) -> Stress | None:
    """The stress that the options ask for; None for none.  Raises: SpecError, which names the option."""
    from dobc_design.simulation.stress import Failure, Stress

    failures = []
    for text in fail:
        agent, found, when = text.rpartition("@")
        time, _, kind = when.partition(":")
        try:
            failures.append(Failure(agent=agent, time=float(time if found else "none"), kind=kind or "vanish"))
        except ValueError:  # also a SpecError of Failure
            raise SpecError(
                f"--fail must be LABEL@TIME or LABEL@TIME:freeze; got {text[:40]!r}.",
                key="--fail",
                cure="For example 3@2.5.",
            ) from None
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
            f"{str(out / there[0])!r} exists already.",
            key="--out",
            cure="Add --force to replace it, or choose another folder.",
        )


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
    from dobc_design.simulation.trajectory import Trajectory

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
    for name, title, unit, nothing in (
        ("final_error", "final |e|_inf", "", "unknown"),
        ("settling_time", "settled to 1 % after", " s", "never"),
        ("decay_rate", "decay rate", " 1/s", "unknown"),
    ):
        values = document[name] if document["runs"] > 1 else {"": document[name]["median"]}
        named = [f"{each} {nothing if value is None else f'{value:.4g}{unit}'}" for each, value in values.items()]
        lines.append(f"  {title:<22} {', '.join(named).strip()}")
    for name, interval in document.get("intervals", {}).items():
        words = f"no bound with {document['runs']} runs"
        if interval is not None:
            words = f"{interval[0]:.4g} to {interval[1]:.4g}, with 95 % confidence"
        lines.append(f"  {name.replace('_', ' '):<22} {words}")
    if document.get("certified"):
        certified = document["certified"]
        lines.append(
            f"  {'certified':<22} final |e|_inf <= {certified['final_error']:.4g}, by {', '.join(certified['sources'])}"
        )
    reasons = document["reasons"]
    lines += [f"  seed {each['seed']}: {each['reason']}." for each in reasons[:SHOWN]]
    if len(reasons) > SHOWN:
        lines.append(f"  ... and {len(reasons) - SHOWN} more.")
    lines += [f"  Note: {note}" for note in document["notes"]]
    lines += [f"wrote {file}" for file in document["files"]]
    return "\n".join(lines)
