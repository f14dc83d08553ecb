"""The network in motion: one HTML page that needs no network.

Arrows point to the agent that listens.  The page
holds its data, its script and nothing else; it loads nothing and runs in any browser.
"""

import json
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dobc_design._files import own_text
from dobc_design.errors import refused
from dobc_design.exact.matrix import Array

from .look import (
    BLUE,
    GRID,
    INK,
    MUTED,
    PAPER,
    VERMILLION,
    in_units,
    short,
    thinned_rows,
    write_new,
)
from .runs import Run

Arcs = Mapping[str, Sequence[tuple[int, int]]]
MOST_FRAMES = 401
MOST_AGENTS, MOST_LINKS = 500, 200_000
PACE = 20.0  # pictures per second
COLOURS = {
    "blue": BLUE,
    "grid": GRID,
    "ink": INK,
    "muted": MUTED,
    "paper": PAPER,
    "goal": VERMILLION,
}


def write_animation(
    run: Run,
    path: Path,
    *,
    arcs: Arcs | None = None,
    pinned: Sequence[int] = (),
    force: bool = True,
) -> Path:
    """Write ``path``, an .html file.  ``arcs``: (listener, speaker) by mode, where the run has no
    graphs of its own.
    Raises: SpecError for another ending, or a network that is too large."""
    if path.suffix.lower() != ".html":
        told = f"an animation is saved as .html; got {path.name[:40]!r}."
        raise refused("path", told, "Choose that ending.")
    page = animation_page(run, arcs=arcs, pinned=pinned)
    return write_new(path, page.encode("utf-8"), force=force)


def animation_page(run: Run, *, arcs: Arcs | None = None, pinned: Sequence[int] = ()) -> str:
    """The page: agents on their first two components, to the same scale, or one component of agents
    side by side; ``pinned`` ones are squares."""
    frames = thinned_rows(len(run.times), MOST_FRAMES)
    times = run.times[frames]
    # A leader that moves carries the goals with it: they are not drawn.
    goals = run.goal[:0] if run.leader.any() else run.goal
    places = _in_plane(run.x)[frames]
    links = [pairs.tolist() for pairs in _links(run, arcs)]
    data = {
        "title": run.name,
        "labels": [short(label, 12) for label in run.labels],
        "times": times.tolist(),
        "places": _rounded(places),
        "goals": _rounded(_in_plane(goals)),
        "links": links,
        "mode": run.switches.at(times).tolist(),
        "modes": list(run.switches.names),
        "axes": _axis_names(run),
        "plane": run.x.shape[2] >= 2,
        "pinned": list(pinned),
        "colours": COLOURS,
        "pace": PACE,
    }
    text = json.dumps(data, ensure_ascii=True, separators=(",", ":"))
    text = text.replace("<", "\\u003c")  # so that nothing of it ends the script
    page = own_text("plotting/animation.html")
    return page.replace("{title}", escape(run.name)).replace("{data}", text)


def _in_plane(values: Array) -> Array:
    """Positions (..., n, 2): the first two components, or the only one against the agents'
    numbers."""
    if values.shape[-1] >= 2:
        return values[..., :2]
    states = values[..., 0]
    # One component is a height; agents stand side by side.
    numbers = np.arange(1.0, values.shape[-2] + 1)
    return np.stack([states, np.broadcast_to(numbers, states.shape)], axis=-1)


def _axis_names(run: Run) -> tuple[str, str]:
    first = in_units(*run.units[:1])
    if run.x.shape[2] == 1:
        return f"state x, {first}", "agent"
    return f"first component, {first}", f"second component, {in_units(*run.units[1:2])}"


def _links(run: Run, arcs: Arcs | None) -> list[NDArray[np.int64]]:
    """Pairs of agents (listener, speaker), (k, 2), by mode, each pair once.
    Raises: SpecError for a network that is too large."""
    # Agents that move have graphs of the run itself; else the modes have arcs.
    if run.switches.graphs:
        found = [np.asarray(graph).T for graph in run.switches.graphs]
    else:
        found = [_pairs(arcs, name) for name in run.switches.names]
    links = [np.unique(each, axis=0) for each in found]
    agents = len(run.labels)
    count = sum(map(len, links))
    if agents > MOST_AGENTS or count > MOST_LINKS:
        most = f"an animation shows at most {MOST_AGENTS} agents and {MOST_LINKS} links"
        told = f"{most}; there are {agents} agents and {count} links."
        raise refused("animation", told, "Draw a part of them yourself.")
    return links


def _pairs(arcs: Arcs | None, mode: str) -> NDArray[np.int64]:
    known = () if arcs is None else arcs.get(mode, ())
    return np.array(known, dtype=np.int64).reshape(-1, 2)


def _rounded(values: Array) -> Any:
    """Lists with five digits of the range, which is finer than a pixel."""
    size = float(np.abs(values).max(initial=0.0)) or 1.0
    exponent = int(np.floor(np.log10(size)))
    return np.round(values, max(0, 5 - exponent)).tolist()
