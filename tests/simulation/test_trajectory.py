"""What is asked of one run, and its file; where runs start: drawn, given, or from a file."""

import json
from functools import cache

import numpy as np
import pytest
from simulated_runs import simulate

import dobc_design as dd
from dobc_design.errors import CertificateError, ShapeError, SpecError
from dobc_design.simulation.field import make_closed_loop
from dobc_design.simulation.signals import Mobile, Periodic
from dobc_design.simulation.starts import make_starts
from dobc_design.simulation.trajectory import PLAIN, SAMPLED


def made(errors, *, diverged: bool = False, times=None, name: str = "made") -> dd.Trajectory:
    """Two agents; the first is off its goal by the given errors, the second by minus half of
    them."""
    error = np.asarray(errors, dtype=float)
    goal = np.array([[1.0], [3.0]])
    components = [error, -error / 2]
    x = goal + np.stack(components, axis=1)[:, :, None]
    shape = (len(error), 2, 0)
    nothing = np.zeros(shape)
    zero = np.zeros_like(x)
    times = np.arange(len(error)) if times is None else times
    times_array = np.asarray(times, dtype=float)
    return dd.Trajectory(
        name=name,
        mode="G",
        labels=("a", "b"),
        t_final=10.0,
        seed=0,
        times=times_array,
        x=x,
        xi=nothing,
        xihat=nothing.copy(),
        d=zero + 2,
        dhat=zero + 1.5,
        u=zero,
        goal=goal,
        diverged=diverged,
    )


def test_the_error_is_the_largest_distance_from_a_goal_and_nothing_can_be_changed():
    trajectory = made([4, -2, 1])
    found = trajectory.error().tolist()
    assert found == [4, 2, 1]
    assert trajectory.final_error == 1
    assert trajectory.estimation_error().tolist() == [0.5] * 3
    assert str(made([4, 1])) == 'made: mode "G", ran to 10 s, |e|_inf from 4 to 1'
    assert "diverged at about 1 s of 10 s" in str(made([4, 1e9], diverged=True))
    assert "<b>&lt;i&gt;</b>" in made([1, 2], name="<i>")._repr_html_()
    trajectory = made([1, 2])
    for array in (trajectory.x, trajectory.times, trajectory.goal, trajectory.d):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


RISING = [4, 0.1, 2, 0.4, 0.5, 0.2]
SETTLED = [  # errors, tolerance, settling time
    (RISING, 0.5, 3),
    (RISING, 5, 0),
    (RISING, 0.1, None),
    ([1, np.nan], 2, None),
    ([4, 0.05, 0.039, 0.03], None, 2),  # one percent of the start
    ([4, 0.05], None, None),
    ([0, 0], None, 0),
]


@pytest.mark.parametrize(("errors", "tolerance", "wanted"), SETTLED)
def test_the_settling_time_is_when_the_error_stays_small(errors, tolerance, wanted):
    assert made(errors).settling_time(tolerance) == wanted
    assert made(errors, diverged=True).settling_time(tolerance) is None


def test_the_decay_rate_is_the_slope_of_the_logarithm_without_integration_error():
    times = np.linspace(0, 3, 20)
    errors = 5 * np.exp(-0.7 * times)
    found = made(errors, times=times).decay_rate()
    assert found == pytest.approx(0.7)
    errors = 5 * np.exp(0.7 * times)
    found = made(errors, times=times).decay_rate()
    assert found == pytest.approx(-0.7)
    errors = [0, 0, 0, 0]
    found = made(errors).decay_rate()
    assert found is None
    times = np.linspace(0, 40, 200)
    errors = np.maximum(np.exp(-times), 1e-9)
    found = made(errors, times=times).decay_rate()
    assert found == pytest.approx(1)


def example_2(**given) -> dd.Trajectory:
    """Example 2 over 2 s."""
    signal = Periodic(dwell=0.3)
    return simulate(
        dd.load_problem("paper-switching"), signal=signal, t_final=2, samples=9, **given
    )


@cache
def switching() -> dd.Trajectory:
    return example_2()


@cache
def mobile() -> dd.Trajectory:
    arcs = [["ä", "b c"]]
    labels = ["ä", "b c", "d"]
    network = dd.Network.from_arcs(arcs, arrow="listens_to", agents=labels)
    problem = dd.Problem(network=network, coupling="-y", target=[0, 1], name="Ω")
    signal = Mobile(radius=1, hysteresis=0.1)
    return simulate(problem, signal=signal, t_final=40, samples=11)


@cache
def stressed() -> dd.Trajectory:
    frozen = dd.Failure(agent="3", time=1.0, kind="freeze")
    stress = dd.Stress(noise=0.1, period=0.25, failures=(frozen,))
    return example_2(stress=stress)


STORE = "needs the extra: pip install dobc_design[store]"
CASES = {
    "stressed": stressed,
    "switching": switching,
    "mobile, diverged, without disturbance": mobile,
}


