"""What rows are about where agents agree on a value that nobody prescribes.

In general that is the loop of pairs (theory, section 16).  Its nodes are the ordered pairs (i, j)
of agents, with the error x_i - x_j:

    (x_i - x_j)' = sum_l w_il h_il(x_l - x_i) - sum_l w_jl h_jl(x_l - x_j) + C eps_i - C eps_j

Pair (i, j) hears (l, j) by h_il where i hears l, and (i, l) by h*(y) = -h_jl(-y) where j hears l.
A pair (j, j) is a fixed node: its error is 0.  The upper row of (i, j) bounds x_i - x_j; its lower
row is the upper one of (j, i).

Where an agent hears nobody, in no mode, it is the target of all others: n - 1 rows do.

C eps_i - C eps_j is at most twice the largest |C eps_i|, so that an exosystem has the output 2 C
here, and a gain W counts as W/2: A - W C is the same.  What linear dynamics do, A x_i, they do to
differences as well; offsets of a formation are taken off the states.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import lru_cache
from types import MappingProxyType
from typing import Any

import numpy as np

from dobc_design._checks import noun
from dobc_design.coupling.coupling import Coupling, make_coupling
from dobc_design.coupling.expression import LONGEST_MADE
from dobc_design.exact.matrix import Matrix, scale
from dobc_design.exact.number import common_denominator
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.groups import Group
from dobc_design.problem.network import Arc, Arcs, IndexArray, sized

from .arcs import coupling_places
from .loop import Loop, Pair, pins_of, zero_goals
from .saturation import saturated

#: Largest |C eps_i - C eps_j|, in parts of the largest |C eps_i|.
RESIDUALS = Fraction(2)
#: Two fixed nodes: what the first agent of a pair hears of the second, and the other way round.
FIXED = ("same", "same 2")
MOST_AGENTS = 300  # of which pairs are looked at


def rows_of(loop: Loop, W: Matrix | None) -> Loop | None:
    """The loop whose errors rows bound: this one, without its signs, that of disagreements, or that
    with what saturation leaves of the pins, with the observer gain W (q, m); None where that is not
    known.  Of more than MOST_AGENTS, with the goal "roots", only the graphs are looked at."""
    if loop.saturates:
        return saturated(loop, W)
    return _made_once(loop) if loop.agrees or loop.signed else loop


@lru_cache(maxsize=16)
def _made_once(loop: Loop) -> Loop:
    if loop.signed:
        # sigma e_j lies in the same interval as e_j, whatever the sign.
        plain = {name: sized(arcs) for name, arcs in loop.modes.items()}
        return replace(loop, modes=plain, signs=loop.modes)
    leader = silent_agent(loop)
    if leader is not None:
        return _led_by(loop, leader)
    if loop.n > MOST_AGENTS:
        return replace(_of_disagreements(loop, loop.n), goal="roots")
    return pairs_of(loop)


def required_rows(loop: Loop, W: Matrix | None) -> Loop:
    """The same.  Raises: ValueError where there are too many pairs."""
    rows = rows_of(loop, W)
    if rows is None:
        raise ValueError(f"{loop.n} agents have more pairs than are looked at")
    return rows


def are_pairs(loop: Loop) -> bool:
    """Whether its nodes are pairs of agents."""
    return loop.goal == "differences" and len(loop.fixed) > 1


def gain_of_rows(loop: Loop, W: Matrix | None) -> Matrix | None:
    """The observer gain as it counts in these rows."""
    return scale(1 / RESIDUALS, W) if loop.agrees and W is not None else W


def silent_agent(loop: Loop) -> int | None:
    """The only agent that hears nobody in any mode; None if there is none, or several."""
    hears = np.zeros(loop.n, dtype=bool)
    for arcs in loop.modes.values():
        hears[arcs.listeners] = True
    silent = np.flatnonzero(~hears).tolist()
    return silent[0] if len(silent) == 1 else None


def _led_by(loop: Loop, leader: int) -> Loop:
    """The loop of all other agents, whose target is this one."""
    order = np.arange(loop.n)
    order[leader] = loop.n - 1
    order[leader + 1 :] -= 1
    modes = {}
    for name, arcs in loop.modes.items():
        modes[name] = replace(arcs, listeners=order[arcs.listeners], speakers=order[arcs.speakers])
    exceptions = {
        (int(order[i]), int(order[j])): place for (i, j), place in loop.exceptions.items()
    }
    return replace(
        _of_disagreements(loop, loop.n - 1),
        labels=_without(loop.labels, leader),
        fixed=(loop.labels[leader],),
        modes=modes,
        exceptions=MappingProxyType(exceptions),
    )


def _of_disagreements(loop: Loop, count: int) -> Loop:
    """What is the same for all: errors are differences of states, ``count`` of them."""
    starts = loop.starts
    if starts is not None:
        apart = tuple((lo - hi, hi - lo) for lo, hi in shared_starts(loop))
        starts = replace(starts, states=apart, off=2 * starts.off)
    drift = {}
    if loop.slopes:
        drift = dict.fromkeys(range(count), scale(-1, loop.slopes))
    return replace(
        loop,
        pins=pins_of({}),
        pulls=pins_of(drift),
        groups=tuple(map(_doubled, loop.groups)),
        goal="differences",
        goals=zero_goals(loop.m),
        starts=starts,
        xi0=None,
    )


def shared_starts(loop: Loop) -> Iterator[Pair]:
    """By component, the interval in which every x_i - offset_i starts."""
    goals = loop.goals.different(range(loop.n))
    for c, (lo, hi) in enumerate(loop.starts.states if loop.starts else ()):
        offsets = [goal[c] for goal in goals]
        yield lo - max(offsets), hi - min(offsets)


def _doubled(group: Group) -> Group:
    """The same estimation error, seen through 2 C."""
    exosystem = Exosystem(A=group.exosystem.A, C=scale(RESIDUALS, group.exosystem.C))
    W = group.observer.W
    if W is not None:
        W = scale(1 / RESIDUALS, W)
    observer = replace(group.observer, W=W)
    return Group(agents=group.agents, exosystem=exosystem, observer=observer)


def pairs_of(loop: Loop) -> Loop:
    """The loop of pairs of one without pins."""
    functions, mirrored = both_ways(loop)
    modes = dict[str, Arcs]()
    exceptions = dict[Arc, int]()
    for name, arcs in loop.modes.items():
        heard = _heard_by_pairs(loop, arcs)
        modes[name] = heard.arcs
        places = np.where(heard.mirrored, mirrored[heard.places], heard.places)
        other = np.flatnonzero(places)
        listeners = heard.arcs.listeners[other].tolist()
        speakers = heard.arcs.speakers[other].tolist()
        exceptions |= zip(
            zip(listeners, speakers, strict=True), places[other].tolist(), strict=True
        )
    labels = (
        f"({first}, {second})"
        for i, first in enumerate(loop.labels)
        for second in _without(loop.labels, i)
    )
    return replace(
        _of_disagreements(loop, loop.n * (loop.n - 1)),
        labels=tuple(labels),
        fixed=FIXED,
        modes=modes,
        functions=functions,
        exceptions=MappingProxyType(exceptions),
    )


def _without(labels: Sequence[str], i: int) -> tuple[str, ...]:
    return (*labels[:i], *labels[i + 1 :])


def both_ways(loop: Loop) -> tuple[tuple[Coupling, ...], IndexArray]:
    """The functions h, then h*(y) = -h(-y) of those that are not linear; the place of each h*."""
    functions = list(loop.functions)
    places = list(range(len(functions)))
    for place, h in enumerate(loop.functions):
        if not h.is_linear:
            places[place] = len(functions)
            functions.append(_mirrored(h, loop.m))
    return tuple(functions), np.array(places, dtype=np.int64)


def _mirrored(h: Coupling, m: int) -> Coupling:
    """-h(-y)."""
    texts = [f"-({re.sub(r'y[0-9]*', lambda y: f'(-{y[0]})', text)})" for text in h.texts]
    made = texts[0] if h.by_component else texts
    return make_coupling(made, dimension=m, longest=2 * LONGEST_MADE)


@noun(eq=False)
class _Heard:
    """Which pairs each pair hears in a mode; the places of functions, and which are mirrored."""

    arcs: Arcs
    places: IndexArray
    mirrored: Any


def _heard_by_pairs(loop: Loop, arcs: Arcs) -> _Heard:
    """Every arc, by which i hears l, once for each other agent j: (i, j) hears (l, j), and (j, i)
    hears (j, l)."""
    n = loop.n
    bottom = common_denominator(arcs.weights, bits=512) or 1
    numbers = _as_integers(arcs.weights, bottom)
    table = _matched(loop, arcs, numbers)
    arc, other = np.nonzero(arcs.listeners[:, None] != np.arange(n))
    sure = ~arcs.uncertain[arc]
    left = numbers[arc] - sure * np.minimum(numbers[arc], table[other, arcs.speakers[arc]])
    kept = left != 0
    arc, other, left = arc[kept], other[kept], left[kept]

    own, heard = arcs.listeners[arc], arcs.speakers[arc]
    meets = heard == other
    # Where they meet the pair is no pair, and the number that is made for it is not used.
    apart = np.where(meets, (heard + 1) % n, other)
    first = np.where(meets, n * (n - 1), _number(heard, apart, n))
    second = np.where(meets, n * (n - 1) + 1, _number(apart, heard, n))
    together = _together(table)
    i, j = np.nonzero(together)
    listeners = [_number(i, j, n), _number(own, other, n), _number(other, own, n)]
    speakers = [np.full(len(i), n * (n - 1)), first, second]
    places = coupling_places(loop, arcs)[arc]
    loose = np.concatenate([i < 0, arcs.uncertain[arc], arcs.uncertain[arc]])
    # Optional arcs are the last ones.
    order = np.argsort(loose, kind="stable")
    weights = np.concatenate([together[i, j], left, left])[order].tolist()
    known = {x: Fraction(x) / bottom for x in set(weights)}
    return _Heard(
        arcs=Arcs(
            listeners=np.concatenate(listeners)[order],
            speakers=np.concatenate(speakers)[order],
            weights=tuple(map(known.__getitem__, weights)),
            optional=int(np.count_nonzero(loose)),
        ),
        places=np.concatenate([0 * i, places, places])[order],
        mirrored=np.repeat([False, False, True], [len(i), len(arc), len(arc)])[order],
    )


def _number(i: Any, j: Any, n: int) -> Any:
    """The number of the pair (i, j) of n agents."""
    return i * (n - 1) + j - (j > i)


def _as_integers(weights: Sequence[Fraction], bottom: int) -> Any:
    """Weights times ``bottom``, which is 1 where denominators are long, and they stay fractions."""
    numbers = np.array([w * bottom for w in weights], dtype=object)
    if all(w.denominator == 1 and w < 2**40 for w in numbers.tolist()):
        return numbers.astype(np.int64)
    return numbers


def has_matches(loop: Loop) -> bool:
    """Whether what both agents of a pair hear may count with one weight."""
    plant = loop.uncertainty
    exact = plant is None or not (plant.weights or plant.measurement)
    return exact and loop.is_linear and len(loop.functions) == 1


def _matched(loop: Loop, arcs: Arcs, numbers: Any) -> Any:
    """The weight, in ``numbers``, by which the agent of each row hears that of each column, where
    what both agents of a pair hear of a third one may be matched: w (x_l - x_i) - w (x_l - x_j) is
    -w (x_i - x_j), an arc to a fixed node of the lesser weight of the two.  That is so where there
    is one function, a linear one, and for arcs that are always there; weights and measured states
    that are uncertain are off by errors of their own."""
    table = np.zeros((loop.n, loop.n), dtype=numbers.dtype)
    if has_matches(loop):
        sure = ~arcs.uncertain
        table[arcs.listeners[sure], arcs.speakers[sure]] = numbers[sure]
    return table


def _together(table: Any) -> Any:
    """What both agents of every pair hear of the same others, (n, n)."""
    total = np.zeros_like(table)
    for heard in table.T:
        hears = np.flatnonzero(heard)
        total[np.ix_(hears, hears)] += np.minimum.outer(heard[hears], heard[hears])
    np.fill_diagonal(total, 0)
    return total
