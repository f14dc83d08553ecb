"""What was computed in floating point to be looked at: eigenvalues, and one simulated run.  No
verdict depends on it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from dobc_design.plotting.look import thinned_rows
from dobc_design.report import pictures, words

from .document import (
    Blocks,
    Column,
    Pictures,
    Section,
    Table,
    Text,
    in_markdown,
    on_pages,
    section,
    table_of,
)
from .findings import Findings
from .words import number

if TYPE_CHECKING:
    from dobc_design.analysis.analysis import Analysis
    from dobc_design.simulation.trajectory import Trajectory

MOST_SPECTRA = 40  # rows
MOST_SAMPLES = 9
MOST_MARGINS = 12  # eigenvalues of A whose observability is told


def bound_section(found: Findings) -> Blocks:
    """One picture: what is proved about the largest error, and one simulated run, or two."""
    certificate, run = found.certificate, found.trajectory
    if run is None or len(run.times) < 2:
        return
    title = "Simulated error"
    if certificate.envelope(run).sources:
        title = "Certified bound and simulation"
    # The bound holds for the start of this run, so the run stands under it.
    picture = pictures.error_picture(certificate, run, found.worst)
    drawn = Pictures((picture, *pictures.weight_pictures(certificate)))
    yield on_pages(Section(title, (drawn,), "bound"))


@section("Eigenvalues", "eigenvalues")
def eigenvalue_section(found: Findings) -> Blocks:
    """As pictures on pages, as numbers in Markdown."""
    analysis = found.analysis
    if analysis is None:
        return
    told = (
        "Computed in floating point, to show how large the margins are. No verdict depends on them."
    )
    yield Text(told + _observability(analysis))
    drawn = Pictures(tuple(pictures.eigenvalue_pictures(found.certificate, analysis)))
    head = "eigenvalues in 1/s, the rightmost first"
    table = table_of(
        "Eigenvalues",
        list(_spectra(analysis, agrees=not found.problem.has_target))[:MOST_SPECTRA],
        Column("matrix", lambda row: row[0]),
        Column(head, lambda row: words.eigenvalues(row[1])),
    )
    yield in_markdown(table)
    yield on_pages(drawn)


def _spectra(analysis: Analysis, *, agrees: bool) -> Iterator[tuple[str, Sequence[complex]]]:
    """Every matrix by its name, with its eigenvalues."""
    if analysis.spectrum is not None:
        yield "A − WC", analysis.spectrum.eigenvalues
    for mode in analysis.modes:
        # Lambda is about the distance to a target.
        if mode.lambda_eigenvalues is not None and not agrees:
            # ascending as they come; the table begins with the rightmost
            yield f"Λ(J), mode {mode.mode}", mode.lambda_eigenvalues[::-1]
        if mode.loop_eigenvalues is not None:
            yield f"J − K, mode {mode.mode}", mode.loop_eigenvalues


def _observability(analysis: Analysis) -> str:
    """How well C sees each mode of A; nothing without an exosystem."""
    found = analysis.observability
    if found is None:
        return ""
    # One of each pair of conjugate eigenvalues.
    seen = [each for each in found.modes if each.eigenvalue.imag >= 0]
    margins = [
        f"{number(each.margin)} at {_eigenvalue(each.eigenvalue)}" for each in seen[:MOST_MARGINS]
    ]
    return (
        f" In floating point the observability matrix has rank {found.rank} of {found.order}. "
        "The smallest singular value of [A − λI; C], which would be 0 at an unobservable "
        f"eigenvalue λ of A, is {', '.join(margins)}."
    )


def _eigenvalue(value: complex) -> str:
    """A real number, or a pair of conjugate ones."""
    if not value.imag:
        return number(value.real)
    # Conjugate ones are one line.
    size = f"{number(value.imag)}i"
    return f"{number(value.real)} ± {size}" if value.real else f"±{size}"


@section("A simulation", "simulation", "Simulation")
def simulation_section(found: Findings) -> Blocks:
    """As pictures on pages, as a few samples in Markdown."""
    run = found.trajectory
    if run is None or len(run.times) == 0:
        return
    yield Text(_run_words(run))
    yield in_markdown(_samples(run))
    yield on_pages(Pictures(tuple(pictures.simulation_pictures(found.certificate, run))))


def _run_words(run: Trajectory) -> str:
    """Which run it was, and what became of its error."""
    error = run.error()
    first, last = float(error[0]), float(error[-1])
    end = number(run.times[-1])
    moves = "falls" if last < first else "grows"
    told = [
        "An illustration, not a proof.",
        f"One run of {end} s in mode {run.mode}, seed {run.seed}:",
        f"the largest error {moves} from {number(first)} to {number(last)}.",
    ]
    if run.diverged:
        told.append(f"The run diverged and could not be carried to {number(run.t_final)} s.")
    told.append("One run shows one start; the verdict above does not use it.")
    return " ".join(told)


def _samples(run: Trajectory) -> Table:
    error, times = run.error(), run.times
    return table_of(
        "Largest error over time",
        thinned_rows(len(times), MOST_SAMPLES).tolist(),
        Column("time in s", lambda i: number(times[i])),
        Column("largest error", lambda i: number(error[i])),
    )
