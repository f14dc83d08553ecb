"""`make bench`: the speed table.  Ratios measured in one run, CPU time, medians; BLAS has one
thread.

A bar that is missed says BELOW (or ABOVE, where it is a ceiling).  Timings are never asserted in
tests.
"""

import os
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from itertools import chain
from pathlib import Path
from random import Random
from typing import Any

for _threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "RAYON_NUM_THREADS"):
    os.environ[_threads] = "1"

sys.path.append(str(Path(__file__).resolve().parents[1] / "support"))

from arcs import arc_bars
from large import agreement_bars, lambda_rows, size_bars, weighted_rows, whole_bars
from oracles.observers import solve_dense, solve_reduced
from peers import peer_table
from pinning import large_design, pinning_bars, shared_design
from simulation import simulation_bars

from dobc_design import Exosystem, Network, Problem, Switching, block_lmi, certify
from dobc_design.conditions.consensus.claim import reduced, state_theorems
from dobc_design.exact.cholesky import Scaled, bad_direction, proves_by_integers, scaled
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.exact.zmatrix import search
from dobc_design.loop.make import loop_of
from dobc_design.solvers.conic import solve_directly
from dobc_design.solvers.program import Program, Solution

EXOSYSTEM = Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]])
Arcs = list[tuple[int, int]]
HELP = "import sys; from dobc_design.cli.main import main; sys.argv = ['dobc', '--help']; main()"


@dataclass(frozen=True, kw_only=True)
class Bar:
    """A ratio and what is asked of it; ``ceiling``: at most, else at least."""

    what: str
    bar: float
    ratio: float
    ceiling: bool = False
    note: str = ""

    def __str__(self) -> str:
        sign, good = (
            ("<=", self.ratio <= self.bar) if self.ceiling else (">=", self.ratio >= self.bar)
        )
        outcome = "ok" if good else "ABOVE" if self.ceiling else "BELOW"
        digits = 2 if self.ratio < 10 else 0
        return (
            f"{self.what:<72} {sign} {self.bar:>5g}x  {self.ratio:>8.{digits}f}x  {outcome:<5} "
            f" {self.note}"
        )


def main() -> None:
    print("CPU time, medians, one BLAS thread; both sides of a ratio from the same run.\n")
    print(f"{'what':<72} {'bar':>9}  {'measured':>9}")
    for bar in bars():
        print(bar, flush=True)
    sections = {
        "Designs": (each() for each in (large_design, shared_design)),
        "Certified radii of small cycles, beside other tools": peer_table(),
        "Large networks: products of the n x n matrix, CPU time and peak memory of the "
        "whole way": lambda_rows(),
        "The weighted theorem beside Lemma 1 (at most 3 times its time)": weighted_rows(),
    }
    for title, lines in sections.items():
        print(f"\n{title} (no bar):")
        for line in lines:
            print(line, flush=True)


def bars() -> Iterator[Bar]:
    lmi = "Theorem 1, reduced vs block LMI in cvxpy"
    yield against_dense(
        f"{lmi}, tr P + |Q|^2, n = 100 sparse", problem(100, random_balanced(100)), bar=200
    )
    yield against_dense(f"{lmi}, tr P + |Q|^2, n = 50 dense", problem(50, complete(50)), bar=1000)
    for n, bar in ((10, 10), (30, 30), (100, 200)):
        yield against_block_lmi(
            f"{lmi} by dd.block_lmi, n = {n} sparse", problem(n, random_balanced(n)), bar=bar
        )
    yield tiny("tiny observer SDP: Clarabel directly vs rebuilt in cvxpy")
    paths = "definiteness, exact LDL' vs"
    yield against_elimination(
        f"{paths} factor with integer rest, n = 100 dense", gram(100), by_integer_rest, bar=50
    )
    yield against_elimination(
        f"{paths} factor with integer rest, n = 200 dense", gram(200), by_integer_rest, bar=100
    )
    yield against_elimination(
        f"{paths} vector v > 0, n = 1000 ring, 200 chords", ring(1000), by_vector, bar=100
    )
    yield help_bar("dobc --help vs python -c 'import numpy'")
    yield schedule_bar("certify a sequence without repetition, 100 vs 30 phases of 3 agents")
    for row in chain(pinning_bars(), simulation_bars()):
        yield Bar(**row)
    faster, growth = arc_bars()
    yield Bar(**faster)
    yield Bar(**growth, ceiling=True)
    for row in chain(whole_bars(), size_bars(), agreement_bars()):
        yield Bar(**row, ceiling=True)


def against_dense(what: str, given: Problem, *, bar: float) -> Bar:
    """Both from the problem object to the solver's answer."""

    def dense() -> Solution:
        return solve_dense(Program(pencils=state_theorems(loop_of(given)).psi()))

    def small() -> Solution:
        return solve_reduced(given)

    ours = small()
    theirs = dense()
    slow = median_of(dense, repeats=5)
    fast = median_of(small, repeats=25, inner=10)
    difference = abs(ours.objective - theirs.objective) / abs(theirs.objective)
    agree = "" if difference <= 1e-5 else "THE ANSWERS DIFFER: "
    note = f"{slow:.3g} s / {1e3 * fast:.3g} ms; {agree}optima {difference:.0e} apart"
    return Bar(what=what, bar=bar, ratio=slow / fast, note=note)


def against_block_lmi(what: str, given: Problem, *, bar: float) -> Bar:
    """Both from the problem object to a P and Q, the block with the constraints that users get."""

    def dense() -> None:
        lmi = block_lmi(given)
        lmi.problem().solve(solver="CLARABEL")
        if lmi.W is None:
            raise RuntimeError(lmi.status)

    slow = median_of(dense, repeats=3)
    fast = median_of(partial(solve_reduced, given), repeats=15, inner=10)
    return Bar(what=what, bar=bar, ratio=slow / fast, note=f"{slow:.3g} s / {1e3 * fast:.3g} ms")


