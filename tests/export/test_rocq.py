"""The Coq file: its numbers are the problem's, its LDL' is Psi, and Coq accepts it and nothing near
it."""

import re
import shutil
import subprocess
from dataclasses import replace
from fractions import Fraction
from functools import cache

import pytest
from campaigns.certificates import a_problem
from certified import consensus_claims, without_region
from hypothesis import given, settings
from hypothesis import strategies as st
from rocq_files import bare

from dobc_design import Certificate, Exosystem, Network, Problem, Verdict, certify, load_problem
from dobc_design.conditions.consensus.claim import state_theorems
from dobc_design.errors import SpecError
from dobc_design.exact.cholesky import squares_of
from dobc_design.exact.definite import decide_positive_definite
from dobc_design.exact.matrix import scale
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.export.rocq.matrices import rocq_proof
from dobc_design.loop.make import loop_of
from dobc_design.problem.canonical import problem_sha256

BUILTINS = ("paper-fixed", "paper-switching", "clock-sync", "microgrid-ieee14", "uav-swarm")
COQC = shutil.which("coqc")
needs_coq = pytest.mark.skipif(COQC is None, reason="coqc is not installed (Debian package coq)")
EXOSYSTEM = Exosystem(A=((0, 1), (-1, 0)), C=((1, 0),))
NUMBER = r"\(?(-?\d+)(?: # (\d+))?\)?"


def certify_consensus(problem):
    """A certificate without the region, which is not exported."""
    return Certificate(problem=problem, claims=consensus_claims(problem))


@cache
def certificate_of(name):
    """Of "paper-fixed" the problem as it is, of the others without their region."""
    return certify_consensus(load_problem(name) if name == "paper-fixed" else without_region(name))


@cache
def certificate_of_a_ring():
    """That of paper-fixed with four agents: a proof with a rate of all ten keeps the kernel busy
    for long."""
    arcs = [[1, 2], [2, 3], [3, 4], [4, 1]]
    ring = Network.from_arcs(arcs, arrow="listens_to")
    return certify(load_problem("paper-fixed").replace(network=ring, gains={1: 5}))


def cycle(n=3, *, gains=2, **more):
    agents = range(1, n + 1)
    arcs = [[i, i % n + 1] for i in agents]
    network = Network.from_arcs(arcs, arrow="listens_to", agents=n)
    return Problem(network=network, gains=gains, **more)


def two_modes_of_matrix_gains():
    """No exosystem, m = 2, a coupling between components, weights, a gain that is not symmetric."""
    modes = {"one": [[1, 2], [2, 3, "1/3"], [3, 1]], "two": [[2, 1], [3, 2, "7/5"]]}
    network = Network.from_arcs(modes, arrow="listens_to", agents=3)
    gains = {1: [[9, 1], [-2, 7]], 2: 8, 3: 6}
    return Problem(
        network=network,
        coupling=["y1 + y2/2", "y2 - y1/2"],
        target=[0, 0],
        gains=gains,
        exceptions={(1, 2): ["2*y1", "3*y2"]},
    )


def rational(match):
    numerator = int(match[1])
    denominator = int(match[2] or 1)
    return Fraction(numerator, denominator)


def factors_in(text, name):
    """[(weight, pivot, {place: factor})] of a list of squares in the file."""
    after = text.split(f"Definition {name} : list square :=", 1)[1]
    body = after.split("].\n", 1)[0]
    result = []
    for part in re.sub(r"\s+", " ", body).split("Square ")[1:]:
        head = re.match(NUMBER + r" (\d+)", part)
        found = re.finditer(r"Term (\d+) " + NUMBER, part)
        terms = {int(t[1]): Fraction(int(t[2]), int(t[3] or 1)) for t in found}
        degree = int(head[3])
        result.append((rational(head), degree, terms))
    return result


def multiplied_out(factors, size):
    rows = [[Fraction(0)] * size for _ in range(size)]
    for weight, pivot, terms in factors:
        column = {pivot: Fraction(1)} | terms
        for i, x in column.items():
            for j, y in column.items():
                rows[i][j] += weight * x * y
    return rows


