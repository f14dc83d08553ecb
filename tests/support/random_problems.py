"""Random problems of every kind the specification allows, the same ones for the same seed.

``random_problem(seed)``: m 1 to 3, q 0 to 4, 1 to 4 modes, weights, exceptions, formations, matrix
gains (skew and singular ones too), W absent, good or bad, P given, undetectable pairs, nobody
pinned, isolated agents, one agent, couplings with irrational slopes, with kinks, with negative
slopes, regions. ``random_linear_problem(seed)``: exactly linear couplings only.  No solver of the
package is used.
"""

import warnings
from collections.abc import Callable
from fractions import Fraction
from random import Random
from typing import Any

import numpy as np
from networks import floats, network_of, random_arcs
from scipy import linalg

from dobc_design import Exosystem, Observer, Problem

LINEAR = ("y", "2*y", "y/3", "5*y/2", "-y/8", "y*exp(1)", "pi*y/2")
CURVED = (
    "tanh(y)",
    "exp(y) - 1 + y",
    "y + y**3",
    "sin(y)",
    "atan(y)/2",
    "sinh(y)",
    "y**3",
    "y - y**2",
)
IRRATIONAL = ("sin(pi*y)", "exp(1)*(exp(y) - 1)", "tanh(sqrt(2)*y)", "log(1 + y*pi)")
KINKED = ("abs(y)", "clip(y, -1, 1)", "max(y, 2*y)")
PLANE_LINEAR = (
    ["y1 + y2/2", "y2 - y1/2"],
    ["y1", "y1 + y2"],
    ["2*y1 + y2", "y1 + y2"],
    ["y1*exp(1)", "y2 + y1/3"],
)
PLANE_CURVED = (["sin(y1) + y2**2", "3*y2"], ["y1 - y2/4", "tanh(y2) + sin(pi*y1)/5"])
SPACE_LINEAR = (["y1 + y2/3", "y2 - y1/3", "y3"], ["2*y1", "y2 + y3/2", "y3 - y2/2"])
WEIGHTS = ("1/2", 2, "1/3", 3.2, 5, "7/5")


def random_problem(seed: int) -> Problem:
    return _problem(Random(seed), linear=False)


def random_linear_problem(seed: int) -> Problem:
    """A problem with linear couplings, where a proof at the consensus is global."""
    return _problem(Random(seed), linear=True)


def _problem(r: Random, *, linear: bool) -> Problem:
    m = r.choice((1, 1, 1, 2, 2, 3))
    sizes = (1, 2, 2, 3, 3, 4, 5, 6)
    n = r.choice(sizes)
    named = r.random() < 0.3
    labels = [f"a{i}" for i in range(n)] if named else [str(i + 1) for i in range(n)]
    modes = {f"G{k}": _arcs(r, labels) for k in range(r.choice((1, 1, 1, 2, 3, 4)))}
    couplings = _couplings(m, linear=linear)
    exosystem = _exosystem(r, m) if r.random() < 0.75 else None
    pairs = {tuple(arc[:2]) for arcs in modes.values() for arc in arcs}
    every = sorted(pairs)
    special = r.sample(every, min(len(every), r.choice((0, 0, 1, 2)))) if every else []
    place = {label: i for i, label in enumerate(labels)}
    region: dict[str, Any] | None = None
    if r.random() < 0.3:
        starts = ([0, 5], [-1, 1], ["1/2", 2], [1, 1])
        region = {"initial_states": r.choice(starts)}
        if exosystem is not None:
            region["initial_disturbance"] = r.choice((0, 0.5, 3))
    given: dict[str, Any] = {"name": f"random-{r.randrange(10**9)}", "exosystem": exosystem}
    given["network"] = network_of(modes, labels)
    given["coupling"] = r.choice(couplings)
    given["exceptions"] = {(place[a], place[b]): r.choice(couplings) for a, b in special}
    given["target"] = [r.choice((0, 1, "1/2", -2)) for _ in range(m)]
    given["gains"] = _gains(r, labels, m)
    if exosystem is not None:
        given["observer"] = _observer(r, exosystem)
    offsets = {}
    for label in labels:
        if r.random() < 0.2:
            offsets[label] = [r.choice((0, 1, -1.5))] * m
    return Problem(**given, offsets=offsets, region=region)


def _drawn(rows: int, columns: int, draw: Callable[[], Any]) -> list[list[Any]]:
    """A matrix whose entries are drawn one by one."""
    return [[draw() for _ in range(columns)] for _ in range(rows)]


