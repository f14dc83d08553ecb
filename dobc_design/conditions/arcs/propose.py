"""Proposes arc-wise certificates, in floating point: how much of V' each arc may take of its two
agents, so that all are left as much as possible (theory, section 20).

On the edge of its disc an arc i <- j has d_i x^2 = (1 - z) rho^2, d_j y^2 = z rho^2, and takes at
most N(z) d_i w rho^2 there, z in [0, 1].  Its numbers a = d_i w A, b = d_j w B are a line A (1 - z)
+ B z that lies nowhere below N; a line that is no higher than needed touches the concave hull of N
at some z.  Where all agents of a connected part are left the same, z = 1/(1 + exp(y_i - y_j)) for a
number y of each agent (the dual variables of the linear program), which Newton's method finds.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from dobc_design._checks import noun
from dobc_design.conditions.numbers import rounded_down
from dobc_design.conditions.quadratic.propose import ScaledPair, scaled_pair
from dobc_design.coupling.coupling import Coupling
from dobc_design.exact.interval import UndefinedError
from dobc_design.exact.matrix import Array, Matrix, add, multiply, scale, to_float, transpose
from dobc_design.exact.number import ZERO, float_above
from dobc_design.exact.symmetric import Doubles
from dobc_design.exact.work import spend
from dobc_design.loop.arcs import coupling_places
from dobc_design.loop.loop import Loop
from dobc_design.problem.groups import group_numbers
from dobc_design.problem.network import IndexArray
from dobc_design.solvers.program import factored

from .claim import ArcWise, form_of, shared_arcs
from .decide import errors_of_arcs, taken_of

PLACES = 512  # z of a table
SAMPLES = 4097  # of a coupling
#: The hull is averaged over so many places on both sides, which smooths it, then over fewer.
WIDTHS = (64, 16, 4, 1, 0)
STEPS = 12  # of Newton's method for each
FARTHEST = 4.0  # of y in a step
ROUNDING = 1e-7  # of the mean, by which a step may seem to gain nothing
HALVINGS = 8  # of a step that gains nothing
DAMPING = 1e-7
CLOSE = 1e-4  # of the least that an agent is left
SPARE = 0.02  # of what agents are left, shared among their arcs for what the tables do not see
LEAST = 1e-4  # of what pulls most, that has to be left of everybody
IN_HAND = 1 + 1e-6  # of what observers take of a level, for the rounding of eigenvalues
TINY = 1e-300
BITS = 24  # of a number of an arc, as a part of the largest one


# z = sin(theta)^2 with equal steps of theta: N bends like a root at both ends
Z = np.sin(np.linspace(0, math.pi / 2, PLACES + 1)) ** 2


def _hull(
    h: Coupling, rho: float, d: tuple[float, float], *, loose: bool, error: float = 0.0
) -> Array:
    """The least concave function above N / d_i of one kind of arc with a weight of 1 up to this
    error, (PLACES + 1,).  Raises: UndefinedError."""
    x = np.sqrt((1 - Z) / d[0])
    farthest = rho * math.sqrt(1 / d[0] + 1 / d[1])
    places = np.linspace(0, farthest, SAMPLES)
    gains = _gains(h, farthest)
    taken = np.full(len(Z), 0.0 if loose else -np.inf)
    for y in (np.sqrt(Z / d[1]), -np.sqrt(Z / d[1])):
        for ends in gains:
            gain = np.interp(rho * np.abs(y - x), places, ends)
            taken = np.maximum(taken, -2 * d[0] * gain * (x * x - x * y))
    return _concave(Z, taken + error * np.abs(taken))


@lru_cache(maxsize=256)
def _gains(h: Coupling, farthest: float) -> tuple[Array, Array]:
    """The least and the most that h(y)/y is, about, on growing intervals around 0 up to
    ``farthest``.  Raises: UndefinedError."""
    y = np.linspace(0, farthest, SAMPLES)[1:]
    both = np.stack([y, -y])
    with np.errstate(all="ignore"):
        values = h.numpy_function()(np.repeat(both[..., None], h.dimension, axis=-1))
        both = values[..., 0] / both
    if not np.all(np.isfinite(both)):
        raise UndefinedError("a coupling has no values so far out.")
    least, most = np.minimum.accumulate(both.min(axis=0)), np.maximum.accumulate(both.max(axis=0))
    return np.insert(least, 0, least[0]), np.insert(most, 0, most[0])


def _concave(z: Array, values: Array) -> Array:
    """The least concave function above some values."""
    kept: list[int] = []
    for k in range(len(z)):
        while len(kept) >= 2:
            i, j = kept[-2:]
            rise = (values[j] - values[i]) * (z[k] - z[i])
            if rise > (values[k] - values[i]) * (z[j] - z[i]):
                break
            kept.pop()
        kept.append(k)
    return np.interp(z, z[kept], values[kept])


@noun(eq=False)
class Lines:
    """Lines by the z at which they touch: their heights at z = 0 and z = 1, (kinds, PLACES + 1)."""

    own: Array
    other: Array


@noun(eq=False)
class Network:
    """One mode: arcs between free nodes with their ``kind`` and weight, the hulls of all kinds,
    and what pulls each node by itself, over d (n,).  ``part``: of each node, the number of the
    connected part it belongs to."""

    listeners: IndexArray
    speakers: IndexArray
    weights: Array
    kind: IndexArray
    hulls: Array
    pull: Array
    part: IndexArray

    def lines(self, width: int) -> Lines:
        """Tangents of the hulls, which are averaged over so many places on both sides."""
        place = np.arange(PLACES + 1)
        half = np.minimum(width, np.minimum(place, PLACES - place))
        sums = np.pad(np.cumsum(self.hulls, axis=1), ((0, 0), (1, 0)))
        means = (sums[:, place + half + 1] - sums[:, place - half]) / (2 * half + 1)
        slope = np.gradient(means, Z, axis=1)
        return Lines(own=means - Z * slope, other=means + (1 - Z) * slope)

    def shares(self, lines: Lines, y: Array) -> Shared:
        """What the lines give that y chooses, and how it changes with y, as an M-matrix."""
        i, j = self.listeners, self.speakers
        theta = np.arctan(np.exp(np.clip(y[j] - y[i], -200, 200) / 2))
        where = theta * (2 * PLACES / math.pi)
        place = np.minimum(where.astype(np.int64), PLACES - 1)
        part = where - place
        turn = (np.sin(2 * theta) / 2) ** 2 / np.diff(Z)[place]  # dz/dy over the step of z
        heights, changes = [], []
        for table in (lines.own, lines.other):
            below = table[self.kind, place]
            rise = table[self.kind, place + 1] - below
            heights.append(self.weights * (below + rise * part))
            changes.append(self.weights * turn * rise)
        own, other = heights
        n = len(self.pull)
        left = self.pull - np.bincount(i, own, n) - np.bincount(j, other, n)
        return Shared(own=own, other=other, left=left, y=y, changes=changes)

    def step(self, now: Shared) -> Array:
        """Newton's step of y, towards what leaves all nodes of a part the same; 0 where they
        are."""
        i, j = self.listeners, self.speakers
        n = len(self.pull)
        own, other = np.maximum(now.changes[0], 0), np.maximum(-now.changes[1], 0)
        damping = DAMPING * ((own.sum() + other.sum()) / n + 1e-12)
        nodes = np.arange(n)
        M = sparse.csc_array(
            (
                np.concatenate([own, -own, other, -other, np.full(n, damping)]),
                (np.concatenate([i, i, j, j, nodes]), np.concatenate([i, j, j, i, nodes])),
            ),
            shape=(n, n),
        )
        options = {"SymmetricMode": True, "DiagPivotThresh": 0.0}
        solver = factored(M, permc_spec="MMD_AT_PLUS_A", options=options)
        fall, rise = solver.solve(-now.left), solver.solve(np.ones(n))
        # M does not know how y is shifted as a whole.
        level = -np.bincount(self.part, fall) / np.bincount(self.part, rise)
        off = np.abs(now.left - level[self.part]).max()
        if off < CLOSE * (np.abs(level).max() + 1e-9):
            return np.zeros(n)
        return np.asarray(fall + level[self.part] * rise)

    def mean(self, now: Shared) -> Array:
        """What is left of each part, weighted by u = exp(y), as if no y were larger than 0."""
        highest = np.full(self.part.max() + 1, -np.inf)
        np.maximum.at(highest, self.part, now.y)
        u = np.exp(now.y - highest[self.part])
        return np.bincount(self.part, u * now.left) / np.bincount(self.part, u)


def network_of(loop: Loop, mode: str, d: Array, rho: float, pull: Array) -> Network:
    """Raises: UndefinedError."""
    arcs = loop.modes[mode]
    free = shared_arcs(loop, arcs)
    i, j = arcs.listeners[free], arcs.speakers[free]
    place = coupling_places(loop, arcs)[free]
    loose = arcs.uncertain[free]
    rows = np.stack([place, d[i], d[j], loose], axis=1)
    kinds, kind = np.unique(rows, axis=0, return_inverse=True)
    error = float(errors_of_arcs(loop).weights)
    found = []
    for number, own, other, comes in kinds.tolist():
        spend(20)
        h = loop.functions[int(number)]
        found.append(_hull(h, rho, (own, other), loose=bool(comes), error=error))
    links = sparse.coo_array((np.ones(len(i)), (i, j)), shape=(loop.n, loop.n))
    _, part = connected_components(links, directed=False)
    return Network(
        listeners=i,
        speakers=j,
        weights=np.array([float(arcs.weights[k]) for k in free.tolist()]),
        kind=kind.ravel(),
        hulls=np.array(found).reshape(-1, PLACES + 1),
        pull=pull,
        part=part,
    )


@noun(eq=False)
class Shared:
    """How V' is shared out: A and B of every arc, and their ``changes``; what is left of every
    node, over d; y."""

    own: Array
    other: Array
    left: Array
    y: Array
    changes: list[Array]

    @property
    def least(self) -> float:
        return float(self.left.min())


def shared_out(net: Network, y: Array | None) -> Shared:
    """What leaves the least well off as much as is found, from y on."""
    exact = net.lines(0)
    best = net.shares(exact, np.zeros(len(net.pull)) if y is None else y)
    y = best.y
    for width in WIDTHS:
        y = _balanced(net, net.lines(width), y)
        found = net.shares(exact, y)
        if found.least > best.least:
            best = found
    return best


def _balanced(net: Network, lines: Lines, y: Array) -> Array:
    """y for which all nodes of a part are left the same.  With u = exp(y) what is left is the
    gradient of the convex function sum u_i left_i, which falls in every step."""
    now = net.shares(lines, y)
    for _ in range(STEPS):
        spend(40 + (len(y) + len(net.kind)) // 400)
        step = net.step(now)
        if not step.any():
            break
        farthest = np.zeros(net.part.max() + 1)
        np.maximum.at(farthest, net.part, np.abs(step))
        size = np.minimum(1, FARTHEST / np.maximum(farthest, 1e-12))
        before = net.mean(now)
        for _ in range(HALVINGS):
            tried = net.shares(lines, now.y + step * size[net.part])
            worse = net.mean(tried) > before + ROUNDING * np.abs(before)
            if not worse.any():
                break
            size = np.where(worse, size / 4, size)
        now = tried
    return now.y


class Split(NamedTuple):
    """Parts of the rate without observers: that is asked for, and that observers may take."""

    rate: float
    observer: float


SPLITS = (
    Split(0.9, 0.05),
    Split(0.7, 0.2),
    Split(0.4, 0.5),
    Split(0.1, 0.7),
    Split(0.1, 0.2),
    Split(0.02, 0.9),
    Split(0.02, 0.05),
)


@noun(eq=False)
class Search:
    """What certificates are looked for: the weights d (n,), and the gain W (q, m) for observers
    with |eps_i| <= disturbance.  ``known``: y of every mode, from where the search goes on."""

    loop: Loop
    W: Matrix | None
    d: Doubles
    disturbance: Fraction
    known: dict[str, Array]

    def claims(self, room: float) -> Iterator[ArcWise]:
        """Those that are found whose level is ``room`` beside what observers take.  Raises:
        UndefinedError or WorkLimitError."""
        free = self._with(room, None, math.inf)
        if free is None or not self.loop.groups:
            yield from () if free is None else (free,)
            return
        for split in SPLITS:
            rate = rounded_down(free.rate * Fraction(split.rate), digits=4)
            pair = None
            if self.W is not None:
                pair = scaled_pair(self.loop, self.W, rate=rate, disturbance=self.disturbance)
            if pair is None:
                continue
            # The smallest multiple of the pair that takes no more than its part.
            cost = self.d.array.max() * np.linalg.eigvalsh(pair.S)[-1]
            kappa = max(float(cost), TINY) / (split.observer * 2 * float(free.rate))
            pair = _scaled(pair, kappa)
            claim = self._with(room + pair.disturbance * IN_HAND, pair, float(rate))
            if claim is not None:
                yield claim

    def _with(self, level: float, pair: ScaledPair | None, most: float) -> ArcWise | None:
        """One with this level and pair, and a rate of at most ``most``."""
        loop = self.loop
        none = {
            mode: Doubles(np.zeros(len(shared_arcs(loop, x)))) for mode, x in loop.modes.items()
        }
        bare = ArcWise(
            P_e=form_of(loop, self.d),
            d=self.d,
            a=none,
            b=none,
            level=Fraction(float_above(Fraction(level))),
            rate=ZERO,
            P=None if pair is None else pair.P,
            Q=None if pair is None else multiply(pair.P, pair.W),
        )
        rho = math.sqrt(level)
        shares = {}
        for mode in loop.modes:
            net = network_of(loop, mode, self.d.array, rho, self._pull(bare, mode, pair))
            shares[mode] = shared_out(net, self.known.get(mode))
            if not shares[mode].least > LEAST * np.abs(net.pull).max():
                return None
            self.known[mode] = shares[mode].y
        least = min(each.least for each in shares.values())
        rate = rounded_down(Fraction(min((1 - 2 * SPARE) * least / 2, most)), digits=6)
        numbers = {mode: self._numbers(mode, each, SPARE * least) for mode, each in shares.items()}
        return replace(
            bare,
            a={mode: a for mode, (a, _) in numbers.items()},
            b={mode: b for mode, (_, b) in numbers.items()},
            rate=rate,
        )

    def _pull(self, bare: ArcWise, mode: str, pair: ScaledPair | None) -> Array:
        """What pulls every node, over d, less what its observer costs."""
        loop = self.loop
        least = loop.pulls.each(lambda K: np.linalg.eigvalsh(to_float(add(K, transpose(K))))[0])
        found = np.array([least.get(i, 0.0) for i in range(loop.n)])
        taken = np.array([float(x) for x in taken_of(loop, bare, mode)])
        if pair is not None:
            m = loop.m
            blocks = [pair.S[k : k + m, k : k + m] for k in range(0, len(pair.S), m)]
            costs = np.array([*(float(np.linalg.eigvalsh(block)[-1]) for block in blocks), 0.0])
            taken += self.d.array**2 * costs[group_numbers(loop.groups, loop.labels)]
        return found - taken / self.d.array

    def _numbers(self, mode: str, shared: Shared, spare: float) -> tuple[Doubles, Doubles]:
        """a and b of every arc, with what is spare shared among those of a node; rounded up."""
        loop = self.loop
        arcs = loop.modes[mode]
        free = shared_arcs(loop, arcs)
        found = []
        i, j = arcs.listeners[free], arcs.speakers[free]
        often = np.bincount(np.concatenate([i, j]), minlength=loop.n)
        for node, heights in ((i, shared.own), (j, shared.other)):
            exact = self.d.array[node] * (heights + spare / np.maximum(often[node], 1))
            largest = np.abs(exact).max(initial=2.0**-60)
            unit = 2.0 ** (math.ceil(math.log2(largest)) - BITS)
            found.append(Doubles(np.ceil(exact / unit) * unit))
        return found[0], found[1]


def _scaled(pair: ScaledPair, kappa: float) -> ScaledPair:
    """The same pair times kappa."""
    exact = rounded_down(kappa, digits=4)
    return replace(
        pair,
        P=scale(exact, pair.P),
        S=pair.S / float(exact),
        disturbance=pair.disturbance * float(exact),
    )
