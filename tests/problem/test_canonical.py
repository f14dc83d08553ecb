"""problem.json: a function of the problem alone, read back exactly, and safe to read from
anybody."""

import json
from collections.abc import Iterator
from fractions import Fraction
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from networks import network_of
from random_problems import random_problem

from dobc_design import Exosystem, Network, Observer, Problem, Switching
from dobc_design.errors import SpecError
from dobc_design.problem.canonical import canonical_bytes, problem_from_canonical, problem_sha256


def network(weight: float) -> Network:
    arcs = {"A": [("a", "b"), ("b", "c", weight)], "B": [("c", "a")]}
    return network_of(arcs, ["a", "b", "c"])


#: One problem, and for each of its fields another value.
PARTS: dict[str, Any] = {}
OTHERS: dict[str, Any] = {}


def field(name: str, own: Any, other: Any) -> None:
    PARTS[name] = own
    OTHERS[name] = other


SINE = [[0, 2], [-2, 0]]
W = [["16/5"], ["12/5"]]
P = [["1/2", "-1/4"], ["-1/4", "1/3"]]
BOX = {"initial_states": [0, 5]}
RUN = {"t_final": 20, "xi0": [1, 0]}
field("name", "rich", "other")
field("network", network(2.5), network(2.25))
field("coupling", "exp(y) - 1 + y", "exp(y) - 1 + 2*y")
field("exceptions", {(0, 1): "2*y"}, {(0, 1): "3*y"})
field("target", "1/3", "2/3")
field("gains", {"a": 5, "c": "9/16"}, {"a": 5, "c": "9/15"})
field("exosystem", Exosystem(A=SINE, C=[[1, 0]]), Exosystem(A=SINE, C=[[1, 1]]))
field("observer", Observer(W=W, P=P, rate=1), Observer(W=W, rate=1))
field("offsets", {"b": 1.5}, {"c": 1.5})
field("region", BOX | {"initial_disturbance": 0.5}, BOX | {"initial_disturbance": 0.25})
field("switching", Switching(signal="random", dwell=0.5), Switching(signal="random"))
field("simulation", RUN | {"seed": 7}, RUN | {"seed": 8})
field("notes", ["A stand-in."], [])


def hash_with(**changes: Any) -> str:
    return problem_sha256(Problem(**PARTS | changes))


def document() -> dict:
    return json.loads(canonical_bytes(Problem(**PARTS)))


def read(changed: object) -> Problem:
    return problem_from_canonical(json.dumps(changed).encode("utf-8"))


@settings(max_examples=20)
@given(st.integers(0, 2**32))
def test_any_problem_is_read_back_equal_and_gives_the_same_bytes(seed):
    problem = random_problem(seed)
    data = canonical_bytes(problem)
    again = problem_from_canonical(data)
    assert again == problem
    assert hash(again) == hash(problem)
    assert canonical_bytes(again) == data


def test_the_bytes_are_utf_8_json_with_sorted_keys_and_no_white_space():
    data = canonical_bytes(Problem(**PARTS | {"notes": ["Zürich 東京"]}))
    assert data.endswith(b"\n")
    assert "Zürich 東京".encode() in data
    parsed = json.loads(data)
    dense = json.dumps(parsed, sort_keys=True, ensure_ascii=False, separators=(",", ":"))
    assert data == dense.encode() + b"\n"


def test_the_arrow_and_the_way_a_number_is_typed_leave_no_trace():
    """Arcs are stored as listens_to index triples."""
    arcs = {"G": [(2, 1)]}
    sends = Network.from_arcs(arcs, arrow="sends_to", agents=2)
    listens = network_of({"G": [(1, 2)]}, 2)
    text = canonical_bytes(Problem(network=sends, coupling="y"))
    assert canonical_bytes(Problem(network=listens, coupling="y")) == text
    modes = json.loads(text)["modes"]
    expected = {"name": "G", "arcs": [[0, 1, "1"]]}
    assert modes == [expected]
    typed = hash_with(target=3.2)
    for value in ("16/5", "3.20", Fraction(16, 5)):
        assert hash_with(target=value) == typed


@pytest.mark.parametrize("name", sorted(PARTS))
def test_the_hash_changes_with_every_field(name):
    assert hash_with() != hash_with(**{name: OTHERS[name]})


