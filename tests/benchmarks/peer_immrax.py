"""immrax on directed cycles, two ways.  Called by ``peers.py``; needs immrax.

Mean value: the largest box on which the natural inclusion of the Jacobian keeps J + J' < 0, so that
V = e'e decreases (theory, section 1); the interval matrix by its centre and the norm of its radii.
Embedding: the largest box whose trajectory of the embedding system shrinks to a hundredth of it.
Both in double precision without outward rounding, the second by Runge-Kutta steps: no proofs.
"""

import json
import os
import sys
from collections.abc import Callable
from functools import partial
from typing import Any

os.environ["JAX_PLATFORMS"] = "cpu"

import immrax
import jax
import jax.numpy as jnp
import numpy as np

STEPS = 10
SHRUNK, HORIZON, STEP = 0.01, 40.0, 0.01  # of the box; s; s
COUPLINGS: dict[str, Callable[[Any], Any]] = {
    "exp(y) - 1 + y": lambda y: jnp.exp(y) - 1 + y,
    "y + y**3": lambda y: y + y**3,
}


class Cycle(immrax.System):
    def __init__(self, n: int, coupling: str, gains: Any) -> None:
        self.evolution = "continuous"
        self.xlen = n
        self.h, self.gains = COUPLINGS[coupling], jnp.array(gains)

    def f(self, t: Any, x: Any) -> Any:
        return self.h(jnp.concatenate((x[1:], x[:1])) - x) - self.gains * x


def decreases(system: Cycle, radius: float) -> bool:
    sides = radius * jnp.ones(system.xlen)
    J = immrax.natif(jax.jacfwd(lambda x: system.f(0.0, x)))(immrax.interval(-sides, sides))
    low = np.asarray(J.lower)
    high = np.asarray(J.upper)
    centre = (low + high) / 2
    spread = (high - low) / 2
    return bool(
        np.linalg.eigvalsh(centre + centre.T)[-1] + np.linalg.norm(spread + spread.T, 2) < 0
    )


def shrinks(system: Cycle, radius: float) -> bool:
    sides = radius * jnp.ones(system.xlen)
    start = immrax.i2ut(immrax.interval(-sides, sides))
    path = np.asarray(immrax.natemb(system).compute_trajectory(0.0, HORIZON, start, dt=STEP).ys)
    seen = path[np.all(np.isfinite(path), axis=1)]
    return bool(np.min(np.max(np.abs(seen), axis=1)) <= SHRUNK * radius)


def largest(holds: Callable[[float], bool], limit: float) -> float:
    if holds(limit):
        return limit
    low, high = 0.0, limit
    for _ in range(STEPS):
        middle = (low + high) / 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    n, coupling, pinned, gain, limit = sys.argv[1:]
    cycle = Cycle(
        int(n), coupling, [float(gain) if i < int(pinned) else 0.0 for i in range(int(n))]
    )
    tests = (decreases, shrinks)
    print(json.dumps([largest(partial(holds, cycle), float(limit)) for holds in tests]))
