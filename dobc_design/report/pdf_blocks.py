"""The report as a list of plain blocks (headings, texts, tables, figures) for the Typst template; user text stays text.

The template never reads text as markup: everything from the problem file reaches it as a string in JSON.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from itertools import pairwise
from typing import Any

from dobc_design.report import network_words as nw
from dobc_design.report.check_views import CheckRow
from dobc_design.report.pdf_parts import (
    Block,
    code_block,
    formula_block,
    gallery_blocks,
    heading_block,
    list_block,
    matrix_block,
    number_parts,
    table_block,
    text_block,
    verdict_mark,
)
from dobc_design.report.region_words import RegionRow
from dobc_design.report.words import capitalize_first, typeset

View = Mapping[str, Any]


def blocks(view: View) -> list[Block]:
    """All blocks in the order of the page."""
    parts: Iterable[Iterator[Block]] = (
        _cure(view),
        _meaning(view),
        _problem(view),
        _network(view),
        _regions(view),
        _settling(view),
        _searches(view),
        _checks(view),
        _condition(view),
        _pictures_of(view),
        _traces(view),
        _again(view),
        _glossary(view),
        _signatures(view),
    )
    found = [block for part in parts for block in part]
    for block, after in pairwise(found):
        if block.get("style") == "plain" and after["kind"] not in ("heading", "text"):
            block["style"] = "lead"  # stays on the page of what it introduces
    return found


def _cure(view: View) -> Iterator[Block]:
    cure = view["cure"]
    if cure is None:
        return
    yield heading_block(cure.head)
    yield text_block(cure.text)
    if cure.lines:
        yield text_block("In the problem file:")
        yield code_block(*cure.lines)
    yield text_block("The cured problem was decided by the very conditions that failed. This writes it to a file:")
    yield code_block(view["cure_command"])


def _meaning(view: View) -> Iterator[Block]:
    yield heading_block("What this says, and what it does not")
    yield heading_block("It says", level=2)
    yield list_block(view["says"])
    yield heading_block("It does not say", level=2)
    yield list_block(view["says_not"])
    yield heading_block("What was given, assumed and designed")
    yield list_block(view["notes"] or ["Nothing was assumed or designed beyond the problem file."])


def _problem(view: View) -> Iterator[Block]:
    problem = view["problem"]
    disturbed = ", disturbed" if problem.groups else ""
    yield heading_block("The problem")
    yield text_block(" ".join(filter(None, [view["size"], view["pins"], view["region"], view["switching"]])))
    for name, _, number in view["loop"]:
        yield formula_block(name + disturbed, label=name, number=number)
    letters = "h(y)" if problem.coupling.by_component else "h(y) by components"
    yield table_block(
        ["", ""],
        [
            ["coupling", [f"{letters} = {problem.coupling.texts[0]}", *problem.coupling.texts[1:]]],
            ["target", nw.vector_text(problem.target)],
        ],
        [0, 1],
    )
    yield text_block(f"Here {view['letters']}")
    if view["groups"]:
        yield text_block("Each agent has the A, C and W of its group:")
        yield list_block(view["groups"])
    if view["exceptions"]:
        yield text_block("Arcs with a coupling of their own:")
        yield list_block(view["exceptions"])


def _network(view: View) -> Iterator[Block]:
    yield heading_block("Who listens to whom")
    yield list_block(f"{name}: {sentence}" for name, sentence in view["modes"])
    yield from gallery_blocks(view["network_pictures"])
    yield text_block(view["network_legend"], style="caption")
    if view["agents"]:
        goals = bool(view["problem"].offsets)
        names = [f"listens to in {name}" for name in view["mode_names"]]
        heads = ["agent", "k in 1/s", *(["goal"] if goals else []), *names]
        rows = [[row.label, row.gain, *([row.goal] if goals else []), *row.hears] for row in view["agents"]]
        yield table_block(heads, rows, [1.2, 0.8, *([1] if goals else []), *(2 for _ in names)])
    if view["graphs"]:
        heads = ["mode", "arcs", "strong components", "balanced", "not reached", "λmax(Λ) in 1/s", "decay in 1/s"]
        yield table_block(heads, [[*row.values()] for row in view["graphs"]], [1.4, 1, 1.2, 1, 1.2, 1.2, 1.2])


def _regions(view: View) -> Iterator[Block]:
    regions = view["regions"]
    if regions is None:
        return
    yield heading_block("From which starts it is proved")
    yield text_block(regions["asked"])
    yield from gallery_blocks(view["region_pictures"])
    limits = bool(regions["limits"])
    heads = ["method", "verdict", "certified starts", "rate in 1/s", regions["time_head"], "covers it"]
    heads += [*(["cannot exceed"] if limits else []), "why not further"]
    widths = [1.1, 0, 1.3, 0.8, 0.8, 0.7, *([0.9] if limits else []), 1.7]
    yield table_block(heads, [_region_row(row, limits=limits) for row in regions["rows"]], widths)
    yield text_block(regions["norms"], style="caption")
    for sentence in filter(None, (*regions["limits"], regions["rest"])):
        yield text_block(sentence)
    if regions["timing"]:
        yield list_block(regions["timing"])


def _region_row(row: RegionRow, *, limits: bool) -> list[Any]:
    cannot = [row.cannot] if limits else []
    cells = [row.starts, row.rate, row.time, row.covers, *cannot, row.limit]
    return [[row.name, row.id], verdict_mark(row.symbol, row.verdict), *cells]


def _settling(view: View) -> Iterator[Block]:
    settling = view["settling"]
    if settling is None:
        return
    yield heading_block("How fast it is proved to settle")
    yield text_block(settling["sentence"])
    yield from gallery_blocks([view["envelope_picture"]])
    yield text_block(settling["stages"])
    yield table_block(settling["heads"], [row.cells for row in settling["rows"]], [1] * len(settling["heads"]))
    if settling["timing"]:
        yield text_block(settling["timing"], style="caption")


def _searches(view: View) -> Iterator[Block]:
    if view["searches"]:
        yield heading_block("What a search for counterexamples found")
    for search, picture in zip(view["searches"], view["search_pictures"], strict=True):
        yield heading_block(search["title"], level=2)
        yield text_block(f"{search['tried']} {search['found']}")
        if search["proved"]:
            yield list_block(search["proved"])
        yield from gallery_blocks([picture])
        if search["rows"]:
            yield table_block(search["heads"], [row.cells for row in search["rows"]], [1] * len(search["heads"]))
        yield from (text_block(sentence) for sentence in filter(None, (search["warning"], *search["notes"])))


def _checks(view: View) -> Iterator[Block]:
    yield heading_block("What was checked")
    yield text_block(
        "“Proved” and “refuted” rest on exact arithmetic alone. Margins and rates are in 1/s and cut towards zero, so"
        " that they hold as printed."
    )
    heads = ["verdict", "condition", "where", "margin", "rate", "reason"]
    yield table_block(heads, [_check_row(row) for row in view["checks"]], [0, 1.5, 1.1, 0.8, 0.8, 3])
    if view["checks_hidden"]:
        yield text_block(view["checks_hidden"])


def _check_row(row: CheckRow) -> list[Any]:
    name = [row.name, *([] if row.mode is None else [f"mode {row.mode}"]), row.id]
    reason = [row.reason, *(f"{key}: {value}" for key, value in row.exact)]
    if row.witness is not None:
        reason.append(f"{row.witness[0]}: {row.witness[1]}")
    if row.fix is not None:
        reason += [f"Cure: {row.fix}", *row.fix_lines]
    return [verdict_mark(row.symbol, row.verdict), name, row.domain, typeset(row.margin), typeset(row.rate), reason]


def _condition(view: View) -> Iterator[Block]:
    yield heading_block("The condition and its matrices")
    if not view["problem"].groups:
        yield text_block("Without a disturbance, Lemma 1 asks in every mode for")
        yield formula_block("lemma 1")
    else:
        yield text_block("Theorems 1 and 2 ask for matrices P > 0 and Q, with W = P⁻¹ Q, such that in every mode")
        yield formula_block("psi", number="(18)")
        yield from (formula_block(name) for name in ("lambda", "omega"))
        yield text_block("where J is the Jacobian of the couplings. The size of the condition does not matter, because")
        yield formula_block("reduced")
        yield text_block("and, when nothing is said about P and Q,")
        yield formula_block("existence")
        if view["by_group"]:
            yield text_block(view["by_group"])
    yield from (matrix_block(item, capitalize_first(item.what)) for item in view["matrices"])
    if view["matrices"]:
        yield text_block(
            "Entries with a decimal point are rounded for this page; certificate.json holds them exactly.",
            style="caption",
        )
    for name, bound in view["bounds"].items():
        yield {"kind": "bound", "label": f"For {name} the condition is", "number": number_parts(bound)}
    for item in view["lambdas"]:
        yield matrix_block(item, f"Λ at the target, mode {item.what}")


def _pictures_of(view: View) -> Iterator[Block]:
    if view["eigenvalue_pictures"]:
        yield heading_block("Eigenvalues")
        text = "Computed in floating point, to show how far things are from the edge. No verdict rests on them."
        yield text_block(" ".join(filter(None, (text, view["observability"]))))
        yield from gallery_blocks(view["eigenvalue_pictures"])
    if view["simulation_pictures"]:
        yield heading_block("A simulation")
        yield text_block(
            f"An illustration, not a proof. {view['simulation']} One run shows one start; the verdict does not use it."
        )
        yield from gallery_blocks(view["simulation_pictures"])


def _traces(view: View) -> Iterator[Block]:
    yield heading_block("Traceability")
    yield text_block(view["traced"])
    rows = [
        [[row.name, row.id], row.meaning, row.source, [*row.modules], row.checker, row.found] for row in view["traces"]
    ]
    yield table_block(view["trace_heads"], rows, [1.2, 1.9, 1.2, 1.4, 1.1, 0.8])


def _again(view: View) -> Iterator[Block]:
    again = view["again"]
    yield heading_block("Check it yourself")
    yield text_block("With certificate.json and problem.json in one folder, this decides every claim again, exactly:")
    yield code_block(again["verify"])
    yield text_block(
        "It trusts the problem file and nothing of the certificate. With nothing but Python, and none of this package,"
        " the lone checker (the folder dobc_design/checker) does the same:"
    )
    yield code_block(again["alone"])
    yield text_block("This makes the certificate again, byte for byte with the same version:")
    yield code_block(again["certify"])
    yield text_block(view["made_with"])
    prints = [[f"SHA-256 of {name}", value] for name, value in again["fingerprints"]]
    yield table_block(["", ""], [["problem", view["claims"].problem_name], *prints, *again["versions"]], [0, 1])


def _glossary(view: View) -> Iterator[Block]:
    yield heading_block("Glossary")
    yield table_block(
        ["verdict", "meaning"],
        [[verdict_mark(sign, word), meaning] for word, sign, meaning in view["verdict_words"]],
        [0, 1],
    )


def _signatures(view: View) -> Iterator[Block]:
    yield heading_block("Signatures")
    yield text_block(view["signing"])
    yield {"kind": "signatures", "heads": ["role", *view["signed"]], "roles": list(view["roles"])}
