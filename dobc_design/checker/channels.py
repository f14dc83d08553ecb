"""How observers pass on a disturbance d of the inputs, a drift g of the exosystem and noise nu. In
every group what is left of them acts on the agents by a signal

    z = C eps + D d + at_once nu,    eps' = F eps + disturbance d + drift g + noise nu.

Where states are measured, z = d - dhat enters by the inputs, and noise moves estimates at once. Of
measured outputs eps = (x - xhat, xi - xihat). Where couplings and pins act on outputs, the same
enters; where they act on estimates, z = y - H xhat enters by W_x, and the rows after it are x -
xhat. Of two agents both residuals count: C twice, and what enters half.
"""

from fractions import Fraction
from typing import NamedTuple

from .claims import Case
from .consensus import closed
from .loop import Loop, Residual
from .matrices import ZERO, Matrix, identity, opposite, product


class Channel(NamedTuple):
    """That of one group; ``acting`` rows act on the agents."""

    F: Matrix
    C: Matrix
    D: Matrix
    disturbance: Matrix
    drift: Matrix
    noise: Matrix
    at_once: Matrix
    acting: int


def is_estimated(loop: Loop) -> bool:
    """Whether errors are those of estimates of measured outputs."""
    return loop.node.H is None and any(each.sensed for each in loop.residuals)


def channel_of(case: Case, residual: Residual) -> Channel:
    """With the W that is claimed."""
    F = closed(residual)
    C = residual.C
    W: Matrix = residual.W or []
    B = case.node.B
    if B is not None:  # what acts, and what is asked, is in the inputs
        C = product(case.node.left, C)
        W = product(W, B)
    if residual.sensed is None:
        noise = product(F, W)
        at_once = product(C, W)
        drift = identity(len(F))
        return Channel(F, C, identity(len(C)), opposite(W), drift, noise, at_once, len(C))
    m = case.m
    sides = Fraction(1 + case.differences)
    q = len(F) - m
    p = len(B[0])
    felt = [*parts(B, sides), *none(q, p)]
    moved = [*none(m, q), *identity(q)]
    if not is_estimated(case):
        return Channel(F, C, identity(p), felt, moved, none(len(F), 0), none(p, 0), p)
    _, H, gain = residual.sensed
    r = len(H)
    seen = parts([*H, *identity(len(F))[:m]], 1 / sides)
    at_once = [*identity(r), *none(m, r)]
    return Channel(F, seen, none(r + m, p), felt, moved, opposite(parts(gain, sides)), at_once, r)


def entries(loop: Loop) -> list[Matrix]:
    """By which matrix the signal enters every node."""
    if not is_estimated(loop):
        return [loop.node.B or identity(loop.m)] * loop.n
    found: list[Matrix] = [[]] * loop.n
    alone = len(loop.residuals) == 1
    for residual in loop.residuals:
        _, _, gain = residual.sensed or ([], [], [])
        # pairs of agents have one observer
        for node in loop.nodes if alone else residual.agents:
            found[node] = gain[: loop.m]
    return found


def none(rows: int, columns: int) -> Matrix:
    """Zeros."""
    return [[ZERO] * columns for _ in range(rows)]


def parts(X: Matrix, of: Fraction) -> Matrix:
    """X / of."""
    return [[x / of for x in row] for row in X]
