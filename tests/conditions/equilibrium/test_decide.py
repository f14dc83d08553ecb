"""A second equilibrium, proved by Krawczyk's test: closed forms and mpmath from outside, and what
just fails."""

import math
from fractions import Fraction
from functools import partial
from random import Random
from typing import Any

import mpmath
import numpy as np
import pytest
from certified import confirmed
from networks import linked
from regional_problems import (
    FOLDED,
    HARMONIC,
    PAPER_GAIN,
    exact,
    field,
    half_difference,
    listening_pair,
    random_folded,
    random_problem,
)
from scipy.optimize import fsolve
from texts import exact_matrix

from dobc_design import Observer, Problem, Verdict
from dobc_design.conditions.check import Check, check_from_json
from dobc_design.conditions.equilibrium.decide import (
    Equilibrium,
    field_at,
    krawczyk_holds,
    lies_in_region,
    refuting_check,
    slopes_on,
    why_not,
)
from dobc_design.conditions.equilibrium.propose import enclose_equilibrium
from dobc_design.exact.interval import Interval
from dobc_design.loop.make import loop_of

F = Fraction
SADDLE = half_difference(3.3)  # y = 3.3077
NODE = half_difference(6.0)  # y = 5.98
SMALL = F(1, 10**4)


def boxed(*middle: F, half: F = SMALL, mode: str = "G") -> Equilibrium:
    box = tuple(Interval(c - half, c + half) for c in middle)
    return Equilibrium(mode=mode, box=box)


ROOT = boxed(-SADDLE, SADDLE)


def refusal(problem: Problem, claim: Equilibrium, **part: F) -> str | None:
    return why_not(loop_of(problem), claim, **part)


def is_proved(problem: Problem, claim: Equilibrium) -> bool:
    return refusal(problem, claim) is None


def enclosed(problem: Problem, *point: float, **options: bool) -> Equilibrium | None:
    return enclose_equilibrium(loop_of(problem), "G", [float(e) for e in point], **options)


def refuting(problem: Problem, claim: Equilibrium = ROOT) -> Check | None:
    return refuting_check(loop_of(problem), claim)


def root_near(problem: Problem, start: Any, accuracy: float = 1e-8) -> np.ndarray:
    """Where SciPy ends, a root or not."""
    found, *_ = fsolve(lambda e: field(problem, "G", e), start, xtol=accuracy, full_output=True)
    return found


@pytest.mark.parametrize("half", [SADDLE, NODE, -SADDLE])
def test_the_false_equilibria_of_two_agents_are_proved_around_the_true_root(half: F):
    """2 sin y + y/10 = 0 near y = 3.31 and 5.98: e = (-y/2, y/2); the root is mpmath's at 50
    digits."""
    problem = listening_pair()
    claim = enclosed(problem, -half, half)
    assert claim.box[0].contains(-half)
    assert claim.box[1].contains(half)
    assert max(side.width for side in claim.box) < F(1, 10**4)


def test_with_one_pin_the_false_equilibrium_is_at_pi():
    """The free agent rests where sin y = 0, and then the pinned one at its target: e = (0, pi)."""
    problem = listening_pair(gains={1: "1/10"})
    claim = enclosed(problem, 0.0, 3.14159)
    with mpmath.workdps(50):
        assert claim.box[1].contains(exact(mpmath.pi))
    assert claim.box[0].contains(0)


def test_a_box_is_proved_until_the_root_leaves_it():
    """Shifted by 9/10 of its half width it holds the root, by 11/10 it does not."""
    problem = listening_pair()
    half = SMALL
    assert is_proved(problem, ROOT)
    assert is_proved(problem, boxed(-SADDLE, SADDLE + half * F(9, 10)))
    assert not is_proved(problem, boxed(-SADDLE, SADDLE + half * F(11, 10)))
    assert not is_proved(problem, boxed(-SADDLE - half * F(11, 10), SADDLE))
    # At 0 the test holds as well, so a box that holds 0 is refused, and one that only touches it
    # holds nothing.
    assert "target itself" in refusal(problem, boxed(F(0), F(0)))
    assert "target itself" in refusal(problem, boxed(F(0), half))
    assert "Krawczyk" in refusal(problem, boxed(F(0), half * F(1001, 1000)))
    # Boxes made here leave room for coarser enclosures: at most nine tenths of each half width is
    # used.
    claim = enclosed(problem, -SADDLE, SADDLE)
    found = refusal(problem, claim, part=F(9, 10))
    assert found is None
    tight = boxed(-SADDLE, SADDLE + SMALL * F(95, 100))
    assert is_proved(problem, tight)
    found = refusal(problem, tight, part=F(9, 10))
    assert found is not None


