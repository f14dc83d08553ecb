"""Certified regions side by side: nouns for what a certificate says about starts.

``gathering.certified_regions`` makes them.  Sizes and rates are rounded down, times and what is asked up, so that
what is shown stays a claim that holds.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from dobc_design._show.cards import Card, Shown
from dobc_design._show.text import significant_towards_zero
from dobc_design.conditions.check import Check
from dobc_design.verdict import Verdict


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """The region of the problem: |e|_inf <= box, which the ball |e| <= ball holds; |eps_i| <= disturbance.

    ``interval``: the states x_i(0) asked for where they have one component, else None.
    """

    box: float
    ball: float
    disturbance: float
    interval: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class RegionClaim:
    """What one condition says about starts.

    ``kind``: "everywhere", "box", "ball", "near" (local, no radius) or "none" (nothing proved).  Every start with
    |e|_inf <= box is covered, and every one with |e| <= ball (Euclidean, all agents stacked), where |eps_i| <=
    ``disturbance``.  ``rate`` in 1/s.  ``time`` (s): from then on |e|_inf <= the tolerance.  ``limit``: why no more.
    """

    id: str
    variant: str
    verdict: Verdict
    kind: str
    box: float | None = None
    ball: float | None = None
    disturbance: float | None = None
    rate: float | None = None
    time: float | None = None
    covers: bool = False
    limit: str = ""

    def to_json(self) -> dict[str, Any]:
        """JSON object."""
        return {
            "id": self.id,
            "variant": self.variant,
            "verdict": self.verdict.value,
            "kind": self.kind,
            "box": self.box,
            "ball": self.ball,
            "disturbance": self.disturbance,
            "rate": self.rate,
            "time": self.time,
            "covers": self.covers,
            "limit": self.limit,
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class AgentBound:
    """One agent of the max-separable certificate: starts with |e_i| <= bound for all agents at once are covered.

    ``goal``: where it is to go, None with several state components.
    """

    label: str
    bound: float
    pinned: bool
    goal: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Regions(Shown):
    """The certified regions of one problem, in the order in which they were tried.

    ``tolerance`` belongs to the times of ``claims`` (same unit as the states); ``agents`` to the max-separable
    certificate, empty without one or above 2000 agents.  ``delay``, ``sampling``, ``settling`` and ``equilibrium``
    are the checks of these ids.
    """

    name: str
    verdict: Verdict
    reason: str
    asked: Asked | None
    tolerance: float | None
    claims: tuple[RegionClaim, ...]
    agents: tuple[AgentBound, ...]
    delay: Check | None
    sampling: Check | None
    settling: Check | None = None
    equilibrium: Check | None = None

    @property
    def tried(self) -> bool:
        """Whether a region was asked for, or anything was said about one."""
        others = any(claim.kind != "near" for claim in self.claims)
        return self.asked is not None or others or self.equilibrium is not None

    @property
    def sized(self) -> bool:
        """Whether there is anything to be drawn: a region asked for, or one that is proved."""
        return self.asked is not None or any(claim.kind not in ("near", "none") for claim in self.claims)

    @property
    def rest(self) -> float | None:
        """About how far from the goals another equilibrium lies, |e|_inf, where one is proved."""
        found = self.equilibrium
        if found is None or found.verdict is not Verdict.REFUTED or found.witness is None:
            return None
        return max((abs(float(Fraction(value))) for value in found.witness.values or ()), default=None)

    def to_json(self) -> dict[str, Any]:
        """JSON object: numbers rounded towards the weaker claim."""
        asked = self.asked
        return {
            "asked": None
            if asked is None
            else {"box": asked.box, "ball": asked.ball, "disturbance": asked.disturbance},
            "tolerance": self.tolerance,
            "regions": [claim.to_json() for claim in self.claims],
            "agents": [{"label": a.label, "bound": a.bound, "pinned": a.pinned} for a in self.agents],
            **{name: None if check is None else check.to_json() for name, check in self._others()},
        }

    def _others(self) -> Iterator[tuple[str, Check | None]]:
        yield from (("settling", self.settling), ("delay", self.delay), ("sampling", self.sampling))
        yield "equilibrium", self.equilibrium

    def __str__(self) -> str:
        head = f"{self.name}: {self.verdict.value.upper()}. {self.reason}"
        return "\n".join([head, *("  " + "  ".join(cells).rstrip() for cells in _aligned(self._cells()))])

    def _cells(self) -> list[list[str]]:
        rows = [["method", "kind", "|e|_inf <=", "|e| <=", "rate 1/s", "covers"]]
        for claim in self.claims:
            sizes = [significant_towards_zero(claim.box), significant_towards_zero(claim.ball)]
            yes = "yes" if claim.covers else "no" if self.asked is not None else ""
            rows.append([title_of(claim), claim.kind, *sizes, significant_towards_zero(claim.rate), yes])
        return rows

    def _card(self) -> Card:
        head, *body = self._cells()
        return Card(title=self.name, verdict=self.verdict.value, text=self.reason, heads=head, rows=body)

    def __repr__(self) -> str:
        return f"<Regions of {self.name}: {self.verdict.value}, {len(self.claims)} methods>"


def title_of(claim: RegionClaim) -> str:
    """The id, and the variant where there is one."""
    return claim.id if not claim.variant else f"{claim.id}, {claim.variant}"


def _aligned(rows: list[list[str]]) -> Iterator[list[str]]:
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    return ([cell.ljust(width) for cell, width in zip(row, widths, strict=True)] for row in rows)
