"""A whole design, and a trade-off of designs: what is asked, what was decided and why, what each
limit costs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING, Any

from dobc_design._show.cards import MOST_ITEMS, Card, Headed, listed
from dobc_design._show.text import significant_away_from_zero, significant_towards_zero
from dobc_design.certificate.certificate import Certificate
from dobc_design.errors import SpecError
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.number import float_above, number_text
from dobc_design.exact.reading import counted
from dobc_design.problem.canonical import matrix_text
from dobc_design.problem.changes import typed_number
from dobc_design.problem.problem import Problem
from dobc_design.synthesis.observer.claim import Answer, NoiseLimit, ObserverDesign, read_noise
from dobc_design.synthesis.pinning.claim import check_yes_or_no, read_all, read_request
from dobc_design.verdict import Verdict

if TYPE_CHECKING:
    import pandas as pd


AXES = {
    "gain": ("rate, 1/s", "sum of the gains, 1/s"),
    "pins": ("pinned agents", "rate, 1/s"),
    "noise": ("decay of the estimate's error, 1/s", "largest gain from noise to dhat, 1/s"),
}
NO_LIMITS = "no limits, and every agent may be pinned"


@dataclass(frozen=True, slots=True, kw_only=True)
class DesignRequest:
    """What W and the gains k_i have to do together, so that everything the problem asks is proved.
    ``rate`` (1/s): the certified rate has to be at least that; None leaves it open.  ``allowed``:
    agent indices, rising.  ``caps``: the largest k_i (1/s) of agents that have one.  ``pins``: at
    most so many agents, None for as few as it takes. ``noise``: bounds on norms of the observer.
    ``digits``: significant digits of W and of the gains. ``reduce``: an exosystem that C does not
    see whole may be replaced by its observable part.  ``coupling``: h is designed, too."""

    rate: Fraction | None
    allowed: tuple[int, ...]
    caps: Mapping[int, Fraction]
    pins: int | None
    noise: tuple[NoiseLimit, ...]
    digits: int
    reduce: bool
    conservative: bool = False
    coupling: bool = False

    def limits(self, labels: Sequence[str]) -> Iterator[tuple[str, str]]:
        """Every limit that was set, as the name of the argument and its value in words."""
        if self.rate is not None:
            yield "rate", f"a certified rate of at least {typed_number(self.rate)} 1/s"
        if self.pins is not None:
            yield "pins", f"at most {counted(self.pins, 'pinned agent')}"
        if self.caps:
            ends = sorted({min(self.caps.values()), max(self.caps.values())})
            yield "max_gain", f"gains up to {' to '.join(str(typed_number(k)) for k in ends)}"
        if len(self.allowed) < len(labels):
            named = ", ".join(labels[i] for i in self.allowed[:8]) + (
                ", ..." if len(self.allowed) > 8 else ""
            )
            yield "allowed", f"pins on {named} only"
        for limit in self.noise:
            yield "noise", str(limit)
        if not self.reduce:
            yield "reduce", "the exosystem kept as it is"
        if self.conservative:
            yield "conservative", "V = e'e near the target"
        if self.coupling:
            yield "coupling", "a coupling of the design's own"


def read_design_request(
    labels: Sequence[str], *, rate: Any = None, noise: Any = None, reduce: Any = True, **asked: Any
) -> DesignRequest:
    """Read the arguments of ``design``, exactly.  Raises: SpecError that names every wrong one."""
    pinning = partial(read_request, labels, rate=1 if rate is None else rate, **asked)
    cure = "True lets the observable part take the exosystem's place."
    found, limits, _ = read_all(
        pinning, lambda: read_noise(noise), lambda: check_yes_or_no(reduce, "reduce", cure=cure)
    )
    own = {
        "allowed": found.allowed,
        "caps": found.caps,
        "digits": found.digits,
        "noise": limits,
        "reduce": reduce,
    }
    own["conservative"] = found.conservative
    pins = found.pins if isinstance(found.pins, int) else None
    return DesignRequest(rate=None if rate is None else found.rate, pins=pins, **own)


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Design(Answer):
    """An observer gain, pinned agents and gains, and what is known of them.

    ``verdict``: PROVED, everything that the problem asks is proved for ``problem``, with these
    rounded numbers, and ``certificate`` shows it; REFUTED, nothing can do what was asked, and
    ``reason`` is the proof in words; UNDECIDED, neither was shown.  ``W`` (q, p), ``P`` (q, q) and
    ``gains`` (1/s, by label) are exact; ``rate`` (1/s) is the certified rate and ``cost`` the sum
    of the gains; of agents with [dynamics] these are multiples of the coupling. ``decisions``: what
    was chosen and why; ``prices``: what each limit costs, about, and the time to one percent beside
    that of the file's gains.  ``observer``: W with what is proved of it.  ``changes``: the keys of
    the problem file that were set (None: removed).  ``nearest``: the design for the nearest request
    that was proved possible, where this one was not.
    """

    request: DesignRequest
    labels: tuple[str, ...]
    W: Matrix | None = None
    P: Matrix | None = None
    gains: Mapping[str, Fraction]
    rate: float | None = None
    cost: Fraction | None = None
    decisions: tuple[str, ...] = ()
    prices: tuple[str, ...] = ()
    changes: Mapping[str, Any]
    problem: Problem | None = None
    certificate: Certificate | None = None
    observer: ObserverDesign | None = None
    nearest: Design | None = None

    @property
    def binding(self) -> str | None:
        """The limit that a refuted request fails by, as the argument is called; None where nothing
        was refuted."""
        names = {"structure": "allowed", "detectable": "reduce", "gain": "noise"}
        kind = (
            self.statements[0].kind if self.verdict is Verdict.REFUTED and self.statements else None
        )
        return None if kind is None else names.get(kind, kind)

    @property
    def limits(self) -> str:
        """The limits that were set, in words."""
        return "; ".join(words for _, words in self.request.limits(self.labels)) or NO_LIMITS

    def __str__(self) -> str:
        lines = [f"{self.verdict.value}: {self.reason}"]
        lines += [f"  {sentence}" for sentence in (*self.decisions, *self.prices)]
        if self.nearest is not None:
            lines.append(f"  Nearest possible request: {self.nearest.limits}.")
        return "\n".join(lines)

    def to_json(self) -> dict[str, Any]:
        """JSON object; exact numbers as text, ``cost`` rounded up.  ``problem`` is the name of the
        problem."""
        return {
            "verdict": self.verdict.value,
            "W": None if self.W is None else matrix_text(self.W),
            "P": None if self.P is None else matrix_text(self.P),
            "gains": {label: number_text(k) for label, k in self.gains.items()},
            **({"coupling": self.changes["coupling.h"]} if "coupling.h" in self.changes else {}),
            "rate": self.rate,
            "factor": None if self.certificate is None else self.certificate.factor,
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
        facts: list[tuple[str, Any]] = [
            (name, M) for name, M in (("W", self.W), ("P", self.P)) if M is not None
        ]
        if self.gains:
            pairs = [
                f"{label}: {number_text(k)}"
                for label, k in islice(self.gains.items(), MOST_ITEMS + 1)
            ]
            facts.append(("gains in 1/s", listed(pairs, count=len(self.gains))))
        if self.rate is not None:
            facts.append(("certified rate in 1/s", significant_towards_zero(self.rate, 6)))
        if self.certificate is not None and self.certificate.factor is not None:
            facts.append(("factor of it", significant_away_from_zero(self.certificate.factor, 6)))
        facts += [("decided", sentence) for sentence in self.decisions]
        if self.nearest is not None:
            facts.append(("nearest possible", self.nearest.limits))
        return Card(
            title="Design",
            verdict=self.verdict.value,
            text=self.reason,
            facts=facts,
            lines=self.prices,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class TradePoint:
    """One design of a curve.  ``pinned``: labels of the agents; ``proved``: whether y is a proved
    bound."""

    x: float
    y: float
    pinned: tuple[str, ...] = ()
    proved: bool = False


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class TradeOff(Headed):
    """One limit of a design in terms of another.

    ``curve``: "gain" (x: rate asked, y: sum of the gains), "pins" (x: how many agents, y: the rate
    that gains there approach) or "noise" (x: decay rate of the estimate's error, y: largest gain
    from measurement noise to dhat); all in 1/s but the number of agents.  ``points``: by x.
    ``chosen``: the point of the design that was handed in, or None. ``sensitivity``: what the
    multipliers say, in sentences.
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

    def plot(self, ax: Any = None) -> Any:
        """The curve with the chosen point.  Returns: a Sheet; with Matplotlib's ``ax`` these
        axes."""
        from dobc_design.plotting.sweeps import trade_off_plot

        return trade_off_plot(self, steps=self.curve == "pins", ax=ax)

    def to_pandas(self) -> pd.DataFrame:
        """One row per point: x, y, pinned, proved, chosen.  Raises: SpecError if pandas is not
        installed."""
        try:
            import pandas as pd
        except ImportError:
            message = "to_pandas needs the package pandas, which is not installed."
            cure = "Install it (pip install dobc_design[store]), or use the points themselves."
            raise SpecError(message, key="pandas", cure=cure) from None
        rows = [(p.x, p.y, ", ".join(p.pinned), p.proved, p is self.chosen) for p in self._all()]
        return pd.DataFrame(rows, columns=[self.x_name, self.y_name, "pinned", "proved", "chosen"])

    def _all(self) -> list[TradePoint]:
        own = [] if self.chosen is None else [self.chosen]
        return sorted([*self.points, *own], key=lambda point: (point.x, point.y))

    def _card(self) -> Card:
        rows = [
            (f"{p.x:.4g}", f"{p.y:.4g}", listed(p.pinned), "chosen" * (p is self.chosen))
            for p in self._all()
        ]
        text, heads = (
            f"{self.y_name} against {self.x_name}",
            (self.x_name, self.y_name, "pinned", ""),
        )
        return Card(title=self.name, text=text, rows=rows, lines=self.sensitivity, heads=heads)
