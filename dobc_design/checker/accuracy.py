"""accuracy: boxes that shrink down to final bounds of |e_i| although disturbances, drift and noise
act on the loop.

What acts on agent i besides its row is at most b_i for all times, once the estimation errors of the
start have decayed; until then they are part of V, as in max-separable. The peak gains in b_i are
sums over steps in integers. Of a linear loop in one mode the peak gains of the whole loop give the
bounds, without boxes.
"""

import math
from fractions import Fraction
from functools import cache, partial
from itertools import accumulate, pairwise
from operator import mul
from types import SimpleNamespace
from typing import Any, NamedTuple

from .arcs import around, decreases, read_claim
from .bands import need_bands
from .channels import channel_of, entries, is_estimated
from .claims import Case
from .consensus import jacobian, own
from .coordinates import inverse, shown, sizes
from .curves import Curve, secants
from .expressions import Coupling
from .files import ERRORS
from .intervals import enclosed
from .loop import Arc, Loop, Residual
from .matrices import (
    ZERO,
    Matrix,
    Vector,
    combined,
    diagonal,
    identity,
    integers,
    norm,
    paired,
    plus,
    product,
    root,
    transpose,
)
from .quadratic import gains_shape
from .reading import Object, an_object, index, matrix, maybe, need, rational, read, weights
from .separable import (
    Errors,
    Heard,
    Row,
    composite,
    curved_row,
    frame,
    holds_box,
    linear_row,
    observed,
    spread,
    starts,
    tables,
)

STAGES = 30
SWEEPS = 30  # over the coordinates, to balance them
STEPS = 20_000
GROWTH = 2000  # of |F| h steps
AGENTS = 500
TURNS = 2  # how often sines are integrated
PRODUCTS = 20_000_000  # of numbers, along the steps of a whole loop
NAMES = ("disturbance", "drift", "measurement")
#: Of an observer that passes nothing on.
NOTHING: Object = {**dict.fromkeys(NAMES, ZERO), "bands": None, "off": None}
#: The plant of a file without `uncertainty`.
EXACT = SimpleNamespace(**dict.fromkeys(ERRORS, ZERO), known_to_agents=True, bands=None)


def accuracy(case: Case, check: Any) -> None:
    """The peak gains, the starts in the first box, every box in the next one, the rows, and the
    bounds at the end."""
    asked = case.uncertainty is not None and check.rate is None
    need(asked, "there is no [uncertainty], or it claims a rate")
    need(case.n <= AGENTS, f"there are more than {AGENTS} agents")
    if "balls" in (check.exact or {}):
        by_balls(case, check)
        return
    linear = case.domain == "global"
    everywhere = not linear or check.domain == "global"
    need(everywhere, "the couplings are linear, and the domain is not global")
    if "response" in (check.exact or {}):
        whole_loop(case, check)
    else:
        by_stages(case, check)


def acting(case: Case, peaks: Any) -> Any:
    """What acts on every agent in the end, by the matrix of ``entries``: w + C eps, or what is left
    of measured outputs."""
    return irregular(case, peaks) + sines(case, peaks)


def irregular(case: Case, peaks: Any) -> Any:
    """The part of it that is of any shape."""
    plant = case.uncertainty
    passed = plant.drift * peaks.drift
    if is_estimated(case):
        passed += plant.measurement * peaks.measurement
        return plant.disturbance * peaks.disturbance + passed
    return plant.disturbance * (1 + peaks.disturbance) + passed


def sines(case: Loop, peaks: Any) -> Fraction:
    """The part that is left of sines in bands."""
    return sum(sines_by_band(case, peaks), ZERO)


def sines_by_band(case: Loop, peaks: Any) -> Vector:
    """The same of every band."""
    skipped = case.m * is_estimated(case)
    return [max(rows[: len(rows) - skipped]) for rows in left_by_row(case, peaks)]


