"""A sweep before anything runs: the base problem, the axes, the task; and every case, by its number.

A plan is a value: the same problem, axes, task, seed and version of the toolbox give the same cases in the same order,
and ``sha256`` names them all.  Every case is one change of the base document, read by the reader of problem files, so
that it means what the same change in a file would mean.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

from dobc_design import __version__
from dobc_design.errors import SpecError
from dobc_design.exact.reading import shown
from dobc_design.problem.canonical import problem_sha256
from dobc_design.problem.changes import problem_text
from dobc_design.problem.load import load_problem, source_text
from dobc_design.problem.problem import Problem
from dobc_design.problem.toml_text import parse_toml
from dobc_design.sweeps.axes import Axis, read_axes
from dobc_design.sweeps.tasks import Task

MOST_CASES = 1_000_000
FORMAT, VERSION = "dobc-sweep", 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Base:
    """What every case starts from: the tables of a problem file, and the folder its arc files are in."""

    document: Mapping[str, Any]
    folder: str | None
    name: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One case: its number from 0, and the value of every axis as text, in the order of the axes."""

    number: int
    values: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """All cases of a sweep: the grid of the listed values (last axis fastest), ``samples`` draws at each point."""

    base: Base
    problem_sha256: str
    axes: tuple[Axis, ...]
    samples: int
    seed: int
    task: Task

    def __len__(self) -> int:
        return self.samples * math.prod(len(axis.values) for axis in self.axes if axis.draw is None)

    def case(self, number: int) -> Case:
        """The case of that number."""
        rest, sample = divmod(number, self.samples)
        values: list[str] = []
        for axis in reversed(self.axes):
            if axis.draw is not None:
                values.append(axis.draw.value(self.seed, axis.name, sample))
            else:
                rest, place = divmod(rest, len(axis.values))
                values.append(axis.values[place])
        return Case(number=number, values=tuple(reversed(values)))

    @property
    def document(self) -> dict[str, Any]:
        """What makes this sweep: everything that its results depend on."""
        return {
            "format": FORMAT,
            "version": VERSION,
            "made_by": __version__,
            "problem": self.base.name,
            "problem_sha256": self.problem_sha256,
            "axes": [axis.text for axis in self.axes],
            "samples": self.samples,
            "seed": self.seed,
            "task": self.task.to_json(),
            "cases": len(self),
        }

    @property
    def sha256(self) -> str:
        """SHA-256 of ``document``, as hexadecimal text."""
        text = json.dumps(self.document, sort_keys=True, ensure_ascii=False, separators=(",", ":"))
        return hashlib.sha256(text.encode("utf-8")).hexdigest()


def make_plan(
    source: Problem | str | PathLike[str],
    over: Mapping[str, Any] | Sequence[str],
    *,
    task: Task,
    samples: int | None = None,
    seed: int = 0,
) -> Plan:
    """Read the problem and the axes.  Raises: SpecError for a wrong problem, axis or number of samples."""
    problem = source if isinstance(source, Problem) else load_problem(source)
    axes = read_axes(over)
    drawn = [axis.name for axis in axes if axis.draw is not None]
    if drawn and samples is None:
        raise SpecError(
            f"samples must say how many times {drawn[0]} is drawn.", key="samples", cure="For example --samples 100."
        )
    if not drawn and samples is not None:
        raise SpecError(
            "samples must be left out when nothing is drawn; the grid is gone through once.",
            key="samples",
            cure="Draw a key, such as KEY=~uniform(0,1), or leave samples out.",
        )
    for name, value, least in (("samples", samples, 1), ("seed", seed, 0)):
        if value is not None and (type(value) is not int or value < least):
            raise SpecError(
                f"{name} must be a whole number >= {least}; got {shown(value)}.", key=name, cure="Correct it."
            )
    plan = Plan(
        base=_base(source, problem),
        problem_sha256=problem_sha256(problem),
        axes=axes,
        samples=samples or 1,
        seed=seed,
        task=task,
    )
    if len(plan) > MOST_CASES:
        raise SpecError(
            f"a sweep may have at most {MOST_CASES} cases; these axes give {len(plan)}.",
            key="over",
            cure="Take fewer values, or split it into several sweeps.",
        )
    return plan


def _base(source: Problem | str | PathLike[str], problem: Problem) -> Base:
    """The tables as they were typed where that is possible, so that paths lead to what the user sees."""
    text = None if isinstance(source, Problem) else source_text(source)
    document = parse_toml((problem_text(problem) if text is None else text).encode("utf-8"))
    modes = document["network"]["modes"].values()
    if text is not None and any(isinstance(mode, dict) for mode in modes):
        # Arc files are read once, here; a worker on another machine need not have them.
        whole = parse_toml(problem_text(problem).encode("utf-8"))
        document["network"] = whole["network"]
        if "exceptions" in document["coupling"]:
            document["coupling"]["exceptions"] = whole["coupling"]["exceptions"]
    folder = None if isinstance(source, Problem) or text is None else str(Path(source).resolve().parent)
    return Base(document=document, folder=folder, name=problem.name)
