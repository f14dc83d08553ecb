"""The lone checker's part about settling times: how sharp it is, and hostile claims."""

import json
from fractions import Fraction
from typing import Any

import pytest
from checker_files.files import FAILS, HOLDS, outcome
from checker_files.separable import certificate, problems
from checker_files.settling import BOXES, LINE, bent, moved
from networks import listening
from regional_problems import HARMONIC, PAPER_GAIN

from dobc_design import Observer, certify
from dobc_design.certificate.text import certificate_bytes
from dobc_design.problem.canonical import canonical_bytes

Document = dict[str, Any]


@pytest.fixture(scope="module")
def found() -> tuple[Document, bytes]:
    """What the package claims of three agents with an observer."""
    region = {"initial_states": [-1, 1], "initial_disturbance": "1/2"}
    observed: Document = {
        "exosystem": HARMONIC,
        "observer": Observer(W=PAPER_GAIN),
        "region": region,
    }
    arcs = [[1, 2], [2, 3], [3, 1]]
    problem = listening(arcs, "exp(y) - 1 + y", gains={1: 5}, target=0, **observed)
    claims = certify(problem, settling="1/10").claims
    return json.loads(certificate_bytes(claims)), canonical_bytes(problem)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("path", "factor", "code"),
    [
        (("time",), 1, HOLDS),
        (("time",), "999/1000", FAILS),
        (("tolerance",), "999/1000", FAILS),
        (("last", "level"), "999/1000", FAILS),
        (("last", "height"), "999/1000", FAILS),
        (("tube", "size"), "1/2", FAILS),
        (("tube", "upper", 5, 1), "9/10", FAILS),
        (("tube", "lower", 5, 1), "9/10", FAILS),
    ],
)
def test_numbers_that_the_package_finds_hold_and_are_nearly_as_small_as_they_may_be(
    found, path, factor, code
):
    claimed, problem = found
    document = json.loads(json.dumps(claimed))
    (check,) = [each for each in document["checks"] if each["id"] == "settling"]
    part = check["exact"]
    for key in path[:-1]:
        part = part[key]
    entry = part[path[-1]]
    changed = Fraction(entry) * Fraction(factor)
    part[path[-1]] = str(changed)
    assert outcome(json.dumps(document).encode(), problem) == code


MANY = [f"{k}/1000" for k in range(2001)]


@pytest.mark.parametrize(
    "check",
    [
        bent(LINE, time="1e400", tolerance="0"),
        bent(LINE, time="-1e400"),
        bent(LINE, times=MANY, upper=[BOXES[0]] * 2001, lower=[BOXES[0]] * 2001),
        bent(LINE, times=["0", "1e-400", "1"]),
        bent(LINE, level="1e-400"),
        bent(LINE, upper={"float64": "AAAA"}),
        bent(LINE, upper=[BOXES[0], {"float64": "AAAA"}, BOXES[2]]),
        moved(LINE, 1, 0, "1e400"),
        moved(LINE, 1, 0, "1e-400"),
        moved(LINE, 2, 1, "1" + "0" * 9000 + "1"),
    ],
)
def test_hostile_claims_are_refused(check: Document):
    problem = canonical_bytes(problems()["line"])
    assert outcome(certificate("line", check), problem) == FAILS