def left_by_row(case: Loop, peaks: Any) -> Matrix:
    """What is left of the sines of every band, by row of its gains: each row has its own share of
    all components."""
    if not peaks.bands:
        return []
    both = paired(case.uncertainty.bands, peaks.bands)
    return [[amplitude * sum(row, ZERO) for row in gains] for (_, _, amplitude), gains in both]


def off(case: Case, peaks: Any) -> Vector:
    """How far states end from their estimates, by component, where errors are those of these."""
    found = [ZERO] * case.m
    if is_estimated(case):
        found = peaks.off or found
        for rows in left_by_row(case, peaks):
            found = combined(found, 1, rows[-case.m :])
    return found


# --- Boxes
def by_stages(case: Case, check: Any) -> None:
    """The form with boxes."""
    curved = case.domain != "global"
    turned = "T" in (check.exact or {})
    if not turned:
        by_component = case.B is None and all(h.single for h in case.functions)
        need(by_component, "there are dynamics, or a coupling is a list")
    exact, peaks = with_peaks(case, check, stages_shape(case, turned))
    stages = exact.stages
    need(1 <= len(stages) <= STAGES, f"there is not between 1 and {STAGES} stages")
    for each in stages:
        need(each.alpha > 0 and each.level > 0, "a number of a stage is not positive")
        need((each.rho is not None) == curved, "rho is not what these couplings need")
        need(each.rho is None or each.rho >= each.level, "rho is below the level")
    T = frame(exact)
    S = inverse(T)
    if curved:
        starts(case, check.domain, "box")
        first = SimpleNamespace(**vars(exact) | vars(stages[0]))
        holds_starts(case, check.domain, first)
    # a run that has come down to the level of a stage lies in the box of the next
    for before, after in pairwise(stages):
        inner = paired(before.v, after.v)
        need(
            curved and all(before.level * x < after.rho * y for x, y in inner),
            "a stage does not hold the box before",
        )
    for each in stages:
        if turned:
            shrinks_turned(case, T, each, peaks)
        else:
            shrinks(case, each, peaks)
    last = stages[-1]
    missed = off(case, peaks) if turned else [ZERO]
    for label, end in paired(case.labels, sizes(S, last.v)):
        listed = exact.bounds[label]
        bounds = read(listed, (rational,) * case.m) if turned else [rational(listed)]
        ends = combined(missed, last.level, end)
        need(all(x >= y for x, y in paired(bounds, ends)), "a bound is too small")


def stages_shape(loop: Loop, turned: bool) -> Object:
    """The shape of the form with boxes; ``turned``: in coordinates."""
    size = loop.size if turned else loop.n
    stage = {
        "v": partial(weights, size),
        "alpha": rational,
        "level": rational,
        "rho": maybe(rational),
    }
    shape: Object = {"stages": [stage], "bounds": an_object}
    if turned:
        stage["ranges"] = gains_shape(loop.m)
        shape["T"] = matrix(loop.m, loop.m)
    if loop.domain != "global":
        shape |= observed(loop)
    return shape


def holds_starts(case: Case, domain: Any, claim: Any) -> None:
    """All starts lie in the box of a stage, and V = N + kappa E does not leave it."""
    if case.q:
        need(claim.kappa * claim.beta * min(claim.v) > 1, "kappa is too small")
    composite(case, claim)
    # runs may start inside the level, too, and disturbances bring them back to it
    radius = max(domain.radius, claim.level / spread(frame(claim), claim.v))
    holds_box(claim, radius, domain.disturbance, claim.rho)


def shrinks_turned(case: Case, T: Matrix, stage: Any, peaks: Any) -> None:
    """All rows of a stage in coordinates, with what acts on each agent, on [level, rho]: they are
    linear."""
    load = [b / stage.level for b in entering(case, T, peaks)]
    shown(case, SimpleNamespace(**vars(stage), T=T), inverse(T), load)


