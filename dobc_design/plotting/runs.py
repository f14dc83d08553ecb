"""Figures of one run and of many: states, disturbance and estimate, errors, the active mode.

A certified envelope is handed over as points (t, bound on |e|_inf); nothing is certified here.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from dobc_design.errors import ShapeError

from .look import (
    BLUE,
    DASHED,
    DOTTED,
    GREEN,
    INK,
    MUTED,
    PURPLE,
    SERIES,
    SMALLEST,
    VERMILLION,
    Sheet,
    fit_heights,
    in_units,
    legend_above,
    resolved,
    short,
    shown_agents,
    thinned_rows,
)
from .networks import draw_arcs

Array = NDArray[np.float64]
Envelope = ArrayLike | Callable[[Array], Array]
MOST_COMPONENTS = 3
_NODE = 0.03  # radius of an agent of a formation, in its size
MOST_ESTIMATES = 3
MOST_BOUNDS = 200  # points at which a certified bound is asked for
MOST_NAMED_MODES = 6
WIDTH, PANEL, BAND = 7.0, 1.75, 0.32  # inches
#: Colours, and once more with dashes: the agents that can be told apart.
STYLES: Any = [(colour, dashes) for dashes in ("solid", (0, (6, 1.5, 1, 1.5))) for colour in SERIES]
LEVELS = (0.05, 0.25, 0.5, 0.75, 0.95)
#: What errors are called, in text and in figures.
MEASURED = {
    "|e|_inf": "|e|∞",
    "max |x_i - x_j|": "max |xᵢ − xⱼ|",
    "max |e_i - e_j|": "max |eᵢ − eⱼ|",
}
_SUBSCRIPTS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")


#: Nouns of rooms that rest on this one: ``simulation.trajectory`` and ``simulation.switches`` say
#: what they have.
Run = Any  # a Trajectory
Runs = Any  # an Ensemble
Goals = Any  # either of them, for the goals of which figures ask
Switches = Any  # mode ``names[modes[k]]`` is active from ``times[k]`` s on


def trajectory_sheet(
    run: Run,
    *,
    envelope: Envelope | None = None,
    pinned: Sequence[int] = (),
    ends: Array | None = None,
) -> Sheet:
    """States by component, disturbance and estimate, errors on a logarithmic axis, and which mode
    was active. ``envelope``: points (t, bound), (k, 2), or the bound as a function of times, drawn
    into the errors. ``pinned``: indices of agents to be drawn in blue. ``ends`` (2, m): between
    which states agents end that agree on a value."""
    points = checked_envelope(envelope, run.times)
    components = min(run.x.shape[2], MOST_COMPONENTS)
    has_estimate = bool(run.d.size and (run.d.any() or run.dhat.any()))
    has_band = len(run.switches) > 1
    heights = [PANEL] * (components + has_estimate + 1)
    if has_band:
        heights = [BAND, *heights]

    def draw(figure: Figure) -> None:
        panels = figure.subplots(len(heights), 1, sharex=True, height_ratios=heights)
        rows = list(np.atleast_1d(panels))
        if has_band:
            plot_modes(rows.pop(0), run.switches, run.times[-1])
        for c in range(components):
            plot_agents(rows.pop(0), run, component=c, pinned=pinned, ends=ends)
        errors = {MEASURED[run.measured]: _largest(run.errors())}
        if has_estimate:
            plot_estimates(rows.pop(0), run)
            unit = "per s" if run.d.shape == run.x.shape else "units of d"
            errors[f"|d − d̂|∞, {unit}"] = _largest(run.d - run.dhat)
        last = plot_errors(rows[0], run.times, errors, envelope=points, units=run.units)
        if run.diverged:
            last.set_title(f"ended early, at t = {run.times[-1]:.4g} {run.clock}")
        in_time(last, run.times, run.clock)

    height = sum(heights) + 0.5 + 0.25 * len(heights)
    return Sheet(draw, width=WIDTH, height=height)


def ensemble_sheet(runs: Runs, *, envelope: Envelope | None = None) -> Sheet:
    """States of the first runs; quantile bands of |e|_inf and of |d - dhat|_inf, a run that
    diverged being infinite. ``envelope``: points (t, bound), (k, 2), or the bound as a function of
    times, drawn into |e|_inf."""
    has_estimate = bool(np.nan_to_num(runs.estimation_error).any())
    components = 0
    if len(runs.states):
        components = min(runs.states.shape[3], MOST_COMPONENTS)
    count = components + 1 + has_estimate

    def draw(figure: Figure) -> None:
        rows = np.atleast_1d(figure.subplots(count, 1, sharex=True))
        for c in range(components):
            plot_states(rows[c], runs, component=c)
        plot_bands(rows[components], runs, envelope)
        last = rows[-1]
        if has_estimate:
            rows[components].set_xlabel("")
            what = "|d − d̂|∞, units of d"
            plot_quantiles(last, runs.times, runs.estimation_error, colour=PURPLE, what=what)
        in_time(last, runs.times, runs.clock)

    return Sheet(draw, width=WIDTH, height=0.7 + 2.2 * count)


def plot_states(ax: Axes, runs: Runs, *, component: int) -> Axes:
    """One component of the states of at most 30 agents in the first runs, one colour for each
    run."""
    rows = thinned_rows(len(runs.times))
    chosen = shown_agents(runs.states.shape[2], set())
    times = runs.times[rows]
    for x, seed, colour in zip(runs.states, runs.seeds, SERIES, strict=False):
        curves = x[rows][:, chosen, component]
        ax.plot(times, curves, color=colour, linewidth=0.7, label=f"seed {seed}")
    _goals(ax, runs, chosen, component)
    return legend_above(ax, right=True, widest=7)


def plot_bands(ax: Axes, runs: Runs, envelope: Envelope | None) -> Axes:
    """The first panel of an ensemble: |e|_inf over time."""
    points = checked_envelope(envelope, runs.times)
    what = f"{MEASURED[runs.measured]}, {in_units(*runs.units)}"
    plot_quantiles(ax, runs.times, runs.error, colour=BLUE, what=what)
    if points is not None:
        label = f"certified bound on {MEASURED[runs.measured]}"
        _draw_bound(ax, points[:, 0], resolved(points[:, 1]), label)
    title = f"{len(runs)} runs"
    bad = int(np.count_nonzero(runs.diverged))
    if bad:
        title += f", {bad} diverged"
    ax.set_title(title)
    legend_above(ax, right=True, widest=4)
    return in_time(ax, runs.times, runs.clock)


def plot_error(ax: Axes, run: Run, envelope: Envelope | None) -> Axes:
    """|e|_inf of one run over time."""
    errors = {MEASURED[run.measured]: _largest(run.errors())}
    points = checked_envelope(envelope, run.times)
    plot_errors(ax, run.times, errors, envelope=points, units=run.units)
    return in_time(ax, run.times, run.clock)


def plot_agents(
    ax: Axes,
    run: Run,
    *,
    component: int,
    pinned: Sequence[int] = (),
    ends: Array | None = None,
) -> Axes:
    """One component of the states of at most 30 agents, and their goals (dashed), or the ``ends``
    (2, m) between which they agree.  Up to 12 differ in colour and dashes, the ``pinned`` ones are
    thicker; of more, the pinned ones are blue."""
    rows = thinned_rows(len(run.times))
    held = set(pinned)
    chosen = shown_agents(run.x.shape[1], held)
    few = len(chosen) <= len(STYLES)
    # Of many the order is seen from dark to light.
    shades: Any = colormaps["cividis"](np.linspace(0.05, 0.8, len(chosen)))
    word = "agent " if len(chosen) <= len(SERIES) else ""  # no room for it beside many names
    times, marker = run.times[rows], _marker(rows)
    for place, agent in enumerate(chosen):
        x = run.x[rows, agent, component]
        (line,) = ax.plot(times, x, linewidth=1.0, marker=marker)
        if few:
            colour, dashes = STYLES[place]
            label = f"{word}{short(run.labels[agent], 10)}"
            line.set(color=colour, linestyle=dashes, label=label)
            if agent in held:
                line.set(linewidth=2.2, label=f"{label}, pinned")
        # Of many agents the question is who is pinned and not who is who.
        elif agent in held:
            line.set(color=BLUE, label="pinned", linewidth=1.7, zorder=2.1)
        elif held:
            line.set(color=MUTED, label="not pinned")
        else:
            line.set_color(shades[place])
    _goals(ax, run, chosen, component, ends)
    if component > 0:
        return ax
    if few or held:
        # As many columns as the longest name leaves room for.
        longest = max(map(len, ax.get_legend_handles_labels()[1]))
        columns = int(14 * ax.figure.bbox.width / ax.figure.dpi / (longest + 6))
        return legend_above(ax, right=True, widest=min(columns, 7))
    dark = short(run.labels[chosen[0]])
    light = short(run.labels[chosen[-1]])
    title = f"agents {dark} (dark) to {light} (light); goals dashed"
    ax.set_title(title, loc="right", parse_math=False)
    return ax


def _goals(
    ax: Axes, run: Goals, chosen: Sequence[int], component: int, ends: Array | None = None
) -> Axes:
    """The axes of a state component, with the goals of these agents; those beside a leader move
    with it."""
    rows = thinned_rows(len(run.times))
    times = run.times[rows]
    # One leader for one run, or one for each of the runs whose states are drawn.
    leaders = run.leader[..., component].reshape(-1, len(run.times))
    slack = run.slack[component]
    between: list[float] = []
    label = "between the fixed nodes"
    if slack:
        middle = run.goal[0, component]
        between = [middle - slack, middle + slack]
    elif ends is not None:
        between = ends[:, component].tolist()
        label = "value, proved"
    if between:
        ax.axhspan(*between, color=VERMILLION, alpha=0.12, zorder=1.4)
        for end in between:
            line = ax.axhline(end, color=VERMILLION, linewidth=1.1, zorder=1.5)
            line.set(linestyle=DASHED, label=label)
    if between or run.sides.size:
        return _unit_label(ax, run, component)
    for goal in np.unique(run.goal[chosen, component])[:12]:
        if run.leader.any():
            drawn = [ax.plot(times, s[rows] + goal, label="leader")[0] for s in leaders]
        else:
            drawn = [ax.axhline(goal, label="goal")]
        for line in drawn:
            line.set(color=VERMILLION, linewidth=1.1, linestyle=DASHED, zorder=1.5)
    return _unit_label(ax, run, component)


def _unit_label(ax: Axes, run: Goals, component: int) -> Axes:
    """The axes with the letter and the unit of a state component."""
    unit = in_units(*run.units[component : component + 1])
    ax.set_ylabel(f"{state_symbol(component, run.goal.shape[1])}\n{unit}", parse_math=False)
    return ax


def state_symbol(component: int, m: int) -> str:
    """The letter of a state component; with a single one it has no number."""
    return "xᵢ" if m == 1 else f"xᵢ,{component + 1}".translate(_SUBSCRIPTS)


def plot_plane(
    ax: Axes, run: Run, *, pinned: Sequence[int] = (), arcs: Sequence[tuple[int, int]] = ()
) -> Axes:
    """Paths of at most 30 agents in their first two components, which share a scale, up to where
    they end; ``arcs`` (listener, speaker) as arrows there, towards who listens.  Pinned agents are
    blue squares, goals crosses."""
    rows = thinned_rows(len(run.times))
    chosen = shown_agents(run.x.shape[1], set(pinned))
    ends = run.x[-1, :, :2]
    size = np.ptp(ends[chosen], axis=0).max()
    shown = {pair: 1 for pair in arcs if set(pair) <= set(chosen)}
    draw_arcs(ax, shown, ends, _NODE * size)
    for agent in chosen:
        held = agent in pinned
        colour = BLUE if held else INK
        path = run.x[rows, agent, :2]
        ax.plot(*path.T, color=colour, linewidth=0.8, alpha=0.6)
        marker = "s" if held else "o"
        (end,) = ax.plot(*ends[agent], color=colour, linestyle="none", marker=marker)
        end.set_label("pinned" if held else "not pinned")
        label = short(run.labels[agent], 8)
        text = ax.annotate(label, ends[agent], (4, 4), textcoords="offset points", fontsize=7)
        text.set_parse_math(False)
    goals = run.goal[chosen, :2] + run.leader[-1, :2]
    ax.plot(*goals.T, color=VERMILLION, linestyle="none", marker="x", label="goal")
    ax.set_aspect("equal", adjustable="datalim")
    m = run.x.shape[2]
    for axis, component in ((ax.xaxis, 0), (ax.yaxis, 1)):
        unit = in_units(*run.units[component : component + 1])
        axis.set_label_text(f"{state_symbol(component, m)} {unit}", parse_math=False)
    return legend_above(ax, right=True)


def plot_estimates(ax: Axes, run: Run) -> Axes:
    """The first component of the disturbance (dotted) and its estimate (solid) of at most three
    agents."""
    rows = thinned_rows(len(run.times))
    chosen = shown_agents(run.d.shape[1], set(), MOST_ESTIMATES)
    times = run.times[rows]
    for rank, agent in enumerate(chosen):
        label = f"d̂, agent {short(run.labels[agent])}"
        values = run.dhat[rows, agent, 0]
        (line,) = ax.plot(times, values, color=SERIES[rank], marker=_marker(rows), label=label)
        line.set_linewidth(3.2 - rank)  # thinner from agent to agent: none hides another
    for agent in chosen:  # on top of all estimates
        (line,) = ax.plot(times, run.d[rows, agent, 0], color=INK, label="d")
        line.set(linestyle=DOTTED, linewidth=1.3)
    unit = "in their own units"
    if run.d.shape == run.x.shape:
        unit = f"{in_units(*run.units[:1])} per s"
    ax.set_ylabel(f"d and estimate d̂\n{unit}", parse_math=False)
    return legend_above(ax, right=True, widest=4)


def plot_errors(
    ax: Axes,
    times: Array,
    errors: dict[str, Array],
    *,
    envelope: Array | None = None,
    rate: float | None = None,
    units: Sequence[str] = (),
) -> Axes:
    """Errors, each (T,) with its name, and the certified envelope; on a logarithmic axis where they
    span decades.  Without one ``rate`` (1/s) adds a line that falls like exp(-rate t) from the
    first error, a slope and no bound.  ``units``: of the state components, where they are known."""
    rows = thinned_rows(len(times))
    for (name, values), colour in zip(errors.items(), (BLUE, PURPLE, GREEN), strict=False):
        shown = np.where(values[rows] > SMALLEST, values[rows], np.nan)
        ax.plot(times[rows], shown, color=colour, label=name, marker=_marker(rows))
    if envelope is not None:
        name = next(iter(errors)).split(",")[0]
        _draw_bound(ax, envelope[:, 0], resolved(envelope[:, 1]), f"certified bound on {name}")
    elif rate is not None:
        error = next(iter(errors.values()))
        # Clipped where exp would underflow or overflow.
        exponent = -rate * (times[rows] - times[0])
        slope = error[0] * np.exp(np.clip(exponent, -700, 0))
        # Not below the errors: the line would stretch the axis.
        lowest = max(0.5 * np.nanmin(error), SMALLEST)
        visible = np.where(slope > lowest, slope, np.nan)
        _draw_bound(ax, times[rows], visible, "slope of the certified rate")
    fit_heights(ax)
    ax.set_ylabel(f"errors\n{in_units(*units)}", parse_math=False)
    return legend_above(ax, right=True)


def plot_quantiles(ax: Axes, times: Array, errors: Array, *, colour: str, what: str) -> Axes:
    """Bands of 5 to 95 and of 25 to 75 percent, and the median; errors (R, T) with nan counted as
    infinite."""
    rows = thinned_rows(len(times))
    chosen = errors[:, rows]
    sizes = np.where(np.isnan(chosen), np.inf, chosen)
    ordered = np.sort(sizes, axis=0)
    # Of the sorted runs the first that at least this part of them do not exceed.
    places = np.ceil(np.multiply(LEVELS, len(ordered))).astype(int) - 1
    bands = np.clip(ordered[places], SMALLEST, None)
    finite = bands[np.isfinite(bands)]
    # Bands that end in infinity leave the picture at its top; a median stops there.
    top = 10 * finite.max() if len(finite) else 1.0
    low, lower, _, upper, high = np.where(np.isfinite(bands), bands, top)
    median = np.where(np.isfinite(bands[2]), bands[2], np.nan)
    shown = times[rows]
    wide = ax.fill_between(shown, low, high, color=colour, alpha=0.18, linewidth=0)
    wide.set_label("5 to 95 %")
    narrow = ax.fill_between(shown, lower, upper, color=colour, alpha=0.34, linewidth=0)
    narrow.set_label("25 to 75 %")
    ax.plot(shown, median, color=colour, label="median")
    fit_heights(ax, bands[np.isfinite(bands)])
    ax.set_ylabel(what)
    return ax


def plot_modes(ax: Axes, switches: Switches, end: float) -> Axes:
    """A band that shows which mode is active when: names for few modes, shades for many."""
    times = np.asarray(switches.times)
    modes = np.asarray(switches.modes)
    # A mode lasts until the next switch, the last one until the end.
    ends = np.minimum(np.append(times[1:], end), end)
    lengths = ends - times
    # A network of agents that move may have hundreds of graphs.
    used = np.unique(modes).tolist()
    named = len(used) <= MOST_NAMED_MODES
    shades: Any = (*SERIES[:4], INK, MUTED)
    if not named:
        shades = colormaps["cividis"](np.linspace(0, 1, len(used)))
    for shade, mode in zip(shades, used, strict=False):
        here = modes == mode
        begins, lasting = times[here].tolist(), lengths[here].tolist()
        spans = list(zip(begins, lasting, strict=True))
        bars = ax.broken_barh(spans, (0, 1), facecolors=shade, linewidth=0)
        if named:
            bars.set(alpha=0.75, label=short(switches.names[mode]))
    ax.set_yticks([])
    ax.set_ylim(0, 1)
    ax.grid(visible=False)
    ax.set_ylabel("mode", rotation=0, ha="right", va="center")
    if named:
        legend_above(ax, right=True, widest=MOST_NAMED_MODES)
    else:
        ax.set_title(f"{len(used)} graphs, {len(times) - 1} switches")
    return ax


def checked_envelope(envelope: Envelope | None, times: Array) -> Array | None:
    """Points (t, bound) as an array (k, 2); a function is asked at the samples.  Raises:
    ShapeError."""
    if envelope is None:
        return None
    if callable(envelope):
        # A certified bound can take a while to be computed at one time.
        chosen = times[thinned_rows(len(times), MOST_BOUNDS)]
        bound = np.asarray(envelope(chosen), dtype=np.float64)
        envelope = np.stack([chosen, bound], axis=1)
    points = np.asarray(envelope, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2:
        told = f"envelope must be points (t, bound), shape (k, 2) with k >= 2; got {points.shape}."
        raise ShapeError(told, key="envelope", cure="For example [[0, 4.0], [10, 0.5]].")
    return points


def _draw_bound(ax: Axes, times: Array, values: Array, label: str) -> None:
    ax.plot(times, values, color=INK, linestyle=DASHED, linewidth=1.2, label=label)


def _marker(rows: NDArray[np.intp]) -> str | None:
    """A run that ended at its start is a dot: a line through one point is nothing."""
    return "." if len(rows) == 1 else None


def in_time(ax: Axes, times: Array, clock: str = "s") -> Axes:
    """The axes with time along them, from the first to the last sample."""
    ax.set_xlabel(f"time t in {clock}")
    if times[-1] > 0:
        ax.set_xlim(0, times[-1])
    return ax


def _largest(values: Array) -> Array:
    return np.asarray(np.abs(values).max(axis=(1, 2)))
