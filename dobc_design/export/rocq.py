"""A certificate's Theorem 1, 2 or Lemma 1 as a file that the kernel of Coq checks.

The file states the problem in rationals, builds Psi from it inside Coq, and proves x' Psi x < 0 for every
vector x other than 0, rational or real, from Psi = -L D L' multiplied out by the kernel.  It needs nothing
but Coq's standard library: ``coqc FILE.v``.  Nothing is taken from a solver, and nothing here is trusted:
a wrong number makes a file that Coq refuses.  What Coq does not see is h: the slopes h'(0) enter as numbers.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping
from fractions import Fraction

from dobc_design.certificate.certificate import Certificate
from dobc_design.errors import SpecError
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.export import rocq_theory as theory
from dobc_design.export.squares import Square, factor
from dobc_design.spec.canonical import problem_sha256
from dobc_design.spec.problem import Problem
from dobc_design.theorems.jacobians import Jacobians, ModeJacobian
from dobc_design.theorems.statements import Statements, state_theorems
from dobc_design.verdict import Verdict
from dobc_design.verify.numbers import claimed

LARGEST_SIZE = 120  # rows of Psi; at 81 Coq takes about a minute
WIDTH = 110
COMPUTED = "Proof. vm_cast_no_check (eq_refl true). Qed."  # the kernel computes, once, when it reads Qed
TITLES = {"theorem1": "Theorem 1", "theorem2": "Theorem 2", "lemma1": "Lemma 1"}


def rocq_proof(certificate: Certificate, *, rate: bool = False) -> str:
    """Return the text of a Coq file that proves the certificate's theorem.

    With an exosystem: theorem1 or theorem2, with the certificate's P and Q = P W, for all modes.  Without:
    lemma1 of every mode.  ``rate`` adds the proof of the claimed decay rate.  Same certificate, same text.
    Raises: SpecError if that is not proved in the certificate, if slopes h'(0) are irrational, if the
    problem is too large for Coq, or if the numbers in the certificate do not prove what it claims.
    """
    problem = certificate.problem
    if certificate.claims.problem_sha256 != problem_sha256(problem):
        raise SpecError(
            "the certificate is about another problem: its hash differs.", key="problem_sha256",
            cure="Give the problem it was made for.",
        )  # fmt: skip
    id = _theorem_id(certificate)
    statements = state_theorems(problem)
    _refuse_irrational(statements)
    claimed_rate = _rate(certificate, id) if rate else None
    psi = _matrices(certificate, statements, Fraction(0))
    parts = [
        _head(certificate, id),
        _section("1. What the words mean"), theory.DEFINITIONS,
        _section("2. The problem, and Psi"), *_data(certificate, statements, claimed_rate),
        _section("3. From L D L' to definiteness: proved once, for every matrix"),
        theory.CHECKER, theory.OVER_Q, theory.OVER_R,
        _section("4. The witnesses: L and D of -Psi, and what the kernel finds when it multiplies them out"),
        *_witnesses(psi, "Psi"),
    ]  # fmt: skip
    if problem.exosystem is not None and certificate.claims.P is not None:
        parts += _pair_witnesses(certificate.claims.P)
    if claimed_rate is not None:
        parts += _witnesses(_matrices(certificate, statements, claimed_rate), "Psi_rate")
    parts += [
        _section(f"5. {TITLES[id]}"),
        *_conclusions(id, list(psi), with_pair=problem.exosystem is not None, rate=claimed_rate),
    ]
    return "\n".join(part.strip("\n") + "\n" for part in parts)


def _theorem_id(certificate: Certificate) -> str:
    """The id of what is to be proved; raises SpecError unless the certificate says that it is proved."""
    problem, claims = certificate.problem, certificate.claims
    if problem.exosystem is None:
        wanted, id = [("lemma1", mode) for mode in problem.network.modes], "lemma1"
    else:
        id = "theorem1" if len(problem.network.modes) == 1 else "theorem2"
        wanted = [(id, None)]
    found = {(check.id, check.mode): check for check in claims.checks}
    for key in wanted:
        check = found.get(key)
        if check is None or check.verdict is not Verdict.PROVED:
            verdict = "missing" if check is None else check.verdict.value
            title = f"{id} ({key[1]})" if key[1] else id
            raise SpecError(
                f"only a proved theorem can be exported; {title} is {verdict} in this certificate.", key="checks",
                cure="Certify a problem for which it is proved.",
            )  # fmt: skip
    if problem.exosystem is not None and (claims.P is None or claims.Q is None or claims.W is None):
        raise SpecError(
            f"the certificate must hold W, P and Q, because {id} is proved by them; it lacks one.", key="observer",
            cure="Make it again with `dobc certify`.",
        )  # fmt: skip
    return id


def _rate(certificate: Certificate, id: str) -> Fraction:
    """The decay rate claimed for every mode, in 1/s."""
    rates = [check.rate for check in certificate.checks if check.id == id]
    known = [each for each in rates if each]
    if not known or len(known) != len(rates):
        raise SpecError(
            f"the certificate claims no decay rate for {id}.", key="rate", cure="Export it without a rate.",
        )  # fmt: skip
    return min(claimed(each) for each in known)


def _refuse_irrational(statements: Statements) -> None:
    problem = statements.problem
    for coupling in problem.couplings:
        if any(not entry.is_point for row in coupling.jacobian_at_zero() for entry in row):
            raise SpecError(
                f'coupling h = "{"; ".join(coupling.texts)}": the slope h\'(0) must be rational, because Psi is'
                " stated in rationals; it is known here as an interval only.",
                key="coupling.h", cure="Write the coupling with a rational slope at 0, or use `dobc verify`.",
            )  # fmt: skip
    size = problem.n * (problem.m + problem.q)
    if size > LARGEST_SIZE:
        raise SpecError(
            f"Psi must have at most {LARGEST_SIZE} rows for Coq to check it in reasonable time; it has {size}.",
            key="network.agents", cure="`dobc verify` checks certificates of any size.",
        )  # fmt: skip


def _matrices(certificate: Certificate, statements: Statements, rate: Fraction) -> dict[str, tuple[Square, ...]]:
    """Mode -> the squares of -(Psi + 2 rate V)."""
    claims, problem = certificate.claims, certificate.problem
    if problem.exosystem is None or claims.P is None or claims.Q is None:
        named = {mode: each.constant.shifted(2 * rate) for mode, each in statements.lambdas.items()}
    else:
        pair = {"P": claims.P, "Q": claims.Q}
        each = zip(statements.lambdas, statements.psi(rate=rate), strict=True)
        named = {mode: pencil.at(pair) for mode, pencil in each}
    return {mode: _factored(matrix.negated(), f"Psi of mode {mode}") for mode, matrix in named.items()}


def _factored(matrix: SparseSymmetric, name: str) -> tuple[Square, ...]:
    squares = factor(matrix)
    if squares is None:
        raise SpecError(
            f"{name} is not definite with the numbers of this certificate, though it is claimed.", key="checks",
            cure="Check the certificate with `dobc verify`, and make it again.",
        )  # fmt: skip
    return squares


def _head(certificate: Certificate, id: str) -> str:
    problem, claims = certificate.problem, certificate.claims
    several = "" if len(problem.network.modes) == 1 else f", in each of the {len(problem.network.modes)} modes"
    return _comment(
        f"{TITLES[id]} for the problem {problem.name}, checked by Coq.",
        f"Claim: Psi is negative definite at the consensus{several}; with it V = e'e"
        + ("" if problem.exosystem is None else " + sum over i of eps_i' P eps_i")
        + " decreases along the linearised closed loop.",
        "Check it with: coqc FILE.v   (Coq 8.16 or newer, standard library only).",
        "To know what is proved, read parts 1 and 2 and the statements in part 5; parts 3 and 4 are proofs. Coq does"
        " not see the coupling h itself: its slopes h'(0) at the consensus enter part 2 as numbers.",
        f"Made by dobc_design {claims.version}. SHA-256 of the problem: {claims.problem_sha256}.",
        *(f"Note: {note}" for note in problem.notes),
    )


def _data(certificate: Certificate, statements: Statements, rate: Fraction | None) -> Iterable[str]:
    problem, claims = certificate.problem, certificate.claims
    agents = ", ".join(f"{i} is {label}" for i, label in enumerate(problem.network.labels))
    yield _comment(f"Agents by number, counted from 0: {agents}.")
    yield f"Definition n : nat := {problem.n}. (* agents *)"
    yield f"Definition m : nat := {problem.m}. (* state components of an agent *)"
    yield from _arcs(statements)
    yield from _pins(problem)
    yield theory.NETWORK
    if problem.exosystem is None or claims.P is None or claims.Q is None or claims.W is None:
        yield theory.ALONE
    else:
        yield _comment("The disturbance d = C xi with xi' = A xi, the observer gain W, and P and Q = P W of V.")
        yield f"Definition q : nat := {problem.q}. (* order of the exosystem *)"
        for name, value in (("A", problem.exosystem.A), ("C", problem.exosystem.C), ("W", claims.W)):
            yield f"Definition {name} := {_matrix(value)}."
        yield f"Definition P := {_matrix(claims.P)}."
        yield f"Definition Qm := {_matrix(claims.Q)}."
        yield theory.OBSERVER
    yield theory.DERIVATIVE
    if rate is not None:
        yield _comment("The decay rate, in 1/s.")
        yield f"Definition rate : Q := {_number(rate)}."
        yield theory.RATE


def _arcs(statements: Statements) -> Iterable[str]:
    problem, jacobians = statements.problem, statements.jacobians
    if jacobians is None:  # unreachable: something is proved
        return
    yield _comment("h of the couplings: " + ", ".join(" ; ".join(each.texts) for each in problem.couplings) + ".")
    names = _slope_names(jacobians)
    for slope, name in names.items():
        yield f"Definition {name} := {_matrix(slope)}."
    for number, mode in enumerate(jacobians.modes, start=1):
        yield _comment(f"Mode {mode.name}: who listens to whom.")
        arcs = [
            f"Arc {listener} {speaker} {names[_slope(mode, kind)]}"
            for (listener, speaker, _), kind in zip(mode.arcs, mode.kind.tolist(), strict=True)
        ]
        yield f"Definition arcs_{number} : list arc :=\n{_list(arcs)}."
    modes = "; ".join(f"arcs_{number}" for number in range(1, len(jacobians.modes) + 1))
    yield f"Definition modes : list (list arc) := [{modes}]."


def _slope_names(jacobians: Jacobians) -> dict[Matrix, str]:
    slopes = dict.fromkeys(_slope(mode, kind) for mode in jacobians.modes for kind in range(len(mode.gains)))
    return {slope: f"slope_{number}" for number, slope in enumerate(slopes, start=1)}


def _slope(mode: ModeJacobian, kind: int) -> Matrix:
    return tuple(tuple(entry.lo for entry in row) for row in mode.gains[kind])


def _pins(problem: Problem) -> Iterable[str]:
    gains = dict.fromkeys(problem.pinning.gains.values())
    names = {gain: f"gain_{number}" for number, gain in enumerate(gains, start=1)}
    yield _comment("Who is pinned, and how strongly; all others have the gain 0.")
    for gain, name in names.items():
        yield f"Definition {name} := {_matrix(gain)}."
    pins = [f"Pin {agent} {names[gain]}" for agent, gain in problem.pinning.gains.items()]
    yield f"Definition pins : list pin :=\n{_list(pins)}."


def _witnesses(squares: Mapping[str, tuple[Square, ...]], name: str) -> Iterable[str]:
    for number, (mode, each) in enumerate(squares.items(), start=1):
        yield _comment(f"{'-Psi' if name == 'Psi' else '-(Psi + 2 rate V)'} = L D L' in mode {mode}.")
        yield f"Definition {name}_squares_{number} : list square :=\n{_squares(each)}."
        arcs = f"arcs_{number}"
        yield (
            f"Lemma {name}_checked_{number} :"
            f" check size (fun i j => - {name} {arcs} i j) {name}_squares_{number} = true.\n"
            f"{COMPUTED}"
        )
        if name == "Psi":
            yield (
                f"Lemma derivative_checked_{number} : check_derivative size (F {arcs}) V (Psi {arcs}) = true.\n{COMPUTED}"
            )


def _pair_witnesses(P: Matrix) -> Iterable[str]:
    yield _comment("P = L D L', and Q = P W.")
    yield f"Definition P_squares : list square :=\n{_squares(_factored(SparseSymmetric.from_dense(P), 'P'))}."
    yield f"Lemma P_checked : check q P P_squares = true.\n{COMPUTED}"
    yield (
        "Lemma Q_checked :\n  all_below q (fun i => all_below m (fun j =>"
        f" Qeq_bool (Qm i j) (sum q (fun k => P i k * W k j)))) = true.\n{COMPUTED}"
    )


def _conclusions(id: str, modes: list[str], *, with_pair: bool, rate: Fraction | None) -> Iterable[str]:
    count = range(1, len(modes) + 1)
    if with_pair:
        yield _comment("P > 0, so that V > 0; and Q is P W.")
        yield "Theorem P_positive : positive_definite q P.\nProof. exact (check_positive _ _ _ P_checked). Qed."
        yield "Theorem P_positive_R : positive_definite_R q P.\nProof. exact (check_positive_R _ _ _ P_checked). Qed."
        yield (
            "Theorem Q_is_P_W : forall i j, (i < q)%nat -> (j < m)%nat -> Qm i j == sum q (fun k => P i k * W k j).\n"
            "Proof.\n  intros i j Hi Hj. apply Qeq_bool_iff.\n"
            "  exact (all_below_spec m _ (all_below_spec q _ Q_checked i Hi) j Hj).\nQed."
        )
    yield _comment("x' Psi x < 0 for every rational x other than 0, in every mode.")
    yield _theorem(id, "negative_definite size (Psi arcs)", [f"check_negative _ _ _ Psi_checked_{k}" for k in count])
    yield _comment("The same for vectors written as lists of rationals.")
    yield (
        f"Theorem {id}_lists : forall arcs, In arcs modes -> forall x : list Q,\n"
        "  length x = size -> Exists (fun a => ~ a == 0) x -> form size (Psi arcs) (fun i => nth i x 0) < 0.\n"
        f"Proof. intros arcs H. exact (negative_lists size _ ({id} arcs H)). Qed."
    )
    yield _comment("The same for every real x other than 0.")
    steps = [f"check_negative_R _ _ _ Psi_checked_{k}" for k in count]
    yield _theorem(f"{id}_R", "negative_definite_R size (Psi arcs)", steps)
    yield _comment(
        "Why Psi matters: Psi = F' V + V F, so along the linearised closed loop z' = F z the derivative of z' V z is"
        " negative for every z other than 0."
    )
    steps = [f"derivative_negative_R _ _ _ _ derivative_checked_{k} (check_negative_R _ _ _ Psi_checked_{k})" for k in count]
    yield _theorem("V_decreases", "negative_definite_R size (derivative arcs)", steps)
    if rate is not None:
        yield _comment("Psi + 2 rate V < 0: the derivative of V is below -2 rate V.")
        steps = [f"check_negative_R _ _ _ Psi_rate_checked_{k}" for k in count]
        yield _theorem("rate_holds", "negative_definite_R size (Psi_rate arcs)", steps)
    yield _comment(
        "What the proofs assume: the rational one nothing; the real one the axioms of the library's real numbers."
    )
    yield f"Print Assumptions {id}.\nPrint Assumptions V_decreases."


def _theorem(name: str, claim: str, steps: list[str]) -> str:
    """A statement about every mode, proved mode by mode."""
    proof = "".join(f"  apply Forall_cons; [exact ({step})|].\n" for step in steps)
    return (
        f"Theorem {name} : forall arcs, In arcs modes -> {claim}.\n"
        f"Proof.\n  apply Forall_forall. unfold modes.\n{proof}  apply Forall_nil.\nQed."
    )


def _section(title: str) -> str:
    return "\n(* ---- " + title.ljust(88) + " ---- *)\n"


def _comment(*paragraphs: str) -> str:
    lines = [line for text in paragraphs for line in textwrap.wrap(_harmless(text), WIDTH - 6) or [""]]
    return "\n" + "(* " + "\n   ".join(lines) + " *)"


def _harmless(text: str) -> str:
    """Text that can neither end a comment nor open another, or a string in it; printable ASCII only."""
    text = text.replace('"', "'").replace("(*", "( *").replace("*)", "* )")
    return text.encode("ascii", "backslashreplace").decode("ascii")


def _number(x: Fraction) -> str:
    if x.denominator == 1:
        return str(x.numerator) if x >= 0 else f"({x.numerator})"
    return f"({x.numerator} # {x.denominator})"


def _matrix(M: Matrix) -> str:
    return "matrix [" + "; ".join("[" + "; ".join(_number(x) for x in row) + "]" for row in M) + "]"


def _list(items: Iterable[str]) -> str:
    text = "; ".join(items)
    lines = textwrap.wrap(text, WIDTH - 4, break_long_words=False, break_on_hyphens=False)
    return "  [" + "\n   ".join(lines) + "]"


def _squares(squares: Iterable[Square]) -> str:
    items = []
    for each in squares:
        terms = [f"Term {i} {_number(x)}" for i, x in each.others.items()]
        inner = "[]" if not terms else "\n  " + _list(terms)
        items.append(f"Square {_number(each.weight)} {each.pivot} {inner}")
    return "  [" + ";\n   ".join(items) + "]"
