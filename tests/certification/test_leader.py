"""Leaders, s' = A s or f(s): what is proved of every s, the box that s never leaves, and runs
beside it."""

import json
from contextlib import nullcontext
from fractions import Fraction
from functools import cache
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
    own = Dynamics(A=[[0, 1], [-1, 0]], B=[[0], [1]])
    gains = {1: [[0, gain]]} if gain else None
    return Problem(
        **{"network": RING, "coupling": "y2", "gains": gains, "dynamics": own, "leader": SQUARE}
        | more
    )


def spiking(gain: Any = 2, **more: Any) -> Problem:
    """FitzHugh-Nagumo nodes that fire, all pinned to a leader that does."""
    return Problem(
        **{"network": RING, "coupling": "y", "gains": gain, "dynamics": SPIKES, "leader": SQUARE}
        | more
    )


# at the target f = (1/2, 0.056): it moves off, in a box whose face f touches at a corner
AT_REST = {"initial": [0, 0]}


def touching() -> Problem:
    """Agent 1 is pinned to the leader in its first state, and agent 2 hears agent 1."""
    line, own = (
        Network.from_arcs([[2, 1]], arrow="listens_to", agents=2),
        Dynamics(f=list(SPIKES.f or ()), B=[[1], [0]]),
    )
    return Problem(
        network=line, coupling="6*y1", gains={1: [[10, 0]]}, dynamics=own, leader=AT_REST
    )


PROVED, REFUTED, UNDECIDED = Verdict.PROVED, Verdict.REFUTED, Verdict.UNDECIDED
CASES = {
    "oscillators": (oscillators(), PROVED, "linearisation"),
    "touching": (touching(), PROVED, "lure"),
    "seen": (oscillators(**SEEN), PROVED, "linearisation"),
    "in formation": (oscillators(offsets={2: [1, 0]}), PROVED, "linearisation"),
    "in a region": (oscillators(region={"initial_states": [-9, 9]}), PROVED, "linearisation"),
    "pushed": (oscillators(-2), REFUTED, None),
    # e alike in all agents obeys e' = A e, and A turns it
    "nobody pinned": (oscillators(0), REFUTED, None),
    "spiking": (spiking(), PROVED, "lure"),
    # f_1 = 0 at two corners of the box, which are no floating-point numbers
    "along a face": (
        spiking(dynamics=Dynamics(f=["x2 - x1", "-x1/2 - x2 - x2**3"]), leader=TENTHS),
        PROVED,
        "lure",
    ),
    "let go": (spiking("9/10"), UNDECIDED, None),  # where |s_1| < 1/4 all errors alike grow
    "no box": (spiking(leader=SQUARE | {"stays_in": [[-1, 1], [-1, 1]]}), UNDECIDED, None),
}


@cache
def certified(name: str) -> Certificate:
    return certify(CASES[name][0])


LONG = {
    "along a face": pytest.mark.slow,
    "let go": pytest.mark.slow,
    "spiking": pytest.mark.evidence,
}


@pytest.mark.parametrize("name", [pytest.param(name, marks=LONG.get(name, ())) for name in CASES])
def test_both_programs_agree_on_who_follows(name: str):
    problem, verdict, by = CASES[name]
    certificate = certified(name)
    assert (certificate.verdict, certificate.covered_by) == (verdict, by)
    assert verify(certificate, problem).holds
    own = ("reachability", "lure", "observability", "hurwitz")
    others = [each.reason for each in certificate.checks if each.id not in own]
    about = all(each.startswith("does not apply: the leader moves") for each in others)
    assert about is loop_of(problem).slopes_move


def test_a_linear_leader_leaves_the_claims_of_a_constant_target():
    """e' does not depend on s: everything but the region is that of the target 0."""
    led, still = (
        certify(oscillators(**given)) for given in ({}, {"leader": None, "target": [0, 0]})
    )
    assert [each.exact for each in led.checks] == [each.exact for each in still.checks]
    assert led.rate == still.rate


