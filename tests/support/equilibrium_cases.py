"""Problems with equilibria beside the target, and the equilibria from outside: closed forms and
mpmath at 50 digits."""

from fractions import Fraction
from random import Random
from typing import Any

import mpmath
from random_couplings import exact

from dobc_design import Network, Problem

FOLDED = "y - 3/2*max(0, y - 1) - 3/2*min(0, y + 1)"  # rises to 1 at y = 1, falls to 0 at y = 3


def listening_pair(
    h: Any = "sin(y)", *, gains: Any = "1/10", target: Any = 0, reach: Any = 5, **more: Any
) -> Problem:
    """Two agents that listen to each other."""
    network = Network.from_arcs([[1, 2], [2, 1]], arrow="listens_to", agents=2)
    region = (
        None
        if reach is None
        else {"initial_states": reach if isinstance(reach, list) else [-reach, reach]}
    )
    return Problem(network=network, coupling=h, gains=gains, target=target, region=region, **more)


def half_difference(guess: float, k: float = 0.1) -> Fraction:
    """e_2 = -e_1 = y/2 with 2 sin y + k y = 0 near ``guess``: both agents of the pair pinned with
    k."""
    with mpmath.workdps(50):
        y = mpmath.findroot(lambda y: 2 * mpmath.sin(y) + mpmath.mpf(k) * y, guess)
        return exact(y / 2)


def random_folded(seed: int, *, m: int = 1, exceptions: bool = True) -> Problem:
    """Weights, an arc with a coupling of its own, matrix gains for m > 1, offsets."""
    r = Random(f"equilibria {seed} {m}")
    n = r.randint(2, 5)
    arcs = [
        [i, j, r.choice((1, "1/2", 2))]
        for i in range(1, n + 1)
        for j in range(1, n + 1)
        if i != j and (j == i % n + 1 or r.random() < 0.4)
    ]
    network = Network.from_arcs(arcs, arrow="listens_to", agents=n)
    h: Any = r.choice(("sin(y)", FOLDED, "y*exp(1 - y**2)", "clip(y, -1, 1)", "exp(y) - 1 + y"))
    if m > 1 and r.random() < 0.5:
        h = [f"sin(y{c + 1}) + y{(c + 1) % m + 1}/4" for c in range(m)]
    gains: Any = {i: r.choice(("1/10", "1/2", 3)) for i in range(1, n + 1) if r.random() < 0.7}
    if m > 1:
        gains = {
            i: [
                [k if c == d else ("1/20" if d > c else "-1/20") for d in range(m)]
                for c in range(m)
            ]
            for i, k in gains.items()
        }
    listener, speaker = int(network.modes["G"].listeners[0]), int(network.modes["G"].speakers[0])
    other = {(listener, speaker): "tanh(2*y)"} if exceptions else None
    offsets = {1: [r.randint(-2, 2) for _ in range(m)]}
    return Problem(
        network=network,
        coupling=h,
        exceptions=other,
        gains=gains,
        target=[1] * m,
        offsets=offsets,
        region={"initial_states": [-9, 9]},
    )
