"""The lone checker's part about quadratic certificates: lure, boxes one by one, and changed claims."""

import itertools
import json
import math
import random
import time
from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import mpmath
import numpy as np
import pytest
from checker_cases import FAILS, HOLDS, accepted_by, alone, outcome
from lure_cases import HARMONIC, PAPER_GAIN
from mutants import mutate
from quadratic_cases import SHARP, WAVY, chain, grid, quadratic_cases
from region_cases import certificate, changed, problems

from dobc_design import Network, Observer, Problem, Region, certify
from dobc_design.certificate.text import certificate_bytes
from dobc_design.checker import examine as checker
from dobc_design.checker import quadratic
from dobc_design.checker.matrices import identity
from dobc_design.conditions.boxes.stage import exhaustive_stage
from dobc_design.conditions.coverage import read_region
from dobc_design.conditions.quadratic.stage import quadratic_stage
from dobc_design.problem.canonical import canonical_bytes


def test_the_lone_folder_confirms_boxes(tmp_path):
    boxes = quadratic_cases()[0]
    done = alone(tmp_path, boxes.certificate, boxes.problem)
    assert (done.returncode, done.stderr) == (HOLDS, "")
    assert "holds  exhaustive : proved" in done.stdout


def test_a_list_with_a_clipped_expression_needs_the_radius():
    """clip(y1, -1, 1) is not linear although two of its three arguments are constants; y2 is."""
    arcs = Network.from_arcs([[2, 1]], arrow="listens_to", agents=2)
    problem = Problem(network=arcs, coupling=["clip(y1, -1, 1)", "y2"], gains=1, target=[0, 0])
    assert quadratic.relied(checker.Problem(canonical_bytes(problem))) == {(2, 0)}


def reader(h: Any) -> tuple[checker.Problem, str]:
    """Agent 2 of three hears agent 3 with weight 2; two components."""
    arcs = Network.from_arcs([[2, 3, 2]], arrow="listens_to", agents=3)
    read = checker.Problem(canonical_bytes(Problem(network=arcs, coupling=h, gains=1, target=[0, 0])))
    return read, *read.modes


def test_channels_of_several_components_lead_from_the_differences_to_the_rows():
    read, mode = reader(["y1 + y2", "y2"])
    gains = [[(Fraction(lo), Fraction(hi)) for lo, hi in row] for row in (((1, 3), (0, 0)), ((1, 1), (0, 4)))]
    found = quadratic.channels(read, mode, {read.couplings[0]: gains})
    assert found == [(2, 2, 4, 4, 2), (3, 2, 4, 2, 0), (3, 3, 5, 4, 4)]


def test_components_and_agents_meet_their_own():
    read, mode = reader("tanh(y)")
    claim = SimpleNamespace(P_e=identity(6), rate=Fraction(0))
    assert [(a, b) for *_, a, b in quadratic.field(read, mode, claim, identity(6)).arcs] == [(2, 4), (3, 5)]
    agents = SimpleNamespace(q=0, m=1, n=3, block=lambda S, i: [[Fraction(i)]])
    costs = quadratic.noise(SimpleNamespace(problem=agents), None)
    assert [row[i] for i, row in enumerate(costs)] == [0, 1, 2]


# --- Where V decreases, sampled -------------------------------------------------------------------------------------
def sampled_rate(h: Any, k: float, outer: float) -> float:
    """The largest rate of e'e for two agents that hear each other, at 400 000 points of the disc |e|^2 <= outer."""
    r, angle = np.meshgrid(np.linspace(1e-3, math.sqrt(outer), 400), np.linspace(0, 2 * math.pi, 1000))
    a, b = r * np.cos(angle), r * np.sin(angle)
    change = a * (h(b - a) - k * a) + b * (h(a - b) - k * b)
    return float(np.min(-change / r**2))


@pytest.mark.parametrize(
    ("h", "function", "slopes"),
    [
        ("sin(y)", np.sin, ["0.95", "1.001"]),
        ("y*cos(y)", lambda y: y * np.cos(y), ["0.87", "1.001"]),
        ("min(y, 1 + sin(3*y)/4)", lambda y: np.minimum(y, 1 + np.sin(3 * y) / 4), ["0.999", "1.001"]),
        ("clip(2*y, -1, 1) - abs(y)/4", lambda y: np.clip(2 * y, -1, 1) - np.abs(y) / 4, ["1.7", "2.3"]),
    ],
)
def test_boxes_are_accepted_below_the_sampled_rate_and_refused_above(h, function, slopes):
    """Couplings that are not monotone, or have kinks; near the target a ball so small that their slopes there do."""
    outer, k = 4, 5
    best = sampled_rate(function, k, outer)
    arcs = Network.from_arcs([[1, 2], [2, 1]], arrow="listens_to", agents=2)
    problem = Problem(network=arcs, coupling=h, gains=k)
    frame = json.loads(certificate_bytes(certify(problem).claims))
    for room, code in ((-0.1, HOLDS), (0.02, FAILS)):
        check = changed(
            WAVY,
            domain={"kind": "ball", "radius": 1.99, "disturbance": 0},
            ranges=[{"coupling": 0, "gains": [[slopes]]}],
            **{"rate": None, "outer": str(outer), "half": "2", "tree": grid(2, 4), "level": "1/10", "radius": "1/2"},
        )
        check["exact"]["rate"] = f"{best + room:.6f}"
        check["rate"] = round(best / 2, 6)
        data = json.dumps(frame | {"checks": [*frame["checks"], check]}).encode()
        assert outcome(data, canonical_bytes(problem)) == code


