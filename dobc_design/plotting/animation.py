"""The network in motion: one HTML page that needs no network, or a GIF.

An arrow is not drawn: a line between two agents means that at least one hears the other.  The page holds its data, its
script and nothing else; it loads nothing and runs in any browser.
"""

from __future__ import annotations

import io
import json
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from dobc_design.errors import SpecError
from dobc_design.plotting.axes import short
from dobc_design.plotting.look import BLUE, GRID, INK, MUTED, PAPER, VERMILLION, styled
from dobc_design.plotting.sheet import write_new

Array = NDArray[np.float64]
Arcs = Mapping[str, Sequence[tuple[int, int]]]
MOST_FRAMES, MOST_GIF_FRAMES = 401, 80
MOST_AGENTS, MOST_LINKS = 500, 200_000
PACE = 20.0  # pictures per second
COLOURS = {"blue": BLUE, "grid": GRID, "ink": INK, "muted": MUTED, "paper": PAPER, "goal": VERMILLION}


class Run(Protocol):
    """What an animation needs of a run; see ``simulation.trajectory.Trajectory``."""

    @property
    def name(self) -> str: ...
    @property
    def labels(self) -> tuple[str, ...]: ...
    @property
    def times(self) -> Array: ...
    @property
    def x(self) -> Array: ...
    @property
    def goal(self) -> Array: ...
    @property
    def switches(self) -> Any: ...


def write_animation(run: Run, path: Path, *, arcs: Arcs | None = None, force: bool = False) -> Path:
    """Write ``path``: .html or .gif.  ``arcs``: (listener, speaker) by mode, where the run has no graphs of its own.

    Raises: SpecError for another ending, a network that is too large, or a GIF without Pillow.
    """
    kind = path.suffix.lower()
    if kind == ".html":
        return write_new(path, animation_page(run, arcs=arcs).encode("utf-8"), force=force)
    if kind == ".gif":
        return write_new(path, animation_gif(run, arcs=arcs), force=force)
    raise SpecError(
        f"an animation is saved as .html or .gif; got {path.name[:40]!r}.", key="path", cure="Choose one of the two."
    )


def animation_page(run: Run, *, arcs: Arcs | None = None) -> str:
    """The page: agents on their first two components, or one component against the agents' numbers."""
    frames = _frames(run, MOST_FRAMES)
    links = _links(run, arcs)
    places = _places(run)[frames]
    data = {
        "title": run.name,
        "labels": [short(label, 12) for label in run.labels],
        "times": run.times[frames].tolist(),
        "places": _rounded(places),
        "goals": _rounded(_goals(run)),
        "links": [pairs.tolist() for pairs in links],
        "mode": run.switches.at(run.times[frames]).tolist(),
        "modes": list(run.switches.names),
        "axes": _axis_names(run),
        "colours": COLOURS,
        "pace": PACE,
    }
    text = json.dumps(data, ensure_ascii=True, separators=(",", ":")).replace("<", "\\u003c")
    return _PAGE.replace("{title}", escape(run.name)).replace("{data}", text)


def animation_gif(run: Run, *, arcs: Arcs | None = None) -> bytes:
    """The same as a GIF, at most 80 pictures.  Raises: SpecError if Pillow is not installed."""
    try:
        from PIL import Image
    except ImportError:
        raise SpecError(
            "a GIF needs the package Pillow, which is not installed.",
            key="path",
            cure="Install it (pip install pillow), or save as .html.",
        ) from None
    links, places = _links(run, arcs), _places(run)
    chosen = _frames(run, MOST_GIF_FRAMES)
    modes = run.switches.at(run.times[chosen])
    pictures = []
    with styled():
        figure = Figure(figsize=(4.6, 4.0), layout="constrained", facecolor="white", dpi=100)
        ax = figure.add_subplot()
        low, high = _limits(places, _goals(run))
        for frame, mode in zip(chosen.tolist(), modes.tolist(), strict=True):
            ax.clear()
            ax.add_collection(LineCollection(places[frame][links[mode]].tolist(), colors=MUTED, linewidths=0.7))
            ax.plot(*_goals(run).T, linestyle="none", marker="x", color=VERMILLION, label="goal")
            ax.plot(*places[frame].T, linestyle="none", marker="o", color=BLUE, label="agent")
            ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
            ax.set_xlabel(_axis_names(run)[0])
            ax.set_ylabel(_axis_names(run)[1])
            title = f"{short(run.name)}, t = {run.times[frame]:.2f} s, {short(run.switches.names[mode])}"
            ax.set_title(title, parse_math=False)
            buffer = io.BytesIO()
            figure.savefig(buffer, format="png", facecolor="white")
            pictures.append(Image.open(buffer).convert("P", palette=Image.Palette.ADAPTIVE))
    out = io.BytesIO()
    pictures[0].save(out, format="GIF", save_all=True, append_images=pictures[1:], duration=round(2000 / PACE), loop=0)
    return out.getvalue()


