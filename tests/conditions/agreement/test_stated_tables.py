"""Agreement of the plant that [uncertainty] and [actuators] state (theory, sections 12 and 16): the
largest disagreement that remains, errors of weights, inputs with a limit; both programs."""

import json
from collections.abc import Callable
from fractions import Fraction
from functools import cache
from itertools import permutations
from typing import Any

import numpy as np
import pytest
from checker_files.files import accepted_by
from networks import around, jacobian_by_hand, linked
from scipy.integrate import quad_vec
from scipy.linalg import expm

from dobc_design import Certificate, Exosystem, Observer, Problem, Verdict, verify
from dobc_design import certify as certified
from dobc_design.certificate.text import certificate_bytes
from dobc_design.problem.dynamics import Dynamics

PROVED, REFUTED, UNDECIDED = Verdict.PROVED, Verdict.REFUTED, Verdict.UNDECIDED
OMEGA = {"disturbance": "1/10"}
BIAS = Exosystem(A=[[0]], C=[[1]])
PAPER = "exp(y) - 1 + y"
REGION = {"initial_states": [-1, 1]}
TWO = [[1, 2], [2, 1]]
FIVE = [list(arc) for arc in permutations(range(1, 6), 2)]
BEHIND_ONE = [[2, 1], [3, 2], [4, 2], [4, 3]]  # agent 1 hears nobody

certify = cache(certified)


def agreeing(arcs: Any, n: Any = None, coupling: Any = "y", **more: Any) -> Problem:
    return linked(arcs, n, coupling, goal="agreement", **more)


def exact_of(problem: Problem, id: str) -> dict[str, Any]:
    """What a proved check claims, in a certificate that both programs accept."""
    certificate = certify(problem)
    assert certificate.verdict is PROVED, certificate.reason
    report = verify(certificate, problem)
    assert report.holds
    assert report.lone_checker == "it accepts every claim"
    check = certificate.check(id)
    assert check.is_proved, check.reason
    assert check.exact is not None
    return check.exact


def bounds(problem: Problem) -> dict[str, float]:
    """By pair, or by agent compared with the one that hears nobody."""
    found = exact_of(problem, "accuracy")["bounds"]
    return {label: float(Fraction(x)) for label, x in found.items()}


def forged(certificate: Certificate, id: str, change: Callable[[Any], None]) -> dict[str, Any]:
    """The certificate once ``change`` is done to a check."""
    document: dict[str, Any] = json.loads(certificate_bytes(certificate.claims))
    (check,) = [each for each in document["checks"] if each["id"] == id]
    change(check)
    return document


def refuse(problem: Problem, id: str, change: Callable[[Any], None]) -> None:
    """Both programs refuse what they accept without the change."""
    certificate = certify(problem)
    assert accepted_by(forged(certificate, id, lambda check: None), problem) == (True, True)
    assert accepted_by(forged(certificate, id, change), problem) == (False, False)


def reached(problem: Problem, omega: float) -> dict[tuple[int, int], float]:
    """What the worst disturbance of each agent, |w_i| <= omega, reaches of every difference of a
    linear loop: omega times the integral of sum_k |(e^(-L t))_ik - (e^(-L t))_jk|."""
    n = problem.n
    J = jacobian_by_hand(problem, None, 1.0)

    def integrand(t: float) -> Any:
        moved = expm(J * t)
        return np.abs(moved[:, None, :] - moved[None, :, :]).sum(axis=2)

    total, _ = quad_vec(integrand, 0, 60, epsabs=1e-7)
    return {(i + 1, j + 1): omega * total[i, j] for i, j in permutations(range(n), 2)}


@pytest.mark.parametrize(("arcs", "n", "exact"), [(TWO, 2, 0.1), (FIVE, 5, 0.04)])
def test_complete_graphs_end_within_twice_the_disturbance_over_n(arcs: Any, n: int, exact: float):
    """(x_i - x_j)' = -n (x_i - x_j) + w_i - w_j."""
    problem = agreeing(arcs, n, uncertainty=OMEGA)
    found = bounds(problem)
    assert list(found.values()) == pytest.approx([exact] * n * (n - 1), rel=1e-3)
    assert min(found.values()) >= exact
    short = str(Fraction(exact) * (1 - Fraction(1, 10**6)))
    refuse(problem, "accuracy", lambda check: check["exact"]["bounds"].update({"(1, 2)": short}))


def test_no_bound_is_below_what_the_worst_disturbance_reaches():
    """A cycle, and a graph with one more arc, by scipy; the chain behind an agent that hears nobody
    is exact."""
    for arcs, slack in ((around(4), 2), ([*around(4), [3, 1]], 2), (BEHIND_ONE, 1.001)):
        problem = agreeing(arcs, 4, uncertainty=OMEGA)
        worst = reached(problem, 0.1)
        for label, bound in bounds(problem).items():
            pair = json.loads(label.replace("(", "[").replace(")", "]"))
            true = worst[tuple(pair) if isinstance(pair, list) else (pair, 1)]
            assert true <= bound <= slack * true, label


def test_observers_drift_and_noise_of_both_agents_count():
    """With W = 2 a disturbance comes twice, by eps as w C eps of size omega, and a drift as
    gamma/2; noise of 4 measured states, and 2 (CW + |F W|/2) by the estimates."""
    more = {"exosystem": BIAS, "observer": Observer(W=[[2]]), "region": None}
    for table, both in (
        (OMEGA, 2 * (0.1 + 0.1)),
        ({"drift": "1/10"}, 2 * 0.1 / 2),
        ({"measurement": "1/10"}, 4 * 0.1 * (1 + 1) + 2 * 0.1 * (2 + 2)),
    ):
        problem = agreeing(TWO, 2, uncertainty=table, **more)
        assert bounds(problem)["(1, 2)"] == pytest.approx(both / 2, rel=1e-3)


