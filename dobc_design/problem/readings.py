"""When agents know what they use: [readings], how late and how often, and [processor], where
everything is computed from samples."""

import math
from fractions import Fraction
from functools import partial

from dobc_design._checks import noun, positional
from dobc_design._show.cards import Card
from dobc_design.errors import wrong
from dobc_design.exact.number import ONE, ZERO, decimal_text
from dobc_design.exact.reading import least_number, one_of, positive_number, whole_number

from .stated import Stated, read_by

TIMES = ("continuous", "discrete")
MOST_LOST = 1000  # readings in a row
_seconds = partial(positive_number, unit="s")
_age = partial(least_number, what=">= 0 (s)", cure="0 is none.")
_threshold = partial(
    least_number, what="a relative threshold, >= 0 and < 1", cure="25 % is 0.25.", below=ONE
)
_lost = partial(
    whole_number, least=0, most=MOST_LOST, cure="Write 2 where two in a row may be lost."
)


@noun
class Readings(Stated):
    """What a proof has to stand; numbers are exact, 0 where nothing is given.

    delay: s, the largest age of what an agent uses of its neighbours.
    own_delay: s, the same of itself.
    period: s, couplings and pins are computed at its multiples and held in between; 0: always.
    lost: how many readings of a neighbour in a row may be lost.
    event: relative threshold of an event trigger, or of a logarithmic quantiser, >= 0 and < 1.
    Raises: SpecError that names every wrong key.
    """

    delay: Fraction = read_by(_age, ZERO)
    own_delay: Fraction = read_by(_age, ZERO)
    period: Fraction | None = read_by(_seconds, later=True)
    lost: int = read_by(_lost, 0)
    event: Fraction = read_by(_threshold, ZERO)


@positional
class Processor(Stated):
    """Every agent computes all that it does from samples: couplings, pin and compensation.

    period: s, between two samples; everything is held in between.
    Raises: SpecError unless it is > 0.
    """

    period: Fraction = read_by(_seconds)

    def __post_init__(self) -> None:
        if self.period is None:
            raise wrong("processor", "needs a period.", "For example period = 0.02 (s).")
        Stated.__post_init__(self)

    def _card(self) -> Card:
        return Card(title="Processor", facts=[("period", self.period)])


def check_ticks(late: Fraction, period: Fraction, *, key: str) -> None:
    """What is computed at a tick acts at another one.  Raises: SpecError that names ``key``."""
    ticks = math.ceil(late / period)
    if late == ticks * period:
        return
    told = decimal_text(period)
    raise wrong(
        key,
        f"must be a part of actuators.delay = {decimal_text(late)} s; got {told} s.",
        f"Let inputs wait for the next tick, actuators.delay = {decimal_text(ticks * period)}; or "
        f"take {decimal_text(late / ticks)}.",
    )


def read_time(value: object) -> bool:
    """Whether agents move in steps; None stands for continuous time.  Raises: SpecError."""
    return value is not None and one_of(value, TIMES, "dynamics.time") == TIMES[1]
