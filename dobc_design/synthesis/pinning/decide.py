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

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from fractions import Fraction
from itertools import combinations
from math import comb
from typing import Any

import numpy as np

from dobc_design._checks import noun
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
from dobc_design.conditions.numbers import text_above
from dobc_design.conditions.statement import Statement, proved, refuted, undecided
from dobc_design.exact.definite import decide_positive_definite, decide_positive_semidefinite
from dobc_design.exact.interval import UndefinedError
from dobc_design.exact.matrix import Vector
from dobc_design.exact.number import ZERO, number_text, typed_number
from dobc_design.exact.reading import Names, counted
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.loop.arcs import closed_groups
from dobc_design.loop.make import loop_of
from dobc_design.problem.problem import Problem

from .claim import Agents, AgentSet, Bound, Gains, Limits, PinningRequest, Structure

BITS = 40  # of the largest entry of a rounded multiplier
LARGEST = 300  # rows that are eliminated in the search for a witness
MOST_ROWS = 200  # of Lambda, up to which slow directions are counted
Vectors = Sequence[tuple[str, Any]]  # a mode, and numbers (n m) in a list or an array
MOST_STEPS = 50_000  # of the exhaustive search
COARSE, FINE = 2**20, 10**12  # the largest entry of a rounded direction: one of a space, one alone
MOST_SETS = 3000  # sets of agents that are excluded one by one
LONGEST = 400  # entries of a direction that a statement writes out
NAMED, WRITTEN = 8, 50  # groups that a sentence names; that exact values list
#: (mode, state component, agents that may be pinned, caps, size=n) -> directions (n), in floating
#: point.
Directions = Callable[..., Iterable[Sequence[float]]]


@noun
class Ground:
    """A request and what decides it: J + J' of every mode (``lambdas``, without any gain), exactly
    enclosed."""

    problem: Problem
    request: PinningRequest
    lambdas: Mapping[str, Enclosed]


def reaches(ground: Ground, gains: Gains) -> bool:
    """Whether Lambda0 - 2 K < -2 rate I is proved in every mode."""
    m = ground.problem.m
    held = SparseSymmetric(ground.problem.n * m, _diagonal(gains, m))
    for enclosed in ground.lambdas.values():
        matrix = Enclosed(middle=enclosed.middle + held, deviations=enclosed.deviations)
        if not is_negative(matrix, shift=2 * ground.request.rate):
            return False
    return True


def _diagonal(gains: Gains, m: int) -> dict[tuple[int, int], Fraction]:
    """The entries of -2 K, whose agents have m rows each."""
    entries = {}
    for agent, gain in gains.items():
        for row in range(agent * m, (agent + 1) * m):
            entries[row, row] = -2 * gain
    return entries


def is_undirected(statements: Statements) -> bool:
    """Whether J is symmetric in the only mode, exactly: then V = e'e decays at the true rate."""
    if statements.jacobians is None or len(statements.jacobians.modes) != 1:
        return False
    mode = statements.jacobians.modes[0]
    listeners = mode.arcs.listeners.tolist()
    speakers = mode.arcs.speakers.tolist()
    kinds = mode.kind.tolist()
    # Enclosures of slopes cannot be compared, but arcs of one kind have one slope.
    there = Counter(zip(listeners, speakers, kinds, strict=True))
    back = Counter(zip(speakers, listeners, kinds, strict=True))
    return there == back


