"""What is asked of the errors of runs: when they settle, how fast they decay, how they spread.

Errors are |e|_inf at every sample, of one run (T,) or of many (R, T), nan from where a run had
ended.
"""

import math
from collections.abc import Sequence
from statistics import median

import numpy as np

from dobc_design.exact.matrix import Array
from dobc_design.exact.reading import Document
from dobc_design.problem.network import BoolArray

RESOLVED = 1e-6  # part of the largest error below which a decay is not read off: integration error
SETTLED = 0.01  # part of the error at the start that counts as settled
LEAST_SAMPLES = 3  # from which a decay is read off


def disagreements(e: Array, sides: Array, *, axis: int) -> Array:
    """How far every s_i e_i is above the least of all agents, which are along ``axis``: the largest
    of them is the largest disagreement."""
    shape = [1] * e.ndim
    shape[axis] = len(sides)
    turned = e * sides.reshape(shape)
    return np.asarray(turned - turned.min(axis=axis, keepdims=True))


def length_of_pairs(e: Array, sides: Array) -> float:
    """Euclidean length of all s_i e_i - s_j e_j stacked, of e (n, m)."""
    apart = e * sides[:, None]
    return math.sqrt(2 * len(e)) * float(np.linalg.norm(apart - apart.mean(axis=0)))


def settling_time(
    times: Array, error: Array, tolerance: float | None, *, diverged: bool
) -> float | None:
    """Time of the first sample from which on error <= tolerance; None if it is not so at the
    end."""
    bound = SETTLED * float(error[0]) if tolerance is None else tolerance
    outside = np.flatnonzero(~(error <= bound))
    if diverged:
        return None
    if not len(outside):
        return float(times[0])
    last = outside[-1]
    return None if last == len(times) - 1 else float(times[last + 1])


def decay_rate(times: Array, error: Array) -> float | None:
    """Slope of -ln(error), by least squares over the samples that are at least RESOLVED of the
    largest."""
    valid = error[np.isfinite(error)]
    if not len(valid):
        return None
    chosen = error > RESOLVED * valid.max()
    if np.count_nonzero(chosen) < LEAST_SAMPLES:
        return None
    # the slope of least squares does not depend on the origin of time
    about = times[chosen] - times[chosen].mean()
    return -float(about @ np.log(error[chosen]) / (about @ about))


def final_errors(error: Array) -> Array:
    """The last error of every run, (R,); nan stands where a run had ended before."""
    known = np.isfinite(error)
    last = known.shape[1] - 1 - np.argmax(known[:, ::-1], axis=1)
    return np.asarray(error[np.arange(len(error)), last])


def summary(times: Array, error: Array, diverged: BoolArray) -> Document:
    """Medians and maxima over runs; one that never settles counts as later than any time, which is
    None."""
    settled = []
    rates = []
    for row, bad in zip(error, diverged.tolist(), strict=True):
        time = settling_time(times, row, None, diverged=bad)
        settled.append(math.inf if time is None else time)
        rate = decay_rate(times, row)
        if rate is not None:
            rates.append(rate)
    return {
        "runs": len(error),
        "diverged": bool(diverged.any()),
        "diverged_runs": int(diverged.sum()),
        "final_error": _median_and_max(final_errors(error).tolist()),
        "settling_time": _median_and_max(settled),
        "decay_rate": _median_and_max(rates) | {"min": min(rates, default=None)},
    }


def _median_and_max(values: Sequence[float]) -> dict[str, float | None]:
    """Both, or None where there are none or they are not finite."""
    found: dict[str, float | None] = {"median": None, "max": None}
    if values:
        middle = median(values)
        largest = max(values)
        found["median"] = middle if math.isfinite(middle) else None
        found["max"] = largest if math.isfinite(largest) else None
    return found


def quantile(values: Array, level: float) -> Array:
    """The order statistic at ``level`` along the first axis; nan counts as larger than every
    number."""
    place = max(0, math.ceil(level * len(values)) - 1)
    ordered = np.sort(np.where(np.isnan(values), np.inf, values), axis=0)
    return np.asarray(ordered[place])


def quantile_interval(values: Array, level: float, confidence: float) -> tuple[float, float] | None:
    """Bounds of a quantile with this confidence by order statistics, for any distribution; None for
    too few values."""
    from scipy.stats import quantile_test  # slow to import, and hardly ever needed

    test = quantile_test(np.where(np.isnan(values), np.inf, values), p=level)
    low, high = test.confidence_interval(confidence)
    return None if np.isnan(low) or np.isnan(high) else (float(low), float(high))


def proportion_interval(successes: int, count: int, confidence: float) -> tuple[float, float]:
    """Clopper and Pearson's bounds of a probability, after ``successes`` of ``count`` independent
    trials."""
    from scipy.stats import binomtest

    low, high = binomtest(successes, count).proportion_ci(confidence)
    return float(low), float(high)
