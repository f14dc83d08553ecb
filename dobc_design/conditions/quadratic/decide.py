"""Decides the certificates of ``claim``: ranges of the gains, inequality, region, covered starts.

Every step is exact.  "Refuted" is about the certificate at hand, with a witness where a matrix fails; it never says
that consensus fails.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from dobc_design.conditions.consensus.claim import Pair
from dobc_design.conditions.consensus.decide import schur_block
from dobc_design.conditions.numbers import claimed, shorten
from dobc_design.conditions.quadratic.claim import Lure, interval_matrix, lure_matrix, vertex_matrices
from dobc_design.conditions.quadratic.sectors import Enclose, Sectors, build_sectors, gains_on, relied_differences
from dobc_design.errors import ShapeError
from dobc_design.exact import Definiteness
from dobc_design.exact.definite import decide_positive_definite, decide_positive_semidefinite
from dobc_design.exact.interval import UndefinedError
from dobc_design.exact.matrix import Matrix, Vector, inverse, to_float
from dobc_design.exact.number import float_below
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

ZERO = Fraction(0)
# How far above its estimate a bound on an eigenvalue is tried, relative to the largest one.
RISE = (Fraction(1, 10**9), Fraction(1, 10**6), Fraction(1, 1000), Fraction(1))


@dataclass(frozen=True, slots=True, kw_only=True)
class LureDecision:
    """The verdict on a certificate and, unless proved, the ``step`` that fails.

    Steps: "gains", "P_e", "observer", "inequality", "region".  ``witness``: a direction in which the matrix of the
    step is not definite (of P_e, of the inequality of ``mode``); None where the step is not about a matrix.
    """

    verdict: Verdict
    step: str = ""
    mode: str | None = None
    witness: Vector | None = None
    reason: str


def verify_lure(problem: Problem, lure: Lure, *, enclose: Enclose = gains_on) -> LureDecision:
    """Decide whether the certificate proves what it claims, for every mode of the problem.

    Proved: {V <= level} is invariant and V' <= -2 rate V in it, for every switching among the modes.
    ``enclose``: where the ranges of the gains are looked up; they have to contain its answer.
    Raises: ShapeError or SpecError for a certificate that does not fit the problem.
    Source: theory, section 4.
    """
    if lure.P_e.size != problem.n * problem.m:
        raise ShapeError(
            f"P_e must have {problem.n * problem.m} rows, one per component of e; got {lure.P_e.size}.", key="P_e"
        )
    sectors = build_sectors(problem, lure.ranges, radius=lure.radius)
    for decision in _steps(problem, lure, sectors, enclose):
        if decision is not None:
            return decision
    return LureDecision(
        verdict=Verdict.PROVED, reason=f"V decreases, V' <= -2 ({float(lure.rate):.4g}) V, {_where(lure)}."
    )


def region_holds(lure: Lure, sectors: Sectors) -> bool:
    """Whether {e'P_e e <= level} keeps every |e_j - e_i| within the radius: level c'P_e^-1 c <= radius^2.

    P_e > 0 has to be known.  Without a level no range may need a radius.
    """
    places = () if lure.radius is None else relied_differences(sectors.problem)
    if lure.level is None or lure.radius is None or not places:
        return not places
    level, square = lure.level, lure.radius**2
    return all(level * width <= square for width in differences(lure.P_e, places))


def differences(P_e: SparseSymmetric, places: Iterable[tuple[int, int]]) -> Iterator[Fraction]:
    """c'P_e^-1 c for c = u_j - u_i, exactly: the square of the largest c'e on {e'P_e e <= 1}.  P_e > 0."""
    if all(i == j for i, j in P_e.entries):
        for i, j in places:
            yield 1 / P_e.entries[i, i] + 1 / P_e.entries[j, j]
        return
    Y = inverse(P_e.to_dense())
    for i, j in places:
        yield Y[i][i] + Y[j][j] - 2 * Y[i][j]


def covers(problem: Problem, lure: Lure, *, radius: Fraction, disturbance: Fraction = ZERO) -> bool:
    """Whether all starts |e| <= radius, |eps_i| <= disturbance lie in {V <= level}: proved, or not.

    lambda_max(P_e) radius^2 + n lambda_max(P) disturbance^2 <= level, with rational upper bounds of the eigenvalues.
    """
    room = _room(problem, lure, disturbance)
    return room is None or (room >= 0 and eigenvalue_bound(lure.P_e) * radius**2 <= room)


def covered_radius(problem: Problem, lure: Lure, *, disturbance: Fraction = ZERO) -> float:
    """The largest R, rounded down, for which ``covers`` holds; inf for all of space, 0 if there is none."""
    room = _room(problem, lure, disturbance)
    if room is None:
        return math.inf
    if room <= 0:
        return 0.0
    estimate = math.sqrt(float_below(room / eigenvalue_bound(lure.P_e)))
    for part in (0.0, 1e-12, 1e-9):
        radius = shorten(estimate * (1 - part))
        if covers(problem, lure, radius=claimed(radius), disturbance=disturbance):
            return radius
    return 0.0


def eigenvalue_bound(M: SparseSymmetric) -> Fraction:
    """A rational l with l I - M >= 0 proved, close above lambda_max(M); exact for diagonal M."""
    if all(i == j for i, j in M.entries):
        return max((M.entries.get((i, i), ZERO) for i in range(M.size)), default=ZERO)
    values = np.linalg.eigvalsh(to_float(M.to_dense()))
    largest, unit = Fraction(float(values[-1])), Fraction(float(np.max(np.abs(values))))
    for rise in RISE:
        bound = _short_above(largest + rise * unit)
        if decide_positive_semidefinite(M.negated().shifted(bound)).verdict is Verdict.PROVED:
            return bound
    rows = [ZERO] * M.size  # Gershgorin, which needs no estimate
    for (i, j), value in M.entries.items():
        for row in {i, j}:
            rows[row] += abs(value)
    return max(rows)


def _steps(problem: Problem, lure: Lure, sectors: Sectors, enclose: Enclose) -> Iterator[LureDecision | None]:
    """One decision per step, None where it holds; the first one that is not None decides."""
    yield _gains(problem, lure, enclose)
    positive = decide_positive_definite(lure.P_e)
    if positive.verdict is not Verdict.PROVED:
        yield _refuted("P_e", "P_e is not positive definite.", positive)
    pair = None if lure.P is None or lure.Q is None else Pair(P=lure.P, Q=lure.Q)
    S: Matrix | None = None
    if pair is not None:
        exosystem = problem.joint_exosystem
        if exosystem is None:
            raise ShapeError("P and Q have no meaning without an [exosystem].", key="P")
        S = schur_block(pair, exosystem, rate=lure.rate)
        own = decide_positive_definite(SparseSymmetric.from_dense(pair.P))
        if S is None or own.verdict is not Verdict.PROVED:
            yield _refuted("observer", "P > 0 and Omega0 + 2 rate P < 0 do not hold for this pair (P, Q).", None)
            return
    for mode in sectors.modes:
        yield _inequality(lure, sectors, mode, S)
    if not region_holds(lure, sectors):
        yield _refuted("region", "{V <= level} reaches beyond the radius on which the gains are bounded.", None)


def _gains(problem: Problem, lure: Lure, enclose: Enclose) -> LureDecision | None:
    for each in lure.ranges:
        coupling = problem.couplings[each.coupling]
        if each.radius is None and not coupling.is_linear:
            return _undecided(f'h = "{coupling.texts[0]}" is not linear, so its gains need a radius.')
        try:
            found = enclose(coupling, Fraction(1) if each.radius is None else each.radius)
        except UndefinedError as error:
            return _undecided(f"the gains cannot be enclosed: {error}")
        pairs = zip(each.entries, found, strict=True)
        if not all(mine.contains(gain) for row, own in pairs for mine, gain in zip(row, own, strict=True)):
            return _undecided(f'the gains of h = "{coupling.texts[0]}" are not shown to lie in the range claimed.')
    return None


def _inequality(lure: Lure, sectors: Sectors, mode: str, S: Matrix | None) -> LureDecision | None:
    for matrix in _matrices(lure, sectors, mode, S):
        decision = decide_positive_definite(matrix.negated())
        if decision.verdict is not Verdict.PROVED:
            return _refuted(
                "inequality", f"the matrix inequality fails in mode {mode} for these multipliers.", decision, mode=mode
            )
    return None


def _matrices(lure: Lure, sectors: Sectors, mode: str, S: Matrix | None) -> Iterator[SparseSymmetric]:
    """What has to be negative definite."""
    if lure.method == "lure":
        yield lure_matrix(sectors, mode, lure.P_e, lure.multipliers.get(mode, ()), rate=lure.rate, S=S)
    elif lure.method == "interval":
        yield interval_matrix(sectors, mode, lure.P_e, rate=lure.rate, S=S)
    else:
        yield from vertex_matrices(sectors, mode, lure.P_e, rate=lure.rate, S=S)


def _room(problem: Problem, lure: Lure, disturbance: Fraction) -> Fraction | None:
    """What the observer errors leave of the level for e'P_e e; None: no limit.  Negative: nothing."""
    if disturbance and lure.P is None:
        return Fraction(-1)
    if lure.level is None:
        return None
    if not disturbance or lure.P is None:
        return lure.level
    return lure.level - problem.n * eigenvalue_bound(SparseSymmetric.from_dense(lure.P)) * disturbance**2


def _refuted(step: str, reason: str, decision: Definiteness | None, *, mode: str | None = None) -> LureDecision:
    witness = None if decision is None else decision.witness
    return LureDecision(verdict=Verdict.REFUTED, step=step, mode=mode, witness=witness, reason=reason)


def _undecided(reason: str) -> LureDecision:
    return LureDecision(verdict=Verdict.UNDECIDED, step="gains", reason=reason)


def _short_above(value: Fraction) -> Fraction:
    """A number of 12 significant digits that is not below."""
    if value <= 0:
        return ZERO
    unit = Fraction(10) ** (11 - math.floor(math.log10(float(value))))
    return math.ceil(value * unit) / unit


def _where(lure: Lure) -> str:
    if lure.level is None:
        return "everywhere (all gains are bounded for every y)"
    return f"while V <= {float(lure.level):.6g}"
