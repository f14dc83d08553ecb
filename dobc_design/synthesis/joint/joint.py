"""The joint design: a request decided, and where it is not possible, the nearest request that is.

What is given up first is what the refutation names; how far is found by designing without that limit and reading off
what the design reaches.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction

from dobc_design.conditions.numbers import claimed, shorten
from dobc_design.problem.problem import Problem
from dobc_design.synthesis.joint.attempt import attempt
from dobc_design.synthesis.joint.designed import Design
from dobc_design.synthesis.joint.ground import Tools
from dobc_design.synthesis.joint.proposing import HALF
from dobc_design.synthesis.joint.request import DesignRequest
from dobc_design.synthesis.pinning.structure import structure_of
from dobc_design.verdict import Verdict

NEARLY = Fraction(9, 10)  # of the fastest rate, where the one asked for cannot be had; more takes very large gains


def joint_design(problem: Problem, request: DesignRequest, tools: Tools) -> Design:
    """Decide a request; one that is refuted or undecided comes with the nearest one that was proved possible."""
    found = attempt(problem, request, tools)
    if found.verdict is Verdict.PROVED:
        return found
    for weaker, part in _weaker(problem, request, found):
        tools.progress("looking for the nearest possible request")
        nearest = attempt(problem, weaker, tools, part=part)
        if nearest.verdict is Verdict.PROVED:
            return replace(found, nearest=_tightened(request, nearest))
    return found


def _weaker(problem: Problem, request: DesignRequest, found: Design) -> Iterator[tuple[DesignRequest, Fraction]]:
    """Requests with one limit given up, the binding one first; then a rate as near as possible."""
    kind = found.statements[0].kind if found.statements else None
    slower = None if request.rate is None else replace(request, rate=None)
    if kind == "detectable":
        yield replace(request, reduce=True), HALF
        return
    if kind == "structure":
        structure = structure_of(problem, request.allowed)
        free = set(request.allowed)
        lacking = {i for group in structure.groups if not free & set(group) for i in group}
        request = replace(request, allowed=tuple(sorted(free | lacking)))
        yield request, HALF
        yield replace(request, pins=None), HALF
        return
    if kind in ("gain", "noise"):
        other = None if found.observer is None else found.observer.nearest
        yield replace(request, noise=() if other is None else other.request.noise), HALF
    elif kind == "pins" or (kind is None and slower is None and request.pins is not None):
        yield replace(request, pins=None), HALF
    elif kind == "max_gain":
        yield replace(request, caps={}), HALF
    if slower is not None:
        yield slower, NEARLY
    for name, weaker in (
        ("pins", replace(request, pins=None)),
        ("caps", replace(request, caps={})),
        ("allowed", replace(request, allowed=tuple(range(problem.n)))),
        ("noise", replace(request, noise=())),
    ):
        if getattr(weaker, name) != getattr(request, name):
            yield weaker, HALF


def _tightened(asked: DesignRequest, found: Design) -> Design:
    """The design with its request restored as far as it keeps it: limits given up become what it reaches."""
    request = found.request
    if asked.rate is not None and request.rate is None and found.rate:
        request = replace(request, rate=claimed(shorten(found.rate, digits=3)))
    if asked.pins is not None and request.pins is None:
        request = replace(request, pins=max(asked.pins, len(found.gains)))
    if asked.caps and not request.caps and found.problem is not None:
        index = found.problem.network.index
        reached = {index[label]: k for label, k in found.gains.items()}
        if len(set(asked.caps.values())) == 1:  # one cap for all was asked for, so one for all is the answer
            reached = dict.fromkeys(asked.caps, max(reached.values()))
        request = replace(request, caps={i: max(cap, reached.get(i, cap)) for i, cap in asked.caps.items()})
    return replace(found, request=request)
