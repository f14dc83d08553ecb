"""Reports, comparisons and figures of certificates.  What they show is computed here; the report
computes nothing."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from os import PathLike
from pathlib import Path

from dobc_design._show.progress import Reports, report_to, shows_progress
from dobc_design.analysis.analysis import analyse
from dobc_design.certificate.certificate import Certificate
from dobc_design.certificate.files import make_folder, write_folder
from dobc_design.conditions.consensus.claim import state_theorems
from dobc_design.errors import SpecError
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.work import out_of_time
from dobc_design.falsification.suspect import Falsification
from dobc_design.loop.loop import Loop
from dobc_design.loop.make import loop_of
from dobc_design.problem.problem import Problem
from dobc_design.simulation.execution import run_once
from dobc_design.simulation.runs import fingerprint
from dobc_design.simulation.setting import make_setting
from dobc_design.simulation.signals import signal_of
from dobc_design.simulation.trajectory import Trajectory
from dobc_design.simulation.worst import worst_signal
from dobc_design.solvers.program import is_solver_failure
from dobc_design.synthesis.block_lmi import block_lmi

from .comparison import comparison_document
from .content import report_document
from .document import Document
from .findings import Findings
from .latex import Files, latex_fragments
from .pages import html_page, markdown_page
from .refusal import Checked, refusal_document

DRAWN = 2000  # rows (n m) up to which diagnostics and a simulation go into the report
DRAWN_ORDER = 100  # of the exosystem, likewise
SHOWN = 12  # rows up to which Lambda is printed


@shows_progress
def write_report(
    certificate: Certificate,
    folder: str | PathLike[str],
    *,
    searches: Sequence[Falsification] = (),
    pdf: bool = False,
    latex: bool = False,
    lmi: bool = False,
    progress: Reports[str] = None,
) -> Path:
    """Write report.html and report.md into ``folder`` and return the path of the page; see
    ``render_report``.

    ``searches``: what ``falsify`` found.  ``pdf``: report.pdf too, which needs the extra
    `pdf`. ``latex``: the folder latex too, with fragments for a paper and a BibTeX file.
    ``lmi``: what a solver says of ``block_lmi``, beside the proof (at most 600 rows).
    ``progress``: as in ``certify``.
    Raises: CertificateError when the machine refuses, SpecError without the extra.
    """
    files = render_report(certificate, searches=searches, pdf=pdf, lmi=lmi, progress=progress)
    if latex:
        make_folder(Path(folder, "latex"))
        files |= {f"latex/{name}": data for name, data in render_latex(certificate).items()}
    return write_folder(Path(folder), files)[0]


def render_report(
    certificate: Certificate,
    *,
    searches: Sequence[Falsification] = (),
    pdf: bool = False,
    full: bool = False,
    lmi: bool = False,
    kernel: str = "",
    progress: Reports[str] = None,
) -> Files:
    """The bytes of report.html and report.md by name, and with ``pdf`` of report.pdf.  ``full``:
    details are open on the page and printed in the PDF.  ``lmi``: a solver is asked for the block
    matrix inequality.  ``kernel``: what Coq says of proof.v,
    where it was asked.  Diagnostics and one simulation are computed here and handed to the report,
    which computes nothing."""
    from .pdf import require_typst

    if pdf:
        require_typst()  # said before anything is computed
    say = report_to(progress)
    # What is computed may fail without the proof being less true; see ``_computed``.
    found = _computed(certificate, say)
    if lmi:
        say("asking a solver for the block matrix inequality")
        found = replace(found, lmi=_solver_words(certificate.problem))
    say("writing the report")
    document = report_document(replace(found, searches=searches, kernel=kernel))
    if pdf:
        say("setting the PDF")
    return _pages(document, "report", pdf=pdf, full=full)


def _computed(certificate: Certificate, say: Callable[[str], None]) -> Findings:
    """A certificate with its diagnostics and one simulation, or two, where it is not too large."""

    problem = certificate.problem
    found = Findings(certificate=certificate, lambdas=_shown_lambdas(loop_of(problem)))
    if problem.n * problem.m > DRAWN or problem.q > DRAWN_ORDER:
        return found

    gain = certificate.claims.W
    # Numbers beyond the floats, or too long for the integrator, are no reason for no report.
    with suppress(SpecError):
        say("computing diagnostics")
        found = replace(found, analysis=analyse(problem, gain=gain))
        if (not problem.groups or gain is not None) and out_of_time() is None:
            say("simulating")
            found = replace(found, trajectory=_drawn_run(problem, gain))
            # With a guarantee, beside it one with a slow signal that keeps it.
            signal = worst_signal(problem)
            if signal is not None:
                setting = make_setting(problem, gain=gain, signal=signal)
                found = replace(found, worst=run_once(setting))
    return found


def _drawn_run(problem: Problem, gain: Matrix | None) -> Trajectory:
    """One run with the signal of the problem; without a guarantee in the first mode."""

    # A proof for every signal is shown with one mode; one for some signals with such a signal.
    signal = signal_of(problem)[0] if loop_of(problem).guarantee.phases else None
    run = run_once(make_setting(problem, gain=gain, signal=signal))
    return replace(run, loop_sha256=fingerprint(problem, gain))


def _solver_words(problem: Problem) -> str:
    """What a solver says of the block matrix inequality, or why it was not asked."""
    try:
        lmi = block_lmi(problem)
        lmi.problem().solve()
    except SpecError as error:
        return str(error)
    except BaseException as error:
        if not is_solver_failure(error):
            raise
        return "the solver failed on the block matrix inequality, which says nothing about it."
    return f"a solver was asked for P and Q of (18). {lmi.status}"


def _pages(document: Document, name: str, *, pdf: bool, full: bool = False) -> Files:
    from .pdf import pdf_page

    pages = {
        f"{name}.html": html_page(document, full=full).encode("utf-8"),
        f"{name}.md": markdown_page(document).encode("utf-8"),
    }
    if pdf:
        pages[f"{name}.pdf"] = pdf_page(document, full=full)
    return pages


def write_comparison(
    first: Certificate, second: Certificate, folder: str | PathLike[str], *, pdf: bool = False
) -> Path:
    """Write two certificates side by side, comparison.html and comparison.md, into ``folder``;
    return the page's path.

    ``first`` and ``second``: their verdicts, checks, rates, certified starts, and what differs
    between the problems. ``pdf``: comparison.pdf too, which needs the extra `pdf`.
    Raises: CertificateError when the machine refuses, SpecError without the extra.
    """
    return write_folder(Path(folder), render_comparison(first, second, pdf=pdf))[0]


def render_comparison(first: Certificate, second: Certificate, *, pdf: bool = False) -> Files:
    """The bytes of comparison.html and comparison.md by name, and with ``pdf`` of
    comparison.pdf."""

    return _pages(comparison_document(first, second), "comparison", pdf=pdf)


def render_refusal(sides: Sequence[Checked], *, pdf: bool = False) -> Files:
    """The pages of certificates of which at least one does not hold, under the names of their
    report or comparison."""

    name = "report" if len(sides) == 1 else "comparison"
    return _pages(refusal_document(sides), name, pdf=pdf)


def render_latex(certificate: Certificate) -> Files:
    """The bytes of the report's LaTeX fragments by name, with references.bib and a main.tex that
    inputs them all."""

    lambdas = _shown_lambdas(loop_of(certificate.problem))
    document = report_document(Findings(certificate=certificate, lambdas=lambdas))
    return latex_fragments(document, certificate.claims.version)


def _shown_lambdas(loop: Loop) -> dict[str, Matrix]:
    """Lambda at the target by mode, where it is small enough to be printed."""
    if loop.size > SHOWN:
        return {}
    lambdas = state_theorems(loop).lambdas
    return {mode: pencil.constant.to_dense() for mode, pencil in lambdas.items()}
