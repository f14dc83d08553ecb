"""``certify`` writes what the second checker confirms: known defects by their problems, and
programs that disagree."""

import json
import random
from dataclasses import replace
from fractions import Fraction
from functools import partial
from itertools import product
from types import SimpleNamespace

import pytest
from certified import certified, consensus_claims
from networks import linked

import dobc_design.certification.recheck as rechecks
from dobc_design import Exosystem, Verdict, certify, verify
from dobc_design.certificate.text import certificate_bytes
from dobc_design.certification.equilibria import equilibrium_check
from dobc_design.certification.overall import decide_overall
from dobc_design.checker.examine import Refused, examine
from dobc_design.checker.verdict import leaves_free
from dobc_design.conditions.check import Values, Witness
from dobc_design.errors import CertificateError
from dobc_design.exact.matrix import find_in_nullspace
from dobc_design.loop.make import loop_of
from dobc_design.problem.canonical import canonical_bytes

PROVED, REFUTED, UNDECIDED = Verdict.PROVED, Verdict.REFUTED, Verdict.UNDECIDED
CONSTANT = Exosystem(A=[[0]], C=[[1]])
LIST, ONE = ["tanh(y1)", "tanh(y2)"], "tanh(y)"


def matrix_gains(third=(1, 2)):
    """Agent 1 listens to nobody; its gain leaves (0, y, z) free, and gains of both need not leave a
    basis vector."""
    sides = [[-1, 1], [1, 2], list(third)]
    of_the_first = [[1, 0, 0], [0, 1, -1], [0, -1, 1]]
    of_the_second = [[1, 0, 0], [0, 0, 0], [0, 0, 0]]
    gains = {1: of_the_first, 2: of_the_second}
    arcs = [[2, 1]]
    target = [0, 0, 0]
    return linked(arcs, gains=gains, target=target, region={"initial_states": sides})


def box(h, half, arcs=((2, 1),), **more):
    region = {"initial_states": [f"-{half}", half]}
    return linked(arcs, 2, coupling=h, region=region, **more)


def chain(*weights):
    arcs = []
    for i, weight in enumerate(weights):
        arcs.append([i + 2, i + 1, weight])
    gains = {1: "0.1" if len(weights) == 1 else 1}
    return linked(arcs, gains=gains)


#: Problems with known defects, and what is decided of each.
ROOT = "sqrt(1+y) - 1"
WIGGLE = "2*y + sin(3*y)"
WIDE = [[2, 1], [1, 2, "1.1"]]
TWO = [[2, 1, 2]]
DEAD = "max(y - 0.1, 0) + min(y + 0.1, 0)"
CASES = {
    "closed set, basis test": (matrix_gains(), REFUTED),
    "closed set, just missed": (matrix_gains(third=(3, 4)), UNDECIDED),
    "sqrt": (box(ROOT, "0.6", gains={1: 2}), UNDECIDED),
    "sqrt, inside": (box(ROOT, "0.4", gains={1: 2}), PROVED),
    "log": (box("log(1+y)", "0.4", gains={1: 2}), PROVED),
    "wiggle": (box(WIGGLE, 2, gains={1: "2.4"}), PROVED),
    "wiggle, wide": (box(WIGGLE, 8, WIDE, gains={1: "2.4"}), PROVED),
    "sine, wide": (box("sin(y)", "1.6", gains={1: "0.15", 2: "0.15"}), PROVED),
    "list": (box(LIST, 3, gains={1: 1}, target=[0, 0]), PROVED),
    "chain": (chain("2.8", "0.5", "2.9", "0.4"), PROVED),
    "chain of two": (linked(TWO, gains={1: "0.1"}), PROVED),
    "chain of two, disturbed": (linked(TWO, gains={1: "0.1"}, exosystem=CONSTANT), PROVED),
    "chain of two, held by nobody": (linked(TWO, gains={2: "0.1"}), REFUTED),
    "max(y, 0)": (box("max(y, 0)", "0.8", gains={1: 2}), REFUTED),
    "max(y, 0), held": (box("max(y, 0)", "0.8", gains={1: 2, 2: 2}), PROVED),
    "dead zone": (box(DEAD, "0.8", gains={1: 2}), REFUTED),
    "0*y": (box("0*y", 1, gains={1: 1}), REFUTED),
}


SLOW = ("sqrt", "sqrt, inside", "wiggle", "wiggle, wide", "max(y, 0)", "dead zone")
#: The rule about sets that hear nobody else decides these; nothing of a region is searched for.
AT_ONCE = ("closed set, basis test", "closed set, just missed")
NAMES = []
for case in CASES:
    marks = [pytest.mark.slow] if case in SLOW else []
    NAMES.append(pytest.param(case, marks=marks))


