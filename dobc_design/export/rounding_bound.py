"""How far the C code may be from the double-precision loop: running error analysis along recorded
samples.

Every operation is taken to be off by one unit roundoff u, every function of <math.h> by four
(glibc, newlib and musl stay below), and errors are carried on to first order with the recorded
values; the sum is doubled.  An error of the estimate is carried from sample to sample by Ad,
because the recorded states do not answer to it.
"""

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import accumulate, repeat

import numpy as np
from numpy.typing import NDArray

from dobc_design._checks import noun, positional
from dobc_design.coupling.expression import Expression, evaluated
from dobc_design.coupling.functions import FUNCTIONS, applied
from dobc_design.exact.matrix import Array, to_float
from dobc_design.problem.dynamics import expressions_of

from .c_controller import AgentNumbers, Controller

ROUNDOFF = {"double": 2.0**-53, "float": 2.0**-24}
LIBRARY = 4.0  # units of roundoff of a function of <math.h>


@positional
class Erring:
    """Values and bounds on their errors, arrays of one shape."""

    value: Array
    error: Array


class ErringAlgebra:
    """Algebra (``coupling.tree.Algebra``) of values with errors, at the unit roundoff ``u``."""

    def __init__(self, u: float) -> None:
        self.u = u

    def constant(self, value: Fraction) -> Erring:
        return self._made(np.asarray(float(value)), np.asarray(0.0))

    def pi(self) -> Erring:
        return self._made(np.asarray(np.pi), np.asarray(0.0))

    def negate(self, operand: Erring) -> Erring:
        return Erring(-operand.value, operand.error)

    def add(self, left: Erring, right: Erring) -> Erring:
        return self._made(left.value + right.value, left.error + right.error)

    def subtract(self, left: Erring, right: Erring) -> Erring:
        return self.add(left, self.negate(right))

    def multiply(self, left: Erring, right: Erring) -> Erring:
        carried = abs(left.value) * right.error
        carried = carried + abs(right.value) * left.error
        carried = carried + left.error * right.error
        return self._made(left.value * right.value, carried)

    def divide(self, left: Erring, right: Erring) -> Erring:
        value = left.value / right.value
        room = abs(right.value) - right.error
        safe = room > 0  # else the divisor may be 0
        carried = (left.error + abs(value) * right.error) / np.where(safe, room, 1)
        return self._made(value, np.where(safe, carried, np.inf))

    def power(self, base: Erring, exponent: int) -> Erring:
        count = abs(exponent)
        # The slope is largest at the end that is farthest from 0.
        largest = (abs(base.value) + base.error) ** max(0, count - 1)
        carried = count * largest * base.error
        positive = self._made(base.value**count, carried, times=count)
        if exponent >= 0:
            return positive
        return self.divide(self.constant(Fraction(1)), positive)

    def call(self, name: str, arguments: tuple[Erring, ...]) -> Erring:
        return applied(name, arguments, self, self._called)

    def _called(self, name: str, *operands: Erring) -> Erring:
        row = FUNCTIONS[name]
        of = row.found_in(np, "numpy")
        # min and max pick one of two numbers, and do not round.
        if len(operands) == 2:
            left, right = operands
            return Erring(of(left.value, right.value), np.maximum(left.error, right.error))
        (inner,) = operands
        # An error grows by the steepest slope within reach of it.
        slope = 1.0
        if row.steepest is not None:
            slope = row.steepest(inner.value, abs(inner.value) + inner.error)
        return self._made(of(inner.value), slope * inner.error, times=LIBRARY)

    def _made(self, value: Array, carried: Array, *, times: float = 1.0) -> Erring:
        rounding = times * self.u * abs(value)
        return Erring(np.asarray(value), np.asarray(carried + rounding))


@noun(eq=False)
class Recorded:
    """One agent's samples in the double-precision loop of a controller.  Shapes: x (S, m), u, v,
    dhat (S, p), heard (S, neighbours, m), xihat (S, q), modes (S,)."""

    controller: Controller
    agent: AgentNumbers
    modes: NDArray[np.int64]
    x: Array
    heard: Array
    xihat: Array
    dhat: Array
    u: Array
    v: Array


