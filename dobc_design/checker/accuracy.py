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
from itertools import pairwise
from types import SimpleNamespace
from typing import Any, NamedTuple

from .claims import Certificate
from .consensus import closed, parts
from .coordinates import inverse, outputs, shown, sizes, spread
from .curves import Curve, secants
from .expressions import Coupling
from .files import ERRORS
from .intervals import enclosed
from .loop import Arc, Loop
from .matrices import ZERO, Matrix, diagonal, identity, integers, norm, paired, product
from .peaks import STEPS, gains_by_row
from .quadratic import gains_shape
from .reading import Object, an_object, index, matrix, maybe, need, rational, read, weights
from .separable import (
    Errors,
    Heard,
    Row,
    composite,
    curved_row,
    holds_box,
    linear_row,
    starts,
    tables,
)
from .slopes import jacobian

STAGES = 30
AGENTS = 500
PRODUCTS = 20_000_000  # of numbers, along the steps of a whole loop
NAMES = ("disturbance", "drift", "measurement")
#: The plant of a file without `uncertainty`.
EXACT = SimpleNamespace(**dict.fromkeys(ERRORS, ZERO), known_to_agents=True)


def accuracy(case: Certificate, check: Any) -> None:
    """The peak gains, the starts in the first box, every box in the next one, the rows, and the
    bounds at the end."""
    loop = case.loop
    need(
        loop.uncertainty is not None and check.rate is None,
        "there is no [uncertainty], or it claims a rate",
    )
    need(loop.n <= AGENTS, f"there are more than {AGENTS} agents")
    linear = loop.domain == "global"
    need(
        not linear or check.domain == "global",
        "the couplings are linear, and the domain is not global",
    )
    if check.exact is not None and "response" in check.exact:
        whole_loop(case, check)
    else:
        by_stages(case, check)


def acting(plant: Any, peaks: Any) -> Any:
    """What acts on every agent in the end, as an input: w + C eps."""
    return plant.disturbance * (1 + peaks.disturbance) + plant.drift * peaks.drift


# --- Boxes
def by_stages(case: Certificate, check: Any) -> None:
    """The form with boxes."""
    loop = case.loop
    curved = loop.domain != "global"
    turned = check.exact is not None and "T" in check.exact
    if not turned:
        need(
            loop.B is None and all(h.single for h in loop.functions),
            "there are dynamics, or a coupling is a list",
        )
    exact, peaks = with_peaks(case, check, stages_shape(loop, turned))
    stages = exact.stages
    need(1 <= len(stages) <= STAGES, f"there is not between 1 and {STAGES} stages")
    for each in stages:
        need(each.alpha > 0 and each.level > 0, "a number of a stage is not positive")
        need((each.rho is not None) == curved, "rho is not what these couplings need")
        need(each.rho is None or each.rho >= each.level, "rho is below the level")
    T = exact.T if turned else None
    S = inverse(T) if T else []
    if curved:
        starts(case, check.domain, "box")
        first = SimpleNamespace(**vars(exact) | vars(stages[0]))
        holds_starts(case, check.domain, first, T)
    # a run that has come down to the level of a stage lies in the box of the next
    for before, after in pairwise(stages):
        need(curved and lies_inside(before, after), "a stage does not hold the box before")
    for each in stages:
        if T:
            shrinks_turned(case, T, each, peaks)
        else:
            shrinks(loop, each, peaks)
    last = stages[-1]
    need(set(exact.bounds) == set(loop.labels), "there is not one bound for each agent")
    ends = sizes(S, last.v) if T else ([x] for x in last.v)
    for label, end in paired(loop.labels, ends):
        listed = exact.bounds[label]
        bounds = read(listed, (rational,) * loop.m) if T else [rational(listed)]
        need(all(x >= last.level * y for x, y in paired(bounds, end)), "a bound is too small")


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
    if loop.q and loop.domain != "global":
        shape["P"] = matrix(loop.q, loop.q)
        shape |= dict.fromkeys(("beta", "kappa", "size"), rational)
    return shape


def holds_starts(case: Certificate, domain: Any, claim: Any, T: Matrix | None = None) -> None:
    """All starts lie in the box of a stage, and V = N + kappa E does not leave it."""
    if case.loop.q:
        need(claim.kappa * claim.beta * min(claim.v) > 1, "kappa is too small")
    composite(case, claim, outputs(case.loop, T) if T else None)
    most = spread(T, claim.v) if T else 1 / min(claim.v)
    # runs may start inside the level, too, and disturbances bring them back to it
    radius = max(domain.radius, claim.level / most)
    holds_box(claim, radius, domain.disturbance, claim.rho, most)


def lies_inside(before: Any, after: Any) -> bool:
    """Whether the inner box of a stage lies in the outer one of the next."""
    pairs = paired(before.v, after.v)
    return all(before.level * x < after.rho * y for x, y in pairs)


