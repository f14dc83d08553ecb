"""Which figures a report has, each with its caption and its text alternative, and how one becomes SVG inside a page.

The colours are those of Okabe and Ito that keep a contrast of 3:1 on white; in the SVG each is a CSS variable
with the colour itself as fallback, so that a page may exchange them in the dark.  Text stays text.  The
same drawing gives the same bytes: no date, no random identifiers.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final
from xml.etree import ElementTree

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from dobc_design._show.text import Fragment
from dobc_design.certificate.certificate import Certificate
from dobc_design.certificate.regions import RegionClaim, Regions
from dobc_design.conditions.schedule.decide import Settling
from dobc_design.falsification.suspect import Falsification
from dobc_design.plotting.look import (
    BLUE,
    GREEN,
    GRID,
    INK,
    MOST_AGENTS,
    MUTED,
    PAPER,
    PURPLE,
    VERMILLION,
    shown_agents,
    styled,
)
from dobc_design.plotting.runs import (
    MOST_COMPONENTS,
    MOST_ESTIMATES,
    in_time,
    plot_agents,
    plot_errors,
    plot_estimates,
)
from dobc_design.plotting.sheet import Sheet
from dobc_design.report import figures
from dobc_design.report.document import Picture
from dobc_design.report.drawing import (
    LEGEND,
    MOST_LABELLED,
    draw_network,
    drawn_labels,
    positions,
    proportions,
    too_large,
)
from dobc_design.report.formulas import bounds_of
from dobc_design.report.region_words import agents_sentence, envelope_alt, lower, method_name
from dobc_design.report.search_words import search_alt
from dobc_design.report.words import names_in_words, number, unreached_agents

if TYPE_CHECKING:
    from dobc_design.analysis.analysis import Analysis
    from dobc_design.simulation.trajectory import Trajectory

Values = NDArray[Any]

MOST_MODES = 6
ALONE: Final = 5.2  # inches, of one drawing in a file
_SUBSCRIPTS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")
VARIABLES = {
    INK: "ink",
    MUTED: "muted",
    GRID: "grid",
    PAPER: "paper",
    BLUE: "blue",
    VERMILLION: "vermillion",
    GREEN: "green",
    PURPLE: "purple",
}

_FONT = re.compile(r"font-family:[^;]*")
_LONG_DECIMAL = re.compile(r"-?\d+\.\d{3,}")
_REFERENCE = re.compile(r"url\(#([^)]+)\)")
_COLOUR = re.compile(r"#[0-9a-f]{6}\b")


def network_pictures(certificate: Certificate) -> tuple[tuple[Picture, ...], str]:
    """One drawing per mode, at most six, and a sentence that explains them or says why there is none."""
    problem = certificate.problem
    labels, pinned = problem.network.labels, problem.pinning.agents
    modes = list(problem.network.modes.items())[:MOST_MODES]
    pairs = {name: list(zip(arcs.listeners.tolist(), arcs.speakers.tolist(), strict=True)) for name, arcs in modes}
    total = sum(len(each) for each in pairs.values())
    if too_large(problem.n, total):
        return (), f"A network of {problem.n} agents and {total} arcs is too large to be drawn."
    # The modes stand on the same places, so that they can be compared.
    places = positions({pair for each in pairs.values() for pair in each}, problem.n)
    lost = {name: unreached_agents(certificate, name) for name in pairs}

    def picture(place: int, name: str) -> Picture:
        alt = f"Network of mode {name}: {problem.n} agents, {len(pairs[name])} arcs, pinned: "
        alt += names_in_words([labels[i] for i in pinned])
        away = [labels[i] for i in sorted(lost[name])]
        return Picture(
            name=f"network-{place + 1}",
            title=f"Mode {name}",
            caption="",
            alt=f"{alt}; not reached: {names_in_words(away)}." if away else f"{alt}.",
            draw=lambda ax: draw_network(
                ax,
                labels=labels,
                arcs=pairs[name],
                places=places,
                pinned=pinned,
                unreached=lost[name],
            ),
            width=3.4,
            height=3.4 * proportions(places),
        )

    pictures = tuple(picture(place, name) for place, name in enumerate(pairs))
    return pictures, _network_legend(labels, len(problem.network.modes), lost=any(lost.values()))


def _network_legend(labels: Sequence[str], modes: int, *, lost: bool) -> str:
    text = f"{LEGEND} Blue squares are pinned agents, circles are agents without a pin"
    text += "; a dashed orange circle is an agent that no pin reaches." if lost else "."
    alike = drawn_labels(labels)[1]
    if len(labels) > MOST_LABELLED:
        text += " Labels are left out."
    elif alike:
        text += f" “{alike}” is left out of the labels."
    if modes > MOST_MODES:
        text += f" The first {MOST_MODES} of {modes} modes are drawn."
    return text


def eigenvalue_pictures(certificate: Certificate, analysis: Analysis | None) -> Iterator[Picture]:
    """Spectra of A - WC, of Lambda and of J - K."""
    if analysis is None:
        return
    if analysis.spectrum is not None:
        values = np.array(analysis.spectrum.eigenvalues)
        yield Picture(
            name="spectrum-observer",
            title="Observer: eigenvalues of A − WC",
            caption="The estimation error decays when all lie left of the line; the slowest gives"
            f" {number(analysis.spectrum.rate)} 1/s.",
            alt=f"Eigenvalues of A minus W C in the complex plane: {_listed(values)}, in 1/s.",
            draw=lambda ax: figures.plot_spectrum(ax, {"A − WC": values}),
            height=_spectrum_height(values),
        )
    lambdas = {m.mode: np.array(m.lambda_eigenvalues) for m in analysis.modes if m.lambda_eigenvalues}
    if lambdas:
        yield _lambda_picture(certificate, dict(list(lambdas.items())[: 2 * MOST_MODES]))
    loops = {m.mode: np.array(m.loop_eigenvalues) for m in analysis.modes if m.loop_eigenvalues}
    if loops:
        chosen = dict(list(loops.items())[:MOST_MODES])
        rightmost = "; ".join(f"mode {name}: {number(float(v.real.max()))}" for name, v in chosen.items())
        yield Picture(
            name="spectrum-loop",
            title="Network: eigenvalues of J − K at the target",
            caption="Small errors decay, with the disturbance known, when all lie left of the line."
            " This says more than Λ about one mode, and nothing about switching.",
            alt=f"Eigenvalues of J minus K in the complex plane; the rightmost real parts are {rightmost} 1/s.",
            draw=lambda ax: figures.plot_spectrum(ax, chosen),
            height=_spectrum_height(*chosen.values()),
        )


def _lambda_picture(certificate: Certificate, lambdas: Mapping[str, Values]) -> Picture:
    known = {name: float(bound) for name, bound in bounds_of(certificate).items()}
    caption = "Lemma 1 asks for all of them to be negative; the largest is the diamond."
    if known:
        styles = zip(known.items(), figures.DASHES, strict=False)
        bounds = (f"{name} {number(value)} ({style})" for (name, value), style in styles)
        caption += f" It must stay below a bound that depends on P: for {', for '.join(bounds)}."
    largest = "; ".join(f"mode {name}: {number(float(v.max()))}" for name, v in lambdas.items())
    return Picture(
        name="spectrum-lambda",
        title="Network: eigenvalues of Λ(J) at the target",
        caption=caption,
        alt=f"Eigenvalues of Lambda; the largest are {largest} 1/s.",
        draw=lambda ax: figures.plot_lambda(ax, lambdas, bounds=known),
        height=2.3 + 0.22 * max(0, len(lambdas) - 4),
    )


def simulation_pictures(certificate: Certificate, trajectory: Trajectory | None) -> Iterator[Picture]:
    """States, estimates and error of one simulation."""
    if trajectory is None or len(trajectory.times) < 2:
        return
    for component in range(min(certificate.problem.m, MOST_COMPONENTS)):
        yield _state_picture(certificate, trajectory, component)
    if certificate.problem.groups:
        yield _estimate_picture(trajectory)
    yield _error_picture(certificate, trajectory)


def _error_picture(certificate: Certificate, trajectory: Trajectory) -> Picture:
    """The error with what is proved about it: a bound where this start is covered, else the slope alone."""
    error, proved = trajectory.error(), certificate.envelope(trajectory)
    bound = proved(trajectory.times) if proved.sources else None
    caption = "The largest |xᵢ − goal| of all agents and components, on a logarithmic axis."
    if bound is not None:
        caption += f" Dashed: what {' and '.join(proved.sources)} prove{'s' * (len(proved.sources) == 1)} about it."
    elif certificate.rate:
        caption += " Dashed: the slope of the certified rate, for comparison."
    return Picture(
        name="error",
        title="Distance to the goals",
        caption=caption,
        alt=f"Largest error over time: {number(float(error[0]))} at the start, {number(float(error[-1]))} at the end"
        + ("." if bound is None else f"; proved to be at most {number(float(bound[-1]))} there."),
        draw=lambda ax: in_time(
            plot_errors(
                ax,
                trajectory.times,
                {"|e|∞": error},
                envelope=None if bound is None else np.stack([trajectory.times, bound], axis=1),
                rate=certificate.rate,
            ),
            trajectory.times,
        ),
    )


def _state_picture(certificate: Certificate, trajectory: Trajectory, c: int) -> Picture:
    problem = certificate.problem
    several = problem.m > 1
    symbol = f"xᵢ,{str(c + 1).translate(_SUBSCRIPTS)}" if several else "xᵢ"
    who = "all agents" if problem.n <= MOST_AGENTS else f"{MOST_AGENTS} of the {problem.n} agents"
    last = trajectory.x[-1, :, c]
    return Picture(
        name=f"states-{c + 1}",
        title=f"States, component {c + 1} of {problem.m}" if several else "States",
        caption=f"{symbol}(t) of {who}; goals dashed.",
        alt=f"States over {number(float(trajectory.times[-1]))} s: at the end between {number(float(last.min()))} and"
        f" {number(float(last.max()))}.",
        draw=lambda ax: in_time(
            plot_agents(ax, trajectory, component=c, pinned=problem.pinning.agents), trajectory.times
        ),
    )


def _estimate_picture(trajectory: Trajectory) -> Picture:
    agents = min(len(trajectory.labels), MOST_ESTIMATES)
    which = "" if trajectory.d.shape[2] == 1 else ", first component"
    return Picture(
        name="estimates",
        title="Disturbance and estimate",
        caption=f"Disturbance d (dotted) and its estimate d̂ of {agents} agents{which}.",
        alt="Disturbance and estimate over time; they differ at the end by at most "
        f"{number(float(np.abs(trajectory.d[-1] - trajectory.dhat[-1]).max()))} over all agents.",
        draw=lambda ax: in_time(plot_estimates(ax, trajectory), trajectory.times),
    )


def _spectrum_height(*spectra: Values) -> float:
    """Inches; a row of real eigenvalues needs little."""
    return 2.9 if any(np.abs(values.imag).max(initial=0.0) > 1e-9 for values in spectra) else 2.1


def _listed(values: Values) -> str:
    shown = [f"{v.real:.4g}{v.imag:+.4g}i" if abs(v.imag) > 1e-12 else f"{v.real:.4g}" for v in values[:8]]
    return ", ".join(shown) + (" and more" if len(values) > 8 else "")


def region_pictures(regions: Regions) -> Iterator[Picture]:
    """How far each method reaches, and single agents where they have bounds."""
    if not regions.sized:
        return
    yield Picture(
        name="region-methods",
        title="How far each proof reaches",
        caption=_bars(regions),
        alt="Certified distance from the goals. " + " ".join(f"{_told(claim)}." for claim in regions.claims),
        draw=lambda ax: figures.plot_regions(ax, regions),
        height=_height(regions),
    )
    if regions.agents:
        pinned = {place for place, agent in enumerate(regions.agents) if agent.pinned}
        drawn = len(shown_agents(len(regions.agents), pinned, figures.MOST_STARTS))
        sentence = agents_sentence(regions, drawn=drawn if drawn < len(regions.agents) else None)
        yield Picture(
            name="region-agents",
            title="From where each agent may start",
            caption=sentence + (" Dashed: the starts asked for." if regions.asked is not None else ""),
            alt=sentence,
            draw=lambda ax: figures.plot_starts(ax, regions),
            height=_height(regions),
        )


def region_sheet(regions: Regions) -> Sheet:
    """Both pictures side by side, to be shown in a notebook or saved."""

    def draw(figure: Figure) -> None:
        figure.suptitle(regions.name, x=0.01, ha="left", fontsize=10, parse_math=False)
        spaces = figure.subplots(1, 2 if regions.agents else 1, squeeze=False)[0]
        figures.plot_regions(spaces[0], regions)
        if regions.agents:
            figures.plot_starts(spaces[1], regions)

    return Sheet(draw, width=2 * ALONE if regions.agents else ALONE, height=_height(regions) + 0.3)


def _bars(regions: Regions) -> str:
    parts = []
    if any(claim.box for claim in regions.claims):
        parts.append("Bars: all agents may be off by this much at once.")
    if any(claim.kind == "ball" for claim in regions.claims):
        parts.append("Thin lines: one agent alone, the others at their goals.")
    if regions.asked is not None:
        parts.append("Dashed: what was asked for, of all agents at once.")
    if regions.rest is not None:
        parts.append("Dotted: another equilibrium.")
    return " ".join(parts)


def _told(claim: RegionClaim) -> str:
    name = method_name(claim)
    if claim.kind in ("box", "ball"):
        return f"{name}: {lower(claim.box)} for all agents at once, {lower(claim.ball)} for one alone"
    return f"{name}: " + {"everywhere": "every start", "near": "no radius"}.get(claim.kind, "nothing proved")


def _height(regions: Regions) -> float:
    """Inches; every method has its row."""
    return max(2.9, 1.1 + 0.42 * len(regions.claims))


def envelope_pictures(settling: Settling | None) -> Iterator[Picture]:
    """The certified bound of |e|_inf over time; nothing without a proved settling time."""
    if settling is not None and settling.time is not None:
        yield Picture(
            name="region-envelope",
            title="How fast the error falls, proved",
            caption="Every start of the box stays below the curve. Marks: another certificate takes over.",
            alt=envelope_alt(settling),
            draw=lambda ax: figures.plot_envelope(ax, settling),
            height=3.1,
        )


def search_picture(search: Falsification, place: int) -> Picture | None:
    """What a search found, the ``place``-th of the report; None where it found nothing."""
    if not search.suspects:
        return None
    return Picture(
        name=f"search-{place + 1}",
        title="What the search found",
        caption="Solid: the agents rest there, which is proved. Dashed: simulated runs, which refute nothing.",
        alt=search_alt(search),
        draw=lambda ax: figures.plot_search(ax, search),
    )


def search_sheet(searches: Sequence[Falsification]) -> Sheet | None:
    """The searches that found anything side by side, to be shown or saved; None where nothing was found."""
    found = [search for search in searches if search.suspects]
    if not found:
        return None

    def draw(figure: Figure) -> None:
        figure.suptitle(found[0].name, x=0.01, ha="left", fontsize=10, parse_math=False)
        for space, search in zip(figure.subplots(1, len(found), squeeze=False)[0], found, strict=True):
            figures.plot_search(space, search)

    return Sheet(draw, width=ALONE * len(found), height=3.3)


def svg_of(picture: Picture) -> Fragment:
    """The picture as one <svg> element."""
    buffer = io.StringIO()
    with styled():
        figure = Figure(figsize=(picture.width, picture.height), layout="constrained")
        picture.draw(figure.add_subplot())
        nothing = {"Date": None, "Creator": None, "Format": None, "Type": None}
        figure.savefig(buffer, format="svg", metadata=nothing, transparent=True)
    return Fragment(_inline(buffer.getvalue(), name=picture.name, alt=picture.alt))


def _inline(text: str, *, name: str, alt: str) -> str:
    """Make the SVG file an element of a page: own identifiers, colours as variables, nothing global."""
    root = ElementTree.fromstring(text)
    for parent in list(root.iter()):
        for child in list(parent):
            if _local(child.tag) in ("metadata", "style"):  # a style inside would hold for the whole page
                parent.remove(child)
    new_names = _referenced(root, name)
    for element in root.iter():
        element.tag = _local(element.tag)
        attributes = {_local(key): value for key, value in element.attrib.items()}
        element.attrib.clear()
        for key, value in attributes.items():
            if key != "id":
                element.set(key, _attribute(key, value, new_names))
            elif value in new_names:
                element.set("id", new_names[value])
        if element.text is not None and not element.text.strip():
            element.text = None
        element.tail = None
    for key in ("width", "height", "version"):
        root.attrib.pop(key, None)
    root.set("xmlns", "http://www.w3.org/2000/svg")
    root.set("style", "stroke-linejoin: round; stroke-linecap: butt")
    root.set("role", "img")
    root.set("aria-label", alt)
    return ElementTree.tostring(root, encoding="unicode")


def _referenced(root: ElementTree.Element, name: str) -> dict[str, str]:
    """New identifiers for those that something refers to, numbered as they are met."""
    names: dict[str, str] = {}
    for element in root.iter():
        for key, value in element.attrib.items():
            found = _REFERENCE.findall(value) if "url(#" in value else []
            if _local(key) == "href":
                found = [value.removeprefix("#")]
            for old in found:
                names.setdefault(old, f"{name}-{len(names) + 1}")
    return names


def _attribute(key: str, value: str, names: dict[str, str]) -> str:
    if key == "href":
        return "#" + names[value.removeprefix("#")]
    if "url(#" in value:
        value = _REFERENCE.sub(lambda match: f"url(#{names[match.group(1)]})", value)
    if key == "style":
        value = _FONT.sub("font-family: inherit", value)
        value = _COLOUR.sub(lambda match: _variable(match.group()), value)
    if key == "d":
        value = " ".join(value.split())
    return _LONG_DECIMAL.sub(lambda match: f"{float(match.group()):.2f}".rstrip("0").rstrip("."), value)


def _variable(colour: str) -> str:
    return f"var(--figure-{VARIABLES[colour]}, {colour})" if colour in VARIABLES else colour


def _local(name: str) -> str:
    return name.rsplit("}", 1)[-1]