def estimated(measured: Recorded) -> Recorded:
    """The samples of an agent of whose states, and of those that it hears, outputs are measured:
    what it has to answer, with estimates that follow from y alone."""
    controller, agent = measured.controller, measured.agent
    Ad, Cd, L, H = map(to_float, (controller.Ad, controller.Cd, controller.L, controller.outputs))
    m = measured.x.shape[1]
    ys = measured.x @ H[:, :m].T
    if not controller.estimated:
        measured = replace(measured, heard=measured.heard @ H[:, :m].T)
    z = to_float(controller.begin) @ ys[0]
    rows = []
    for k, y in enumerate(ys):
        e = (z[:m] if controller.estimated else y) - to_float((agent.goal,))
        here = replace(measured, modes=measured.modes[k : k + 1], heard=measured.heard[k : k + 1])
        dhat = Cd @ z
        u = to_float((agent.rest or (),))[0] - to_float(agent.gain) @ e[0] - dhat
        v = felt_with_error(here, e, 0 * e, 0.0).value[0] + u
        rows.append((z, dhat, u, v))
        z = Ad @ z + to_float(controller.push) @ v + L @ (y - H @ z)
    xihat, dhats, us, vs = map(np.array, zip(*rows, strict=True))
    return replace(measured, x=ys, xihat=xihat, dhat=dhats, u=us, v=vs)


def rounding_bound(recorded: Recorded) -> float:
    """The largest difference of u, v and dhat between C code of the controller's precision and the
    recorded samples."""
    # The recorded loop is in double precision: its own errors stand between the two as well.
    with np.errstate(all="ignore"):
        own = _bound(recorded, ROUNDOFF[recorded.controller.precision])
        loops = _bound(recorded, ROUNDOFF["double"])
    return 2 * (own + loops)


def _bound(recorded: Recorded, u: float) -> float:
    controller, agent = recorded.controller, recorded.agent
    q = controller.q
    m = controller.problem.m
    goal = to_float((agent.goal,))[0]
    gain = abs(to_float(agent.gain))
    x = recorded.xihat[:, :m] if controller.estimated else recorded.x
    e = x - goal
    # of e: its input, the goal, the difference
    size_of_e = abs(e)
    own = u * (abs(x) + abs(goal) + size_of_e)
    off = np.zeros(q)
    if controller.outputs:
        off = _estimate_error(recorded, u)
    if controller.estimated:
        own = own + off[:m]
    # Every operation below adds one u of its result; a product of a row and a column one for each.
    felt = felt_with_error(recorded, e, own, u)
    pull = own @ gain.T + (m + 2) * u * size_of_e @ gain.T
    sized = abs(felt.value) + size_of_e @ gain.T
    if agent.rest is not None:
        sized = sized + abs(to_float((agent.rest,))[0])
    # Without an observer u and v are all there is, and nothing is carried on.
    if q == 0:
        return float(np.max(felt.error + pull + 3 * u * sized))
    Ad = to_float(controller.Ad)
    told = abs(to_float(controller.told))
    L = abs(to_float(controller.L))
    size = abs(recorded.xihat) @ told.T
    held = felt.error + pull + (q + 2) * u * size + 3 * u * (sized + size) + told @ off
    if controller.outputs:
        return float(max(np.max(held), np.max(off)))
    surprise = _innovation(recorded, held, u)
    expected = abs(recorded.xihat[:-1]) @ abs(to_float(controller.Cd)).T
    local = surprise.error + (q + 2) * u * expected
    moved = abs(recorded.xihat[:-1]) @ abs(Ad).T + surprise.value @ L.T
    estimate = (q + m + 3) * u * moved + local @ L.T
    # What every sample adds to the error of the estimate lives on, with the powers of Ad.
    powers = accumulate(repeat(Ad, len(recorded.x) - 2), np.matmul, initial=np.eye(q))
    carried = sum(map(abs, powers), np.zeros((q, q))) @ np.max(estimate, axis=0, initial=0.0)
    return float(np.max(held) + np.max(told @ carried))


