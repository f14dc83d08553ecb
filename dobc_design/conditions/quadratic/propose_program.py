"""The Lur'e inequalities as programs in Y = P_e^-1, in floating point: gains, the loop, the blocks
of a barrier.

Everything is affine in Y (theory, section 4).  With t = 1/(2 tau d), d the half-width of a gain and
g0 its middle, the inequality times Y on both sides is

    [[A0 Y + Y A0' + 2 beta Y + sum d t b b' + kappa I (x) S,  Y C' sqrt(d)], [., -diag(t)]] < 0

{e'P_e e <= 1} lies in |c'e| <= r iff c'Y c <= r^2, and holds the ball of radius sqrt(lambda) iff Y
>= lambda I.  With the observer's pair (P, Q)/kappa, |e| <= R, |eps_i| <= s are covered iff
R^2/lambda + n lambda_max(P) s^2/kappa <= 1.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from dobc_design.conditions.quadratic.sectors import GainRange, is_sum_of_curves
from dobc_design.coupling.coupling import Coupling
from dobc_design.coupling.expression import variables_used
from dobc_design.exact.number import nearest
from dobc_design.exact.work import spend
from dobc_design.loop.loop import Loop
from dobc_design.solvers.barrier import Basis, Block, Indices, Inequalities
from dobc_design.solvers.program import Array

Gains = tuple[Array, Array]  # lowest and highest, (couplings, m, m)

POINTS: Final = 401
SCATTERED: Final = 600  # points in a box of several dimensions, besides its corners
WIDER: Final = 2e-5  # about what enclosures are widened and rounded by
_STEP: Final = 1e-6
# Half-width of a range that is a point at this radius, relative to the gain, so that the unknowns
# stay the same.
_NARROW: Final = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Template:
    """What does not depend on the radius in one mode: (3, channels) ``place``, coupling, row and
    column of the gain, and ``where``, target, plus and minus; ``curved``: whether it may have a
    width; ``known``: what of it K holds."""

    name: str
    place: Indices
    where: Indices
    weight: Array
    known: Array
    curved: Array  # 2 or more for arcs that come and go


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Templates:
    """All modes, and the pins K (n m, n m)."""

    size: int
    K: Array
    modes: tuple[_Template, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FloatMode:
    """One mode in floats: A0 (n m, n m); of every channel with a range its target, plus and minus
    (3, k), and d."""

    name: str
    A: Array
    where: Indices
    d: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FloatSystem:
    """All modes at one radius, the borders S (n m, n m) of the observers or None, and the rate
    beta.  ``ends`` (pairs, 2) and ``reach`` (pairs,): |e_i - e_j| <= reach, each pair once."""

    size: int
    modes: tuple[FloatMode, ...]
    S: Array | None
    rate: float
    ends: Indices
    reach: Array

    @property
    def multipliers(self) -> int:
        """Number of t, all modes together."""
        return sum(len(mode.d) for mode in self.modes)

    def widths(self, Y: Array) -> Array:
        """c'Y c of every pair of ends."""
        # the target, whose error is 0, comes last
        i, j, Y = self.ends[:, 0], self.ends[:, 1], np.pad(Y, (0, 1))
        return np.asarray(Y[i, i] + Y[j, j] - 2 * Y[i, j])


def sample_gains(loop: Loop, radius: float) -> Gains | None:
    """Lowest and highest gains of every coupling on |y_c| <= radius, about, of nodes for every
    state of a leader; None where one is not finite."""
    known = loop.functions[: loop.drift_place if loop.slopes_move else None]
    found = [_sampled(each, radius) for each in known]
    if loop.slopes_move:
        box = loop.goals.leaders_box()
        half = np.array([nearest(side.width / 2) for side in box])
        found.append(
            _of_vectors(
                loop.functions[-1], radius + half, np.array([nearest(x.midpoint) for x in box])
            )
        )
    low, high = (np.array(ends) for ends in zip(*found, strict=True))
    if not (np.all(np.isfinite(low)) and np.all(np.isfinite(high))):
        return None
    bent = np.array([not each.is_linear for each in loop.functions])[:, None, None]
    margin = WIDER * np.where(bent, np.maximum(np.abs(low), np.abs(high)), 0.0)
    return low - margin, high + margin


