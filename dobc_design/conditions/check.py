"""One checked condition: its verdict, where it holds, with which margin, and why.

A Check is what a certificate consists of; what confirms it is the problem, the gain W and the pair (P, Q).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from dobc_design._show.cards import Card, Shown, listed
from dobc_design._show.text import significant_towards_zero
from dobc_design.conditions.kinds import KINDS, Kind
from dobc_design.verdict import Verdict

#: Fields of a check in JSON: those that are always there, and the others.
NEEDED = ("id", "verdict", "domain", "margin", "rate", "reason")
OPTIONAL = ("mode", "group", "exact", "witness", "fix")

Domain = str | Mapping[str, Any]  # "global", "consensus", or {"kind", "radius", "disturbance"}


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Witness(Shown):
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


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Fix(Shown):
    """What would cure a refuted or undecided check: keys of the problem file to set, and a sentence."""

    kind: str
    set: Mapping[str, Any]
    text: str

    def to_json(self) -> dict[str, Any]:
        """JSON object."""
        return {"kind": self.kind, "set": dict(self.set), "text": self.text}


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Check(Shown):
    """One condition, decided.

    ``margin`` and ``rate`` (1/s) are rounded towards the weaker claim.  ``exact`` holds exact values as text.
    ``mode`` is None on checks that speak of all modes together.  ``group``, the label of its first agent, stands on
    checks of one group of agents where these have different exosystems.
    """

    id: str
    verdict: Verdict
    domain: Domain
    reason: str
    mode: str | None = None
    group: str | None = None
    margin: float | None = None
    rate: float | None = None
    exact: Mapping[str, Any] | None = None
    witness: Witness | None = None
    fix: Fix | None = None

    def __post_init__(self) -> None:
        if self.id not in KINDS:
            raise ValueError(f"unknown check id {self.id!r}")

    @property
    def kind(self) -> Kind:
        """What is known about checks with this id."""
        return KINDS[self.id]

    @property
    def title(self) -> str:
        """The id, with the mode or the group where there is one."""
        if self.group is not None:
            return f"{self.id} (group of {self.group})"
        return self.id if self.mode is None else f"{self.id} ({self.mode})"

    def _card(self) -> Card:
        domain = self.domain if isinstance(self.domain, str) else ", ".join(f"{k} {v}" for k, v in self.domain.items())
        facts = [("holds for", domain)]
        numbers = (("margin", self.margin), ("rate in 1/s", self.rate))
        facts += [(name, significant_towards_zero(value, 6)) for name, value in numbers if value is not None]
        facts += [(name, str(value)) for name, value in (self.exact or {}).items() if isinstance(value, (str, int))]
        if self.witness is not None:
            facts.append((f"witness, {self.witness.kind}", listed(self.witness.labels or self.witness.values or ())))
        if self.fix is not None:
            facts.append(("cure", self.fix.text))
        return Card(title=self.title, verdict=self.verdict.value, text=self.reason, facts=facts)

    def to_json(self) -> dict[str, Any]:
        """JSON object of the contract."""
        result: dict[str, Any] = {"id": self.id}
        if self.mode is not None:
            result["mode"] = self.mode
        if self.group is not None:
            result["group"] = self.group
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
        return result


def main_cure(checks: Sequence[Check]) -> Check | None:
    """The failed check whose fix cures most: the condition everything rests on, else a printed P, else the model."""
    for id in ("theorem2", "theorem1", "lemma1", "theorem2-printed", "theorem1-printed", "detectability", "hurwitz"):
        for check in checks:
            if check.id == id and check.fix is not None:
                return check
    return None


def main_fix(checks: Sequence[Check]) -> Fix | None:
    """The fix of ``main_cure``, None where nothing is to be cured or no cure is known."""
    check = main_cure(checks)
    return None if check is None else check.fix


def other_cures(checks: Sequence[Check]) -> list[Check]:
    """Checks with a fix that sets other keys than the main one and than those before, which supersede it."""
    main = main_cure(checks)
    seen = [] if main is None or main.fix is None else [set(main.fix.set)]
    result = []
    for check in checks:
        if check.fix is not None and not any(set(check.fix.set) <= other for other in seen):
            seen.append(set(check.fix.set))
            result.append(check)
    return result


def check_from_json(data: Any) -> Check:
    """Read a check back.

    Raises: KeyError, TypeError or ValueError on anything else; a field that is not known here is refused,
    because nobody would have checked it.
    """
    require_keys(data, "a check", needed=NEEDED, allowed=OPTIONAL)
    domain = data["domain"]
    return Check(
        id=_text(data["id"]),
        mode=_text(data["mode"]) if "mode" in data else None,
        group=_text(data["group"]) if "group" in data else None,
        verdict=Verdict(data["verdict"]),
        domain=domain if isinstance(domain, str) else _object(domain, "domain"),
        margin=number_or_none(data["margin"]),
        rate=number_or_none(data["rate"]),
        reason=_text(data["reason"]),
        exact=_object(data["exact"], "exact") if "exact" in data else None,
        witness=_witness(data["witness"]) if "witness" in data else None,
        fix=_fix(data["fix"]) if "fix" in data else None,
    )


def require_keys(data: Any, name: str, *, needed: Collection[str], allowed: Collection[str] = ()) -> None:
    """Raise TypeError, KeyError or ValueError unless ``data`` is an object with these keys and no others."""
    _object(data, name)
    missing = [key for key in needed if key not in data]
    if missing:
        raise KeyError(f"{name} lacks {', '.join(missing)}")
    unknown = [key for key in data if key not in needed and key not in allowed]
    if unknown:
        raise ValueError(f"{name} has unknown fields: {', '.join(unknown)[:100]}")


def number_or_none(value: Any) -> float | None:
    """Read a finite number or null; of an integer that is no float the next one further from 0, which claims more.

    Raises: TypeError, ValueError or OverflowError.
    """
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise TypeError(f"expected a number or null, got {value!r}")
    if not math.isfinite(value):
        raise ValueError(f"expected a finite number, got {value!r}")
    nearest = float(value)
    return math.nextafter(nearest, math.copysign(math.inf, value)) if abs(nearest) < abs(value) else nearest


def _witness(data: Any) -> Witness:
    require_keys(data, "witness", needed=("kind",), allowed=("labels", "values"))
    labels = _texts(data["labels"]) if "labels" in data else None
    return Witness(kind=_text(data["kind"]), labels=labels, values=_texts(data["values"]) if "values" in data else None)


def _fix(data: Any) -> Fix:
    require_keys(data, "fix", needed=("kind", "set", "text"))
    return Fix(kind=_text(data["kind"]), set=_object(data["set"], "fix.set"), text=_text(data["text"]))


def _object(data: Any, name: str) -> dict[str, Any]:
    if not isinstance(data, dict):
        raise TypeError(f"{name} must be an object, got {str(data)[:60]!r}")
    return data


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError(f"expected text, got {value!r}")
    return value


def _texts(value: Any) -> tuple[str, ...]:
    if not isinstance(value, list):
        raise TypeError("expected a list of texts")
    return tuple(_text(item) for item in value)
