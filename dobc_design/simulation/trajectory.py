"""A simulated run of the closed loop: its samples, what is asked of them or of many runs, and its file."""

from __future__ import annotations

import io
import json
import math
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtr, betaincinv

from dobc_design._show.cards import Card, Shown
from dobc_design.certificate.certificate import Certificate
from dobc_design.certificate.files import write_atomically
from dobc_design.errors import SpecError
from dobc_design.exact.reading import shown
from dobc_design.problem.arrays import Array
from dobc_design.problem.network import IndexArray
from dobc_design.simulation.switches import Switches, one_mode

if TYPE_CHECKING:
    import pandas as pd

    from dobc_design.plotting.look import Sheet
    from dobc_design.plotting.runs import Envelope

FORMAT, VERSION = "dobc-trajectory", 1
SAMPLED = ("x", "xi", "xihat", "d", "dhat", "u")  # (T, n, width)
RESOLVED = 1e-6  # part of the largest error below which a decay is not read off: integration error
SETTLED = 0.01  # part of the error at the start that counts as settled


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


class Simulated(Shown):
    """How runs show themselves."""

    __slots__ = ()

    def __str__(self) -> str:
        return f"{self._card().title}: {self._card().text}"

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {self}>"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Trajectory(Simulated):
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
        for name in ("times", "goal", "mode_index", *SAMPLED):
            getattr(self, name).setflags(write=False)

    def __len__(self) -> int:
        return len(self.times)

    def __iter__(self) -> Iterator[Sample]:
        modes = (self.switches.names[place] for place in self.mode_index)
        return map(Sample, self.times.tolist(), modes, *(getattr(self, name) for name in SAMPLED))

    def error(self) -> Array:
        """|e|_inf, the largest distance of any component from its goal, at every sample: (T,)."""
        return np.asarray(np.abs(self.x - self.goal).max(axis=(1, 2)))

    def estimation_error(self) -> Array:
        """The largest component of d - dhat at every sample: (T,)."""
        return np.asarray(np.abs(self.d - self.dhat).max(axis=(1, 2)))

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
        return settling_time(self.times, self.error(), tolerance, diverged=self.diverged)

    def decay_rate(self) -> float | None:
        """Slope of -ln |e|_inf over time in 1/s, fitted by least squares; negative for growth.

        Fitted to the samples in which the error is at least a millionth of its largest value; None if
        these are fewer than three.
        """
        return decay_rate(self.times, self.error())

    def summary(self) -> dict[str, Any]:
        """The numbers of ``dobc simulate --json``, without its files."""
        return summary(self.times, self.error()[None], np.array([self.diverged]))

    def plot(
        self, *, certificate: Certificate | None = None, envelope: Envelope | None = None, pinned: Sequence[int] = ()
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
        """A table with one row per sample, indexed by time in s; columns (quantity, agent, component), from 1.

        The active mode is in the column ("mode", "", 0).  Raises: SpecError if pandas is not installed.
        """
        try:
            import pandas as pd
        except ImportError:
            message = "to_pandas needs the package pandas, which is not installed."
            cure = "Install it (pip install dobc_design[store]), or use the arrays themselves."
            raise SpecError(message, key="pandas", cure=cure) from None
        modes = np.array(self.switches.names, dtype=object)
        columns: dict[tuple[str, str, int], Any] = {("mode", "", 0): modes[self.mode_index]}
        for name in SAMPLED:
            array = getattr(self, name)
            for i, label in enumerate(self.labels):
                columns |= {(name, label, c + 1): array[:, i, c] for c in range(array.shape[2])}
        frame = pd.DataFrame(columns, index=pd.Index(self.times, name="time"))
        return frame.rename_axis(columns=["quantity", "agent", "component"])

    def save(self, path: str | PathLike[str], *, force: bool = False) -> Path:
        """Write all of it to ``path``, an .npz file, which ``load_trajectory`` reads.

        Raises: SpecError for another ending, or for a file that is there already, unless ``force``.
        """
        place, switches = Path(path), self.switches
        if place.suffix.lower() != ".npz":
            message = f"a trajectory is saved as .npz; got {shown(place.name)}."
            raise SpecError(message, key="path", cure="Choose that ending.")
        facts = {name: getattr(self, name) for name in PLAIN}
        facts |= {"format": FORMAT, "version": VERSION, "labels": self.labels, "notes": self.notes}
        arrays: dict[str, Any] = {
            "times": self.times,
            "about": np.array(json.dumps(facts | {"modes": switches.names}, ensure_ascii=False)),
            "goal": self.goal,
            "switch_times": switches.times,
            "switch_modes": switches.modes,
            "graph_arcs": np.concatenate(switches.graphs or (np.zeros((2, 0), dtype=np.int64),), axis=1),
            "graph_sizes": np.array([graph.shape[1] for graph in switches.graphs], dtype=np.int64),
        }
        arrays |= {name: getattr(self, name) for name in SAMPLED}
        return save_arrays(place, arrays, force=force)

    def _card(self) -> Card:
        end = f"diverged at about {self.times[-1]:.4g} s of" if self.diverged else "ran to"
        first, last = self.error()[[0, -1]]
        text = f'mode "{self.mode}", {end} {self.t_final:.4g} s, |e|_inf from {first:.4g} to {last:.4g}'
        return Card(title=self.name, text=text, lines=self.notes)


PLAIN = tuple(each.name for each in fields(Trajectory) if each.type in {"str", "int", "float", "bool"})


def bound_of(run: Any, certificate: Certificate | None, envelope: Envelope | None) -> Envelope | None:
    """The bound to be drawn with a run: that of the certificate, or the given one.  Raises: SpecError for both."""
    if certificate is None:
        return envelope
    if envelope is not None:
        raise SpecError("certificate and envelope exclude each other.", key="envelope", cure="Leave one of them out.")
    found: Any = certificate.envelope(run)
    return found if found.sources else None


def load_trajectory(path: str | PathLike[str]) -> Trajectory:
    """Read a trajectory that ``Trajectory.save`` wrote.

    Returns: the Trajectory.  Raises: SpecError if the file is none.
    """
    name = shown(Path(path).name)
    try:
        with np.load(path, allow_pickle=False) as stored:
            return _made(json.loads(str(stored["about"])), stored)
    except OSError as error:
        message = f"{name} cannot be read: {error.strerror or error}."
        raise SpecError(message, key="path", cure="Check the path.") from None
    except (ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
        if isinstance(error, SpecError):
            raise
        message = f"{name} does not hold a trajectory ({str(error)[:80]})."
        raise SpecError(message, key="path", cure="Give a file that Trajectory.save wrote.") from None


def _made(facts: Any, arrays: Mapping[str, NDArray[Any]]) -> Trajectory:
    if not isinstance(facts, dict) or facts.get("format") != FORMAT or facts.get("version") != VERSION:
        raise ValueError(f'it must say "format": "{FORMAT}", version {VERSION}')
    ends = np.cumsum(arrays["graph_sizes"])[:-1] if len(arrays["graph_sizes"]) else None
    graphs = () if ends is None else tuple(part.copy() for part in np.split(arrays["graph_arcs"], ends, axis=1))
    switches = Switches(
        times=np.array(arrays["switch_times"]),
        modes=np.array(arrays["switch_modes"]),
        names=tuple(facts["modes"]),
        graphs=graphs,
    )
    given: dict[str, Any] = {name: facts[name] for name in PLAIN if name in facts}
    given |= {name: np.array(arrays[name]) for name in ("times", "goal", *SAMPLED)}
    return Trajectory(labels=tuple(facts["labels"]), notes=tuple(facts["notes"]), switches=switches, **given)


def save_arrays(path: Path, arrays: Mapping[str, Any], *, force: bool) -> Path:
    """Write an .npz file.  Raises: SpecError if the place is taken, unless ``force``, CertificateError if it fails."""
    if path.exists() and not force:
        raise SpecError(f"{shown(str(path))} exists already.", key="path", cure="Replace it with force=True.")
    stream = io.BytesIO()
    np.savez(stream, allow_pickle=False, **arrays)
    write_atomically(path, stream.getvalue())
    return path


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
    """Medians and maxima over runs; one that never settles counts as later than any time, which is None."""
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
    """Bounds of a quantile with this confidence by order statistics, for any distribution; None for too few values."""
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
