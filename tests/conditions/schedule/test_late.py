"""Boxes and weights that move, with readings of neighbours that are late or off: both programs
decide them, and late runs stay inside."""

import json
from dataclasses import replace
from fractions import Fraction
from functools import cache
from itertools import islice
from typing import Any

import numpy as np
import pytest
from checker_files.files import accepted_by
from oracles.late import Bounds, Plant, late_runs
from regional_problems import HARMONIC, PAPER_GAIN

import dobc_design as dd
from dobc_design.certificate.text import certificate_bytes
from dobc_design.conditions.case import Case
from dobc_design.conditions.check import Check
from dobc_design.conditions.domain import EVERYWHERE
from dobc_design.conditions.schedule import stage
from dobc_design.conditions.schedule.claim import Cycles
from dobc_design.conditions.schedule.cycles import why_not
from dobc_design.conditions.schedule.decide import why_not as why_not_settled
from dobc_design.conditions.schedule.propose_cycles import propose
from dobc_design.loop.loop import Loop
from dobc_design.loop.make import loop_of
from dobc_design.loop.timing import Timing
from dobc_design.verdict import Verdict

F = Fraction
PINS = {1: 1}
CHAIN = {"A": [[3, 2]], "B": [[2, 1]]}
#: Agents 2 and 3 hear each other, so that what is late comes back.
RETURN = {"A": [[3, 2], [2, 3]], "B": [[2, 1]]}


def problem(
    arcs: Any = CHAIN, *, h: str = "y", readings: Any = None, longest: Any = None
) -> dd.Problem:
    """Three agents, the first pinned; A and B for 1/2 s each in turn, or with ``longest`` in any
    order."""
    switching = dd.Switching(guarantee="sequence", sequence=["A", "B"], dwell="1/2")
    if longest is not None:
        switching = dd.Switching(guarantee="dwell", dwell="1/2", longest=longest)
    return dd.Problem(
        name="late",
        network=dd.Network.from_arcs(arcs, arrow="listens_to", agents=3),
        coupling=h,
        gains=PINS,
        region={"initial_states": [-1, 1]},
        switching=switching,
        readings=readings,
    )


def late_loop(loop: Loop, **timing: Any) -> Loop:
    return replace(loop, timing=Timing(**timing))


@cache
def certified() -> dd.Certificate:
    """The chain with readings up to 1/5 s old."""
    return dd.certify(problem(readings={"delay": "1/5"}))


@cache
def weights(late: bool, *, back: bool = False) -> Cycles:
    """With readings of the same instant, or up to 1/5 s old and 1/20 off; of the chain, or where
    agents 2 and 3 hear each other, up to 1/2 s old."""
    timing = {"delay": "1/2"} if back else {"delay": "1/5", "event": "1/20"}
    loop = loop_of(problem(RETURN if back else CHAIN, readings=timing))
    found = propose(loop, None, rho=None, error=None, late=late)
    assert found is not None
    return found


def test_weights_that_move_answer_for_late_readings_where_no_constant_ones_exist():
    certificate = certified()
    assert certificate.verdict is Verdict.PROVED
    assert certificate.covered_by == "schedule"
    assert "with readings of neighbours up to 0.2 s old" in certificate.reason
    assert certificate.check("readings").verdict is Verdict.UNDECIDED
    assert certificate.check("schedule").exact["late"] is True
    assert dd.verify(certificate, certificate.problem).holds


def changed(**exact: Any) -> dict[str, Any]:
    """The certificate with other exact values in `schedule`."""
    data = json.loads(certificate_bytes(certified().claims))
    (check,) = [each for each in data["checks"] if each["id"] == "schedule"]
    check["exact"] |= exact
    return data


def test_both_programs_refuse_weights_of_the_same_instant_that_are_claimed_for_late_readings():
    exact = weights(False).to_json()
    data = changed(phases=exact["phases"], rate=exact["rate"])
    assert accepted_by(data, certified().problem) == (False, False)


@pytest.mark.parametrize("value", [False, 1, "true", None])
def test_both_programs_refuse_another_word_for_late(value):
    assert accepted_by(changed(late=value), certified().problem) == (False, False)


def test_a_proof_of_the_same_instant_does_not_answer_for_late_readings():
    data = changed()
    (check,) = [each for each in data["checks"] if each["id"] == "schedule"]
    del check["exact"]["late"]
    assert accepted_by(data, certified().problem) == (False, False)


