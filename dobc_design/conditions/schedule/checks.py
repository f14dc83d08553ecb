"""The check `settling`: a proved chain of stages as what a certificate holds, and back.

The form is fixed by docs/certificate-format.md, "Regions".  Also what the stages say about sampling and delays, one by
one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Final

from dobc_design.conditions.check import Check
from dobc_design.conditions.numbers import read_rational
from dobc_design.conditions.quadratic.claim import Lure
from dobc_design.conditions.quadratic.json_text import lure_from_json, lure_to_json
from dobc_design.conditions.schedule.claim import ONE, ZERO, Stage, Staging
from dobc_design.conditions.schedule.decide import proved_reason, verify_staging
from dobc_design.conditions.schedule.settling import Settling
from dobc_design.conditions.separable.checks import (
    box,
    decimal_below,
    obstacle,
    read_domain,
    read_object,
    separable_from_json,
    separable_to_json,
    undecided_check,
    vector_from_json,
    vector_to_json,
)
from dobc_design.conditions.separable.claim import Separable
from dobc_design.conditions.separable.decide import rounded_down
from dobc_design.conditions.separable.timing import (
    DelayBound,
    SamplingBound,
    largest_delay_rate,
    largest_period,
    longest_delay,
)
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.number import number_text
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

SEPARABLE, QUADRATIC = "max-separable", "quadratic"
MOST_STAGES: Final = 100
#: The part of a stage's rate that late messages are to leave.
KEPT: Final = Fraction(1, 2)
LURE: Final = ("method", "P_e", "level", "radius", "ranges", "multipliers", "rate")


@dataclass(frozen=True, slots=True, kw_only=True)
class StageTiming:
    """What a stage allows once it has begun: how long values may be held, and how late messages may be.

    ``delay`` leaves half of the stage's rate.  None where nothing is shown, as for every quadratic stage.
    """

    sampling: SamplingBound | None = None
    delay: DelayBound | None = None


def settling_check(problem: Problem, W: Matrix | None, settling: Settling, *, domain: str) -> Check:
    """Decide a settling time once more, for the decimals that its box domain shows; ``domain``: that of Lemma 1.

    PROVED or UNDECIDED.
    """
    if settling.staging is None:
        return undecided_check("settling", domain, settling.reason)
    shown = box(decimal_below(settling.radius), decimal_below(settling.disturbance))
    check = Check(
        id="settling",
        verdict=Verdict.PROVED,
        domain=shown,
        reason=proved_reason(settling.staging),
        exact=staging_to_json(settling.staging),
    )
    wrong = confirm_settling(check, problem, W, domain)
    return check if wrong is None else undecided_check("settling", domain, wrong)


def confirm_settling(check: Check, problem: Problem, W: Matrix | None, domain: str) -> str | None:
    """None if everything a proved ``settling`` claims is confirmed, else what is not; ``domain`` is not needed.

    Raises what a malformed claim raises.
    """
    del domain  # of Lemma 1: a settling time is always about a box
    reason = obstacle(problem, W)
    if reason is not None:
        return reason
    if check.verdict is not Verdict.PROVED or check.witness is not None or check.rate is not None:
        return "it can only be proved or undecided, and has no rate and no witness"
    radius, disturbance = read_domain(check.domain, problem, kind="box")
    staging = staging_from_json(check.exact, problem, W, radius=radius, disturbance=disturbance)
    answer = verify_staging(problem, W, staging)
    return None if answer.verdict is Verdict.PROVED else answer.reason


def staging_to_json(staging: Staging) -> dict[str, Any]:
    """The exact values of a proved settling check."""
    return {
        "tolerance": number_text(staging.tolerance),
        "time": number_text(staging.time),
        "stages": [_stage_to_json(stage) for stage in staging.stages],
    }


def staging_from_json(
    exact: object, problem: Problem, W: Matrix | None, *, radius: Fraction, disturbance: Fraction
) -> Staging:
    """Read them back for this problem, the gain W (q, m) and the box.

    Raises: KeyError, TypeError, ValueError, ShapeError or SpecError for anything that cannot be such a claim.
    """
    values = read_object(exact, ("tolerance", "time", "stages"))
    rows = values["stages"]
    if not isinstance(rows, list) or not 0 < len(rows) <= MOST_STAGES:
        raise ValueError(f"stages must be a list of 1 to {MOST_STAGES} objects")
    stages: list[Stage] = []
    for row in rows:
        stages.append(_stage_from_json(row, problem, W, stages[-1] if stages else None))
    return Staging(
        stages=tuple(stages),
        radius=radius,
        disturbance=disturbance,
        tolerance=read_rational(values["tolerance"]),
        time=read_rational(values["time"]),
    )


def settling_of(check: Check | None, problem: Problem, W: Matrix | None) -> Settling | None:
    """The settling time and the envelope that a proved ``settling`` claims; None without such a check.

    The claim is taken as it is; ``confirm_settling`` decides it.  Raises what a malformed claim raises.
    """
    if check is None or check.verdict is not Verdict.PROVED:
        return None
    radius, disturbance = read_domain(check.domain, problem, kind="box")
    staging = staging_from_json(check.exact, problem, W, radius=radius, disturbance=disturbance)
    return Settling(
        verdict=check.verdict,
        reason=check.reason,
        problem_name=problem.name,
        radius=radius,
        disturbance=disturbance,
        tolerance=staging.tolerance,
        staging=staging,
    )


def stage_timings(problem: Problem, settling: Settling) -> tuple[StageTiming, ...]:
    """Sampling and delays stage by stage, each proved for a loop that is in the stage's box and stays there."""
    return tuple(
        _timing(problem, stage.certificate) if isinstance(stage.certificate, Separable) else StageTiming()
        for stage in settling.stages
    )


