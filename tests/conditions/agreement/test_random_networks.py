"""Agreement of random networks, against oracles that know nothing of the package: networkx for
roots, numpy for eigenvalues, rows of pairs by hand, and runs of an integrator of our own.

A few of each are tried; ``-m evidence`` tries as many as the claims of the handbook rest on.
"""

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from random import Random
from statistics import median
from typing import Any

import networkx as nx
import numpy as np
import pytest
from checker_files.files import accepted_by
from networks import jacobian_by_hand, linked, random_arcs

from dobc_design import Certificate, Exosystem, Problem, Switching, Verdict, certify
from dobc_design.certificate.text import certificate_bytes
from dobc_design.problem.groups import Observer

PROVED, REFUTED = Verdict.PROVED, Verdict.REFUTED
#: With the slopes at 0.
RISING = {"y": 1.0, "tanh(y)": 1.0, "exp(y) - 1 + y": 2.0, "atan(2*y)": 2.0, "y + y**3/4": 1.0}


def few_or(*, few: int, many: int) -> Any:
    """How many are tried."""
    return pytest.mark.parametrize(
        "count", [few, pytest.param(many, marks=pytest.mark.evidence)], ids=["few", "many"]
    )


def closed_sets(n: int, arcs: list[Any]) -> list[set[str]]:
    """The strong components that hear no other, by networkx."""
    graph = nx.DiGraph()
    graph.add_nodes_from(range(1, n + 1))
    graph.add_edges_from((i, j) for i, j, *_ in arcs)
    condensed = nx.condensation(graph)
    found = []
    for node in condensed:
        if condensed.out_degree(node) == 0:
            found.append({str(i) for i in condensed.nodes[node]["members"]})
    return found


def drawn_arcs(r: Random, n: int, density: float) -> list[Any]:
    found: list[Any] = random_arcs(r, n, density, lambda: Fraction(r.randint(1, 8), 4))
    return found


@few_or(few=6, many=300)
def test_a_network_agrees_iff_it_has_a_root_and_at_the_second_eigenvalue(
    count: int, record_property: Callable[[str, object], None]
):
    """A proof is one that the second program accepts: `certify` withdraws any other."""
    r = Random(360)
    ratios = []
    verdicts = set()
    for k in range(count):
        n = r.randint(2, 6)
        arcs = drawn_arcs(r, n, r.choice((0.15, 0.3, 0.5)))
        h = r.choice(list(RISING)) if k % 4 else "y"
        slope = RISING[h]
        problem = linked(arcs, n, h, goal="agreement")
        certificate = certify(problem, everything=h == "y")
        apart = closed_sets(n, arcs)
        verdicts.add(certificate.verdict)
        checks = {check.id: check for check in certificate.checks}
        if len(apart) > 1:
            assert certificate.verdict is REFUTED
            witness = checks["reachability"].witness
            assert witness is not None
            assert witness.labels is not None
            assert set(witness.labels) == set.union(*apart)
            continue
        assert certificate.verdict is PROVED
        values = np.sort(np.linalg.eigvals(-jacobian_by_hand(problem, None, slope)).real)
        exact = checks["linearisation"].rate
        assert exact is not None
        # A multiple eigenvalue is known to half the digits, by numpy.
        assert exact == pytest.approx(values[1], rel=1e-3)
        if h == "y":
            by_rows = checks["max-separable"].rate
            assert by_rows is not None
            assert by_rows <= exact * (1 + 1e-6)
            ratios.append(by_rows / exact)
    assert verdicts == {PROVED, REFUTED}
    record_property("median of max-separable rates in parts of the exact ones", median(ratios))
    assert median(ratios) > 0.5


@few_or(few=2, many=100)
def test_a_periodic_schedule_agrees_iff_the_union_of_its_graphs_has_a_root(count: int):
    r = Random(361)
    verdicts = set()
    for _ in range(count):
        n = r.randint(2, 4)
        modes = {name: drawn_arcs(r, n, 0.2) for name in "ABC"[: r.randint(2, 3)]}
        order = list(modes)[: r.randint(1, len(modes))]
        turns = Switching(guarantee="sequence", sequence=order, dwell=r.choice(("1/2", 1, 2)))
        h = r.choice(("y", "tanh(y)"))
        problem = linked(modes, n, h, goal="agreement", switching=turns)
        certificate = certify(problem)
        union = [arc for name in order for arc in modes[name]]
        has_root = len(closed_sets(n, union)) == 1
        assert certificate.verdict is (PROVED if has_root else REFUTED)
        verdicts.add(certificate.verdict)
    assert verdicts == {PROVED, REFUTED}


