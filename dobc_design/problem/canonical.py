"""problem.json: the one text of a problem that a certificate is about, and its hash; a function of
the Problem alone.

Arcs are [listener, speaker, weight] with indices from 0; numbers are rationals as strings.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from fractions import Fraction
from typing import Any

import numpy as np

from dobc_design.coupling.coupling import Coupling
from dobc_design.errors import SpecError, reason_of, wrong
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.number import number_text
from dobc_design.exact.reading import named, shown
from dobc_design.problem.arrays import distinct_weights
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.foreign_json import PROBLEM, not_a
from dobc_design.problem.groups import Group, Observer, group_key, renamed
from dobc_design.problem.integrators import enclosed
from dobc_design.problem.network import Arcs, Network, directed, joined, labels_of, parse_weights
from dobc_design.problem.problem import Problem
from dobc_design.problem.settings import Switching

FORMAT = "dobc-problem"
#: Other problems keep their version, and their hash.
VERSION, VERSION_DYNAMICS, VERSION_OPTIONAL, VERSION_UNDISTURBED = 1, 2, 3, 4
_CURE = "Write it again with `dobc check FILE --canonical OUT`."
_KEYS = (
    "format",
    "version",
    "name",
    "notes",
    "labels",
    "dimension",
    "target",
    "modes",
    "coupling",
    "gains",
)
_TABLES = ("exosystem", "observer", "offsets", "region", "switching", "simulation")
_LATER_TABLES = ("uncertainty", "actuators", "dynamics", "leader")
_SWITCHING = ("signal", "dwell")
_LATER_SWITCHING = tuple(each.name for each in fields(Switching) if each.name not in _SWITCHING)


def canonical_bytes(problem: Problem) -> bytes:
    """The UTF-8 bytes of problem.json; of integrators that stand for agents with [dynamics] those
    of these."""
    document = canonical_document(problem.origin or problem)
    text = json.dumps(document, sort_keys=True, ensure_ascii=False, separators=(",", ":"))
    return text.encode("utf-8") + b"\n"


def problem_sha256(problem: Problem) -> str:
    """SHA-256 of ``canonical_bytes``, as hexadecimal text."""
    return hashlib.sha256(canonical_bytes(problem)).hexdigest()


def loop_sha256(problem: Problem, W: Matrix | None) -> str:
    """The fingerprint of a closed loop: of the problem and of the observer gain W (q, m) that it
    runs with."""
    rows = None if W is None else [[str(entry) for entry in row] for row in W]
    return hashlib.sha256(f"{problem_sha256(problem)} {json.dumps(rows)}".encode()).hexdigest()


def matrix_text(matrix: Matrix) -> list[list[str]]:
    """A rational matrix as rows of strings."""
    return [[number_text(entry) for entry in row] for row in matrix]


def canonical_document(problem: Problem) -> dict[str, Any]:
    """The document behind problem.json: JSON types only."""
    exceptions = sorted(problem.exceptions.items())
    version = VERSION if problem.dynamics is None else VERSION_DYNAMICS
    if problem.network.loose is not None:
        version = VERSION_OPTIONAL
    if problem.undisturbed:
        version = VERSION_UNDISTURBED
    return {
        "format": FORMAT,
        "version": version,
        "name": problem.name,
        "notes": list(problem.notes),
        "labels": list(problem.network.labels),
        "dimension": problem.m,
        "target": [number_text(x) for x in problem.target],
        "modes": [
            {
                "name": name,
                "arcs": each[: len(each) - k],
                **({"optional": each[len(each) - k :]} if k else {}),
            }
            for name, arcs in problem.network.modes.items()
            for k, each in [(arcs.optional, _arc_rows(arcs))]
        ],
        "coupling": {
            "h": _coupling(problem.coupling),
            "exceptions": [
                {"arc": [i, j], "h": _coupling(coupling)} for (i, j), coupling in exceptions
            ],
        },
        "gains": [[i, matrix_text(k)] for i, k in problem.pinning.gains.items()],
        "offsets": [[i, [number_text(x) for x in offset]] for i, offset in problem.offsets.items()],
        **converted(settings_of(problem), number_text),
    }


def _arc_rows(arcs: Arcs) -> list[list[Any]]:
    """[listener, speaker, weight] of every arc; arcs mostly share few weights, whose texts are made
    once."""
    place, different = distinct_weights(arcs.weights)
    texts = [number_text(weight) for weight in different]
    weights = map(texts.__getitem__, place.tolist())
    return list(
        map(list, zip(arcs.listeners.tolist(), arcs.speakers.tolist(), weights, strict=True))
    )


def settings_of(problem: Problem) -> dict[str, Any]:
    """Exosystem, observer, region, switching and simulation as tables; their numbers are exact,
    agents are indices. Keys that later versions added stand there only where they were given: other
    problems keep their hash."""
    index = problem.network.index
    exosystem: dict[str, Any] | None
    if problem.is_grouped:
        keys = [
            {
                "agents": [index[label] for label in group.agents],
                **_own(group.exosystem),
                **_own(group.observer),
            }
            for group in problem.groups
        ]
        exosystem = {
            "groups": [{key: x for key, x in each.items() if key != "rate"} for each in keys]
        }
        observer = Observer(rate=problem.groups[0].observer.rate)
    else:
        exosystem = None if problem.exosystem is None else _own(problem.exosystem)
        observer = problem.observer
    own = {name: getattr(problem, name) for name in _LATER_TABLES} | {"leader": enclosed(problem)}
    return {
        "exosystem": exosystem,
        "observer": _own(observer),
        "region": problem.region and _own(problem.region),
        "switching": problem.switching and _own(problem.switching, later=_LATER_SWITCHING),
        "simulation": _own(problem.simulation, later=("x0",)),
        **{
            name: _own(noun, later=("A", "f", "stays_in"))
            for name in _LATER_TABLES
            if (noun := own[name]) is not None
        },
    }


def _own(noun: Any, *, later: Sequence[str] = ()) -> dict[str, Any]:
    found = {each.name: getattr(noun, each.name) for each in fields(noun)}
    return {name: value for name, value in found.items() if value is not None or name not in later}


def converted(value: Any, number: Callable[[Fraction], Any]) -> Any:
    """Tables and lists with every Fraction in them replaced."""
    if isinstance(value, Fraction):
        return number(value)
    if isinstance(value, Mapping):
        return {key: converted(each, number) for key, each in value.items()}
    return (
        [converted(each, number) for each in value] if isinstance(value, (list, tuple)) else value
    )


def _coupling(coupling: Coupling) -> str | list[str]:
    return coupling.texts[0] if coupling.by_component else list(coupling.texts)


def problem_from_canonical(data: bytes, *, name: str = "problem.json") -> Problem:
    """Read problem.json back; ``name`` of the file is for messages.  Raises SpecError for anything
    that is not one."""
    document = _load(data, name)
    problem = _Reader(document).problem()
    if problem.m != document["dimension"] or type(document["dimension"]) is not int:
        raise _wrong(
            "dimension", f"the number of state components, {problem.m}", document["dimension"]
        )
    return problem


def _load(data: bytes, name: str) -> dict[str, Any]:
    try:
        document = json.loads(data.decode("utf-8"), object_pairs_hook=_no_duplicates)
    except SpecError:
        raise
    except (UnicodeDecodeError, ValueError, RecursionError) as error:
        raise wrong(named(name), f"is not valid JSON ({reason_of(error)}).", _CURE) from None
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise not_a(PROBLEM, document, name=name)
    version = document.get("version")
    known, modes = VERSION_DYNAMICS if "dynamics" in document else VERSION, document.get("modes")
    if isinstance(modes, list) and any(
        isinstance(mode, dict) and "optional" in mode for mode in modes
    ):
        known = VERSION_OPTIONAL
    if _leaves_agents_undisturbed(document):
        known = VERSION_UNDISTURBED
    if version != known or type(version) is not int:  # true and 1.0 equal 1
        what = (
            f"problem.json has version {shown(version)}; this program knows {VERSION} to "
            f"{VERSION_UNDISTURBED},"
        )
        what += f" and reads this one as {known}."
        raise SpecError(what, key="version", cure="Update dobc_design, or write the file again.")
    return document


def _leaves_agents_undisturbed(document: Mapping[str, Any]) -> bool:
    """Whether there are groups, and agents in none of them."""
    exosystem, labels = document.get("exosystem"), document.get("labels")
    groups = exosystem.get("groups") if isinstance(exosystem, dict) else None
    if not isinstance(groups, list) or not isinstance(labels, list):
        return False
    lists = [group.get("agents") for group in groups if isinstance(group, dict)]
    return sum(len(agents) for agents in lists if isinstance(agents, list)) < len(labels)


def _no_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    result = dict(pairs)
    if len(result) != len(pairs):
        raise wrong("problem.json", "holds a key twice.", _CURE)
    return result


class _Reader:
    """Reads the document strictly: every key, no other, and no value of another kind."""

    def __init__(self, document: Mapping[str, Any]) -> None:
        self.document = _object(document, (*_KEYS, *_TABLES), _LATER_TABLES, key="problem.json")
        self.labels = [
            _text(label, key="labels") for label in _list(document["labels"], key="labels")
        ]

    def problem(self) -> Problem:
        document = self.document
        groups = self.groups(document["exosystem"])
        exosystem = (
            None
            if groups
            else _object(document["exosystem"], ("A", "C"), key="exosystem", optional=True)
        )
        observer = _object(document["observer"], ("W", "P", "rate"), key="observer")
        switching = _object(
            document["switching"], _SWITCHING, _LATER_SWITCHING, key="switching", optional=True
        )
        wanted = ("initial_states", "initial_disturbance")
        region = _object(document["region"], wanted, key="region", optional=True)
        simulation = _object(
            document["simulation"], ("t_final", "seed", "xi0"), ("x0",), key="simulation"
        )
        coupling = _object(document["coupling"], ("h", "exceptions"), key="coupling")
        return Problem(
            name=_text(document["name"], key="name"),
            notes=_list(document["notes"], key="notes"),
            network=Network(labels=labels_of(self.labels), modes=self.modes()),
            coupling=coupling["h"],
            exceptions=self.exceptions(coupling["exceptions"]),
            target=_list(document["target"], key="target"),
            gains=self.by_label("gains"),
            exosystem=Exosystem(**exosystem) if exosystem else None,
            observer=Observer(**observer)
            if any(value is not None for value in observer.values())
            else None,
            groups=groups,
            offsets=self.by_label("offsets"),
            region=region or None,
            switching=Switching(**switching) if switching else None,
            simulation=simulation,
            uncertainty=document.get("uncertainty"),
            actuators=document.get("actuators"),
            dynamics=_object(document["dynamics"], ("B",), ("A", "f"), key="dynamics")
            if "dynamics" in document
            else None,
            leader=_object(document["leader"], ("initial",), ("stays_in",), key="leader")
            if "leader" in document
            else None,
        )

    def groups(self, exosystem: Any) -> list[Group]:
        if not isinstance(exosystem, dict) or "groups" not in exosystem:
            return []
        result = []
        _object(exosystem, ("groups",), key="exosystem")
        for position, item in enumerate(_list(exosystem["groups"], key="exosystem.groups")):
            key = group_key(position)
            group = _object(item, ("agents", "A", "C", "W", "P"), key=key)
            places = [
                self.index(place, key=f"{key}.agents")
                for place in _list(group["agents"], key=f"{key}.agents")
            ]
            agents = [self.labels[i] for i in places]
            try:
                system, observer = (
                    Exosystem(A=group["A"], C=group["C"]),
                    Observer(W=group["W"], P=group["P"]),
                )
                result.append(Group(agents=agents, exosystem=system, observer=observer))
            except SpecError as error:
                raise renamed(error, key) from None
        everybody = len(result) == 1 and len(result[0].agents) == len(self.labels)
        if not result or everybody:
            raise _wrong(
                "exosystem.groups",
                "a list of groups, none of which has all agents",
                exosystem["groups"],
            )
        return result

    def modes(self) -> dict[str, Arcs]:
        result: dict[str, Arcs] = {}
        for position, item in enumerate(_list(self.document["modes"], key="modes")):
            mode = _object(item, ("name", "arcs"), ("optional",), key=f"modes[{position}]")
            name = _text(mode["name"], key=f"modes[{position}].name")
            if name in result:
                raise _wrong(f"modes[{position}].name", "different from the others", name)
            parts = (part for part in ("arcs", "optional") if part in mode)
            keys = {part: f"modes[{position}].{part}" for part in parts}
            first, *rest = (
                _arcs(_list(mode[part], key=key), key=key) for part, key in keys.items()
            )
            if rest and not len(rest[0]):
                raise _wrong(keys["optional"], "arcs, at least one", mode["optional"])
            result[name] = joined(first, *rest) if rest else first
        return result

    def exceptions(self, items: Any) -> dict[tuple[int, int], Any]:
        result: dict[tuple[int, int], Any] = {}
        for position, item in enumerate(_list(items, key="coupling.exceptions")):
            key = f"coupling.exceptions[{position}]"
            table = _object(item, ("arc", "h"), key=key)
            ends = [
                self.index(end, key=f"{key}.arc")
                for end in _list(table["arc"], key=f"{key}.arc", length=2)
            ]
            if (ends[0], ends[1]) in result:
                raise _wrong(f"{key}.arc", "an arc without an exception so far", ends)
            result[ends[0], ends[1]] = table["h"]
        return result

    def by_label(self, name: str) -> dict[str, Any]:
        """A list of [index, value] as a mapping of label to value."""
        result: dict[str, Any] = {}
        for position, pair in enumerate(_list(self.document[name], key=name)):
            place, value = _list(pair, key=f"{name}[{position}]", length=2)
            label = self.labels[self.index(place, key=f"{name}[{position}][0]")]
            if label in result:
                raise _wrong(f"{name}[{position}][0]", "an agent that is not listed already", place)
            result[label] = value
        return result

    def index(self, value: Any, *, key: str) -> int:
        if type(value) is not int or not 0 <= value < len(self.labels):
            raise _wrong(key, "the index of an agent", value)
        return value


def _object(
    value: Any, keys: Sequence[str], later: Sequence[str] = (), *, key: str, optional: bool = False
) -> dict[str, Any]:
    """An object with all of ``keys``, and some of ``later``, which are not null where they stand;
    {} for no object."""
    if optional and value is None:
        return {}
    known = isinstance(value, dict) and set(keys) <= set(value) <= {*keys, *later}
    if not known or any(value[name] is None for name in later if name in value):
        raise _wrong(key, f"an object with the keys {', '.join(keys)}", value)
    found: dict[str, Any] = value
    return found


def _list(value: Any, *, key: str, length: int | None = None) -> list[Any]:
    if not isinstance(value, list) or (length is not None and len(value) != length):
        raise _wrong(key, "a list" if length is None else f"a list of {length}", value)
    return value


def _text(value: Any, *, key: str) -> str:
    if isinstance(value, str):
        return value
    raise _wrong(key, "text", value)


def _wrong(key: str, wanted: str, value: object) -> SpecError:
    return SpecError(
        f"problem.json: {key} must be {wanted}; got {shown(value)}.", key=key, cure=_CURE
    )


def _arcs(rows: list[Any], *, key: str) -> Arcs:
    for position, row in enumerate(rows):
        if (
            not isinstance(row, list)
            or len(row) != 3
            or type(row[0]) is not int
            or type(row[1]) is not int
        ):
            raise _wrong(f"{key}[{position}]", "[listener, speaker, weight] with indices", row)
        _text(row[2], key=f"{key}[{position}][2]")
    weights = parse_weights([row[2] for row in rows], key=key)
    try:
        listeners, speakers = (
            np.array([row[end] for row in rows], dtype=np.int64) for end in (0, 1)
        )
    except OverflowError:
        raise _wrong(key, "arcs between the agents", "an index that is too large") from None
    return directed(listeners, speakers, weights, arrow="listens_to")
