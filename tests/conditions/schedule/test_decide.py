"""Chains of certificates, decided: every condition has a twin that just fails, and oracles from outside."""

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
from dobc_design.exact.matrix import multiply, scale, to_float
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

F = Fraction
LESS, MORE = F(99, 100), F(101, 100)


def changed(k: int, **fields) -> Staging:
    """The chain with some fields of stage k (from 0) replaced; functions are applied to the old value."""
    stage = chain().stages[k]
    values = {name: value(getattr(stage, name)) if callable(value) else value for name, value in fields.items()}
    stages = (*chain().stages[:k], replace(stage, **values), *chain().stages[k + 1 :])
    return replace(chain(), stages=stages)


def failure(staging: Staging) -> tuple[Verdict, int | None, str]:
    answer = verify_staging(problem(), PAPER_GAIN, staging)
    return answer.verdict, answer.stage, answer.step


def cut(staging: Staging, count: int) -> Staging:
    """The first stages alone, with a tolerance that they meet at once."""
    stages = staging.stages[:count]
    return replace(staging, stages=stages, time=stages[-1].start, tolerance=F(10**6))


def less(value: Fraction) -> Fraction:
    return value * LESS


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


@pytest.mark.parametrize("k", [1, 2, 3])
def test_a_stage_that_takes_over_a_little_too_early_is_refuted(k):
    """Where the stage before is not yet small enough for its guard, whatever level and noise it claims."""
    larger = {"level": lambda level: 2 * level, "noise": lambda noise: 2 * noise}
    at = changed(k, **larger)
    assert verify_staging(problem(), PAPER_GAIN, cut(at, k + 1)).verdict is Verdict.PROVED
    early = changed(k, start=lambda start: start - F(1, 1000), **larger)
    assert failure(cut(early, k + 1)) == (Verdict.REFUTED, k, "guard")


def test_an_earlier_time_wider_starts_and_larger_errors_are_refuted():
    last = chain().stages[-1]
    earlier = last.start + (chain().time - last.start) * LESS
    assert failure(replace(chain(), time=earlier)) == (Verdict.REFUTED, 3, "tolerance")
    assert failure(replace(chain(), radius=ASKED.radius * MORE)) == (Verdict.REFUTED, 0, "start")
    assert failure(replace(chain(), disturbance=ASKED.disturbance * MORE))[2] == "start"


@pytest.mark.parametrize(("k", "name"), [(0, "alpha"), (1, "alpha"), (2, "rate"), (3, "rate")])
def test_a_rate_one_per_cent_larger_is_refuted(k, name):
    certificate = chain().stages[k].certificate
    faster = replace(certificate, **{name: getattr(certificate, name) * MORE})
    assert failure(changed(k, certificate=faster)) == (Verdict.REFUTED, k, "certificate")


def test_a_rate_of_zero_and_kappa_at_its_limit_are_refuted():
    """Kappa beta min v = 1 lets the observer error raise V."""
    stopped = replace(chain().stages[2].certificate, rate=F(0))
    assert failure(changed(2, certificate=stopped)) == (Verdict.REFUTED, 2, "certificate")
    claim = chain().stages[0].certificate
    at = replace(claim, error=replace(claim.error, kappa=1 / (claim.error.beta * claim.least)))
    assert failure(changed(0, certificate=at)) == (Verdict.REFUTED, 0, "certificate")


@pytest.mark.parametrize("k", [2, 3])
def test_a_quadratic_certificate_of_another_observer_gain_is_refuted(k):
    """V' counts eps' = (A - WC) eps with the W of the pair."""
    certificate = chain().stages[k].certificate
    other = multiply(certificate.P, scale(MORE, PAPER_GAIN))
    foreign = replace(certificate, Q=other)
    assert failure(changed(k, certificate=foreign))[1:] == (k, "observer")
    blind = replace(certificate, P=None, Q=None)
    assert failure(changed(k, certificate=blind)) == (Verdict.REFUTED, k, "observer")


def test_a_diagonal_below_p_e_is_refuted():
    """The least multiple of I above P_e, and 1 % less."""
    size = problem().n
    top = eigenvalue_bound(chain().stages[2].certificate.P_e)
    enough = changed(2, diagonal=(top,) * size, level=lambda level: level * 2)
    assert verify_staging(problem(), PAPER_GAIN, cut(enough, 3)).verdict is Verdict.PROVED
    below = changed(2, diagonal=(top * LESS,) * size, level=lambda level: level * 2)
    assert failure(below) == (Verdict.REFUTED, 2, "diagonal")
    assert failure(changed(2, diagonal=(top,) * (size - 1))) == (Verdict.REFUTED, 2, "diagonal")


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


def test_the_stretch_between_two_observer_matrices_is_compared_exactly():
    """P' = 4 P needs l = 2; one part in 10^9 less is refuted."""
    before, claim = (stage.certificate for stage in chain().stages[:2])
    four = replace(before.error, P=scale(4, before.error.P), size=4 * before.error.size)
    fields = {"certificate": replace(claim, error=four), "level": F(100), "noise": F(100)}
    assert verify_staging(problem(), PAPER_GAIN, cut(changed(1, stretch=F(2), **fields), 2)).verdict is Verdict.PROVED
    assert failure(cut(changed(1, stretch=2 - F(1, 10**9), **fields), 2)) == (Verdict.REFUTED, 1, "stretch")
