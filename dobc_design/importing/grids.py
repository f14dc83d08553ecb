"""A power grid as a consensus problem: voltage angles, coupled by the sines of their differences.

    theta_i' = sum_j (1/D) b_ij sin(theta_j - theta_i) + u_i + d_i,        b_ij = 1 / (x_ij tap_ij)

Lossless lines, voltages of 1 p.u., first order (droop-controlled inverters, or machines whose
inertia is left out), flat schedule: all angles agree at the target 0.  The weights b_ij are exact;
everything else is said in the notes.
"""

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from typing import Any

from scipy.cluster.hierarchy import DisjointSet

from dobc_design._checks import noun
from dobc_design.errors import SpecError, refused, wrong
from dobc_design.exact.number import parse_number
from dobc_design.exact.reading import Names, Table, Texts, named, shown, some
from dobc_design.problem.exosystems import constant
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem

NOTES = (
    "Imported from {source}: {buses} buses, {branches} branches in service, generators at "
    "{generators}.",
    "Model: voltage angles in rad with h = sin(y) and the weights 1/(x tap) in p.u.; "
    "voltages are 1 p.u., resistances,"
    " shunts, phase shifts, inertia and the schedule of powers are left out, and the droop "
    "1/D is 1 rad/s per p.u.",
    "Stand-ins: every generator bus is pinned with the gain {gain} 1/s, and the "
    "disturbance is an unknown constant (a"
    " load that was not scheduled). Choose your own, for example with design_pinning(allowed=...).",
)
SHOWN = 8
Ends = tuple[str, str]  # the buses of a branch


@noun
class Branch:
    """A line or transformer: its two buses, its reactance x times the tap ratio in p.u., and its
    place in the file."""

    ends: Ends
    reactance: Fraction
    place: str


@noun
class Grid:
    """What is read of a grid: bus labels, branches in service, buses with a generator in service,
    where it is from."""

    buses: Texts
    branches: tuple[Branch, ...]
    generators: Texts
    source: str


def grid_problem(grid: Grid, *, name: str, gain: Any = 1) -> Problem:
    """The consensus problem of a grid; generators are pinned with ``gain`` (1/s).  Raises:
    SpecError."""
    _check_ends(grid)
    becomes = merged(grid.buses, [branch.ends for branch in grid.branches if not branch.reactance])
    weights = _weights(grid, becomes)
    if not weights:
        raise refused("branch", f"{grid.source} has no branch in service.", "A grid needs lines.")
    arcs = []
    for (a, b), weight in weights.items():
        arcs += [[a, b, abs(weight)], [b, a, abs(weight)]]
    buses = list(dict.fromkeys(becomes.values()))
    # Series capacitors have negative reactances.
    repelling = [ends for ends, weight in weights.items() if weight < 0]
    place = {bus: i for i, bus in enumerate(buses)}
    pairs = [(place[a], place[b]) for a, b in repelling]
    known = set(grid.buses)
    generators = tuple(dict.fromkeys(becomes[bus] for bus in grid.generators if bus in known))
    notes = [_filled(note, grid, generators, gain) for note in NOTES]
    if len(buses) < len(grid.buses):
        joined = some([f"{a} into {b}" for a, b in becomes.items() if a != b], SHOWN)
        notes.append(
            f"Buses joined by couplers, or by branches of reactance 0, are one agent: {joined}."
        )
    if repelling:
        between = some([f"{a} and {b}" for a, b in repelling], SHOWN)
        note = f"The reactance between buses {between} is negative: these push each other apart"
        notes.append(f"{note}, h = -sin(y).")
    return Problem(
        name=name,
        network=Network.from_arcs({"grid": arcs}, arrow="listens_to", agents=buses),
        coupling="sin(y)",
        exceptions=dict.fromkeys(pairs + [pair[::-1] for pair in pairs], "-sin(y)"),
        target=0,
        gains=dict.fromkeys(generators, gain),
        exosystem=constant(),
        notes=notes,
    )


