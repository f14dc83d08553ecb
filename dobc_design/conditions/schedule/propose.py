"""Proposals for settling times: the box of all starts, followed in time, and certificates near the
target (section 11).

Two trajectories, the faces of the box, obey the rows with equality and a little more; chords of
them make the tube. Floating point; nothing here is a proof, but the certificates have been accepted
by what decides them.
"""

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dobc_design._checks import noun
from dobc_design.conditions.arcs.claim import ArcWise
from dobc_design.conditions.arcs.stage import claims_in
from dobc_design.conditions.consensus.propose import decay_rate
from dobc_design.conditions.domain import Box as Starts
from dobc_design.conditions.numbers import decimal_above, rounded_down
from dobc_design.conditions.quadratic.claim import Lure, Quadratic
from dobc_design.conditions.quadratic.decide import diagonal_of_inverse, verify_lure
from dobc_design.conditions.quadratic.propose import fast_lures, linear_rate, raise_rate
from dobc_design.conditions.schedule import decide, propose_cycles
from dobc_design.conditions.separable.claim import ErrorBound, Separable
from dobc_design.conditions.separable.coordinates import seen_through
from dobc_design.conditions.separable.decide import composite_rate
from dobc_design.conditions.separable.propose import first_certificate, propose_separable
from dobc_design.conditions.separable.propose_observer import propose_error_bound, with_kappa
from dobc_design.conditions.separable.timing import verify_readings
from dobc_design.exact.matrix import Array, Matrix, to_float
from dobc_design.exact.number import ZERO, root_above
from dobc_design.exact.work import STAGE, WorkLimitError, at_most
from dobc_design.loop.arcs import unreached
from dobc_design.loop.guarantee import Round
from dobc_design.loop.loop import Loop

from .chords import ACCURACY, Chords
from .claim import Cycles, Last, Tube
from .cycles import why_not
from .rows import Box, MovingRows, RowsBySize, heard_from, heard_last

LONGEST = 10.0  # times what the rate near the target would take
WIDER = 1.25  # times what a box grows to where couplings rise; beyond it is given up
# parts of the radius for which certificates near the target are sought
LEVELS = (1.0, 0.3, 0.1, 0.03, 0.01)
RADII = (0.03, 0.08, 0.16, 0.25)  # of quadratic ones
OF_ARCS = (1.0, 0.95, 0.9, 0.8, 0.6, 0.3)  # of arc-wise ones, which need not rise
ROOM = 0.999  # of a level
SMALLEST = 1e-300
# of the decay rate of A - WC: that of E; 0.7 for the observer's pair of quadratic certificates
OBSERVER = 0.9
PAIR = 0.7
SLOWER = Fraction(1, 2)  # of the rate of a certificate that is to hold with late readings
SHARE = Fraction(9, 10)  # of the rate of E that V = N + kappa E may use
ABOVE = 1e-7  # of numbers that have to be above a matrix, for rounding
#: By which part of their speed and of the rate near the target faces fall more slowly, and how much
#: a chord may bend.
TRIED = (
    (0.0005, 0.002),
    (0.001, 0.002),
    (0.001, 0.004),
    (0.003, 0.002),  # the first one for arbitrary switching
    (0.01, 0.004),
    (0.02, 0.02),
    (0.05, 0.1),
)
FIRST_STEP = 1e-4  # times 1 / rate
SHORT = 0.01  # the same of the longest chord where readings are late
MOST_TIMES = 2000
#: Rows n m, and rows and channels of one mode, up to which quadratic certificates are looked for:
#: dense programs.
MOST_ROWS = 24
MOST_BLOCK = 90


@noun
class Asked:
    """Starts |e|_inf <= radius, |eps_i| <= disturbance, and the tolerance to be kept from some time
    on."""

    radius: Fraction
    disturbance: Fraction
    tolerance: Fraction


