"""One checked condition: its verdict, where it holds, with which margin, and why.

A Check is what a certificate consists of.  ``evidence`` is what somebody else needs to confirm it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from dobc_design.verdict import Verdict

CHECK_IDS = (
    "observability", "detectability", "hurwitz", "reachability", "lemma1", "theorem1", "theorem2",
    "theorem1-printed", "theorem2-printed", "lure", "max-separable", "delay", "sampling",
)  # fmt: skip

#: The checks whose proof is a proof of consensus.
CONSENSUS_IDS = ("lemma1", "theorem1", "theorem2", "theorem1-printed", "theorem2-printed", "lure", "max-separable")

Domain = str | Mapping[str, Any]  # "global", "consensus", or {"kind", "radius", "disturbance"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Witness:
    """Why something is refuted.

    ``kind``: "vector" (rational v with v'Mv >= 0), "agents", "polynomial" (a factor that does not decay),
    "routh_row", "farkas", "start".  ``labels`` name agents, ``values`` are exact numbers as text.
    """

    kind: str
    labels: tuple[str, ...] | None = None
    values: tuple[str, ...] | None = None

    def to_json(self) -> dict[str, Any]:
        """JSON object with the keys that are there."""
        result: dict[str, Any] = {"kind": self.kind}
        if self.labels is not None:
            result["labels"] = list(self.labels)
        if self.values is not None:
            result["values"] = list(self.values)
        return result


@dataclass(frozen=True, slots=True, kw_only=True)
class Fix:
    """What would cure a refuted or undecided check: keys of the problem file to set, and a sentence."""

    kind: str
    set: Mapping[str, Any]
    text: str

    def to_json(self) -> dict[str, Any]:
        """JSON object."""
        return {"kind": self.kind, "set": dict(self.set), "text": self.text}


@dataclass(frozen=True, slots=True, kw_only=True)
class Check:
    """One condition, decided.

    ``margin`` and ``rate`` (1/s) are rounded towards the weaker claim.  ``exact`` holds exact values as text.
    ``mode`` is None on checks that speak of all modes together.
    """

    id: str
    verdict: Verdict
    domain: Domain
    reason: str
    mode: str | None = None
    margin: float | None = None
    rate: float | None = None
    exact: Mapping[str, Any] | None = None
    witness: Witness | None = None
    fix: Fix | None = None
    evidence: Mapping[str, Any] = field(default_factory=dict)

    @property
    def title(self) -> str:
        """The id, with the mode where there is one."""
        return self.id if self.mode is None else f"{self.id} ({self.mode})"

    def to_json(self, *, with_evidence: bool = False) -> dict[str, Any]:
        """JSON object of the contract; ``with_evidence`` adds what certificate.json holds beyond it."""
        result: dict[str, Any] = {"id": self.id}
        if self.mode is not None:
            result["mode"] = self.mode
        result |= {
            "verdict": self.verdict.value,
            "domain": self.domain if isinstance(self.domain, str) else dict(self.domain),
            "margin": self.margin,
            "rate": self.rate,
            "reason": self.reason,
        }
        if self.exact is not None:
            result["exact"] = dict(self.exact)
        if self.witness is not None:
            result["witness"] = self.witness.to_json()
        if self.fix is not None:
            result["fix"] = self.fix.to_json()
        if with_evidence:
            result["evidence"] = dict(self.evidence)
        return result


def check_from_json(data: Mapping[str, Any]) -> Check:
    """Read a check back.  Raises KeyError, TypeError or ValueError on anything else."""
    witness, fix = data.get("witness"), data.get("fix")
    if data["id"] not in CHECK_IDS:
        raise ValueError(f"unknown check id {data['id']!r}")
    return Check(
        id=data["id"],
        mode=_text_or_none(data.get("mode")),
        verdict=Verdict(data["verdict"]),
        domain=data["domain"],
        margin=_number_or_none(data["margin"]),
        rate=_number_or_none(data["rate"]),
        reason=str(data["reason"]),
        exact=data.get("exact"),
        witness=None
        if witness is None
        else Witness(kind=witness["kind"], labels=_texts(witness.get("labels")), values=_texts(witness.get("values"))),
        fix=None if fix is None else Fix(kind=fix["kind"], set=fix["set"], text=fix["text"]),
        evidence=dict(data.get("evidence") or {}),
    )


def _number_or_none(value: object) -> float | None:
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise TypeError(f"expected a number or null, got {value!r}")
    return float(value)


def _text_or_none(value: object) -> str | None:
    if value is not None and not isinstance(value, str):
        raise TypeError(f"expected text or null, got {value!r}")
    return value


def _texts(value: Any) -> tuple[str, ...] | None:
    if value is None:
        return None
    if not isinstance(value, (list, tuple)) or not all(isinstance(item, str) for item in value):
        raise TypeError("expected a list of texts")
    return tuple(value)
