"""Certified regions where the truth is known from outside: the other equilibrium, the slowest eigenvalue."""

from __future__ import annotations

from statistics import median

import known_regions
from evidence.row import Row


def run(count: int, seed: int) -> Row:
    """Half of them two agents, half linear networks."""
    half = count // 2
    two = known_regions.equilibrium_campaign(range(seed, seed + half))
    linear = known_regions.linear_campaign(range(seed, seed + count - half))
    counted = two.counts + linear.counts
    notes = [", ".join(f"{number} {name}" for name, number in sorted(counted.items()))]
    for what, ratios in {**two.ratios, **linear.ratios}.items():
        of = "true rate" if what.startswith("rate") else "way to the nearest equilibrium"
        notes.append(
            f"{what}: {len(ratios)} certified, {median(ratios):.4f} of the {of} in the median"
            f" ({min(ratios):.4f} to {max(ratios):.4f})"
        )
    what = "regions: no ball or box holds another equilibrium, no rate is above the slowest eigenvalue's"
    return Row(what=what, count=count, failures=(*two.wrong, *linear.wrong), notes=tuple(notes))
