"""Proposals for the max-separable certificate: v for one radius, common to all modes (theory, section 5).

The rows bound each v_i from below by the others: whoever is listened to may only raise a row.  So for a given alpha the
solutions with v >= 1 have a least one, and Newton's method finds it (one sparse solve per step, for any size).  The
largest alpha follows by bisection.  This needs no monotone coupling.  Nothing here is a proof.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from dobc_design.conditions.consensus.estimates import decay_rate
from dobc_design.conditions.separable.claim import ErrorBound
from dobc_design.conditions.separable.field import Field, field_of
from dobc_design.conditions.separable.newton import FEW_AGENTS, LOOSE, TIGHT, least_solution, linear_rate
from dobc_design.conditions.separable.ordering import find_ordering
from dobc_design.conditions.separable.propose_observer import propose_error_bound, radius_needed
from dobc_design.exact.matrix import Matrix, Vector
from dobc_design.exact.symmetric import Doubles
from dobc_design.problem.problem import Problem
from dobc_design.solvers.program import Array

logger = logging.getLogger("dobc_design")
DIGITS = (3, 4, 5, 6, 8, 11)
BITS = (12, 20, 30)  # of large networks, whose arithmetic is binary
LARGE = 400
LARGEST_RADIUS = 1e150
BISECTIONS = 40
# (agents, relative accuracy of alpha that is still worth the time); for more agents.
CLOSE = ((300, 1e-5), (2000, 1e-3))
CLOSE_LARGE = 0.05
# kappa is chosen for the rate that v has, or where the observer is slower for one that suits both.
ROUNDS = 6
ABOVE = 1.005  # how much faster than N the observer's part is to be
SHARE = 0.05  # of the observer's decay rate: the first guess for many agents
ENOUGH = 0.5  # of that rate, where N loses some because kappa needs room
COARSE, CLOSE_ENOUGH = 8, 0.01  # points of s, and accuracy of a rate, where many v are looked for
SLOWEST = 1e-6  # rates below this part of the largest gain are not looked for
# Weights above which v is steep, and the parts of the rate that are tried in its place.
STEEP, FLATTER = 100.0, (0.9, 0.7, 0.4)
ROUNDING = 1e-15  # of h, absolutely


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SeparableProposal:
    """v (n,), min v = 1, and the rate (1/s) that floating point sees for s in (0, rho]."""

    v: Array
    rate: float
    rho: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SeparablePlan:
    """A proposal with the radius rho it is for and the observer's part (None without an exosystem)."""

    proposal: SeparableProposal
    rho: Fraction
    error: ErrorBound | None


def propose_separable(
    problem: Problem, *, rho: float, modes: Sequence[str] | None = None, near: float | None = None
) -> SeparableProposal | None:
    """Find v with min v = 1 and the largest rate, about, for all s in (0, rho]; None if no positive rate is found.

    The box |e|_inf <= rho is then inside {N <= rho}.  ``near``: a rate (1/s) that is expected, with which the search
    for many agents begins.
    """
    if not find_ordering(problem, modes=modes).exists or not 0 < rho <= LARGEST_RADIUS:
        return None
    with np.errstate(all="ignore"):  # far out couplings overflow or end; what is not finite is no proposal
        return _propose(problem, rho, modes, near)