def _frames(run: Run, most: int) -> NDArray[np.intp]:
    count = len(run.times)
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(np.intp))


def _places(run: Run) -> Array:
    """Positions (T, n, 2)."""
    if run.x.shape[2] >= 2:
        return np.asarray(run.x[:, :, :2])
    numbers = np.broadcast_to(np.arange(1.0, run.x.shape[1] + 1), run.x.shape[:2])
    return np.stack([run.x[:, :, 0], numbers], axis=2)


def _goals(run: Run) -> Array:
    if run.goal.shape[1] >= 2:
        return np.asarray(run.goal[:, :2])
    return np.stack([run.goal[:, 0], np.arange(1.0, len(run.goal) + 1)], axis=1)


def _axis_names(run: Run) -> tuple[str, str]:
    if run.x.shape[2] >= 2:
        return "first component, in its own unit", "second component, in its own unit"
    return "state x, in its own unit", "agent, by number"


def _links(run: Run, arcs: Arcs | None) -> list[NDArray[np.int64]]:
    """Pairs of agents (k, 2) by mode, each pair once.  Raises: SpecError for a network that is too large."""
    n = len(run.labels)
    if run.switches.graphs:
        found = [np.asarray(graph).T for graph in run.switches.graphs]
    else:
        empty: Sequence[tuple[int, int]] = ()
        given = [(arcs or {}).get(name, empty) for name in run.switches.names]
        found = [np.array(pairs, dtype=np.int64).reshape(-1, 2) for pairs in given]
    pairs = [np.unique(np.sort(each, axis=1), axis=0) for each in found]
    if n > MOST_AGENTS or sum(map(len, pairs)) > MOST_LINKS:
        raise SpecError(
            f"an animation shows at most {MOST_AGENTS} agents and {MOST_LINKS} links; there are {n} agents and"
            f" {sum(map(len, pairs))} links.",
            key="animation",
            cure="Draw a part of them yourself.",
        )
    return pairs


def _limits(places: Array, goals: Array) -> tuple[Array, Array]:
    every = np.concatenate([places.reshape(-1, 2), goals])
    low, high = every.min(axis=0), every.max(axis=0)
    room = 0.06 * np.maximum(high - low, 1e-9)
    return low - room, high + room


def _rounded(values: Array) -> Any:
    """Lists with five digits of the range, which is finer than a pixel."""
    size = float(np.abs(values).max(initial=0.0)) or 1.0
    return np.round(values, max(0, 5 - int(np.floor(np.log10(size))))).tolist()


