"""Agreement without a target (theory, section 16): answers that are known in closed form, by
certificates that both programs accept, and claims just beyond them that both refuse."""

import json
import math
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from checker_files.files import accepted_by
from networks import around, jacobian_by_hand, linked

from dobc_design import Certificate, Exosystem, Problem, Verdict, certify, verify
from dobc_design.certificate.text import certificate_bytes
from dobc_design.problem.dynamics import Dynamics

PROVED, REFUTED, UNDECIDED = Verdict.PROVED, Verdict.REFUTED, Verdict.UNDECIDED
PAPER = "exp(y) - 1 + y"


def agreeing(arcs: Any, n: Any = None, coupling: Any = "y", **more: Any) -> Problem:
    return linked(arcs, n, coupling, goal="agreement", **more)


def complete(n: int, *weight: Any) -> list[Any]:
    return [[i, j, *weight] for i in range(1, n + 1) for j in range(1, n + 1) if i != j]


def confirmed(problem: Problem, **options: Any) -> Certificate:
    certificate = certify(problem, **options)
    report = verify(certificate, problem)
    assert report.holds
    assert "second checker: it accepts every claim" in str(report)
    return certificate


def rate_of(certificate: Certificate, id: str) -> float:
    (found,) = [check for check in certificate.checks if check.id == id]
    assert found.verdict is PROVED
    assert found.rate is not None
    return found.rate


def faster(certificate: Certificate, id: str, rate: float) -> dict[str, Any]:
    """The certificate with another rate, and alpha where the check has one."""
    document: dict[str, Any] = json.loads(certificate_bytes(certificate.claims))
    (check,) = [each for each in document["checks"] if each["id"] == id]
    check["rate"] = rate
    if "alpha" in check.get("exact", {}):
        check["exact"]["alpha"] = str(rate)
    if document["covered_by"] == id:
        document["rate"] = rate
    return document


@pytest.mark.parametrize("n", [3, 4, 6])
def test_a_directed_cycle_agrees_by_pairs_at_twice_one_less_the_cosine_of_pi_over_n(n: int):
    """Pairs at the distance d weigh sin(pi d/n).  The local rate is 1 - cos(2 pi/n)."""
    problem = agreeing(around(n), n)
    certificate = confirmed(problem, everything=True)
    by_pairs = 2 * (1 - math.cos(math.pi / n))
    assert rate_of(certificate, "max-separable") == pytest.approx(by_pairs, rel=1e-3)
    assert rate_of(certificate, "max-separable") <= by_pairs
    exact = 1 - math.cos(2 * math.pi / n)
    assert rate_of(certificate, "linearisation") == pytest.approx(exact, rel=1e-6)
    for id, most in (("max-separable", by_pairs), ("linearisation", exact)):
        assert accepted_by(faster(certificate, id, most * (1 + 1e-6)), problem) == (False, False)


def test_what_all_hear_of_each_other_is_matched():
    """The rate of the complete graph of 5 is 5, that of its pairs without matched arcs 2."""
    problem = agreeing(complete(5), 5)
    certificate = confirmed(problem, everything=True)
    for id in ("max-separable", "linearisation"):
        assert rate_of(certificate, id) == pytest.approx(5, rel=1e-3)
        assert accepted_by(faster(certificate, id, 5.001), problem) == (False, False)


def test_weights_that_may_be_off_are_not_matched():
    problem = agreeing(complete(5), 5, uncertainty={"weights": "1/100"})
    certificate = certify(problem, everything=True)
    assert rate_of(certificate, "max-separable") == pytest.approx(2, rel=1e-3)
    assert accepted_by(faster(certificate, "max-separable", 2.001), problem) == (False, False)


def test_the_coupling_of_the_paper_agrees_at_the_slope_of_its_farthest_chord():
    """Directed 3-cycle, all widths at most 2: v = 1 at 1 + (1 - exp(-2))/2 = 1.432332."""
    problem = agreeing(around(3), 3, PAPER, region={"initial_states": [-1, 1]})
    certificate = confirmed(problem)
    assert certificate.verdict is PROVED
    exact = 1 + (1 - math.exp(-2)) / 2
    assert certificate.rate == pytest.approx(exact, rel=1e-3)
    assert rate_of(certificate, "max-separable") <= exact
    beyond = faster(certificate, "max-separable", exact + 1e-6)
    assert accepted_by(beyond, problem) == (False, False)


def test_who_hears_nobody_is_the_target_of_the_others():
    """A chain of three: the second follows at 1, the third at 1 - v_2/v_3; n - 1 weights do."""
    problem = agreeing([[2, 1], [3, 2]], 3, "tanh(y)", region={"initial_states": [-1, 1]})
    certificate = confirmed(problem)
    assert certificate.verdict is PROVED
    (rows,) = [check for check in certificate.checks if check.id == "max-separable"]
    assert rows.exact is not None
    assert len(rows.exact["v"]) == 2


