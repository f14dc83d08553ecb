"""The quadratic certificate of a region: radii of the theory, when it stops, what it says where it
does not reach."""

import math
from fractions import Fraction
from typing import Any

import pytest
from networks import linked
from regional_problems import HARMONIC, PAPER, PAPER_GAIN

import dobc_design as dd
from dobc_design import Check, Observer, Problem, Region, Verdict
from dobc_design.certification.overall import decide_overall
from dobc_design.conditions.coverage import Asked, read_region
from dobc_design.conditions.domain import EVERYWHERE, NEAR_TARGET
from dobc_design.conditions.quadratic import stage as quadratic
from dobc_design.conditions.quadratic.sectors import enclose_ranges, gains_on
from dobc_design.conditions.quadratic.stage import quadratic_stage
from dobc_design.loop.make import loop_of
from dobc_design.problem.load import read_problem_text

LOOKING = "deciding the region (quadratic)"


def ring(
    n: int, gains: Any, *, side: str | None = "1", coupling: Any = PAPER, s: str | None = None
) -> Problem:
    """Agent i listens to agent i + 1; every |e_i| <= side; with ``s`` also the paper's observer."""
    agents = range(1, n + 1)
    arcs = [[i, i % n + 1] for i in agents]
    given: dict[str, Any] = {"coupling": coupling, "gains": gains}
    if side is not None:
        side_range = ((-Fraction(side), Fraction(side)),)
        states = side_range * (len(coupling) if isinstance(coupling, list) else 1)
        given["region"] = Region(
            initial_states=states, initial_disturbance=None if s is None else Fraction(s)
        )
    if s is not None:
        given |= {"exosystem": HARMONIC, "observer": Observer(W=PAPER_GAIN)}
    return linked(arcs, n, **given)


def asked(problem: Problem, *, everything: bool = False) -> Asked:
    domain = EVERYWHERE if problem.is_linear else NEAR_TARGET
    return read_region(loop_of(problem), problem.observer.W, domain=domain, everything=everything)


def stage(problem: Problem, *, everything: bool = False) -> tuple[Check, list[str]]:
    said: list[str] = []
    (check,) = quadratic_stage(asked(problem, everything=everything), said.append)
    return check, said


@pytest.mark.slow
@pytest.mark.parametrize(("gains", "ball"), [(3, 2.927), ({1: 3}, 1.138)])
def test_the_largest_ball_is_that_of_the_theory(gains, ball):
    """Theory, section 9, directed 10-cycle, full P_e: within 1 %; the ball asked for, about 12.6,
    is not reached."""
    problem = ring(10, gains, side="4")
    check, said = stage(problem)
    assert check.verdict is Verdict.PROVED
    assert 0.99 * ball < check.domain.radius < 1.005 * ball
    assert check.domain.disturbance == 0.0
    assert said == [LOOKING]
    assert check.reason.endswith("the region needs 12.6491: beyond, no quadratic V is found.")


@pytest.mark.slow
def test_a_ball_that_is_too_small_is_told_with_the_one_asked_for():
    """Two agents that hear each other, one k = 3, reach 3.15; sides of 4 ask for sqrt(32).
    The verdict says which is the ball and which the bound of an agent."""
    problem = ring(2, {1: 3}, side="4")
    check, _ = stage(problem)
    assert check.verdict is Verdict.PROVED
    assert check.domain.radius == pytest.approx(3.15, abs=0.01)
    whole = decide_overall(loop_of(ring(2, {1: 3}, side="4")), [check], None).reason
    assert f"from the ball |e| <= {check.domain.radius} of all errors together (lure)" in whole
    assert (
        "asks for |e_i| <= 4 for every agent; a ball that holds these needs |e| <= 5.656" in whole
    )
    assert check.reason.endswith("the region needs 5.65685: beyond, no quadratic V is found.")


