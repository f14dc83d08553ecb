"""A few of what the evidence counts: regions of random problems, changed claims, and truths known from outside."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from exact_oracle import Oracle
from known_regions import equilibria, equilibrium_campaign, linear_campaign, linear_problem
from region_campaigns import change_region, region_mutant_campaign, region_problem, region_recheck_campaign

from dobc_design.certificate.text import certificate_bytes
from dobc_design.certification.certify import certify
from dobc_design.certification.recheck import recheck

QUICK = 8  # a seed with a region that max-separable covers, in well under a second
FAST_PAIR = 3


def test_a_region_of_a_random_problem_is_confirmed_by_both_checkers_and_the_oracle():
    tally = region_recheck_campaign([QUICK])
    assert not tally.wrong, tally.wrong
    assert tally.counts["max-separable proved"] == 1


def test_changed_regional_claims_are_refused_or_true():
    tally = region_mutant_campaign([QUICK], each=25)
    assert not tally.wrong, tally.wrong
    assert tally.counts["refused"] + tally.counts["unreadable"] >= 5


@pytest.mark.parametrize("sign", [0, -1])
@pytest.mark.parametrize("name", ["radius", "rate"])
def test_a_radius_or_a_rate_that_is_not_positive_is_refused_and_false(name: str, sign: int):
    """A max-separable claim with 0 or less for what has to be above 0."""
    problem = region_problem(QUICK)
    document = json.loads(certificate_bytes(certify(problem).claims))
    assert recheck(json.dumps(document).encode(), problem).holds
    assert Oracle(problem).false_claims(document) == []
    check = next(each for each in document["checks"] if each["id"] == "max-separable")
    holder = check["domain"] if name == "radius" else check
    holder[name] = sign * holder[name]
    assert not recheck(json.dumps(document).encode(), problem).holds
    assert any(text.startswith("max-separable") for text in Oracle(problem).false_claims(document))


def test_random_changes_of_regional_claims_reach_the_domain_and_every_exact_value():
    domain = {"kind": "box", "radius": 1.0, "disturbance": 0.5}
    exact = {"v": ["1", "2"], "alpha": "1/2", "rho": "3"}
    check = {"id": "max-separable", "verdict": "proved", "domain": domain, "rate": 0.25, "exact": exact}
    reached = set()
    for seed in range(300):
        changed = change_region({"checks": [check]}, seed)["checks"][0]
        reached |= {name for name in ("verdict", "rate") if changed[name] != check[name]}
        if isinstance(changed["domain"], dict):
            reached |= {name for name in domain if changed["domain"].get(name) != domain[name]}
        reached |= {name for name in exact if changed["exact"].get(name) != exact[name]}
    assert reached == {"verdict", "rate", *domain, *exact}


def test_equilibria_of_two_agents_are_those_of_the_closed_form():
    """One way: h(-e_2) = 0, the zeros of sin; both ways, pinned with 1/10: 2 sin y + y/10 = 0 near 3.31."""
    one_way = [e for e in equilibria(math.sin, 1.0, back=False) if abs(e[1]) < 4]
    assert np.allclose(sorted(one_way), [(0, -math.pi), (0, math.pi)])
    nearest = min((e for e in equilibria(math.sin, 0.1, back=True)), key=lambda e: abs(e[1] - e[0]))
    assert math.isclose(abs(nearest[1] - nearest[0]), 3.3077, rel_tol=1e-3)
    for e in equilibria(math.sin, 0.1, back=True):
        assert abs(math.sin(e[1] - e[0]) - 0.1 * e[0]) < 1e-9
        assert abs(math.sin(e[0] - e[1]) - 0.1 * e[1]) < 1e-9


def test_no_region_of_two_agents_holds_another_equilibrium():
    tally = equilibrium_campaign([FAST_PAIR])
    assert not tally.wrong, tally.wrong
    assert sum(map(len, tally.ratios.values())) >= 1


def test_linear_networks_are_proved_where_the_eigenvalues_are_stable_and_never_too_fast():
    tally = linear_campaign(range(6))
    assert not tally.wrong, tally.wrong
    assert {name.rpartition(":")[0] for name in tally.counts} == {"linear stable", "linear not stable"}


def test_the_matrix_of_a_linear_network_annihilates_what_nobody_holds():
    """Rows of M sum to -k_i."""
    problem, M = linear_problem(1)
    gains = [float(problem.pinning.gains[i][0][0]) if i in problem.pinning.gains else 0.0 for i in range(problem.n)]
    assert np.allclose(M.sum(axis=1), -np.array(gains))
