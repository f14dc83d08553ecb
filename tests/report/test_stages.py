"""A settling time in the report: stages in rows, the envelope drawn, nothing rounded to the better side."""

from __future__ import annotations

from fractions import Fraction
from functools import cache

import numpy as np
import pytest
from matplotlib.figure import Figure
from staging_cases import ASKED, chain, problem

from dobc_design.conditions.schedule.checks import StageTiming, stage_timings
from dobc_design.conditions.schedule.decide import Settling
from dobc_design.conditions.separable.claim import DelayBound, SamplingBound
from dobc_design.report.figures import plot_envelope
from dobc_design.report.pictures import envelope_pictures
from dobc_design.report.region_words import settling_section, settling_sentence, stages_table, timing_notes
from dobc_design.verdict import Verdict

F = Fraction


@cache
def settling() -> Settling:
    """Two max-separable stages and two quadratic ones, R = 2, |eps_i| <= 1/2."""
    asked = {name: getattr(ASKED, name) for name in ("radius", "disturbance", "tolerance")}
    return Settling(verdict=Verdict.PROVED, reason="", problem_name="three", staging=chain(), **asked)


def timing(period: str, delay: str) -> StageTiming:
    held = SamplingBound(period=F(period), factor=F(1, 2))
    return StageTiming(sampling=held, delay=DelayBound(delay=F(delay), rate=F(1)))


def test_every_stage_is_a_row_and_quadratic_ones_say_nothing_about_sampling():
    timings = [timing("0.0123456", "1/20"), timing("1/8", "1/5"), StageTiming(), StageTiming()]
    rows = stages_table(settling(), timings).rows
    assert [(kind, held, late) for _, kind, *_, held, late in rows] == [
        ("max-separable", "0.01234 s", "0.05 s"),
        ("max-separable", "0.125 s", "0.2 s"),
        ("quadratic", "–", "–"),
        ("quadratic", "–", "–"),
    ]


def test_bounds_and_times_are_raised_and_rates_are_cut():
    for row, stage in zip(stages_table(settling(), ()).rows, settling().stages, strict=True):
        number, _, start, level, bound, rate, *_ = row
        assert F(start.removesuffix(" s")) >= stage.start
        assert F(bound) >= stage.level * stage.height
        assert F(level) >= stage.level
        assert F(rate) <= F(settling().rows()[int(number) - 1][4]) * F(1001, 1000)


def test_the_sentence_claims_no_more_than_is_proved():
    sentence = settling_sentence(settling())
    assert "|e|∞ ≤ 2 and |εᵢ| ≤ 0.5 for every i" in sentence
    assert "|e(t)|∞ ≤ 0.001" in sentence
    told = float(sentence.partition("t ≥ ")[2].partition(" s")[0])
    assert settling().time <= told <= settling().time * 1.001
    assert timing_notes(()) == []
    assert list(settling_section(None, (), ())) == []


def test_what_the_stages_allow_is_told_apart_from_what_the_certificate_holds():
    (note,) = timing_notes([timing("1/8", "1/5")] * 2 + [StageTiming()] * 2)
    assert "the certificate has them for its whole region only" in note


def test_the_curve_drawn_is_the_certified_bound():
    ax = plot_envelope(Figure().add_subplot(), settling())
    curve = ax.lines[0]
    assert curve.get_ydata()[0] >= 2
    assert curve.get_ydata()[-1] <= 0.001
    assert np.array_equal(curve.get_ydata(), settling().envelope(curve.get_xdata()))
    marks = [line.get_xdata()[0] for line in ax.lines[1:4]]
    assert marks == [float(stage.start) for stage in settling().stages[1:]]
    assert ax.get_yscale() == "log"


def test_the_picture_says_in_words_what_it_shows():
    (picture,) = envelope_pictures(settling())
    assert "in 4 stage(s)" in picture.alt
    assert list(envelope_pictures(None)) == []


@pytest.mark.slow
def test_sampling_and_delays_are_decided_stage_by_stage_and_grow_as_the_box_shrinks():
    found = stage_timings(problem(), settling())
    assert [each.sampling is None for each in found] == [False, False, True, True]
    assert found[0].sampling.period < found[1].sampling.period
    assert all(each.delay is not None for each in found[:2])
