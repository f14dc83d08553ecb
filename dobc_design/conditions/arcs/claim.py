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
from functools import partial

import numpy as np

from dobc_design._checks import noun
from dobc_design.conditions.check import read_parts
from dobc_design.conditions.numbers import (
    positive_from_json,
    vector_from_json,
    vector_to_json,
)
from dobc_design.conditions.quadratic.claim import Quadratic, observed_in, observer_of
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.reading import Document
from dobc_design.exact.symmetric import SparseSymmetric, least
from dobc_design.loop.loop import Loop
from dobc_design.problem.network import Arcs, IndexArray

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

    def to_json(self) -> Document:
        values: Document = {"d": vector_to_json(tuple(self.d))}
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


def claim_from_json(data: object, loop: Loop, W: Matrix | None) -> ArcWise:
    """Read it back.  Raises: KeyError, TypeError or ValueError for what is no such claim."""
    shares = {}
    for mode, arcs in loop.modes.items():
        shares[mode] = partial(vector_from_json, size=len(shared_arcs(loop, arcs)))
    shape: Document = {
        "d": partial(vector_from_json, size=loop.n),
        "a": shares,
        "b": shares,
        "level": positive_from_json,
        "rate": positive_from_json,
    }
    values = observer_of(read_parts(data, shape | observed_in(loop)), loop, W)
    d = values["d"]
    if least(d) <= 0:
        raise ValueError("d must be > 0")
    return ArcWise(P_e=form_of(loop, d), **values)
