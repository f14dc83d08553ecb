"""Runs under stress side by side are the same runs one by one; and both are what a loop over agents
gives."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from simulated_runs import (
    EVERYTHING,
    FAILING,
    HARMONIC,
    PRINTED,
    nonlinear_planar,
    require_the_same,
    simulate,
    simulate_many,
)

import dobc_design as dd
from dobc_design import Stress
from dobc_design.errors import SpecError
from dobc_design.simulation.signals import Mobile, Periodic, RandomDwell, Waypoints

CONTINUOUS = {
    "noise": Stress(noise=0.1),
    "saturated": Stress(saturation=1.0),
    "pushed": Stress(disturbance=0.3, frequency=3),
    "pushed for ever": Stress(disturbance=0.3, frequency=0),
    "pushed in resonance": Stress(disturbance=0.3, frequency=1),
    "lost": Stress(loss=0.5, exchange=0.11),
    "failing": Stress(failures=FAILING),
    "everything": EVERYTHING,
}
SAMPLED = {
    "sampled": Stress(period=0.05),
    "too slow": Stress(period=0.4),
    "noise": Stress(period=0.05, noise=0.1),
    "lost": Stress(period=0.05, loss=0.5),
    "all at once": replace(EVERYTHING, exchange=None, period=0.05),
    "constant push": Stress(period=0.1, disturbance=0.3, frequency=0),
}


def agree(problem: dd.Problem, stress: Stress, **given) -> dd.Ensemble:
    """Sampled runs to rounding, others to what the steps of the two integrators are off."""
    own = {"runs": 4, "close": 1e-12}
    if stress.period is None:
        own = {"runs": 2, "close": 3e-8, "t_final": 0.35, "tolerance": 1e-10}
        if stress.failures:
            own["t_final"] = 0.7
    return require_the_same(problem, stress, **(own | given))


EVERY = [*CONTINUOUS.values(), *SAMPLED.values()]


def in_both(name: str, other: str):
    """The stress of this name in continuous time, and the other one of sampled loops."""
    both = [CONTINUOUS[name], SAMPLED[other]]
    return pytest.mark.parametrize("stress", both, ids=["continuous", "sampled"])


@pytest.mark.parametrize("stress", EVERY, ids=[*CONTINUOUS, *SAMPLED])
def test_every_stress_gives_the_runs_that_single_ones_give(stress: Stress):
    """Modes change within the time between two exchanges."""
    signal = RandomDwell(dwell=0.13 if stress.period else 0.07)
    agree(nonlinear_planar(), stress, signal=signal)


@in_both("everything", "all at once")
def test_agents_that_do_not_heed_their_observer_are_the_same_too(stress: Stress):
    agree(nonlinear_planar(), stress, signal=Periodic(dwell=0.3), observer="off")


@in_both("lost", "lost")
def test_graphs_of_a_given_motion_are_shared(stress: Stress):
    positions = [[[0], [1], [2]], [[0], [1], [9]]]
    motion = Waypoints(times=(0, 1), positions=positions)
    signal = Mobile(radius=1.5, motion=motion)
    agree(nonlinear_planar(), stress, signal=signal)


def test_a_gain_for_the_sampled_observer_takes_its_place():
    gain = ((0.1, 0), (0, 0.1), (0.05, 0))
    stress = Stress(period=0.1, sampled_gain=gain)
    agree(nonlinear_planar(), stress, mode="one")


class ByHand:
    """Three agents in a ring with h = sinh, one state each, under everything at once: agent by
    agent, arc by arc."""

    A = np.array([[0.0, 2.0], [-2.0, 0.0]])
    C = np.array([1.0, 0.0])
    W = np.array([3.2, 2.4])
    K = (1.0, 0.0, 0.5)
    arcs = ((0, 1), (1, 2), (2, 0), (0, 2))

    def __init__(self, stress: Stress, seed: int) -> None:
        self.stress = stress
        self.bound = stress.saturation
        self.noise_rng = np.random.default_rng([seed, 2])
        self.loss_rng = np.random.default_rng([seed, 3])
        rng = np.random.default_rng([seed, 4])
        phases = rng.uniform(0, 2 * np.pi, size=(3, 1))
        self.phase = phases[:, 0]
        self.noise = np.zeros(3)
        self.held = {}
        self.stopped = {}

    @staticmethod
    def problem() -> dd.Problem:
        arcs = [[i + 1, j + 1] for i, j in ByHand.arcs]
        network = dd.Network.from_arcs(arcs, arrow="listens_to", agents=3)
        gains = {"1": 1, "3": "1/2"}
        return dd.Problem(
            network=network,
            coupling="sinh(y)",
            gains=gains,
            exosystem=HARMONIC,
            observer=PRINTED,
        )

    def meet(self, time: float, x: np.ndarray, estimate, *, due: bool) -> None:
        """Draw and exchange where it is due, and fail; ``estimate`` gives dhat, once the new noise
        is there."""
        if due:
            noise = self.noise_rng.standard_normal((3, 1))
            self.noise = self.stress.noise * noise[:, 0]
        dhat = estimate()
        commands = [self.command(i, x, dhat) for i in range(3)]
        for failure in self.stress.failures:
            i = int(failure.agent) - 1
            if failure.time > time or i in self.stopped:
                continue
            if failure.kind == "freeze":
                seen = x[i] + self.noise[i]
                self.stopped[i] = (commands[i], seen)
            else:
                self.stopped[i] = (0.0, None)
        if not due:
            return
        draws = self.loss_rng.random(len(self.arcs))
        for arc, drawn in zip(self.arcs, draws, strict=True):
            speaker = arc[1]
            said = x[speaker] + self.noise[speaker]
            if speaker in self.stopped:
                said = self.stopped[speaker][1]
            if drawn >= self.stress.loss or said is None:
                self.held[arc] = said

    def command(self, i: int, x: np.ndarray, dhat: np.ndarray) -> float:
        if i in self.stopped:
            return self.stopped[i][0]
        seen = x[i] + self.noise[i]
        pull = -self.K[i] * seen
        wanted = pull - dhat[i]
        return np.clip(wanted, -self.bound, self.bound)

    def felt(self, x: np.ndarray, dhat: np.ndarray) -> np.ndarray:
        """Couplings and input of every agent."""
        commands = [self.command(i, x, dhat) for i in range(3)]
        total = np.array(commands)
        for (i, _), said in self.held.items():
            if said is not None:
                difference = said - x[i] - self.noise[i]
                total[i] += np.sinh(difference)
        return total

    def push(self, time: float) -> np.ndarray:
        angle = self.stress.frequency * time + self.phase
        return self.stress.disturbance * np.sin(angle)

    def continuous(self, x: np.ndarray, xi: np.ndarray, end: float) -> np.ndarray:
        """x at the end, from xihat = 0: SciPy from one meeting to the next."""
        A = self.A
        C = self.C
        W = self.W
        spacing = self.stress.exchange
        due = [spacing * k for k in range(round(end / spacing))]
        moments = {*due, *(failure.time for failure in self.stress.failures), end}
        times = sorted(moments)
        arrays = [x, xi.ravel(), -np.outer(x, W).ravel()]
        y = np.concatenate(arrays)

        def known(y: np.ndarray) -> np.ndarray:
            injection = np.outer(y[:3] + self.noise, W)
            return y[9:].reshape(3, 2) + injection

        def rate(time: float, y: np.ndarray) -> np.ndarray:
            xi = y[3:9].reshape(3, 2)
            xihat = known(y)
            felt = self.felt(y[:3], xihat @ C)
            error_matrix = (A - np.outer(W, C)).T
            z = xihat @ error_matrix - np.outer(felt, W)
            x_dot = felt + xi @ C + self.push(time)
            xi_dot = (xi @ A.T).ravel()
            arrays = [x_dot, xi_dot, z.ravel()]
            return np.concatenate(arrays)

        exactly = {"method": "LSODA", "rtol": 1e-10, "atol": 1e-12, "max_step": 0.01}
        for begin, until in pairwise(times):
            self.meet(begin, y[:3], lambda y=y: known(y) @ C, due=begin in due)
            solution = solve_ivp(rate, (begin, until), y, **exactly)
            y = solution.y[:, -1]
        return y[:3]

    def sampled(self, x: np.ndarray, xi: np.ndarray, end: float) -> np.ndarray:
        """The same with everything computed at multiples of the period; integrals by quadrature."""
        A = self.A
        C = self.C
        period = self.stress.period
        nodes, weights = np.polynomial.legendre.leggauss(12)
        nodes = period * (1 + nodes) / 2
        weights = period * weights / 2
        Ad = expm(A * period)
        F = A - np.outer(self.W, C)

        def integral(value) -> np.ndarray:
            pairs = zip(nodes, weights, strict=True)
            return sum(w * value(s) for s, w in pairs)

        Cd = C @ integral(lambda s: expm(A * s)) / period
        L = integral(lambda s: expm(F * s)) @ self.W
        xihat = np.zeros((3, 2))
        before = None
        held = None
        for k in range(round(end / period)):

            def estimate(x=x, xihat=xihat, before=before, held=held, k=k) -> np.ndarray:
                nonlocal found
                found = xihat
                if k:
                    seen = (x + self.noise - before) / period - held - xihat @ Cd
                    found = xihat @ Ad.T + np.outer(seen, L)
                return found @ Cd

            found = xihat
            self.meet(period * k, x, estimate, due=True)
            xihat = found
            before = x + self.noise
            held = self.felt(x, found @ Cd)
            pushed = integral(lambda s, k=k: self.push(period * k + s))
            x = x + period * (held + xi @ Cd) + pushed
            xi = xi @ Ad.T
        return x


@pytest.mark.parametrize("kind", ["continuous", "sampled"])
def test_everything_at_once_is_what_a_loop_over_agents_gives(kind: str):
    """The oracle knows of the code only in which order random numbers are drawn."""
    stress = EVERYTHING if kind == "continuous" else SAMPLED["all at once"]
    rows = [[1.0, 0], [0, 1], [-1, 1]]
    xi = np.array(rows)
    x = [[1], [-1], [0.5]]
    start = {"x": x, "xi": xi}
    given = {"seed": 3, "t_final": 1.5, "samples": 4, "stress": stress}
    run = simulate(ByHand.problem(), start=start, **given)
    function = getattr(ByHand(stress, 3), kind)
    wanted = function(np.array([1, -1, 0.5]), xi, 1.5)
    actual = run.x[-1, :, 0]
    np.testing.assert_allclose(actual, wanted, atol=1e-7)


def test_without_an_exosystem_only_the_push_is_a_disturbance():
    arcs = [[1, 2], [2, 3], [3, 1]]
    network = dd.Network.from_arcs(arcs, arrow="listens_to")
    problem = dd.Problem(network=network, coupling="sin(y)", gains={"1": 1})
    agree(problem, EVERYTHING)


def test_runs_that_leave_the_floats_end_where_single_ones_do_and_the_others_go_on():
    """e' = e^3 - e: some starts escape, and noise only shakes them."""
    arcs = [[1, 2]]
    network = dd.Network.from_arcs(arcs, arrow="listens_to", agents=2)
    region = {"initial_states": [0, 2]}
    problem = dd.Problem(network=network, coupling="y - y**3", region=region)
    many = agree(problem, Stress(noise=0.01), runs=4, t_final=0.5, tolerance=1e-8)
    assert many.diverged.tolist() == [False, False, False, True]
    assert np.isfinite(many.error[~many.diverged]).all()


