"""A check after its way through JSON, confirmed against the problem as `dobc verify` does."""

import json

from dobc_design.certificate.topics import Trusted
from dobc_design.certification.recheck import confirm
from dobc_design.conditions.check import Check, check_from_json
from dobc_design.conditions.consensus.claim import Statements
from dobc_design.conditions.domain import NEAR_TARGET, Domain
from dobc_design.exact.matrix import Matrix
from dobc_design.loop.make import loop_of
from dobc_design.problem.problem import Problem


def through_json(check: Check) -> Check:
    """The check as a file holds it."""
    return check_from_json(json.loads(json.dumps(check.to_json())))


def confirmed(
    check: Check,
    problem: Problem,
    *,
    W: Matrix | None = None,
    domain: Domain = NEAR_TARGET,
    beside: Check | None = None,
) -> str | None:
    """None, or what is wrong with a regional check; errors count as refusals.  ``beside``: the
    max-separable check."""
    read = through_json(check)
    statements = Statements(
        loop=loop_of(problem), domain=domain, jacobians=None, lambdas={}, inapplicable=None
    )
    trusted = Trusted(
        loop=loop_of(problem),
        W=W,
        domain=domain,
        checks=(beside or read,),
        statements=statements,
        pair=None,
    )
    try:
        return confirm(read, trusted)
    except (ValueError, TypeError, KeyError, ArithmeticError) as error:
        return str(error) or type(error).__name__
