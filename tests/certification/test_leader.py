"""Leaders, s' = A s or f(s): what is proved of every s, the box that s never leaves, and runs
beside it."""

import json
from contextlib import nullcontext
from fractions import Fraction
from functools import cache
from itertools import product
from typing import Any

import control
import numpy as np
import pytest
from checker_files.files import second_loop
from scipy.integrate import solve_ivp

from dobc_design import (
    Certificate,
    Dynamics,
    Exosystem,
    Network,
    Observer,
    Problem,
    Stress,
    Verdict,
    build_model,
    certify,
    export,
    falsify,
    load_problem,
    simulate,
    verify,
    what_breaks_first,
)
from dobc_design.certificate.text import certificate_bytes
from dobc_design.checker.loop import leader_box
from dobc_design.checker.reading import Refused
from dobc_design.conditions.coverage import asked_radius
from dobc_design.conditions.quadratic.sectors import slopes_of_node
from dobc_design.errors import SpecError
from dobc_design.exact.interval import Interval
from dobc_design.loop.make import loop_of
from dobc_design.problem.canonical import canonical_bytes, problem_from_canonical
from dobc_design.problem.leader import Leader, enclosure, open_faces

TENTHS: dict[str, Any] = {"initial": [["-1/4", "1/4"]] * 2, "stays_in": [["-3/10", "3/10"]] * 2}
RING = Network.from_arcs([[2, 1], [3, 2], [1, 3]], arrow="listens_to", agents=3)
SPIKES = Dynamics(f=["x1 - x1**3/3 - x2 + 1/2", "0.08*(x1 + 0.7 - 0.8*x2)"])
SQUARE: dict[str, Any] = {"initial": [[-1, 1], [-1, 1]]}
SEEN = {"exosystem": Exosystem(A=[[0, 1], [-1, 0]], C=[[1, 0]]), "observer": Observer(W=[[2], [0]])}


def oscillators(gain: Any = 2, **more: Any) -> Problem:
    """Coupled harmonic oscillators behind a leader (Ren 2008): x1'' = -x1, coupled by their
    speeds."""
    A = [[0, 1], [-1, 0]]
    B = [[0], [1]]
    own = Dynamics(A=A, B=B)
    gains = {1: [[0, gain]]} if gain else None
    given: dict[str, Any] = {"network": RING, "leader": SQUARE}
    given |= {"coupling": "y2", "gains": gains, "dynamics": own}
    return Problem(**given | more)


def spiking(gain: Any = 2, **more: Any) -> Problem:
    """FitzHugh-Nagumo nodes that fire, all pinned to a leader that does."""
    given: dict[str, Any] = {"network": RING, "leader": SQUARE}
    given |= {"coupling": "y", "gains": gain, "dynamics": SPIKES}
    return Problem(**given | more)


# at the target f = (1/2, 0.056): it moves off, in a box whose face f touches at a corner
AT_REST = {"initial": [0, 0]}


def touching() -> Problem:
    """Agent 1 is pinned to the leader in its first state, and agent 2 hears agent 1."""
    arcs = [[2, 1]]
    line = Network.from_arcs(arcs, arrow="listens_to", agents=2)
    f = list(SPIKES.f or ())
    B = [[1], [0]]
    own = Dynamics(f=f, B=B)
    gains = {1: [[10, 0]]}
    return Problem(network=line, coupling="6*y1", gains=gains, dynamics=own, leader=AT_REST)


