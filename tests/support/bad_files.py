"""Problem files with exactly one mistake each, and what a user must be told about it.

Every case starts from VALID, a small file that uses every table, and makes one change.  The reader must
refuse each with a SpecError, without a traceback, an import, a hang or a file left behind.

``expect_key`` is the key path as the user would write it: tables dotted, places in a list as [0].  One of
the errors must carry it; "" means that no key can be asked for (the text is not TOML, or not text).
``expect_words`` must all occur in the lower-cased message (with its cure); they are few and tolerant on
purpose.  VALID_BUT_NASTY looks like an attack or a slip and has to load.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

Content = str | bytes | Callable[[], str | bytes]


@dataclass(frozen=True)
class BadFile:
    """One problem file, the files beside it, and what the reader must say.

    ``files``: path below the problem file's folder -> bytes; a path with a folder in it makes the folder.
    ``links``: path -> target of a symbolic link, where the system has them.
    """

    id: str
    content: Content
    expect_key: str = ""
    expect_words: tuple[str, ...] = ()
    files: Mapping[str, bytes] = field(default_factory=dict)
    links: Mapping[str, str] = field(default_factory=dict)

    def data(self) -> bytes:
        """The bytes of the problem file (large ones are made only now)."""
        content = self.content() if callable(self.content) else self.content
        return content.encode("utf-8") if isinstance(content, str) else content


VALID = """\
schema = 1
name = "four-agents"
target = 1.0

[network]
agents = 4
arrow = "listens_to"

[network.modes]
Ga = [[1, 2], [2, 3], [3, 4], [4, 1, 0.5]]
Gb = [[1, 2], [2, 1], [3, 2], [4, 3]]

[coupling]
h = "exp(y) - 1 + y"

[[coupling.exceptions]]
arcs = [[1, 2], [2, 3]]
h = "2*y"

[pinning]
gains = { 1 = 5.0, 3 = "9/16" }

[exosystem]
A = [[0, 2], [-2, 0]]
C = [[1, 0]]

[observer]
W = [["16/5"], ["12/5"]]
P = [["1/2", "-1/4"], ["-1/4", "1/3"]]

[formation]
offsets = { 2 = 1.5, 4 = -1.5 }

[region]
initial_states = [0, 5]
initial_disturbance = 0.5

[switching]
signal = "random"
dwell = 0.5

[simulation]
t_final = 20.0
seed = 0
xi0 = ["0.420735492", "0.270151153"]
"""

GA, GB = "Ga = [[1, 2], [2, 3], [3, 4], [4, 1, 0.5]]", "Gb = [[1, 2], [2, 1], [3, 2], [4, 3]]"
H = 'h = "exp(y) - 1 + y"'
EXCEPTION = '[[coupling.exceptions]]\narcs = [[1, 2], [2, 3]]\nh = "2*y"\n'
A, C = "A = [[0, 2], [-2, 0]]", "C = [[1, 0]]"
ONE = "A = [[0]]\nC = [[1]]"
W, P = 'W = [["16/5"], ["12/5"]]', 'P = [["1/2", "-1/4"], ["-1/4", "1/3"]]'
GAINS, OFFSETS = 'gains = { 1 = 5.0, 3 = "9/16" }', "offsets = { 2 = 1.5, 4 = -1.5 }"
STATES, XI0 = "initial_states = [0, 5]", 'xi0 = ["0.420735492", "0.270151153"]'
CSV = b"from,to,weight\n1,2,1\n2,3,1\n3,4,1\n4,1,0.5\n"


def swap(old: str, new: str) -> str:
    """Exchange the one place where ``old`` stands in VALID."""
    if VALID.count(old) != 1:
        raise ValueError(f"{old!r} stands {VALID.count(old)} times in VALID; it must stand there once")
    return VALID.replace(old, new)


def without(line: str) -> str:
    """Drop one line."""
    return swap(line + "\n", "")


def below(table: str, line: str) -> str:
    """Add a line right below the header of a table."""
    return swap(f"\n{table}\n", f"\n{table}\n{line}\n")


def top(line: str) -> str:
    """Add a line above the first table."""
    return swap("schema = 1\n", f"schema = 1\n{line}\n")


def end(lines: str) -> str:
    """Add a table at the end."""
    return f"{VALID}\n{lines}\n"


def signal(kind: str, *lines: str) -> str:
    """Another [switching], with these lines."""
    table = "\n".join([f'signal = "{kind}"', *lines])
    return swap('signal = "random"\ndwell = 0.5\n', f"{table}\n")


def target(value: str) -> str:
    """Give ``target`` another value, as typed."""
    return swap("target = 1.0", f"target = {value}")


def agents(value: str) -> str:
    """Give ``network.agents`` another value, as typed."""
    return swap("agents = 4", f"agents = {value}")


def group(*tables: str) -> str:
    """Add groups of agents with an exosystem of their own."""
    return VALID + "".join(f"\n[[exosystem.groups]]\n{lines}\n" for lines in tables)


def kind(lines: str) -> str:
    """Give the exosystem by these lines in place of A and C."""
    return swap(f"{A}\n{C}\n", f"{lines}\n")


def mode(value: str) -> str:
    """Give mode Ga another value, as typed."""
    return swap(GA, f"Ga = {value}")


def coupling(text: str) -> str:
    """Give ``coupling.h`` another expression."""
    return swap(H, f"h = '{text}'")


def exception(lines: str) -> str:
    """Give the exception other keys."""
    return swap(EXCEPTION, f"[[coupling.exceptions]]\n{lines}\n")


def number(case: str, value: str, *words: str) -> BadFile:
    """A ``target`` that is no number the contract allows."""
    return BadFile(f"number-{case}", target(value), "target", words)


def expression(case: str, text: str, *words: str) -> BadFile:
    """A ``coupling.h`` that is no coupling."""
    return BadFile(f"expression-{case}", coupling(text), "coupling.h", words)


def arcs_file(case: str, content: bytes | None, *words: str, name: str = "arcs.csv") -> BadFile:
    """A mode whose arcs are in a file; None: the file is not there."""
    files = {} if content is None else {name: content}
    return BadFile(f"arcs-file-{case}", mode(f"{{ file = '{name}' }}"), "network.modes.Ga.file", words, files)


TOML_AND_BYTES = [
    BadFile("empty", "", "network"),
    BadFile("only-comments", "# nothing yet\n\n", "network"),
    BadFile("syntax-error", swap("seed = 0", "seed = "), "", ("toml",)),
    BadFile("unclosed-text", swap('name = "four-agents"', 'name = "four-agents'), "", ("toml",)),
    BadFile("unclosed-table-header", swap("[pinning]", "[pinning"), "", ("toml",)),
    BadFile("number-in-bad-toml", swap("seed = 0", "seed = 01"), "", ("toml",)),
    BadFile("duplicate-key", swap("seed = 0", "seed = 0\nseed = 1"), "", ("toml",)),
    BadFile("duplicate-table", end("[pinning]\ngains = 1"), "", ("toml",)),
    BadFile("duplicate-mode", swap(GB, GB.replace("Gb", "Ga")), "", ("toml",)),
    BadFile("duplicate-gain-1-and-quoted-1", swap(GAINS, 'gains = { 1 = 5, "1" = 6 }'), "", ("toml",)),
    BadFile("truncated-in-a-matrix", VALID[: VALID.index("-2, 0]]")], "", ("toml",)),
    BadFile("truncated-between-tables", VALID[: VALID.index("[coupling]")], "coupling"),
    BadFile("latin-1", VALID.replace("four-agents", "vier-Glühwürmchen").encode("latin-1"), "", ("utf-8",)),
    BadFile("utf-16", VALID.encode("utf-16"), "", ("utf-8",)),
    BadFile("lone-surrogate", VALID.encode().replace(b"four-agents", b"\xed\xa0\x80"), "", ("utf-8",)),
    BadFile("nul-byte", VALID.encode().replace(b"four", b"fo\x00ur"), ""),
    BadFile("nul-byte-escaped", swap("four-agents", r"four\u0000agents"), "name"),
    BadFile("only-binary", bytes(range(256)), ""),
    BadFile("over-16-megabytes", lambda: VALID + "#" * (16 * 1024 * 1024), "", ("large",)),
    BadFile("over-16-megabytes-of-arcs", lambda: mode("[" + "[1, 2], " * 2_100_000 + "]"), "", ("large",)),
    BadFile("nested-lists-60", target("[" * 60 + "1" + "]" * 60), "", ("nest",)),
    BadFile("nested-lists-100000", target("[" * 100_000 + "]" * 100_000), "", ("nest",)),
    BadFile("nested-lists-unclosed", target("[" * 100_000), ""),
    BadFile("nested-inline-tables-60", top("deep = " + "{ a = " * 60 + "1" + " }" * 60), "", ("nest",)),
    BadFile("nested-dotted-key", top(".".join("a" * 20_000) + " = 1"), "", ("nest",)),
    BadFile("nested-table-header", end("[" + ".".join("a" * 200) + "]"), "", ("nest",)),
    BadFile("nested-table-header-of-a-megabyte", lambda: end("[" + "a." * 500_000 + "a]"), "", ("nest",)),
    BadFile("nested-inline-key-of-a-megabyte", lambda: top("deep = { " + "a." * 500_000 + "a = 1 }"), "", ("nest",)),
    BadFile("megabytes-of-quotes", lambda: '\\"""\n' * 800_000, "", ("toml",)),
    BadFile("megabytes-of-escaped-quotes", lambda: 'name = "' + '\\"' * 1_000_000, "", ("toml",)),
    BadFile("megabytes-in-triple-quotes", lambda: 'name = """' + 'a"\n' * 1_000_000, "", ("toml",)),
    BadFile(
        "megabytes-of-unknown-keys",
        lambda: VALID + "".join(f"u{i} = 1\n" for i in range(100_000)),
        "simulation.u0",
        ("unknown",),
    ),
]

