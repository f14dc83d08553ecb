"""The report's section on regions: what is drawn is what is proved, and nothing is rounded to the
better side."""

import dataclasses
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from matplotlib.figure import Figure
from reports import html_report, markdown_report

from dobc_design import Network, Verdict
from dobc_design.certificate.regions import AgentBound, Asked, RegionClaim, Regions
from dobc_design.conditions.check import Check, Values, Witness
from dobc_design.conditions.domain import NEAR_TARGET, Box
from dobc_design.plotting.look import Sheet
from dobc_design.plotting.regions import plot_regions, plot_starts, region_sheet
from dobc_design.report.region_words import (
    agents_sentence,
    asked_sentence,
    regions_table,
    rest_sentence,
    timing_sentences,
    upper,
)

BOX = Box(4.0, 0.5)


def claim(id: str = "max-separable", **changes: Any) -> RegionClaim:
    settings: dict[str, Any] = {
        "id": id,
        "variant": "",
        "verdict": Verdict.PROVED,
        "kind": "box",
        "covers": True,
    }
    sizes = {"box": 4.0, "ball": 4.0, "disturbance": 0.5, "rate": 0.20408, "time": 25.6001}
    return RegionClaim(**settings | sizes | changes)


BALL = claim(
    "lure",
    variant="P_e full",
    kind="ball",
    box=0.35987,
    ball=1.13899,
    covers=False,
    limit="no P_e is found.",
)
NEAR = claim(
    "theorem1",
    kind="near",
    box=None,
    ball=None,
    disturbance=None,
    time=None,
    covers=False,
    limit="local.",
)
NONE = claim(
    verdict=Verdict.UNDECIDED,
    kind="none",
    box=None,
    ball=None,
    disturbance=None,
    rate=None,
    time=None,
)
EVERYWHERE = claim(kind="everywhere", box=None, ball=None, disturbance=None)
AGENTS = (
    AgentBound(label="a", bound=4.0, pinned=True, goal=1.0),
    AgentBound(label="b", bound=6.65, pinned=False, goal=1.0),
)


def make(*claims: RegionClaim, **changes: Any) -> Regions:
    asked = Asked(box=4.0, ball=12.6491107, disturbance=0.5, interval=(0.0, 5.0))
    settings: dict[str, Any] = {
        "name": "ring",
        "verdict": Verdict.PROVED,
        "reason": "Here is why.",
        "agents": AGENTS,
    }
    others = {"asked": asked, "tolerance": 0.04, "delay": None, "sampling": None}
    return Regions(claims=claims, **settings | others | changes)


def check(id: str, **changes: Any) -> Check:
    settings = {"verdict": Verdict.PROVED, "domain": BOX, "reason": "it is so.", **changes}
    return Check(id=id, **settings)


def rows(regions: Regions) -> list[dict[str, Any]]:
    """The table's cells by the heads of their columns, each once."""
    table = regions_table(regions, disturbed=True)
    by_head = []
    for row in table.rows:
        by_head.append({column.head: cell for column, cell in zip(table.columns, row, strict=True)})
    return by_head


def test_sizes_and_rates_are_cut_and_times_and_wishes_are_raised():
    shown = rows(make(BALL))[0]
    shown_values = [shown[head] for head in ("|e|∞ ≤", "|e|₂ ≤", "rate in 1/s")]
    expected = ["0.3598", "1.138", "0.204"]
    assert shown_values == expected
    assert shown["|e|∞ ≤ 0.04 after"] == "25.61 s"
    assert "at least 12.65." in asked_sentence(make(BALL))


@pytest.mark.parametrize(
    ("value", "shown"), [(25.6001, "25.61"), (25.61, "25.61"), (6925.01, "6926"), (0.5, "0.5")]
)
def test_a_time_is_never_shown_shorter_than_it_is(value: float, shown: str):
    assert upper(value) == shown


def test_sizes_have_the_unit_that_all_components_share():
    regions = make(claim(), BALL, NEAR, EVERYWHERE, unit="m")
    box, ball, near, everywhere = rows(regions)
    assert (box["|e|∞ ≤"], ball["|e|₂ ≤"]) == ("4 m", "1.138 m")
    assert (near["|e|∞ ≤"], everywhere["|e|∞ ≤"]) == ("–", "any")
    assert box["certified starts"] == "box |e|∞ ≤ 4 m, every |εᵢ| ≤ 0.5"
    assert box["|e|∞ ≤ 0.04 m after"] == "25.61 s"
    assert "|e|∞ ≤ 4 m and |εᵢ| ≤ 0.5" in asked_sentence(regions)
    assert str(regions).count(" 4 m ") == 2
    assert "up to 4 m, for some agents up to 6.65 m." in agents_sentence(regions)


