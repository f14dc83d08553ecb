"""A problem with some keys of its file set anew or removed: what a cure proposes, before anyone
writes it.

Key paths are those of the problem file ("pinning.gains", "observer.W"); the value None removes the
key. "exosystem.groups.W" is the gains of all groups of agents at once, by the name of the group;
what P they have goes. ``toml_writing`` makes the same changes to the text of a file.
"""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from types import MappingProxyType
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError

from dobc_design.errors import SpecError, refused
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.number import typed_number
from dobc_design.exact.reading import Document, Names, Table, is_scalar_matrix, shown

from .canonical import (
    canonical_bytes,
    converted,
    coupling_text,
    settings_of,
    texts_of,
)
from .fixed import resting
from .groups import Groups, Observer, gains_of
from .load import parse_toml, read_problem_text
from .network import Arcs, Network
from .problem import Problem
from .readings import TIMES
from .region import Pairs
from .uncertainty import BOUNDS, RELATIVE

INLINE = 10  # labels up to which a table of gains stands in one line


def typed_matrix(matrix: Sequence[Sequence[Fraction]]) -> list[list[int | float | str]]:
    """A rational matrix as rows that somebody would type."""
    return [[typed_number(x) for x in row] for row in matrix]


def gain_table(gains: Mapping[int, Matrix], labels: Names) -> Document:
    """Gains by agent index as they stand in a file: label -> number, or rows."""
    table = {}
    for i, gain in gains.items():
        scalar = is_scalar_matrix(gain)
        table[labels[i]] = typed_number(gain[0][0]) if scalar else typed_matrix(gain)
    return table


def value_text(value: Any) -> str:
    """A value as it stands in a file, on one line."""
    if isinstance(value, Mapping):
        rows = [f"{_key(str(key))} = {value_text(each)}" for key, each in value.items()]
        return f"{{ {', '.join(rows)} }}"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(value_text, value))}]"
    # A number or a text means the same in JSON and in TOML (JSON escapes are TOML escapes).
    return json.dumps(value, ensure_ascii=False)


def change_lines(changes: Table) -> list[str]:
    """Changes as lines of a problem file, for people: long tables are cut, what has to go stands in
    a comment."""
    kept = {path: value for path, value in changes.items() if value is not None}
    lines = [f"{path} = {value_text(value)}" for path, value in kept.items() if "." not in path]
    for table in dict.fromkeys(path.partition(".")[0] for path in kept if "." in path):
        lines.append(f"[{table}]")
        for name, value in _below(table, kept).items():
            lines.append(f"{name} = {_cut_text(value)}")
    return lines + [f"# remove {path}" for path in changes if path not in kept]


def _cut_text(value: Any) -> str:
    """A value on one line; of a long table the first rows."""
    if not isinstance(value, Mapping) or len(value) <= INLINE:
        return value_text(value)
    first = value_text(dict(list(value.items())[: INLINE - 1]))
    return f"{first.removesuffix(' }')}, ... }}  # {len(value) - INLINE + 1} more"


def _key(name: str) -> str:
    """A key of TOML, in quotes where it needs them."""
    bare = re.fullmatch(r"[\w-]*[A-Za-z0-9][\w-]*", name, re.ASCII)
    return name if bare else json.dumps(name, ensure_ascii=False)


GROUP_GAINS = "exosystem.groups.W"
#: The key paths that a change may name; some of them only where all agents have one exosystem.
_OF_ALL = (
    "exosystem",
    "exosystem.A",
    "exosystem.C",
    "observer",
    "observer.W",
    "observer.P",
    "observer.rate",
)
_OF_NETWORK = (
    "target",
    "network.arrow",
    "network.modes",
    "coupling.h",
    "coupling.exceptions",
    "pinning.gains",
)
CHANGEABLE = (*_OF_NETWORK, *_OF_ALL, "region.initial_disturbance", "simulation.xi0", GROUP_GAINS)


def gain_changes(problem: Problem, W: Matrix | None, groups: Groups = ()) -> Document:
    """The changes that make W (of ``groups``, as it acts on these: block diagonal) the observer
    gain, None: a designed one; P is removed."""
    if not problem.is_grouped:
        return {"observer.W": None if W is None else typed_matrix(W), "observer.P": None}
    if W is None:
        return {GROUP_GAINS: None}
    gains = zip(problem.groups, gains_of(groups or problem.groups, W), strict=True)
    return {GROUP_GAINS: {group.name: typed_matrix(gain) for group, gain in gains}}


