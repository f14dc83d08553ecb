"""Proposals for late, held and lost readings, and for a processor: v, a rate and the observer's
part for one box; no proofs.

Rows count v_j as theta v_j, and theta grows with the rate, so that rates are bisected with one
solution of the rows each.  An observer needs a larger kappa the later an agent knows itself, hence
a larger rho, where couplings may be steeper: a few rounds find one that suits both.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np

from dobc_design._checks import noun
from dobc_design.conditions.domain import Around, Domain
from dobc_design.conditions.numbers import (
    bisected,
    claimed,
    last_found,
    rounded_down,
    rounded_up,
    time_to_one_percent,
)
from dobc_design.conditions.observer.propose import decay_of_error, observer_gain
from dobc_design.exact.matrix import Array, Matrix
from dobc_design.exact.number import ZERO
from dobc_design.exact.work import spend
from dobc_design.loop.loop import Loop
from dobc_design.loop.pairs import gain_of_rows, required_rows
from dobc_design.loop.timing import Timing

from .claim import ErrorBound, Separable, stated_errors
from .propose import Field, SeparablePlan, field_of, least_solution, rounded_vectors
from .propose_observer import propose_error_bound, radius_needed
from .timing import drift_before, more_error, steepness, too_steep, verify_readings

OBSERVERS = (0.25, 0.5, 0.75)  # parts of the observer's decay that are left to V
ROUNDS = 4  # of kappa, rho and slopes
KEPT = (0.95, 0.7, 0.4)  # parts of the largest rate that are claimed
CLOSE = 0.03  # how closely a rate is looked for, relatively
SLOWEST = 1e-3  # and the least, as a part of the largest gain
MORE = Fraction(1001, 1000)  # of kappa, and of a rate, for digits that are cut


@noun(eq=False)
class Search:
    """Claims for all starts with |e|_inf <= radius and |eps_i| <= disturbance."""

    loop: Loop
    W: Matrix | None
    radius: Fraction
    disturbance: Fraction
    everywhere: bool

    @property
    def timing(self) -> Timing:
        """What is stated."""
        return self.loop.timing or Timing()

    def claims(self, least: float = 0.0) -> Iterator[Separable]:
        """Claims worth deciding, with each observer's part in turn; first one a little faster than
        ``least`` (1/s)."""
        for error in self._observers():
            claim = self._largest(error)
            if claim is None:
                continue
            for rate in (least * float(MORE), *(part * float(claim.alpha) for part in KEPT)):
                slower = self.at(rate, error)
                if slower is not None:
                    yield slower

    def soonest(self, least: float) -> list[Separable]:
        """The same, that with the least time to one percent first; those with the rate ``least``
        (1/s) before all others."""

        def time(claim: Separable) -> tuple[bool, float]:
            rate = float(claim.alpha)
            return rate < least, time_to_one_percent(rate, float(claim.factor))

        return sorted(self.claims(least), key=time)

    def _observers(self) -> Iterator[ErrorBound | None]:
        exosystem = self.loop.joint_exosystem
        if exosystem is None or self.W is None:
            yield None
            return
        decay = decay_of_error(exosystem, self.W, self.timing)
        if self.timing.period:
            decay = min(decay, 0.99 / float(self.timing.period))
        for part in OBSERVERS:
            spend(0)
            error = propose_error_bound(exosystem, self.W, rate=part * decay, timing=self.timing)
            if error is not None:
                yield error

    def _largest(self, error: ErrorBound | None) -> Separable | None:
        top = self._field(self.radius).limit
        if self.timing.period:
            top = min(top, 0.99 / float(self.timing.period))
        if error is not None:
            top = min(top, float(self.timing.decay(error.beta)))

        # Where the slowest fails, so do all others.
        least = self.at(SLOWEST * top, error)
        if least is None:
            return None

        def find(rate: float, best: Separable) -> Separable | None:
            return self.at(rate, error)

        return last_found(
            find,
            least,
            SLOWEST * top,
            top,
            middle=lambda low, high: math.sqrt(low * high),
            close=lambda low, high: high <= (1 + CLOSE) * low,
        )[1]

    def _field(self, rho: Fraction) -> Field:
        """Raises: ArithmeticError for a coupling that turns too often."""
        return field_of(self.loop, rho=float(rho), errors=stated_errors(self.loop))

    def at(self, rate: float, error: ErrorBound | None) -> Separable | None:
        """A claim with this rate (1/s), about; None if none is found."""
        alpha = rounded_down(rate, digits=4)
        if not alpha > 0:
            return None
        timing = self.timing
        drag = more = ZERO
        drift = drift_before(self.loop)
        for _ in range(ROUNDS):
            if error is not None:
                left = timing.decay(error.beta) - alpha - drag
                if left <= 0:
                    return None
                error = replace(error, kappa=rounded_up(MORE / left, digits=6))
            rho = radius_needed(self.radius + drift, error, self.disturbance) + more
            found = self._weights(alpha, rho)
            if found is None:
                return None
            plan = SeparablePlan(v=found, rate=rate, rho=rho)
            *_, weights, _ = rounded_vectors(plan)
            claim = Separable(
                v=weights, alpha=alpha, rho=None if self.everywhere else rho, error=error
            )
            if timing.steepest is None:
                return claim
            steep = steepness(self.loop, claim, timing)
            if isinstance(steep, str) or too_steep(timing, steep) is not None:
                return None
            needed = ZERO if error is None else steep * (timing.lag(error.beta) - 1)
            wider = drift * more_error(self.loop, claim)
            if needed <= drag and wider * MORE <= more:
                return claim
            drag = needed * MORE
            more = rounded_up(wider * MORE**2, digits=4)
        return None

    def _weights(self, alpha: Fraction, rho: Fraction) -> Array | None:
        with np.errstate(all="ignore"):
            try:
                stretch = float(self.timing.stretch(alpha))
                field = replace(self._field(rho), stretch=stretch)
            except (ArithmeticError, OverflowError):
                return None
            return least_solution(field, alpha=float(alpha * MORE), start=np.ones(self.loop.n))


#: Times tried beside the stated one, as parts of it, and bisections after the longest of them.
AROUND = tuple(2 ** (3 * k / 4) for k in range(-4, 5))
CLOSELY = 5


def varied(timing: Timing) -> str:
    """The stated time that is varied: the period, else a delay; "event" where there is none."""
    names = ("delay", "own_delay") if timing.steps else ("period", "ahead", "delay", "own_delay")
    return next((name for name in names if getattr(timing, name)), "event")


def rates_around(agents: Loop, domain: Domain) -> dict[float, float]:
    """Proved rates (1/s) from the same starts with shorter and longer times than the stated one
    (s); 0 where none is found.  A gain W that nobody gave is designed for each period."""
    found: dict[float, float] = {}
    timing = agents.timing or Timing()
    name = varied(timing)
    # Linear couplings have one box, of any size.
    sizes = (domain.radius, domain.disturbance) if isinstance(domain, Around) else (1.0, 0.0)
    radius, disturbance = map(claimed, sizes)

    def look(wanted: float) -> bool:
        time = rounded_down(wanted, digits=3)
        changed: dict[str, Any] = {name: time}
        if timing.ahead:  # of a processor as many periods; both ages count it
            ahead = timing.ahead * time / getattr(timing, name)
            more = ahead - timing.ahead
            changed |= {"delay": timing.delay + more, "own_delay": timing.own_delay + more}
            changed["ahead"] = ahead
        stated = replace(agents, timing=replace(timing, **changed))
        W = observer_gain(stated)
        # what saturation leaves of pins may depend on both
        other = required_rows(stated, W)
        W = gain_of_rows(stated, W)
        search = Search(
            loop=other,
            W=W,
            radius=radius,
            disturbance=disturbance,
            everywhere=not isinstance(domain, Around),
        )
        proved = (x.alpha for x in search.claims() if verify_readings(other, W, x).wrong is None)
        found[float(time)] = float(next(proved, ZERO))
        return found[float(time)] > 0

    first = float(getattr(timing, name))
    held = [part for part in AROUND if look(first * part)]
    lost = [part for part in AROUND if part > max(held, default=0.0)]
    if held and lost:  # the longest of them closely
        bisected(lambda part: look(first * part), held[-1], lost[0], steps=CLOSELY)
    return dict(sorted(found.items()))
