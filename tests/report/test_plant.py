"""Model error, noise and input limits in a report: bounds, inputs, tolerance; nothing where nothing
is asked."""

import re
from dataclasses import replace
from fractions import Fraction
from typing import Any

import pytest

from dobc_design import Verdict, certify, load_problem
from dobc_design.conditions.check import Check, Values
from dobc_design.conditions.domain import Box
from dobc_design.report.document import Beside, Section, Table, Text
from dobc_design.report.findings import Findings
from dobc_design.report.plant import MOST_ROWS, plant_numbers, plant_section
from dobc_design.report.write import render_report

BOX = Box(4.0, 0.5)
TABLES = {
    "uncertainty": {"disturbance": "1/10", "weights": "1/50"},
    "actuators": {"limit": {"1": 30}},
}


def checked(
    id: str, verdict: Verdict = Verdict.PROVED, reason: str = "why.", **exact: Any
) -> Check:
    return Check(
        id=id, verdict=verdict, domain=BOX, reason=reason, claim=Values(exact) if exact else None
    )


def parts(certificate: Any) -> dict[str, Section]:
    (section,) = plant_section(Findings(certificate=certificate))
    (beside,) = (each for each in section.blocks if isinstance(each, Beside))
    return {each.title: each for (each,) in beside.parts}


def rows(section: Section) -> list[tuple[Any, ...]]:
    shown_rows = []
    for block in section.blocks:
        if isinstance(block, Table):
            for row in block.rows:
                shown_rows.append(row)
    return shown_rows


def test_assumptions_are_a_table_and_agents_with_the_same_bound_share_a_row(
    problem_with, certificate_of
):
    """A bound is never shown smaller than it is: 0.250001 is 0.2501."""
    bounds = {}
    for i in range(1, 11):
        bounds[str(i)] = "0.250001" if i % 2 else "1/2"
    accuracy = (checked("accuracy", bounds=bounds),)
    found = certificate_of(problem_with(**TABLES), checks=accuracy)
    (section,) = plant_section(Findings(certificate=found))
    expected = (
        ("unmodelled disturbance", "0.1"),
        ("error of every arc weight", "2 %"),
        ("inputs |uᵢ| of 1 agent", "30"),
    )
    assert section.blocks[0].rows == expected
    shown = rows(parts(found)["Accuracy"])
    found_rows = [row[:2] for row in shown]
    assert found_rows == [("2, 4, 6, 8 and 10", "0.5"), ("1, 3, 5, 7 and 9", "0.2501")]


def test_of_many_agents_the_worst_are_shown_and_the_others_counted(problem_with, certificate_of):
    bounds = {}
    for i in range(1, 31):
        bounds[str(i)] = str(Fraction(i, 10))
    problem = problem_with(n=30, **TABLES)
    checks = (checked("accuracy", bounds=bounds),)
    found = parts(certificate_of(problem, checks=checks))
    labels = [row[0] for row in rows(found["Accuracy"])]
    expected = [str(30 - k) for k in range(MOST_ROWS)]
    assert labels == expected
    assert found["Accuracy"].blocks[-1].words.startswith("And 22 more")


def test_inputs_come_by_their_share_of_the_limit_and_those_without_one_last(
    problem_with, certificate_of
):
    actuators = {"limit": {"1": 30, "2": 10}}
    limits = {"uncertainty": None, "actuators": actuators}
    equal_inputs = {str(i): "25" for i in range(3, 11)}
    inputs = {"1": "20", "2": "9", **equal_inputs}
    check = checked("actuators", rho="1", inputs=inputs)
    certificate = certificate_of(problem_with(**limits), checks=(check,))
    shown = parts(certificate)["Inputs"]
    expected = [("2", "9", "10"), ("1", "20", "30"), ("3, 4, 5, 6, 7, 8 and 2 more", "25", "–")]
    assert rows(shown) == expected


@pytest.mark.parametrize(
    ("verdict", "head"),
    [(Verdict.PROVED, "Proved for starts"), (Verdict.UNDECIDED, "Undecided. Why.")],
)
def test_a_tolerance_is_told_in_a_sentence(
    verdict: Verdict, head: str, problem_with, certificate_of
):
    checks = (checked("tolerance", verdict),)
    certificate = certificate_of(problem_with(**TABLES), checks=checks)
    found = parts(certificate)
    (text,) = found["Tolerance"].blocks
    assert isinstance(text, Text)
    assert text.words.startswith(head)


def test_in_one_line_each_only_what_is_proved_with_its_worst_agent(problem_with, certificate_of):
    """Bounds are rounded up, tolerances down."""
    accuracy = checked("accuracy", bounds={"1": "1/3", "2": "2/3"})
    actuators = checked("actuators", inputs={"1": "25", "2": "7"})
    tolerance = checked("tolerance", weights="206/10001", gains="1/50", alpha="1")
    checks = [accuracy, actuators, tolerance]
    told = ["largest |u| ≤ 25 (agent 1)", "largest final |e| ≤ 0.6667 (agent 2)"]
    told += ["weights may be off by 2.059 %, gains by 2 %"]
    assert plant_numbers(certificate_of(problem_with(), checks=tuple(checks))) == told
    open_ones = tuple(replace(check, verdict=Verdict.UNDECIDED) for check in checks)
    assert plant_numbers(certificate_of(problem_with(), checks=open_ones)) == []


def test_an_empty_table_of_actuators_asks_for_the_inputs_alone(problem_with, certificate_of):
    inputs = {str(i): "25" for i in range(1, 11)}
    check = checked("actuators", rho="1", inputs=inputs)
    bare = certificate_of(problem_with(actuators={}), checks=(check,))
    (section,) = plant_section(Findings(certificate=bare))
    assert [type(block) for block in section.blocks] == [Beside]
    bare = certificate_of(problem_with(uncertainty={}), checks=())
    assert list(plant_section(Findings(certificate=bare))) == []


@pytest.mark.slow
def test_a_certified_problem_has_the_block_on_its_first_page():
    problem = load_problem("paper-fixed").replace(
        uncertainty={"disturbance": "1/10"}, actuators={"limit": 30}
    )
    files = render_report(certify(problem))
    text = files["report.md"].decode()
    assert (
        text.index("## Model error, noise and input limits")
        < text.index("## The loop")
        < text.index("## The problem")
    )
    assert re.search(r"\| 1 and 6 \| 2\d\.\d\d \| 30 \|", text)
    page = files["report.html"].decode()
    assert page.index("Model error, noise and input limits") < page.index("<details")
