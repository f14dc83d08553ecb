"""Many simulated runs of one problem: their errors over time, and what they say together.

An ensemble illustrates; however many runs converge, nothing is proved.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dobc_design._show.cards import Card, Shown
from dobc_design.simulation import measures
from dobc_design.simulation.trajectory import Bounding, bound_of

if TYPE_CHECKING:
    from dobc_design.plotting.runs import Envelope
    from dobc_design.plotting.sheet import Sheet

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Ensemble(Shown):
    """Runs that differ by their seeds: starts and switches.  Arrays cannot be written to.

    Shapes: seeds (R,); times (T,) in s; error and estimation_error (R, T), |e|_inf and |d - dhat|_inf, nan from where
    a run that diverged had ended; diverged (R,); ended (R,) in s; switches (R,), how often a run switched;
    states (R, T, n, m) or None where nobody asked for them; goal (n, m); lengths (R,), the Euclidean |e| of all agents
    at the start; disturbances (R,), the largest |xi_i - xihat_i| there.  ``reasons`` says by run why it ended early;
    ``signal`` and ``stress`` are JSON, ``observer`` as in ``simulate``.
    ``simulate(problem, seed=seeds[r], ...)`` gives run r again, in full.
    """

    name: str
    mode: str
    labels: tuple[str, ...]
    t_final: float
    seeds: NDArray[np.int64]
    times: Array
    error: Array
    estimation_error: Array
    diverged: NDArray[np.bool_]
    ended: Array
    switches: NDArray[np.int64]
    reasons: dict[int, str]
    goal: Array
    states: Array | None
    method: str
    notes: tuple[str, ...]
    signal: str
    observer: str
    stress: str
    lengths: Array
    disturbances: Array
    loop_sha256: str = ""  # of the problem and W; "" where they were not recorded

    def __post_init__(self) -> None:
        for array in (
            self.seeds,
            self.times,
            self.error,
            self.estimation_error,
            self.diverged,
            self.ended,
            self.lengths,
            self.disturbances,
        ):
            array.setflags(write=False)

    def __len__(self) -> int:
        return len(self.seeds)

    def start_size(self) -> tuple[float, float, float]:
        """Over all starts the largest |e|_inf, Euclidean |e| of all agents stacked, and |xi_i - xihat_i|."""
        return float(self.error[:, 0].max()), float(self.lengths.max()), float(self.disturbances.max())

    @property
    def final_error(self) -> Array:
        """|e|_inf at the end of every run, (R,)."""
        return measures.final_errors(self.error)

    def quantiles(self, levels: Sequence[float] = (0.05, 0.5, 0.95)) -> Array:
        """Quantiles of |e|_inf over the runs at every sample: (levels, T); a run that diverged counts as infinite."""
        return np.stack([measures.quantile(self.error, level) for level in levels])

    def summary(self) -> dict[str, Any]:
        """The numbers of ``dobc simulate --json``, without its files."""
        return measures.summary(self.times, self.error, self.diverged)

    def plot(self, *, certificate: Bounding | None = None, envelope: Envelope | None = None) -> Sheet:
        """Quantile bands of the errors over all runs.  ``certificate``, ``envelope``: as in ``Trajectory.plot``."""
        from dobc_design.plotting.runs import ensemble_sheet

        return ensemble_sheet(self, envelope=bound_of(self, certificate, envelope))

    def intervals(self, confidence: float = 0.95) -> dict[str, tuple[float, float] | None]:
        """Confidence intervals for a random run: median final error, probability of divergence.

        Free of assumptions on distributions (order statistics; Clopper and Pearson).  None: too few runs.
        """
        final = np.where(self.diverged, np.inf, self.final_error)
        return {
            "median_final_error": measures.quantile_interval(final, 0.5, confidence),
            "probability_of_divergence": measures.proportion_interval(int(self.diverged.sum()), len(self), confidence),
        }

    def save(self, path: str | PathLike[str], *, force: bool = False) -> Path:
        """Write the arrays to ``path``, an .npz file for ``numpy.load``.  Raises: SpecError."""
        from dobc_design.simulation.storage import write_whole

        arrays: dict[str, Any] = {
            name: getattr(self, name)
            for name in (
                "seeds",
                "times",
                "error",
                "estimation_error",
                "diverged",
                "ended",
                "switches",
                "goal",
                "states",
                "lengths",
                "disturbances",
            )
            if getattr(self, name) is not None
        }
        words = ("name", "mode", "labels", "t_final", "notes", "signal", "method", "observer", "stress")
        facts = {name: getattr(self, name) for name in words} | {"format": "dobc-ensemble", "version": 1}
        about = np.array(json.dumps(facts, ensure_ascii=False))
        place = Path(path)
        write_whole(place, lambda file: np.savez(file, about=about, allow_pickle=False, **arrays), force=force)
        return place

    def __str__(self) -> str:
        return f"{self.name}: {self._summary}"

    def __repr__(self) -> str:
        return f"<Ensemble of {self.name}: {self._summary}>"

    def _card(self) -> Card:
        return Card(title=self.name, text=self._summary, lines=self.notes)

    @property
    def _summary(self) -> str:
        bad = int(self.diverged.sum())
        final = np.sort(self.final_error)
        return (
            f'{len(self)} runs of {self.t_final:.4g} s, mode "{self.mode}",'
            f" {'none' if bad == 0 else bad} diverged, final |e|_inf {final[0]:.3g} to {final[-1]:.3g}"
        )
