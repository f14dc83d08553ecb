"""Problem files: TOML in, a Problem out; every mistake named by its key, all at once where possible.

Nothing from the file is ever executed.  Numbers are read from their text.  Sizes are bounded before
anything is parsed: 16 MB for the problem, 50 levels of nesting, and see ``spec.arcs_file`` for arcs.
"""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from dobc_design.errors import SpecError
from dobc_design.spec.arcs_file import read_arcs_file
from dobc_design.spec.canonical import problem_from_canonical
from dobc_design.spec.coupling import Coupling, make_coupling
from dobc_design.spec.exosystem import Exosystem
from dobc_design.spec.network import ARROWS, Arcs, Network, arcs_from_pairs, labels_of
from dobc_design.spec.observer import Observer
from dobc_design.spec.problem import Problem, dimension_of
from dobc_design.spec.reading import NumberText, is_list, shown
from dobc_design.spec.schema import RESERVED, SCHEMA_VERSION, ProblemFile
from dobc_design.spec.settings import Switching

MAX_BYTES = 16 * 1024 * 1024
MAX_NESTING = 50
_DOTTED = re.compile(rb"(?:[A-Za-z0-9_\-\"' \t]*\.){%d}" % MAX_NESTING)
_STRINGS = re.compile(rb'"""(?:[^\\]|\\.)*?"""|\'\'\'.*?\'\'\'|"(?:[^"\\\n]|\\.)*"|\'[^\'\n]*\'|#[^\n]*', re.DOTALL)


def read_problem_file(path: Path) -> Problem:
    """Read a problem from a TOML file, or from a canonical problem.json.

    Raises: SpecError naming the key and the cure.
    """
    data = _read_bytes(path)
    if path.suffix.lower() == ".json":
        return problem_from_canonical(data)
    return read_problem_text(data, folder=path.resolve().parent, default_name=path.stem)


def read_problem_text(data: bytes, *, folder: Path | None, default_name: str = "problem") -> Problem:
    """Read a problem from the bytes of a TOML file; ``folder`` is where ``file = `` may look."""
    document = _parse_toml(data)
    _check_version(document)
    _check_depth(document)
    try:
        tables = ProblemFile.model_validate(document)
    except ValidationError as error:
        raise SpecError.several(list(_explain(error, document))) from None
    return _build(tables, folder=folder, default_name=default_name)


def _read_bytes(path: Path) -> bytes:
    try:
        if path.is_dir():
            raise SpecError(f"{path.name!r} is a folder, not a problem file.", key=path.name, cure="Name the file in it.")
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise SpecError(
                f"{path.name!r} is too large: {size} bytes, at most {MAX_BYTES} are read.", key=path.name,
                cure='Keep long lists of arcs in a CSV file: Ga = { file = "arcs.csv" }.',
            )  # fmt: skip
        return path.read_bytes()
    except FileNotFoundError:
        raise SpecError(
            f"there is no file {path.name!r} and no built-in problem of that name.", key=path.name,
            cure="`dobc problems` lists the built-in ones.",
        ) from None  # fmt: skip
    except OSError as error:
        raise SpecError(
            f"{path.name!r} cannot be read: {error.strerror or error}.", key=path.name, cure="Check the path."
        ) from None


def _parse_toml(data: bytes) -> dict[str, Any]:
    if len(data) > MAX_BYTES:
        raise SpecError(
            f"the problem file is too large: {len(data)} bytes, at most {MAX_BYTES} are read.",
            cure="Keep long lists of arcs in a CSV file.",
        )
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise SpecError(
            f"the problem file must be UTF-8 text; byte {error.start} is not.", cure="Save it as UTF-8."
        ) from None
    if not text.strip():
        raise SpecError(
            "the problem file is empty.", key="network", cure="Copy a built-in one to start from: `dobc problems`."
        )
    _check_brackets(data)
    try:
        return tomllib.loads(text, parse_float=NumberText)
    except RecursionError:
        raise _too_deep() from None
    except tomllib.TOMLDecodeError as error:
        raise SpecError(
            f"the problem file is not valid TOML: {error}.",
            cure="Look at that line: a missing quote or bracket, or a key given twice.",
        ) from None
    except ValueError as error:
        raise SpecError(
            f"the problem file holds a number that is too long or not valid ({str(error)[:80]}).",
            cure="Numbers have at most 200 digits.",
        ) from None


def _check_brackets(data: bytes) -> None:
    """Refuse deep nesting before the TOML parser recurses into it (or takes quadratic time over it)."""
    bare = _STRINGS.sub(b"''", data)
    depth = 0
    for match in re.finditer(rb"[\[\]{}]", bare):
        depth = depth + 1 if match.group() in b"[{" else max(0, depth - 1)
        if depth > MAX_NESTING:
            raise _too_deep()
    if any(_DOTTED.match(line) for line in bare.splitlines()):
        raise _too_deep()