def changed_problem(problem: Problem, changes: Table) -> Problem:
    """The problem with these keys (path -> value as in the file, None to remove it) set.  Raises:
    SpecError."""
    for key in changes:
        if key not in CHANGEABLE:
            raise refused(
                key,
                f"{shown(key)} is no key that a change may set.",
                f"One of {', '.join(CHANGEABLE)}.",
            )
    given = {
        "target": changes.get("target", problem.target),
        "coupling": changes.get("coupling.h", problem.coupling),
        "gains": changes.get("pinning.gains", problem.pinning),
    }
    if "network.modes" in changes:
        arrow = changes.get("network.arrow", "listens_to")
        old = problem.network
        made = Network.from_arcs(
            changes["network.modes"], agents=old.labels, arrow=arrow, negative=old.negative
        )
        given["network"] = made
    if "coupling.exceptions" in changes:
        given["exceptions"] = changes["coupling.exceptions"]
    if problem.is_grouped:
        given |= _changed_groups(problem, changes)
    else:
        given["exosystem"] = _changed(problem.exosystem, "exosystem", changes)
        given["observer"] = None
        if given["exosystem"] is not None:
            observer = _changed(problem.observer, "observer", changes)
            given["observer"] = Observer() if observer is None else observer
    given["simulation"] = _changed(problem.simulation, "simulation", changes)
    given["region"] = _changed(problem.region, "region", changes)
    return problem.replace(**given)


def _changed(noun: Any, table: str, changes: Table) -> Any:
    """The noun of a table with the keys that change; None where it goes, or is not there."""
    if noun is None or (table in changes and changes[table] is None):
        return None
    return replace(noun, **_below(table, changes))


def _changed_groups(problem: Problem, changes: Table) -> Document:
    """The groups with other gains.  Raises: SpecError for a change of all agents."""
    if any(key in _OF_ALL for key in changes):
        raise refused(
            "exosystem.groups",
            "exosystem and observer cannot be changed by key where agents have different ones.",
            "Make the problem anew with other groups.",
        )
    if GROUP_GAINS not in changes:
        return {}
    gains = changes[GROUP_GAINS] or {}
    groups = []
    for group in problem.groups:  # one without a gain gets its W designed
        observer = Observer(W=gains.get(group.name), rate=group.observer.rate)
        groups.append(replace(group, observer=observer))
    return {"groups": groups}


def _below(table: str, changes: Table) -> Document:
    """The keys of a table, without its name."""
    own = {}
    for key, value in changes.items():
        if key.startswith(f"{table}.") and key != GROUP_GAINS:
            own[key.removeprefix(f"{table}.")] = value
    return own


REMARK = "set by dobc certify --apply-fix"  # in place of a comment on the value that stood there


def changed_text(
    text: str,
    changes: Table,
    *,
    whole: bool = False,
    remark: str = REMARK,
    remarks: Mapping[str, str] = MappingProxyType({}),
) -> str | None:
    """The text of a problem file with these keys set; comments and order stay.  Raises: SpecError
    if it is no TOML.  In a table with lines of its own ([pinning.gains]) only the lines change
    whose values do; ``whole``: all of them. ``remark``: the comment on what was set, ``remarks``:
    other ones by path.  Returns: None if the text cannot be changed key by key."""
    parse_toml(text.encode("utf-8"))  # bounds size and nesting before tomlkit sees it
    try:
        document = tomlkit.parse(text)
        for path, value in changes.items():
            own = remarks.get(path, remark)
            if path == GROUP_GAINS:
                _set_group_gains(document, value or {}, remark=own)
            else:
                _set(document, path, value, whole=whole, remark=own)
        return tomlkit.dumps(document)
    except _NOT_BY_KEY:
        return None


#: What tomlkit raises where a text, though it is TOML, is written in a way that it cannot change.
_NOT_BY_KEY = (
    TOMLKitError,
    TypeError,
    ValueError,
    KeyError,
    IndexError,
    AttributeError,
    RecursionError,
)


