"""What certificates whose numbers move with time claim (theory, section 11).

**Weights that keep to a guarantee** (``Cycles``).  A signal passes through phases: phase p lasts
between ``shortest`` and ``longest``, its mode is on, then a phase of its successors follows.
Claim: in phase p, N(t, e) = max_i |e_i| / v^p_i(t), t from its beginning, does not increase while
N <= rho, up to max_i |C eps_i| / v_i; and for every t at which it may end, v^p(t) <= exp(-rate t)
v^q(0) for every successor q.  With kappa (beta - rate) min v >= 1, V = N + kappa E falls at least
by exp(-rate t) over each phase and never rises.  A phase without a longest time keeps its last
weights, and there N falls at the rate.

``late``: the same with readings of neighbours up to ``delay`` old, off by up to the part ``event``,
no older than the shortest phase and of nothing from before the start.  Then N <= N_0 within a phase
that begins with N_0: while that holds, a reading is at most 1 + event times the largest v_j of the
last ``delay`` seconds, in units of N; the phase before is counted as exp(rate t) v(t'), t its end
and t - t' <= delay.  Rows hold with these v_j, and without an end with their largest, times
exp(rate delay).  In units of V - kappa E, which rises within a phase, readings of before only
count as larger.

In coordinates z_i = T e_i (``separable.coordinates``) weights have an entry for each component of
z; gains of fixed ``ranges`` make rows that are convex in v, and hold on a segment where they hold
at its ends.

Without weights the claim has no rate: couplings rise as far out as 2 rho, strictly at 0, every
cycle of phases reaches every agent from a pin, and with v = 1 (kappa beta >= 1) V <= rho holds for
ever; then every error decays.

**Boxes that hold every run, and what takes over** (``Descent``).  Claim: -lower(t) <= e(t) <=
upper(t) on [0, T], linear between the times, from every start |e|_inf <= radius and |eps_i| <=
disturbance, whatever modes are on; |C eps_i(t)| <= sqrt(size) disturbance exp(-beta t).  At T the
box lies in {W <= level} of a certificate near the target, whose size W decays from there on;
|e|_inf <= height W.  Where the guarantee of [switching] says which mode is on at a time, only that
one is on.

Proof.  The box is subtangential: on a face that e_i touches, its derivative is no larger than that
of the face, by the rows.  With late readings of neighbours rows have the largest u_j and l_j of the
last ``delay`` seconds, times 1 + event, in place of those of now: until a first run leaves the box,
every reading lies in between.  What takes over holds with late readings, and the boxes of the last
``delay`` seconds lie in its level set: so do readings of before, which its rows count as larger
still.  Where the certificate is max-separable, W = N + kappa E with the P of the
tube; where it is quadratic or arc-wise, W^2 = e'P_e e + sum eps_i'P' eps_i <= sum |P_e|_kl b_k b_l
+ n stretch^2 E^2 for |e| <= b and P' <= stretch^2 P.  Weights that keep to the guarantee take over
where a phase begins; without weights W = N + kappa E, v = 1, stays.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from itertools import chain, pairwise

from dobc_design._checks import noun
from dobc_design._show.cards import Card, Shown
from dobc_design.conditions.arcs.claim import ArcWise
from dobc_design.conditions.numbers import fields_to_json
from dobc_design.conditions.quadratic.claim import Lure
from dobc_design.conditions.quadratic.sectors import GainRange
from dobc_design.conditions.separable.claim import (
    ErrorBound,
    Separable,
    error_to_json,
    reach,
    require_coordinates,
    spread,
)
from dobc_design.errors import SpecError, wrong
from dobc_design.exact.interval import Interval, exp
from dobc_design.exact.matrix import Matrix, Vector
from dobc_design.exact.number import ONE, ZERO
from dobc_design.exact.reading import Document
from dobc_design.loop.loop import Loop

SEPARABLE = "max-separable"
QUADRATIC = "quadratic"
SCHEDULE = "schedule"
ARC_WISE = "arc-wise"
# of the radius: below this every |e_ic| has settled, where no tolerance is named
SETTLED = Fraction(1, 100)
FARTHEST = 10_000  # exp(-x) beyond is bounded by exp(-FARTHEST)

Vectors = tuple[Vector, ...]


def shrunk(value: Fraction, rate: Fraction, time: Fraction) -> Interval:
    """Enclose value exp(-rate time) for value, rate, time >= 0."""
    power = rate * time
    if power > FARTHEST:
        # Rationals of such a size are long, and slow to compute with; 0 is a lower bound, too.
        least = exp(Interval.point(Fraction(-FARTHEST)))
        return Interval(ZERO, (least * value).hi)
    return exp(Interval.point(-power)) * value


def _rise_from_zero(times: Vector) -> bool:
    if not times or times[0]:
        return False
    return all(before < after for before, after in pairwise(times))


@noun
class Weights(Shown):
    """Weights of one phase at ``times`` (s) from its beginning, linear in between: one entry > 0
    per agent, or per component of z."""

    times: Vector
    v: Vectors

    def to_json(self) -> Document:
        return fields_to_json(self, "times", "v")


@noun
class Cycles:
    """A claim as above: weights phase by phase, ``rate`` (1/s), ``rho`` (None: linear couplings,
    every rho), the observer's ``error`` (None without an exosystem); by the graphs alone without
    phases and rate; in coordinates with ``T`` and ``ranges``; ``late``: with the readings that the
    problem states, not with those of the same instant.  Raises: SpecError unless weights,
    rate and rho are > 0, times rise from 0, and there are both phases and a rate, or neither."""

    phases: tuple[Weights, ...]
    rate: Fraction | None
    rho: Fraction | None
    error: ErrorBound | None = None
    T: Matrix | None = None
    ranges: tuple[GainRange, ...] = ()
    late: bool = False

    def __post_init__(self) -> None:
        require_coordinates(self.T)
        has_rate = self.rate is not None
        has_weights = bool(self.phases)
        if has_rate is not has_weights or (self.T is not None and not has_weights):
            what = "a rate belongs to weights, weights to a rate, and T to weights."
            raise SpecError(what, key="rate")
        for number in (self.rate, self.rho):
            if number is not None and number <= 0:
                raise SpecError("rate and rho must be > 0.", key="rate")
        for each in self.phases:
            if not _rise_from_zero(each.times) or len(each.times) != len(each.v):
                raise wrong("times", "must rise from 0, with weights for each.")
            if min(chain.from_iterable(each.v)) <= 0:
                raise SpecError("weights must be > 0.", key="v")

    def _all_weights(self) -> Iterator[Vector]:
        """The weights of all phases and times."""
        for each in self.phases:
            yield from each.v

    @property
    def least(self) -> Fraction:
        """The least weight of all phases and times; 1 where there are none."""
        return min(chain.from_iterable(self._all_weights()), default=ONE)

    @property
    def most(self) -> Fraction:
        """The largest weight of all phases and times; 1 where there are none."""
        return max(chain.from_iterable(self._all_weights()), default=ONE)

    @property
    def tallest(self) -> Vector:
        """The largest weights of all phases and times, entry by entry."""
        return tuple(map(max, zip(*self._all_weights(), strict=True)))

    def spread(self, loop: Loop) -> Fraction:
        """The largest N of errors with |e|_inf <= 1, in any phase that may be first."""
        if not self.phases:
            return ONE
        # A run may begin with any of these phases, and N is counted from there.
        begun = zip(loop.guarantee.phases, self.phases, strict=True)
        sizes = [spread(self.T, each.v[0]) for phase, each in begun if phase.first]
        return max(sizes, default=ONE)

    @property
    def height(self) -> Fraction:
        """The largest |e|_inf exp(rate t) at a time t of a phase, of errors with N = 1 when it
        begins: N does not rise within a phase, and falls at the rate from one phase to the next; 1
        without weights."""
        rate = self.rate or ZERO
        heights = list[Fraction]()
        for each in self.phases:
            for place, later in enumerate(each.times):
                # On the segment that ends here weights are at most the larger of both ends, and
                # exp(rate t) is largest at the later one.
                before = each.v[max(0, place - 1)]
                v = tuple(map(max, before, each.v[place]))
                heights.append(reach(self.T, v) / shrunk(ONE, rate, later).lo)
        return max(heights, default=ONE)

    def factor(self, loop: Loop) -> Fraction:
        """|e(t)|_inf <= factor |e(0)|_inf exp(-rate t) + what the estimation error adds."""
        return self.spread(loop) * self.height

    def to_json(self) -> Document:
        values = fields_to_json(self, "rate", "rho", "phases")
        if self.T is not None:
            values |= fields_to_json(self, "T", "ranges")
        if self.late:
            values["late"] = True
        return values | error_to_json(self.error)


Last = Separable | Lure | ArcWise | Cycles  # what may take over from a box that moves


@noun
class Tube(Shown):
    """Boxes -lower <= e <= upper at ``times`` (s) from 0 on, linear in between; one entry > 0 per
    agent, for each of its components.  ``error``: P, beta and size of the observer (kappa is not
    used); None without an exosystem.
    Raises: SpecError unless times rise from 0 and boxes are as many as times and not empty."""

    times: Vector
    upper: Vectors
    lower: Vectors
    error: ErrorBound | None = None

    def __post_init__(self) -> None:
        if not _rise_from_zero(self.times):
            raise wrong("times", "must rise from 0.")
        if not len(self.times) == len(self.upper) == len(self.lower):
            raise SpecError("there must be one box for each time.", key="upper")
        if min(self._entries()) <= 0:
            raise SpecError("boxes must have entries > 0.", key="upper")

    @classmethod
    def start(cls, loop: Loop, radius: Fraction, error: ErrorBound | None) -> Tube:
        """The box of all starts, from which a certificate takes over at once."""
        box = (radius,) * loop.n
        return cls(times=(ZERO,), upper=(box,), lower=(box,), error=error)

    def _entries(self) -> Iterator[Fraction]:
        for box in (*self.upper, *self.lower):
            yield from box

    @property
    def ends(self) -> Fraction:
        """Its last time, in s."""
        return self.times[-1]

    @property
    def most(self) -> Fraction:
        """The largest entry of all boxes."""
        return max(self._entries())

    def widths(self, k: int) -> Vector:
        """The larger of upper and lower of every agent at the k-th time."""
        return tuple(map(max, self.upper[k], self.lower[k]))

    def _card(self) -> Card:
        until = f"{float(self.ends):.6g} s"
        segments = str(len(self.times) - 1)
        return Card(title="Tube", facts=[("until", until), ("segments", segments)])

    def to_json(self) -> Document:
        observed = error_to_json(self.error)
        # A box that moves has no V, so that nothing weighs E against N.
        observed.pop("kappa", None)
        return fields_to_json(self, "times", "upper", "lower") | observed


@noun
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
                raise wrong(name, "must be > 0.")
        if self.disturbance < 0:
            raise wrong("disturbance", "must be >= 0.")
        if self.time < self.tube.ends:
            raise wrong("time", "must not lie before the end of the tube.")

    @property
    def kind(self) -> str:
        """Of the certificate."""
        if isinstance(self.certificate, Lure):
            return QUADRATIC
        if isinstance(self.certificate, ArcWise):
            return ARC_WISE
        return SCHEDULE if isinstance(self.certificate, Cycles) else SEPARABLE

    def to_json(self) -> Document:
        last = fields_to_json(self, "kind", "level", "height", "stretch", "certificate")
        return fields_to_json(self, "tolerance", "time", "tube") | {"last": last}
