"""Pins of single modes ([pinning.modes]): read, written, told, drawn, simulated, and proved."""

import json
from dataclasses import replace
from fractions import Fraction
from random import Random

import numpy as np
import pytest
from certified import certified, rough_settling
from matplotlib.colors import to_rgba

from dobc_design import (
    Certificate,
    Exosystem,
    Network,
    Problem,
    Stress,
    analyse,
    build_model,
    design,
    export,
    simulate,
)
from dobc_design.certificate.text import certificate_bytes
from dobc_design.certification.recheck import confirm, trust
from dobc_design.checker.examine import examine
from dobc_design.conditions.separable.claim import rows
from dobc_design.description.words import describe, facts
from dobc_design.errors import SpecError
from dobc_design.export.rocq.matrices import rocq_proof
from dobc_design.loop.make import loop_of
from dobc_design.loop.pairs import required_rows
from dobc_design.plotting import look
from dobc_design.problem.canonical import (
    canonical_bytes,
    problem_from_canonical,
    problem_sha256,
)
from dobc_design.problem.changes import changed_problem, problem_text
from dobc_design.problem.load import read_problem_text
from dobc_design.problem.pinning import Pinning
from dobc_design.simulation.signals import Periodic

F = Fraction
HEAD = """\
name = "switch-pins"
[network]
agents = 4
arrow = "listens_to"
[network.modes]
G1 = [[2, 1], [3, 1], [4, 1]]
G2 = [[1, 2], [3, 1], [4, 1]]
"""
REGION = "[region]\ninitial_states = [-1, 1]\n"
TEXT = f"""\
{HEAD}[coupling]
h = "tanh(y)"
[pinning.modes]
G1 = {{ 1 = 1 }}
G2 = {{ 2 = "5/2" }}
{REGION}"""
START = [[0.5], [-0.7], [0.9], [-0.2]]
SIGNAL = Periodic(dwell=0.7)


@pytest.fixture(autouse=True)
def rough_search():
    """How soon agents settle is not asked here."""
    with rough_settling():
        yield


def problem(text: str = TEXT) -> Problem:
    return read_problem_text(text.encode(), folder=None)


def with_stand_in() -> Problem:
    """The same network, in which an agent at the target that hears nobody is the target: its pin
    keeps it there, and pins of the others are linear arcs to it."""
    text = TEXT.replace("agents = 4", 'agents = ["1", "2", "3", "4", "target"]')
    text = text.replace("G1 = [[", 'G1 = [[1, "target"], [').replace(
        "G2 = [[", 'G2 = [[2, "target", "5/2"], ['
    )
    head, _, _ = text.partition("[pinning.modes]")
    own = '[[coupling.exceptions]]\narcs = [[1, "target"], [2, "target"]]\nh = "y"\n'
    return problem(f"{head}{own}[pinning]\ngains = {{ target = 1 }}\n{REGION}")


def test_the_gains_of_a_mode_are_those_of_all_modes_and_its_own():
    given = problem(TEXT.replace("G2 = {", "G2 = { 3 = 0, ")).replace(gains={"4": 2})
    assert given.pinning.agents == (0, 1, 3)
    assert given.pinning.of("G1") == {3: ((F(2),),), 0: ((F(1),),)}
    assert given.pinning.of("G2") == {3: ((F(2),),), 1: ((F(5, 2),),)}
    assert given.gains == {"4": F(2)}


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("G2 = { 2", "G3 = { 2", "pinning.modes.G3 names no mode of the network. The modes are G1"),
        ("G2 = { 2", "G2 = { 7", "pinning.modes.G2.7: there is no agent '7'"),
        ('"5/2"', "-1", "pinning.modes.G2.2 must be >= 0"),
        (
            "[pinning.modes]",
            "[pinning]\ngains = { 1 = 3 }\n[pinning.modes]",
            r"pinning.modes.G1.1 names an agent that has a gain in every mode.*Keep one",
        ),
    ],
)
def test_wrong_pins_of_modes_are_refused_by_key(old: str, new: str, message: str):
    with pytest.raises(SpecError, match=message):
        problem(TEXT.replace(old, new))


