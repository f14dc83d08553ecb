"""Inputs that saturate: what is left of them for the pins (theory, section 14).

u_i = -k_i e_i - dhat_i, cut at |u_i| <= ubar_i by component; couplings act outside the actuator.
The observer is fed the input that was applied, so that eps is untouched.  Where |dhat_i| <= dbar_i
for all time, at unpinned agents too, the pin pulls at least as clip(k_i e_i) at +-(ubar_i - dbar_i)
does: it may be stronger, so that the function bounds rows, and says nothing about places of rest.
"""

from dataclasses import replace
from fractions import Fraction
from functools import lru_cache

from dobc_design._checks import noun
from dobc_design.coupling.coupling import Coupling, make_coupling
from dobc_design.exact.definite import decide_positive_definite
from dobc_design.exact.interval import Box, IntervalMatrix, interval_product
from dobc_design.exact.matrix import (
    Matrix,
    Vector,
    add,
    dot,
    identity,
    inverse,
    multiply,
    scale,
    solve_lyapunov,
    subtract,
    trace,
    transpose,
)
from dobc_design.exact.number import ONE, ZERO, number_text, root_above
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.groups import group_numbers
from dobc_design.problem.uncertainty import ABSOLUTE

from .arcs import Pin, with_pins
from .loop import Loop, pins_of
from .timing import sampled

ROOTS = 10**15  # roots are rounded up to multiples of 1/ROOTS
LARGEST_ORDER = 12  # of an exosystem, whose Lyapunov equation is solved exactly
TILT = Fraction(1, 100)  # of the norm of C'C, which makes the Lyapunov equation definite
DOUBLINGS = 12  # of the samples over which errors are followed
SQUARINGS = 3  # lambda_max(P) <= the 8th root of tr P^8
#: Rooms are rounded down, and count for errors of estimates that are a little larger than asked.
UNIT = 10**9
MORE = 1 + Fraction(1, 10**6)
IN_HAND = 1 + Fraction(1, 10**9)  # for a second program that rounds roots otherwise
FIXED = ("target of saturated pins",)


@noun
class Rooms:
    """What saturation leaves, by agent with a limit. ``compensation``: a bound of |dhat_i| by
    component; ``room``: the limit less that, for the pin, which may be <= 0."""

    compensation: dict[int, Fraction]
    room: dict[int, Fraction]


