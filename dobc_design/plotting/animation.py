"""The network in motion: one HTML page that needs no network, or a GIF.

An arrow is not drawn: a line between two agents means that at least one hears the other.  The page holds its data, its
script and nothing else; it loads nothing and runs in any browser.
"""

from __future__ import annotations

import io
import json
from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from dobc_design.errors import SpecError
from dobc_design.plotting.look import BLUE, GRID, INK, MUTED, PAPER, VERMILLION, short, styled, thinned_rows, write_new
from dobc_design.plotting.runs import Run

Array = NDArray[np.float64]
Arcs = Mapping[str, Sequence[tuple[int, int]]]
MOST_FRAMES, MOST_GIF_FRAMES = 401, 80
MOST_AGENTS, MOST_LINKS = 500, 200_000
PACE = 20.0  # pictures per second
COLOURS = {"blue": BLUE, "grid": GRID, "ink": INK, "muted": MUTED, "paper": PAPER, "goal": VERMILLION}


def write_animation(run: Run, path: Path, *, arcs: Arcs | None = None, force: bool = True) -> Path:
    """Write ``path``: .html or .gif.  ``arcs``: (listener, speaker) by mode, where the run has no graphs of its own.
    Raises: SpecError for another ending, a network that is too large, or a GIF without Pillow."""
    kind = path.suffix.lower()
    if kind not in (".html", ".gif"):
        told = f"an animation is saved as .html or .gif; got {path.name[:40]!r}."
        raise SpecError(told, key="path", cure="Choose one of the two.")
    data = animation_page(run, arcs=arcs).encode("utf-8") if kind == ".html" else animation_gif(run, arcs=arcs)
    return write_new(path, data, force=force)


def animation_page(run: Run, *, arcs: Arcs | None = None) -> str:
    """The page: agents on their first two components, or one component against the agents' numbers."""
    frames = thinned_rows(len(run.times), MOST_FRAMES)
    data = {
        "title": run.name,
        "labels": [short(label, 12) for label in run.labels],
        "times": run.times[frames].tolist(),
        "places": _rounded(_in_plane(run.x)[frames]),
        "goals": _rounded(_in_plane(run.goal)),
        "links": [pairs.tolist() for pairs in _links(run, arcs)],
        "mode": run.switches.at(run.times[frames]).tolist(),
        "modes": list(run.switches.names),
        "axes": _axis_names(run),
        "colours": COLOURS,
        "pace": PACE,
    }
    text = json.dumps(data, ensure_ascii=True, separators=(",", ":")).replace("<", "\\u003c")
    page = (files("dobc_design.plotting") / "animation.html").read_text("utf-8")
    return page.replace("{title}", escape(run.name)).replace("{data}", text)


def animation_gif(run: Run, *, arcs: Arcs | None = None) -> bytes:
    """The same as a GIF, at most 80 pictures.  Raises: SpecError if Pillow is not installed."""
    try:
        from PIL import Image
    except ImportError:
        cure = "Install it (pip install pillow), or save as .html."
        raise SpecError("a GIF needs the package Pillow, which is not installed.", key="path", cure=cure) from None
    links, places, goals = _links(run, arcs), _in_plane(run.x), _in_plane(run.goal)
    chosen = thinned_rows(len(run.times), MOST_GIF_FRAMES)
    modes = run.switches.at(run.times[chosen])
    every = np.concatenate([places.reshape(-1, 2), goals])
    low, high = every.min(axis=0), every.max(axis=0)
    room = 0.06 * np.maximum(high - low, 1e-9)
    low, high = low - room, high + room
    pictures = []
    with styled():
        figure = Figure(figsize=(4.6, 4.0), layout="constrained", facecolor="white", dpi=100)
        ax = figure.add_subplot()
        for frame, mode in zip(chosen.tolist(), modes.tolist(), strict=True):
            ax.clear()
            ax.add_collection(LineCollection(places[frame][links[mode]].tolist(), colors=MUTED, linewidths=0.7))
            ax.plot(*goals.T, linestyle="none", marker="x", color=VERMILLION, label="goal")
            ax.plot(*places[frame].T, linestyle="none", marker="o", color=BLUE, label="agent")
            xlabel, ylabel = _axis_names(run)
            ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel=xlabel, ylabel=ylabel)
            title = f"{short(run.name)}, t = {run.times[frame]:.2f} s, {short(run.switches.names[mode])}"
            ax.set_title(title, parse_math=False)
            buffer = io.BytesIO()
            figure.savefig(buffer, format="png", facecolor="white")
            pictures.append(Image.open(buffer).convert("P", palette=Image.Palette.ADAPTIVE))
    out = io.BytesIO()
    pictures[0].save(out, format="GIF", save_all=True, append_images=pictures[1:], duration=round(2000 / PACE), loop=0)
    return out.getvalue()


def _in_plane(values: Array) -> Array:
    """Positions (..., n, 2): the first two components, or the only one against the agents' numbers."""
    if values.shape[-1] >= 2:
        return np.asarray(values[..., :2])
    return np.stack([values[..., 0], np.broadcast_to(np.arange(1.0, values.shape[-2] + 1), values.shape[:-1])], axis=-1)


def _axis_names(run: Run) -> tuple[str, str]:
    if run.x.shape[2] >= 2:
        return "first component, in its own unit", "second component, in its own unit"
    return "state x, in its own unit", "agent, by number"


def _links(run: Run, arcs: Arcs | None) -> list[NDArray[np.int64]]:
    """Pairs of agents (k, 2) by mode, each pair once.  Raises: SpecError for a network that is too large."""
    known = arcs or {}
    found = [np.asarray(graph).T for graph in run.switches.graphs] or [
        np.array(known.get(name, ()), dtype=np.int64).reshape(-1, 2) for name in run.switches.names
    ]
    pairs = [np.unique(np.sort(each, axis=1), axis=0) for each in found]
    agents, links = len(run.labels), sum(map(len, pairs))
    if agents > MOST_AGENTS or links > MOST_LINKS:
        most = f"an animation shows at most {MOST_AGENTS} agents and {MOST_LINKS} links"
        told = f"{most}; there are {agents} agents and {links} links."
        raise SpecError(told, key="animation", cure="Draw a part of them yourself.")
    return pairs


def _rounded(values: Array) -> Any:
    """Lists with five digits of the range, which is finer than a pixel."""
    size = float(np.abs(values).max(initial=0.0)) or 1.0
    return np.round(values, max(0, 5 - int(np.floor(np.log10(size))))).tolist()