def entering(case: Case, T: Matrix, peaks: Any) -> Vector:
    """What acts on the components of T e, agent by agent."""
    plant = case.uncertainty
    seen = plant.measurement == 0 or is_estimated(case)
    need(seen, "measurement noise is not known in coordinates")
    weights_known = plant.weights == plant.gains == 0
    need(weights_known, "errors of weights and gains are not known in coordinates")
    acts = [row for each in entries(case) for row in product(T, each)]
    return [acting(case, peaks) * sum(map(abs, row)) for row in acts]


class Added(NamedTuple):
    """What all that acts adds to the input of an agent: a part of N, and a number."""

    part: Fraction = ZERO
    number: Fraction = ZERO


class Loads:
    """What acts on the agents while the box of a stage holds them."""

    def __init__(self, loop: Loop, stage: Any, peaks: Any) -> None:
        self.loop = loop
        self.plant = loop.uncertainty or EXACT
        self.peaks = peaks
        self.rho = stage.rho
        v, self.bottom = integers(stage.v)
        self.v = loop.with_fixed(v)
        # of a difference of two measured states, which that of a pair is
        self.noise = self.plant.measurement * (1 if loop.differences else 2)
        self.added = cache(self.find_added)
        self.steepest = cache(self.find_steepest)
        self.secant = cache(self.find_secant)

    def find_steepest(self, h: Coupling, width: int) -> Fraction:
        """A bound of the slope of h, which is one of h(y)/y as well, on |y| <= rho width, and
        noise more."""
        if self.rho is None:
            return self.find_secant(h, width)
        reach = enclosed(self.rho * Fraction(width, self.bottom) + self.noise)[1]
        # noise moves both ends of a difference, so that slopes are asked for a little further out
        found = max(map(abs, Curve(h, False).at((-reach, reach))[1]))
        need(math.isfinite(found), "a slope is not bounded")
        return Fraction(found)

    def find_secant(self, h: Coupling, width: int) -> Fraction:
        """A bound of |h(y)/y| on |y| <= rho width."""
        if self.rho is None:
            return max(map(abs, h.slope(0, 0)))
        return max(secants(h, enclosed(self.rho * Fraction(width, self.bottom))[1]))

    def by_noise(self, i: int, heard: list[Arc]) -> Fraction:
        """What noise adds by the arcs of a mode: 2 nu (1 + dw) H."""
        if not self.noise:
            return ZERO
        slopes = ZERO
        for arc in heard:
            slopes += arc.w * self.steepest(arc.coupling, self.v[i] + self.v[arc.j])
        plant = self.plant
        # an arc to a node whose error is 0 may be a pin
        error = max(plant.weights, plant.gains) if self.loop.fixed else plant.weights
        return Fraction(self.noise * (1 + error) * slopes)

    def pulled(self, i: int, heard: list[Arc]) -> Fraction:
        """What the arcs of a mode add to an input, by their weights."""
        found = ZERO
        for arc in heard:
            width = self.v[i] + self.v[arc.j]
            found += arc.w * width * self.secant(arc.coupling, width)
        return found

    def on(self, i: int, heard: list[Arc]) -> Fraction:
        """What acts on an agent, as a number, by the arcs of a mode."""
        return Fraction(self.plant.disturbance + self.by_noise(i, heard) + self.added(i).number)

    def find_added(self, i: int) -> Added:
        """What an observer passes on to an input: it may have seen any mode."""
        plant = self.plant
        peaks = self.peaks
        modes = [heard[i] for heard in self.loop.heard.values()]
        k = (1 + plant.gains) * self.loop.gain_size(i)
        number = plant.disturbance * peaks.disturbance + plant.drift * peaks.drift
        number += plant.measurement * (peaks.measurement + k) + sines(self.loop, peaks)
        number += peaks.disturbance * max(self.by_noise(i, heard) for heard in modes)
        if plant.known_to_agents or not plant.weights * peaks.disturbance:
            return Added(ZERO, number)
        eta = plant.weights * peaks.disturbance * max(self.pulled(i, heard) for heard in modes)
        return Added(eta / self.bottom, number)


