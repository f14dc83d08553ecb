"""Every claim of a certificate decided again, from the trusted problem and the certificate's matrices.

Not checked, because no verdict depends on them: the sentences (``reason``), the notes, the program's version,
and the advice (``fix``) of a Lemma 1 or theorem check.  Everything else has to be true.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from dobc_design.certificate.claims import Claims
from dobc_design.certificate.text import read_claims
from dobc_design.errors import DobcError
from dobc_design.exact.matrix import is_symmetric, multiply
from dobc_design.spec.canonical import problem_sha256
from dobc_design.spec.problem import Problem
from dobc_design.theorems.statements import state_theorems
from dobc_design.verdict import Verdict
from dobc_design.verify.check import Check
from dobc_design.verify.confirm import Trusted, confirm, expected_checks
from dobc_design.verify.consensus import Pair
from dobc_design.verify.overall import decide_overall


@dataclass(frozen=True, slots=True, kw_only=True)
class Recheck:
    """The outcome of checking a certificate.

    ``holds``: every claim holds and the claimed verdict follows.  ``confirmed`` and ``failures`` list
    the checks by title, the failures with what is wrong.
    """

    verdict: Verdict
    confirmed: tuple[str, ...]
    failures: tuple[str, ...]

    @property
    def holds(self) -> bool:
        """Whether nothing failed."""
        return not self.failures

    def __str__(self) -> str:
        head = "every claim holds" if self.holds else f"{len(self.failures)} claim(s) do not hold"
        rows = [f"{head}; verdict {self.verdict.value}."]
        rows += [f"  confirmed: {title}" for title in self.confirmed]
        rows += [f"  NOT confirmed: {text}" for text in self.failures]
        return "\n".join(rows)


def recheck(certificate: Claims | bytes, problem: Problem) -> Recheck:
    """Confirm the claims one by one, then that the verdict follows from those confirmed.

    Raises: CertificateError if the bytes are no certificate.
    """
    claims = read_claims(certificate) if isinstance(certificate, bytes) else certificate
    failures: list[str] = []
    if claims.problem_sha256 != problem_sha256(problem):
        failures.append("problem: the certificate is about another problem (its hash differs)")
    elif claims.problem_name != problem.name:
        failures.append("problem: its name is not what it says")
    if claims.notes[: len(problem.notes)] != problem.notes:
        failures.append("notes: those of the problem are missing or changed")
    failures += _matrix_failures(claims, problem)
    confirmed: list[Check] = []
    if not failures:
        trusted = _trusted(claims, problem)
        for check in claims.checks:
            reason = _reason(check, trusted)
            if reason is None:
                confirmed.append(check)
            else:
                failures.append(f"{check.title}: {reason}")
        failures += _overall_failures(claims, problem, confirmed)
    return Recheck(
        verdict=claims.verdict, confirmed=tuple(check.title for check in confirmed), failures=tuple(failures)
    )


def _trusted(claims: Claims, problem: Problem) -> Trusted:
    pair = None if claims.P is None or claims.Q is None else Pair(P=claims.P, Q=claims.Q)
    return Trusted(problem=problem, statements=state_theorems(problem), W=claims.W, pair=pair)


def _reason(check: Check, trusted: Trusted) -> str | None:
    try:
        return confirm(check, trusted)
    except (DobcError, ArithmeticError, ValueError, TypeError, KeyError, IndexError, AttributeError) as error:
        return f"it cannot be evaluated ({type(error).__name__}: {str(error)[:120]})"


def _matrix_failures(claims: Claims, problem: Problem) -> list[str]:
    """W must be the problem's own where it has one, P symmetric, and Q = P W."""
    q, m = problem.q, problem.m
    shapes = {"W": (claims.W, (q, m)), "P": (claims.P, (q, q)), "Q": (claims.Q, (q, m))}
    failures = [
        f"{name}: expected shape {shape}"
        for name, (matrix, shape) in shapes.items()
        if matrix is not None and (len(matrix), len(matrix[0])) != shape
    ]
    if failures:
        return failures
    own = problem.observer.W
    if own is not None and own != claims.W:
        failures.append("W: not the gain of the problem")
    source = None if claims.W is None else ("designed" if own is None else "given")
    if claims.gain_source != source:
        failures.append("W: its source is not what it says")
    if (claims.P is None) != (claims.Q is None):
        failures.append("P, Q: one of them is missing")
    elif claims.P is not None and claims.Q is not None:
        if not is_symmetric(claims.P):
            failures.append("P: not symmetric")
        elif claims.W is None or multiply(claims.P, claims.W) != claims.Q:
            failures.append("Q: not equal to P W")
    return failures


def _overall_failures(claims: Claims, problem: Problem, confirmed: Sequence[Check]) -> list[str]:
    found = [(check.id, check.mode) for check in claims.checks]
    expected = expected_checks(problem)
    if len(set(found)) != len(found):
        return ["verdict: a check stands there twice"]
    missing = [f"{id} ({mode})" if mode else id for id, mode in expected if (id, mode) not in found]
    if missing:
        return [f"verdict: the certificate lacks {', '.join(missing)}"]
    failures = []
    proofs = [check for check in claims.checks if check.id in ("theorem1", "theorem2")]
    if claims.P is not None and not any(check.verdict is Verdict.PROVED for check in proofs):
        failures.append("P, Q: they belong to no proof")
    overall = decide_overall(problem, confirmed, claims.W)
    if overall.verdict is not claims.verdict:
        failures.append(
            f"verdict: {claims.verdict.value} does not follow from the confirmed checks ({overall.verdict.value} does)"
        )
    if (overall.rate, overall.covered_by) != (claims.rate, claims.covered_by):
        failures.append("rate, covered_by: not what the confirmed checks give")
    return failures