def test_the_box_has_to_lie_in_the_region_up_to_its_very_edge_goals_taken_into_account():
    """Twin: a region that ends inside the box, or exactly at the root, is not shown to hold the
    start."""
    edge = ROOT.box[1].hi
    inside = listening_pair(reach=edge)
    reach = edge - F(1, 10**9)
    outside = listening_pair(reach=reach)
    assert refuting(inside).verdict is Verdict.REFUTED
    assert lies_in_region(loop_of(inside), ROOT)
    assert not lies_in_region(loop_of(outside), ROOT)
    assert refuting(outside) is None
    # A smaller box around the same root still fits there, but none around a root on the edge.
    on_edge = listening_pair(reach=F(f"{float(SADDLE):.15f}"))
    assert enclosed(outside, -SADDLE, SADDLE, within_region=True) is not None
    assert enclosed(on_edge, -SADDLE, SADDLE, within_region=True) is None
    # Target 1 and an offset of 2 for agent 2: x = (1 - y/2, 3 + y/2).
    shifted = partial(listening_pair, target=1, offsets={2: 2})
    low = 1 - SADDLE - F(1, 1000)
    high = 3 + SADDLE + F(1, 1000)
    assert refuting(shifted(reach=[low, high])) is not None
    reach = [low + F(1, 500), high]
    problem = shifted(reach=reach)
    found = refuting(problem)
    assert found is None
    reach = [low, high - F(1, 500)]
    problem = shifted(reach=reach)
    found = refuting(problem)
    assert found is None


def test_an_observer_does_not_matter():
    """With eps = 0 the disturbance is cancelled, so the states rest as without one."""
    region = {"initial_states": [-5, 5], "initial_disturbance": 0}
    observer = {"exosystem": HARMONIC, "observer": Observer(W=PAPER_GAIN)}
    arcs = [[1, 2], [2, 1]]
    problem = linked(arcs, coupling="sin(y)", gains="1/10", region=region, **observer)
    check = refuting(problem)
    assert confirmed(check, problem, W=PAPER_GAIN) is None
    assert "without W" in confirmed(check, problem)


def test_a_folded_line_has_its_equilibrium_at_ten_thirds_exactly():
    """For 1 < y: h = 3/2 - y/2, so 2 h + y/10 = 0 at y = 10/3, a rational number."""
    problem = listening_pair(FOLDED)
    claim = boxed(F(-5, 3), F(5, 3), half=F(1, 10))
    assert is_proved(problem, claim)
    claim = boxed(F(-5, 3), F(5, 3) + F(11, 10**5))
    assert not is_proved(problem, claim)
    # A box that reaches the kink sees slopes of both signs.
    claim = boxed(F(-5, 3), F(5, 3), half=F(7, 5))
    assert not is_proved(problem, claim)


def test_couplings_of_vectors_are_decided_too():
    """m = 2, h = (sin y1 + y2/4, sin y2 - y1/4), pins 1/10; mpmath has the root."""
    problem = listening_pair(["sin(y1) + y2/4", "sin(y2) - y1/4"], target=[0, 0])
    rows = [
        lambda a, b: 2 * (mpmath.sin(a) + b / 4) + a / 10,
        lambda a, b: 2 * (mpmath.sin(b) - a / 4) + b / 10,
    ]
    with mpmath.workdps(50):
        y = mpmath.findroot(rows, (3.5, 0.5))
        half = [exact(each) / 2 for each in y]
    root = (-half[0], -half[1], *half)
    assert max(root) > 1
    claim = enclosed(problem, *root)
    for side, e in zip(claim.box, root, strict=True):
        assert side.contains(e)
    assert is_proved(problem, boxed(*root))
    assert not is_proved(problem, boxed(*root[:3], root[3] + F(2, 10**4)))


@pytest.mark.parametrize(("m", "seeds"), [(1, (0, 1, 3, 5)), (2, (1, 2, 4))])
def test_what_floating_point_finds_in_random_problems_is_proved_and_is_a_root(
    m: int, seeds: tuple[int, ...]
):
    """Weights, exceptions, matrix gains, offsets; SciPy finds the roots and says how far they are
    from zero."""
    proved = 0
    rounding = F(1, 10**11)
    for seed in seeds:
        problem = random_folded(seed, m=m)
        r = Random(f"roots {seed}")
        for _ in range(4):
            start = [r.uniform(-6, 6) for _ in range(problem.n * m)]
            root = root_near(problem, start)
            left = np.max(np.abs(field(problem, "G", root)))
            if np.max(np.abs(root)) < 1e-3 or left > 1e-9:
                continue
            claim = enclosed(problem, *root.tolist())
            if claim is None:  # singular there, or on a kink
                continue
            proved += 1
            start = [float(c) for c in claim.middle]
            polished = root_near(problem, start, 1e-12)
            for side, e in zip(claim.box, polished.tolist(), strict=True):
                assert side.lo - rounding <= F(e) <= side.hi + rounding
    assert proved >= 3


