"""`dobc design`: a new problem file with the user's comments, exit codes of the contract, nothing
written in vain."""

import json
from pathlib import Path

import pytest

from dobc_design.errors import CertificateError
from dobc_design.problem.canonical import canonical_bytes
from dobc_design.synthesis import designs

STAR = """\
# Three followers and their leader.
name = "star"
notes = ["Made up."]

[network]
agents = ["lead", "a", "b", "c"]
arrow = "listens_to"
modes.G = [["a", "lead"], ["b", "lead"], ["c", "lead"]]   # who listens to whom

[coupling]
h = "y"                                # a spring

[pinning]
gains = { a = 77 }                     # of no use

[exosystem]
A = [[0, 0], [0, 0]]                   # the second state is never seen
C = [[1, 0]]

[observer]
W = [[1], [0]]                         # typed by hand
P = [[1, 0], [0, 1]]
"""

RING = """\
[network]
agents = 4
arrow = "listens_to"
modes.G = [[1, 2], [2, 3], [3, 4], [4, 1]]

[coupling]
h = "y"
"""

DESIGNED: dict[str, designs.Design] = {}


def design_once(problem, *, progress: object = None, design=designs.design, **options):
    """``design``, of the same problem and options once for all tests here."""
    key = f"{canonical_bytes(problem)} {sorted(options.items())}"
    if key not in DESIGNED:
        DESIGNED[key] = design(problem, **options)
    return DESIGNED[key]


@pytest.fixture
def dobc(command_line, tmp_path, monkeypatch):
    """Run the command line in an empty folder: exit code, standard output, standard error."""
    monkeypatch.setattr(designs, "design", design_once)
    (tmp_path / "star.toml").write_text(STAR, encoding="utf-8")
    return command_line


def test_a_design_writes_a_file_that_certify_proves_and_keeps_the_comments(dobc, tmp_path: Path):
    code, out, _ = dobc("design", "star.toml", "--out", "new.toml")
    assert code == 0
    for words in ("star: PROVED.", "Pinned: agent lead", "wrote        new.toml"):
        assert words in out
    text = (tmp_path / "new.toml").read_text("utf-8")
    assert text.startswith("# Three followers and their leader.")
    assert all(
        kept in text for kept in ("# who listens to whom", "# a spring", "set by dobc design")
    )
    for old in ("77", "P = "):
        assert old not in text
    assert dobc("certify", "new.toml", "--no-report")[0] == 0
    assert dobc("certify", "star.toml", "--no-report")[0] != 0


def test_without_out_the_file_goes_to_standard_output_and_the_words_to_standard_error(
    dobc, tmp_path: Path
):
    dobc("design", "star.toml", "--out", "star-design.toml")
    text = (tmp_path / "star-design.toml").read_text("utf-8")
    code, out, err = dobc("design", "star.toml")
    assert (code, out) == (0, text)
    assert "star: PROVED." in err and "Pinned: agent lead" in err
    assert dobc("design", "star.toml", "--quiet") == (0, text, "")
    code, out, err = dobc("design", "star.toml", "--keep-exosystem")
    assert (code, out) == (1, "")
    assert "    dobc design star.toml\n" in err and "Nothing was written." in err
    assert {path.name for path in tmp_path.iterdir()} == {"star.toml", "star-design.toml"}


def test_a_design_has_its_own_name_so_that_its_certificate_replaces_none(dobc):
    """The certificate of the file that was designed for stays as it is."""
    dobc("certify", "star.toml", "--no-report")
    Path("sub").mkdir()
    before = Path("star-certificate/certificate.json").read_bytes()
    for target, name in (("new.toml", "new"), ("sub/star.toml", "star-design")):
        out = dobc("design", "star.toml", "--out", target)[1]
        assert f"its name     {name}: its certificate does not replace that of star" in out
        out = dobc("certify", target, "--no-report")[1]
        assert f"certificate  {name}-certificate/certificate.json" in out
    assert Path("star-certificate/certificate.json").read_bytes() == before


def test_the_file_says_where_its_numbers_come_from(dobc):
    lines = dobc("design", "star.toml")[1].splitlines()
    (W,) = [line for line in lines if line.startswith("W = ")]
    (gains,) = [line for line in lines if line.startswith("gains = ")]
    assert "# set by dobc design: linear matrix inequalities, decay rate at least " in W
    assert "# set by dobc design: total gain " in gains
    assert "certified at " in gains and " 1/s by theorem1-weighted" in gains


