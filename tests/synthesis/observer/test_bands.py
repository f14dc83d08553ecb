"""Poles for sines of unknown frequency (theory, section 19)."""

import numpy as np
import pytest

import dobc_design as dd
from dobc_design.errors import SpecError
from dobc_design.exact.matrix import to_float

ARCS = [["tail", "head"]]
BANDS = [["1.8", "2.2", "0.5"]]


def problem(exosystem=None, bands=BANDS, components=1):
    return dd.Problem(
        network=dd.Network.from_arcs(ARCS, arrow="listens_to"),
        coupling="y",
        target=[0] * components,
        gains={"head": 3},
        exosystem=exosystem or dd.exosystems.stacked(*[dd.exosystems.constant()] * components),
        uncertainty={"bands": bands},
    )


def left_of(design, low=1.8, high=2.2):
    """The largest row sum of I - C (jw - F)^-1 W on a dense grid, by linear solves."""
    A, C = (to_float(M) for M in (design.problem.exosystem.A, design.problem.exosystem.C))
    W = to_float(design.W)
    most = 0.0
    for w in np.linspace(low, high, 2001):
        S = np.eye(len(C)) - C @ np.linalg.solve(1j * w * np.eye(len(A)) - A + W @ C, W)
        most = max(most, np.abs(S).sum(axis=1).max())
    return most


@pytest.mark.parametrize("components", [1, 2])
def test_the_fewest_pairs_leave_no_more_than_is_asked(components: int):
    """A smaller residual takes more pairs; what is claimed is what a sweep finds, within 1e-5."""
    found = [
        dd.design_bands(problem(components=components), residual=part, rate=2)
        for part in ("0.1", "0.01", "0.0001")
    ]
    pairs = [design.pairs for design in found]
    assert pairs == sorted(set(pairs))
    for design, asked in zip(found, (0.1, 0.01, 0.0001), strict=True):
        assert design.is_proved
        assert left_of(design) <= float(design.left[0]) <= min(asked, left_of(design) * 1.00001)


def test_one_pair_less_leaves_more_than_is_asked():
    """The twin that just fails: with the poles of the design before, 1/100 is not met."""
    fewer = dd.design_bands(problem(), residual="0.1", rate=2)
    more = dd.design_bands(problem(), residual="0.01", rate=2)
    assert more.pairs == fewer.pairs + 1
    assert fewer.left[0] > more.residual


def test_poles_inside_a_band_are_chosen_anew_and_others_stay():
    """A sine at 2 rad/s is replaced, one at 5 rad/s and a constant are kept."""
    parts = [dd.exosystems.constant(), dd.exosystems.harmonics([2, 5])]
    design = dd.design_bands(problem(dd.exosystems.total(*parts)), residual="0.1", rate=2)
    eigenvalues = np.linalg.eigvals(to_float(design.problem.exosystem.A))
    sines = sorted(x for x in eigenvalues.imag if x > 0)
    assert len(eigenvalues) == 3 + 2 * design.pairs
    assert sines[-1] == pytest.approx(5)
    assert all(1.8 < x < 2.2 for x in sines[:-1])
    assert 2.0 not in sines


def test_nothing_left_of_a_band_is_impossible():
    """Internal model principle: S(jw) vanishes at eigenvalues of A only."""
    design = dd.design_bands(problem(), residual=0)
    assert design.verdict is dd.Verdict.REFUTED
    assert "internal model" in design.reason


def test_what_is_asked_has_to_make_sense():
    with pytest.raises(SpecError, match="residual must be a part of a sine, >= 0; got -1"):
        dd.design_bands(problem(), residual=-1)
    with pytest.raises(SpecError, match=r"exosystem\.bands is missing"):
        dd.design_bands("paper-fixed", residual="0.1")


def test_measured_outputs_are_refused_by_name():
    cart = {"A": [[0, 1], [0, 0]], "B": [[0], [1]], "H": [[1, 0]]}
    measured = dd.Problem(
        network=dd.Network.from_arcs({"G": []}, arrow="listens_to", agents=1),
        dynamics=cart,
        coupling="y1",
        gains={1: [[4, 4]]},
        exosystem=dd.exosystems.constant(),
        uncertainty={"bands": [[1, 2, 1]]},
    )
    with pytest.raises(SpecError, match=r"^dynamics\.H: the design of poles for bands does not"):
        dd.design_bands(measured, residual="0.1")
