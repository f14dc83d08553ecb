"""accuracy: boxes that shrink down to final bounds of |e_i| although disturbances, drift and noise act on the loop.

What acts on agent i besides its row is at most b_i for all times, once the estimation errors of the start have decayed;
until then they are part of V, as in max-separable. The peak gains in b_i are sums over steps in integers.
"""

import math
from fractions import Fraction
from functools import cache, partial
from itertools import pairwise
from operator import mul
from types import SimpleNamespace
from typing import Any

from .consensus import closed
from .coordinates import gains, inverse, outputs, shown, sizes, spread
from .expressions import Coupling
from .files import Arc, Certificate, Problem
from .intervals import enclosed
from .matrices import ZERO, Matrix, identity, integers, plus, product, transpose
from .reading import an_object, index, matrix, maybe, need, rational, read, weights
from .separable import Curve, Row, composite, curved_row, holds_box, linear_row, secants, starts, tables

STAGES, AGENTS, STEPS, GROWTH = 30, 500, 20_000, 2000
#: The plant of a file without `uncertainty`.
EXACT = SimpleNamespace(
    **dict.fromkeys(("weights", "gains", "disturbance", "drift", "measurement"), ZERO), known_to_agents=True
)


def accuracy(case: Certificate, check: Any) -> None:
    """The peak gains, the starts in the first box, every box in the next one, the rows, and the bounds at the end."""
    p = case.problem
    need(p.uncertainty is not None and check.rate is None, "there is no [uncertainty], or it claims a rate")
    need(p.n <= AGENTS, f"there are more than {AGENTS} agents")
    curved, turned = p.domain != "global", check.exact is not None and "T" in check.exact
    need(turned or (p.B is None and all(h.single for h in p.couplings)), "there are dynamics, or a coupling is a list")
    v = partial(weights, p.n * (p.m if turned else 1))
    stage = {"v": v, "alpha": rational, "level": rational, "rho": maybe(rational)}
    stage |= {"ranges": gains(p.m)} if turned else {}
    shape: dict[str, Any] = {"stages": [stage], "bounds": an_object} | ({"T": matrix(p.m, p.m)} if turned else {})
    names = ("disturbance", "drift", "measurement", "step")
    shape |= {"peaks": dict.fromkeys(names, rational) | {"steps": partial(index, STEPS + 1)}} if p.q else {}
    if p.q and curved:
        shape |= {"P": matrix(p.q, p.q), **dict.fromkeys(("beta", "kappa", "size"), rational)}
    exact = read(check.exact, shape)
    peaks = exact.peaks if p.q else SimpleNamespace(**dict.fromkeys(names, ZERO))
    for group in p.groups:
        need_peaks(case, group, peaks)

    need(1 <= len(exact.stages) <= STAGES, f"there is not between 1 and {STAGES} stages")
    for each in exact.stages:
        need(each.alpha > 0 and each.level > 0, "a number of a stage is not positive")
        need((each.rho is not None) == curved, "rho is not what these couplings need")
        need(each.rho is None or each.rho >= each.level, "rho is below the level")
    first, S = exact.stages[0], inverse(exact.T) if turned else []
    if curved:
        starts(case, check.domain, "box")
        claim = SimpleNamespace(**{**vars(exact), **vars(first)})
        need(p.q == 0 or claim.kappa * claim.beta * min(first.v) > 1, "kappa is too small")
        composite(case, claim, outputs(p, exact.T) if turned else None)
        most = spread(exact.T, first.v) if turned else 1 / min(first.v)
        radius = max(check.domain.radius, first.level / most)
        holds_box(claim, SimpleNamespace(radius=radius, disturbance=check.domain.disturbance), first.rho, most)
    else:
        need(check.domain == "global", "the couplings are linear, and the domain is not global")
    for before, after in pairwise(exact.stages):
        inside = (before.level * x < after.rho * y for x, y in zip(before.v, after.v, strict=True)) if curved else ()
        need(curved and all(inside), "a stage does not hold the box before")
    for each in exact.stages:
        if turned:
            shrinks_turned(case, exact.T, each, peaks)
        else:
            shrinks(p, each, peaks)
    last = exact.stages[-1]
    need(set(exact.bounds) == set(p.labels), "there is not one bound for each agent")
    for label, ends in zip(p.labels, sizes(S, last.v) if turned else ([x] for x in last.v), strict=True):
        bounds = read(exact.bounds[label], (rational,) * p.m) if turned else [rational(exact.bounds[label])]
        need(all(x >= last.level * y for x, y in zip(bounds, ends, strict=True)), "a bound is too small")


