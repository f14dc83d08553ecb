"""Enclosures of h, h' and h(y)/y against random points at 200 bits, for every function and
compositions."""

from random import Random

from couplings import OUTER, coupling_text, outside
from evidence.row import Row

from dobc_design.coupling.functions import FUNCTIONS

PER_COUPLING = 1000  # points on one random interval of one random coupling


def run(count: int, seed: int) -> Row:
    failures: list[str] = []
    done = turn = 0
    used: set[str] = set()
    while done < count:
        text = coupling_text(seed + turn)
        used |= {name for name in FUNCTIONS if f"{name}(" in text}
        points = min(PER_COUPLING, count - done)
        failures += [
            f"turn {turn}: {each}" for each in outside(text, Random(f"{seed} {turn}"), points)
        ]
        done += points
        turn += 1
    missing = set(FUNCTIONS) - used
    if missing and turn >= 3 * len(OUTER):
        failures.append(f"never used: {sorted(missing)}")
    what = "enclosures of h, h' and the secant gain contain the values at random points (200 bits)"
    return Row(
        what, done, failures, [f"{turn} couplings, {len(used)} of {len(FUNCTIONS)} functions"]
    )