def matrices(certificate, rate=Fraction(0)):
    """-(Psi + 2 rate V) of every mode from the theorems, dense."""
    statements = state_theorems(loop_of(certificate.problem))
    claims = certificate.claims
    if certificate.problem.exosystem is None:
        found = [pencil.constant.shifted(2 * rate) for pencil in statements.lambdas.values()]
    else:
        pencils = statements.psi(rate=rate)
        found = [pencil.at({"P": claims.P, "Q": claims.Q}) for pencil in pencils]
    negated_rows = []
    for matrix in found:
        negated_rows.append([list(row) for row in matrix.negated().to_dense()])
    return negated_rows


def assert_ldl(text, name, expected):
    assert_factors(factors_in(text, name), expected)


def assert_factors(factors, expected):
    pivots = [pivot for _, pivot, _ in factors]
    assert sorted(pivots) == list(range(len(expected)))
    assert all(weight > 0 for weight, _, _ in factors)
    for k, (_, _, terms) in enumerate(factors):
        assert set(terms) <= set(pivots[k + 1 :])
    assert multiplied_out(factors, len(expected)) == expected


@pytest.mark.parametrize("name", BUILTINS)
def test_l_d_l_transposed_is_minus_psi_of_every_mode(name):
    """(18), (28): the file's own numbers, multiplied out here."""
    certificate = certificate_of(name)
    text = rocq_proof(certificate)
    for place, expected in enumerate(matrices(certificate), start=1):
        assert_ldl(text, f"Psi_squares_{place}", expected)
    P = [list(row) for row in certificate.claims.P]
    assert_ldl(text, "P_squares", P)


@pytest.mark.parametrize("name", ["paper-fixed", "clock-sync"])
def test_with_a_rate_the_shifted_matrix_is_factored_too(name):
    certificate = certificate_of(name)
    text = rocq_proof(certificate, rate=True)
    claimed = Fraction(repr(certificate.check("theorem1").rate))
    assert_ldl(text, "Psi_rate_squares_1", matrices(certificate, claimed)[0])
    assert f"Definition rate : Q := ({claimed.numerator} # {claimed.denominator})." in text
    assert "Theorem rate_holds" in text


def test_without_a_disturbance_it_is_lemma_1_in_every_mode():
    certificate = certify_consensus(two_modes_of_matrix_gains())
    text = rocq_proof(certificate, rate=True)
    rate = min(Fraction(repr(check.rate)) for check in certificate.checks if check.id == "lemma1")
    for place in (1, 2):
        assert_ldl(text, f"Psi_squares_{place}", matrices(certificate)[place - 1])
        assert_ldl(text, f"Psi_rate_squares_{place}", matrices(certificate, rate)[place - 1])
    assert "Theorem lemma1_R" in text
    assert "Omega0" not in bare(text)
    # that arc has a coupling of its own
    assert "[[(1 # 3); (1 # 6)]; [(-1 # 6); (1 # 3)]]" not in text
    assert "matrix [[(2 # 3); 0]; [0; 1]]" in text
    assert "matrix [[9; 1]; [(-2); 7]]" in text


def test_the_problem_stands_in_the_file_number_by_number():
    """Example 1: n, m, q, arcs, pins, h'(0) = 2, A, C, W, P and Q."""
    text = rocq_proof(certificate_of("paper-fixed"))
    assert problem_sha256(certificate_of("paper-fixed").problem) in text
    code = re.sub(r"\s+", " ", bare(text))
    for line in (
        "Definition n : nat := 10.",
        "Definition m : nat := 1.",
        "Definition q : nat := 2.",
        "Definition slope_1 := matrix [[2]].",
        "Definition A := matrix [[0; 2]; [(-2); 0]].",
        "Definition C := matrix [[1; 0]].",
        "Definition W := matrix [[(16 # 5)]; [(12 # 5)]].",
        "[Pin 0 gain_1; Pin 5 gain_1]",
        "Definition gain_1 := matrix [[5]].",
        "Theorem theorem1 : forall arcs, In arcs modes -> negative_definite size (Psi arcs).",
        "Theorem theorem1_R : forall arcs, In arcs modes -> negative_definite_R size (Psi arcs).",
    ):
        assert line in code
    found = re.findall(r"Arc (\d+) (\d+) slope_1", code)
    arcs = [tuple(map(int, arc)) for arc in found]
    assert arcs == [(i, (i + 1) % 10) for i in range(10)]
    P = certificate_of("paper-fixed").claims.P
    entries = [f"({x.numerator} # {x.denominator})" for row in P for x in row]
    assert "Definition P := matrix [[{}; {}]; [{}; {}]].".format(*entries) in code
    assert "Axiom" not in code
    assert "Admitted" not in code
    assert "Parameter" not in code


