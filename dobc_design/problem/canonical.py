"""problem.json: the one text of a problem that a certificate is about, and its hash; a function of
the Problem alone.

Arcs are [listener, speaker, weight] with indices from 0; numbers are rationals as strings.  Keys
that came later (``LATER``) stand there only where they were given: other problems keep their hash.
"""

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import fields
from fractions import Fraction
from typing import Any

import numpy as np

from dobc_design._checks import LATER
from dobc_design.coupling.coupling import Coupling
from dobc_design.errors import SpecError, reason_of, refused, wrong
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.number import number_text
from dobc_design.exact.reading import Document, Names, Table, Texts, json_object, named, shown

from .dynamics import Dynamics
from .exosystems import Exosystem
from .foreign_json import PROBLEM, not_a
from .groups import Group, Observer, group_key, renamed
from .leader import Leader, enclosed
from .network import (
    Arc,
    Arcs,
    Index,
    Network,
    directed,
    distinct_weights,
    joined,
    labels_of,
    parse_weights,
)
from .problem import Problem
from .readings import TIMES, Processor, Readings
from .region import GOALS, Region
from .simulation import Simulation
from .switching import Switching
from .uncertainty import Actuators, Uncertainty

FORMAT = "dobc-problem"
#: Other problems keep their version, and their hash.
VERSION, VERSION_DYNAMICS, VERSION_OPTIONAL, VERSION_OPEN = 1, 2, 3, 4
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
#: Tables whose keys are the fields of a noun; those after the first two came later.
_NOUNS = (Region, Simulation, Uncertainty, Actuators, Dynamics, Leader, Readings, Processor)
_STATED: Document = {noun.__name__.lower(): noun for noun in _NOUNS}
_LATER_TABLES = tuple(_STATED)[2:]
_NEW = ("goal", "fixed", "negative", "readings", "processor", "time")
_LATER = (*_LATER_TABLES, *_NEW, "units")
_ALWAYS = ("observer", "simulation")  # tables that are never null


def canonical_bytes(problem: Problem) -> bytes:
    """The UTF-8 bytes of problem.json."""
    document = canonical_document(problem)
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


def canonical_document(problem: Problem) -> Document:
    """The document behind problem.json: JSON types only."""
    # Sorted, so that equal problems have one text whatever their files looked like.
    exceptions = []
    for arc, coupling in sorted(problem.exceptions.items()):
        exceptions.append({"arc": list(arc), "h": coupling_text(coupling)})
    offsets = list(problem.offsets.items())
    numbers = {"target": problem.target, "offsets": offsets, **settings_of(problem)}
    if problem.fixed:
        numbers["fixed"] = list(problem.fixed.items())
    document = {
        "format": FORMAT,
        **texts_of(problem),
        "labels": list(problem.network.labels),
        "dimension": problem.m,
        "modes": [_mode(problem, name) for name in problem.network.modes],
        "coupling": {"h": coupling_text(problem.coupling), "exceptions": exceptions},
        "gains": _gains(problem.pinning.gains),
        **converted(numbers, number_text),
    }
    if problem.network.negative:
        document["negative"] = problem.network.negative
    return {**document, "version": _version_of(document)}


def texts_of(problem: Problem) -> Document:
    """What stands at the top of a problem file and is text."""
    found = {"name": problem.name, "notes": list(problem.notes)}
    # A key that came later: problems without it keep their hash.
    if problem.units:
        found["units"] = list(problem.units)
    if problem.goal != GOALS[0]:
        found["goal"] = problem.goal
    if problem.steps:
        found["time"] = TIMES[1]
    return found


def _gains(gains: Mapping[int, Matrix]) -> list[list[Any]]:
    """[agent, gain] of every pin."""
    return [[i, matrix_text(k)] for i, k in gains.items()]


def _mode(problem: Problem, name: str) -> Document:
    """A mode; its optional arcs, which are the last, have a list of their own, and so have pins of
    this mode alone."""
    arcs = problem.network.modes[name]
    rows = _arc_rows(arcs)
    sure = len(rows) - arcs.optional
    mode = {"name": name, "arcs": rows[:sure]}
    if arcs.optional:
        mode["optional"] = rows[sure:]
    if name in problem.pinning.modes:
        mode["gains"] = _gains(problem.pinning.modes[name])
    return mode


def _arc_rows(arcs: Arcs) -> list[list[Any]]:
    """[listener, speaker, weight] of every arc; arcs mostly share few weights, whose texts are made
    once."""
    # To write a Fraction takes long; a million arcs mostly have a handful of weights.
    place, different = distinct_weights(arcs.weights)
    texts = [number_text(weight) for weight in different]
    weights = map(texts.__getitem__, place.tolist())
    rows = zip(arcs.listeners.tolist(), arcs.speakers.tolist(), weights, strict=True)
    return [list(row) for row in rows]


