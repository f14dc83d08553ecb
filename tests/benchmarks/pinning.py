"""Rows of `make bench` on pinning gains: the closed form against the semidefinite program, and a
large network."""

import time
from collections.abc import Callable, Iterator
from random import Random
from typing import Any

import cvxpy as cp
import numpy as np
from simulation import cpu

import dobc_design as dd
from dobc_design import Network, Problem
from dobc_design.conditions.consensus.pinning import (
    for_rate,
    network_blocks,
    smallest_gains,
    solve_program,
    solve_shared,
)
from dobc_design.loop.make import loop_of

RATE = 0.1
LARGE = 100_000


def digraph(n: int, *, degree: int = 4) -> Problem:
    """A random digraph; every agent hears about ``degree`` others."""
    r = Random(n)
    pairs = {(i, r.randint(1, n)) for i in range(1, n + 1) for _ in range(degree)}
    arcs = sorted((i, j) for i, j in pairs if i != j)
    return Problem(
        network=Network.from_arcs(arcs, arrow="listens_to", agents=n), coupling="exp(y) - 1 + y"
    )


def digraphs(n: int, *, modes: int = 4, degree: int = 4) -> Problem:
    """Random digraphs on the same agents; in each every agent hears its follower on a cycle and
    some others."""
    r = Random(n)
    found = {}
    for mode in range(modes):
        pairs = {(i, i % n + 1) for i in range(1, n + 1)}
        pairs |= {(i, r.randint(1, n)) for i in range(1, n + 1) for _ in range(degree - 1)}
        found[f"G{mode}"] = sorted((i, j) for i, j in pairs if i != j)
    return Problem(network=Network.from_arcs(found, arrow="listens_to", agents=n), coupling="y")


def pinning_bars() -> Iterator[dict[str, Any]]:
    """The arguments of the bar: both from the blocks of a problem to the gains, every other agent
    allowed."""
    n = 100
    blocks = for_rate(network_blocks(loop_of(digraph(n))), RATE)
    allowed = list(range(0, n, 2))

    def by_program() -> float:
        gains = cp.Variable(len(allowed), nonneg=True)
        place = np.zeros((n, len(allowed)))
        place[allowed, np.arange(len(allowed))] = 1
        limit = blocks.tables[0].toarray() + 2 * cp.diag(place @ gains) >> 0
        program = cp.Problem(cp.Minimize(cp.sum(gains)), [limit])
        program.solve(solver=cp.CLARABEL)
        return float(program.value)

    def by_formula() -> float:
        return float(np.sum(smallest_gains(blocks, allowed)))

    what = "smallest pinning gains, closed form vs SDP (cvxpy, Clarabel), n = 100"
    yield _bar(what, 30, by_program, by_formula, repeats=(3, 21))
    yield _shared_bar()


def _shared_bar() -> dict[str, Any]:
    """Four modes that share their gains: both from the blocks to the gains, two agents of three
    allowed."""
    n = 60
    blocks = for_rate(network_blocks(loop_of(digraphs(n))), RATE)
    chosen = np.arange(n) % 3 > 0
    costs = np.ones(n)

    def by_program() -> float:
        return float(solve_program(blocks, np.flatnonzero(chosen), costs).gains.sum())

    def by_dual() -> float:
        return float(solve_shared(blocks.tables, chosen, costs).gains.sum())

    what = "gains shared by four modes, dual vs SDP (Clarabel directly), n = 60"
    return _bar(what, 5, by_program, by_dual, repeats=(1, 5))


def _bar(
    what: str,
    bar: float,
    slow: Callable[[], float],
    fast: Callable[[], float],
    *,
    repeats: tuple[int, int],
) -> dict[str, Any]:
    (long, other), (short, own) = (
        cpu(each, repeats=n) for each, n in zip((slow, fast), repeats, strict=True)
    )
    note = f"{long:.3g} s / {1e3 * short:.3g} ms; optima {abs(other - own) / own:.0e} apart"
    return {"what": what, "bar": bar, "ratio": long / short, "note": note}


def shared_design() -> str:
    """One line: a thousand agents in four modes, gains and proofs; and the pins of three thousand
    agents."""
    n, many = 1000, 3000
    problem = digraphs(n)
    before = time.process_time()
    design = dd.design_pinning(
        problem,
        rate=str(RATE),
        allowed=[i + 1 for i in range(n) if i % 3],
        digits=6,
        conservative=True,
    )
    middle = time.process_time()
    few = dd.design_pinning(digraph(many), rate=str(RATE), pins=many // 5, conservative=True)
    after = time.process_time()
    return (
        f"Pinning design, n = {n}, four modes: {middle - before:.2g} s with everything "
        f"proved ({design.verdict.value},"
        f" gap {design.gap:.1e}); at most {many // 5} pins among {many} agents: "
        f"{after - middle:.2g} s"
        f" ({few.verdict.value}, gap {few.gap:.1e}); CPU time"
    )


def large_design() -> str:
    """One line: gains for 1e5 agents, and the whole design with its exact proofs."""
    problem = digraph(LARGE)
    allowed = range(0, LARGE, 2)
    before = time.process_time()
    gains = smallest_gains(for_rate(network_blocks(loop_of(problem)), RATE), allowed)
    middle = time.process_time()
    design = dd.design_pinning(
        problem, rate=str(RATE), allowed=[i + 1 for i in allowed], conservative=True
    )
    after = time.process_time()
    return (
        f"Pinning design, n = {LARGE}, {len(problem.network.modes['G'])} arcs, half of the "
        "agents allowed: gains in"
        f" {middle - before:.2g} s ({int(np.count_nonzero(gains))} pins), with everything "
        f"proved {after - middle:.3g} s"
        f" ({design.verdict.value}, gap {design.gap:.1e}); CPU time"
    )