def test_every_mode_is_in_the_list_of_modes_and_the_text_is_always_the_same():
    code = bare(rocq_proof(certificate_of("paper-switching")))
    assert "Definition modes : list (list arc) := [arcs_1; arcs_2; arcs_3; arcs_4]." in code
    assert code.count("check_negative _ _ _ Psi_checked_") == 4
    assert len(re.findall(r"Arc \d+ \d+", code)) == 10 + 20 + 20 + 30
    problem = cycle(exosystem=EXOSYSTEM, coupling="y")
    assert rocq_proof(certify(problem)) == rocq_proof(certify_consensus(problem))


def nasty(text):
    notes = [text, "*" + text + "("]
    return cycle(exosystem=EXOSYSTEM, coupling="(y)*(y)/1000+y", name=text, notes=notes)


@cache
def code_named(text):
    return bare(rocq_proof(certify_consensus(nasty(text))))


@pytest.mark.parametrize(
    "text", ['*) Axiom bad : False. (* "', "(*", "*)", "(*)", "**))((**", "λ → é", "x)"]
)
def test_names_and_notes_cannot_leave_their_comments(text):
    assert code_named(text) == code_named("harmless")
    assert code_named(text).isascii()


def test_an_irrational_slope_is_refused():
    certificate = certify_consensus(cycle(exosystem=EXOSYSTEM, coupling="sin(pi*y)"))
    assert certificate.verdict is Verdict.PROVED
    with pytest.raises(
        SpecError, match=r'coupling "sin\(pi\*y\)": its slope .* must be a rational number'
    ):
        rocq_proof(certificate)
    # one that no arc uses does no harm
    exceptions = {}
    for i in range(3):
        exceptions[i, (i + 1) % 3] = "y"
    turning = cycle(exosystem=EXOSYSTEM, coupling="sin(pi*y)", exceptions=exceptions)
    assert rocq_proof(certify_consensus(turning))


@pytest.mark.parametrize(
    ("problem", "what"),
    [
        (cycle(exosystem=EXOSYSTEM, coupling="y", gains=None), "theorem1 is refuted"),
        # undetectable: Lemma 1 is proved, Theorem 1 is not
        (cycle(exosystem=Exosystem(A=((0,),), C=((0,),)), coupling="y"), "theorem1 is refuted"),
        (cycle(coupling="y", gains=None), r"lemma1 \(G\) is refuted"),
        (cycle(exosystem=EXOSYSTEM, coupling="clip(y, -1, 1)"), "theorem1 is undecided"),
    ],
)
def test_only_what_is_proved_is_exported(problem, what):
    with pytest.raises(SpecError, match=f"only a proved theorem can be exported; {what}"):
        rocq_proof(certify_consensus(problem))


def test_what_does_not_apply_or_is_not_claimed_is_refused():
    other = replace(certificate_of("paper-fixed"), problem=certificate_of("clock-sync").problem)
    with pytest.raises(SpecError, match="about another problem"):
        rocq_proof(other)
    certificate = certify_consensus(cycle(exosystem=EXOSYSTEM, coupling="clip(y, -1, 1)"))
    checks = tuple(replace(check, verdict=Verdict.PROVED) for check in certificate.checks)
    with pytest.raises(SpecError, match=r"cannot be exported: does not apply: .* uses clip"):
        rocq_proof(replace(certificate, claims=replace(certificate.claims, checks=checks)))
    certificate = certificate_of("paper-fixed")
    checks = tuple(replace(check, rate=None) for check in certificate.checks)
    claims = replace(certificate.claims, checks=checks)
    forged = replace(certificate, claims=claims)
    with pytest.raises(SpecError, match="claims no decay rate for theorem1"):
        rocq_proof(forged, rate=True)


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (
            lambda P, Q: {"P": scale(Fraction(1, 20), P), "Q": scale(Fraction(1, 20), Q)},
            "-Psi of mode Ga",
        ),
        (lambda P, Q: {"P": scale(-1, P), "Q": scale(-1, Q)}, "P must be"),
        (lambda P, Q: {"Q": scale(2, Q)}, "Q = P W"),
        (lambda P, Q: {"W": None}, "must hold W, P and Q"),
    ],
)
def test_matrices_that_prove_nothing_are_refused(change, what):
    certificate = certificate_of("paper-fixed")
    changes = change(certificate.claims.P, certificate.claims.Q)
    claims = replace(certificate.claims, **changes)
    with pytest.raises(SpecError, match=what):
        rocq_proof(replace(certificate, claims=claims))


