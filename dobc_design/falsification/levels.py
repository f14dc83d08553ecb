"""Certified sets of starts: what their boundaries are in floats, and starts on them.

Every V is positive homogeneous of degree 1 in e (n m, R) and eps (n, q, R), so that a factor brings
every start but 0 to the boundary of a certified set.
"""

import numpy as np
from numpy.random import Generator
from scipy.sparse import dia_array, diags_array

from dobc_design._checks import noun
from dobc_design.certificate.certificate import Certificate
from dobc_design.certificate.claims import claim_of
from dobc_design.conditions.arcs.claim import ArcWise
from dobc_design.conditions.check import Check
from dobc_design.conditions.kinds import ids_of
from dobc_design.conditions.quadratic.claim import Quadratic
from dobc_design.conditions.separable.claim import Separable
from dobc_design.conditions.separable.decide import composite_rate
from dobc_design.errors import refused, wrong
from dobc_design.exact.matrix import Array, Matrix, to_float
from dobc_design.loop.make import loop_of
from dobc_design.problem.problem import Problem
from dobc_design.simulation.field import ClosedLoop
from dobc_design.simulation.starts import RANDOM, TINY, Box, Pair, sphere, unit_cube

Certified = Separable | Quadratic | Check

EVERYWHERE = 1.0  # the level that stands for a certificate that holds everywhere
OTHER_PROBLEM = "Give the certificate of this very problem."


@noun(eq=False)
class BoxLevel:
    """V = max_k |e_k| / height_k + max_i |eps_i|_P, height (n m,), scaled so that it is 1 on the
    boundary.  ``rate`` in 1/s: V(t) <= V(0) exp(-rate t) is certified while V <= 1.  ``P`` (q, q)
    is the observer's matrix, scaled like V; None where the certificate is about eps = 0 only.  With
    ``T`` (m, m) it is T e_i that the heights belong to."""

    name: str
    rate: float
    height: Array
    P: Array | None
    T: Array | None = None

    def value(self, e: Array, eps: Array) -> Array:
        """V of states e (n m, R) and eps (n, q, R): (R,)."""
        sides = np.abs(turned(self.T, e)) / self.height[:, None]
        return np.asarray(sides.max(axis=0) + observer_norms(self.P, eps).max(axis=0, initial=0.0))

    def directions(self, standard: Array) -> Array:
        """Errors (n m, R) that are spread over the set, from standard ones."""
        back = None if self.T is None else inverse(self.T)
        return turned(back, standard * self.height[:, None])


def inverse(T: Array) -> Array:
    """T^-1."""
    return np.asarray(np.linalg.inv(T), dtype=float)


def turned(T: Array | None, e: Array) -> Array:
    """T e_i of every agent, for e (n m,) or (n m, R); e itself without T."""
    if T is None:
        return e
    by_agent = e.reshape(-1, len(T), e[0].size)
    return (T @ by_agent).reshape(e.shape)


@noun(eq=False)
class Ellipsoid:
    """V = root of e'P_e e + sum |eps_i|_P^2, P_e (n m, n m), sparse for arc-wise
    claims; everything else as in ``BoxLevel``."""

    name: str
    rate: float
    P_e: Array | dia_array
    P: Array | None

    @property
    def lengths(self) -> Array:
        """How far the set reaches, (n m,)."""
        return np.asarray(2 / np.sqrt(np.maximum(self.P_e.diagonal(), TINY)))

    def value(self, e: Array, eps: Array) -> Array:
        """V of states, (R,)."""
        # rounding may take a square below 0
        squares = np.maximum(0.0, np.sum((self.P_e @ e) * e, axis=0))
        of_observers = np.sum(observer_norms(self.P, eps) ** 2, axis=0)
        return np.asarray(np.sqrt(squares + of_observers))

    def directions(self, standard: Array) -> Array:
        """Errors that are spread over the set."""
        if not isinstance(self.P_e, np.ndarray):
            return standard * self.lengths[:, None]
        # the axes of the ellipsoid, and how long they are
        values, vectors = np.linalg.eigh(self.P_e)
        lengths = np.sqrt(np.maximum(values, TINY))
        return np.asarray(vectors @ (standard / lengths[:, None]))


Level = BoxLevel | Ellipsoid


def observer_norms(P: Array | None, eps: Array) -> Array:
    """|eps_i|_P of every agent and run, (n, R), for eps (n, q, R); 0 without a P."""
    if P is None:
        return np.zeros((eps.shape[0], eps.shape[2]))
    squares = np.einsum("nar,ab,nbr->nr", eps, P, eps)
    return np.asarray(np.sqrt(np.maximum(0.0, squares)))


def level_of(problem: Problem, certified: Certified, W: Matrix | None = None) -> Level:
    """The set of a claim, or of a proved check about ``W``; up to V = 1 if it holds everywhere.
    Raises: SpecError."""
    # scaled so that V = 1 is the boundary, whatever the claim says
    if isinstance(certified, Check):
        certified = _claim_of(problem, certified, W)
    if isinstance(certified, Separable):
        return _box_level(problem, certified)
    return _ellipsoid(problem, certified)


