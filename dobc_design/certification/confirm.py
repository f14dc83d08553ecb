"""Confirming a claimed check against the trusted problem: every number in it, exactly.

Nothing of the claim is believed: matrices are rebuilt from the problem, witnesses are multiplied out,
margins and rates are proved as they are written, and exact values have to be the very ones that follow.
A proof may claim less than is true (a smaller margin or rate, "undecided"), never more.

Not checked, because nothing depends on it: the sentences (``reason``) and the advice (``fix``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dobc_design.certification.confirm_regions import QUADRATIC, REGIONAL, Beside, confirm_region
from dobc_design.conditions.check import Check, Witness
from dobc_design.conditions.consensus.claim import omega
from dobc_design.conditions.consensus.decide import (
    Pair,
    enclosed_lambda,
    lambda_with,
    lambda_witness,
    pair_facts,
    psi_is_negative,
    schur_block,
    vector_witness,
)
from dobc_design.conditions.consensus.linearisation import unstable_roots
from dobc_design.conditions.consensus.negative import Enclosed, is_negative, lowest_quotient, refutes
from dobc_design.conditions.consensus.network import reachability_check
from dobc_design.conditions.consensus.statements import Statements
from dobc_design.conditions.numbers import VECTOR_BITS, claimed, doubles_from_json, has_short_denominator, read_rational
from dobc_design.conditions.observer.decide import (
    detectability_check,
    hurwitz_check,
    hurwitz_with_rate,
    observability_check,
)
from dobc_design.exact.matrix import Matrix, Vector, multiply, subtract
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.groups import blocks_of
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

#: Exact values that are no numbers.
NAMES = ("block", "mode", "group", "unobservable_polynomial")

#: Checks of the network or the exosystem alone; they say the same for every coupling.
PLAIN = ("observability", "detectability", "reachability", "hurwitz")


@dataclass(frozen=True, slots=True, kw_only=True)
class Trusted:
    """What claims are confirmed against: the problem, its conditions, and the matrices the claims use.

    ``separable``: the max-separable check of the same certificate, on which those of delays and sampling rest.
    """

    problem: Problem
    statements: Statements
    W: Matrix | None
    pair: Pair | None
    separable: Check | None = None


def claimed_vectors(checks: Sequence[Check], problem: Problem) -> dict[str, NDArray[np.float64]]:
    """The vectors that proved checks of Lemma 1 bring, by mode; what is no vector of n m numbers is left out."""
    found = {}
    for check in checks:
        if check.id == "lemma1" and check.verdict is Verdict.PROVED and check.exact is not None:
            try:
                vector = doubles_from_json(check.exact["v"]) if set(check.exact) == {"v"} else np.zeros(0)
            except (TypeError, ValueError):
                continue
            if len(vector) == problem.n * problem.m:
                found[str(check.mode)] = vector
    return found


def expected_checks(problem: Problem) -> tuple[tuple[str, str | None, str | None], ...]:
    """The (id, mode, group) of the checks that every complete certificate of this problem holds.

    It may hold regional ones besides.
    """
    modes = tuple(problem.network.modes)
    theorem = "theorem1" if len(modes) == 1 else "theorem2"
    result: list[tuple[str, str | None, str | None]] = []
    for group in problem.groups:
        name = group.name if problem.is_grouped else None
        result += [(id, None, name) for id in ("observability", "detectability", "hurwitz")]
    for id in ("reachability", "lemma1"):
        result += [(id, mode, None) for mode in modes]
    if problem.groups:
        if problem.joint_observer.P is not None:
            result.append((f"{theorem}-printed", None, None))
        result.append((theorem, None, None))
    return tuple(result)


def confirm(check: Check, trusted: Trusted) -> str | None:
    """None if everything the check claims is confirmed, else what is not."""
    statements = trusted.statements
    if check.id in (*REGIONAL, *QUADRATIC) and check.group is None:
        return confirm_region(
            check, Beside(problem=trusted.problem, W=trusted.W, domain=statements.domain, separable=trusted.separable)
        )
    if (check.id, check.mode, check.group) not in expected_checks(trusted.problem):
        return f"{check.title} does not belong to this problem"
    domain = "global" if check.id in PLAIN else statements.domain
    if check.domain != domain:
        return f"the domain must be {domain!r}"
    if check.verdict is Verdict.UNDECIDED:
        claims = (check.margin, check.rate, check.exact, check.witness)
        return None if all(part is None for part in claims) else "an undecided check must claim nothing"
    if check.id in PLAIN:
        return _confirm_plain(check, trusted)
    if statements.inapplicable is not None:
        return "the theorems do not apply to this coupling"
    if check.verdict is Verdict.PROVED:
        return _confirm_proved(check, trusted)
    return _confirm_refuted(check, trusted)


def _confirm_plain(check: Check, trusted: Trusted) -> str | None:
    own = _plain_check(check, trusted)
    if own.verdict is not check.verdict:
        return f"it is {own.verdict.value}"
    if not _agrees(check.exact, own.exact):
        return "exact differs from what the problem gives"
    if not _same_witness(check.witness, own.witness):
        return "witness differs from what the problem gives"
    if check.margin is not None or (check.rate is not None and check.id != "hurwitz"):
        return "it claims a number that this check does not have"
    if check.rate is None:
        return None
    exosystem, W = _of_group(check.group, trusted)
    if W is None or check.verdict is not Verdict.PROVED or check.rate <= 0:
        return "it claims a rate without ground"
    error = subtract(exosystem.A, multiply(W, exosystem.C))
    return None if hurwitz_with_rate(error, claimed(check.rate)) else f"the rate {check.rate} is not reached"


def _plain_check(check: Check, trusted: Trusted) -> Check:
    if check.id == "reachability":
        return reachability_check(trusted.problem, str(check.mode))
    exosystem, W = _of_group(check.group, trusted)
    if check.id == "observability":
        return observability_check(exosystem)
    if check.id == "detectability":
        return detectability_check(exosystem)
    return hurwitz_check(exosystem, W)


def _of_group(name: object, trusted: Trusted) -> tuple[Exosystem, Matrix | None]:
    """The exosystem and the gain of the group with this name; of the only one without a name.

    Raises: ValueError if there is none, or if W is not block diagonal.
    """
    groups, W = trusted.problem.groups, trusted.W
    if not trusted.problem.is_grouped:
        if name is not None:
            raise ValueError("there are no groups")
        return _exosystem(trusted), W
    place = [group.name for group in groups].index(str(name))
    system = groups[place].exosystem
    if W is None:
        return system, None
    blocks = blocks_of(W, [(group.exosystem.order, system.outputs) for group in groups])
    if blocks is None:
        raise ValueError("W is not block diagonal")
    return system, blocks[place]


def _confirm_proved(check: Check, trusted: Trusted) -> str | None:
    if check.margin is None or check.margin < 0 or (check.rate is not None and check.rate <= 0):
        return "a proof must claim a margin >= 0, and a rate > 0 or none"
    if check.witness is not None:
        return "a proof has no witness"
    margin, rate = claimed(check.margin), claimed(check.rate or 0.0)
    statements = trusted.statements
    if check.id == "lemma1":
        if check.exact is not None and str(check.mode) not in statements.shown:
            return "the vector does not show that Lambda < 0"
        proved = is_negative(enclosed_lambda(statements, str(check.mode)), shift=max(margin, 2 * rate))
        return None if proved else "Lambda < 0 is not true with that margin and rate"
    exosystem, pair = _exosystem(trusted), _pair_of(check, trusted)
    if pair is None:
        return "there is no pair (P, Q) to confirm it with"
    if not psi_is_negative(statements, exosystem, pair, margin=margin):
        return "Psi < 0 is not true with that margin"
    if rate and not psi_is_negative(statements, exosystem, pair, rate=rate):
        return f"the rate {check.rate} is not reached"
    S = schur_block(pair, exosystem)
    return None if S is not None and _agrees(check.exact, pair_facts(pair, S)) else "exact values are not what they say"


def _confirm_refuted(check: Check, trusted: Trusted) -> str | None:
    if check.rate is not None or (check.margin is not None and check.margin > 0):
        return "a refuted check must claim no rate and no positive margin"
    exact = dict(check.exact or {})
    block, mode = exact.get("block"), str(exact.get("mode", check.mode))
    if check.id == "lemma1":
        vector = _vector(check)
        if not _facts_follow(exact, trusted.statements, str(check.mode), vector):
            return "exact values are not what they say"
        return _confirm_lambda(check, vector, str(check.mode), trusted)
    if check.id.endswith("printed"):
        return _confirm_printed(check, exact, trusted)
    if block in ("detectability", "hurwitz"):
        return _confirm_obstacle(check, str(block), trusted)
    if mode not in trusted.statements.lambdas or exact != {"block": "Lambda", "mode": mode}:
        return "one pair failing says nothing about the others"
    return _confirm_lambda(check, _vector(check), mode, trusted)


def _facts_follow(exact: Mapping[str, Any], statements: Statements, mode: str, vector: Vector) -> bool:
    """A lower bound of the unstable roots, and perhaps one of v' Lambda v."""
    if not {"unstable_roots"} <= set(exact) <= {"unstable_roots", "value"}:
        return False
    roots = read_rational(exact["unstable_roots"])
    if roots.denominator != 1 or roots < 0 or (roots and roots > unstable_roots(statements, mode)):
        return False
    low = enclosed_lambda(statements, mode).value(vector).lo
    return "value" not in exact or read_rational(exact["value"]) <= low