def observed(loop: Loop, W: Matrix | None, T: Matrix | None = None) -> ErrorBound | None:
    """P, beta, size of the observer, and a kappa for weights of at least 1 (of T e); None if none
    is found, or needed."""
    exosystem, W = seen_through(loop, T, W)
    if exosystem is None or W is None:
        return None
    # A little slower than the observer, so that there is a P.
    rate = OBSERVER * decay_rate(exosystem, W)
    error = propose_error_bound(exosystem, W, rate=rate)
    return None if error is None else with_kappa(error)


def approach(
    loop: Loop, W: Matrix | None, asked: Asked, *, limit: float | None
) -> Iterator[tuple[Tube, Last]]:
    """Tubes from the box asked for, tightest first, with the certificate that settles first, before
    ``limit`` (s)."""
    error = observed(loop, W)
    if error is None and loop.groups:
        return
    turns = loop.guarantee.round
    last = _certificates(loop, W, asked, error)
    rows = RowsBySize(loop, _widest(asked, error))
    modes = {""} if turns is None else {phase.mode for phase in turns.phases}
    if any(rows.get(mode) is None for mode in modes) or not last.found or not last.fastest > 0:
        return
    # Without a guarantee one row is about all modes; the coarser paths are enough then.
    tried = TRIED[3:] if turns is None else TRIED
    for slack, bend in tried:
        path = _Path(
            rows=rows,
            turns=turns,
            error=error,
            asked=asked,
            slack=slack,
            bend=bend,
            fastest=last.fastest,
            rests=last.rests,
        )
        # The tightest path is the first; the last of them may end on its way.
        arrives = path.follow(limit)
        if not arrives and (slack, bend) != TRIED[-1]:
            continue
        choice = _choose(path, last.found)
        if choice is not None:
            until, certificate = choice
            yield path.tube(until), certificate


@noun
class _Certificates:
    """What may take over near the target, and the fastest rate (1/s) known there, about."""

    found: Sequence[Last]
    fastest: float

    @property
    def rests(self) -> Fraction | None:
        """The largest kappa of weights that keep to the guarantee; None without such."""
        kappas = list[Fraction]()
        for own in self.found:
            if isinstance(own, Cycles):
                kappas.append(own.error.kappa if own.error else ZERO)
        return max(kappas, default=None)


def _certificates(
    loop: Loop, W: Matrix | None, asked: Asked, error: ErrorBound | None
) -> _Certificates:
    is_timed = loop.guarantee.round is not None
    # Where a mode alone leaves agents without a pin no certificate serves all modes.
    apart = is_timed and any(unreached(loop, [arcs]) for arcs in loop.modes.values())
    found = [] if apart else list[Last](_near(loop, W, asked, error))
    boxes = [each for each in found if isinstance(each, Separable)] or found
    fastest = max((float(decide.rate_near(each)) for each in boxes), default=0.0)
    if is_timed:
        found += _kept(loop, W, asked, error)
        fastest = max(fastest, propose_cycles.late_rate(loop))
    return _Certificates(found=found, fastest=fastest)


def slowed(loop: Loop, W: Matrix | None, own: Separable | None) -> Separable | None:
    """The same claim at a rate at which it holds with late readings, where some are."""
    if own is None or loop.timing is None:
        return own
    slow = replace(own, alpha=own.alpha * SLOWER)
    return slow if verify_readings(loop, W, slow).wrong is None else None


def _widest(asked: Asked, error: ErrorBound | None) -> Fraction:
    """The largest box that is followed: as far as the estimation error alone may push, and more."""
    # At the decay rate beta the load adds up to at most its first value over beta.
    pushed = asked.radius
    if error is not None:
        pushed += asked.disturbance * root_above(error.size, unit=10**6) / error.beta
    return pushed * Fraction(WIDER)