@pytest.mark.evidence
def test_where_the_region_is_covered_it_raises_the_rate():
    """All k = 3: 2.914 is the largest ball, the one asked for sqrt(6)/2; near the consensus errors
    decay at 3 1/s."""
    problem = ring(6, 3, side="1/2")
    check, said = stage(problem)
    assert said == [LOOKING, "deciding the region (quadratic, its rate)"]
    assert check.domain.radius >= math.sqrt(6) / 2
    assert 1.5 <= check.rate < 3
    assert "beyond" not in check.reason
    # sqrt(6) 1.25 = 3.06, just more than it reaches
    beyond, said = stage(ring(6, 3, side="1.25"))
    assert beyond.domain.radius < math.sqrt(6) * 1.25
    assert said == [LOOKING]


@pytest.mark.slow
def test_with_a_disturbance_the_ball_is_smaller_and_with_a_large_one_there_is_none():
    problem = ring(3, 3, side="3", s="0")
    free, _ = stage(problem)
    problem = ring(3, 3, side="3", s="1/4")
    some, _ = stage(problem)
    assert some.domain.disturbance == 0.25
    assert some.domain.radius < free.domain.radius
    problem = ring(3, 3, side="3", s="50")
    none, _ = stage(problem)
    assert none.verdict == Verdict.UNDECIDED
    assert none.domain == NEAR_TARGET
    assert none.exact is None
    assert "|eps_i| <= 50: a smaller initial disturbance may help" in none.reason


def test_linear_couplings_are_certified_everywhere_with_a_rate():
    """One pin, h = 2 y: e'e may grow, a full P_e does it; the linear system decays at the largest
    real part."""
    problem = ring(5, {1: 4}, coupling="2*y")
    check, _ = stage(problem)
    assert check.verdict == Verdict.PROVED
    assert check.domain == EVERYWHERE
    assert check.exact["level"] is None
    assert check.rate > 0


@pytest.mark.slow
def test_a_coupling_that_no_arc_has_still_gives_a_ball_which_both_programs_accept():
    """e' = -k e: every level will do, and claims about all of space are for couplings that are
    linear as written."""
    region = {"initial_states": [-4, 0]}
    problem = linked([], 1, coupling="tanh(y)", gains=1, target=-3, region=region)
    certificate = dd.certify(problem, everything=True)
    (check,) = [check for check in certificate.checks if check.id == "lure"]
    assert check.verdict is Verdict.PROVED
    assert check.domain.radius >= 3
    assert dd.verify(certificate, problem).holds


@pytest.mark.slow
def test_where_nothing_is_found_where_it_is_left_out_and_where_it_does_not_apply():
    problem = ring(3, {1: 1}, coupling="-y + y**3")
    check, _ = stage(problem)
    assert check.verdict is Verdict.UNDECIDED
    assert check.reason == "no quadratic V is found, not even close to the target."
    check, said = stage(ring(21, 3))  # where arc-wise certificates are looked for
    assert said == []
    assert "with 21 rows n m; it is examined up to 20." in check.reason
    check, said = stage(ring(31, 3, coupling=["sin(y1) + y2", "sin(y2)"]))
    assert said == []
    assert "with 62 rows n m; it is examined up to 60." in check.reason
    loop = loop_of(ring(3, 3, s="1"))
    asked_for = read_region(loop, None, domain=NEAR_TARGET, everything=False)
    (check,) = quadratic_stage(asked_for, lambda _: None)
    assert check.reason.startswith("does not apply:")


def test_a_library_that_breaks_down_costs_the_certificate_only(monkeypatch):
    def broken(*_: Any, **__: Any) -> None:
        raise RuntimeError("no convergence")

    monkeypatch.setattr(quadratic, "design_lure", broken)
    check, _ = stage(ring(3, 3))
    assert check.verdict is Verdict.UNDECIDED


@pytest.mark.parametrize("text", ["exp(y) - 1 + y", "sin(y)", "y + abs(y)/3", "tanh(y)"])
def test_gains_are_claimed_with_room_on_both_sides(text):
    problem = ring(2, 1, coupling=text)
    tight_gains = gains_on(problem.couplings[0], Fraction(2))
    wide_gains = enclose_ranges(loop_of(problem), radius=Fraction(2))[0].entries
    ((tight,),), ((wide,),) = (tight_gains, wide_gains)
    assert wide.lo < tight.lo
    assert tight.hi < wide.hi
    tolerance = Fraction(1, 10_000) * (1 + tight.magnitude)
    assert wide.width < tight.width + tolerance
    linear = ring(2, 1, coupling="3*y/7")
    found = enclose_ranges(loop_of(linear), radius=Fraction(2))
    expected = gains_on(linear.couplings[0], Fraction(2))
    assert found[0].entries == expected


