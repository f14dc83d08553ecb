"""Proposals for settling times: the box of all starts, followed in time, and certificates near the
target (section 11).

Two trajectories, the faces of the box, obey the rows with equality and a little more; chords of
them make the tube. Floating point; nothing here is a proof, but the certificates have been accepted
by what decides them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import partial
from typing import Final

import numpy as np

from dobc_design.conditions.consensus.propose import decay_rate
from dobc_design.conditions.numbers import rounded_down
from dobc_design.conditions.quadratic.claim import Lure
from dobc_design.conditions.quadratic.decide import diagonal_of_inverse, differences, verify_lure
from dobc_design.conditions.quadratic.propose import fast_lures, linear_rate, raise_rate
from dobc_design.conditions.quadratic.sectors import relied_differences
from dobc_design.conditions.schedule import decide, propose_cycles
from dobc_design.conditions.schedule.claim import Last, Tube
from dobc_design.conditions.schedule.cycles import Cycles, why_not
from dobc_design.conditions.schedule.propose_cycles import ACCURACY, Chords
from dobc_design.conditions.schedule.rows import Box, MovingRows
from dobc_design.conditions.separable.claim import ErrorBound, Separable
from dobc_design.conditions.separable.coordinates import seen_through
from dobc_design.conditions.separable.decide import composite_rate
from dobc_design.conditions.separable.propose import first_certificate, propose_separable
from dobc_design.conditions.separable.propose_observer import propose_error_bound, with_kappa
from dobc_design.exact.matrix import Matrix, to_float
from dobc_design.exact.number import root_above
from dobc_design.loop.arcs import unreached
from dobc_design.loop.guarantee import Round
from dobc_design.loop.loop import Loop
from dobc_design.solvers.program import Array
from dobc_design.verdict import Verdict

LONGEST: Final = 10.0  # times what the rate near the target would take
WIDER: Final = 1.25  # times what a box grows to where couplings rise; beyond it is given up
# parts of the radius for which certificates near the target are sought
LEVELS: Final = (1.0, 0.3, 0.1, 0.03, 0.01)
RADII: Final = (0.03, 0.08, 0.16, 0.25)  # of quadratic ones
ROOM: Final = 0.999  # of a level
SMALLEST: Final = 1e-300
# of the decay rate of A - WC: that of E; 0.7 for the observer's pair of quadratic certificates
OBSERVER: Final = 0.9
PAIR: Final = 0.7
SHARE: Final = Fraction(9, 10)  # of the rate of E that V = N + kappa E may use
ABOVE: Final = 1e-7  # of numbers that have to be above a matrix, for rounding
#: By which part of their speed and of the rate near the target faces fall more slowly, and how much
#: a chord may bend.
TRIED: Final = (
    (0.0005, 0.002),
    (0.001, 0.002),
    (0.001, 0.004),
    (0.003, 0.002),  # the first one for arbitrary switching
    (0.01, 0.004),
    (0.02, 0.02),
    (0.05, 0.1),
)
FIRST_STEP: Final = 1e-4  # times 1 / rate
MOST_TIMES: Final = 2000
#: Rows n m, and rows and channels of one mode, up to which quadratic certificates are looked for:
#: dense programs.
MOST_ROWS: Final = 24
MOST_BLOCK: Final = 90


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """Starts |e|_inf <= radius, |eps_i| <= disturbance, and the tolerance to be kept from some time
    on."""

    radius: Fraction
    disturbance: Fraction
    tolerance: Fraction


def observed(loop: Loop, W: Matrix | None, T: Matrix | None = None) -> ErrorBound | None:
    """P, beta, size of the observer, and a kappa for weights of at least 1 (of T e); None if none
    is found, or needed."""
    exosystem, W = (loop.joint_exosystem, W) if T is None else seen_through(loop, T, W)
    if exosystem is None or W is None:
        return None
    error = propose_error_bound(exosystem, W, rate=OBSERVER * decay_rate(exosystem, W))
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
    apart = turns is not None and any(unreached(loop, [arcs]) for arcs in loop.modes.values())
    candidates = [] if apart else list[Last](_near(loop, W, asked, error))
    boxes = [each for each in candidates if isinstance(each, Separable)] or candidates
    fastest = max((float(decide.rate_near(each)) for each in boxes), default=0.0)
    if turns is not None:
        candidates += _kept(loop, W, asked, error)
        fastest = max(fastest, propose_cycles.late_rate(loop))
    grown = asked.radius + (
        0 if error is None else asked.disturbance * root_above(error.size, unit=10**6) / error.beta
    )
    rows = decide.RowsBySize(loop, grown * Fraction(WIDER))
    modes = {phase.mode for phase in turns.phases} if turns is not None else {""}
    if any(rows.get(mode) is None for mode in modes) or not candidates or not fastest > 0:
        return
    kappas = [
        own.error.kappa if own.error else Fraction(0)
        for own in candidates
        if isinstance(own, Cycles)
    ]
    rests = max(kappas, default=None)
    for slack, bend in TRIED[0 if turns else 3 :]:
        path = _Path(
            rows=rows,
            turns=turns,
            error=error,
            asked=asked,
            slack=slack,
            bend=bend,
            fastest=fastest,
            rests=rests,
        )
        whole = path.follow(limit)
        choice = (
            _choose(loop, path, candidates, asked) if whole or (slack, bend) == TRIED[-1] else None
        )
        if choice is not None:
            yield path.tube(choice[0]), choice[1]


@dataclass(slots=True, kw_only=True, eq=False)
class _Path:
    """Boxes (upper, lower) (2 n,) at times (s), so far apart as they bend, one at each change of
    modes.  On each chord the faces are as fast as the rows ask at its slower end, and a little
    slower.  ``rests``: kappa of a certificate that keeps its size, None if there is none."""

    rows: decide.RowsBySize
    turns: Round | None
    error: ErrorBound | None
    asked: Asked
    slack: float
    bend: float
    fastest: float
    rests: Fraction | None
    times: list[Fraction] = field(default_factory=lambda: [Fraction(0)])
    boxes: list[Array] = field(default_factory=list)

    @np.errstate(all="ignore")  # near the ends of the floats
    def follow(self, limit: float | None) -> bool:
        """Go on until the box lies within the tolerance or the ``limit`` is reached; False if it
        does not."""
        radius, goal = float(self.asked.radius), float(self.asked.tolerance)
        goal = goal if self.rests is None else goal * ROOM
        kappa, most = float(self.rests or 0), ROOM * float(self.rows.most)
        longest = (
            LONGEST * math.log(max(radius / goal, 2.0)) / self.fastest if limit is None else limit
        )
        chords = Chords(bend=self.bend, pace=self.fastest, step=FIRST_STEP / self.fastest)
        self.boxes = [np.full(2 * self.rows.loop.n, radius)]
        while len(self.times) < MOST_TIMES and float(self.times[-1]) < longest:
            now, box = self.times[-1], self.boxes[-1]
            rests = goal - kappa * self.load(now)
            if float(box.max()) <= rests:
                return True
            mode, change = "", None
            if self.turns is not None:
                place, _, change = self.turns.at(now)
                mode = self.turns.phases[place].mode
            rows = self.rows.get(mode, self.rows.level(float(box.max())))
            lands = None if rests <= 0 else rests
            found = (
                None
                if rows is None
                else chords.next(box, now, change, partial(self._asked, rows), lands=lands)
            )
            if found is None or float(found[1].max()) > most:
                return False
            self.times.append(found[0])
            self.boxes.append(found[1])
        return limit is not None and len(self.times) < MOST_TIMES

    def _asked(self, rows: MovingRows, boxes: Array, t: Fraction) -> Array:
        """The slopes of the faces that the rows ask for, and a little more."""
        faces = boxes.reshape(len(boxes), 2, -1)
        asked = rows.needed(Box.floats(faces), np.full(len(boxes), self.load(t)))
        return np.asarray(asked + self.slack * (np.abs(asked) + self.fastest * faces)).reshape(
            boxes.shape
        )

    def load(self, t: Fraction) -> float:
        """|C eps_i| at most."""
        if self.error is None:
            return 0.0
        return (
            math.sqrt(float(self.error.size))
            * float(self.asked.disturbance)
            * math.exp(-float(self.error.beta * t))
        )

    def tube(self, until: Fraction) -> Tube:
        """The chords between the boxes up to a time of theirs."""
        boxes = [
            tuple(_above(x, digits=9) for x in box.tolist())
            for box in self.boxes[: self.times.index(until) + 1]
        ]
        boxes[0], n = (self.asked.radius,) * len(boxes[0]), len(boxes[0]) // 2
        return Tube(
            times=tuple(self.times[: len(boxes)]),
            upper=tuple(box[:n] for box in boxes),
            lower=tuple(box[n:] for box in boxes),
            error=self.error,
        )


@np.errstate(all="ignore")
def _choose(
    loop: Loop, path: _Path, candidates: Sequence[Last], asked: Asked
) -> tuple[Fraction, Last] | None:
    """When which certificate takes over, for the earliest settling time."""
    times, boxes = (
        np.array([float(t) for t in path.times]),
        np.stack(path.boxes).reshape(len(path.boxes), 2, -1),
    )
    widths, loads = boxes.max(axis=1) * (1 + ACCURACY), np.array([path.load(t) for t in path.times])
    best: tuple[float, int, Last] | None = None
    for each in candidates:
        rate, wait, mine = float(decide.rate_near(each)), 0.0, np.ones(len(times), dtype=bool)
        if isinstance(each, Cycles):
            v, wait = (
                np.ones((len(times), len(widths[0]))),
                float(max((x.times[-1] for x in each.phases), default=0)),
            )
            if path.turns is not None and each.phases:
                at = [path.turns.at(t) for t in path.times]
                mine = np.array(
                    [begun == t for (_, begun, _), t in zip(at, path.times, strict=True)]
                )
                first = np.array([[float(x) for x in phase.v[0]] for phase in each.phases])
                v = first[[place for place, _, _ in at]]
            kappa = 0.0 if each.error is None else float(each.error.kappa)
            levels, height = (widths / v).max(axis=1) + kappa * loads, float(each.most)
            most = math.inf if each.rho is None else float(each.rho)
        elif isinstance(each, Separable):
            v = np.array([float(x) for x in each.v])
            kappa = 0.0 if each.error is None else float(each.error.kappa)
            levels, height = (widths / v).max(axis=1) + kappa * loads, float(v.max())
            most = math.inf if each.rho is None else float(each.rho)
        else:
            P_e, b = np.abs(to_float(each.P_e.to_dense())), np.repeat(widths, loop.m, axis=1)
            stretch = 1.0
            if each.P is not None and path.error is not None:
                stretch = math.sqrt(float(relative_bound(each.P, path.error.P)))
            levels = np.sqrt(np.einsum("ti,ij,tj->t", b, P_e, b) + loop.n * (stretch * loads) ** 2)
            height, most = math.sqrt(float(max(diagonal_of_inverse(each.P_e)))), math.inf
            if each.radius is not None:
                wide = max(differences(each.P_e, relied_differences(loop)), default=Fraction(0))
                most = float(each.radius) / math.sqrt(float(wide)) if wide else math.inf
        left = np.maximum(np.log(levels * height / float(asked.tolerance)), 0.0)
        total = times + np.where(left == 0, 0.0, wait + left / max(rate, SMALLEST))
        total = np.where(
            mine & (levels <= most / ROOM if not rate else levels <= ROOM * most), total, np.inf
        )
        k = int(np.argmin(total))
        if np.isfinite(total[k]) and (best is None or total[k] < best[0]):
            best = float(total[k]), k, each
    return None if best is None or not best[1] else (path.times[best[1]], best[2])


def _near(
    loop: Loop, W: Matrix | None, asked: Asked, error: ErrorBound | None
) -> Iterator[Separable | Lure]:
    """Certificates that may take over near the target."""
    slowest, levels = (
        0.0,
        [part for part in LEVELS if part * asked.radius >= asked.tolerance / 2] or [LEVELS[0]],
    )
    for part in [1.0] if loop.is_linear else levels:
        plan = propose_separable(loop, rho=Fraction(part) * asked.radius)
        if plan is None:
            continue
        own = error
        if error is not None:
            rate = min(Fraction(plan.rate), SHARE * error.beta)
            own = with_kappa(error, rate=rate, least=Fraction(float(plan.v.min())))
        found = first_certificate(loop, W, replace(plan, error=own), everywhere=loop.is_linear)
        if found is not None and composite_rate(found) > 0:
            slowest = max(slowest, float(composite_rate(found)))
            yield found
    yield from _quadratic(loop, W, [part * float(asked.radius) for part in RADII], slowest)


def _kept(loop: Loop, W: Matrix | None, asked: Asked, error: ErrorBound | None) -> Iterator[Cycles]:
    """Weights that move under the guarantee, and the tolerance itself as a box that is never
    left."""
    rests = Cycles(
        phases=(), rate=None, rho=None if loop.is_linear else asked.tolerance, error=error
    )
    if why_not(loop, W, rests) is None:
        yield rests
    for part in [1.0] if loop.is_linear else LEVELS:
        rho = None if loop.is_linear else Fraction(part) * asked.radius
        found = next(propose_cycles.propose(loop, W, rho=rho, error=error), None)
        if found is not None:
            yield found
            return


def _quadratic(loop: Loop, W: Matrix | None, radii: list[float], slowest: float) -> Iterator[Lure]:
    """Certificates at the given radii, one each, smallest first; those only whose rate (1/s)
    exceeds ``slowest``. Linear couplings need no radius and have one.  Nothing for networks beyond
    MOST_ROWS or MOST_BLOCK."""
    size, arcs = loop.n * loop.m, max(len(each) for each in loop.modes.values())
    if size > MOST_ROWS or size + arcs * loop.m > MOST_BLOCK:
        return

    def holds(lure: Lure) -> bool:
        return verify_lure(loop, lure).verdict is Verdict.PROVED

    observer, fastest = Fraction(0), linear_rate(loop, W)
    if (exosystem := loop.joint_exosystem) is not None:
        observer = rounded_down(
            0.0 if W is None else max(0.0, PAIR * decay_rate(exosystem, W)), digits=6
        )
        fastest = min(fastest, float(observer))
    for radius in [None] if loop.is_linear else sorted(radii):
        lures = fast_lures(loop, radius=radius, W=W, observer=observer, rates=(slowest, fastest))
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
