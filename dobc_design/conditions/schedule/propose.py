"""Proposals for settling times: the box of all starts, followed in time, and certificates near the target (section 11).

Two trajectories, the faces of the box, obey the rows with equality and a little more; chords of them make the tube.
Floating point; nothing here is a proof, but the certificates have been accepted by what decides them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, Final

import numpy as np
from scipy.integrate import solve_ivp

from dobc_design.conditions.consensus.propose import decay_rate
from dobc_design.conditions.numbers import rounded_down
from dobc_design.conditions.quadratic.claim import Lure
from dobc_design.conditions.quadratic.decide import diagonal_of_inverse, differences, verify_lure
from dobc_design.conditions.quadratic.propose import fast_lures, linear_rate, raise_rate
from dobc_design.conditions.quadratic.sectors import relied_differences
from dobc_design.conditions.schedule import decide
from dobc_design.conditions.schedule.claim import Tube
from dobc_design.conditions.schedule.rows import Box, MovingRows, moving_rows
from dobc_design.conditions.separable.claim import ErrorBound, Separable
from dobc_design.conditions.separable.decide import composite_rate
from dobc_design.conditions.separable.propose import first_certificate, propose_separable
from dobc_design.conditions.separable.propose_observer import propose_error_bound
from dobc_design.exact.matrix import Matrix, to_float
from dobc_design.exact.number import root_above
from dobc_design.problem.problem import Problem
from dobc_design.solvers.program import Array
from dobc_design.verdict import Verdict

SLACKS: Final = (0.01, 0.05)  # of the speed of a face and of the rate near the target, by which faces fall more slowly
EARLY: Final = 8.0  # times that, more at first, where faces bend and time is short
LONGEST: Final = 10.0  # times what the rate near the target would take
WIDER: Final = 1.05  # times what a box grows to where couplings rise; beyond it is given up
LEVELS: Final = (1.0, 0.3, 0.1, 0.03, 0.01)  # parts of the radius for which certificates near the target are sought
RADII: Final = (0.03, 0.08, 0.16, 0.25)  # of quadratic ones
SAMPLES: Final = 400  # times at which a certificate may take over
ROOM: Final = 0.999  # of a level
PARTS: Final = (0.0, 0.5, 1.0)  # of a segment, where its rows are looked at
LONGEST_STEP: Final = 0.05  # of the whole time, of a segment
MOST_SEGMENTS: Final = 1000
MOST_HALVINGS: Final = 40
REFINED: Final = 6  # times that segments are halved whose rows are not proved
OBSERVER: Final = 0.9  # of the decay rate of A - WC: that of E; 0.7 for the observer's pair of quadratic certificates
PAIR: Final = 0.7
SHARE: Final = Fraction(9, 10)  # of the rate of E that V = N + kappa E may use
ABOVE: Final = 1e-7  # of numbers that have to be above a matrix, for rounding
ACCURACY: Final = 1e-7  # of the trajectories
#: Rows n m, and rows and channels of one mode, up to which quadratic certificates are looked for: dense programs.
MOST_ROWS: Final = 24
MOST_BLOCK: Final = 90


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """Starts |e|_inf <= radius, |eps_i| <= disturbance, and the tolerance to be kept from some time on."""

    radius: Fraction
    disturbance: Fraction
    tolerance: Fraction


@np.errstate(all="ignore")  # near the ends of the floats
def approach(
    problem: Problem, W: Matrix | None, asked: Asked, *, limit: float | None
) -> tuple[Tube, Separable | Lure] | None:
    """A tube from the box asked for, and the certificate that then gives the earliest settling time, before ``limit``
    (s) if there is one; None if none is found."""
    error, exosystem = None, problem.joint_exosystem
    if exosystem is not None:
        error = None if W is None else propose_error_bound(exosystem, W, rate=OBSERVER * decay_rate(exosystem, W))
        if error is None:
            return None
    candidates = list(_near(problem, W, asked, error))
    grown = asked.radius + (0 if error is None else asked.disturbance * root_above(error.size, unit=10**6) / error.beta)
    rows = moving_rows(problem, grown * Fraction(WIDER))
    if rows is None or not candidates:
        return None
    boxes = [each for each in candidates if isinstance(each, Separable)] or candidates
    fastest = max(float(decide.rate_near(each)) for each in boxes)
    for slack in SLACKS:
        path = _Path.follow(rows, asked, error, slack=slack, fastest=fastest, limit=limit)
        choice = None if path is None else _choose(problem, path, candidates, asked)
        times = None if path is None or choice is None else path.times(choice[0])
        for _ in range(REFINED):
            if path is None or choice is None or times is None or len(times) > MOST_SEGMENTS:
                break
            tube = path.tube(times)
            left = decide.open_segments(problem, tube, disturbance=asked.disturbance, rows=rows)
            if not left:
                return None if left is None else (tube, choice[1])
            times = sorted([*times, *((times[k] + times[k + 1]) / 2 for k in left)])
    return None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Path:
    """The faces of the box over time: ``at(t)`` is (upper, lower) in one vector (2 n,), up to ``end`` (s)."""

    rows: MovingRows
    error: ErrorBound | None
    size: float  # of |C eps_i| at the start
    at: Any
    end: float
    start: Fraction

    @classmethod
    def follow(
        cls,
        rows: MovingRows,
        asked: Asked,
        error: ErrorBound | None,
        *,
        slack: float,
        fastest: float,
        limit: float | None,
    ) -> _Path | None:
        """Integrate until the box lies within the tolerance, or the ``limit`` is reached; None if the box grows."""
        n, radius, goal = rows.size, float(asked.radius), float(asked.tolerance)
        size = 0.0 if error is None else math.sqrt(float(error.size)) * float(asked.disturbance)
        beta = 0.0 if error is None else float(error.beta)

        def slopes(t: float, box: Array) -> Array:
            faces = np.maximum(box, 0.0).reshape(1, 2, n)
            asked = rows.needed(Box.floats(faces), np.array([size * math.exp(-beta * t)]))
            return np.asarray(
                asked + slack * (1 + EARLY * math.exp(-2 * fastest * t)) * (np.abs(asked) + fastest * faces)
            ).ravel()

        def small(t: float, box: Array) -> float:
            return float(np.max(box)) - goal

        def large(t: float, box: Array) -> float:
            return ROOM * float(rows.most) - float(np.max(box))

        small.terminal = large.terminal = True  # type: ignore[attr-defined]
        longest = LONGEST * math.log(max(radius / goal, 2.0)) / fastest if limit is None else limit
        found = solve_ivp(
            slopes,
            (0.0, longest),
            np.full(2 * n, radius),
            method="LSODA",
            dense_output=True,
            events=(small, large),
            rtol=ACCURACY,
            atol=ACCURACY * goal,
        )
        if found.status < 0 or len(found.t_events[1]):
            return None
        return cls(rows=rows, error=error, size=size, at=found.sol, end=float(found.t[-1]), start=asked.radius)

    def load(self, t: float) -> float:
        """|C eps_i| at most."""
        return self.size * math.exp(-float(self.error.beta) * t) if self.error is not None else 0.0

    def times(self, end: float) -> list[float] | None:
        """Times up to ``end``, as far apart as the rows seem to allow; None if they get too close."""
        times, step = [0.0], LONGEST_STEP * end
        while times[-1] < end:
            now, tried = times[-1], 0
            step = min(2 * step, LONGEST_STEP * end)
            while not self._fits(now, min(now + step, end)):
                step, tried = step / 2, tried + 1
                if tried > MOST_HALVINGS:
                    return None
            times.append(min(now + step, end))
            if len(times) > MOST_SEGMENTS:
                return None
        return times

    def tube(self, times: list[float]) -> Tube:
        """The chords between these times."""
        n, exact = self.rows.size, [Fraction(f"{t:.12g}") for t in times]
        boxes = [tuple(_above(x) for x in self.at(float(t)).tolist()) for t in exact]
        boxes[0] = (self.start,) * (2 * n)
        return Tube(
            times=tuple(exact),
            upper=tuple(box[:n] for box in boxes),
            lower=tuple(box[n:] for box in boxes),
            error=self.error,
        )

    def _fits(self, start: float, end: float) -> bool:
        boxes = np.stack([self.at(start), self.at(end)])
        slope = (boxes[1] - boxes[0]) / (end - start)
        chord = np.stack([boxes[0] + part * (boxes[1] - boxes[0]) for part in PARTS])
        loads = np.array([self.load(start) + part * (self.load(end) - self.load(start)) for part in PARTS])
        asked = self.rows.needed(Box.floats(chord.reshape(len(PARTS), 2, -1)), loads).reshape(len(PARTS), -1)
        return bool(np.all(boxes > 0) and np.all(asked + ACCURACY * np.abs(asked) <= slope))


def _choose(
    problem: Problem, path: _Path, candidates: list[Separable | Lure], asked: Asked
) -> tuple[float, Separable | Lure] | None:
    """When which certificate takes over, for the earliest settling time."""
    times = np.linspace(0.0, path.end, SAMPLES)
    boxes = path.at(times).T.reshape(len(times), 2, -1)
    widths, loads = boxes.max(axis=1) * (1 + ACCURACY), np.array([path.load(t) for t in times])
    best: tuple[float, float, Separable | Lure] | None = None
    for each in candidates:
        rate = float(decide.rate_near(each))
        if isinstance(each, Separable):
            v = np.array([float(x) for x in each.v])
            kappa = 0.0 if each.error is None else float(each.error.kappa)
            levels, height = (widths / v).max(axis=1) + kappa * loads, float(v.max())
            most = math.inf if each.rho is None else float(each.rho)
        else:
            P_e, b = np.abs(to_float(each.P_e.to_dense())), np.repeat(widths, problem.m, axis=1)
            stretch = 1.0
            if each.P is not None and path.error is not None:
                stretch = math.sqrt(float(relative_bound(each.P, path.error.P)))
            levels = np.sqrt(np.einsum("ti,ij,tj->t", b, P_e, b) + problem.n * (stretch * loads) ** 2)
            height, most = math.sqrt(float(max(diagonal_of_inverse(each.P_e)))), math.inf
            if each.radius is not None:
                wide = max(differences(each.P_e, relied_differences(problem)), default=Fraction(0))
                most = float(each.radius) / math.sqrt(float(wide)) if wide else math.inf
        total = times + np.maximum(np.log(levels * height / float(asked.tolerance)), 0.0) / rate
        total = np.where(levels <= ROOM * most, total, np.inf)
        k = int(np.argmin(total))
        if np.isfinite(total[k]) and (best is None or total[k] < best[0]):
            best = float(total[k]), float(times[k]), each
    return None if best is None or not best[1] else best[1:]


def _near(problem: Problem, W: Matrix | None, asked: Asked, error: ErrorBound | None) -> Iterator[Separable | Lure]:
    """Certificates that may take over near the target."""
    slowest, levels = 0.0, [part for part in LEVELS if part * asked.radius >= asked.tolerance / 2] or [LEVELS[0]]
    for part in [1.0] if problem.is_linear else levels:
        plan = propose_separable(problem, rho=Fraction(part) * asked.radius)
        if plan is None:
            continue
        own = error
        if error is not None:
            rate = min(Fraction(plan.rate), SHARE * error.beta)
            kappa = Fraction(math.ceil(10**6 / ((error.beta - rate) * Fraction(float(plan.v.min())))), 10**6)
            own = replace(error, kappa=kappa)
        found = first_certificate(problem, W, replace(plan, error=own), everywhere=problem.is_linear)
        if found is not None and composite_rate(found) > 0:
            slowest = max(slowest, float(composite_rate(found)))
            yield found
    yield from _quadratic(problem, W, [part * float(asked.radius) for part in RADII], slowest)


def _quadratic(problem: Problem, W: Matrix | None, radii: list[float], slowest: float) -> Iterator[Lure]:
    """Certificates at the given radii, one each, smallest first; those only whose rate (1/s) exceeds ``slowest``.
    Linear couplings need no radius and have one.  Nothing for networks beyond MOST_ROWS or MOST_BLOCK."""
    size, arcs = problem.n * problem.m, max(len(each) for each in problem.network.modes.values())
    if size > MOST_ROWS or size + arcs * problem.m > MOST_BLOCK:
        return

    def holds(lure: Lure) -> bool:
        return verify_lure(problem, lure).verdict is Verdict.PROVED

    observer, fastest = Fraction(0), linear_rate(problem, W)
    if (exosystem := problem.joint_exosystem) is not None:
        observer = rounded_down(0.0 if W is None else max(0.0, PAIR * decay_rate(exosystem, W)), digits=6)
        fastest = min(fastest, float(observer))
    for radius in [None] if problem.is_linear else sorted(radii):
        lures = fast_lures(problem, radius=radius, W=W, observer=observer, rates=(slowest, fastest))
        lure = next(filter(holds, lures), None)
        if lure is None:
            break  # larger radii are harder
        yield raise_rate(problem, lure, holds=holds)


def relative_bound(new: Matrix, old: Matrix) -> Fraction:
    """A number f with new <= f old, rounded up; old > 0."""
    quotient = np.linalg.solve(to_float(old), to_float(new))
    return _above(float(np.max(np.linalg.eigvals(quotient).real)) * (1 + ABOVE), digits=9)


def _above(value: float, *, digits: int = 7) -> Fraction:
    """A decimal not below the value, up to its last digit."""
    return Fraction(f"{value * (1 + 10.0 ** (1 - digits)):.{digits}g}")
