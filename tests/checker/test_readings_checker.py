"""The lone checker's part about late and held readings, and about processors."""

import json
import math
import random
from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import mpmath
import numpy as np
import pytest
from certified import only
from checker_files.files import accepted_by, check_of
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import linalg

import dobc_design as dd
from dobc_design.certificate.text import certificate_bytes
from dobc_design.checker import sampled, separable
from dobc_design.checker.matrices import characteristic

F = Fraction


# --- exp(A T), and its mean
@pytest.mark.parametrize("size", [1, 2, 4])
@pytest.mark.parametrize("scale", [F(1, 100), F(1), F(30)])
def test_exponentials_and_their_means_are_enclosed(size: int, scale: Fraction):
    draw = random.Random(f"{size} {scale}")
    X = [[F(draw.randint(-9, 9), 9) * scale for _ in range(size)] for _ in range(size)]
    whole, mean = sampled.with_mean(X)
    mpmath.mp.dps = 120
    block = mpmath.matrix(2 * size)
    for i, row in enumerate(X):
        block[i, size + i] = 1
        for j, x in enumerate(row):
            block[i, j] = mpmath.mpf(x.numerator) / x.denominator
    truth = mpmath.expm(block)
    for ball, first in ((whole, 0), (mean, size)):
        worst = max(
            sum(
                abs(ball.entries[i][j] - truth[i, first + j] * 2**sampled.BITS) for j in range(size)
            )
            for i in range(size)
        )
        assert worst <= ball.missed
    # what is not known is far below what anything depends on
    assert max(whole.missed, mean.missed) < 2 ** (sampled.BITS - 100)


def test_what_grows_too_far_is_refused_in_no_time():
    with pytest.raises(Exception, match="too large to be followed"):
        sampled.with_mean([[F(10**30)]])


# --- Jury's table
@given(st.lists(st.integers(-20, 20), min_size=1, max_size=6), st.integers(1, 20))
@settings(max_examples=300, deadline=None)
def test_jury_says_of_polynomials_what_their_roots_say(rest: list[int], first: int):
    p = [first, *rest]
    found = sampled.inside([(F(c), F(c)) for c in p])
    largest = max(np.abs(np.roots(p)), default=0.0)
    if abs(largest - 1) > 1e-3:
        assert found is bool(largest < 1)


def test_a_root_on_the_circle_is_not_inside_and_one_that_may_be_on_either_side_is_open():
    assert sampled.inside([(F(1), F(1)), (F(-1), F(-1))]) is False
    assert sampled.inside([(F(1), F(1)), (F(-1), F(-99, 100))]) is None
    assert sampled.inside([(F(1), F(1)), (F(-98, 100), F(-99, 100))[::-1]]) is True
    # (z - 1)(z + 1)(z - 1/2)
    exact = [F(1), F(-1, 2), F(-1), F(1, 2)]
    assert sampled.inside([(c, c) for c in exact]) is False


@given(st.integers(0, 10**6))
@settings(max_examples=50, deadline=None)
def test_polynomials_of_matrices_nearby_are_enclosed(seed: int):
    draw = random.Random(seed)
    size = draw.randint(1, 4)
    off = F(1, draw.choice([2, 50, 10**6]))
    X = [[F(draw.randint(-9, 9), 7) for _ in range(size)] for _ in range(size)]
    found = sampled.spread_out(X, off)
    for _ in range(5):
        near = []
        for row in X:
            step = [F(draw.randint(-9, 9)) for _ in row]
            left = off / (sum(map(abs, step)) or 1)
            near.append([x + left * d for x, d in zip(row, step, strict=True)])
        for (lo, hi), c in zip(found, characteristic(near), strict=True):
            assert lo <= c <= hi


# --- Eigenvalues nearby
@given(
    st.lists(st.tuples(st.integers(-9, 9), st.integers(1, 4)), min_size=1, max_size=4),
    st.integers(-40, 40),
    st.integers(-40, 40),
)
@settings(max_examples=200, deadline=None)
def test_a_root_is_as_near_as_it_is_said_to_be(roots: list[tuple[int, int]], x: int, y: int):
    p = [F(1)]
    for root, times in roots:
        for _ in range(times):
            p = [a - root * b for a, b in zip([*p, F(0)], [F(0), *p], strict=True)]
    off = separable.to_a_root(p, F(x, 4), F(y, 4))
    nearest = min(math.hypot(x / 4 - root, y / 4) for root, _ in roots)
    assert nearest <= float(off) * (1 + 1e-9)


def test_an_eigenvalue_of_many_is_found_by_what_floats_say_of_it():
    """The complete graph of 20 has the eigenvalue 20 nineteen times."""
    p = [F(1)]
    for root in (1, *[20] * 19):
        p = [a - root * b for a, b in zip([*p, F(0)], [F(0), *p], strict=True)]
    near = F(float(np.nextafter(20, 21)))
    assert 0 < separable.to_a_root(p, near, F(0)) < F(1, 10**12)
    assert separable.to_a_root(p, F(20), F(0)) == 0


