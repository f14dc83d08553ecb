"""What a simulation was asked for: a stress, checked arguments, where runs start, and what follows
before integrating.

A stress is what the theorems leave out.  Starts and stresses are the same for the same seed;
neither enters a proof.
"""

from __future__ import annotations

import csv
import io
import json
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from os import PathLike
from pathlib import Path
from typing import Any, Literal, TypedDict, Unpack

import numpy as np
from numpy.typing import NDArray

from dobc_design._checks import put
from dobc_design._show.cards import Shown, Told
from dobc_design.errors import ShapeError, SpecError, wrong
from dobc_design.exact.matrix import Vector, to_float
from dobc_design.exact.reading import shown
from dobc_design.problem.arrays import (
    ArcGroup,
    Array,
    Gain,
    arc_groups,
    mode_index,
    no_gain,
    require_floats,
)
from dobc_design.problem.integrators import as_integrators
from dobc_design.problem.load import read_bytes
from dobc_design.problem.network import one_form
from dobc_design.problem.problem import Problem
from dobc_design.problem.uncertainty import Uncertainty
from dobc_design.simulation._arguments import finite_array, not_negative, positive, seconds, whole
from dobc_design.simulation.field import ClosedForm, Loop, make_closed_form, make_loop
from dobc_design.simulation.integrate import STIFF, fastest_decay, observer_decay
from dobc_design.simulation.signals import Fixed, Mobile, Signal
from dobc_design.simulation.switches import (
    Switches,
    drawn_graphs,
    drawn_switches,
    groups_of,
    motion_switches,
)
from dobc_design.simulation.trajectory import UnfitError, describing, read_arrays, require

