"""A simulated run of the closed loop, and many of them as an ensemble: their samples, errors and
files."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field, fields
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dobc_design._checks import noun, put
from dobc_design._show.cards import Card, Headed
from dobc_design.certificate.certificate import Certificate
from dobc_design.errors import refused
from dobc_design.exact.matrix import Array
from dobc_design.exact.reading import Document, Table, Texts, shown
from dobc_design.problem.network import BoolArray, IndexArray
from dobc_design.simulation import measures

from .npz import ABOUT, Shapes, arrays_bytes, describing, read_arrays, require, save_arrays
from .switches import Switches, one_mode

if TYPE_CHECKING:
    import pandas as pd

    from dobc_design.plotting.runs import Envelope

FORMAT, VERSION = "dobc-trajectory", 1
SAMPLED = ("x", "xi", "xihat", "d", "dhat", "u")  # (T, n, width)
OPTIONAL = ("leader", "slack", "sides")  # stored where they are not 0
#: The arrays of a file by their axes: samples, agents, state components, inputs, exosystem states,
#: switches, arcs, graphs.
AXES = dict.fromkeys(("d", "dhat", "u"), "Tnp") | dict.fromkeys(("xi", "xihat"), "Tnq")
AXES |= dict.fromkeys(("switch_times", "switch_modes"), "S")
AXES |= {"x": "Tnm", "times": "T", "goal": "nm", ABOUT: "", "graph_arcs": "2a", "graph_sizes": "g"}
AXES |= {"leader": "Tm", "slack": "m", "sides": "n"}


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


STEPS = "steps of agents"  # so the method of runs begins whose times count steps


@noun(eq=False)
class Simulated(Headed):
    """What one run and many have in common, and how they show themselves.

    Shapes: times (T,) in s; goal (n, m); slack (m,), half the sides of the box of the fixed nodes,
    whose middle is the goal then; sides (n,), 1 or by signs -1, where agents agree on a value, and
    errors are disagreements.  ``mode`` names the mode, or the modes and the signal; ``method`` the
    integrator; ``notes`` say what was chosen; ``signal`` and ``stress`` are JSON.
    """

    name: str
    mode: str
    labels: Texts
    t_final: float
    times: Array
    goal: Array
    notes: Texts = ()
    signal: str = ""
    method: str = ""
    observer: str = "closed-form"  # or "full-loop", "off"
    stress: str = ""  # "" where there was none
    units: Texts = ()  # of the m state components, where the problem gives them
    loop_sha256: str = ""  # of the problem and W; "" where they were not recorded
    slack: Array = field(default_factory=lambda: np.zeros(0))  # default: 0
    sides: Array = field(default_factory=lambda: np.zeros(0))  # default: every agent has a goal

    @property
    def clock(self) -> str:
        """The unit of times."""
        return "steps" if self.method.startswith(STEPS) else "s"

    @property
    def measured(self) -> str:
        """What the errors of runs are called."""
        if not self.sides.size:
            return "|e|_inf"
        return "max |x_i - x_j|" if (self.sides > 0).all() else "max |e_i - e_j|"

    def __str__(self) -> str:
        return f"{self._card().title}: {self._card().text}"


@noun(eq=False)
class Trajectory(Simulated):
    """Samples of a run; arrays cannot be written to.  Iterating gives one ``Sample`` after the
    other.

    Shapes beside those of ``Simulated``: x (T, n, m); d, dhat, u (T, n, p), the inputs of
    [dynamics], else p = m; xi, xihat (T, n, q); leader (T, m), 0 without one, to which goals are
    relative; mode_index (T,), the active mode as a place in ``switches.names``, which holds the
    exact instants.  ``diverged`` says that the run could not be carried to its end, ``t_final``:
    the samples are those before, and ``reason`` says why.
    """

    seed: int
    x: Array
    xi: Array
    xihat: Array
    d: Array
    dhat: Array
    u: Array
    diverged: bool
    reason: str = ""
    evaluations: int = 0
    switches: Switches = field(default_factory=lambda: one_mode(""))  # default: ``mode`` throughout
    leader: Array = field(default_factory=lambda: np.zeros(0))  # default: 0
    mode_index: IndexArray = field(init=False)

    def __post_init__(self) -> None:
        # without switches of its own it was in ``mode`` throughout
        if self.switches.names == ("",):
            put(self, switches=one_mode(self.mode))
        put(self, mode_index=self.switches.at(self.times))
        if not self.leader.size:
            put(self, leader=np.zeros((len(self.times), self.x.shape[2])))
        if not self.slack.size:
            put(self, slack=np.zeros(self.x.shape[2]))
        for name in ("times", "goal", "leader", "slack", "sides", "mode_index", *SAMPLED):
            getattr(self, name).setflags(write=False)

    def __len__(self) -> int:
        return len(self.times)

    def __iter__(self) -> Iterator[Sample]:
        modes = (self.switches.names[place] for place in self.mode_index)
        return map(Sample, self.times.tolist(), modes, *(getattr(self, name) for name in SAMPLED))

    def errors(self) -> Array:
        """e = x - goal, of a leader x - leader - goal: (T, n, m); between fixed nodes the distance
        to where they are, with its sign; where agents agree, how far x - goal is above the least
        of all agents."""
        e = self.x - self.goal - self.leader[:, None]
        if self.sides.size:
            return measures.disagreements(e, self.sides, axis=1)
        return e - np.clip(e, -self.slack, self.slack) if self.slack.any() else e

    def error(self) -> Array:
        """|e|_inf, the largest distance of any component from its goal, at every sample: (T,).
        Where agents agree on a value it is their largest disagreement."""
        return np.asarray(np.abs(self.errors()).max(axis=(1, 2)))

    def estimation_error(self) -> Array:
        """The largest component of d - dhat at every sample: (T,)."""
        return np.asarray(np.abs(self.d - self.dhat).max(axis=(1, 2)))

    def start_size(self) -> tuple[float, float, float]:
        """Of the start: |e|_inf, the Euclidean |e| of all agents (where they agree, of all their
        differences) stacked, and the largest |xi_i - xihat_i|."""
        e = self.errors()[0]
        eps = np.linalg.norm(self.xi[0] - self.xihat[0], axis=1)
        length = float(np.linalg.norm(e))
        if self.sides.size:
            length = measures.length_of_pairs(e, np.ones(len(e)))
        return float(np.abs(e).max()), length, float(eps.max(initial=0.0))

    @property
    def final_error(self) -> float:
        """|e|_inf at the last sample."""
        return float(self.error()[-1])

    def settling_time(self, tolerance: float | None = None) -> float | None:
        """Time in s of the first sample from which on |e|_inf <= tolerance; None if it is not so at
        the end.

        ``tolerance`` defaults to one percent of the error at the start.
        """
        return measures.settling_time(self.times, self.error(), tolerance, diverged=self.diverged)

    def decay_rate(self) -> float | None:
        """Slope of -ln |e|_inf over time in 1/s, fitted by least squares; negative for growth.

        Fitted to the samples in which the error is at least a millionth of its largest value; None
        if these are fewer than three.
        """
        return measures.decay_rate(self.times, self.error())

    def summary(self) -> Document:
        """The numbers of ``dobc simulate --json``, without its files."""
        return measures.summary(self.times, self.error()[None], np.array([self.diverged]))

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
        times, such as ``certificate.settling.envelope``.  ``pinned``: indices to be drawn in
        blue.  Returns: a Sheet; with Matplotlib's ``ax`` these axes, with the errors.
        """
        from dobc_design.plotting.runs import plot_error, trajectory_sheet

        bound = bound_of(self, certificate, envelope)
        if ax is not None:
            return plot_error(ax, self, bound)
        ends = None if certificate is None else self.ends(certificate)
        return trajectory_sheet(self, envelope=bound, pinned=pinned, ends=ends)

    def ends(self, certificate: Certificate) -> Array | None:
        """By component between which numbers agents that agree end, (2, m), by a certificate of
        this problem; None where it does not say."""
        value = certificate.value
        # Offsets of a formation differ, so that no number is where all end.
        if value is None or self.stress or self.observer == "off" or self.goal.any():
            return None
        return value.ends(self.x[0], self.xi[0] - self.xihat[0])

    def animate(
        self,
        path: str | PathLike[str],
        *,
        arcs: Mapping[str, Sequence[tuple[int, int]]] | None = None,
        pinned: Sequence[int] = (),
        force: bool = True,
    ) -> Path:
        """Write the moving network to ``path``, an .html file that loads nothing.

        ``arcs``: (listener, speaker) by mode, for graphs that are not the trajectory's own.
        ``pinned``: indices of agents to be drawn as squares.
        Raises: SpecError.
        """
        from dobc_design.plotting.animation import write_animation

        return write_animation(self, Path(path), arcs=arcs, pinned=pinned, force=force)

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
            raise refused("pandas", message, cure) from None
        modes = np.array(self.switches.names, dtype=object)
        columns: dict[tuple[str, str, int], Any] = {("mode", "", 0): modes[self.mode_index]}
        for name in SAMPLED:
            array = getattr(self, name)
            for i, label in enumerate(self.labels):
                for c in range(array.shape[2]):
                    columns[name, label, c + 1] = array[:, i, c]
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
            raise refused("path", message, "Choose that ending.")
        return save_arrays(place, self.to_bytes(), force=force)

    def to_bytes(self) -> bytes:
        """What ``save`` writes."""
        switches = self.switches
        facts = {name: getattr(self, name) for name in PLAIN}
        facts |= {"format": FORMAT, "version": VERSION, "labels": self.labels, "notes": self.notes}
        facts["units"] = self.units
        facts["modes"] = switches.names
        arcs = switches.graphs or (np.zeros((2, 0), dtype=np.int64),)
        sizes = [graph.shape[1] for graph in switches.graphs]
        arrays: Document = {
            "times": self.times,
            ABOUT: np.array(json.dumps(facts, ensure_ascii=False)),
            "goal": self.goal,
        }
        # left out otherwise, as in files of older versions
        for name in OPTIONAL:
            if getattr(self, name).any():
                arrays[name] = getattr(self, name)
        arrays["switch_times"] = switches.times
        arrays["switch_modes"] = switches.modes
        arrays["graph_arcs"] = np.concatenate(arcs, axis=1)
        arrays["graph_sizes"] = np.array(sizes, dtype=np.int64)
        arrays |= {name: getattr(self, name) for name in SAMPLED}
        return arrays_bytes(arrays)

    def _card(self) -> Card:
        end = "ran to"
        if self.diverged:
            end = f"diverged at about {self.times[-1]:.4g} {self.clock} of"
        first, last = self.error()[[0, -1]]
        errors = f"{self.measured} from {first:.4g} to {last:.4g}"
        text = f'mode "{self.mode}", {end} {self.t_final:.4g} {self.clock}, {errors}'
        return Card(title=self.name, text=text, lines=self.notes)


