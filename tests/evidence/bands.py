"""Sines of unknown frequencies: gains of random observers against dense sweeps of the frequency,
and final bounds of random networks against runs at the worst frequencies and phases."""

from random import Random

import numpy as np
from evidence.row import Row
from oracles.sines import drawn_network, drawn_observer, left_of, reached_errors, worst_errors

from dobc_design import Network, Observer, Problem, certify, verify
from dobc_design.conditions.accuracy.decide import Accuracy, Peaks

POINTS = 20_001
CLOSE = 1.01  # how many times the largest value on the sweep a gain may be
SMALL = 1e-6  # below which it is not compared
RUNS = 5  # observers for one network


def run(count: int, seed: int) -> Row:
    """``count`` observers, and a fifth as many networks, half of them linear."""
    failures: list[str] = []
    ratios: list[float] = []
    shares: list[float] = []
    for number in range(seed, seed + count):
        _sweep(number, failures, ratios)
    for number in range(seed, seed + max(2, count // RUNS)):
        _network(number, failures, shares)
    notes = [
        f"gain / sweep: {min(ratios):.7f} to {max(ratios):.7f}",
        f"runs reach {min(shares):.3f} to {max(shares):.3f} of a bound",
    ]
    return Row("sines of unknown frequencies against sweeps and runs", count, failures, notes)


def _claim(problem: Problem) -> Accuracy | None:
    certificate = certify(problem)
    claim = next(check for check in certificate.checks if check.id == "accuracy").claim
    if not isinstance(claim, Accuracy) or not verify(certificate, problem).holds:
        return None
    return claim


def _sweep(number: int, failures: list[str], ratios: list[float]) -> None:
    r = Random(f"sweep {number}")
    exosystem, W = drawn_observer(r)
    low = r.randint(0, 60) / 10
    high = low + r.randint(1, 40) / 10
    problem = Problem(
        network=Network.from_arcs([], arrow="listens_to", agents=1),
        coupling="y",
        gains={"1": 2},
        target=[0] * exosystem.outputs,
        exosystem=exosystem,
        observer=Observer(W=W),
        uncertainty={"bands": [[str(low), str(high), 1]]},
    )
    claim = _claim(problem)
    if claim is None or not isinstance(claim.peaks, Peaks):
        failures.append(f"observer {number}: not proved and confirmed by both programs")
        return
    (gains,) = np.array(claim.peaks.bands, dtype=float)
    swept = left_of(exosystem.A, exosystem.C, W, np.linspace(low, high, POINTS)).max(axis=0)
    counted = swept > SMALL
    ratios += (gains[counted] / swept[counted]).tolist()
    if np.any(gains < swept) or np.any(gains > CLOSE * swept + SMALL):
        failures.append(f"observer {number}: gains {gains}, sweep {swept}")


def _network(number: int, failures: list[str], shares: list[float]) -> None:
    coupling = ("y", "tanh(y)")[number % 2]
    network = drawn_network(number, coupling)
    claim = _claim(network.problem)
    if claim is None:
        failures.append(f"network {number}: not proved and confirmed by both programs")
        return
    bounds = np.array([v[0] for v in claim.listed.values()], dtype=float)
    reached = reached_errors(network, number)
    if coupling == "y":
        worst = worst_errors(network)
        if np.any(worst > bounds):
            failures.append(f"network {number}: bounds {bounds}, possible {worst}")
    shares.append(float(np.max(reached / bounds)))
    if np.any(reached > bounds):
        failures.append(f"network {number}: bounds {bounds}, reached {reached}")
