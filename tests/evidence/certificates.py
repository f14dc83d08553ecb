"""The campaigns of tests/support over many random problems, as rows of the table.

Certificates are checked by ``verify`` and by an oracle that shares no code with theorems, verify or
exact.
"""

from collections import Counter
from collections.abc import Callable
from statistics import median

from campaigns import certificates as campaigns
from campaigns import known_regions
from campaigns.certificates import Tally
from campaigns.cures import cure_campaign, decided_campaign, share, undirected_campaign
from campaigns.regions import region_mutant_campaign, region_recheck_campaign
from checker_files.removals import EQUIVALENT, unnoticed
from evidence.row import Row
from oracles.groups import GroupsOracle, random_grouped_problem

MUTANTS = 20  # of each certificate
REGION_MUTANTS = 100
DECIDED = 0.95  # of all conditions with a truth from outside and a margin of 1e-6
KINDS = ("lemma1", "theorem", "linear loop", "undirected")
GROUPS = {"make": random_grouped_problem, "know": GroupsOracle}


def _counted(counts: Counter[str]) -> str:
    return ", ".join(f"{number} {name}" for name, number in sorted(counts.items()))


def _row(what: str, count: int, tally: Tally, *notes: str) -> Row:
    return Row(what, count, tally.wrong, [_counted(tally.counts), *notes])


def _campaign(what: str, run: Callable[..., Tally], **more: object) -> Callable[[int, int], Row]:
    """One case for every seed."""
    return lambda count, seed: _row(what, count, run(range(seed, seed + count), **more))


def _mutants(what: str, **more: object) -> Callable[[int, int], Row]:
    def run(count: int, seed: int) -> Row:
        tally = campaigns.mutant_campaign(
            range(seed, seed + count // MUTANTS), each=MUTANTS, **more
        )
        return _row(
            f"{what}: refused, or true for the oracle; both checkers agree",
            count // MUTANTS * MUTANTS,
            tally,
        )

    return run


recheck = _campaign(
    "certify: verify accepts, an independent exact oracle confirms every claim",
    campaigns.recheck_campaign,
)
region_recheck = _campaign(
    "certify with a region: both checkers accept, an independent oracle finds nothing false",
    region_recheck_campaign,
)
groups_recheck = _campaign(
    "groups of agents: both checkers accept, an oracle with the whole Psi finds nothing false",
    campaigns.recheck_campaign,
    **GROUPS,
)
mutants = _mutants("changed certificates")
groups_mutants = _mutants("groups of agents, changed", **GROUPS)
whole_psi = _campaign(
    "Psi < 0: the Reduction = the oracle's own (18), pairs at the boundary",
    campaigns.reduction_campaign,
)
decision = _campaign(
    "Decision: badly scaled, Lambda < 0: theorem proved iff (A, C) is detectable",
    campaigns.decision_campaign,
)
outside = _campaign(
    "linear problems: verdicts and rates against eigenvalues and matrix exponentials",
    campaigns.outside_campaign,
)
cures = _campaign(
    "refuted: the oracle confirms the witness, a cure is offered, and written and read it "
    "is proved",
    cure_campaign,
)


def region_mutants(count: int, seed: int) -> Row:
    tally = region_mutant_campaign(range(seed, seed + count // REGION_MUTANTS), each=REGION_MUTANTS)
    changed = sum(tally.counts.values()) - tally.counts["nothing to change"]
    return _row(
        "changed regional claims: refused, or true for the oracle; both checkers agree",
        changed,
        tally,
    )


def decided(count: int, seed: int) -> Row:
    tally = decided_campaign(range(seed, seed + count))
    more = undirected_campaign(range(seed, seed + count))
    tally.counts.update(more.counts)
    tally.wrong += more.wrong
    yes, all_of_them = (
        sum(n for name, n in tally.counts.items() if name.endswith(end))
        for end in (": decided", "")
    )
    if yes < DECIDED * all_of_them:
        tally.wrong.append(f"only {yes} of {all_of_them} are decided")
    parts = ", ".join(f"{kind} {100 * share(tally, kind):.1f} %" for kind in KINDS)
    notes = [f"decided: {yes} of {all_of_them}, {100 * yes / max(1, all_of_them):.1f} % ({parts})"]
    return _row(
        "truth known from outside with a margin of 1e-6: decided, and never wrongly",
        2 * count,
        tally,
        *notes,
    )


def regions(count: int, seed: int) -> Row:
    """Certified regions where the truth is known from outside: half of them two agents, half linear
    networks."""
    half = count // 2
    two = known_regions.equilibrium_campaign(range(seed, seed + half))
    linear = known_regions.linear_campaign(range(seed, seed + count - half))
    notes = []
    for what, ratios in {**two.ratios, **linear.ratios}.items():
        of = "true rate" if what.startswith("rate") else "way to the nearest equilibrium"
        span = (
            f"{median(ratios):.4f} of the {of} in the median ({min(ratios):.4f} to "
            f"{max(ratios):.4f})"
        )
        notes.append(f"{what}: {len(ratios)} certified, {span}")
    what = (
        "regions: no ball or box holds another equilibrium, no rate is above the slowest "
        "eigenvalue's"
    )
    return Row(
        what, count, [*two.wrong, *linear.wrong], [_counted(two.counts + linear.counts), *notes]
    )


def removals(count: int, seed: int) -> Row:
    """``count`` of the lone checker's conditions, evenly spread, taken away: a case has to
    notice."""
    tried, missed = unnoticed(count)
    notes = [f"{len(EQUIVALENT)} removals that nothing can notice are listed with their reasons"]
    return Row("the lone checker with one of its checks removed: noticed", tried, missed, notes)
