"""Pinning gains on request: what is asked, what was found and proved, and the price of each limit
in words."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from fractions import Fraction
from functools import partial
from itertools import islice
from typing import Any, Protocol

from dobc_design._checks import noun
from dobc_design._show.cards import Card, listed, plain
from dobc_design.conditions.consensus.network import name_agents
from dobc_design.conditions.numbers import (
    fields_to_json,
    rounded_up,
    shorten,
    text_above,
    text_below,
)
from dobc_design.conditions.separable.claim import ErrorBound, Separable
from dobc_design.conditions.statement import Statement
from dobc_design.conditions.weighted.decide import Weighted
from dobc_design.errors import Mistakes, about, wrong
from dobc_design.exact.matrix import Matrix, Vector
from dobc_design.exact.number import ONE, ZERO, float_above, float_below, number_text
from dobc_design.exact.reading import (
    Document,
    Names,
    Texts,
    flag,
    is_list,
    named,
    shown,
    shown_number,
)
from dobc_design.problem.changes import changed_problem
from dobc_design.problem.network import Index, one_form
from dobc_design.problem.problem import Problem
from dobc_design.synthesis.observer.claim import Answer, check_digits, read_positive
from dobc_design.verdict import Verdict

Agents = tuple[int, ...]  # by index
AgentSet = Collection[int]  # in any order
Gains = Mapping[int, Fraction]  # or their caps, in 1/s, by agent index
FEWEST = "fewest"
POSITIVE = "Give a positive number."
NOISE = 1e-9  # gains below this part of the largest are left out
SHOWN = 5  # prices or ties of one kind that are put into words
SHORT = 12  # letters of a rational that is shown as it is
NONE_FOUND = (
    "no gains were found that are proved to reach the rate, and no proof that there are none."
)


@noun
class Limits:
    """What every request of gains k_i has: the ``rate`` (1/s) to be reached, None leaves it open;
    ``allowed``: agent indices, rising; ``caps``: the largest k_i (1/s) of agents that have one;
    ``pins``: at most so many agents; ``digits``: significant digits of the gains."""

    rate: Fraction | None
    allowed: Agents
    caps: Gains
    pins: int | str | None
    digits: int
    conservative: bool = False


@noun
class PinningRequest(Limits):
    """What gains k_i have to do: every error decays at the ``rate`` (1/s) > 0 near the target, with
    one V for all modes, at the least sum of cost_i k_i.  ``conservative``: with V = e'e, Lambda(K)
    < -2 rate I; else V = e'De. ``costs``: c_i > 0 of every agent.  ``pins``: also "fewest", or
    None for any number."""

    rate: Fraction
    costs: tuple[Fraction, ...]


@noun
class AskedGains:
    """The arguments of ``design_pinning`` as they were given, not yet read."""

    rate: Any
    allowed: Any = None
    cost: Any = None
    max_gain: Any = None
    pins: Any = None
    digits: Any = 4
    conservative: Any = False


def read_request(labels: Names, asked: AskedGains) -> PinningRequest:
    """Read the arguments of ``design_pinning``, exactly.  Raises: SpecError that names every wrong
    one."""
    index = {label: i for i, label in enumerate(labels)}
    # All that is wrong is said at once.
    errors = Mistakes()
    with errors:
        cure = "True asks for V = e'e, without weights."
        flag(asked.conservative, "conservative", cure)
    with errors:
        check_digits(asked.digits)
    with errors:
        _check_pins(asked.pins)
    with errors:
        because = ", because V is to decrease at that rate, V' <= -2 rate V"
        rate = read_positive(asked.rate, "rate", why=because, cure=POSITIVE)
    with errors:
        allowed = _agents(asked.allowed, index)
    with errors:
        caps = _by_agent(asked.max_gain, index, key="max_gain", why="a gain of 0 is no pin")
    with errors:
        why = "a gain without cost has no best value"
        costs = _by_agent(asked.cost, index, key="cost", why=why)
    errors.raise_all()
    return PinningRequest(
        rate=rate,
        allowed=allowed,
        costs=tuple(costs.get(i, ONE) for i in range(len(labels))),
        caps=caps,
        pins=asked.pins,
        digits=asked.digits,
        conservative=asked.conservative,
    )


def _check_pins(pins: Any) -> None:
    if pins is None or pins == FEWEST:
        return
    # True and False are integers of Python.
    is_number = isinstance(pins, int) and not isinstance(pins, bool)
    if not is_number or pins < 1:
        raise wrong(
            "pins",
            f'must be an integer >= 1 or "{FEWEST}"; got {shown(pins)}.',
            "Leave it out for any number of pinned agents.",
        )


def _agents(allowed: Any, index: Index) -> Agents:
    if allowed is None:
        return tuple(index.values())
    must = ""
    if not is_list(allowed) and not isinstance(allowed, (set, frozenset, range)):
        must = f"must be a list of labels of agents; got {shown(allowed)}."
    elif not len(allowed):
        must = "must name at least one agent; got none."
    if must:
        raise wrong("allowed", must, "Leave it out to allow every agent.")
    agents = {_agent(label, index, key="allowed") for label in allowed}
    return tuple(sorted(agents))


def _agent(label: Any, index: Index, *, key: str) -> int:
    place = None
    # True would stand for agent 1.
    if not isinstance(label, bool):
        place = index.get(one_form(label))
    if place is None:
        raise about(
            key,
            f"there is no agent {shown(str(label))} in network.agents.",
            "Use the label of an agent.",
        )
    return place


def _by_agent(value: Any, index: Index, *, key: str, why: str) -> dict[int, Fraction]:
    """A number for all agents, or label -> number; None for none."""
    if value is None:
        return {}
    read = partial(read_positive, why=f", because {why}", cure=POSITIVE)
    if not isinstance(value, Mapping):
        return dict.fromkeys(range(len(index)), read(value, key))
    found = {}
    for label, x in value.items():
        agent = _agent(label, index, key=key)
        found[agent] = read(x, f"{key}.{named(str(label))}")
    return found


def typed_gains(gains: Mapping[int, float], limits: Limits) -> dict[int, Fraction]:
    """Gains rounded up to the digits asked for, or their caps where those are less; what is nearly
    0 is left out."""
    # A gain of the size of rounding errors would pin an agent for nothing.
    least = max(gains.values(), default=0.0) * NOISE
    typed = {}
    for agent, k in sorted(gains.items()):
        if k > least:
            # down would lose the rate; a cap is a limit even so
            larger = rounded_up(Fraction(k), digits=limits.digits)
            typed[agent] = min(larger, limits.caps.get(agent, larger))
    return typed


@noun
class Bound:
    """A proved lower bound of the cost at a rate, and what shows it: exact, to be multiplied out by
    anybody. ``vectors``: mode and v (n m).  ``loads``: sum_r |v_r,i|^2 of every agent.
    ``cap_prices``: y_i > 0 by agent. ``rate_price``: at any other rate b the cost is at least value
    + rate_price (b - rate), by the same vectors."""

    value: Fraction
    rate: Fraction
    vectors: tuple[tuple[str, Vector], ...]
    loads: tuple[Fraction, ...]
    cap_prices: Gains
    rate_price: Fraction


@noun
class Structure:
    """``groups``: agent indices, each group needs a pin.  ``least``: no fewer allowed agents meet
    all groups. ``exact``: so many do (``agents`` are such); False where the groups overlap in too
    many ways.  ``apart``: groups without a common agent.  ``unmet``: a group without an allowed
    agent, or None."""

    groups: tuple[Agents, ...]
    least: int
    exact: bool
    agents: Agents
    apart: tuple[Agents, ...]
    unmet: Agents | None


@noun
class Region:
    """Starts |e|_inf <= radius and |eps_i| <= disturbance.

    ``rho``: the box of the certificate, with room for the observer; None for linear couplings,
    where every start is covered.  ``error`` and ``W``: the observer's part where disturbance > 0.
    """

    radius: Fraction
    rho: Fraction | None
    disturbance: Fraction = ZERO
    error: ErrorBound | None = None
    W: Matrix | None = None

    def __str__(self) -> str:
        errors = f", |eps_i| <= {shown_number(self.disturbance)}" if self.disturbance else ""
        return f"|e_i| <= {shown_number(self.radius)}{errors}"


@noun
class Alternatives:
    """Agents that are as good: ``others`` by the pinned agent whose place one of them may take, and
    whole sets (``rivals``) that were met on the way."""

    others: Mapping[str, Names]
    rivals: Sequence[Names]

    def sentences(self) -> Iterator[str]:
        rivals = self.rivals
        for pinned, names in self.others.items():
            alike = f"{name_agents(names)} would cost the same (to six digits)."
            yield f"In place of agent {pinned}, {alike}"
        if not rivals:
            return
        sets = "; ".join(name_agents(rival) for rival in rivals[:SHOWN])
        left = len(rivals) - SHOWN
        more = f"; and {left} more." if left > 0 else "."
        yield f"As good (to six digits) among the sets that were met: {sets}{more}"


class Whole(Protocol):
    """A whole design that pinning gains may belong to, in words."""

    @property
    def reason(self) -> str: ...
    @property
    def decisions(self) -> Texts: ...
    @property
    def prices(self) -> Texts: ...


@noun
class PinningDesign(Answer):
    """Pinning gains and what is known of them.

    ``verdict``: PROVED, ``gains`` (1/s, exact, by label) do what was asked, by ``weights`` of V =
    e'De, or where these are None by Lambda < -2 ``rate`` I in every mode (V = e'e); REFUTED, no
    gains can, and ``reason`` is the proof in words; UNDECIDED, neither was shown.  ``cost``: sum of
    cost_i k_i.  ``lower_bound``: no gains that do what was asked cost less (proved); ``bound``: the
    exact multipliers that show it for gains on the agents named in ``bound_for``.  ``prices``: what
    each limit costs, in words. ``structural_minimum``: so many pins are needed whatever the gains
    (None if it was not found).  ``ties``: agents that are as good, in words.  ``problem``: the
    problem with these gains.  ``nearest``: the design for the nearest request that was proved
    possible, where this one was not.  ``region``, ``radius`` and ``certificate``: of a design over
    a region, what is asked and proved for ``problem`` there.  ``whole``: of agents with [dynamics],
    the whole design that these gains belong to.
    """

    request: PinningRequest
    gains: Mapping[str, Fraction]
    rate: Fraction | None = None
    cost: Fraction | None = None
    lower_bound: Fraction | None = None
    bound: Bound | None = None
    bound_for: Texts = ()
    structural_minimum: int | None = None
    alternatives: Alternatives | None = None
    problem: Problem | None = None
    nearest: PinningDesign | None = None
    region: Region | None = None
    certificate: Separable | None = None
    weights: Weighted | None = None
    whole: Whole | None = None

    @property
    def radius(self) -> Fraction | None:
        """Of a design over a region, the largest |e_i| of a start."""
        return None if self.region is None else self.region.radius

    @property
    def gap(self) -> float | None:
        """(cost - lower bound) / cost, rounded up: nothing that does what was asked is cheaper by
        more than this."""
        cost = self.cost
        if cost is None or self.lower_bound is None or not cost:
            return None
        return float_above((cost - self.lower_bound) / cost)

    @property
    def method(self) -> str:
        """What proves the rate: "consensus" (V = e'e), "weighted" (V = e'De) or, over a region,
        "max-separable"."""
        if self.region is not None:
            return "max-separable"
        agents = self.problem is not None and self.problem.dynamics is not None
        return "weighted" if self.weights is not None or agents else "consensus"

    @property
    def prices(self) -> Texts:
        """What each limit costs, in words."""
        if self.whole is not None:
            return self.whole.prices
        if self.bound is None or self.problem is None:
            return ()
        labels = self.problem.network.labels
        return tuple(prices_in_words(labels, self.request, self.bound, set(self.bound_for)))

    @property
    def ties(self) -> Texts:
        """Agents that are as good as the pinned ones, in words."""
        return () if self.alternatives is None else tuple(self.alternatives.sentences())

    def _why(self) -> str:
        whole = self.whole
        if whole is not None:
            return " ".join([whole.reason, *whole.decisions])
        if self.obstacle is not None:
            return self.obstacle.text
        if not self.is_proved:
            return NONE_FOUND
        over = ""
        # What proves it, or what bounds the cost.
        by = ", by V = e'e."
        if self.region is not None:
            over = f" over {self.region}"
            by = "."
        elif self.weights is not None:
            over = " near the target"
            by = ", by V = e'De with a weight for each agent (the true local rate)."
        elif self.lower_bound is not None:
            least = shorten(self.lower_bound, digits=6)
            by = f", and nothing that does costs less than {least:.6g}."
        rate = shown_number(self.rate or ZERO)
        cost = float(self.cost or 0)
        who = name_agents(tuple(self.gains))
        return f"gains on {who} reach the rate {rate}{over} at the cost {cost:.6g}{by}"

    def __str__(self) -> str:
        lines = [f"{self.verdict.value}: {self.reason}"]
        if self.gains:
            lines.append(f"pinned: {name_agents(tuple(self.gains))}")
        lines += [f"  {each}" for each in (*self.statements, *self.prices, *self.ties)]
        return "\n".join(lines)

    def _card(self) -> Card:
        facts = list[tuple[str, Any]]()
        if self.gains:
            pairs = [f"{label}: {plain(k)}" for label, k in islice(self.gains.items(), 13)]
            facts.append(("gains in 1/s", listed(pairs, count=len(self.gains))))
        # Each is rounded towards the weaker claim.
        sizes = (
            ("rate in 1/s", self.rate, float_below),
            ("cost at most", self.cost, float_above),
            ("no cheaper than", self.lower_bound, float_below),
            ("radius", self.radius, float_below),
        )
        for name, value, weaker in sizes:
            if value is not None:
                # A rational stands as it is where it is short.
                text = str(value)
                facts.append((name, text if len(text) < SHORT else repr(weaker(value))))
        if self.structural_minimum is not None:
            facts.append(("pins needed at least", self.structural_minimum))
        return self._card_of("Pinning design", facts, (*self.prices, *self.ties))

    def to_json(self) -> Document:
        """JSON object; exact numbers as text, bounds as numbers rounded towards the weaker
        claim."""
        names = (
            "structural_minimum",
            "method",
            "radius",
            "statements",
            "prices",
            "ties",
            "nearest",
        )
        return {
            "verdict": self.verdict.value,
            **fields_to_json(self, "reason", "gains", "rate"),
            "cost": None if self.cost is None else float_above(self.cost),
            "lower_bound": None if self.lower_bound is None else float_below(self.lower_bound),
            **fields_to_json(self, *names),
        }


def without_gains(
    request: PinningRequest,
    structure: Structure,
    obstacle: Statement | None,
    *,
    region: Region | None = None,
) -> PinningDesign:
    """REFUTED or UNDECIDED as the statement says; UNDECIDED without one."""
    return PinningDesign(
        verdict=Verdict.UNDECIDED if obstacle is None else obstacle.verdict,
        request=request,
        gains={},
        structural_minimum=structure.least if structure.exact else None,
        obstacle=obstacle,
        statements=() if obstacle is None else (obstacle,),
        region=region,
    )


def with_gains(
    request: PinningRequest, structure: Structure, gains: Gains, held: Problem
) -> PinningDesign:
    """The design of gains that are proved for the problem ``held``, which has them."""
    return PinningDesign(
        verdict=Verdict.PROVED,
        request=request,
        gains={held.network.labels[i]: k for i, k in gains.items()},
        rate=request.rate,
        cost=sum((request.costs[i] * k for i, k in gains.items()), ZERO),
        structural_minimum=structure.least if structure.exact else None,
        problem=held,
    )


def holding(problem: Problem, gains: Gains) -> Problem:
    """The problem with these gains (1/s, by agent index) and no others."""
    labels = problem.network.labels
    named = {labels[i]: k for i, k in gains.items()}
    return changed_problem(problem, {"pinning.gains": named})


#: Prices are rounded towards the weaker claim: what costs down, what saves up.
_down = partial(text_below, digits=6)
_up = partial(text_above, digits=6)


def prices_in_words(
    labels: Names, request: PinningRequest, bound: Bound, agents: Collection[str]
) -> Iterator[str]:
    """What each limit costs, from the exact multipliers; ``agents`` are those that may have a gain
    in the bound."""
    if not bound.vectors:
        return
    base = number_text(bound.rate)
    line = f"{_down(bound.value)} + {_down(bound.rate_price)} (b - {base})"
    yield f"Rate: a larger rate b costs at least {line} with gains on these agents."
    for i in _largest(bound.cap_prices)[:SHOWN]:
        most = _up(bound.cap_prices[i])
        yield f"Cap of agent {labels[i]}: each 1/s more of it saves at most {most}."
    left_out = [i for i, label in enumerate(labels) if label not in agents]
    saved = {i: bound.loads[i] - request.costs[i] for i in left_out}
    best = [i for i in _largest(saved) if saved[i] > 0][:SHOWN]
    if best:
        most = ", ".join(f"agent {labels[i]} at most {_up(saved[i])}" for i in best)
        yield f"Agents left out: each 1/s of gain would save, after its own cost, {most}."
    elif saved:
        yield "Agents left out: a gain on any one of them would save nothing."


def _largest(values: Gains) -> list[int]:
    """Agents, those with the largest values first."""
    return sorted(values, key=lambda i: (-values[i], i))
