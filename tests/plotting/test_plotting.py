"""Figures of runs: what must be in them, read back from Matplotlib's objects and from the files."""

import json
import re
import subprocess
import warnings
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from browser import CHROMIUM, alone
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from simulated_runs import ring

import dobc_design as dd
from dobc_design.errors import ShapeError, SpecError
from dobc_design.plotting import look
from dobc_design.plotting.animation import animation_page
from dobc_design.plotting.runs import plot_agents, plot_errors, plot_plane, trajectory_sheet


@pytest.fixture(scope="module")
def switched():
    return dd.simulate("paper-switching", t_final=4, samples=81)


@pytest.fixture(scope="module")
def swarm():
    network = dd.Network.from_arcs({"G": []}, arrow="listens_to", agents=9)
    problem = dd.Problem(
        network=network,
        coupling="y",
        target=[0, 0],
        gains={"1": 1},
        name="swarm </script><b>&",
    )
    rng = np.random.default_rng(2)
    start = rng.uniform(-1, 1, size=(9, 2))
    signal = dd.signals.Mobile(radius=0.9, hysteresis=0.05)
    return dd.simulate(problem, signal=signal, start=start, t_final=5, samples=21)


def by_label(sheet, beginning: str):
    found = []
    for ax in sheet.figure.axes:
        if ax.get_ylabel().startswith(beginning):
            found.append(ax)
    return found


def test_a_trajectory_shows_band_states_estimates_and_errors_each_with_its_unit(switched):
    axes = switched.plot().figure.axes
    band, states, estimates, errors = (ax.get_ylabel() for ax in axes)
    assert band == "mode"
    assert states == "xᵢ\nin units of x"
    assert estimates == "d and estimate d̂\nin units of x per s"
    assert errors == "errors\nin units of x"
    assert axes[-1].get_yscale() == "log"
    assert axes[-1].get_xlabel() == "time t in s"


def labels_of(sheet) -> list[str]:
    return [ax.get_ylabel() for ax in sheet.figure.axes]


def test_axes_show_the_units_of_the_problem_as_they_are_written():
    """One unit for all components is that of the errors, too; several have no common one."""
    problem = dd.load_problem("paper-fixed")
    run = dd.simulate(problem.replace(units="$m$/s"), t_final=1)
    estimates = "d and estimate d̂\nin $m$/s per s"
    assert labels_of(run.plot()) == ["xᵢ\nin $m$/s", estimates, "errors\nin $m$/s"]
    for ax in run.plot().figure.axes:
        assert not ax.yaxis.label.get_parse_math()
    problem_in_metres = problem.replace(units="m/s")
    runs = dd.simulate(problem_in_metres, runs=2, t_final=1)
    assert labels_of(runs.plot())[1] == "|e|∞, in m/s"


def test_components_with_units_of_their_own_have_no_common_one(tmp_path):
    arcs = [[2, 1]]
    network = dd.Network.from_arcs(arcs, arrow="listens_to", agents=2)
    problem = dd.Problem(
        network=network,
        coupling="y",
        target=[1, 0],
        gains={1: 1},
        units=["m", "rad"],
    )
    run = dd.simulate(problem, t_final=1)
    assert labels_of(run.plot()) == ["xᵢ,₁\nin m", "xᵢ,₂\nin rad", "errors\nin units of x"]
    page = animation_page(run)
    assert "first component, in m" in page
    assert "second component, in rad" in page
    again = dd.load_trajectory(run.save(tmp_path / "run.npz"))
    assert again.units == ("m", "rad")


def test_the_curves_are_the_samples(switched):
    sheet = switched.plot()
    states = by_label(sheet, "xᵢ")[0].get_lines()
    for agent in range(10):
        line = states[agent].get_ydata()
        states_of_agent = switched.x[:, agent, 0]
        np.testing.assert_array_equal(line, states_of_agent)
    error, estimation = by_label(sheet, "errors")[0].get_lines()
    np.testing.assert_array_equal(error.get_ydata(), switched.error())
    np.testing.assert_array_equal(estimation.get_ydata(), switched.estimation_error())


