"""Where runs start: as given, in a file, in the problem, or drawn by a seed; and boxes of starts of
many runs, in terms of e (n m, R) and eps = xi - xihat (n, q, R), a column for each run.

Starts are the same for the same seed; none enters a proof.
"""

import csv
import io
import re
from collections.abc import Mapping, Sequence
from itertools import product
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.random import Generator, default_rng

from dobc_design._checks import noun
from dobc_design.errors import misshapen, wrong
from dobc_design.exact.matrix import Array, Vector, to_float
from dobc_design.exact.reading import Table, shown
from dobc_design.loop.arrays import Sensed
from dobc_design.problem.load import read_bytes
from dobc_design.problem.network import BoolArray
from dobc_design.problem.problem import Problem

from ._arguments import finite_array
from .field import ClosedLoop, act, applied
from .npz import Shapes, UnfitError, describing, read_arrays, require

Given = Table | Array | list[Any] | str | PathLike[str]

AWAY = 1.0  # drawn starts without a region: at most this far from the goal, in every component
PARTS = ("x", "xi", "xihat")
NUMBER = re.compile(r" *[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)? *")  # in a CSV file
TINY = 1e-300

Pair = tuple[Array, Array]  # e and eps

RANDOM, CORNERS, EDGES = "random", "corners", "edges"
MOST_ENUMERATED = 8  # components up to which all corners are taken in turn


@noun(eq=False)
class Start:
    """One start: x (n, m), xi (n, q), xihat (n, q); of a leader s (m,), else of no numbers.  Where
    outputs are measured z and zhat in place of xi and xihat, and x is what errors are of."""

    x: Array
    xi: Array
    xihat: Array
    s: Array

    def errors(self, loop: ClosedLoop) -> Array:
        """e = x - goal, with a leader x - s - goal: (n, m)."""
        return self.x - loop.goal - (self.s if len(self.s) else 0.0)

    def state(self, loop: ClosedLoop) -> Array:
        """e, flat, and s after it."""
        return np.concatenate([self.errors(loop).ravel(), self.s])

    @property
    def eps(self) -> Array:
        """xi - xihat, (n, q)."""
        return self.xi - self.xihat


@noun(eq=False)
class Starts:
    """Draws starts: x in [low, high] unless it is given, xi, where it is nan, in a ball within an
    agent's ``own`` states; those of a leader between ``leads`` (2, m), to which x is ``relative``
    or not."""

    low: Array
    high: Array
    radius: float
    x: Array | None
    xi: Array
    xihat: Array
    own: BoolArray | None = None
    leads: Array | None = None
    relative: bool = False
    sensed: Sensed | None = None

    def draw(self, seed: int) -> Start:
        """The start of one seed."""
        rng = default_rng(seed)
        x = self.x
        if x is None:
            with np.errstate(all="ignore"):
                x = self.low + (self.high - self.low) * rng.random(self.low.shape)
        xi = self.xi
        if np.isnan(xi).any():
            xi = np.where(np.isnan(xi), self.drawn_xi(rng), xi)
        s = np.zeros(0)
        if self.leads is not None:
            low, high = self.leads
            s = low + (high - low) * rng.random(len(low))
            if self.relative:
                x = x + s
        xihat = self.xihat
        if self.sensed is not None:
            estimates = x - xi @ self.sensed.x.T
            known = applied(self.sensed.entry, estimates)
            xi = xi + known
            xihat = xihat + known
            x = estimates if self.sensed.estimated else x
        return Start(x=x, xi=xi, xihat=xihat, s=s)

    def drawn_xi(self, rng: Generator) -> Array:
        """xi evenly in the ball of every agent: a direction, and the q-th root of a number from 0
        to 1 for the length."""
        n, q = self.xihat.shape
        # normal numbers have no preferred direction
        directions = rng.standard_normal((n, q))
        exponent: float | Array = 1 / max(1, q)
        if self.own is not None:
            directions = directions * self.own
            exponent = 1 / self.own.sum(axis=1, keepdims=True)
        lengths = np.linalg.norm(directions, axis=1, keepdims=True)
        # most of a ball's volume is near its surface
        sizes = self.radius * rng.random((n, 1)) ** exponent
        return np.asarray(sizes * directions / np.maximum(lengths, TINY))


class _Width(NamedTuple):
    """How many numbers a row of a part of a start has, and what each of them is of."""

    numbers: int
    what: str


