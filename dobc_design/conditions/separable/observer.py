"""The max-separable certificate with the observer: V = N + kappa E, the starts it covers, and its rate; exact.

Theory, section 5: with (A-WC)'P + P(A-WC) <= -2 beta P and c'c <= P for each row c of C, |C eps_i| <= E := max_i
sqrt(eps_i' P eps_i) and D+ E <= -beta E.  With kappa > 1/(beta min v) the set {N + kappa E <= rho} is invariant and
attracted.  Where agents have different exosystems, all this is about the joint one: an agent's eps_i
stays in the coordinates of its own group, and the rows of C are those of all groups.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fractions import Fraction

from dobc_design.conditions.separable.claim import ErrorBound, Separable
from dobc_design.conditions.separable.decide import SeparableAnswer, largest_rate, verify_separable
from dobc_design.errors import SpecError
from dobc_design.exact.definite import decide_positive_definite, decide_positive_semidefinite
from dobc_design.exact.matrix import (
    Matrix,
    Vector,
    add,
    identity,
    is_symmetric,
    multiply,
    scale,
    shape,
    subtract,
    transpose,
)
from dobc_design.exact.number import root_above
from dobc_design.exact.symmetric import Doubles
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

_DECIMALS = 10**12
_NEARLY = 0.997  # of the rate that floating point sees


def verify_composite(
    problem: Problem, W: Matrix | None, claim: Separable, *, modes: Sequence[str] | None = None
) -> SeparableAnswer:
    """Decide a whole certificate: its rows and, with an exosystem, the observer's part for the gain W (q, m).

    PROVED: V = N + kappa E (V = N without an exosystem) decays at least at ``composite_rate`` from every start with
    V <= rho, for arbitrary switching among the modes.
    """
    exosystem = problem.joint_exosystem
    if exosystem is not None:
        if W is None or claim.error is None:
            return SeparableAnswer(
                verdict=Verdict.UNDECIDED,
                reason="with an [exosystem] the certificate needs an observer gain W and P, beta and kappa.",
            )
        obstacle = error_bound_obstacle(exosystem, W, claim.error) or _kappa_obstacle(claim)
        if obstacle is not None:
            return SeparableAnswer(verdict=Verdict.REFUTED, reason=obstacle)
    return verify_separable(problem, claim, modes=modes)


def first_certificate(
    problem: Problem,
    W: Matrix | None,
    vectors: Iterable[Vector | Doubles],
    *,
    rho: Fraction | None,
    error: ErrorBound | None,
    wanted: float,
    modes: Sequence[str] | None = None,
) -> Separable | None:
    """The first of the proposed v that is proved with nearly the ``wanted`` rate (1/s), else the best one proved.

    Every answer is PROVED by ``verify_composite``; None if no v is.
    """
    best: Separable | None = None
    for v in vectors:
        alpha = largest_rate(problem, v, rho=rho, modes=modes)
        if alpha is None or (best is not None and alpha <= best.alpha):
            continue
        claim = Separable(v=v, alpha=alpha, rho=rho, error=error)
        if verify_composite(problem, W, claim, modes=modes).verdict is Verdict.PROVED:
            best = claim
            if alpha >= wanted * _NEARLY:
                break
    return best


def error_bound_obstacle(exosystem: Exosystem, W: Matrix, error: ErrorBound) -> str | None:
    """Why ``error`` does not hold for W, in words; None if it is proved.  Exact: there is no third answer."""
    P, q = error.P, exosystem.order
    if shape(P) != (q, q) or not is_symmetric(P):
        return f"P must be a symmetric {q}x{q} matrix."
    if decide_positive_definite(P).verdict is not Verdict.PROVED:
        return "P is not positive definite."
    E = subtract(exosystem.A, multiply(W, exosystem.C))
    decay = add(add(multiply(transpose(E), P), multiply(P, E)), scale(2 * error.beta, P))
    if not _is_semidefinite(scale(-1, decay)):
        return f"the observer error does not decay at the rate beta = {float(error.beta):.6g} in the norm of P."
    for number, c in enumerate(exosystem.C):
        if not _is_semidefinite(subtract(P, tuple(tuple(x * y for y in c) for x in c))):
            return f"P does not bound row {number + 1} of C: c'c <= P fails."
    if not _is_semidefinite(subtract(scale(error.size, identity(q)), P)):
        return f"P exceeds {float(error.size):.6g} times the identity."
    return None


def composite_rate(claim: Separable) -> Fraction:
    """The rate of V = N + kappa E: min(alpha, beta - 1/(kappa min v)); alpha without an observer.

    Positive whenever ``verify_composite`` is proved.
    """
    if claim.error is None:
        return claim.alpha
    return min(claim.alpha, claim.error.beta - 1 / (claim.error.kappa * claim.least))


def covers(claim: Separable, *, radius: Fraction, disturbance: Fraction) -> bool:
    """Whether every start with |e|_inf <= radius and |eps_i| <= disturbance lies in {V <= rho}; exact.

    radius/min v + kappa disturbance sqrt(size) <= rho, decided by squares.
    Raises: SpecError for a negative radius or disturbance.
    """
    if radius < 0 or disturbance < 0:
        raise SpecError("radius and disturbance must be >= 0.", key="radius" if radius < 0 else "disturbance")
    if claim.rho is None:
        return True
    room = claim.rho - radius / claim.least
    if claim.error is None:
        return room >= 0
    return room >= 0 and (claim.error.kappa * disturbance) ** 2 * claim.error.size <= room**2


def covered_radius(claim: Separable, *, disturbance: Fraction) -> Fraction | None:
    """A radius that is covered together with the disturbance, at most 1e-12 below the largest; None if there is none.

    Only for a finite rho: without one every radius is covered.
    Raises: SpecError if rho is None, or for a negative disturbance.
    """
    if claim.rho is None:
        raise SpecError("a certificate without a radius covers every start.", key="rho")
    taken = Fraction(0)
    if claim.error is not None:
        square = (claim.error.kappa * disturbance) ** 2 * claim.error.size
        taken = root_above(square, unit=_DECIMALS)
    room = claim.rho - taken
    radius = room * claim.least
    return radius if radius >= 0 and covers(claim, radius=radius, disturbance=disturbance) else None


def _kappa_obstacle(claim: Separable) -> str | None:
    error = claim.error
    if error is None or (error.beta > 0 and error.kappa * error.beta * claim.least > 1):
        return None
    return "kappa must exceed 1/(beta min v), or the observer error can raise V."


def _is_semidefinite(M: Matrix) -> bool:
    return decide_positive_semidefinite(M).verdict is Verdict.PROVED
