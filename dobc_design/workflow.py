"""The order of the stages: the only module that knows it.

certify: statements -> estimates and proposals (floating point) -> exact decisions -> certificate.
verify: every claim of a certificate again, from the trusted problem.
"""

from __future__ import annotations

import logging
import math
import platform
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib import metadata
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dobc_design import __version__
from dobc_design.certificate.certificate import Certificate
from dobc_design.certificate.claims import Claims
from dobc_design.certificate.files import make_folder, write_atomically
from dobc_design.certificate.recheck import Recheck, recheck
from dobc_design.design.estimates import Top, decay_rate, directions, lambda_tops, pair_margin, pair_rate
from dobc_design.design.gain import GainDesign, design_gain
from dobc_design.design.pair import propose_pairs
from dobc_design.errors import DobcError
from dobc_design.exact.matrix import Matrix, multiply, to_float
from dobc_design.spec.canonical import problem_sha256
from dobc_design.spec.exosystem import Exosystem
from dobc_design.spec.load import load_problem
from dobc_design.spec.problem import Problem
from dobc_design.theorems.statements import Statements, state_theorems
from dobc_design.verdict import Verdict
from dobc_design.verify.check import Check
from dobc_design.verify.consensus import Pair, Proposal, lemma1_check, psi_is_negative, theorem_check
from dobc_design.verify.network import reachability_check
from dobc_design.verify.observer import detectability_check, hurwitz_check, observability_check
from dobc_design.verify.overall import decide_overall

if TYPE_CHECKING:
    from dobc_design.analysis.analysis import Analysis
    from dobc_design.model.model import Model
    from dobc_design.simulate.trajectory import Trajectory

logger = logging.getLogger("dobc_design")
logger.addHandler(logging.NullHandler())

Progress = Callable[[str], None]
DRAWN = 2000  # rows (n m) up to which diagnostics and a simulation go into the report
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
    report("stating the theorems")
    statements = state_theorems(problem)
    tops = _estimates(statements)
    run = _Run(problem=problem, statements=statements, tops=tops)
    report("deciding network and Lemma 1")
    lemmas = run.lemmas()
    checks = [*(reachability_check(problem, mode) for mode in problem.network.modes), *lemmas]
    design: GainDesign | None = None
    W: Matrix | None = None
    pair: Pair | None = None
    if problem.exosystem is not None:
        report("deciding the observer")
        W = problem.observer.W
        if W is None:
            design = design_gain(problem.exosystem, rate=problem.observer.rate)
            W = design.W
        first = run.observer_checks(problem.exosystem, W)
        report("deciding the theorem")
        theorems, pair = run.theorem_checks(problem.exosystem, W, lemmas, first)
        checks = [*first, *checks, *theorems]
    overall = decide_overall(problem, checks, W)
    return Certificate(
        problem=problem,
        claims=Claims(
            problem_name=problem.name, problem_sha256=problem_sha256(problem), verdict=overall.verdict,
            reason=overall.reason, rate=overall.rate, covered_by=overall.covered_by, checks=tuple(checks), W=W,
            gain_source=None if W is None else ("given" if design is None else "designed"),
            P=None if pair is None else pair.P, Q=None if pair is None else pair.Q,
            notes=tuple(_notes(problem, design)), version=__version__,
        ),
    )  # fmt: skip


def verify(certificate: Certificate | Claims | bytes, problem: Problem | str | PathLike[str]) -> Recheck:
    """Check every claim of a certificate exactly, against the problem, which is trusted and never taken from it.

    Returns: a Recheck; ``holds`` is True iff every claim holds and the verdict follows from them.
    Raises: CertificateError if the certificate cannot be read.
    """
    if not isinstance(problem, Problem):
        problem = load_problem(problem)
    claims = certificate.claims if isinstance(certificate, Certificate) else certificate
    return recheck(claims, problem)


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


def simulate(
    problem: Problem | str | PathLike[str], *, mode: str | None = None, t_final: float | None = None,
    seed: int | None = None,
) -> Trajectory:  # fmt: skip
    """Simulate the full loop (1), (12), (13), (19) in one mode.  A missing W is designed first.

    ``t_final`` in s.  Returns: a Trajectory; ``diverged`` says whether it had to stop early.
    """
    from dobc_design.simulate.simulate import simulate as run

    problem = problem if isinstance(problem, Problem) else load_problem(problem)
    return run(problem, mode=mode, t_final=t_final, seed=seed, gain=observer_gain(problem))


def observer_gain(problem: Problem) -> Matrix | None:
    """The W that ``certify`` uses: the one given, else the designed one; None without either."""
    if problem.exosystem is None:
        return None
    return problem.observer.W or design_gain(problem.exosystem, rate=problem.observer.rate).W


