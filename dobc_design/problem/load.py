"""Problem files and built-in problems: TOML in, a Problem out; every mistake named by its key, all
at once.

Nothing from the file is ever executed; numbers are read from their text.  Whatever the bytes are,
the time is linear in their number: strings are skipped without backtracking, and nesting is counted
before the TOML parser, which is recursive and quadratic in it, sees the text.
"""

from __future__ import annotations

import os
import re
import stat
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from functools import cache, partial
from importlib.resources import files
from itertools import islice, takewhile
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from dobc_design.coupling.coupling import Coupling, make_coupling
from dobc_design.errors import SpecError, about, kept, raise_all, wrong
from dobc_design.exact.reading import MOST_ERRORS, NumberText, is_list, is_text, named, shown
from dobc_design.problem import arcs_file, exosystems
from dobc_design.problem.canonical import problem_from_canonical
from dobc_design.problem.dynamics import Dynamics
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.groups import Group, Observer, check_observer, group_key, renamed
from dobc_design.problem.network import (
    Arcs,
    Network,
    arcs_from_pairs,
    check_arrow,
    joined,
    labels_of,
)
from dobc_design.problem.problem import Problem, dimension_of, is_name
from dobc_design.problem.schema import (
    RESERVED,
    SCHEMA_VERSION,
    ExosystemTable,
    GroupTable,
    ProblemFile,
)
from dobc_design.problem.settings import Switching

MAX_BYTES = 16 * 1024 * 1024
MAX_NESTING = 50
PROBLEM = "problem file"

# Strings and comments; possessive, so that no byte is looked at twice. A string that is not closed
# reaches to the end (of the line): the parser stops there anyway.
_TEXTS = re.compile(
    rb'"""(?:[^"\\]++|\\.|"(?!""))*+(?:"{3,5}|\Z)'
    rb"|'''(?:[^']++|'(?!''))*+(?:'{3,5}|\Z)"
    rb'|"(?:[^"\\\n]++|\\.)*+"?'
    rb"|'[^'\n]*+'?"
    rb"|#[^\n]*+",
    re.DOTALL,
)
_DOTTED_KEY = re.compile(rb"[A-Za-z0-9_\-' \t.]++")
_BRACKET = re.compile(rb"[\[\]{}]")
_KINDS = {stat.S_IFREG: "", stat.S_IFDIR: "folder", stat.S_IFIFO: "pipe"}


def read_bytes(path: Path, *, limit: int = MAX_BYTES, what: str = PROBLEM) -> bytes:
    """Read a regular file of at most ``limit`` bytes; ``what`` it ought to be is for messages.
    Raises: SpecError that names the file.  Pipes and devices are refused: they may never end, or
    never begin."""
    name = shown(path.name)
    try:
        state = path.stat()
        kind = _KINDS.get(stat.S_IFMT(state.st_mode), "device")
        data = b"" if kind or state.st_size > limit else path.read_bytes()
    except FileNotFoundError:
        known = " and no built-in problem of that name" if what == PROBLEM else ""
        cure = "`dobc problems` lists the built-in ones." if known else "Check the path."
        raise SpecError(f"there is no file {name}{known}.", key=path.name, cure=cure) from None
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        reason = getattr(error, "strerror", None) or error
        raise SpecError(
            f"{name} cannot be read: {reason}.", key=path.name, cure="Check the path."
        ) from None
    if kind:
        cure = "Name the file in it." if kind == "folder" else "Write it to a file first."
        raise SpecError(f"{shown(str(path))} is a {kind}, not a {what}.", key=path.name, cure=cure)
    if max(state.st_size, len(data)) > limit:
        raise _too_large(limit, what)
    return data


def parse_toml(data: bytes) -> dict[str, Any]:
    """Parse TOML; numbers with a point or an exponent stay text.  Raises SpecError."""
    if len(data) > MAX_BYTES:
        raise _too_large(MAX_BYTES)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        what = f"the problem file must be UTF-8 text; byte {error.start} is not."
        raise SpecError(what, cure="Save it as UTF-8.") from None
    if not text.strip():
        what = "the problem file is empty."
        raise SpecError(
            what, key="network", cure="Copy a built-in one to start from: `dobc problems`."
        )
    _check_nesting(data)
    try:
        document = tomllib.loads(text, parse_float=NumberText)
    except RecursionError:
        raise _too_deep() from None
    except tomllib.TOMLDecodeError as error:
        what = f"the problem file is not valid TOML: {error}."
        raise SpecError(
            what,
            cure="Check that line for a missing quote or bracket, a repeated key, or yes for true.",
        ) from None
    except ValueError:  # Python refuses to read a whole number of more than 4300 digits
        what = "the problem file holds a whole number of thousands of digits."
        raise SpecError(what, cure="Numbers have at most 200 digits.") from None
    _check_depth(document)
    return document


