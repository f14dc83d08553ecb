"""Signed graphs: agents that oppose others, by proofs that both programs accept (theory, sections
14 and 16)."""

from __future__ import annotations

import hashlib
import json
from itertools import product
from typing import Any

import numpy as np
import pytest
from certified import few_chords, only, rough_settling
from published import curved_ring

import dobc_design as dd
from dobc_design.certificate.text import certificate_bytes
from dobc_design.checker.examine import Refused, examine
from dobc_design.conditions.quadratic.stage import quadratic_stage
from dobc_design.conditions.separable.stage import separable_stage
from dobc_design.errors import SpecError
from dobc_design.problem.canonical import (
    canonical_bytes,
    canonical_document,
    problem_from_canonical,
)
from dobc_design.problem.changes import problem_text
from dobc_design.problem.load import read_problem_text
from dobc_design.verdict import Verdict

Array = np.ndarray[Any, Any]
#: Two pairs that do not hear each other, each with one sign -1: they converge, and the double cover
#: has no root.
PAIRS = [[1, 2, 1], [2, 1, -1], [3, 4, 1], [4, 3, -1]]


def signed(arcs: list[Any], n: int, **more: Any) -> dd.Problem:
    """A problem with h = y unless another one is given."""
    network = dd.Network.from_arcs(arcs, arrow="listens_to", agents=n, negative="opposes")
    return dd.Problem(**{"network": network, "coupling": "y", **more})


def laplacian(arcs: list[Any], n: int) -> Array:
    """The signed Laplacian (Altafini 2013): sum of |w| on the diagonal, -w beside it."""
    L = np.zeros((n, n))
    for listener, speaker, weight in arcs:
        L[listener - 1, listener - 1] += abs(weight)
        L[listener - 1, speaker - 1] -= weight
    return L


def rate_of(M: Array) -> float:
    """The least real part of an eigenvalue."""
    return float(np.linalg.eigvals(M).real.min())


def random_arcs(rng: np.random.Generator, n: int) -> list[Any]:
    arcs = []
    for i, j in product(range(1, n + 1), repeat=2):
        if i != j and rng.random() < 0.4:
            arcs.append([i, j, int(rng.integers(1, 4)) * (-1 if rng.random() < 0.4 else 1)])
    return arcs or [[1, 2, 1]]


def balanced_sets(arcs: list[Any], n: int) -> list[set[int]]:
    """All sets that hear nobody outside and have two sides, by trying every set and side."""
    found = []
    for mask in range(1, 2**n):
        members = [i + 1 for i in range(n) if mask >> i & 1]
        inner = [(i, j, w) for i, j, w in arcs if i in members]
        if any(j not in members for _, j, _ in inner):
            continue
        for sides in product((1, -1), repeat=len(members)):
            side = dict(zip(members, sides, strict=True))
            if all(side[i] * side[j] * w > 0 for i, j, w in inner):
                found.append(set(members))
                break
    return found


def holds_for_both(certificate: dd.Certificate, problem: dd.Problem) -> bool:
    return dd.verify(certificate, problem).holds


def test_the_directed_three_cycle_with_one_sign_and_no_pin_has_the_rate_one_half():
    """(x - 2)(x^2 - x + 1)."""
    arcs = [[1, 2, 1], [2, 3, 1], [3, 1, -1]]
    problem = signed(arcs, 3)
    certificate = dd.certify(problem)
    assert certificate.verdict is Verdict.PROVED
    assert certificate.rate == pytest.approx(0.5, abs=1e-6)
    assert holds_for_both(certificate, problem)
    assert np.poly(laplacian(arcs, 3)) == pytest.approx([1, -3, 3, -2])
    # Two signs balance: x = (1, 1, -1) rests.
    twin = signed([[1, 2, 1], [2, 3, -1], [3, 1, -1]], 3)
    refuted = dd.certify(twin)
    assert refuted.verdict is Verdict.REFUTED
    assert holds_for_both(refuted, twin)


def test_two_pairs_with_one_sign_each_converge_though_nobody_is_heard_by_all():
    problem = signed(PAIRS, 4)
    certificate = dd.certify(problem)
    assert certificate.verdict is Verdict.PROVED
    assert certificate.rate == pytest.approx(1, abs=1e-6)
    assert holds_for_both(certificate, problem)
    twin = signed([*PAIRS[:3], [4, 3, 1]], 4)
    refuted = dd.certify(twin)
    assert refuted.verdict is Verdict.REFUTED
    (reached,) = (each for each in refuted.checks if each.id == "reachability")
    assert reached.witness is not None
    assert list(reached.witness.labels) == ["3", "4"]
    assert holds_for_both(refuted, twin)


