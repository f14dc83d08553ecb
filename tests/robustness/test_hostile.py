"""Input made to do harm: every reader refuses it in its one way, in a few seconds of CPU time.

The files themselves (pipes, devices, folders) are the business of ``test_machine``.
"""

import json
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import pytest
from bad_files import VALID
from broken_input import LIMIT as ALONE
from broken_input import time_limit
from certified import certified
from flint import fmpz

import dobc_design as dd
from dobc_design.certificate.text import certificate_bytes, read_claims
from dobc_design.certification.recheck import recheck
from dobc_design.errors import CertificateError, SpecError
from dobc_design.exact.matrix import multiply
from dobc_design.problem.canonical import canonical_bytes, problem_from_canonical
from dobc_design.problem.load import load_problem, read_problem_text

# other programs beside it slow a processor's caches too; what hangs takes minutes
LIMIT = 5 * ALONE
MB = 1_000_000
SOME = 100_000  # characters of most: enough to see whether the time is linear in them
TREES: dict[str, Any] = {
    "deep lists": "[" * 100_000,
    "deep objects": '{"a":' * 100_000,
    "as deep as can just be read": "[" * 900 + "]" * 900,
    "a long number": "9" * SOME,
    "an exponent": "1e999999999",
    "not a number": "NaN",
    "a long text": '"' + "a" * SOME + '"',
    "a lone surrogate": '"\\ud800"',
    "a long list": "[" + "0," * SOME + "0]",
    "many keys": "{" + ",".join(f'"k{k}":0' for k in range(10_000)) + "}",
    "one key many times": "{" + '"a":0,' * 10_000 + '"a":0}',
}
BYTES: dict[str, Any] = {
    "nothing": b"",
    "blanks": b" " * (3 * MB),
    "bytes that are no text": b"\xff\xfe" * MB,
    "a surrogate in UTF-8": b'{"format": "\xed\xa0\x80"}',
    "UTF-16": '{"format": 1}'.encode("utf-16"),
    "compressed": b"\x1f\x8b\x08\x00" + bytes(1000),
    "a list": b"[]",
    "two documents": b"{}{}",
}


def take(read: Callable[[bytes], Any], data: bytes, error: type[Exception]) -> Any:
    """What the reader makes of it: a value, or None where it refuses; never long, never another
    exception."""
    with time_limit(ALONE):
        try:
            return read(data)
        except error as refusal:
            for line in str(refusal).split("\n"):
                assert line.isprintable()
            assert len(str(refusal)) < 20_000
            return None


READERS = {
    "certificate.json": (read_claims, CertificateError),
    "problem.json": (problem_from_canonical, SpecError),
    "problem.toml": (lambda data: read_problem_text(data, folder=None), SpecError),
}


@pytest.fixture(scope="module")
def problem() -> dd.Problem:
    return load_problem("paper-fixed")


@pytest.fixture(scope="module")
def valid(problem) -> dict[str, dict[str, Any]]:
    certificate = json.loads(certificate_bytes(certified("paper-fixed").claims))
    document = json.loads(canonical_bytes(problem))
    return {"certificate.json": certificate, "problem.json": document}


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("name", BYTES)
def test_bytes_that_are_no_file_of_ours_are_refused(reader, name):
    assert take(READERS[reader][0], BYTES[name], READERS[reader][1]) is None


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("name", TREES)
def test_a_hostile_document_is_refused(reader, name):
    text = f"x = {TREES[name]}" if reader == "problem.toml" else TREES[name]
    reads = READERS[reader][0]
    error = READERS[reader][1]
    assert take(reads, text.encode(), error) is None


@pytest.mark.parametrize("text", ["9" * (10 * MB), "1/" + "9" * (10 * MB), "0." + "9" * (10 * MB)])
def test_a_rational_of_ten_megabytes_is_refused(valid, text):
    for reader, place in (
        ("certificate.json", "observer P 0 0"),
        ("problem.json", "exosystem A 0 0"),
    ):
        reads = READERS[reader][0]
        assert take(reads, changed(valid[reader], place, f'"{text}"'), READERS[reader][1]) is None


def changed(valid: dict[str, Any], place: str, text: str) -> bytes:
    document = json.loads(json.dumps(valid))
    holder: Any = document
    *keys, last = [int(part) if part.isdigit() else part for part in place.split()]
    for key in keys:
        holder = holder[key]
    holder[last] = "@@"
    return json.dumps(document).replace('"@@"', text).encode()


