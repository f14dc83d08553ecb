"""certificate.json: its bytes, and reading it back.

A field that is not known, is missing or stands there twice is refused: what nobody checks must not
look like a part of the proof.
"""

import json
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from decimal import Decimal
from functools import partial
from typing import Any

from dobc_design._show.text import visible
from dobc_design.conditions.accuracy.value import value_from_json
from dobc_design.conditions.check import (
    Check,
    Written,
    check_from_json,
    factor_or_none,
    number_or_none,
    read_parts,
    text_from_json,
    with_optional,
    withdrawn,
)
from dobc_design.conditions.consensus.claim import Unstable
from dobc_design.conditions.domain import Domain
from dobc_design.conditions.numbers import (
    LONGEST,
    VECTOR_BITS,
    fields_to_json,
    has_short_denominator,
    known_to_json,
    read_rational,
)
from dobc_design.conditions.reason import read_reason
from dobc_design.errors import CertificateError, SpecError, reason_of
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.reading import Document, json_object
from dobc_design.problem.foreign_json import CERTIFICATE, not_a
from dobc_design.verdict import Verdict

from .claims import Claims

FORMAT = "dobc-certificate"
VERSION = 1
MAX_BYTES = 256 * 1024 * 1024


def certificate_document(claims: Claims) -> Document:
    """The JSON document of certificate.json."""
    program: Document = {"name": "dobc_design", "version": claims.version}
    if claims.options:
        program["options"] = list(claims.options)
    observer = fields_to_json(claims, "W") | {"source": claims.gain_source}
    return {
        "format": FORMAT,
        "version": VERSION,
        "program": program,
        "problem": claims.problem_name,
        "problem_sha256": claims.problem_sha256,
        "verdict": claims.verdict.value,
        **fields_to_json(claims, "reason", "rate", "factor", "covered_by"),
        "observer": observer | fields_to_json(claims, "P", "Q"),
        **fields_to_json(claims, "notes", "checks"),
        **known_to_json(claims, "value"),
    }


def certificate_bytes(claims: Claims) -> bytes:
    """The UTF-8 bytes of certificate.json."""
    text = json.dumps(certificate_document(claims), ensure_ascii=False, indent=1, allow_nan=False)
    return text.encode("utf-8") + b"\n"


def read_claims(data: bytes) -> Claims:
    """Read certificate.json.  Raises CertificateError for anything that is not one."""
    if len(data) > MAX_BYTES:
        raise CertificateError(
            f"the certificate is too large ({len(data)} bytes).", cure="Choose another file."
        )
    try:
        numbers = partial(json.loads, parse_float=_claimed_float, parse_constant=_no_constant)
        document = numbers(data.decode("utf-8"), object_pairs_hook=json_object)
        if not isinstance(document, dict) or document.get("format") != FORMAT:
            found = not_a(CERTIFICATE, document, name="the file")
            raise CertificateError(
                f"the certificate cannot be read: {found.message}", cure=found.cure
            )
        version = document["version"]
        if type(version) is not int or version != VERSION:  # true and 1.0 equal 1
            raise ValueError(
                f"version {version!r} is not known here (this program knows {VERSION})"
            )
        return _claims(document)
    except SpecError as error:
        what = f"the certificate cannot be read: {visible(str(error)[:300])}"
        raise CertificateError(what, cure="Make it again.") from None
    except (
        ValueError,
        KeyError,
        TypeError,
        AttributeError,
        RecursionError,
        ArithmeticError,
    ) as error:
        what = f"the certificate cannot be read: {visible(reason_of(error)[:200])}."
        raise CertificateError(what, cure="Make it again with `dobc certify`.") from None


