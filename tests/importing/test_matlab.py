"""MATLAB files written by SciPy, read as problems."""

from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.io import savemat

import dobc_design as dd
from dobc_design.errors import SpecError
from dobc_design.verdict import Verdict

L = np.array([[1.0, -1.0, 0.0], [0.0, 0.5, -0.5], [-2.0, 0.0, 2.0]])


def written(tmp_path, **variables):
    savemat(tmp_path / "net.mat", variables)
    return tmp_path / "net.mat"


def test_a_laplacian_says_who_listens_to_whom(tmp_path):
    """Row i has -w_ij where i listens to j."""
    problem = dd.problem_from_file(written(tmp_path, L=L, k=np.array([[5.0], [0.0], [0.25]])))
    assert list(problem.network.modes["G"]) == [(0, 1, 1), (1, 2, 0.5), (2, 0, 2)]
    assert problem.coupling.texts == ("y",)
    assert {i: float(k[0][0]) for i, k in problem.pinning.gains.items()} == {0: 5.0, 2: 0.25}
    assert "linear" in problem.notes[0]
    assert problem.name == "net"


def test_a_sparse_laplacian_a_coupling_and_an_exosystem_certify(tmp_path):
    path = written(
        tmp_path,
        L=sp.csc_matrix(L),
        A=np.array([[0.0, 2.0], [-2.0, 0.0]]),
        C=np.array([[1.0, 0.0]]),
        h="tanh(y)",
        k=3.0,
        xbar=1.5,
        W=np.array([[3.2], [2.4]]),
    )
    problem = dd.problem_from_file(path)
    assert problem.target == (Fraction(3, 2),)
    assert problem.observer.W == dd.load_problem("paper-fixed").observer.W
    assert dd.certify(problem).verdict is Verdict.PROVED


def test_layers_are_modes_with_their_names(tmp_path):
    names = np.empty((2, 1), dtype=object)
    names[:, 0] = ["calm", "storm"]
    problem = dd.problem_from_file(written(tmp_path, L=np.stack([L, 2 * L], axis=2), modes=names))
    assert list(problem.network.modes) == ["calm", "storm"]
    assert [float(w) for w in problem.network.modes["storm"].weights] == [2.0, 1.0, 4.0]


@pytest.mark.parametrize(
    ("variables", "match"),
    [
        ({"A": [[0.0]]}, "must hold the variable L"),
        ({"L": L.T}, "give the transpose"),
        ({"L": -L}, "entries <= 0 off the diagonal"),
        ({"L": np.array([[np.nan, 0.0], [0.0, 0.0]])}, "must be finite"),
        ({"L": np.ones((2, 3))}, r"n x n, or n x n x modes; got shape \(2, 3\)"),
        ({"L": L, "A": [[0.0]]}, "A and C must stand together"),
        ({"L": L, "k": np.ones((2, 1))}, "3 gains"),
        ({"L": L, "h": 3.0}, "h must be text"),
        ({"L": L * 1j}, "real matrix"),
        ({"L": L, "h": "exp(y)"}, "must vanish"),
        ({"L": L, "labels": "ab"}, "labels must hold 3 texts"),
        ({"L": L, "offsets": np.ones((2, 1))}, "offsets must have 3 rows"),
    ],
)
def test_a_wrong_variable_is_named(variables, match: str, tmp_path):
    with pytest.raises(SpecError, match=match):
        dd.problem_from_file(written(tmp_path, **variables))


@pytest.mark.parametrize("data", [b"", b"MATLAB 7.3 MAT-file", b"\x00" * 300, bytes(range(256)) * 8])
def test_bytes_that_are_no_matlab_file_are_refused(data: bytes, tmp_path):
    (tmp_path / "net.mat").write_bytes(data)
    with pytest.raises(SpecError):
        dd.problem_from_file(tmp_path / "net.mat")
