"""Cures: what would turn a refuted condition into a proof, cheapest first.

``design`` proposes in floating point; here every proposal is put into the problem and the very conditions that failed
are decided again, exactly.  What is not proved then is not offered.  Nothing here changes a verdict.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

from dobc_design.certification.cure_words import Accepted, gain_change_words, pin_words, rate_words
from dobc_design.conditions.check import Check, Fix
from dobc_design.conditions.consensus.choice import groups_without_pin
from dobc_design.conditions.consensus.claim import PairFacts, Statements, state_theorems
from dobc_design.conditions.consensus.cures import (
    PinProposal,
    on_present_pins,
    one_more,
    rounded_up,
    scale_needed,
    several_more,
)
from dobc_design.conditions.consensus.decide import enclosed_lambda
from dobc_design.conditions.consensus.negative import is_negative
from dobc_design.conditions.consensus.witness import Directions, unpinned_witness
from dobc_design.conditions.observer.decide import detectability_check, hurwitz_check
from dobc_design.conditions.observer.gain import design_gain
from dobc_design.exact.matrix import Matrix, Vector, add, identity, scale
from dobc_design.exact.observability import decide_detectable
from dobc_design.problem.changes import changed_problem, gain_table, typed_matrix, typed_number
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

logger = logging.getLogger("dobc_design")
FACTORS = (1.0, 1.01, 1.1, 2.0)  # by which gains are raised until they are proved to do
LARGEST_LOOK = 60  # agents up to which one more pin is tried though the present ones do
CHEAPER = 0.8  # part of the total from which another pin is worth a word
BISECTIONS = 30

Decide = Callable[[Problem], Sequence[Check]]
Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Findings:
    """What the decision of a problem left behind: its conditions, the directions looked at, P if there is one."""

    statements: Statements
    directions: Mapping[str, Directions]
    P: Matrix | None


def with_cures(
    problem: Problem, checks: Sequence[Check], findings: Findings, *, decide: Decide, progress: Progress
) -> tuple[Check, ...]:
    """The checks, those that failed with a fix where one is found and proved.

    ``decide`` decides all checks of another problem, as those given were decided for this one.
    A numerical library that breaks down costs a cure, never a check.
    """
    if findings.statements.inapplicable is not None:
        return tuple(checks)
    found: dict[str, Fix] = {}
    # Cures of W and P name keys that all agents share; those of the network are the same for groups.
    for search in (_model_and_network,) if problem.is_grouped else (_model_and_network, _printed, _slower):
        try:
            found |= search(problem, checks, findings, decide, progress)
        except (ArithmeticError, RuntimeError, ValueError) as error:
            logger.warning("a search for cures failed: %s", error)
    return tuple(_cured(check, found) for check in checks)


def _cured(check: Check, found: Mapping[str, Fix]) -> Check:
    fix = found.get(check.id)
    wanted = check.verdict is Verdict.REFUTED or check.id in ("lemma1", "hurwitz")
    if check.verdict is Verdict.PROVED:
        wanted = fix is not None and fix.kind == "rate"
    return check if fix is None or not wanted else replace(check, fix=fix)


def _model_and_network(
    problem: Problem, checks: Sequence[Check], findings: Findings, decide: Decide, progress: Progress
) -> dict[str, Fix]:
    """Cures of the exosystem, of W and of the network, and all of them together for the theorem."""
    found: dict[str, Fix] = {}
    model = _merged(_model_parts(problem))
    if model is not None:
        found["hurwitz"] = model
    network = None
    if any(check.id == "lemma1" and check.verdict is not Verdict.PROVED for check in checks):
        progress("looking for a cure")
        network = _network_fix(problem, findings, progress)
        if network is not None:
            found |= {"reachability": network, "lemma1": network}
    both = _merged([fix for fix in (model, network) if fix is not None])
    theorem = next((check.id for check in checks if check.id in ("theorem1", "theorem2")), None)
    refuted = any(check.id == theorem and check.verdict is Verdict.REFUTED for check in checks)
    if both is not None and theorem is not None and refuted:
        progress("deciding the cured problem")
        cured = changed_problem(problem, both.set)
        if _holds(cured, decide(cured)):
            found[theorem] = both
    return found


def _holds(problem: Problem, checks: Sequence[Check]) -> bool:
    """Whether the theorem is proved; without an exosystem, Lemma 1 in every mode."""
    ids = ("theorem1", "theorem2") if problem.groups else ("lemma1",)
    own = [check.verdict for check in checks if check.id in ids]
    return bool(own) and all(verdict is Verdict.PROVED for verdict in own)


def _merged(fixes: Sequence[Fix]) -> Fix | None:
    """All changes in one, in order."""
    if len(fixes) < 2:
        return fixes[0] if fixes else None
    changes = {key: value for fix in fixes for key, value in fix.set.items()}
    kinds = dict.fromkeys(fix.kind for fix in fixes)
    kind = next(iter(kinds)) if len(kinds) == 1 else "several"
    return Fix(kind=kind, set=changes, text=" ".join(fix.text for fix in fixes))


# the exosystem and the gain W


def _model_parts(problem: Problem) -> list[Fix]:
    """What the exosystem and W need: the observable part in place of an undetectable pair, a W that decays."""
    parts: list[Fix] = []
    if problem.is_grouped or problem.exosystem is None:
        return parts
    reduction = detectability_check(problem.exosystem, problem).fix
    if reduction is not None:
        parts.append(reduction)
        problem = changed_problem(problem, reduction.set)
    exosystem, W = problem.exosystem, problem.observer.W
    if exosystem is None or W is None or hurwitz_check(exosystem, W).verdict is Verdict.PROVED:
        return parts
    return [*parts, *_other_gain(problem, exosystem)]


def _other_gain(problem: Problem, exosystem: Exosystem) -> Iterator[Fix]:
    """A designed W in place of the one given, proved to decay; a P goes, because it was meant for the old W."""
    W = design_gain(exosystem, rate=problem.observer.rate).W
    if W is None:
        return
    check = hurwitz_check(exosystem, W)
    if check.verdict is Verdict.PROVED:
        removal = {} if problem.observer.P is None else {"observer.P": None}
        changes: dict[str, Any] = {"observer.W": typed_matrix(W)} | removal
        yield Fix(kind="gain", set=changes, text=gain_change_words(check.rate, without_p=bool(removal)))


# the network


def _network_fix(problem: Problem, findings: Findings, progress: Progress) -> Fix | None:
    """The cheapest pins and gains that are proved to give Lambda < 0 in every mode."""
    present = list(_proved(problem, on_present_pins(problem)))
    if present:
        other = _cheaper_with_one_more(problem, present[0])
        return _pin_fix(problem, present[0], faster=present[1:], other=other)
    held_back = None
    if problem.pinning.agents:
        matrices = {mode: enclosed_lambda(findings.statements, mode) for mode in findings.statements.lambdas}
        held_back = unpinned_witness(problem, matrices, findings.directions)
    for search in (one_more, several_more):
        proved = _proved(problem, search(problem, progress=progress))
        accepted = next(proved, None)
        if accepted is None:
            continue
        faster = [
            each
            for each in [next(proved, None) if accepted.proposal.smallest else None]
            if each is not None and each.proposal.is_faster_than(accepted.proposal)
        ]
        groups = groups_without_pin(problem) if len(accepted.proposal.added) > 1 else []
        return _pin_fix(problem, accepted, faster=faster, held_back=held_back, groups=groups)
    return None


def _proved(problem: Problem, proposals: Iterable[PinProposal]) -> Iterator[Accepted]:
    """The proposals for which Lambda < 0 is proved in every mode, with the rounded gains that do."""
    for proposal in proposals:
        for factor in FACTORS:
            accepted = Accepted(proposal=proposal, gains=proposal.rounded(factor=factor))
            statements = state_theorems(changed_problem(problem, _gain_changes(problem, accepted)))
            if all(is_negative(enclosed_lambda(statements, mode)) for mode in statements.lambdas):
                yield accepted
                break


def _gain_changes(problem: Problem, accepted: Accepted) -> dict[str, Any]:
    gains, labels = accepted.gains, problem.network.labels
    if len(gains) == problem.n > 1 and len(set(gains.values())) == 1:
        return {"pinning.gains": typed_number(gains[0])}
    table = gain_table(problem.pinning.gains, labels) if accepted.proposal.keeps else {}
    table |= {labels[agent]: typed_number(gain) for agent, gain in gains.items()}
    return {"pinning.gains": {label: table[label] for label in labels if label in table}}


def _cheaper_with_one_more(problem: Problem, present: Accepted) -> Accepted | None:
    if problem.n > LARGEST_LOOK or len(problem.pinning.agents) == problem.n:
        return None
    found = next((each for each in _proved(problem, one_more(problem)) if not each.proposal.keeps), None)
    return found if found is not None and found.total < CHEAPER * present.total else None


def _pin_fix(
    problem: Problem,
    accepted: Accepted,
    *,
    faster: Sequence[Accepted] = (),
    other: Accepted | None = None,
    held_back: tuple[str, Vector] | None = None,
    groups: Sequence[tuple[int, ...]] = (),
) -> Fix:
    text = pin_words(problem, accepted, faster=faster, other=other, held_back=held_back, groups=groups)
    return Fix(kind="pinning", set=_gain_changes(problem, accepted), text=text)


# a printed P, and a rate


def _printed(
    problem: Problem, checks: Sequence[Check], findings: Findings, decide: Decide, progress: Progress
) -> dict[str, Fix]:
    """A printed P that fails by its scale, times the smallest factor that does; any other, the P that was found."""
    check = next((c for c in checks if c.id.endswith("-printed") and c.verdict is Verdict.REFUTED), None)
    own = problem.observer.P
    if check is None or own is None or not _holds(problem, checks):
        return {}
    progress("looking for a P")
    for fix in _other_pairs(problem, check, own, findings.P):
        cured = next(c for c in decide(changed_problem(problem, fix.set)) if c.id == check.id)
        if cured.verdict is Verdict.PROVED:
            return {check.id: fix}
    return {}


def _other_pairs(problem: Problem, check: Check, own: Matrix, found: Matrix | None) -> Iterator[Fix]:
    if isinstance(check.claim, PairFacts):
        factor = scale_needed(problem, check.claim.S)
        for more in FACTORS if factor is not None and factor > 0 else ():
            a = rounded_up(Fraction(factor or 1) * Fraction(more))
            yield Fix(
                kind="pair",
                set={"observer.P": typed_matrix(scale(a, own))},
                text=f"Multiply P by {typed_number(a)}: only its scale is wrong, and this is the smallest factor that"
                " does, rounded up.",
            )
    if found is not None:
        yield Fix(
            kind="pair",
            set={"observer.P": typed_matrix(found)},
            text="Use the P that was found for this W, for which the condition is proved.",
        )


def _slower(
    problem: Problem, checks: Sequence[Check], findings: Findings, decide: Decide, progress: Progress
) -> dict[str, Fix]:
    """The nearest rate of the observer that can be had, where the one asked for cannot."""
    asked, exosystem = problem.observer.rate, problem.exosystem
    if asked is None or exosystem is None or problem.observer.W is not None or _reaches(exosystem, asked):
        return {}
    if not any(check.id == "hurwitz" and check.verdict is Verdict.PROVED for check in checks):
        return {}
    low, high = Fraction(0), asked
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        low, high = (middle, high) if _reaches(exosystem, middle) else (low, middle)
    for part in (Fraction(99, 100), Fraction(9, 10), Fraction(1, 2)):
        rate = Fraction(f"{float(low * part):.2g}")
        if rate > 0 and (W := design_gain(exosystem, rate=rate).W) is not None:
            check = hurwitz_check(exosystem, W, estimate=float(rate) * (1 + 1e-9))
            if check.verdict is Verdict.PROVED and check.rate is not None:
                return {
                    "hurwitz": Fix(kind="rate", set={"observer.rate": typed_number(rate)}, text=rate_words(asked, rate))
                }
    return {}


def _reaches(exosystem: Exosystem, rate: Fraction) -> bool:
    shifted = add(exosystem.A, scale(rate, identity(exosystem.order)))
    return decide_detectable(shifted, exosystem.C).verdict is Verdict.PROVED
