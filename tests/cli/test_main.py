"""The command line: exit codes, one JSON document, files in their place, and words that can be
read.

Most tests call ``dobc_design.cli.main.main`` in this process; the last ones start real ones.
"""

import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
import tomlkit
from bad_files import BAD_FILES, listing, write_case
from certified import certify_once
from problem_texts import CHAIN
from slips import TYPED
from typer.main import get_command

from dobc_design import __version__
from dobc_design.cli.main import app, main
from dobc_design.cli.output import EXIT
from dobc_design.conditions.kinds import KINDS
from dobc_design.errors import SolverError, SpecError
from dobc_design.problem.canonical import canonical_bytes
from dobc_design.problem.load import builtin_names, load_problem


@pytest.fixture
def dobc(command_line, monkeypatch):
    """Run the command line in an empty folder, without a width of the terminal from outside."""
    monkeypatch.setattr("dobc_design.certification.certify.certify", certify_once)
    monkeypatch.delenv("COLUMNS", raising=False)
    monkeypatch.delenv("DOBC_TRACEBACK", raising=False)
    return command_line


def write(text: str, name: str = "problem.toml") -> Path:
    path = Path(name)
    path.write_text(text, encoding="utf-8")
    return path


def checks(ran: Any) -> dict[str, dict[str, Any]]:
    """The checks of ``certify --json`` by id (of several modes the last)."""
    return {check["id"]: check for check in ran.json["checks"]}


def test_certify_of_a_proved_problem_leaves_with_0_and_writes_its_files(dobc):
    ran = dobc("certify", "paper-fixed", "--no-report", "--json")
    assert ran.code == 0
    assert ran.err == ""
    document = ran.json
    keys = {
        "verdict",
        "rate",
        "covered_by",
        "problem",
        "problem_sha256",
        "checks",
        "certificate",
        "report",
    }
    assert set(document) >= keys
    assert document["verdict"] == "proved"
    assert document["covered_by"] == "max-separable"
    assert document["problem"] == "paper-fixed"
    assert document["report"] is None
    assert document["rate"] > 0
    folder = "paper-fixed-certificate"
    assert listing(Path()) == [folder, f"{folder}/certificate.json", f"{folder}/problem.json"]
    assert Path(document["certificate"]) == Path("paper-fixed-certificate/certificate.json")
    assert Path("paper-fixed-certificate/problem.json").read_bytes() == canonical_bytes(
        load_problem("paper-fixed")
    )
    for check in document["checks"]:
        assert set(check) >= {"id", "verdict", "domain", "margin", "rate", "reason"}
        assert check["id"] in KINDS


def test_the_same_problem_gives_the_same_files_and_replaces_the_old_ones(command_line):
    call = ("certify", write(CHAIN), "--no-report", "--out", "here")
    first = command_line(*call)
    files = {name: Path("here", name).read_bytes() for name in ("certificate.json", "problem.json")}
    Path("here/certificate.json").write_text("old", encoding="utf-8")
    assert command_line(*call) == first
    assert {name: Path("here", name).read_bytes() for name in files} == files


JUDGED = {
    "lemma1": "proved",
    "theorem1-printed": "refuted",
    "theorem2": "undecided",
    "theorem1": "proved",
}


@pytest.mark.parametrize(("theorem", "verdict"), JUDGED.items())
def test_one_theorem_alone_can_be_judged(dobc, theorem, verdict):
    code = EXIT[verdict]
    ran = dobc("certify", "paper-fixed", "--no-report", "--json", "--theorem", theorem)
    assert ran.code == code
    assert ran.json["verdict"] == verdict
    assert ran.json["theorem"] == theorem
    assert {check["id"] for check in ran.json["checks"]} <= {theorem}
    assert ran.json["covered_by"] == (theorem if verdict == "proved" else None)
    words = dobc("certify", "paper-fixed", "--no-report", "--theorem", theorem)
    assert words.code == code
    assert f"\npaper-fixed: {verdict.upper()}. " in words.out
    if theorem == "theorem2":
        assert ran.json["reason"].startswith("does not apply: theorem2 is not among the conditions")


