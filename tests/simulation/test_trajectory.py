"""What is asked of one run and of many, and their files: what is read back is what was saved."""

from __future__ import annotations

import builtins
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from dobc_design import Failure, Mobile, Network, Periodic, Problem, Stress, Trajectory, load_problem, load_trajectory
from dobc_design.errors import CertificateError, SpecError
from dobc_design.simulation import trajectory as measures
from dobc_design.simulation.run import simulate
from dobc_design.simulation.trajectory import PLAIN, SAMPLED


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


def test_the_bounds_of_a_proportion_are_those_of_scipy():
    """Clopper and Pearson."""
    for successes, count in [(0, 10), (3, 10), (10, 10), (1, 1000), (997, 1000)]:
        exact = stats.binomtest(successes, count).proportion_ci(0.95, method="exact")
        assert measures.proportion_interval(successes, count, 0.95) == pytest.approx((exact.low, exact.high), abs=1e-9)


@pytest.mark.parametrize(("level", "count"), [(0.5, 6), (0.5, 40), (0.9, 200)])
def test_order_statistics_hold_the_quantile_as_often_as_promised_and_tighter_ones_would_not(level: float, count: int):
    """P(X_(a) <= quantile < X_(b)) by the binomial distribution; uniform values, so that the quantile is known."""
    low, high = measures.quantile_interval(np.arange(count, dtype=float), level, 0.95)
    a, b = int(low) + 1, int(high) + 1

    def covered(a: int, b: int) -> float:
        return stats.binom.cdf(b - 1, count, level) - stats.binom.cdf(a - 1, count, level)

    assert covered(a, b) >= 0.95
    assert stats.binom.cdf(a, count, level) > 0.025
    assert stats.binom.cdf(b - 2, count, level) < 0.975


def test_few_values_hold_no_quantile():
    assert measures.quantile_interval(np.arange(5.0), 0.5, 0.95) is None
    assert measures.quantile_interval(np.arange(6.0), 0.5, 0.95) == (0, 5)


def test_a_run_that_is_not_a_number_is_larger_than_every_number():
    values = np.array([[3.0], [np.nan], [1.0], [2.0]])
    assert measures.quantile(values, 0.5).tolist() == [2]
    assert measures.quantile(values, 0.75).tolist() == [3]
    assert measures.quantile(values, 1.0).tolist() == [np.inf]
    assert measures.quantile(values, 0.01).tolist() == [1]


def test_the_summary_counts_and_says_never_where_a_run_does_not_settle():
    times = np.linspace(0, 10, 101)
    good, slow = np.exp(-times), np.exp(-0.1 * times)
    bad = np.where(times < 5, np.exp(times), np.nan)
    found = measures.summary(times, np.stack([good, slow, bad]), np.array([False, False, True]))
    assert (found["runs"], found["diverged"], found["diverged_runs"]) == (3, True, 1)
    assert found["final_error"] == {"median": pytest.approx(np.exp(-1)), "max": pytest.approx(np.exp(4.9))}
    assert found["settling_time"] == {"median": None, "max": None}
    assert found["decay_rate"] == {"median": pytest.approx(0.1), "max": pytest.approx(1), "min": pytest.approx(-1)}
    found = measures.summary(times, np.stack([good, good, slow]), np.zeros(3, dtype=bool))
    assert found["settling_time"] == {"median": pytest.approx(4.7), "max": None}


def test_the_default_of_settled_is_one_percent_of_the_start():
    times = np.linspace(0, 10, 1001)
    assert measures.settling_time(times, 7 * np.exp(-times), None, diverged=False) == pytest.approx(4.61)
    assert measures.settling_time(times, 7 * np.exp(-times), 0.7, diverged=False) == pytest.approx(2.31)
    assert measures.settling_time(times, np.zeros(1001), None, diverged=False) == 0


def switching() -> Trajectory:
    return simulate(load_problem("paper-switching"), signal=Periodic(dwell=0.3), t_final=2, samples=9)


def mobile() -> Trajectory:
    network = Network.from_arcs([["ä", "b c"]], arrow="listens_to", agents=["ä", "b c", "d"])
    problem = Problem(network=network, coupling="-y", target=[0, 1], name="Ω")
    return simulate(problem, signal=Mobile(radius=1, hysteresis=0.1), t_final=40, samples=11)


def stressed() -> Trajectory:
    stress = Stress(noise=0.1, period=0.25, failures=(Failure(agent="3", time=1.0, kind="freeze"),))
    return simulate(load_problem("paper-switching"), signal=Periodic(dwell=0.3), t_final=2, samples=9, stress=stress)


