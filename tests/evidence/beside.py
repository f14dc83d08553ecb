"""Signals that keep a guarantee, beside other methods: the last two tables of docs/comparison.md,
as Markdown.

immrax (embedding, half a ring at a time) runs by the Python that PEERS_PYTHON names; where it is
not installed that table says so.  Products of exact flows bound the joint spectral radius of linear
agents with a fixed dwell time.
"""

import json
import math
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from itertools import product
from typing import Any

import numpy as np
from certified import settling_alone
from networks import network_of
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from dobc_design import Problem, Switching, certify

PERIODS = (1, 2, 4, 8)  # of 2 s
GAIN, RADIUS = 5.0, 4.0
STEPS, ACCURACY = (0.05, 0.01), 1e-12  # s; of the true run, as a part
LENGTHS = (4, 8, 12)  # of products
EMBEDDED = """
import os, sys, json, time
os.environ["JAX_PLATFORMS"] = "cpu"
import immrax, jax, jax.numpy as jnp
from importlib.metadata import version
jax.config.update("jax_enable_x64", True)

class Half(immrax.System):
    def __init__(self, place):
        self.evolution, self.xlen = "continuous", 10
        self.on = jnp.array([float(i % 2 == place) for i in range(10)])
        self.gains = jnp.array([5.0 if i in (0, 5) else 0.0 for i in range(10)])
    def f(self, t, x):
        y = jnp.concatenate((x[1:], x[:1])) - x
        return self.on * (jnp.exp(y) - 1 + y) - self.gains * x

halves = [immrax.natemb(Half(0)), immrax.natemb(Half(1))]
def follow():
    box, found = immrax.i2ut(immrax.interval(-4 * jnp.ones(10), 4 * jnp.ones(10))), []
    for k in range(16):
        path = halves[k % 2].compute_trajectory(0.0, 1.0, box, dt=STEP)
        box = path.ys[jnp.isfinite(path.ts).sum() - 1]
        found.append(box[10:].tolist())
    return found
follow()
start = time.process_time()
boxes = follow()
print(json.dumps([version("immrax"), time.process_time() - start, boxes]))
"""


def tables() -> Iterator[str]:
    yield from boxes_table()
    yield ""
    yield from products_table()


def half_a_ring() -> Problem:
    """Agent i hears i + 1 on a ring of 10, odd agents for 1 s, then even ones."""
    ring = [[i, i % 10 + 1] for i in range(1, 11)]
    halves = {"odd": ring[::2], "even": ring[1::2]}
    return Problem(
        network=network_of(halves, 10),
        coupling="exp(y) - 1 + y",
        gains={1: 5, 6: 5},
        switching=Switching(guarantee="sequence", sequence=["odd", "even"], dwell=1),
    )


def boxes_table() -> Iterator[str]:
    """Largest bounds at the ends of periods, and the largest part by which a corner lies inside the
    exact box, whose corner is a run: couplings rise."""
    start = time.process_time()
    settling = settling_alone(half_a_ring(), radius=RADIUS, tolerance="1/25")
    ours = time.process_time() - start
    true = corner_run()
    theirs = {step: embedded(step) for step in STEPS}
    heads = [f"immrax, step {step:g} s" for step in theirs]
    yield f"| periods of 2 s | true box | certified | {' | '.join(heads)} |"
    yield "|---" * (3 + len(theirs)) + "|"
    for k in PERIODS:
        cells = [f"{true[2 * k - 1].max():.6f}", f"{settling.envelope(2 * k):.6f}"]
        for found in theirs.values():
            box = None if found is None else np.array(found[2][2 * k - 1])
            cells.append(
                "not installed" if box is None else f"{box.max():.6f}{_short(box, true[2 * k - 1])}"
            )
        yield f"| {k} | {' | '.join(cells)} |"
    times = ["-" if each is None else f"{each[1]:.2f}" for each in theirs.values()]
    yield f"| CPU s | | {ours:.1f} | {' | '.join(times)} |"


