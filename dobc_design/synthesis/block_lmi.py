"""Theorems 1 and 2 as printed: the block matrix inequality (18), (28) as constraints for cvxpy.

There is one block for every mode, all with the same unknowns P and Q, at the consensus:

    Psi(J) = [[J + J' - (K + K'), I (x) C], [(I (x) C)', I (x) (P A + A'P - Q C - C'Q')]] < 0

Any solver of cvxpy may look for P and Q, also under constraints of the user's own.  What it finds
is a proposal: ``BlockLMI.certify`` rounds it and decides it exactly.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from dobc_design._show.cards import Card, Shown
from dobc_design.certificate.certificate import Certificate
from dobc_design.certification.certify import certify
from dobc_design.conditions.consensus.claim import state_theorems
from dobc_design.conditions.consensus.propose import float_lambda, largest_eigenvalue
from dobc_design.errors import SpecError, wrong
from dobc_design.exact.matrix import Array, to_float
from dobc_design.exact.number import Number, parse_number
from dobc_design.exact.reading import counted
from dobc_design.loop.loop import Loop
from dobc_design.loop.make import loop_of
from dobc_design.problem.groups import Observer
from dobc_design.problem.load import Source, load_problem
from dobc_design.problem.problem import Problem
from dobc_design.solvers.program import round_matrix

#: Rows of one block, n (m + q). Clarabel's time depends on the graph: a ring of 600 rows took 2 s,
#: 150 rows of agents that all hear each other 14 s. ``certify`` needs none of this.
MOST_ROWS: Final = 600
#: Significant digits of P and of W = P^-1 Q that are decided.
DIGITS: Final = 12


def block_lmi(problem: Source, *, margin: Number | None = None, floor: Number = 1) -> BlockLMI:
    """Theorem 1, or Theorem 2 for several modes, as a linear matrix inequality for cvxpy.

    ``problem`` is a Problem, a path or a built-in name, with n agents of m states and one exosystem
    of order q.  A solver knows no strict inequality, so the constraints say Psi <= -``margin`` I
    (1/s) in every mode and P >= ``floor`` I.  Neither loses a pair: the larger a
    is, the closer (a P, a Q) comes to the margin of the network alone, -lambda_max(J + J' - K -
    K'), and by default half of that is asked.  Constraints of your own should not fix this scale:
    norm(Q) <= 5 t with P >= t I bounds the gain, norm(Q) <= 5 alone may leave nothing.
    Returns: a BlockLMI with the cvxpy variables P (q, q) and Q (q, m).
    Raises: SpecError where the theorems do not apply (no exosystem, several of them, a coupling
    without a derivative) or a block has more than 600 rows.
    Source: paper, Theorems 1 and 2, (18) and (28); theory, section 2.
    Example:
        >>> lmi = dd.block_lmi("paper-switching")
        >>> optimum = lmi.problem().solve(solver="CLARABEL")
        >>> lmi.certify().check("theorem2-printed").verdict.value
        'proved'
    """
    stated = load_problem(problem)
    stated.require("the block matrix inequality")
    loop = loop_of(stated)
    require_theorems(loop)
    lowest = None if margin is None else float(parse_number(margin, key="margin"))
    least = float(parse_number(floor, key="floor"))
    if least <= 0:
        raise wrong("floor", "must be > 0: P >= floor I keeps P invertible.", "Leave it out for 1.")
    return BlockLMI(stated=stated, loop=loop, margin=lowest, floor=least)


def require_theorems(loop: Loop) -> None:
    """Refuse a loop whose Theorem 1 or 2 cannot be written as one block.  Raises: SpecError."""
    inapplicable = state_theorems(loop).inapplicable
    if inapplicable is not None:
        raise SpecError(f"The matrix inequality of Theorems 1 and 2 {inapplicable}", key="coupling")
    if len(loop.groups) != 1 or loop.is_grouped:
        raise wrong(
            "exosystem",
            "must be one for all agents, because (18) has one P and one Q; got "
            f"{len(loop.groups) or 'none'}.",
            "dobc_design.certify decides the theorems with a P and Q for each group.",
        )
    rows = loop.n * (loop.m + loop.groups[0].exosystem.order)
    if rows > MOST_ROWS:
        raise wrong(
            "network.agents",
            f"must be fewer: a block would have {rows} rows, and solvers take {MOST_ROWS}.",
            "dobc_design.certify decides the same without the block (theory, Reduction).",
        )


class BlockLMI(Shown):
    """The inequality of Theorem 1 or 2: cvxpy variables, constraints, and the exact decision.

    P (q, q) symmetric and Q (q, m) are cvxpy variables; ``psi``: mode -> Psi, a cvxpy expression
    with n (m + q) rows; ``constraints``: one for every mode, then P >= floor I.
    """

    def __init__(
        self, *, stated: Problem, loop: Loop, margin: float | None = None, floor: float = 1.0
    ) -> None:
        import cvxpy as cp

        exosystem = loop.groups[0].exosystem
        self.stated = stated
        self.floor = floor
        self.P = cp.Variable((exosystem.order, exosystem.order), symmetric=True, name="P")
        self.Q = cp.Variable((exosystem.order, loop.m), name="Q")
        lambdas = {mode: float_lambda(loop, mode) for mode in loop.modes}
        #: lambda_max(J + J' - K - K') of every mode, 1/s
        self.tops = {mode: largest_eigenvalue(each).value for mode, each in lambdas.items()}
        allowed = -max(self.tops.values())
        if margin is None:
            margin = max(allowed, 0.0) / 2
        self.margin = margin

        A = to_float(exosystem.A)
        C = to_float(exosystem.C)
        eye = np.eye(loop.n)
        beside = np.kron(eye, C)
        omega = self.P @ A + A.T @ self.P - self.Q @ C - C.T @ self.Q.T
        below = cp.kron(eye, omega)
        self.psi = {
            mode: cp.bmat([[each.toarray(), beside], [beside.T, below]])
            for mode, each in lambdas.items()
        }
        self.constraints = [
            *(psi << -self.margin * np.eye(self.rows) for psi in self.psi.values()),
            self.P >> floor * np.eye(exosystem.order),
        ]
        self._asked: Any = None

    @property
    def rows(self) -> int:
        """Rows of a block, n (m + q)."""
        first = next(iter(self.psi.values()))
        return int(first.shape[0])

    def problem(self, objective: Any = None, more: Sequence[Any] = ()) -> Any:
        """A cvxpy.Problem: the constraints and ``more`` of them.

        ``objective``: cvxpy.Minimize or Maximize, or an expression to be minimised; default tr P
        + |Q|^2.  Solve it with any solver that cvxpy knows for semidefinite programs.
        """
        import cvxpy as cp

        if objective is None:
            objective = cp.trace(self.P) + cp.sum_squares(self.Q)
        if not isinstance(objective, cp.problems.objective.Objective):
            objective = cp.Minimize(objective)
        self._asked = cp.Problem(objective, [*self.constraints, *more])
        return self._asked

    @property
    def W(self) -> Array | None:  # noqa: N802 - the paper's letter
        """P^-1 Q (q, m), 1/s, of the values found; None before."""
        if self.P.value is None or self.Q.value is None:
            return None
        gain: Array = np.linalg.solve(self.P.value, self.Q.value)
        return gain

    @property
    def largest(self) -> Mapping[str, float]:
        """The largest eigenvalue of Psi in every mode at the values found, 1/s; in floating
        point."""
        return {
            mode: float(np.linalg.eigvalsh(psi.value)[-1])
            for mode, psi in self.psi.items()
            if psi.value is not None
        }

    @property
    def status(self) -> str:
        """What the solver said and what its P and Q come to, in words; no proof."""
        if self._asked is None or self._asked.status is None:
            return "Not solved yet: lmi.problem().solve()."
        said = f'The solver says "{self._asked.status}"'
        largest = self.largest
        if not largest:
            return f"{said} and gives no P and Q. That is no proof that there are none."
        mode = max(largest, key=lambda each: largest[each])
        worst = largest[mode]
        if worst < 0:
            return f"{said}: Psi < 0 in floating point, largest eigenvalue {worst:.4g} 1/s."
        return (
            f"{said}, but Psi has the eigenvalue {worst:.4g} 1/s in mode {mode}: these P and Q "
            "prove nothing."
        )

    def certify(self, *, digits: int = DIGITS) -> Certificate:
        """Decide the P and Q found: rounded to ``digits``, then exactly.

        Returns: the Certificate of ``problem_with_gain``; its check ``theorem1-printed`` or
        ``theorem2-printed`` says whether P and W prove it, by how much or with which vector they
        fail.
        Raises: SpecError without values.
        """
        return certify(self.problem_with_gain(digits=digits))

    def problem_with_gain(self, *, digits: int = DIGITS) -> Problem:
        """The problem with the P found and W = P^-1 Q, rounded to ``digits``, to go on with:
        ``certify``, ``simulate``, ``design_pinning``; ``save`` of its certificate writes it as
        problem.json.

        Raises: SpecError without values.
        """
        gain = self.W
        if gain is None:
            raise SpecError("There is no P and Q to decide.", key="P", cure="Solve lmi.problem().")
        observer = Observer(
            W=round_matrix(gain, digits), P=round_matrix(self.P.value, digits), rate=None
        )
        return self.stated.replace(observer=observer)

    def __repr__(self) -> str:
        return f"{self._title}: {self._size}. {self.status}"

    @property
    def _title(self) -> str:
        theorem = 2 if len(self.psi) > 1 else 1
        return f"Matrix inequality of Theorem {theorem}"

    @property
    def _size(self) -> str:
        q, m = self.Q.shape
        blocks = counted(len(self.psi), "block")
        return f"{blocks} of {self.rows} rows, P {q} x {q} and Q {q} x {m} in all of them"

    def _card(self) -> Card:
        facts = [
            ("size", self._size),
            ("Psi at most, 1/s", -self.margin),
            ("P at least", self.floor),
        ]
        return Card(title=self._title, text=self.status, facts=facts)
