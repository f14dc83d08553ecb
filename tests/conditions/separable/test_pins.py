"""Pins of any function: arcs to a fixed node, whose weight is 0 (theory, section 14).

No problem file states a curved pin, so the loops are made by hand.
"""

from collections.abc import Mapping
from dataclasses import replace
from fractions import Fraction
from random import Random

import numpy as np
import pytest
from networks import MONOTONE, PAPER, cycle, fractions, listening

from dobc_design import Verdict
from dobc_design.conditions.accuracy.decide import obstacle as accuracy_obstacle
from dobc_design.conditions.consensus.claim import state_theorems
from dobc_design.conditions.domain import NEAR_TARGET
from dobc_design.conditions.equilibrium.decide import Equilibrium
from dobc_design.conditions.equilibrium.decide import why_not as not_an_equilibrium
from dobc_design.conditions.graphs.claim import Kept
from dobc_design.conditions.graphs.decide import why_not as not_kept
from dobc_design.conditions.margins.decide import why_not_local
from dobc_design.conditions.quadratic.decide import quadratic_obstacle
from dobc_design.conditions.separable.checks import obstacle, stuck_check
from dobc_design.conditions.separable.claim import (
    Errors,
    Separable,
    Term,
    is_stuck,
    rows,
    stuck_agents,
)
from dobc_design.conditions.separable.decide import ask, in_arrays, verify_separable
from dobc_design.conditions.separable.large import open_rows
from dobc_design.conditions.separable.propose_limits import largest_rate, longest_delay
from dobc_design.conditions.separable.timing import largest_period
from dobc_design.coupling.coupling import make_coupling
from dobc_design.exact.interval import Interval
from dobc_design.loop.loop import Loop
from dobc_design.loop.make import loop_of
from dobc_design.problem.network import Arcs

F = Fraction
TINY = F(1, 10**30)
PROVED, REFUTED = Verdict.PROVED, Verdict.REFUTED


def ones(loop: Loop) -> tuple[F, ...]:
    return (F(1),) * loop.n


def pinned_by(loop: Loop, functions: Mapping[int, str]) -> Loop:
    """The loop in which these nodes hear a fixed node by h(0 - e_i), beside what it has."""
    made = tuple(make_coupling(h, dimension=loop.m) for h in functions.values())
    places = {(node, loop.n): len(loop.functions) + k for k, node in enumerate(functions)}
    modes = {mode: with_arcs_to(loop.n, list(functions), arcs) for mode, arcs in loop.modes.items()}
    return replace(
        loop,
        fixed=("target",),
        modes=modes,
        functions=(*loop.functions, *made),
        exceptions={**loop.exceptions, **places},
    )


def with_arcs_to(speaker: int, listeners: list[int], arcs: Arcs) -> Arcs:
    """These arcs, and those of ``listeners`` to one speaker."""
    return Arcs(
        listeners=np.append(np.array(listeners), arcs.listeners),
        speakers=np.append(np.full(len(listeners), speaker), arcs.speakers),
        weights=(F(1),) * len(listeners) + tuple(arcs.weights),
        optional=arcs.optional,
    )


def saturated(n: int, *, h: str = PAPER, k: str = "5", most: str = "1/2") -> Loop:
    """A directed cycle of rising couplings in which every pin k y saturates at ``most``."""
    problem = cycle(n, h=h, gains={})
    loop = loop_of(problem)
    functions = dict.fromkeys(range(n), f"clip({k}*y, -{most}, {most})")
    return pinned_by(loop, functions)


def verdict(loop: Loop, v, alpha, rho, **errors) -> Verdict:
    claim = Separable(v=v, alpha=F(alpha), rho=F(rho))
    return verify_separable(loop, claim, errors=Errors(**errors)).verdict


def test_saturated_pins_of_all_agents_have_the_rate_of_the_theory():
    """Section 14: k = 5, ubar - dbar = 1/2, |e| <= 4, all pinned, v = 1: 1/8, and nothing above."""
    loop = saturated(4)
    v = ones(loop)
    found = largest_rate(loop, v, rho=F(4))
    assert found == F(1, 8)
    assert verdict(loop, v, "1/8", 4) is PROVED
    found = verdict(loop, v, F(1, 8) + TINY, 4)
    assert found is REFUTED
    found = verdict(loop, v, "1/8", F(4) + TINY)
    assert found is REFUTED


