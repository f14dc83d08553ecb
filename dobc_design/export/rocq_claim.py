"""What a Coq file is to prove about one problem, taken from its certificate and factored: LDL' of every matrix."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

from dobc_design.certificate.certificate import Certificate
from dobc_design.conditions.consensus.claim import Jacobians, Statements, state_theorems
from dobc_design.conditions.numbers import claimed
from dobc_design.errors import SpecError
from dobc_design.exact.matrix import Matrix, multiply
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.export.squares import Square, factor
from dobc_design.problem.canonical import problem_sha256
from dobc_design.problem.exosystem import Exosystem
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

# Rows of Psi, and squared bits to be multiplied: 10^9 of them take Coq about a minute and a half.
LARGEST_SIZE = 150
LARGEST_WORK = 10**10

Factors = tuple[Square, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class PairClaim:
    """The part of a claim that the observer adds: its matrices, and P = LDL'."""

    exosystem: Exosystem
    W: Matrix
    P: Matrix
    Q: Matrix
    P_factors: Factors


@dataclass(frozen=True, slots=True, kw_only=True)
class RocqClaim:
    """Psi < 0 in every mode, and with a rate also Psi + 2 rate V < 0; each by the LDL' of its negative.

    ``factors`` and ``rate_factors`` go by the name of the mode; the latter is empty without a rate.
    Without a ``pair`` Psi is Lambda.
    """

    id: str
    problem: Problem
    jacobians: Jacobians
    pair: PairClaim | None
    rate: Fraction | None
    factors: dict[str, Factors]
    rate_factors: dict[str, Factors]


def read_claim(certificate: Certificate, *, rate: bool) -> RocqClaim:
    """Read what the certificate proves, and factor its matrices.

    Raises: SpecError if nothing is proved, if it cannot be stated in rationals or is too large, or if the
    numbers in the certificate do not prove what it claims.
    """
    problem = certificate.problem
    if certificate.claims.problem_sha256 != problem_sha256(problem):
        raise SpecError(
            "the certificate is about another problem: its hash differs.",
            key="problem_sha256",
            cure="Give the problem it was made for.",
        )
    id = _proved_id(certificate)
    statements = state_theorems(problem)
    jacobians = _rational_jacobians(statements)
    pair = None if problem.exosystem is None else _pair(certificate, problem.exosystem)
    claimed_rate = _rate(certificate, id) if rate else None
    return RocqClaim(
        id=id,
        problem=problem,
        jacobians=jacobians,
        pair=pair,
        rate=claimed_rate,
        factors=_factors(statements, pair, Fraction(0)),
        rate_factors={} if claimed_rate is None else _factors(statements, pair, claimed_rate),
    )


def _proved_id(certificate: Certificate) -> str:
    modes: tuple[str | None, ...] = tuple(certificate.problem.network.modes)
    id = "lemma1"
    if certificate.problem.exosystem is not None:
        id = "theorem1" if len(modes) == 1 else "theorem2"
        modes = (None,)
    found = {check.mode: check.verdict for check in certificate.checks if check.id == id}
    for mode in modes:
        verdict = found.get(mode)
        if verdict is not Verdict.PROVED:
            title = id if mode is None else f"{id} ({mode})"
            said = "missing" if verdict is None else verdict.value
            raise SpecError(
                f"only a proved theorem can be exported; {title} is {said} in this certificate.",
                key="checks",
                cure="Certify a problem for which it is proved.",
            )
    return id


def _rational_jacobians(statements: Statements) -> Jacobians:
    problem, jacobians = statements.problem, statements.jacobians
    size = problem.n * (problem.m + problem.q)
    if size > LARGEST_SIZE:
        raise _too_large(
            f"Psi must have at most {LARGEST_SIZE} rows, so that Coq ends within a quarter of an hour; it has {size}."
        )
    if jacobians is None:
        raise SpecError(
            f"the theorem cannot be exported: {statements.inapplicable}",
            key="coupling.h",
            cure="Check the certificate with `dobc verify`.",
        )
    if not all(mode.is_point for mode in jacobians.modes):
        texts = next(
            each.texts
            for each in problem.couplings
            if not all(entry.is_point for row in each.jacobian_at_zero() for entry in row)
        )
        raise SpecError(
            f'coupling "{"; ".join(texts)}": its slope h\'(0) must be a rational number, because Coq is given Psi in'
            " rationals; it is known as an interval only.",
            key="coupling.h",
            cure="Use a coupling with a rational slope at 0, or rely on `dobc verify`.",
        )
    return jacobians


def _pair(certificate: Certificate, exosystem: Exosystem) -> PairClaim:
    claims = certificate.claims
    W, P, Q = claims.W, claims.P, claims.Q
    if W is None or P is None or Q is None or multiply(P, W) != Q:
        raise _unsound("the certificate must hold W, P and Q with Q = P W.")
    factors = _factored(SparseSymmetric.from_dense(P, name="P"), "P")
    return PairClaim(exosystem=exosystem, W=W, P=P, Q=Q, P_factors=factors)


def _rate(certificate: Certificate, id: str) -> Fraction:
    """The decay rate claimed for every mode, in 1/s."""
    rates = [check.rate for check in certificate.checks if check.id == id]
    known = [claimed(each) for each in rates if each]
    if not known or len(known) != len(rates):
        raise SpecError(f"the certificate claims no decay rate for {id}.", key="rate", cure="Export it without one.")
    return min(known)


def _factors(statements: Statements, pair: PairClaim | None, rate: Fraction) -> dict[str, Factors]:
    """Mode -> LDL' of -(Psi + 2 rate V)."""
    constants = [each.constant for each in statements.lambdas.values()]
    matrices = [each.shifted(2 * rate) for each in constants if isinstance(each, SparseSymmetric)]
    if len(matrices) < len(constants):
        raise _too_large("Lambda of so large a network would take Coq hours.")
    if pair is not None:
        matrices = [each.at({"P": pair.P, "Q": pair.Q}) for each in statements.psi(rate=rate)]
    result = {
        mode: _factored(matrix.negated(), f"-Psi of mode {mode}")
        for mode, matrix in zip(statements.lambdas, matrices, strict=True)
    }
    if sum(_work(factors) for factors in result.values()) > LARGEST_WORK:
        raise _too_large("the fractions in L and D of Psi are too long for Coq to end within a quarter of an hour.")
    return result


def _factored(matrix: SparseSymmetric, name: str) -> Factors:
    factors = factor(matrix)
    if factors is None:
        raise _unsound(f"{name} must be positive definite, as the certificate claims; it is not.")
    return factors


def _work(factors: Factors) -> int:
    """How many bits have to be multiplied with how many to multiply L D L' out, roughly."""
    total = 0
    for each in factors:
        longest = max(_bits(x) for x in (each.weight, *each.others.values()))
        total += (len(each.others) + 1) ** 2 * longest**2
    return total


def _bits(x: Fraction) -> int:
    return x.numerator.bit_length() + x.denominator.bit_length()


def _too_large(message: str) -> SpecError:
    return SpecError(message, key="network", cure="`dobc verify` checks certificates of any size.")


def _unsound(message: str) -> SpecError:
    return SpecError(message, key="observer", cure="Check the certificate with `dobc verify`, and make it again.")
