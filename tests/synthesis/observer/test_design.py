"""design_observer: what it says is proved for the rounded W, and checked here again; wrong requests
name their key."""

import math
from fractions import Fraction

import numpy as np
import pytest
from networks import floats, linked
from oracles.observers import control_norm, sampled_in_floats

import dobc_design as dd
from dobc_design.conditions.observer.decide import sampled_verdict
from dobc_design.errors import SpecError
from dobc_design.exact.matrix import multiply, subtract, to_float, transpose
from dobc_design.exact.polynomial import decide_hurwitz
from dobc_design.loop.make import loop_of
from dobc_design.synthesis.observer.claim import (
    Cone,
    Disk,
    HalfPlane,
    NoiseLimit,
    read_observer_request,
)
from dobc_design.synthesis.observer.decide import channel, noise_statement, rate_holds
from dobc_design.verdict import Verdict

SHAPES = {
    "constant": dd.exosystems.constant(),
    "ramp": dd.exosystems.ramp(),
    "harmonic": dd.exosystems.harmonics(2),
    "periodic": dd.exosystems.periodic(1, harmonics_kept=1),
    "two outputs": dd.exosystems.stacked(dd.exosystems.harmonics(1), dd.exosystems.ramp()),
}


def problem(exosystem, **more) -> dd.Problem:
    target = [0] * (1 if exosystem is None else exosystem.outputs)
    arcs = [[1, 2], [2, 1]]
    network = dd.Network.from_arcs(arcs, arrow="listens_to", agents=2)
    return dd.Problem(
        network=network, coupling="y", gains={1: 1}, exosystem=exosystem, target=target, **more
    )


def design(exosystem, **asked):
    return dd.design_observer(problem(exosystem), **asked)


def poles(exosystem, W):
    error = to_float(exosystem.A) - to_float(W) @ to_float(exosystem.C)
    return np.linalg.eigvals(error)


def distance(region, spectrum) -> float:
    """How far the spectrum lies outside a region; negative inside."""
    if isinstance(region, dd.poles.Disk):
        distances = np.abs(spectrum - float(region.centre))
        return np.max(distances) - float(region.radius)
    if isinstance(region, dd.poles.Cone):
        sizes = float(region.damping) * np.abs(spectrum)
        return np.max(spectrum.real + sizes)
    low, high = region.real_ends
    if high is None:
        return float(low) - np.min(spectrum.real)
    return np.max(spectrum.real) - float(high)


def digits_of(W) -> int:
    """Significant decimal digits of the longest entry, counted from the largest; 99 if it is no
    decimal."""
    entries = [x for row in W for x in row if x]
    largest = max(abs(x) for x in entries)
    top = math.floor(math.log10(largest))
    for digits in range(1, 30):
        unit = Fraction(10) ** (digits - 1 - top)
        if all((x * unit).denominator == 1 for x in entries):
            return digits
    return 99


@pytest.mark.parametrize("shape", SHAPES)
def test_the_rate_is_reached_with_the_digits_asked(shape):
    """The rate by Routh's test of A - WC + (rate - 1e-9) I, by floats, and the digits counted."""
    exosystem = SHAPES[shape]
    found = design(exosystem, rate="3/2", digits=3)
    assert found.verdict is Verdict.PROVED
    for statement in found.statements:
        assert statement.verdict is Verdict.PROVED
    assert {"hurwitz", "rate"} <= {statement.kind for statement in found.statements}
    error = subtract(exosystem.A, multiply(found.W, exosystem.C))
    assert decide_hurwitz(error).verdict is Verdict.PROVED
    assert rate_holds(error, Fraction(3, 2))
    # eigenvalues that meet are badly conditioned
    answer = np.max(poles(exosystem, found.W).real)
    assert answer < -1.5 + 0.01
    assert digits_of(found.W) <= 3
    assert found.measures["rate"] >= 1.5


