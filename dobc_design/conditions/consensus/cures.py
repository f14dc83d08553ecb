"""Cures for a network that is not held, as proposals: gains on the present pins, one more pin, several more.

Each is gains in floating point on the boundary of what is needed; ``PinProposal.rounded`` gives what a person would
type, and exact arithmetic decides whether that cures.  Also: the factor by which a given P is too small.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
from scipy import sparse

from dobc_design.conditions.consensus.choice import best_single, small_set, usual_rate
from dobc_design.conditions.consensus.pinning import Blocks, fastest_rate, for_rate, network_blocks, smallest_gains
from dobc_design.conditions.consensus.propose import float_lambda, largest_eigenvalue
from dobc_design.exact.matrix import Matrix, to_float
from dobc_design.problem.problem import Problem
from dobc_design.solvers.program import Array

ENOUGH = Fraction(51, 50)  # two digits if they ask for at most this much more than is needed, else three
Progress = Callable[[str], None]
STEPS = 80  # of a bisection


@dataclass(frozen=True, slots=True, kw_only=True)
class PinProposal:
    """Gains by agent index, about; which agents are new; the ``rivals`` of a single new one.

    ``keeps``: the gains are for the new agents alone and the present ones stay as they are; else they replace them.
    ``smallest``: the gains are the least that can do.  Otherwise smaller ones would do, and these are the least for
    half of the fastest decay that pins on these agents can give.
    """

    gains: Mapping[int, float]
    added: tuple[int, ...] = ()
    rivals: tuple[int, ...] = ()
    keeps: bool = False
    smallest: bool = True

    def is_faster_than(self, other: PinProposal) -> bool:
        """Whether this is for the same agents, for a decay that the smallest gains do not give."""
        return other.smallest and not self.smallest and (self.added, self.keeps) == (other.added, other.keeps)

    def rounded(self, *, factor: float = 1.0) -> dict[int, Fraction]:
        """The gains times ``factor``, rounded up to two or three digits."""
        return {agent: rounded_up(gain * factor) for agent, gain in sorted(self.gains.items()) if gain > 0}


def rounded_up(value: float | Fraction) -> Fraction:
    """The next number >= value > 0 with two significant digits, or three where two would ask for too much."""
    exact = Fraction(value)
    two = _ceiling(exact, 2)
    return two if two <= exact * ENOUGH else _ceiling(exact, 3)


def _ceiling(value: Fraction, digits: int) -> Fraction:
    exponent = math.floor(math.log10(value.numerator) - math.log10(value.denominator))
    unit = Fraction(10) ** (exponent - digits + 1)
    return math.ceil(value / unit) * unit


def gains_on(blocks: Blocks, agents: Sequence[int], proposal: PinProposal) -> Iterator[PinProposal]:
    """The smallest gains on these agents, then those for half of the fastest decay; nothing if no gains can do.

    ``proposal`` says what the gains are for; its own gains are not looked at.
    """
    least = smallest_gains(blocks, agents)
    if least is None:
        return
    if float(np.max(least, initial=0.0)) > 1e-9 * blocks.scale:
        yield replace(proposal, gains=_by_agent(least), smallest=True)
    rate = usual_rate(blocks, fastest_rate(blocks, agents))
    faster = smallest_gains(for_rate(blocks, rate), agents)
    if faster is not None:
        yield replace(proposal, gains=_by_agent(faster), smallest=False)


def on_present_pins(problem: Problem) -> Iterator[PinProposal]:
    """New gains on the present pins; nothing if there are none, or no gains on them can do."""
    blocks = network_blocks(problem)
    if blocks is not None and problem.pinning.agents:
        yield from gains_on(blocks, problem.pinning.agents, PinProposal(gains={}))


def one_more(problem: Problem, *, progress: Progress | None = None) -> Iterator[PinProposal]:
    """The best agent to add: beside the present gains as they are, then with all gains chosen anew."""
    for blocks, pins in _grounds(problem):
        found = best_single(blocks, problem, pins=pins, progress=progress)
        if found is not None:
            added = (found.agent,)
            proposal = PinProposal(gains={}, added=added, rivals=found.rivals, keeps=not pins)
            yield from gains_on(blocks, (*pins, *added), proposal)


def several_more(problem: Problem, *, progress: Progress | None = None) -> Iterator[PinProposal]:
    """A small set to add, likewise; last, one gain on every agent, which always does."""
    blocks = network_blocks(problem)
    if blocks is None:
        return
    added = small_set(blocks, problem, progress=progress)
    for ground, pins in _grounds(problem):
        yield from gains_on(ground, (*pins, *added), PinProposal(gains={}, added=added, keeps=not pins))
    enough = max((_row_excess(table) for table in blocks.tables), default=0.0) / 2
    gain = max(enough, blocks.scale / 8) * 1.01 or 1.0
    new = tuple(sorted(set(range(problem.n)) - set(problem.pinning.agents)))
    yield PinProposal(gains=dict.fromkeys(range(problem.n), gain), added=new, smallest=False)


def _grounds(problem: Problem) -> Iterator[tuple[Blocks, tuple[int, ...]]]:
    """What to add to: the present gains as they are; the present pins with gains still to be chosen."""
    kept = network_blocks(problem, pins=True)
    if kept is not None:
        yield kept, ()
    free = network_blocks(problem)
    if free is not None and problem.pinning.agents:
        yield free, problem.pinning.agents


def _row_excess(table: sparse.csr_array) -> float:
    """By how much the entries off the diagonal outweigh it, in the worst row (Gershgorin)."""
    diagonal = table.diagonal()
    rows = np.asarray(abs(table).sum(axis=1)).ravel() - np.abs(diagonal)
    return float(np.max(rows - diagonal, initial=0.0))


def _by_agent(gains: Array) -> dict[int, float]:
    return {agent: gain for agent, gain in enumerate(gains.tolist()) if gain > 0}


def scale_needed(problem: Problem, S: Matrix) -> float | None:
    """The factor a beyond which Lambda + I (x) S / a < 0 in every mode, about; None if Lambda < 0 fails.

    With (a P, a Q) in place of (P, Q) the border term S becomes S / a (theory, section 9).
    """
    block = to_float(S)
    weight = float(np.max(np.linalg.eigvalsh(block), initial=0.0))
    worst = 0.0
    for mode in problem.network.modes:
        table = sparse.csr_array(float_lambda(problem, mode))
        top = largest_eigenvalue(sparse.coo_array(table)).value
        if not top < 0 or not math.isfinite(weight):
            return None
        high, low = weight / -top * (1 + 1e-12), 0.0  # with m = 1 and S = s I this is the answer
        if len(block) > 1:
            border = sparse.kron(sparse.eye_array(problem.n), sparse.csr_array(block))
            low = 0.0
            for _ in range(STEPS):
                middle = (low + high) / 2
                does = middle > 0 and largest_eigenvalue(sparse.coo_array(table + border / middle)).value < 0
                low, high = (low, middle) if does else (middle, high)
        worst = max(worst, high)
    return worst
