"""certificate.json: the same claims there and back, and one kind of error for everything that is
none."""

import json
from dataclasses import replace
from fractions import Fraction
from itertools import chain, product
from math import comb
from random import Random

import pytest
from campaigns.certificates import a_problem
from certified import certified

from dobc_design import Exosystem, Network, Observer, Problem, Verdict, certify, verify
from dobc_design.certificate.text import (
    LONGEST_COEFFICIENT,
    certificate_bytes,
    certificate_document,
    read_claims,
    writable,
)
from dobc_design.certification.recheck import recheck
from dobc_design.checker import examine as checker
from dobc_design.conditions.check import Check, Fix, Values, Witness, number_or_none
from dobc_design.conditions.domain import EVERYWHERE, NEAR_TARGET, Box
from dobc_design.conditions.numbers import LONGEST
from dobc_design.errors import CertificateError
from dobc_design.exact.matrix import identity, multiply, scale, solve_lyapunov
from dobc_design.exact.number import number_text
from dobc_design.problem.canonical import canonical_bytes


@pytest.fixture(scope="module")
def document():
    return json.loads(certificate_bytes(certified("paper-fixed").claims))


def as_bytes(document):
    return json.dumps(document).encode()


@pytest.mark.slow
def test_claims_come_back_as_they_were_written_and_the_same_problem_gives_the_same_bytes():
    """No time stamps; same input and versions give the same claims."""
    for seed in range(10):
        claims = certify(a_problem(seed)).claims
        data = certificate_bytes(claims)
        assert read_claims(data) == claims
        assert certificate_bytes(read_claims(data)) == data
        if seed <= 2:
            assert certificate_bytes(certify(a_problem(seed)).claims) == data


def test_the_document_has_the_fields_of_the_contract(document):
    assert document["format"] == "dobc-certificate"
    needed = {"id", "verdict", "domain", "margin", "rate", "factor", "reason"}
    for check in document["checks"]:
        assert needed <= set(check) <= needed | {"mode", "exact", "witness", "fix"}


def test_numbers_longer_than_anybody_types_are_read_back(monkeypatch):
    """The last pair that is tried comes from an exact Lyapunov equation: hundreds of digits."""
    A = [["0"] * 4 for _ in range(4)]
    for i, j in product(range(4), repeat=2):
        over = (i * 7 + j * 3) % 11 - 50 * (i == j)
        A[i][j] = f"{over}/{10**9 + 7 * i + j}"
    network = Network.from_arcs([], arrow="listens_to", agents=1)
    observer = Observer(W=[[0]] * 4)
    problem = Problem(
        network=network,
        coupling="y",
        gains="1/1000000007",
        exosystem=Exosystem(A=A, C=[["1/3", "3/7", "-5/11", "1/13"]]),
        observer=observer,
    )

    def exact_only(exosystem, W, *, bound, decay):
        P = scale(10**40, solve_lyapunov(exosystem.A, identity(exosystem.order)))
        yield P, multiply(P, W), ""

    monkeypatch.setattr("dobc_design.certification.certify.propose_pairs", exact_only)
    certificate = certify(problem)
    data = certificate_bytes(certificate.claims)
    P = json.loads(data)["observer"]["P"]
    assert max(map(len, chain.from_iterable(P))) > 200
    assert read_claims(data) == certificate.claims
    assert verify(data, problem).holds


def changed(document, *path, value):
    copy = json.loads(json.dumps(document))
    holder = copy
    for name in path[:-1]:
        holder = holder[name]
    holder[path[-1]] = value
    return copy


#: Places of a certificate, each with something that cannot stand there.
OTHERS = []


def no(*path_and_values):
    """No one of these values, which come in a list last, may stand at this place."""
    *path, values = path_and_values
    for value in values:
        OTHERS.append((tuple(path), value))


