"""A certificate's Theorem 1, 2 or Lemma 1 as a file that the kernel of Coq checks.

The file states the problem in rationals, builds Psi from it inside Coq, and proves x' Psi x < 0 for every
vector x other than 0, rational or real, from Psi = -L D L' multiplied out by the kernel.  It needs nothing
but Coq's standard library: ``coqc FILE.v``.  Nothing is taken from a solver, and nothing here is trusted:
a wrong number makes a file that Coq refuses.  What Coq does not see is h: the slopes h'(0) enter as numbers.
"""

from __future__ import annotations

import heapq
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from importlib.resources import files

from dobc_design.certificate.certificate import Certificate
from dobc_design.conditions.consensus.claim import Jacobians, ModeJacobian, Statements, state_theorems
from dobc_design.conditions.kinds import KINDS
from dobc_design.conditions.numbers import claimed
from dobc_design.errors import SpecError
from dobc_design.exact.matrix import Matrix, multiply
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.problem.canonical import problem_sha256
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

WIDTH = 110  # characters of a line, where numbers allow it


@cache
def theory(name: str) -> str:
    """A part of templates/theory.v: what does not depend on the problem, written for Coq 8.16's standard library."""
    text = (files("dobc_design.export") / "templates" / "theory.v").read_text("utf-8")
    return text.partition(f"(*** {name} ***)\n")[2].partition("(*** ")[0].rstrip("\n") + "\n"


def section(title: str) -> str:
    """A heading between the parts of a file."""
    return f"\n(* ---- {title} ---- *)\n"


def comment(*paragraphs: str) -> str:
    """A comment, whatever the text: it can neither end the comment nor open a comment or string in it."""
    lines = [line for text in paragraphs for line in textwrap.wrap(_harmless(text), WIDTH - 6)]
    return "\n(* " + "\n   ".join(lines) + " *)"


def number(x: Fraction) -> str:
    """A rational: 3, (-3), (3 # 7)."""
    if x.denominator == 1:
        return str(x.numerator) if x >= 0 else f"({x.numerator})"
    return f"({x.numerator} # {x.denominator})"


def matrix(M: Matrix) -> str:
    """A matrix by its rows."""
    return "matrix [" + "; ".join("[" + "; ".join(number(x) for x in row) + "]" for row in M) + "]"


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
        terms = [f"Term {i} {number(x)}" for i, x in each.others.items()]
        items.append(f"Square {number(each.weight)} {each.pivot}" + ("\n  " + wrapped_list(terms) if terms else " []"))
    return "  [" + ";\n   ".join(items) + "]"


def _harmless(text: str) -> str:
    text = text.replace('"', "'").replace("(*", "( *").replace("*)", "* )")
    return text.encode("ascii", "backslashreplace").decode("ascii")


@dataclass(frozen=True, slots=True)
class Square:
    """d (x_pivot + sum of others[i] x_i)^2: one entry of D and one column of L.

    ``others`` are the entries of the column that are neither 0 nor the 1 at the pivot, by rising index.
    """

    weight: Fraction
    pivot: int
    others: Mapping[int, Fraction]


def factor(M: SparseSymmetric) -> tuple[Square, ...] | None:
    """Return the squares M is the sum of, in the order of elimination, or None if M is not positive definite.

    Pivots are taken on the diagonal by least degree, then least index, so the answer is unique.
    """
    rows: list[dict[int, Fraction]] = [{} for _ in range(M.size)]
    for (i, j), value in M.entries.items():
        rows[i][j] = rows[j][i] = value
    queue = [(len(row), i) for i, row in enumerate(rows)]
    heapq.heapify(queue)
    closed = [False] * M.size
    squares: list[Square] = []
    while queue:
        degree, pivot = heapq.heappop(queue)
        if closed[pivot] or degree != len(rows[pivot]):
            continue  # stale: the row has changed since, and stands in the queue again
        closed[pivot] = True
        weight = rows[pivot].pop(pivot, Fraction(0))
        if weight <= 0:
            return None
        others = {i: rows[pivot][i] / weight for i in sorted(rows[pivot])}
        squares.append(Square(weight, pivot, others))
        _eliminate(rows, pivot, weight, others)
        for i in others:
            heapq.heappush(queue, (len(rows[i]), i))
    return tuple(squares)


def _eliminate(rows: list[dict[int, Fraction]], pivot: int, weight: Fraction, others: Mapping[int, Fraction]) -> None:
    """Subtract weight l l' from the rows still open; drop the pivot's column and what cancels."""
    for i, x in others.items():
        row, scaled = rows[i], weight * x
        del row[pivot]
        for j, y in others.items():
            value = row.get(j, Fraction(0)) - scaled * y
            if value:
                row[j] = value
            else:
                row.pop(j, None)


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


# The kernel computes, once, when it comes to Qed.
COMPUTED = "Proof. vm_cast_no_check (eq_refl true). Qed."


