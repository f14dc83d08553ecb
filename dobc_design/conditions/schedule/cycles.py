"""Whether weights that keep to a guarantee (``claim.Cycles``) are proved; and which agents the
modes of a cycle leave without a pin.

Rows are decided in floats with outward bounds, or in coordinates exactly; exponentials are
enclosed, all else is rational.
"""

from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from itertools import combinations, pairwise

import numpy as np

from dobc_design.conditions.consensus.network import name_agents
from dobc_design.conditions.reason import APART, Need, first_missing, gap_obstacle
from dobc_design.conditions.separable.claim import (
    acts_by_component,
    holding_gains,
    stated_errors,
)
from dobc_design.conditions.separable.coordinates import gains_obstacle, seen_through, slowest_row
from dobc_design.conditions.separable.decide import error_bound_obstacle
from dobc_design.conditions.separable.large import up
from dobc_design.conditions.separable.timing import readings_obstacle
from dobc_design.coupling.enclosures import Curve, jet, profile
from dobc_design.exact.interval import Interval, UndefinedError, exp
from dobc_design.exact.matrix import Matrix, Vector
from dobc_design.exact.number import ONE, ZERO, float_above, float_below
from dobc_design.exact.reading import Texts
from dobc_design.loop.arcs import unreached
from dobc_design.loop.guarantee import Phase
from dobc_design.loop.loop import Loop, Pins
from dobc_design.loop.timing import Timing

from .claim import Cycles, Weights, shrunk
from .rows import Box, Motion, MovingRows, heard_boxes, heard_from, rows_of_phases


def why_not(loop: Loop, W: Matrix | None, claim: Cycles) -> str | None:
    """None if the claim is proved for the gain W (q, m); else the first thing that is not."""
    return first_missing(_needs(loop, W, claim))


def holds_starts(loop: Loop, claim: Cycles, *, radius: Fraction, disturbance: Fraction) -> bool:
    """Whether every start |e|_inf <= radius, |eps_i| <= disturbance has V <= rho, in every phase
    that may be first."""
    if claim.rho is None:
        return True
    room = claim.rho - radius * claim.spread(loop)
    return room >= 0 if claim.error is None else claim.error.fits(disturbance, room)


def _needs(loop: Loop, W: Matrix | None, claim: Cycles) -> Iterator[Need]:
    """What has to hold, in turn: what is cheap first, and what later needs rely on."""
    yield bool(_cycles(loop)), "there is no guarantee of what modes follow."
    if loop.goal == "roots":
        yield not claim.phases, "weights of so many pairs are not looked at."
    if claim.late:
        yield from _known_late(loop, W, claim)
    yield from _fits_the_loop(loop, claim)
    yield from holds_observer(loop, W, claim, claim.rate)
    if claim.phases and claim.rate is not None:
        yield from _weights_fall(loop, claim, claim.rate)
        return
    yield from rises(loop, claim.rho)
    missed = unreached_in_words(loop)
    yield missed is None, str(missed)


def late_obstacle(loop: Loop, W: Matrix | None) -> str | None:
    """Why nothing is said with the readings that the problem states; None where something is, or
    where it states none."""
    timing = loop.timing
    if timing is None:
        return None
    times = timing.period or timing.own_delay or timing.ahead
    if times or any(stated_errors(loop)) or loop.saturates or loop.sensed:
        told = "own_delay, a period, and errors of weights or gains are not known where boxes or "
        return f"{APART}{told}weights move; nor are inputs that act late or saturate, and outputs."
    return readings_obstacle(loop, W)


def _known_late(loop: Loop, W: Matrix | None, claim: Cycles) -> Iterator[Need]:
    """What is known of late readings while weights move."""
    yield loop.timing is not None, "the problem states no readings."
    obstacle = late_obstacle(loop, W)
    yield obstacle is None, str(obstacle)
    yield claim.T is None, "late readings are not known in coordinates."
    timing = loop.timing or Timing()
    yield bool(claim.phases) or not timing.event, "weights of 1 leave no room for an event."
    for phase, _ in zip(loop.guarantee.phases, claim.phases, strict=False):
        yield phase.shortest >= timing.delay, "a phase may be shorter than readings are old."


