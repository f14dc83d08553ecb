"""Exact decisions about pinning gains: do they reach a rate, can none, what do they cost at least, how many pins.

Cost.  With Lambda0 = J + J', any gains k with Lambda0 - 2 K < -2 rate I satisfy, for all v_r and y >= 0 with
sum_r |v_r,i|^2 <= c_i + y_i on allowed agents (y_i = 0 without a cap),

    sum c_i k_i >= 1/2 sum_r (v_r' Lambda0 v_r + 2 rate v_r' v_r) - sum y_i cap_i

(weak duality: the multiplier Z = sum_r v_r v_r'/2 is semidefinite by its form).  The vectors are proposals; the
inequality is multiplied out over the rationals.

Count.  Every set that listens to nobody outside, in one of the modes, needs a pin: e_S = c is an equilibrium without
one (theory, section 2); the smallest ones are the source components of each mode.  And if Lambda0 + 2 rate I >= 0 on a
space of dimension d, and fewer than d / m agents are pinned, a direction of that space is 0 on all of them, and no gain
holds it.

Rates that nothing reaches, whatever V proves it.  With arc gains >= 0 the linearisation M = J - K at the consensus has
no negative entry off its diagonal.  For w >= 0, w != 0, M w >= -r w shows an eigenvalue >= -r (Perron and Frobenius).
Where w = 0 on agents whose gain has no limit, this holds for all their gains, so no error in that mode decays faster
than exp(-r t).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations
from math import comb
from typing import Any

import numpy as np

from dobc_design.conditions.consensus.claim import Jacobians, ModeJacobian, jacobians_at_consensus
from dobc_design.conditions.consensus.network import TOPS, Enclosed, find_witness, is_negative, name_agents, refutes
from dobc_design.conditions.statement import Statement, refuted
from dobc_design.exact.definite import decide_positive_definite, decide_positive_semidefinite
from dobc_design.exact.interval import UndefinedError
from dobc_design.exact.matrix import Vector
from dobc_design.exact.number import number_text
from dobc_design.exact.reading import counted
from dobc_design.exact.symmetric import SparseSymmetric, Symmetric
from dobc_design.exact.zmatrix import proves
from dobc_design.problem.changes import typed_number
from dobc_design.problem.problem import Problem
from dobc_design.problem.reaching import closed_groups
from dobc_design.synthesis.pinning.claim import Bound, Obstacle, Structure
from dobc_design.synthesis.pinning.request import PinningRequest, rounded_up
from dobc_design.verdict import Verdict

ZERO = Fraction(0)
BITS = 40  # of the largest entry of a rounded multiplier
HINT_BITS = 50  # of the largest entry of a vector that shows definiteness
LARGEST = 300  # rows that are eliminated in the search for a witness
MOST_ROWS = 200  # of Lambda, up to which slow directions are counted
Vectors = Sequence[tuple[str, Any]]  # a mode, and numbers (n m) in a list or an array
MOST_STEPS = 50_000  # of the exhaustive search
COARSE, FINE = 2**20, 10**12  # the largest entry of a rounded direction: one of a space, one alone
MOST_SETS = 3000  # sets of agents that are excluded one by one
LONGEST = 400  # entries of a direction that a statement writes out
#: (mode, state component, agents that may be pinned, caps, size=n) -> directions (n), in floating point.
Directions = Callable[..., Iterable[Sequence[float]]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Ground:
    """A request and what decides it: J + J' of every mode (``lambdas``, without any gain), exactly enclosed."""

    problem: Problem
    request: PinningRequest
    lambdas: Mapping[str, Enclosed]


def reaches(ground: Ground, gains: Mapping[int, Fraction], rate: Fraction, *, hints: Vectors = ()) -> bool:
    """Whether Lambda0 - 2 K < -2 rate I is proved in every mode.  ``hints``: v > 0 that may show it quickly."""
    m = ground.problem.m
    size = ground.problem.n * m
    held = SparseSymmetric(size, {(i * m + c, i * m + c): -2 * k for i, k in gains.items() for c in range(m)})
    for mode, enclosed in ground.lambdas.items():
        matrix = Enclosed(middle=enclosed.middle + held, deviations=enclosed.deviations)
        upper = matrix.middle.shifted(matrix.radius + 2 * rate).negated()
        if not _shown(upper, [v for name, v in hints if name == mode]) and not is_negative(matrix, shift=2 * rate):
            return False
    return True