def _identity(m: int, k: Any) -> list[list[Any]]:
    found = []
    for i in range(m):
        found.append([k if i == j else 0 for j in range(m)])
    return found


def _couplings(m: int, *, linear: bool) -> list[Any]:
    own: list[Any] = [*LINEAR[:4], *LINEAR]
    by_width = {1: [], 2: list(PLANE_LINEAR), 3: list(SPACE_LINEAR)}
    vector: list[Any] = by_width[m]
    if linear:
        return own + vector
    kinks = KINKED[: 1 if m > 1 else 3]
    curved: list[Any] = [*CURVED, *CURVED, *IRRATIONAL, *kinks]
    return own + curved + vector * 3 + (list(PLANE_CURVED) if m == 2 else [])


def _arcs(r: Random, labels: list[str]) -> list[list[Any]]:
    n = len(labels)
    kind = r.choice(("random", "cycle", "path", "undirected", "empty" if n < 4 else "dense"))
    if kind == "cycle":
        pairs = [(i, (i + 1) % n) for i in range(n)] if n > 1 else []
    elif kind == "path":
        pairs = [(i + 1, i) for i in range(n - 1)]
    elif kind == "empty":
        pairs = []
    else:
        density = {"random": 0.4, "undirected": 0.4, "dense": 0.8}[kind]
        pairs = []
        for i, j in random_arcs(r, n, density):
            pairs.append((i - 1, j - 1))
        if kind == "undirected":
            backwards = [(j, i) for i, j in pairs]
            pairs = sorted({*pairs, *backwards})
    weighted = r.random() < 0.4
    arcs: list[list[Any]] = []
    for i, j in pairs:
        weight = [r.choice(WEIGHTS)] if weighted else []
        arcs.append([labels[i], labels[j], *weight])
    return arcs


