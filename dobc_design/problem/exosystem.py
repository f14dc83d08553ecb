"""The generator of one agent's disturbance (eq. 12).

Every agent has its own state xi_i but the same (A, C).  Nothing is decided here; whether the pair is
detectable is the business of ``conditions.observer.decide``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dobc_design._checks import require_square
from dobc_design._show.cards import Shown
from dobc_design.errors import ShapeError, SpecError
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.reading import counted, read_matrix, shown


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Exosystem(Shown):
    """Generator of one agent's disturbance: xi' = A xi, d = C xi (eq. 12).

    Shapes: A (q, q) in 1/s, C (m, q).  Accepts nested sequences or arrays of exact numbers.
    Raises: ShapeError or SpecError naming exosystem.A or exosystem.C.
    Example:
        >>> dd.Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]]).order
        2
    """

    A: Matrix
    C: Matrix

    def __init__(self, *, A: Sequence[Sequence[Any]], C: Sequence[Sequence[Any]]) -> None:
        dynamics, output = read_matrix(A, key="exosystem.A"), read_matrix(C, key="exosystem.C")
        require_square(dynamics, name="exosystem.A")
        q = len(dynamics)
        if len(output[0]) != q:
            raise ShapeError(
                f"exosystem.C must have {counted(q, 'column')}, one per exosystem state (A is {q}x{q});"
                f" got shape ({len(output)}, {len(output[0])}).",
                key="exosystem.C",
                cure="Each row of C picks one component of the disturbance.",
            )
        object.__setattr__(self, "A", dynamics)
        object.__setattr__(self, "C", output)

    @property
    def order(self) -> int:
        """q, the number of exosystem states."""
        return len(self.A)

    @property
    def outputs(self) -> int:
        """m, the number of disturbance components."""
        return len(self.C)

    @classmethod
    def from_control(cls, system: Any) -> Exosystem:
        """Take A and C from a control.StateSpace; floats are read as their shortest decimal text.

        Raises: SpecError for a system in discrete time or without A and C.
        """
        if not hasattr(system, "A") or not hasattr(system, "C"):
            raise SpecError(
                f"exosystem must be a state-space system with A and C; got {type(system).__name__}.",
                key="exosystem",
                cure="For a transfer function: control.ss(system).",
            )
        if getattr(system, "dt", None):
            raise SpecError(
                f"exosystem must be in continuous time, xi' = A xi; got one with the time step {shown(system.dt)}.",
                key="exosystem",
                cure="Give the continuous-time system.",
            )
        return cls(A=np.asarray(system.A).tolist(), C=np.asarray(system.C).tolist())