def test_why_nothing_is_proved_is_said():
    no_box = certified("no box").check("lure").reason
    assert no_box.startswith("does not apply: [leader] stays_in is not shown to be invariant")
    alone = Network.from_arcs([], arrow="listens_to", agents=1)
    cubic = {"dynamics": Dynamics(f=["x - x**3"]), "leader": {"initial": 0, "stays_in": [-1, 1]}}
    let_go = certify(spiking("9/10", network=alone, **cubic))  # where |s| < 1/6 the error grows
    assert let_go.verdict is UNDECIDED and "no quadratic V" in let_go.check("lure").reason
    undamped = Dynamics(f=["x2", "-x1 - x1**3"])
    lost = certify(spiking(99, network=alone, dynamics=undamped, leader={"initial": [1, 1]})).check(
        "lure"
    )
    assert "could not be enclosed in a box; give [leader] stays_in" in lost.reason


def test_the_region_is_asked_for_wherever_the_leader_starts():
    """max |lo - s|, |hi - s| by hand: x in [-3, 5], s in [-1, 2]; x in [0, 1], s in [-2, -2]."""
    region = {"initial_states": [[-3, 5], [0, 1]]}
    led = oscillators(region=region, leader={"initial": [[-1, 2], -2]}, offsets={2: [1, 0]})
    assert asked_radius(loop_of(led)) == (6, 3)


# --- the box that a leader never leaves
def flow(time: float, s: Any) -> list[float]:
    return [s[0] - s[0] ** 3 / 3 - s[1] + 0.5, 0.08 * (s[0] + 0.7 - 0.8 * s[1])]


@pytest.mark.parametrize(
    ("box", "left"),
    [
        ([[-3, 3], ["-4.7", "4.7"]], []),
        # On x1 = 3 f1 = -5.5 - x2, on x1 = -3 6.5 - x2: the twins just fail.
        ([[-3, 3], ["-5.5", "6.5"]], []),
        ([[-3, 3], ["-5.51", "6.5"]], [(0, True)]),
        ([[-3, 3], ["-5.5", "6.51"]], [(0, False)]),
        # On x2 = hi f2 has the sign of x1 + 0.7 - 0.8 hi.
        ([[-3, 3], ["-4.7", "4.625"]], []),
        ([[-3, 3], ["-4.7", "4.624"]], [(1, True)]),
        ([[-3, 3], ["-2.874", "4.7"]], [(1, False)]),
        # On x2 = -3 f2 = 0.08 (x1 + 3.1) is 0 at the corner.
        ([["-3.1", "2.7"], [-3, "4.5"]], []),
        ([["-3.11", "2.7"], [-3, "4.5"]], [(1, False)]),
    ],
)
def test_a_box_is_invariant_where_f_points_inwards_on_its_faces(box: Any, left: Any):
    """The twin that just fails is left by a solution that begins at a corner."""
    sides = tuple(Interval(Fraction(lo), Fraction(hi)) for lo, hi in box)
    assert list(open_faces(SPIKES, sides)) == left
    corners = [[x, y] for x in map(float, box[0]) for y in map(float, box[1])]
    ends = [
        solve_ivp(flow, (0, 1e-5), corner, rtol=1e-12, atol=1e-14).y[:, -1] for corner in corners
    ]
    low, high = np.array(box, dtype=float).T
    outside = any((end < low - 1e-12).any() or (end > high + 1e-12).any() for end in ends)
    assert outside is bool(left)
    second = second_loop(spiking(leader={"initial": [0, 0], "stays_in": box}))
    with pytest.raises(Refused, match="point inwards") if left else nullcontext():
        leader_box(second)


def test_a_box_is_found_in_which_solutions_stay():
    leader = spiking().leader
    assert leader is not None
    box = enclosure(SPIKES, leader)
    assert box is not None
    assert not list(open_faces(SPIKES, box))
    low, high = np.array([[float(side.lo), float(side.hi)] for side in box]).T
    for start in np.random.default_rng(0).uniform(low, high, (8, 2)):
        states = solve_ivp(flow, (0, 40), start, rtol=1e-9).y.T
        assert (states >= low - 1e-6).all() and (states <= high + 1e-6).all()
    given = Leader(initial=leader.initial, stays_in=tuple((side.lo, side.hi) for side in box))
    assert enclosure(SPIKES, given) == box


