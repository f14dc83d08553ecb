"""What a certificate file claims: everything in it but the problem, which is never taken from there."""

from __future__ import annotations

from dataclasses import dataclass

from dobc_design.conditions.check import Check
from dobc_design.exact.matrix import Matrix
from dobc_design.verdict import Verdict


@dataclass(frozen=True, slots=True, kw_only=True)
class Claims:
    """Verdict, checks and the matrices they rest on.

    ``reason`` is the verdict in one sentence; ``rate`` (1/s) and ``covered_by`` name the best proof.
    ``W`` (q, m) is the observer gain every check is about, ``gain_source`` says "given" or "designed";
    ``P`` (q, q) and ``Q`` (q, m) belong to Theorem 1 or 2 where it is proved.  Where agents have different exosystems,
    these are block diagonal, one block per group, and "designed" says that at least one block of W is.
    ``notes`` list what was assumed, designed or stood in.  ``options`` are those of `dobc certify` that it was made
    with, for whoever makes it again; nothing follows from them.
    """

    problem_name: str
    problem_sha256: str
    verdict: Verdict
    reason: str
    rate: float | None
    covered_by: str | None
    checks: tuple[Check, ...]
    W: Matrix | None
    gain_source: str | None
    P: Matrix | None
    Q: Matrix | None
    notes: tuple[str, ...]
    version: str
    options: tuple[str, ...] = ()