def test_p_and_q_prove_the_envelope():
    """lower I <= P <= upper I and F'P + PF + 2 rate P <= 0, by eigenvalues; Q = P W exactly."""
    exosystem = SHAPES["periodic"]
    found = design(exosystem, rate=1)
    assert multiply(found.P, found.W) == found.Q
    assert transpose(found.P) == found.P
    envelope = next(s for s in found.statements if s.kind == "lyapunov")
    P = to_float(found.P)
    injection = multiply(found.W, exosystem.C)
    error_matrix = subtract(exosystem.A, injection)
    F = to_float(error_matrix)
    names = ("rate", "lower", "upper")
    rate, lower, upper = (float(Fraction(envelope.exact[name])) for name in names)
    values = np.linalg.eigvalsh(P)
    assert rate > 0
    assert 0 < lower <= values[0] * (1 + 1e-9)
    assert values[-1] <= upper * (1 + 1e-9)
    lyapunov = F.T @ P + P @ F
    growth = np.linalg.eigvalsh(lyapunov + 2 * rate * P)
    assert np.max(growth) <= 1e-9 * upper


@pytest.mark.parametrize(
    "region",
    [
        dd.poles.Cone(damping="0.8"),
        dd.poles.Disk(centre=-3, radius="2"),
        [dd.poles.HalfPlane(left_of=-1), dd.poles.HalfPlane(right_of=-4)],
        [
            dd.poles.Cone(damping="1/2"),
            dd.poles.Disk(centre=-2, radius=1),
            dd.poles.HalfPlane(left_of="-3/2"),
        ],
    ],
)
def test_regions_hold_for_the_rounded_gain(region):
    exosystem = SHAPES["periodic"]
    found = design(exosystem, region=region)
    assert found.verdict is Verdict.PROVED
    regions = region if isinstance(region, list) else [region]
    answer = [s for s in found.statements if s.kind == "region"]
    assert len(answer) == len(regions)
    spectrum = poles(exosystem, found.W)
    assert max(distance(each, spectrum) for each in regions) <= 1e-3


@pytest.mark.parametrize(
    ("exosystem", "asked", "reason"),
    [
        (dd.Exosystem(A=[[0, 2], [-2, 0]], C=[[0, 0]]), {"rate": 1}, "s^2 + 4"),
        (
            SHAPES["ramp"],
            {"region": [dd.poles.HalfPlane(left_of=-3), dd.poles.Disk(centre=0, radius=2)]},
            "no point",
        ),
        (dd.Exosystem(A=[[0]], C=[[0]]), {"period": 1}, "not detectable"),
    ],
)
def test_what_nothing_can_do_is_refuted_for_good(exosystem, asked, reason):
    found = design(exosystem, **asked)
    assert found.verdict == Verdict.REFUTED
    assert found.nearest is None
    assert reason in found.reason


def test_a_rate_beyond_a_hidden_mode_and_too_little_noise_are_refuted_and_the_nearest_is_offered():
    A = [[-1, 0, 0], [0, 0, 1], [0, -1, 0]]
    C = [[0, 1, 0]]
    exosystem = dd.Exosystem(A=A, C=C)
    found = design(exosystem, rate=2)
    assert found.verdict is Verdict.REFUTED
    assert "s + 1" in found.reason
    assert found.nearest.request.rate == 1
    assert found.nearest.verdict is Verdict.PROVED
    assert design(exosystem, rate=1).verdict is Verdict.PROVED
    loud = design(SHAPES["harmonic"], noise="1.9")
    assert loud.verdict is Verdict.REFUTED
    assert loud.nearest.verdict is Verdict.PROVED
    assert loud.nearest.request.noise[0].bound > 2


@pytest.mark.parametrize("channel", ["disturbance", "measurement"])
@pytest.mark.parametrize("frequency", ["23/7", "24/7"])
def test_the_nearest_bound_on_noise_is_kept_by_its_gain(frequency, channel):
    """A norm is rounded up to six digits: 3.360270... is not below 3.36027."""
    A = [[0, frequency], [f"-{frequency}", 0]]
    exosystem = dd.Exosystem(A=A, C=[[1, 0]])
    limit = NoiseLimit(bound="1/100", channel=channel)
    nearest = design(exosystem, noise=limit).nearest
    (reached,) = nearest.request.noise
    assert noise_statement(exosystem, nearest.W, reached).verdict is Verdict.PROVED