def _too_deep() -> SpecError:
    return SpecError(
        f"the problem file is nested too deeply; at most {MAX_NESTING} levels are read.", cure="Flatten it."
    )


def _check_version(document: Mapping[str, Any]) -> None:
    version = document.get("schema", SCHEMA_VERSION)
    if isinstance(version, bool) or not isinstance(version, int) or version < 1:
        raise SpecError(
            f"schema must be the whole number {SCHEMA_VERSION}; got {shown(version)}.", key="schema",
            cure=f"Write schema = {SCHEMA_VERSION}.",
        )  # fmt: skip
    if version > SCHEMA_VERSION:
        raise SpecError(
            f"schema {version} is newer than this program knows ({SCHEMA_VERSION}).", key="schema",
            cure="Update dobc_design.",
        )  # fmt: skip


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


def _explain(error: ValidationError, document: Mapping[str, Any]) -> Iterator[SpecError]:
    for item in error.errors():
        key = key_text(item["loc"])
        kind, value = item["type"], item["input"]
        if kind == "extra_forbidden":
            yield _unknown_key(key, item["loc"])
        elif kind == "missing":
            yield SpecError(f"{key} is required and missing.", key=key, cure=f"Add it; see `dobc schema` for {key}.")
        elif kind in ("model_type", "model_attributes_type", "dict_type"):
            yield SpecError(
                f"{key} must be a table; got {shown(value)}.", key=key, cure=f"Write [{key}] and its keys below."
            )
        elif kind == "list_type":
            yield SpecError(
                f"{key} must be a list of tables; got {shown(value)}.", key=key, cure=f"Write [[{key}]]."
            )
        else:
            reason = str(item.get("ctx", {}).get("error", item["msg"]))
            yield SpecError(f"{key} {reason}.", key=key, cure="See `dobc schema`.")


def _unknown_key(key: str, location: tuple[int | str, ...]) -> SpecError:
    known = _known_keys(location[:-1])
    table = key_text(location[:-1])
    place = f" in [{table}]" if table else ""
    if key in RESERVED or re.sub(r"\[\d+\]", "", key) in RESERVED:
        return SpecError(
            f"{key} is an unknown key{place}: it is reserved for a later version.", key=key, cure="Remove it for now."
        )
    near = difflib.get_close_matches(str(location[-1]), known, n=1)
    hint = f'; did you mean "{near[0]}"?' if near else "."
    return SpecError(
        f'{key} is an unknown key{place}{hint}', key=key, cure=f"Known keys{place}: {', '.join(known)}."
    )


def _known_keys(location: tuple[int | str, ...]) -> list[str]:
    schema = ProblemFile.model_json_schema(by_alias=True)
    node: dict[str, Any] = schema
    for part in location:
        node = node.get("items", {}) if isinstance(part, int) else node.get("properties", {}).get(part, {})
        for choice in (node, *node.get("anyOf", ())):
            if "$ref" in choice:
                node = schema["$defs"][choice["$ref"].rsplit("/", 1)[1]]
                break
    return list(node.get("properties", {}))


def key_text(location: tuple[int | str, ...]) -> str:
    """Write a location as the user would: tables dotted, places in a list as [0]."""
    text = ""
    for part in location:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            name = "schema" if part == "schema_" else str(part)
            text += f".{name}" if text else name
    return text


class _Collector:
    """Runs the parts of a file one after another and keeps their errors."""

    def __init__(self) -> None:
        self.errors: list[SpecError] = []

    def __enter__(self) -> _Collector:
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> bool:
        if isinstance(error, SpecError):
            self.errors.extend(error.errors)
            return True
        return False

    def finish(self) -> None:
        """Raise what was kept."""
        if self.errors:
            raise SpecError.several(self.errors)


def _build(tables: ProblemFile, *, folder: Path | None, default_name: str) -> Problem:
    collect = _Collector()
    exosystem, observer, switching = None, None, None
    network = None
    exceptions: dict[tuple[int, int], Coupling] = {}
    with collect:
        network = _network(tables, folder=folder)
    with collect:
        if tables.exosystem is not None:
            exosystem = Exosystem(A=tables.exosystem.A, C=tables.exosystem.C)
    with collect:
        if tables.observer is not None:
            observer = Observer(W=tables.observer.W, P=tables.observer.P, rate=tables.observer.rate)
    with collect:
        if tables.switching is not None:
            switching = Switching(signal=tables.switching.signal, dwell=tables.switching.dwell)
    if network is None or (tables.exosystem is not None and exosystem is None):
        collect.finish()
        raise AssertionError("unreachable: a part is missing without an error")  # pragma: no cover
    with collect:
        dimension = dimension_of(exosystem, tables.target, tables.coupling.h)
        exceptions = _exceptions(tables, network, dimension=dimension)
    with collect:
        problem = Problem(
            name=default_name if tables.name is None else tables.name,
            network=network,
            coupling=tables.coupling.h,
            exceptions=exceptions,
            target=tables.target,
            gains=None if tables.pinning is None else tables.pinning.gains,
            exosystem=exosystem,
            observer=observer,
            offsets={} if tables.formation is None else tables.formation.offsets,
            region=None if tables.region is None else tables.region.model_dump(),
            switching=switching,
            notes=tables.notes,
            simulation=None if tables.simulation is None else tables.simulation.model_dump(),
        )
    collect.finish()
    return problem