@pytest.mark.parametrize(
    "seed", [0, 1, 2, *(pytest.param(seed, marks=pytest.mark.evidence) for seed in (3, 4, 5))]
)
def test_agents_meet_at_zero_iff_every_closed_set_whose_signs_balance_has_a_pin(seed: int):
    """Ten random graphs each, half of them with a pin; the local rate is that of the signed
    Laplacian."""
    rng = np.random.default_rng(seed)
    for k in range(10):
        n = int(rng.integers(2, 6))
        arcs = random_arcs(rng, n)
        if seed == 0 and k == 0:
            arcs, n = PAIRS, 4
        if all(w > 0 for _, _, w in arcs):
            arcs[0][2] *= -1
        pins = {int(rng.integers(1, n + 1)): 1} if k % 2 else {}
        problem = signed(arcs, n, gains=pins)
        certificate = dd.certify(problem)
        M = laplacian(arcs, n)
        for agent in pins:
            M[agent - 1, agent - 1] += 1
        resting = any(not set(pins) & each for each in balanced_sets(arcs, n))
        wanted = Verdict.REFUTED if resting else Verdict.PROVED
        assert certificate.verdict is wanted, (arcs, pins)
        assert resting == (rate_of(M) < 1e-9)
        assert certificate.rate is None or certificate.rate <= rate_of(M) + 1e-9
        assert holds_for_both(certificate, problem), (arcs, pins)


def test_a_region_with_unbalanced_signs_is_proved_by_rows_that_do_not_see_them():
    """The same weights v prove the network without signs; runs never leave their box."""
    arcs = [[1, 2, -1], [2, 1, -1], [2, 3, 1], [3, 2, 1], [1, 3, 1]]
    given = {"coupling": "exp(y)-1+y", "gains": {1: 2}, "region": {"initial_states": [-1, 1]}}
    problem = signed(arcs, 3, **given)
    certificate = dd.certify(problem)
    plain = [[i, j, abs(w)] for i, j, w in arcs]
    network = dd.Network.from_arcs(plain, arrow="listens_to", agents=3)
    other = dd.certify(dd.Problem(network=network, **given))
    found, twin = (
        next(each for each in one.checks if each.id == "max-separable")
        for one in (certificate, other)
    )
    assert found.is_proved
    assert found.rate == twin.rate
    assert holds_for_both(certificate, problem)
    box = np.array([float(x) for x in found.claim.v])
    trajectory = dd.simulate(problem, t_final=5, start=[1, -1, 1])
    errors = np.abs(trajectory.x[..., 0]) / box
    size = errors.max(axis=1)
    bound = size[0] * np.exp(-float(found.rate) * trajectory.times)
    assert np.all(size <= bound * (1 + 1e-6))


def test_agents_on_two_sides_agree_up_to_signs_and_end_at_the_target_and_its_negative():
    arcs = [[1, 2, 1], [2, 1, 1], [2, 3, -2], [3, 2, -2], [3, 4, 1], [4, 3, 1], [4, 1, -1]]
    agreeing = signed(arcs, 4, goal="agreement")
    certificate = dd.certify(agreeing)
    assert certificate.verdict is Verdict.PROVED
    assert certificate.rate == pytest.approx(np.sort(np.linalg.eigvals(laplacian(arcs, 4)).real)[1])
    assert any("Agents 1, 2 oppose agents 3, 4" in note for note in certificate.claims.notes)
    assert holds_for_both(certificate, agreeing)
    # The value of one side is minus that of the other: no formula of one value is claimed.
    assert certificate.value is None
    ended = dd.simulate(agreeing, t_final=60, start=[3, 1, 1, -2]).x[-1, :, 0]
    assert ended[:2] == pytest.approx([ended[0]] * 2, abs=1e-6)
    assert ended[2:] == pytest.approx([-ended[0]] * 2, abs=1e-6)
    pinned = signed(arcs, 4, gains={3: 1}, target=2)
    assert [pinned.goal_of(agent)[0] for agent in range(4)] == [-2, -2, 2, 2]
    assert dd.simulate(pinned, t_final=100).x[-1, :, 0] == pytest.approx([-2, -2, 2, 2], abs=1e-3)
    # Without a root: two groups keep their own values.
    apart = signed([[1, 2, -1], [2, 1, -1], [3, 4, 1], [4, 3, 1]], 4, goal="agreement")
    refuted = dd.certify(apart)
    assert refuted.verdict is Verdict.REFUTED
    assert holds_for_both(refuted, apart)


