"""What the model leaves out, bounded: [uncertainty], and what the actuators can give:
[actuators]."""

from collections.abc import Mapping
from fractions import Fraction
from types import MappingProxyType
from typing import Any

from dobc_design._checks import later, noun, put
from dobc_design._show.cards import Card, Shown
from dobc_design.errors import Mistakes, wrong
from dobc_design.exact.number import ZERO, parse_number
from dobc_design.exact.reading import Document, Names, items, positive_number, shown, shown_number

from .bands import Band, band_words, read_bands

RELATIVE = ("weights", "gains")
BOUNDS = ("disturbance", "drift", "measurement")
#: What acts on the plant however near the target it is.
ABSOLUTE = (*BOUNDS, "bands")


@noun
class Uncertainty(Shown):
    """How far the plant may be from the model; numbers are exact, 0 where nothing is given.

    weights, gains: largest relative error of every arc weight and every pinning gain, >= 0 and < 1.
    known_to_agents: whether the observers use the true couplings; else their model of them is off
        by that much.
    disturbance: bound on every component of the part of d_i that the exosystem does not generate.
    drift: bound on xi' - A xi.
    measurement: bound on the noise of every measured state.
    bands: (low, high, amplitude) of sines of an unknown frequency in d_i, low and high in rad/s;
        None without any.
    Raises: SpecError that names every wrong key.
    """

    weights: Fraction = ZERO
    gains: Fraction = ZERO
    known_to_agents: bool = True
    disturbance: Fraction = ZERO
    drift: Fraction = ZERO
    measurement: Fraction = ZERO
    bands: tuple[Band, ...] | None = later()

    def __post_init__(self) -> None:
        errors = Mistakes()
        with errors:
            put(self, bands=read_bands(self.bands))
        for name in (*RELATIVE, *BOUNDS):
            with errors:
                value, key = getattr(self, name), f"uncertainty.{name}"
                put(self, **{name: _bound(value, key, below=name in RELATIVE)})
        with errors:
            # "false" in quotes would be true.
            known: object = self.known_to_agents
            if not isinstance(known, bool):
                raise wrong(
                    "uncertainty.known_to_agents",
                    f"must be true or false; got {shown(known)}.",
                    "Leave it out where the agents know their couplings.",
                )
        errors.raise_all()

    def _card(self) -> Card:
        bounds = [(name, getattr(self, name)) for name in (*RELATIVE, *BOUNDS)]
        facts = [(name, x) for name, x in bounds if x]
        facts += [("of d_i", band_words(band)) for band in self.bands or ()]
        if not self.known_to_agents:
            facts.append(("the agents' couplings", "off by as much"))
        return Card(title="Uncertainty", text="at most", facts=facts)


@noun
class Actuators(Shown):
    """What actuators can give.

    limit: bound on every component of u_i, a number for all agents, or label -> number.
    amplitude: bound on every component of d_i, by default that of the runs from simulation.xi0.
    saturates: whether inputs may reach their limits, so that a proof has to count what is left of
        them; else it shows that none is reached.
    Raises: SpecError that names every wrong key.
    """

    limit: Fraction | Mapping[str, Fraction] | None = None
    amplitude: Fraction | None = None
    saturates: bool | None = later()

    def __post_init__(self) -> None:
        errors = Mistakes()
        with errors:
            _read_saturates(self)
        with errors:
            if isinstance(self.limit, Mapping):
                limits = {}
                for x, u in self.limit.items():
                    limits[str(x)] = positive_number(u, f"actuators.limit.{x}", "unit of u")
                put(self, limit=MappingProxyType(limits))
            elif self.limit is not None:
                put(self, limit=positive_number(self.limit, "actuators.limit", "unit of u"))
        with errors:
            if self.amplitude is not None:
                put(self, amplitude=_bound(self.amplitude, "actuators.amplitude"))
        errors.raise_all()

    def __hash__(self) -> int:
        return hash(self.amplitude)

    def limit_of(self, label: str) -> Fraction | None:
        """The limit of one agent; None where it has none."""
        return self.limit.get(label) if isinstance(self.limit, Mapping) else self.limit

    def _card(self) -> Card:
        facts = []
        if self.amplitude is not None:
            facts.append(("|d_i| at most", self.amplitude))
        if isinstance(self.limit, Mapping):
            facts += [(f"|u| of {label} at most", x) for label, x in self.limit.items()]
        elif self.limit is not None:
            facts.append(("|u_i| at most", self.limit))
        text = "inputs saturate at their limits" if self.saturates else ""
        return Card(title="Actuators", text=text, facts=facts)


def read_uncertainty(value: Any) -> Uncertainty | None:
    """Read the [uncertainty] table.  Raises: SpecError that names every wrong key."""
    if value is None or isinstance(value, Uncertainty):
        return value
    return Uncertainty(**_known(value, Uncertainty))


def read_actuators(value: Any, labels: Names) -> Actuators | None:
    """Read the [actuators] table.  Raises: SpecError that names every wrong key and every unknown
    agent."""
    if value is None:
        return None
    found = value if isinstance(value, Actuators) else Actuators(**_known(value, Actuators))
    errors = Mistakes()
    if isinstance(found.limit, Mapping):
        for label in set(found.limit) - set(labels):
            errors.append(
                wrong(
                    f"actuators.limit.{label}",
                    f"there is no agent {shown(label)} in network.agents.",
                    "Use the label of an agent.",
                )
            )
    errors.sort(key=str)
    errors.raise_all()
    return found


def _read_saturates(table: Actuators) -> None:
    """A flag, which says something where there is a limit; false is the same as none."""
    key = "actuators.saturates"
    given: object = table.saturates
    if given is not None and not isinstance(given, bool):
        raise wrong(key, f"must be true or false; got {shown(given)}.", "For example true.")
    put(table, saturates=given or None)
    if given and not table.limit:
        raise wrong(key, "needs a limit at which inputs saturate.", "Give actuators.limit.")


def _known(value: Any, noun: Any) -> Document:
    """The keys of a table that say something; no other may stand there."""
    key, names = noun.__name__.lower(), noun.__dataclass_fields__
    for name, _ in items(value, key):
        if name not in names:
            raise wrong(f"{key}.{name}", "is an unknown key.", f"Known keys: {', '.join(names)}.")
    return {name: each for name, each in value.items() if each is not None}


def _bound(value: Any, key: str, *, below: bool = False) -> Fraction:
    """A number >= 0; of relative errors one ``below`` 1."""
    number = parse_number(value, key)
    if number < 0 or (below and number >= 1):
        what = "a relative error, >= 0 and < 1" if below else ">= 0, because it is a bound"
        raise wrong(key, f"must be {what}; got {shown_number(number)}.", "For example 0.05.")
    return number
