"""Rates that no gains on some agents can reach, whatever V proves them: exact, from a direction that is too slow.

With arc gains >= 0 the linearisation M = J - K at the consensus has no negative entry off its diagonal.  For w >= 0,
w != 0, M w >= -r w shows an eigenvalue >= -r (Perron and Frobenius).  Where w = 0 on agents whose gain has no limit,
this holds for all their gains, so no error in that mode decays faster than exp(-r t).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from decimal import ROUND_CEILING, Context, Decimal
from fractions import Fraction
from itertools import combinations
from math import comb
from typing import Final

from dobc_design.conditions.consensus.jacobians import Jacobians, ModeJacobian
from dobc_design.conditions.consensus.network import name_agents
from dobc_design.conditions.statement import Statement
from dobc_design.exact.number import number_text
from dobc_design.exact.reading import counted
from dobc_design.problem.changes import typed_number
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

TOP = 10**12  # of the largest entry of a rounded direction
MOST_SETS = 3000  # sets of agents that are excluded one by one
LONGEST = 400  # entries of a direction that a statement writes out
_UPWARDS: Final = Context(prec=4, rounding=ROUND_CEILING)
#: (mode, state component, agents that may be pinned, caps) -> directions (n), in floating point.
Directions = Callable[[ModeJacobian, int, Collection[int], Mapping[int, Fraction]], Iterable[Sequence[float]]]


@dataclass(frozen=True, slots=True, kw_only=True)
class SlowDirection:
    """w (n) >= 0 of one state component in one mode; no gains make the loop decay faster than ``limit`` (1/s) there."""

    mode: str
    component: int
    w: tuple[int, ...]
    limit: Fraction


def slow_direction(
    jacobians: Jacobians, pinned: Collection[int], caps: Mapping[int, Fraction], propose: Directions
) -> SlowDirection | None:
    """The proved direction with the lowest limit for scalar gains on the ``pinned`` agents; None without any.

    ``caps``: the largest gain (1/s) of agents that have one.
    """
    best: SlowDirection | None = None
    for mode in jacobians.modes:
        if not mode.is_nonnegative_diagonal:
            continue
        for component in _components(mode):
            for proposed in propose(mode, component, pinned, caps):
                w = _rounded(proposed, set(pinned) - set(caps))
                limit = limit_of(mode, component, w, pinned=pinned, caps=caps)
                if limit is not None and (best is None or limit < best.limit):
                    best = SlowDirection(mode=mode.name, component=component, w=w, limit=limit)
    return best


def limit_of(
    mode: ModeJacobian, component: int, w: Sequence[int], *, pinned: Collection[int], caps: Mapping[int, Fraction]
) -> Fraction | None:
    """The rate (1/s) that w shows to be out of reach, above: the largest -(M w)_i / w_i, at least 0; exact.

    None if w shows nothing: it is 0, has a negative entry, or moves an agent whose gain has no limit.
    """
    free = set(pinned) - set(caps)
    if not any(w) or min(w) < 0 or any(w[i] for i in free) or not mode.is_nonnegative_diagonal:
        return None
    pull = {i: x * (caps[i] if i in caps and i in set(pinned) else Fraction(0)) for i, x in enumerate(w) if x}
    listeners, speakers, kinds = mode.arcs.listeners.tolist(), mode.arcs.speakers.tolist(), mode.kind.tolist()
    for i, j, kind in zip(listeners, speakers, kinds, strict=True):
        if w[i] and w[i] != w[j]:
            gain = mode.gains[kind][component][component]
            pull[i] += (gain.hi if w[i] > w[j] else gain.lo) * (w[i] - w[j])
    return max(Fraction(0), *(value / w[i] for i, value in pull.items()))


def rate_obstacle(
    problem: Problem,
    jacobians: Jacobians,
    rate: Fraction,
    *,
    allowed: Sequence[int],
    caps: Mapping[int, Fraction],
    propose: Directions,
) -> Statement | None:
    """A proof that no gains on the ``allowed`` agents let every error decay at ``rate`` (1/s); None if there is none.

    Its kind is "max_gain" where gains without caps are not excluded by the same means, else "rate".
    """
    found = slow_direction(jacobians, allowed, caps, propose)
    if found is None or found.limit >= rate:
        return None
    labels = problem.network.labels
    free = None if not caps else slow_direction(jacobians, allowed, {}, propose)
    capped = bool(caps) and (free is None or free.limit >= rate)
    moved = name_agents([labels[i] for i, x in enumerate(found.w) if x])
    where = f" in mode {found.mode}" if len(problem.network.modes) > 1 else ""
    how = "with every gain at its cap" if capped else "with the allowed agents held exactly at the target"
    if not capped and len(allowed) == problem.n:
        how = "with every gain at its cap"
    pace = f"return{'s' if sum(map(bool, found.w)) == 1 else ''} no faster than {_above(found.limit)} 1/s"
    values = {"w": ", ".join(map(str, found.w))} if len(found.w) <= LONGEST else {}
    return Statement(
        kind="max_gain" if capped else "rate",
        verdict=Verdict.REFUTED,
        exact={"mode": found.mode, "component": str(found.component + 1), "limit": number_text(found.limit), **values},
        text=f"no gains let the errors decay at {typed_number(rate)} 1/s{where}: even {how}, {moved} {pace}"
        " near the target.",
    )


def too_few_pins(
    problem: Problem,
    jacobians: Jacobians,
    rate: Fraction,
    pins: int,
    *,
    allowed: Sequence[int],
    caps: Mapping[int, Fraction],
    propose: Directions,
) -> Statement | None:
    """A proof that no ``pins`` of the allowed agents reach the rate: every set is excluded; None if one is not."""
    if pins >= len(allowed) or comb(len(allowed), pins) > MOST_SETS:
        return None
    most = Fraction(0)
    for chosen in combinations(allowed, pins):
        found = slow_direction(jacobians, chosen, caps, propose)
        if found is None or found.limit >= rate:
            return None
        most = max(most, found.limit)
    count = comb(len(allowed), pins)
    return Statement(
        kind="pins",
        verdict=Verdict.REFUTED,
        exact={"sets": str(count), "limit": number_text(most)},
        text=f"{counted(pins, 'pinned agent')} cannot give the rate {typed_number(rate)} 1/s, whatever the gains: all"
        f" {counted(count, 'choice')} are excluded one by one, and the best of them reaches"
        f" {_above(most)} 1/s at most near the target.",
    )


def _above(limit: Fraction) -> str:
    """At most four digits, not below."""
    return f"{float(_UPWARDS.divide(Decimal(limit.numerator), Decimal(limit.denominator))):.4g}"


def _components(mode: ModeJacobian) -> range:
    """State components whose gains differ; one stands for all where h acts by component."""
    width = len(mode.gains[0]) if mode.gains else 1
    alike = all(gain[c][c] == gain[0][0] for gain in mode.gains for c in range(width))
    return range(1 if alike else width)


def _rounded(proposed: Sequence[float], free: Collection[int]) -> tuple[int, ...]:
    top = max((abs(x) for x in proposed), default=0.0)
    if not 0 < top < float("inf"):
        return ()
    return tuple(0 if i in free else max(0, round(x / top * TOP)) for i, x in enumerate(proposed))
