"""The linearised loop (22) at the target, decided exactly: its eigenvalues are those of J - K and
of A - WC.

Both Hurwitz: all agents converge from close enough starts, whatever the signs of the slopes
(theory, section 10).  An eigenvalue of J - K with positive real part: consensus fails in every
neighbourhood.
"""

from functools import partial

from dobc_design.conditions.check import Check, differs
from dobc_design.conditions.consensus.claim import Statements, Unstable
from dobc_design.conditions.consensus.decide import linear_part, unstable_roots
from dobc_design.conditions.numbers import claimed, largest_proved, text_below
from dobc_design.conditions.observer.decide import error_matrix, hurwitz_with_rate
from dobc_design.exact.matrix import Matrix
from dobc_design.verdict import Verdict

ID = "linearisation"


def linearisation_check(statements: Statements, W: Matrix | None, *, estimate: float) -> Check:
    """Decide whether J - K and A - WC, for the gain W (q, m), are Hurwitz; ``estimate`` (1/s) is a
    proposed rate."""
    check = partial(Check, id=ID, domain=statements.domain)
    undecided = partial(check, verdict=Verdict.UNDECIDED)
    loop = statements.loop
    without = statements.jacobians is None or loop.gap > 0 or loop.is_sampled
    if statements.inapplicable is not None and without:
        return undecided(reason=statements.inapplicable, applies=False)
    # Of several modes eigenvalues say nothing: only a common V does.
    if len(statements.lambdas) > 1:
        reason = (
            "does not apply: several modes may be stable one by one and unstable under switching."
        )
        return undecided(reason=reason, applies=False)
    (mode,) = statements.lambdas
    matrix = linear_part(statements, mode)
    if matrix is None:
        reason = "does not apply: it is decided for rational slopes and up to 60 states n m."
        return undecided(reason=reason, applies=False)
    # The linearised loop is block triangular: its eigenvalues are those of these parts.
    parts = decaying_parts(statements, W, matrix)
    if parts is None:
        return undecided(reason="there is no observer gain W.")
    rate = largest_proved(estimate, lambda b: all(hurwitz_with_rate(part, b) for part in parts))
    if rate is not None:
        pace = f", at every rate below {text_below(rate)} 1/s" if rate else ""
        reason = (
            "every eigenvalue of the linearised loop has a negative real part: the errors "
            f"decay {statements.where}{pace}."
        )
        return check(verdict=Verdict.PROVED, rate=rate or None, reason=reason)
    roots = unstable_roots(statements, mode)
    if roots:
        reason = f"{roots} eigenvalue(s) of the linearised network have a positive real part."
        return check(verdict=Verdict.REFUTED, reason=reason, claim=Unstable(roots=roots))
    return undecided(
        reason="no eigenvalue is proved to have a positive real part, and not all have a negative "
        "one."
    )


def decaying_parts(statements: Statements, W: Matrix | None, matrix: Matrix) -> list[Matrix] | None:
    """What has to be Hurwitz: J - K, and A - WC with an exosystem; None where that has no W."""
    exosystem = statements.loop.joint_exosystem
    if exosystem is None:
        return [matrix]
    if W is None:
        return None
    return [matrix, error_matrix(exosystem, W)]


def confirm(check: Check, statements: Statements, W: Matrix | None) -> str | None:
    """None if the claim holds, else what does not."""
    if check.domain != statements.domain or check.margin is not None:
        return f"the domain must be {str(statements.domain)!r}, and there is no margin"
    # Everything but the rate, which was an estimate of floating point, is decided once more.
    own = linearisation_check(statements, W, estimate=0.0)
    if (reason := differs(check, own)) is not None or check.rate is None:
        return reason
    if not check.is_proved:
        return "without a proof there is no rate"
    (mode,) = statements.lambdas
    matrix = linear_part(statements, mode)
    parts = None if matrix is None else decaying_parts(statements, W, matrix)
    rate = claimed(check.rate)
    if parts is None or not all(hurwitz_with_rate(part, rate) for part in parts) or rate <= 0:
        return f"the rate {check.rate} is not reached"
    return None
