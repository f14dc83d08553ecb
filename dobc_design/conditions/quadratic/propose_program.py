"""The Lur'e inequalities as programs in Y = P_e^-1, in floating point: gains, the loop, the blocks
of a barrier.

Everything is affine in Y (theory, section 4).  With t = 1/(2 tau d), d the half-width of a gain and
g0 its middle, the inequality times Y on both sides is

    [[A0 Y + Y A0' + 2 beta Y + sum d t b b' + kappa I (x) S,  Y C' sqrt(d)], [., -diag(t)]] < 0

{e'P_e e <= 1} lies in |c'e| <= r iff c'Y c <= r^2, and holds the ball of radius sqrt(lambda) iff Y
>= lambda I.  With the observer's pair (P, Q)/kappa, |e| <= R, |eps_i| <= s are covered iff
R^2/lambda + n lambda_max(P) s^2/kappa <= 1.
"""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dobc_design._checks import noun
from dobc_design.coupling.coupling import Coupling
from dobc_design.coupling.expression import variables_used
from dobc_design.exact.matrix import Array
from dobc_design.exact.number import ONE, nearest
from dobc_design.exact.work import spend
from dobc_design.loop.loop import Loop
from dobc_design.loop.matrices import pull_matrix
from dobc_design.solvers.barrier import Basis, Block, Indices, Inequalities

from .sectors import is_sum_of_curves

Gains = tuple[Array, Array]  # lowest and highest, (couplings, m, m)

POINTS = 401  # along each axis
SCATTERED = 600  # points in a box of several dimensions, besides its corners
WIDER = 2e-5  # about what enclosures are widened and rounded by
_STEP = 1e-6  # of a central difference, relative to the radius
# Half-width of a range that is a point at this radius, relative to the gain, so that the unknowns
# stay the same.
_NARROW = 1e-9


@noun(eq=False)
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


class _Gain(NamedTuple):
    """One gain of one arc or node: its coupling, row and column there; the rows of e that it acts
    on and takes the difference of; ``curved`` as in _Template; ``known``: what of it K holds."""

    coupling: int
    row: int
    column: int
    target: int
    plus: int
    minus: int
    curved: int
    weight: float
    known: float


@noun(eq=False)
class Templates:
    """All modes, and the pins K (n m, n m)."""

    size: int
    K: Array
    modes: tuple[_Template, ...]


@noun(eq=False)
class FloatMode:
    """One mode in floats: A0 (n m, n m); of every channel with a range its target, plus and minus
    (3, k), and d."""

    name: str
    A: Array
    where: Indices
    d: Array


@noun(eq=False)
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
        i = self.ends[:, 0]
        j = self.ends[:, 1]
        # the target, whose error is 0, comes last
        Y = np.pad(Y, (0, 1))
        return np.asarray(Y[i, i] + Y[j, j] - 2 * Y[i, j])


def sample_gains(loop: Loop, radius: float) -> Gains | None:
    """Lowest and highest gains of every coupling on |y_c| <= radius, about, of nodes for every
    state of a leader; None where one is not finite."""
    # Where slopes move with a leader, those of the nodes are asked for around every state of it.
    known = loop.functions
    if loop.slopes_move:
        known = known[: loop.drift_place]
    found = [_sampled(each, radius) for each in known]
    if loop.slopes_move:
        box = loop.goals.leaders_box()
        half = np.array([nearest(side.width / 2) for side in box])
        middle = np.array([nearest(side.midpoint) for side in box])
        found.append(_of_vectors(loop.functions[-1], radius + half, middle))
    low = np.array([ends[0] for ends in found])
    high = np.array([ends[1] for ends in found])
    if not np.all(np.isfinite(low)) or not np.all(np.isfinite(high)):
        return None
    # As wide as the enclosures that certificates claim, so that what fits here fits there.
    bent = np.array([not each.is_linear for each in loop.functions])[:, None, None]
    largest = np.maximum(np.abs(low), np.abs(high))
    margin = WIDER * np.where(bent, largest, 0.0)
    return low - margin, high + margin