def _set(document: Any, path: str, value: Any, *, remark: str, whole: bool = True) -> None:
    """Set, or remove, the value at a path of a TOML document."""
    table = document
    *tables, name = path.split(".")
    for each in tables:
        if each not in table:
            if value is None:
                return
            table[each] = tomlkit.table()
        table = table[each]
    if value is None:
        if name in table:
            table.remove(name)
            if tables and not len(table):
                document.remove(tables[0])
        return
    old = table.get(name)
    if not whole and isinstance(value, Mapping) and isinstance(old, tomlkit.items.Table):
        _change_lines(old, value, remark)
        return
    item = _item(value)
    is_table = isinstance(old, Mapping) or isinstance(item, Mapping)
    # A table is written in another place than a value.
    if name in table and is_table and type(old) is not type(item):
        table.remove(name)
    # A table ends with an empty line, or the next one sticks to it.
    if isinstance(item, tomlkit.items.Table):
        item.add(tomlkit.nl())
    table[name] = item
    table[name].comment(remark)


def _set_group_gains(document: Any, gains: Table, *, remark: str) -> None:
    """W of every group in its table, found by the label of an agent, or in [observer] for those
    outside of all."""
    left = dict(gains)
    for table in document["exosystem"]["groups"]:
        agents = {str(agent) for agent in table["agents"]}
        name = next((name for name in gains if name in agents), None)
        own = None if name is None else left.pop(name)
        _set(table, "W", own, remark=remark)
        _set(table, "P", None, remark=remark)
    # The gain that no group has taken is that of the agents outside of all groups.
    outside = next(iter(left.values()), None)
    _set(document, "observer.W", outside, remark=remark)
    _set(document, "observer.P", None, remark=remark)


def _change_lines(table: Any, wanted: Table, remark: str) -> None:
    """Change the lines of a table that say something else than wanted, and leave the others with
    their comments."""
    for key in [str(key) for key in table if str(key) not in wanted]:
        table.remove(key)
    for key, value in wanted.items():
        if key not in table or table[key].unwrap() != value:
            table[key] = _item(value)
            table[key].comment(remark)


def _item(value: Any) -> Any:
    """A value as tomlkit writes it; a long table gets lines of its own."""
    if isinstance(value, Mapping):
        table = tomlkit.inline_table() if len(value) <= INLINE else tomlkit.table()
        for key, each in value.items():
            table[str(key)] = _item(each)
        return table
    return tomlkit.item(value)


def changed_file(
    problem: Problem,
    changes: Table,
    *,
    text: str | None,
    folder: Path,
    name: str | None = None,
    remark: str = REMARK,
    remarks: Mapping[str, str] = MappingProxyType({}),
) -> str:
    """The text of a file in ``folder`` that holds the problem with these changes.  Raises:
    SpecError.  ``text``: the TOML the problem came from, or None; its comments and its order stay
    where that is possible.  ``name``: of the new problem, where it is another one."""
    wanted = changed_problem(problem, changes)
    if name is not None:
        wanted = wanted.replace(name=name)
        changes = {"name": name, **changes}
    # First in the text that was there, then in one of the problem; each time first with the
    # comments of every line that stays, then with whole tables written anew.
    for source in _texts(problem, text):
        for whole in (False, True):
            own = changed_text(source, changes, whole=whole, remark=remark, remarks=remarks)
            if own is not None and _gives(own, wanted, folder=folder):
                return own
    # Last without remarks.
    anew = problem_text(wanted)
    if _gives(anew, wanted, folder=folder):
        return anew
    raise refused(
        "problem",
        "the changed problem cannot be written as a problem file: it is too large, or a number in "
        "it too long.",
        "Make the change by hand.",
    )


def _texts(problem: Problem, text: str | None) -> Iterator[str]:
    if text is not None:
        yield text
    yield problem_text(problem)


def _gives(text: str, wanted: Problem, *, folder: Path) -> bool:
    """Whether reading the text gives this problem."""
    try:
        found = read_problem_text(text.encode("utf-8"), folder=folder, default_name=wanted.name)
    except SpecError:
        return False
    return canonical_bytes(found) == canonical_bytes(wanted)


def problem_text(problem: Problem) -> str:
    """A whole problem file.  Reading it gives an equal Problem."""
    names = problem.network.names
    labels = list(problem.network.labels)
    # A count in place of labels, as somebody would write it.
    counted = labels == [str(i + 1) for i in range(len(labels))]
    document = tomlkit.document()
    document["schema"] = 1
    for name, value in texts_of(problem).items():
        if value and name != "time":  # a key of [dynamics]
            document[name] = value
    document["target"] = [typed_number(x) for x in problem.target]
    network = {
        "agents": len(labels) if counted else labels,
        "arrow": "listens_to",
        "modes": mode_table(problem.network),
    }
    if problem.network.negative:
        network["negative"] = problem.network.negative
    document["network"] = _table(network)
    document["coupling"] = _table(_coupling(problem, names))
    for name, content in _settings(problem, labels).items():
        document[name] = _table(content)
    return tomlkit.dumps(document)


