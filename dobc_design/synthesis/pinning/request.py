"""What is asked of pinning gains: a decay rate, agents that may be pinned, costs, caps, how many pins, digits.

A noun, exact and checked; and gains as it wants them, rounded up to its digits.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, TypeVar

from dobc_design.errors import SpecError
from dobc_design.exact.number import parse_number
from dobc_design.exact.reading import is_list, named, shown, shown_number
from dobc_design.synthesis.observer.request import check_digits

FEWEST = "fewest"
NOISE = 1e-9  # gains below this part of the largest are left out
T = TypeVar("T")


@dataclass(frozen=True, slots=True, kw_only=True)
class PinningRequest:
    """What gains k_i have to do: Lambda(K) < -2 rate I in every mode, at the least sum of cost_i k_i.

    ``rate`` (1/s) > 0.  ``allowed``: agent indices, rising.  ``costs``: c_i > 0 of every agent.  ``caps``: the largest
    k_i (1/s) of agents that have one.  ``pins``: at most so many agents, "fewest", or None for any number.
    ``digits``: significant digits of the gains.
    """

    rate: Fraction
    allowed: tuple[int, ...]
    costs: tuple[Fraction, ...]
    caps: Mapping[int, Fraction]
    pins: int | str | None
    digits: int


def read_request(
    labels: Sequence[str],
    *,
    rate: Any,
    allowed: Any = None,
    cost: Any = None,
    max_gain: Any = None,
    pins: Any = None,
    digits: Any = 4,
) -> PinningRequest:
    """Read the arguments of ``design_pinning``; agents by label, numbers exactly.

    Raises: SpecError that names every wrong argument.
    """
    index, errors = {label: i for i, label in enumerate(labels)}, list[SpecError]()

    def read(reader: Callable[[], T], default: T) -> T:
        try:
            return reader()
        except SpecError as error:
            errors.extend(error.errors)
            return default

    read(lambda: check_digits(digits), None)
    read(lambda: _check_pins(pins), None)
    because = "V is to decrease at that rate, V' <= -2 rate V"
    speed = read(lambda: _positive(rate, "rate", because), Fraction(0))
    every = tuple(range(len(labels)))
    agents = every if allowed is None else read(lambda: _agents(allowed, index), every)
    none: dict[int, Fraction] = {}
    caps = none if max_gain is None else read(lambda: _by_agent(max_gain, index, key="max_gain"), none)
    costs = none if cost is None else read(lambda: _by_agent(cost, index, key="cost"), none)
    if errors:
        raise SpecError.several(errors)
    return PinningRequest(
        rate=speed,
        allowed=agents,
        costs=tuple(costs.get(i, Fraction(1)) for i in every),
        caps=caps,
        pins=pins,
        digits=digits,
    )


def _check_pins(pins: Any) -> None:
    if pins is not None and pins != FEWEST and (isinstance(pins, bool) or not isinstance(pins, int) or pins < 1):
        raise SpecError(
            f'pins must be an integer >= 1 or "{FEWEST}"; got {shown(pins)}.',
            key="pins",
            cure="Leave it out for any number of pinned agents.",
        )


def _agents(allowed: Any, index: Mapping[str, int]) -> tuple[int, ...]:
    if not is_list(allowed) and not isinstance(allowed, (set, frozenset, range)):
        raise SpecError(
            f"allowed must be a list of labels of agents; got {shown(allowed)}.",
            key="allowed",
            cure="Leave it out to allow every agent.",
        )
    found = sorted({_agent(label, index, key="allowed") for label in allowed})
    if not found:
        raise SpecError(
            "allowed must name at least one agent; got none.", key="allowed", cure="Leave it out to allow every agent."
        )
    return tuple(found)


def _agent(label: Any, index: Mapping[str, int], *, key: str) -> int:
    place = None if isinstance(label, bool) else index.get(str(label))
    if place is None:
        raise SpecError(
            f"{key}: there is no agent {shown(str(label))} in network.agents.",
            key=key,
            cure="Use the label of an agent.",
        )
    return place


def _by_agent(value: Any, index: Mapping[str, int], *, key: str) -> dict[int, Fraction]:
    """A number for all agents, or label -> number."""
    because = "a gain without cost has no best value" if key == "cost" else "a gain of 0 is no pin"
    if not isinstance(value, Mapping):
        return dict.fromkeys(range(len(index)), _positive(value, key, because))
    return {
        _agent(label, index, key=key): _positive(each, f"{key}.{named(str(label))}", because)
        for label, each in value.items()
    }


def _positive(value: Any, key: str, because: str) -> Fraction:
    number = parse_number(value, key=key)
    if number <= 0:
        raise SpecError(
            f"{key} must be > 0, because {because}; got {shown_number(number)}.",
            key=key,
            cure="Give a positive number.",
        )
    return number


def cost_of(request: PinningRequest, gains: Mapping[int, Fraction]) -> Fraction:
    """sum c_i k_i."""
    return sum((request.costs[i] * k for i, k in gains.items()), Fraction(0))


def typed_gains(gains: Mapping[int, float], *, digits: int, caps: Mapping[int, Fraction]) -> dict[int, Fraction]:
    """Gains rounded up to so many digits, or their caps where those are less; what is nearly 0 is left out."""
    least = max(gains.values(), default=0.0) * NOISE
    typed = {agent: rounded_up(Fraction(k), digits) for agent, k in sorted(gains.items()) if k > least}
    return {agent: min(k, caps.get(agent, k)) for agent, k in typed.items()}


def rounded_up(value: Fraction, digits: int) -> Fraction:
    """The next number of so many digits; ``value`` > 0."""
    unit = Fraction(10) ** (math.floor(math.log10(value)) - digits + 1)
    return math.ceil(value / unit) * unit
