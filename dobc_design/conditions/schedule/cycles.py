"""Signals that keep a guarantee, and weights that move with them (theory, section 11): claim and
decision.

A signal passes through phases: phase p lasts between ``shortest`` and ``longest``, its mode is on,
then a phase of its successors follows.  Claim: in phase p, N(t, e) = max_i |e_i| / v^p_i(t), t from
its beginning, does not increase while N <= rho, up to max_i |C eps_i| / v_i; and for every t at
which it may end, v^p(t) <= exp(-rate t) v^q(0) for every successor q.  With kappa (beta - rate) min
v >= 1, V = N + kappa E falls at least by exp(-rate t) over each phase and never rises.  A phase
without a longest time keeps its last weights, and there N falls at the rate.

In coordinates z_i = T e_i (``separable.coordinates``) weights have an entry for each component of
z; gains of fixed ``ranges`` make rows that are convex in v, and hold on a segment where they hold
at its ends.

Without weights the claim has no rate: couplings rise as far out as 2 rho, strictly at 0, every
cycle of phases reaches every agent from a pin, and with v = 1 (kappa beta >= 1) V <= rho holds for
ever; then every error decays.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from itertools import combinations, pairwise
from typing import Any, Final

import numpy as np

from dobc_design._show.cards import Shown
from dobc_design.conditions.numbers import vector_to_json
from dobc_design.conditions.quadratic.sectors import GainRange, ranges_to_json
from dobc_design.conditions.reason import pins_obstacle
from dobc_design.conditions.schedule.rows import Box, MovingRows, moving_rows
from dobc_design.conditions.separable.claim import (
    ErrorBound,
    acts_by_component,
    holding_gains,
    reach,
    require_coordinates,
    spread,
)
from dobc_design.conditions.separable.coordinates import gains_obstacle, seen_through, slowest_row
from dobc_design.conditions.separable.decide import error_bound_obstacle
from dobc_design.coupling.enclosures import Curve, jet, profile
from dobc_design.errors import SpecError
from dobc_design.exact.interval import Interval, UndefinedError, exp
from dobc_design.exact.matrix import Matrix, Vector
from dobc_design.exact.number import float_above, float_below, number_text
from dobc_design.loop.guarantee import Phase
from dobc_design.loop.loop import Loop
from dobc_design.problem.canonical import matrix_text

ZERO, ONE = Fraction(0), Fraction(1)
FARTHEST: Final = 10_000  # exp(-x) beyond is bounded by exp(-FARTHEST)


def shrunk(value: Fraction, rate: Fraction, time: Fraction) -> Interval:
    """Enclose value exp(-rate time) for value, rate, time >= 0."""
    power = rate * time
    if power > FARTHEST:
        return Interval(ZERO, (exp(Interval.point(Fraction(-FARTHEST))) * value).hi)
    return exp(Interval.point(-power)) * value


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Weights(Shown):
    """Weights of one phase at ``times`` (s) from its beginning, linear in between: one entry > 0
    per agent, or per component of z."""

    times: Vector
    v: tuple[Vector, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Cycles:
    """A claim as above: weights phase by phase, ``rate`` (1/s), ``rho`` (None: linear couplings,
    every rho), the observer's ``error`` (None without an exosystem); by the graphs alone without
    phases and rate; in coordinates with ``T`` and ``ranges``.  Raises: SpecError unless weights,
    rate and rho are > 0, times rise from 0, and there are both phases and a rate, or neither."""

    phases: tuple[Weights, ...]
    rate: Fraction | None
    rho: Fraction | None
    error: ErrorBound | None = None
    T: Matrix | None = None
    ranges: tuple[GainRange, ...] = ()

    def __post_init__(self) -> None:
        require_coordinates(self.T)
        if (self.rate is None) is bool(self.phases) or (self.T is not None and not self.phases):
            raise SpecError(
                "a rate belongs to weights, weights to a rate, and T to weights.", key="rate"
            )
        if min(x for x in (self.rate, self.rho, ONE) if x is not None) <= 0:
            raise SpecError("rate and rho must be > 0.", key="rate")
        for each in self.phases:
            rising = all(a < b for a, b in pairwise(each.times))
            if not each.times or each.times[0] or not rising or len(each.times) != len(each.v):
                raise SpecError("times must rise from 0, with weights for each.", key="times")
            if min(x for v in each.v for x in v) <= 0:
                raise SpecError("weights must be > 0.", key="v")

    @property
    def least(self) -> Fraction:
        """The least weight of all phases and times; 1 where there are none."""
        return min((x for each in self.phases for v in each.v for x in v), default=ONE)

    @property
    def tallest(self) -> Vector:
        """The largest weights of all phases and times, entry by entry."""
        return tuple(map(max, zip(*(v for each in self.phases for v in each.v), strict=True)))

    def spread(self, loop: Loop) -> Fraction:
        """The largest N of errors with |e|_inf <= 1, in any phase that may be first."""
        begun = zip(loop.guarantee.phases, self.phases, strict=bool(self.phases))
        return max((spread(self.T, each.v[0]) for phase, each in begun if phase.first), default=ONE)

    @property
    def height(self) -> Fraction:
        """The largest |e|_inf exp(rate t) at a time t of a phase, of errors with N = 1 when it
        begins: N does not rise within a phase, and falls at the rate from one phase to the next; 1
        without weights."""
        rate = self.rate or ZERO
        heights = [ONE]
        for each in self.phases:
            for place, later in enumerate(each.times):
                v = tuple(map(max, each.v[max(0, place - 1)], each.v[place]))
                heights.append(reach(self.T, v) / shrunk(ONE, rate, later).lo)
        return max(heights[1:], default=ONE)

    def factor(self, loop: Loop) -> Fraction:
        """|e(t)|_inf <= factor |e(0)|_inf exp(-rate t) + what the estimation error adds."""
        return self.spread(loop) * self.height

    @property
    def most(self) -> Fraction:
        """The largest weight of all phases and times; 1 where there are none."""
        return max((x for each in self.phases for v in each.v for x in v), default=ONE)

    def to_json(self) -> dict[str, Any]:
        values: dict[str, Any] = {
            "rate": None if self.rate is None else number_text(self.rate),
            "rho": None if self.rho is None else number_text(self.rho),
            "phases": [
                {"times": vector_to_json(each.times), "v": [vector_to_json(v) for v in each.v]}
                for each in self.phases
            ],
        }
        if self.T is not None:
            values |= {"T": matrix_text(self.T), "ranges": ranges_to_json(self.ranges)}
        return values if self.error is None else values | self.error.to_json()


def why_not(loop: Loop, W: Matrix | None, claim: Cycles) -> str | None:
    """None if the claim is proved for the gain W (q, m); else the first thing that is not."""
    return next((words for holds, words in _needs(loop, W, claim) if not holds), None)


def holds_starts(loop: Loop, claim: Cycles, *, radius: Fraction, disturbance: Fraction) -> bool:
    """Whether every start |e|_inf <= radius, |eps_i| <= disturbance has V <= rho, in every phase
    that may be first."""
    if claim.rho is None:
        return True
    room = claim.rho - radius * claim.spread(loop)
    if claim.error is None:
        return room >= 0
    return room >= 0 and (claim.error.kappa * disturbance) ** 2 * claim.error.size <= room**2


def _needs(loop: Loop, W: Matrix | None, claim: Cycles) -> Iterator[tuple[bool, str]]:
    yield not loop.pins.curved, str(pins_obstacle(loop))
    phases = loop.guarantee.phases
    yield bool(phases), "there is no guarantee, or only one mode."
    turned, size = claim.T is not None, loop.n * len(claim.T or (1,))
    yield not turned or len(claim.T or ()) == loop.m, "T needs one row per state component."
    yield (
        turned or acts_by_component(loop),
        "couplings have to act on each state component by itself.",
    )
    yield len(claim.phases) in (0, len(phases)), "there must be weights for every phase."
    yield (
        all(len(v) == size for each in claim.phases for v in each.v),
        "weights must have an entry for each row.",
    )
    yield from holds_observer(loop, W, claim, claim.rate)
    if not claim.phases or claim.rate is None:
        yield from rises(loop, claim.rho)
        missed = next(unreached_cycles(loop, phases), None)
        if missed is not None:
            yield (
                False,
                f"while modes {' and '.join(missed[0])} are on in turn, no pin reaches "
                f"agent {missed[1]}.",
            )
        return
    if claim.T is not None:
        wrong = gains_obstacle(loop, claim.T, claim.tallest, claim.rho, claim.ranges)
        yield wrong is None, str(wrong)
    rows = dict.fromkeys(phase.mode for phase in phases)
    if claim.T is None:  # tables as wide as the widest phase needs, once for each mode
        reach = claim.most * (ONE if claim.rho is None else claim.rho)
        rows = {mode: moving_rows(loop, reach, [mode]) for mode in rows}
    for p, (phase, each) in enumerate(zip(phases, claim.phases, strict=True)):
        where = f"phase {p + 1} (mode {phase.mode})"
        yield phase.shortest in each.times, f"{where}: its shortest time has to be among the times."
        yield (
            phase.longest is None or each.times[-1] == phase.longest,
            f"{where}: times have to end with its longest.",
        )
        for q in phase.successors:
            yield (
                _fits(each, claim.phases[q], phase, claim.rate),
                f"{where}: its weights do not fall far enough.",
            )
        yield (
            not _open(loop, rows[phase.mode], phase, each, claim),
            f"{where}: a row does not hold.",
        )


def holds_observer(
    loop: Loop, W: Matrix | None, claim: Cycles, rate: Fraction | None
) -> Iterator[tuple[bool, str]]:
    """Rho and the observer's part of a claim, at this rate: whether each condition holds, and what
    it is."""
    exosystem = loop.joint_exosystem
    if claim.T is not None:
        exosystem, W = seen_through(loop, claim.T, W)
    yield claim.rho is not None or loop.is_linear, "without rho couplings have to be linear."
    yield (
        (claim.error is not None) == (exosystem is not None),
        "P, beta, kappa and size belong to an [exosystem].",
    )
    if exosystem is not None and claim.error is not None:
        yield W is not None, "with an [exosystem] it needs an observer gain W."
        obstacle = None if W is None else error_bound_obstacle(exosystem, W, claim.error)
        yield obstacle is None, str(obstacle)
        room = (claim.error.beta - (rate or ZERO)) * claim.error.kappa * claim.least
        yield claim.error.kappa > 0 and room >= 1, "kappa (beta - rate) min v must be at least 1."


def rises(loop: Loop, rho: Fraction | None, *, strictly: bool = True) -> Iterator[tuple[bool, str]]:
    """Couplings rise as far out as 2 rho, ``strictly`` at the target; gains hold."""
    try:
        profiles = [profile(Curve(each.components[0]), 2 * (rho or ONE)) for each in loop.functions]
        slopes = (
            [jet(each.curve, Interval.point(ZERO)).slope for each in profiles] if strictly else []
        )
        rising = all(each.is_nondecreasing for each in profiles) and all(
            slope.lo > 0 for slope in slopes
        )
    except UndefinedError:
        rising = False
    strict = ", strictly at the target" if strictly else ""
    yield rising, f"a coupling is not shown to rise as far out as that{strict}."
    yield min(holding_gains(loop)) >= 0, "a gain pushes outward."


def cycles_of(phases: Sequence[Phase]) -> list[tuple[str, ...]]:
    """The smallest sets of modes that may be on over and over, and no other."""
    cycles: set[tuple[str, ...]] = {(phase.mode,) for phase in phases if phase.longest is None}
    # any other mode may follow: longer cycles hold two
    if len(phases) > 1 and all(phase.first for phase in phases):
        cycles |= set(combinations((phase.mode for phase in phases), 2))
    elif phases:
        cycles.add(tuple(dict.fromkeys(phase.mode for phase in phases)))
    return sorted(cycles)


def unreached_cycles(loop: Loop, phases: Sequence[Phase]) -> Iterator[tuple[tuple[str, ...], str]]:
    """Modes of a cycle, or a mode that may stay on for ever, and the label of an agent that they do
    not reach."""
    for cycle in cycles_of(phases):
        if (missed := first_unreached(loop, cycle)) is not None:
            yield cycle, missed


def first_unreached(loop: Loop, modes: Sequence[str]) -> str | None:
    """The label of an agent that no pin which holds reaches in these modes together, by arcs that
    are always there; None if there is none."""
    heard: dict[int, set[int]] = {}
    for arcs in (loop.modes[mode].always for mode in modes):
        for i, j in zip(arcs.listeners.tolist(), arcs.speakers.tolist(), strict=True):
            heard.setdefault(j, set()).add(i)
    waiting = [i for i, gain in enumerate(holding_gains(loop)) if gain > 0]
    reached = set(waiting)
    while waiting:
        new = heard.get(waiting.pop(), set()) - reached
        reached |= new
        waiting += new
    return None if len(reached) == loop.n else loop.labels[min(set(range(loop.n)) - reached)]


def _fits(old: Weights, new: Weights, phase: Phase, rate: Fraction) -> bool:
    """v(t) <= exp(-rate t) v'(0) for every t at which the phase may end."""
    first = old.times.index(phase.shortest)
    places = [(first, first), *((k, k + 1) for k in range(first, len(old.times) - 1))]
    for a, b in places:
        factor = shrunk(ONE, rate, old.times[b]).lo
        if any(
            max(x, y) > factor * z for x, y, z in zip(old.v[a], old.v[b], new.v[0], strict=True)
        ):
            return False
    return True


