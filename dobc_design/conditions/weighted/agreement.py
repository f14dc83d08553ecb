"""How fast linear agents agree: V = e'((D - pi pi') (x) R)e, D = diag(pi) (theory, section 16).

pi > 0 has pi'L = 0 in every mode and the sum 1; it is computed here, and no claim states it.  V is
the sum of pi_i pi_j (e_i - e_j)'R(e_i - e_j) over all pairs: 0 iff all agree.  Since (D - pi pi')L
is D L, and rows of D L + L'D and of D - pi pi' add up to 0,

    D L + L'D - 2 c (D - pi pi') + pi pi' > 0

says of differences what D (M - c I) + (M - c I)'D > 0 says of errors where there is a target.
"""

from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigvalsh

from dobc_design._checks import noun
from dobc_design.conditions.consensus.claim import Statements, linearisation
from dobc_design.conditions.consensus.network import name_agents
from dobc_design.exact.definite import decide_positive_definite
from dobc_design.exact.matrix import nullspace
from dobc_design.exact.number import ZERO
from dobc_design.exact.symmetric import SparseSymmetric

MOST_AGENTS = 200  # of which the exact pi, whose digits grow with them, is computed


@noun(eq=False)
class Disagreement:
    """D - pi pi' is the ``spread``, D L + L'D + pi pi' of each mode one of ``pulls``: (n, n), of
    fractions."""

    spread: NDArray[Any]
    pulls: tuple[NDArray[Any], ...]

    def strongest(self) -> float:
        """The largest c (1/s), about."""
        spread = self.spread.astype(float)
        ends = (eigvalsh(spread, pull.astype(float))[-1] for pull in self.pulls)
        return 0.5 / float(max(ends))

    def falls(self, strength: Fraction) -> bool:
        """Whether the condition above holds in every mode for the ``strength`` c (1/s)."""
        for pull in self.pulls:
            form = tuple(map(tuple, pull - 2 * strength * self.spread))
            if not decide_positive_definite(SparseSymmetric.from_dense(form)).is_proved:
                return False
        return True


def disagreement_of(network: Statements) -> Disagreement | str:
    """The forms of a network with one component, or why there are none."""
    nodes = range(network.loop.n)
    if network.jacobians is None or len(nodes) > MOST_AGENTS:
        return f"it is decided for up to {MOST_AGENTS} agents."
    tables = []
    for mode in network.jacobians.modes:
        if mode.pulls.gains or not (mode.is_point and mode.is_nonnegative_diagonal):
            return "it is for arcs of positive weight that are always there."
        J = np.full((len(nodes), len(nodes)), ZERO)
        for place, slope in linearisation(mode, 1).items():
            J[place] = slope
        tables.append(J)
    found = nullspace(tuple(map(tuple, np.hstack(tables).T)))
    if not found:
        return "the modes keep different weighted means of the states."
    # Of an agent that does not reach all others pi is 0, or pi is not the only one.
    unheard = [i for i in nodes if not all(row[i] for row in found)]
    if unheard:
        who = name_agents(list(network.loop.named(unheard)))
        return f"not everybody hears {who}, directly or through others (strongly connected graphs)."
    pi = np.array(found[0]) / sum(found[0])
    outer = np.outer(pi, pi)
    pulled = (pi[:, None] * J for J in tables)
    return Disagreement(
        spread=np.diag(pi) - outer, pulls=tuple(outer - each - each.T for each in pulled)
    )
