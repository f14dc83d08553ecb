"""Chains of certificates, decided: the step at which a twin fails, and oracles from outside.

More twins of every condition are among ``quadratic_cases``, which both programs decide.
"""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from lure_cases import PAPER_GAIN
from staging_cases import ASKED, chain, problem
from staging_cases import settling as shown

from dobc_design.conditions.quadratic.decide import eigenvalue_bound
from dobc_design.conditions.schedule.claim import Stage, Staging
from dobc_design.conditions.schedule.decide import decayed, next_level, stage_rate, verify_staging
from dobc_design.conditions.separable.claim import Separable
from dobc_design.errors import SpecError
from dobc_design.exact.matrix import multiply, scale, to_float
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

F = Fraction
LESS, MORE = F(99, 100), F(101, 100)
less = LESS.__mul__


def changed(k: int, **fields) -> Staging:
    """The chain with some fields of stage k (from 0) replaced; functions are applied to the old value."""
    stage = chain().stages[k]
    values = {name: value(getattr(stage, name)) if callable(value) else value for name, value in fields.items()}
    stages = (*chain().stages[:k], replace(stage, **values), *chain().stages[k + 1 :])
    return replace(chain(), stages=stages)


def failure(staging: Staging) -> tuple[Verdict, int | None, str]:
    answer = verify_staging(problem(), PAPER_GAIN, staging)
    return answer.verdict, answer.stage, answer.step


def test_the_chain_with_every_kind_of_hand_over_is_proved():
    """Theory, section 5, Staging."""
    assert verify_staging(problem(), PAPER_GAIN, chain()).verdict is Verdict.PROVED
    assert [stage.is_quadratic for stage in chain().stages] == [False, False, True, True]
    assert all(stage.stretch != 1 for stage in chain().stages[1:3])


@pytest.mark.parametrize(
    ("k", "fields", "step"),
    [
        (0, {"level": less}, "start"),
        (0, {"level": lambda level: F(3) * MORE}, "guard"),
        (0, {"noise": less}, "noise"),
        *((k, {"height": less}, "height") for k in range(4)),
        *((k, {"level": less}, "level") for k in (1, 2, 3)),
        *((k, {"noise": less}, "noise") for k in (1, 2, 3)),
        *((k, {"stretch": less}, "stretch") for k in (1, 2)),
        (3, {"factor": less}, "factor"),
    ],
)
def test_one_per_cent_less_is_refuted_at_its_own_step(k, fields, step):
    assert failure(changed(k, **fields)) == (Verdict.REFUTED, k, step)


@pytest.mark.parametrize("k", [2, 3])
def test_a_quadratic_certificate_of_another_observer_gain_is_refuted(k):
    """V' counts eps' = (A - WC) eps with the W of the pair."""
    certificate = chain().stages[k].certificate
    other = multiply(certificate.P, scale(MORE, PAPER_GAIN))
    foreign = replace(certificate, Q=other)
    assert failure(changed(k, certificate=foreign))[1:] == (k, "observer")
    blind = replace(certificate, P=None, Q=None)
    assert failure(changed(k, certificate=blind)) == (Verdict.REFUTED, k, "observer")


def test_a_diagonal_has_one_entry_per_row():
    short = chain().stages[2].diagonal[1:]
    assert failure(changed(2, diagonal=short)) == (Verdict.REFUTED, 2, "diagonal")


def one_stage(time: Fraction, **fields) -> tuple[Problem, Staging]:
    """Two equal agents that settle like exp(-2 t), by one certificate; |e| <= 1/100 from ``time`` on."""
    pair = Problem(network=Network.from_arcs([[2, 1]], arrow="listens_to", agents=2), coupling="y", gains={1: 2, 2: 2})
    claim = Separable(v=(F(1), F(1)), alpha=F(2), rho=None)
    stage = Stage(certificate=claim, start=F(0), level=F(1), height=F(1), **fields)
    return pair, Staging(stages=(stage,), radius=F(1), disturbance=F(0), tolerance=F(1, 100), time=time)


