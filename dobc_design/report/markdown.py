"""The report as Markdown: the same content in text and tables, formulas in LaTeX, no pictures."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from dobc_design._show.text import latex_number
from dobc_design.certificate.certificate import Certificate
from dobc_design.exact.matrix import Matrix
from dobc_design.report import formulas
from dobc_design.report.check_views import CheckRow
from dobc_design.report.figures import thinned_rows
from dobc_design.report.region_words import RegionRow
from dobc_design.report.view import common_view
from dobc_design.report.words import capitalize_first, number

if TYPE_CHECKING:
    from dobc_design.analysis.analysis import Analysis
    from dobc_design.conditions.quadratic.duals import QuadraticDual
    from dobc_design.conditions.schedule.checks import StageTiming
    from dobc_design.falsification.suspect import Falsification
    from dobc_design.simulation.trajectory import Trajectory

_SPECIAL = re.compile(r"[\\`*_\[\]|<>~$&#]")
_OPENING = re.compile(r"^(\d*)([-+=.)])(?=\s|$)")  # would begin a list or underline a heading
MOST_EIGENVALUES = 8
MOST_SAMPLES = 9


def markdown_report(
    certificate: Certificate,
    *,
    analysis: Analysis | None,
    trajectory: Trajectory | None,
    lambdas: Mapping[str, Matrix] | None = None,
    timings: Sequence[StageTiming] = (),
    searches: Sequence[Falsification] = (),
    limits: Sequence[QuadraticDual] = (),
) -> str:
    """Return the report as Markdown; arguments as in ``html_report``."""
    view = common_view(
        certificate,
        analysis=analysis,
        trajectory=trajectory,
        lambdas=lambdas,
        timings=timings,
        searches=searches,
        limits=limits,
    )
    parts = [
        *_head(view),
        *_problem(view),
        *_network(view),
        *_regions(view),
        *_settling(view),
        *_searches(view),
        *_checks(view),
        *_condition(view),
        *_eigenvalues(view, analysis),
        *_simulation(view, trajectory),
        *_traces(view),
        *_end(view),
    ]
    return "\n".join(parts).rstrip() + "\n"


def escape(text: object) -> str:
    """Escape user text so that Markdown and HTML show it as it is, on one line."""
    line = " ".join(str(text).split())
    return _OPENING.sub(r"\1\\\2", _SPECIAL.sub(r"\\\g<0>", line))


def _head(view: Mapping[str, Any]) -> Iterable[str]:
    yield f"# {escape(view['problem'].name)}\n"
    yield f"**{view['symbol']} {view['verdict'].upper()}.** {escape(view['claims'].reason)}\n"
    facts = [*view["title_block"], *view["facts"]]
    yield from _table(["", ""], [[escape(name), escape(value)] for name, value in facts])
    yield from _cure(view)
    yield "## What this says, and what it does not\n"
    yield "It says:\n"
    yield from _list(view["says"])
    yield "It does not say:\n"
    yield from _list(view["says_not"])
    yield "## What was given, assumed and designed\n"
    yield from _list(view["notes"] or ["Nothing was assumed or designed beyond the problem file."])


def _cure(view: Mapping[str, Any]) -> Iterable[str]:
    cure = view["cure"]
    if cure is None:
        return
    yield f"## {escape(cure.head)}\n"
    yield escape(cure.text) + "\n"
    if cure.lines:
        yield "In the problem file:\n"
        yield "\n".join(f"    {line}" for line in cure.lines) + "\n"
    yield f"Proved with the very conditions that failed. To write the cured problem: `{view['cure_command']}`\n"


def _problem(view: Mapping[str, Any]) -> Iterable[str]:
    problem = view["problem"]
    yield "## The problem\n"
    yield escape(" ".join(filter(None, [view["size"], view["pins"], view["region"], view["switching"]]))) + "\n"
    for name, latex, equation in view["loop"]:
        yield f"{capitalize_first(name)} {equation}:\n\n{_formula(latex)}"
    yield f"Coupling and target:\n\n{_formula(formulas.coupling_latex(problem.coupling))}"
    yield _formula(formulas.target_latex(problem))
    yield escape(f"Here {view['letters']}") + "\n"
    if view["groups"]:
        yield "Each agent has the A, C and W of its group:\n"
        yield from _list(view["groups"])
    if view["exceptions"]:
        yield "Arcs with a coupling of their own:\n"
        yield from _list(view["exceptions"])


def _network(view: Mapping[str, Any]) -> Iterable[str]:
    yield "## Who listens to whom\n"
    yield from _list(f"{name}: {sentence}" for name, sentence in view["modes"])
    if view["agents"]:
        names = [f"listens to in {escape(name)}" for name in view["mode_names"]]
        rows = [[escape(x) for x in (row.label, row.gain, row.goal, *row.hears)] for row in view["agents"]]
        yield from _table(["agent", "k in 1/s", "goal", *names], rows)
    if view["graphs"]:
        heads = ["mode", "arcs", "strong components", "balanced", "not reached", "λmax(Λ) in 1/s", "decay in 1/s"]
        yield from _table(heads, [[escape(value) for value in row.values()] for row in view["graphs"]])


def _regions(view: Mapping[str, Any]) -> Iterable[str]:
    regions = view["regions"]
    if regions is None:
        return
    yield "## From which starts it is proved\n"
    yield escape(f"{regions['asked']} {regions['norms']}") + "\n"
    heads = ["method", "verdict", "certified", "|e|∞ ≤", "|e|₂ ≤", "rate in 1/s", regions["time_head"], "covers it"]
    heads = [*heads[:5], *(["|εᵢ| ≤"] if regions["disturbed"] else []), *heads[5:]]
    heads += [*(["cannot exceed"] if regions["limits"] else []), "why not further"]
    yield from _table([escape(head) for head in heads], [_region_cells(row, regions) for row in regions["rows"]])
    for sentence in filter(None, (*regions["limits"], regions["agents"], regions["rest"])):
        yield escape(sentence) + "\n"
    yield from _list(regions["timing"])


def _settling(view: Mapping[str, Any]) -> Iterable[str]:
    settling = view["settling"]
    if settling is None:
        return
    yield "## How fast it is proved to settle\n"
    yield escape(f"{settling['sentence']} {settling['stages']}") + "\n"
    yield from _table([escape(x) for x in settling["heads"]], [[*map(escape, row.cells)] for row in settling["rows"]])
    if settling["timing"]:
        yield escape(settling["timing"]) + "\n"


def _searches(view: Mapping[str, Any]) -> Iterable[str]:
    for search in view["searches"]:
        yield f"## {escape(search['title'])}\n"
        yield escape(f"{search['tried']} {search['found']}") + "\n"
        if search["proved"]:
            yield from _list(search["proved"])
        if search["rows"]:
            rows = [[*map(escape, row.cells)] for row in search["rows"]]
            yield from _table([escape(head) for head in search["heads"]], rows)
        for sentence in filter(None, (search["warning"], *search["notes"])):
            yield escape(sentence) + "\n"


def _region_cells(row: RegionRow, regions: Mapping[str, Any]) -> list[str]:
    errors = [row.disturbance] if regions["disturbed"] else []
    cells = [row.name, f"{row.symbol} {row.verdict}", row.kind, row.box, row.ball, *errors, row.rate, row.time]
    cannot = [row.cannot] if regions["limits"] else []
    return [escape(cell) for cell in (*cells, row.covers, *cannot, row.limit)]


def _checks(view: Mapping[str, Any]) -> Iterable[str]:
    yield "## What was checked\n"
    yield "“Proved” and “refuted” rest on exact arithmetic alone."
    yield "Margins and rates are in 1/s and cut towards zero: they hold as printed.\n"
    heads = ["verdict", "condition", "id", "where", "margin", "rate", "reason"]
    yield from _table(heads, [_check_cells(row) for row in view["checks"]])
    if view["checks_hidden"]:
        yield view["checks_hidden"] + "\n"
    yield "What the conditions decide:\n"
    yield from _list(f"{name} ({id}): {what}." for id, name, what in view["check_glossary"])


def _check_cells(row: CheckRow) -> list[str]:
    name = row.name if row.mode is None else f"{row.name}, mode {row.mode}"
    name += "" if row.group is None else f", group of agent {row.group}"
    reason = [escape(row.reason), *(f"{escape(key)}: {escape(value)}." for key, value in row.exact)]
    if row.witness is not None:
        reason.append(f"{escape(row.witness[0])}: {escape(row.witness[1])}.")
    if row.fix is not None:
        reason.append(f"**Cure:** {escape(row.fix)}")
        reason += [escape(line) + ";" for line in row.fix_lines]
    cells = [f"{row.symbol} {row.verdict}", escape(name), escape(row.id), escape(row.domain), row.margin, row.rate]
    return [*cells, "<br>".join(reason)]


def _condition(view: Mapping[str, Any]) -> Iterable[str]:
    yield "## The condition and its matrices\n"
    if not view["problem"].groups:
        yield _formula(formulas.LAMBDA + " < 0")
    else:
        for latex in (formulas.PSI, formulas.LAMBDA, formulas.OMEGA, formulas.REDUCED, formulas.BY_EXISTENCE):
            yield _formula(latex)
        if view["by_group"]:
            yield f"{view['by_group']}\n"
    for item in view["matrices"]:
        yield f"{capitalize_first(item.what)}:\n"
        yield _formula(f"{item.name} = {item.latex}") if item.latex else f"{item.size}, see certificate.json.\n"
    for name, bound in view["bounds"].items():
        yield f"For {name}:\n\n" + _formula(rf"\lambda_{{\max}}(\Lambda) < {latex_number(bound)}")
    for item in view["lambdas"]:
        yield f"At the target, mode {escape(item.what)}:\n\n" + _formula(f"{item.name} = {item.latex}")


def _eigenvalues(view: Mapping[str, Any], analysis: Analysis | None) -> Iterable[str]:
    if analysis is None:
        return
    yield "## Eigenvalues\n"
    yield "Computed in floating point, for orientation. No verdict rests on them.\n"
    if view["observability"]:
        yield escape(view["observability"]) + "\n"
    rows = []
    if analysis.spectrum is not None:
        rows.append(["A − WC", _values(analysis.spectrum.eigenvalues)])
    for mode in analysis.modes:
        if mode.lambda_eigenvalues is not None:
            rows.append([f"Λ(J), mode {escape(mode.mode)}", _values(mode.lambda_eigenvalues[::-1])])
        if mode.loop_eigenvalues is not None:
            rows.append([f"J − K, mode {escape(mode.mode)}", _values(mode.loop_eigenvalues)])
    yield from _table(["matrix", "eigenvalues in 1/s, the rightmost first"], rows[:40])


def _values(values: Sequence[complex]) -> str:
    shown = [
        number(v.real) + (f" {'−' if v.imag < 0 else '+'} {number(abs(v.imag))}i" if v.imag else "")
        for v in map(complex, values[:MOST_EIGENVALUES])
    ]
    hidden = len(values) - len(shown)
    return ", ".join(shown) + (f" and {hidden} more" if hidden else "")


def _simulation(view: Mapping[str, Any], trajectory: Trajectory | None) -> Iterable[str]:
    if trajectory is None or not view["simulation"]:
        return
    yield "## A simulation\n"
    yield f"An illustration, not a proof. {escape(view['simulation'])}\n"
    error = trajectory.error()
    rows = thinned_rows(len(trajectory.times), MOST_SAMPLES)
    yield from _table(
        ["time in s", "largest error"], [[number(float(trajectory.times[i])), number(float(error[i]))] for i in rows]
    )


def _traces(view: Mapping[str, Any]) -> Iterable[str]:
    yield "## Traceability\n"
    yield view["traced"] + "\n"
    yield from _table(view["trace_heads"], [[*map(escape, row.cells)] for row in view["traces"]])


def _end(view: Mapping[str, Any]) -> Iterable[str]:
    again = view["again"]
    yield "## Check it yourself\n"
    yield f"```\n{again['verify']}\n```\n"
    yield "This decides every claim again in exact arithmetic, against the problem file, which it trusts."
    yield "With nothing but Python, and none of this package, the lone checker (a folder) does the same:\n"
    yield f"```\n{again['alone']}\n```\n"
    yield "To make the certificate again, byte for byte with the same version:\n"
    yield f"```\n{again['certify']}\n```\n"
    yield view["made_with"] + "\n"
    yield from _table(["", ""], [[escape(name), escape(value)] for name, value in _identity(view)])
    yield "## Glossary\n"
    yield from _list(f"{word}: {meaning}" for word, _, meaning in view["verdict_words"])
    yield "## Signatures\n"
    yield view["signing"] + "\n"
    yield from _table(
        ["", *view["signed"]], [[role, *("&nbsp;" * 24 for _ in view["signed"])] for role in view["roles"]]
    )


def _identity(view: Mapping[str, Any]) -> Iterable[tuple[str, str]]:
    yield "problem", view["claims"].problem_name
    yield from ((f"SHA-256 of {name}", value) for name, value in view["again"]["fingerprints"])
    yield from view["again"]["versions"]


def _list(items: Iterable[str]) -> Iterable[str]:
    yield from (f"- {escape(item)}" for item in items)
    yield ""


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterable[str]:
    yield f"| {' | '.join(heads)} |"
    yield f"|{' --- |' * len(heads)}"
    yield from (f"| {' | '.join(row)} |" for row in rows)
    yield ""


def _formula(latex: str) -> str:
    return f"$$\n{latex}\n$$\n"
