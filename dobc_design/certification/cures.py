"""Cures: what would turn a refuted condition into a proof, cheapest first, and how that is said.

Gains and pins are proposed in floating point; here every proposal is put into the problem and the very conditions that
failed are decided again, exactly.  What is not proved then is not offered.  Nothing here changes a verdict.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

from dobc_design.conditions.check import Check, Fix
from dobc_design.conditions.consensus.claim import PairFacts, Statements, state_theorems
from dobc_design.conditions.consensus.cures import (
    PinProposal,
    groups_without_pin,
    on_present_pins,
    one_more,
    rounded_up,
    scale_needed,
    several_more,
)
from dobc_design.conditions.consensus.decide import enclosed_lambda
from dobc_design.conditions.consensus.network import Directions, carriers, is_negative, name_agents, unpinned_witness
from dobc_design.conditions.numbers import shorten
from dobc_design.conditions.observer.decide import detectability_check, hurwitz_check
from dobc_design.conditions.observer.propose import design_gain
from dobc_design.exact.matrix import Matrix, Vector, add, identity, scale
from dobc_design.exact.number import number_text
from dobc_design.exact.observability import decide_detectable
from dobc_design.problem.changes import changed_problem, gain_table, typed_matrix, typed_number
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

SHOWN = 4  # agents whose gains stand in a sentence
ENTRIES = 6  # of a direction that stand in a sentence
RIVALS = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class Accepted:
    """A proposal, and its rounded gains, which were proved to do."""

    proposal: PinProposal
    gains: dict[int, Fraction]

    @property
    def total(self) -> Fraction:
        """The sum of these gains (1/s)."""
        return sum(self.gains.values(), Fraction(0))


def pin_words(
    problem: Problem,
    accepted: Accepted,
    *,
    faster: Sequence[Accepted] = (),
    other: Accepted | None = None,
    held_back: tuple[str, Vector] | None = None,
    groups: Sequence[tuple[int, ...]] = (),
) -> str:
    """What to do, why that is the least, and what was considered besides.

    ``faster``: the same pins for a faster decay; ``other``: one more pin, though the present ones do;
    ``held_back``: a mode and a direction that show that no gains on the present pins can do;
    ``groups``: sets of agents each of which needs a pin.
    """
    parts = [_task(problem, accepted), *_because(problem, held_back, groups)]
    if accepted.proposal.rivals:
        parts.append(_rivals(problem, accepted.proposal))
    for each in faster:
        parts.append(f"For half of the fastest decay that pins there allow: {_gains(problem, each.gains)}.")
    if other is not None:
        new = name_agents(_labels(problem, other.proposal.added))
        total = f", in total {_short(other.total)}" if len(other.gains) > 1 else ""
        parts.append(
            f"Also possible, with a pin on {new}: {_gains(problem, other.gains)}{total}{_none(problem, other)}."
        )
    return " ".join(parts)


def _task(problem: Problem, accepted: Accepted) -> str:
    proposal, gains, pins = accepted.proposal, accepted.gains, problem.pinning.agents
    if proposal.added and set(gains) == set(proposal.added):
        as_well = " as well" if pins and proposal.keeps else ""
        head = f"Pin {name_agents(_labels(problem, proposal.added))}{as_well}, {_with(problem, gains)}"
    elif proposal.added:
        head = f"Pin {name_agents(_labels(problem, proposal.added))} as well, and use {_gains(problem, gains)}"
    else:
        head = f"Change the gain{'s' if len(pins) > 1 else ''} of the present pin{'s' if len(pins) > 1 else ''}:"
        head += f" {_gains(problem, gains)}"
    plural = len(gains) > 1
    total = f" (in total {_short(accepted.total)})" if plural else ""
    total += _none(problem, accepted)
    if proposal.smallest:
        return f"{head}{total}: the smallest gain{'s that do' if plural else ' that does'}, rounded up."
    return (
        f"{head}{total}. Smaller gains do as well; {'these give' if plural else 'this one gives'} about half of the"
        " fastest decay that pins there allow."
    )


def _none(problem: Problem, accepted: Accepted) -> str:
    """The pins that are no longer needed."""
    if accepted.proposal.keeps:
        return ""
    idle = [agent for agent in problem.pinning.agents if agent not in accepted.gains]
    return f", none for {name_agents(_labels(problem, idle))}" if idle else ""


def _with(problem: Problem, gains: Mapping[int, Fraction]) -> str:
    if len(set(gains.values())) == 1:
        return f"{'each ' if len(gains) > 1 else ''}with k = {_short(next(iter(gains.values())))}"
    return f"with {_gains(problem, gains)}"


def _because(problem: Problem, held_back: tuple[str, Vector] | None, groups: Sequence[tuple[int, ...]]) -> list[str]:
    parts = []
    if held_back is not None:
        mode, vector = held_back
        who = carriers(problem, vector)
        where = f" in mode {mode}" if len(problem.network.modes) > 1 else ""
        parts.append(
            f"No gains on the present pins can do: {name_agents(who)}, without a pin, carr{_y(who)} a direction that"
            f" they do not touch and along which V = e'e does not decrease{where}{_direction(problem, vector)}."
        )
    least = [group for group in groups if not any(set(other) < set(group) for other in groups)]
    if len(least) > 1:
        named = " and ".join(
            f"({', '.join(_labels(problem, group[:SHOWN]))}{', ...' if len(group) > SHOWN else ''})"
            for group in least[:RIVALS]
        )
        more = f" and {len(least) - RIVALS} more" if len(least) > RIVALS else ""
        where = "in one of the modes " if len(problem.network.modes) > 1 else ""
        parts.append(f"These groups listen {where}to nobody else, so each needs a pin of its own: {named}{more}.")
    return parts


def _y(labels: Sequence[str]) -> str:
    return "ies" if len(labels) == 1 else "y"


def _direction(problem: Problem, vector: Vector) -> str:
    moved = [x for x in vector if x]
    if problem.m > 1 or len(moved) > ENTRIES or len(set(moved)) == 1:
        return ""
    return f" (v = {', '.join(number_text(x) for x in moved)})"


def _rivals(problem: Problem, proposal: PinProposal) -> str:
    rivals = _labels(problem, proposal.rivals)
    if len(rivals) + 1 == problem.n - len(set(problem.pinning.agents)) and len(rivals) > 1:
        return "Any other agent would do as well."
    many = f"{len(rivals)} other agents" if len(rivals) > RIVALS else name_agents(rivals)
    return f"{many[0].upper()}{many[1:]} would do as well."


def _gains(problem: Problem, gains: Mapping[int, Fraction]) -> str:
    labels = problem.network.labels
    values = sorted(set(gains.values()))
    if len(values) == 1:
        who = "every agent" if len(gains) == problem.n > 1 else name_agents([labels[i] for i in gains])
        return f"k = {_short(values[0])} for {who}"
    if len(gains) > SHOWN:
        return f"gains from {_short(values[0])} to {_short(values[-1])} for {name_agents([labels[i] for i in gains])}"
    each = [f"k = {_short(k)} for agent {labels[i]}" for i, k in gains.items()]
    return f"{', '.join(each[:-1])} and {each[-1]}"


def _short(value: Fraction) -> str:
    return str(typed_number(value))


def _labels(problem: Problem, agents: Sequence[int]) -> tuple[str, ...]:
    return tuple(problem.network.labels[i] for i in agents)


def gain_change_words(rate: float | None, *, without_p: bool) -> str:
    """A designed W in place of the one given."""
    pace = f" at least like exp(-{shorten(rate, digits=4):.4g} t)" if rate else ""
    gone = " and drop P, which was meant for the old W" if without_p else ""
    return f"Use the observer gain W below{gone}: with it the estimation error decays{pace}."


def rate_words(asked: Fraction, rate: Fraction) -> str:
    """A rate of the observer that can be had in place of one that cannot."""
    return (
        f"Ask for observer.rate = {_short(rate)}: a part of the exosystem that C does not see decays more slowly than"
        f" the {_short(asked)} asked for, whatever W is."
    )


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