def test_the_band_spans_every_stretch_in_the_colour_of_its_mode(switched):
    band = by_label(switched.plot(), "mode")[0]
    spans = {}
    for collection in band.collections:
        colour = to_hex(collection.get_facecolor()[0])
        for path in collection.get_paths():
            times = path.vertices[:, 0]
            end = float(times.max())
            spans[float(times.min())] = (end, colour)
    assert sorted(spans) == pytest.approx(switched.switches.times.tolist())
    wanted = np.append(switched.switches.times[1:], 4.0)
    ends, colours = zip(*(spans[start] for start in sorted(spans)), strict=True)
    assert ends == pytest.approx(wanted.tolist())
    modes = switched.switches.modes.tolist()
    count = len(set(modes))
    assert len(set(colours)) == count
    assert len(set(zip(modes, colours, strict=True))) == count


def certified(sheet):
    """The lines of certified bounds."""
    lines = by_label(sheet, "errors")[0].get_lines()
    return [line for line in lines if line.get_label().startswith("certified")]


def test_the_certified_envelope_is_drawn_where_it_was_given(switched):
    points = [[0, 5.0], [2, 3.0], [4, 1.0]]
    drawn = certified(switched.plot(envelope=points))
    assert len(drawn) == 1
    assert drawn[0].get_xydata().tolist() == points
    assert not certified(switched.plot())
    (again,) = certified(switched.plot(envelope=lambda t: 5 - t))
    assert again.get_xdata().tolist() == switched.times.tolist()
    np.testing.assert_array_equal(again.get_ydata(), 5 - switched.times)
    wrong_shape = [[0, 1, 2]]
    wrong_rows = [[0, 1]]
    for wrong in ([1, 2], wrong_shape, wrong_rows):
        with pytest.raises(ShapeError, match=r"envelope must be points \(t, bound\)"):
            switched.plot(envelope=wrong)


@pytest.mark.parametrize(
    ("low", "high", "wanted"),
    [
        (0.13, 4.5, ["0.2", "0.5", "1", "2"]),
        (1.2, 2.3, ["0.0", "2.0"]),
        (1e-6, 2.0, ["10⁻⁵", "10⁻³", "0.1"]),
    ],
)
def test_an_axis_of_errors_has_ticks_that_can_be_read_whatever_it_spans(
    low: float, high: float, wanted: list[str]
):
    ax = Figure().add_subplot()
    times = np.array([0.0, 1.0])
    curves = {"|e|∞": np.array([high, low])}
    plot_errors(ax, times, curves)
    ax.figure.canvas.draw()
    bottom, top = ax.get_ylim()
    inside = []
    for tick in ax.get_yticklabels():
        _, height = tick.get_position()
        if bottom <= height <= top:
            inside.append(tick.get_text())
    assert set(wanted) <= set(inside)
    assert 2 <= len(inside) <= 9


def test_a_run_that_ended_at_its_start_is_dots_and_says_so():
    network = dd.Network.from_arcs([[1, 2]], arrow="listens_to")
    problem = dd.Problem(network=network, coupling="exp(y) - 1 + y")
    start = [[0], [1e300]]
    run = dd.simulate(problem, start=start, t_final=1)
    sheet = run.plot()
    assert len(run) == 1
    states = by_label(sheet, "xᵢ")[0].get_lines()[:2]
    assert [line.get_marker() for line in states] == [".", "."]
    assert by_label(sheet, "errors")[0].get_title("left") == "ended early, at t = 0 s"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert sheet.file("svg").startswith(b"<?xml")


def test_an_ensemble_shows_the_quantiles_of_its_runs():
    runs = dd.simulate("paper-switching", runs=40, t_final=3, samples=31)
    envelope = [[0, 5], [3, 1]]
    sheet = runs.plot(envelope=envelope)
    states, top, below = sheet.figure.axes
    assert len(states.get_lines()) == 5 * 10 + 1  # agents of the first runs, and their goal
    second = states.get_lines()[13].get_ydata()
    np.testing.assert_array_equal(second, runs.states[1, :, 3, 0])
    median = next(line for line in top.get_lines() if line.get_label() == "median")
    medians = runs.quantiles([0.5])[0]
    np.testing.assert_array_equal(median.get_ydata(), medians)
    outer = top.collections[0].get_paths()[0].vertices
    low, high = runs.quantiles([0.05, 0.95])
    for place in (0, 15, 30):
        at = outer[np.isclose(outer[:, 0], runs.times[place]), 1]
        assert at.min() == pytest.approx(low[place])
        assert at.max() == pytest.approx(high[place])
    assert below.get_ylabel() == "|d − d̂|∞, units of d"