def _check_ends(grid: Grid) -> None:
    """Raise SpecError for a branch of a bus that is not there, or from a bus to itself."""
    known = set(grid.buses)
    for branch in grid.branches:
        a, b = branch.ends
        for end in branch.ends:
            if end not in known:
                raise refused(
                    branch.place,
                    f"{branch.place} names bus {named(end)}, which is not there.",
                    "Add the bus, or take the branch out of service.",
                )
        if a == b:
            raise refused(branch.place, f"{branch.place} leads from bus {named(a)} to itself.")


def _weights(grid: Grid, becomes: Mapping[str, str]) -> dict[Ends, Fraction]:
    """The susceptance between two agents, of all their branches together; none is 0."""
    weights: dict[Ends, Fraction] = {}
    # Parallel branches add up, whichever way they are listed.
    for branch in grid.branches:
        a, b = (becomes[end] for end in branch.ends)
        if a != b:
            ends = (b, a) if (b, a) in weights else (a, b)
            weights[ends] = weights.get(ends, Fraction(0)) + 1 / branch.reactance
    return {ends: weight for ends, weight in weights.items() if weight}


def _filled(note: str, grid: Grid, generators: Names, gain: Any) -> str:
    return note.format(
        source=grid.source,
        buses=len(grid.buses),
        branches=len(grid.branches),
        gain=gain,
        generators=f"bus {some(generators, SHOWN)}" if generators else "no bus",
    )


def merged(labels: Names, pairs: Sequence[Ends]) -> dict[str, str]:
    """Label -> the label it becomes when these pairs are joined (closed bus couplers): the first of
    its group."""
    groups = DisjointSet(labels)
    for a, b in pairs:
        groups.merge(a, b)
    first: dict[str, str] = {}  # by the label that stands for the group
    return {label: first.setdefault(groups[label], label) for label in labels}


CURE = "Let MATPOWER compute it: savecase('plain.m', loadcase('case.m')), and import plain.m."
COMPUTED = " nothing in a case is computed"
ISOLATED = 4  # bus type
USED = {"bus": (1, 2), "gen": (1, 8), "branch": (1, 2, 4, 9, 11)}  # columns
_TABLE = re.compile(r"(?<![\w.])mpc\.(bus|gen|branch)[ \t]*=[ \t]*\[")
_COMMENT = re.compile(
    r"^[ \t]*%\{[ \t\r]*$.*?(?:^[ \t]*%\}[ \t\r]*$|\Z)|%[^\n]*", re.MULTILINE | re.DOTALL
)
_END = re.compile(r"\][ \t\r]*(?:[;,\n\v]|\Z)")
_CONTINUED = re.compile(r"\.\.\.[^\n]*(?:\n|\Z)")  # the end, too: else every dot looks for it again
_NUMBER = (
    r"(?:[0-9]+(?:\.[0-9]*)?(?:[eE][+-]?[0-9]+)?|\.[0-9]+(?:[eE][+-]?[0-9]+)?|[iI]nf|[nN]a[nN])"
)
_CELL = re.compile(f"[+-]?{_NUMBER}")
_UNUSED = re.compile(rf"[+-]?{_NUMBER}(?:[*/](?:{_NUMBER}|sqrt\({_NUMBER}\)))*")
_EQUALS = re.compile(r"(?<![=~<>!])=(?!=)")
_GRID = re.compile(r"(?<![\w.])mpc(?:\.(?:bus|gen|branch)(?!\w)|(?![\w.]))")
_HARMLESS = re.compile(
    r"function|mpc\.(?:bus|gen|branch)=\[|mpc\.(?:bus|gen)\([:\w]*,\[?(?:(?:[PQ][DG]|[PQ]MAX|[PQ]MIN),?)+\]?\)="
)
VOLTS, WATTS = "mpc.bus(1,BASE_KV)*1e3", "mpc.baseMVA*1e6"
FROM_OHM = "mpc.branch(:,[BR_RBR_X])=mpc.branch(:,[BR_RBR_X])/(Vbase^2/Sbase)"


