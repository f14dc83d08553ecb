"""The lone checker's part about quadratic certificates, and changed claims."""

import json
from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import pytest
from broken_certificates import mutate
from checker_files.files import accepted_by, second_loop
from checker_files.separable import CUBIC, certificate, problems
from regional_problems import HARMONIC, PAPER_GAIN

from dobc_design import Network, Observer, Problem, Region, certify
from dobc_design.certificate.factors import with_factors
from dobc_design.certificate.text import certificate_bytes
from dobc_design.checker import quadratic
from dobc_design.checker.loop import Loop
from dobc_design.conditions.case import Case
from dobc_design.conditions.coverage import read_region
from dobc_design.conditions.domain import NEAR_TARGET
from dobc_design.conditions.quadratic.stage import quadratic_stage
from dobc_design.loop.make import loop_of


def test_a_list_with_a_clipped_expression_needs_the_radius():
    """clip(y1, -1, 1) is not linear although two of its three arguments are constants; y2 is."""
    listed = [[2, 1]]
    arcs = Network.from_arcs(listed, arrow="listens_to", agents=2)
    problem = Problem(network=arcs, coupling=["clip(y1, -1, 1)", "y2"], gains=1, target=[0, 0])
    assert quadratic.relied(second_loop(problem)) == {(2, 0)}


def reader(h: Any) -> tuple[Loop, str]:
    """Agent 2 of three hears agent 3 with weight 2; two components."""
    listed = [[2, 3, 2]]
    arcs = Network.from_arcs(listed, arrow="listens_to", agents=3)
    problem = Problem(network=arcs, coupling=h, gains=1, target=[0, 0])
    loop = second_loop(problem)
    return loop, *loop.modes


def test_channels_of_several_components_lead_from_the_differences_to_the_rows():
    loop, mode = reader(["y1 + y2", "y2"])
    first = ((1, 3), (0, 0))
    second = ((1, 1), (0, 4))
    gains = [[(Fraction(lo), Fraction(hi)) for lo, hi in row] for row in (first, second)]
    found = quadratic.channels(loop, mode, {loop.functions[0]: gains})
    assert found == [(2, 2, 4, 4, 2), (3, 2, 4, 2, 0), (3, 3, 5, 4, 4)]


def test_agents_meet_their_own_costs():
    agents = SimpleNamespace(q=0, m=1, nodes=range(3), block=lambda S, i: [[Fraction(i)]])
    costs = quadratic.noise(agents, None)
    diagonal = [row[i] for i, row in enumerate(costs)]
    expected = [0, 1, 2]
    assert diagonal == expected


def ring(n: int, *, coupling: str, gains: object, s: Fraction | None = None) -> Problem:
    agents = range(1, n + 1)
    arcs = [[i, i % n + 1] for i in agents]
    lower = Fraction(-1, 2)
    region = Region(initial_states=((lower, Fraction(1, 2)),), initial_disturbance=s)
    observed = {} if s is None else {"exosystem": HARMONIC, "observer": Observer(W=PAPER_GAIN)}
    network = Network.from_arcs(arcs, arrow="listens_to", agents=n)
    return Problem(
        network=network, coupling=coupling, gains=gains, target=0, region=region, **observed
    )


def judged_alike(
    document: dict[str, Any], check: dict[str, Any], problem: Problem, *, count: int
) -> None:
    """Both programs accept the check in the document, and refuse the same of ``count`` changes of
    it."""
    document = document | {"checks": [*document["checks"], check]}
    assert accepted_by(document, problem) == (True, True)
    refused = 0
    for seed in range(count):
        first = {"it": document["checks"][0]}
        mutated = mutate({"it": check}, seed, other=first)
        changed = mutated.get("it")
        if not isinstance(changed, dict) or changed == check:
            continue
        checks = [changed if each is check else each for each in document["checks"]]
        mutant = document | {
            "checks": checks,
            "rate": changed.get("rate"),
            "factor": changed.get("factor"),
        }
        package, lone = accepted_by(mutant, problem)
        assert package is lone, (seed, changed)
        refused += not package
    assert refused > 0.7 * count


def test_what_one_program_refuses_of_a_claim_by_hand_the_other_refuses():
    document = json.loads(certificate("cubic", CUBIC))
    others = document["checks"][:-1]
    document["checks"], check = others, document["checks"][-1]
    judged_alike(document, check, problems()["cubic"], count=20)


@pytest.mark.slow
@pytest.mark.parametrize(("s", "count"), [(None, 10), (Fraction(1, 10), 20)])
def test_what_one_program_refuses_the_other_refuses(s: Fraction | None, count: int):
    problem = ring(3, coupling="exp(y) - 1 + y", gains=3, s=s)
    document = json.loads(certificate_bytes(certify(problem).claims))
    asked = read_region(loop_of(problem), problem.observer.W, domain=NEAR_TARGET, everything=False)
    proofs = tuple(quadratic_stage(asked, lambda _: None)[:1])
    case = Case(loop=asked.loop, W=asked.W, domain=asked.domain, checks=proofs)
    found = with_factors(case)
    check = json.loads(json.dumps(found[0].to_json()))
    regional = ("max-separable", "delay", "sampling", "lure", "tolerance")
    document["checks"] = [each for each in document["checks"] if each["id"] not in regional]
    document |= {
        "verdict": "proved",
        "rate": check["rate"],
        "factor": check["factor"],
        "covered_by": "lure",
    }
    judged_alike(document, check, problem, count=count)
