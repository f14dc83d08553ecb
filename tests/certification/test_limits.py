"""Inputs that once ran for minutes or filled the memory end soon, with a verdict that both programs
confirm.

Measured in a child process; the bounds are several times what is needed.
"""

import os
import subprocess
import sys
from fractions import Fraction
from itertools import combinations
from pathlib import Path
from random import Random

import pytest
from networks import linked

import dobc_design as dd
from dobc_design.coupling.enclosures import Curve, profile
from dobc_design.coupling.expression import parse_expression
from dobc_design.errors import SpecError
from dobc_design.exact.number import number_key
from dobc_design.exact.work import (
    WorkLimitError,
    at_most,
    exhausted,
    out_of_time,
    read_time_limit,
    spend,
    until,
)

RING = "a = [[1, 2], [2, 3], [3, 1]]"
CHILD = """
import resource, runpy, sys
resource.setrlimit(resource.RLIMIT_CPU, (120, 120))
resource.setrlimit(resource.RLIMIT_AS, (3 << 30, 3 << 30))
alone = sys.argv[2] == "checker"
sys.argv = sys.argv[2 if alone else 1 :]
runpy.run_module("dobc_design.checker" if alone else "dobc_design", run_name="__main__")
"""


def problem_text(
    h: str = "sin(y)", *, modes: str = RING, more: str = "", region: str = "[-0.5, 0.5]"
) -> str:
    start = f"[region]\ninitial_states = {region}\n" if region else ""
    network = f'target = 0\n[network]\nagents = 3\narrow = "listens_to"\n[network.modes]\n{modes}\n'
    return f'{network}[coupling]\nh = "{h}"\n[pinning]\ngains = 2\n{more}{start}'


def dense(order: int) -> str:
    random = Random(order)
    rows = []
    for _ in range(order + 1):
        rows.append([f'"{random.randint(-99, 99)}/{random.randint(1, 97)}"' for _ in range(order)])
    parts = (rows[1:], rows[:1])
    A, C = (f"[{', '.join('[' + ', '.join(row) + ']' for row in part)}]" for part in parts)
    return f"[exosystem]\nA = {A}\nC = {C}\n"


def given(order: int, groups: int = 1, *, region: str = "[-1, 1]") -> str:
    """Dense exosystems, skew-symmetric but for the diagonal, each with a W that keeps the errors
    stable."""
    random, text = Random(5), 'h = "y+tanh(y)"\n[pinning]\ngains = { 3 = 2 }\n'
    for agent in range(1, groups + 1):
        A = []
        for i in range(order):
            A.append([Fraction(-(i == j), 2) for j in range(order)])
        for i, j in combinations(range(order), 2):
            numerator = random.randint(-9, 9)
            A[i][j] = Fraction(numerator, random.randint(2, 9))
            A[j][i] = -A[i][j]
        C_row = [[1] * order]
        W_column = [["1/10"]] * order
        matrices = (A, C_row, W_column)
        A, C, W = ([[str(x) for x in row] for row in M] for M in matrices)
        own = f"agents = [{agent}]\nW = {W}\n" if groups > 1 else ""
        text += f"[{'[exosystem.groups]' if groups > 1 else 'exosystem'}]\n{own}A = {A}\nC = {C}\n"
    observer = "" if groups > 1 else f"[observer]\nW = {W}\n"
    start = f"[region]\ninitial_states = {region}\ninitial_disturbance = 0.1\n" if region else ""
    network = (
        'target = 0\n[network]\nagents = 3\narrow = "listens_to"\n[network.modes]\nG = [[1, '
        "2], [2, 3]]\n"
    )
    return f"{network}[coupling]\n{text}{observer}{start}"


def many_modes(count: int) -> str:
    return "\n".join(f"m{i} = [[1, 2], [2, 3], [3, 1, {1 + i}]]" for i in range(count))


