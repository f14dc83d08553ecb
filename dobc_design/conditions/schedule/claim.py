"""Staging: certificates that take over from each other as the error shrinks (theory, section 5).

Stage k has a certificate with a size W_k: N + kappa E of a max-separable one, sqrt(e'P_e e + sum eps_i'P eps_i) of a
quadratic one.  W_k decays at the rate r_k wherever its guard holds: N <= rho, or |e_j - e_i| <= radius on the arcs.

Claim: W_k(t) <= a_k exp(-r_k (t - t_k)) for all t >= t_k, so |e(t)|_inf <= height_k W_k(t), for every switching signal.

Proof.  {W_0 <= a_0} holds the starts and lies in the guard of the first stage, so it is invariant.  Let c be the bound
of W_k at t_(k+1).  If {W_k <= c} lies in the guard of stage k+1, that guard holds from then on, because W_k only falls;
so W_(k+1) decays from the largest value that it can have where W_k <= c and the observer errors are as small as known.

These evolve on their own, eps_i' = (A - WC) eps_i: b_k exp(-beta_k (t - t_k)) bounds E_k = max_i sqrt(eps_i'P_k eps_i),
and with P_(k+1) <= l^2 P_k, E_(k+1) <= l E_k.  Where W_k <= c and E_k <= d:

    N' <= g N, g = max_i v_i/v'_i:  N' + kappa' E' <= g c + max(0, kappa' l - g kappa) min(d, c/kappa)
    |e_i| <= c v_i, P_e <= diag(D): e'P_e e + sum eps_i'P' eps_i <= c^2 sum D_i v_i^2 + n (l d)^2
    P_e' <= f P_e:                  e'P_e' e + sum eps_i'P' eps_i <= max(f, l^2) c^2

(the first because N <= c - kappa E, so that the sum is at most g (c - kappa x) + kappa' l x for some x <= d, c/kappa).
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from dobc_design._show.cards import Card, Shown
from dobc_design.conditions.numbers import vector_to_json
from dobc_design.conditions.quadratic.claim import Lure
from dobc_design.conditions.separable.claim import Separable
from dobc_design.errors import SpecError
from dobc_design.exact.matrix import Vector
from dobc_design.exact.number import float_above, number_text

SEPARABLE, QUADRATIC = "max-separable", "quadratic"
ZERO, ONE = Fraction(0), Fraction(1)
#: What every stage claims.
NUMBERS = ("start", "level", "height", "noise", "stretch")


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Stage(Shown):
    """A claim: from ``start`` (s) on W <= level exp(-rate (t - start)), W the size of the certificate.

    ``height``: |e|_inf <= height W.  ``noise``: max_i sqrt(eps_i'P eps_i) <= noise at ``start``; 0 without an
    exosystem.  ``stretch`` l: P <= l^2 (P of the stage before).  Of quadratic stages only: ``factor`` f with
    P_e <= f (P_e of the stage before) where that is quadratic too, else ``diagonal`` (n m) with P_e <= diag(diagonal).
    Raises: SpecError unless start, noise >= 0, level, height, stretch > 0, and each kind has its own numbers.
    """

    certificate: Separable | Lure
    start: Fraction
    level: Fraction
    height: Fraction
    noise: Fraction = ZERO
    stretch: Fraction = ONE
    diagonal: Vector | None = None
    factor: Fraction | None = None

    def __post_init__(self) -> None:
        for name in ("start", "noise"):
            if getattr(self, name) < 0:
                raise SpecError(f"{name} of a stage must be >= 0.", key=name)
        for name in ("level", "height", "stretch", "factor"):
            value = getattr(self, name)
            if value is not None and value <= 0:
                raise SpecError(f"{name} of a stage must be > 0.", key=name)
        if self.is_quadratic is (self.diagonal is None and self.factor is None) or (self.diagonal and self.factor):
            raise SpecError("a quadratic stage has either a diagonal or a factor, others have neither.", key="diagonal")

    def _card(self) -> Card:
        facts = [(name, repr(float_above(getattr(self, name)))) for name in NUMBERS[:-1]]
        return Card(title="Stage", text=QUADRATIC if self.is_quadratic else SEPARABLE, facts=facts)

    def __repr__(self) -> str:
        return f"<Stage {self._card().text} from {float(self.start):.6g} s>"

    @property
    def is_quadratic(self) -> bool:
        return isinstance(self.certificate, Lure)

    def to_json(self) -> dict[str, Any]:
        values: dict[str, Any] = {"kind": QUADRATIC if self.is_quadratic else SEPARABLE}
        values |= {name: number_text(getattr(self, name)) for name in NUMBERS}
        if self.diagonal is not None:
            values["diagonal"] = vector_to_json(self.diagonal)
        if self.factor is not None:
            values["factor"] = number_text(self.factor)
        return values | {"certificate": self.certificate.to_json()}


@dataclass(frozen=True, slots=True, kw_only=True)
class Staging:
    """A claim: from |e|_inf <= radius, |eps_i| <= disturbance, |e(t)|_inf <= tolerance for all t >= time (s).  The
    stages are in the order in which they begin, the first at 0.  A quadratic one is never followed by a max-separable
    one.  Raises: SpecError for anything else, or unless radius, tolerance > 0 and disturbance >= 0."""

    stages: tuple[Stage, ...]
    radius: Fraction
    disturbance: Fraction
    tolerance: Fraction
    time: Fraction

    def __post_init__(self) -> None:
        if not self.stages or self.stages[0].start:
            raise SpecError("there must be at least one stage, and the first must start at 0.", key="stages")
        for before, after in zip(self.stages, self.stages[1:], strict=False):
            if after.start < before.start:
                raise SpecError("stages must be in the order of their starts.", key="stages")
            if before.is_quadratic and not after.is_quadratic:
                raise SpecError("no max-separable stage may follow a quadratic one.", key="stages")
            if (after.factor is None) is before.is_quadratic:
                raise SpecError("factor belongs to a quadratic stage that follows a quadratic one.", key="factor")
        if self.stages[0].factor is not None:
            raise SpecError("the first stage follows no other, so it has no factor.", key="factor")
        for name in ("radius", "tolerance"):
            if getattr(self, name) <= 0:
                raise SpecError(f"{name} must be > 0.", key=name)
        if self.disturbance < 0:
            raise SpecError("disturbance must be >= 0.", key="disturbance")
        if self.time < self.stages[-1].start:
            raise SpecError("time must not lie before the last stage.", key="time")

    def to_json(self) -> dict[str, Any]:
        return {
            "tolerance": number_text(self.tolerance),
            "time": number_text(self.time),
            "stages": [stage.to_json() for stage in self.stages],
        }
