"""``dobc simulate``, and what ``dobc stress`` shares with it: options of runs, the document that
--json prints, and the files.

An ensemble of one run is a trajectory.  A run that diverges is an answer, not a failure.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from dobc_design._checks import noun
from dobc_design.errors import refused
from dobc_design.loop.make import loop_of

from .output import (
    Document,
    Progress,
    Stage,
    json_bytes,
    load_problem,
    naming_options,
    print_json,
    read_claims,
    require_folder,
    require_free,
    say,
)

if TYPE_CHECKING:
    from dobc_design.certificate.certificate import Certificate
    from dobc_design.problem.problem import Problem
    from dobc_design.simulation.stress import Stress
    from dobc_design.simulation.trajectory import Ensemble, Trajectory

SUMMARY = "summary.json"
FIGURE = "simulation.svg"
NETWORK = "network.html"
BREAKING = "breaking.svg"
TRAJECTORY = "trajectory.npz"
ENSEMBLE = "ensemble.npz"
WRITTEN = (TRAJECTORY, ENSEMBLE, FIGURE, NETWORK, BREAKING, SUMMARY)  # all that a run may write
MOST_MOVING = 200  # agents whose motion is drawn
SHOWN = 5  # reasons for early ends that are printed
OBSERVER = "closed-form"
#: What is measured of runs: its key, its title, its unit, and the word where there is no number.
MEASURES = (
    ("final_error", "final {}", "", "unknown"),
    ("settling_time", "settled to 1 % after", " s", "never"),
    ("decay_rate", "decay rate", " 1/s", "unknown"),
)

Files = dict[str, bytes]  # by their names in --out


@noun
class Runs:
    """Which runs are made, and how."""

    runs: int | None = None
    seed: int | None = None
    t_final: float | None = None
    mode: str | None = None
    start: str | None = None
    observer: str = OBSERVER

    @property
    def single(self) -> bool:
        """Whether one run is made, a trajectory."""
        return self.runs in (None, 1)


@noun
class Answer:
    """What is shown of the runs, and where it goes."""

    certificate: Path | None = None
    out: Path | None = None
    force: bool = False
    quiet: bool = False
    verbose: bool = False
    as_json: bool = False

    def progress(self) -> Progress:
        """Names the stages."""
        return Progress(quiet=self.quiet, verbose=self.verbose)

    def require_free(self) -> None:
        """Refuse a folder that has files of runs already, unless they may be replaced."""
        if self.out is not None:
            folder = require_folder(self.out)
            require_free(folder, WRITTEN, force=self.force, other=", or choose another folder")

    def proof(self, problem: Problem, progress: Stage) -> Certificate | None:
        """The certificate whose bounds are shown, verified."""
        return None if self.certificate is None else _verified(self.certificate, problem, progress)

    def write(self, document: Document, names: Sequence[str], draw: Callable[[], Files]) -> None:
        """Write what ``draw`` gives and the document, all of it or nothing; without a folder
        nothing is drawn."""
        from dobc_design.certificate.files import make_folder, write_together

        document["files"] = [] if self.out is None else [str(self.out / name) for name in names]
        if self.out is None:
            return
        made = draw() | {SUMMARY: json_bytes(document)}
        make_folder(self.out)
        whole = {self.out / name: data for name, data in made.items()}
        # What an earlier run left there goes, so that files of two runs are never mixed.
        write_together(whole, without=[self.out / name for name in WRITTEN])

    def say(self, document: Document, text: str, names: Sequence[str]) -> None:
        """Print the document, or the text with its notes and files."""
        if self.as_json:
            print_json(document)
        elif not self.quiet:
            lines = [text, *(f"  Note: {note}" for note in document["notes"])]
            lines += [f"wrote {path}" for path in document["files"]]
            if not document["files"]:
                lines.append(f"Add --out FOLDER for {', '.join(names)}.")
            say("\n".join(lines))


def simulate(file: str, runs: Runs, answer: Answer) -> None:
    """Simulate runs of the closed loop; the exit code is 0 even if a run diverges."""
    make_runs(file, runs, answer)


def make_runs(
    file: str, runs: Runs, answer: Answer, *, stress: Stress | Literal["worst"] | None = None
) -> None:
    """Make the runs, write their files, and say what came of them."""
    from dobc_design.simulation import runs as simulation

    with answer.progress() as progress:
        problem = load_problem(file)
        names = [TRAJECTORY if runs.single else ENSEMBLE, SUMMARY, FIGURE]
        # A motion of one component is a curve, and many agents would hide each other.
        if runs.single and problem.m > 1 and problem.n <= MOST_MOVING:
            names.append(NETWORK)
        answer.require_free()
        proof = answer.proof(problem, progress)
        progress("simulating")
        with naming_options("runs"):
            result: Any = simulation.simulate(
                problem,
                runs=None if runs.single else runs.runs,
                mode=runs.mode,
                start=runs.start,
                t_final=runs.t_final,
                seed=runs.seed,
                observer=runs.observer,
                stress=stress,
                progress=lambda part: progress(f"simulating, {part:.0%}"),
            )
        document = _document(result, problem, proof)
        if not runs.single:
            document["intervals"] = _intervals(result)

        def draw() -> Files:
            progress("writing")
            figure = result.plot(certificate=proof).file("svg")
            made = {names[0]: result.to_bytes(), FIGURE: figure}
            if NETWORK in names:
                made[NETWORK] = _moving_network(result, problem)
            return made

        answer.write(document, names, draw)
    answer.say(document, "\n".join(_lines(result, document)), names)


def _moving_network(result: Trajectory, problem: Problem) -> bytes:
    """The page on which the run moves through the network."""
    from dobc_design.plotting.animation import animation_page

    arcs = {}
    for name, mode in problem.network.modes.items():
        arcs[name] = list(zip(mode.listeners.tolist(), mode.speakers.tolist(), strict=True))
    return animation_page(result, arcs=arcs, pinned=problem.pinning.agents).encode("utf-8")


def _document(result: Any, problem: Problem, proof: Certificate | None) -> Document:
    """What --json prints of runs, with what the certificate bounds; a note where it bounds nothing
    here."""
    notes = list(result.notes)
    document: Document = result.summary()
    document |= {"problem": problem.name, "mode": result.mode}
    document |= {"reasons": _reasons(result), "notes": notes}
    if proof is None:
        return document
    from dobc_design.plotting.look import RESOLVED

    bound = proof.envelope(result)
    document["certified"] = None
    if not bound.sources:
        notes.append(f"No certified bound: {bound.reason}.")
        return document
    first, last = (float(x) for x in bound([0.0, result.t_final]))
    document["certified"] = {"sources": list(bound.sources), "final_error": last}
    # Below that the figure would show the integrator, not the loop.
    if last < RESOLVED * first:
        notes.append("The certified bound falls below what the integration resolves.")
    return document


def _intervals(result: Ensemble) -> dict[str, list[float] | None]:
    """Confidence intervals at 95 %; None where there are too few runs, or no bound."""
    intervals = {}
    for name, interval in result.intervals(0.95).items():
        # Infinity is no number of JSON.
        bounded = interval is not None and interval[1] != float("inf")
        intervals[name] = list(interval) if interval is not None and bounded else None
    return intervals


def _verified(place: Path, problem: Problem, progress: Stage) -> Certificate:
    """The certificate at ``place``, every claim decided again.  Raises: SpecError unless all of
    them hold."""
    from dobc_design.certificate.certificate import Certificate
    from dobc_design.conditions.observer.propose import observer_gain

    progress("verifying the certificate")
    claims = read_claims(place, problem)
    if claims.W is not None and observer_gain(loop_of(problem)) != claims.W:
        raise refused(
            "--certificate",
            "the certificate is about another observer gain W than the one that is designed here.",
            "Certify the problem anew, or give the W of the certificate in [observer].",
        )
    return Certificate(problem=problem, claims=claims)


def _reasons(result: Trajectory | Ensemble) -> list[Document]:
    """Why runs ended early, by seed."""
    from dobc_design.simulation.trajectory import Trajectory

    if isinstance(result, Trajectory):
        return [{"seed": result.seed, "reason": result.reason}] if result.diverged else []
    # Told by seed, with which the run can be made again.
    early = result.reasons.items()
    return [{"seed": int(result.seeds[run]), "reason": reason} for run, reason in early]


def _lines(result: Trajectory | Ensemble, document: Document) -> Iterator[str]:
    """What came of the runs, in words."""
    from dobc_design.simulation.trajectory import Trajectory

    yield str(result)
    if isinstance(result, Trajectory) and result.sides.size:
        sides = result.sides[:, None]
        first, last = (
            ", ".join(f"{x:.6g}" for x in (sides * (result.x[k] - result.goal)).mean(axis=0))
            for k in (0, -1)
        )
        yield f"  {'value at the end':<22} {last}; mean of the starts {first}"
    in_steps = result.clock == "steps"
    for name, title, unit, nothing in MEASURES:
        values = document[name]
        if document["runs"] == 1:
            values = {"": values["median"]}
        told = []
        for each, value in values.items():
            own = unit.replace("1/s", "1/step").replace(" s", " steps") if in_steps else unit
            shown = nothing if value is None else f"{value:.4g}{own}"
            told.append(f"{each} {shown}")
        yield f"  {title.format(result.measured):<22} {', '.join(told).strip()}"
    for name, interval in document.get("intervals", {}).items():
        words = f"no confidence interval with {document['runs']} runs"
        if interval is not None:
            words = f"{interval[0]:.4g} to {interval[1]:.4g}, with 95 % confidence"
        yield f"  {name.replace('_', ' '):<22} {words}"
    certified = document.get("certified")
    if certified:
        sources = ", ".join(certified["sources"])
        final = f"{certified['final_error']:.4g}, by {sources}"
        yield f"  {'certified':<22} final {result.measured} <= {final}"
    reasons = document["reasons"]
    for each in reasons[:SHOWN]:
        yield f"  seed {each['seed']}: {each['reason']}."
    if len(reasons) > SHOWN:
        yield f"  ... and {len(reasons) - SHOWN} more."