def test_a_coupling_that_is_not_odd_is_mirrored_on_the_second_side():
    """x -> s x: agents of the side -1 have -h(-y), and a box is proved for both."""
    arcs = [[1, 2, -1], [2, 1, -1], [2, 3, 1], [3, 2, 1]]
    region = {"initial_states": [-1, 1]}
    problem = signed(arcs, 3, coupling="exp(y)-1+y", gains={1: 2}, region=region, target=1)
    certificate = dd.certify(problem)
    assert certificate.verdict is Verdict.PROVED
    assert holds_for_both(certificate, problem)
    plain = [[i, j, abs(w)] for i, j, w in arcs]
    turned = dd.Problem(
        network=dd.Network.from_arcs(plain, arrow="listens_to", agents=3),
        coupling="exp(y)-1+y",
        exceptions={(1, 0): "-(exp(-y)-1-y)", (1, 2): "-(exp(-y)-1-y)", (2, 1): "-(exp(-y)-1-y)"},
        gains={1: 2},
        target=1,
    )
    start = np.array([1.0, -0.5, 0.25])
    ended = dd.simulate(problem, t_final=3, start=start).x[-1, :, 0]
    mirror = dd.simulate(turned, t_final=3, start=start * [1, -1, -1]).x[-1, :, 0]
    assert ended == pytest.approx(mirror * [1, -1, -1], rel=1e-6)


@pytest.mark.slow
def test_agents_without_pins_meet_at_zero_from_a_region_by_signs_that_do_not_balance():
    """Whoever is far from 0 holds its opposite back: by the graphs of the double cover, for
    couplings that rise, for one graph and for graphs in turn."""
    region = {"initial_states": ["-3/4", "3/4"]}
    triangle = [[1, 2, 1], [2, 3, 1], [3, 1, -1]]
    follower = [[6, 1, 1], [6, 5, -1]]
    given = {"coupling": "exp(y)-1+y", "region": region}
    problem = signed([*triangle, [4, 5, 1], [5, 4, -1], *follower], 6, **given)
    certificate = dd.certify(problem)
    assert certificate.covered_by == "schedule"
    assert (
        certificate.claims.reason == "All agents reach the target from every start in the region."
    )
    assert holds_for_both(certificate, problem)
    rng = np.random.default_rng(0)
    for start in rng.choice([-0.75, 0.75], size=(5, 6)):
        ended = dd.simulate(problem, t_final=20, start=start).x[-1]
        assert np.abs(ended).max() < 1e-3
    # 4 and 5 agree: their signs balance.
    twin = signed([*triangle, [4, 5, 1], [5, 4, 1], *follower], 6, **given)
    refuted = dd.certify(twin)
    assert refuted.verdict is Verdict.REFUTED
    (check,) = (each for each in refuted.checks if each.id == "schedule")
    assert "agents 4 and 5 hear nobody outside, with signs that balance and no pin" in check.reason
    forged = json.loads(certificate_bytes(certificate.claims))
    forged["problem_sha256"] = hashlib.sha256(canonical_bytes(twin)).hexdigest()
    failures = dd.verify(json.dumps(forged).encode(), twin).failures
    assert any("agents 4 and 5 hear nobody outside" in text for text in failures)
    found = examine(json.dumps(forged).encode(), canonical_bytes(twin))
    assert any("a set whose signs balance has no pin" in text for _, text in found)
    network = dd.Network.from_arcs(
        {"a": [[1, 2, 1]], "b": [[2, 1, -1]]}, arrow="listens_to", agents=2, negative="opposes"
    )
    turns = dd.Switching(guarantee="dwell", dwell=1, longest=2)
    in_turn = dd.Problem(network=network, switching=turns, **given)
    assert dd.certify(in_turn).covered_by == "schedule"
    forever = in_turn.replace(switching=dd.Switching(guarantee="dwell", dwell=1))
    assert dd.certify(forever).verdict is Verdict.REFUTED


