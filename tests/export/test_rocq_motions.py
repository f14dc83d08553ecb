"""Proofs about motions: what stands in the file, what is refused, and that Coq accepts it and
nothing near it."""

import re
from collections import Counter
from dataclasses import replace
from fractions import Fraction
from functools import cache
from importlib.resources import files
from itertools import pairwise

import numpy as np
import pytest
from agents import double_integrators
from couplings import coupling_text
from rocq_files import (
    AXIOMS,
    EDITS,
    about,
    bare,
    base,
    boxed,
    certify_motions,
    claims,
    coqc,
    edited,
    forged_proof,
    forgeries,
    listens,
    missing,
    parts_2_to_4,
    problems,
    refused_in,
    separable,
    text_of,
    with_gain,
)

from dobc_design import Exosystem, Network, Problem, Verdict, certify
from dobc_design.conditions.separable.claim import Separable
from dobc_design.coupling.expression import ATOM, Piece, numpy_function, parse_expression
from dobc_design.coupling.tree import evaluate
from dobc_design.errors import SpecError
from dobc_design.export.rocq import motions
from dobc_design.export.rocq.motions import RocqAlgebra, Rows, motions_proof, real
from dobc_design.problem.groups import gains_of

NAMES = ("small", "rich", "bent", "exact")
ALL_NAMES = (*NAMES, pytest.param("turning", marks=pytest.mark.slow))
KINKED = ("abs", "min", "max", "clip")
BOX = {"initial_states": [-1, 1]}
OTHER = {(1, 0): "tanh(y)"}  # no arc has the coupling of all others
LOOSE = Network.from_arcs([[2, 1]], arrow="listens_to", agents=2, optional=[[1, 2]])
theory = (files("dobc_design.export.rocq") / "theory").iterdir()
LIBRARY = {path.name: path.read_text("utf-8") for path in theory}
LEMMA = r"^Lemma ((?:upper|lower)_\d+_\d+)_(\d+) : \w+ network v k alpha (\d+) (\d+) (.+)\.$"


def line(h="tanh(y)", **more):
    """Agent 2 hears agent 1, which is pinned."""
    chain = listens([[2, 1]], 2)
    own = {"network": chain, "coupling": h, "gains": {1: 3}, "region": BOX}
    return Problem(**own | more)


def rational(text):
    """A number of the file: 3, (- (3)), (3 / 7)."""
    sign = -1 if text.startswith("(-") else 1
    return sign * Fraction(re.sub(r"[()\s-]", "", text))


@pytest.mark.parametrize("name", ["rich", "bent"])
def test_the_same_certificate_gives_the_same_text(name):
    assert motions_proof(boxed(name)) == text_of(name)


def test_one_that_is_made_anew_with_everything_that_is_claimed_gives_the_same_text():
    assert motions_proof(certify(problems()["exact"])) == text_of("exact")


@cache
def code_named(word):
    """The file of a problem whose every name has this word, without comments."""
    labels = ["1" + word, "2" + word]
    arcs = [[labels[1], labels[0]]]
    modes = {"mode " + word: arcs}
    network = Network.from_arcs(modes, arrow="listens_to", agents=labels)
    gains = {labels[0]: 3}
    notes = [word, "*" + word + "("]
    problem = line(network=network, gains=gains, name=word, notes=notes)
    return bare(motions_proof(certify_motions(problem)))


@pytest.mark.parametrize(
    "text", ['*) Axiom bad : False. (* "', "(*", "*)", "(*)", "**))((**", "λ → é", "x)"]
)
def test_names_notes_labels_and_modes_cannot_leave_their_comments(text):
    assert code_named(text) == code_named("harmless")
    assert code_named(text).isascii()


def test_without_a_max_separable_proof_there_is_no_file():
    with pytest.raises(
        SpecError, match=r"no max-separable proof is in this certificate\. Give a \[region\]"
    ):
        motions_proof(certify_motions(line(region=None)))
    certificate = boxed("exact")
    checks = tuple(
        replace(each, verdict=Verdict.UNDECIDED) if each.id == "max-separable" else each
        for each in certificate.checks
    )
    with pytest.raises(SpecError, match="no max-separable proof"):
        motions_proof(replace(certificate, claims=replace(certificate.claims, checks=checks)))


def test_a_global_proof_is_exported_for_a_radius_of_1():
    """Linear couplings: the claim has no rho, and the file says 1 / min v."""
    certificate = certify_motions(line("y", region=None), everything=True)
    claim = separable(certificate).claim
    assert claim.rho is None
    text = motions_proof(certificate)
    assert f"converges network 1 0 (fun i => {real(1 / claim.least)} * v i)" in text
    assert "every_motion_from_these_states" not in text


