"""A gain W for the observer (13): designed for a decay rate by a small SDP, rounded, and tested exactly.

Without a rate, half the decay rate of the Kalman gain with unit weights is asked for.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from scipy import linalg

from dobc_design.conditions.consensus.claim import reduced
from dobc_design.conditions.observer.ackermann import placed_gains
from dobc_design.conditions.observer.scaling import Scaled, decimal_exponent, natural_units, scaled_exosystem
from dobc_design.exact.matrix import Matrix, add, identity, multiply, scale, subtract, to_float
from dobc_design.exact.observability import decide_detectable
from dobc_design.exact.polynomial import decide_hurwitz
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.groups import join
from dobc_design.problem.problem import Problem
from dobc_design.solvers.conic import SECOND, TIME_LIMIT, climb
from dobc_design.solvers.program import GIVEN_UP, Array, Program, Solution
from dobc_design.solvers.rounding import round_matrix
from dobc_design.verdict import Verdict

DIGITS = (3, 4, 6, 9, 15)
SLACK = (Fraction(21, 20), Fraction(1001, 1000))  # how much more than the rate is asked of a proposal


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


def design_gain(exosystem: Exosystem, *, rate: Fraction | None = None, time_limit: float = TIME_LIMIT) -> GainDesign:
    """Design W so that A - WC decays at least at ``rate`` (1/s).

    ``time_limit`` in s, for one call of a solver; the ladder ends with a gain that needs no solver.
    Shapes: A (q, q), C (m, q), W (q, m).  Source: Theorem 1 with the rate added; W = P^-1 Q.
    """
    if decide_detectable(exosystem.A, exosystem.C).verdict is not Verdict.PROVED:
        return GainDesign(W=None, rate=None, note="no W exists: (A, C) is not detectable.")
    prefix, asked = "", "as asked"
    if rate is not None and not _reachable(exosystem, rate):
        prefix = (
            f"the rate asked, {_short(rate)} 1/s, cannot be reached: a part of the exosystem that C does not see"
            " decays no faster. "
        )
    kalman = None if rate is not None and not prefix else _kalman(exosystem)
    wanted = rate
    if wanted is None or prefix:
        wanted = _default_rate(exosystem, kalman)
        asked = "half that of the Kalman gain with unit weights" if wanted else "the least that can be asked"
    status = ""
    for W, how, status in _candidates(exosystem, wanted, kalman, time_limit=time_limit):
        if _decays(exosystem, W, wanted):
            note = f"{prefix}W was designed ({how}) for the decay rate {_short(wanted)} 1/s, {asked}."
            return GainDesign(W=W, rate=wanted, note=note, status=status)
    cure = "ask for a lower observer.rate, or give one as observer.W." if wanted else "give one as observer.W."
    return GainDesign(
        W=None,
        rate=wanted,
        status=status,
        note=f"{prefix}no W was found for the decay rate {_short(wanted)} 1/s, neither by the small SDP (Clarabel, then"
        f" {SECOND}) nor as a Kalman gain nor by exact pole placement; {cure}",
    )


def _candidates(
    exosystem: Exosystem, rate: Fraction, kalman: Array | None, *, time_limit: float
) -> Iterator[tuple[Matrix, str, str]]:
    """Proposals W for a rate, each in several roundings: gain matrix, how it came about, the solver's status."""
    time, output = natural_units(exosystem, rate=rate)
    # Large C alone would ask for a far faster observer than the rate does, hence max(1, output).
    units = scaled_exosystem(exosystem, time=time, output=output)
    programs = (
        (_program(each, rate / each.time * slack), each.gain)
        for each in (*_in_own_time(exosystem, max(Fraction(1), output)), units)
        for slack in SLACK
    )
    for answer, unit, how in climb(programs, time_limit=time_limit):
        for W in _roundings(_gain_of(answer)):
            yield scale(unit, W), f"small SDP {how}".rstrip(), answer.status
    for W in _roundings(kalman):
        yield W, "Kalman gain", ""
    for slack in SLACK:
        for W in _roundings(_kalman(units.exosystem, shift=float(rate / units.time * slack))):
            yield scale(units.gain, W), "Kalman gain of A + rate I", ""
    for W in placed_gains(exosystem, rate=rate):
        yield W, "exact pole placement", ""


