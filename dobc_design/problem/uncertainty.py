"""What the model leaves out, bounded: [uncertainty], and what the actuators can give:
[actuators]."""

from collections.abc import Mapping
from fractions import Fraction
from functools import partial
from types import MappingProxyType
from typing import Any

from dobc_design._checks import noun
from dobc_design._show.cards import Card
from dobc_design.errors import Mistakes, wrong
from dobc_design.exact.number import ONE, ZERO
from dobc_design.exact.reading import Names, flag, least_number, positive_number, shown

from .bands import Band, band_words, read_bands
from .stated import Stated, read_by

RELATIVE = ("weights", "gains")
BOUNDS = ("disturbance", "drift", "measurement")
#: What acts on the plant however near the target it is.
ABSOLUTE = (*BOUNDS, "bands")
_bound = partial(least_number, what=">= 0, because it is a bound", cure="For example 0.05.")
_relative = partial(
    least_number, what="a relative error, >= 0 and < 1", cure="For example 0.05.", below=ONE
)
_positive = partial(positive_number, unit="unit of u")


def _read_limit(value: Any, key: str) -> Fraction | Mapping[str, Fraction]:
    """One number for all agents, or label -> number."""
    if not isinstance(value, Mapping):
        return _positive(value, key)
    return MappingProxyType({str(x): _positive(u, f"{key}.{x}") for x, u in value.items()})


def _read_saturates(value: Any, key: str) -> bool | None:
    """A flag; false is the same as none."""
    return flag(value, key) or None


def _read_delay(value: Any, key: str) -> Fraction | None:
    """A time in s; 0 is the same as none."""
    return _bound(value, key) or None


@noun
class Uncertainty(Stated):
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

    weights: Fraction = read_by(_relative, ZERO)
    gains: Fraction = read_by(_relative, ZERO)
    known_to_agents: bool = read_by(flag, default=True)
    disturbance: Fraction = read_by(_bound, ZERO)
    drift: Fraction = read_by(_bound, ZERO)
    measurement: Fraction = read_by(_bound, ZERO)
    bands: tuple[Band, ...] | None = read_by(read_bands, later=True)

    def _card(self) -> Card:
        bounds = [(name, getattr(self, name)) for name in (*RELATIVE, *BOUNDS)]
        facts = [(name, x) for name, x in bounds if x]
        facts += [("of d_i", band_words(band)) for band in self.bands or ()]
        if not self.known_to_agents:
            facts.append(("the agents' couplings", "off by as much"))
        return Card(title="Uncertainty", text="at most", facts=facts)


@noun
class Actuators(Stated):
    """What actuators can give.

    limit: bound on every component of u_i, a number for all agents, or label -> number.
    amplitude: bound on every component of d_i, by default that of the runs from simulation.xi0.
    saturates: whether inputs may reach their limits, so that a proof has to count what is left of
        them; else it shows that none is reached.
    delay: s, a constant delay between what is measured and what acts, sensor and actuator together.
    Raises: SpecError that names every wrong key.
    """

    limit: Fraction | Mapping[str, Fraction] | None = read_by(_read_limit)
    amplitude: Fraction | None = read_by(_bound)
    saturates: bool | None = read_by(_read_saturates, later=True)
    delay: Fraction | None = read_by(_read_delay, later=True)

    def __post_init__(self) -> None:
        Stated.__post_init__(self)
        if self.saturates and not self.limit:
            what = "needs a limit at which inputs saturate."
            raise wrong("actuators.saturates", what, "Give actuators.limit.")

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
        if self.delay is not None:
            facts.append(("late by (s)", self.delay))
        text = "inputs saturate at their limits" if self.saturates else ""
        return Card(title="Actuators", text=text, facts=facts)


def read_actuators(value: Any, labels: Names) -> Actuators | None:
    """Read the [actuators] table.  Raises: SpecError that names every wrong key and every unknown
    agent."""
    found = Actuators.stated(value)
    errors = Mistakes()
    if found is not None and isinstance(found.limit, Mapping):
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
