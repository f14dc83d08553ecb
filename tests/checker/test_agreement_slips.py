"""The loop of pairs of the second program with one line changed at a time: a case written by hand
notices each."""

import pytest
from checker_files.agreement import agreement_cases
from checker_files.mutants import with_slip
from checker_files.removals import outcome

SLIPS = (
    ("if not case.agrees and not case.signed:", "if True:"),
    ("leader = silent(case)", "leader = None"),
    ("rows.differences = True", "rows.differences = False"),
    ("opposite(case.drift)", "case.drift"),
    ("if case.drift is not None:", "if False:"),
    ("C = [[2 * x for x", "C = [[x for x"),
    ("rows.W = halved_gain(case.W)", "rows.W = case.W"),
    ("[[x / 2 for x", "[[x for x"),
    ("if len(found) == 1 else None", "if found else None"),
    ("enumerate([*others, leader])", "enumerate([leader, *others])"),
    ("i=number[arc.i], j=number[arc.j]", "i=number[arc.i], j=rows.n - 1"),
    ("rows.fixed = 1", "rows.fixed = 2"),
    ("rows.fixed = 2", "rows.fixed = 1"),
    ("h if h.straight else mirrored(h, case.m)", "h"),
    ("exact = plant is None or not", "exact = True or not"),
    ("sole = exact and len(case.functions) == 1 and", "sole = exact and"),
    ("== 1 and case.functions[0].straight", "== 1"),
    (
        "            if sole and not arc.loose:\n                hears",
        "            if sole:\n                hears",
    ),
    (
        "                if sole and not arc.loose:\n                    w",
        "                if sole:\n                    w",
    ),
    ("hears[arc.j][arc.i] = arc.w", "hears[arc.i][arc.j] = arc.w"),
    ("+= min(w, other)", "+= max(w, other)"),
    ("shared[number[i, j]] += min", "shared[number[i, j]] = 2 * min"),
    ("found.append(Arc(pair, count, w, case.functions[0]))", "pass"),
    ("w -= min(w, hears[heard].get(j, ZERO))", "pass"),
    ("if not w:", "if w < 1:"),
    ("first = count if j == heard else number[heard, j]", "first = count"),
    (
        "first = count if j == heard else number[heard, j]",
        "first = count if j == heard else number[j, heard]",
    ),
    ("second = count + 1 if j == heard else number[j, heard]", "second = count + 1"),
    (
        "second = count + 1 if j == heard else number[j, heard]",
        "second = count + 1 if j == heard else number[heard, j]",
    ),
    ("i, heard = arc.i, arc.j", "arc = arc._replace(loose=False); i, heard = arc.i, arc.j"),
    ("second, w, star[arc.coupling]", "second, w, arc.coupling"),
    ("sorted([*found, *mirror]", "sorted([*found]"),
    ('texts = tuple(f"-({re', 'texts = tuple(f"({re'),
    ("f'(-{y[0]})'", "f'({y[0]})'"),
)


@pytest.mark.parametrize(("text", "slip"), SLIPS, ids=[slip for _, slip in SLIPS])
def test_a_changed_line_is_noticed(text: str, slip: str):
    file = "signs" if "y[0]" in text or "texts" in text else "pairs"
    module = with_slip(file, text, slip)
    assert any(
        outcome(module.examine, module.Refused, case) != case.code for case in agreement_cases()
    )