def test_problems_and_fractions_that_would_keep_coq_busy_for_hours_are_refused(monkeypatch):
    with pytest.raises(SpecError, match=r"at most 150 rows.*it has 153"):
        rocq_proof(certify_consensus(cycle(51, exosystem=EXOSYSTEM, coupling="y")))
    monkeypatch.setattr("dobc_design.export.rocq.matrices.LARGEST_WORK", 10**6)
    assert rocq_proof(certify_consensus(cycle(exosystem=EXOSYSTEM, coupling="y")))
    with pytest.raises(SpecError, match="too long for Coq"):
        rocq_proof(certificate_of("paper-fixed"))


def refused_by_the_kernel(text, folder):
    """Refused where the kernel computes, not because the file cannot be read."""
    outcome = run_coq(text, folder)
    assert outcome.returncode != 0
    named = re.search(r"line (\d+)", outcome.stderr)
    number = int(named[1])
    assert "vm_cast_no_check" in text.splitlines()[number - 1]


def run_coq(text, folder):
    (folder / "proof.v").write_text(text, encoding="ascii")
    command = [COQC, "-q", "proof.v"]
    return subprocess.run(
        command,
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )


@pytest.mark.slow
@needs_coq
@pytest.mark.parametrize("name", BUILTINS[:3])  # the others keep the kernel busy longest
def test_coq_accepts_the_builtin_problems(name, tmp_path):
    """Over the rationals without any axiom."""
    outcome = run_coq(rocq_proof(certificate_of(name)), tmp_path)
    assert outcome.returncode == 0, outcome.stderr[-2000:]
    assert outcome.stdout.startswith("Closed under the global context\n")
    listed = outcome.stdout.split("Axioms:\n")[1]
    axioms = re.findall(r"^(\S+)\s*:?$", listed, flags=re.MULTILINE)
    for each in axioms:
        assert re.match(r"(ClassicalDedekindReals|FunctionalExtensionality)\.", each)


@pytest.mark.slow
@needs_coq
@pytest.mark.parametrize(
    ("problem", "rate"),
    [(two_modes_of_matrix_gains(), True), (nasty('*) Axiom bad : False. (* " λ'), False)],
    ids=["lemma1", "nasty"],
)
def test_coq_accepts_lemma_1_and_any_name(problem, rate, tmp_path):
    outcome = run_coq(rocq_proof(certify(problem), rate=rate), tmp_path)
    assert outcome.returncode == 0, outcome.stderr[-2000:]


@pytest.mark.slow
@needs_coq
def test_coq_accepts_a_rate(tmp_path):
    outcome = run_coq(rocq_proof(certificate_of_a_ring(), rate=True), tmp_path)
    assert outcome.returncode == 0, outcome.stderr[-2000:]


@pytest.mark.slow
@needs_coq
def test_coq_accepts_whatever_random_problem_is_exported(tmp_path):
    """m to 3, q to 4, several modes, exceptions, matrix gains."""
    count = 0
    for seed in range(200):
        try:
            text = rocq_proof(certify(a_problem(seed)))
        except SpecError:
            continue
        outcome = run_coq(text, tmp_path)
        assert outcome.returncode == 0, f"seed {seed}: {outcome.stderr[-2000:]}"
        count += 1
        if count == 1:  # CI has time for one
            return
    raise AssertionError("no problem was exported")


def changed(text, old, new):
    assert text.count(old) == 1, old
    return text.replace(old, new)


def bump(match):
    return f"{match[1]}{int(match[2]) + 1}{match[3]}"


