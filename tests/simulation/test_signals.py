"""Switching signals: reproducible, with the instants and frequencies they promise."""

import json
from dataclasses import replace

import numpy as np
import pytest

import dobc_design as dd
from dobc_design.errors import ShapeError, SpecError
from dobc_design.simulation.signals import (
    Fixed,
    Markov,
    Mobile,
    Periodic,
    RandomDwell,
    Schedule,
    Waypoints,
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
    Mobile(
        radius=1,
        motion=Waypoints(times=[0, 1], positions=[[[0, 0], [1, 1]], [[0, 0], [3, 1.5]]]),
    ),
]


@pytest.mark.parametrize("signal", SIGNALS, ids=str)
def test_the_json_of_a_signal_holds_all_of_it(signal):
    document = json.loads(signal_to_json(signal))
    assert document.pop("signal") == signal.kind
    if document.get("motion"):
        document["motion"] = Waypoints(**document["motion"])
    again = type(signal)(**document)
    assert again == signal
    assert hash(again) == hash(signal)
    assert str(signal)


@pytest.mark.parametrize("signal", [s for s in SIGNALS if not isinstance(s, Mobile)], ids=str)
def test_the_seed_decides_the_switches(signal):
    first, again = (scheduled_switches(signal, NAMES, 30.0, 5) for _ in range(2))
    assert first.times.tolist() == again.times.tolist()
    assert first.modes.tolist() == again.modes.tolist()
    assert first.times[0] == 0
    assert (np.diff(first.times) > 0).all()
    assert first.times[-1] < 30
    assert (np.diff(first.modes) != 0).all()
    other = scheduled_switches(signal, NAMES, 30.0, 6)
    assert np.array_equal(first.times, other.times) == isinstance(
        signal, (Fixed, Periodic, Schedule)
    )


def test_a_random_signal_draws_each_mode_equally_often():
    """At multiples of the dwell time; three of 3000 draws' counts within four standard
    deviations."""
    found = scheduled_switches(RandomDwell(dwell=0.5), NAMES, 1500.0, 1)
    modes = found.at(0.5 * np.arange(3000) + 0.1)
    assert np.abs(np.bincount(modes) - 1000).max() < 4 * np.sqrt(3000 * 2 / 9)
    assert set((found.times / 0.5 % 1).tolist()) == {0.0}


@pytest.mark.parametrize("seed", range(20))
def test_with_a_longest_time_modes_differ_and_last_between_the_two_times(seed):
    found = scheduled_switches(
        RandomDwell(dwell=0.3, longest=0.5), NAMES[: 2 + seed % 2], 100.0, seed
    )
    stays = np.diff(found.times)
    assert stays.min() >= 0.3 - 1e-12
    assert stays.max() <= 0.5 + 1e-12
    assert 100 - found.times[-1] <= 0.5
    assert set(found.modes.tolist()) == set(range(2 + seed % 2))


def test_a_markov_signal_stays_and_jumps_as_its_generator_says():
    """Mean stay -1/pi_kk and jump probabilities -pi_kl/pi_kk, within four standard deviations."""
    found = scheduled_switches(CHAIN, NAMES, 20_000.0, 3)
    stays = np.diff(found.times)
    modes = found.modes[:-1]
    for k, rate in enumerate((3, 0.5, 2)):
        own = stays[modes == k]
        assert abs(own.mean() * rate - 1) < 4 / np.sqrt(len(own))
    after = found.modes[1:][modes == 0]
    assert abs((after == 1).mean() - 2 / 3) < 4 * np.sqrt(2 / 9 / len(after))
    assert not (found.modes[1:][modes == 1] == 2).any()
    assert not (found.modes[1:][modes == 1] == 1).any()


def test_at_an_instant_of_switching_the_new_mode_is_active_and_one_never_left_ends_the_signal():
    found = scheduled_switches(Schedule(times=[0, 1.5, 2], modes=["a", "c", "a"]), NAMES, 5.0, 0)
    assert found.at(np.array([0, 1.4, 1.5, 1.9, 2, 5])).tolist() == [0, 0, 2, 2, 0, 0]
    found = scheduled_switches(Markov(generator=[[-1, 1], [0, 0]]), ("a", "b"), 1e9, 0)
    assert found.modes.tolist() == [0, 1]
    assert "for ever" in str(Markov(generator=[[-1, 1], [0, 0]]))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Periodic(dwell=0), "dwell must be a time > 0 in s"),
        (lambda: Periodic(dwell=[]), "at least one time"),
        (lambda: Periodic(dwell=[1, -1]), r"dwell\[1\] must be"),
        (lambda: RandomDwell(dwell=float("nan")), "got nan"),
        (lambda: RandomDwell(dwell=1, longest=0.5), "longest must be >= dwell"),
        (
            lambda: Markov(generator=[[-1, 1], [1, 0]]),
            r"generator\[1\] must add up to 0",
        ),
        (
            lambda: Markov(generator=[[1, -1], [1, -1]]),
            r"generator\[0\]\[1\] must be a number >= 0",
        ),
        (lambda: Markov(generator=[[0, 0]]), "generator must be a square matrix"),
        (
            lambda: Schedule(times=[0, 2, 2], modes=["a", "b", "a"]),
            "must begin with 0 and increase",
        ),
        (lambda: Schedule(times=[0], modes=[]), "equally long"),
        (Mobile, "either radius or neighbours"),
        (lambda: Mobile(radius=1, neighbours=2), "and not both"),
        (lambda: Mobile(radius=1, hysteresis=-1), "hysteresis must be a number >= 0"),
        (lambda: Mobile(neighbours=0), "neighbours must be a whole number >= 1"),
        (lambda: Waypoints(times=[0, 1], positions=[[[0]]]), "with 2 times"),
        (
            lambda: Waypoints(times=[1, 1], positions=[[[0]], [[1]]]),
            "times must increase",
        ),
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


