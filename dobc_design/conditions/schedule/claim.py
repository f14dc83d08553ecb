"""Tubes: boxes that move with time and hold every run (theory, section 11), and the certificate
that takes over.

Claim: -lower(t) <= e(t) <= upper(t) on [0, T], linear between the times, from every start |e|_inf
<= radius and |eps_i| <= disturbance, whatever modes are on; |C eps_i(t)| <= sqrt(size) disturbance
exp(-beta t).  At T the box lies in {W <= level} of a certificate near the target, whose size W
decays from there on; |e|_inf <= height W. Where the guarantee of [switching] says which mode is on
at a time, only that one is on.

Proof.  The box is subtangential: on a face that e_i touches, its derivative is no larger than that
of the face, by the rows.  Where the certificate is max-separable, W = N + kappa E with the P of the
tube; where it is quadratic, W^2 = e'P_e e + sum eps_i'P' eps_i <= sum |P_e|_kl b_k b_l + n
stretch^2 E^2 for |e| <= b and P' <= stretch^2 P.  Weights that move under the guarantee
(``cycles``) take over where a phase begins; without weights W = N + kappa E, v = 1, stays.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from dobc_design._show.cards import Card, Shown
from dobc_design.conditions.numbers import vector_to_json
from dobc_design.conditions.quadratic.claim import Lure
from dobc_design.conditions.schedule.cycles import Cycles
from dobc_design.conditions.separable.claim import ErrorBound, Separable
from dobc_design.errors import SpecError
from dobc_design.exact.matrix import Vector
from dobc_design.exact.number import number_text
from dobc_design.loop.loop import Loop

SEPARABLE, QUADRATIC, SCHEDULE = "max-separable", "quadratic", "schedule"
ZERO, ONE = Fraction(0), Fraction(1)
# of the radius: below this every |e_ic| has settled, where no tolerance is named
SETTLED = Fraction(1, 100)


Last = Separable | Lure | Cycles  # what may take over


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Tube(Shown):
    """Boxes -lower <= e <= upper at ``times`` (s) from 0 on, linear in between; one entry > 0 per
    agent, for each of its components.  ``error``: P, beta and size of the observer (kappa is not
    used); None without an exosystem.
    Raises: SpecError unless times rise from 0 and boxes are as many as times and not empty."""

    times: Vector
    upper: tuple[Vector, ...]
    lower: tuple[Vector, ...]
    error: ErrorBound | None = None

    def __post_init__(self) -> None:
        if (
            not self.times
            or self.times[0]
            or any(b <= a for a, b in zip(self.times, self.times[1:], strict=False))
        ):
            raise SpecError("times must rise from 0.", key="times")
        if not len(self.times) == len(self.upper) == len(self.lower):
            raise SpecError("there must be one box for each time.", key="upper")
        if min(x for face in (self.upper, self.lower) for box in face for x in box) <= 0:
            raise SpecError("boxes must have entries > 0.", key="upper")

    @classmethod
    def start(cls, loop: Loop, radius: Fraction, error: ErrorBound | None) -> Tube:
        """The box of all starts, from which a certificate takes over at once."""
        box = (radius,) * loop.n
        return cls(times=(ZERO,), upper=(box,), lower=(box,), error=error)

    @property
    def ends(self) -> Fraction:
        """Its last time, in s."""
        return self.times[-1]

    def widths(self, k: int) -> Vector:
        """The larger of upper and lower of every agent at the k-th time."""
        return tuple(map(max, self.upper[k], self.lower[k]))

    def _card(self) -> Card:
        return Card(
            title="Tube",
            facts=[("until", f"{float(self.ends):.6g} s"), ("segments", str(len(self.times) - 1))],
        )

    def to_json(self) -> dict[str, Any]:
        values: dict[str, Any] = {"times": vector_to_json(self.times)}
        values |= {
            name: [vector_to_json(box) for box in getattr(self, name)]
            for name in ("upper", "lower")
        }
        observed = {} if self.error is None else self.error.to_json()
        return values | {name: x for name, x in observed.items() if name != "kappa"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Descent:
    """A claim: from |e|_inf <= radius, |eps_i| <= disturbance, |e(t)|_inf <= tolerance for all t >=
    time (s): by a tube, and from its end on by a ``certificate`` with ``level``, ``height`` and
    ``stretch`` as above (stretch 1 unless it is quadratic).  Raises: SpecError unless all are > 0
    (disturbance >= 0) and time is not before that end."""

    tube: Tube
    certificate: Last
    level: Fraction
    height: Fraction
    stretch: Fraction = ONE
    radius: Fraction
    disturbance: Fraction
    tolerance: Fraction
    time: Fraction

    def __post_init__(self) -> None:
        for name in ("level", "height", "stretch", "radius", "tolerance"):
            if getattr(self, name) <= 0:
                raise SpecError(f"{name} must be > 0.", key=name)
        if self.disturbance < 0:
            raise SpecError("disturbance must be >= 0.", key="disturbance")
        if self.time < self.tube.ends:
            raise SpecError("time must not lie before the end of the tube.", key="time")

    @property
    def kind(self) -> str:
        """Of the certificate."""
        return {Lure: QUADRATIC, Cycles: SCHEDULE}.get(type(self.certificate), SEPARABLE)

    def to_json(self) -> dict[str, Any]:
        last: dict[str, Any] = {"kind": self.kind}
        last |= {name: number_text(getattr(self, name)) for name in ("level", "height", "stretch")}
        return {
            "tolerance": number_text(self.tolerance),
            "time": number_text(self.time),
            "tube": self.tube.to_json(),
            "last": last | {"certificate": self.certificate.to_json()},
        }
