"""What a problem means in words, and slips: each is named, and a sound problem draws no remark."""

import re
from typing import Any

import pytest

from dobc_design import Exosystem, Network, Observer, Problem, Switching, exosystems
from dobc_design.description.meaning import disturbance_words, remarks, time_words
from dobc_design.problem.load import builtin_names, load_problem

SINE = Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]])
CHAIN = [(1, 2), (2, 3), (3, 4)]


def heard(arcs: Any, n: int = 4) -> dict[str, Any]:
    return {"network": Network.from_arcs(arcs, arrow="listens_to", agents=n)}


STARTS = {"initial_states": [0, 2], "initial_disturbance": "1/2"}
SOUND: dict[str, Any] = {
    **heard(CHAIN),
    "coupling": "tanh(y)",
    "gains": {4: 2},
    "target": 1,
    "exosystem": SINE,
    "region": STARTS,
}


@pytest.mark.parametrize(
    ("exosystem", "words"),
    [
        (exosystems.constant(), "constant"),
        (exosystems.ramp(), "constant and ramp"),
        (exosystems.polynomial(2), "polynomial of degree 2"),
        (SINE, "sine of 2 rad/s (0.3183 Hz, period 3.142 s)"),
        (
            exosystems.total(exosystems.constant(), exosystems.harmonics("3.14159265358979")),
            "constant + sine of 3.142 rad/s (0.5 Hz, period 2 s)",
        ),
        (exosystems.stacked(exosystems.ramp(), exosystems.constant()), "constant and ramp"),
        (
            Exosystem(A=[[-1, 2], [-2, -1]], C=[[1, 0]]),
            "sine of 2 rad/s (0.3183 Hz, period 3.142 s, decaying like exp(-1 t))",
        ),
        (Exosystem(A=[[3]], C=[[1]]), "a part growing like exp(3 t)"),
        (Exosystem(A=[[0, 2], [-2, 0]], C=[[0, 0]]), "none: the exosystem never reaches d"),
    ],
)
def test_the_disturbance_in_words(exosystem: Exosystem, words: str):
    problem = Problem(**SOUND | {"exosystem": exosystem})
    assert disturbance_words(problem, problem.groups[0]) == words


