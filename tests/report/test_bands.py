"""What a report says of sines of unknown frequencies."""

from functools import cache

import matplotlib.pyplot as plt
import numpy as np
import pytest

from dobc_design import Certificate, Exosystem, Network, Observer, Problem, certify
from dobc_design.report.bands import bands_section
from dobc_design.report.document import Only, Picture, Pictures
from dobc_design.report.findings import Findings
from dobc_design.report.write import render_report


@cache
def certified(k: str = "2") -> Certificate:
    """One agent with the paper's observer, which leaves 0.103995 of a sine in [1.8, 2.2]."""
    return certify(
        Problem(
            network=Network.from_arcs({"a": []}, arrow="listens_to", agents=1),
            coupling="y",
            gains={"1": k},
            exosystem=Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]]),
            observer=Observer(W=[["16/5"], ["12/5"]]),
            uncertainty={"bands": [["1.8", "2.2", "1/2"]]},
        )
    )


def page_of(certificate: Certificate) -> str:
    (data,) = (data for name, data in render_report(certificate).items() if name.endswith(".md"))
    return data.decode()


def test_the_table_has_the_part_that_is_proved():
    page = page_of(certified())
    assert "Sines of unknown frequency" in page
    assert "| 1.8 to 2.2 | 0.5 | 0.104 |" in page


def test_a_certificate_that_bounds_errors_has_no_row_of_dashes_for_a_rate():
    page = page_of(certified())
    assert "All agents end within 0.026" in page
    assert "Certified decay rate" not in page
    assert "| Shown by | Final accuracy |" in page


def test_where_nothing_is_proved_the_part_is_drawn_without_a_bound():
    certificate = certified(k="0")
    page = page_of(certificate)
    assert "Sines of unknown frequency" in page
    assert "part left" not in page


def test_without_bands_there_is_no_section():
    plain = certify(certified().problem.replace(uncertainty=None))
    assert "unknown frequency" not in page_of(plain)


def pictures(certificate: Certificate) -> list[Picture]:
    """Those of the section."""
    found = []
    for section in bands_section(Findings(certificate=certificate)):
        for block in section.blocks:
            if isinstance(block, Only):
                (inside,) = block.blocks
                assert isinstance(inside, Pictures)
                found += inside.items
    return found


def test_the_picture_shows_the_size_of_the_filter_and_the_proved_bound():
    """|S(jw)|^2 = (w^2 - 4)^2 / ((44/5 - w^2)^2 + (16 w/5)^2)."""
    (picture,) = pictures(certified())
    assert "Proved in the bands: 0.104" in picture.alt
    _, ax = plt.subplots()
    picture.draw(ax)
    curve, bound, *_ = ax.lines
    w, left = curve.get_data()
    expected = np.abs(w**2 - 4) / np.hypot(8.8 - w**2, 3.2 * w)
    assert left == pytest.approx(np.maximum(expected, 1e-6), rel=1e-6)
    ends, heights = bound.get_data()
    assert list(ends) == [1.8, 2.2]
    assert heights[0] == pytest.approx(0.103995, rel=1e-5)
    inside = (w >= 1.8) & (w <= 2.2)
    assert left[inside].max() <= heights[0]
    plt.close("all")