_PAGE = """\
<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<meta http-equiv="Content-Security-Policy"
 content="default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'">
<title>{title}</title>
<style>
body { font: 15px/1.4 sans-serif; margin: 1rem auto; max-width: 46rem; padding: 0 1rem }
body { color: #1b1e24; background: #fefefe }
canvas { width: 100%; border: 1px solid #d8dce2; touch-action: manipulation }
.row { display: flex; gap: .7rem; align-items: center; margin: .5rem 0 } input { flex: 1 }
button { font: inherit; min-width: 5rem }
</style></head><body>
<h1 id="title" style="font-size: 1.2rem"></h1>
<canvas id="picture" width="1380" height="1000" role="img" aria-label="Agents and who hears whom, over time"></canvas>
<div class="row"><button id="play">pause</button>
<input id="time" type="range" min="0" value="0" step="1" aria-label="time"><output id="now"></output></div>
<p>Dots are agents, crosses their goals; a line joins two agents of which one at least hears the other.</p>
<script id="data" type="application/json">{data}</script>
<script>
"use strict";
const data = JSON.parse(document.getElementById("data").textContent), colour = data.colours;
const canvas = document.getElementById("picture"), pen = canvas.getContext("2d");
const [slider, now, play] = ["time", "now", "play"].map(id => document.getElementById(id));
document.getElementById("title").textContent = data.title;
slider.max = data.times.length - 1;
const every = data.places.flat().concat(data.goals), edge = [90, 30, 30, 80];
const low = [0, 1].map(c => every.reduce((a, p) => Math.min(a, p[c]), Infinity));
const high = [0, 1].map(c => every.reduce((a, p) => Math.max(a, p[c]), -Infinity));
for (const c of [0, 1]) { const room = 0.06 * Math.max(high[c] - low[c], 1e-9); low[c] -= room; high[c] += room; }
const wide = canvas.width - edge[0] - edge[2], tall = canvas.height - edge[1] - edge[3];
const at = p => [edge[0] + wide * (p[0] - low[0]) / (high[0] - low[0]),
                 edge[1] + tall * (high[1] - p[1]) / (high[1] - low[1])];
function ticks(c) {
  const step = 10 ** Math.floor(Math.log10((high[c] - low[c]) / 2)), found = [];
  for (let k = Math.ceil(low[c] / step); k * step <= high[c]; k++) found.push(Number((k * step).toPrecision(10)));
  return found.filter((value, k) => k % Math.ceil(found.length / 8) === 0);
}
function frame() {
  pen.fillStyle = colour.paper; pen.fillRect(0, 0, canvas.width, canvas.height);
  pen.font = "24px sans-serif"; pen.lineWidth = 1.5; pen.strokeStyle = colour.grid; pen.fillStyle = colour.ink;
  pen.textAlign = "center";
  for (const value of ticks(0)) {
    const x = at([value, low[1]])[0];
    line([x, edge[1]], [x, edge[1] + tall]); pen.fillText(value, x, edge[1] + tall + 28);
  }
  pen.fillText(data.axes[0], edge[0] + wide / 2, canvas.height - 14);
  for (const value of ticks(1)) {
    const y = at([low[0], value])[1];
    line([edge[0], y], [edge[0] + wide, y]); pen.textAlign = "right"; pen.fillText(value, edge[0] - 8, y + 8);
  }
  pen.save(); pen.translate(24, edge[1] + tall / 2); pen.rotate(-Math.PI / 2); pen.textAlign = "center";
  pen.fillText(data.axes[1], 0, 0); pen.restore();
  const k = Number(slider.value), places = data.places[k].map(at);
  pen.strokeStyle = colour.muted; pen.lineWidth = 2;
  for (const [a, b] of data.links[data.mode[k]]) line(places[a], places[b]);
  pen.strokeStyle = colour.goal; pen.lineWidth = 3;
  for (const [x, y] of data.goals.map(at)) {
    line([x - 9, y - 9], [x + 9, y + 9]); line([x - 9, y + 9], [x + 9, y - 9]);
  }
  places.forEach(([x, y], i) => {
    pen.fillStyle = colour.blue; pen.beginPath(); pen.arc(x, y, 9, 0, 7); pen.fill();
    pen.fillStyle = colour.ink; pen.textAlign = "left";
    if (places.length <= 40) pen.fillText(data.labels[i], x + 12, y - 10);
  });
  now.textContent = "t = " + data.times[k].toFixed(2) + " s, " + data.modes[data.mode[k]];
}
function line(a, b) { pen.beginPath(); pen.moveTo(...a); pen.lineTo(...b); pen.stroke(); }
let running = !matchMedia("(prefers-reduced-motion: reduce)").matches;
function label() { play.textContent = running ? "pause" : "play"; }
play.onclick = () => { running = !running; label(); };
slider.oninput = () => { running = false; label(); frame(); };
setInterval(() => {
  if (running) { slider.value = (Number(slider.value) + 1) % data.times.length; frame(); }
}, 1000 / data.pace);
label(); frame();
</script></body></html>
"""