def _estimate_error(recorded: Recorded, u: float) -> Array:
    """How far an estimate may be off that follows from a sample as it was recorded, (q,)."""
    controller = recorded.controller
    z, v, y = (np.max(abs(each), axis=0) for each in (recorded.xihat, recorded.v, recorded.x))
    moved = abs(to_float(controller.Ad)) @ z + abs(to_float(controller.push)) @ v
    moved += abs(to_float(controller.L)) @ (y + abs(to_float(controller.outputs)) @ z)
    moved += abs(to_float(controller.begin)) @ y
    # Sums have fewer terms than two estimates; these were rounded before, and so are the sums.
    return np.asarray(4 * (len(z) + 1) * u * moved)


def _innovation(recorded: Recorded, held: Array, u: float) -> Erring:
    """Sizes of what the samples tell beside the expected disturbance, and bounds on the errors, (S
    - 1, p) each."""
    controller = recorded.controller
    motion = to_float(controller.motion)
    push = to_float(controller.push)
    watch = to_float(controller.watch)
    x, before = recorded.x[1:], recorded.x[:-1]
    # what acted: nothing before the first answer did
    waiting = np.zeros((controller.late, recorded.v.shape[1]))
    v = np.vstack([waiting, recorded.v])[: len(x)]
    held = np.vstack([waiting, held])[: len(x)]
    # An f is computed from the measured state, with rounding errors of its own.
    own = Erring(before, np.zeros_like(before))
    dynamics = controller.problem.dynamics
    if dynamics is not None and dynamics.f is not None:
        measured = Erring(before, u * abs(before))
        own = with_errors(expressions_of(dynamics), measured, ErringAlgebra(u))
    apart = x - before - own.value @ motion.T - v @ push.T
    moved = abs(x) + abs(before)
    moved = moved + abs(own.value) @ abs(motion).T + abs(v) @ abs(push).T
    terms = np.count_nonzero(motion) + np.count_nonzero(push)
    rounding = (terms + 3) * u * moved
    error = held @ abs(push).T + rounding + (len(motion) + 2) * u * abs(apart)
    error += own.error @ abs(motion).T
    size = abs(apart @ watch.T - recorded.xihat[:-1] @ to_float(controller.Cd).T)
    return Erring(size, error @ abs(watch).T)


def felt_with_error(recorded: Recorded, e: Array, own: Array, u: float) -> Erring:
    """The couplings at every sample with bounds on their errors, (S, p) each; ``own`` bounds the
    error of e."""
    algebra = ErringAlgebra(u)
    problem = recorded.controller.problem
    total = np.zeros((len(e), problem.inputs))
    error, size = total.copy(), total.copy()
    for mode, hearings in enumerate(recorded.agent.modes):
        here = recorded.modes == mode
        for arc in hearings:
            sign = -1 if arc.weight < 0 else 1
            heard = sign * recorded.heard[here, arc.neighbour]
            y = heard - e[here]
            difference = Erring(y, own[here] + u * (abs(heard) + abs(y)))
            h = with_errors(problem.couplings[arc.coupling].components, difference, algebra)
            weight = abs(float(arc.weight))
            total[here] += weight * h.value
            size[here] += abs(weight * h.value)
            error[here] += weight * h.error
    # Sums of so many terms, each rounded once more.
    most = max((len(each) for each in recorded.agent.modes), default=0)
    return Erring(total, error + (most + 2) * u * size)


def with_errors(functions: Sequence[Expression], y: Erring, algebra: ErringAlgebra) -> Erring:
    """Functions of y (S, m), as ``evaluated`` takes them, with a bound on their errors."""
    components = zip(y.value.T, y.error.T, strict=True)
    values, errors = [], []
    for each in evaluated(functions, [Erring(*each) for each in components], algebra):
        # A constant is one number for all samples.
        value, error, _ = np.broadcast_arrays(each.value, each.error, y.value[:, 0])
        values.append(value)
        errors.append(error)
    return Erring(np.stack(values, axis=-1), np.stack(errors, axis=-1))
