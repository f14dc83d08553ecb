"""Confirming a claimed check against the trusted problem: every number in it, exactly.

Nothing of the claim is believed: matrices are rebuilt from the problem, witnesses are multiplied out,
margins and rates are proved as they are written.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction

from dobc_design.exact.matrix import Matrix, Vector, multiply, subtract
from dobc_design.exact.number import parse_number
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.spec.problem import Problem
from dobc_design.theorems.conditions import omega
from dobc_design.theorems.statements import Statements
from dobc_design.verdict import Verdict
from dobc_design.verify.check import Check
from dobc_design.verify.consensus import Pair, enclosed_lambda, psi_is_negative, schur_block
from dobc_design.verify.linearisation import unstable_roots
from dobc_design.verify.negative import Enclosed, is_negative, refutes
from dobc_design.verify.network import reachability_check
from dobc_design.verify.numbers import claimed
from dobc_design.verify.observer import detectability_check, hurwitz_check, hurwitz_with_rate, observability_check

PLAIN = ("observability", "detectability", "reachability", "hurwitz")


@dataclass(frozen=True, slots=True, kw_only=True)
class Trusted:
    """What claims are confirmed against: the problem, its conditions, and the matrices the claims use."""

    problem: Problem
    statements: Statements
    W: Matrix | None
    pair: Pair | None


def expected_checks(problem: Problem) -> tuple[tuple[str, str | None], ...]:
    """The (id, mode) of the checks that every complete certificate of this problem holds."""
    modes = tuple(problem.network.modes)
    theorem = "theorem1" if len(modes) == 1 else "theorem2"
    result: list[tuple[str, str | None]] = []
    if problem.exosystem is not None:
        result += [("observability", None), ("detectability", None), ("hurwitz", None)]
    for id in ("reachability", "lemma1"):
        result += [(id, mode) for mode in modes]
    if problem.exosystem is not None:
        if problem.observer.P is not None:
            result.append((f"{theorem}-printed", None))
        result.append((theorem, None))
    return tuple(result)


def confirm(check: Check, trusted: Trusted) -> str | None:
    """None if everything the check claims is confirmed, else what is not."""
    problem = trusted.problem
    if (check.id, check.mode) not in expected_checks(problem):
        return f"{check.title} does not belong to this problem"
    if check.verdict is Verdict.UNDECIDED:
        return None if check.margin is None and check.rate is None else "an undecided check must claim no number"
    if check.id in PLAIN:
        return _confirm_plain(check, trusted)
    statements = trusted.statements
    if statements.inapplicable is not None:
        return "the theorems do not apply to this coupling"
    if check.domain != statements.domain:
        return f"the domain must be {statements.domain!r}"
    if check.verdict is Verdict.PROVED:
        return _confirm_proved(check, trusted)
    return _confirm_refuted(check, trusted)


def _confirm_plain(check: Check, trusted: Trusted) -> str | None:
    problem, exosystem = trusted.problem, trusted.problem.exosystem
    if check.id == "reachability":
        own = reachability_check(problem, check.mode or "")
    elif exosystem is None:
        return "there is no exosystem"
    else:
        makers: dict[str, Callable[[], Check]] = {
            "observability": lambda: observability_check(exosystem),
            "detectability": lambda: detectability_check(exosystem),
            "hurwitz": lambda: hurwitz_check(exosystem, trusted.W),
        }
        own = makers[check.id]()
    if own.verdict is not check.verdict:
        return f"it is {own.verdict.value}"
    for part in ("domain", "exact", "witness", "fix"):
        if _plain(getattr(own, part)) != _plain(getattr(check, part)):
            return f"{part} differs from what the problem gives"
    if check.margin is not None or (check.rate is not None and check.id != "hurwitz"):
        return "it claims a number that this check does not have"
    if check.rate is not None:
        if exosystem is None or trusted.W is None or check.verdict is not Verdict.PROVED or check.rate <= 0:
            return "it claims a rate without ground"
        error = subtract(exosystem.A, multiply(trusted.W, exosystem.C))
        if not hurwitz_with_rate(error, claimed(check.rate)):
            return f"the rate {check.rate} is not reached"
    return None


def _plain(value: object) -> object:
    return value.to_json() if hasattr(value, "to_json") else value


def _confirm_proved(check: Check, trusted: Trusted) -> str | None:
    if check.margin is None or check.margin < 0 or (check.rate is not None and check.rate <= 0):
        return "a proof must claim a margin >= 0, and a rate > 0 or none"
    margin, rate = claimed(check.margin), claimed(check.rate or 0.0)
    statements = trusted.statements
    if check.id == "lemma1":
        if not is_negative(enclosed_lambda(statements, check.mode or ""), shift=max(margin, 2 * rate)):
            return "Lambda < 0 is not true with that margin and rate"
        return None
    exosystem, pair = trusted.problem.exosystem, _pair_of(check, trusted)
    if exosystem is None or pair is None:
        return "there is no pair (P, Q) to confirm it with"
    if not psi_is_negative(statements, exosystem, pair, margin=margin):
        return "Psi < 0 is not true with that margin"
    if rate and not psi_is_negative(statements, exosystem, pair, rate=rate):
        return f"the rate {check.rate} is not reached"
    return _confirm_exact(check, pair, trusted)


def _confirm_exact(check: Check, pair: Pair, trusted: Trusted) -> str | None:
    exosystem = trusted.problem.exosystem
    S = None if exosystem is None else schur_block(pair, exosystem)
    known = {"P": pair.P, "Q": pair.Q, "S": S}
    for name, value in (check.exact or {}).items():
        if name in known:
            if known[name] is None or _numbers(value) != known[name]:
                return f"exact {name} is not what it says"
        elif name == "bound":
            bound = -_number(value)
            if S is None or any(S[i][j] != (bound if i == j else 0) for i in range(len(S)) for j in range(len(S))):
                return "exact bound is not what it says"
        elif name != "mode":
            return f"exact {name} is not known here"
    return None


def _confirm_refuted(check: Check, trusted: Trusted) -> str | None:
    if check.rate is not None or (check.margin is not None and check.margin > 0):
        return "a refuted check must claim no rate and no positive margin"
    exact = dict(check.exact or {})
    block = exact.get("block")
    if block in ("detectability", "hurwitz") and not check.id.endswith("printed"):
        return _confirm_obstacle(check, str(block), trusted)
    if check.witness is None or check.witness.kind != "vector" or check.witness.values is None:
        return "a refuted condition must bring a vector"
    vector = tuple(_number(text) for text in check.witness.values)
    if not any(vector):
        return "the vector is zero"
    if check.id == "lemma1":
        return _confirm_lambda(check, vector, check.mode or "", trusted)
    mode = exact.get("mode")
    if block == "Lambda" and not check.id.endswith("printed") and mode in trusted.statements.lambdas:
        return _confirm_lambda(check, vector, str(mode), trusted)
    pair, exosystem = _pair_of(check, trusted), trusted.problem.exosystem
    if pair is None or exosystem is None or not check.id.endswith("printed"):
        return "one pair failing says nothing about the others"
    if block in ("P", "Omega0"):
        matrix = SparseSymmetric.from_dense(pair.P).negated() if block == "P" else omega(pair.P, pair.Q, exosystem)
        enclosed = Enclosed(middle=matrix, radius=Fraction(0))
        return None if len(vector) == matrix.size and refutes(enclosed, vector) else f"the vector does not refute {block}"
    return _confirm_psi(check, vector, mode, pair, trusted) or _confirm_exact(check, pair, trusted)


def _confirm_lambda(check: Check, vector: Vector, mode: str, trusted: Trusted) -> str | None:
    matrix = enclosed_lambda(trusted.statements, mode)
    if len(vector) != matrix.middle.size or not refutes(matrix, vector):
        return "the vector does not refute Lambda < 0"
    if not _margin_follows(check, matrix, vector):
        return "the margin does not follow from the vector"
    if check.id == "lemma1":
        exact = dict(check.exact or {})
        if _number(exact.pop("value", "0")) != matrix.middle.quadratic_form(vector):
            return "exact value is not v' Lambda v"
        if exact.pop("unstable_roots", "0") != str(unstable_roots(trusted.statements, mode)) or exact:
            return "exact unstable_roots is not what it says"
    return None


def _confirm_psi(check: Check, vector: Vector, mode: object, pair: Pair, trusted: Trusted) -> str | None:
    names = list(trusted.statements.lambdas)
    if mode not in names:
        return "it must name a mode of the problem"
    pencil = trusted.statements.psi()[names.index(str(mode))]
    matrix = Enclosed(middle=pencil.at({"P": pair.P, "Q": pair.Q}), radius=pencil.radius)
    if len(vector) != matrix.middle.size or not refutes(matrix, vector):
        return "the vector does not refute Psi < 0"
    head = vector[: trusted.problem.n * trusted.problem.m]
    S = schur_block(pair, trusted.problem.exosystem) if trusted.problem.exosystem is not None else None
    if check.margin and S is not None:
        reduced = enclosed_lambda(trusted.statements, str(mode)).plus_blocks(S)
        return None if any(head) and _margin_follows(check, reduced, head) else "the margin does not follow"
    return None


def _margin_follows(check: Check, matrix: Enclosed, vector: Sequence[Fraction]) -> bool:
    """-margin is a lower bound of lambda_max: -margin v'v <= v'Mv."""
    if check.margin is None:
        return True
    square = sum((x * x for x in vector), Fraction(0))
    lowest = matrix.middle.quadratic_form(vector) - matrix.radius * square
    return -claimed(check.margin) * square <= lowest


def _confirm_obstacle(check: Check, block: str, trusted: Trusted) -> str | None:
    exosystem = trusted.problem.exosystem
    if exosystem is None:
        return "there is no exosystem"
    own = detectability_check(exosystem) if block == "detectability" else hurwitz_check(exosystem, trusted.W)
    if own.verdict is not Verdict.REFUTED:
        return f"{block} is {own.verdict.value}"
    if block == "hurwitz" and trusted.problem.observer.W is None:
        return "another W can be designed, so no pair is ruled out"
    for part in ("witness", "fix"):
        if _plain(getattr(own, part)) != _plain(getattr(check, part)):
            return f"{part} differs from what the problem gives"
    return None


def _pair_of(check: Check, trusted: Trusted) -> Pair | None:
    observer = trusted.problem.observer
    if check.id.endswith("printed"):
        if observer.P is None or observer.W is None:
            return None
        return Pair(P=observer.P, Q=multiply(observer.P, observer.W))
    return trusted.pair


def _numbers(value: object) -> Matrix | None:
    if not isinstance(value, list) or not all(isinstance(row, list) for row in value):
        return None
    return tuple(tuple(_number(entry) for entry in row) for row in value)


def _number(text: object) -> Fraction:
    return read_rational(text)


def read_rational(text: object) -> Fraction:
    """Read a rational of a certificate: "-9/8" or "3", at most 20000 characters (not a typed number)."""
    if isinstance(text, str) and 200 < len(text) <= 20000:
        top, _, bottom = text.partition("/")
        plain = top.removeprefix("-")
        if plain.isascii() and plain.isdigit() and (not bottom or (bottom.isascii() and bottom.isdigit())):
            return Fraction(_big(top), _big(bottom) if bottom else 1)
    return parse_number(text, key="certificate")


def _big(digits: str) -> int:
    """int() of up to 20000 digits, in pieces: Python refuses more than 4300 at once."""
    sign, plain = (-1, digits[1:]) if digits.startswith("-") else (1, digits)
    value = 0
    for start in range(0, len(plain), 4000):
        part = plain[start : start + 4000]
        value = value * 10 ** len(part) + int(part)
    return sign * value
