"""A simulated run of the closed loop: samples, and what is usually asked of them.

Numbers of one run in floating point: they illustrate and never decide.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dobc_design._render import escape_html

Array = NDArray[np.float64]

RESOLVED = 1e-6  # part of the largest error below which a decay is not read off: integration error


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Trajectory:
    """Samples of a run in one mode; arrays cannot be written to.

    Shapes: times (T,) in s; x, d, dhat, u (T, n, m); xi, xihat (T, n, q); goal (n, m).  ``diverged`` says that the
    run could not be carried to its end, ``t_final``: the samples are those before.
    """

    name: str
    mode: str
    labels: tuple[str, ...]
    t_final: float
    seed: int
    times: Array
    x: Array
    xi: Array
    xihat: Array
    d: Array
    dhat: Array
    u: Array
    goal: Array
    diverged: bool

    def __post_init__(self) -> None:
        for array in (self.times, self.x, self.xi, self.xihat, self.d, self.dhat, self.u, self.goal):
            array.setflags(write=False)

    def error(self) -> Array:
        """|e|_inf, the largest distance of any component from its goal, at every sample: (T,)."""
        return _largest(self.x - self.goal)

    def estimation_error(self) -> Array:
        """The largest component of d - dhat at every sample: (T,)."""
        return _largest(self.d - self.dhat)

    @property
    def final_error(self) -> float:
        """|e|_inf at the last sample."""
        return float(self.error()[-1])

    def settling_time(self, tolerance: float) -> float | None:
        """Time in s of the first sample from which on |e|_inf <= tolerance; None if it is not so at the end."""
        outside = np.flatnonzero(~(self.error() <= tolerance))
        if self.diverged or (len(outside) and outside[-1] == len(self.times) - 1):
            return None
        return float(self.times[outside[-1] + 1 if len(outside) else 0])

    @property
    def decay_rate(self) -> float | None:
        """Slope of -ln |e|_inf over time in 1/s, fitted by least squares; negative for growth.

        Fitted to the samples in which the error is at least a millionth of its largest value; None if
        these are fewer than three.
        """
        error = self.error()
        chosen = error > RESOLVED * error.max()
        if np.count_nonzero(chosen) < 3:
            return None
        times = self.times[chosen] - self.times[chosen].mean()
        return -float(times @ np.log(error[chosen]) / (times @ times))

    def __str__(self) -> str:
        return f"{self.name}: {self._summary}"

    def __repr__(self) -> str:
        return f"<Trajectory of {self.name}: {self._summary}>"

    def _repr_html_(self) -> str:
        return f"<p><b>{escape_html(self.name)}</b>: {escape_html(self._summary)}</p>"

    @property
    def _summary(self) -> str:
        end = f"diverged at about {self.times[-1]:.4g} s of" if self.diverged else "ran to"
        first, last = self.error()[[0, -1]]
        return f'mode "{self.mode}", {end} {self.t_final:.4g} s, |e|_inf from {first:.4g} to {last:.4g}'


def _largest(values: Array) -> Array:
    return np.asarray(np.abs(values).max(axis=(1, 2)))