UNKNOWN_KEYS = [
    BadFile("unknown-top", top("targett = 2"), "targett", ("target",)),
    BadFile("unknown-network", below("[network]", "agent = 4"), "network.agent", ("agents",)),
    BadFile("unknown-coupling", below("[coupling]", 'exception = "y"'), "coupling.exception", ("exceptions",)),
    BadFile(
        "unknown-exception", exception('arcs = [[1, 2]]\nh = "2*y"\narc = 1'), "coupling.exceptions[0].arc", ("arcs",)
    ),
    BadFile("unknown-pinning", below("[pinning]", "gain = 1"), "pinning.gain", ("gains",)),
    BadFile("unknown-exosystem", below("[exosystem]", "B = [[1]]"), "exosystem.B", ("unknown",)),
    BadFile("unknown-exosystem-case", below("[exosystem]", "a = [[1]]"), "exosystem.a", ("unknown",)),
    BadFile("unknown-observer", below("[observer]", "rat = 1"), "observer.rat", ("rate",)),
    BadFile("unknown-formation", below("[formation]", "offset = 1"), "formation.offset", ("offsets",)),
    BadFile("unknown-region", below("[region]", "initial_state = 1"), "region.initial_state", ("initial_states",)),
    BadFile("unknown-switching", below("[switching]", "dwel = 1"), "switching.dwel", ("dwell",)),
    BadFile("unknown-simulation", below("[simulation]", "tfinal = 1"), "simulation.tfinal", ("t_final",)),
    BadFile("unknown-table", end("[noise]\nlevel = 1"), "noise", ("unknown",)),
    BadFile("unknown-table-misspelt", swap("[exosystem]", "[exosytem]"), "exosytem", ("exosystem",)),
    BadFile("unknown-list-of-tables", end("[[agents]]\nname = 1"), "agents", ("unknown",)),
    BadFile("unknown-in-mode-file", mode('{ fil = "arcs.csv" }'), "network.modes.Ga", ("file",)),
    BadFile("unknown-key-with-markup", top('"<b>target</b>" = 1'), "<b>target</b>", ("unknown",)),
    BadFile("reserved-delays", end("[delays]\nlargest = 1"), "delays", ("delays",)),
    BadFile("reserved-dynamics", end("[dynamics]\norder = 2"), "dynamics", ("dynamics",)),
]

GROUPS_AND_KINDS = [
    BadFile("group-without-matrices", group('agents = ["1"]'), "exosystem.groups[0].A", ("required",)),
    BadFile("group-without-agents", group("A = [[0]]\nC = [[1]]"), "exosystem.groups[0].agents", ("required",)),
    BadFile("group-of-nobody", group(f"agents = []\n{ONE}"), "exosystem.groups[0].agents", ("labels",)),
    BadFile("group-of-a-number", group(f"agents = 1\n{ONE}"), "exosystem.groups[0].agents", ("labels",)),
    BadFile("group-of-a-stranger", group(f"agents = [1, 9]\n{ONE}"), "exosystem.groups[0].agents[1]", ("no agent",)),
    BadFile("group-with-a-twin", group(f"agents = [1, 1]\n{ONE}"), "exosystem.groups[0].agents[1]", ("already",)),
    BadFile(
        "two-groups-share-an-agent",
        group(f"agents = [1]\n{ONE}", f"agents = [2, 1]\n{ONE}"),
        "exosystem.groups[1].agents[1]",
        ("exosystem.groups[0] already",),
    ),
    BadFile("group-of-everybody-beside-a-rest", group(f"agents = [1, 2, 3, 4]\n{ONE}"), "exosystem.A", ("nobody",)),
    BadFile(
        "group-with-two-outputs", group("agents = [1]\nA = [[0]]\nC = [[1], [1]]"), "exosystem.groups[0].C", ("row",)
    ),
    BadFile("group-not-square", group("agents = [1]\nA = [[0, 1]]\nC = [[1]]"), "exosystem.groups[0].A", ("square",)),
    BadFile(
        "group-bad-number", group("agents = [1]\nA = [[0]]\nC = [[true]]"), "exosystem.groups[0].C[0][0]", ("boolean",)
    ),
    BadFile("group-with-a-wrong-w", group(f"agents = [1]\n{ONE}\nW = [[1, 2]]"), "exosystem.groups[0].W", ("shape",)),
    BadFile("group-with-p-alone", group(f"agents = [1]\n{ONE}\nP = [[1]]"), "exosystem.groups[0].P", ("beside",)),
    BadFile("group-without-the-p-of-others", group(f"agents = [1]\n{ONE}\nW = [[1]]"), "exosystem.groups", ("tested",)),
    BadFile("group-with-a-rate", group(f"agents = [1]\n{ONE}\nrate = 1"), "exosystem.groups[0].rate", ("unknown",)),
    BadFile("groups-as-a-table", end("[exosystem.groups]\nagents = [1]"), "exosystem.groups", ("list of tables",)),
    BadFile(
        "xi0-of-groups-in-one-row", group(f"agents = [1]\n{ONE}\nW = [[1]]\nP = [[1]]"), "simulation.xi0", ("row",)
    ),
    BadFile("kind-beside-matrices", below("[exosystem]", 'kind = "constant"'), "exosystem.kind", ("ignored",)),
    BadFile("kind-unknown", kind('kind = "sine"'), "exosystem.kind", ("constant, ramp, harmonics",)),
    BadFile("kind-of-a-number", kind("kind = 1"), "exosystem.kind", ("one of",)),
    BadFile("kind-without-frequencies", kind('kind = "harmonics"'), "exosystem.frequencies", ("required",)),
    BadFile("kind-with-frequencies", kind('kind = "ramp"\nfrequencies = [2]'), "exosystem.frequencies", ("meaning",)),
    BadFile("frequencies-alone", below("[exosystem]", "frequencies = [2]"), "exosystem.frequencies", ("harmonics",)),
    BadFile(
        "kind-with-a-zero-frequency",
        kind('kind = "harmonics"\nfrequencies = [2, 0]'),
        "exosystem.frequencies[1]",
        ("> 0",),
    ),
]

