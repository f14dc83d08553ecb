"""Gains and couplings of agents with [dynamics], in floating point: ``certify`` decides (theory,
section 13).

Gains are multiples of the coupling, so that pins and gains are those of the network alone.  If D M
+ M'D > 2 c D for it, R > 0 with A'R + R A - 2 c R G + 2 rate R < 0 proves the rate, G = B h'(0).
For a coupling h(y) = B'R y, R comes from the Riccati equation, scaled down as far as the rate
allows, and from a semidefinite program in R^-1.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from functools import partial
from itertools import product
from typing import Any

import numpy as np

from dobc_design.conditions.consensus.claim import state_theorems
from dobc_design.conditions.numbers import bisected
from dobc_design.conditions.statement import Statement, refuted, undecided
from dobc_design.conditions.weighted.network import network_of
from dobc_design.conditions.weighted.propose import GIVEN_UP, proposals, stiffness
from dobc_design.conditions.weighted.propose_alike import affine_cone, seems_to_do, symmetric_basis
from dobc_design.coupling.coupling import make_coupling
from dobc_design.exact.matrix import Matrix, multiply, scale, to_float, transpose
from dobc_design.exact.observability import decide_detectable
from dobc_design.exact.polynomial import (
    characteristic_polynomial,
    count_right_half_plane,
    routh,
    shifted,
)
from dobc_design.problem.changes import typed_matrix, typed_number
from dobc_design.problem.dynamics import Dynamics
from dobc_design.problem.integrators import as_integrators
from dobc_design.problem.problem import Problem
from dobc_design.solvers import conic
from dobc_design.solvers.program import Array, round_matrix
from dobc_design.synthesis.joint.claim import DesignRequest
from dobc_design.synthesis.pinning.claim import Gains, Structure
from dobc_design.synthesis.pinning.decide import structural_obstacle
from dobc_design.verdict import Verdict

#: (a network of integrators with one component, its rate or None, pinned agents or none named) ->
#: gains
Networks = Callable[[Problem, float | None, Iterable[int]], Iterator[Gains]]
FASTER, MORE = 1.005, 1.25  # than the rate asked; times the least strength, where no rate is asked
MORE_DIGITS = (0, 2, 5)  # of R than of the gains
# networks, one after the other; of a bisection; than the least that is seen
STRONGER, STEPS, WIDE = 1.5, 20, 1.02
MOST_AGENTS = 400  # whose eigenvalues are computed
# of couplings that agents hardly need; of networks, that are tried
LEAST, STRENGTHS = 0.01, (1.0, 1e2, 1e4, 1e6)


def obstacle(problem: Problem, request: DesignRequest, structure: Structure) -> Statement | None:
    """Why the graph, or agents with [dynamics], forbid what is asked (refuted), or why it is not
    known (undecided)."""
    found, dynamics = structural_obstacle(problem, request.pins, structure), problem.dynamics
    if dynamics is None:
        return found
    (A, bend), rate = dynamics.about(problem.target), request.rate or Fraction(0)
    hidden = decide_detectable(transpose(A), transpose(dynamics.B))
    moved = shifted(hidden.unobservable_polynomial, -rate)
    if routh(moved).verdict is not Verdict.PROVED:
        roots = np.roots([float(x) for x in hidden.unobservable_polynomial])
        s = max(roots, key=lambda s: (s.real, s.imag))
        falls = (
            f"decays no faster, and {float(rate):.4g} 1/s are asked" if rate else "does not decay"
        )
        text = (
            f"no input reaches the mode s = {f'{s:.4g}' if s.imag else f'{s.real:.4g}'} of the "
            "agents (a root of"
        )
        text += (
            f" {hidden.unobservable_text}): whatever couplings and gains are, an error in it "
            f"{falls}"
        )
        sure = count_right_half_plane(moved) > 0 or not (rate or bend)
        text += (
            "."
            if sure or bend is None
            else " by the slopes of f; what f is beside them is not looked at."
        )
        return (refuted if sure else undecided)(
            "stabilisable", text, polynomial=hidden.unobservable_text
        )
    # agents that settle by themselves, or by what f has beside its slopes, need no pin
    if found is not None:
        settled = routh(characteristic_polynomial(A)).verdict is Verdict.PROVED
        return replace(found, verdict=Verdict.UNDECIDED) if settled or bend is not None else found
    network = network_of(state_theorems(as_integrators(problem)))
    if isinstance(network, str) and not request.coupling:
        text = network.removeprefix("does not apply: ").removesuffix(".")
        return undecided(
            "coupling", f"{text}; a coupling can be designed, too (coupling=True, --coupling)."
        )
    return None


def designs(
    problem: Problem, dynamics: Dynamics, request: DesignRequest, networks: Networks
) -> Iterator[tuple[Gains, dict[str, Any]]]:
    """Gains, multiples of the coupling, and the changes of the problem that set them, and on
    request the coupling."""
    (A, _), B, rate = dynamics.about(problem.target), dynamics.B, float(request.rate or 0)

    def changed(
        gains: Gains, slopes: Matrix, texts: str | list[str] | None = None
    ) -> tuple[Gains, dict[str, Any]]:
        numbers = dynamics.inputs < problem.m and (texts is not None or problem.coupling.is_linear)
        typed = {
            i: typed_number(k) if numbers else typed_matrix(scale(k, slopes))
            for i, k in sorted(gains.items())
        }
        own = {"pinning.gains": {problem.network.labels[i]: k for i, k in typed.items()}}
        return gains, own if texts is None else {
            "coupling.h": texts,
            "coupling.exceptions": None,
        } | own

    if request.coupling:
        alone, every = (
            Problem(network=problem.network, coupling="y"),
            _couplings(to_float(A), to_float(B), rate),
        )
        c, gains = _network(alone, networks) if every else (0.0, {})
        for R, more in product(every if c else (), MORE_DIGITS):
            slopes = multiply(transpose(B), round_matrix(R / c, request.digits + more))
            yield changed(gains, slopes, _texts(slopes))
        return
    network = network_of(state_theorems(as_integrators(problem)))
    if isinstance(network, str):
        return
    does = partial(seems_to_do, symmetric_basis(network.G), network, rate=FASTER * rate)
    high = next(filter(does, STRENGTHS), None)
    if high is None:
        return
    least = WIDE * bisected(does, high, 0.0, steps=STEPS)[0]
    strengths = (None, MORE * least) if least < LEAST else (MORE * least, None)
    for strength in (least,) if rate else strengths:
        for gains in networks(network.statements.problem, strength, ()):
            yield changed(gains, multiply(dynamics.left_inverse, network.G))


def _network(alone: Problem, networks: Networks) -> tuple[float, Gains]:
    """The strength c and the gains of a network in which h = y / c pulls little on every agent; 0
    if none is seen."""
    least, best = float("inf"), (0.0, dict[int, Fraction]())
    while gains := dict(next(networks(alone, STRONGER * best[0] or None, best[1]), {})):
        held = alone.replace(gains={alone.network.labels[i]: k for i, k in gains.items()})
        strength = next((c for _, c in proposals(state_theorems(held), None)), 0.0)
        pull = max(float(stiffness(held, mode).diagonal().max()) for mode in held.network.modes)
        if not strength or pull >= least * strength:
            break
        least, best = pull / strength, (strength, gains)
    return best


def _couplings(a: Array, b: Array, rate: float) -> list[Array]:
    """R (m, m) that seem to do for c = 1 and the rate (1/s), the smallest gain B'R first; without a
    rate for half of what unit weights give one agent alone."""
    import control

    m, found = len(a), list[Array]()
    with suppress(*GIVEN_UP):
        usual = (
            -np.linalg.eigvals(
                a - b @ control.lqr(a, b, np.eye(m), np.eye(b.shape[1]))[0]
            ).real.max()
            / 2
        )
        a = a + (FASTER * rate or usual) * np.eye(m)
        R = np.asarray(control.care(a, b, np.eye(m))[0])

        def holds(strength: float) -> bool:
            return bool(
                np.linalg.eigvalsh(R @ a + a.T @ R - 2 * strength * R @ b @ b.T @ R).max() < 0
            )

        found.append(WIDE * bisected(holds, 0.5, LEAST, steps=STEPS)[0] * R)
        # The least s with Y >= I and a Y + Y a' < 2 s b b'; R = s Y^-1.
        units = conic.symmetric_basis(m)
        cones = [
            affine_cone([*units, 0 * a], -np.eye(m)),
            affine_cone(
                [*(-(a @ Y + Y @ a.T) for Y in units), 2 * b @ b.T],
                -1e-6 * (1 + np.abs(a).max()) * np.eye(m),
            ),
            conic.Cone("nonnegative", -np.eye(1, len(units) + 1, len(units)), np.array([-LEAST])),
        ]
        answer = conic.solve_cones(np.array([*(1e-6 * np.trace(Y) for Y in units), 1.0]), cones)
        if answer.found:
            found.append(WIDE * answer.x[-1] * np.linalg.inv(np.tensordot(answer.x[:-1], units, 1)))
    return sorted(found, key=lambda R: float(np.linalg.norm(b.T @ R)))


def _texts(slopes: Matrix) -> str | list[str]:
    """A linear coupling with these slopes (p, m), as it stands in a file."""
    m = len(slopes[0])
    names = ["y"] if m == 1 else [f"y{c + 1}" for c in range(m)]
    rows = [
        " + ".join(f"({typed_number(x)})*{name}" for x, name in zip(row, names, strict=True) if x)
        or "0"
        for row in slopes
    ]
    texts = make_coupling(rows, dimension=m, outputs=len(rows)).texts
    return texts[0] if len(texts) == 1 else list(texts)


def prices(problem: Problem, rate: float) -> tuple[str, ...]:
    """How much weaker couplings and gains could be at this rate (1/s), as the eigenvalues of the
    linearisation say."""
    network = network_of(state_theorems(as_integrators(problem)))
    if isinstance(network, str) or problem.n > MOST_AGENTS:
        return ()
    A, G = to_float(network.A), to_float(network.G)
    tables = [stiffness(network.statements.problem, mode) for mode in problem.network.modes]
    pulls = np.concatenate([np.linalg.eigvals(table.toarray()) for table in tables])[:, None, None]

    def fast(part: float) -> bool:
        return bool(np.linalg.eigvals(A - part * pulls * G).real.max() < -rate)

    part = bisected(fast, 1.0, 0.0, steps=STEPS)[0] if fast(1.0) else 1.0
    weaker = f"{part:.3g} times all couplings and gains would keep {rate:.4g} 1/s"
    return (f"By the eigenvalues of the linearisation, which prove nothing, {weaker}.",)
