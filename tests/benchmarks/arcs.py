"""Arc-wise certificates in `make bench`: their time beside the Lur'e ball, how it grows with the
agents, and the regions of real networks beside those of the other methods.

    python tests/benchmarks/arcs.py

prints the tables that `docs/comparison.md` holds.  Grids need pandapower.
"""

import resource
import sys
import time
from collections.abc import Callable, Iterator
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path.append(str(Path(__file__).resolve().parents[1] / "support"))

import numpy as np
from arc_wise import searched
from large import GAIN, LOOSE_DEGREE, _first_agents, geometric, grid
from scipy import sparse as sp
from simulation import cpu

import dobc_design as dd
from dobc_design import Check, Network, Problem
from dobc_design.conditions.arcs.claim import ArcWise
from dobc_design.conditions.arcs.decide import why_not
from dobc_design.conditions.arcs.propose import Search
from dobc_design.conditions.coverage import read_region
from dobc_design.conditions.domain import NEAR_TARGET
from dobc_design.conditions.quadratic.stage import quadratic_stage
from dobc_design.conditions.separable.stage import separable_stage
from dobc_design.exact.symmetric import Doubles
from dobc_design.exact.work import WorkLimitError
from dobc_design.loop.loop import Loop
from dobc_design.loop.make import loop_of

SIZES = (100, 1000, 10_000, 20_000, 100_000)
RADII = (1.0, 0.9, 0.7, 0.5)
GROWS = (10_000, 20_000)
PIN = 10  # 1/s, of generators and of both ends of what pushes apart
CASES = ("case14", "case118", "case300")
DREAL = {2: 2.88, 3: 2.63, 4: 2.5}  # 4.21, sin(y), V = e'e
RANGE = "y*exp(-y**2)"  # opinions that are too far apart hardly matter


def arc_bars() -> Iterator[dict[str, Any]]:
    """Lur'e over arc-wise of a cycle of ten; deciding twice as many agents."""
    problem = cycle(10, "exp(y) - 1 + y")
    slow, fast = (cpu(partial(found, problem), repeats=3)[0] for found in (lure, searched))
    radii = [f"{reach(found(problem)):.3g}" for found in (lure, searched)]
    yield {
        "what": "the largest ball of a cycle of 10, Lur'e vs arc-wise",
        "bar": 0.5,
        "ratio": slow / fast,
        "note": f"{slow:.3g} s / {fast:.3g} s; balls {radii[0]} / {radii[1]}",
    }
    half, whole = (decided(n)["decide"] for n in GROWS)
    yield {
        "what": "deciding an arc-wise claim of a geometric network, 2e4 agents vs 1e4",
        "bar": 2.4,
        "ratio": whole / half,
        "note": f"{whole:.3g} s / {half:.3g} s",
    }


def cycle(n: int, h: str) -> Problem:
    arcs = [[i, i % n + 1] for i in range(1, n + 1)]
    network = Network.from_arcs(arcs, arrow="listens_to", agents=n)
    return Problem(network=network, coupling=h, gains={1: GAIN})


def lure(problem: Problem) -> Check:
    """The quadratic stage alone."""
    return _stage(quadratic_stage, problem)


def separable(problem: Problem) -> Check:
    """The max-separable stage alone."""
    return _stage(separable_stage, problem)


def _stage(stage: Callable[..., list[Check]], problem: Problem) -> Check:
    asked = read_region(loop_of(problem), None, domain=NEAR_TARGET, everything=True)
    return stage(asked, lambda text: None)[0]


def reach(check: Check) -> float:
    """The radius of a proved check, 0 without one."""
    return float(check.domain.radius) if check.is_proved else 0.0


def sine_rows() -> Iterator[str]:
    """Directed cycles with one pin beside dReal's radii for V = e'e."""
    yield "| n | box, max-separable | ball, arc-wise | ball, Lur'e | dReal, V = e'e |"
    yield "|---" * 5 + "|"
    for n in (2, 3, 4, 6, 10):
        problem = cycle(n, "sin(y)")
        ours = [shown(reach(found(problem))) for found in (separable, searched, lure)]
        quoted = DREAL.get(n)
        yield f"| {n} | {' | '.join(ours)} | {'-' if quoted is None else shown(quoted)} |"