def shrinks_turned(case: Certificate, T: Matrix, stage: Any, peaks: Any) -> None:
    """All rows of a stage in coordinates, with what acts on each agent through B, on [level, rho]:
    they are linear."""
    loop = case.loop
    plant = loop.uncertainty
    need(plant.measurement == 0, "measurement noise is not known in coordinates")
    need(
        plant.weights == plant.gains == 0,
        "errors of weights and gains are not known in coordinates",
    )
    b = acting(plant, peaks) / stage.level
    entering = T if loop.B is None else product(T, loop.B)
    load = [b * sum(map(abs, row)) for row in entering]
    shown(case, SimpleNamespace(**vars(stage), T=T), inverse(T), load * loop.n)


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
        self.v, self.bottom = integers(stage.v)
        self.noise = 2 * self.plant.measurement  # of a difference of two measured states
        self.steepest = cache(self.find_steepest)
        self.secant = cache(self.find_secant)

    def find_steepest(self, h: Coupling, width: int) -> Fraction:
        """A bound of the slope of h, which is one of h(y)/y as well, on |y| <= rho width, and
        noise more."""
        if self.rho is None:
            return max(map(abs, h.slope(0, 0)))
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
        return Fraction(self.noise * (1 + self.plant.weights) * slopes)

    def pulled(self, i: int, heard: list[Arc]) -> Fraction:
        """What the arcs of a mode add to an input, by their weights."""
        found = ZERO
        for arc in heard:
            width = self.v[i] + self.v[arc.j]
            found += arc.w * width * self.secant(arc.coupling, width)
        return found

    def added(self, i: int) -> Added:
        """What an observer passes on to an input: it may have seen any mode."""
        plant = self.plant
        peaks = self.peaks
        modes = [heard[i] for heard in self.loop.heard.values()]
        k = (1 + plant.gains) * self.loop.gain_size(i)
        number = plant.disturbance * peaks.disturbance + plant.drift * peaks.drift
        number += plant.measurement * (peaks.measurement + k)
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
        load = plant.disturbance + loads.by_noise(i, heard) + added[i].number
        arcs = [Heard(arc.coupling, arc.w, v[arc.j], arc.loose) for arc in heard]
        c = (loop.least_gain(i, plant.gains) - stage.alpha) * v[i] - added[i].part * bottom
        row = Row(v[i], c, tuple(arcs))
        if stage.rho is None:
            # for all s >= level: it is hardest there
            most = load * bottom / stage.level
            holds = linear_row(row, Errors(weights=plant.weights, load=most))
        else:
            errors = Errors(weights=plant.weights, load=load, start=stage.level)
            holds = curved_row(row, bottom, stage.rho, curves, errors)
        need(holds, f"the row of agent {loop.labels[i]} is not shown")
    return added


# --- The whole loop
def whole_loop(case: Certificate, check: Any) -> None:
    """e' = M e + (I (x) B)(w + C eps): in the end every e_ic is at most b times the integral of its
    row of |exp(M t) (I (x) B)|; that it is finite proves that M is Hurwitz."""
    loop = case.loop
    plant = loop.uncertainty
    shape = {"bounds": an_object, "response": steps_of("step")}
    exact, peaks = with_peaks(case, check, shape)
    need(loop.domain == "global", "the couplings are not linear")
    need(not loop.switches, "the response of a loop that switches is not followed")
    need(
        plant.measurement == plant.weights == plant.gains == 0,
        "noise and errors are not known beside a response",
    )
    (M,) = [jacobian(loop, mode) for mode in loop.modes]
    inputs = [] if loop.B is None else [diagonal([loop.B] * loop.n)]
    columns = len(M) + sum(len(B[0]) for B in inputs)
    work = len(M) ** 2 * columns * exact.response.steps
    # that many products of integers take a minute
    need(work <= PRODUCTS, "the response takes too many steps")
    found = gains_by_row(M, identity(len(M)), inputs, exact.response)
    b = acting(plant, peaks)
    # bounds of 0 would be claims about rest, which takes for ever
    need(b > 0, "nothing acts on the loop")
    need(set(exact.bounds) == set(loop.labels), "there is not one list of bounds for each agent")
    for i, label in enumerate(loop.labels):
        bounds = read(exact.bounds[label], (rational,) * loop.m)
        ends = [b * row[-1] for row in found[i * loop.m : (i + 1) * loop.m]]
        need(
            all(x >= y for x, y in paired(bounds, ends)), "a bound is below what the loop passes on"
        )


# --- Peak gains of the observers
def steps_of(*names: str) -> Object:
    """The shape of rationals with these names, and of steps."""
    return dict.fromkeys(names, rational) | {"steps": partial(index, STEPS + 1)}


def with_peaks(case: Certificate, check: Any, shape: Object) -> tuple[Any, Any]:
    """What a claim says, and the peak gains of its observer, which are shown here; 0 without an
    exosystem."""
    if case.loop.q == 0:
        return read(check.exact, shape), SimpleNamespace(**dict.fromkeys(NAMES, ZERO))
    exact = read(check.exact, shape | {"peaks": steps_of(*NAMES, "step")})
    for k in range(len(case.loop.residuals)):
        need_peaks(case, k, exact.peaks)
    return exact, exact.peaks


def need_peaks(case: Certificate, k: int, peaks: Any) -> None:
    """The peak gains of one residual are at most those that are claimed."""
    loop = case.loop
    residual = loop.residuals[k]
    W = parts(loop, case.W, loop.m)[k]
    F = closed(residual, W)
    C = residual.C
    if loop.B is not None:  # what acts, and what is asked, is in the inputs
        C = product(loop.node.left, C)
        W = product(W, loop.B)
    for drift, disturbance, noise in gains_by_row(F, C, [W, product(F, W)], peaks):
        need(
            drift <= peaks.drift and disturbance <= peaks.disturbance,
            "the peak gains are not shown",
        )
        at_once = norm(product(C, W))
        need(noise + at_once <= peaks.measurement, "the peak gain of noise is not shown")
