"""Published problems, stated and answered (docs/published.md has this table); regions of agents
with dynamics."""

import time

from evidence.row import Row
from published import PUBLISHED, regional, stated, swing9

import dobc_design as dd

REGIONS = 20


def table(count: int, seed: int) -> Row:
    """The first ``count`` of them: verdict as published or derived, accepted by both programs."""
    failures = []
    lines = ["problem | n x m | verdict | by | rate in 1/s | region | time | published"]
    for each in PUBLISHED[:count]:
        problem = each.build()
        start = time.perf_counter()
        certificate = dd.certify(problem)
        seconds = time.perf_counter() - start
        if certificate.verdict.value != each.verdict:
            failures.append(f"{each.name}: {certificate.verdict.value}")
        if not dd.verify(certificate, problem).holds:
            failures.append(f"{each.name}: verify refuses it")
        proved = [
            check.domain for check in certificate.checks if check.id == certificate.covered_by
        ]
        reach = f"{proved[0]['radius']:.3g}" if proved and isinstance(proved[0], dict) else "-"
        rate = "-" if certificate.rate is None else f"{certificate.rate:.4g}"
        facts = (
            certificate.verdict.value,
            certificate.covered_by or "-",
            rate,
            reach,
            f"{seconds:.1f} s",
        )
        lines.append(" | ".join((each.name, stated(problem), *facts, each.published)))
    if count >= len(PUBLISHED):
        first = [f"{critical_start(swing9('0.05', '0.1'), place):.3g}" for place in range(6)]
        lines.append(
            "IEEE 9: x_1, v_1, x_2, v_2, x_3, v_3 alone do not return from "
            f"{', '.join(first)} on, simulated"
        )
    return Row(
        "published problems: the verdict is the known one",
        min(count, len(PUBLISHED)),
        failures,
        lines,
    )


def regions(count: int, seed: int) -> Row:
    """``count`` starts on the boundary of certified regions of REGIONS problems: none leaves, none
    is slower."""
    failures = list[str]()
    tried = 0
    unfinished = 0
    proved = 0
    each = max(10, -(-count // REGIONS))
    for number in range(-(-count // each)):
        problem = regional(number)
        certificate = dd.certify(problem)
        if certificate.covered_by is None:
            failures.append(f"{number}: not proved")
            continue
        found = dd.falsify(
            problem, certified=certificate, runs=each, seed=seed + number, t_final=15
        )
        tried = tried + found.tried
        unfinished = unfinished + found.unfinished
        proved = proved + 1
        failures += [f"{number}: {suspect}" for suspect in found.suspects]
    what = "agents with dynamics: starts on the boundary of certified regions, none leaves"
    notes = [f"{proved} problems, {unfinished} runs took too many steps"]
    return Row(what, tried - unfinished, failures, notes, least=count * 99 // 100)


def critical_start(problem: dd.Problem, place: int) -> float:
    """The smallest error of one state alone from which a run of 30 s does not return, by bisection,
    to 1 %."""
    low, high = 0.0, 50.0
    while high - low > 0.01 * high:
        middle = (low + high) / 2
        start = []
        for i in range(problem.n):
            start.append([middle * (2 * i + c == place) for c in (0, 1)])
        returns = dd.simulate(problem, start=start, t_final=30).final_error < 1e-2
        low, high = (middle, high) if returns else (low, middle)
    return high