def _timing(problem: Problem, claim: Separable) -> StageTiming:
    fastest = claim.alpha if claim.error is None else min(claim.alpha, claim.error.beta)
    return StageTiming(
        sampling=largest_period(problem, claim),
        delay=longest_delay(problem, claim, rate=rounded_down(fastest * KEPT, digits=4)),
    )


def sampling_periods(problem: Problem, settling: Settling) -> tuple[SamplingBound | None, ...]:
    """The largest sampling period, about, that each max-separable stage allows once it has begun; None for others.

    Each says: while N <= rho of that stage, couplings and pinning held over the period let N fall by the factor.
    """
    return tuple(
        largest_period(problem, stage.certificate) if isinstance(stage.certificate, Separable) else None
        for stage in settling.stages
    )


def delay_rates(problem: Problem, settling: Settling, *, delay: Fraction) -> tuple[DelayBound | None, ...]:
    """The rate that each max-separable stage keeps for communication delays up to ``delay`` (s); None for others.

    Each is about a loop that begins and stays in that stage's box.  Raises: SpecError for a negative delay.
    """
    return tuple(
        largest_delay_rate(problem, stage.certificate, delay=delay)
        if isinstance(stage.certificate, Separable)
        else None
        for stage in settling.stages
    )


def _stage_to_json(stage: Stage) -> dict[str, Any]:
    certificate = stage.certificate
    values: dict[str, Any] = {"kind": QUADRATIC if stage.is_quadratic else SEPARABLE}
    values |= {name: number_text(getattr(stage, name)) for name in ("start", "level", "height", "noise", "stretch")}
    if stage.diagonal is not None:
        values["diagonal"] = vector_to_json(stage.diagonal)
    if stage.factor is not None:
        values["factor"] = number_text(stage.factor)
    values["certificate"] = (
        separable_to_json(certificate) if isinstance(certificate, Separable) else lure_to_json(certificate)
    )
    return values


def _stage_from_json(row: object, problem: Problem, W: Matrix | None, before: Stage | None) -> Stage:
    quadratic = isinstance(row, Mapping) and row.get("kind") == QUADRATIC
    last = () if not quadratic else ("factor",) if before is not None and before.is_quadratic else ("diagonal",)
    values = read_object(row, ("kind", "start", "level", "height", "noise", "stretch", "certificate", *last))
    if values["kind"] not in {SEPARABLE, QUADRATIC}:
        raise ValueError(f"kind must be {SEPARABLE} or {QUADRATIC}")
    numbers = {name: read_rational(values[name]) for name in ("start", "level", "height", "noise", "stretch")}
    if before is None and numbers["stretch"] != ONE:
        raise ValueError("the first stage has no stage before: its stretch is 1")
    if not problem.groups and (numbers["noise"] != ZERO or numbers["stretch"] != ONE):
        raise ValueError("without an exosystem noise is 0 and stretch 1")
    certificate: Separable | Lure
    if quadratic:
        observer = ("P",) if problem.groups else ()
        certificate = lure_from_json(read_object(values["certificate"], (*LURE, *observer)), problem, W)
    else:
        certificate = separable_from_json(values["certificate"], problem)
    return Stage(
        certificate=certificate,
        **numbers,
        diagonal=tuple(vector_from_json(values["diagonal"], problem.n * problem.m)) if "diagonal" in values else None,
        factor=read_rational(values["factor"]) if "factor" in values else None,
    )
