"""What is asked of a trajectory, on samples made by hand."""

from __future__ import annotations

import numpy as np
import pytest

from dobc_design import Trajectory


def made(errors, *, diverged: bool = False, times=None, name: str = "made") -> Trajectory:
    """Two agents; the first is off its goal by the given errors, the second by minus half of them."""
    error = np.asarray(errors, dtype=float)
    T = len(error)
    goal = np.array([[1.0], [3.0]])
    x = goal + np.stack([error, -error / 2], axis=1)[:, :, None]
    empty, zero = np.zeros((T, 2, 0)), np.zeros((T, 2, 1))
    return Trajectory(
        name=name,
        mode="G",
        labels=("a", "b"),
        t_final=10.0,
        seed=0,
        times=np.arange(T, dtype=float) if times is None else np.asarray(times),
        x=x,
        xi=empty,
        xihat=empty.copy(),
        d=zero + 2,
        dhat=zero + 1.5,
        u=zero.copy(),
        goal=goal,
        diverged=diverged,
    )


def test_the_error_is_the_largest_distance_from_a_goal():
    trajectory = made([4, -2, 1])
    assert trajectory.error().tolist() == [4, 2, 1]
    assert trajectory.final_error == 1
    assert trajectory.estimation_error().tolist() == [0.5] * 3


def test_the_settling_time_is_when_the_error_stays_small():
    trajectory = made([4, 0.1, 2, 0.4, 0.5, 0.2])
    assert trajectory.settling_time(0.5) == 3
    assert trajectory.settling_time(5) == 0
    assert trajectory.settling_time(0.3) == 5
    assert trajectory.settling_time(0.1) is None


def test_a_run_that_diverged_never_settled():
    assert made([0.1, 0.1], diverged=True).settling_time(1) is None


def test_an_error_that_is_not_a_number_is_not_small():
    assert made([1, np.nan]).settling_time(2) is None


def test_the_decay_rate_is_the_slope_of_the_logarithm():
    times = np.linspace(0, 3, 20)
    assert made(5 * np.exp(-0.7 * times), times=times).decay_rate() == pytest.approx(0.7)
    assert made(5 * np.exp(0.7 * times), times=times).decay_rate() == pytest.approx(-0.7)


def test_the_decay_rate_leaves_out_what_is_integration_error():
    times = np.linspace(0, 40, 200)
    assert made(np.maximum(np.exp(-times), 1e-9), times=times).decay_rate() == pytest.approx(1)


def test_an_error_of_zero_has_no_decay_rate():
    assert made([0, 0, 0, 0]).decay_rate() is None


def test_without_a_tolerance_settled_means_one_percent_of_the_start():
    assert made([4, 0.05, 0.039, 0.03]).settling_time() == 2
    assert made([4, 0.05]).settling_time() is None


def test_a_trajectory_sums_itself_up_as_an_ensemble_of_one():
    found = made([4, 2, 1]).summary()
    assert found["runs"] == 1
    assert found["final_error"] == {"median": 1, "max": 1}
    assert found["decay_rate"]["median"] == pytest.approx(np.log(2))
    assert found["settling_time"] == {"median": None, "max": None}


def test_a_trajectory_is_a_row_of_samples():
    samples = list(made([4, 2, 1]))
    assert [sample.time for sample in samples] == [0, 1, 2]
    assert {sample.mode for sample in samples} == {"G"}
    assert samples[1].x.tolist() == [[3], [2]]


def test_samples_cannot_be_written_to():
    trajectory = made([1, 2])
    for array in (trajectory.x, trajectory.times, trajectory.goal, trajectory.d):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


def test_a_trajectory_says_where_it_went():
    assert str(made([4, 1])) == 'made: mode "G", ran to 10 s, |e|_inf from 4 to 1'
    assert "diverged at about 1 s of 10 s" in str(made([4, 1e9], diverged=True))
    assert "<b>&lt;i&gt;</b>" in made([1, 2], name="<i>")._repr_html_()