def _check_nesting(data: bytes) -> None:
    bare = _TEXTS.sub(b"''", data)
    depth = 0
    for match in _BRACKET.finditer(bare):
        depth = depth + 1 if match.group() in b"[{" else max(0, depth - 1)
        if depth > MAX_NESTING:
            raise _too_deep()
    if any(match.group().count(b".") >= MAX_NESTING for match in _DOTTED_KEY.finditer(bare)):
        raise _too_deep()


def _check_depth(document: Mapping[str, Any]) -> None:
    level: list[Any] = [document]
    for _ in range(MAX_NESTING + 1):
        deeper: list[Any] = []
        for value in level:
            children = value.values() if isinstance(value, dict) else value
            deeper.extend(child for child in children if isinstance(child, (dict, list)))
        if not deeper:
            return
        level = deeper
    raise _too_deep()


def _too_large(limit: int, what: str = PROBLEM) -> SpecError:
    arcs = 'Keep long lists of arcs in a CSV file: Ga = { file = "arcs.csv" }.'
    cure = arcs if what == PROBLEM else "dobc_design writes no such file."
    return SpecError(f"the {what} is too large: at most {limit} bytes are read.", cure=cure)


def _too_deep() -> SpecError:
    what = f"the problem file is nested too deeply: at most {MAX_NESTING} levels are read."
    return SpecError(what, cure="Flatten it.")


Location = tuple[int | str, ...]
T = TypeVar("T")

_EXAMPLES = {
    "network": "[network] with agents, arrow and, below it, [network.modes]",
    "network.agents": 'agents = 10, or agents = ["lead", "wing"]',
    "network.arrow": 'arrow = "listens_to" when [a, b] means that a '
    'hears b, else arrow = "sends_to"',
    "network.modes": "[network.modes] and below it Ga = [[1, 2], [2, 3]]",
    "coupling": '[coupling] and below it h = "exp(y) - 1 + y"',
    "coupling.h": 'h = "exp(y) - 1 + y"',
    "coupling.exceptions": '[[coupling.exceptions]] and below it arcs = [[1, 2]] and h = "2*y"',
    "coupling.exceptions.arcs": "arcs = [[1, 2]]",
    "coupling.exceptions.h": 'h = "2*y"',
    "pinning": "[pinning] and below it gains = { 1 = 5.0, 6 = 2 }",
    "exosystem": "[exosystem] and below it A = [[0, 2], [-2, 0]] and C = [[1, 0]]",
    "exosystem.A": "A = [[0, 2], [-2, 0]]",
    "exosystem.C": "C = [[1, 0]]",
    "exosystem.groups": "[[exosystem.groups]] and below it agents = "
    "[1, 2], A = [[0]] and C = [[1]]",
    "exosystem.groups.agents": "agents = [1, 2]",
    "formation.offsets": "offsets = { 2 = 1.5, 3 = -1.5 }",
    "region.initial_states": "initial_states = [0, 5]",
    "leader.initial": "initial = [[0, 1], [-1, 1]]",
}


def explain(error: ValidationError) -> SpecError:
    """Turn what pydantic found into one error that names every key (the first twenty)."""
    items = error.errors(include_url=False)
    return SpecError.several([_explain(item) for item in islice(items, MOST_ERRORS)])


def _explain(item: Any) -> SpecError:
    location, value = item["loc"], item["input"]
    key = key_text(location)
    if item["type"] == "extra_forbidden":
        return _unknown_key(key, location)
    example = f"Write {_EXAMPLES.get(_without_places(key), f'[{key}] and its keys below')}."
    if item["type"] == "missing":
        return wrong(key, "is required and missing.", example)
    kind = "list of tables" if item["type"] == "list_type" else "table"
    return wrong(key, f"must be a {kind}; got {shown(value)}.", example)