def test_pins_of_modes_survive_text_json_changes_and_copies():
    given = problem()
    assert problem_from_canonical(canonical_bytes(given)) == given
    document = json.loads(canonical_bytes(given))
    assert [mode["gains"] for mode in document["modes"]] == [[[0, [["1"]]]], [[1, [["5/2"]]]]]
    assert problem(problem_text(given)) == given
    assert given.replace(name="other").pinning == given.pinning
    changed = changed_problem(given, {"pinning.gains": {"3": 2}})
    assert changed.pinning.modes == given.pinning.modes
    assert changed.pinning.gains == {2: ((F(2),),)}
    parts = {"network": given.network, "coupling": given.coupling}
    chain = Network.from_arcs([[2, 1]], arrow="listens_to")
    assert Problem(**parts, gains=given.pinning).pinning == given.pinning
    assert given.replace(mode_gains=None).pinning == Pinning(gains={})
    with pytest.raises(SpecError, match=r"pinning\.modes\.G1 names no mode"):
        Problem(**parts | {"network": chain}, gains=given.pinning)
    with pytest.raises(SpecError, match="Give mode_gains for these agents too"):
        given.replace(network=chain)


def test_check_says_who_is_pinned_in_which_mode():
    told = describe(problem())
    assert 'Pinned in mode "G1": 1 (k = 1).' in told
    assert 'Pinned in mode "G2": 2 (k = 5/2).' in told or "2 (k = 2.5)" in told
    assert "nobody" not in told
    assert "NOT REACHED" not in told
    assert "Look at this" not in told
    assert facts(problem())["pinned_in_modes"] == {"G1": ["1"], "G2": ["2"]}
    # the twin: with the pins exchanged agent 1 keeps nobody else in G2
    other = problem(TEXT.replace("G2 = { 2", "G2 = { 3"))
    assert "NOT REACHED from a pinned agent: 1, 2, 4." in describe(other)
    assert facts(other)["modes"]["G2"]["unreached"] == ["1", "2", "4"]
    assert analyse(other).graphs[1].unreached == ("1", "2", "4")


def test_the_picture_of_a_mode_shows_its_own_pins():
    given = problem()
    for mode, label in (("G1", "1"), ("G2", "2")):
        axes = given.plot(mode).figure.axes[0]
        blue = to_rgba(look.BLUE)
        (square,) = [each for each in axes.patches if each.get_facecolor() == blue]
        (text,) = [each for each in axes.texts if each.get_text() == label]
        assert np.allclose(square.get_path().vertices[:4].mean(axis=0), text.get_position())


@pytest.mark.parametrize("observer", ["closed-form", "full-loop"])
def test_runs_are_those_of_the_network_with_an_agent_at_the_target(observer: str):
    own = {"signal": SIGNAL, "t_final": 4, "samples": 41, "observer": observer}
    run = simulate(problem(), start=START, **own)
    other = simulate(with_stand_in(), start=[*START, [0]], **own)
    assert np.allclose(run.x, other.x[:, :4], rtol=0, atol=1e-7)
    # u is the pin of the mode that is on
    first = np.floor(run.times / 0.7 + 1e-9).astype(int) % 2 == 0
    assert np.allclose(run.u[first, 0, 0], -run.x[first, 0, 0])
    assert np.allclose(run.u[~first, 1, 0], -2.5 * run.x[~first, 1, 0])
    assert not run.u[first][:, 1:].any()
    assert not run.u[~first][:, [0, 2, 3]].any()


