"""Networks without one target at rest: the value agreed upon against runs that push it outwards,
its formula against matrix exponentials, and forged claims of every new kind against both programs.

Rows of max-separable certificates are sampled here by NumPy, kind by kind; what is forged exceeds
the least sample, and so is false.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from random import Random
from typing import Any

import numpy as np
from evidence.row import Row
from networks import network_of
from scipy.linalg import expm

from dobc_design import Certificate, Exosystem, Network, Observer, Problem, Verdict, certify
from dobc_design.certificate.text import certificate_bytes
from dobc_design.certification.recheck import recheck
from dobc_design.checker import examine as checker
from dobc_design.errors import CertificateError
from dobc_design.problem.canonical import canonical_bytes, problem_sha256

F = Fraction
Function = Callable[[Any], Any]
Document = dict[str, Any]
RISING: dict[str, Function] = {
    "y": lambda y: y,
    "3*y/2": lambda y: 1.5 * y,
    "tanh(y)": np.tanh,
    "exp(y) - 1 + y": lambda y: np.expm1(y) + y,
    "y + y**3/10": lambda y: y + y**3 / 10,
}
LINEAR = {"y": 1.0, "2*y": 2.0, "y/2": 0.5}
#: A and C of one component, and gains W with which A - W C is Hurwitz.
OBSERVED = (
    ([[0]], [[1]], ([["1/2"]], [[3]])),
    ([[0, 1], [-1, 0]], [[1, 0]], ([[1], ["1/2"]], [[3], [1]], [["1/2"], ["-1/5"]])),
    ([[0, 1], [0, 0]], [[1, 0]], ([[2], [1]], [[2], [3]])),
)


def drawn_arcs(r: Random, n: int, *, chain: bool) -> list[list[Any]]:
    """Weights are multiples of 1/4; ``chain``: some agent is heard by all others."""
    found: list[list[Any]] = []
    for i in range(1, n + 1):
        for j in range(1, n + 1):
            if i != j and ((chain and j == i - 1) or r.random() < 0.35):
                found.append([i, j, F(r.randint(1, 8), 4)])
    return found


def drawn_observer(r: Random) -> Document:
    A, C, gains = r.choice(OBSERVED)
    return {"exosystem": Exosystem(A, C), "observer": Observer(W=r.choice(gains))}


def floats(rows: Any) -> Any:
    return np.array([[float(x) for x in row] for row in rows])


# --- The value agreed upon
STEP = 0.02
RUNS = 40


@dataclass(frozen=True)
class Agreeing:
    """Agents without a target; arcs by mode, all with one function."""

    problem: Problem
    modes: list[list[list[Any]]]
    function: Function

    def slope(self, x: Any, mode: int) -> Any:
        """What couplings do to states (runs, n)."""
        moved = np.zeros_like(x)
        for i, j, w in self.modes[mode]:
            moved[:, i - 1] += float(w) * self.function(x[:, j - 1] - x[:, i - 1])
        return moved


def agreeing(number: int) -> Agreeing:
    r = Random(f"value {number}")
    n = r.randint(2, 5)
    modes = [drawn_arcs(r, n, chain=True) for _ in range(r.choice((1, 1, 2)))]
    h = r.choice(list(RISING))
    lo = F(r.randint(-8, 4), 4)
    given: Document = {"initial_states": [lo, lo + F(r.randint(1, 6), 4)]}
    observer: Document = {}
    if r.random() < 0.8:
        observer = drawn_observer(r)
        given["initial_disturbance"] = F(r.randint(1, 8), 16)
    named = dict(zip("GH", modes, strict=False))
    problem = Problem(
        network=network_of(named, n), coupling=h, goal="agreement", region=given, **observer
    )
    return Agreeing(problem, modes, RISING[h])


def farthest(case: Agreeing, rng: Any) -> tuple[float, float]:
    """The least and the largest state of runs that start in corners, whose estimation errors push
    all agents one way, or as the integral of C eps is largest, while modes come at random."""
    problem = case.problem
    region = problem.region
    assert region is not None
    (low, high), *_ = [tuple(map(float, pair)) for pair in region.initial_states]
    n = problem.n
    x = rng.choice([low, high], (RUNS, n))
    x[0] = low
    x[1] = high
    C = np.zeros((1, 1))
    whole = half = np.eye(1)
    eps = np.zeros((RUNS, n, 1))
    if problem.exosystem is not None:
        A = floats(problem.exosystem.A)
        C = floats(problem.exosystem.C)
        rate = A - floats(problem.observer.W) @ C
        half = expm(rate * STEP / 2)
        whole = half @ half
        most = np.linalg.solve(-rate.T, C[0])
        directions = rng.standard_normal((RUNS, n, len(A)))
        directions[: RUNS // 2] = most * np.sign(x[: RUNS // 2, :, None] - (low + high) / 2)
        lengths = np.linalg.norm(directions, axis=2, keepdims=True)
        eps = float(region.initial_disturbance or 0) * directions / lengths
    least = x.min()
    largest = x.max()
    mode = 0
    for k in range(int(6 / STEP)):
        if k % 20 == 0:
            mode = int(rng.integers(len(case.modes)))
        later = eps @ half.T
        last = eps @ whole.T
        pushes = [each @ C[0] for each in (eps, later, last)]
        a = case.slope(x, mode) + pushes[0]
        b = case.slope(x + STEP / 2 * a, mode) + pushes[1]
        c = case.slope(x + STEP / 2 * b, mode) + pushes[1]
        d = case.slope(x + STEP * c, mode) + pushes[2]
        x = x + STEP / 6 * (a + 2 * b + 2 * c + d)
        eps = last
        least = min(least, x.min())
        largest = max(largest, x.max())
    return least, largest


def values(count: int, seed: int) -> Row:
    """No state, and so no value agreed upon, leaves the interval that a certificate states."""
    failures = list[str]()
    stated = 0
    closest = np.inf
    for number in range(seed, seed + count):
        case = agreeing(number)
        certificate = certify(case.problem)
        value = certificate.value
        if value is None or value.lo is None or value.hi is None:
            continue
        stated += 1
        least, largest = farthest(case, np.random.default_rng(number))
        room = min(least - value.lo[0], value.hi[0] - largest)
        closest = min(closest, room / (value.hi[0] - value.lo[0]))
        if room < -1e-9:
            failures.append(f"seed {number}: a run leaves the interval by {-room:.3g}")
    told = f"{stated} state an interval; {RUNS} runs each come to {closest:.2g} of its width to it."
    what = "the value agreed upon: no run leaves its interval"
    return Row(what, count, failures, (told,))


def formulas(count: int, seed: int) -> Row:
    """The formula for linear couplings is the limit of the matrix exponential of the whole loop."""
    failures = list[str]()
    worst = 0.0
    for number in range(seed, seed + count):
        r = Random(f"formula {number}")
        n = r.randint(2, 6)
        arcs = drawn_arcs(r, n, chain=r.random() < 0.8)
        h = r.choice(list(LINEAR))
        observer = drawn_observer(r)
        problem = Problem(network=network_of(arcs, n), coupling=h, goal="agreement", **observer)
        certificate = certify(problem)
        value = certificate.value
        if certificate.verdict is not Verdict.PROVED or value is None or value.weights is None:
            # No agent is heard by all others: nothing is agreed upon.
            if certificate.verdict is not Verdict.REFUTED:
                failures.append(f"seed {number}: {certificate.verdict.value} without a formula")
            continue
        A = floats(problem.exosystem.A)  # type: ignore[union-attr]
        C = floats(problem.exosystem.C)  # type: ignore[union-attr]
        q = len(A)
        loop = np.zeros((n + n * q, n + n * q))
        for i, j, w in arcs:
            loop[i - 1, j - 1] += LINEAR[h] * float(w)
            loop[i - 1, i - 1] -= LINEAR[h] * float(w)
        loop[:n, n:] = np.kron(np.eye(n), C)
        loop[n:, n:] = np.kron(np.eye(n), A - floats(problem.observer.W) @ C)
        rng = np.random.default_rng(number)
        x = rng.uniform(-3, 3, n)
        eps = rng.uniform(-1, 1, (n, q))
        slowest = -np.sort(np.linalg.eigvals(loop).real)[-2]
        end = expm(loop * 40 / slowest) @ np.concatenate([x, eps.ravel()])
        off = abs(end[:n] - value.reached(x[:, None], eps)).max()
        worst = max(worst, off)
        if off > 1e-9:
            failures.append(f"seed {number}: the formula is off by {off:.3g}")
    told = f"The largest difference is {worst:.2g}."
    return Row("the value agreed upon: formula of linear couplings", count, failures, (told,))


# --- Forged claims
Terms = list[tuple[float, Function, int | None]]


@dataclass(frozen=True)
class Rows:
    """What node i hears, in every mode: weight, function and node, None for one whose error is 0;
    and what pulls it linearly."""

    terms: list[tuple[int, Terms, float]]

    def fastest(self, v: Any, rho: float) -> float:
        """No alpha above this meets all rows: the least over a grid of s in (0, rho]."""
        sizes = rho * np.concatenate([[1e-4], np.linspace(0.02, 1, 50)])
        least = np.inf
        for i, heard, pull in self.terms:
            upper = np.zeros_like(sizes)
            lower = np.zeros_like(sizes)
            for w, h, j in heard:
                reach = sizes * ((0.0 if j is None else v[j]) - v[i])
                upper += w * h(reach)
                lower -= w * h(-reach)
            falls = pull - np.maximum(upper, lower) / (sizes * v[i])
            least = min(least, float(falls.min()))
        return least


@dataclass(frozen=True)
class Forgery:
    """A problem of some kind whose proof is a max-separable, and the rows of that proof."""

    problem: Problem
    rows: Callable[[Certificate], Rows]


def _region(r: Random) -> Document:
    return {"initial_states": [-F(r.randint(1, 4), 4), F(r.randint(1, 4), 4)]}


def _pairs(r: Random) -> Forgery:
    """Agreement of agents that all hear someone; two functions, so that nothing is matched."""
    n = r.randint(3, 4)
    arcs = [*drawn_arcs(r, n, chain=True)]
    if all(i != 1 for i, *_ in arcs):
        arcs.append([1, n, F(1)])
    names = r.sample(list(RISING)[2:], 2)
    i, j, _ = arcs[0]
    problem = Problem(
        network=network_of(arcs, n),
        coupling=names[0],
        exceptions={(i - 1, j - 1): names[1]},
        goal="agreement",
        region=_region(r),
    )
    places = [(i, j) for i in range(1, n + 1) for j in range(1, n + 1) if i != j]
    number = {place: k for k, place in enumerate(places)}

    def mirrored(h: Function) -> Function:
        return lambda y: -h(-y)

    terms = []
    for first, second in places:
        heard: Terms = []
        for a, b, w in arcs:
            h = RISING[names[1] if (a, b) == (i, j) else names[0]]
            if a == first:
                heard.append((float(w), h, number.get((b, second))))
            if a == second:
                heard.append((float(w), mirrored(h), number.get((first, b))))
        terms.append((number[first, second], heard, 0.0))
    return Forgery(problem, lambda _: Rows(terms))


def _heard(arcs: Any, h: Function, n: int, *, first: int = 1) -> list[Terms]:
    """What every agent hears of the arcs; nodes from n on have the error 0."""
    found: list[Terms] = [[] for _ in range(n)]
    for i, j, w in arcs:
        node = j - first if isinstance(j, int) else None
        found[i - first].append((abs(float(w)), h, node))
    return found


def _opposed(r: Random) -> Forgery:
    """A chain of signs without two sides, and the pin of agent 1."""
    n = r.randint(3, 5)
    arcs = drawn_arcs(r, n, chain=True)
    for arc in arcs:
        arc[2] *= r.choice((1, -1))
    # 1 follows 2, and 2 follows -x of 1
    arcs = [arc for arc in arcs if arc[:2] not in ([1, 2], [2, 1])]
    arcs += [[1, 2, F(1)], [2, 1, F(-1)]]
    h = r.choice(list(RISING))
    network = Network.from_arcs(arcs, arrow="listens_to", agents=n, negative="opposes")
    half = F(r.randint(1, 4), 4)
    k = r.randint(1, 4)
    problem = Problem(
        network=network, coupling=h, gains={1: k}, region={"initial_states": [-half, half]}
    )
    heard = _heard(arcs, RISING[h], n)
    terms = [(i, heard[i], float(k) if i == 0 else 0.0) for i in range(n)]
    return Forgery(problem, lambda _: Rows(terms))


def _fixed(r: Random) -> Forgery:
    """Agents between two nodes, one of which may move."""
    n = r.randint(2, 5)
    arcs: list[list[Any]] = [*drawn_arcs(r, n, chain=True), [1, "left", F(1)], [n, "right", F(1)]]
    h = r.choice(list(RISING))
    network = Network.from_arcs(arcs, arrow="listens_to", agents=n, fixed=["left", "right"])
    fixed = {"left": 0, "right": r.choice((1, {"between": [1, "3/2"]}))}
    problem = Problem(
        network=network, coupling=h, goal="containment", fixed=fixed, region=_region(r)
    )
    heard = _heard(arcs, RISING[h], n)
    return Forgery(problem, lambda _: Rows([(i, heard[i], 0.0) for i in range(n)]))


def _saturated(r: Random) -> Forgery:
    """Some pins, which saturate."""
    n = r.randint(2, 5)
    arcs = drawn_arcs(r, n, chain=True)
    h = r.choice(list(RISING))
    gains = {i: r.randint(2, 6) for i in range(1, n + 1) if i == 1 or r.random() < 0.6}
    problem = Problem(
        network=network_of(arcs, n),
        coupling=h,
        gains=gains,
        actuators={"limit": F(r.randint(4, 12), 8), "saturates": True},
        region=_region(r),
    )

    def rows(certificate: Certificate) -> Rows:
        exact = certificate.check("actuators").exact
        assert exact is not None
        heard = _heard(arcs, RISING[h], n)
        for i, k in gains.items():
            room = float(F(exact["rooms"][str(i)]))
            heard[i - 1].append((1.0, lambda y, k=k, room=room: np.clip(k * y, -room, room), None))
        return Rows([(i, heard[i], 0.0) for i in range(n)])

    return Forgery(problem, rows)


def _pins_of_modes(r: Random) -> Forgery:
    """Two modes, each with the same chain and a gain of its own for agent 1."""
    n = r.randint(2, 5)
    modes = {name: drawn_arcs(r, n, chain=True) for name in "GH"}
    gains = {name: {1: r.randint(1, 4), n: r.randint(1, 3)} for name in modes}
    # Of linear couplings a quadratic V is found first.
    h = r.choice(list(RISING)[2:])
    problem = Problem(network=network_of(modes, n), coupling=h, mode_gains=gains, region=_region(r))
    terms = []
    for name, arcs in modes.items():
        heard = _heard(arcs, RISING[h], n)
        terms += [(i, heard[i], float(gains[name].get(i + 1, 0))) for i in range(n)]
    return Forgery(problem, lambda _: Rows(terms))


def refusals(data: bytes, problem: Problem) -> list[str]:
    """What the second program says of the claims that it refuses."""
    return [text for holds, text in checker.examine(data, canonical_bytes(problem)) if not holds]


def _refused_by(document: Document, problem: Problem, id: str) -> tuple[bool, bool]:
    """Whether the package, and the second program at this check, refuse."""
    data = json.dumps(document).encode()
    try:
        package = not recheck(data, problem).holds
    except CertificateError:
        package = True
    try:
        told = [
            text for holds, text in checker.examine(data, canonical_bytes(problem)) if not holds
        ]
        second = any(id in text for text in told)
    except checker.Refused:
        second = True
    return package, second


def _copied(certificate: Certificate) -> Document:
    document: Document = json.loads(certificate_bytes(certificate.claims))
    return document


def _of_rows(certificate: Certificate, rows: Rows) -> Iterator[tuple[str, Document]]:
    """Max-separables that claim too much: the name of what is bent, and the certificate."""
    honest = _copied(certificate)
    exact = next(each for each in honest["checks"] if each["id"] == "max-separable")["exact"]
    v = np.array([float(F(x)) for x in exact["v"]])
    rho = float(F(exact["rho"])) if exact["rho"] is not None else 2.0
    alpha = float(F(exact["alpha"]))
    bent: dict[str, Document] = {}
    bent["alpha"] = {"alpha": str(F(rows.fastest(v, rho) * 1.001).limit_denominator(10**6))}
    for k in range(len(v)):
        for times in (F(1, 2), F(2)):
            other = v.copy()
            other[k] *= float(times)
            if rows.fastest(other, rho) < alpha * 0.999:
                weights = [*exact["v"]]
                weights[k] = str(F(weights[k]) * times)
                bent["v"] = {"v": weights}
    if exact["rho"] is not None and rows.fastest(v, 3 * rho) < alpha * 0.999:
        bent["rho"] = {"rho": str(3 * F(exact["rho"]))}
    for name, change in bent.items():
        document = _copied(certificate)
        check = next(each for each in document["checks"] if each["id"] == "max-separable")
        check["exact"] |= change
        yield name, document
    document = _copied(certificate)
    check = next(each for each in document["checks"] if each["id"] == "max-separable")
    if type(check["domain"]) is dict:
        check["domain"]["radius"] = float(F(rho * v.min() * 1.01))
        yield "radius", document


def _of_values(certificate: Certificate) -> Iterator[tuple[str, Document]]:
    """Statements on the value that say too much."""
    value = _copied(certificate)["value"]
    bent: dict[str, Document] = {}
    if value["lo"] is not None:
        bent["lo"] = {"lo": [value["lo"][0] + 1e-3]}
        bent["hi"] = {"hi": [value["hi"][0] - 1e-3]}
    if value["peaks"] is not None:
        less = str(F(value["peaks"]["drift"]) / 2)
        bent["peaks"] = {"peaks": value["peaks"] | {"drift": less}}
    if value["weights"] is not None:
        labels = list(value["weights"])
        moved = {label: F(x) for label, x in value["weights"].items()}
        moved[labels[0]] += F(1, 1000)
        moved[labels[1]] -= F(1, 1000)
        bent["weights"] = {"weights": {label: str(x) for label, x in moved.items()}}
    if value["shifts"]:
        (first, *rest), *others = value["shifts"][0]
        shift = [[str(F(first) + F(1, 100)), *rest], *others]
        bent["shifts"] = {"shifts": [shift, *value["shifts"][1:]]}
    for name, change in bent.items():
        document = _copied(certificate)
        document["value"] |= change
        yield name, document


KINDS: dict[str, Callable[[Random], Forgery]] = {
    "pairs": _pairs,
    "signs": _opposed,
    "fixed nodes": _fixed,
    "saturation": _saturated,
    "pins of modes": _pins_of_modes,
}


def _balanced(r: Random) -> tuple[Problem, Problem]:
    """Signs without two sides, which lead to 0, and the same with one sign turned, which do not."""
    n = r.randint(3, 5)
    around = [[i, i % n + 1, F(r.randint(1, 4), 2)] for i in range(1, n + 1)]
    signs = [r.choice((1, -1)) for _ in range(n)]
    if np.prod(signs) > 0:
        signs[0] *= -1
    if all(sign > 0 for sign in signs[1:]):
        signs[1:3] = [-1, -1]
    problems = []
    for first in (signs[0], -signs[0]):
        arcs = [
            [i, j, w * sign] for (i, j, w), sign in zip(around, [first, *signs[1:]], strict=True)
        ]
        network = Network.from_arcs(arcs, arrow="listens_to", agents=n, negative="opposes")
        problems.append(Problem(network=network, coupling="y"))
    return problems[0], problems[1]


def forgeries(count: int, seed: int) -> Row:
    """Each forged claim is refused by both programs, and each true one beside it accepted."""
    failures = list[str]()
    refused = Counter[str]()

    def judge(kind: str, what: str, number: int, problem: Problem, forged: Document, id: str):
        package, second = _refused_by(forged, problem, id)
        refused[kind] += package and second
        if not (package and second):
            who = "the second program" if package else "the package"
            failures.append(f"seed {number}, {kind}: {who} accepts another {what}")

    def honest(kind: str, number: int, problem: Problem) -> Certificate:
        certificate = certify(problem)
        data = certificate_bytes(certificate.claims)
        told = [
            text for holds, text in checker.examine(data, canonical_bytes(problem)) if not holds
        ]
        if told or not recheck(data, problem).holds:
            failures.append(f"seed {number}, {kind}: the true claim is refused, {told}")
        return certificate

    for number in range(seed, seed + count):
        for kind, drawn in KINDS.items():
            forgery = drawn(Random(f"{kind} {number}"))
            certificate = honest(kind, number, forgery.problem)
            proofs = [each.id for each in certificate.checks if each.verdict is Verdict.PROVED]
            if "max-separable" not in proofs:
                continue
            for what, forged in _of_rows(certificate, forgery.rows(certificate)):
                judge(kind, what, number, forgery.problem, forged, "max-separable")
        problem = agreeing(number).problem
        certificate = honest("value", number, problem)
        if certificate.value is not None:
            for what, forged in _of_values(certificate):
                judge("value", what, number, problem, forged, "value")
        proved, still = _balanced(Random(f"cover {number}"))
        certificate = honest("double cover", number, proved)
        if certificate.verdict is not Verdict.PROVED:
            failures.append(f"seed {number}: signs without two sides are not proved")
        forged = _copied(certificate) | {"problem_sha256": problem_sha256(still)}
        judge("double cover", "problem", number, still, forged, "reachability")
    told = ", ".join(f"{kind}: {number}" for kind, number in refused.items())
    what = "forged claims of other networks: both programs refuse"
    return Row(what, refused.total(), failures, (f"Refused, {told}.",), least=10 * count)
