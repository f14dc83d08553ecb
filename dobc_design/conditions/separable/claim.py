"""The max-separable certificate of theory, section 5: what it claims, and its rows.

For v > 0, a rate alpha and a radius rho the rows ask, for all s in (0, rho], every agent i and
every mode,

    upper:  sum_j w_ij sup { h_ij(y) : -s (v_i + v_j) <= y <= s (v_j - v_i) } <= -alpha s v_i

and the same for the lower face, whose couplings are -h_ij(-y).  The sum goes over all arcs of i,
those to the fixed node among them, whose weight v_j is 0 (section 14).  Such an arc is a pin.  With
a linear function, h(y) = k y, it adds -k s v_i: divided by s v_i that is one number for all s, and
a row keeps it as its ``pull``.  With another function it is a term like every other.

An arc that comes and goes adds at most the supremum over y from -s (v_i + v_j) to the larger of
s (v_j - v_i) and 0, where h(0) = 0.  Then N(e) = max_i |e_i|/v_i decays at the rate alpha while
N <= rho.  No monotonicity is needed.  Arcs that look alike share a term, so rows stay short.  Also
whether one v can serve all modes at all: for nondecreasing couplings an order of the agents decides
it, in time linear in the arcs.
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from fractions import Fraction
from functools import partial
from operator import mul
from typing import NamedTuple

import numpy as np

from dobc_design._checks import noun, positional
from dobc_design.conditions.check import Check, Claim, read_parts, with_optional
from dobc_design.conditions.kinds import READINGS
from dobc_design.conditions.numbers import (
    fields_to_json,
    form_from_json,
    positive_from_json,
    rational_or_none,
    read_rational,
    vector_from_json,
    vector_to_json,
)
from dobc_design.conditions.quadratic.sectors import GainRange, ranges_from_json
from dobc_design.errors import ShapeError, SpecError
from dobc_design.exact.matrix import Matrix, Vector, inverse, rank
from dobc_design.exact.number import ONE, ZERO, float_above
from dobc_design.exact.reading import Document
from dobc_design.exact.symmetric import Doubles, largest, least
from dobc_design.loop.arcs import coupling_places
from dobc_design.loop.loop import Loop

FACES = {1: "upper", -1: "lower"}
OBSERVED = ("P", "beta", "kappa", "size")
MOST_COMPONENTS = 6  # of an agent, for T
# the key under which a check of sampling holds one of its own, where it has one
OWN = "certificate"
TURNED: Document = {"T": form_from_json, "ranges": None}  # of claims in coordinates
MORE_OF_DELAYS = ("own_delay", "event")


@noun
class ErrorBound:
    """The observer's part of V = N + kappa E, E = max_i sqrt(eps_i' P eps_i).  P (q, q) symmetric
    with (A-WC)'P + P(A-WC) <= -2 beta P, c'c <= P for each row c of C and P <= size I; beta in 1/s,
    kappa > 1/(beta min v) in s."""

    P: Matrix
    beta: Fraction
    kappa: Fraction
    size: Fraction

    def fits(self, disturbance: Fraction, room: Fraction) -> bool:
        """Whether kappa E <= kappa disturbance sqrt(size) is at most ``room``; by squares, which
        need no root."""
        return room >= 0 and (self.kappa * disturbance) ** 2 * self.size <= room**2


def observed_in(loop: Loop) -> Document:
    """The shape of the observer's part of a claim (``read_parts``)."""
    if not loop.groups:
        return {}
    return {"P": form_from_json} | dict.fromkeys(OBSERVED[1:], positive_from_json)


def error_to_json(error: ErrorBound | None) -> Document:
    """The exact values of the observer's part, by the keys ``OBSERVED``; empty without one."""
    return {} if error is None else fields_to_json(error, *OBSERVED)


def error_of(values: Document) -> ErrorBound | None:
    """The observer's part, taken out of values that were read; None without an exosystem."""
    if "P" not in values:
        return None
    return ErrorBound(**{name: values.pop(name) for name in OBSERVED})


def coordinates_of(values: Document, loop: Loop) -> Document:
    """The same values with their gains, if they are in coordinates z = T e.  Raises as
    ``read_claim``."""
    if "T" in values:
        values["ranges"] = ranges_from_json(values["ranges"], loop, values["rho"])
    return values