def test_a_region_of_one_point_is_met_exactly():
    """Re s <= -2 and Re s >= -2 and an almost flat cone: (s + 2)^2, W = (4, 4)."""
    left = dd.poles.HalfPlane(left_of=-2)
    right = dd.poles.HalfPlane(right_of=-2)
    flat = dd.poles.Cone(damping="0.999999")
    ramp = SHAPES["ramp"]
    found = design(ramp, region=[left, right, flat])
    assert found.verdict is Verdict.PROVED
    answer = np.abs(poles(ramp, found.W) + 2)
    assert answer == pytest.approx(0, abs=5e-3)


@pytest.mark.parametrize(
    ("limit", "kind"),
    [
        (dd.poles.NoiseLimit(bound="2.2"), "inf"),
        (dd.poles.NoiseLimit(channel="exosystem", bound="0.9"), "inf"),
        (dd.poles.NoiseLimit(channel="disturbance", norm="h2", bound="1.1"), 2),
        (dd.poles.NoiseLimit(channel="exosystem", norm="h2", bound="0.6"), 2),
    ],
)
def test_bounds_on_norms_hold_by_python_control(limit, kind):
    exosystem = SHAPES["harmonic"]
    found = design(exosystem, noise=limit)
    assert found.verdict is Verdict.PROVED
    system = channel(exosystem, found.W, limit.channel)
    value = control_norm(system, kind)
    assert value <= float(limit.bound) * (1 + 1e-6)
    name = f"{limit.norm} {limit.channel}"
    assert found.measures[name] == pytest.approx(value, rel=1e-6)


def test_a_sampled_observer_converges_at_its_rate():
    """Ad - W Cd by SciPy: the largest |z| is at most exp(-rate T); over pi s a sine of 2 rad/s has
    the mean 0."""
    unseen = design(SHAPES["harmonic"], rate=1, period="3.14159265358979")
    assert unseen.verdict is Verdict.UNDECIDED
    exosystem = SHAPES["periodic"]
    period = 0.2
    found = design(exosystem, rate=1, period="0.2")
    assert found.verdict is Verdict.PROVED
    error = sampled_in_floats(exosystem, found.W, period)
    sizes = np.abs(np.linalg.eigvals(error))
    assert np.max(sizes) <= math.exp(-0.2) + 1e-3
    answer = {s.kind for s in found.statements}
    assert answer == {"sampled", "rate"}


def test_numbers_beyond_the_floats_get_an_exact_gain():
    exosystem = dd.Exosystem(A=[["1e399"]], C=[[1]])
    found = design(exosystem, rate=1)
    assert found.verdict is Verdict.PROVED
    least = exosystem.A[0][0] + 1 - Fraction(1, 10**9)
    assert found.W[0][0] > least
    assert "exact pole placement" in found.source


def test_the_rate_of_the_problem_file_is_the_default_and_without_an_exosystem_nothing_is_designed():
    own = problem(SHAPES["harmonic"], observer=dd.Observer(rate=2))
    assert dd.design_observer(own).request.rate == 2
    assert dd.design_observer(own, rate=1).request.rate == 1
    with pytest.raises(SpecError, match="exosystem must be given"):
        dd.design_observer(problem(None))


def test_a_design_shows_itself_and_goes_to_json():
    import json

    found = design(SHAPES["harmonic"], rate=1)
    assert design(SHAPES["harmonic"], rate=1) == found
    text = str(found)
    assert text.startswith("proved: W")
    assert "proved: A - WC is Hurwitz." in text
    data = json.loads(json.dumps(found.to_json(), allow_nan=False))
    assert data["verdict"] == "proved"
    assert data["measures"]["h2 measurement"] is None