# --- How it grows
def sines(n: int) -> Problem:
    """A geometric network of some 7 n arcs, one agent in ten pinned, h = sin(y)."""
    listeners, speakers = geometric(n, degree=LOOSE_DEGREE)
    graph = sp.csr_array((np.ones(len(listeners)), (listeners, speakers)), shape=(n, n))
    chosen = np.random.default_rng(n).choice(n, n // 10, replace=False).tolist()
    pinned = sorted(set(chosen) | set(_first_agents(graph)))
    return Problem(
        network=Network.from_sparse({"G": graph}, arrow="listens_to"),
        coupling="sin(y)",
        gains={i + 1: GAIN for i in pinned},
    )


def decided(n: int) -> dict[str, float]:
    """CPU s to find and to decide the first claim that is proved, for balls from 1 down."""
    loop = loop_of(sines(n))
    for radius in RADII:
        start = time.process_time()
        claim = next(ones(loop).claims(radius**2), None)
        found = time.process_time()
        if claim is not None and why_not(loop, claim) is None:
            times = {"find": found - start, "decide": time.process_time() - found}
            arcs = len(loop.modes["G"])
            return {"arcs": arcs, "rate": float(claim.rate), "radius": radius} | times
    raise RuntimeError(f"n = {n}: no claim is proved.")


def ones(loop: Loop) -> Search:
    """For V = e'e."""
    d = Doubles(np.ones(loop.n))
    return Search(loop=loop, W=None, d=d, disturbance=Fraction(0), known={})


def growth_rows() -> Iterator[str]:
    """The table of sizes; memory is that of this process so far."""
    yield "| n | arcs | ball | rate, 1/s | CPU s to find | CPU s to decide | peak memory, MB |"
    yield "|---" * 7 + "|"
    for n in SIZES:
        row = decided(n)
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
        size = f"{n} | {row['arcs']:.0f} | {row['radius']:.2f} | {row['rate']:.2g}"
        yield f"| {size} | {row['find']:.2f} | {row['decide']:.2f} | {peak} |"


# --- Real networks
def networks() -> Iterator[tuple[str, Problem]]:
    try:
        import pandapower.networks as grids
    except ImportError:
        grids = None
    for name in CASES if grids else ():
        problem = dd.from_pandapower(getattr(grids, name)(), gain=PIN)
        apart = sorted({i for pair in problem.exceptions for i in pair})
        pins = {problem.network.labels[i]: PIN for i in {*problem.pinning.gains, *apart}}
        more = ", 1 negative" if apart else ""
        yield f"IEEE {name[4:]}{more}", problem.replace(exosystem=None, observer=None, gains=pins)
    yield "a grid as large as that of the western US", grid(4941, 6594).replace(region=None)
    yield "Kuramoto, all to all", complete(20, "sin(y)/20")
    yield "opinions of a range", complete(20, f"{RANGE}/20")
    yield "y + sin(3 y) on a cycle", cycle(10, "y + sin(3*y)")


def complete(n: int, h: str) -> Problem:
    """One agent in five is pinned with 1."""
    arcs = [[i, j] for i in range(1, n + 1) for j in range(1, n + 1) if i != j]
    network = Network.from_arcs(arcs, arrow="listens_to", agents=n)
    return Problem(network=network, coupling=h, gains=dict.fromkeys(range(1, n + 1, 5), 1))


def network_rows() -> Iterator[str]:
    yield (
        "| network | agents | arcs | box, max-separable | ball, arc-wise | box in it | "
        "ball, Lur'e | CPU s of each |"
    )
    yield "|---" * 8 + "|"
    for name, problem in networks():
        cells = []
        seconds = []
        for found in (separable, searched, lure):
            start = time.process_time()
            try:
                check = found(problem)
            except WorkLimitError:
                check = None
            seconds.append(f"{time.process_time() - start:.1f}")
            cells.append(shown(0.0 if check is None else reach(check)))
            if check is not None and isinstance(check.claim, ArcWise):
                total = problem.m * sum(map(float, check.claim.d))
                cells.append(shown((float(check.claim.level) / total) ** 0.5))
            elif found is searched:
                cells.append("-")
        arcs = sum(map(len, problem.network.modes.values()))
        case = [name, str(problem.n), str(arcs)]
        yield f"| {' | '.join([*case, *cells, ', '.join(seconds)])} |"


def shown(radius: float) -> str:
    """Two decimals, down; where nothing larger was tried it says so."""
    if radius >= 10:
        return ">= 10"
    return f"{int(radius * 100 + 1e-9) / 100:.2f}" if radius else "-"


if __name__ == "__main__":
    for table in (sine_rows, network_rows, growth_rows):
        for line in table():
            print(line, flush=True)
        print(flush=True)