@noun
class _Row:
    """A row of a table of numbers, and where it stands."""

    cells: list[str]
    place: str

    def number(self, column: int) -> Fraction:
        return _decimal(self.cells[column - 1], f"{self.place}, column {column}")

    def bus(self, column: int = 1) -> str:
        number = self.number(column)
        if number.denominator > 1 or number < 0:
            raise wrong(
                self.place,
                f"must name a bus by a whole number; got {self.cells[column - 1]}.",
                CURE,
            )
        return str(number)


def read_matpower(text: str, name: str) -> Grid:
    """Read a case file; its ``name`` is for messages.  Raises: SpecError that names line, table,
    row and column."""
    # Without comments and continued lines, and as many lines as before, for messages.
    uncommented = _COMMENT.sub(lambda found: "\n" * found[0].count("\n"), text)
    plain = _CONTINUED.sub("\v", uncommented)
    tables = dict(_tables(plain, name))
    for table in ("bus", "branch"):
        if table not in tables:
            what = f"{name} must hold the table mpc.{table} of a MATPOWER case, in numbers; it is "
            raise refused(f"mpc.{table}", f"{what}not there.", CURE)
    unit = _unit(plain, tables["bus"], name)
    kinds = {row.bus(): row.number(2) for row in tables["bus"]}
    isolated = {bus for bus, kind in kinds.items() if kind == ISOLATED}
    branches = []
    for row in tables["branch"]:
        ends = row.bus(1), row.bus(2)
        # Left out: what is out of service, or at an isolated bus.
        if row.number(11) != 0 and not isolated & set(ends):
            reactance = row.number(4) * unit * (row.number(9) or 1)
            branches.append(Branch(ends=ends, reactance=reactance, place=row.place))
    return Grid(
        buses=tuple(bus for bus in kinds if bus not in isolated),
        branches=tuple(branches),
        generators=tuple(row.bus() for row in tables.get("gen", []) if row.number(8) > 0),
        source=f"the MATPOWER case {name}",
    )


def _tables(text: str, name: str) -> Iterator[tuple[str, list[_Row]]]:
    """Every table, from its bracket to the next closing one; each character is passed once."""
    begin = _TABLE.search(text)
    line, counted = 1, 0
    while begin is not None:
        end = text.find("]", begin.end())
        if end < 0:
            return
        line += _lines(text[counted : begin.end()])
        counted = begin.end()
        rows = _rows(text[counted:end], begin[1], line, name)
        # A bracket that does not end the statement is transposed, or computed with.
        if not _END.match(text, end):
            raise wrong(f"{name}, line {line}: mpc.{begin[1]}", f"must end in ];{COMPUTED}.", CURE)
        yield begin[1], rows
        begin = _TABLE.search(text, end)


def _lines(text: str) -> int:
    return text.count("\n") + text.count("\v")


def _rows(body: str, table: str, line: int, name: str) -> list[_Row]:
    rows: list[_Row] = []
    for text in body.split("\n"):
        place = f"{name}, line {line}: mpc.{table}"
        for part in text.split(";"):
            cells = part.replace(",", " ").split()
            if cells:
                number = len(rows) + 1
                _check_cells(cells, table, place, number)
                rows.append(_Row(cells=cells, place=f"{place} row {number}"))
        line += 1 + text.count("\v")
    return rows


def _check_cells(cells: Names, table: str, place: str, row: int) -> None:
    """Raise SpecError for a row that is too short, or that holds anything but numbers."""
    least = USED[table][-1]
    if len(cells) < least:
        raise refused(
            f"mpc.{table}",
            f"{place} must have at least {least} columns; row {row} has {len(cells)}.",
            CURE,
        )
    for column, cell in enumerate(cells, start=1):
        form = _CELL if column in USED[table] else _UNUSED
        if not form.fullmatch(cell):
            raise wrong(
                f"{place}({row},{column})",
                f"must be a number, because{COMPUTED}; got {shown(cell)}.",
                CURE,
            )