def rocq_proof(certificate: Certificate, *, rate: bool = False) -> str:
    """Return the text of a Coq file that proves the certificate's theorem.

    With an exosystem: theorem1 or theorem2, with the certificate's P and Q = P W, for all modes.  Without:
    lemma1 of every mode.  ``rate`` adds the claimed decay rate.  The same certificate gives the same text.
    Raises: SpecError if that is not proved in the certificate, if a slope h'(0) is irrational, if the
    problem is too large for Coq, or if the numbers in the certificate do not prove what it claims.
    Source: theory, sections 2 and 3.  Tested with Coq 8.16.
    """
    claim = read_claim(certificate, rate=rate)
    parts = [
        _head(certificate, claim),
        section("1. What the words mean"),
        theory("DEFINITIONS"),
        section("2. The problem, and Psi"),
        *_data(claim),
        section("3. From L D L' to definiteness: proved once, for every matrix"),
        theory("CHECKER"),
        theory("OVER_Q"),
        theory("OVER_R"),
        section("4. The witnesses L and D, multiplied out by the kernel"),
        *_witnesses(claim),
        section(f"5. {KINDS[claim.id].short}"),
        *_conclusions(claim),
    ]
    return "\n".join(part.strip("\n") + "\n" for part in parts)


def _head(certificate: Certificate, claim: RocqClaim) -> str:
    problem, claims = claim.problem, certificate.claims
    modes = len(problem.network.modes)
    linear = "" if problem.is_linear else ", linearised at the consensus"
    return comment(
        f"{KINDS[claim.id].short} for the problem {problem.name}, to be checked by Coq.",
        f"Claim: Psi is negative definite{'' if modes == 1 else f' in each of the {modes} modes'}, and so V = e'e"
        + ("" if claim.pair is None else " + sum over i of eps_i' P eps_i")
        + f" decreases along the closed loop{linear}.",
        "Check it by: coqc FILE.v (standard library only; tested with Coq 8.16).",
        "What is proved stands in parts 1, 2 and 5; parts 3 and 4 are proofs, which only Coq has to read. Coq does not"
        " see the coupling h: its slopes h'(0) stand in part 2 as numbers.",
        f"Made by dobc_design {claims.version}. SHA-256 of the problem: {claims.problem_sha256}.",
        *(f"Note: {note}" for note in problem.notes),
    )


def _data(claim: RocqClaim) -> Iterator[str]:
    problem = claim.problem
    agents = ", ".join(f"{i} is {label}" for i, label in enumerate(problem.network.labels))
    yield comment(f"Agents by number and label: {agents}.")
    yield f"Definition n : nat := {problem.n}. (* agents *)"
    yield f"Definition m : nat := {problem.m}. (* state components of an agent *)"
    yield from _arcs(problem, claim.jacobians)
    yield from _pins(problem)
    yield theory("NETWORK")
    if claim.pair is None:
        yield theory("ALONE")
    else:
        yield from _observer(claim.pair)
    yield theory("DERIVATIVE")
    if claim.rate is not None:
        yield comment("The decay rate, in 1/s.")
        yield f"Definition rate : Q := {number(claim.rate)}."
        yield theory("RATE")


def _arcs(problem: Problem, jacobians: Jacobians) -> Iterator[str]:
    slopes = dict.fromkeys(_slope(mode, kind) for mode in jacobians.modes for kind in range(len(mode.gains)))
    names = {slope: f"slope_{place}" for place, slope in enumerate(slopes, start=1)}
    texts = ", and ".join("; ".join(coupling.texts) for coupling in problem.couplings)
    yield comment(f"Slopes h'(0), weight of the arc included. The couplings h are {texts}.")
    for slope, name in names.items():
        yield f"Definition {name} := {matrix(slope)}."
    for place, mode in enumerate(jacobians.modes, start=1):
        arcs = [
            f"Arc {listener} {speaker} {names[_slope(mode, kind)]}"
            for (listener, speaker, _), kind in zip(mode.arcs, mode.kind.tolist(), strict=True)
        ]
        yield comment(f"Mode {mode.name}: Arc i j says that agent i listens to agent j.")
        yield f"Definition arcs_{place} : list arc :=\n{wrapped_list(arcs)}."
    modes = "; ".join(f"arcs_{place}" for place in range(1, len(jacobians.modes) + 1))
    yield f"Definition modes : list (list arc) := [{modes}]."


def _slope(mode: ModeJacobian, kind: int) -> Matrix:
    return tuple(tuple(entry.lo for entry in row) for row in mode.gains[kind])


def _pins(problem: Problem) -> Iterator[str]:
    gains = dict.fromkeys(problem.pinning.gains.values())
    names = {gain: f"gain_{place}" for place, gain in enumerate(gains, start=1)}
    yield comment("Who is pinned, and how strongly; the others have the gain 0.")
    for gain, name in names.items():
        yield f"Definition {name} := {matrix(gain)}."
    pins = [f"Pin {agent} {names[gain]}" for agent, gain in problem.pinning.gains.items()]
    yield f"Definition pins : list pin :=\n{wrapped_list(pins)}."


