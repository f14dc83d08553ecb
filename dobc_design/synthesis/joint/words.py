"""What a design decided, why, and what each limit costs, in sentences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction

from dobc_design.conditions.consensus.network import name_agents
from dobc_design.exact.reading import counted
from dobc_design.problem.changes import typed_number, value_text
from dobc_design.problem.problem import Problem
from dobc_design.synthesis.observer.design import ObserverDesign
from dobc_design.synthesis.pinning.region_gains import RegionGains
from dobc_design.synthesis.pinning.structure import Structure

SHOWN = 6  # gains in a sentence
BUYS = 3  # agents in the sentence on what a further pin buys


def observer_words(found: ObserverDesign) -> list[str]:
    """W, how fast its error decays, how it came about; a sentence for every group of agents."""
    if not found.groups:
        return [f"Observer: {_gain_words(found)}"]
    return [f"Observer of the group of agent {name}: {_gain_words(each)}" for name, each in found.groups.items()]


def _gain_words(found: ObserverDesign) -> str:
    rows = value_text([[typed_number(x) for x in row] for row in found.W or ()])
    rate, gain = found.measures.get("rate"), found.measures.get("gain")
    noise = found.measures.get("hinf measurement")
    pace = f"the error of the estimate decays at {rate:.4g} 1/s" if rate else "the error of the estimate decays"
    loud = f", noise on the measured x reaches dhat with a gain of at most {noise:.4g} 1/s" if noise else ""
    size = f" |W| = {gain:.4g}." if gain else ""
    return f"W = {rows} ({found.source}): {pace}{loud}.{size}"


def pins_words(problem: Problem, structure: Structure, pinned: Sequence[int], *, fixed: bool) -> str:
    """Which agents are pinned, and why so many."""
    labels = problem.network.labels
    who = name_agents([labels[i] for i in pinned])
    single = len(structure.groups) == 1 and len(structure.groups[0]) == problem.n
    if len(pinned) == structure.least:
        if single:
            why = "one pin has to be: moved together, unpinned agents stay moved. No more were needed"
        elif len(structure.groups) == 1:
            group = [labels[i] for i in structure.groups[0]]
            hears = "listens" if len(group) == 1 else "listen"
            why = f"{name_agents(group)} {hears} to nobody outside, so there has to be a pin"
        else:
            why = f"{len(structure.groups)} groups listen to nobody outside, so fewer pins cannot do"
    elif fixed:
        why = "as many as were allowed"
    else:
        least = f"{structure.least} {'is' if structure.least == 1 else 'are'} the least that the arcs allow"
        why = f"{least}, but with fewer than {len(pinned)} very large gains or no proof were left"
    return f"Pinned: {who}; {why}."


def gains_words(problem: Problem, gains: Mapping[int, Fraction], *, digits: int, part: Fraction | None) -> str:
    """The gains, rounded up, and what they are for."""
    labels = problem.network.labels
    shown = list(gains.items())[:SHOWN]
    each = ", ".join(f"k = {typed_number(k)} for agent {labels[i]}" for i, k in shown)
    more = f" and {len(gains) - len(shown)} more" if len(gains) > len(shown) else ""
    total = f", in total {typed_number(sum(gains.values(), Fraction(0)))}" if len(gains) > 1 else ""
    aim = ""
    if part is not None:
        aim = f" They are meant for {float(part):.0%} of the fastest rate that pins there allow."
    return f"Gains: {each}{more}{total} (1/s), rounded up to {counted(digits, 'digit')}.{aim}"


def price_words(
    problem: Problem, found: RegionGains, allowed: Sequence[int], caps: Mapping[int, Fraction]
) -> list[str]:
    """The multipliers of a design over a region: what more rate costs, and where a further pin buys most."""
    labels, total = problem.network.labels, found.total
    if not total or not found.rate:
        return []
    share = found.rate_price * found.rate / total
    words = [f"Price of the rate: near {found.rate:.4g} 1/s, each 1 % more takes about {share:.3g} % more gain."]
    capped = [i for i in found.gains if i in caps and found.gains[i] >= 0.999 * float(caps[i])]
    if capped:
        words.append(
            f"Price of the caps: {name_agents([labels[i] for i in capped])} stand"
            f"{'s' if len(capped) == 1 else ''} at the largest gain allowed."
        )
    others = [i for i in range(problem.n) if i not in found.gains]
    best = sorted(others, key=lambda i: (-round(float(found.prices[i]), 6), i))[:BUYS]
    if best and found.prices[best[0]] > 1:
        named = ", ".join(f"agent {labels[i]} {found.prices[i]:.3g}" for i in best if found.prices[i] > 1)
        kept = "" if best[0] in set(allowed) else f" (pins there are not allowed on agent {labels[best[0]]})"
        words.append(
            f"Price of so few pins: agent {labels[best[0]]} would buy most. Each 1/s of gain there would save"
            f" about so much elsewhere: {named}{kept}."
        )
    elif others:
        words.append("Price of so few pins: none; a gain on any other agent would cost more than it saves.")
    return words