_KINDS: dict[Any, type] = {"str": str, "int": int, "float": float, "bool": bool}
#: The fields that a file holds as JSON, each with its type.
PLAIN = {each.name: _KINDS[each.type] for each in fields(Trajectory) if each.type in _KINDS}


#: The fields that the file of an ensemble holds as JSON.
FACTS = (
    "name",
    "mode",
    "labels",
    "units",
    "t_final",
    "notes",
    "signal",
    "method",
    "observer",
    "stress",
)


@noun(eq=False)
class Ensemble(Simulated):
    """Runs that differ by their seeds: starts and switches.  Arrays cannot be written to.

    Shapes beside those of ``Simulated``: seeds (R,); error and estimation_error (R, T), |e|_inf and
    |d - dhat|_inf, nan from where a run that diverged had ended; diverged (R,); ended (R,) in s;
    switches (R,), how often a run switched; lengths (R,), the Euclidean |e| of all agents at the
    start; disturbances (R,), the largest |xi_i - xihat_i| there; states (S, T, n, m), x of the
    first runs, which the figure shows (at most 5, none of very large networks); leader (S, T, m),
    that of these runs, 0 without one.  ``reasons`` says by run why it ended early.
    ``simulate(problem, seed=seeds[r], ...)`` gives run r again, in full.
    """

    seeds: IndexArray
    error: Array
    estimation_error: Array
    diverged: BoolArray
    ended: Array
    switches: IndexArray
    reasons: dict[int, str]
    lengths: Array
    disturbances: Array
    states: Array
    leader: Array

    def __post_init__(self) -> None:
        for array in self._arrays().values():
            array.setflags(write=False)

    def _arrays(self) -> Document:
        values = {each.name: getattr(self, each.name) for each in fields(self)}
        # What came later is left out where it is 0, as in files of older versions.
        for name in ("slack", "sides"):
            if not values[name].any():
                del values[name]
        return {name: value for name, value in values.items() if isinstance(value, np.ndarray)}

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

    def summary(self) -> Document:
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
        facts: Document = {name: getattr(self, name) for name in FACTS}
        facts |= {"format": "dobc-ensemble", "version": 1}
        about = np.array(json.dumps(facts, ensure_ascii=False))
        return arrays_bytes({ABOUT: about} | self._arrays())

    def _card(self) -> Card:
        bad = int(self.diverged.sum()) or "none"
        final = np.sort(self.final_error)
        ends = f"{bad} diverged, final {self.measured} {final[0]:.3g} to {final[-1]:.3g}"
        text = f'{len(self)} runs of {self.t_final:.4g} {self.clock}, mode "{self.mode}", {ends}'
        return Card(title=self.name, text=text, lines=self.notes)


