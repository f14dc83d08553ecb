"""The LMI as an SDPA file: read back, solved by others, the same verdict."""

import shutil
import subprocess
from fractions import Fraction

import numpy as np
import pytest
from oracles.observers import Margin, solve_dense

import dobc_design as dd
from dobc_design import Exosystem, Network, Problem, load_problem
from dobc_design.conditions.consensus.claim import state_theorems
from dobc_design.errors import SpecError
from dobc_design.export.matrices import normalisation, sdpa_text
from dobc_design.loop.make import loop_of

no_csdp = shutil.which("csdp") is None
needs_csdp = pytest.mark.skipif(
    no_csdp, reason="CSDP is not installed (Debian: apt install coinor-csdp)"
)


def pair_problem(
    *, k: object = 1, A: object = 0, modes: int = 1, unseen: bool = False, h: str = "y"
) -> Problem:
    """Two agents that hear each other; agent 1 pinned with k; a disturbance xi' = A xi, or a
    growing state unseen."""
    arcs = {}
    for i in range(modes):
        arcs[f"G{i}"] = [[1, 2], [2, 1, i + 1]]
    A_of_both = [[0, 0], [0, 1]]
    C_of_first = [[1, 0]]
    hidden = Exosystem(A=A_of_both, C=C_of_first)  # not detectable
    network = Network.from_arcs(arcs, arrow="listens_to")
    return Problem(
        network=network,
        coupling=h,
        gains={"1": k} if k else {},
        exosystem=hidden if unseen else None if A is None else Exosystem(A=[[A]], C=[[1]]),
    )


class SdpaFile:
    """c, and for every block the dense F_0, F_1, ..., F_k; written for this test from the format's
    description."""

    def __init__(self, text: str) -> None:
        lines = []
        for line in text.splitlines():
            if not line.startswith('"'):
                lines.append(line)
        count = int(lines[0])
        blocks = int(lines[1])
        sizes = [int(word) for word in lines[2].split()]
        assert len(sizes) == blocks
        words = lines[3].split()
        self.c = np.array([float(word) for word in words])
        assert len(self.c) == count
        self.F = [np.zeros((count + 1, size, size)) for size in sizes]
        for line in lines[4:]:
            number, block, i, j, value = line.split()
            F = self.F[int(block) - 1][int(number)]
            assert int(i) <= int(j), "the upper triangle"
            entry = F[int(i) - 1, int(j) - 1]
            assert entry == 0, "every entry once"
            F[int(i) - 1, int(j) - 1] = F[int(j) - 1, int(i) - 1] = float(value)

    def solved(self) -> float:
        import cvxpy as cp

        x = cp.Variable(len(self.c))
        constraints = []
        for F in self.F:
            constraints.append(sum(x[k] * F[k + 1] for k in range(len(self.c))) - F[0] >> 0)
        problem = cp.Problem(cp.Minimize(self.c @ x), constraints)
        return float(problem.solve(solver="CLARABEL"))


def csdp(text: str, folder) -> float:
    """CSDP's primal objective, which is SDPA's minimum."""
    (folder / "lmi.dat-s").write_text(text)
    command = ["csdp", "lmi.dat-s", "lmi.sol"]
    done = subprocess.run(
        command,
        cwd=folder,
        capture_output=True,
        check=False,
        text=True,
        timeout=120,
    )
    assert done.returncode in (0, 3), done.stdout  # 3: solved with reduced accuracy
    printed = done.stdout.splitlines()
    line = next(line for line in printed if line.startswith("Primal objective value"))
    return float(line.split()[3])


CASES = [
    ("one mode", {}, "proved"),
    ("two modes", {"modes": 2}, "proved"),
    ("growing disturbance", {"A": "1/2"}, "proved"),
    ("nobody pinned", {"k": 0}, "refuted"),
    ("undetectable", {"unseen": True}, "refuted"),
]


@pytest.mark.parametrize(("name", "given", "verdict"), CASES, ids=[case[0] for case in CASES])
def test_clarabel_finds_a_negative_t_exactly_where_the_theorem_is_proved(
    name: str, given, verdict: str
):
    """The Decision theorem: a pair exists iff Lambda < 0 and (A, C) is detectable."""
    text = dd.export.to_sdpa(pair_problem(**given))
    assert f"decided exactly by dobc_design: {verdict}" in text
    optimum = SdpaFile(text).solved()
    assert (optimum < -1e-4) if verdict == "proved" else (optimum > -1e-6)


@needs_csdp
@pytest.mark.parametrize(("name", "given", "verdict"), CASES, ids=[case[0] for case in CASES])
def test_csdp_gives_the_same_verdict(name: str, given, verdict: str, tmp_path):
    optimum = csdp(dd.export.to_sdpa(pair_problem(**given)), tmp_path)
    assert (optimum < -1e-4) if verdict == "proved" else (optimum > -1e-6)


def test_the_file_states_the_same_program_as_the_dense_lmi():
    """Same optimum as cvxpy's block LMI (18) with the same bounds on P and Q."""
    for problem in (pair_problem(), load_problem("paper-fixed")):
        text = sdpa_text(problem)
        pencils = state_theorems(loop_of(problem)).psi()
        program = Margin(pencils=pencils, ratio=Fraction(100), radius=Fraction(100))
        solved = SdpaFile(text).solved()
        assert solved == pytest.approx(solve_dense(program).objective, abs=1e-5)


def test_without_an_exosystem_the_file_is_lemma_1():
    """min t is lambda_max(Lambda): two agents, one pinned with 1: eigenvalues of [[-4, 2], [2,
    -2]]."""
    text = dd.export.to_sdpa(pair_problem(A=None))
    assert "Lemma 1" in text
    found = SdpaFile(text)
    assert len(found.c) == 1
    M = [[-4, 2], [2, -2]]
    largest = np.linalg.eigvalsh(M)
    assert found.solved() == pytest.approx(largest.max(), abs=1e-6)


def test_the_bounds_leave_room_for_a_pair_that_is_small_or_large():
    """P = 1/1000 has to be scaled up to 1 first; |Q| with it."""
    bound = ((Fraction(1, 1000),),)
    weight = ((Fraction(3, 1000),),)
    small = normalisation((bound, weight))
    assert small.ratio >= 2
    assert small.radius >= 6
    large_bound = ((Fraction(500),),)
    large_weight = ((Fraction(1),),)
    large = normalisation((large_bound, large_weight))
    assert 1000 <= large.ratio <= 10_000
    assert normalisation(None).ratio == 100


def test_couplings_with_a_kink_have_no_lmi():
    with pytest.raises(SpecError, match="no linear matrix inequality"):
        dd.export.to_sdpa(pair_problem(A=None, h="y + abs(y)/2"))


def test_irrational_slopes_are_named_in_the_file():
    assert "irrational" in sdpa_text(pair_problem(A=None, h="exp(1)*y"))
    assert "irrational" not in sdpa_text(pair_problem())
