"""The widget: what it shows follows from the problem it was made of and from what was moved since.

While the hand still moves it shows estimates in floating point; when it rests, the exact verdict.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Sequence
from dataclasses import asdict, replace
from fractions import Fraction
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from dobc_design._checks import noun
from dobc_design.certificate.certificate import Certificate
from dobc_design.certificate.files import write_atomically
from dobc_design.certification.certify import certify
from dobc_design.conditions.consensus.propose import float_lambda, largest_eigenvalue
from dobc_design.conditions.numbers import bisected
from dobc_design.conditions.observer.propose import with_observer
from dobc_design.conditions.separable.claim import acts_by_component, stuck_agents
from dobc_design.conditions.separable.propose import field_of, least_above
from dobc_design.errors import DobcError, refused
from dobc_design.exact.matrix import Matrix, multiple_of, scale
from dobc_design.exact.number import ONE, ZERO, number_text, parse_number
from dobc_design.exact.reading import Document
from dobc_design.loop.make import loop_of
from dobc_design.loop.timing import Timing
from dobc_design.plotting.networks import positions
from dobc_design.problem.changes import problem_text
from dobc_design.problem.load import Source, load_problem
from dobc_design.problem.network import Network
from dobc_design.problem.pinning import GainForm
from dobc_design.problem.problem import Problem
from dobc_design.simulation.runs import simulate
from dobc_design.synthesis.pinning.propose_regions import late_caps

from .shown import limit_words, shown, shown_rates
from .source import python_source

try:
    import anywidget
    import traitlets
except ImportError as error:
    raise ImportError(
        "Designer needs anywidget, which is not installed. Install it: pip install "
        "'dobc_design[notebook]'"
    ) from error

FOLDER = Path(__file__).parent
LARGEST = 200  # agents that a drawing to be clicked holds
GAIN = 5.0  # 1/s, of an agent that is clicked
HALVINGS = 7
SCALES = 8  # sizes of the box, down to the smallest, at which it has to shrink
SMALLEST = 1 / 64  # of the radius asked for: below that nothing is shown
POINTS = 120  # of a curve


def _synced() -> Any:
    """A table that Python and the page share."""
    return traitlets.Dict().tag(sync=True)


class Designer(anywidget.AnyWidget):  # type: ignore[misc]
    """A problem to be changed by hand: pin agents, set gains, rate and region, add and remove arcs.

    Estimates in floating point follow every change; the exact verdict comes after a short rest.
    With it comes the proved bound, drawn against the run: no agent is ever above it from starts
    within the radius; whether inputs keep the limit of [actuators]; and the proved rate where
    readings are older or younger than stated.
    ``problem`` is the problem as it stands now, equal to the one given until something is changed;
    ``certificate`` is that of the last exact verdict, or None if something was changed since.
    ``save`` writes a problem file: after a restart of the kernel, ``Designer(path)`` goes on from
    it.  ``python_source(designer.problem)`` is the problem as Python.

    ``problem``: Problem, path of a problem file, or name of a built-in problem; at most 200 agents.
    Gains are numbers, of agents with [dynamics] multiples of the coupling; a matrix that is none
    counts as 1 and is scaled.  ``rate``: the decay rate in 1/s that the previewed region has to
    have.  ``radius``: starts within this distance of the target, or of each other where agents
    agree on a value, which are not pinned; default those of the problem's region.
    Raises: SpecError for a problem that it cannot show.
    """

    _esm = FOLDER / "designer.js"
    _css = FOLDER / "designer.css"

    network = _synced()
    # mode -> [listener, speaker, weight as text], counted from 0
    arcs = _synced()
    gains = _synced()  # label -> k in 1/s, of pinned agents
    rate = traitlets.Float(0.05).tag(sync=True)
    radius = traitlets.Float(1.0).tag(sync=True)
    version = traitlets.Int(0).tag(sync=True)  # counts the changes
    numbers = _synced()
    verdict = _synced()

    def __init__(
        self,
        problem: Source,
        *,
        rate: float = 0.05,
        radius: float | None = None,
    ) -> None:
        base = load_problem(problem)
        base.require("the Designer")
        self._base = base
        if base.n > LARGEST:
            raise refused(
                "network.agents",
                f"the network has {base.n} agents; the drawing shows at most {LARGEST}.",
                "Use certify and design for it.",
            )
        self._gains = _multiples(base)
        self._working = threading.Lock()
        self.certificate: Certificate | None = None
        self._arcs: dict[str, list[list[Any]]] = {}
        for mode, arcs in base.network.modes.items():
            self._arcs[mode] = [[i, j, number_text(weight)] for i, j, weight in arcs]
        super().__init__(
            network=_drawn(with_observer(base)),
            arcs=self._arcs,
            gains={label: float(k) for label, (k, _) in self._gains.items()},
            rate=float(rate),
            radius=_radius(base) if radius is None else float(radius),
        )
        self.observe(self._moved, ["arcs", "gains", "rate", "radius"])
        self.on_msg(self._asked)
        self._look()

    @property
    def problem(self) -> Problem:
        """The problem as it stands now.  Raises: SpecError for an arc, a gain or a radius that is
        none."""
        base = self._base
        changes: Document = {"gains": {}}
        for label, value in self.gains.items():
            given, unit = self._gains.get(label, (ZERO, None))
            # What was not moved stays exact: 1/3 stays 1/3.
            if float(given) != value:
                given = exact(value)
            changes["gains"][label] = given if unit is None else scale(given, unit)
        if self.radius != _radius(base):
            changes["region"] = _region(base, exact(self.radius))
        if self.arcs != self._arcs:
            network = self._network()
            there = {(i, j) for each in network.modes.values() for i, j, _ in each}
            changes["network"] = network
            changes["exceptions"] = {arc: h for arc, h in base.exceptions.items() if arc in there}
        return base.replace(**changes)

    def _network(self) -> Network:
        """The network of the arcs that are drawn."""
        labels = self._base.network.labels
        arcs = {}
        for mode, each in self.arcs.items():
            arcs[mode] = [[labels[i], labels[j], weight] for i, j, weight in each]
        return Network.from_arcs(arcs, arrow="listens_to", agents=labels)

    def certify(self) -> Certificate:
        """Decide the problem as it stands, exactly, show the verdict, and return the
        certificate."""
        with self._working:
            version = self.version
            self.verdict = {"busy": True}
            certificate = certify(self.problem)
            if version == self.version:  # else it is out of date already
                self.certificate = certificate
                told = shown(certificate, self.numbers["times"], exact(self.radius))
                self.verdict = told
                rates = shown_rates(certificate)
                if rates and version == self.version:
                    self.verdict = told | {"rates": rates}
            return certificate

    def save(self, path: str | PathLike[str], *, force: bool = False) -> Path:
        """Write the problem as a TOML file.  Raises: SpecError if the file is there, unless
        ``force``."""
        target = Path(path)
        if target.exists() and not force:
            raise refused(
                "path",
                f"{target} is there already.",
                "Choose another name, or tick replace (in Python: force=True).",
            )
        write_atomically(target, problem_text(self.problem).encode())
        return target

    def _moved(self, _change: Any) -> None:
        self.certificate = None
        self.version += 1
        self.verdict = {}
        self._look()

    def _look(self) -> None:
        started = time.perf_counter()
        t_final = float(self._base.simulation.t_final)
        try:
            seen = preview(self.problem, radius=self.radius, rate=self.rate, t_final=t_final)
        except DobcError as error:
            seen = Preview(note=str(error))
        milliseconds = round(1000 * (time.perf_counter() - started))
        self.numbers = asdict(seen) | {"version": self.version, "milliseconds": milliseconds}

    def _asked(self, _widget: Any, content: Any, _buffers: Any) -> None:
        kind = content.get("kind") if isinstance(content, dict) else None
        if kind == "certify" and content.get("version") == self.version:
            threading.Thread(target=self._certify_quietly, daemon=True).start()
        elif kind in ("save", "python"):
            try:
                self.send(self._answer(content))
            except (DobcError, OSError) as error:
                self.send({"kind": "saved", "text": str(error)})

    def _answer(self, content: Document) -> dict[str, str]:
        """The problem as Python, or where it was saved."""
        if content["kind"] == "python":
            return {"kind": "python", "text": python_source(self.problem)}
        path = self.save(str(content.get("path", "")), force=content.get("replace") is True)
        text = f"Saved. To open it again: dd.Designer({str(path)!r})"
        return {"kind": "saved", "text": text}

    def _certify_quietly(self) -> None:
        try:
            self.certify()
        except DobcError as error:
            self.verdict = {"verdict": "error", "text": str(error)}


def exact(value: float) -> Fraction:
    """The number as it was typed: 0.1 is 1/10."""
    return parse_number(repr(float(value)), "value")


def _multiples(problem: Problem) -> dict[str, tuple[Fraction, Matrix]]:
    """The number of a pinned agent, and what it is a multiple of: what numbers mean in a file, else
    its own gain."""
    unit = GainForm.of(problem.m, problem.dynamics, problem.coupling).unit or ()
    found = {}
    for agent, k in problem.pinning.gains.items():
        number = multiple_of(k, unit) if unit else None
        own = (ONE, k) if number is None else (number, unit)
        found[problem.network.labels[agent]] = own
    return found


def _drawn(problem: Problem) -> Document:
    # The drawing stays where it is when modes differ: it is of all their arcs.
    pairs = sorted({(i, j) for arcs in problem.network.modes.values() for i, j, _ in arcs})
    return {
        "name": problem.name,
        "labels": list(problem.network.labels),
        "places": positions(pairs, problem.n).round(4).tolist(),
        "gain": GAIN,
        "limit": limit_words(problem),
        "unit": problem.unit,
        "agrees": problem.agrees,
        "dynamics": problem.dynamics is not None,
        "multiples": problem.dynamics is not None or not problem.pinning.is_scalar,
    }


def _radius(problem: Problem) -> float:
    if problem.region is None:
        return 1.0
    if problem.agrees:
        return float(max(high - low for low, high in problem.region.initial_states))
    farthest = []
    for (low, high), goal in zip(problem.region.initial_states, problem.target, strict=True):
        farthest.append(max(abs(low - goal), abs(high - goal)))
    return float(max(farthest))


def _region(problem: Problem, radius: Fraction) -> Document:
    """Starts within ``radius`` of the target, or of each other, in every component; the bound on
    the estimation error stays as it was."""
    middles = list(problem.target)
    if problem.agrees:
        radius /= 2
        if problem.region is not None:
            middles = [(low + high) / 2 for low, high in problem.region.initial_states]
    states = [[middle - radius, middle + radius] for middle in middles]
    region: Document = {"initial_states": states[0] if problem.m == 1 else states}
    given = None if problem.region is None else problem.region.initial_disturbance
    if problem.groups and given is None:
        region["initial_disturbance"] = 0
    return region


@noun
class Preview:
    """Estimates for one problem: numbers in floating point, in a fraction of a second, and no
    proofs.  ``lambda_max``: the largest eigenvalue of Lambda over all modes in 1/s, None where h
    may have a kink.  ``reach``: the largest box |e|_inf <= reach, up to the radius asked for, that
    seems to shrink at the rate asked for (the network alone, without the observer); 0 if none
    does.  ``errors`` (agents, times): |x_i - goal_i|_inf at ``times`` in s, where agents agree on a
    value the largest |x_i - x_j|, beside which nothing is estimated.  ``note``: why something is
    missing."""

    lambda_max: float | None = None
    reach: float = 0.0
    times: Sequence[float] = ()
    errors: Sequence[Sequence[float]] = ()
    note: str


def preview(problem: Problem, *, radius: float, rate: float, t_final: float) -> Preview:
    """Estimate everything.  ``radius`` in the unit of x, ``rate`` in 1/s, ``t_final`` in s."""
    problem = with_observer(problem)
    seen = _response(problem, radius, t_final)
    # What is estimated is about integrators.
    if problem.agrees or problem.dynamics is not None:
        return seen
    return replace(seen, lambda_max=_lambda_max(problem), reach=_reach(problem, radius, rate))


def _lambda_max(problem: Problem) -> float | None:
    if any(coupling.nonsmooth for coupling in problem.couplings):
        return None
    tops = []
    for mode in problem.network.modes:
        try:
            tops.append(largest_eigenvalue(float_lambda(loop_of(problem), mode)).value)
        except (ArithmeticError, DobcError):
            return None
    if not all(map(math.isfinite, tops)):
        return None
    return float(max(tops))


def _reach(problem: Problem, radius: float, rate: float) -> float:
    # What cannot be proved that way need not be searched for.
    if not acts_by_component(loop_of(problem)) or stuck_agents(loop_of(problem)):
        return 0.0
    if _shrinks(problem, radius, rate):
        return radius
    least = SMALLEST * radius
    low, high = bisected(
        lambda middle: _shrinks(problem, middle, rate),
        0.0,
        radius,
        steps=HALVINGS,
        close=lambda low, high: high < least or high - low < 0.02 * high,
    )
    return 0.0 if high < least else low


def _shrinks(problem: Problem, radius: float, rate: float) -> bool:
    loop = loop_of(problem)
    timing = loop.timing or Timing()
    try:
        field = field_of(loop, rho=radius)
        stretch = float(timing.stretch(exact(rate)))
    except (ArithmeticError, DobcError):
        return False
    # enough for an estimate
    grid = field.grid[:: max(1, len(field.grid) // SCALES)]
    field = replace(field, grid=grid, stretch=stretch)
    if timing.steepest is not None:
        caps = late_caps(field, timing, {})
        if any(k > caps[i] for i, k in enumerate(field.gains.tolist())):
            return False
    return least_above(field, alpha=rate, lower=np.ones(problem.n)) is not None


def _response(problem: Problem, radius: float, t_final: float) -> Preview:
    """The network without disturbances, from a start on the box's boundary that is the same every
    time."""
    goals = np.array([list(map(float, problem.goal_of(agent))) for agent in range(problem.n)])
    # Corners and halves of the box: a start that shows something of every agent.
    random = np.random.default_rng(0)
    size = radius / 2 if problem.agrees else radius
    start = goals + size * random.choice((-1.0, -0.5, 0.5, 1.0), size=goals.shape)
    alone = problem.replace(region=None, switching=None, simulation=None)
    given = {"x": start}
    sensed = loop_of(problem).sensed
    if sensed:
        # Where outputs are measured estimates are part of the network; they are right at first.
        given["xi"] = np.zeros((problem.n, sum(group.exosystem.order for group in sensed)))
    else:
        alone = alone.replace(exosystem=None, observer=None, groups=None)
    mode = next(iter(problem.network.modes))
    try:
        run = simulate(
            alone, mode=mode, start=given, t_final=t_final, samples=POINTS, tolerance=1e-5
        )
    except DobcError as error:
        return Preview(note=str(error))
    e = run.x - goals
    errors = abs(e).max(axis=2)  # (times, agents)
    if problem.agrees:
        low, high = e.min(axis=1, keepdims=True), e.max(axis=1, keepdims=True)
        errors = np.maximum(e - low, high - e).max(axis=2)
    rows = [[float(f"{value:.4g}") for value in row] for row in errors.T]
    times = [float(f"{t:.4g}") for t in run.times]
    return Preview(times=times, errors=rows, note=run.reason if run.diverged else "")