PLACES = {
    "certificate.json": "version, rate, reason, notes, checks, checks 0 "
    "margin, checks 0 exact, checks 0 "
    "domain,"
    " observer P, observer P 0, observer P 0 0, problem_sha256",
    "problem.json": "version, name, labels, labels 0, dimension, modes "
    "0 arcs, modes 0 arcs 0, modes 0 "
    "arcs 0 0,"
    " modes 0 arcs 0 2, coupling h, gains 0 1, exosystem A 0 0, simulation seed",
}


@pytest.mark.parametrize("name", TREES)
@pytest.mark.parametrize("reader", PLACES)
def test_a_hostile_part_of_a_good_document_is_refused_or_changes_no_proof(
    reader, name, valid, problem
):
    """Some parts are text that nobody judges, and may be anything."""
    for text in PLACES[reader].split(", "):
        reads = READERS[reader][0]
        data = changed(valid[reader], text, TREES[name])
        found = take(reads, data, READERS[reader][1])
        if found is not None and reader == "certificate.json":
            with time_limit(LIMIT):
                assert recheck(found, problem).holds is (text == "reason")


@pytest.mark.parametrize("reader", PLACES)
def test_line_ends_and_a_byte_order_mark_are_taken_or_refused_as_a_whole(reader, valid):
    text = json.dumps(valid[reader], indent=1)
    read, error = READERS[reader]
    windows_lines = text.replace("\n", "\r\n").encode()
    assert take(read, windows_lines, error) is not None
    assert take(read, text.encode("utf-8-sig"), error) is None
    assert take(read, text.encode() + b"\0", error) is None


TOML: dict[str, Any] = {
    "thirty thousand keys": "\n".join(f"k{k} = 0" for k in range(30_000)),
    "ten thousand tables": "\n".join(f"[t{k}]" for k in range(10_000)),
    "thousands of modes": VALID.replace(
        "Gb =", "\n".join(f"M{k} = []" for k in range(4000)) + "\nGb ="
    ),
    "a hundred thousand strings": "a = [" + '"",' * 100_000 + "]",
    "a long label": VALID.replace("agents = 4", f'agents = ["{"a" * MB}"]'),
    "towers of powers": VALID.replace('"2*y"', '"' + "(" * 40 + "y" + "**64)" * 40 + '"'),
    "a constant tower": VALID.replace('"2*y"', '"y*' + "(" * 40 + "9" + "**64)" * 40 + '"'),
    "signs": VALID.replace('"2*y"', '"' + "-" * 1900 + 'y"'),
}


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.slow if name == "thirty thousand keys" else [])
        for name in TOML
    ],
)
def test_hostile_toml_is_refused_or_read_in_time(name):
    found = take(READERS["problem.toml"][0], TOML[name].encode(), SpecError)
    assert found is None or name in ("thousands of modes", "towers of powers", "signs")


@pytest.mark.parametrize("name", ["paper-fixed", "paper-switching"])
def test_a_pair_of_long_numbers_is_decided_in_time(name):
    """P + tiny terms with huge, coprime denominators: elimination in exact arithmetic would take
    minutes."""
    problem = load_problem(name)
    digits = 2000
    claims = certified(name).claims
    assert claims.P is not None
    assert claims.W is not None
    tail = Fraction(1, 10**digits + 7)
    P = tuple(
        tuple(x + tail * (i + j + 1) for j, x in enumerate(row)) for i, row in enumerate(claims.P)
    )
    document = json.loads(certificate_bytes(claims))
    document["observer"] |= {"P": as_text(P), "Q": as_text(multiply(P, claims.W))}
    with time_limit(LIMIT):
        data = json.dumps(document).encode()
        found = recheck(read_claims(data), problem)
    assert not found.holds  # the exact values beside it are those of the old pair


def as_text(matrix: Any) -> list[list[str]]:
    return [
        [f"{fmpz(x.numerator).str()}/{fmpz(x.denominator).str()}" for x in row] for row in matrix
    ]


def test_a_deep_fix_is_no_way_to_crash_the_checker(valid, problem):
    text = json.dumps(valid["certificate.json"])
    document = json.loads(text)
    document["checks"][1]["fix"] = {"kind": "x", "set": {"a": "@@"}, "text": "x"}
    for depth in (100, 500, 900, 960):
        brackets = "[" * depth + "]" * depth
        data = json.dumps(document).replace('"@@"', brackets).encode()
        found = take(read_claims, data, CertificateError)
        if found is not None:
            with time_limit(LIMIT):
                recheck(found, problem)
