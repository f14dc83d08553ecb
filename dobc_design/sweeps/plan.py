"""A sweep before anything runs: the base problem, the axes, the task; and every case, by its
number.

The same problem, axes, task, seed and version of the toolbox give the same cases in the same order,
and ``sha256`` names them all.  Every case is one change of the base document, read by the reader of
problem files.
"""

from __future__ import annotations

import hashlib
import json
import math
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from dobc_design import __version__
from dobc_design._checks import noun, put
from dobc_design._files import own_table
from dobc_design.conditions.numbers import time_to_one_percent
from dobc_design.errors import refused, wrong
from dobc_design.exact.number import float_above
from dobc_design.exact.reading import Document, Table, Texts, one_of
from dobc_design.problem.canonical import problem_sha256
from dobc_design.problem.changes import problem_text
from dobc_design.problem.load import (
    Source,
    load_problem,
    parse_toml,
    read_problem_tables,
    source_text,
)
from dobc_design.problem.problem import Problem
from dobc_design.simulation._arguments import whole
from dobc_design.verdict import Verdict

from .axes import Axis, Over, read_axes, read_value, with_changes

if TYPE_CHECKING:
    from dobc_design.certificate.certificate import Certificate

MOST_CASES = 1_000_000


class Column(NamedTuple):
    """What is kept of every case; ``kind`` is "text", "number", "truth" or "count"."""

    name: str
    kind: str
    meaning: str


_TABLES = own_table("sweeps/columns.toml")
#: Columns of the results by task.
COLUMNS = {
    task: tuple(Column(name, *each) for name, each in table.items())
    for task, table in _TABLES.items()
}
_NEAR = ("theorem2", "theorem1", "lemma1")  # the checks at the consensus, the strongest first
_ORDER = ("everywhere", "box", "ball", "near", "none")


@noun
class Task:
    """What is done with every case: "certify", with ``everything`` as there, or "simulate" with
    ``runs`` runs.  Raises: SpecError for another kind, or options of the other one."""

    kind: str = "certify"
    everything: bool = False
    runs: int = 1

    def __post_init__(self) -> None:
        kind = one_of(self.kind, COLUMNS, "task")
        put(self, runs=whole(self.runs, "runs", least=1))
        if kind == "certify" and self.runs != 1:
            raise wrong(
                "runs", "is for simulations; a proof is made once.", 'Take task="simulate".'
            )
        if kind == "simulate" and self.everything:
            raise refused("everything", "everything is for certify.", "Leave it out.")

    @property
    def columns(self) -> tuple[Column, ...]:
        """What is kept of every case."""
        return COLUMNS[self.kind]

    def to_json(self) -> Document:
        # Options of the other task are no part of what the results depend on.
        own = {"everything": self.everything} if self.kind == "certify" else {"runs": self.runs}
        return {"kind": self.kind, **own}

    def prepare(self) -> None:
        """Import what ``run`` needs, which takes seconds in a new process and is no part of a
        case."""
        from dobc_design.certification import certify  # noqa: F401 - for its imports
        from dobc_design.simulation import runs  # noqa: F401 - likewise

    def run(self, problem: Problem) -> Document:
        # Imported here: a sweep of simulations needs no solver, and one of proofs no simulation.
        if self.kind == "certify":
            from dobc_design.certification.certify import certify

            return _facts(certify(problem, everything=self.everything))
        from dobc_design.simulation.runs import simulate

        summary = simulate(problem, runs=None if self.runs == 1 else self.runs).summary()
        found = {name: summary[name] for name in ("diverged", "diverged_runs")}
        extremes = {"final_error": "max", "settling_time": "max", "decay_rate": "min"}
        for name, extreme in extremes.items():
            found[name] = summary[name]["median"]
            found[f"{name}_{extreme}"] = summary[name][extreme]
        return found


def _facts(certificate: Certificate) -> Document:
    regions = certificate.regions
    proved = [claim for claim in regions.claims if claim.verdict is Verdict.PROVED]
    kinds = [claim.kind for claim in proved if claim.kind in _ORDER]
    boxes = [claim.box for claim in proved if claim.box is not None]
    balls = [claim.ball for claim in proved if claim.ball is not None]
    checks = certificate.checks
    # Margins of a weaker theorem say nothing where a stronger one was decided.
    near = next((id for id in _NEAR if any(check.id == id for check in checks)), None)
    margins = [each.margin for each in checks if each.id == near and each.margin is not None]
    # Only a proved settling time is a result, rounded up.
    settling, time = regions.settling, None
    if settling is not None and settling.is_proved and settling.exact is not None:
        time = float_above(Fraction(settling.exact["time"]))
    one_percent = time_to_one_percent(certificate.rate, certificate.factor)
    return {
        "verdict": certificate.verdict.value,
        "covered_by": certificate.covered_by,
        "rate": certificate.rate,
        "factor": certificate.factor,
        "one_percent": one_percent if math.isfinite(one_percent) else None,
        "margin": min(margins, default=None),
        "starts": min(kinds, key=_ORDER.index, default="none"),
        "box": max(boxes, default=None),
        "ball": max(balls, default=None),
        "settling_time": time,
        "reason": certificate.reason,
    }


