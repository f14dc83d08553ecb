"""`dobc report`: the report of a certificate again; two certificates side by side."""

import json
import re
import sys
from pathlib import Path

import pytest
from certified import certify_once
from problem_texts import CHAIN


@pytest.fixture
def dobc(command_line, monkeypatch):
    """Run the command line in a folder with two certificates, A and B: exit code, standard output
    and error."""
    monkeypatch.setattr("dobc_design.certification.certify.certify", certify_once)
    Path("a.toml").write_text(CHAIN, encoding="utf-8")
    Path("b.toml").write_text(CHAIN.replace("3 = 5", "3 = 0"), encoding="utf-8")
    assert command_line("certify", "a.toml", "--no-report", "-q", "--out", "A")[0] == 0
    assert command_line("certify", "b.toml", "--no-report", "-q", "--out", "B")[0] == 1
    return command_line


def test_two_certificates_are_compared_and_nothing_is_overwritten(dobc):
    code, out, _ = dobc("report", "A", "B/certificate.json", "--json")
    document = json.loads(out)
    assert code == 0
    assert document == {
        "problems": ["chain", "chain"],
        "verdicts": ["proved", "refuted"],
        "failures": [[], []],
        "files": ["chain-comparison/comparison.html", "chain-comparison/comparison.md"],
    }
    page = Path("chain-comparison/comparison.html").read_text("utf-8")
    assert "A is proved, B is refuted." in page
    assert "pinning.gains.3" in page
    code, _, err = dobc("report", "A", "B")
    assert code == 2
    assert "exists already" in err
    assert dobc("report", "A", "B", "--force")[0] == 0
    assert dobc("report", "B", "A", "--out", "other")[1].startswith("A is refuted, B is proved.")


@pytest.mark.slow
def test_the_report_of_one_certificate_is_written_beside_it(dobc):
    assert dobc("report", "A")[0] == 0
    names = {"certificate.json", "problem.json", "report.html", "report.md"}
    assert {path.name for path in Path("A").iterdir()} >= names
    first = Path("A/report.html").read_bytes()
    assert dobc("report", "A", "--out", "again")[0] == 0
    assert Path("again/report.html").read_bytes() == first
    assert dobc("report", "A", "--out", "again")[0] == 2


def changed(path: str, **values) -> None:
    """Edit a certificate by hand."""
    document = json.loads(Path(path).read_text("utf-8"))
    Path(path).write_text(json.dumps(document | values), encoding="utf-8")


def test_a_verdict_is_verified_before_it_is_repeated(dobc):
    """Somebody has written another rate into the certificate: the report names what fails, and
    repeats nothing."""
    changed(
        "A/certificate.json",
        rate=100.0,
        reason="All agents reach the target, at a rate of at least 100 1/s.",
    )
    code, out, _ = dobc("report", "A")
    assert code == 1
    assert (
        out.splitlines()[0]
        == "The certificate says proved and is not confirmed: 1 claim does not hold for this "
        "problem."
    )
    assert "NOT confirmed: rate, factor, covered_by" in out
    for name in ("report.html", "report.md"):
        page = Path("A", name).read_text("utf-8")
        assert "not confirmed" in page.lower()
        assert "exp(" not in page
        assert "100 1/s" not in page
    code, out, _ = dobc("report", "A", "--out", "again", "--json")
    assert code == 1
    assert json.loads(out)["verdicts"] == [None]
    assert len(json.loads(out)["failures"][0]) == 1
    code, out, _ = dobc("report", "B", "A")
    assert code == 1
    assert out.startswith(
        "A holds: refuted. B says proved and is not confirmed: 1 claim does not hold"
    )
    assert (
        "100"
        not in Path("chain-comparison/comparison.md").read_text("utf-8").partition("SHA-256")[0]
    )


def test_a_sentence_that_was_edited_is_not_repeated(dobc):
    """Sentences are not judged by `verify`; that of the verdict is made again from the claims."""
    changed("A/certificate.json", reason="All agents reach the target within a second.")
    assert dobc("report", "A", "B")[0] == 0
    page = Path("chain-comparison/comparison.md").read_text("utf-8")
    assert "within a second" not in page
    assert "Both" in page or "A is proved" in page