def _gains(r: Random, labels: list[str], m: int) -> Any:
    kind = r.choice(("none", "one", "some", "all", "all", "number"))
    if kind == "none":
        return None
    if kind == "number":
        return r.choice((1, "9/16", 3, 10))
    chosen = labels
    if kind == "one":
        chosen = r.sample(labels, 1)
    elif kind == "some":
        chosen = r.sample(labels, max(1, len(labels) // 2))
    return {label: _gain(r, m) for label in chosen}


def _gain(r: Random, m: int) -> Any:
    numerators = r.choice((1, 2, 5, 10))
    denominators = (1, 1, 2, 3)
    k = Fraction(numerators, r.choice(denominators))
    kind = "number"
    if m > 1:
        kind = r.choice(("number", "number", "turned", "skew", "singular", "full"))
    if kind == "number":
        return k
    if kind == "singular":
        found = _identity(m, 0)
        found[0][0] = k
        return found
    s = Fraction(r.randint(-3, 3))
    turn = np.array(_identity(m, Fraction(0)))
    for i in range(m):
        turn[i, i + 1 :] += s
        turn[i, :i] -= s
    if kind == "full":  # a Gram matrix and a skew one: k + k' >= 0, not symmetric
        drawn = _drawn(m, m, lambda: r.randint(-2, 2))
        rows = np.array(drawn, dtype=object)
        return (turn + rows @ rows.T).tolist()
    if kind == "turned":
        turn = turn + np.array(_identity(m, k))
    return turn.tolist()


def _exosystem(r: Random, m: int) -> Exosystem:
    q = r.choice((1, 2, 2, 3, 4))
    w = r.choice((1, 2, "1/2"))
    A: list[list[Any]] = [[0] * q for _ in range(q)]
    kind = r.choice(("harmonic", "constant", "ramp", "random", "decaying", "hidden"))
    if kind == "harmonic":
        for i in range(0, q - 1, 2):
            A[i][i + 1], A[i + 1][i] = w, f"-{w}"
    elif kind == "ramp":
        for i in range(q - 1):
            A[i][i + 1] = 1
    elif kind in ("random", "decaying", "hidden"):
        A = _drawn(q, q, lambda: Fraction(r.randint(-4, 4), r.choice((1, 2))))
        if kind == "decaying":
            for i in range(q):
                A[i][i] -= 9
    C = _drawn(m, q, lambda: r.choice((0, 1, 1, -1, "1/2")))
    if kind == "hidden":  # the last state drives nothing that C sees: unobservable, stable or not
        for i in range(q - 1):
            A[i][q - 1] = 0
        ends = (-1, -3, 0, 1)
        A[q - 1][q - 1] = r.choice(ends)
        for row in C:
            row[q - 1] = 0
    return Exosystem(A=A, C=C)


def _observer(r: Random, exosystem: Exosystem) -> Observer:
    kind = r.choice(("none", "none", "good", "good", "bad", "rate"))
    if kind == "none":
        return Observer()
    if kind == "rate":
        return Observer(rate=r.choice(("1/10", 1, 2)))
    W = kalman_gain(exosystem) if kind == "good" else None
    if W is None:
        W = _drawn(exosystem.order, exosystem.outputs, lambda: r.randint(-3, 3))
    return Observer(W=W, P=_lyapunov_guess(r, exosystem, W) if r.random() < 0.6 else None)


def kalman_gain(exosystem: Exosystem) -> list[list[Fraction]] | None:
    """W of the steady Kalman filter with unit weights, to three decimals; None where SciPy finds
    none."""
    A = floats(exosystem.A)
    C = floats(exosystem.C)
    try:
        state_noise = np.eye(len(A))
        output_noise = np.eye(len(C))
        covariance = linalg.solve_continuous_are(A.T, C.T, state_noise, output_noise)
    except (linalg.LinAlgError, ValueError):
        return None
    return _to_three_decimals(covariance @ C.T)


def _to_three_decimals(M: np.ndarray) -> list[list[Fraction]]:
    found = []
    for row in M.tolist():
        found.append([Fraction(round(1000 * x), 1000) for x in row])
    return found


def _lyapunov_guess(r: Random, exosystem: Exosystem, W: list[list[Any]]) -> list[list[Fraction]]:
    """A P near a solution of the Lyapunov equation, at a random scale; sometimes any symmetric
    matrix."""
    q = exosystem.order
    error = floats(exosystem.A) - floats(W) @ floats(exosystem.C)
    P = np.eye(q)
    if r.random() < 0.8:
        try:
            # nearly singular equations are welcome here
            with warnings.catch_warnings(action="ignore"):
                P = linalg.solve_continuous_lyapunov(error.T, -np.eye(q))
        except linalg.LinAlgError:
            P = np.diag([1.0, -1.0, 2.0, 1.0][:q])
    symmetric = (P + P.T) / 2
    clipped = np.clip(symmetric, -1e6, 1e6)
    factor = r.choice((0.1, 1, 3, 30))
    P = clipped * factor
    return _to_three_decimals(P)


def badly_scaled_problem(seed: int) -> Problem:
    """Held networks with tiny or huge gains, and exosystems that numerical methods dislike (q up to
    8)."""
    r = Random(seed)
    m = r.choice((1, 1, 2))
    q = r.choice((1, 2, 3, 4, 5, 6, 8))
    kind = r.choice(("scaled", "defective", "hidden", "rotations", "integrators", "random"))
    A = [[Fraction(0)] * q for _ in range(q)]
    if kind == "scaled":
        A = _drawn(q, q, lambda: r.randint(-9, 9) * Fraction(10) ** r.randint(-6, 6))
    elif kind in ("defective", "integrators"):
        for i in range(q):
            if kind == "defective" and i == 0:
                first = r.choice((0, 1, -1))
                A[0][0] = Fraction(first)
            A[i][i] = A[0][0]
            if i + 1 < q:
                exponent = r.randint(-1, 1) if kind == "defective" else 0
                A[i][i + 1] = Fraction(10) ** exponent
    elif kind == "rotations":
        for i in range(0, q - 1, 2):
            digit = r.randint(1, 9)
            A[i][i + 1] = digit * Fraction(10) ** r.randint(-3, 3)
            A[i + 1][i] = -A[i][i + 1]
    else:
        A = _drawn(q, q, lambda: Fraction(r.randint(-4, 4)))
    exponent = r.randint(-4, 4) if kind == "scaled" else 0
    C = _drawn(m, q, lambda: r.randint(-3, 3) * Fraction(10) ** exponent)
    if kind == "hidden":  # unobservable and stable, perhaps barely
        for row in (*A[:-1], *C):
            row[q - 1] = Fraction(0)
        decay = Fraction(10) ** r.randint(-9, 3)
        A[q - 1][q - 1] = -decay
    n = r.choice((1, 2, 3))
    sizes = (1, 3, Fraction(1, 10**9), Fraction(1, 10**6), 10**6)
    k = r.choice(sizes)
    network = network_of([[i + 1, i] for i in range(1, n)], n)
    exosystem = Exosystem(A=A, C=C)
    return Problem(
        name=f"badly-scaled-{seed}",
        network=network,
        coupling=r.choice(("y", "tanh(y)", "2*y")) if k >= 1 else "y/1000000000000",
        gains=k,
        target=[0] * m,
        exosystem=exosystem,
    )