def shrinks(loop: Loop, stage: Any, peaks: Any) -> list[Added]:
    """Both faces of all rows of a stage, with what acts on each agent, on [level, rho]: each weight
    and gain at its worse end. Returned: what of this is added to the input of every agent."""
    loads = Loads(loop, stage, peaks)
    plant = loads.plant
    v = loads.v
    bottom = loads.bottom
    added = [loads.added(i) for i in loop.nodes]
    curves = tables(loop, stage.rho, (v, v, bottom))
    for i, heard in loop.rows:
        load = loads.on(i, heard)
        arcs = [Heard(arc.coupling, arc.w, v[arc.j], arc.loose) for arc in heard]
        c = (loop.least_gain(i, plant.gains) - stage.alpha) * v[i] - added[i].part * bottom
        row = Row(v[i], c, tuple(arcs))
        if stage.rho is None:
            # for all s >= level: it is hardest there
            most = load * bottom / stage.level
            holds = linear_row(row, Errors(plant.weights, plant.gains, load=most))
        else:
            errors = Errors(plant.weights, plant.gains, load, stage.level)
            holds = curved_row(row, bottom, stage.rho, curves, errors)
        need(holds, f"the row of agent {loop.labels[i]} is not shown")
    return added


# --- Arc-wise balls
def by_balls(case: Case, check: Any) -> None:
    """V falls in every ball to where the next one begins, and in the last one down to the
    bounds."""
    shape = {"balls": [partial(read_claim, case)], "bounds": an_object}
    exact, peaks = with_peaks(case, check, shape)
    balls = exact.balls
    need(1 <= len(balls) <= STAGES, f"there is not between 1 and {STAGES} balls")
    need(getattr(check.domain, "kind", None) == "box", "the starts are no box")
    around(case, balls[0], check.domain)
    felt = not is_estimated(case) and (not case.q or case.uncertainty.known_to_agents)
    need(felt, "estimates feel errors of the weights, or are those of outputs")
    for ball, after in pairwise([*balls, balls[-1]]):
        need(ball.rate > 0, "a rate is not positive")
        decreases(case, ball)
        squares = paired(ball.d, loads_in(case, ball, peaks))
        left = sum((d * x for d, x in squares), ZERO) / ball.rate**2
        held = ball.d == after.d and left < min(ball.level, after.level)
        need(held, "a ball does not hold what the one before leaves")
    for label, d in paired(case.labels, ball.d):
        bound = rational(exact.bounds[label])
        need(bound > 0 and bound**2 * d >= left, "a bound is too small")


def loads_in(case: Case, ball: Any, peaks: Any) -> Vector:
    """Of every agent the square of what acts on it in a ball, over its components."""
    if case.B is not None:
        acts = entering(case, identity(case.m), peaks)
        return [sum((b * b for b in acts[: case.m]), ZERO)] * case.n
    box = SimpleNamespace(v=[root(ball.level / d) for d in ball.d], rho=Fraction(1))
    loads = Loads(case, box, peaks)
    found = [ZERO] * case.n
    for i, heard in case.rows:
        found[i] = max(found[i], case.m * loads.on(i, heard) ** 2)
    return found