def key_text(location: Location) -> str:
    """Write a location as the user would: tables dotted, places in a list as [0]."""
    text = ""
    for part in location:
        text += f"[{part}]" if isinstance(part, int) else f"{'.' if text else ''}{named(part)}"
    return text


def _without_places(key: str) -> str:
    return re.sub(r"\[\d+\]", "", key)


def _unknown_key(key: str, location: Location) -> SpecError:
    table, name = key_text(location[:-1]), str(location[-1])
    place = f" in [{table}]" if table else ""
    if _without_places(key) in RESERVED:
        return wrong(
            key,
            f"is an unknown key{place}: it is reserved for a later version.",
            "Remove it for now.",
        )
    known = known_keys(_without_places(table))
    near = [other for other in known if other.lower() == name.lower()]
    near += get_close_matches(name[:100], known, n=1, cutoff=0.7)
    homes = [f"[{home}]" for home in _tables() if home and name in known_keys(home)]
    hint = (
        f'; did you mean "{near[0]}"?'
        if near
        else f"; it belongs in {' or '.join(homes)}."
        if homes
        else "."
    )
    return wrong(key, f"is an unknown key{place}{hint}", f"Known keys{place}: {', '.join(known)}.")


@cache
def _tables() -> dict[str, tuple[str, ...]]:
    """The keys of every table, by its name; "" is the top of the file."""
    schema = ProblemFile.model_json_schema(by_alias=True)
    tables: dict[str, tuple[str, ...]] = {}

    def walk(name: str, properties: dict[str, Any]) -> None:
        tables[name] = tuple(properties)
        for key, node in properties.items():
            items = node.get("items", {})
            for choice in (node, items, *node.get("anyOf", ())):
                if "$ref" in choice:
                    child = schema["$defs"][choice["$ref"].rsplit("/", 1)[1]]
                    walk(f"{name}.{key}" if name else key, child["properties"])

    walk("", schema["properties"])
    return tables


def known_keys(table: str) -> tuple[str, ...]:
    """The keys that a table may have; "" is the top of the file."""
    return _tables().get(table, ())


@dataclass(frozen=True, slots=True, kw_only=True)
class Disturbances:
    """What [exosystem] says: the exosystem of the agents in no group (None: they have no
    disturbance), the groups, and the lists of agents without a disturbance, with their keys."""

    exosystem: Exosystem | None = None
    groups: tuple[Group, ...] = ()
    without: Mapping[str, Sequence[Any]] = field(default_factory=dict)

    def divided(
        self, labels: Sequence[str], observer: Observer | None, states: int | None
    ) -> tuple[Exosystem | None, tuple[Group, ...]]:
        """The exosystem and the groups of a Problem, in which agents in no group have no
        disturbance where there is no exosystem: agents that share it then are a group like others.
        ``states``: how many an agent with [dynamics] has.  Raises: SpecError."""
        listed = {str(agent): key for key, agents in self.without.items() for agent in agents}
        if not listed or self.exosystem is None:
            return self.exosystem, self.groups
        others = {agent for group in self.groups for agent in group.agents} | set(listed)
        rest = [label for label in labels if label not in others]
        if not rest:
            what = (
                "and exosystem.C apply to no agent, because every agent is in a group of "
                "exosystem.groups."
            )
            raise wrong("exosystem.A", what, "Remove A and C (or kind) from [exosystem].")
        own = Observer() if observer is None else Observer(W=observer.W, P=observer.P)
        check_observer(own, q=self.exosystem.order, m=self.exosystem.outputs, states=states)
        return None, (*self.groups, Group(agents=rest, exosystem=self.exosystem, observer=own))

    def checked(self, labels: Sequence[str]) -> Disturbances:
        """Every agent without a disturbance is there, once.  Raises: SpecError."""
        owner = {
            agent: group_key(k) for k, group in enumerate(self.groups) for agent in group.agents
        }
        for key, agents in self.without.items():
            for place, agent in enumerate(map(str, agents)):
                if agent not in labels:
                    what = f"there is no agent {shown(agent)} in network.agents."
                    raise about(f"{key}.agents[{place}]", what, "Use the label of an agent.")
                if agent in owner:
                    what = (
                        f"agent {shown(agent)} is in {owner[agent]} already, and an agent has "
                        "one exosystem only."
                    )
                    raise about(f"{key}.agents[{place}]", what, "Keep it in one group.")
                owner[agent] = key
        return self


