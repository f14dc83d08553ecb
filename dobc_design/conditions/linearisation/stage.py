"""The linearisation: when it is tried."""

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from dobc_design.conditions.check import Check, limited
from dobc_design.conditions.consensus.claim import Statements
from dobc_design.conditions.consensus.decide import linear_part
from dobc_design.conditions.consensus.propose import decay_of
from dobc_design.conditions.coverage import covers
from dobc_design.errors import SpecError
from dobc_design.exact.matrix import Matrix, to_float
from dobc_design.loop.arcs import unreached
from dobc_design.loop.loop import Loop

from .decide import ID, decaying_parts, linearisation_check


def linearisation_stage(
    loop: Loop, statements: Statements, checks: Sequence[Check], W: Matrix | None
) -> list[Check]:
    """The check, where the question is local and open: one mode, all agents reached, nothing proved
    so far."""
    # Where no pin reaches an agent, other checks say so.
    if loop.switches or any(unreached(loop, [arcs]) for arcs in loop.modes.values()):
        return []
    # It says nothing of a region, and less than a proof with a Lyapunov function; but where agents
    # agree such a proof has no factor, and its rate is the lower one.
    if (loop.starts is not None and not loop.is_linear) or (
        not loop.agrees and any(covers(loop, check, checks) for check in checks)
    ):
        return []

    def decided() -> Check:
        matrix = linear_part(statements, *loop.modes) if statements.jacobians is not None else None
        parts = None if matrix is None else decaying_parts(statements, W, matrix)
        slowest = 0.0
        with suppress(SpecError, np.linalg.LinAlgError):  # beyond the floats there is no estimate
            decays = [decay_of(to_float(part)) for part in parts or ()]
            slowest = min(decays, default=0.0)
        return linearisation_check(statements, W, estimate=slowest)

    found = limited(ID, statements.domain, decided)
    return [found] if found.applies else []
