"""The simulator of late readings that proofs are attacked with, against closed forms."""

import numpy as np
import pytest
from oracles.late import (
    AGES,
    MARKS,
    Plant,
    continuous,
    held_error,
    late_runs,
    on_ticks,
    sampled_error,
)
from scipy.linalg import expm

A = np.array([[0.0, 2.0], [-2.0, 0.0]])
C = np.array([[1.0, 0.0]])
W = np.array([[3.2], [2.4]])
ALONE = {"arcs": [], "weights": np.zeros((1, 0))}
CYCLE = [(i, (i + 1) % 10) for i in range(10)]
PINS = np.array([[5.0 if i in (0, 5) else 0.0] for i in range(10)])


def linear(y):
    return 2 * y


def after(plant, bounds, time, *, habit=("oldest", "outward"), start=None):
    """|e|_inf over [3/4 of the time, the time], from ones."""
    e = np.ones((*plant.gains.shape, 1)) if start is None else start
    most = 0.0
    runs = late_runs(plant, bounds, e, np.zeros((len(e), 0, 1)), habit, np.random.default_rng(1))
    for t, x, _ in runs:
        if t > time:
            return most
        if t > 0.75 * time:
            most = max(most, float(np.abs(x).max()))
    return most


@pytest.mark.parametrize(("sigma", "grows"), [(1.45, False), (1.7, True)])
def test_one_agent_with_a_late_reading_of_itself_diverges_from_pi_over_two_on(sigma, grows):
    """e' = -e(t - sigma)."""
    plant = Plant(h=linear, gains=np.ones((1, 1)), **ALONE)
    assert (after(plant, continuous(0, sigma, 0, fastest=1.0), 150) > 1) is grows


@pytest.mark.slow
@pytest.mark.parametrize(("tau", "grows"), [(0.2, False), (0.25, True)])
def test_the_linearised_paper_diverges_from_its_exact_margin_on(tau, grows):
    """0.222832 (theory, section 15)."""
    plant = Plant(arcs=CYCLE, weights=np.ones((1, 10)), h=linear, gains=PINS)
    start = np.random.default_rng(2).normal(size=(10, 1, 1))
    found = after(plant, continuous(tau, tau, 0, fastest=10.0), 20, start=start)
    assert (found > 1) is grows


@pytest.mark.parametrize(("period", "grows"), [(0.28, False), (0.287, True)])
def test_the_linearised_paper_on_a_processor_diverges_from_its_exact_period_on(period, grows):
    """0.283719 (theory, section 15)."""
    plant = Plant(arcs=CYCLE, weights=np.ones((1, 10)), h=linear, gains=PINS)
    start = np.random.default_rng(2).normal(size=(10, 1, 1))
    assert (after(plant, on_ticks(period, 0, 0, 0, 0), 100, start=start) > 1) is grows


@pytest.mark.parametrize(("period", "radius"), [(0.05, 0.919925), (0.1, 0.840267), (0.2, 0.686773)])
def test_the_sampled_observer_of_the_paper_has_the_known_spectral_radius(period, radius):
    F, _ = sampled_error(A, C, W, period)
    assert np.abs(np.linalg.eigvals(F)).max() == pytest.approx(radius, abs=1e-6)


def test_a_held_period_adds_the_integral_of_what_drives():
    F = A - W @ C
    flow, added = held_error(F, C, 0.3)
    assert np.allclose(flow, expm(F * 0.3))
    assert np.allclose(added, C @ np.linalg.solve(F, flow - np.eye(2)))


@pytest.mark.parametrize("ages", AGES)
@pytest.mark.parametrize("marks", MARKS)
def test_no_habit_leaves_the_box_of_one_listener(ages, marks):
    """e_2' = e_1(t') (1 + d) - 2 e_2, e_1' = -e_1: |e_2| <= v_2 exp(-t/2) with v_2 (2 - 1/2) =
    exp(1/2) (1 + 1/4) after one second of delay."""
    plant = Plant(
        arcs=[(1, 0)],
        weights=np.ones((1, 1)),
        h=lambda y: y,
        gains=np.array([[1.0], [1.0]]),
    )
    v = np.array([1.0, np.exp(0.5) * 1.25 / 1.5])[:, None, None]
    bounds = continuous(1.0, 0, 0.25, fastest=2.0)
    r = np.random.default_rng(3)
    start = v * r.choice([-1.0, 1.0], (2, 1, 8))
    for t, e, _ in late_runs(plant, bounds, start, np.zeros((2, 0, 8)), (ages, marks), r):
        assert np.all(np.abs(e) <= v * np.exp(-t / 2) * (1 + 1e-6))
        if t > 8:
            break
