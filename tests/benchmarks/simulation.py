"""Rows of `make bench` on simulation.  Ratios of CPU times from one run; the peak memory of a fresh
process."""

import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import scipy.sparse as sp
from simulated_runs import simulate, simulate_many

from dobc_design import Exosystem, Network, Observer, Problem, Stress, load_problem
from dobc_design.loop.arrays import error_arcs
from dobc_design.loop.make import loop_of
from dobc_design.simulation.field import make_closed_loop, network_of
from dobc_design.simulation.signals import RandomDwell

DEGREE = 6
RUNS, ALONE = 1000, 25  # runs side by side; runs one by one that are timed and scaled up
MEMORY = """
import resource, sys
sys.path[:0] = [{folder!r}, {support!r}]
from simulation import large
from simulated_runs import simulate_many
from dobc_design.simulation.signals import Periodic
many = simulate_many(large(1000, modes=2), runs=1000, signal=Periodic(dwell=0.25), t_final=1.0)
assert len(many) == 1000 and not many.diverged.any()
try:  # not ru_maxrss: a child keeps that of the process it was started from
    lines = open("/proc/self/status")
    peak = next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) * 1024
except OSError:
    unit = 1 if sys.platform == "darwin" else 1024
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
print(peak)
"""


def large(n: int, *, modes: int = 1) -> Problem:
    """The paper's coupling, exosystem and W on digraphs of degree 6; every tenth agent pinned."""
    rng = np.random.default_rng(n)

    def graph() -> Any:
        listeners = np.repeat(np.arange(n), DEGREE)
        speakers = (listeners + rng.integers(1, n, size=DEGREE * n)) % n
        return sp.coo_array((np.ones(DEGREE * n), (listeners, speakers)), shape=(n, n))

    return Problem(
        network=Network.from_sparse({f"G{k}": graph() for k in range(modes)}, arrow="listens_to"),
        coupling="exp(y) - 1 + y",
        gains=dict.fromkeys(range(1, n + 1, 10), 5),
        exosystem=Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]]),
        observer=Observer(W=[["16/5"], ["12/5"]]),
    )


def simulation_bars() -> Iterator[dict[str, Any]]:
    """The arguments of the bars."""
    yield stacked(None, "runs with 20 draws of the mode", bar=30)
    noisy = "under noise and loss"
    yield stacked(Stress(period=0.05, noise=0.05, loss=0.1), f"sampled runs {noisy}", bar=10)
    yield stacked(Stress(saturation=4.0, noise=0.05, loss=0.1), f"continuous runs {noisy}", bar=10)
    yield right_hand_side()
    yield memory()


def stacked(stress: Stress | None, what: str, *, bar: float) -> dict[str, Any]:
    """The same samples, tolerance and random numbers side by side and one by one; errors of all
    runs are compared."""
    problem = load_problem("paper-switching")
    signal = RandomDwell(dwell=0.5)
    given: dict[str, Any] = {"signal": signal, "t_final": 10.0, "stress": stress}
    slow = stress is not None and stress.period is None  # such runs take their time one by one
    together, many = cpu(
        lambda: simulate_many(problem, runs=RUNS, **given), repeats=1 if slow else 3
    )
    count = 5 if slow else ALONE
    single, runs = cpu(
        lambda: [simulate(problem, seed=k, **given) for k in range(count)], repeats=1
    )
    apart = max(
        float(np.nanmax(np.abs(run.error() - many.error[k, : len(run)])))
        for k, run in enumerate(runs)
    )
    alone = single * RUNS / count
    return {
        "what": f"1000 {what} of n = 10, stacked vs one by one",
        "bar": bar,
        "ratio": alone / together,
        "note": f"{alone:.3g} s / {together:.3g} s; errors {apart:.0e} apart",
    }


def right_hand_side() -> dict[str, Any]:
    """h(e) - K e + C eps against copying what it reads once: states, arc arrays, weights."""
    problem = large(100_000)
    loop = make_closed_loop(problem, None)
    groups = error_arcs(loop_of(problem), "G0")
    network = network_of(loop, groups)
    eps = np.zeros((problem.n, problem.q))
    e = np.random.default_rng(0).normal(size=problem.n)
    arrays = [
        e,
        eps,
        *(a for group in groups for a in (group.listeners, group.speakers, group.weights)),
    ]
    weights = np.array([[1.0, 0.5]])

    def derivative() -> Any:
        result = network(e)
        result.reshape(problem.n, 1)[...] += eps @ weights.T
        return result

    places = [np.zeros_like(a) for a in arrays]  # in use already, so that no page has to be fetched

    def copy() -> None:
        for place, array in zip(places, arrays, strict=True):
            np.copyto(place, array)

    # in turns
    pairs = [(cpu(derivative, repeats=1)[0], cpu(copy, repeats=1)[0]) for _ in range(102)][2:]
    ours, copying = (statistics.median(column) for column in zip(*pairs, strict=True))
    return {
        "what": "right-hand side at n = 1e5, degree 6, vs copying states, arcs, weights",
        "bar": 3,
        "ceiling": True,
        "ratio": ours / copying,
        "note": f"{1e3 * ours:.3g} ms / {1e3 * copying:.3g} ms",
    }


def memory() -> dict[str, Any]:
    """Peak resident memory in GiB stands in for the ratio."""
    from pathlib import Path

    script = MEMORY.format(
        folder=str(own := Path(__file__).parent), support=str(own.parent / "support")
    )
    done = subprocess.run(
        [sys.executable, "-c", script], check=True, capture_output=True, text=True
    )
    peak = int(done.stdout) / 2**30
    return {
        "what": "peak memory of 1000 runs at n = 1000, two modes, in GiB",
        "bar": 2,
        "ratio": peak,
        "ceiling": True,
        "note": "GiB, not a ratio",
    }


def cpu(function: Callable[[], Any], *, repeats: int) -> tuple[float, Any]:
    """Median CPU time of a call in s, and what the last one returned."""
    samples = []
    result = None
    for _ in range(repeats + (repeats > 1)):
        begin = time.process_time()
        result = function()
        samples.append(time.process_time() - begin)
    return statistics.median(samples[1:] or samples), result
