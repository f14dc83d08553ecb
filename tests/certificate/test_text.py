"""certificate.json: the same claims there and back, and one kind of error for everything that is none."""

from __future__ import annotations

import json

import pytest
from campaigns import a_problem
from certified import certified

from dobc_design.certificate.text import certificate_bytes, certificate_document, read_claims
from dobc_design.certification.certify import certify, verify
from dobc_design.certification.recheck import recheck
from dobc_design.checker import examine as checker
from dobc_design.conditions.check import number_or_none
from dobc_design.conditions.observer.propose import lyapunov
from dobc_design.errors import CertificateError
from dobc_design.exact.matrix import multiply, scale
from dobc_design.problem.canonical import canonical_bytes
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.groups import Observer
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem


@pytest.fixture(scope="module")
def document():
    return json.loads(certificate_bytes(certified("paper-fixed").claims))


def as_bytes(document):
    return json.dumps(document).encode()


def test_claims_come_back_as_they_were_written():
    for seed in range(15):
        claims = certify(a_problem(seed)).claims
        data = certificate_bytes(claims)
        assert read_claims(data) == claims
        assert certificate_bytes(read_claims(data)) == data


def test_the_same_problem_gives_the_same_bytes():
    """No time stamps; same input and versions give the same claims."""
    for seed in range(4):
        first, second = (certificate_bytes(certify(a_problem(seed)).claims) for _ in range(2))
        assert first == second


def test_the_document_has_the_fields_of_the_contract(document):
    assert document["format"] == "dobc-certificate"
    needed = {"id", "verdict", "domain", "margin", "rate", "reason"}
    for check in document["checks"]:
        assert needed <= set(check) <= needed | {"mode", "exact", "witness", "fix"}


def test_numbers_longer_than_anybody_types_are_read_back(monkeypatch):
    """The last pair that is tried comes from an exact Lyapunov equation: hundreds of digits."""
    A = [[f"{(i * 7 + j * 3) % 11 - 50 * (i == j)}/{10**9 + 7 * i + j}" for j in range(4)] for i in range(4)]
    problem = Problem(
        network=Network.from_arcs([], arrow="listens_to", agents=1),
        coupling="y",
        gains="1/1000000007",
        exosystem=Exosystem(A=A, C=[["1/3", "3/7", "-5/11", "1/13"]]),
        observer=Observer(W=[[0]] * 4),
    )

    def exact_only(exosystem, W, *, bound, decay):
        P = scale(10**40, lyapunov(exosystem.A))
        yield P, multiply(P, W), ""

    monkeypatch.setattr("dobc_design.certification.certify.propose_pairs", exact_only)
    certificate = certify(problem)
    data = certificate_bytes(certificate.claims)
    assert max(len(entry) for row in json.loads(data)["observer"]["P"] for entry in row) > 200
    assert read_claims(data) == certificate.claims
    assert verify(data, problem).holds


def changed(document, *path, value):
    copy = json.loads(json.dumps(document))
    holder = copy
    for name in path[:-1]:
        holder = holder[name]
    holder[path[-1]] = value
    return copy


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("extra",), 1),
        (("checks", 0, "evidence"), {}),
        (("checks", 0, "witness"), {"kind": "vector", "note": "x"}),
        (("observer", "K"), None),
        (("program", "path"), "x"),
        (("version",), 2),
        (("version",), "1"),
        (("version",), 1.0),
        (("version",), True),
        (("format",), "other"),
        (("verdict",), "perhaps"),
        (("verdict",), None),
        (("rate",), "0.5"),
        (("rate",), True),
        (("rate",), 10**400),
        (("covered_by",), 3),
        (("reason",), None),
        (("notes",), "text"),
        (("notes",), [1]),
        (("checks",), {}),
        (("checks", 0), []),
        (("checks", 0, "id"), "theorem9"),
        (("checks", 0, "id"), ["lemma1"]),
        (("checks", 0, "verdict"), "Proved"),
        (("checks", 0, "margin"), False),
        (("checks", 0, "domain"), None),
        (("checks", 0, "domain"), ["global"]),
        (("checks", 0, "exact"), None),
        (("checks", 0, "exact"), "abc"),
        (("checks", 0, "mode"), 7),
        (("checks", 0, "fix"), {"kind": "x"}),
        (("checks", 0, "witness"), {"kind": "vector", "values": "12"}),
        (("checks", 0, "witness"), {"kind": "vector", "values": [1]}),
        (("observer", "W"), [["1"], ["2", "3"]]),
        (("observer", "W"), [[1.5], [2]]),
        (("observer", "W"), [["nan"], ["1"]]),
        (("observer", "W"), [["1/0"], ["1"]]),
        (("observer", "W"), []),
        (("observer", "W"), "W"),
        (("observer",), None),
    ],
)
def test_other_documents_are_refused(document, path, value):
    """Unknown, missing, doubled and mistyped fields: never a guess, never another exception."""
    with pytest.raises(CertificateError, match="cannot be read"):
        read_claims(as_bytes(changed(document, *path, value=value)))