@pytest.mark.slow
def test_offsets_of_a_formation_widen_what_has_to_be_covered():
    """Sines draw two agents together that are less than pi apart: 1 is, 4 is not."""
    each_other = [[1, 2], [2, 1]]
    close = agreeing(each_other, 2, "sin(y)", region={"initial_states": ["-1/2", "1/2"]})
    assert confirmed(close).verdict is PROVED
    formed = close.replace(offsets={1: [3]})
    assert confirmed(formed).verdict is UNDECIDED


def test_late_states_make_no_pairs():
    """Two agents, x_1' = x_2 - x_1, x_2' = x_1(t - 5) - x_2: rows with late v_j would claim D <=
    0.0183 at t = 2 for x = 1 and 0, where D is 0.1355."""
    problem = agreeing([[1, 2], [2, 1]], 2, region={"initial_states": [0, 1]})
    certificate = confirmed(problem, everything=True)
    (late,) = [check for check in certificate.checks if check.id == "delay"]
    assert late.verdict is UNDECIDED
    assert "no difference of states at one time" in late.reason
    document: dict[str, Any] = json.loads(certificate_bytes(certificate.claims))
    (rows,) = [each for each in document["checks"] if each["id"] == "max-separable"]
    (open_claim,) = [each for each in document["checks"] if each["id"] == "delay"]
    open_claim |= {"verdict": "proved", "rate": 0.001, "domain": rows["domain"]}
    open_claim["exact"] = {"delay": "1/1000", "rate": "1/1000"}
    assert accepted_by(document, problem) == (False, False)
    # The run itself, by small steps: D(2) is what the theory says.
    step = 1e-4
    x = np.array([1.0, 0.0])
    for _ in range(round(2 / step)):
        x = x + step * np.array([x[1] - x[0], 1.0 - x[1]])
    assert abs(x[0] - x[1]) == pytest.approx(0.1355, abs=1e-3)


def test_two_groups_that_hear_nobody_are_named():
    problem = agreeing([[2, 1], [1, 2], [4, 3], [5, 4], [5, 1]], 5, "tanh(y)")
    certificate = confirmed(problem)
    assert certificate.verdict is REFUTED
    (found,) = [check for check in certificate.checks if check.id == "reachability"]
    assert found.witness is not None
    assert found.witness.labels == ("1", "2", "3")
    one_more = agreeing([[2, 1], [1, 2], [4, 3], [5, 4], [5, 1], [3, 2]], 5, "tanh(y)")
    assert confirmed(one_more).verdict is PROVED


def test_residuals_of_both_agents_count():
    """With an observer that forgets at 2, |C eps_i - C eps_j| <= 2 max |C eps|: P >= 4 C'C."""
    problem = agreeing(
        around(3),
        3,
        "tanh(y)",
        exosystem=Exosystem(A=[[0]], C=[[1]]),
        region={"initial_states": ["-1/4", "1/4"], "initial_disturbance": "1/10"},
    )
    certificate = confirmed(problem)
    assert certificate.verdict is PROVED
    document: dict[str, Any] = json.loads(certificate_bytes(certificate.claims))
    (rows,) = [each for each in document["checks"] if each["id"] == "max-separable"]
    assert Fraction(rows["exact"]["P"][0][0]) >= 4
    rows["exact"]["P"] = [["399/100"]]
    assert accepted_by(document, problem) == (False, False)


def test_differences_of_agents_with_linear_dynamics_move_by_the_same():
    """x_i' = x_i + 3 (x_j - x_i) for two agents: (x_1 - x_2)' = (1 - 6) (x_1 - x_2), though the
    states grow."""
    growing = Dynamics(A=[[1]], B=[[1]])
    arcs = [[1, 2], [2, 1]]
    problem = agreeing(arcs, 2, "3*y", dynamics=growing)
    certificate = confirmed(problem, everything=True)
    assert certificate.verdict is PROVED
    for id in ("linearisation", "max-separable"):
        assert rate_of(certificate, id) == pytest.approx(5, rel=1e-3)
        assert accepted_by(faster(certificate, id, 5.001), problem) == (False, False)
    alone = agreeing([], 2, dynamics=growing)
    assert confirmed(alone).verdict is REFUTED


def test_an_unstable_mode_refutes_wherever_agents_start():
    for region in (None, {"initial_states": [2, 3]}):
        problem = agreeing(around(3), 3, "-y", region=region)
        certificate = confirmed(problem)
        assert certificate.verdict is REFUTED


def test_the_oracle_of_the_rate_is_the_second_eigenvalue():
    """Of a cycle with one chord, by numpy."""
    problem = agreeing([*around(5), [3, 1, "1/2"]], 5)
    values = np.linalg.eigvals(-jacobian_by_hand(problem, None, 1.0)).real
    certificate = confirmed(problem)
    assert certificate.rate == pytest.approx(np.sort(values)[1], rel=1e-6)
