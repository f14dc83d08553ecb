"""What is left of pins whose inputs saturate at `limit` (the format page, "Saturation").

Of an agent with a limit, |dhat_i| <= dbar_i for all time, the pin is at least k e cut at +-(limit -
dbar_i): an arc to a node whose error is 0. dbar_i is the amplitude of d_i and a bound of |C eps_i|.
"""

import copy
import math
from collections.abc import Iterator
from fractions import Fraction
from functools import lru_cache

from .claims import Case
from .expressions import LONGEST_MADE, read_coupling
from .loop import Arc, Loop, Residual, Timing
from .matrices import (
    ZERO,
    Matrix,
    form,
    identity,
    is_diagonal,
    is_form,
    opposite,
    plus,
    product,
    root,
    solved,
    transpose,
)
from .reading import Refused, need, rational, read
from .sampled import BITS, Ball, multiplied, ticks

MOST = 12  # states of an exosystem
MORE = 1 + Fraction(1, 10**6)  # of the errors at the start that are asked for
UNIT = 10**9
DOUBLINGS = 12  # of the samples over which errors are followed
POWER = 3  # lambda_max(P) <= the root of order 2^POWER of the trace of that power


def saturates(loop: Loop) -> bool:
    """Whether inputs saturate."""
    return loop.actuators is not None and bool(loop.actuators.saturates)


def to_target(loop: Loop) -> bool:
    """Whether fixed nodes, where there are any, are the target, and pins are exact."""
    return not (loop.differences or loop.gap or saturates(loop))


def allowed(loop: Loop) -> Fraction:
    """The largest |eps_i| at the start that is counted."""
    return Fraction(loop.region.initial_disturbance or 0) * MORE


@lru_cache(maxsize=1)
def cut(case: Case) -> Case:
    """The same case with pins that saturate; itself where some limit leaves nothing."""
    try:
        rooms = dict(left(case, allowed(case)))
    except Refused:
        return case
    cut_off = [i for i in rooms if any(map(any, case.gain(i)))]
    if min(rooms.values(), default=ZERO) <= 0 or not cut_off:
        return case
    rows = copy.copy(case)
    rows.fixed = 1
    rows.hold = {i: k for i, k in case.hold.items() if i not in rooms}
    rows.pins = {i: k for i, k in case.pins.items() if i not in rooms}
    pins = []
    for i in cut_off:
        end = rooms[i]
        text = f"clip(({case.gain(i)[0][0]})*y, -({end}), {end})"
        pins.append(Arc(i, case.n, Fraction(1), read_coupling((text,), case.m, LONGEST_MADE)))
    rows.functions = [*case.functions, *dict.fromkeys(arc.coupling for arc in pins)]
    rows.modes = {mode: [*pins, *arcs] for mode, arcs in case.modes.items()}
    rows.collect()
    return rows


