"""The switching signals of a search: constant ones, and random ones at quite different paces."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.random import Generator

from dobc_design.loop.guarantee import Phase
from dobc_design.loop.make import loop_of
from dobc_design.problem.problem import Problem
from dobc_design.simulation.signals import Fixed, Markov, Scheduled, even_chain
from dobc_design.simulation.switches import ModeTable, Switches, scheduled_switches, table_of

PACES = (5, 20, 80)  # switches in a horizon, on average


def drawn_signals(
    rng: Generator, count: int, problem: Problem, horizon: float, *, longer: float = 1.0
) -> ModeTable:
    """Every third run in one mode, the modes in turn; the others switch at random, at quite
    different paces.  Under a guarantee all keep it, for ``longer`` horizons: modes last as short or
    as long as they may, or as a chain draws."""
    lasting = longer * horizon
    guarantee = loop_of(problem).guarantee
    if guarantee.phases:
        return table_of([_kept(rng, problem, guarantee.phases, lasting) for _ in range(count)])
    names = tuple(problem.network.modes)
    drawn = []
    for run in range(count):
        turn, place = divmod(run, len(names))
        signal: Scheduled
        if guarantee.generator is not None:
            rates = tuple(tuple(map(float, row)) for row in guarantee.generator)
            signal = Markov(generator=rates, start=str(rng.choice(names)))
        elif len(names) == 1 or turn % 3 == 0:
            signal = Fixed(mode=names[place])
        else:
            # No pace is preferred: stays are as long and as short as those of a Poisson process.
            chain = even_chain(horizon / float(rng.choice(PACES)), len(names))
            signal = replace(chain, start=names[place])
        end = horizon if guarantee.generator is None else lasting
        drawn.append(scheduled_switches(signal, names, end, int(rng.integers(2**32))))
    return table_of(drawn)


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