def test_a_report_is_written_unless_it_is_not_wanted(dobc, monkeypatch):
    def render_report(certificate, **how):
        return {"report.html": b"<p>report</p>"}

    monkeypatch.setattr("dobc_design.report.write.render_report", render_report)
    ran = dobc("certify", "paper-fixed", "--json")
    assert Path(ran.json["report"]).read_text(encoding="utf-8") == "<p>report</p>"
    assert "report       " in dobc("certify", "paper-fixed").out


NAMES = r"../../x a/b .. . ... .hidden -rf /etc/x a\b C:x ~ $HOME ' * [red]x[/red]"


@pytest.mark.parametrize("name", [*NAMES.split(), "x y", "東京" * 50, "x" * 100, "e\u0301" * 50])
def test_no_name_of_a_problem_leads_out_of_the_current_folder(dobc, tmp_path, name):
    inner = tmp_path / "in" / "here"
    inner.mkdir(parents=True)
    os.chdir(inner)
    before = listing(tmp_path)
    text = tomlkit.dumps(
        {"name": name} | {k: v for k, v in tomllib.loads(CHAIN).items() if k != "name"}
    )
    ran = dobc("certify", write(text), "--no-report", "--json")
    assert ran.code == 0
    made = sorted(set(listing(tmp_path)) - set(before) - {"in/here/problem.toml"})
    folder = Path(made[0])
    assert made == [str(folder), str(folder / "certificate.json"), str(folder / "problem.json")]
    assert folder.parent == Path("in/here")
    assert folder.name.endswith("-certificate")
    assert folder.name[0] not in ".-_"
    assert len(folder.name.encode("utf-8")) <= 255
    assert ran.json["problem"] == name


PARTS = 10  # of the bad files, so that the workers share them


@pytest.mark.parametrize("each", [9, pytest.param(1, marks=pytest.mark.slow)])
@pytest.mark.parametrize("part", range(PARTS))
def test_a_bad_file_leaves_with_2_one_json_error_and_nothing_written(dobc, tmp_path, part, each):
    # Reading is tested with all of them, the command with some; slow tests run it on all.
    for case in BAD_FILES[part::PARTS][::each]:
        if callable(case.content) and not os.environ.get("CI"):
            continue  # megabytes
        folder = tmp_path / case.id
        folder.mkdir()
        os.chdir(folder)
        path = write_case(case, folder)
        before = listing(folder)
        ran = dobc("certify", path, "--json")
        assert case.id == case.id
        assert ran.code == 2
        assert ran.err == ""
        error = ran.json["error"]
        assert set(error) >= {"kind", "key", "message", "cure"}
        assert error["kind"] in ("spec", "shape", "expression")
        keys = [each["key"] for each in error.get("all", [error])]
        assert not case.expect_key or case.expect_key in keys, case.id
        assert listing(folder) == before


@pytest.mark.parametrize("case", BAD_FILES[::40], ids=lambda case: case.id)
def test_a_bad_file_is_told_on_standard_error_in_words(dobc, tmp_path, case):
    path = write_case(case, tmp_path)
    ran = dobc("check", path)
    assert ran.code == 2
    assert ran.out == ""
    assert ran.err[:7] == "error: "
    assert ran.err.replace("\n", "").isprintable()


def test_all_mistakes_are_counted_and_a_wrong_option_points_to_the_help(dobc):
    ran = dobc("check", write(CHAIN.replace("{ 3 = 5 }", "{ 4 = 5, 3 = -1 }")))
    assert ran.code == 2
    assert ran.err.count("error: ") == 2
    assert ran.err.endswith("2 errors; nothing was written.\n")
    assert "See `dobc certify --help`." in dobc("certify", "--wrong").err
    assert "See `dobc --help`." in dobc("frobnicate").err


def test_check_writes_the_canonical_problem_and_overwrites_it_only_when_told(dobc):
    ran = dobc("check", "paper-fixed", "--canonical", "out.json", "--json")
    data = Path("out.json").read_bytes()
    assert ran.code == 0
    assert ran.json["canonical"] == "out.json"
    assert ran.json["valid"] is True
    assert data == canonical_bytes(load_problem("paper-fixed"))
    again = dobc("check", "uav-swarm", "--canonical", "out.json", "--json")
    assert again.code == 2
    assert again.json["error"]["key"] == "--canonical"
    assert "--force" in again.json["error"]["cure"]
    assert Path("out.json").read_bytes() == data
    assert dobc("check", "uav-swarm", "--canonical", "out.json", "--force").code == 0
    assert Path("out.json").read_bytes() == canonical_bytes(load_problem("uav-swarm"))
    assert dobc("check", "out.json", "--json").json["name"] == "uav-swarm"


