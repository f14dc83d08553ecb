"""Pinning gains on request: what is asked, what was found and proved, and the price of each limit
in words."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from itertools import islice
from typing import Any

from dobc_design._show.cards import Card, listed, plain
from dobc_design.conditions.consensus.network import name_agents
from dobc_design.conditions.numbers import rounded_up, shorten
from dobc_design.conditions.separable.claim import Separable
from dobc_design.conditions.statement import Statement
from dobc_design.conditions.weighted.decide import Weighted
from dobc_design.errors import SpecError, kept, raise_all
from dobc_design.exact.matrix import Vector
from dobc_design.exact.number import float_above, float_below, number_text
from dobc_design.exact.reading import is_list, named, shown
from dobc_design.problem.network import one_form
from dobc_design.problem.problem import Problem
from dobc_design.synthesis.observer.claim import Answer, check_digits, read_positive
from dobc_design.verdict import Verdict

Gains = Mapping[int, Fraction]  # or their caps, in 1/s, by agent index
FEWEST = "fewest"
POSITIVE = "Give a positive number."
NOISE = 1e-9  # gains below this part of the largest are left out
SHOWN = 5  # prices of one kind that are put into words
SHORT = 12  # letters of a rational that is shown as it is


@dataclass(frozen=True, slots=True, kw_only=True)
class PinningRequest:
    """What gains k_i have to do: every error decays at the ``rate`` (1/s) > 0 near the target, with
    one V for all modes, at the least sum of cost_i k_i.  ``conservative``: with V = e'e, Lambda(K)
    < -2 rate I; else V = e'De. ``allowed``: agent indices, rising.  ``costs``: c_i > 0 of every
    agent.  ``caps``: the largest k_i (1/s) of agents that have one.  ``pins``: at most so many
    agents, "fewest", or None for any number. ``digits``: significant digits of the gains."""

    rate: Fraction
    allowed: tuple[int, ...]
    costs: tuple[Fraction, ...]
    caps: Gains
    pins: int | str | None
    digits: int
    conservative: bool = False


def read_request(
    labels: Sequence[str],
    *,
    rate: Any,
    allowed: Any = None,
    cost: Any = None,
    max_gain: Any = None,
    pins: Any = None,
    digits: Any = 4,
    conservative: Any = False,
) -> PinningRequest:
    """Read the arguments of ``design_pinning``, exactly.  Raises: SpecError that names every wrong
    one."""
    index = {label: i for i, label in enumerate(labels)}
    because = ", because V is to decrease at that rate, V' <= -2 rate V"
    _, _, _, speed, agents, caps, costs = read_all(
        lambda: check_yes_or_no(
            conservative, "conservative", cure="True asks for V = e'e, without weights."
        ),
        lambda: check_digits(digits),
        lambda: _check_pins(pins),
        lambda: read_positive(rate, "rate", why=because, cure=POSITIVE),
        lambda: tuple(index.values()) if allowed is None else _agents(allowed, index),
        lambda: (
            {}
            if max_gain is None
            else _by_agent(max_gain, index, key="max_gain", why="a gain of 0 is no pin")
        ),
        lambda: (
            {}
            if cost is None
            else _by_agent(cost, index, key="cost", why="a gain without cost has no best value")
        ),
    )
    costs = tuple(costs.get(i, Fraction(1)) for i in range(len(labels)))
    own: dict[str, Any] = {"pins": pins, "digits": digits, "conservative": conservative}
    return PinningRequest(rate=speed, allowed=agents, costs=costs, caps=caps, **own)


def check_yes_or_no(value: Any, key: str, *, cure: str) -> None:
    """Raises: SpecError unless the value is True or False."""
    if not isinstance(value, bool):
        raise SpecError(f"{key} must be True or False; got {shown(value)}.", key=key, cure=cure)


def read_all(*readers: Callable[[], Any]) -> list[Any]:
    """What every reader returns.  Raises: SpecError with what each of them raises."""
    found, errors = [], list[SpecError]()
    for reader in readers:
        with kept(errors):
            found.append(reader())
    raise_all(errors)
    return found


def _check_pins(pins: Any) -> None:
    if (
        pins is not None
        and pins != FEWEST
        and (isinstance(pins, bool) or not isinstance(pins, int) or pins < 1)
    ):
        text = f'pins must be an integer >= 1 or "{FEWEST}"; got {shown(pins)}.'
        raise SpecError(text, key="pins", cure="Leave it out for any number of pinned agents.")


def _agents(allowed: Any, index: Mapping[str, int]) -> tuple[int, ...]:
    wrong = ""
    if not is_list(allowed) and not isinstance(allowed, (set, frozenset, range)):
        wrong = f"allowed must be a list of labels of agents; got {shown(allowed)}."
    elif not len(allowed):
        wrong = "allowed must name at least one agent; got none."
    if wrong:
        raise SpecError(wrong, key="allowed", cure="Leave it out to allow every agent.")
    return tuple(sorted({_agent(label, index, key="allowed") for label in allowed}))


def _agent(label: Any, index: Mapping[str, int], *, key: str) -> int:
    place = None if isinstance(label, bool) else index.get(one_form(label))
    if place is None:
        text = f"{key}: there is no agent {shown(str(label))} in network.agents."
        raise SpecError(text, key=key, cure="Use the label of an agent.")
    return place


def _by_agent(value: Any, index: Mapping[str, int], *, key: str, why: str) -> dict[int, Fraction]:
    """A number for all agents, or label -> number."""
    read = partial(read_positive, why=f", because {why}", cure=POSITIVE)
    if not isinstance(value, Mapping):
        return dict.fromkeys(range(len(index)), read(value, key))
    return {
        _agent(label, index, key=key): read(x, f"{key}.{named(str(label))}")
        for label, x in value.items()
    }


def typed_gains(gains: Mapping[int, float], *, digits: int, caps: Gains) -> dict[int, Fraction]:
    """Gains rounded up to so many digits, or their caps where those are less; what is nearly 0 is
    left out."""
    least = max(gains.values(), default=0.0) * NOISE
    typed = {
        agent: rounded_up(Fraction(k), digits=digits)
        for agent, k in sorted(gains.items())
        if k > least
    }
    return {agent: min(k, caps.get(agent, k)) for agent, k in typed.items()}


@dataclass(frozen=True, slots=True, kw_only=True)
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Structure:
    """``groups``: agent indices, each group needs a pin.  ``least``: no fewer allowed agents meet
    all groups. ``exact``: so many do (``agents`` are such); False where the groups overlap in too
    many ways.  ``apart``: groups without a common agent.  ``unmet``: a group without an allowed
    agent, or None."""

    groups: tuple[tuple[int, ...], ...]
    least: int
    exact: bool
    agents: tuple[int, ...]
    apart: tuple[tuple[int, ...], ...]
    unmet: tuple[int, ...] | None


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class PinningDesign(Answer):
    """Pinning gains and what is known of them.

    ``verdict``: PROVED, ``gains`` (1/s, exact, by label) do what was asked, by ``weights`` of V =
    e'De, or where these are None by Lambda < -2 ``rate`` I in every mode (V = e'e); REFUTED, no
    gains can, and ``reason`` is the proof in words; UNDECIDED, neither was shown.  ``cost``: sum of
    cost_i k_i.  ``lower_bound``: no gains that do what was asked cost less (proved); ``bound``: the
    exact multipliers that show it for gains on the agents named in ``bound_for``.  ``prices``: what
    each limit costs, in words. ``structural_minimum``: so many pins are needed whatever the gains
    (None if it was not found).  ``ties``: agents that are as good.  ``problem``: the problem with
    these gains.  ``nearest``: the design for the nearest request that was proved possible, where
    this one was not.  ``radius`` and ``certificate``: of a design over a region, what is proved for
    ``problem`` there.
    """

    request: PinningRequest
    gains: Mapping[str, Fraction]
    rate: Fraction | None = None
    cost: Fraction | None = None
    lower_bound: Fraction | None = None
    bound: Bound | None = None
    bound_for: tuple[str, ...] = ()
    structural_minimum: int | None = None
    prices: tuple[str, ...] = ()
    ties: tuple[str, ...] = ()
    problem: Problem | None = None
    nearest: PinningDesign | None = None
    radius: Fraction | None = None
    certificate: Separable | None = None
    weights: Weighted | None = None

    @property
    def gap(self) -> float | None:
        """(cost - lower bound) / cost, rounded up: nothing that does what was asked is cheaper by
        more than this."""
        if self.cost is None or self.lower_bound is None or not self.cost:
            return None
        return float_above((self.cost - self.lower_bound) / self.cost)

    @property
    def method(self) -> str:
        """What proves the rate: "consensus" (V = e'e), "weighted" (V = e'De) or, over a region,
        "max-separable"."""
        agents = self.problem is not None and self.problem.dynamics is not None
        near = "weighted" if self.weights is not None or agents else "consensus"
        return near if self.radius is None else "max-separable"

    def __str__(self) -> str:
        lines = [f"{self.verdict.value}: {self.reason}"]
        if self.gains:
            lines.append(f"pinned: {name_agents(tuple(self.gains))}")
        lines += [f"  {each}" for each in (*self.statements, *self.prices, *self.ties)]
        return "\n".join(lines)

    def _card(self) -> Card:
        facts: list[tuple[str, Any]] = []
        if self.gains:
            pairs = [f"{label}: {plain(k)}" for label, k in islice(self.gains.items(), 13)]
            facts.append(("gains in 1/s", listed(pairs, count=len(self.gains))))
        numbers = (
            ("rate in 1/s", self.rate, float_below),
            ("cost at most", self.cost, float_above),
            ("no cheaper than", self.lower_bound, float_below),
            ("radius", self.radius, float_below),
        )
        for name, value, rounded in numbers:
            if value is not None:
                facts.append(
                    (name, str(value) if len(str(value)) < SHORT else repr(rounded(value)))
                )
        if self.structural_minimum is not None:
            facts.append(("pins needed at least", self.structural_minimum))
        return self._card_of("Pinning design", facts, (*self.prices, *self.ties))

    def to_json(self) -> dict[str, Any]:
        """JSON object; exact numbers as text, bounds as numbers rounded towards the weaker
        claim."""
        return {
            "verdict": self.verdict.value,
            "reason": self.reason,
            "gains": {label: number_text(k) for label, k in self.gains.items()},
            "rate": None if self.rate is None else number_text(self.rate),
            "cost": None if self.cost is None else float_above(self.cost),
            "lower_bound": None if self.lower_bound is None else float_below(self.lower_bound),
            "structural_minimum": self.structural_minimum,
            "method": self.method,
            "radius": None if self.radius is None else number_text(self.radius),
            "statements": [statement.to_json() for statement in self.statements],
            "prices": list(self.prices),
            "ties": list(self.ties),
            "nearest": None if self.nearest is None else self.nearest.to_json(),
        }


def without_gains(
    request: PinningRequest,
    structure: Structure,
    obstacle: Statement | None,
    *,
    radius: Fraction | None = None,
) -> PinningDesign:
    """REFUTED or UNDECIDED as the statement says; UNDECIDED without one."""
    unknown = (
        "no gains were found that are proved to reach the rate, and no proof that there are none."
    )
    return PinningDesign(
        verdict=Verdict.UNDECIDED if obstacle is None else obstacle.verdict,
        request=request,
        gains={},
        structural_minimum=structure.least if structure.exact else None,
        reason=unknown if obstacle is None else obstacle.text,
        statements=() if obstacle is None else (obstacle,),
        radius=radius,
    )


def prices_in_words(
    problem: Problem, request: PinningRequest, bound: Bound, agents: Collection[int]
) -> Iterator[str]:
    """What each limit costs, from the exact multipliers; ``agents`` are those that may have a gain
    in the bound."""
    labels = problem.network.labels
    if not bound.vectors:
        return
    value, price = _down(bound.value), _down(bound.rate_price)
    base = number_text(bound.rate)
    yield (
        f"Rate: a larger rate b costs at least {value} + {price} (b - {base}) with gains on "
        "these agents."
    )
    for i in sorted(bound.cap_prices, key=lambda i: (-bound.cap_prices[i], i))[:SHOWN]:
        yield (
            f"Cap of agent {labels[i]}: each 1/s more of it saves at most "
            f"{_up(bound.cap_prices[i])}."
        )
    gain = {i: load - request.costs[i] for i, load in enumerate(bound.loads) if i not in agents}
    best = [i for i in sorted(gain, key=lambda i: (-gain[i], i)) if gain[i] > 0][:SHOWN]
    if best:
        most = ", ".join(f"agent {labels[i]} at most {_up(gain[i])}" for i in best)
        yield f"Agents left out: each 1/s of gain would save, after its own cost, {most}."
    elif gain:
        yield "Agents left out: a gain on any one of them would save nothing."


def _down(value: Fraction) -> str:
    return f"{shorten(value, digits=6):.6g}"


def _up(value: Fraction) -> str:
    return f"{float(rounded_up(value, digits=6)):.6g}"