no("extra", [1])
no("program", "path", ["x"])
no("version", [2, "1", 1.0, True])
no("format", ["other"])
no("verdict", ["perhaps", None])
no("rate", ["0.5", True, 10**400])
no("covered_by", [3])
no("reason", [None])
no("notes", ["text", [1]])
no("observer", [None])
no("observer", "K", [None])
no("observer", "W", [[["1"], ["2", "3"]], [[1.5], [2]], [["nan"], ["1"]]])
no("observer", "W", [[["1/0"], ["1"]], [], "W"])
no("checks", [{}])
no("checks", 0, [[]])
no("checks", 0, "id", ["theorem9", ["lemma1"]])
no("checks", 0, "mode", [7])
no("checks", 0, "verdict", ["Proved"])
no("checks", 0, "margin", [False])
no("checks", 0, "domain", [None, ["global"]])
no("checks", 0, "exact", [None, "abc"])
no("checks", 0, "evidence", [{}])
no("checks", 0, "fix", [{"kind": "x"}])
for more in ({"note": "x"}, {"values": "12"}, {"values": [1]}):
    no("checks", 0, "witness", [{"kind": "vector"} | more])


@pytest.mark.parametrize(("path", "value"), OTHERS)
def test_other_documents_are_refused(document, path, value):
    """Unknown, missing, doubled and mistyped fields: never a guess, never another exception."""
    with pytest.raises(CertificateError, match="cannot be read"):
        read_claims(as_bytes(changed(document, *path, value=value)))


def test_missing_fields_are_refused(document):
    # certificates of earlier versions have no factor
    for name in set(document) - {"factor"}:
        less = dict(document)
        del less[name]
        with pytest.raises(CertificateError, match="cannot be read"):
            read_claims(as_bytes(less))
    for name in ("id", "verdict", "domain", "margin", "rate", "reason"):
        check = dict(document["checks"][0])
        del check[name]
        with pytest.raises(CertificateError, match="cannot be read"):
            read_claims(as_bytes(changed(document, "checks", 0, value=check)))


HEAD = b'"format": "dobc-certificate"'


BYTES = [b"", b"[]", b"null", b"1", b"{", b"\xff\xfe", b"[" * 100_000, b"9" * 5000]
BYTES.append(b"{" + HEAD + b"}")
BYTES.append(b"{" + HEAD + b", " + HEAD + b', "version": 1}')


@pytest.mark.parametrize("data", BYTES)
def test_other_bytes_are_refused(data):
    with pytest.raises(CertificateError, match="cannot be read"):
        read_claims(data)


@pytest.mark.parametrize("text", ["NaN", "Infinity", "-Infinity", "1e999", "-1e999"])
def test_numbers_that_are_not_finite_are_refused(document, text):
    data = as_bytes(document).replace(b'"rate": null', b'"rate": ' + text.encode(), 1)
    assert data != as_bytes(document)
    with pytest.raises(CertificateError, match="cannot be read"):
        read_claims(data)


def test_a_huge_file_is_refused_before_it_is_parsed(monkeypatch):
    monkeypatch.setattr("dobc_design.certificate.text.MAX_BYTES", 10)
    with pytest.raises(CertificateError, match="too large"):
        read_claims(b"x" * 11)


def with_margin(text: str) -> tuple[bytes, Problem]:
    """One agent with the gain k = 1/10 + 1e-30, and a certificate with this margin; what is true is
    less than 2 k."""
    alone = Network.from_arcs([], arrow="listens_to", agents=1)
    problem = Problem(network=alone, coupling="y", gains={1: "100000000000000000000000000001e-30"})
    document = certificate_document(certify(problem).claims)
    lemma = next(check for check in document["checks"] if check["id"] == "lemma1")
    lemma["margin"] = "the margin"
    return json.dumps(document).replace('"the margin"', text).encode(), problem


MARGINS = {"0.2": True, f"0.2{'0' * 30}": True, f"2{'0' * 49}e-50": True}
MARGINS |= {f"0.2{'0' * 28}2": False, f"0.2{'0' * 28}21": False, "1": False}


@pytest.mark.parametrize(("text", "true"), MARGINS.items())
def test_a_number_with_more_digits_than_a_float_is_not_read_as_a_smaller_claim(text, true):
    """2 k = 0.200000000000000000000000000002 and the margin has to stay below; the nearest float
    says 0.2."""
    data, problem = with_margin(text)
    assert (recheck(data, problem).failures == ()) is true
    found = checker.examine(data, canonical_bytes(problem))
    assert all(holds for holds, _ in found) is true


