"""Two certificates side by side: what is the same, what differs, and nothing that a user wrote gets
out of its cell."""

import dataclasses
import re
from functools import partial

import pytest
from reports import Page, compare_html, compare_markdown

from dobc_design import Network, Observer, Verdict
from dobc_design.conditions.kinds import KINDS
from dobc_design.report.comparison import comparison_document, conclusion, differences
from dobc_design.report.document import Mark, Table


def ring(n: int, *, back: bool = False) -> list[tuple[int, int]]:
    arcs = []
    for i in range(n):
        arcs.append((i + 1, (i + 1) % n + 1))
    return arcs + [(j, i) for i, j in arcs] if back else arcs


def table_in(section: str, first, second) -> Table:
    blocks = comparison_document(first, second).section(section)
    return next(each for each in blocks if isinstance(each, Table))


def test_a_problem_differs_from_itself_in_nothing(problem_with, certificate_of):
    assert differences(problem_with(), problem_with()) == ([], 0)
    assert "The two problems are the same." in compare_markdown(certificate_of(), certificate_of())


def test_two_certificates_of_one_name_are_told_apart_in_the_title(problem_with, certificate_of):
    other = certificate_of(problem_with(name="valley"))
    assert comparison_document(certificate_of(), other).title.endswith(" and valley, compared")
    again = certificate_of(problem_with(name="valley", target=2))
    title = comparison_document(other, again).title
    assert title == "valley (A) and valley (B), compared"


def test_networks_that_would_be_drawn_alike_are_not_drawn(problem_with, certificate_of):
    """A gain is no part of a drawing; who is pinned is."""
    first = certificate_of(problem_with(gains={1: 5}))
    for gains, drawn in (({1: 4}, False), ({2: 5}, True)):
        page = compare_html(first, certificate_of(problem_with(gains=gains)))
        assert ("A: Mode" in page) == drawn


def test_every_kind_of_difference_is_named_by_its_key(problem_with):
    first = problem_with()
    region = {"initial_states": [0, 5], "initial_disturbance": "1/2"}
    arcs = {"Ga": [*ring(10)[1:], (1, 3)]}
    network = Network.from_arcs(arcs, arrow="listens_to", agents=10)
    second = problem_with(
        target=2,
        coupling="tanh(y)",
        gains={1: 3, 2: "1/3"},
        observer=Observer(rate=2),
        region=region,
        offsets={3: 1},
        actuators={"limit": 10},
        network=network,
    )
    compared = differences(first, second)[0]
    found = {key: (a, b) for key, a, b in compared}
    assert found == {
        "network.modes.Ga: 1 listens to 2": ("there", "–"),
        "network.modes.Ga: 1 listens to 3": ("–", "there"),
        "target": ("1", "2"),
        "coupling.h": ("exp(y) - 1 + y", "tanh(y)"),
        "pinning.gains.1": ("5", "3"),
        "pinning.gains.2": ("–", "1/3"),
        "pinning.gains.6": ("5", "–"),
        "observer.rate": ("–", "2"),
        "observer.W": ("[3.2, 2.4]", "–"),
        "observer.P": ("[[0.5, -0.25], [-0.25, 1/3]]", "–"),
        "formation.offsets.3": ("–", "1"),
        "region.initial_states": ("–", "[0, 5]"),
        "region.initial_disturbance": ("–", "0.5"),
        "actuators.limit": ("–", "10"),
    }


def test_many_arcs_and_whole_modes_are_counted(problem_with):
    both = {"G": ring(10), "only": ring(10)}
    turned = {"G": [(j, i) for i, j in ring(10)]}
    one, other = (
        problem_with(network=Network.from_arcs(modes, arrow="listens_to", agents=10))
        for modes in (both, turned)
    )
    (arcs, mode), count = differences(one, other)
    assert count == 2
    assert arcs[0] == "network.modes.G: arcs that differ"
    assert mode == ("network.modes.only", "10 arcs", "–")
    assert arcs[1].startswith("10: 1 listens to 2, 2 listens to 3")
    assert arcs[2].startswith("10: 2 listens to 1")


def test_arcs_that_may_be_absent_are_told_from_those_that_are_there(problem_with):
    arcs = ring(10)
    make = partial(Network.from_arcs, arrow="listens_to", agents=10)
    one = problem_with(network=make({"G": arcs}))
    other = problem_with(network=make({"G": arcs[1:]}, optional={"G": arcs[:1]}))
    (arc,), count = differences(one, other)
    assert count == 1
    assert arc == ("network.modes.G: 1 listens to 2", "there", "optional")


@pytest.mark.parametrize(
    ("first", "second", "words"),
    [
        (
            {},
            {"rate": 0.5},
            "Both are proved. B has the larger certified rate, 0.5 against 0.2618 1/s of A.",
        ),
        ({}, {}, "Both are proved, at the same certified rate."),
        (
            {},
            {"verdict": Verdict.REFUTED, "rate": None, "covered_by": None},
            "A is proved, B is refuted.",
        ),
    ],
)
def test_the_conclusion_compares_verdicts_and_rates(certificate_of, first, second, words):
    assert conclusion(certificate_of(**first), certificate_of(**second)) == words


def test_checks_are_paired_by_id_and_mode_and_marked_where_they_differ(certificate_of):
    one = certificate_of()
    checks = {check.id: check for check in one.checks}
    checks["lemma1"] = dataclasses.replace(checks["lemma1"], margin=0.1)
    del checks["hurwitz"]
    other = certificate_of(checks=tuple(checks.values()))
    table = table_in("checks", one, other)
    ids = [check.id for check in one.checks]
    kinds = [row[0].parts[0] for row in table.rows]
    assert kinds == [KINDS[id].name for id in ids]
    rows = dict(zip(ids, table.rows, strict=True))
    assert {ids[place] for place in table.marked} == {"lemma1", "hurwitz"}
    shown = rows["lemma1"][1:5]
    assert shown == (Mark("✓", "proved"), Mark("✓", "proved"), "0.5822", "0.1")
    assert rows["hurwitz"][2] == "–"


def test_starts_stand_beside_each_other(asked_for, certificate_of):
    table = table_in("starts", asked_for["certificate"], certificate_of())
    rows = {name: starts for name, *starts in table.rows}
    assert rows["Max-separable"][0].startswith("box |e|∞ ≤ 4")
    quadratic = next(starts for name, starts in rows.items() if name.startswith("Lur"))
    assert quadratic[0].startswith("ball |e|₂ ≤ 1.079")
    assert quadratic[1] == "–"


def test_the_page_loads_nothing_and_its_drawings_have_their_own_names(certificate_of, problem_with):
    arcs = {"Ga": ring(10, back=True)}
    network = Network.from_arcs(arcs, arrow="listens_to", agents=10)
    other = certificate_of(problem_with(name="other", network=network))
    page = compare_html(certificate_of(), other)
    assert not re.search(r"(?:src|href)=\"(?!#)", page)
    assert "<script" not in page
    ids = []
    for _, each in Page(page).elements:
        if "id" in each:
            ids.append(each["id"])
    assert len(set(ids)) == len(ids)
    assert page.count("<svg") == 2
