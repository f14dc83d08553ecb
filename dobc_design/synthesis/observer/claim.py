"""An observer gain W on request: what is asked (speed, region of the spectrum, noise, digits), and
what was found.

The regions (half plane, disk, cone) are closed, convex and symmetric about the real axis.  So an
intersection of them that is not empty contains a real point, and whether it is empty is seen on the
real axis.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field
from fractions import Fraction
from typing import Any

from dobc_design._checks import noun, put
from dobc_design._show.cards import Card, Shown, Told, cut
from dobc_design.conditions.numbers import fields_to_json
from dobc_design.conditions.statement import Statement
from dobc_design.errors import refused, wrong
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.number import ZERO, parse_number, typed_number
from dobc_design.exact.reading import Document, is_list, one_of, shown, shown_number, whole_number
from dobc_design.loop.timing import Timing
from dobc_design.problem.canonical import matrix_text
from dobc_design.verdict import Decided, Verdict

CHANNELS = ("measurement", "disturbance", "exosystem")
NORMS = {"hinf": "H-infinity", "h2": "H2"}
Ends = tuple[Fraction | None, Fraction | None]  # on the real axis; None is infinite


@noun
class HalfPlane(Told):
    """Re s <= left_of, or Re s >= right_of (1/s); exactly one of them is given.

    HalfPlane(left_of=-2) asks for decay at the rate 2 or more, HalfPlane(right_of=-50) for none
    above 50.
    Example:
        >>> wanted = [dd.poles.HalfPlane(left_of=-2), dd.poles.Disk(centre=-4, radius=3)]
        >>> design = dd.design_observer("paper-fixed", region=wanted)
        >>> design.verdict.value
        'proved'
    """

    left_of: Fraction | None
    right_of: Fraction | None

    def __init__(self, *, left_of: Any = None, right_of: Any = None) -> None:
        if (left_of is None) == (right_of is None):
            got = "neither" if left_of is None else "both"
            raise refused(
                "region",
                f"a HalfPlane must have one side, left_of or right_of; got {got}.",
                "For a strip give two half planes in a list.",
            )
        left = _end(left_of, "region.left_of")
        put(self, left_of=left, right_of=_end(right_of, "region.right_of"))

    def __str__(self) -> str:
        low, high = self.real_ends
        if high is not None:
            return f"Re s <= {shown_number(high)}"
        return f"Re s >= {shown_number(low or ZERO)}"

    @property
    def real_ends(self) -> Ends:
        """Where the region begins and ends on the real axis."""
        return self.right_of, self.left_of


def _end(value: Any, key: str) -> Fraction | None:
    """A side of a half plane, exactly; None if it is not given."""
    return None if value is None else parse_number(value, key)


@noun
class Disk(Told):
    """|s - centre| <= radius, with a real centre; both in 1/s."""

    centre: Fraction
    radius: Fraction

    def __init__(self, *, centre: Any, radius: Any) -> None:
        why = ", so that the disk holds something"
        cure = "Give a positive radius (1/s)."
        put(self, centre=parse_number(centre, "region.centre"))
        put(self, radius=read_positive(radius, "region.radius", why=why, cure=cure))

    def __str__(self) -> str:
        return self.in_letter("s")

    def in_letter(self, letter: str) -> str:
        """The disk in words, of eigenvalues that are called s, or z where they are sampled."""
        centre = shown_number(self.centre)
        return f"|{letter} - ({centre})| <= {shown_number(self.radius)}"

    @property
    def real_ends(self) -> Ends:
        """Where the disk begins and ends on the real axis."""
        return self.centre - self.radius, self.centre + self.radius


@noun
class Cone(Told):
    """Damping ratio at least ``damping``: Re s <= 0 and -Re s >= damping |s|; 0 < damping < 1."""

    damping: Fraction

    def __init__(self, *, damping: Any) -> None:
        put(self, damping=parse_number(damping, "region.damping"))
        if not 0 < self.damping < 1:
            got = shown_number(self.damping)
            must = "must lie between 0 and 1, as the cosine of the cone's half angle"
            raise wrong(
                "region.damping", f"{must}; got {got}.", "For real eigenvalues only, ask for 0.999."
            )

    def __str__(self) -> str:
        return f"damping >= {shown_number(self.damping)}"

    @property
    def real_ends(self) -> Ends:
        """Where the cone begins and ends on the real axis."""
        return None, ZERO


SpectralRegion = HalfPlane | Disk | Cone


@noun
class NoiseLimit(Told):
    """An upper bound on the norm of one transfer function of the observer, with F = A - W C.

    ``channel``: "measurement", noise on the measured x to the estimate dhat, C s (sI - F)^-1 W, in
    1/s; "disturbance", an unmodelled d to dhat, C (sI - F)^-1 W, no unit; "exosystem", an input of
    xi' = A xi to the error C eps, C (sI - F)^-1.  ``norm``: "hinf", the largest gain over the
    frequencies, or "h2", the root of the variance under white noise of unit intensity (infinite for
    "measurement" unless C W = 0). An H2 norm may equal its bound, an H-infinity norm has to stay
    below.
    """

    channel: str
    norm: str
    bound: Fraction

    def __init__(self, *, bound: Any, channel: str = "measurement", norm: str = "hinf") -> None:
        one_of(channel, CHANNELS, "noise.channel")
        one_of(norm, sorted(NORMS), "noise.norm")
        put(self, channel=channel, norm=norm, bound=read_positive(bound, "noise"))

    def __str__(self) -> str:
        norm = NORMS[self.norm]
        sign = "<=" if self.norm == "h2" else "<"
        return f"{norm} norm of the {self.channel} channel {sign} {typed_number(self.bound)}"


@noun
class ObserverRequest:
    """What a gain W has to do.  Absent limits are None or empty.  ``rate`` (1/s): every eigenvalue
    has Re <= -rate. ``regions``: where else the spectrum must lie.  ``noise``: bounds on norms.
    ``digits``: significant digits of W. ``period`` (s): sampled observer, whose gain per sample W
    is; with ``timing``, that of a processor, W is the one of the problem.  ``norms``: what passes
    through it is stated; not known with [dynamics]."""

    rate: Fraction | None = None
    regions: tuple[SpectralRegion, ...] = ()
    noise: tuple[NoiseLimit, ...] = ()
    digits: int = 4
    period: Fraction | None = None
    norms: bool = True
    timing: Timing | None = None

    @property
    def sampling(self) -> Timing:
        """When the observer samples."""
        return self.timing or Timing(period=self.period or ZERO, sampled=True)

    @property
    def all_regions(self) -> tuple[SpectralRegion, ...]:
        """The regions and the half planes of the rate and of convergence, in continuous time."""
        slowest = self.rate or ZERO
        return (HalfPlane(left_of=-slowest), *self.regions)


LARGEST_ASKED = Fraction(10**100)
LESS_MAY_DO = (
    "Less may do under the guarantee of [switching], which designs do not look at: "
    "certify gains of your own."
)


def read_observer_request(
    *, rate: Any = None, region: Any = None, noise: Any = None, digits: Any = 4, period: Any = None
) -> ObserverRequest:
    """Read the arguments of ``design_observer``; numbers exactly.  Raises: SpecError for a wrong
    one."""
    check_digits(digits)
    regions = _given(region)
    for each in regions:
        if not isinstance(each, SpectralRegion):
            must = "must be a HalfPlane, a Disk or a Cone, or a list of them"
            raise wrong(
                "region",
                f"{must}; got {shown(each)}.",
                "For example region=dd.poles.Cone(damping=0.7).",
            )
    request = ObserverRequest(
        rate=None if rate is None else read_positive(rate, "rate"),
        regions=regions,
        noise=read_noise(noise),
        digits=digits,
        period=None if period is None else read_positive(period, "period"),
    )
    if request.period is not None:
        require_sampled(request)
    return request


def require_sampled(request: ObserverRequest) -> None:
    """Raises: SpecError for what cannot be asked of a sampled observer."""
    if request.noise:
        raise wrong(
            "noise",
            "cannot be asked of a sampled observer yet; got it together with period.",
            "Leave noise out, or design in continuous time.",
        )
    if not all(isinstance(region, Disk) for region in request.regions):
        raise wrong(
            "region",
            "must be a Disk for a sampled observer: its eigenvalues belong in the unit disk.",
            "Use rate for a decay rate in 1/s.",
        )


def check_digits(digits: Any) -> None:
    """Raises: SpecError if ``digits`` is not a number of significant digits."""
    whole_number(digits, "digits", least=1, most=15, cure="Four digits are a good choice.")


def read_positive(
    value: Any, key: str, *, why: str = "", cure: str = "Leave it out for no limit."
) -> Fraction:
    """A number > 0 and at most 1e100, exactly.  Raises: SpecError for another one."""
    number = parse_number(value, key)
    if 0 < number <= LARGEST_ASKED:
        return number
    must = "at most 1e100" if number > 0 else f"> 0{why}"
    raise wrong(key, f"must be {must}; got {shown_number(number)}.", cure)


def read_noise(value: Any) -> tuple[NoiseLimit, ...]:
    """A limit or a list of them; a number bounds the H-infinity norm from measurement noise to
    dhat."""
    limits = []
    for each in _given(value):
        limit = each if isinstance(each, NoiseLimit) else NoiseLimit(bound=each)
        limits.append(limit)
    return tuple(limits)


def _given(value: Any) -> tuple[Any, ...]:
    """None, one, or a list of them."""
    if value is None:
        return ()
    return tuple(value) if is_list(value) else (value,)


def common_interval(regions: tuple[SpectralRegion, ...]) -> Ends | None:
    """The common part on the real axis; if it is empty (None), so is that of the regions: z brings
    Re z along."""
    ends = [region.real_ends for region in regions]
    # Closed, convex and symmetric regions meet on the real axis if they meet at all.
    low = max((left for left, _ in ends if left is not None), default=None)
    high = min((right for _, right in ends if right is not None), default=None)
    if low is not None and high is not None and low > high:
        return None
    return low, high


@noun
class Envelope:
    """A proposed P (q, q), a rate (1/s) and bounds of P: lower I <= P <= upper I."""

    P: Matrix
    rate: Fraction
    lower: Fraction
    upper: Fraction


@noun
class Answer(Shown, Decided):
    """What every design on request has: the verdict, and what was decided on the way.

    ``obstacle``: what stands in the way of the request, where that has a statement.
    ``under_guarantee``: only arbitrary switching forbids the request, and the problem has a
    guarantee.
    """

    verdict: Verdict
    statements: tuple[Statement, ...] = ()
    obstacle: Statement | None = None
    under_guarantee: bool = False

    @property
    def reason(self) -> str:
        """Why the verdict is what it is, in words."""
        why = self._why()
        return f"{why} {LESS_MAY_DO}" if self.under_guarantee else why

    def _why(self) -> str:
        raise NotImplementedError

    def _card_of(
        self, title: str, facts: Sequence[tuple[str, Any]], lines: Sequence[str] = ()
    ) -> Card:
        return Card(
            title=title,
            verdict=self.verdict.value,
            text=self.reason,
            facts=facts,
            heads=("verdict", "statement"),
            rows=[(each.verdict, each.text) for each in self.statements],
            lines=lines,
        )

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.verdict.value}: {cut(self.reason)}>"


@noun
class ObserverDesign(Answer):
    """An observer gain and what is known of it.

    ``verdict``: PROVED, ``W`` does everything that was asked; REFUTED, nothing can, and ``reason``
    is the proof in words; UNDECIDED, none was found. ``W`` (q, m), ``P`` (q, q) and ``Q`` = P W are
    exact; P proves the envelope |eps(t)| <= k exp(-rate t) |eps(0)| of the statement "lyapunov".
    ``measures``: numbers rounded towards the weaker claim, in 1/s where they are rates.
    ``nearest``: the design for the nearest request that was proved possible, where this one was
    not. ``groups``: where agents have different exosystems, the design of every group by its name;
    W, P and Q then are block diagonal, and a measure is that of the worst group.  ``relaxed``: the
    request is the nearest that all groups meet.
    """

    request: ObserverRequest
    W: Matrix | None = None
    P: Matrix | None = None
    Q: Matrix | None = None
    source: str | None = None
    measures: Mapping[str, float]
    nearest: ObserverDesign | None = None
    groups: Mapping[str, ObserverDesign] = field(default_factory=dict)
    relaxed: bool = False

    def _why(self) -> str:
        groups = self.groups
        if self.relaxed:
            return "every group meets this request."
        if groups and not self.is_proved:
            # The first group that has the verdict of all.
            worst = next(name for name, each in groups.items() if each.verdict is self.verdict)
            return f"group of agent {worst}: {groups[worst].reason}"
        if self.obstacle is not None:
            return self.obstacle.text
        if self.is_proved:
            whose = " of every group" if groups else ""
            return f"W{whose}, with its rounded entries, meets all requirements."
        return "no W was found that meets all requirements, and no proof that there is none."

    def __str__(self) -> str:
        lines = [f"{self.verdict.value}: {self.reason}"]
        if self.groups:
            lines += [f"Group of agent {name}: {design}" for name, design in self.groups.items()]
            return "\n".join(lines)
        if self.W is not None:
            lines.append(f"W = {matrix_text(self.W)} ({self.source})")
        lines += [f"  {statement}" for statement in self.statements]
        return "\n".join(lines)

    def _card(self) -> Card:
        facts = list[tuple[str, Any]]()
        for name, M in (("W", self.W), ("P", self.P), ("Q", self.Q)):
            if M is not None:
                facts.append((name, M))
        for name, value in self.measures.items():
            # Measures are bounds: as they are, without rounding.
            facts.append((name.replace("_", " "), repr(value)))
        return self._card_of("Observer design", facts)

    def to_json(self) -> Document:
        """JSON object; exact numbers as text, infinite ones as null."""
        measures = {}
        # JSON has no infinite numbers.
        for name, value in self.measures.items():
            measures[name] = value if abs(value) < float("inf") else None
        return {
            "verdict": self.verdict.value,
            **fields_to_json(self, "reason", "source", "W", "P", "Q", "statements"),
            "measures": measures,
            # Groups are there only where agents have different exosystems.
            **fields_to_json(self, "nearest", *(["groups"] if self.groups else [])),
        }
