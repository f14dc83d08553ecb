"""A simulated run of the closed loop: its samples, what is asked of them or of many runs, and its
file."""

from __future__ import annotations

import io
import json
import math
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields
from os import PathLike
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtr, betaincinv

from dobc_design._show.cards import Card, Headed
from dobc_design.certificate.certificate import Certificate
from dobc_design.certificate.files import write_atomically
from dobc_design.errors import SpecError
from dobc_design.exact.reading import shown
from dobc_design.problem.arrays import Array
from dobc_design.problem.load import read_bytes
from dobc_design.problem.network import IndexArray
from dobc_design.simulation.switches import Switches, one_mode

if TYPE_CHECKING:
    import pandas as pd

    from dobc_design.plotting.runs import Envelope

FORMAT, VERSION = "dobc-trajectory", 1
SAMPLED = ("x", "xi", "xihat", "d", "dhat", "u")  # (T, n, width)
RESOLVED = 1e-6  # part of the largest error below which a decay is not read off: integration error
SETTLED = 0.01  # part of the error at the start that counts as settled


class Sample(NamedTuple):
    """One instant of a run: time in s, name of the mode; x (n, m), d, dhat, u (n, p), p = m but
    with [dynamics]; xi, xihat (n, q)."""

    time: float
    mode: str
    x: Array
    xi: Array
    xihat: Array
    d: Array
    dhat: Array
    u: Array


