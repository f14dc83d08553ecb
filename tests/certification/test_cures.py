"""Cures: known answers, each with a twin that just fails, and over random problems."""

import re
from fractions import Fraction

import pytest
from campaigns.cures import cured, theorem_holds, with_cures
from certified import without_region
from networks import linked

from dobc_design import Exosystem, Observer, Verdict
from dobc_design.certification import cures as certification_cures
from dobc_design.conditions.check import main_cure
from dobc_design.conditions.consensus import cures
from dobc_design.problem.changes import changed_problem

HARMONIC = Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]])
TWO_OSCILLATORS = Exosystem(
    A=[[0, 1, 0, 0], [-4, 0, 0, 0], [0, 0, 0, 1], [0, 0, -4, 0]], C=[[1, 0, 1, 0]]
)


def cycle(n, **changes):
    agents = range(1, n + 1)
    arcs = [[i, i % n + 1] for i in agents]
    settings = {"coupling": "exp(y) - 1 + y"} | changes
    return linked(arcs, n, **settings)


def gains_of(fix):
    found = {}
    for label, k in fix.set["pinning.gains"].items():
        found[label] = Fraction(str(k))
    return found


def minimum_of(fix):
    """The smallest gains on the agents of the cure, as its text names them; the others are those of
    the cure."""
    told = re.search(r"Minimum with V = e'e: (.*?)(?: Also possible|$)", fix.text)[1]
    named = re.findall(r"k = ([0-9.e+-]*[0-9]) for agents? ((?:\d+(?:, | and )?)+)", told)
    named_gains = {
        label: Fraction(k) for k, labels in named for label in re.findall(r"\d+", labels)
    }
    return gains_of(fix) | named_gains


def with_minimum(problem, fix, part=1):
    """The problem with those gains, or with those that are not the problem's own a little
    smaller."""
    own = {}
    for i, k in problem.pinning.gains.items():
        own[problem.network.labels[i]] = k[0][0]
    gains = {}
    for label, k in minimum_of(fix).items():
        gains[label] = k if own.get(label) == k else k * part
    return changed_problem(problem, {"pinning.gains": gains})


def test_the_ten_cycle_without_pins_is_cured_by_any_one_pin():
    """Every gain > 0 does.  The fastest rate is 2, but half of it, and a quarter, take more gain
    than any agent has."""
    problem = cycle(10, exosystem=HARMONIC)
    stages = []
    fix = main_cure(with_cures(problem, progress=stages.append).checks).fix
    assert "looking for a cure" in stages
    assert any("tried" in stage for stage in stages)
    assert list(gains_of(fix)) == ["1"]
    assert "Any other agent would do as well." in fix.text
    # The gain for the rate beta (slope 2): det(M - beta I) = (2 + k - beta) (2 - beta)^9 - 2^10 =
    # 0.
    gain = {}
    for beta in (1 / 8, 1 / 4):
        gain[beta] = 2**10 / (2 - beta) ** 9 - 2 + beta
    assert gain[1 / 4] > 4
    found = float(gains_of(fix)["1"])
    assert gain[1 / 8] <= found <= 1.02 * gain[1 / 8]
    assert ", for a decay rate of at least 0.12 1/s near the target" in fix.text
    assert theorem_holds(cured(problem, fix.set))
    assert not theorem_holds(changed_problem(problem, {"pinning.gains": {"1": 0}}))