MISSING_OR_OF_A_WRONG_KIND = [
    BadFile("no-network", VALID[: VALID.index("[network]")] + VALID[VALID.index("[coupling]") :], "network"),
    BadFile("no-agents", without("agents = 4"), "network.agents"),
    BadFile("no-arrow", without('arrow = "listens_to"'), "network.arrow"),
    BadFile("no-modes", swap(f"[network.modes]\n{GA}\n{GB}\n", ""), "network.modes"),
    BadFile("no-coupling", swap(f"[coupling]\n{H}\n\n{EXCEPTION}", ""), "coupling"),
    BadFile("no-h", without(H), "coupling.h"),
    BadFile("no-h-in-exception", exception("arcs = [[1, 2]]"), "coupling.exceptions[0].h"),
    BadFile("no-arcs-in-exception", exception('h = "2*y"'), "coupling.exceptions[0].arcs"),
    BadFile("no-A", without(A), "exosystem.A"),
    BadFile("no-C", without(C), "exosystem.C"),
    BadFile("no-exosystem", swap(f"[exosystem]\n{A}\n{C}\n", ""), "observer", ("exosystem",)),
    BadFile("no-W-beside-P", without(W), "observer.P", ("w",)),
    BadFile("no-initial-disturbance", without("initial_disturbance = 0.5"), "region.initial_disturbance"),
    BadFile("no-initial-states", without(STATES), "region.initial_states"),
    BadFile("no-signal", without('signal = "random"'), "switching.signal"),
    BadFile("schema-newer", swap("schema = 1", "schema = 2"), "schema", ("2",)),
    BadFile("schema-zero", swap("schema = 1", "schema = 0"), "schema"),
    BadFile("schema-text", swap("schema = 1", 'schema = "1"'), "schema"),
    BadFile("schema-float", swap("schema = 1", "schema = 1.0"), "schema"),
    BadFile("schema-boolean", swap("schema = 1", "schema = true"), "schema"),
    BadFile("name-number", swap('"four-agents"', "4"), "name"),
    BadFile("name-float", swap('"four-agents"', "4.5"), "name"),
    BadFile("name-empty", swap('"four-agents"', '""'), "name"),
    BadFile("name-of-300-letters", swap("four-agents", "n" * 300), "name"),
    BadFile("name-with-escape-sequence", swap("four-agents", r"\u001b[31mred"), "name"),
    BadFile("notes-number", top("notes = 5"), "notes[0]"),
    BadFile("notes-with-escape-sequence", top(r'notes = ["\u001b[31mred"]'), "notes[0]"),
    BadFile("notes-of-2000-letters", top(f"notes = ['{'n' * 2000}']"), "notes[0]", ("1000",)),
    BadFile("schema-of-5000-hexadecimal-digits", swap("schema = 1", "schema = 0x" + "f" * 5000), "schema"),
    BadFile("name-of-two-lines", swap("four-agents", r"four\nagents"), "name"),
    BadFile("network-is-text", 'network = "ring"\n[coupling]\nh = "y"\n', "network", ("table",)),
    BadFile("coupling-is-text", 'coupling = "y"\n' + VALID[: VALID.index("[coupling]")], "coupling", ("table",)),
    BadFile("exceptions-is-table", swap("[[coupling.exceptions]]", "[coupling.exceptions]"), "coupling.exceptions"),
    BadFile("pinning-is-number", top("pinning = 5").replace(f"[pinning]\n{GAINS}\n", ""), "pinning", ("table",)),
    BadFile("formation-is-list", swap(OFFSETS, "offsets = [0, 1.5, 0, -1.5]"), "formation.offsets", ("table",)),
]

