"""Designs of agents that agree on a value, and of pins whose inputs saturate."""

from fractions import Fraction

import pytest

import dobc_design as dd
from dobc_design.certification.cures import missing_arcs
from dobc_design.errors import SpecError

CONSTANT = dd.exosystems.constant()


def agreeing(arcs, **more) -> dd.Problem:
    network = dd.Network.from_arcs(arcs, arrow="listens_to")
    return dd.Problem(network=network, coupling="tanh(y)", goal="agreement", **more)


def test_agents_that_agree_get_an_observer_and_no_pin():
    found = dd.design(agreeing([["a", "b"], ["b", "a"]], exosystem=CONSTANT))
    assert found.is_proved
    assert set(found.changes) == {"observer.W", "observer.P"}
    assert not found.problem.pinning.agents
    assert dd.verify(found.certificate, found.problem).holds


def test_the_fewest_arcs_join_groups_that_hear_nobody_outside():
    """Three such groups need two arcs: by one arc, one of them hears another."""
    arcs = [["a", "b"], ["b", "a"], ["c", "d"], ["e", "d"], ["f", "a"], ["g", "f"], ["h", "h1"]]
    found = dd.design(agreeing(arcs))
    assert found.is_proved
    [rows] = found.changes["network.modes"].values()
    assert rows[len(arcs) :] == [["d", "a"], ["h1", "a"]]
    assert found.decisions[0].startswith("Arcs: Let agent d listen to agent a, agent h1")


def test_graphs_that_take_turns_need_arcs_only_for_what_they_lack_together():
    arcs = {"day": [["a", "b"], ["b", "a"], ["c", "d"]], "night": [["b", "c"], ["e", "f"]]}
    each = missing_arcs(agreeing(arcs))
    turns = dd.Switching(guarantee="sequence", sequence=["day", "night"], dwell=1)
    together = missing_arcs(agreeing(arcs, switching=turns))
    assert [len(modes) for modes in each.set["network.modes"].values()] == [6, 5]
    assert together.set["network.modes"]["day"][3:] == [["f", "d"]]
    assert together.set["network.modes"]["night"] == arcs["night"]


def test_pins_are_nobodys_wish_where_agents_agree():
    with pytest.raises(SpecError, match=r"design of pins needs a target.*missing arcs"):
        dd.design(agreeing([["a", "b"]]), pins=2)


@pytest.mark.slow
def test_pins_of_inputs_that_saturate_are_designed_for_what_is_left_of_them():
    """All pinned, v = 1: the rate is min(k, room/rho), with room = limit - amplitude here."""
    problem = dd.Problem(
        network=dd.Network.from_arcs([[1, 2], [2, 1]], arrow="listens_to"),
        coupling="y",
        target=0,
        actuators={"limit": 1, "saturates": True},
        region={"initial_states": [-2, 2]},
    )
    found = dd.design(problem, rate="2/5")
    assert found.is_proved
    assert max(found.gains.values()) <= Fraction(1, 2)
    beyond = dd.design(problem, rate="3/5")
    assert not beyond.is_proved
    assert beyond.nearest.rate == pytest.approx(0.5, rel=0.11)


def test_a_pin_of_another_mode_is_no_reason_against_a_cure():
    problem = dd.Problem(
        network=dd.Network.from_arcs(
            {"G1": [[2, 1], [3, 2]], "G2": [[1, 2], [3, 2]]}, arrow="listens_to"
        ),
        coupling="y",
        target=1,
        mode_gains={"G1": {1: 1}},
    )
    certificate = dd.certify(problem)
    fixes = [each.fix for each in certificate.checks if each.fix]
    assert fixes[0].set == {"pinning.gains": {"2": 1.5}}
