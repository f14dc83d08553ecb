"""Decides arc-wise dissipation, ``claim``: agents exactly, arcs by ``directions``.

"Refuted" is never the outcome: only this way to share V' out has failed.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from fractions import Fraction

import numpy as np

from dobc_design._checks import noun
from dobc_design.conditions.consensus.claim import Pair as ObserverPair
from dobc_design.conditions.consensus.decide import schur_block
from dobc_design.conditions.quadratic.decide import border_of
from dobc_design.conditions.separable.large import floats_around, gain_table
from dobc_design.exact.definite import decide_positive_definite, decide_positive_semidefinite
from dobc_design.exact.interval import UndefinedError
from dobc_design.exact.matrix import Matrix, add, identity, scale, subtract, transpose
from dobc_design.exact.number import root_above
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.loop.arcs import coupling_places
from dobc_design.loop.loop import Loop
from dobc_design.problem.groups import agent_blocks

from .claim import ArcWise
from .directions import Terms, open_arcs

ZERO = Fraction(0)
CELLS = 1024  # of a table of gains


def why_not(loop: Loop, claim: ArcWise) -> str | None:
    """None if the claim is proved for every switching, else what is not shown.  Raises:
    WorkLimitError."""
    S = None
    if claim.P is not None:
        S = border_of(loop, claim, claim.rate)
        own = decide_positive_definite(SparseSymmetric.from_dense(claim.P))
        if S is None or not own.is_proved:
            return "P > 0 and Omega0 + 2 rate P < 0 do not hold for this pair (P, Q)."
    for mode in loop.modes:
        for node in short_nodes(loop, claim, mode, S):
            return f"in mode {mode} the slack of {loop.labels[node]} is negative."
    for mode, listener, speaker in open_terms(loop, claim):
        names = loop.labels[listener], (*loop.labels, *loop.fixed)[speaker]
        return f"in mode {mode} the term of the arc by which {names[0]} hears {names[1]} may be negative."
    return None


def slacks(loop: Loop, claim: ArcWise, mode: str) -> list[Fraction]:
    """What arcs take of every agent: the sum of its a and b, and 2 rate d."""
    taken = [2 * claim.rate * d for d in claim.d]
    arcs = loop.modes[mode]
    for i, j, (a, b) in zip(
        arcs.listeners.tolist(), arcs.speakers.tolist(), claim.shares[mode], strict=True
    ):
        taken[i] += a
        if j < loop.n:
            taken[j] += b
    return taken


def short_nodes(loop: Loop, claim: ArcWise, mode: str, S: Matrix | None) -> Iterator[int]:
    """The agents whose gain does not pay for what arcs, the rate and the observer take."""
    blocks: Sequence[Matrix] = ()
    if S is not None:
        blocks = agent_blocks(S, loop.groups, loop.labels)
    m = loop.m
    for node, taken in enumerate(slacks(loop, claim, mode)):
        d = claim.d[node]
        left = scale(-taken, identity(m))
        gain = loop.pulls.gains.get(node)
        if gain is not None:
            left = add(left, scale(d, add(gain, transpose(gain))))
        if blocks:
            left = subtract(left, scale(d * d, blocks[node]))
        holds = left[0][0] >= 0 if m == 1 else decide_positive_semidefinite(left).is_proved
        if not holds:
            yield node


def open_terms(loop: Loop, claim: ArcWise) -> Iterator[tuple[str, int, int]]:
    """The arcs (mode, listener, speaker) whose term is not shown to be nonnegative."""
    d = (*claim.d, *[Fraction(1)] * len(loop.fixed))
    alike = defaultdict(dict)
    for mode, arcs in loop.modes.items():
        places = coupling_places(loop, arcs).tolist()
        listeners, speakers = arcs.listeners.tolist(), arcs.speakers.tolist()
        sure = len(arcs) - arcs.optional
        for k, (i, j, w) in enumerate(zip(listeners, speakers, arcs.weights, strict=True)):
            a, b = claim.shares[mode][k]
            # Without the arc there is nothing but the shares; a fixed node has no share.
            if (k >= sure and min(a, b) < 0) or (j >= loop.n and b):
                yield mode, i, j
            key = a, b, 2 * d[i] * w, d[i], d[j], j >= loop.n
            alike[places[k]].setdefault(key, (mode, i, j))
    for place, terms in alike.items():
        yield from _open_of_one(loop, claim, place, terms)


def _open_of_one(loop, claim, place, terms):
    keys = list(terms)
    a, b, pull, own, other, fixed = zip(*keys, strict=True)
    coupling = loop.functions[place]
    # |y - x| at most: both at their largest, or x alone
    far = max(1 / x + (0 if still else 1 / y) for x, y, still in zip(own, other, fixed, strict=True))
    rho = root_above(claim.level, unit=10**9)
    reach = rho * root_above(far, unit=10**9)
    found = set()
    for component in coupling.components:
        try:
            table = gain_table(component, reach, cells=CELLS)
        except UndefinedError:
            found.update(range(len(keys)))
            break
        made = Terms(
            a=floats_around(a)[0],
            b=floats_around(b)[0],
            pull=floats_around(pull),
            own=floats_around(own)[0],
            other=floats_around(other)[0],
            fixed=np.array(fixed),
        )
        found.update(open_arcs(made, table, rho).tolist())
    return (terms[keys[k]] for k in sorted(found))