NETWORK = [
    BadFile("agents-zero", agents("0"), "network.agents", ("0",)),
    BadFile("agents-negative", agents("-1"), "network.agents", ("-1",)),
    BadFile("agents-fraction", agents("1.5"), "network.agents", ("1.5",)),
    BadFile("agents-boolean", agents("true"), "network.agents"),
    BadFile("agents-text", agents('"four"'), "network.agents", ("four",)),
    BadFile("agents-huge", agents("1000000000000"), "network.agents"),
    BadFile("agents-of-60-digits", agents("1" * 60), "network.agents"),
    BadFile("agents-infinite", agents("inf"), "network.agents"),
    BadFile("agents-none", agents("[]"), "network.agents"),
    BadFile("labels-twice", agents("[1, 2, 3, 4, 2]"), "network.agents", ("2",)),
    BadFile("labels-1-and-quoted-1", agents('[1, 2, 3, 4, "1"]'), "network.agents", ("1",)),
    BadFile("labels-boolean", agents("[1, 2, 3, 4, true]"), "network.agents"),
    BadFile("labels-float", agents("[1, 2, 3, 4, 5.5]"), "network.agents", ("5.5",)),
    BadFile("labels-list", agents("[1, 2, 3, 4, [5]]"), "network.agents"),
    BadFile("labels-empty", agents('[1, 2, 3, 4, ""]'), "network.agents"),
    BadFile("labels-blank", agents('[1, 2, 3, 4, "  "]'), "network.agents"),
    BadFile("labels-with-newline", agents(r'[1, 2, 3, 4, "a\nb"]'), "network.agents"),
    BadFile("labels-right-to-left-override", agents(r'[1, 2, 3, 4, "a\u202eb"]'), "network.agents"),
    BadFile("labels-with-escape-sequence", agents(r'[1, 2, 3, 4, "\u001b[31mred"]'), "network.agents"),
    BadFile("arrow-wrong", swap('"listens_to"', '"to"'), "network.arrow", ("listens_to", "sends_to")),
    BadFile("arrow-case", swap('"listens_to"', '"Listens_To"'), "network.arrow", ("listens_to",)),
    BadFile("arrow-boolean", swap('"listens_to"', "true"), "network.arrow", ("listens_to",)),
    BadFile("arrow-list", swap('"listens_to"', '["listens_to"]'), "network.arrow", ("listens_to",)),
    BadFile("modes-empty", swap(f"{GA}\n{GB}\n", ""), "network.modes", ("mode",)),
    BadFile("modes-is-list", swap(f"[network.modes]\n{GA}\n{GB}\n", "modes = [[1, 2], [2, 3]]\n"), "network.modes"),
    BadFile("mode-name-empty", swap(GB, GB.replace("Gb", '""')), "network.modes", ("name",)),
    BadFile("mode-name-with-escape-sequence", swap(GB, GB.replace("Gb", r'"\u001b[31mred"')), "network.modes"),
    BadFile("mode-name-of-300-letters", swap(GB, GB.replace("Gb", "G" * 300)), "network.modes", ("200",)),
    BadFile("agents-of-5000-hexadecimal-digits", agents("0x" + "f" * 5000), "network.agents"),
    BadFile("labels-of-5000-hexadecimal-digits", agents("[1, 2, 3, 4, 0x" + "f" * 5000 + "]"), "network.agents"),
    BadFile("mode-is-number", mode("3"), "network.modes.Ga"),
    BadFile("mode-is-text", mode('"arcs.csv"'), "network.modes.Ga"),
    BadFile("arc-is-number", mode("[1, 2]"), "network.modes.Ga[0]"),
    BadFile("arc-is-text", mode('[[1, 2], [2, 3], "34"]'), "network.modes.Ga[2]"),
    BadFile("arc-of-none", mode("[[1, 2], [2, 3], []]"), "network.modes.Ga[2]"),
    BadFile("arc-of-one", mode("[[1, 2], [2, 3], [4]]"), "network.modes.Ga[2]"),
    BadFile("arc-of-four", mode("[[1, 2], [2, 3, 1, 1]]"), "network.modes.Ga[1]"),
    BadFile("arc-to-itself", mode("[[1, 2], [2, 3], [3, 3]]"), "network.modes.Ga[2]", ("3",)),
    BadFile("arc-twice", mode("[[1, 2], [2, 3], [1, 2]]"), "network.modes.Ga[2]", ("duplicate",)),
    BadFile("arc-twice-mixed-labels", mode('[[1, 2], [2, 3], ["1", "2", 3]]'), "network.modes.Ga[2]"),
    BadFile("arc-unknown-agent", mode("[[1, 2], [2, 3], [3, 11]]"), "network.modes.Ga[2]", ("11",)),
    BadFile("arc-agent-zero", mode("[[0, 1], [1, 2]]"), "network.modes.Ga[0]", ("0",)),
    BadFile("arc-float-label", mode("[[1, 2], [2.0, 3]]"), "network.modes.Ga[1][0]", ("2.0",)),
    BadFile("arc-boolean-label", mode("[[1, 2], [true, 3]]"), "network.modes.Ga[1][0]"),
    BadFile("arc-list-label", mode("[[1, 2], [2, [3]]]"), "network.modes.Ga[1][1]"),
    BadFile("arc-in-second-mode", swap(GB, "Gb = [[1, 2], [2, 9]]"), "network.modes.Gb[1]", ("9",)),
    BadFile("weight-zero", mode("[[1, 2], [2, 3, 0]]"), "network.modes.Ga[1]", ("weight",)),
    BadFile("weight-negative", mode('[[1, 2], [2, 3, "-1/2"]]'), "network.modes.Ga[1]", ("weight",)),
    BadFile("weight-nan-text", mode('[[1, 2], [2, 3, "nan"]]'), "network.modes.Ga[1][2]", ("nan",)),
    BadFile("weight-nan", mode("[[1, 2], [2, 3, nan]]"), "network.modes.Ga[1][2]", ("nan",)),
    BadFile("weight-infinite", mode("[[1, 2], [2, 3, inf]]"), "network.modes.Ga[1][2]", ("inf",)),
    BadFile("weight-boolean", mode("[[1, 2], [2, 3, true]]"), "network.modes.Ga[1][2]"),
    BadFile("weight-list", mode("[[1, 2], [2, 3, [1]]]"), "network.modes.Ga[1][2]"),
    BadFile("weight-table", mode("[[1, 2], [2, 3, { w = 1 }]]"), "network.modes.Ga[1][2]"),
    BadFile("weight-tiny-underflow", mode('[[1, 2], [2, 3, "1e-9999"]]'), "network.modes.Ga[1][2]"),
]

EXPRESSIONS = [
    expression("empty", ""),
    expression("syntax", "exp(y) - 1 +"),
    expression("unclosed", "exp(y - 1"),
    expression("two-values", "y y"),
    expression("unknown-function", "foo(y)", "foo"),
    expression("unknown-function-near", "tahn(y)", "tanh"),
    expression("unknown-name", "k*y", "k"),
    expression("variable-of-higher-dimension", "y2", "y2"),
    expression("no-arguments", "exp()", "exp"),
    expression("too-many-arguments", "exp(y, y)", "exp"),
    expression("function-without-call", "exp", "exp"),
    expression("clip-with-two-arguments", "clip(y, 1)", "clip"),
    expression("attribute", "y.__class__"),
    expression("import", '__import__("os").system("echo")'),
    expression("eval", 'eval("y")', "eval"),
    expression("lambda", "(lambda: y)()"),
    expression("subscript", "y[0]"),
    expression("comprehension", "[y for y in (1,)][0]"),
    expression("assignment", "y := 0"),
    expression("comparison", "y if y > 0 else 2*y"),
    expression("caret", "y^3", "**"),
    expression("floor-division", "y//2"),
    expression("semicolon", "y; y"),
    expression("comment", "y # linear"),
    expression("complex-number", "2j*y"),
    expression("power-tower", "9**9**9*y"),
    expression("power-tower-parenthesised", "(9**64)**64*y"),
    expression("exponent-too-large", "y**65", "64"),
    expression("exponent-huge", "y**99999999999", "64"),
    expression("exponent-fraction", "y**0.3"),
    expression("exponent-variable", "y**y"),
    expression("number-exponent-too-large", "1e999*y"),
    expression("number-of-300-digits", "1" * 300 + "*y"),
    expression("too-long", "y + " * 600 + "y", "2000"),
    expression("too-deep", "(" * 60 + "y" + ")" * 60, "50"),
    expression("too-deep-functions", "tanh(" * 60 + "y" + ")" * 60, "50"),
    expression("does-not-vanish", "exp(y) + y", "vanish"),
    expression("does-not-vanish-by-little", "y + 1e-300", "vanish"),
    expression("constant", "1", "vanish"),
    expression("undefined-log", "log(y)", "0"),
    expression("undefined-quotient", "1/y", "0"),
    expression("undefined-removable", "sin(y)/y*y", "0"),
    expression("undefined-to-the-left", "sqrt(y)"),
    expression("division-by-zero", "y/0", "zero"),
    expression("division-by-hidden-zero", "y/(1 - 1)", "zero"),
    expression("cyrillic-letters", "\u0435\u0445\u0440(y) - 1", "ascii"),
    expression("fullwidth-letter", "\uff59", "ascii"),
    expression("superscript", "y + y\u00b3", "\u00b3"),
    expression("minus-sign", "exp(y) \u2212 1", "\u2212"),
    expression("line-continuation", "y + \\"),
    BadFile("h-number", swap(H, "h = 2"), "coupling.h"),
    BadFile("h-float", swap(H, "h = 2.0"), "coupling.h"),
    BadFile("h-table", swap(H, 'h = { y = "y" }'), "coupling.h"),
    BadFile("h-list-too-long", swap(H, 'h = ["y1", "y2"]'), "coupling.h"),
    BadFile("h-list-empty", swap(H, "h = []"), "coupling.h"),
    BadFile("h-list-of-numbers", swap(H, "h = [1]"), "coupling.h[0]"),
    BadFile("exception-h-does-not-vanish", swap('h = "2*y"', 'h = "2*y + 1"'), "coupling.exceptions[0].h", ("vanish",)),
    BadFile(
        "exception-h-of-the-second-table",
        swap(EXCEPTION, f'{EXCEPTION}\n[[coupling.exceptions]]\narcs = [[3, 4]]\nh = "foo(y)"\n'),
        "coupling.exceptions[1].h",
        ("foo",),
    ),
    BadFile("exception-no-such-arc", exception('arcs = [[1, 2], [1, 3]]\nh = "2*y"'), "coupling.exceptions[0].arcs[1]"),
    BadFile("exception-wrong-way-round", exception('arcs = [[3, 1]]\nh = "2*y"'), "coupling.exceptions[0].arcs[0]"),
    BadFile(
        "exception-unknown-agent",
        exception('arcs = [[1, 2], [2, 11]]\nh = "2*y"'),
        "coupling.exceptions[0].arcs[1]",
        ("11",),
    ),
    BadFile("exception-arc-twice", exception('arcs = [[1, 2], [1, 2]]\nh = "y"'), "coupling.exceptions[0].arcs[1]"),
    BadFile(
        "exception-arc-in-two-tables",
        swap(EXCEPTION, f'{EXCEPTION}\n[[coupling.exceptions]]\narcs = [[3, 4], [2, 3]]\nh = "3*y"\n'),
        "coupling.exceptions[1].arcs[1]",
    ),
    BadFile("exception-with-weight", exception('arcs = [[1, 2, 3]]\nh = "y"'), "coupling.exceptions[0].arcs[0]"),
    BadFile("exception-arc-is-number", exception('arcs = [1, 2]\nh = "y"'), "coupling.exceptions[0].arcs[0]"),
    BadFile("exception-arcs-empty", exception('arcs = []\nh = "y"'), "coupling.exceptions[0].arcs"),
    BadFile("exception-arcs-text", exception('arcs = "all"\nh = "y"'), "coupling.exceptions[0].arcs"),
]

