"""Final bounds of the error: when they are looked for and what is reported (theory, section 12)."""

import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from functools import partial
from itertools import chain, islice
from typing import Any, NamedTuple

import numpy as np
from scipy import linalg, sparse

from dobc_design.conditions.arcs.claim import ArcWise
from dobc_design.conditions.arcs.decide import close_root
from dobc_design.conditions.arcs.stage import claims_in
from dobc_design.conditions.case import Case
from dobc_design.conditions.check import Check, limited, surviving, undecided_check
from dobc_design.conditions.consensus.propose import decay_of
from dobc_design.conditions.coverage import Asked, Progress, read_region
from dobc_design.conditions.domain import EVERYWHERE, Around, Box, Domain
from dobc_design.conditions.kinds import MAX_SEPARABLE
from dobc_design.conditions.numbers import (
    claimed,
    decimal_above,
    decimal_below,
    last_found,
    rounded_down,
    rounded_up,
)
from dobc_design.conditions.observer.bands import filters
from dobc_design.conditions.observer.channels import channels
from dobc_design.conditions.observer.propose import band_gains
from dobc_design.conditions.separable.checks import why_no_weights
from dobc_design.conditions.separable.claim import (
    ErrorBound,
    Separable,
    acts_by_component,
    error_sizes,
    stated_errors,
)
from dobc_design.conditions.separable.coordinates import enclosed_ranges, slowest_row
from dobc_design.conditions.separable.propose import Field, field_of, least_solution, linear_rate
from dobc_design.conditions.separable.propose_coordinates import (
    Agents,
    Rows,
    candidates,
    in_floats,
    solved_whole,
)
from dobc_design.conditions.separable.propose_observer import propose_error_bound, radius_needed
from dobc_design.conditions.separable.stage import largest_claim, separable_stage
from dobc_design.conditions.stated import holds_asked, stated_in
from dobc_design.coupling.expression import numpy_function
from dobc_design.exact.interval import UndefinedError
from dobc_design.exact.matrix import (
    Array,
    Matrix,
    Vector,
    identity,
    largest_entry,
    row_norm,
    to_float,
)
from dobc_design.exact.number import ONE, ZERO, root_above
from dobc_design.exact.peaks import MOST_GROWTH, MOST_STEPS, balanced
from dobc_design.exact.polynomial import routh
from dobc_design.exact.work import STAGE, WorkLimitError, at_most, out_of_time
from dobc_design.loop.arcs import coupling_places
from dobc_design.loop.loop import Loop

from .decide import (
    ID,
    INPUTS,
    MOST_STAGES,
    Accuracy,
    Level,
    Peaks,
    Plant,
    Response,
    accuracy_check,
    loop_matrix,
    most_steps,
    observer_peaks,
    obstacle,
    response_obstacle,
    takes_integrals,
)

DECAYED = 12.0  # exponents of the slowest mode that the steps follow
FINENESS = (0.1, 0.035, 0.012)  # |F| h of a step: the first that loses little
LOST = Fraction(10_001, 10_000)  # beside the next
BETTER = Fraction(9, 10)  # of the largest bound
COARSEST = 0.3  # |F| h, where there are not enough finer ones
LEFT = 1e-4  # of the response of a whole loop, after the steps that follow it
FINE = 0.25  # |M| h of a step
COARSE = 0.4  # the same, where there are not enough finer ones
#: How much more than b_i v is made for, where it has to reach further out.
SPREADS = (1.0, 1.1, 1.2, 1.4, 1.7, 2.2, 3.0, 5.0, 8.0, 20.0, 60.0, 200.0)
ABOVE = Fraction(1, 50_000)  # of a level, left to two programs that round apart
MORE = Fraction(1, 10**6)  # the same, of a peak gain
WORTH = Fraction(998, 1000)  # what a stage has to leave of the largest bound, or less
HALVINGS = 10
DEEPEST = 1e-4  # part of rho down to which the lowest level is looked for
HIGHEST = 0.98  # part of rho at which a stage has to hold
SLOW = Fraction(1, 10**7)  # the rate of a stage, as a part of b_i/(level v_i)
LEAST = 1e-3  # the first guess of v, as a part of what b_i does to an agent alone
NEAR = 1e-6  # where slopes are taken
V_DIGITS = 12
CHOICES = 30  # of rows, one after the other
SETTLED = 1e-9  # of v, when none of them changes any more
SLACK = 1e-5  # of the largest input, for rows in which nothing acts
MOST_COORDINATES = 3  # in which rows are decided
FROM = (0.9, 0.5, 0.98)  # parts of rho from which the first stage is looked for
ROOM = Fraction(1, 100)  # of eta, for a second program with wider enclosures
POINTS = 9  # of s
SAMPLES = 500  # of h
TIGHTER = 1 + 1e-6  # what is left to rounding


