"""What the page and the Markdown text have in common, gathered once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from dobc_design._show.text import significant_towards_zero
from dobc_design.certificate.certificate import Certificate
from dobc_design.conditions.kinds import KINDS
from dobc_design.exact.matrix import Matrix
from dobc_design.problem.problem import Problem
from dobc_design.report import formulas
from dobc_design.report import network_words as nw
from dobc_design.report.check_views import check_rows, cure_view
from dobc_design.report.region_stages import settling_view
from dobc_design.report.region_words import region_view
from dobc_design.report.search_words import search_view
from dobc_design.report.tracing import (
    MADE_WITH,
    ROLES,
    SIGNED,
    SIGNING,
    TRACE_HEADS,
    TRACED,
    reproduction,
    title_block,
    trace_rows,
)
from dobc_design.report.words import (
    MEANINGS,
    SYMBOLS,
    covering_domain,
    domain_words,
    number,
    typeset,
    what_it_means,
)
from dobc_design.verdict import Verdict

if TYPE_CHECKING:
    from dobc_design.analysis.analysis import Analysis
    from dobc_design.conditions.schedule.checks import StageTiming
    from dobc_design.falsification.suspect import Falsification
    from dobc_design.simulation.trajectory import Trajectory

CURE_COMMAND = "dobc certify problem.json --apply-fix cured.toml"
MOST_NOTES = 60


def common_view(
    certificate: Certificate,
    *,
    analysis: Analysis | None,
    trajectory: Trajectory | None,
    lambdas: Mapping[str, Matrix] | None,
    timings: Sequence[StageTiming] = (),
    searches: Sequence[Falsification] = (),
) -> dict[str, Any]:
    """Names and values that both templates use."""
    problem, claims = certificate.problem, certificate.claims
    yes, no = what_it_means(certificate)
    rows, hidden = check_rows(certificate.checks)
    again = reproduction(certificate)
    return {
        "problem": problem,
        "claims": claims,
        "verdict": certificate.verdict.value,
        "symbol": SYMBOLS[certificate.verdict],
        "facts": _facts(certificate),
        "says": yes,
        "says_not": no,
        "notes": claims.notes[:MOST_NOTES],
        "size": nw.size_sentence(problem),
        "pins": nw.pin_sentence(problem),
        "modes": nw.mode_sentences(problem),
        "mode_names": list(problem.network.modes)[: nw.MOST_MODES],
        "agents": nw.agent_rows(problem),
        "exceptions": nw.exception_sentences(problem),
        "region": nw.region_sentence(problem),
        "regions": region_view(problem, certificate.regions),
        "settling": settling_view(certificate.settling, timings),
        "searches": search_view(searches),
        "switching": nw.switching_sentence(problem),
        "letters": _letters(problem),
        "loop": formulas.LOOP_DISTURBED if problem.groups else formulas.LOOP,
        "groups": nw.group_sentences(problem),
        "by_group": nw.BY_GROUP if problem.is_grouped else "",
        "cure": cure_view(certificate.checks),
        "cure_command": CURE_COMMAND,
        "checks": rows,
        "checks_hidden": hidden,
        "check_glossary": _check_glossary(certificate),
        "matrices": formulas.matrices_of(certificate),
        "bounds": formulas.bounds_of(certificate),
        "lambdas": formulas.lambda_matrices(lambdas),
        "graphs": _graph_rows(analysis),
        "observability": _observability(analysis),
        "simulation": _simulation(trajectory),
        "verdict_words": [(verdict.value, SYMBOLS[verdict], MEANINGS[verdict]) for verdict in Verdict],
        "traces": trace_rows(certificate.checks),
        "trace_heads": TRACE_HEADS,
        "again": again,
        "title_block": title_block(certificate, again),
        "traced": TRACED,
        "made_with": MADE_WITH,
        "signing": SIGNING,
        "roles": ROLES,
        "signed": SIGNED,
    }


def _facts(certificate: Certificate) -> list[tuple[str, str]]:
    facts = []
    if certificate.verdict is Verdict.PROVED:
        domain = covering_domain(certificate)
        facts.append(("Holds", domain_words(domain) if domain is not None else "–"))
        rate = certificate.rate
        facts.append(("Certified rate", "–" if rate is None else f"{typeset(significant_towards_zero(rate))} 1/s"))
        facts.append(("Carried by", KINDS[certificate.covered_by].name if certificate.covered_by in KINDS else "–"))
    counts = [(v, sum(check.verdict is v for check in certificate.checks)) for v in Verdict]
    facts.append(("Checks", ", ".join(f"{count} {v.value}" for v, count in counts if count) or "none"))
    facts.append(("Agents", str(certificate.problem.n)))
    facts.append(("Modes", str(len(certificate.problem.network.modes))))
    return facts


def _check_glossary(certificate: Certificate) -> list[tuple[str, str, str]]:
    present = dict.fromkeys(check.id for check in certificate.checks)
    return [(id, KINDS[id].name, KINDS[id].decides) for id in present]


def _graph_rows(analysis: Analysis | None, most: int = 12) -> list[dict[str, str]]:
    if analysis is None:
        return []
    rows = []
    for graph, mode in list(zip(analysis.graphs, analysis.modes, strict=False))[:most]:
        lost = graph.unreached
        rows.append(
            {
                "mode": graph.mode,
                "arcs": str(graph.arcs),
                "components": "one" if graph.is_strongly_connected else str(len(graph.components)),
                "balanced": "yes" if graph.balanced else "no",
                "unreached": nw.names_in_words(lost, 6) if lost else "nobody",
                "lambda_max": number(mode.lambda_max),
                "decay": number(mode.decay_rate),
            }
        )
    return rows


def _observability(analysis: Analysis | None) -> str | None:
    if analysis is None or analysis.observability is None:
        return None
    found = analysis.observability
    margins = [
        f"{number(each.margin)} at {_eigenvalue(each.eigenvalue)}" for each in found.modes if each.eigenvalue.imag >= 0
    ]
    return (
        f"In floating point the observability matrix has rank {found.rank} of {found.order}. The smallest singular"
        f" value of [A − λI; C] at the eigenvalues λ of A, 0 meaning unseen: {', '.join(margins[:12])}."
    )


def _eigenvalue(value: complex) -> str:
    real = number(value.real) if value.real or not value.imag else ""
    return f"{real}{' ± ' if real else '±'}{number(value.imag)}i" if value.imag else real


def _simulation(trajectory: Trajectory | None) -> str | None:
    if trajectory is None or len(trajectory.times) == 0:
        return None
    error = trajectory.error()
    first, last = float(error[0]), float(error[-1])
    text = f"One run of {number(float(trajectory.times[-1]))} s in mode {trajectory.mode}, seed {trajectory.seed}:"
    text += f" the largest error {'falls' if last < first else 'grows'} from {number(first)} to {number(last)}."
    if trajectory.diverged:
        text += f" The run diverged and could not be carried to {number(trajectory.t_final)} s."
    return text


def _letters(problem: Problem) -> str:
    """What the letters of the equations mean, for text without formulas."""
    text = (
        "N_i are the agents that i listens to, w_ij weights (1 unless said), k_i the gain of a pin (a number or a"
        " matrix), 0 without one."
    )
    if problem.offsets:
        text += " Agents keep their formation: x_i is measured from the offset of agent i."
    return text
