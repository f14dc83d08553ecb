"""The order of the stages: the only module that knows it.

certify: statements -> estimates and proposals (floating point) -> exact decisions -> certificate.
verify: every claim of a certificate again, from the trusted problem.
"""

from __future__ import annotations

import logging
import platform
from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib import metadata
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

from dobc_design import __version__
from dobc_design.certificate.certificate import Certificate
from dobc_design.certificate.claims import Claims
from dobc_design.certificate.files import make_folder, write_together
from dobc_design.certificate.recheck import Recheck, verify_twice
from dobc_design.curing.curing import Findings, with_cures
from dobc_design.deciding import decide, notes_of
from dobc_design.design.gain import design_gain
from dobc_design.errors import DobcError, SpecError
from dobc_design.exact.matrix import Matrix
from dobc_design.spec.canonical import problem_sha256
from dobc_design.spec.load import load_problem
from dobc_design.spec.problem import Problem
from dobc_design.theorems.statements import state_theorems
from dobc_design.verdict import Verdict
from dobc_design.verify.overall import decide_overall

if TYPE_CHECKING:
    from dobc_design.analysis.analysis import Analysis
    from dobc_design.model.model import Model
    from dobc_design.simulate.ensemble import Ensemble
    from dobc_design.simulate.signal_files import Signal
    from dobc_design.simulate.starts import Given
    from dobc_design.simulate.trajectory import Trajectory
    from dobc_design.verify.observer_design import ObserverDesign

logger = logging.getLogger("dobc_design")
logger.addHandler(logging.NullHandler())

Progress = Callable[[str], None]
DRAWN = 2000  # rows (n m) up to which diagnostics and a simulation go into the report
PAGE = "report.html"
SHOWN = 12  # rows up to which Lambda is printed
PACKAGES = (
    "casadi", "control", "sympy", "numpy", "scipy", "cvxpy", "clarabel", "networkx", "matplotlib", "python-flint",
    "pydantic", "tomlkit", "typer", "rich", "jinja2", "latex2mathml", "joblib",
)  # fmt: skip


def certify(problem: Problem | str | PathLike[str], *, progress: Progress | None = None) -> Certificate:
    """Run every condition that applies and decide each exactly.

    ``problem`` is a Problem, a path or a built-in name.  ``progress`` is called with the name of each stage.
    Returns: a Certificate; its verdict is PROVED, REFUTED or UNDECIDED.
    Raises: SpecError for a wrong problem.  A numerical library that breaks down costs at most a shorter proof.
    Source: Lemma 1, Theorems 1 and 2; theory, sections 1 to 3.
    """
    if not isinstance(problem, Problem):
        problem = load_problem(problem)
    report = progress or (lambda stage: None)
    found = decide(problem, report)
    findings = Findings(
        statements=found.statements, directions=found.directions, P=None if found.pair is None else found.pair.P
    )
    checks = with_cures(
        problem, found.checks, findings, progress=report,
        decide=lambda cured: decide(cured, lambda stage: None).checks,
    )  # fmt: skip
    W, pair, design = found.W, found.pair, found.design
    overall = decide_overall(problem, checks, W)
    return Certificate(
        problem=problem,
        claims=Claims(
            problem_name=problem.name, problem_sha256=problem_sha256(problem), verdict=overall.verdict,
            reason=overall.reason, rate=overall.rate, covered_by=overall.covered_by, checks=checks, W=W,
            gain_source=None if W is None else ("given" if design is None else "designed"),
            P=None if pair is None else pair.P, Q=None if pair is None else pair.Q,
            notes=tuple(notes_of(problem, design, found.how)), version=__version__,
        ),
    )  # fmt: skip


def verify(certificate: Certificate | Claims | bytes, problem: Problem | str | PathLike[str]) -> Recheck:
    """Check every claim of a certificate exactly, against the problem, which is trusted and never taken from it.

    Two programs written apart decide, the package's own exact arithmetic and ``certificate/checker.py``.
    Returns: a Recheck; ``holds`` is True iff both find that every claim holds and the verdict follows from them.
    Raises: CertificateError if the certificate cannot be read.
    """
    if not isinstance(problem, Problem):
        problem = load_problem(problem)
    claims = certificate.claims if isinstance(certificate, Certificate) else certificate
    return verify_twice(claims, problem)


