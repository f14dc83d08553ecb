"""Decides arc-wise dissipation, ``claim``: agents exactly, arcs by ``directions``.

"Refuted" is never the outcome: only this way to share V' out has failed.
"""

from collections.abc import Iterator, Sequence
from fractions import Fraction

import numpy as np

from dobc_design.conditions.case import Case
from dobc_design.conditions.check import Check, not_a_proof, read_domain
from dobc_design.conditions.domain import Ball, Box, Domain
from dobc_design.conditions.numbers import follows
from dobc_design.conditions.quadratic.decide import border_of, room_of
from dobc_design.conditions.quadratic.sectors import gains_at
from dobc_design.conditions.reason import gap_obstacle, observer_obstacle, shares_obstacle
from dobc_design.conditions.separable.claim import EXACT, Errors, stated_errors
from dobc_design.conditions.separable.large import down, floats_around, gain_table, up
from dobc_design.conditions.stated import is_felt_by_arcs_alone
from dobc_design.exact.definite import decide_positive_definite, decide_positive_semidefinite
from dobc_design.exact.interval import UndefinedError
from dobc_design.exact.matrix import Matrix, add, identity, row_norm, scale, subtract, transpose
from dobc_design.exact.number import ZERO, root_above
from dobc_design.exact.symmetric import SparseSymmetric, largest
from dobc_design.loop.arcs import coupling_places, split_by
from dobc_design.loop.loop import Loop
from dobc_design.problem.groups import agent_blocks
from dobc_design.problem.network import BoolArray

from .claim import ArcWise, claim_from_json, shared_arcs
from .directions import TERMS, Terms, open_arcs

CELLS = 1024  # of a table of gains
ROOTS = 10**9  # roots are rounded up by less than 1/ROOTS of themselves, or of 1


def obstacle(loop: Loop, W: Matrix | None) -> str | None:
    """Why no arc-wise certificate applies to the loop with the gain W (q, m); None if one does."""
    return shares_obstacle(loop) or observer_obstacle(loop, W) or gap_obstacle(loop)


def errors_of_arcs(loop: Loop) -> Errors:
    """What [uncertainty] states of weights and gains; none where estimates feel it, too."""
    return stated_errors(loop) if is_felt_by_arcs_alone(loop) else EXACT


def why_not(loop: Loop, claim: ArcWise) -> str | None:
    """None if the claim is proved for every switching, else what is not shown.  Raises:
    WorkLimitError."""
    S = border_of(loop, claim, claim.rate)
    if claim.P is not None:
        own = decide_positive_definite(SparseSymmetric.from_dense(claim.P))
        if S is None or not own.is_proved:
            return "P > 0 and Omega0 + 2 rate P < 0 do not hold for this pair (P, Q)."
    try:
        for mode in loop.modes:
            for node in short_agents(loop, claim, mode, S):
                return f"in mode {mode} arcs take more of {loop.labels[node]} than it has."
        for mode, arc in open_terms(loop, claim):
            arcs = loop.modes[mode]
            hears = loop.labels[int(arcs.listeners[arc])], loop.labels[int(arcs.speakers[arc])]
            return f"in mode {mode} the arc by which {hears[0]} hears {hears[1]} takes more."
    except UndefinedError as error:
        return f"the gains cannot be enclosed: {error}"
    return None


def taken_of(loop: Loop, claim: ArcWise, mode: str) -> list[Fraction]:
    """What arcs, what agents do by themselves, errors of gains and the rate take of every agent;
    pins that are arcs give.  Raises: UndefinedError."""
    known: dict[tuple[int, Fraction], tuple[Fraction, Fraction]] = {}

    def ends(place: int, d: Fraction) -> tuple[Fraction, Fraction]:
        """The ends of the gains of one variable, as far as the error of an agent may be."""
        if (place, d) not in known:
            reach = close_root(claim.level / d)
            gain = gains_at(loop, place, reach)[0][0]
            known[place, d] = gain.lo, gain.hi
        return known[place, d]

    taken = [2 * claim.rate * d for d in claim.d]
    errors = errors_of_arcs(loop)
    for i, K in loop.pulls.gains.items():
        taken[i] += claim.d[i] * errors.gains * (row_norm(K) + row_norm(transpose(K)))
    arcs = loop.modes[mode]
    free = shared_arcs(loop, arcs)
    shares = zip(free.tolist(), claim.a[mode], claim.b[mode], strict=True)
    listeners, speakers = arcs.listeners.tolist(), arcs.speakers.tolist()
    for arc, a, b in shares:
        taken[listeners[arc]] += a
        taken[speakers[arc]] += b
    for arc in np.flatnonzero(arcs.speakers >= loop.n).tolist():
        i = listeners[arc]
        least, _ = ends(loop.place_of(i, speakers[arc]), claim.d[i])
        # An arc that comes and goes pulls at least by nothing, or pushes as hard as it may.
        gain = min(least, ZERO) if arc >= len(arcs) - arcs.optional else least
        # It may be a pin.
        worst = gain - max(errors) * abs(gain)
        taken[i] -= 2 * claim.d[i] * arcs.weights[arc] * worst
    if loop.drift_place is not None:
        for i, d in enumerate(claim.d):
            # The slopes at the target count as pulls.
            taken[i] += 2 * d * (ends(loop.drift_place, d)[1] - loop.slopes[0][0])
    return taken


