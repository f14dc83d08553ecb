"""The search behind ``propose``: centres at growing radii, and the largest covered ball over radii.

At the analytic centre of the inequalities the radius is raised until they are about to fail, then the centre is found
anew (method of centres).  Everything here is floating point and proposes; nothing is believed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from typing import Final

import numpy as np
from scipy import linalg, optimize

from dobc_design.conditions.consensus.claim import omega
from dobc_design.conditions.quadratic.program import FloatLoop, Templates, centring, covering, float_loop
from dobc_design.conditions.quadratic.sampled_gains import Gains, range_gains, sample_gains
from dobc_design.conditions.quadratic.sectors import Enclose, enclose_ranges
from dobc_design.errors import SpecError
from dobc_design.exact.interval import UndefinedError
from dobc_design.exact.matrix import Matrix, multiply, to_float
from dobc_design.problem.groups import group_numbers
from dobc_design.problem.problem import Problem
from dobc_design.solvers.barrier import Basis, centre, minimise
from dobc_design.solvers.program import Array
from dobc_design.solvers.rounding import round_matrix

FIRST: Final = (1.0, 0.1, 1e-2, 1e-4, 1e-6)  # radii at which the first centre is looked for
# Where many unknowns make that expensive, a Lyapunov equation is tried at these first.
RADII: Final = tuple(10.0 ** (-k / 2) for k in range(12))
GROWTH: Final = 0.9  # part of the room that is used at every step
SETTLED: Final = 3e-4
MOST_CENTRES: Final = 60
SMALL: Final = 300  # unknowns up to which many radii are tried for the ball
TRIED: Final = (1.0, 0.998, 0.9, 0.6)  # of the largest radius, before the ball is given up
CONDITION: Final = 100.0
_EDGE: Final = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class ScaledPair:
    """The observer's P before scaling, S of all agents (n m, n m), and n lambda_max(P) s^2, for kappa = 1."""

    P: Matrix
    W: Matrix
    S: Array
    disturbance: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Point:
    """A point inside at a radius (None: couplings are linear); ``value``: the ball it covers, where that was sought."""

    radius: float | None
    Y: Array
    t: Array
    kappa: float | None
    value: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Search:
    """A design in progress: what stays the same over all radii.  ``sampled``: gains in floats, not enclosed."""

    problem: Problem
    templates: Templates
    enclose: Enclose
    basis: Basis
    pair: ScaledPair | None
    rate: Fraction
    sampled: bool

    def loop(self, radius: float | None) -> FloatLoop | None:
        """The numbers at a radius; None where the couplings have no bounded gains."""
        exact = None if radius is None else round_down(radius)
        gains = self._gains(exact)
        if gains is None:
            return None
        S = None if self.pair is None else self.pair.S
        reach = None if exact is None else float(exact)
        return float_loop(self.templates, gains, radius=reach, S=S, rate=float(self.rate))

    def _gains(self, radius: Fraction | None) -> Gains | None:
        couplings = self.problem.couplings
        if self.sampled:
            return sample_gains(couplings, 1.0 if radius is None else float(radius))
        try:
            ranges = enclose_ranges(self.problem, radius=radius, enclose=self.enclose)
        except UndefinedError:
            return None
        return range_gains(ranges, len(couplings), self.problem.m)

    def inside(self, point: Point, radius: float) -> bool:
        """Whether the inequalities hold at another radius with the same unknowns."""
        loop = self.loop(radius)
        if loop is None or loop.multipliers != len(point.t):
            return False
        program, _ = centring(loop, self.basis)
        return program.holds(program.join(point.Y, scalars_of(point.t, point.kappa)))

    def centred(self, radius: float | None, start: Point | None) -> Point | None:
        """The analytic centre at a radius, from a point inside; None if there is none, as far as can be seen."""
        loop = self.loop(radius)
        if loop is None:
            return None
        program, _ = centring(loop, self.basis)
        guess = None if start is None else program.join(start.Y, scalars_of(start.t, start.kappa))
        if guess is None or len(guess) != self.basis.size + program.count or not program.holds(guess):
            guess = self._phase_one(loop)
        if guess is None:
            return None
        Y, x = program.split(centre(program, guess))
        return Point(radius=radius, Y=Y, t=x[: loop.multipliers], kappa=None if loop.S is None else float(x[-1]))

    def _lyapunov(self, radius: float) -> Point | None:
        """A point inside from the Lyapunov equation of the middle gains (one mode), with one t for all arcs."""
        loop = self.loop(radius)
        if loop is None or len(loop.modes) > 1:
            return None
        A = loop.modes[0].A + loop.rate * np.eye(loop.size)
        if not float(np.max(np.linalg.eigvals(A).real)) < 0:
            return None
        Y = linalg.solve_continuous_lyapunov(A, -np.eye(loop.size))
        Y = Y / (2 * float(np.linalg.norm(Y, 2)))
        widest = math.sqrt(float(np.max(widths(Y, loop), initial=1e-12)))
        kappa = None if loop.S is None else 1e-3 / float(np.linalg.norm(loop.S, 2))
        for part in (1.0, 0.3, 0.1):
            t = np.full(loop.multipliers, part * widest)
            point = Point(radius=radius, Y=Y, t=t, kappa=None if kappa is None else kappa * widest)
            if self.inside(point, radius):
                return point
        return None

    def _phase_one(self, loop: FloatLoop) -> Array | None:
        """Minimise theta in F + theta I > 0 until it is negative."""
        program, scalars = centring(loop, self.basis, shift=True)
        Y = np.eye(loop.size) / 2
        start = program.join(Y, [*[1.0] * loop.multipliers, *([1.0] if scalars.kappa is not None else []), 0.0])
        lowest = min(float(np.linalg.eigvalsh(block.value(*program.split(start)))[0]) for block in program.blocks)
        start[-1] = max(1.0, -2 * lowest)
        if not program.holds(start):
            return None
        cost = np.zeros(len(start))
        cost[-1] = 1.0
        found = minimise(program, start, cost, accuracy=1e-9, stop=lambda point: bool(point[-1] < 0), hopeless=0.0)
        return found[:-1] if found[-1] < 0 else None

    def covering(self, start: Point) -> Point | None:
        """The largest covered ball at the radius of ``start``, which is inside; None if nothing is covered."""
        loop = self.loop(start.radius)
        if loop is None:
            return None
        disturbance = 0.0 if self.pair is None else self.pair.disturbance
        program, places = covering(loop, self.basis, disturbance=disturbance, condition=_condition(start.Y))
        reach = widths(start.Y, loop) / loop.reach**2
        size = 0.5 / max(float(np.max(reach, initial=0.0)), 1e-12)
        Y, t = size * start.Y, size * start.t
        kappa = None if start.kappa is None else size * start.kappa
        lowest = float(np.linalg.eigvalsh(Y)[0])
        scalars = [*scalars_of(t, kappa), 0.5 * lowest]
        if places.R is not None:
            found = self._room_for(loop, Point(radius=start.radius, Y=Y, t=t, kappa=kappa))
            if found is None or found.kappa is None:
                return None
            lowest = float(np.linalg.eigvalsh(found.Y)[0])
            share = (1 + disturbance / found.kappa) / 2
            scalars = [*scalars_of(found.t, found.kappa), 0.5 * lowest, 0.1 * math.sqrt(lowest * (1 - share)), share]
            Y = found.Y
        point = program.join(Y, scalars)
        if not program.holds(point):
            return None
        goal = self.basis.size + (places.R if places.R is not None else places.lambda_ or 0)
        cost = np.zeros(len(point))
        cost[goal] = -1.0
        point = minimise(program, point, cost, accuracy=1e-4 if self.basis.size <= SMALL else 1e-3)
        Y, x = program.split(point)
        value = float(point[goal]) if places.R is not None else math.sqrt(float(point[goal]))
        return Point(
            radius=start.radius,
            Y=Y,
            t=x[: loop.multipliers],
            value=value,
            kappa=None if places.kappa is None else float(x[places.kappa]),
        )

    def _room_for(self, loop: FloatLoop, start: Point) -> Point | None:
        """Raise kappa, within the radii, until the disturbance leaves room for e; None if it never does."""
        disturbance = 0.0 if self.pair is None else self.pair.disturbance
        program, places = covering(loop, self.basis, disturbance=0.0, condition=_condition(start.Y))
        point = program.join(start.Y, [*scalars_of(start.t, start.kappa), 0.5 * float(np.linalg.eigvalsh(start.Y)[0])])
        if places.kappa is None or not program.holds(point):
            return None
        at = self.basis.size + places.kappa
        cost = np.zeros(len(point))
        cost[at] = -1.0
        point = minimise(program, point, cost, stop=lambda p: bool(p[at] > 1.05 * disturbance), hopeless=-disturbance)
        Y, x = program.split(point)
        kappa = float(x[places.kappa])
        if kappa <= disturbance:
            return None
        return Point(radius=start.radius, Y=Y, t=x[: loop.multipliers], kappa=kappa)

    def path(self, largest: float) -> list[Point]:
        """Centres at growing radii, up to the largest one that could be reached; empty if there is none."""
        known = (self._lyapunov(min(radius, largest)) for radius in RADII) if self.basis.size > SMALL else iter(())
        start = next((point for point in known if point is not None), None)
        if start is not None:
            found = self.centred(start.radius, start)
        else:
            found = next((point for r in FIRST if (point := self.centred(min(r, largest), None)) is not None), None)
        path: list[Point] = []
        while found is not None and found.radius is not None:
            path.append(found)
            limit = self._limit(found, found.radius, largest)
            if limit <= found.radius * (1 + SETTLED) or len(path) >= MOST_CENTRES:
                break
            step = limit if limit == largest else found.radius + GROWTH * (limit - found.radius)
            found = self.centred(step, found)
        return path

    def _limit(self, point: Point, radius: float, largest: float) -> float:
        """The largest radius for which the same unknowns do, about, from below."""
        low, high = radius, 2 * radius
        while high < largest and self.inside(point, high):
            low, high = high, 2 * high
        if high >= largest:
            if self.inside(point, largest):
                return largest
            high = largest
        while high - low > max(0.03 * (low - radius), SETTLED / 4 * radius):
            middle = (low + high) / 2
            low, high = (middle, high) if self.inside(point, middle) else (low, middle)
        return low

    def largest_balls(self, path: list[Point]) -> list[Point]:
        """Points with the covered ball of their radius, the largest ball first; empty if nothing is covered."""
        top = path[-1].radius or 0.0
        found: list[Point] = []

        def lost(radius: float) -> float:
            near = min(path, key=lambda each: abs((each.radius or 0.0) - radius))
            start = self.centred(radius, near)
            ball = None if start is None else self.covering(start)
            if ball is None:
                return 0.0
            found.append(ball)
            return -ball.value

        small = self.basis.size <= SMALL
        if any(lost(part * top) for part in TRIED[0 if small else 1 :]) and small:
            optimize.minimize_scalar(
                lost, bounds=(0.5 * top, top), method="bounded", options={"maxiter": 12, "xatol": 1e-3 * top}
            )
        return sorted(found, key=lambda each: -each.value)


