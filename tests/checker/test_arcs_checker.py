"""The lone checker's part about arc-wise certificates."""

import random
from collections.abc import Callable
from fractions import Fraction
from functools import partial

import numpy as np
import pytest
from checker_files.arcs import HALF, SINES, TAKEN, made, moved
from checker_files.files import FAILS, HOLDS, changed, outcome
from numpy.typing import NDArray

from dobc_design.certification.recheck import recheck
from dobc_design.checker import arcs
from dobc_design.checker import examine as checker
from dobc_design.checker.curves import throughout
from dobc_design.checker.expressions import read_coupling
from dobc_design.problem.canonical import problem_from_canonical


@pytest.mark.parametrize("k", range(10))
@pytest.mark.parametrize("name", TAKEN)
def test_the_numbers_of_the_page_leave_less_than_five_hundredths(name: str, k: int):
    """With less the arc takes more than it may; with more the agent that pays has not enough."""
    heard = (k + 1) % 10 + 1
    payer = k + 1 if name == "a" else heard
    said = {
        -50: (f"the arc by which {k + 1} hears {heard} ", f"the arc from {heard} to {k + 1} "),
        50: (f"more of {payer} than", f"take of agent {payer} is"),
    }
    for step, (here, alone) in said.items():
        case = moved(name, k, step)
        problem = problem_from_canonical(case.problem)
        assert here in recheck(case.certificate, problem).failures[0]
        findings = checker.examine(case.certificate, case.problem)
        assert alone in next(text for holds, text in findings if not holds)


@pytest.mark.parametrize(("b", "code"), [("1.000001", HOLDS), ("0.999999", FAILS)])
def test_of_a_linear_arc_little_has_to_be_left(b: str, code: int):
    """-x^2 + b y^2 >= 2 x (y - x) iff b >= 1."""
    shares = {"a": {"G": ["0", "-1"]}, "b": {"G": [HALF, b]}}
    case = made("mixed", code, b, changed(SINES, rate=1, own="1", **shares))
    assert outcome(case.certificate, case.problem) == code


def test_numbers_that_are_no_floats_show_nothing():
    """1e-400 and sums of two are 0 as floats."""
    d = ["1e-400", "1e-400"]
    shares = {"a": {"G": ["1e-400"]}, "b": {"G": ["1e-400"]}}
    case = made("one sine", FAILS, "tiny", changed(SINES, rate=1, own="1", d=d, **shares))
    assert outcome(case.certificate, case.problem) == FAILS


Function = Callable[[NDArray[np.float64]], NDArray[np.float64]]
FUNCTIONS: dict[str, Function] = {
    "sin(y)": np.sin,
    "y + sin(3*y)": lambda y: y + np.sin(3 * y),
    "exp(y) - 1 + y": lambda y: np.expm1(y) + y,
    "clip(y, -1/2, 1) - y/5": lambda y: np.clip(y, -0.5, 1) - y / 5,
    "y - y**2/4": lambda y: y - y * y / 4,
    "abs(y) + 2*y": lambda y: np.abs(y) + 2 * y,
}


@pytest.mark.parametrize("text", FUNCTIONS)
def test_what_is_shown_of_an_arc_holds_on_a_grid_and_what_has_room_there_is_shown(text: str):
    h = read_coupling((text,), 1)
    angle, radius = np.meshgrid(np.linspace(0, 2 * np.pi, 1441), np.linspace(0.01, 1, 60))
    faces = [arcs.Gains(h, mirrored) for mirrored in (False, True)]
    draw = random.Random(text)
    seen = {False: 0, True: 0}
    for _ in range(12):
        c, own, other = (Fraction(draw.randint(5, 20), 10) for _ in range(3))
        level = Fraction(draw.randint(1, 60), 10)
        x, y = (radius * np.sqrt(float(level)) * f(angle) for f in (np.cos, np.sin))
        x, y = x / np.sqrt(float(own)), y / np.sqrt(float(other))
        b = c * Fraction(draw.randint(5, 60), 10)
        pull = 2 * float(c) * x * FUNCTIONS[text](y - x) - float(b) * y * y
        # the least a for this b, unless y alone takes more than b
        across = np.abs(x) > 1e-3
        least = Fraction(float(np.max(pull[across] / x[across] ** 2)))
        for room in (Fraction(-1, 50), Fraction(1, 50)):
            arc = arcs.Arcs(h, False, least + room, b, (c, c), own, other)
            end = float(arcs.root(level * (1 / own + 1 / other)))
            settled = arcs.Disc(arc, level).settled
            shown = all(throughout(end, partial(settled, gains)) for gains in faces)
            assert shown is (room > 0)
            seen[shown] += 1
    assert min(seen.values()) > 5