def read_exosystem(
    tables: ProblemFile, *, dimension_of: Callable[[Exosystem | None], int]
) -> Disturbances:
    """The disturbances of all agents.  Raises: SpecError naming the keys.  ``dimension_of``: how
    many state components there are, for the first exosystem given by A and C, or None; one given in
    words has that many."""
    table = tables.exosystem
    if table is None:
        return Disturbances()
    errors: list[SpecError] = []
    places = {"exosystem": table} | {
        group_key(number): group for number, group in enumerate(table.groups)
    }
    found = {place: _explicit(each, place, errors) for place, each in places.items()}
    raise_all(errors)
    m = dimension_of(next((each for each in found.values() if each is not None), None))
    own, *others = (
        found[place] or _in_words(each, place, m, errors) for place, each in places.items()
    )
    result, without = list[Group](), dict[str, Sequence[Any]]()
    for number, (each, exosystem) in enumerate(zip(table.groups, others, strict=True)):
        try:
            observer = Observer(W=each.W, P=each.P)
            if exosystem is not None or each.none:
                agents, key = each.agents, f"{group_key(number)}.agents"
                if (
                    not is_list(agents)
                    or not agents
                    or not all(is_text(x) or isinstance(x, str | int) for x in agents)
                ):
                    what = f"must be a list of labels, at least one; got {shown(agents)}."
                    raise wrong(key, what, "For example agents = [1, 2].")
            if exosystem is not None:
                result.append(Group(agents=list(agents), exosystem=exosystem, observer=observer))
            elif each.none:
                without[group_key(number)] = list(agents)
        except SpecError as error:
            errors.append(renamed(error, group_key(number)))
    raise_all(errors)
    return Disturbances(exosystem=own, groups=tuple(result), without=without)


def _explicit(
    table: ExosystemTable | GroupTable, place: str, errors: list[SpecError]
) -> Exosystem | None:
    """The exosystem of A and C; None where a kind stands in their place, or where groups alone are
    given."""
    matrices = [name for name in ("A", "C") if getattr(table, name) is not None]
    parts = [name for name in exosystems.PARTS if getattr(table, name) is not None]
    if isinstance(table, GroupTable) and table.none is not None:
        _check_none(table, place, [*matrices, *parts], errors)
        return None
    if parts and matrices:
        both = f"stands beside {' and '.join(matrices)}; only one of them can be used."
        errors.append(
            wrong(f"{place}.{parts[0]}", both, f"Give either A and C or {' and '.join(parts)}.")
        )
    if parts or (isinstance(table, ExosystemTable) and table.groups and not matrices):
        return None
    for name in sorted({"A", "C"} - set(matrices)):
        example = _EXAMPLES[f"exosystem.{name}"]
        errors.append(wrong(f"{place}.{name}", "is required and missing.", f"Write {example}."))
    if len(matrices) < 2:
        return None
    try:
        return Exosystem(A=table.A, C=table.C)
    except SpecError as error:
        found = renamed(error, place)
        if "pi" in str(table.A):  # the commonest reason for pi is a sine
            cure = (
                f"For a sine write hz = [0.5] or frequencies = [3.14159265] in [{place}], in "
                "place of A and C."
            )
            found = type(found)(str(found).partition("\n")[0], key=found.key, cure=cure)
        errors.append(found)
        return None


def _check_none(
    table: GroupTable, place: str, given: Sequence[str], errors: list[SpecError]
) -> None:
    """``none`` is true, and says all that there is to say of the disturbance of its agents."""
    key, given = (
        f"{place}.none",
        [*given, *(name for name in ("W", "P") if getattr(table, name) is not None)],
    )
    if table.none is not True:
        what = f"must be true, for agents without a disturbance; got {shown(table.none)}."
        errors.append(
            wrong(key, what, "Write none = true, or leave it out and give A and C, or a part.")
        )
    elif given:
        what = (
            f"stands beside {' and '.join(given)}: agents without a disturbance need no observer."
        )
        errors.append(wrong(key, what, f"Remove none, or {' and '.join(given)}."))


