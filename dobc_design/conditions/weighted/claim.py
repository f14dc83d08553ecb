"""Theorems 1 and 2 with weights: V = e'De + sum eps_i' P eps_i, D > 0 diagonal (theory, section 10).

With arc gains a >= 0 at the target and diagonal k >= 0, M = L(a) + K is an M-matrix.  For a rate beta let

    N = D M + M'D - 2 beta D - D (I (x) sigma I) D,        sigma >= lambda_max(S),  S = C (-Omega0 - 2 beta P)^-1 C'

N is a symmetric Z-matrix, so w > 0 with N w > 0 proves N > 0, and by the Reduction V' <= -2 beta V near the target
(linear couplings: everywhere).  One D and one P serve all modes; each mode has a w of its own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from dobc_design.conditions.check import Check, Claim, read_object
from dobc_design.conditions.numbers import is_short, read_rational, vector_from_json, vector_to_json
from dobc_design.errors import ShapeError
from dobc_design.exact.matrix import Matrix, Vector
from dobc_design.exact.symmetric import Doubles, least
from dobc_design.problem.canonical import matrix_text
from dobc_design.problem.problem import Problem


@dataclass(frozen=True, slots=True, kw_only=True)
class Weighted:
    """A claim: N w > 0 in every mode.  ``D`` and ``w[mode]`` (n m,), all > 0, entry i m + c for component c of agent i;
    ``P`` (q, q) symmetric, None without an exosystem.  Raises: ShapeError for an entry that is not > 0."""

    D: Vector | Doubles
    w: Mapping[str, Vector | Doubles]
    P: Matrix | None = None

    def __post_init__(self) -> None:
        for name, vector in (("D", self.D), *self.w.items()):
            if not len(vector) or least(vector) <= 0:
                raise ShapeError(f"{name} must have one entry > 0 per state.", key=name)

    def to_json(self) -> dict[str, Any]:
        """The exact values of a proved check."""
        values: dict[str, Any] = {
            "D": vector_to_json(self.D),
            "w": {mode: vector_to_json(vector) for mode, vector in self.w.items()},
        }
        return values if self.P is None else {**values, "P": matrix_text(self.P)}


def read_claim(check: Check, problem: Problem, W: Matrix | None) -> Claim:
    """What a proved check of this topic claims; the gain ``W`` is not needed.  Raises: KeyError, TypeError, ValueError,
    ShapeError or SpecError for anything that cannot be such a claim."""
    values = read_object(check.exact, ("D", "w", "P") if problem.groups else ("D", "w"))
    size = problem.n * problem.m
    w = {
        mode: vector_from_json(vector, size) for mode, vector in read_object(values["w"], problem.network.modes).items()
    }
    P = None
    if problem.groups:
        P = tuple(tuple(read_rational(x) for x in row) for row in values["P"])
        if not is_short(P):
            raise ValueError("P needs too long a common denominator")
    return Weighted(D=vector_from_json(values["D"], size), w=w, P=P)
