"""``dobc simulate``: runs, files, and the document that --json prints.

An ensemble of one run is a trajectory.  A run that diverges is an answer, not a failure.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dobc_design.cli import output
from dobc_design.errors import SpecError

if TYPE_CHECKING:
    from dobc_design.certificate.certificate import Certificate
    from dobc_design.problem.problem import Problem
    from dobc_design.simulation.runs import Ensemble
    from dobc_design.simulation.setting import Failure
    from dobc_design.simulation.trajectory import Trajectory

SUMMARY, FIGURE, NETWORK, BREAKING = "summary.json", "simulation.svg", "network.html", "breaking.svg"
TRAJECTORY, ENSEMBLE = "trajectory.npz", "ensemble.npz"
WRITTEN = (TRAJECTORY, ENSEMBLE, FIGURE, NETWORK, BREAKING, SUMMARY)  # all that a run may write
MOST_MOVING = 200  # agents whose motion is drawn
SHOWN = 5  # reasons for early ends that are printed


def simulate(
    file: output.File,
    runs: Annotated[int | None, typer.Option(help="How many runs, with the seeds S, S + 1, ...")] = None,
    seed: Annotated[int | None, typer.Option(help="Seed of starts and switches; default the problem's.")] = None,
    t_final: Annotated[float | None, typer.Option("--t-final", help="Horizon in s; default the problem's.")] = None,
    mode: Annotated[str | None, typer.Option(help="Stay in this mode, whatever [switching] says.")] = None,
    start: Annotated[str | None, typer.Option(help="Start from a CSV or .npz file.")] = None,
    observer: Annotated[
        str, typer.Option(help="closed-form, full-loop (the reference), or off: d is not compensated.")
    ] = "closed-form",
    noise: Annotated[float, typer.Option(help="Stress: standard deviation of measured states.")] = 0.0,
    disturbance: Annotated[float, typer.Option(help="Stress: amplitude of a sine outside the exosystem.")] = 0.0,
    saturation: Annotated[float | None, typer.Option(help="Stress: bound on every component of u.")] = None,
    period: Annotated[float | None, typer.Option(help="Stress: period in s of sample and hold.")] = None,
    loss: Annotated[float, typer.Option(help="Stress: probability that a packet is lost.")] = 0.0,
    fail: Annotated[
        list[str] | None, typer.Option(help="Stress: LABEL@TIME or LABEL@TIME:freeze; may be repeated.")
    ] = None,
    worst: Annotated[
        bool, typer.Option("--worst", help="As bad as [uncertainty], [actuators] and the guarantee allow.")
    ] = False,
    breaking: Annotated[
        bool, typer.Option("--what-breaks-first", help="Make every stress worse until the loop no longer converges.")
    ] = False,
    certificate: Annotated[Path | None, typer.Option(help="Show the bounds that this certificate proves.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for arrays (.npz), figures and summary.json.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite files in --out.")] = False,
    quiet: output.Quiet = False,
    verbose: output.Verbose = False,
    as_json: output.Json = False,
) -> None:
    """Simulate runs of the closed loop; the exit code is 0 even if a run diverges."""
    from dobc_design.certificate.files import make_folder, write_together
    from dobc_design.problem.load import load_problem
    from dobc_design.simulation.breaking import what_breaks_first
    from dobc_design.simulation.runs import simulate as simulate_runs
    from dobc_design.simulation.setting import Stress
    from dobc_design.simulation.signals import Fixed

    output.refuse_option(out, key="--out")
    failures = tuple(_failure(text) for text in fail or ())
    bounds: dict[str, Any] = {"saturation": saturation, "period": period}
    stress = Stress(noise=noise, disturbance=disturbance, loss=loss, failures=failures, **bounds)
    if worst and not stress.is_calm:
        message = "--worst must be the only stress: it takes all of them from the problem."
        raise SpecError(message, key="--worst", cure="Leave the others out.")
    single = runs in (None, 1)
    if breaking and (worst or not stress.is_calm or not single or observer != "closed-form"):
        what = "--observer" if observer != "closed-form" else "--runs" if stress.is_calm and not worst else "a stress"
        does = "runs every stress separately"
        message = f"{what} must be left out beside --what-breaks-first, which {does}."
        raise SpecError(message, key="--what-breaks-first", cure="Leave one of the two out.")
    stages = output.Progress(quiet=quiet, verbose=verbose)
    with stages as progress:
        problem = load_problem(file)
        moving = (NETWORK,) if single and problem.m > 1 and problem.n <= MOST_MOVING else ()
        names = (TRAJECTORY if single else ENSEMBLE, SUMMARY, FIGURE, *moving)
        names = (BREAKING, SUMMARY) if breaking else names
        if out is not None:
            folder = output.require_folder(out)
            output.require_free(folder, WRITTEN, force=force, other=", or choose another folder")
        proof = None if certificate is None else _verified(certificate, problem, progress)
        given: dict[str, Any] = {"seed": seed, "t_final": t_final, "start": start}
        result: Any
        if breaking:
            progress("what breaks first")
            found = what_breaks_first(
                problem,
                signal=None if mode is None else Fixed(mode=mode),
                certificate=proof,
                progress=lambda part: progress(f"what breaks first, {part:.0%}"),
                **given,
            )
            result, document = found.calm, _breaking(found, problem, proof)
        else:
            progress("simulating")
            given |= {
                "mode": mode,
                "observer": observer,
                "stress": "worst" if worst else None if stress.is_calm else stress,
            }
            given["progress"] = lambda part: progress(f"simulating, {part:.0%}")
            result = simulate_runs(problem, runs=None if single else runs, **given)
            document = _document(result, problem, proof, single=single)
        document["files"] = [] if out is None else [str(out / name) for name in names]
        if out is not None:
            progress("writing")
            made = {names[0]: found.plot().file("svg") if breaking else result.to_bytes()}
            if FIGURE in names:
                made[FIGURE] = result.plot(certificate=proof).file("svg")
            if NETWORK in names:
                made[NETWORK] = _moving_network(result, problem)
            made[SUMMARY] = output.json_bytes(document)
            make_folder(out)
            whole = {out / name: data for name, data in made.items()}
            write_together(whole, without=[out / name for name in WRITTEN])
    if as_json:
        output.print_json(document)
    elif not quiet:
        notes = [f"  Note: {note}" for note in document["notes"]]
        text = str(found) if breaking else _words(result, document)
        files = [f"wrote {path}" for path in document["files"]] or [f"Add --out FOLDER for {', '.join(names)}."]
        output.say("\n".join([text, *notes, *files]))


def _moving_network(result: Trajectory, problem: Problem) -> bytes:
    """The page on which the run moves through the network."""
    from dobc_design.plotting.animation import animation_page

    modes = problem.network.modes.items()
    arcs = {name: list(zip(x.listeners.tolist(), x.speakers.tolist(), strict=True)) for name, x in modes}
    return animation_page(result, arcs=arcs).encode("utf-8")


def _failure(text: str) -> Failure:
    """An agent that fails, as --fail says it.  Raises: SpecError."""
    from dobc_design.simulation.setting import Failure

    agent, found, when = text.rpartition("@")
    time, _, kind = when.partition(":")
    try:
        return Failure(agent=agent, time=float(time if found else "none"), kind=kind or "vanish")
    except ValueError:  # also a SpecError of Failure
        message = f"--fail must be LABEL@TIME or LABEL@TIME:freeze; got {text[:40]!r}."
        raise SpecError(message, key="--fail", cure="For example 3@2.5.") from None


def _document(result: Any, problem: Problem, proof: Certificate | None, *, single: bool) -> dict[str, Any]:
    """What --json prints of runs, with what the certificate bounds; a note where it bounds nothing here."""
    notes = list(result.notes)
    document: dict[str, Any] = result.summary() | {"problem": problem.name, "mode": result.mode}
    document |= {"reasons": _reasons(result), "notes": notes}
    if proof is not None:
        from dobc_design.plotting.look import RESOLVED

        bound = proof.envelope(result)
        document["certified"] = None
        if bound.sources:
            first, last = (float(x) for x in bound([0.0, result.t_final]))
            document["certified"] = {"sources": list(bound.sources), "final_error": last}
            if last < RESOLVED * first:
                notes.append("The certified bound falls below what the integration resolves.")
        else:
            notes.append(f"No certified bound: {bound.reason}.")
    if not single:  # confidence intervals at 95 %; null where there are too few runs, or no bound
        document["intervals"] = {
            name: None if interval is None or interval[1] == float("inf") else list(interval)
            for name, interval in result.intervals(0.95).items()
        }
    return document


def _breaking(found: Any, problem: Problem, proof: Certificate | None) -> dict[str, Any]:
    """What --json prints of what breaks the loop first, with the certified sampling period beside."""
    notes = list(found.calm.notes)
    if proof is not None and found.period is not None and found.period.certified is None:
        notes.append("The certificate proves no sampling period.")
    document: dict[str, Any] = found.calm.summary() | {"problem": problem.name, "mode": found.calm.mode}
    return document | {"notes": notes, "breaking": found.to_json()}


def _verified(place: Path, problem: Problem, progress: Callable[[str], None]) -> Certificate:
    """The certificate at ``place``, every claim decided again.  Raises: SpecError unless all of them hold."""
    from dobc_design.certificate.certificate import Certificate
    from dobc_design.conditions.observer.propose import observer_gain

    progress("verifying the certificate")
    claims = output.read_claims(place, problem)
    if claims.W is not None and observer_gain(problem) != claims.W:
        message = "the certificate is about another observer gain W than the one that is designed here."
        cure = "Certify the problem anew, or give the W of the certificate in [observer]."
        raise SpecError(message, key="--certificate", cure=cure)
    return Certificate(problem=problem, claims=claims)


def _reasons(result: Trajectory | Ensemble) -> list[dict[str, Any]]:
    """Why runs ended early, by seed."""
    from dobc_design.simulation.trajectory import Trajectory

    if isinstance(result, Trajectory):
        return [{"seed": result.seed, "reason": result.reason}] if result.diverged else []
    return [{"seed": int(result.seeds[run]), "reason": reason} for run, reason in result.reasons.items()]


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
        words = f"no confidence interval with {document['runs']} runs"
        if interval is not None:
            words = f"{interval[0]:.4g} to {interval[1]:.4g}, with 95 % confidence"
        lines.append(f"  {name.replace('_', ' '):<22} {words}")
    if document.get("certified"):
        final, sources = document["certified"]["final_error"], ", ".join(document["certified"]["sources"])
        lines.append(f"  {'certified':<22} final |e|_inf <= {final:.4g}, by {sources}")
    reasons = document["reasons"]
    lines += [f"  seed {each['seed']}: {each['reason']}." for each in reasons[:SHOWN]]
    if len(reasons) > SHOWN:
        lines.append(f"  ... and {len(reasons) - SHOWN} more.")
    return "\n".join(lines)
