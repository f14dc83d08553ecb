"""What a sweep leaves: tables in every format with the same content, answers, figures."""

import csv
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from problem_texts import CHAIN

from dobc_design.errors import SpecError
from dobc_design.plotting.sweeps import Cases, Places, heat_map, lines
from dobc_design.sweeps.plan import Task, make_plan
from dobc_design.sweeps.result import SweepResult


def made(over, tmp_path: Path, *, task: str = "certify", samples=None, missing=()) -> SweepResult:
    """A result whose numbers are made up: rate = number of the case / 10, every third undecided,
    some failed."""
    (tmp_path / "c.toml").write_text(CHAIN, encoding="utf-8")
    plan = make_plan(tmp_path / "c.toml", over, task=Task(kind=task), samples=samples)
    lines = []
    for number in range(len(plan)):
        found = dict.fromkeys(name for name, _, _ in plan.task.columns)
        if task == "certify":
            found |= {
                "verdict": "undecided" if number % 3 == 2 else "proved",
                "rate": number / 10,
                "reason": 'r, "q"',
            }
        else:
            found |= {
                "diverged": number % 2 == 1,
                "diverged_runs": number % 2,
                "settling_time": None,
            }
        error = (
            {"kind": "k", "key": None, "message": "it broke", "cure": "mend it"}
            if number in missing
            else None
        )
        values = list(plan.values(number))
        about = {"case": number, "id": f"{number:064x}", "values": values, "seconds": 0.5}
        lines.append(about | {"result": None if error else found, "error": error})
    return SweepResult(plan=plan, lines=tuple(lines))


GRID = {"pinning.gains.3": "1:3:3", "coupling.h": "y,tanh(y),sin(y),atan(y)"}


def test_csv_and_json_lines_hold_every_row(tmp_path):
    result = made(GRID, tmp_path, missing=(4,))
    saved = result.save(tmp_path / "r.csv")
    file = saved.open(encoding="utf-8", newline="")
    rows = list(csv.DictReader(file))
    lines = result.save(tmp_path / "r.jsonl").read_text("utf-8").splitlines()
    again = [json.loads(line) for line in lines]
    assert again == result.rows
    assert len(rows) == 12
    assert rows[5]["pinning.gains.3"] == "2.0"
    assert rows[5]["coupling.h"] == "tanh(y)"
    assert rows[5]["rate"] == "0.5"
    assert rows[4]["rate"] == ""
    assert rows[4]["error"] == "it broke"
    assert rows[3]["error"] == ""
    assert rows[0]["reason"] == 'r, "q"'


def test_a_table_is_not_overwritten_and_has_a_known_ending(tmp_path):
    result = made(GRID, tmp_path)
    result.save(tmp_path / "r.csv")
    with pytest.raises(SpecError, match="exists already"):
        result.save(tmp_path / "r.csv", force=False)
    result.save(tmp_path / "r.csv")
    with pytest.raises(SpecError, match=r"saved as .csv, .jsonl, .parquet"):
        result.save(tmp_path / "r.xls")


def test_parquet_holds_the_same_rows_with_their_types(tmp_path):
    pytest.importorskip("pandas", reason="needs dobc_design[store]")
    parquet = pytest.importorskip("pyarrow.parquet", reason="needs dobc_design[store]")
    for task, missing in (("certify", (4,)), ("simulate", ())):
        result = made(GRID, tmp_path, task=task, missing=missing)
        table = parquet.read_table(result.save(tmp_path / f"{task}.parquet"))
        assert table.to_pylist() == result.rows
        assert list(result.frame().columns) == list(result.columns)
        kinds = {field.name: str(field.type) for field in table.schema}
        names = {"text": "string", "number": "double", "truth": "bool", "count": "int64"}
        columns = result.columns.items()
        assert kinds == {name: names[kind] for name, kind in columns}


