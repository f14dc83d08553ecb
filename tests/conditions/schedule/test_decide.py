"""Tubes decided: the words for what does not hold, closed forms, and runs that stay inside."""

import math
import re
from contextlib import nullcontext
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from certified import coarse_tables, rough_settling, settling_alone
from checker_files.separable import problems
from checker_files.settling import CUBIC, GOOD, LINE, MIXED, SEEN, STRETCHED, UNEVEN, bent, moved
from networks import listening, pair
from regional_problems import field
from scipy.integrate import solve_ivp
from texts import exact_matrix

import dobc_design as dd
from dobc_design.conditions.check import check_from_json
from dobc_design.conditions.schedule.checks import read_claim, settling_of
from dobc_design.conditions.schedule.claim import Descent, Tube
from dobc_design.conditions.schedule.decide import open_segments, why_not
from dobc_design.conditions.separable.claim import Separable
from dobc_design.errors import SpecError
from dobc_design.exact.matrix import to_float
from dobc_design.loop.make import loop_of

F = Fraction
HEARD = "observed, linear"


def answer(name: str, document: dict) -> str | None:
    """Why the claim of a stored check is not proved, for a known problem."""
    problem = problems()[name]
    loop = loop_of(problem)
    W = None if problem.observer is None else problem.observer.W
    claim = read_claim(check_from_json(document), loop, W)
    return why_not(loop, W, claim)


@pytest.mark.parametrize(
    ("name", "document", "words"),
    [
        *((name, document, None) for name, document in GOOD.items()),
        ("line", moved(LINE, 0, 0, "0.999"), "does not hold all starts"),
        ("line", moved(LINE, 2, 1, "0.833"), "a row does not hold between 0.5 s"),
        ("bent", moved(UNEVEN, 1, 1, "0.761", "lower"), "a row does not hold between 0 s"),
        ("matrix", moved(MIXED, 1, 1, "0.668", "lower"), "faces have to be alike"),
        ("line", bent(LINE, level="0.4449"), "last box of the tube does not lie in its level set"),
        ("line", bent(LINE, height="1.9999"), "height must be at least max v"),
        ("line", bent(LINE, stretch="2"), "stretch is 1 unless"),
        ("line", bent(LINE, time="5.372"), "by the time claimed"),
        ("line", bent(LINE, tolerance="0.09999"), "by the time claimed"),
        ("cubic", bent(CUBIC, height="0.9999"), "height\\^2 must be"),
        ("cubic", bent(CUBIC, level="0.70711"), "reaches beyond its radius"),
        (HEARD, bent(SEEN, beta="2.0001"), "the observer error of the tube"),
        (HEARD, bent(STRETCHED, stretch="1.9999"), "is not semidefinite"),
    ],
)
@coarse_tables()
def test_every_condition_that_fails_is_named(name: str, document: dict, words: str | None):
    found = answer(name, document)
    if words is None:
        assert found is None
    else:
        assert found is not None
        assert re.search(words, found)


def test_boxes_that_cannot_be_are_refused():
    one = exact_matrix("1") * 2
    second = (F(0), F(1))
    increasing = (F(1), F(2))
    standing = (F(0), F(0))
    backwards = (F(1), F(0))
    for times in ((), increasing, standing, backwards):
        with pytest.raises(SpecError, match="times must rise from 0"):
            Tube(times=times, upper=one, lower=one)
    with pytest.raises(SpecError, match="one box for each time"):
        Tube(times=second, upper=one, lower=one[:1])
    empty = exact_matrix("1; 0")
    with pytest.raises(SpecError, match="entries > 0"):
        Tube(times=second, upper=one, lower=empty)


@pytest.mark.parametrize(
    "name", ["level", "height", "stretch", "radius", "tolerance", "disturbance", "time"]
)
def test_numbers_of_a_claim_that_cannot_be_are_refused(name: str):
    loop = loop_of(problems()["line"])
    claim = read_claim(check_from_json(LINE), loop, None)
    with pytest.raises(SpecError, match=f"{name} must"):
        replace(claim, **{name: F(-1)})


# --- Closed forms
# --------------------------------------------------------------------------------------------------
def alone(k: int, *, steps: int, room: float) -> Tube:
    """One agent, e' = -k e: the factor 1/(1 + k h) of every step of h = 1/steps s, and a little
    more."""
    times = list[F]()
    boxes = list[tuple[F]]()
    for each in range(steps + 1):
        times.append(F(each, steps))
        shrunk = (1 + F(k, steps)) ** -each
        wider = shrunk * (1 + F(room) * each)
        boxes.append((wider,))
    return Tube(times=tuple(times), upper=tuple(boxes), lower=tuple(boxes))


def test_the_tube_of_one_agent_is_as_close_to_its_run_as_its_steps_are_short_and_never_below():
    """e = exp(-k t); chords with slope -k times their lower end lie above it by (k h / 2) k t."""
    k = 3
    one_agent = listening([], "y", n=1, gains={1: k}, target=0)
    loop = loop_of(one_agent)
    for steps, gap in ((50, 0.05), (200, 0.013)):
        tube = alone(k, steps=steps, room=1e-9)
        tighter = alone(k, steps=steps, room=-1e-9)
        assert open_segments(loop, tube, disturbance=F(0)) == []
        assert open_segments(loop, tighter, disturbance=F(0)) != []
        widths = [float(width) for (width,) in tube.upper]
        exact = [math.exp(-k * t) for t in tube.times]
        excess = []
        for width, run in zip(widths, exact, strict=True):
            excess.append(width / run - 1)
        assert min(excess) >= 0
        assert max(excess) <= k * gap * 2


