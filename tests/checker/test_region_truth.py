"""The oracle of regional claims has teeth: what is false by 1e-6 is seen, at boundaries known in closed form.

Nothing of the package takes part but the canonical form of a problem, and the frames of hand-written claims.
"""

from __future__ import annotations

import json
import math
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from checker_cases import HOLDS
from region_oracle import Regions
from scipy import optimize
from tube_cases import tube_cases

from dobc_design.problem.canonical import canonical_document
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem

HUMP = "y*((y + 2)**2 + 1/10)"  # a local maximum at the larger |root| of 3 y^2 + 8 y + 4.1, near y = -1.97
TINY = 1e-6
PAPER = "exp(y) - 1 + y"


def pair(h: str, *, k: Any = 5, back: bool = False, **more: Any) -> Problem:
    """Agent 2 listens to the pinned agent 1 (``back``: and the other way round, both pinned)."""
    arcs = [[2, 1], [1, 2]] if back else [[2, 1]]
    network = Network.from_arcs(arcs, arrow="listens_to", agents=2)
    return Problem(network=network, coupling=h, gains=k if back else {1: k}, target=0, **more)


def text(x: float | Fraction) -> str:
    return str(Fraction(x))


def separable(*, v: Any, alpha: Any, rho: Any, radius: float = 0.5, **more: Any) -> dict[str, Any]:
    domain: Any = "global" if rho is None else {"kind": "box", "radius": radius, "disturbance": 0.0}
    exact = {"v": [text(x) for x in v], "alpha": text(alpha), "rho": None if rho is None else text(rho), **more}
    return {"id": "max-separable", "verdict": "proved", "domain": domain, "margin": None, "rate": 1e-4, "exact": exact}


def beside(proof: dict[str, Any], id: str, exact: dict[str, Any], *, rate: float | None = None) -> dict[str, Any]:
    return {**proof, "id": id, "rate": rate, "exact": {name: text(x) for name, x in exact.items()}}


def found(
    problem: Problem, check: dict[str, Any], *others: dict[str, Any], W: Any = None, domain: str = ""
) -> list[str]:
    """What the oracle says against a check, in a certificate that holds it and the others."""
    smooth = "global" if problem.coupling.is_linear else "consensus"
    return Regions(canonical_document(problem), W).false(check, {"checks": [check, *others]}, domain or smooth)


@pytest.mark.parametrize(
    ("h", "rho", "most"),
    [
        # upper row of agent 2, v = (1, 2): sup of h on [-3 s, -s] <= -2 alpha s
        (PAPER, 2, (1 + (1 - math.exp(-2)) / 2) / 2),  # nondecreasing: h(-s), worst at s = rho
        ("sin(y)", 1, math.sin(3) / 2),  # the left end, worst at s = 1
        (HUMP, 1, -0.5 * max(y * ((y + 2) ** 2 + 0.1) for y in [(-8 - math.sqrt(14.8)) / 6])),  # inside
        ("clip(y, -1, 1)", 4, 1 / 8),
    ],
)
def test_a_rate_is_false_just_above_the_largest_and_true_just_below(h: str, rho: int, most: float):
    problem = pair(h)
    assert found(problem, separable(v=(1, 2), alpha=most * (1 - TINY), rho=rho)) == []
    assert found(problem, separable(v=(1, 2), alpha=most * (1 + TINY), rho=rho)) != []


def test_the_lower_face_counts_too():
    """-h(-y): with h = y - y**2/3 the lower row of agent 2 reads s - s^2/3 >= 2 alpha s, worst at s = rho = 1/2."""
    for factor, true in ((1 - TINY, True), (1 + TINY, False)):
        check = separable(v=(1, 2), alpha=factor * 5 / 12, rho=0.5)
        wrong = found(pair("y - y**2/3"), check)
        assert (wrong == []) is true


def test_a_radius_is_false_just_beyond_the_box_that_rho_holds():
    """R / min v <= rho, and rates are at most alpha."""
    problem = pair(PAPER)
    assert found(problem, separable(v=(1, 2), alpha=0.5, rho=1, radius=1.0)) == []
    assert found(problem, separable(v=(1, 2), alpha=0.5, rho=1, radius=1 + TINY)) == ["the box"]
    assert found(problem, separable(v=(1, 2), alpha=0.5, rho=1) | {"rate": 0.5 * (1 + TINY)}) == ["rate"]


@pytest.mark.parametrize("radius", [0.0, -1.0])
def test_radii_and_rates_that_are_not_positive_are_false(radius: float):
    problem = pair(PAPER)
    assert found(problem, separable(v=(1, 2), alpha=0.5, rho=1, radius=radius)) != []
    assert found(problem, separable(v=(1, 2), alpha=0.5, rho=1) | {"rate": radius}) != []
    assert found(problem, separable(v=(1, 2), alpha=0.5, rho=radius)) != []
    assert found(problem, separable(v=(1, radius), alpha=0.5, rho=1)) != []