def from_region(coupling: str, low: object, high: object, **given: object) -> dd.Problem:
    """Three agents that start between two states."""
    region = {"initial_states": [low, high]}
    return ring(coupling, 3, gains={"1": 5}, region=region, **given)


EDGES = {
    "one sample": from_region("exp(y) - 1 + y", 0, 2000),
    "at rest": from_region("y", 2, 2, target=2),
    "diverging": ring("-y**3", 3, gains={"1": 1}),
    "huge": from_region("y", "-1e300", "1e300"),
}
FEW = ("diverging", "huge")


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=() if name in FEW else pytest.mark.slow) for name in EDGES],
)
def test_runs_at_the_edge_are_drawn_without_a_warning(name: str):
    given = {"t_final": 2, "tolerance": 1e-6}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run = dd.simulate(EDGES[name], **given)
        many = dd.simulate(EDGES[name], runs=2, **given)
        assert run.plot().file("png").startswith(b"\x89PNG")
        assert many.plot().file("png").startswith(b"\x89PNG")
        assert len(page_data(animation_page(run))["times"]) == len(run.times)


@pytest.mark.slow
def test_a_figure_shows_itself_and_is_saved_by_its_ending(switched, tmp_path):
    sheet = switched.plot()
    assert sheet._repr_png_().startswith(b"\x89PNG")
    for kind, head in (("png", b"\x89PNG"), ("svg", b"<?xml"), ("pdf", b"%PDF")):
        assert sheet.save(tmp_path / f"run.{kind}").read_bytes().startswith(head)
    with pytest.raises(SpecError, match="exists already"):
        sheet.save(tmp_path / "run.png", force=False)
    with pytest.raises(SpecError, match=r"saved as \.png, \.svg or \.pdf"):
        sheet.save(tmp_path / "run.bmp")


# Brettel, Vienot and Mollon's matrices for linear RGB, as simplified by Vienot (1999): red and
# green blindness.
BLIND = {}
BLIND["protanopia"] = """
    0.11238 0.88762 0
    0.11238 0.88762 0
    0.00401 -0.00401 1"""
BLIND["deuteranopia"] = """
    0.29275 0.70725 0
    0.29275 0.70725 0
    -0.02234 0.02234 1"""


@pytest.mark.parametrize("kind", ["normal", *BLIND])
def test_the_series_colours_differ_for_every_eye(kind: str):
    matrix = np.eye(3)
    if kind != "normal":
        words = BLIND[kind].split()
        numbers = np.array(words, float)
        matrix = numbers.reshape(3, 3)
    seen = []
    for colour in look.SERIES[:4]:
        srgb = np.array(to_rgb(colour))
        bright = ((srgb + 0.055) / 1.055) ** 2.4
        linear = np.where(srgb <= 0.04045, srgb / 12.92, bright)
        seen.append(matrix @ linear)
    apart = []
    for a, b in combinations(seen, 2):
        apart.append(np.linalg.norm(a - b))
    assert min(apart) > 0.08


def page_data(page: str):
    script = r'<script id="data" type="application/json">(.*?)</script>'
    return json.loads(re.search(script, page, re.DOTALL)[1])


def test_the_animation_holds_the_run_and_loads_nothing(swarm):
    page = animation_page(swarm)
    data = page_data(page)
    np.testing.assert_allclose(data["places"], swarm.x, atol=1e-4)
    assert data["times"] == swarm.times.tolist()
    assert data["mode"] == swarm.mode_index.tolist()
    for pairs, graph in zip(data["links"], swarm.switches.graphs, strict=True):
        wanted = {tuple(pair) for pair in graph.T.tolist()}
        assert {tuple(pair) for pair in pairs} == wanted
    assert data["title"] == "swarm </script><b>&"
    assert page.count("</script>") == 2
    assert not re.search(r"https?:|//[a-z]|@import|src=|url\(|fetch|XMLHttp|WebSocket", page)
    assert "default-src 'none'" in page


