"""A power grid as a consensus problem: voltage angles, coupled by the sines of their differences.

    theta_i' = sum_j (1/D) b_ij sin(theta_j - theta_i) + u_i + d_i,        b_ij = 1 / (x_ij tap_ij)

Lossless lines, voltages of 1 p.u., first order (droop-controlled inverters, or machines whose inertia is left out),
flat schedule: all angles agree at the target 0.  The weights b_ij are exact; everything else is said in the notes.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from dobc_design.errors import SpecError, wrong
from dobc_design.exact.number import parse_number
from dobc_design.exact.reading import named, shown
from dobc_design.problem.exosystems import constant
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem

NOTES = (
    "Imported from {source}: {buses} buses, {branches} branches in service, generators at {generators}.",
    "Model: voltage angles in rad with h = sin(y) and the weights 1/(x tap) in p.u.; voltages are 1 p.u., resistances,"
    " shunts, phase shifts, inertia and the schedule of powers are left out, and the droop 1/D is 1 rad/s per p.u.",
    "Stand-ins: every generator bus is pinned with the gain {gain} 1/s, and the disturbance is an unknown constant (a"
    " load that was not scheduled). Choose your own, for example with design_pinning(allowed=...).",
)
SHOWN = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class Branch:
    """A line or transformer: its two buses, its reactance x times the tap ratio in p.u., and its place in the file."""

    ends: tuple[str, str]
    reactance: Fraction
    place: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Grid:
    """What is read of a grid: bus labels, branches in service, buses with a generator in service, where it is from."""

    buses: tuple[str, ...]
    branches: tuple[Branch, ...]
    generators: tuple[str, ...]
    source: str


def grid_problem(grid: Grid, *, name: str, gain: Any = 1) -> Problem:
    """The consensus problem of a grid; generators are pinned with ``gain`` (1/s).  Raises: SpecError."""
    known = set(grid.buses)
    weights: dict[tuple[str, str], Fraction] = {}
    for branch in grid.branches:
        a, b = branch.ends
        for end in branch.ends:
            if end not in known:
                what = f"{branch.place} names bus {named(end)}, which is not there."
                raise SpecError(what, key=branch.place, cure="Add the bus, or take the branch out of service.")
        if a == b:
            raise SpecError(f"{branch.place} leads from bus {named(a)} to itself.", key=branch.place)
    becomes = merged(grid.buses, [branch.ends for branch in grid.branches if not branch.reactance])
    for branch in grid.branches:
        a, b = (becomes[end] for end in branch.ends)
        if a != b:
            ends = (a, b) if (b, a) not in weights else (b, a)
            weights[ends] = weights.get(ends, Fraction(0)) + 1 / branch.reactance
    weights = {ends: w for ends, w in weights.items() if w}
    if not weights:
        raise SpecError(f"{grid.source} has no branch in service.", key="branch", cure="A grid needs lines.")
    arcs = [arc for (a, b), w in weights.items() for arc in ([a, b, abs(w)], [b, a, abs(w)])]
    buses = list(dict.fromkeys(becomes.values()))
    repelling = [ends for ends, w in weights.items() if w < 0]
    place = {bus: i for i, bus in enumerate(buses)}
    pairs = [(place[a], place[b]) for a, b in repelling]
    notes = list(NOTES)
    if len(buses) < len(grid.buses):
        joined = _listed([f"{a} into {b}" for a, b in becomes.items() if a != b])
        notes.append(f"Buses joined by branches of reactance 0 are one agent: {joined}.")
    if repelling:
        between = _listed([f"{a} and {b}" for a, b in repelling])
        notes.append(f"The reactance between buses {between} is negative: these push each other apart, h = -sin(y).")
    generators = tuple(dict.fromkeys(becomes[bus] for bus in grid.generators if bus in known))
    facts = {"source": grid.source, "buses": len(grid.buses), "branches": len(grid.branches), "gain": gain}
    at = f"bus {_listed(generators)}" if generators else "no bus"
    return Problem(
        name=name,
        network=Network.from_arcs({"grid": arcs}, arrow="listens_to", agents=buses),
        coupling="sin(y)",
        exceptions=dict.fromkeys(pairs + [pair[::-1] for pair in pairs], "-sin(y)"),
        target=0,
        gains=dict.fromkeys(generators, gain),
        exosystem=constant(),
        notes=[note.format(**facts, generators=at) for note in notes],
    )


def _listed(items: Sequence[str]) -> str:
    return ", ".join(items[:SHOWN]) + (f" and {len(items) - SHOWN} more" if len(items) > SHOWN else "")


def merged(labels: Sequence[str], pairs: Sequence[tuple[str, str]]) -> dict[str, str]:
    """Label -> the label it becomes when these pairs are joined (closed bus couplers): the first of its group."""
    place = {label: i for i, label in enumerate(labels)}
    ends = [[place[pair[end]] for pair in pairs] for end in (0, 1)]
    graph = coo_array((np.ones(len(pairs)), tuple(ends)), shape=(len(labels),) * 2)
    first: dict[int, str] = {}
    groups = connected_components(graph, directed=False)[1].tolist() if labels else []
    return {label: first.setdefault(group, label) for label, group in zip(labels, groups, strict=True)}


CURE = "Write the case with MATPOWER's savecase."
ISOLATED = 4  # bus type
COLUMNS = {"bus": 2, "gen": 8, "branch": 11}  # that have to be there
_TABLE = re.compile(r"(?<![\w.])mpc\.(bus|gen|branch)[ \t]*=[ \t]*\[")
_COMMENT = re.compile(r"%[^\n]*")
_CONTINUED = re.compile(r"\.\.\.[^\n]*(?:\n|\Z)")  # the end, too: else every dot looks for it again
_CELL = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*(?:[eE][+-]?[0-9]+)?|\.[0-9]+(?:[eE][+-]?[0-9]+)?|[iI]nf|[nN]a[nN])")
_BUS = re.compile(r"[0-9]{1,18}(\.0*)?")


def read_matpower(text: str, *, name: str) -> Grid:
    """Read a case file; its ``name`` is for messages.  Raises: SpecError that names table, row and column."""
    plain = _CONTINUED.sub(" ", _COMMENT.sub("", text))
    tables = {table: _rows(body, table, name) for table, body in _tables(plain)}
    for table in ("bus", "branch"):
        if table not in tables:
            what = f"{name} must hold the table mpc.{table} of a MATPOWER case, in numbers; it is not there."
            raise SpecError(what, key=f"mpc.{table}", cure=CURE)
    kinds = {_bus(row[0], "bus", i): _number(row[1], f"mpc.bus({i},2)") for i, row in enumerate(tables["bus"], 1)}
    isolated = {bus for bus, kind in kinds.items() if kind == ISOLATED}
    gens = enumerate(tables.get("gen", []), 1)
    generators = [_bus(row[0], "gen", i) for i, row in gens if _number(row[7], f"mpc.gen({i},8)") > 0]
    branches = []
    for i, row in enumerate(tables["branch"], 1):
        if _number(row[10], f"mpc.branch({i},11)") == 0:
            continue
        tap = _number(row[8], f"mpc.branch({i},9)")
        ends = _bus(row[0], "branch", i), _bus(row[1], "branch", i)
        if not isolated & set(ends):
            reactance = _number(row[3], f"mpc.branch({i},4)") * (tap or 1)
            branches.append(Branch(ends=ends, reactance=reactance, place=f"mpc.branch row {i}"))
    return Grid(
        buses=tuple(bus for bus in kinds if bus not in isolated),
        branches=tuple(branches),
        generators=tuple(generators),
        source=f"the MATPOWER case {name}",
    )


def _tables(text: str) -> Iterator[tuple[str, str]]:
    """Name and body of every table, from its bracket to the next closing one; each character is passed once."""
    begin = _TABLE.search(text)
    while begin is not None:
        end = text.find("]", begin.end())
        if end < 0:
            return
        yield begin[1], text[begin.end() : end]
        begin = _TABLE.search(text, end)


def _rows(body: str, table: str, name: str) -> list[list[str]]:
    rows = [row.replace(",", " ").split() for line in body.split("\n") for row in line.split(";")]
    rows = [row for row in rows if row]
    for i, row in enumerate(rows, 1):
        if len(row) < COLUMNS[table]:
            what = f"{name}: mpc.{table} must have at least {COLUMNS[table]} columns; row {i} has {len(row)}."
            raise SpecError(what, key=f"mpc.{table}", cure=CURE)
        for j, cell in enumerate(row, 1):
            if not _CELL.fullmatch(cell):
                what = (
                    f"{name}: mpc.{table}({i},{j}) must be a number, because nothing in a case is computed;"
                    f" got {shown(cell)}."
                )
                raise SpecError(what, key=f"mpc.{table}({i},{j})", cure=CURE)
    return rows


def _bus(text: str, table: str, row: int) -> str:
    if not _BUS.fullmatch(text):
        what = f"row {row}: a bus must be a whole number; got {shown(text)}."
        raise wrong(f"mpc.{table}", what, CURE)
    return str(int(text.partition(".")[0]))


def _number(text: str, key: str) -> Fraction:
    """An entry as the decimal text it is; MATLAB writes .5 and 5. too."""
    trimmed = re.sub(r"(?<![0-9])\.(?=[0-9])", "0.", text)
    return parse_number(re.sub(r"(?<=[0-9])\.(?![0-9])", "", trimmed), key=key)


Row = Mapping[str, Any]
Tables = Mapping[str, list[Row]]
BRANCHES = (("line", "from_bus", "to_bus"), ("trafo", "hv_bus", "lv_bus"), ("impedance", "from_bus", "to_bus"))
TABLES = ("bus", "line", "trafo", "trafo3w", "impedance", "switch", "gen", "ext_grid")


def from_pandapower(net: Any, *, name: str | None = None, gain: Any = 1) -> Problem:
    """The consensus problem of a pandapower network: angles coupled by sines, generators pinned with ``gain`` (1/s).

    ``name`` of the problem, by default that of the network.  Returns: a Problem whose notes say what was left out.
    Raises: SpecError for what is no such network, and for what cannot be a positive susceptance.
    """
    if not all(hasattr(net, table) for table in ("bus", "line", "ext_grid")):
        what = f"must be a pandapower network; got {type(net).__name__}."
        raise wrong("net", what, "Such as pandapower.networks.case14().")
    tables = {table: _records(getattr(net, table, None)) for table in TABLES}
    title = name or str(getattr(net, "name", "") or "pandapower-grid")
    return grid_problem(_checked(tables, base=net.sn_mva, source="a pandapower network"), name=title, gain=gain)


def read_pandapower(data: bytes, *, name: str) -> Grid:
    """Read the JSON of pandapower.to_json.  Raises: SpecError."""
    try:
        document = json.loads(data)
        inside = document["_object"]
        tables = {table: _json_records(inside[table]) for table in TABLES if table in inside}
        base = inside.get("sn_mva", 1.0)
    except (ValueError, TypeError, KeyError, LookupError, RecursionError, AttributeError):
        what = "must be a network written by pandapower.to_json; its tables cannot be read."
        raise wrong(name, what, "Write it with pandapower.to_json(net, file).") from None
    rows = {table: tables.get(table, []) for table in TABLES}
    return _checked(rows, base=base, source=f"the pandapower network {name}")


def is_pandapower(data: bytes) -> bool:
    """Whether JSON looks like that of pandapower.to_json."""
    return b'"_module"' in data[:4096] and b"pandapower" in data[:4096]


def _records(table: Any) -> list[Row]:
    if table is None:
        return []
    return [{"index": index, **row} for index, row in zip(table.index, table.to_dict("records"), strict=True)]


def _json_records(table: Any) -> list[Row]:
    frame = table["_object"]
    frame = json.loads(frame) if isinstance(frame, str) else frame
    return [
        {"index": index, **dict(zip(frame["columns"], row, strict=True))}
        for index, row in zip(frame["index"], frame["data"], strict=True)
    ]


def _checked(tables: Tables, *, base: Any, source: str) -> Grid:
    """The grid of the tables.  Raises: SpecError, also for a column that is missing or holds something else."""
    try:
        return _grid(tables, base=float(base), source=source)
    except SpecError:
        raise
    except (KeyError, TypeError, ValueError, ArithmeticError, AttributeError) as error:
        what = f"{source} has a table with a column that is missing or holds no number ({str(error)[:60]})."
        raise SpecError(what, key="pandapower", cure="Write it anew with a current version of pandapower.") from None


def _grid(tables: Tables, *, base: float, source: str) -> Grid:
    if any(_on(row) for row in tables["trafo3w"]):
        what = "three-winding transformers cannot be imported: their star point may have a negative reactance."
        raise SpecError(what, key="trafo3w", cure="Replace them by two-winding transformers.")
    buses = [str(row["index"]) for row in tables["bus"] if _on(row)]
    closed = [row for row in tables["switch"] if row.get("et") == "b" and row.get("closed")]
    joined = [(str(row["bus"]), str(row["element"])) for row in closed]
    becomes = merged(buses, [pair for pair in joined if set(pair) <= set(buses)])
    opened = {(row.get("et"), row["element"]) for row in tables["switch"] if not row.get("closed")}
    found = (
        (becomes.get(a, a), becomes.get(b, b), x, at) for a, b, x, at in _branches(tables, base=base, opened=opened)
    )
    generators = (str(row["bus"]) for table in ("ext_grid", "gen") for row in tables[table] if _on(row))
    return Grid(
        buses=tuple(dict.fromkeys(becomes.values())),
        branches=tuple(Branch(ends=(a, b), reactance=x, place=place) for a, b, x, place in found if a != b),
        generators=tuple(becomes.get(bus, bus) for bus in generators),
        source=source,
    )


def _branches(tables: Tables, *, base: float, opened: set[tuple[Any, Any]]) -> Iterator[tuple[str, str, Fraction, str]]:
    """Ends, reactance in p.u. on ``base`` MVA and place of what is in service."""
    voltage = {row["index"]: float(row["vn_kv"]) for row in tables["bus"]}
    on = {row["index"] for row in tables["bus"] if _on(row)}
    for table, first, second in BRANCHES:
        for row in tables[table]:
            ends, place = (row[first], row[second]), f"{table} {row['index']}"
            if not _on(row) or (table[0], row["index"]) in opened or not on >= set(ends):
                continue
            if table == "line":
                ohm = float(row["x_ohm_per_km"]) * float(row["length_km"]) / float(row.get("parallel") or 1)
                x = ohm * base / voltage[row["from_bus"]] ** 2
            elif table == "trafo":
                part = base / float(row["sn_mva"]) / float(row.get("parallel") or 1) / 100
                z, r = float(row["vk_percent"]) * part, float(row["vkr_percent"]) * part
                x = math.sqrt(max(0.0, z * z - r * r)) * _tap(row)
            else:
                x = float(row["xft_pu"]) * base / float(row["sn_mva"])
            # Twelve digits: x was computed in floats, and 0.05917 should not read 0.059170000000000006.
            yield str(ends[0]), str(ends[1]), parse_number(f"{x:.12g}", key=f"the reactance of {place}"), place


def _tap(row: Row) -> float:
    """The tap ratio of a transformer, 1 where there is no tap changer."""
    position, neutral, step = (row.get(key) for key in ("tap_pos", "tap_neutral", "tap_step_percent"))
    if any(value is None or value != value for value in (position, neutral, step)):  # nan: no tap changer
        return 1.0
    ratio = 1 + (float(position or 0) - float(neutral or 0)) * float(step or 0) / 100
    return ratio if row.get("tap_side") in (None, "hv") else 1 / ratio


def _on(row: Row) -> bool:
    return bool(row.get("in_service", True))
