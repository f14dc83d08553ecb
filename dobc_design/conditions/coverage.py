"""Whether a check proves what is asked: its domain against the region, compared exactly (the contract, Coverage)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction

from dobc_design.conditions.check import Check
from dobc_design.conditions.numbers import claimed
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict


def covers(problem: Problem, check: Check, checks: Sequence[Check]) -> bool:
    """Whether this check proves what the problem asks."""
    if check.verdict is not Verdict.PROVED or not check.kind.is_consensus:
        return False
    if check.id == "lemma1":
        if problem.groups:
            return False
        lemmas = [other for other in checks if other.id == "lemma1"]
        if {other.mode for other in lemmas} != set(problem.network.modes):
            return False
        # One V = e'e serves every mode, so all have to hold; the slowest speaks for them.
        if not all(other.verdict is Verdict.PROVED for other in lemmas):
            return False
        if check is not min(lemmas, key=lambda other: other.rate or 0.0):
            return False
    if problem.region is None:
        return check.kind.role != "region"  # they are about starts, and the question is about the consensus itself
    if check.domain == "global":
        return True
    return isinstance(check.domain, Mapping) and _region_inside(problem, check.domain)


def _region_inside(problem: Problem, domain: Mapping[str, object]) -> bool:
    radius, disturbance = domain.get("radius"), domain.get("disturbance")
    region = problem.region
    if region is None or not isinstance(radius, (int, float)):
        return False
    reach = asked_radius(problem)
    if domain.get("kind") == "box":
        inside = claimed(radius) >= max(reach)
    elif domain.get("kind") == "ball":
        inside = radius >= 0 and claimed(radius) ** 2 >= problem.n * sum((r * r for r in reach), Fraction(0))
    else:
        return False
    if region.initial_disturbance is None:
        return inside
    return inside and isinstance(disturbance, (int, float)) and claimed(disturbance) >= region.initial_disturbance


def asked_radius(problem: Problem) -> tuple[Fraction, ...]:
    """R_c, per component: the largest |e_ic(0)| that the region allows."""
    pairs = problem.region.initial_states if problem.region is not None else ()
    goals = {problem.goal_of(agent) for agent in range(problem.n)} if problem.offsets else {problem.target}
    return tuple(max(max(abs(lo - goal[c]), abs(hi - goal[c])) for goal in goals) for c, (lo, hi) in enumerate(pairs))
