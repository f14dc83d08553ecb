"""The switching signals of a search: constant ones, and random ones at quite different paces."""

from collections.abc import Sequence

import numpy as np
from numpy.random import Generator

from dobc_design.loop.guarantee import Phase
from dobc_design.loop.make import loop_of
from dobc_design.problem.problem import Problem
from dobc_design.simulation._arguments import NumberRows
from dobc_design.simulation.signals import Markov
from dobc_design.simulation.switches import (
    ModeTable,
    Switches,
    constant_signals,
    scheduled_switches,
    table_of,
)

PACES = (5, 20, 80)  # switches in a horizon, on average


def drawn_signals(
    rng: Generator, count: int, problem: Problem, horizon: float, *, longer: float = 1.0
) -> ModeTable:
    """Every third run in one mode, the modes in turn; the others switch at random, at quite
    different paces.  Under a guarantee all keep it, for ``longer`` horizons: modes last as short or
    as long as they may, or as a chain draws."""
    lasting = longer * horizon
    phases = loop_of(problem).guarantee.phases
    if phases:
        return table_of([_kept(rng, problem, phases, lasting) for _ in range(count)])
    generator = loop_of(problem).guarantee.generator
    if generator is not None:
        rates = tuple(tuple(map(float, row)) for row in generator)
        return table_of([_chained(rng, problem, rates, lasting) for _ in range(count)])
    modes = len(problem.network.modes)
    first = np.arange(count) % modes
    if modes == 1:
        return constant_signals(first)
    paces = rng.choice(PACES, count)
    longest = 2 * int(paces.max(initial=1))
    shape = (count, longest)
    # no pace is preferred: stays are as long and as short as those of a Poisson process
    stays = rng.exponential(size=shape) * (horizon / paces)[:, None]
    times = np.zeros((count, 1 + longest))
    times[:, 1:] = np.cumsum(stays, axis=1)
    others = rng.integers(modes, size=shape)
    chosen = np.concatenate([first[:, None], others], axis=1)
    # modes are taken in turn, and each third turn stays constant
    constant = np.arange(count) // modes % 3 == 0
    times[:, 1:][constant] = np.inf
    times[times >= horizon] = np.inf
    return ModeTable(times=times, modes=np.where(np.isinf(times), 0, chosen))


def _chained(
    rng: Generator,
    problem: Problem,
    rates: NumberRows,
    horizon: float,
) -> Switches:
    """The switches that a Markov chain draws, from any mode on."""
    names = tuple(problem.network.modes)
    chain = Markov(generator=rates, start=str(rng.choice(names)))
    return scheduled_switches(chain, names, horizon, int(rng.integers(2**32)))


def _kept(rng: Generator, problem: Problem, phases: Sequence[Phase], horizon: float) -> Switches:
    """The switches of a signal that keeps the phases of the guarantee."""
    names = tuple(problem.network.modes)
    times = []
    modes = []
    time = 0.0
    # a guarantee may say in which phases a signal begins
    firsts = [place for place, phase in enumerate(phases) if phase.first]
    place = int(rng.choice(firsts))
    while time < horizon:
        phase = phases[place]
        times.append(time)
        modes.append(names.index(phase.mode))
        shortest = float(phase.shortest)
        if phase.longest is None:
            # it may last for ever, for which the horizon stands
            longest = rng.choice((2 * shortest, horizon))
        else:
            longest = float(phase.longest)
        time += float(rng.choice((shortest, longest)))
        place = int(rng.choice(phase.successors))
    return Switches(times=np.array(times), modes=np.array(modes), names=names)
