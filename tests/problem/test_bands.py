"""[exosystem] bands: what a file may say of sines of unknown frequencies, none of which is lost."""

import pickle
from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from problem_texts import CHAIN

import dobc_design as dd
from dobc_design import Problem
from dobc_design.description.words import describe
from dobc_design.designer.source import python_source
from dobc_design.errors import SpecError
from dobc_design.problem.canonical import (
    canonical_bytes,
    canonical_document,
    problem_from_canonical,
)
from dobc_design.problem.changes import changed_file, changed_problem, problem_text
from dobc_design.problem.load import read_problem_text
from dobc_design.problem.uncertainty import Uncertainty

FILE = CHAIN + "[exosystem]\n"
HUM = "bands_hz = [[49.5, 50.5]]\namplitude = 2\n"
WAVE = "bands = [[1.8, 2.2]]\namplitude = 0.5\n"


def read(text: str) -> Problem:
    return read_problem_text((FILE + text).encode(), folder=None)


def bands_of(problem: Problem) -> list[tuple[Fraction, ...]]:
    table = problem.uncertainty
    assert table is not None
    return [tuple(band) for band in table.bands or ()]


def frequencies(problem: Problem) -> list[float]:
    """Of the poles of A, rad/s."""
    assert problem.exosystem is not None
    A = problem.exosystem.A
    return sorted(float(A[k][k + 1]) for k in range(len(A) - 1) if A[k][k + 1])


def test_a_band_is_exact_and_gives_the_model_a_pair_of_poles_inside():
    problem = read(WAVE)
    assert bands_of(problem) == [(Fraction(9, 5), Fraction(11, 5), Fraction(1, 2))]
    (w,) = frequencies(problem)
    assert w == pytest.approx(4.04**0.5, abs=1e-7)  # the middle of w^2


def test_a_band_in_hertz_becomes_no_narrower():
    ((low, high, amplitude),) = bands_of(read(HUM))
    assert amplitude == 2
    pi = Fraction("3.14159265358979323846")
    assert 0 < 99 * pi - low < Fraction(1, 10**8)
    assert 0 < high - 101 * pi < Fraction(1, 10**8)


def test_pairs_and_amplitudes_are_those_of_each_band():
    text = "bands = [[1, 2], [5, 6]]\nbands_hz = [[2, 3]]\namplitude = [1, 2, 3]\npairs = 2\n"
    problem = read(text + "constant = true")
    assert [band[2] for band in bands_of(problem)] == [1, 2, 3]
    assert problem.q == 1 + 2 * 2 * 3


def test_poles_beside_a_band_are_kept_and_the_same_one_stands_once():
    assert frequencies(read(f"{WAVE}A = [[0, 3], [-3, 0]]\nC = [[1, 0]]")) == [3]
    assert len(frequencies(read(f"{WAVE}frequencies = [1]"))) == 2
    same = "bands = [[2, 2], [2, 2]]\namplitude = 1\nfrequencies = [2.0]"
    assert frequencies(read(same)) == [2]
    assert len(bands_of(read(same))) == 2


def test_a_wide_range_of_frequencies_is_read():
    for low, high in (("1e-90", "2e-90"), ("1e90", "2e90"), ("0", "1e-9")):
        assert 0 < frequencies(read(f"bands = [[{low}, {high}]]\namplitude = 1"))[0] < float(high)


PARTS = st.fractions(min_value=0, max_value=40, max_denominator=50)
BANDS = st.tuples(PARTS, PARTS, PARTS).map(
    lambda x: (min(x[:2]), max(x[:2]) + 1, x[2] + Fraction(1, 3))
)
#: What may stand beside, in [exosystem] and after it.
BESIDE = [
    "",
    "constant = true",
    "A = [[0]]\nC = [[1]]",
    "[[exosystem.groups]]\nagents = [2]\nnone = true",
    "[[exosystem.groups]]\nagents = [1]\nhz = [1]",
    "[[exosystem.groups]]\nagents = [1, 2]\nhz = [1]\n"
    "[[exosystem.groups]]\nagents = [3]\nconstant = true",
    "[[exosystem.groups]]\nagents = [1]\nhz = [1]\n[[exosystem.groups]]\nagents = [3]\nnone = true",
    "[observer]\nW = [[3], [1]]",
    "[uncertainty]\ndrift = 0.1",
    "[uncertainty]\nweights = 0.1\nknown_to_agents = false",
]


@given(bands=st.lists(BANDS, min_size=1, max_size=3, unique_by=sum), beside=st.sampled_from(BESIDE))
@settings(max_examples=60, deadline=None)
def test_every_way_to_write_a_problem_keeps_its_bands(bands, beside):
    bands = bands[:1] if "W =" in beside else bands
    ends = [[f"{x}" for x in band[:2]] for band in bands]
    sizes = [f"{band[2]}" for band in bands]
    problem = read(f"bands = {ends}\namplitude = {sizes}\n{beside}\n")
    assert bands_of(problem) == bands
    data = canonical_bytes(problem)
    assert canonical_document(problem)["version"] == 4
    spaces: dict[str, Problem] = {}
    exec(python_source(problem), spaces)  # noqa: S102 - what the package itself has written
    written = problem_text(problem).encode()
    again = {
        "problem.json": problem_from_canonical(data),
        "a file": read_problem_text(written, folder=None),
        "a pickle": pickle.loads(pickle.dumps(problem)),
        "a change": changed_problem(problem, {}),
        "Python": spaces["problem"],
    }
    for way, other in again.items():
        assert canonical_bytes(other) == data, way