EXCHANGE = 0.05  # s between two exchanges where neither a period nor an exchange is given
KINDS = ("vanish", "freeze")


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Failure(Shown):
    """Agent ``agent`` fails at ``time`` s.

    "vanish": its input is 0 and nobody hears it any more.  "freeze": its input and what the others
    hear of it stay as they are at that instant.  It goes on feeling the couplings, which are no
    part of its input in (1).
    """

    agent: str
    time: float = 0.0
    kind: str = "vanish"

    def __post_init__(self) -> None:
        put(self, agent=str(self.agent), time=not_negative(self.time, "failure.time"))
        if self.kind not in KINDS:
            message = f"must be one of {', '.join(KINDS)}; got {shown(self.kind)}."
            raise wrong("failure.kind", message, '"vanish" is the default.')

    def __str__(self) -> str:
        return f"agent {self.agent} fails at {self.time:g} s ({self.kind})"


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Stress(Told):
    """Options that can be combined; what is left out does not happen.

    ``noise``: standard deviation of every measured component, in the unit of x, drawn anew at every
    exchange (every 0.05 s without). ``disturbance``: amplitude, in units of x per s (of u with
    [dynamics]), of a sine of ``frequency`` rad/s with random phases that acts besides d and that no
    exosystem knows (frequency 0: a constant).  ``saturation``: bound on every component of u, in
    the same units; the observer is told the input that is applied.  ``period`` (s): couplings,
    input and observer are computed at its multiples and held between (see ``sampled``);
    ``sampled_gain`` (q, m) is then the observer's, as ``design_observer(period=...)`` gives it, in
    place of the discretised W.  ``loss``: probability that a packet is lost, on every arc and at
    every exchange; the listener keeps the last.  ``exchange`` (s): time between exchanges, the
    period where there is one, else 0.05 s.  ``failures``: agents that fail.  ``worst``: noise and
    disturbance take the values + and - only, the disturbance so that it drives one agent, the seed
    modulo n, as far as the linearised loop can be driven; agents have the limits of [actuators].
    """

    noise: float = 0.0
    disturbance: float = 0.0
    frequency: float = 1.0
    saturation: float | None = None
    period: float | None = None
    sampled_gain: tuple[tuple[float, ...], ...] | None = None
    loss: float = 0.0
    exchange: float | None = None
    failures: tuple[Failure, ...] = ()
    worst: bool = False

    def __post_init__(self) -> None:
        numbers = ("noise", "disturbance", "frequency", "loss")
        put(self, **{name: not_negative(getattr(self, name), name) for name in numbers})
        if self.loss > 1:
            raise wrong(
                "loss", f"must be a probability, 0 to 1; got {self.loss:g}.", "Such as 0.1."
            )
        if self.saturation is not None:
            put(self, saturation=positive(self.saturation, "saturation"))
        times = [name for name in ("period", "exchange") if getattr(self, name) is not None]
        put(self, **{name: seconds(getattr(self, name), name, example="0.05") for name in times})
        if self.period is not None and self.exchange not in (None, self.period):
            message = (
                "must be left out when a period is given, because a sampled agent exchanges "
                "when it samples."
            )
            raise wrong("exchange", message, "Leave one of them out.")
        if self.sampled_gain is not None:
            self._check_gain(self.sampled_gain)
        given: Any = self.failures
        failures = (given,) if isinstance(given, Failure) else tuple(given)
        if not all(isinstance(each, Failure) for each in failures):
            raise wrong(
                "failures", "must be a list of Failure.", 'Such as [Failure(agent="3", time=2.0)].'
            )
        for agent, count in Counter(each.agent for each in failures).items():
            if count > 1:
                raise SpecError(
                    f"agent {shown(agent)} fails twice.",
                    key="failures",
                    cure="Leave one of them out.",
                )
        put(self, failures=failures)

    def _check_gain(self, given: Any) -> None:
        if self.period is None:
            message = "needs a period, because it is the gain of a sampled observer."
            raise wrong("sampled_gain", message, "Give the period it was designed for.")
        try:
            shape = np.shape(given)
        except ValueError:  # rows of different lengths, which the next line refuses
            shape = (0, 0)
        gain = finite_array(
            given, "sampled_gain", shape=shape, because="one row per exosystem state"
        )
        put(self, sampled_gain=tuple(map(tuple, np.atleast_2d(gain).tolist())))

    @property
    def is_calm(self) -> bool:
        return replace(self, frequency=1.0) == Stress()

    @property
    def exchanges(self) -> float | None:
        """Time in s between two exchanges; None where states are heard continuously."""
        given = self.exchange if self.period is None else self.period
        return EXCHANGE if given is None and self.loss else given

    @property
    def draws(self) -> float | None:
        """Time in s between two draws of the measurement noise; None where nothing is ever drawn or
        exchanged."""
        return EXCHANGE if self.noise and self.exchanges is None else self.exchanges

    def failing(self, problem: Problem) -> dict[int, Failure]:
        """Failures by the agent's index.  Raises: SpecError for an agent that is not there."""
        places = {label: place for place, label in enumerate(problem.network.labels)}
        failures = {one_form(each.agent): each for each in self.failures}
        for label, each in failures.items():
            if label not in places:
                cure = f"Labels are {', '.join(problem.network.labels[:6])}, ..."
                raise wrong(
                    "failures", f"names {shown(each.agent)}, and no agent has this label.", cure
                )
        return {places[label]: each for label, each in failures.items()}

    def __str__(self) -> str:
        words = []
        if self.noise:
            words.append(f"measurement noise {'of at most ' if self.worst else ''}{self.noise:g}")
        if self.disturbance:
            how = (
                "switched to be as bad as it can be"
                if self.worst
                else f"at {self.frequency:g} rad/s"
            )
            words.append(f"unmodelled disturbance {self.disturbance:g} {how}")
        if self.saturation is not None:
            words.append(f"|u| at most {self.saturation:g}")
        if self.exchanges is not None:
            words.append(
                f"{'exchanges' if self.period is None else 'sampled'} every {self.exchanges:g} s"
            )
        if self.loss:
            words.append(f"{self.loss:.3g} of the packets lost")
        return "; ".join([*words, *map(str, self.failures)]) or "no stress"