def bound_from(ground: Ground, vectors: Vectors, allowed: AgentSet) -> Bound:
    """The lower bound that proposed vectors prove, for gains on the ``allowed`` agents; each made
    to fit first."""
    request = ground.request
    rate = request.rate
    top = max((abs(x) for _, v in vectors for x in v), default=0.0)
    # Without numbers nothing is proved, as without vectors.
    if not 0 < top < math.inf:
        vectors = ()
        top = 1.0
    # Entries of so many bits at most.
    largest = Fraction(top)
    bits = largest.numerator.bit_length() - largest.denominator.bit_length()
    unit = Fraction(2) ** (bits - BITS)
    n = ground.problem.n
    rows = [[round(Fraction(x) / unit) for x in v] for _, v in vectors]
    # Whole numbers by vector, agent and component, in this unit.
    table = np.array(rows, dtype=object).reshape(len(rows), n, ground.problem.m)

    def load(agent: int) -> Fraction:
        return Fraction(int(np.sum(table[:, agent] ** 2))) * unit**2

    loads = [load(i) for i in range(n)]
    prices = {}
    for i in sorted(set(allowed)):
        cost = request.costs[i]
        if loads[i] <= cost:
            continue
        if i in request.caps:
            prices[i] = loads[i] - cost
        else:
            # part <= sqrt(part), so that the squares of what is left, rounded towards 0, fit
            part = cost / loads[i]
            sizes = abs(table[:, i]) * part.numerator // part.denominator
            table[:, i] = np.sign(table[:, i]) * sizes
            loads[i] = load(i)
    # Every step above keeps the vectors feasible, so that their value is a bound.
    flat = table.reshape(len(rows), -1).tolist()
    modes = (mode for mode, _ in vectors)
    exact = tuple((mode, tuple(x * unit for x in v)) for mode, v in zip(modes, flat, strict=True))
    squares = sum(loads, ZERO)
    value = sum((ground.lambdas[mode].value(v).lo for mode, v in exact), ZERO) / 2 + rate * squares
    value -= sum((price * request.caps[i] for i, price in prices.items()), ZERO)
    return Bound(
        value=max(value, ZERO),
        rate=rate,
        vectors=exact,
        loads=tuple(loads),
        cap_prices=prices,
        rate_price=squares,
    )


