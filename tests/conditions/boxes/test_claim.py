"""Bounds of V' on boxes: never below what is found at points of the box."""

from fractions import Fraction
from random import Random

import numpy as np
import pytest
from lure_cases import PAPER, cycle, field, identity, random_problem

from dobc_design.conditions.boxes.decide import Boxes, Shell, build_forms, energy_bounds, upper_bounds
from dobc_design.conditions.quadratic.claim import Lure
from dobc_design.errors import SpecError
from dobc_design.exact.matrix import to_float
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.problem.problem import Problem

ONE = Fraction(1)


def plain(size: int, metric: SparseSymmetric | None = None, **changes) -> Lure:
    """A certificate's noun; nothing here depends on whether it holds."""
    given = {"P_e": metric or identity(size), "ranges": (), "radius": ONE, "level": ONE, "multipliers": {}}
    return Lure(**(given | changes))


def metric_of(size: int, seed: int) -> SparseSymmetric:
    r = Random(seed)
    rows = [[r.randint(-2, 2) for _ in range(size)] for _ in range(size)]
    full = (np.array(rows) @ np.array(rows).T + np.eye(size, dtype=int)).tolist()
    return SparseSymmetric.from_dense(tuple(tuple(Fraction(x) for x in row) for row in full))


def boxes_of(rng: np.random.Generator, size: int, width: float, count: int = 40) -> Boxes:
    centres = np.round(rng.uniform(-2, 2, (count, size)) * 64) / 64
    return Boxes(centres=centres, halves=np.round(rng.uniform(0.2, 1, (count, size)) * width * 1024) / 1024)


@pytest.mark.parametrize("width", [1.0, 0.1])
@pytest.mark.parametrize(("seed", "text"), [*enumerate((PAPER, "y - y**3", "sin(3*y)", "clip(y, -1, 1)", "2*y"))])
def test_the_derivative_of_v_is_never_above_its_bound(seed, text, width):
    """2 e'P_e (h(e) - K e) + 2 beta e'P_e e + (9/8) |P_e e|^2 at 200 points of each box, from the couplings alone."""
    problem = random_problem(seed, coupling=text)
    size = problem.n
    metric, S, beta = metric_of(size, seed), ((Fraction(9, 8),),), Fraction(1, 5)
    form = build_forms(problem, plain(size, metric), S=S, rate=beta)["G0"]
    rng = np.random.default_rng(seed)
    boxes = boxes_of(rng, size, width)
    bound, terms, spread = upper_bounds(form, boxes)
    points = boxes.centres + boxes.halves * rng.uniform(-1, 1, (200, *boxes.centres.shape))
    P = to_float(metric.to_dense())
    Pe = points @ P
    value = 2 * np.sum(Pe * field(problem, "G0", points), axis=-1) + 0.4 * np.sum(Pe * points, axis=-1)
    value += 9 / 8 * np.sum(Pe * Pe, axis=-1)
    assert np.all(np.max(value, axis=0) <= bound + 1e-9 * terms)
    assert np.all(spread >= 0)
    if width == 0.1:  # and it is not far above
        assert np.median(bound - np.max(value, axis=0)) < 0.2 * np.median(terms)


def test_the_bound_at_a_point_is_the_value_up_to_rounding():
    problem = cycle(3, 3)
    form = build_forms(problem, plain(3), S=None, rate=Fraction(0))["G"]
    centres = np.array([[0.5, -1.25, 2.0], [0.0, 0.0, 0.0]])
    bound, terms, _ = upper_bounds(form, Boxes(centres=centres, halves=np.zeros((2, 3))))
    value = 2 * np.sum(centres * field(problem, "G", centres), axis=-1)
    assert np.all(bound >= value)
    assert np.allclose(bound, value, atol=1e-12 * float(np.max(terms)))


@pytest.mark.parametrize("seed", range(4))
def test_the_energy_of_a_box_lies_between_its_bounds(seed):
    rng = np.random.default_rng(seed)
    metric = metric_of(3, seed) if seed % 2 else SparseSymmetric(3, {(i, i): Fraction(i + 1, 3) for i in range(3)})
    P, boxes = to_float(metric.to_dense()), boxes_of(rng, 3, 0.5)
    points = boxes.centres + boxes.halves * rng.uniform(-1, 1, (500, *boxes.centres.shape))
    values = np.sum((points @ P) * points, axis=-1)
    least, most = energy_bounds(P, boxes)
    assert np.all(least <= np.min(values, axis=0))
    assert np.all(np.max(values, axis=0) <= most)
    corner = np.abs(boxes.centres) + boxes.halves
    assert np.all(most <= 3 * np.sum((corner @ np.abs(P)) * corner, axis=1))


def test_where_a_coupling_is_not_defined_the_bound_is_infinite():
    problem = cycle(2, 3, coupling="log(1 + y)")
    form = build_forms(problem, plain(2), S=None, rate=Fraction(0))["G"]
    for half, defined in ((2.0, False), (0.125, True)):
        bound = upper_bounds(form, Boxes(centres=np.zeros((1, 2)), halves=np.full((1, 2), half)))[0]
        assert np.isfinite(bound[0]) == defined


@pytest.mark.parametrize("centre", [(-1, -3), (-3, -1), (1, 3), (3, 1)])
def test_nothing_is_shown_where_a_coupling_is_not_defined_whatever_its_sign(centre):
    """log(1 + y) at y = -2, times an error of either sign."""
    form = build_forms(cycle(2, 3, coupling="log(1 + y)"), plain(2), S=None, rate=Fraction(0))["G"]
    boxes = Boxes(centres=np.array([centre], dtype=float), halves=np.full((1, 2), 0.125))
    assert not np.any(upper_bounds(form, boxes)[0] < 0)


def test_only_small_networks_and_couplings_by_component_are_taken():
    with pytest.raises(SpecError, match="at most 6 rows n m; got 7"):
        build_forms(cycle(7, 3), plain(7), S=None, rate=Fraction(0))
    vectors = Problem(network=cycle(2, 3).network, coupling=["y1 + y2", "y2"], gains=3, target=[0, 0])
    with pytest.raises(SpecError, match="act by component"):
        build_forms(vectors, plain(4), S=None, rate=Fraction(0))


def test_one_number_out_of_the_range_of_floats_among_others_is_refused():
    problem = Problem(network=cycle(2, 3).network, coupling="y", gains={1: 3, 2: "1e-150"}, target=0)
    with pytest.raises(SpecError, match="between 1e-100 and 1e100"):
        build_forms(problem, plain(2), S=None, rate=Fraction(0))


@pytest.mark.parametrize("change", [{"outer": Fraction(1, 2)}, {"half": Fraction(0)}])
def test_what_cannot_be_a_claim_is_refused(change):
    given = {"lure": plain(2), "outer": Fraction(2), "half": Fraction(2), "tree": "."}
    with pytest.raises(SpecError, match="outer must be"):
        Shell(**(given | change))
