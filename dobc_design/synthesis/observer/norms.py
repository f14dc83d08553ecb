"""H2 and H-infinity norms of the observer's transfer functions, decided over the rationals.

With F = A - W C:  measurement noise nu on x to dhat, C s (sI - F)^-1 W = C W + C F (sI - F)^-1 W;  an unmodelled d to
dhat, C (sI - F)^-1 W;  an input of the exosystem to the error C eps, C (sI - F)^-1.

H2: its square is rational, C X C' with F X + X F' + B B' = 0. H-infinity: for F Hurwitz the norm is below gamma iff
gamma^2 I - D'D > 0 and the Hamiltonian matrix has no eigenvalue on the imaginary axis; its characteristic polynomial
is even, so that is a Sturm count in s^2. (Boyd, Balakrishnan, Kabamba 1989.)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction

from dobc_design.conditions.statement import Statement, decided
from dobc_design.errors import SpecError
from dobc_design.exact.definite import decide_positive_definite
from dobc_design.exact.matrix import (
    Matrix,
    add,
    identity,
    inverse,
    multiply,
    scale,
    solve_lyapunov,
    subtract,
    transpose,
    zeros,
)
from dobc_design.exact.number import float_above, number_text
from dobc_design.exact.polynomial import characteristic_polynomial, decide_hurwitz, has_root_up_to_zero
from dobc_design.problem.exosystems import Exosystem
from dobc_design.synthesis.observer.request import CHANNELS, NoiseLimit
from dobc_design.synthesis.observer.spectrum import error_matrix
from dobc_design.verdict import Verdict


@dataclass(frozen=True, slots=True, kw_only=True)
class StateSpace:
    """Exact C (sI - F)^-1 B + D: F (q, q), B (q, u), C (y, q), D (y, u)."""

    F: Matrix
    B: Matrix
    C: Matrix
    D: Matrix


def channel(exosystem: Exosystem, W: Matrix, name: str) -> StateSpace:
    """The transfer function of one channel, "measurement", "disturbance" or "exosystem", exactly.

    Raises: SpecError for another name.
    """
    F, C, m = error_matrix(exosystem, W), exosystem.C, exosystem.outputs
    if name == "measurement":
        return StateSpace(F=F, B=W, C=multiply(C, F), D=multiply(C, W))
    if name == "disturbance":
        return StateSpace(F=F, B=W, C=C, D=zeros(m, m))
    if name == "exosystem":
        return StateSpace(F=F, B=identity(exosystem.order), C=C, D=zeros(m, exosystem.order))
    raise SpecError(f"channel must be one of {', '.join(CHANNELS)}; got {name!r}.", key="channel")


def h2_squared(system: StateSpace) -> Fraction | None:
    """The square of the H2 norm, exactly; None if it is infinite (F not Hurwitz or D not 0)."""
    if any(x for row in system.D for x in row) or decide_hurwitz(system.F).verdict is not Verdict.PROVED:
        return None
    X = solve_lyapunov(transpose(system.F), multiply(system.B, transpose(system.B)))
    if X is None:  # cannot be for a Hurwitz F
        return None
    return sum((row[i] for i, row in enumerate(multiply(multiply(system.C, X), transpose(system.C)))), Fraction(0))


def hinf_below(system: StateSpace, gamma: Fraction) -> bool:
    """Whether F is Hurwitz and the H-infinity norm is < gamma: exact both ways."""
    if gamma <= 0 or decide_hurwitz(system.F).verdict is not Verdict.PROVED:
        return False
    F, B, C, D = system.F, system.B, system.C, system.D
    room = subtract(scale(gamma * gamma, identity(len(B[0]))), multiply(transpose(D), D))
    if decide_positive_definite(room).verdict is not Verdict.PROVED:
        return False
    R = inverse(room)
    closed = add(F, multiply(multiply(B, R), multiply(transpose(D), C)))
    inner = add(identity(len(C)), multiply(multiply(D, R), transpose(D)))
    upper = multiply(multiply(B, R), transpose(B))
    lower = scale(-1, multiply(multiply(transpose(C), inner), C))
    hamiltonian = tuple(p + s for p, s in zip(closed, upper, strict=True)) + tuple(
        p + s for p, s in zip(lower, scale(-1, transpose(closed)), strict=True)
    )
    return not has_root_up_to_zero(characteristic_polynomial(hamiltonian)[::2])  # a polynomial in s^2


def root_above(square: Fraction) -> float:
    """A float that is not below the root of a rational >= 0."""
    if not square:
        return 0.0
    root = math.sqrt(float_above(square))
    while math.isfinite(root) and Fraction(root) ** 2 < square:
        root = math.nextafter(root, math.inf)
    return root


def noise_statement(exosystem: Exosystem, W: Matrix, limit: NoiseLimit) -> Statement:
    """State whether a norm keeps its limit (H-infinity: stays below it)."""
    system = channel(exosystem, W, limit.channel)
    exact: dict[str, str] = {}
    if limit.norm == "h2":
        square = h2_squared(system)
        holds = square is not None and square <= limit.bound**2
        exact["h2_squared"] = "infinite" if square is None else number_text(square)
    else:
        holds = hinf_below(system, limit.bound)
    return Statement(
        kind="noise",
        verdict=decided(holds),
        text=f"{limit}." if holds else f"it is false that the {limit}.",
        exact=exact,
    )
