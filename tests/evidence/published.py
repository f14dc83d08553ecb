"""Published problems, stated and answered (docs/published.md has this table); regions of agents with dynamics."""

import time

from evidence.row import Row
from published import PUBLISHED, regional, stated

import dobc_design as dd

REGIONS = 20


def table(count: int, seed: int) -> Row:
    """The first ``count`` of them: verdict as published or derived, accepted by both programs."""
    failures, lines = [], ["problem | n x m | verdict | by | rate in 1/s | region | time | published"]
    for each in PUBLISHED[:count]:
        problem, start = each.build(), time.perf_counter()
        certificate = dd.certify(problem)
        seconds = time.perf_counter() - start
        if certificate.verdict.value != each.verdict:
            failures.append(f"{each.name}: {certificate.verdict.value}")
        if not dd.verify(certificate, problem).holds:
            failures.append(f"{each.name}: verify refuses it")
        proved = [check.domain for check in certificate.checks if check.id == certificate.covered_by]
        reach = f"{proved[0]['radius']:.3g}" if proved and isinstance(proved[0], dict) else "-"
        rate = "-" if certificate.rate is None else f"{certificate.rate:.4g}"
        facts = (certificate.verdict.value, certificate.covered_by or "-", rate, reach, f"{seconds:.1f} s")
        lines.append(" | ".join((each.name, stated(problem), *facts, each.published)))
    return Row("published problems: the verdict is the known one", min(count, len(PUBLISHED)), failures, lines)


def regions(count: int, seed: int) -> Row:
    """``count`` starts on the boundary of certified regions of REGIONS problems: none leaves, none is slower."""
    failures, tried, unfinished, proved, each = list[str](), 0, 0, 0, max(10, -(-count // REGIONS))
    for number in range(-(-count // each)):
        problem = regional(number)
        certificate = dd.certify(problem)
        if certificate.covered_by is None:
            failures.append(f"{number}: not proved")
            continue
        found = dd.falsify(problem, certified=certificate, runs=each, seed=seed + number, t_final=15)
        tried, unfinished, proved = tried + found.tried, unfinished + found.unfinished, proved + 1
        failures += [f"{number}: {suspect}" for suspect in found.suspects]
    what = "agents with dynamics: starts on the boundary of certified regions, none leaves"
    notes = [f"{proved} problems, {unfinished} runs took too many steps"]
    return Row(what, tried - unfinished, failures, notes, least=count * 99 // 100)
