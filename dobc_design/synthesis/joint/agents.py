"""Gains and couplings of agents with [dynamics], in floating point: ``certify`` decides (theory,
section 13).

Gains are multiples of the coupling, so that pins and gains are those of the network alone.  If D M
+ M'D > 2 c D for it, R > 0 with A'R + R A - 2 c R G + 2 rate R < 0 proves the rate, G = B h'(0).
For a coupling h(y) = B'R y, R comes from the Riccati equation, scaled down as far as the rate
allows, and from a semidefinite program in R^-1.
"""

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from functools import partial
from itertools import product
from typing import Any

import numpy as np
from scipy import linalg

from dobc_design.conditions.consensus.claim import state_theorems
from dobc_design.conditions.consensus.propose import decay_of
from dobc_design.conditions.numbers import bisected
from dobc_design.conditions.observer.propose import half_rate, kalman_gain
from dobc_design.conditions.reason import Reason
from dobc_design.conditions.statement import Statement, refuted, undecided
from dobc_design.conditions.weighted.network import Network, network_of
from dobc_design.conditions.weighted.propose import GIVEN_UP, proposals, stiffness
from dobc_design.conditions.weighted.propose_alike import Forms
from dobc_design.coupling.coupling import make_coupling
from dobc_design.exact.matrix import Array, Matrix, multiply, scale, to_float, transpose
from dobc_design.exact.number import typed_number
from dobc_design.exact.observability import decide_detectable
from dobc_design.exact.polynomial import (
    characteristic_polynomial,
    count_right_half_plane,
    routh,
    shifted,
)
from dobc_design.exact.reading import Document, Table
from dobc_design.loop.make import loop_of
from dobc_design.loop.timing import middle_of
from dobc_design.problem.changes import typed_matrix
from dobc_design.problem.dynamics import Dynamics
from dobc_design.problem.problem import Problem
from dobc_design.solvers import conic
from dobc_design.solvers.program import round_matrix
from dobc_design.synthesis.pinning.claim import Gains, Structure, holding
from dobc_design.synthesis.pinning.decide import structural_obstacle
from dobc_design.verdict import Verdict

from .claim import DesignRequest

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
    found = structural_obstacle(problem, request.pins, structure)
    dynamics = problem.dynamics
    if dynamics is None:
        return found
    (A, bend) = dynamics.about(problem.target)
    unreached = _unreached(A, dynamics.B, request.rate or Fraction(0), bent=bend is not None)
    if unreached is not None:
        return unreached
    if found is not None:
        # Agents that settle by themselves, or by what f has beside its slopes, need no pin.
        settled = routh(characteristic_polynomial(A)).is_proved
        if settled or bend is not None:
            return replace(found, verdict=Verdict.UNDECIDED)
        return found
    # Gains are looked for only as multiples of one matrix (theory, section 13).
    network = network_of(state_theorems(loop_of(problem)))
    if isinstance(network, Reason) and not request.coupling:
        why = network.head.removesuffix(".")
        cure = "a coupling can be designed, too (coupling=True, --coupling)"
        return undecided("coupling", f"{why}; {cure}.")
    return None


def _unreached(A: Matrix, B: Matrix, rate: Fraction, *, bent: bool) -> Statement | None:
    """A mode of x' = A x that no input reaches and that is slower than the rate (1/s).  ``bent``:
    A holds the slopes of an f that has more beside them, which may make it fall."""
    hidden = decide_detectable(transpose(A), transpose(B))
    moved = shifted(hidden.unobservable_polynomial, -rate)
    if routh(moved).is_proved:
        return None
    roots = np.roots([float(x) for x in hidden.unobservable_polynomial])
    s = max(roots, key=lambda s: (s.real, s.imag))
    mode = f"{s:.4g}" if s.imag else f"{s.real:.4g}"
    falls = "does not decay"
    if rate:
        falls = f"decays no faster, and {float(rate):.4g} 1/s are asked"
    root = f"a root of {hidden.unobservable_text}"
    none = f"no input reaches the mode s = {mode} of the agents ({root})"
    text = f"{none}: whatever couplings and gains are, an error in it {falls}"
    state = refuted
    # A root on the border may be hit; it counts only where A is all there is.
    if count_right_half_plane(moved) == 0 and (rate or bent):
        state = undecided
    if state is undecided and bent:
        text += " by the slopes of f; what f is beside them is not looked at"
    return state("stabilisable", f"{text}.", polynomial=hidden.unobservable_text)


