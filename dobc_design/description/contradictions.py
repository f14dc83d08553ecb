"""Numbers of a file that cannot be kept together, or that have no effect beside another one:
warnings, in words.

Nothing is decided here: amplitudes and rates are computed in floating point, and no verdict rests
on them.
"""

import math
from collections.abc import Mapping
from fractions import Fraction
from itertools import chain, combinations

import numpy as np

from dobc_design._show.cards import listed
from dobc_design._show.text import significant
from dobc_design.conditions.coverage import asked_radius
from dobc_design.exact.matrix import to_float
from dobc_design.exact.number import nearest
from dobc_design.loop.make import loop_of
from dobc_design.loop.pairs import shared_starts
from dobc_design.loop.timing import Timing
from dobc_design.loop.words import said_of
from dobc_design.problem.problem import Problem
from dobc_design.problem.uncertainty import Actuators

from .meaning import (
    LARGEST_ORDER,
    Sentences,
    disturbance_parts,
    disturbance_starts,
    has_floats,
    observer_excess,
)

ENOUGH = 10  # times the network's rate, with which an observer does all that it can do
LARGE_ERROR = Fraction(1, 2)  # relative, of weights or gains
ALIKE = 0.01  # sines that differ by less, relative to their frequency, may be one


def warnings(problem: Problem) -> tuple[str, ...]:
    """What the file states that cannot hold together, or that changes nothing, in sentences."""
    floats = has_floats(problem)
    found = chain(
        _about_limits(problem, _reached_in_runs(problem) if floats else {}),
        _about_errors(problem),
        _about_sines(problem),
        _about_observer_rates(problem) if floats else (),
        _about_region(problem),
        _about_readings(problem),
        _about_dwell(problem),
    )
    return tuple(dict.fromkeys(found))


def _about_limits(problem: Problem, reached: Mapping[str, float]) -> Sentences:
    """Limits of actuators that the disturbance alone exceeds; ``reached``: label -> the largest
    |d_i| in runs."""
    table = problem.actuators
    if table is None:
        return
    stated = None if table.amplitude is None or not problem.groups else nearest(table.amplitude)
    disturbed = [label for label in problem.network.labels if label not in set(problem.undisturbed)]
    named = {} if stated is None else dict.fromkeys(disturbed, stated)
    for amplitudes, source in ((named, "actuators.amplitude"), (reached, "from simulation.xi0")):
        tight = _within(table, amplitudes)
        if tight:
            yield _limit_warning(tight, amplitudes, source, problem.n)
            break  # the same agents, most often: one warning is enough
    largest = max(reached.values(), default=0.0)
    if stated is not None and stated < largest:
        yield (
            f"The disturbance that simulation.xi0 starts reaches {significant(largest)}, more than "
            f"actuators.amplitude = {significant(stated)}: simulations leave what the proof "
            "assumes."
        )


def _within(table: Actuators, amplitudes: Mapping[str, float]) -> dict[str, Fraction]:
    """The limits below the amplitudes, by label; where none is below, those that are equal."""
    limits = {}
    for label in amplitudes:
        limit = table.limit_of(label)
        if limit is not None:
            limits[label] = limit
    below = {label: limit for label, limit in limits.items() if limit < amplitudes[label]}
    return below or {label: limit for label, limit in limits.items() if limit == amplitudes[label]}


def _limit_warning(
    tight: Mapping[str, Fraction], amplitudes: Mapping[str, float], source: str, n: int
) -> str:
    largest = max(amplitudes[label] for label in tight)
    least = significant(min(tight.values()))
    whose = f"agent {listed(list(tight))}" if len(tight) == 1 else f"agents {listed(list(tight))}"
    if len(tight) == n:
        whose = "every agent"
    relation, leaves = "is below", "the disturbance alone needs more than the actuators can give"
    if all(limit == amplitudes[label] for label, limit in tight.items()):
        relation, leaves = "equals", "cancelling the disturbance leaves nothing for the feedback"
    return (
        f"The actuator limit {least} of {whose} {relation} the disturbance, which reaches "
        f"{significant(largest)} ({source}): {leaves}. Give actuators.limit above "
        f"{significant(largest)}, or a smaller disturbance."
    )


def _reached_in_runs(problem: Problem) -> dict[str, float]:
    """Label -> a bound of |d_i(t)| by component in runs that start at simulation.xi0; nobody whose
    bound is unknown."""
    found = {}
    for group in problem.groups:
        starts = disturbance_starts(problem, group)
        if not starts.size or problem.steps or group.exosystem.order > LARGEST_ORDER:
            continue
        if any(part[0] > 0 or part[2] > 1 for part in disturbance_parts(group.exosystem)):
            continue  # it grows for ever
        # |C xi(t)| is at most the sum of the amplitudes of all parts.
        _, vectors = np.linalg.eig(to_float(group.exosystem.A))
        weights = np.linalg.lstsq(vectors, starts, rcond=None)[0]
        # of C xi, by component and agent
        sizes = np.abs(to_float(group.exosystem.C) @ vectors) @ np.abs(weights)
        largest = np.broadcast_to(sizes.max(axis=0), (len(group.agents),)).tolist()
        # Rounded, so that a limit which is equal is not found to be below by an error of the last
        # digit.
        for label, size in zip(group.agents, largest, strict=True):
            found[label] = float(f"{size:.9g}")
    return found