def _propose(problem: Problem, rho: float, modes: Sequence[str] | None, near: float | None) -> SeparableProposal | None:
    try:
        field = field_of(problem, rho=rho, modes=modes)
    except ArithmeticError as error:
        logger.info("no proposal for rho = %g: %s", rho, error)
        return None
    best = least_solution(field, alpha=0.0, start=np.ones(problem.n))
    high = float(np.max(field.gains, initial=0.0))
    if best is None or high <= 0:
        return None
    if problem.n > FEW_AGENTS:
        return _propose_large(field, rho=rho, start=best, near=near)
    whole = least_solution(field, alpha=high, start=best)
    if whole is not None:
        return SeparableProposal(v=whole, rate=high, rho=rho)
    low, close = 0.0, next(part for size, part in CLOSE if problem.n <= size)
    # The rate may be many powers of ten below the gains: halve first, then divide evenly.
    for _ in range(BISECTIONS):
        middle = (low + high) / 2 if low else high / 8
        found = least_solution(field, alpha=middle, start=best)
        if found is None:
            high = middle
        else:
            low, best = middle, found
        if (low and high - low <= close * low) or high <= SLOWEST * float(np.max(field.gains)):
            break
    return SeparableProposal(v=best, rate=low, rho=rho) if low else None


def _propose_large(field: Field, *, rho: float, start: Array, near: float | None) -> SeparableProposal | None:
    """The same with few trials, beginning at ``near``, or at half the rate that linear couplings would have."""
    low, high, best = 0.0, float(np.max(field.gains)), start
    slowest = SLOWEST * high
    middle = min(linear_rate(field) / 2 if near is None else near * (1 - CLOSE_LARGE), high)
    while high > slowest and not (low and high - low <= CLOSE_LARGE * low):
        found = least_solution(field, alpha=middle, start=best)
        low, high, best = (low, middle, best) if found is None else (middle, high, found)
        further = low * (1.5 if near is None else 1 + 2 * CLOSE_LARGE)
        middle = min((low + high) / 2, further) if low else high / 4
    return SeparableProposal(v=best, rate=low, rho=rho) if low else None


