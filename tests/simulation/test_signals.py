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
DRAWN = [RandomDwell(dwell=0.3), RandomDwell(dwell=0.3, longest=1), CHAIN]
DRAWN.append(replace(CHAIN, order=("c", "b", "a"), start="b"))
GIVEN = [Fixed(), Fixed(mode="b"), Periodic(dwell=0.5)]
GIVEN.append(Periodic(dwell=[1, 0.25], order=["c", "a"]))
GIVEN.append(Schedule(times=[0, 1.5, 2], modes=["a", "c", "a"]))
MOTION = Waypoints(times=[0, 1], positions=[[[0, 0], [1, 1]], [[0, 0], [3, 1.5]]])
MOBILE = [Mobile(radius=2, hysteresis=0.1), Mobile(neighbours=3), Mobile(radius=1, motion=MOTION)]


@pytest.mark.parametrize("signal", DRAWN + GIVEN + MOBILE, ids=str)
def test_the_json_of_a_signal_holds_all_of_it(signal):
    document = json.loads(signal_to_json(signal))
    assert document.pop("signal") == signal.kind
    if document.get("motion"):
        document["motion"] = Waypoints(**document["motion"])
    again = type(signal)(**document)
    assert again == signal
    assert hash(again) == hash(signal)
    assert str(signal)


@pytest.mark.parametrize("signal", DRAWN + GIVEN, ids=str)
def test_the_seed_decides_the_switches(signal):
    first = scheduled_switches(signal, NAMES, 30.0, 5)
    again = scheduled_switches(signal, NAMES, 30.0, 5)
    assert first.times.tolist() == again.times.tolist()
    assert first.modes.tolist() == again.modes.tolist()
    assert first.times[0] == 0
    assert (np.diff(first.times) > 0).all()
    assert first.times[-1] < 30
    assert (np.diff(first.modes) != 0).all()
    other = scheduled_switches(signal, NAMES, 30.0, 6)
    found = np.array_equal(first.times, other.times)
    assert found == (signal in GIVEN)


def test_a_random_signal_draws_each_mode_equally_often():
    """At multiples of the dwell time; three of 3000 draws' counts within four standard
    deviations."""
    found = scheduled_switches(RandomDwell(dwell=0.5), NAMES, 1500.0, 1)
    modes = found.at(0.5 * np.arange(3000) + 0.1)
    answer = np.abs(np.bincount(modes) - 1000).max()
    assert answer < 4 * np.sqrt(3000 * 2 / 9)
    answer = (found.times / 0.5 % 1).tolist()
    assert set(answer) == {0.0}


@pytest.mark.parametrize("seed", range(20))
def test_with_a_longest_time_modes_differ_and_last_between_the_two_times(seed):
    names = NAMES[: 2 + seed % 2]
    signal = RandomDwell(dwell=0.3, longest=0.5)
    found = scheduled_switches(signal, names, 100.0, seed)
    stays = np.diff(found.times)
    assert stays.min() >= 0.3 - 1e-12
    assert stays.max() <= 0.5 + 1e-12
    assert 100 - found.times[-1] <= 0.5
    visited = set(found.modes.tolist())
    every_mode = set(range(len(names)))
    assert visited == every_mode


def test_a_markov_signal_stays_and_jumps_as_its_generator_says():
    """Mean stay -1/pi_kk and jump probabilities -pi_kl/pi_kk, within four standard deviations."""
    found = scheduled_switches(CHAIN, NAMES, 20_000.0, 3)
    stays = np.diff(found.times)
    modes = found.modes[:-1]
    for k, rate in enumerate((3, 0.5, 2)):
        own = stays[modes == k]
        deviation = abs(own.mean() * rate - 1)
        allowed = 4 / np.sqrt(len(own))
        assert deviation < allowed
    after = found.modes[1:][modes == 0]
    deviation_after = abs((after == 1).mean() - 2 / 3)
    allowed_after = 4 * np.sqrt(2 / 9 / len(after))
    assert deviation_after < allowed_after
    answer = found.modes[1:][modes == 1].tolist()
    assert set(answer) == {0}


def test_at_an_instant_of_switching_the_new_mode_is_active_and_one_never_left_ends_the_signal():
    times = [0, 1.5, 2]
    modes = ["a", "c", "a"]
    signal = Schedule(times=times, modes=modes)
    found = scheduled_switches(signal, NAMES, 5.0, 0)
    answer = found.at(np.array([0, 1.4, 1.5, 1.9, 2, 5])).tolist()
    expected = [0, 0, 2, 2, 0, 0]
    assert answer == expected
    generator = [[-1, 1], [0, 0]]
    once = Markov(generator=generator)
    switches = scheduled_switches(once, ("a", "b"), 1e9, 0)
    answer = switches.modes.tolist()
    assert answer == [0, 1]
    assert "for ever" in str(once)


WRONG = {  # what is said -> a signal that cannot be
    "dwell must be a time > 0 in s": lambda: Periodic(dwell=0),
    "at least one time": lambda: Periodic(dwell=[]),
    r"dwell\[1\] must be": lambda: Periodic(dwell=[1, -1]),
    "got nan": lambda: RandomDwell(dwell=float("nan")),
    "longest must be >= dwell": lambda: RandomDwell(dwell=1, longest=0.5),
    r"generator\[1\] must add up to 0": lambda: Markov(generator=[[-1, 1], [1, 0]]),
    r"generator\[0\]\[1\] must be a number >= 0": lambda: Markov(generator=[[1, -1], [1, -1]]),
    "generator must be a square matrix": lambda: Markov(generator=[[0, 0]]),
    "must begin with 0 and increase": lambda: Schedule(times=[0, 2, 2], modes="aba"),
    "equally long": lambda: Schedule(times=[0], modes=[]),
    "either radius or neighbours": Mobile,
    "and not both": lambda: Mobile(radius=1, neighbours=2),
    "hysteresis must be a number >= 0": lambda: Mobile(radius=1, hysteresis=-1),
    "neighbours must be a whole number >= 1": lambda: Mobile(neighbours=0),
    "with 2 times": lambda: Waypoints(times=[0, 1], positions=[[[0]]]),
    "times must increase": lambda: Waypoints(times=[1, 1], positions=[[[0]], [[1]]]),
}


