"""pandapower networks: an object in memory, or the file that pandapower.to_json writes.

The file is read as plain JSON: pandapower's own reader imports whatever classes a file names, and this one none.
The object is taken by its tables, without importing pandapower.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from fractions import Fraction
from typing import Any

from dobc_design.errors import SpecError
from dobc_design.exact.number import parse_number
from dobc_design.importing.grids import Branch, Grid, grid_problem, merged
from dobc_design.problem.problem import Problem

Row = Mapping[str, Any]
Tables = Mapping[str, list[Row]]
TABLES = ("bus", "line", "trafo", "trafo3w", "impedance", "switch", "gen", "ext_grid")


def from_pandapower(net: Any, *, name: str | None = None, gain: Any = 1) -> Problem:
    """The consensus problem of a pandapower network: see ``grids``.  Generators and external grids are pinned.

    Raises: SpecError for what is no such network, and for what cannot be a positive susceptance.
    """
    if not all(hasattr(net, table) for table in ("bus", "line", "ext_grid")):
        raise SpecError(
            f"net must be a pandapower network; got {type(net).__name__}.",
            key="net",
            cure="Such as pandapower.networks.case14().",
        )
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
        raise SpecError(
            f"{name} must be a network written by pandapower.to_json; its tables cannot be read.",
            key=name,
            cure="Write it with pandapower.to_json(net, file).",
        ) from None
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
        raise SpecError(
            f"{source} has a table with a column that is missing or holds no number ({str(error)[:60]}).",
            key="pandapower",
            cure="Write it anew with a current version of pandapower.",
        ) from None


def _grid(tables: Tables, *, base: float, source: str) -> Grid:
    if any(_on(row) for row in tables["trafo3w"]):
        raise SpecError(
            "three-winding transformers cannot be imported: their star point may have a negative reactance.",
            key="trafo3w",
            cure="Replace them by two-winding transformers.",
        )
    buses = [str(row["index"]) for row in tables["bus"] if _on(row)]
    joined = [
        (str(row["bus"]), str(row["element"])) for row in tables["switch"] if row.get("et") == "b" and row.get("closed")
    ]
    becomes = merged(buses, [pair for pair in joined if set(pair) <= set(buses)])
    opened = {(row.get("et"), row["element"]) for row in tables["switch"] if not row.get("closed")}
    branches = [
        Branch(ends=(becomes.get(a, a), becomes.get(b, b)), reactance=x, place=place)
        for a, b, x, place in _branches(tables, base=base, opened=opened)
    ]
    generators = [str(row["bus"]) for table in ("ext_grid", "gen") for row in tables[table] if _on(row)]
    kept = tuple(dict.fromkeys(becomes.values()))
    return Grid(
        buses=kept,
        branches=tuple(each for each in branches if each.ends[0] != each.ends[1]),
        generators=tuple(becomes.get(bus, bus) for bus in generators),
        source=source,
    )


def _branches(tables: Tables, *, base: float, opened: set[tuple[Any, Any]]) -> Iterator[tuple[str, str, Fraction, str]]:
    """Ends, reactance in p.u. on ``base`` MVA and place of what is in service."""
    voltage = {row["index"]: float(row["vn_kv"]) for row in tables["bus"]}
    on = {row["index"] for row in tables["bus"] if _on(row)}
    for row in tables["line"]:
        ends = (row["from_bus"], row["to_bus"])
        if _on(row) and ("l", row["index"]) not in opened and on >= set(ends):
            ohm = float(row["x_ohm_per_km"]) * float(row["length_km"]) / float(row.get("parallel") or 1)
            x = ohm * base / voltage[row["from_bus"]] ** 2
            yield *map(str, ends), _exact(x, f"line {row['index']}"), f"line {row['index']}"  # type: ignore[misc]
    for row in tables["trafo"]:
        ends = (row["hv_bus"], row["lv_bus"])
        if _on(row) and ("t", row["index"]) not in opened and on >= set(ends):
            part = base / float(row["sn_mva"]) / float(row.get("parallel") or 1) / 100
            z, r = float(row["vk_percent"]) * part, float(row["vkr_percent"]) * part
            x = math.sqrt(max(0.0, z * z - r * r)) * _tap(row)
            yield *map(str, ends), _exact(x, f"trafo {row['index']}"), f"trafo {row['index']}"  # type: ignore[misc]
    for row in tables["impedance"]:
        ends = (row["from_bus"], row["to_bus"])
        if _on(row) and on >= set(ends):
            x = float(row["xft_pu"]) * base / float(row["sn_mva"])
            yield *map(str, ends), _exact(x, f"impedance {row['index']}"), f"impedance {row['index']}"  # type: ignore[misc]


def _tap(row: Row) -> float:
    """The tap ratio of a transformer, 1 where there is no tap changer."""
    position, neutral, step = (row.get(key) for key in ("tap_pos", "tap_neutral", "tap_step_percent"))
    if any(value is None or value != value for value in (position, neutral, step)):  # nan: no tap changer
        return 1.0
    ratio = 1 + (float(position or 0) - float(neutral or 0)) * float(step or 0) / 100
    return ratio if row.get("tap_side") in (None, "hv") else 1 / ratio


def _exact(value: float, key: str) -> Fraction:
    """Twelve digits: the reactance was computed in floats, and 0.05917 should not read 0.059170000000000006."""
    return parse_number(f"{value:.12g}", key=f"the reactance of {key}")


def _on(row: Row) -> bool:
    return bool(row.get("in_service", True))