@dataclass(slots=True, kw_only=True, eq=False)
class _Path:
    """Boxes (upper, lower) (2 n,) at times (s), so far apart as they bend, one at each change of
    modes.  On each chord the faces are as fast as the rows ask at its slower end, and a little
    slower.  ``rests``: kappa of a certificate that keeps its size, None if there is none."""

    rows: RowsBySize
    turns: Round | None
    error: ErrorBound | None
    asked: Asked
    slack: float
    bend: float
    fastest: float
    rests: Fraction | None
    times: list[Fraction] = field(default_factory=lambda: [ZERO])
    boxes: list[Array] = field(default_factory=list)

    @np.errstate(all="ignore")  # near the ends of the floats
    def follow(self, limit: float | None) -> bool:
        """Go on until the box lies within the tolerance or the ``limit`` is reached; False if it
        does not."""
        radius = float(self.asked.radius)
        goal = float(self.asked.tolerance)
        if self.rests is not None:
            goal *= ROOM
        kappa = float(self.rests or 0)
        longest = limit
        if longest is None:
            longest = LONGEST * math.log(max(radius / goal, 2.0)) / self.fastest
        first = FIRST_STEP / self.fastest
        chords = Chords(
            bend=self.bend,
            pace=self.fastest,
            step=first,
            longest=SHORT / self.fastest if self.rows.loop.timing else math.inf,
        )
        self.boxes = [np.full(2 * self.rows.loop.n, radius)]
        while len(self.times) < MOST_TIMES and float(self.times[-1]) < longest:
            rests = goal - kappa * self.load(self.times[-1])
            first = heard_from(self.times, self.times[-1], self.rows.loop.timing)
            if float(np.max(self.boxes[first:])) <= rests:
                return True
            if not self._go_on(chords, lands=rests if rests > 0 else None):
                return False
        return limit is not None and len(self.times) < MOST_TIMES

    def _go_on(self, chords: Chords, *, lands: float | None) -> bool:
        """Add a chord; False where none is found, or where it grows too far."""
        now = self.times[-1]
        box = self.boxes[-1]
        mode = ""
        change = None
        if self.turns is not None:
            place, _, change = self.turns.at(now)
            mode = self.turns.phases[place].mode
        past = heard_last(self.boxes, self.times, self.rows.loop.timing)
        rows = self.rows.get(mode, self.rows.level(float(np.max(past, initial=box.max()))))
        if rows is None:
            return False
        found = chords.next(box, now, change, partial(self._asked, rows, past), lands=lands)
        if found is None:
            return False
        after, end = found
        # The tables reach no further.
        if float(end.max()) > ROOM * float(self.rows.most):
            return False
        self.times.append(after)
        self.boxes.append(end)
        return True

    def _asked(self, rows: MovingRows, past: Any, boxes: Array, t: Fraction) -> Array:
        """The slopes of the faces that the rows ask for where neighbours may still read ``past``
        boxes, and a little more."""
        faces = boxes.reshape(len(boxes), 2, -1)
        loads = np.full(len(boxes), self.load(t))
        heard = Box.floats(np.maximum(past, boxes).reshape(faces.shape))
        asked = rows.needed(Box.floats(faces), loads, heard)
        slower = asked + self.slack * (np.abs(asked) + self.fastest * faces)
        return np.asarray(slower).reshape(boxes.shape)

    def load(self, t: Fraction) -> float:
        """|C eps_i| at most."""
        if self.error is None:
            return 0.0
        first = math.sqrt(float(self.error.size)) * float(self.asked.disturbance)
        return first * math.exp(-float(self.error.beta * t))

    def tube(self, until: Fraction) -> Tube:
        """The chords between the boxes up to a time of theirs."""
        n = self.rows.loop.n
        count = self.times.index(until) + 1
        boxes = [(self.asked.radius,) * (2 * n)]
        for box in self.boxes[1:count]:
            boxes.append(tuple(_above(x, digits=9) for x in box.tolist()))
        return Tube(
            times=tuple(self.times[:count]),
            upper=tuple(box[:n] for box in boxes),
            lower=tuple(box[n:] for box in boxes),
            error=self.error,
        )


@noun(eq=False)
class _Handover:
    """A certificate at every box of a path, in floats: its size there, and up to which size it
    holds; ``may_begin`` there; the rate (1/s) of its size after ``wait`` (s); |e|_inf <= ``height``
    times its size."""

    levels: Array
    most: float
    height: float
    rate: float
    wait: float = 0.0
    may_begin: bool | NDArray[np.bool_] = True

    def settled(self, times: Array, tolerance: float) -> Array:
        """When |e|_inf is within the tolerance if it takes over at each of the times; inf where it
        cannot."""
        left = np.maximum(np.log(self.levels * self.height / tolerance), 0.0)
        lasting = self.wait + left / max(self.rate, SMALLEST)
        total = times + np.where(left == 0, 0.0, lasting)
        # A certificate that only keeps its size is entered exactly; others have room to spare.
        most = ROOM * self.most if self.rate else self.most / ROOM
        return np.where(self.may_begin & (self.levels <= most), total, np.inf)