def analyse(problem: Problem | str | PathLike[str]) -> Analysis:
    """Compute the diagnostics shown beside a certificate: spectra, margins, graph facts.  Never a proof."""
    from dobc_design.analysis.analysis import analyse as run

    problem = problem if isinstance(problem, Problem) else load_problem(problem)
    return run(problem, gain=observer_gain(problem))


def build_model(problem: Problem | str | PathLike[str], *, mode: str | None = None) -> Model:
    """Build the CasADi functions of the problem: h, its Jacobian, observer, controller, closed loop.

    A missing W is designed first, as ``certify`` does.  ``mode`` defaults to the first.
    """
    from dobc_design.model.model import build_model as run

    problem = problem if isinstance(problem, Problem) else load_problem(problem)
    return run(problem, mode, gain=observer_gain(problem))


@overload
def simulate(
    problem: Problem | str | PathLike[str], *, runs: None = None, mode: str | None = None,
    signal: Signal | None = None, start: Given | None = None, t_final: float | None = None, seed: int | None = None,
    samples: int | Sequence[float] | None = None, observer: str = ..., tolerance: float = ...,
    progress: Callable[[float], None] | None = None,
) -> Trajectory: ...  # fmt: skip


@overload
def simulate(
    problem: Problem | str | PathLike[str], *, runs: int | None, mode: str | None = None,
    signal: Signal | None = None, start: Given | None = None, t_final: float | None = None, seed: int | None = None,
    samples: int | Sequence[float] | None = None, observer: str = ..., tolerance: float = ...,
    progress: Callable[[float], None] | None = None,
) -> Trajectory | Ensemble: ...  # fmt: skip


def simulate(
    problem: Problem | str | PathLike[str], *, runs: int | None = None, mode: str | None = None,
    signal: Signal | None = None, start: Given | None = None, t_final: float | None = None, seed: int | None = None,
    samples: int | Sequence[float] | None = None, observer: str = "closed-form", tolerance: float = 1e-9,
    progress: Callable[[float], None] | None = None,
) -> Trajectory | Ensemble:  # fmt: skip
    """Simulate the closed loop (1), (12), (13), (19): one run, or ``runs`` of them with the seeds seed, seed + 1, ...

    The modes follow ``signal``; without it ``mode``; without both the problem's [switching].  The other arguments are
    those of ``simulate.simulate``.  A missing W is designed first, as ``certify`` does, and a note says so.
    Returns: a Trajectory, or with ``runs`` an Ensemble; ``diverged`` says what had to stop early, and ``reason`` why.
    Raises: SpecError for a wrong argument.
    """
    from dobc_design.simulate.ensembles import simulate_many
    from dobc_design.simulate.signal_files import signal_of
    from dobc_design.simulate.simulate import simulate as run

    problem = problem if isinstance(problem, Problem) else load_problem(problem)
    remarks: list[str] = []
    if signal is None and mode is None:
        signal, remark = signal_of(problem)
        remarks += [] if remark is None else [remark]
    if problem.exosystem is not None and problem.observer.W is None and observer != "off":
        remarks.append("No W was given: it was designed.")
    gain = None if observer == "off" else observer_gain(problem)
    if runs is None:
        done = run(
            problem, mode=mode, signal=signal, start=start, t_final=t_final, seed=seed, gain=gain, samples=samples,
            observer=observer, tolerance=tolerance, progress=progress,
        )  # fmt: skip
        return replace(done, notes=(*remarks, *done.notes))
    many = simulate_many(
        problem, runs=runs, mode=mode, signal=signal, start=start, t_final=t_final, seed=seed, gain=gain,
        samples=samples, observer=observer, tolerance=tolerance, progress=progress,
    )  # fmt: skip
    return replace(many, notes=(*remarks, *many.notes))


def observer_gain(problem: Problem) -> Matrix | None:
    """The W that ``certify`` uses: the one given, else the designed one; None without either."""
    if problem.exosystem is None:
        return None
    return problem.observer.W or design_gain(problem.exosystem, rate=problem.observer.rate).W