def shrinks_turned(case: Certificate, T: Matrix, stage: Any, peaks: Any) -> None:
    """All rows of a stage in coordinates, with what acts on each agent through B, on [level, rho]: they are linear."""
    p, plant = case.problem, case.problem.uncertainty
    need(plant.measurement == 0, "measurement noise is not known in coordinates")
    need(plant.weights == plant.gains == 0, "errors of weights and gains are not known in coordinates")
    b = (plant.disturbance * (1 + peaks.disturbance) + plant.drift * peaks.drift) / stage.level
    load = [b * sum(map(abs, row)) for row in (T if p.B is None else product(T, p.B))]
    shown(case, SimpleNamespace(**vars(stage), T=T), inverse(T), load * p.n)


def shrinks(p: Problem, stage: Any, peaks: Any) -> list[tuple[Fraction, Fraction]]:
    """Both faces of all rows of a stage, with what acts on each agent, on [level, rho]: each weight and gain at its
    worse end. What an observer passes on it may have seen in any mode. Returned: what of this the input of every agent
    adds, a part of N and a number."""
    plant, (v, bottom) = p.uncertainty or EXACT, integers(stage.v)
    off, noise = 1 + plant.weights, 2 * plant.measurement
    unknown = ZERO if plant.known_to_agents else plant.weights * peaks.disturbance
    everywhere = plant.disturbance * peaks.disturbance + plant.drift * peaks.drift + noise / 2 * peaks.measurement
    by_input = [(ZERO, ZERO)] * p.n
    modes = list(p.heard.values())
    agents = [(i, heard[i]) for heard in modes for i in range(p.n)]
    curves = tables(stage, ((arc.coupling, v[i], v[arc.j]) for i, heard in agents for arc in heard), bottom, False)

    @cache
    def steepest(h: Coupling, width: int, wider: Fraction) -> Fraction:
        """A bound of the slope of h, which is one of h(y)/y as well, on |y| <= rho width + wider."""
        if stage.rho is None:
            return max(map(abs, h.slope(0, 0)))
        reach = enclosed(stage.rho * Fraction(width, bottom) + wider)[1]
        found = max(map(abs, Curve(h, False).at((-reach, reach))[1]))
        need(math.isfinite(found), "a slope is not bounded")
        return Fraction(found)

    @cache
    def secant(h: Coupling, width: int) -> Fraction:
        """A bound of |h(y)/y| on |y| <= rho width."""
        if stage.rho is None:
            return max(map(abs, h.slope(0, 0)))
        return max(secants(h, enclosed(stage.rho * Fraction(width, bottom))[1]))

    def slopes(i: int, heard: list[Arc]) -> Fraction:
        return sum((arc.w * steepest(arc.coupling, v[i] + v[arc.j], noise) for arc in heard), ZERO) if noise else ZERO

    def pulled(i: int, heard: list[Arc]) -> Fraction:
        widths = ((arc, v[i] + v[arc.j]) for arc in heard)
        return sum((arc.w * y * secant(arc.coupling, y) for arc, y in widths), ZERO) if unknown else ZERO

    for i, heard in agents:
        k = (1 + plant.gains) * max((sum(map(abs, row)) for row in p.gains.get(i, [])), default=0)
        largest = max(slopes(i, each[i]) for each in modes)
        passed = everywhere + noise / 2 * k + noise * off * peaks.disturbance * largest
        load = plant.disturbance + noise * off * slopes(i, heard) + passed
        eta = unknown * max(pulled(i, each[i]) for each in modes)
        by_input[i] = (Fraction(eta) / bottom, passed)
        terms = tuple((arc.coupling, arc.w, v[arc.j], arc.loose) for arc in heard)
        row = Row(v[i], (p.least_gain(i, plant.gains) - stage.alpha) * v[i] - eta, terms)
        if stage.rho is None:
            holds = linear_row(row, plant.weights, load=load * bottom / stage.level)
        else:
            options = {"error": plant.weights, "start": stage.level, "load": load}
            holds = all(curved_row(row, bottom, stage.rho, curves, face, **options) for face in (False, True))
        need(holds, f"the row of agent {p.labels[i]} is not shown")
    return by_input