@noun
class Plan:
    """All cases of a sweep: the grid of the listed values (last axis fastest), ``samples`` draws at
    each point. ``tables`` are those of a problem file, ``folder`` the place of its arc files."""

    name: str
    tables: Table
    folder: Path | None
    problem_sha256: str
    axes: tuple[Axis, ...]
    samples: int
    seed: int
    task: Task

    def __len__(self) -> int:
        listed = [len(axis.values) for axis in self.axes if axis.draw is None]
        return self.samples * math.prod(listed)

    def values(self, case: int) -> Texts:
        """The value of every axis in the case of that number, as text."""
        # Like digits of a number: draws first, then the axes from the last to the first.
        rest, sample = divmod(case, self.samples)
        values = []
        for axis in reversed(self.axes):
            if axis.draw is not None:
                values.append(axis.draw.value(self.seed, axis.name, sample))
            else:
                rest, place = divmod(rest, len(axis.values))
                values.append(axis.values[place])
        return tuple(reversed(values))

    def problem(self, case: int) -> Problem:
        """The problem of the case of that number.  Raises: SpecError."""
        given = zip(self.axes, self.values(case), strict=True)
        changes = {path: read_value(text) for axis, text in given for path in axis.keys}
        tables = with_changes(self.tables, changes)
        return read_problem_tables(tables, folder=self.folder, default_name=self.name)

    @property
    def document(self) -> Document:
        """What makes this sweep: everything that its results depend on."""
        return {
            "format": "dobc-sweep",
            "version": 1,
            "made_by": __version__,
            "problem": self.name,
            "problem_sha256": self.problem_sha256,
            "axes": [axis.text for axis in self.axes],
            "samples": self.samples,
            "seed": self.seed,
            "task": self.task.to_json(),
            "cases": len(self),
        }

    @property
    def sha256(self) -> str:
        text = json.dumps(self.document, sort_keys=True, ensure_ascii=False, separators=(",", ":"))
        return hashlib.sha256(text.encode("utf-8")).hexdigest()


def make_plan(
    source: Source,
    over: Over,
    *,
    task: Task,
    samples: int | None = None,
    seed: int = 0,
) -> Plan:
    """Read the problem and the axes.  Raises: SpecError for a wrong problem, axis or number of
    samples."""
    problem = load_problem(source)
    axes = read_axes(over)
    drawn = [axis.name for axis in axes if axis.draw is not None]
    if drawn and samples is None:
        raise wrong(
            "samples",
            f"must say how many times {drawn[0]} is drawn.",
            "For example --samples 100.",
        )
    if not drawn and samples is not None:
        raise wrong(
            "samples",
            "must be left out when nothing is drawn; every grid point is run once.",
            "Draw a key, such as KEY=~uniform(0,1), or leave samples out.",
        )
    text, folder = None, None
    if not isinstance(source, Problem):
        text = source_text(source)
        if text is not None:
            folder = Path(source).resolve().parent
    plan = Plan(
        name=problem.name,
        tables=_tables(text, problem),
        folder=folder,
        problem_sha256=problem_sha256(problem),
        axes=axes,
        samples=1 if samples is None else whole(samples, "samples", least=1),
        seed=whole(seed, "seed", least=0),
        task=task,
    )
    # Cases are counted and not listed, so that this is refused before anything takes memory.
    if len(plan) > MOST_CASES:
        raise refused(
            "over",
            f"a sweep may have at most {MOST_CASES} cases; these axes give {len(plan)}.",
            "Take fewer values, or split it into several sweeps.",
        )
    return plan


def _tables(text: str | None, problem: Problem) -> Table:
    """The tables as they were typed where that is possible, so that paths lead to what the user
    sees."""
    if text is None:
        return parse_toml(problem_text(problem).encode("utf-8"))
    tables = parse_toml(text.encode("utf-8"))
    if any(isinstance(mode, dict) for mode in tables["network"]["modes"].values()):
        # Arc files are read once, here; a worker on another machine need not have them.
        whole = parse_toml(problem_text(problem).encode("utf-8"))
        tables["network"] = whole["network"]
        if "exceptions" in tables["coupling"]:
            tables["coupling"]["exceptions"] = whole["coupling"]["exceptions"]
    return tables