# --- The whole loop
def whole_loop(case: Case, check: Any) -> None:
    """e' = M e + (I (x) B)(w + C eps): in the end every e_ic is at most b times the integral of its
    row of |exp(M t) (I (x) B)|; that it is finite proves that M is Hurwitz."""
    plant = case.uncertainty
    shape = {"bounds": an_object, "response": steps_of("step")}
    exact, peaks = with_peaks(case, check, shape)
    need(case.domain == "global", "the couplings are not linear")
    need(not case.switches, "the response of a loop that switches is not followed")
    need(not case.signed, "rows have left out the signs")
    seen = plant.measurement == 0 or is_estimated(case)
    disturbed_only = seen and plant.weights == plant.gains == 0
    need(disturbed_only, "noise and errors are not known beside a response")
    (M,) = [jacobian(case, mode) for mode in case.modes]
    turned = [diagonal(entries(case))]
    for _ in range(TURNS * bool(case.bands)):
        turned.append(product(M, turned[-1]))
    columns = len(M) + len(turned) * len(turned[0][0])
    work = len(M) ** 2 * columns * exact.response.steps
    # that many products of integers take a minute
    need(work <= PRODUCTS, "the response takes too many steps")
    found = gains_by_row(M, identity(len(M)), turned, exact.response)
    any_shape = irregular(case, peaks)
    left = sines_by_band(case, peaks)
    missed = off(case, peaks)
    # bounds of 0 would be claims about rest, which takes for ever
    need(any_shape + sum(left) > 0, "nothing acts on the loop")
    for i, label in enumerate(case.labels):
        bounds = read(exact.bounds[label], (rational,) * case.m)
        for c, bound in enumerate(bounds):
            row = i * case.m + c
            gains = found[row]
            at_once = [sum(map(abs, each[row]), ZERO) for each in turned]
            end = missed[c] + any_shape * gains[0]
            for (low, _, _), size in paired(case.bands, left):
                end += size * passed_on(low, gains, at_once)
            need(bound >= end, "a bound is below what the loop passes on")


def passed_on(low: Fraction, gains: Vector, at_once: Vector) -> Fraction:
    """The part of a sine, of frequency ``low`` or more, that a row passes on: z is the derivative
    of a sine that is smaller by the frequency. e less E times that obeys the same equation with
    M E in place of E, which can be said again of it."""
    ways = [gains[0]]
    for k in range(1, len(gains) if low else 0):
        parts = [at_once[j] / low ** (j + 1) for j in range(k)]
        ways.append(sum(parts, gains[k] / low**k))
    return min(ways)


# --- Peak gains of the observers
def steps_of(*names: str) -> Object:
    """The shape of rationals with these names, and of steps."""
    return dict.fromkeys(names, rational) | {"steps": partial(index, STEPS + 1)}


def with_peaks(case: Case, check: Any, shape: Object) -> tuple[Any, Any]:
    """What a claim says, and the peak gains of its observer, which are shown here; 0 without an
    exosystem."""
    stated = an_object(an_object(check.exact).get("bounds"))
    need(set(stated) == set(case.labels), "there is not one bound, or list, for each agent")
    if case.q == 0:
        return read(check.exact, shape), SimpleNamespace(**NOTHING)
    wanted: Object = {}
    if takes_integrals(case):
        wanted = steps_of(*NAMES, "step")
        if is_estimated(case):
            wanted["off"] = (rational,) * case.m
    if case.bands:
        p = case.m if case.B is None else len(case.B[0])
        rows = p
        if is_estimated(case):
            rows = len(entries(case)[0][0]) + case.m
        wanted["bands"] = [matrix(rows, p)]
    exact = read(check.exact, shape | {"peaks": wanted})
    peaks = SimpleNamespace(**NOTHING | vars(exact.peaks))
    for name in case.names:
        need_peaks(case, own(case, name), peaks)
    return exact, peaks


def takes_integrals(case: Case) -> bool:
    """Whether something is stated of which an observer passes on up to an integral."""
    plant = case.uncertainty
    if plant is None:  # the value that is agreed on rests on them
        return True
    felt = plant.weights and not plant.known_to_agents
    return bool(felt or plant.disturbance or plant.drift or plant.measurement)