class Simulated(Headed):
    """How runs show themselves."""

    __slots__ = ()

    def __str__(self) -> str:
        return f"{self._card().title}: {self._card().text}"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Trajectory(Simulated):
    """Samples of a run; arrays cannot be written to.  Iterating gives one ``Sample`` after the
    other.

    Shapes: times (T,) in s; x (T, n, m); d, dhat, u (T, n, p), the inputs of [dynamics], else p =
    m; xi, xihat (T, n, q); goal (n, m); leader (T, m), 0 without one, to which goals are relative;
    mode_index (T,), the active mode as a place in ``switches.names``.  ``mode`` names the mode, or
    the modes and the signal; ``switches`` holds the exact instants.  ``diverged`` says that the run
    could not be carried to its end, ``t_final``: the samples are those before, and ``reason`` says
    why.  ``method`` names the integrator, ``notes`` say what was chosen.
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
    leader: Array = field(default_factory=lambda: np.zeros(0))  # default: 0
    mode_index: IndexArray = field(init=False)

    def __post_init__(self) -> None:
        if self.switches.names == ("",):
            object.__setattr__(self, "switches", one_mode(self.mode))
        object.__setattr__(self, "mode_index", self.switches.at(self.times))
        if not self.leader.size:
            object.__setattr__(self, "leader", np.zeros((len(self.times), self.x.shape[2])))
        for name in ("times", "goal", "leader", "mode_index", *SAMPLED):
            getattr(self, name).setflags(write=False)

    def __len__(self) -> int:
        return len(self.times)

    def __iter__(self) -> Iterator[Sample]:
        modes = (self.switches.names[place] for place in self.mode_index)
        return map(Sample, self.times.tolist(), modes, *(getattr(self, name) for name in SAMPLED))

    def errors(self) -> Array:
        """e = x - goal, of a leader x - leader - goal: (T, n, m)."""
        return np.asarray(self.x - self.goal - self.leader[:, None])

    def error(self) -> Array:
        """|e|_inf, the largest distance of any component from its goal, at every sample: (T,)."""
        return np.asarray(np.abs(self.errors()).max(axis=(1, 2)))

    def estimation_error(self) -> Array:
        """The largest component of d - dhat at every sample: (T,)."""
        return np.asarray(np.abs(self.d - self.dhat).max(axis=(1, 2)))

    def start_size(self) -> tuple[float, float, float]:
        """Of the start: |e|_inf, the Euclidean |e| of all agents stacked, and the largest |xi_i -
        xihat_i|."""
        e, eps = self.errors()[0], self.xi[0] - self.xihat[0]
        return (
            float(np.abs(e).max()),
            float(np.linalg.norm(e)),
            float(np.linalg.norm(eps, axis=1).max(initial=0.0)),
        )

    @property
    def final_error(self) -> float:
        """|e|_inf at the last sample."""
        return float(self.error()[-1])

    def settling_time(self, tolerance: float | None = None) -> float | None:
        """Time in s of the first sample from which on |e|_inf <= tolerance; None if it is not so at
        the end.

        ``tolerance`` defaults to one percent of the error at the start.
        """
        return settling_time(self.times, self.error(), tolerance, diverged=self.diverged)

    def decay_rate(self) -> float | None:
        """Slope of -ln |e|_inf over time in 1/s, fitted by least squares; negative for growth.

        Fitted to the samples in which the error is at least a millionth of its largest value; None
        if these are fewer than three.
        """
        return decay_rate(self.times, self.error())

    def summary(self) -> dict[str, Any]:
        """The numbers of ``dobc simulate --json``, without its files."""
        return summary(self.times, self.error()[None], np.array([self.diverged]))

    def plot(
        self,
        *,
        certificate: Certificate | None = None,
        envelope: Envelope | None = None,
        pinned: Sequence[int] = (),
        ax: Any = None,
    ) -> Any:
        """States, disturbance and estimate, errors on a logarithmic axis, and the active mode, as
        one figure.

        ``certificate``: what it proves about |e|_inf from this start is drawn into the errors.
        ``envelope``: other bounds of |e|_inf, as points (t, bound), (k, 2), or as a function of
        times, such as ``certify_settling(problem).envelope``.  ``pinned``: indices to be drawn in
        blue.  Returns: a Sheet; with Matplotlib's ``ax`` these axes, with the errors.
        """
        from dobc_design.plotting.runs import plot_error, trajectory_sheet

        bound = bound_of(self, certificate, envelope)
        return (
            trajectory_sheet(self, envelope=bound, pinned=pinned)
            if ax is None
            else plot_error(ax, self, bound)
        )

    def animate(
        self,
        path: str | PathLike[str],
        *,
        arcs: Mapping[str, Sequence[tuple[int, int]]] | None = None,
        force: bool = True,
    ) -> Path:
        """Write the moving network to ``path``, an .html file that loads nothing.

        ``arcs``: (listener, speaker) by mode, for graphs that are not the trajectory's own.
        Raises: SpecError.
        """
        from dobc_design.plotting.animation import write_animation

        return write_animation(self, Path(path), arcs=arcs, force=force)

    def to_pandas(self) -> pd.DataFrame:
        """A table with one row per sample, indexed by time in s; columns (quantity, agent,
        component), from 1.

        The active mode is in the column ("mode", "", 0).  Raises: SpecError if pandas is not
        installed.
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

    def save(self, path: str | PathLike[str], *, force: bool = True) -> Path:
        """Write all of it to ``path``, an .npz file, which ``load_trajectory`` reads.

        Raises: SpecError for another ending, or for a file that is there already where not
        ``force``.
        """
        place = Path(path)
        if place.suffix.lower() != ".npz":
            message = f"a trajectory is saved as .npz; got {shown(place.name)}."
            raise SpecError(message, key="path", cure="Choose that ending.")
        return save_arrays(place, self.to_bytes(), force=force)

    def to_bytes(self) -> bytes:
        """What ``save`` writes."""
        switches = self.switches
        facts = {name: getattr(self, name) for name in PLAIN}
        facts |= {"format": FORMAT, "version": VERSION, "labels": self.labels, "notes": self.notes}
        arrays: dict[str, Any] = {
            "times": self.times,
            "about": np.array(json.dumps(facts | {"modes": switches.names}, ensure_ascii=False)),
            "goal": self.goal,
            **({"leader": self.leader} if self.leader.any() else {}),
            "switch_times": switches.times,
            "switch_modes": switches.modes,
            "graph_arcs": np.concatenate(
                switches.graphs or (np.zeros((2, 0), dtype=np.int64),), axis=1
            ),
            "graph_sizes": np.array([graph.shape[1] for graph in switches.graphs], dtype=np.int64),
        }
        return arrays_bytes(arrays | {name: getattr(self, name) for name in SAMPLED})

    def _card(self) -> Card:
        end = f"diverged at about {self.times[-1]:.4g} s of" if self.diverged else "ran to"
        first, last = self.error()[[0, -1]]
        text = (
            f'mode "{self.mode}", {end} {self.t_final:.4g} s, |e|_inf from {first:.4g} to '
            f"{last:.4g}"
        )
        return Card(title=self.name, text=text, lines=self.notes)