def test_what_the_graphs_alone_show_is_not_about_late_readings():
    data = changed(phases=[], rate=None)
    (check,) = [each for each in data["checks"] if each["id"] == "schedule"]
    check |= {"rate": None, "factor": None}
    data |= {"rate": None, "factor": None}
    assert accepted_by(data, certified().problem) == (False, False)


@pytest.mark.parametrize(
    ("timing", "message"),
    [
        ({"delay": F(3, 5)}, "shorter than readings are old"),
        ({"delay": F(1, 5), "own_delay": F(1, 50)}, "own_delay"),
        ({"delay": F(1, 5), "period": F(1, 50)}, "period"),
        ({"delay": F(1, 5), "event": F(1, 2)}, "a row does not hold"),
        ({"delay": F(1, 2), "event": F(1, 20)}, "a row does not hold"),
    ],
)
def test_what_is_later_than_weights_stand_or_not_known_is_refused(timing, message):
    loop = loop_of(problem())
    claim = weights(True)
    for held in ({"delay": F(1, 5), "event": F(1, 20)}, {"delay": F(1, 10)}):
        assert why_not(late_loop(loop, **held), None, claim) is None
    assert message in why_not(late_loop(loop, **timing), None, claim)
    assert "states no readings" in why_not(loop, None, claim)


def rows_asked(claim: Cycles, delay: float, event: float) -> float:
    """The least of v' less what the rows of the chain ask for, on a grid of times.  The phase
    before is the other one, which lasts 1/2 s."""
    grid = np.linspace(0.0, 0.5, 2001)
    known = []
    for each in claim.phases:
        times = [float(t) for t in each.times]
        known.append(
            np.array([np.interp(grid, times, [float(v[i]) for v in each.v]) for i in range(3)])
        )
    worst = np.inf
    for p, v in enumerate(known):
        before = known[1 - p] * np.exp(0.5 * float(claim.rate))
        whole = np.concatenate([before[:, :-1], v], axis=1)
        steps = round(delay / (grid[1] - grid[0]))
        slope = np.diff(v) / np.diff(grid)
        for k in range(0, 2000, 5):
            last = 2000 + k
            heard = whole[:, last - steps : last + 1].max(axis=1) * (1 + event)
            asked = (
                [-v[0, k], 0.0, heard[1] - v[2, k]]
                if p == 0
                else [-v[0, k], heard[0] - v[1, k], 0.0]
            )
            worst = min(worst, float(np.min(slope[:, k] - asked)))
    return worst


def test_rows_of_late_weights_hold_on_a_grid_and_those_of_the_same_instant_do_not():
    """The largest weight of every window, taken from the grid."""
    assert rows_asked(weights(True), 0.2, 0.05) > -1e-9
    assert rows_asked(weights(False), 0.0, 0.0) > -1e-9
    assert rows_asked(weights(False), 0.2, 0.05) < -0.05


def largest(late: bool, habit: tuple[str, str]) -> float:
    """The largest |e_i| of runs with readings up to 1/2 s old from the corners, as a part of what
    the weights allow, where agents 2 and 3 hear each other."""
    claim = weights(late, back=True)
    step = 0.01
    plant = Plant(
        arcs=[(1, 0), (1, 2), (2, 1)],
        weights=np.array([[0.0, 1.0, 1.0], [1.0, 0.0, 0.0]]),
        h=lambda y: y,
        gains=np.array([[1.0], [0.0], [0.0]]),
        mode_at=lambda t: int(t / 0.5) % 2,
    )
    signs = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1)
    start = np.array([float(x) for x in claim.phases[0].v[0]])
    e = (start[:, None] * signs)[:, None, :]
    bounds = Bounds(step=step, heard=round(0.5 / step) - 1)
    runs = late_runs(plant, bounds, e, np.zeros((3, 0, 8)), habit, np.random.default_rng(3))
    worst = 0.0
    for t, x, _ in islice(runs, 400):
        turn = int((t + step / 10) / 0.5)
        each = claim.phases[turn % 2]
        times = [float(s) for s in each.times]
        v = [np.interp(t - turn / 2, times, [float(w[i]) for w in each.v]) for i in range(3)]
        size = np.exp(-float(claim.rate) * turn / 2)
        worst = max(worst, float(np.max(np.abs(x[:, 0]).max(axis=1) / v)) / size)
    return worst


