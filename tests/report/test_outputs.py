"""Reports of agents whose outputs are measured."""

from typing import Any

import pytest
from networks import network_of

from dobc_design import Exosystem, Observer, Problem, certify, verify
from dobc_design.certificate.certificate import Certificate
from dobc_design.certificate.text import certificate_bytes, read_claims
from dobc_design.report.write import render_report

CART: dict[str, Any] = {"A": [[0, 1], [0, -3]], "B": [[0], [1]], "H": [[1, 0]]}
GIVEN: dict[str, Any] = {
    "network": network_of([[2, 1], [3, 2]], 3),
    "coupling": "2*y1 + 3*y2",
    "gains": {1: [[4, 4]]},
    "exosystem": Exosystem(A=[[0]], C=[[1]]),
    "observer": Observer(W=[[6], [5], [8]]),
    "dynamics": CART,
}


def markdown(**given: Any) -> str:
    pages = render_report(certify(Problem(**GIVEN | given)))
    (page,) = (data for name, data in pages.items() if name.endswith(".md"))
    return page.decode()


def test_the_observer_of_states_and_disturbance_is_typeset():
    text = markdown()
    assert r"+ W_x (y_i - H \hat x_i)" in text
    assert r"\dot{\hat{\xi}}_i = A \hat{\xi}_i + W_\xi (y_i - H \hat x_i)" in text
    assert r"\quad e_i = \hat x_i - \bar x_i" in text
    assert "z_i" not in text
    assert "how far the estimate of agent i is from the target" in text
    assert "gives the loop to python-control" in text


def test_couplings_and_pins_on_outputs_are_typeset_with_h():
    dynamics = CART | {"acts_on": "outputs"}
    text = markdown(dynamics=dynamics, coupling="2*y", gains={1: 4})
    assert r"h_{ij}(H e_j - H e_i)" in text
    assert r"u_i = -K_i H e_i - \hat{d}_i" in text
    assert r"\quad e_i = x_i - \bar x_i" in text
    assert "couplings and pins act on outputs" in text


@pytest.mark.parametrize(
    ("own", "error"), [(False, "e_i = \\hat x_i - s"), (True, "e_i = x_i - s")]
)
def test_a_leader_takes_the_place_of_the_target(own, error):
    dynamics = CART | ({"acts_on": "outputs"} if own else {})
    coupling, gain = ("2*y", 4) if own else ("2*y1 + 3*y2", [[4, 4]])
    leader = {"initial": [[0, 1], [1, 1]]}
    given = {"dynamics": dynamics, "coupling": coupling, "gains": {1: gain}, "leader": leader}
    assert error in markdown(**given)


def test_a_certificate_of_agreement_is_read_and_reported():
    """That of double integrators has R for all agents, and no weights of agents."""
    ring = network_of([[2, 1], [3, 2], [1, 3]], 3)
    dynamics = {"A": [[0, 1], [0, 0]], "B": [[0], [1]], "H": [[1, 0]]}
    given = {"network": ring, "dynamics": dynamics, "goal": "agreement", "gains": None}
    problem = Problem(**GIVEN | given | {"observer": Observer(W=[[3], [3], [1]])})
    certificate = certify(problem)
    assert verify(certificate, problem).holds
    read = Certificate(claims=read_claims(certificate_bytes(certificate.claims)), problem=problem)
    assert any(name.endswith(".html") for name in render_report(read))
