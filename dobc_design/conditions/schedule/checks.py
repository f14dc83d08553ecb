"""The check `settling`: a proved chain of stages as what a certificate holds (docs/certificate-claims.md), and back.

Also what the stages say about sampling and delays, one by one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Final

from dobc_design.conditions.check import Check, read_domain, read_object, starts_in, undecided_check
from dobc_design.conditions.numbers import claimed, decimal_below, read_rational, rounded_down, vector_from_json
from dobc_design.conditions.quadratic.claim import Lure
from dobc_design.conditions.quadratic.decide import lure_from_json, names_of
from dobc_design.conditions.schedule.claim import NUMBERS, ONE, QUADRATIC, SEPARABLE, ZERO, Stage, Staging
from dobc_design.conditions.schedule.decide import Settling, proved_reason, verify_staging
from dobc_design.conditions.separable.checks import obstacle
from dobc_design.conditions.separable.claim import DelayBound, SamplingBound, Separable, separable_from_json
from dobc_design.conditions.separable.timing import largest_period, longest_delay
from dobc_design.exact.matrix import Matrix
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

MOST_STAGES: Final = 100
KEPT: Final = Fraction(1, 2)  # of a stage's rate, which late messages are to leave


@dataclass(frozen=True, slots=True, kw_only=True)
class StageTiming:
    """What a stage allows once it has begun: how long values may be held, and how late messages may be.  ``delay``
    leaves half of the stage's rate.  None where nothing is shown, as for every quadratic stage."""

    sampling: SamplingBound | None = None
    delay: DelayBound | None = None


def settling_check(problem: Problem, W: Matrix | None, settling: Settling, *, domain: str) -> Check:
    """Decide a settling time once more, for the decimals that its box domain shows; ``domain``: that of Lemma 1.
    PROVED or UNDECIDED."""
    if settling.staging is None:
        return undecided_check("settling", domain, settling.reason)
    radius, disturbance = decimal_below(settling.radius), decimal_below(settling.disturbance)
    check = Check(
        id="settling",
        verdict=Verdict.PROVED,
        domain=starts_in("box", radius, disturbance),
        reason=proved_reason(settling.staging),
        claim=replace(settling.staging, radius=claimed(radius), disturbance=claimed(disturbance)),
    )
    wrong = confirm(check, problem, W, domain=domain)
    return check if wrong is None else undecided_check("settling", domain, wrong)


def confirm(check: Check, problem: Problem, W: Matrix | None, *, domain: str) -> str | None:
    """None if everything a proved ``settling`` claims is confirmed, else what is not; ``domain`` is not needed.  Raises
    what a malformed claim raises."""
    del domain  # of Lemma 1: a settling time is always about a box
    if (reason := obstacle(problem, W)) is not None:
        return reason
    if check.verdict is not Verdict.PROVED or check.witness is not None or check.rate is not None:
        return "it can only be proved or undecided, and has no rate and no witness"
    answer = verify_staging(problem, W, read_claim(check, problem, W))
    return None if answer.verdict is Verdict.PROVED else answer.reason


def read_claim(check: Check, problem: Problem, W: Matrix | None) -> Staging:
    """What a proved check claims, for this problem and the gain W (q, m).  Raises: KeyError, TypeError, ValueError,
    ShapeError or SpecError for anything that cannot be such a claim."""
    radius, disturbance = read_domain(check.domain, problem, kind="box")
    values = read_object(check.exact, ("tolerance", "time", "stages"))
    if not isinstance(values["stages"], list) or not 0 < len(values["stages"]) <= MOST_STAGES:
        raise ValueError(f"stages must be a list of 1 to {MOST_STAGES} objects")
    stages: list[Stage] = []
    for row in values["stages"]:
        stages.append(_stage_from_json(row, problem, W, stages[-1] if stages else None))
    tolerance, time = read_rational(values["tolerance"]), read_rational(values["time"])
    return Staging(stages=tuple(stages), radius=radius, disturbance=disturbance, tolerance=tolerance, time=time)


def settling_of(problem: Problem, staging: Staging, reason: str) -> Settling:
    """The settling time and the envelope of a proved claim, which is taken as it is; ``confirm`` decides it."""
    return Settling(
        verdict=Verdict.PROVED,
        reason=reason,
        problem_name=problem.name,
        radius=staging.radius,
        disturbance=staging.disturbance,
        tolerance=staging.tolerance,
        staging=staging,
    )


def stage_timings(problem: Problem, settling: Settling) -> tuple[StageTiming, ...]:
    """Sampling and delays stage by stage, each proved for a loop that is in the stage's box and stays there."""
    timings = []
    for claim in (stage.certificate for stage in settling.stages):
        if isinstance(claim, Separable):
            fastest = claim.alpha if claim.error is None else min(claim.alpha, claim.error.beta)
            delay = longest_delay(problem, claim, rate=rounded_down(fastest * KEPT, digits=4))
            timings.append(StageTiming(sampling=largest_period(problem, claim), delay=delay))
        else:
            timings.append(StageTiming())
    return tuple(timings)


def _stage_from_json(row: object, problem: Problem, W: Matrix | None, before: Stage | None) -> Stage:
    quadratic = isinstance(row, Mapping) and row.get("kind") == QUADRATIC
    last = () if not quadratic else ("factor",) if before is not None and before.is_quadratic else ("diagonal",)
    values = read_object(row, ("kind", *NUMBERS, "certificate", *last))
    if values["kind"] not in {SEPARABLE, QUADRATIC}:
        raise ValueError(f"kind must be {SEPARABLE} or {QUADRATIC}")
    numbers = {name: read_rational(values[name]) for name in NUMBERS}
    if before is None and numbers["stretch"] != ONE:
        raise ValueError("the first stage has no stage before: its stretch is 1")
    if not problem.groups and (numbers["noise"] != ZERO or numbers["stretch"] != ONE):
        raise ValueError("without an exosystem noise is 0 and stretch 1")
    certificate: Separable | Lure
    if quadratic:
        certificate = lure_from_json(read_object(values["certificate"], names_of(problem)), problem, W)
    else:
        certificate = separable_from_json(values["certificate"], problem)
    diagonal = tuple(vector_from_json(values["diagonal"], problem.n * problem.m)) if "diagonal" in values else None
    factor = read_rational(values["factor"]) if "factor" in values else None
    return Stage(certificate=certificate, **numbers, diagonal=diagonal, factor=factor)