def need_peaks(case: Case, residual: Residual, peaks: Any) -> None:
    """The peak gains of one residual are at most those that are claimed."""
    channel = channel_of(case, residual)
    if case.bands:
        need_bands(case.bands, channel, peaks.bands)
    if not takes_integrals(case):
        return
    plant = case.uncertainty or EXACT
    inputs = [channel.disturbance, channel.drift, channel.noise]
    found = gains_by_row(channel.F, channel.C, inputs, peaks)
    for row, (disturbance, drift, noise) in enumerate(found):
        measured = noise + sum(map(abs, channel.at_once[row]))
        if row < channel.acting:
            small_enough = drift <= peaks.drift and disturbance <= peaks.disturbance
            need(small_enough, "the peak gains are not shown")
            need(measured <= peaks.measurement, "the peak gain of noise is not shown")
        else:
            total = plant.disturbance * disturbance + plant.drift * drift
            total += plant.measurement * measured
            near = total <= peaks.off[row - channel.acting]
            need(near, "how far states end from their estimates is not shown")


# --- Peak gains: bounds of the integral over t > 0 of |C exp(F t) B|, in integers. exp(F h) of one
# step has entries in units of 2^-bits that miss at most ``off`` of them; what the products of a run
# of steps miss is followed by one number.
class Step(NamedTuple):
    """exp(F h) in units of 2^-bits."""

    phi: Any
    off: int  # what an entry may miss, in units
    grown: Fraction  # an upper bound of exp(|F| h)
    bits: int


def one_step(F: Matrix, h: Fraction, steps: int) -> Step:
    """exp(F h) by its series, with as many bits as that many steps need."""
    q = len(F)
    size = norm(F)
    euler = float(norm(plus(identity(q), h, F)) + (size * h) ** 2)  # not below |exp(F h)|, about
    # a guess: too few bits only make the bounds larger
    bits = 192 + 2 * math.ceil(steps * max(0.0, math.log(euler)))
    power = identity(q)
    total = identity(q)
    rest = Fraction(1)  # (size h)^k / k!, a bound of the next term
    terms = 0
    grown = ZERO
    while rest * 2**bits > 1:  # what is left is at most rest exp(size h)
        terms += 1
        grown += rest
        power = [[x * h / terms for x in row] for row in product(power, F)]
        total = plus(total, 1, power)
        rest = rest * size * h / terms
    # not below exp(size h), rounded up to few bits
    grown = Fraction(math.ceil((grown + rest / (1 - size * h)) * 2**64), 2**64)
    off = math.ceil(rest * 2**bits * grown) + 1  # of the series, and of rounding
    return Step(in_units(total, bits), off, grown, bits)


def in_units(X: Matrix, bits: int) -> Any:
    """A matrix in units of 2^-bits, each entry within one unit."""
    return [[round(x * 2**bits) for x in row] for row in X]


class Run:
    """Z(t) = exp(F t) [I, B, ...] from step to step, each entry within ``error`` units."""

    def __init__(self, step: Step, blocks: list[Matrix]) -> None:
        self.step = step
        columns = [column for block in blocks for column in transpose(block)]
        self.Z: Any = transpose(in_units(columns, step.bits))
        self.error = 1
        ends = list(accumulate((len(block[0]) for block in blocks), initial=0))
        #: The columns of each block.
        self.cuts = [range(*pair) for pair in pairwise(ends)]

    def masses(self) -> Vector:
        """A bound of the largest row sum of |Z| in each block."""
        found = []
        for cut in self.cuts:
            most = max(sum(abs(row[j]) for j in cut) for row in self.Z)
            found.append(Fraction(most + len(cut) * self.error))
        return found

    def go_on(self) -> None:
        """One step further."""
        phi = self.step.phi
        off = self.step.off
        bits = self.step.bits
        q = len(phi)
        largest = max(abs(x) for row in self.Z for x in row)
        # (phi + off)(Z + error): what is missed, shifted down, and one unit for each rounding
        missed = (norm(phi) + q * off) * self.error + q * off * largest
        self.error = (missed >> bits) + 2
        columns = transpose(self.Z)
        self.Z = [[sum(map(mul, row, column)) >> bits for column in columns] for row in phi]