def test_check_cannot_write_onto_a_folder_or_into_none_or_without_a_problem(dobc):
    assert dobc("check", write(CHAIN.replace("y", "y + 1")), "--canonical", "out.json").code == 2
    assert listing(Path()) == ["problem.toml"]
    Path("folder").mkdir()
    for force in ((), ("--force",)):
        ran = dobc("check", "paper-fixed", "--canonical", "folder", "--json", *force)
        assert ran.code == 2
        assert ran.json["error"]["message"] == "'folder' is a folder."
    ran = dobc("check", "paper-fixed", "--canonical", "none/out.json", "--json")
    assert ran.code == 4
    assert ran.json["error"]["key"] == "--canonical"


@pytest.fixture
def certified(dobc):
    assert dobc("certify", "paper-fixed", "--no-report", "--out", "proof").code == 0
    return Path("proof")


def test_a_certificate_verifies_against_every_form_of_its_problem_that_is_there(dobc, certified):
    assert (
        dobc("verify", "nowhere.json", "--problem", "paper-fixed", "--json").json["error"]["key"]
        == "certificate"
    )
    ran = dobc("verify", certified, "--problem", "nowhere.toml", "--json")
    assert ran.code == 2
    assert ran.json["error"]["key"] == "nowhere.toml"
    for certificate, problem in (
        ("proof", "proof/problem.json"),
        ("proof/certificate.json", "paper-fixed"),
    ):
        ran = dobc("verify", certificate, "--problem", problem, "--json")
        assert ran.code == 0
        assert ran.json["holds"] is True
        assert ran.json["verdict"] == "proved"
        assert ran.json["failures"] == []
    assert dobc("verify", "proof", "--problem", "paper-fixed").out.startswith(
        "every claim holds; verdict proved."
    )


@pytest.mark.parametrize(
    ("old", "new"),
    [('"verdict": "proved"', '"verdict": "refuted"'), ('"16/5"', '"17/5"'), ('"-9/8"', '"-9/9"')],
)
def test_a_certificate_that_was_changed_or_is_of_another_problem_leaves_with_1(
    dobc, certified, old, new
):
    ran = dobc("verify", certified, "--problem", "uav-swarm", "--json")
    (failure,) = ran.json["failures"]
    assert ran.code == 1
    assert "another problem, 'paper-fixed', and not about 'uav-swarm'" in failure
    path = certified / "certificate.json"
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    ran = dobc("verify", path, "--problem", "paper-fixed", "--json")
    assert (ran.code, ran.json["holds"], ran.json["failures"] != []) == (1, False, True)


def test_problems_and_conditions_are_listed_and_explained(dobc):
    assert [row["name"] for row in dobc("problems", "--json").json["problems"]] == list(
        builtin_names()
    )
    assert [line.split()[0] for line in dobc("problems").out.splitlines()] == list(builtin_names())
    assert [line.split()[0] for line in dobc("explain").out.splitlines()] == list(KINDS)
    for id, kind in KINDS.items():
        words = dobc("explain", id).out
        for part in (kind.title, "Proved: ", "Refuted: "):
            assert part in words
    assert dobc("explain", "hurwitz", "--json").json["title"] == KINDS["hurwitz"].title


def test_an_unknown_condition_is_refused_with_those_that_are_known(dobc):
    assert "Did you mean theorem2?" in dobc("explain", "theorm2").err
    ran = dobc("explain", "theorem3", "--json")
    assert ran.code == 2
    assert ran.json["error"]["key"] == "id"
    assert "theorem1" in ran.json["error"]["cure"]
    ran = dobc("certify", "paper-fixed", "--theorem", "theorem3", "--json")
    assert ran.code == 2
    assert ran.json["error"]["key"] == "--theorem"
    assert listing(Path()) == []


def test_schema_version_and_help_are_printed(dobc):
    assert dobc("schema") == dobc("schema", "--json")
    assert dobc("schema").json["properties"]["network"]
    assert dobc("--version").out == f"dobc {__version__}\n"
    ran = dobc("--help")
    assert ran.code == 0
    for command in ("certify", "verify", "check", "explain", "doctor"):
        assert command in ran.out


