"""Hostile files for ``--start`` and for saved trajectories, and numbers beyond all floats: one
message, exit 2."""

import gzip
import io
import os
import subprocess
import sys
import zipfile
from itertools import pairwise
from pathlib import Path

import clarabel
import numpy as np
import pytest
from networks import network_of

import dobc_design as dd
from dobc_design.certification import certify as certification
from dobc_design.errors import SpecError
from dobc_design.importing.grids import merged, read_matpower
from dobc_design.loop.arrays import require_floats
from dobc_design.report.write import render_report
from dobc_design.solvers.conic import Cone, solve_cones
from dobc_design.sweeps.plan import Task, make_plan
from dobc_design.sweeps.result import SweepResult, _cell, _is_line

pytestmark = pytest.mark.skipif(os.name == "nt", reason="memory limits and devices of Unix")
WITHIN = "import resource, sys\nresource.setrlimit(resource.RLIMIT_AS, (3 << 30,) * 2)\n"
START = (
    f"{WITHIN}import dobc_design as dd\ndd.simulate('paper-fixed', t_final=1, start=sys.argv[1])"
)


def npy(array: np.ndarray, *, said: tuple[int, ...] | None = None) -> bytes:
    """An .npy file, whose head may say another shape."""
    stream = io.BytesIO()
    head = np.lib.format.header_data_from_array_1_0(array)
    np.lib.format.write_array_header_1_0(stream, head if said is None else head | {"shape": said})
    return stream.getvalue() + array.tobytes()


def zipped(path: Path, **members: bytes) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(f"{name}.npy", data)
    return path


@pytest.fixture(scope="module")
def bomb(tmp_path_factory) -> Path:
    """A GB of zeros in a MB."""
    path = tmp_path_factory.mktemp("bomb") / "x.npz"
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("x.npy", "w") as stream,
    ):
        header = npy(np.zeros(0), said=(12_500_000, 10, 1))
        stream.write(header)
        for _ in range(1000):
            stream.write(bytes(1_000_000))
    return path


def fifo(path: Path) -> Path:
    os.mkfifo(path)
    return path


def written(path: Path, data: bytes) -> Path:
    path.write_bytes(data)
    return path


ONES = npy(np.zeros((10, 1)))
#: Members of an archive.
ARRAYS: dict[str, bytes] = {
    "lie": npy(np.zeros((10, 1)), said=(10**9, 10, 1)),
    "other shape": npy(np.zeros((11, 1))),
    "nan": npy(np.full((10, 1), np.nan)),
    "deep head": b"\x93NUMPY\x01\x00\x10\x27" + b"(" * 10_000,
    "pickle": npy(np.array([{"a": 1}], dtype=object)),
}
TABLES: dict[str, bytes] = {
    "gz": gzip.compress(bytes(10**6)),
    "field": b'"' + b"1" * 10**6,
    "control": b"1\x1b[2J\n" * 10,
    "words": b"words\n",
    "ragged": b"1,2\n3\n5,6\n",
    "too large": b"1e400\n" * 10,
}
OTHERS = ("nothing known", "cut", "no zip", "fifo", "zero", "folder")


def hostile(kind: str, folder: Path) -> Path:
    """A file of starts, or what stands in its place."""
    archive = folder / "x.npz"
    if kind in ARRAYS:
        return zipped(archive, x=ARRAYS[kind])
    if kind in TABLES:
        return written(folder / "x.csv", TABLES[kind])
    match kind:
        case "nothing known":
            return zipped(archive, y=ONES)
        case "cut":
            whole = zipped(archive, x=ONES).read_bytes()
            return written(archive, whole[:-30])
        case "no zip":
            return written(archive, b"PK\x03\x04" + bytes(100))
        case "fifo":
            return fifo(archive)
        case "zero":
            return Path("/dev/zero")
    return folder


@pytest.mark.parametrize("kind", [*ARRAYS, *TABLES, *OTHERS])
def test_a_hostile_start_is_refused_by_its_key(tmp_path, kind: str):
    with pytest.raises(SpecError, match="start") as caught:
        dd.simulate("paper-fixed", t_final=1, start=hostile(kind, tmp_path))
    assert caught.value.cure or "start" in str(caught.value.key)
    assert "Error" not in str(caught.value)
    assert str(caught.value).isprintable()


@pytest.mark.slow
@pytest.mark.parametrize(
    "code", [START, f"{WITHIN}import dobc_design as dd\ndd.load_trajectory(sys.argv[1])"]
)
def test_a_gigabyte_of_zeros_is_refused_before_it_is_unpacked(bomb, code: str):
    command = [sys.executable, "-c", code, str(bomb)]
    done = subprocess.run(command, capture_output=True, check=False, timeout=120)
    assert b"SpecError" in done.stderr
    assert b"x.npz" in done.stderr


