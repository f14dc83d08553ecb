"""Switching signals: reproducible, with the instants and frequencies they promise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dobc_design.errors import ShapeError, SpecError
from dobc_design.problem.load import load_problem
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem
from dobc_design.problem.settings import Switching
from dobc_design.simulation.signals import (
    Fixed,
    Markov,
    Mobile,
    Periodic,
    RandomDwell,
    Schedule,
    Waypoints,
    signal_from_json,
    signal_of,
    signal_to_json,
)
from dobc_design.simulation.switches import scheduled_switches

NAMES = ("a", "b", "c")
CHAIN = Markov(generator=[[-3, 2, 1], [0.5, -0.5, 0], [1, 1, -2]])
SIGNALS = [
    Fixed(),
    Fixed(mode="b"),
    Periodic(dwell=0.5),
    Periodic(dwell=[1, 0.25], order=["c", "a"]),
    RandomDwell(dwell=0.3),
    RandomDwell(dwell=0.3, longest=1),
    CHAIN,
    replace(CHAIN, order=("c", "b", "a"), start="b"),
    Schedule(times=[0, 1.5, 2], modes=["a", "c", "a"]),
    Mobile(radius=2, hysteresis=0.1),
    Mobile(neighbours=3),
    Mobile(radius=1, motion=Waypoints(times=[0, 1], positions=[[[0, 0], [1, 1]], [[0, 0], [3, 1.5]]])),
]


@pytest.mark.parametrize("signal", SIGNALS, ids=str)
def test_a_signal_survives_json_and_can_be_printed(signal):
    assert signal_from_json(signal_to_json(signal)) == signal
    assert str(signal)
    assert hash(signal) == hash(signal_from_json(signal_to_json(signal)))


@pytest.mark.parametrize("signal", [s for s in SIGNALS if not isinstance(s, Mobile)], ids=str)
def test_the_seed_decides_the_switches(signal):
    first, again = (scheduled_switches(signal, NAMES, 30.0, 5) for _ in range(2))
    assert first == again
    assert first.times[0] == 0
    assert (np.diff(first.times) > 0).all()
    assert first.times[-1] < 30
    assert (np.diff(first.modes) != 0).all()
    other = scheduled_switches(signal, NAMES, 30.0, 6)
    assert (first == other) == isinstance(signal, (Fixed, Periodic, Schedule))


def test_a_periodic_signal_switches_at_multiples_of_its_dwell_time():
    found = scheduled_switches(Periodic(dwell=0.1), NAMES, 10.0, 0)
    assert found.times.tolist() == (0.1 * np.arange(100)).tolist()
    assert found.modes[:4].tolist() == [0, 1, 2, 0]


def test_dwell_times_may_differ_from_mode_to_mode():
    found = scheduled_switches(Periodic(dwell=[1, 0.25], order=["c", "a"]), NAMES, 3.0, 0)
    assert found.times.tolist() == [0, 1, 1.25, 2.25, 2.5]
    assert found.modes.tolist() == [2, 0, 2, 0, 2]


def test_a_random_signal_draws_each_mode_equally_often():
    """At multiples of the dwell time; three of 3000 draws' counts within four standard deviations."""
    found = scheduled_switches(RandomDwell(dwell=0.5), NAMES, 1500.0, 1)
    modes = found.at(0.5 * np.arange(3000) + 0.1)
    assert np.abs(np.bincount(modes) - 1000).max() < 4 * np.sqrt(3000 * 2 / 9)
    assert set((found.times / 0.5 % 1).tolist()) == {0.0}


def test_random_stays_lie_between_the_two_dwell_times():
    found = scheduled_switches(RandomDwell(dwell=0.3, longest=0.5), ("a", "b"), 100.0, 1)
    stays = np.diff(found.times)
    assert stays.min() >= 0.3
    multiples = np.ceil(stays / 0.5)  # a mode may be drawn again
    assert (stays >= 0.3 * multiples - 1e-12).all()