def test_the_hash_changes_with_the_order_of_modes_and_with_labels():
    own = PARTS["network"]
    modes_of_own = own.modes.items()
    reversed_modes = dict(reversed(modes_of_own))
    turned = Network(labels=own.labels, modes=reversed_modes)
    renamed = Network(labels=("c", "b", "a"), modes=own.modes)
    hashes = {hash_with(), hash_with(network=turned), hash_with(network=renamed)}
    assert len(hashes) == 3


NO_PROBLEMS: list[Any] = []


def no_problem(message: str, data: bytes) -> None:
    NO_PROBLEMS.append((data, message))


no_problem("not valid JSON", b"\xff\xfe{}")
no_problem("not valid JSON", b"[" * 100_000)
no_problem("not valid JSON", b'{"a":' * 100_000)
no_problem("not valid JSON", b'{"format":' + b"9" * 5000 + b"}")
no_problem("a field stands there twice", b'{"format":"dobc-problem","format":"dobc-problem"}')
no_problem("is not a problem but a certificate", b'{"format":"dobc-certificate"}')
no_problem("has version 2; this program knows 1", b'{"format":"dobc-problem","version":2}')
no_problem("has version True", b'{"format":"dobc-problem","version":true}')
no_problem(
    "an object with the keys format, version, name", b'{"format":"dobc-problem","version":1}'
)


@pytest.mark.parametrize(("data", "message"), NO_PROBLEMS)
def test_what_is_no_problem_json_is_refused(data, message):
    with pytest.raises(SpecError, match=message):
        problem_from_canonical(data)


WRONG: list[Any] = []


def wrong(message: str, path: tuple, value: Any) -> None:
    WRONG.append((path, value, message))


wrong("name must be text", ("name",), 5)
wrong("notes must be a list", ("notes",), "text")
wrong(r"notes\[0\] must be text", ("notes",), ["\ud800"])
wrong("labels must be text", ("labels",), ["a", "b", 3])
wrong("dimension must be the number of state components, 1; got 2", ("dimension",), 2)
wrong("1 number", ("target",), [])
wrong(r"modes\[0\]\.name must be text", ("modes", 0, "name"), 5)
wrong("different from the others; got 'A'", ("modes", 1, "name"), "A")
wrong(r"must be \[listener, speaker, weight\]", ("modes", 0, "arcs", 0), [0, 1])
wrong("too large", ("modes", 0, "arcs", 0), [0, 10**30, "1"])
wrong("leaves the graph", ("modes", 0, "arcs", 0), [0, -1, "1"])
wrong("must be text", ("modes", 0, "arcs", 0, 2), 1)
wrong("must be an expression", ("coupling", "h"), None)
wrong("a list of 2", ("coupling", "exceptions", 0, "arc"), [0])
wrong("must be the index of an agent; got -1", ("coupling", "exceptions", 0, "arc"), [-1, 1])
wrong("must be an expression", ("coupling", "exceptions", 0, "h"), {"y": 1})
wrong("not listed already", ("gains",), [[0, [["1"]]], [0, [["2"]]]])
wrong("exosystem must be an object with the keys A, C", ("exosystem",), {"A": [["1"]]})
wrong("simulation must be an object", ("simulation",), None)


@pytest.mark.parametrize(("path", "value", "message"), WRONG)
def test_a_wrong_value_is_refused_by_its_key(path, value, message):
    changed = document()
    place = changed
    for step in path[:-1]:
        place = place[step]
    place[path[-1]] = value
    with pytest.raises(SpecError, match=message):
        read(changed)


def tables(value: object) -> Iterator[dict]:
    """Every object of a JSON document, the outermost first."""
    if isinstance(value, dict):
        yield value
        value = list(value.values())
    if isinstance(value, list):
        for child in value:
            yield from tables(child)


def test_no_key_may_be_missing_and_none_added_anywhere():
    for number, table in enumerate(tables(document())):
        for key in (*table, None):
            changed = document()
            place = list(tables(changed))[number]
            if key is None:
                place["more"] = None
            else:
                del place[key]
            with pytest.raises(SpecError):
                read(changed)