NUMBERS = [
    number("text", '"one"', "one"),
    number("empty-text", '""'),
    number("two-points", '"0.5.1"', "0.5.1"),
    number("two-signs", '"--1"', "--1"),
    number("two-slashes", '"1/2/3"', "1/2/3"),
    number("over-zero", '"1/0"', "0"),
    number("sum", '"2 + 2"', "2 + 2"),
    number("hexadecimal-text", '"0x10"', "0x10"),
    number("nan", "nan", "nan"),
    number("nan-text", '"NaN"', "nan"),
    number("infinite", "-inf", "inf"),
    number("infinite-text", '"Infinity"', "inf"),
    number("boolean", "true", "boolean"),
    number("date", "2024-02-29"),
    number("time", "12:30:00"),
    number("table", "{ x = 1 }"),
    number("exponent-999", "1e999"),
    number("exponent-minus-999", '"1e-999"'),
    number("exponent-99999999", "1e99999999"),
    number("exponent-of-a-million-digits", '"1e' + "9" * 1_000_000 + '"'),
    number("300-digits", "3." + "1" * 300, "200"),
    number("300-digits-whole", "7" * 300, "200"),
    number("300-digits-text", '"' + "7" * 300 + '"', "200"),
    number("300-digits-below-the-line", '"1/' + "7" * 300 + '"', "200"),
    number("arabic-digits", '"\u0661\u0662"', "number"),
    number("fullwidth-digits", '"\uff11"', "number"),
    number("vulgar-fraction", '"\u00bd"', "number"),
    number("decimal-comma", '"3,2"', "3,2"),
    number("with-unit", '"3.2 m"', "3.2 m"),
    BadFile("number-5000-digits", target("7" * 5000), ""),
    BadFile("number-leading-zero", target("007"), "", ("toml",)),
    BadFile("number-5000-hexadecimal-digits", target("0x" + "f" * 5000), "target", ("200",)),
    BadFile("target-of-600", target(str([0] * 600)).replace(f"[exosystem]\n{A}\n{C}\n", ""), "target", ("100",)),
    BadFile("target-too-long", target("[1, 2]"), "target", ("1",)),
    BadFile("target-empty", target("[]"), "target"),
    BadFile("target-nested", target("[[1]]"), "target[0]"),
    BadFile("target-boolean-inside", target("[true]"), "target[0]"),
]

MATRICES = [
    BadFile("A-not-square", swap(A, "A = [[0, 2, 0], [-2, 0, 0]]"), "exosystem.A", ("square",)),
    BadFile("A-ragged", swap(A, "A = [[0, 2], [-2]]"), "exosystem.A[1]", ("row",)),
    BadFile("A-flat", swap(A, "A = [0, 2, -2, 0]"), "exosystem.A", ("rows",)),
    BadFile("A-number", swap(A, "A = 0"), "exosystem.A"),
    BadFile("A-text", swap(A, 'A = "0 2; -2 0"'), "exosystem.A"),
    BadFile("A-empty", swap(A, "A = []"), "exosystem.A"),
    BadFile("A-empty-rows", swap(A, "A = [[], []]"), "exosystem.A[0]"),
    BadFile("A-nested", swap(A, "A = [[[0], 2], [-2, 0]]"), "exosystem.A[0][0]"),
    BadFile("A-nan-text", swap(A, 'A = [["nan", 2], [-2, 0]]'), "exosystem.A[0][0]", ("nan",)),
    BadFile("A-boolean", swap(A, "A = [[0, 2], [-2, false]]"), "exosystem.A[1][1]"),
    BadFile("C-too-wide", swap(C, "C = [[1, 0, 0]]"), "exosystem.C", ("column",)),
    BadFile("C-flat", swap(C, "C = [1, 0]"), "exosystem.C"),
    BadFile("C-division-by-zero", swap(C, 'C = [["1/0", 0]]'), "exosystem.C[0][0]"),
    BadFile("C-of-two-rows-and-W-of-one-column", swap(C, "C = [[1, 0], [0, 1]]"), "observer.W", ("shape",)),
    BadFile("W-lying", swap(W, 'W = [["16/5", "12/5"]]'), "observer.W", ("shape",)),
    BadFile("W-flat", swap(W, 'W = ["16/5", "12/5"]'), "observer.W"),
    BadFile("W-infinite", swap(W, 'W = [["16/5"], [inf]]'), "observer.W[1][0]"),
    BadFile("P-not-symmetric", swap(P, 'P = [["1/2", "-1/4"], ["1/4", "1/3"]]'), "observer.P", ("symmetric",)),
    BadFile("P-almost-symmetric", swap('["-1/4", "1/3"]', '["-0.25000000000000001", "1/3"]'), "observer.P"),
    BadFile("P-not-square", swap(P, 'P = [["1/2", "-1/4"]]'), "observer.P"),
    BadFile("P-too-large", swap(P, "P = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]"), "observer.P", ("shape",)),
    BadFile("rate-zero", swap(f"{W}\n{P}", "rate = 0"), "observer.rate"),
    BadFile("rate-negative", swap(f"{W}\n{P}", "rate = -1"), "observer.rate", ("-1",)),
    BadFile("rate-text", swap(f"{W}\n{P}", 'rate = "fast"'), "observer.rate", ("fast",)),
    BadFile("rate-list", swap(f"{W}\n{P}", "rate = [1]"), "observer.rate"),
]

