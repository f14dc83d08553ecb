"""A trade-off: one limit of a design in terms of another, as points, as a figure, as a table."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from dobc_design._show.cards import Card, Shown, listed
from dobc_design.errors import SpecError

if TYPE_CHECKING:
    import pandas as pd

    from dobc_design.plotting.sheet import Sheet


@dataclass(frozen=True, slots=True, kw_only=True)
class TradePoint:
    """One design of a curve.  ``pinned``: labels of the agents; ``proved``: whether y is a proved bound."""

    x: float
    y: float
    pinned: tuple[str, ...] = ()
    proved: bool = False


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class TradeOff(Shown):
    """A Pareto curve: no design that was found is better in one quantity without being worse in the other.

    ``curve``: "gain" (x: rate, y: sum of the gains), "pins" (x: how many agents, y: the rate that gains there approach)
    or "noise" (x: decay rate of the estimate's error, y: largest gain from measurement noise to dhat); all in 1/s but
    the number of agents.  ``points``: by x.  ``chosen``: the point of the design that was handed in, or None.
    ``sensitivity``: what the multipliers say, in sentences.
    """

    name: str
    curve: str
    x_name: str
    y_name: str
    points: tuple[TradePoint, ...]
    chosen: TradePoint | None
    sensitivity: tuple[str, ...]

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