def propose_peaks(loop: Loop, W: Matrix) -> Peaks | None:
    """Proved upper bounds of the peak gains, a little above; None where none are found."""
    bands = tuple(band_gains(loop, W, band) for band in loop.bands)
    if not takes_integrals(loop):
        stable = all(routh(below).is_proved for below, _ in filters(loop, W))
        return Peaks(bands=bands) if stable else None
    matrices = [to_float(balanced(channel.F)[0]) for channel in channels(loop, W)]
    decay = min(map(decay_of, matrices))
    size = max(map(_row_norm, matrices))
    if not (decay > 0 and np.isfinite(size)):
        return None
    horizon = DECAYED / decay
    found: Peaks | None = None
    for fine in FINENESS:
        # Fine steps lose little; slow observers need longer ones, to be followed to their end.
        h = min(max(fine / size, horizon / MOST_STEPS), COARSEST / size)
        steps = min(MOST_STEPS, int(np.ceil(horizon / h)))
        finer = observer_peaks(loop, W, step=rounded_up(Fraction(h), digits=3), steps=steps)
        if found is not None and (finer is None or _are_close(found, finer)):
            break
        found = finer
    if found is None:
        return None
    raised: dict[str, Any] = {}
    for name in INPUTS:
        raised[name] = rounded_up(getattr(found, name) * (1 + MORE), digits=7)
    off = tuple(rounded_up(x * (1 + MORE), digits=7) for x in found.off)
    return replace(found, **raised, bands=bands, off=off)


def _are_close(found: Peaks, finer: Peaks) -> bool:
    """Whether finer steps gain little."""
    both = [(getattr(found, name), getattr(finer, name)) for name in INPUTS]
    both += zip(found.off, finer.off, strict=True)
    return all(x <= LOST * y for x, y in both)


def _row_norm(matrix: Array) -> float:
    """The largest sum of sizes of a row."""
    return float(np.max(np.sum(np.abs(matrix), axis=1)))


def propose_stages(plant: Plant, outer: Level) -> Iterator[Level]:
    """Stages from the box of ``outer`` inwards, each decided already; for linear couplings one
    does."""
    last: Level | None = outer
    if outer.rho is not None:
        last = _lowest(plant, outer)
        if last is not None:
            yield last
    while last is not None:
        last = next(_inside(plant, last), None)
        if last is not None:
            yield last
            if last.rho is None:
                return


def near_target(plant: Plant) -> Iterator[Level]:
    """Boxes |e_i| <= v_i around the target that shrink, larger ones first: v as the rows near the
    target want it."""
    # In a box this small the slopes are those at the target.
    tiny = Level(v=(ONE,) * plant.loop.n, alpha=SLOW, level=SLOW, rho=Fraction(1, 1000))
    for v in reversed(list(_vectors(plant, tiny, SPREADS))):
        level = None if v is None else _lowest(plant, replace(tiny, v=v, rho=ONE))
        if level is not None:
            yield level


def _inside(plant: Plant, before: Level) -> Iterator[Level]:
    """Stages that take over where ``before`` ends, and leave less of its largest bound."""
    within = before
    rho = None
    spreads: Sequence[float] = SPREADS[:1]
    if before.rho is not None:
        within = replace(before, rho=before.level)
        spreads = SPREADS
    for spread, v in zip(spreads, _vectors(plant, within, spreads), strict=True):
        if v is None:
            continue
        if before.rho is not None:
            rho = _reach(before, v)
        tight = _with_rate(plant, Level(v=v, alpha=SLOW, level=1 + ABOVE, rho=rho))
        # v was made for b_i at s = 1, so that this level is the lowest one if its rows hold.
        is_inside = spread == 1 and (rho is None or tight.level < rho)
        if is_inside and plant.not_shrinking(tight) is None:
            found: Level | None = tight
        else:
            found = _lowest(plant, tight)
        if found is None:
            continue
        if rho is None or found.level * max(found.v) <= WORTH * before.level * max(before.v):
            yield found