@noun
class Separable:
    """A claim: the rows hold for v (one entry per agent), alpha (1/s) and all s in (0, rho].
    ``rho`` None: for every s > 0.  ``error``: the observer's part, None without an exosystem.  With
    ``T`` (m, m) the claim is about z_i = T e_i (``coordinates``): v has an entry for each
    component, ``ranges`` are the gains of couplings and nodes, and ``error`` belongs to the output
    T C.  Raises: ShapeError or SpecError unless v > 0, alpha > 0 and rho > 0."""

    v: Vector | Doubles
    alpha: Fraction
    rho: Fraction | None
    error: ErrorBound | None = None
    T: Matrix | None = None
    ranges: tuple[GainRange, ...] = ()

    def __post_init__(self) -> None:
        require_coordinates(self.T)
        m = len(self.T or (1,))
        if not len(self.v) or len(self.v) % m or least(self.v) <= 0:
            raise ShapeError(
                "v must have one entry > 0 per agent, or per component of z = T e.", key="v"
            )
        if self.alpha <= 0:
            raise SpecError("alpha and rho must be > 0.", key="alpha")
        if self.rho is not None and self.rho <= 0:
            raise SpecError("alpha and rho must be > 0.", key="rho")

    @property
    def least(self) -> Fraction:
        """Min v."""
        return least(self.v)

    @property
    def spread(self) -> Fraction:
        """The largest N of errors with |e|_inf <= 1."""
        return spread(self.T, self.v)

    @property
    def reach(self) -> Fraction:
        """The largest |e|_inf of errors with N <= 1."""
        return reach(self.T, self.v)

    @property
    def factor(self) -> Fraction:
        """|e(t)|_inf <= factor |e(0)|_inf exp(-rate t) + what the estimation error adds: max v /
        min v without T."""
        return self.spread * self.reach

    def to_json(self) -> Document:
        """The exact values of a proved max-separable check."""
        values = {"v": vector_to_json(self.v), **fields_to_json(self, "alpha", "rho")}
        if self.T is not None:
            values |= fields_to_json(self, "T", "ranges")
        return values | error_to_json(self.error)


def require_coordinates(T: Matrix | None) -> None:
    """Raise ShapeError unless T is None or invertible, of few rows."""
    if T is None:
        return
    m = len(T)
    is_square = all(len(row) == m for row in T)
    if not is_square or rank(T) < m or not 0 < m <= MOST_COMPONENTS:
        raise ShapeError(
            f"T must be an invertible matrix of at most {MOST_COMPONENTS} rows.", key="T"
        )


def spread(T: Matrix | None, v: Vector | Doubles) -> Fraction:
    """The largest N of errors with |e|_inf <= 1, for weights v of e or of T e."""
    rows = T or ((ONE,),)
    found = []
    for c, row in enumerate(rows):
        own = v[c :: len(rows)]  # of every agent
        found.append(sum(map(abs, row), ZERO) / least(own))
    return max(found)


def reach(T: Matrix | None, v: Sequence[Fraction]) -> Fraction:
    """The largest |e|_inf of errors with N <= 1."""
    return largest(v) if T is None else max(map(max, error_sizes(T, v)))


def error_sizes(T: Matrix, v: Sequence[Fraction]) -> Iterator[list[Fraction]]:
    """For every agent the largest |e_ic| where |(T e_i)_c| <= v_ic, c = 1, ..., m."""
    S = [[abs(x) for x in row] for row in inverse(T)]
    values = tuple(v)
    for first in range(0, len(values), len(T)):
        own = values[first : first + len(T)]
        yield [sum(map(mul, row, own), ZERO) for row in S]


@noun
class DelayBound:
    """For all delays up to ``delay`` (s) the error decays at ``rate`` (1/s); with an observer at
    every smaller rate.  At the same time own readings may be ``own_delay`` (s) old; readings that
    are off by the part ``event`` may take the place of late ones."""

    delay: Fraction
    rate: Fraction
    own_delay: Fraction = ZERO
    event: Fraction = ZERO

    def to_json(self) -> Document:
        """The exact values of a proved check of delays."""
        more = [name for name in MORE_OF_DELAYS if getattr(self, name)]
        return fields_to_json(self, "delay", "rate", *more)


@noun
class SamplingBound:
    """A certified sampling period (s), and by how much N falls from one sample to the next at
    least.  ``own``: the certificate whose N that is, where it is not the one beside it."""

    period: Fraction
    factor: Fraction
    own: Separable | None = None

    def to_json(self) -> Document:
        """The exact values of a proved check of sampling."""
        values = fields_to_json(self, "period", "factor")
        if self.own is not None:
            values[OWN] = self.own.to_json()
        return values