def test_times_of_the_table_are_told_apart_from_the_time_to_one_percent_of_the_verdict():
    """Both are of the same bound factor |e(0)| exp(-rate t) + error; only the table has the
    error."""
    told = "Times in the table count what the estimation errors add."
    assert told in asked_sentence(make(claim()))
    calm = Asked(box=4.0, ball=12.6491107, disturbance=0.0)
    assert told not in asked_sentence(make(claim(disturbance=0.0), asked=calm))
    assert told not in asked_sentence(make(claim(time=None)))


def test_rows_say_what_covers_and_why_not():
    regions = make(claim(), BALL, NEAR, NONE, EVERYWHERE)
    covering, ball, near, none, everywhere = rows(regions)
    assert covering["covers it"] == "yes"
    assert covering["why not further"] == "It covers what was asked for; more was not tried."
    assert covering["certified starts"] == "box |e|∞ ≤ 4, every |εᵢ| ≤ 0.5"
    assert str(ball["method"]) == "Lur’e, Pₑ full"
    assert ball["covers it"] == "no"
    assert ball["why not further"] == "No P_e is found."
    assert (
        ball["certified starts"]
        == "ball |e|₂ ≤ 1.138, every |εᵢ| ≤ 0.5; it holds the box |e|∞ ≤ 0.3598"
    )
    assert near["certified"] == "near the target, no radius"
    assert near["|e|∞ ≤"] == "–"
    shown = (none["verdict"].verdict, none["certified"], none["rate in 1/s"])
    expected = ("undecided", "–", "–")
    assert shown == expected
    shown_everywhere = (everywhere["|e|∞ ≤"], everywhere["|e|₂ ≤"], everywhere["certified"])
    expected_everywhere = ("any", "any", "every start")
    assert shown_everywhere == expected_everywhere
    uncovered = make(claim(covers=False), asked=None)
    assert rows(uncovered)[0]["covers it"] == "–"


@pytest.mark.usefixtures("undrawn")
def test_where_nothing_is_asked_the_sentence_says_so_and_there_is_no_section(
    problem_with, certificate_of
):
    assert "the largest that was found is shown." in asked_sentence(make(claim(), asked=None))
    assert asked_sentence(make(NONE, asked=None)) == "No region was asked for."
    assert rows(make(NEAR, tolerance=None))[0]["settled after"] == "–"
    arcs = {"G": [(1, 2), (2, 1)]}
    network = Network.from_arcs(arcs, arrow="listens_to", agents=2)
    problem = problem_with(network=network, gains={1: 1})
    local = check("theorem1", domain=NEAR_TARGET)
    certificate = certificate_of(problem, checks=(local,))
    page = html_report(certificate)
    assert 'id="region"' not in page
    assert "From which starts" not in markdown_report(certificate)


def test_delays_and_sampling_have_a_sentence_each():
    delay = check("delay", rate=0.101989, claim=Values({"delay": "1/50", "rate": "101989/1000000"}))
    sampling = check("sampling", claim=Values({"period": "21/1000", "factor": "99/100"}))
    late, held = timing_sentences(make(claim(), delay=delay, sampling=sampling))
    assert "every bounded communication delay" in late
    assert "up to 0.02 s" in late
    assert "every rate below 0.1019 1/s" in late
    assert held.startswith(
        "With couplings and pinning measured and held every 0.021 s, the proof still holds"
    )
    assert "at least 1 % a sample, up to what the estimation error adds." in held


def test_a_sample_without_disturbance_has_nothing_added_and_only_a_very_short_one_is_explained():
    calm = {"domain": dataclasses.replace(BOX, disturbance=0.0)}
    half_second = ("1/2", "1/2", calm)
    microsecond = ("1/1000000", "999/1000", {})
    hundredth = ("1/100", "999/1000", {})
    for period, factor, more in (
        half_second,
        microsecond,
        hundredth,
    ):
        sampling = check("sampling", claim=Values({"period": period, "factor": factor}), **more)
        (held,) = timing_sentences(make(claim(), sampling=sampling))
        assert held.endswith("at least 50 % a sample.") is bool(more)
        assert ("That is short because" in held) is (period == "1/1000000")