def mode_table(network: Network, names: Sequence[str | int] = ()) -> Document:
    """The arcs of every mode as they stand in a file with arrow = "listens_to"; ``names``: what
    agents are called there, if not by their labels."""
    return {name: _arcs(arcs, names or network.names) for name, arcs in network.modes.items()}


def _arcs(arcs: Arcs, labels: Sequence[str | int]) -> Any:
    """The arcs of a mode; optional ones, which are the last, have a list of their own."""
    rows = []
    for i, j, w in arcs:
        row = [labels[i], labels[j]]
        rows.append(row if w == 1 else [*row, typed_number(w)])
    if not arcs.optional:
        return rows
    sure = len(rows) - arcs.optional
    return {"arcs": rows[:sure], "optional": rows[sure:]}


def _coupling(problem: Problem, labels: Names) -> Document:
    """[coupling]: h, and the exceptions arc by arc."""
    table: Document = {"h": coupling_text(problem.coupling)}
    exceptions = []
    for (i, j), coupling in sorted(problem.exceptions.items()):
        exceptions.append({"arcs": [[labels[i], labels[j]]], "h": coupling_text(coupling)})
    if exceptions:
        table["exceptions"] = exceptions
    return table


def _settings(problem: Problem, labels: Names) -> dict[str, Document]:
    """The tables after [coupling], those that say something, with the keys that say something."""
    # The same tables as problem.json has, with the numbers that somebody would type.
    tables = converted(settings_of(problem), typed_number)
    for group in (tables["exosystem"] or {}).get("groups", ()):
        group["agents"] = [labels[i] for i in group["agents"]]
    _state_bands(problem, tables)
    offsets = {labels[i]: typed_matrix([x])[0] for i, x in problem.offsets.items()}
    mode_gains = {mode: gain_table(k, labels) for mode, k in problem.pinning.modes.items()}
    fixed = {label: _place(place) for label, place in problem.fixed.items()}
    # In the order of a file: an exosystem and its observer stand before the formation.
    ordered = {
        "fixed": fixed,
        "pinning": {
            "gains": gain_table(problem.pinning.gains, labels) or None,
            "modes": mode_gains or None,
        },
        "exosystem": tables.pop("exosystem"),
        "observer": tables.pop("observer"),
        "formation": {"offsets": offsets or None},
        "dynamics": {"time": TIMES[1] if problem.steps else None},
        **tables,
    }
    kept = {name: _given(table or {}) for name, table in ordered.items()}
    return {name: table for name, table in kept.items() if table}


def _state_bands(problem: Problem, tables: dict[str, Document]) -> None:
    """Bands stand in [exosystem], where agents in no group would be given poles for them."""
    plant = tables.get("uncertainty") or {}
    bands = plant.pop("bands", None)
    if bands is None:
        return
    given = {"bands": [row[:2] for row in bands], "amplitude": [row[2] for row in bands]}
    own = {**given, **tables["exosystem"]}
    tables["exosystem"] = own
    if not any(plant[name] for name in (*RELATIVE, *BOUNDS)):
        del tables["uncertainty"]
    disturbed = {agent for group in problem.groups for agent in group.agents}
    others = [name for name in problem.network.labels if name not in disturbed]
    if others:
        own["groups"] = [*own["groups"], {"agents": others, "none": True}]


def _place(place: Pairs) -> Any:
    """Where a fixed node is, or between what it moves."""
    value = resting(place)
    return {"between": typed_matrix(place)} if value is None else typed_matrix([value])[0]


def _given(table: Table) -> Document:
    """A table without the keys that say nothing."""
    return {key: value for key, value in table.items() if value is not None}


def _table(content: Table) -> Any:
    """A table of a new document."""
    table = tomlkit.table()
    for key, value in content.items():
        if isinstance(value, Mapping) and key == "modes":
            table[key] = _table(value)
        elif key == "groups":
            table[key] = tomlkit.aot()
            for group in value:
                table[key].append(_table(_given(group)))
        else:
            table[key] = _item(value)
    return table