@pytest.mark.parametrize("m", [1, 2])
def test_boxes_in_which_the_field_does_not_vanish_are_never_proved(m: int):
    """One component of f is farther from 0 in the middle than it can change within the box: no root
    is there."""
    refused = 0
    for seed in range(6):
        problem = random_folded(seed, m=m)
        r = Random(f"no roots {seed}")
        for _ in range(4):
            half = F(1, r.choice((10, 100, 10**6)))
            middle = [F(r.randint(-3000, 3000), 1000) for _ in range(problem.n * m)]
            claim = boxed(*middle, half=half)
            slopes = slopes_on(loop_of(problem), "G", claim.box)
            value = field(problem, "G", np.array(claim.middle, dtype=float))
            change = np.zeros(problem.n * m)
            for (row, _), slope in slopes.items():
                change[row] += float(slope.magnitude * half)
            if np.any(np.abs(value) > 1.01 * change + 1e-9):
                refused += 1
                assert not is_proved(problem, claim)
    assert refused > 7


def test_no_equilibrium_is_proved_where_there_is_none():
    """tanh with every agent pinned has 0 only (theory, section 5: v = 1), wherever one looks."""
    r = Random("none")
    for seed in range(8):
        problem = random_problem(seed, pin=1.1)
        for _ in range(6):
            scale = r.choice((F(1, 1000), F(1, 10), F(1), F(5)))
            middle = [scale * F(r.randint(-100, 100), 100) for _ in range(problem.n)]
            half = scale * F(r.randint(1, 40), 100)
            claim = boxed(*middle, half=half, mode="G0")
            assert not is_proved(problem, claim)


def test_a_point_of_a_line_of_equilibria_is_proved_and_large_problems_are_left_alone():
    """Without pins every common shift is an equilibrium; the slopes are singular and nothing is
    isolated."""
    free = listening_pair(gains=None)
    box = (Interval.point(1),) * 2
    assert enclosed(free, 1.0, 1.0) == Equilibrium(mode="G", box=box)
    assert enclosed(free, 1.0, -1.0) is None
    arcs = [[i, i % 61 + 1] for i in range(1, 62)]
    region = {"initial_states": [-5, 5]}
    problem = linked(arcs, coupling="sin(y)", gains="1/10", region=region)
    assert enclosed(problem, *[1.0] * 61) is None
    claim = boxed(*[F(1)] * 61)
    assert not is_proved(problem, claim)
    assert enclosed(listening_pair(), math.nan, 1.0) is None
    claim = boxed(F(0), F(10) ** 6)
    assert not is_proved(listening_pair("exp(y) - 1"), claim)


def test_a_check_is_confirmed_from_its_json_and_for_no_other_problem():
    problem = listening_pair()
    check = check_from_json(refuting(problem).to_json())
    assert confirmed(check, problem) is None
    assert "-1.65387" in check.reason
    assert confirmed(check, listening_pair(gains="2/10")) is not None
    assert confirmed(check, listening_pair("tanh(y)")) is not None
    # without a region the question is about every neighbourhood of the target
    free = listening_pair(reach=None)
    assert is_proved(free, ROOT)
    assert refuting(free) is None


def test_a_y_that_is_not_invertible_and_a_field_that_is_hardly_known_prove_nothing():
    """Y = 0 maps every box into itself, not into its interior; f(c) in [-1, 1] may be anything."""
    loop = loop_of(listening_pair())
    slopes = slopes_on(loop, "G", ROOT.box)
    value = field_at(loop, "G", ROOT.middle)
    middle = np.zeros((2, 2))
    for place, slope in slopes.items():
        middle[place] = float(slope.midpoint)
    Y = tuple(tuple(map(F, row)) for row in np.linalg.inv(middle).tolist())
    nothing = exact_matrix("0 0; 0 0")
    anything = (Interval(F(-1), F(1)),) * 2
    assert krawczyk_holds(ROOT, value, slopes, Y, F(1))
    assert not krawczyk_holds(ROOT, value, slopes, nothing, F(1))
    assert not krawczyk_holds(ROOT, anything, slopes, Y, F(1))


def test_agents_without_a_target_rest_anywhere_and_nothing_is_refuted():
    """Both at 1 agree, though the error system rests there and not at 0."""
    at_one = Equilibrium(mode="G", box=(Interval(F(1), F(1)), Interval(F(1), F(1))))
    arcs = [[1, 2], [2, 1]]
    assert refusal(linked(arcs, 2, gains={}), at_one) is None
    assert refusal(linked(arcs, 2, goal="agreement"), at_one) == (
        "agents without a target may rest anywhere."
    )