@pytest.mark.parametrize(
    ("problem", "words"),
    [
        (double_integrators(), "not available yet for agents with dynamics of their own"),
        (line(network=LOOSE, gains=3), "arcs that come and go"),
        (line("max(y, 2*y)"), "not smooth as far out: it has a kink"),
        (
            line("clip(y, -9, 9)", gains=3),
            "a coupling has clip, which has no derivative everywhere",
        ),
        (
            line("y + abs(y)/2", exceptions=OTHER),
            "a coupling has abs, which has no derivative everywhere",
        ),
        (
            line("min(y, 2*y)", exceptions=OTHER),
            "a coupling has min, which has no derivative everywhere",
        ),
    ],
    ids=["dynamics", "optional", "max", "clip", "abs", "min"],
)
def test_what_the_library_does_not_know_is_refused_in_words(problem, words):
    with pytest.raises(SpecError, match=words):
        motions_proof(certify_motions(problem))


def test_a_claim_about_other_coordinates_is_refused():
    """z = T e: agents with [dynamics], and couplings that are lists."""
    scaled = ((Fraction(1),),)
    changed = claims(boxed("small"), T=scaled)
    with pytest.raises(SpecError, match="no max-separable proof is in this certificate"):
        motions_proof(changed)


def test_400_arcs_are_the_most():
    """21 agents, each hears all others: 420 arcs."""
    arcs = [[i, j] for i in range(1, 22) for j in range(1, 22) if i != j]
    problem = line(network=listens(arcs, 21), gains=2)
    with pytest.raises(SpecError, match="not made for more than 400 arcs"):
        motions_proof(certify_motions(problem))


def test_six_states_of_an_exosystem_are_the_most():
    """Whatever is claimed of its observer."""

    def proof(q):
        A, unit = ([[x if i == j else 0 for j in range(q)] for i in range(q)] for x in (-1, 1))
        C = [[1] * q]
        exosystem = Exosystem(A=A, C=C)
        certificate = about(boxed("exact"), exosystem=exosystem)
        gained = with_gain(certificate, [[1]] * q)
        return forged_proof(claims(gained, P=unit))

    assert "Theorem every_motion_converges" in proof(6)
    with pytest.raises(SpecError, match="not made for exosystems of more than 6"):
        proof(7)


def test_a_certificate_of_another_problem_is_refused():
    with pytest.raises(SpecError, match="about another problem: its hash differs"):
        motions_proof(replace(boxed("exact"), problem=boxed("small").problem))


# ---- Expressions ----


def coq_text(expression):
    atoms = [Piece("y", ATOM)]
    return evaluate(expression.node, atoms, RocqAlgebra()).text


CALLED = {name: getattr(np, name) for name in ("exp", "sin", "cos", "sqrt")} | {
    "ln": np.log,
    "atan": np.arctan,
}
JOINED = {"+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide}


def value(text, y):
    """An expression of Coq at an array y: application binds closest, then ^, then / x and - x, then
    * /, then + -."""
    tokens = re.findall(r"\d+|\w+|\S", text)

    def atom():
        token = tokens.pop(0)
        if token == "(":
            inner = total()
            assert tokens.pop(0) == ")"
            return inner
        return (
            CALLED[token](atom())
            if token in CALLED
            else (y if token == "y" else np.pi if token == "PI" else np.float64(token))
        )

    def power():
        low = atom()
        return low ** int(tokens.pop(0)) if tokens and tokens[0] == "^" and tokens.pop(0) else low

    def prefixed():
        if tokens[0] in "-/":
            return -prefixed() if tokens.pop(0) == "-" else 1 / prefixed()
        return power()

    def chain(operators, operand):
        found = operand()
        while tokens and tokens[0] in operators:
            found = JOINED[tokens.pop(0)](found, operand())
        return found

    def total():
        return chain("+-", lambda: chain("*/", prefixed))

    found = total()
    assert not tokens
    return found


@pytest.mark.parametrize("seed", range(110))
def test_an_expression_means_in_coq_what_it_means_in_numpy(seed):
    """Five of each function of the grammar."""
    expression = parse_expression(coupling_text(seed), key="h")
    if any(name in coupling_text(seed) for name in KINKED):
        with pytest.raises(SpecError, match="no derivative everywhere"):
            coq_text(expression)
        return
    y = np.linspace(-1.5, 1.5, 61)
    with np.errstate(all="ignore"):
        found = value(coq_text(expression), y)
    wanted = numpy_function(expression)(y)
    np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    "text",
    [
        "-y**2",
        "(-y)**2",
        "y - (y - y**3)",
        "2 - (1 + y/2)**-2 - exp(-y)",
        "y/(y/2 + 3)/4",
        "-(-3)**3*y",
    ],
)
def test_signs_powers_and_quotients_bind_as_in_numpy(text):
    expression_read = parse_expression(text, key="h")
    expression = expression_read
    y = np.linspace(-1, 1, 21)
    found = value(coq_text(expression), y)
    wanted = numpy_function(expression)(y)
    np.testing.assert_allclose(found, wanted, rtol=1e-12, atol=1e-12)