PROVED, REFUTED, UNDECIDED = Verdict.PROVED, Verdict.REFUTED, Verdict.UNDECIDED
LINEAR = "linearisation"
#: A problem, what is decided, and the check that proves it.
WIDE = {"initial_states": [-9, 9]}
# f_1 = 0 at two corners of the box, which are no floating-point numbers
FACES = Dynamics(f=["x2 - x1", "-x1/2 - x2 - x2**3"])
SMALL = SQUARE | {"stays_in": [[-1, 1], [-1, 1]]}
CASES: dict[str, tuple[Problem, Verdict, str | None]] = {
    "oscillators": (oscillators(), PROVED, LINEAR),
    "touching": (touching(), PROVED, "lure"),
    "seen": (oscillators(**SEEN), PROVED, LINEAR),
    "in formation": (oscillators(offsets={2: [1, 0]}), PROVED, LINEAR),
    "in a region": (oscillators(region=WIDE), PROVED, LINEAR),
    "pushed": (oscillators(-2), REFUTED, None),
    # e alike in all agents obeys e' = A e, and A turns it
    "nobody pinned": (oscillators(0), REFUTED, None),
    "spiking": (spiking(), PROVED, "lure"),
    "along a face": (spiking(dynamics=FACES, leader=TENTHS), PROVED, "lure"),
    # where |s_1| < 1/4 all errors alike grow
    "let go": (spiking("9/10"), UNDECIDED, None),
    "no box": (spiking(leader=SMALL), UNDECIDED, None),
}


@cache
def certified(name: str) -> Certificate:
    return certify(CASES[name][0])


LONG = dict.fromkeys(("along a face", "let go", "touching"), pytest.mark.slow)
LONG["spiking"] = pytest.mark.evidence
NAMES = [pytest.param(name, marks=LONG.get(name, ())) for name in CASES]


@pytest.mark.parametrize("name", NAMES)
def test_both_programs_agree_on_who_follows(name: str):
    problem, verdict, by = CASES[name]
    certificate = certified(name)
    assert certificate.verdict == verdict
    assert certificate.covered_by == by
    assert verify(certificate, problem).holds
    own = ("reachability", "arc-wise", "lure", "observability", "hurwitz")
    others = [each.reason for each in certificate.checks if each.id not in own]
    about = all(each.startswith("does not apply: the leader moves") for each in others)
    assert about is loop_of(problem).slopes_move


def test_a_linear_leader_leaves_the_claims_of_a_constant_target():
    """e' does not depend on s: everything but the region is that of the target 0."""
    led = certify(oscillators())
    still = certify(oscillators(leader=None, target=[0, 0]))
    exact_of_led = [each.exact for each in led.checks]
    exact_of_still = [each.exact for each in still.checks]
    assert exact_of_led == exact_of_still
    assert led.rate == still.rate


def test_why_nothing_is_proved_is_said():
    no_box = certified("no box").check("lure").reason
    assert no_box.startswith("does not apply: [leader] stays_in is not shown to be invariant")
    alone = Network.from_arcs([], arrow="listens_to", agents=1)
    cubic = Dynamics(f=["x - x**3"])
    led = {"initial": 0, "stays_in": [-1, 1]}
    # where |s| < 1/6 the error grows
    let_go = certify(spiking("9/10", network=alone, dynamics=cubic, leader=led))
    assert let_go.verdict is UNDECIDED
    assert "no quadratic V" in let_go.check("lure").reason
    undamped = Dynamics(f=["x2", "-x1 - x1**3"])
    led = {"initial": [1, 1]}
    lost = certify(spiking(99, network=alone, dynamics=undamped, leader=led))
    told = "could not be enclosed in a box; give [leader] stays_in"
    assert told in lost.check("lure").reason


def test_the_region_is_asked_for_wherever_the_leader_starts():
    """max |lo - s|, |hi - s| by hand: x in [-3, 5], s in [-1, 2]; x in [0, 1], s in [-2, -2]."""
    region = {"initial_states": [[-3, 5], [0, 1]]}
    leader = {"initial": [[-1, 2], -2]}
    offsets = {2: [1, 0]}
    led = oscillators(region=region, leader=leader, offsets=offsets)
    assert asked_radius(loop_of(led)) == (6, 3)


# --- the box that a leader never leaves
def flow(time: float, s: Any) -> list[float]:
    cubic = s[0] - s[0] ** 3 / 3
    first = cubic - s[1] + 0.5
    second = 0.08 * (s[0] + 0.7 - 0.8 * s[1])
    return [first, second]


#: Boxes, and the faces (component, upper) through which solutions leave them.
BOXES: list[tuple[Any, list[tuple[int, bool]]]] = []


