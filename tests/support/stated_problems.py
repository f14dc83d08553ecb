"""Random problems with stated tables: those that cannot be kept, for a reason in closed form, and
those that can."""

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from random import Random
from typing import Any

import numpy as np

from dobc_design import Network, Observer, Problem
from dobc_design.problem.exosystems import constant, harmonics

F = Fraction
R = F(1)  # of every region
RISING = {"y": lambda y: y, "tanh(y)": np.tanh, "y + y**3/10": lambda y: y + y**3 / 10}


@dataclass(frozen=True)
class Stated:
    """A problem with tables; ``tables``: which, ``why`` they cannot be kept ("" if they can)."""

    problem: Problem
    tables: str
    why: str = ""


def network(r: Random, *, saturating: bool = False) -> dict[str, Any]:
    """Three to five agents in a tree, the first pinned, in every second case another one as
    well."""
    n = r.randint(3, 5)
    arcs = [[i, r.randint(1, i - 1), F(r.randint(2, 6), 2)] for i in range(2, n + 1)]
    gains = {1: F(r.randint(4, 8), 2)} | ({n: F(r.randint(4, 8), 2)} if r.random() < 0.5 else {})
    h = "tanh(y)" if saturating else r.choice(list(RISING))
    network = Network.from_arcs(arcs, arrow="listens_to", agents=n)
    return {"network": network, "coupling": h, "gains": gains, "target": 0, "name": "stated"}


def seen(r: Random) -> dict[str, Any]:
    """A constant and a sine of 2 rad/s, or the sine alone, with an observer, and the region with
    its errors."""
    exosystem, W = (harmonics([2]), ["16/5", "12/5"]) if r.random() < 0.5 else (constant(), ["3"])
    errors = F(r.randint(1, 4), 20)
    region = {"initial_states": [-R, R], "initial_disturbance": errors}
    return {"exosystem": exosystem, "observer": Observer(W=[[w] for w in W]), "region": region}


BOX = {"region": {"initial_states": [-R, R]}}


def limit_below_the_disturbance(r: Random, more: dict[str, Any]) -> Stated:
    amplitude = F(r.randint(4, 20), 4)
    table = {"limit": amplitude * r.randint(20, 95) / 100, "amplitude": amplitude}
    problem = Problem(**network(r), **seen(r), actuators=table, **more)
    return Stated(problem, "limit", "the disturbance alone needs more")


def limit_below_the_start(r: Random, more: dict[str, Any]) -> Stated:
    parts = network(r) | BOX
    needed = parts["gains"][1] * R
    problem = Problem(**parts, actuators={"limit": {"1": needed * r.randint(50, 97) / 100}}, **more)
    return Stated(problem, "limit", "agent 1 needs k R at its start")


def limit_between(r: Random, more: dict[str, Any]) -> Stated:
    """Each of the two tables can be kept alone: k R fits into the limit, and any error of gains is
    tolerated."""
    parts = network(r) | BOX
    error = F(r.randint(10, 30), 100)
    limit = {"limit": {"1": parts["gains"][1] * R * (1 + error * r.randint(1, 19) / 20)}}
    table = more.pop("uncertainty", {}) | {"gains": error}
    problem = Problem(**parts, actuators=limit, uncertainty=table, **more)
    return Stated(problem, "limit, gains", "agent 1 needs k (1 + error) R at its start")


def repelling(r: Random, more: dict[str, Any]) -> Stated:
    """e_1 - e_2 grows where 2 w (1 + error) > k (1 - error); with noise, where the claim is about
    where agents end, without a bound only if the coupling has none."""
    k, w = F(r.randint(8, 16), 2), F(r.randint(2, 6), 4)
    largest = (k - 2 * w) / (k + 2 * w)
    error = largest + (1 - largest) * r.randint(2, 30) / 100
    pair = Network.from_arcs([[1, 2, w], [2, 1, w]], arrow="listens_to", agents=2)
    h = "-y" if more else r.choice(["-y", "-tanh(y)"])
    where = {} if r.random() < 0.5 else BOX
    table = more.pop("uncertainty", {}) | {"weights": error, "gains": error}
    problem = Problem(
        network=pair,
        coupling=h,
        gains=k,
        target=0,
        name="stated",
        uncertainty=table,
        **where,
        **more,
    )
    return Stated(problem, "weights, gains", f"two agents come apart from {float(largest):.3g} on")


