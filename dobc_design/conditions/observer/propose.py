"""Observer gains W and pairs (P, Q) worth trying, and norms of the error system that designs are judged by.

Paper: W with A - WC Hurwitz (17), and P, Q = P W for (18).  Small programs and Kalman gains come first, but feasible
problems never depend on a solver: the last rung of the ladder for W is Ackermann's formula over the rationals, that
for P an exact Lyapunov equation, scaled up until the border term is small enough.  Nothing here is a proof.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import comb
from random import Random
from typing import Any

import numpy as np
from scipy import linalg

from dobc_design.conditions.consensus.claim import reduced, with_gain
from dobc_design.exact.matrix import (
    Matrix,
    Vector,
    add,
    identity,
    inverse,
    multiply,
    scale,
    subtract,
    to_float,
    transpose,
    zeros,
)
from dobc_design.exact.observability import (
    decide_detectable,
    decide_observable,
    observability_matrix,
    observable_reduction,
)
from dobc_design.exact.polynomial import decide_hurwitz
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.groups import join
from dobc_design.problem.problem import Problem
from dobc_design.solvers.conic import SECOND, TIME_LIMIT, climb
from dobc_design.solvers.program import GIVEN_UP, Array, Program, Solution, round_matrix
from dobc_design.verdict import Verdict


@dataclass(frozen=True, slots=True, kw_only=True)
class Scaled:
    """An exosystem in other units: ``time`` (1/s) is worth 1 there, and ``gain`` turns its W into the real one."""

    exosystem: Exosystem
    time: Fraction
    gain: Fraction


def natural_units(exosystem: Exosystem, *, rate: Fraction) -> tuple[Fraction, Fraction]:
    """Powers of ten near the largest of (A, rate) and of C."""
    return _unit([*(x for row in exosystem.A for x in row), rate]), _unit([x for row in exosystem.C for x in row])


def scaled_exosystem(exosystem: Exosystem, *, time: Fraction, output: Fraction) -> Scaled:
    """(A / time, C / output); the exosystem itself where both are 1."""
    if time == output == 1:
        return Scaled(exosystem=exosystem, time=time, gain=time)
    copy = Exosystem(A=_rounded(exosystem.A, time), C=_rounded(exosystem.C, output))
    return Scaled(exosystem=copy, time=time, gain=time / output)


def _unit(numbers: list[Fraction]) -> Fraction:
    """A power of ten near the largest number; 1 if that is 0."""
    largest = max((abs(x) for x in numbers), default=Fraction(0))
    return Fraction(10) ** decimal_exponent(largest) if largest else Fraction(1)


def decimal_exponent(x: Fraction) -> int:
    """The e with 10^e about x > 0, within one or two; for numbers of any length."""
    bits = x.numerator.bit_length() - x.denominator.bit_length()
    return round(bits * 0.30103)


def _rounded(matrix: Matrix, unit: Fraction) -> list[list[str]]:
    return [[repr(float(x / unit)) for x in row] for row in matrix]


TRIES = 20  # a random choice fails with probability zero; small integers may need a few


def placed_gains(exosystem: Exosystem, *, rate: Fraction) -> Iterator[Matrix]:
    """W (q, m) with every observable pole of A - WC at -(rate + 1), in roundings and then exactly."""
    A, C, T = observable_reduction(exosystem.A, exosystem.C)
    if not A:
        yield zeros(exosystem.order, exosystem.outputs)
        return
    back = multiply(transpose(T), inverse(multiply(T, transpose(T))))
    random = Random(0)  # the same choice every time
    for attempt in range(TRIES):
        first = _small(random, len(A), len(C), attempt)
        mix = _small(random, 1, len(C), max(1, attempt))
        error, output = subtract(A, multiply(first, C)), multiply(mix, C)
        if decide_observable(error, output).verdict is Verdict.PROVED:
            gain = multiply(back, add(first, multiply(_ackermann(error, output, pole=rate + 1), mix)))
            for digits in (6, 12):
                try:
                    yield round_matrix(to_float(gain), digits)
                except OverflowError:  # beyond the floats; the exact one is still there
                    break
            yield gain
            return


def _ackermann(A: Matrix, c: Matrix, *, pole: Fraction) -> Matrix:
    """L (r, 1) with det(sI - A + L c) = (s + pole)^r, for an observable pair of one output."""
    r = len(A)
    polynomial, power = zeros(r, r), identity(r)
    for k in range(r + 1):
        polynomial = add(polynomial, scale(comb(r, k) * pole ** (r - k), power))
        power = multiply(power, A)
    last = tuple((Fraction(int(i == r - 1)),) for i in range(r))
    return multiply(polynomial, multiply(inverse(observability_matrix(A, c)), last))


def _small(random: Random, rows: int, columns: int, size: int) -> Matrix:
    """Small random integers; all zero (or one) at the first attempt."""
    return tuple(
        tuple(Fraction(random.randint(-size, size) or int(i == j and rows == 1)) for j in range(columns))
        for i in range(rows)
    )


TOLERANCE = 1e-10
STEPS = 60
SMALLEST = 1e-140  # its square is still a float
SAMPLES = 400
AROUND = (0.3, 0.7, 1.0, 1.4, 3.0, 10.0)  # frequencies tried, in parts of the size of each pole


def h2_norm(F: Array, B: Array, C: Array, D: Array) -> float:
    """The H2 norm of C (sI - F)^-1 B + D; inf if D is not 0 or F is not Hurwitz.

    Shapes: F (q, q), B (q, u), C (y, q), D (y, u).
    """
    if np.any(D) or not _hurwitz(F):
        return math.inf
    X = linalg.solve_continuous_lyapunov(F, -B @ B.T)
    return math.sqrt(max(0.0, float(np.trace(C @ X @ C.T))))


def hinf_norm(F: Array, B: Array, C: Array, D: Array) -> float:
    """The H-infinity norm of C (sI - F)^-1 B + D, the largest gain over the frequencies; inf if F is not Hurwitz."""
    if not _hurwitz(F):
        return math.inf
    poles = np.linalg.eigvals(F)
    tried = [0.0, *(float(x) * abs(z) for z in poles for x in AROUND), *np.abs(poles.imag).tolist()]
    low = max([_gain(F, B, C, D, w) for w in tried] + [float(np.linalg.norm(D, 2))])
    if low < SMALLEST:
        return low
    for _ in range(STEPS):
        level = (1 + 2 * TOLERANCE) * low
        crossings = _crossings(F, B, C, D, level)
        if not len(crossings):
            return low
        # With D not 0 the gain may stay above the level up to infinity: look beyond the last crossing as well.
        middles = np.array([*(crossings[1:] + crossings[:-1]) / 2, crossings[0] / 2, 2 * crossings[-1]])
        better = max(_gain(F, B, C, D, float(w)) for w in middles)
        if better <= level:
            return max(low, better)
        low = better
    return low


def transient_peak(F: Array) -> float:
    """The largest |exp(F t)| (spectral norm) over a grid of t >= 0: how far the error swings out; inf if it grows."""
    if not _hurwitz(F):
        return math.inf
    slowest = float(-np.max(np.linalg.eigvals(F).real))
    step = linalg.expm(F * (8.0 / slowest / SAMPLES))
    peak, power = 1.0, np.eye(len(F))
    for _ in range(SAMPLES):
        power = step @ power
        peak = max(peak, float(np.linalg.norm(power, 2)))
    return peak


def _hurwitz(F: Array) -> bool:
    return bool(np.all(np.isfinite(F))) and float(np.max(np.linalg.eigvals(F).real)) < 0


def _gain(F: Array, B: Array, C: Array, D: Array, frequency: float) -> float:
    value: Any = C @ np.linalg.solve(1j * frequency * np.eye(len(F)) - F, B.astype(complex)) + D
    return float(np.linalg.norm(value, 2))


def _crossings(F: Array, B: Array, C: Array, D: Array, level: float) -> Array:
    """Frequencies at which a singular value crosses the level: imaginary eigenvalues of the Hamiltonian matrix."""
    room = level**2 * np.eye(B.shape[1]) - D.T @ D
    R = np.linalg.inv(room)
    closed = F + B @ R @ D.T @ C
    hamiltonian = np.block([[closed, B @ R @ B.T], [-C.T @ (np.eye(len(C)) + D @ R @ D.T) @ C, -closed.T]])
    values = np.linalg.eigvals(hamiltonian)
    scale = max(1.0, float(np.max(np.abs(values))))
    return np.sort(values.imag[(np.abs(values.real) < 1e-8 * scale) & (values.imag >= 0)])


PAIR_DIGITS = (3, 4, 6, 9, 14)
PAIR_SLACK = (0.9, 0.5, 0.1)
MOST_WORK = 300_000
LADDER = (0, 2, 6, 15, 40, 400)  # powers of ten, the last ones for a bound that is not known


def propose_pairs(
    exosystem: Exosystem, W: Matrix, *, bound: float, decay: float, time_limit: float = TIME_LIMIT
) -> Iterator[tuple[Matrix, Matrix, str]]:
    """Rational (P, P W) to be tried in turn, each with a sentence on how it came about ("" for the usual way).

    ``bound`` is about max lambda_max(Lambda) < 0, ``decay`` about the decay rate of A - WC > 0 (1/s).
    ``time_limit`` in s, for one call of a solver; the last pairs need no solver.
    """
    why = "there was no estimate to start a solver from"
    if bound < 0 < decay and math.isfinite(bound) and math.isfinite(decay):
        for answer, _, how in climb(_programs(exosystem, W, bound=bound, decay=decay), time_limit=time_limit):
            why = f"no proposal of a solver could be proved (the last said: {answer.status})"
            if answer.found:
                for digits in PAIR_DIGITS:
                    P = round_matrix(answer.values["P"], digits)
                    yield P, multiply(P, W), f"P was found {how}." if how else ""
    error = subtract(exosystem.A, multiply(W, exosystem.C))
    exact = lyapunov(error) if _is_solvable(error) else None
    if exact is not None:
        for P, Q in _scaled_until_small(exact, W, exosystem, bound=bound):
            yield P, Q, f"P solves a Lyapunov equation exactly, because {why}."


def _programs(exosystem: Exosystem, W: Matrix, *, bound: float, decay: float) -> Iterator[tuple[Program, None]]:
    floor = _floor(exosystem, bound, decay)
    for part in PAIR_SLACK:
        rate = Fraction(part * min(-bound / 2, decay)).limit_denominator(10**6)
        pencil = with_gain(reduced(_tightened(bound, rate), exosystem, rate=rate), W)
        yield Program(pencils=(pencil,), floor=floor), None


def lyapunov(error: Matrix) -> Matrix | None:
    """The exact P with error' P + P error = -I, or None if there is no unique one.  Shape (q, q)."""
    q = len(error)
    places = [(i, j) for i in range(q) for j in range(i, q)]
    index = {place: k for k, place in enumerate(places)}
    rows: list[Vector] = []
    for i, j in places:
        row = [Fraction(0)] * len(places)
        for r in range(q):  # (E'P + PE)_ij = sum_r E_ri P_rj + P_ir E_rj
            row[index[min(r, j), max(r, j)]] += error[r][i]
            row[index[min(i, r), max(i, r)]] += error[r][j]
        rows.append(tuple(row))
    try:
        solution = multiply(inverse(tuple(rows)), tuple((Fraction(-1 if i == j else 0),) for i, j in places))
    except (ArithmeticError, ValueError):
        return None
    return tuple(tuple(solution[index[min(i, j), max(i, j)]][0] for j in range(q)) for i in range(q))


