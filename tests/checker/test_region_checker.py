"""The lone checker's part about regions: accepts what is proved, refuses what just fails.

Its cases are in tests/support/region_cases.py; test_removals.py takes its checks away.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable

import mpmath
import pytest
from checker_cases import FAILS, HOLDS, alone, misjudged, outcome
from region_cases import BENT, PAIR, SINE, certificate, changed, claim, doubles, problems, region_cases

from dobc_design.certificate.text import certificate_bytes
from dobc_design.certification.certify import certify
from dobc_design.problem.canonical import canonical_bytes
from dobc_design.problem.load import load_problem
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem


def test_every_case_gets_its_exit_code():
    """Claims whose truth is known, and twins that just fail in one place each."""
    assert misjudged(region_cases()) == []
    assert sum(case.code == HOLDS for case in region_cases()) > 25
    assert sum(case.code == FAILS for case in region_cases()) > 100


@pytest.mark.parametrize("name", ["paper-fixed", "paper-switching"])
def test_the_lone_folder_confirms_a_region_of_the_paper(tmp_path, name):
    problem = load_problem(name)
    proof = certify(problem)
    assert "max-separable" in {check.id for check in proof.checks}
    done = alone(tmp_path, certificate_bytes(proof.claims), canonical_bytes(problem))
    assert (done.returncode, done.stderr) == (0, "")
    assert "holds  max-separable : proved" in done.stdout


# --- Known answers: the largest alpha by closed forms and by sampling the rows --------------------------------------
def sampled_rate(h: Callable[[float], float], v: list[float], k: list[float], rho: float) -> float:
    """The largest alpha of agents in a line, from 200 values of s and suprema over 200 points."""
    rates = []
    for s in (rho * (step + 1) / 200 for step in range(200)):
        for i, own in enumerate(v):
            for face in (1, -1):
                low, high = (-s * (own + v[i - 1]), s * (v[i - 1] - own)) if i else (0.0, 0.0)
                top = max(face * h(face * (low + (high - low) * part / 200)) for part in range(201))
                rates.append(k[i] - top / (s * own))
    return min(rates)


ROWS = {
    "sin(y)": math.sin,
    "exp(y) - 1 + y": lambda y: math.exp(y) - 1 + y,
    "y - y**3/5": lambda y: y - y**3 / 5,
    "max(-1, min(2*y, y + 1/4))": lambda y: max(-1, min(2 * y, y + 1 / 4)),
    "y*cos(2*y)": lambda y: y * math.cos(2 * y),
    "abs(y)/2 + atan(y)": lambda y: abs(y) / 2 + math.atan(y),
}


@pytest.mark.parametrize("h", sorted(ROWS))
def test_rows_are_accepted_below_the_sampled_rate_and_refused_above(h):
    """Three agents in a line, the first pinned more; also couplings that are not monotone, or have kinks."""
    v, k = [1.0, 1.5, 1.75], [6.0, 5.0, 6.0]
    exact = {"v": ["1", "3/2", "7/4"], "rho": "1"}
    problem = Problem(
        network=Network.from_arcs([[2, 1], [3, 2]], arrow="listens_to", agents=3), coupling=h, gains={1: 6, 2: 5, 3: 6}
    )
    best = sampled_rate(ROWS[h], v, k, 1.0)
    frame = json.loads(certificate_bytes(certify(problem).claims))
    for room, code in ((-5e-3, HOLDS), (5e-3, FAILS)):
        alpha = best + room
        check = claim("max-separable", {"kind": "box", "radius": 0.5, "disturbance": 0}, None, exact)
        check["exact"]["alpha"] = f"{alpha:.9f}"
        check["rate"] = round(alpha / 2, 9)
        data = json.dumps(frame | {"checks": [*frame["checks"], check]}).encode()
        assert outcome(data, canonical_bytes(problem)) == code


def test_two_agents_that_hear_each_other_keep_their_alpha_to_nine_digits():
    """-|y|, both pinned with 5, v = 1: alpha = 3 exactly; sin on [-5/2 s, -s/2]: sin 3 / 1.8 at s = 6/5."""
    sharp = mpmath.sin(3) / mpmath.mpf("1.8")
    for name, check, alpha in (("bent", BENT, 3.0), ("sine", SINE, float(sharp))):
        for factor, code in ((1 - 1e-9, HOLDS), (1 + 1e-9, FAILS)):
            data = certificate(name, changed(check, alpha=f"{alpha * factor:.15f}"))
            assert outcome(data, canonical_bytes(problems()[name])) == code


# --- Hostile claims -------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    "change",
    [
        {"v": ["1e400", "1e-400"]},
        {"v": ["1e-400", "1e-400"]},
        {"rho": "1e400"},
        {"alpha": "1e400"},
        {"alpha": "-1e400"},
        {"v": {"float64": "AAAA"}},
        {"v": {"float64": "A" * 100_000}},
        {"v": doubles(float("nan"), 1.0)},
        {"v": doubles(5e-324, 1.7e308)},
        {"v": {"float64": ""}},
        {"v": {"float32": "AAAA"}},
        {"v": [1, 1]},
        {"v": "11"},
        {"v": [["1"], ["1"]]},
        {"v": None},
        {"rho": 1},
        {"rho": "1/0"},
        {"rho": "nan"},
        {"alpha": ["1"]},
        {"v": ["1", "1" * 9999]},
        {"rho": "1" * 9999},
        {"alpha": "1/" + "3" * 9000},
        {"v": ["\u0661", "1"]},
    ],
)
def test_hostile_numbers_are_refused_at_once(change):
    data, problem = certificate("pair", changed(PAIR, **change)), canonical_bytes(problems()["pair"])
    start = time.process_time()
    assert outcome(data, problem) == FAILS
    assert time.process_time() - start < 10
