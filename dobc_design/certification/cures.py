"""Cures: what would turn a refuted condition into a proof, cheapest first, and how that is said.

Every proposal is put into the problem and what failed is decided again, exactly; what is not proved
is not offered.
"""

import logging
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction

from dobc_design._checks import noun
from dobc_design._show.text import capitalize_first
from dobc_design.conditions.check import Check, Checks, Fix
from dobc_design.conditions.consensus import cures
from dobc_design.conditions.consensus.claim import Pair, PairFacts, Statements, state_theorems
from dobc_design.conditions.consensus.cures import PinProposal, rounded_up
from dobc_design.conditions.consensus.decide import enclosed_lambda
from dobc_design.conditions.consensus.network import (
    Directions,
    carriers,
    is_negative,
    name_agents,
    unpinned_witness,
)
from dobc_design.conditions.coverage import Progress
from dobc_design.conditions.kinds import REACHABILITY
from dobc_design.conditions.numbers import claimed, text_below
from dobc_design.conditions.observer.decide import detectability_check, hurwitz_check, too_large
from dobc_design.conditions.observer.propose import GainDesign, design_gain
from dobc_design.conditions.schedule.cycles import cycles_of
from dobc_design.conditions.weighted.decide import network_holds, why_not
from dobc_design.conditions.weighted.propose import network_claim
from dobc_design.conditions.weighted.stage import weighted_stage
from dobc_design.exact.matrix import Matrix, Vector, scale
from dobc_design.exact.number import typed_number
from dobc_design.exact.reading import Document, Texts
from dobc_design.exact.work import STAGE, WorkLimitError, at_most, spend
from dobc_design.loop.arcs import closed_groups, tied, unreached
from dobc_design.loop.loop import Loop
from dobc_design.loop.make import loop_of
from dobc_design.problem.changes import changed_problem, gain_table, mode_table, typed_matrix
from dobc_design.problem.network import labels_of
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

Fixes = dict[str, Fix]  # by the id of the check that is cured

logger = logging.getLogger("dobc_design")

SHOWN = 4  # agents whose gains stand in a sentence
RIVALS = 5
FACTORS = (1.0, 1.01, 1.1, 2.0)  # by which gains are raised until they are proved to do
CURE = 100  # steps of work for a proposal, besides what its decision spends
WORK = 5  # stages' work for a search
LARGEST_LOOK = 60  # agents up to which one more pin is tried though the present ones do
MOST_ARCS = 2000  # of a network whose missing arcs are named,
MOST_PHASES = 40  # and phases of a guarantee, of which cycles are examined
LARGE = 3000  # agents from which a cured problem is not decided as a whole
CHEAPER = 0.8  # part of the total from which another pin is worth a word


@noun
class Decided:
    """The checks of one problem and what they are about: W, how it was designed, the pair,
    directions by mode."""

    checks: tuple[Check, ...]
    statements: Statements
    directions: Mapping[str, Directions]
    designs: tuple[GainDesign | None, ...] = ()  # one per group of agents, None where W is given
    W: Matrix | None = None
    pair: Pair | None = None
    how: str = ""  # the pair came about, where not the usual way


@noun
class Accepted:
    """A proposal, and its rounded gains, which were proved to do."""

    proposal: PinProposal
    gains: dict[int, Fraction]

    @property
    def total(self) -> Fraction:
        """The sum of these gains (1/s)."""
        return sum(self.gains.values(), Fraction(0))


def with_cures(
    problem: Problem, found: Decided, *, decide: Callable[[Problem], Decided], progress: Progress
) -> tuple[Check, ...]:
    """The checks, failed ones with a fix where one is proved: ``decide`` decides another
    problem."""
    if found.statements.inapplicable is not None:
        return found.checks
    cures = _Cures(problem=problem, found=found, decide=decide, progress=progress)
    searches = [cures.of_model_and_network]
    # Cures of W and P name keys that all agents share; those of the network are the same for
    # groups.
    if not problem.is_grouped:
        searches.append(cures.of_printed)
    fixes: Fixes = {}
    for search in searches:
        try:
            with at_most(WORK * STAGE):
                fixes |= search()
        except (ArithmeticError, RuntimeError, ValueError, WorkLimitError) as error:
            logger.warning("a search for cures failed: %s", error)
    checks: list[Check] = []
    for check in found.checks:
        fix = fixes.get(check.id)
        may_be_open = check.kind.is_lemma or check.id == "hurwitz"
        wanted = may_be_open and check.verdict is Verdict.UNDECIDED
        cured = fix is not None and (wanted or check.verdict is Verdict.REFUTED)
        checks.append(replace(check, fix=fix) if cured else check)
    return tuple(checks)


