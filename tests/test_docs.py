"""The notes of record name things that exist, and links inside the handbook lead to a page and to a
heading of it."""

import ast
import json
import re
from pathlib import Path

import pytest

from dobc_design import Verdict, certify
from dobc_design.certificate import text
from dobc_design.checker import quadratic, reading
from dobc_design.cli.main import main
from dobc_design.conditions import numbers
from dobc_design.coupling import expression, parser, tree
from dobc_design.exact import number
from dobc_design.problem import arcs_file, load
from dobc_design.problem.schema import json_schema

ROOT = Path(__file__).resolve().parents[1]
_MADE = ("command-line", "commands-design", "commands-prepare", "conditions")
WRITTEN_BY_PROGRAM = {f"docs/reference/{name}.md" for name in _MADE}
PAGES = sorted(
    path.relative_to(ROOT).as_posix()
    for path in [
        ROOT / "README.md",
        *(ROOT / "docs").rglob("*.md"),
        *(ROOT / "notebooks").glob("*.ipynb"),
    ]
    if "_build" not in path.parts
)
CODE = re.compile(r"^```.*?^```$|`[^`\n]*`", re.MULTILINE | re.DOTALL)


def named_paths() -> list[tuple[str, str]]:
    """(column, path) of every path that stands in a row of the paper map."""
    found = []
    for line in (ROOT / "docs/paper-map.md").read_text("utf-8").splitlines():
        cells = [cell.strip() for cell in line.split("|")]
        if len(cells) < 6 or cells[1] in ("equation", "") or set(cells[1]) <= {"-"}:
            continue
        for column, cell in (("dobc_design", cells[3]), ("tests", cells[4])):
            found += [(column, path) for path in re.findall(r"`([^`]+)`", cell)]
    return found


@pytest.mark.parametrize(("column", "path"), named_paths())
def test_a_room_or_test_of_the_paper_map_exists(column: str, path: str):
    assert (ROOT / column / path).exists()


def test_the_paper_map_has_rows():
    assert len(named_paths()) > 60


def text_of(page: Path) -> str:
    """The words of a page; of a notebook those of its cells."""
    if page.suffix != ".ipynb":
        return page.read_text("utf-8")
    cells = json.loads(page.read_text("utf-8"))["cells"]
    return "\n\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "markdown")


def anchors(page: Path) -> set[str]:
    """What headings are called in a link, as GitHub and the handbook call them."""
    heads = re.findall(
        r"^#{1,6} +(.+?) *$", re.sub(r"^```.*?^```$", "", text_of(page), flags=re.M | re.S), re.M
    )
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


def broken_links(page: Path) -> list[str]:
    """Targets of a page's links that are not there; of web addresses nothing is asked."""
    broken = []
    for target in re.findall(r"\]\(([^)\s]+)\)", CODE.sub("", text_of(page))):
        file, _, anchor = target.partition("#")
        if "://" in target:
            continue
        place = (page.parent / file).resolve() if file else page
        if place.is_relative_to(ROOT) and place.relative_to(ROOT).as_posix() in WRITTEN_BY_PROGRAM:
            continue
        if not place.exists() or (anchor and anchor not in anchors(place)):
            broken.append(target)
    return broken


@pytest.mark.parametrize("name", PAGES)
def test_links_inside_the_project_lead_somewhere(name: str):
    assert broken_links(ROOT / name) == []


def test_a_link_to_no_page_or_no_heading_is_found(tmp_path: Path):
    page = tmp_path / "page.md"
    page.write_text(
        "# The `h`, once\n[a](#the-h-once) [b](#three) [c](page.md#the-h-once) [d](none.md)\n",
        "utf-8",
    )
    assert broken_links(page) == ["#three", "none.md"]


def test_the_readme_is_read_in_five_minutes():
    assert len((ROOT / "README.md").read_text("utf-8").split()) <= 900


def toctree_entries(page: Path) -> list[str]:
    trees = re.findall(r"^```\{toctree\}\n(.*?)^```$", page.read_text("utf-8"), re.M | re.S)
    return [
        line for tree in trees for line in tree.splitlines() if line and not line.startswith(":")
    ]