def bound_of(
    run: Any, certificate: Certificate | None, envelope: Envelope | None
) -> Envelope | None:
    """The bound to be drawn with a run: that of the certificate, or the given one.  Raises:
    SpecError for both."""
    if certificate is None:
        return envelope
    if envelope is not None:
        message = "certificate and envelope exclude each other."
        raise refused("envelope", message, "Leave one of them out.")
    found = certificate.envelope(run)
    return found if found.sources else None


def load_trajectory(path: str | PathLike[str]) -> Trajectory:
    """Read a trajectory that ``Trajectory.save`` wrote.

    Returns: the Trajectory.  Raises: SpecError if the file is none.
    """
    place = Path(path)
    cure = "Give a file that Trajectory.save wrote."
    with describing(place, key="path", what="trajectory", cure=cure):
        arrays = read_arrays(place, tuple(AXES), _require_shapes)
        facts = json.loads(str(arrays.pop(ABOUT)))
        plain = _plain_facts(facts)
        _require_texts(facts, plain)
        _require_numbers(arrays, plain)
        switches = _switches(facts, arrays)
        plain |= {name: arrays[name] for name in ("times", "goal", *SAMPLED)}
        plain |= {name: arrays[name] for name in OPTIONAL if name in arrays}
        m = arrays["x"].shape[2]
        units = facts.get("units", [])
        require(len(units) in (0, m), f"its units are not those of {m} state components")
        return Trajectory(
            **plain,  # what an older file does not have is as by default
            labels=tuple(facts["labels"]),
            notes=tuple(facts["notes"]),
            units=tuple(units),
            switches=switches,
        )