def settings_of(problem: Problem) -> Document:
    """Exosystem, observer, region, switching and simulation as tables, and the later tables where
    there are any; their numbers are exact, agents are indices."""
    found: Document = {}
    if problem.is_grouped:
        index = problem.network.index
        found["exosystem"] = {"groups": [_group_table(each, index) for each in problem.groups]}
        found["observer"] = _table_of(Observer(rate=problem.groups[0].observer.rate))
    else:
        found["exosystem"] = _table_of(problem.exosystem)
        found["observer"] = _table_of(problem.observer)
    for name in ("region", "switching", "simulation"):
        found[name] = _table_of(getattr(problem, name))
    for name in _LATER_TABLES:
        noun = getattr(problem, name)
        if name == "leader":
            noun = enclosed(problem.leader, problem.dynamics)
        if noun is not None:
            found[name] = _table_of(noun)
    return found


def _group_table(group: Group, index: Index) -> Document:
    """A group as a table: its agents by index, A, C, W and P."""
    table = {"agents": [index[label] for label in group.agents]}
    for noun in (group.exosystem, group.observer):
        table |= _table_of(noun) or {}
    del table["rate"]  # that of all groups, which stands in observer
    return table


def _table_of(noun: Any) -> Document | None:
    """A noun as a table; of its later keys those that were given."""
    if noun is None:
        return None
    every = {each.name: getattr(noun, each.name) for each in fields(noun)}
    # Keys that came later are left out where they say nothing: older hashes stay valid.
    later = _later_keys(type(noun))
    return {name: x for name, x in every.items() if x is not None or name not in later}


def _later_keys(noun: Any) -> Texts:
    """The fields that a noun has in problem.json only where they were given."""
    return tuple(each.name for each in fields(noun) if LATER.keys() <= each.metadata.keys())