def _claims(document: Document) -> Claims:
    matrix = partial(_read_or_none, _read_matrix)
    text_or_none = partial(_read_or_none, text_from_json)
    # Every key, on every level: a field that is not known might look like a part of the proof.
    shape: Document = {
        "format": None,
        "version": None,
        "program": _program_from_json,
        "problem": text_from_json,
        "problem_sha256": text_from_json,
        "verdict": Verdict,
        "reason": text_from_json,
        "rate": number_or_none,
        "covered_by": text_or_none,
        "observer": {"W": matrix, "source": text_or_none, "P": matrix, "Q": matrix},
        "notes": [text_from_json],
        "checks": [check_from_json],
    }
    optional: Document = {"factor": factor_or_none, "value": value_from_json}
    values = read_parts(document, with_optional(shape, optional, document), "the certificate")
    observer = values.pop("observer")
    program = values.pop("program")
    kept = ("problem_sha256", "verdict", "rate", "covered_by", "notes", "checks", *optional)
    return Claims(
        problem_name=values["problem"],
        why=read_reason(values["reason"]),
        gain_source=observer.pop("source"),
        version=program["version"],
        options=program.get("options", ()),
        **observer,
        **{name: values[name] for name in kept if name in values},
    )


def _program_from_json(data: Any) -> Document:
    shape: Document = {"name": text_from_json, "version": text_from_json}
    program: Document = read_parts(data, with_optional(shape, {"options": [text_from_json]}, data))
    return program


def _read_or_none(read: Callable[[Any], Any], value: Any) -> Any:
    return None if value is None else read(value)


def _read_matrix(value: Any) -> Matrix:
    rows: Matrix = read_parts(value, [[read_rational]], "a matrix")
    # A ragged list is no matrix, whatever its entries are.
    if len({len(row) for row in rows}) != 1 or not rows[0]:
        raise TypeError("a matrix must have rows of equal length")
    return rows


def _claimed_float(text: str) -> float:
    """The float whose shortest decimal text is what is written, or the next one further from 0; it
    keeps the text.

    A rate, a margin or a radius further from 0 claims more: what is confirmed then is never less
    than what is written. Of a factor the opposite is true; who reads one looks at the text.
    """
    value = float(text)
    written = Decimal(text)
    # abs() would round
    if math.isfinite(value) and Decimal(repr(value)).copy_abs() < written.copy_abs():
        value = math.nextafter(value, math.copysign(math.inf, written))
    return Written.of(value, text)


def _no_constant(name: str) -> float:
    raise ValueError(f"{name} is not a number")


_DIGITS = re.compile(r"[0-9]+")
# an array of doubles and a cut-up box, which may be long; names
NO_NUMBERS = ("float64", "mode", "group", "tree")
# digits of a numerator or denominator in a polynomial: Python prints no more than 4300
LONGEST_COEFFICIENT = 4000


def writable(check: Check, domain: Domain) -> Check:
    """The check, if a certificate can hold it; else without what may be left out; else UNDECIDED
    with the reason, about ``domain``, that of Lemma 1.

    Nothing untrue comes of it: a check may always claim less.
    """
    claim = check.claim
    shorter = check
    if isinstance(claim, Unstable):  # Lemma 1 may leave out its lower bound
        shorter = replace(check, claim=Unstable(roots=claim.roots))
    # What may be left out goes before the whole proof does.
    for each in (check, shorter):
        if _fits(each):
            return each
    reason = (
        f"it is {check.verdict.value} here, but a number in the proof has more digits than a "
        "certificate holds"
    )
    cure = "Give the numbers of the problem with fewer digits, or with one common denominator."
    return withdrawn(check, domain, f"{reason} ({LONGEST} characters). {cure}")


def _fits(check: Check) -> bool:
    witness = check.witness
    values = () if witness is None or witness.values is None else witness.values
    for text in _numbers_in([check.exact, values]):
        if "s" in text:  # a polynomial
            too_long = any(len(each) > LONGEST_COEFFICIENT for each in _DIGITS.findall(text))
        else:
            too_long = len(text) > LONGEST
        if too_long:
            return False
    if witness is None or witness.kind != "vector":
        return True
    # Readers bring a vector over one denominator before they multiply out.
    broken = (text for text in values if not text.lstrip("-").isdigit())
    return has_short_denominator((read_rational(text) for text in broken), VECTOR_BITS)


def _numbers_in(part: object) -> Iterator[str]:
    """The texts in a part of a check that stand for numbers."""
    if isinstance(part, str):
        yield part
    elif isinstance(part, Mapping):
        for key, each in part.items():
            yield from _numbers_in(each) if key not in NO_NUMBERS else ()
    elif isinstance(part, Sequence):
        for each in part:
            yield from _numbers_in(each)
