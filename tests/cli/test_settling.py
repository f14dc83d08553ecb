"""`dobc certify --settling TOL --search`: both in the answer, in the certificate and in the
report."""

import json
from functools import partial
from pathlib import Path

import pytest
from certified import few_chords
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


@pytest.mark.slow
@few_chords()
def test_the_command_of_a_certificate_proves_the_same_from_the_same_starts(
    file: Path, tmp_path: Path
):
    """Starts that are named on the command line, told again by the certificate's own options."""
    starts = ["--settling", "1/10", "--settling-radius", "11/10", "--settling-disturbance", "0"]
    call = ["certify", str(file), "--no-report", *starts, "--out", str(tmp_path / "out")]
    assert CliRunner().invoke(app, call).exit_code == 0
    first = json.loads((tmp_path / "out" / "certificate.json").read_text("utf-8"))
    (settled,) = (check for check in first["checks"] if check["id"] == "settling")
    assert settled["verdict"] == "proved"
    assert settled["domain"]["radius"] == 1.1
    told = " ".join(first["program"]["options"]).split()
    again = ["certify", str(file), "--no-report", *told, "--out", str(tmp_path / "again")]
    assert CliRunner().invoke(app, again).exit_code == 0
    second = json.loads((tmp_path / "again" / "certificate.json").read_text("utf-8"))
    assert second == first


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--settling-radius", "1"], "--settling-radius has no meaning without --settling."),
        (["--settling", "1", "--settling-radius", "far"], "--settling-radius must be a number"),
        (["--settling", "1", "--settling-radius", "0"], "--settling-radius must be > 0"),
        (["--settling", "0"], "--settling must be > 0"),
        (
            ["--settling", "1", "--settling-disturbance", "-1"],
            "--settling-disturbance must be >= 0",
        ),
        (["--rate", "0"], "--rate must be > 0"),
    ],
)
def test_an_error_about_a_number_names_the_option(command_line, file: Path, options, words: str):
    ran = command_line("certify", str(file), "--no-report", *options)
    assert ran.code == 2
    assert words in ran.err
