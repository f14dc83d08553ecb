"""What is asked of the errors of many runs: quantiles, their intervals, and a summary."""

import numpy as np
import pytest
from scipy import stats

from dobc_design.simulation import measures


def test_the_bounds_of_a_proportion_are_those_of_scipy():
    """Clopper and Pearson."""
    cases = [(0, 10), (3, 10), (10, 10), (1, 1000), (997, 1000)]
    for successes, count in cases:
        exact = stats.binomtest(successes, count).proportion_ci(0.95, method="exact")
        found = measures.proportion_interval(successes, count, 0.95)
        assert found == pytest.approx((exact.low, exact.high), abs=1e-9)


@pytest.mark.parametrize(("level", "count"), [(0.5, 6), (0.5, 40), (0.9, 200)])
def test_order_statistics_hold_the_quantile_as_often_as_promised_and_tighter_ones_would_not(
    level: float, count: int
):
    """P(X_(a) <= quantile < X_(b)) by the binomial distribution; uniform values, so that the
    quantile is known."""
    values = np.arange(count, dtype=float)
    low, high = measures.quantile_interval(values, level, 0.95)
    a = int(low) + 1
    b = int(high) + 1

    def covered(a: int, b: int) -> float:
        below_b = stats.binom.cdf(b - 1, count, level)
        below_a = stats.binom.cdf(a - 1, count, level)
        return below_b - below_a

    assert covered(a, b) >= 0.95
    assert stats.binom.cdf(a, count, level) > 0.025
    assert stats.binom.cdf(b - 2, count, level) < 0.975
    found = measures.quantile_interval(np.arange(5.0), 0.5, 0.95)
    assert found is None  # too few


def test_a_run_that_is_not_a_number_is_larger_than_every_number():
    column = [[3.0], [np.nan], [1.0], [2.0]]
    values = np.array(column)
    assert measures.quantile(values, 0.5).tolist() == [2]
    assert measures.quantile(values, 0.75).tolist() == [3]
    found = measures.quantile(values, 1.0).tolist()
    assert found == [np.inf]
    assert measures.quantile(values, 0.01).tolist() == [1]


def test_the_summary_counts_and_says_never_where_a_run_does_not_settle():
    times = np.linspace(0, 10, 101)
    good = np.exp(-times)
    slow = np.exp(-0.1 * times)
    bad = np.where(times < 5, np.exp(times), np.nan)
    diverged = np.array([False, False, True])
    error = np.stack([good, slow, bad])
    found = measures.summary(times, error, diverged)
    assert found["runs"] == 3
    assert found["diverged"] is True
    assert found["diverged_runs"] == 1
    median = np.exp(-1)
    expected = {"median": pytest.approx(median), "max": pytest.approx(np.exp(4.9))}
    assert found["final_error"] == expected
    assert found["settling_time"] == {"median": None, "max": None}
    expected = {"median": pytest.approx(0.1), "max": pytest.approx(1), "min": pytest.approx(-1)}
    assert found["decay_rate"] == expected
    error = np.stack([good, good, slow])
    found = measures.summary(times, error, np.zeros(3, dtype=bool))
    expected = {"median": pytest.approx(4.7), "max": None}
    assert found["settling_time"] == expected
