"""Vectors v > 0 for large networks against SciPy's eigenvalues, and directions where there is no such vector."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import sparse

from dobc_design.conditions.consensus.propose import MOST_PRODUCTS, dominating_vector, float_lambda
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem


def ring(n, *, step=10, h="exp(y) - 1 + y", arcs=None):
    """Both neighbours are heard; every so many agents one is pinned (step 0: none)."""
    arcs = arcs or [[i, (i + k) % n or n] for i in range(1, n + 1) for k in (1, n - 1)]
    network = Network.from_arcs(arcs, arrow="listens_to", agents=n)
    return Problem(network=network, coupling=h, gains=dict.fromkeys(range(1, n + 1, step), 3) if step else None)


@pytest.mark.parametrize("step", [1, 10, 300])
def test_the_bound_is_close_to_the_least_eigenvalue_and_not_beyond(step):
    """-Lambda of a ring of 3000; the vector itself shows the bound."""
    table = float_lambda(ring(3000, step=step), "G").tocsr()
    found = dominating_vector(table)
    least = -sparse.linalg.eigsh(table.tocsc(), k=1, sigma=1e-3, return_eigenvectors=False)[0]
    assert 0.95 * least <= found.least <= least * (1 + 1e-9)
    assert (found.vector > 0).all()
    assert np.min(-(table @ found.vector) / found.vector) == pytest.approx(found.least, rel=1e-6)
    assert found.first <= found.products


def test_few_products_are_enough_where_every_tenth_agent_is_pinned():
    """design.md: 250 for the first bound."""
    found = dominating_vector(float_lambda(ring(10_000), "G"))
    assert found.first <= 250
    assert found.products <= MOST_PRODUCTS + 5


def test_one_pin_is_left_to_a_factorisation():
    """Conjugate gradients would need as many steps as half of the ring has agents."""
    found = dominating_vector(float_lambda(ring(20_000, step=20_000), "G"))
    assert 0 < found.least < 4 * np.pi**2 / 20_000**2 * 4
    assert found.products < 1000


def test_without_a_pin_there_is_a_direction_and_no_bound():
    """All agents moved together: v' Lambda v = 0."""
    table = float_lambda(ring(3000, step=0), "G").tocsr()
    found = dominating_vector(table)
    assert not found.least > 0
    v = found.vector
    assert v @ (table @ v) >= -1e-9 * (v @ v)


def test_an_agent_that_hears_nobody_and_has_no_pin_is_a_direction():
    arcs = [[i, i + 1] for i in range(1, 2500)]
    found = dominating_vector(float_lambda(ring(2501, arcs=arcs, step=2400), "G"))
    assert not found.least > 0
    assert found.vector.any()


def test_what_floats_cannot_hold_has_no_vector():
    table = sparse.csr_array(np.array([[-np.inf, 0.0], [0.0, -1.0]]))
    assert dominating_vector(table) is None
