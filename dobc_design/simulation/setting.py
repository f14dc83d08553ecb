"""What a simulation was asked for: its checked arguments, and what all its runs share."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import cache
from typing import Any, Literal, TypedDict, Unpack

import numpy as np

from dobc_design._checks import noun
from dobc_design.errors import refused, wrong
from dobc_design.exact.matrix import Array
from dobc_design.exact.reading import Document, Texts, one_of
from dobc_design.loop.arrays import (
    ArcGroups,
    Gain,
    error_arcs,
    mode_index,
    no_gain,
    require_float_errors,
    require_floats,
)
from dobc_design.loop.loop import Loop
from dobc_design.loop.make import errors_of
from dobc_design.loop.timing import Timing, timing_words
from dobc_design.problem.problem import Problem
from dobc_design.problem.readings import check_ticks

from ._arguments import finite_array, positive, seconds, whole
from .closed_form import ClosedForm, make_closed_form
from .field import ClosedLoop, make_closed_loop
from .fixed import MOTION, fixed_nodes
from .integrate import STIFF, fastest_decay, observer_decay
from .mobile import groups_of, motion_switches
from .signals import Fixed, Mobile, Signal, signal_to_json
from .starts import Given, Starts, make_starts
from .stress import EXCHANGE, Stress, stated_bands, stress_to_json, worst_stress
from .switches import Switches, drawn_graphs, drawn_switches

TOLERANCE = 1e-9  # relative, of the integrator; the absolute one is a hundredth of it
SAMPLES = 401
LONGEST = 1e12  # s; there two neighbouring floats are 0.1 ms apart
MOST_NUMBERS = 1 << 26  # in a trajectory whose samples nobody asked for: half a GiB
CLOSED_FORM, FULL_LOOP, WITHOUT = OBSERVERS = ("closed-form", "full-loop", "off")
OFF = "The observer is off: the disturbance is not compensated."


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


@noun(eq=False)
class Setting:
    """The checked arguments of a simulation, and what all its runs share.  ``exact``: the error
    system, of which ``loop`` has the numbers in floats."""

    problem: Problem
    exact: Loop
    loop: ClosedLoop
    groups: Callable[[str], ArcGroups]
    signal: Signal
    starts: Starts
    horizon: float
    seed: int
    times: Array
    observer: str
    tolerance: float
    stress: Stress
    notes: Texts

    def of_seed(self, seed: int) -> Setting:
        """The setting of the run with this seed, where fixed nodes move as it says."""
        if not self.loop.moves or seed == self.seed:
            return self
        nodes = fixed_nodes(self.problem, horizon=self.horizon, seed=seed)
        return replace(self, loop=replace(self.loop, nodes=nodes))

    @property
    def is_full(self) -> bool:
        """Whether the full loop is integrated, as printed: asked for, or needed under a stress."""
        calm = self.stress.is_calm and not self.exact.saturates
        return not calm or self.observer == FULL_LOOP

    @property
    def is_moving(self) -> bool:
        """Whether the graphs of a run follow from its own states."""
        return isinstance(self.signal, Mobile) and self.signal.motion is None

    def under(self, stress: Stress, timing: Timing | None) -> Setting:
        """The same with another stress, and other times of readings and processors."""
        exact = replace(self.exact, timing=timing)
        stress = replace(stress, bands=self.stress.bands)
        return replace(self, exact=exact, stress=stated_times(stress, timing))

    @property
    def residual_matrix(self) -> Array:
        """F of eps' = F eps, d - dhat = C eps: A where nothing is estimated."""
        return self.loop.A if self.observer == WITHOUT else self.loop.F

    @property
    def stress_notes(self) -> Texts:
        """The stress in words."""
        found = []
        timing = self.exact.timing
        if timing is not None:
            how = "at its worst" if self.stress.worst else "by chance"
            late = f", {how}" if timing.is_late else ""
            found.append(f"As stated{late}: {timing_words(timing)}.")
        if not self.own_stress.is_calm:
            found.append(f"Stress: {self.stress}.")
        return tuple(found)

    @property
    def own_stress(self) -> Stress:
        """The stress beside what [readings] and [processor] state."""
        stress = self.stress
        timing = self.exact.timing
        if timing is None:
            return stress
        period = None if timing.sampled else stress.period
        own = replace(stress, period=period, exchange=None, worst=False)
        return own if own.is_calm else replace(own, worst=stress.worst)

    @property
    def stress_json(self) -> str:
        """The stress as JSON, "" for none."""
        return "" if self.own_stress.is_calm else stress_to_json(self.own_stress)

    @property
    def modes_in_words(self) -> str:
        """The mode of a fixed signal by name; else the modes and the signal in words."""
        signal = self.signal
        names = tuple(self.exact.modes)
        if isinstance(signal, Fixed):
            return signal.mode or names[0]
        if isinstance(signal, Mobile):
            return str(signal)
        more = ", ..." if len(names) > 4 else ""
        return f"{', '.join(names[:4])}{more} ({signal})"

    @property
    def facts(self) -> Document:
        """What all runs have in common, as a ``Simulated`` has it."""
        problem, loop = self.problem, self.loop
        return {
            "name": problem.name,
            "mode": self.modes_in_words,
            "labels": problem.network.labels,
            "units": problem.units,
            "t_final": self.horizon,
            "goal": loop.goal.copy(),
            "signal": signal_to_json(self.signal),
            "observer": self.observer,
            "stress": self.stress_json,
            "slack": loop.slack.copy(),
            "sides": loop.sides,
        }

    def closed_form(self) -> ClosedForm | None:
        """C exp(F t) up to the horizon; None if there is no disturbance, or if it is out of
        reach."""
        if self.loop.q == 0:
            return None
        return make_closed_form(self.residual_matrix, self.loop.C, self.horizon)

    def is_stiff(self, *, closed: bool) -> bool:
        """Whether an explicit method would need too many steps, estimated at the consensus;
        ``closed``: the observer's error is not integrated."""
        signal = self.signal
        names = tuple(self.exact.modes)
        if isinstance(signal, Fixed):
            names = (signal.mode or names[0],)
        if isinstance(signal, Mobile):  # who will be near is not known: pins alone
            fastest = fastest_decay(self.loop, ())
        else:
            fastest = max(fastest_decay(self.loop, self.groups(name)) for name in names)
        if not closed:
            fastest = max(fastest, observer_decay(self.loop))
        return self.horizon * fastest > STIFF

    def switches(self, seed: int) -> Switches:
        """The switches of one run.  A mobile signal must have a given motion."""
        signal = self.signal
        if not isinstance(signal, Mobile):
            return drawn_switches(signal, self.problem, self.horizon, seed)
        if signal.motion is None:
            message = "the switches follow from the states."
            raise refused("signal", message, "Give a motion.")
        return motion_switches(signal, signal.motion, self.exact, self.horizon)

    def groups_of(self, switches: Switches, mode: int) -> ArcGroups:
        """The arcs of a mode by its index: the problem's own, or those of a mobile graph."""
        if not switches.graphs:
            return self.groups(switches.names[mode])
        listeners, speakers = switches.graphs[mode]
        return groups_of(self.exact, listeners * self.exact.n + speakers)