PINS_AND_FORMATION = [
    BadFile("gain-negative", swap(GAINS, "gains = { 1 = 5, 3 = -1 }"), "pinning.gains.3", ("-1",)),
    BadFile("gain-boolean", swap(GAINS, "gains = { 1 = true }"), "pinning.gains.1"),
    BadFile("gain-text", swap(GAINS, 'gains = { 1 = "abc" }'), "pinning.gains.1", ("abc",)),
    BadFile("gain-nan", swap(GAINS, "gains = { 1 = nan }"), "pinning.gains.1", ("nan",)),
    BadFile("gain-table", swap(GAINS, "gains = { 1 = { k = 5 } }"), "pinning.gains.1"),
    BadFile("gain-flat-list", swap(GAINS, "gains = { 1 = [5] }"), "pinning.gains.1"),
    BadFile("gain-matrix-negative", swap(GAINS, 'gains = { 1 = [["-1/9"]] }'), "pinning.gains.1"),
    BadFile("gain-matrix-too-large", swap(GAINS, "gains = { 1 = [[1, 0], [0, 1]] }"), "pinning.gains.1", ("shape",)),
    BadFile("gain-matrix-entry", swap(GAINS, 'gains = { 1 = [["x"]] }'), "pinning.gains.1[0][0]", ("x",)),
    BadFile("gain-of-unknown-agent", swap(GAINS, "gains = { 1 = 5, 11 = 5 }"), "pinning.gains.11", ("11",)),
    BadFile(
        "gain-of-a-label-of-a-megabyte",
        swap(GAINS, "gains = { " + "x" * 1_000_000 + " = 5 }"),
        f"pinning.gains.{'x' * 57}...",
        ("agent",),
    ),
    BadFile(
        "gain-of-label-with-escape-sequence",
        swap(GAINS, r'gains = { "\u001b[31m" = 5 }'),
        r"pinning.gains.\x1b[31m",
        ("agent",),
    ),
    BadFile("gain-of-label-01", swap(GAINS, "gains = { 01 = 5 }"), "pinning.gains.01", ("01",)),
    BadFile("gains-text", swap(GAINS, 'gains = "all"'), "pinning.gains", ("all",)),
    BadFile("gains-negative-for-all", swap(GAINS, "gains = -2"), "pinning.gains", ("-2",)),
    BadFile("gains-list", swap(GAINS, "gains = [5, 0, 0, 0]"), "pinning.gains"),
    BadFile("offset-of-unknown-agent", swap(OFFSETS, "offsets = { 11 = 1 }"), "formation.offsets.11", ("11",)),
    BadFile("offset-too-long", swap(OFFSETS, "offsets = { 2 = [1, 2] }"), "formation.offsets.2"),
    BadFile("offset-text", swap(OFFSETS, 'offsets = { 2 = "left" }'), "formation.offsets.2", ("left",)),
    BadFile("offset-boolean", swap(OFFSETS, "offsets = { 2 = true }"), "formation.offsets.2"),
]

REGION_AND_SETTINGS = [
    BadFile("region-reversed", swap(STATES, "initial_states = [5, 0]"), "region.initial_states", ("5",)),
    BadFile("region-reversed-inside", swap(STATES, "initial_states = [[5, 0]]"), "region.initial_states[0]"),
    BadFile("region-two-pairs", swap(STATES, "initial_states = [[0, 5], [0, 5]]"), "region.initial_states", ("pair",)),
    BadFile("region-three-numbers", swap(STATES, "initial_states = [0, 5, 7]"), "region.initial_states", ("pair",)),
    BadFile("region-one-number", swap(STATES, "initial_states = 5"), "region.initial_states", ("pair",)),
    BadFile("region-mixed", swap(STATES, "initial_states = [[0, 5], 3]"), "region.initial_states", ("pair",)),
    BadFile("region-empty", swap(STATES, "initial_states = []"), "region.initial_states"),
    BadFile("region-infinite", swap(STATES, "initial_states = [0, inf]"), "region.initial_states[1]", ("inf",)),
    BadFile(
        "disturbance-negative", swap("disturbance = 0.5", "disturbance = -0.5"), "region.initial_disturbance", ("-1/2",)
    ),
    BadFile("disturbance-list", swap("disturbance = 0.5", "disturbance = [0.5, 0]"), "region.initial_disturbance"),
    BadFile("signal-unknown", swap('"random"', '"sometimes"'), "switching.signal", ("random", "sometimes")),
    BadFile("signal-number", swap('"random"', "5"), "switching.signal", ("random",)),
    BadFile("signal-list", swap('"random"', '["random"]'), "switching.signal"),
    BadFile("radius-of-random", below("[switching]", "radius = 1"), "switching.radius", ("random", "mobile")),
    BadFile("mobile-without-radius", signal("mobile"), "switching.radius", ("neighbours",)),
    BadFile("radius-twice", signal("mobile", "radius = 1", "neighbours = 2"), "switching.neighbours", ("radius",)),
    BadFile("radius-negative", signal("mobile", "radius = -1"), "switching.radius", ("-1",)),
    BadFile("neighbours-fraction", signal("mobile", "neighbours = 1.5"), "switching.neighbours", ("1.5",)),
    BadFile(
        "hysteresis-negative", signal("mobile", "radius = 1", "hysteresis = -0.1"), "switching.hysteresis", ("-1/10",)
    ),
    BadFile("schedule-missing", signal("schedule"), "switching.schedule", ("missing",)),
    BadFile("schedule-flat", signal("schedule", 'schedule = [0, "Ga"]'), "switching.schedule[0]", ("instant",)),
    BadFile("schedule-late", signal("schedule", 'schedule = [[1, "Ga"]]'), "switching.schedule[0][0]", ("0",)),
    BadFile(
        "schedule-backwards",
        signal("schedule", 'schedule = [[0, "Ga"], [2, "Gb"], [1, "Ga"]]'),
        "switching.schedule[2][0]",
        ("increase",),
    ),
    BadFile(
        "schedule-unknown-mode",
        signal("schedule", 'schedule = [[0, "Ga"], [1, "Gx"]]'),
        "switching.schedule[1][1]",
        ("gx", "ga, gb"),
    ),
    BadFile("sequence-unknown", signal("periodic", 'sequence = ["Ga", "Gx"]'), "switching.sequence[1]", ("gx",)),
    BadFile("sequence-text", signal("periodic", 'sequence = "Ga"'), "switching.sequence", ("list",)),
    BadFile("sequence-number", signal("periodic", "sequence = [1]"), "switching.sequence[0]", ("name of a mode",)),
    BadFile("sequence-empty", signal("periodic", "sequence = []"), "switching.sequence", ("list",)),
    BadFile("period-and-dwell", signal("periodic", "period = 1", "dwell = 1"), "switching.period", ("dwell",)),
    BadFile("period-zero", signal("periodic", "period = 0"), "switching.period", ("> 0",)),
    BadFile(
        "period-too-short",
        signal("periodic", 'schedule = [[0, "Ga"], [2, "Gb"]]', "period = 2"),
        "switching.period",
        ("> 2 s",),
    ),
    BadFile(
        "round-without-end", signal("periodic", 'schedule = [[0, "Ga"], [2, "Gb"]]'), "switching.period", ("missing",)
    ),
    BadFile("generator-not-square", signal("markov", "generator = [[0, 0]]"), "switching.generator", ("square",)),
    BadFile("generator-of-three", signal("markov", f"generator = {[[0] * 3] * 3}"), "switching.generator", ("2 rows",)),
    BadFile(
        "generator-sum", signal("markov", "generator = [[-1, 0.9], [1, -1]]"), "switching.generator[0]", ("-1/10",)
    ),
    BadFile(
        "generator-negative", signal("markov", "generator = [[1, -1], [1, -1]]"), "switching.generator[0][1]", (">= 0",)
    ),
    BadFile(
        "generator-and-dwell",
        signal("markov", "generator = [[-1, 1], [1, -1]]", "dwell = 1"),
        "switching.dwell",
        ("generator",),
    ),
    BadFile("x0-of-three", below("[simulation]", "x0 = [1, 2, 3]"), "simulation.x0", ("4 numbers", "3")),
    BadFile("x0-rows", below("[simulation]", "x0 = [[1], [2]]"), "simulation.x0", ("4 rows",)),
    BadFile("x0-number", below("[simulation]", "x0 = 1"), "simulation.x0", ("list",)),
    BadFile("x0-text", below("[simulation]", 'x0 = [1, 2, "far", 4]'), "simulation.x0[2]", ("far",)),
    BadFile("dwell-zero", swap("dwell = 0.5", "dwell = 0"), "switching.dwell"),
    BadFile("dwell-negative", swap("dwell = 0.5", "dwell = -1"), "switching.dwell", ("-1",)),
    BadFile("dwell-text", swap("dwell = 0.5", 'dwell = "short"'), "switching.dwell", ("short",)),
    BadFile("t_final-zero", swap("t_final = 20.0", "t_final = 0"), "simulation.t_final"),
    BadFile("t_final-negative", swap("t_final = 20.0", "t_final = -5"), "simulation.t_final", ("-5",)),
    BadFile("t_final-infinite", swap("t_final = 20.0", "t_final = inf"), "simulation.t_final", ("inf",)),
    BadFile("t_final-boolean", swap("t_final = 20.0", "t_final = true"), "simulation.t_final"),
    BadFile("seed-negative", swap("seed = 0", "seed = -1"), "simulation.seed", ("-1",)),
    BadFile("seed-float", swap("seed = 0", "seed = 1.5"), "simulation.seed", ("1.5",)),
    BadFile("seed-text", swap("seed = 0", 'seed = "0"'), "simulation.seed"),
    BadFile("seed-boolean", swap("seed = 0", "seed = true"), "simulation.seed"),
    BadFile("seed-of-5000-hexadecimal-digits", swap("seed = 0", "seed = 0x" + "f" * 5000), "simulation.seed"),
    BadFile("seed-of-60-digits", swap("seed = 0", "seed = " + "9" * 60), "simulation.seed"),
    BadFile("xi0-too-long", swap(XI0, "xi0 = [1, 0, 0]"), "simulation.xi0", ("2",)),
    BadFile("xi0-number", swap(XI0, "xi0 = 1"), "simulation.xi0"),
    BadFile("xi0-empty", swap(XI0, "xi0 = []"), "simulation.xi0"),
    BadFile("xi0-too-few-rows", swap(XI0, "xi0 = [[1, 0], [1, 0], [1, 0]]"), "simulation.xi0", ("4",)),
    BadFile("xi0-row-too-short", swap(XI0, "xi0 = [[1, 0], [1], [1, 0], [1, 0]]"), "simulation.xi0[1]"),
    BadFile("xi0-mixed", swap(XI0, "xi0 = [[1, 0], 1]"), "simulation.xi0[0]"),
    BadFile("xi0-text", swap(XI0, 'xi0 = ["0.5 sin 1", 0]'), "simulation.xi0[0]", ("0.5 sin 1",)),
]

