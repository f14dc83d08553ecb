"""What a certificate says about a sampling period: its proved check ``sampling``, as a statement about one period.

The check is about couplings and pinning that are held, with the observer (13) and dhat in continuous time; that the
sampled observer's own error dies out is decided in ``sampled_loop``.
"""

from __future__ import annotations

from fractions import Fraction

from dobc_design.certificate.claims import Claims, certified_period
from dobc_design.conditions.statement import Statement
from dobc_design.exact.number import number_text
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict


def certified_sampling(problem: Problem, claims: Claims, period: Fraction) -> Statement:
    """State whether ``period`` (s) is within the one that the certificate proves: PROVED, or UNDECIDED."""
    longest = certified_period(problem, claims)
    if longest is None:
        return _statement(Verdict.UNDECIDED, "the certificate has no proved check `sampling`.", None)
    where = _domain(next(check.domain for check in claims.checks if check.id == "sampling"))
    if period <= longest:
        return _statement(
            Verdict.PROVED,
            f"the certificate's check `sampling` covers this period: couplings and pinning may be held for"
            f" {float(longest):.4g} s{where} (observer and estimate: those of (13), in continuous time).",
            longest,
        )
    return _statement(
        Verdict.UNDECIDED,
        f"the certificate's check `sampling` proves periods up to {float(longest):.4g} s{where};"
        f" {float(period):.4g} s is longer.",
        longest,
    )


def _statement(verdict: Verdict, text: str, longest: Fraction | None) -> Statement:
    exact = {} if longest is None else {"period": number_text(longest)}
    return Statement(kind="certified-sampling", verdict=verdict, text=text, exact=exact)


def _domain(domain: object) -> str:
    if isinstance(domain, dict) and "radius" in domain:
        rest = f" and |eps_i| <= {domain['disturbance']:g}" if domain.get("disturbance") else ""
        return f", from every start with |e|_inf <= {domain['radius']:g}{rest}"
    return ", from every start" if domain == "global" else ""
