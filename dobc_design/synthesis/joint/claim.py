"""A whole design, and a trade-off of designs: what was decided and why, what each limit costs, as text and table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from itertools import islice
from typing import TYPE_CHECKING, Any

from dobc_design._show.cards import MOST_ITEMS, Card, Shown, cut, listed
from dobc_design._show.text import significant_towards_zero
from dobc_design.certificate.certificate import Certificate
from dobc_design.conditions.statement import Statement
from dobc_design.errors import SpecError
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.number import float_above, number_text
from dobc_design.problem.canonical import matrix_text
from dobc_design.problem.problem import Problem
from dobc_design.synthesis.joint.request import DesignRequest
from dobc_design.synthesis.observer.claim import ObserverDesign
from dobc_design.verdict import Verdict

if TYPE_CHECKING:
    import pandas as pd

    from dobc_design.plotting.look import Sheet

AXES = {
    "gain": ("rate, 1/s", "sum of the gains, 1/s"),
    "pins": ("pinned agents", "rate, 1/s"),
    "noise": ("decay of the estimate's error, 1/s", "largest gain from noise to dhat, 1/s"),
}
NO_LIMITS = "no limits, and every agent may be pinned"


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Design(Shown):
    """An observer gain, pinned agents and gains, and what is known of them.

    ``verdict``: PROVED, everything that the problem asks is proved for ``problem``, with these rounded numbers, and
    ``certificate`` shows it; REFUTED, nothing can do what was asked, and ``reason`` is the proof in words;
    UNDECIDED, neither was shown.  ``W`` (q, m), ``P`` (q, q) and ``gains`` (1/s, by label) are exact; ``rate`` (1/s) is
    the certified rate and ``cost`` the sum of the gains.  ``decisions``: what was chosen and why; ``prices``: what each
    limit costs, about.  ``observer``: W with what is proved of it.  ``changes``: the keys of the problem file that were
    set (None: removed).  ``nearest``: the design for the nearest request that was proved possible, where this one was
    not.
    """

    verdict: Verdict
    reason: str
    request: DesignRequest
    labels: tuple[str, ...]
    W: Matrix | None = None
    P: Matrix | None = None
    gains: Mapping[str, Fraction]
    rate: float | None = None
    cost: Fraction | None = None
    statements: tuple[Statement, ...] = ()
    decisions: tuple[str, ...] = ()
    prices: tuple[str, ...] = ()
    changes: Mapping[str, Any]
    problem: Problem | None = None
    certificate: Certificate | None = None
    observer: ObserverDesign | None = None
    nearest: Design | None = None

    @property
    def binding(self) -> str | None:
        """The limit that a refuted request fails by, as the argument is called; None where nothing was refuted."""
        names = {"structure": "allowed", "detectable": "reduce", "gain": "noise"}
        kind = self.statements[0].kind if self.verdict is Verdict.REFUTED and self.statements else None
        return None if kind is None else names.get(kind, kind)

    def __str__(self) -> str:
        lines = [f"{self.verdict.value}: {self.reason}"]
        lines += [f"  {sentence}" for sentence in (*self.decisions, *self.prices)]
        if self.nearest is not None:
            limits = "; ".join(words for _, words in self.nearest.request.limits(self.labels)) or NO_LIMITS
            lines.append(f"  Nearest possible request: {limits}.")
        return "\n".join(lines)

    def to_json(self) -> dict[str, Any]:
        """JSON object; exact numbers as text, ``cost`` rounded up.  ``problem`` is the name of the problem."""
        return {
            "verdict": self.verdict.value,
            "W": None if self.W is None else matrix_text(self.W),
            "P": None if self.P is None else matrix_text(self.P),
            "gains": {label: number_text(k) for label, k in self.gains.items()},
            "rate": self.rate,
            "cost": None if self.cost is None else float_above(self.cost),
            "reason": self.reason,
            "problem": None if self.problem is None else self.problem.name,
            "covered_by": None if self.certificate is None else self.certificate.covered_by,
            "binding": self.binding,
            "decisions": list(self.decisions),
            "prices": list(self.prices),
            "statements": [statement.to_json() for statement in self.statements],
            "request": dict(self.request.limits(self.labels)),
            "nearest": None if self.nearest is None else self.nearest.to_json(),
        }

    def _card(self) -> Card:
        facts: list[tuple[str, Any]] = [(name, M) for name, M in (("W", self.W), ("P", self.P)) if M is not None]
        if self.gains:
            pairs = [f"{label}: {number_text(k)}" for label, k in islice(self.gains.items(), MOST_ITEMS + 1)]
            facts.append(("gains in 1/s", listed(pairs, count=len(self.gains))))
        if self.rate is not None:
            facts.append(("certified rate in 1/s", significant_towards_zero(self.rate, 6)))
        facts += [("decided", sentence) for sentence in self.decisions]
        if self.nearest is not None:
            limits = "; ".join(words for _, words in self.nearest.request.limits(self.labels))
            facts.append(("nearest possible", limits or NO_LIMITS))
        return Card(title="Design", verdict=self.verdict.value, text=self.reason, facts=facts, lines=self.prices)

    def __repr__(self) -> str:
        return f"<Design {self.verdict.value}: {cut(self.reason)}>"


@dataclass(frozen=True, slots=True, kw_only=True)
class TradePoint:
    """One design of a curve.  ``pinned``: labels of the agents; ``proved``: whether y is a proved bound."""

    x: float
    y: float
    pinned: tuple[str, ...] = ()
    proved: bool = False


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class TradeOff(Shown):
    """One limit of a design in terms of another.

    ``curve``: "gain" (x: rate asked, y: sum of the gains), "pins" (x: how many agents, y: the rate that gains there
    approach) or "noise" (x: decay rate of the estimate's error, y: largest gain from measurement noise to dhat); all in
    1/s but the number of agents.  ``points``: by x.  ``chosen``: the point of the design that was handed in, or None.
    ``sensitivity``: what the multipliers say, in sentences.
    """

    name: str
    curve: str
    points: tuple[TradePoint, ...]
    chosen: TradePoint | None
    sensitivity: tuple[str, ...]

    @property
    def x_name(self) -> str:
        """What x is, with its unit."""
        return AXES[self.curve][0]

    @property
    def y_name(self) -> str:
        """What y is, with its unit."""
        return AXES[self.curve][1]

    def __str__(self) -> str:
        lines = [f"{self.name}: {self.y_name} against {self.x_name}"]
        for point in self._all():
            marks = ", ".join(point.pinned[:8]) + (", ..." if len(point.pinned) > 8 else "")
            lines.append(
                f"  {point.x:<10.4g} {point.y:<10.4g} {'pinned ' + marks if marks else ''}".rstrip()
                + ("   <- chosen" if point is self.chosen else "")
            )
        return "\n".join([*lines, *(f"  {sentence}" for sentence in self.sensitivity)])

    def plot(self) -> Sheet:
        """The curve as a figure, with the chosen point."""
        from dobc_design.plotting.sweeps import trade_off_sheet

        return trade_off_sheet(
            [(point.x, point.y) for point in self.points],
            x_name=self.x_name,
            y_name=self.y_name,
            chosen=None if self.chosen is None else (self.chosen.x, self.chosen.y),
            name=self.name,
            steps=self.curve == "pins",
        )

    def to_pandas(self) -> pd.DataFrame:
        """One row per point: x, y, pinned, proved, chosen.  Raises: SpecError if pandas is not installed."""
        try:
            import pandas as pd
        except ImportError:
            raise SpecError(
                "to_pandas needs the package pandas, which is not installed.",
                key="pandas",
                cure="Install it (pip install dobc_design[store]), or use the points themselves.",
            ) from None
        rows: list[dict[str, Any]] = [
            {
                self.x_name: point.x,
                self.y_name: point.y,
                "pinned": ", ".join(point.pinned),
                "proved": point.proved,
                "chosen": point is self.chosen,
            }
            for point in self._all()
        ]
        return pd.DataFrame(rows, columns=[self.x_name, self.y_name, "pinned", "proved", "chosen"])

    def _all(self) -> Iterator[TradePoint]:
        own = [] if self.chosen is None else [self.chosen]
        yield from sorted([*self.points, *own], key=lambda point: (point.x, point.y))

    def _card(self) -> Card:
        rows = [
            (f"{point.x:.4g}", f"{point.y:.4g}", listed(point.pinned), "chosen" if point is self.chosen else "")
            for point in self._all()
        ]
        return Card(
            title=self.name,
            text=f"{self.y_name} against {self.x_name}",
            rows=rows,
            lines=self.sensitivity,
            heads=(self.x_name, self.y_name, "pinned", ""),
        )

    def __repr__(self) -> str:
        return f"<TradeOff of {self.name}: {self.y_name} against {self.x_name}, {len(self.points)} points>"
