"""The path for large networks against the one for small ones, on problems that both can take."""

import json
from base64 import b64decode, b64encode
from fractions import Fraction
from functools import cache

import numpy as np
import pytest
from networks import cycle, listening
from random_problems import random_linear_problem, random_problem
from texts import exosystem_of

from dobc_design import Verdict, certify
from dobc_design.certificate.text import certificate_bytes
from dobc_design.certification.recheck import recheck
from dobc_design.checker import examine as checker
from dobc_design.conditions.consensus import claim, propose
from dobc_design.conditions.consensus.propose import float_lambda
from dobc_design.loop.make import loop_of
from dobc_design.problem.canonical import canonical_bytes


@pytest.fixture
def as_large(monkeypatch):
    """Every network counts as large."""
    monkeypatch.setattr(claim, "LARGE_ROWS", 0)
    monkeypatch.setattr(propose, "LARGEST_DENSE", 0)


def held(n=30, *, h="exp(y) - 1 + y", step=3):
    """Both neighbours are heard, every third agent is pinned, with an oscillator for every
    agent."""
    arcs = [[i, (i + k) % n or n] for i in range(1, n + 1) for k in (1, n - 1)]
    oscillator = exosystem_of("0 2; -2 0", "1 0")
    pinned = range(1, n + 1, step)
    gains = dict.fromkeys(pinned, 3)
    return listening(arcs, h, n=n, gains=gains, exosystem=oscillator)


@cache
def certified(problem):
    """What ``as_large`` certifies."""
    return certify(problem)


def accepted(certificate, problem):
    """By the package, and by the lone checker; a certificate or its bytes."""
    data = certificate if isinstance(certificate, bytes) else certificate_bytes(certificate.claims)
    findings = checker.examine(data, canonical_bytes(problem))
    lone = all(holds for holds, _ in findings)
    return recheck(data, problem).holds, lone


@pytest.mark.parametrize("h", ["exp(y) - 1 + y", "sin(pi*y)", "y"])
def test_the_vector_stands_in_the_certificate_and_both_programs_accept_it(as_large, h):
    problem = held(h=h)
    certificate = certified(problem)
    lemma = certificate.check("lemma1")
    theorem = certificate.check("theorem1")
    lambda_float = float_lambda(loop_of(problem), "G").toarray()
    eigenvalues = np.linalg.eigvalsh(lambda_float)
    top = eigenvalues[-1]
    assert 0.97 * -top <= lemma.margin <= -top
    assert theorem.verdict is Verdict.PROVED
    v_bytes = b64decode(lemma.exact["v"]["float64"])
    assert len(v_bytes) == 8 * problem.n
    assert accepted(certificate, problem) == (True, True)


@pytest.mark.parametrize(
    "seed", [1, *(pytest.param(k, marks=pytest.mark.slow) for k in (0, 2, 3, 4, 5))]
)
def test_both_paths_come_to_the_same_verdicts(seed, request):
    """Vectors, matrix gains, irrational and negative slopes, several modes; margins differ by what
    is left unsought."""
    problem = random_problem(seed) if seed % 2 else random_linear_problem(seed)
    plain = {(c.id, c.mode): c for c in certify(problem).checks}
    request.getfixturevalue("as_large")
    large = certify(problem)
    found = {key: c.verdict for key, c in plain.items()}
    expected = {(c.id, c.mode): c.verdict for c in large.checks}
    assert found == expected
    for check in large.checks:
        other = plain[check.id, check.mode]
        if check.id == "lemma1" and check.verdict is Verdict.PROVED and other.margin:
            assert check.margin <= other.margin * (1 + 1e-6)
            assert check.margin >= 0.5 * other.margin
    assert accepted(large, problem) == (True, True)


@pytest.mark.parametrize("change", [0.0, 1e-3, "ones", "negative", "short", "nan", "no base64"])
def test_a_margin_beyond_the_vector_or_a_forged_vector_is_refused_by_both(as_large, change):
    """The twin with no more margin is accepted."""
    problem = held()
    document = json.loads(certificate_bytes(certified(problem).claims))
    lemma = next(each for each in document["checks"] if each["id"] == "lemma1")
    if isinstance(change, float):
        lemma["margin"] *= 1 + change
    else:
        v_text = lemma["exact"]["v"]
        v_raw = b64decode(v_text["float64"])
        v = np.frombuffer(v_raw, dtype="<f8")
        ones = np.ones(problem.n)
        not_numbers = np.full(problem.n, np.nan)
        forged = {"ones": ones, "negative": -v, "short": v[:-1], "nan": not_numbers}
        lemma["exact"]["v"]["float64"] = (
            b64encode(forged[change].tobytes()).decode() if change in forged else "?"
        )
    answers = accepted(json.dumps(document).encode(), problem)
    expected = (change == 0.0,) * 2
    assert answers == expected


def test_an_unpinned_part_is_refuted_by_the_large_path_too(as_large):
    """Theory, section 2: the agents that nobody holds, moved together."""
    arcs = [[1, 2], [2, 1], [3, 4], [4, 3]]
    problem = listening(arcs, "y", n=4, gains={1: 3})
    certificate = certify(problem)
    lemma = certificate.check("lemma1")
    assert lemma.verdict is Verdict.REFUTED
    assert lemma.witness.labels == ("3", "4")
    assert accepted(certificate, problem) == (True, True)


def test_a_network_of_more_than_2000_rows_carries_its_vector():
    gains = dict.fromkeys(range(1, 2101), 5)
    problem = cycle(2100, gains=gains)
    certificate = certify(problem)
    lemma = certificate.check("lemma1")
    assert set(lemma.exact) == {"v"}
    assert Fraction(99, 10) < Fraction(lemma.margin) <= 10
    assert recheck(certificate.claims, problem).holds
