"""Linear matrix inequalities for (P, Q) with W = P^-1 Q: regions of the spectrum, gain, peak, H2, H-infinity.

With M = P A - Q C = P (A - W C) every condition is affine in (P, Q):

    Re s <= a      M + M' - 2 a P <= 0                      (Chilali and Gahinet 1996, here and below)
    |s - x| <= r   [[-r P, M - x P], [., -r P]] <= 0
    damping z      [[s (M + M'), z (M - M')], [., s (M + M')]] <= 0,   s = root of 1 - z^2
    peak k         I <= P <= k^2 I
    |W| <= g       I <= P, [[g^2 I, Q'], [Q, P]] >= 0
    H-infinity     [[M + M', B, C'], [., -g I, 0], [., ., -g I]] <= 0,  B = Q, or P for an input of the exosystem
    H2             M + M' + C'C <= 0 and [[g^2/m I, Q'], [Q, P]] >= 0, or tr P <= g^2

One P for all of them makes it sufficient, not necessary.  Noise on the measured x is not among them: its output matrix
C (A - W C) is not affine.  A proposal, as everything here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from fractions import Fraction

import numpy as np

from dobc_design.exact.pencil import Pencil, Unknown
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.solvers.conic import solve_directly
from dobc_design.solvers.program import Array, Program, Solution, without_values
from dobc_design.synthesis.observer.request import NoiseLimit
from dobc_design.synthesis.observer.spectral_regions import Cone, Disk, SpectralRegion

FLOORS = tuple(Fraction(10) ** k / 3**j for k in range(2, -7, -1) for j in (0, 1))
Block = Callable[..., Array]


def solve_lmi(
    A: Array,
    C: Array,
    regions: Sequence[SpectralRegion],
    *,
    time: float = 1.0,
    gain: float | None = None,
    peak: float | None = None,
    noise: Sequence[NoiseLimit] = (),
    slack: float = 1e-6,
) -> Solution:
    """Minimise tr P + |Q|^2 subject to the inequalities.  P and Q are those of (A / time, C): W = time P^-1 Q.

    Shapes: A (q, q) in 1/s, C (m, q).  ``slack`` keeps the answer inside, relative to P.
    """
    q, m = C.shape[1], C.shape[0]
    unknowns = (
        Unknown(name="P", rows=q, columns=q, symmetric=True),
        Unknown(name="Q", rows=q, columns=m, symmetric=False),
    )
    scaled = A / time
    blocks: list[Block] = [_of_region(scaled, C, region, time=time, slack=slack) for region in regions]
    if gain is not None:
        blocks.append(_bordered(m, (gain / time) ** 2))
    if peak is not None:
        blocks.append(lambda P, Q: P - peak**2 * (1 - slack) * np.eye(q))
    for limit in noise:
        blocks += _of_noise(scaled, C, limit, time=time)
    pencils = tuple(pencil(block, unknowns) for block in blocks)
    # A bound on a norm fixes the scale of P; the largest floor of P that has an answer keeps W = P^-1 Q small.
    floors = FLOORS if noise and peak is None and gain is None else (Fraction(1),)
    answer = without_values("not solved", solver="Clarabel")
    for floor in floors:
        answer = solve_directly(Program(pencils=pencils, floor=floor))
        if answer.found:
            break
    return answer


def pencil(block: Block, unknowns: tuple[Unknown, ...]) -> Pencil:
    """The pencil of an affine function of the unknowns' arrays, from its values at 0 and at unit entries."""
    zeros = [np.zeros((u.rows, u.columns)) for u in unknowns]
    constant = block(*zeros)
    coefficients = {}
    for number, unknown in enumerate(unknowns):
        for place in unknown.places():
            arrays = [each.copy() for each in zeros]
            arrays[number][place[1], place[2]] = 1.0
            if unknown.symmetric:
                arrays[number][place[2], place[1]] = 1.0
            coefficients[place] = _sparse(block(*arrays) - constant)
    return Pencil(name="observer", constant=_sparse(constant), unknowns=unknowns, coefficients=coefficients)


def _of_region(A: Array, C: Array, region: SpectralRegion, *, time: float, slack: float) -> Block:
    def block(P: Array, Q: Array) -> Array:
        M = P @ A - Q @ C
        if isinstance(region, Disk):
            x, r = float(region.centre) / time, float(region.radius) / time
            return np.block([[(slack - r) * P, M - x * P], [(M - x * P).T, (slack - r) * P]])
        if isinstance(region, Cone):
            z = float(region.damping)
            s = math.sqrt(1 - z * z)
            symmetric, skew = s * (M + M.T) + slack * P, z * (M - M.T)
            return np.block([[symmetric, skew], [skew.T, symmetric]])
        low, high = (None if x is None else float(x) / time for x in region.real_ends)
        if high is not None:
            return M + M.T + (slack - 2 * high) * P
        return -(M + M.T) + (slack + 2 * float(low or 0)) * P

    return block


def _of_noise(A: Array, C: Array, limit: NoiseLimit, *, time: float) -> list[Block]:
    """With time in units of ``time``, C (sI - F)^-1 of the exosystem channel is ``time`` times as large."""
    m = len(C)
    bound = float(limit.bound)
    if limit.channel == "measurement":
        return []
    if limit.channel == "exosystem":
        bound *= time if limit.norm == "hinf" else math.sqrt(time)
    elif limit.norm == "h2":
        bound /= math.sqrt(time)
    if limit.norm == "hinf":

        def real(P: Array, Q: Array) -> Array:
            M, B = P @ A - Q @ C, (P if limit.channel == "exosystem" else Q)
            u = B.shape[1]
            return np.block(
                [
                    [M + M.T, B, C.T],
                    [B.T, -bound * np.eye(u), np.zeros((u, m))],
                    [C, np.zeros((m, u)), -bound * np.eye(m)],
                ]
            )

        return [real]

    def gramian(P: Array, Q: Array) -> Array:
        M = P @ A - Q @ C
        return M + M.T + C.T @ C

    if limit.channel == "exosystem":
        return [gramian, lambda P, Q: np.array([[np.trace(P) - bound**2]])]
    return [gramian, _bordered(m, bound**2 / m)]


def _bordered(m: int, square: float) -> Block:
    """Minus [[square I, Q'], [Q, P]]."""
    return lambda P, Q: -np.block([[square * np.eye(m), Q.T], [Q, P]])


def _sparse(matrix: Array) -> SparseSymmetric:
    size = len(matrix)
    entries = {(i, j): Fraction(float(matrix[i, j])) for i in range(size) for j in range(i, size) if matrix[i, j]}
    return SparseSymmetric(size, entries)
