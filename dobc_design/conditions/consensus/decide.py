"""Lemma 1 and Theorems 1 and 2, decided exactly, with the eigenvalues that prove the linearisation
unstable.

A pair (P, Q) is a proposal; whether Psi < 0 holds for it is decided through the Reduction (theory,
section 2): given Omega0 < 0 and S = C (-Omega0)^-1 C', Psi(J) < 0 iff Lambda(J) + I (x) S < 0.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import partial

from dobc_design._checks import noun
from dobc_design.conditions import numbers
from dobc_design.conditions.check import Check, Values, Witness, agrees, differs, same_witness
from dobc_design.conditions.consensus import claim, network
from dobc_design.conditions.kinds import REACHABILITY
from dobc_design.conditions.numbers import (
    claimed,
    has_short_denominator,
    largest_proved,
    shorten,
    text_below,
)
from dobc_design.exact.definite import decide_positive_definite
from dobc_design.exact.interval import Interval
from dobc_design.exact.matrix import Array, Matrix, Vector, multiply, transpose, zeros
from dobc_design.exact.number import ZERO, from_fmpq_mat, number_text, to_fmpq_mat
from dobc_design.exact.polynomial import characteristic_polynomial, count_right_half_plane
from dobc_design.exact.symmetric import Entries, SparseSymmetric
from dobc_design.loop.arcs import unreached
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.groups import group_blocks, group_numbers
from dobc_design.verdict import Verdict

from .claim import ModeJacobian, Pair, PairFacts, Shown, Statements, Unstable, omega
from .network import (
    Enclosed,
    find_witness,
    is_negative,
    lowest_quotient,
    refutes,
)

LARGEST_EXAMINED = 60  # rows; counting roots takes seconds there, minutes at twice the size
MOST_SYMMETRIC = 100_000  # arcs of a mode whose J - K is compared with its transpose
# How a claim is not confirmed.
NO_NUMBER = "it claims a number that this check does not have"
OTHER_VALUES = "exact values are not what they say"
# rows^2 times the bits of the common denominator: as long as 60 rows with about 550 bits
MOST_COUNTING = 2_000_000


@noun
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
    jacobian = _jacobian(statements, mode)
    if jacobian is None:
        return 0
    # A gain < 0 pushes its agent away, so that there may be some.
    pulls = jacobian.pulls
    pulling = pulls.is_scalar and all(k[0][0] >= 0 for k in pulls.gains.values())
    if pulling and jacobian.is_nonnegative_diagonal:
        return 0
    matrix = linear_part(statements, mode)
    if matrix is None:
        return 0
    return count_right_half_plane(characteristic_polynomial(matrix))


def is_unstable_along(statements: Statements, mode: str, value: Interval) -> bool:
    """Whether v'Lambda v = ``value`` > 0 shows an eigenvalue of J - K > 0, of any size: where J - K
    is symmetric, Lambda = 2 (J - K), and its largest eigenvalue is at least v'(J - K)v / v'v."""
    return value.lo > 0 and _is_symmetric(statements, mode)


def _is_symmetric(statements: Statements, mode: str) -> bool:
    """Whether J - K of one mode is known exactly, and symmetric: the same arcs both ways."""
    if len(statements.loop.modes[mode]) > MOST_SYMMETRIC:
        return False
    entries = _known_entries(statements, mode)
    if entries is None:
        return False
    return all(value == entries.get((j, i), ZERO) for (i, j), value in entries.items())


def linear_part(statements: Statements, mode: str) -> Matrix | None:
    """J - K of one mode (n m, n m); None for more than 60 rows, for slopes that are not rational or
    too long."""
    loop = statements.loop
    size = loop.size
    if size > LARGEST_EXAMINED:
        return None
    entries = _known_entries(statements, mode)
    # Counting roots multiplies the digits of the entries.
    if entries is None or not has_short_denominator(entries.values(), MOST_COUNTING // size**2):
        return None
    rows = tuple(tuple(entries.get((i, j), ZERO) for j in range(size)) for i in range(size))
    return of_differences(rows, loop.m) if loop.agrees else rows


def of_differences(J: Matrix, m: int) -> Matrix:
    """The matrix of x_i - x_n, i < n, where rows of J add up to 0: that of J without its eigenvalue
    0, once for every component."""
    kept = len(J) - m
    last = J[kept:]
    return tuple(tuple(J[i][j] - last[i % m][j] for j in range(kept)) for i in range(kept))


def _known_entries(statements: Statements, mode: str) -> Entries | None:
    """The entries of J - K of one mode, where all slopes are rational; else None."""
    each = _jacobian(statements, mode)
    if each is None or not each.is_point:
        return None
    return claim.linearisation(each, statements.loop.m)


def _jacobian(statements: Statements, mode: str) -> ModeJacobian | None:
    """The Jacobian of the mode; None where the theorems do not apply."""
    modes = () if statements.jacobians is None else statements.jacobians.modes
    return next((each for each in modes if each.name == mode), None)


def enclosed_lambda(statements: Statements, mode: str) -> Enclosed:
    """Lambda(J) of one mode, with what it may deviate by."""
    pencil = statements.lambdas[mode]
    shown = statements.shown.get(mode)
    bound = None if shown is None else shown.bound
    return Enclosed(middle=pencil.constant, deviations=pencil.deviations, bound=bound)


def with_vectors(statements: Statements, vectors: Mapping[str, Array]) -> Statements:
    """The statements with the bounds below 0 of Lambda, by mode, that these vectors v > 0 (n m,)
    prove."""
    shown = {}
    for mode, v in vectors.items():
        bound = network.shown_bound(enclosed_lambda(statements, mode), v)
        if bound is not None and bound < 0:
            shown[mode] = Shown(vector=v, bound=bound)
    return replace(statements, shown=shown)


def lambda_with(statements: Statements, mode: str, S: Matrix) -> Enclosed:
    """Lambda(J) + I (x) S of one mode; where agents have different exosystems every agent has its
    own block of S, and 0 without a disturbance."""
    loop = statements.loop
    matrix = enclosed_lambda(statements, mode)
    blocks = list(group_blocks(S, len(loop.groups)))
    if not loop.is_grouped:
        return matrix.plus_blocks(blocks)
    owners = group_numbers(loop.groups, loop.labels)
    # An agent of no group has the number after the last one.
    if len(loop.groups) in owners:
        blocks.append(zeros(loop.m, loop.m))
    return matrix.plus_blocks(blocks, owners)


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
            reason=f"Lambda(J) < 0{most}: V = e'e decreases {statements.where}.",
        )
    loop = statements.loop
    arcs = loop.modes[mode]
    # A group that nothing holds reads better than any other witness.
    vector = find_witness(matrix, [*network.group_directions(loop, arcs), *proposal.vectors])
    if vector is None:
        reason = f"lambda_max(Lambda) {network.why_undecided(loop, matrix)}"
        return check(verdict=Verdict.UNDECIDED, reason=reason)
    value = matrix.value(vector)
    unstable = is_unstable_along(statements, mode, value)
    roots = max(unstable_roots(statements, mode), int(unstable))
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
    # What the user printed is decided as it is, whatever holds for other pairs.
    if not printed:
        general = _refuted_for_every_pair(id, statements, lemmas, obstacle)
        if general is not None:
            return general
    if pair is None:
        reason = "no pair (P, Q) was found, and no proof that there is none; give W and P."
        return undecided(reason=reason)
    failing = _failing_block(id, statements, pair)
    if failing is not None:
        return failing
    S = schur_block(pair, _exosystem(statements))
    if S is not None:
        facts = PairFacts(pair=pair, S=S)
        theorem = _Theorem(
            id=id, statements=statements, facts=facts, proposal=proposal, printed=printed
        )
        decided = theorem.proved() or theorem.refuted()
        if decided is not None:
            return decided
    # The mode with most enclosed slopes is the hardest to decide.
    matrices = [enclosed_lambda(statements, mode) for mode in statements.lambdas]
    widest = max(matrices, key=lambda each: len(each.deviations))
    why = network.why_undecided(statements.loop, widest)
    return undecided(reason=f"lambda_max of Lambda + I (x) S {why}")


def _failing_block(id: str, statements: Statements, pair: Pair) -> Check | None:
    """The refutation of a pair by P or Omega0 alone, whatever the network; None if both do."""
    reasons = {
        "P": "P is not positive definite: v'Pv <= 0 for the vector shown, so V is no Lyapunov "
        "function.",
        "Omega0": "PA + A'P - QC - C'Q' is not negative definite: the estimation error alone can "
        "make V grow.",
    }
    blocks = {
        "P": SparseSymmetric.from_dense(pair.P),
        "Omega0": omega(pair.P, pair.Q, _exosystem(statements)).negated(),
    }
    for block, reason in reasons.items():
        vector = decide_positive_definite(blocks[block]).witness
        if vector is not None:
            return Check(
                id=id,
                verdict=Verdict.REFUTED,
                domain=statements.domain,
                reason=f"{reason} Another P may do.",
                claim=Values({"block": block}),
                witness=vector_witness(vector),
            )
    return None


@noun
class _Theorem:
    """Theorem 1 or 2 for one pair with P > 0 and Omega0 < 0: Lambda + I (x) S < 0 in every mode."""

    id: str
    statements: Statements
    facts: PairFacts
    proposal: Proposal
    printed: bool

    def proved(self) -> Check | None:
        """The check with its largest proved margin and rate; None without a proof."""
        statements = self.statements
        pair = self.facts.pair
        matrices = [lambda_with(statements, mode, self.facts.S) for mode in statements.lambdas]

        def has_margin(shift: Fraction) -> bool:
            return bool(matrices) and all(is_negative(each, shift=shift) for each in matrices)

        def has_rate(rate: Fraction) -> bool:
            return psi_is_negative(statements, _exosystem(statements), pair, rate=rate)

        # Proposals of floating point are lowered a little until they are proved.
        margin = largest_proved(self.proposal.margin, has_margin)
        if margin is None:
            return None
        rate = largest_proved(self.proposal.rate, has_rate)
        name = "the P given" if self.printed else "a rational P"
        if len(matrices) > 1:
            modes = "both" if len(matrices) == 2 else f"all {len(matrices)}"
            name += f" with one P for {modes} modes"
        pace = f", V' <= -2 ({text_below(rate)}) V." if rate else "."
        return Check(
            id=self.id,
            verdict=Verdict.PROVED,
            domain=statements.domain,
            margin=margin,
            rate=rate or None,
            claim=self.facts,
            reason=f"Psi < 0 holds exactly for {name}: V = e'e + sum eps_i' P eps_i"
            f" decreases {statements.where}{pace}",
        )

    def refuted(self) -> Check | None:
        """The check with a direction in which V does not decrease; None if none is found."""
        statements = self.statements
        S = self.facts.S
        for mode in statements.lambdas:
            enclosed = lambda_with(statements, mode, S)
            vector = find_witness(enclosed, self.proposal.vectors)
            if vector is None:
                continue
            reason = "Psi is not negative definite for this P"
            if len(statements.lambdas) > 1:
                reason += f" in mode {mode}"
            reason += ": v'(Lambda + I (x) S)v >= 0 for the vector shown."
            if self.facts.bound is not None:
                reason += f" It needs lambda_max(Lambda) < {number_text(self.facts.bound)}."
            if self.printed:
                reason += " Another P may do: see the check for a new P."
            return Check(
                id=self.id,
                verdict=Verdict.REFUTED,
                domain=statements.domain,
                margin=network.refuted_margin(enclosed, vector),
                reason=reason,
                claim=replace(self.facts, mode=mode),
                witness=lambda_witness(statements, vector),
            )
        return None


def schur_block(pair: Pair, exosystem: Exosystem, *, rate: Fraction = ZERO) -> Matrix | None:
    """S = C (-Omega0 - 2 rate P)^-1 C', m x m; None unless that block is proved negative
    definite."""
    block = omega(pair.P, pair.Q, exosystem, rate=rate).negated()
    if not decide_positive_definite(block).is_proved:
        return None
    C = exosystem.C
    if not C or not C[0]:  # nothing to solve for
        return multiply(C, transpose(C))
    solved = to_fmpq_mat(block.to_dense()).solve(to_fmpq_mat(transpose(C)))
    return multiply(C, from_fmpq_mat(solved))


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
    if not decide_positive_definite(pair.P).is_proved:
        return False
    S = schur_block(pair, exosystem, rate=rate)
    if S is None:
        return False
    shift = margin + 2 * rate
    matrices = (lambda_with(statements, mode, S) for mode in statements.lambdas)
    return all(is_negative(each, shift=shift) for each in matrices)


def vector_witness(vector: Vector) -> Witness:
    """A direction in which a matrix is not definite."""
    return Witness(kind="vector", values=tuple(number_text(x) for x in vector))


def lambda_witness(statements: Statements, vector: Vector) -> Witness:
    """A direction of the network, with the labels of the agents that move in it."""
    return replace(vector_witness(vector), labels=network.carriers(statements.loop, vector))


def _refuted_for_every_pair(
    id: str, statements: Statements, lemmas: Sequence[Check], obstacle: Check | None
) -> Check | None:
    """What the other checks decide for all pairs at once; None if the pair has to be looked at."""
    refuted = partial(Check, id=id, verdict=Verdict.REFUTED, domain=statements.domain)
    for lemma in lemmas:
        if lemma.verdict is Verdict.REFUTED:
            return refuted(
                margin=lemma.margin,
                reason="no P and Q satisfy Psi < 0, because Lambda(J) is not negative definite "
                f"in mode {lemma.mode}: {lemma.reason}",
                claim=Values({"block": "Lambda", "mode": lemma.mode}),
                witness=lemma.witness,
            )
    if obstacle is not None:
        who = "no P and Q satisfy Psi < 0"
        # A W that does not do leaves others; an undetectable pair leaves none.
        if obstacle.id == "hurwitz":
            who = "no P with Q = P W satisfies Psi < 0 for this W"
        values = {"block": obstacle.id}
        if obstacle.group is not None:
            values["group"] = obstacle.group
        return refuted(
            reason=f"{who}: {obstacle.reason}",
            claim=Values(values),
            witness=obstacle.witness,
            fix=obstacle.fix,
        )
    for lemma in lemmas:
        if lemma.verdict is Verdict.UNDECIDED:
            reason = f"Lambda(J) < 0 could not be decided: {lemma.reason}"
            return Check(id=id, verdict=Verdict.UNDECIDED, domain=statements.domain, reason=reason)
    return None


def confirm(check: Check, statements: Statements, pair: Pair | None) -> str | None:
    """None if all that a check of this topic claims is confirmed; one refuted by the observer is
    not for here."""
    loop = statements.loop
    if check.id == REACHABILITY:
        if check.margin is not None or check.rate is not None:
            return NO_NUMBER
        return differs(check, network.reachability_check(loop, str(check.mode)))
    if statements.inapplicable is not None:
        return "the theorems do not apply to this coupling"
    # The printed check is about the pair of the problem, not about that of the certificate.
    if check.kind.role == "given":
        own = loop.joint_observer
        pair = None if own.P is None or own.W is None else Pair(P=own.P, Q=multiply(own.P, own.W))
    decide = _confirm_proved if check.is_proved else _confirm_refuted
    return decide(check, statements, pair)


def _confirm_proved(check: Check, statements: Statements, pair: Pair | None) -> str | None:
    if check.margin is None or check.margin < 0 or (check.rate is not None and check.rate <= 0):
        return "a proof must claim a margin >= 0, and a rate > 0 or none"
    if check.witness is not None:
        return "a proof has no witness"
    # The decimals as they are written, not the floats nearest to them.
    margin = claimed(check.margin)
    rate = claimed(check.rate or 0.0)
    if check.kind.is_lemma:
        mode = str(check.mode)
        if check.exact is not None and mode not in statements.shown:
            return "the vector does not show that Lambda < 0"
        if not is_negative(enclosed_lambda(statements, mode), shift=max(margin, 2 * rate)):
            return "Lambda < 0 is not true with that margin and rate"
        return None
    exosystem = _exosystem(statements)
    if pair is None:
        return "there is no pair (P, Q) to confirm it with"
    if not psi_is_negative(statements, exosystem, pair, margin=margin):
        return "Psi < 0 is not true with that margin"
    if rate and not psi_is_negative(statements, exosystem, pair, rate=rate):
        return f"the rate {check.rate} is not reached"
    # S and the bound are for readers, and must be what follows from P and Q.
    S = schur_block(pair, exosystem)
    if S is None or not agrees(check.exact, PairFacts(pair=pair, S=S).to_json()):
        return OTHER_VALUES
    return None


def _confirm_refuted(check: Check, statements: Statements, pair: Pair | None) -> str | None:
    if check.rate is not None or (check.margin is not None and check.margin > 0):
        return "a refuted check must claim no rate and no positive margin"
    if check.kind.is_lemma:
        return _confirm_unstable(check, statements)
    if check.kind.role == "given":
        return _confirm_printed(check, statements, pair, _vector(check))
    # Without Lambda < 0 there is no pair at all (theory, the Reduction).
    exact = check.exact or {}
    mode = str(exact.get("mode", check.mode))
    if mode not in statements.lambdas or exact != {"block": "Lambda", "mode": mode}:
        return "one pair failing says nothing about the others"
    return _confirm_lambda(check, statements, mode, _vector(check))


def _confirm_unstable(check: Check, statements: Statements) -> str | None:
    """Lemma 1 fails with at least so many unstable eigenvalues, and v'Lambda v is at least what
    is said."""
    mode = str(check.mode)
    said = claim.read_claim(check, statements.loop, None)
    if not isinstance(said, Unstable):
        return OTHER_VALUES
    vector = _vector(check)
    value = enclosed_lambda(statements, mode).value(vector)
    is_more = said.roots > unstable_roots(statements, mode)
    # The direction itself shows one, where J - K is symmetric.
    if is_more and (said.roots > 1 or not is_unstable_along(statements, mode, value)):
        return OTHER_VALUES
    # Of irrational slopes only a lower end is known.
    if said.value is not None and said.value > value.lo:
        return OTHER_VALUES
    return _confirm_lambda(check, statements, mode, vector)


def _confirm_lambda(
    check: Check, statements: Statements, mode: str, vector: Vector, *, S: Matrix | None = None
) -> str | None:
    """The vector shows that Lambda, or Lambda + I (x) S, is not negative definite in that mode; so
    does the margin."""
    if S is None:
        what = "Lambda"
        matrix = enclosed_lambda(statements, mode)
    else:
        what = "Psi"
        matrix = lambda_with(statements, mode, S)
    if not refutes(matrix, vector):
        return f"the vector does not refute {what} < 0"
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
    exosystem = _exosystem(statements)
    if pair is None:
        return "it needs the pair of the problem"
    exact = check.exact or {}
    block = exact.get("block")
    if block in ("P", "Omega0"):
        if exact != {"block": block} or check.margin is not None:
            return NO_NUMBER
        if not same_witness(check.witness, vector_witness(vector)):
            return "it needs a vector without labels"
        failing = omega(pair.P, pair.Q, exosystem)
        if block == "P":
            failing = SparseSymmetric.from_dense(pair.P).negated()
        if not refutes(Enclosed(middle=failing), vector):
            return f"the vector does not refute {block}"
        return None
    S = schur_block(pair, exosystem)
    mode = exact.get("mode")
    # A forger's mode may be of any type, also one that has no hash.
    if S is None or mode not in list(statements.lambdas):
        return OTHER_VALUES
    if not agrees(exact, PairFacts(pair=pair, S=S, mode=mode).to_json()):
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