def _unit(text: str, buses: list[_Row], name: str) -> Fraction:
    """The p.u. that a reactance of 1 in the table is: 1, or baseMVA / kV^2 where the case turns
    ohms into p.u. by the statement of the radial cases.  Raises: SpecError for any other change of
    what is read of the tables."""
    unit = Fraction(1)
    said: dict[str, str] = {}  # what was given to each name so far
    line = 1
    for row in text.split("\n"):
        for statement in row.split(";"):
            # Nothing is executed: harmless is what cannot touch the columns that are read.
            left, *right = _EQUALS.split(statement, 1)
            if not right:
                continue
            short = "".join(statement.split())
            if short == FROM_OHM and (said.get("Vbase"), said.get("Sbase")) == (VOLTS, WATTS):
                base = _decimal(said.get("mpc.baseMVA", ""), "mpc.baseMVA")
                unit *= base / buses[0].number(10) ** 2
            elif _GRID.search(left) and not _HARMLESS.match(short):
                raise wrong(f"{name}, line {line}", f"changes the tables, but{COMPUTED}.", CURE)
            said["".join(left.split())] = "".join(right[0].split())
        line += _lines(row) + 1
    return unit


def _decimal(text: str, key: str) -> Fraction:
    """An entry as the decimal text it is; MATLAB writes .5 and 5. too."""
    trimmed = re.sub(r"(?<![0-9])\.(?=[0-9])", "0.", text)
    return parse_number(re.sub(r"(?<=[0-9])\.(?![0-9])", "", trimmed), key)


Tables = Mapping[str, list[Table]]
BRANCHES = (
    ("line", "from_bus", "to_bus"),
    ("trafo", "hv_bus", "lv_bus"),
    ("impedance", "from_bus", "to_bus"),
    ("switch", "bus", "element"),
)
TABLES = ("bus", "line", "trafo", "trafo3w", "impedance", "switch", "gen", "ext_grid")


def from_pandapower(net: Any, *, name: str | None = None, gain: Any = 1) -> Problem:
    """The consensus problem of a pandapower network: angles coupled by sines, generators pinned
    with ``gain`` (1/s).

    ``name`` of the problem, by default that of the network.  Returns: a Problem whose notes say
    what was left out.
    Raises: SpecError for what is no such network, and for what cannot be a positive susceptance.
    """
    if not all(hasattr(net, table) for table in ("bus", "line", "ext_grid")):
        raise wrong(
            "net",
            f"must be a pandapower network; got {type(net).__name__}.",
            "Such as pandapower.networks.case14().",
        )
    tables = {table: _records(getattr(net, table, None)) for table in TABLES}
    title = name or str(getattr(net, "name", "") or "pandapower-grid")
    grid = _grid(tables, base=net.sn_mva, source="a pandapower network")
    return grid_problem(grid, name=title, gain=gain)


def read_pandapower(data: bytes, name: str) -> Grid:
    """Read the JSON of pandapower.to_json.  Raises: SpecError."""
    try:
        document = json.loads(data)
        inside = document["_object"]
        tables = {table: _json_records(inside[table]) for table in TABLES if table in inside}
        base = inside.get("sn_mva", 1.0)
    except (ValueError, TypeError, KeyError, LookupError, RecursionError, AttributeError):
        raise wrong(
            name,
            "must be a network written by pandapower.to_json; its tables cannot be read.",
            "Write it with pandapower.to_json(net, file).",
        ) from None
    rows = {table: tables.get(table, []) for table in TABLES}
    return _grid(rows, base=base, source=f"the pandapower network {name}")


def is_pandapower(data: bytes) -> bool:
    """Whether JSON looks like that of pandapower.to_json."""
    return b'"_module"' in data[:4096] and b"pandapower" in data[:4096]


def _records(table: Any) -> list[Table]:
    if table is None:
        return []
    rows = zip(table.index, table.to_dict("records"), strict=True)
    return [{"index": index, **row} for index, row in rows]


