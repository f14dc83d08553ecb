"""Changed lure and exhaustive checks: the two programs that decide them never disagree."""

from __future__ import annotations

import json
from contextlib import suppress
from fractions import Fraction

import pytest
from checker_cases import HOLDS, outcome
from lure_cases import HARMONIC, PAPER_GAIN
from mutants import mutate

from dobc_design.certificate.text import certificate_bytes
from dobc_design.certification.certify import certify
from dobc_design.certification.recheck import recheck
from dobc_design.conditions.boxes.stage import exhaustive_stage
from dobc_design.conditions.coverage import read_region
from dobc_design.conditions.quadratic.stage import quadratic_stage
from dobc_design.errors import CertificateError
from dobc_design.problem.canonical import canonical_bytes
from dobc_design.problem.groups import Observer
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem
from dobc_design.problem.settings import Region


def ring(n: int, *, coupling: str, gains: object, s: Fraction | None = None) -> Problem:
    arcs = [[i, i % n + 1] for i in range(1, n + 1)]
    region = Region(initial_states=((Fraction(-1, 2), Fraction(1, 2)),), initial_disturbance=s)
    observed = {} if s is None else {"exosystem": HARMONIC, "observer": Observer(W=PAPER_GAIN)}
    network = Network.from_arcs(arcs, arrow="listens_to", agents=n)
    return Problem(network=network, coupling=coupling, gains=gains, target=0, region=region, **observed)


def accepted_by(document: dict[str, object], problem: Problem) -> tuple[bool, bool]:
    """Whether the package and the lone checker accept; what cannot be read is refused."""
    data = json.dumps(document).encode()
    package = False
    with suppress(CertificateError):
        package = recheck(data, problem).holds
    return package, outcome(data, canonical_bytes(problem)) == HOLDS


@pytest.mark.parametrize(
    ("id", "problem", "count"),
    [
        ("lure", ring(3, coupling="exp(y) - 1 + y", gains=3), 40),
        pytest.param(
            "lure", ring(3, coupling="exp(y) - 1 + y", gains=3, s=Fraction(1, 10)), 250, marks=pytest.mark.slow
        ),
        pytest.param("exhaustive", ring(2, coupling="sin(y)", gains={1: 3}), 120, marks=pytest.mark.slow),
    ],
)
def test_what_one_program_refuses_the_other_refuses(id, problem, count):
    document = json.loads(certificate_bytes(certify(problem).claims))
    stage = quadratic_stage if id == "lure" else exhaustive_stage
    asked = read_region(problem, problem.observer.W, domain="consensus", everything=id == "exhaustive")
    check = json.loads(json.dumps(stage(asked, lambda _: None)[0].to_json()))
    regional = ("max-separable", "delay", "sampling", "lure", "exhaustive")
    document["checks"] = [*(each for each in document["checks"] if each["id"] not in regional), check]
    document |= {"verdict": "proved", "rate": check["rate"], "covered_by": id}
    assert accepted_by(document, problem) == (True, True)
    refused = 0
    for seed in range(count):
        changed = mutate({"it": check}, seed, other={"it": document["checks"][0]}).get("it")
        if not isinstance(changed, dict) or changed == check:
            continue
        mutant = document | {
            "checks": [changed if each is check else each for each in document["checks"]],
            "rate": changed.get("rate"),
        }
        package, lone = accepted_by(mutant, problem)
        assert package is lone, (seed, changed)
        refused += not package
    assert refused > 0.7 * count
