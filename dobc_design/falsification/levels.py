"""Certified sets as functions of arrays: V scaled so that it is 1 on the boundary and decays at a known rate.

Floats, to search with: whether a certificate holds is decided in ``verify``.  Both kinds of V are positive
homogeneous of degree 1 in (e, eps), so that every start but 0 is brought to the boundary by a factor.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from dobc_design.certificate.certificate import Certificate
from dobc_design.certificate.claims import claim_of
from dobc_design.conditions.boxes.claim import Shell
from dobc_design.conditions.check import Check
from dobc_design.conditions.kinds import ids_of
from dobc_design.conditions.quadratic.claim import Lure
from dobc_design.conditions.separable.claim import Separable
from dobc_design.conditions.separable.decide import composite_rate
from dobc_design.errors import SpecError
from dobc_design.exact.matrix import Matrix, to_float
from dobc_design.problem.problem import Problem
from dobc_design.simulation._arguments import Array
from dobc_design.verdict import Verdict

if TYPE_CHECKING:
    pass

Certified = Separable | Lure | Shell | Check
EVERYWHERE = 1.0  # the level that stands for a certificate that holds everywhere
TINY = 1e-300


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BoxLevel:
    """V = max_k |e_k| / height_k + max_i |eps_i|_P, height (n m,).

    ``rate`` in 1/s: V(t) <= V(0) exp(-rate t) is certified while V <= 1.  ``P`` (q, q) is the observer's matrix, scaled
    like V; None where the certificate is about eps = 0 only.
    """

    name: str
    rate: float
    height: Array
    P: Array | None

    @property
    def lengths(self) -> Array:
        """How far the set reaches from side to side, about, by component of e: (n m,)."""
        return np.asarray(2 * self.height)

    def value(self, e: Array, eps: Array) -> Array:
        """V of states e (n m, R) and eps (n, q, R): (R,)."""
        sides = np.abs(e) / self.height[:, None]
        return np.asarray(sides.max(axis=0) + observer_norms(self.P, eps).max(axis=0, initial=0.0))

    def gradient(self, e: Array, eps: Array) -> tuple[Array, Array]:
        """A (sub)gradient of V at one state e (n m,), eps (n, q) with V > 0."""
        along, along_eps = np.zeros_like(e), np.zeros_like(eps)
        place = int(np.argmax(np.abs(e) / self.height))
        along[place] = np.sign(e[place]) / self.height[place]
        own = observer_norms(self.P, eps[:, :, None])[:, 0]
        if self.P is not None and own.max(initial=0.0) > 0:
            agent = int(np.argmax(own))
            along_eps[agent] = self.P @ eps[agent] / own[agent]
        return along, along_eps

    def directions(self, standard: Array) -> Array:
        """Errors (n m, R) that are spread over the set, from standard ones."""
        return np.asarray(standard * self.height[:, None])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ellipsoid:
    """V = root of e'P_e e + sum |eps_i|_P^2, P_e (n m, n m); ``rate`` and ``P`` as in ``BoxLevel``."""

    name: str
    rate: float
    P_e: Array
    P: Array | None

    @property
    def lengths(self) -> Array:
        return np.asarray(2 / np.sqrt(np.maximum(np.diag(self.P_e), TINY)))

    def value(self, e: Array, eps: Array) -> Array:
        squares = np.maximum(0.0, np.sum((self.P_e @ e) * e, axis=0))
        return np.asarray(np.sqrt(squares + np.sum(observer_norms(self.P, eps) ** 2, axis=0)))

    def gradient(self, e: Array, eps: Array) -> tuple[Array, Array]:
        size = float(self.value(e[:, None], eps[:, :, None])[0])
        along_eps = np.zeros_like(eps) if self.P is None else eps @ self.P / size
        return np.asarray(self.P_e @ e / size), np.asarray(along_eps)

    def directions(self, standard: Array) -> Array:
        values, vectors = np.linalg.eigh(self.P_e)
        return np.asarray(vectors @ (standard / np.sqrt(np.maximum(values, TINY))[:, None]))


