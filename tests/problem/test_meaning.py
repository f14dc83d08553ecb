"""What a problem means in words, and slips: each is named, and a sound problem draws no remark."""

from __future__ import annotations

from typing import Any

import pytest

from dobc_design.problem import exosystems
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.groups import Observer
from dobc_design.problem.load import builtin_names, load_problem
from dobc_design.problem.meaning import disturbance_words, remarks
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem
from dobc_design.problem.settings import Switching

SINE = Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]])
CHAIN = [(1, 2), (2, 3), (3, 4)]
SOUND: dict[str, Any] = {
    "network": Network.from_arcs(CHAIN, arrow="listens_to", agents=4),
    "coupling": "tanh(y)",
    "gains": {4: 2},
    "target": 1,
    "exosystem": SINE,
    "region": {"initial_states": [0, 2], "initial_disturbance": "1/2"},
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
    assert disturbance_words(exosystem) == words


SLIPS: tuple[tuple[str, dict[str, Any], str], ...] = (
    ("a sign in A", {"exosystem": Exosystem(A=[[0, 2], [2, 0]], C=[[1, 0]])}, "grows like exp(2 t). A sign missing"),
    (
        "two equal sines",
        {"exosystem": Exosystem(A=[[0, 2, 1, 0], [-2, 0, 0, 1], [0, 0, 0, 2], [0, 0, -2, 0]], C=[[1, 0, 0, 0]])},
        "grows without limit",
    ),
    ("a degree too much", {"exosystem": exosystems.polynomial(3)}, "grows without limit"),
    (
        "C misses a part",
        {"exosystem": Exosystem(A=[[0, 2, 0], [-2, 0, 0], [0, 0, 0]], C=[[1, 0, 0]])},
        "The constant does not appear in d",
    ),
    ("C is zero", {"exosystem": Exosystem(A=[[0, 2], [-2, 0]], C=[[0, 0]])}, "does not appear in d"),
    ("what fades", {"exosystem": Exosystem(A=[[-1]], C=[[1]])}, "decays by itself"),
    ("nobody pinned", {"gains": {}}, "No agent is pinned"),
    (
        "arrows turned round",
        {"network": Network.from_arcs(CHAIN, arrow="sends_to", agents=4)},
        "with the other network.arrow",
    ),
    ("a deaf pin", {"gains": {1: 2}}, "Agent 1 is pinned, but nobody listens to it"),
    (
        "an empty mode",
        {"network": Network.from_arcs({"a": CHAIN, "b": []}, arrow="listens_to", agents=4)},
        "In mode b nobody listens",
    ),
    (
        "a mode twice",
        {"network": Network.from_arcs({"a": CHAIN, "b": CHAIN}, arrow="listens_to", agents=4)},
        "Modes a and b have the same arcs",
    ),
    (
        "a weight in another unit",
        {"network": Network.from_arcs([(1, 2), (2, 3), (3, 4, 5_000_000)], arrow="listens_to", agents=4)},
        "weights of the arcs differ",
    ),
    ("a gain in another unit", {"gains": {4: 2, 3: 3_000_000}}, "gains differ by more than a factor of a million"),
    ("a sign in h", {"coupling": "-tanh(y)"}, "repels near 0"),
    ("a cube", {"coupling": "y**3"}, "vanishes to first order"),
    ("a logarithm", {"coupling": "log(1 + y)"}, "is not defined for y <= -1"),
    ("a pole", {"coupling": "tan(y)"}, "falls for |y| above about 1.6"),
    ("a sine too far", {"coupling": "sin(y)"}, "falls for |y| above about 1.6"),
    ("a target outside", {"target": 5}, "The target 5 is outside region.initial_states [0, 2]"),
    ("one start only", {"region": {"initial_states": [1, 1], "initial_disturbance": 1}}, "single point 1"),
    ("an offset outside", {"offsets": {2: 7}}, "The goal (target + offset) of 2 is outside"),
    (
        "no error allowed",
        {"region": {"initial_states": [0, 2], "initial_disturbance": 0}},
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
)


@pytest.mark.parametrize(("changes", "words"), [slip[1:] for slip in SLIPS], ids=[slip[0] for slip in SLIPS])
def test_a_slip_is_named(changes: dict[str, Any], words: str):
    assert any(words in remark for remark in remarks(Problem(**SOUND | changes)))


def test_a_sound_problem_draws_no_remark():
    assert remarks(Problem(**SOUND)) == ()


@pytest.mark.parametrize("name", builtin_names())
def test_remarks_on_the_built_in_problems_are_about_large_differences_only(name: str):
    assert [each for each in remarks(load_problem(name)) if " falls for |y| " not in each] == []
