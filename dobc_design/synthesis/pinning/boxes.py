"""The smallest gains with which the max-separable certificate of a box holds at a rate: proved, or why there are none.

Proposals come from outside.  Whether gains do is decided by ``separable``; that no gains on these agents do, for any v
and any radius, by an order of the agents or by weights of the rows near the consensus (Farkas).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, Protocol

from dobc_design.conditions.consensus.network import name_agents
from dobc_design.conditions.separable.claim import Separable, acts_by_component
from dobc_design.conditions.separable.decide import coupling_profiles, verify_separable
from dobc_design.conditions.separable.ordering import find_ordering
from dobc_design.conditions.statement import Statement
from dobc_design.exact.interval import UndefinedError
from dobc_design.exact.matrix import Vector
from dobc_design.exact.number import number_text
from dobc_design.exact.reading import shown_number
from dobc_design.problem.changes import changed_problem
from dobc_design.problem.problem import Problem
from dobc_design.synthesis.pinning.box_bound import BoxBound, NearRows, bound_value, holds_nobody, near_rows
from dobc_design.synthesis.pinning.request import PinningRequest
from dobc_design.verdict import Verdict

#: How much faster than asked a proposal is to be, one after the other.
TILTS = (Fraction(1, 10**7), Fraction(1, 10**5), Fraction(1, 1000), Fraction(1, 50))
NOISE = 1e-9  # gains below this part of the largest are left out
MOST_ARCS = 20_000  # of all modes, up to which the rows near the consensus are looked at
LONGEST = 400  # weights of one mode that a statement writes out
ZERO = Fraction(0)


class Proposed(Protocol):
    """v (n,) with min v = 1, and gains (n,) that should do with it."""

    @property
    def v(self) -> Vector: ...
    @property
    def gains(self) -> tuple[float, ...]: ...


#: ``propose(problem without gains, request, rho=..., rate=..., near=...)``.
Propose = Callable[..., Iterable[Proposed]]
PlainRows = Mapping[str, tuple[Mapping[tuple[int, int], Fraction], tuple[Fraction, ...]]]


@dataclass(frozen=True, slots=True, kw_only=True)
class NearProposals:
    """Where proposals about the rows near the consensus come from; these are given as (a_ij, their sums) by mode.

    ``optimum(rows, request)``: with ``v``, the best one there.  ``flows(rows, request, optimum)``: with ``weights``,
    ``v`` and ``flows`` of a ``BoxBound``.  ``hopeless(rows, request)``: weights by mode that show that no v does.  All
    may return None.
    """

    optimum: Callable[[PlainRows, PinningRequest], Any]
    flows: Callable[[PlainRows, PinningRequest, Any], Any]
    hopeless: Callable[[PlainRows, PinningRequest], Mapping[str, Vector] | None]


@dataclass(frozen=True, slots=True, kw_only=True)
class BoxGains:
    """Gains (1/s, by agent index) and the certificate that is PROVED for the ``problem`` with them.

    ``certificate``: min v = 1, so that every start with |e|_inf <= rho is inside; rho None: every start.
    ``lower_bound``: no gains on the allowed agents with a max-separable certificate of any radius at this rate cost
    less (proved, by ``bound``); 0 where that was not examined.
    """

    gains: Mapping[int, Fraction]
    cost: Fraction
    certificate: Separable
    problem: Problem
    lower_bound: Fraction = ZERO
    bound: BoxBound | None = None


def gains_for_box(
    problem: Problem,
    request: PinningRequest,
    *,
    rho: Fraction | None,
    propose: Propose,
    near: NearProposals | None = None,
) -> BoxGains | Statement:
    """Cheap gains on the allowed agents with which the max-separable certificate of the box rho holds, or why not.

    The certificate decays at ``request.rate`` for all s in (0, rho] (None: linear couplings, every s), for every
    switching among the modes.  Gains that the problem has are not looked at.
    Returns: a Statement, REFUTED where no gains on these agents have such a certificate for any radius; UNDECIDED where
    none were found.
    """
    bare = changed_problem(problem, {"pinning.gains": None})
    if not acts_by_component(problem) or (rho is None and not problem.is_linear):
        return Statement(
            kind="method",
            verdict=Verdict.UNDECIDED,
            text="does not apply: the max-separable certificate is for couplings that act on each state component by"
            " itself, and needs a radius where they are not linear.",
        )
    obstacle = _undefined(bare, rho) or _unordered(bare, request)
    if obstacle is not None:
        return obstacle
    rows = near_rows(bare) if near is not None and _arcs(bare) <= MOST_ARCS else None
    plain = None if rows is None else {mode: (each.arcs, each.sums) for mode, each in rows.items()}
    if near is None or rows is None or plain is None:
        return _found(bare, request, rho, propose, None) or _nothing(request, rho)
    optimum = near.optimum(plain, request)
    found = _found(bare, request, rho, propose, None if optimum is None else optimum.v)
    if found is None:
        return _too_fast(rows, request, near.hopeless(plain, request)) or _nothing(request, rho)
    proposed = None if optimum is None else near.flows(plain, request, optimum)
    if proposed is None:
        return found
    bound = BoxBound(weights=proposed.weights, v=proposed.v, flows=proposed.flows)
    value = bound_value(rows, request, bound)
    return found if value is None else replace(found, lower_bound=value, bound=bound)


def _undefined(bare: Problem, rho: Fraction | None) -> Statement | None:
    """Why no v of any kind can be looked at: |e_j - e_i| reaches 2 rho at least, and a coupling ends before."""
    try:
        coupling_profiles(bare, (Fraction(1),) * bare.n, rho=rho, modes=tuple(bare.network.modes))
    except UndefinedError as error:
        return Statement(kind="method", verdict=Verdict.UNDECIDED, text=f"does not apply: {error}")
    return None


def _found(
    bare: Problem, request: PinningRequest, rho: Fraction | None, propose: Propose, near: Any
) -> BoxGains | None:
    """The first proposal that is proved."""
    for tilt in TILTS:
        for proposed in propose(bare, request, rho=rho, rate=float(request.rate * (1 + tilt)), near=near):
            found = _proved(bare, request, proposed, rho)
            if found is not None:
                return found
    return None


def _nothing(request: PinningRequest, rho: Fraction | None) -> Statement:
    where = "" if rho is None else f" over |e_i| <= {shown_number(rho)}"
    return Statement(
        kind="gains",
        verdict=Verdict.UNDECIDED,
        text="no gains on the allowed agents were found with which the max-separable certificate reaches the rate"
        f" {shown_number(request.rate)}{where}, and no proof that there are none.",
    )


def _too_fast(
    rows: Mapping[str, NearRows], request: PinningRequest, weights: Mapping[str, Vector] | None
) -> Statement | None:
    if weights is None or not holds_nobody(rows, request, weights):
        return None
    return Statement(
        kind="rate",
        verdict=Verdict.REFUTED,
        exact={
            f"weights of {mode}": ", ".join(number_text(x) for x in p)
            for mode, p in weights.items()
            if len(p) <= LONGEST
        },
        text="no gains on the allowed agents have a max-separable certificate with the rate"
        f" {shown_number(request.rate)}, of any radius: weighted as shown, the rows of the others near the consensus"
        " contradict each other for every v.",
    )


def _arcs(problem: Problem) -> int:
    return sum(len(arcs) for arcs in problem.network.modes.values())


def _proved(bare: Problem, request: PinningRequest, proposed: Proposed, rho: Fraction | None) -> BoxGains | None:
    """The proposal with gains rounded up, if its certificate is proved."""
    least = max(proposed.gains, default=0.0) * NOISE
    gains = {i: rounded_up(k, request, i) for i, k in enumerate(proposed.gains) if k > least}
    if not gains:
        return None
    problem = changed_problem(bare, {"pinning.gains": {bare.network.labels[i]: k for i, k in gains.items()}})
    claim = Separable(v=proposed.v, alpha=request.rate, rho=rho)
    if verify_separable(problem, claim).verdict is not Verdict.PROVED:
        return None
    cost = sum((request.costs[i] * k for i, k in gains.items()), ZERO)
    return BoxGains(gains=gains, cost=cost, certificate=claim, problem=problem)


def rounded_up(gain: float, request: PinningRequest, agent: int) -> Fraction:
    """The next number of so many digits, or the cap if that is less."""
    unit = Fraction(10) ** (math.floor(math.log10(gain)) - request.digits + 1)
    typed = math.ceil(Fraction(gain) / unit) * unit
    return min(typed, request.caps.get(agent, typed))


def _unordered(bare: Problem, request: PinningRequest) -> Statement | None:
    """A proof that no v exists for any radius, whatever the gains: agents that no order serves."""
    labels = bare.network.labels
    held = changed_problem(bare, {"pinning.gains": {labels[i]: Fraction(1) for i in request.allowed}})
    ordering = find_ordering(held)
    if ordering.exists:
        return None
    stuck = name_agents([labels[i] for i in ordering.stuck])
    modes = name_modes(ordering.blocking) if len(bare.network.modes) > 1 else ""
    return Statement(
        kind="ordering",
        verdict=Verdict.REFUTED,
        exact={"agents": ", ".join(labels[i] for i in ordering.stuck[:50])},
        text="no gains on the allowed agents have a max-separable certificate, of any radius: each of"
        f" {stuck} may not be pinned and in one of the modes hears nobody but these{modes}.",
    )


def name_modes(names: Iterable[str]) -> str:
    """The modes, in brackets."""
    return f" ({', '.join(dict.fromkeys(names))})"