@pytest.mark.parametrize("period", [None, 0.05])
def test_pins_of_modes_saturate_and_lose_no_packets(period: float | None):
    """Every packet is lost: what is left is the pin, which needs none, with |u| <= 1/10."""
    stress = Stress(saturation=0.1, loss=1, period=period, exchange=None if period else 0.05)
    run = simulate(problem(), mode="G1", start=START, t_final=2, samples=21, stress=stress)
    assert np.allclose(run.u[:, 0, 0], -0.1)
    assert np.allclose(run.x[:, 0, 0], 0.5 - 0.1 * run.times)
    assert np.array_equal(run.x[:, 1:], run.x[:1, 1:].repeat(21, axis=0))


def test_models_and_exports_have_the_pins_of_their_mode():
    given = problem()
    e = np.ravel(START)
    h = np.tanh
    expected = {"G1": -e[0], "G2": -2.5 * e[1]}
    for mode, pull in expected.items():
        model = build_model(given, mode=mode)
        heard = 1 if mode == "G1" else 0
        slope = model.error_dynamics(e, [])[0]
        assert np.allclose(np.ravel(slope)[1 - heard], pull)
        assert np.allclose(np.ravel(slope)[heard], h(e[1 - heard] - e[heard]))
        loop = export.to_control(given, mode=mode)
        assert np.allclose(loop.dynamics(0, e, np.zeros(4)), np.ravel(slope))
        assert np.allclose(loop.output(0, e, np.zeros(4))[8 + 1 - heard], pull)
    matrices = export.to_numpy(given)
    assert np.array_equal(matrices["K_G1"], np.diag([1, 0, 0, 0]))
    assert np.array_equal(matrices["K_G2"], np.diag([0, 2.5, 0, 0]))


@pytest.mark.parametrize(
    "ask",
    [
        lambda p: export.to_c(p, period="1/10"),
        lambda p: export.to_fmu(p, period="1/10"),
        export.python_script,
        design,
        lambda p: rocq_proof(certified(p.replace(region=None))),
    ],
)
def test_what_does_not_know_pins_of_modes_refuses_them_by_name(ask):
    with pytest.raises(SpecError, match=r"pinning\.modes: .* does not know pins of single modes"):
        ask(problem())


def agreed(given: Problem) -> Certificate:
    """The certificate, whose every claim the second checker accepts."""
    certificate = certified(given)
    findings = examine(certificate_bytes(certificate.claims), canonical_bytes(given))
    assert all(holds for holds, _ in findings), [what for holds, what in findings if not holds]
    return certificate


def test_rows_are_those_of_agents_that_agree_with_one_that_hears_nobody():
    """Pins of modes with the coupling itself are arcs to an agent that stays where it is."""
    given = problem(TEXT.replace('"5/2"', "1").replace('"tanh(y)"', '"y"'))
    text = TEXT.replace("agents = 4", 'agents = ["1", "2", "3", "4", "target"]')
    text = text.replace("G1 = [[", 'G1 = [[1, "target"], [', 1)
    text = text.replace("G2 = [[", 'G2 = [[2, "target"], [', 1).replace('"tanh(y)"', '"y"')
    head, _, _ = text.partition("[pinning.modes]")
    agreeing = problem(f'goal = "agreement"\n{head}')
    v = (F(1), F(2), F(3), F(5))
    expected = rows(required_rows(loop_of(agreeing), None), v)
    assert list(rows(loop_of(given), v)) == list(expected)


@pytest.mark.parametrize("change", [("1 = 1", "1 = 3"), ("1 = 1", "4 = 1")])
def test_pins_of_modes_decide_as_who_hears_them(change: tuple[str, str]):
    """Linear, under a dwell time: proved where in each mode all hear the pin; refuted where in one
    of them, which may stay on, they do not."""
    dwell = '[switching]\nsignal = "random"\nguarantee = "dwell"\ndwell = 3\n'
    given = problem(TEXT.replace(*change).replace('"tanh(y)"', '"y"') + dwell)
    proved = agreed(given).claims.verdict
    assert proved.value == ("proved" if change[1].startswith("1") else "refuted")