def _json_records(table: Any) -> list[Table]:
    frame = table["_object"]
    if isinstance(frame, str):
        frame = json.loads(frame)
    found: list[Table] = []
    for index, row in zip(frame["index"], frame["data"], strict=True):
        cells = zip(frame["columns"], row, strict=True)
        found.append({"index": index, **dict(cells)})
    return found


def _grid(tables: Tables, *, base: Any, source: str) -> Grid:
    """The grid of the tables.  Raises: SpecError, also for a column that is missing or holds
    something else."""
    try:
        if any(_on(row) for row in tables["trafo3w"]):
            what = "three-winding transformers cannot be imported: their star point may have a "
            raise refused(
                "trafo3w", f"{what}negative reactance.", "Replace them by two-winding transformers."
            )
        buses = tuple(str(row["index"]) for row in tables["bus"] if _on(row))
        sources = [*tables["ext_grid"], *tables["gen"]]
        generators = tuple(str(row["bus"]) for row in sources if _on(row))
        branches = tuple(_branches(tables, float(base)))
    except SpecError:
        raise
    except (KeyError, TypeError, ValueError, ArithmeticError, AttributeError) as error:
        what = f"{source} has a table with a column that is missing or holds no number "
        raise refused(
            "pandapower",
            f"{what}({str(error)[:60]}).",
            "Write it anew with a current version of pandapower.",
        ) from None
    return Grid(buses=buses, branches=branches, generators=generators, source=source)


def _branches(tables: Tables, base: float) -> Iterator[Branch]:
    """What is in service, with reactances in p.u. on ``base`` MVA; closed bus couplers have 0."""
    switches = tables["switch"]
    # A line behind an open switch carries nothing.
    opened = {(row.get("et"), row["element"]) for row in switches if not row.get("closed")}
    voltage = {row["index"]: float(row["vn_kv"]) for row in tables["bus"]}
    on = {row["index"] for row in tables["bus"] if _on(row)}
    for table, first, second in BRANCHES:
        for row in tables[table]:
            if not _on(row) or not on >= {row[first], row[second]}:
                continue
            if (table[0], row["index"]) in opened:
                continue
            if table == "switch" and (row.get("et") != "b" or not row.get("closed")):
                continue
            x = _reactance(table, row, base, voltage)
            place = f"{table} {row['index']}"
            # Twelve digits: x was computed in floats, and 0.05917 should not read
            # 0.059170000000000006.
            reactance = parse_number(f"{x:.12g}", f"the reactance of {place}")
            labels = str(row[first]), str(row[second])
            yield Branch(ends=labels, reactance=reactance, place=place)


def _reactance(table: str, row: Table, base: float, voltage: Mapping[Any, float]) -> float:
    """Of a branch in p.u. on ``base`` MVA, from what the row of its table says; ``voltage`` of the
    buses in kV."""
    if table == "line":
        parallel = float(row.get("parallel") or 1)
        ohm = float(row["x_ohm_per_km"]) * float(row["length_km"]) / parallel
        return ohm * base / voltage[row["from_bus"]] ** 2
    if table == "trafo":
        part = base / float(row["sn_mva"]) / float(row.get("parallel") or 1) / 100
        # The short-circuit voltage gives the impedance, its real part the resistance.
        z = float(row["vk_percent"]) * part
        r = float(row["vkr_percent"]) * part
        return math.sqrt(max(0.0, z * z - r * r)) * _tap(row)
    if table == "impedance":
        return float(row["xft_pu"]) * base / float(row["sn_mva"])
    return 0.0  # a closed switch


def _tap(row: Table) -> float:
    """The tap ratio of a transformer, 1 where there is no tap changer."""
    given = [row.get(key) for key in ("tap_pos", "tap_neutral", "tap_step_percent")]
    if any(value is None or value != value for value in given):  # nan: no tap changer
        return 1.0
    position, neutral, step = (float(value or 0) for value in given)
    ratio = 1 + (position - neutral) * step / 100
    return ratio if row.get("tap_side") in (None, "hv") else 1 / ratio


def _on(row: Table) -> bool:
    return bool(row.get("in_service", True))