def _in_words(
    table: ExosystemTable | GroupTable, place: str, components: int, errors: list[SpecError]
) -> Exosystem | None:
    parts = {name: getattr(table, name) for name in exosystems.PARTS}
    if all(value is None for value in parts.values()):
        return None
    try:
        return exosystems.of_parts(**parts, components=components)
    except SpecError as error:
        for each in error.errors:
            own = (each.key or "constant").removeprefix("exosystem").removeprefix(".")
            key = f"{place}.{own}".rstrip(".")
            errors.append(
                type(each)(each.message.replace(each.key or "", key, 1), key=key, cure=each.cure)
            )
        return None


def read_problem_file(path: Path) -> Problem:
    """Read a problem from a TOML file, or from a canonical problem.json.  Raises: SpecError naming
    key and cure."""
    if path.suffix.lower() == ".json":  # it holds the arcs, too
        return problem_from_canonical(read_bytes(path, limit=arcs_file.MAX_BYTES), name=path.name)
    suffix = path.suffix.lower()
    # a .txt may hold TOML
    if suffix in (*arcs_file.READERS, ".m") and suffix != ".txt" and path.is_file():
        arcs = suffix != ".m"
        what = (
            f"{shown(path.name)} is {'a file of arcs' if arcs else 'a MATPOWER case'}, not a "
            "problem file."
        )
        arrow = " --arrow listens_to (or sends_to)" if arcs else ""
        cure = (
            f"`dobc new NAME --from FILE{arrow}` makes a problem of it; in Python "
            "problem_from_file does."
        )
        raise SpecError(what, key=path.name, cure=cure)
    return read_problem_text(read_bytes(path), folder=path.resolve().parent, default_name=path.stem)


def read_problem_text(
    data: bytes, *, folder: Path | None, default_name: str = "problem"
) -> Problem:
    """Read a problem from the bytes of a TOML file; ``folder`` is where ``file = `` may look."""
    return read_problem_tables(parse_toml(data), folder=folder, default_name=default_name)


def read_problem_tables(
    document: Mapping[str, Any], *, folder: Path | None, default_name: str
) -> Problem:
    """Read a problem from the tables of a TOML file, as ``parse_toml`` gives them."""
    _check_version(document)
    try:
        tables = ProblemFile.model_validate(document)
    except ValidationError as error:
        raise explain(error) from None
    return _build(
        tables, folder=folder, default_name=default_name if is_name(default_name) else "problem"
    )


def _check_version(document: Mapping[str, Any]) -> None:
    version = document.get("schema", SCHEMA_VERSION)
    if isinstance(version, bool) or not isinstance(version, int) or version < 1:
        what = f"must be the whole number {SCHEMA_VERSION}; got {shown(version)}."
        raise wrong("schema", what, f"Write schema = {SCHEMA_VERSION}.")
    if version > SCHEMA_VERSION:
        what = (
            f"must be at most {SCHEMA_VERSION}, the newest this program knows; got "
            f"{shown(version)}."
        )
        raise wrong("schema", what, "Update dobc_design.")


def _tried(part: Callable[[], T], errors: list[SpecError]) -> T | None:
    """What ``part`` returns, or None when it raises a SpecError, which is kept."""
    try:
        return part()
    except SpecError as error:
        errors.extend(error.errors)
        return None


def _given(table: BaseModel | None) -> dict[str, Any] | None:
    return None if table is None else table.model_dump()