def test_a_change_of_a_gain_leaves_the_bands_as_they_were_written(tmp_path):
    text = FILE + HUM + "pairs = 2\n"
    problem = read(HUM + "pairs = 2\n")
    changes = {"pinning.gains": {"1": 4}}
    kept = changed_file(problem, changes, text=text, folder=tmp_path)
    assert HUM in kept
    anew = changed_file(problem, changes, text=None, folder=tmp_path)
    assert bands_of(read_problem_text(anew.encode(), folder=None)) == bands_of(problem)
    assert "[uncertainty]" not in anew


def test_without_bands_problem_json_stays_as_it_was():
    document = canonical_document(read("constant = true\n[uncertainty]\ndrift = 0.1"))
    assert document["version"] == 1
    assert "bands" not in document["uncertainty"]


ENDS = r"must be \[low, high\] with 0 <= low <= high, and 1e-100 < high < 1e100 rad/s; got "
DISCRETE = "A = [[1]]\nC = [[1]]\n[dynamics]\ntime = 'discrete'"
SATURATING = (
    "[actuators]\nlimit = 9\namplitude = 1\nsaturates = true\n"
    "[region]\ninitial_states = [-1, 1]\ninitial_disturbance = 0"
)
WRONG = [
    ("bands = [[1.8, 2.2]]", "exosystem.amplitude is required with bands and missing"),
    ("bands = [[2.2, 1.8]]\namplitude = 1", rf"exosystem.bands\[0\] {ENDS}\[11/5, 9/5\]"),
    ("bands = [[-1, 1]]\namplitude = 1", rf"exosystem.bands\[0\] {ENDS}\[-1, 1\]"),
    ("bands = [[0, 0]]\namplitude = 1", rf"exosystem.bands\[0\] {ENDS}\[0, 0\]"),
    ("bands = [[1, '1e400']]\namplitude = 1", rf"exosystem.bands\[0\] {ENDS}\[1, 1e400\]"),
    ("bands_hz = [[1, 2], [2, 1]]\namplitude = 1", rf"exosystem.bands_hz\[1\] {ENDS}"),
    ("bands = [1.8, 2.2]\namplitude = 1", "exosystem.bands must be a list of pairs"),
    ("bands = []\namplitude = 1", "exosystem.bands must be a list of pairs"),
    ("bands = [[1, 2, 3]]\namplitude = 1", "exosystem.bands must be a list of pairs"),
    ("bands = 'low'\namplitude = 1", "exosystem.bands must be a list of pairs"),
    ("bands = [['low', 2]]\namplitude = 1", r"exosystem.bands\[0\] must be a number"),
    (f"{WAVE[:-4]}0", "exosystem.amplitude must be > 0, because it bounds the sine; got 0"),
    (f"{WAVE[:-4]}[1, 2]", "must be one number, or one for each of 1 bands; got 2"),
    (f"{WAVE[:-4]}'much'", "exosystem.amplitude must be a number"),
    ("amplitude = 1\nconstant = true", "exosystem.amplitude belongs to bands, and there are none"),
    ("pairs = 2\nconstant = true", "exosystem.pairs belongs to bands, and there are none"),
    (f"{WAVE}pairs = 0", "exosystem.pairs must be an integer from 1 to 10; got 0"),
    (f"{WAVE}pairs = 11", "exosystem.pairs must be an integer from 1 to 10; got 11"),
    (f"{WAVE}pairs = 1.5", "exosystem.pairs must be an integer from 1 to 10; got 1.5"),
    (f"{WAVE}pairs = true", "exosystem.pairs must be an integer from 1 to 10; got True"),
    ("constant = true\n[uncertainty]\nbands = [[1, 2]]", r"it belongs in \[exosystem\]"),
    (f"{WAVE}{DISCRETE}", 'exosystem.bands is not known with dynamics.time = "discrete"'),
    (f"{WAVE}{SATURATING}", "exosystem.bands is not known together with actuators.saturates"),
]


def test_a_band_that_is_reversed_and_a_missing_amplitude_are_said_at_once():
    with pytest.raises(SpecError, match=rf"amplitude is required [^|]*bands\[0\] {ENDS}") as raised:
        read("bands = [[2.2, 1.8]]")
    assert len(raised.value.errors) == 2


@pytest.mark.parametrize(("text", "told"), WRONG)
def test_what_cannot_be_is_refused_by_its_key_with_a_cure(text, told):
    with pytest.raises(SpecError, match=told) as caught:
        read(text)
    assert len(caught.value.errors) == 1


PYTHON = [
    ([[1, 2]], r"uncertainty.bands\[0\] must be \[low, high, amplitude\]"),
    ([[1, 2, -1]], r"uncertainty.bands\[0\] must be > 0"),
    ([[2, 1, 1]], r"uncertainty.bands\[0\] must be \[low, high\]"),
    ("1 2", "uncertainty.bands must be a list of bands"),
]


@pytest.mark.parametrize(("bands", "told"), PYTHON)
def test_in_python_the_key_is_that_of_uncertainty(bands, told):
    with pytest.raises(SpecError, match=told):
        Uncertainty(bands=bands)


def test_sines_that_no_observer_makes_less_of_are_no_bands():
    network = dd.Network.from_arcs([[2, 1]], arrow="listens_to")
    with pytest.raises(SpecError, match=r"uncertainty.bands has no meaning without an"):
        Problem(network=network, coupling="y", gains=1, uncertainty={"bands": [[1, 2, 1]]})


def test_the_description_says_what_acts():
    told = str(describe(read(WAVE)))
    assert "the disturbance of every agent has a sine of 1.8 to 2.2 rad/s" in told
    assert "of amplitude up to 0.5" in told
