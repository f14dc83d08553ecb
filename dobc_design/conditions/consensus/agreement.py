"""Networks without pins: whether the agents agree with each other, though nothing pulls them to a
target.  In words.

Agents whose couplings attract agree near the consensus iff in every mode somebody is heard by all
others, directly or through others (a root of the graph), and the estimation errors decay.
"""

from collections.abc import Sequence

from dobc_design.exact.matrix import multiply, subtract
from dobc_design.exact.observability import decide_detectable
from dobc_design.exact.polynomial import decide_hurwitz
from dobc_design.loop.arcs import closed_groups
from dobc_design.loop.loop import Loop
from dobc_design.problem.groups import Group, name_some
from dobc_design.problem.network import Arcs

from .network import apart_in_words


def agreement_words(loop: Loop) -> str:
    """What agents of which none is pinned do among themselves, in a sentence; "" where it is not
    known here."""
    if loop.is_pulled or loop.drift is not None or loop.n == 1 or loop.signed:
        return ""
    labels = loop.labels
    modes = loop.modes
    apart = closed_groups(loop, modes.values())
    if len(apart) > 1:
        first, second = (name_some([labels[i] for i in group]) for group in apart[:2])
        return (
            f"Nor need they agree with each other: no arc lets {first} hear anybody else, and none "
            f"lets {second}."
        )
    roots = []  # of each mode, if there are any: agents that hear nobody outside of themselves
    for arcs in modes.values():
        groups = closed_groups(loop, [arcs.present])
        if len(groups) == 1:
            roots.append(set(groups[0]))
    if len(roots) < len(modes):
        return ""  # it depends on how the modes follow each other
    if loop.uncertainty is not None or loop.actuators is not None:
        return ""  # what they leave of it is not decided here
    if not _attract(loop) or not all(map(_estimates_decay, loop.groups)):
        return ""
    # One agent that leads in every mode can be named.
    common = set.intersection(*roots)
    heard = "every mode has an agent that is heard by all others"
    if common:
        heard = f"agent {labels[min(common)]} is heard by all others"
    # Slopes at 0 say nothing of far starts unless the couplings are linear.
    start = "" if loop.is_linear else ", from close enough starts"
    return (
        f"The agents do agree with each other{start}, because {heard}, directly or through others; "
        "but on a value that nobody prescribes."
    )


def roots_words(loop: Loop, arcs: Sequence[Arcs]) -> str:
    """Who is heard by all others in these arcs together, as a sentence."""
    groups = closed_groups(loop, arcs)
    if len(groups) > 1:
        return f"NO AGREEMENT here: {apart_in_words(loop, arcs)}"
    roots = name_some([loop.labels[i] for i in groups[0]])
    by = " by arcs that are always there," if any(each.optional for each in arcs) else ""
    return f"Heard by all others,{by} directly or through others: {roots}."


def _attract(loop: Loop) -> bool:
    """Whether every coupling acts by component and rises at 0."""
    for each in loop.functions:
        slopes = [row[k] for k, row in enumerate(each.jacobian_at_zero())]
        if not each.by_component or any(slope.lo <= 0 for slope in slopes):
            return False
    return True


def _estimates_decay(group: Group) -> bool:
    """Whether A - W C is Hurwitz for the W that is given, or can be made so."""
    A = group.exosystem.A
    C = group.exosystem.C
    W = group.observer.W
    if W is None:
        return decide_detectable(A, C).is_proved
    if len(W[0]) != len(C):
        return False
    return decide_hurwitz(subtract(A, multiply(W, C))).is_proved
