"""Reports of agents that agree on a value that nobody prescribes."""

import re

import pytest

from dobc_design import Exosystem, Network, Problem, certify
from dobc_design.errors import SpecError
from dobc_design.report.write import render_report

RING = Network.from_arcs([[1, 2], [2, 3], [3, 1]], arrow="listens_to", agents=3)
REGION = {"initial_states": [-1, 1], "initial_disturbance": 0.1}


def ring(**settings) -> Problem:
    known = {"coupling": "tanh(y)", "goal": "agreement", "region": REGION}
    exosystem = Exosystem(A=[[0]], C=[[1]])
    return Problem(network=RING, exosystem=exosystem, name="ring", **known | settings)


@pytest.fixture(scope="module")
def text() -> str:
    """The report in Markdown."""
    (page,) = (data for name, data in render_report(certify(ring())).items() if name[-2:] == "md")
    return page.decode()


def test_a_report_of_agreement_speaks_of_differences_and_of_no_target(text: str):
    told = re.sub(r"(is|are) about a target|without a target|as a target", "", text)
    assert not re.search(r"\btarget\b|\bpin|\\\|e(\\\||\()|k in 1/s", told)
    assert r"starts with max \|xᵢ − xⱼ\| ≤ 2" in told
    assert r"the largest \|xᵢ − xⱼ\| falls to one percent" in told
    assert "Somebody is heard by all" in told


def test_a_card_of_regions_is_about_differences():
    regions = certify(ring()).regions
    assert "all |x_i - x_j| <=" in str(regions)
    assert not regions.agents


def test_a_report_of_agreement_says_between_which_ends_the_value_lies(text: str):
    assert r"The value they agree on lies in \[-1.0981, 1.0981\]." in text
    assert r"u_i = -\hat{d}_i" in text


@pytest.mark.parametrize(
    ("key", "given"), [("target", {"target": 1}), ("pinning", {"gains": {1: 1}})]
)
def test_what_names_a_value_excludes_agreement(key: str, given: dict):
    said = rf'{key} has no meaning with goal = "agreement": nobody prescribes the value'
    with pytest.raises(SpecError, match=said):
        ring(**given)