def test_every_page_of_the_handbook_stands_in_a_table_of_contents():
    pages = [ROOT / name for name in PAGES if name.startswith("docs/")]
    listed = [
        (page.parent / f"{entry}.md").resolve() for page in pages for entry in toctree_entries(page)
    ]
    assert set(pages) <= {ROOT / "docs/index.md", *listed}


def test_the_page_of_the_problem_file_has_every_key_of_its_schema_and_no_other():
    schema = json_schema()
    wanted = set()
    for name, key in schema["properties"].items():
        tables = [
            each["$ref"].rpartition("/")[2]
            for each in [key, *key.get("anyOf", [])]
            if "$ref" in each
        ]
        inside = schema["$defs"][tables[0]].get("properties", {}) if tables else {}
        wanted |= {f"{name}.{part}" for part in inside} or {name}
    found, table = set(), ""
    for line in (ROOT / "docs/reference/problem-file.md").read_text("utf-8").splitlines():
        for name in (
            re.findall(r"`([\w.]+)`", line.split(" | ")[0]) if line.startswith("| `") else ()
        ):
            table = name.rpartition(".")[0] or table  # `switching.dwell`, `sequence`: one table
            found.add(
                name.removesuffix(".NAME") if "." in name or name in wanted else f"{table}.{name}"
            )
    assert found == wanted


LINE = """\
name = "line"
target = 0
[network]
agents = 3
arrow = "listens_to"
[network.modes]
G = [[2, 1], [3, 2]]
[coupling]
h = "y"
[pinning]
gains = { 1 = 2 }
[exosystem]
A = [[0]]
C = [[1]]
[region]
initial_states = [-1, 1]
initial_disturbance = 1
"""
#: Every command, with what is needed to see all keys of its document; the first file is LINE, the
#: second lacks its pin.
COMMANDS = """
problems; schema; doctor; explain; explain hurwitz; check line.toml
check groups.toml --canonical problem.json
check alone.toml; check late.toml
certify line.toml --no-report
certify free.toml --no-report --theorem lemma1 --apply-fix cured.toml --search
verify line-certificate --problem line.toml; region line.toml; region line.toml --all --search
design line.toml --out designed.toml; design platoon --coupling --rate 0.4 --out trucks.toml
simulate line.toml; simulate line.toml --runs 3; stress line.toml --noise 0.1 --runs 3
stress line.toml --loss 0.1 --certificate line-certificate
simulate line.toml --certificate line-certificate
sweep line.toml pinning.gains.1=1,2 --jobs 1 --out swept
report line-certificate; new pumps; export line.toml --sdpa lmi.dat-s
export line.toml --c code --period 1/4
export line.toml --fmu agent.fmu --period 1/4; export line.toml --python-control loop.py
export line-certificate --rocq proof.v"""


def keys_of_documents() -> dict[str, dict[str, bool]]:
    """Heading of docs/reference/json.md or json-more.md -> key -> whether it is always there."""
    tables: dict[str, dict[str, bool]] = {}
    pages = [
        (ROOT / f"docs/reference/{name}.md").read_text("utf-8") for name in ("json", "json-more")
    ]
    for line in "".join(pages).splitlines():
        if line.startswith("## "):
            table = tables.setdefault(line[3:], {})
        elif line.startswith("| `") and tables:
            names, text = line.strip("| ").split(" | ", 1)
            table |= dict.fromkeys(re.findall(r"`(\w+)`", names), not text.startswith("only "))
    return tables