def _confirm_lambda(
    check: Check, vector: Vector, mode: str, trusted: Trusted, *, S: Matrix | None = None
) -> str | None:
    """The vector shows that Lambda, or Lambda + I (x) S, is not negative definite in that mode."""
    statements = trusted.statements
    matrix = enclosed_lambda(statements, mode) if S is None else lambda_with(statements, mode, S)
    if not refutes(matrix, vector):
        return "the vector does not refute Lambda < 0" if S is None else "the vector does not refute Psi < 0"
    if not _same_witness(check.witness, lambda_witness(trusted.statements, vector)):
        return "the witness names other agents than the vector"
    return None if _margin_follows(check, matrix, vector) else "the margin does not follow from the vector"


def _confirm_printed(check: Check, exact: dict[str, Any], trusted: Trusted) -> str | None:
    """The given pair fails: P > 0, Omega0 < 0 or, in a named mode, Psi < 0 is refuted by the vector."""
    exosystem, pair, vector = _exosystem(trusted), _pair_of(check, trusted), _vector(check)
    if pair is None:
        return "it needs the pair of the problem"
    block = exact.get("block")
    if block in ("P", "Omega0"):
        if exact != {"block": block} or check.margin is not None:
            return "it claims a number that this check does not have"
        if not _same_witness(check.witness, vector_witness(vector)):
            return "it needs a vector without labels"
        blocks = {
            "P": lambda: SparseSymmetric.from_dense(pair.P).negated(),
            "Omega0": lambda: omega(pair.P, pair.Q, exosystem),
        }
        matrix = Enclosed(middle=blocks[str(block)]())
        return None if refutes(matrix, vector) else f"the vector does not refute {block}"
    statements, mode = trusted.statements, exact.get("mode")
    S = schur_block(pair, exosystem)
    if S is None or mode not in list(statements.lambdas) or not _agrees(exact, {**pair_facts(pair, S), "mode": mode}):
        return "exact values are not what they say"
    # Omega0 < 0 is proved by now, so that Lambda + I (x) S decides (theory, the Reduction).
    return _confirm_lambda(check, vector, str(mode), trusted, S=S)