def _build(tables: ProblemFile, *, folder: Path | None, default_name: str) -> Problem:
    errors: list[SpecError] = []

    table = _given(tables.dynamics)
    dynamics = None if table is None else _tried(lambda: Dynamics(**table), errors)
    if table is not None and dynamics is None:
        raise SpecError.several(errors)

    def dimension(exosystem: Exosystem | None) -> int:
        return (
            dimension_of(exosystem, tables.target, tables.coupling.h)
            if dynamics is None
            else dynamics.inputs
        )

    network = _tried(lambda: _network(tables, folder=folder), errors)
    given = _tried(lambda: read_exosystem(tables, dimension_of=dimension), errors)
    own, signal = _given(tables.observer), _given(tables.switching)
    observer = None if own is None else _tried(lambda: Observer(**own), errors)
    switching = None if signal is None else _tried(lambda: Switching(**signal), errors)
    if given is None:
        raise SpecError.several(errors)
    first = (
        given.exosystem
        if given.exosystem is not None or not given.groups
        else given.groups[0].exosystem
    )
    m = _tried(lambda: dimension(first), errors)
    if network is None or m is None:
        raise SpecError.several(errors)
    labels, states = network.labels, None if dynamics is None else dynamics.dimension
    known = _tried(lambda: given.checked(labels), errors)
    divided = (
        None if known is None else _tried(lambda: known.divided(labels, observer, states), errors)
    )
    if divided is None:
        raise SpecError.several(errors)
    exosystem, groups = divided
    # W and P are those of the last group now
    if exosystem is not given.exosystem and observer is not None:
        observer = None if observer.rate is None else Observer(rate=observer.rate)
    sizes = (m, m) if dynamics is None else (dynamics.dimension, dynamics.inputs)
    exceptions = _tried(lambda: _exceptions(tables, network, sizes=sizes), errors)
    problem = _tried(
        lambda: Problem(
            name=default_name if tables.name is None else tables.name,
            network=network,
            coupling=tables.coupling.h,
            exceptions=exceptions,
            target=tables.target,
            gains=None if tables.pinning is None else tables.pinning.gains,
            exosystem=exosystem,
            observer=observer,
            groups=groups,
            offsets=None if tables.formation is None else tables.formation.offsets,
            region=_given(tables.region),
            switching=switching,
            notes=tables.notes,
            simulation=_given(tables.simulation),
            uncertainty=_given(tables.uncertainty),
            actuators=_given(tables.actuators),
            dynamics=dynamics,
            leader=_given(tables.leader),
        ),
        errors,
    )
    if problem is None or errors:
        raise SpecError.several(errors)
    return problem


def _network(tables: ProblemFile, *, folder: Path | None) -> Network:
    table, errors = tables.network, list[SpecError]()
    _tried(lambda: check_arrow(table.arrow), errors)
    labels = _tried(lambda: labels_of(table.agents), errors)
    if labels is None or errors:
        raise SpecError.several(errors)
    index = {label: i for i, label in enumerate(labels)}
    modes: dict[str, Arcs] = {}
    for name, value in table.modes.items():
        key = f"network.modes.{named(name)}"
        with kept(errors):
            read = partial(_mode, index=index, arrow=table.arrow, folder=folder)
            modes[name] = _with_optional(value, read, key=key)
        if len(errors) >= MOST_ERRORS:
            break
    # With what can be read, so that further mistakes show at once.
    network = (
        _tried(lambda: Network(labels=labels, modes=modes), errors) if modes or not errors else None
    )
    if network is None or errors:
        raise SpecError.several(errors)
    return network


def _with_optional(value: Any, read: Callable[..., Arcs], *, key: str) -> Arcs:
    """A mode; of one with optional arcs these are the last."""
    if not isinstance(value, dict) or "optional" not in value:
        return read(value, key=key)
    if set(value) != {"arcs", "optional"}:
        what = (
            "must have the keys arcs and optional, and no other; got "
            f"{', '.join(map(shown, value))}."
        )
        raise wrong(key, what, "For example arcs = [[1, 2]] and optional = [[2, 3]].")
    return joined(*(read(value[part], key=f"{key}.{part}") for part in ("arcs", "optional")))


def _mode(
    value: Any, *, index: Mapping[str, int], arrow: str, key: str, folder: Path | None
) -> Arcs:
    if is_list(value):
        return arcs_from_pairs(value, index=index, arrow=arrow, key=key)
    known = isinstance(value, dict) and set(value) <= {"file", "merge", "drop_loops"}
    if not known or not is_text(value.get("file")):
        wanted = 'a list of arcs, { file = "arcs.csv" } or a table with arcs and optional'
        what = f"{key} must be {wanted}; got {shown(value)}."
        cure = (
            'For example [[1, 2], [2, 3]]; beside file may stand merge = "sum" and drop_loops '
            "= true."
        )
        raise SpecError(what, key=key, cure=cure)
    repairs = {name: value[name] for name in ("merge", "drop_loops") if name in value}
    return arcs_file.read_arcs_file(
        value["file"], folder=folder, index=index, arrow=arrow, key=f"{key}.file", **repairs
    )


