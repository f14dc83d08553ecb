"""Settling, decay, quantiles and confidence, against closed forms and SciPy's own statistics."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from dobc_design.simulation import trajectory as measures


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
