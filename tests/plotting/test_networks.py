"""Pictures of networks: what is drawn where, and what ``problem.plot`` shows."""

import networkx as nx
import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

import dobc_design as dd
from dobc_design.errors import SpecError
from dobc_design.plotting import look
from dobc_design.plotting.networks import draw_network, drawn_labels, positions


def new_axes():
    return Figure().add_subplot()


def ring(n: int) -> list[tuple[int, int]]:
    return [(i, (i + 1) % n) for i in range(n)]


def test_a_ring_stands_on_a_circle_in_any_order():
    order = np.random.default_rng(0).permutation(9)
    pairs = []
    for i, j in ring(9):
        pairs.append((int(order[i]), int(order[j])))
    places = positions(pairs, 9)
    assert np.allclose(np.hypot(*places.T), 1)
    steps = []
    for i, j in pairs:
        steps.append(np.hypot(*(places[i] - places[j])))
    assert np.allclose(steps, steps[0])


def test_a_chain_stands_on_a_line_in_its_own_order_and_longer_arcs_make_two():
    arcs = [(3, 0), (0, 2), (2, 1)]
    places = positions(arcs, 4)
    assert places[:, 1].tolist() == [0] * 4
    order = np.argsort(places[:, 0]).tolist()
    forward = [1, 2, 0, 3]
    possible = (forward, [3, 0, 2, 1])
    assert order in possible
    by_one = [(i, i - 1) for i in range(1, 8)]
    by_two = [(i, i - 2) for i in range(2, 8)]
    both = by_one + by_two
    places = positions(both, 8)
    assert np.all(np.diff(places[:, 0]) > 0)
    assert len(set(places[:, 1].tolist())) == 2


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
    labels = ["a", "b", "c"]
    settings = {
        "labels": labels,
        "places": positions(ring(3), 3),
        "pinned": [0],
        "unreached": {2},
    }
    ax = draw_network(new_axes(), arcs={(0, 1): 1}, **settings)
    colours = {patch.get_facecolor()[:3] for patch in ax.patches}
    assert len(colours) >= 2
    assert any(patch.get_linestyle() not in ("solid", "-") for patch in ax.patches)
    # Agent 0 listens to agent 1, so information runs from 1 to 0: the head is near 0.
    places = np.array([[-1.0, 0.0], [1.0, 0.0]])
    arcs = {(0, 1): 1}
    ax = draw_network(new_axes(), labels=["a", "b"], arcs=arcs, places=places)
    heads = next(patch for patch in ax.patches if patch.get_edgecolor()[3] == 0)
    assert heads.get_path().vertices[:, 0].max() < -0.5


def test_labels_lose_what_they_share():
    found = drawn_labels(["uav-1", "uav-2", "uav-12"])
    expected = (["1", "2", "12"], "uav-")
    assert found == expected
    # these fit into their nodes
    kept = drawn_labels(["T1", "T2", "T12"])
    expected_kept = (["T1", "T2", "T12"], "")
    assert kept == expected_kept
    assert drawn_labels(["11", "12"]) == (["11", "12"], "")
    assert drawn_labels(["gateway", "s1"]) == (["gateway", "s1"], "")
    assert drawn_labels(["only"]) == (["only"], "")
    assert drawn_labels(["s", "s1"]) == (["s", "s1"], "")


def test_positions_are_reproducible_for_large_networks():
    drawn = np.random.default_rng(1).integers(0, 200, (400, 2))
    pairs = [(i, j) for i, j in drawn.tolist() if i != j]
    assert np.array_equal(positions(pairs, 200), positions(pairs, 200))


@pytest.fixture
def two_modes():
    """c is pinned; d is heard by nobody and hears nobody in the first mode, in the second b."""
    day = [["a", "b"], ["b", "c"]]
    night = [["c", "b"], ["d", "b"]]
    modes = {"day": day, "$night_1$": night}
    network = dd.Network.from_arcs(modes, arrow="listens_to", agents=["a", "b", "c", "d"])
    return dd.Problem(network=network, coupling="y", gains={"c": 1}, name="mine $x$")


def patches_in(ax, colour: str):
    return [patch for patch in ax.patches if to_hex(patch.get_edgecolor()) == colour]


def count_of_nodes(patches) -> int:
    """Every node of a compound path begins with one MOVETO."""
    return sum(int((patch.get_path().codes == 1).sum()) for patch in patches)


def test_the_picture_of_a_problem_has_a_place_for_every_mode_and_explains_its_signs(two_modes):
    figure = two_modes.plot().figure
    assert [ax.get_title("left") for ax in figure.axes] == ["mode day", "mode $night_1$"]
    assert figure.get_suptitle() == "mine $x$"
    (legend,) = figure.legends
    texts = [text.get_text() for text in legend.get_texts()]
    expected = [
        "pinned",
        "not pinned",
        "reached from no pinned agent",
        "points to the agent that listens",
    ]
    assert texts == expected