@pytest.mark.parametrize("command", sorted(get_command(app).commands))
def test_help_names_values_in_words_and_not_by_types_of_python(dobc, command):
    """FILE and NUMBER, not <path>, <float> or <list[Path]>."""
    told = dobc(command, "--help").out
    assert told.startswith(f"Usage: dobc {command} [OPTIONS]")
    assert not re.search(r"<\w|[{}]|list\[", told)
    values = re.findall(r"^  --[a-z-]+ ([A-Za-z@]+)", told, re.MULTILINE)
    assert [value for value in values if not value.isupper()] == ["sum"] * (command == "new")


def test_help_says_what_is_a_file_and_what_a_number(dobc):
    assert "Usage: dobc sweep [OPTIONS] FILE KEY=VALUES...\n" in dobc("sweep", "--help").out
    assert "Usage: dobc report [OPTIONS] CERT [CERT]\n" in dobc("report", "--help").out
    told = dobc("simulate", "--help").out
    for text in ("--t-final NUMBER", "--start FILE", "--out FOLDER"):
        assert text in told


@pytest.mark.parametrize(("line", "key", "cure"), TYPED)
def test_a_number_with_its_unit_is_answered_by_the_number(dobc, line, key, cure):
    """A slip of the command line, told as one of a problem file is."""
    ran = dobc(*line.split(), "--json")
    assert ran.code == 2
    assert ran.json["error"]["key"] == key
    assert ran.json["error"]["message"].startswith(f"{key} must be a number such as 3.2")
    assert ran.json["error"]["cure"].startswith(cure)
    assert listing(Path()) == []


def test_a_fraction_of_runs_is_refused_as_no_whole_number(dobc):
    assert "valid integer" in dobc("simulate", "paper-fixed", "--runs", "2.5").err


GOOD = (
    "problems",
    "check paper-fixed",
    "certify paper-fixed --no-report",
    "schema",
    "explain lemma1",
    "explain",
)
MISTAKES = (
    "; frobnicate; certify; certify paper-fixed more; certify paper-fixed --wrong; certify "
    "paper-fixed --out --all;"
    " check paper-fixed --canonical --force; certify paper-fixed --theorem none; certify "
    "none.toml; certify .;"
    " check none.toml; verify; verify none.json; verify none.json --problem paper-fixed; "
    "explain none; problems more;"
    " schema more; doctor more"
)


def test_json_puts_one_document_on_standard_output_and_nothing_else(dobc):
    for line in GOOD:
        ran = dobc(*line.split(), "--json")
        assert (ran.code, ran.err, ran.out[-2:], "error" in ran.json) == (0, "", "}\n", False), line


@pytest.mark.parametrize("line", MISTAKES.split("; "))
def test_a_mistake_is_one_document_or_a_line_on_standard_error(dobc, line):
    ran = dobc(*line.split(), "--json")
    words = dobc(*line.split())
    assert ran.code == 2
    assert ran.err == ""
    assert list(ran.json) == ["error"]
    assert set(ran.json["error"]) - {"all"} == {"kind", "key", "message", "cure"}
    assert ran.json["error"]["message"]
    assert words.code == 2
    assert words.out == ""
    assert words.err[:7] == "error: "


@pytest.mark.parametrize(
    ("error", "code", "kind", "message"),
    [
        (KeyboardInterrupt(), 130, "interrupted", "Interrupted"),
        (RuntimeError("a slip"), 4, "internal", "Internal error (RuntimeError: a slip)."),
        (RecursionError("deep"), 4, "internal", "RecursionError"),
        (MemoryError(), 4, "memory", "out of memory"),
        (OSError(5, "Input/output error", "somewhere"), 4, "io", "Input/output error (somewhere)."),
        (
            SolverError("the solver broke down.", cure="Rescale."),
            4,
            "solver",
            "the solver broke down.",
        ),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, BaseException) else None,
)
def test_a_failure_of_the_machine_is_never_an_answer(
    dobc, monkeypatch, capsys, error, code, kind, message
):
    """Contract: an uncaught exception is never 1."""

    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr("dobc_design.certification.certify.certify", fail)
    ran = dobc("certify", "paper-fixed", "--json")
    assert ran.code == code
    assert ran.err == ""
    assert ran.json["error"]["kind"] == kind
    assert message in ran.json["error"]["message"]
    words = dobc("certify", "paper-fixed")
    assert words.code == code
    assert words.out == ""
    assert message in words.err
    assert listing(Path()) == []
    if kind == "internal":
        monkeypatch.setenv("DOBC_TRACEBACK", "1")
        with pytest.raises(SystemExit):
            main(["certify", "paper-fixed"])
        assert "Traceback" in capsys.readouterr().err


