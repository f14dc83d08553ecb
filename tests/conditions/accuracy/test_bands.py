"""Final bounds under sines of unknown frequencies: known answers, runs, what else the table goes
with."""

from fractions import Fraction
from functools import cache

import numpy as np
import pytest
from oracles.sines import drawn_network, reached_errors, worst_errors

import dobc_design as dd
from dobc_design import Verdict
from dobc_design.certificate.certificate import Certificate
from dobc_design.conditions.accuracy.decide import Accuracy
from dobc_design.errors import SpecError
from dobc_design.loop.make import loop_of
from dobc_design.problem.load import read_problem_text

#: The paper's A, C and W leave 0.103995 of a sine in this band.
LOAD = 0.103995 / 2
TEXT = """
{top}
[network]
agents = 3
arrow = "listens_to"
modes.G = [[2, 1], [3, 2]]
{modes}
[coupling]
h = "{h}"
{pinning}
[exosystem]
bands = [[1.8, 2.2]]
amplitude = 0.5
A = [[0, 2], [-2, 0]]
C = [[1, 0]]
{groups}
{observer}
{more}
"""
GIVEN = "[observer]\nW = [['16/5'], ['12/5']]"
BOX = "[region]\ninitial_states = [-1, 1]\ninitial_disturbance = 0.1\n"
PINNED = "[pinning]\ngains = { 1 = 5 }"


@cache
def certified(
    more: str = "",
    *,
    h: str = "y",
    modes: str = "",
    top: str = "",
    pinning: str = PINNED,
    groups: str = "",
    observer: str = GIVEN,
) -> Certificate:
    text = TEXT.format(
        top=top, modes=modes, h=h, pinning=pinning, groups=groups, observer=observer, more=more
    )
    certificate = dd.certify(read_problem_text(text.encode(), folder=None))
    assert dd.verify(certificate, certificate.problem).holds
    return certificate


def bounds(certificate: Certificate) -> list[float]:
    check = certificate.check("accuracy")
    assert check.verdict is Verdict.PROVED, check.reason
    assert isinstance(check.claim, Accuracy)
    return [float(v[0]) for v in check.claim.listed.values()]


def test_a_chain_ends_where_the_loads_add_up_to():
    """e_1' = -5 e_1 + r_1, e_i' = e_(i-1) - e_i + r_i, |r_i| <= 0.103995/2: in two modes
    what the sizes add up to, in one less, since a lag passes on 1/2 of a sine of 2 rad/s."""
    wanted = [LOAD / 5, LOAD / 5 + LOAD, LOAD / 5 + 2 * LOAD]
    found = bounds(certified(modes="modes.H = [[2, 1], [3, 2]]"))
    assert found == pytest.approx(wanted, rel=1e-4)
    assert all(x >= least for x, least in zip(found, wanted, strict=True))
    certificate = certified()
    assert max(bounds(certificate)) < 0.75 * wanted[2]
    assert bounds(certificate)[0] >= LOAD / np.hypot(5, 2.2)
    assert certificate.verdict is Verdict.PROVED
    assert "with a sine of 1.8 to 2.2 rad/s" in str(certificate)
    assert "of amplitude up to 0.5" in str(certificate)


def test_the_differences_of_agents_that_agree_feel_the_sines_of_both():
    """Of 1 and 2, that hear each other: e' = -2 e + r_1 - r_2."""
    modes = "modes.H = [[1, 2], [2, 1], [3, 1], [3, 2]]"
    text = TEXT.replace("modes.G = [[2, 1], [3, 2]]\n", "")
    problem = read_problem_text(
        text.format(
            top='goal = "agreement"',
            modes=modes,
            h="y",
            pinning="",
            groups="",
            observer=GIVEN,
            more="",
        ).encode(),
        folder=None,
    )
    certificate = dd.certify(problem)
    claim = certificate.check("accuracy").claim
    assert isinstance(claim, Accuracy)
    # labels of pairs begin with those of their agents
    first = next(iter(claim.listed.values()))
    assert float(first[0]) == pytest.approx(LOAD, rel=1e-4)


def test_the_load_is_added_to_what_uncertainty_states():
    """A disturbance of 0.1 passes 0.1 (1 + 1.33276): theory, section 12."""
    found = bounds(certified("[uncertainty]\ndisturbance = 0.1"))
    assert found[0] == pytest.approx((0.233276 + LOAD) / 5, rel=1e-3)


