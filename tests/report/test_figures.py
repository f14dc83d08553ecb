"""Figures: what is drawn where, and that names are never read as mathematics."""

from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.figure import Figure

from dobc_design.plotting import look
from dobc_design.report import figures
from dobc_design.report.document import Picture
from dobc_design.report.figures import draw_network, drawn_labels, positions
from dobc_design.report.pictures import svg_of


def svg_text(draw, *, name, alt):
    return svg_of(Picture(name=name, title="", caption="", alt=alt, draw=draw))


def new_axes():
    return Figure().add_subplot()


def ring(n: int) -> list[tuple[int, int]]:
    return [(i, (i + 1) % n) for i in range(n)]


def test_a_ring_stands_on_a_circle_in_any_order():
    order = np.random.default_rng(0).permutation(9)
    pairs = [(int(order[i]), int(order[j])) for i, j in ring(9)]
    places = positions(pairs, 9)
    assert np.allclose(np.hypot(*places.T), 1)
    steps = [np.hypot(*(places[i] - places[j])) for i, j in pairs]
    assert np.allclose(steps, steps[0])


@pytest.mark.parametrize(
    ("pairs", "n"), [([], 1), ([], 5), ([(0, 1)], 2), ([(0, 1), (2, 3), (3, 4)], 6), (ring(3), 3)]
)
def test_positions_are_finite_and_apart(pairs: list[tuple[int, int]], n: int):
    places = positions(pairs, n)
    assert places.shape == (n, 2)
    assert np.isfinite(places).all()
    assert np.abs(places).max(initial=0) <= 1 + 1e-9
    assert len(np.unique(places.round(6), axis=0)) == n


def test_the_arrow_points_at_the_listener_and_pinned_and_unreached_agents_look_different():
    settings = {
        "labels": ["a", "b", "c"],
        "places": positions(ring(3), 3),
        "pinned": [0],
        "unreached": {2},
    }
    ax = draw_network(new_axes(), arcs=[(0, 1)], **settings)
    assert len({patch.get_facecolor()[:3] for patch in ax.patches}) >= 2
    assert any(patch.get_linestyle() not in ("solid", "-") for patch in ax.patches)
    # Agent 0 listens to agent 1, so information runs from 1 to 0: the head is near 0.
    places = np.array([[-1.0, 0.0], [1.0, 0.0]])
    ax = draw_network(new_axes(), labels=["a", "b"], arcs=[(0, 1)], places=places)
    heads = next(patch for patch in ax.patches if patch.get_edgecolor()[3] == 0)
    assert heads.get_path().vertices[:, 0].max() < -0.5


def test_a_figure_is_drawn_once():
    """Matplotlib draws a figure with a layout twice when it is saved."""
    drawn = []

    def draw(ax):
        own = ax.draw
        ax.draw = lambda renderer: (drawn.append(renderer), own(renderer))
        return ax.plot([0, 1], [0, 1])

    assert "<path" in svg_text(draw, name="once", alt="A line.")
    assert len(drawn) == 1


def test_labels_lose_what_they_share():
    assert drawn_labels(["uav-1", "uav-2", "uav-12"]) == (["1", "2", "12"], "uav-")
    # these fit into their nodes
    assert drawn_labels(["T1", "T2", "T12"]) == (["T1", "T2", "T12"], "")
    assert drawn_labels(["11", "12"]) == (["11", "12"], "")
    assert drawn_labels(["gateway", "s1"]) == (["gateway", "s1"], "")
    assert drawn_labels(["only"]) == (["only"], "")
    assert drawn_labels(["s", "s1"]) == (["s", "s1"], "")


def test_long_series_are_thinned_and_keep_their_ends():
    rows = look.thinned_rows(100_000)
    assert (len(rows), rows[0], rows[-1]) == (look.MOST_POINTS, 0, 99_999)
    assert look.thinned_rows(3).tolist() == [0, 1, 2]
    shown = look.shown_agents(1000, {500, 700})
    assert len(shown) == look.MOST_AGENTS
    assert {500, 700} <= set(shown)


def test_an_svg_is_xml_with_own_identifiers_variables_and_its_alternative():
    text = svg_text(lambda ax: ax.plot([1, 2], color="#0072b2"), name="one", alt='a "b" <c>')
    root = ElementTree.fromstring(text)
    assert root.get("aria-label") == 'a "b" <c>'
    assert "var(--figure-blue, #0072b2)" in text
    assert all(each.get("id", "one-").startswith("one-") for each in root.iter())
    assert "<style" not in text


def test_names_are_not_read_as_mathematics_and_powers_of_ten_are_written_out():
    text = svg_text(
        lambda ax: figures.plot_lambda(ax, {"$\\frac{$": [-1.0], "<b>": [-2.0]}), name="x", alt="x"
    )
    assert "$\\frac{$" in text
    assert "&lt;b&gt;" in text
    assert [look.power_of_ten(10.0**k) for k in (-3, -1, 0, 1, 12)] == [
        "10⁻³",
        "0.1",
        "1",
        "10",
        "10¹²",
    ]


def test_positions_are_reproducible_for_large_networks():
    pairs = [
        (i, j) for i, j in np.random.default_rng(1).integers(0, 200, (400, 2)).tolist() if i != j
    ]
    assert np.array_equal(positions(pairs, 200), positions(pairs, 200))
