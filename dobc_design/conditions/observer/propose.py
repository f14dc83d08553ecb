"""Observer gains W for (17) and pairs (P, Q = P W) for (18) that are worth trying, and norms of the
error system.

Programs and Kalman gains come first, but feasible problems never depend on a solver: the last rung
for W is Ackermann's formula over the rationals, that for P an exact Lyapunov equation, scaled up.
Nothing here is a proof.
"""

import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from functools import partial
from itertools import product
from random import Random
from typing import Any

import numpy as np
from scipy import linalg

from dobc_design._checks import noun
from dobc_design._show.text import capitalize_first
from dobc_design.conditions.consensus.claim import reduced, with_gain
from dobc_design.conditions.consensus.propose import decay_of, decay_rate
from dobc_design.conditions.numbers import rounded_up
from dobc_design.exact import observability
from dobc_design.exact.matrix import (
    Array,
    Matrix,
    add,
    identity,
    inverse,
    largest_entry,
    multiply,
    scale,
    solve_lyapunov,
    subtract,
    to_float,
    transpose,
    zeros,
)
from dobc_design.exact.number import ONE, ZERO, nearest
from dobc_design.exact.polynomial import Coefficients
from dobc_design.loop.loop import Loop
from dobc_design.loop.make import errors_of
from dobc_design.loop.matrices import consensus_jacobian, pull_matrix
from dobc_design.loop.outputs import sensed
from dobc_design.loop.timing import Timing, middle_of, sampled
from dobc_design.problem.bands import Band
from dobc_design.problem.dynamics import Dynamics
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.groups import Group, Observer, join
from dobc_design.problem.problem import Problem
from dobc_design.solvers.conic import solve_in_turn
from dobc_design.solvers.program import GIVEN_UP, Program, Solution, round_matrix
from dobc_design.verdict import Verdict

from .bands import are_bounded, filters
from .decide import error_matrix, hurwitz_with_rate, sampled_verdict, too_large

# Order up to which semidefinite programs are solved: their unknowns grow with its square.
LARGEST_PROGRAM = 16
LARGEST_NETWORK = 200  # errors, whose eigenvalues are taken for the rate of a W
# Of W:
TRIES = 20  # random choices (each fails with probability zero; small integers may need a few)
DIGITS = (3, 4, 6, 9, 15)
SLACK = (Fraction(21, 20), Fraction(1001, 1000))  # how much more than the rate is asked for
# Of P:
PAIR_DIGITS = (3, 4, 6, 9, 14)
PAIR_SLACK = (0.9, 0.5, 0.1)  # parts of the rate
MOST_WORK = 300_000  # for an exact equation
LADDER = (0, 2, 6, 15, 40, 400)  # powers of ten, the last for an unknown bound
# Of norms:
STEPS = 60
TOLERANCE = 1e-10  # relative
SMALLEST = 1e-140  # its square is still a float
SAMPLES = 400  # points of t
# Of bands:
FREQUENCIES = 4001
MISSED = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2)  # parts of a gain
LEAST_GAIN = 1e-9
RESIDUAL = Fraction(1, 10)  # what a designed W is to leave of a sine
DOUBLINGS = 12  # of the rate
AROUND = (0.3, 0.7, 1.0, 1.4, 3.0, 10.0)  # frequencies tried, in parts of the size of each pole


@noun
class Scaled:
    """An exosystem in other units: ``time`` (1/s) is worth 1 there, and ``gain`` turns its W into
    the real one."""

    exosystem: Exosystem
    time: Fraction
    gain: Fraction


def natural_units(exosystem: Exosystem, *, rate: Fraction) -> tuple[Fraction, Fraction]:
    """Powers of ten near the largest of (A, rate) and of C."""
    rates = [x for row in exosystem.A for x in row]
    outputs = [x for row in exosystem.C for x in row]
    return _unit([*rates, rate]), _unit(outputs)