def box_of(first: Any, second: Any, *left: tuple[int, bool]) -> None:
    """One more box."""
    BOXES.append(([first, second], list(left)))


X = [-3, 3]
box_of(X, ["-4.7", "4.7"])
# On x1 = 3 f1 = -5.5 - x2, on x1 = -3 6.5 - x2: the twins just fail.
box_of(X, ["-5.5", "6.5"])
box_of(X, ["-5.51", "6.5"], (0, True))
box_of(X, ["-5.5", "6.51"], (0, False))
# On x2 = hi f2 has the sign of x1 + 0.7 - 0.8 hi.
box_of(X, ["-4.7", "4.625"])
box_of(X, ["-4.7", "4.624"], (1, True))
box_of(X, ["-2.874", "4.7"], (1, False))
# On x2 = -3 f2 = 0.08 (x1 + 3.1) is 0 at the corner.
box_of(["-3.1", "2.7"], [-3, "4.5"])
box_of(["-3.11", "2.7"], [-3, "4.5"], (1, False))


@pytest.mark.slow
@pytest.mark.parametrize(("box", "left"), BOXES)
def test_a_box_is_invariant_where_f_points_inwards_on_its_faces(box: Any, left: Any):
    """The twin that just fails is left by a solution that begins at a corner."""
    sides = tuple(Interval(Fraction(lo), Fraction(hi)) for lo, hi in box)
    assert list(open_faces(SPIKES, sides)) == left
    ends = []
    first_side = map(float, box[0])
    second_side = map(float, box[1])
    for corner in product(first_side, second_side):
        run = solve_ivp(flow, (0, 1e-5), corner, rtol=1e-12, atol=1e-14)
        ends.append(run.y[:, -1])
    low, high = np.array(box, dtype=float).T
    outside = any((end < low - 1e-12).any() or (end > high + 1e-12).any() for end in ends)
    assert outside is bool(left)
    leader = {"initial": [0, 0], "stays_in": box}
    second = second_loop(spiking(leader=leader))
    with pytest.raises(Refused, match="point inwards") if left else nullcontext():
        leader_box(second)


def test_a_box_is_found_in_which_solutions_stay():
    leader = spiking().leader
    assert leader is not None
    box = enclosure(SPIKES, leader)
    assert box is not None
    assert not list(open_faces(SPIKES, box))
    low, high = np.array([[float(side.lo), float(side.hi)] for side in box]).T
    starts = np.random.default_rng(0)
    for start in starts.uniform(low, high, (8, 2)):
        run = solve_ivp(flow, (0, 40), start, rtol=1e-9)
        states = run.y.T
        assert (states >= low - 1e-6).all()
        assert (states <= high + 1e-6).all()
    sides = tuple((side.lo, side.hi) for side in box)
    given = Leader(initial=leader.initial, stays_in=sides)
    assert enclosure(SPIKES, given) == box


def test_slopes_of_nodes_hold_those_between_leader_and_agents():
    """(f(s + e) - f(s)) = F e: for f = x - x^3 F = 1 - 3 s^2 - 3 s e - e^2, seen in [1 - 3 (1 +
    2)^2, 1]."""
    own = Dynamics(f=["x - x**3"])
    leader = {"initial": 0, "stays_in": [-1, 1]}
    problem = spiking(4, dynamics=own, leader=leader)
    errors = Interval(Fraction(-2), Fraction(2))
    ((found,),) = slopes_of_node(loop_of(problem), (errors,))
    rng = np.random.default_rng(0)
    lower = [[-1], [-2]]
    upper = [[1], [2]]
    s, e = rng.uniform(lower, upper, (2, 500))
    means = 1 - 3 * s**2 - 3 * s * e - e**2
    assert float(found.lo) <= means.min()
    assert means.max() <= float(found.hi)
    assert found.contains(Interval(Fraction(-26), Fraction(1)))
    assert found.width < Fraction(2701, 100)