WIDE = {"initial_states": [-180, 180], "initial_disturbance": "1/2"}
TWO_MODES = Network.from_arcs({"a": CHAIN, "b": [*CHAIN, (1, 3)]}, arrow="listens_to", agents=4)
PLANE = Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0], [0, 0]])
SLIPS: tuple[tuple[str, dict[str, Any], str], ...] = (
    (
        "a sign in A",
        {"exosystem": Exosystem(A=[[0, 2], [2, 0]], C=[[1, 0]])},
        "grows like exp(2 t). A sign missing",
    ),
    (
        "two equal sines",
        {
            "exosystem": Exosystem(
                A=[[0, 2, 1, 0], [-2, 0, 0, 1], [0, 0, 0, 2], [0, 0, -2, 0]], C=[[1, 0, 0, 0]]
            )
        },
        "grows without limit",
    ),
    ("a degree too much", {"exosystem": exosystems.polynomial(3)}, "grows without limit"),
    (
        "C misses a part",
        {"exosystem": Exosystem(A=[[0, 2, 0], [-2, 0, 0], [0, 0, 0]], C=[[1, 0, 0]])},
        "The constant does not appear in d",
    ),
    (
        "C is zero",
        {"exosystem": Exosystem(A=[[0, 2], [-2, 0]], C=[[0, 0]])},
        "does not appear in d",
    ),
    ("what fades", {"exosystem": Exosystem(A=[[-1]], C=[[1]])}, "decays by itself"),
    ("nobody pinned", {"gains": {}}, "No agent is pinned"),
    (
        "arrows turned round",
        {"network": Network.from_arcs(CHAIN, arrow="sends_to", agents=4)},
        "with the other network.arrow",
    ),
    ("a deaf pin", {"gains": {1: 2}}, "Agent 1 is pinned, but nobody listens to it"),
    ("an empty mode", heard({"a": CHAIN, "b": []}), "In mode b nobody listens"),
    ("a mode twice", heard({"a": CHAIN, "b": CHAIN}), "Modes a and b have the same arcs"),
    (
        "a weight in another unit",
        heard([(1, 2), (2, 3), (3, 4, 5_000_000)]),
        "weights of the arcs differ",
    ),
    (
        "a gain in another unit",
        {"gains": {4: 2, 3: 3_000_000}},
        "gains differ by more than a factor of a million",
    ),
    ("a sign in h", {"coupling": "-tanh(y)"}, "repels near 0"),
    ("a cube", {"coupling": "y**3"}, "vanishes to first order"),
    ("a logarithm", {"coupling": "log(1 + y)"}, "is not defined for y <= -1"),
    ("a pole", {"coupling": "tan(y)"}, "pushes neighbours apart for |y| > 1.6 (about)"),
    (
        "a sine too far",
        {"coupling": "sin(y)"},
        "falls, so that agents pull less for |y| > 1.6 (about)",
    ),
    ("degrees", {"coupling": "sin(y)", "region": WIDE}, "sin, cos and tan take radians"),
    ("an even coupling", {"coupling": "abs(y)"}, "pushes neighbours apart for y < 0"),
    ("one side only", {"coupling": "max(y, 0)"}, "is 0, so that agents do not react for y < 0"),
    (
        "an exponential too far",
        {"coupling": "exp(y) - 1", "region": WIDE},
        "over the region; the region allows",
    ),
    (
        "a saturation too low",
        {"coupling": "tanh(50*y)/10", "region": WIDE},
        "saturates: it never exceeds 0.1",
    ),
    ("a target outside", {"target": 5}, "The target 5 is outside region.initial_states [0, 2]"),
    (
        "one start only",
        {"region": {"initial_states": [1, 1], "initial_disturbance": 1}},
        "single point 1",
    ),
    ("an offset outside", {"offsets": {2: 7}}, "The goal (target + offset) of 2 is outside"),
    (
        "no error allowed",
        {"region": STARTS | {"initial_disturbance": 0}},
        "only if every observer starts",
    ),
    ("a sign in W", {"observer": Observer(W=[[-3], [1]])}, "estimation error does not decay"),
    ("a start outside", {"simulation": {"x0": [9]}}, "simulation.x0 is outside"),
    ("a run at rest", {"simulation": {"xi0": [0, 0]}}, "the simulated runs have no disturbance"),
    (
        "one mode for ever",
        {"switching": Switching(signal="random", dwell=50), "simulation": {"t_final": 20}},
        "switching.dwell = 50 s is longer",
    ),
    (
        "a damped sine",
        {
            "exosystem": exosystems.stacked(
                exosystems.constant(), Exosystem(A=[[-1, 2], [-2, -1]], C=[[1, 0]])
            )
        },
        "decays by itself: sine of 2 rad/s",
    ),
    ("a row of zeros in C", {"exosystem": PLANE, "target": [1, 1]}, "acts on state component 2"),
    ("an agent too many", heard(CHAIN, 5), "without any arc: 5"),
    ("two chains", heard([(1, 2), (3, 4)]), "No path of arcs leads from a pinned agent to 1, 2"),
    ("an offset forgotten", {"offsets": {2: "1/2", 3: "1/2"}}, "2, 3 have the same goal"),
    (
        "an error in another unit",
        {"region": STARTS | {"initial_disturbance": 5000}},
        "initial_disturbance = 5000 and the width 2",
    ),
    (
        "a disturbance larger than asked",
        {"simulation": {"xi0": [3, 4]}},
        "simulation.xi0 has length 5, more than",
    ),
    (
        "a sign in P",
        {"observer": Observer(W=[[3], [1]], P=[[1, 2], [2, 1]])},
        "P is not positive definite",
    ),
    (
        "a rate beside W",
        {"observer": Observer(W=[[3], [1]], rate=2)},
        "observer.rate has no effect",
    ),
    (
        "one pole of W too fast",
        {"observer": Observer(W=[[40001], [19998]])},
        "The observer (2.5e-05 s) is more than 1000 times faster",
    ),
    (
        "rad per ms",
        {"exosystem": exosystems.harmonics(31416)},
        "Hz, or rad per ms, in place of rad/s?",
    ),
    ("Hz for rad/s", {"exosystem": exosystems.harmonics("0.01")}, "needs 628 s for a period"),
    (
        "a gain in micro",
        {"gains": {4: "1/1000000"}},
        "Is a gain, a rate or a frequency in another unit?",
    ),
    (
        "a run too short",
        {"simulation": {"t_final": "1/10"}},
        "is shorter than the slowest time constant, 1 s",
    ),
    (
        "a run too long",
        {"simulation": {"t_final": 100_000}},
        "more than 10000 times the slowest time constant",
    ),
    (
        "nothing happens",
        {"exosystem": None, "region": None, "simulation": {"x0": [1]}},
        "in the runs nothing happens",
    ),
    (
        "a dwell time in ms",
        {"switching": Switching(signal="random", dwell="1/100000")},
        "far below every time scale",
    ),
    (
        "switching alone",
        {"switching": Switching(signal="random", dwell=1)},
        "There is one mode only",
    ),
    (
        "a mode left out",
        {"network": TWO_MODES, "switching": Switching(signal="periodic", dwell=1, sequence=["a"])},
        "never makes b active",
    ),
    (
        "a chain that stops",
        {
            "network": TWO_MODES,
            "switching": Switching(signal="markov", generator=[[-1, 1], [0, 0]]),
        },
        "never leaves b",
    ),
)