def scaled_exosystem(exosystem: Exosystem, *, time: Fraction, output: Fraction) -> Scaled:
    """(A / time, C / output), rounded to floats; the exosystem itself where both are 1."""
    if not time == output == 1:
        exosystem = Exosystem(A=_texts(exosystem.A, time), C=_texts(exosystem.C, output))
    return Scaled(exosystem=exosystem, time=time, gain=time / output)


def _texts(M: Matrix, unit: Fraction) -> list[list[str]]:
    """The entries in a unit, as shortest decimals of floats."""
    return [[repr(float(x / unit)) for x in row] for row in M]


def _unit(numbers: list[Fraction]) -> Fraction:
    """A power of ten near the largest number; 1 if that is 0."""
    largest = max((abs(x) for x in numbers), default=ZERO)
    return Fraction(10) ** decimal_exponent(largest) if largest else ONE


def decimal_exponent(x: Fraction) -> int:
    """The e with 10^e about x > 0, within one or two; for numbers of any length."""
    return round((x.numerator.bit_length() - x.denominator.bit_length()) * 0.30103)


def placed_gains(exosystem: Exosystem, *, rate: Fraction) -> Iterator[Matrix]:
    """W (q, m) with every observable pole of A - WC at -(rate + 1), in roundings and then
    exactly."""
    A, C, T = observability.observable_reduction(exosystem.A, exosystem.C)
    if not A:
        yield zeros(exosystem.order, exosystem.outputs)
        return
    back = multiply(transpose(T), inverse(multiply(T, transpose(T))))
    random = Random(0)  # the same choice every time
    for attempt in range(TRIES):
        # From a single mixed output everything has to be observable: a random first gain helps.
        first = _small(random, len(A), len(C), attempt)
        mix = _small(random, 1, len(C), max(1, attempt))
        error = subtract(A, multiply(first, C))
        output = multiply(mix, C)
        if not observability.decide_observable(error, output).is_proved:
            continue
        placed = multiply(_ackermann(error, output, pole=rate + 1), mix)
        gain = multiply(back, add(first, placed))
        with suppress(*GIVEN_UP):  # beyond the floats; the exact one is still there
            yield from (round_matrix(to_float(gain), digits) for digits in (6, 12))
        yield gain
        return


def _ackermann(A: Matrix, c: Matrix, *, pole: Fraction) -> Matrix:
    """L (r, 1) with det(sI - A + L c) = (s + pole)^r, for an observable pair of one output."""
    r = len(A)
    shifted = add(A, scale(pole, identity(r)))
    polynomial = identity(r)
    for _ in range(r):
        polynomial = multiply(polynomial, shifted)
    last = tuple((Fraction(int(i == r - 1)),) for i in range(r))
    return multiply(polynomial, multiply(inverse(observability.observability_matrix(A, c)), last))


def _small(random: Random, rows: int, columns: int, size: int) -> Matrix:
    """Small random integers; all zero (or one) at the first attempt."""
    one = [[int(i == j and rows == 1) for j in range(columns)] for i in range(rows)]
    return tuple(tuple(Fraction(random.randint(-size, size) or x) for x in row) for row in one)


def kalman_gain(A: Array, C: Array, *, process: float = 1.0, sampled: bool = False) -> Array | None:
    """The gain W (q, m) for process noise ``process`` I and measurement noise I, of the predictor
    where ``sampled``."""
    m, q = C.shape
    noise = process * np.eye(q)
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            if sampled:
                X = linalg.solve_discrete_are(A.T, C.T, noise, np.eye(m))
                gain = np.linalg.solve(C @ X @ C.T + np.eye(m), C @ X @ A.T).T
            else:
                gain = linalg.solve_continuous_are(A.T, C.T, noise, np.eye(m)) @ C.T
    except GIVEN_UP:
        return None
    return gain if np.all(np.isfinite(gain)) else None


def decay_of_error(exosystem: Exosystem, W: Matrix, timing: Timing | None) -> float:
    """The rate (1/s) at which the observer error decays, about; of the recursion where it is
    sampled."""
    if timing is None or not timing.sampled:
        return decay_rate(exosystem, W)
    F = middle_of(sampled(exosystem, timing).error(W, timing.period))
    largest = largest_entry(np.linalg.eigvals(to_float(F)))
    return -math.log(largest) / float(timing.period) if largest else math.inf