@noun
class ReadingsBound:
    """With readings and a processor as the problem states them ``rows`` holds: its alpha (1/s) is
    the rate, at the ticks where something is held; the beta of a sampled observer is one per
    tick."""

    rows: Separable

    def to_json(self) -> Document:
        """The exact values of a proved check of readings."""
        return self.rows.to_json()


def read_claim(check: Check, loop: Loop, W: Matrix | None) -> Claim:
    """What a proved check of this topic claims, for this problem."""
    exact = check.exact
    if check.id == READINGS:
        return ReadingsBound(rows=separable_from_json(exact, loop))
    if check.id == "delay":
        shape = dict.fromkeys(("delay", "rate"), read_rational)
        more = dict.fromkeys(MORE_OF_DELAYS, read_rational)
        return DelayBound(**read_parts(exact, with_optional(shape, more, exact)))
    if check.id == "sampling":
        own = None
        if exact is not None and OWN in exact:
            own = separable_from_json(exact.pop(OWN), loop)
        values = read_parts(exact, {"period": read_rational, "factor": read_rational})
        return SamplingBound(own=own, **values)
    return separable_from_json(exact, loop, turned="T" in (exact or ()))


def separable_from_json(exact: object, loop: Loop, *, turned: bool = False) -> Separable:
    """Read the values of ``Separable.to_json`` back for this problem, ``turned`` with T; raises as
    ``read_claim``."""
    size = loop.size if turned else loop.n
    shape = {"v": partial(vector_from_json, size=size), "alpha": read_rational}
    shape |= {"rho": rational_or_none} | observed_in(loop) | (TURNED if turned else {})
    values = coordinates_of(read_parts(exact, shape), loop)
    found = Separable(error=error_of(values), **values)
    if found.T is not None and len(found.T) != loop.m:
        raise ValueError("T needs one row and one column per state component")
    return found


class Errors(NamedTuple):
    """Relative errors of every arc weight, in [w (1 - weights), w (1 + weights)], and of every
    entry of a gain."""

    weights: Fraction = ZERO
    gains: Fraction = ZERO


EXACT = Errors()


def stated_errors(loop: Loop) -> Errors:
    """The errors that the problem states in [uncertainty]."""
    table = loop.uncertainty
    return EXACT if table is None else Errors(table.weights, table.gains)


@positional
class Term:
    """``weight`` times the largest h(y) on -s reach <= y <= s step; ``coupling`` is its place in
    loop.functions."""

    coupling: int
    weight: Fraction
    reach: Fraction
    step: Fraction


@positional
class Row:
    """One row without its agent, divided by s: the sum of its terms is to be at most
    (pull - alpha) own.

    ``own``: v_i.  ``pull`` (1/s): what is the same at every s, of which the linear arcs to the
    fixed node are the most; what grows like s and pushes outward is taken off it.  Agents in the
    same situation share a row.
    """

    terms: tuple[Term, ...]
    pull: Fraction
    own: Fraction


@positional
class Place:
    """Where a row stands: the first agent (index) and mode that have it, and how many do."""

    agent: int
    mode: str
    count: int


def holding_gains(loop: Loop, *, error: Fraction | int = 0) -> Vector:
    """What the linear pin of each agent is worth in a row: the least k_cc - sum_{d != c} |k_cd|;
    ``error``: relative, of every entry."""
    least = 1 - Fraction(error)
    most = 1 + Fraction(error)

    def worth(k: Matrix) -> Fraction:
        return min(
            least * row[c] - most * sum(map(abs, row[:c] + row[c + 1 :])) for c, row in enumerate(k)
        )

    return _by_agent(loop, worth)


def held_gains(loop: Loop) -> Vector:
    """How steep the linear pin of each agent is, the largest k_cc: what it can overshoot by in a
    step during which it is held."""
    return _by_agent(loop, lambda k: max(row[c] for c, row in enumerate(k)))


def tied_sizes(loop: Loop) -> dict[int, Fraction] | None:
    """By agent how much its arcs to fixed nodes, which may be pins, add to its input for each
    |e_i|: the largest sum of w |h'| of a mode, with the stated errors; None where one is curved."""
    found: dict[int, Fraction] = {}
    more = 1 + max(stated_errors(loop))
    for arcs in loop.modes.values() if loop.fixed else ():
        own: dict[int, Fraction] = {}
        for i, j, w in arcs.where(arcs.speakers >= loop.n):
            h = loop.function_of(i, j)
            if not h.is_linear:
                return None
            steepness = max(sum(x.magnitude for x in row) for row in h.jacobian_at_zero())
            own[i] = own.get(i, ZERO) + more * w * steepness
        found |= {i: max(size, found.get(i, ZERO)) for i, size in own.items()}
    return found


