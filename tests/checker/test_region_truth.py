"""The oracle of regional claims has teeth: it sees what is false in the cases written by hand, and
rates off by 1e-6.

Nothing of the package takes part but the canonical form of a problem, and the frames of
hand-written claims.
"""

import json
import math
from collections.abc import Callable
from typing import Any

import pytest
from checker_files.files import HOLDS, Case
from checker_files.quadratic import quadratic_cases
from checker_files.separable import region_cases
from checker_files.settling import tube_cases
from networks import PAPER, listening
from oracles.regions import IDS, Regions

from dobc_design.problem.canonical import canonical_document

# a local maximum at the larger |root| of 3 y^2 + 8 y + 4.1, near y = -1.97
HUMP = "y*((y + 2)**2 + 1/10)"
TINY = 1e-6


@pytest.mark.filterwarnings("ignore:.*xtol:RuntimeWarning")
@pytest.mark.parametrize(
    ("cases", "unseen"), [(region_cases, 29), (quadratic_cases, 1), (tube_cases, 0)]
)
def test_the_oracle_tells_claims_that_are_true_from_their_twins(
    cases: Callable[[], list[Case]], unseen: int
):
    """Worked out on paper.  Twins that it does not contradict are wrong in form or only in the
    verdict of the whole."""
    missed = 0
    for case in cases():
        document = json.loads(case.certificate)
        problem = json.loads(case.problem)
        # of arc-wise ends runs are the oracle: tests/conditions/arcs
        if "arc-wise" in case.certificate.decode():
            continue
        W = (document["observer"] or {"W": None})["W"]
        oracle = Regions(problem, W)
        checks = document["checks"]
        smooth = next((each["domain"] for each in checks if each["id"] == "lemma1"), "")
        said = []
        try:
            for each in checks:
                if each["id"] in IDS:
                    said += oracle.false(each, document, smooth)
        # no numbers, or none that a float holds
        except (ArithmeticError, LookupError, TypeError, ValueError) as error:
            said.append(repr(error))
        assert case.code != HOLDS or said == [], (case.name, said)
        missed += case.code != HOLDS and said == []
    assert missed <= unseen


def contradicted(h: str, id: str, domain: Any, exact: dict[str, Any]) -> bool:
    """Whether the oracle says something against a claim about two agents, the second of which
    listens to the first."""
    arcs = [[2, 1]]
    problem = listening(arcs, h, n=2, gains={1: 5}, target=0)
    check = {
        "id": id,
        "verdict": "proved",
        "domain": domain,
        "margin": None,
        "rate": 1e-4 if id == "max-separable" else None,
        "exact": exact,
    }
    document = {"checks": [check]}
    smooth = "global" if problem.coupling.is_linear else "consensus"
    oracle = Regions(canonical_document(problem), None)
    return bool(oracle.false(check, document, smooth))


@pytest.mark.parametrize(
    ("h", "rho", "most"),
    [
        # upper row of agent 2, v = (1, 2): sup of h on [-3 s, -s] <= -2 alpha s
        (PAPER, 2, (1 + (1 - math.exp(-2)) / 2) / 2),  # nondecreasing: h(-s), worst at s = rho
        ("sin(y)", 1, math.sin(3) / 2),  # the left end, worst at s = 1
        # inside
        (HUMP, 1, -0.5 * max(y * ((y + 2) ** 2 + 0.1) for y in [(-8 - math.sqrt(14.8)) / 6])),
        ("clip(y, -1, 1)", 4, 1 / 8),
        ("y - y**2/3", 0.5, 5 / 12),  # the lower row, s - s^2/3 >= 2 alpha s
    ],
)
def test_a_rate_is_false_just_above_the_largest_and_true_just_below(
    h: str, rho: float, most: float
):
    domain = {"kind": "box", "radius": 0.5, "disturbance": 0.0}
    for factor in (1 - TINY, 1 + TINY):
        exact = {"v": ["1", "2"], "alpha": f"{most * factor:.17f}", "rho": str(rho)}
        assert contradicted(h, "max-separable", domain, exact) is (factor > 1)


def test_a_quadratic_rate_is_false_just_above_the_eigenvalue():
    """P_e = I and [[-5, 0], [1, -1]]: the rate is 3 - sqrt(17) / 2."""
    P_e = [[0, 0, "1"], [1, 1, "1"]]
    exact = {"method": "lure", "P_e": P_e, "level": None, "radius": None}
    gains = [[["1", "1"]]]
    slopes = {"coupling": 0, "gains": gains}
    exact |= {"ranges": [slopes]}
    exact["multipliers"] = {"G": ["1/2"]}
    for factor in (1 - TINY, 1 + TINY):
        rate = f"{(3 - math.sqrt(17) / 2) * factor:.17f}"
        found = contradicted("y", "lure", "global", exact | {"rate": rate})
        assert found is (factor > 1)
