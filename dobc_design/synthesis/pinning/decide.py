"""Exact decisions about pinning gains: do they reach a rate, can none, what do they cost at least,
how many pins.

Cost: with Lambda0 = J + J', gains k with Lambda0 - 2 K < -2 rate I cost at least 1/2 sum_r (v_r'
Lambda0 v_r + 2 rate v_r' v_r) - sum y_i cap_i for all v_r and y >= 0 with sum_r |v_r,i|^2 <= c_i +
y_i on allowed agents, y_i = 0 without a cap (weak duality; theory, section 7): vectors are proposed
and multiplied out. Count: every set that listens to nobody outside, in one of the modes, needs a
pin (theory, section 2); and where Lambda0 + 2 rate I >= 0 on a space of dimension d, at least d / m
agents need one.  Rates that nothing reaches, whatever V proves it: M = J - K has no negative entry
off its diagonal, so M w >= -r w for a w >= 0, w != 0, shows an eigenvalue >= -r (Perron and
Frobenius); where w = 0 on agents whose gain has no limit, for all their gains.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations, product
from math import comb
from typing import Any

import numpy as np

from dobc_design.conditions.consensus.claim import (
    Jacobians,
    ModeJacobian,
    Statements,
    jacobians_at_consensus,
)
from dobc_design.conditions.consensus.network import (
    Enclosed,
    find_witness,
    is_negative,
    name_agents,
    refutes,
    rounded,
)
from dobc_design.conditions.numbers import rounded_up
from dobc_design.conditions.statement import Statement, refuted
from dobc_design.exact.definite import decide_positive_definite, decide_positive_semidefinite
from dobc_design.exact.interval import UndefinedError
from dobc_design.exact.matrix import Vector
from dobc_design.exact.number import number_text
from dobc_design.exact.reading import counted
from dobc_design.exact.symmetric import SparseSymmetric, Symmetric
from dobc_design.exact.zmatrix import proves
from dobc_design.problem.arrays import closed_groups
from dobc_design.problem.changes import typed_number
from dobc_design.problem.problem import Problem
from dobc_design.synthesis.pinning.claim import Bound, Gains, PinningRequest, Structure
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
#: (mode, state component, agents that may be pinned, caps, size=n) -> directions (n), in floating
#: point.
Directions = Callable[..., Iterable[Sequence[float]]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Ground:
    """A request and what decides it: J + J' of every mode (``lambdas``, without any gain), exactly
    enclosed."""

    problem: Problem
    request: PinningRequest
    lambdas: Mapping[str, Enclosed]


def reaches(ground: Ground, gains: Gains, rate: Fraction, *, hints: Vectors = ()) -> bool:
    """Whether Lambda0 - 2 K < -2 rate I is proved in every mode.  ``hints``: v > 0 that may show it
    quickly."""
    m = ground.problem.m
    size = ground.problem.n * m
    held = SparseSymmetric(
        size, {(i * m + c, i * m + c): -2 * k for i, k in gains.items() for c in range(m)}
    )
    for mode, enclosed in ground.lambdas.items():
        matrix = Enclosed(middle=enclosed.middle + held, deviations=enclosed.deviations)
        upper = matrix.middle.shifted(matrix.radius + 2 * rate).negated()
        if not _shown(upper, [v for name, v in hints if name == mode]) and not is_negative(
            matrix, shift=2 * rate
        ):
            return False
    return True


def is_undirected(statements: Statements) -> bool:
    """Whether J is symmetric in the only mode, exactly: then V = e'e decays at the true rate."""
    modes = () if statements.jacobians is None else statements.jacobians.modes
    arcs = [
        (mode.arcs.listeners.tolist(), mode.arcs.speakers.tolist(), mode.kind.tolist())
        for mode in modes
    ]
    return len(arcs) == 1 and Counter(zip(*arcs[0], strict=True)) == Counter(
        zip(arcs[0][1], arcs[0][0], arcs[0][2], strict=True)
    )


