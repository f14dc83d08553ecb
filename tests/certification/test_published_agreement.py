"""Published problems of agreement, with answers that NumPy computes."""

from __future__ import annotations

import numpy as np
import pytest
from published import average, clocks, headings, jointly_rooted, leaderless, sharing
from scipy.linalg import expm

import dobc_design as dd
from dobc_design.verdict import Verdict


def laplacian(problem: dd.Problem, mode: str | None = None) -> np.ndarray:
    arcs = problem.network.modes[mode or next(iter(problem.network.modes))]
    L = np.zeros((problem.n, problem.n))
    for i, j, weight in arcs:
        L[i, j] -= float(weight)
        L[i, i] += float(weight)
    return L


def proved(problem: dd.Problem) -> dd.Certificate:
    certificate = dd.certify(problem)
    assert certificate.verdict is Verdict.PROVED
    assert dd.verify(certificate, problem).holds
    return certificate


def local_rate(certificate: dd.Certificate) -> float:
    return certificate.check("linearisation").rate


@pytest.mark.parametrize("build", [average, clocks, sharing, headings])
def test_the_rate_near_agreement_is_the_second_eigenvalue_of_the_laplacian(build):
    """Olfati-Saber and Murray 2004; 2 - 2 cos(2 pi/10), 2 - sqrt(2) on a path of four clocks."""
    problem = build()
    second = np.sort(np.linalg.eigvals(laplacian(problem)).real)[1]
    found = local_rate(dd.certify(problem.replace(region=None)))
    if problem.groups:
        second = min(second, 2)  # the observer's own
    assert 0.99 * second <= found <= second


@pytest.mark.parametrize(
    ("build", "weights"),
    [
        pytest.param(average, [1 / 10] * 10, marks=pytest.mark.slow),
        (clocks, [1 / 4] * 4),
        (sharing, [1 / 6, 1 / 3, 1 / 2]),
    ],
)
def test_the_value_is_the_weighted_mean_of_the_starts(build, weights):
    """pi' L = 0."""
    problem = build()
    found = proved(problem).value.weights
    np.testing.assert_allclose([float(w) for w in found.values()], weights, rtol=1e-12)
    np.testing.assert_allclose(np.array(weights) @ laplacian(problem), 0, atol=1e-12)


@pytest.mark.slow
def test_graphs_that_have_a_root_together_lead_to_agreement_no_faster_than_their_flow():
    """Moreau 2005, Ren and Beard 2005; one arc fewer leaves two groups."""
    problem = jointly_rooted()
    certificate = proved(problem)
    flow = np.eye(4)
    for mode in ("a", "b", "c"):
        flow = expm(-laplacian(problem, mode)) @ flow
    second = np.sort(np.abs(np.linalg.eigvals(flow)))[-2]
    assert certificate.rate is None or certificate.rate <= -np.log(second) / 3
    modes = {"a": [[2, 1]], "b": [[3, 2]]}
    network = dd.Network.from_arcs(modes, arrow="listens_to", agents=4)
    turns = dd.Switching(guarantee="sequence", sequence=["a", "b"], dwell=1)
    fewer = dd.Problem(network=network, coupling="y", goal="agreement", switching=turns)
    assert dd.certify(fewer).verdict is Verdict.REFUTED


def test_leaderless_double_integrators_agree_as_the_roots_of_each_eigenvalue_say():
    """s^2 + 2 mu s + mu for every eigenvalue mu of L but 0."""
    problem = leaderless()
    certificate = proved(problem)
    slowest = -2.0
    for mu in np.linalg.eigvals(laplacian(problem)):
        if abs(mu) > 1e-9:
            slowest = max(slowest, *np.roots([1, 2 * mu, mu]).real)
    assert slowest < 0
    assert 0.95 * -slowest <= local_rate(certificate) <= -slowest


def test_headings_within_half_a_turn_agree_between_the_first_ones():
    certificate = proved(headings())
    assert certificate.check("max-separable").is_proved
    assert certificate.value.lo == pytest.approx((-0.7,))
    assert certificate.value.hi == pytest.approx((0.7,))


@pytest.mark.slow
def test_a_region_that_is_too_wide_is_told_by_how_far_apart_agents_start():
    """Within 2 rad the sine falls."""
    wide = headings().replace(region={"initial_states": [-1, 1]})
    certificate = dd.certify(wide)
    assert certificate.verdict is Verdict.UNDECIDED
    assert "asks for |x_i - x_j| <= 2 " in certificate.reason