def _reach(before: Level, v: Sequence[Fraction]) -> Fraction:
    """The rho with which the box in which a stage ends lies inside that of the next one."""
    ratio = max(before.level * x / y for x, y in zip(before.v, v, strict=True))
    return rounded_up(ratio * (1 + ABOVE), digits=9)


def _vectors(plant: Plant, within: Level, spreads: Sequence[float]) -> Iterator[Vector | None]:
    """v for the rows with b_i at s = 1, b_i as in the box ``within``, and with multiples, which
    reach further."""
    b = _loads(plant, within)
    size = 1.0 if within.rho is None else float(max(within.v)) * float(within.rho)
    field = field_of(plant.loop, rho=size, errors=stated_errors(plant.loop))
    field = replace(field, grid=np.array([1.0]), extra=_pulls(plant, size))
    for spread in spreads:
        with np.errstate(all="ignore"):
            # What an agent alone would come to is below the solution, where Newton may begin.
            own = -field.rows(b * NEAR, alpha=0.0)[1].diagonal()
            lower = LEAST * spread * b / np.where(own > 0, own, 1.0)
            v = least_solution(replace(field, load=spread * b), alpha=0.0, start=lower, lower=lower)
        yield None if v is None else _raised_weights(v)


def _raised_weights(v: Array) -> Vector:
    """Weights as decimals a little above."""
    return tuple(rounded_up(Fraction(x), digits=V_DIGITS) for x in v.ravel().tolist())


def _pulls(plant: Plant, reach: float) -> Any:
    """eta_i as a matrix (n, n) that acts on v, for |y| <= 2 reach; None where the observers know
    the weights."""
    loop = plant.loop
    stated = plant.stated
    peaks = plant.peaks
    if stated.known_to_agents or not stated.weights or peaks is None:
        return None
    y = np.linspace(0, 2 * reach, SAMPLES)[1:]
    secants = []
    for function in loop.functions:
        h = numpy_function(function.components[0])
        secants.append(max(largest_entry(h(y) / y), largest_entry(h(-y) / y)))
    steepest = np.array(secants)
    passed = float(stated.weights * peaks.disturbance * (1 + ROOM) * (1 + ABOVE))
    total = sparse.csr_array((loop.n, loop.n))
    for arcs in loop.modes.values():
        w = np.array(arcs.weights, dtype=float) * steepest[coupling_places(loop, arcs)]
        w *= passed
        rows = np.concatenate([arcs.listeners, arcs.listeners])
        columns = np.concatenate([arcs.listeners, arcs.speakers])
        entries = np.concatenate([w, w])
        # an observer has seen all modes: the worst counts
        table = sparse.csr_array((entries, (rows, columns)), shape=(loop.n, loop.nodes))
        total = total.maximum(table[:, : loop.n])
    return total


