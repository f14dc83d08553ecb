"""`dobc new`, `dobc doctor`, `dobc explain`, completion: what a newcomer meets first."""

import json
import os
import re
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest

from dobc_design import Verdict, certify, load_problem, verify
from dobc_design.cli.doctor import Item, examine, install_command
from dobc_design.cli.output import ids, problem_names
from dobc_design.problem.schema import json_schema


@pytest.fixture
def dobc(command_line):
    """Run the command line in an empty folder: exit code, standard output, standard error."""
    return command_line


def test_new_writes_a_problem_a_notebook_a_test_and_the_schema(dobc):
    code, out, _ = dobc("new", "my-swarm")
    assert code == 0
    names = sorted(path.name for path in Path("my-swarm").iterdir())
    assert names == ["my-swarm.ipynb", "my-swarm.toml", "problem.schema.json", "test_my_swarm.py"]
    assert "next:  cd my-swarm\n       dobc check my-swarm.toml" in out
    assert load_problem("my-swarm/my-swarm.toml").name == "my-swarm"
    assert json.loads(Path("my-swarm/problem.schema.json").read_text("utf-8")) == json_schema()
    assert (
        Path("my-swarm/my-swarm.toml")
        .read_text("utf-8")
        .startswith("#:schema ./problem.schema.json\n")
    )


@pytest.mark.slow
def test_the_starter_problem_is_proved_from_its_own_starts_and_refuted_without_its_pin(dobc):
    dobc("new", "my-swarm")
    problem = load_problem("my-swarm/my-swarm.toml")
    certificate = certify(problem)
    assert certificate.verdict is Verdict.PROVED
    assert certificate.covered_by == "max-separable"
    assert verify(certificate, problem).holds
    text = (
        Path("my-swarm/my-swarm.toml")
        .read_text("utf-8")
        .replace("gains = { 1 = 2.0 }", "gains = { 1 = 0 }")
    )
    Path("unpinned.toml").write_text(text, encoding="utf-8")
    assert certify("unpinned.toml").verdict is Verdict.REFUTED


def test_new_overwrites_nothing(dobc):
    assert dobc("new", "swarm")[0] == 0
    before = {path: path.read_bytes() for path in Path("swarm").iterdir()}
    code, out, _ = dobc("new", "swarm", "--json")
    assert code == 2
    assert json.loads(out)["error"]["key"] == "NAME"
    assert "exists already; nothing is overwritten" in json.loads(out)["error"]["message"]
    assert {path: path.read_bytes() for path in Path("swarm").iterdir()} == before
    assert dobc("new", "swarm", "--out", "elsewhere")[0] == 0
    Path("file").write_text("x", encoding="utf-8")
    assert dobc("new", "swarm", "--out", "file")[0] == 2


@pytest.mark.parametrize(
    "name", ["", "1", "a b", "../a", "a/b", "a.b", "ä", "-a", "a" * 61, "a;rm"]
)
def test_a_name_that_cannot_name_files_is_refused(dobc, name):
    code, _, err = dobc("new", "--", name)
    assert code == 2
    assert "NAME must be" in err
    assert list(Path().iterdir()) == []


def test_new_from_arcs_makes_a_problem_of_them(dobc):
    Path("ring.csv").write_text("a,b\nb,c\nc,a\n", encoding="utf-8")
    code, _, err = dobc("new", "ring", "--from", "ring.csv")
    assert (code, list(Path().iterdir())) == (2, [Path("ring.csv")]), err
    code, out, err = dobc("new", "ring", "--from", "ring.csv", "--arrow", "listens_to", "--json")
    assert code == 0, err
    assert json.loads(out)["name"] == "ring"
    problem = load_problem("ring/ring.toml")
    assert problem.name == "ring"
    assert sorted(problem.network.labels) == ["a", "b", "c"]
    assert sum(len(arcs) for arcs in problem.network.modes.values()) == 3
    assert dobc("new", "other", "--arrow", "listens_to")[0] == 2


def test_new_from_arcs_says_first_what_was_read_and_adds_parallel_arcs_where_asked(dobc):
    Path("ring.csv").write_text("a,b\nb,a\na,b\na,a\n", encoding="utf-8")
    code, _, err = dobc(
        "new", "ring", "--from", "ring.csv", "--arrow", "listens_to", "--drop-loops"
    )
    assert code == 2 and "--merge sum" in err
    code, out, _ = dobc(
        "new",
        "ring",
        "--from",
        "ring.csv",
        "--arrow",
        "listens_to",
        "--drop-loops",
        "--merge",
        "sum",
    )
    assert code == 0
    assert out.splitlines()[0] == "read ring.csv: 2 agents, 2 arcs, labels a, b"
    assert sorted(load_problem("ring/ring.toml").network.modes["G"]) == [(0, 1, 2), (1, 0, 1)]
    code, _, err = dobc("new", "other", "--merge", "sum")
    assert code == 2 and "--merge says how the arcs of --from are read" in err