def same(one: dd.Trajectory, other: dd.Trajectory) -> None:
    for name in ("times", "goal", "mode_index", *SAMPLED):
        assert np.array_equal(getattr(one, name), getattr(other, name)), name
        assert getattr(one, name).dtype == getattr(other, name).dtype
    for name in (*PLAIN, "labels", "notes"):
        assert getattr(one, name) == getattr(other, name), name
    assert one.switches.names == other.switches.names
    for name in ("times", "modes", "graphs"):
        found = getattr(one.switches, name)
        expected = getattr(other.switches, name)
        assert np.array_equal(found, expected)
    assert str(one) == str(other)


@pytest.mark.parametrize("name", CASES)
def test_an_npz_file_gives_the_trajectory_back(tmp_path, name: str):
    run = CASES[name]()
    one = dd.load_trajectory(run.save(tmp_path / "run.npz"))
    same(one, run)


def test_a_pandas_table_can_be_grouped_by_what_it_names():
    """Columns (quantity, agent, component): errors of all agents in one line, and the mode beside
    them."""
    pytest.importorskip("pandas", reason=STORE)
    run = mobile()
    frame = run.to_pandas()
    assert frame.columns.names == ["quantity", "agent", "component"]
    expected = []
    for agent in run.labels:
        for c in (1, 2):
            expected.append((agent, c))
    assert list(frame["x"].columns) == expected
    assert frame.index.tolist() == run.times.tolist()
    found = frame["x"].abs().max(axis=1).tolist()
    sizes = np.abs(run.x)
    wanted = sizes.max(axis=(1, 2))
    assert found == wanted.tolist()
    found = frame["mode", "", 0].tolist()
    expected = [run.switches.names[k] for k in run.mode_index]
    assert found == expected
    assert "xi" not in frame.columns.get_level_values("quantity")  # no disturbance, no columns


def test_files_are_not_overwritten_unless_asked_and_other_places_are_refused(tmp_path):
    run = switching()
    path = run.save(tmp_path / "run.npz")
    before = path.read_bytes()
    with pytest.raises(SpecError, match="exists already"):
        mobile().save(path, force=False)
    assert path.read_bytes() == before
    mobile().save(path)
    assert dd.load_trajectory(path).name == "Ω"
    found = [each.name for each in tmp_path.iterdir()]
    assert found == ["run.npz"]
    with pytest.raises(SpecError, match=r"saved as \.npz"):
        switching().save(tmp_path / "run.csv")
    with pytest.raises(CertificateError, match="cannot be written"):
        switching().save(tmp_path / "no" / "run.npz")


ELSE = np.array('{"format": "else"}')
PICKLED = np.array([{"a": 1}], dtype=object)

BROKEN = {  # what is done to a file
    "text": lambda path: path.write_text("words", encoding="utf-8"),
    "cut": lambda path: path.write_bytes(switching().save(path).read_bytes()[:-200]),
    "other arrays": lambda path: np.savez(path, x=np.zeros(3)),
    "other format": lambda path: np.savez(path, about=ELSE, times=np.zeros(2)),
    "pickle": lambda path: np.savez(path, about=PICKLED),
    "empty": lambda path: path.write_bytes(b""),
    "missing": lambda path: None,
}


@pytest.mark.parametrize("kind", BROKEN)
def test_what_is_no_trajectory_is_refused(tmp_path, kind: str):
    path = tmp_path / "run.npz"
    BROKEN[kind](path)
    with pytest.raises(SpecError, match=r"does not hold a trajectory|there is no file"):
        dd.load_trajectory(path)


def problem(**settings) -> dd.Problem:
    arcs = [[1, 2], [2, 3]]
    network = dd.Network.from_arcs(arcs, arrow="listens_to")
    C = [[1, 0, 0], [0, 0, 1]]
    A = [[0, 1, 0], [-1, 0, 0], [0, 0, 0]]
    exosystem = dd.Exosystem(A=A, C=C)
    W = [[1, 0], [0, 0], [0, 1]]
    observer = dd.Observer(W=W)
    return dd.Problem(
        network=network,
        coupling="y",
        target=[0, 1],
        gains={"3": 1},
        exosystem=exosystem,
        observer=observer,
        **settings,
    )


def drawn(given=None, seed: int = 0, **settings):
    one = problem(**settings)
    return make_starts(one, make_closed_loop(one, None), given).draw(seed)


def test_the_disturbance_of_a_region_is_drawn_in_its_ball_and_fills_it():
    """region.initial_disturbance bounds |xi_i(0) - xihat_i(0)|, and xihat starts at 0."""
    region = {"initial_states": [0, 5], "initial_disturbance": "1/2"}
    starts = []
    for seed in range(120):
        starts.append(drawn(seed=seed, region=region).xi)
    lengths = np.linalg.norm(starts, axis=2)
    assert lengths.max() <= 0.5
    assert lengths.max() > 0.48
    share = np.mean(lengths < 0.25)
    assert share == pytest.approx(1 / 8, abs=0.06)  # the volume of the inner ball


def test_a_given_initial_disturbance_wins_over_the_region():
    region = {"initial_states": [0, 5], "initial_disturbance": 9}
    simulation = {"xi0": [1, 2, 3]}
    start = drawn(region=region, simulation=simulation)
    assert start.xi.tolist() == [[1, 2, 3]] * 3
    assert not start.xihat.any()


