"""When which mode is active: the outcome of a switching signal on one horizon."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
IndexArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Switches:
    """Mode ``names[modes[s]]`` is active from ``times[s]`` (included) to the next instant (excluded).

    Shapes: times (S,) in s, increasing from 0; modes (S,), no two neighbours alike.  ``graphs`` is empty
    where the modes are the problem's own; with moving agents it holds, by mode, listeners and speakers (2, arcs).
    """

    times: Array
    modes: IndexArray
    names: tuple[str, ...]
    graphs: tuple[IndexArray, ...] = ()

    def __post_init__(self) -> None:
        for array in (self.times, self.modes, *self.graphs):
            array.setflags(write=False)

    def __len__(self) -> int:
        return len(self.times)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Switches):
            return NotImplemented
        return (
            self.names == other.names
            and np.array_equal(self.times, other.times)
            and np.array_equal(self.modes, other.modes)
            and len(self.graphs) == len(other.graphs)
            and all(np.array_equal(a, b) for a, b in zip(self.graphs, other.graphs, strict=True))
        )

    __hash__ = None  # type: ignore[assignment]  # arrays inside: equal ones need not be the same

    def at(self, times: Array) -> IndexArray:
        """Index of the active mode at each of the times, (T,); at an instant of switching the new one."""
        return np.asarray(self.modes[np.searchsorted(self.times, times, side="right") - 1])


def one_mode(name: str) -> Switches:
    """One mode throughout."""
    return Switches(times=np.zeros(1), modes=np.zeros(1, dtype=np.int64), names=(name,))


def merged(times: Array, modes: IndexArray, names: tuple[str, ...]) -> Switches:
    """Leave out the instants at which nothing changes."""
    keep = np.concatenate([[True], modes[1:] != modes[:-1]])
    return Switches(times=times[keep].astype(np.float64), modes=modes[keep].astype(np.int64), names=names)