@np.errstate(all="ignore")
def _choose(path: _Path, candidates: Sequence[Last]) -> tuple[Fraction, Last] | None:
    """When which certificate takes over, for the earliest settling time."""
    times = np.array([float(t) for t in path.times])
    faces = np.stack(path.boxes).reshape(len(path.boxes), 2, -1)
    widths = faces.max(axis=1) * (1 + ACCURACY)
    # Readings may still be those of before.
    late = [heard_from(path.times, t, path.rows.loop.timing) for t in path.times]
    widths = np.array([widths[first : k + 1].max(axis=0) for k, first in enumerate(late)])
    loads = np.array([path.load(t) for t in path.times])
    earliest = math.inf
    best: tuple[int, Last] | None = None
    for each in candidates:
        if isinstance(each, Quadratic):
            handover = _of_quadratic(path, each, widths, loads)
        else:
            handover = _of_weights(path, each, widths, loads)
        total = handover.settled(times, float(path.asked.tolerance))
        k = int(np.argmin(total))
        if total[k] < earliest:
            earliest = float(total[k])
            best = (k, each)
    # At the first time there is no path to follow.
    if best is None or best[0] == 0:
        return None
    place, certificate = best
    return path.times[place], certificate


def _of_weights(path: _Path, own: Separable | Cycles, widths: Array, loads: Array) -> _Handover:
    """The size N + kappa E; weights that move take over with those that a phase begins with."""
    v = np.ones(widths.shape)
    may_begin: bool | NDArray[np.bool_] = True
    wait = ZERO
    if isinstance(own, Separable):
        v = np.array([float(x) for x in own.v])
    elif own.phases:
        wait = max(each.times[-1] for each in own.phases)
    if path.turns is not None and isinstance(own, Cycles) and own.phases:
        places = list[int]()
        begins = list[bool]()
        for t in path.times:
            place, begun, _ = path.turns.at(t)
            places.append(place)
            begins.append(begun == t)
        first = np.array([to_float((phase.v[0],))[0] for phase in own.phases])
        v = first[places]
        may_begin = np.array(begins)
    kappa = 0.0 if own.error is None else float(own.error.kappa)
    return _Handover(
        levels=np.asarray((widths / v).max(axis=1) + kappa * loads),
        most=math.inf if own.rho is None else float(own.rho),
        height=float(decide.tallest(own)),
        rate=float(decide.rate_near(own)),
        wait=float(wait),
        may_begin=may_begin,
    )


def _of_quadratic(path: _Path, own: Lure | ArcWise, widths: Array, loads: Array) -> _Handover:
    loop = path.rows.loop
    P_e = np.abs(to_float(own.P_e.to_dense()))
    b = np.repeat(widths, loop.m, axis=1)
    stretch = 1.0
    if own.P is not None and path.error is not None:
        stretch = math.sqrt(float(relative_bound(own.P, path.error.P)))
    squares = np.einsum("ti,ij,tj->t", b, P_e, b) + loop.n * (stretch * loads) ** 2
    most = decide.largest_square(loop, own)
    return _Handover(
        levels=np.sqrt(squares),
        most=math.inf if most is None else math.sqrt(float(most)),
        height=math.sqrt(float(max(diagonal_of_inverse(own.P_e)))),
        rate=float(decide.rate_near(own)),
    )


