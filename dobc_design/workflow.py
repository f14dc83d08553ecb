"""The order of the stages: the only module that knows it.

certify: statements -> estimates and proposals (floating point) -> exact decisions -> certificate.
verify: every claim of a certificate again, from the trusted problem.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
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
from dobc_design.errors import SpecError
from dobc_design.exact.matrix import Matrix
from dobc_design.settling.asked import asked_of, read_tolerance
from dobc_design.settling.settling import settle
from dobc_design.settling.stage import settling_stage
from dobc_design.spec.canonical import loop_sha256, problem_sha256
from dobc_design.spec.groups import join
from dobc_design.spec.load import load_problem
from dobc_design.spec.problem import Problem
from dobc_design.theorems.statements import state_theorems
from dobc_design.verdict import Verdict
from dobc_design.verify.overall import decide_overall
from dobc_design.verify.settling_check import stage_timings
from dobc_design.verify.writable import writable

if TYPE_CHECKING:
    from dobc_design.analysis.analysis import Analysis
    from dobc_design.designing.designed import Design
    from dobc_design.designing.trade_off import TradeOff
    from dobc_design.export.python_control import ConsensusLoop
    from dobc_design.falsifying.levels import Certified
    from dobc_design.falsifying.suspect import Falsification
    from dobc_design.model.model import Model
    from dobc_design.plotting.sheet import Sheet
    from dobc_design.searching import Searched
    from dobc_design.simulate.breaking import Breaking
    from dobc_design.simulate.ensemble import Ensemble
    from dobc_design.simulate.signal_files import Signal
    from dobc_design.simulate.starts import Given
    from dobc_design.simulate.stress import Stress
    from dobc_design.simulate.trajectory import Trajectory
    from dobc_design.theorems.duals import QuadraticDual
    from dobc_design.verify.check import Check
    from dobc_design.verify.observer_design import ObserverDesign
    from dobc_design.verify.pinning_design import PinningDesign
    from dobc_design.verify.settling import Settling

logger = logging.getLogger("dobc_design")
logger.addHandler(logging.NullHandler())

Progress = Callable[[str], None]
DRAWN = 2000  # rows (n m) up to which diagnostics and a simulation go into the report
PAGE, PDF = "report.html", "report.pdf"
SHOWN = 12  # rows up to which Lambda is printed
MOST_ARCS_COMPARED = 5000  # of all modes, up to which a run records of which problem it is


def certify(
    problem: Problem | str | PathLike[str], *, everything: bool = False, settling: Any = None,
    progress: Progress | None = None,
) -> Certificate:  # fmt: skip
    """Run every condition that applies and decide each exactly.

    ``problem`` is a Problem, a path or a built-in name.  The region asked for is examined cheapest first, until a
    proof covers it; ``everything``: all of it, also where no region is asked for.  ``settling``: a tolerance in the
    unit of x; the time after which |e(t)|_inf stays below it is proved as well (with ``everything`` and a region a
    hundredth of its radius by default).  ``progress`` is called with the name of each stage.
    Returns: a Certificate; its verdict is PROVED, REFUTED or UNDECIDED.
    Raises: SpecError for a wrong problem.  A numerical library that breaks down costs at most a shorter proof.
    Source: Lemma 1, Theorems 1 and 2; theory, sections 1 to 5.
    """
    if not isinstance(problem, Problem):
        problem = load_problem(problem)
    report = progress or (lambda stage: None)
    tolerance = None if settling is None else read_tolerance(settling)
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
    if tolerance is not None or (everything and problem.region is not None):
        checks = (
            *checks,
            settling_stage(
                problem, W, checks, tolerance=tolerance, domain=found.statements.domain, report=report
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
        return replace(done, notes=(*remarks, *done.notes), loop_sha256=_fingerprint(problem, gain))
    many = simulate_many(
        problem, runs=runs, mode=mode, signal=signal, start=start, t_final=t_final, seed=seed, gain=gain,
        samples=samples, observer=observer, tolerance=tolerance, stress=stress, progress=progress,
    )  # fmt: skip
    return replace(many, notes=(*remarks, *many.notes), loop_sha256=_fingerprint(problem, gain))


def _fingerprint(problem: Problem, gain: Matrix | None) -> str:
    """What ties a run to certificates of its problem; "" for large networks, where it would cost more than the run."""
    arcs = sum(len(each) for each in problem.network.modes.values())
    return loop_sha256(problem, gain) if arcs <= MOST_ARCS_COMPARED else ""


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
    chosen, remark = (signal, None) if signal is not None else signal_of(problem)
    found = run(
        problem, options=OPTIONS if options is None else options, signal=chosen, start=start, t_final=t_final,
        seed=seed, gain=observer_gain(problem), tolerance=tolerance,
        certified=None if certificate is None else certified_period(certificate), progress=progress,
    )  # fmt: skip
    if remark is None:
        return found
    return replace(found, calm=replace(found.calm, notes=(remark, *found.calm.notes)))


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
        from dobc_design.searching import needed_check

        gain, certified = certified.claims.W, needed_check(certified)
    return run(
        problem, runs=runs, seed=seed, radius=radius, disturbance=disturbance, certified=certified, t_final=t_final,
        gain=gain, progress=progress,
    )  # fmt: skip


def search_certificate(
    certificate: Certificate, *, runs: int | None = None, seed: int | None = None, progress: Progress | None = None
) -> Searched:
    """Look for starts that contradict: in the region asked for, and on the boundary of the certified set.

    Returns: the searches, and the certificate, which a proved equilibrium inside the region asked for refutes where
    nothing was decided.  A missing region: twice the largest certified box.  Raises: SpecError for a wrong argument.
    """
    from dobc_design.searching import search_certificate as run

    return run(certificate, runs=runs, seed=seed, progress=progress)


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
    pins: Any = None, digits: int = 4, region: Any = None, method: str | None = None, progress: Progress | None = None,
) -> PinningDesign:  # fmt: skip
    """Design the cheapest pinning gains for a decay rate, and prove what is said of them.

    ``rate`` (1/s): at the consensus Lambda < -2 rate I in every mode, so V = e'e of (22) with eps = 0 decays at it.
    ``region``: a radius, or True for the problem's [region]; the gains then come with a certificate that covers it.
    ``method``: "max-separable" (|e_i| <= radius; the default for couplings by component) or "lure" (V = e'e on |e| <=
    radius, eps = 0).  ``allowed``: labels of agents that may be pinned (default all).  ``cost``: c_i > 0, a number or
    label -> number, of sum c_i k_i.  ``max_gain`` (1/s): cap of every gain, likewise.  ``pins``: at most so many
    agents, or "fewest".  ``digits`` of the gains, which are rounded up.  ``progress`` is called with what is being
    done.  Gains that the problem has are not looked at.
    Returns: a PinningDesign: PROVED; REFUTED with the reason; UNDECIDED.  The last two with the nearest request.
    Raises: SpecError for a wrong request, or couplings without a derivative at the consensus.
    Source: theory, sections 4, 5 and 7.
    """
    from dobc_design.designing.pinning import designed_pinning
    from dobc_design.spec.pinning_request import read_request

    problem = problem if isinstance(problem, Problem) else load_problem(problem)
    request = read_request(
        problem.network.labels, rate=rate, allowed=allowed, cost=cost, max_gain=max_gain, pins=pins, digits=digits
    )
    return designed_pinning(problem, request, region=region, method=method, progress=progress or (lambda stage: None))


def design(
    problem: Problem | str | PathLike[str], *, rate: Any = None, pins: Any = None, max_gain: Any = None,
    allowed: Any = None, noise: Any = None, digits: int = 3, reduce: bool = True, progress: Progress | None = None,
) -> Design:  # fmt: skip
    """Design observer gain, pinned agents and gains together, so that ``certify`` proves what the problem asks.

    W, P and gains that the problem has are not looked at.  ``rate`` (1/s): the certified rate has to be at least that;
    without it half of the fastest that the pins allow is aimed at.  ``pins``: at most so many agents, by default as few
    as it takes.  ``max_gain`` (1/s): cap of every gain, a number or label -> number.  ``allowed``: labels of agents
    that may be pinned.  ``noise``: bound on the H-infinity norm from measurement noise to dhat, or NoiseLimit.
    ``digits`` of W and of the gains: what is certified are the rounded numbers.  ``reduce``: an exosystem with a part
    that C does not see and that does not decay is replaced by its observable part.  ``progress`` is called with what
    is being done.
    Returns: a Design: PROVED, with ``problem`` and ``certificate``; REFUTED with the reason; UNDECIDED.  The last two
    with the nearest possible request.  Raises: SpecError for a wrong argument.
    """
    from dobc_design.designing.ground import Tools
    from dobc_design.designing.joint import joint_design
    from dobc_design.spec.design_request import read_design_request

    problem = problem if isinstance(problem, Problem) else load_problem(problem)
    request = read_design_request(
        problem.network.labels, rate=rate, pins=pins, max_gain=max_gain, allowed=allowed, noise=noise, digits=digits,
        reduce=reduce,
    )  # fmt: skip
    tools = Tools(certify=certify, observer=design_observer, pinning=design_pinning,
                  progress=progress or (lambda stage: None))  # fmt: skip
    return joint_design(problem, request, tools)


def trade_off(
    problem: Problem | str | PathLike[str], *, curve: str = "gain", design: Design | None = None, pins: Any = None,
    max_gain: Any = None, allowed: Any = None, points: int = 10, digits: int = 3, progress: Progress | None = None,
) -> TradeOff:  # fmt: skip
    """One limit of a design in terms of another, as a curve.

    ``curve``: "gain", the sum of the gains against the rate, with the pins of ``design``, or those that ``design()``
    would begin with; "pins", the rate that gains approach against the number of pinned agents; "noise", the gain from
    measurement noise to dhat against the decay of the estimate's error.  ``design``: one of this problem, whose point
    is marked and whose W is used.  The other arguments are those of ``design``; gains that the problem has are not
    looked at.  With a [region] the curves "gain" and "pins" are about it, and are what floating point sees.
    Returns: a TradeOff with ``points``, ``plot()`` and ``to_pandas()``.  Raises: SpecError for a wrong argument.
    """
    from dobc_design.designing.curves import Terms, read_points, trade_off_of
    from dobc_design.designing.ground import Tools
    from dobc_design.spec.design_request import read_design_request

    problem = problem if isinstance(problem, Problem) else load_problem(problem)
    request = read_design_request(
        problem.network.labels, pins=pins, max_gain=max_gain, allowed=allowed, digits=digits
    )  # fmt: skip
    tools = Tools(certify=certify, observer=design_observer, pinning=design_pinning,
                  progress=progress or (lambda stage: None))  # fmt: skip
    W = observer_gain(problem) if design is None or design.W is None else design.W
    terms = Terms(problem=problem, request=request, W=W, design=design, points=read_points(points), tools=tools)
    return trade_off_of(terms, curve)


def write_report(
    certificate: Certificate, folder: str | PathLike[str], *, searches: Sequence[Falsification] = (),
    limits: Sequence[QuadraticDual] = (), pdf: bool = False, progress: Progress | None = None,
) -> Path:  # fmt: skip
    """Write report.html and report.md into ``folder`` and return the path of the page; see ``render_report``.

    ``pdf``: report.pdf too, which needs the extra `pdf`.
    """
    pages = render_report(certificate, searches=searches, limits=limits, pdf=pdf, progress=progress)
    target = make_folder(Path(folder))
    write_together({target / name: data for name, data in pages.items()})
    return target / PAGE


def render_report(
    certificate: Certificate, *, searches: Sequence[Falsification] = (), limits: Sequence[QuadraticDual] = (),
    pdf: bool = False, progress: Progress | None = None,
) -> dict[str, bytes]:  # fmt: skip
    """The bytes of report.html and report.md by name, and with ``pdf`` of report.pdf.

    Diagnostics, one simulation and what the stages of a settling time say about sampling and delays are computed here
    and handed to the report, which computes nothing.  ``searches`` for counterexamples and ``limits`` of quadratic
    certificates are shown where they are given.
    """
    from dobc_design.report.html import html_report
    from dobc_design.report.markdown import markdown_report
    from dobc_design.report.pdf import pdf_report, require_typst

    if pdf:
        require_typst()  # said before anything is computed
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
            trajectory = replace(run_simulation(problem, gain=gain), loop_sha256=_fingerprint(problem, gain))
    lambdas = {}
    if problem.n * problem.m <= SHOWN:
        lambdas = {mode: pencil.constant.to_dense() for mode, pencil in state_theorems(problem).lambdas.items()}
    settling = certificate.settling
    if settling is not None:
        say("deciding delays and sampling, stage by stage")
    timings = () if settling is None else stage_timings(problem, settling)
    say("writing the report")
    html = html_report(
        certificate, analysis=analysis, trajectory=trajectory, lambdas=lambdas, timings=timings, searches=searches,
        limits=limits,
    )  # fmt: skip
    text = markdown_report(
        certificate, analysis=analysis, trajectory=trajectory, lambdas=lambdas, timings=timings, searches=searches,
        limits=limits,
    )  # fmt: skip
    pages = {PAGE: html.encode("utf-8"), "report.md": text.encode("utf-8")}
    if pdf:
        say("setting the PDF")
        pages[PDF] = pdf_report(
            certificate, analysis=analysis, trajectory=trajectory, lambdas=lambdas, timings=timings, searches=searches,
            limits=limits,
        )  # fmt: skip
    return pages


def quadratic_limits(
    certificate: Certificate, *, progress: Progress | None = None
) -> tuple[QuadraticDual, ...]:  # fmt: skip
    """Prove how far no quadratic certificate reaches, for every shape of P_e, beside a proved `lure`.

    Each is an exact dual: no P_e of its shape decreases for all gains while |e_j - e_i| <= its ``radius``, so certified
    balls stay below its ``ball``.  Empty where none is found.  Source: theory, section 4.
    """
    from dobc_design.covering.limits import quadratic_limits as run

    lure = next((check for check in certificate.checks if check.id == "lure"), None)
    return run(certificate.problem, lure, report=progress or (lambda stage: None))


def write_comparison(
    first: Certificate, second: Certificate, folder: str | PathLike[str]
) -> Path:  # fmt: skip
    """Write two certificates side by side, comparison.html and comparison.md, into ``folder``; return the page's path.

    Verdicts, checks, rates, certified starts, and what differs between the two problems.
    """
    target = make_folder(Path(folder))
    pages = render_comparison(first, second)
    write_together({target / name: data for name, data in pages.items()})
    return target / next(iter(pages))


def render_comparison(first: Certificate, second: Certificate) -> dict[str, bytes]:
    """The bytes of comparison.html and comparison.md by name."""
    from dobc_design.report.compare import compare_html, compare_markdown

    html, text = compare_html(first, second), compare_markdown(first, second)
    return {"comparison.html": html.encode("utf-8"), "comparison.md": text.encode("utf-8")}


def plot_regions(certificate: Certificate, *, limits: Sequence[QuadraticDual] = ()) -> Sheet:
    """The certified regions as a figure: how far each method reaches, and from where each agent may start.

    The figure shows itself in Jupyter; ``save("region.svg")`` writes it, also as .png or .pdf.
    """
    from dobc_design.report.region_pictures import region_sheet

    return region_sheet(certificate.regions, limits)


def search_sheet(searches: Sequence[Falsification]) -> Sheet | None:
    """What searches found as a figure, one drawing each; None where nothing was found."""
    from dobc_design.report.search_figures import search_sheet as run

    return run(searches)
