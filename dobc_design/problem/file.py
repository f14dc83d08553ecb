"""Problem files: TOML in, a Problem out; every mistake named by its key, all at once where possible.

Nothing from the file is ever executed.  Numbers are read from their text.  Sizes are bounded before
anything is parsed; see ``toml_text`` and, for arcs, ``arcs_file``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError

from dobc_design.coupling.coupling import Coupling, make_coupling
from dobc_design.errors import SpecError
from dobc_design.exact.reading import MOST_ERRORS, is_list, is_text, named, shown
from dobc_design.problem import arcs_file
from dobc_design.problem.arcs import Arcs, arcs_from_pairs, check_arrow
from dobc_design.problem.canonical import problem_from_canonical
from dobc_design.problem.exosystem_tables import read_exosystem
from dobc_design.problem.file_errors import explain
from dobc_design.problem.labels import labels_of
from dobc_design.problem.network import Network
from dobc_design.problem.observer import Observer
from dobc_design.problem.problem import Problem, dimension_of, is_name
from dobc_design.problem.schema import SCHEMA_VERSION, ProblemFile
from dobc_design.problem.switching import Switching
from dobc_design.problem.toml_text import parse_toml, read_bytes

T = TypeVar("T")


def read_problem_file(path: Path) -> Problem:
    """Read a problem from a TOML file, or from a canonical problem.json.

    Raises: SpecError naming the key and the cure.
    """
    if path.suffix.lower() == ".json":  # it holds the arcs, too
        return problem_from_canonical(read_bytes(path, limit=arcs_file.MAX_BYTES))
    return read_problem_text(read_bytes(path), folder=path.resolve().parent, default_name=path.stem)


def read_problem_text(data: bytes, *, folder: Path | None, default_name: str = "problem") -> Problem:
    """Read a problem from the bytes of a TOML file; ``folder`` is where ``file = `` may look."""
    return read_problem_tables(parse_toml(data), folder=folder, default_name=default_name)


def read_problem_tables(document: Mapping[str, Any], *, folder: Path | None, default_name: str) -> Problem:
    """Read a problem from the tables of a TOML file, as ``parse_toml`` gives them."""
    _check_version(document)
    try:
        tables = ProblemFile.model_validate(document)
    except ValidationError as error:
        raise explain(error) from None
    return _build(tables, folder=folder, default_name=default_name if is_name(default_name) else "problem")


def _check_version(document: Mapping[str, Any]) -> None:
    version = document.get("schema", SCHEMA_VERSION)
    if isinstance(version, bool) or not isinstance(version, int) or version < 1:
        raise SpecError(
            f"schema must be the whole number {SCHEMA_VERSION}; got {shown(version)}.",
            key="schema",
            cure=f"Write schema = {SCHEMA_VERSION}.",
        )
    if version > SCHEMA_VERSION:
        raise SpecError(
            f"schema must be at most {SCHEMA_VERSION}, the newest this program knows; got {shown(version)}.",
            key="schema",
            cure="Update dobc_design.",
        )


class _Collector:
    """Runs the parts of a file one after another and keeps their errors."""

    def __init__(self) -> None:
        self.errors: list[SpecError] = []

    def read(self, part: Callable[[], T]) -> T | None:
        """What ``part`` returns, or None when it raises a SpecError, which is kept."""
        try:
            return part()
        except SpecError as error:
            self.errors.extend(error.errors)
            return None

    def error(self) -> SpecError:
        """All that was kept, as one error."""
        return SpecError.several(self.errors)


def _build(tables: ProblemFile, *, folder: Path | None, default_name: str) -> Problem:
    collect = _Collector()
    network = collect.read(lambda: _network(tables, folder=folder))
    given = collect.read(
        lambda: read_exosystem(tables, dimension_of=lambda found: dimension_of(found, tables.target, tables.coupling.h))
    )
    observer = collect.read(lambda: _observer(tables))
    switching = collect.read(lambda: _switching(tables))
    if given is None:
        raise collect.error()
    exosystem, groups = given
    first = exosystem if exosystem is not None or not groups else groups[0].exosystem
    dimension = collect.read(lambda: dimension_of(first, tables.target, tables.coupling.h))
    if network is None or dimension is None:
        raise collect.error()
    exceptions = collect.read(lambda: _exceptions(tables, network, dimension=dimension))
    problem = collect.read(
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
            region=None if tables.region is None else tables.region.model_dump(),
            switching=switching,
            notes=tables.notes,
            simulation=None if tables.simulation is None else tables.simulation.model_dump(),
        )
    )
    if problem is None or collect.errors:
        raise collect.error()
    return problem


def _observer(tables: ProblemFile) -> Observer | None:
    table = tables.observer
    return None if table is None else Observer(W=table.W, P=table.P, rate=table.rate)


def _switching(tables: ProblemFile) -> Switching | None:
    table = tables.switching
    return None if table is None else Switching(**table.model_dump())


def _network(tables: ProblemFile, *, folder: Path | None) -> Network:
    table = tables.network
    collect = _Collector()
    collect.read(lambda: check_arrow(table.arrow))
    labels = collect.read(lambda: labels_of(table.agents))
    if labels is None or collect.errors:
        raise collect.error()
    index = {label: i for i, label in enumerate(labels)}
    modes: dict[str, Arcs] = {}
    for name, value in table.modes.items():
        key = f"network.modes.{named(name)}"
        try:
            modes[name] = _mode(value, index=index, arrow=table.arrow, key=key, folder=folder)
        except SpecError as error:
            collect.errors.extend(error.errors)
        if len(collect.errors) >= MOST_ERRORS:
            break
    # With what can be read, so that further mistakes show at once.
    network = collect.read(lambda: Network(labels=labels, modes=modes)) if modes or not collect.errors else None
    if network is None or collect.errors:
        raise collect.error()
    return network


def _mode(value: Any, *, index: Mapping[str, int], arrow: str, key: str, folder: Path | None) -> Arcs:
    if is_list(value):
        return arcs_from_pairs(value, index=index, arrow=arrow, key=key)
    if not isinstance(value, dict) or list(value) != ["file"] or not is_text(value["file"]):
        raise SpecError(
            f'{key} must be a list of arcs or {{ file = "arcs.csv" }}; got {shown(value)}.',
            key=key,
            cure="For example [[1, 2], [2, 3]].",
        )
    return arcs_file.read_arcs_file(value["file"], folder=folder, index=index, arrow=arrow, key=f"{key}.file")


def _exceptions(tables: ProblemFile, network: Network, *, dimension: int) -> dict[tuple[int, int], Coupling]:
    given = tables.coupling.exceptions
    codes = network.arc_codes() if given else set()
    result: dict[tuple[int, int], Coupling] = {}
    errors: list[SpecError] = []
    for position, table in enumerate(given):
        key = f"coupling.exceptions[{position}]"
        pairs: list[tuple[int, int]] = []
        try:
            pairs = _exception_arcs(table.arcs, key=f"{key}.arcs", network=network, arrow=tables.network.arrow)
            _check_exceptions(pairs, codes, taken=result, labels=network.labels, key=f"{key}.arcs")
        except SpecError as error:
            errors.extend(error.errors)
        try:
            coupling = make_coupling(table.h, dimension=dimension, key=f"{key}.h")
            result |= dict.fromkeys(pairs, coupling)
        except SpecError as error:
            errors.extend(error.errors)
        if len(errors) >= MOST_ERRORS:
            break
    if errors:
        raise SpecError.several(errors)
    return result


def _exception_arcs(value: Any, *, key: str, network: Network, arrow: str) -> list[tuple[int, int]]:
    if not is_list(value) or not value:
        raise SpecError(
            f"{key} must be a list of arcs; got {shown(value)}.", key=key, cure="For example [[1, 2], [2, 3]]."
        )
    for place, arc in enumerate(value):
        if is_list(arc) and len(arc) == 3:
            raise SpecError(
                f"{key}[{place}] must be [a, b]; the weight stands with the arc in its mode.",
                key=f"{key}[{place}]",
                cure="Drop the third entry.",
            )
    arcs = arcs_from_pairs(value, index=network.index, arrow=arrow, key=key)
    return list(zip(arcs.listeners.tolist(), arcs.speakers.tolist(), strict=True))


def _check_exceptions(
    pairs: list[tuple[int, int]],
    codes: set[int],
    *,
    taken: Mapping[tuple[int, int], Coupling],
    labels: tuple[str, ...],
    key: str,
) -> None:
    """Refuse arcs that no mode has, and arcs that have an exception already."""
    seen: set[tuple[int, int]] = set()
    for place, (listener, speaker) in enumerate(pairs):
        names = f"{named(labels[listener])} listens to {named(labels[speaker])}"
        if listener * len(labels) + speaker not in codes:
            turned = speaker * len(labels) + listener in codes
            raise SpecError(
                f"{key}[{place}]: no mode has the arc in which {names}"
                + ("; it is there the other way round." if turned else "."),
                key=f"{key}[{place}]",
                cure="Correct the arc, or remove the exception.",
            )
        if (listener, speaker) in taken or (listener, speaker) in seen:
            raise SpecError(
                f"{key}[{place}]: the arc in which {names} has an exception already.",
                key=f"{key}[{place}]",
                cure="Keep one of them.",
            )
        seen.add((listener, speaker))