def test_slopes_of_nodes_hold_those_between_leader_and_agents():
    """(f(s + e) - f(s)) = F e: for f = x - x^3 F = 1 - 3 s^2 - 3 s e - e^2, seen in [1 - 3 (1 +
    2)^2, 1]."""
    own = Dynamics(f=["x - x**3"])
    problem = spiking(4, dynamics=own, leader={"initial": 0, "stays_in": [-1, 1]})
    ((found,),) = slopes_of_node(loop_of(problem), (Interval(Fraction(-2), Fraction(2)),))
    s, e = np.random.default_rng(0).uniform([[-1], [-2]], [[1], [2]], (2, 500))
    means = 1 - 3 * s**2 - 3 * s * e - e**2
    assert float(found.lo) <= means.min() and means.max() <= float(found.hi)
    assert found.contains(Interval(Fraction(-26), Fraction(1))) and found.width < Fraction(
        2701, 100
    )


# --- files and runs
def test_a_file_keeps_the_leader_and_the_box_that_was_found():
    problem = spiking()
    table = json.loads(canonical_bytes(problem))["leader"]
    assert table["initial"] == [["-1", "1"], ["-1", "1"]] and len(table["stays_in"]) == 2
    again = problem_from_canonical(canonical_bytes(problem))
    assert canonical_bytes(again) == canonical_bytes(problem)
    assert "stays_in" not in json.loads(canonical_bytes(oscillators()))["leader"]
    assert "leader" not in json.loads(canonical_bytes(load_problem("platoon")))


MISTAKES = {
    "leader needs \\[dynamics\\]": {
        "dynamics": None,
        "coupling": "y",
        "gains": 1,
        "target": [0, 0],
    },
    "target must be left out, or 0": {"target": [1, 0]},
    "leader.stays_in": {"leader": SQUARE | {"stays_in": [[-9, 9], [-9, 9]]}},
    "leader.initial": {"leader": {"initial": [1]}},
    "leader.start is an unknown key": {"leader": {"start": [0, 0]}},
    "leader.stays_in must hold leader.initial": {
        "dynamics": SPIKES,
        "coupling": "y",
        "gains": 1,
        "leader": SQUARE | {"stays_in": [[-1, 1], ["-1/2", 1]]},
    },
    "formation": {"dynamics": SPIKES, "coupling": "y", "gains": 1, "offsets": {1: [1, 0]}},
    "formation.offsets.2 must be an equilibrium": {"offsets": {2: [0, 1]}},
}


@pytest.mark.parametrize("told", MISTAKES)
def test_a_mistake_is_named(told: str):
    with pytest.raises(SpecError, match=told):
        oscillators(**MISTAKES[told])


@pytest.mark.slow
def test_other_claims_beside_the_problem_with_another_leader_fail():
    certificate = certified("spiking")
    assert not verify(certificate, spiking(leader={"initial": [[-2, 1], [-1, 1]]})).holds
    assert b'"lure"' in certificate_bytes(certificate.claims)