def test_further_pins_are_a_table_and_gains_that_are_not_proved_are_named(dobc):
    """On a ring a second pin saves gain; on a star none does beside that of the leader."""
    err = dobc("design", "star.toml")[2]
    assert "Your own gains are not proved to do what the problem asks; this design is." in err
    assert "Price of further pins" not in err
    Path("ring.toml").write_text(RING, encoding="utf-8")
    code, _, err = dobc("design", "ring.toml", "--rate", "0.2", "--further", "1")
    assert code == 0
    table = err[err.index("Price of further pins") :].splitlines()
    assert table[1].split()[:3] == ["pins", "total", "gain"]
    assert [row.split()[0] for row in table[2:4]] == ["1", "2"]
    without = dobc("design", "ring.toml", "--rate", "0.2", "--further", "0")[2]
    assert "Price of further pins" not in without


def test_json_is_one_document_with_the_keys_of_the_contract(dobc, tmp_path: Path):
    code, out, _ = dobc("design", "star.toml", "--out", "new.toml", "--json")
    document = json.loads(out)
    assert code == 0
    assert set(document) >= {"verdict", "W", "P", "gains", "rate", "cost", "reason", "problem"}
    assert document["verdict"] == "proved"
    assert document["problem"] == "new.toml"
    assert list(document["gains"]) == ["lead"]
    assert document["rate"] > 0
    assert document["further"] == []
    assert json.loads(dobc("design", "star.toml", "--json")[1])["problem"] is None


def test_an_impossible_request_leaves_with_1_names_the_limit_and_the_nearest_request(
    dobc, tmp_path: Path
):
    code, out, _ = dobc("design", "star.toml", "--out", "new.toml", "--keep-exosystem")
    assert code == 1
    assert "star: REFUTED. No W exists" in out
    assert "The limit that fails: --keep-exosystem." in out
    assert "dobc design star.toml --out new.toml" in out
    assert not (tmp_path / "new.toml").exists()


@pytest.mark.slow
def test_the_nearest_request_can_be_typed_as_it_is_shown(dobc):
    code, out, _ = dobc(
        "design", "star.toml", "--out", "new.toml", "--allowed", "a,b", "--allowed", "c", "--json"
    )
    assert code == 1
    nearest = json.loads(out)["nearest"]
    assert nearest["verdict"] == "proved"
    out = dobc("design", "star.toml", "--out", "new.toml", "--allowed", "a,b,c")[1]
    command = next(line for line in out.splitlines() if line.startswith("    dobc "))
    assert dobc(*command.split()[1:])[0] == 0


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (("--out", "new.json"), "--out must name a .toml file"),
        (("--out", "new.toml", "--rate", "fast"), "rate"),
        (("--out", "new.toml", "--pins", "some"), "pins must be an integer"),
        (("--out", "new.toml", "--allowed", "nobody"), "there is no agent 'nobody'"),
        (("--out", "new.toml", "--digits", "0"), "digits must be"),
        (("--out", "--json"), "needs a value"),
        (("--further", "-1"), "further must be an integer from 0 to 20"),
    ],
)
def test_wrong_options_leave_with_2_and_write_nothing(dobc, tmp_path: Path, options, complaint):
    code, out, err = dobc("design", "star.toml", *options)
    assert code == 2
    assert complaint in (err or out)
    assert {path.name for path in tmp_path.iterdir()} == {"star.toml"}


def test_a_disk_that_refuses_leaves_with_4(dobc, monkeypatch):
    def refuse(path: Path, data: bytes) -> None:
        raise CertificateError("no room")

    monkeypatch.setattr("dobc_design.certificate.files.write_atomically", refuse)
    assert dobc("design", "star.toml", "--out", "new.toml")[0] == 4


@pytest.mark.parametrize(
    ("command", "option"),
    [
        ("design star.toml --rate 0", "--rate"),
        ("design star.toml --max-gain 0", "--max-gain"),
        ("design star.toml --coupling", "--coupling"),
        ("simulate star.toml --t-final 0", "--t-final"),
        ("simulate star.toml --mode zz", "--mode"),
        ("stress star.toml --loss 2", "--loss"),
        ("stress star.toml --fail zz@1", "--fail"),
        ("sweep star.toml target=1 --jobs 0", "--jobs"),
        ("certify star.toml --rate 0", "--rate"),
    ],
)
def test_errors_about_options_name_them_as_they_were_typed(dobc, command, option):
    code, out, _ = dobc(*command.split(), "--json")
    error = json.loads(out)["error"]
    assert (code, error["key"]) == (2, option)
    assert error["message"].startswith(option)


def test_every_wrong_option_is_named_at_once(dobc):
    err = dobc("design", "star.toml", "--rate", "0", "--noise=-1", "--digits", "99")[2]
    assert all(f"error: {option} must be" in err for option in ("--rate", "--noise", "--digits"))