def half_rate(A: Array, C: Array, gain: Array | None) -> Fraction:
    """Half the decay rate of A - gain C, to three digits; 0 if that fails (any W that decays will
    do)."""
    if gain is None:
        return ZERO
    try:
        decay = decay_of(A - gain @ C)
    except GIVEN_UP:
        return ZERO
    return Fraction(f"{decay / 2:.3g}") if 0 < decay < np.inf else ZERO


def hinf_norm(F: Array, B: Array, C: Array, D: Array) -> float:
    """The H-infinity norm of C (sI - F)^-1 B + D, the largest gain over the frequencies; inf if F
    is not Hurwitz."""
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
        # With D not 0 the gain may stay above the level up to infinity: look beyond the last
        # crossing as well.
        middles = (crossings[1:] + crossings[:-1]) / 2
        looked_at = np.array([*middles, crossings[0] / 2, 2 * crossings[-1]])
        better = max(_gain(F, B, C, D, float(w)) for w in looked_at)
        if better <= level:
            return max(low, better)
        low = better
    return low


def transient_peak(F: Array) -> float:
    """The largest |exp(F t)| (spectral norm) over a grid of t >= 0: how far the error swings out;
    inf if it grows."""
    if not _hurwitz(F):
        return math.inf
    slowest = decay_of(F)
    step = linalg.expm(F * (8.0 / slowest / SAMPLES))
    peak = 1.0
    power = np.eye(len(F))
    for _ in range(SAMPLES):
        power = step @ power
        peak = max(peak, float(np.linalg.norm(power, 2)))
    return peak


def _hurwitz(F: Array) -> bool:
    return bool(np.all(np.isfinite(F))) and decay_of(F) > 0


def _gain(F: Array, B: Array, C: Array, D: Array, frequency: float) -> float:
    value: Any = C @ np.linalg.solve(1j * frequency * np.eye(len(F)) - F, B.astype(complex)) + D
    return float(np.linalg.norm(value, 2))


def _crossings(F: Array, B: Array, C: Array, D: Array, level: float) -> Array:
    """Frequencies at which a singular value crosses the level: imaginary eigenvalues of the
    Hamiltonian matrix."""
    room = level**2 * np.eye(B.shape[1]) - D.T @ D
    R = np.linalg.inv(room)
    closed = F + B @ R @ D.T @ C
    output = C.T @ (np.eye(len(C)) + D @ R @ D.T) @ C
    hamiltonian = np.block([[closed, B @ R @ B.T], [-output, -closed.T]])
    values = np.linalg.eigvals(hamiltonian)
    scale = max(1.0, largest_entry(values))
    imaginary = np.abs(values.real) < 1e-8 * scale
    return np.sort(values.imag[imaginary & (values.imag >= 0)])


def propose_pairs(
    exosystem: Exosystem, W: Matrix, *, bound: float, decay: float
) -> Iterator[tuple[Matrix, Matrix, str]]:
    """Rational (P, P W) to be tried in turn, each with a sentence on how it came about ("" for the
    usual way). ``bound`` is about max lambda_max(Lambda) < 0, ``decay`` about that of A - WC > 0
    (1/s); the last need no solver."""
    why = "there was no estimate to start a solver from"
    small = exosystem.order <= LARGEST_PROGRAM
    if small and bound < 0 < decay and math.isfinite(bound) and math.isfinite(decay):
        for answer in solve_in_turn(_programs(exosystem, W, bound=bound, decay=decay)):
            why = f"no proposal of a solver could be proved (the last said: {answer.status})"
            if answer.found:
                for digits in PAIR_DIGITS:
                    P = round_matrix(answer.values["P"], digits)
                    yield P, multiply(P, W), ""
    error = error_matrix(exosystem, W)
    # What S = C C' / a needs of a; the sum is at least lambda_max(C C').
    wanted = _square(exosystem)
    if bound < 0 and math.isfinite(bound):
        wanted = 2 * wanted / Fraction(-bound)
    if not small:
        why = f"a semidefinite program of order {exosystem.order} takes long"
        for P in _near_solutions(exosystem, error, wanted):
            yield P, multiply(P, W), f"P solves a Lyapunov equation about, because {why}."
    for P in _exact_solutions(error, wanted):
        yield P, multiply(P, W), f"P solves a Lyapunov equation exactly, because {why}."


