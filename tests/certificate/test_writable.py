"""Numbers longer than a certificate holds: the check claims less, and the certificate stays readable."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from math import comb
from random import Random

import pytest

from dobc_design.certificate.text import LONGEST_COEFFICIENT, writable
from dobc_design.certification.certify import certify, verify
from dobc_design.conditions.check import Check, Fix, Values, Witness
from dobc_design.conditions.numbers import LONGEST
from dobc_design.exact.number import number_text
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.groups import Observer
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

PROVED, REFUTED, UNDECIDED = Verdict.PROVED, Verdict.REFUTED, Verdict.UNDECIDED


def long_number(random: Random, digits: int) -> Fraction:
    return Fraction(random.randrange(10**digits), 10**digits + random.randrange(10**digits))


def network_of_two(**parts) -> Problem:
    network = Network.from_arcs([[2, 1]], arrow="listens_to", agents=2)
    return Problem(network=network, coupling="y", gains={1: 3}, **parts)


def hidden_problem(order: int, digits: int) -> Problem:
    """An unstable part that C does not see, whose characteristic polynomial has long coefficients."""
    random = Random(1)
    rows = [[long_number(random, digits) for _ in range(order)] for _ in range(order)]
    A = [[-1] + [0] * order, *([0, *row] for row in rows)]
    return network_of_two(exosystem=Exosystem(A=A, C=[[1] + [0] * order]))


def companion_problem(order: int, digits: int) -> Problem:
    """A pair in observer form with W = 0 and nearly (s + 1)^order: long rationals meet in Routh's table."""
    random = Random(2)
    first = [-comb(order, i + 1) - long_number(random, digits) for i in range(order)]
    A = [[first[i]] + [int(j == i + 1) for j in range(1, order)] for i in range(order)]
    W = [[0]] * order
    return network_of_two(exosystem=Exosystem(A=A, C=[[1] + [0] * (order - 1)]), observer=Observer(W=W))


def star_problem(leaves: int, digits: int) -> Problem:
    """One agent that is pushed away by many others: v' Lambda v has the common denominator of all weights."""
    random = Random(3)
    arcs = [[1, j + 2, long_number(random, digits)] for j in range(leaves)]
    network = Network.from_arcs(arcs, arrow="listens_to", agents=leaves + 1)
    return Problem(network=network, coupling="-y", gains=1)


def vector_check(*values: str) -> Check:
    return Check(
        id="lemma1",
        mode="G",
        verdict=REFUTED,
        domain="consensus",
        reason="",
        claim=Values({"unstable_roots": "0"}),
        witness=Witness(kind="vector", labels=("1",), values=values),
    )


@pytest.mark.parametrize("digits", [LONGEST, LONGEST + 1])
def test_a_number_of_a_witness_may_be_as_long_as_a_checker_reads_and_no_longer(digits):
    check = vector_check("1" + "0" * (digits - 1))
    assert writable(check) == check if digits <= LONGEST else writable(check).verdict is UNDECIDED


def quotient(prime: int, power: int) -> str:
    return number_text(Fraction(1, prime**power))


def test_the_common_denominator_of_a_witness_is_bounded():
    """docs/certificate-format.md: 65 536 bits; each of these numbers may stand there alone."""
    two, three, five = quotient(2, 30_000), quotient(3, 18_000), quotient(5, 4000)
    assert (2**30_000 * 3**18_000).bit_length() < 2**16 < (2**30_000 * 3**18_000 * 5**4000).bit_length()
    assert writable(vector_check(two, three)) == vector_check(two, three)
    assert writable(vector_check(two, three, five)).verdict is UNDECIDED


@pytest.mark.parametrize("digits", [LONGEST_COEFFICIENT, LONGEST_COEFFICIENT + 1])
def test_a_polynomial_may_be_long_and_its_coefficients_not(digits):
    text = " + ".join(f"{'7' * digits} s^{k}" for k in (9, 8, 7)) + " + 1"
    check = Check(
        id="detectability", verdict=PROVED, domain="global", reason="", claim=Values({"unobservable_polynomial": text})
    )
    assert (writable(check) == check) is (digits <= LONGEST_COEFFICIENT)


def test_what_is_no_number_may_be_long():
    check = Check(
        id="lemma1",
        verdict=PROVED,
        domain="global",
        reason="x" * 20_000,
        claim=Values({"mode": "G" * 20_000, "v": {"float64": "A" * 20_000}}),
        witness=Witness(kind="agents", labels=("9" * 20_000,)),
    )
    assert writable(check) == check


def test_an_undecided_check_keeps_its_cure_and_says_what_to_do():
    fix = Fix(kind="pinning", set={"pinning.gains": 1}, text="Pin agent 1.")
    check = writable(replace(vector_check("1" * (LONGEST + 1)), fix=fix))
    assert (check.verdict, check.mode, check.fix, check.margin) == (UNDECIDED, "G", fix, None)
    assert (check.exact, check.witness) == (None, None)
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


@pytest.mark.parametrize(("order", "verdict"), [(3, REFUTED), pytest.param(7, UNDECIDED, marks=pytest.mark.slow)])
def test_a_hidden_part_with_long_coefficients_is_undecided_and_the_certificate_holds(order, verdict):
    """49 entries with denominators of 95 digits each: over 4000 digits in the polynomial."""
    problem = hidden_problem(order, 95)
    certificate = certify(problem)
    assert certificate.check("detectability").verdict is verdict
    assert certificate.verdict is UNDECIDED
    assert verify(certificate, problem).failures == ()


@pytest.mark.parametrize(("order", "verdict"), [(6, PROVED), pytest.param(14, UNDECIDED, marks=pytest.mark.slow)])
def test_a_column_of_routh_that_is_too_long_is_undecided_and_the_certificate_holds(order, verdict):
    problem = companion_problem(order, 95)
    certificate = certify(problem)
    assert certificate.check("hurwitz").verdict is verdict
    assert verify(certificate, problem).failures == ()


def test_small_decimals_in_a_polynomial_are_written_as_quotients():
    """The lone checker compares polynomials as texts, in lowest terms."""
    problem = network_of_two(exosystem=Exosystem(A=[[0, 0], [0, "-1e-250"]], C=[[1, 0]]))
    certificate = certify(problem)
    assert certificate.check("detectability").exact["unobservable_polynomial"] == f"s + 1/1{'0' * 250}"
    assert verify(certificate, problem).failures == ()
