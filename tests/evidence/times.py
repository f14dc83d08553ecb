"""The certified time to one percent, ln(100 factor) / rate, of many problems: none is later than
with earlier versions.

    python tests/evidence/times.py > tests/evidence/times.csv

writes what this version finds: `times.csv` holds it for the version that looked for the fastest
rate alone.
"""

import csv
import math
import sys
from dataclasses import dataclass
from pathlib import Path
from random import Random

if __name__ == "__main__":
    TESTS = Path(__file__).resolve().parents[1]
    sys.path[:0] = [str(TESTS), str(TESTS / "support")]

from evidence.row import Row
from networks import network_of

import dobc_design as dd
from dobc_design import Dynamics, Exosystem, Problem, Region

BUILT_IN = tuple(path.stem for path in sorted(Path(dd.__file__).parent.glob("problems/*.toml")))
FOUND = Path(__file__).resolve().parents[1] / "found"
BEFORE = Path(__file__).with_name("times.csv")
RANDOM = 50
SAME = 1.001  # two times that differ by less are the same: solvers stop here or there
COUPLINGS = ("exp(y) - 1 + y", "tanh(y)", "2*y", "y + y**3", "sin(y)/2 + y", "atan(y)")


@dataclass(frozen=True)
class Bound:
    """abs(e(t)) <= factor abs(e(0)) exp(-rate t): of the check that settles first."""

    check: str
    rate: float
    factor: float

    @property
    def time(self) -> float:
        return (math.log(100) + math.log(self.factor)) / self.rate


def names() -> list[str]:
    """Built-in problems, those of the folder tests/found, and random ones."""
    files = []
    for path in sorted(FOUND.glob("*.toml")):
        if path.stem in ("drones", "cars"):
            files.append(path.stem)
    return [*BUILT_IN, *files, *(f"random-{seed}" for seed in range(RANDOM))]


def problem_of(name: str) -> Problem:
    if name.startswith("random-"):
        return random_problem(int(name.removeprefix("random-")))
    return dd.load_problem(FOUND / f"{name}.toml" if (FOUND / f"{name}.toml").exists() else name)


def random_problem(seed: int) -> Problem:
    """Agents on a line, a tree or a random graph, all of them reached, with a region; some
    oscillate, some switch."""
    r = Random(f"times {seed}")
    n = r.randint(3, 12)
    modes = {f"G{k}": _arcs(r, n) for k in range(r.choice((1, 1, 1, 2)))}
    pins = {1: r.choice(("1/2", 1, 3, 5))} | {i: 2 for i in range(2, n + 1) if r.random() < 0.15}
    disturbed = Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]]) if r.random() < 0.5 else None
    size = r.choice(("1/2", 1, 3))
    plain = {
        "name": f"random-{seed}",
        "network": network_of(modes, n),
        "coupling": r.choice(COUPLINGS),
        "gains": pins,
    }
    noise = None if disturbed is None else "1/2"
    if r.random() < 0.2:
        moving = Dynamics(A=[[0, 1], [-1, r.choice((-1, "-1/2"))]], B=[[0], [1]])
        gains = {i: [[k, k]] for i, k in pins.items()}
        own = plain | {
            "coupling": ["y1 + y2"],
            "gains": gains,
            "dynamics": moving,
            "target": [0, 0],
        }
        return Problem(
            **own,
            exosystem=disturbed,
            region=Region(initial_states=[-1, 1], initial_disturbance=noise),
        )
    region = Region(initial_states=[f"-{size}", size], initial_disturbance=noise)
    return Problem(**plain, exosystem=disturbed, region=region)


def _arcs(r: Random, n: int) -> list[list[object]]:
    """Everybody listens to an earlier agent, and to some others."""
    parents = {i: i - 1 if r.random() < 0.5 else r.randint(1, i - 1) for i in range(2, n + 1)}
    pairs = set(parents.items())
    pairs |= {
        (i, j)
        for i in range(1, n + 1)
        for j in range(1, n + 1)
        if i != j and r.random() < r.choice((0, 0.15))
    }
    return [[i, j, r.choice((1, 1, 2, "1/2"))] for i, j in sorted(pairs)]


def bound_of(name: str) -> Bound | None:
    """What the check says that carries the verdict; None where nothing is proved or no bound
    follows."""
    certificate = dd.certify(problem_of(name))
    if certificate.rate is None or certificate.factor is None:
        return None
    return Bound(str(certificate.covered_by), certificate.rate, certificate.factor)


def recorded() -> dict[str, Bound]:
    with BEFORE.open(encoding="utf-8", newline="") as file:
        rows = csv.DictReader(file)
        return {
            row["problem"]: Bound(row["check"], float(row["rate"]), float(row["factor"]))
            for row in rows
        }


def times(count: int, seed: int) -> Row:
    """No certified time to one percent is later than the one that is recorded."""
    before = recorded()
    failures = []
    notes = []
    chosen = Random(seed).sample(names(), min(count, len(names())))
    for name in chosen:
        old = before.get(name)
        new = bound_of(name)
        notes.append(f"{name}: {_words(old)}; now {_words(new)}")
        if old is not None and (new is None or new.time > old.time * SAME):
            failures.append(notes[-1])
    return Row(
        "certified times to one percent: none later than before", len(chosen), failures, notes
    )


def _words(bound: Bound | None) -> str:
    if bound is None:
        return "no bound"
    return f"{bound.check} {bound.rate:.4g} 1/s, factor {bound.factor:.4g}, {bound.time:.4g} s"


if __name__ == "__main__":
    table = csv.writer(sys.stdout)
    table.writerow(("problem", "check", "rate", "factor"))
    for each in names():
        found = bound_of(each)
        if found is not None:
            table.writerow((each, found.check, found.rate, found.factor))
            sys.stdout.flush()