@pytest.mark.parametrize("seed", range(6))
def test_the_rate_of_saturated_pins_is_that_of_the_weakest_agent(seed: int):
    """Section 14, h rising and v = 1: the least of min(k_i, (ubar - dbar)/rho) over all agents."""
    r = Random(f"saturated {seed}")
    n = r.randint(2, 5)
    rho = F(r.choice(("1/4", "1", "3")))
    gains = [F(r.randint(1, 9), 2) for _ in range(n)]
    rooms = [F(r.randint(1, 9), 4) for _ in range(n)]
    pins = {i: f"clip({gains[i]}*y, -{rooms[i]}, {rooms[i]})" for i in range(n)}
    problem = cycle(n, h=r.choice(MONOTONE), gains={})
    bare = loop_of(problem)
    loop = pinned_by(bare, pins)
    v = ones(loop)
    both = zip(gains, rooms, strict=True)
    rate = min(min(k, room / rho) for k, room in both)
    assert verdict(loop, v, rate, rho) is PROVED
    assert verdict(loop, v, rate + TINY, rho) is REFUTED
    found = largest_rate(loop, v, rho=rho)
    assert found == pytest.approx(rate, rel=1e-8)


def test_a_pin_is_a_term_whose_other_node_has_the_weight_zero():
    """h(-s v_i) and nothing else; delays stretch the v_j of nodes that move, and the fixed one
    stays."""
    arcs = [[2, 1]]
    problem = listening(arcs, "y", n=2, gains={1: 3}, target=0)
    usual = loop_of(problem)
    loop = pinned_by(usual, {1: "tanh(y)"})
    ((first, _), (second, _)) = rows(loop, fractions(1, 2), stretch=F(3, 2))
    assert first.terms == ()
    assert first.pull == F(3)
    assert first.own == F(1)
    expected = (Term(0, F(1), F(7, 2), F(-1, 2)), Term(1, F(1), F(2), F(-2)))
    assert second.terms == expected
    assert second.pull == F(0)
    assert second.own == F(2)


def test_a_linear_function_of_a_pin_says_what_the_gain_says():
    """Rates, delays and sampling periods are those of the loop with the gain k in place of k y."""
    v = fractions(1, "1.3", "1.2", "1.1")
    gains = {1: 5, 3: "1/2"}
    problem = cycle(4, gains=gains)
    usual = loop_of(problem)
    loop = loop_of(cycle(4, gains={}))
    functions = {0: "5*y", 2: "y/2"}
    other = pinned_by(loop, functions)
    rate = largest_rate(usual, v, rho=F(1))
    assert rate > F(1, 10)
    found = largest_rate(other, v, rho=F(1))
    assert found == pytest.approx(rate, rel=1e-4)
    alpha = rate * F(9, 10)
    claim = Separable(v=v, alpha=alpha, rho=F(1))
    assert verify_separable(other, claim).verdict is PROVED
    delay = longest_delay(usual, claim, rate=claim.alpha / 2)
    assert longest_delay(other, claim, rate=claim.alpha / 2) == delay
    assert largest_period(usual, claim) == largest_period(other, claim)


@pytest.mark.parametrize(("h", "weaker"), [("y + y**2/8", "upper"), ("y - y**2/8", "lower")])
def test_pins_that_are_not_odd_are_held_on_the_weaker_face(h: str, weaker: str):
    """One agent, |e| <= 1: h(-1) = -7/8 and -h(1) = -9/8, or the other way round; 7/8 holds."""
    problem = listening([], "y", n=1, gains={}, target=0)
    alone = loop_of(problem)
    loop = pinned_by(alone, {0: h})
    assert verdict(loop, ones(loop), "7/8", 1) is PROVED
    alpha = F(7, 8) + TINY
    faster = Separable(v=ones(loop), alpha=alpha, rho=F(1))
    refused = verify_separable(loop, faster)
    assert refused.verdict == REFUTED
    assert refused.face == weaker


def test_no_sample_of_the_field_contradicts_a_rate_of_curved_pins():
    """One curved pin and a linear one: the largest row of 4000 samples is below 0 at the rate."""
    problem = cycle(3, h="tanh(y)", gains={2: 1})
    loop = pinned_by(loop_of(problem), {0: "atan(3*y)"})
    v = fractions(1, "1.2", "1.1")
    rate = float(largest_rate(loop, v, rho=F(1)))
    r = np.random.default_rng(7)
    sizes = np.array(v, dtype=float)
    for _ in range(4000):
        e = r.uniform(-1, 1, 3) * sizes * r.uniform()
        slopes = [np.arctan(-3 * e[0]), -e[1], 0.0]
        pull = np.array(slopes)
        slope = np.tanh(np.roll(e, -1) - e) + pull
        largest = np.argmax(np.abs(e) / sizes)
        found = np.sign(e[largest]) * slope[largest]
        allowed = -rate * abs(e[largest]) + 1e-12
        assert found <= allowed