#: Gains as multiples of the coupling, by agent index, and the changes of the problem that set them,
#: and on request the coupling.
Scaled = tuple[Gains, Table]


def with_couplings(
    problem: Problem, dynamics: Dynamics, request: DesignRequest, networks: Networks
) -> Iterator[Scaled]:
    """Couplings B'R y, and gains for the network that holds with the strength R is made for."""
    A = dynamics.about(problem.target)[0]
    B = dynamics.B
    every = _couplings(to_float(A), to_float(B), float(request.rate or 0))
    if not every:
        return
    alone = Problem(network=problem.network, coupling="y")
    strength, gains = _network(alone, networks)
    if not strength:
        return
    for R, more in product(every, MORE_DIGITS):
        slopes = multiply(transpose(B), round_matrix(R / strength, request.digits + more))
        numbers = dynamics.inputs < problem.m
        own = _typed(problem, gains, None if numbers else slopes)
        coupling = {"coupling.h": _texts(slopes), "coupling.exceptions": None}
        yield gains, coupling | own


def with_strengths(
    problem: Problem, dynamics: Dynamics, request: DesignRequest, networks: Networks
) -> Iterator[Scaled]:
    """Gains for the coupling of the problem, so that the network has the strength that it needs."""
    network = network_of(state_theorems(loop_of(problem)))
    if isinstance(network, Reason):
        return
    rate = float(request.rate or 0)
    does = partial(Forms.of(network).seems_to_do, rate=FASTER * rate)
    high = next(filter(does, STRENGTHS), None)
    if high is None:
        # Of couplings on outputs there often is no R, while eigenvalues do.
        does = partial(_decays, network, FASTER * rate)
        high = next(filter(does, np.geomspace(LEAST, 1 / LEAST).tolist()), None)
    if high is None:
        return
    least = WIDE * bisected(does, high, 0.0, steps=STEPS)[0]
    # Without a rate the gains of usual networks (None) are tried, too; they come first where agents
    # hardly need any strength.
    strengths: tuple[float | None, ...] = (MORE * least, None)
    if least < LEAST:
        strengths = (None, MORE * least)
    if rate:
        strengths = (least,)
    numbers = dynamics.inputs != dynamics.felt and problem.coupling.is_linear
    # of states or outputs, the gain of one
    every = (middle_of(each.jacobian_at_zero()) for each in problem.couplings)
    slopes = next(each for each in every if any(map(any, each)))
    # The network of agents with one component as a problem, whose gains can be designed.
    loop = network.statements.loop
    alone = Problem(
        network=problem.network,
        coupling=loop.functions[0],
        exceptions={arc: loop.functions[place] for arc, place in loop.exceptions.items()},
        gains={loop.labels[i]: gain for i, gain in loop.pins.gains.items()},
    )
    for strength in strengths:
        for gains in networks(alone, strength, ()):
            yield gains, _typed(problem, gains, None if numbers else slopes)


def _decays(network: Network, rate: float, strength: float) -> bool:
    """Whether an agent that feels the target so strongly (1/s) seems to decay at the rate (1/s)."""
    return decay_of(to_float(network.A) - strength * to_float(network.G)) > rate


def _typed(problem: Problem, gains: Gains, slopes: Matrix | None) -> Document:
    """Gains as a file has them: multiples of the ``slopes`` of the coupling, or plain numbers where
    these are understood so (None)."""
    labels = problem.network.labels
    table = Document()
    for i, k in sorted(gains.items()):
        table[labels[i]] = typed_number(k) if slopes is None else typed_matrix(scale(k, slopes))
    return {"pinning.gains": table}


def _network(alone: Problem, networks: Networks) -> tuple[float, Gains]:
    """The strength of a network of integrators, and gains with which h = y over it pulls little on
    every agent; strength 0 if none was seen."""
    least = float("inf")
    best: tuple[float, Gains] = (0.0, {})
    while gains := dict(next(networks(alone, STRONGER * best[0] or None, best[1]), {})):
        held = holding(alone, gains)
        strength = next((c for _, c in proposals(state_theorems(loop_of(held)), None)), 0.0)
        diagonals = [stiffness(loop_of(held), mode).diagonal() for mode in held.network.modes]
        pull = max(float(diagonal.max()) for diagonal in diagonals)
        # The next network is asked for more strength on the same pins, until that costs more.
        if not strength or pull >= least * strength:
            break
        least = pull / strength
        best = (strength, gains)
    return best