def test_a_single_stage_settles_at_the_logarithm_of_closed_form():
    """e' = -2 e exactly for two equal agents: |e| <= tol from ln(1/tol)/2 on, and not a thousandth before."""
    for time, verdict in ((math.log(100) / 2 + 1e-9, Verdict.PROVED), (math.log(100) / 2 - 1e-9, Verdict.REFUTED)):
        pair, staging = one_stage(F(time))
        assert verify_staging(pair, None, staging).verdict is verdict
    pair, noisy = one_stage(F(231, 100), noise=F(1))  # there is no exosystem
    assert verify_staging(pair, None, noisy).step == "observer"


def quadratic_first(**fields) -> Staging:
    """The last certificate of the chain alone, from starts that just fit; ``fields`` of the stage replaced."""
    last, radius, s = chain().stages[-1], F(1, 100), F(1, 1000)
    lure = last.certificate
    top, even = eigenvalue_bound(SparseSymmetric.from_dense(lure.P)), eigenvalue_bound(lure.P_e)
    level = (problem().n * (even * radius**2 + top * s**2)) ** 0.5
    values = {
        "start": F(0),
        "level": F(f"{level * (1 + 1e-9):.12g}"),
        "factor": None,
        "stretch": F(1),
        "diagonal": (even,) * problem().n,
        "noise": F(f"{float(top) ** 0.5 * float(s) * (1 + 1e-9):.12g}"),
        "certificate": replace(lure, level=F(f"{level**2 * (1 + 1e-6):.12g}")),
    }
    stage = replace(last, **(values | fields))
    return Staging(stages=(stage,), radius=radius, disturbance=s, tolerance=F(1, 1000), time=F(30))


def test_a_quadratic_certificate_may_begin_where_its_ellipsoid_holds_the_box():
    """Sum D_i R^2 + n lambda_max(P) s^2 <= level^2 <= the level of the certificate."""
    assert verify_staging(problem(), PAPER_GAIN, quadratic_first()).verdict is Verdict.PROVED
    stage = quadratic_first().stages[0]
    twins = {"level": stage.level * LESS}, {"noise": stage.noise * LESS}, {"level": stage.level * MORE}
    for fields, step in zip(twins, ("start", "noise", "guard"), strict=True):
        assert failure(quadratic_first(**fields)) == (Verdict.REFUTED, 0, step)
    assert failure(replace(quadratic_first(), radius=F(102, 10000))) == (Verdict.REFUTED, 0, "start")


def sizes(stage: Stage, e: np.ndarray, eps: np.ndarray) -> np.ndarray:
    """W of many (e, eps) at once, from its definition; e (R, n), eps (R, n, q)."""
    certificate = stage.certificate
    if isinstance(certificate, Separable):
        P = to_float(certificate.error.P)
        N = np.max(np.abs(e) / np.array([float(x) for x in certificate.v]), axis=1)
        E = np.sqrt(np.max(np.einsum("rij,jk,rik->ri", eps, P, eps), axis=1))
        return N + float(certificate.error.kappa) * E
    P_e, P = to_float(certificate.P_e.to_dense()), to_float(certificate.P)
    return np.sqrt(np.einsum("ri,ij,rj->r", e, P_e, e) + np.einsum("rij,jk,rik->r", eps, P, eps))


@pytest.mark.parametrize("k", [1, 2, 3])
def test_no_point_handed_over_is_larger_than_the_level_and_some_come_near(k):
    """Random points with W <= c and E <= noise at the hand-over, from the definitions of both sizes."""
    rng = np.random.default_rng(k)
    before, after = chain().stages[k - 1], chain().stages[k]
    c = float(decayed(before, after.start).lo)
    n, runs = problem().n, 20_000
    e = rng.standard_normal((runs, n)) if before.is_quadratic else rng.choice([-1.0, 1.0], (runs, n))
    if not before.is_quadratic:
        e *= np.array([float(x) for x in before.certificate.v])
    eps = 1e-9 * rng.standard_normal((runs, n, 2))
    scales = c / sizes(before, e, eps)
    e, eps = e * scales[:, None], eps * scales[:, None, None]
    found = sizes(after, e, eps)
    assert np.max(found) <= float(after.level) * (1 + 1e-9)
    assert np.max(found) >= (0.97 if before.is_quadratic is after.is_quadratic else 0.8) * float(after.level)


