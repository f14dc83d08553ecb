"""What is asked of a designed observer gain W: speed, region of the spectrum, noise, digits; exact and checked.

The regions (half plane, disk, cone) are closed, convex and symmetric about the real axis.  So an intersection of them
that is not empty contains a real point, and whether it is empty is seen on the real axis.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from dobc_design._show.cards import Card, Shown
from dobc_design.errors import SpecError
from dobc_design.exact.number import parse_number
from dobc_design.exact.reading import is_list, shown, shown_number
from dobc_design.problem.changes import typed_number

CHANNELS = ("measurement", "disturbance", "exosystem")
NORMS = ("h2", "hinf")
Ends = tuple[Fraction | None, Fraction | None]  # on the real axis; None is infinite


class _Asked(Shown):
    """What shows itself by its sentence."""

    __slots__ = ()

    def _card(self) -> Card:
        return Card(title=type(self).__name__, text=str(self))


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class HalfPlane(_Asked):
    """Re s <= left_of, or Re s >= right_of (1/s); exactly one of them is given.

    HalfPlane(left_of=-2) asks for decay at the rate 2 or more, HalfPlane(right_of=-50) for none above 50.
    Example:
        >>> design = dd.design_observer("paper-fixed", region=[dd.HalfPlane(left_of=-2), dd.Disk(centre=-4, radius=3)])
        >>> design.verdict.value
        'proved'
    """

    left_of: Fraction | None
    right_of: Fraction | None

    def __init__(self, *, left_of: Any = None, right_of: Any = None) -> None:
        if (left_of is None) == (right_of is None):
            raise SpecError(
                "a HalfPlane must have one side, left_of or right_of; got "
                + ("both." if left_of is not None else "neither."),
                key="region",
                cure="For a strip give two half planes in a list.",
            )
        for name, value in (("left_of", left_of), ("right_of", right_of)):
            number = None if value is None else parse_number(value, key=f"region.{name}")
            object.__setattr__(self, name, number)

    def __str__(self) -> str:
        if self.left_of is not None:
            return f"Re s <= {shown_number(self.left_of)}"
        return f"Re s >= {shown_number(self.right_of or Fraction(0))}"

    @property
    def real_ends(self) -> Ends:
        """Where the region begins and ends on the real axis."""
        return self.right_of, self.left_of


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Disk(_Asked):
    """|s - centre| <= radius, with a real centre; both in 1/s."""

    centre: Fraction
    radius: Fraction

    def __init__(self, *, centre: Any, radius: Any) -> None:
        object.__setattr__(self, "centre", parse_number(centre, key="region.centre"))
        object.__setattr__(self, "radius", parse_number(radius, key="region.radius"))
        if self.radius <= 0:
            raise SpecError(
                f"region.radius must be > 0, so that the disk holds something; got {shown_number(self.radius)}.",
                key="region.radius",
                cure="Give a positive radius (1/s).",
            )

    def __str__(self) -> str:
        return f"|s - ({shown_number(self.centre)})| <= {shown_number(self.radius)}"

    @property
    def real_ends(self) -> Ends:
        """Where the region begins and ends on the real axis."""
        return self.centre - self.radius, self.centre + self.radius


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Cone(_Asked):
    """Damping ratio at least ``damping``: Re s <= 0 and -Re s >= damping |s|; 0 < damping < 1."""

    damping: Fraction

    def __init__(self, *, damping: Any) -> None:
        object.__setattr__(self, "damping", parse_number(damping, key="region.damping"))
        if not 0 < self.damping < 1:
            raise SpecError(
                f"region.damping must lie between 0 and 1, as the cosine of the cone's half angle;"
                f" got {shown_number(self.damping)}.",
                key="region.damping",
                cure="For real eigenvalues only, ask for 0.999.",
            )

    def __str__(self) -> str:
        return f"damping >= {shown_number(self.damping)}"

    @property
    def real_ends(self) -> Ends:
        """Where the region begins and ends on the real axis."""
        return None, Fraction(0)


SpectralRegion = HalfPlane | Disk | Cone


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class NoiseLimit(_Asked):
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

    def __str__(self) -> str:
        name = {"h2": "H2", "hinf": "H-infinity"}[self.norm]
        sign = "<=" if self.norm == "h2" else "<"
        return f"{name} norm of the {self.channel} channel {sign} {typed_number(self.bound)}"


@dataclass(frozen=True, slots=True, kw_only=True)
class ObserverRequest:
    """What a gain W has to do.  Absent limits are None or empty.

    ``rate`` (1/s): every eigenvalue has Re <= -rate.  ``regions``: where else the spectrum must lie.  ``noise``: bounds
    on norms.  ``digits``: significant digits of W.  ``period`` (s): sampled observer.
    """

    rate: Fraction | None = None
    regions: tuple[SpectralRegion, ...] = ()
    noise: tuple[NoiseLimit, ...] = ()
    digits: int = 4
    period: Fraction | None = None

    @property
    def all_regions(self) -> tuple[SpectralRegion, ...]:
        """The regions and the half planes of the rate and of convergence, in continuous time."""
        return (HalfPlane(left_of=-(self.rate or Fraction(0))), *self.regions)


def read_observer_request(
    *, rate: Any = None, region: Any = None, noise: Any = None, digits: Any = 4, period: Any = None
) -> ObserverRequest:
    """Read the arguments of ``design_observer``; numbers exactly.  Raises: SpecError for a wrong one."""
    check_digits(digits)
    request = ObserverRequest(
        rate=None if rate is None else _positive(rate, "rate"),
        regions=_read_regions(region),
        noise=read_noise(noise),
        digits=digits,
        period=None if period is None else _positive(period, "period"),
    )
    if request.period is not None and request.noise:
        raise SpecError(
            "noise cannot be asked of a sampled observer yet; got it together with period.",
            key="noise",
            cure="Leave noise out, or design in continuous time.",
        )
    if request.period is not None and not all(isinstance(region, Disk) for region in request.regions):
        raise SpecError(
            "region must be a Disk for a sampled observer: its eigenvalues belong in the unit disk.",
            key="region",
            cure="Use rate for a decay rate in 1/s.",
        )
    return request


def check_digits(digits: Any) -> None:
    """Raises: SpecError if ``digits`` is not a number of significant digits."""
    if isinstance(digits, bool) or not isinstance(digits, int) or not 1 <= digits <= 15:
        raise SpecError(
            f"digits must be an integer from 1 to 15; got {shown(digits)}.",
            key="digits",
            cure="Four digits are a good choice.",
        )


def read_noise(value: Any) -> tuple[NoiseLimit, ...]:
    """A limit or a list of them; a number bounds the H-infinity norm from measurement noise to dhat."""
    if value is None:
        return ()
    given = tuple(value) if is_list(value) else (value,)
    return tuple(each if isinstance(each, NoiseLimit) else NoiseLimit(bound=each) for each in given)


def common_interval(regions: tuple[SpectralRegion, ...]) -> Ends | None:
    """The common part of the regions on the real axis; None if it is empty, and then the regions have no common point.

    A common point z would bring its conjugate and, by convexity, Re z along.
    """
    low = max((left for left, _ in (region.real_ends for region in regions) if left is not None), default=None)
    high = min((right for _, right in (region.real_ends for region in regions) if right is not None), default=None)
    return None if low is not None and high is not None and low > high else (low, high)


def _read_regions(value: Any) -> tuple[SpectralRegion, ...]:
    """One region or a list of them; None is no region."""
    if value is None:
        return ()
    regions = tuple(value) if is_list(value) else (value,)
    for region in regions:
        if not isinstance(region, (HalfPlane, Disk, Cone)):
            raise SpecError(
                f"region must be a HalfPlane, a Disk or a Cone, or a list of them; got {shown(region)}.",
                key="region",
                cure="For example region=dd.Cone(damping=0.7).",
            )
    return regions


def _positive(value: Any, key: str) -> Fraction:
    number = parse_number(value, key=key)
    if number <= 0:
        raise SpecError(f"{key} must be > 0; got {shown_number(number)}.", key=key, cure="Leave it out for no limit.")
    return number