def test_the_noise_of_a_thousand_runs_spreads_as_its_recursion_says():
    """x' = -k (x + held noise): x+ = a x - (1 - a) noise, a = exp(-k T); the variance goes to s^2
    (1 - a)/(1 + a)."""
    network = dd.Network.from_arcs({"G": []}, arrow="listens_to", agents=1)
    problem = dd.Problem(network=network, coupling="y", gains={"1": 20})
    given = {"t_final": 1.0, "samples": 2, "stress": Stress(noise=0.3), "tolerance": 1e-6}
    many = simulate_many(problem, runs=1000, start=[[0]], **given)
    a = np.exp(-20 * 0.05)
    squares = np.square(many.error[:, -1])
    spread = np.sqrt(squares.mean())
    factor = np.sqrt((1 - a) / (1 + a))
    assert spread == pytest.approx(0.3 * factor, rel=0.1)


@pytest.mark.parametrize("runs", [None, 2])
def test_too_many_exchanges_are_refused_before_anything_is_integrated(runs: int | None):

    with pytest.raises(SpecError, match="2e\\+10 exchanges are too many") as caught:
        dd.simulate(dd.load_problem("paper-fixed"), runs=runs, stress=Stress(exchange=1e-9))
    assert caught.value.key == "exchange"


def test_an_observer_of_a_growing_disturbance_is_followed_through_the_noise():
    """A has an eigenvalue 1: xi grows while eps decays, and every draw makes eps jump."""
    arcs = [[1, 2], [2, 1]]
    network = dd.Network.from_arcs(arcs, arrow="listens_to")
    exosystem = dd.Exosystem(A=[[1]], C=[[1]])
    observer = dd.Observer(W=[[5]])
    problem = dd.Problem(
        network=network,
        coupling="y",
        gains=1,
        exosystem=exosystem,
        observer=observer,
    )
    stress = Stress(noise=0.1, saturation=3.0)
    agree(problem, stress, t_final=1.0)