def test_the_error_of_the_observer_is_counted_where_two_max_separable_sizes_meet():
    """N + kappa E <= c and E <= d: the largest N' + kappa' E' is found on a grid as well."""
    before, after = chain().stages[:2]
    early = replace(after, start=F(1, 100))  # while the observer error is still large
    least = float(next_level(problem(), before, early).hi)
    c = float(decayed(before, early.start).hi)
    g = max(float(a / b) for a, b in zip(before.certificate.v, after.certificate.v, strict=True))
    old, new = float(before.certificate.error.kappa), float(after.certificate.error.kappa)
    d = float(before.noise) * math.exp(-float(before.certificate.error.beta) / 100)
    x = np.linspace(0, min(d, c / old), 1001)
    best = np.max(g * (c - old * x) + new * float(after.stretch) * x)
    assert least == pytest.approx(best, rel=1e-9)
    assert least > g * c * 1.01


def test_the_envelope_never_rises_and_meets_its_bounds_from_above():
    settling = shown()
    times, bounds = settling.curve(until=2 * settling.time, samples=301)
    assert np.all(np.diff(bounds) <= 0)
    assert settling.envelope(settling.time) <= float(ASKED.tolerance)
    assert settling.envelope(0.0) >= float(ASKED.radius)
    truth = np.full(len(times), np.inf)
    for stage in chain().stages:
        t = times - float(stage.start)
        value = float(stage.level * stage.height) * np.exp(-float(stage_rate(stage.certificate)) * t)
        truth = np.where(t >= 0, np.minimum(truth, value), truth)
    assert np.allclose(bounds, truth, rtol=1e-12)


NEGATIVE = [(0, {name: F(-1)}, f"{name} of a stage must be >= 0") for name in ("start", "noise")]
ZERO = [
    (k, {name: F(0)}, f"{name} of a stage") for k, name in ((0, "level"), (0, "height"), (1, "stretch"), (3, "factor"))
]
EITHER = ((3, {"factor": None}), (2, {"diagonal": None}), (2, {"factor": F(1)}), (0, {"diagonal": (F(1),) * 3}))


@pytest.mark.parametrize(
    ("k", "fields", "message"), [*NEGATIVE, *ZERO, *((*each, "either a diagonal or a factor") for each in EITHER)]
)
def test_a_stage_that_cannot_be_is_refused(k, fields, message):
    with pytest.raises(SpecError, match=message):
        replace(chain().stages[k], **fields)


def test_a_chain_that_cannot_be_is_refused():
    first, second, third, fourth = chain().stages
    for stages, message in (
        ((), "at least one"),
        ((second,), "must start at 0"),
        ((first, third, second), "in the order|may follow"),
        ((first, fourth), "factor belongs"),
        ((replace(fourth, start=F(0)),), "follows no other"),
        ((first, replace(second, start=third.start), replace(third, start=second.start)), "in the order"),
        ((first, third, replace(second, start=third.start)), "no max-separable stage may follow"),
    ):
        with pytest.raises(SpecError, match=message):
            replace(chain(), stages=stages)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"radius": F(0)}, "radius must be > 0"),
        ({"tolerance": F(0)}, "tolerance must be > 0"),
        ({"disturbance": F(-1)}, "disturbance must be >= 0"),
        ({"time": F(0)}, "time must not lie before"),
    ],
)
def test_numbers_of_a_chain_that_cannot_be_are_refused(fields, message):
    with pytest.raises(SpecError, match=message):
        replace(chain(), **fields)
