"""The errors of linear couplings over one round of a sequence: e -> M e, and when that is proved to
expand.

M is the product of exp((J_p - K) T_p) over the phases, the last one on the left; J_p - K includes
the dynamics of the agents.  If |tr M^k| > n m then an eigenvalue of M is larger than 1 in size,
because tr M^k is the sum of the n m k-th powers of eigenvalues.  With eps = 0 errors along its
eigenvector grow without bound from every neighbourhood of the target, whatever the observer.  Balls
of python-flint enclose every exponential, product and trace.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Final

import numpy as np

from dobc_design.conditions.check import Check, Values
from dobc_design.conditions.consensus.claim import state_theorems
from dobc_design.conditions.consensus.decide import linear_part
from dobc_design.conditions.domain import Domain
from dobc_design.conditions.numbers import read_rational
from dobc_design.exact.exponential import expanding_product
from dobc_design.exact.matrix import Matrix
from dobc_design.loop.guarantee import Phase
from dobc_design.loop.loop import Loop
from dobc_design.verdict import Verdict

POWERS: Final = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32)  # that are tried
MOST_POWER: Final = 64
MOST_ROWS: Final = 20  # n m
MOST_PHASES: Final = 200
MOST_GROWTH: Final = 1000  # the sum of |J_p - K| T_p over the phases, in the largest row sum


def growth_check(loop: Loop, domain: Domain) -> Check | None:
    """REFUTED, if errors grow from round to round and one of POWERS shows it; None if none does."""
    for power in POWERS:
        if (factor := growth(loop, power)) is not None:
            reason = (
                f"errors grow by a factor of about {factor:.4g} in every round of "
                f"{loop.guarantee.in_words()}"
            )
            reason += " (the spectral radius of the linear map of a round)."
            claim = Values({"power": str(power)})
            return Check(
                id="schedule", verdict=Verdict.REFUTED, domain=domain, reason=reason, claim=claim
            )
    return None


def growth(loop: Loop, power: int) -> float | None:
    """About the spectral radius of M, where |tr M^power| > n m is proved; None elsewhere."""
    phases = loop.guarantee.phases
    parts = _parts(loop, phases)
    if parts is None or not 1 <= power <= MOST_POWER:
        return None
    whole = expanding_product(parts, power)
    return None if whole is None else float(np.abs(np.linalg.eigvals(np.array(whole))).max())


def _parts(loop: Loop, phases: tuple[Phase, ...]) -> list[tuple[Matrix, Fraction]] | None:
    """J_p - K and the length of every phase; None where the question is another one, or takes
    long."""
    one_end = all(
        phase.longest == phase.shortest and len(phase.successors) == 1 for phase in phases
    )
    if not (
        loop.is_linear and one_end and 0 < len(phases) <= MOST_PHASES and loop.size <= MOST_ROWS
    ):
        return None
    if sum(phase.first for phase in phases) != 1 or any(
        each.optional for each in loop.modes.values()
    ):
        return None
    statements = state_theorems(loop)
    known = {mode: linear_part(statements, mode) for mode in {phase.mode for phase in phases}}
    parts = [(known[phase.mode], phase.shortest) for phase in phases]
    sure = [(A, time) for A, time in parts if A is not None]
    if len(sure) < len(parts):
        return None
    total = sum(
        (max(sum(map(abs, row), Fraction(0)) for row in A) * time for A, time in sure), Fraction(0)
    )
    return sure if total <= MOST_GROWTH else None


def confirm_growth(check: Check, loop: Loop, domain: Domain) -> str | None:
    """None if a refuted check of the schedule is confirmed, else what is not."""
    exact = check.exact or {}
    if (
        set(exact) != {"power"}
        or check.rate is not None
        or check.witness is not None
        or check.domain != domain
    ):
        return "it is refuted by the power of a trace, and by nothing else"
    power = read_rational(exact["power"])
    if power.denominator != 1 or not 1 <= power <= MOST_POWER:
        return f"power must be a whole number from 1 to {MOST_POWER}"
    return (
        None
        if growth(loop, int(power)) is not None
        else "the trace of that power does not show that errors grow"
    )
