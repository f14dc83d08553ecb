"""Requests that no gain W can meet, proved: exact reasons, never a solver's word.

Without a bound on gain, peak or noise the answer is complete: the regions (closed, convex, symmetric) and Re s < 0
share a real point or nothing; W can put all observable eigenvalues into one real point (Ackermann), and the hidden
ones are where they are. So a W exists iff there is such a point and the hidden eigenvalues lie in the regions.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

from dobc_design.conditions.statement import Statement
from dobc_design.exact.number import float_below, number_text
from dobc_design.exact.observability import decide_detectable, observable_reduction
from dobc_design.exact.polynomial import (
    Coefficients,
    characteristic_polynomial,
    count_right_half_plane,
    decide_images,
    disk_image,
    polynomial_text,
    reflected,
    routh,
    shifted,
)
from dobc_design.exact.reading import shown_number
from dobc_design.problem.exosystems import Exosystem
from dobc_design.synthesis.observer.request import NoiseLimit, ObserverRequest
from dobc_design.synthesis.observer.spectral_conditions import GainRow, images
from dobc_design.synthesis.observer.spectral_regions import Cone, SpectralRegion, common_interval
from dobc_design.verdict import Verdict

BISECTIONS = 40


def why_impossible(
    exosystem: Exosystem, request: ObserverRequest, *, rows: Sequence[GainRow], multipliers: Sequence[Fraction]
) -> Statement | None:
    """A proof that no W meets a request in continuous time, or None if none was found.

    ``multipliers`` (one per row) are a proposal for the bound on |W|. A Statement with the verdict REFUTED says
    which part of the request fails: "detectable", "rate", "region", "gain" or "noise".
    """
    undetectable = why_undetectable(exosystem)
    if undetectable is not None:
        return undetectable
    found = decide_detectable(exosystem.A, exosystem.C)
    return (
        _hidden_outside(found.unobservable_polynomial, request)
        or _empty(request.all_regions)
        or _too_small(request, rows, multipliers)
        or _too_quiet(exosystem, request)
    )


def why_undetectable(exosystem: Exosystem) -> Statement | None:
    """A proof that no W makes the error decay, sampled or not, or None: a mode that C never sees does not decay."""
    found = decide_detectable(exosystem.A, exosystem.C)
    if found.verdict is Verdict.PROVED:
        return None
    return _refuted(
        "detectable",
        f"no W exists: (A, C) is not detectable; the part {found.unobservable_text} never reaches d = C xi and does"
        " not decay. It does not act on the agents either: leave it out.",
        polynomial=found.unobservable_text,
    )


def least_gain_squared(rows: Sequence[GainRow], multipliers: Sequence[Fraction]) -> Fraction:
    """A lower bound of |W|^2 for every W that satisfies the rows; 0 says nothing.

    With l >= 0: 0 <= sum l (g.W + a), so |sum l g| |W| >= -sum l a. Negative multipliers count as 0.
    """
    if not rows:
        return Fraction(0)
    weights = [max(Fraction(0), x) for x in multipliers]
    need = -sum((x * row.constant for x, row in zip(weights, rows, strict=True)), Fraction(0))
    total = [
        sum((x * row.gradient[k] for x, row in zip(weights, rows, strict=True)), Fraction(0))
        for k in range(len(rows[0].gradient))
    ]
    square = sum((x * x for x in total), Fraction(0))
    return need * need / square if need > 0 and square else Fraction(0)


def largest_hidden_rate(polynomial: Coefficients) -> Fraction | None:
    """A rate (1/s) that the hidden eigenvalues reach, proved, close to the largest; None if there is none."""
    if len(polynomial) < 2 or routh(polynomial).verdict is not Verdict.PROVED:
        return None
    low, high = Fraction(0), 1 + sum((abs(x) for x in polynomial), Fraction(0))  # Cauchy's bound
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        if count_right_half_plane(shifted(polynomial, -middle)) == 0:
            low = middle
        else:
            high = middle
    short = high.limit_denominator(1000)
    if short >= low > 0 and count_right_half_plane(shifted(polynomial, -short)) == 0:
        return short
    return low or None


def _hidden_outside(polynomial: Coefficients, request: ObserverRequest) -> Statement | None:
    """The first region that does not hold the eigenvalues that W cannot move."""
    for position, region in enumerate(request.all_regions):
        degree = (len(polynomial) - 1) * (2 if isinstance(region, Cone) else 1)
        if len(polynomial) > 1 and not decide_images(images(region, polynomial), degree=degree)[0]:
            text = polynomial_text(polynomial)
            return _refuted(
                "rate" if position == 0 else "region",
                f"no W meets {region}: C does not see the part {text} of the exosystem, so no gain moves its"
                " eigenvalues, and they lie outside.",
                polynomial=text,
            )
    return None


def _empty(regions: Sequence[SpectralRegion]) -> Statement | None:
    common = common_interval(tuple(regions))
    if common is not None and (common[0] is None or common[0] < 0):
        return None
    names = " and ".join(str(region) for region in regions)
    return _refuted("region", f"no W exists: no point with Re s < 0 lies in {names}.")


def _too_small(request: ObserverRequest, rows: Sequence[GainRow], multipliers: Sequence[Fraction]) -> Statement | None:
    if request.max_gain is None:
        return None
    square = least_gain_squared(rows, multipliers)
    if square <= request.max_gain**2:
        return None
    used = ", ".join(number_text(max(Fraction(0), x)) for x in multipliers)
    return _refuted(
        "gain",
        f"no W with |W| <= {shown_number(request.max_gain)} puts the spectrum there: every one that does has"
        f" |W| >= {float_below(square) ** 0.5:.6g} (no coefficient of the mapped polynomial may be negative).",
        multipliers=used,
        least_gain_squared=number_text(square),
    )


def _too_quiet(exosystem: Exosystem, request: ObserverRequest) -> Statement | None:
    """At an eigenvalue s of A with C v != 0 the estimate follows exactly: C (sI - F)^-1 W C v = C v.

    So for Re s >= 0 (maximum principle) no W has a disturbance channel of norm below 1, or a measurement channel
    below |s|.
    """
    A = observable_reduction(exosystem.A, exosystem.C)[0]
    polynomial = characteristic_polynomial(A) if A else (Fraction(1),)
    if len(polynomial) < 2 or routh(polynomial).verdict is Verdict.PROVED:
        return None
    # If none decays, all eigenvalues count, and one of them is not inside the open disk of the bound.
    none_decays = count_right_half_plane(reflected(polynomial)) == 0
    for limit in request.noise:
        if limit.norm != "hinf":
            continue
        if limit.channel == "disturbance" and limit.bound <= 1:
            return _noise(limit, "follows the exosystem's own disturbances exactly, which takes the gain 1")
        if limit.channel == "measurement" and none_decays and _one_not_inside(polynomial, limit.bound):
            return _noise(limit, "follows the exosystem's fastest frequency exactly, which takes at least that gain")
    return None


def _one_not_inside(polynomial: Coefficients, radius: Fraction) -> bool:
    image = disk_image(polynomial, centre=Fraction(0), radius=radius)
    return not decide_images((image,), degree=len(polynomial) - 1)[1]


def _noise(limit: NoiseLimit, because: str) -> Statement:
    return _refuted("noise", f"no W makes the {limit}: an estimate that converges {because}.")


def _refuted(kind: str, text: str, **exact: str) -> Statement:
    return Statement(kind=kind, text=text, verdict=Verdict.REFUTED, exact=exact)
