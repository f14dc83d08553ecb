"""Trajectories as files: what is read back is what was saved; what is no trajectory is refused."""

from __future__ import annotations

import builtins
from pathlib import Path

import numpy as np
import pytest

from dobc_design.errors import CertificateError, SpecError
from dobc_design.problem.load import load_problem
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem
from dobc_design.simulation.run import simulate
from dobc_design.simulation.signals import Mobile, Periodic
from dobc_design.simulation.stress import Failure, Stress
from dobc_design.simulation.trajectory import PLAIN, SAMPLED, Trajectory, load_trajectory


def switching() -> Trajectory:
    return simulate(load_problem("paper-switching"), signal=Periodic(dwell=0.3), t_final=2, samples=9)


def mobile() -> Trajectory:
    network = Network.from_arcs([["ä", "b c"]], arrow="listens_to", agents=["ä", "b c", "d"])
    problem = Problem(network=network, coupling="-y", target=[0, 1], name="Ω")
    return simulate(problem, signal=Mobile(radius=1, hysteresis=0.1), t_final=40, samples=11)


def stressed() -> Trajectory:
    stress = Stress(noise=0.1, period=0.25, failures=(Failure(agent="3", time=1.0, kind="freeze"),))
    return simulate(load_problem("paper-switching"), signal=Periodic(dwell=0.3), t_final=2, samples=9, stress=stress)


STORE = "needs the extra: pip install dobc_design[store]"
CASES = {"stressed": stressed, "switching": switching, "mobile, diverged, without disturbance": mobile}


def same(one: Trajectory, other: Trajectory) -> None:
    for name in ("times", "goal", "mode_index", *SAMPLED):
        assert np.array_equal(getattr(one, name), getattr(other, name)), name
        assert getattr(one, name).dtype == getattr(other, name).dtype
    for name in (*PLAIN, "labels", "notes"):
        assert getattr(one, name) == getattr(other, name), name
    assert one.switches == other.switches
    assert str(one) == str(other)


@pytest.mark.parametrize("name", CASES)
def test_an_npz_file_gives_the_trajectory_back(tmp_path, name: str):
    run = CASES[name]()
    same(load_trajectory(run.save(tmp_path / "run.npz")), run)


def test_a_pandas_table_can_be_grouped_by_what_it_names():
    """Columns (quantity, agent, component): errors of all agents in one line, and the mode beside them."""
    pytest.importorskip("pandas", reason=STORE)
    run = mobile()
    frame = run.to_pandas()
    assert frame.columns.names == ["quantity", "agent", "component"]
    assert list(frame["x"].columns) == [(agent, c) for agent in run.labels for c in (1, 2)]
    assert frame["x"].abs().max(axis=1).tolist() == np.abs(run.x).max(axis=(1, 2)).tolist()
    assert frame["mode", "", 0].tolist() == [run.switches.names[k] for k in run.mode_index]
    assert "xi" not in frame.columns.get_level_values("quantity")  # no disturbance, no columns


def test_a_pandas_table_has_a_column_for_every_component():
    pytest.importorskip("pandas", reason=STORE)
    run = switching()
    frame = run.to_pandas()
    assert frame.index.tolist() == run.times.tolist()
    assert frame["x", "3", 1].tolist() == run.x[:, 2, 0].tolist()
    assert frame["xihat", "10", 2].tolist() == run.xihat[:, 9, 1].tolist()
    assert frame["mode", "", 0].tolist() == [sample.mode for sample in run]
    assert frame.shape == (9, 1 + 10 * (4 + 2 * 2))


def test_without_pandas_the_way_out_is_said(monkeypatch):
    run, original = switching(), builtins.__import__

    def refuse(name, *rest):
        if name.partition(".")[0] == "pandas":
            raise ImportError(name)
        return original(name, *rest)

    monkeypatch.setattr(builtins, "__import__", refuse)
    with pytest.raises(SpecError, match="needs the package pandas") as caught:
        run.to_pandas()
    assert "dobc_design[store]" in caught.value.cure


def test_files_are_not_overwritten_unless_asked(tmp_path):
    run = switching()
    path = run.save(tmp_path / "run.npz")
    before = path.read_bytes()
    with pytest.raises(SpecError, match="exists already"):
        mobile().save(path)
    assert path.read_bytes() == before
    mobile().save(path, force=True)
    assert load_trajectory(path).name == "Ω"
    assert [each.name for each in tmp_path.iterdir()] == ["run.npz"]


def test_another_ending_or_a_missing_folder_is_refused(tmp_path):
    with pytest.raises(SpecError, match=r"saved as \.npz"):
        switching().save(tmp_path / "run.csv")
    with pytest.raises(CertificateError, match="cannot be written"):
        switching().save(tmp_path / "no" / "run.npz")


def broken(path: Path, kind: str) -> None:
    if kind == "text":
        path.write_text("words", encoding="utf-8")
    elif kind == "cut":
        switching().save(path)
        path.write_bytes(path.read_bytes()[:-200])
    elif kind == "other arrays":
        np.savez(path, x=np.zeros(3))
    elif kind == "other format":
        np.savez(path, about=np.array('{"format": "else"}'), times=np.zeros(2))
    elif kind == "pickle":
        np.savez(path, about=np.array([{"a": 1}], dtype=object))
    elif kind == "empty":
        path.write_bytes(b"")


@pytest.mark.parametrize("kind", ["text", "cut", "other arrays", "other format", "pickle", "empty", "missing"])
def test_what_is_no_trajectory_is_refused(tmp_path, kind: str):
    path = tmp_path / "run.npz"
    broken(path, kind)
    with pytest.raises(SpecError, match=r"does not hold a trajectory|cannot be read"):
        load_trajectory(path)
