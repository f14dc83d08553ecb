"""The order of the stages: the only module that knows it.

certify: statements -> estimates and proposals (floating point) -> exact decisions -> certificate.
verify: every claim of a certificate again, from the trusted problem.
"""

from __future__ import annotations

import logging
import platform
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from importlib import metadata
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

from dobc_design import __version__
from dobc_design.certificate.certificate import Certificate
from dobc_design.certificate.claims import Claims
from dobc_design.certificate.files import make_folder, write_together
from dobc_design.certificate.recheck import Recheck, verify_twice
from dobc_design.covering.covering import region_checks
from dobc_design.curing.curing import Findings, with_cures
from dobc_design.deciding import chosen_gains, decide, design_gains, notes_of
from dobc_design.errors import DobcError, SpecError
from dobc_design.exact.matrix import Matrix
from dobc_design.spec.canonical import problem_sha256
from dobc_design.spec.groups import join
from dobc_design.spec.load import load_problem
from dobc_design.spec.problem import Problem
from dobc_design.theorems.statements import state_theorems
from dobc_design.verdict import Verdict
from dobc_design.verify.overall import REGION_IDS, decide_overall
from dobc_design.verify.writable import writable

if TYPE_CHECKING:
    from dobc_design.analysis.analysis import Analysis
    from dobc_design.export.python_control import ConsensusLoop
    from dobc_design.falsifying.levels import Certified
    from dobc_design.falsifying.suspect import Falsification
    from dobc_design.model.model import Model
    from dobc_design.plotting.sheet import Sheet
    from dobc_design.simulate.breaking import Breaking
    from dobc_design.simulate.ensemble import Ensemble
    from dobc_design.simulate.signal_files import Signal
    from dobc_design.simulate.starts import Given
    from dobc_design.simulate.stress import Stress
    from dobc_design.simulate.trajectory import Trajectory
    from dobc_design.verify.check import Check
    from dobc_design.verify.observer_design import ObserverDesign
    from dobc_design.verify.pinning_design import PinningDesign
    from dobc_design.verify.settling import Settling

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