def test_pinned_agents_are_blue_and_agents_that_no_pin_reaches_are_dashed(two_modes):
    """The oracle of who is reached is networkx on the exported graph, arrows turned round."""
    axes = two_modes.plot().figure.axes
    for mode, ax in zip(two_modes.network.modes, axes, strict=True):
        hears = two_modes.network.to_networkx(mode).reverse()
        reached = {"c", *nx.descendants(hears, "c")}
        assert count_of_nodes(patches_in(ax, look.BLUE)) == 1
        assert count_of_nodes(patches_in(ax, look.VERMILLION)) == 4 - len(reached)


def test_without_pins_nobody_is_called_unreached(two_modes):
    figure = two_modes.replace(gains={}).plot().figure
    for ax in figure.axes:
        assert not patches_in(ax, look.VERMILLION)
    texts = figure.legends[0].get_texts()
    words = [text.get_text() for text in texts]
    assert words == ["agent", "points to the agent that listens"]


def test_one_mode_is_drawn_alone_and_into_axes_that_are_given(two_modes):
    (only,) = two_modes.plot("$night_1$").figure.axes
    assert only.get_title("left") == "mode $night_1$"
    ax = Figure().add_subplot()
    assert two_modes.plot(ax=ax) is ax
    assert ax.get_title("left") == "mode day"


def test_a_picture_of_a_network_saves_itself(two_modes, tmp_path):
    sheet = two_modes.plot().save(tmp_path / "network.svg")
    assert sheet.read_bytes().startswith(b"<?xml")


def test_an_unknown_mode_and_a_network_too_large_to_be_drawn_are_refused(two_modes):
    with pytest.raises(SpecError, match=r"mode must be one of day, \$night_1\$; got 'noon'"):
        two_modes.plot("noon")
    crowd = dd.Network.from_arcs([], arrow="listens_to", agents=301)
    with pytest.raises(SpecError, match=r"301 agents and 0 arcs are too many to be drawn"):
        dd.Problem(network=crowd, coupling="y").plot()


def curves_of(ax) -> list[np.ndarray]:
    """Points of every shaft, from the control points of Matplotlib's own path."""
    shafts = next(patch for patch in ax.patches if to_hex(patch.get_edgecolor()) == look.MUTED)
    one, control, other = shafts.get_path().vertices.reshape(-1, 3, 2).transpose(1, 0, 2)
    t = np.linspace(0, 1, 50)[:, None, None]
    return list(((1 - t) ** 2 * one + 2 * t * (1 - t) * control + t**2 * other).transpose(1, 0, 2))


def test_arcs_pass_by_nodes_that_stand_between_their_ends():
    places = np.array([[-1.0, 0.0], [0.0, 0.0], [1.0, 0.0]])
    both_ways = {(2, 0): 1, (0, 2): 1}
    ax = draw_network(new_axes(), labels=list("abc"), arcs=both_ways, places=places)
    (curve,) = curves_of(ax)
    assert np.hypot(*curve.T).min() > 0.12  # the largest radius of a node
    ax = draw_network(new_axes(), labels=list("abc"), arcs={(0, 1): 1}, places=places)
    (curve,) = curves_of(ax)
    assert np.allclose(curve[:, 1], 0)


def texts_of(ax) -> list[str]:
    return [text.get_text() for text in ax.texts]


def test_weights_stand_beside_a_few_arcs_unless_all_are_one():
    arcs = [["a", "b", 2], ["b", "a", "1/3"], ["b", "c"], ["c", "b"]]
    network = dd.Network.from_arcs({"m": arcs}, arrow="listens_to", agents=["a", "b", "c"])
    problem = dd.Problem(network=network, coupling="y", gains={"a": 1})
    assert sorted(texts_of(problem.plot().figure.axes[0])) == ["0.3333", "1", "2", "a", "b", "c"]
    plain = dd.Network.from_arcs({"m": [["a", "b"]]}, arrow="listens_to", agents=["a", "b"])
    ax = dd.Problem(network=plain, coupling="y", gains={"a": 1}).plot().figure.axes[0]
    assert texts_of(ax) == ["a", "b"]
    many = dict.fromkeys(ring(25), 2)
    ax = draw_network(new_axes(), labels=[""] * 25, arcs=many, places=positions(many, 25))
    assert "2" not in texts_of(ax)


def test_all_labels_stand_inside_their_nodes_or_all_beside_them():
    places = positions(ring(3), 3)
    for labels, inside in ((["a", "b", "c"], True), (["a", "gateway", "c"], False)):
        ax = draw_network(new_axes(), labels=labels, arcs={}, places=places)
        drawn = zip(ax.texts, places, strict=True)
        stand = [np.allclose(text.get_position(), place) for text, place in drawn]
        assert stand == [inside] * 3