def test_parts_of_a_start_can_be_given_and_read_from_csv(tmp_path):
    x = [[1, 2], [3, 4], [5, 6]]
    assert drawn(x).x.tolist() == x
    found = drawn([7, 8]).x.tolist()
    assert found == [[7, 8]] * 3
    given = {"xihat": [1, 0, 0]}
    found = drawn(given).xihat.tolist()
    assert found == [[1, 0, 0]] * 3
    ones = np.ones((3, 3))
    start_given = {"xi": ones, "x": x}
    found = drawn(start_given).xi.tolist()
    assert found == [[1, 1, 1]] * 3
    ones_given = {"xi": [1, 1, 1]}
    found_start = drawn(ones_given, seed=4)
    usual = drawn(seed=4).x
    assert np.array_equal(found_start.x, usual)
    path = tmp_path / "x.csv"
    path.write_text("1,2\n3,4\n\n5.5,-6e0\n", encoding="utf-8")
    found = drawn(path).x.tolist()
    expected = [[1, 2], [3, 4], [5.5, -6]]
    assert found == expected
    found = drawn(str(path)).x.tolist()
    expected = [[1, 2], [3, 4], [5.5, -6]]
    assert found == expected


def test_a_run_goes_on_where_a_saved_one_stopped(tmp_path):
    """Half a run, saved, then the other half: the same end as in one run."""
    whole = simulate(problem(), t_final=4, tolerance=1e-11)
    first = simulate(problem(), t_final=2, tolerance=1e-11)
    half = first.save(tmp_path / "half.npz")
    second = simulate(problem(), t_final=2, tolerance=1e-11, start=half)
    found_x = second.x[-1]
    wanted_x = whole.x[-1]
    np.testing.assert_allclose(found_x, wanted_x, atol=1e-9)
    found_xihat = second.xihat[-1]
    wanted_xihat = whole.xihat[-1]
    np.testing.assert_allclose(found_xihat, wanted_xihat, atol=1e-9)


WRONG_STARTS = {  # what is said -> a start that cannot be
    r"start\.x must have shape \(3, 2\)": [[1, 2]],
    "row 3, column 2 is nan": [[1, 2], [3, 4], [5, float("nan")]],
    r"start\.xi must have shape": {"xi": [[1, 2, 3]] * 2},
    "unknown part 'y'": {"y": 1},
    "must be an array of numbers": {"x": [["a", "b"]] * 3},
    "must be finite": [1, float("inf")],
    "must be": {"xihat": [1, None, 3]},
    "there is no file": "missing.csv",
}


@pytest.mark.parametrize(("message", "given"), WRONG_STARTS.items())
def test_a_wrong_start_is_refused(given, message: str):
    with pytest.raises((SpecError, ShapeError), match=message):
        drawn(given)


def stored(path) -> dict:
    """The arrays of the saved run."""
    with np.load(switching().save(path)) as arrays:
        return dict(arrays)


def without(name: str):
    return lambda arrays: arrays.pop(name)


def with_array(name: str, change):
    """The array, or what becomes of the one that is there."""

    def made(arrays) -> None:
        arrays[name] = change(arrays[name]) if callable(change) else change

    return made


def saying(**facts):
    """Other facts."""

    def made(arrays) -> None:
        text = str(arrays["about"])
        about = json.loads(text) | facts
        arrays["about"] = np.array(json.dumps(about))

    return made


UNFIT = [  # what is changed in a file, and what is said
    (without("u"), "it has no array u"),
    (with_array("x", np.zeros((1, 2))), "samples of agents"),
    (with_array("goal", np.zeros((2, 9))), "shapes of goal do not fit"),
    (with_array("switch_times", np.array([np.nan])), "shapes of switch_modes"),
    (with_array("times", lambda t: t * np.nan), "not finite"),
    (with_array("times", np.flip), "do not increase"),
    (with_array("switch_modes", lambda s: s + 9), "no such mode"),
    (with_array("switch_modes", lambda s: s - 1), "no such mode"),
    (with_array("switch_modes", lambda s: s * 1.0), "another kind"),
    (with_array("x", lambda x: x.astype("U8")), "x must be numbers"),
    (with_array("graph_sizes", np.array([5])), "graphs are not"),
    (saying(labels=["1", "1"]), "different agents"),
    (saying(labels="12"), "must be lists"),
    (saying(name="a\x1b[2Jb"), "control characters"),
    (saying(t_final=float("inf")), "t_final is no float"),
    (saying(seed=True), "seed is no int"),
    (saying(version=2), "version 1"),
]


@pytest.mark.parametrize(("change", "message"), UNFIT)
def test_a_trajectory_whose_parts_do_not_fit_is_refused(tmp_path, change, message: str):
    path = tmp_path / "run.npz"
    arrays = stored(path)
    np.savez_compressed(path, **arrays)
    found = dd.load_trajectory(path).times.tolist()
    assert found == switching().times.tolist()
    change(arrays)
    np.savez_compressed(path, **arrays)
    with pytest.raises(SpecError, match=rf"does not hold a trajectory \(.*{message}"):
        dd.load_trajectory(path)