def _network(tables: ProblemFile, *, folder: Path | None) -> Network:
    table = tables.network
    collect = _Collector()
    labels: tuple[str, ...] = ()
    modes: dict[str, Arcs] = {}
    with collect:
        if table.arrow not in ARROWS:
            raise SpecError(
                f'network.arrow must be "listens_to" or "sends_to": it says what [a, b] means;'
                f" got {shown(table.arrow)}.",
                key="network.arrow",
                cure='"listens_to": a hears b. "sends_to": a is heard by b.',
            )
    with collect:
        if not is_list(table.agents) and (isinstance(table.agents, bool) or not isinstance(table.agents, int)):
            raise SpecError(
                f"network.agents must be a count or a list of labels; got {shown(table.agents)}.",
                key="network.agents", cure="For example agents = 10.",
            )  # fmt: skip
        labels = labels_of(table.agents)
    collect.finish()
    index = {label: i for i, label in enumerate(labels)}
    for name, arcs in table.modes.items():
        with collect:
            modes[name] = _mode(arcs, index=index, arrow=table.arrow, key=f"network.modes.{name}", folder=folder)
    if table.modes and not modes:
        collect.finish()
    with collect:
        network = Network(labels=labels, modes=modes)
    collect.finish()
    return network


def _mode(value: Any, *, index: Mapping[str, int], arrow: str, key: str, folder: Path | None) -> Arcs:
    if isinstance(value, dict):
        if list(value) != ["file"] or not isinstance(value["file"], str) or isinstance(value["file"], NumberText):
            raise SpecError(
                f'{key} must be a list of arcs or {{ file = "arcs.csv" }}; got {shown(value)}.', key=key,
                cure="Give the key file, and nothing else.",
            )  # fmt: skip
        return read_arcs_file(value["file"], folder=folder, index=index, arrow=arrow, key=f"{key}.file")
    if not is_list(value):
        raise SpecError(
            f'{key} must be a list of arcs or {{ file = "arcs.csv" }}; got {shown(value)}.', key=key,
            cure="Write [[1, 2], [2, 3]].",
        )  # fmt: skip
    return arcs_from_pairs(value, index=index, arrow=arrow, key=key)


def _exceptions(tables: ProblemFile, network: Network, *, dimension: int) -> dict[tuple[int, int], Coupling]:
    index = network.index
    result: dict[tuple[int, int], Coupling] = {}
    collect = _Collector()
    for position, table in enumerate(tables.coupling.exceptions):
        key = f"coupling.exceptions[{position}]"
        pairs: list[tuple[int, int]] = []
        with collect:
            pairs = _exception_arcs(table.arcs, key=f"{key}.arcs", network=network, index=index, arrow=tables.network.arrow)
            for place, pair in enumerate(pairs):
                if pair in result or pair in pairs[:place]:
                    raise SpecError(
                        f"{key}.arcs[{place}]: this arc has an exception already.", key=f"{key}.arcs[{place}]",
                        cure="Keep one of them.",
                    )  # fmt: skip
        with collect:
            coupling = make_coupling(table.h, dimension=dimension, key=f"{key}.h")
            result |= dict.fromkeys(pairs, coupling)
    collect.finish()
    return result


def _exception_arcs(
    value: Any, *, key: str, network: Network, index: Mapping[str, int], arrow: str
) -> list[tuple[int, int]]:
    if not is_list(value) or not value:
        raise SpecError(f"{key} must be a list of arcs; got {shown(value)}.", key=key, cure="Write [[1, 2]].")
    for place, arc in enumerate(value):
        if is_list(arc) and len(arc) == 3:
            raise SpecError(
                f"{key}[{place}] must be [a, b]; the weight stands with the arc in its mode.", key=f"{key}[{place}]",
                cure="Drop the third entry.",
            )  # fmt: skip
    arcs = arcs_from_pairs(value, index=index, arrow=arrow, key=key)
    pairs = list(zip(arcs.listeners.tolist(), arcs.speakers.tolist(), strict=True))
    known = {code for mode in network.modes.values() for code in (mode.listeners * network.size + mode.speakers).tolist()}
    for place, (listener, speaker) in enumerate(pairs):
        if listener * network.size + speaker not in known:
            raise SpecError(
                f"{key}[{place}]: no mode has the arc {list(value[place])}.", key=f"{key}[{place}]",
                cure="Correct the arc, or remove the exception.",
            )  # fmt: skip
    return pairs
