"""Designed pinning gains, what was proved about them, and the price of each limit in words: the nouns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from itertools import islice
from typing import Any

from dobc_design._show.cards import Card, Shown, cut, listed, plain
from dobc_design.conditions.consensus.network import name_agents
from dobc_design.conditions.numbers import shorten
from dobc_design.conditions.separable.claim import Separable
from dobc_design.conditions.statement import Statement
from dobc_design.exact.matrix import Vector
from dobc_design.exact.number import float_above, float_below, number_text
from dobc_design.problem.problem import Problem
from dobc_design.synthesis.pinning.request import PinningRequest
from dobc_design.verdict import Verdict

SHOWN = 5  # prices of one kind that are put into words
SHORT = 12  # letters of a rational that is shown as it is


@dataclass(frozen=True, slots=True, kw_only=True)
class Bound:
    """A proved lower bound of the cost at a rate, and what shows it: exact, to be multiplied out by anybody.

    ``vectors``: mode and v (n m).  ``loads``: sum_r |v_r,i|^2 of every agent.  ``cap_prices``: y_i > 0 by agent.
    ``rate_price``: at any other rate b the cost is at least value + rate_price (b - rate), by the same vectors.
    """

    value: Fraction
    rate: Fraction
    vectors: tuple[tuple[str, Vector], ...]
    loads: tuple[Fraction, ...]
    cap_prices: Mapping[int, Fraction]
    rate_price: Fraction


@dataclass(frozen=True, slots=True, kw_only=True)
class Obstacle:
    """A direction v (n m) of one mode, v'(Lambda0 - 2 K + 2 rate I) v >= 0 for all gains within the limits."""

    mode: str
    vector: Vector


@dataclass(frozen=True, slots=True, kw_only=True)
class Structure:
    """``groups``: agent indices, each group needs a pin.  ``least``: no fewer allowed agents meet all groups.

    ``exact``: so many do (``agents`` are such); False where the groups overlap in too many ways.  ``apart``: groups
    without a common agent.  ``unmet``: a group without an allowed agent, or None.
    """

    groups: tuple[tuple[int, ...], ...]
    least: int
    exact: bool
    agents: tuple[int, ...]
    apart: tuple[tuple[int, ...], ...]
    unmet: tuple[int, ...] | None


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class PinningDesign(Shown):
    """Pinning gains and what is known of them.

    ``verdict``: PROVED, ``gains`` (1/s, exact, by label) do what was asked, Lambda < -2 ``rate`` I in every mode;
    REFUTED, no gains can, and ``reason`` is the proof in words; UNDECIDED, neither was shown.  ``cost``: sum of
    cost_i k_i.  ``lower_bound``: no gains that do what was asked cost less (proved); ``bound``: the exact multipliers
    that show it for gains on the agents named in ``bound_for``.  ``prices``: what each limit costs, in words.
    ``structural_minimum``: so many pins are needed whatever the gains (None if it was not found).  ``ties``: agents
    that are as good.  ``problem``: the problem with these gains.  ``nearest``: the design for the nearest request that
    was proved possible, where this one was not.  ``radius`` and ``certificate``: of a design over a region, what is
    proved for ``problem`` there.
    """

    verdict: Verdict
    reason: str
    request: PinningRequest
    gains: Mapping[str, Fraction]
    rate: Fraction | None = None
    cost: Fraction | None = None
    lower_bound: Fraction | None = None
    bound: Bound | None = None
    bound_for: tuple[str, ...] = ()
    structural_minimum: int | None = None
    statements: tuple[Statement, ...] = ()
    prices: tuple[str, ...] = ()
    ties: tuple[str, ...] = ()
    problem: Problem | None = None
    nearest: PinningDesign | None = None
    radius: Fraction | None = None
    certificate: Separable | None = None

    @property
    def gap(self) -> float | None:
        """(cost - lower bound) / cost, rounded up: nothing that does what was asked is cheaper by more than this."""
        if self.cost is None or self.lower_bound is None or not self.cost:
            return None
        return float_above((self.cost - self.lower_bound) / self.cost)

    def __str__(self) -> str:
        lines = [f"{self.verdict.value}: {self.reason}"]
        if self.gains:
            lines.append(f"pinned: {name_agents(tuple(self.gains))}")
        lines += [f"  {statement}" for statement in self.statements]
        lines += [f"  {sentence}" for sentence in (*self.prices, *self.ties)]
        return "\n".join(lines)

    def _card(self) -> Card:
        facts: list[tuple[str, Any]] = []
        if self.gains:
            pairs = [f"{label}: {plain(k)}" for label, k in islice(self.gains.items(), 13)]
            facts.append(("gains in 1/s", listed(pairs, count=len(self.gains))))
        named = (
            ("rate in 1/s", self.rate, float_below),
            ("cost at most", self.cost, float_above),
            ("no cheaper than", self.lower_bound, float_below),
            ("radius", self.radius, float_below),
        )
        facts += [
            (name, str(value) if len(str(value)) < SHORT else repr(rounded(value)))
            for name, value, rounded in named
            if value is not None
        ]
        if self.structural_minimum is not None:
            facts.append(("pins needed at least", self.structural_minimum))
        return Card(
            title="Pinning design",
            verdict=self.verdict.value,
            text=self.reason,
            facts=facts,
            heads=("verdict", "statement"),
            rows=[(each.verdict, each.text) for each in self.statements],
            lines=(*self.prices, *self.ties),
        )

    def __repr__(self) -> str:
        return f"<PinningDesign {self.verdict.value}: {cut(self.reason)}>"

    def to_json(self) -> dict[str, Any]:
        """JSON object; exact numbers as text, bounds as numbers rounded towards the weaker claim."""
        return {
            "verdict": self.verdict.value,
            "reason": self.reason,
            "gains": {label: number_text(k) for label, k in self.gains.items()},
            "rate": None if self.rate is None else number_text(self.rate),
            "cost": None if self.cost is None else float_above(self.cost),
            "lower_bound": None if self.lower_bound is None else float_below(self.lower_bound),
            "structural_minimum": self.structural_minimum,
            "method": "consensus" if self.radius is None else "max-separable",
            "radius": None if self.radius is None else number_text(self.radius),
            "statements": [statement.to_json() for statement in self.statements],
            "prices": list(self.prices),
            "ties": list(self.ties),
            "nearest": None if self.nearest is None else self.nearest.to_json(),
        }