# --- Both programs, of numbers that are moved
CYCLE = dd.Network.from_arcs([[1, 2], [2, 3], [3, 1]], arrow="listens_to")
WAVE = dd.Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]])
REGION = {"initial_states": [-1, 1], "initial_disturbance": "1/2"}
STATED: dict[str, dict[str, Any]] = {
    "late": {"readings": {"delay": "3/10", "own_delay": "1/50", "event": "1/50"}},
    "held": {"readings": {"period": "1/50", "own_delay": "1/50", "lost": 1}},
    "processor": {"processor": {"period": "1/20"}, "readings": {"delay": "1/10"}},
}
FACTORS = (F(1, 2), F(19, 20), F(21, 20), F(2))


@pytest.fixture(scope="module", params=STATED)
def certificate(request: pytest.FixtureRequest) -> dd.Certificate:
    problem = dd.Problem(
        network=CYCLE, coupling="tanh(y)", gains={1: 2, 3: 2}, exosystem=WAVE, region=REGION,
        **STATED[request.param],
    )  # fmt: skip
    with only():
        return dd.certify(problem)


def test_every_number_of_a_proof_is_needed_and_both_programs_say_so(certificate: dd.Certificate):
    """Moved one way or the other each is refused at the latest at twice or half of it; on the way
    both programs agree."""
    assert certificate.verdict is dd.Verdict.PROVED
    document = json.loads(certificate_bytes(certificate.claims))
    exact = check_of(document, "readings")["exact"]
    keys = ["alpha", "rho", "beta", "kappa", "size", *((k, "v") for k in range(3))]
    keys += [((a, b), "P") for a, b in ((0, 0), (1, 1))]
    assert set(exact) == {"v", "P", "alpha", "rho", "beta", "kappa", "size"}
    for key in keys:
        refused = 0
        for factor in FACTORS:
            changed = json.loads(json.dumps(document))
            _scale(check_of(changed, "readings")["exact"], key, factor)
            package, alone = accepted_by(changed, certificate.problem)
            assert package is alone, (key, factor)
            refused += not alone
        assert refused, key


def _scale(exact: dict[str, Any], key: Any, factor: Fraction) -> None:
    if isinstance(key, str):
        exact[key] = str(F(exact[key]) * factor)
        return
    place, name = key
    holder = exact[name]
    while isinstance(place, tuple):
        first, place = place
        holder = holder[first]
    holder[place] = str(F(holder[place]) * factor)


def test_what_a_proof_says_of_itself_is_not_moved_up(certificate: dd.Certificate):
    document = json.loads(certificate_bytes(certificate.claims))
    for key, factor in (("rate", 1.001), ("factor", 0.999), ("radius", 2), ("disturbance", 3)):
        changed = json.loads(json.dumps(document))
        check = check_of(changed, "readings")
        holder = check if key in check else check["domain"]
        holder[key] *= factor
        if key in changed:
            changed[key] = holder[key]
        assert accepted_by(changed, certificate.problem) == (False, False), key


@only()
def test_shorter_times_are_proved_by_the_same_numbers_and_longer_ones_are_not():
    """The claim is about what the problem states."""
    made = {}
    for delay in ("1/10", "1/5", "1"):
        problem = dd.Problem(
            network=CYCLE, coupling="y", gains={1: 2, 3: 2}, readings={"delay": delay}
        )
        made[delay] = problem, json.loads(certificate_bytes(dd.certify(problem).claims))
    checks = [check_of(made["1/5"][1], "readings")]
    for delay, holds in (("1/10", True), ("1", False)):
        problem, document = made[delay]
        own = check_of(document, "readings")
        document["checks"] = [check for check in document["checks"] if check is not own] + checks
        for key in ("rate", "factor"):
            document[key] = checks[0][key]
        assert accepted_by(document, problem) == (holds, holds)


def test_the_sampled_observer_of_the_second_program_is_that_of_scipy():
    A, C, W = [[F(0), F(2)], [F(-2), F(0)]], [[F(1), F(0)]], [[F(16, 5)], [F(12, 5)]]
    timing = SimpleNamespace(period=F(1, 10), steps=False)
    found = sampled.ticks(SimpleNamespace(A=A, C=C, W=W), timing)
    step = linalg.expm(np.array(A, dtype=float) / 10)
    mean = np.linalg.solve(np.array(A, dtype=float), step - np.eye(2)) * 10
    loop = step - 0.1 * np.array(W, dtype=float) @ np.array(C, dtype=float) @ mean
    assert np.array(found.F, dtype=float) == pytest.approx(loop, abs=1e-13)
    assert max(abs(np.linalg.eigvals(loop))) == pytest.approx(0.840267, abs=1e-6)