@pytest.mark.parametrize("key", ["target", "pinning.gains.1", "coupling", "network.modes.G"])
def test_a_number_beyond_floats_is_refused_by_its_key(key: str):
    big = {
        name: "1e400" if name == key else 1
        for name in ("target", "pinning.gains.1", "network.modes.G")
    }
    arcs = [[1, 2, big["network.modes.G"]]]
    network = network_of({"G": arcs})
    h = "1e400*y" if key == "coupling" else "y"
    gains = {"1": big["pinning.gains.1"]}
    problem = dd.Problem(network=network, coupling=h, target=big["target"], gains=gains)
    with pytest.raises(SpecError, match=key) as caught:
        dd.simulate(problem)
    assert caught.value.key == key
    with pytest.raises(SpecError, match=r"1\.8e308"):
        require_floats(problem)


@pytest.mark.parametrize("key", ["pinning.gains.1", "exosystem", "observer.W"])
def test_products_beyond_floats_are_refused_by_the_key_of_one_factor(key: str):
    """B K, B C and W B+ of agents with [dynamics], of numbers that all are floats."""
    gain = "1e200" if key == "pinning.gains.1" else 1
    C = "1e200" if key == "exosystem" else 1
    B = "1e200"
    W = [[0], [0]]
    if key == "observer.W":
        B = "1e-200"
        W = [["1e200"], [1]]
    dynamics = {"A": [[0, 1], [0, 0]], "B": [[0], [B]]}
    A = [[0, 1], [-1, 0]]
    exosystem = dd.Exosystem(A=A, C=[[C, 0]])
    problem = dd.Problem(
        network=network_of([[1, 2]]),
        coupling="y1",
        dynamics=dynamics,
        gains={"1": [[gain, 0]]},
        exosystem=exosystem,
        observer=dd.Observer(W=W),
    )
    assert require_floats(problem) is problem
    with pytest.raises(SpecError, match=r"1\.8e308") as caught:
        dd.simulate(problem)
    assert caught.value.key == key


def test_a_billion_runs_are_refused_with_the_limit():
    with pytest.raises(SpecError, match="runs must be at most 249376 with 401 samples"):
        dd.simulate("paper-fixed", runs=1_000_000_000)


@pytest.mark.parametrize("field", ["rate", "id", "seconds", "verdict", "error", "case", "values"])
def test_a_line_of_a_journal_with_a_wrong_field_is_no_line(field: str):
    target = {"target": [0]}
    plan = make_plan("clock-sync", target, task=Task(kind="certify"), samples=None, seed=0)
    columns = {name: None for name, _, _ in plan.task.columns}
    values = {"verdict": "proved", "rate": 0.5, "starts": "box"}
    result = columns | values
    line = {
        "case": 0,
        "id": "a" * 64,
        "values": list(plan.values(0)),
        "result": result,
        "error": None,
        "seconds": 1.0,
    }
    assert _is_line(line, plan)
    assert len(SweepResult(plan=plan, lines=(line,))) == 1
    wrong = {
        "rate": float("inf"),
        "id": "../x",
        "seconds": -1.0,
        "verdict": "surely",
        "error": {},
        "case": True,
    }
    change = {field: wrong.get(field, [1])}
    if field in result:
        change = {"result": result | change}
    assert not _is_line(line | change, plan)


IMPORT = f"{WITHIN}resource.setrlimit(resource.RLIMIT_CPU, (60, 60))\nimport dobc_design as dd\n"


@pytest.mark.slow
@pytest.mark.parametrize("suffix", ["csv", "graphml", "toml"])
def test_many_labels_are_read_in_a_minute_and_3_gb(tmp_path, suffix: str):
    count = 100_000 if suffix == "graphml" else 200_000
    path = tmp_path / f"x.{suffix}"
    if suffix == "csv":
        text = "\n".join(f"n{i},n{i + 1}" for i in range(count - 1))
    elif suffix == "graphml":
        nodes = "".join(f'<node id="n{i}"/>' for i in range(count))
        text = (
            '<graphml xmlns="http://graphml.graphdrawing.org/xmlns"><graph '
            f'edgedefault="directed">{nodes}'
        )
        text += '<edge source="n0" target="n1"/></graph></graphml>'
    else:
        labels = ",".join(f'"n{i}"' for i in range(count))
        text = f'name="x"\ntarget=0\n[network]\narrow="listens_to"\nagents=[{labels}]\n'
        text += '[network.modes]\nG=[["n0","n1"]]\n[coupling]\nh="y"\n'
    path.write_text(text)
    arrow = None if suffix == "toml" else "listens_to"
    code = f"{IMPORT}sys.stdout.write(str(dd.problem_from_file(sys.argv[1], arrow={arrow!r}).n))"
    command = [sys.executable, "-c", code, str(path)]
    done = subprocess.run(command, capture_output=True, check=False)
    assert done.stdout == str(count).encode()
    assert done.stderr == b""


