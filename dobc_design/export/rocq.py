"""A certificate's Theorem 1, 2 or Lemma 1 as a file that the kernel of Coq checks.

The file states the problem in rationals, builds Psi from it inside Coq, and proves x' Psi x < 0 for every
vector x other than 0, rational or real, from Psi = -L D L' multiplied out by the kernel.  It needs nothing
but Coq's standard library: ``coqc FILE.v``.  Nothing is taken from a solver, and nothing here is trusted:
a wrong number makes a file that Coq refuses.  What Coq does not see is h: the slopes h'(0) enter as numbers.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from dobc_design.certificate.certificate import Certificate
from dobc_design.conditions.consensus.claim import Jacobians, ModeJacobian
from dobc_design.conditions.kinds import KINDS
from dobc_design.exact.matrix import Matrix
from dobc_design.export import rocq_theory as theory
from dobc_design.export.rocq_claim import Factors, PairClaim, RocqClaim, read_claim
from dobc_design.export.rocq_lemmas import CHECKER, OVER_Q
from dobc_design.export.rocq_reals import OVER_R
from dobc_design.export.rocq_text import comment, matrix, number, section, square_list, wrapped_list
from dobc_design.problem.problem import Problem

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
        theory.DEFINITIONS,
        section("2. The problem, and Psi"),
        *_data(claim),
        section("3. From L D L' to definiteness: proved once, for every matrix"),
        CHECKER,
        OVER_Q,
        OVER_R,
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
    yield theory.NETWORK
    if claim.pair is None:
        yield theory.ALONE
    else:
        yield from _observer(claim.pair)
    yield theory.DERIVATIVE
    if claim.rate is not None:
        yield comment("The decay rate, in 1/s.")
        yield f"Definition rate : Q := {number(claim.rate)}."
        yield theory.RATE


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
    yield theory.OBSERVER


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