def test_a_chain_pinned_at_the_wrong_end_gets_a_pin_at_the_other():
    """1 hears 2 hears 3: nothing on 1 and 2 helps; the gains that are there stay."""
    arcs = [[1, 2], [2, 3]]
    problem = linked(arcs, gains={1: 5}, exosystem=HARMONIC)
    certificate = with_cures(problem)
    fix = main_cure(certificate.checks).fix
    assert gains_of(fix)["1"] == 5
    assert list(gains_of(fix)) == ["1", "3"]
    assert "No gain on agent 1 can help: the error of agent 3 would not decrease." in fix.text
    assert theorem_holds(cured(problem, fix.set))
    # M is triangular with the diagonal 6, 1, k: half of the fastest rate 1 takes k = 1/2, and every
    # k > 0 does.
    assert gains_of(fix)["3"] == Fraction(1, 2)
    cured_gains = {"1": 5, "3": Fraction(1, 1000)}
    assert theorem_holds(changed_problem(problem, {"pinning.gains": cured_gains}))
    lost_gains = {"pinning.gains": {"1": 5, "3": 0}}
    assert not theorem_holds(changed_problem(problem, lost_gains))
    for id in ("reachability", "lemma1", "theorem1"):
        assert certificate.check(id).fix.set == fix.set


def test_of_a_large_cured_problem_only_the_weighted_theorem_is_decided(monkeypatch):
    """Its cure is that of deciding the whole cured problem; where weights do not prove it, the
    whole one is decided."""
    observer = Observer(W=[[3], [2]])
    problem = cycle(4, exosystem=HARMONIC, observer=observer)
    whole = with_cures(problem).check("theorem1").fix
    monkeypatch.setattr(certification_cures, "LARGE", 0)
    asked = []
    monkeypatch.setattr(certification_cures, "_holds", lambda *given: asked.append(given) or True)
    assert whole is not None
    assert with_cures(problem).check("theorem1").fix == whole
    assert not asked
    monkeypatch.setattr(certification_cures, "weighted_stage", lambda *given: [])
    assert with_cures(problem).check("theorem1").fix == whole
    assert asked


def test_two_closed_groups_get_a_pin_each():
    arcs = [[1, 2], [2, 1], [3, 4], [4, 3], [5, 1], [5, 3]]
    problem = linked(arcs, gains={5: 5})
    fix = main_cure(with_cures(problem).checks).fix
    added = set(gains_of(fix)) - {"5"}
    in_the_first = len(added & {"1", "2"})
    in_the_second = len(added & {"3", "4"})
    assert in_the_first == in_the_second == 1
    assert len(added) == 2
    assert "(1, 2) and (3, 4)" in fix.text
    assert theorem_holds(cured(problem, fix.set))
    for label in added:
        less = {"pinning.gains": gains_of(fix) | {label: 0}}
        assert not theorem_holds(changed_problem(problem, less))


def test_agents_out_of_reach_in_one_mode_get_a_pin_each_with_a_gain_of_its_own():
    """Mode a: 3 hears 2; mode b: 2 hears the pinned 1."""
    first_arc = [[3, 2]]
    modes = {"a": first_arc, "b": [[2, 1]]}
    problem = linked(modes, gains={1: 1})
    fix = main_cure(with_cures(problem).checks).fix
    gains = gains_of(fix)
    assert set(gains) == {"1", "2", "3"}
    assert gains["1"] == 1
    assert gains["2"] != gains["3"]
    assert fix.text.startswith(
        "Pin agents 3 and 2 as well, with k = 0.5 for agent 3 and k = 0.75 for agent 2"
    )
    assert "Recommended: half of the maximum decay rate. Smaller gains do as well." in fix.text
    assert theorem_holds(cured(problem, fix.set))
    for label in ("2", "3"):
        assert not theorem_holds(changed_problem(problem, {"pinning.gains": gains | {label: 0}}))


def test_one_other_agent_that_would_do_as_well_is_named():
    arcs = [[1, 2], [2, 1], [3, 4], [4, 3]]
    problem = linked(arcs, gains={1: 1})
    fix = main_cure(with_cures(problem).checks).fix
    assert "Pin agent 3 as well" in fix.text
    assert "Agent 4 would do as well." in fix.text
    assert theorem_holds(cured(problem, fix.set))
    same_gain = gains_of(fix)["3"]
    moved_gains = {"1": 1, "4": same_gain}
    assert theorem_holds(changed_problem(problem, {"pinning.gains": moved_gains}))
    assert not theorem_holds(problem)