# --- files and runs
def test_a_file_keeps_the_leader_and_the_box_that_was_found():
    problem = spiking()
    document = canonical_bytes(problem)
    table = json.loads(document)["leader"]
    assert table["initial"] == [["-1", "1"], ["-1", "1"]]
    assert len(table["stays_in"]) == 2
    assert canonical_bytes(problem_from_canonical(document)) == document
    linear = json.loads(canonical_bytes(oscillators()))
    assert "stays_in" not in linear["leader"]
    assert "leader" not in json.loads(canonical_bytes(load_problem("platoon")))


CURVED = {"dynamics": SPIKES, "coupling": "y", "gains": 1}
NO_DYNAMICS = {"dynamics": None, "coupling": "y", "gains": 1}
LEFT = SQUARE | {"stays_in": [[-9, 9], [-9, 9]]}
APART = SQUARE | {"stays_in": [[-1, 1], ["-1/2", 1]]}
#: What is told of a mistake, by what an oscillator is given in place of its own.
MISTAKES: dict[str, dict[str, Any]] = {
    "leader needs \\[dynamics\\]": NO_DYNAMICS | {"target": [0, 0]},
    "target must be left out, or 0": {"target": [1, 0]},
    "leader.stays_in": {"leader": LEFT},
    "leader.initial": {"leader": {"initial": [1]}},
    "leader.start is an unknown key": {"leader": {"start": [0, 0]}},
    "leader.stays_in must hold leader.initial": CURVED | {"leader": APART},
    "formation": CURVED | {"offsets": {1: [1, 0]}},
    "formation.offsets.2 must be an equilibrium": {"offsets": {2: [0, 1]}},
}


@pytest.mark.parametrize("told", MISTAKES)
def test_a_mistake_is_named(told: str):
    with pytest.raises(SpecError, match=told):
        oscillators(**MISTAKES[told])


@pytest.mark.slow
def test_other_claims_beside_the_problem_with_another_leader_fail():
    certificate = certified("spiking")
    initial = [[-2, 1], [-1, 1]]
    other = spiking(leader={"initial": initial})
    assert not verify(certificate, other).holds
    assert b'"lure"' in certificate_bytes(certificate.claims)


@pytest.mark.parametrize("problem", [oscillators(**SEEN), spiking(4)], ids=["linear", "nonlinear"])
def test_runs_are_those_of_the_whole_loop_and_stay_below_what_is_proved(problem: Problem):
    """x, xi, xihat and s by SciPy, x' = A x or f(x) plus B (h + u + d), u = -K (x - s) - dhat."""
    run = simulate(problem, t_final=6, samples=13, seed=3)
    n = problem.n
    own = problem.dynamics
    assert own is not None
    B = np.array(own.B, dtype=float)
    A = None if own.A is None else np.array(own.A, dtype=float)
    nothing = np.zeros((B.shape[1], 2))
    K = []
    for i in range(n):
        K.append(np.array(problem.pinning.gains.get(i, nothing), dtype=float))
    S = np.zeros((0, 0))
    C = np.zeros((1, 0))
    W = np.zeros((0, 1))
    if problem.exosystem is not None:
        S = np.array(problem.exosystem.A, dtype=float)
        C = np.array(problem.exosystem.C, dtype=float)
        W = np.array(problem.observer.W, dtype=float)
    q = len(S)

    def moved(x: Any) -> Any:
        if A is None:
            return np.array([flow(0, each) for each in x])
        return x @ A.T

    def slope(_: float, state: Any) -> Any:
        end_of_x = (2 + q) * n
        end_of_xi = (2 + 2 * q) * n
        ends = [2 * n, end_of_x, end_of_xi]
        x, xi, eps, s = np.split(state, ends)
        x = x.reshape(n, 2)
        xi = xi.reshape(n, -1)
        eps = eps.reshape(n, -1)
        pulls = []
        for k, each in zip(K, x, strict=True):
            pulls.append(k @ (each - s))
        u = -np.array(pulls) - (xi - eps) @ C.T
        heard = x[[2, 0, 1]] - x
        # oscillators are coupled by their speeds
        felt = heard if A is None else heard[:, 1:]
        acts = felt + u + xi @ C.T
        driven = acts @ B.T
        x_dot = moved(x) + driven
        xi_dot = xi @ S.T
        eps_dot = eps @ (S - W @ C).T
        parts = (x_dot, xi_dot, eps_dot, moved(s[None])[0])
        return np.concatenate([part.ravel() for part in parts])

    start = (run.x[0], run.xi[0], run.xi[0] - run.xihat[0], run.leader[0])
    first = np.concatenate([each.ravel() for each in start])
    whole = solve_ivp(slope, (0, 6), first, t_eval=run.times, rtol=1e-10, atol=1e-12)
    states = whole.y[: 2 * n].T
    x = states.reshape(-1, n, 2)
    assert np.abs(x - run.x).max() < 1e-7
    leader = whole.y[-2:]
    missed = leader.T - run.leader
    assert np.abs(missed).max() < 1e-7
    many = simulate(problem, runs=2, t_final=6, samples=13, seed=3)
    apart = many.states[0] - run.x
    assert np.abs(apart).max() < 1e-7
    leaders_apart = many.leader[0] - run.leader
    assert np.abs(leaders_apart).max() < 1e-7
    assert run.error()[-1] < run.error()[0] / 2
    assert abs(run.leader[-1]).max() > 0.1


