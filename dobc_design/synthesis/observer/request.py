"""What is asked of a designed observer gain W: speed, region of the spectrum, size, noise, method, digits.

A noun, exact and checked; ``design`` proposes for it, ``verify`` decides whether a W meets it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from dobc_design._show.cards import Card, Shown
from dobc_design.errors import SpecError
from dobc_design.exact.number import parse_number
from dobc_design.exact.reading import is_list, shown, shown_number
from dobc_design.problem.changes import typed_number
from dobc_design.synthesis.observer.spectral_regions import Disk, HalfPlane, SpectralRegion, read_regions

METHODS = ("lmi", "kalman", "place")
CHANNELS = ("measurement", "disturbance", "exosystem")
NORMS = ("h2", "hinf")


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class NoiseLimit(Shown):
    """An upper bound on the norm of one transfer function of the observer, with F = A - W C.

    ``channel``: "measurement", noise on the measured x to the estimate dhat, C s (sI - F)^-1 W, in 1/s;
    "disturbance", an unmodelled d to dhat, C (sI - F)^-1 W, no unit; "exosystem", an input of xi' = A xi to the
    error C eps, C (sI - F)^-1.  ``norm``: "hinf", the largest gain over the frequencies, or "h2", the
    root of the variance under white noise of unit intensity (infinite for "measurement" unless C W = 0).
    An H2 norm may equal its bound, an H-infinity norm has to stay below.
    """

    channel: str
    norm: str
    bound: Fraction

    def __init__(self, *, bound: Any, channel: str = "measurement", norm: str = "hinf") -> None:
        for name, value, words in (("channel", channel, CHANNELS), ("norm", norm, NORMS)):
            if value not in words:
                raise SpecError(
                    f"noise.{name} must be one of {', '.join(words)}; got {shown(value)}.",
                    key=f"noise.{name}",
                    cure=f'For example {name}="{words[0]}".',
                )
            object.__setattr__(self, name, value)
        object.__setattr__(self, "bound", _positive(bound, "noise"))

    def _card(self) -> Card:
        return Card(title="NoiseLimit", text=str(self))

    def __str__(self) -> str:
        name = {"h2": "H2", "hinf": "H-infinity"}[self.norm]
        sign = "<=" if self.norm == "h2" else "<"
        return f"{name} norm of the {self.channel} channel {sign} {typed_number(self.bound)}"


@dataclass(frozen=True, slots=True, kw_only=True)
class ObserverRequest:
    """What a gain W has to do.  Absent limits are None or empty.

    ``rate`` (1/s): every eigenvalue has Re <= -rate.  ``regions``: where else the spectrum must lie.
    ``max_gain``: bound on |W|, the root of the sum of the squares of its entries.  ``noise``: bounds on norms.
    ``peak``: bound on |eps(t)| / |eps(0)|.  ``digits``: significant digits of W.  ``period`` (s): sampled observer.
    """

    rate: Fraction | None
    regions: tuple[SpectralRegion, ...]
    max_gain: Fraction | None
    noise: tuple[NoiseLimit, ...]
    peak: Fraction | None
    method: str
    digits: int
    period: Fraction | None

    def __init__(
        self,
        *,
        rate: Any = None,
        region: Any = None,
        max_gain: Any = None,
        noise: Any = None,
        peak: Any = None,
        method: str = "lmi",
        digits: Any = 4,
        period: Any = None,
    ) -> None:
        if method not in METHODS:
            raise SpecError(
                f"method must be one of {', '.join(METHODS)}; got {shown(method)}.",
                key="method",
                cure='"lmi" meets every kind of request.',
            )
        if isinstance(digits, bool) or not isinstance(digits, int) or not 1 <= digits <= 15:
            raise SpecError(
                f"digits must be an integer from 1 to 15; got {shown(digits)}.",
                key="digits",
                cure="Four digits are a good choice.",
            )
        object.__setattr__(self, "rate", None if rate is None else _positive(rate, "rate"))
        object.__setattr__(self, "regions", read_regions(region))
        object.__setattr__(self, "max_gain", None if max_gain is None else _positive(max_gain, "max_gain"))
        object.__setattr__(self, "noise", _read_noise(noise))
        object.__setattr__(self, "peak", None if peak is None else parse_number(peak, key="peak"))
        object.__setattr__(self, "period", None if period is None else _positive(period, "period"))
        object.__setattr__(self, "method", method)
        object.__setattr__(self, "digits", digits)
        if self.peak is not None and self.peak < 1:
            raise SpecError(
                f"peak must be at least 1, because |eps| starts there; got {shown_number(self.peak)}.",
                key="peak",
                cure="Ask for 2, say.",
            )
        if self.period is not None:
            self._require_sampled()

    def _require_sampled(self) -> None:
        if self.noise or self.peak is not None:
            key = "noise" if self.noise else "peak"
            raise SpecError(
                f"{key} cannot be asked of a sampled observer yet; got it together with period.",
                key=key,
                cure=f"Leave {key} out, or design in continuous time.",
            )
        if not all(isinstance(region, Disk) for region in self.regions):
            raise SpecError(
                "region must be a Disk for a sampled observer: its eigenvalues belong in the unit disk.",
                key="region",
                cure="Use rate for a decay rate in 1/s.",
            )

    @property
    def all_regions(self) -> tuple[SpectralRegion, ...]:
        """The regions and the half planes of the rate and of convergence, in continuous time."""
        stable = HalfPlane(left_of=-(self.rate or Fraction(0)))
        return (stable, *self.regions)

    def changed(self, other: Mapping[str, Any]) -> ObserverRequest:
        """The same request with other arguments in some places: changed({"max_gain": None}) lifts that limit."""
        own: dict[str, Any] = {
            "rate": self.rate,
            "region": list(self.regions) or None,
            "max_gain": self.max_gain,
            "noise": list(self.noise) or None,
            "peak": self.peak,
            "method": self.method,
            "digits": self.digits,
            "period": self.period,
        }
        return ObserverRequest(**(own | dict(other)))


def _positive(value: Any, key: str) -> Fraction:
    number = parse_number(value, key=key)
    if number <= 0:
        raise SpecError(f"{key} must be > 0; got {shown_number(number)}.", key=key, cure="Leave it out for no limit.")
    return number


def _read_noise(value: Any) -> tuple[NoiseLimit, ...]:
    """A number bounds the H-infinity norm from measurement noise to dhat."""
    if value is None:
        return ()
    given = tuple(value) if is_list(value) else (value,)
    return tuple(each if isinstance(each, NoiseLimit) else NoiseLimit(bound=each) for each in given)
