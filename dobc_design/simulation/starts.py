"""Where a run starts: drawn from the region, given, or read from a file.

xihat starts at 0 unless it is given.  Drawn starts are the same for the same seed.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dobc_design.errors import ShapeError, SpecError
from dobc_design.exact.matrix import Vector, to_float
from dobc_design.exact.reading import shown
from dobc_design.problem.problem import Problem
from dobc_design.simulation._arguments import finite_array
from dobc_design.simulation.field import Loop

Array = NDArray[np.float64]
Given = Mapping[str, Any] | Array | list[Any] | str | PathLike[str]

AWAY = 1.0  # drawn starts without a region: at most this far from the goal, in every component
PARTS = ("x", "xi", "xihat")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Start:
    """One start: x (n, m), xi (n, q), xihat (n, q)."""

    x: Array
    xi: Array
    xihat: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Starts:
    """Draws starts by seed.  Arrays that are not None are the same for every seed.

    x: uniform in [low, high] by component, (n, m).  xi: where it is not given, uniform in the ball of ``radius``.
    ``own``: which states of the exosystems of all groups are an agent's own, where agents have different ones.
    """

    low: Array
    high: Array
    radius: float
    x: Array | None
    xi: Array | None
    xihat: Array
    own: NDArray[np.bool_] | None = None

    def draw(self, seed: int) -> Start:
        """The start of the run with this seed."""
        rng = np.random.default_rng(seed)
        x, xi = self.x, self.xi
        if x is None:
            with np.errstate(all="ignore"):
                x = self.low + (self.high - self.low) * rng.random(self.low.shape)
        if xi is None:
            n, q = self.xihat.shape
            directions, exponent = rng.standard_normal((n, q)), 1 / max(1, q)
            if self.own is not None:
                directions, exponent = directions * self.own, 1 / self.own.sum(axis=1, keepdims=True)
            lengths = np.linalg.norm(directions, axis=1, keepdims=True)
            xi = self.radius * rng.random((n, 1)) ** exponent * directions / np.maximum(lengths, 1e-300)
        return Start(x=x, xi=xi, xihat=self.xihat)


def make_starts(problem: Problem, loop: Loop, given: Given | None) -> Starts:
    """Decide where runs start.

    ``given``: x as an array (n, m) (or m numbers for all agents); a mapping with some of x, xi, xihat; a path to a CSV
    file with n rows of m numbers (x), or to an .npz file with arrays x, xi, xihat, where a saved trajectory
    gives its last sample.  What is not given: x from simulation.x0, else from region.initial_states, without a region
    within 1 of the goal; xi from simulation.xi0, else from the ball region.initial_disturbance, else ones; xihat = 0.
    Raises: SpecError or ShapeError for what does not fit or is not finite.
    """
    parts = _parts(given)
    n, m, q = loop.n, loop.m, loop.q
    x = None if parts.get("x") is None else _rows(parts["x"], "start.x", n, m, "component")
    xi = None if parts.get("xi") is None else _rows(parts["xi"], "start.xi", n, q, "exosystem state")
    xihat = np.zeros((n, q))
    if parts.get("xihat") is not None:
        xihat = _rows(parts["xihat"], "start.xihat", n, q, "exosystem state")
    _refuse_foreign(loop, {"xi": xi, "xihat": xihat})
    if x is None and problem.simulation.x0 is not None:
        x = np.array(np.broadcast_to(to_float(problem.simulation.x0), (n, m)))
    region = problem.region
    if region is None:
        low, high = loop.goal - AWAY, loop.goal + AWAY
    else:
        pairs = to_float(region.initial_states)
        low, high = np.broadcast_to(pairs[:, 0], (n, m)), np.broadcast_to(pairs[:, 1], (n, m))
    xi0 = problem.simulation.xi0
    radius = 0.0
    if xi is None and xi0 is not None:
        xi = _placed(xi0, loop)
    if xi is None and region is not None and region.initial_disturbance is not None:
        radius = float(region.initial_disturbance)
    elif xi is None:
        xi = np.ones((n, q)) if loop.own is None else loop.own.astype(float)
    return Starts(low=low, high=high, radius=radius, x=x, xi=xi, xihat=xihat, own=loop.own)


def _placed(rows: Sequence[Vector], loop: Loop) -> Array:
    """xi0 of the problem, one row for all agents or one each, where the states of an agent's own exosystem are."""
    if loop.own is None:
        return np.array(np.broadcast_to(to_float(tuple(rows)), (loop.n, loop.q)))
    xi = np.zeros((loop.n, loop.q))
    for agent in range(loop.n):
        xi[agent, loop.own[agent]] = to_float((rows[agent if len(rows) > 1 else 0],))[0]
    return xi


def _refuse_foreign(loop: Loop, parts: Mapping[str, Array | None]) -> None:
    """No agent may start in a state of another group's exosystem, which it does not have."""
    for name, rows in parts.items():
        if loop.own is not None and rows is not None and rows[~loop.own].any():
            agent = int(np.flatnonzero((rows * ~loop.own).any(axis=1))[0])
            raise SpecError(
                f"start.{name} must be 0 in the states that belong to other groups; row {agent} is not.",
                key=f"start.{name}",
                cure="Each row holds the states of all groups, in the order of problem.groups.",
            )


def _parts(given: Given | None) -> Mapping[str, Any]:
    if given is None:
        return {}
    if isinstance(given, (str, PathLike)):
        return _read(Path(given))
    if isinstance(given, Mapping):
        unknown = sorted(set(map(str, given)) - set(PARTS))
        if unknown:
            raise SpecError(
                f"start has an unknown part {shown(unknown[0])}.", key="start", cure=f"Known: {', '.join(PARTS)}."
            )
        return given
    return {"x": given}


def _rows(value: Any, name: str, n: int, width: int, what: str) -> Array:
    """n rows of ``width`` numbers; one row stands for all agents."""
    because = f"{n} rows of {width}: one per agent, one number per {what}"
    try:
        shape = np.shape(value)
    except ValueError:  # rows of different lengths
        raise ShapeError(f"{name} must be {because}; its rows differ in length.", key=name, cure="Fill them.") from None
    if shape == (n,) and width == 1:
        value = np.reshape(value, (n, 1))
    elif shape == (width,):
        value = np.tile(np.asarray(value), (n, 1))
    return finite_array(value, name, shape=(n, width), because=because)


def _read(path: Path) -> Mapping[str, Any]:
    name = shown(path.name)
    try:
        if path.suffix.lower() == ".npz":
            with np.load(path, allow_pickle=False) as arrays:
                found = {part: arrays[part] for part in PARTS if part in arrays}
            return {part: array[-1] if array.ndim == 3 else array for part, array in found.items()}
        with path.open(encoding="utf-8", newline="") as stream:
            return {"x": [[float(entry) for entry in row] for row in csv.reader(stream) if row]}
    except OSError as error:
        raise SpecError(
            f"start: {name} cannot be read: {error.strerror or error}.", key="start", cure="Check the path."
        ) from None
    except (ValueError, UnicodeDecodeError, EOFError) as error:
        raise SpecError(
            f"start: {name} does not hold a start ({str(error)[:80]}).",
            key="start",
            cure="Give a CSV file with one row of numbers per agent, or an .npz file with x, xi and xihat.",
        ) from None