def _short(box: Any, true: Any) -> str:
    short = float(np.max((true - box) / true))
    return f", too small by {short:.0e}" if short > ACCURACY else ""


def corner_run() -> list[Any]:
    e = np.full(10, RADIUS)
    found = []
    gains = np.where(np.arange(10) % 5 == 0, GAIN, 0.0)
    for k in range(2 * PERIODS[-1]):
        on = np.arange(10) % 2 == k % 2

        def slope(_: float, x: Any, on: Any = on) -> Any:
            y = np.roll(x, -1) - x
            return np.where(on, np.expm1(y) + y, 0.0) - gains * x

        e = solve_ivp(slope, (0.0, 1.0), e, "DOP853", rtol=2.3e-14, atol=1e-18).y[:, -1]
        found.append(e)
    return found


def embedded(step: float) -> Any:
    call = [
        os.environ.get("PEERS_PYTHON", sys.executable),
        "-c",
        EMBEDDED.replace("STEP", repr(step)),
    ]
    answer = subprocess.run(call, capture_output=True, text=True, check=False)
    if answer.returncode == 0:
        return json.loads(answer.stdout.splitlines()[-1])
    return None


def products_table() -> Iterator[str]:
    """Rates (1/s) for every order of three modes of 1 s each, none twice in a row."""
    heads = " | ".join(f"products of {length}, max norm" for length in LENGTHS)
    yield (
        f"| n | slowest order found | certified | {heads} | s: certify, products of {LENGTHS[-1]} |"
    )
    yield "|---" * (4 + len(LENGTHS)) + "|"
    for n in range(3, 11):
        modes = {k: [(i, i - 1) for i in range(2, n + 1) if i % 3 != k] for k in range(3)}
        network = network_of({"ABC"[k]: arcs for k, arcs in modes.items()}, n)
        turns = Switching(guarantee="dwell", dwell=1, longest=1)
        start = time.process_time()
        found = certify(Problem(network=network, coupling="y", gains={1: 1}, switching=turns))
        ours = time.process_time() - start
        flows = [expm(jacobian(n, arcs)) for arcs in modes.values()]
        start = time.process_time()
        norms, slowest = bounds(flows)
        theirs = time.process_time() - start
        rate = "-" if found.rate is None else f"{float(found.rate):.4f}"
        cells = [
            f"{slowest:.4f}",
            rate,
            *(f"{max(0.0, norms[k]):.4f}" for k in LENGTHS),
            f"{ours:.1f}, {theirs:.2f}",
        ]
        yield f"| {n} | {' | '.join(cells)} |"


def jacobian(n: int, arcs: list[tuple[int, int]]) -> Any:
    M = np.diag([-1.0, *[0.0] * (n - 1)])
    for i, j in arcs:
        M[i - 1, [i - 1, j - 1]] += -1.0, 1.0
    return M


def bounds(flows: list[Any]) -> tuple[dict[int, float], float]:
    """By length, the rate that the largest norm of all products gives (proved but for rounding);
    the slowest closed order, which none can beat."""
    norms = dict[int, float]()
    slowest = math.inf
    products = {(k,): each for k, each in enumerate(flows)}
    for length in range(1, LENGTHS[-1] + 1):
        norms[length] = (
            -math.log(max(np.abs(each).sum(axis=1).max() for each in products.values())) / length
        )
        closed = [each for word, each in products.items() if word[0] != word[-1]]
        sizes = [np.abs(np.linalg.eigvals(each)).max() for each in closed]
        slowest = min([slowest, *(-math.log(size) / length for size in sizes)])
        products = {
            (*w, k): flows[k] @ products[w]
            for w, k in product(products, range(len(flows)))
            if w[-1] != k
        }
    return norms, slowest


if __name__ == "__main__":
    for line in tables():
        sys.stdout.write(line + "\n")