@pytest.mark.parametrize("problem", [oscillators(**SEEN), spiking(4)], ids=["linear", "nonlinear"])
def test_runs_are_those_of_the_whole_loop_and_stay_below_what_is_proved(problem: Problem):
    """x, xi, xihat and s by SciPy, x' = A x or f(x) plus B (h + u + d), u = -K (x - s) - dhat."""
    run, own, n = simulate(problem, t_final=6, samples=13, seed=3), problem.dynamics, problem.n
    assert own is not None
    B = np.array(own.B, dtype=float)
    A = np.zeros((2, 2)) if own.A is None else np.array(own.A, dtype=float)
    K = [
        np.array(problem.pinning.gains.get(i, np.zeros((B.shape[1], 2))), dtype=float)
        for i in range(n)
    ]
    S, C, W = (np.zeros((0, 0)), np.zeros((1, 0)), np.zeros((0, 1)))
    if problem.exosystem is not None:
        S, C, W = (
            np.array(x, dtype=float)
            for x in (problem.exosystem.A, problem.exosystem.C, problem.observer.W)
        )

    def moved(x: Any) -> Any:
        return np.array([flow(0, each) for each in x]) if own.A is None else x @ A.T

    def slope(_: float, state: Any) -> Any:
        x, xi, eps, s = np.split(state, [2 * n, 2 * n + n * len(S), 2 * n + 2 * n * len(S)])
        x, xi, eps = x.reshape(n, 2), xi.reshape(n, -1), eps.reshape(n, -1)
        u = -np.array([k @ (each - s) for k, each in zip(K, x, strict=True)]) - (xi - eps) @ C.T
        heard = x[[2, 0, 1]] - x
        x_dot = moved(x) + ((heard[:, 1:] if own.A else heard) + u + xi @ C.T) @ B.T
        return np.concatenate(
            [x_dot.ravel(), (xi @ S.T).ravel(), (eps @ (S - W @ C).T).ravel(), moved(s[None])[0]]
        )

    start = [run.x[0], run.xi[0], run.xi[0] - run.xihat[0], run.leader[0]]
    whole = solve_ivp(
        slope,
        (0, 6),
        np.concatenate([each.ravel() for each in start]),
        t_eval=run.times,
        rtol=1e-10,
        atol=1e-12,
    )
    assert np.abs(whole.y[: 2 * n].T.reshape(-1, n, 2) - run.x).max() < 1e-7
    assert np.abs(whole.y[-2:].T - run.leader).max() < 1e-7
    many = simulate(problem, runs=2, t_final=6, samples=13, seed=3)
    assert (
        np.abs(many.states[0] - run.x).max() < 1e-7
        and np.abs(many.leader[0] - run.leader).max() < 1e-7
    )
    assert run.error()[-1] < run.error()[0] / 2 and abs(run.leader[-1]).max() > 0.1


@pytest.mark.parametrize(
    "problem", [oscillators(**SEEN, offsets={2: [1, 0]}), spiking(4)], ids=["linear", "nonlinear"]
)
def test_python_control_and_casadi_have_the_same_loop(problem: Problem):
    """A response of the first is the run, whose s it has as states; the second has s as an
    input."""
    run, loop = simulate(problem, t_final=3, samples=7), export.to_control(problem)
    tight = {"rtol": 1e-9, "atol": 1e-11}
    response = control.input_output_response(
        loop, run.times, 0, loop.start_of(run), solve_ivp_kwargs=tight
    )
    assert np.abs(response.outputs[: 2 * problem.n].T.reshape(run.x.shape) - run.x).max() < 1e-6
    model, z = build_model(problem), run.xihat[3] - run.x[3] @ loop.loop.W.T
    parts = [run.x[3].ravel(), run.xi[3].ravel(), z.ravel(), run.leader[3]]
    slopes = [np.ravel(each) for each in model.closed_loop(*parts)]
    known = loop.dynamics(0, np.concatenate(parts), np.zeros(loop.ninputs))
    assert np.abs(np.concatenate(slopes) - known).max() < 1e-12
    eps = (run.xi - run.xihat)[3].ravel()
    e_dot = np.ravel(model.error_dynamics(run.errors()[3].ravel(), eps, run.leader[3])[0])
    assert np.abs(slopes[0] - np.tile(slopes[3], problem.n) - e_dot).max() < 1e-12


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
    certificate, rng = certify(problem), np.random.default_rng(1)
    start = (
        np.array([0.5, 0.25])
        + rng.uniform(-1, 1, (3, 2)) * certificate.check("lure").domain.radius / 3
    )
    run = simulate(problem, start=start, t_final=8)
    bound = certificate.envelope(run)
    assert bound.sources and (run.error() <= bound(run.times)).all()
    assert (run.error() > 0).all() and certificate.rate > 0.5
    run.plot(certificate=certificate).save(tmp_path / "run.png")
