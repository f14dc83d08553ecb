"""The campaigns of tests/support over many random problems, as rows of the table.

Certificates are checked by ``verify`` and by an oracle that shares no code with theorems, verify or exact.
"""

from __future__ import annotations

from campaigns import Tally, decision_campaign, mutant_campaign, outside_campaign, recheck_campaign, reduction_campaign
from evidence.row import Row
from groups_oracle import GroupsOracle, random_grouped_problem
from region_campaigns import region_mutant_campaign, region_recheck_campaign

MUTANTS = 20  # of each certificate
REGION_MUTANTS = 100


def recheck(count: int, seed: int) -> Row:
    tally = recheck_campaign(range(seed, seed + count))
    return _row("certify: verify accepts, an independent exact oracle confirms every claim", count, tally)


def mutants(count: int, seed: int) -> Row:
    tally = mutant_campaign(range(seed, seed + count // MUTANTS), each=MUTANTS)
    return _row(
        "changed certificates: refused, or true for the oracle; both checkers agree", count // MUTANTS * MUTANTS, tally
    )


def region_recheck(count: int, seed: int) -> Row:
    tally = region_recheck_campaign(range(seed, seed + count))
    return _row("certify with a region: both checkers accept, an independent oracle finds nothing false", count, tally)


def region_mutants(count: int, seed: int) -> Row:
    tally = region_mutant_campaign(range(seed, seed + count // REGION_MUTANTS), each=REGION_MUTANTS)
    changed = sum(tally.counts.values()) - tally.counts["nothing to change"]
    return _row("changed regional claims: refused, or true for the oracle; both checkers agree", changed, tally)


def groups_recheck(count: int, seed: int) -> Row:
    tally = recheck_campaign(range(seed, seed + count), make=random_grouped_problem, know=GroupsOracle)
    return _row(
        "groups of agents: both checkers accept, an oracle with the whole Psi finds nothing false", count, tally
    )


def groups_mutants(count: int, seed: int) -> Row:
    seeds = range(seed, seed + count // MUTANTS)
    tally = mutant_campaign(seeds, each=MUTANTS, make=random_grouped_problem, know=GroupsOracle)
    return _row(
        "groups of agents, changed: refused, or true for the oracle; both checkers agree",
        count // MUTANTS * MUTANTS,
        tally,
    )


def whole_psi(count: int, seed: int) -> Row:
    tally = reduction_campaign(range(seed, seed + count))
    return _row("Psi < 0: the Reduction = the oracle's own (18), pairs at the boundary", count, tally)


def decision(count: int, seed: int) -> Row:
    tally = decision_campaign(range(seed, seed + count))
    return _row("Decision: badly scaled, Lambda < 0: theorem proved iff (A, C) is detectable", count, tally)


def outside(count: int, seed: int) -> Row:
    tally = outside_campaign(range(seed, seed + count))
    return _row("linear problems: verdicts and rates against eigenvalues and matrix exponentials", count, tally)


def _row(what: str, count: int, tally: Tally) -> Row:
    counts = ", ".join(f"{number} {name}" for name, number in sorted(tally.counts.items()))
    return Row(what=what, count=count, failures=tuple(tally.wrong), notes=(counts,))
