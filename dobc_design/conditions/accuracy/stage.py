"""Final bounds of the error: when they are looked for and what is reported (theory, section 12)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import chain

from dobc_design.conditions.accuracy.claim import MOST_STAGES, Accuracy, Level, Peaks
from dobc_design.conditions.accuracy.decide import ID, accuracy_check, obstacle
from dobc_design.conditions.accuracy.propose import near_target, propose_peaks, propose_stages
from dobc_design.conditions.check import Check, Domain, limited, starts_in, surviving, undecided_check
from dobc_design.conditions.coverage import Progress, read_region
from dobc_design.conditions.numbers import claimed, decimal_below, rounded_up
from dobc_design.conditions.separable.claim import ErrorBound, Separable
from dobc_design.conditions.separable.propose_observer import propose_error_bound
from dobc_design.conditions.separable.stage import largest_claim
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.number import root_above
from dobc_design.exact.work import STAGE, WorkLimitError, at_most, out_of_time
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

#: Parts of the box that are tried one after the other: noise passes through a coupling that is steep far out.
PARTS = (Fraction(1), Fraction(1, 2), Fraction(1, 4), Fraction(1, 10), Fraction(1, 30), Fraction(1, 100))
DIGITS = 6  # of a bound, rounded up
NEARLY = Fraction(100_001, 100_000)  # kappa beta min v, which has to exceed 1


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
    first = None
    with surviving("no final bounds"):
        with at_most(STAGE):
            peaks = None if W is None or not problem.groups else propose_peaks(problem, W)
        if problem.groups and peaks is None:
            reason = "the peak gains of the observer are not bounded: its error does not decay, or too slowly."
            return [undecided_check(ID, domain, reason)]
        first = next(_claims(problem, W, peaks, checks, domain), None)
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
        yield from _proved(problem, W, Accuracy(stages=_stages(problem, peaks, one), bounds={}, peaks=peaks), domain)
        return
    known, starts = _outer(problem, W, checks, domain)
    error = None if known is None else known.error
    boxes: list[tuple[Level, ErrorBound | None, Domain]] = []
    if known is not None and known.rho is not None:
        for part in PARTS:
            radius, disturbance = (decimal_below(x * part) if x else 0.0 for x in starts)
            outer = Level(v=known.v, alpha=known.alpha, level=known.rho, rho=known.rho * part)
            boxes.append((outer, error, starts_in("box", radius, disturbance)))
    exosystem = problem.joint_exosystem
    if exosystem is not None and W is not None and error is None:
        error = propose_error_bound(exosystem, W)
    near = () if exosystem is not None and error is None else near_target(problem, peaks)
    for outer, bound, box in chain(boxes, (_near_box(each, error, starts[1]) for each in near)):
        claim = Accuracy(stages=_stages(problem, peaks, outer), bounds={}, peaks=peaks, error=bound)
        yield from _proved(problem, W, claim, box, domain)


def _near_box(outer: Level, error: ErrorBound | None, disturbance: Fraction) -> tuple[Level, ErrorBound | None, Domain]:
    """A stage |e_i| <= v_i with starts in it: half of what its level leaves is for the errors of the estimates."""
    smallest, room = min(outer.v), (1 - outer.level) / 2
    if error is None:
        return outer, None, starts_in("box", decimal_below(smallest), 0.0)
    kappa = rounded_up(1 / (error.beta * smallest) * NEARLY, digits=9)
    most = min(disturbance, room / (kappa * root_above(error.size, unit=10**9)))
    box = starts_in("box", decimal_below(smallest * (1 - room)), decimal_below(most) if most else 0.0)
    return outer, replace(error, kappa=kappa), box


def _outer(
    problem: Problem, W: Matrix | None, checks: Sequence[Check], domain: str
) -> tuple[Separable | None, tuple[Fraction, Fraction]]:
    """A box that shrinks without the inputs, and its starts: that of ``checks``, else the largest one that is found."""
    known = next((check for check in checks if check.id == "max-separable"), None)
    if known is not None and isinstance(known.claim, Separable) and isinstance(known.domain, Mapping):
        return known.claim, (claimed(known.domain["radius"]), claimed(known.domain["disturbance"]))
    asked = read_region(problem, W, domain=domain, everything=True)
    claim, radius = None, 0.0
    if known is None:
        with at_most(STAGE):
            claim, radius = largest_claim(asked)
    return claim, (claimed(radius), claimed(asked.disturbance))


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


def _proved(
    problem: Problem, W: Matrix | None, claim: Accuracy, starts: Domain, local: str = "global"
) -> Iterator[Check]:
    """The check of a claim with its bounds, if it is proved."""
    if claim.stages:
        last, labels = claim.stages[-1], problem.network.labels
        bounds = {x: rounded_up(last.level * v, digits=DIGITS) for x, v in zip(labels, last.v, strict=True)}
        whole = replace(claim, bounds=bounds)
        check = limited(ID, local, lambda: accuracy_check(problem, W, whole, domain=starts, local=local))
        if check.verdict is Verdict.PROVED:
            yield check