def _fits_the_loop(loop: Loop, claim: Cycles) -> Iterator[Need]:
    """Weights for every phase and every row."""
    if claim.T is not None:
        yield len(claim.T) == loop.m, "T needs one row per state component."
    else:
        yield acts_by_component(loop), "couplings have to act on each state component by itself."
    count = len(claim.phases)
    yield count in (0, len(loop.guarantee.phases)), "there must be weights for every phase."
    size = loop.n if claim.T is None else loop.size
    whole = all(len(v) == size for each in claim.phases for v in each.v)
    yield whole, "weights must have an entry for each row."


def _weights_fall(loop: Loop, claim: Cycles, rate: Fraction) -> Iterator[Need]:
    """In every phase the rows hold, and its weights shrink until each time at which it may end."""
    phases = loop.guarantee.phases
    if claim.T is not None:
        obstacle = gap_obstacle(loop)
        yield obstacle is None, str(obstacle)
        wrong = gains_obstacle(loop, claim.T, claim.tallest, claim.rho, claim.ranges)
        yield wrong is None, str(wrong)
    # Rows of the errors themselves, in tables as wide as the widest phase needs.
    rows: Mapping[str, MovingRows | None] = {}
    timing = loop.timing if claim.late else None
    if claim.T is None:
        most = claim.most * (claim.rho or ONE)
        old = [each.v[0] for each in claim.phases]
        if timing is not None:
            old = weights_before(phases, claim, timing)
            most = max(most, *map(max, old)) * timing.stretch(rate) ** 2
        # Only a coupling that rises is largest where rows look, from any place without error.
        if loop.gap:
            yield from rises(loop, most, strictly=False)
        rows = rows_of_phases(loop, most)
    for p, (phase, each) in enumerate(zip(phases, claim.phases, strict=True)):
        where = f"phase {p + 1} (mode {phase.mode})"
        yield phase.shortest in each.times, f"{where}: its shortest time has to be among the times."
        ends_well = phase.longest is None or each.times[-1] == phase.longest
        yield ends_well, f"{where}: times have to end with its longest."
        for q in phase.successors:
            # Whatever phase may follow has to begin with weights that are large enough.
            falls = _fits(each, claim.phases[q], phase, rate)
            yield falls, f"{where}: its weights do not fall far enough."
        if claim.T is None:
            heard = None
            if timing is not None:
                heard = heard_in_phase(each, old[p], timing, rate)
            is_open = _open(rows[phase.mode], phase, each, claim, heard)
        else:
            is_open = _open_in_coordinates(loop, phase, each, claim, claim.T)
        yield not is_open, f"{where}: a row does not hold."


def holds_observer(
    loop: Loop, W: Matrix | None, claim: Cycles, rate: Fraction | None
) -> Iterator[Need]:
    """Rho and the observer's part of a claim, at this rate: whether each condition holds, and what
    it is."""
    exosystem, W = seen_through(loop, claim.T, W)
    yield claim.rho is not None or loop.is_linear, "without rho couplings have to be linear."
    belongs = (claim.error is not None) == (exosystem is not None)
    yield belongs, "P, beta, kappa and size belong to an [exosystem]."
    if exosystem is None or claim.error is None:
        return
    yield W is not None, "with an [exosystem] it needs an observer gain W."
    obstacle = None if W is None else error_bound_obstacle(exosystem, W, claim.error)
    yield obstacle is None, str(obstacle)
    # What E loses at the rate beta has to outweigh what |C eps_i| / v_i adds to N.
    room = (claim.error.beta - (rate or ZERO)) * claim.error.kappa * claim.least
    yield claim.error.kappa > 0 and room >= 1, "kappa (beta - rate) min v must be at least 1."


