"""What a certificate says about a sampling period: its proved check ``sampling``, as a statement about one period.

The check is about couplings and pinning that are held, with the observer (13) and dhat in continuous time; that the
sampled observer's own error dies out is decided in ``sampled_loop``.
"""

from __future__ import annotations

from fractions import Fraction

from dobc_design.certificate.claims import Claims
from dobc_design.conditions.statement import Statement
from dobc_design.exact.number import number_text
from dobc_design.verdict import Verdict


def certified_sampling(claims: Claims, period: Fraction) -> Statement:
    """State whether ``period`` (s) is within the one that the certificate proves: PROVED, or UNDECIDED."""
    for check in claims.checks:
        if check.id == "sampling" and check.verdict is Verdict.PROVED and check.exact and "period" in check.exact:
            longest = Fraction(str(check.exact["period"]))
            where = _domain(check.domain)
            if period <= longest:
                return _statement(
                    check.verdict,
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
    return _statement(Verdict.UNDECIDED, "the certificate has no proved check `sampling`.", None)


def _statement(verdict: Verdict, text: str, longest: Fraction | None) -> Statement:
    exact = {} if longest is None else {"period": number_text(longest)}
    return Statement(kind="certified-sampling", verdict=verdict, text=text, exact=exact)


def _domain(domain: object) -> str:
    if isinstance(domain, dict) and "radius" in domain:
        rest = f" and |eps_i| <= {domain['disturbance']:g}" if domain.get("disturbance") else ""
        return f", from every start with |e|_inf <= {domain['radius']:g}{rest}"
    return ", from every start" if domain == "global" else ""