def _couplings(a: Array, b: Array, rate: float) -> list[Array]:
    """R (m, m) that seem to do for c = 1 and the rate (1/s), the smallest gain B'R first; without a
    rate for half of what unit weights give one agent alone."""
    found = list[Array]()
    with suppress(*GIVEN_UP):
        # The gain of one agent alone is that of an observer of (A', B').
        usual = half_rate(a.T, b.T, kalman_gain(a.T, b.T))
        faster = a + float(FASTER * rate or usual) * np.eye(len(a))
        found.append(_by_riccati(faster, b))
        R = _by_program(faster, b)
        if R is not None:
            found.append(R)
    return sorted(found, key=lambda R: float(np.linalg.norm(b.T @ R)))


def _by_riccati(a: Array, b: Array) -> Array:
    """R of the Riccati equation, scaled down as far as the rate allows."""
    R = linalg.solve_continuous_are(a, b, np.eye(len(a)), np.eye(b.shape[1]))

    def holds(strength: float) -> bool:
        decay = R @ a + a.T @ R - 2 * strength * R @ b @ b.T @ R
        return bool(np.linalg.eigvalsh(decay).max() < 0)

    scaled: Array = WIDE * bisected(holds, 0.5, LEAST, steps=STEPS)[0] * R
    return scaled


def _by_program(a: Array, b: Array) -> Array | None:
    """R = s Y^-1 of the least s with Y >= I and a Y + Y a' < 2 s b b'; None without an answer."""
    m = len(a)
    units = conic.symmetric_basis(m)
    falling = [-(a @ Y + Y @ a.T) for Y in units]
    room = -1e-6 * (1 + np.abs(a).max()) * np.eye(m)
    cones = [
        conic.affine_cone([*units, 0 * a], -np.eye(m)),
        conic.affine_cone([*falling, 2 * b @ b.T], room),
        conic.Cone("nonnegative", -np.eye(1, len(units) + 1, len(units)), np.array([-LEAST])),
    ]
    linear = np.array([*(1e-6 * np.trace(Y) for Y in units), 1.0])
    answer = conic.solve_cones(linear, cones)
    if not answer.found:
        return None
    Y = np.tensordot(answer.x[:-1], units, 1)
    R: Array = WIDE * answer.x[-1] * np.linalg.inv(Y)
    return R


def _texts(slopes: Matrix) -> str | list[str]:
    """A linear coupling with these slopes (p, m), as it stands in a file."""
    m = len(slopes[0])
    names = ["y"] if m == 1 else [f"y{c + 1}" for c in range(m)]
    rows = list[str]()
    for row in slopes:
        terms = [f"({typed_number(x)})*{name}" for x, name in zip(row, names, strict=True) if x]
        rows.append(" + ".join(terms) or "0")
    texts = make_coupling(rows, dimension=m, outputs=len(rows)).texts
    return texts[0] if len(texts) == 1 else list(texts)


def weaker(problem: Problem, rate: float) -> float | None:
    """So many times all couplings and gains would keep this rate (1/s), as the eigenvalues of the
    linearisation say; None where they are not computed."""
    network = network_of(state_theorems(loop_of(problem)))
    if isinstance(network, Reason) or problem.n > MOST_AGENTS or network.apart:
        return None
    A = to_float(network.A)
    G = to_float(network.G)
    own = list[Any]()
    for mode in problem.network.modes:
        table = stiffness(network.statements.loop, mode)
        own.append(np.linalg.eigvals(table.toarray()))
    # Every eigenvalue of the network gives one loop of m states.
    pulls = np.concatenate(own)[:, None, None]

    def fast(part: float) -> bool:
        return bool(np.linalg.eigvals(A - part * pulls * G).real.max() < -rate)

    if not fast(1.0):
        return 1.0
    return bisected(fast, 1.0, 0.0, steps=STEPS)[0]