def bound_from(ground: Ground, vectors: Vectors, allowed: Collection[int], rate: Fraction) -> Bound:
    """The lower bound that proposed vectors prove, for gains on the ``allowed`` agents; each made
    to fit first."""
    request, m, n = ground.request, ground.problem.m, ground.problem.n
    top = max((abs(x) for _, v in vectors for x in v), default=0.0)
    if not 0 < top < float("inf"):
        return Bound(
            value=ZERO, rate=rate, vectors=(), loads=(ZERO,) * n, cap_prices={}, rate_price=ZERO
        )
    largest = Fraction(top)
    unit = Fraction(2) ** (largest.numerator.bit_length() - largest.denominator.bit_length() - BITS)
    rows = [(mode, [round(Fraction(x) / unit) for x in v]) for mode, v in vectors]

    def load_of(agent: int) -> Fraction:
        return sum(x * x for _, v in rows for x in v[agent * m : (agent + 1) * m]) * unit * unit

    loads, prices, free = list(map(load_of, range(n))), {}, set(allowed)
    for i, load in enumerate(loads):
        if i in free and load > request.costs[i]:
            if i in request.caps:
                prices[i] = load - request.costs[i]
            else:
                part = request.costs[i] / load  # part <= sqrt(part), so that the squares fit
                for v, row in product((v for _, v in rows), range(i * m, (i + 1) * m)):
                    size = abs(v[row]) * part.numerator // part.denominator
                    v[row] = size if v[row] > 0 else -size
                loads[i] = load_of(i)
    exact = tuple((mode, tuple(x * unit for x in v)) for mode, v in rows)
    squares = sum(loads, ZERO)
    value = sum((ground.lambdas[mode].value(v).lo for mode, v in exact), ZERO) / 2 + rate * squares
    value -= sum((price * request.caps[i] for i, price in prices.items()), ZERO)
    value = max(value, ZERO)
    return Bound(
        value=value,
        rate=rate,
        vectors=exact,
        loads=tuple(loads),
        cap_prices=prices,
        rate_price=squares,
    )