_KINDS: dict[Any, type] = {"str": str, "int": int, "float": float, "bool": bool}
PLAIN = {each.name: _KINDS[each.type] for each in fields(Trajectory) if each.type in _KINDS}
STORED = ("times", "about", "goal", "switch_times", "switch_modes", "graph_arcs", "graph_sizes")
LARGEST = 1 << 28  # bytes of the arrays of a file once unpacked, if the file itself is smaller
LARGEST_FILE = 1 << 31


def bound_of(
    run: Any, certificate: Certificate | None, envelope: Envelope | None
) -> Envelope | None:
    """The bound to be drawn with a run: that of the certificate, or the given one.  Raises:
    SpecError for both."""
    if certificate is None:
        return envelope
    if envelope is not None:
        raise SpecError(
            "certificate and envelope exclude each other.",
            key="envelope",
            cure="Leave one of them out.",
        )
    found: Any = certificate.envelope(run)
    return found if found.sources else None


def load_trajectory(path: str | PathLike[str]) -> Trajectory:
    """Read a trajectory that ``Trajectory.save`` wrote.

    Returns: the Trajectory.  Raises: SpecError if the file is none.
    """
    with describing(
        Path(path), key="path", what="trajectory", cure="Give a file that Trajectory.save wrote."
    ):
        arrays = read_arrays(Path(path), (*STORED, *SAMPLED, "leader"), _require_shapes)
        return _made(json.loads(str(arrays.pop("about"))), arrays)


def require(holds: object, what: str) -> None:
    """Raises: UnfitError, of a file for which this does not hold."""
    if not holds:
        raise UnfitError(what)


def _require_shapes(shapes: Mapping[str, tuple[int, ...]]) -> None:
    """The shapes of a trajectory's arrays must fit each other.  Raises: UnfitError."""
    missing = [name for name in (*STORED, *SAMPLED) if name not in shapes]
    require(not missing, f"it has no array {', '.join(missing)}")
    require(len(shapes["x"]) == len(shapes["xi"]) == 3, "x and xi must be samples of agents")
    (samples, n, m), q, switches = shapes["x"], shapes["xi"][2], shapes["switch_times"][:1]
    p = shapes["u"][2:][-1:]  # inputs of an agent: m but with [dynamics]
    arcs, graphs = shapes["graph_arcs"][1:2], shapes["graph_sizes"][:1]
    wanted = {
        "times": (samples,),
        "goal": (n, m),
        "switch_modes": switches,
        "switch_times": switches,
        "about": (),
    }
    wanted |= dict.fromkeys(("d", "dhat", "u"), (samples, n, *p)) | dict.fromkeys(
        ("xi", "xihat"), (samples, n, q)
    )
    wanted |= {"leader": (samples, m)} if "leader" in shapes else {}
    wanted |= {"graph_arcs": (2, *arcs), "graph_sizes": graphs}
    wrong = [name for name, shape in wanted.items() if shapes[name] != shape]
    require(not wrong, f"the shapes of {', '.join(wrong)} do not fit that of x")
    require(min(samples, n, m, *p, *switches), "it has no samples")