def _program(units: Scaled, rate: Fraction) -> Program:
    # The bound makes room for the rate: what stays of Lambda + 2 rate I is -I, whatever the rate.
    return Program(pencils=(reduced(-1 - 2 * rate, units.exosystem, rate=rate),), floor=Fraction(1))


def _in_own_time(exosystem: Exosystem, output: Fraction) -> Iterator[Scaled]:
    try:
        yield scaled_exosystem(exosystem, time=Fraction(1), output=output)
    except OverflowError:  # A is beyond the floats
        return


def _gain_of(answer: Solution) -> Array | None:
    """P^-1 Q, or None."""
    if not answer.found:
        return None
    try:
        gain = np.asarray(np.linalg.solve(answer.values["P"], answer.values["Q"]), dtype=np.float64)
    except GIVEN_UP:
        return None
    return gain if np.all(np.isfinite(gain)) else None


def _roundings(gain: Array | None) -> Iterator[Matrix]:
    if gain is not None:
        for digits in DIGITS:
            yield round_matrix(gain, digits)


def _kalman(exosystem: Exosystem, *, shift: float = 0.0) -> Array | None:
    """The Kalman gain of (A + shift I, C) with unit weights; A - WC then decays faster than ``shift``."""
    try:
        A, C = to_float(exosystem.A) + shift * np.eye(exosystem.order), to_float(exosystem.C)
        with np.errstate(all="ignore"):
            covariance = linalg.solve_continuous_are(A.T, C.T, np.eye(len(A)), np.eye(len(C)))
            gain = np.asarray(covariance @ C.T, dtype=np.float64)
    except GIVEN_UP:
        return None
    return gain if np.all(np.isfinite(gain)) else None


def _default_rate(exosystem: Exosystem, kalman: Array | None) -> Fraction:
    """Half the Kalman gain's decay rate, to three digits; 0 if that fails (any W that decays will do)."""
    if kalman is None:
        return Fraction(0)
    try:
        decay = float(-np.max(np.linalg.eigvals(to_float(exosystem.A) - kalman @ to_float(exosystem.C)).real))
    except GIVEN_UP:
        return Fraction(0)
    return Fraction(f"{decay / 2:.3g}") if 0 < decay < np.inf else Fraction(0)


def _short(rate: Fraction) -> str:
    """A rate for a sentence; beyond the floats as a power of ten."""
    if not rate:
        return "0"
    exponent = decimal_exponent(rate)
    return f"{float(rate):.4g}" if abs(exponent) < 300 else f"about 1e{exponent}"


def _reachable(exosystem: Exosystem, rate: Fraction) -> bool:
    shifted = add(exosystem.A, scale(rate, identity(exosystem.order)))
    return decide_detectable(shifted, exosystem.C).verdict is Verdict.PROVED


def _decays(exosystem: Exosystem, W: Matrix, rate: Fraction) -> bool:
    error = subtract(exosystem.A, multiply(W, exosystem.C))
    return decide_hurwitz(add(error, scale(rate, identity(len(error))))).verdict is Verdict.PROVED


def design_gains(problem: Problem) -> tuple[GainDesign | None, ...]:
    """A designed gain for every group of agents; None where W is given."""
    return tuple(
        None if group.observer.W is not None else design_gain(group.exosystem, rate=group.observer.rate)
        for group in problem.groups
    )


def chosen_gains(problem: Problem, designs: Sequence[GainDesign | None]) -> tuple[Matrix | None, ...]:
    """The W of every group of agents, given or designed; None where there is none."""
    given = zip(problem.groups, designs, strict=True)
    return tuple(group.observer.W if design is None else design.W for group, design in given)


def observer_gain(problem: Problem) -> Matrix | None:
    """The W that ``certify`` uses: the one given, else the designed one; None without either."""
    return join(chosen_gains(problem, design_gains(problem)))
