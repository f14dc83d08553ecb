"""Everything the theorems say about one problem: its Jacobians, Lambda of every mode, Psi of every mode."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from dobc_design.conditions.consensus.claim import lemma1, theorem1, theorem1_of_groups
from dobc_design.conditions.consensus.jacobians import Jacobians, jacobians_at_consensus
from dobc_design.errors import SpecError
from dobc_design.exact.interval import UndefinedError
from dobc_design.exact.pencil import Pencil
from dobc_design.problem.problem import Problem


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shown:
    """lambda_max(Lambda) <= bound, proved by the vector v > 0 (n m,) of floats; 1/s."""

    vector: NDArray[np.float64]
    bound: Fraction


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Statements:
    """The conditions of one problem on one domain.

    ``lambdas``: mode -> Lambda(J), a Pencil without unknowns.  ``inapplicable``: why Lemma 1 and the
    theorems say nothing here (couplings that are not C1), or None; then ``lambdas`` is empty.  ``shown``: for modes of
    large networks, what a vector has proved about Lambda (``negative``).
    """

    problem: Problem
    domain: str
    jacobians: Jacobians | None
    lambdas: Mapping[str, Pencil]
    inapplicable: str | None
    shown: Mapping[str, Shown] = field(default_factory=dict)

    def psi(self, *, rate: Fraction = Fraction(0)) -> tuple[Pencil, ...]:
        """Psi of every mode, in the order of the modes.  Raises SpecError without an exosystem."""
        groups = self.problem.groups
        if not groups:
            raise SpecError(
                "Psi of (18) needs an [exosystem].", key="exosystem", cure="Without one, Lemma 1 is the condition."
            )
        if self.problem.is_grouped:
            labels = self.problem.network.labels
            return tuple(theorem1_of_groups(each, groups, labels, rate=rate) for each in self.lambdas.values())
        exosystem = groups[0].exosystem
        return tuple(theorem1(each, exosystem, agents=self.problem.n, rate=rate) for each in self.lambdas.values())


def state_theorems(problem: Problem) -> Statements:
    """State Lemma 1, Theorem 1 and Theorem 2 for ``problem`` at the consensus."""
    reason = _inapplicable(problem)
    if reason is None:
        try:
            jacobians = jacobians_at_consensus(problem)
        except UndefinedError as error:
            reason = f"does not apply: the coupling has no bounded derivative at the consensus ({error})."
    if reason is not None:
        return Statements(problem=problem, domain="consensus", jacobians=None, lambdas={}, inapplicable=reason)
    lambdas = {
        mode.name: lemma1(mode, problem.pinning, size=problem.n, dimension=problem.m) for mode in jacobians.modes
    }
    return Statements(problem=problem, domain=jacobians.domain, jacobians=jacobians, lambdas=lambdas, inapplicable=None)


def _inapplicable(problem: Problem) -> str | None:
    for coupling in problem.couplings:
        if coupling.nonsmooth:
            names = ", ".join(coupling.nonsmooth)
            return (
                f'does not apply: h = "{coupling.texts[0]}" uses {names}; Lemma 1 and both theorems are for'
                " continuously differentiable couplings, and that is not shown here; use a smooth one, such as tanh for"
                " clip."
            )
    return None
