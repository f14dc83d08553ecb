"""Small loops that several tests of simulations share, and runs of them with a given gain."""

from typing import Any

from dobc_design import Ensemble, Exosystem, Network, Observer, Problem, Trajectory
from dobc_design.loop.arrays import Gain
from dobc_design.simulation.many_runs import run_many
from dobc_design.simulation.one_run import run_once
from dobc_design.simulation.setting import make_setting

HARMONIC = Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]])
PRINTED = Observer(W=[["16/5"], ["12/5"]])


def ring(coupling: str = "exp(y) - 1 + y", n: int = 10, **settings) -> Problem:
    """The paper's directed cycle of n agents."""
    network = Network.from_arcs(
        [[i + 1, (i + 1) % n + 1] for i in range(n)], arrow="listens_to", agents=n
    )
    return Problem(network=network, coupling=coupling, **settings)


def single(**settings) -> Problem:
    """One agent by itself, x' = u + d."""
    network = Network.from_arcs({"G": []}, arrow="listens_to", agents=1)
    return Problem(network=network, coupling="y", gains={"1": 2}, **settings)


def pair(coupling: str = "y", **settings) -> Problem:
    """Agent 1 listens to agent 2."""
    network = Network.from_arcs([[1, 2]], arrow="listens_to", agents=2)
    return Problem(network=network, coupling=coupling, **settings)


def planar(**settings) -> Problem:
    """Linear, m = 2, q = 3, two modes, formation, matrix gains, weights."""
    modes = {"one": [[1, 2], [2, 3, 2], [3, 1], [1, 3]], "two": [[1, 3, "1/2"], [2, 1]]}
    given = {
        "coupling": ["2*y1 + y2", "3*y2 - y1"],
        "simulation": {"t_final": 4, "seed": 3, "xi0": [[1, 0, 2], [0, 1, -1], [3, 0, 0]]},
    }
    return Problem(
        network=Network.from_arcs(modes, arrow="listens_to", agents=3),
        target=[1, -2],
        gains={"1": 3, "3": [[2, 1], [-1, 2]]},
        exosystem=Exosystem(A=[[0, 1, 0], [-1, 0, 0], [0, 0, 0]], C=[[1, 0, 1], [0, 1, 0]]),
        observer=Observer(W=[[2, 0], [0, 2], [1, 0]]),
        offsets={"2": [1, 0]},
        **(given | settings),
    )


def simulate(
    problem: Problem, *, gain: Gain | None = None, progress: Any = None, **given: Any
) -> Trajectory:
    """One run with this gain; nothing is designed, and [switching] is not looked at."""
    return run_once(make_setting(problem, gain=gain, **given), progress=progress)


def simulate_many(
    problem: Problem, *, runs: int, gain: Gain | None = None, progress: Any = None, **given
) -> Ensemble:
    """The same for many runs."""
    return run_many(make_setting(problem, gain=gain, **given), runs, progress=progress)
