"""Cures in plain words: which gain for which agent, why these, and what else was considered."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

from dobc_design.conditions.consensus.cures import PinProposal
from dobc_design.conditions.consensus.network import name_agents
from dobc_design.conditions.consensus.witness import carriers
from dobc_design.conditions.numbers import shorten
from dobc_design.exact.matrix import Vector
from dobc_design.exact.number import number_text
from dobc_design.problem.changes import typed_number
from dobc_design.problem.problem import Problem

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