def make_setting(problem: Problem, *, gain: Gain | None, **given: Unpack[Options]) -> Setting:
    """Check the arguments of ``simulate``.  Raises: SpecError."""
    exact = errors_of(problem)
    stress = _stress(problem, given.get("stress"))
    signal = _signal(problem, given.get("signal"), given.get("mode"))
    asked, cure = given.get("observer", CLOSED_FORM), '"closed-form" is the fast one.'
    observer = one_of(asked, OBSERVERS, "observer", cure)
    horizon = _horizon(problem, given.get("t_final"))
    require_float_errors(exact)
    require_floats(problem)
    if observer == WITHOUT and gain is None:
        gain = no_gain(exact)
    seed = problem.simulation.seed
    if given.get("seed") is not None:
        seed = whole(given["seed"], "seed", least=0)
    nodes = fixed_nodes(problem, horizon=horizon, seed=seed)
    if isinstance(signal, Mobile):
        problem.require("a mobile signal")
    loop = make_closed_loop(problem, gain, nodes)
    if observer == WITHOUT:
        problem.require("a run without an observer")
    bands = stated_bands(problem)
    if observer == FULL_LOOP or stress is not None or bands:
        problem.require("a stress, or the full loop as printed,")
    width = loop.n * (4 * loop.m + 2 * loop.q)
    times, notes = _times(given.get("samples"), horizon, width)
    if problem.steps:
        times = _whole(times)
    # without a disturbance there is nothing to compensate
    if observer == WITHOUT and problem.q:
        notes = [*notes, OFF]
    stress = replace(stress or Stress(), bands=bands)
    stress.failing(problem)  # refuses agents that are not there
    if exact.timing is not None:
        problem.require("a simulation of [readings], [processor] or steps")
        stress = stated_times(stress, exact.timing)
    starts = make_starts(problem, loop, given.get("start"))
    if loop.moves:
        notes = [*notes, MOTION]
    return Setting(
        problem=problem,
        exact=exact,
        loop=loop,
        groups=cache(_arcs_by_name(problem, exact)),
        signal=signal,
        starts=starts,
        horizon=horizon,
        seed=seed,
        times=times,
        observer=observer,
        tolerance=positive(given.get("tolerance", TOLERANCE), "tolerance", example="1e-9"),
        stress=stress,
        notes=tuple(notes),
    )


def _whole(times: Array) -> Array:
    """Agents that move in steps are seen after each.  Raises: SpecError for a part of a step."""
    horizon = float(times[-1])
    if horizon % 1:
        message = f"must be a whole number of steps (time is discrete); got {horizon:g}."
        raise wrong("t_final", message, f"For example {math.ceil(horizon)}.")
    return np.unique(np.round(times))


