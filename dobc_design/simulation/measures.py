"""What is asked of one run or of many: settling time, decay, medians, and how sure a count of runs makes us."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtr, betaincinv

Array = NDArray[np.float64]

RESOLVED = 1e-6  # part of the largest error below which a decay is not read off: integration error
SETTLED = 0.01  # part of the error at the start that counts as settled


def settling_time(times: Array, error: Array, tolerance: float | None, *, diverged: bool) -> float | None:
    """Time of the first sample from which on error <= tolerance; None if it is not so at the end."""
    bound = SETTLED * float(error[0]) if tolerance is None else tolerance
    outside = np.flatnonzero(~(error <= bound))
    if diverged or (len(outside) and outside[-1] == len(times) - 1):
        return None
    return float(times[outside[-1] + 1 if len(outside) else 0])


def decay_rate(times: Array, error: Array) -> float | None:
    """Slope of -ln(error), by least squares over the samples that are at least RESOLVED of the largest."""
    valid = error[np.isfinite(error)]
    if not len(valid):
        return None
    chosen = error > RESOLVED * valid.max()
    if np.count_nonzero(chosen) < 3:
        return None
    about = times[chosen] - times[chosen].mean()
    return -float(about @ np.log(error[chosen]) / (about @ about))


def final_errors(error: Array) -> Array:
    """The last error of every run, (R,); nan stands where a run had ended before."""
    last = np.isfinite(error).shape[1] - 1 - np.argmax(np.isfinite(error)[:, ::-1], axis=1)
    return np.asarray(error[np.arange(len(error)), last])


def summary(times: Array, error: Array, diverged: NDArray[np.bool_]) -> dict[str, Any]:
    """The contract's numbers: medians and maxima over runs.

    Shapes: times (T,), error (R, T) with nan after the end of a run that diverged, diverged (R,).  A run that never
    settles counts as later than any time, so a median or maximum may be None.  Of rates the least is
    given besides: it is the worst.
    """
    settled = [settling_time(times, row, None, diverged=bool(bad)) for row, bad in zip(error, diverged, strict=True)]
    rates = [rate for row in error if (rate := decay_rate(times, row)) is not None]
    return {
        "runs": len(error),
        "diverged": bool(diverged.any()),
        "diverged_runs": int(diverged.sum()),
        "final_error": _median_and_max(final_errors(error).tolist()),
        "settling_time": _median_and_max([math.inf if t is None else t for t in settled]),
        "decay_rate": _median_and_max(rates) | {"min": min(rates) if rates else None},
    }


def _median_and_max(values: Sequence[float]) -> dict[str, float | None]:
    if not values:
        return {"median": None, "max": None}
    middle = sorted(values)[(len(values) - 1) // 2 : len(values) // 2 + 1]
    found = {"median": sum(middle) / len(middle), "max": max(values)}
    return {name: value if math.isfinite(value) else None for name, value in found.items()}


def quantile(values: Array, level: float) -> Array:
    """The order statistic at ``level`` along the first axis; nan counts as larger than every number."""
    place = max(0, math.ceil(level * len(values)) - 1)
    found = np.sort(np.where(np.isnan(values), np.inf, values), axis=0)[place]
    return np.asarray(found)


def quantile_interval(values: Array, level: float, confidence: float) -> tuple[float, float] | None:
    """Bounds that hold the distribution's quantile with at least this confidence, whatever the distribution is.

    From order statistics and the binomial distribution; None if there are too few values.
    """
    ordered = np.sort(np.where(np.isnan(values), np.inf, values))
    count, tail = len(ordered), (1 - confidence) / 2
    below = bdtr(np.arange(count), count, level)  # P(at most k values lie below the quantile)
    low = int(np.searchsorted(below, tail, side="right")) - 1
    high = int(np.searchsorted(below, 1 - tail, side="left"))
    if low < 0 or high >= count:
        return None
    return float(ordered[low]), float(ordered[high])


def proportion_interval(successes: int, count: int, confidence: float) -> tuple[float, float]:
    """Clopper and Pearson's bounds of a probability, after ``successes`` of ``count`` independent trials."""
    tail = (1 - confidence) / 2
    low = 0.0 if successes == 0 else float(betaincinv(successes, count - successes + 1, tail))
    high = 1.0 if successes == count else float(betaincinv(successes + 1, count - successes, 1 - tail))
    return low, high