def test_a_certificate_alone_settles_at_the_logarithm_of_closed_form():
    """e' = -2 e for two equal agents: |e| <= tol from ln(1/tol)/2 on, and not a billionth
    before."""
    chain = listening([[2, 1]], "y", n=2, gains={1: 2, 2: 2}, target=0)
    loop = loop_of(chain)
    exactly = math.log(100) / 2
    tube = Tube.start(loop, F(1), None)
    certificate = Separable(v=(F(1), F(1)), alpha=F(2), rho=None)
    later = Descent(
        tube=tube,
        certificate=certificate,
        level=F(1),
        height=F(1),
        radius=F(1),
        disturbance=F(0),
        tolerance=F(1, 100),
        time=F(exactly + 1e-9),
    )
    sooner = replace(later, time=F(exactly - 1e-9))
    assert why_not(loop, None, later) is None
    assert why_not(loop, None, sooner) is not None


# --- Runs stay inside
# -----------------------------------------------------------------------------------------------
@dataclass(frozen=True, kw_only=True)
class Runs:
    """Runs of a problem without an exosystem that begin together, one row each."""

    problem: dd.Problem
    e: np.ndarray

    def through(self, mode: str, times: np.ndarray) -> np.ndarray:
        """The errors at these times, the first one now: (runs, n, times)."""

        def slope(t: float, flat: np.ndarray) -> np.ndarray:
            errors = flat.reshape(self.e.shape)
            change = field(self.problem, mode, errors)
            return change.ravel()

        span = (times[0], times[-1])
        start = self.e.ravel()
        run = solve_ivp(slope, span, start, t_eval=times, rtol=1e-9, atol=1e-12)
        return run.y.reshape(*self.e.shape, len(times))


def excess(problem: dd.Problem, tube: Tube, *, runs: int = 60) -> float:
    """By how much simulated runs leave the boxes, relative to their size; from corners of the first
    box, with another mode on every segment."""
    rng = np.random.default_rng(0)
    times = np.array([float(t) for t in tube.times])
    upper = to_float(tube.upper)
    lower = to_float(tube.lower)
    corners = rng.random((runs, problem.n)) < 0.5
    e = np.where(corners, upper[0], -lower[0])
    names = list(problem.network.modes)
    worst = 0.0
    for number, (start, end) in enumerate(pairwise(times)):
        at = np.linspace(start, end, 5)
        mode = names[number % len(names)]
        found = Runs(problem=problem, e=e).through(mode, at)
        for k, share in enumerate((at - start) / (end - start)):
            here = (1 - share) * upper[number]
            there = share * upper[number + 1]
            top = here + there
            low_here = (1 - share) * lower[number]
            low_there = share * lower[number + 1]
            low = low_here + low_there
            above = float(np.max(found[:, :, k] / top))
            reached = -found[:, :, k] / low
            below = float(np.max(reached))
            worst = max(worst, above, below)
        e = found[:, :, -1]
    return worst - 1


LATER = [pytest.param("sin(y)", "1/20", nullcontext, marks=pytest.mark.slow)]
LATER += [
    pytest.param(h, "1/20", nullcontext, marks=pytest.mark.evidence)
    for h in ("y*(1 + exp(-y**2))", "y + y**3")
]


@pytest.mark.parametrize(
    ("h", "tolerance", "search"), [("exp(y) - 1 + y", "1/2", rough_settling), *LATER]
)
def test_no_run_leaves_a_tube_that_is_proved_and_some_leave_one_that_is_refused(
    h: str, tolerance: str, search: Any
):
    """Sin falls beyond pi/2 and y (1 + exp(-y^2)) near 1.2, both within |y| <= 1.8."""
    problem = pair(h, k=2)
    with search():
        tube = settling_alone(problem, radius="9/10", tolerance=tolerance).claim.tube
        first, *others = tube.upper
        narrower = []
        for box in others:
            narrower.append(tuple(x * F(9, 10) for x in box))
        tight = replace(tube, upper=(first, *narrower))
        assert open_segments(loop_of(problem), tight, disturbance=F(0)) != []
    assert len(tube.times) > 2
    assert excess(problem, tube) <= 1e-7
    assert excess(problem, tight) > 1e-3


def test_the_envelope_is_the_larger_face_and_then_the_certificate():
    """Between times on the chord; from the end on height level exp(-alpha t)."""
    loop = loop_of(problems()["bent"])
    claim = read_claim(check_from_json(UNEVEN), loop, None)
    settling = settling_of(loop, claim, "")
    times, bounds = settling.curve(until=2 * settling.time, samples=101)
    chord = 1 - 2.37 * times
    decay = 0.763 * np.exp(-2.9999 * (times - 0.1))
    wanted = np.where(times < 0.1, chord, decay)
    assert np.allclose(bounds, wanted, rtol=1e-12)
    assert np.all(bounds >= wanted * (1 - 1e-15))
    assert settling.envelope(settling.time) <= 0.1 < settling.envelope(0.777)
    stages = []
    for stage in settling.stages:
        stages.append((stage.kind, stage.start, stage.bound))
    moving = ("moving box", 0, 1)
    still = ("max-separable", F(1, 10), F(763, 1000))
    expected = [moving, still]
    assert stages == expected