def _near_solutions(exosystem: Exosystem, error: Matrix, wanted: Fraction) -> Iterator[Matrix]:
    """Roundings of the P of a Lyapunov equation, of growing sizes from ``wanted`` on."""
    with suppress(*GIVEN_UP):
        near = linalg.solve_continuous_lyapunov(to_float(error).T, -np.eye(exosystem.order))
        for factor, digits in product((1, 10, 1000), (6, 12)):
            yield round_matrix(float(wanted * factor) * (near + near.T) / 2, digits)


def _exact_solutions(error: Matrix, wanted: Fraction) -> Iterator[Matrix]:
    """The P of a Lyapunov equation times growing powers of ten; none where that takes hours."""
    q = len(error)
    common = math.lcm(*(x.denominator for row in error for x in row))
    # Beyond so much work P has more digits than a certificate can hold in any case.
    if q * (q + 1) // 2 * common.bit_length() > MOST_WORK:
        return
    exact = solve_lyapunov(error, identity(q))
    if exact is None:
        return
    # a (P, P W) has Omega0 = -a I and S = C C' / a, so every a large enough will do
    start = max(0, decimal_exponent(wanted) + 2) if wanted else 0
    for step in LADDER:
        yield scale(Fraction(10) ** (start + step), exact)


def _programs(exosystem: Exosystem, W: Matrix, *, bound: float, decay: float) -> Iterator[Program]:
    """Programs for P, at falling rates."""
    # P is kept away from singular where C sees nothing, and the bound has a little slack for the
    # rounding of P.
    natural = _square(exosystem) / (Fraction(-bound) * Fraction(max(decay, -bound))) / 1000
    floor = natural.limit_denominator(10**12) or Fraction(1, 10**12)
    for part in PAIR_SLACK:
        rate = Fraction(part * min(-bound / 2, decay)).limit_denominator(10**6)
        total = bound + 2 * float(rate)
        tightened = Fraction(bound - 0.05 * total) if total < 0 else Fraction(bound)
        pencil = with_gain(reduced(tightened, exosystem, rate=rate), W)
        yield Program(pencils=(pencil,), floor=floor)


def _square(exosystem: Exosystem) -> Fraction:
    return sum((x * x for row in exosystem.C for x in row), ZERO)


@noun
class GainDesign:
    """A designed W (q, m), or None; the proved decay rate (1/s) it was designed for; and how it
    came about."""

    W: Matrix | None
    rate: Fraction | None
    note: str


def design_gain(exosystem: Exosystem, *, rate: Fraction | None = None) -> GainDesign:
    """Design W (q, m) so that A - WC decays at ``rate`` (1/s), by default half that of a Kalman
    gain."""
    reason = too_large(exosystem)
    if reason is not None:
        return GainDesign(W=None, rate=None, note=f"no W is designed: it is {reason}")
    if not observability.decide_detectable(exosystem.A, exosystem.C).is_proved:
        return GainDesign(W=None, rate=None, note="no W exists: (A, C) is not detectable.")
    prefix = ""
    asked = "as asked"
    wanted = rate
    kalman = None
    if rate is not None and not _can_reach(exosystem, rate):
        reason = "a part of the exosystem that C does not see decays no faster."
        prefix = f"the rate asked, {_short(rate)} 1/s, cannot be reached: {reason} "
        wanted = None
    if wanted is None:
        kalman = _kalman(exosystem)
        wanted = ZERO
        if kalman is not None:
            wanted = half_rate(to_float(exosystem.A), to_float(exosystem.C), kalman)
        asked = "the least that can be asked"
        if wanted:
            asked = "half that of the Kalman gain with unit weights"
    for W, how in _candidates(exosystem, wanted, kalman):
        if hurwitz_with_rate(error_matrix(exosystem, W), wanted):
            note = (
                f"{prefix}W was designed ({how}) for the decay rate {_short(wanted)} 1/s, {asked}."
            )
            return GainDesign(W=W, rate=wanted, note=note)
    cure = "give one as observer.W."
    if wanted:
        cure = f"ask for a lower observer.rate, or {cure}"
    note = (
        f"{prefix}no W was found for the decay rate {_short(wanted)} 1/s, neither by the small "
        f"SDP nor as a Kalman gain nor by exact pole placement; {cure}"
    )
    return GainDesign(W=None, rate=wanted, note=note)


