"""Which figures a report has, each with its caption and its text alternative, and how one becomes
SVG inside a page.

In the SVG each colour is a CSS variable with the colour itself as fallback, so that a page may
exchange them in the dark.  Text stays text.  The same drawing gives the same bytes: no date, no
random identifiers.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from numpy.typing import NDArray

from dobc_design._show.text import Fragment, escape_html, lower, with_unit
from dobc_design.certificate.certificate import Certificate
from dobc_design.certificate.regions import RegionClaim, Regions
from dobc_design.conditions.schedule.settling import Settling
from dobc_design.exact.reading import some
from dobc_design.falsification.suspect import Falsification
from dobc_design.plotting import look, networks, runs
from dobc_design.plotting.look import Sheet
from dobc_design.plotting.networks import MOST_AGENTS, MOST_ARCS, MOST_MODES
from dobc_design.plotting.regions import (
    drawn_agents,
    height_of,
    plot_regions,
    plot_starts,
    side_by_side,
)
from dobc_design.plotting.weights import draw_band, plot_weights
from dobc_design.problem.problem import Problem
from dobc_design.report import figures, region_words

from .document import Picture
from .words import (
    agents_in_words,
    bounds_of,
    eigenvalues,
    number,
    unreached_agents,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from dobc_design.analysis.analysis import Analysis, SpectrumResult
    from dobc_design.simulation.trajectory import Trajectory

Values = NDArray[Any]

_NAMES = ("ink", "muted", "grid", "paper", "blue", "vermillion", "green", "purple")
_COLOURS = {name: getattr(look, name.upper()) for name in _NAMES}
VARIABLES = {colour: f"var(--figure-{name}, {colour})" for name, colour in _COLOURS.items()}
SLOW = (
    "in two simulated runs from one start. "
    "Slow signal, modes beneath: of short rounds that keep the guarantee the slowest for the "
    "linearised loop."
)
_UNSEEN = re.compile(r"<(metadata|style)\b.*?</\1>|<[?!][^>]*>|(?<=>)\s+(?=<)|\A\s+", re.DOTALL)
_TAG = re.compile(r"<[^>]*>")
_VIEW = re.compile(r'viewBox="[^"]*"')
_NUMBERED = re.compile(r' id="[^"]*_\d+"')  # of a group, to which nothing refers
_HASH = re.compile(r'(?<=["#])[a-z][0-9a-f]{10}(?=[")])')  # of what something refers to
_FONT = re.compile(r"font-family:[^;\"]*")
_LONG_DECIMAL = re.compile(r"-?\d+\.\d{3,}")
_COLOUR = re.compile(r"#[0-9a-f]{6}\b")


def network_pictures(certificate: Certificate) -> tuple[list[Picture], str]:
    """One drawing per mode, at most six, and a sentence that explains them or says why there is
    none."""
    problem = certificate.problem
    labels = problem.network.names
    modes = list(problem.network.modes.items())[:MOST_MODES]
    pairs = {
        name: {(listener, speaker): weight for listener, speaker, weight in arcs}
        for name, arcs in modes
    }
    # A drawing of thousands of arcs shows nothing and makes a page of megabytes.
    total = sum(map(len, pairs.values()))
    if problem.n > MOST_AGENTS or total > MOST_ARCS:
        return [], f"A network of {problem.n} agents and {total} arcs is too large to be drawn."
    # The modes stand on the same places, so that they can be compared.
    places = networks.positions({pair for each in pairs.values() for pair in each}, len(labels))
    drawn = []
    lost_in = {name: unreached_agents(certificate, name) for name in pairs}
    for place, (name, arcs) in enumerate(pairs.items(), 1):
        lost = lost_in[name]
        pinned = problem.sources(name)
        alt = f"Network of mode {name}: {problem.n} agents, {len(arcs)} arcs"
        if problem.has_target:
            alt += f", pinned: {agents_in_words(problem, tuple(problem.pinning.of(name)))}"
        if problem.fixed:
            alt += f"; fixed nodes: {some(tuple(problem.fixed), MOST_MODES)}"
        if lost:
            alt += f"; not reached: {agents_in_words(problem, sorted(lost))}"
        draw = partial(
            networks.draw_network,
            labels=labels,
            arcs=arcs,
            places=places,
            pinned=pinned,
            unreached=lost,
        )
        picture = Picture(
            f"network-{place}",
            f"Mode {name}",
            alt=f"{alt}.",
            draw=draw,
            width=3.4,
            height=3.4 * networks.proportions(places),
        )
        drawn.append(picture)
    legend = _network_legend(problem, lost=any(lost_in.values()))
    if any(map(networks.shows_weights, pairs.values())):
        legend += " Numbers on arrows are weights."
    return drawn, legend


def _network_legend(problem: Problem, *, lost: bool) -> str:
    labels, modes = problem.network.names, len(problem.network.modes)
    text = networks.LEGEND
    if problem.has_target or problem.fixed:
        squares = "fixed nodes" if problem.fixed else "pinned agents"
        text += f" Blue squares are {squares}, circles are agents without a pin"
        text += "; a dashed orange circle is an agent that no pin reaches." if lost else "."
    elif lost:
        text += " A dashed orange circle is an agent of a group that hears nobody outside of it."
    alike = networks.drawn_labels(labels)[1]
    if len(labels) > networks.MOST_LABELLED:
        text += " Labels are left out."
    elif alike:
        text += f" “{alike}” is left out of the labels."
    if modes > MOST_MODES:
        text += f" The first {MOST_MODES} of {modes} modes are drawn."
    return text


def eigenvalue_pictures(certificate: Certificate, analysis: Analysis) -> Iterator[Picture]:
    """Spectra of A - WC, of Lambda and of J - K."""
    if analysis.spectrum is not None:
        yield _observer_picture(analysis.spectrum)
    lambdas: dict[str, Values] = {}
    loops: dict[str, Values] = {}
    for mode in analysis.modes:
        # A row needs less room than a plane of its own.
        if mode.lambda_eigenvalues and len(lambdas) < 2 * MOST_MODES:
            lambdas[mode.mode] = np.array(mode.lambda_eigenvalues)
        if mode.loop_eigenvalues and len(loops) < MOST_MODES:
            loops[mode.mode] = np.array(mode.loop_eigenvalues)
    # Where agents agree Lambda has the eigenvalue 0, which says nothing of them.
    if lambdas and not certificate.problem.agrees:
        yield _lambda_picture(certificate, lambdas)
    if loops:
        yield _loop_picture(loops)


def _observer_picture(spectrum: SpectrumResult) -> Picture:
    values = np.array(spectrum.eigenvalues)
    told = eigenvalues(values.tolist())
    return Picture(
        "spectrum-observer",
        "Observer: eigenvalues of A − WC",
        caption="The estimation error decays when all lie left of the line; the slowest gives"
        f" {number(spectrum.rate)} 1/s.",
        alt=f"Eigenvalues of A minus W C in the complex plane: {told}, in 1/s.",
        draw=lambda ax: figures.plot_spectrum(ax, {"A − WC": values}),
        height=_spectrum_height(values),
    )


def _loop_picture(loops: Mapping[str, Values]) -> Picture:
    rightmost = _by_mode({name: values.real for name, values in loops.items()})
    return Picture(
        "spectrum-loop",
        "Network: eigenvalues of J − K at the target",
        caption="Small errors decay, with the disturbance known, when all lie left of the line."
        " This says more than Λ about one mode, and nothing about switching.",
        alt="Eigenvalues of J minus K in the complex plane; the rightmost real parts are "
        f"{rightmost} 1/s.",
        draw=lambda ax: figures.plot_spectrum(ax, loops),
        height=_spectrum_height(*loops.values()),
    )


def _lambda_picture(certificate: Certificate, lambdas: Mapping[str, Values]) -> Picture:
    known = {name: float(bound) for name, bound in bounds_of(certificate).items()}
    caption = "Lemma 1 asks for all of them to be negative; the largest is the diamond."
    if known:
        told = []
        for (name, value), style in zip(known.items(), figures.DASHES, strict=False):
            told.append(f"{name} {number(value)} ({style})")
        bounds = ", for ".join(told)
        caption += f" It must stay below a bound that depends on P: for {bounds}."
    return Picture(
        "spectrum-lambda",
        "Network: eigenvalues of Λ(J) at the target",
        caption=caption,
        alt=f"Eigenvalues of Lambda; the largest are {_by_mode(lambdas)} 1/s.",
        draw=lambda ax: figures.plot_lambda(ax, lambdas, bounds=known),
        height=2.3 + 0.22 * max(0, len(lambdas) - 4),
    )


def _by_mode(values: Mapping[str, Values]) -> str:
    """The largest value of each mode."""
    return "; ".join(f"mode {name}: {number(v.max())}" for name, v in values.items())


def _spectrum_height(*spectra: Values) -> float:
    """Inches; a row of real eigenvalues needs little."""
    return 2.9 if any(abs(values.imag).max(initial=0.0) > 1e-9 for values in spectra) else 2.1


def simulation_pictures(certificate: Certificate, trajectory: Trajectory) -> Iterator[Picture]:
    """States and estimates of one simulation; nothing where it ended at its start."""
    if len(trajectory.times) < 2:
        return
    problem = certificate.problem
    # States of a formation are places; those of [dynamics] are not.
    if problem.offsets and problem.m > 1 and problem.dynamics is None:
        yield _formation_picture(problem, trajectory)
    for component in range(min(problem.m, runs.MOST_COMPONENTS)):
        yield _state_picture(certificate, trajectory, component)
    if problem.groups:
        yield _estimate_picture(trajectory)


def _formation_picture(problem: Problem, trajectory: Trajectory) -> Picture:
    """Paths, goals and who listens to whom at the end, in the first two components."""
    mode = trajectory.switches.names[int(trajectory.switches.at(trajectory.times[-1:])[0])]
    arcs = [(listener, speaker) for listener, speaker, _ in problem.network.modes.get(mode, ())]
    draw = partial(runs.plot_plane, run=trajectory, pinned=problem.pinning.agents, arcs=arcs)
    text = "Paths of the agents in their first two components, to the same scale"
    return Picture(
        "formation",
        "The formation",
        caption=f"{text}. Crosses are goals; arrows point to the agent that listens.",
        alt=f"{text}; at the end they are at most {number(trajectory.error()[-1])} from their "
        "goals.",
        draw=draw,
        height=3.6,
    )


def _state_picture(certificate: Certificate, trajectory: Trajectory, component: int) -> Picture:
    problem = certificate.problem
    ends = trajectory.ends(certificate)
    dashed = "; goals dashed"
    if problem.agrees:
        dashed = "" if ends is None else "; between the dashed lines they end, which is proved"
    times, last = trajectory.times, trajectory.x[-1, :, component]
    title, who = "States", "all agents"
    if problem.m > 1:
        title = f"States, component {component + 1} of {problem.m}"
    if problem.n > look.MOST_AGENTS:
        who = f"{look.MOST_AGENTS} of the {problem.n} agents"
    # The text for the blind tells where the curves end.
    unit = "".join(problem.units[component : component + 1])
    end, least, most = (number(value) for value in (times[-1], last.min(), last.max()))

    def draw(ax: Axes) -> object:
        pinned = problem.pinning.agents
        drawn = runs.plot_agents(ax, trajectory, component=component, pinned=pinned, ends=ends)
        return draw_band(runs.in_time(drawn, times), trajectory.switches, times[-1])

    return Picture(
        f"states-{component + 1}",
        title,
        caption=f"{runs.state_symbol(component, problem.m)}(t) of {who}{dashed}.",
        alt=with_unit(f"States over {end} s: at the end between {least} and {most}", unit) + ".",
        draw=draw,
    )


def _estimate_picture(trajectory: Trajectory) -> Picture:
    d, dhat = trajectory.d, trajectory.dhat
    agents = min(len(trajectory.labels), runs.MOST_ESTIMATES)
    which = "" if d.shape[2] == 1 else ", first component"
    left = number(abs(d[-1] - dhat[-1]).max())

    def draw(ax: Axes) -> object:
        drawn = runs.in_time(runs.plot_estimates(ax, trajectory), trajectory.times)
        return draw_band(drawn, trajectory.switches, trajectory.times[-1])

    return Picture(
        "estimates",
        "Disturbance and estimate",
        caption=f"Disturbance d (dotted) and its estimate d̂ of {agents} agents{which}.",
        alt=f"Disturbance and estimate over time; they differ at the end by at most {left} "
        "over all agents.",
        draw=draw,
    )


def error_picture(
    certificate: Certificate, trajectory: Trajectory, worst: Trajectory | None = None
) -> Picture:
    """The error with what is proved about it, bound or slope; beside it that of ``worst``, with a
    slow signal."""
    times, error = trajectory.times, trajectory.error()
    first, last = number(error[0]), number(error[-1])
    alt = f"Largest error over time: {first} at the start, {last} at the end"
    name = runs.MEASURED[trajectory.measured]
    solid = "Solid: |e|∞, the largest |xᵢ − goal| of all agents"
    title = "Largest distance to the goals over time"
    if certificate.problem.agrees:
        solid = f"Solid: {name}, the largest disagreement of two agents"
        title = "Largest disagreement over time"
    caption = f"{solid} in one simulated run."
    errors, switches = {name: error}, trajectory.switches
    # A run that ended early is not beside the other at the same times.
    if worst is not None and len(worst.times) == len(times):
        # Both runs in one picture: how much the signal matters is seen at once.
        slow = worst.error()
        errors = {f"{name}, drawn signal": error, f"{name}, slow signal": slow}
        switches = worst.switches
        caption = f"{solid}, {SLOW}"
        alt += f", with the slow signal {number(slow[-1])}"
    proved, envelope = certificate.envelope(trajectory), None
    if proved.sources:
        bound = proved(times)
        envelope = np.stack([times, bound], axis=1)
        sources = " and ".join(proved.sources)
        caption += f" Dashed: certified upper bound for this start ({sources})."
        caption += " It may begin above the run: it holds for all runs from starts as large."
        alt += f"; proved to be at most {number(bound[-1])} there"
    elif certificate.rate:
        caption += " Dashed: the slope of the certified rate, for comparison."

    def draw(ax: Axes) -> object:
        runs.plot_errors(
            ax,
            times=times,
            errors=errors,
            envelope=envelope,
            rate=certificate.rate,
            units=certificate.problem.units,
        )
        return draw_band(runs.in_time(ax, times), switches, times[-1])

    return Picture(
        "error",
        title,
        caption=caption,
        alt=f"{alt}.",
        draw=draw,
        width=4.8,
    )


def region_pictures(regions: Regions) -> Iterator[Picture]:
    """How far each method reaches, and single agents where they have bounds."""
    if not regions.sized:
        return
    yield _methods_picture(regions)
    if regions.agents:
        # That some are left out is said only where it is so.
        drawn = len(drawn_agents(regions))
        some = drawn if drawn < len(regions.agents) else None
        sentence = region_words.agents_sentence(regions, drawn=some)
        asked = "" if regions.asked is None else " Dashed: the starts asked for."
        yield Picture(
            "region-agents",
            "From where each agent may start",
            caption=sentence + asked,
            alt=sentence,
            draw=lambda ax: plot_starts(ax, regions),
            height=height_of(regions),
        )


def _methods_picture(regions: Regions) -> Picture:
    """How far each method reaches, explained by what there is to be seen."""
    claims, bars = regions.claims, []
    if any(claim.box for claim in claims):
        bars.append("Bars: all agents may be off by this much at once.")
    if any(claim.kind == "ball" for claim in claims):
        bars.append("Thin lines: one agent alone, the others at their goals.")
    if regions.asked is not None:
        bars.append("Dashed: what was asked for, of all agents at once.")
    if regions.rest is not None:
        bars.append("Dotted: another equilibrium.")
    told = " ".join(f"{_told(claim, regions.unit)}." for claim in claims)
    return Picture(
        "region-methods",
        "How far each proof reaches",
        caption=" ".join(bars),
        alt=f"Certified {'differences' if regions.agree else 'distance from the goals'}. {told}",
        draw=lambda ax: plot_regions(ax, regions),
        height=height_of(regions),
    )


def _told(claim: RegionClaim, unit: str) -> str:
    """How far one method reaches."""
    reach = {"everywhere": "every start", "near": "no radius"}.get(claim.kind, "nothing proved")
    if claim.kind in ("box", "ball"):
        box, ball = lower(claim.box, unit), lower(claim.ball, unit)
        reach = f"{box} for all agents at once, {ball} for one alone"
    return f"{claim.method}: {reach}"


def envelope_pictures(settling: Settling | None) -> Iterator[Picture]:
    """The certified bound of |e|_inf over time; nothing without a proved settling time."""
    if settling is not None and settling.time is not None:
        yield Picture(
            "region-envelope",
            "How fast the error falls, proved",
            caption="Every start of the box stays below the curve. Marks: another certificate "
            "takes over.",
            alt=region_words.envelope_alt(settling),
            draw=lambda ax: figures.plot_envelope(ax, settling),
            height=3.1,
        )


def weight_pictures(certificate: Certificate) -> Iterator[Picture]:
    """The weights of a few agents over one round of phases; nothing without them."""
    weights, labels = certificate.weights, certificate.problem.network.labels
    if not weights:
        return
    sizes = [float(x) for _, phase in weights for v in phase.v for x in v]
    least, most = number(min(sizes)), number(max(sizes))
    yield Picture(
        "weights",
        "Weights of the agents that prove it",
        caption="The largest |eᵢ|/vᵢ(t) of all agents grows at most by estimation errors. Where "
        "the mode changes (dotted: it may) the next weights are larger by at least the factor of "
        "the certified rate.",
        alt=f"Weights over one round of {len(weights)} phases, from {least} to {most}.",
        draw=lambda ax: plot_weights(ax, weights, labels=labels),
        width=4.8,
    )


def search_picture(search: Falsification, place: int, *, unit: str) -> Picture | None:
    """What a search found, the ``place``-th of the report; None where it found nothing."""
    if not search.suspects:
        return None
    return Picture(
        f"search-{place + 1}",
        "What the search found",
        caption="Solid: the agents rest there, which is proved. Dashed: simulated runs, which "
        "refute nothing.",
        alt=region_words.search_alt(search),
        draw=lambda ax: figures.plot_search(ax, search, unit=unit),
    )


def search_sheet(searches: Sequence[Falsification]) -> Sheet | None:
    """The searches that found anything side by side, to be shown or saved; None where nothing was
    found."""
    found = [search for search in searches if search.suspects]
    draw = [partial(figures.plot_search, search=search) for search in found]
    return side_by_side(found[0].name, draw, 3.3) if found else None


def svg_of(picture: Picture) -> Fragment:
    """The picture as one <svg> element."""
    buffer = io.StringIO()
    with look.styled():
        layout = ConstrainedLayoutEngine()
        figure = Figure(figsize=(picture.width, picture.height), layout=layout)
        FigureCanvasSVG(figure)
        picture.draw(figure.add_subplot())
        # Matplotlib would draw everything once for the layout and once more for the file.
        layout.execute(figure)
        figure.set_layout_engine(None)
        figure.savefig(buffer, format="svg", metadata=look.NOTHING["svg"], transparent=True)
    return Fragment(_inline(buffer.getvalue(), name=picture.name, alt=picture.alt))


def _inline(text: str, *, name: str, alt: str) -> str:
    """Make the SVG file an element of a page: own identifiers, colours as variables, nothing
    global, and nothing that is not seen."""
    bare = _UNSEEN.sub("", text).rstrip()
    root, rest = _TAG.search(bare), _TAG.sub("", bare, count=1)
    # The page decides how large a picture is; its viewBox keeps the proportions.
    box = _VIEW.search(bare)
    if root is None or box is None:
        raise ValueError("Matplotlib's SVG has no root with a viewBox.")
    style = "stroke-linejoin: round; stroke-linecap: butt"
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" {_short_tag(box[0])} style="{style}" role="img"'
    )
    # Pictures share a page: the same identifier twice would mix them up.
    own = _TAG.sub(lambda tag: _HASH.sub(rf"{name}-\g<0>", _short_tag(tag[0])), rest)
    return f'{head} aria-label="{escape_html(alt)}">{own}'


def _short_tag(tag: str) -> str:
    """A tag inside a page, with decimals that are no longer than can be seen."""
    text = " ".join(_NUMBERED.sub("", tag).split()).replace("xlink:href", "href")
    text = _FONT.sub("font-family: inherit", text)
    text = _COLOUR.sub(lambda match: VARIABLES.get(match[0], match[0]), text)
    return _LONG_DECIMAL.sub(_shortened, text)


def _shortened(decimal: re.Match[str]) -> str:
    return f"{float(decimal.group()):.2f}".rstrip("0").rstrip(".")
