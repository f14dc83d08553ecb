"""A designed observer gain, and the bound on its transient that a matrix P proves: the nouns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

from dobc_design._show.cards import Card, Shown, cut
from dobc_design.conditions.statement import Statement
from dobc_design.exact.matrix import Matrix
from dobc_design.problem.canonical import matrix_text
from dobc_design.synthesis.observer.request import ObserverRequest
from dobc_design.verdict import Verdict


@dataclass(frozen=True, slots=True, kw_only=True)
class Envelope:
    """A proposed P (q, q), a rate (1/s) and bounds of P: lower I <= P <= upper I."""

    P: Matrix
    rate: Fraction
    lower: Fraction
    upper: Fraction


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class ObserverDesign(Shown):
    """An observer gain and what is known of it.

    ``verdict``: PROVED, ``W`` does everything that was asked; REFUTED, nothing can, and ``reason`` is the proof in
    words; UNDECIDED, none was found. ``W`` (q, m), ``P`` (q, q) and ``Q`` = P W are exact; P proves the envelope
    |eps(t)| <= k exp(-rate t) |eps(0)| of the statement "lyapunov". ``measures``: numbers rounded towards the weaker
    claim, in 1/s where they are rates.
    ``nearest``: the design for the nearest request that was proved possible, where this one was not.
    ``groups``: where agents have different exosystems, the design of every group by its name; W, P and Q then are
    block diagonal, and a measure is that of the worst group.
    """

    verdict: Verdict
    reason: str
    request: ObserverRequest
    W: Matrix | None = None
    P: Matrix | None = None
    Q: Matrix | None = None
    source: str | None = None
    statements: tuple[Statement, ...] = ()
    measures: Mapping[str, float]
    nearest: ObserverDesign | None = None
    groups: Mapping[str, ObserverDesign] = field(default_factory=dict)

    def __str__(self) -> str:
        lines = [f"{self.verdict.value}: {self.reason}"]
        if self.groups:
            own = [f"Group of agent {name}: {design}" for name, design in self.groups.items()]
            return "\n".join([*lines, *own])
        if self.W is not None:
            lines.append(f"W = {matrix_text(self.W)} ({self.source})")
        lines += [f"  {statement}" for statement in self.statements]
        return "\n".join(lines)

    def _card(self) -> Card:
        matrices = (("W", self.W), ("P", self.P), ("Q", self.Q))
        facts: list[tuple[str, Any]] = [(name, M) for name, M in matrices if M is not None]
        facts += [(name.replace("_", " "), repr(value)) for name, value in self.measures.items()]  # bounds: no rounding
        rows = [(each.verdict, each.text) for each in self.statements]
        return Card(
            title="Observer design",
            verdict=self.verdict.value,
            text=self.reason,
            facts=facts,
            heads=("verdict", "statement"),
            rows=rows,
        )

    def __repr__(self) -> str:
        return f"<ObserverDesign {self.verdict.value}: {cut(self.reason)}>"

    def to_json(self) -> dict[str, Any]:
        """JSON object; exact numbers as text, infinite ones as null."""
        finite = {name: value for name, value in self.measures.items() if abs(value) < float("inf")}
        return {
            "verdict": self.verdict.value,
            "reason": self.reason,
            "source": self.source,
            "W": None if self.W is None else matrix_text(self.W),
            "P": None if self.P is None else matrix_text(self.P),
            "Q": None if self.Q is None else matrix_text(self.Q),
            "statements": [statement.to_json() for statement in self.statements],
            "measures": {name: finite.get(name) for name in self.measures},
            "nearest": None if self.nearest is None else self.nearest.to_json(),
            **({"groups": {name: each.to_json() for name, each in self.groups.items()}} if self.groups else {}),
        }