def need_peaks(case: Certificate, group: Any, peaks: Any) -> None:
    """The peak gains of one group. On a step of length h the integral of |f| is at most h (|f(t)| + |f(t + h)|)/2 +
    (h^3/12) sup |f''|; what is left after the last step is a part r < 1 of the whole."""
    p = case.problem
    k = next(number for number, each in enumerate(p.groups) if each is group)
    above = sum(len(each.A) for each in p.groups[:k])
    W = [row[k * p.m : (k + 1) * p.m] for row in case.W[above : above + len(group.A)]]
    F, C, h, q = closed(group, W), group.C, peaks.step, len(group.A)
    if p.B is not None:  # what acts, and what is asked, is in the inputs
        C, W = product(p.left, C), product(W, p.B)
    size = norm(F)
    growth = size * h * peaks.steps
    known = 0 < h * size < Fraction(1, 2) and peaks.steps > 0 and growth <= GROWTH
    need(known, "the peak gains are not followed here with these steps")
    bits = 192 + 2 * int(growth)
    power, step, rest, terms = identity(q), identity(q), Fraction(1), 0
    while rest * 2**bits > 1:  # exp(F h) by its series; what is left is at most rest exp(size h)
        terms += 1
        power = [[x * h / terms for x in row] for row in product(power, F)]
        step, rest = plus(step, 1, power), rest * size * h / terms
    grown = 1 / (1 - size * h)  # not below exp(size h)
    phi: Any = [[round(x * 2**bits) for x in row] for row in step]
    off = math.ceil(rest * 2**bits * grown) + 1  # of an entry of phi, in units of 2^-bits
    blocks = [identity(q), W, product(F, W)]
    Z: Any = transpose([[round(x * 2**bits) for x in column] for block in blocks for column in transpose(block)])
    error, largest = 1, norm(Z)  # of an entry of Z
    inputs = len(C)
    cuts = [range(q), range(q, q + inputs), range(q + inputs, q + 2 * inputs)]
    totals, masses, tail = [[ZERO] * 3 for _ in C], [ZERO] * 3, [ZERO] * 3
    (top, unit) = integers([x for row in C for x in row])
    rows, weight = [top[i * q : (i + 1) * q] for i in range(inputs)], norm(C)
    for number in range(peaks.steps + 1):
        columns, share = transpose(Z), Fraction(1, 1 + (number in (0, peaks.steps)))
        for total, row in zip(totals, rows, strict=True):
            values = [abs(sum(map(mul, row, column))) for column in columns]
            for block, cut in enumerate(cuts):
                total[block] += share * (Fraction(sum(values[j] for j in cut), unit) + len(cut) * weight * error)
        tail = [Fraction(max(sum(abs(row[j]) for j in cut) for row in Z) + len(cut) * error) for cut in cuts]
        if number < peaks.steps:
            masses = [x + y for x, y in zip(masses, tail, strict=True)]
            largest = max(abs(x) for row in Z for x in row)
            error = ((norm(phi) + q * off) * error + q * off * largest >> bits) + 2
            Z = [[sum(map(mul, row, column)) >> bits for column in columns] for row in phi]
    left = [Fraction(x) / 2**bits for x in tail]
    need(left[0] < 1, "the peak gains are not shown to be finite")
    bend = h**3 / 12 * grown
    for curved, total in zip(product(C, product(F, F)), totals, strict=True):
        sums = [(h * x + bend * sum(map(abs, curved)) * y) / 2**bits for x, y in zip(total, masses, strict=True)]
        drift, disturbance, noise = [x + sums[0] / (1 - left[0]) * y for x, y in zip(sums, left, strict=True)]
        need(drift <= peaks.drift and disturbance <= peaks.disturbance, "the peak gains are not shown")
        need(noise + norm(product(C, W)) <= peaks.measurement, "the peak gain of noise is not shown")


def norm(X: Any) -> Any:
    """The largest row sum of absolute values."""
    return max(sum(map(abs, row)) for row in X)