def random_pins(seed: int) -> Problem:
    """Two or three modes, each with an agent that is pinned there, and arcs to all others."""
    r = Random(f"pins of modes {seed}")
    n = r.randint(2, 4)
    modes, gains = {}, {}
    for mode in ("a", "b", "c")[: r.randint(2, 3)]:
        order = r.sample(range(1, n + 1), n)
        arcs = [[later, r.choice(order[:k])] for k, later in enumerate(order) if k]
        modes[mode] = [[*arc, r.choice((1, 2))] for arc in arcs]
        gains[mode] = {str(order[0]): F(r.randint(1, 8), 2)}
    extra = {}
    if r.random() < 0.5:
        extra = {"exosystem": Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]])}
    if r.random() < 0.7:
        disturbance = {"initial_disturbance": "0.1"} if extra else {}
        extra["region"] = {"initial_states": [-1, 1]} | disturbance
    return Problem(
        network=Network.from_arcs(modes, agents=n, arrow="listens_to"),
        coupling=r.choice(("y", "tanh(y)", "exp(y) - 1 + y", "y**3 + y", "atan(2*y)")),
        mode_gains=gains,
        **extra,
    )


#: Those for which balls are looked for take seconds.
SEEDS = (1, 3, *(pytest.param(seed, marks=pytest.mark.evidence) for seed in (0, 2, 4, 5, 6, 7)))


@pytest.mark.parametrize("seed", SEEDS)
def test_random_networks_with_pins_of_modes_are_told_alike_by_both_programs(seed: int):
    certificate = agreed(random_pins(seed))
    assert certificate.claims.verdict.value != "refuted"


UNCERTAIN = '[uncertainty]\nweights = "1/10"\ngains = "1/5"\n'
LOADED = f'{UNCERTAIN}disturbance = "1/20"\nmeasurement = "1/100"\n'
MARKOV = '[switching]\nguarantee = "markov"\ngenerator = [[-1, 1], [1, -1]]\n'
OBSERVED = 'initial_disturbance = "1/10"\n[exosystem]\nhz = 1\n'
STRONG = ("G1 = { 1 = 1 }", "G1 = { 1 = 1, 2 = 1 }"), ('2 = "5/2"', '2 = "5/2", 1 = 2')
APART = (("G2 = { 2", "G2 = { 3"),)