@pytest.mark.slow
def test_inputs_compensate_the_sines_too():
    """|u_3| <= |d| + the sine + what is left of it + the error of the estimate."""
    text = f"{BOX}[actuators]\nlimit = 9\namplitude = 1"
    loose = certified(text, h="tanh(y)")
    without = dd.certify(loose.problem.replace(uncertainty=None))

    def input_of(certificate: Certificate) -> float:
        check = certificate.check("actuators")
        assert check.verdict is Verdict.PROVED, check.reason
        assert check.exact is not None
        return float(Fraction(check.exact["inputs"]["3"]))

    assert "and no input exceeds the limit of 9" in str(loose)
    # the error of the estimate may have a smaller share of another box
    assert input_of(loose) >= input_of(without) + 0.5 - 0.05
    # C xi of amplitude 1 and the sine, when they are in phase
    start = {"x": [[0], [0], [0]], "xi": [[1, 0], [1, 0], [1, 0]], "xihat": [[1, 0]] * 3}
    run = dd.simulate(loose.problem, start=start, t_final=60, samples=601, tolerance=1e-5)
    largest = np.abs(run.u[:, 2]).max()
    assert 1.4 < largest < input_of(loose)


def test_agents_without_a_disturbance_feel_no_sine_of_their_own():
    certificate = certified(
        f"{BOX}", h="tanh(y)", groups="[[exosystem.groups]]\nagents = [2]\nnone = true"
    )
    problem = certificate.problem
    start = {"x": [[0], [0], [0]]}
    run = dd.simulate(
        problem, stress="worst", seed=1, start=start, t_final=20, samples=201, tolerance=1e-6
    )
    late = np.abs(run.x[120:, :, 0]).max(axis=0)
    assert np.all(late <= bounds(certificate))
    # the sine of agent 2 would leave all of its amplitude, 1/2
    assert late[1] < 0.1


UNDECIDED = [
    ("modes.H = [[3, 1], [2, 3, 20]]", '[switching]\nguarantee = "dwell"\ndwell = 1', "arbitrary"),
    ("", "[readings]\ndelay = 0.01", r"[exosystem] bands is not counted with late readings"),
    ("", "[processor]\nperiod = 0.01", r"[exosystem] bands is not counted with late readings"),
]


@pytest.mark.parametrize(("modes", "more", "why"), UNDECIDED)
def test_what_is_not_known_beside_bands_is_left_open(modes, more, why):
    certificate = certified(more, modes=modes)
    assert certificate.verdict is Verdict.UNDECIDED
    assert why in str(certificate)


@pytest.mark.slow
def test_where_the_sines_are_too_large_it_says_without_what_it_would_hold():
    text = BOX + "[uncertainty]\nmeasurement = 0"
    small = certified(text, h="tanh(y)")
    table = {"bands": [["1.8", "2.2", 40]]}
    large = dd.certify(small.problem.replace(uncertainty=table))
    assert small.verdict is Verdict.PROVED
    assert large.verdict is Verdict.UNDECIDED
    assert "with a sine of 1.8 to 2.2 rad/s" in str(large)


def test_errors_get_no_bound_that_goes_to_zero():
    certificate = certified(BOX, h="tanh(y)")
    with pytest.raises(SpecError, match="acts on the plant for ever"):
        certificate.bound([1.0])


def test_a_designed_gain_leaves_a_tenth_at_most():
    problem = certified(observer="").problem
    claim = certified(observer="").check("accuracy").claim
    assert isinstance(claim, Accuracy)
    assert claim.peaks is not None
    assert float(claim.peaks.bands[0][0][0]) <= 0.1
    assert loop_of(problem).groups[0].observer.W is None


def test_a_whole_design_leaves_little_too():
    problem = certified().problem
    design = dd.design(problem)
    assert design.is_proved
    claim = dd.certify(design.problem).check("accuracy").claim
    assert isinstance(claim, Accuracy)
    assert claim.peaks is not None
    assert float(claim.peaks.bands[0][0][0]) <= 0.15
    assert design.problem.uncertainty == problem.uncertainty


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "coupling"), [(1, "y"), (2, "tanh(y)")])
def test_no_run_at_the_worst_frequencies_leaves_the_bounds(seed, coupling):
    """Linear networks come to most of the bound at phases and frequencies that are possible."""
    network = drawn_network(seed, coupling)
    certificate = dd.certify(network.problem)
    found = np.array(bounds(certificate))
    assert np.all(reached_errors(network, seed) <= found)
    if coupling == "y":
        worst = worst_errors(network)
        assert np.all(worst <= found)
        assert np.any(worst > found / 2)


@pytest.mark.slow
def test_the_package_runs_at_the_worst_frequency_it_finds():
    """Alone with k = 5 and 1 an agent answers most to the end 11/5 where more is left."""
    network = drawn_network(1, "y")
    run = dd.simulate(network.problem, stress="worst", seed=0, t_final=20, samples=401)
    late = np.abs(run.x[200:, 0, 0]).max()
    assert late == pytest.approx(worst_errors(network)[0], rel=0.02)
    assert late <= bounds(dd.certify(network.problem))[0]