def without_gains(
    request: PinningRequest, structure: Structure, obstacle: Statement | None, *, radius: Fraction | None = None
) -> PinningDesign:
    """REFUTED or UNDECIDED as the statement says; UNDECIDED without one."""
    unknown = "no gains were found that are proved to reach the rate, and no proof that there are none."
    return PinningDesign(
        verdict=Verdict.UNDECIDED if obstacle is None else obstacle.verdict,
        request=request,
        gains={},
        structural_minimum=structure.least if structure.exact else None,
        reason=unknown if obstacle is None else obstacle.text,
        statements=() if obstacle is None else (obstacle,),
        radius=radius,
    )


def prices_in_words(problem: Problem, request: PinningRequest, bound: Bound, agents: Mapping[int, Any]) -> list[str]:
    """What each limit costs, from the exact multipliers: every sentence is a consequence of the lower bound.

    ``agents``: those that may have a gain in the bound.
    """
    labels = problem.network.labels
    if not bound.vectors:
        return []
    words = [
        f"Rate: a larger rate b costs at least {_down(bound.value)} + {_down(bound.rate_price)}"
        f" (b - {number_text(bound.rate)}) with gains on these agents."
    ]
    for i in sorted(bound.cap_prices, key=lambda i: (-bound.cap_prices[i], i))[:SHOWN]:
        words.append(f"Cap of agent {labels[i]}: each 1/s more of it saves at most {_up(bound.cap_prices[i])}.")
    gain = {i: load - request.costs[i] for i, load in enumerate(bound.loads) if i not in agents}
    best = [i for i in sorted(gain, key=lambda i: (-gain[i], i)) if gain[i] > 0][:SHOWN]
    if best:
        most = ", ".join(f"agent {labels[i]} at most {_up(gain[i])}" for i in best)
        words.append(f"Agents left out: each 1/s of gain would save, after its own cost, {most}.")
    elif gain:
        words.append("Agents left out: a gain on any one of them would save nothing.")
    return words


def _down(value: Fraction) -> str:
    return f"{shorten(value, digits=6):.6g}"


def _up(value: Fraction) -> str:
    return f"{float_above(value) * (1 + 1e-6):.6g}"