@pytest.mark.slow
def test_many_dots_and_joined_buses_are_read_in_linear_time():
    with pytest.raises(SpecError, match=r"mpc\.bus"):
        read_matpower("." * 500_000, name="x.m")
    labels = list(map(str, range(200_000)))
    assert set(merged(labels, list(pairwise(labels))).values()) == {"0"}


def test_help_shows_brackets_and_colons_as_they_are_typed(command_line, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setenv("TERM", "dumb")
    for command, typed in (("sweep", "KEY=1:100:5:log"), ("simulate", "[switching]")):
        assert typed in command_line(command, "--help").out


@pytest.mark.slow
@pytest.mark.parametrize("command", ["certify", "simulate"])
def test_a_home_that_cannot_be_written_is_no_matter_for_standard_error(tmp_path, command: str):
    """Matplotlib would say where it keeps its fonts instead."""
    program = [sys.executable, "-m", "dobc_design", command, "clock-sync"]
    elsewhere = {name: text for name, text in os.environ.items() if name != "MPLCONFIGDIR"}
    elsewhere["HOME"] = "/proc"
    arguments = [*program, "--out", str(tmp_path / "out")]
    done = subprocess.run(arguments, capture_output=True, check=False, timeout=300, env=elsewhere)
    assert done.returncode == 0
    assert done.stderr == b""


def test_a_cell_of_csv_is_no_formula_and_numbers_stay_numbers():
    for text in ("=1+1", "@a", "-y", "+a", "\t=1"):
        assert _cell(text) == f"'{text}"
    for number in ("-1.5", -1.5, "y", None, "+3"):
        assert _cell(number) == number
    assert _cell(True) == "true"


WIDE = {"initial_states": [-1, "1e400"]}


@pytest.mark.parametrize(
    ("weight", "region", "verdict", "stages"),
    [
        ("1e400", None, "proved", 4),  # both agents are reached
        (1, WIDE, "undecided", 1),
        pytest.param(1, WIDE, "undecided", 4, marks=pytest.mark.slow),
    ],
)
def test_numbers_beyond_floats_have_a_verdict_and_a_report(
    weight, region, verdict, stages: int, monkeypatch
):
    """``stages``: so many of those of the region, of which the first asks for a box, the second for
    an ellipsoid."""
    monkeypatch.setattr("dobc_design.certification.certify.STAGES", certification.STAGES[:stages])
    arcs = [[1, 2, weight], [2, 1]]
    network = network_of({"G": arcs})
    given = {"coupling": "y + tanh(y)", "gains": {"1": 1}, "region": region}
    certificate = dd.certify(dd.Problem(network=network, **given))
    assert {"report.html", "report.md"} <= render_report(certificate).keys()
    assert certificate.verdict.value == verdict


def test_cliques_are_merged_with_their_parents_alone(monkeypatch):
    """The other way of Clarabel 0.11.1 takes all memory for some small programs."""
    told = []
    solver = clarabel.DefaultSolver
    monkeypatch.setattr(
        clarabel, "DefaultSolver", lambda *given: told.append(given[-1]) or solver(*given)
    )
    # x I - 2 I >= 0
    rows = np.array([[-1.0], [0.0], [-1.0]])
    right = np.array([-2.0, 0.0, -2.0])
    square = Cone("semidefinite", rows, right)
    found = solve_cones(np.array([1.0]), [square])
    assert found.x == pytest.approx([2.0], abs=1e-6)
    assert [settings.chordal_decomposition_merge_method for settings in told] == ["parent_child"]


@pytest.mark.slow
def test_a_small_program_does_not_take_all_memory():
    """Clarabel 0.11.1 merged cliques without an end for the pins of these five modes of 19
    agents."""
    tests = Path(__file__).resolve().parents[1]
    paths = [str(tests), str(tests / "support")]
    child = (
        f"{WITHIN}sys.path[:0] = {paths}\nfrom evidence.schedules import case\nimport "
        "dobc_design as dd\n"
    )
    child += "print(dd.certify(case(359).problem).verdict.value)"
    command = [sys.executable, "-c", child]
    ran = subprocess.run(command, capture_output=True, text=True, timeout=100, check=False)
    told = (ran.stdout, ran.returncode)
    assert told == ("refuted\n", 0), ran.stderr[-2000:]
