"""Final bounds of the error: when they are looked for and what is reported (theory, section 12)."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction

from dobc_design.conditions.accuracy.claim import MOST_STAGES, Accuracy, Level, Peaks
from dobc_design.conditions.accuracy.decide import ID, accuracy_check, obstacle
from dobc_design.conditions.accuracy.propose import propose_peaks, propose_stages
from dobc_design.conditions.check import Check, Domain, limited, starts_in, undecided_check
from dobc_design.conditions.coverage import Progress, read_region
from dobc_design.conditions.numbers import claimed, decimal_below, rounded_up
from dobc_design.conditions.separable.claim import Separable
from dobc_design.conditions.separable.stage import largest_claim
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.work import STAGE, WorkLimitError, at_most, out_of_time
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

logger = logging.getLogger("dobc_design")

#: Parts of the box that are tried one after the other: noise passes through a coupling that is steep far out.
PARTS = (Fraction(1), Fraction(1, 2), Fraction(1, 4), Fraction(1, 10), Fraction(1, 30), Fraction(1, 100))
DIGITS = 6  # of a bound, rounded up


def accuracy_stage(
    problem: Problem, W: Matrix | None, checks: Sequence[Check], *, domain: str, report: Progress
) -> list[Check]:
    """The check ``accuracy`` for the gain W (q, m), after ``checks``; none where [uncertainty] adds no input."""
    plant = problem.uncertainty
    if plant is None or not (plant.disturbance or plant.measurement or (plant.drift and problem.groups)):
        return []
    report("bounding the final error")
    if (reason := obstacle(problem, W)) is not None:
        return [undecided_check(ID, domain, reason, applies=False)]
    if (late := out_of_time()) is not None:
        return [undecided_check(ID, domain, late)]
    try:
        with at_most(STAGE):
            peaks = None if W is None or not problem.groups else propose_peaks(problem, W)
        if problem.groups and peaks is None:
            reason = "the peak gains of the observer are not bounded: its error does not decay, or too slowly."
            return [undecided_check(ID, domain, reason)]
        found = _claims(problem, W, peaks, checks, domain)
        first = next(found, None)
    except (ArithmeticError, RuntimeError, ValueError) as error:
        logger.warning("no final bounds: %s", error)
        first = None
    if first is None:
        reason = "no box is found that shrinks under the inputs of [uncertainty]: they are too large for these gains."
        return [undecided_check(ID, domain, reason)]
    return [first]


def _claims(
    problem: Problem, W: Matrix | None, peaks: Peaks | None, checks: Sequence[Check], domain: str
) -> Iterator[Check]:
    """Proved checks, for the largest box of starts first."""
    if domain == "global":
        one = Level(v=(Fraction(1),) * problem.n, alpha=Fraction(1), level=Fraction(1), rho=None)
        yield from _proved(
            problem, W, Accuracy(stages=_stages(problem, peaks, one), bounds={}, peaks=peaks), domain, domain
        )
        return
    claim, starts = _outer(problem, W, checks, domain)
    if claim is None or claim.rho is None:
        return
    for part in PARTS:
        outer = Level(v=claim.v, alpha=claim.alpha, level=claim.rho, rho=claim.rho * part)
        stages = _stages(problem, peaks, outer)
        radius, disturbance = (decimal_below(claimed(x) * part) if x else 0.0 for x in starts)
        box = starts_in("box", radius, disturbance)
        yield from _proved(problem, W, Accuracy(stages=stages, bounds={}, peaks=peaks, error=claim.error), box, domain)


def _outer(
    problem: Problem, W: Matrix | None, checks: Sequence[Check], domain: str
) -> tuple[Separable | None, tuple[float, float]]:
    """A box that shrinks without the inputs, and its starts: that of ``checks``, else the largest one that is found."""
    known = next((check for check in checks if check.id == "max-separable"), None)
    if known is not None and isinstance(known.claim, Separable) and isinstance(known.domain, Mapping):
        return known.claim, (known.domain["radius"], known.domain["disturbance"])
    if known is not None:
        return None, (0.0, 0.0)
    asked = read_region(problem, W, domain=domain, everything=True)
    with at_most(STAGE):
        claim, radius = largest_claim(asked)
    return claim, (radius, asked.disturbance)


def _stages(problem: Problem, peaks: Peaks | None, outer: Level) -> tuple[Level, ...]:
    """Stages as far as they are found within the work of one stage of ``certify``."""
    stages: list[Level] = []
    try:
        with at_most(STAGE):
            for stage in propose_stages(problem, peaks, outer):
                stages.append(stage)
                if len(stages) == MOST_STAGES:
                    break
    except WorkLimitError:
        pass
    return tuple(stages)


def _proved(problem: Problem, W: Matrix | None, claim: Accuracy, starts: Domain, domain: str) -> Iterator[Check]:
    """The check of a claim with its bounds, if it is proved."""
    if not claim.stages:
        return
    last = claim.stages[-1]
    bounds = {x: rounded_up(last.level * v, digits=DIGITS) for x, v in zip(problem.network.labels, last.v, strict=True)}
    whole = Accuracy(stages=claim.stages, bounds=bounds, peaks=claim.peaks, error=claim.error)
    check = limited(ID, domain, lambda: accuracy_check(problem, W, whole, domain=starts, local=domain))
    if check.verdict is Verdict.PROVED:
        yield check
