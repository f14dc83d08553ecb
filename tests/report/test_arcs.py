"""Arc-wise certificates in a report: what each arc takes of its two agents, and where least is
left."""

from functools import cache

import numpy as np
import pytest
from arc_wise import claimed, searched
from matplotlib.figure import Figure

from dobc_design import Certificate, Network, Problem, certify
from dobc_design.certification import certify as order
from dobc_design.conditions.arcs.claim import ArcWise
from dobc_design.conditions.arcs.shares import shares_of
from dobc_design.conditions.arcs.stage import arcs_stage
from dobc_design.loop.make import loop_of
from dobc_design.report import arcs as shown
from dobc_design.report.arcs import arcs_section
from dobc_design.report.document import Only, Picture, Pictures, Table, Text
from dobc_design.report.figures import Taken, plot_shares
from dobc_design.report.findings import Findings
from dobc_design.report.write import render_report

ONE = [[1, 2], [2, 1], [2, 3], [3, 2], [3, 4], [4, 3]]
OTHER = [[1, 4], [4, 1], [4, 3], [3, 4], [3, 2], [2, 3]]
REGION = {"initial_states": ["-4/5", "4/5"]}


def rows() -> Problem:
    """Four agents in a row, of which two change places: no common box."""
    network = Network.from_arcs({"one": ONE, "other": OTHER}, arrow="listens_to")
    return Problem(network=network, coupling="sin(y)", gains={1: 3}, target=0, region=REGION)


@cache
def proved() -> Certificate:
    return certify(rows())


def section(certificate: Certificate) -> tuple[str, Picture | None, list[tuple[str, ...]]]:
    """Its sentence, its picture and the rows of its table."""
    (found,) = arcs_section(Findings(certificate=certificate))
    text, picture, table = "", None, list[tuple[str, ...]]()
    for block in found.blocks:
        if isinstance(block, Text):
            text = str(block.words)
        if isinstance(block, Table):
            table = [tuple(map(str, row)) for row in block.rows]
        if isinstance(block, Only) and isinstance(block.blocks[0], Pictures):
            (picture,) = block.blocks[0].items
    return text, picture, table


def test_what_a_pin_gives_is_what_arcs_the_rate_and_the_rest_take_together():
    """Linear in the numbers: added up by hand for every agent."""
    problem = rows()
    claim = searched(problem).claim
    assert isinstance(claim, ArcWise)
    for mode, names in (("one", ONE), ("other", OTHER)):
        shares = shares_of(loop_of(problem), claim, mode)
        given = np.array([6.0, 0, 0, 0])
        total = shares.left + 2 * float(claim.rate)
        for (i, j), own, other in zip(names, shares.own, shares.other, strict=True):
            total[i - 1] += own
            total[j - 1] += other
        assert total == pytest.approx(given, abs=1e-9)
        assert shares.left.min() >= 0


@pytest.mark.parametrize("d", [(1, 1), (1, 3)])
def test_what_an_arc_leaves_is_the_least_of_its_term_on_a_grid(d: tuple[int, int]):
    """Of a x^2 + b y^2 - 2 d_i w x sin(y - x) over d_i x^2 + d_j y^2, on the disc of radius 2."""
    network = Network.from_arcs([[1, 2, 2]], arrow="listens_to")
    problem = Problem(network=network, coupling="sin(y)", gains={1: 9, 2: 9}, target=0)
    loop = loop_of(problem)
    shares = shares_of(loop, claimed(loop, [3], [5], level=4, rate=1, d=d), *loop.modes)
    angle, radius = np.meshgrid(np.linspace(0, 2 * np.pi, 1441), np.linspace(1e-3, 2, 200))
    x = radius * np.cos(angle) / np.sqrt(d[0])
    y = radius * np.sin(angle) / np.sqrt(d[1])
    term = 3 * x * x + 5 * y * y - 4 * d[0] * x * np.sin(y - x)
    assert shares.room[0] == pytest.approx(np.min(term / radius**2), rel=0.01)


def test_a_report_names_the_arc_and_the_agent_that_leave_least():
    text, picture, table = section(proved())
    assert "Least is left to agent 1, mode one: 0.005" in text
    name, *_, room = table[0]
    assert f"The arc that leaves least of its numbers: {name}, about 0.0013" in text
    assert float(room) == min(float(row[-1]) for row in table)
    assert len(table) == shown.MOST_ROWS
    assert picture is not None
    assert "3 hears 4, mode one: " in picture.alt
    assert "|e|∞ ≤ 0.8" in picture.caption


def test_a_page_has_the_picture_and_markdown_the_table():
    files = render_report(proved())
    page, markdown = (files[name].decode() for name in ("report.html", "report.md"))
    for text in (page, markdown):
        assert "Arc by arc: who takes and who gives" in text
        assert text.count(" hears ") >= shown.MOST_ROWS
    assert 'aria-label="What arcs take at most' in page


def test_of_many_arcs_those_that_leave_least_are_drawn(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(shown, "MOST_DRAWN", 4)
    _, picture, _ = section(proved())
    assert picture is not None
    assert "The 4 of 12 arcs that leave least are drawn." in picture.caption
    ax = Figure().add_subplot()
    picture.draw(ax)
    assert len(ax.get_yticks()) == 4


def test_of_very_many_arcs_nothing_is_shown(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(shown, "MOST_ARCS", 11)
    assert list(arcs_section(Findings(certificate=proved()))) == []


def test_agents_that_hear_nobody_have_no_picture_of_arcs():
    network = Network.from_arcs({"G": []}, arrow="listens_to", agents=2)
    problem = Problem(
        network=network, coupling="sin(y)", gains={1: 3, 2: 1}, target=0, region=REGION
    )
    text, picture, table = section(certify(problem, everything=True))
    assert "Least is left to agent" in text
    assert picture is None and table == []


def test_where_agents_agree_the_nodes_are_pairs(monkeypatch: pytest.MonkeyPatch):
    # The boxes of pairs, which come first, cover it as well.
    monkeypatch.setattr(order, "STAGES", (arcs_stage,))
    network = Network.from_arcs([[1, 2], [2, 1]], arrow="listens_to")
    problem = Problem(
        network=network,
        coupling="tanh(y)",
        goal="agreement",
        region={"initial_states": [0, 1]},
    )
    text, _, _ = section(certify(problem))
    assert "from every pair. Least is left to pair (" in text


def test_a_report_without_an_arc_wise_certificate_has_no_such_section(certificate: Certificate):
    assert list(arcs_section(Findings(certificate=certificate))) == []


def test_an_arc_has_two_bars_that_end_where_its_numbers_are():
    ax = Figure().add_subplot()
    plot_shares(ax, [Taken("b hears $a_", own=-1.5, other=2.0, room=0.1)])
    ends = sorted(bar.get_width() for bar in ax.patches)
    assert ends == [-1.5, 2.0]
    (label,) = ax.get_yticklabels()
    assert label.get_text() == "b hears $a_"
