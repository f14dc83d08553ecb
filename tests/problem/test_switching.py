"""[switching] and simulation.x0: every key there and back, what each signal may have, and words for
people."""

import json
import pickle
from fractions import Fraction
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from networks import network_of

from dobc_design import Problem
from dobc_design.description.words import describe, facts
from dobc_design.errors import SpecError
from dobc_design.problem.canonical import (
    canonical_bytes,
    canonical_document,
    problem_from_canonical,
    problem_sha256,
)
from dobc_design.problem.changes import problem_text
from dobc_design.problem.load import read_problem_text
from dobc_design.problem.switching import KEYS, SIGNALS, Switching

MODES = ("Ga", "Gb", 'a."b"')
NETWORK = network_of({name: [[1, 2], [2, 3]] for name in MODES}, 3)
modes = st.sampled_from(MODES)
numbers = st.fractions(min_value=Fraction(1, 1000), max_value=1000, max_denominator=1000)


numbers_or_0 = numbers | st.just(Fraction(0))


@st.composite
def instants(draw) -> list[list[object]]:
    steps = draw(st.lists(numbers, max_size=4))
    times = [sum(steps[:k], Fraction(0)) for k in range(len(steps) + 1)]
    return [[time, draw(modes)] for time in times]


@st.composite
def generators(draw) -> list[list[Fraction]]:
    rates = []
    for k in range(len(MODES)):
        row = [draw(numbers_or_0) for _ in MODES]
        row[k] -= sum(row)
        rates.append(row)
    return rates


@st.composite
def promises(draw) -> list[dict[str, object]]:
    shortest = draw(numbers)
    guarantee = draw(st.sampled_from(["arbitrary", "dwell"]))
    longest = shortest + draw(numbers_or_0)
    any_stay = {"guarantee": guarantee, "dwell": shortest}
    bounded = {"guarantee": "dwell", "dwell": shortest, "longest": longest}
    return [any_stay, bounded]


@st.composite
def sections(draw) -> Switching:
    signal = draw(st.sampled_from(SIGNALS))
    dwell = {"dwell": draw(st.none() | numbers)}
    schedule = draw(instants())
    ways: list[dict[str, Any]] = []
    if signal == "random":
        ways = [dwell, *draw(promises())]
    elif signal == "markov":
        ways = [dwell, {"generator": draw(generators())}]
    elif signal == "schedule":
        ways = [dwell | {"schedule": schedule}]
    elif signal == "mobile":
        dwell["hysteresis"] = draw(st.none() | numbers_or_0)
        radius = {"radius": draw(numbers)}
        nearest = {"neighbours": draw(st.integers(1, 99))}
        ways = [dwell | radius, dwell | nearest]
    else:
        listed_modes = st.lists(modes, min_size=1, max_size=5)
        sequence = draw(st.none() | listed_modes)
        order = {"sequence": sequence, "guarantee": draw(st.sampled_from([None, "arbitrary"]))}
        rounds = {"schedule": schedule, "period": schedule[-1][0] + draw(numbers)}
        rounds["guarantee"] = draw(st.sampled_from([None, "sequence"]))
        ways = [order | dwell, order | {"period": draw(numbers)}, rounds]
    return Switching(signal=signal, **draw(st.sampled_from(ways)))


for_all = st.lists(numbers, min_size=1, max_size=1)
for_each = st.lists(numbers, min_size=3, max_size=3)
starts = st.none() | for_all | for_each


def switched(**given: Any) -> Problem:
    return Problem(network=NETWORK, coupling="y", **given)


@settings(max_examples=12)
@given(sections(), starts)
def test_every_section_is_read_back_equal_from_json_from_toml_and_from_a_pickle(
    section: Switching, x0
):
    problem = switched(switching=section, simulation={"x0": x0})
    data = canonical_bytes(problem)
    assert problem_from_canonical(data) == problem
    assert canonical_bytes(problem_from_canonical(data)) == data
    assert read_problem_text(problem_text(problem).encode(), folder=None) == problem
    assert pickle.loads(pickle.dumps(problem)) == problem
    assert "Switching in simulations: " in describe(problem)
    assert facts(problem)["switching"] in describe(problem)


def test_problems_without_the_later_keys_keep_the_bytes_they_had():
    """The two documents as the first version wrote them, and the hash of the whole."""
    random = Switching(signal="random", dwell=0.5)
    problem = switched(switching=random)
    document = canonical_document(problem)
    assert document["switching"] == {"signal": "random", "dwell": "1/2"}
    assert document["simulation"] == {"t_final": "20", "seed": 0, "xi0": None}
    longer = switched(switching=random, simulation={"x0": [1]})
    assert canonical_document(longer)["simulation"] == document["simulation"] | {"x0": [["1"]]}
    assert problem_sha256(longer) != problem_sha256(problem)


OF_SOME = ["sequence", "period", "generator", "schedule", "radius", "neighbours", "hysteresis"]