Level = BoxLevel | Ellipsoid


def observer_norms(P: Array | None, eps: Array) -> Array:
    """|eps_i|_P of every agent and run, (n, R), for eps (n, q, R); 0 without a P."""
    if P is None:
        return np.zeros((eps.shape[0], eps.shape[2]))
    return np.asarray(np.sqrt(np.maximum(0.0, np.einsum("nar,ab,nbr->nr", eps, P, eps))))


def level_of(problem: Problem, certified: Certified, W: Matrix | None = None) -> Level:
    """The set of a certificate; one that holds everywhere is looked at up to N = 1, or V = 1.

    ``certified``: a claim, or a proved check of a region, which is about the gain ``W`` (q, m).
    Raises: SpecError for one that does not fit the problem.
    """
    if isinstance(certified, Check):
        certified = _claim_of(problem, certified, W)
    if isinstance(certified, Shell):
        certified = replace(certified.lure, level=certified.outer, rate=certified.rate)
    if isinstance(certified, Separable):
        if len(certified.v) != problem.n:
            raise SpecError(
                f"certified must have one v per agent ({problem.n}); got {len(certified.v)}.",
                key="certified",
                cure="Give the certificate of this very problem.",
            )
        rho = EVERYWHERE if certified.rho is None else float(certified.rho)
        P = None
        if certified.error is not None:
            P = to_float(certified.error.P) * (float(certified.error.kappa) / rho) ** 2
        height = np.repeat([float(v) for v in certified.v], problem.m) * rho
        return BoxLevel(name="max-separable", rate=float(composite_rate(certified)), height=height, P=P)
    if certified.P_e.size != problem.n * problem.m:
        raise SpecError(
            f"certified must have a P_e of {problem.n * problem.m} rows; got {certified.P_e.size}.",
            key="certified",
            cure="Give the certificate of this very problem.",
        )
    size = EVERYWHERE if certified.level is None else float(certified.level)
    P = None if certified.P is None else to_float(certified.P) / size
    P_e = to_float(certified.P_e.to_dense()) / size
    return Ellipsoid(name="lure", rate=float(certified.rate), P_e=P_e, P=P)


def _claim_of(problem: Problem, check: Check, W: Matrix | None) -> Separable | Lure | Shell:
    """What a proved check of a region claims."""
    known = ids_of("region")
    if check.verdict is not Verdict.PROVED or check.id not in known or check.claim is None:
        raise SpecError(
            f"certified must be a proved check of a region ({', '.join(known)}); got {check.verdict.value}"
            f" {check.title}.",
            key="certified",
            cure="Ask for a [region], or give certify everything=True.",
        )
    try:
        claim = claim_of(check, problem, W)
    except (KeyError, TypeError, ValueError) as error:
        raise SpecError(
            f"certified: the check {check.title} does not fit this problem ({error}).",
            key="certified",
            cure="Give the certificate of this very problem.",
        ) from error
    if not isinstance(claim, Separable | Lure | Shell):
        raise SpecError(f"certified: the check {check.title} names no set of starts.", key="certified")
    return claim


def regional_check(certificate: Certificate) -> Check | None:
    """The proved check of a region that covers what is asked, else the first one; None without one."""
    proved = [check for check in certificate.checks if check.verdict is Verdict.PROVED and check.kind.role == "region"]
    first = proved[0] if proved else None
    return next((check for check in proved if check.id == certificate.claims.covered_by), first)


def needed_check(certificate: Certificate) -> Check:
    """The same.  Raises: SpecError without one."""
    found = regional_check(certificate)
    if found is None:
        raise SpecError(
            "certified must hold a proved check of a region; this certificate has none.",
            key="certified",
            cure="Ask for a [region], or give certify everything=True.",
        )
    return found