def test_noise_of_what_both_hear_is_not_matched():
    """K5, nu = 1/100: 8 arcs with 2 nu, and a pull of 2."""
    problem = agreeing(FIVE, 5, uncertainty={"measurement": "1/100"})
    assert bounds(problem)["(1, 2)"] == pytest.approx(0.08, rel=1e-3)


def test_weights_that_are_off_slow_agreement_by_as_much():
    """Directed 3-cycle, exp(y) - 1 + y, widths at most 2: (1 - 1/10)(1 + (1 - exp(-2))/2)."""
    problem = agreeing(around(3), 3, PAPER, region=REGION, uncertainty={"weights": "1/10"})
    known = 0.9 * (1 + (1 - np.exp(-2)) / 2)
    exact_of(problem, "tolerance")
    assert certify(problem).rate == pytest.approx(known, rel=1e-3)

    def faster(check: Any) -> None:
        check["rate"] = known * 1.0001
        check["exact"]["alpha"] = str(Fraction(known * 1.0001))

    refuse(problem, "tolerance", faster)


def test_what_both_hear_counts_with_one_weight_only_where_weights_are_exact():
    """K5 matched has the rate 5; with the errors of a tolerance nothing is matched."""
    stated = agreeing(FIVE, 5, uncertainty={"weights": "1/100"})
    exact = exact_of(stated, "tolerance") | {"alpha": "99/25", "v": ["1"] * 20}
    exact_problem = agreeing(FIVE, 5)
    (check,) = [c for c in forged_checks(stated) if c["id"] == "tolerance"]
    document = json.loads(certificate_bytes(certify(exact_problem).claims))
    document["checks"].append(check | {"exact": exact, "rate": 3.96})
    assert accepted_by(document, exact_problem) == (False, False)


def forged_checks(problem: Problem) -> list[dict[str, Any]]:
    checks: list[dict[str, Any]] = json.loads(certificate_bytes(certify(problem).claims))["checks"]
    return checks


@pytest.mark.slow
def test_observers_that_do_not_know_the_weights_disturb_each_others_estimates():
    """eta is |W|_P dw S, S = max sum w (v_i + v_j) sup |h/y| of one agent at least."""
    problem = agreeing(
        TWO,
        2,
        "tanh(y)",
        exosystem=BIAS,
        region=REGION | {"initial_disturbance": "1/100"},
        uncertainty={"weights": "1/500", "known_to_agents": False},
    )
    exact = exact_of(problem, "tolerance")
    smaller = str(Fraction(exact["eta"]) * Fraction(9, 10))
    refuse(problem, "tolerance", lambda check: check["exact"].update(eta=smaller))


LIMITED = {
    "exosystem": BIAS,
    "observer": Observer(W=[[2]]),
    "region": REGION | {"initial_disturbance": "1/100"},
    "actuators": {"limit": 1, "amplitude": "1/2"},
}


def test_inputs_are_the_estimates_of_the_disturbance():
    """|d| <= 1/2 and |eps| <= 1/100, which falls: 0.49 of the limit is left."""
    problem = agreeing(around(3), 3, "tanh(y)", **LIMITED)
    rooms = exact_of(problem, "actuators")["rooms"]
    assert [float(Fraction(x)) for x in rooms.values()] == pytest.approx([0.49] * 3, rel=1e-5)
    more = dict.fromkeys(rooms, "49001/100000")
    refuse(problem, "actuators", lambda check: check["exact"].update(rooms=more))
    refuse(problem, "actuators", lambda check: check["domain"].update(disturbance=0.011))
    assert "no input exceeds the limit of 1" in certify(problem).reason


@pytest.mark.parametrize(
    ("more", "why"),
    [
        ({"actuators": {"limit": "1/2", "amplitude": "1/2"}}, "no region and no gain would do"),
        ({"uncertainty": OMEGA}, "acts on the estimates, too"),
    ],
)
def test_a_limit_that_estimates_may_exceed_leaves_the_verdict_open(more: Any, why: str):
    certificate = certify(agreeing(around(3), 3, "tanh(y)", **(LIMITED | more)))
    assert certificate.verdict is UNDECIDED
    assert why in certificate.reason


@pytest.mark.parametrize(("beta", "verdict"), [("0.974", PROVED), ("0.973", REFUTED)])
def test_double_integrators_on_a_directed_ring_agree_iff_they_are_damped_enough(
    beta: str, verdict: Verdict
):
    """p'' = sum (p_j - p_i) + beta (p_j' - p_i') + d_i, 5 agents: iff beta^2 > cot(pi/5)^2/2 =
    0.947214 (Yu, Chen, Cao 2010), whatever motion they agree on; constant d_i (Yang and Mei)."""
    twice = Dynamics(A=[[0, 1], [0, 0]], B=[[0], [1]])
    problem = agreeing(around(5), 5, [f"y1 + {beta}*y2"], dynamics=twice, exosystem=BIAS)
    certificate = certify(problem)
    assert certificate.verdict is verdict
    assert verify(certificate, problem).holds


def test_oscillators_on_a_directed_ring_agree_at_the_second_rate():
    """x_i' = A x_i + sum (x_j - x_i) with A'= -A: 1 - cos(2 pi/n)."""
    swinging = Dynamics(A=[[0, 1], [-1, 0]], B=[[1, 0], [0, 1]])
    problem = agreeing(around(6), 6, ["y1", "y2"], dynamics=swinging)
    assert certify(problem).rate == pytest.approx(1 - np.cos(np.pi / 3), rel=1e-6)
    assert verify(certify(problem), problem).holds