@pytest.mark.parametrize("key", OF_SOME)
def test_a_key_in_the_wrong_place_names_the_signals_it_belongs_to(key: str):
    for signal in SIGNALS:
        if key in KEYS[signal]:
            continue
        with pytest.raises(SpecError, match="has no meaning for signal") as caught:
            Switching(signal=signal, **{key: 1})
        keys = [error.key for error in caught.value.errors]
        assert f"switching.{key}" in keys
        for each in SIGNALS:
            if key in KEYS[each]:
                assert f'"{each}"' in str(caught.value)


def test_all_mistakes_of_a_section_are_told_at_once():
    with pytest.raises(SpecError) as caught:
        Switching(signal="mobile", radius=0, neighbours=0, hysteresis=-1, period=3)
    keys = [f"switching.{name}" for name in ("period", "radius", "neighbours", "hysteresis")]
    assert [error.key for error in caught.value.errors] == keys


@pytest.mark.parametrize(
    "later", [{"radius": None}, {"radius": "0"}, {"speed": "1"}, {"neighbours": 1.0}]
)
def test_a_canonical_section_with_other_keys_or_null_is_refused(later):
    """One problem has one text: a null where a key may be absent would be another."""
    section = Switching(signal="mobile", radius=1)
    document = canonical_document(switched(switching=section))
    document["switching"] |= later
    with pytest.raises(SpecError, match="switching"):
        problem_from_canonical(json.dumps(document).encode())


SECTIONS: list[Any] = []


def section_in_words(words: str, /, **section: Any) -> None:
    SECTIONS.append((section, words))


section_in_words("random, a mode drawn anew every 0.5 s", signal="random", dwell=0.5)
section_in_words(
    "periodic, Gb, Ga in turn, 2 s each", signal="periodic", dwell=2, sequence=["Gb", "Ga"]
)
section_in_words('periodic, Ga, Gb, a."b" in turn, a round in 3 s', signal="periodic", period=3)
section_in_words(
    "Ga from 0 s, Gb from 1 s, and so again every 3 s",
    signal="periodic",
    period=3,
    schedule=[[0, "Ga"], [1, "Gb"]],
)
section_in_words(
    "Ga from 0 s, Gb from 1/3 s", signal="schedule", schedule=[[0, "Ga"], ["1/3", "Gb"]]
)
section_in_words(
    'a Markov chain, whose stays last on average: Ga 0.5 s, Gb for ever, a."b" 1 s',
    signal="markov",
    generator=[[-2, 2, 0], [0, 0, 0], [0, 1, -1]],
)
section_in_words(
    "an agent hears its 2 nearest neighbours; the arcs of the modes", signal="mobile", neighbours=2
)
section_in_words(
    "everyone within 2 in the unit of x, with a hyst", signal="mobile", radius=2, hysteresis="1/4"
)


@pytest.mark.parametrize(("section", "words"), SECTIONS)
def test_check_says_the_signal_in_words(section, words: str):
    text = describe(switched(switching=Switching(**section)))
    assert words in text


def test_check_says_where_simulations_start():
    def words(x0) -> str:
        return describe(switched(simulation={"x0": x0}))

    assert "they start at x0, all agents at 2." in words([2])
    assert "they start at x0, every agent at its own." in words([1, 2, 3])


def test_a_list_of_dwells_is_the_schedule_of_a_round():
    sequence = ["Ga", "Gb", "Ga"]
    dwell = [1, "1/2", 2]
    listed = Switching(guarantee="sequence", sequence=sequence, dwell=dwell)
    rounds = [[0, "Ga"], [1, "Gb"], ["3/2", "Ga"]]
    given: Any = {"signal": "periodic", "schedule": rounds, "period": "7/2"}
    assert listed == Switching(guarantee="sequence", **given)


def test_times_whose_sum_cannot_be_written_are_named_as_dwell():
    """1e-300 + 1e300 has 601 digits; nobody has written a period."""
    said = r"switching\.dwell holds times from 1e-300 to 1e300 s, whose sum has more than 200"
    with pytest.raises(SpecError, match=said):
        Switching(guarantee="sequence", sequence=["Ga", "Gb"], dwell=["1e-300", "1e300"])
    shorter = Switching(guarantee="sequence", sequence=["Ga", "Gb"], dwell=["1e-90", "1e90"])
    assert shorter.period == 10**90 + Fraction(1, 10**90)


def test_a_guarantee_chooses_the_signal_unless_it_is_named():
    assert Switching(guarantee="arbitrary").signal == "random"
    assert Switching(guarantee="dwell", dwell=1).signal == "random"
    assert Switching(guarantee="sequence", dwell=1).signal == "periodic"
    assert Switching(guarantee="dwell", signal="markov", dwell=1).signal == "markov"
    bounded = Switching(guarantee="dwell", dwell=1, longest=2)
    document = canonical_document(switched(switching=bounded))
    written = {"signal": "random", "dwell": "1", "guarantee": "dwell", "longest": "2"}
    assert document["switching"] == written
