"""MATPOWER case files: the numeric tables mpc.bus, mpc.gen and mpc.branch, read as text and never executed.

Entries have to be numbers.  A case whose tables are computed is refused: MATPOWER's savecase writes a plain one.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from fractions import Fraction

from dobc_design.errors import SpecError
from dobc_design.exact.number import parse_number
from dobc_design.exact.reading import shown
from dobc_design.importing.grids import Branch, Grid

ISOLATED = 4  # bus type
COLUMNS = {"bus": 2, "gen": 8, "branch": 11}  # that have to be there
_TABLE = re.compile(r"(?<![\w.])mpc\.(bus|gen|branch)[ \t]*=[ \t]*\[")
_COMMENT = re.compile(r"%[^\n]*")
_CONTINUED = re.compile(r"\.\.\.[^\n]*\n")
_CELL = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*(?:[eE][+-]?[0-9]+)?|\.[0-9]+(?:[eE][+-]?[0-9]+)?|[iI]nf|[nN]a[nN])")
_BUS = re.compile(r"[0-9]{1,18}(\.0*)?")


def read_matpower(text: str, *, name: str) -> Grid:
    """Read the tables of a case file; ``name`` of the file is for messages.

    Raises: SpecError that names table, row and column.
    """
    plain = _CONTINUED.sub(" ", _COMMENT.sub("", text))
    tables = {table: _rows(body, table, name) for table, body in _tables(plain)}
    for table in ("bus", "branch"):
        if table not in tables:
            raise SpecError(
                f"{name} must hold the table mpc.{table} of a MATPOWER case, in numbers; it is not there.",
                key=f"mpc.{table}",
                cure="Write the case with MATPOWER's savecase.",
            )
    kinds = {_bus(row[0], "bus", i): _number(row[1], f"mpc.bus({i},2)") for i, row in enumerate(tables["bus"], 1)}
    isolated = {bus for bus, kind in kinds.items() if kind == ISOLATED}
    generators = [
        _bus(row[0], "gen", i)
        for i, row in enumerate(tables.get("gen", []), 1)
        if _number(row[7], f"mpc.gen({i},8)") > 0
    ]
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
            raise SpecError(
                f"{name}: mpc.{table} must have at least {COLUMNS[table]} columns; row {i} has {len(row)}.",
                key=f"mpc.{table}",
                cure="Write the case with MATPOWER's savecase.",
            )
        for j, cell in enumerate(row, 1):
            if not _CELL.fullmatch(cell):
                raise SpecError(
                    f"{name}: mpc.{table}({i},{j}) must be a number, because nothing in a case is computed;"
                    f" got {shown(cell)}.",
                    key=f"mpc.{table}({i},{j})",
                    cure="Write the case with MATPOWER's savecase.",
                )
    return rows


def _bus(text: str, table: str, row: int) -> str:
    if not _BUS.fullmatch(text):
        raise SpecError(
            f"mpc.{table} row {row}: a bus must be a whole number; got {shown(text)}.",
            key=f"mpc.{table}",
            cure="Write the case with MATPOWER's savecase.",
        )
    return str(int(text.partition(".")[0]))


def _number(text: str, key: str) -> Fraction:
    """An entry as the decimal text it is; MATLAB writes .5 and 5. too."""
    trimmed = re.sub(r"(?<![0-9])\.(?=[0-9])", "0.", text)
    return parse_number(re.sub(r"(?<=[0-9])\.(?![0-9])", "", trimmed), key=key)
