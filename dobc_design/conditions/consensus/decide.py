"""Lemma 1 and Theorems 1 and 2, decided exactly, with the eigenvalues that prove the linearisation
unstable.

A pair (P, Q) is a proposal; whether Psi < 0 holds for it is decided through the Reduction (theory,
section 2): given Omega0 < 0 and S = C (-Omega0)^-1 C', Psi(J) < 0 iff Lambda(J) + I (x) S < 0.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial

import numpy as np
from numpy.typing import NDArray

from dobc_design.conditions import numbers
from dobc_design.conditions.check import Check, Values, Witness, agrees, differs, same_witness
from dobc_design.conditions.consensus import claim, network
from dobc_design.conditions.consensus.claim import (
    ZERO,
    ModeJacobian,
    Pair,
    PairFacts,
    Shown,
    Statements,
    Unstable,
    omega,
)
from dobc_design.conditions.consensus.network import (
    Enclosed,
    find_witness,
    is_negative,
    lowest_quotient,
    refutes,
)
from dobc_design.conditions.numbers import (
    claimed,
    has_short_denominator,
    largest_proved,
    shorten,
    text_below,
)
from dobc_design.exact.definite import decide_positive_definite
from dobc_design.exact.interval import Interval
from dobc_design.exact.matrix import Matrix, Vector, multiply, transpose, zeros
from dobc_design.exact.number import from_fmpq_mat, number_text, to_fmpq_mat
from dobc_design.exact.polynomial import characteristic_polynomial, count_right_half_plane
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.loop.arcs import unreached
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.groups import group_blocks, group_numbers
from dobc_design.verdict import Verdict

LARGEST_EXAMINED = 60  # rows; counting roots takes seconds there, minutes at twice the size
MOST_SYMMETRIC = 100_000  # arcs of a mode whose J - K is compared with its transpose
# How a claim is not confirmed.
NO_NUMBER, OTHER_VALUES = (
    "it claims a number that this check does not have",
    "exact values are not what they say",
)
# rows^2 times the bits of the common denominator: as long as 60 rows with about 550 bits
MOST_COUNTING = 2_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Proposal:
    """Numbers from floating point, to be proved: a margin, a rate (1/s), vectors worth trying as
    witnesses."""

    margin: float = 0.0
    rate: float = 0.0
    vectors: network.Directions = ()


def unstable_roots(statements: Statements, mode: str) -> int:
    """A proved lower bound of the eigenvalues of J - K with positive real part, with multiplicity;
    0 if not examined. With diagonal slopes >= 0 and scalar gains >= 0 there are none (rows weakly
    dominated by a diagonal <= 0)."""
    nonnegative = (each.is_nonnegative_diagonal for each in _modes(statements, mode))
    pulls = statements.loop.pulls
    if all(nonnegative) and pulls.is_scalar and all(k[0][0] >= 0 for k in pulls.gains.values()):
        return 0
    matrix = linear_part(statements, mode)
    return 0 if matrix is None else count_right_half_plane(characteristic_polynomial(matrix))


def is_unstable_along(statements: Statements, mode: str, value: Interval) -> bool:
    """Whether v'Lambda v = ``value`` > 0 shows an eigenvalue of J - K > 0, of any size: where J - K
    is symmetric, Lambda = 2 (J - K), and its largest eigenvalue is at least v'(J - K)v / v'v."""
    return value.lo > 0 and _is_symmetric(statements, mode)


def _is_symmetric(statements: Statements, mode: str) -> bool:
    """Whether J - K of one mode is known exactly, and symmetric: the same arcs both ways."""
    jacobians = statements.jacobians
    if (
        jacobians is None
        or sum(len(each.arcs) for each in _modes(statements, mode)) > MOST_SYMMETRIC
    ):
        return False
    (each,) = _modes(statements, mode)
    if not each.is_point:
        return False
    entries = claim.linearisation(each, statements.loop.pulls, jacobians.dimension)
    return all(value == entries.get((j, i), ZERO) for (i, j), value in entries.items())


def linear_part(statements: Statements, mode: str) -> Matrix | None:
    """J - K of one mode (n m, n m); None for more than 60 rows, for slopes that are not rational or
    too long."""
    jacobians, pulls = statements.jacobians, statements.loop.pulls
    size = 0 if jacobians is None else jacobians.size * jacobians.dimension
    if jacobians is None or size > LARGEST_EXAMINED:
        return None
    (each,) = _modes(statements, mode)
    if not each.is_point:
        return None
    entries = claim.linearisation(each, pulls, jacobians.dimension)
    if not has_short_denominator(entries.values(), MOST_COUNTING // size**2):
        return None
    return tuple(tuple(entries.get((i, j), ZERO) for j in range(size)) for i in range(size))


def _modes(statements: Statements, mode: str) -> list[ModeJacobian]:
    return (
        []
        if statements.jacobians is None
        else [each for each in statements.jacobians.modes if each.name == mode]
    )


def enclosed_lambda(statements: Statements, mode: str) -> Enclosed:
    """Lambda(J) of one mode, with what it may deviate by."""
    pencil, shown = statements.lambdas[mode], statements.shown.get(mode)
    return Enclosed(
        middle=pencil.constant,
        deviations=pencil.deviations,
        bound=None if shown is None else shown.bound,
    )


def with_vectors(statements: Statements, vectors: Mapping[str, NDArray[np.float64]]) -> Statements:
    """The statements with the bounds below 0 of Lambda, by mode, that these vectors v > 0 (n m,)
    prove."""
    bounds = {
        mode: network.shown_bound(enclosed_lambda(statements, mode), v)
        for mode, v in vectors.items()
    }
    shown = {
        mode: Shown(vector=vectors[mode], bound=b)
        for mode, b in bounds.items()
        if b is not None and b < 0
    }
    return replace(statements, shown=shown)


def lambda_with(statements: Statements, mode: str, S: Matrix) -> Enclosed:
    """Lambda(J) + I (x) S of one mode; where agents have different exosystems every agent has its
    own block of S, and 0 without a disturbance."""
    loop = statements.loop
    groups, m = loop.groups, loop.m
    blocks, owners = group_blocks(S, len(groups)), group_numbers(groups, loop.labels)
    if not loop.is_grouped:
        return enclosed_lambda(statements, mode).plus_blocks(blocks)
    nothing = [zeros(m, m)] if len(groups) in owners else []
    return enclosed_lambda(statements, mode).plus_blocks([*blocks, *nothing], owners)


def lemma1_check(statements: Statements, mode: str, proposal: Proposal) -> Check:
    """Decide Lambda(J) < 0 for one mode.  PROVED: V = e'e decreases, V' <= -2 rate V near the
    target."""
    check = partial(Check, id="lemma1", mode=mode, domain=statements.domain)
    if statements.inapplicable is not None:
        return check(verdict=Verdict.UNDECIDED, reason=statements.inapplicable)
    matrix = enclosed_lambda(statements, mode)
    margin = largest_proved(proposal.margin, lambda shift: is_negative(matrix, shift=shift))
    if margin is not None:
        most = f", lambda_max <= -{text_below(margin, digits=6)}" if margin else ""
        return check(
            verdict=Verdict.PROVED,
            margin=margin,
            rate=shorten(claimed(margin) / 2) or None,
            claim=statements.shown.get(mode),
            reason=f"Lambda(J) < 0{most}: V = e'e decreases{_where(statements)}.",
        )
    loop = statements.loop
    arcs = loop.modes[mode]
    vector = find_witness(matrix, [*network.group_directions(loop, arcs), *proposal.vectors])
    if vector is None:
        reason = f"lambda_max(Lambda) {network.why_undecided(loop, matrix)}"
        return check(verdict=Verdict.UNDECIDED, reason=reason)
    value, roots = matrix.value(vector), unstable_roots(statements, mode)
    roots = max(roots, int(is_unstable_along(statements, mode, value)))
    return check(
        verdict=Verdict.REFUTED,
        margin=network.refuted_margin(matrix, vector),
        reason=network.refutation(loop, vector, alone=unreached(loop, [arcs]), roots=roots),
        claim=Unstable(roots=roots, value=value.lo if value.is_point else None),
        witness=lambda_witness(statements, vector),
    )


def theorem_check(
    id: str,
    statements: Statements,
    exosystem: Exosystem,
    pair: Pair | None,
    proposal: Proposal,
    *,
    lemmas: Sequence[Check],
    obstacle: Check | None,
    printed: bool = False,
) -> Check:
    """Decide Theorem 1 or 2 for the pair (``printed``: the user's own), or refute it for every
    pair: by the decided Lemma 1 of a mode, or by an ``obstacle``, a refuted detectability or
    Hurwitz check."""
    undecided = partial(Check, id=id, verdict=Verdict.UNDECIDED, domain=statements.domain)
    if statements.inapplicable is not None:
        return undecided(reason=statements.inapplicable)
    if not printed:
        general = _refuted_for_every_pair(id, statements, lemmas, obstacle)
        if general is not None:
            return general
    if pair is None:
        reason = "no pair (P, Q) was found, and no proof that there is none; give W and P."
        return undecided(reason=reason)
    refuted = partial(Check, id=id, verdict=Verdict.REFUTED, domain=statements.domain)
    not_p = (
        "P is not positive definite: v'Pv <= 0 for the vector shown, so V is no Lyapunov function."
    )
    not_omega = (
        "PA + A'P - QC - C'Q' is not negative definite: the estimation error alone can make V grow."
    )
    blocks = {
        "P": SparseSymmetric.from_dense(pair.P),
        "Omega0": omega(pair.P, pair.Q, exosystem).negated(),
    }
    for (block, matrix), what in zip(blocks.items(), (not_p, not_omega), strict=True):
        vector = decide_positive_definite(matrix).witness
        if vector is not None:
            reason = f"{what} Another P may do."
            return refuted(
                reason=reason, claim=Values({"block": block}), witness=vector_witness(vector)
            )
    S = schur_block(pair, exosystem)
    modes = (
        {} if S is None else {mode: lambda_with(statements, mode, S) for mode in statements.lambdas}
    )
    margin = largest_proved(
        proposal.margin,
        lambda shift: (
            bool(modes) and all(is_negative(each, shift=shift) for each in modes.values())
        ),
    )
    if S is not None and margin is not None:
        rate = largest_proved(
            proposal.rate, lambda b: psi_is_negative(statements, exosystem, pair, rate=b)
        )
        name = "the P given" if printed else "a rational P"
        common = "" if len(modes) == 1 else f" with one P for all {len(modes)} modes"
        pace = f", V' <= -2 ({text_below(rate)}) V." if rate else "."
        return Check(
            id=id,
            verdict=Verdict.PROVED,
            domain=statements.domain,
            margin=margin,
            rate=rate or None,
            claim=PairFacts(pair=pair, S=S),
            reason=f"Psi < 0 holds exactly for {name}{common}: V = e'e + sum eps_i' P eps_i"
            f" decreases{_where(statements)}{pace}",
        )
    for mode, enclosed in modes.items():
        vector = find_witness(enclosed, proposal.vectors)
        if vector is None or S is None:
            continue
        facts = PairFacts(pair=pair, S=S, mode=mode)
        bound = (
            ""
            if facts.bound is None
            else f" It needs lambda_max(Lambda) < {number_text(facts.bound)}."
        )
        fix = " Another P may do: see the check for a new P." if printed else ""
        where = f" in mode {mode}" if len(modes) > 1 else ""
        return refuted(
            margin=network.refuted_margin(enclosed, vector),
            reason=f"Psi is not negative definite for this P{where}: v'(Lambda + I (x) S)v >= 0 "
            "for the vector shown."
            f"{bound}{fix}",
            claim=facts,
            witness=lambda_witness(statements, vector),
        )
    matrices = [enclosed_lambda(statements, mode) for mode in statements.lambdas]
    widest = max(matrices, key=lambda each: len(each.deviations))
    return undecided(
        reason=f"lambda_max of Lambda + I (x) S {network.why_undecided(statements.loop, widest)}"
    )


def schur_block(pair: Pair, exosystem: Exosystem, *, rate: Fraction = ZERO) -> Matrix | None:
    """S = C (-Omega0 - 2 rate P)^-1 C', m x m; None unless that block is proved negative
    definite."""
    block = omega(pair.P, pair.Q, exosystem, rate=rate).negated()
    if decide_positive_definite(block).verdict is not Verdict.PROVED:
        return None
    C = exosystem.C
    if not C or not C[0]:
        return multiply(C, transpose(C))
    return multiply(
        C, from_fmpq_mat(to_fmpq_mat(block.to_dense()).solve(to_fmpq_mat(transpose(C))))
    )


def psi_is_negative(
    statements: Statements,
    exosystem: Exosystem,
    pair: Pair,
    *,
    margin: Fraction = ZERO,
    rate: Fraction = ZERO,
) -> bool:
    """Whether P > 0 and Psi(J) + 2 rate diag(I, I (x) P) + margin diag(I, 0) < 0 is proved for
    every mode."""
    if decide_positive_definite(SparseSymmetric.from_dense(pair.P)).verdict is not Verdict.PROVED:
        return False
    S = schur_block(pair, exosystem, rate=rate)
    return S is not None and all(
        is_negative(lambda_with(statements, mode, S), shift=margin + 2 * rate)
        for mode in statements.lambdas
    )


def vector_witness(vector: Vector) -> Witness:
    """A direction in which a matrix is not definite."""
    return Witness(kind="vector", values=tuple(number_text(x) for x in vector))


def lambda_witness(statements: Statements, vector: Vector) -> Witness:
    """A direction of the network, with the labels of the agents that move in it."""
    return replace(vector_witness(vector), labels=network.carriers(statements.loop, vector))


def _refuted_for_every_pair(
    id: str, statements: Statements, lemmas: Sequence[Check], obstacle: Check | None
) -> Check | None:
    refuted = partial(Check, id=id, verdict=Verdict.REFUTED, domain=statements.domain)
    for lemma in lemmas:
        if lemma.verdict is Verdict.REFUTED:
            return refuted(
                margin=lemma.margin,
                reason="no P and Q satisfy Psi < 0, because Lambda(J) is not negative definite "
                f"in mode {lemma.mode}: " + lemma.reason,
                claim=Values({"block": "Lambda", "mode": lemma.mode}),
                witness=lemma.witness,
            )
    if obstacle is not None:
        who = "no P with Q = P W satisfies Psi < 0 for this W"
        return refuted(
            reason=f"{who if obstacle.id == 'hurwitz' else 'no P and Q satisfy Psi < 0'}: "
            f"{obstacle.reason}",
            claim=Values(
                {"block": obstacle.id}
                | ({} if obstacle.group is None else {"group": obstacle.group})
            ),
            witness=obstacle.witness,
            fix=obstacle.fix,
        )
    for lemma in lemmas:
        if lemma.verdict is Verdict.UNDECIDED:
            reason = f"Lambda(J) < 0 could not be decided: {lemma.reason}"
            return Check(id=id, verdict=Verdict.UNDECIDED, domain=statements.domain, reason=reason)
    return None


def _where(statements: Statements) -> str:
    return (
        " everywhere (the couplings are linear)"
        if statements.domain == "global"
        else " near the target"
    )


def confirm(check: Check, statements: Statements, pair: Pair | None) -> str | None:
    """None if all that a check of this topic claims is confirmed; one refuted by the observer is
    not for here."""
    loop = statements.loop
    if check.id == "reachability":
        if check.margin is not None or check.rate is not None:
            return NO_NUMBER
        return differs(check, network.reachability_check(loop, str(check.mode)))
    if statements.inapplicable is not None:
        return "the theorems do not apply to this coupling"
    if check.kind.role == "given":
        own = loop.joint_observer
        pair = None if own.P is None or own.W is None else Pair(P=own.P, Q=multiply(own.P, own.W))
    decide = _confirm_proved if check.verdict is Verdict.PROVED else _confirm_refuted
    return decide(check, statements, pair)


def _confirm_proved(check: Check, statements: Statements, pair: Pair | None) -> str | None:
    if check.margin is None or check.margin < 0 or (check.rate is not None and check.rate <= 0):
        return "a proof must claim a margin >= 0, and a rate > 0 or none"
    if check.witness is not None:
        return "a proof has no witness"
    margin, rate = claimed(check.margin), claimed(check.rate or 0.0)
    if check.id == "lemma1":
        if check.exact is not None and str(check.mode) not in statements.shown:
            return "the vector does not show that Lambda < 0"
        proved = is_negative(
            enclosed_lambda(statements, str(check.mode)), shift=max(margin, 2 * rate)
        )
        return None if proved else "Lambda < 0 is not true with that margin and rate"
    exosystem = _exosystem(statements)
    if pair is None:
        return "there is no pair (P, Q) to confirm it with"
    if not psi_is_negative(statements, exosystem, pair, margin=margin):
        return "Psi < 0 is not true with that margin"
    if rate and not psi_is_negative(statements, exosystem, pair, rate=rate):
        return f"the rate {check.rate} is not reached"
    S = schur_block(pair, exosystem)
    return (
        None
        if S is not None and agrees(check.exact, PairFacts(pair=pair, S=S).to_json())
        else OTHER_VALUES
    )


def _confirm_refuted(check: Check, statements: Statements, pair: Pair | None) -> str | None:
    if check.rate is not None or (check.margin is not None and check.margin > 0):
        return "a refuted check must claim no rate and no positive margin"
    exact = check.exact or {}
    if check.id == "lemma1":
        mode, said = str(check.mode), claim.read_claim(check, statements.loop, None)
        if not isinstance(said, Unstable):
            return OTHER_VALUES
        vector = _vector(check)
        if not _has_roots(said.roots, statements, mode, vector):
            return OTHER_VALUES
        if (
            said.value is not None
            and said.value > enclosed_lambda(statements, mode).value(vector).lo
        ):
            return OTHER_VALUES
        return _confirm_lambda(check, statements, mode, vector)
    if check.kind.role == "given":
        return _confirm_printed(check, statements, pair, _vector(check))
    mode = str(exact.get("mode", check.mode))
    if mode not in statements.lambdas or exact != {"block": "Lambda", "mode": mode}:
        return "one pair failing says nothing about the others"
    return _confirm_lambda(check, statements, mode, _vector(check))


def _has_roots(count: int, statements: Statements, mode: str, vector: Vector) -> bool:
    """Whether J - K is shown to have so many eigenvalues with positive real part."""
    if count <= unstable_roots(statements, mode):
        return True
    return count == 1 and is_unstable_along(
        statements, mode, enclosed_lambda(statements, mode).value(vector)
    )


def _confirm_lambda(
    check: Check, statements: Statements, mode: str, vector: Vector, *, S: Matrix | None = None
) -> str | None:
    """The vector shows that Lambda, or Lambda + I (x) S, is not negative definite in that mode; so
    does the margin."""
    matrix = enclosed_lambda(statements, mode) if S is None else lambda_with(statements, mode, S)
    if not refutes(matrix, vector):
        return (
            "the vector does not refute Lambda < 0"
            if S is None
            else "the vector does not refute Psi < 0"
        )
    if not same_witness(check.witness, lambda_witness(statements, vector)):
        return "the witness names other agents than the vector"
    if check.margin is not None and -claimed(check.margin) > lowest_quotient(matrix, vector):
        return "the margin does not follow from the vector"
    return None


def _confirm_printed(
    check: Check, statements: Statements, pair: Pair | None, vector: Vector
) -> str | None:
    """The given pair fails: P > 0, Omega0 < 0 or, in a named mode, Psi < 0 is refuted by the
    vector."""
    exact, exosystem = check.exact or {}, _exosystem(statements)
    if pair is None:
        return "it needs the pair of the problem"
    block = exact.get("block")
    if block in ("P", "Omega0"):
        if exact != {"block": block} or check.margin is not None:
            return NO_NUMBER
        if not same_witness(check.witness, vector_witness(vector)):
            return "it needs a vector without labels"
        P_negated = SparseSymmetric.from_dense(pair.P).negated()
        matrix = Enclosed(middle=P_negated if block == "P" else omega(pair.P, pair.Q, exosystem))
        return None if refutes(matrix, vector) else f"the vector does not refute {block}"
    S, mode = schur_block(pair, exosystem), exact.get("mode")
    known = S is not None and mode in list(statements.lambdas)
    if S is None or not known or not agrees(exact, PairFacts(pair=pair, S=S, mode=mode).to_json()):
        return OTHER_VALUES
    # Omega0 < 0 is proved by now, so that Lambda + I (x) S decides (theory, the Reduction).
    return _confirm_lambda(check, statements, str(mode), vector, S=S)


def _exosystem(statements: Statements) -> Exosystem:
    exosystem = statements.loop.joint_exosystem
    if exosystem is None:
        raise ValueError("there is no exosystem")
    return exosystem


def _vector(check: Check) -> Vector:
    if check.witness is None or check.witness.kind != "vector" or check.witness.values is None:
        raise ValueError("a refuted condition must bring a vector")
    vector = tuple(numbers.read_rational(text) for text in check.witness.values)
    # a forger's: evaluating it would take minutes
    if not has_short_denominator(vector, numbers.VECTOR_BITS):
        raise ValueError(
            f"the vector needs a common denominator of more than {numbers.VECTOR_BITS} bits"
        )
    return vector
