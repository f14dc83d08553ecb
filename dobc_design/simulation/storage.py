"""Trajectories as files: .npz (NumPy), or .parquet (needs pyarrow).  Nothing in a file is ever executed.

A file appears whole or not at all: it is written beside its place and renamed.
"""

from __future__ import annotations

import json
import os
import tempfile
import zipfile
from collections.abc import Callable, Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dobc_design.errors import CertificateError, SpecError
from dobc_design.exact.reading import shown
from dobc_design.simulation.switches import Switches
from dobc_design.simulation.trajectory import Trajectory

FORMAT, VERSION = "dobc-trajectory", 1
SAMPLED = ("x", "xi", "xihat", "d", "dhat", "u")  # (T, n, width)
PLAIN = (
    "name",
    "mode",
    "t_final",
    "seed",
    "diverged",
    "reason",
    "method",
    "evaluations",
    "signal",
    "observer",
    "stress",
    "loop_sha256",
)


def save_trajectory(trajectory: Trajectory, path: Path, *, force: bool) -> Path:
    """Write a trajectory; the ending of ``path`` says how.  Raises: SpecError."""
    writers = {".npz": _write_npz, ".parquet": _write_parquet}
    writer = writers.get(path.suffix.lower())
    if writer is None:
        raise SpecError(
            f"a trajectory is saved as .npz or .parquet; got {shown(path.name)}.",
            key="path",
            cure="Choose one of the two endings.",
        )
    write_whole(path, lambda place: writer(trajectory, place), force=force)
    return path


def load_trajectory(path: str | PathLike[str]) -> Trajectory:
    """Read a trajectory, .npz or .parquet, that ``Trajectory.save`` wrote.

    Returns: the Trajectory.  Raises: SpecError if the file is none.
    """
    place = Path(path)
    name = shown(place.name)
    reader = _read_parquet if place.suffix.lower() == ".parquet" else _read_npz
    try:
        return reader(place)
    except OSError as error:
        raise SpecError(
            f"{name} cannot be read: {error.strerror or error}.", key="path", cure="Check the path."
        ) from None
    except (ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
        if isinstance(error, SpecError):
            raise
        raise SpecError(
            f"{name} does not hold a trajectory ({str(error)[:80]}).",
            key="path",
            cure="Give a file that Trajectory.save wrote.",
        ) from None


def write_whole(path: Path, write: Callable[[Path], None], *, force: bool) -> None:
    """Let ``write`` fill a file beside ``path``, then put it into its place.

    Raises: SpecError if the place is taken (and not ``force``), CertificateError if the machine refuses.
    """
    if path.exists() and not force:
        raise SpecError(f"{shown(str(path))} exists already.", key="path", cure="Replace it with force=True.")
    temporary = None
    try:
        descriptor, temporary = tempfile.mkstemp(prefix=f".{path.name}.", suffix=path.suffix, dir=path.parent)
        os.close(descriptor)
        write(Path(temporary))
        with open(temporary, "rb+") as stream:
            os.fsync(stream.fileno())
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
        temporary = None
    except OSError as error:
        raise CertificateError(
            f"{shown(path.name)} cannot be written: {error.strerror or error}.",
            key="path",
            cure="Choose another place.",
        ) from error
    finally:
        if temporary is not None and os.path.exists(temporary):
            os.unlink(temporary)


def _about(trajectory: Trajectory) -> str:
    facts = {name: getattr(trajectory, name) for name in PLAIN}
    facts |= {"format": FORMAT, "version": VERSION, "labels": trajectory.labels, "notes": trajectory.notes}
    return json.dumps(facts | {"modes": trajectory.switches.names}, ensure_ascii=False)


def _arrays(trajectory: Trajectory) -> dict[str, NDArray[Any]]:
    """Everything that is no sample."""
    switches = trajectory.switches
    graphs = switches.graphs or (np.zeros((2, 0), dtype=np.int64),)
    return {
        "goal": trajectory.goal,
        "switch_times": switches.times,
        "switch_modes": switches.modes,
        "graph_arcs": np.concatenate(graphs, axis=1),
        "graph_sizes": np.array([graph.shape[1] for graph in switches.graphs], dtype=np.int64),
    }


def _write_npz(trajectory: Trajectory, path: Path) -> None:
    arrays = _arrays(trajectory) | {name: getattr(trajectory, name) for name in SAMPLED}
    np.savez(path, times=trajectory.times, about=np.array(_about(trajectory)), allow_pickle=False, **arrays)


def _read_npz(path: Path) -> Trajectory:
    with np.load(path, allow_pickle=False) as stored:
        return _made(json.loads(str(stored["about"])), stored, stored["times"])


def _made(facts: Any, arrays: Mapping[str, NDArray[Any]], times: NDArray[Any]) -> Trajectory:
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
    given: dict[str, Any] = {name: facts[name] for name in PLAIN if name in facts} | {
        name: arrays[name] for name in SAMPLED
    }
    return Trajectory(
        labels=tuple(facts["labels"]),
        notes=tuple(facts["notes"]),
        times=times,
        goal=np.array(arrays["goal"]),
        switches=switches,
        **given,
    )


def _write_parquet(trajectory: Trajectory, path: Path) -> None:
    pa, parquet = _pyarrow()
    columns: dict[str, Any] = {"time": trajectory.times, "mode": trajectory.mode_index}
    shapes = {}
    for name in SAMPLED:
        array = getattr(trajectory, name)
        shapes[name] = array.shape[1:]
        width = int(np.prod(array.shape[1:]))
        if width:
            columns[name] = pa.FixedSizeListArray.from_arrays(pa.array(array.ravel()), width)
    rest = {name: array.tolist() for name, array in _arrays(trajectory).items()}
    about = json.dumps({"facts": json.loads(_about(trajectory)), "arrays": rest, "shapes": shapes})
    table = pa.table(columns).replace_schema_metadata({FORMAT: about})
    parquet.write_table(table, path)


def _read_parquet(path: Path) -> Trajectory:
    _, parquet = _pyarrow()
    table = parquet.read_table(path)
    about = json.loads((table.schema.metadata or {})[FORMAT.encode()])
    arrays: dict[str, NDArray[Any]] = {}
    for name, shape in about["shapes"].items():
        flat = table[name].combine_chunks().flatten().to_numpy() if name in table.column_names else np.zeros(0)
        arrays[name] = np.array(flat, dtype=np.float64).reshape(table.num_rows, *shape)
    for name, values in about["arrays"].items():
        whole = name in ("switch_modes", "graph_arcs", "graph_sizes")
        arrays[name] = np.array(values, dtype=np.int64 if whole else np.float64)
    return _made(about["facts"], arrays, np.array(table["time"].to_numpy()))


def _pyarrow() -> tuple[Any, Any]:
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        raise SpecError(
            "Parquet files need the package pyarrow, which is not installed.",
            key="path",
            cure="Install it (pip install dobc_design[store]), or save as .npz.",
        ) from None
    return pyarrow, parquet