def write_report(
    certificate: Certificate, folder: str | PathLike[str], *, progress: Progress | None = None
) -> Path:
    """Write report.html and report.md into ``folder`` and return the path of the page.

    Diagnostics and one simulation are computed here and handed to the report, which computes nothing.
    """
    from dobc_design.report.html import html_report
    from dobc_design.report.markdown import markdown_report

    say = progress or (lambda stage: None)
    problem, gain = certificate.problem, certificate.claims.W
    target = make_folder(Path(folder))
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
    page = target / "report.html"
    html = html_report(certificate, analysis=analysis, trajectory=trajectory, lambdas=lambdas)
    text = markdown_report(certificate, analysis=analysis, trajectory=trajectory, lambdas=lambdas)
    write_atomically(page, html.encode("utf-8"))
    write_atomically(target / "report.md", text.encode("utf-8"))
    return page


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


@dataclass(frozen=True, slots=True, kw_only=True)
class _Run:
    """One certification: the problem, its conditions, and floating-point estimates to propose from."""

    problem: Problem
    statements: Statements
    tops: dict[str, Top]

    def lemmas(self) -> list[Check]:
        """Lemma 1, mode by mode."""
        checks = []
        for mode in self.problem.network.modes:
            top = self.tops.get(mode)
            proposal = Proposal() if top is None else Proposal(margin=-top.value, vectors=[top.vector.tolist()])
            checks.append(lemma1_check(self.statements, mode, proposal))
        return checks

    def observer_checks(self, exosystem: Exosystem, W: Matrix | None) -> list[Check]:
        """Observability, detectability, Hurwitz."""
        source = "given" if self.problem.observer.W is not None else "designed"
        estimate = 0.0 if W is None else decay_rate(exosystem, W)
        return [
            observability_check(exosystem, self.problem),
            detectability_check(exosystem, self.problem),
            hurwitz_check(exosystem, W, estimate=estimate, source=source, problem=self.problem),
        ]

    def theorem_checks(
        self, exosystem: Exosystem, W: Matrix | None, lemmas: Sequence[Check], observer: Sequence[Check]
    ) -> tuple[list[Check], Pair | None]:
        """The printed P where there is one, then the theorem with a P of our own."""
        problem, checks = self.problem, []
        name = "theorem1" if len(problem.network.modes) == 1 else "theorem2"
        if problem.observer.P is not None and problem.observer.W is not None:
            printed = Pair(P=problem.observer.P, Q=multiply(problem.observer.P, problem.observer.W))
            checks.append(
                theorem_check(
                    f"{name}-printed", self.statements, exosystem, printed, self.proposal(printed, exosystem),
                    lemmas=lemmas, obstacle=None, printed=True,
                )
            )  # fmt: skip
        obstacle = next((c for c in observer[1:] if c.verdict is Verdict.REFUTED), None)
        blocked = obstacle is not None or any(c.verdict is not Verdict.PROVED for c in lemmas)
        pair = None if blocked or W is None else self.find_pair(exosystem, W)
        proposal = Proposal() if pair is None else self.proposal(pair, exosystem)
        checks.append(
            theorem_check(name, self.statements, exosystem, pair, proposal, lemmas=lemmas, obstacle=obstacle)
        )
        return checks, pair

    def find_pair(self, exosystem: Exosystem, W: Matrix) -> Pair | None:
        """The first proposed pair for which Psi < 0 is proved."""
        bound = max((top.value for top in self.tops.values()), default=math.nan)
        for P, Q in propose_pairs(exosystem, W, bound=bound, decay=decay_rate(exosystem, W)):
            pair = Pair(P=P, Q=Q)
            if psi_is_negative(self.statements, exosystem, pair):
                return pair
        return None

    def proposal(self, pair: Pair, exosystem: Exosystem) -> Proposal:
        """Margin, rate and directions to try for a pair."""
        if not self.tops:
            return Proposal()
        P, Q = to_float(pair.P), to_float(pair.Q)
        return Proposal(
            margin=pair_margin(self.tops, P, Q, exosystem),
            rate=pair_rate(self.tops, P, Q, exosystem),
            vectors=directions(self.tops),
        )


def _estimates(statements: Statements) -> dict[str, Top]:
    """Estimates to propose from; none at all if the numerical library breaks down: the exact side then does without."""
    try:
        return lambda_tops(statements)
    except (ArithmeticError, RuntimeError, ValueError) as error:
        logger.warning("eigenvalue estimate failed: %s", error)
        return {}


def _notes(problem: Problem, design: GainDesign | None) -> Iterator[str]:
    yield from problem.notes
    if problem.exosystem is None:
        yield "No exosystem was given: there is no disturbance and no observer."
    elif design is None:
        yield "The observer gain W was given."
    else:
        yield f"No W was given. {design.note[0].upper()}{design.note[1:]}"
    if not problem.pinning.agents:
        yield "No agent is pinned."
    if problem.observer.W is not None and problem.observer.rate is not None:
        yield "observer.rate is not used, because W was given."
    if problem.region is None and not problem.is_linear:
        yield "No region was asked for: the verdict is about the consensus itself, from close enough starts."
    if len(problem.network.modes) > 1:
        yield "The modes may switch in any way, so one V has to serve them all."
    if problem.is_linear:
        yield "Every coupling is exactly linear: what holds near the target holds everywhere."
    if problem.exceptions:
        yield f"{len(problem.exceptions)} arc(s) have a coupling of their own."
    if problem.offsets:
        yield "Agents go to the target plus their formation offset; couplings act on x - offset."


