"""What no W of an exosystem can do, and the observable part that takes its place: exact."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from dobc_design.conditions.observer.decide import detectability_check
from dobc_design.conditions.statement import Statement, refuted
from dobc_design.problem.changes import value_text
from dobc_design.problem.problem import Problem
from dobc_design.synthesis.joint.request import DesignRequest
from dobc_design.verdict import Verdict


def reduced_exosystem(
    problem: Problem, request: DesignRequest
) -> tuple[Mapping[str, Any], tuple[str, ...], Statement | None]:
    """The observable part in place of an undetectable exosystem, or why there is no W at all.

    That of one group of agents among several is named, and left to the caller.
    """
    if problem.is_grouped:
        return {}, (), next(_undetectable_groups(problem, request), None)
    if problem.exosystem is None:
        return {}, (), None
    check = detectability_check(problem.exosystem, problem)
    if check.verdict is Verdict.PROVED:
        return {}, (), None
    if check.fix is None or not request.reduce:
        exact = {} if check.exact is None else {name: str(value) for name, value in check.exact.items()}
        text = check.reason[0].lower() + check.reason[1:]
        return {}, (), refuted("detectable", f"no W exists: {text}", **exact)
    return check.fix.set, (f"Exosystem: {check.fix.text}",), None


def _undetectable_groups(problem: Problem, request: DesignRequest) -> Iterator[Statement]:
    for group in problem.groups:
        check = detectability_check(group.exosystem)
        if check.verdict is Verdict.PROVED:
            continue
        text = f"no W exists for the group of agent {group.name}: {check.reason[0].lower() + check.reason[1:]}"
        fix = check.fix
        if not request.reduce or fix is None:
            yield refuted("detectable", text)
            continue
        parts = "; ".join(f"{key.rpartition('.')[2]} = {value_text(value)}" for key, value in fix.set.items() if value)
        rest = f" ({parts})" if parts else ""
        yield Statement(
            kind="detectable",
            verdict=Verdict.UNDECIDED,
            text=f"{text} Write its observable part in its place{rest}, and design again; that is done by itself only"
            " where all agents have one exosystem.",
        )
