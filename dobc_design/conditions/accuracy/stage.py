"""Final bounds of the error: when they are looked for and what is reported (theory, section 12)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import chain, islice
from typing import Any, Final, NamedTuple

import numpy as np
from scipy import linalg, sparse

from dobc_design.conditions.accuracy.decide import (
    ID,
    INPUTS,
    MOST_STAGES,
    Accuracy,
    Level,
    Peaks,
    Response,
    accuracy_check,
    load_in_coordinates,
    loads,
    loop_matrix,
    most_steps,
    not_shrinking,
    observer_peaks,
    obstacle,
    response_bounds,
    response_obstacle,
)
from dobc_design.conditions.case import Case
from dobc_design.conditions.check import Check, limited, surviving, undecided_check
from dobc_design.conditions.coverage import Progress, read_region
from dobc_design.conditions.domain import EVERYWHERE, Around, Box, Domain
from dobc_design.conditions.kinds import MAX_SEPARABLE
from dobc_design.conditions.numbers import (
    claimed,
    decimal_below,
    last_found,
    rounded_down,
    rounded_up,
)
from dobc_design.conditions.observer.decide import error_matrix
from dobc_design.conditions.separable.checks import why_no_weights
from dobc_design.conditions.separable.claim import (
    ErrorBound,
    Separable,
    acts_by_component,
    error_sizes,
    stated_errors,
)
from dobc_design.conditions.separable.coordinates import enclosed_ranges, slowest_row
from dobc_design.conditions.separable.propose import field_of, least_solution, linear_rate, solved
from dobc_design.conditions.separable.propose_coordinates import (
    Agents,
    Gains,
    candidates,
    in_floats,
)
from dobc_design.conditions.separable.propose_observer import propose_error_bound, radius_needed
from dobc_design.conditions.separable.stage import largest_claim, separable_stage
from dobc_design.coupling.expression import numpy_function
from dobc_design.exact.interval import UndefinedError
from dobc_design.exact.matrix import Matrix, Vector, identity, to_float
from dobc_design.exact.number import root_above
from dobc_design.exact.peaks import MOST_GROWTH, MOST_STEPS, row_norm
from dobc_design.exact.work import STAGE, WorkLimitError, at_most, out_of_time
from dobc_design.loop.arcs import coupling_places
from dobc_design.loop.loop import Loop
from dobc_design.problem.groups import gains_of
from dobc_design.solvers.program import Array
from dobc_design.verdict import Verdict

DECAYED: Final = 12.0  # exponents of the slowest mode that the steps follow
FINEST: Final = 0.012  # |F| h of a step
COARSEST: Final = 0.3  # the same, where there are not enough finer ones
LEFT: Final = 1e-4  # of the response of a whole loop, after the steps that follow it
FINE: Final = 0.08  # |M| h of a step
COARSE: Final = 0.4  # the same, where there are not enough finer ones
#: How much more than b_i v is made for, where it has to reach further out.
SPREADS: Final = (1.0, 1.1, 1.2, 1.4, 1.7, 2.2, 3.0, 5.0, 8.0, 20.0, 60.0, 200.0)
ABOVE: Final = Fraction(1, 50_000)  # of a level, left to two programs that round apart
MORE: Final = Fraction(1, 10**6)  # the same, of a peak gain
WORTH: Final = Fraction(998, 1000)  # what a stage has to leave of the largest bound, or less
HALVINGS: Final = 10
DEEPEST: Final = 1e-4  # part of rho down to which the lowest level is looked for
HIGHEST: Final = 0.98  # part of rho at which a stage has to hold
SLOW: Final = Fraction(1, 10**7)  # the rate of a stage, as a part of b_i/(level v_i)
LEAST: Final = 1e-3  # the first guess of v, as a part of what b_i does to an agent alone
NEAR: Final = 1e-6  # where slopes are taken
V_DIGITS: Final = 12
CHOICES: Final = 30  # of rows, one after the other
SETTLED: Final = 1e-9  # of v, when none of them changes any more
SLACK: Final = 1e-5  # of the largest input, for rows in which nothing acts
MOST_COORDINATES: Final = 3  # in which rows are decided
FROM: Final = (0.9, 0.5, 0.98)  # parts of rho from which the first stage is looked for
ROOM: Final = Fraction(1, 100)  # of eta, for a second program with wider enclosures
POINTS: Final = 9  # of s
SAMPLES: Final = 500  # of h
TIGHTER: Final = 1 + 1e-6  # what is left to rounding


def propose_peaks(loop: Loop, W: Matrix) -> Peaks | None:
    """Proved upper bounds of the peak gains, a little above; None where none are found."""
    parts = zip(loop.groups, gains_of(loop.groups, W), strict=True)
    matrices = [to_float(error_matrix(group.exosystem, gain)) for group, gain in parts]
    decay = min(float(-np.max(np.linalg.eigvals(F).real)) for F in matrices)
    size = max(float(np.max(np.sum(np.abs(F), axis=1))) for F in matrices)
    if not (decay > 0 and np.isfinite(size)):
        return None
    horizon = DECAYED / decay
    h = min(max(FINEST / size, horizon / MOST_STEPS), COARSEST / size)
    steps = min(MOST_STEPS, int(np.ceil(horizon / h)))
    found = observer_peaks(loop, W, step=rounded_up(Fraction(h), digits=3), steps=steps)
    if found is None:
        return None
    disturbance, drift, measurement = (
        rounded_up(getattr(found, x) * (1 + MORE), digits=7) for x in INPUTS
    )
    return replace(found, disturbance=disturbance, drift=drift, measurement=measurement)


def propose_stages(loop: Loop, peaks: Peaks | None, outer: Level) -> Iterator[Level]:
    """Stages from the box of ``outer`` inwards, each decided already; for linear couplings one
    does."""
    last = None if outer.rho is None else _lowest(loop, peaks, outer)
    if last is not None:
        yield last
    while outer.rho is None or last is not None:
        last = next(_inside(loop, peaks, outer if last is None else last), None)
        if last is None:
            return
        yield last
        if last.rho is None:
            return


def near_target(loop: Loop, peaks: Peaks | None) -> Iterator[Level]:
    """Boxes |e_i| <= v_i around the target that shrink, larger ones first: v as the rows near the
    target want it."""
    tiny = Level(v=(Fraction(1),) * loop.n, alpha=SLOW, level=SLOW, rho=Fraction(1, 1000))
    for v in reversed(list(_vectors(loop, peaks, tiny, SPREADS))):
        level = None if v is None else _lowest(loop, peaks, replace(tiny, v=v, rho=Fraction(1)))
        if level is not None:
            yield level


def _inside(loop: Loop, peaks: Peaks | None, before: Level) -> Iterator[Level]:
    """Stages that take over where ``before`` ends, and leave less of its largest bound."""
    within = before if before.rho is None else replace(before, rho=before.level)
    spreads = SPREADS[:1] if before.rho is None else SPREADS
    for spread, v in zip(spreads, _vectors(loop, peaks, within, spreads), strict=True):
        if v is None:
            continue
        # The box in which the stage before ends has to lie inside this one.
        ratio = max(before.level * x / y for x, y in zip(before.v, v, strict=True))
        rho = None if before.rho is None else rounded_up(ratio * (1 + ABOVE), digits=9)
        tight = _with_rate(loop, peaks, Level(v=v, alpha=SLOW, level=1 + ABOVE, rho=rho))
        if spread == 1 and (rho is None or tight.level < rho) and _holds(loop, peaks, tight):
            found: Level | None = tight
        else:
            found = None if rho is None else _lowest(loop, peaks, tight)
        if found is None:
            continue
        if rho is None or found.level * max(found.v) <= WORTH * before.level * max(before.v):
            yield found


def _vectors(
    loop: Loop, peaks: Peaks | None, within: Level, spreads: Sequence[float]
) -> Iterator[Vector | None]:
    """v for the rows with b_i at s = 1, b_i as in the box ``within``, and with multiples, which
    reach further."""
    b = _loads(loop, peaks, within)
    size = 1.0 if within.rho is None else float(max(within.v)) * float(within.rho)
    field = field_of(loop, rho=size, errors=stated_errors(loop))
    field = replace(field, grid=np.array([1.0]), extra=_pulls(loop, peaks, size))
    for spread in spreads:
        with np.errstate(all="ignore"):
            own = -field.rows(b * NEAR, alpha=0.0)[1].diagonal()
            lower = LEAST * spread * b / np.where(own > 0, own, 1.0)
            v = least_solution(replace(field, load=spread * b), alpha=0.0, start=lower, lower=lower)
        yield None if v is None else _raised_weights(v)


def _raised_weights(v: Array) -> Vector:
    """Weights as decimals a little above."""
    return tuple(rounded_up(Fraction(x), digits=V_DIGITS) for x in v.tolist())


def _pulls(loop: Loop, peaks: Peaks | None, reach: float) -> Any:
    """eta_i as a matrix (n, n) that acts on v, for |y| <= 2 reach; None where the observers know
    the weights."""
    plant = loop.uncertainty
    if plant is None or plant.known_to_agents or not plant.weights or peaks is None:
        return None
    y = np.linspace(0, 2 * reach, SAMPLES)[1:]
    secants = []
    for function in loop.functions:
        h = numpy_function(function.components[0])
        secants.append(max(np.max(np.abs(h(y) / y)), np.max(np.abs(h(-y) / y))))
    steepest = np.array(secants)
    total = sparse.csr_array((loop.n, loop.n))
    for arcs in loop.modes.values():
        w = np.array([float(x) for x in arcs.weights]) * steepest[coupling_places(loop, arcs)]
        w *= float(plant.weights * peaks.disturbance * (1 + ROOM) * (1 + ABOVE))
        rows = np.concatenate([arcs.listeners, arcs.listeners])
        columns = np.concatenate([arcs.listeners, arcs.speakers])
        places = (rows, columns)
        found = sparse.csr_array((np.concatenate([w, w]), places), shape=total.shape)
        total = total.maximum(found)
    return total


def covering_boxes(
    loop: Loop,
    peaks: Peaks | None,
    error: ErrorBound | None,
    starts: tuple[Fraction, Fraction],
    *,
    slowly: float = 0.0,
) -> Iterator[tuple[Level, ErrorBound | None]]:
    """First stages that hold these starts, |e_i| <= R and |eps_i| <= s: the least v >= 1 whose rows
    hold from a part of rho on although b_i acts on them; ``slowly``: at that part of the rate that
    linear couplings would have."""
    radius, disturbance = starts
    if error is not None:
        error = replace(error, kappa=rounded_up(1 / error.beta * NEARLY, digits=9))
    rho = radius_needed(radius, error, disturbance)
    # starts may be as near as that, with their errors of estimates beside
    inside = float(radius / rho)
    for part in sorted({min(part, inside) for part in FROM}, reverse=True):
        v: Vector = (Fraction(1),) * loop.n
        with surviving("no box that holds the starts", UndefinedError), np.errstate(all="ignore"):
            for _ in range(2):  # with noise, what acts depends on how far v reaches
                b = _loads(loop, peaks, Level(v=v, alpha=SLOW, level=rho, rho=rho))
                field = field_of(loop, rho=float(rho), errors=stated_errors(loop))
                grid = float(rho) * np.linspace(part, 1, POINTS)
                load = b * TIGHTER / (part * float(rho))
                extra = _pulls(loop, peaks, float(rho) * float(max(v)))
                field = replace(field, grid=grid, load=load, extra=extra)
                rate = 0.0
                if slowly:
                    rate = slowly * max(0.0, linear_rate(replace(field, load=0.0)))
                found = least_solution(field, alpha=rate, start=np.ones(loop.n))
                if found is None:
                    break
                v = _raised_weights(found)
            else:
                alpha = rounded_down(Fraction(rate) / 2, digits=3) or SLOW
                level = min(radius, rounded_down(rho * Fraction(part), digits=9))
                yield Level(v=v, alpha=alpha, level=level, rho=rho), error


def _loads(loop: Loop, peaks: Peaks | None, stage: Level) -> Array:
    """The largest b_i of every agent."""
    b = np.zeros(loop.n)
    for load in loads(loop, peaks, stage):
        b[load.agent] = max(b[load.agent], float(load.constant))
    return b


def _lowest(loop: Loop, peaks: Peaks | None, stage: Level) -> Level | None:
    """The stage with the lowest level for which its rows hold, about; None if they do not even hold
    near rho."""
    if stage.rho is None:
        return None
    rho = stage.rho

    def at(place: float, _: object = None) -> Level | None:
        level = rounded_up(rho * Fraction(math.exp(place)), digits=6)
        tried = _with_rate(loop, peaks, replace(stage, level=level))
        return tried if _holds(loop, peaks, tried) else None

    high, low = math.log(HIGHEST), math.log(DEEPEST)
    first = at(high)
    if first is None:
        return None
    _, lowest = last_found(at, first, high, low, steps=HALVINGS - 1)
    return replace(lowest, level=lowest.level * (1 + ABOVE))


def _with_rate(loop: Loop, peaks: Peaks | None, stage: Level) -> Level:
    """The stage with a small rate, which makes its rows strict."""
    b = _loads(loop, peaks, stage)
    least = float(np.min(b / np.array([float(x) for x in stage.v]))) / float(stage.level)
    return replace(stage, alpha=rounded_down(Fraction(least) * SLOW, digits=2) or SLOW)


def _holds(loop: Loop, peaks: Peaks | None, stage: Level) -> bool:
    """Whether the rows of a stage are proved, with room for a second program."""
    return not_shrinking(loop, peaks, stage, room=ROOM) is None


#: Parts of the box that are tried one after the other: noise passes through a coupling that is
#: steep far out.
PARTS = (
    Fraction(1),
    Fraction(1, 2),
    Fraction(1, 4),
    Fraction(1, 10),
    Fraction(1, 30),
    Fraction(1, 100),
)
DIGITS = 6  # of a bound, rounded up
NEARLY = Fraction(100_001, 100_000)  # kappa beta min v, which has to exceed 1


def accuracy_stage(case: Case, report: Progress) -> list[Check]:
    """The check ``accuracy`` beside the checks of a case; none where [uncertainty] adds no
    input."""
    loop, W, domain = case.loop, case.W, case.domain
    plant = loop.uncertainty
    if plant is None or not (
        plant.disturbance or plant.measurement or (plant.drift and loop.groups)
    ):
        return []
    report("bounding the final error")
    turned = loop.drift is not None or not acts_by_component(loop)
    if (reason := obstacle(loop, W, turned=turned)) is not None:
        return [undecided_check(ID, domain, reason, applies=False)]
    if (apart := why_no_weights(loop)) is not None:
        return [undecided_check(ID, domain, apart)]
    if (late := out_of_time()) is not None:
        return [undecided_check(ID, domain, late)]
    first = None
    with surviving("no final bounds"):
        with at_most(STAGE):
            peaks = None if W is None or not loop.groups else propose_peaks(loop, W)
        if loop.groups and peaks is None:
            reason = (
                "the peak gains of the observer are not bounded: its error does not decay, or "
                "too slowly."
            )
            return [undecided_check(ID, domain, reason)]
        claims = _turned if turned else _claims
        found = chain(claims(case, peaks), _of_response(loop, W, peaks, domain))
        first = next(found, None)
    if first is None:
        return [undecided_check(ID, domain, _not_found(loop))]
    return [first]


def _not_found(loop: Loop) -> str:
    """What is said where the search found nothing: of linear couplings bounds scale with the
    inputs, so that these cannot be too large."""
    what = "no box is found that shrinks under the inputs of [uncertainty]"
    if loop.is_linear:
        return (
            f"{what}: the search for its weights failed. The loop is linear, so that it is not "
            "their size."
        )
    return f"{what}: they may be too large for these gains, or the search may have missed it."


def _claims(case: Case, peaks: Peaks | None) -> Iterator[Check]:
    """Proved checks, for the largest box of starts first."""
    loop, W, domain = case.loop, case.W, case.domain
    if domain == EVERYWHERE:
        one = Level(v=(Fraction(1),) * loop.n, alpha=Fraction(1), level=Fraction(1), rho=None)
        claim = Accuracy(stages=_stages(loop, peaks, one), bounds={}, peaks=peaks)
        yield from _proved(loop, W, claim, domain)
        return
    known, starts = _outer(case)
    error = None if known is None else known.error
    boxes: list[_First] = []
    if known is not None and known.rho is not None:
        for part in PARTS:
            radius, disturbance = (decimal_below(x * part) if x else 0.0 for x in starts)
            outer = Level(v=known.v, alpha=known.alpha, level=known.rho, rho=known.rho * part)
            boxes.append(_First(outer, error, Box(radius, disturbance)))
    exosystem = loop.joint_exosystem
    if exosystem is not None and W is not None and error is None:
        error = propose_error_bound(exosystem, W)
    near = () if exosystem is not None and error is None else near_target(loop, peaks)
    whole = Box(*(decimal_below(x) if x else 0.0 for x in starts))
    held = covering_boxes(loop, peaks, error, starts) if boxes else ()
    tried = chain(
        boxes[:1],
        (_First(level, bound, whole) for level, bound in held),
        boxes[1:],
        (_near_box(level, error, starts[1]) for level in near),
    )
    for first in tried:
        stages = _stages(loop, peaks, first.level)
        claim = Accuracy(stages=stages, bounds={}, peaks=peaks, error=first.error)
        yield from _proved(loop, W, claim, first.starts, domain)


class _First(NamedTuple):
    """The stage from which others are looked for inwards, the observer's part, and the starts that
    it holds."""

    level: Level
    error: ErrorBound | None
    starts: Domain


def _turned(case: Case, peaks: Peaks | None) -> Iterator[Check]:
    """The same in coordinates: of linear couplings those with the smallest bounds, else the boxes
    that max-separable proves in its own."""
    loop, W, domain = case.loop, case.W, case.domain
    if loop.is_linear:
        near = _near(loop, peaks)[:MOST_COORDINATES]
        for T, v in chain(near, _proved_weights(case)):
            stages = tuple(propose_turned(loop, peaks, T, v, None))[-1:]
            claim = Accuracy(stages=stages, bounds={}, peaks=peaks, T=T)
            yield from _proved(loop, W, claim, EVERYWHERE, domain)
        return
    known = _separable(case)
    base = known.claim
    if not isinstance(base, Separable) or base.rho is None or not isinstance(known.domain, Around):
        return
    T, v = _in_coordinates(base, loop.m)
    for part in PARTS:
        radius = decimal_below(claimed(known.domain.radius) * part)
        disturbance = decimal_below(claimed(known.domain.disturbance) * part)
        with at_most(STAGE), surviving("no final bounds in coordinates", UndefinedError):
            inwards = propose_turned(loop, peaks, T, v, base.rho * part)
            stages = tuple(islice(inwards, MOST_STAGES))
            claim = Accuracy(stages=stages, bounds={}, peaks=peaks, error=base.error, T=T)
            yield from _proved(loop, W, claim, Box(radius, disturbance), domain)


def _of_response(
    loop: Loop, W: Matrix | None, peaks: Peaks | None, domain: Domain
) -> Iterator[Check]:
    """The bounds of a linear loop in one mode by its peak gains, which need no coordinates, if they
    are proved."""
    if response_obstacle(loop) is not None or out_of_time() is not None:
        return
    response = _followed(loop)
    ends = None if response is None else response_bounds(loop, peaks, response)
    if ends is not None:
        bounds = {label: _raised(x * (1 + MORE) for x in each) for label, each in ends.items()}
        claim = Accuracy(stages=(), bounds=bounds, peaks=peaks, response=response)
        check = limited(
            ID, domain, lambda: accuracy_check(loop, W, claim, domain=EVERYWHERE, local=domain)
        )
        if check.verdict is Verdict.PROVED:
            yield check


def _followed(loop: Loop) -> Response | None:
    """Steps that follow a linear loop until little of its response is left; None where it does not
    decay, or slowly."""
    M = loop_matrix(loop)
    if M is None:
        return None
    size, most = float(row_norm(M)), most_steps(loop)
    horizon = _decayed(to_float(M), size) if 0 < size < math.inf else None
    if horizon is None:
        return None
    h = rounded_up(Fraction(min(max(FINE / size, horizon / most), COARSE / size)), digits=3)
    return Response(step=h, steps=min(most, math.ceil(horizon / float(h))))


def _decayed(M: Array, size: float) -> float | None:
    """A time after which |exp(M t)| is small, about the first one, |M| = ``size``; None where that
    takes too long."""

    def norm(matrix: Array) -> float:
        return float(np.max(np.sum(np.abs(matrix), axis=1)))

    time, power = 1 / size, linalg.expm(M / size)
    with np.errstate(all="ignore"):
        while not norm(power) <= LEFT:
            if time * size > MOST_GROWTH:
                return None
            time, power = 2 * time, power @ power
    sooner = (part * time for part in (0.625, 0.75, 0.875))
    return next((t for t in sooner if norm(linalg.expm(M * t)) <= LEFT), time)


def _raised(values: Iterable[Fraction]) -> Vector:
    return tuple(rounded_up(x, digits=DIGITS) for x in values)


def _separable(case: Case) -> Check:
    """The max-separable check of the case where it is proved, else what is found for every
    start."""
    known = case.proof(Separable)
    if known is not None:
        return known
    asked = read_region(case.loop, case.W, domain=case.domain, everything=True)
    return separable_stage(asked, lambda _: None)[0]


def _in_coordinates(base: Separable, m: int) -> tuple[Matrix, Vector]:
    """T and v (n m,) of a claim; by component |e_ic| <= v_i and T = I."""
    if base.T is not None:
        return base.T, tuple(base.v)
    return identity(m), tuple(x for x in base.v for _ in range(m))


def _proved_weights(case: Case) -> Iterator[tuple[Matrix, Vector]]:
    """Coordinates and weights of a max-separable proof, whose rows hold strictly: some multiple of
    them does."""
    base = _separable(case).claim
    if isinstance(base, Separable):
        yield _in_coordinates(base, case.loop.m)


def _near(loop: Loop, peaks: Peaks | None) -> list[tuple[Matrix, Vector]]:
    """Coordinates and weights for linear couplings: those with the smallest bounds (in the
    geometric mean) first."""
    agents, found = Agents.of(loop, most=loop.n), dict[Matrix, tuple[float, Vector]]()
    ones = np.ones((loop.n, loop.m))
    gains = agents.gains_at(np.eye(loop.m), ones, 1.0)
    if gains is None:
        return []
    for T in candidates(agents, gains):
        if T is not None and T not in found:
            acts = np.array([float(x) for x in load_in_coordinates(loop, peaks, T)])
            v = _least_weights(agents, to_float(T), gains, acts + np.max(acts) * SLACK)
            if v is not None:
                weights = _raised_weights(v)
                sizes = np.array([[float(x) for x in each] for each in error_sizes(T, weights)])
                found[T] = float(np.sum(np.log(sizes))), weights
    return [(T, found[T][1]) for T in sorted(found, key=lambda T: found[T][0])]


def _least_weights(agents: Agents, T: Array, gains: Gains, acts: Array) -> Array | None:
    """The v (n m,) at which the largest row of every component is -acts, or None.

    Rows are chosen at the last v, and v solves the chosen ones: with optional arcs another row may
    be the largest there.  It rises from step to step (policy iteration) where the first v makes all
    rows fall, as ones often do, and as the v with the best rate does where there is one.
    """
    starts = [
        np.ones((agents.size, agents.loop.m)),
        *(v for _, v in agents.vectors(T, gains)[-1:]),
    ]
    for start in starts:
        v = start
        for _ in range(CHOICES):
            u = solved(agents.rows(T, gains, v)[1], acts, np.ones(v.size, dtype=bool))
            if u is None or not np.all(u > 0):
                break
            u = u.reshape(v.shape)
            if np.allclose(u, v, rtol=SETTLED, atol=0):
                return np.ravel(u)
            v = u
    return None


def propose_turned(
    loop: Loop, peaks: Peaks | None, T: Matrix, v: Sequence[Fraction], rho: Fraction | None
) -> Iterator[Level]:
    """Stages in coordinates from the box N <= rho inwards, for linear couplings (without rho)
    one."""
    load = load_in_coordinates(loop, peaks, T)
    acts = np.array([float(x) for x in load])
    agents, turned = Agents.of(loop, most=loop.n), to_float(T)
    last = math.inf

    def stage(
        weights: Sequence[Fraction], rho: Fraction | None
    ) -> tuple[Level | None, Array | None]:
        """The lowest level for these weights, and the weights that these gains ask for."""
        ranges = enclosed_ranges(loop, T, weights, rho)
        u = np.array([float(x) for x in weights])
        best, M = agents.rows(turned, in_floats(ranges), u.reshape(-1, loop.m))
        better = solved(M, acts + np.max(acts) * SLACK, np.ones(u.size, dtype=bool))
        if not np.all(best < 0):
            return None, better
        lowest = Fraction(float(np.max(acts / -best.ravel())))
        level = rounded_up(lowest * (1 + ABOVE), digits=9)
        if level <= 0 or (rho is not None and level > rho):
            return None, better
        at_level = tuple(x / level for x in load)
        rate = slowest_row(loop, T, weights, ranges, load=at_level).rate
        if rate <= 0:
            return None, better
        alpha = rounded_down(rate, digits=2)
        found = Level(v=tuple(weights), alpha=alpha, level=level, rho=rho, ranges=ranges)
        return found, better

    found, better = stage(v, rho)
    while found is not None:
        size = float(found.level * max(map(max, error_sizes(T, found.v))))
        if size >= float(WORTH) * last:
            return
        yield found
        if better is None or not np.all(better > 0):
            return
        last = size
        u = _raised_weights(better)
        if rho is not None:
            # the box in which this stage ends has to lie inside the next one
            ratio = max(found.level * x / y for x, y in zip(found.v, u, strict=True))
            rho = rounded_up(ratio * (1 + ABOVE), digits=9)
        found, better = stage(u, rho)


def _near_box(outer: Level, error: ErrorBound | None, disturbance: Fraction) -> _First:
    """A stage |e_i| <= v_i with starts in it: half of what its level leaves is for the errors of
    the estimates."""
    smallest = min(outer.v)
    room = (1 - outer.level) / 2
    if error is None:
        return _First(outer, None, Box(decimal_below(smallest), 0.0))
    kappa = rounded_up(1 / (error.beta * smallest) * NEARLY, digits=9)
    most = min(disturbance, room / (kappa * root_above(error.size, unit=10**9)))
    radius = decimal_below(smallest * (1 - room))
    starts = Box(radius, decimal_below(most) if most else 0.0)
    return _First(outer, replace(error, kappa=kappa), starts)


def _outer(case: Case) -> tuple[Separable | None, tuple[Fraction, Fraction]]:
    """A box that shrinks without the inputs, and its starts: that of the case, else the largest
    one that is found."""
    known = case.proof(Separable)
    if (
        known is not None
        and isinstance(known.claim, Separable)
        and isinstance(known.domain, Around)
    ):
        return known.claim, (claimed(known.domain.radius), claimed(known.domain.disturbance))
    asked = read_region(case.loop, case.W, domain=case.domain, everything=True)
    found = None
    # Where it was examined in vain already, it is not searched for a second time.
    if case.named(MAX_SEPARABLE) is None:
        with at_most(STAGE):
            found = largest_claim(asked)
    if found is None:
        return None, (Fraction(0), claimed(asked.disturbance))
    return found.claim, (claimed(found.radius), claimed(asked.disturbance))


def _stages(loop: Loop, peaks: Peaks | None, outer: Level) -> tuple[Level, ...]:
    """Stages as far as they are found within the work of one stage of ``certify``."""
    stages: list[Level] = []
    try:
        with at_most(STAGE):
            for stage in propose_stages(loop, peaks, outer):
                stages.append(stage)
                if len(stages) == MOST_STAGES:
                    break
    except WorkLimitError:
        pass
    return tuple(stages)


def _proved(
    loop: Loop, W: Matrix | None, claim: Accuracy, starts: Domain, local: Domain = EVERYWHERE
) -> Iterator[Check]:
    """The check of a claim with its bounds, if it is proved."""
    if not claim.stages:
        return
    ends = zip(loop.labels, claim.ends, strict=True)
    vectors = {label: _raised(each) for label, each in ends}
    bounds: Mapping[str, Fraction | Vector] = vectors
    if claim.T is None:
        bounds = {label: each[0] for label, each in vectors.items()}
    whole = replace(claim, bounds=bounds)
    check = limited(ID, local, lambda: accuracy_check(loop, W, whole, domain=starts, local=local))
    if check.verdict is Verdict.PROVED:
        yield check
