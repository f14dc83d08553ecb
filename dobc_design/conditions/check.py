"""One checked condition, of which a certificate consists: its verdict, where it holds, its margin,
why, and its claim.

The claim is the noun of its topic.  It becomes JSON when a certificate is written; a check that was
read from a file holds the values as they stand there, until ``certificate.claims`` reads them for a
trusted problem.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from decimal import Decimal
from fractions import Fraction
from typing import Any, Protocol

from dobc_design._checks import noun, positional
from dobc_design._show.cards import Card, Headed, Shown, listed
from dobc_design._show.text import (
    capitalize_first,
    rate_text,
    significant_away_from_zero,
    significant_towards_zero,
)
from dobc_design.exact.reading import Document, Table, Texts
from dobc_design.exact.work import STAGE, WorkLimitError, at_most, spend
from dobc_design.loop.loop import Loop
from dobc_design.loop.saturation import allowed_error
from dobc_design.verdict import Decided, Verdict

from .domain import EVERYWHERE, Around, Domain, domain_from_json
from .kinds import KINDS, Kind
from .numbers import (
    claimed,
    fields_to_json,
    known_to_json,
    read_rational,
    time_to_one_percent,
)

logger = logging.getLogger("dobc_design")

NAMES = ("block", "mode", "group", "unobservable_polynomial")  # exact values that are no numbers

#: Topics whose V is a quadratic form of the errors; those of the others are weighted maxima.
EUCLIDEAN = ("consensus", "weighted", "quadratic", "arcs")


class Claim(Protocol):
    """What a check proves, exactly: a noun of its topic."""

    def to_json(self) -> Document:
        """The exact values as text."""


@positional
class Values:
    """A claim that consists of named values only, or one that was read from a file, as it stands
    there."""

    values: Table

    def to_json(self) -> Document:
        return dict(self.values)


@noun
class Witness(Shown):
    """Why something is refuted.  ``kind``: "vector" (rational v with v'Mv >= 0), "agents",
    "polynomial" (a factor that does not decay), "routh_row", "farkas", "start".  ``labels`` name
    agents, ``values`` are exact numbers as text."""

    kind: str
    labels: Texts | None = None
    values: Texts | None = None

    def to_json(self) -> Document:
        return known_to_json(self, "kind", "labels", "values")


@noun
class Fix(Shown):
    """What would cure a refuted or undecided check: keys of the problem file to set, and a
    sentence."""

    kind: str
    set: Table
    text: str

    def to_json(self) -> Document:
        return fields_to_json(self, "kind", "set", "text")


@noun(eq=False)
class Check(Headed, Decided):
    """One condition, decided.

    ``margin`` and ``rate`` (1/s) are rounded towards the weaker claim.  ``factor`` >= 1 belongs to
    the rate: |e(t)| <= factor |e(0)| exp(-rate t) + what the estimation error adds, in the norm
    ``norm``; None where no such bound follows. ``claim``: what is proved, exactly; ``exact`` is
    that as text.  ``mode`` is None on checks that speak of all modes together.  ``group``, the
    label of its first agent, stands on checks of one group of agents where these have different
    exosystems.  ``applies``: False where an undecided condition is not about such a problem at all.
    ``cut``: True where time or work ran out before it was decided, so that it says nothing about
    the problem; ``longer``: and `certify --all` searches longer for it.
    """

    id: str
    verdict: Verdict
    domain: Domain
    reason: str
    mode: str | None = None
    group: str | None = None
    margin: float | None = None
    rate: float | None = None
    factor: float | None = None
    claim: Claim | None = None
    witness: Witness | None = None
    fix: Fix | None = None
    applies: bool = True
    cut: bool = False
    longer: bool = False

    def __post_init__(self) -> None:
        if self.id not in KINDS:
            raise ValueError(f"unknown check id {self.id!r}")

    def __eq__(self, other: object) -> bool:
        """Checks are equal if a certificate says the same of them."""
        return self.to_json() == other.to_json() if isinstance(other, Check) else NotImplemented

    __hash__ = None  # type: ignore[assignment]

    @property
    def exact(self) -> Document | None:
        """The exact values as text, or None where nothing is claimed."""
        return None if self.claim is None else self.claim.to_json()

    @property
    def kind(self) -> Kind:
        """What is known about checks with this id."""
        return KINDS[self.id]

    @property
    def norm(self) -> str:
        """The norm of its bound: the largest component of all errors, or the Euclidean length of
        all of them."""
        # Of a chain the mean of the squared length decays.
        in_mean_square = self.id == "markov" and (self.exact or {}).get("kind") == "mean square"
        return "|e|" if self.kind.topic in EUCLIDEAN or in_mean_square else "|e|_inf"

    @property
    def time_to_one_percent(self) -> float:
        """After how many seconds the bound is a hundredth of |e(0)|: ln(100 factor) / rate;
        infinite without one."""
        return time_to_one_percent(self.rate, self.factor)

    @property
    def title(self) -> str:
        """The id, with the mode or the group where there is one."""
        if self.group is not None:
            return f"{self.id} (group of {self.group})"
        return self.id if self.mode is None else f"{self.id} ({self.mode})"

    @property
    def remark(self) -> str:
        """The reason without its first sentence, which says what is proved; to be shown, never to
        be read."""
        return self.reason.partition(". ")[2]

    def _card(self) -> Card:
        told = {"global": "every start", "consensus": "near the target"}
        facts = [("starts", told.get(str(self.domain), str(self.domain)))]
        if self.margin is not None:
            facts.append(("margin", significant_towards_zero(self.margin, 6)))
        if self.rate is not None:
            facts.append(("rate in 1/s", rate_text(self.rate, 6)))
        if self.factor is not None:
            facts.append((f"factor of {self.norm}", significant_away_from_zero(self.factor, 6)))
        # Lists and tables of a claim are too long for a card.
        for name, value in (self.exact or {}).items():
            if isinstance(value, (str, int)):
                facts.append((name, str(value)))
        witness = self.witness
        if witness is not None:
            named = listed(witness.labels or witness.values or ())
            facts.append((f"witness, {witness.kind}", named))
        if self.fix is not None:
            facts.append(("cure", self.fix.text))
        reason = capitalize_first(self.reason)
        return Card(title=self.title, verdict=self.verdict.value, text=reason, facts=facts)

    def unless(self, wrong: str | None, domain: Domain) -> Check:
        """The same check; where something is ``wrong`` with it an undecided one that says so."""
        return self if wrong is None else undecided_check(self.id, domain, wrong)

    def to_json(self) -> Document:
        """JSON object of the contract."""
        result = known_to_json(self, "id", "mode", "group")
        result["verdict"] = self.verdict.value
        result |= fields_to_json(self, "domain", "margin", "rate", "factor", "reason")
        if self.claim is not None:
            result["exact"] = self.claim.to_json()
        return result | known_to_json(self, "witness", "fix")


Checks = Sequence[Check]


def not_a_proof(check: Check) -> str | None:
    """Why a claimed check is not even a proof, where its topic refutes nothing; None if it is."""
    if check.is_proved and check.witness is None:
        return None
    return "it can only be proved or undecided, and has no witness"


def undecided_check(id: str, domain: Domain, reason: str, *, applies: bool = True) -> Check:
    """A check of all modes that claims nothing."""
    return Check(id=id, verdict=Verdict.UNDECIDED, domain=domain, reason=reason, applies=applies)


def cut_check(
    id: str, domain: Domain, reason: str, *, mode: str | None = None, longer: bool = False
) -> Check:
    """A check that was not decided, because time or work ran out; ``longer``: `certify --all`
    searches longer."""
    return replace(undecided_check(id, domain, reason), mode=mode, cut=True, longer=longer)


def withdrawn(check: Check, domain: Domain, reason: str) -> Check:
    """The same check undecided: it claims nothing any more.  ``domain``: that of Lemma 1."""
    # A fact of the network or of the exosystem alone is about every start.
    domain = EVERYWHERE if check.kind.role == "part" else domain
    nothing: Document = dict.fromkeys(("margin", "rate", "factor", "claim", "witness"))
    return replace(check, verdict=Verdict.UNDECIDED, domain=domain, reason=reason, **nothing)


def limited(id: str, domain: Domain, decide: Callable[[], Check]) -> Check:
    """What ``decide`` finds within the work of one stage, or an undecided check that says how far
    it came."""
    try:
        with at_most(STAGE):
            # Time that has run out already is noticed before anything is begun.
            spend(0)
            return decide()
    except WorkLimitError as limit:
        return cut_check(id, domain, str(limit))


@contextmanager
def surviving(what: str, *beside: type[Exception]) -> Iterator[None]:
    """A proposal in floating point may break down (or meet what stands ``beside``): the log tells
    it, all goes on."""
    expected: tuple[type[Exception], ...] = (ArithmeticError, RuntimeError, ValueError, *beside)
    try:
        yield
    except expected as error:
        logger.warning("%s: %s", what, error)


def fastest_in_words(rate: float, factor: float) -> str:
    """What a proof with the largest rate would say, as a sentence for the reason of one that
    settles earlier."""
    fastest = significant_towards_zero(rate)
    larger = significant_away_from_zero(factor, 3)
    return (
        f" The largest rate is about {fastest} 1/s, with a factor of {larger}: it reaches "
        "one percent later."
    )


def read_domain(domain: Domain, loop: Loop, *, kind: type[Around]) -> tuple[Fraction, Fraction]:
    """Radius > 0 and disturbance >= 0 of a domain of this kind.  Raises: ValueError or
    TypeError."""
    if not isinstance(domain, kind):
        raise ValueError(f"the domain must be a {kind.kind} with radius and disturbance")
    radius = number_or_none(domain.radius)
    disturbance = number_or_none(domain.disturbance)
    if radius is None or radius <= 0 or disturbance is None or disturbance < 0:
        raise ValueError("the radius must be > 0 and the disturbance >= 0")
    if disturbance and not loop.groups:
        raise ValueError("without an exosystem the disturbance must be 0")
    allowed = allowed_error(loop)
    if allowed is not None and claimed(disturbance) > allowed:
        raise ValueError("what saturation leaves is known for the estimation error of [region]")
    return claimed(radius), claimed(disturbance)


def main_cure(checks: Checks) -> Check | None:
    """The failed check whose fix cures most: the condition everything rests on, else a printed P,
    else the model."""
    order = (
        "theorem2",
        "theorem1",
        "lemma1",
        "theorem2-printed",
        "theorem1-printed",
        "detectability",
        "hurwitz",
    )
    cured = [check for check in checks if check.fix is not None and check.id in order]
    # Where agents agree no theorem applies, and arcs are all that is missing.
    arcs = (check for check in checks if check.fix is not None and check.fix.kind == "arcs")
    return min(cured, key=lambda check: order.index(check.id), default=next(arcs, None))


def other_cures(checks: Checks) -> list[Check]:
    """Checks with a fix that sets other keys than the main one and than those before, which
    supersede it."""
    seen = list[set[str]]()
    main = main_cure(checks)
    if main is not None and main.fix is not None:
        seen.append(set(main.fix.set))
    result = list[Check]()
    for check in checks:
        if check.fix is None:
            continue
        keys = set(check.fix.set)
        if not any(keys <= other for other in seen):
            seen.append(keys)
            result.append(check)
    return result


def check_from_json(data: Any) -> Check:
    """Read a check back.  Raises: KeyError, TypeError or ValueError, also for a field that is not
    known here."""
    values = read_parts(data, with_optional(NEEDED, OPTIONAL, data), "a check")
    if "exact" in values:
        values["claim"] = Values(values.pop("exact"))
    return Check(**values)


def _witness_from_json(data: Any) -> Witness:
    lists: Document = {"labels": [text_from_json], "values": [text_from_json]}
    shape = with_optional({"kind": text_from_json}, lists, data)
    return Witness(**read_parts(data, shape, "witness"))


def _fix_from_json(data: Any) -> Fix:
    shape = {"kind": text_from_json, "set": _object, "text": text_from_json}
    return Fix(**read_parts(data, shape, "fix"))


def _domain_from_json(data: Any) -> Domain:
    return domain_from_json(data if isinstance(data, str) else _object(data))


def differs(check: Check, own: Check) -> str | None:
    """What a claimed check says otherwise than our own one for the same question; None if
    nothing."""
    # What follows from the verdict is compared only where that is the same.
    if own.verdict is not check.verdict:
        return f"it is {own.verdict.value}"
    if not agrees(check.exact, own.exact):
        return "exact differs from what the problem gives"
    if not same_witness(check.witness, own.witness):
        return "witness differs from what the problem gives"
    return None


def agrees(claim: object, own: object, *, as_text: bool = False) -> bool:
    """Whether a part of a check says the same: rationals as numbers, names and polynomials as they
    are written."""
    if isinstance(own, Mapping) and isinstance(claim, Mapping):
        if set(claim) != set(own):
            return False
        return all(agrees(claim[key], own[key], as_text=key in NAMES) for key in own)
    if isinstance(own, Sequence) and isinstance(claim, Sequence) and not isinstance(own, str):
        if isinstance(claim, str) or len(claim) != len(own):
            return False
        return all(agrees(a, b, as_text=as_text) for a, b in zip(claim, own, strict=True))
    if claim == own or as_text or not isinstance(own, str):
        return claim == own
    return read_rational(claim) == read_rational(own)


def same_witness(claim: Witness | None, own: Witness | None) -> bool:
    """Whether two witnesses are the same, their values as numbers."""
    if claim is None or own is None:
        return claim is own
    named = (claim.kind, claim.labels) == (own.kind, own.labels)
    return named and agrees(claim.values, own.values, as_text=own.kind == "polynomial")


def require_keys(data: Any, name: str, *, needed: Collection[str]) -> None:
    """Raise TypeError, KeyError or ValueError unless ``data`` is an object with these keys and no
    others."""
    if not isinstance(data, dict):
        raise TypeError(f"{name} must be an object, got {str(data)[:60]!r}")
    missing = [key for key in needed if key not in data]
    if missing:
        raise KeyError(f"{name} lacks {', '.join(missing)}")
    unknown = [key for key in data if key not in needed]
    if unknown:
        raise ValueError(f"{name} has unknown fields: {', '.join(unknown)[:100]}")


def read_parts(data: Any, shape: Any, name: str = "exact") -> Any:
    """A part of a claim, as its shape says: an object with the keys of a dict and no others, items
    of one shape in a list, as many items as in a tuple, what a function reads; of None what stands
    there.  Raises: KeyError, TypeError or ValueError for anything else."""
    if isinstance(shape, dict):
        require_keys(data, name, needed=shape)
        return {key: read_parts(data[key], part, key) for key, part in shape.items()}
    if isinstance(shape, list | tuple):
        if not isinstance(data, list) or (isinstance(shape, tuple) and len(data) != len(shape)):
            count = f" of {len(shape)}" if isinstance(shape, tuple) else ""
            raise TypeError(f"{name} must be a list{count}")
        parts = shape if isinstance(shape, tuple) else shape * len(data)
        return tuple(read_parts(each, part, name) for each, part in zip(data, parts, strict=True))
    try:
        return data if shape is None else shape(data)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name}: {error}") from error


def with_optional(shape: Document, optional: Document, data: Any) -> Document:
    """The shape with those of the optional keys that stand there."""
    there = data if isinstance(data, Mapping) else {}
    return shape | {key: part for key, part in optional.items() if key in there}


def number_or_none(value: Any) -> float | None:
    """Read a finite number or null; of an integer that is no float the next one further from 0,
    which claims more.
    Raises: TypeError, ValueError or OverflowError."""
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise TypeError(f"expected a number or null, got {value!r}")
    if not math.isfinite(value):
        raise ValueError(f"expected a finite number, got {value!r}")
    nearest = float(value)
    # Rounding towards 0 would claim less than what is written.
    if abs(nearest) < abs(value):
        return math.nextafter(nearest, math.copysign(math.inf, value))
    return nearest


class Written(float):
    """A number that was read from a decimal text, which it need not equal."""

    text: str

    @classmethod
    def of(cls, value: float, text: str) -> Written:
        """The number ``value`` that stands for ``text``."""
        number = cls(value)
        number.text = text
        return number


def factor_or_none(value: Any) -> float | None:
    """Read a factor or null; of a number that is no float the next one below, because a smaller
    factor claims more.
    Raises: as ``number_or_none``, and ValueError below 1."""
    if value is None:
        return None
    number = number_or_none(value)
    written = Decimal(value.text if isinstance(value, Written) else str(value))
    if number is None or number < 1 or not 1 <= written <= Decimal("1e300"):
        raise ValueError(f"a factor must be at least 1 and at most 1e300, got {value!r}")
    while Decimal(repr(number)) > written:
        number = math.nextafter(number, 0.0)
    return number


def _object(data: Any) -> Document:
    if not isinstance(data, dict):
        raise TypeError(f"an object was expected, got {str(data)[:60]!r}")
    return data


def text_from_json(value: Any) -> str:
    """A text.  Raises: TypeError for anything else."""
    if not isinstance(value, str):
        raise TypeError(f"text was expected, got {value!r}")
    return value


#: Fields of a check in JSON: those that are always there, and the others.
NEEDED: Document = {
    "id": text_from_json,
    "verdict": Verdict,
    "domain": _domain_from_json,
    "margin": number_or_none,
    "rate": number_or_none,
    "reason": text_from_json,
}
OPTIONAL: Document = {
    "mode": text_from_json,
    "group": text_from_json,
    "factor": factor_or_none,
    "exact": _object,
    "witness": _witness_from_json,
    "fix": _fix_from_json,
}