def test_antagonists_in_a_ring_go_to_zero_from_the_region_asked_for():
    """Altafini 2013, couplings that are not linear: 2 - sqrt(2) is the least eigenvalue of the
    signed Laplacian, which no claim exceeds."""
    problem = curved_ring()
    certificate = dd.certify(problem)
    assert certificate.verdict is Verdict.PROVED
    assert holds_for_both(certificate, problem)
    ring = [(i + 1, (i + 1) % 4 + 1, w) for i, w in enumerate((1, -1, 1, 1))]
    L = laplacian([*ring, *((j, i, w) for i, j, w in ring)], 4)
    assert rate_of(L) == pytest.approx(2 - 2**0.5)
    assert certificate.check("lemma1").rate <= rate_of(L)


def test_the_loop_as_printed_and_held_readings_know_who_opposes_whom():
    """(13) integrated beside (1) ends where the closed form of its error does; readings held for a
    short period end close by."""
    arcs = [[1, 2, -1], [2, 1, "-1/2"], [2, 3, 1], [3, 1, 1]]  # they do not balance
    problem = signed(
        arcs,
        3,
        coupling="exp(y)-1+y",
        exosystem=dd.Exosystem(A=[[0]], C=[[1]]),
        simulation={"x0": ["1/2", -1, "1/4"], "xi0": [1]},
    )
    wanted = dd.simulate(problem, t_final=3).x[-1]
    assert np.abs(wanted).max() > 0.01
    printed = dd.simulate(problem, t_final=3, observer="full-loop").x[-1]
    assert printed == pytest.approx(wanted, abs=1e-6)
    held = dd.simulate(problem, t_final=3, stress=dd.Stress(period=1e-3)).x[-1]
    assert held == pytest.approx(wanted, abs=1e-2)


@few_chords()
def test_schedules_of_signed_graphs_go_to_zero_iff_no_balanced_set_rests_over_a_round():
    modes = {"a": [[1, 2, 1]], "b": [[2, 1, -1]]}
    switching = dd.Switching(guarantee="sequence", sequence=["a", "b"], dwell=1)
    network = dd.Network.from_arcs(modes, arrow="listens_to", agents=2, negative="opposes")
    pinned = dd.Problem(network=network, coupling="y", gains={1: 1}, switching=switching)
    certificate = dd.certify(pinned)
    assert certificate.verdict is Verdict.PROVED
    assert holds_for_both(certificate, pinned)
    both = {"a": [[1, 2, -1]], "b": [[2, 1, -1]]}
    rests = dd.Network.from_arcs(both, arrow="listens_to", agents=2, negative="opposes")
    problem = dd.Problem(network=rests, coupling="y", switching=switching)
    refuted = dd.certify(problem)
    assert refuted.verdict is Verdict.REFUTED
    assert holds_for_both(refuted, problem)
    # Over a round the signs do not balance: true, and not proved here, but never refuted.
    open_one = dd.Problem(network=network, coupling="y", switching=switching)
    undecided = dd.certify(open_one)
    assert undecided.verdict is not Verdict.REFUTED
    assert holds_for_both(undecided, open_one)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"target": 1}, r"target must be 0 or left out: .* \(4 listens to 3 fits none\)"),
        ({"offsets": {1: 1}}, "formation must be 0"),
        ({"region": {"initial_states": [0, 5]}}, "the same on both sides of 0"),
        ({"dynamics": {"A": [[0]], "B": [[1]]}}, "dynamics is not known"),
    ],
)
def test_what_signs_do_not_allow_is_refused_by_name(more: dict[str, Any], message: str):
    arcs = [[1, 2, 1], [2, 1, 1], [3, 4, 1], [4, 3, -1]]
    with pytest.raises(SpecError, match=message):
        signed(arcs, 4, **more)


@pytest.mark.parametrize(
    "call",
    [
        dd.design,
        lambda problem: dd.design_pinning(problem, rate="0.1"),
        dd.falsify,
        dd.export.python_script,
    ],
)
def test_what_does_not_know_signs_refuses_them_by_name(call: Any):
    with pytest.raises(SpecError, match="does not know agents that oppose others"):
        call(signed(PAIRS, 4))


def test_models_and_python_control_have_the_signs():
    problem = signed(PAIRS, 4)
    e = np.array([1.0, 2.0, -1.0, 0.5])
    model = dd.build_model(problem)
    assert np.array(model.h(e)).ravel() == pytest.approx(-laplacian(PAIRS, 4) @ e)
    assert np.array(model.jacobian(e)) == pytest.approx(-laplacian(PAIRS, 4))
    system = dd.export.to_control(problem)
    assert np.ravel(system.dynamics(0, e, np.zeros(4))) == pytest.approx(-laplacian(PAIRS, 4) @ e)


