"""The errors of linear couplings over one round of a sequence: e -> M e, and when that is proved to
expand.

M is the product of exp((J_p - K) T_p) over the phases, the last one on the left; J_p - K includes
the dynamics of the agents.  If |tr M^k| > n m then an eigenvalue of M is larger than 1 in size,
because tr M^k is the sum of the n m k-th powers of eigenvalues.  With eps = 0 errors along its
eigenvector grow without bound from every neighbourhood of the target, whatever the observer.  Balls
of python-flint enclose every exponential, product and trace.
"""

from fractions import Fraction

import numpy as np

from dobc_design.conditions.check import Check, Values
from dobc_design.conditions.consensus.claim import state_theorems
from dobc_design.conditions.consensus.decide import linear_part
from dobc_design.conditions.domain import Domain
from dobc_design.conditions.numbers import read_rational
from dobc_design.exact.exponential import expanding_product
from dobc_design.exact.matrix import Matrix, largest_entry, row_norm
from dobc_design.exact.number import ZERO
from dobc_design.loop.loop import Loop
from dobc_design.loop.pairs import are_pairs
from dobc_design.verdict import Verdict

POWERS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32)  # that are tried
MOST_POWER = 64
MOST_ROWS = 20  # n m
MOST_PHASES = 200
MOST_GROWTH = 1000  # the sum of |J_p - K| T_p over the phases, in the largest row sum


def growth_check(loop: Loop, domain: Domain) -> Check | None:
    """REFUTED, if errors grow from round to round and one of POWERS shows it; None if none does."""
    for power in POWERS:
        factor = growth(loop, power)
        if factor is not None:
            return Check(
                id="schedule",
                verdict=Verdict.REFUTED,
                domain=domain,
                reason=f"errors grow by a factor of about {factor:.4g} in every round of "
                f"{loop.guarantee.in_words()} (the spectral radius of the linear map of a round).",
                claim=Values({"power": str(power)}),
            )
    return None


def growth(loop: Loop, power: int) -> float | None:
    """About the spectral radius of M, where |tr M^power| > n m is proved; None elsewhere."""
    parts = _parts(loop)
    if parts is None or not 1 <= power <= MOST_POWER:
        return None
    whole = expanding_product(parts, power)
    return None if whole is None else largest_entry(np.linalg.eigvals(np.array(whole)))


def _parts(loop: Loop) -> list[tuple[Matrix, Fraction]] | None:
    """J_p - K and the length of every phase; None where the question is another one, or takes
    long."""
    phases = loop.guarantee.phases
    in_turn = all(p.longest == p.shortest and len(p.successors) == 1 for p in phases)
    is_small = 0 < len(phases) <= MOST_PHASES and loop.size <= MOST_ROWS
    # Rows leave signs out, and with them errors may well decay.
    if not (loop.is_linear and in_turn and is_small) or loop.loose is not None or loop.signed:
        return None
    # Errors that grow are those from one target.
    if loop.gap:
        return None
    if sum(phase.first for phase in phases) != 1 or are_pairs(loop):
        return None
    statements = state_theorems(loop)
    modes = {phase.mode for phase in phases}
    known = {mode: linear_part(statements, mode) for mode in modes}
    parts = list[tuple[Matrix, Fraction]]()
    total = ZERO
    for phase in phases:
        A = known[phase.mode]
        if A is None:
            return None
        parts.append((A, phase.shortest))
        total += row_norm(A) * phase.shortest
    return parts if total <= MOST_GROWTH else None


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
    if growth(loop, int(power)) is None:
        return "the trace of that power does not show that errors grow"
    return None
