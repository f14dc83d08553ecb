"""Checks of a region, from a claim that is decided here to what a certificate holds, and back.

Theory, section 5: the max-separable certificate, and what it says about delays and sampling.  The form is fixed by
docs/certificate-format.md, "Regions".  A proved check is proved for the very numbers that it shows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any, Final

import numpy as np

from dobc_design.conditions.check import Check, Domain, Witness, number_or_none, require_keys
from dobc_design.conditions.consensus.network import name_agents
from dobc_design.conditions.numbers import (
    VECTOR_BITS,
    claimed,
    doubles_from_json,
    doubles_to_json,
    has_short_denominator,
    is_short,
    read_rational,
    shorten,
)
from dobc_design.conditions.separable.claim import ErrorBound, Separable, acts_by_component
from dobc_design.conditions.separable.decide import rounded_down
from dobc_design.conditions.separable.observer import composite_rate, covers, verify_composite
from dobc_design.conditions.separable.ordering import find_ordering
from dobc_design.conditions.separable.timing import (
    DelayBound,
    SamplingBound,
    largest_period,
    sampled_factor,
    verify_delay,
)
from dobc_design.exact.matrix import Matrix, Vector
from dobc_design.exact.number import number_text
from dobc_design.exact.symmetric import Doubles
from dobc_design.problem.canonical import matrix_text
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

#: Agents from which on v travels as doubles.
MANY_AGENTS: Final = 1000
#: Sampling periods below are no use to anybody (s).
SHORTEST: Final = Fraction(1, 10**30)
#: The part of a sampling period that is kept in hand, for a second program with wider enclosures.
IN_HAND: Final = Fraction(1, 1000)
#: The key under which a sampling check holds weights of its own, where it has some.
OWN: Final = "certificate"
_OBSERVER: Final = ("P", "beta", "kappa", "size")
_SHOWN: Final = 6  # stuck agents that a sentence tells with the mode that blocks them


def obstacle(problem: Problem, W: Matrix | None) -> str | None:
    """Why the max-separable certificate does not apply to the loop with the gain W (q, m); None if it does."""
    if not acts_by_component(problem):
        return (
            "does not apply: the max-separable certificate is for couplings that act on each state component by itself."
        )
    if problem.groups and W is None:
        return "does not apply: there is no observer gain W, and without one the estimation error is not bounded."
    return None


def max_separable_check(
    problem: Problem,
    W: Matrix | None,
    claim: Separable,
    *,
    radius: float,
    disturbance: float,
    domain: str,
    remark: str = "",
) -> Check:
    """Decide ``claim`` as a proof for every start with |e|_inf <= radius and |eps_i| <= disturbance.

    ``domain``: that of Lemma 1, for a claim that is not proved.  A claim without rho is about all starts.  ``remark``
    is added to the reason.
    Returns: a Check, PROVED or UNDECIDED; that one claim fails says nothing against the others.
    """
    reason = obstacle(problem, W)
    if reason is not None:
        return undecided_check("max-separable", domain, reason)
    answer = verify_composite(problem, W, claim)
    if answer.verdict is not Verdict.PROVED:
        return undecided_check("max-separable", domain, answer.reason)
    if not covers(claim, radius=claimed(radius), disturbance=claimed(disturbance)):
        return undecided_check("max-separable", domain, "the box asked for is not inside the invariant set.")
    rate = decimal_below(composite_rate(claim))
    if not rate:
        return undecided_check("max-separable", domain, "the rate of the whole loop is not shown to be positive.")
    starts = "every start" if claim.rho is None else f"every start with |e_i| <= {radius:.6g}"
    if problem.groups and claim.rho is not None:
        starts += f" and |eps_i| <= {disturbance:.6g}"
    measure = "max_i |e_i|/v_i" + ("" if claim.error is None else f" + {float(claim.error.kappa):.4g} max_i |eps_i|_P")
    return Check(
        id="max-separable",
        verdict=Verdict.PROVED,
        domain="global" if claim.rho is None else box(radius, disturbance),
        rate=rate,
        exact=separable_to_json(claim),
        reason=f"from {starts}: V = {measure} decays at least like exp(-{shorten(rate, digits=4):.4g} t), because"
        f" on every face of every smaller box the field points inwards{_in_every_mode(problem)}.{remark}",
    )


def stuck_check(problem: Problem, W: Matrix | None, *, domain: str) -> Check | None:
    """REFUTED, with the agents that no common v can hold, if there are such agents; else None."""
    ordering = find_ordering(problem)
    if obstacle(problem, W) is not None or ordering.exists:
        return None
    labels = tuple(problem.network.labels[agent] for agent in ordering.stuck)
    reason = (
        f"no v does: each of {name_agents(labels)} has a mode in which it is not pinned and hears nobody outside this"
        " group."
    )
    if len(problem.network.modes) > 1 and len(labels) <= _SHOWN:
        told = ", ".join(f"{label} in {mode}" for label, mode in zip(labels, ordering.blocking, strict=True))
        reason = f"no common v does, as these are not pinned and hear nobody but each other: {told}."
    return Check(
        id="max-separable",
        verdict=Verdict.REFUTED,
        domain=domain,
        reason=reason,
        witness=Witness(kind="agents", labels=labels),
    )


def delay_check(problem: Problem, claim: Separable, bound: DelayBound, beside: Check, *, domain: str) -> Check:
    """Decide what ``claim``, proved by the check ``beside``, says about delays up to ``bound.delay`` (s)."""
    answer = verify_delay(problem, claim, bound)
    rate = decimal_below(bound.rate)
    if answer.verdict is not Verdict.PROVED or not rate:
        return undecided_check("delay", domain, answer.reason)
    return Check(
        id="delay",
        verdict=Verdict.PROVED,
        domain=beside.domain,
        rate=rate,
        exact={"delay": number_text(bound.delay), "rate": number_text(bound.rate)},
        reason=f"agents may hear each other late by up to {float(bound.delay):.4g} s, in any varying way: the error"
        f" still decays at every rate below {shorten(rate, digits=4):.4g} 1/s. Longer delays make it slower; none"
        " stops it.",
    )


def sampling_check(
    problem: Problem,
    claim: Separable,
    beside: Check,
    *,
    domain: str,
    W: Matrix | None = None,
    own: Separable | None = None,
) -> Check:
    """Decide how long couplings and pinning may be held, for a ``claim`` that the check ``beside`` proves.

    ``own``: another claim, for whose v longer periods do no harm; it is decided here, for the starts of ``beside`` and
    the loop with the gain ``W`` (q, m).
    """
    if own is not None and _holds_box(problem, W, own, beside):
        claim = own
    else:
        own = None
    longest = largest_period(problem, claim)
    if longest is None or longest.period < SHORTEST:
        reason = "the slopes of the coupling are too steep in the box for a sampling period."
        return undecided_check("sampling", domain, reason)
    period = rounded_down(
        longest.period * (1 - IN_HAND), digits=4
    )  # what is proved for a period holds for shorter ones
    bound = SamplingBound(period=period, factor=1 - period * claim.alpha)
    fall = shorten(100 * (1 - sampled_factor(claim, bound)), digits=2)
    exact: dict[str, Any] = {"period": number_text(bound.period), "factor": number_text(bound.factor)}
    if own is not None:
        exact[OWN] = separable_to_json(own)
    estimate = " (dhat is subtracted all the time)" if problem.groups else ""  # held, it leaves an error for ever
    what = "V still falls" if own is None else "a V of its own, with weights that differ less, falls"
    return Check(
        id="sampling",
        verdict=Verdict.PROVED,
        domain=beside.domain,
        exact=exact,
        reason=f"couplings and pinning may be held for {float(period):.4g} s from one sample to the next{estimate}:"
        f" {what}, by at least {fall:.2g} % a sample.",
    )


def _holds_box(problem: Problem, W: Matrix | None, claim: Separable, beside: Check) -> bool:
    """Whether the claim is proved for all starts of the box of a proved check."""
    if claim.rho is None or not isinstance(beside.domain, Mapping):
        return False
    radius, disturbance = read_domain(beside.domain, problem, kind="box")
    inside = covers(claim, radius=radius, disturbance=disturbance)
    return inside and verify_composite(problem, W, claim).verdict is Verdict.PROVED


def undecided_check(id: str, domain: str, reason: str) -> Check:
    """A regional check that claims nothing."""
    return Check(id=id, verdict=Verdict.UNDECIDED, domain=domain, reason=reason)


def decimal_below(value: Fraction) -> float:
    """A decimal number of at most nine digits that does not exceed ``value`` > 0; the same if it has no more."""
    found = float(rounded_down(value))
    return found if claimed(found) <= value else shorten(value)


def box(radius: float, disturbance: float) -> Domain:
    """The domain |e|_inf <= radius and |eps_i| <= disturbance."""
    return {"kind": "box", "radius": radius, "disturbance": disturbance}


def read_domain(domain: object, problem: Problem, *, kind: str) -> tuple[Fraction, Fraction]:
    """Radius > 0 and disturbance >= 0 of a domain, ``kind`` "box" or "ball".

    Raises: ValueError or TypeError for another one, and for a disturbance without an exosystem.
    """
    if not isinstance(domain, Mapping) or set(domain) != {"kind", "radius", "disturbance"} or domain["kind"] != kind:
        raise ValueError(f"the domain must be a {kind} with radius and disturbance")
    radius, disturbance = number_or_none(domain["radius"]), number_or_none(domain["disturbance"])
    if radius is None or radius <= 0 or disturbance is None or disturbance < 0:
        raise ValueError("the radius must be > 0 and the disturbance >= 0")
    if disturbance and not problem.groups:
        raise ValueError("without an exosystem the disturbance must be 0")
    return claimed(radius), claimed(disturbance)


def separable_to_json(claim: Separable) -> dict[str, Any]:
    """The exact values of a proved max-separable check."""
    values: dict[str, Any] = {
        "v": vector_to_json(claim.v),
        "alpha": number_text(claim.alpha),
        "rho": None if claim.rho is None else number_text(claim.rho),
    }
    if claim.error is not None:
        values["P"] = matrix_text(claim.error.P)
        values |= {name: number_text(getattr(claim.error, name)) for name in ("beta", "kappa", "size")}
    return values


def separable_from_json(exact: object, problem: Problem) -> Separable:
    """Read them back for this problem.  Raises: KeyError, TypeError or ValueError for anything else."""
    names = _OBSERVER if problem.groups else ()
    values = read_object(exact, ("v", "alpha", "rho", *names))
    error = None
    if problem.groups:
        P = tuple(tuple(read_rational(entry) for entry in row) for row in values["P"])
        if not is_short(P):
            raise ValueError("P needs too long a common denominator")
        beta, kappa, size = (read_rational(values[name]) for name in ("beta", "kappa", "size"))
        if min(beta, kappa, size) <= 0:
            raise ValueError("beta, kappa and size must be > 0")
        error = ErrorBound(P=P, beta=beta, kappa=kappa, size=size)
    return Separable(
        v=vector_from_json(values["v"], problem.n),
        alpha=read_rational(values["alpha"]),
        rho=None if values["rho"] is None else read_rational(values["rho"]),
        error=error,
    )


def read_object(data: object, names: Sequence[str]) -> Mapping[str, Any]:
    """An object with exactly these keys.  Raises: KeyError, TypeError or ValueError for anything else."""
    require_keys(data, "exact", needed=names)
    return data if isinstance(data, Mapping) else {}


def vector_to_json(v: Vector | Doubles) -> list[str] | dict[str, str]:
    """A list of rationals, or for many agents the base64 of little-endian doubles where those are exact."""
    if len(v) > MANY_AGENTS:
        doubles = v.array if isinstance(v, Doubles) else np.array([float(x) for x in v])
        if isinstance(v, Doubles) or all(Fraction(x) == y for x, y in zip(doubles.tolist(), v, strict=True)):
            return doubles_to_json(doubles)
    return [number_text(x) for x in v]


def vector_from_json(data: object, size: int) -> Vector | Doubles:
    """Read ``size`` numbers.  Raises: KeyError, TypeError or ValueError for anything else."""
    v: Vector | Doubles
    if isinstance(data, list):
        v = tuple(read_rational(text) for text in data)
        if not has_short_denominator(v, VECTOR_BITS):
            raise ValueError("the vector needs too long a common denominator")
    else:
        v = Doubles(doubles_from_json(data))
    if len(v) != size:
        raise ValueError(f"expected {size} numbers, got {len(v)}")
    return v


def _in_every_mode(problem: Problem) -> str:
    return ", in every mode" if len(problem.network.modes) > 1 else ""