def test_new_asks_what_negative_weights_mean(dobc):
    Path("pair.csv").write_text("a,b,1\nb,a,-1\n", encoding="utf-8")
    read = ("new", "pair", "--from", "pair.csv", "--arrow", "listens_to")
    code, _, err = dobc(*read)
    assert code == 2 and "dobc new: --negative" in err
    assert dobc(*read, "--negative", "opposes")[0] == 0
    assert load_problem("pair/pair.toml").signs is not None
    code, _, err = dobc("new", "other", "--negative", "repels")
    assert code == 2 and "--negative says how the arcs of --from are read" in err


@pytest.mark.slow
def test_the_notebook_and_the_test_of_a_new_project_run(dobc, tmp_path):
    dobc("new", "my-swarm")
    environment = {**os.environ, "JUPYTER_PLATFORM_DIRS": "1"}
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--nbmake"]
    how = {"cwd": tmp_path / "my-swarm", "env": environment, "timeout": 300}
    done = subprocess.run(command, capture_output=True, text=True, check=False, **how)
    assert done.returncode == 0, done.stdout[-2000:]
    assert "3 passed" in done.stdout


WORKS = Item(item="paper-fixed", group="core", detail="proved, re-checked", ok=True)


@pytest.mark.slow
def test_doctor_lists_what_the_package_asks_for_and_leaves_with_0(dobc):
    code, out, _ = dobc("doctor", "--json")
    document = json.loads(out)
    assert code == 0
    assert document["ok"] is True
    items = {row["item"]: row for row in document["items"]}
    for text in metadata.requires("dobc_design"):
        name = re.match(r"[A-Za-z0-9-]+", text)[0]
        assert items[name]["group"] == (text.partition("extra == ")[2].strip("\"'") or "core")
    assert items["numpy"]["detail"] == metadata.version("numpy")
    assert items["paper-fixed"] == WORKS._asdict()


def test_doctor_says_what_is_missing_and_the_command_that_installs_it(dobc, monkeypatch):
    real = metadata.version

    def version(name: str) -> str:
        if name == "typst":
            raise metadata.PackageNotFoundError(name)
        return "2.3.9" if name == "numpy" else real(name)

    monkeypatch.setattr(metadata, "version", version)
    monkeypatch.setattr("dobc_design.cli.doctor._main_path", lambda: WORKS)
    code, out, _ = dobc("doctor")
    assert code == 0
    assert "absent   typst" in out
    assert re.search(r"MISSING  numpy +2\.3\.9, needs .*>=2\.4", out)
    wanted = next(
        text.partition(";")[0].strip()
        for text in metadata.requires("dobc_design")
        if "typst" in text
    )
    assert f"To install the extra pdf:\n  {install_command([wanted])}" in out
    assert "1 of the things that are needed are missing or broken." in out
    assert json.loads(dobc("doctor", "--json")[1])["ok"] is False


def test_doctor_without_programs_names_their_packages(monkeypatch):
    monkeypatch.setattr(
        "shutil.which", lambda name: "/usr/bin/apt-get" if name == "apt-get" else None
    )
    monkeypatch.setattr("dobc_design.cli.doctor._main_path", lambda: WORKS)
    found = {each.item: each for each in examine() if each.group == "programs"}
    wanted = {"gcc": "gcc", "chromium": "chromium", "csdp": "coinor-csdp"}
    wanted["coqc"] = "coq libcoq-coquelicot libcoq-interval"
    assert {
        name: each.install.removeprefix("sudo apt-get install ") for name, each in found.items()
    } == wanted


def test_completion_offers_problems_files_and_conditions(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text("", encoding="utf-8")
    (tmp_path / "mine.txt").write_text("", encoding="utf-8")
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub/deep.json").write_text("", encoding="utf-8")
    assert problem_names("paper-f") == ["paper-fixed"]
    assert problem_names("m") == ["microgrid-ieee14", "mine.toml"]
    assert problem_names("su") == ["sub/"]
    assert problem_names("sub/") == ["sub/deep.json"]
    assert problem_names("nowhere/x") == []
    assert ids("theorem1") == ["theorem1", "theorem1-printed", "theorem1-weighted"]


def shell(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    known = {**os.environ, "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "", **environment}
    command = [sys.executable, "-m", "dobc_design", *arguments]
    return subprocess.run(
        command, capture_output=True, text=True, check=False, timeout=120, env=known
    )


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="bash")
def test_bash_gets_a_script_and_then_its_answers(tmp_path, monkeypatch):
    """In an empty folder: files of the present one are offered, too."""
    monkeypatch.chdir(tmp_path)
    command = f"{sys.executable} -m dobc_design --show-completion; true"
    script = subprocess.run(
        ["bash", "-c", command], capture_output=True, text=True, check=False, timeout=120
    )
    assert "complete -o default -F _dobc_completion dobc" in script.stdout
    assert script.stderr == ""
    done = shell(_DOBC_COMPLETE="complete_bash", COMP_WORDS="dobc certify paper-", COMP_CWORD="2")
    assert done.returncode == 0
    assert done.stdout.split() == ["paper-fixed", "paper-switching"]
    done = shell(_DOBC_COMPLETE="complete_bash", COMP_WORDS="dobc expl", COMP_CWORD="1")
    assert done.returncode == 0
    assert done.stdout.split() == ["explain"]