def with_arcs(problem: Problem, checks: Checks) -> tuple[Check, ...]:
    """The checks of agents that are to agree: where nobody is heard by all others, with the arcs
    that change it, in every mode that lacks them."""
    fix = missing_arcs(problem)
    if fix is None:
        return tuple(checks)
    refuted = [each.id == REACHABILITY and each.verdict is Verdict.REFUTED for each in checks]
    found = zip(checks, refuted, strict=True)
    return tuple(replace(check, fix=fix) if cured else check for check, cured in found)


def missing_arcs(problem: Problem) -> Fix | None:
    """Arcs by which somebody is heard by all others in every mode, or in those that are on in turn:
    one for each closed group but one, the least for one mode.  None where none is needed, arcs are
    optional, or there are too many."""
    loop = loop_of(problem)
    count = loop.arc_count
    # Optional arcs stand in a list of their own, which may not be rewritten.
    if count > MOST_ARCS or any(arcs.optional for arcs in loop.modes.values()):
        return None
    labels: Sequence[str | int] = loop.labels
    if loop.labels == labels_of(loop.n):  # as they were typed
        labels = range(1, loop.n + 1)
    modes = mode_table(problem.network, labels)
    changes: Document = {"network.arrow": "listens_to", "network.modes": modes}
    cycles: list[Texts] = [(mode,) for mode in loop.modes]
    if 0 < len(loop.guarantee.phases) <= MOST_PHASES:
        cycles = cycles_of(loop.guarantee.phases)
    added: dict[str, None] = {}
    for cycle in cycles:
        # By its arc, each closed group but the first listens to that one.
        first, *others = closed_groups(loop, [loop.modes[mode] for mode in cycle])
        for group in others:
            modes[cycle[0]].append([labels[group[0]], labels[first[0]]])
            added[f"agent {labels[group[0]]} listen to agent {labels[first[0]]}"] = None
        if others:
            loop = loop_of(changed_problem(problem, changes))
    if not added or any(
        len(closed_groups(loop, [loop.modes[mode] for mode in cycle])) > 1 for cycle in cycles
    ):
        return None
    told = list(added)
    more = f" and {len(told) - SHOWN} more arcs" if len(told) > SHOWN else ""
    where = ""
    if len(loop.modes) > 1:
        where = " in every mode" if len(cycles[0]) == 1 else " while the modes take turns"
    text = f"Let {', '.join(told[:SHOWN])}{more}: then somebody is heard by all others{where}."
    return Fix(kind="arcs", set=changes, text=text)


