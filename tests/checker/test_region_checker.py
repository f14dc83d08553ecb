"""The lone checker's part about regions: accepts what is proved, refuses what just fails, encloses couplings outward.

Its cases are in tests/support/region_cases.py; tests/certificate/test_checker_removals.py takes its checks away.
"""

from __future__ import annotations

import json
import math
import random
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import mpmath
import pytest
from checker_cases import FAILS, HOLDS, UNREADABLE, Case
from region_cases import BENT, PAIR, SINE, certificate, changed, claim, doubles, problems, region_cases

from dobc_design.certificate.text import certificate_bytes
from dobc_design.certification.certify import certify
from dobc_design.checker import checker, region_checker
from dobc_design.problem.canonical import canonical_bytes
from dobc_design.problem.load import load_problem
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem

FOLDER = Path(checker.__file__).parent


def outcome(case: Case) -> int:
    try:
        return HOLDS if all(holds for holds, _ in checker.examine(case.certificate, case.problem)) else FAILS
    except checker.Refused:
        return UNREADABLE


def alone(folder: Path, files: list[str], certificate: bytes, problem: bytes) -> subprocess.CompletedProcess[str]:
    """Run copies of the files in an empty folder, without site packages and without the package."""
    for file in files:
        shutil.copy(FOLDER / file, folder / file)
    (folder / "certificate.json").write_bytes(certificate)
    (folder / "problem.json").write_bytes(problem)
    command = [sys.executable, "-I", "-S", "checker.py", "certificate.json", "problem.json"]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=120)


def test_every_case_gets_its_exit_code():
    """Claims whose truth is known, and twins that just fail in one place each."""
    wrong = [case.name for case in region_cases() if outcome(case) != case.code]
    assert wrong == []
    assert sum(case.code == HOLDS for case in region_cases()) > 25
    assert sum(case.code == FAILS for case in region_cases()) > 100