# readings in the shortest time that they may be late; at the worst more of them, all nearly as late
AT_ONCE, AT_WORST, AT_A_KNOWN_TIME = 2, 4, 8
MOST_PARTS = 10**9  # of a second, of which a period has a whole number


def stated_times(stress: Stress, timing: Timing | None) -> Stress:
    """The stress with the instants at which agents sample or exchange as stated.  Raises: SpecError
    for options that say otherwise."""
    if timing is None:
        return stress
    if timing.ahead and (stress.noise or stress.acts):
        message = "has noise or a disturbance, and with actuators.delay runs know none of them."
        raise refused("stress", message, "Leave them out, or the delay.")
    period = float(timing.period) or None
    table = "[processor]" if timing.sampled else "[readings]"
    if timing.steps:
        table = 'time = "discrete"'
    names = ["exchange"]
    if period and not (timing.sampled and stress.period == period):
        names.append("period")
    if timing.sampled:
        names.append("sampled_gain")
    for name in names:
        if getattr(stress, name) is not None:
            message = f"is no stress where the problem has {table}, which says it."
            raise wrong(name, message, "Leave it out, or change the problem.")
    if timing.sampled:
        return replace(stress, period=period)
    if timing.ahead and stress.period:
        near = Fraction(stress.period).limit_denominator(MOST_PARTS)
        check_ticks(timing.ahead, near, key="period")
    # everything is sampled then, with ages that count in its ticks
    if stress.period or not (period or timing.is_late):
        return stress
    late = [float(x) for x in (timing.delay, timing.own_delay) if x]
    count = AT_WORST if stress.worst else AT_ONCE
    if timing.ahead:  # a known delay, not a bound
        count = AT_A_KNOWN_TIME
    exchange = min(late) / count if late else EXCHANGE
    return replace(stress, exchange=period or exchange)


def _stress(problem: Problem, given: Any) -> Stress | None:
    if given == "worst":
        worst = worst_stress(problem)
        if worst == Stress():
            message = (
                "has nothing to apply: the problem bounds no disturbance, no measurement noise, no "
                "readings, no input and no signal."
            )
            cure = 'Give [uncertainty], [actuators] limit, or [switching] guarantee = "dwell".'
            raise wrong("stress", message, cure)
        return worst
    if given is None or isinstance(given, Stress):
        return given
    message = f"must be a Stress; got {str(given)[:40]}."
    raise wrong("stress", message, 'For example Stress(noise=0.1), or "worst".')


def _signal(problem: Problem, given: Any, mode: str | None) -> Signal:
    if given is not None and not isinstance(given, Signal):
        message = f"must be a switching signal; got {str(given)[:40]}."
        cure = "For example Periodic(dwell=0.5); names belong into [switching] of a problem file."
        raise wrong("signal", message, cure)
    if mode is None:
        return Fixed() if given is None else given
    if given is not None:
        message = "mode and signal exclude each other."
        raise refused("signal", message, "Leave one of them out.")
    mode_index(mode, tuple(problem.network.modes))  # refuses one that is not there
    return Fixed(mode=mode)


def _horizon(problem: Problem, given: float | None) -> float:
    asked = problem.simulation.t_final if given is None else given
    horizon = seconds(asked, "t_final", example="20")
    if horizon > LONGEST:
        message = f"must be at most {LONGEST:g} s, beyond which floats are too coarse."
        raise wrong("t_final", message, "Choose a shorter horizon, or another unit of time.")
    return horizon


def _arcs_by_name(problem: Problem, exact: Loop) -> Callable[[str], ArcGroups]:
    """The arcs of a mode, or of one of its drawn graphs, by name."""
    drawn = drawn_graphs(problem)

    def arcs(name: str) -> ArcGroups:
        graph = drawn.get(name)
        if graph is None:
            return error_arcs(exact, name)
        return error_arcs(exact, graph.mode, graph.there)

    return arcs


def _times(
    samples: int | Sequence[float] | None, horizon: float, width: int
) -> tuple[Array, list[str]]:
    """The times of samples of ``width`` numbers each, and a note where these are fewer than
    usual."""
    if samples is None:
        count = int(min(SAMPLES, max(2, MOST_NUMBERS // max(1, width))))
        notes = []
        if count < SAMPLES:
            notes.append(f"{count} samples only, because every one holds {width} numbers.")
        return np.linspace(0.0, horizon, count), notes
    if np.ndim(samples) == 0:
        return np.linspace(0.0, horizon, whole(samples, "samples", least=2)), []
    times = finite_array(samples, "samples", shape=np.shape(samples), because="one list of times")
    # a run is integrated up to its last sample
    listed = times.ndim == 1 and len(times) >= 2
    if not (listed and times[0] == 0 and times[-1] == horizon and (np.diff(times) > 0).all()):
        message = f"must be a number, or times that increase from 0 to t_final, {horizon:g} s."
        raise wrong("samples", message, "For example 401.")
    return times, []