def _made(facts: Any, arrays: Mapping[str, NDArray[Any]]) -> Trajectory:
    known = (
        isinstance(facts, dict)
        and facts.get("format") == FORMAT
        and facts.get("version") == VERSION
    )
    require(known, f'it must say "format": "{FORMAT}", version {VERSION}')
    given: dict[str, Any] = {name: facts[name] for name in PLAIN if name in facts}
    for name, value in given.items():
        fits = type(value) is PLAIN[name] or (PLAIN[name] is float and type(value) is int)
        require(
            fits and math.isfinite(value if PLAIN[name] is float else 0),
            f"{name} is no {PLAIN[name].__name__}",
        )
    lists = [facts[name] for name in ("labels", "notes", "modes")]
    require(all(type(each) is list for each in lists), "labels, notes and modes must be lists")
    texts = [
        *(text for each in lists for text in each),
        *(text for text in given.values() if type(text) is str),
    ]
    readable = all(type(text) is str and text.isprintable() for text in texts)
    require(readable, "a text entry is not text or has control characters")
    times, begins, modes = arrays["times"], arrays["switch_times"], arrays["switch_modes"]
    numbers, sizes, arcs = (arrays[name] for name in ("goal", "graph_sizes", "graph_arcs"))
    whole = all(each.dtype.kind in "iu" for each in (modes, sizes, arcs))
    real = all(
        arrays[name].dtype.kind == "f" for name in ("times", "goal", "switch_times", *SAMPLED)
    )
    require(whole and real, "an array holds numbers of another kind")
    require(
        all(np.isfinite(each).all() for each in (times, begins, numbers)),
        "a time or a goal is not finite",
    )
    ordered = all((np.diff(each) > 0).all() for each in (times, begins)) and begins[0] <= times[0]
    require(ordered and given["t_final"] > 0, "its times do not increase")
    labels, names, n = facts["labels"], facts["modes"], len(numbers)
    require(len(set(labels)) == len(labels) == n, f"it must name {n} different agents")
    require(
        len(set(names)) == len(names) and modes.min() >= 0 and modes.max() < len(names),
        "it has no such mode",
    )
    require(
        len(sizes) in (0, len(names)) and (sizes >= 0).all(),
        "its graphs are not those of its modes",
    )
    require(
        sizes.sum() == arcs.shape[1] and ((arcs >= 0) & (arcs < n)).all(),
        "its arcs are not those of its agents",
    )
    graphs = (
        tuple(part.copy() for part in np.split(arcs, np.cumsum(sizes)[:-1], axis=1))
        if len(sizes)
        else ()
    )
    switches = Switches(times=begins, modes=modes, names=tuple(names), graphs=graphs)
    given |= {
        name: arrays[name] for name in ("times", "goal", "leader", *SAMPLED) if name in arrays
    }
    return Trajectory(labels=tuple(labels), notes=tuple(facts["notes"]), switches=switches, **given)


class UnfitError(ValueError):
    """What a file of arrays says cannot be; the text says what."""


@contextmanager
def describing(path: Path, *, key: str, what: str, cure: str) -> Iterator[None]:
    """Reading ``path``, which ought to be a ``what``: whatever goes wrong is a SpecError that names
    ``key``."""
    try:
        yield
    except SpecError as error:  # there is no such file, or it is none
        raise SpecError(f"{key}: {error.message}", key=key, cure=error.cure) from None
    except MemoryError:
        raise
    except Exception as error:  # noqa: BLE001 - zipfile, zlib, NumPy, csv and json have many words for broken bytes
        reason = str(error) if isinstance(error, UnfitError) else "its bytes are damaged"
        message = f"{key}: {shown(path.name)} does not hold a {what} ({reason})."
        raise SpecError(message, key=key, cure=cure) from None


