"""From a problem to a certificate, and back from a certificate to the claims in it.

certify: statements -> estimates and proposals (floating point) -> exact decisions -> certificate.
verify: every claim of a certificate again, from the trusted problem.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any

from dobc_design import __version__
from dobc_design.certificate.certificate import Certificate
from dobc_design.certificate.claims import Claims
from dobc_design.certification.consensus import decide, notes_of
from dobc_design.certification.cures import Findings, with_cures
from dobc_design.certification.overall import decide_overall
from dobc_design.certification.recheck import Recheck, verify_twice
from dobc_design.certification.regions import region_checks
from dobc_design.conditions.observer.gain import observer_gain
from dobc_design.conditions.schedule.asked import asked_of, read_tolerance
from dobc_design.conditions.schedule.settle import settle
from dobc_design.conditions.schedule.stage import settling_stage
from dobc_design.conditions.writable import writable
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.number import number_text
from dobc_design.problem.canonical import problem_sha256
from dobc_design.problem.load import load_problem
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

if TYPE_CHECKING:
    from dobc_design.conditions.check import Check
    from dobc_design.conditions.schedule.settling import Settling

Progress = Callable[[str], None]


def certify(
    problem: Problem | str | PathLike[str],
    *,
    everything: bool = False,
    settling: Any = None,
    progress: Progress | None = None,
) -> Certificate:
    """Run every condition that applies and decide each exactly.

    ``problem`` is a Problem, a path or a built-in name.  The region asked for is examined cheapest first, until a
    proof covers it; ``everything``: all of it, also where no region is asked for.  ``settling``: a tolerance in the
    unit of x; the time after which |e(t)|_inf stays below it is proved as well (with ``everything`` and a region a
    hundredth of its radius by default).  ``progress`` is called with the name of each stage.
    Returns: a Certificate; its verdict is PROVED, REFUTED or UNDECIDED.
    Raises: SpecError for a wrong problem.  A numerical library that breaks down costs at most a shorter proof.
    Source: Lemma 1, Theorems 1 and 2; theory, sections 1 to 5.
    Example:
        >>> certificate = dd.certify("clock-sync")
        >>> certificate.verdict.value, certificate.covered_by
        ('proved', 'theorem1')
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
        problem, found.checks, findings, progress=report, decide=lambda cured: decide(cured, lambda stage: None).checks
    )
    W, pair = found.W, found.pair
    checks = (
        *checks,
        *region_checks(problem, W, checks, domain=found.statements.domain, everything=everything, report=report),
    )
    if tolerance is not None or (everything and problem.region is not None):
        checks = (
            *checks,
            settling_stage(problem, W, checks, tolerance=tolerance, domain=found.statements.domain, report=report),
        )
    checks = tuple(writable(check) for check in (*checks, *other_equilibria(problem, W, checks, report=report)))
    overall = decide_overall(problem, checks, W)
    return Certificate(
        problem=problem,
        claims=Claims(
            problem_name=problem.name,
            problem_sha256=problem_sha256(problem),
            verdict=overall.verdict,
            reason=overall.reason,
            rate=overall.rate,
            covered_by=overall.covered_by,
            checks=checks,
            W=W,
            gain_source=None if W is None else ("designed" if any(found.designs) else "given"),
            P=None if pair is None else pair.P,
            Q=None if pair is None else pair.Q,
            notes=tuple(notes_of(problem, found.designs, found.how)),
            version=__version__,
            options=(
                *(["--all"] if everything else []),
                *([] if tolerance is None else [f"--settling {number_text(tolerance)}"]),
            ),
        ),
    )


def other_equilibria(
    problem: Problem, W: Matrix | None, checks: Sequence[Check], *, report: Progress
) -> Iterator[Check]:
    """The check that refutes a region with a second equilibrium, where nothing is proved or refuted so far."""
    if problem.region is None or problem.is_linear or (problem.groups and W is None):
        return
    if decide_overall(problem, checks, W).verdict is Verdict.UNDECIDED:
        from dobc_design.falsification.equilibria import equilibrium_check

        report("looking for another equilibrium")
        found = equilibrium_check(problem)
        if found is not None:
            yield found


def verify(certificate: Certificate | Claims | bytes, problem: Problem | str | PathLike[str]) -> Recheck:
    """Check every claim of a certificate exactly, against the problem, which is trusted and never taken from it.

    Two programs written apart decide, the package's own exact arithmetic and the folder ``checker``.
    Returns: a Recheck; ``holds`` is True iff both find that every claim holds and the verdict follows from them.
    Raises: CertificateError if the certificate cannot be read.
    Example:
        >>> dd.verify(dd.certify("clock-sync"), "clock-sync").holds
        True
    """
    if not isinstance(problem, Problem):
        problem = load_problem(problem)
    claims = certificate.claims if isinstance(certificate, Certificate) else certificate
    return verify_twice(claims, problem)


def certify_settling(
    problem: Problem | str | PathLike[str],
    *,
    tolerance: Any = "1/1000",
    radius: Any = None,
    disturbance: Any = None,
    progress: Progress | None = None,
) -> Settling:
    """Prove a settling time: |e(t)|_inf <= tolerance for all t >= time, and an envelope of |e(t)|_inf on the way.

    ``tolerance`` in the unit of x.  The starts are |e(0)|_inf <= ``radius`` and |eps_i(0)| <= ``disturbance``
    (Euclidean), by default the smallest such set that holds the [region].  It holds for arbitrary switching among the
    modes.  A missing W is designed first, as ``certify`` does.  ``progress`` is called with the name of each stage.
    Returns: a Settling with ``time`` (s), ``envelope(t)``, ``stages`` and ``verdict``: PROVED, or UNDECIDED with
    the reason.  Raises: SpecError for a wrong number, or without a [region] and without a radius.
    Source: theory, section 5, Staging.
    Example:
        >>> settling = dd.certify_settling("clock-sync", radius=1, disturbance=1, tolerance="1/10")
        >>> settling.verdict.value, settling.envelope(settling.time) <= 0.1
        ('proved', True)
    """
    problem = problem if isinstance(problem, Problem) else load_problem(problem)
    asked = asked_of(problem, tolerance=tolerance, radius=radius, disturbance=disturbance)
    return settle(problem, observer_gain(problem), asked, progress=progress or (lambda stage: None))