ARC_FILES = [
    arcs_file("missing", None, "arcs.csv"),
    BadFile(
        "arcs-file-in-a-missing-folder",
        mode('{ file = "no/such/arcs.csv" }'),
        "network.modes.Ga.file",
        ("no/such/arcs.csv",),
    ),
    BadFile("arcs-file-is-a-folder", mode('{ file = "data" }'), "network.modes.Ga.file", (), {"data/arcs.csv": CSV}),
    BadFile("arcs-file-is-its-own-folder", mode('{ file = "." }'), "network.modes.Ga.file"),
    BadFile("arcs-file-above", mode('{ file = "../x.csv" }'), "network.modes.Ga.file", ("folder",)),
    BadFile(
        "arcs-file-above-by-a-detour",
        mode('{ file = "data/../../x.csv" }'),
        "network.modes.Ga.file",
        ("folder",),
        {"data/arcs.csv": CSV},
    ),
    BadFile("arcs-file-absolute", mode('{ file = "/etc/passwd" }'), "network.modes.Ga.file", ("folder",)),
    BadFile("arcs-file-home", mode('{ file = "~/arcs.csv" }'), "network.modes.Ga.file"),
    BadFile("arcs-file-address", mode('{ file = "https://example.org/arcs.csv" }'), "network.modes.Ga.file"),
    BadFile(
        "arcs-file-linked-outside",
        mode('{ file = "arcs.csv" }'),
        "network.modes.Ga.file",
        ("arcs.csv",),
        links={"arcs.csv": "/etc/passwd"},
    ),
    BadFile(
        "arcs-file-linked-to-itself",
        mode('{ file = "arcs.csv" }'),
        "network.modes.Ga.file",
        ("arcs.csv",),
        links={"arcs.csv": "arcs.csv"},
    ),
    BadFile("arcs-file-with-nul", mode(r'{ file = "arcs.csv\u0000" }'), "network.modes.Ga.file"),
    BadFile("arcs-file-name-too-long", mode('{ file = "' + "a" * 5000 + '.csv" }'), "network.modes.Ga.file"),
    BadFile("arcs-file-name-empty", mode('{ file = "" }'), "network.modes.Ga.file"),
    BadFile("arcs-file-name-number", mode("{ file = 5 }"), "network.modes.Ga"),
    BadFile("arcs-file-name-float", mode("{ file = 5.5 }"), "network.modes.Ga"),
    BadFile("arcs-file-two-keys", mode('{ file = "arcs.csv", weight = 2 }'), "network.modes.Ga", (), {"arcs.csv": CSV}),
    arcs_file("of-unknown-kind", CSV, "arcs.xlsx", name="arcs.xlsx"),
    arcs_file("empty", b"", "arcs.csv"),
    arcs_file("only-header", b"from,to,weight\n", "arcs.csv"),
    arcs_file("one-column", b"1,2\n2\n3,4\n", "line 2"),
    arcs_file("four-columns", b"1,2,1\n2,3,1,1\n", "line 2"),
    arcs_file("semicolons", b"1;2\n2;3\n", "line 1"),
    arcs_file("weight-text", b"from,to,weight\n1,2,1\n2,3,heavy\n", "line 3", "heavy"),
    arcs_file("weight-empty", b"1,2,1\n2,3,\n", "line 2"),
    arcs_file("weight-nan", b"1,2,nan\n", "line 1", "nan"),
    arcs_file("weight-zero", b"1,2,1\n2,3,0\n", "weight"),
    arcs_file("weight-negative", b"1,2,1\n2,3,-4\n", "weight"),
    arcs_file("unknown-agent", b"1,2\n2,3\n3,eleven\n", "line 3", "eleven"),
    arcs_file("header-in-the-middle", b"1,2\nfrom,to\n2,3\n", "line 2"),
    arcs_file("self-arc", b"1,2\n2,2\n", "2"),
    arcs_file("arc-twice", b"1,2\n2,3\n1,2\n", "duplicate"),
    arcs_file("latin-1", "1,2\n2,Zürich\n".encode("latin-1"), "utf-8"),
    arcs_file("utf-16", "1,2\n2,3\n".encode("utf-16"), "utf-8"),
    arcs_file("nul-byte", b"1,2\n2,3\x00\n", "line 2"),
    arcs_file("open-quote", b'1,2\n"2,3\n3,4\n'),
    arcs_file("field-of-a-megabyte", b"1," + b"2" * 1_000_000 + b"\n"),
    arcs_file("not-graphml", b"<graphml><graph>", "graphml", name="arcs.graphml"),
    arcs_file(
        "graphml-with-entities",
        b'<!DOCTYPE g [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;&a;">]><graphml>&b;</graphml>',
        name="arcs.graphml",
    ),
    arcs_file(
        "graphml-without-arcs",
        b'<graphml xmlns="http://graphml.graphdrawing.org/xmlns"><graph edgedefault="directed"/></graphml>',
        "arcs.graphml",
        name="arcs.graphml",
    ),
]

BAD_FILES: list[BadFile] = [
    *TOML_AND_BYTES,
    *UNKNOWN_KEYS,
    *GROUPS_AND_KINDS,
    *MISSING_OR_OF_A_WRONG_KIND,
    *NETWORK,
    *EXPRESSIONS,
    *NUMBERS,
    *MATRICES,
    *PINS_AND_FORMATION,
    *REGION_AND_SETTINGS,
    *ARC_FILES,
]


