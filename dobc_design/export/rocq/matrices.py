"""A certificate's Theorem 1, 2 or Lemma 1 as a file that the kernel of Coq checks.

The file states the problem in rationals, builds Psi from it inside Coq, and proves x' Psi x < 0 for
every x other than 0, rational or real, from Psi = -L D L' multiplied out by the kernel; it needs
Coq's standard library alone. Nothing here is trusted: a wrong number makes a file that Coq
refuses.  Coq does not see h: h'(0) enter as numbers.
"""

import textwrap
from collections.abc import Callable, Iterable, Mapping
from fractions import Fraction

from dobc_design._checks import noun
from dobc_design.certificate.certificate import Certificate
from dobc_design.conditions.consensus.claim import (
    Jacobians,
    ModeJacobian,
    Statements,
    state_theorems,
)
from dobc_design.conditions.kinds import KINDS
from dobc_design.conditions.numbers import claimed
from dobc_design.coupling.coupling import Coupling
from dobc_design.errors import SpecError, refused
from dobc_design.exact.cholesky import Square, squares_of
from dobc_design.exact.matrix import Matrix, multiply
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.export.c_text import template
from dobc_design.loop.make import loop_of
from dobc_design.problem.canonical import problem_sha256
from dobc_design.verdict import Verdict

WIDTH = 110  # characters of a line, where numbers allow it


def comment(*paragraphs: str) -> str:
    """A comment, whatever the text: it can neither end the comment nor open a comment or string in
    it."""
    lines: list[str] = []
    for text in paragraphs:
        harmless = text.replace('"', "'").replace("(*", "( *").replace("*)", "* )")
        plain = harmless.encode("ascii", "backslashreplace").decode("ascii")
        lines += textwrap.wrap(plain, WIDTH - 6)
    return "(* " + "\n   ".join(lines) + " *)"


def number(x: Fraction) -> str:
    """A rational: 3, (-3), (3 # 7)."""
    if x.denominator == 1:
        return str(x.numerator) if x >= 0 else f"({x.numerator})"
    return f"({x.numerator} # {x.denominator})"


def matrix(M: Matrix, number: Callable[[Fraction], str] = number) -> str:
    """A matrix by its rows; ``number``: how Coq writes an entry."""
    rows = ["; ".join(map(number, row)) for row in M]
    return "matrix [" + "; ".join(f"[{row}]" for row in rows) + "]"


def wrapped_list(items: Iterable[str]) -> str:
    """A list over as many lines as it needs."""
    lines: list[str] = []
    for item in items:
        if lines and len(lines[-1]) + len(item) + 6 <= WIDTH:
            lines[-1] += f"; {item}"
        else:
            lines.append(item)
    return "  [" + ";\n   ".join(lines) + "]"


def square_list(squares: Iterable[Square]) -> str:
    """The columns of L with their entries of D, in the order of elimination."""
    items = []
    for each in squares:
        head = f"Square {number(each.weight)} {each.pivot}"
        terms = [f"Term {i} {number(x)}" for i, x in each.others.items()]
        items.append(f"{head}\n  {wrapped_list(terms)}" if terms else f"{head} []")
    return "  [" + ";\n   ".join(items) + "]"


# Rows of Psi, and squared bits to be multiplied: 10^9 of them take Coq about a minute and a half.
LARGEST_SIZE = 150
LARGEST_WORK = 10**10

Factors = tuple[Square, ...]