# ---- What stands in the file ----


@pytest.mark.parametrize("name", ALL_NAMES)
def test_every_number_of_the_problem_and_of_the_claim_stands_in_the_file(name):
    certificate = boxed(name)
    problem, check = certificate.problem, separable(certificate)
    code = re.sub(r"\s+", " ", bare(text_of(name)))

    def rows(M):
        return "matrix [" + "; ".join("[" + "; ".join(map(real, row)) + "]" for row in M) + "]"

    claim = check.claim
    entries = "; ".join(map(real, claim.v))
    wanted = [f"Definition alpha : R := {real(claim.alpha)}.", "nth i [" + entries + "] 0."]
    wanted += [f"| {i} => {rows(gain)}" for i, gain in problem.pinning.gains.items()]
    wanted += [
        f"alpha 0 0 0 {real(claim.rho)}.",
        f"(fun i => {real(claim.rho)} * v i) {real(Fraction(str(check.rate)))}.",
    ]
    wanted += [f"converges network {real(Fraction(str(check.domain.radius)))} "]
    wanted += [f"nth c [{'; '.join(map(real, problem.target))}] 0."]
    wanted += [
        f"| {i} => fun c => nth c [{'; '.join(map(real, x))}] 0" for i, x in problem.offsets.items()
    ]
    above = 0
    if claim.error is not None:
        wanted += [
            f"Definition {each} : R := {real(getattr(claim.error, each))}."
            for each in ("kappa", "beta", "size")
        ]
        gains = gains_of(problem.groups, certificate.claims.W)
        for group, gain in zip(problem.groups, gains, strict=True):
            q = len(gain)
            error_rows = claim.error.P[above : above + q]
            P = [row[above : above + q] for row in error_rows]
            matrices = (group.exosystem.A, group.exosystem.C, gain, P)
            wanted += map(rows, matrices)
            above += q
    assert [each for each in wanted if each not in code] == []
    modes = problem.network.modes.values()
    weights = Counter(Fraction(w) for arcs in modes for _, _, w in arcs)
    listed = Counter(
        rational(found[1] or "1")
        for found in re.finditer(r"Arc \d+ \d+ (?:\(fun y => (.+?) \* )?h\d", code)
    )
    assert listed == weights


@pytest.mark.parametrize("name", ALL_NAMES)
def test_the_pieces_of_a_row_cover_0_to_rho_without_gaps(name):
    """Every mode, agent and face; the row is joined of all of them in their order."""
    certificate = boxed(name)
    text = text_of(name)
    rho = separable(certificate).claim.rho
    ends = {}
    for row, k, _, _, numbers in re.findall(LEMMA, text, flags=re.MULTILINE):
        low, high = map(rational, re.findall(r"\([^()]*\)|\d+", numbers))
        assert ends.get(row, 0) == low < high
        assert len(re.findall(rf"exact {row}_{k}\b", text)) == 1
        ends[row] = high
    problem = certificate.problem
    assert len(ends) == 2 * problem.n * len(problem.network.modes)
    assert set(ends.values()) == {rho}


def test_a_row_with_less_room_has_more_pieces_until_there_is_too_little(monkeypatch):
    """Agent 2 hears agent 1 by a sine, at most 0.978 for y in [-2 s, 0] at s = 9/4, which asks for
    a room of 0.435."""
    monkeypatch.setattr(motions, "MOST_PARTS", 6)

    def pieces(room):
        ones = (Fraction(1), Fraction(1))
        claim = Separable(v=ones, alpha=3 - room, rho=Fraction(9, 4))
        of_the_line = line("sin(y)", gains=3)
        rows = [row for row in Rows(of_the_line, claim, claim.rho).all() if row.agent == 1]
        for row in rows:
            ends = [(part.low, part.high) for part in row.parts]
            last = ends[-1][1]
            assert ends[0][0] == 0
            assert last == claim.rho
            for before, after in pairwise(ends):
                assert before[1] == after[0]
        return [len(row.parts) for row in rows]

    coarse = pieces(Fraction(9, 4))
    fine = pieces(Fraction(1, 2))
    wide, narrow = coarse, fine
    assert 1 < wide[0] == wide[1] < narrow[0] == narrow[1]
    with pytest.raises(SpecError, match="the row of agent 2 in mode G has too little room for Coq"):
        pieces(Fraction("0.43"))


