"""Trajectories as pandas tables, where pandas is installed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dobc_design.errors import SpecError
from dobc_design.simulation.storage import SAMPLED
from dobc_design.simulation.trajectory import Trajectory

if TYPE_CHECKING:
    import pandas as pd


def to_frame(trajectory: Trajectory) -> pd.DataFrame:
    """One row per sample, indexed by time in s; columns (quantity, agent, component), components from 1.

    The active mode is in the column ("mode", "", 0).  Raises: SpecError if pandas is not installed.
    """
    try:
        import pandas as pd
    except ImportError:
        raise SpecError(
            "to_pandas needs the package pandas, which is not installed.",
            key="pandas",
            cure="Install it (pip install dobc_design[store]), or use the arrays themselves.",
        ) from None
    columns: list[tuple[str, str, int]] = []
    blocks = []
    for name in SAMPLED:
        array = getattr(trajectory, name)
        columns += [(name, label, c + 1) for label in trajectory.labels for c in range(array.shape[2])]
        blocks.append(array.reshape(len(trajectory.times), array.shape[1] * array.shape[2]))
    frame = pd.DataFrame(
        np.concatenate(blocks, axis=1),
        index=pd.Index(trajectory.times, name="time"),
        columns=pd.MultiIndex.from_tuples(columns, names=["quantity", "agent", "component"]),
    )
    modes = np.array(trajectory.switches.names, dtype=object)[trajectory.mode_index]
    frame.insert(0, ("mode", "", 0), modes)
    return frame