def entries_of_a_gain(r: Random, more: dict[str, Any]) -> Stated:
    """[[1, c], [c, 1]] is indefinite where 1 - d < c (1 + d)."""
    c = F(r.randint(3, 7), 10)
    largest = (1 - c) / (1 + c)
    table = more.pop("uncertainty", {}) | {
        "gains": largest + (1 - largest) * r.randint(2, 30) / 100
    }
    one = Network.from_arcs([], arrow="listens_to", agents=1)
    gains = {1: [[1, c], [c, 1]]}
    problem = Problem(
        network=one,
        coupling="y",
        gains=gains,
        target=[0, 0],
        name="stated",
        uncertainty=table,
        **more,
    )
    return Stated(problem, "gains", f"the gain is indefinite from {float(largest):.3g} on")


def more_than_a_coupling(r: Random, more: dict[str, Any]) -> Stated:
    """An agent that is held by w tanh alone, against a constant push of more than w."""
    w = F(r.randint(2, 8), 4)
    chain = Network.from_arcs([[2, 1, w]], arrow="listens_to", agents=2)
    table = more.pop("uncertainty", {}) | {"disturbance": w * r.randint(101, 150) / 100}
    problem = Problem(
        network=chain,
        coupling="tanh(y)",
        gains={1: 20},
        target=0,
        name="stated",
        uncertainty=table,
        **BOX,
        **more,
    )
    return Stated(problem, "disturbance", "the coupling gives less than what acts")


def weaker_than_stated(r: Random, more: dict[str, Any]) -> Stated:
    """Each alone can be kept: w tanh holds against 3/4 w, and any error of its weight is
    tolerated."""
    w = F(r.randint(2, 8), 4)
    chain = Network.from_arcs([[2, 1, w]], arrow="listens_to", agents=2)
    table = more.pop("uncertainty", {}) | {
        "disturbance": w * 3 / 4,
        "weights": F(r.randint(26, 40), 100),
    }
    problem = Problem(
        network=chain,
        coupling="tanh(y)",
        gains={1: 20},
        target=0,
        name="stated",
        uncertainty=table,
        **BOX,
        **more,
    )
    return Stated(problem, "disturbance, weights", "the weakest coupling gives less than what acts")


ALONE = (
    limit_below_the_disturbance,
    limit_below_the_start,
    repelling,
    entries_of_a_gain,
    more_than_a_coupling,
)
TOGETHER = (limit_between, weaker_than_stated)


def broken(seed: int) -> Stated:
    """Tables that cannot be kept; in every third problem two or three, one of them or all together
    too much."""
    r = Random(f"stated tables {seed}")
    if seed % 3:
        return r.choice(ALONE)(r, {})
    maker: Callable[[Random, dict[str, Any]], Stated] = r.choice(TOGETHER + ALONE)
    small: dict[str, Any] = {"uncertainty": {"measurement": F(1, 1000)}}
    if maker in (limit_below_the_disturbance, limit_below_the_start, limit_between):
        small["uncertainty"] |= {"weights": F(1, 100), "disturbance": F(1, 1000)}
    elif maker is not entries_of_a_gain:
        small["actuators"] = {"limit": 1000}
    found = maker(r, small)
    return Stated(found.problem, f"{found.tables} and others", found.why)


def kept(seed: int) -> Stated:
    """Tables with room: limits of three times what starts and disturbance need, small errors, weak
    inputs."""
    r = Random(f"tables that are kept {seed}")
    parts, watched = network(r), r.random() < 0.5
    parts |= seen(r) if watched else BOX
    named, wanted = {}, {1: ["limit"], 2: ["relative"], 0: ["absolute"]}[seed % 3]
    if seed % 4 == 0:
        wanted = ["limit", "relative", "absolute"]
    if "relative" in wanted:
        named |= {"weights": F(r.randint(1, 4), 100), "gains": F(r.randint(1, 4), 100)}
    if "absolute" in wanted:
        named |= {"disturbance": F(r.randint(1, 4), 100), "measurement": F(r.randint(0, 2), 1000)}
        named |= {"drift": F(1, 100)} if watched else {}
    if "relative" in wanted and watched and seed % 5 == 0:
        named |= {"known_to_agents": False, "weights": F(1, 200)}
    if named:
        parts["uncertainty"] = named
    if "limit" in wanted:
        amplitude = F(r.randint(1, 4), 2) if watched else F(0)
        largest = max(parts["gains"].values()) * R
        parts["actuators"] = {"limit": 3 * (largest + amplitude + 1), "amplitude": amplitude}
    return Stated(Problem(**parts), " and ".join(wanted))