@pytest.mark.parametrize(
    ("id", "changes", "table", "verdict"),
    [
        ("tolerance", STRONG, UNCERTAIN, "proved"),
        pytest.param(*("accuracy", STRONG, LOADED, "proved"), marks=pytest.mark.slow),
        pytest.param(
            *("tolerance", (*STRONG, ('"tanh(y)"', '"y"')), UNCERTAIN, "proved"),
            marks=pytest.mark.slow,
        ),
        ("accuracy", (*STRONG, ('"tanh(y)"', '"y"')), LOADED, "proved"),
        ("actuators", STRONG, "[actuators]\nlimit = 5\namplitude = 1\n", "proved"),
        pytest.param(
            *("actuators", STRONG, "[actuators]\nlimit = 2\namplitude = 1\n", "undecided"),
            marks=pytest.mark.slow,
        ),
        pytest.param(
            *("actuators", STRONG, f"{LOADED}[actuators]\nlimit = 6\namplitude = 1\n", "proved"),
            marks=pytest.mark.slow,
        ),
        pytest.param(*("markov", APART, MARKOV, "proved"), marks=pytest.mark.slow),
        ("markov", (*APART, ('"tanh(y)"', '"y"')), MARKOV, "proved"),
        ("markov", APART, MARKOV.replace("[1, -1]", "[0, 0]"), "refuted"),
        pytest.param(
            "equilibrium",
            (*STRONG, ('"tanh(y)"', '"sin(3*y)"'), ("[-1, 1]", "[-4, 4]")),
            "",
            "refuted",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_topics_take_pins_of_modes(id: str, changes, table: str, verdict: str):
    """Twins among them: pins that the chain visits again and again, and pins that it leaves."""
    text = TEXT
    for old, new in changes:
        text = text.replace(old, new)
    certificate = agreed(problem(text + table))
    (check,) = [each for each in certificate.checks if each.id == id]
    assert check.verdict.value == verdict


def test_the_final_bound_of_one_agent_is_that_of_its_weakest_pin():
    """omega/k: x' = -k x + w, k = 2 or 1, 20 % less: 0.1/0.8."""
    given = Problem(
        network=Network.from_arcs({"a": [], "b": []}, agents=1, arrow="listens_to"),
        coupling="y",
        mode_gains={"a": {"1": 2}, "b": {"1": 1}},
        uncertainty={"disturbance": "1/10", "gains": "1/5"},
    )
    (check,) = [each for each in agreed(given).checks if each.id == "accuracy"]
    (bound,) = check.claim.listed.values()
    assert F(1, 8) <= bound[0] <= F(1, 8) * (1 + F(1, 1000))


def test_the_largest_input_of_one_agent_is_that_of_its_strongest_pin():
    """|u| <= k |e| + |d|, k = 2 or 1, |e| <= 3, |d| <= 1/2: 13/2, with noise of 1/4 beside."""
    given = Problem(
        network=Network.from_arcs({"a": [], "b": []}, agents=1, arrow="listens_to"),
        coupling="y",
        mode_gains={"a": {"1": 2}, "b": {"1": 1}},
        region={"initial_states": [-3, 3]},
        actuators={"limit": 8, "amplitude": "1/2"},
    )
    (check,) = [each for each in agreed(given).checks if each.id == "actuators"]
    assert check.is_proved
    largest = check.claim.inputs["1"]
    assert F(13, 2) <= largest <= F(13, 2) * (1 + F(1, 1000))
    noisy = given.replace(uncertainty={"measurement": "1/4"})
    (check,) = [each for each in agreed(noisy).checks if each.id == "actuators"]
    assert check.is_proved
    assert F(7) <= check.claim.inputs["1"] <= 7 * (1 + F(1, 1000))


@pytest.mark.slow
def test_a_quadratic_proof_of_stronger_pins_is_refused_for_weaker_ones():
    """The pin of G2 at a thousandth; the certificate of the other one knows its gain."""
    strong = problem()
    weak = problem(TEXT.replace('"5/2"', '"1/400"'))
    claims = agreed(strong).claims
    (kept,) = [each for each in claims.checks if each.id == "lure"]
    assert kept.is_proved
    forged = replace(claims, problem_sha256=problem_sha256(weak))
    findings = examine(certificate_bytes(forged), canonical_bytes(weak))
    assert any(what.startswith("lure") for holds, what in findings if not holds)
    assert confirm(kept, trust(claims, loop_of(weak))) is not None


@pytest.mark.slow
@pytest.mark.parametrize("id", ["max-separable", "tolerance", "accuracy", "lemma1", "delay"])
def test_proofs_of_stronger_pins_are_refused_for_weaker_ones(id: str):
    """The same claims, with the hash of a problem whose pin in G2 is a hundredth."""
    text = TEXT
    for old, new in STRONG:
        text = text.replace(old, new)
    strong = problem(text + LOADED)
    weak = problem(text.replace('2 = "5/2", 1 = 2', '2 = "1/40", 1 = "1/50"') + LOADED)
    claims = agreed(strong).claims
    (kept, *_) = [each for each in claims.checks if each.id == id and each.mode in (None, "G2")]
    assert kept.is_proved
    forged = replace(claims, problem_sha256=problem_sha256(weak))
    findings = examine(certificate_bytes(forged), canonical_bytes(weak))
    assert any(what.startswith(id) for holds, what in findings if not holds)
    assert confirm(kept, trust(claims, loop_of(weak))) is not None