def labels(*last: str) -> str:
    """VALID with further agents, whose labels are typed as given."""
    return agents(f"[1, 2, 3, 4, {', '.join(last)}]")


VALID_BUT_NASTY: list[BadFile] = [
    BadFile("plain", VALID),
    BadFile("label-script", labels('"<script>alert(1)</script>"')),
    BadFile("label-image", labels("""'"><img src=x onerror="alert(1)">'""")),
    BadFile("label-template", labels('"{{ 7*7 }}"', '"{% raw %}"')),
    BadFile("label-latex", labels(r"'$\frac{'", r"'\input{x}'", "'a_b^c%'")),
    BadFile("label-markdown", labels('"[x](javascript:alert(1))"', '"| a | b |"', '"`code`"')),
    BadFile("label-rich-markup", labels('"[red]x[/red]"', '"[/]"')),
    BadFile("label-format", labels('"%s%n"', '"{0.__class__}"', '"$(id)"')),
    BadFile("label-dotted", labels('"a.b"', '"a[0]"', '" spaced "')),
    BadFile("label-spreadsheet", labels("""'=HYPERLINK("http://example.org")'""")),
    BadFile("label-unicode", labels('"Zürich"', '"東京"', '"🛰"', '"e\u0301"', '"\u00e9"')),
    BadFile("label-of-200-letters", labels('"' + "x" * 200 + '"')),
    BadFile("label-like-python", labels('"None"', '"__proto__"', '"nan"', '"true"', '"from"', '"0"', '"-1"')),
    BadFile("mode-markup", swap(GB, GB.replace("Gb", '"<b>G & b</b>"'))),
    BadFile("mode-dotted", swap(GB, GB.replace("Gb", '"a.b[0]"'))),
    BadFile("mode-unicode", swap(GB, GB.replace("Gb", '"Netz ohne Süden"'))),
    BadFile("mode-without-arcs", swap(GB, "Gb = []")),
    BadFile("name-markup", swap("four-agents", "<script>alert(1)</script>")),
    BadFile("name-latex", swap('"four-agents"', r"'$\frac{'")),
    BadFile("switching-in-rounds", signal("periodic", 'sequence = ["Gb", "Ga", "Gb"]', "period = 1.5")),
    BadFile("switching-in-uneven-rounds", signal("periodic", 'schedule = [[0, "Gb"], ["1/3", "Ga"]]', "period = 1")),
    BadFile("switching-markov", signal("markov", 'generator = [["-1/3", "1/3"], [0, 0]]')),
    BadFile("switching-schedule", signal("schedule", 'schedule = [[0, "Ga"], [1e-3, "Gb"]]')),
    BadFile("switching-mobile", signal("mobile", "radius = 2.5", "hysteresis = 0")),
    BadFile("switching-nearest", signal("mobile", "neighbours = 2", "dwell = 1")),
    BadFile("x0-for-all", below("[simulation]", "x0 = [2]")),
    BadFile("x0-each", below("[simulation]", "x0 = [1, 2, 3, 4]")),
    BadFile("x0-each-a-row", below("[simulation]", "x0 = [[1], [2], [3], [4]]")),
    BadFile("line-ends-of-windows", VALID.replace("\n", "\r\n")),
    BadFile("no-final-line-end", VALID.rstrip("\n")),
    BadFile("byte-order-mark", b"\xef\xbb\xbf" + VALID.encode()),
    BadFile("quotes-at-the-end-of-a-long-text", top('notes = ["""a"""", "b"]')),
    BadFile("brackets-in-text-and-comments", top("# " + "[" * 200 + "'\"") + "# '''" + "{" * 200),
    BadFile("number-negative-zero", target("-0.0")),
    BadFile("number-underscores", target("1_000.000_5")),
    BadFile("number-hexadecimal-whole", target("0x10")),
    BadFile("number-of-150-digits", target('"1.' + "3" * 150 + '"')),
    BadFile("number-tiny", target("1e-300")),
    BadFile("number-below-every-float", target('"1e-399"')),
    BadFile("number-above-every-float", target('"1e399"')),
    BadFile("number-fraction-text", target('"-22/7"')),
    BadFile("target-list", target("[1]")),
    BadFile("weights-far-apart", mode("[[1, 2, 1e-20], [2, 3, 1e20], [3, 4], [4, 1]]")),
    BadFile("labels-mixed-in-arcs", mode('[["1", 2], [2, "3"], [3, 4], [4, 1]]')),
    BadFile("gain-zero", swap(GAINS, "gains = { 1 = 0, 3 = 5 }")),
    BadFile("gain-of-nobody", swap(GAINS, "gains = {}")),
    BadFile("gain-for-all", swap(GAINS, 'gains = "9/16"')),
    BadFile("gain-matrix", swap(GAINS, "gains = { 1 = [[5]] }")),
    BadFile("h-list-of-one", swap(H, 'h = ["y"]')),
    BadFile("h-with-kinks", coupling("clip(y, -1, 1) + abs(y)/2 + max(y, 0)")),
    BadFile("h-vanishes-by-a-hair", coupling("(exp(y) - exp(-y))/3 + sin(y)**2")),
    BadFile("h-of-2000-characters", coupling("y" + " " * 1997 + "+y")),
    BadFile("h-long-sum", coupling("+".join("y" * 1000))),
    BadFile("h-depth-40", coupling("tanh(" * 40 + "y" + ")" * 40)),
    BadFile("h-of-two-lines", swap(H, 'h = """\nexp(y) - 1\n  + y"""')),
    BadFile("P-not-definite", swap(P, "P = [[1, 2], [2, 1]]")),
    BadFile("rate-beside-W", swap(P, "rate = 1")),
    BadFile("region-of-one-point", swap(STATES, "initial_states = [1, 1]")),
    BadFile("disturbance-zero", swap("disturbance = 0.5", "disturbance = 0")),
    BadFile("xi0-rows", swap(XI0, "xi0 = [[1, 0], [0, 1], [1, 1], [0, 0]]")),
    BadFile("arcs-file", mode('{ file = "arcs.csv" }'), files={"arcs.csv": CSV}),
    BadFile("arcs-file-below", mode('{ file = "data/arcs.csv" }'), files={"data/arcs.csv": CSV}),
    BadFile(
        "arcs-file-detour-inside", mode('{ file = "data/../arcs.csv" }'), files={"arcs.csv": CSV, "data/other.csv": CSV}
    ),
    BadFile(
        "arcs-file-of-windows",
        mode('{ file = "arcs.csv" }'),
        files={"arcs.csv": b"\xef\xbb\xbf" + CSV.replace(b"\n", b"\r\n")},
    ),
    BadFile("arcs-file-quoted", mode('{ file = "arcs.csv" }'), files={"arcs.csv": b'"1","2"\n\n"2","3"\n3 , 4\n4,1\n'}),
    BadFile(
        "arcs-file-exact-weights",
        mode('{ file = "arcs.csv" }'),
        files={"arcs.csv": b"1,2,9/16\n2,3,1e-3\n3,4,0.1\n4,1,2\n"},
    ),
]


def write_case(case: BadFile, folder: Path) -> Path:
    """Write a case and the files beside it.  Raises OSError where links cannot be made (Windows)."""
    for name, content in case.files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    for name, goal in case.links.items():
        (folder / name).symlink_to(goal)
    path = folder / "problem.toml"
    path.write_bytes(case.data())
    return path


def listing(folder: Path) -> list[str]:
    """Everything that lies in a folder and below."""
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))