def _by_agent(loop: Loop, number: Callable[[Matrix], Fraction]) -> Vector:
    """A number of the linear pin of every agent, 0 for agents without one."""
    known = loop.pulls.each(number)
    return tuple(known.get(agent, ZERO) for agent in range(loop.n))


def acts_by_component(loop: Loop) -> bool:
    """Whether the certificate applies: every coupling acts by component, and nodes have no dynamics
    that are curved."""
    return loop.drift_place is None and all(coupling.by_component for coupling in loop.functions)


def largest_reach(loop: Loop, v: Sequence[Fraction], *, stretch: Fraction | int = 1) -> Vector:
    """A bound of v_i + stretch v_j over the arcs of each coupling, with room for rounding up; of
    v_i over the arcs to the fixed node.  Raises: ShapeError."""
    require_one_per_agent(loop, v)
    above = v.array if isinstance(v, Doubles) else np.array([float_above(x) for x in v])
    above = np.append(above, np.zeros(len(loop.fixed)))
    factor = float_above(Fraction(stretch))
    found = np.zeros(len(loop.functions))
    for arcs in loop.modes.values():
        np.maximum.at(
            found,
            coupling_places(loop, arcs),
            above[arcs.listeners] + factor * above[arcs.speakers],
        )
    return tuple(Fraction(most) * (1 + Fraction(1, 2**45)) for most in found.tolist())


def require_one_per_agent(loop: Loop, v: Sequence[Fraction]) -> None:
    """Raise ShapeError unless v has one entry per agent."""
    if len(v) != loop.n:
        raise ShapeError(f"v must have {loop.n} entries, one per agent; got {len(v)}.", key="v")


def rows(
    loop: Loop,
    v: Sequence[Fraction],
    *,
    modes: Sequence[str] | None = None,
    agents: Collection[int] | None = None,
    stretch: Fraction | int = 1,
    errors: Errors = EXACT,
    held: bool = False,
) -> Iterator[tuple[Row, Place]]:
    """List the different rows of the given modes and agents (default: all); both faces have the
    same terms.

    ``stretch`` >= 1 multiplies the v_j of those who are listened to (delays, theory section 5).
    ``errors``: weights and gains take their worse ends; where h may have either sign, the part of a
    weight that is unsure counts with the largest h on -s reach <= y <= 0.  So does an optional arc
    where it would pull inward, since it may be absent.  ``held``: rows of what is held between
    samples, where an arc is worst if it is there, and a pin by ``held_gains``.
    Raises: ShapeError unless v has one entry per agent."""
    require_one_per_agent(loop, v)
    pulls = held_gains(loop) if held else holding_gains(loop, error=errors.gains)
    # Many agents are in the same situation: their row is decided once.
    found: dict[Row, Place] = {}
    for mode in loop.modes if modes is None else modes:
        heard_by = _heard(loop, mode, v, agents, loose=not held)
        for agent, heard in heard_by.items():
            row = Row(tuple(_terms(heard, v[agent], stretch, errors)), pulls[agent], v[agent])
            known = found.get(row)
            if known is None:
                found[row] = Place(agent, mode, 1)
            else:
                found[row] = Place(known.agent, known.mode, known.count + 1)
    yield from found.items()


class Heard(NamedTuple):
    """What arcs of one agent have in common that add one term: the place of their function, the
    weight v_j of whom they hear, and whether they may be absent."""

    place: int
    other: Fraction  # 0 of a fixed node: h is taken at -s v_i alone
    absent: bool


def _heard(
    loop: Loop,
    mode: str,
    v: Sequence[Fraction],
    agents: Collection[int] | None,
    *,
    loose: bool,
) -> dict[int, dict[Heard, Fraction]]:
    """For every one of these agents (default: all) what it hears in a mode, by total weight."""
    arcs = loop.modes[mode]
    # Arcs that come and go are the last ones.
    sure = len(arcs) - arcs.optional if loose else len(arcs)
    if agents is None:
        numbers = np.arange(len(arcs))
    else:
        numbers = np.flatnonzero(np.isin(arcs.listeners, list(agents)))
    listeners = arcs.listeners[numbers].tolist()
    speakers = arcs.speakers[numbers].tolist()
    chosen = range(loop.n) if agents is None else agents
    found: dict[int, dict[Heard, Fraction]] = {agent: {} for agent in chosen}
    for arc, i, j in zip(numbers.tolist(), listeners, speakers, strict=True):
        heard = found[i]
        key = Heard(loop.place_of(i, j), v[j] if j < loop.n else ZERO, arc >= sure)
        heard[key] = heard.get(key, ZERO) + arcs.weights[arc]
    return found