def covering_boxes(
    plant: Plant,
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
        box = Level(v=(ONE,) * plant.loop.n, alpha=SLOW, level=rho, rho=rho)
        with surviving("no box that holds the starts", UndefinedError), np.errstate(all="ignore"):
            for _ in range(2):  # with noise, what acts depends on how far v reaches
                field = _loaded_field(plant, box, part)
                rate = 0.0
                if slowly:
                    rate = slowly * max(0.0, linear_rate(replace(field, load=0.0)))
                found = least_solution(field, alpha=rate, start=np.ones(field.size))
                if found is None:
                    break
                box = replace(box, v=_raised_weights(found))
            else:
                alpha = rounded_down(Fraction(rate) / 2, digits=3) or SLOW
                level = min(radius, rounded_down(rho * Fraction(part), digits=9))
                yield replace(box, alpha=alpha, level=level), error


def _loaded_field(plant: Plant, box: Level, part: float) -> Field:
    """The rows for s from a part of rho on, with what acts in the box."""
    rho = float(box.level)
    field = field_of(plant.loop, rho=rho, errors=stated_errors(plant.loop))
    return replace(
        field,
        grid=rho * np.linspace(part, 1, POINTS),
        load=_loads(plant, box) * TIGHTER / (part * rho),
        extra=_pulls(plant, rho * float(max(box.v))),
    )


def _loads(plant: Plant, stage: Level) -> Array:
    """The largest b_i of every agent."""
    return np.array(plant.largest(stage), dtype=float)


def _lowest(plant: Plant, stage: Level) -> Level | None:
    """The stage with the lowest level for which its rows hold, about; None if they do not even hold
    near rho, and without rho."""
    if stage.rho is None:
        return None
    rho = stage.rho

    def at(place: float, _: object = None) -> Level | None:
        level = rounded_up(rho * Fraction(math.exp(place)), digits=6)
        tried = _with_rate(plant, replace(stage, level=level))
        return tried if plant.not_shrinking(tried) is None else None

    high = math.log(HIGHEST)
    low = math.log(DEEPEST)
    first = at(high)
    if first is None:
        return None
    _, lowest = last_found(at, first, high, low, steps=HALVINGS - 1)
    return replace(lowest, level=lowest.level * (1 + ABOVE))


def _with_rate(plant: Plant, stage: Level) -> Level:
    """The stage with a small rate, which makes its rows strict."""
    v = np.array(stage.v, dtype=float)
    least = float(np.min(_loads(plant, stage) / v)) / float(stage.level)
    return replace(stage, alpha=rounded_down(Fraction(least) * SLOW, digits=2) or SLOW)


#: Parts of the box that are tried one after the other: noise passes through a coupling that is
#: steep far out.
PARTS = (
    ONE,
    Fraction(1, 2),
    Fraction(1, 4),
    Fraction(1, 10),
    Fraction(1, 30),
    Fraction(1, 100),
)
MOST_BALLS = 10
NO_BALL = "And no ball of an arc-wise proof is found that shrinks under what acts for ever."
DIGITS = 6  # of a bound, rounded up
NEARLY = Fraction(100_001, 100_000)  # kappa beta min v, which has to exceed 1


def accuracy_stage(case: Case, report: Progress) -> list[Check]:
    """The check ``accuracy`` beside the checks of a case; none where [uncertainty] adds no
    input."""
    loop = case.loop
    W = case.W
    if not stated_in(loop).absolute:
        return []
    undecided = partial(undecided_check, ID, case.domain)
    report("bounding the final error")
    turned = loop.drift is not None or not acts_by_component(loop)
    reason = obstacle(loop, W, turned=turned)
    if reason is not None:
        return [undecided(reason, applies=False)]
    late = out_of_time()
    if late is not None:
        return [undecided(late)]
    apart = why_no_weights(loop)
    peaks = first = None
    with surviving("no final bounds"):
        if W is not None and loop.groups:
            with at_most(STAGE):
                peaks = propose_peaks(loop, W)
            if peaks is None:
                return [
                    undecided(
                        "the peak gains of the observer are not bounded: its error does not "
                        "decay, or too slowly."
                    )
                ]
        plant = Plant(loop=loop, peaks=peaks, room=ROOM)
        claims = _turned if turned else _claims
        ways = [] if apart else [claims(case, plant), _of_response(case, plant)]
        if turned:
            ways.reverse()
        first = next(chain(*ways), None)
        # Linear rows of scalars lose nothing, but of sines they know the size alone.
        if first is not None and loop.bands and not turned:
            other = next(_of_response(case, plant), None)
            if other is not None and _largest(other) < BETTER * _largest(first):
                first = other
        if first is None or not holds_asked(loop, first):
            first = next(_by_arcs(case, plant), first)
    if first is not None:
        return [first]
    nothing = _not_found(loop) if apart is None else f"{apart} {NO_BALL}"
    return [undecided(nothing)]


def _largest(check: Check) -> Fraction:
    """The largest bound."""
    claim = check.claim
    if not isinstance(claim, Accuracy):
        raise TypeError("it claims no bounds")
    return max(max(bounds) for bounds in claim.listed.values())


def _not_found(loop: Loop) -> str:
    """What is said where the search found nothing: of linear couplings bounds scale with the
    inputs, so that these cannot be too large."""
    what = "no box is found that shrinks under what acts for ever"
    if loop.is_linear:
        return (
            f"{what}: the search for its weights failed. The loop is linear, so that it is not "
            "their size."
        )
    return f"{what}: they may be too large for these gains, or the search may have missed it."


def _claims(case: Case, plant: Plant) -> Iterator[Check]:
    """Proved checks, for the largest box of starts first."""
    loop = case.loop
    if case.domain == EVERYWHERE:
        one = Level(v=(ONE,) * loop.n, alpha=ONE, level=ONE, rho=None)
        yield from _proved_from(case, plant, _First(one, None, EVERYWHERE))
        return
    known, (radius, disturbance) = _outer(case)
    error = None if known is None else known.error
    boxes: list[_First] = []
    if known is not None and known.rho is not None:
        for part in PARTS:
            outer = Level(v=known.v, alpha=known.alpha, level=known.rho, rho=known.rho * part)
            boxes.append(_First(outer, error, _box(radius * part, disturbance * part)))
    exosystem = loop.joint_exosystem
    if exosystem is not None and case.W is not None and error is None:
        error = propose_error_bound(exosystem, case.W)
    near = () if exosystem is not None and error is None else near_target(plant)
    whole = _box(radius, disturbance)
    held = covering_boxes(plant, error, (radius, disturbance)) if boxes else ()
    # The whole box first, then those made for what acts; smaller ones hold fewer starts.
    tried = chain(
        boxes[:1],
        (_First(level, bound, whole) for level, bound in held),
        boxes[1:],
        (_near_box(level, error, disturbance) for level in near),
    )
    for first in tried:
        yield from _proved_from(case, plant, first)


class _First(NamedTuple):
    """The stage from which others are looked for inwards, the observer's part, and the starts that
    it holds."""

    level: Level
    error: ErrorBound | None
    starts: Domain


def _box(radius: Fraction, disturbance: Fraction) -> Box:
    """The box with decimals that are not above."""
    return Box(decimal_below(radius), decimal_below(disturbance))


def _proved_from(case: Case, plant: Plant, first: _First) -> Iterator[Check]:
    """The check of the stages from this one inwards, if it is proved."""
    stages = _stages(plant, first.level)
    claim = Accuracy(stages=stages, bounds={}, peaks=plant.peaks, error=first.error)
    yield from _proved(case, plant, claim, first.starts)


def _turned(case: Case, plant: Plant) -> Iterator[Check]:
    """The same in coordinates: of linear couplings those with the smallest bounds, else the boxes
    that max-separable proves in its own."""
    loop = case.loop
    peaks = plant.peaks
    if loop.is_linear:
        near = _near(plant)[:MOST_COORDINATES]
        for T, v in chain(near, _proved_weights(case)):
            stages = tuple(propose_turned(plant, T, v, None))[-1:]
            claim = Accuracy(stages=stages, bounds={}, peaks=peaks, T=T)
            yield from _proved(case, plant, claim, EVERYWHERE)
        return
    known = _separable(case)
    base = known.claim
    starts = known.domain
    if not isinstance(base, Separable) or base.rho is None or not isinstance(starts, Around):
        return
    T, v = _in_coordinates(base, loop.m)
    for part in PARTS:
        box = _box(claimed(starts.radius) * part, claimed(starts.disturbance) * part)
        with at_most(STAGE), surviving("no final bounds in coordinates", UndefinedError):
            inwards = propose_turned(plant, T, v, base.rho * part)
            stages = tuple(islice(inwards, MOST_STAGES))
            claim = Accuracy(stages=stages, bounds={}, peaks=peaks, error=base.error, T=T)
            yield from _proved(case, plant, claim, box)


def _by_arcs(case: Case, plant: Plant) -> Iterator[Check]:
    """The bounds by arc-wise balls, from the box asked for or a part of it."""
    loop = case.loop
    asked = _everything(case)
    for part in () if loop.estimated else PARTS:
        starts = _box(claimed(asked.radius) * part, claimed(asked.disturbance) * part)
        with at_most(STAGE), surviving("no final balls", UndefinedError, WorkLimitError):
            balls = tuple(islice(_balls(plant, case.W, starts), MOST_BALLS))
            if balls:
                left = plant.left_in(balls[-1])
                ends = _raised(close_root(left / d) for d in balls[-1].d)
                bounds = dict(zip(loop.labels, ends, strict=True))
                claim = Accuracy(stages=(), bounds=bounds, peaks=plant.peaks, balls=balls)
                yield from _decided(case, claim, starts)


def _balls(plant: Plant, W: Matrix | None, box: Box) -> Iterator[ArcWise]:
    """Arc-wise claims from a box inwards, each about what the last one leaves."""
    d: Sequence[Fraction] | None = None
    left = ZERO
    while True:
        for ball in claims_in(plant.loop, W, box):
            less = plant.left_in(ball)
            same = d is None or tuple(ball.d) == tuple(d)
            if same and less < WORTH * (left or ball.level):
                break
        else:
            return
        yield ball
        d, left = ball.d, less
        # The corners of this box are where V is as large.
        weight = plant.loop.m * sum(d)
        box = Box(decimal_above(close_root(left / weight)), 0.0)


def _of_response(case: Case, plant: Plant) -> Iterator[Check]:
    """The bounds of a linear loop in one mode by its peak gains, which need no coordinates, if they
    are proved."""
    if response_obstacle(plant.loop) is not None or out_of_time() is not None:
        return
    response = _followed(plant.loop)
    ends = None if response is None else plant.response_bounds(response)
    if ends is not None:
        bounds = {label: _raised(x * (1 + MORE) for x in each) for label, each in ends.items()}
        claim = Accuracy(stages=(), bounds=bounds, peaks=plant.peaks, response=response)
        yield from _decided(case, claim, EVERYWHERE)


def _followed(loop: Loop) -> Response | None:
    """Steps that follow a linear loop until little of its response is left; None where it does not
    decay, or slowly."""
    M = loop_matrix(loop)
    if M is None:
        return None
    M, _ = balanced(M)
    size = float(row_norm(M))
    most = most_steps(loop)
    horizon = _decayed(to_float(M), size) if 0 < size < math.inf else None
    if horizon is None:
        return None
    h = rounded_up(Fraction(min(max(FINE / size, horizon / most), COARSE / size)), digits=3)
    return Response(step=h, steps=min(most, math.ceil(horizon / float(h))))


def _decayed(M: Array, size: float) -> float | None:
    """A time after which |exp(M t)| is small, about the first one, |M| = ``size``; None where that
    takes too long."""
    time = 1 / size
    power = linalg.expm(M / size)
    with np.errstate(all="ignore"):
        while not _row_norm(power) <= LEFT:
            if time * size > MOST_GROWTH:
                return None
            time, power = 2 * time, power @ power  # exp(2 M t)
    sooner = (part * time for part in (0.625, 0.75, 0.875))
    return next((t for t in sooner if _row_norm(linalg.expm(M * t)) <= LEFT), time)


def _raised(values: Iterable[Fraction]) -> Vector:
    return tuple(rounded_up(x, digits=DIGITS) for x in values)


def _separable(case: Case) -> Check:
    """The max-separable check of the case where it is proved, else what is found for every
    start."""
    known = case.proof(Separable)
    return known or separable_stage(_everything(case), lambda _: None)[0]


def _everything(case: Case) -> Asked:
    return read_region(case.loop, case.W, domain=case.domain, everything=True)


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


def _near(plant: Plant) -> list[tuple[Matrix, Vector]]:
    """Coordinates and weights for linear couplings: those with the smallest bounds (in the
    geometric mean) first."""
    agents = Agents.of(plant.loop, most=plant.loop.n)
    gains = agents.gains_near(1.0)
    if gains is None:
        return []
    found: list[tuple[float, Matrix, Vector]] = []
    for T in candidates(agents, gains):
        v = _least_weights(Rows.of(agents, to_float(T), gains), _acting(plant, T))
        if v is not None:
            weights = _raised_weights(v)
            sizes = np.array(list(error_sizes(T, weights)), dtype=float)
            found.append((float(np.sum(np.log(sizes))), T, weights))
    found.sort(key=lambda each: each[0])
    return [(T, weights) for _, T, weights in found]


def _acting(plant: Plant, T: Matrix) -> Array:
    """What acts on every component, (n, m), with a little where nothing does."""
    acts: Array = np.array(plant.load_in(T), dtype=float)
    return (acts + np.max(acts) * SLACK).reshape(-1, len(T))


def _least_weights(rows: Rows, acts: Array) -> Array | None:
    """The v (n, m) at which the largest row of every component is -acts (n, m), or None.

    Rows are chosen at the last v, and v solves the chosen ones: with optional arcs another row may
    be the largest there.  It rises from step to step (policy iteration) where the first v makes all
    rows fall, as ones often do, and as the v with the best rate does where there is one.
    """
    starts = [rows.agents.ones, *(v for _, v in rows.vectors()[-1:])]
    for start in starts:
        v = start
        for _ in range(CHOICES):
            u = solved_whole(rows.chosen(v)[1], acts)
            if u is None:
                break
            if np.allclose(u, v, rtol=SETTLED, atol=0):
                return u
            v = u
    return None


def propose_turned(plant: Plant, T: Matrix, v: Vector, rho: Fraction | None) -> Iterator[Level]:
    """Stages in coordinates from the box N <= rho inwards, for linear couplings (without rho)
    one."""
    last = math.inf
    agents = Agents.of(plant.loop, most=plant.loop.n)
    found, better = _stage_in(plant, agents, T, v, rho)
    while found is not None:
        size = float(found.level * max(map(max, error_sizes(T, found.v))))
        if size >= float(WORTH) * last:
            return
        yield found
        if better is None:
            return
        last = size
        u = _raised_weights(better)
        if rho is not None:
            rho = _reach(found, u)
        found, better = _stage_in(plant, agents, T, u, rho)


def _stage_in(
    plant: Plant, agents: Agents, T: Matrix, v: Vector, rho: Fraction | None
) -> tuple[Level | None, Array | None]:
    """The lowest level for these weights, and the weights that these gains ask for."""
    loop = plant.loop
    ranges = enclosed_ranges(loop, T, v, rho)
    rows = Rows.of(agents, to_float(T), in_floats(ranges))
    best, M = rows.chosen(np.array(v, dtype=float).reshape(-1, loop.m))
    better = solved_whole(M, _acting(plant, T))
    if not np.all(best < 0):
        return None, better
    load = plant.load_in(T)
    acts = np.array(load, dtype=float)
    # Rows fall like best s for every s: from this s on they outweigh what acts.
    lowest = Fraction(float(np.max(acts / -best.ravel())))
    level = rounded_up(lowest * (1 + ABOVE), digits=9)
    if level <= 0 or (rho is not None and level > rho):
        return None, better
    at_level = tuple(x / level for x in load)
    rate = slowest_row(loop, T, v, ranges, load=at_level).rate
    if rate <= 0:
        return None, better
    alpha = rounded_down(rate, digits=2)
    return Level(v=v, alpha=alpha, level=level, rho=rho, ranges=ranges), better


def _near_box(outer: Level, error: ErrorBound | None, disturbance: Fraction) -> _First:
    """A stage |e_i| <= v_i with starts in it: half of what its level leaves is for the errors of
    the estimates."""
    smallest = min(outer.v)
    room = (1 - outer.level) / 2
    if error is None:
        return _First(outer, None, _box(smallest, ZERO))
    kappa = rounded_up(1 / (error.beta * smallest) * NEARLY, digits=9)
    most = min(disturbance, room / (kappa * root_above(error.size, unit=10**9)))
    return _First(outer, replace(error, kappa=kappa), _box(smallest * (1 - room), most))


def _outer(case: Case) -> tuple[Separable | None, tuple[Fraction, Fraction]]:
    """A box that shrinks without the inputs, and its starts: that of the case, else the largest
    one that is found."""
    known = case.proof(Separable)
    claim = case.proved(Separable)
    if known is not None and isinstance(known.domain, Around):
        return claim, (claimed(known.domain.radius), claimed(known.domain.disturbance))
    asked = _everything(case)
    disturbance = claimed(asked.disturbance)
    found = None
    # Where it was examined in vain already, it is not searched for a second time.
    if case.named(MAX_SEPARABLE) is None:
        with at_most(STAGE):
            found = largest_claim(asked)
    if found is None:
        return None, (ZERO, disturbance)
    return found.claim, (claimed(found.radius), disturbance)


def _stages(plant: Plant, outer: Level) -> tuple[Level, ...]:
    """Stages as far as they are found within the work of one stage of ``certify``."""
    stages: list[Level] = []
    with suppress(WorkLimitError), at_most(STAGE):
        for stage in islice(propose_stages(plant, outer), MOST_STAGES):
            stages.append(stage)
    return tuple(stages)


def _proved(case: Case, plant: Plant, claim: Accuracy, starts: Domain) -> Iterator[Check]:
    """The check of a claim with its bounds, if it is proved."""
    if not claim.stages:
        return
    bounds: dict[str, Fraction | Vector] = {}
    for label, ends in zip(case.loop.labels, plant.ends(claim), strict=True):
        raised = _raised(ends)
        bounds[label] = raised[0] if claim.T is None else raised
    yield from _decided(case, replace(claim, bounds=bounds), starts)


def _decided(case: Case, claim: Accuracy, starts: Domain) -> Iterator[Check]:
    """The check of a claim, if it is proved."""
    check = limited(ID, case.domain, lambda: accuracy_check(case, claim, starts))
    if check.is_proved:
        yield check
