"""Linear agents that feel their neighbours alike: V = e'(D (x) R)e for networks of any size
(theory, section 13).

All couplings have slopes g_a G at the target (B times those of h, one matrix G, g_a >= 0), and all
gains obey B K_i = k_i G, k_i >= 0.  With M = L(g) + diag(k) the errors obey e' = (I (x) A - M (x)
G) e near the target.  If

    D (M - c I) + (M - c I)'D > 0 in every mode,   R > 0,   R G = G'R >= 0,   A'R + R A - 2 c R G +
    2 rate R < 0

then V' = e'(D (x) (A'R + R A) - (D M + M'D) (x) R G) e < -2 rate V.  The first condition is that of
the weighted theorem for the network alone; and A - WC + rate I is Hurwitz, so that V + a sum
eps_i'P eps_i falls for a large enough.

Where agents agree (theory, section 16) D - pi pi' takes the place of D = diag(pi), where pi > 0 has
pi'L = 0 in every mode and the sum 1.  It is computed here, and no claim states it.  V is the sum of
pi_i pi_j (e_i - e_j)'R(e_i - e_j) over all pairs of agents: 0 iff all agree.  (D - pi pi')L = D L,
and rows of D L + L'D and of D - pi pi' add up to 0, so that the first condition is

    D L + L'D - 2 c (D - pi pi') + pi pi' > 0 in every mode
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigvalsh

from dobc_design._checks import noun
from dobc_design.conditions.consensus.claim import Statements, linearisation, state_theorems
from dobc_design.conditions.consensus.network import name_agents
from dobc_design.conditions.numbers import fields_to_json
from dobc_design.conditions.observer.decide import error_matrix, hurwitz_with_rate
from dobc_design.conditions.reason import Reason, read_reason
from dobc_design.coupling.coupling import make_coupling
from dobc_design.exact.definite import decide_positive_definite, decide_positive_semidefinite
from dobc_design.exact.matrix import (
    Matrix,
    add,
    is_symmetric,
    multiple_of,
    multiply,
    nullspace,
    scale,
    subtract,
    transpose,
)
from dobc_design.exact.number import ZERO, number_text
from dobc_design.loop.guarantee import Guarantee
from dobc_design.loop.loop import Loop, pins_of, zero_goals

from .decide import Weighted, network_holds

MOST_AGENTS = 200  # that agree: of these the exact pi, whose digits grow with them, is computed


@noun
class Alike:
    """A claim as above: ``weights`` D and w of the network alone, whose rate is ``strength`` c; R
    (m, m).  Of agents that agree there are no weights to claim."""

    weights: Weighted | None
    strength: Fraction
    R: Matrix

    def to_json(self) -> dict[str, Any]:
        """The exact values of a proved check."""
        own = {"c": number_text(self.strength), **fields_to_json(self, "R")}
        return own if self.weights is None else {**self.weights.to_json(), **own}

    def holds(self, statements: Statements, W: Matrix | None, *, rate: Fraction) -> bool:
        """Whether the claim proves V' < -2 rate V near the target, for the gain W (q, m)."""
        network = network_of(statements)
        if not isinstance(network, Network):
            return False
        # Errors of observers that decay faster than the rate are a summand of V (see above).
        exosystem = statements.loop.joint_exosystem
        if exosystem is not None and (
            W is None or not hurwitz_with_rate(error_matrix(exosystem, W), rate)
        ):
            return False
        if not holds_of_agents(self.R, network, self.strength, rate):
            return False
        if network.apart:
            return network.apart.falls(self.strength)
        return self.weights is not None and network_holds(
            self.weights, network.statements, rate=self.strength
        )


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
        forms = (tuple(map(tuple, pull - 2 * strength * self.spread)) for pull in self.pulls)
        return all(decide_positive_definite(form).is_proved for form in forms)


@noun(eq=False)
class Network:
    """M of every mode as the ``statements`` of a problem with one component; A and G (m, m);
    ``apart``: where agents agree."""

    statements: Statements
    A: Matrix
    G: Matrix
    apart: Disagreement | None