def rises(loop: Loop, rho: Fraction | None, *, strictly: bool = True) -> Iterator[Need]:
    """Couplings rise as far out as 2 rho, and further between fixed nodes, ``strictly`` at the
    target; gains hold."""
    farthest = loop.gap + 2 * (rho or ONE)
    at_target = Interval.point(ZERO)
    rising = True
    try:
        for each in loop.functions:
            shape = profile(Curve(each.components[0]), farthest)
            steep = not strictly or jet(shape.curve, at_target).slope.lo > 0
            rising = rising and steep and shape.is_nondecreasing
    except UndefinedError:
        rising = False
    strict = ", strictly at 0" if strictly else ""
    yield rising, f"a coupling is not shown to rise on |y| <= {float(farthest):.6g}{strict}."
    yield min(holding_gains(loop)) >= 0, "a gain pushes outward."


def cycles_of(phases: Sequence[Phase]) -> list[Texts]:
    """The smallest sets of modes that may be on over and over, and no other."""
    # A mode without a longest time may stay on for ever.
    cycles: set[Texts] = {(phase.mode,) for phase in phases if phase.longest is None}
    # any other mode may follow: longer cycles hold two
    if len(phases) > 1 and all(phase.first for phase in phases):
        cycles |= set(combinations((phase.mode for phase in phases), 2))
    elif phases:
        cycles.add(tuple(dict.fromkeys(phase.mode for phase in phases)))
    return sorted(cycles)


def _cycles(loop: Loop) -> Sequence[Texts]:
    """The same of a loop; one mode alone stays on for ever."""
    if loop.guarantee.phases:
        return cycles_of(loop.guarantee.phases)
    return [tuple(loop.modes)] if len(loop.modes) == 1 else []


def unreached_cycles(loop: Loop) -> Iterator[tuple[Texts, Texts]]:
    """Modes of a cycle, or a mode that may stay on for ever, and the labels of the agents that they
    do not reach."""
    for cycle in _cycles(loop):
        missed = left_out(loop, cycle)
        if missed:
            yield cycle, missed


def unreached_in_words(loop: Loop) -> str | None:
    """The agents that no pin reaches while the modes of a cycle are on, in a sentence; None if
    there are none."""
    for cycle, agents in unreached_cycles(loop):
        on = f"modes {' and '.join(cycle)} are on in turn"
        ends = ""
        if len(cycle) == 1:
            on = f"mode {cycle[0]} is on"
            if len(loop.modes) > 1:
                ends = " A longest time for it (longest in [switching]) would end that."
        missed = f"no pin reaches {name_agents(agents)}"
        if loop.signed:
            missed = (
                f"{name_agents(agents)} hear nobody outside, with signs that balance and no pin"
            )
        if loop.goal == "roots":
            missed = f"no agent is heard by all others: {name_agents(agents)} are in several groups"
        return f"while {on}, {missed}.{ends}"
    return None


def left_out(loop: Loop, modes: Sequence[str]) -> Texts:
    """The labels of the agents that no pin which holds reaches in these modes together, by arcs
    that are always there."""
    holding = holding_gains(loop)
    gains = {i: gain for i, gain in loop.pulls.gains.items() if holding[i] > 0}
    arcs = [(loop.signs or loop.modes)[mode] for mode in modes]
    left = unreached(loop, arcs, pins=Pins(gains=gains))
    return tuple(loop.named(left))


def _fits(old: Weights, new: Weights, phase: Phase, rate: Fraction) -> bool:
    """v(t) <= exp(-rate t) v'(0) for every t at which the phase may end."""
    first = old.times.index(phase.shortest)
    # It may end at its shortest time, or on a segment after it: there weights are at most the
    # larger of both ends, and exp(-rate t) is least at the later one.
    segments = pairwise(range(first, len(old.times)))
    for before, after in ((first, first), *segments):
        factor = shrunk(ONE, rate, old.times[after]).lo
        for x, y, begun in zip(old.v[before], old.v[after], new.v[0], strict=True):
            if max(x, y) > factor * begun:
                return False
    return True