def _sampled(coupling: Coupling, radius: float) -> Gains:
    """H_c(y)/y_d along the axes, and the slopes at 0, where H_c is a sum of functions of one
    variable each; elsewhere slopes."""
    m = coupling.dimension
    spend(0 if coupling.is_linear else m * _steps(coupling))
    summed = [c for c in range(m) if _is_summed(coupling, c)]
    if len(summed) == m:
        low, high = np.zeros((2, m, m))
    else:
        low, high = _of_vectors(coupling, radius)
    slopes = coupling.jacobian_at_zero() if summed else ()
    if coupling.is_linear:  # its gains are its slopes
        for c in summed:
            for d in range(m):
                low[c, d] = high[c, d] = nearest(slopes[c][d].midpoint)
        return _flattened(low, high, 1e-9)
    y = np.delete(np.linspace(-radius, radius, POINTS), POINTS // 2)  # without 0
    for d, axis in enumerate(np.eye(m)):
        with np.errstate(all="ignore"):
            gains = coupling.value(np.outer(y, axis)) / y[:, None]
        # The slope at 0 is the gain there, between the points.
        for c in summed:
            low[c, d] = min(float(np.min(gains[:, c])), nearest(slopes[c][d].lo))
            high[c, d] = max(float(np.max(gains[:, c])), nearest(slopes[c][d].hi))
    return _flattened(low, high, 1e-9)


def _is_summed(coupling: Coupling, c: int) -> bool:
    """Whether component c is a sum of functions of one variable each."""
    return coupling.by_component or is_sum_of_curves(coupling.components[c].node)


def _flattened(low: Array, high: Array, part: float, least: float = 0.0) -> Gains:
    """The middle for both ends where they differ by less than this part of themselves, which is the
    noise of floats."""
    flat = high - low < part * (np.abs(high) + np.abs(low) + least)
    middle = (low + high) / 2
    return np.where(flat, middle, low), np.where(flat, middle, high)


def _steps(coupling: Coupling) -> int:
    """What its values at some hundred points take: about two steps for each sign and function."""
    return 1 + sum(len(component.text) for component in coupling.components) // 4


def _of_vectors(coupling: Coupling, radius: float | Array, about: float | Array = 0.0) -> Gains:
    """Central differences at the corners, the centre and scattered points, for |y_c - about_c| <=
    radius, or its c."""
    m = coupling.dimension
    radius = np.broadcast_to(radius, m)
    spend(2 * m * _steps(coupling))
    corners = np.zeros((1, m))
    if m <= 4:  # beyond, there are too many
        corners = np.array(list(itertools.product((-1.0, 0.0, 1.0), repeat=m)))
    scattered = np.random.default_rng(0).uniform(-1, 1, (SCATTERED, m))
    # A step inside, so that differences stay in the box.
    points = about + radius * np.concatenate([corners, scattered]) * (1 - _STEP)
    low = np.zeros((m, m))
    high = np.zeros((m, m))
    for d in range(m):
        step = np.zeros(m)
        step[d] = _STEP * radius[d]
        with np.errstate(all="ignore"):
            rise = coupling.value(points + step) - coupling.value(points - step)
            slopes = rise / (2 * step[d])
        low[:, d] = np.min(slopes, axis=0)
        high[:, d] = np.max(slopes, axis=0)
    return _flattened(low, high, 1e-7, 1e-300)


def make_templates(loop: Loop) -> Templates:
    """Lay out the channels of every mode once; ranges of the couplings are put in by
    ``float_system``."""
    entries = [_entries(coupling) for coupling in loop.functions]
    modes = tuple(_template(loop, name, entries) for name in loop.modes)
    return Templates(size=loop.size, K=pull_matrix(loop).toarray(), modes=modes)


def _template(
    loop: Loop, name: str, entries: Sequence[Sequence[tuple[int, int, bool]]]
) -> _Template:
    """The gains of one mode, those of its nodes after those of its arcs."""
    m = loop.m
    arcs = loop.modes[name]
    links = list(zip(arcs, arcs.uncertain.tolist(), strict=True))
    if loop.drift_place is not None:
        links += [((i, i, ONE), False) for i in range(loop.n)]
    gains: list[_Gain] = []
    # Arc (i, j): agent i takes the difference e_j - e_i; (i, i) is what it does alone, which is
    # about its difference to the target.
    for (i, j, weight), loose in links:
        alone = i == j
        coupling = loop.place_of(i, j)
        if alone and loop.drift_place is not None:
            coupling = loop.drift_place
        for c, d, curved in entries[coupling]:
            gain = _Gain(
                coupling=coupling,
                row=c,
                column=d,
                target=i * m + c,
                plus=min(j * m + d, loop.size),
                minus=loop.size if alone else i * m + d,
                curved=curved + 2 * loose,
                weight=nearest(weight),
                known=nearest(loop.slopes[c][d]) if alone else 0.0,
            )
            gains.append(gain)
    # One column of a table for every gain: the first six entries are places, the others numbers.
    columns = np.array(gains, dtype=float).reshape(-1, len(_Gain._fields)).T
    place, where = np.split(columns[:6].astype(np.intp), 2)
    return _Template(
        name=name,
        place=place,
        where=where,
        curved=columns[6],
        weight=columns[7],
        known=columns[8],
    )


def _entries(coupling: Coupling) -> list[tuple[int, int, bool]]:
    """Row and column of every gain that may not be 0, and whether it may have a range.  So may
    every gain of a coupling that is not linear, and an irrational one, which is known by an
    enclosure only."""
    if coupling.by_component:
        places = [(c, c) for c in range(coupling.dimension)]
    else:
        places = []
        for c, component in enumerate(coupling.components):
            places += [(c, d) for d in variables_used(component.node)]
    if not coupling.is_linear:
        return [(c, d, True) for c, d in places]
    slopes = coupling.jacobian_at_zero()
    return [(c, d, not slopes[c][d].is_point) for c, d in places]


def float_system(
    templates: Templates, gains: Gains, *, radius: float | None, S: Array | None, rate: float
) -> FloatSystem:
    """The numbers at one radius, from the gains of the couplings there."""
    modes = [_float_mode(templates, mode, gains) for mode in templates.modes]
    ends = np.zeros((0, 2), dtype=np.intp)
    if radius is not None:
        # Gains are bounded while these differences stay below the radius.
        pairs = [np.sort(mode.where[1:].T, axis=1) for mode in modes]
        ends = np.unique(np.concatenate(pairs), axis=0)
    reach = np.full(len(ends), radius or 0.0)
    return FloatSystem(
        size=templates.size, modes=tuple(modes), S=S, rate=rate, ends=ends, reach=reach
    )


def _float_mode(templates: Templates, mode: _Template, gains: Gains) -> FloatMode:
    """The middle gains of a mode as A0, and the half-widths of those with a range."""
    low, high = gains
    place = tuple(mode.place)
    bottom = mode.weight * low[place] - mode.known
    above = mode.weight * high[place] - mode.known
    # An arc that may be away has the gain 0 as well.
    loose = mode.curved > 1
    bottom = np.where(loose, np.minimum(bottom, 0), bottom)
    above = np.where(loose, np.maximum(above, 0), above)
    middle = (bottom + above) / 2
    target, plus, minus = mode.where
    # A last row and column for the target, dropped in the end.
    A = np.pad(-templates.K, (0, 1))
    np.add.at(A, (target, plus), middle)
    np.add.at(A, (target, minus), -middle)
    curved = mode.curved > 0
    narrowest = _NARROW * np.maximum(np.abs(middle), 1e-300)
    d = np.maximum((above - bottom) / 2, narrowest)[curved]
    return FloatMode(name=mode.name, A=A[:-1, :-1], where=mode.where[:, curved], d=d)


def _decrease(system: FloatSystem, *, shift: int | None = None) -> list[Block]:
    """The inequality of every mode over Y, t, and kappa > 0 with an observer; ``shift``: theta with
    F + theta I > 0."""
    blocks = []
    start = 0
    for mode in system.modes:
        blocks.append(_decrease_in(system, mode, start, shift))
        start += len(mode.d)
    return blocks


def _decrease_in(system: FloatSystem, mode: FloatMode, start: int, shift: int | None) -> Block:
    """The inequality of one mode, whose t begin at the scalar ``start``."""
    n = system.size
    k = len(mode.d)
    rows = n + k
    root = np.sqrt(mode.d)
    target, plus, minus = mode.where
    arcs = np.arange(k)
    # A0 + beta I above, sqrt(d) c' below; the column of the target is dropped.
    left = np.zeros((rows, n + 1))
    left[:n, :n] = mode.A + system.rate * np.eye(n)
    left[n + arcs, plus] += root
    left[n + arcs, minus] -= root
    right = np.vstack([np.eye(n), np.zeros((k, n))])
    # -d t b b' above, t below
    columns = np.zeros((rows, 2 * k))
    columns[target, arcs] = root
    columns[n + arcs, k + arcs] = 1.0
    signs = np.repeat([-1.0, 1.0], k)
    scalars = np.concatenate([start + arcs, start + arcs])
    dense = {}
    if system.S is not None:
        border = np.zeros((rows, rows))
        border[:n, :n] = -system.S
        dense[system.multipliers] = border
    if shift is not None:
        dense[shift] = np.eye(rows)
    return Block(
        constant=np.zeros((rows, rows)),
        sides=(left[:, :-1], right),
        columns=(columns, signs, scalars),
        dense=dense,
    )


def centring(system: FloatSystem, basis: Basis, *, shift: bool = False) -> Inequalities:
    """Find Y, t, kappa with 0 < Y < I: the inequalities do not change when all are scaled.
    Scalars: t, with an observer kappa, and with ``shift`` theta."""
    count = system.multipliers
    if system.S is not None:
        count += 1
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
    # lambda I < Y < condition lambda I
    blocks.append(Block(constant=np.zeros_like(eye), plain=1.0, dense={lambda_: -1.0 * eye}))
    blocks.append(Block(constant=np.zeros_like(eye), plain=-1.0, dense={lambda_: condition * eye}))
    disturbed = system.S is not None and disturbance > 0
    if disturbed:
        R = lambda_ + 1
        share = lambda_ + 2
        # [[lambda, R], [R, 1 - b]] > 0: the ball of radius R takes at most the part 1 - b.
        corner, other, off = _unit_forms()
        blocks.append(Block(constant=other, dense={lambda_: corner, R: off, share: -other}))
        blocks.append(_disturbance_block(disturbance, kappa=kappa, share=share))
    count = lambda_ + 1 + 2 * disturbed
    return _within_radii(system, basis, blocks, count=count, positive=np.arange(kappa, lambda_))


def _unit_forms() -> tuple[Array, Array, Array]:
    """The symmetric 2 x 2 matrices with a 1 at the first place, at the second, and beside the
    diagonal."""
    return np.diag([1.0, 0.0]), np.diag([0.0, 1.0]), np.array([[0.0, 1.0], [1.0, 0.0]])


def _disturbance_block(disturbance: float, *, kappa: int, share: int) -> Block:
    """b kappa > disturbance: what the errors of the observers take of the level."""
    corner, other, off = _unit_forms()
    root = np.sqrt(disturbance)
    return Block(constant=root * off, dense={kappa: corner, share: other})


def flattening(
    system: FloatSystem, basis: Basis, *, ball: float, disturbance: float
) -> Inequalities:
    """Find Y, t, kappa and mu with ball^2 I < Y < mu I in the radii, so that mu bounds the
    condition of Y.  With a ``disturbance`` n lambda_max(P) s^2 at kappa = 1: lambda I < Y and the
    share b of it, before mu."""
    kappa = system.multipliers
    first = kappa + (system.S is not None)
    disturbed = system.S is not None and disturbance > 0
    mu = first + 2 * disturbed
    eye = np.eye(system.size)
    blocks = _decrease(system)
    # Y < mu I; and Y > ball^2 I, or with the part that the disturbance takes
    blocks.append(Block(constant=np.zeros_like(eye), plain=-1.0, dense={mu: eye}))
    if disturbed:
        share = first + 1
        corner, other, off = _unit_forms()
        blocks.append(Block(constant=np.zeros_like(eye), plain=1.0, dense={first: -eye}))
        blocks.append(Block(constant=other + ball * off, dense={first: corner, share: -other}))
        blocks.append(_disturbance_block(disturbance, kappa=kappa, share=share))
    else:
        blocks.append(Block(constant=-(ball**2) * eye, plain=1.0))
    # The unknown scalars in this order: t, kappa, lambda and b, mu.
    positive = np.arange(kappa, mu + 1)
    return _within_radii(system, basis, blocks, count=mu + 1, positive=positive)


def _within_radii(
    system: FloatSystem, basis: Basis, blocks: Sequence[Block], *, count: int, positive: Indices
) -> Inequalities:
    """These inequalities of so many scalars, and c'Y c below the square of the radius for every
    pair of ends."""
    pairs = np.arange(len(system.ends))
    # One column c = u_i - u_j for each pair; the row of the target is dropped.
    c = np.zeros((system.size + 1, len(pairs)))
    c[system.ends[:, 0], pairs] = 1.0
    c[system.ends[:, 1], pairs] = -1.0
    c = c[:-1]
    return Inequalities(
        basis=basis,
        blocks=tuple(blocks),
        count=count,
        positive=positive,
        forms=basis.products(c, c).T,
        limits=system.reach**2,
    )
