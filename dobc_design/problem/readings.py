"""When agents know what they use: [readings], how late and how often, and [processor], where
everything is computed from samples."""

from fractions import Fraction
from typing import Any

from dobc_design._checks import later, noun, put
from dobc_design._show.cards import Card, Shown
from dobc_design.errors import Mistakes, wrong
from dobc_design.exact.number import ZERO, parse_number
from dobc_design.exact.reading import keyed, positive_number, shown, shown_number

TIMES = ("continuous", "discrete")
MOST_LOST = 1000  # readings in a row


@noun
class Readings(Shown):
    """What a proof has to stand; numbers are exact, 0 where nothing is given.

    delay: s, the largest age of what an agent uses of its neighbours.
    own_delay: s, the same of itself.
    period: s, couplings and pins are computed at its multiples and held in between; 0: always.
    lost: how many readings of a neighbour in a row may be lost.
    event: relative threshold of an event trigger, or of a logarithmic quantiser, >= 0 and < 1.
    Raises: SpecError that names every wrong key.
    """

    delay: Fraction = ZERO
    own_delay: Fraction = ZERO
    period: Fraction | None = later()
    lost: int = 0
    event: Fraction = ZERO

    def __post_init__(self) -> None:
        errors = Mistakes()
        for name in ("delay", "own_delay", "event"):
            with errors:
                key = f"readings.{name}"
                value = parse_number(getattr(self, name), key)
                if value < 0 or (name == "event" and value >= 1):
                    what, cure = ">= 0 (s)", "0 is none."
                    if name == "event":
                        what, cure = "a relative threshold, >= 0 and < 1", "25 % is 0.25."
                    raise wrong(key, f"must be {what}; got {shown_number(value)}.", cure)
                put(self, **{name: value})
        with errors:
            if self.period is not None:
                put(self, period=positive_number(self.period, "readings.period", "s"))
        with errors:
            lost: object = self.lost
            if type(lost) is not int or not 0 <= lost <= MOST_LOST:
                what = f"must be a count, 0 to {MOST_LOST}; got {shown(lost)}."
                raise wrong("readings.lost", what, "Write 2 where two in a row may be lost.")
        errors.raise_all()

    def _card(self) -> Card:
        names = ("delay", "own_delay", "period", "lost", "event")
        facts = [(name, value) for name in names if (value := getattr(self, name))]
        return Card(title="Readings", text="at most", facts=facts)


@noun
class Processor(Shown):
    """Every agent computes all that it does from samples: couplings, pin and compensation.

    period: s, between two samples; everything is held in between.
    Raises: SpecError unless it is > 0.
    """

    period: Fraction

    def __post_init__(self) -> None:
        put(self, period=positive_number(self.period, "processor.period", "s"))

    def _card(self) -> Card:
        return Card(title="Processor", facts=[("period", self.period)])


def read_readings(value: Any) -> Readings | None:
    """Read the [readings] table.  Raises: SpecError that names every wrong key."""
    if value is None or isinstance(value, Readings):
        return value
    names = tuple(Readings.__dataclass_fields__)
    given = zip(names, keyed(value, names, key="readings"), strict=True)
    return Readings(**{name: each for name, each in given if each is not None})


def read_processor(value: Any) -> Processor | None:
    """Read the [processor] table.  Raises: SpecError that names the wrong key."""
    if value is None or isinstance(value, Processor):
        return value
    (period,) = keyed(value, ("period",), key="processor")
    if period is None:
        raise wrong("processor", "needs a period.", "For example period = 0.02 (s).")
    return Processor(period=period)


def read_time(value: object) -> bool:
    """Whether agents move in steps; None stands for continuous time.  Raises: SpecError."""
    if value not in (None, *TIMES):
        known = ", ".join(f'"{each}"' for each in TIMES)
        raise wrong("dynamics.time", f"must be one of {known}; got {shown(value)}.", "Choose one.")
    return value == TIMES[1]
