"""Arc-wise dissipation in a region: V = sum d_i e_i'e_i + sum eps_i'P eps_i, and how its decrease
is shared out among arcs and agents.

Theory, section 20.  Along an arc i <- j of weight w the derivative of V is 2 d_i w e_i'h(e_j -
e_i).  Two numbers a, b per arc bound it, by component, wherever d_i x^2 + d_j y^2 <= level:

    2 d_i w x h(y - x) <= a x^2 + b y^2

What pulls an agent back has to pay for all a of arcs by which it hears, all b of arcs by which it
is heard, the rate, and the error of its observer:

    d_i (K_i + K_i') - (sum of a + sum of b + 2 rate d_i) I - d_i^2 S >= 0

S = C (-Omega0 - 2 rate P)^-1 C' of the agent's exosystem.  Arcs to fixed nodes, and what an agent
does by itself, are terms of one variable: they count with the end of their gains, and have no
numbers.  No coupling has to rise, and the work grows with the arcs.
"""

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from dobc_design._checks import noun
from dobc_design.conditions.check import read_object
from dobc_design.conditions.numbers import (
    read_rational,
    vector_from_json,
    vector_to_json,
)
from dobc_design.conditions.quadratic.claim import Quadratic, observer_from_json
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.reading import Table
from dobc_design.exact.symmetric import SparseSymmetric, least
from dobc_design.loop.loop import Loop
from dobc_design.problem.network import Arcs, IndexArray

NAMES = ("d", "a", "b", "level", "rate")
Numbers = Sequence[Fraction]


@noun
class ArcWise(Quadratic):
    """A claim: {V <= level} is invariant and V' <= -2 rate V in it, in every mode.

    ``d``: one number > 0 per node, of which P_e consists.  ``a`` and ``b``: mode -> one number per
    arc between free nodes, in the order of the loop, in 1/s times the unit of d.
    """

    level: Fraction
    d: Numbers
    a: Mapping[str, Numbers]
    b: Mapping[str, Numbers]

    def to_json(self) -> dict[str, Any]:
        values: dict[str, Any] = {"d": vector_to_json(tuple(self.d))}
        for name, shares in (("a", self.a), ("b", self.b)):
            values[name] = {mode: vector_to_json(tuple(each)) for mode, each in shares.items()}
        return values | Quadratic.to_json(self)


def form_of(loop: Loop, d: Numbers) -> SparseSymmetric:
    """P_e = diag(d_i I), (n m, n m)."""
    m = loop.m
    return SparseSymmetric(loop.size, {(k, k): d[k // m] for k in range(loop.size)})


def shared_arcs(loop: Loop, arcs: Arcs) -> IndexArray:
    """The places of the arcs between free nodes."""
    return np.flatnonzero(arcs.speakers < loop.n)


def claim_from_json(values: Table, loop: Loop, W: Matrix | None) -> ArcWise:
    """Read it back.  Raises: KeyError, TypeError or ValueError for what is no such claim."""
    counts = {mode: len(shared_arcs(loop, arcs)) for mode, arcs in loop.modes.items()}
    shares = []
    for name in ("a", "b"):
        stated = read_object(values[name], tuple(counts))
        shares.append({mode: vector_from_json(stated[mode], k) for mode, k in counts.items()})
    d = vector_from_json(values["d"], loop.n)
    level, rate = (read_rational(values[name]) for name in ("level", "rate"))
    if least(d) <= 0 or level <= 0 or rate <= 0:
        raise ValueError("d, level and rate must be > 0")
    P, Q = observer_from_json(values, loop, W)
    return ArcWise(
        P_e=form_of(loop, d),
        d=d,
        a=shares[0],
        b=shares[1],
        level=level,
        rate=rate,
        P=P,
        Q=Q,
    )


def names_of(loop: Loop) -> tuple[str, ...]:
    """The keys of ``exact``."""
    return (*NAMES, "P") if loop.groups else NAMES
