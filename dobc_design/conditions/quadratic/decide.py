"""Decides the certificates of ``claim``, and the check ``lure``: from a claim to what a certificate
holds, and back.

Theory, section 4: a ball in a sublevel set of V = e'P_e e + sum eps_i'P eps_i.  Every step is
exact.  "Refuted" is about the certificate at hand, with a witness where a matrix fails; it never
says that consensus fails. docs/certificate-claims.md, "Regions", fixes the form.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from fractions import Fraction
from functools import partial

import numpy as np

from dobc_design._checks import noun
from dobc_design.conditions import numbers
from dobc_design.conditions.case import Case, not_all_starts
from dobc_design.conditions.check import (
    Check,
    not_a_proof,
    read_parts,
)
from dobc_design.conditions.consensus.claim import Pair
from dobc_design.conditions.consensus.decide import schur_block
from dobc_design.conditions.consensus.network import name_agents
from dobc_design.conditions.coverage import Asked
from dobc_design.conditions.domain import EVERYWHERE, Ball
from dobc_design.conditions.numbers import (
    claimed,
    has_short_denominator,
    rational_or_none,
    read_rational,
    rounded_up,
    shorten,
    text_below,
    whole_from_json,
)
from dobc_design.conditions.quadratic import sectors as channels
from dobc_design.conditions.reason import fixed_obstacle, observer_obstacle, signs_obstacle
from dobc_design.errors import ShapeError
from dobc_design.exact.definite import decide_positive_definite, decide_positive_semidefinite
from dobc_design.exact.interval import UndefinedError
from dobc_design.exact.matrix import Matrix, Vector, inverse, largest_entry, to_float
from dobc_design.exact.number import ONE, ZERO, float_below
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.loop.arcs import unreached
from dobc_design.loop.loop import Loop
from dobc_design.verdict import Decided, Verdict

from .claim import METHOD, Lure, Quadratic, lure_matrix, observed_in, observer_of
from .sectors import build_sectors, left_open, ranges_from_json

# How far above its estimate a bound on an eigenvalue is tried, relative to the largest one.
RISE = (Fraction(1, 10**9), Fraction(1, 10**6), Fraction(1, 1000), ONE)
IN_HAND = 1e-6  # of a ball, for a second program with its own bounds of eigenvalues
_DIGITS = 6


@noun
class LureDecision(Decided):
    """The verdict and, unless proved, the ``step`` that fails: "gains", "P_e", "observer",
    "inequality" (of ``mode``), "region".  ``witness``: a direction in which a matrix of that step
    is not definite."""

    verdict: Verdict
    step: str = ""
    mode: str | None = None
    witness: Vector | None = None
    reason: str


def verify_lure(loop: Loop, lure: Lure) -> LureDecision:
    """Decide whether the certificate proves what it claims, for every switching.  Raises:
    ShapeError or SpecError."""
    if lure.P_e.size != loop.size:
        what = f"P_e must have {loop.size} rows, one per component of e; got {lure.P_e.size}."
        raise ShapeError(what, key="P_e")
    # First what is quick: the claimed gains are taken as they are, and shown last.
    sectors = build_sectors(loop, lure.ranges, radius=lure.radius)
    unsettled = partial(LureDecision, verdict=Verdict.UNDECIDED, step="gains")
    for each in lure.ranges:
        if each.radius is None and not loop.functions[each.coupling].is_linear:
            return unsettled(reason="a coupling is not linear, so its gains need a radius.")
    refuted = partial(LureDecision, verdict=Verdict.REFUTED)
    positive = decide_positive_definite(lure.P_e)
    if not positive.is_proved:
        return refuted(step="P_e", reason="P_e is not positive definite.", witness=positive.witness)
    S = border_of(loop, lure, lure.rate)
    if lure.P is not None:
        own = decide_positive_definite(lure.P)
        if S is None or not own.is_proved:
            return refuted(
                step="observer",
                reason="P > 0 and Omega0 + 2 rate P < 0 do not hold for this pair (P, Q).",
            )
    for mode in sectors.modes:
        taus = lure.multipliers.get(mode, ())
        matrix = lure_matrix(sectors, mode, lure.P_e, taus, rate=lure.rate, S=S)
        decision = decide_positive_definite(matrix.negated())
        if not decision.is_proved:
            return refuted(
                step="inequality",
                mode=mode,
                reason=f"the matrix inequality fails in mode {mode} for these multipliers.",
                witness=decision.witness,
            )
    if not region_holds(lure, loop):
        return refuted(
            step="region",
            reason="{V <= level} reaches beyond the radius on which the gains are bounded.",
        )
    for each in lure.ranges:  # last, since it takes longest
        # Linear gains are the same on every radius.
        gains = left_open(loop, each.coupling, each.entries, each.radius or ONE)
        if gains is not None:
            return unsettled(reason=gains)
    where = "everywhere (all gains are bounded for every y)"
    if lure.level is not None:
        where = f"while V <= {float(lure.level):.6g}"
    reason = f"V decreases, V' <= -2 ({float(lure.rate):.4g}) V, {where}."
    return LureDecision(verdict=Verdict.PROVED, reason=reason)


def region_holds(lure: Lure, loop: Loop) -> bool:
    """Whether {e'P_e e <= level} keeps every |e_j - e_i| within the radius: level c'P_e^-1 c <=
    radius^2.  P_e > 0 has to be known.  Without a level no range may need a radius."""
    if lure.radius is None:
        return True
    places = channels.relied_differences(loop)
    if lure.level is None:
        return not places
    return all(lure.level * width <= lure.radius**2 for width in differences(lure.P_e, places))


def differences(P_e: SparseSymmetric, places: Iterable[tuple[int, int]]) -> Iterator[Fraction]:
    """c'P_e^-1 c for c = u_j - u_i, exactly: the square of the largest c'e on {e'P_e e <= 1}; c =
    -u_i for the target, whose place is after the last.  P_e > 0."""
    size = P_e.size
    Y = inverse(P_e.to_dense())
    for i, j in places:
        yield Y[i][i] if j == size else Y[i][i] + Y[j][j] - 2 * Y[i][j]


def diagonal_of_inverse(P_e: SparseSymmetric) -> list[Fraction]:
    """The diagonal of P_e^-1: entry c is the largest e_c^2 where e'P_e e <= 1.  P_e > 0."""
    if P_e.is_diagonal:
        return [1 / x for x in P_e.diagonal()]
    Y = inverse(P_e.to_dense())
    return [Y[i][i] for i in range(P_e.size)]


def border_of(loop: Loop, lure: Quadratic, rate: Fraction) -> Matrix | None:
    """S of the observer's pair at a rate (1/s), exactly; None without a pair, or unless Omega0 + 2
    rate P < 0."""
    if lure.P is None or lure.Q is None:
        return None
    exosystem = loop.joint_exosystem
    if exosystem is None:
        raise ShapeError("P and Q have no meaning without an [exosystem].", key="P")
    return schur_block(Pair(P=lure.P, Q=lure.Q), exosystem, rate=rate)


def covers(loop: Loop, lure: Quadratic, *, radius: Fraction, disturbance: Fraction = ZERO) -> bool:
    """Whether all starts |e| <= radius, |eps_i| <= disturbance lie in {V <= level}: proved, or
    not.  lambda_max(P_e) radius^2 + n lambda_max(P) disturbance^2 <= level, with rational upper
    bounds of the eigenvalues."""
    # e'P_e e <= lambda_max(P_e) R^2 has to fit into what the observers leave of the level.
    room = room_of(loop, lure, disturbance)
    return room is None or (room >= 0 and eigenvalue_bound(lure.P_e) * radius**2 <= room)


def eigenvalue_bound(M: SparseSymmetric) -> Fraction:
    """A rational l with l I - M >= 0 proved, close above lambda_max(M); exact for diagonal M."""
    if M.is_diagonal:
        return max(M.diagonal(), default=ZERO)
    values = np.linalg.eigvalsh(to_float(M.to_dense()))
    largest = Fraction(float(values[-1]))
    unit = Fraction(largest_entry(values))
    # The estimate says only which bound is tried.
    for rise in RISE:
        bound = rounded_up(largest + rise * unit, digits=12)
        if decide_positive_semidefinite(M.negated().shifted(bound)).is_proved:
            return bound
    rows = [ZERO] * M.size  # Gershgorin, which needs no estimate
    for (i, j), value in M.entries.items():
        for row in {i, j}:
            rows[row] += abs(value)
    return max(rows)


def condition_bound(M: SparseSymmetric) -> Fraction | None:
    """An upper bound of lambda_max(M) / lambda_min(M) for M > 0, close; exact for diagonal M.  None
    where lambda_min is lost among the digits of lambda_max."""
    if M.is_diagonal:
        diagonal = M.diagonal()
        return max(diagonal) / min(diagonal)
    # The estimate says only which bound is tried.
    smallest = float(np.linalg.eigvalsh(to_float(M.to_dense()))[0])
    for part in numbers.SHRINK:
        bound = numbers.rounded_down(smallest * (1 - part), digits=12)
        if bound and decide_positive_semidefinite(M.shifted(-bound)).is_proved:
            return eigenvalue_bound(M) / bound
    return None


def room_of(loop: Loop, lure: Quadratic, disturbance: Fraction) -> Fraction | None:
    """What the observer errors leave of the level for e'P_e e; None: no limit.  Negative:
    nothing."""
    if disturbance and lure.P is None:  # eps = 0 is claimed only
        return Fraction(-1)
    if lure.level is None:
        return None
    if not disturbance or lure.P is None:
        return lure.level
    bound = eigenvalue_bound(SparseSymmetric.from_dense(lure.P))
    return lure.level - loop.n * bound * disturbance**2


def quadratic_obstacle(loop: Loop, W: Matrix | None) -> str | None:
    """Why no quadratic certificate applies to the loop with the gain W (q, m); None if one does."""
    found = observer_obstacle(loop, W) or fixed_obstacle(loop) or signs_obstacle(loop)
    if found is not None:
        return found
    if loop.slopes_move:
        try:
            loop.goals.leaders_box()
        except UndefinedError as error:
            return f"does not apply: {error}"
    for mode, arcs in loop.modes.items():
        alone = unreached(loop, [arcs])
        if alone:
            who = name_agents([loop.labels[i] for i in alone])
            return (
                f"does not apply: in mode {mode} no pin reaches {who}; a common error of "
                "theirs does not decay."
            )
    return None


def certified_ball(loop: Loop, lure: Quadratic, *, disturbance: float) -> float:
    """The largest |e| to be claimed for |eps_i| <= disturbance, a little in hand; inf for all of
    space, 0 for none."""
    room = room_of(loop, lure, claimed(disturbance))
    if room is None:
        return math.inf
    if room <= 0:
        return 0.0
    radius = math.sqrt(float_below(room / eigenvalue_bound(lure.P_e)))
    return shorten(radius * (1 - IN_HAND), digits=_DIGITS)


def lure_check(asked: Asked, lure: Lure, *, radius: float, remark: str = "") -> Check:
    """Decide ``lure`` as a proof for every start with |e| <= radius and |eps_i| as asked (all
    starts without a level): PROVED or UNDECIDED, because one claim that fails says nothing against
    the others.  ``remark`` is added to the reason."""
    loop = asked.loop
    disturbance = asked.disturbance
    errors = f" and |eps_i| <= {disturbance:.6g}" if loop.groups else ""
    within = "" if lure.level is None else f" with |e| <= {radius:.6g}{errors}"
    V = "e'P_e e" + ("" if lure.P is None else " + sum eps_i'P eps_i")
    pace = f", at least like exp(-2 ({text_below(lure.rate)}) t)" if lure.rate else ""
    where = ", in every mode" if len(loop.modes) > 1 else ""
    check = Check(
        id="lure",
        verdict=Verdict.PROVED,
        rate=numbers.decimal_below(lure.rate) or None if lure.rate else None,
        domain=EVERYWHERE if lure.level is None else Ball(radius, disturbance),
        claim=lure,
        reason=f"from every start{within}, V = {V} decreases{pace}, for all gains that the "
        f"couplings have there (multipliers, a {lure.shape} P_e){where}.{remark}",
    )
    return check.unless(confirm(check, asked.case), asked.domain)


def confirm(check: Check, case: Case) -> str | None:
    """None if everything that a proved check of this topic claims is confirmed, else what is
    not."""
    loop, W = case.loop, case.W
    reason = quadratic_obstacle(loop, W) or not_a_proof(check)
    if reason is not None:
        return reason
    lure = read_claim(check, loop, W)
    holds = None if lure.level is None else partial(covers, loop, lure)
    wrong = not_all_starts(check, case, holds, kind=Ball)
    if wrong is not None:
        return wrong
    decision = verify_lure(loop, lure)
    if not decision.is_proved:
        return decision.reason
    modes = build_sectors(loop, lure.ranges, radius=lure.radius).modes
    for mode, taus in lure.multipliers.items():
        for channel, tau in zip(modes[mode], taus, strict=True):
            if tau and not channel.spread:
                return "a multiplier of a channel without a range is not 0"
    if check.rate is not None and not numbers.follows(check.rate, lure.rate):
        return f"the rate {check.rate} does not follow"
    return None


def read_claim(check: Check, loop: Loop, W: Matrix | None) -> Lure:
    """What a proved check claims, for this problem and the gain W (q, m); raises as
    ``lure_from_json``."""
    return lure_from_json(check.exact, loop, W)


def lure_from_json(data: object, loop: Loop, W: Matrix | None) -> Lure:
    """Read it back.  Raises: KeyError, TypeError, ValueError, ShapeError or SpecError for what is
    no such claim."""
    shape = {
        "method": None,
        "P_e": [(whole_from_json, whole_from_json, read_rational)],
        "level": rational_or_none,
        "radius": rational_or_none,
        "ranges": None,
        "multipliers": {mode: [read_rational] for mode in loop.modes},
        "rate": read_rational,
    }
    values = observer_of(read_parts(data, shape | observed_in(loop)), loop, W)
    radius = values["radius"]
    if (radius is None) is not (values["level"] is None):
        raise ValueError("radius and level must both be null, or neither")
    if radius is not None and radius <= 0:
        raise ValueError("radius must be > 0")
    method = values.pop("method")
    if method != METHOD:
        raise ValueError(f"method {method!r} is no longer decided, only {METHOD}; certify again")
    taus = values["multipliers"].values()
    if not all(has_short_denominator(each, numbers.VECTOR_BITS) for each in taus):
        raise ValueError("multipliers need too long a common denominator")
    values["ranges"] = ranges_from_json(values["ranges"], loop, radius)
    return Lure(**values | {"P_e": _sparse(values["P_e"], loop.size)})


def _sparse(listed: Sequence[tuple[int, int, Fraction]], size: int) -> SparseSymmetric:
    """The nonzero entries [a, b, value], a <= b, each once."""
    entries = {(i, j): value for i, j, value in listed}
    values = entries.values()
    if len(entries) < len(listed) or not all(values):
        raise ValueError("P_e must list its entries that are not 0, each once")
    if not has_short_denominator(values, numbers.MATRIX_BITS):
        raise ValueError("the entries of P_e need too long a common denominator")
    return SparseSymmetric(size, entries)