def make_starts(problem: Problem, loop: ClosedLoop, given: Given | None) -> Starts:
    """Decide where runs start: as given, by [simulation], by the region, or around the goal.
    Raises: SpecError."""
    goal = loop.goal
    rows = _given_rows(given, loop)
    region = problem.region
    away = AWAY + loop.slack
    low, high = goal - away, goal + away
    if region is not None:
        sides = to_float(region.initial_states).T
        low, high = (np.broadcast_to(side, goal.shape) for side in sides)
    # what is given comes first, then [simulation], then the region
    x = rows.get("x")
    if x is None and problem.simulation.x0 is not None:
        x = np.array(np.broadcast_to(to_float(problem.simulation.x0), goal.shape))
    xi = rows.get("xi")
    radius = 0.0
    if xi is None:
        xi = loop.owned.copy()  # where nothing bounds it: 1 in every number
        if region is not None and region.initial_disturbance is not None:
            radius = float(region.initial_disturbance)
            xi[xi > 0] = np.nan
        _place(problem.simulation.xi0 or (), loop, xi)
    return Starts(
        low=low,
        high=high,
        radius=radius,
        x=x,
        xi=xi,
        xihat=rows.get("xihat", np.zeros((loop.n, loop.q))),
        own=loop.own,
        leads=None if problem.leader is None else to_float(problem.leads).T,
        relative=x is None and region is None,
        sensed=loop.sensed,
    )


def _given_rows(given: Given | None, loop: ClosedLoop) -> dict[str, Array]:
    """The parts of a start that were given, a row for every agent.  Raises: SpecError."""
    state = _Width(loop.q, "exosystem state" if loop.sensed is None else "estimation error")
    widths = {"x": _Width(loop.m, "component"), "xi": state, "xihat": state}
    rows = {}
    for name, value in _parts(given, loop.n, widths).items():
        if value is not None:
            rows[name] = _rows(value, f"start.{name}", loop.n, widths[name])
    # states that an agent does not have
    others = 1 - loop.owned
    for name in sorted(rows.keys() - {"x"}):
        foreign = (rows[name] * others).any(axis=1)
        if foreign.any():
            row = int(foreign.argmax())
            message = f"must be 0 in the states that belong to other groups; row {row} is not."
            cure = "Each row holds the states of all groups, in the order of problem.groups."
            raise wrong(f"start.{name}", message, cure)
    return rows


def _place(rows: Sequence[Vector], loop: ClosedLoop, xi: Array) -> None:
    """Put xi0 of the problem, one row for all agents or one each, where the states of an agent's
    own exosystem are."""
    own = np.zeros_like(loop.owned)
    own[:, loop.of_xi] = loop.owned[:, loop.of_xi]
    of_agents = [to_float((row,))[0] for row in rows] * (loop.n if len(rows) == 1 else 1)
    if of_agents:
        xi[own > 0] = np.concatenate(of_agents)


def _parts(given: Given | None, n: int, widths: Mapping[str, _Width]) -> Table:
    """What was given, by part."""
    if given is None:
        return {}
    if isinstance(given, (str, PathLike)):
        return _read(Path(given), n, widths)
    if not isinstance(given, Mapping):
        return {"x": given}
    # a part that is misspelt would be left out in silence
    unknown = sorted(set(map(str, given)) - set(PARTS))
    if unknown:
        message = f"has an unknown part {shown(unknown[0])}."
        raise wrong("start", message, f"Known: {', '.join(PARTS)}.")
    return given


def _rows(value: Any, name: str, n: int, width: _Width) -> Array:
    """n rows of numbers; one row stands for all agents."""
    numbers = width.numbers
    because = f"{n} rows of {numbers}: one per agent, one number per {width.what}"
    try:
        shape = np.shape(value)
    except ValueError:  # rows of different lengths
        message = f"must be {because}; its rows differ in length."
        raise misshapen(name, message, "Fill them.") from None
    # one number per agent, else one row for all of them
    if shape == (n,) and numbers == 1:
        value = np.reshape(value, (n, 1))
    elif shape == (numbers,):
        value = np.tile(np.asarray(value), (n, 1))
    return finite_array(value, name, shape=(n, numbers), because=because)


def _read(path: Path, n: int, widths: Mapping[str, _Width]) -> Table:
    """The parts of a start in a file; of a trajectory, its last sample."""

    def fits(shapes: Shapes) -> None:
        for name, shape in shapes.items():
            count, what = widths[name]
            samples = len(shape) <= 3 and shape[-2:] == (n, count)
            numbers = shape == (count,) or (count == 1 and shape == (n,))
            wanted = f"{name} must have {n} rows of {count}, one number per {what}"
            require(samples or numbers, f"{wanted}; got shape {shape}")
        require(shapes, f"it has none of the arrays {', '.join(PARTS)}")

    cure = (
        "Give a CSV file with one row of numbers per agent, or an .npz file with x, xi and xihat."
    )
    with describing(path, key="start", what="start", cure=cure):
        if path.suffix.lower() != ".npz":
            return {"x": _numbers(read_bytes(path, what="start").decode("utf-8-sig"))}
        found = read_arrays(path, PARTS, fits)
        return {part: array[-1] if array.ndim == 3 else array for part, array in found.items()}