MUTANTS = {
    "an entry of P": (r"(Definition P := matrix \[\[\()(\d+)( #)", bump),
    "an entry of Q": (r"(Definition Qm := matrix \[\[\()(\d+)( #)", bump),
    "an entry of W": (r"(Definition W := matrix \[\[\()(16)( #)", bump),
    "an entry of A": (r"(Definition A := matrix \[\[0; )(2)(\])", bump),
    "an entry of D": (r"(Psi_squares_1 : list square :=\s+\[Square \()(\d+)( #)", bump),
    "an entry of L": (
        r"(Psi_squares_1 : list square :=\s+\[Square [^[]*\[Term \d+ \(-)(\d+)( #)",
        bump,
    ),
    "an entry of the L of P": (
        r"(P_squares : list square :=\s+\[Square [^[]*\[Term \d+ \(-)(\d+)( #)",
        bump,
    ),
    "who is heard": (r"(Arc 3 )(4)( slope_1)", bump),
    "the slope": (r"(Definition slope_1 := matrix \[\[)(2)(\])", bump),
    "a pinning gain": (r"(Definition gain_1 := matrix \[\[)(5)(\])", bump),
    "the rate": (r"(Definition rate : Q := \()(\d+)( #)", bump),
    "the last column is missing": (
        r"(;\s+Square \(\d+ # \d+\) \d+ \[\])(\]\.\s+Lemma Psi_checked_1)()",
        r"\2",
    ),
}


#: One of each kind: a matrix, a certificate of definiteness, the graph, a number, a shape.
TRIED = ("an entry of P", "an entry of L", "who is heard", "the rate", "the last column is missing")


@needs_coq
@pytest.mark.parametrize(
    "what",
    [
        pytest.param(what, marks=pytest.mark.slow if what in TRIED else pytest.mark.evidence)
        for what in MUTANTS
    ],
)
def test_coq_rejects_the_file_when_one_number_is_another(what, tmp_path):
    rate = what == "the rate"
    text = rocq_proof(certificate_of_a_ring() if rate else certificate_of("paper-fixed"), rate=rate)
    pattern, new = MUTANTS[what]
    wrong, count = re.subn(pattern, new, text)
    assert count == 1
    refused_by_the_kernel(wrong, tmp_path)


@pytest.mark.slow
@needs_coq
def test_coq_rejects_an_indefinite_matrix_with_its_own_l_d_l(tmp_path):
    """No pins: -Psi = L D L' holds with a D that is not positive; that proves nothing."""
    text = rocq_proof(certify(cycle(2, gains=3, coupling="y")))
    first = (Fraction(8), 0, {1: Fraction(-1, 4)})
    second = (Fraction(15, 2), 1, {})
    assert factors_in(text, "Psi_squares_1") == [first, second]
    lines = changed(
        text, "Definition gain_1 := matrix [[3]].", "Definition gain_1 := matrix [[0]]."
    )
    lines = changed(lines, "Square 8 0", "Square 2 0")
    lines = changed(lines, "Term 1 (-1 # 4)", "Term 1 (-1)")
    lines = changed(lines, "Square (15 # 2) 1", "Square 0 1")
    refused_by_the_kernel(lines, tmp_path)


@st.composite
def symmetric(draw):
    size = draw(st.integers(1, 5))
    entry = st.fractions(-3, 3, max_denominator=4)
    entries = {(i, j): draw(entry) for i in range(size) for j in range(i, size)}
    lift = draw(st.integers(0, 12))
    lifted = {(i, j): x + (lift if i == j else 0) for (i, j), x in entries.items()}
    return SparseSymmetric(size, lifted)


@settings(max_examples=25)
@given(symmetric())
def test_factors_exist_exactly_for_positive_definite_matrices_and_multiply_out(M):
    squares = squares_of(M)
    assert (squares is not None) == (decide_positive_definite(M).verdict is Verdict.PROVED)
    if squares is not None:
        factors = [(each.weight, each.pivot, each.others) for each in squares]
        rows = [list(row) for row in M.to_dense()]
        assert_factors(factors, rows)


def test_a_semidefinite_matrix_or_a_zero_row_has_no_factors_and_the_empty_matrix_the_empty_sum():
    entries = {(0, 0): Fraction(1), (0, 1): Fraction(1), (1, 1): Fraction(1)}
    squares = squares_of(SparseSymmetric(2, entries))
    assert squares is None
    assert squares_of(SparseSymmetric(2, {(0, 0): Fraction(1)})) is None
    assert squares_of(SparseSymmetric(0, {})) == ()