def test_a_proved_settling_time_has_its_own_section_and_what_is_undecided_gives_its_reason():
    settling = check(
        "settling", reason="|e(t)|_inf <= 0.04 for all t >= 15.6 s, by a max-separable certificate."
    )
    assert timing_sentences(make(claim(), settling=settling)) == []
    left = {}
    for id in ("settling", "delay"):
        left[id] = check(id, verdict=Verdict.UNDECIDED, reason="left out.")
    assert timing_sentences(make(claim(), **left)) == ["Settling: left out.", "Delay: left out."]


def test_bars_are_as_long_as_what_is_proved():
    """Solid bars end at the box, thin lines at the ball, the dashed line stands at what is
    asked."""
    axes = Figure().add_subplot()
    regions = make(claim(), BALL, NEAR)
    ax = plot_regions(axes, regions)
    assert [bar.get_width() for bar in ax.patches] == [4.0, 0.35987]
    ends = [tuple(line.get_xdata()) for line in ax.lines]
    assert (0.35987, 1.13899) in ends
    assert sum(x == (4.0, 4.0) for x in ends) == 1
    names = [text.get_text() for text in ax.get_yticklabels()]
    assert names == ["Max-separable", "Lur’e\nPₑ full", "Theorem 1"]
    texts = [text.get_text() for text in ax.texts]
    assert texts == ["4", "0.3598 … 1.138", "near the target, no radius"]


def test_every_start_fills_the_axis_and_an_equilibrium_is_a_dotted_line():
    witness = Witness(kind="start", values=("33/20", "-33/20"))
    rest = check("equilibrium", verdict=Verdict.REFUTED, domain=NEAR_TARGET, witness=witness)
    ax = plot_regions(Figure().add_subplot(), make(EVERYWHERE, equilibrium=rest))
    widths = [bar.get_width() for bar in ax.patches]
    expected = [ax.get_xlim()[1]]
    assert widths == expected
    lines = [tuple(line.get_xdata()) for line in ax.lines]
    assert (1.65, 1.65) in lines
    entries = ax.get_legend().get_texts()
    assert "other equilibrium" in [text.get_text() for text in entries]
    assert "|e|∞ ≈ 1.65" in (rest_sentence(make(EVERYWHERE, equilibrium=rest)) or "")
    assert rest_sentence(make(EVERYWHERE)) is None


def test_agents_have_bars_around_their_goals_and_the_band_is_what_was_asked():
    ax = plot_starts(Figure().add_subplot(), make(claim()))
    spans = []
    for bar in ax.patches:
        spans.append((bar.get_y(), bar.get_y() + bar.get_height()))
    assert spans[0] == (-3.0, 5.0)
    assert spans[1] == pytest.approx((-5.65, 7.65))
    assert spans[2] == (0.0, 5.0)
    assert ax.get_ylabel() == "xᵢ(0), in units of x"


def test_the_figure_is_a_file_by_itself_also_by_its_public_function(
    asked_for: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    regions = make(claim(), BALL, name="<a> & $x_1$")
    picture = region_sheet(regions).file("svg")
    assert picture == region_sheet(regions).file("svg")
    assert "<a> & $x_1$" in [element.text for element in ElementTree.fromstring(picture).iter()]
    assert region_sheet(regions).file("png").startswith(b"\x89PNG")
    sheet = asked_for["certificate"].plot()
    assert len(sheet.figure.axes) == 2
    monkeypatch.setattr(Sheet, "file", lambda self, kind: f"a figure as {kind}".encode())
    assert sheet.save(tmp_path / "region.svg").read_bytes() == b"a figure as svg"


@pytest.mark.usefixtures("undrawn")
def test_a_proof_that_covers_delays_and_sampling_does_not_exclude_them(asked_for: dict[str, Any]):
    assert "messages without delay" in html_report(**asked_for)
    certificate = asked_for["certificate"]
    sampling = check("sampling", claim=Values({"period": "1/50", "factor": "99/100"}))
    claims = dataclasses.replace(certificate.claims, checks=(*certificate.checks, sampling))
    page = html_report(dataclasses.replace(certificate, claims=claims))
    assert "messages without delay" not in page
    assert "communication delay and sampling as far as their checks say" in page