def test_without_its_problem_a_verdict_would_be_repeated_unverified(dobc):
    Path("A/problem.json").unlink()
    code, _, err = dobc("report", "A")
    assert code == 2
    assert "can only be repeated unverified, proved, and no report is written" in err
    assert "--problem FILE" in err
    assert not Path("A/report.html").exists()


def test_a_certificate_of_another_problem_is_refused(dobc):
    Path("A/problem.json").write_bytes(Path("B/problem.json").read_bytes())
    code, out, _ = dobc("report", "A", "B", "--json")
    assert code == 2
    assert "another problem" in json.loads(out)["error"]["message"]
    assert dobc("report", "A", "B", "--problem", "a.toml", "--problem", "b.toml")[0] == 0
    assert dobc("report", "A", "B", "--problem", "a.toml", "--force")[0] == 2


def test_what_is_no_certificate_leaves_with_2_and_writes_nothing(dobc):
    Path("A/certificate.json").write_text("{}", encoding="utf-8")
    assert dobc("report", "A", "B")[0] == 2
    assert dobc("report", "nowhere")[0] == 2
    assert dobc("report", "A", "B", "A")[0] == 2
    assert not Path("chain-comparison").exists()


def test_a_pdf_is_refused_before_anything_is_computed(dobc, monkeypatch):
    Path("there.pdf").write_bytes(b"mine")
    monkeypatch.setitem(sys.modules, "typst", None)
    for name, words in (
        ("there.pdf", "--force"),
        ("new.txt", "must name a .pdf file"),
        ("new.pdf", "dobc_design[pdf]"),
    ):
        code, _, err = dobc("report", "A", "--pdf", name)
        assert (code, words in err) == (2, True)
    assert Path("there.pdf").read_bytes() == b"mine"
    assert not Path("A/report.html").exists()


@pytest.mark.slow
def test_a_pdf_is_written_and_replaced_with_force_only(dobc):
    pytest.importorskip("typst", reason="needs the extra `pdf`: pip install 'dobc_design[pdf]'")
    Path("there.pdf").write_bytes(b"mine")
    code, out, _ = dobc("report", "A", "--pdf", "there.pdf", "--force", "--json")
    assert code == 0
    assert json.loads(out)["files"] == ["A/report.html", "A/report.md", "there.pdf"]
    assert Path("there.pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.slow
def test_two_certificates_in_one_pdf(dobc):
    pytest.importorskip("typst", reason="needs the extra `pdf`: pip install 'dobc_design[pdf]'")
    code, out, _ = dobc("report", "A", "B", "--pdf", "both.pdf", "--json")
    assert code == 0
    assert json.loads(out)["files"][-1] == "both.pdf"
    assert not Path("chain-comparison/comparison.pdf").exists()
    assert Path("both.pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.slow
def test_latex_fragments_go_to_a_folder_of_their_own_and_replace_nothing(dobc):
    code, out, _ = dobc("report", "A", "--out", "page", "--latex", "tex", "--json")
    names = {path.name for path in Path("tex").iterdir()}
    assert code == 0
    assert {"main.tex", "checks.tex", "matrices.tex", "references.bib"} <= names
    assert {f"tex/{name}" for name in names} <= set(json.loads(out)["files"])
    code, _, err = dobc("report", "A", "--out", "page2", "--latex", "tex")
    assert code == 2
    assert "exists already" in err and "--force" in err
    assert not Path("page2").exists()
    code, _, err = dobc("report", "A", "B", "--lmi")
    assert code == 2
    assert "--lmi" in err
    code, _, err = dobc("report", "A", "B", "--latex", "tex2")
    assert code == 2
    assert "of one certificate" in err
    assert dobc("report", "A", "--out", "page3", "--latex", "a.toml")[0] == 2


@pytest.mark.slow
def test_the_commands_in_a_report_make_and_check_the_same_certificate(dobc, monkeypatch):
    assert dobc("report", "A")[0] == 0
    commands = dict.fromkeys(
        re.findall(r"^(dobc .*)$", Path("A/report.md").read_text("utf-8"), re.MULTILINE)
    )
    assert len(commands) == 2
    monkeypatch.chdir("A")
    for command in commands:
        assert dobc(*command.split()[1:])[0] == 0, command
    assert Path("again/certificate.json").read_bytes() == Path("certificate.json").read_bytes()