OBSERVER = {"P": [["1"]], "beta": "1", "kappa": "2", "size": "1"}


@pytest.mark.parametrize(
    ("change", "true"),
    [
        ({}, True),
        ({"beta": text(1 + TINY)}, False),  # F = -1: -2 P + 2 beta P <= 0
        ({"P": [[text(1 - TINY)]]}, False),  # C'C <= P
        ({"P": [[text(1 + TINY)]]}, False),  # P <= size
        ({"kappa": "1"}, False),  # kappa beta min v > 1
        ({"kappa": text(3 * (1 - TINY))}, True),  # R / min v + kappa s sqrt(size) <= rho: 1/2 + 3/2 = 2
        ({"kappa": text(3 * (1 + TINY))}, False),
    ],
)
def test_every_condition_on_the_observer_counts(change: dict[str, Any], true: bool):
    problem = pair(PAPER, exosystem=Exosystem(A=[[0]], C=[[1]]))
    check = separable(v=(1, 2), alpha=0.5, rho=2, radius=0.5, **(OBSERVER | change))
    check["domain"]["disturbance"] = 0.5
    assert (found(problem, check, W=[["1"]]) == []) is true


def test_a_delay_is_false_just_above_the_largest():
    """h = y, v = (1, 2): theta - 2 <= -2 b, so T <= ln(3/2) / b at b = 1/4."""
    problem, proof = pair("y"), separable(v=(1, 2), alpha=0.5, rho=1)
    for factor, true in ((1 - TINY, True), (1 + TINY, False)):
        exact = {"delay": 4 * math.log(1.5) * factor, "rate": 0.25}
        assert (found(problem, beside(proof, "delay", exact, rate=0.1), proof) == []) is true


def test_a_sampling_period_is_false_where_a_step_overshoots():
    """Agent 1 alone: e -> (1 - 5 T) e; |1 - 5 T| <= f = 1 - T alpha up to T = 2 / (5 + alpha)."""
    problem, proof = pair("y"), separable(v=(1, 2), alpha=0.5, rho=1)
    for factor, true in ((1 - TINY, True), (1 + TINY, False)):
        T = 2 / 5.5 * factor
        exact = {"period": T, "factor": 1 - Fraction(T) / 2}
        assert (found(problem, beside(proof, "sampling", exact), proof) == []) is true
    low = {"period": 0.1, "factor": 0.95 * (1 - TINY)}
    assert found(problem, beside(proof, "sampling", low), proof) == ["period, factor"]


def test_stuck_agents_are_stuck():
    modes = {"a": [[2, 1], [3, 2]], "b": [[2, 3], [3, 1]]}
    network = Network.from_arcs(modes, arrow="listens_to", agents=3)
    problem = Problem(network=network, coupling=PAPER, gains={1: 1}, target=0)
    check = {"id": "max-separable", "verdict": "refuted", "domain": "consensus", "margin": None, "rate": None}
    for labels, true in ((["2", "3"], True), (["2"], False), (["1", "2"], False), ([], False)):
        witness = {"kind": "agents", "labels": labels}
        assert (found(problem, check | {"witness": witness}) == []) is true


# quadratic


def lure(P_e: Any, *, gains: Any, level: Any, radius: Any, rate: Any = 0, method: str = "vertices", ball: Any = 0.1):
    domain: Any = "global" if level is None else {"kind": "ball", "radius": ball, "disturbance": 0.0}
    exact = {
        "method": method,
        "P_e": [[a, b, text(x)] for a, b, x in P_e],
        "rate": text(rate),
        "level": None if level is None else text(level),
        "radius": None if radius is None else text(radius),
        "ranges": [{"coupling": 0, "gains": [[[text(x) for x in gains]]]}],
        "multipliers": {"G": ["1/2"]} if method == "lure" else {},
    }
    return {"id": "lure", "verdict": "proved", "domain": domain, "margin": None, "rate": None, "exact": exact}


BALL = [(0, 0, 1), (1, 1, 1)]


@pytest.mark.parametrize("method", ["vertices", "interval", "lure"])
def test_a_quadratic_rate_is_false_just_above_the_eigenvalue(method: str):
    """P_e = I and [[-5, 0], [1, -1]]: the rate is 3 - sqrt(17) / 2."""
    most = 3 - math.sqrt(17) / 2
    for factor, true in ((1 - TINY, True), (1 + TINY, False)):
        check = lure(BALL, gains=(1, 1), level=None, radius=None, rate=most * factor, method=method)
        assert (found(pair("y"), check) == []) is true