def worst_stress(problem: Problem, *, needed: bool = True) -> Stress:
    """What [uncertainty] and [actuators] allow, at its worst.  Raises: SpecError if nothing, but
    ``needed``."""
    allowed, actuators = problem.uncertainty or Uncertainty(), problem.actuators
    limit = None if actuators is None or isinstance(actuators.limit, Mapping) else actuators.limit
    stress = Stress(
        noise=float(allowed.measurement), disturbance=float(allowed.disturbance), worst=True
    )
    if not (stress.noise or stress.disturbance) and (actuators is None or actuators.limit is None):
        if not needed:
            return Stress()
        what = (
            "has nothing to apply: the problem bounds no disturbance, no measurement noise, no "
            "input and no signal."
        )
        raise wrong(
            "stress",
            what,
            'Give [uncertainty], [actuators] limit, or [switching] guarantee = "dwell".',
        )
    return replace(stress, saturation=None if limit is None else float(limit))


def stress_to_json(stress: Stress) -> str:
    """A stress as one JSON object."""
    given = asdict(stress)
    if not stress.worst:
        del given["worst"]
    return json.dumps(given, ensure_ascii=False)


TOLERANCE = 1e-9  # relative, of the integrator; the absolute one is a hundredth of it
SAMPLES = 401
LONGEST = 1e12  # s; there two neighbouring floats are 0.1 ms apart
MOST_NUMBERS = 1 << 26  # in a trajectory whose samples nobody asked for: half a GiB
OBSERVERS = ("closed-form", "full-loop", "off")
OFF = "The observer is off: the disturbance is not compensated."
Given = Mapping[str, Any] | Array | list[Any] | str | PathLike[str]

AWAY = 1.0  # drawn starts without a region: at most this far from the goal, in every component
PARTS = ("x", "xi", "xihat")
NUMBER = re.compile(r" *[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)? *")  # in a CSV file


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Start:
    """One start: x (n, m), xi (n, q), xihat (n, q); of a leader s (m,), else of no numbers."""

    x: Array
    xi: Array
    xihat: Array
    s: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Starts:
    """Draws starts: x in [low, high], xi in a ball within an agent's ``own`` states, unless they
    are given; those of a leader between ``leads`` (2, m), to which x is ``relative`` or not."""

    low: Array
    high: Array
    radius: float
    x: Array | None
    xi: Array | None
    xihat: Array
    own: NDArray[np.bool_] | None = None
    leads: Array | None = None
    relative: bool = False

    def draw(self, seed: int) -> Start:
        rng = np.random.default_rng(seed)
        x, xi = self.x, self.xi
        if x is None:
            with np.errstate(all="ignore"):
                x = self.low + (self.high - self.low) * rng.random(self.low.shape)
        if xi is None:
            n, q = self.xihat.shape
            directions, exponent = rng.standard_normal((n, q)), 1 / max(1, q)
            if self.own is not None:
                directions, exponent = (
                    directions * self.own,
                    1 / self.own.sum(axis=1, keepdims=True),
                )
            lengths = np.linalg.norm(directions, axis=1, keepdims=True)
            xi = (
                self.radius
                * rng.random((n, 1)) ** exponent
                * directions
                / np.maximum(lengths, 1e-300)
            )
        s = np.zeros(0)
        if self.leads is not None:
            s = self.leads[0] + (self.leads[1] - self.leads[0]) * rng.random(self.leads.shape[1])
            x = x + s if self.relative else x
        return Start(x=x, xi=xi, xihat=self.xihat, s=s)


