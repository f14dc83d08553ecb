"""What agents feel of each other, and what f has beside its slopes, as CasADi expressions."""

from collections.abc import Sequence
from itertools import product
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
import scipy.sparse as sp

from dobc_design.exact.matrix import Array, to_float
from dobc_design.loop.arrays import (
    ArcGroup,
    ArcGroups,
    difference_matrix,
    error_arcs,
    gathering_matrix,
)
from dobc_design.loop.loop import Loop

from .algebras import CasadiAlgebra

Named = dict[str, Any]  # symbols and expressions, by the names that users see


class Felt(NamedTuple):
    """h and dh/de as casadi.Functions of e; arcs of one coupling are one vector operation."""

    h: Any
    jacobian: Any


def felt_errors(loop: Loop, mode: str) -> Felt:
    """h of the error system, which holds all that is curved: what f has beside its slopes, too."""
    size = loop.size
    e = ca.SX.sym("e", size)
    h = ca.SX(size, 1)
    jacobian = ca.SX(size, size)
    if loop.drift_place is not None:
        h += bent(loop, e)
        jacobian += ca.jacobian(h, e)
    return _with_arcs(e, h, jacobian, error_arcs(loop, mode), np.eye(loop.m))


def felt_inputs(groups: ArcGroups, *, n: int, p: int, seen: Array) -> Felt:
    """h of (9), (n p,): what couplings, which act on ``seen`` e_j - e_i, (r, m), add to the inputs
    of agents with m states."""
    size = n * seen.shape[1]
    e = ca.SX.sym("e", size)
    h = ca.SX(n * p, 1)
    return _with_arcs(e, h, ca.SX(n * p, size), groups, seen)


def _with_arcs(e: Any, h: Any, jacobian: Any, groups: ArcGroups, seen: Array) -> Felt:
    """The functions of what agents feel by themselves, h and its slopes, and along these arcs."""
    n = e.size1() // seen.shape[1]
    p = h.size1() // n
    for group in groups:
        # A row of a difference takes what is seen of e_j - e_i for an arc (i, j) ...
        along = difference_matrix(group, n)
        differences = [constant(sp.kron(along, row)) for row in np.split(seen, len(seen))]
        # ... and a gathering adds up what every agent feels there, with the weights of its arcs.
        onto = gathering_matrix(group, n)
        gathering = [constant(sp.kron(onto, column)) for column in np.split(np.eye(p), p, axis=1)]
        found = _on_arcs(group, [difference @ e for difference in differences])
        for c, gathered in enumerate(gathering):
            h += gathered @ found.values[c]
            for d, difference in enumerate(differences):
                slope = found.slopes.get((c, d))
                if slope is not None:
                    jacobian += gathered @ ca.diag(slope) @ difference
    sparse = ca.Function("jacobian", [e], [jacobian], ["e"], ["dh_de"])
    return Felt(function("h", {"e": e}, {"h": h}), sparse)


def bent(loop: Loop, e: Any) -> Any:
    """f(goal + e) - f(goal) less its slopes at e = 0, of every agent whose [dynamics] are
    nonlinear; else 0."""
    result = ca.SX(loop.size, 1)
    place = loop.drift_place
    if place is None:
        return result
    parts = [e[c :: loop.m] for c in range(loop.m)]
    values = loop.functions[place].evaluated(parts, CasadiAlgebra())
    slopes = to_float(loop.slopes)
    for c, value in enumerate(values):
        terms = zip(slopes[c], parts, strict=True)
        linear = sum(slope * part for slope, part in terms)
        result[c :: loop.m] = value - linear
    return result


class _OnArcs(NamedTuple):
    """Components of h, and dh_c/dy_d by (c, d) where it is not 0, on every arc."""

    values: list[Any]
    slopes: dict[tuple[int, int], Any]


def _on_arcs(group: ArcGroup, y: Sequence[Any]) -> _OnArcs:
    """h and its slopes at the arguments of the arcs; y[c] has one row per arc."""
    count, m = len(group.weights), len(y)
    p = group.coupling.outputs
    variables = [ca.SX.sym(f"y{c + 1}", count) for c in range(m)]
    components = group.coupling.evaluated(variables, CasadiAlgebra())
    # A component may be a constant, which has to be one for every arc.
    zeros = ca.SX.zeros(count, 1)
    values = [zeros + value for value in components]
    if group.coupling.by_component:
        pairs = [(c, c) for c in range(p)]
    else:
        pairs = list(product(range(p), range(m)))
    # Each arc's value depends on that arc's y alone, so J times a vector of ones is the diagonal of
    # J.
    ones = ca.DM.ones(count, 1)
    slopes = [ca.jtimes(values[c], variables[d], ones) for c, d in pairs]
    on_arcs = ca.Function("arcs", variables, [*values, *slopes])
    found = on_arcs(*y)
    by_pair = dict(zip(pairs, found[p:], strict=True))
    return _OnArcs(values=found[:p], slopes=by_pair)


def constant(matrix: sp.sparray) -> Any:
    """A SciPy sparse array as a casadi.DM without stored zeros."""
    return ca.sparsify(ca.DM(sp.csc_matrix(matrix)))


def function(name: str, inputs: Named, outputs: Named) -> Any:
    """A casadi.Function with named inputs and outputs."""
    # Users see full arrays; only the Jacobian stays sparse.
    dense = [ca.densify(each) for each in outputs.values()]
    return ca.Function(name, list(inputs.values()), dense, list(inputs), list(outputs))