def rooms_of(loop: Loop, W: Matrix | None, *, allowed: Fraction | None = None) -> Rooms | str:
    """What is left of the limits with the observer gain W (q, m), or why no bound of the estimates
    is known.  Exact, rounded towards the smaller room.  ``allowed``: |eps_i(0)|, by default that
    of the region."""
    table = loop.actuators
    plant = loop.uncertainty
    acts = plant is not None and any(getattr(plant, name) for name in ABSOLUTE)
    if acts or (plant is not None and not plant.known_to_agents):
        return "what [uncertainty] states acts on the estimates, too."
    if loop.fixed not in ((), FIXED):
        return "what is left of pins to several nodes is not known."
    disturbances = largest_disturbance(loop)
    if table is None or disturbances is None:
        return "no bound of the disturbance is known: give actuators.amplitude."
    errors = _largest_errors(loop, W, allowed_error(loop) if allowed is None else allowed)
    if errors is None:
        return "no bound of the estimation error is known with this observer."
    compensation = {}
    room = {}
    numbers = group_numbers(loop.groups, loop.labels)
    for agent, label in enumerate(loop.labels):
        limit = table.limit_of(label)
        if limit is not None:
            # Agents outside all groups have no disturbance, and no estimate of one.
            error = errors[numbers[agent]] if numbers[agent] < len(errors) else ZERO
            needed = (disturbances[agent] + error) * IN_HAND
            compensation[agent] = needed
            room[agent] = Fraction((limit - needed) * UNIT // 1, UNIT)
    return Rooms(compensation=compensation, room=room)


def allowed_error(loop: Loop) -> Fraction | None:
    """The largest |eps_i(0)| that the rooms count for; None where inputs do not saturate."""
    if not loop.saturates or loop.starts is None:
        return None
    return (loop.starts.disturbance or ZERO) * MORE


@lru_cache(maxsize=16)
def saturated(loop: Loop, W: Matrix | None) -> Loop:
    """The loop whose pins are cut: arcs to a fixed node; as it is where something takes all of a
    limit, which the check ``actuators`` says."""
    rooms = rooms_of(loop, W)
    if isinstance(rooms, str) or min(rooms.room.values(), default=ZERO) <= 0:
        return loop
    cut = {agent: gain for agent, gain in loop.pins.gains.items() if agent in rooms.room}
    if not cut:
        return loop
    made: dict[str, Coupling] = {}  # what agents with the same gain and room share
    pins = []
    for agent, gain in cut.items():
        end = number_text(rooms.room[agent])
        text = f"clip(({number_text(gain[0][0])})*y, -({end}), {end})"
        if text not in made:
            made[text] = make_coupling(text, dimension=loop.m)
        pins.append(Pin(agent, made[text], ONE))
    kept = pins_of({i: gain for i, gain in loop.pins.gains.items() if i not in cut})
    found = with_pins(loop, dict.fromkeys(loop.modes, pins), *FIXED)
    return replace(found, pins=kept, pulls=kept)


def _largest_errors(
    loop: Loop, W: Matrix | None, allowed: Fraction | None
) -> list[Fraction] | None:
    """For each group a bound of every component of C eps_i(t), t >= 0; None where none is known."""
    if not loop.groups or not allowed:
        return [ZERO] * len(loop.groups)
    if W is None:
        return None
    found = []
    for group, gain in loop.observed(W):
        if loop.timing is not None and loop.is_sampled:
            ticks = sampled(group.exosystem, loop.timing)
            peak = _sampled_peak(ticks.error(gain, loop.timing.period), ticks.C)
        else:
            peak = _peak(group.exosystem, gain)
        if peak is None:
            return None
        found.append(peak * allowed)
    return found


def _peak(exosystem: Exosystem, W: Matrix) -> Fraction | None:
    """A bound of |c e^(F t)|_2 for every row c of C, F = A - W C: eps'P eps falls where F'P + P F =
    -N < 0, so that (c eps)^2 <= (c P^-1 c') lambda_max(P) |eps(0)|^2.  None where F is not Hurwitz,
    or too large."""
    C = exosystem.C
    q = exosystem.order
    if q > LARGEST_ORDER:
        return None
    seen = multiply(transpose(C), C)
    # Where nothing is seen any N > 0 will do.
    tilt = TILT * (trace(seen) or 1)
    N = add(seen, scale(tilt, identity(q)))
    P = solve_lyapunov(subtract(exosystem.A, multiply(W, C)), N)
    if P is None or not decide_positive_definite(P).is_proved:
        return None
    inverted = inverse(P)
    most = max(dot(multiply((c,), inverted)[0], c) for c in C)
    return root_above(most * _largest_eigenvalue(P), unit=ROOTS)


def _sampled_peak(F: IntervalMatrix, C: IntervalMatrix) -> Fraction | None:
    """A bound of |c F^k|_2 for every row c of C and every k: that for k < K, where |F^K| <= 1.
    None where no such K is found."""
    if len(F) > LARGEST_ORDER:
        return None
    rows = C
    power = F
    for _ in range(DOUBLINGS):
        if sum(map(_square, power)) <= 1:
            return root_above(max(map(_square, rows)), unit=ROOTS)
        rows = (*rows, *interval_product(rows, power))
        power = interval_product(power, power)
    return None


def _square(row: Box) -> Fraction:
    """A bound of the square of its length."""
    return sum((x.magnitude**2 for x in row), ZERO)


def _largest_eigenvalue(P: Matrix) -> Fraction:
    """A bound of lambda_max(P) of a P > 0."""
    size = trace(P)
    power = scale(1 / size, P)
    for _ in range(SQUARINGS):
        power = multiply(power, power)
    part = trace(power)
    for _ in range(SQUARINGS):
        part = root_above(part, unit=ROOTS)
    return size * part


def largest_disturbance(loop: Loop) -> Vector | None:
    """For each agent a bound of |d_i(t)|, t >= 0, by component; None where neither [actuators] nor
    xi0 gives one, as where amplitudes drift, or agents move in steps."""
    given = None if loop.actuators is None else loop.actuators.amplitude
    # Sines of unknown frequencies come on top of what the exosystem generates.
    sines = sum((band.amplitude for band in loop.bands), ZERO)
    if given is not None or not loop.groups:
        return ((given or ZERO) + sines,) * loop.n
    steps = loop.timing is not None and loop.timing.steps
    if steps or not loop.xi0 or (loop.uncertainty is not None and loop.uncertainty.drift):
        return None
    starts = loop.xi0 if len(loop.xi0) > 1 else loop.xi0 * loop.n
    known: dict[tuple[int, Vector], Fraction | None] = {}  # agents often start alike
    found: list[Fraction] = []
    for pair in zip(group_numbers(loop.groups, loop.labels), starts, strict=True):
        number, start = pair
        if pair not in known:
            is_free = number == len(loop.groups)  # of disturbances
            own = ZERO if is_free else _amplitude(loop.groups[number].exosystem, start)
            known[pair] = own if is_free or own is None else own + sines
        amplitude = known[pair]
        if amplitude is None:
            return None
        found.append(amplitude)
    return tuple(found)


def _amplitude(exosystem: Exosystem, start: Vector) -> Fraction | None:
    """A bound of every component of C exp(A t) start.  If A^2 is diagonal, xi_i'' = -w_i^2 xi_i:
    what the components with one w^2 add is a sine, or with w = 0 constant where its slope is 0.
    None for others."""
    A = exosystem.A
    q = exosystem.order
    squares = multiply(A, A)
    if any(squares[i][j] for i in range(q) for j in range(q) if i != j):
        return None
    slopes = tuple(row[0] for row in multiply(A, tuple((x,) for x in start)))
    sums = [ZERO] * exosystem.outputs
    for square in {-squares[i][i] for i in range(q)}:
        alike = [i for i in range(q) if squares[i][i] == -square]
        for row, c in enumerate(exosystem.C):
            value = sum((c[i] * start[i] for i in alike), ZERO)
            slope = sum((c[i] * slopes[i] for i in alike), ZERO)
            if square < 0 or (square == 0 and slope):
                return None
            if square:
                sums[row] += root_above(value**2 + slope**2 / square, unit=ROOTS)
            else:
                sums[row] += abs(value)
    return max(sums)