def rocq_proof(certificate: Certificate, *, rate: bool = False) -> str:
    """Return the text of a Coq file that proves the certificate's theorem.  With an exosystem:
    theorem1 or theorem2, with the certificate's P and Q = P W, for all modes.  Without: lemma1 of
    every mode.  ``rate`` adds the claimed decay rate.  The same certificate gives the same text.
    Raises: SpecError if that is not proved in the certificate, if a slope h'(0) is irrational, if
    the problem is too large for Coq, or if the numbers in the certificate do not prove what it
    claims. Source: theory, sections 2 and 3.  Tested with Coq 8.16."""
    require_own(certificate)
    problem = certificate.problem
    id = _proved_id(certificate)
    title = KINDS[id].short
    statements = state_theorems(loop_of(problem))
    jacobians = _rational_jacobians(statements)
    # P, Q, and what they are about, enter as numbers; Coq builds Psi from them itself.
    matrices = _matrices(certificate)
    P_squares: Factors = ()
    if matrices:
        P_squares = _factored(SparseSymmetric.from_dense(matrices["P"], name="P"), "P")
    claimed_rate = _rate(certificate, id) if rate else None
    factors = _factors(statements, matrices, Fraction(0))
    rate_factors = factors
    if claimed_rate is not None:
        rate_factors = _factors(statements, matrices, claimed_rate)
    # Each matrix has one definition, however many arcs it stands for.
    slopes = _named("slope", [each for mode in jacobians.modes for each in _slopes(mode)])
    modes = []
    for mode in jacobians.modes:
        squares, rate_squares = factors[mode.name], rate_factors[mode.name]
        modes.append(
            _Mode(
                name=mode.name,
                arcs=_arcs(mode, slopes),
                squares=squares,
                rate_squares=rate_squares,
            )
        )
    pinning = problem.pinning.gains
    gains = _named("gain", pinning.values())
    return template("rocq_matrices.v.j2").render(
        head=_head(certificate, title),
        id=id,
        title=title,
        problem=problem,
        agents=", ".join(f"{i} is {label}" for i, label in enumerate(problem.network.labels)),
        couplings=", and ".join("; ".join(coupling.texts) for coupling in problem.couplings),
        slopes=slopes,
        modes=modes,
        gains=gains,
        pins=[f"Pin {agent} {gains[gain]}" for agent, gain in pinning.items()],
        pair=matrices,
        P_squares=P_squares,
        rate=claimed_rate,
        comment=comment,
        number=number,
        matrix=matrix,
        wrapped_list=wrapped_list,
        square_list=square_list,
    )


@noun
class _Mode:
    """A graph: its arcs as Coq reads them, and the squares that -Psi is the sum of, and -(Psi + 2
    rate V)."""

    name: str
    arcs: list[str]
    squares: Factors
    rate_squares: Factors


def _matrices(certificate: Certificate) -> dict[str, Matrix]:
    """The matrices of exosystem and observer by their names in Coq; none without an exosystem."""
    exosystem, claims = certificate.problem.exosystem, certificate.claims
    if exosystem is None:
        return {}
    W, P, Q = claims.W, claims.P, claims.Q
    if W is None or P is None or Q is None or multiply(P, W) != Q:
        raise _unsound("the certificate must hold W, P and Q with Q = P W.")
    return {"A": exosystem.A, "C": exosystem.C, "W": W, "P": P, "Qm": Q}


def _named(word: str, matrices: Iterable[Matrix]) -> dict[Matrix, str]:
    """Every matrix once, with a name: slope_1, slope_2, ..."""
    distinct = dict.fromkeys(matrices)
    return {each: f"{word}_{place}" for place, each in enumerate(distinct, start=1)}


def _slopes(mode: ModeJacobian) -> list[Matrix]:
    """The slopes h'(0) of the mode's kinds of arcs, each a point."""
    return [tuple(tuple(entry.lo for entry in row) for row in gain) for gain in mode.gains]


def _arcs(mode: ModeJacobian, names: Mapping[Matrix, str]) -> list[str]:
    slopes = [names[each] for each in _slopes(mode)]
    found = []
    for (listener, speaker, _), kind in zip(mode.arcs, mode.kind.tolist(), strict=True):
        found.append(f"Arc {listener} {speaker} {slopes[kind]}")
    return found


def require_own(certificate: Certificate) -> None:
    """Raise SpecError for agents with [dynamics], pins of single modes, and for a certificate about
    another problem."""
    certificate.problem.require("a proof for Rocq")
    if certificate.claims.problem_sha256 != problem_sha256(certificate.problem):
        raise refused(
            "problem_sha256",
            "the certificate is about another problem: its hash differs.",
            "Give the problem it was made for.",
        )