def bound_from(ground: Ground, vectors: Vectors, allowed: Collection[int], rate: Fraction) -> Bound:
    """The lower bound that proposed vectors prove, for gains on the ``allowed`` agents; each made to fit first."""
    request, m = ground.request, ground.problem.m
    top = max((abs(x) for _, v in vectors for x in v), default=0.0)
    if not 0 < top < float("inf"):
        return Bound(
            value=ZERO, rate=rate, vectors=(), loads=(ZERO,) * ground.problem.n, cap_prices={}, rate_price=ZERO
        )
    size = Fraction(top)
    unit = Fraction(2) ** (size.numerator.bit_length() - size.denominator.bit_length() - BITS)
    rows = [(mode, [round(Fraction(x) / unit) for x in v]) for mode, v in vectors]

    def load_of(agent: int) -> Fraction:
        return sum(x * x for _, v in rows for x in v[agent * m : (agent + 1) * m]) * unit * unit

    loads, prices = [ZERO] * ground.problem.n, {}
    free = set(allowed)
    for i in range(ground.problem.n):
        load = load_of(i)
        if i in free and load > request.costs[i]:
            if i in request.caps:
                prices[i] = load - request.costs[i]
            else:
                _shrink(rows, i, m, request.costs[i] / load)
                load = load_of(i)
        loads[i] = load
    exact = tuple((mode, tuple(x * unit for x in v)) for mode, v in rows)
    squares = sum(loads, ZERO)
    value = sum((ground.lambdas[mode].value(v).lo for mode, v in exact), ZERO) / 2 + rate * squares
    value -= sum((price * request.caps[i] for i, price in prices.items()), ZERO)
    return Bound(
        value=max(value, ZERO), rate=rate, vectors=exact, loads=tuple(loads), cap_prices=prices, rate_price=squares
    )


