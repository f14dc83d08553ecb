"""What is asked of a whole design: a decay rate, who may be pinned and how hard, noise, digits.

A noun, exact and checked.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, TypeVar

from dobc_design.errors import SpecError
from dobc_design.exact.reading import counted, shown
from dobc_design.problem.changes import typed_number
from dobc_design.synthesis.observer.request import NoiseLimit, read_noise
from dobc_design.synthesis.pinning.request import read_request as read_pinning_request

T = TypeVar("T")


@dataclass(frozen=True, slots=True, kw_only=True)
class DesignRequest:
    """What W and the gains k_i have to do together, so that everything the problem asks is proved.

    ``rate`` (1/s): the certified rate has to be at least that; None leaves it open.  ``allowed``: agent indices,
    rising.  ``caps``: the largest k_i (1/s) of agents that have one.  ``pins``: at most so many agents, None for as few
    as it takes.  ``noise``: bounds on norms of the observer.  ``digits``: significant digits of W and of the gains.
    ``reduce``: an exosystem that C does not see whole may be replaced by its observable part.
    """

    rate: Fraction | None
    allowed: tuple[int, ...]
    caps: Mapping[int, Fraction]
    pins: int | None
    noise: tuple[NoiseLimit, ...]
    digits: int
    reduce: bool

    def limits(self, labels: Sequence[str]) -> Iterator[tuple[str, str]]:
        """Every limit that was set, as the name of the argument and its value in words."""
        if self.rate is not None:
            yield "rate", f"a certified rate of at least {typed_number(self.rate)} 1/s"
        if self.pins is not None:
            yield "pins", f"at most {counted(self.pins, 'pinned agent')}"
        if self.caps:
            low, high = min(self.caps.values()), max(self.caps.values())
            each = f"{typed_number(low)}" if low == high else f"{typed_number(low)} to {typed_number(high)}"
            yield "max_gain", f"gains up to {each}"
        if len(self.allowed) < len(labels):
            named = ", ".join(labels[i] for i in self.allowed[:8]) + (", ..." if len(self.allowed) > 8 else "")
            yield "allowed", f"pins on {named} only"
        for limit in self.noise:
            yield "noise", str(limit)
        if not self.reduce:
            yield "reduce", "the exosystem kept as it is"


def read_design_request(
    labels: Sequence[str],
    *,
    rate: Any = None,
    allowed: Any = None,
    max_gain: Any = None,
    pins: Any = None,
    noise: Any = None,
    digits: Any = 3,
    reduce: Any = True,
) -> DesignRequest:
    """Read the arguments of ``design``; agents by label, numbers exactly.

    Raises: SpecError that names every wrong argument.
    """
    errors: list[SpecError] = []

    def read(reader: Callable[[], T]) -> T | None:
        try:
            return reader()
        except SpecError as error:
            errors.extend(error.errors)
            return None

    asked = {"allowed": allowed, "max_gain": max_gain, "pins": pins, "digits": digits}
    pinning = read(lambda: read_pinning_request(labels, rate=1 if rate is None else rate, **asked))
    limits = read(lambda: read_noise(noise))
    if not isinstance(reduce, bool):
        errors.append(
            SpecError(
                f"reduce must be True or False; got {shown(reduce)}.",
                key="reduce",
                cure="True lets the observable part take the exosystem's place.",
            )
        )
    if errors or pinning is None or limits is None:
        raise SpecError.several(errors)
    return DesignRequest(
        rate=None if rate is None else pinning.rate,
        allowed=pinning.allowed,
        caps=pinning.caps,
        pins=pinning.pins if isinstance(pinning.pins, int) else None,
        noise=limits,
        digits=pinning.digits,
        reduce=reduce,
    )
