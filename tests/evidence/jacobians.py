"""dh/de by CasADi against finite differences, SymPy and the theorems' own J(0), with every allowed function.

Each problem has 2 to 4 agents, m = 1 or 2, weights and an arc with a coupling of its own; e is random, a
little away from where the couplings have kinks.
"""

from collections.abc import Iterable
from functools import cache
from random import Random
from typing import Any

import numpy as np
import sympy
from evidence.row import Row
from random_couplings import names

from dobc_design import Network, Problem
from dobc_design.conditions.consensus.claim import jacobians_at_consensus
from dobc_design.coupling.functions import FUNCTIONS
from dobc_design.model.model import build_model

# Smooth at 0 and defined on |y| <= 3, so that J(0) exists; with kinks elsewhere where a function has them.
_SMOOTH = (
    "exp(y) - 1; log(1 + y/9); sin(y) + y; 1 - cos(y) + y/2; tan(y/4); tanh(3*y); atan(y)/2; sinh(y); "
    "cosh(y) - 1 + 2*y; sqrt(4 + y) - 2; y*abs(y) + y; abs(y - 1) - 1 + 3*y; min(y, 1/2); max(-3/4, y); "
    "clip(2*y, -1, 1); y**3 - y/3; y/(2 + y**2); (1 + y**2)**(1/2) - 1; (1 + y/8)**-2 - 1; sin(pi*y)"
)
SCALAR = tuple(_SMOOTH.split("; "))
PLANE = (
    ("sin(y1) + y2**2", "3*y2 - y1*y2"),
    ("exp(y1 - y2) - 1", "tanh(y1) + y2"),
    ("y1*cos(y2)", "log(1 + y2/9) + abs(y1 - 1) - 1"),
    ("max(y1, y2/2 - 1)", "sqrt(4 + y1) - 2 + clip(y2, -1, 1)"),
    ("atan(y1*y2) + y1", "sinh(y2)/2 + min(y1, 1)"),
)
CLEARANCE = 1e-3  # from a kink, so that the finite differences stay on one side
STEP = 1e-6


def run(count: int, seed: int) -> Row:
    failures: list[str] = []
    worst = {"SymPy": 0.0, "finite differences": 0.0, "J(0)": 0.0}
    used: set[str] = set()
    for k in range(seed, seed + count):
        problem = _problem(k)
        used |= {name for name in FUNCTIONS for c in problem.couplings for text in c.texts if f"{name}(" in text}
        model = build_model(problem)
        e = _point(problem, Random(k))
        found = np.array(model.jacobian(e).full())
        zero = np.array(model.jacobian(np.zeros_like(e)).full())
        others = {
            "SymPy": (found, _symbolic(problem, e)),
            "finite differences": (found, _differences(model.h, e)),
            "J(0)": (zero, _stated(problem)),
        }
        for name, (own, other) in others.items():
            error = float(np.max(np.abs(own - other) / (1 + np.abs(other))))
            worst[name] = max(worst[name], error)
            if not error <= (2e-7 if name == "finite differences" else 1e-11):
                failures.append(f"seed {k}: {name} differs by {error:.1e}")
    missing = set(FUNCTIONS) - used
    if missing and count >= 100:
        failures.append(f"never used: {sorted(missing)}")
    sizes = ", ".join(f"{name} {error:.1e}" for name, error in worst.items())
    what = "dh/de: CasADi = SymPy = finite differences; at 0 = the pencil's J(0)"
    return Row(what, count, failures, [f"{len(used)} of {len(FUNCTIONS)} functions; worst: {sizes}"])


def _problem(seed: int) -> Problem:
    r = Random(seed)
    n, m = r.randint(2, 4), r.choice((1, 1, 2))
    pairs = [(i, j) for i in range(1, n + 1) for j in range(1, n + 1) if i != j and r.random() < 0.7] or [(1, 2)]
    arcs = [[i, j, r.choice((1, "1/2", 3.2))] for i, j in pairs]
    kinds: list[Any] = [*SCALAR, *(list(each) for each in PLANE * (4 if m == 2 else 0))]
    return Problem(
        network=Network.from_arcs(arcs, arrow="listens_to", agents=n),
        # Every function comes round in turn; the rest is left to chance.
        coupling=SCALAR[seed % len(SCALAR)] if m == 1 else r.choice(kinds),
        exceptions={(arcs[0][0] - 1, arcs[0][1] - 1): r.choice(kinds)},
        target=[0] * m,
    )


def _point(problem: Problem, r: Random) -> np.ndarray:
    """A random e at which no arc lies near a kink (they are at multiples of 1/4 apart from those of vectors)."""
    while True:
        e = np.array([r.uniform(-1.4, 1.4) for _ in range(problem.n * problem.m)])
        # Shifts small enough to change slopes by less than 0.1 unless there is a kink in between.
        shifts = [CLEARANCE * np.array([r.choice((-1, 1)) for _ in e]) for _ in range(8)]
        steps = [np.abs(_symbolic(problem, e + shift) - _symbolic(problem, e)) for shift in shifts]
        if max(float(np.max(step)) for step in steps) < 0.1:
            return e


def _assembled(problem: Problem, blocks: Iterable[tuple[int, int, np.ndarray]]) -> np.ndarray:
    """J from the slope of every arc (i, j)."""
    n, m = problem.n, problem.m
    J = np.zeros((n, m, n, m))
    for i, j, block in blocks:
        J[i, :, j] += block
        J[i, :, i] -= block
    return J.reshape(n * m, n * m)


def _symbolic(problem: Problem, e: np.ndarray) -> np.ndarray:
    """J from SymPy's partial derivatives, arc by arc."""
    z = e.reshape(problem.n, problem.m)

    def block(i: int, j: int, weight: Any) -> np.ndarray:
        partials = _partials(problem.coupling_of(i, j).texts, problem.m)
        return float(weight) * np.array([[float(f(*(z[j] - z[i]))) for f in row] for row in partials])

    arcs = next(iter(problem.network.modes.values()))
    return _assembled(problem, ((i, j, block(i, j, weight)) for i, j, weight in arcs))


@cache
def _partials(texts: tuple[str, ...], m: int) -> list[list[Any]]:
    y = sympy.symbols(f"y1:{m + 1}", real=True)
    own = names({f"y{c + 1}": y[c] for c in range(m)})
    by_component = len(texts) == 1
    h = [sympy.sympify(texts[0 if by_component else c], locals={**own, "y": y[c]}, rational=True) for c in range(m)]
    return [[sympy.lambdify(y, sympy.diff(each, v), "numpy") for v in y] for each in h]


def _differences(h: Any, e: np.ndarray) -> np.ndarray:
    """Central differences of h itself."""
    steps = STEP * np.eye(len(e))
    return np.array([np.ravel(h(e + step).full() - h(e - step).full()) for step in steps]).T / (2 * STEP)


def _stated(problem: Problem) -> np.ndarray:
    """J(0) as the theorems state it, the middle of each enclosure."""
    mode = jacobians_at_consensus(problem).modes[0]
    slopes = [np.array([[float((x.lo + x.hi) / 2) for x in row] for row in gains]) for gains in mode.gains]
    arcs = zip(mode.arcs, mode.kind.tolist(), strict=True)
    return _assembled(problem, ((i, j, slopes[kind]) for (i, j, _), kind in arcs))
