"""A simulated run of the closed loop: samples, and what is usually asked of them.

Numbers of one run in floating point: they illustrate and never decide.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from dobc_design._show.cards import Card, Shown
from dobc_design.errors import SpecError
from dobc_design.simulation import measures
from dobc_design.simulation.switches import Switches, one_mode

if TYPE_CHECKING:
    import pandas as pd

    from dobc_design.plotting.runs import Envelope
    from dobc_design.plotting.sheet import Sheet

Array = NDArray[np.float64]
IndexArray = NDArray[np.int64]
SHOWN_MODES = 4  # names in a summary


class Sample(NamedTuple):
    """One instant of a run: time in s, name of the mode; x, d, dhat, u (n, m); xi, xihat (n, q)."""

    time: float
    mode: str
    x: Array
    xi: Array
    xihat: Array
    d: Array
    dhat: Array
    u: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Trajectory(Shown):
    """Samples of a run; arrays cannot be written to.  Iterating gives one ``Sample`` after the other.

    Shapes: times (T,) in s; x, d, dhat, u (T, n, m); xi, xihat (T, n, q); goal (n, m); mode_index (T,), the active mode
    as a place in ``switches.names``.  ``mode`` names the mode, or the modes and the signal; ``switches`` holds the
    exact instants.  ``diverged`` says that the run could not be carried to its end, ``t_final``: the samples are
    those before, and ``reason`` says why.  ``method`` names the integrator, ``notes`` say what was chosen.
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
    reason: str = ""
    method: str = ""
    evaluations: int = 0
    notes: tuple[str, ...] = ()
    signal: str = ""  # as JSON
    observer: str = "closed-form"  # or "full-loop", "off"
    stress: str = ""  # as JSON; "" where there was none
    loop_sha256: str = ""  # of the problem and W; "" where they were not recorded
    switches: Switches = field(default_factory=lambda: one_mode(""))  # default: ``mode`` throughout
    mode_index: IndexArray = field(init=False)

    def __post_init__(self) -> None:
        if self.switches.names == ("",):
            object.__setattr__(self, "switches", one_mode(self.mode))
        object.__setattr__(self, "mode_index", self.switches.at(self.times))
        for array in (self.times, self.x, self.xi, self.xihat, self.d, self.dhat, self.u, self.goal, self.mode_index):
            array.setflags(write=False)

    def __len__(self) -> int:
        return len(self.times)

    def __iter__(self) -> Iterator[Sample]:
        names = self.switches.names
        for k, time in enumerate(self.times.tolist()):
            yield Sample(
                time,
                names[self.mode_index[k]],
                self.x[k],
                self.xi[k],
                self.xihat[k],
                self.d[k],
                self.dhat[k],
                self.u[k],
            )

    def error(self) -> Array:
        """|e|_inf, the largest distance of any component from its goal, at every sample: (T,)."""
        return _largest(self.x - self.goal)

    def estimation_error(self) -> Array:
        """The largest component of d - dhat at every sample: (T,)."""
        return _largest(self.d - self.dhat)

    def start_size(self) -> tuple[float, float, float]:
        """Of the start: |e|_inf, the Euclidean |e| of all agents stacked, and the largest |xi_i - xihat_i|."""
        e, eps = self.x[0] - self.goal, self.xi[0] - self.xihat[0]
        return float(np.abs(e).max()), float(np.linalg.norm(e)), float(np.linalg.norm(eps, axis=1).max(initial=0.0))

    @property
    def final_error(self) -> float:
        """|e|_inf at the last sample."""
        return float(self.error()[-1])

    def settling_time(self, tolerance: float | None = None) -> float | None:
        """Time in s of the first sample from which on |e|_inf <= tolerance; None if it is not so at the end.

        ``tolerance`` defaults to one percent of the error at the start.
        """
        return measures.settling_time(self.times, self.error(), tolerance, diverged=self.diverged)

    def decay_rate(self) -> float | None:
        """Slope of -ln |e|_inf over time in 1/s, fitted by least squares; negative for growth.

        Fitted to the samples in which the error is at least a millionth of its largest value; None if
        these are fewer than three.
        """
        return measures.decay_rate(self.times, self.error())

    def summary(self) -> dict[str, Any]:
        """The numbers of ``dobc simulate --json``, without its files."""
        return measures.summary(self.times, self.error()[None], np.array([self.diverged]))

    def plot(
        self, *, certificate: Bounding | None = None, envelope: Envelope | None = None, pinned: Sequence[int] = ()
    ) -> Sheet:
        """States, disturbance and estimate, errors on a logarithmic axis, and the active mode, as one figure.

        ``certificate``: what it proves about |e|_inf from this start is drawn into the errors.  ``envelope``: other
        bounds of |e|_inf, as points (t, bound), (k, 2), or as a function of times, such as
        ``certify_settling(problem).envelope``.  ``pinned``: indices to be drawn in blue.
        """
        from dobc_design.plotting.runs import trajectory_sheet

        return trajectory_sheet(self, envelope=bound_of(self, certificate, envelope), pinned=pinned)

    def animate(
        self,
        path: str | PathLike[str],
        *,
        arcs: Mapping[str, Sequence[tuple[int, int]]] | None = None,
        force: bool = False,
    ) -> Path:
        """Write the moving network to ``path``: .html, which needs no network, or .gif (needs Pillow).

        ``arcs``: (listener, speaker) by mode, for graphs that are not the trajectory's own.  Raises: SpecError.
        """
        from dobc_design.plotting.animation import write_animation

        return write_animation(self, Path(path), arcs=arcs, force=force)

    def to_pandas(self) -> pd.DataFrame:
        """A table with one row per sample and columns (quantity, agent, component).  Needs pandas.

        Raises: SpecError if pandas is not installed.
        """
        from dobc_design.simulation.tables import to_frame

        return to_frame(self)

    def save(self, path: str | PathLike[str], *, force: bool = False) -> Path:
        """Write all of it to ``path``: .npz, or .parquet (needs pyarrow).  ``load_trajectory`` reads both.

        Raises: SpecError for another ending, or for a file that is there already, unless ``force``.
        """
        from dobc_design.simulation.storage import save_trajectory

        return save_trajectory(self, Path(path), force=force)

    def __str__(self) -> str:
        return f"{self.name}: {self._summary}"

    def __repr__(self) -> str:
        return f"<Trajectory of {self.name}: {self._summary}>"

    def _card(self) -> Card:
        return Card(title=self.name, text=self._summary, lines=self.notes)

    @property
    def _summary(self) -> str:
        end = f"diverged at about {self.times[-1]:.4g} s of" if self.diverged else "ran to"
        first, last = self.error()[[0, -1]]
        return f'mode "{self.mode}", {end} {self.t_final:.4g} s, |e|_inf from {first:.4g} to {last:.4g}'


class Bounding(Protocol):
    """What bounds runs: a ``certificate.certificate.Certificate``."""

    def envelope(self, run: Any) -> Any:
        """A function of times, whose ``sources`` are empty where nothing is proved about the run."""


def bound_of(run: Any, certificate: Bounding | None, envelope: Envelope | None) -> Envelope | None:
    """The bound to be drawn with a run: that of the certificate, or the given one.  Raises: SpecError for both."""
    if certificate is None:
        return envelope
    if envelope is not None:
        raise SpecError("certificate and envelope exclude each other.", key="envelope", cure="Leave one of them out.")
    found: Any = certificate.envelope(run)
    return found if found.sources else None


def _largest(values: Array) -> Array:
    return np.asarray(np.abs(values).max(axis=(1, 2)))
