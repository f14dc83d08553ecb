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
from typing import Any

from .consensus import closed
from .coordinates import gains, inverse, outputs, shown, sizes, spread
from .expressions import Coupling
from .files import Arc, Certificate, Problem
from .intervals import enclosed
from .matrices import ZERO, Matrix, diagonal, identity, integers, plus, product, transpose
from .reading import an_object, index, matrix, maybe, need, rational, read, weights
from .separable import (
    Curve,
    Row,
    composite,
    curved_row,
    holds_box,
    linear_row,
    secants,
    starts,
    tables,
)

STAGES, AGENTS, STEPS, GROWTH = 30, 500, 20_000, 2000
PRODUCTS = 20_000_000  # of numbers, along the steps of a whole loop
NAMES = ("disturbance", "drift", "measurement")
#: The plant of a file without `uncertainty`.
EXACT = SimpleNamespace(
    **dict.fromkeys(("weights", "gains", "disturbance", "drift", "measurement"), ZERO),
    known_to_agents=True,
)


def accuracy(case: Certificate, check: Any) -> None:
    """The peak gains, the starts in the first box, every box in the next one, the rows, and the
    bounds at the end."""
    p = case.problem
    need(
        p.uncertainty is not None and check.rate is None,
        "there is no [uncertainty], or it claims a rate",
    )
    need(p.n <= AGENTS, f"there are more than {AGENTS} agents")
    linear = p.domain == "global"
    need(
        not linear or check.domain == "global",
        "the couplings are linear, and the domain is not global",
    )
    if check.exact is not None and "response" in check.exact:
        whole_loop(case, check)
    else:
        by_stages(case, check)


def by_stages(case: Certificate, check: Any) -> None:
    """The form with boxes."""
    p = case.problem
    curved, turned = p.domain != "global", check.exact is not None and "T" in check.exact
    need(
        turned or (p.B is None and all(h.single for h in p.couplings)),
        "there are dynamics, or a coupling is a list",
    )
    v = partial(weights, p.n * (p.m if turned else 1))
    stage = {"v": v, "alpha": rational, "level": rational, "rho": maybe(rational)}
    stage |= {"ranges": gains(p.m)} if turned else {}
    shape: dict[str, Any] = {"stages": [stage], "bounds": an_object} | (
        {"T": matrix(p.m, p.m)} if turned else {}
    )
    if p.q and curved:
        shape |= {"P": matrix(p.q, p.q), **dict.fromkeys(("beta", "kappa", "size"), rational)}
    exact, peaks = with_peaks(case, check, shape)

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
        holds_box(
            claim,
            SimpleNamespace(radius=radius, disturbance=check.domain.disturbance),
            first.rho,
            most,
        )
    for before, after in pairwise(exact.stages):
        inside = (
            (before.level * x < after.rho * y for x, y in zip(before.v, after.v, strict=True))
            if curved
            else ()
        )
        need(curved and all(inside), "a stage does not hold the box before")
    for each in exact.stages:
        if turned:
            shrinks_turned(case, exact.T, each, peaks)
        else:
            shrinks(p, each, peaks)
    last = exact.stages[-1]
    need(set(exact.bounds) == set(p.labels), "there is not one bound for each agent")
    for label, ends in zip(
        p.labels, sizes(S, last.v) if turned else ([x] for x in last.v), strict=True
    ):
        bounds = (
            read(exact.bounds[label], (rational,) * p.m)
            if turned
            else [rational(exact.bounds[label])]
        )
        need(
            all(x >= last.level * y for x, y in zip(bounds, ends, strict=True)),
            "a bound is too small",
        )


def whole_loop(case: Certificate, check: Any) -> None:
    """e' = M e + (I (x) B)(w + C eps): in the end every e_ic is at most b times the integral of its
    row of |exp(M t) (I (x) B)|; that it is finite proves that M is Hurwitz."""
    p, plant = case.problem, case.problem.uncertainty
    exact, peaks = with_peaks(case, check, {"bounds": an_object, "response": steps_of("step")})
    need(p.domain == "global", "the couplings are not linear")
    need(not p.switches, "the response of a loop that switches is not followed")
    need(
        plant.measurement == plant.weights == plant.gains == 0,
        "noise and errors are not known beside a response",
    )
    M = p.jacobian(next(iter(p.modes)))
    inputs = [] if p.B is None else [diagonal([p.B] * p.n)]
    columns = len(M) + sum(len(B[0]) for B in inputs)
    need(
        len(M) ** 2 * columns * exact.response.steps <= PRODUCTS,
        "the response takes too many steps",
    )
    found = gains_by_row(M, identity(len(M)), inputs, exact.response)
    b = plant.disturbance * (1 + peaks.disturbance) + plant.drift * peaks.drift
    need(b > 0, "nothing acts on the loop")
    need(set(exact.bounds) == set(p.labels), "there is not one list of bounds for each agent")
    for i, label in enumerate(p.labels):
        bounds = read(exact.bounds[label], (rational,) * p.m)
        ends: list[Fraction] = [b * row[-1] for row in found[i * p.m : (i + 1) * p.m]]
        need(
            all(x >= y for x, y in zip(bounds, ends, strict=True)),
            "a bound is below what the loop passes on",
        )