def network_of(statements: Statements) -> Network | Reason:
    """The network of agents with dynamics, or why they do not feel their neighbours alike."""
    loop = statements.loop
    drift = loop.drift
    # Agents that agree have slopes, too, but no target.
    if statements.inapplicable is not None and not loop.agrees:
        return read_reason(statements.inapplicable)
    if drift is None:
        return Reason(head="agents have no dynamics.", applies=False)
    if loop.agrees and not loop.is_linear:
        return Reason(head="it is for linear couplings and agents.", applies=False)
    arcs = (f for place, f in enumerate(loop.functions) if place != drift.place)
    slopes = [function.jacobian_at_zero() for function in arcs]
    if not all(x.is_point for each in slopes for row in each for x in row):
        head = "a slope of a coupling at the target is not rational."
        return Reason(head=head, applies=False)
    # All have to be multiples of the first that is not 0.
    blocks = [tuple(tuple(x.lo for x in row) for row in each) for each in slopes]
    G = next((each for each in blocks if any(map(any, each))), None)
    if G is None:
        return Reason(head="couplings have no slope at the target.", applies=False)
    parts = [multiple_of(each, G) for each in blocks]
    gains = {i: multiple_of(K, G) for i, K in loop.pins.gains.items()}
    if any(part is None or part < 0 for part in (*parts, *gains.values())):
        head = "couplings and gains are not multiples of one matrix."
        return Reason(head=head, applies=False)
    if drift.place is not None:
        parts.insert(drift.place, ZERO)  # which no arc has
    alone = state_theorems(_scalar_loop(loop, parts, gains))
    apart = disagreement_of(alone) if loop.agrees else None
    if isinstance(apart, str):
        return Reason(head=apart, applies=False)
    return Network(statements=alone, A=drift.A, G=G, apart=apart)


def _scalar_loop(
    loop: Loop, parts: Sequence[Fraction | None], gains: Mapping[int, Fraction | None]
) -> Loop:
    """The same network with one component and linear functions, place by place ``parts`` y."""
    functions = [make_coupling(f"({number_text(part or ZERO)})*y", dimension=1) for part in parts]
    # of equal functions the first, as in a problem
    different = tuple(dict.fromkeys(functions))
    places = [different.index(function) for function in functions]
    pins = pins_of({i: ((part or ZERO,),) for i, part in gains.items()})
    return replace(
        loop,
        m=1,
        functions=different,
        exceptions={arc: places[place] for arc, place in loop.exceptions.items()},
        pins=pins,
        pulls=pins,
        drift=None,
        groups=(),
        goals=zero_goals(1),
        starts=None,
        guarantee=Guarantee(kind="arbitrary"),
        uncertainty=None,
        actuators=None,
        xi0=None,
    )


def disagreement_of(network: Statements) -> Disagreement | str:
    """The forms of the network alone, or why there are none."""
    n = network.loop.n
    if network.jacobians is None or n > MOST_AGENTS:
        return f"it is decided for up to {MOST_AGENTS} agents."
    tables = []
    for mode in network.jacobians.modes:
        if mode.pulls.gains or not (mode.is_point and mode.is_nonnegative_diagonal):
            return "it is for arcs of positive weight that are always there."
        J = np.full((n, n), ZERO)
        for place, slope in linearisation(mode, 1).items():
            J[place] = slope
        tables.append(J)
    found = nullspace(tuple(map(tuple, np.hstack(tables).T)))
    if not found:
        return "the modes keep different weighted means of the states."
    # Of an agent that does not reach all others pi is 0, or pi is not the only one.
    named = zip(network.loop.labels, transpose(found), strict=True)
    unheard = [label for label, entries in named if not all(entries)]
    if unheard:
        return (
            f"{name_agents(unheard)} cannot be heard by all others: a graph is not strongly "
            "connected."
        )
    pi = np.array(found[0]) / sum(found[0])
    outer = np.outer(pi, pi)
    pulled = (pi[:, None] * J for J in tables)
    return Disagreement(
        spread=np.diag(pi) - outer, pulls=tuple(outer - each - each.T for each in pulled)
    )


def holds_of_agents(R: Matrix, network: Network, strength: Fraction, rate: Fraction) -> bool:
    """The three conditions on R."""
    # Neighbours pull with R G: it has to be symmetric and >= 0.
    RG = multiply(R, network.G)
    if not is_symmetric(R) or len(R) != len(network.A) or not is_symmetric(RG):
        return False
    RA = multiply(R, network.A)
    pulled = subtract(add(RA, transpose(RA)), scale(2 * strength, RG))
    F = add(pulled, scale(2 * rate, R))
    # R > 0 and A'R + R A - 2 c R G + 2 rate R < 0
    forms = (decide_positive_definite(matrix) for matrix in (R, scale(-1, F)))
    return all(form.is_proved for form in forms) and decide_positive_semidefinite(RG).is_proved
