"""The check ``lure``, from a claim that is decided here to what a certificate holds, and back.

Theory, section 4: a ball in a sublevel set of V = e'P_e e + sum eps_i'P eps_i.  docs/certificate-format.md, "Regions",
fixes the form.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from fractions import Fraction
from typing import Any, Final

from dobc_design.conditions.check import Check, read_domain, read_object, starts_in, undecided_check
from dobc_design.conditions.numbers import (
    MATRIX_BITS,
    VECTOR_BITS,
    claimed,
    decimal_below,
    follows,
    has_short_denominator,
    is_short,
    read_rational,
    shorten,
)
from dobc_design.conditions.quadratic.claim import METHODS, Lure, Method
from dobc_design.conditions.quadratic.decide import LureDecision, covered_radius, covers, verify_lure
from dobc_design.conditions.quadratic.sectors import GainRange, build_sectors
from dobc_design.exact.interval import Interval
from dobc_design.exact.matrix import Matrix, is_symmetric, multiply
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

#: The part of a ball that is kept in hand, for a second program with its own bounds of eigenvalues.
IN_HAND: Final = 1e-6
_DIGITS: Final = 6
#: How a sentence names a certificate.
IN_WORDS: Final = {"identity": "P_e = I", "diagonal": "a diagonal P_e", "full": "a full P_e"}
_DEVICES: Final = {"lure": "multipliers", "interval": "an interval bound", "vertices": "the corners of all gains"}


def quadratic_obstacle(problem: Problem, W: Matrix | None) -> str | None:
    """Why no quadratic certificate applies to the loop with the gain W (q, m); None if one does."""
    if problem.groups and W is None:
        return "does not apply: there is no observer gain W, and without one the estimation error is not bounded."
    return None


def certified_ball(problem: Problem, lure: Lure, *, disturbance: float) -> float:
    """The largest |e| to be claimed for |eps_i| <= disturbance, a little in hand; inf for all of space, 0 for none."""
    radius = covered_radius(problem, lure, disturbance=claimed(disturbance))
    return radius if math.isinf(radius) else shorten(radius * (1 - IN_HAND), digits=_DIGITS)


def lure_check(
    problem: Problem, W: Matrix | None, lure: Lure, *, radius: float, disturbance: float, domain: str, remark: str = ""
) -> Check:
    """Decide ``lure`` as a proof for every start with |e| <= radius and |eps_i| <= disturbance.

    ``domain``: that of Lemma 1, for a claim that is not proved.  A claim without a level is about all starts.
    ``remark`` is added to the reason.
    Returns: a Check, PROVED or UNDECIDED; that one claim fails says nothing against the others.
    """
    reason = quadratic_obstacle(problem, W)
    if reason is not None:
        return undecided_check("lure", domain, reason, applies=False)
    decision = verify_lure(problem, lure)
    if decision.verdict is not Verdict.PROVED:
        return undecided_check("lure", domain, decision.reason)
    if lure.level is not None and not covers(problem, lure, radius=claimed(radius), disturbance=claimed(disturbance)):
        return undecided_check("lure", domain, "the ball asked for is not inside the invariant set.")
    return Check(
        id="lure",
        verdict=Verdict.PROVED,
        rate=rate_of(lure),
        domain="global" if lure.level is None else starts_in("ball", radius, disturbance),
        claim=lure,
        reason=f"from {starts_in_words(problem, lure, radius, disturbance)} V = {function_in_words(lure)}"
        f" decreases{pace_in_words(lure)}, for all gains that the couplings have there ({_DEVICES[lure.method]},"
        f" {IN_WORDS[lure.shape]}){in_every_mode(problem)}.{remark}",
    )


def confirm(check: Check, problem: Problem, W: Matrix | None, *, domain: str) -> str | None:
    """None if everything a proved ``lure`` claims is confirmed, else what is not; ``domain`` is that of Lemma 1.

    Raises what a malformed claim raises.
    """
    reason = wrong_outside(check, problem, W)
    if reason is not None:
        return reason
    lure = read_claim(check, problem, W)
    if lure.level is None:
        if check.domain != "global" or domain != "global":
            return "without a level the domain must be global, and every coupling linear"
    elif not ball_is_inside(problem, lure, check.domain):
        return "the ball is not inside the invariant set"
    return not_shown(check, problem, lure, verify_lure(problem, lure))


def wrong_outside(check: Check, problem: Problem, W: Matrix | None) -> str | None:
    """What is wrong before the exact values are looked at."""
    reason = quadratic_obstacle(problem, W)
    if reason is not None:
        return reason
    if check.verdict is not Verdict.PROVED or check.witness is not None:
        return "it can only be proved or undecided, and has no witness"
    return None


def not_shown(check: Check, problem: Problem, lure: Lure, decision: LureDecision) -> str | None:
    """What ``decision`` leaves open of a claimed check; None if nothing."""
    if decision.verdict is not Verdict.PROVED:
        return decision.reason
    if not _needless_are_zero(problem, lure):
        return "a multiplier of a channel without a range is not 0"
    if check.rate is not None and not follows(check.rate, lure.rate):
        return f"the rate {check.rate} does not follow"
    return None


def _needless_are_zero(problem: Problem, lure: Lure) -> bool:
    """Whether the channels without a range of gains have no multiplier either."""
    channels = build_sectors(problem, lure.ranges, radius=lure.radius).modes
    return all(
        channel.spread or not tau
        for mode, taus in lure.multipliers.items()
        for channel, tau in zip(channels[mode], taus, strict=True)
    )


def ball_is_inside(problem: Problem, lure: Lure, domain: object) -> bool:
    """Whether the domain is a ball of covered starts.  Raises: ValueError or TypeError if it is no ball."""
    radius, disturbance = read_domain(domain, problem, kind="ball")
    return covers(problem, lure, radius=radius, disturbance=disturbance)


def rate_of(lure: Lure) -> float | None:
    """The claimed rate in 1/s, rounded down; None for 0."""
    return decimal_below(lure.rate) or None if lure.rate else None


def starts_in_words(problem: Problem, lure: Lure, radius: float, disturbance: float) -> str:
    """The covered starts as part of a sentence."""
    if lure.level is None:
        return "every start"
    errors = f" and |eps_i| <= {disturbance:.6g}" if problem.groups else ""
    return f"every start with |e| <= {radius:.6g}{errors}"


def function_in_words(lure: Lure) -> str:
    """V as part of a sentence."""
    return "e'P_e e" + ("" if lure.P is None else " + sum eps_i'P eps_i")


def pace_in_words(lure: Lure) -> str:
    """The decay of V as part of a sentence."""
    return f", at least like exp(-2 ({shorten(lure.rate, digits=4):.4g}) t)" if lure.rate else ""


def in_every_mode(problem: Problem) -> str:
    """What is added for several modes."""
    return ", in every mode" if len(problem.network.modes) > 1 else ""


_LURE: Final = ("method", "P_e", "level", "radius", "ranges", "multipliers", "rate")


def read_claim(check: Check, problem: Problem, W: Matrix | None) -> Lure:
    """What a proved check claims, for this problem and the gain W (q, m); raises as ``lure_from_json``."""
    return lure_from_json(read_object(check.exact, names_of(problem)), problem, W)


def lure_from_json(values: Mapping[str, Any], problem: Problem, W: Matrix | None) -> Lure:
    """Read them back for this problem and the gain W (q, m).

    Raises: KeyError, TypeError, ValueError, ShapeError or SpecError for anything that cannot be such a claim.
    """
    radius, level = (_number_or_none(values[name]) for name in ("radius", "level"))
    if (radius is None) is not (level is None):
        raise ValueError("radius and level must both be null, or neither")
    if radius is not None and radius <= 0:
        raise ValueError("radius must be > 0")
    P = _pair_matrix(values["P"], problem) if problem.groups else None
    return Lure(
        method=_method(values["method"]),
        P_e=_sparse(values["P_e"], problem.n * problem.m),
        level=level,
        radius=radius,
        ranges=_ranges(values["ranges"], problem, radius),
        multipliers=_multipliers(values, problem),
        rate=read_rational(values["rate"]),
        P=P,
        Q=None if P is None or W is None else multiply(P, W),
    )


def names_of(problem: Problem) -> tuple[str, ...]:
    """The keys of ``exact``."""
    return (*_LURE, "P") if problem.groups else _LURE


def _number_or_none(text: object) -> Fraction | None:
    return None if text is None else read_rational(text)


def _method(name: object) -> Method:
    for method in METHODS:
        if name == method:
            return method
    raise ValueError(f"method must be one of {', '.join(METHODS)}")


def _sparse(rows: object, size: int) -> SparseSymmetric:
    """The nonzero entries [a, b, value], a <= b, each once."""
    if not isinstance(rows, list):
        raise TypeError("P_e must be a list")
    entries: dict[tuple[int, int], Fraction] = {}
    for row in rows:
        i, j, text = row
        if type(i) is not int or type(j) is not int or (i, j) in entries:
            raise ValueError("P_e must list each entry once, with two whole numbers")
        entries[i, j] = read_rational(text)
    if not all(entries.values()) or not has_short_denominator(entries.values(), MATRIX_BITS):
        raise ValueError("an entry of P_e is 0, or they need too long a common denominator")
    return SparseSymmetric(size, entries)


def _ranges(data: object, problem: Problem, radius: Fraction | None) -> tuple[GainRange, ...]:
    if not isinstance(data, list):
        raise TypeError("ranges must be a list")
    found = []
    for each in data:
        values = read_object(each, ("coupling", "gains"))
        if type(values["coupling"]) is not int:
            raise TypeError("coupling must be a whole number")
        entries = tuple(
            tuple(Interval(read_rational(lo), read_rational(hi)) for lo, hi in row) for row in values["gains"]
        )
        found.append(GainRange(coupling=values["coupling"], radius=radius, entries=entries))
    arcs = (arc for mode in problem.network.modes.values() for arc in mode)
    used = {problem.coupling_place(i, j) for i, j, _ in arcs}
    if len(found) != len(used) or {each.coupling for each in found} != used:
        raise ValueError("ranges must name every coupling that an arc has, once")
    return tuple(found)


def _multipliers(values: Mapping[str, Any], problem: Problem) -> dict[str, tuple[Fraction, ...]]:
    names = tuple(problem.network.modes) if values["method"] == "lure" else ()
    taus = read_object(values["multipliers"], names)
    found = {mode: tuple(map(read_rational, taus[mode])) for mode in names}
    if not all(has_short_denominator(each, VECTOR_BITS) for each in found.values()):
        raise ValueError("multipliers need too long a common denominator")
    return found


def _pair_matrix(rows: Any, problem: Problem) -> Matrix:
    P = tuple(tuple(read_rational(entry) for entry in row) for row in rows)
    if len(P) != problem.q or any(len(row) != problem.q for row in P) or not is_symmetric(P) or not is_short(P):
        raise ValueError(f"P must be a symmetric matrix of {problem.q} rows, with a short common denominator")
    return P