def obstacle_to(
    ground: Ground, allowed: Collection[int], rate: Fraction, candidates: Vectors = ()
) -> tuple[str, Vector] | None:
    """A mode and v (n m,), v'(Lambda0 - 2 K + 2 rate I) v >= 0 for all gains on ``allowed``, 0
    where one has no cap."""
    request, m = ground.request, ground.problem.m
    size = ground.problem.n * m
    free = set(allowed) - set(request.caps)
    rows = [row for row in range(size) if row // m not in free]
    held = {
        (i * m + c, i * m + c): -2 * request.caps[i]
        for i in set(allowed) & set(request.caps)
        for c in range(m)
    }
    added = SparseSymmetric(size, held).shifted(2 * rate)
    for mode, enclosed in ground.lambdas.items():
        matrix = Enclosed(middle=enclosed.middle + added, deviations=enclosed.deviations)
        own = [v for name, v in candidates if name == mode and len(v) == size]
        fitting = [[x if row // m not in free else 0.0 for row, x in enumerate(v)] for v in own]
        vector = next(
            (v for x in fitting for v in rounded(x, finest=(10**9,)) if refutes(matrix, v)), None
        )
        if vector is None and len(rows) <= LARGEST:
            vector = find_witness(matrix, fitting, rows=rows)
        if vector is not None:
            return mode, vector
    return None


def _shown(upper: Symmetric, hints: Sequence[Sequence[float]]) -> bool:
    if any(len(each) != upper.size for each in hints):
        return False
    total = [sum(column) for column in zip(*hints, strict=True)]
    top = max(total, default=0.0)
    return 0 < top < float("inf") and proves(upper, [round(x / top * 2**HINT_BITS) for x in total])


def pins_needed(ground: Ground, rate: Fraction, directions: Vectors) -> int:
    """The largest number of pins that the proposed ``directions`` of one mode prove to be needed; 0
    if none."""
    m, least = ground.problem.m, 0
    if ground.problem.n * m > MOST_ROWS:
        return 0
    for mode, enclosed in ground.lambdas.items():
        vectors = [v for name, v in directions if name == mode]
        if len(vectors) > least * m and _are_slow(enclosed, rate, vectors):
            least = -(-len(vectors) // m)
    return least


def _are_slow(enclosed: Enclosed, rate: Fraction, vectors: list[Any]) -> bool:
    """Whether the directions are independent, and v'(Lambda0 + 2 rate I)v >= 0 for all their
    combinations."""
    columns = np.array(
        [[round(x / max(map(abs, v)) * COARSE) for x in v] for v in vectors], dtype=object
    ).T
    lower = enclosed.middle.shifted(2 * rate - enclosed.radius)
    common = math.lcm(1, *(x.denominator for x in lower.entries.values()))  # integers are quicker
    matrix = np.zeros((lower.size, lower.size), dtype=object)
    for (i, j), value in lower.entries.items():
        matrix[i, j] = matrix[j, i] = int(value * common)

    def symmetric(table: Any) -> SparseSymmetric:
        return SparseSymmetric.from_dense(
            tuple(tuple(Fraction(int(x)) for x in row) for row in table)
        )

    independent = decide_positive_definite(symmetric(columns.T @ columns)).verdict is Verdict.PROVED
    form = symmetric(columns.T @ (matrix @ columns))
    return independent and decide_positive_semidefinite(form).verdict is Verdict.PROVED


def structure_of(problem: Problem, allowed: Collection[int]) -> Structure:
    """The groups of all modes and the least number of allowed agents that meet them."""
    found = {
        group for arcs in problem.network.modes.values() for group in closed_groups(problem, [arcs])
    }
    groups = tuple(sorted(found, key=lambda group: (len(group), group)))
    open_ = [frozenset(group) & frozenset(allowed) for group in groups]
    unmet = next((group for group, left in zip(groups, open_, strict=True) if not left), None)
    own = tuple(groups[k] for k in apart(open_))
    agents = _fewest(open_, len(own)) if unmet is None else None
    least, exact = len(own if agents is None else agents), agents is not None
    return Structure(
        groups=groups, least=least, exact=exact, agents=agents or (), apart=own, unmet=unmet
    )


def structural_obstacle(
    problem: Problem, pins: int | str | None, structure: Structure
) -> Statement | None:
    """A proof by the graph alone that the allowed agents, or so few pins, cannot do."""
    labels = problem.network.labels
    # signals that leave a mode often enough may do with fewer pins
    several = len(problem.network.modes) > 1
    words = (" in one of the modes", " under arbitrary switching", " while it lasts")
    where, always, lasts = words if several else ("", "", "")
    if structure.unmet is not None:
        listen = "listens" if len(structure.unmet) == 1 else "listen"
        group = [labels[i] for i in structure.unmet]
        text = (
            f"consensus{always} is impossible with pins on the allowed agents only: "
            f"{name_agents(group)} {listen}"
        )
        text += (
            f" to nobody else{where}, and may not be pinned, so a common error of theirs does "
            f"not decay{lasts}."
        )
        return refuted("structure", text, group=", ".join(group))
    if isinstance(pins, int) and pins < structure.least:
        groups = structure.apart if len(structure.apart) > pins else structure.groups
        named = "; ".join(name_agents([labels[i] for i in group]) for group in groups[:8])
        text = (
            f"{counted(pins, 'pin')} cannot work{always}, whatever the gains: at least "
            f"{structure.least} are needed,"
        )
        text += (
            f" because each of these groups hears nobody outside{where} and needs a pin of its "
            f"own: {named}."
        )
        every = " | ".join(", ".join(labels[i] for i in group) for group in groups[:50])
        return refuted("pins", text, least=str(structure.least), groups=every)
    return None


def apart(groups: Sequence[Collection[int]]) -> list[int]:
    """Places of groups without a common agent, the smallest first: each needs a pin of its own."""
    used, kept = set[int](), list[int]()
    for k in sorted(range(len(groups)), key=lambda k: (len(groups[k]), k)):
        if not used & set(groups[k]):
            used |= set(groups[k])
            kept.append(k)
    return kept


def _fewest(groups: Sequence[frozenset[int]], least: int) -> tuple[int, ...] | None:
    """The smallest set that meets all groups, by search in growing size; None if that was given
    up."""
    if len(apart(groups)) == len(groups):
        return tuple(sorted(min(group) for group in groups))
    steps = [MOST_STEPS]
    for size in range(least, len(groups) + 1):
        found = _of_size(groups, size, steps)
        if steps[0] <= 0:
            return None
        if found is not None:
            return tuple(sorted(found))
    return None


def _of_size(
    groups: Sequence[frozenset[int]], size: int, steps: list[int]
) -> tuple[int, ...] | None:
    steps[0] -= 1
    if not groups:
        return ()
    if steps[0] <= 0 or len(apart(groups)) > size:
        return None
    smallest: frozenset[int] = min(groups, key=len)
    for agent in sorted(smallest):
        rest = _of_size([group for group in groups if agent not in group], size - 1, steps)
        if rest is not None:
            return (agent, *rest)
    return None


@dataclass(frozen=True, slots=True, kw_only=True)
class SlowDirection:
    """w (n) >= 0 of one state component in one mode; no gains make the loop decay faster than
    ``limit`` (1/s) there."""

    mode: str
    component: int
    w: tuple[int, ...]
    limit: Fraction


def slow_direction(
    jacobians: Jacobians, pinned: Collection[int], caps: Gains, propose: Directions
) -> SlowDirection | None:
    """The proved direction with the lowest limit for scalar gains on the ``pinned`` agents; None
    without any."""
    best: SlowDirection | None = None
    free = set(pinned) - set(caps)
    for mode in jacobians.modes:
        if not mode.is_nonnegative_diagonal:
            continue
        width = len(mode.gains[0]) if mode.gains else 1
        alike = all(gain[c][c] == gain[0][0] for gain in mode.gains for c in range(width))
        # one stands for all where h acts by component
        for component in range(1 if alike else width):
            for proposed in propose(mode, component, pinned, caps, size=jacobians.size):
                top = max((abs(x) for x in proposed), default=0.0)
                if not 0 < top < float("inf"):
                    continue
                w = tuple(
                    0 if i in free else max(0, round(x / top * FINE))
                    for i, x in enumerate(proposed)
                )
                limit = limit_of(mode, component, w, pinned=pinned, caps=caps)
                if limit is not None and (best is None or limit < best.limit):
                    best = SlowDirection(mode=mode.name, component=component, w=w, limit=limit)
    return best


def limit_of(
    mode: ModeJacobian, component: int, w: Sequence[int], *, pinned: Collection[int], caps: Gains
) -> Fraction | None:
    """The rate (1/s) out of reach by w: the largest -(M w)_i / w_i; None if w is 0, not >= 0 or
    moves a free agent."""
    free = set(pinned) - set(caps)
    if not any(w) or min(w) < 0 or any(w[i] for i in free) or not mode.is_nonnegative_diagonal:
        return None
    held = set(pinned) & set(caps)
    pull = {i: x * (caps[i] if i in held else Fraction(0)) for i, x in enumerate(w) if x}
    arcs = (mode.arcs.listeners.tolist(), mode.arcs.speakers.tolist(), mode.kind.tolist())
    for i, j, kind in zip(*arcs, strict=True):
        if w[i] and w[i] != w[j]:
            gain = mode.gains[kind][component][component]
            pull[i] += (gain.hi if w[i] > w[j] else gain.lo) * (w[i] - w[j])
    return max(Fraction(0), *(value / w[i] for i, value in pull.items()))


def too_fast(
    problem: Problem,
    rate: Fraction,
    *,
    allowed: Sequence[int],
    caps: Gains,
    pins: int | str | None,
    propose: Directions,
) -> Statement | None:
    """A proof that no gains on the ``allowed`` agents, or on ``pins`` of them, let every error
    decay at ``rate`` (1/s). Whatever proves it; None if there is none.  Its kind is "pins" where
    every set of so many is excluded, "max_gain" where gains without caps are not excluded by the
    same means, else "rate"."""
    if any(coupling.nonsmooth for coupling in problem.couplings):
        return None
    try:
        jacobians = jacobians_at_consensus(problem)
    except UndefinedError:
        return None

    def slowest(agents: Sequence[int], caps: Gains = caps) -> SlowDirection | None:
        direction = slow_direction(jacobians, agents, caps, propose)
        return None if direction is None or direction.limit >= rate else direction

    found = slowest(allowed)
    if found is None:
        return _too_few_pins(rate, pins, allowed, slowest) if isinstance(pins, int) else None
    labels = problem.network.labels
    capped = bool(caps) and slowest(allowed, {}) is None
    moved = [labels[i] for i, x in enumerate(found.w) if x]
    where = f" in mode {found.mode}" if len(problem.network.modes) > 1 else ""
    how = "with the allowed agents held exactly at the target"
    if capped or len(allowed) == problem.n:
        how = "with every gain at its cap"
    pace = f"return{'s' if len(moved) == 1 else ''} no faster than {_above(found.limit)} 1/s"
    text = (
        f"no gains let the errors decay at {typed_number(rate)} 1/s{where}: even {how}, "
        f"{name_agents(moved)} {pace}"
    )
    values = {"w": ", ".join(map(str, found.w))} if len(found.w) <= LONGEST else {}
    values = {
        "mode": found.mode,
        "component": str(found.component + 1),
        "limit": number_text(found.limit),
        **values,
    }
    return refuted("max_gain" if capped else "rate", f"{text} near the target.", **values)


def _too_few_pins(
    rate: Fraction,
    pins: int,
    allowed: Sequence[int],
    slowest: Callable[[Sequence[int]], SlowDirection | None],
) -> Statement | None:
    """A proof that no ``pins`` of the allowed agents reach the rate: every set is excluded; None if
    one is not."""
    count, most = comb(len(allowed), pins), Fraction(0)
    if pins >= len(allowed) or count > MOST_SETS:
        return None
    for chosen in combinations(allowed, pins):
        found = slowest(chosen)
        if found is None:
            return None
        most = max(most, found.limit)
    text = (
        f"{counted(pins, 'pinned agent')} cannot give the rate {typed_number(rate)} 1/s, "
        "whatever the gains: all"
    )
    text += (
        f" {counted(count, 'choice')} are excluded one by one, and the best of them reaches "
        f"{_above(most)} 1/s at"
    )
    return refuted(
        "pins", f"{text} most near the target.", sets=str(count), limit=number_text(most)
    )


def _above(limit: Fraction) -> str:
    """At most four digits, not below."""
    return f"{float(rounded_up(limit, digits=4)):.4g}" if limit else "0"