@pytest.mark.parametrize(
    ("change", "wrong"),
    [
        ({}, []),
        ({"gains": (math.tanh(1) * (1 + TINY), 1)}, ["gains"]),
        ({"gains": (math.tanh(1) * (1 - TINY), 1 - TINY)}, ["gains"]),
        ({"level": 0.5 * (1 + TINY)}, ["the level set leaves the gains"]),  # z'z = 2, radius 1
        ({"ball": math.sqrt(0.5) * (1 + TINY)}, ["the ball"]),
        ({"ball": -0.5}, ["witness or domain"]),
        ({"radius": -1}, ["level and radius"]),
        ({"P_e": [(0, 0, 1), (1, 1, -1)]}, ["P_e or rate"]),
        ({"rate": 0.8}, ["inequality"]),  # slower than 0.762 in the worst corner
    ],
)
def test_every_condition_of_a_quadratic_claim_counts(change: dict[str, Any], wrong: list[str]):
    claim = {"P_e": BALL, "gains": (math.tanh(1) * (1 - TINY), 1), "level": 0.5, "radius": 1}
    claim["ball"] = math.sqrt(0.5) * (1 - TINY)
    assert found(pair("tanh(y)"), lure(**(claim | change))) == wrong


def test_a_ball_of_decrease_is_false_just_beyond_where_it_ends():
    """Two agents, sin, V = e'e: the least V at which V' = 0, by SciPy over all directions."""
    problem = pair("sin(y)", k="1/5", back=True)

    def change(r: float, angle: float) -> float:
        a, b = r * math.cos(angle), r * math.sin(angle)
        return 2 * (a * math.sin(b - a) + b * math.sin(a - b)) - 0.4 * (a * a + b * b)

    # On the worst direction, b = -a = y / 2: -2 y sin y - y^2 / 5 = 0.
    y = optimize.brentq(lambda y: math.sin(y) + y / 10, 3, 3.6)
    end = y * y / 2
    assert max(change(math.sqrt(end) * 0.9999, angle) for angle in np.linspace(0, 7, 4001)) < 0
    claim = lure(BALL, gains=(0.84, 1), level=0.5, radius=1, ball=0.5)
    claim["exact"] |= {"half": "4", "tree": "."}
    for factor, true in ((1 - TINY, True), (1 + TINY, False)):
        check = {**claim, "id": "exhaustive", "exact": {**claim["exact"], "outer": text(end * factor)}}
        assert (found(problem, check) == []) is true


def test_a_tree_that_does_not_end_is_none():
    claim = lure(BALL, gains=(0, 1), level=0.5, radius=1, ball=0.5)
    for tree, true in ((".", True), ("0..", True), ("0.", False), ("0...", False), ("2..", False), ("", False)):
        exact = {**claim["exact"], "outer": "1", "half": "1", "tree": tree}
        check = {**claim, "id": "exhaustive", "exact": exact}
        assert (found(pair("sin(y)", k="1/2", back=True), check) == []) is true


# settling times


def test_the_oracle_tells_every_settling_time_that_is_true_from_its_twins():
    """Claims worked out on paper; no sample of their rows contradicts them, and one does in every twin."""
    for case in tube_cases():
        document, problem = json.loads(case.certificate), json.loads(case.problem)
        W = (document["observer"] or {"W": None})["W"]
        (check,) = [each for each in document["checks"] if each["id"] == "settling"]
        (lemma, *_) = [each["domain"] for each in document["checks"] if each["id"] == "lemma1"]
        said = Regions(problem, W).false(check, document, lemma)
        assert (said == []) is (case.code == HOLDS), (case.name, said)


# equilibria


def test_an_equilibrium_is_true_where_the_closed_form_has_one():
    """Both pinned with 1/10: 2 sin y + y/10 = 0 with e_2 = -e_1 = y/2, near y = 3.31."""
    problem = pair("sin(y)", k="1/10", back=True, region={"initial_states": [-5, 5]})
    root = optimize.brentq(lambda y: 2 * math.sin(y) + y / 10, 3, 3.6) / 2
    for shift, reach, true in ((0.0, 1e-6, True), (2e-6, 1e-6, False), (0.0, 4.0, False)):
        box = [[text(x - reach), text(x + reach)] for x in (-root + shift, root + shift)]
        check = {"id": "equilibrium", "verdict": "refuted", "domain": "consensus", "margin": None, "rate": None}
        check |= {"exact": {"mode": "G", "box": box}, "witness": {"kind": "start", "values": []}}
        assert (found(problem, check) == []) is true