def test_a_markov_signal_stays_and_jumps_as_its_generator_says():
    """Mean stay -1/pi_kk and jump probabilities -pi_kl/pi_kk, within four standard deviations."""
    found = scheduled_switches(CHAIN, NAMES, 20_000.0, 3)
    stays, modes = np.diff(found.times), found.modes[:-1]
    for k, rate in enumerate((3, 0.5, 2)):
        own = stays[modes == k]
        assert abs(own.mean() * rate - 1) < 4 / np.sqrt(len(own))
    after = found.modes[1:][modes == 0]
    assert abs((after == 1).mean() - 2 / 3) < 4 * np.sqrt(2 / 9 / len(after))
    assert not (found.modes[1:][modes == 1] == 2).any()
    assert not (found.modes[1:][modes == 1] == 1).any()


def test_a_mode_that_is_never_left_ends_a_markov_signal():
    found = scheduled_switches(Markov(generator=[[-1, 1], [0, 0]]), ("a", "b"), 1e9, 0)
    assert found.modes.tolist() == [0, 1]
    assert "for ever" in str(Markov(generator=[[-1, 1], [0, 0]]))


def test_at_an_instant_of_switching_the_new_mode_is_active():
    found = scheduled_switches(Schedule(times=[0, 1.5, 2], modes=["a", "c", "a"]), NAMES, 5.0, 0)
    assert found.at(np.array([0, 1.4, 1.5, 1.9, 2, 5])).tolist() == [0, 0, 2, 2, 0, 0]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Periodic(dwell=0), "dwell must be a time > 0 in s"),
        (lambda: Periodic(dwell=[]), "at least one time"),
        (lambda: Periodic(dwell=[1, -1]), r"dwell\[1\] must be"),
        (lambda: RandomDwell(dwell=float("nan")), "got nan"),
        (lambda: RandomDwell(dwell=1, longest=0.5), "longest must be >= dwell"),
        (lambda: Markov(generator=[[-1, 1], [1, 0]]), r"generator\[1\] must add up to 0"),
        (lambda: Markov(generator=[[1, -1], [1, -1]]), r"generator\[0\]\[1\] must be a number >= 0"),
        (lambda: Markov(generator=[[0, 0]]), "generator must be a square matrix"),
        (lambda: Schedule(times=[1], modes=["a"]), "must begin with 0"),
        (lambda: Schedule(times=[0, 2, 2], modes=["a", "b", "a"]), "must begin with 0 and increase"),
        (lambda: Schedule(times=[0], modes=[]), "equally long"),
        (Mobile, "either radius or neighbours"),
        (lambda: Mobile(radius=1, neighbours=2), "and not both"),
        (lambda: Mobile(radius=-1), "radius must be"),
        (lambda: Mobile(radius=1, hysteresis=-1), "hysteresis must be a number >= 0"),
        (lambda: Mobile(neighbours=0), "neighbours must be a whole number >= 1"),
        (lambda: Waypoints(times=[0, 1], positions=[[[0]]]), "with 2 times"),
        (lambda: Waypoints(times=[1, 1], positions=[[[0]], [[1]]]), "times must increase"),
    ],
)
def test_a_wrong_signal_is_refused(make, message: str):
    with pytest.raises(SpecError, match=message):
        make()


@pytest.mark.parametrize(
    ("signal", "message"),
    [
        (Fixed(mode="d"), "mode must be one of"),
        (Periodic(dwell=[1, 2]), "one per mode; got 2"),
        (Markov(generator=[[-1, 1], [1, -1]]), "one per mode; got 2"),
        (RandomDwell(dwell=1e-9), "at most 1000000"),
        (Periodic(dwell=1e-9), "at most 1000000"),
        (Markov(generator=[[-1e9, 1e9, 0], [1e9, -1e9, 0], [0, 0, 0]]), "at most"),
        (Schedule(times=[0], modes=["z"]), "mode must be one of"),
        (replace(CHAIN, start="z"), "mode must be one of"),
    ],
)
def test_a_signal_that_does_not_fit_the_modes_is_refused(signal, message: str):
    with pytest.raises((SpecError, ShapeError), match=message):
        scheduled_switches(signal, NAMES, 10.0, 0)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        '{"signal": "chaos"}',
        '{"signal": "periodic"}',
        '{"signal": "periodic", "dwell": 1, "x": 2}',
        '{"signal": "markov", "generator": 3}',
        '{"signal": "mobile", "radius": 1, "motion": {"times": [0]}}',
        '{"signal": "periodic", "dwell": {}}',
    ],
)
def test_what_is_no_signal_is_refused(text: str):
    with pytest.raises(SpecError):
        signal_from_json(text)