def converted(value: Any, number: Callable[[Fraction], Any]) -> Any:
    """Tables and lists with every Fraction in them replaced."""
    if isinstance(value, Fraction):
        return number(value)
    if isinstance(value, Mapping):
        return {key: converted(each, number) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [converted(each, number) for each in value]
    return value


def coupling_text(coupling: Coupling) -> str | list[str]:
    """h of one component, or a list of them."""
    return coupling.texts[0] if coupling.by_component else list(coupling.texts)


def problem_from_canonical(data: bytes, *, name: str = "problem.json") -> Problem:
    """Read problem.json back; ``name`` of the file is for messages.  Raises SpecError for anything
    that is not one."""
    document = _load(data, name)
    problem = _Reader(document).problem()
    dimension = document["dimension"]
    if problem.m != dimension or type(dimension) is not int:
        wanted = f"the number of state components, {problem.m}"
        raise _wrong("dimension", wanted, dimension)
    return problem


def _load(data: bytes, name: str) -> Document:
    """The JSON document, of a version that is known.  Raises: SpecError."""
    try:
        document = json.loads(data.decode("utf-8"), object_pairs_hook=json_object)
    except (UnicodeDecodeError, ValueError, RecursionError) as error:
        raise wrong(named(name), f"is not valid JSON ({reason_of(error)}).", _CURE) from None
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise not_a(PROBLEM, document, name=name)
    # A version that does not fit would let one problem have two texts, and two hashes.
    version, known = document.get("version"), _version_of(document)
    if version != known or type(version) is not int:  # true and 1.0 equal 1
        raise refused(
            "version",
            f"problem.json has version {shown(version)}; this program knows {VERSION} to "
            f"{VERSION_OPEN}, and reads this one as {known}.",
            "Update dobc_design, or write the file again.",
        )
    return document


def _version_of(document: Table) -> int:
    """The first version that knows all that the document has."""
    new = any(key in document for key in _NEW)
    if new or _in_a_mode(document, "gains") or _leaves_agents_undisturbed(document):
        return VERSION_OPEN
    actuators = document.get("actuators")
    if isinstance(actuators, dict) and not actuators.keys().isdisjoint(("saturates", "delay")):
        return VERSION_OPEN
    for name, key in (("uncertainty", "bands"), ("dynamics", "H")):
        table = document.get(name)
        if isinstance(table, dict) and key in table:
            return VERSION_OPEN
    if _in_a_mode(document, "optional"):
        return VERSION_OPTIONAL
    return VERSION_DYNAMICS if "dynamics" in document else VERSION


def _in_a_mode(document: Table, key: str) -> bool:
    """Whether a mode of the document has this key."""
    modes = document.get("modes")
    return isinstance(modes, list) and any(isinstance(x, dict) and key in x for x in modes)


def _leaves_agents_undisturbed(document: Table) -> bool:
    """Whether there are groups, and agents in none of them."""
    exosystem, labels = document.get("exosystem"), document.get("labels")
    groups = exosystem.get("groups") if isinstance(exosystem, dict) else None
    if not isinstance(groups, list) or not isinstance(labels, list):
        return False
    lists = [group.get("agents") for group in groups if isinstance(group, dict)]
    return sum(len(agents) for agents in lists if isinstance(agents, list)) < len(labels)


class _Reader:
    """Reads the document strictly: every key, no other, and no value of another kind."""

    def __init__(self, document: Table) -> None:
        self.document = _object(document, "problem.json", *_KEYS, *_TABLES, later=_LATER)
        labels = _list(document["labels"], "labels")
        self.labels = [_text(label, "labels") for label in labels]
        self.nodes = len(self.labels) + len(_list(self.document.get("fixed", []), "fixed"))

    def problem(self) -> Problem:
        document = self.document
        groups = self.groups(document["exosystem"])
        exosystem = None if groups else self.table(Exosystem, "exosystem")
        observer = self.table(Observer, "observer") or {}
        switching = self.table(Switching, "switching")
        coupling = _object(document["coupling"], "coupling", "h", "exceptions")
        fixed = self.fixed()
        estimates = any(value is not None for value in observer.values())
        for key in ("notes", "target", "units"):
            _list(document.get(key, []), key)
        own: Document = {key: self.table(noun, key) for key, noun in _STATED.items()}
        own |= {key: document.get(key) for key in ("notes", "target", "units", "time")}
        return Problem(
            **own,
            name=_text(document["name"], "name"),
            goal=self.goal(),
            network=Network(
                labels=labels_of(self.labels),
                modes=self.modes(),
                fixed=tuple(fixed),
                negative=self.document.get("negative"),
            ),
            fixed=fixed,
            coupling=coupling["h"],
            exceptions=self.exceptions(coupling["exceptions"]),
            gains=self.by_label(self.document["gains"], "gains"),
            mode_gains=self.mode_gains(),
            exosystem=Exosystem(**exosystem) if exosystem else None,
            observer=Observer(**observer) if estimates else None,
            groups=groups,
            offsets=self.by_label(self.document["offsets"], "offsets"),
            switching=Switching(**switching) if switching else None,
        )

    def table(self, noun: Any, key: str) -> Document | None:
        """A table with the keys of this noun; None where there is none, and need not be."""
        value = self.document.get(key)
        if value is None and key not in _ALWAYS:
            return None
        later = _later_keys(noun)
        keys = [each.name for each in fields(noun) if each.name not in later]
        return _object(value, key, *keys, later=later)

    def groups(self, exosystem: Any) -> list[Group]:
        if not isinstance(exosystem, dict) or "groups" not in exosystem:
            return []
        result = []
        _object(exosystem, "exosystem", "groups")
        for position, item in enumerate(_list(exosystem["groups"], "exosystem.groups")):
            key = group_key(position)
            group = _object(item, key, "agents", "A", "C", "W", "P")
            places = _list(group["agents"], f"{key}.agents")
            agents = [self.labels[self.index(place, f"{key}.agents")] for place in places]
            try:
                system = Exosystem(A=group["A"], C=group["C"])
                observer = Observer(W=group["W"], P=group["P"])
                result.append(Group(agents=agents, exosystem=system, observer=observer))
            except SpecError as error:
                raise renamed(error, key) from None
        # One problem has one text: a group of all agents is written without groups.
        everybody = len(result) == 1 and len(result[0].agents) == len(self.labels)
        if not result or everybody:
            wanted = "a list of groups, none of which has all agents"
            raise _wrong("exosystem.groups", wanted, exosystem["groups"])
        return result

    def modes(self) -> dict[str, Arcs]:
        result = {}
        for position, item in enumerate(_list(self.document["modes"], "modes")):
            key = f"modes[{position}]"
            mode = _object(item, key, "name", "arcs", later=("optional", "gains"))
            name = _text(mode["name"], f"{key}.name")
            if name in result:
                raise _wrong(f"{key}.name", "different from the others", name)
            arcs = _arcs(mode["arcs"], f"{key}.arcs")
            if "optional" in mode:
                optional = _arcs(mode["optional"], f"{key}.optional")
                if not len(optional):
                    raise _wrong(f"{key}.optional", "arcs, at least one", mode["optional"])
                arcs = joined(arcs, optional)
            result[name] = arcs
        return result

    def exceptions(self, items: Any) -> dict[Arc, Any]:
        result = {}
        for position, item in enumerate(_list(items, "coupling.exceptions")):
            key = f"coupling.exceptions[{position}]"
            table = _object(item, key, "arc", "h")
            ends = _list(table["arc"], f"{key}.arc", length=2)
            listener = self.index(ends[0], f"{key}.arc")
            speaker = self.index(ends[1], f"{key}.arc", count=self.nodes)
            if (listener, speaker) in result:
                raise _wrong(f"{key}.arc", "an arc without an exception so far", ends)
            result[listener, speaker] = table["h"]
        return result

    def goal(self) -> str | None:
        """Another goal than the target, where there is one."""
        goal = self.document.get("goal")
        if goal == GOALS[0]:
            raise _wrong("goal", "left out for a target", goal)
        return None if goal is None else _text(goal, "goal")

    def fixed(self) -> Document:
        """Where fixed nodes may be, by label."""
        found: Document = {}
        rows = _list(self.document.get("fixed", []), "fixed")
        for position, row in enumerate(rows):
            label, place = _list(row, f"fixed[{position}]", length=2)
            if label in found:
                raise _wrong(f"fixed[{position}]", "a node that is not listed already", label)
            found[_text(label, f"fixed[{position}]")] = {"between": place}
        if not rows and "fixed" in self.document:
            raise _wrong("fixed", "nodes, at least one", rows)
        return found

    def mode_gains(self) -> Document:
        """The pins of single modes, by mode; after ``modes``, which reads the modes themselves."""
        found: Document = {}
        for position, mode in enumerate(self.document["modes"]):
            key = f"modes[{position}].gains"
            if "gains" in mode:
                found[mode["name"]] = self.by_label(mode["gains"], key)
                if not mode["gains"]:
                    raise _wrong(key, "gains, at least one", mode["gains"])
        return found

    def by_label(self, rows: Any, name: str) -> Document:
        """A list of [index, value] as a mapping of label to value."""
        result = {}
        for position, pair in enumerate(_list(rows, name)):
            key = f"{name}[{position}]"
            place, value = _list(pair, key, length=2)
            label = self.labels[self.index(place, f"{key}[0]")]
            if label in result:
                raise _wrong(f"{key}[0]", "an agent that is not listed already", place)
            result[label] = value
        return result

    def index(self, value: Any, key: str, count: int = 0) -> int:
        if type(value) is not int or not 0 <= value < (count or len(self.labels)):
            raise _wrong(key, "the index of an agent", value)
        return value


def _object(value: Any, key: str, *keys: str, later: Names = ()) -> Document:
    """An object with all of ``keys``, and some of ``later``, which are not null where they
    stand."""
    # Neither more nor less: a key that is not read could change what a certificate is about.
    known = isinstance(value, dict) and set(keys) <= set(value) <= {*keys, *later}
    if not known or any(value[name] is None for name in later if name in value):
        raise _wrong(key, f"an object with the keys {', '.join(keys)}", value)
    found: Document = value
    return found


def _list(value: Any, key: str, length: int | None = None) -> list[Any]:
    wanted = "a list" if length is None else f"a list of {length}"
    if not isinstance(value, list) or (length is not None and len(value) != length):
        raise _wrong(key, wanted, value)
    return value


def _text(value: Any, key: str) -> str:
    if isinstance(value, str):
        return value
    raise _wrong(key, "text", value)


def _wrong(key: str, wanted: str, value: object) -> SpecError:
    return refused(key, f"problem.json: {key} must be {wanted}; got {shown(value)}.", _CURE)


def _arcs(value: Any, key: str) -> Arcs:
    """Rows [listener, speaker, weight] as arcs.  Raises: SpecError."""
    rows = _list(value, key)
    # One row after the other, so that a message names the first wrong one.
    for position, row in enumerate(rows):
        if not isinstance(row, list) or len(row) != 3 or not type(row[0]) is type(row[1]) is int:
            raise _wrong(f"{key}[{position}]", "[listener, speaker, weight] with indices", row)
        _text(row[2], f"{key}[{position}][2]")
    weights = parse_weights([row[2] for row in rows], key)
    try:
        listeners = np.array([row[0] for row in rows], dtype=np.int64)
        speakers = np.array([row[1] for row in rows], dtype=np.int64)
    except OverflowError:
        raise _wrong(key, "arcs between the agents", "an index that is too large") from None
    return directed(listeners, speakers, weights, arrow="listens_to")