def heard_in_phase(each: Weights, old: Vector, timing: Timing, rate: Fraction) -> Box:
    """The same of weights, before which there were ``old`` ones; while they rest N falls."""
    v = (old, *each.v)
    heard = heard_boxes(Box.of(v, v), (-timing.delay, *each.times), timing)[1:]
    heard.above[-1] = up(heard.above[-1] * float_above(timing.stretch(rate)))
    return heard


def weights_before(phases: Sequence[Phase], claim: Cycles, timing: Timing) -> list[Vector]:
    """For each phase the largest weights that readings may be from when it begins, as parts of N
    there."""
    found = [each.v[0] for each in claim.phases]
    for phase, each in zip(phases, claim.phases, strict=True):
        first = heard_from(each.times, phase.shortest, timing)
        for k in range(first, len(each.times) - 1):
            # From this segment until the phase ends N falls by exp(-rate end) at most.
            end = each.times[k + 1] + timing.delay
            if phase.longest is not None:
                end = min(end, phase.longest)
            grown = exp(Interval.point((claim.rate or ZERO) * end)).hi
            for q in phase.successors:
                old = zip(found[q], each.v[k], each.v[k + 1], strict=True)
                found[q] = tuple(max(x, y * grown, z * grown) for x, y, z in old)
    return found


def _open(
    rows: MovingRows | None,
    phase: Phase,
    each: Weights,
    claim: Cycles,
    heard: Box | None,
) -> bool:
    """Whether a row of the phase is not proved."""
    if rows is None:
        return True
    # N bounds |e_i| on both sides, and what the estimation error adds is in V already.
    boxes = Box.of(each.v, each.v)
    no_load = np.zeros(len(each.times))
    low = high = 1.0
    if claim.rho is not None:
        low = 0.0
        high = float_above(claim.rho)
    if rows.open_segments(boxes, each.times, no_load, low=low, high=high, heard=heard):
        return True
    if phase.longest is not None:
        return False
    # Without an end the last weights stay, and rows have to hold as if they fell at the rate.
    resting = [each.v[-1]] * 2
    falls = [float_below(x) for x in _slopes_at_rest(each, claim)]
    rest = Motion(
        boxes=Box.of(resting, resting),
        slopes=np.array([[falls] * 2]),
        load=np.zeros(2),
        low=low,
        high=high,
        heard=None if heard is None else heard[-1:],
    )
    return bool(rows.open_for(rest))


def _slopes_at_rest(each: Weights, claim: Cycles) -> Vector:
    """How fast the last weights would have to fall to lose the rate of the claim."""
    rate = claim.rate or ZERO
    return tuple(-rate * x for x in each.v[-1])


def _open_in_coordinates(loop: Loop, phase: Phase, each: Weights, claim: Cycles, T: Matrix) -> bool:
    """The same for rows in coordinates, at both ends of every segment: they are convex in v."""
    asked = list[tuple[Vector, Vector]]()
    if phase.longest is None:
        asked.append((each.v[-1], _slopes_at_rest(each, claim)))
    segments = zip(pairwise(each.times), pairwise(each.v), strict=True)
    for (begun, ended), (v, w) in segments:
        length = ended - begun
        slopes = tuple((y - x) / length for x, y in zip(v, w, strict=True))
        asked += [(v, slopes), (w, slopes)]
    for v, slopes in asked:
        load = tuple(-x for x in slopes)
        worst = slowest_row(loop, T, v, load=load, ranges=claim.ranges, modes=[phase.mode])
        if worst.rate < 0:
            return True
    return False