def test_lemma_1_refuted_is_no_alarm_where_weights_prove_the_theorem():
    """1 hears 2 with weight 3, and only 2 is pinned: Lambda < 0 iff 12 k > 9, but M is
    triangular."""
    arcs = [[1, 2, 3]]
    problem = linked(arcs, gains={2: "1/2"}, exosystem=HARMONIC)
    certificate = with_cures(problem)
    assert certificate.verdict is Verdict.PROVED
    assert certificate.covered_by == "theorem1-weighted"
    assert certificate.check("lemma1").verdict is Verdict.REFUTED
    assert all(check.fix is None for check in certificate.checks)
    arcs_of_twin = [[1, 2, 3]]
    unpinned = linked(arcs_of_twin, gains={2: 0}, exosystem=HARMONIC)
    twin = with_cures(unpinned)
    assert twin.verdict is not Verdict.PROVED
    assert twin.check("lemma1").fix is not None


def test_too_small_gains_on_the_present_pins_are_raised_to_the_least_that_do():
    """Each hears the other in one of two modes, with weight 3: M + M' > 0 iff 4 (3 + k) k > 9, k >
    0.6213.  By symmetry weights do not help."""
    modes = {"A": [[1, 2, 3]], "B": [[2, 1, 3]]}
    gains = {1: "1/10", 2: "1/10"}
    problem = linked(modes, gains=gains, exosystem=HARMONIC)
    certificate = with_cures(problem)
    assert certificate.check("theorem2").verdict is Verdict.REFUTED
    fix = main_cure(certificate.checks).fix
    assert theorem_holds(cured(problem, fix.set))
    assert theorem_holds(changed_problem(problem, {"pinning.gains": "0.63"}))
    assert not theorem_holds(changed_problem(problem, {"pinning.gains": "0.621"}))
    assert (
        "Recommended: half of the maximum decay rate. Minimum with V = e'e: k = 0.63 for "
        "every agent." in fix.text
    )


def test_a_cheaper_cure_with_another_pin_is_named_beside_the_present_pins():
    """For V = e'e k = 1 on agent 1, or (3 + k) (1 + k) = 4 on both."""
    three = [1, 2, 3]
    modes = {"A": [three, [2, 1]], "B": [[1, 2], [2, 1, 3]]}
    problem = linked(modes, gains={1: "1/99"})
    fix = main_cure(with_cures(problem).checks).fix
    assert list(gains_of(fix)) == ["1"]
    assert "Also possible, with a pin on agent 2" in fix.text
    assert theorem_holds(cured(problem, fix.set))
    assert theorem_holds(with_minimum(problem, fix))
    weaker = with_cures(with_minimum(problem, fix, Fraction(97, 100)))
    check = weaker.check("lemma1", "A")
    assert check.verdict is not Verdict.PROVED
    # matrix gains that leave a direction free are cured by gains that are numbers
    arcs = [[1, 2], [2, 1]]
    gains = {1: [[1, 0], [0, 0]]}
    problem = linked(arcs, target=[0, 0], gains=gains)
    fix = main_cure(with_cures(problem).checks).fix
    assert list(gains_of(fix)) == ["1"]
    assert theorem_holds(cured(problem, fix.set))


@pytest.mark.parametrize("exosystem", [Exosystem(A=[[0]], C=[[0]]), TWO_OSCILLATORS])
def test_an_undetectable_pair_is_cured_by_its_observable_part(exosystem):
    arcs = [[1, 2], [2, 1]]
    problem = linked(arcs, gains=1, exosystem=exosystem)
    certificate = with_cures(problem)
    fix = main_cure(certificate.checks).fix
    assert fix.kind == "exosystem"
    assert certificate.check("theorem1").fix == fix
    assert theorem_holds(cured(problem, fix.set))


