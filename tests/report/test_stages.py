"""A settling time in the report: what proves it in rows, the envelope drawn, nothing rounded to the
better side."""

from dataclasses import replace
from fractions import Fraction
from functools import cache

import numpy as np
from checker_files.separable import problems
from checker_files.settling import STRETCHED
from matplotlib.figure import Figure

from dobc_design.conditions.check import check_from_json
from dobc_design.conditions.schedule.checks import read_claim, settling_of
from dobc_design.conditions.schedule.claim import Tube
from dobc_design.conditions.schedule.settling import Settling
from dobc_design.loop.make import loop_of
from dobc_design.report.figures import plot_envelope
from dobc_design.report.pictures import envelope_pictures
from dobc_design.report.region_words import settling_section, settling_sentence, stages_table

F = Fraction


@cache
def settling() -> Settling:
    """A box that moves until 1/2 s and a quadratic certificate, R = 1, |eps_i| <= 1/2; 0.01 from
    4.6764 s on."""
    problem = problems()["observed, linear"]
    claim = read_claim(check_from_json(STRETCHED), loop_of(problem), problem.observer.W)
    return settling_of(loop_of(problem), claim, "")


def test_what_proves_the_time_are_two_rows_whose_bounds_are_raised_and_rates_cut():
    """The bound of the second is 0.92102 * 0.707107 = 0.651259."""
    shown = stages_table(settling()).rows
    (box, last), (first, second) = shown, settling().stages
    assert first.rate is None
    assert second.rate == 1
    assert box == ("moving box", "0 s", "1", "–")
    assert last[0] == "quadratic"
    assert last[3] == "1"
    assert F(last[1].removesuffix(" s")) >= F(1, 2)
    shown_bound = F(last[2])
    assert second.bound <= shown_bound <= second.bound * F(1001, 1000)
    rows = settling().rows()
    kinds = [row[1] for row in rows]
    assert kinds == ["moving box", "quadratic"]


def test_the_sentence_claims_no_more_than_is_proved():
    sentence = settling_sentence(settling())
    assert "|e|∞ ≤ 1 and |εᵢ| ≤ 0.5 for every i" in sentence
    assert "|e(t)|∞ ≤ 0.01" in sentence and "by a moving box and a certificate" in sentence
    after = sentence.partition("t ≥ ")[2]
    told = float(after.partition(" s")[0])
    assert settling().time <= told <= settling().time * 1.001
    assert list(settling_section(None, ())) == []


def test_the_curve_drawn_is_the_certified_bound_and_said_in_words():
    ax = plot_envelope(Figure().add_subplot(), replace(settling(), unit="m"))
    curve = ax.lines[0]
    assert curve.get_ydata()[0] >= 1
    assert curve.get_ydata()[-1] <= 0.01
    envelope = settling().envelope(curve.get_xdata())
    assert np.array_equal(curve.get_ydata(), envelope)
    assert ax.lines[1].get_xdata()[0] == 0.5  # where the certificate takes over
    assert ax.get_yscale() == "log"
    assert ax.get_ylabel() == "|e|∞, in m"
    (picture,) = envelope_pictures(settling())
    assert "from 1 down to 0.01 at 4.67" in picture.alt
    assert list(envelope_pictures(None)) == []


def test_without_a_moving_box_one_certificate_covers_the_whole_time():
    whole, claim = settling(), settling().claim
    observed = loop_of(problems()["observed, linear"])
    tube = Tube.start(observed, F(1), claim.tube.error)
    at_once = replace(claim, tube=tube)
    only = replace(whole, claim=at_once)
    assert "by one certificate" in settling_sentence(only)
    assert [row[0] for row in stages_table(only).rows] == ["quadratic"]
    for each, words in (
        (whole, "A box that moves with time"),
        (only, "One certificate covers the whole time"),
    ):
        (section,) = settling_section(each, ())
        assert words in str(section)