def switched(signal: str | None, *, dwell=None, modes=("a", "b", "c")) -> Problem:
    network = Network.from_arcs({name: [[1, 2]] for name in modes}, arrow="listens_to", agents=2)
    return Problem(
        network=network, coupling="y", switching=None if signal is None else Switching(signal=signal, dwell=dwell)
    )


def test_the_section_of_the_paper_s_second_example_is_a_random_signal():
    assert signal_of(load_problem("paper-switching")) == (RandomDwell(dwell=0.5), None)


def test_sections_become_signals_and_what_was_chosen_is_said():
    assert signal_of(switched("periodic", dwell=2)) == (Periodic(dwell=2), None)
    signal, remark = signal_of(switched("random"))
    assert signal == RandomDwell(dwell=0.5)
    assert "switching.dwell is not given: 0.5 s" in remark
    signal, remark = signal_of(switched("markov", dwell="1/2"))
    assert signal == Markov(generator=[[-2, 1, 1], [1, -2, 1], [1, 1, -2]])
    assert "equally likely" in remark
    assert signal_of(switched("random", modes=("a",)))[0] == Fixed()
    assert signal_of(switched(None, modes=("a",))) == (Fixed(), None)
    assert "a is active throughout" in signal_of(switched(None))[1]


@pytest.mark.parametrize(
    ("section", "signal"),
    [
        (Switching(signal="periodic", dwell=2, sequence=["c", "a"]), Periodic(dwell=2, order=("c", "a"))),
        (Switching(signal="periodic", period=3), Periodic(dwell=1)),
        (Switching(signal="periodic", period=3, sequence=["b", "a"]), Periodic(dwell=1.5, order=("b", "a"))),
        (
            Switching(signal="periodic", schedule=[[0, "b"], [0.5, "a"], [2, "b"]], period=3),
            Periodic(dwell=(0.5, 1.5, 1.0), order=("b", "a", "b")),
        ),
        (
            Switching(signal="markov", generator=[[-1, 1, 0], [0, -2, 2], ["1/4", "1/4", "-1/2"]]),
            Markov(generator=((-1, 1, 0), (0, -2, 2), (0.25, 0.25, -0.5))),
        ),
        (Switching(signal="schedule", schedule=[[0, "c"], ["5/2", "a"]]), Schedule(times=(0, 2.5), modes=("c", "a"))),
        (Switching(signal="mobile", radius=2.5, hysteresis="1/4"), Mobile(radius=2.5, hysteresis=0.25)),
        (Switching(signal="mobile", neighbours=1), Mobile(neighbours=1)),
    ],
    ids=str,
)
def test_every_key_of_the_section_reaches_the_signal(section: Switching, signal):
    network = Network.from_arcs({name: [[1, 2]] for name in "abc"}, arrow="listens_to", agents=2)
    assert signal_of(Problem(network=network, coupling="y", switching=section)) == (signal, None)


def test_a_dwell_time_that_a_signal_does_not_use_is_said():
    network = Network.from_arcs({name: [[1, 2]] for name in "ab"}, arrow="listens_to", agents=2)
    section = Switching(signal="mobile", radius=1, dwell=2)
    remark = signal_of(Problem(network=network, coupling="y", switching=section))[1]
    assert remark == "switching.dwell is not used by a mobile signal."


@pytest.mark.parametrize(
    ("section", "key"),
    [
        (Switching(signal="random", dwell="1e399"), "switching.dwell"),
        (Switching(signal="schedule", schedule=[[0, "a"], ["1e399", "b"]]), "switching.schedule[1][0]"),
        (Switching(signal="mobile", radius="1e-399"), "switching.radius"),
        (Switching(signal="markov", generator=[["-1e399", "1e399"], [0, 0]]), "switching.generator"),
    ],
)
def test_numbers_beyond_floats_are_refused_by_their_key(section: Switching, key: str):
    network = Network.from_arcs({name: [[1, 2]] for name in "ab"}, arrow="listens_to", agents=2)
    with pytest.raises(SpecError, match="beyond the range of floats") as caught:
        signal_of(Problem(network=network, coupling="y", switching=section))
    assert caught.value.key == key