def _is_solvable(error: Matrix) -> bool:
    """Whether the exact equation takes seconds, not hours: unknowns times bits of the common denominator.

    Beyond that the solution has more digits than a certificate can hold in any case.
    """
    common = math.lcm(*(x.denominator for row in error for x in row))
    return len(error) * (len(error) + 1) // 2 * common.bit_length() <= MOST_WORK


def _scaled_until_small(P: Matrix, W: Matrix, exosystem: Exosystem, *, bound: float) -> Iterator[tuple[Matrix, Matrix]]:
    """a (P, P W) with S = C C' / a well below |bound|: Omega0 = -a I, so every a large enough will do."""
    size = sum((x * x for row in exosystem.C for x in row), Fraction(0))  # at least lambda_max(C C')
    wanted = 2 * size / Fraction(-bound) if bound < 0 and math.isfinite(bound) else size
    start = max(0, decimal_exponent(wanted) + 2) if wanted else 0
    for step in LADDER:
        larger = scale(Fraction(10) ** (start + step), P)
        yield larger, multiply(larger, W)


def _floor(exosystem: Exosystem, bound: float, decay: float) -> Fraction:
    """A lower bound for P that keeps it away from singular where C sees nothing."""
    size = sum((x * x for row in exosystem.C for x in row), Fraction(0))
    natural = size / (Fraction(-bound) * Fraction(max(decay, -bound))) / 1000
    return natural.limit_denominator(10**12) or Fraction(1, 10**12)


def _tightened(bound: float, rate: Fraction) -> Fraction:
    """The bound with a little slack, so that rounding P cannot cross it."""
    total = bound + 2 * float(rate)
    return Fraction(bound - 0.05 * total) if total < 0 else Fraction(bound)


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