@pytest.mark.slow
@pytest.mark.parametrize("ages", ["outward", "oldest", "constant"])
def test_late_runs_stay_within_late_weights_and_leave_those_of_the_same_instant(ages):
    """Runge-Kutta, with readings that push outward."""
    assert largest(True, (ages, "outward")) <= 1 + 1e-9
    assert largest(False, (ages, "outward")) > 1.03


@pytest.mark.slow
def test_modes_without_a_longest_time_and_an_observer_are_known_to_both_programs():
    """Weights rest, and N falls; the estimation error has its part of V."""
    arcs = {"A": [[2, 1], [3, 2]], "B": [[3, 1], [2, 3]]}
    readings = {"delay": "1/10", "event": "1/50"}
    observed = {"exosystem": HARMONIC, "observer": dd.Observer(W=PAPER_GAIN)}
    region = {"initial_states": [-1, 1], "initial_disturbance": "1/10"}
    switching = dd.Switching(guarantee="dwell", dwell="1/2")
    stated = problem(arcs, readings=readings).replace(
        switching=switching, region=region, **observed
    )
    certificate = dd.certify(stated)
    assert certificate.covered_by == "schedule"
    assert dd.verify(certificate, stated).holds
    data = json.loads(certificate_bytes(certificate.claims))
    (check,) = [each for each in data["checks"] if each["id"] == "schedule"]
    resting = check["exact"]["phases"][0]["v"][-1]
    resting[1] = str(F(resting[1]) * F(9, 10))
    assert accepted_by(data, stated) == (False, False)


@cache
def settled(delay: str) -> tuple[Check, Loop]:
    """The check of a settling time of the chain, and its loop."""
    loop = loop_of(problem(h="tanh(y)", readings={"delay": delay}))
    case = Case(loop=loop, W=None, domain=EVERYWHERE, checks=())
    return stage.settling_stage(case, tolerance=F(1, 10), report=lambda text: None), loop


@pytest.mark.slow
def test_a_box_that_moves_holds_for_shorter_delays_alone():
    check, loop = settled("1/5")
    assert check.verdict is Verdict.PROVED
    assert "with readings of neighbours up to 0.2 s old" in check.reason
    claim = check.claim
    assert why_not_settled(loop, None, claim) is None
    assert why_not_settled(late_loop(loop, delay=F(1, 10)), None, claim) is None
    assert "a row" in why_not_settled(late_loop(loop, delay=F(2, 5)), None, claim)
    late = late_loop(loop, delay=F(1, 5), own_delay=F(1, 50))
    assert "own_delay" in why_not_settled(late, None, claim)
    # What takes over is about late readings, too.
    instant = replace(claim, certificate=replace(claim.certificate, late=False))
    assert "must be late" in why_not_settled(loop, None, instant)


@pytest.mark.slow
def test_readings_of_before_have_to_lie_in_the_level_set_that_takes_over():
    """The last box does, the boxes of the delay before do not."""
    check, loop = settled("1/5")
    tube = check.claim.tube
    last = max(tube.widths(-1))
    assert why_not_settled(loop, None, check.claim) is None
    lower = replace(check.claim, level=last)
    assert "does not lie in its level set" in why_not_settled(loop, None, lower)


@pytest.mark.slow
def test_both_programs_refuse_a_level_for_the_last_box_alone_and_a_box_of_the_same_instant():
    stated = problem(h="tanh(y)", readings={"delay": "1/5"})
    certificate = dd.certify(stated, settling="1/10")
    data = json.loads(certificate_bytes(certificate.claims))
    (check,) = [each for each in data["checks"] if each["id"] == "settling"]
    assert accepted_by(data, stated) == (True, True)
    claim = certificate.check("settling").claim
    lower = json.loads(json.dumps(data))
    (lowered,) = [each for each in lower["checks"] if each["id"] == "settling"]
    lowered["exact"]["last"]["level"] = str(max(claim.tube.widths(-1)))
    assert accepted_by(lower, stated) == (False, False)
    instant = dd.certify(problem(h="tanh(y)"), settling="1/10").check("settling")
    check["exact"]["tube"] = instant.claim.tube.to_json()
    assert accepted_by(data, stated) == (False, False)