@pytest.mark.parametrize(
    ("changes", "words"), [slip[1:] for slip in SLIPS], ids=[slip[0] for slip in SLIPS]
)
def test_a_slip_is_named(changes: dict[str, Any], words: str):
    assert any(words in remark for remark in remarks(Problem(**SOUND | changes)))


@pytest.mark.parametrize(
    ("xi0", "words"),
    [
        (["3/10", "2/5"], "period 3.142 s, amplitude 0.5 in simulations)"),  # sqrt(0.3^2 + 0.4^2)
        ([[0, 0], [0, "1/4"], [0, 0], ["1/8", 0]], "amplitude 0.25 in simulations)"),
    ],
)
def test_the_amplitude_is_said_where_it_is_known(xi0: Any, words: str):
    problem = Problem(**SOUND | {"simulation": {"xi0": xi0}})
    assert words in disturbance_words(problem, problem.groups[0])


def test_close_sines_have_amplitudes_of_their_own():
    problem = Problem(
        **SOUND
        | {
            "exosystem": exosystems.total(
                exosystems.constant(), exosystems.harmonics(["1e-7", 10**6, "1000000.5"])
            ),
            "simulation": {"xi0": [3, 1, 0, 1, 0, 5, 0]},
        }
    )
    words = disturbance_words(problem, problem.groups[0])
    assert re.findall(r"(\d+) in simulations", words) == ["3", "1", "1", "5"]


def test_the_time_scales_of_a_chain_are_those_of_its_diagonal():
    """J of the chain is triangular: -1 for who listens, -2 for the pin; the sine has 2 rad/s."""
    words = (
        "fastest 0.5 s (network), slowest 1 s (network); sample and integrate with steps of at "
        "most 0.05 s"
    )
    assert time_words(Problem(**SOUND | {"exosystem": exosystems.harmonics(1)})) == words


def test_a_sound_problem_draws_no_remark():
    assert remarks(Problem(**SOUND)) == ()


def test_numbers_that_no_float_holds_stop_no_remark():
    exosystem = Exosystem(A=[["1e400"]], C=[[1]])
    given = {
        "exosystem": exosystem,
        "gains": {4: "1e400"},
        "target": "1e400",
        "simulation": {"t_final": "1e400"},
    }
    assert "A sign missing in exosystem.A?" in "".join(remarks(Problem(**SOUND | given)))


@pytest.mark.parametrize("name", builtin_names())
def test_the_built_in_problems_draw_no_remark(name: str):
    assert remarks(load_problem(name)) == ()