def refusals(problem: dd.Problem, change: Any, claims: bytes) -> list[str]:
    """What the second program says of a changed problem, whose hash the certificate repeats."""
    document = canonical_document(problem)
    change(document)
    text = json.dumps(document, sort_keys=True, ensure_ascii=False, separators=(",", ":"))
    data = text.encode() + b"\n"
    certificate = json.loads(claims)
    certificate["problem_sha256"] = hashlib.sha256(data).hexdigest()
    found = examine(json.dumps(certificate).encode(), data)
    return [words for holds, words in found if not holds]


def test_a_flipped_sign_is_refused_by_the_second_program():
    """What is proved for signs that do not balance says nothing of those that do."""
    problem = signed(PAIRS, 4)
    claims = certificate_bytes(dd.certify(problem).claims)
    assert refusals(problem, lambda document: None, claims) == []

    def flipped(document: Any) -> None:
        document["modes"][0]["arcs"][3][2] = "1"

    assert refusals(problem, flipped, claims)

    def repels(document: Any) -> None:
        document["negative"] = "repels"

    with pytest.raises(Refused, match="is no word that is known here"):
        refusals(problem, repels, claims)


def test_old_problems_keep_their_text():
    """The key is there with negative weights only."""
    arcs = [[1, 2], [2, 1]]
    plain = dd.Network.from_arcs(arcs, arrow="listens_to")
    keyed = dd.Network.from_arcs(arcs, arrow="listens_to", negative="opposes")
    one, other = (
        canonical_bytes(dd.Problem(network=each, coupling="y")) for each in (plain, keyed)
    )
    assert one == other
    assert b"negative" not in one
    problem = signed(PAIRS, 4)
    assert problem_from_canonical(canonical_bytes(problem)) == problem
    again = read_problem_text(problem_text(problem).encode(), folder=None)
    assert canonical_bytes(again) == canonical_bytes(problem)


@pytest.fixture(scope="module")
def settled() -> tuple[dd.Problem, dict[str, Any]]:
    """Unbalanced signs with a pin, a region and a settling time, and what its certificate says."""
    arcs = [[1, 2, -1], [2, 1, -1], [2, 3, 1], [3, 2, 1], [1, 3, 1]]
    region = {"initial_states": [-1, 1]}
    problem = signed(arcs, 3, coupling="tanh(y)", gains={1: 2}, region=region)
    with rough_settling(), only(separable_stage, quadratic_stage):
        certificate = dd.certify(problem, everything=True, settling="0.01")
    return problem, json.loads(certificate_bytes(certificate.claims))


def forged(found: tuple[dd.Problem, dict[str, Any]], change: Any) -> list[str]:
    """What the second program says of a changed certificate; the first has to refuse it as well."""
    problem, claims = found
    other = json.loads(json.dumps(claims))
    change({each["id"]: each for each in other["checks"]})
    data = json.dumps(other).encode()
    assert not dd.verify(data, problem).holds
    said = examine(data, canonical_bytes(problem))
    return [words for holds, words in said if not holds]


@pytest.mark.slow
def test_unlike_faces_of_a_tube_are_refused_where_agents_oppose_others(settled: Any):
    def change(checks: Any) -> None:
        tube = checks["settling"]["exact"]["tube"]
        tube["upper"] = [[f"{x}" for x in face] for face in tube["upper"]]
        tube["upper"][0][0] = "2"

    assert any("faces are not alike" in words for words in forged(settled, change))


def test_a_form_of_rows_without_signs_is_refused_where_agents_oppose_others(settled: Any):
    def change(checks: Any) -> None:
        checks["lure"] |= {"verdict": "proved", "rate": 0.1, "exact": {}}
        checks["lure"]["domain"] = checks["max-separable"]["domain"]

    assert any("fit no two sides" in words for words in forged(settled, change))


def test_a_refutation_by_rows_without_signs_is_refused(settled: Any):
    def change(checks: Any) -> None:
        checks["reachability"]["verdict"] = "refuted"
        checks["reachability"]["witness"] = {"kind": "agents", "labels": ["2", "3"]}

    assert any("it is proved here" in words for words in forged(settled, change))