def _require_shapes(shapes: Shapes) -> None:
    """The shapes of a trajectory's arrays must fit each other.  Raises: UnfitError."""
    missing = [name for name in AXES if name not in shapes and name not in OPTIONAL]
    require(not missing, f"it has no array {', '.join(missing)}")
    require(len(shapes["x"]) == 3, "x must be samples of agents")
    sizes = {"2": 2}
    wrong = []
    # what first has an axis says how long it is
    for name in ("x", *shapes):
        wanted = [sizes.setdefault(*each) for each in zip(AXES[name], shapes[name], strict=False)]
        if len(AXES[name]) != len(shapes[name]) or tuple(wanted) != shapes[name]:
            wrong.append(name)
    require(not wrong, f"the shapes of {', '.join(wrong)} do not fit that of x")
    require(all(sizes[axis] for axis in "TnmpS"), "it has no samples")


def _plain_facts(facts: Any) -> Document:
    """The fields that stand in the text, each of its type."""
    known = isinstance(facts, dict) and facts.get("format") == FORMAT
    require(
        known and facts.get("version") == VERSION,
        f'it must say "format": "{FORMAT}", version {VERSION}',
    )
    plain = {name: facts[name] for name in PLAIN if name in facts}
    for name, value in plain.items():
        wanted = PLAIN[name]
        # JSON writes 20.0 as 20, too
        fits = type(value) is wanted or (wanted is float and type(value) is int)
        finite = fits and (wanted is not float or math.isfinite(value))
        require(finite, f"{name} is no {wanted.__name__}")
    return plain