def make_starts(problem: Problem, loop: Loop, given: Given | None) -> Starts:
    """Decide where runs start: as given, by [simulation], by the region, or around the goal.
    Raises: SpecError."""
    n, m, q, region, x0, xi0 = (
        loop.n,
        loop.m,
        loop.q,
        problem.region,
        problem.simulation.x0,
        problem.simulation.xi0,
    )
    sizes = {"x": (m, "component"), "xi": (q, "exosystem state"), "xihat": (q, "exosystem state")}
    parts = {name: value for name, value in _parts(given, n, sizes).items() if value is not None}
    rows = {name: _rows(value, f"start.{name}", n, *sizes[name]) for name, value in parts.items()}
    # states that an agent does not have
    others = np.zeros((n, q), dtype=bool) if loop.own is None else ~loop.own
    for name in sorted(rows.keys() - {"x"}):
        foreign = (rows[name] * others).any(axis=1)
        if foreign.any():
            message = (
                "must be 0 in the states that belong to other groups; row "
                f"{int(foreign.argmax())} is not."
            )
            cure = "Each row holds the states of all groups, in the order of problem.groups."
            raise wrong(f"start.{name}", message, cure)
    x, xi, xihat, radius = rows.get("x"), rows.get("xi"), rows.get("xihat", np.zeros((n, q))), 0.0
    if x is None and x0 is not None:
        x = np.array(np.broadcast_to(to_float(x0), (n, m)))
    low, high = loop.goal - AWAY, loop.goal + AWAY
    if region is not None:
        low, high = (np.broadcast_to(side, (n, m)) for side in to_float(region.initial_states).T)
    if xi is None and xi0 is not None:
        xi = _placed(xi0, loop)
    if xi is None and region is not None and region.initial_disturbance is not None:
        radius = float(region.initial_disturbance)
    elif xi is None:
        xi = np.ones((n, q)) if loop.own is None else loop.own.astype(float)
    leads = None if problem.leader is None else to_float(problem.leads).T
    led: dict[str, Any] = {"leads": leads, "relative": x is None and region is None}
    return Starts(low=low, high=high, radius=radius, x=x, xi=xi, xihat=xihat, own=loop.own, **led)


def _placed(rows: Sequence[Vector], loop: Loop) -> Array:
    """xi0 of the problem, one row for all agents or one each, where the states of an agent's own
    exosystem are."""
    if loop.own is None:
        return np.array(np.broadcast_to(to_float(tuple(rows)), (loop.n, loop.q)))
    xi = np.zeros((loop.n, loop.q))
    for agent in range(loop.n):
        xi[agent, loop.own[agent]] = to_float((rows[agent if len(rows) > 1 else 0],))[0]
    return xi


def _parts(given: Given | None, n: int, sizes: Mapping[str, tuple[int, str]]) -> Mapping[str, Any]:
    if given is None:
        return {}
    if isinstance(given, (str, PathLike)):
        return _read(Path(given), n, sizes)
    if isinstance(given, Mapping):
        unknown = sorted(set(map(str, given)) - set(PARTS))
        if unknown:
            raise wrong(
                "start", f"has an unknown part {shown(unknown[0])}.", f"Known: {', '.join(PARTS)}."
            )
        return given
    return {"x": given}


def _rows(value: Any, name: str, n: int, width: int, what: str) -> Array:
    """n rows of ``width`` numbers; one row stands for all agents."""
    because = f"{n} rows of {width}: one per agent, one number per {what}"
    try:
        shape = np.shape(value)
    except ValueError:  # rows of different lengths
        raise wrong(
            name, f"must be {because}; its rows differ in length.", "Fill them.", kind=ShapeError
        ) from None
    if shape == (n,) and width == 1:
        value = np.reshape(value, (n, 1))
    elif shape == (width,):
        value = np.tile(np.asarray(value), (n, 1))
    return finite_array(value, name, shape=(n, width), because=because)