def _terms(
    heard: Mapping[Heard, Fraction], own: Fraction, stretch: Fraction | int, errors: Errors
) -> Iterator[Term]:
    """The terms of an agent with v_i = ``own``."""
    for (place, other, absent), weight in sorted(heard.items()):
        # An arc to a fixed node may be a pin, and its weight a gain.
        error = errors.weights if other else max(errors)
        far = stretch * other
        reach = far + own
        step = far - own
        if absent:
            step = max(step, ZERO)
        term = Term(place, weight, reach, step)
        if error:
            yield from _at_worst(term, error)
        else:
            yield term


def _at_worst(term: Term, error: Fraction) -> Iterator[Term]:
    """The term at the worse end of its weight; ``error``: relative."""
    place = term.coupling
    weight = term.weight
    reach = term.reach
    step = term.step
    if step >= 0:
        yield Term(place, weight * (1 + error), reach, step)
        return
    yield Term(place, weight * (1 - error), reach, step)
    if error:
        # The rest may be there or not: it counts where h is largest, which is 0 if h rises.
        yield Term(place, 2 * error * weight, reach, ZERO)


def stuck_agents(loop: Loop, *, held: Collection[int] = ()) -> dict[int, str]:
    """The agents (indices) that no common v can hold, each with a mode in which its pin does not
    hold it and it hears nobody outside of them by an arc that is always there; empty if there are
    none.  ``held``: agents that are taken for pinned.

    Then no rows with alpha > 0 hold for any v > 0, whatever the couplings: take the agent of the
    set with the least v. Else the agents have an order in which each is pinned or hears an earlier
    one in every mode; for couplings that are nondecreasing, with a secant gain bounded away from 0
    on bounded sets, a common v exists for every radius then. "Pinned" means that the pin holds the
    agent in a row: k_cc - sum_{d != c} |k_cd| > 0 for every component c.  Fixed nodes come before
    all agents."""
    names = list(loop.modes)
    # Who listens to each agent: agent j is heard by listener[start[j]:start[j + 1]].
    listeners = []
    for arcs in (each.always for each in loop.modes.values()):
        order = np.argsort(arcs.speakers, kind="stable")
        start = np.searchsorted(arcs.speakers[order], np.arange(loop.nodes + 1))
        listeners.append((start.tolist(), arcs.listeners[order].tolist()))
    # Modes in which nobody earlier is heard yet.
    pinned = enumerate(_are_held(loop))
    waiting = [0 if is_held or agent in held else len(names) for agent, is_held in pinned]
    heard: list[set[int]] = [set() for _ in names]
    ordered = [agent for agent, count in enumerate(waiting) if not count]
    ordered += range(loop.n, loop.nodes)
    for agent in ordered:  # which grows meanwhile
        for number, (first, listener) in enumerate(listeners):
            for other in listener[first[agent] : first[agent + 1]]:
                if other not in heard[number]:
                    heard[number].add(other)
                    waiting[other] -= 1
                    if not waiting[other]:
                        ordered.append(other)
    stuck = sorted(set(range(loop.n)) - set(ordered))
    return {
        agent: next(name for name, known in zip(names, heard, strict=True) if agent not in known)
        for agent in stuck
    }


def pins_that_order(loop: Loop) -> list[int]:
    """Agents with pins on which no agent is stuck, few of them: the next one leaves the fewest."""
    found: list[int] = []

    def left_by(agent: int) -> int:
        return len(stuck_agents(loop, held=[*found, agent]))

    while stuck := stuck_agents(loop, held=found):
        found.append(min(stuck, key=left_by))
    return found


def is_stuck(loop: Loop, agents: Collection[int]) -> bool:
    """Whether every one of these agents has a mode in which it is not pinned and hears nobody
    outside them."""
    group = set(agents)
    held = _are_held(loop)
    unpinned = {agent for agent in group if not held[agent]}
    free = set[int]()
    for arcs in loop.modes.values():
        helped = {i for i, j, _ in arcs.always if j not in group}
        free |= unpinned - helped
    return bool(group) and free == group


def _are_held(loop: Loop) -> list[bool]:
    """For every agent whether its pin holds it in a row."""
    return [gain > 0 for gain in holding_gains(loop)]