def test_an_exosystem_that_is_not_seen_at_all_takes_everything_about_it_along():
    """m = 2 is then said by the target, and the bound on the observer error has no meaning any
    more."""
    region = {"initial_states": [0, 5], "initial_disturbance": 1}
    C = [[0], [0]]
    exosystem = Exosystem(A=[[1]], C=C)
    given = {"exosystem": exosystem, "observer": Observer(rate=1), "region": region}
    arcs = [[1, 2], [2, 1]]
    simulation = {"xi0": [1]}
    problem = linked(arcs, gains=1, simulation=simulation, target=[1, 2], **given)
    fix = main_cure(with_cures(problem).checks).fix
    whole = cured(problem, fix.set)
    assert whole.exosystem is None
    assert whole.m == 2
    assert whole.target == (1, 2)
    assert theorem_holds(whole)


def test_a_gain_w_that_does_not_decay_is_replaced_by_one_that_does():
    W = [[-1], [0]]
    P = [[1, 0], [0, 1]]
    observer = Observer(W=W, P=P)
    problem = cycle(4, gains=1, exosystem=HARMONIC, observer=observer)
    certificate = with_cures(problem)
    assert certificate.check("hurwitz").witness.kind == "routh_row"
    fix = certificate.check("hurwitz").fix
    assert set(fix.set) == {"observer.W", "observer.P"}
    assert certificate.check("theorem1").fix == fix
    assert cured(problem, fix.set).observer.W is not None
    assert theorem_holds(cured(problem, fix.set))


def test_several_causes_are_cured_together_for_the_theorem_and_one_by_one_for_the_checks():
    W = [[-9], [0], [0], [0]]
    problem = cycle(4, exosystem=TWO_OSCILLATORS, observer=Observer(W=W))
    certificate = with_cures(problem)
    fix = certificate.check("theorem1").fix
    assert fix.kind == "several"
    assert set(fix.set) == {"exosystem.A", "exosystem.C", "observer.W", "pinning.gains"}
    cure = set(certificate.check("detectability").fix.set)
    expected = {"exosystem.A", "exosystem.C", "observer.W"}
    assert cure == expected
    assert set(certificate.check("lemma1").fix.set) == {"pinning.gains"}
    assert theorem_holds(cured(problem, fix.set))


def test_the_printed_p_is_multiplied_by_the_least_factor_that_does():
    """lambda_max(Lambda) = -0.5823 and the bound is -9/(8 a): a > 1.932."""
    problem = without_region("paper-fixed")
    fix = with_cures(problem).check("theorem1-printed").fix
    entry = str(fix.set["observer.P"][0][0])
    factor = Fraction(entry) / Fraction(1, 2)
    assert Fraction("1.931") < factor <= Fraction("1.95")
    found = with_cures(cured(problem, fix.set))
    verdict = found.check("theorem1-printed").verdict
    assert verdict is Verdict.PROVED
    less = []
    for row in (["1/2", "-1/4"], ["-1/4", "1/3"]):
        less.append([str(Fraction("1.93") * Fraction(x)) for x in row])
    twin = changed_problem(problem, {"observer.P": less})
    assert with_cures(twin).check("theorem1-printed").verdict is Verdict.REFUTED


def test_a_printed_p_that_is_no_lyapunov_matrix_is_replaced_by_the_one_that_was_found():
    indefinite = [[1, 0], [0, -1]]
    problem = changed_problem(without_region("paper-fixed"), {"observer.P": indefinite})
    fix = with_cures(problem).check("theorem1-printed").fix
    found = with_cures(cured(problem, fix.set))
    verdict = found.check("theorem1-printed").verdict
    assert verdict is Verdict.PROVED


def test_what_holds_and_kinked_couplings_get_no_cure_and_a_library_that_breaks_down_costs_it_alone(
    monkeypatch,
):
    ring_of_four = cycle(4, gains=1, exosystem=HARMONIC)
    assert main_cure(with_cures(ring_of_four).checks) is None
    assert main_cure(with_cures(cycle(4, coupling="clip(y, -1, 1)")).checks) is None

    def broken(*args, **kwargs):
        raise ValueError("no convergence")

    monkeypatch.setattr(cures, "network_blocks", broken)
    certificate = with_cures(cycle(4))
    assert certificate.verdict is Verdict.REFUTED
    assert certificate.check("lemma1").fix is None