@pytest.mark.slow
def test_the_json_documents_have_the_keys_of_the_reference_and_no_others(
    tmp_path, monkeypatch, capsys
):
    """Those not said to be there only in some cases are there always; all but `group`, `breaking`,
    `rocq` are seen."""
    monkeypatch.chdir(tmp_path)
    Path("line.toml").write_text(LINE, "utf-8")
    Path("free.toml").write_text(
        LINE.replace("gains = { 1 = 2 }", "").replace("line", "free"), "utf-8"
    )
    own = 'C = [[1]]\n[[exosystem.groups]]\nagents = [3]\nkind = "ramp"\n'
    Path("groups.toml").write_text('units = "m"\n' + LINE.replace("C = [[1]]\n", own), "utf-8")
    one = '[[exosystem.groups]]\nagents = [3]\nkind = "ramp"\n'
    Path("alone.toml").write_text(LINE.replace("A = [[0]]\nC = [[1]]\n", one), "utf-8")
    Path("late.toml").write_text(f"{LINE}\n[processor]\nperiod = 0.1\n", "utf-8")
    documented, seen = keys_of_documents(), {}

    def look(heading: str, document: dict[str, object]) -> None:
        always = {key for key, sure in documented[heading].items() if sure}
        assert always <= set(document) <= set(documented[heading]), heading
        seen.setdefault(heading, set()).update(document)

    for command in re.split("; |\n", COMMANDS.strip()):
        with pytest.raises(SystemExit) as left:
            main([*command.split(), "--json"])
        document = json.loads(capsys.readouterr().out)
        assert left.value.code == (1 if "free.toml" in command else 0), (command, document)
        if command != "schema":
            look(f"dobc {command.split()[0]}", document)
        for check in document.get("checks", []):
            look("A check", check)
    with pytest.raises(SystemExit):
        main(["check", "nobody.toml", "--json"])
    assert set(json.loads(capsys.readouterr().out)["error"]) == {"kind", "key", "message", "cure"}
    seen |= {"A failure": set(documented["A failure"]), "A check": seen["A check"] | {"group"}}
    seen["dobc stress"].add("breaking")  # takes too long here
    seen["dobc verify"].add("rocq")  # needs coqc
    assert {heading: set(keys) for heading, keys in documented.items() if keys} == seen


def test_the_comparison_has_the_columns_that_the_benchmark_prints():
    """docs/comparison.md is what `make bench` printed once: another table there has to be pasted
    anew."""
    assigned = [
        node
        for node in ast.parse((ROOT / "tests/benchmarks/peers.py").read_text("utf-8")).body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "HEAD"
    ]
    (head,) = (ast.literal_eval(node.value) for node in assigned)
    assert head in (ROOT / "docs/comparison.md").read_text("utf-8").splitlines()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["paper-fixed", "paper-switching"])
def test_a_rate_that_the_readme_promises_is_proved_and_not_far_below(name: str):
    said = float(
        re.search(rf"`{name}`[^`]*?([0-9.]+) 1/s", (ROOT / "README.md").read_text("utf-8"))[1]
    )
    certificate = certify(load.load_problem(name))
    assert certificate.verdict is Verdict.PROVED
    assert said <= certificate.rate < 1.01 * said


PROBLEM_FILE, FORMAT = "docs/reference/problem-file.md", "docs/certificate-format.md"
LIMITS = [
    (PROBLEM_FILE, "at most {} MB. Numbers", load.MAX_BYTES // 2**20),
    (PROBLEM_FILE, "Arc files have at most {} GB", arcs_file.MAX_BYTES // 10**9),
    (PROBLEM_FILE, "Expressions have at most {} characters", expression.LONGEST),
    (PROBLEM_FILE, "characters and depth {};", parser.DEEPEST),
    (PROBLEM_FILE, "integers up to {} or 1/2", tree.LARGEST_EXPONENT),
    (PROBLEM_FILE, "Numbers have at most {} digits", number.MAX_CHARACTERS),
    (PROBLEM_FILE, "digits and exponents up to {}.", number.MAX_EXPONENT),
    (FORMAT, "a file above {} MiB", text.MAX_BYTES // 2**20),
    (FORMAT, "reads up to {} MiB", reading.MAX_BYTES // 2**20),
    (FORMAT, "with at most {} characters", numbers.LONGEST),
    (FORMAT, "with at most {} characters", reading.MAX_DIGITS),
    (FORMAT, "certificates of up to {} rows", quadratic.ROWS),
]


@pytest.mark.parametrize(("page", "sentence", "limit"), LIMITS)
def test_a_limit_that_a_page_names_is_the_one_of_the_code(page: str, sentence: str, limit: int):
    """How each is refused is tested where it is read."""
    assert sentence.format(
        f"{limit:,}".replace(",", " ") if limit >= 10_000 else limit
    ) in " ".join((ROOT / page).read_text("utf-8").split())