def obstacle_to(ground: Ground, allowed: Collection[int], rate: Fraction, candidates: Vectors = ()) -> Obstacle | None:
    """A direction that no gains on the ``allowed`` agents hold at this rate, or None if none was found.

    Gains with a cap stand at it, which is best; the direction is 0 on agents whose gain has no cap.
    """
    request, m = ground.request, ground.problem.m
    size = ground.problem.n * m
    free = set(allowed) - set(request.caps)
    rows = [row for row in range(size) if row // m not in free]
    held = {(i * m + c, i * m + c): -2 * request.caps[i] for i in set(allowed) & set(request.caps) for c in range(m)}
    added = SparseSymmetric(size, held).shifted(2 * rate)
    for mode, enclosed in ground.lambdas.items():
        matrix = Enclosed(middle=enclosed.middle + added, deviations=enclosed.deviations)
        own = [v for name, v in candidates if name == mode and len(v) == size]
        fitting = [[x if row // m not in free else 0.0 for row, x in enumerate(v)] for v in own]
        vector = _rounded(matrix, fitting)
        if vector is None and len(rows) <= LARGEST:
            vector = find_witness(matrix, fitting, rows=rows)
        if vector is not None:
            return Obstacle(mode=mode, vector=vector)
    return None


def _rounded(matrix: Enclosed, candidates: Iterable[Sequence[float]]) -> Vector | None:
    for candidate in candidates:
        largest = max((abs(x) for x in candidate), default=0.0)
        for top in (*TOPS, 10**9) if 0 < largest < float("inf") else ():
            vector = tuple(Fraction(round(x / largest * top)) for x in candidate)
            if refutes(matrix, vector):
                return vector
    return None


def _shown(upper: Symmetric, hints: Sequence[Sequence[float]]) -> bool:
    if not hints or any(len(each) != upper.size for each in hints):
        return False
    total = [sum(column) for column in zip(*hints, strict=True)]
    top = max(total, default=0.0)
    if not 0 < top < float("inf"):
        return False
    return proves(upper, [round(x / top * 2**HINT_BITS) for x in total])


def _shrink(rows: Sequence[tuple[str, list[int]]], agent: int, m: int, part: Fraction) -> None:
    """Multiply the rows of one agent by ``part`` < 1, towards 0: part <= sqrt(part), so that squares fit."""
    for _, v in rows:
        for row in range(agent * m, (agent + 1) * m):
            size = abs(v[row]) * part.numerator // part.denominator
            v[row] = size if v[row] > 0 else -size


def pins_needed(ground: Ground, rate: Fraction, directions: Vectors) -> int:
    """The largest number of pins that the proposed ``directions`` of one mode prove to be needed; 0 if none."""
    m, least = ground.problem.m, 0
    if ground.problem.n * m > MOST_ROWS:
        return 0
    for mode, enclosed in ground.lambdas.items():
        vectors = [v for name, v in directions if name == mode]
        if len(vectors) > least * m and _are_slow(enclosed, rate, vectors):
            least = -(-len(vectors) // m)
    return least


def _are_slow(enclosed: Enclosed, rate: Fraction, vectors: list[Any]) -> bool:
    """Whether the directions are independent, and v'(Lambda0 + 2 rate I)v >= 0 for all their combinations."""
    columns = np.array([[round(x / max(map(abs, v)) * COARSE) for x in v] for v in vectors], dtype=object).T
    lower = enclosed.middle.shifted(2 * rate - enclosed.radius)
    common = math.lcm(1, *(x.denominator for x in lower.entries.values()))
    matrix = np.zeros((lower.size, lower.size), dtype=object)
    for (i, j), value in lower.entries.items():
        matrix[i, j] = matrix[j, i] = int(value * common)
    independent = decide_positive_definite(_symmetric(columns.T @ columns)).verdict is Verdict.PROVED
    form = columns.T @ (matrix @ columns)
    return independent and decide_positive_semidefinite(_symmetric(form)).verdict is Verdict.PROVED


def _symmetric(table: Any) -> SparseSymmetric:
    size = len(table)
    return SparseSymmetric(size, {(i, j): Fraction(int(table[i, j])) for i in range(size) for j in range(i, size)})


def structure_of(problem: Problem, allowed: Collection[int]) -> Structure:
    """The groups of all modes and the least number of allowed agents that meet them."""
    found: dict[tuple[int, ...], None] = {}
    for arcs in problem.network.modes.values():
        found |= dict.fromkeys(closed_groups(problem, [arcs]))
    groups = tuple(sorted(found, key=lambda group: (len(group), group)))
    free = set(allowed)
    open_ = [frozenset(group) & free for group in groups]
    unmet = next((group for group, left in zip(groups, open_, strict=True) if not left), None)
    apart = tuple(groups[k] for k in _apart(open_))
    if unmet is not None:
        return Structure(groups=groups, least=len(apart), exact=False, agents=(), apart=apart, unmet=unmet)
    agents, exact = _fewest(open_, len(apart))
    least = len(agents) if exact else len(apart)
    return Structure(groups=groups, least=least, exact=exact, agents=agents, apart=apart, unmet=None)


def structural_obstacle(problem: Problem, pins: int | str | None, structure: Structure) -> Statement | None:
    """A proof by the graph alone that the allowed agents, or so few pins, cannot do."""
    labels = problem.network.labels
    several = len(problem.network.modes) > 1  # signals that leave a mode often enough may do with fewer pins
    where, always = (" in one of the modes", " under arbitrary switching") if several else ("", "")
    if structure.unmet is not None:
        who = name_agents([labels[i] for i in structure.unmet])
        return refuted(
            "structure",
            f"consensus{always} is out of reach with pins on the allowed agents only: {who} listen"
            f"{'s' if len(structure.unmet) == 1 else ''} to nobody else{where}, and no pin may be put there, so moved"
            f" together they stay moved{' while it lasts' if several else ''}.",
            group=", ".join(labels[i] for i in structure.unmet),
        )
    if isinstance(pins, int) and pins < structure.least:
        groups = structure.apart if len(structure.apart) > pins else structure.groups
        named = "; ".join(name_agents([labels[i] for i in group]) for group in groups[:8])
        return refuted(
            "pins",
            f"{counted(pins, 'pin')} cannot do{always}, whatever the gains: at least {structure.least} are"
            f" needed, because each of these groups hears nobody outside{where} and needs a pin of its own: {named}.",
            least=str(structure.least),
            groups=" | ".join(", ".join(labels[i] for i in group) for group in groups[:50]),
        )
    return None


def packing(groups: Sequence[Collection[int]], inside: Collection[int]) -> int:
    """How many further agents at least meet the groups that ``inside`` does not: groups without a common agent."""
    return len(_apart([frozenset(group) for group in groups if not set(group) & set(inside)]))


def _apart(groups: Sequence[Collection[int]]) -> list[int]:
    used: set[int] = set()
    kept = []
    for k in sorted(range(len(groups)), key=lambda k: (len(groups[k]), k)):
        if not used & set(groups[k]):
            used |= set(groups[k])
            kept.append(k)
    return kept


def _fewest(groups: Sequence[frozenset[int]], least: int) -> tuple[tuple[int, ...], bool]:
    """The smallest set that meets all groups, by search in growing size; False if that was given up."""
    if len(_apart(groups)) == len(groups):
        return tuple(sorted(min(group) for group in groups)), True
    steps = [MOST_STEPS]
    for size in range(least, len(groups) + 1):
        found = _of_size(groups, size, steps)
        if steps[0] <= 0:
            return (), False
        if found is not None:
            return tuple(sorted(found)), True
    return (), False


def _of_size(groups: Sequence[frozenset[int]], size: int, steps: list[int]) -> tuple[int, ...] | None:
    steps[0] -= 1
    if not groups:
        return ()
    if steps[0] <= 0 or len(_apart(groups)) > size:
        return None
    smallest: frozenset[int] = min(groups, key=len)
    for agent in sorted(smallest):
        rest = _of_size([group for group in groups if agent not in group], size - 1, steps)
        if rest is not None:
            return (agent, *rest)
    return None


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
            for proposed in propose(mode, component, pinned, caps, size=jacobians.size):
                w = _nonnegative(proposed, set(pinned) - set(caps))
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


def too_fast(
    problem: Problem,
    rate: Fraction,
    *,
    allowed: Sequence[int],
    caps: Mapping[int, Fraction],
    pins: int | str | None,
    propose: Directions,
) -> Statement | None:
    """A proof that no gains on the ``allowed`` agents, or on ``pins`` of them, let every error decay at ``rate`` (1/s).

    Whatever proves it; None if there is none.  Its kind is "pins" where every set of so many is excluded, "max_gain"
    where gains without caps are not excluded by the same means, else "rate".
    """
    jacobians = _jacobians(problem)
    if jacobians is None:
        return None
    found = slow_direction(jacobians, allowed, caps, propose)
    if found is None or found.limit >= rate:
        return _too_few_pins(problem, jacobians, rate, pins, allowed, caps, propose) if isinstance(pins, int) else None
    labels = problem.network.labels
    free = None if not caps else slow_direction(jacobians, allowed, {}, propose)
    capped = bool(caps) and (free is None or free.limit >= rate)
    moved = name_agents([labels[i] for i, x in enumerate(found.w) if x])
    where = f" in mode {found.mode}" if len(problem.network.modes) > 1 else ""
    every = capped or len(allowed) == problem.n
    how = "with every gain at its cap" if every else "with the allowed agents held exactly at the target"
    pace = f"return{'s' if sum(map(bool, found.w)) == 1 else ''} no faster than {_above(found.limit)} 1/s"
    values = {"w": ", ".join(map(str, found.w))} if len(found.w) <= LONGEST else {}
    return refuted(
        "max_gain" if capped else "rate",
        f"no gains let the errors decay at {typed_number(rate)} 1/s{where}: even {how}, {moved} {pace} near the"
        " target.",
        mode=found.mode,
        component=str(found.component + 1),
        limit=number_text(found.limit),
        **values,
    )


def _jacobians(problem: Problem) -> Jacobians | None:
    if any(coupling.nonsmooth for coupling in problem.couplings):
        return None
    try:
        return jacobians_at_consensus(problem)
    except UndefinedError:
        return None


def _too_few_pins(
    problem: Problem,
    jacobians: Jacobians,
    rate: Fraction,
    pins: int,
    allowed: Sequence[int],
    caps: Mapping[int, Fraction],
    propose: Directions,
) -> Statement | None:
    """A proof that no ``pins`` of the allowed agents reach the rate: every set is excluded; None if one is not."""
    count = comb(len(allowed), pins)
    if pins >= len(allowed) or count > MOST_SETS:
        return None
    most = Fraction(0)
    for chosen in combinations(allowed, pins):
        found = slow_direction(jacobians, chosen, caps, propose)
        if found is None or found.limit >= rate:
            return None
        most = max(most, found.limit)
    return refuted(
        "pins",
        f"{counted(pins, 'pinned agent')} cannot give the rate {typed_number(rate)} 1/s, whatever the gains: all"
        f" {counted(count, 'choice')} are excluded one by one, and the best of them reaches"
        f" {_above(most)} 1/s at most near the target.",
        sets=str(count),
        limit=number_text(most),
    )


def _above(limit: Fraction) -> str:
    """At most four digits, not below."""
    return f"{float(rounded_up(limit, 4)):.4g}" if limit else "0"


def _components(mode: ModeJacobian) -> range:
    """State components whose gains differ; one stands for all where h acts by component."""
    width = len(mode.gains[0]) if mode.gains else 1
    alike = all(gain[c][c] == gain[0][0] for gain in mode.gains for c in range(width))
    return range(1 if alike else width)


def _nonnegative(proposed: Sequence[float], free: Collection[int]) -> tuple[int, ...]:
    top = max((abs(x) for x in proposed), default=0.0)
    if not 0 < top < float("inf"):
        return ()
    return tuple(0 if i in free else max(0, round(x / top * FINE)) for i, x in enumerate(proposed))
