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
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from dobc_design.conditions.consensus.claim import Statements, state_theorems
from dobc_design.conditions.observer.decide import error_matrix, hurwitz_with_rate
from dobc_design.conditions.weighted.decide import Weighted, network_holds
from dobc_design.exact.definite import decide_positive_definite, decide_positive_semidefinite
from dobc_design.exact.matrix import Matrix, add, is_symmetric, multiply, scale, subtract, transpose
from dobc_design.exact.number import number_text
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.problem.canonical import matrix_text
from dobc_design.problem.integrators import slopes_of_nodes
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

ZERO = Fraction(0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Alike:
    """A claim as above: ``weights`` D and w of the network alone, whose rate is ``strength`` c; R
    (m, m)."""

    weights: Weighted
    strength: Fraction
    R: Matrix

    def to_json(self) -> dict[str, Any]:
        """The exact values of a proved check."""
        return {**self.weights.to_json(), "c": number_text(self.strength), "R": matrix_text(self.R)}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Network:
    """M of every mode as the ``statements`` of a problem with one component; A and G (m, m)."""

    statements: Statements
    A: Matrix
    G: Matrix


def network_of(statements: Statements) -> Network | str:
    """The network of agents with dynamics, or why they do not feel their neighbours alike."""
    problem = statements.problem
    origin = problem.origin
    if origin is None or origin.dynamics is None or statements.inapplicable is not None:
        return statements.inapplicable or "does not apply: agents have no dynamics."
    slopes = [coupling.jacobian_at_zero() for coupling in problem.couplings[: problem.node]]
    if not all(x.is_point for each in slopes for row in each for x in row):
        return "does not apply: a slope of a coupling at the target is not rational."
    blocks = [tuple(tuple(x.lo for x in row) for row in each) for each in slopes]
    G = next((each for each in blocks if any(map(any, each))), None)
    if G is None:
        return "does not apply: couplings have no slope at the target."
    dynamics = origin.dynamics
    parts = [_part(each, G) for each in blocks]
    gains = {i: _part(multiply(dynamics.B, k), G) for i, k in origin.pinning.gains.items()}
    if any(part is None or part < 0 for part in (*parts, *gains.values())):
        return "does not apply: couplings and gains are not multiples of one matrix."
    alone = Problem(
        network=problem.network,
        coupling=f"({number_text(parts[0] or ZERO)})*y",
        exceptions={
            arc: f"({number_text(parts[place] or ZERO)})*y"
            for arc, place in problem.exception_places.items()
        },
        gains={problem.network.labels[i]: k for i, k in gains.items()},
    )
    return Network(statements=state_theorems(alone), A=slopes_of_nodes(problem), G=G)


def _part(M: Matrix, G: Matrix) -> Fraction | None:
    """The number g with M = g G; None if there is none."""
    pairs = [
        (x, y) for row, other in zip(M, G, strict=True) for x, y in zip(row, other, strict=True)
    ]
    g = next(x / y for x, y in pairs if y)
    return g if all(x == g * y for x, y in pairs) else None


def alike_holds(claim: Alike, statements: Statements, W: Matrix | None, *, rate: Fraction) -> bool:
    """Whether the claim proves V' < -2 rate V near the target, for the gain W (q, m)."""
    network = network_of(statements)
    if isinstance(network, str):
        return False
    exosystem = statements.problem.joint_exosystem
    if exosystem is not None and (
        W is None or not hurwitz_with_rate(error_matrix(exosystem, W), rate)
    ):
        return False
    return holds_of_agents(claim.R, network, claim.strength, rate) and network_holds(
        claim.weights, network.statements, rate=claim.strength
    )


def holds_of_agents(R: Matrix, network: Network, strength: Fraction, rate: Fraction) -> bool:
    """The three conditions on R."""
    RG = multiply(R, network.G)
    if not (is_symmetric(R) and len(R) == len(network.A) and is_symmetric(RG)):
        return False
    RA = multiply(R, network.A)
    F = add(subtract(add(RA, transpose(RA)), scale(2 * strength, RG)), scale(2 * rate, R))
    definite = all(
        decide_positive_definite(SparseSymmetric.from_dense(each)).verdict is Verdict.PROVED
        for each in (R, scale(-1, F))
    )
    return (
        definite
        and decide_positive_semidefinite(SparseSymmetric.from_dense(RG)).verdict is Verdict.PROVED
    )