def _numbers(text: str) -> list[list[float]]:
    """The rows of a CSV file.  Raises: UnfitError."""
    # strict: a quote that is never closed is an error, not the rest of the file
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    lines = [(reader.line_num, row) for row in reader if row]
    for line, row in lines:
        for cell in row:
            if not NUMBER.fullmatch(cell):
                raise UnfitError(f"line {line}: {shown(cell)} is no number")
    return [[float(cell) for cell in row] for _, row in lines]


@noun(eq=False)
class Box:
    """low <= e <= high, both (n m,), and |eps_i| <= radius for every agent of the loop."""

    words: str
    loop: ClosedLoop
    low: Array
    high: Array
    radius: float

    @property
    def has_disturbance(self) -> bool:
        """Whether starts have eps != 0."""
        return self.radius > 0 and bool(self.loop.owned.any())

    def draw(self, rng: Generator, count: int, kind: str) -> Pair:
        """Starts of one kind: anywhere, at corners, or on sides; eps anywhere or at the most."""
        low = self.low
        part = unit_cube(rng, len(low), count, kind)
        width = (self.high - low)[:, None]
        e = low[:, None] + width * (part + 1) / 2
        own = self.loop.owned
        lengths: Array | float = 1.0
        if kind == RANDOM:
            sizes = np.maximum(1.0, own.sum(axis=1))[:, None, None]
            lengths = rng.random((len(own), 1, count)) ** (1 / sizes)
        eps = self.radius * lengths * sphere(rng, own, count)
        sensed = self.loop.sensed
        if sensed is not None and sensed.estimated:
            # the box is of states, and errors are of their estimates
            e = e - act(sensed.x, eps).reshape(e.shape)
        return e, eps

    def holds(self, e: Array) -> bool:
        """Whether e (n m,) with eps = 0 is in the set, but for rounding."""
        slack = 1e-9 * (1 + np.abs(self.high) + np.abs(self.low))
        above = self.low - slack <= e
        return bool(np.all(above & (e <= self.high + slack)))


def asked_box(
    problem: Problem,
    loop: ClosedLoop,
    *,
    radius: float | None = None,
    disturbance: float | None = None,
) -> Box:
    """|e|_inf <= radius, else the region, else |e|_inf <= 1; |eps_i| as asked, else the region's,
    else 0."""
    region = problem.region
    goal = loop.goal.ravel()
    if radius is None and region is not None:
        low, high = np.tile(to_float(region.initial_states), (problem.n, 1)).T - goal
        words = "the region"
    else:
        far = AWAY if radius is None else radius
        high = np.full(len(goal), far)
        low = -high
        words = f"|e|_inf <= {far:.4g}"
    if disturbance is None:
        disturbance = 0.0 if region is None else float(region.initial_disturbance or 0)
    return Box(words=words, low=low, high=high, radius=disturbance, loop=loop)


def unit_cube(rng: Generator, rows: int, count: int, kind: str) -> Array:
    """Points of [-1, 1]^rows, (rows, count): anywhere, at corners (all where there are few), or on
    sides."""
    inside = rng.uniform(-1, 1, (rows, count))
    signs = rng.choice((-1.0, 1.0), (rows, count))
    if kind == RANDOM:
        return inside
    if kind == EDGES:
        at_end = rng.random((rows, count)) < rng.random(count)
        sides = rng.integers(rows, size=count)
        at_end[sides, np.arange(count)] = True  # one at least
        return np.where(at_end, signs, inside)
    if rows <= MOST_ENUMERATED:
        every = np.array(list(product((-1.0, 1.0), repeat=rows))).T
        signs[:, : every.shape[1]] = every[:, :count]
    else:
        signs[:, :2] = np.array([-1.0, 1.0])[:count]
    return signs


def sphere(rng: Generator, own: Array, count: int) -> Array:
    """Unit vectors of the numbers that are an agent's own, (n, q, count) for ``own`` (n, q)."""
    directions = rng.standard_normal((*own.shape, count)) * own[:, :, None]
    lengths = np.linalg.norm(directions, axis=1, keepdims=True)
    return np.asarray(directions / np.maximum(lengths, TINY))