MARKUP = CHAIN.replace("agents = 3", 'agents = ["[red]x[/red]", "[/]", ":smile:"]').replace(
    "G = [[1, 2], [2, 3]]", '"[bold]G[/bold]" = [["[red]x[/red]", "[/]"], ["[/]", ":smile:"]]'
)


def test_names_with_markup_come_out_as_they_are(dobc):
    text = MARKUP.replace('name = "chain"', 'name = "[link=x]name"').replace(
        "gains = { 3 = 5 }", "gains = {}"
    )
    path = write('notes = ["[red]note[/red]"]\n' + text)
    for arguments in (("certify", path, "--no-report"), ("check", path)):
        ran = dobc(*arguments)
        for literal in (
            "[red]x[/red]",
            "[/]",
            ":smile:",
            "[bold]G[/bold]",
            "[link=x]name",
            "[red]note[/red]",
        ):
            assert literal in ran.out
        assert "\x1b" not in ran.out


ESCAPES = {"agents = 3": r'agents = ["\u001b[31mred", 2, 3]', '"chain"': r'"\u001b]0;title\u0007"'}
ESCAPES |= {"G =": r'"\u001b[2J" =', "3 = 5": r'"\u001b[31m" = 5', "[pinning]": '["\\u001b[31m"]'}


@pytest.mark.parametrize(("old", "new"), ESCAPES.items())
def test_escape_sequences_never_reach_the_terminal(dobc, old, new):
    path = write(CHAIN.replace(old, new))
    for arguments in (("check", path), ("check", path, "--json")):
        ran = dobc(*arguments)
        assert ran.code == 2
        assert "\x1b" not in ran.out + ran.err
        assert "\\x1b" in ran.out + ran.err


def test_piped_output_is_wide_and_a_narrow_terminal_has_the_reasons_below(dobc, monkeypatch):
    wide = dobc("certify", "paper-fixed", "--no-report").out.splitlines()
    rows = [line for line in wide if line.startswith("hurwitz")]
    assert len(rows) == 1
    assert "A - WC is Hurwitz (given W): the estimation error decays at least like exp(" in rows[0]
    assert any("from every start in the region" in line for line in wide[:5])
    monkeypatch.setenv("COLUMNS", "80")
    narrow = dobc("certify", "paper-fixed", "--no-report").out.splitlines()
    assert max(len(line) for line in narrow if not line.startswith("re-check")) <= 80
    place = narrow.index("hurwitz")
    assert narrow[place + 1].startswith("  A - WC is Hurwitz (given W)")
    monkeypatch.setenv("COLUMNS", "200")
    wider = dobc("certify", "paper-fixed", "--no-report").out.splitlines()
    assert any("hurwitz" in line and "exp(" in line for line in wider)


def test_the_line_to_check_again_can_be_pasted_into_a_shell(dobc):
    path = write(CHAIN, "my problem's.toml")
    out = dobc("certify", path, "--no-report", "--out", "a b").out
    assert (
        "re-check     dobc verify 'a b/certificate.json' --problem 'my problem'\"'\"'s.toml'" in out
    )


def start(*arguments: str, **options: Any) -> subprocess.CompletedProcess[str]:
    how = {"capture_output": "stdout" not in options, "encoding": "utf-8", "timeout": 120}
    return subprocess.run(
        [sys.executable, "-m", "dobc_design", *arguments], check=False, **how, **options
    )


@pytest.mark.slow
def test_a_real_process_certifies(tmp_path):
    (tmp_path / "problem.toml").write_text(CHAIN, encoding="utf-8")
    ran = start("certify", "problem.toml", "--no-report", "--json", cwd=tmp_path)
    assert ran.returncode == 0
    assert ran.stderr == ""
    assert json.loads(ran.stdout)["verdict"] == "proved"


