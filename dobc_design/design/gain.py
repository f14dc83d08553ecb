"""A gain W for the observer (13): designed for a decay rate by a small SDP, rounded, and tested exactly.

Without a rate, half the decay rate of the Kalman gain with unit weights is asked for.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from scipy import linalg, signal

from dobc_design.design.direct import solve_directly
from dobc_design.design.program import Array, Program
from dobc_design.design.rounding import round_matrix
from dobc_design.exact.matrix import Matrix, add, identity, multiply, scale, subtract, to_float
from dobc_design.exact.observability import decide_detectable
from dobc_design.exact.polynomial import decide_hurwitz
from dobc_design.spec.exosystem import Exosystem
from dobc_design.theorems.conditions import reduced
from dobc_design.verdict import Verdict

DIGITS = (3, 4, 6, 9, 15)


@dataclass(frozen=True, slots=True, kw_only=True)
class GainDesign:
    """A designed W (q, m), or None with the reason.

    ``rate`` (1/s) is the decay that was asked for and that A - WC has, proved by Routh's test;
    ``note`` says in a sentence how it came about; ``status`` is the solver's, for the record only.
    """

    W: Matrix | None
    rate: Fraction | None
    note: str
    status: str = ""


def design_gain(exosystem: Exosystem, *, rate: Fraction | None = None) -> GainDesign:
    """Design W so that A - WC decays at least at ``rate`` (1/s).

    Shapes: A (q, q), C (m, q), W (q, m).  Source: Theorem 1 with the rate added; W = P^-1 Q.
    """
    if decide_detectable(exosystem.A, exosystem.C).verdict is not Verdict.PROVED:
        return GainDesign(W=None, rate=None, note="no W exists: (A, C) is not detectable.")
    kalman = _kalman(exosystem)
    wanted, prefix = rate, ""
    if rate is not None and not _reachable(exosystem, rate):
        prefix = f"the rate asked, {float(rate):.4g} 1/s, cannot be reached: a part of the exosystem that C does not see decays more slowly. "
        wanted = None
    if wanted is None:
        wanted = _default_rate(exosystem, kalman)
    status = ""
    for W, how, status in _candidates(exosystem, wanted, kalman):
        if _decays(exosystem, W, wanted):
            asked = "as asked" if rate is not None and not prefix else "half that of the Kalman gain with unit weights"
            note = f"{prefix}W was designed ({how}) for the decay rate {float(wanted):.4g} 1/s, {asked}."
            return GainDesign(W=W, rate=wanted, note=note, status=status)
    return GainDesign(
        W=None, rate=wanted, status=status,
        note=f"{prefix}no W was found for the decay rate {float(wanted):.4g} 1/s; ask for a lower observer.rate.",
    )  # fmt: skip


def _candidates(exosystem: Exosystem, rate: Fraction, kalman: Array | None) -> Iterator[tuple[Matrix, str, str]]:
    for slack in (Fraction(21, 20), Fraction(1001, 1000)):
        pencil = reduced(Fraction(-1), exosystem, rate=rate * slack)
        answer = solve_directly(Program(pencils=(pencil,), floor=Fraction(1)))
        if answer.found:
            try:
                gain = np.linalg.solve(answer.values["P"], answer.values["Q"])
            except np.linalg.LinAlgError:
                continue
            for digits in DIGITS:
                yield round_matrix(gain, digits), "small SDP", answer.status
    if kalman is not None:
        for digits in DIGITS:
            yield round_matrix(kalman, digits), "Kalman gain", ""
    for gain in _placed(exosystem, float(rate)):
        for digits in DIGITS:
            yield round_matrix(gain, digits), "pole placement", ""


def _kalman(exosystem: Exosystem) -> Array | None:
    A, C = to_float(exosystem.A), to_float(exosystem.C)
    try:
        covariance = linalg.solve_continuous_are(A.T, C.T, np.eye(len(A)), np.eye(len(C)))
    except (linalg.LinAlgError, ValueError):
        return None
    return np.asarray(covariance @ C.T, dtype=float)


def _placed(exosystem: Exosystem, rate: float) -> Iterator[Array]:
    A, C = to_float(exosystem.A), to_float(exosystem.C)
    try:
        answer = signal.place_poles(A.T, C.T, [-rate * (1.2 + 0.2 * k) for k in range(len(A))])
    except (ValueError, linalg.LinAlgError):
        return
    yield np.asarray(answer.gain_matrix, dtype=float).T


def _default_rate(exosystem: Exosystem, kalman: Array | None) -> Fraction:
    """Half the Kalman gain's decay rate, to three digits; 0 if that fails (any W that decays will do)."""
    if kalman is None:
        return Fraction(0)
    error = to_float(exosystem.A) - kalman @ to_float(exosystem.C)
    decay = float(-np.max(np.linalg.eigvals(error).real))
    return Fraction(f"{decay / 2:.3g}") if decay > 0 and np.isfinite(decay) else Fraction(0)


def _reachable(exosystem: Exosystem, rate: Fraction) -> bool:
    shifted = add(exosystem.A, scale(rate, identity(exosystem.order)))
    return decide_detectable(shifted, exosystem.C).verdict is Verdict.PROVED


def _decays(exosystem: Exosystem, W: Matrix, rate: Fraction) -> bool:
    error = subtract(exosystem.A, multiply(W, exosystem.C))
    return decide_hurwitz(add(error, scale(rate, identity(len(error))))).verdict is Verdict.PROVED
