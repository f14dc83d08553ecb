"""Which figures a report has, each with its caption and its text alternative."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from dobc_design._show.text import Fragment
from dobc_design.certificate.certificate import Certificate
from dobc_design.report import figures
from dobc_design.report.drawing import LEGEND, MOST_LABELLED, draw_network, drawn_labels, proportions, too_large
from dobc_design.report.formulas import bounds_of
from dobc_design.report.layout import positions
from dobc_design.report.network_words import names_in_words, unreached_agents
from dobc_design.report.svg import svg_text
from dobc_design.report.words import number

if TYPE_CHECKING:
    from dobc_design.analysis.analysis import Analysis
    from dobc_design.simulation.trajectory import Trajectory

Values = NDArray[Any]

MOST_MODES = 6
MOST_COMPONENTS = 3
MOST_ESTIMATES = 3
_SUBSCRIPTS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """A figure as an inline SVG with a caption; ``title`` is user text where it names a mode."""

    svg: Fragment
    title: str
    caption: str


def network_pictures(certificate: Certificate) -> tuple[list[Picture], str]:
    """One drawing per mode, at most six, and a sentence that explains them or says why there is none."""
    problem = certificate.problem
    modes = list(problem.network.modes.items())[:MOST_MODES]
    pairs = {name: list(zip(arcs.listeners.tolist(), arcs.speakers.tolist(), strict=True)) for name, arcs in modes}
    total = sum(len(each) for each in pairs.values())
    if too_large(problem.n, total):
        return [], f"A network of {problem.n} agents and {total} arcs is too large to be drawn."
    # The modes stand on the same places, so that they can be compared.
    places = positions({pair for each in pairs.values() for pair in each}, problem.n)
    pinned = problem.pinning.agents
    pictures, anybody_lost = [], False
    for place, (name, each) in enumerate(pairs.items()):
        lost = unreached_agents(certificate, name)
        anybody_lost = anybody_lost or bool(lost)
        alt = f"Network of mode {name}: {problem.n} agents, {len(each)} arcs, pinned: "
        alt += names_in_words([problem.network.labels[i] for i in pinned])
        alt += f"; not reached: {names_in_words([problem.network.labels[i] for i in sorted(lost)])}." if lost else "."

        def draw(figure: Figure, each: list[tuple[int, int]] = each, lost: set[int] = lost) -> None:
            draw_network(
                labels=problem.network.labels,
                arcs=each,
                places=places,
                pinned=pinned,
                unreached=lost,
                ax=figure.add_subplot(),
            )

        svg = svg_text(draw, name=f"network-{place + 1}", alt=alt, width=3.4, height=3.4 * proportions(places))
        pictures.append(Picture(svg=Fragment(svg), title=f"Mode {name}", caption=""))
    return pictures, _network_legend(problem.network.labels, len(problem.network.modes), lost=anybody_lost)


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


def eigenvalue_pictures(certificate: Certificate, analysis: Analysis | None) -> list[Picture]:
    """Spectra of A - WC, of Lambda and of J - K."""
    if analysis is None:
        return []
    pictures = []
    if analysis.spectrum is not None:
        values = np.array(analysis.spectrum.eigenvalues)
        rate = analysis.spectrum.rate
        pictures.append(
            _plotted(
                lambda figure: figures.plot_spectrum({"A − WC": values}, ax=figure.add_subplot()),
                name="spectrum-observer",
                title="Observer: eigenvalues of A − WC",
                caption="The estimation error decays when all lie left of the line; the slowest gives"
                f" {number(rate)} 1/s.",
                height=_spectrum_height(values),
                alt=f"Eigenvalues of A minus W C in the complex plane: {_listed(values)}, in 1/s.",
            )
        )
    lambdas = {m.mode: np.array(m.lambda_eigenvalues) for m in analysis.modes if m.lambda_eigenvalues}
    loops = {m.mode: np.array(m.loop_eigenvalues) for m in analysis.modes if m.loop_eigenvalues}
    if lambdas:
        pictures.append(_lambda_picture(certificate, dict(list(lambdas.items())[: 2 * MOST_MODES])))
    if loops:
        chosen = dict(list(loops.items())[:MOST_MODES])
        pictures.append(
            _plotted(
                lambda figure: figures.plot_spectrum(chosen, ax=figure.add_subplot()),
                name="spectrum-loop",
                title="Network: eigenvalues of J − K at the target",
                caption="Small errors decay, with the disturbance known, when all lie left of the line."
                " This says more than Λ about one mode, and nothing about switching.",
                height=_spectrum_height(*chosen.values()),
                alt="Eigenvalues of J minus K in the complex plane; the rightmost real parts are "
                + "; ".join(f"mode {name}: {number(float(v.real.max()))}" for name, v in chosen.items())
                + " 1/s.",
            )
        )
    return pictures


def _lambda_picture(certificate: Certificate, lambdas: Mapping[str, Values]) -> Picture:
    known = {name: float(bound) for name, bound in bounds_of(certificate).items()}
    caption = "Lemma 1 asks for all of them to be negative; the largest is the diamond."
    if known:
        styled = zip(known.items(), figures.DASHES, strict=False)
        bounds = (f"{name} {number(value)} ({style})" for (name, value), style in styled)
        caption += f" It must stay below a bound that depends on P: for {', for '.join(bounds)}."
    return _plotted(
        lambda figure: figures.plot_lambda(lambdas, bounds=known, ax=figure.add_subplot()),
        name="spectrum-lambda",
        title="Network: eigenvalues of Λ(J) at the target",
        caption=caption,
        alt="Eigenvalues of Lambda; the largest are "
        + "; ".join(f"mode {name}: {number(float(v.max()))}" for name, v in lambdas.items())
        + " 1/s.",
        height=2.3 + 0.22 * max(0, len(lambdas) - 4),
    )


def simulation_pictures(certificate: Certificate, trajectory: Trajectory | None) -> list[Picture]:
    """States, estimates and error of one simulation."""
    if trajectory is None or len(trajectory.times) < 2:
        return []
    components = range(min(certificate.problem.m, MOST_COMPONENTS))
    pictures = [_state_picture(certificate, trajectory, c) for c in components]
    if certificate.problem.groups:
        pictures.append(_estimate_picture(trajectory))
    pictures.append(_error_picture(certificate, trajectory))
    return pictures


def _error_picture(certificate: Certificate, trajectory: Trajectory) -> Picture:
    """The error with what is proved about it: a bound where this start is covered, else the slope alone."""
    error, proved = trajectory.error(), certificate.envelope(trajectory)
    bound = proved(trajectory.times) if proved.sources else None
    caption = "The largest |xᵢ − goal| of all agents and components, on a logarithmic axis."
    if bound is not None:
        caption += f" Dashed: what {' and '.join(proved.sources)} prove{'s' * (len(proved.sources) == 1)} about it."
    elif certificate.rate:
        caption += " Dashed: the slope of the certified rate, for comparison."
    return _plotted(
        lambda figure: figures.plot_error(
            trajectory.times, error, rate=certificate.rate, bound=bound, ax=figure.add_subplot()
        ),
        name="error",
        title="Distance to the goals",
        caption=caption,
        alt=f"Largest error over time: {number(float(error[0]))} at the start, {number(float(error[-1]))} at the end"
        + ("." if bound is None else f"; proved to be at most {number(float(bound[-1]))} there."),
    )


def _state_picture(certificate: Certificate, trajectory: Trajectory, c: int) -> Picture:
    problem = certificate.problem
    several = problem.m > 1
    symbol = f"xᵢ,{str(c + 1).translate(_SUBSCRIPTS)}" if several else "xᵢ"
    who = "all agents" if problem.n <= figures.MOST_AGENTS else f"{figures.MOST_AGENTS} of the {problem.n} agents"
    last = trajectory.x[-1, :, c]
    return _plotted(
        lambda figure: figures.plot_states(
            trajectory.times,
            trajectory.x[:, :, c],
            goals=trajectory.goal[:, c],
            pinned=problem.pinning.agents,
            symbol=symbol,
            ax=figure.add_subplot(),
        ),
        name=f"states-{c + 1}",
        title=f"States, component {c + 1} of {problem.m}" if several else "States",
        caption=f"{symbol}(t) of {who}; goals dashed.",
        alt=f"States over {number(float(trajectory.times[-1]))} s: at the end between {number(float(last.min()))} and"
        f" {number(float(last.max()))}.",
    )


def _estimate_picture(trajectory: Trajectory) -> Picture:
    agents = figures.shown_agents(len(trajectory.labels), set(), MOST_ESTIMATES)

    def draw(figure: Figure) -> None:
        axes = np.atleast_1d(figure.subplots(len(agents), 1, sharex=True))
        for row, agent in enumerate(agents):
            figures.plot_disturbance(
                trajectory.times,
                trajectory.d[:, agent, 0],
                trajectory.dhat[:, agent, 0],
                title=f"agent {figures.short(trajectory.labels[agent])}",
                legend=row == 0,
                ax=axes[row],
            )
            axes[row].set_xlabel("")
            axes[row].set_ylabel("")
        axes[-1].set_xlabel("time t in s")
        figure.supylabel("d in units of x per s", fontsize=9)

    which = "" if trajectory.d.shape[2] == 1 else ", first component"
    return _plotted(
        draw,
        name="estimates",
        title="Disturbance and estimate",
        height=2.9 if len(agents) < 3 else 3.2,
        caption=f"Disturbance d (dotted) and its estimate d̂ of {len(agents)} agents{which}.",
        alt="Disturbance and estimate over time; they differ at the end by at most "
        f"{number(float(np.abs(trajectory.d[-1] - trajectory.dhat[-1]).max()))} over all agents.",
    )


def _plotted(
    draw: Callable[[Figure], object], *, name: str, title: str, caption: str, alt: str, height: float = 2.9
) -> Picture:
    return Picture(svg=Fragment(svg_text(draw, name=name, alt=alt, height=height)), title=title, caption=caption)


def _spectrum_height(*spectra: Values) -> float:
    """Inches; a row of real eigenvalues needs little."""
    return 2.9 if any(np.abs(values.imag).max(initial=0.0) > 1e-9 for values in spectra) else 2.1


def _listed(values: Values) -> str:
    shown = [f"{v.real:.4g}{v.imag:+.4g}i" if abs(v.imag) > 1e-12 else f"{v.real:.4g}" for v in values[:8]]
    return ", ".join(shown) + (" and more" if len(values) > 8 else "")
