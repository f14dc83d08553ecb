"""From which starts a check holds: everywhere, near the target, or in a box or ball of errors."""

import json
from collections.abc import Mapping
from typing import Any, ClassVar

from dobc_design._checks import positional


@positional
class Word:
    """Starts for which a certificate has one word, the ``value``."""

    value: Any

    def to_json(self) -> Any:
        """As a certificate has it."""
        return self.value

    def __str__(self) -> str:
        """A text by itself, anything else as the JSON of the certificate."""
        if isinstance(self.value, str):
            return self.value
        return json.dumps(self.value, ensure_ascii=False, default=str)


class Everywhere(Word):
    """Every start."""


class NearTarget(Word):
    """All starts that are close enough to the target; how close is not said."""


class Foreign(Word):
    """What a foreign certificate has in place of a domain; no claim holds there."""


@positional
class Around:
    """Starts around the target, in the norm of the subclass: errors of at most ``radius`` in the
    unit of x, and |eps_i| <= ``disturbance`` (Euclidean) for every agent."""

    radius: float
    disturbance: float

    kind: ClassVar[str] = ""

    def to_json(self) -> Any:
        """As a certificate has it."""
        return {"kind": self.kind, "radius": self.radius, "disturbance": self.disturbance}

    def __str__(self) -> str:
        norm = "|e|_inf" if self.kind == "box" else "|e|"
        return f"{norm} <= {self.radius:.6g} and |eps_i| <= {self.disturbance:.6g}"


@positional
class Box(Around):
    """|e|_inf <= radius: every component of every error."""

    kind: ClassVar[str] = "box"


@positional
class Ball(Around):
    """|e| <= radius: the Euclidean length of all errors together."""

    kind: ClassVar[str] = "ball"


Domain = Everywhere | NearTarget | Box | Ball | Foreign

EVERYWHERE = Everywhere("global")
NEAR_TARGET = NearTarget("consensus")


def domain_from_json(value: Any) -> Domain:
    """Read a domain back; what is none becomes ``Foreign``, and claims about it fail."""
    if value == EVERYWHERE.to_json():
        return EVERYWHERE
    if value == NEAR_TARGET.to_json():
        return NEAR_TARGET
    if isinstance(value, Mapping) and set(value) == {"kind", "radius", "disturbance"}:
        numbers = value["radius"], value["disturbance"]
        # true counts as 1 in Python, and is no number here
        plain = all(isinstance(x, (int, float)) and not isinstance(x, bool) for x in numbers)
        if plain and value["kind"] == Box.kind:
            return Box(*numbers)
        if plain and value["kind"] == Ball.kind:
            return Ball(*numbers)
    return Foreign(value)