@pytest.mark.parametrize("name", ["paper-fixed", "paper-switching"])
def test_the_two_lone_files_confirm_a_region_of_the_paper(tmp_path, name):
    problem = load_problem(name)
    proof = certify(problem)
    assert "max-separable" in {check.id for check in proof.checks}
    done = alone(
        tmp_path, ["checker.py", "region_checker.py"], certificate_bytes(proof.claims), canonical_bytes(problem)
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert "holds  max-separable : proved" in done.stdout


def test_without_its_second_file_the_checker_says_what_it_needs(tmp_path):
    """A certificate with regional claims cannot be read; one without them needs the one file only."""
    case = region_cases()[0]
    done = alone(tmp_path, ["checker.py"], case.certificate, case.problem)
    assert (done.returncode, done.stderr) == (2, "")
    assert "needs region_checker.py beside it" in done.stdout
    done = alone(tmp_path, ["checker.py"], certificate("line"), canonical_bytes(problems()["line"]))
    assert (done.returncode, done.stderr) == (0, "")


def test_a_certificate_without_regional_claims_never_loads_the_second_file(monkeypatch):
    def refuse() -> None:
        raise AssertionError("it is not needed")

    monkeypatch.setattr(checker, "sibling", refuse)
    assert all(holds for holds, _ in checker.examine(certificate("line"), canonical_bytes(problems()["line"])))


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
        assert outcome(Case(h, data, canonical_bytes(problem), code)) == code


def test_two_agents_that_hear_each_other_keep_their_alpha_to_nine_digits():
    """-|y|, both pinned with 5, v = 1: alpha = 3 exactly; sin on [-5/2 s, -s/2]: sin 3 / 1.8 at s = 6/5."""
    sharp = mpmath.sin(3) / mpmath.mpf("1.8")
    for name, check, alpha in (("bent", BENT, 3.0), ("sine", SINE, float(sharp))):
        for factor, code in ((1 - 1e-9, HOLDS), (1 + 1e-9, FAILS)):
            data = certificate(name, changed(check, alpha=f"{alpha * factor:.15f}"))
            assert outcome(Case(name, data, canonical_bytes(problems()[name]), code)) == code


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
    assert outcome(Case("", data, problem, FAILS)) == FAILS
    assert time.process_time() - start < 10


# --- Enclosures -----------------------------------------------------------------------------------------------------
DERIVATIVES = {
    "exp": (mpmath.exp, mpmath.exp),
    "log": (mpmath.log, lambda x: 1 / x),
    "sqrt": (mpmath.sqrt, lambda x: 1 / (2 * mpmath.sqrt(x))),
    "sin": (mpmath.sin, mpmath.cos),
    "cos": (mpmath.cos, lambda x: -mpmath.sin(x)),
    "tan": (mpmath.tan, lambda x: 1 + mpmath.tan(x) ** 2),
    "atan": (mpmath.atan, lambda x: 1 / (1 + x * x)),
    "tanh": (mpmath.tanh, lambda x: 1 / mpmath.cosh(x) ** 2),
    "sinh": (mpmath.sinh, mpmath.cosh),
    "cosh": (mpmath.cosh, mpmath.sinh),
    "abs": (abs, mpmath.sign),
}


def test_every_function_of_the_grammar_is_enclosed_here():
    assert set(DERIVATIVES) | {"min", "max", "clip"} == set(checker.FUNCTIONS)
    assert set(DERIVATIVES) == set(region_checker.FUNCTIONS)


def intervals(name: str, count: int) -> list[tuple[float, float]]:
    """Intervals of all sizes, single numbers among them."""
    r, found = random.Random(name), []
    for _ in range(count):
        size = 10 ** r.uniform(-6, 1.5)
        a, b = sorted((r.uniform(-size, size), r.uniform(-size, size)))
        if name in ("log", "sqrt"):
            a, b = sorted((abs(a) + 1e-9, abs(b) + 1e-9))
        found.append((a, a if r.random() < 0.2 else b))
    return found


@pytest.mark.parametrize("name", sorted(DERIVATIVES))
@pytest.mark.parametrize("count", [60, pytest.param(1000, marks=pytest.mark.slow)])
def test_enclosures_of_values_and_slopes_hold_random_points(name, count):
    """12 in each of up to 1000 intervals; the oracle is mpmath at 200 bits."""
    r, (function, derivative) = random.Random(name + "points"), DERIVATIVES[name]
    seen = 0
    with mpmath.workprec(200):
        for a, b in intervals(name, count):
            try:
                value, (slope,) = region_checker.function_jet(name, ((a, b), (region_checker.ONE,)))
            except region_checker.Refused:
                assert name == "tan"
                continue
            for x in (a, b, *(r.uniform(a, b) for _ in range(10))):
                exact = mpmath.mpf(x)
                assert value[0] <= function(exact) <= value[1]
                assert slope[0] <= derivative(exact) <= slope[1]
                seen += 1
    assert seen > (9 if name == "tan" else 11) * count


COMPOSED = {
    "min(y, y**2, 1 - y)": lambda y: min(y, y**2, 1 - y),
    "max(y**3 - y, -y/2)": lambda y: max(y**3 - y, -y / 2),
    "clip(2*y, -1, y**2 + 1/3)": lambda y: max(-1, min(2 * y, y**2 + mpmath.mpf(1) / 3)),
    "tanh(y)*exp(-y**2)/(2 + sin(3*y))": lambda y: mpmath.tanh(y) * mpmath.exp(-(y**2)) / (2 + mpmath.sin(3 * y)),
    "(y + 1/10)**-3 + 0.1*pi*y": lambda y: (y + mpmath.mpf(1) / 10) ** -3 + mpmath.mpf("0.1") * mpmath.pi * y,
    "-y**4 + 7*y**5 - 1e-3": lambda y: -(y**4) + 7 * y**5 - mpmath.mpf("1e-3"),
}


@pytest.mark.parametrize("source", sorted(COMPOSED))
@pytest.mark.parametrize("count", [60, pytest.param(1000, marks=pytest.mark.slow)])
def test_enclosures_of_compositions_hold_random_points_and_all_their_secants(source, count):
    """Slopes of kinked functions are Clarke's: they bound every secant inside the interval."""
    r, formula, h = random.Random(source), region_checker.Formula(source, ["y"]), COMPOSED[source]
    seen = 0
    with mpmath.workprec(200):
        for a, b in intervals(source, count):
            try:
                value, slopes = formula.at(((a, b), (region_checker.ONE,)))
            except region_checker.Refused:
                continue
            slope = slopes[0] if slopes else region_checker.NOTHING
            points = [mpmath.mpf(r.uniform(a, b)) for _ in range(10)]
            for x, y in zip(points, [mpmath.mpf(b), *points], strict=False):
                assert value[0] <= h(x) <= value[1]
                gap = mpmath.mpf(2) ** -150 * (1 + abs(h(x)))
                assert min(slope[0] * (y - x), slope[1] * (y - x)) - gap <= h(y) - h(x)
                assert h(y) - h(x) <= max(slope[0] * (y - x), slope[1] * (y - x)) + gap
                seen += 1
    assert seen > 5 * count


@pytest.mark.parametrize("n", [0, 1, 2, 3, 4, 7, 10])
def test_arithmetic_is_rounded_outward(n):
    """Against exact rational arithmetic at the ends of random intervals."""
    r = random.Random(n)
    for _ in range(300):
        x, y = (tuple(sorted((r.uniform(-3, 3), r.uniform(-3, 3)))) for _ in range(2))
        ends = [Fraction(a) * Fraction(b) for a in x for b in y]
        lo, hi = region_checker.times(x, y)
        assert Fraction(lo) <= min(ends) <= max(ends) <= Fraction(hi)
        lo, hi = region_checker.added(x, y)
        assert Fraction(lo) <= Fraction(x[0]) + Fraction(y[0]) <= Fraction(x[1]) + Fraction(y[1]) <= Fraction(hi)
        lo, hi = region_checker.power(x, n)
        inside = [Fraction(a) ** n for a in (*x, *([0.0] if x[0] < 0 < x[1] else []))]
        assert Fraction(lo) <= min(inside) <= max(inside) <= Fraction(hi)
        if not y[0] <= 0 <= y[1]:
            lo, hi = region_checker.divided(x, y)
            assert Fraction(lo) <= min(Fraction(a) / Fraction(b) for a in x for b in y)
            assert max(Fraction(a) / Fraction(b) for a in x for b in y) <= Fraction(hi)


def test_products_of_known_signs_keep_them_where_floats_underflow():
    tiny = 5e-324
    assert region_checker.times((tiny, 1.0), (tiny, 1.0))[0] == 0
    assert region_checker.times((-1.0, -tiny), (tiny, 1.0))[1] == 0
    assert region_checker.times((-tiny, 0.0), (0.0, tiny))[0] < 0


def test_the_table_of_a_coupling_names_its_rising_and_falling_stretches():
    """sin rises on [-pi/2, pi/2] and falls to the left of it down to -3 pi/2."""
    curve = region_checker.Curve(region_checker.Formula("sin(y)", ["y"]), False)
    curve.prepare(-4.0, 1.0)
    ways = [cell.way for cell in curve.table if cell.way]
    assert ways == [-1, 1]
    rising = next(cell for cell in curve.table if cell.way == 1)
    assert rising.lo == pytest.approx(-mpmath.pi / 2, abs=2e-3)
    assert rising.lo >= -mpmath.pi / 2