def _head(certificate: Certificate, title: str) -> str:
    problem, claims = certificate.problem, certificate.claims
    modes = len(problem.network.modes)
    claim = "Claim: Psi is negative definite"
    if modes > 1:
        claim += f" in each of the {modes} modes"
    claim += ", and so V = e'e"
    if problem.exosystem is not None:
        claim += " + sum over i of eps_i' P eps_i"
    claim += " decreases along the closed loop"
    if not problem.is_linear:
        claim += ", linearised at the consensus"
    return comment(
        f"{title} for the problem {problem.name}, to be checked by Coq.",
        f"{claim}.",
        "Check it by: coqc FILE.v (standard library only; tested with Coq 8.16).",
        "What is proved stands in parts 1, 2 and 5; parts 3 and 4 are proofs, which only "
        "Coq has to read. Coq does not"
        " see the coupling h: its slopes h'(0) stand in part 2 as numbers.",
        f"Made by dobc_design {claims.version}. SHA-256 of the problem: {claims.problem_sha256}.",
        *(f"Note: {note}" for note in problem.notes),
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
            raise refused(
                "checks",
                f"only a proved theorem can be exported; {title} is {said} in this certificate.",
                "Certify a problem for which it is proved.",
            )
    return id


def _rational_jacobians(statements: Statements) -> Jacobians:
    loop, jacobians = statements.loop, statements.jacobians
    size = loop.n * (loop.m + loop.q)
    if size > LARGEST_SIZE:
        limit = f"at most {LARGEST_SIZE} rows, so that Coq ends within a quarter of an hour"
        raise _too_large(f"Psi must have {limit}; it has {size}.")
    if jacobians is None:
        raise refused(
            "coupling.h",
            f"the theorem cannot be exported: {statements.inapplicable}",
            "Check the certificate with `dobc verify`.",
        )
    if not all(mode.is_point for mode in jacobians.modes):
        bent = next(each for each in loop.functions if not _has_rational_slopes(each))
        raise refused(
            "coupling.h",
            f'coupling "{"; ".join(bent.texts)}": its slope h\'(0) must be a rational '
            "number, because Coq is given Psi in rationals; it is known as an interval only.",
            "Use a coupling with a rational slope at 0, or rely on `dobc verify`.",
        )
    return jacobians


def _has_rational_slopes(coupling: Coupling) -> bool:
    return all(entry.is_point for row in coupling.jacobian_at_zero() for entry in row)


def _rate(certificate: Certificate, id: str) -> Fraction:
    """The decay rate claimed for every mode, in 1/s."""
    rates = [check.rate for check in certificate.checks if check.id == id]
    known = [claimed(each) for each in rates if each]
    if not known or len(known) != len(rates):
        raise refused(
            "rate", f"the certificate claims no decay rate for {id}.", "Export it without one."
        )
    return min(known)


def _factors(
    statements: Statements, known: Mapping[str, Matrix], rate: Fraction
) -> dict[str, Factors]:
    """Mode -> LDL' of -(Psi + 2 rate V); ``known``: P and Q, where there is an exosystem."""
    constants = [each.constant for each in statements.lambdas.values()]
    matrices = [each.shifted(2 * rate) for each in constants if isinstance(each, SparseSymmetric)]
    if len(matrices) < len(constants):
        raise _too_large("Lambda of so large a network would take Coq hours.")
    # With an exosystem Psi has the estimation errors as well.
    if known:
        pair = {"P": known["P"], "Q": known["Qm"]}
        matrices = [each.at(pair) for each in statements.psi(rate=rate)]
    result = {}
    for mode, matrix in zip(statements.lambdas, matrices, strict=True):
        result[mode] = _factored(matrix.negated(), f"-Psi of mode {mode}")
    if sum(_work(factors) for factors in result.values()) > LARGEST_WORK:
        message = "the fractions in L and D of Psi are too long for Coq to end within a quarter "
        raise _too_large(f"{message}of an hour.")
    return result


def _factored(matrix: SparseSymmetric, name: str) -> Factors:
    factors = squares_of(matrix)
    if factors is None:
        raise _unsound(f"{name} must be positive definite, as the certificate claims; it is not.")
    return factors


def _work(factors: Factors) -> int:
    """How many bits have to be multiplied with how many to multiply L D L' out, roughly."""
    # Numbers are as long as their fractions: the longest sets the pace.
    total = 0
    for each in factors:
        numbers = (each.weight, *each.others.values())
        longest = max(x.numerator.bit_length() + x.denominator.bit_length() for x in numbers)
        total += (len(each.others) + 1) ** 2 * longest**2
    return total


def _too_large(message: str) -> SpecError:
    return refused("network", message, "`dobc verify` checks certificates of any size.")


def _unsound(message: str) -> SpecError:
    return refused(
        "observer", message, "Check the certificate with `dobc verify`, and make it again."
    )
