"""What is asked of the errors of many runs: quantiles, their intervals, and a summary."""

import numpy as np
import pytest
from scipy import stats

from dobc_design.simulation import measures


def test_the_bounds_of_a_proportion_are_those_of_scipy():
    """Clopper and Pearson."""
    for successes, count in [(0, 10), (3, 10), (10, 10), (1, 1000), (997, 1000)]:
        exact = stats.binomtest(successes, count).proportion_ci(0.95, method="exact")
        found = measures.proportion_interval(successes, count, 0.95)
        assert found == pytest.approx((exact.low, exact.high), abs=1e-9)


@pytest.mark.parametrize(("level", "count"), [(0.5, 6), (0.5, 40), (0.9, 200)])
def test_order_statistics_hold_the_quantile_as_often_as_promised_and_tighter_ones_would_not(
    level: float, count: int
):
    """P(X_(a) <= quantile < X_(b)) by the binomial distribution; uniform values, so that the
    quantile is known."""
    low, high = measures.quantile_interval(np.arange(count, dtype=float), level, 0.95)
    a = int(low) + 1
    b = int(high) + 1

    def covered(a: int, b: int) -> float:
        return stats.binom.cdf(b - 1, count, level) - stats.binom.cdf(a - 1, count, level)

    assert covered(a, b) >= 0.95
    assert stats.binom.cdf(a, count, level) > 0.025
    assert stats.binom.cdf(b - 2, count, level) < 0.975
    assert measures.quantile_interval(np.arange(5.0), 0.5, 0.95) is None  # too few


def test_a_run_that_is_not_a_number_is_larger_than_every_number():
    values = np.array([[3.0], [np.nan], [1.0], [2.0]])
    assert measures.quantile(values, 0.5).tolist() == [2]
    assert measures.quantile(values, 0.75).tolist() == [3]
    assert measures.quantile(values, 1.0).tolist() == [np.inf]
    assert measures.quantile(values, 0.01).tolist() == [1]


def test_the_summary_counts_and_says_never_where_a_run_does_not_settle():
    times = np.linspace(0, 10, 101)
    good = np.exp(-times)
    slow = np.exp(-0.1 * times)
    bad = np.where(times < 5, np.exp(times), np.nan)
    diverged = np.array([False, False, True])
    found = measures.summary(times, np.stack([good, slow, bad]), diverged)
    assert found["runs"] == 3
    assert found["diverged"] is True
    assert found["diverged_runs"] == 1
    assert found["final_error"] == {
        "median": pytest.approx(np.exp(-1)),
        "max": pytest.approx(np.exp(4.9)),
    }
    assert found["settling_time"] == {"median": None, "max": None}
    assert found["decay_rate"] == {
        "median": pytest.approx(0.1),
        "max": pytest.approx(1),
        "min": pytest.approx(-1),
    }
    found = measures.summary(times, np.stack([good, good, slow]), np.zeros(3, dtype=bool))
    assert found["settling_time"] == {"median": pytest.approx(4.7), "max": None}