def _open(loop: Loop, rows: MovingRows | None, phase: Phase, each: Weights, claim: Cycles) -> bool:
    """Whether a row of the phase is not proved."""
    if claim.T is not None:
        return _open_in_coordinates(loop, phase, each, claim, claim.T)
    if rows is None:
        return True
    boxes, none = Box.of(each.v, each.v), np.zeros(len(each.times))
    low, high = (1.0, 1.0) if claim.rho is None else (0.0, float_above(claim.rho))
    if rows.open_segments(boxes, each.times, none, low=low, high=high):
        return True
    if phase.longest is not None:
        return False
    last = Box.of([each.v[-1]] * 2, [each.v[-1]] * 2)
    falls = np.array([[[float_below(-(claim.rate or ZERO) * x) for x in each.v[-1]]] * 2])
    return bool(rows.open_for(last, falls, np.zeros(2), low=low, high=high))


def _open_in_coordinates(loop: Loop, phase: Phase, each: Weights, claim: Cycles, T: Matrix) -> bool:
    """The same for rows in coordinates, at both ends of every segment."""
    rests = (
        []
        if phase.longest is not None
        else [(each.v[-1], tuple(-(claim.rate or ZERO) * x for x in each.v[-1]))]
    )
    for (a, b), (v, w) in zip(pairwise(each.times), pairwise(each.v), strict=True):
        slopes = tuple((y - x) / (b - a) for x, y in zip(v, w, strict=True))
        rests += [(v, slopes), (w, slopes)]
    rows = partial(slowest_row, loop, T, ranges=claim.ranges, modes=[phase.mode])
    return any(rows(v, load=tuple(-x for x in slopes)).rate < 0 for v, slopes in rests)