def test_the_sharp_rate_is_where_the_paper_and_pencil_put_it():
    """3 + 2 min sin(y)/y, to a hundred-thousandth; more halvings than the checker makes would do better."""
    root = mpmath.findroot(lambda y: y * mpmath.cos(y) - mpmath.sin(y), 4.49)
    sharp = float(3 + 2 * mpmath.sin(root) / root)
    problem = canonical_bytes(problems()["wavy"])
    for room, code in ((-1e-5, HOLDS), (1e-5, FAILS)):
        check = changed(SHARP, tree=grid(2, 10), rate=2.5)
        check["exact"]["rate"] = f"{sharp + room:.9f}"
        assert outcome(certificate("wavy", check), problem) == code


# --- Boxes ----------------------------------------------------------------------------------------------------------
def random_form(r: random.Random, size: int) -> tuple[np.ndarray, list[list[Any]]]:
    """A positive definite matrix of small integers, as numbers and as intervals."""
    rows = range(size)
    L = np.array([[r.randint(-2, 2) if j < i else int(i == j) * r.randint(1, 3) for j in rows] for i in rows])
    P = L @ L.T
    return P, [[(float(x), float(x)) for x in row] for row in P]


def random_box(r: random.Random, size: int) -> Any:
    ends = [sorted((r.uniform(-2, 2), r.uniform(-2, 2))) for _ in range(size)]
    return tuple(lo for lo, _ in ends), tuple(hi for _, hi in ends)


@pytest.mark.parametrize("size", [1, 2, 3, 5])
def test_boxes_inside_and_outside_an_ellipsoid_are_told_apart(size):
    """At the corners, where a convex function is largest, and at its least value by quadratic programming."""
    from scipy.optimize import lsq_linear

    r = random.Random(size)
    sharp = 0
    for _ in range(60):
        P, form = random_form(r, size)
        box = random_box(r, size)
        corners = [np.array(corner) for corner in itertools.product(*zip(*box, strict=True))]
        top = max(corner @ P @ corner for corner in corners)
        factor = np.linalg.cholesky(P).T
        least = 2 * lsq_linear(factor, np.zeros(size), bounds=box, tol=1e-14).cost
        assert not quadratic.within(form, box, top - 1e-6)
        assert not quadratic.beyond(form, box, least + 1e-6)
        sharp += quadratic.beyond(form, box, 0.999 * least - 1e-9)
        small = tuple(tuple(x * 1e-9 + 1 for x in side) for side in box)
        value = np.ones(size) @ P @ np.ones(size)
        assert quadratic.within(form, small, value * (1 + 1e-6) + 1e-6)
        assert quadratic.beyond(form, small, value * (1 - 1e-6) - 1e-6)
    assert sharp > 40


def test_phi_and_its_slopes_hold_random_points():
    """Three agents, h = sin(y) + y^2/2, against phi and its gradient written out at 100 bits."""
    r = random.Random(3)
    arcs, K = [(0, 1, 1), (1, 2, 2), (2, 0, 1), (0, 2, "1/2")], [1, 2, 3]
    network = Network.from_arcs([[i + 1, j + 1, w] for i, j, w in arcs], arrow="listens_to", agents=3)
    problem = Problem(network=network, coupling="sin(y) + y**2/2", gains=dict(enumerate(K, 1)))
    read = checker.Problem(canonical_bytes(problem))
    zero = [[Fraction(0)] * 3] * 3
    for _ in range(20):
        P, _ = random_form(r, 3)
        rate = Fraction(r.randint(0, 8), 4)
        claim = SimpleNamespace(P_e=[[Fraction(int(x)) for x in row] for row in P], rate=rate)
        (mode,) = read.modes
        field = quadratic.field(read, mode, claim, zero)
        box = random_box(r, 3)
        value, slopes = field.at(box)

        def phi(*e: Any, P: Any = P, rate: Fraction = rate) -> Any:
            force = [-k * x for k, x in zip(K, e, strict=True)]
            for i, j, w in arcs:
                y = e[j] - e[i]
                force[i] += mpmath.mpf(Fraction(w).numerator) / Fraction(w).denominator * (mpmath.sin(y) + y * y / 2)
            Pe = [sum(int(P[a][b]) * e[b] for b in range(3)) for a in range(3)]
            twice = 2 * mpmath.mpf(rate.numerator) / rate.denominator
            return sum(x * (2 * f + twice * y) for x, f, y in zip(Pe, force, e, strict=True))

        with mpmath.workprec(100):
            for _ in range(5):
                e = [mpmath.mpf(r.uniform(lo, hi)) for lo, hi in zip(*box, strict=True)]
                assert value[0] <= phi(*e) <= value[1]
                for k in range(3):
                    slope = mpmath.diff(phi, tuple(e), tuple(int(k == each) for each in range(3))) / 2
                    assert slopes[k][0] - 1e-9 <= slope <= slopes[k][1] + 1e-9