def _box_level(problem: Problem, claim: Separable) -> BoxLevel:
    """The set of a max-separable claim."""
    T = None if claim.T is None else to_float(claim.T)
    count = problem.n * (1 if T is None else len(T))
    if len(claim.v) != count:
        message = f"must have {count} weights v for this problem; got {len(claim.v)}."
        raise wrong("certified", message, OTHER_PROBLEM)
    # what holds everywhere has no boundary: any level stands for it
    rho = EVERYWHERE if claim.rho is None else float(claim.rho)
    P = None
    if claim.error is not None:
        P = to_float(claim.error.P) * (float(claim.error.kappa) / rho) ** 2
    # without T a weight is of an agent, for all of its components
    weights = np.repeat([float(v) for v in claim.v], problem.m if T is None else 1)
    rate = float(composite_rate(claim))
    return BoxLevel(name="max-separable", rate=rate, height=weights * rho, P=P, T=T)


def _ellipsoid(problem: Problem, claim: Quadratic) -> Ellipsoid:
    """The set of a claim about V = e'P_e e."""
    rows = problem.n * problem.m
    if claim.P_e.size != rows:
        message = f"must have a P_e of {rows} rows; got {claim.P_e.size}."
        raise wrong("certified", message, OTHER_PROBLEM)
    size = EVERYWHERE if claim.level is None else float(claim.level)
    P = None if claim.P is None else to_float(claim.P) / size
    if isinstance(claim, ArcWise):  # of which there may be very many rows
        P_e = diags_array([float(x) / size for x in claim.P_e.diagonal()])
        return Ellipsoid(name="arc-wise", rate=float(claim.rate), P_e=P_e, P=P)
    P_e = to_float(claim.P_e.to_dense()) / size
    return Ellipsoid(name="lure", rate=float(claim.rate), P_e=P_e, P=P)


def _claim_of(problem: Problem, check: Check, W: Matrix | None) -> Separable | Quadratic:
    """What a proved check of a region claims."""
    known = ids_of("region")
    if not check.is_proved or check.id not in known or check.claim is None:
        got = f"{check.verdict.value} {check.title}"
        message = f"must be a proved check of a region ({', '.join(known)}); got {got}."
        raise wrong("certified", message, "Ask for a [region], or give certify everything=True.")
    try:
        claim = claim_of(check, loop_of(problem), W)
    except (KeyError, TypeError, ValueError) as error:
        message = f"certified: the check {check.title} does not fit this problem ({error})."
        raise refused("certified", message, OTHER_PROBLEM) from error
    if not isinstance(claim, Separable | Quadratic):
        message = f"certified: the check {check.title} names no set of starts."
        raise refused("certified", message)
    return claim


def regional_check(certificate: Certificate) -> Check | None:
    """The proved check of a region that covers what is asked, else the first one; None without
    one.  One whose sets move with time is none."""
    proved = []
    for check in certificate.checks:
        regional = check.kind.role == "region" and check.kind.signals == "every"
        if regional and check.is_proved:
            proved.append(check)
    # the verdict rests on this one
    for check in proved:
        if check.id == certificate.claims.covered_by:
            return check
    return proved[0] if proved else None


@noun(eq=False)
class Boundary:
    """V = 1 for a certified set; a third of the starts has eps = 0.  Everything as in ``Box``."""

    level: Level
    loop: ClosedLoop

    @property
    def words(self) -> str:
        """What was searched."""
        return f"the boundary of the {self.level.name} set"

    @property
    def has_disturbance(self) -> bool:
        """Whether starts have eps != 0."""
        return self.level.P is not None

    def draw(self, rng: Generator, count: int, kind: str) -> Pair:
        """Starts of one kind."""
        loop = self.loop
        level = self.level
        rows = loop.size
        if kind == RANDOM:
            part = rng.standard_normal((rows, count))
        else:
            part = unit_cube(rng, rows, count, kind)
        e = level.directions(part)
        eps = sphere(rng, loop.owned, count) * rng.random((loop.n, 1, count))
        sizes = level.value(e, 0 * eps)
        sizes_eps = level.value(0 * e, eps)
        # the part of V that is eps
        share = rng.random(count) * (rng.random(count) < 2 / 3)
        if level.P is None:
            share = np.zeros(count)
            eps = 0 * eps
        e = e * ((1 - share) / np.maximum(sizes, TINY))
        eps = eps * (share / np.maximum(sizes_eps, TINY))
        # V grows along every ray in proportion to the distance
        size = np.maximum(level.value(e, eps), TINY)
        return e / size, eps / size

    def holds(self, e: Array) -> bool:
        """Whether e (n m,) with eps = 0 is in the set, but for rounding."""
        known = np.zeros((self.loop.n, self.loop.q, 1))
        return bool(self.level.value(e[:, None], known)[0] <= 1 + 1e-9)


StartSet = Box | Boundary