def design_sampled_gain(
    exosystem: Exosystem, timing: Timing, rate: Fraction | None = None
) -> GainDesign:
    """Design W (q, m) so that all eigenvalues of Ad - W C Gamma are smaller than exp(-rate T), or
    1: a Kalman gain, which is that of continuous time as T goes to 0, or all of them at 0."""
    rate = rate or ZERO
    reason = too_large(exosystem)
    if reason is not None:
        return GainDesign(W=None, rate=None, note=f"no W is designed: it is {reason}")
    found = sampled(exosystem, timing)
    A, C = (middle_of(M) for M in (found.A, found.C))
    T = timing.period
    ways = []
    with suppress(OverflowError):
        growth = math.exp(float(rate * T))  # what decays although it grows so fast
        kalman = kalman_gain(growth * to_float(A), to_float(C), process=float(T * T), sampled=True)
        if kalman is not None:
            ways = [(W, "Kalman gain") for W in _roundings(kalman / growth)]
    pair = Exosystem(A=A, C=C)
    ways += [(W, "all eigenvalues at 0, about") for W in placed_gains(pair, rate=-ONE)]
    for L, how in ways:
        W = scale(1 / T, L)
        if sampled_verdict(exosystem, W, timing, rate) is Verdict.PROVED:
            note = f"W was designed ({how}) for the recursion from sample to sample."
            return GainDesign(W=W, rate=rate, note=note)
    return GainDesign(W=None, rate=None, note="no W was found for this period and rate.")


def _can_reach(exosystem: Exosystem, rate: Fraction) -> bool:
    """Whether some W gives the decay rate: (A + rate I, C) is detectable."""
    shifted = add(exosystem.A, scale(rate, identity(exosystem.order)))
    return observability.decide_detectable(shifted, exosystem.C).is_proved


def _candidates(
    exosystem: Exosystem, rate: Fraction, kalman: Array | None
) -> Iterator[tuple[Matrix, str]]:
    """Proposals W for a rate, each in several roundings, and how they came about."""
    time, output = natural_units(exosystem, rate=rate)
    # Large C alone would ask for a far faster observer than the rate does, hence max(1, output).
    units = scaled_exosystem(exosystem, time=time, output=output)
    systems = [units]
    with suppress(OverflowError):  # A is beyond the floats
        tame = max(ONE, output)
        systems.insert(0, scaled_exosystem(exosystem, time=ONE, output=tame))
    if exosystem.order > LARGEST_PROGRAM:
        systems = []
    asked = list(product(systems, SLACK))
    answers = solve_in_turn(_program(each, rate / each.time * slack) for each, slack in asked)
    for (each, _), answer in zip(asked, answers, strict=False):
        for W in _roundings(_gain_of(answer)):
            yield scale(each.gain, W), "small SDP"
    for W in _roundings(kalman):
        yield W, "Kalman gain"
    for slack in SLACK:
        shift = float(rate / units.time * slack)
        for W in _roundings(_kalman(units.exosystem, shift=shift)):
            yield scale(units.gain, W), "Kalman gain of A + rate I"
    for W in placed_gains(exosystem, rate=rate):
        yield W, "exact pole placement"


def _program(units: Scaled, rate: Fraction) -> Program:
    # The bound makes room for the rate: what stays of Lambda + 2 rate I is -I, whatever the rate.
    return Program(pencils=(reduced(-1 - 2 * rate, units.exosystem, rate=rate),), floor=ONE)


