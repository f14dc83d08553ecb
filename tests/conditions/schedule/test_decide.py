"""Tubes decided: the words for what does not hold, closed forms, and runs that stay inside."""

import math
import re
from contextlib import nullcontext
from dataclasses import replace
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
    problem = problems()[name]
    W = None if problem.observer is None else problem.observer.W
    return why_not(loop_of(problem), W, read_claim(check_from_json(document), loop_of(problem), W))


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
    assert found is None if words is None else found is not None and re.search(words, found)


def test_boxes_that_cannot_be_are_refused():
    one = ((F(1),),) * 2
    for times in ((), (F(1), F(2)), (F(0), F(0)), (F(1), F(0))):
        with pytest.raises(SpecError, match="times must rise from 0"):
            Tube(times=times, upper=one, lower=one)
    with pytest.raises(SpecError, match="one box for each time"):
        Tube(times=(F(0), F(1)), upper=one, lower=one[:1])
    with pytest.raises(SpecError, match="entries > 0"):
        Tube(times=(F(0), F(1)), upper=one, lower=((F(1),), (F(0),)))


@pytest.mark.parametrize(
    "name", ["level", "height", "stretch", "radius", "tolerance", "disturbance", "time"]
)
def test_numbers_of_a_claim_that_cannot_be_are_refused(name: str):
    claim = read_claim(check_from_json(LINE), loop_of(problems()["line"]), None)
    with pytest.raises(SpecError, match=f"{name} must"):
        replace(claim, **{name: F(-1)})


# --- Closed forms
# --------------------------------------------------------------------------------------------------
def alone(k: int, *, steps: int, room: float) -> Tube:
    """One agent, e' = -k e: the factor 1/(1 + k h) of every step of h = 1/steps s, and a little
    more."""
    times = [F(each, steps) for each in range(steps + 1)]
    boxes = [((1 + F(k, steps)) ** -each * (1 + F(room) * each),) for each in range(steps + 1)]
    return Tube(times=tuple(times), upper=tuple(boxes), lower=tuple(boxes))


def test_the_tube_of_one_agent_is_as_close_to_its_run_as_its_steps_are_short_and_never_below():
    """e = exp(-k t); chords with slope -k times their lower end lie above it by (k h / 2) k t."""
    problem, k = listening([], "y", n=1, gains={1: 3}, target=0), 3
    for steps, gap in ((50, 0.05), (200, 0.013)):
        tube = alone(k, steps=steps, room=1e-9)
        assert open_segments(loop_of(problem), tube, disturbance=F(0)) == []
        assert (
            open_segments(loop_of(problem), alone(k, steps=steps, room=-1e-9), disturbance=F(0))
            != []
        )
        excess = [
            float(box[0]) * math.exp(k * t) - 1
            for t, box in zip(tube.times, tube.upper, strict=True)
        ]
        assert min(excess) >= 0
        assert max(excess) <= k * gap * 2


def test_a_certificate_alone_settles_at_the_logarithm_of_closed_form():
    """e' = -2 e for two equal agents: |e| <= tol from ln(1/tol)/2 on, and not a billionth
    before."""
    problem = listening([[2, 1]], "y", n=2, gains={1: 2, 2: 2}, target=0)
    numbers = {
        "level": F(1),
        "height": F(1),
        "radius": F(1),
        "disturbance": F(0),
        "tolerance": F(1, 100),
    }
    last = Separable(v=(F(1), F(1)), alpha=F(2), rho=None)
    for shift in (1e-9, -1e-9):
        time = F(math.log(100) / 2 + shift)
        claim = Descent(
            tube=Tube.start(loop_of(problem), F(1), None), certificate=last, time=time, **numbers
        )
        assert (why_not(loop_of(problem), None, claim) is None) is (shift > 0)


# --- Runs stay inside
# -----------------------------------------------------------------------------------------------
def excess(
    problem: dd.Problem, tube: Tube, *, W: Any = None, disturbance: F | int = 0, runs: int = 60
) -> float:
    """By how much simulated runs leave the boxes, relative to their size; corners of the first box,
    the largest observer error; another mode on every segment."""
    rng, n, q = np.random.default_rng(0), problem.n, problem.q
    upper, lower = (
        np.array([[float(x) for x in box] for box in face]) for face in (tube.upper, tube.lower)
    )
    times = np.array([float(t) for t in tube.times])
    e = np.where(rng.random((runs, n)) < 0.5, upper[0], -lower[0])
    eps = rng.standard_normal((runs, n, q))
    eps *= float(disturbance) / np.maximum(np.linalg.norm(eps, axis=2, keepdims=True), 1e-300)
    A, C = (
        (to_float(problem.exosystem.A), to_float(problem.exosystem.C))
        if q
        else (np.zeros((0, 0)), np.zeros((1, 0)))
    )
    A = A - to_float(W) @ C if q else A
    worst, names = 0.0, list(problem.network.modes)
    for number, (start, end) in enumerate(pairwise(times)):
        mode = names[number % len(names)]

        def slope(t: float, flat: np.ndarray, mode: str = mode) -> np.ndarray:
            state = flat.reshape(runs, n * (1 + q))
            errors = state[:, n:].reshape(runs, n, q)
            change = field(problem, mode, state[:, :n]) + (errors @ C.T)[:, :, 0]
            return np.concatenate([change, (errors @ A.T).reshape(runs, n * q)], axis=1).ravel()

        state = np.concatenate([e, eps.reshape(runs, n * q)], axis=1)
        at = np.linspace(start, end, 5)
        run = solve_ivp(slope, (start, end), state.ravel(), t_eval=at, rtol=1e-9, atol=1e-12)
        states = run.y.reshape(runs, n * (1 + q), len(at))
        part = (at - start) / (end - start)
        for k, share in enumerate(part):
            top, low = (
                (1 - share) * face[number] + share * face[number + 1] for face in (upper, lower)
            )
            worst = max(
                worst, float(np.max(states[:, :n, k] / top)), float(np.max(-states[:, :n, k] / low))
            )
        e, eps = states[:, :n, -1], states[:, n:, -1].reshape(runs, n, q)
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
        tight = replace(
            tube,
            upper=(tube.upper[0], *(tuple(x * F(9, 10) for x in box) for box in tube.upper[1:])),
        )
        assert open_segments(loop_of(problem), tight, disturbance=F(0)) != []
    assert len(tube.times) > 2
    assert excess(problem, tube) <= 1e-7
    assert excess(problem, tight) > 1e-3


def test_the_envelope_is_the_larger_face_and_then_the_certificate():
    """Between times on the chord; from the end on height level exp(-alpha t)."""
    claim = read_claim(check_from_json(UNEVEN), loop_of(problems()["bent"]), None)
    settling = settling_of(loop_of(problems()["bent"]), claim, "")
    times, bounds = settling.curve(until=2 * settling.time, samples=101)
    wanted = np.where(times < 0.1, 1 - 2.37 * times, 0.763 * np.exp(-2.9999 * (times - 0.1)))
    assert np.allclose(bounds, wanted, rtol=1e-12) and np.all(bounds >= wanted * (1 - 1e-15))
    assert settling.envelope(settling.time) <= 0.1 < settling.envelope(0.777)
    assert [(stage.kind, stage.start, stage.bound) for stage in settling.stages] == [
        ("moving box", 0, 1),
        ("max-separable", F(1, 10), F(763, 1000)),
    ]
