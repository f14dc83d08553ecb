"""What a report says of late and held readings."""

import math
import re

import pytest

from dobc_design import Certificate, Network, Problem, certify
from dobc_design.report.document import Text
from dobc_design.report.findings import Findings
from dobc_design.report.readings import readings_section
from dobc_design.report.write import render_report

ALONE = Network.from_arcs({"a": []}, arrow="listens_to", agents=["1"])
REGION = {"initial_states": [-1, 1]}


def alone(**tables) -> Problem:
    """x' = -x - tanh(0), computed now and then: below T = 1 it does not overshoot."""
    return Problem(network=ALONE, coupling="y", gains=1, region=REGION, **tables)


def page_of(certificate: Certificate) -> str:
    (data,) = (data for name, data in render_report(certificate).items() if name.endswith(".md"))
    return data.decode()


def section_of(certificate: Certificate) -> str:
    """The sentences of the section alone."""
    found = [
        str(block.words)
        for section in readings_section(Findings(certificate=certificate))
        for block in section.blocks
        if isinstance(block, Text)
    ]
    return "\n".join(found)


def test_a_processor_has_its_samples_to_one_percent_and_the_longest_period_that_was_tried():
    certificate = certify(alone(processor={"period": "0.5"}))
    page = page_of(certificate)
    assert "Late and held readings" in page
    # the largest k with factor (1 - T rate)^k > 1/100, and one more
    left = 1 - 0.5 * certificate.rate
    samples = math.ceil(math.log(0.01 / certificate.factor) / math.log(left))
    assert f"One percent is reached within {samples} samples." in page
    (longest,) = re.findall(r"computed and held over \| 0\.5 s \| ([\d.]+) s", page)
    # linear: all starts are covered, and T = 1 is the bound
    assert 0.9 < float(longest) <= 1


def test_broadcasts_on_events_have_a_least_time_between_them_and_a_report_without_tables_has_none():
    page = section_of(certify(alone(readings={"event": "0.1"})))
    # |e'| <= s, the threshold is s/10: t exp(rate t) = 1/10
    (gap,) = re.findall(r"at most once in ([\d.]+) s", page)
    assert 0.05 < float(gap) <= 0.1
    assert section_of(certify(alone())) == ""


@pytest.mark.parametrize("period", ["2.1"])
def test_what_diverges_is_told_with_its_reason(period):
    assert "does not converge" in section_of(certify(alone(processor={"period": period})))