def certify(
    problem: Problem | str | PathLike[str], *, everything: bool = False, progress: Progress | None = None
) -> Certificate:
    """Run every condition that applies and decide each exactly.

    ``problem`` is a Problem, a path or a built-in name.  The region asked for is examined cheapest first, until a
    proof covers it; ``everything``: all of it, also where no region is asked for.  ``progress`` is called with the
    name of each stage.
    Returns: a Certificate; its verdict is PROVED, REFUTED or UNDECIDED.
    Raises: SpecError for a wrong problem.  A numerical library that breaks down costs at most a shorter proof.
    Source: Lemma 1, Theorems 1 and 2; theory, sections 1 to 5.
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
    W, pair = found.W, found.pair
    checks = (
        *checks,
        *region_checks(
            problem, W, checks, domain=found.statements.domain, everything=everything, report=report
        ),
    )  # fmt: skip
    checks = tuple(writable(check) for check in (*checks, *other_equilibria(problem, W, checks, report=report)))
    overall = decide_overall(problem, checks, W)
    return Certificate(
        problem=problem,
        claims=Claims(
            problem_name=problem.name, problem_sha256=problem_sha256(problem), verdict=overall.verdict,
            reason=overall.reason, rate=overall.rate, covered_by=overall.covered_by, checks=checks, W=W,
            gain_source=None if W is None else ("designed" if any(found.designs) else "given"),
            P=None if pair is None else pair.P, Q=None if pair is None else pair.Q,
            notes=tuple(notes_of(problem, found.designs, found.how)), version=__version__,
        ),
    )  # fmt: skip


def other_equilibria(
    problem: Problem, W: Matrix | None, checks: Sequence[Check], *, report: Progress
) -> Iterator[Check]:  # fmt: skip
    """The check that refutes a region with a second equilibrium, where nothing is proved or refuted so far."""
    if problem.region is None or problem.is_linear or problem.is_grouped or (problem.groups and W is None):
        return
    if decide_overall(problem, checks, W).verdict is Verdict.UNDECIDED:
        from dobc_design.falsifying.equilibria import equilibrium_check

        report("looking for another equilibrium")
        found = equilibrium_check(problem)
        if found is not None:
            yield found


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
    stress: Stress | None = None, progress: Callable[[float], None] | None = None,
) -> Trajectory: ...  # fmt: skip


@overload
def simulate(
    problem: Problem | str | PathLike[str], *, runs: int | None, mode: str | None = None,
    signal: Signal | None = None, start: Given | None = None, t_final: float | None = None, seed: int | None = None,
    samples: int | Sequence[float] | None = None, observer: str = ..., tolerance: float = ...,
    stress: Stress | None = None, progress: Callable[[float], None] | None = None,
) -> Trajectory | Ensemble: ...  # fmt: skip


def simulate(
    problem: Problem | str | PathLike[str], *, runs: int | None = None, mode: str | None = None,
    signal: Signal | None = None, start: Given | None = None, t_final: float | None = None, seed: int | None = None,
    samples: int | Sequence[float] | None = None, observer: str = "closed-form", tolerance: float = 1e-9,
    stress: Stress | None = None, progress: Callable[[float], None] | None = None,
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
    if problem.groups and problem.joint_observer.W is None and observer != "off":
        remarks.append("No W was given: it was designed.")
    gain = None if observer == "off" else observer_gain(problem)
    if runs is None:
        done = run(
            problem, mode=mode, signal=signal, start=start, t_final=t_final, seed=seed, gain=gain, samples=samples,
            observer=observer, tolerance=tolerance, stress=stress, progress=progress,
        )  # fmt: skip
        return replace(done, notes=(*remarks, *done.notes))
    many = simulate_many(
        problem, runs=runs, mode=mode, signal=signal, start=start, t_final=t_final, seed=seed, gain=gain,
        samples=samples, observer=observer, tolerance=tolerance, stress=stress, progress=progress,
    )  # fmt: skip
    return replace(many, notes=(*remarks, *many.notes))


def what_breaks_first(
    problem: Problem | str | PathLike[str], *, options: Sequence[str] | None = None, signal: Signal | None = None,
    start: Given | None = None, t_final: float | None = None, seed: int | None = None, tolerance: float = 0.1,
    certificate: Certificate | None = None, progress: Callable[[float], None] | None = None,
) -> Breaking:  # fmt: skip
    """Make noise, disturbance, saturation, sampling, packet loss and failures worse, each until the loop breaks.

    ``options``: some of these (default all).  ``certificate``: its certified sampling period, where it has one, stands
    beside the longest that was seen to work.  The other arguments are those of ``simulate.breaking``.
    Returns: a Breaking, the data of one figure.  Raises: SpecError.
    """
    from dobc_design.simulate.breaking import OPTIONS
    from dobc_design.simulate.breaking import what_breaks_first as run
    from dobc_design.simulate.signal_files import signal_of

    problem = problem if isinstance(problem, Problem) else load_problem(problem)
    return run(
        problem, options=OPTIONS if options is None else options, signal=signal or signal_of(problem)[0], start=start,
        t_final=t_final, seed=seed, gain=observer_gain(problem), tolerance=tolerance,
        certified=None if certificate is None else certified_period(certificate), progress=progress,
    )  # fmt: skip


def to_control(
    problem: Problem | str | PathLike[str], *, mode: str | None = None, signal: Any = None, seed: int | None = None
) -> ConsensusLoop:
    """The closed loop as a control.NonlinearIOSystem, whose response reproduces the trajectory of ``simulate``.

    ``exosystem`` and ``observer`` of the result are control.StateSpace of one agent; ``start_of(trajectory)`` is the
    initial state.  Modes as in ``simulate``: ``mode``, a ``signal`` that does not depend on the states, else the
    problem's [switching], up to its t_final.  A missing W is designed first.  Raises: SpecError.
    """
    from dobc_design.export.python_control import to_control as run
    from dobc_design.simulate.mobile import Mobile
    from dobc_design.simulate.signal_files import signal_of

    problem = problem if isinstance(problem, Problem) else load_problem(problem)
    if signal is None and mode is None:
        signal = signal_of(problem)[0]
    if isinstance(signal, Mobile):
        raise SpecError(
            "signal must not depend on the states, because python-control keeps no graph between calls.", key="signal",
            cure="Give a mode, or another signal.",
        )  # fmt: skip
    settings = problem.simulation
    return run(
        problem, mode=mode, signal=signal, horizon=float(settings.horizon),
        seed=settings.seed if seed is None else seed, gain=observer_gain(problem),
    )  # fmt: skip


def python_script(problem: Problem | str | PathLike[str]) -> str:
    """The closed loop as the text of a Python file that needs NumPy and python-control only.  Raises: SpecError."""
    from dobc_design.export.python_script import python_script as run

    problem = problem if isinstance(problem, Problem) else load_problem(problem)
    return run(problem, gain=observer_gain(problem))


def certified_period(certificate: Certificate) -> float | None:
    """The sampling period in s that a proved ``sampling`` check states; None without one."""
    for check in certificate.checks:
        exact = check.exact or {}
        if check.id == "sampling" and check.verdict is Verdict.PROVED and "period" in exact:
            return float(Fraction(exact["period"]))
    return None


def falsify(
    problem: Problem | str | PathLike[str], *, runs: int = 500, seed: int | None = None, radius: float | None = None,
    disturbance: float | None = None, certified: Certificate | Certified | None = None,
    t_final: float | None = None, progress: Progress | None = None,
) -> Falsification:  # fmt: skip
    """Search for starts that do not converge, or that leave a certified set; and prove second equilibria.

    Starts: the region asked for; with ``radius`` the box |e|_inf <= radius; without both |e|_inf <= 1; with
    ``certified`` the boundary of a certified set: that of a certificate, of one of its checks, or of a claim of
    theorems.separable, theorems.lure or theorems.shell.  ``disturbance`` bounds |eps_i|.  ``runs`` starts are
    simulated: corners, edges, random ones, and the worst of them after gradient ascent through CasADi.  ``t_final``
    in s; ``progress`` is called with the name of each stage.  The same ``seed`` gives the same search.  A missing W is
    designed first, as ``certify`` does.
    Returns: a Falsification with suspects, which prove nothing, and equilibria, each proved in a box by interval
    arithmetic.  Raises: SpecError for a wrong argument.
    """
    from dobc_design.falsifying.falsify import falsify as run

    problem = problem if isinstance(problem, Problem) else load_problem(problem)
    gain = observer_gain(problem)
    if isinstance(certified, Certificate):
        gain, certified = certified.claims.W, regional_check(certified)
    return run(
        problem, runs=runs, seed=seed, radius=radius, disturbance=disturbance, certified=certified, t_final=t_final,
        gain=gain, progress=progress,
    )  # fmt: skip


def regional_check(certificate: Certificate) -> Check:
    """The proved check of a region that covers what is asked, else the first one.  Raises: SpecError without one."""
    proved = [check for check in certificate.checks if check.verdict is Verdict.PROVED and check.id in REGION_IDS]
    if not proved:
        raise SpecError(
            "certified must hold a proved check of a region; this certificate has none.", key="certified",
            cure="Ask for a [region], or give certify everything=True.",
        )  # fmt: skip
    return next((check for check in proved if check.id == certificate.claims.covered_by), proved[0])


def certify_settling(
    problem: Problem | str | PathLike[str], *, tolerance: Any = "1/1000", radius: Any = None, disturbance: Any = None,
    progress: Progress | None = None,
) -> Settling:  # fmt: skip
    """Prove a settling time: |e(t)|_inf <= tolerance for all t >= time, and an envelope of |e(t)|_inf on the way.

    ``tolerance`` in the unit of x.  The starts are |e(0)|_inf <= radius and |eps_i(0)| <= disturbance (Euclidean), by
    default the smallest such set that holds the [region].  It holds for arbitrary switching among the modes.  A
    missing W is designed first, as ``certify`` does.  ``progress`` is called with the name of each stage.
    Returns: a Settling with ``time`` (s), ``envelope(t)``, ``stages`` and ``verdict``: PROVED, or UNDECIDED with
    the reason.  Raises: SpecError for a wrong number, or without a [region] and without a radius.
    Source: theory, section 5, Staging.
    """
    from dobc_design.settling import asked_of, settle

    problem = problem if isinstance(problem, Problem) else load_problem(problem)
    asked = asked_of(problem, tolerance=tolerance, radius=radius, disturbance=disturbance)
    return settle(problem, observer_gain(problem), asked, progress=progress or (lambda stage: None))


def observer_gain(problem: Problem) -> Matrix | None:
    """The W that ``certify`` uses: the one given, else the designed one; None without either."""
    return join(chosen_gains(problem, design_gains(problem)))


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


def design_pinning(
    problem: Problem | str | PathLike[str], *, rate: Any, allowed: Any = None, cost: Any = None, max_gain: Any = None,
    pins: Any = None, digits: int = 4, progress: Progress | None = None,
) -> PinningDesign:  # fmt: skip
    """Design the cheapest pinning gains for a decay rate at the consensus, and prove what is said of them.

    ``rate`` (1/s): Lambda < -2 rate I in every mode, so V = e'e of (22) with eps = 0 decays at it.  ``allowed``: labels
    of agents that may be pinned (default all).  ``cost``: c_i > 0, a number or label -> number, of sum c_i k_i.
    ``max_gain`` (1/s): cap of every gain, likewise.  ``pins``: at most so many agents, or "fewest".  ``digits`` of the
    gains, which are rounded up.  ``progress`` is called with what is being done.  Gains that the problem has are not
    looked at.
    Returns: a PinningDesign: PROVED; REFUTED with the reason; UNDECIDED.  The last two with the nearest request.
    Raises: SpecError for a wrong request, or couplings without a derivative at the consensus.
    Source: theory, section 7.
    """
    from dobc_design.design.pinning_proposals import make_proposer
    from dobc_design.spec.changes import changed_problem
    from dobc_design.spec.pinning_request import PinningRequest, read_request
    from dobc_design.verify.negative import Enclosed
    from dobc_design.verify.pinning_bound import Ground
    from dobc_design.verify.pinning_choice import PinningProposals
    from dobc_design.verify.pinning_search import search_pinning

    problem = problem if isinstance(problem, Problem) else load_problem(problem)
    request = read_request(
        problem.network.labels, rate=rate, allowed=allowed, cost=cost, max_gain=max_gain, pins=pins, digits=digits
    )
    bare = changed_problem(problem, {"pinning.gains": None})
    statements = state_theorems(bare)
    proposer = None if statements.inapplicable else make_proposer(bare, request)
    if proposer is None:
        raise SpecError(
            "coupling must have a derivative at the consensus that floats can hold, because gains are designed for"
            f" the linearisation; {statements.inapplicable or 'an entry of J + J is too large.'}",
            key="coupling.h", cure="Use a smooth coupling, such as tanh(y).",
        )  # fmt: skip
    lambdas = {mode: Enclosed(middle=each.constant, deviations=each.deviations)
               for mode, each in statements.lambdas.items()}  # fmt: skip

    def proposals_for(asked: PinningRequest) -> PinningProposals:
        own = proposer.asked(asked)
        return PinningProposals(
            relax=own.relax, greedy=own.greedy, replaceable=own.replaceable, fastest=own.fastest, slow=own.slow,
            progress=progress or (lambda stage: None),
        )  # fmt: skip

    return search_pinning(Ground(problem=problem, request=request, lambdas=lambdas), proposals_for)


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
        if not problem.groups or gain is not None:
            say("simulating")
            trajectory = run_simulation(problem, gain=gain)
    lambdas = {}
    if problem.n * problem.m <= SHOWN:
        lambdas = {mode: pencil.constant.to_dense() for mode, pencil in state_theorems(problem).lambdas.items()}
    say("writing the report")
    html = html_report(certificate, analysis=analysis, trajectory=trajectory, lambdas=lambdas)
    text = markdown_report(certificate, analysis=analysis, trajectory=trajectory, lambdas=lambdas)
    return {PAGE: html.encode("utf-8"), "report.md": text.encode("utf-8")}


def plot_regions(certificate: Certificate) -> Sheet:
    """The certified regions as a figure: how far each method reaches, and from where each agent may start.

    The figure shows itself in Jupyter; ``save("region.svg")`` writes it, also as .png or .pdf.
    """
    from dobc_design.report.region_pictures import region_sheet

    return region_sheet(certificate.regions)


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
