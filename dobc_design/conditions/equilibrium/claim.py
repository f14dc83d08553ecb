"""Equilibria of one mode other than the target: what is claimed, and its JSON."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from dobc_design.conditions.check import Check, read_object
from dobc_design.conditions.numbers import (
    VECTOR_BITS,
    fields_to_json,
    has_short_denominator,
    read_rational,
)
from dobc_design.errors import ShapeError, SpecError
from dobc_design.exact.interval import Interval
from dobc_design.exact.matrix import Matrix, Vector
from dobc_design.loop.loop import Loop

Box = tuple[Interval, ...]

LARGEST: Final = 60  # rows n m


@dataclass(frozen=True, slots=True, kw_only=True)
class Equilibrium:
    """A claim: the box, n m intervals for e, agent by agent, holds an equilibrium of h(e) - K e in
    ``mode`` and not 0. A box of points is one itself: then others may lie beside it.  Raises:
    ShapeError or SpecError for no claim."""

    mode: str
    box: Box

    def __post_init__(self) -> None:
        if not self.box:
            raise ShapeError("box must have one interval per component of e; got none.", key="box")
        if len({side.is_point for side in self.box}) > 1:
            raise SpecError("every side of the box must be longer than 0, or none.", key="box")

    @property
    def is_point(self) -> bool:
        """Whether the equilibrium is known exactly."""
        return self.box[0].is_point

    @property
    def middle(self) -> Vector:
        """The middle of the box, (n m,)."""
        return tuple(side.midpoint for side in self.box)

    def to_json(self) -> dict[str, Any]:
        return fields_to_json(self, "mode", "box")


def read_claim(check: Check, loop: Loop, W: Matrix | None) -> Equilibrium:
    """What a proved check of this topic claims, for this problem."""
    values = read_object(check.exact, ("mode", "box"))
    mode = values["mode"]
    rows = values["box"]
    if mode not in list(loop.modes) or not isinstance(rows, (list, tuple)):
        raise ValueError("it needs a mode of this problem, and a list of intervals")
    if loop.size > LARGEST or len(rows) != loop.size:
        raise ValueError(f"the box must have one interval per component of e, at most {LARGEST}")
    if not all(isinstance(row, (list, tuple)) and len(row) == 2 for row in rows):
        raise ValueError("the box is no list of intervals")
    ends = [tuple(map(read_rational, row)) for row in rows]
    if any(lo > hi for lo, hi in ends):
        raise ValueError("the box is no list of intervals")
    if not has_short_denominator((end for pair in ends for end in pair), VECTOR_BITS):
        raise ValueError("the box needs too long a common denominator")
    return Equilibrium(mode=mode, box=tuple(Interval(lo, hi) for lo, hi in ends))
