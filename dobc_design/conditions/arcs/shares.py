"""How an arc-wise claim shares V' out, in floats: to be shown, nothing rests on it."""

import math

import numpy as np

from dobc_design._checks import noun
from dobc_design.conditions.quadratic.decide import border_of
from dobc_design.exact.matrix import Array, to_float
from dobc_design.loop.loop import Loop
from dobc_design.problem.network import IndexArray

from .claim import ArcWise
from .decide import left_of
from .propose import Z, network_of


@noun(eq=False)
class Shares:
    """One mode, by arc between free nodes: what it takes of the node that listens, ``own``, and of
    the one that is heard, ``other`` (< 0: it gives), and how much of that it leaves wherever these
    two are, ``room``; by node what is ``left``.  All over d, in 1/s."""

    listeners: IndexArray
    speakers: IndexArray
    own: Array
    other: Array
    room: Array
    left: Array


def shares_of(loop: Loop, claim: ArcWise, mode: str) -> Shares:
    """The shares of a proved claim.  Raises: UndefinedError."""
    d = np.array(claim.d, dtype=float)
    S = border_of(loop, claim, claim.rate)
    blocks = left_of(loop, claim, mode, S)
    left = np.array([np.linalg.eigvalsh(to_float(each))[0] for each in blocks]) / d
    net = network_of(loop, mode, d, math.sqrt(claim.level), left)
    own = np.array(claim.a[mode], dtype=float) / d[net.listeners]
    other = np.array(claim.b[mode], dtype=float) / d[net.speakers]
    room = []
    for a, b, weight, kind in zip(own, other, net.weights, net.kind, strict=True):
        # d_i x^2 : d_j y^2 = 1 - Z : Z
        room.append(np.min(a * (1 - Z) + b * Z - weight * net.hulls[kind]))
    return Shares(
        listeners=net.listeners,
        speakers=net.speakers,
        own=own,
        other=other,
        room=np.array(room),
        left=left,
    )
