"""The smallest gains with which V = e'e decays at a rate over a ball, all arc gains in their sectors: proved.

The proposal comes from outside; whether it does is decided by ``lure``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Protocol

from dobc_design.conditions.numbers import claimed, shorten
from dobc_design.conditions.quadratic.claim import Lure
from dobc_design.conditions.quadratic.decide import verify_lure
from dobc_design.conditions.quadratic.sectors import Sectors, build_sectors, enclose_ranges
from dobc_design.conditions.statement import Statement
from dobc_design.exact.interval import UndefinedError
from dobc_design.exact.number import root_above
from dobc_design.exact.reading import shown_number
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.problem.changes import changed_problem
from dobc_design.problem.problem import Problem
from dobc_design.synthesis.pinning.boxes import NOISE, TILTS, ZERO, rounded_up
from dobc_design.synthesis.pinning.request import PinningRequest
from dobc_design.verdict import Verdict

DECIMALS = 10**6  # of the radius on which arc gains are bounded
DIGITS = (6, 9, 12)  # of the multipliers


class ProposedBall(Protocol):
    """Gains (n,), and multipliers by mode, one per channel."""

    @property
    def gains(self) -> tuple[float, ...]: ...
    @property
    def multipliers(self) -> Mapping[str, tuple[float, ...]]: ...


#: ``propose(sectors of the problem without gains, request, rate=...)``.
ProposeBall = Callable[..., Iterable[ProposedBall]]


@dataclass(frozen=True, slots=True, kw_only=True)
class BallGains:
    """Gains (1/s, by agent index) and the certificate, P_e = I and eps = 0, PROVED for the ``problem`` with them."""

    gains: Mapping[int, Fraction]
    cost: Fraction
    certificate: Lure
    problem: Problem


def gains_for_ball(
    problem: Problem, request: PinningRequest, *, radius: Fraction | None, propose: ProposeBall
) -> BallGains | Statement:
    """Cheap gains on the allowed agents with which V = e'e obeys V' <= -2 rate V while |e| <= radius and eps = 0.

    ``radius`` None: everywhere, for linear couplings.  Gains that the problem has are not looked at.
    """
    bare = changed_problem(problem, {"pinning.gains": None})
    reach = None if radius is None or problem.is_linear else _times_root_two(radius)
    try:
        ranges = enclose_ranges(bare, radius=reach)
    except UndefinedError as error:
        return Statement(kind="method", verdict=Verdict.UNDECIDED, text=f"does not apply: {error}")
    sectors = build_sectors(bare, ranges, radius=reach)
    unit = SparseSymmetric(sectors.size, {(i, i): Fraction(1) for i in range(sectors.size)})
    for tilt in TILTS:
        for proposed in propose(sectors, request, rate=float(request.rate * (1 + tilt))):
            least = max(proposed.gains, default=0.0) * NOISE
            gains = {i: rounded_up(k, request, i) for i, k in enumerate(proposed.gains) if k > least}
            labels = bare.network.labels
            held = changed_problem(bare, {"pinning.gains": {labels[i]: k for i, k in gains.items()}})
            for digits in DIGITS:
                claim = Lure(
                    P_e=unit,
                    ranges=ranges,
                    radius=reach,
                    level=None if reach is None else reach * reach / 2,
                    multipliers=_rounded(sectors, proposed, digits),
                    rate=request.rate,
                )
                if verify_lure(held, claim).verdict is Verdict.PROVED:
                    cost = sum((request.costs[i] * k for i, k in gains.items()), ZERO)
                    return BallGains(gains=gains, cost=cost, certificate=claim, problem=held)
    where = "" if radius is None else f" over |e| <= {shown_number(radius)}"
    return Statement(
        kind="gains",
        verdict=Verdict.UNDECIDED,
        text=f"no gains on the allowed agents were found with which V = e'e decays at the rate"
        f" {shown_number(request.rate)}{where} for all arc gains there, and no proof that there are none.",
    )


def _rounded(sectors: Sectors, proposed: ProposedBall, digits: int) -> dict[str, tuple[Fraction, ...]]:
    """Multipliers of so many digits, > 0 where a gain has a range."""
    return {
        mode: tuple(
            claimed(shorten(max(tau, 1e-12), digits=digits)) if each.spread else ZERO
            for each, tau in zip(channels, proposed.multipliers[mode], strict=True)
        )
        for mode, channels in sectors.modes.items()
    }


def _times_root_two(radius: Fraction) -> Fraction:
    """radius sqrt 2, not less: |e_j - e_i| while |e| <= radius."""
    return root_above(2 * radius * radius, unit=DECIMALS)