def _exceptions(
    tables: ProblemFile, network: Network, *, sizes: tuple[int, int]
) -> dict[tuple[int, int], Coupling]:
    given = tables.coupling.exceptions
    codes, index = (network.arc_codes(), network.index) if given else (set(), {})
    result: dict[tuple[int, int], Coupling] = {}
    errors: list[SpecError] = []
    for position, table in enumerate(given):
        key = f"coupling.exceptions[{position}]"
        pairs, seen = list[tuple[int, int]](), set[tuple[int, int]]()
        with kept(errors):
            pairs = _exception_arcs(
                table.arcs, key=f"{key}.arcs", index=index, arrow=tables.network.arrow
            )
            for place, (listener, speaker) in enumerate(pairs):
                names = (
                    f"{named(network.labels[listener])} listens to {named(network.labels[speaker])}"
                )
                if listener * network.size + speaker not in codes:
                    turned = speaker * network.size + listener in codes
                    end = "; it is there the other way round." if turned else "."
                    what = f"no mode has the arc in which {names}{end}"
                    raise about(
                        f"{key}.arcs[{place}]", what, "Correct the arc, or remove the exception."
                    )
                if (listener, speaker) in result or (listener, speaker) in seen:
                    what = f"the arc in which {names} has an exception already."
                    raise about(f"{key}.arcs[{place}]", what, "Keep one of them.")
                seen.add((listener, speaker))
        with kept(errors):
            coupling = make_coupling(table.h, dimension=sizes[0], outputs=sizes[1], key=f"{key}.h")
            result |= dict.fromkeys(pairs, coupling)
        if len(errors) >= MOST_ERRORS:
            break
    raise_all(errors)
    return result


def _exception_arcs(
    value: Any, *, key: str, index: Mapping[str, int], arrow: str
) -> list[tuple[int, int]]:
    if not is_list(value) or not value:
        raise wrong(
            key, f"must be a list of arcs; got {shown(value)}.", "For example [[1, 2], [2, 3]]."
        )
    for place, arc in enumerate(value):
        if is_list(arc) and len(arc) == 3:
            what = "must be [a, b]; the weight stands with the arc in its mode."
            raise wrong(f"{key}[{place}]", what, "Drop the third entry.")
    arcs = arcs_from_pairs(value, index=index, arrow=arrow, key=key)
    return list(zip(arcs.listeners.tolist(), arcs.speakers.tolist(), strict=True))


SUFFIX = ".toml"


def builtin_names() -> tuple[str, ...]:
    """Names of the built-in problems, in the order they are best read."""
    folder = files("dobc_design.problems")
    names = sorted(
        item.name[: -len(SUFFIX)] for item in folder.iterdir() if item.name.endswith(SUFFIX)
    )
    return tuple(sorted(names, key=lambda name: name not in ("paper-fixed", "paper-switching")))


def builtin_text(name: str) -> str:
    """The problem file of that name, as text."""
    return (files("dobc_design.problems") / f"{name}{SUFFIX}").read_text(encoding="utf-8")


def builtin_summary(name: str) -> str:
    """The first sentence of the comment a built-in problem opens with."""
    lines = takewhile(lambda line: line.startswith("#"), builtin_text(name).splitlines())
    return " ".join(line.lstrip("# ").strip() for line in lines).split(". ", 1)[0].rstrip(".") + "."


Source = Problem | str | PathLike[str]


def load_problem(source: Source) -> Problem:
    """Read a problem file (TOML, or a canonical problem.json), or a built-in problem by its name.

    A file of that name in the current folder wins over a built-in problem; a Problem is returned as
    it is.
    Returns: a Problem.  Raises: SpecError that names every wrong key and its cure.
    Example:
        >>> dd.load_problem("paper-fixed").n
        10
    """
    if isinstance(source, Problem):
        return source
    path = Path(source)
    if isinstance(source, str) and not os.path.isfile(source):  # unlike Path, it takes any text
        if source in builtin_names():
            return read_problem_text(
                builtin_text(source).encode("utf-8"), folder=None, default_name=source
            )
        near = get_close_matches(source[:100], builtin_names(), n=1)
        if near and not os.path.exists(source):
            what = f"there is no file {shown(source)} and no built-in problem of that name."
            raise SpecError(what, key=path.name, cure=f"did you mean {near[0]}?")
    return read_problem_file(path)


def source_text(source: str | PathLike[str]) -> str | None:
    """The TOML that ``load_problem`` reads for this source; None for a problem.json.  Raises:
    SpecError."""
    path = Path(source)
    if isinstance(source, str) and not os.path.isfile(source) and source in builtin_names():
        return builtin_text(source)
    return None if path.suffix.lower() == ".json" else read_bytes(path).decode("utf-8-sig")
