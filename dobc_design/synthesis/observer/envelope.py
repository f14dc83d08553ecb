"""Lyapunov matrices for a given W with little stretch: I <= P <= k^2 I and F'P + P F + 2 rate P <= 0.

With F = A - W C they prove |eps(t)| <= k exp(-rate t) |eps(0)|.  Proposals, rounded; ``verify`` decides.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction

import numpy as np
from scipy import linalg

from dobc_design.conditions.observer.propose import transient_peak
from dobc_design.errors import SpecError
from dobc_design.exact.matrix import Matrix, multiply, subtract, to_float
from dobc_design.exact.pencil import Unknown
from dobc_design.problem.exosystem import Exosystem
from dobc_design.solvers.direct import solve_directly
from dobc_design.solvers.program import Array, Program
from dobc_design.solvers.rounding import round_matrix
from dobc_design.synthesis.observer.lmi import pencil

PARTS = (1.0, 0.9, 0.5)  # of the rate asked, where the border cannot be reached with one P
DIGITS = (4, 6, 9, 14)
BISECTIONS = 12
MARGIN = 1e-6  # more decay than asked, relative to the largest entry of F, for the solver's tolerance and rounding
LARGEST = 1e8  # squared stretch that is still looked for


def propose_envelopes(
    exosystem: Exosystem, W: Matrix, *, rate: Fraction | None, peak: Fraction | None
) -> Iterator[tuple[Matrix, Fraction, Fraction, Fraction]]:
    """(P, rate, lower, upper) with lower I <= P <= upper I, to be tried in turn.

    ``rate`` (1/s): the one asked, else half the decay rate of A - WC.  Smaller ones follow, and 0 if a ``peak`` is
    asked: the slower the decay that P proves, the smaller its stretch.
    """
    try:
        F = to_float(subtract(exosystem.A, multiply(W, exosystem.C)))
    except SpecError:
        return
    decay = float(-np.max(np.linalg.eigvals(F).real))
    if not decay > 0:
        return
    if peak is not None and transient_peak(F) > peak:
        return  # the error itself goes beyond it, and the stretch of every P is larger still
    wanted = float(rate) if rate is not None and float(rate) < decay * 1.001 else decay / 2
    rates = [wanted * part for part in PARTS if wanted * part <= decay * (1 - 1e-9)]
    for each in [*rates, *([0.0] if peak is not None else [])]:
        exact = rate if rate is not None and each == float(rate) else Fraction(f"{each:.6g}")
        for P in (_least_stretch(F, float(exact), peak=peak), _by_equation(F, float(exact))):
            if P is None:
                continue
            for digits in DIGITS:
                rounded = round_matrix(P, digits)
                values = np.linalg.eigvalsh(to_float(rounded))
                lower, upper = float(values[0]) * (1 - 1e-9), float(values[-1]) * (1 + 1e-9)
                if lower > 0:
                    yield rounded, exact, Fraction(f"{lower:.12g}"), Fraction(f"{upper:.12g}")


def _by_equation(F: Array, rate: float) -> Array | None:
    """P with (F + rate I)'P + P (F + rate I) = -I, which exists for every rate below the decay of F."""
    try:
        P = linalg.solve_continuous_lyapunov((F + rate * np.eye(len(F))).T, -np.eye(len(F)))
    except linalg.LinAlgError:
        return None
    P = (P + P.T) / 2
    return np.asarray(P, dtype=np.float64) if np.all(np.isfinite(P)) else None


def _least_stretch(F: Array, rate: float, *, peak: Fraction | None) -> Array | None:
    """P >= I with the least largest eigenvalue, by bisection over small programs; with a peak, one that keeps it."""
    q = len(F)
    unknown = (Unknown(name="P", rows=q, columns=q, symmetric=True),)
    time = max(float(np.max(np.abs(F))), 1e-300)
    scaled = F / time

    def solve(ceiling: float) -> Array | None:
        blocks = (
            lambda P: P @ scaled + scaled.T @ P + (2 * rate / time + MARGIN) * P,
            lambda P: P - ceiling * np.eye(q),
        )
        program = Program(pencils=tuple(pencil(block, unknown) for block in blocks), floor=Fraction(1))
        answer = solve_directly(program)
        return answer.values["P"] if answer.found else None

    if peak is not None:
        return solve(float(peak) ** 2 * (1 - 1e-6))
    ceiling, best = 1.0 + 1e-6, None
    while best is None and ceiling < LARGEST:
        best = solve(ceiling)
        if best is None:
            ceiling *= 4
    if best is None:
        return None
    low, high = max(1.0, ceiling / 4), ceiling
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        found = solve(middle)
        if found is None:
            low = middle
        else:
            high, best = middle, found
    return best
