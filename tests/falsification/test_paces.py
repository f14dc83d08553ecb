"""The switching signals of a search: some constant, some at several paces, all within a
guarantee."""

from itertools import pairwise

import numpy as np
import pytest
from regional_problems import random_problem as switched_problem

from dobc_design import Problem, Switching
from dobc_design.falsification.paces import drawn_signals


def test_some_runs_keep_their_mode_and_the_others_switch_at_several_paces():
    rng = np.random.default_rng(0)
    signals = drawn_signals(rng, 60, switched_problem(0, modes=2), 10.0)
    switches = []
    for run in range(60):
        switches.append(signals.named(run, ("A", "B")))
    lengths = [len(each) for each in switches]
    assert 15 <= lengths.count(1) <= 25
    assert max(lengths) > 40
    for each in switches:
        times = [time for time, _ in each]
        assert times[0] == 0
        assert times == sorted(times)
        assert times[-1] < 10


@pytest.mark.parametrize("longest", [None, 3])
def test_under_a_guarantee_all_runs_keep_it(longest):
    turns = Switching(guarantee="dwell", dwell=1, longest=longest)
    own = switched_problem(0, modes=3)
    target = [0] * own.m
    kept = Problem(network=own.network, coupling="y", gains={1: 1}, target=target, switching=turns)
    signals = drawn_signals(np.random.default_rng(0), 40, kept, 10.0)
    names = tuple(own.network.modes)
    for run in range(40):
        switches = signals.named(run, names)
        for (before, old), (after, new) in pairwise(switches):
            assert old != new
            assert 1 <= after - before <= (longest or 10)
    first_modes = {signals.named(run, names)[0][1] for run in range(40)}
    assert first_modes == set(names)