def steps_of(*names: str) -> dict[str, Any]:
    """The shape of rationals with these names, and of steps."""
    return dict.fromkeys(names, rational) | {"steps": partial(index, STEPS + 1)}


def with_peaks(case: Certificate, check: Any, shape: dict[str, Any]) -> tuple[Any, Any]:
    """What a claim says, and the peak gains of its observer, which are shown here; 0 without an
    exosystem."""
    p = case.problem
    exact = read(check.exact, shape | ({"peaks": steps_of(*NAMES, "step")} if p.q else {}))
    peaks = exact.peaks if p.q else SimpleNamespace(**dict.fromkeys(NAMES, ZERO))
    for group in p.groups:
        need_peaks(case, group, peaks)
    return exact, peaks


def shrinks_turned(case: Certificate, T: Matrix, stage: Any, peaks: Any) -> None:
    """All rows of a stage in coordinates, with what acts on each agent through B, on [level, rho]:
    they are linear."""
    p, plant = case.problem, case.problem.uncertainty
    need(plant.measurement == 0, "measurement noise is not known in coordinates")
    need(
        plant.weights == plant.gains == 0,
        "errors of weights and gains are not known in coordinates",
    )
    b = (plant.disturbance * (1 + peaks.disturbance) + plant.drift * peaks.drift) / stage.level
    load = [b * sum(map(abs, row)) for row in (T if p.B is None else product(T, p.B))]
    shown(case, SimpleNamespace(**vars(stage), T=T), inverse(T), load * p.n)


def shrinks(p: Problem, stage: Any, peaks: Any) -> list[tuple[Fraction, Fraction]]:
    """Both faces of all rows of a stage, with what acts on each agent, on [level, rho]: each weight
    and gain at its worse end. What an observer passes on it may have seen in any mode. Returned:
    what of this the input of every agent adds, a part of N and a number."""
    plant, (v, bottom) = p.uncertainty or EXACT, integers(stage.v)
    off, noise = 1 + plant.weights, 2 * plant.measurement
    unknown = ZERO if plant.known_to_agents else plant.weights * peaks.disturbance
    everywhere = (
        plant.disturbance * peaks.disturbance
        + plant.drift * peaks.drift
        + noise / 2 * peaks.measurement
    )
    by_input = [(ZERO, ZERO)] * p.n
    modes = list(p.heard.values())
    agents = [(i, heard[i]) for heard in modes for i in range(p.n)]
    curves = tables(
        stage,
        ((arc.coupling, v[i], v[arc.j]) for i, heard in agents for arc in heard),
        bottom,
        False,
    )

    @cache
    def steepest(h: Coupling, width: int, wider: Fraction) -> Fraction:
        """A bound of the slope of h, which is one of h(y)/y as well, on |y| <= rho width +
        wider."""
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
        return (
            sum((arc.w * steepest(arc.coupling, v[i] + v[arc.j], noise) for arc in heard), ZERO)
            if noise
            else ZERO
        )

    def pulled(i: int, heard: list[Arc]) -> Fraction:
        widths = ((arc, v[i] + v[arc.j]) for arc in heard)
        return (
            sum((arc.w * y * secant(arc.coupling, y) for arc, y in widths), ZERO)
            if unknown
            else ZERO
        )

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
            holds = all(
                curved_row(row, bottom, stage.rho, curves, face, **options)
                for face in (False, True)
            )
        need(holds, f"the row of agent {p.labels[i]} is not shown")
    return by_input


