"""Problems and certificates with what is asked of regions taken away, for tests of the consensus
alone."""

import json
from collections.abc import Iterable

from dobc_design import Check, Problem, load_problem
from dobc_design.problem.canonical import canonical_document, problem_from_canonical

REGIONAL = ("max-separable", "delay", "sampling", "lure", "equilibrium")


def without_region(problem: Problem | str) -> Problem:
    """The same problem, asked about the consensus itself."""
    document = canonical_document(load_problem(problem) if isinstance(problem, str) else problem)
    return problem_from_canonical(json.dumps(document | {"region": None}).encode("utf-8"))


def at_the_consensus(checks: Iterable[Check]) -> list[Check]:
    """The checks that speak of the consensus."""
    return [check for check in checks if check.id not in REGIONAL]