@pytest.mark.parametrize(("message", "make"), WRONG.items())
def test_a_wrong_signal_is_refused(make, message: str):
    with pytest.raises(SpecError, match=message):
        make()


ALTERNATING = Markov(generator=[[-1, 1], [1, -1]])
HECTIC = Markov(generator=[[-1e9, 1e9, 0], [1e9, -1e9, 0], [0, 0, 0]])


@pytest.mark.parametrize("signal", [RandomDwell(dwell=1e-9), Periodic(dwell=1e-9), HECTIC], ids=str)
def test_a_signal_that_switches_too_often_is_refused(signal):
    with pytest.raises(SpecError, match="at most 1000000"):
        scheduled_switches(signal, NAMES, 10.0, 0)


@pytest.mark.parametrize("signal", [Periodic(dwell=[1, 2]), ALTERNATING], ids=str)
def test_a_signal_of_another_number_of_modes_is_refused(signal):
    with pytest.raises(ShapeError, match="one per mode; got 2"):
        scheduled_switches(signal, NAMES, 10.0, 0)


STRANGERS = [Fixed(mode="d"), Schedule(times=[0], modes=["z"]), replace(CHAIN, start="z")]


@pytest.mark.parametrize("signal", STRANGERS, ids=str)
def test_a_signal_that_names_another_mode_is_refused(signal):
    with pytest.raises(SpecError, match="mode must be one of"):
        scheduled_switches(signal, NAMES, 10.0, 0)


def switched(section: dd.Switching | None, modes: str = "abc") -> dd.Problem:
    arcs = {name: [[1, 2]] for name in modes}
    network = dd.Network.from_arcs(arcs, arrow="listens_to", agents=2)
    return dd.Problem(network=network, coupling="y", switching=section)


def chosen(modes: str = "abc", **section):
    """The signal of a section, and what is said of it."""
    problem = switched(dd.Switching(**section), modes)
    return signal_of(problem)


def test_sections_become_signals_and_what_was_chosen_or_is_not_used_is_said():
    found = chosen(signal="periodic", dwell=2)
    assert found == (Periodic(dwell=2), None)
    signal, remark = chosen(signal="random")
    assert signal == RandomDwell(dwell=0.5)
    assert "switching.dwell is not given: 0.5 s" in remark
    signal, remark = chosen(signal="markov", dwell="1/2")
    generator = [[-2, 1, 1], [1, -2, 1], [1, 1, -2]]
    assert signal == Markov(generator=generator)
    assert "equally likely" in remark
    kept = RandomDwell(dwell=1 / 3, longest=2)
    found = chosen(guarantee="dwell", dwell="1/3", longest=2)
    assert found == (kept, None)
    assert chosen("a", signal="random")[0] == Fixed()
    found = signal_of(switched(None, "a"))
    assert found == (Fixed(), None)
    assert "a is active throughout" in signal_of(switched(None))[1]
    _, remark = chosen("ab", signal="mobile", radius=1, dwell=2)
    assert remark == "switching.dwell is not used by a mobile signal."


READ = []  # sections, and the signals that they describe


def reads(wanted, **section):
    READ.append((dd.Switching(**section), wanted))


turns = [[0, "b"], [0.5, "a"], [2, "b"]]
rates = [[-1, 1, 0], [0, -2, 2], ["1/4", "1/4", "-1/2"]]
chain = Markov(generator=((-1, 1, 0), (0, -2, 2), (0.25, 0.25, -0.5)))
reads(Periodic(dwell=2, order=("c", "a")), signal="periodic", dwell=2, sequence=["c", "a"])
reads(Periodic(dwell=1), signal="periodic", period=3)
reads(Periodic(dwell=1.5, order=("b", "a")), signal="periodic", period=3, sequence=["b", "a"])
reads(Periodic(dwell=(0.5, 1.5, 1), order="bab"), signal="periodic", schedule=turns, period=3)
reads(chain, signal="markov", generator=rates)
reads(Schedule(times=(0, 2.5), modes="ca"), signal="schedule", schedule=[[0, "c"], ["5/2", "a"]])
reads(Mobile(radius=2.5, hysteresis=0.25), signal="mobile", radius=2.5, hysteresis="1/4")
reads(Mobile(neighbours=1), signal="mobile", neighbours=1)


@pytest.mark.parametrize(("section", "signal"), READ, ids=str)
def test_every_key_of_the_section_reaches_the_signal(section: dd.Switching, signal):
    assert signal_of(switched(section)) == (signal, None)


FAR = {  # key -> a section with a number beyond the floats
    "switching.dwell": dd.Switching(signal="random", dwell="1e399"),
    "switching.schedule[1][0]": dd.Switching(
        signal="schedule", schedule=[[0, "a"], ["1e399", "b"]]
    ),
    "switching.radius": dd.Switching(signal="mobile", radius="1e-399"),
    "switching.generator": dd.Switching(signal="markov", generator=[["-1e399", "1e399"], [0, 0]]),
}


@pytest.mark.parametrize(("key", "section"), FAR.items())
def test_numbers_beyond_floats_are_refused_by_their_key(section: dd.Switching, key: str):
    with pytest.raises(SpecError, match="beyond the range of floats") as caught:
        signal_of(switched(section, "ab"))
    assert caught.value.key == key
