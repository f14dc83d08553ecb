"""Assertions for the unit tests of users: what passes, and what a failure says."""

import json

import pytest

import dobc_design as dd
from dobc_design import Network, Observer, Problem, Verdict
from dobc_design.errors import SpecError
from dobc_design.testing import (
    assert_condition,
    assert_proved,
    assert_refuted,
    assert_verified,
)


@pytest.fixture
def pair(constant):
    """Agent 2 listens to agent 1, which is pinned; linear, so everything holds for every start."""
    return Problem(
        name="pair",
        network=Network.from_arcs([[2, 1]], arrow="listens_to", agents=2),
        coupling="y",
        gains={1: 2},
        exosystem=constant,
        observer=Observer(W=[[3]]),
    )


@pytest.fixture
def constant():
    return dd.exosystems.constant()


def test_a_proved_problem_passes_with_its_rate_and_not_with_a_greater_one(pair):
    """The error system is triangular with poles -1, -2 and -3: no rate above 1 exists."""
    certificate = assert_proved(pair, rate="1/2")
    assert certificate.verdict is Verdict.PROVED
    with pytest.raises(AssertionError, match=r"pair: the proved rate is 0\.\d+, less than the 2"):
        assert_proved(pair, rate=2)
    with pytest.raises(AssertionError, match=r"(?s)Reason: .* reach the target.*Cure: dd\.design "):
        assert_proved(pair, rate=2)


def test_a_region_takes_the_place_of_that_of_the_problem(pair):
    region = {"initial_states": [-1, 1], "initial_disturbance": 1}
    assert assert_proved(pair, region=region).problem.region is not None


def test_a_failure_names_the_condition_the_witness_and_the_cure(pair):
    unpinned = pair.replace(gains={})
    with pytest.raises(AssertionError) as failure:
        assert_proved(unpinned)
    text = str(failure.value)
    assert text.startswith("pair is refuted, not proved.")
    assert "reachability (G) is refuted." in text
    assert "Witness: agents 1, 2" in text
    assert "Cure: Pin agent 1" in text
    assert assert_refuted(unpinned).verdict is Verdict.REFUTED
    with pytest.raises(AssertionError, match="pair is proved, not refuted"):
        assert_refuted(pair)


def test_one_condition_is_asked_by_its_id(pair):
    assert assert_condition(pair, "hurwitz", rate="5/2").id == "hurwitz"
    with pytest.raises(AssertionError, match=r"the proved rate is 2\.9\d+, less than the 3"):
        assert_condition(pair, "hurwitz", rate=3)
    with pytest.raises(AssertionError, match=r"lemma1 \(G\) is refuted, not proved"):
        assert_condition(pair.replace(gains={}), "lemma1")
    assert_condition(pair.replace(gains={}), "lemma1", verdict=Verdict.REFUTED)
    with pytest.raises(AssertionError, match="theorem2 was not examined here"):
        assert_condition(pair, "theorem2")
    with pytest.raises(AssertionError, match=r"lemma1 has no mode 'damp'; its modes are G\."):
        assert_condition(pair, "lemma1", mode="damp")
    with pytest.raises(SpecError, match="no condition 'theorem3'"):
        assert_condition(pair, "theorem3")


def test_a_kept_certificate_is_verified_and_a_changed_one_is_not(pair, tmp_path):
    dd.certify(pair).save(tmp_path)
    assert_verified(tmp_path, pair)
    with pytest.raises(AssertionError, match="does not hold"):
        assert_verified(tmp_path, pair.replace(gains={1: 1}))
    file = tmp_path / "certificate.json"
    document = json.loads(file.read_text("utf-8"))
    document["rate"] = 1.5
    file.write_text(json.dumps(document), "utf-8")
    with pytest.raises(AssertionError, match="does not hold"):
        assert_verified(tmp_path, pair)