@pytest.mark.parametrize("name", NAMES)
def test_known_defects_end_as_they_should_and_both_programs_accept(name: str):
    problem, wanted = CASES[name]
    claims = consensus_claims(problem) if name in AT_ONCE else certified(problem).claims
    assert claims.verdict is wanted
    assert verify(claims, problem).failures == ()
    assert rechecks.agreed(claims, problem) == claims
    # |e_i| <= 1/2 compares the agents as far apart as sqrt(1 + y) has values
    if name == "sqrt":
        assert certified(problem).check("max-separable").domain.radius > 0.4


def test_a_list_of_one_function_is_that_function():
    made = partial(box, half=3, gains={1: 1}, target=[0, 0])
    assert canonical_bytes(made(LIST)) == canonical_bytes(made(ONE))
    exchanged = ["tanh(y2)", "tanh(y1)"]
    different = ["tanh(y1)", "2*y2"]
    seeming = ["tanh(y1) + 0*y2", "tanh(y2)"]
    for other in (exchanged, different, seeming):
        assert not made(other).coupling.by_component


@pytest.mark.slow
def test_one_sided_couplings_get_no_advice_that_cannot_help():
    """e2' = (e1 - e2)^2 leaves from every e2 > 0, so that a smaller region is no help."""
    certificate = certify(box("y**2", "0.8", gains={1: 2}))
    assert certificate.verdict is UNDECIDED
    assert "smaller" not in certificate.claims.reason


# --- the linear program of verdict 2(a)
# -------------------------------------------------------------------------------
def free_shift_by_checker(M, sides) -> bool:
    zero = Fraction(0)
    hold = {0: [list(row) for row in M]}
    goals = [[zero] * len(sides)]
    leads = [(zero, zero)] * len(sides)
    loop = SimpleNamespace(
        m=len(sides),
        hold=hold,
        goals=goals,
        exact_region=SimpleNamespace(initial_states=sides),
        leads=leads,
    )
    return leaves_free(loop, {0})


def is_met_for_scipy(M, sides) -> bool:
    """Whether a point of the box other than 0 lies in the nullspace."""
    from scipy.optimize import linprog

    if any(lo > hi for lo, hi in sides):
        return False
    for k, sign in product(range(len(sides)), (1, -1)):
        cost = []
        for j in range(len(sides)):
            cost.append(-sign * (j == k))
        A = [[float(x) for x in row] for row in M] or None
        bounds = [(float(lo), float(hi)) for lo, hi in sides]
        answer = linprog(cost, A_eq=A, b_eq=A and [0] * len(A), bounds=bounds)
        if answer.status == 0 and -answer.fun > 1e-7:
            return True
    return False


@pytest.mark.parametrize("seed", range(2))
def test_a_box_meets_a_nullspace_iff_a_linear_program_says_so(seed: int):
    r = random.Random(seed)
    found = {True: 0, False: 0}
    for _ in range(30):
        m = r.randint(1, 5)
        rows = []
        for _ in range(r.randint(0, m)):
            row = [r.choice((0, 0, 0, 1, -1, 2, -3)) for _ in range(m)]
            rows.append(tuple(map(Fraction, row)))
        M = tuple(rows)
        sides = []
        for _ in range(m):
            lo = r.randint(-3, 2)
            mostly_up = (0, 0, 1, 1, 2, 3) * 5
            widths = (-1, *mostly_up)
            own = (lo, lo + r.choice(widths))
            sides_drawn = (own, (0, 2), (-2, 0), (0, 0), (-1, 1))
            side = r.choice(sides_drawn)
            sides.append(tuple(map(Fraction, side)))
        v = find_in_nullspace(M, sides)
        if v is not None:
            assert any(v)
            for x, (lo, hi) in zip(v, sides, strict=True):
                assert lo <= x <= hi
            for row in M:
                products = zip(row, v, strict=True)
                assert sum(a * x for a, x in products) == 0
        meets = v is not None
        assert meets is is_met_for_scipy(M, sides)
        assert meets is free_shift_by_checker(M, sides)
        found[meets] += 1
    assert min(found.values()) > 5


def test_a_box_with_an_empty_side_meets_nothing():
    whole = (Fraction(-1), Fraction(1))
    empty = (Fraction(1), Fraction(0))
    for M in ((), ((Fraction(0), Fraction(0)),)):
        for other, meets in ((whole, True), (empty, False)):
            sides = [whole, other]
            assert (find_in_nullspace(M, sides) is not None) is meets
            assert free_shift_by_checker(M, sides) is meets


# --- disagreement
# --------------------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def disturbed():
    region = {"initial_states": [-1, 1], "initial_disturbance": "1/10"}
    arcs = [[2, 1]]
    problem = linked(arcs, coupling="tanh(y)", gains=2, exosystem=CONSTANT, region=region)
    return problem, certify(problem).claims


WITHDRAWN = ["max-separable", "delay", "lemma1", "theorem1", "hurwitz", "overall"]