def test_numbers_are_read_as_typed():
    request = read_observer_request(rate=0.1, region=Cone(damping=0.7), noise=2.5)
    assert request.rate == Fraction(1, 10)
    assert request.regions[0].damping == Fraction(7, 10)
    expected = (NoiseLimit(channel="measurement", norm="hinf", bound="5/2"),)
    assert request.noise == expected
    region = [Disk(centre=-3, radius=1)]
    request = read_observer_request(rate=2, region=region)
    half_plane = HalfPlane(left_of=-2)
    disk = Disk(centre=-3, radius=1)
    expected = (half_plane, disk)
    assert request.all_regions == expected
    assert read_observer_request().all_regions == (HalfPlane(left_of=0),)


@pytest.mark.parametrize(
    ("call", "match"),
    [
        (HalfPlane, "one side, left_of or right_of; got neither"),
        (lambda: HalfPlane(left_of=1, right_of=0), "got both"),
        (lambda: Disk(centre=0, radius=0), "region.radius must be > 0"),
        (lambda: Cone(damping=1), "region.damping must lie between 0 and 1"),
        (lambda: Cone(damping=0), "region.damping must lie between 0 and 1"),
        (lambda: read_observer_request(region="left"), "HalfPlane, a Disk or a Cone"),
        (lambda: read_observer_request(rate=0), "rate must be > 0"),
        (lambda: read_observer_request(digits=0), "digits must be an integer from 1 to 15"),
        (lambda: read_observer_request(period=0), "period must be > 0"),
        (
            lambda: read_observer_request(period=1, noise=1),
            "noise cannot be asked of a sampled observer",
        ),
        (
            lambda: read_observer_request(period=1, region=Cone(damping="1/2")),
            "must be a Disk for a sampled observer",
        ),
        (lambda: NoiseLimit(bound=1, channel="wind"), "noise.channel must be one of"),
        (lambda: NoiseLimit(bound=1, norm="h3"), "noise.norm must be one of"),
        (lambda: NoiseLimit(bound=0), "noise must be > 0"),
        (lambda: read_observer_request(noise="loud"), "noise must be a number"),
    ],
)
def test_wrong_requests_name_their_key(call, match):
    with pytest.raises(SpecError, match=match):
        call()


@pytest.mark.parametrize("period", ["1/20", "1/10", "1/5"])
@pytest.mark.parametrize("rate", [None, 2])
def test_a_problem_on_a_processor_gets_the_w_of_its_own_period(period, rate):
    """Ad - W C Gamma by SciPy: W is the one of the file, the gain per sample divided by T."""
    paper = dd.load_problem("paper-fixed").replace(processor={"period": period})
    found = dd.design_observer(paper, rate=rate)
    assert found.is_proved
    T = float(Fraction(period))
    W = [[float(x) * T for x in row] for row in found.W]
    error = sampled_in_floats(paper.exosystem, W, T)
    radius = np.abs(np.linalg.eigvals(error)).max()
    assert radius < np.exp(-(rate or 0) * T)
    loop = loop_of(paper.replace(observer=dd.Observer(W=found.W)))
    verdict = sampled_verdict(loop.groups[0].exosystem, loop.observer.W, loop.timing)
    assert verdict is dd.Verdict.PROVED


def test_agents_in_steps_get_a_w_for_a_step():
    steps = linked(
        [[1, 2, "1/4"]],
        gains={2: "1/2"},
        time="discrete",
        exosystem=dd.Exosystem(A=[["3/5", "4/5"], ["-4/5", "3/5"]], C=[[1, 0]]),
    )
    found = dd.design_observer(steps)
    assert found.is_proved
    error = floats(steps.exosystem.A) - floats(found.W) @ floats(steps.exosystem.C)
    assert np.abs(np.linalg.eigvals(error)).max() < 0.95


def test_a_period_beside_that_of_a_processor_is_refused():
    paper = dd.load_problem("paper-fixed").replace(processor={"period": "1/10"})
    with pytest.raises(SpecError, match="period is that of \\[processor\\] or of a step"):
        dd.design_observer(paper, period="1/20")
