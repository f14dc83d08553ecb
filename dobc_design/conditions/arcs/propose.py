"""Proposes the shares of arcs for given d: a linear program whose rows are directions (theory,
section 20).

Each direction of an arc is a row in its two numbers a and b; those that the last answer violates
are added until none is.  Agents share the slack that is left among their arcs, so that what lies
between the directions that were looked at is paid for, too.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import csr_matrix

from dobc_design.conditions.separable.large import Array, gain_table
from dobc_design.loop.arcs import coupling_places, split_by
from dobc_design.loop.loop import Loop, Pair

from .directions import gains_within

DIRECTIONS = 800
FIRST = 24  # directions of each arc, to begin with
ROUNDS = 40
CELLS = 1024
SHARED = 0.02  # of the slack, for what lies between directions
GRID = 2**30  # numbers a and b are multiples of its inverse, times the unit


@dataclass(frozen=True, slots=True, eq=False)
class Needs:
    """Of every arc of a mode and every direction (x, y), a x^2 + b y^2 >= need; x and y are alike
    for all arcs but for d."""

    listeners: Array
    speakers: Array
    xx: Array
    yy: Array
    need: Array


def needs_of(loop: Loop, mode: str, d: Array, rho: float) -> Needs:
    """Raises: exact.interval.UndefinedError where a coupling is not defined so far out."""
    arcs = loop.modes[mode]
    angle = (np.arange(DIRECTIONS) + 0.5) * (np.pi / DIRECTIONS)
    own = d[arcs.listeners][:, None]
    other = np.append(d, np.ones(len(loop.fixed)))[arcs.speakers][:, None]
    free = (arcs.speakers < loop.n)[:, None]
    x = np.where(free, np.cos(angle), 1.0) / np.sqrt(own)
    y = np.where(free, np.sin(angle), 0.0) / np.sqrt(other)
    weights = np.array([float(w) for w in arcs.weights])
    pull = 2 * own * weights[:, None] * (x * x - x * y)
    far = rho * np.abs(y - x)
    need = np.full(far.shape, -np.inf)
    for place, mine in split_by(coupling_places(loop, arcs)):
        for component in set(loop.functions[place].components):
            table = gain_table(component, Fraction(float(far[mine].max())), cells=CELLS)
            least, most = gains_within(table, np.minimum(far[mine], table.radius))
            need[mine] = np.maximum(need[mine], np.maximum(-pull[mine] * least, -pull[mine] * most))
    optional = np.arange(len(arcs)) >= len(arcs) - arcs.optional
    need[optional] = np.maximum(need[optional], 0.0)
    return Needs(arcs.listeners, arcs.speakers, x * x, y * y, need)


def shares_of(needs: Needs, gains: Array, d: Array) -> tuple[Array, Array, float] | None:
    """a and b of every arc with the largest t for which gains_i - (sum of a and b) >= 2 t d_i, and
    t; None where no answer is found.  ``gains``: 2 d_i k_i less what the observer takes."""
    count, n = len(needs.listeners), len(d)
    chosen = np.zeros(needs.need.shape, dtype=bool)
    chosen[:, np.linspace(0, DIRECTIONS - 1, FIRST).astype(int)] = True
    arc = np.arange(count)
    free = needs.speakers < n
    taken = csr_matrix(
        (
            np.concatenate([np.ones(count), np.ones(int(free.sum())), 2 * d]),
            (
                np.concatenate([needs.listeners, needs.speakers[free], np.arange(n)]),
                np.concatenate([arc, count + arc[free], np.full(n, 2 * count)]),
            ),
        ),
        shape=(n, 2 * count + 1),
    )
    goal = np.zeros(2 * count + 1)
    goal[-1] = -1.0
    bounds = [(None, None)] * count + [(None, None) if f else (0, 0) for f in free] + [(None, None)]
    from scipy.sparse import vstack
    for _ in range(ROUNDS):
        places, way = np.nonzero(chosen)
        row = np.arange(len(places))
        rows = csr_matrix(
            (
                np.concatenate([-needs.xx[places, way], -needs.yy[places, way]]),
                (np.concatenate([row, row]), np.concatenate([places, count + places])),
            ),
            shape=(len(row), 2 * count + 1),
        )
        answer = linprog(
            goal,
            A_ub=vstack([rows, taken]),
            b_ub=np.concatenate([-needs.need[places, way], gains]),
            bounds=bounds,
            method="highs",
        )
        if answer.x is None:
            return None
        a, b, t = answer.x[:count], answer.x[count:-1], float(answer.x[-1])
        left = a[:, None] * needs.xx + b[:, None] * needs.yy - needs.need
        missed = left < -1e-9 * (1 + np.abs(needs.need))
        if not missed.any():
            return a, b, t
        # where they are missed most, and wherever that has a local minimum
        before, after = np.roll(left, 1, axis=1), np.roll(left, -1, axis=1)
        chosen |= missed & (left <= before) & (left <= after)
    return None