def design_observer(
    problem: Problem | str | PathLike[str], *, rate: Any = None, region: Any = None, max_gain: Any = None,
    noise: Any = None, method: str = "lmi", peak: Any = None, digits: int = 4, period: Any = None,
) -> ObserverDesign:  # fmt: skip
    """Design the observer gain W and prove that the rounded W does what was asked.

    ``rate`` (1/s); ``region``: HalfPlane, Disk, Cone or a list; ``max_gain``: bound on |W|, the root of the sum of
    squares; ``noise``: bound on the H-infinity norm from measurement noise to dhat, or NoiseLimit; ``peak`` of |eps|;
    ``method``: "lmi", "kalman" or "place"; ``digits`` of W; ``period`` (s) of a sampled observer.
    Returns: an ObserverDesign: PROVED; REFUTED with the reason; UNDECIDED. The last two with the nearest request.
    Raises: SpecError for a wrong request or a problem without [exosystem].
    """
    from dobc_design.design.gain_bound import propose_multipliers
    from dobc_design.design.observer_candidates import propose_gains
    from dobc_design.design.observer_envelope import propose_envelopes
    from dobc_design.design.observer_estimates import estimate_observer
    from dobc_design.spec.observer_request import ObserverRequest
    from dobc_design.verify.observer_search import Proposals, search_observer

    problem = problem if isinstance(problem, Problem) else load_problem(problem)
    exosystem = problem.exosystem
    if exosystem is None:
        raise SpecError(
            "exosystem must be given to design an observer, because it says what W estimates; got none.",
            key="exosystem", cure="dobc_design.exosystems has common shapes, constant() among them.",
        )  # fmt: skip
    request = ObserverRequest(
        rate=problem.observer.rate if rate is None else rate, region=region, max_gain=max_gain, noise=noise,
        peak=peak, method=method, digits=digits, period=period,
    )  # fmt: skip
    proposals = Proposals(
        gains=propose_gains, multipliers=propose_multipliers, estimates=lambda W: estimate_observer(exosystem, W),
        envelopes=lambda W, asked: propose_envelopes(exosystem, W, rate=asked.rate, peak=asked.peak),
    )  # fmt: skip
    return search_observer(exosystem, request, proposals)


def write_report(certificate: Certificate, folder: str | PathLike[str], *, progress: Progress | None = None) -> Path:
    """Write report.html and report.md into ``folder`` and return the path of the page."""
    pages = render_report(certificate, progress=progress)
    target = make_folder(Path(folder))
    write_together({target / name: data for name, data in pages.items()})
    return target / PAGE


def render_report(certificate: Certificate, *, progress: Progress | None = None) -> dict[str, bytes]:
    """The bytes of report.html and report.md by name.

    Diagnostics and one simulation are computed here and handed to the report, which computes nothing.
    """
    from dobc_design.report.html import html_report
    from dobc_design.report.markdown import markdown_report

    say = progress or (lambda stage: None)
    problem, gain = certificate.problem, certificate.claims.W
    analysis, trajectory = None, None
    if problem.n * problem.m <= DRAWN:
        from dobc_design.analysis.analysis import analyse as run_analysis
        from dobc_design.simulate.simulate import simulate as run_simulation

        say("computing diagnostics")
        analysis = run_analysis(problem, gain=gain)
        if problem.exosystem is None or gain is not None:
            say("simulating")
            trajectory = run_simulation(problem, gain=gain)
    lambdas = {}
    if problem.n * problem.m <= SHOWN:
        lambdas = {mode: pencil.constant.to_dense() for mode, pencil in state_theorems(problem).lambdas.items()}
    say("writing the report")
    html = html_report(certificate, analysis=analysis, trajectory=trajectory, lambdas=lambdas)
    text = markdown_report(certificate, analysis=analysis, trajectory=trajectory, lambdas=lambdas)
    return {PAGE: html.encode("utf-8"), "report.md": text.encode("utf-8")}


def diagnose() -> list[dict[str, Any]]:
    """What is installed, and whether the main path works: rows of item, detail, ok."""
    rows: list[dict[str, Any]] = [{"item": "python", "detail": platform.python_version(), "ok": True}]
    for name in PACKAGES:
        try:
            rows.append({"item": name, "detail": metadata.version(name), "ok": True})
        except metadata.PackageNotFoundError:
            rows.append({"item": name, "detail": "not installed", "ok": False})
    try:
        certificate = certify("paper-fixed")
        works = certificate.verdict is Verdict.PROVED and verify(certificate, "paper-fixed").holds
        rows.append({"item": "paper-fixed", "detail": f"{certificate.verdict.value}, re-checked", "ok": works})
    except (DobcError, ImportError) as error:
        rows.append({"item": "paper-fixed", "detail": str(error)[:200], "ok": False})
    return rows
