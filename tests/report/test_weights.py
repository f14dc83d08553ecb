"""Weights that move under a guarantee, drawn: what is proved, phase by phase, and which modes are
on beneath."""

from fractions import Fraction

import pytest
from checker_files.schedules import CHAIN, CHAINED, DWELL
from checker_files.switching import Frames
from matplotlib.figure import Figure

import dobc_design as dd
from dobc_design.certificate.certificate import Certificate
from dobc_design.certificate.text import read_claims
from dobc_design.conditions.schedule.claim import Weights
from dobc_design.loop.guarantee import Phase
from dobc_design.plotting.weights import plot_weights
from dobc_design.problem.canonical import problem_from_canonical
from dobc_design.report.pictures import error_picture, svg_of, weight_pictures
from dobc_design.report.write import render_report

ONE, LONG = Fraction(7, 10), Fraction(6, 5)
STEEP = Weights(
    times=(Fraction(0), ONE, LONG),
    v=((Fraction(1), Fraction(9)), (Fraction(1, 2), Fraction(4)), (ONE, ONE)),
)
LABELS = ("leader", "$x_2$")


def phases(*modes: str) -> list[tuple[Phase, Weights]]:
    given = {"shortest": ONE, "longest": LONG, "successors": (), "first": True}
    return [(Phase(mode=mode, **given), STEEP) for mode in modes]


def drawn(*modes: str) -> tuple[Figure, list[list[float]]]:
    figure = Figure(layout="constrained")
    ax = plot_weights(figure.add_subplot(), phases(*modes), labels=LABELS)
    return figure, [line.get_xydata().round(9).tolist() for line in ax.lines]


def test_phases_follow_each_other_the_largest_weights_first():
    _, lines = drawn("A", "B")
    assert lines[0] == [[0, 9], [0.7, 4]]  # solid until the mode may change
    assert lines[1] == [[0.7, 4], [1.2, 0.7]]
    assert lines[2] == [[0, 1], [0.7, 0.5]]
    assert lines[4] == [[1.2, 9], [1.9, 4]]


def test_the_band_names_every_mode_once_and_names_are_no_mathematics():
    figure, _ = drawn("A", "B", "A")
    main, band = figure.axes
    texts = band.get_legend().get_texts()
    labels = [text.get_text() for text in texts]
    assert labels == ["A", "B"]
    texts_of_main = main.get_legend().get_texts()
    labels_of_main = [text.get_text() for text in texts_of_main]
    assert labels_of_main == ["agent $x_2$", "agent leader"]
    assert band.get_xlabel().startswith("time t in s")
    shown = (main.get_xlabel(), main.get_xlim())
    expected = ("", (0, pytest.approx(3.6)))
    assert shown == expected
    entries = main.get_legend().get_texts()
    assert not any(text.get_parse_math() for text in entries)


@pytest.fixture(scope="module")
def certificate() -> Certificate:
    """Weights by hand: agents 2 and 3 hear the one before, each in one mode; a mode lasts for 1
    s."""
    turns = DWELL | {"longest": 1}
    modes = {"relay": (CHAIN, turns)}
    made = Frames(modes, ("reachability", "lemma1"))
    claims, problem = made.certificate("relay", CHAINED)
    return Certificate(problem=problem_from_canonical(problem), claims=read_claims(claims))


def test_the_report_draws_weights_and_two_runs_below_the_bound(
    certificate: Certificate, drawn_only
):
    drawn_only("error")
    (picture,) = weight_pictures(certificate)
    assert "one round of 2 phases" in picture.alt
    page = render_report(certificate)["report.html"].decode()
    for words in (
        "Weights of the agents that prove it",
        "|e|∞, drawn signal",
        "|e|∞, slow signal",
        "certified bound",
    ):
        assert words in page
    assert "stays in one mode" not in page
    assert certificate.plot().file("svg").count(b"agent 3") == 1


def test_without_a_guarantee_there_is_one_run_in_one_mode_and_no_band(certificate: Certificate):
    plain = certificate.problem.replace(switching=None)
    certified = dd.certify(plain)
    assert certified.weights == ()
    assert list(weight_pictures(certified)) == []
    picture = error_picture(certified, dd.simulate(plain, t_final=2))
    assert "one simulated run" in picture.caption
    assert ">mode<" not in svg_of(picture)
