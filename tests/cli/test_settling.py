"""`dobc certify --settling TOL --search`: both in the answer, in the certificate and in the
report."""

import json
from functools import partial
from pathlib import Path

import pytest
from problem_texts import listening_pair_text
from typer.testing import CliRunner

from dobc_design.cli.main import app
from dobc_design.falsification import falsify as falsification


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(falsification, "falsify", partial(falsification.falsify, runs=10))
    path = tmp_path / "pair.toml"
    path.write_text(listening_pair_text(1), encoding="utf-8")
    return path


@pytest.mark.slow
def test_the_answer_and_the_report_hold_the_settling_time_and_searches(file: Path, tmp_path: Path):
    call = ["certify", str(file), "--settling", "1/100", "--search", "--out", str(tmp_path / "out")]
    done = CliRunner().invoke(app, call)
    assert done.exit_code == 0
    assert "|e(t)|∞ ≤ 0.01 for all t ≥" in done.stdout
    assert "No suspect was found, which proves nothing." in done.stdout
    for name in ("report.html", "report.md"):
        text = (tmp_path / "out" / name).read_text("utf-8")
        assert "How fast it is proved to settle" in text
        assert "One certificate covers the whole time." in text
        assert "starts from the region were simulated" in text
    again = CliRunner().invoke(app, [*call, "--json", "--no-report"])
    document = json.loads(again.stdout)
    assert [each["target"] for each in document["searches"]] == [
        "the region",
        "the boundary of the max-separable set",
    ]
    assert document["checks"][-1]["id"] == "settling"
    kept = CliRunner().invoke(app, ["verify", str(tmp_path / "out"), "--problem", str(file)])
    assert kept.exit_code == 0