def _near(
    loop: Loop, W: Matrix | None, asked: Asked, error: ErrorBound | None
) -> Iterator[Separable | Lure | ArcWise]:
    """Certificates that may take over near the target."""
    # Linear couplings look the same from everywhere; else a smaller box may have a faster rate.
    levels = [1.0]
    if not loop.is_linear:
        half = asked.tolerance / 2
        levels = [part for part in LEVELS if part * asked.radius >= half] or [LEVELS[0]]
    slowest = 0.0
    for part in levels:
        plan = propose_separable(loop, rho=Fraction(part) * asked.radius)
        if plan is None:
            continue
        own = error
        if error is not None:
            rate = min(Fraction(plan.rate), SHARE * error.beta)
            # What V = N + kappa E loses by E has to leave the rate of N.
            own = with_kappa(error, rate=rate, least=Fraction(float(plan.v.min())))
        whole_plan = replace(plan, error=own)
        whole = first_certificate(loop, W, whole_plan, everywhere=loop.is_linear)
        found = slowed(loop, W, whole)
        if found is not None and composite_rate(found) > 0:
            slowest = max(slowest, float(composite_rate(found)))
            yield found
    if loop.timing is not None:
        return
    radii = [part * float(asked.radius) for part in RADII]
    forms: list[Lure] = []
    # They take longest; of half a stage there are some, and time is left for the tube.
    with at_most(STAGE // 2), suppress(WorkLimitError):
        for lure in _quadratic(loop, W, radii, slowest):
            forms.append(lure)
    yield from forms
    # No box serves all modes there, or couplings fall: what arcs take may be paid for even so.
    for part in () if slowest else OF_ARCS:
        radius = decimal_above(asked.radius * Fraction(part))
        yield from claims_in(loop, W, Starts(radius, decimal_above(asked.disturbance)))


def _kept(loop: Loop, W: Matrix | None, asked: Asked, error: ErrorBound | None) -> Iterator[Cycles]:
    """Weights that move under the guarantee, and the tolerance itself as a box that is never
    left."""
    within = None if loop.is_linear else asked.tolerance
    late = loop.timing is not None
    rests = Cycles(phases=(), rate=None, rho=within, error=error, late=late)
    if why_not(loop, W, rests) is None:
        yield rests
    levels = [1.0] if loop.is_linear else LEVELS
    for part in levels:
        rho = None if loop.is_linear else Fraction(part) * asked.radius
        found = propose_cycles.propose(loop, W, rho=rho, error=error, late=late)
        if found is not None:
            yield found
            return


def _quadratic(loop: Loop, W: Matrix | None, radii: list[float], slowest: float) -> Iterator[Lure]:
    """Certificates at the given radii, one each, smallest first; those only whose rate (1/s)
    exceeds ``slowest``. Linear couplings need no radius and have one.  Nothing for networks beyond
    MOST_ROWS or MOST_BLOCK."""
    arcs = max(len(each) for each in loop.modes.values())
    large = loop.size > MOST_ROWS or loop.size + arcs * loop.m > MOST_BLOCK
    # They know pins as gains, the same in every mode.
    if large or loop.fixed:
        return

    def holds(lure: Lure) -> bool:
        return verify_lure(loop, lure).is_proved

    observer = ZERO
    fastest = linear_rate(loop, W)
    exosystem = loop.joint_exosystem
    if exosystem is not None:
        rate = 0.0 if W is None else max(0.0, PAIR * decay_rate(exosystem, W))
        observer = rounded_down(rate, digits=6)
        fastest = min(fastest, float(observer))
    rates = (slowest, fastest)
    for radius in [None] if loop.is_linear else sorted(radii):
        lures = fast_lures(loop, radius=radius, W=W, observer=observer, rates=rates)
        lure = next(filter(holds, lures), None)
        if lure is None:
            break  # larger radii are harder
        yield raise_rate(loop, lure, holds=holds)


def relative_bound(new: Matrix, old: Matrix) -> Fraction:
    """A number f with new <= f old, rounded up; old > 0."""
    quotient = np.linalg.solve(to_float(old), to_float(new))
    return _above(float(np.max(np.linalg.eigvals(quotient).real)) * (1 + ABOVE), digits=9)


def _above(value: float, *, digits: int = 7) -> Fraction:
    """A decimal not below the value, up to its last digit."""
    return Fraction(f"{value * (1 + 10.0 ** (1 - digits)):.{digits}g}")