def test_without_the_extra_the_message_says_what_is_missing_and_what_works(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    result = made(GRID, tmp_path)
    with pytest.raises(SpecError, match=r"dobc_design\[store\]") as caught:
        result.save(tmp_path / "r.parquet")
    assert ".csv and .jsonl need none" in str(caught.value.cure)


def test_a_result_shows_itself_with_user_text_escaped(tmp_path):
    result = made({"name": '"<b>",x'}, tmp_path, missing=(1,))
    assert "2 cases of name: 1 proved, 1 failed" in str(result)
    assert "&lt;b&gt;" in result._repr_html_()
    assert "<b></td>" not in result._repr_html_()
    with pytest.raises(SpecError, match="is no column"):
        result.column("rat")


RATE = "certified rate in 1/s"


@pytest.mark.parametrize(
    ("over", "samples", "options", "axes"),
    [
        (GRID, None, {}, ("pinning.gains.3", "coupling.h")),
        (GRID, None, {"x": "coupling.h"}, ("coupling.h", RATE)),
        (
            {"pinning.gains.3": "1:3:3", "coupling.h": "y,tanh(y)"},
            None,
            {},
            ("pinning.gains.3", RATE),
        ),
        ({"coupling.h": "y,tanh(y)", "target": "~uniform(0,1)"}, 6, {}, ("target", RATE)),
        ({"target": "~loguniform(1,1000)"}, 6, {"value": "rate"}, ("target", RATE)),
        (
            {"target": "~uniform(0,1)", "coupling.h": "~choice(y,sin(y))"},
            6,
            {"x": "coupling.h"},
            ("coupling.h", None),
        ),
    ],
)
def test_a_figure_names_what_it_shows(tmp_path, over, samples, options, axes):
    sheet = made(over, tmp_path, samples=samples).plot(**options)
    drawn = sheet.figure.axes[0]
    assert drawn.get_xlabel() == axes[0]
    if axes[1] is not None:
        assert drawn.get_ylabel() == axes[1]
    assert sheet.file("png")[:4] == b"\x89PNG"


def test_a_heat_map_draws_the_median_of_what_falls_on_a_cell_and_marks_the_worst_verdict(tmp_path):
    grid = {**GRID, "target": "~uniform(0,1)"}
    result = made(grid, tmp_path, samples=3, missing=(0,))
    figure = result.plot().figure
    collection = figure.axes[0].collections[0]
    mesh = collection.get_array().reshape(4, 3)
    for row in range(4):
        for column in range(3):
            numbers = []
            for k in range(3):
                numbers.append((column * 4 + row) * 3 + k)
            rates = [number / 10 for number in numbers if number != 0]
            assert mesh[row, column] == pytest.approx(np.median(rates))
    assert "median over target" in figure.axes[0].get_title("left")
    texts = [text.get_text() for text in figure.axes[0].texts]
    assert texts.count("!") == 1
    assert texts.count("?") == 11


@pytest.mark.parametrize(("ratio", "scale"), [(10.0, "log"), (1.1, "linear")])
def test_rates_that_span_decades_are_drawn_on_a_logarithmic_axis(ratio: float, scale: str):
    value = ratio ** np.arange(6.0)
    outcome = ["proved"] * 6
    cases = Cases(value=value, outcome=outcome, label="rate", title="", note="", series=[""] * 6)
    agents = Places(name="agents", position=np.arange(6.0), ticks=np.arange(6.0))
    assert lines(agents, cases).figure.axes[0].get_yscale() == scale
    row = Places(name="k", position=np.zeros(6), ticks=np.zeros(1))
    figure = heat_map(agents, row, cases).figure
    assert figure.axes[1].get_yscale() == scale  # of the bar of colours


def test_what_cannot_be_drawn_is_refused_with_what_can(tmp_path):
    result = made(GRID, tmp_path)
    no_number = ({"value": "verdict"}, "no numeric column")
    no_axis = ({"x": "rate"}, "no axis")
    same_axis = ({"x": "coupling.h", "y": "coupling.h"}, "different axes")
    for options, words in (
        no_number,
        no_axis,
        ({"value": "box"}, "nothing to be drawn"),
        same_axis,
    ):
        with pytest.raises(SpecError, match=words):
            result.plot(**options)


def test_a_case_without_a_number_stands_on_the_axis_and_is_named():
    """The last one is open: a reader sees where, and the scale is that of the numbers."""
    times = np.array([1.0, 2.0, 3.0])
    places = Places(name="period in s", position=times, ticks=times)
    value = np.array([0.5, 0.4, np.nan])
    outcome = ["proved", "proved", "undecided"]
    cases = Cases(
        value=value, outcome=outcome, label="rate", title="", note="", series=["", "", ""]
    )
    (ax,) = lines(places, cases).figure.axes
    (mark,) = (each for each in ax.lines if each.get_label() == "undecided, no number")
    assert mark.get_xdata().tolist() == [3.0]
    assert ax.get_ylim()[0] > 0.3
    assert [text.get_text() for text in ax.get_legend().texts] == ["undecided, no number"]


def test_an_axis_of_times_says_its_unit(tmp_path):
    result = made(["processor.period=1/10,1/5"], tmp_path)
    assert result.plot().figure.axes[0].get_xlabel() == "processor.period in s"