@pytest.mark.slow
def test_couplings_of_vectors_are_covered_by_it_and_both_programs_accept():
    """Max-separable does not apply to a list; h = (y1 + tanh(y2)/5, y2), every |e_ic| <= 1."""
    problem = ring(3, 3, coupling=["y1 + tanh(y2)/5", "y2"])
    certificate = dd.certify(problem)
    assert certificate.verdict == Verdict.PROVED
    assert certificate.covered_by == "lure"
    outcome = dd.verify(certificate, problem)
    assert outcome.holds
    assert outcome.lone_checker == "it accepts every claim"
    repelling, _ = stage(ring(3, 1, coupling=["-y1 + tanh(y2)/5", "-y2"]))
    assert repelling.verdict is Verdict.UNDECIDED


@pytest.mark.slow
def test_without_a_region_it_runs_on_request_and_covers_nothing():
    problem = ring(7, 3, side=None)
    assert "lure" not in {check.id for check in dd.certify(problem).checks}
    certificate = dd.certify(problem, everything=True)
    lure = next(check for check in certificate.checks if check.id == "lure")
    assert lure.verdict is Verdict.PROVED
    assert "no region is asked for" in lure.reason
    assert certificate.covered_by != "lure"


#: Kuramoto oscillators with inertia (ten machines, fifteen lines), half of them pinned.
SWING = """
target = [0, 0]
[network]
agents = 10
arrow = "listens_to"
[network.modes]
g = [[1, 4], [1, 7], [1, 9], [2, 3], [2, 8], [2, 10], [3, 7], [3, 6], [4, 6], [4, 10], [5, 10],
[5, 9], [5, 6], [7, 8],
  [8, 9], [4, 1], [7, 1], [9, 1], [3, 2], [8, 2], [10, 2], [7, 3], [6, 3], [6, 4], [10, 4],
  [10, 5], [9, 5], [6, 5],
  [8, 7], [9, 8]]
[dynamics]
f = ["x2", "-0.1*x2"]
B = [[0], [1]]
[coupling]
h = "4*sin(y1)"
[pinning.gains]
1 = [[1, 1]]
2 = [[1, 1]]
3 = [[1, 1]]
4 = [[1, 1]]
5 = [[1, 1]]
[exosystem]
constant = true
[region]
initial_states = [[-0.02, 0.02], [-0.02, 0.02]]
initial_disturbance = 0.02
"""


@pytest.mark.slow
def test_ten_swing_equations_are_proved_in_the_usual_order():
    """No coordinates make the rows dominant, and no diagonal P_e does: a full one of 20 rows."""
    problem = read_problem_text(SWING.encode(), folder=None)
    certificate = dd.certify(problem)
    assert certificate.verdict == Verdict.PROVED
    assert certificate.covered_by == "lure"
    lure = next(check for check in certificate.checks if check.id == "lure")
    assert lure.domain.radius >= 0.278


@pytest.mark.parametrize(("n", "wanted"), [(10, ["diagonal", "full"]), (11, ["diagonal"])])
def test_where_arc_wise_certificates_do_not_apply_a_diagonal_p_e_is_tried_first(
    n: int, wanted: list[str], monkeypatch: pytest.MonkeyPatch
):
    shapes: list[str] = []
    monkeypatch.setattr(quadratic, "design_lure", lambda *_, shape, **__: shapes.append(shape))
    problem = ring(n, 3, coupling=["sin(y1) + y2", "sin(y2)"])
    check, _ = stage(problem)
    assert check.verdict is Verdict.UNDECIDED
    assert shapes == wanted
    stage(ring(n, 3))
    assert shapes == [*wanted, "full"]


def test_a_search_that_is_cut_says_whether_a_longer_one_exists(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(quadratic, "STAGE", 1)
    for everything in (False, True):
        check, _ = stage(ring(3, 3), everything=everything)
        assert check.cut
        assert check.longer is not everything