def _require_texts(facts: Table, plain: Table) -> None:
    """Every text must be one that can be shown.  Raises: UnfitError."""
    texts = [value for value in plain.values() if type(value) is str]
    for each in (*(facts[name] for name in ("labels", "notes", "modes")), facts.get("units", [])):
        require(type(each) is list, "labels, notes, units and modes must be lists")
        texts += each
    for text in texts:
        readable = type(text) is str and text.isprintable()
        require(readable, "a text entry is not text or has control characters")


def _require_numbers(arrays: Mapping[str, NDArray[Any]], plain: Table) -> None:
    """Numbers must be of the kind that they are for, and times increase.  Raises: UnfitError."""
    kinds = dict.fromkeys(("switch_modes", "graph_sizes", "graph_arcs"), "iu")
    kinds |= dict.fromkeys(("times", "goal", "switch_times", *SAMPLED), "f")
    for name, kind in kinds.items():
        require(arrays[name].dtype.kind in kind, "an array holds numbers of another kind")
    for name in ("times", "switch_times", "goal"):
        require(np.isfinite(arrays[name]).all(), "a time or a goal is not finite")
    times = arrays["times"]
    begins = arrays["switch_times"]
    ordered = (np.diff(times) > 0).all() and (np.diff(begins) > 0).all() and begins[0] <= times[0]
    require(ordered and plain["t_final"] > 0, "its times do not increase")


def _switches(facts: Table, arrays: Mapping[str, NDArray[Any]]) -> Switches:
    """Its switches, which have to be of its modes and agents.  Raises: UnfitError."""
    labels = facts["labels"]
    names = facts["modes"]
    modes = arrays["switch_modes"]
    sizes = arrays["graph_sizes"]
    arcs = arrays["graph_arcs"]
    n = len(arrays["goal"])
    require(len(set(labels)) == len(labels) == n, f"it must name {n} different agents")
    known = modes.min() >= 0 and modes.max() < len(names)
    require(len(set(names)) == len(names) and known, "it has no such mode")
    counted = len(sizes) in (0, len(names)) and (sizes >= 0).all()
    require(counted, "its graphs are not those of its modes")
    own = ((arcs >= 0) & (arcs < n)).all()
    require(sizes.sum() == arcs.shape[1] and own, "its arcs are not those of its agents")
    graphs: tuple[IndexArray, ...] = ()
    if len(sizes):
        parts = np.split(arcs, np.cumsum(sizes)[:-1], axis=1)
        graphs = tuple(part.copy() for part in parts)
    return Switches(times=arrays["switch_times"], modes=modes, names=tuple(names), graphs=graphs)