def fastest_of_rows(arcs: list[Any], n: int, v: dict[tuple[int, int], Fraction]) -> Fraction:
    """The largest alpha with which all rows of pairs hold, for h = y; every i - j from 1 on."""
    weight = {(i, j): Fraction(w) for i, j, w in arcs}
    found = []
    none = Fraction(0)
    for (i, j), own in v.items():
        falls = none
        for third in range(1, n + 1):
            first = weight.get((i, third), none)
            second = weight.get((j, third), none)
            shared = min(first, second)
            # w (x_l - x_i) - w (x_l - x_j), then what is left of both
            falls += shared * own
            falls += (first - shared) * (own - v.get((third, j), none))
            falls += (second - shared) * (own - v.get((i, third), none))
        found.append(falls / own)
    return min(found)


def _bent(r: Random, certificate: Certificate, rate: Fraction, v: list[Fraction]) -> Any:
    """The max-separable with these weights and this rate; nothing else is claimed of regions."""
    document: dict[str, Any] = json.loads(certificate_bytes(certificate.claims))
    (rows,) = [each for each in document["checks"] if each["id"] == "max-separable"]
    known = ("reachability", "lemma1", "max-separable")
    document["checks"] = [each for each in document["checks"] if each["id"] in known]
    rows["rate"] = float(rate)
    rows["exact"] |= {"alpha": str(rate), "v": list(map(str, v))}
    factor = max(v) / min(v)
    rows["factor"] = float(factor) * (1 + 1e-9)
    told = {"verdict": "proved", "covered_by": "max-separable"}
    document |= told | {"rate": rows["rate"], "factor": rows["factor"]}
    r.shuffle(document["checks"])
    return document


@few_or(few=1, many=100)
def test_forged_rows_of_pairs_are_refused_and_the_true_ones_beside_them_accepted(count: int):
    r = Random(362)
    tried = 0
    while tried < count:
        n = r.randint(3, 5)
        arcs = drawn_arcs(r, n, 0.6)
        silent = set(range(1, n + 1)) - {i for i, *_ in arcs}
        if len(closed_sets(n, arcs)) > 1 or len(silent) == 1:
            continue
        problem = linked(arcs, n, goal="agreement")
        certificate = certify(problem, everything=True)
        (rows,) = [check for check in certificate.checks if check.id == "max-separable"]
        if rows.verdict is not PROVED:
            continue
        places = [(i, j) for i in range(1, n + 1) for j in range(1, n + 1) if i != j]
        assert rows.exact is not None
        weights = list(map(Fraction, rows.exact["v"]))
        # A little away from what was found, so that few rows are alike.
        weights = [x * Fraction(r.randint(990, 1010), 1000) for x in weights]
        most = fastest_of_rows(arcs, n, dict(zip(places, weights, strict=True)))
        if most <= 0:
            continue
        below = Fraction(int(most * 10**7), 10**7)
        above = below + Fraction(2, 10**7)
        for rate, holds in ((below, True), (above, False)):
            document = _bent(r, certificate, rate, weights)
            assert accepted_by(document, problem) == (holds, holds)
        # One pair with less weight than its neighbours leave it.
        least = min(range(len(weights)), key=weights.__getitem__)
        smaller = [x / 50 if k == least else x for k, x in enumerate(weights)]
        if fastest_of_rows(arcs, n, dict(zip(places, smaller, strict=True))) < below:
            assert accepted_by(_bent(r, certificate, below, smaller), problem) == (False, False)
        tried += 1


# --- Runs
FUNCTIONS = {
    "tanh(y)": np.tanh,
    "exp(y) - 1 + y": lambda y: np.expm1(y) + y,
    "sin(y)": np.sin,
    "y + y**3/4": lambda y: y + y**3 / 4,
}
OMEGA = 2.0


