"""A designed observer gain with everything that was asked, proved, measured: the noun, and what decides it.

A gain is a proposal until every statement of its request is proved for the rational W as it is written.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

from dobc_design._show.cards import Card, Shown, cut
from dobc_design.conditions.statement import Statement, decided
from dobc_design.exact.definite import decide_positive_definite, decide_positive_semidefinite
from dobc_design.exact.matrix import Matrix, add, identity, is_symmetric, multiply, scale, subtract, transpose
from dobc_design.exact.number import number_text
from dobc_design.exact.reading import shown_number
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.problem.canonical import matrix_text
from dobc_design.problem.exosystems import Exosystem
from dobc_design.synthesis.observer.norms import noise_statement, root_above
from dobc_design.synthesis.observer.request import ObserverRequest
from dobc_design.synthesis.observer.spectrum import (
    error_matrix,
    hurwitz_statement,
    region_statement,
    sampled_statements,
)
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
    |eps(t)| <= peak exp(-rate t) |eps(0)| of the statement "lyapunov". ``measures``: numbers rounded towards the weaker
    claim, in 1/s where they are rates. ``least_gain``: no W that meets the regions has a smaller |W| (proved).
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
    least_gain: float | None = None
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
            "least_gain": self.least_gain,
            "nearest": None if self.nearest is None else self.nearest.to_json(),
            **({"groups": {name: each.to_json() for name, each in self.groups.items()}} if self.groups else {}),
        }


def gain_statements(exosystem: Exosystem, W: Matrix, request: ObserverRequest) -> tuple[Statement, ...]:
    """Everything that the request asks of W (q, m), decided for W exactly; the peak is decided with a P."""
    result: list[Statement] = []
    if request.period is not None:
        result += sampled_statements(exosystem, W, period=request.period, rate=request.rate, regions=request.regions)
    else:
        F = error_matrix(exosystem, W)
        result.append(hurwitz_statement(F))
        if request.rate is not None:
            result.append(region_statement(F, request.all_regions[0], kind="rate"))
        result += [region_statement(F, region) for region in request.regions]
    if request.max_gain is not None:
        square = gain_squared(W)
        holds = square <= request.max_gain**2
        sign = "<=" if holds else ">"
        result.append(
            Statement(
                kind="gain",
                verdict=decided(holds),
                text=f"|W| {sign} {shown_number(request.max_gain)}.",
                exact={"gain_squared": number_text(square)},
            )
        )
    result += [noise_statement(exosystem, W, limit) for limit in request.noise]
    return tuple(result)


def first_proved(
    exosystem: Exosystem,
    request: ObserverRequest,
    proposals: Iterable[tuple[Matrix, str]],
    envelopes: Callable[[Matrix], Iterable[Envelope]],
) -> ObserverDesign | None:
    """The first proposed W of which everything asked is proved, with a P where one is proved; None if there is none."""
    for W, source in proposals:
        statements = gain_statements(exosystem, W, request)
        if any(statement.verdict is not Verdict.PROVED for statement in statements):
            continue
        P: Matrix | None = None
        if request.period is None:
            envelope = next((e for e in envelopes(W) if _envelope_holds(exosystem, W, e, request.peak)), None)
            if envelope is not None:
                P = envelope.P
                statements += (_envelope_statement(envelope),)
            if request.peak is not None:
                if envelope is None:
                    continue
                statements += (_peak_statement(request.peak),)
        return ObserverDesign(
            verdict=Verdict.PROVED,
            request=request,
            W=W,
            P=P,
            Q=None if P is None else multiply(P, W),
            source=source,
            statements=statements,
            measures={},
            reason="W, as it is written with its rounded entries, does everything that was asked.",
        )
    return None


def gain_squared(W: Matrix) -> Fraction:
    """|W|^2, the sum of the squares of its entries."""
    return sum((x * x for row in W for x in row), Fraction(0))


def envelope_peak(envelope: Envelope) -> float:
    """The root of upper/lower, rounded up: |eps(t)| <= peak exp(-rate t) |eps(0)|."""
    ratio = envelope.upper / envelope.lower
    return root_above(ratio)


def _envelope_holds(exosystem: Exosystem, W: Matrix, envelope: Envelope, peak: Fraction | None) -> bool:
    """P >= lower I > 0, P <= upper I, F'P + P F + 2 rate P <= 0, and upper/lower <= peak^2: exact."""
    P, F, q = envelope.P, error_matrix(exosystem, W), exosystem.order
    if envelope.lower <= 0 or not is_symmetric(P):
        return False
    if peak is not None and envelope.upper > peak * peak * envelope.lower:
        return False
    product = multiply(P, F)
    decay = scale(-1, add(add(product, transpose(product)), scale(2 * envelope.rate, P)))
    parts = (subtract(P, scale(envelope.lower, identity(q))), subtract(scale(envelope.upper, identity(q)), P), decay)
    return decide_positive_definite(SparseSymmetric.from_dense(P)).verdict is Verdict.PROVED and all(
        decide_positive_semidefinite(part).verdict is Verdict.PROVED for part in parts
    )


def _envelope_statement(envelope: Envelope) -> Statement:
    rate, peak = number_text(envelope.rate), envelope_peak(envelope)
    return Statement(
        kind="lyapunov",
        verdict=Verdict.PROVED,
        text=f"P proves |eps(t)| <= {peak:.4g} exp(-{float(envelope.rate):.4g} t) |eps(0)|."
        if envelope.rate
        else f"P proves |eps(t)| <= {peak:.4g} |eps(0)|.",
        exact={"rate": rate, "lower": number_text(envelope.lower), "upper": number_text(envelope.upper)},
    )


def _peak_statement(peak: Fraction) -> Statement:
    text = f"|eps(t)| never exceeds {shown_number(peak)} |eps(0)|."
    return Statement(kind="peak", text=text, verdict=Verdict.PROVED, exact={"peak": number_text(peak)})
