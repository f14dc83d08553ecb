"""Cures and witnesses over random problems, and how much of what is known from outside is decided."""

from __future__ import annotations

from campaigns import Tally
from cured import cure_campaign, decided_campaign, share, undirected_campaign
from evidence.row import Row

DECIDED = 0.95  # of all conditions with a truth from outside and a margin of 1e-6
KINDS = ("lemma1", "theorem", "linear loop", "undirected")


def cures(count: int, seed: int) -> Row:
    tally = cure_campaign(range(seed, seed + count))
    what = "refuted: the oracle confirms the witness, a cure is offered, and written and read it is proved"
    return Row(what=what, count=count, failures=tuple(tally.wrong), notes=(_counted(tally),))


def decided(count: int, seed: int) -> Row:
    tally = decided_campaign(range(seed, seed + count))
    more = undirected_campaign(range(seed, seed + count))
    tally.counts.update(more.counts)
    tally.wrong += more.wrong
    yes, all_of_them = (sum(n for name, n in tally.counts.items() if name.endswith(end)) for end in (": decided", ""))
    if yes < DECIDED * all_of_them:
        tally.wrong.append(f"only {yes} of {all_of_them} are decided")
    parts = ", ".join(f"{kind} {100 * share(tally, kind):.1f} %" for kind in KINDS)
    notes = (_counted(tally), f"decided: {yes} of {all_of_them}, {100 * yes / max(1, all_of_them):.1f} % ({parts})")
    what = "truth known from outside with a margin of 1e-6: decided, and never wrongly"
    return Row(what=what, count=2 * count, failures=tuple(tally.wrong), notes=notes)


def _counted(tally: Tally) -> str:
    return ", ".join(f"{number} {name}" for name, number in sorted(tally.counts.items()))