def obstacle_to(
    ground: Ground, allowed: AgentSet, candidates: Vectors
) -> tuple[str, Vector] | None:
    """A mode and v (n m,), v'(Lambda0 - 2 K + 2 rate I) v >= 0 for all gains on ``allowed``, 0
    where one has no cap."""
    caps = ground.request.caps
    m = ground.problem.m
    size = ground.problem.n * m
    free = set(allowed) - set(caps)
    rows = [row for row in range(size) if row // m not in free]
    held = _diagonal({i: caps[i] for i in set(allowed) & set(caps)}, m)
    added = SparseSymmetric(size, held).shifted(2 * ground.request.rate)
    for mode, enclosed in ground.lambdas.items():
        matrix = Enclosed(middle=enclosed.middle + added, deviations=enclosed.deviations)
        fitting = []
        for name, v in candidates:
            if name == mode and len(v) == size:
                fitting.append([0.0 if row // m in free else x for row, x in enumerate(v)])
        # Proposals first: elimination costs the third power of the rows.
        tries = (v for each in fitting for v in rounded(each, finest=(10**9,)))
        vector = next((v for v in tries if refutes(matrix, v)), None)
        if vector is None and len(rows) <= LARGEST:
            vector = find_witness(matrix, fitting, rows=rows)
        if vector is not None:
            return mode, vector
    return None


def _in_integers(values: Sequence[float], largest: int) -> list[int]:
    """The numbers in proportion, so that the largest size is ``largest``; none where all are 0 or
    the largest is infinite."""
    top = max(map(abs, values), default=0.0)
    if not 0 < top < math.inf:
        return []
    return [round(x / top * largest) for x in values]


def pins_needed(ground: Ground, directions: Vectors) -> int:
    """The largest number of pins that the proposed ``directions`` of one mode prove to be needed; 0
    if none."""
    m = ground.problem.m
    if ground.problem.n * m > MOST_ROWS:
        return 0
    least = 0
    for mode, enclosed in ground.lambdas.items():
        vectors = [v for name, v in directions if name == mode]
        if len(vectors) > least * m and _are_slow(enclosed, ground.request.rate, vectors):
            least = -(-len(vectors) // m)
    return least


def _are_slow(enclosed: Enclosed, rate: Fraction, vectors: list[Any]) -> bool:
    """Whether the directions are independent, and v'(Lambda0 + 2 rate I)v >= 0 for all their
    combinations."""
    columns = np.array([_in_integers(v, COARSE) for v in vectors], dtype=object).T
    lower = enclosed.middle.shifted(2 * rate - enclosed.radius)
    common = math.lcm(1, *(x.denominator for x in lower.entries.values()))  # integers are quicker
    matrix = np.array([[int(x * common) for x in row] for row in lower.to_dense()], dtype=object)
    # Rounded directions may have become dependent.
    gram = _from_integers(columns.T @ columns)
    if not decide_positive_definite(gram).is_proved:
        return False
    form = _from_integers(columns.T @ (matrix @ columns))
    return decide_positive_semidefinite(form).is_proved


def _from_integers(table: Any) -> SparseSymmetric:
    rows = [tuple(Fraction(int(x)) for x in row) for row in table]
    return SparseSymmetric.from_dense(tuple(rows))


def structure_of(problem: Problem, allowed: AgentSet) -> Structure:
    """The groups of all modes and the least number of allowed agents that meet them."""
    found = set()
    for arcs in problem.network.modes.values():
        found |= set(closed_groups(loop_of(problem), [arcs]))
    groups = tuple(sorted(found, key=lambda group: (len(group), group)))
    may = frozenset(allowed)
    left = [frozenset(group) & may for group in groups]
    unmet = next((group for group in groups if not may & set(group)), None)
    own = tuple(groups[k] for k in apart(left))
    agents = None
    if unmet is None:
        agents = _fewest(left, len(own))
    return Structure(
        groups=groups,
        least=len(own) if agents is None else len(agents),
        exact=agents is not None,
        agents=agents or (),
        apart=own,
        unmet=unmet,
    )


@noun
class Scope:
    """In which modes a group listens to nobody, in words that are empty where there is one mode."""

    where: str = ""
    always: str = ""
    lasts: str = ""


# Signals that leave a mode often enough may do with fewer pins.
OF_MODES = Scope(
    where=" in one of the modes", always=" under arbitrary switching", lasts=" while it lasts"
)


def structural_obstacle(
    problem: Problem, pins: int | str | None, structure: Structure
) -> Statement | None:
    """A proof by the graph alone that the allowed agents, or so few pins, cannot do."""
    labels = problem.network.labels
    scope = OF_MODES if len(problem.network.modes) > 1 else Scope()
    if structure.unmet is not None:
        group = [labels[i] for i in structure.unmet]
        listen = "listens" if len(group) == 1 else "listen"
        never = f"consensus{scope.always} is impossible with pins on the allowed agents only"
        alone = f"{name_agents(group)} {listen} to nobody else{scope.where}, and may not be pinned"
        stays = f"so a common error of theirs does not decay{scope.lasts}"
        return refuted("structure", f"{never}: {alone}, {stays}.", group=", ".join(group))
    if isinstance(pins, int) and pins < structure.least:
        return _too_few(pins, structure, labels, scope)
    return None


def _too_few(pins: int, structure: Structure, labels: Names, scope: Scope) -> Statement:
    groups = structure.groups
    if len(structure.apart) > pins:
        groups = structure.apart
    words = [[labels[i] for i in group] for group in groups]
    named = "; ".join(name_agents(group) for group in words[:NAMED])
    fails = f"{counted(pins, 'pin')} cannot work{scope.always}, whatever the gains"
    least = f"at least {structure.least} are needed"
    because = f"because each of these groups hears nobody outside{scope.where}"
    every = " | ".join(", ".join(group) for group in words[:WRITTEN])
    return refuted(
        "pins",
        f"{fails}: {least}, {because} and needs a pin of its own: {named}.",
        least=str(structure.least),
        groups=every,
    )


def fewest(pins: int, needed: int) -> Statement:
    """What is known of fewer pins than do, where so many are needed."""
    if pins <= needed:
        return proved(
            "pins",
            f"No fewer than {counted(pins, 'pinned agent')} reach this rate.",
            least=str(pins),
        )
    unknown = "whether fewer do was not decided"
    return undecided(
        "pins",
        f"{pins} pinned agents do; {unknown}, but at least {needed} are needed.",
        least=str(needed),
    )


def apart(groups: Sequence[AgentSet]) -> list[int]:
    """Places of groups without a common agent, the smallest first: each needs a pin of its own."""
    # Small groups first: they leave the most agents for others.
    used = set[int]()
    kept = []
    for k in sorted(range(len(groups)), key=lambda k: (len(groups[k]), k)):
        if not used & set(groups[k]):
            used |= set(groups[k])
            kept.append(k)
    return kept


def _fewest(groups: Sequence[frozenset[int]], least: int) -> Agents | None:
    """The smallest set that meets all groups, by search in growing size; None if that was given
    up."""
    if len(apart(groups)) == len(groups):
        return tuple(sorted(min(group) for group in groups))
    # One budget for all sizes, in a list, because the search counts it down.
    steps = [MOST_STEPS]
    for size in range(least, len(groups) + 1):
        found = _of_size(groups, size, steps)
        if steps[0] <= 0:
            return None
        if found is not None:
            return tuple(sorted(found))
    return None


def _of_size(groups: Sequence[frozenset[int]], size: int, steps: list[int]) -> Agents | None:
    """A set of so many agents that meets all groups; None without one, or where no ``steps`` are
    left."""
    steps[0] -= 1
    if not groups:
        return ()
    if steps[0] <= 0 or len(apart(groups)) > size:
        return None
    smallest: frozenset[int] = min(groups, key=len)
    for agent in sorted(smallest):
        left = [group for group in groups if agent not in group]
        rest = _of_size(left, size - 1, steps)
        if rest is not None:
            return (agent, *rest)
    return None


@noun
class SlowDirection:
    """w (n) >= 0 of one state component in one mode; no gains make the loop decay faster than
    ``limit`` (1/s) there."""

    mode: str
    component: int
    w: tuple[int, ...]
    limit: Fraction


def slow_direction(
    jacobians: Jacobians, pinned: AgentSet, caps: Gains, propose: Directions
) -> SlowDirection | None:
    """The proved direction with the lowest limit for scalar gains on the ``pinned`` agents; None
    without any."""
    best: SlowDirection | None = None
    free = set(pinned) - set(caps)
    for mode in jacobians.modes:
        if not mode.is_nonnegative_diagonal:
            continue
        for component in range(_components(mode)):
            for proposed in propose(mode, component, pinned, caps, size=jacobians.size):
                w = _direction(proposed, free)
                limit = limit_of(mode, component, w, pinned=pinned, caps=caps)
                if limit is not None and (best is None or limit < best.limit):
                    best = SlowDirection(mode=mode.name, component=component, w=w, limit=limit)
    return best


def _components(mode: ModeJacobian) -> int:
    """How many components have to be looked at: one stands for all where h acts on all alike."""
    gains = mode.gains
    width = len(gains[0]) if gains else 1
    for gain in gains:
        if any(gain[c][c] != gain[0][0] for c in range(width)):
            return width
    return 1


def _direction(proposed: Sequence[float], free: AgentSet) -> tuple[int, ...]:
    """A direction >= 0 as whole numbers, 0 on free agents; empty for one without numbers."""
    whole = _in_integers(proposed, FINE)
    return tuple(0 if i in free else max(0, x) for i, x in enumerate(whole))


def limit_of(
    mode: ModeJacobian, component: int, w: Sequence[int], *, pinned: AgentSet, caps: Gains
) -> Fraction | None:
    """The rate (1/s) out of reach by w: the largest -(M w)_i / w_i; None if w is 0, not >= 0 or
    moves a free agent."""
    free = set(pinned) - set(caps)
    if not any(w) or min(w) < 0 or any(w[i] for i in free) or not mode.is_nonnegative_diagonal:
        return None
    held = set(pinned) & set(caps)
    pull = {}
    for i, x in enumerate(w):
        if x:
            pull[i] = x * caps[i] if i in held else ZERO
    listeners = mode.arcs.listeners.tolist()
    speakers = mode.arcs.speakers.tolist()
    for i, j, kind in zip(listeners, speakers, mode.kind.tolist(), strict=True):
        if w[i] and w[i] != w[j]:
            gain = mode.gains[kind][component][component]
            pull[i] += (gain.hi if w[i] > w[j] else gain.lo) * (w[i] - w[j])
    return max(ZERO, *(value / w[i] for i, value in pull.items()))


def too_fast(problem: Problem, limits: Limits, propose: Directions) -> Statement | None:
    """A proof that no gains within the limits let every error decay at their rate (1/s). Whatever
    proves it; None if there is none.  Its kind is "pins" where every set of so many is excluded,
    "max_gain" where gains without caps are not excluded by the same means, else "rate"."""
    allowed = limits.allowed
    rate = limits.rate
    if rate is None or any(coupling.nonsmooth for coupling in problem.couplings):
        return None
    try:
        jacobians = jacobians_at_consensus(loop_of(problem))
    except UndefinedError:
        return None

    def slowest(agents: AgentSet, caps: Gains = limits.caps) -> SlowDirection | None:
        direction = slow_direction(jacobians, agents, caps, propose)
        return None if direction is None or direction.limit >= rate else direction

    found = slowest(allowed)
    if found is None:
        return _too_few_pins(rate, limits, slowest)
    # Caps are to blame if gains without them are not excluded.
    capped = bool(limits.caps) and slowest(allowed, {}) is None
    how = "with the allowed agents held exactly at the target"
    if capped or len(allowed) == problem.n:
        how = "with every gain at its cap"
    labels = problem.network.labels
    moved = [labels[i] for i, x in enumerate(found.w) if x]
    where = f" in mode {found.mode}" if len(problem.network.modes) > 1 else ""
    never = f"no gains let the errors decay at {typed_number(rate)} 1/s{where}"
    comes = "returns" if len(moved) == 1 else "return"
    pace = f"{comes} no faster than {_above(found.limit)} 1/s near the target"
    text = f"{never}: even {how}, {name_agents(moved)} {pace}."
    values = {
        "mode": found.mode,
        "component": str(found.component + 1),
        "limit": number_text(found.limit),
    }
    if len(found.w) <= LONGEST:
        values["w"] = ", ".join(map(str, found.w))
    return refuted("max_gain" if capped else "rate", text, **values)


def _too_few_pins(
    rate: Fraction,
    limits: Limits,
    slowest: Callable[[AgentSet], SlowDirection | None],
) -> Statement | None:
    """A proof that no so many of the allowed agents reach the rate: every set is excluded; None if
    one is not."""
    allowed = limits.allowed
    pins = limits.pins
    if not isinstance(pins, int):
        return None
    count = comb(len(allowed), pins)
    if pins >= len(allowed) or count > MOST_SETS:
        return None
    most = ZERO
    # Fewer pins do no better, so that sets of exactly so many are enough.
    for chosen in combinations(allowed, pins):
        found = slowest(chosen)
        if found is None:
            return None
        most = max(most, found.limit)
    few = f"{counted(pins, 'pinned agent')} cannot give the rate {typed_number(rate)} 1/s"
    excluded = f"all {counted(count, 'choice')} are excluded one by one"
    best = f"the best of them reaches {_above(most)} 1/s at most near the target"
    return refuted(
        "pins",
        f"{few}, whatever the gains: {excluded}, and {best}.",
        sets=str(count),
        limit=number_text(most),
    )


def _above(limit: Fraction) -> str:
    """At most four digits, not below."""
    return text_above(limit, digits=4) if limit else "0"
