"""The pictures of certified regions: methods against what was asked for, and single agents."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from matplotlib.figure import Figure

from dobc_design._show.text import Fragment
from dobc_design.certificate.regions import RegionClaim, Regions
from dobc_design.conditions.schedule.settling import Settling
from dobc_design.plotting.axes import shown_agents
from dobc_design.plotting.sheet import Sheet
from dobc_design.report import region_figures
from dobc_design.report.pictures import Picture
from dobc_design.report.region_stages import envelope_alt
from dobc_design.report.region_words import agents_sentence, lower, method_name
from dobc_design.report.svg import svg_text

WIDTH: Final = 4.6  # inches, of one drawing in a page
ALONE: Final = 5.2  # in a file


def region_pictures(regions: Regions) -> list[Picture]:
    """Two pictures, or one where there is no bound for single agents; none where there is nothing to be drawn."""
    if not regions.sized:
        return []
    pictures = [_methods(regions)]
    return [*pictures, _agents(regions)] if regions.agents else pictures


def envelope_picture(settling: Settling | None) -> Picture | None:
    """The certified bound of |e|_inf over time; None without a proved settling time."""
    if settling is None or settling.time is None:
        return None
    return _drawn(
        lambda figure: region_figures.plot_envelope(settling, ax=figure.add_subplot()),
        name="region-envelope",
        title="How fast the error falls, proved",
        height=3.1,
        alt=envelope_alt(settling),
        caption="Every start of the box stays below the curve. Marks: another certificate takes over.",
    )


def region_sheet(regions: Regions) -> Sheet:
    """Both pictures side by side, to be shown in a notebook or saved."""

    def draw(figure: Figure) -> None:
        figure.suptitle(regions.name, x=0.01, ha="left", fontsize=10, parse_math=False)
        spaces = figure.subplots(1, 2 if regions.agents else 1, squeeze=False)[0]
        region_figures.plot_regions(regions, ax=spaces[0])
        if regions.agents:
            region_figures.plot_starts(regions, ax=spaces[1])

    return Sheet(draw, width=2 * ALONE if regions.agents else ALONE, height=_height(regions) + 0.3)


def _methods(regions: Regions) -> Picture:
    return _drawn(
        lambda figure: region_figures.plot_regions(regions, ax=figure.add_subplot()),
        name="region-methods",
        title="How far each proof reaches",
        height=_height(regions),
        caption=_bars(regions),
        alt="Certified distance from the goals. " + " ".join(f"{_told(claim)}." for claim in regions.claims),
    )


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


def _agents(regions: Regions) -> Picture:
    pinned = {place for place, agent in enumerate(regions.agents) if agent.pinned}
    chosen = shown_agents(len(regions.agents), pinned, region_figures.MOST_AGENTS)
    some = len(chosen) < len(regions.agents)
    sentence = agents_sentence(regions, drawn=len(chosen) if some else None)
    band = " Dashed: the starts asked for." if regions.asked is not None else ""
    return _drawn(
        lambda figure: region_figures.plot_starts(regions, ax=figure.add_subplot()),
        name="region-agents",
        title="From where each agent may start",
        caption=sentence + band,
        height=_height(regions),
        alt=sentence,
    )


def _height(regions: Regions) -> float:
    """Inches; every method has its row."""
    return max(2.9, 1.1 + 0.42 * len(regions.claims))


def _drawn(
    draw: Callable[[Figure], object], *, name: str, title: str, caption: str, alt: str, height: float
) -> Picture:
    svg = svg_text(draw, name=name, alt=alt, width=WIDTH, height=height)
    return Picture(svg=Fragment(svg), title=title, caption=caption)
