"""Files of people whose network is no network with a target: each is told which key says what is
meant, and with that key the network is proved."""

from fractions import Fraction

import numpy as np
import pytest

from dobc_design import Problem, Verdict, certify, simulate
from dobc_design.description.words import describe
from dobc_design.errors import SpecError
from dobc_design.problem.load import read_problem_text


def read(text: str) -> Problem:
    return read_problem_text(text.encode(), folder=None)


def network(agents: int, modes: str, *, more: str = "") -> str:
    return f"""\
[network]
agents = {agents}
arrow = "listens_to"
{more}
[network.modes]
{modes}
"""


# --- Nobody is pinned
AROUND = [f"[{i}, {i % 10 + 1}, 0.5], [{i % 10 + 1}, {i}, 0.5]" for i in range(1, 11)]
RING = network(10, f"ring = [{', '.join(AROUND)}]")
NO_PINS = f'{RING}[coupling]\nh = "40*y"\n[exosystem]\nconstant = true\n[observer]\nW = [[2]]\n'


def test_a_ring_without_pins_is_asked_whether_agreement_is_meant():
    certificate = certify(read(NO_PINS))
    assert certificate.verdict is Verdict.REFUTED
    assert "The agents do agree with each other" in certificate.reason


def test_a_ring_of_sensors_agrees_on_the_average_of_the_starts():
    """The rate is the observer's: 2 1/s, below the 40 (1 - cos(pi/5)) of the ring."""
    certificate = certify(read(f'goal = "agreement"\n{NO_PINS}'))
    assert certificate.verdict is Verdict.PROVED
    assert certificate.rate == pytest.approx(2, rel=1e-3)
    assert certificate.value is not None
    assert certificate.value.weights is not None
    assert set(certificate.value.weights.values()) == {Fraction(1, 10)}


# --- Some agents oppose others
SIGNED = "g = [[1, 2], [2, 1], [2, 3, -2], [3, 2, -2], [3, 4], [4, 3], [4, 1, -1], [1, 4, -1]]"
POSITIVE = SIGNED.replace("-", "")
PULLED = '[coupling]\nh = "y"\n[pinning]\ngains = { 1 = 1 }\n'


def test_a_negative_weight_alone_does_not_say_what_it_means():
    with pytest.raises(SpecError, match=r'network\.negative[^$]*"opposes"[^$]*"repels"'):
        read(f"target = 1\n{network(4, SIGNED)}{PULLED}")


def test_couplings_that_repel_are_asked_whether_signs_are_meant():
    text = f"target = 1\n{network(4, POSITIVE)}{PULLED}"
    text += '[[coupling.exceptions]]\narcs = [[2, 3], [3, 2], [4, 1], [1, 4]]\nh = "-y"\n'
    problem = read(text)
    assert 'negative = "opposes"' in describe(problem)
    assert certify(problem).verdict is Verdict.REFUTED


def test_agents_on_two_sides_go_to_the_target_and_to_minus_the_target():
    """The rate is the least eigenvalue of the unsigned Laplacian with its pin, by NumPy."""
    text = network(4, SIGNED, more='negative = "opposes"')
    problem = read(f"target = 1\n{text}{PULLED}")
    certificate = certify(problem)
    assert certificate.verdict is Verdict.PROVED
    weights = np.array([[0, 1, 0, 1], [1, 0, 2, 0], [0, 2, 0, 1], [1, 0, 1, 0]])
    pin = np.array([1, 0, 0, 0])
    pulled = np.diag(weights.sum(axis=1) + pin) - weights
    assert certificate.rate == pytest.approx(np.linalg.eigvalsh(pulled)[0], rel=1e-2)
    run = simulate(problem, t_final=60, start=[[3], [-2], [0.5], [1]], samples=2)
    np.testing.assert_allclose(run.x[-1].ravel(), [1, 1, -1, -1], atol=1e-3)


# --- Pins that follow the mode
TURNS = """\
G1 = [[2, 1], [3, 1], [4, 1]]
G2 = [[1, 2], [3, 1], [4, 1]]
G3 = [[3, 1], [4, 1]]
"""
PINS = "G1 = { 1 = 1 }\nG2 = { 2 = 1 }\nG3 = { 2 = 1 }\n"
AGENTS = '[dynamics]\nA = [[-4, 1], [0, -1]]\nB = [[1], [0]]\n[coupling]\nh = "y1 + y2"\n'


def test_pins_of_modes_below_gains_are_answered_with_their_table():
    with pytest.raises(SpecError, match=r"G1 is a mode[^$]*\[pinning\.modes\]: G1"):
        read(f"{network(4, TURNS)}{AGENTS}[pinning.gains]\n{PINS}")


def test_pins_of_modes_hold_agents_with_dynamics_under_any_switching():
    """The rate is that of e'e: the least of half the eigenvalues of the symmetric parts."""
    certificate = certify(read(f"{network(4, TURNS)}{AGENTS}[pinning.modes]\n{PINS}"))
    assert certificate.verdict is Verdict.PROVED
    assert certificate.covered_by == "lemma1"
    A = np.array([[-4, 1], [0, -1]])
    BK = np.array([[1, 1], [0, 0]])
    modes = [([(1, 0), (2, 0), (3, 0)], 0), ([(0, 1), (2, 0), (3, 0)], 1), ([(2, 0), (3, 0)], 1)]
    rates = []
    for arcs, pinned in modes:
        L = np.zeros((4, 4))
        L[pinned, pinned] = 1
        for i, j in arcs:
            L[i, i] += 1
            L[i, j] -= 1
        M = np.kron(np.eye(4), A) - np.kron(L, BK)
        rates.append(-np.linalg.eigvalsh((M + M.T) / 2)[-1])
    assert certificate.rate == pytest.approx(min(rates), rel=1e-3)
