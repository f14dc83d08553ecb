"""The checks of one problem: design proposes in floating point, verify decides exactly.

Every condition that applies is run; what carries the verdict and what would cure a failure is said elsewhere.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from dobc_design.design.estimates import Top, decay_rate, directions, lambda_tops, pair_margin, pair_rate
from dobc_design.design.gain import GainDesign, design_gain
from dobc_design.design.pair import propose_pairs
from dobc_design.design.supports import witness_directions
from dobc_design.errors import DobcError
from dobc_design.exact.matrix import Matrix, multiply, to_float
from dobc_design.spec.exosystem import Exosystem
from dobc_design.spec.problem import Problem
from dobc_design.theorems.statements import Statements, state_theorems
from dobc_design.verdict import Verdict
from dobc_design.verify.check import Check
from dobc_design.verify.consensus import (
    Pair,
    Proposal,
    lemma1_check,
    psi_is_negative,
    schur_block,
    theorem_check,
)
from dobc_design.verify.network import reachability_check
from dobc_design.verify.numbers import is_writable
from dobc_design.verify.observer import detectability_check, hurwitz_check, observability_check

logger = logging.getLogger("dobc_design")
Progress = Callable[[str], None]
DOUBT = 1e-9  # an estimate of lambda_max above minus this calls for a witness


@dataclass(frozen=True, slots=True, kw_only=True)
class Decided:
    """The checks of one problem and what they are about: W, how it was designed, the pair, directions by mode."""

    checks: tuple[Check, ...]
    statements: Statements
    directions: dict[str, list[Sequence[float]]]
    design: GainDesign | None = None
    W: Matrix | None = None
    pair: Pair | None = None
    how: str = ""  # the pair came about, where not the usual way


def decide(problem: Problem, report: Progress) -> Decided:
    """Run every condition that applies; no cures."""
    report("stating the theorems")
    statements = state_theorems(problem)
    tops = _estimates(statements)
    run = _Run(problem=problem, statements=statements, tops=tops, found={})
    report("deciding network and Lemma 1")
    lemmas = run.lemmas()
    checks = [*(reachability_check(problem, mode) for mode in problem.network.modes), *lemmas]
    exosystem, W = problem.exosystem, problem.observer.W
    if exosystem is None:
        return Decided(checks=tuple(checks), statements=statements, directions=run.found)
    report("deciding the observer")
    design = None if W is not None else design_gain(exosystem, rate=problem.observer.rate)
    W = W if design is None else design.W
    first = run.observer_checks(exosystem, W)
    report("deciding the theorem")
    theorems, pair, how = run.theorem_checks(exosystem, W, lemmas, first)
    return Decided(
        checks=(*first, *checks, *theorems), statements=statements, directions=run.found, design=design, W=W,
        pair=pair, how=how,
    )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class _Run:
    """One certification: the problem, its conditions, floating-point estimates to propose from.

    ``found``: directions of few agents, filled in for the modes where Lambda < 0 looks doubtful.
    """

    problem: Problem
    statements: Statements
    tops: dict[str, Top]
    found: dict[str, list[Sequence[float]]]

    def lemmas(self) -> list[Check]:
        """Lemma 1, mode by mode."""
        checks = []
        for mode in self.problem.network.modes:
            top = self.tops.get(mode)
            if top is None or not top.value < -DOUBT:
                self.found[mode] = self.small_directions(mode)
            vectors = [*self.found.get(mode, ()), *([] if top is None else [top.vector.tolist()])]
            proposal = Proposal(margin=0.0 if top is None else -top.value, vectors=vectors)
            checks.append(lemma1_check(self.statements, mode, proposal))
        return checks

    def small_directions(self, mode: str) -> list[Sequence[float]]:
        """Directions of few agents in which Lambda may not be negative; none if a numerical library breaks down."""
        try:
            return witness_directions(self.problem, mode)
        except (ArithmeticError, RuntimeError, ValueError) as error:
            logger.warning("no small directions: %s", error)
            return []

    def observer_checks(self, exosystem: Exosystem, W: Matrix | None) -> list[Check]:
        """Observability, detectability, Hurwitz."""
        source = "given" if self.problem.observer.W is not None else "designed"
        estimate = 0.0 if W is None else decay_rate(exosystem, W)
        return [
            observability_check(exosystem, self.problem),
            detectability_check(exosystem, self.problem),
            hurwitz_check(exosystem, W, estimate=estimate, source=source, problem=self.problem),
        ]

    def theorem_checks(
        self, exosystem: Exosystem, W: Matrix | None, lemmas: Sequence[Check], observer: Sequence[Check]
    ) -> tuple[list[Check], Pair | None, str]:
        """The printed P where there is one, then the theorem with a P of our own; how that came about."""
        problem, checks = self.problem, []
        name = "theorem1" if len(problem.network.modes) == 1 else "theorem2"
        if problem.observer.P is not None and problem.observer.W is not None:
            printed = Pair(P=problem.observer.P, Q=multiply(problem.observer.P, problem.observer.W))
            checks.append(
                theorem_check(
                    f"{name}-printed", self.statements, exosystem, printed, self.proposal(printed, exosystem),
                    lemmas=lemmas, obstacle=None, printed=True,
                )
            )  # fmt: skip
        obstacle = next((c for c in observer[1:] if c.verdict is Verdict.REFUTED), None)
        blocked = obstacle is not None or any(c.verdict is not Verdict.PROVED for c in lemmas)
        pair, how = (None, "") if blocked or W is None else self.find_pair(exosystem, W)
        proposal = Proposal() if pair is None else self.proposal(pair, exosystem)
        checks.append(theorem_check(name, self.statements, exosystem, pair, proposal, lemmas=lemmas, obstacle=obstacle))
        return checks, pair, how

    def find_pair(self, exosystem: Exosystem, W: Matrix) -> tuple[Pair | None, str]:
        """The first proposed pair for which Psi < 0 is proved, and a sentence if it did not come the usual way."""
        bound = max((top.value for top in self.tops.values()), default=math.nan)
        for P, Q, how in propose_pairs(exosystem, W, bound=bound, decay=decay_rate(exosystem, W)):
            pair = Pair(P=P, Q=Q)
            S = schur_block(pair, exosystem)
            if S is not None and is_writable(P, Q, S) and psi_is_negative(self.statements, exosystem, pair):
                return pair, how
        return None, ""

    def proposal(self, pair: Pair, exosystem: Exosystem) -> Proposal:
        """Margin, rate and directions to try for a pair."""
        if not self.tops:
            return Proposal()
        try:
            P, Q = to_float(pair.P), to_float(pair.Q)
        except DobcError:  # entries too large for floats: the exact side does without
            return Proposal()
        return Proposal(
            margin=pair_margin(self.tops, P, Q, exosystem),
            rate=pair_rate(self.tops, P, Q, exosystem),
            vectors=directions(self.tops),
        )


def _estimates(statements: Statements) -> dict[str, Top]:
    """Estimates to propose from; none at all if the numerical library breaks down: the exact side then does without."""
    try:
        return lambda_tops(statements)
    except (ArithmeticError, RuntimeError, ValueError) as error:
        logger.warning("eigenvalue estimate failed: %s", error)
        return {}


def notes_of(problem: Problem, design: GainDesign | None, how: str) -> Iterator[str]:
    """What was given, assumed and designed, in sentences; ``how`` the pair came about, if not the usual way."""
    yield from problem.notes
    if problem.exosystem is None:
        yield "No exosystem was given: there is no disturbance and no observer."
    elif design is None:
        yield "The observer gain W was given."
    else:
        yield f"No W was given. {design.note[0].upper()}{design.note[1:]}"
    if how:
        yield how
    if not problem.pinning.agents:
        yield "No agent is pinned."
    if problem.observer.W is not None and problem.observer.rate is not None:
        yield "observer.rate is not used, because W was given."
    if problem.region is None and not problem.is_linear:
        yield "No region was asked for: the verdict is about the consensus itself, from close enough starts."
    if len(problem.network.modes) > 1:
        yield "The modes may switch in any way, so one V has to serve them all."
    if problem.is_linear:
        yield "Every coupling is exactly linear: what holds near the target holds everywhere."
    if problem.exceptions:
        yield f"{len(problem.exceptions)} arc(s) have a coupling of their own."
    if problem.offsets:
        yield "Agents go to the target plus their formation offset; couplings act on x - offset."
