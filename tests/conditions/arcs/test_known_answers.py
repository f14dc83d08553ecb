"""Radii of the theory (section 20), and linear couplings, where arc-wise shares exist iff V'
decreases."""

from fractions import Fraction
from random import Random
from typing import Any

import numpy as np
import pytest
from arc_wise import claimed, radius_of, searched
from networks import around, linked, random_arcs

from dobc_design import Problem
from dobc_design.conditions.arcs.decide import why_not
from dobc_design.conditions.arcs.propose import Search
from dobc_design.exact.symmetric import Doubles
from dobc_design.loop.make import loop_of

F = Fraction
PAPER = "exp(y) - 1 + y"
PART = 0.97  # of the theory's radii, which are those of grids
ONE = {2: 3.78, 3: 3.53, 4: 3.23, 6: 3.03, 10: 2.88}
OFTEN = (4,)


def cycle(n: int, h: str, pinned: int) -> Problem:
    return linked(around(n), n, h, gains=dict.fromkeys(range(1, pinned + 1), 3))


@pytest.mark.parametrize(
    "n", [n if n in OFTEN else pytest.param(n, marks=pytest.mark.slow) for n in ONE]
)
def test_one_pin_holds_the_ball_of_the_theory_and_not_three_per_cent_more(n: int):
    radius = ONE[n]
    found = radius_of(searched(cycle(n, PAPER, 1)))
    assert PART * radius < found < radius / PART


@pytest.mark.parametrize("n", [2, 3, 4, 6, 10])
def test_all_pinned_the_ball_does_not_depend_on_the_number_of_agents(n: int):
    found = radius_of(searched(cycle(n, PAPER, n)))
    assert PART * 6.02 < found < 6.03


@pytest.mark.parametrize(("h", "n", "radius"), [("sin(y)", 4, 2.07), ("sin(y)", 10, 1.88)])
def test_couplings_that_turn_have_balls_beyond_the_turning_point(h: str, n: int, radius: float):
    """|y| <= sqrt(2) 1.88 > pi/2."""
    found = radius_of(searched(cycle(n, h, 1)))
    assert found > PART * radius


def test_the_ball_of_a_cubic_coupling_is_that_of_the_split_of_degree_two():
    found = radius_of(searched(cycle(4, "y + y**3", 1)))
    assert PART * 2.19 < found < 2.19 / PART


def test_no_ball_of_the_sine_reaches_the_equilibrium_beside_the_target():
    """V = e'e does not decrease at e = (0, pi)."""
    assert radius_of(searched(cycle(2, "sin(y)", 1))) < np.pi


# --- Linear couplings
@pytest.mark.parametrize(("error", "proved"), [("0.142", True), ("0.144", False)])
def test_a_linear_arc_that_errs_is_proved_iff_the_inequality_holds_at_the_worst_ends(
    error: str, proved: bool
):
    """S = [[2 k, -w], [-w, 2 w]] > 0 iff w < 4 k: for w = 1 and k = 1/3 while the error of both is
    below 1/7."""
    off = {"weights": error, "gains": error}
    loop = loop_of(linked([[2, 1, 1]], 2, "y", gains={1: F(1, 3)}, uncertainty=off))
    b = (1 + F(error)) / 2
    found = claimed(loop, [F(-1, 10**4)], [b + F(1, 10**4)], level=1, rate=F(1, 10**5))
    assert (why_not(loop, found) is None) is proved
    # With less than half of the largest weight the arc takes more than it may.
    less = claimed(loop, [F(-1, 10**4)], [b - F(1, 10**4)], level=1, rate=F(1, 10**5))
    assert ("hears 1 takes more" in str(why_not(loop, less))) is proved


def stiffness(problem: Problem, g: F) -> list[list[F]]:
    """M = K + g L."""
    n = problem.n
    M = [[F(0)] * n for _ in range(n)]
    for i, gain in problem.pinning.gains.items():
        M[i][i] += gain[0][0]
    for i, j, w in problem.network.modes["G"]:
        M[i][i] += g * w
        M[i][j] -= g * w
    return M


def weighed(M: list[list[F]], d: list[F]) -> list[list[F]]:
    """S = D M + M'D."""
    n = len(d)
    return [[d[i] * M[i][j] + M[j][i] * d[j] for j in range(n)] for i in range(n)]