def drawn_problems(r: Random) -> Iterator[tuple[Problem, str, list[Any]]]:
    """Nonlinear, with a sine as disturbance and an observer of it."""
    while True:
        n = r.randint(2, 5)
        arcs = drawn_arcs(r, n, 0.5)
        if len(closed_sets(n, arcs)) > 1:
            continue
        h = r.choice(list(FUNCTIONS))
        half = Fraction(r.randint(2, 8), 10)
        region = {"initial_states": [-half, half], "initial_disturbance": "1/10"}
        exosystem = Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]])
        observer = Observer(W=[[3], [r.choice((0, "1/2"))]])
        more: Any = {"exosystem": exosystem, "observer": observer, "region": region}
        yield linked(arcs, n, h, goal="agreement", **more), h, arcs


def simulated(
    arcs: list[Any], h: str, W: Any, x: Any, eps: Any, step: float, steps: int
) -> Iterator[tuple[Any, Any]]:
    """States (runs, n) and estimation errors (runs, n, 2), by the rule of Runge and Kutta."""
    A = np.array([[0.0, OMEGA], [-OMEGA, 0.0]])
    F = A - np.outer(np.array(W, dtype=float).ravel(), [1.0, 0.0])
    function = FUNCTIONS[h]

    def slopes(x: Any, eps: Any) -> tuple[Any, Any]:
        moves = eps[:, :, 0].copy()
        for i, j, w in arcs:
            moves[:, i - 1] += float(w) * function(x[:, j - 1] - x[:, i - 1])
        return moves, eps @ F.T

    for _ in range(steps):
        a, p = slopes(x, eps)
        b, q = slopes(x + step / 2 * a, eps + step / 2 * p)
        c, s = slopes(x + step / 2 * b, eps + step / 2 * q)
        d, t = slopes(x + step * c, eps + step * s)
        x = x + step / 6 * (a + 2 * b + 2 * c + d)
        eps = eps + step / 6 * (p + 2 * q + 2 * s + t)
        yield x, eps


@dataclass(frozen=True)
class Tube:
    """V = max |x_i - x_j|/v_ij + kappa max sqrt(eps'P eps), as a max-separable claims it."""

    pairs: Any  # (count, 2)
    v: Any
    kappa: float
    P: Any

    def size(self, x: Any, eps: Any) -> Any:
        """Of every run: states (runs, n), estimation errors (runs, n, 2)."""
        first, second = self.pairs.T
        apart = np.abs(x[:, first] - x[:, second]) / self.v
        errors = np.sqrt(np.einsum("rni,ij,rnj->rn", eps, self.P, eps))
        return apart.max(axis=1) + self.kappa * errors.max(axis=1)


def tube_of(certificate: Certificate, n: int, arcs: list[Any]) -> Tube:
    (proof,) = [each for each in certificate.checks if each.id == "max-separable"]
    exact = proof.exact
    assert exact is not None
    silent = sorted(set(range(n)) - {i - 1 for i, *_ in arcs})
    if len(silent) == 1:
        pairs = [(i, silent[0]) for i in range(n) if i != silent[0]]
    else:
        pairs = [(i, j) for i in range(n) for j in range(n) if i != j]
    v = np.array([float(Fraction(x)) for x in exact["v"]])
    P = np.array([[float(Fraction(x)) for x in row] for row in exact["P"]])
    return Tube(np.array(pairs), v, float(Fraction(exact["kappa"])), P)


RUNS = 80
STEP = 0.01


@few_or(few=1, many=25)
def test_no_run_leaves_its_tube_of_disagreement(count: int):
    """V falls at the certified rate, from corners of the region and from inside."""
    draws = np.random.default_rng(363)
    problems = drawn_problems(Random(363))
    tried = 0
    while tried < count:
        problem, h, arcs = next(problems)
        certificate = certify(problem)
        rate = certificate.rate
        if certificate.covered_by != "max-separable" or rate is None:
            continue
        n = problem.n
        tube = tube_of(certificate, n, arcs)
        assert problem.region is not None
        half = float(problem.region.initial_states[0][1])
        x = half * draws.uniform(-1, 1, (RUNS, n))
        x[: RUNS // 2] = half * np.sign(x[: RUNS // 2])
        angle = draws.uniform(0, 2 * np.pi, (RUNS, n))
        eps = 0.1 * np.stack([np.cos(angle), np.sin(angle)], axis=2)
        start = tube.size(x, eps)
        runs = simulated(arcs, h, problem.observer.W, x, eps, STEP, 600)
        for k, (now, error) in enumerate(runs, 1):
            allowed = start * np.exp(-rate * k * STEP)
            assert (tube.size(now, error) / allowed).max() <= 1 + 1e-6
        tried += 1