def _observer(pair: PairClaim) -> Iterator[str]:
    yield comment("The disturbance d = C xi with xi' = A xi, the observer gain W, and the pair P, Q of the theorem.")
    yield f"Definition q : nat := {pair.exosystem.order}. (* order of the exosystem *)"
    named = {"A": pair.exosystem.A, "C": pair.exosystem.C, "W": pair.W, "P": pair.P, "Qm": pair.Q}
    for name, value in named.items():
        yield f"Definition {name} := {matrix(value)}."
    yield theory("OBSERVER")


def _witnesses(claim: RocqClaim) -> Iterator[str]:
    for place, (mode, factors) in enumerate(claim.factors.items(), start=1):
        yield comment(f"-Psi = L D L' in mode {mode}; and Psi = F' V + V F.")
        yield from _witness("Psi", place, factors)
        yield (
            f"Lemma derivative_checked_{place} :"
            f" check_derivative size (F arcs_{place}) V (Psi arcs_{place}) = true.\n{COMPUTED}"
        )
    for place, (mode, factors) in enumerate(claim.rate_factors.items(), start=1):
        yield comment(f"-(Psi + 2 rate V) = L D L' in mode {mode}.")
        yield from _witness("Psi_rate", place, factors)
    if claim.pair is not None:
        yield comment("P = L D L'; and Q = P W.")
        yield f"Definition P_squares : list square :=\n{square_list(claim.pair.P_factors)}."
        yield f"Lemma P_checked : check q P P_squares = true.\n{COMPUTED}"
        yield (
            "Lemma Q_checked : all_below q (fun i => all_below m (fun j =>\n"
            f"  Qeq_bool (Qm i j) (sum q (fun k => P i k * W k j)))) = true.\n{COMPUTED}"
        )


def _witness(name: str, place: int, factors: Factors) -> Iterator[str]:
    yield f"Definition {name}_squares_{place} : list square :=\n{square_list(factors)}."
    yield (
        f"Lemma {name}_checked_{place} :"
        f" check size (fun i j => - {name} arcs_{place} i j) {name}_squares_{place} = true.\n{COMPUTED}"
    )


def _conclusions(claim: RocqClaim) -> Iterator[str]:
    id, places = claim.id, range(1, len(claim.factors) + 1)
    if claim.pair is not None:
        yield from _pair_conclusions()
    yield comment("x' Psi x < 0 for every rational vector x other than 0, in every mode.")
    yield _theorem(id, "negative_definite size (Psi arcs)", [f"check_negative _ _ _ Psi_checked_{k}" for k in places])
    yield comment("The same for vectors written as lists of rationals.")
    yield (
        f"Theorem {id}_lists : forall arcs, In arcs modes -> forall x : list Q,\n"
        "  length x = size -> Exists (fun a => ~ a == 0) x -> form size (Psi arcs) (fun i => nth i x 0) < 0.\n"
        f"Proof. intros arcs H. exact (negative_lists size _ ({id} arcs H)). Qed."
    )
    yield comment("The same for every real vector x other than 0.")
    steps = [f"check_negative_R _ _ _ Psi_checked_{k}" for k in places]
    yield _theorem(f"{id}_R", "negative_definite_R size (Psi arcs)", steps)
    yield comment(
        "What that means: Psi = F' V + V F, so along z' = F z the derivative of z' V z is negative for every real z"
        " other than 0."
    )
    steps = [f"derivative_negative_R _ _ _ _ derivative_checked_{k} ({step})" for k, step in enumerate(steps, start=1)]
    yield _theorem("V_decreases", "negative_definite_R size (derivative arcs)", steps)
    if claim.rate is not None:
        yield comment("Psi + 2 rate V < 0: the derivative of z' V z is below -2 rate z' V z for every real z but 0.")
        steps = [f"check_negative_R _ _ _ Psi_rate_checked_{k}" for k in places]
        yield _theorem("rate_holds", "negative_definite_R size (Psi_rate arcs)", steps)
    yield comment("What the proofs assume: over the rationals nothing; over the reals the axioms of Coq's reals.")
    yield f"Print Assumptions {id}.\nPrint Assumptions V_decreases."


def _pair_conclusions() -> Iterator[str]:
    yield comment("P > 0, over the rationals and over the reals, and Q = P W.")
    yield "Theorem P_positive : positive_definite q P.\nProof. exact (check_positive _ _ _ P_checked). Qed."
    yield "Theorem P_positive_R : positive_definite_R q P.\nProof. exact (check_positive_R _ _ _ P_checked). Qed."
    yield (
        "Theorem Q_is_P_W : forall i j, (i < q)%nat -> (j < m)%nat -> Qm i j == sum q (fun k => P i k * W k j).\n"
        "Proof.\n  intros i j Hi Hj. apply Qeq_bool_iff.\n"
        "  exact (all_below_spec m _ (all_below_spec q _ Q_checked i Hi) j Hj).\nQed."
    )


def _theorem(name: str, claim: str, steps: Sequence[str]) -> str:
    """A statement about every mode, with the proof for each."""
    proof = "".join(f"  apply Forall_cons; [exact ({step})|].\n" for step in steps)
    return (
        f"Theorem {name} : forall arcs, In arcs modes -> {claim}.\n"
        f"Proof.\n  apply Forall_forall. unfold modes.\n{proof}  apply Forall_nil.\nQed."
    )