@pytest.mark.parametrize(
    "problem", [oscillators(**SEEN, offsets={2: [1, 0]}), spiking(4)], ids=["linear", "nonlinear"]
)
def test_python_control_and_casadi_have_the_same_loop(problem: Problem):
    """A response of the first is the run, whose s it has as states; the second has s as an
    input."""
    run = simulate(problem, t_final=3, samples=7)
    loop = export.to_control(problem)
    tight = {"rtol": 1e-9, "atol": 1e-11}
    first = loop.start_of(run)
    response = control.input_output_response(loop, run.times, 0, first, solve_ivp_kwargs=tight)
    states = response.outputs[: 2 * problem.n].T
    x = states.reshape(run.x.shape)
    assert np.abs(x - run.x).max() < 1e-6
    model = build_model(problem)
    W = loop.loop.W.T
    injection = run.x[3] @ W
    z = run.xihat[3] - injection
    xi = run.xi[3].ravel()
    parts = [run.x[3].ravel(), xi, z.ravel(), run.leader[3]]
    slopes = [np.ravel(each) for each in model.closed_loop(*parts)]
    no_input = np.zeros(loop.ninputs)
    known = loop.dynamics(0, np.concatenate(parts), no_input)
    assert np.abs(np.concatenate(slopes) - known).max() < 1e-12
    eps = (run.xi - run.xihat)[3].ravel()
    e = run.errors()[3].ravel()
    derivatives = model.error_dynamics(e, eps, run.leader[3])
    e_dot = np.ravel(derivatives[0])
    moves = np.tile(slopes[3], problem.n)
    assert np.abs(slopes[0] - moves - e_dot).max() < 1e-12


@pytest.mark.parametrize(
    "refused",
    [
        lambda problem: simulate(problem, observer="full-loop"),
        lambda problem: simulate(problem, stress=Stress(noise=1)),
        falsify,
        what_breaks_first,
        export.python_script,
    ],
)
def test_what_knows_no_leader_refuses_it(refused: Any):
    with pytest.raises(SpecError, match=r"leader.*not available yet for a target that moves"):
        refused(oscillators())


@pytest.mark.slow
def test_errors_near_a_leader_stay_below_the_bound_of_the_certificate(tmp_path: Any):
    problem = spiking(4, leader={"initial": ["1/2", "1/4"]})
    certificate = certify(problem)
    radius = certificate.check("lure").domain.radius
    rng = np.random.default_rng(1)
    drawn = rng.uniform(-1, 1, (3, 2))
    start = np.array([0.5, 0.25]) + drawn * radius / 3
    run = simulate(problem, start=start, t_final=8)
    bound = certificate.envelope(run)
    assert bound.sources
    assert (run.error() <= bound(run.times)).all()
    assert (run.error() > 0).all()
    assert certificate.rate > 0.5
    run.plot(certificate=certificate).save(tmp_path / "run.png")