def left_of(loop: Loop, claim: ArcWise, mode: str, S: Matrix | None) -> Iterator[Matrix]:
    """What is left of every agent's own pull when all that is taken, and its observer, are paid
    for: (m, m).  Raises: UndefinedError."""
    blocks: Sequence[Matrix] = ()
    if S is not None:
        blocks = agent_blocks(S, loop.groups, loop.labels)
    one = identity(loop.m)
    for i, (d, taken) in enumerate(zip(claim.d, taken_of(loop, claim, mode), strict=True)):
        left = scale(-taken, one)
        pull = loop.pulls.gains.get(i)
        if pull is not None:
            left = add(left, scale(d, add(pull, transpose(pull))))
        if blocks:
            left = subtract(left, scale(d * d, blocks[i]))
        yield left


def short_agents(loop: Loop, claim: ArcWise, mode: str, S: Matrix | None) -> Iterator[int]:
    """The agents of which more is taken than they have."""
    for i, left in enumerate(left_of(loop, claim, mode, S)):
        holds = left[0][0] >= 0 if loop.m == 1 else decide_positive_semidefinite(left).is_proved
        if not holds:
            yield i


def open_terms(loop: Loop, claim: ArcWise) -> Iterator[tuple[str, int]]:
    """Arcs, by mode and place, that are not shown to take at most their numbers.  Raises:
    UndefinedError or WorkLimitError."""
    low, high = floats_around(claim.d)
    error = errors_of_arcs(loop).weights
    least, most = floats_around((2 * (1 - error), 2 * (1 + error)))
    for mode, arcs in loop.modes.items():
        free = shared_arcs(loop, arcs)
        below, above = floats_around(arcs.weights)
        i = arcs.listeners[free]
        terms = Terms(
            a=floats_around(claim.a[mode])[0],
            b=floats_around(claim.b[mode])[0],
            pull=down(down(least[0] * low[i]) * below[free]),
            strongest=up(up(most[1] * high[i]) * above[free]),
            own=low[i],
            other=low[arcs.speakers[free]],
        )
        # Without the arc nothing is left but its numbers.
        open_ones = arcs.uncertain[free] & ((terms.a < 0) | (terms.b < 0))
        for place, mine in split_by(coupling_places(loop, arcs)[free]):
            open_ones[mine] |= _open(loop, place, terms.some(mine), claim.level)
        for k in np.flatnonzero(open_ones).tolist():
            yield mode, int(free[k])


def _open(loop: Loop, place: int, terms: Terms, level: Fraction) -> BoolArray:
    """Which arcs with one coupling are open."""
    # Each different one once.
    rows = np.stack([getattr(terms, name) for name in TERMS], axis=1)
    _, first, inverse = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    # |y - x| on the disc is at most rho times the root of this.
    with np.errstate(divide="ignore"):
        far = float(np.max(up(up(1 / terms.own) + up(1 / terms.other))))
    if not np.isfinite(far):
        return np.ones(len(terms.a), dtype=bool)
    rho = close_root(level)
    component = loop.functions[place].components[0]
    table = gain_table(component, close_root(level * Fraction(far)), cells=CELLS)
    return open_arcs(terms.some(first), table, rho)[inverse.ravel()]


def holds_starts(loop: Loop, claim: ArcWise, domain: Domain) -> bool:
    """Whether all starts of a box or ball lie in {V <= level}.  Raises: ValueError or TypeError."""
    kind = Box if isinstance(domain, Box) else Ball
    radius, disturbance = read_domain(domain, loop, kind=kind)
    room = room_of(loop, claim, disturbance)
    # In a box V is largest at the corners.
    weight = loop.m * sum(claim.d) if kind is Box else largest(claim.d)
    return room is not None and radius**2 * weight <= room


def close_root(square: Fraction) -> Fraction:
    """At least the root of a number > 0, and close: errors may be tiny in the unit of states."""
    return root_above(square, unit=ROOTS * (1 + int(1 / square)))


def confirm(check: Check, case: Case) -> str | None:
    """None if everything that a proved check of this topic claims is confirmed, else what is
    not."""
    loop = case.loop
    reason = obstacle(loop, case.W) or not_a_proof(check)
    if reason is not None:
        return reason
    claim = read_claim(check, loop, case.W)
    if not holds_starts(loop, claim, check.domain):
        return "the starts are not inside the invariant set"
    if not follows(check.rate, claim.rate):
        return f"the rate {check.rate} does not follow"
    return why_not(loop, claim)


def read_claim(check: Check, loop: Loop, W: Matrix | None) -> ArcWise:
    """What a proved check claims; raises as ``claim_from_json``."""
    return claim_from_json(check.exact, loop, W)