def test_the_examples_have_every_kind_of_fact_about_an_arc():
    texts = "".join(map(text_of, NAMES))
    for fact in (
        r"apply h\d+m?_rises",
        r"apply \(rising (?:h|\(mirrored)",
        r"apply \(falling",
        r"destruct \(Rle_dec y",
        r"cbn \[who factor law most\]\.\n[^}]*?\n      assert \(B : \S",
    ):
        assert re.search(fact, texts), fact


# ---- The library ----


def test_the_library_assumes_nothing():
    for name, text in LIBRARY.items():
        words = re.findall(
            r"\b(?:Admitted|Axioms?|Parameters?|Conjecture|Hypothes[ie]s|admit|give_up|Abort)\b",
            bare(text),
        )
        assert not words, name
        assert text.isascii()
        proofs = bare(text).count("Proof")
        closed = bare(text).count("Qed.") + bare(text).count("Defined.")
        assert proofs == closed, name
    names = ("Statement", "Comparison", "Consensus", "Rows", "Weighted")
    assert set(LIBRARY) == {f"{name}.v" for name in names}


def test_the_library_stands_whole_in_every_file():
    """But for the lines by which its files find one another."""
    text = text_of("small")
    for name in ("Statement", "Comparison", "Consensus", "Rows"):
        for line in LIBRARY[f"{name}.v"].splitlines():
            assert line in text or line.startswith(("Require", "From", "Import", "Open Scope"))


# ---- Coq ----


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder in which part 1 is compiled."""
    if reason := missing():
        pytest.skip(reason)
    return base(tmp_path_factory.mktemp("rocq"))


def assert_accepted(ran):
    assert ran.code == 0, ran.err[-2000:]
    assert ran.axioms
    assert all(re.fullmatch(AXIOMS, each) for each in ran.axioms), ran.axioms


@pytest.mark.slow
def test_coq_accepts_a_whole_file_on_the_axioms_of_its_real_numbers(folder):
    """Two modes, arcs that rise, fall, have a peak and are bounded, no exosystem."""
    assert_accepted(coqc(folder, "whole", text_of("turning")))


@pytest.mark.evidence
def test_coq_accepts_groups_two_components_matrix_gains_a_formation_and_weights(folder):
    text = parts_2_to_4(text_of("rich"), assumptions=True)
    assert_accepted(coqc(folder, "rich", text))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["small", "exact"])
def test_coq_accepts_a_nonlinear_network_with_an_exosystem(name, folder):
    """With a bound on the estimation error, and with estimates that start exact."""
    ran = coqc(folder, name, parts_2_to_4(text_of(name)))
    assert ran.code == 0, ran.err[-2000:]


@pytest.mark.slow
@pytest.mark.parametrize(
    "what", ["alpha: twice", "v_1: twice", "pin 2: none", "arc 3 to 2: removed"]
)
def test_coq_refuses_the_row_that_a_changed_claim_makes_false(what, folder):
    forged = forgeries()[what](boxed("small"))
    text = parts_2_to_4(forged_proof(forged))
    ran = coqc(folder, "changed", text)
    assert ran.code != 0
    assert re.match(r"(upper|lower)_\d_\d", refused_in(ran, text))


def test_the_twin_that_is_not_changed_is_the_file_itself():
    assert forged_proof(boxed("small")) == text_of("small")
    for each in EDITS.values():
        assert edited(parts_2_to_4(text_of("small")), *each)


@pytest.mark.slow
def test_the_library_compiles_and_weighted_theorem_1_has_the_same_axioms(folder):
    weighted = None
    for name in ("Statement", "Comparison", "Consensus", "Weighted", "Rows"):
        shown = [
            "m_matrix_vector",
            "weighted_theorem_1",
            "weighted_errors_decay",
            "linear_loop",
            "linear_loop_decays",
        ]
        more = "".join(f"Print Assumptions {each}.\n" for each in shown * (name == "Weighted"))
        ran = coqc(folder, name, LIBRARY[f"{name}.v"] + more, "-Q", ".", "Dobc")
        assert ran.code == 0, f"{name}: {ran.err[-2000:]}"
        weighted = ran if name == "Weighted" else weighted
    assert_accepted(weighted)
    open_ones = weighted.out.count("Axioms:")
    closed_ones = weighted.out.count("Closed under the global context")
    assert open_ones + closed_ones == len(shown)