def scaled_pair(problem: Problem, W: Matrix, *, rate: Fraction, disturbance: Fraction) -> ScaledPair | None:
    """P with Omega(rate) = -(C'C + a little), the smallest whose border S is at most I; None if A - WC is too slow."""
    exosystem = problem.joint_exosystem
    if exosystem is None:
        raise SpecError("W has no meaning without an [exosystem].", key="W", cure="Leave it out.")
    C = to_float(exosystem.C)
    F = to_float(exosystem.A) - to_float(W) @ C + float(rate) * np.eye(exosystem.order)
    if not float(np.max(np.linalg.eigvals(F).real)) < 0:
        return None
    square = C.T @ C
    right = square + _EDGE * max(float(np.linalg.norm(square, 2)), 1e-300) * np.eye(len(F))
    floats = linalg.solve_continuous_lyapunov(F.T, -right)
    for digits in (9, 15):
        P = round_matrix(floats, digits)
        S = border(problem, P, multiply(P, W), rate=float(rate))
        if S is not None:
            largest = float(np.linalg.eigvalsh(to_float(P))[-1])
            return ScaledPair(P=P, W=W, S=S, disturbance=problem.n * largest * float(disturbance) ** 2)
    return None


def border(problem: Problem, P: Matrix, Q: Matrix, *, rate: float) -> Array | None:
    """S = C (-Omega)^-1 C' of every agent along the diagonal (n m, n m), in floats; None unless Omega < 0."""
    exosystem = problem.joint_exosystem
    if exosystem is None:
        return None
    block = -to_float(omega(P, Q, exosystem, rate=Fraction(rate)).to_dense())
    C = to_float(exosystem.C)
    try:
        S = C @ linalg.cho_solve(linalg.cho_factor(block), C.T)
    except (linalg.LinAlgError, ValueError):
        return None
    m, numbers = problem.m, group_numbers(problem.groups, problem.network.labels)
    whole = np.zeros((problem.n * m, problem.n * m))
    for agent, g in enumerate(numbers):
        whole[agent * m : agent * m + m, agent * m : agent * m + m] = S[g * m : g * m + m, g * m : g * m + m]
    return np.asarray((whole + whole.T) / 2)


def _condition(Y: Array) -> float:
    """How far the eigenvalues of Y may lie apart where a ball is sought: enough for the point that it starts from."""
    values = np.linalg.eigvalsh(Y)
    return max(CONDITION, 4 * float(values[-1] / values[0]))


def widths(Y: Array, loop: FloatLoop) -> Array:
    """c'Y c of every pair of ends."""
    i, j = loop.ends[:, 0], loop.ends[:, 1]
    return np.asarray(Y[i, i] + Y[j, j] - 2 * Y[i, j])


def scalars_of(t: Array, kappa: float | None) -> list[float]:
    """The scalars of the programs, in their order."""
    return [*t.tolist(), *([] if kappa is None else [kappa])]


def round_down(value: float, digits: int = 6) -> Fraction:
    """A positive number rounded down to some significant digits."""
    exact = Fraction(value)
    unit = Fraction(10) ** (digits - 1 - math.floor(math.log10(value)))
    return math.floor(exact * unit) / unit