def tiny(what: str) -> Bar:
    program = Program(pencils=(reduced(Fraction(-1), EXOSYSTEM),))
    slow = median_of(partial(solve_dense, program), repeats=15, inner=3)
    fast = median_of(partial(solve_directly, program), repeats=15, inner=100)
    return Bar(
        what=what, bar=30, ratio=slow / fast, note=f"{1e3 * slow:.3g} ms / {1e3 * fast:.3g} ms"
    )


def against_elimination(
    what: str, M: SparseSymmetric, path: Callable[[SparseSymmetric], bool], *, bar: float
) -> Bar:
    """Both from the sparse rational matrix to "positive definite"; the elimination is timed
    once."""
    fast = median_of(partial(path, M), repeats=9)
    start = time.process_time()
    proved = bad_direction(M, strict=True) is None
    slow = time.process_time() - start
    agree = "" if proved and path(M) else "THE ANSWERS DIFFER: "
    return Bar(
        what=what, bar=bar, ratio=slow / fast, note=f"{agree}{slow:.3g} s / {1e3 * fast:.3g} ms"
    )


def by_integer_rest(M: SparseSymmetric) -> bool:
    S = scaled(M)
    return isinstance(S, Scaled) and proves_by_integers(S)


def by_vector(M: SparseSymmetric) -> bool:
    return search(M, strict=True).vector is not None


def gram(n: int) -> SparseSymmetric:
    """G G' + I for small integers in G: dense, and the elimination's numbers begin short."""
    r = Random(n)
    G = []
    for _ in range(n):
        G.append([r.randint(-3, 3) for _ in range(n)])
    return SparseSymmetric(
        n,
        {
            (i, j): Fraction(sum(x * y for x, y in zip(G[i], G[j], strict=True)) + (i == j))
            for i in range(n)
            for j in range(i, n)
        },
    )


def ring(n: int, *, chord: int = 5) -> SparseSymmetric:
    """The Laplacian of a ring with a chord from every fifth agent, one agent in ten pinned."""
    r = Random(n)
    arcs = [(i, (i + 1) % n) for i in range(n)] + [(i, r.randrange(n)) for i in range(0, n, chord)]
    entries = {(i, i): Fraction(5 if i % 10 == 0 else 0) for i in range(n)}
    for i, j in arcs:
        if i != j:
            place = (min(i, j), max(i, j))
            entries[place] = entries.get(place, Fraction(0)) - 2
            entries[i, i] += 2
            entries[j, j] += 2
    return SparseSymmetric(n, entries)


def help_bar(what: str) -> Bar:
    """Medians of 15, taken in turns so that a busy machine slows down both."""
    # the first pair warms the disk cache
    times = [(of_child(HELP), of_child("import numpy")) for _ in range(16)][1:]
    ours, theirs = (statistics.median(column) for column in zip(*times, strict=True))
    return Bar(
        what=what, bar=2, ratio=ours / theirs, ceiling=True, note=f"{ours:.3g} s / {theirs:.3g} s"
    )


def schedule_bar(what: str) -> Bar:
    """The check of the weights and its decision, in both programs."""
    few, many = (median_of(partial(certify, turns(count)), repeats=3) for count in (30, 100))
    return Bar(
        what=what, bar=3.6, ratio=many / few, ceiling=True, note=f"{many:.3g} s / {few:.3g} s"
    )


def turns(count: int) -> Problem:
    """Three agents, of whom one is not reached in each mode; the modes follow each other at
    random."""
    random = Random(count)
    sequence = ["A", "B", *(random.choice("AB") for _ in range(count - 3)), "B"]
    network = Network.from_arcs({"A": [[2, 1]], "B": [[3, 2]]}, arrow="listens_to", agents=3)
    switching = Switching(guarantee="sequence", dwell="1/10", sequence=sequence)
    return Problem(network=network, coupling="y", gains={1: 3}, switching=switching)


def median_of(function: Callable[[], Any], *, repeats: int, inner: int = 1) -> float:
    """Median CPU time of one call, s; ``inner`` calls make one sample."""
    function()
    samples = []
    for _ in range(repeats):
        start = time.process_time()
        for _ in range(inner):
            function()
        samples.append((time.process_time() - start) / inner)
    return statistics.median(samples)


def of_child(script: str) -> float:
    """CPU time, user and system, of a fresh interpreter that runs the script, s."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-c", script], check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def problem(n: int, arcs: Arcs) -> Problem:
    """The paper's coupling and exosystem; every tenth agent pinned."""
    return Problem(
        network=Network.from_arcs([(i + 1, j + 1) for i, j in arcs], arrow="listens_to", agents=n),
        coupling="exp(y) - 1 + y",
        gains=dict.fromkeys(range(1, n + 1, 10), 5),
        exosystem=EXOSYSTEM,
    )


def cycle(n: int) -> Arcs:
    return [(i, (i + 1) % n) for i in range(n)]


def complete(n: int) -> Arcs:
    return [(i, j) for i in range(n) for j in range(n) if i != j]


def random_balanced(n: int, *, degree: int = 4) -> Arcs:
    """Cycles through all agents in random orders: as many arcs in as out, hence Lambda < 0 with few
    pins."""
    r = Random(n)
    found: set[tuple[int, int]] = set()
    for _ in range(degree):
        order = r.sample(range(n), n)
        found |= {(order[k - 1], order[k]) for k in range(n)}
    return sorted(found)


if __name__ == "__main__":
    main()