def read_arrays(
    path: Path, names: Sequence[str], fits: Callable[[Mapping[str, tuple[int, ...]]], None]
) -> dict[str, NDArray[Any]]:
    """The arrays of an .npz file, those of ``names`` that are there; nothing is unpickled.  Sizes
    and shapes are read before the data: ``fits`` sees them, and may raise.  Unpacked, the arrays
    may take LARGEST bytes, or as many as the file has.  Raises: what ``describing`` expects."""
    data = read_bytes(path, limit=LARGEST_FILE, what="file of arrays")
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        listed = {each.filename.removesuffix(".npy"): each for each in archive.infolist()}
        chosen = {name: listed[name] for name in names if name in listed}
        total = sum(each.file_size for each in chosen.values())
        require(
            total <= max(LARGEST, len(data)),
            f"unpacked it would take {total} bytes; at most {LARGEST} are read",
        )
        shapes = {}
        for name, member in chosen.items():
            with archive.open(member) as stream:
                version = np.lib.format.read_magic(stream)
                heads = {
                    (1, 0): np.lib.format.read_array_header_1_0,
                    (2, 0): np.lib.format.read_array_header_2_0,
                }
                shapes[name], _, dtype = heads[version](stream)
                kinds, what = ("U", "text") if name == "about" else ("fiu", "numbers")
                require(dtype.kind in kinds, f"{name} must be {what}")
                size = stream.tell() + math.prod(shapes[name]) * dtype.itemsize
                require(
                    size == member.file_size, f"{name} does not have the size that its head says"
                )
        fits(shapes)
        found = {}
        for name, member in chosen.items():
            with archive.open(member) as stream:
                found[name] = np.lib.format.read_array(stream, allow_pickle=False)
    return found


def arrays_bytes(arrays: Mapping[str, Any]) -> bytes:
    """Arrays as an .npz file."""
    stream = io.BytesIO()
    np.savez(stream, allow_pickle=False, **arrays)
    return stream.getvalue()


def save_arrays(path: Path, data: bytes, *, force: bool) -> Path:
    """Write an .npz file.  Raises: SpecError if the place is taken, unless ``force``,
    CertificateError if it fails."""
    if path.exists() and not force:
        raise SpecError(
            f"{shown(str(path))} exists already.", key="path", cure="Replace it with force=True."
        )
    write_atomically(path, data)
    return path


def settling_time(
    times: Array, error: Array, tolerance: float | None, *, diverged: bool
) -> float | None:
    """Time of the first sample from which on error <= tolerance; None if it is not so at the
    end."""
    bound = SETTLED * float(error[0]) if tolerance is None else tolerance
    outside = np.flatnonzero(~(error <= bound))
    if diverged or (len(outside) and outside[-1] == len(times) - 1):
        return None
    return float(times[outside[-1] + 1 if len(outside) else 0])


def decay_rate(times: Array, error: Array) -> float | None:
    """Slope of -ln(error), by least squares over the samples that are at least RESOLVED of the
    largest."""
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
    """Medians and maxima over runs; one that never settles counts as later than any time, which is
    None."""
    settled = [
        settling_time(times, row, None, diverged=bool(bad))
        for row, bad in zip(error, diverged, strict=True)
    ]
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
    found = {"median": median(values), "max": max(values)}
    return {name: value if math.isfinite(value) else None for name, value in found.items()}


def quantile(values: Array, level: float) -> Array:
    """The order statistic at ``level`` along the first axis; nan counts as larger than every
    number."""
    place = max(0, math.ceil(level * len(values)) - 1)
    found = np.sort(np.where(np.isnan(values), np.inf, values), axis=0)[place]
    return np.asarray(found)


def quantile_interval(values: Array, level: float, confidence: float) -> tuple[float, float] | None:
    """Bounds of a quantile with this confidence by order statistics, for any distribution; None for
    too few values."""
    ordered = np.sort(np.where(np.isnan(values), np.inf, values))
    count, tail = len(ordered), (1 - confidence) / 2
    below = bdtr(np.arange(count), count, level)  # P(at most k values lie below the quantile)
    low = int(np.searchsorted(below, tail, side="right")) - 1
    high = int(np.searchsorted(below, 1 - tail, side="left"))
    return None if low < 0 or high >= count else (float(ordered[low]), float(ordered[high]))


def proportion_interval(successes: int, count: int, confidence: float) -> tuple[float, float]:
    """Clopper and Pearson's bounds of a probability, after ``successes`` of ``count`` independent
    trials."""
    tail = (1 - confidence) / 2
    low = 0.0 if successes == 0 else float(betaincinv(successes, count - successes + 1, tail))
    high = (
        1.0 if successes == count else float(betaincinv(successes + 1, count - successes, 1 - tail))
    )
    return low, high