def range_gains(ranges: Sequence[GainRange], count: int, m: int) -> Gains:
    """The same arrays from enclosures; zero where a coupling is not used."""
    ends = np.zeros((2, count, m, m))
    for each in ranges:
        ends[0, each.coupling] = [[nearest(gain.lo) for gain in row] for row in each.entries]
        ends[1, each.coupling] = [[nearest(gain.hi) for gain in row] for row in each.entries]
    return ends[0], ends[1]


def _sampled(coupling: Coupling, radius: float) -> Gains:
    """H_c(y)/y_d along the axes, and the slopes at 0, where H_c is a sum of functions of one
    variable each; elsewhere slopes."""
    spend(0 if coupling.is_linear else coupling.dimension * _steps(coupling))
    # without 0
    m, y = coupling.dimension, np.delete(np.linspace(-radius, radius, POINTS), POINTS // 2)
    summed = [
        c
        for c in range(m)
        if coupling.by_component or is_sum_of_curves(coupling.components[c].node)
    ]
    low, high = np.zeros((2, m, m)) if len(summed) == m else _of_vectors(coupling, radius)
    for c, d in itertools.product(summed, range(m)) if coupling.is_linear else ():
        low[c, d] = high[c, d] = nearest(coupling.jacobian_at_zero()[c][d].midpoint)
    for d, axis in enumerate(() if coupling.is_linear else np.eye(m)):
        with np.errstate(all="ignore"):
            gains = coupling.value(np.outer(y, axis)) / y[:, None]
        for c, slope in ((c, coupling.jacobian_at_zero()[c][d]) for c in summed):
            low[c, d] = min(float(np.min(gains[:, c])), nearest(slope.lo))
            high[c, d] = max(float(np.max(gains[:, c])), nearest(slope.hi))
    flat, middle = high - low < 1e-9 * (np.abs(high) + np.abs(low)), (low + high) / 2
    return np.where(flat, middle, low), np.where(flat, middle, high)


def _steps(coupling: Coupling) -> int:
    """What its values at some hundred points take: about two steps for each sign and function."""
    return 1 + sum(len(component.text) for component in coupling.components) // 4


def _of_vectors(coupling: Coupling, radius: float | Array, about: float | Array = 0.0) -> Gains:
    """Central differences at the corners, the centre and scattered points, for |y_c - about_c| <=
    radius, or its c."""
    radius = np.broadcast_to(radius, coupling.dimension)
    m = coupling.dimension
    spend(2 * m * _steps(coupling))
    corners = (
        np.array(list(itertools.product((-1.0, 0.0, 1.0), repeat=m)))
        if m <= 4
        else np.zeros((1, m))
    )
    scattered = np.random.default_rng(0).uniform(-1, 1, (SCATTERED, m))
    points = about + radius * np.concatenate([corners, scattered]) * (1 - _STEP)
    low, high = np.zeros((m, m)), np.zeros((m, m))
    for d in range(m):
        step = np.zeros(m)
        step[d] = _STEP * radius[d]
        with np.errstate(all="ignore"):
            slopes = (coupling.value(points + step) - coupling.value(points - step)) / (2 * step[d])
        low[:, d], high[:, d] = np.min(slopes, axis=0), np.max(slopes, axis=0)
    flat, middle = high - low < 1e-7 * (np.abs(high) + np.abs(low) + 1e-300), (low + high) / 2
    return np.where(flat, middle, low), np.where(flat, middle, high)


def make_templates(loop: Loop) -> Templates:
    """Lay out the channels of every mode once; ranges of the couplings are put in by
    ``float_system``."""
    m, size = loop.m, loop.n * loop.m
    K = np.zeros((size, size))
    for agent, gain in loop.pulls.gains.items():
        own = slice(agent * m, (agent + 1) * m)
        K[own, own] = [[nearest(x) for x in row] for row in gain]
    entries = [_entries(coupling) for coupling in loop.functions]
    A = loop.slopes
    nodes = [
        (loop.drift_place, c, d, i * m + c, i * m + d, size, curved, 1.0, nearest(A[c][d]))
        for i in range(loop.n if loop.drift_place is not None else 0)
        for c, d, curved in entries[-1]
    ]
    modes = []
    for name, arcs in loop.modes.items():
        table = [
            (kind, c, d, i * m + c, j * m + d, i * m + d, curved + 2 * loose, nearest(weight), 0.0)
            for (i, j, weight), loose in zip(arcs, arcs.uncertain.tolist(), strict=True)
            for kind in (loop.place_of(i, j),)
            for c, d, curved in entries[kind]
        ]
        columns = np.array(table + nodes, dtype=float).reshape(-1, 9).T
        place, where = np.split(columns[:6].astype(np.intp), 2)
        modes.append(
            _Template(
                name=name,
                place=place,
                where=where,
                curved=columns[6],
                weight=columns[7],
                known=columns[8],
            )
        )
    return Templates(size=size, K=K, modes=tuple(modes))


def _entries(coupling: Coupling) -> list[tuple[int, int, bool]]:
    """Row and column of every gain that may not be 0, and whether it may have a range.  So may
    every gain of a coupling that is not linear, and an irrational one, which is known by an
    enclosure only."""
    places = [(c, c) for c in range(coupling.dimension)]
    if not coupling.by_component:
        places = [
            (c, d)
            for c, component in enumerate(coupling.components)
            for d in variables_used(component.node)
        ]
    if not coupling.is_linear:
        return [(c, d, True) for c, d in places]
    slopes = coupling.jacobian_at_zero()
    return [(c, d, not slopes[c][d].is_point) for c, d in places]


def float_system(
    templates: Templates, gains: Gains, *, radius: float | None, S: Array | None, rate: float
) -> FloatSystem:
    """The numbers at one radius, from the gains of the couplings there."""
    low, high = gains
    modes = []
    for mode in templates.modes:
        bottom, above = (mode.weight * end[tuple(mode.place)] - mode.known for end in (low, high))
        loose, curved = mode.curved > 1, mode.curved > 0
        bottom, above = (
            np.where(loose, np.minimum(bottom, 0), bottom),
            np.where(loose, np.maximum(above, 0), above),
        )
        middle, A = (bottom + above) / 2, np.pad(-templates.K, (0, 1))
        target, plus, minus = mode.where
        np.add.at(A, (target, plus), middle)
        np.add.at(A, (target, minus), -middle)
        A = A[:-1, :-1]
        d = np.maximum((above - bottom) / 2, _NARROW * np.maximum(np.abs(middle), 1e-300))[curved]
        modes.append(FloatMode(name=mode.name, A=A, where=mode.where[:, curved], d=d))
    pairs = [np.sort(mode.where[1:].T, axis=1) for mode in modes]
    ends = (
        np.unique(np.concatenate(pairs), axis=0)
        if radius is not None
        else np.zeros((0, 2), dtype=np.intp)
    )
    reach = np.full(len(ends), radius or 0.0)
    return FloatSystem(
        size=templates.size, modes=tuple(modes), S=S, rate=rate, ends=ends, reach=reach
    )


def _decrease(system: FloatSystem, *, shift: int | None = None) -> list[Block]:
    """The inequality of every mode over Y, t, and kappa > 0 with an observer; ``shift``: theta with
    F + theta I > 0."""
    blocks, n, start = [], system.size, 0
    for mode in system.modes:
        k, root, (target, plus, minus) = len(mode.d), np.sqrt(mode.d), mode.where
        left = np.pad(
            np.vstack([mode.A + system.rate * np.eye(n), np.zeros((k, n))]), ((0, 0), (0, 1))
        )
        arcs = np.arange(k)
        left[n + arcs, plus] += root
        left[n + arcs, minus] -= root
        left = left[:, :-1]
        columns = np.zeros((n + k, 2 * k))
        columns[target, arcs] = root
        columns[n + arcs, k + arcs] = 1.0
        dense = {}
        if system.S is not None:
            dense[system.multipliers] = np.zeros((n + k, n + k))
            dense[system.multipliers][:n, :n] = -system.S
        if shift is not None:
            dense[shift] = np.eye(n + k)
        blocks.append(
            Block(
                constant=np.zeros((n + k, n + k)),
                sides=(left, np.vstack([np.eye(n), np.zeros((k, n))])),
                columns=(
                    columns,
                    np.repeat([-1.0, 1.0], k),
                    np.concatenate([start + arcs, start + arcs]),
                ),
                dense=dense,
            )
        )
        start += k
    return blocks


def centring(system: FloatSystem, basis: Basis, *, shift: bool = False) -> Inequalities:
    """Find Y, t, kappa with 0 < Y < I: the inequalities do not change when all are scaled.
    Scalars: t, with an observer kappa, and with ``shift`` theta."""
    count = system.multipliers + (system.S is not None)
    blocks = _decrease(system, shift=count if shift else None)
    blocks.append(Block(constant=np.eye(system.size), plain=-1.0))
    if shift:
        # Elsewhere the main inequality keeps Y positive: at Y v = 0 it would fail.
        blocks.append(Block(constant=np.zeros((system.size, system.size)), plain=1.0))
    positive = np.arange(0 if shift else system.multipliers, count)
    return Inequalities(basis=basis, blocks=tuple(blocks), count=count + shift, positive=positive)


def covering(
    system: FloatSystem, basis: Basis, *, disturbance: float, condition: float
) -> Inequalities:
    """Find Y, t, kappa, lambda with lambda I < Y < condition lambda I (what no radius limits stays
    tame) in the radii, and with a ``disturbance`` n lambda_max(P) s^2 at kappa = 1 a radius R and
    its share b, in this order."""
    kappa = system.multipliers
    lambda_ = kappa + (system.S is not None)
    eye = np.eye(system.size)
    blocks = _decrease(system)
    for sign, factor in ((1.0, -1.0), (-1.0, condition)):
        blocks.append(Block(constant=np.zeros_like(eye), plain=sign, dense={lambda_: factor * eye}))
    disturbed = system.S is not None and disturbance > 0
    if disturbed:
        R, share = lambda_ + 1, lambda_ + 2
        corner, other, off = (
            np.diag([1.0, 0.0]),
            np.diag([0.0, 1.0]),
            np.array([[0.0, 1.0], [1.0, 0.0]]),
        )
        blocks.append(Block(constant=other, dense={lambda_: corner, R: off, share: -other}))
        blocks.append(
            Block(constant=np.sqrt(disturbance) * off, dense={kappa: corner, share: other})
        )
    forms, limits = _radii(system, basis)
    return Inequalities(
        basis=basis,
        blocks=tuple(blocks),
        count=lambda_ + 1 + 2 * disturbed,
        positive=np.arange(kappa, lambda_),
        forms=forms,
        limits=limits,
    )


def flattening(
    system: FloatSystem, basis: Basis, *, ball: float, disturbance: float
) -> Inequalities:
    """Find Y, t, kappa and mu with ball^2 I < Y < mu I in the radii, so that mu bounds the
    condition of Y.  With a ``disturbance`` n lambda_max(P) s^2 at kappa = 1: lambda I < Y and the
    share b of it, before mu."""
    kappa = system.multipliers
    first = kappa + (system.S is not None)
    disturbed = system.S is not None and disturbance > 0
    mu, eye = first + 2 * disturbed, np.eye(system.size)
    blocks = [*_decrease(system), Block(constant=np.zeros_like(eye), plain=-1.0, dense={mu: eye})]
    if disturbed:
        share = first + 1
        corner, other, off = (
            np.diag([1.0, 0.0]),
            np.diag([0.0, 1.0]),
            np.array([[0.0, 1.0], [1.0, 0.0]]),
        )
        blocks.append(Block(constant=np.zeros_like(eye), plain=1.0, dense={first: -eye}))
        blocks.append(Block(constant=other + ball * off, dense={first: corner, share: -other}))
        blocks.append(
            Block(constant=np.sqrt(disturbance) * off, dense={kappa: corner, share: other})
        )
    else:
        blocks.append(Block(constant=-(ball**2) * eye, plain=1.0))
    forms, limits = _radii(system, basis)
    return Inequalities(
        basis=basis,
        blocks=tuple(blocks),
        count=mu + 1,
        positive=np.arange(kappa, mu + 1),
        forms=forms,
        limits=limits,
    )


def _radii(system: FloatSystem, basis: Basis) -> tuple[Array, Array]:
    """c'E c for every pair of ends and every unit matrix E, and the squares of the radii."""
    c, pairs = np.zeros((system.size + 1, len(system.ends))), np.arange(len(system.ends))
    c[system.ends[:, 0], pairs], c[system.ends[:, 1], pairs] = 1.0, -1.0
    c = c[:-1]
    return basis.products(c, c).T, system.reach**2