def _margin_follows(check: Check, matrix: Enclosed, vector: Sequence[Fraction]) -> bool:
    """-margin is a lower bound of lambda_max."""
    return check.margin is None or -claimed(check.margin) <= lowest_quotient(matrix, vector)


def _confirm_obstacle(check: Check, block: str, trusted: Trusted) -> str | None:
    group = None if check.exact is None else check.exact.get("group")
    exosystem, W = _of_group(group, trusted)
    own = detectability_check(exosystem) if block == "detectability" else hurwitz_check(exosystem, W)
    if own.verdict is not Verdict.REFUTED:
        return f"{block} is {own.verdict.value}"
    if block == "hurwitz" and not _gain_is_given(group, trusted.problem):
        return "another W can be designed, so no pair is ruled out"
    witnessed = _same_witness(check.witness, own.witness)
    named = {"block": block} | ({} if group is None else {"group": group})
    if check.exact != named or not witnessed or check.margin is not None:
        return f"it claims more than that {block} fails"
    return None


def _gain_is_given(group: object, problem: Problem) -> bool:
    """Whether the W of this group is the problem's own."""
    return any(group in (each.name, None) and each.observer.W is not None for each in problem.groups)


def _agrees(claim: object, own: object, *, as_text: bool = False) -> bool:
    """Whether a part of a check says the same: rationals as numbers, names and polynomials as they are written."""
    if isinstance(own, Mapping) and isinstance(claim, Mapping):
        return set(claim) == set(own) and all(_agrees(claim[key], own[key], as_text=key in NAMES) for key in own)
    if isinstance(own, Sequence) and isinstance(claim, Sequence) and not isinstance(own, str):
        same_length = not isinstance(claim, str) and len(claim) == len(own)
        return same_length and all(_agrees(a, b, as_text=as_text) for a, b in zip(claim, own, strict=True))
    if claim == own or as_text or not isinstance(own, str):
        return claim == own
    return read_rational(claim) == read_rational(own)


def _same_witness(claim: Witness | None, own: Witness | None) -> bool:
    if claim is None or own is None:
        return claim is own
    named = (claim.kind, claim.labels) == (own.kind, own.labels)
    return named and _agrees(claim.values, own.values, as_text=own.kind == "polynomial")


def _exosystem(trusted: Trusted) -> Exosystem:
    exosystem = trusted.problem.joint_exosystem
    if exosystem is None:
        raise ValueError("there is no exosystem")
    return exosystem


def _pair_of(check: Check, trusted: Trusted) -> Pair | None:
    observer = trusted.problem.joint_observer
    if not check.id.endswith("printed"):
        return trusted.pair
    if observer.P is None or observer.W is None:
        return None
    return Pair(P=observer.P, Q=multiply(observer.P, observer.W))


def _vector(check: Check) -> Vector:
    if check.witness is None or check.witness.kind != "vector" or check.witness.values is None:
        raise ValueError("a refuted condition must bring a vector")
    vector = tuple(read_rational(text) for text in check.witness.values)
    if not has_short_denominator(vector, VECTOR_BITS):  # a forger's: evaluating it would take minutes
        raise ValueError(f"the vector needs a common denominator of more than {VECTOR_BITS} bits")
    return vector