FAR = ["1e-99999999999999999999999", "1e99999999999999999999", "-1e999999999", "1e400"]


@pytest.mark.parametrize("text", FAR)
def test_numbers_that_no_float_comes_near_are_refused_at_once(text):
    data, problem = with_margin(text)
    with pytest.raises(CertificateError, match="cannot be read"):
        recheck(data, problem)


def test_whole_numbers_beyond_the_floats_are_rounded_to_the_larger_claim():
    assert number_or_none(2**53 + 1) > 2**53 + 1
    assert number_or_none(-(2**53) - 1) < -(2**53) - 1
    assert number_or_none(2**53) == 2**53


PROVED, REFUTED, UNDECIDED = Verdict.PROVED, Verdict.REFUTED, Verdict.UNDECIDED


def long_number(random: Random, digits: int) -> Fraction:
    numerator = random.randrange(10**digits)
    return Fraction(numerator, 10**digits + random.randrange(10**digits))


def network_of_two(**parts) -> Problem:
    network = Network.from_arcs([[2, 1]], arrow="listens_to", agents=2)
    return Problem(network=network, coupling="y", gains={1: 3}, **parts)


def hidden_problem(order: int, digits: int) -> Problem:
    """An unstable part that C does not see, whose characteristic polynomial has long
    coefficients."""
    random = Random(1)
    rows = []
    for _ in range(order):
        rows.append([long_number(random, digits) for _ in range(order)])
    first = [-1] + [0] * order
    A = [first, *([0, *row] for row in rows)]
    C = [[1] + [0] * order]
    exosystem = Exosystem(A=A, C=C)
    return network_of_two(exosystem=exosystem)


def companion_problem(order: int, digits: int) -> Problem:
    """A pair in observer form with W = 0 and nearly (s + 1)^order: long rationals meet in Routh's
    table."""
    random = Random(2)
    A = []
    for i in range(order):
        first = -comb(order, i + 1) - long_number(random, digits)
        row = [first, *(int(j == i + 1) for j in range(1, order))]
        A.append(row)
    C = [1] + [0] * (order - 1)
    exosystem = Exosystem(A=A, C=[C])
    return network_of_two(exosystem=exosystem, observer=Observer(W=[[0]] * order))


def star_problem(leaves: int, digits: int) -> Problem:
    """One agent that is pushed away by many others: v' Lambda v has the common denominator of all
    weights."""
    random = Random(3)
    arcs = []
    for j in range(leaves):
        arcs.append([1, j + 2, long_number(random, digits)])
    network = Network.from_arcs(arcs, arrow="listens_to", agents=leaves + 1)
    return Problem(network=network, coupling="-y", gains=1)


def vector_check(*values: str) -> Check:
    claim = Values({"unstable_roots": "0"})
    witness = Witness(kind="vector", labels=("1",), values=values)
    return Check(
        id="lemma1",
        mode="G",
        verdict=REFUTED,
        domain=NEAR_TARGET,
        reason="",
        claim=claim,
        witness=witness,
    )


@pytest.mark.parametrize("digits", [LONGEST, LONGEST + 1])
def test_a_number_of_a_witness_may_be_as_long_as_a_checker_reads_and_no_longer(digits):
    check = vector_check("1" + "0" * (digits - 1))
    found = writable(check, NEAR_TARGET)
    if digits <= LONGEST:
        assert found == check
    else:
        assert found.verdict is UNDECIDED


def test_the_common_denominator_of_a_witness_is_bounded():
    """docs/certificate-format.md: 65 536 bits; each of these numbers may stand there alone."""
    powers = (2**30_000, 3**18_000, 5**4000)
    two, three, five = (number_text(Fraction(1, power)) for power in powers)
    common = powers[0] * powers[1]
    assert common.bit_length() < 2**16
    assert (common * powers[2]).bit_length() > 2**16
    short = vector_check(two, three)
    assert writable(short, NEAR_TARGET) == short
    long = vector_check(two, three, five)
    assert writable(long, NEAR_TARGET).verdict is UNDECIDED


