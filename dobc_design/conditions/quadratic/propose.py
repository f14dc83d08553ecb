"""Finds quadratic certificates: P_e, multipliers and the observer's pair for the largest ball.

At the analytic centre of the inequalities the radius is raised until they are about to fail, then
the centre is found anew (method of centres).  What is found is rounded, and only what ``holds``
accepts, exactly, is returned.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import partial
from itertools import islice
from typing import TypeAlias

import numpy as np
from scipy import linalg, optimize

from dobc_design._checks import noun
from dobc_design.conditions.consensus.claim import omega
from dobc_design.conditions.consensus.propose import decay_of
from dobc_design.conditions.coverage import Asked
from dobc_design.conditions.numbers import (
    bisected,
    claimed,
    rounded_down,
    soonest,
    time_to_one_percent,
)
from dobc_design.conditions.quadratic import propose_program as programs
from dobc_design.errors import SpecError
from dobc_design.exact.interval import UndefinedError
from dobc_design.exact.matrix import Array, Matrix, Vector, multiply, scale, to_float
from dobc_design.exact.number import ONE, ZERO
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.loop.loop import Loop
from dobc_design.problem.groups import agent_blocks
from dobc_design.solvers.barrier import Basis, Inequalities, centre, make_basis, minimise
from dobc_design.solvers.program import round_matrix

from .claim import Lure, Shape, lure_matrix
from .propose_program import (
    FloatSystem,
    float_system,
    sample_gains,
)
from .sectors import (
    GainRange,
    Sectors,
    build_sectors,
    enclose_ranges,
)

Holds = Callable[[Lure], bool]
Found: TypeAlias = "tuple[_Search, _Point]"

DIGITS = (5, 7, 9, 12)
BALLS = 4  # points tried, the largest ball first
NEAR = 1e-6  # |e_j - e_i| at which couplings are as good as linear
FIRST = (1.0, 0.1, 1e-2, 1e-4, 1e-6)  # radii at which the first centre is looked for
GROWTH = 0.9  # part of the room that is used at every step
SETTLED = 3e-4  # a radius that grows by a smaller part of itself is as good as the largest
FASTER = 3e-3  # a rate that grows by a smaller part of itself is as good as the largest
MOST_CENTRES = 60
TRIED = (1.0, 0.998, 0.9, 0.6)  # of the largest radius, before the ball is given up
CONDITION = 100.0  # how far apart the eigenvalues of Y may lie at least
_EDGE = 1e-3  # beside C'C, which need not be definite, in the equation of the observer
# How far inside of a proved certificate the search for a flatter one begins ...
_INSIDE = 1e-4
_EVEN = 1e-2  # ... and how close it comes
_SHORTFALL = 1e-8  # of the level, for the rounding of its estimate
# Where no arc needs the radius every level will do: one that holds balls of a hundred times the
# radius, about.
_NOT_NEEDED = 1e4


@np.errstate(all="ignore")  # near the ends of the floats
def design_lure(
    loop: Loop,
    *,
    holds: Holds,
    shape: Shape = "full",
    W: Matrix | None = None,
    rate: Fraction = ZERO,
    disturbance: Fraction = ZERO,
    largest: Fraction = Fraction(1000),
) -> Lure | None:
    """The certificate with the largest covered ball |e| <= R, |eps_i| <= disturbance that ``holds``
    accepts, or None. A P_e of full ``shape`` has n m (n m + 1)/2 unknowns, which make a dense
    Newton system: for some 20 rows.  Without the gain ``W`` (q, m) eps = 0 is meant.  No |e_j -
    e_i| beyond ``largest`` is looked at.  Raises: SpecError."""
    search = _begun(loop, W, shape=shape, rate=rate, observer=rate, disturbance=disturbance)
    if search is None:
        return None
    return next(filter(holds, search.candidates(float(largest))), None)


def fast_lures(
    loop: Loop,
    *,
    radius: float | None,
    W: Matrix | None,
    observer: Fraction,
    rates: tuple[float, float],
) -> Iterator[Lure]:
    """Certificates at a radius (None: couplings are linear) with rates between two (1/s), the
    largest first. ``observer``: a rate at which there is a pair for W; no certificate has a larger
    one."""
    slowest, fastest = rates
    start = rounded_down(slowest, digits=6)
    search = _begun(loop, W, shape="full", rate=start, observer=observer, disturbance=ZERO)
    if search is None:
        return
    # The first point is at the slowest rate itself, which is known already.
    growing = list(islice(search.faster(radius, fastest), MOST_CENTRES))
    for there, point in reversed(growing[1:]):
        yield from there.roundings(point)


def sooner_lures(
    asked: Asked, lures: Sequence[Lure], *, holds: Holds, steps: int, least: float
) -> Iterator[Lure]:
    """Certificates that ``holds`` accepts with smaller rates and flatter P_e, which promise the
    least time to one percent first; each covers what is ``asked``.  ``lures`` do, with growing
    rates > 0: the search begins at the next faster one.  ``steps``: rates that are tried, all of
    them at least ``least`` (1/s)."""

    def at(rate: float) -> tuple[float, Found] | None:
        exact = rounded_down(rate, digits=4)
        # What holds at a rate holds at a slower one: the search begins inside.
        near = next((each for each in lures if each.rate >= exact), lures[-1])
        flat = _flattest(asked, near, rate=exact)
        if flat is None:
            return None
        condition = np.linalg.cond(flat[1].Y)
        return time_to_one_percent(float(exact), math.sqrt(condition)), flat

    first = min(time_to_one_percent(float(x.rate), math.sqrt(condition_of(x))) for x in lures)
    longest = float(lures[-1].rate)
    found = soonest(at, first=first, longest=longest, least=least, steps=steps)
    for time, (search, point) in found:
        if time < first:
            yield from islice(filter(holds, search.roundings(point)), 1)


def _flattest(asked: Asked, near: Lure, *, rate: Fraction) -> Found | None:
    """The flattest P_e for this rate that covers what is asked, from a certificate with a larger
    one; None if none is found."""
    begun = _begun(
        asked.loop,
        asked.W,
        shape=near.shape,
        rate=near.rate,
        observer=near.rate,
        disturbance=claimed(asked.disturbance),
    )
    start = None if begun is None else begun.point_of(near)
    if begun is None or start is None:
        return None
    search = replace(begun, rate=rate)
    point = search.flattest(start, asked.ball)
    return None if point is None else (search, point)


def condition_of(lure: Lure) -> float:
    """Lambda_max / lambda_min of P_e, about."""
    return float(np.linalg.cond(to_float(lure.P_e.to_dense())))


def _ranges(loop: Loop, radius: Fraction | None) -> tuple[GainRange, ...] | None:
    """The enclosed gains at a radius; None where a coupling is not defined."""
    try:
        return enclose_ranges(loop, radius=radius)
    except UndefinedError:
        return None


def raise_rate(loop: Loop, lure: Lure, *, holds: Holds) -> Lure:
    """The same certificate with the largest rate that ``holds`` accepts, in steps below an
    estimate."""
    estimate = rate_estimate(loop, lure)
    if not estimate > 0:
        return lure
    for part in (1e-6, 1e-3, 0.01, 0.1, 0.5):
        rate = rounded_down(estimate * (1 - part), digits=6)
        if rate > lure.rate:
            faster = replace(lure, rate=rate)
            if holds(faster):
                return faster
    return lure


def rate_estimate(loop: Loop, lure: Lure) -> float:
    """The largest beta for which the Lur'e inequalities hold with these unknowns, about (1/s); 0 if
    there is none."""
    sectors = build_sectors(loop, lure.ranges, radius=lure.radius)
    P_e = to_float(lure.P_e.to_dense())
    fixed = []
    for mode in sectors.modes:
        matrix = lure_matrix(sectors, mode, lure.P_e, lure.multipliers[mode])
        fixed.append(to_float(matrix.to_dense()))

    def decreases(beta: float) -> bool:
        # The border of the observer's pair grows with the rate.
        observer = np.zeros_like(P_e)
        if lure.P is not None and lure.Q is not None:
            S = _border(loop, lure.P, lure.Q, rate=beta)
            if S is None:
                return False
            observer = P_e @ _of_agents(loop, S) @ P_e
        for X in fixed:
            highest = np.linalg.eigvalsh(X + 2 * beta * P_e + observer)[-1]
            if not float(highest) < 0:
                return False
        return True

    most = min(-float(linalg.eigh(X, P_e, eigvals_only=True)[-1]) for X in fixed) / 2
    rate, _ = bisected(decreases, 0.0, most, steps=50)
    return rate


def linear_rate(loop: Loop, W: Matrix | None) -> float:
    """The decay rate near the consensus (1/s), which no certificate can exceed, about; 0 where that
    does not decay."""
    gains = sample_gains(loop, NEAR)
    if gains is None:
        return 0.0
    system = float_system(programs.make_templates(loop), gains, radius=None, S=None, rate=0.0)
    blocks = [mode.A for mode in system.modes]
    exosystem = loop.joint_exosystem
    if exosystem is not None and W is not None:
        blocks.append(to_float(exosystem.A) - to_float(W) @ to_float(exosystem.C))
    return max(0.0, min(map(decay_of, blocks)))


@noun
class ScaledPair:
    """The observer's P before scaling, S of all groups (G m, G m), and n lambda_max(P) s^2, for
    kappa = 1."""

    P: Matrix
    W: Matrix
    S: Array
    disturbance: float


def scaled_pair(
    loop: Loop, W: Matrix, *, rate: Fraction, disturbance: Fraction
) -> ScaledPair | None:
    """P with Omega(rate) = -(C'C + a little), the smallest whose border S is at most I; None if A -
    WC is too slow."""
    exosystem = loop.joint_exosystem
    if exosystem is None:
        raise SpecError("W has no meaning without an [exosystem].", key="W", cure="Leave it out.")
    C = to_float(exosystem.C)
    F = to_float(exosystem.A) - to_float(W) @ C + float(rate) * np.eye(exosystem.order)
    if not decay_of(F) > 0:
        return None
    # C'C alone need not be definite.
    square = C.T @ C
    right = square + _EDGE * max(float(np.linalg.norm(square, 2)), 1e-300) * np.eye(len(F))
    floats = linalg.solve_continuous_lyapunov(F.T, -right)
    for digits in (9, 15):
        P = round_matrix(floats, digits)
        S = _border(loop, P, multiply(P, W), rate=float(rate))
        if S is not None:
            largest = float(np.linalg.eigvalsh(to_float(P))[-1])
            return ScaledPair(P=P, W=W, S=S, disturbance=loop.n * largest * float(disturbance) ** 2)
    return None


def _border(loop: Loop, P: Matrix, Q: Matrix, *, rate: float) -> Array | None:
    """S = C (-Omega)^-1 C' of all groups (G m, G m), in floats; None unless Omega < 0."""
    exosystem = loop.joint_exosystem
    if exosystem is None:
        return None
    block = -to_float(omega(P, Q, exosystem, rate=Fraction(rate)).to_dense())
    C = to_float(exosystem.C)
    try:
        S = C @ linalg.cho_solve(linalg.cho_factor(block), C.T)
    except (linalg.LinAlgError, ValueError):
        return None
    return np.asarray((S + S.T) / 2)


def _of_agents(loop: Loop, S: Array) -> Array:
    """The block of every agent along the diagonal, (n m, n m)."""
    # An agent without a disturbance has an exact 0.
    blocks = agent_blocks(S.tolist(), loop.groups, loop.labels)
    return np.asarray(linalg.block_diag(*blocks), dtype=float)


@noun(eq=False)
class _Point:
    """A point inside at a radius (None: couplings are linear); ``value``: the ball it covers, where
    that was sought."""

    radius: float | None
    Y: Array
    t: Array
    kappa: float | None
    value: float = 0.0

    @property
    def scalars(self) -> list[float]:
        """t, then kappa where there is an observer, as the programs have them."""
        own: list[float] = self.t.tolist()
        if self.kappa is not None:
            own.append(self.kappa)
        return own

    def scaled(self, size: float) -> _Point:
        """The same certificate with all unknowns times ``size``."""
        kappa = None if self.kappa is None else size * self.kappa
        return _Point(radius=self.radius, Y=size * self.Y, t=size * self.t, kappa=kappa)


@noun(eq=False)
class _Search:
    """A design in progress: what stays the same over all radii."""

    loop: Loop
    templates: programs.Templates
    basis: Basis
    pair: ScaledPair | None
    rate: Fraction

    @property
    def disturbance(self) -> float:
        """N lambda_max(P) s^2 for kappa = 1; 0 without an observer."""
        return 0.0 if self.pair is None else self.pair.disturbance

    def system(self, radius: float | None) -> FloatSystem | None:
        """The numbers at a radius; None where the couplings have no bounded gains."""
        exact = None if radius is None else rounded_down(radius, digits=6)
        reach = None if exact is None else float(exact)
        gains = sample_gains(self.loop, 1.0 if reach is None else reach)
        if gains is None:
            return None
        S = None if self.pair is None else _of_agents(self.loop, self.pair.S)
        return float_system(self.templates, gains, radius=reach, S=S, rate=float(self.rate))

    def inside(self, point: _Point, radius: float | None) -> bool:
        """Whether the inequalities hold at another radius with the same unknowns."""
        system = self.system(radius)
        if system is None or system.multipliers != len(point.t):
            return False
        program = programs.centring(system, self.basis)
        return program.holds(program.join(point.Y, point.scalars))

    def centred(self, radius: float | None, start: _Point | None) -> _Point | None:
        """The analytic centre at a radius, from a point inside; None if there is none, as far as
        can be seen."""
        system = self.system(radius)
        if system is None:
            return None
        program = programs.centring(system, self.basis)
        guess = None if start is None else program.join(start.Y, start.scalars)
        unknowns = self.basis.size + program.count
        # A start with other unknowns, or outside, is of no use.
        if guess is None or len(guess) != unknowns or not program.holds(guess):
            guess = self._phase_one(system)
        if guess is None:
            return None
        Y, scalars = program.split(centre(program, guess))
        return _point(system, radius, Y, scalars)

    def _phase_one(self, system: FloatSystem) -> Array | None:
        """Minimise theta in F + theta I > 0 until it is negative."""
        program = programs.centring(system, self.basis, shift=True)
        start = program.join(np.eye(system.size) / 2, [*[1.0] * (program.count - 1), 0.0])
        Y, scalars = program.split(start)
        lowest = min(
            float(np.linalg.eigvalsh(each.value(Y, scalars))[0]) for each in program.blocks
        )
        # Large enough a theta makes every start one inside.
        start[-1] = max(1.0, -2 * lowest)
        if not program.holds(start):
            return None
        cost = np.zeros(len(start))
        cost[-1] = 1.0
        found = minimise(
            program,
            start,
            cost,
            accuracy=1e-9,
            stop=lambda point: bool(point[-1] < 0),
            hopeless=0.0,
        )
        return found[:-1] if found[-1] < 0 else None

    def covering(self, start: _Point) -> _Point | None:
        """The largest covered ball at the radius of ``start``, which is inside; None if nothing is
        covered."""
        system = self.system(start.radius)
        if system is None:
            return None
        widest = float(np.max(system.widths(start.Y) / system.reach**2, initial=0.0))
        # The inequalities do not depend on the scale, the radii do: well inside of all of them.
        inner = start.scaled(0.5 / max(widest, 1e-12))
        # How far the eigenvalues of Y may lie apart: enough for the point that it starts from.
        values = np.linalg.eigvalsh(start.Y)
        condition = max(CONDITION, 4 * float(values[-1] / values[0]))
        cover = partial(programs.covering, system, self.basis, condition=condition)
        disturbed = inner.kappa is not None and self.disturbance > 0
        if disturbed:
            found = self._room_for(system, cover(disturbance=0.0), inner)
            if found is None or found.kappa is None:
                return None
            inner = found
        lowest = float(np.linalg.eigvalsh(inner.Y)[0])
        scalars = [*inner.scalars, 0.5 * lowest]
        if disturbed and inner.kappa is not None:
            # Between what the disturbance takes and all of it; a small R fits into the rest.
            share = (1 + self.disturbance / inner.kappa) / 2
            scalars += [0.1 * math.sqrt(lowest * (1 - share)), share]
        program = cover(disturbance=self.disturbance)
        point = program.join(inner.Y, scalars)
        if not program.holds(point):
            return None
        goal = len(point) - (2 if disturbed else 1)  # R, or lambda
        cost = np.zeros(len(point))
        cost[goal] = -1.0
        point = minimise(program, point, cost)
        value = float(point[goal]) if disturbed else math.sqrt(float(point[goal]))
        return replace(_point(system, start.radius, *program.split(point)), value=value)

    def _room_for(self, system: FloatSystem, program: Inequalities, start: _Point) -> _Point | None:
        """Raise kappa, within the radii, until the disturbance leaves room for e; None if it never
        does."""
        needed = self.disturbance
        lowest = float(np.linalg.eigvalsh(start.Y)[0])
        point = program.join(start.Y, [*start.scalars, 0.5 * lowest])
        if not program.holds(point):
            return None
        kappa = self.basis.size + system.multipliers
        cost = np.zeros(len(point))
        cost[kappa] = -1.0
        point = minimise(
            program, point, cost, stop=lambda p: bool(p[kappa] > 1.05 * needed), hopeless=-needed
        )
        if point[kappa] <= needed:
            return None
        return _point(system, start.radius, *program.split(point))

    def point_of(self, lure: Lure) -> _Point | None:
        """The point from which ``roundings`` would make this certificate, about; None where it is
        of another search."""
        radius = None if lure.radius is None else float(lure.radius)
        system = self.system(radius)
        if system is None:
            return None
        unit = 1.0 if lure.level is None else float(lure.level)
        sectors = build_sectors(self.loop, lure.ranges, radius=lure.radius)
        t: list[float] = []
        for mode in system.modes:
            known: dict[tuple[int, ...], float] = {}
            taus = lure.multipliers[mode.name]
            for channel, tau in zip(sectors.modes[mode.name], taus, strict=True):
                known[channel.target, channel.plus, channel.minus] = float(tau)
            values = [known.get(place, 0.0) for place in map(tuple, mode.where.T.tolist())]
            if not all(values):
                return None
            t += (unit / (2 * mode.d * np.array(values))).tolist()
        kappa = None
        if self.pair is not None and lure.P is not None:
            kappa = unit * float(self.pair.P[0][0] / lure.P[0][0])
        Y = unit * np.linalg.inv(to_float(lure.P_e.to_dense()))
        return _Point(radius=radius, Y=(Y + Y.T) / 2, t=np.array(t), kappa=kappa)

    def flattest(self, start: _Point, ball: float) -> _Point | None:
        """The point with the least largest eigenvalue of Y that covers the ball; None if ``start``
        is not inside."""
        system = self.system(start.radius)
        if system is None or system.multipliers != len(start.t):
            return None
        size = 1 - _INSIDE
        if start.radius is None:  # all scales are alike
            ball = 1.0
            size = 1.1 / float(np.linalg.eigvalsh(start.Y)[0])
        inner = start.scaled(size)
        disturbed = inner.kappa is not None and self.disturbance > 0 and start.radius is not None
        program = programs.flattening(
            system,
            self.basis,
            ball=ball * (1 + _INSIDE),
            disturbance=self.disturbance if disturbed else 0.0,
        )
        values = np.linalg.eigvalsh(inner.Y)
        scalars = list(inner.scalars)
        if disturbed and inner.kappa is not None:
            share = (1 + _INSIDE) * self.disturbance / inner.kappa
            scalars += [(1 - _INSIDE) * float(values[0]), share]
        point = program.join(inner.Y, [*scalars, 1.5 * float(values[-1])])
        if not program.holds(point):
            return None
        cost = np.zeros(len(point))
        cost[-1] = 1.0
        point = minimise(program, point, cost, accuracy=_EVEN)
        return _point(system, start.radius, *program.split(point))

    def path(self, largest: float) -> list[_Point]:
        """Centres at growing radii, up to the largest one that could be reached; empty if there is
        none."""
        found = self._first(largest)
        path: list[_Point] = []
        while found is not None and found.radius is not None:
            path.append(found)
            limit = self._limit(found, found.radius, largest)
            if limit <= found.radius * (1 + SETTLED) or len(path) >= MOST_CENTRES:
                break
            # A point short of the limit is inside, so that the next centre is found from it.
            step = limit
            if limit != largest:
                step = found.radius + GROWTH * (limit - found.radius)
            found = self.centred(step, found)
        return path

    def _first(self, largest: float) -> _Point | None:
        """The centre at the first of the radii that has one."""
        for radius in FIRST:
            point = self.centred(min(radius, largest), None)
            if point is not None:
                return point
        return None

    def faster(self, radius: float | None, fastest: float) -> Iterator[Found]:
        """Centres at growing rates, at a radius, from this rate on; none if there is none at this
        rate."""
        search = self
        point = self.centred(radius, None)

        def close(low: float, high: float) -> bool:
            return not high - low > FASTER / 4 * high

        while point is not None:
            yield search, point
            rate = float(search.rate)
            inside = partial(search.inside_at, point, radius)
            low, _ = bisected(inside, rate, fastest, close=close)
            if low <= rate * (1 + FASTER):
                return
            search = replace(search, rate=rounded_down(rate + GROWTH * (low - rate), digits=6))
            point = search.centred(radius, point)

    def inside_at(self, point: _Point, radius: float | None, rate: float) -> bool:
        """Whether the point is inside at another rate, about."""
        return replace(self, rate=rounded_down(rate, digits=6)).inside(point, radius)

    def _limit(self, point: _Point, radius: float, largest: float) -> float:
        """The largest radius for which the same unknowns do, about, from below."""
        low = radius
        high = 2 * radius
        while high < largest and self.inside(point, high):
            low = high
            high = 2 * high
        if high >= largest:
            if self.inside(point, largest):
                return largest
            high = largest

        def close(low: float, high: float) -> bool:
            return not high - low > max(0.03 * (low - radius), SETTLED / 4 * radius)

        limit, _ = bisected(partial(self.inside, point), low, high, close=close)
        return limit

    def largest_balls(self, path: list[_Point]) -> list[_Point]:
        """Points with the covered ball of their radius, the largest ball first; empty if nothing is
        covered."""
        top = path[-1].radius or 0.0
        found: list[_Point] = []

        def lost(radius: float) -> float:
            near = min(path, key=lambda each: abs((each.radius or 0.0) - radius))
            start = self.centred(radius, near)
            ball = None if start is None else self.covering(start)
            if ball is None:
                return 0.0
            found.append(ball)
            return -ball.value

        # Near the largest radius the set is thin: the largest ball may be at a smaller one.
        if any(lost(part * top) for part in TRIED):
            bounds = (0.5 * top, top)
            options = {"maxiter": 12, "xatol": 1e-3 * top}
            optimize.minimize_scalar(lost, bounds=bounds, method="bounded", options=options)
        return sorted(found, key=lambda each: -each.value)

    def candidates(self, largest: float) -> Iterator[Lure]:
        """Certificates worth trying, the best first."""
        if self.loop.is_linear:
            points = [self.centred(None, None)]
        else:
            path = self.path(largest)
            points = [*self.largest_balls(path)[:BALLS]] if path else []
        for point in points:
            if point is not None:
                yield from self.roundings(point)

    def roundings(self, point: _Point) -> Iterator[Lure]:
        """Certificates near a point, the shortest numbers first, with lambda_max(P_e) about 1."""
        loop = self.loop
        system = self.system(point.radius)
        radius = None if point.radius is None else rounded_down(point.radius, digits=6)
        ranges = _ranges(self.loop, radius)
        # the samples have not met the place where it is not defined
        if system is None or ranges is None:
            return
        sectors = build_sectors(loop, ranges, radius=radius)
        # P_e = Y^-1, scaled so that its largest eigenvalue is 1.
        unit = float(np.linalg.eigvalsh(point.Y)[0])
        inverse = np.linalg.inv(point.Y)
        for digits in DIGITS:
            P_e = round_matrix(unit * (inverse + inverse.T) / 2, digits)
            reach = _reach(to_float(P_e), system)
            if not reach > 0:
                continue
            if radius is not None:  # a level and a radius belong together
                reach = min(reach, _NOT_NEEDED * float(radius) ** 2)
            level = None
            if not math.isinf(reach):
                level = rounded_down(reach * (1 - _SHORTFALL), digits=10)
            P = self._observer(point, unit, digits)
            yield Lure(
                P_e=SparseSymmetric.from_dense(P_e),
                ranges=ranges,
                radius=radius,
                level=level,
                multipliers=_multipliers(sectors, system, point, unit, digits),
                rate=self.rate,
                P=P,
                Q=None if P is None or self.pair is None else multiply(P, self.pair.W),
            )

    def _observer(self, point: _Point, unit: float, digits: int) -> Matrix | None:
        """The observer's P beside lambda_max(P_e) about 1; None without an observer."""
        if self.pair is None:
            return None
        factor = ONE
        if point.kappa:
            factor = rounded_down(unit / point.kappa, digits=digits)
        return scale(factor, self.pair.P)


def _begun(
    loop: Loop,
    W: Matrix | None,
    *,
    shape: Shape,
    rate: Fraction,
    observer: Fraction,
    disturbance: Fraction,
) -> _Search | None:
    """A search at a rate, with gains in floats; None if A - WC is too slow for the rate
    ``observer`` of its pair."""
    pair = None if W is None else scaled_pair(loop, W, rate=observer, disturbance=disturbance)
    if W is not None and pair is None:
        return None
    templates = programs.make_templates(loop)
    basis = make_basis(loop.size, shape)
    return _Search(loop=loop, templates=templates, basis=basis, pair=pair, rate=rate)


def _point(system: FloatSystem, radius: float | None, Y: Array, x: Array) -> _Point:
    """A point of any of the programs: t come first, then kappa, if there is an observer."""
    count = system.multipliers
    kappa = None if system.S is None else float(x[count])
    return _Point(radius=radius, Y=Y, t=x[:count], kappa=kappa)


def _reach(P_e: Array, system: FloatSystem) -> float:
    """The largest level within the radii, about; inf without radii, 0 if P_e is not positive
    definite."""
    if not float(np.linalg.eigvalsh(P_e)[0]) > 0:
        return 0.0
    Y = np.asarray(np.linalg.inv(P_e), dtype=np.float64)
    widths = np.maximum(system.widths(Y), 1e-300)
    return float(np.min(system.reach**2 / widths, initial=math.inf))


def _multipliers(
    sectors: Sectors, system: FloatSystem, point: _Point, unit: float, digits: int
) -> dict[str, Vector]:
    """Tau = unit / (2 d t) of every channel with a range, 0 elsewhere."""
    result = {}
    start = 0
    for mode in system.modes:
        end = start + len(mode.d)
        values = unit / (2 * mode.d * point.t[start:end])
        start = end
        known = dict(zip(map(tuple, mode.where.T.tolist()), values.tolist(), strict=True))
        taus = []
        for channel in sectors.modes[mode.name]:
            tau = ZERO
            if channel.spread:
                place = channel.target, channel.plus, channel.minus
                tau = rounded_down(known[place], digits=digits)
            taus.append(tau)
        result[mode.name] = tuple(taus)
    return result