def _read(path: Path, n: int, sizes: Mapping[str, tuple[int, str]]) -> Mapping[str, Any]:
    """The parts of a start in a file; of a trajectory, its last sample."""

    def fits(shapes: Mapping[str, tuple[int, ...]]) -> None:
        for name, shape in shapes.items():
            width, what = sizes[name]
            known = (shape[-2:] == (n, width) and len(shape) <= 3) or shape in (
                (n,) * (width == 1),
                (width,),
            )
            require(
                known,
                f"{name} must have {n} rows of {width}, one number per {what}; got shape {shape}",
            )
        require(shapes, f"it has none of the arrays {', '.join(PARTS)}")

    cure = (
        "Give a CSV file with one row of numbers per agent, or an .npz file with x, xi and xihat."
    )
    with describing(path, key="start", what="start", cure=cure):
        if path.suffix.lower() == ".npz":
            found = read_arrays(path, PARTS, fits)
            return {part: array[-1] if array.ndim == 3 else array for part, array in found.items()}
        rows = csv.reader(
            io.StringIO(read_bytes(path, what="start").decode("utf-8-sig"), newline=""), strict=True
        )
        cells = [(rows.line_num, row) for row in rows if row]
        for line, cell in (
            (line, cell) for line, row in cells for cell in row if not NUMBER.fullmatch(cell)
        ):
            raise UnfitError(f"line {line}: {shown(cell)} is no number")
        return {"x": [list(map(float, row)) for _, row in cells]}


class Options(TypedDict, total=False):
    """The arguments of ``simulate`` that a setting is made of."""

    mode: str | None
    signal: Signal | None
    start: Given | None
    t_final: float | None
    seed: int | None
    samples: int | Sequence[float] | None
    observer: str
    tolerance: float
    stress: Stress | Literal["worst"] | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Setting:
    """The checked arguments of a simulation, and what all its runs share."""

    problem: Problem
    loop: Loop
    groups: Callable[[str], Sequence[ArcGroup]]
    signal: Signal
    starts: Starts
    horizon: float
    seed: int
    times: Array
    observer: str
    tolerance: float
    stress: Stress | None
    notes: tuple[str, ...]

    @property
    def is_full(self) -> bool:
        """Whether the full loop is integrated, as printed: asked for, or needed under a stress."""
        return self.stress is not None or self.observer == "full-loop"


def make_setting(problem: Problem, *, gain: Gain | None, **given: Unpack[Options]) -> Setting:
    """Check the arguments of ``simulate``.  Raises: SpecError."""
    problem = as_integrators(problem)
    mode, untyped = given.get("mode"), dict[str, Any](given)
    signal, stress = untyped.get("signal"), untyped.get("stress")
    stress = worst_stress(problem) if stress == "worst" else stress
    if not (signal is None or isinstance(signal, Signal)):
        cure = "For example Periodic(dwell=0.5); names belong into [switching] of a problem file."
        raise wrong("signal", f"must be a switching signal; got {str(signal)[:40]}.", cure)
    if not (stress is None or isinstance(stress, Stress)):
        raise wrong(
            "stress",
            f"must be a Stress; got {str(stress)[:40]}.",
            'For example Stress(noise=0.1), or "worst".',
        )
    if mode is not None:
        if signal is not None:
            raise SpecError(
                "mode and signal exclude each other.", key="signal", cure="Leave one of them out."
            )
        mode_index(mode, tuple(problem.network.modes))
    observer, t_final, seed = (
        given.get("observer", OBSERVERS[0]),
        given.get("t_final"),
        given.get("seed"),
    )
    if observer not in OBSERVERS:
        message = f"must be one of {', '.join(OBSERVERS)}; got {str(observer)[:40]}."
        raise wrong("observer", message, '"closed-form" is the fast one.')
    horizon = seconds(
        problem.simulation.t_final if t_final is None else t_final, "t_final", example="20"
    )
    if horizon > LONGEST:
        cure = "Choose a shorter horizon, or another unit of time."
        raise wrong(
            "t_final", f"must be at most {LONGEST:g} s, beyond which floats are too coarse.", cure
        )
    loop = make_loop(
        require_floats(problem), no_gain(problem) if observer == "off" and gain is None else gain
    )
    drawn = drawn_graphs(problem)
    if observer == "full-loop" or stress is not None:
        problem.require_no_leader("a stress, or the full loop as printed,")
    times, notes = _times(given.get("samples"), horizon, loop.n * (4 * loop.m + 2 * loop.q))
    if stress is not None:
        stress.failing(problem)  # refuses agents that are not there
    return Setting(
        problem=problem,
        loop=loop,
        groups=cache(lambda name: arc_groups(problem, *drawn.get(name, (name,)))),
        signal=Fixed(mode=mode) if signal is None else signal,
        starts=make_starts(problem, loop, given.get("start")),
        horizon=horizon,
        seed=problem.simulation.seed if seed is None else whole(seed, "seed", least=0),
        times=times,
        observer=observer,
        tolerance=positive(given.get("tolerance", TOLERANCE), "tolerance", example="1e-9"),
        stress=None if stress is None or stress.is_calm else stress,
        notes=(*notes, OFF) if observer == "off" and problem.q else notes,
    )