def propose_vectors(problem: Problem, *, rho: float, parts: Sequence[float]) -> Iterator[Array]:
    """Find the least v with min v = 1 for parts (<= 1) of about the largest rate: smaller parts are flatter.

    Quicker and coarser than ``propose_separable``; nothing if no positive rate is found.
    """
    field = field_of(problem, rho=rho)
    field = replace(field, grid=field.grid[:: max(1, len(field.grid) // COARSE)])
    best = least_solution(field, alpha=0.0, start=np.ones(problem.n))
    low, high = 0.0, float(np.max(field.gains, initial=0.0))
    if best is None or high <= 0:
        return
    while high > SLOWEST * float(np.max(field.gains)) and not (low and high - low <= CLOSE_ENOUGH * low):
        middle = (low + high) / 2 if low else high / 8
        found = least_solution(field, alpha=middle, start=best)
        low, high, best = (low, middle, best) if found is None else (middle, high, found)
    for part in parts if low else ():
        v = best if part == 1.0 else least_solution(field, alpha=part * low, start=np.ones(problem.n))
        if v is not None:
            yield v


def design_separable(
    problem: Problem,
    *,
    radius: Fraction,
    disturbance: Fraction = Fraction(0),
    W: Matrix | None = None,
    modes: Sequence[str] | None = None,
) -> SeparablePlan | None:
    """Plan a certificate for every start with |e|_inf <= radius and |eps_i| <= disturbance; None if none is found.

    With an exosystem the observer's part is chosen for the gain W (q, m), so that V = N + kappa E is
    about as fast as N.
    """
    exosystem = problem.joint_exosystem
    if exosystem is None:
        proposal = propose_separable(problem, rho=float(radius), modes=modes)
        return None if proposal is None else SeparablePlan(proposal=proposal, rho=radius, error=None)
    if W is None:
        return None
    # One v for many agents takes long, so that the first one is for a kappa that is seldom too small.
    first = 0.0 if problem.n <= FEW_AGENTS else SHARE * decay_rate(exosystem, W)
    best = _planned(problem, W, first, radius, disturbance, modes)
    if best is None or best.proposal.rate <= first:
        return best
    gained, low, high = first, 0.0, 2 * best.proposal.rate * ABOVE
    for _ in range(ROUNDS if problem.n <= FEW_AGENTS else 1):
        rate = (low + high) / 2
        plan = _planned(problem, W, rate, radius, disturbance, modes, near=best.proposal.rate)
        reached = 0.0 if plan is None else min(rate, plan.proposal.rate)
        if plan is not None and reached > gained:
            best, gained = plan, reached
        if reached > rate * ENOUGH and not low:
            break
        low, high = (rate, high) if reached == rate else (low, rate)
    return best


def _planned(
    problem: Problem,
    W: Matrix,
    rate: float,
    radius: Fraction,
    disturbance: Fraction,
    modes: Sequence[str] | None,
    near: float | None = None,
) -> SeparablePlan | None:
    """A plan whose observer part decays with ``rate``; None if the observer is slower, or leaves no room for a v."""
    exosystem = problem.joint_exosystem
    error = None if exosystem is None else propose_error_bound(exosystem, W, rate=rate)
    if error is None:
        return None
    rho = radius_needed(radius, error, disturbance)
    proposal = propose_separable(problem, rho=float(rho), modes=modes, near=near)
    return None if proposal is None else SeparablePlan(proposal=proposal, rho=rho, error=error)


def flat_separable(
    problem: Problem, *, radius: Fraction, disturbance: Fraction, W: Matrix | None, rate: float
) -> SeparablePlan | None:
    """Plan a certificate like ``design_separable``, whose v is the flattest for about ``rate`` (1/s): the least v >= 1.

    None if there is no v for this rate, or the observer with the gain W (q, m) is slower.
    """
    exosystem, error = problem.joint_exosystem, None
    if exosystem is not None:
        error = None if W is None else propose_error_bound(exosystem, W, rate=rate)
        if error is None:
            return None
    rho = radius_needed(radius, error, disturbance)
    with np.errstate(all="ignore"):  # as in propose_separable
        v = least_solution(field_of(problem, rho=float(rho)), alpha=rate, start=np.ones(problem.n))
    if v is None:
        return None
    return SeparablePlan(proposal=SeparableProposal(v=v, rate=rate, rho=float(rho)), rho=rho, error=error)


def flatter_plans(problem: Problem, plan: SeparablePlan) -> Iterator[SeparablePlan]:
    """The same plan with flatter v and smaller rates, for a v too steep to be proved; nothing for one that is flat.

    The largest rate may ask for weights of which nothing is left of an enclosure: chains of agents have such.
    """
    v = plan.proposal.v
    if float(v.max()) <= STEEP or len(v) > FEW_AGENTS:
        return
    found = propose_vectors(problem, rho=float(plan.rho), parts=FLATTER)
    for part, each in zip(FLATTER, found, strict=False):
        yield replace(plan, proposal=replace(plan.proposal, v=each, rate=part * plan.proposal.rate))


def rounded_vectors(proposal: SeparableProposal) -> Iterator[Vector | Doubles]:
    """v as rationals, few digits first; binary fractions for large networks, which floats hold exactly."""
    if len(proposal.v) > LARGE:
        for bits in BITS:
            yield Doubles(np.ldexp(np.rint(np.ldexp(proposal.v, bits)), -bits))
        return
    for digits in DIGITS:
        unit = 10**digits
        yield tuple(Fraction(round(float(x) * unit), unit) for x in proposal.v)


def least_above(field: Field, *, alpha: float, lower: Array, start: Array | None = None) -> Array | None:
    """The least v >= ``lower`` (n,) whose rows hold with rate alpha, about; None if none is found.

    ``start`` (n,), where it is given, lies between the two.  Newton's method ends where h(s y)/s loses its digits: at
    the smallest s of the grid.
    """
    close, drop = TIGHT if field.size <= FEW_AGENTS else LOOSE
    noise = ROUNDING / float(field.grid[0])
    accuracy = (max(close, noise), max(drop, 100 * noise))
    with np.errstate(all="ignore"):
        return least_solution(
            field, alpha=alpha, start=lower if start is None else start, lower=lower, accuracy=accuracy
        )
