"""Many simulated runs of the closed loop: their errors, what is asked of them, and their file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, fields
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dobc_design._show.cards import Card
from dobc_design.certificate.certificate import Certificate
from dobc_design.loop.matrices import Array
from dobc_design.problem.network import IndexArray
from dobc_design.simulation import measures
from dobc_design.simulation.npz import ABOUT, arrays_bytes, save_arrays
from dobc_design.simulation.trajectory import Simulated, bound_of

if TYPE_CHECKING:
    from dobc_design.plotting.runs import Envelope

#: The fields that a file holds as JSON.
FACTS = (
    "name",
    "mode",
    "labels",
    "t_final",
    "notes",
    "signal",
    "method",
    "observer",
    "stress",
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Ensemble(Simulated):
    """Runs that differ by their seeds: starts and switches.  Arrays cannot be written to.

    Shapes: seeds (R,); times (T,) in s; error and estimation_error (R, T), |e|_inf and |d -
    dhat|_inf, nan from where a run that diverged had ended; diverged (R,); ended (R,) in s;
    switches (R,), how often a run switched; goal (n, m); lengths (R,), the Euclidean |e| of all
    agents at the start; disturbances (R,), the largest |xi_i - xihat_i| there; states (S, T, n, m),
    x of the first runs, which the figure shows (at most 5, none of very large networks); leader (S,
    T, m), that of these runs, 0 without one. ``reasons`` says by run why it ended early; ``signal``
    and ``stress`` are JSON, ``observer`` as in ``simulate``. ``simulate(problem, seed=seeds[r],
    ...)`` gives run r again, in full.
    """

    name: str
    mode: str
    labels: tuple[str, ...]
    t_final: float
    seeds: IndexArray
    times: Array
    error: Array
    estimation_error: Array
    diverged: NDArray[np.bool_]
    ended: Array
    switches: IndexArray
    reasons: dict[int, str]
    goal: Array
    method: str
    notes: tuple[str, ...]
    signal: str
    observer: str
    stress: str
    lengths: Array
    disturbances: Array
    states: Array
    leader: Array
    loop_sha256: str = ""  # of the problem and W; "" where they were not recorded

    def __post_init__(self) -> None:
        for array in self._arrays().values():
            array.setflags(write=False)

    def _arrays(self) -> dict[str, Any]:
        found = {}
        for each in fields(self):
            value = getattr(self, each.name)
            if isinstance(value, np.ndarray):
                found[each.name] = value
        return found

    def __len__(self) -> int:
        return len(self.seeds)

    def start_size(self) -> tuple[float, float, float]:
        """Over all starts the largest |e|_inf, Euclidean |e| of all agents stacked, and |xi_i -
        xihat_i|."""
        largest = float(self.error[:, 0].max())
        return largest, float(self.lengths.max()), float(self.disturbances.max())

    @property
    def final_error(self) -> Array:
        """|e|_inf at the end of every run, (R,)."""
        return measures.final_errors(self.error)

    def quantiles(self, levels: Sequence[float] = (0.05, 0.5, 0.95)) -> Array:
        """Quantiles of |e|_inf over the runs at every sample: (levels, T); a run that diverged
        counts as infinite."""
        return np.stack([measures.quantile(self.error, level) for level in levels])

    def summary(self) -> dict[str, Any]:
        """The numbers of ``dobc simulate --json``, without its files."""
        return measures.summary(self.times, self.error, self.diverged)

    def plot(
        self,
        *,
        certificate: Certificate | None = None,
        envelope: Envelope | None = None,
        ax: Any = None,
    ) -> Any:
        """States of the first runs, quantile bands of all errors.  The arguments are those of
        ``Trajectory.plot``."""
        from dobc_design.plotting.runs import ensemble_sheet, plot_bands

        bound = bound_of(self, certificate, envelope)
        return ensemble_sheet(self, envelope=bound) if ax is None else plot_bands(ax, self, bound)

    def intervals(self, confidence: float = 0.95) -> dict[str, tuple[float, float] | None]:
        """Confidence intervals for a random run: median final error, probability of divergence.

        Free of assumptions on distributions (order statistics; Clopper and Pearson).  None: too few
        runs.
        """
        final = np.where(self.diverged, np.inf, self.final_error)
        bad = int(self.diverged.sum())
        return {
            "median_final_error": measures.quantile_interval(final, 0.5, confidence),
            "probability_of_divergence": measures.proportion_interval(bad, len(self), confidence),
        }

    def save(self, path: str | PathLike[str], *, force: bool = True) -> Path:
        """Write the arrays to ``path``, an .npz file for ``numpy.load``.  Raises: SpecError."""
        return save_arrays(Path(path), self.to_bytes(), force=force)

    def to_bytes(self) -> bytes:
        """What ``save`` writes."""
        facts: dict[str, Any] = {name: getattr(self, name) for name in FACTS}
        facts |= {"format": "dobc-ensemble", "version": 1}
        about = np.array(json.dumps(facts, ensure_ascii=False))
        return arrays_bytes({ABOUT: about} | self._arrays())

    def _card(self) -> Card:
        bad = int(self.diverged.sum()) or "none"
        final = np.sort(self.final_error)
        ends = f"{bad} diverged, final |e|_inf {final[0]:.3g} to {final[-1]:.3g}"
        text = f'{len(self)} runs of {self.t_final:.4g} s, mode "{self.mode}", {ends}'
        return Card(title=self.name, text=text, lines=self.notes)