def ran(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    child = [sys.executable, "-c", CHILD, "dobc", *arguments]
    return subprocess.run(
        child, cwd=folder, capture_output=True, text=True, timeout=600, check=False
    )


SINES = "+".join(f"sin({k}*y)/{k * k}" for k in range(1, 120))
NESTED = "tan(" * 45 + "y" + ")" * 45
HANGS = {
    "tower": (problem_text("(((y+1)**64+y)**64+y)**64 - 1"), 3),
    "nested": (problem_text(NESTED), 3),
    "modes": (problem_text(modes=many_modes(300), region="[-1, 1]"), 0),
    "order 40": (problem_text("y", more=dense(40), region=""), 3),
    "sines": (problem_text(SINES, region="[-1, 1]"), 0),
    "order 20": (problem_text("y", more=dense(20), region=""), 0),
}


LONG = dict.fromkeys(
    ("modes", "nested", "sines", "order 20", "order 40", "tower"), pytest.mark.evidence
)


@pytest.mark.skipif(os.name == "nt", reason="limits of Unix")
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=LONG.get(name, pytest.mark.slow)) for name in HANGS]
)
def test_what_hung_ends_with_a_certificate_that_both_programs_confirm(name: str, tmp_path: Path):
    """Problems whose stages had no limit: pieces of an interval, bits of a number, modes,
    orders."""
    text, code = HANGS[name]
    (tmp_path / "problem.toml").write_text(text, encoding="utf-8")
    found = ran(tmp_path, "certify", "problem.toml", "--no-report", "--out", "out")
    assert found.returncode == code, found.stderr[-500:]
    again = ran(tmp_path, "verify", "out/certificate.json", "--problem", "problem.toml", "--json")
    assert again.returncode == 0, again.stdout[-500:]


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="limits of Unix")
@pytest.mark.parametrize(
    ("order", "region", "code"),
    [(20, "", 0), pytest.param(200, "[-1, 1]", 3, marks=pytest.mark.evidence)],
)
def test_a_design_for_a_large_exosystem_ends_with_a_proof_or_a_reason(
    order: int, region: str, code: int, tmp_path: Path
):
    (tmp_path / "problem.toml").write_text(given(order, region=region), encoding="utf-8")
    found = ran(tmp_path, "design", "problem.toml", "--out", "new.toml")
    assert found.returncode == code, found.stderr[-500:]
    assert code == 0 or "takes long with an exosystem of order 200" in " ".join(
        found.stdout.split()
    )


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="limits of Unix")
@pytest.mark.parametrize(
    ("order", "groups"), [(20, 3), pytest.param(100, 1, marks=pytest.mark.evidence)]
)
def test_a_given_gain_for_a_large_exosystem_ends_with_a_proof_of_the_region(
    order: int, groups: int, tmp_path: Path
):
    """The semidefinite program for the error bound has q^2/2 unknowns; a Lyapunov equation proposes
    it as well."""
    text = given(order // groups, groups)
    (tmp_path / "problem.toml").write_text(text, encoding="utf-8")
    found = ran(tmp_path, "certify", "problem.toml", "--no-report", "--out", "out")
    assert found.returncode == 0, found.stderr[-500:]
    assert "max-separable" in found.stdout
    assert (
        ran(tmp_path, "verify", "out/certificate.json", "--problem", "problem.toml").returncode == 0
    )
    assert (
        groups == 1
        or ran(tmp_path, "checker", "out/certificate.json", "out/problem.json").returncode == 0
    )


@pytest.mark.parametrize("radius", [1, "7/5"])
def test_a_slope_that_only_touches_zero_takes_few_cells(radius: str | int):
    """h = log(1 + y^2) + y has h' = (1 + y)^2/(1 + y^2) >= 0, which is 0 at y = -1 alone: 20,000
    cells before."""
    curve = Curve(parse_expression("log(1+y**2)+y"))
    with at_most(10_000):
        cells = profile(curve, dd.exact.parse_number(radius, key="radius")).cells
    assert len(cells) < 10
    assert all(cell.direction >= 0 for cell in cells)


def test_work_beyond_an_account_is_refused_and_without_one_nothing_is_counted():
    spend(10**9)
    with at_most(10):
        spend(10)
        assert exhausted() is None
        with pytest.raises(WorkLimitError, match="10 steps of work"):
            spend(1)
        assert exhausted() is not None
    assert exhausted() is None


def test_a_stage_without_work_left_is_undecided_and_says_so(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    """Every region stage opens an account of its own; Lemma 1 needs none."""
    problem = loaded(
        tmp_path, problem_text(modes="a = [[2, 1]]").replace("agents = 3", "agents = 2")
    )
    for stage in ("separable", "arcs", "quadratic", "schedule"):
        monkeypatch.setattr(f"dobc_design.conditions.{stage}.stage.STAGE", 5)
    certificate = dd.certify(problem, settling="1/10")
    cut = {check.id for check in certificate.checks if "cut off after" in check.reason}
    assert {"max-separable", "arc-wise", "lure", "settling"} <= cut
    assert certificate.check("lemma1").verdict is dd.Verdict.PROVED
    assert dd.verify(certificate, problem).holds


def test_a_time_limit_leaves_out_the_stages_after_it_and_the_certificate_says_so():
    certificate = dd.certify("clock-sync", everything=True, time_limit="1e-9")
    late = {check.id for check in certificate.checks if "time limit of 1e-09 s" in check.reason}
    assert {"theorem1", "max-separable", "arc-wise", "lure"} <= late
    assert any("time limit" in note for note in certificate.claims.notes)
    assert certificate.claims.options[-1].startswith("--time-limit ")
    assert dd.verify(certificate, "clock-sync").holds
    with until(None):
        assert out_of_time() is None


@pytest.mark.slow
def test_a_time_limit_that_ends_the_search_for_a_faster_ball_leaves_the_ball(
    monkeypatch: pytest.MonkeyPatch,
):
    def late(*_: object) -> float:
        raise WorkLimitError("the time limit is over.")

    monkeypatch.setattr("dobc_design.conditions.quadratic.stage.linear_rate", late)
    region = {"initial_states": ["-1/10", "1/10"]}
    problem = linked([[2, 1]], 2, gains={1: 1}, region=region)
    certificate = dd.certify(problem, everything=True)
    assert certificate.check("lure").verdict is dd.Verdict.PROVED


@pytest.mark.parametrize("wrong", ["0", "-1", "nan", "soon", "1e9"])
def test_a_wrong_time_limit_is_refused_by_its_name(wrong: str):
    with pytest.raises(SpecError) as refused:
        read_time_limit(wrong, key="--time-limit")
    assert refused.value.key == "--time-limit"


def loaded(folder: Path, text: str) -> dd.Problem:
    (folder / "problem.toml").write_text(text, encoding="utf-8")
    return dd.load_problem(folder / "problem.toml")


def test_agents_that_no_pin_reaches_leave_out_quadratic_proofs(tmp_path: Path):
    """Moved together they stay where they are, so no V decreases."""
    text = problem_text(modes="a = [[1, 2], [2, 3], [3, 2]]").replace(
        "gains = 2", "gains = { 1 = 2 }"
    )
    problem = loaded(tmp_path, text)
    certificate = dd.certify(problem)
    assert certificate.verdict is dd.Verdict.REFUTED
    assert certificate.check("lure").reason.startswith(
        "does not apply: in mode a no pin reaches agents 2 and 3"
    )
    assert dd.verify(certificate, problem).holds


def test_numbers_of_one_hash_have_different_keys():
    """hash(k (2^61 - 1)) = 0 for every k."""
    numbers = [k * (2**61 - 1) for k in range(100)]
    assert len(set(map(hash, numbers))) == 1
    assert len({hash(number_key(number)) for number in numbers}) == 100
    assert number_key(1) != number_key("1/1")


FIVE = """
[network]
agents = 5
arrow = "listens_to"
[network.modes]
a = [[1, 2], [1, 3], [1, 4], [2, 4], [2, 5], [3, 2], [3, 5], [4, 1], [4, 5], [5, 1], [5, 2]]
[coupling]
h = "y"
[exosystem]
A = [[0]]
C = [[1]]
"""


def test_a_faster_observer_reaches_a_rate_that_gains_alone_do_not(tmp_path: Path):
    """Gains of 12 on 2 and 5 and W = 5 reach 0.9 for V = e'e; the true rate takes a quarter of
    that."""
    stages: list[str] = []
    found = dd.design(loaded(tmp_path, FIVE), rate="0.9", pins=2, progress=stages.append)
    assert found.verdict == dd.Verdict.PROVED
    assert len(found.gains) == 2
    assert found.cost is not None
    assert found.cost < 6
    assert found.rate is not None
    assert found.rate >= 0.9
    assert "deciding the theorem" in stages


@pytest.mark.parametrize(
    ("arcs", "radius"),
    [("[2, 1]", "1.6"), pytest.param("[2, 1, 1.02]", "1.81", marks=pytest.mark.slow)],
)
def test_designs_for_a_wide_region_of_a_sine_are_found(arcs: str, radius: str, tmp_path: Path):
    """sin falls beyond pi/2, which differences of these starts reach; small gains on both of two
    agents do."""
    text = problem_text(modes=f"a = [{arcs}]", region=f"[-{radius}, {radius}]").replace(
        "agents = 3", "agents = 2"
    )
    problem = loaded(tmp_path, text.replace("[pinning]\ngains = 2\n", ""))
    found = dd.design(problem)
    assert found.verdict is dd.Verdict.PROVED
    assert found.problem is not None
    assert found.certificate is not None
    assert dd.verify(found.certificate, found.problem).holds


@pytest.mark.slow
def test_a_design_for_a_region_of_a_sine_with_an_observer_ends_with_a_proof(tmp_path: Path):
    """Agent 4 listens to nobody and is heard; once the search for gains and W had no end."""
    arcs = "[[2, 3], [2, 5], [3, 1], [5, 1], [5, 3], [5, 4]]"
    head = FIVE[: FIVE.index("a =")] + f"a = {arcs}\n"
    tail = FIVE[FIVE.index("[coupling]") :].replace('"y"', '"sin(y)"')
    text = head + tail
    text = text.replace("A = [[0]]\nC = [[1]]", "A = [[0, 1], [-1, 0]]\nC = [[1, 0]]")
    problem = loaded(
        tmp_path, f"{text}[region]\ninitial_states = [-0.86, 0.86]\ninitial_disturbance = 0.5\n"
    )
    found = dd.design(problem)
    assert found.verdict is dd.Verdict.PROVED
    assert found.problem is not None
    assert dd.verify(dd.certify(found.problem), found.problem).holds