def closed_form_of(setting: Setting) -> ClosedForm | None:
    """C exp(F t) up to the horizon; None if there is no disturbance, or if it is out of reach."""
    if setting.loop.q == 0:
        return None
    F = setting.loop.A if setting.observer == "off" else setting.loop.F
    return make_closed_form(F, setting.loop.C, setting.horizon)


def is_stiff(setting: Setting, *, closed: bool) -> bool:
    """Whether an explicit method would need too many steps, estimated at the consensus."""
    names = tuple(setting.problem.network.modes)
    if isinstance(setting.signal, Fixed):
        names = (setting.signal.mode or names[0],)
    arcs = [()] if isinstance(setting.signal, Mobile) else map(setting.groups, names)
    fastest = max(fastest_decay(setting.loop, each) for each in arcs)
    return (
        setting.horizon * (fastest if closed else max(fastest, observer_decay(setting.loop)))
        > STIFF
    )


def switches_for(setting: Setting, seed: int) -> Switches:
    """The switches of one run.  A mobile signal must have a given motion."""
    signal = setting.signal
    if isinstance(signal, Mobile):
        if signal.motion is None:
            raise SpecError(
                "the switches follow from the states.", key="signal", cure="Give a motion."
            )
        return motion_switches(signal, signal.motion, setting.problem, setting.horizon)
    return drawn_switches(signal, setting.problem, setting.horizon, seed)


def groups_for(setting: Setting, switches: Switches, mode: int) -> Sequence[ArcGroup]:
    """The arcs of a mode by its index: the problem's own, or those of a mobile graph."""
    if switches.graphs:
        listeners, speakers = switches.graphs[mode]
        return groups_of(setting.problem, listeners * setting.problem.n + speakers)
    return setting.groups(switches.names[mode])


def describe(signal: Signal, problem: Problem) -> str:
    """The mode of a fixed signal by name; else the modes and the signal in words."""
    names = tuple(problem.network.modes)
    if isinstance(signal, Fixed):
        return signal.mode or names[0]
    if isinstance(signal, Mobile):
        return str(signal)
    shown = ", ".join(names[:4]) + (", ..." if len(names) > 4 else "")
    return f"{shown} ({signal})"


def _times(
    samples: int | Sequence[float] | None, horizon: float, width: int
) -> tuple[Array, tuple[str, ...]]:
    if samples is None:
        count = int(min(SAMPLES, max(2, MOST_NUMBERS // max(1, width))))
        note = (
            ()
            if count == SAMPLES
            else (f"{count} samples only, because every one holds {width} numbers.",)
        )
        return np.linspace(0.0, horizon, count), note
    if np.ndim(samples) == 0:
        return np.linspace(0.0, horizon, whole(samples, "samples", least=2)), ()
    times = finite_array(samples, "samples", shape=np.shape(samples), because="one list of times")
    if (
        times.ndim != 1
        or len(times) < 2
        or times[0] != 0
        or times[-1] != horizon
        or (np.diff(times) <= 0).any()
    ):
        message = f"must be a number, or times that increase from 0 to t_final, {horizon:g} s."
        raise wrong("samples", message, "For example 401.")
    return times, ()
