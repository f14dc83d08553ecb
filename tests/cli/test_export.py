"""dobc export: C code, FMU and SDPA file from the command line."""

import json
from functools import partial
from pathlib import Path

import pytest
from problem_texts import CHAIN

from dobc_design.export import python_script
from dobc_design.export.c_folder import FILES


@pytest.fixture
def dobc(command_line):
    """Run a command in an empty folder; returns the exit code, standard output and standard
    error."""
    return partial(command_line, "export")


def test_c_code_is_written_with_what_is_proved_about_it(dobc):
    code, out, _ = dobc("paper-fixed", "--c", "code", "--period", "1/20", "--agent", "3", "--json")
    assert code == 0
    document = json.loads(out)
    assert document["agents"] == ["3"]
    assert document["period"] == 0.05
    assert [each["kind"] for each in document["statements"]] == ["sampled", "sampled-network"]
    assert {each["verdict"] for each in document["statements"]} == {"proved"}
    assert sorted(path.name for path in Path("code").iterdir()) == sorted(FILES)
    assert dobc("paper-fixed", "--c", "code", "--period", "0.05")[0] == 2  # it exists already


def test_a_period_that_is_too_long_is_refused_with_one_that_works_and_nothing_is_written(dobc):
    Path("chain.toml").write_text(CHAIN, encoding="utf-8")
    code, out, err = dobc("chain.toml", "--c", "code", "--period", "1")
    assert (code, out) == (2, "")
    assert "too long" in err
    offered = err.rsplit("--period ", 1)[1].strip().rstrip(".")
    assert not Path("code").exists()
    assert dobc("chain.toml", "--c", "code", "--period", offered, "--agent", "1")[0] == 0


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        (["--c", "code"], "a period must be given"),
        (["--c", "code", "--fmu", "a.fmu", "--period", "1"], "exactly one target"),
        ([], "exactly one target"),
        (["--sdpa", "a.dat-s", "--period", "1"], "--period has no meaning with --sdpa"),
        (["--fmu", "a.fmu", "--precision", "float"], "--precision has no meaning with --fmu"),
        (["--python-control", "a.py", "--rate"], "--rate has no meaning with --python-control"),
        (["--c", "code", "--period", "1/20", "--agent", "x"], "no agent 'x'"),
        (["--c", "code", "--period", "1/20", "--certificate", "none"], "none"),
    ],
)
def test_a_wrong_option_is_named_and_nothing_is_written(dobc, arguments: list[str], match: str):
    code, out, err = dobc("paper-fixed", *arguments)
    assert (code, out) == (2, "")
    assert match in err
    assert not list(Path().iterdir())


def test_the_lmi_is_written_for_other_solvers(dobc):
    code, out, _ = dobc("clock-sync", "--sdpa", "lmi.dat-s")
    assert code == 0
    assert "csdp lmi.dat-s" in out
    assert Path("lmi.dat-s").read_text().startswith('"clock-sync: Theorem 1')
    assert dobc("clock-sync", "--sdpa", "lmi.dat-s")[0] == 2
    assert dobc("clock-sync", "--sdpa", "lmi.dat-s", "--force")[0] == 0


def test_a_python_file_is_written_and_overwritten_with_force_only(dobc):
    assert dobc("paper-fixed", "--python-control", "loop.py")[0] == 0
    assert Path("loop.py").read_text("utf-8") == python_script("paper-fixed")
    assert dobc("paper-fixed", "--python-control", "loop.py")[0] == 2
    assert dobc("paper-fixed", "--python-control", "loop.py", "--force")[0] == 0


@pytest.mark.slow
def test_an_fmu_is_written(dobc):
    code, out, _ = dobc("paper-fixed", "--fmu", "agent.fmu", "--period", "1/20", "--json")
    assert code == 0
    assert json.loads(out)["fmu"] == "agent.fmu"
    assert Path("agent.fmu").read_bytes()[:2] == b"PK"


@pytest.mark.slow
def test_a_certificate_says_whether_its_sampling_period_covers_the_one_of_the_code(dobc, tmp_path):
    """clock-sync may hold its couplings for 0.28 s; the certificate of another problem is
    refused."""
    import dobc_design as dd

    certificate = dd.certify("clock-sync", everything=True)
    longest = next(check.exact["period"] for check in certificate.checks if check.id == "sampling")
    certificate.save(tmp_path / "cert")
    for period, verdict in ((longest, "proved"), ("1/3", "undecided")):
        options = ("--c", f"code-{verdict}", "--period", period, "--certificate", "cert", "--json")
        code, out, _ = dobc("clock-sync", *options)
        assert code == 0
        last = json.loads(out)["statements"][-1]
        assert last["kind"] == "certified-sampling"
        assert last["verdict"] == verdict
        where = "What is proved" if verdict == "proved" else "What is not"
        readme = Path(f"code-{verdict}/README.txt").read_text()
        section = " ".join(
            readme.split(where)[1]
            .split("What is not" if verdict == "proved" else "Numbers:")[0]
            .split()
        )
        assert "the certificate's check `sampling`" in section
    code, _, err = dobc("paper-fixed", "--c", "other", "--period", "1/20", "--certificate", "cert")
    assert code == 2
    assert "--certificate must be a valid certificate of this problem" in err