class Outputs:
    """Sums over time of |C Z|, by row of C and by block."""

    def __init__(self, C: Matrix, run: Run) -> None:
        q = len(C[0])
        top, self.unit = integers([x for row in C for x in row])
        self.weight = norm(C)
        self.rows = []
        for i in range(len(C)):
            row = top[i * q : (i + 1) * q]
            self.rows.append([(k, x) for k, x in enumerate(row) if x])
        self.totals = [[ZERO] * len(run.cuts) for _ in C]

    def add(self, run: Run, share: Fraction) -> None:
        """This share of the values of the run as it stands."""
        columns = transpose(run.Z)
        for total, row in paired(self.totals, self.rows):
            values: Any = [abs(sum(x * column[k] for k, x in row)) for column in columns]
            for block, cut in enumerate(run.cuts):
                seen = Fraction(sum(values[j] for j in cut), self.unit)
                total[block] += share * (seen + len(cut) * self.weight * run.error)


def balance(F: Matrix) -> Vector:
    """Powers of two by which coordinates are divided, until rows are about as large as columns."""
    q = len(F)
    d = [Fraction(1)] * q
    for _ in range(SWEEPS):
        before = list(d)
        for i in range(q):
            others = [j for j in range(q) if j != i]
            row = sum((abs(F[i][j]) * d[j] for j in others), ZERO) / d[i]
            column = sum((abs(F[j][i]) / d[j] for j in others), ZERO) * d[i]
            # multiplied by f, d[i] makes of them row / f and column f
            while row and column and row > 4 * column:
                d[i] *= 2
                row, column = row / 2, column * 2
            while row and column and column > 4 * row:
                d[i] /= 2
                row, column = row * 2, column / 2
        if d == before:
            break
    return d


def gains_by_row(F: Matrix, C: Matrix, inputs: list[Matrix], followed: Any) -> list[Vector]:
    """Bounds of the integrals over t > 0 of the row sums of |C exp(F t) B|, by row of C, for every
    B of inputs, in coordinates in which F is balanced. On a step of length h the integral of |f| is
    at most h (|f(t)| + |f(t + h)|)/2 + (h^3/12) sup |f''|; what is left after the last step is a
    part r < 1 of the whole."""
    d = balance(F)
    F = [[x * b / a for x, b in paired(row, d)] for row, a in paired(F, d)]
    C = [[x * a for x, a in paired(row, d)] for row in C]
    inputs = [[[x / a for x in row] for row, a in paired(B, d)] for B in inputs]
    h = followed.step
    steps = followed.steps
    size = norm(F)
    followable = 0 < h * size < Fraction(1, 2) and steps > 0 and size * h * steps <= GROWTH
    need(followable, "the peak gains are not followed here with these steps")
    step = one_step(F, h, steps)
    # the identity comes along: its integral bounds what is left of all others
    run = Run(step, [identity(len(F)), *inputs])
    outputs = Outputs(C, run)
    masses = [ZERO] * len(run.cuts)
    outputs.add(run, Fraction(1, 2))  # the trapezoidal rule takes half of both ends
    for number in range(1, steps + 1):
        masses = combined(masses, 1, run.masses())
        run.go_on()
        outputs.add(run, Fraction(1, 1 + (number == steps)))
    unit = 2**step.bits
    left = [x / unit for x in run.masses()]
    # |exp(F T)| < 1: what is left after T is a part of the whole, a geometric series
    need(left[0] < 1, "the peak gains are not shown to be finite")
    # |f''| = |C F^2 exp(F t) B|, and exp(|F| h) times more within a step
    bend = h**3 / 12 * step.grown
    found = []
    for curved, total in paired(product(C, product(F, F)), outputs.totals):
        curving = bend * sum(map(abs, curved))
        sums = [(h * x + curving * y) / unit for x, y in paired(total, masses)]
        # the whole of the identity: its own sum, and the part left[0] of the whole again
        whole = sums[0] / (1 - left[0])
        found.append([x + whole * y for x, y in paired(sums, left)][1:])
    return found
