"""The Lur'e inequalities as programs in Y = P_e^-1, where everything is affine (theory, section 4).

With t = 1/(2 tau d), d the half-width of a gain and g0 its middle, the inequality times Y on both sides is

    [[A0 Y + Y A0' + 2 beta Y + sum d t b b' + kappa I (x) S,  Y C' sqrt(d)], [., -diag(t)]] < 0

{e'P_e e <= 1} lies in |c'e| <= r iff c'Y c <= r^2, and holds the ball of radius sqrt(lambda) iff Y >= lambda I.  With
the observer's pair (P, Q)/kappa, |e| <= R, |eps_i| <= s are covered iff R^2/lambda + n lambda_max(P) s^2/kappa <= 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dobc_design.conditions.consensus.jacobian import nearest
from dobc_design.conditions.quadratic.sampled_gains import Gains
from dobc_design.coupling.coupling import Coupling
from dobc_design.coupling.expression import variables_used
from dobc_design.problem.problem import Problem
from dobc_design.solvers.barrier import Basis, Block, Indices, Inequalities
from dobc_design.solvers.program import Array

# Half-width of a range that is a point at this radius, relative to the gain, so that the unknowns stay the same.
_NARROW = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Template:
    """What does not depend on the radius in one mode: the arcs' channels, and which of them have a range.

    ``kind``: place among the ranges; ``row``, ``column``: entry of the range; ``curved``: whether it may have a width.
    """

    name: str
    kind: Indices
    row: Indices
    column: Indices
    weight: Array
    curved: NDArray[np.bool_]
    target: Indices
    plus: Indices
    minus: Indices


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Templates:
    """All modes, and the pins K (n m, n m)."""

    size: int
    K: Array
    modes: tuple[_Template, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FloatMode:
    """One mode in floats: A0 (n m, n m), and of every channel with a range its ends and d."""

    name: str
    A: Array
    target: Indices
    plus: Indices
    minus: Indices
    d: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FloatLoop:
    """All modes at one radius, the borders S (n m, n m) of the observers or None, and the rate beta.

    ``ends`` (pairs, 2) and ``reach`` (pairs,): |e_i - e_j| <= reach, each pair once.
    """

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


@dataclass(frozen=True, slots=True, kw_only=True)
class Scalars:
    """Where the scalars stand after the t: kappa, lambda, and R and the share b of the observer; None: absent."""

    kappa: int | None
    lambda_: int | None = None
    R: int | None = None
    share: int | None = None
    count: int


def make_templates(problem: Problem) -> Templates:
    """Lay out the channels of every mode once; ranges of the couplings are put in by ``float_loop``."""
    m, size = problem.m, problem.n * problem.m
    K = np.zeros((size, size))
    for agent, gain in problem.pinning.gains.items():
        K[agent * m : (agent + 1) * m, agent * m : (agent + 1) * m] = [[nearest(x) for x in row] for row in gain]
    entries = [_entries(coupling) for coupling in problem.couplings]
    modes = []
    for name, arcs in problem.network.modes.items():
        table = [
            (kind, c, d, nearest(weight), curved, i * m + c, j * m + d, i * m + d)
            for i, j, weight in arcs
            for kind in (problem.coupling_place(i, j),)
            for c, d, curved in entries[kind]
        ]
        parts = list(zip(*table, strict=True)) or [()] * 8
        kind, row, column, target, plus, minus = (np.array(parts[k], dtype=np.intp) for k in (0, 1, 2, 5, 6, 7))
        modes.append(
            _Template(
                name=name,
                kind=kind,
                row=row,
                column=column,
                weight=np.array(parts[3], dtype=float),
                curved=np.array(parts[4], dtype=bool),
                target=target,
                plus=plus,
                minus=minus,
            )
        )
    return Templates(size=size, K=K, modes=tuple(modes))


def float_loop(templates: Templates, gains: Gains, *, radius: float | None, S: Array | None, rate: float) -> FloatLoop:
    """The numbers at one radius, from the gains of the couplings there."""
    low, high = gains
    modes = []
    for mode in templates.modes:
        places = (mode.kind, mode.row, mode.column)
        bottom, above = mode.weight * low[places], mode.weight * high[places]
        middle, A = (bottom + above) / 2, -templates.K
        np.add.at(A, (mode.target, mode.plus), middle)
        np.add.at(A, (mode.target, mode.minus), -middle)
        kept = mode.curved
        d = np.maximum((above - bottom) / 2, _NARROW * np.maximum(np.abs(middle), 1e-300))[kept]
        modes.append(
            FloatMode(name=mode.name, A=A, target=mode.target[kept], plus=mode.plus[kept], minus=mode.minus[kept], d=d)
        )
    pairs = [np.sort(np.stack([mode.plus, mode.minus], axis=1), axis=1) for mode in modes]
    ends = np.unique(np.concatenate(pairs), axis=0) if radius is not None else np.zeros((0, 2), dtype=np.intp)
    return FloatLoop(
        size=templates.size, modes=tuple(modes), S=S, rate=rate, ends=ends, reach=np.full(len(ends), radius or 0.0)
    )


def _entries(coupling: Coupling) -> list[tuple[int, int, bool]]:
    """Row and column of every gain that may not be 0, and whether it may have a range.

    So may every gain of a coupling that is not linear, and an irrational one, which is known by an enclosure only.
    """
    m = range(coupling.dimension)
    places = (
        [(c, c) for c in m]
        if coupling.by_component
        else [(c, d) for c, component in enumerate(coupling.components) for d in variables_used(component.node)]
    )
    if not coupling.is_linear:
        return [(c, d, True) for c, d in places]
    slopes = coupling.jacobian_at_zero()
    return [(c, d, not slopes[c][d].is_point) for c, d in places]


def decrease_blocks(loop: FloatLoop, *, kappa: int | None, shift: int | None = None) -> list[Block]:
    """The inequality of every mode, as blocks over Y, t, kappa; ``shift``: a scalar theta with F + theta I > 0."""
    blocks, n, start = [], loop.size, 0
    for mode in loop.modes:
        k = len(mode.d)
        root = np.sqrt(mode.d)
        left = np.vstack([mode.A + loop.rate * np.eye(n), np.zeros((k, n))])
        arcs = np.arange(k)
        left[n + arcs, mode.plus] += root
        left[n + arcs, mode.minus] -= root
        columns = np.zeros((n + k, 2 * k))
        columns[mode.target, arcs] = root
        columns[n + arcs, k + arcs] = 1.0
        dense = {}
        if kappa is not None and loop.S is not None:
            dense[kappa] = np.zeros((n + k, n + k))
            dense[kappa][:n, :n] = -loop.S
        if shift is not None:
            dense[shift] = np.eye(n + k)
        scalars = np.concatenate([start + arcs, start + arcs])
        blocks.append(
            Block(
                constant=np.zeros((n + k, n + k)),
                left=left,
                right=np.vstack([np.eye(n), np.zeros((k, n))]),
                columns=columns,
                signs=np.concatenate([-np.ones(k), np.ones(k)]),
                scalars=scalars,
                dense=dense,
            )
        )
        start += k
    return blocks


def centring(loop: FloatLoop, basis: Basis, *, shift: bool = False) -> tuple[Inequalities, Scalars]:
    """Find Y, t, kappa with 0 < Y < I: the inequalities do not change when all are scaled.  ``shift``: with theta."""
    count = loop.multipliers
    kappa = count if loop.S is not None else None
    count += kappa is not None
    theta = count if shift else None
    count += shift
    blocks = decrease_blocks(loop, kappa=kappa, shift=theta)
    blocks.append(Block(constant=np.eye(loop.size), plain=-1.0))
    if kappa is not None:
        blocks.append(Block(constant=np.zeros((1, 1)), dense={kappa: np.ones((1, 1))}))
    if theta is not None:
        # Elsewhere the main inequality keeps Y positive: at Y v = 0 it would fail.
        blocks.append(Block(constant=np.zeros((loop.size, loop.size)), plain=1.0))
        blocks += [Block(constant=np.zeros((1, 1)), dense={k: np.ones((1, 1))}) for k in range(loop.multipliers)]
    problem = Inequalities(
        basis=basis, blocks=tuple(blocks), count=count, forms=np.zeros((0, basis.size)), limits=np.zeros(0)
    )
    return problem, Scalars(kappa=kappa, count=count)


def covering(loop: FloatLoop, basis: Basis, *, disturbance: float, condition: float) -> tuple[Inequalities, Scalars]:
    """Find Y, t, kappa, lambda with Y > lambda I inside the radii, and with a disturbance R and its share b.

    ``disturbance`` is n lambda_max(P) s^2 for kappa = 1; 0: lambda is all there is.  ``condition``: Y < condition
    lambda I, so that directions that no radius limits stay tame.
    """
    count, kappa = loop.multipliers, None
    if loop.S is not None:
        kappa, count = count, count + 1
    lambda_, count = count, count + 1
    eye = np.eye(loop.size)
    blocks = decrease_blocks(loop, kappa=kappa)
    blocks.append(Block(constant=np.zeros_like(eye), plain=1.0, dense={lambda_: -eye}))
    blocks.append(Block(constant=np.zeros_like(eye), plain=-1.0, dense={lambda_: condition * eye}))
    R = share = None
    if kappa is not None:
        blocks.append(Block(constant=np.zeros((1, 1)), dense={kappa: np.ones((1, 1))}))
    if kappa is not None and disturbance > 0:
        R, share, count = count, count + 1, count + 2
        corner, other, off = np.diag([1.0, 0.0]), np.diag([0.0, 1.0]), np.array([[0.0, 1.0], [1.0, 0.0]])
        blocks.append(Block(constant=other, dense={lambda_: corner, R: off, share: -other}))
        blocks.append(Block(constant=np.sqrt(disturbance) * off, dense={kappa: corner, share: other}))
    problem = Inequalities(
        basis=basis, blocks=tuple(blocks), count=count, forms=_squares(basis, loop), limits=loop.reach**2
    )
    return problem, Scalars(kappa=kappa, lambda_=lambda_, R=R, share=share, count=count)


def _squares(basis: Basis, loop: FloatLoop) -> Array:
    """c'E c for every pair of ends and every unit matrix E."""
    c = np.zeros((loop.size, len(loop.ends)))
    pairs = np.arange(len(loop.ends))
    c[loop.ends[:, 0], pairs], c[loop.ends[:, 1], pairs] = 1.0, -1.0
    return basis.products(c, c).T