STORE = "needs the extra: pip install dobc_design[store]"
CASES = {"stressed": stressed, "switching": switching, "mobile, diverged, without disturbance": mobile}


def same(one: Trajectory, other: Trajectory) -> None:
    for name in ("times", "goal", "mode_index", *SAMPLED):
        assert np.array_equal(getattr(one, name), getattr(other, name)), name
        assert getattr(one, name).dtype == getattr(other, name).dtype
    for name in (*PLAIN, "labels", "notes"):
        assert getattr(one, name) == getattr(other, name), name
    assert one.switches == other.switches
    assert str(one) == str(other)


@pytest.mark.parametrize("name", CASES)
def test_an_npz_file_gives_the_trajectory_back(tmp_path, name: str):
    run = CASES[name]()
    same(load_trajectory(run.save(tmp_path / "run.npz")), run)


def test_a_pandas_table_can_be_grouped_by_what_it_names():
    """Columns (quantity, agent, component): errors of all agents in one line, and the mode beside them."""
    pytest.importorskip("pandas", reason=STORE)
    run = mobile()
    frame = run.to_pandas()
    assert frame.columns.names == ["quantity", "agent", "component"]
    assert list(frame["x"].columns) == [(agent, c) for agent in run.labels for c in (1, 2)]
    assert frame["x"].abs().max(axis=1).tolist() == np.abs(run.x).max(axis=(1, 2)).tolist()
    assert frame["mode", "", 0].tolist() == [run.switches.names[k] for k in run.mode_index]
    assert "xi" not in frame.columns.get_level_values("quantity")  # no disturbance, no columns


def test_a_pandas_table_has_a_column_for_every_component():
    pytest.importorskip("pandas", reason=STORE)
    run = switching()
    frame = run.to_pandas()
    assert frame.index.tolist() == run.times.tolist()
    assert frame["x", "3", 1].tolist() == run.x[:, 2, 0].tolist()
    assert frame["xihat", "10", 2].tolist() == run.xihat[:, 9, 1].tolist()
    assert frame["mode", "", 0].tolist() == [sample.mode for sample in run]
    assert frame.shape == (9, 1 + 10 * (4 + 2 * 2))


def test_without_pandas_the_way_out_is_said(monkeypatch):
    run, original = switching(), builtins.__import__

    def refuse(name, *rest):
        if name.partition(".")[0] == "pandas":
            raise ImportError(name)
        return original(name, *rest)

    monkeypatch.setattr(builtins, "__import__", refuse)
    with pytest.raises(SpecError, match="needs the package pandas") as caught:
        run.to_pandas()
    assert "dobc_design[store]" in caught.value.cure


def test_files_are_not_overwritten_unless_asked(tmp_path):
    run = switching()
    path = run.save(tmp_path / "run.npz")
    before = path.read_bytes()
    with pytest.raises(SpecError, match="exists already"):
        mobile().save(path)
    assert path.read_bytes() == before
    mobile().save(path, force=True)
    assert load_trajectory(path).name == "Ω"
    assert [each.name for each in tmp_path.iterdir()] == ["run.npz"]


def test_another_ending_or_a_missing_folder_is_refused(tmp_path):
    with pytest.raises(SpecError, match=r"saved as \.npz"):
        switching().save(tmp_path / "run.csv")
    with pytest.raises(CertificateError, match="cannot be written"):
        switching().save(tmp_path / "no" / "run.npz")


def broken(path: Path, kind: str) -> None:
    if kind == "text":
        path.write_text("words", encoding="utf-8")
    elif kind == "cut":
        switching().save(path)
        path.write_bytes(path.read_bytes()[:-200])
    elif kind == "other arrays":
        np.savez(path, x=np.zeros(3))
    elif kind == "other format":
        np.savez(path, about=np.array('{"format": "else"}'), times=np.zeros(2))
    elif kind == "pickle":
        np.savez(path, about=np.array([{"a": 1}], dtype=object))
    elif kind == "empty":
        path.write_bytes(b"")


@pytest.mark.parametrize("kind", ["text", "cut", "other arrays", "other format", "pickle", "empty", "missing"])
def test_what_is_no_trajectory_is_refused(tmp_path, kind: str):
    path = tmp_path / "run.npz"
    broken(path, kind)
    with pytest.raises(SpecError, match=r"does not hold a trajectory|cannot be read"):
        load_trajectory(path)