def test_a_formation_has_one_scale_arrows_goals_and_pinned_agents(swarm):
    ax = Figure().add_subplot()
    arcs = [(1, 0)]
    plot_plane(ax, swarm, pinned=[0], arcs=arcs)
    assert ax.get_aspect() == 1
    _, labels = ax.get_legend_handles_labels()
    assert set(labels) == {"pinned", "not pinned", "goal"}
    # the head near agent 1, which listens
    head = ax.patches[-1].get_path().vertices.mean(axis=0)
    ends = swarm.x[-1]
    assert np.hypot(*(head - ends[1])) < np.hypot(*(head - ends[0]))
    data = page_data(animation_page(swarm, pinned=[0]))
    assert data["plane"] is True
    assert data["pinned"] == [0]


def test_an_arrow_of_a_formation_passes_by_an_agent_between_its_ends(swarm):
    agents = [0, 1, 2]
    apart = np.zeros(swarm.x.shape)
    apart[:, agents, 0] = agents
    apart[:, 3:, 1] = 5.0
    for arc, height in (((2, 0), 0.1), ((1, 0), 0.0)):
        ax = Figure().add_subplot()
        plot_plane(ax, replace(swarm, x=apart), arcs=[arc])
        # the height of the shaft
        assert np.ptp(ax.patches[0].get_path().vertices[:, 1]) >= height
        assert (np.ptp(ax.patches[0].get_path().vertices[:, 1]) > 0) == (height > 0)


def test_eight_agents_differ_in_colour_or_dashes():
    run = dd.simulate(ring("y", 8), t_final=0.1, samples=2)
    ax = Figure().add_subplot()
    plot_agents(ax, run, component=0, pinned=[0])
    drawn = {}
    for line in ax.get_lines():
        drawn[line.get_label()] = (line.get_color(), line.get_linestyle())
    drawn.pop("goal")
    assert len(drawn) == 8
    assert len(set(drawn.values())) == 8
    assert "1, pinned" in drawn


def test_one_component_moves_along_its_axis_and_arcs_can_be_given(switched):
    listened = [(0, 1), (1, 0), (4, 2)]
    page = animation_page(switched, arcs={"Ga": listened})
    data = page_data(page)
    places = np.array(data["places"])
    shown = places[:, :, 0]
    expected = switched.x[:, :, 0]
    np.testing.assert_allclose(shown, expected, atol=1e-4)
    second_coordinates = places[0, :, 1].tolist()
    numbers = list(range(1, 11))
    assert second_coordinates == numbers
    names = switched.switches.names
    links = data["links"][names.index("Ga")]
    expected_links = [[0, 1], [1, 0], [4, 2]]
    assert links == expected_links
    assert data["links"][names.index("Gb")] == []


def test_an_animation_is_a_page_and_other_endings_are_refused(swarm, tmp_path):
    assert swarm.animate(tmp_path / "run.html").read_text("utf-8") == animation_page(swarm)
    with pytest.raises(SpecError, match="exists already"):
        swarm.animate(tmp_path / "run.html", force=False)
    with pytest.raises(SpecError, match=r"saved as \.html"):
        swarm.animate(tmp_path / "run.mp4")


def test_a_network_too_large_to_be_seen_is_refused():
    n = 600
    run = dd.simulate(ring("y", n), t_final=0.1, samples=2)
    with pytest.raises(SpecError, match="at most 500 agents"):
        animation_page(run)
    assert len(trajectory_sheet(run).figure.axes[0].get_lines()) <= 31


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="no browser is installed")
def test_the_page_runs_in_a_browser_without_errors(swarm, tmp_path):
    """The script itself writes the time of its frame into the page."""
    (tmp_path / "run.html").write_text(animation_page(swarm), encoding="utf-8")
    command = alone("--virtual-time-budget=1500", "--dump-dom", (tmp_path / "run.html").as_uri())
    done = subprocess.run(command, capture_output=True, check=False, text=True, timeout=120)
    shown = re.search(r'<output id="now">([^<]*)</output>', done.stdout)
    assert re.fullmatch(r"t = \d+\.\d\d s, graph \d+", shown[1])
    assert "CONSOLE" not in done.stderr
