"""Where runs start: drawn, given, or from a file; nothing that is not finite gets through."""

from __future__ import annotations

import numpy as np
import pytest

from dobc_design.errors import ShapeError, SpecError
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.groups import Observer
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem
from dobc_design.simulation.field import make_loop
from dobc_design.simulation.run import simulate
from dobc_design.simulation.setting import make_starts


def problem(**settings) -> Problem:
    network = Network.from_arcs([[1, 2], [2, 3]], arrow="listens_to")
    defaults = {
        "coupling": "y",
        "target": [0, 1],
        "gains": {"3": 1},
        "exosystem": Exosystem(A=[[0, 1, 0], [-1, 0, 0], [0, 0, 0]], C=[[1, 0, 0], [0, 0, 1]]),
        "observer": Observer(W=[[1, 0], [0, 0], [0, 1]]),
    }
    return Problem(network=network, **(defaults | settings))


def drawn(given=None, seed: int = 0, **settings):
    one = problem(**settings)
    return make_starts(one, make_loop(one, None), given).draw(seed)


def test_the_disturbance_of_a_region_is_drawn_in_its_ball_and_fills_it():
    """region.initial_disturbance bounds |xi_i(0) - xihat_i(0)|, and xihat starts at 0."""
    region = {"initial_states": [0, 5], "initial_disturbance": "1/2"}
    lengths = np.concatenate([np.linalg.norm(drawn(seed=s, region=region).xi, axis=1) for s in range(200)])
    assert lengths.max() <= 0.5
    assert lengths.max() > 0.48
    assert np.mean(lengths < 0.25) == pytest.approx(1 / 8, abs=0.06)  # the volume of the inner ball


def test_a_given_initial_disturbance_wins_over_the_region():
    region = {"initial_states": [0, 5], "initial_disturbance": 9}
    start = drawn(region=region, simulation={"xi0": [1, 2, 3]})
    assert start.xi.tolist() == [[1, 2, 3]] * 3
    assert not start.xihat.any()


def test_parts_of_a_start_can_be_given():
    x = [[1, 2], [3, 4], [5, 6]]
    assert drawn(x).x.tolist() == x
    assert drawn([7, 8]).x.tolist() == [[7, 8]] * 3
    assert drawn({"xihat": [1, 0, 0]}).xihat.tolist() == [[1, 0, 0]] * 3
    assert drawn({"xi": np.ones((3, 3)), "x": x}).xi.tolist() == [[1, 1, 1]] * 3
    assert np.array_equal(drawn({"xi": [1, 1, 1]}, seed=4).x, drawn(seed=4).x)


def test_a_start_is_read_from_csv(tmp_path):
    path = tmp_path / "x.csv"
    path.write_text("1,2\n3,4\n\n5.5,-6e0\n", encoding="utf-8")
    assert drawn(path).x.tolist() == [[1, 2], [3, 4], [5.5, -6]]
    assert drawn(str(path)).x.tolist() == [[1, 2], [3, 4], [5.5, -6]]


def test_a_run_goes_on_where_a_saved_one_stopped(tmp_path):
    """Half a run, saved, then the other half: the same end as in one run."""
    whole = simulate(problem(), t_final=4, tolerance=1e-11)
    first = simulate(problem(), t_final=2, tolerance=1e-11)
    second = simulate(problem(), t_final=2, tolerance=1e-11, start=first.save(tmp_path / "half.npz"))
    np.testing.assert_allclose(second.x[-1], whole.x[-1], atol=1e-9)
    np.testing.assert_allclose(second.xihat[-1], whole.xihat[-1], atol=1e-9)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ([[1, 2]], r"start\.x must have shape \(3, 2\)"),
        ([[1, 2], [3, 4], [5, float("nan")]], "row 3, column 2 is nan"),
        ({"xi": [[1, 2, 3]] * 2}, r"start\.xi must have shape"),
        ({"y": 1}, "unknown part 'y'"),
        ({"x": [["a", "b"]] * 3}, "must be an array of numbers"),
        ([1, float("inf")], "must be finite"),
        ({"xihat": [1, None, 3]}, "must be"),
        ("missing.csv", "cannot be read"),
    ],
)
def test_a_wrong_start_is_refused(given, message: str):
    with pytest.raises((SpecError, ShapeError), match=message):
        drawn(given)


@pytest.mark.parametrize("name", ["text.npz", "text.csv", "ragged.csv"])
def test_a_file_that_is_no_start_is_refused(tmp_path, name: str):
    path = tmp_path / name
    path.write_text("1,2\n3\n5,6\n" if name == "ragged.csv" else "words\n", encoding="utf-8")
    with pytest.raises(SpecError):
        drawn(path)


def test_pickled_arrays_are_never_executed(tmp_path):
    path = tmp_path / "x.npz"
    np.savez(path, x=np.array([{"a": 1}], dtype=object))
    with pytest.raises(SpecError, match="does not hold a start"):
        drawn(path)