def need_peaks(case: Certificate, group: Any, peaks: Any) -> None:
    """The peak gains of one group are at most those that are claimed."""
    p = case.problem
    k = next(number for number, each in enumerate(p.groups) if each is group)
    above = sum(len(each.A) for each in p.groups[:k])
    W = [row[k * p.m : (k + 1) * p.m] for row in case.W[above : above + len(group.A)]]
    F, C = closed(group, W), group.C
    if p.B is not None:  # what acts, and what is asked, is in the inputs
        C, W = product(p.left, C), product(W, p.B)
    for drift, disturbance, noise in gains_by_row(F, C, [W, product(F, W)], peaks):
        need(
            drift <= peaks.drift and disturbance <= peaks.disturbance,
            "the peak gains are not shown",
        )
        need(
            noise + norm(product(C, W)) <= peaks.measurement, "the peak gain of noise is not shown"
        )


def gains_by_row(F: Matrix, C: Matrix, inputs: list[Matrix], followed: Any) -> list[list[Fraction]]:
    """Bounds of the integrals over t > 0 of the row sums of |C exp(F t) B|, by row of C, for I and
    every B of inputs. On a step of length h the integral of |f| is at most h (|f(t)| + |f(t +
    h)|)/2 + (h^3/12) sup |f''|; what is left after the last step is a part r < 1 of the whole."""
    h, steps, q, size = followed.step, followed.steps, len(F), norm(F)
    known = 0 < h * size < Fraction(1, 2) and steps > 0 and size * h * steps <= GROWTH
    need(known, "the peak gains are not followed here with these steps")
    euler = float(norm(plus(identity(q), h, F)) + (size * h) ** 2)  # not below |exp(F h)|, about
    bits = 192 + 2 * math.ceil(steps * max(0.0, math.log(euler)))
    power, step, rest, terms, grown = identity(q), identity(q), Fraction(1), 0, ZERO
    while rest * 2**bits > 1:  # exp(F h) by its series; what is left is at most rest exp(size h)
        terms, grown = terms + 1, grown + rest
        power = [[x * h / terms for x in row] for row in product(power, F)]
        step, rest = plus(step, 1, power), rest * size * h / terms
    # not below exp(size h)
    grown = Fraction(math.ceil((grown + rest / (1 - size * h)) * 2**64), 2**64)
    phi: Any = [[round(x * 2**bits) for x in row] for row in step]
    off = math.ceil(rest * 2**bits * grown) + 1  # of an entry of phi, in units of 2^-bits
    blocks = [identity(q), *inputs]
    Z: Any = transpose(
        [[round(x * 2**bits) for x in column] for block in blocks for column in transpose(block)]
    )
    error, largest = 1, norm(Z)  # of an entry of Z
    ends = list(accumulate((len(block[0]) for block in blocks), initial=0))
    cuts = [range(*pair) for pair in pairwise(ends)]
    totals, masses, tail = [[ZERO] * len(cuts) for _ in C], [ZERO] * len(cuts), [ZERO] * len(cuts)
    (top, unit) = integers([x for row in C for x in row])
    weight = norm(C)
    rows = [[(k, x) for k, x in enumerate(top[i * q : (i + 1) * q]) if x] for i in range(len(C))]
    for number in range(steps + 1):
        columns, share = transpose(Z), Fraction(1, 1 + (number in (0, steps)))
        for total, row in zip(totals, rows, strict=True):
            values: Any = [abs(sum(x * column[k] for k, x in row)) for column in columns]
            for block, cut in enumerate(cuts):
                total[block] += share * (
                    Fraction(sum(values[j] for j in cut), unit) + len(cut) * weight * error
                )
        tail = [
            Fraction(max(sum(abs(row[j]) for j in cut) for row in Z) + len(cut) * error)
            for cut in cuts
        ]
        if number < steps:
            masses = [x + y for x, y in zip(masses, tail, strict=True)]
            largest = max(abs(x) for row in Z for x in row)
            error = ((norm(phi) + q * off) * error + q * off * largest >> bits) + 2
            Z = [[sum(map(mul, row, column)) >> bits for column in columns] for row in phi]
    left = [Fraction(x) / 2**bits for x in tail]
    need(left[0] < 1, "the peak gains are not shown to be finite")
    bend, found = h**3 / 12 * grown, []
    for curved, total in zip(product(C, product(F, F)), totals, strict=True):
        sums = [
            (h * x + bend * sum(map(abs, curved)) * y) / 2**bits
            for x, y in zip(total, masses, strict=True)
        ]
        found.append([x + sums[0] / (1 - left[0]) * y for x, y in zip(sums, left, strict=True)])
    return found


def norm(X: Any) -> Any:
    """The largest row sum of absolute values."""
    return max(sum(map(abs, row)) for row in X)