def test_output_is_utf_8_whatever_the_system_says(tmp_path):
    path = tmp_path / "problem.toml"
    path.write_text(
        MARKUP.replace(":smile:", "東京").replace("{ 3 = 5 }", '{ "東京" = 5 }'), encoding="utf-8"
    )
    ran = start("check", str(path), cwd=tmp_path, env=os.environ | {"PYTHONIOENCODING": "ascii"})
    assert (ran.returncode, ran.stderr, "東京" in ran.stdout) == (0, "", True)


def test_export_writes_the_theorem_for_rocq_and_refuses_to_overwrite_it(dobc):
    """Contract: `export --rocq FILE` takes a certificate."""
    dobc("certify", "paper-fixed", "--no-report", "--out", "out")
    ran = dobc("export", "out", "--rocq", "theorem.v")
    assert ran.code == 0
    assert "coqc theorem.v" in ran.out
    assert "Theorem every_motion_converges" in Path("theorem.v").read_text("ascii")
    assert dobc("export", "out", "--rocq", "matrix.v", "--theorem").code == 0
    assert "Theorem theorem1" in Path("matrix.v").read_text("ascii")
    again = dobc("export", "out", "--rocq", "theorem.v", "--json")
    assert again.code == 2
    assert again.json["error"]["key"] == "--rocq"
    forced = dobc("export", "out/certificate.json", "--rocq", "theorem.v", "--force", "--json")
    assert forced.json == {"rocq": "theorem.v"}
    for wrong in (
        ["out", "--rocq", "t.v", "--problem", "clock-sync"],
        ["none", "--rocq", "t.v"],
        ["out"],
    ):
        assert dobc("export", *wrong).code == 2
    assert not Path("t.v").exists()


def test_verify_asks_coq_and_tells_what_is_missing(dobc, monkeypatch):
    """Without coqc: a mistake with the cure, and nothing is written."""
    dobc("certify", "paper-fixed", "--no-report", "--out", "out")
    monkeypatch.setenv("PATH", "")
    ran = dobc("verify", "out", "--problem", "paper-fixed", "--rocq", "--json")
    assert ran.code == 2
    assert ran.json["error"]["key"] == "--rocq"
    assert "libcoq-interval" in ran.json["error"]["cure"]
    assert sorted(path.name for path in Path("out").iterdir()) == [
        "certificate.json",
        "problem.json",
    ]


def test_a_cure_is_told_at_the_end_and_written_to_a_new_file(dobc):
    wrong = CHAIN.replace("{ 3 = 5 }", "{ 1 = 5 }")
    source = write("# kept\n" + wrong)
    ran = dobc("certify", source, "--no-report")
    assert ran.code == 1
    cure = ran.out[ran.out.index("What would cure it:") :]
    assert cure.startswith("What would cure it: Pin agent 3 as well, with k = ")
    assert "    [pinning]\n    gains = { 1 = 5, 3 = " in cure
    assert "--apply-fix" in cure
    ran = dobc("certify", source, "--no-report", "--apply-fix", "cured.toml")
    assert ran.code == 1
    assert ran.out.endswith("cured        cured.toml\ncertify it   dobc certify cured.toml\n")
    text = Path("cured.toml").read_text(encoding="utf-8")
    again = dobc("certify", source, "--no-report", "--json", "--apply-fix", "again.toml")
    assert again.json["applied"] == "again.toml"
    assert checks(again)["lemma1"]["fix"]["kind"] == "pinning"
    assert text.startswith("# kept\n")
    assert dobc("certify", "cured.toml", "--no-report").code == 0
    noted = write('notes = ["Agent 1 is pinned."]\n' + wrong, "noted.toml")
    ran = dobc("certify", noted, "--no-report", "--apply-fix", "other.toml")
    assert ran.out.endswith(
        "look at      its notes: they are unchanged and may describe the old problem\n"
    )
    assert "Agent 1 is pinned." in Path("other.toml").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("target", "words"),
    [
        ("new.json", "must name a .toml file"),
        ("there.toml", "exists already"),
        ("folder", "is a folder"),
    ],
)
def test_a_cure_that_cannot_be_written_is_one_clear_error_and_nothing_is_written(
    dobc, target, words
):
    source = write(CHAIN.replace("{ 3 = 5 }", "{ 1 = 5 }"))
    Path("there.toml").write_text("old", encoding="utf-8")
    Path("folder").mkdir()
    before = listing(Path())
    ran = dobc("certify", source, "--no-report", "--json", "--apply-fix", target)
    assert ran.code == 2
    assert ran.json["error"]["key"] == "--apply-fix"
    assert words in ran.json["error"]["message"]
    assert listing(Path()) == before
    assert Path("there.toml").read_text(encoding="utf-8") == "old"