def _gain_of(answer: Solution) -> Array | None:
    """P^-1 Q, or None."""
    if not answer.found:
        return None
    with suppress(*GIVEN_UP):
        gain = np.linalg.solve(answer.values["P"], answer.values["Q"])
        return np.asarray(gain, dtype=np.float64)
    return None


def _roundings(gain: Array | None) -> Iterator[Matrix]:
    if gain is not None and np.all(np.isfinite(gain)):
        yield from (round_matrix(gain, digits) for digits in DIGITS)


def _kalman(exosystem: Exosystem, *, shift: float = 0.0) -> Array | None:
    """The Kalman gain of (A + shift I, C) with unit weights; A - WC then decays faster than
    ``shift``."""
    with suppress(ValueError):  # beyond the floats
        A = to_float(exosystem.A) + shift * np.eye(exosystem.order)
        return kalman_gain(A, to_float(exosystem.C))
    return None


def _short(rate: Fraction) -> str:
    """A rate for a sentence; beyond the floats as a power of ten."""
    exponent = decimal_exponent(rate) if rate else 0
    return f"{float(rate):.4g}" if abs(exponent) < 300 else f"about 1e{exponent}"


def design_gains(loop: Loop) -> tuple[GainDesign | None, ...]:
    """A designed gain for every group of agents; None where W is given."""
    designs = []
    for group in loop.groups:
        own = group.observer
        design = None
        if own.W is None and loop.timing is not None and loop.is_sampled:
            design = design_sampled_gain(group.exosystem, loop.timing, own.rate)
        elif own.W is None and loop.bands and own.rate is None:
            design = _design_filter(loop, group)
        elif own.W is None:
            design = design_gain(group.exosystem, rate=own.rate)
        designs.append(design)
    return tuple(designs)


def _design_filter(loop: Loop, group: Group) -> GainDesign:
    """A gain so fast that little is left of sines in the bands; as fast as it gets where that is
    not enough."""
    alone = replace(loop, groups=(group,))

    def left(W: Matrix) -> float:
        return max(float(max(map(max, band_gains(alone, W, band)))) for band in loop.bands)

    return _fast_enough(group.exosystem, design_gain(group.exosystem), left)


def _fast_enough(
    exosystem: Exosystem, first: GainDesign, left: Callable[[Matrix], float]
) -> GainDesign:
    """The ``first`` design, or a faster one with which little is ``left`` of sines in bands."""
    found = first
    for power in range(DOUBLINGS):
        if found.W is None or first.rate is None or left(found.W) <= RESIDUAL:
            break
        faster = design_gain(exosystem, rate=first.rate * 2 ** (power + 1))
        if faster.W is not None:
            why = "so that little is left of sines in bands"
            found = replace(faster, note=faster.note.replace("as asked", why))
    return found


def _uncompensated(group: Group, own: Dynamics, bands: Sequence[Band], W: Matrix) -> float:
    """How much d - dhat is of a sine d in the bands, at the most, with outputs measured."""
    pair = sensed(group, own).exosystem
    F = to_float(error_matrix(pair, W))
    C = np.hstack([np.zeros((own.inputs, own.dimension)), to_float(group.exosystem.C)])
    B = np.eye(len(F), own.dimension) @ to_float(own.B)
    most = 0.0
    for band in bands:
        for w in np.linspace(nearest(band.low), nearest(band.high), SAMPLES):
            S = np.eye(own.inputs) + C @ np.linalg.solve(1j * w * np.eye(len(F)) - F, B)
            most = max(most, largest_entry(S))
    return most


def filter_rate(loop: Loop) -> Fraction | None:
    """The largest decay rate of designed gains that leave little of sines in the bands; None
    without bands, and where a rate is asked for."""
    if not loop.bands or any(group.observer.rate is not None for group in loop.groups):
        return None
    rates = (_design_filter(loop, group).rate for group in loop.groups)
    return max((rate for rate in rates if rate is not None), default=None)


def chosen_gains(loop: Loop, designs: Sequence[GainDesign | None]) -> tuple[Matrix | None, ...]:
    """The W of every group of agents, given or designed; None where there is none."""
    given = zip(loop.groups, designs, strict=True)
    return tuple(group.observer.W if design is None else design.W for group, design in given)