def switched(section: dd.Switching | None, modes: str = "abc") -> dd.Problem:
    network = dd.Network.from_arcs({name: [[1, 2]] for name in modes}, arrow="listens_to", agents=2)
    return dd.Problem(network=network, coupling="y", switching=section)


def test_sections_become_signals_and_what_was_chosen_or_is_not_used_is_said():
    assert signal_of(switched(dd.Switching(signal="periodic", dwell=2))) == (
        Periodic(dwell=2),
        None,
    )
    signal, remark = signal_of(switched(dd.Switching(signal="random")))
    assert signal == RandomDwell(dwell=0.5)
    assert "switching.dwell is not given: 0.5 s" in remark
    signal, remark = signal_of(switched(dd.Switching(signal="markov", dwell="1/2")))
    assert signal == Markov(generator=[[-2, 1, 1], [1, -2, 1], [1, 1, -2]])
    assert "equally likely" in remark
    own = dd.Switching(guarantee="dwell", dwell="1/3", longest=2)
    assert signal_of(switched(own)) == (RandomDwell(dwell=1 / 3, longest=2), None)
    assert signal_of(switched(dd.Switching(signal="random"), "a"))[0] == Fixed()
    assert signal_of(switched(None, "a")) == (Fixed(), None)
    assert "a is active throughout" in signal_of(switched(None))[1]
    section = dd.Switching(signal="mobile", radius=1, dwell=2)
    remark = signal_of(switched(section, "ab"))[1]
    assert remark == "switching.dwell is not used by a mobile signal."


@pytest.mark.parametrize(
    ("section", "signal"),
    [
        (
            dd.Switching(signal="periodic", dwell=2, sequence=["c", "a"]),
            Periodic(dwell=2, order=("c", "a")),
        ),
        (dd.Switching(signal="periodic", period=3), Periodic(dwell=1)),
        (
            dd.Switching(signal="periodic", period=3, sequence=["b", "a"]),
            Periodic(dwell=1.5, order=("b", "a")),
        ),
        (
            dd.Switching(signal="periodic", schedule=[[0, "b"], [0.5, "a"], [2, "b"]], period=3),
            Periodic(dwell=(0.5, 1.5, 1.0), order=("b", "a", "b")),
        ),
        (
            dd.Switching(
                signal="markov", generator=[[-1, 1, 0], [0, -2, 2], ["1/4", "1/4", "-1/2"]]
            ),
            Markov(generator=((-1, 1, 0), (0, -2, 2), (0.25, 0.25, -0.5))),
        ),
        (
            dd.Switching(signal="schedule", schedule=[[0, "c"], ["5/2", "a"]]),
            Schedule(times=(0, 2.5), modes=("c", "a")),
        ),
        (
            dd.Switching(signal="mobile", radius=2.5, hysteresis="1/4"),
            Mobile(radius=2.5, hysteresis=0.25),
        ),
        (dd.Switching(signal="mobile", neighbours=1), Mobile(neighbours=1)),
    ],
    ids=str,
)
def test_every_key_of_the_section_reaches_the_signal(section: dd.Switching, signal):
    assert signal_of(switched(section)) == (signal, None)


@pytest.mark.parametrize(
    ("section", "key"),
    [
        (dd.Switching(signal="random", dwell="1e399"), "switching.dwell"),
        (
            dd.Switching(signal="schedule", schedule=[[0, "a"], ["1e399", "b"]]),
            "switching.schedule[1][0]",
        ),
        (dd.Switching(signal="mobile", radius="1e-399"), "switching.radius"),
        (
            dd.Switching(signal="markov", generator=[["-1e399", "1e399"], [0, 0]]),
            "switching.generator",
        ),
    ],
)
def test_numbers_beyond_floats_are_refused_by_their_key(section: dd.Switching, key: str):
    with pytest.raises(SpecError, match="beyond the range of floats") as caught:
        signal_of(switched(section, "ab"))
    assert caught.value.key == key