@pytest.mark.parametrize("what", ["weights", "gains"])
def test_errors_act_on_curved_pins(what: str):
    """Gains that may be 10 % smaller leave 9/10 of a rate; an arc to a fixed node may be a pin or
    not, and has the larger error of weights and gains."""
    loop = saturated(3)
    v = ones(loop)
    errors = {what: F(1, 10)}
    found = verdict(loop, v, "9/80", 4, **errors)
    assert found is PROVED
    faster = F(9, 80) + TINY
    found = verdict(loop, v, faster, 4, **errors)
    assert found is REFUTED


def test_large_networks_with_curved_pins_are_decided_in_arrays(monkeypatch):
    """The floats know arcs to fixed nodes: they prove what is a little slower, and no more."""
    monkeypatch.setattr("dobc_design.conditions.separable.decide.MANY_ARCS", 0)
    monkeypatch.setattr("dobc_design.conditions.separable.timing._MANY_ARCS", 0)
    loop = saturated(4)
    v = ones(loop)
    many = in_arrays(ask(loop, v, rho=F(4)))
    assert many is not None
    assert not open_rows(many.arcs, many.kinds, alpha=F("0.1249"), rho=F(4))
    assert len(open_rows(many.arcs, many.kinds, alpha=F("0.1251"), rho=F(4))) == 8
    assert verdict(loop, v, "1/8", 4) is PROVED
    # while |y| <= 1/10 the pins are 5 y, and arcs of slope 1 beside them leave 1/(1 + 5)
    claim = Separable(v=v, alpha=F(5), rho=F(1, 10))
    linear = saturated(4, h="y")
    assert largest_period(linear, claim).period == F("0.166666666")


def test_an_agent_with_a_curved_pin_is_held():
    """Without the pin no weights exist, and the agents say so; with it nothing is refuted."""
    bare = loop_of(cycle(3, gains={}))
    held = pinned_by(bare, {1: "tanh(y)"})
    assert set(stuck_agents(bare)) == {0, 1, 2}
    assert not stuck_agents(held)
    assert is_stuck(bare, (0, 1, 2))
    assert not is_stuck(held, (0, 1, 2))
    assert stuck_check(bare, None, domain=NEAR_TARGET).verdict is REFUTED
    assert stuck_check(held, None, domain=NEAR_TARGET) is None


def refusals(loop: Loop) -> dict[str, str | None]:
    """What each topic says that knows arcs to the target, and to no other fixed node."""
    away = (Interval(F(1), F(2)),) * loop.n
    claim = Equilibrium(mode="G", box=away)
    return {
        "quadratic": quadratic_obstacle(loop, None),
        "equilibrium": not_an_equilibrium(loop, claim),
        "accuracy": accuracy_obstacle(loop, None),
        "margins": why_not_local(loop),
        "graphs": not_kept(loop, None, Kept()),
    }


def test_topics_take_arcs_to_the_target_and_to_no_other_fixed_node():
    """Where agents agree, nodes that are fixed are no target; accuracy and margins know pairs."""
    problem = cycle(3, h="y", gains={1: 1, 2: 1, 3: 1})
    target = pinned_by(loop_of(problem), {1: "tanh(y)"})
    told = "does not apply: it is for pins that are linear, and the same in every mode."
    assert told not in refusals(target).values()
    pairs = replace(target, goal="differences")
    refused = {topic for topic, words in refusals(pairs).items() if words == told}
    assert refused == {"quadratic", "equilibrium", "graphs"}


def test_topics_at_the_consensus_take_a_curved_pin_by_its_slope_there():
    """tanh'(0) = 1: Lemma 1 is that of the loop with the gain 1 there."""
    curved = pinned_by(loop_of(cycle(3, h="y", gains={1: 1})), {1: "tanh(y)"})
    linear = loop_of(cycle(3, h="y", gains={1: 1, 2: 1}))
    (form,) = state_theorems(curved).lambdas.values()
    (expected,) = state_theorems(linear).lambdas.values()
    assert form.constant.entries == expected.constant.entries


def test_the_certificate_by_component_takes_other_pins():
    """``obstacle`` names none for it."""
    assert obstacle(saturated(3), None) is None