def test_a_tree_leaves_boxes_that_fill_the_whole_one():
    boxes = quadratic.leaves("01." + "10" + "....", ((-1.0, -1.0), (1.0, 1.0)))
    volume = sum(math.prod(hi - lo for lo, hi in zip(*box, strict=True)) for box in boxes)
    assert len(boxes) == 5
    assert volume == 4.0
    assert boxes[0] == ((0.0, -1.0), (1.0, 1.0))
    low, high = quadratic.leaves("1..", ((-1.0, -1.0), (1.0, 1.0)))
    assert low == ((-1.0, -1.0), (1.0, 0.0))
    assert high == ((-1.0, 0.0), (1.0, 1.0))


# --- Hostile claims -------------------------------------------------------------------------------------------------
TREES = {
    "deep": "0" * 3_000_000,
    "long": grid(2, 20),
    "chain": chain(90_000),
    "dots": "." * 4_000_000,
    "letters": "a" * 1_000_000,
    "full": grid(2, 15),
    "unfinished": "01" * 49_000,
    "no text": [0, 1],
}


@pytest.mark.parametrize("name", sorted(TREES))
def test_hostile_trees_are_refused_at_once(name):
    rate = "2.6" if name == "full" else "5/2"
    check = changed(WAVY, tree=TREES[name])
    check["exact"]["rate"] = rate
    data, problem = certificate("wavy", check), canonical_bytes(problems()["wavy"])
    start = time.process_time()
    assert outcome(data, problem) == FAILS
    assert time.process_time() - start < 10


def ring(n: int, *, coupling: str, gains: object, s: Fraction | None = None) -> Problem:
    arcs = [[i, i % n + 1] for i in range(1, n + 1)]
    region = Region(initial_states=((Fraction(-1, 2), Fraction(1, 2)),), initial_disturbance=s)
    observed = {} if s is None else {"exosystem": HARMONIC, "observer": Observer(W=PAPER_GAIN)}
    network = Network.from_arcs(arcs, arrow="listens_to", agents=n)
    return Problem(network=network, coupling=coupling, gains=gains, target=0, region=region, **observed)


@pytest.mark.parametrize(
    ("id", "problem", "count"),
    [
        ("lure", ring(3, coupling="exp(y) - 1 + y", gains=3), 15),
        pytest.param(
            "lure", ring(3, coupling="exp(y) - 1 + y", gains=3, s=Fraction(1, 10)), 60, marks=pytest.mark.slow
        ),
        pytest.param("exhaustive", ring(2, coupling="sin(y)", gains={1: 3}), 60, marks=pytest.mark.slow),
    ],
)
def test_what_one_program_refuses_the_other_refuses(id, problem, count):
    document = json.loads(certificate_bytes(certify(problem).claims))
    stage = quadratic_stage if id == "lure" else exhaustive_stage
    asked = read_region(problem, problem.observer.W, domain="consensus", everything=id == "exhaustive")
    check = json.loads(json.dumps(stage(asked, lambda _: None)[0].to_json()))
    regional = ("max-separable", "delay", "sampling", "lure", "exhaustive", "tolerance")
    document["checks"] = [*(each for each in document["checks"] if each["id"] not in regional), check]
    document |= {"verdict": "proved", "rate": check["rate"], "covered_by": id}
    assert accepted_by(document, problem) == (True, True)
    refused = 0
    for seed in range(count):
        changed = mutate({"it": check}, seed, other={"it": document["checks"][0]}).get("it")
        if not isinstance(changed, dict) or changed == check:
            continue
        checks = [changed if each is check else each for each in document["checks"]]
        mutant = document | {"checks": checks, "rate": changed.get("rate")}
        package, lone = accepted_by(mutant, problem)
        assert package is lone, (seed, changed)
        refused += not package
    assert refused > 0.7 * count