@pytest.mark.parametrize("which", WITHDRAWN)
def test_what_the_second_program_refuses_is_not_written(
    which: str, disturbed, monkeypatch: pytest.MonkeyPatch
):
    """The same program, but it refuses whatever is proved under this name."""
    problem, honest = disturbed

    def refuses(data: bytes, document: bytes, **_: float):
        said = []
        for holds, text in examine(data, document):
            is_meant = text.startswith(which) and "proved" in text
            said.append((holds and not is_meant, text))
        return said

    monkeypatch.setattr(rechecks.checker, "examine", refuses)
    claims = rechecks.agreed(honest, problem)
    if which == "overall":
        assert honest.verdict is PROVED
        assert claims.verdict is UNDECIDED
        assert claims.covered_by is None
        assert "second checker" in claims.reason
        return
    withdrawn = []
    for new, old in zip(claims.checks, honest.checks, strict=True):
        if new != old:
            withdrawn.append(new)
    assert which in [check.id for check in withdrawn]
    assert (claims.P is None) is (which == "theorem1")
    for check in withdrawn:
        assert check.verdict is UNDECIDED
        assert "second checker" in check.reason
    assert claims.verdict is (UNDECIDED if which == "max-separable" else PROVED)
    monkeypatch.undo()  # what is left is a certificate like any other
    assert verify(certificate_bytes(claims), problem).failures == ()


@pytest.mark.parametrize("said", ["the row of agent 1 is not shown", "it is refuted here"])
def test_a_limit_of_the_second_program_is_told_from_a_contradiction(
    said: str, monkeypatch: pytest.MonkeyPatch
):
    problem, _ = CASES["list"]
    claims = certified(problem).claims
    count = len(claims.checks)
    believed = [(True, said)] * 3
    refused = [(False, said)] * (1 + count)
    findings = believed + refused
    monkeypatch.setattr(rechecks.checker, "examine", lambda *_, **__: findings)
    contradicts = said == "it is refuted here"
    for check in rechecks.agreed(claims, problem).checks:
        assert said in check.reason
        assert ("please report it" in check.reason) is contradicts


def test_a_problem_that_the_second_program_cannot_read_has_no_proof(
    monkeypatch: pytest.MonkeyPatch,
):
    def refuses(data: bytes, document: bytes, **_: float):
        raise Refused("too deep")

    monkeypatch.setattr(rechecks.checker, "examine", refuses)
    certificate = certify(chain("2"))
    assert certificate.verdict is UNDECIDED
    assert {check.verdict for check in certificate.checks} == {UNDECIDED}


# --- points and malformed claims
# --------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def stuck():
    problem, _ = CASES["max(y, 0)"]
    claims = consensus_claims(problem)
    check = equilibrium_check(problem)
    assert check is not None
    checks = (*claims.checks, check)
    overall = decide_overall(loop_of(problem), checks, claims.W)
    return problem, replace(claims, checks=checks, verdict=overall.verdict, why=overall.why)


POINTS = [("0", "1/2"), ("0", "-1/2"), ("1/100", "1/2"), ("0", "0"), ("0", "9/10")]


@pytest.mark.parametrize("point", POINTS)
def test_a_point_is_confirmed_iff_it_is_an_equilibrium_in_the_region(point: tuple[str, str], stuck):
    """max(y, 0) with one pin: exactly e1 = 0 <= e2 <= 0.8, but not the target."""
    problem, claims = stuck
    *others, old = claims.checks
    assert old.id == "equilibrium"
    bent_claim = {"mode": "G", "box": [[x, x] for x in point]}
    bent = Values(bent_claim)
    witness = Witness(kind="start", values=point)
    check = replace(old, claim=bent, witness=witness)
    data = certificate_bytes(replace(claims, checks=(*others, check)))
    true = point == ("0", "1/2")
    assert rechecks.recheck(data, problem).holds is true
    assert all(holds for holds, _ in examine(data, canonical_bytes(problem))) is true


@pytest.fixture(scope="module")
def made() -> bytes:
    return certificate_bytes(certified(CASES["list"][0]).claims)


#: Places of a certificate, and what cannot stand there.
MALFORMED = [
    (("checks", 0, "id"), "nobody"),
    (("checks", 0, "verdict"), "nobody"),
    (("checks", 0, "domain"), {"kind": "box", "radius": 1}),
    (("checks", 0, "domain"), {"kind": None, "radius": 1}),
]
for field, other in product(("verdict", "checks", "rate", "observer"), (None, "x", 3)):
    MALFORMED.append(((field,), other))
MALFORMED.append((("observer", "P"), []))
MALFORMED.append((("program", "name"), None))


@pytest.mark.parametrize(("path", "value"), MALFORMED)
def test_malformed_claims_have_the_exit_code_of_the_second_program(path, value, made: bytes):
    problem, _ = CASES["list"]
    document = json.loads(made)
    place = document
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    data = json.dumps(document).encode()
    try:
        findings = examine(data, canonical_bytes(problem))
        all_hold = all(holds for holds, _ in findings)
        code = 0 if all_hold else 1
    except Refused:
        code = 2
    assert code
    if code == 1:
        assert not verify(data, problem).holds
    else:
        with pytest.raises(CertificateError, match="read"):
            verify(data, problem)