def test_without_a_cure_apply_fix_shows_the_table_and_leaves_with_the_code_of_the_verdict(dobc):
    proved = dobc("certify", write(CHAIN), "--no-report", "--apply-fix", "new.toml")
    assert proved.code == 0
    assert "condition" in proved.out
    told = "cured        nothing was written: no check here has a known cure"
    assert told in proved.out
    kinks = CHAIN.replace("{ 3 = 5 }", "{ 1 = 5 }")
    source = write(re.sub(r"h = .*", 'h = "clip(y, -1, 1)"', kinks), "kinks.toml")
    ran = dobc("certify", source, "--no-report", "--apply-fix", "new.toml")
    plain = dobc("certify", source, "--no-report", "--json")
    assert ran.code == plain.code != 0
    assert told in ran.out
    document = dobc("certify", source, "--no-report", "--json", "--apply-fix", "new.toml")
    assert document.code == plain.code
    assert document.json["applied"] is None
    assert not Path("new.toml").exists()


def test_force_replaces_the_cured_file_and_a_json_problem_becomes_a_toml_one(dobc):
    source = write(CHAIN.replace("{ 3 = 5 }", "{ 1 = 5 }"))
    dobc("certify", source, "--no-report", "--out", "out")
    Path("cured.toml").write_text("old", encoding="utf-8")
    ran = dobc("certify", "out/problem.json", "--no-report", "--apply-fix", "cured.toml", "--force")
    assert ran.code == 1
    assert dobc("certify", "cured.toml", "--no-report").code == 0


def test_a_certificate_folder_of_another_problem_is_kept_unless_forced(dobc):
    chain = write(CHAIN)
    assert dobc("certify", chain, "--no-report", "--out", "c").code in (0, 1, 3)
    before = listing(Path("c"))
    other = dobc("certify", "paper-fixed", "--no-report", "--out", "c")
    assert other.code == 2
    assert "holds the certificate of another problem" in other.err
    assert dobc("region", "paper-fixed", "--out", "c").code == 2
    Path("c/problem.json").rename("c/elsewhere.json")
    assert (
        "certificate.json of an unknown problem"
        in dobc("certify", chain, "--no-report", "--out", "c").err
    )
    Path("c/elsewhere.json").rename("c/problem.json")
    assert listing(Path("c")) == before
    certificate = certify_once(load_problem("paper-fixed"))
    with pytest.raises(SpecError, match="force=True"):
        certificate.save("c")
    assert listing(Path("c")) == before
    assert dobc("certify", chain, "--no-report", "--out", "c").code in (0, 1, 3)
    assert dobc("certify", "paper-fixed", "--no-report", "--out", "c", "--force").code == 0


def test_a_certificate_of_another_version_is_never_replaced_without_a_word(dobc):
    """A certificate belongs to a problem by its hash: an edited file has another one."""
    source = write(CHAIN)
    first = dobc("certify", source, "--no-report", "--json")
    again = dobc("certify", source, "--no-report", "--json")
    assert first.json["replaced"] is again.json["replaced"] is None
    text = Path(source).read_text(encoding="utf-8")
    Path(source).write_text(text.replace("{ 3 = 5 }", "{ 3 = 6 }"), encoding="utf-8")
    ran = dobc("certify", source, "--no-report")
    assert ran.code == first.code
    words = "another problem, an earlier or later version of 'chain' (its hash differs)"
    assert f"replaced     the certificate of {words}" in ran.out
    forced = dobc("certify", "paper-fixed", "--no-report", "--out", "chain-certificate", "--force")
    assert "replaced     the certificate of another problem, 'chain'" in forced.out


@pytest.mark.parametrize(
    "content", [b"", b"{}", b"no json", b"\xff\xfe", b"[" * 50_000, b'{"format": "dobc-problem"}']
)
def test_what_is_no_certificate_leaves_with_2(dobc, content):
    Path("certificate.json").write_bytes(content)
    ran = dobc("verify", "certificate.json", "--problem", "paper-fixed", "--json")
    assert ran.code == 2
    assert ran.json["error"]["kind"] == "certificate"
    assert "cannot be read" in ran.json["error"]["message"]
