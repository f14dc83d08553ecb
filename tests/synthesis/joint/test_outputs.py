"""Designs for agents whose outputs are measured; eigenvalues of their whole loops are the oracle
(theory, section 18)."""

from typing import Any

import pytest
from measured import growth
from networks import network_of

import dobc_design as dd
from dobc_design import Dynamics, Exosystem, Problem, Verdict
from dobc_design.errors import SpecError

CART = Dynamics(A=[[0, 1], [0, 0]], B=[[0], [1]], H=[[1, 0]])
DAMPED = Dynamics(A=[[0, 1], [0, -3]], B=[[0], [1]], H=[[1, 0]], acts_on="outputs")
SINE = Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]])


GROUPS = [
    dd.Group(agents=[1, 3], exosystem=SINE),
    dd.Group(agents=[2], exosystem=Exosystem(A=[[0]], C=[[1]])),
]


def carts(**given: Any) -> Problem:
    sound = {"dynamics": CART, "coupling": "2*y1 + 3*y2", "exosystem": SINE}
    return Problem(network=network_of([[2, 1], [3, 2]], 3), **sound | given)


@pytest.mark.parametrize(
    "given",
    [
        {},
        {"observer": dd.Observer(W=[[8], [20], [0], [-32]])},
        {"dynamics": DAMPED, "coupling": "2*y"},
        {"exosystem": None, "groups": GROUPS},
        pytest.param({"dynamics": DAMPED, "coupling": "tanh(y)"}, marks=pytest.mark.slow),
    ],
    ids=["states", "own W", "outputs", "groups", "tanh"],
)
def test_a_design_is_as_fast_as_asked_and_no_faster_than_the_whole_loop(given):
    found = dd.design(carts(**given), rate="2/5")
    assert found.verdict is Verdict.PROVED, found
    rows, columns = (7, 2) if "groups" in given else (4, 1)
    assert len(found.W) == rows and len(found.W[0]) == columns
    # Agents of a row have the same eigenvalues, whose floats are only as good as this.
    assert 0.4 <= found.rate <= -max(growth(found.problem).values()) + 1e-5
    again = dd.verify(found.certificate, found.problem)
    assert again.holds and again.lone_checker == "it accepts every claim", again.failures


def test_gains_alone_are_designed_with_an_observer():
    found = dd.design_pinning(carts(), rate="2/5")
    assert found.is_proved and list(found.gains) == ["1"]
    assert -max(growth(found.problem).values()) > 0.4


def test_a_speed_that_outputs_do_not_reach_forbids_every_design():
    """No gain on the position of a cart without friction: s^2 + k."""
    free = Dynamics(A=[[0, 1], [0, 0]], B=[[0], [1]], H=[[1, 0]], acts_on="outputs")
    found = dd.design(carts(dynamics=free, coupling="2*y"))
    assert found.verdict is Verdict.UNDECIDED


@pytest.mark.parametrize("rate", [None, 1])
def test_a_state_that_no_output_shows_refutes_in_its_words(rate):
    seen = Dynamics(A=[[0, 1], [0, 0]], B=[[0], [1]], H=[[0, 1]])
    problem = carts(dynamics=seen, exosystem=Exosystem(A=[[0]], C=[[1]]))
    for found in (dd.design(problem, rate=rate), dd.design_observer(problem)):
        assert found.verdict is Verdict.REFUTED
        assert "no W exists: the state x1 does not show in y = H x" in str(found)
    assert dd.design(problem).binding is None


def test_a_coupling_is_designed_for_states_only():
    with pytest.raises(SpecError, match=r"^dynamics\.acts_on: a design of couplings is for"):
        dd.design(carts(dynamics=DAMPED, coupling="2*y"), coupling=True)
    found = dd.design(carts(), coupling=True, rate="2/5")
    assert found.is_proved and found.problem.dynamics == CART