def _about_errors(problem: Problem) -> Sentences:
    """Errors of weights or gains that are large, or that the agents know about for nothing."""
    table = problem.uncertainty
    if table is None:
        return
    for name, what in (("weights", "arc weight"), ("gains", "gain")):
        error = getattr(table, name)
        if error > LARGE_ERROR:
            yield (
                f"uncertainty.{name} = {significant(error)} says that every {what} may be "
                f"{significant(100 * error)} % off, from {significant(1 - error)} to "
                f"{significant(1 + error)} times what is written. Is a smaller error meant? 5 % is "
                "0.05."
            )
    if not table.known_to_agents and not (table.weights or table.gains):
        yield (
            "uncertainty.known_to_agents = false has no effect: [uncertainty] states no error of "
            "weights or gains. Give weights, such as 0.05, or remove it."
        )


def _about_sines(problem: Problem) -> Sentences:
    """One sine that is given in both units, or typed twice."""
    for group in problem.groups:
        if problem.steps or group.exosystem.order > LARGEST_ORDER:
            continue
        whose = f" of the group of agent {group.name}" if problem.is_grouped else ""
        sines = sorted({part[1] for part in disturbance_parts(group.exosystem) if part[1]})
        for slow, fast in combinations(sines, 2):
            if fast - slow < ALIKE * fast:
                rad = f"{significant(slow, 6)} and {significant(fast, 6)} rad/s"
                hz = f"{significant(slow / math.tau, 6)} and {significant(fast / math.tau, 6)} Hz"
                beat = significant(math.tau / (fast - slow), 3)
                yield (
                    f"The sines of {rad} ({hz}){whose} differ only over {beat} s. Is it one sine, "
                    "typed twice, perhaps in hz and in frequencies? Keep one of them."
                )
            elif abs(fast - math.tau * slow) < 1e-9 * fast:
                number = significant(slow)
                yield (
                    f"The disturbance{whose} has a sine of {number} Hz and one of {number} rad/s. "
                    f"Is it one sine, given in hz and in frequencies? {number} Hz are "
                    f"{significant(fast)} rad/s; keep one of them."
                )


def _about_observer_rates(problem: Problem) -> Sentences:
    """An observer that is much faster than the network."""
    found = observer_excess(problem)
    if found is not None:
        observer, network = found
        yield (
            f"The observer decays at {significant(observer)} 1/s, "
            f"{significant(observer / network)} times as fast as the network "
            f"({significant(network, 3)} 1/s): that amplifies measurement noise, and the agents "
            f"arrive no sooner. A rate of {significant(ENOUGH * network, 2)} 1/s is enough."
        )


def _about_region(problem: Problem) -> Sentences:
    """An estimation error that is as large as the region itself."""
    region = problem.region
    if region is None or not region.initial_disturbance or problem.leader is not None:
        return
    loop = loop_of(problem)
    if loop.agrees:
        reach = max(hi - lo for lo, hi in shared_starts(loop))
    else:
        reach = max(asked_radius(loop))
    error = region.initial_disturbance
    if reach and error >= reach:
        yield (
            f"region.initial_disturbance = {significant(error)} is as large as the region itself, "
            f"which reaches {significant(reach)} {said_of(loop)('from the target')}: such an "
            "estimation error alone can push agents out of it. It is the largest "
            "|xi(0) - xihat(0)| when the proof begins; a smaller one holds once the observers "
            "have settled."
        )


def _about_readings(problem: Problem) -> Sentences:
    """Readings that are not late, and a P of another observer."""
    loop = loop_of(problem)
    if loop.timing == Timing():
        yield "[readings] states nothing: all readings are those of the same instant."
    if loop.is_sampled and any(group.observer.P is not None for group in problem.groups):
        yield (
            "observer.P has no effect: it is about A - W C, and the observer of a processor is "
            "another recursion. Remove it."
        )


def _about_dwell(problem: Problem) -> Sentences:
    """A dwell time that no guarantee lets a proof use."""
    own = problem.switching
    if own is None or own.dwell is None or own.guarantee not in (None, "arbitrary"):
        return
    if len(problem.network.modes) > 1 and own.signal in ("random", "periodic"):
        guarantee = "sequence" if own.signal == "periodic" else "dwell"
        yield (
            f"switching.dwell = {significant(own.dwell)} s counts in simulations only: without a "
            "guarantee a proof allows any switching, however fast. To let the proof use it, write "
            "guarantee "
            f'= "{guarantee}".'
        )