@pytest.mark.parametrize("digits", [LONGEST_COEFFICIENT, LONGEST_COEFFICIENT + 1])
def test_a_polynomial_may_be_long_and_its_coefficients_not(digits):
    text = " + ".join(f"{'7' * digits} s^{k}" for k in (9, 8, 7)) + " + 1"
    claim = Values({"unobservable_polynomial": text})
    check = Check(id="detectability", verdict=PROVED, domain=EVERYWHERE, reason="", claim=claim)
    assert (writable(check, NEAR_TARGET) == check) is (digits <= LONGEST_COEFFICIENT)


def test_what_is_no_number_may_be_long():
    v = {"float64": "A" * 20_000}
    claim = Values({"mode": "G" * 20_000, "v": v})
    witness = Witness(kind="agents", labels=("9" * 20_000,))
    check = Check(
        id="lemma1",
        verdict=PROVED,
        domain=EVERYWHERE,
        reason="x" * 20_000,
        claim=claim,
        witness=witness,
    )
    assert writable(check, NEAR_TARGET) == check


def test_an_undecided_check_keeps_its_cure_and_says_what_to_do():
    fix = Fix(kind="pinning", set={"pinning.gains": 1}, text="Pin agent 1.")
    long_check = vector_check("1" * (LONGEST + 1))
    fixed = replace(long_check, fix=fix)
    check = writable(fixed, NEAR_TARGET)
    assert check.verdict is UNDECIDED
    assert check.mode == "G"
    assert check.fix == fix
    assert check.margin is None
    assert check.exact is None
    assert check.witness is None
    assert "it is refuted here" in check.reason
    assert "fewer digits" in check.reason


def test_a_bound_that_is_too_long_is_left_out_and_the_refutation_stays():
    """v' Lambda v has the common denominator of 60 weights of 190 digits each."""
    problem = star_problem(60, 95)
    certificate = certify(problem)
    lemma = certificate.check("lemma1", "G")
    assert lemma.verdict is REFUTED
    assert "value" not in lemma.exact
    assert verify(certificate, problem).failures == ()
    few = certify(star_problem(20, 95)).check("lemma1", "G")
    assert len(few.exact["value"]) > 2000


@pytest.mark.parametrize(
    ("make", "order", "id", "verdict"),
    [
        (hidden_problem, 3, "detectability", REFUTED),
        pytest.param(hidden_problem, 7, "detectability", UNDECIDED, marks=pytest.mark.slow),
        (companion_problem, 4, "hurwitz", PROVED),
        pytest.param(companion_problem, 14, "hurwitz", UNDECIDED, marks=pytest.mark.slow),
    ],
)
def test_a_polynomial_or_a_column_of_routh_that_is_too_long_is_undecided_and_the_certificate_holds(
    make, order, id, verdict
):
    """Up to 49 entries with denominators of 95 digits each: over 4000 digits in the polynomial."""
    problem = make(order, 95)
    certificate = certify(problem)
    assert certificate.check(id).verdict is verdict
    assert certificate.verdict is UNDECIDED or make is companion_problem
    assert verify(certificate, problem).failures == ()


def test_small_decimals_in_a_polynomial_are_written_as_quotients():
    """The lone checker compares polynomials as texts, in lowest terms."""
    A = [[0, 0], [0, "-1e-250"]]
    C = [[1, 0]]
    exosystem = Exosystem(A=A, C=C)
    problem = network_of_two(exosystem=exosystem)
    certificate = certify(problem)
    exact = certificate.check("detectability").exact
    assert exact["unobservable_polynomial"] == f"s + 1/1{'0' * 250}"
    assert verify(certificate, problem).failures == ()


def test_a_check_that_claims_nothing_any_more_keeps_no_box():
    box = Box(1.0, 0.0)
    claim = Values({"v": ["1" * (LONGEST + 1)]})
    check = Check(id="max-separable", verdict=PROVED, domain=box, rate=1.0, reason="", claim=claim)
    check = writable(check, NEAR_TARGET)
    assert check.verdict is UNDECIDED
    assert check.domain == NEAR_TARGET
    assert check.rate is None
    assert check.exact is None
