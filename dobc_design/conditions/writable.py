"""What a certificate can hold: a check with longer numbers claims less, or nothing.

Numbers of a few digits in a problem can make numbers of many thousand digits in Routh's column, in a polynomial or in a
witness.  No checker reads those (``numbers.LONGEST``), so a certificate with one of them would be refused as a whole.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from dobc_design.conditions.check import Check
from dobc_design.conditions.numbers import LONGEST, VECTOR_BITS, has_short_denominator, read_rational
from dobc_design.verdict import Verdict

_DIGITS = re.compile(r"[0-9]+")
NO_NUMBERS = ("float64", "mode", "group", "tree")  # an array of doubles and a cut-up box, which may be long; names
LONGEST_COEFFICIENT = 4000  # digits of a numerator or denominator in a polynomial: Python prints no more than 4300


def writable(check: Check) -> Check:
    """The check, if a certificate can hold it; else without what may be left out; else UNDECIDED with the reason.

    Nothing untrue comes of it: a check may always claim less.
    """
    if _fits(check):
        return check
    if check.exact is not None and "value" in check.exact:  # a lower bound that Lemma 1 may leave out
        shorter = replace(check, exact={key: x for key, x in check.exact.items() if key != "value"})
        if _fits(shorter):
            return shorter
    return Check(
        id=check.id,
        mode=check.mode,
        group=check.group,
        verdict=Verdict.UNDECIDED,
        domain=check.domain,
        fix=check.fix,
        reason=f"it is {check.verdict.value} here, but a number in the proof has more digits than a certificate holds"
        f" ({LONGEST} characters). Give the numbers of the problem with fewer digits, or with one common denominator.",
    )


def _fits(check: Check) -> bool:
    witness = check.witness
    values = () if witness is None or witness.values is None else witness.values
    if not all(_is_short(text) for text in _texts([check.exact, values])):
        return False
    if witness is None or witness.kind != "vector":
        return True
    broken = (text for text in values if not text.lstrip("-").isdigit())
    return has_short_denominator((read_rational(text) for text in broken), VECTOR_BITS)


def _texts(part: object) -> Iterator[str]:
    """The texts in a part of a check that stand for numbers."""
    if isinstance(part, str):
        yield part
    elif isinstance(part, Mapping):
        for key, each in part.items():
            yield from _texts(each) if key not in NO_NUMBERS else ()
    elif isinstance(part, Sequence):
        for each in part:
            yield from _texts(each)


def _is_short(text: str) -> bool:
    if "s" in text:  # a polynomial
        return all(len(digits) <= LONGEST_COEFFICIENT for digits in _DIGITS.findall(text))
    return len(text) <= LONGEST
