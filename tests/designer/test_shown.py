"""What the Designer shows of a certificate: the limit's state, and what is drawn against the
run."""

import math
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

pytest.importorskip(
    "anywidget", reason="needs the extra `notebook`: pip install 'dobc_design[notebook]'"
)

import dobc_design as dd
from dobc_design.designer.shown import shown

BOTH = [[2, 1], [1, 2]]
BOX = {"initial_states": [-1, 1]}


def decided(coupling: str = "y", **settings: Any) -> dd.Designer:
    """Two agents that listen to each other, the first pinned, with the exact verdict."""
    network = settings.pop("network", None)
    if network is None:
        network = dd.Network.from_arcs(BOTH, arrow="listens_to", agents=2)
    problem = dd.Problem(network=network, coupling=coupling, gains={1: 1}, **settings)
    designer = dd.Designer(problem)
    designer.certify()
    return designer


@pytest.mark.parametrize("radius", [1.0, 2.5])
def test_the_run_stays_below_the_proved_bound_that_is_drawn(radius: float):
    designer = decided("tanh(y) + y", region=BOX)
    designer.radius = radius
    certificate = designer.certify()
    bound = designer.verdict["bound"]
    assert bound["tube"] == certificate.bound(designer.numbers["times"]).tolist()
    errors = np.array(designer.numbers["errors"])
    assert errors[:, 0].max() == radius
    assert (errors <= bound["tube"]).all()
    assert bound["text"] == "proved: from these starts no agent is ever above it"


def test_the_bound_goes_with_the_next_move():
    designer = decided(region=BOX)
    designer.gains = {"1": 2.0}
    assert designer.verdict == {}


@pytest.mark.parametrize(("limit", "kept"), [("1001/1000", True), ("999/1000", False)])
def test_the_limit_is_kept_exactly_where_the_largest_input_allows_it(limit: str, kept: bool):
    """The pinned agent has u = -k e with k = 1 and |e| <= 1."""
    designer = decided(region=BOX, actuators={"limit": limit})
    state = designer.verdict["limit"]
    assert state == {"kept": kept, "why": ""}
    assert designer.network["limit"].startswith("the limit of")
    assert bool(designer.verdict["bound"]["tube"]) is kept
    if not kept:  # the verdict says why
        assert designer.verdict["text"].startswith("Undecided: without the actuator limit")
        assert "inputs keep the limit" in designer.verdict["bound"]["text"]


def test_where_more_fails_than_the_limit_the_limit_has_its_own_reason():
    designer = decided(region=BOX, actuators={"limit": 2})
    designer.gains = {}
    designer.certify()
    assert designer.verdict["verdict"] == "refuted"
    state = designer.verdict["limit"]
    assert state["kept"] is False
    assert state["why"]


def test_without_a_limit_nothing_is_said_about_it():
    designer = decided(region=BOX)
    assert designer.verdict["limit"] is None
    assert designer.network["limit"] == ""


@pytest.mark.parametrize("limit", [None, "1/1000"])
def test_a_disturbance_without_a_model_leaves_the_final_error_as_a_level(limit: str | None):
    """Lambda = [[-2, 1], [1, -1]] and |w_i| <= 1/10: e ends within -Lambda^-1 (1/10, 1/10) =
    (2/10, 3/10)."""
    designer = decided(region=BOX, uncertainty={"disturbance": "1/10"}, actuators={"limit": limit})
    bound = designer.verdict["bound"]
    assert list(bound["tube"]) == []
    assert 0.3 <= bound["level"] < 0.303
    assert ("without the limit of 0.001" in bound["text"]) is (limit is not None)


def test_starts_outside_what_is_proved_show_the_largest_proved_box():
    """sin, one pin of two agents: nothing beyond pi can be proved."""
    certificate = decided("sin(y)", region=BOX).certificate
    bound = shown(certificate, [0.0, 1.0], Fraction(4))["bound"]
    assert list(bound["tube"]) == []
    assert 1 <= bound["level"] < math.pi
    assert "starts that is proved" in bound["text"]


def test_without_a_region_the_page_says_what_to_ask_for():
    bound = decided("sin(y)").verdict["bound"]
    assert list(bound["tube"]) == []
    assert bound["level"] is None
    assert bound["text"].startswith("No proved bound is drawn: ")
    assert "ask for a [region]" in bound["text"]


def test_a_run_that_does_not_keep_the_guarantee_has_no_bound_beside_it():
    """It stays in one mode, and the guarantee says that modes take turns."""
    network = dd.Network.from_arcs({"G": BOTH, "H": []}, arrow="listens_to", agents=2)
    switching = dd.Switching(guarantee="sequence", sequence=["G", "H"], dwell=1)
    verdict = decided(region=BOX, network=network, switching=switching).verdict
    assert verdict["verdict"] == "proved"
    text = verdict["bound"]["text"]
    assert text == "No proved bound is drawn: the run does not keep the switching guarantee."