@noun
class _Cures:
    """The search for what cures one problem, of which ``found`` is known."""

    problem: Problem
    found: Decided
    decide: Callable[[Problem], Decided]
    progress: Progress

    def of_model_and_network(self) -> Fixes:
        """Of the exosystem, of W and of the network, and all of them together for the theorem."""
        problem = self.problem
        checks = self.found.checks
        fixes: Fixes = {}
        model = _merged(_model_parts(problem))
        if model is not None:
            fixes["hurwitz"] = model
        network = None
        # Weights of V hold many networks that V = e'e does not; then no pin is missing.
        failed = any(each.kind.is_lemma and not each.is_proved for each in checks)
        lacking = failed and not _has_weights(checks)
        if lacking and not _held_with_weights(problem, self.found.statements):
            self.progress("looking for a cure")
            network = self._of_network()
            if network is not None:
                fixes |= {"reachability": network, "lemma1": network}
        # The theorem needs the model and the network; each alone may leave it open.
        both = _merged([fix for fix in (model, network) if fix is not None])
        theorem = next((check for check in checks if check.kind.is_theorem), None)
        if both is not None and theorem is not None and theorem.verdict is Verdict.REFUTED:
            self.progress("deciding the cured problem")
            cured = changed_problem(problem, both.set)
            if _weights_do(cured) or _holds(cured, self.decide(cured).checks):
                fixes[theorem.id] = both
        return fixes

    def _of_network(self) -> Fix | None:
        """The cheapest pins and gains proved to hold the network: with weights of V for one mode,
        else with Lambda < 0."""
        problem = self.problem
        loop = loop_of(problem)
        # Other gains cost less than another agent that has to know the target.
        present = list(_proved(problem, cures.on_present_pins(loop)))
        if present:
            other = None
            if problem.n <= LARGEST_LOOK and len(problem.pinning.agents) < problem.n:
                more = _proved(problem, cures.one_more(loop))
                other = next((each for each in more if not each.proposal.keeps), None)
            if other is not None and other.total >= CHEAPER * present[0].total:
                other = None
            return _pin_fix(problem, present[0], faster=present[1:], other=other)
        held_back = self._held_back(loop)
        # Fewer new pins first.
        for search in (cures.one_more, cures.several_more):
            proved = _proved(problem, search(loop, progress=self.progress))
            accepted = next(proved, None)
            if accepted is None:
                continue
            # After the smallest gains may come recommended ones, on the same agents.
            faster = []
            if accepted.proposal.smallest:
                after = next(proved, None)
                if after is not None and not after.proposal.smallest:
                    same = after.proposal.added == accepted.proposal.added
                    if same and after.proposal.keeps == accepted.proposal.keeps:
                        faster.append(after)
            several = len(accepted.proposal.added) > 1
            groups = cures.groups_without_pin(loop) if several else []
            return _pin_fix(problem, accepted, faster=faster, held_back=held_back, groups=groups)
        return None

    def _held_back(self, loop: Loop) -> tuple[str, Vector] | None:
        """A mode and a direction there that no gain on the present pins changes."""
        if not self.problem.pinning.agents:
            return None
        statements = self.found.statements
        apart = {agent for group in cures.groups_without_pin(loop) for agent in group}
        # With weights of V in one mode, only agents that no pin reaches can hold it back.
        if apart and why_not(statements) is None and len(loop.modes) == 1:
            rows = tuple(Fraction(row // loop.m in apart) for row in range(loop.size))
            return next(iter(loop.modes)), rows
        matrices = {mode: enclosed_lambda(statements, mode) for mode in statements.lambdas}
        return unpinned_witness(loop, matrices, self.found.directions)

    def of_printed(self) -> Fixes:
        """A printed P that fails by its scale, times the smallest factor that does; any other, the
        P that was found."""
        problem, checks = self.problem, self.found.checks
        given = (check for check in checks if check.kind.role == "given")
        check = next((check for check in given if check.verdict is Verdict.REFUTED), None)
        own = problem.observer.P
        if check is None or own is None or not _holds(problem, checks):
            return {}
        self.progress("looking for a P")
        tries: list[tuple[Matrix, str]] = []
        if isinstance(check.claim, PairFacts):
            factor = cures.scale_needed(loop_of(problem), check.claim.S)
            for more in FACTORS if factor else ():
                a = rounded_up(Fraction(factor or 1) * Fraction(more))
                why = "only its scale is wrong, and this is the smallest sufficient factor"
                tries.append((scale(a, own), f"Multiply P by {_short(a)}: {why}, rounded up."))
        if self.found.pair is not None:
            text = "Use the P that was found for this W, for which the condition is proved."
            tries.append((self.found.pair.P, text))
        for P, text in tries:
            fix = Fix(kind="pair", set={"observer.P": typed_matrix(P)}, text=text)
            decided = self.decide(changed_problem(problem, fix.set)).checks
            cured = next(each for each in decided if each.id == check.id)
            if cured.is_proved:
                return {check.id: fix}
        return {}


def _weights_do(problem: Problem) -> bool:
    """Whether the theorem is proved with weights, asked of large networks: the other checks of it
    are not needed."""
    W = problem.joint_observer.W if problem.groups else None
    if problem.n <= LARGE or (problem.groups and W is None):
        return False
    return _has_weights(weighted_stage(state_theorems(loop_of(problem)), W))


def _holds(problem: Problem, checks: Checks) -> bool:
    """Whether the theorem is proved, with weights or without; without an exosystem, Lemma 1 in
    every mode."""
    if _has_weights(checks):
        return True
    needed = [
        check
        for check in checks
        if (check.kind.is_theorem if problem.groups else check.kind.is_lemma)
    ]
    return {check.verdict for check in needed} == {Verdict.PROVED}


def _has_weights(checks: Iterable[Check]) -> bool:
    proved = (check for check in checks if check.is_proved)
    return any(check.kind.topic == "weighted" for check in proved)


def _held_with_weights(problem: Problem, statements: Statements, *, rate: float = 0.0) -> bool:
    """Whether weights of V are proved to do for the network alone: then no pin and no gain is
    missing."""
    loop = loop_of(problem)
    if why_not(statements) is not None or any(
        unreached(loop, [arcs]) for arcs in loop.modes.values()
    ):
        return False
    claim = network_claim(loop, rate)
    return claim is not None and network_holds(claim, statements, rate=claimed(rate))


def _merged(fixes: Sequence[Fix]) -> Fix | None:
    """All changes in one, in order."""
    if len(fixes) < 2:
        return fixes[0] if fixes else None
    changes = {key: value for fix in fixes for key, value in fix.set.items()}
    kinds = {fix.kind for fix in fixes}
    return Fix(
        kind=kinds.pop() if len(kinds) == 1 else "several",
        set=changes,
        text=" ".join(fix.text for fix in fixes),
    )


def _model_parts(problem: Problem) -> list[Fix]:
    """What the exosystem and W need: the observable part of an undetectable pair; a W that decays,
    with its P."""
    parts: list[Fix] = []
    if problem.is_grouped or problem.exosystem is None or too_large(problem.exosystem) is not None:
        return parts
    # States that d never shows can be left out of the model.
    reduction = detectability_check(problem.exosystem, loop_of(problem)).fix
    if reduction is not None:
        parts.append(reduction)
        problem = changed_problem(problem, reduction.set)
    exosystem, observer = problem.exosystem, problem.observer
    if exosystem is None or observer.W is None:
        return parts
    if hurwitz_check(exosystem, observer.W).is_proved:
        return parts
    W = design_gain(exosystem, rate=observer.rate).W
    check = None if W is None else hurwitz_check(exosystem, W)
    if W is None or check is None or not check.is_proved:
        return parts
    pace = f" at least like exp(-{text_below(check.rate)} t)" if check.rate else ""
    changes: Document = {"observer.W": typed_matrix(W)}
    gone = ""
    if observer.P is not None:
        gone = " and drop P, which was meant for the old W"
        changes["observer.P"] = None
    text = f"Use the observer gain W below{gone}: with it the estimation error decays{pace}."
    return [*parts, Fix(kind="gain", set=changes, text=text)]


def _proved(problem: Problem, proposals: Iterable[PinProposal]) -> Iterator[Accepted]:
    """The proposals for which Lambda < 0 is proved in every mode, or weights of V, with the rounded
    gains that do."""
    # An agent has a gain in every mode, or gains of single modes: those are kept.
    taken = tied(loop_of(problem))
    for proposal in proposals:
        if taken & set(proposal.rounded()):
            continue
        # A gain at the boundary may be rounded to the wrong side of it.
        for factor in FACTORS:
            spend(CURE)
            accepted = Accepted(proposal=proposal, gains=proposal.rounded(factor=factor))
            cured = changed_problem(problem, _gain_changes(problem, accepted))
            statements = state_theorems(loop_of(cured))
            # A rate is that of a V with weights, which Lambda < 0 says nothing about.
            plain = not proposal.rate and all(
                is_negative(enclosed_lambda(statements, mode)) for mode in statements.lambdas
            )
            if plain or _held_with_weights(cured, statements, rate=proposal.rate):
                yield accepted
                break


def _gain_changes(problem: Problem, accepted: Accepted) -> Document:
    gains, labels = accepted.gains, problem.network.labels
    # One number stands for all agents in the file.
    if len(gains) == problem.n > 1 and len(set(gains.values())) == 1:
        return {"pinning.gains": typed_number(gains[0])}
    table = gain_table(problem.pinning.gains, labels) if accepted.proposal.keeps else {}
    table |= {labels[agent]: typed_number(gain) for agent, gain in gains.items()}
    return {"pinning.gains": {label: table[label] for label in labels if label in table}}


def _pin_fix(
    problem: Problem,
    accepted: Accepted,
    *,
    faster: Sequence[Accepted],
    other: Accepted | None = None,
    held_back: tuple[str, Vector] | None = None,
    groups: Sequence[tuple[int, ...]] = (),
) -> Fix:
    """What to do and what was considered: ``accepted`` are the smallest gains, ``faster`` those
    that are recommended on the same agents; ``other``, one more pin though the present ones do; a
    direction that ``held_back`` all gains there; ``groups`` each of which needs a pin."""
    chosen = faster[0] if faster else accepted
    parts = [_task(problem, chosen, minimum=accepted if faster else None)]
    if held_back is not None:
        # Why gains on the present pins do not do.
        mode, vector = held_back
        who = name_agents(carriers(loop_of(problem), vector))
        pins = name_agents(_labels(problem, problem.pinning.agents))
        where = f" in mode {mode}" if len(problem.network.modes) > 1 else ""
        none = f"No gain on {pins} can help"
        parts.append(f"{none}: the error of {who} would not decrease{where}.")
    # Within one mode no group holds another one.
    if len(problem.network.modes) > 1:
        groups = [each for each in groups if not any(set(other) < set(each) for other in groups)]
    if len(groups) > 1:
        parts.append(_groups_words(problem, groups))
    rivals = _labels(problem, accepted.proposal.rivals)
    if len(rivals) > 1 and len(rivals) + 1 == problem.n - len(set(problem.pinning.agents)):
        parts.append("Any other agent would do as well.")
    elif rivals:
        many = f"{len(rivals)} other agents" if len(rivals) > RIVALS else name_agents(rivals)
        parts.append(f"{capitalize_first(many)} would do as well.")
    if other is not None:
        new = name_agents(_labels(problem, other.proposal.added))
        total = f", in total {_short(other.total)}" if len(other.gains) > 1 else ""
        parts.append(
            f"Also possible, with a pin on {new}: "
            f"{_gains(problem, other.gains)}{total}{_none(problem, other)}."
        )
    return Fix(kind="pinning", set=_gain_changes(problem, chosen), text=" ".join(parts))


def _groups_words(problem: Problem, groups: Sequence[tuple[int, ...]]) -> str:
    """That each of these groups needs a pin."""
    named = []
    for group in groups[:RIVALS]:
        labels = ", ".join(_labels(problem, group[:SHOWN]))
        named.append(f"({labels}, ...)" if len(group) > SHOWN else f"({labels})")
    more = f" and {len(groups) - RIVALS} more" if len(groups) > RIVALS else ""
    where = "in one of the modes " if len(problem.network.modes) > 1 else ""
    return (
        f"These groups listen {where}to nobody else, so each needs a pin: "
        f"{' and '.join(named)}{more}."
    )


def _task(problem: Problem, accepted: Accepted, *, minimum: Accepted | None) -> str:
    """What to do; ``minimum``: the smallest gains on the same agents, where these are the
    recommended ones."""
    proposal, gains, pins = accepted.proposal, accepted.gains, problem.pinning.agents
    plural = len(gains) > 1
    new = name_agents(_labels(problem, proposal.added)) if proposal.added else ""
    if new and set(gains) == set(proposal.added):
        as_well = " as well" if pins and proposal.keeps else ""
        how = f"with {_gains(problem, gains)}"
        if len(set(gains.values())) == 1:
            each = "each " if plural else ""
            how = f"{each}with k = {_short(next(iter(gains.values())))}"
        head = f"Pin {new}{as_well}, {how}"
    elif new:
        head = f"Pin {new} as well, and use {_gains(problem, gains)}"
    else:
        s = "s" if len(pins) > 1 else ""
        head = f"Change the gain{s} of the present pin{s}: {_gains(problem, gains)}"
    if plural:
        head += f" (in total {_short(accepted.total)})"
    head += _none(problem, accepted)
    if proposal.rate:
        aim = (
            f"a decay rate of at least {proposal.rate:.2g} 1/s near the target (V = e'De, a "
            "weight for each agent)"
        )
        return f"{head}, for {aim}. Smaller gains give consensus, too."
    if minimum is not None:
        least = f"Minimum with V = e'e: {_gains(problem, minimum.gains)}"
        return f"{head}. Recommended: half of the maximum decay rate. {least}."
    if proposal.smallest:
        return f"{head}. Minimum with V = e'e: smaller gains do not suffice."
    return f"{head}. Recommended: half of the maximum decay rate. Smaller gains do as well."


def _none(problem: Problem, accepted: Accepted) -> str:
    """The pins that are no longer needed."""
    idle = [agent for agent in problem.pinning.agents if agent not in accepted.gains]
    if not idle or accepted.proposal.keeps:
        return ""
    return f", none for {name_agents(_labels(problem, idle))}"


def _gains(problem: Problem, gains: Mapping[int, Fraction]) -> str:
    labels = _labels(problem, gains)
    values = sorted(set(gains.values()))
    if len(values) == 1:
        who = "every agent" if len(gains) == problem.n > 1 else name_agents(labels)
        return f"k = {_short(values[0])} for {who}"
    if len(gains) > SHOWN:
        return f"gains from {_short(values[0])} to {_short(values[-1])} for {name_agents(labels)}"
    each = []
    for label, k in zip(labels, gains.values(), strict=True):
        each.append(f"k = {_short(k)} for agent {label}")
    return f"{', '.join(each[:-1])} and {each[-1]}"


def _short(value: Fraction) -> str:
    return str(typed_number(value))


def _labels(problem: Problem, agents: Iterable[int]) -> Texts:
    return tuple(problem.network.labels[i] for i in agents)