def observer_gain(loop: Loop) -> Matrix | None:
    """The W (q, m) that ``certify`` uses: the one given, else the designed one; None without
    either."""
    return join(chosen_gains(loop, design_gains(loop)))


def band_gains(loop: Loop, W: Matrix, band: Band) -> Matrix:
    """What is left of sines in a band, (p, p), the most of all groups, a little above."""
    jw = 1j * np.linspace(nearest(band.low / band.high), 1, FREQUENCIES)
    most: Any = 0.0
    for below, rows in filters(loop, W):
        with np.errstate(all="ignore"):  # gains far beyond the band have no floats
            bottom = np.polyval(_in_units(below, band.high), jw)
            tables = [[np.polyval(_in_units(x, band.high), jw) for x in row] for row in rows]
            sizes = [[largest_entry(x / bottom) for x in row] for row in tables]
        most = np.maximum(most, np.nan_to_num(sizes, nan=1.0, posinf=1.0))
    if not np.any(most):  # nothing at all is left only after all time
        most = most + LEAST_GAIN
    found: Matrix = ()
    # Between two frequencies, and in floats, a little may be missed.
    for more in MISSED:
        raised = (most * (1 + more)).tolist()
        found = tuple(tuple(rounded_up(Fraction(x), digits=7) for x in row) for row in raised)
        if are_bounded(loop, W, band, found):
            break
    return found


def _in_units(coefficients: Coefficients, unit: Fraction) -> Array:
    """A polynomial of s / unit, divided by unit^degree, in floats."""
    return np.array([nearest(x / unit**k) for k, x in enumerate(coefficients)])


def with_observer(problem: Problem) -> Problem:
    """The problem with the gains that agents with measured outputs need, where it gives none: loops
    depend on them.  A note says so."""
    own = problem.dynamics
    if own is None or own.H is None or all(each.observer.W for each in problem.groups):
        return problem
    return _designed(problem, own, pace_of(_designed(problem, own, ZERO)))


def _designed(problem: Problem, own: Dynamics, pace: Fraction) -> Problem:
    """The same with gains for at least this rate, where they exist."""
    bands = problem.uncertainty.bands or () if problem.uncertainty else ()
    groups = []
    notes = list(problem.notes)
    for group in problem.groups:
        observer = group.observer
        if observer.W is None:
            pair = sensed(group, own).exosystem
            design = design_gain(pair, rate=observer.rate)
            if observer.rate is None and design.rate is not None and design.rate < pace:
                faster = design_gain(pair, rate=pace)
                if faster.rate == pace:
                    note = faster.note.replace("as asked", "that of the network alone")
                    design = replace(faster, note=note)
            if observer.rate is None and bands:
                design = _fast_enough(pair, design, partial(_uncompensated, group, own, bands))
            # Without one nothing is proved; what is hidden is said all the same.
            none = zeros(pair.order, pair.outputs)
            observer = Observer(W=none if design.W is None else design.W)
            note = design.note.replace("(A, C)", "what y = H x shows of states and disturbance")
            notes.append(f"No W was given. {capitalize_first(note)}")
        groups.append(Group(agents=group.agents, exosystem=group.exosystem, observer=observer))
    if problem.is_grouped:
        return problem.replace(groups=groups, notes=notes)
    return problem.replace(observer=groups[0].observer, notes=notes)


def pace_of(problem: Problem) -> Fraction:
    """The rate (1/s) at which the network alone decays near the target, about; 0 where that is not
    known, or it does not."""
    loop = errors_of(problem)
    if loop.size > LARGEST_NETWORK or loop.agrees:
        return ZERO
    slowest = math.inf
    for mode in loop.modes:
        J = consensus_jacobian(loop, mode)
        if J is None:
            return ZERO
        slowest = min(slowest, decay_of((J - pull_matrix(loop)).toarray()))
    return Fraction(f"{slowest:.3g}") if 0 < slowest < math.inf else ZERO
