"""The Designer of agents that agree on a value: arcs, differences, no pins."""

import numpy as np
import pytest

pytest.importorskip(
    "anywidget", reason="needs the extra `notebook`: pip install 'dobc_design[notebook]'"
)

import dobc_design as dd
from dobc_design.errors import SpecError


def agreeing(arcs, **more) -> dd.Problem:
    network = dd.Network.from_arcs(arcs, arrow="listens_to")
    return dd.Problem(network=network, coupling="tanh(y)", goal="agreement", **more)


def test_differences_stay_below_the_proved_bound_that_is_drawn():
    region = {"initial_states": [2, 6]}
    designer = dd.Designer(agreeing([[1, 2], [2, 3], [3, 1], [1, 3]], region=region))
    assert designer.radius == 4
    designer.certify()
    errors = np.array(designer.numbers["errors"])
    assert 0 < errors[:, 0].max() <= 4
    assert (errors <= designer.verdict["bound"]["tube"]).all()
    assert "the largest |xᵢ − xⱼ|" in designer.verdict["text"]


def test_another_distance_of_starts_keeps_their_middle():
    designer = dd.Designer(agreeing([[1, 2], [2, 1]], region={"initial_states": [2, 6]}))
    designer.radius = 2.0
    assert designer.problem.region.initial_states == ((3, 5),)


def test_an_arc_that_is_drawn_cures_groups_that_hear_nobody():
    designer = dd.Designer(agreeing([[1, 2], [2, 1], [3, 4], [4, 3]]))
    designer.certify()
    assert designer.verdict["verdict"] == "refuted"
    assert "Let agent 3 listen to agent 1" in designer.verdict["text"]
    (mode,) = designer.arcs
    designer.arcs = {mode: [*designer.arcs[mode], [2, 0, "1"]]}
    designer.certify()
    assert designer.verdict["verdict"] == "proved"


def test_differences_to_one_agent_are_no_bound_of_all():
    designer = dd.Designer(agreeing([[2, 1], [3, 1]], region={"initial_states": [0, 1]}))
    designer.certify()
    assert designer.verdict["verdict"] == "proved"
    assert designer.verdict["bound"]["text"].endswith("differences to one agent.")


def test_fixed_nodes_and_signs_are_refused_by_name():
    apart = dd.Network.from_arcs([[1, 2, -1], [2, 1, -1]], arrow="listens_to", negative="opposes")
    with pytest.raises(SpecError, match="the Designer does not know agents that oppose others"):
        dd.Designer(dd.Problem(network=apart, coupling="y"))