def left(case: Case, most: Fraction) -> Iterator[tuple[int, Fraction]]:
    """Every agent with a limit, and what is left of it beside the compensation; ``most``: the
    largest |eps_i| at the start."""
    plant = case.uncertainty
    told = plant is None or (plant.known_to_agents and not case.disturbed)
    scalar = all(k == identity(case.m, k[0][0]) for k in case.pins.values())
    plain = not (case.fixed or case.signed or case.gap)
    known = told and scalar and case.B is None and plain
    stated = case.agrees or case.region is not None
    need(known and stated, "what saturation leaves is not known here")
    # no estimate without an exosystem
    errors = [error(each, most, case.timing) for each in gains(case, most)]
    for i, limit in case.actuators.limit.items():
        needed = amplitude(case, i)
        if i in case.place:
            needed += errors[case.place[i]]
        yield i, Fraction((limit - needed) * UNIT // 1, UNIT)


def gains(case: Case, most: Fraction) -> Iterator[Residual]:
    """The residuals, each with its block of the gain of the certificate."""
    row = column = 0
    for residual in case.residuals:
        need(case.W is not None or not most, "there is no observer gain")
        q = len(residual.A)
        W = case.W and [each[column : column + case.m] for each in case.W[row : row + q]]
        yield residual._replace(W=W)
        row += q
        column += case.m


def error(residual: Residual, most: Fraction, timing: Timing | None) -> Fraction:
    """A bound of |C eps_i| for all time: eps'P eps falls where F'P + P F = -N < 0, F = A - W C, and
    (c eps)^2 <= (c P^-1 c') (eps'P eps)."""
    if not most:
        return ZERO
    C = residual.C
    q = len(residual.A)
    need(q <= MOST, "the exosystem is too large")
    if timing is not None and timing.sampled:
        return over_ticks(residual, timing) * most
    seen = product(transpose(C), C)
    tilt = (trace(seen) or Fraction(1)) / 100
    N = plus(seen, tilt, identity(q))
    F = plus(residual.A, -1, product(residual.W or [], C))
    P = lyapunov(F, N)
    PF = product(P, F)
    falls = plus(PF, 1, transpose(PF)) == opposite(N)
    need(is_form(P) and falls, "errors of the estimates do not decay")
    inverted = solved(P, identity(q))
    return root(max(form(c, inverted, c) for c in C) * largest(P)) * most


def over_ticks(residual: Residual, timing: Timing) -> Fraction:
    """A bound of |c F^k| for every row c of C and every k: that for k < K, where |F^K| <= 1."""
    found = ticks(residual, timing)
    power = ball(found.F, found.off)
    rows = ball(found.C, found.around)
    for _ in range(DOUBLINGS):
        if sum(length(power)) <= 1:
            return root(max(length(rows)))
        more = multiplied(rows, power)
        rows = Ball(rows.entries + more.entries, max(rows.missed, more.missed))
        power = multiplied(power, power)
    raise Refused("errors of the estimates are not seen to decay")


def ball(X: Matrix, off: Fraction) -> Ball:
    """A matrix whose rows may miss ``off``, and less than one unit more for each entry."""
    entries = [[int(x * 2**BITS // 1) for x in row] for row in X]
    return Ball(entries, math.ceil(off * 2**BITS) + len(X[0]))


def length(X: Ball) -> list[Fraction]:
    """A bound of the square of the length of every row."""
    miss = Fraction(X.missed, 2**BITS)
    found = []
    for row in X.middle:
        found.append(sum((abs(x) + miss) ** 2 for x in row) + ZERO)
    return found


def trace(X: Matrix) -> Fraction:
    """The sum of the diagonal."""
    return sum((row[k] for k, row in enumerate(X)), ZERO)


def largest(P: Matrix) -> Fraction:
    """A bound of the largest eigenvalue of P > 0."""
    size = trace(P)
    power = [[x / size for x in row] for row in P]
    for _ in range(POWER):
        power = product(power, power)
    part = trace(power)
    for _ in range(POWER):
        part = root(part)
    return size * part


def lyapunov(F: Matrix, N: Matrix) -> Matrix:
    """The symmetric P with F'P + P F = -N, by elimination of its entries."""
    q = len(F)
    places = [(i, j) for i in range(q) for j in range(i, q)]
    number = {}
    for k, (i, j) in enumerate(places):
        number[i, j] = number[j, i] = k
    rows = []
    for i, j in places:
        row = [ZERO] * len(places)
        for r in range(q):
            row[number[r, j]] += F[r][i]
            row[number[i, r]] += F[r][j]
        rows.append(row)
    entries = solved(rows, [[-N[i][j]] for i, j in places])
    return [[entries[number[i, j]][0] for j in range(q)] for i in range(q)]


def amplitude(case: Case, i: int) -> Fraction:
    """A bound of every component of d_i: given, or of the sines that xi0 starts; there A^2 has to
    be diagonal."""
    # sines of unknown frequencies come on top
    beside = sum((band[2] for band in case.bands), ZERO)
    if case.actuators.amplitude is not None or not case.q:
        return Fraction(case.actuators.amplitude or 0) + beside
    if i not in case.place:
        return ZERO
    steps = case.timing is not None and case.timing.steps
    need(not steps, "agents move in steps, and no amplitude is given")
    plant = case.uncertainty
    # with a drift d leaves the sines that its start gives
    need(plant is None or plant.drift == 0, "amplitudes drift, and none is given")
    residual = case.residuals[case.place[i]]
    given = read(case.xi0 or [], [[rational]])
    # one row for all agents, or one for each
    x: Matrix = transpose(given[min(i, len(given) - 1) :][:1])
    need(len(x) == len(residual.A), "there is no start of the disturbance")
    square = product(residual.A, residual.A)
    # A^2 diagonal: every component swings at one frequency
    need(is_diagonal(square), "d is no sum of sines")
    z = [row[k] for k, row in enumerate(square)]
    slopes = product(residual.A, x)
    sums = [beside] * case.m
    # A^2 = -w on the components of one frequency: each is a sine of size sqrt(x^2 + x'^2 / w)
    for w in {-entry for entry in z}:
        for c, row in enumerate(residual.C):
            part = [[y if z[k] == -w else ZERO for k, y in enumerate(row)]]
            value = product(part, x)[0][0]
            slope = product(part, slopes)[0][0]
            need(w > 0 or w == slope == 0, "the disturbance may grow")
            sums[c] += root(value**2 + slope**2 / w) if w else abs(value)
    return max(sums)