def solved(S: list[list[F]]) -> list[F] | None:
    """w with S w = 1 in fractions; None where a pivot is not positive, so that S > 0 fails."""
    n = len(S)
    rows = [[*row, F(1)] for row in S]
    for k in range(n):
        if rows[k][k] <= 0:
            return None
        for i in range(k + 1, n):
            part = rows[i][k] / rows[k][k]
            rows[i] = [x - part * y for x, y in zip(rows[i], rows[k], strict=True)]
    w = [F(0)] * n
    for k in reversed(range(n)):
        rest = sum((rows[k][j] * w[j] for j in range(k + 1, n)), F(0))
        w[k] = (rows[k][n] - rest) / rows[k][k]
    return w


def random_linear(seed: int) -> tuple[Problem, F, list[F]]:
    r = Random(f"linear arcs {seed}")
    n = r.randint(2, 7)
    arcs = random_arcs(r, n, r.choice((0.3, 0.6)), lambda: F(r.randint(1, 6), 2)) or [[1, 2, 1]]
    gains = {i: F(r.randint(1, 8), 2) for i in range(1, n + 1) if r.random() < 0.6} or {1: 1}
    g = F(r.randint(1, 6), 3)
    d = [F(r.randint(8, 16), 16) for _ in range(n)]
    return linked(arcs, n, f"({g})*y", gains=gains), g, d


def closed_form(problem: Problem, g: F, d: list[F], w: list[F], spare: F) -> Any:
    """a = d_i g w_ij (w_j / w_i - 2), b = d_i g w_ij w_i / w_j, and a little more of both."""
    a, b = [], []
    for i, j, weight in problem.network.modes["G"]:
        pull = d[i] * g * weight
        a.append(pull * (w[j] / w[i] - 2) + spare)
        b.append(pull * w[i] / w[j] + spare)
    return a, b


@pytest.mark.parametrize("count", [8, pytest.param(100, marks=pytest.mark.slow)])
def test_linear_arcs_are_proved_iff_the_weighted_inequality_holds(count: int):
    """S = D M + M'D > 0, by elimination in fractions; S w > 0 gives every number in closed form."""
    seen = {False: 0, True: 0}
    for seed in range(count):
        problem, g, d = random_linear(seed)
        S = weighed(stiffness(problem, g), d)
        w = solved(S)
        smallest = np.linalg.eigvalsh(np.array(S, dtype=float))[0]
        if abs(smallest) < 0.01:
            continue  # what is searched for keeps a part of this in hand
        loop = loop_of(problem)
        search = Search(
            loop=loop,
            W=None,
            d=Doubles(np.array(d, dtype=float)),
            disturbance=F(0),
            known={},
        )
        found = next(search.claims(1.0), None)
        proved = found is not None and why_not(loop, found) is None
        assert proved is (w is not None), seed
        seen[proved] += 1
        if w is not None:
            rate = F(1, 10**6)
            spare = F(1, 10**9)
            a, b = closed_form(problem, g, d, w, spare)
            claim = claimed(loop, a, b, level=1, rate=rate, d=d)
            assert why_not(loop, claim) is None, seed
            a, b = closed_form(problem, g, d, w, -spare)
            less = claimed(loop, a, b, level=1, rate=rate, d=d)
            assert "the arc by which" in (why_not(loop, less) or "")
    assert min(seen.values()) > 1 + count // 10, seen


def test_shares_for_other_weights_are_refused_where_the_inequality_fails():
    """Whatever positive w the closed form is made of, some agent has less than its arcs take."""
    refused = 0
    for seed in range(60):
        problem, g, d = random_linear(seed)
        if solved(weighed(stiffness(problem, g), d)) is not None:
            continue
        r = Random(f"weights {seed}")
        loop = loop_of(problem)
        for _ in range(5):
            w = [F(r.randint(2, 20)) for _ in d]
            a, b = closed_form(problem, g, d, w, F(1, 10**9))
            claim = claimed(loop, a, b, level=1, rate=F(1, 10**9), d=d)
            assert "take more of" in (why_not(loop, claim) or "")
            refused += 1
    assert refused > 20