def test_missing_fields_are_refused(document):
    for name in document:
        with pytest.raises(CertificateError, match="cannot be read"):
            read_claims(as_bytes({key: value for key, value in document.items() if key != name}))
    for name in ("id", "verdict", "domain", "margin", "rate", "reason"):
        check = {key: value for key, value in document["checks"][0].items() if key != name}
        with pytest.raises(CertificateError, match="cannot be read"):
            read_claims(as_bytes(changed(document, "checks", 0, value=check)))


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"[]",
        b"null",
        b"1",
        b"{",
        b"\xff\xfe",
        b"[" * 100_000,
        b'{"format": "dobc-certificate"}',
        b'{"format": "dobc-certificate", "format": "dobc-certificate", "version": 1}',
        b"9" * 5000,
    ],
)
def test_other_bytes_are_refused(data):
    with pytest.raises(CertificateError, match="cannot be read"):
        read_claims(data)


@pytest.mark.parametrize("text", ["NaN", "Infinity", "-Infinity", "1e999", "-1e999"])
def test_numbers_that_are_not_finite_are_refused(document, text):
    data = as_bytes(document).replace(b'"rate": null', b'"rate": ' + text.encode(), 1)
    assert data != as_bytes(document)
    with pytest.raises(CertificateError, match="cannot be read"):
        read_claims(data)


def test_a_doubled_field_is_refused(document):
    """Two readers may take different ones of the two."""
    data = as_bytes(document).replace(b'"verdict": "proved"', b'"verdict": "refuted", "verdict": "proved"', 1)
    assert json.loads(data)["verdict"] == "proved"
    with pytest.raises(CertificateError, match="twice"):
        read_claims(data)


def test_a_huge_file_is_refused_before_it_is_parsed(monkeypatch):
    monkeypatch.setattr("dobc_design.certificate.text.MAX_BYTES", 10)
    with pytest.raises(CertificateError, match="too large"):
        read_claims(b"x" * 11)


def with_margin(text: str) -> tuple[bytes, Problem]:
    """One agent with the gain k = 1/10 + 1e-30, and a certificate with this margin; what is true is less than 2 k."""
    problem = Problem(
        network=Network.from_arcs([], arrow="listens_to", agents=1),
        coupling="y",
        gains={1: "100000000000000000000000000001e-30"},
    )
    document = certificate_document(certify(problem).claims)
    lemma = next(check for check in document["checks"] if check["id"] == "lemma1")
    lemma["margin"] = "the margin"
    return json.dumps(document).replace('"the margin"', text).encode(), problem


@pytest.mark.parametrize(
    ("text", "true"),
    [
        ("0.2", True),
        ("0.2000000000000000000000000000000", True),
        ("20000000000000000000000000000000000000000000000000e-50", True),
        ("0.200000000000000000000000000002", False),
        ("0.2000000000000000000000000000021", False),
        ("1", False),
    ],
)
def test_a_number_with_more_digits_than_a_float_is_not_read_as_a_smaller_claim(text, true):
    """2 k = 0.200000000000000000000000000002 and the margin has to stay below; the nearest float says 0.2."""
    data, problem = with_margin(text)
    assert (recheck(data, problem).failures == ()) is true
    assert all(holds for holds, _ in checker.examine(data, canonical_bytes(problem))) is true


@pytest.mark.parametrize("text", ["1e-99999999999999999999999", "1e99999999999999999999", "-1e999999999", "1e400"])
def test_numbers_that_no_float_comes_near_are_refused_at_once(text):
    data, problem = with_margin(text)
    with pytest.raises(CertificateError, match="cannot be read"):
        recheck(data, problem)


def test_whole_numbers_beyond_the_floats_are_rounded_to_the_larger_claim():
    assert number_or_none(2**53 + 1) > 2**53 + 1
    assert number_or_none(-(2**53) - 1) < -(2**53) - 1
    assert number_or_none(2**53) == 2**53
