"""Problem files with exactly one mistake each, and what a user must be told about it.

Every case starts from VALID, a small file that uses every table, and makes one change.  The reader
must refuse each with a SpecError, without a traceback, an import, a hang or a file left behind.

``expect_key`` is the key path as the user would write it: tables dotted, places in a list as [0].
One of the errors must carry it; "" means that no key can be asked for (the text is not TOML, or not
text). ``expect_words`` must all occur in the lower-cased message (with its cure); they are few and
tolerant on purpose.  VALID_BUT_NASTY looks like an attack or a slip and has to load.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

Content = str | bytes | Callable[[], str | bytes]


@dataclass(frozen=True)
class BadFile:
    """One problem file, the files beside it, and what the reader must say.

    ``files``: path below the problem file's folder -> bytes; a path with a folder in it makes the
    folder. ``links``: path -> target of a symbolic link, where the system has them.
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
        if isinstance(content, str):
            return content.encode("utf-8")
        return content


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
MODES, EXOSYSTEM = f"[network.modes]\n{GA}\n{GB}\n", f"[exosystem]\n{A}\n{C}\n"
GAINS, OFFSETS = 'gains = { 1 = 5.0, 3 = "9/16" }', "offsets = { 2 = 1.5, 4 = -1.5 }"
XI0 = 'xi0 = ["0.420735492", "0.270151153"]'
FILE = "network.modes.Ga.file"
SECOND = f"{EXCEPTION}\n[[coupling.exceptions]]\n"
GROUPS = "exosystem.groups"
TURNS, ROUND = 'sequence = ["Ga", "Gb"]', 'schedule = [[0, "Ga"], [2, "Gb"]]'
CSV = b"from,to,weight\n1,2,1\n2,3,1\n3,4,1\n4,1,0.5\n"


def swap(old: str, new: str) -> str:
    if VALID.count(old) != 1:
        raise ValueError(
            f"{old!r} stands {VALID.count(old)} times in VALID; it must stand there once"
        )
    return VALID.replace(old, new)


def without(line: str) -> str:
    return swap(line + "\n", "")


def below(table: str, line: str) -> str:
    return swap(f"\n{table}\n", f"\n{table}\n{line}\n")


def top(line: str) -> str:
    return swap("schema = 1\n", f"schema = 1\n{line}\n")


def end(lines: str) -> str:
    return f"{VALID}\n{lines}\n"


def signal(kind: str, *lines: str) -> str:
    table = "\n".join([f'signal = "{kind}"', *lines])
    return swap('signal = "random"\ndwell = 0.5\n', f"{table}\n")


def guarantee(kind: str, *lines: str) -> str:
    table = "\n".join([f'guarantee = "{kind}"', *lines])
    return swap('signal = "random"\ndwell = 0.5\n', f"{table}\n")


def target(value: str) -> str:
    return swap("target = 1.0", f"target = {value}")


def agents(value: str) -> str:
    return swap("agents = 4", f"agents = {value}")


def switching(case: str, kind: str, lines: str, key: str, *words: str) -> BadFile:
    """A signal with these lines, semicolons between them."""
    text = signal(kind, *lines.split("; "))
    return bad(case, text, f"switching.{key}", *words)


def guaranteed(case: str, kind: str, lines: str, key: str, *words: str) -> BadFile:
    """The same of a guarantee."""
    text = guarantee(kind, *lines.split("; "))
    return bad(case, text, f"switching.{key}", *words)


def gains(case: str, table: str, key: str, *words: str) -> BadFile:
    return bad(case, swap(GAINS, f"gains = {{ {table} }}"), f"pinning.gains.{key}", *words)


def sequence(case: str, lines: str, key: str, *words: str) -> BadFile:
    """A guarantee about the two modes in turn."""
    text = guarantee("sequence", TURNS, *lines.split("; "))
    return bad(case, text, f"switching.{key}", *words)


def group(*tables: str) -> str:
    return VALID + "".join(f"\n[[exosystem.groups]]\n{lines}\n" for lines in tables)


def kind(lines: str) -> str:
    return swap(f"{A}\n{C}\n", f"{lines}\n")


def observer(lines: str) -> str:
    return swap(f"{W}\n{P}\n", f"{lines}\n")


def mode(value: str) -> str:
    return swap(GA, f"Ga = {value}")


def coupling(text: str) -> str:
    return swap(H, f"h = '{text}'")


def exception(lines: str) -> str:
    return swap(EXCEPTION, f"[[coupling.exceptions]]\n{lines}\n")


FROM_CSV = mode('{ file = "arcs.csv" }')
BELOW = {"data/arcs.csv": CSV}


def bad(
    id: str,
    content: Content,
    key: str = "",
    *words: str,
    files: Mapping[str, bytes] | None = None,
    links: Mapping[str, str] | None = None,
) -> BadFile:
    """One case; after the key the words that its message has to hold."""
    return BadFile(id, content, key, words, files or {}, links or {})


def number(case: str, value: str, *words: str) -> BadFile:
    return bad(f"number-{case}", target(value), "target", *words)


def expression(case: str, text: str, *words: str) -> BadFile:
    return bad(f"expression-{case}", coupling(text), "coupling.h", *words)


def arcs_file(case: str, content: bytes | None, *words: str, name: str = "arcs.csv") -> BadFile:
    """A mode whose arcs are in a file; None: the file is not there."""
    files = {} if content is None else {name: content}
    return bad(f"arcs-file-{case}", mode(f"{{ file = '{name}' }}"), FILE, *words, files=files)


def _toml_and_bytes() -> Iterator[BadFile]:
    yield bad("empty", "", "network")
    yield bad("syntax-error", swap("seed = 0", "seed = "), "", "toml")
    yield bad("duplicate-key", swap("seed = 0", "seed = 0\nseed = 1"), "", "toml")
    yield bad(
        "duplicate-gain-1-and-quoted-1", swap(GAINS, 'gains = { 1 = 5, "1" = 6 }'), "", "toml"
    )
    yield bad("truncated-in-a-matrix", VALID[: VALID.index("-2, 0]]")], "", "toml")
    yield bad(
        "latin-1", VALID.replace("four-agents", "vier-Glühwürmchen").encode("latin-1"), "", "utf-8"
    )
    yield bad("nul-byte", VALID.encode().replace(b"four", b"fo\x00ur"), "")
    yield bad("over-16-megabytes", lambda: VALID + "#" * (16 * 1024 * 1024), "", "large")
    yield bad(
        "over-16-megabytes-of-arcs", lambda: mode("[" + "[1, 2], " * 2_100_000 + "]"), "", "large"
    )
    yield bad("nested-lists-60", target("[" * 60 + "1" + "]" * 60), "", "nest")
    yield bad(
        "nested-inline-tables-60", top("deep = " + "{ a = " * 60 + "1" + " }" * 60), "", "nest"
    )
    yield bad("nested-dotted-key", top(".".join("a" * 20_000) + " = 1"), "", "nest")
    yield bad(
        "nested-table-header-of-a-megabyte", lambda: end("[" + "a." * 500_000 + "a]"), "", "nest"
    )
    yield bad(
        "nested-inline-key-of-a-megabyte",
        lambda: top("deep = { " + "a." * 500_000 + "a = 1 }"),
        "",
        "nest",
    )
    yield bad("megabytes-of-quotes", lambda: '\\"""\n' * 800_000, "", "toml")
    yield bad("megabytes-in-triple-quotes", lambda: 'name = """' + 'a"\n' * 700_000, "", "toml")
    yield bad(
        "many-unknown-keys",
        lambda: VALID + "".join(f"u{i} = 1\n" for i in range(20_000)),
        "simulation.u0",
        "unknown",
    )


def _unknown_keys() -> Iterator[BadFile]:
    for value in ('"1"', "true", 0, 2):
        yield bad(f"schema-{value}", swap("schema = 1", f"schema = {value}"), "schema", "1")
    yield bad("unknown-top", top("targett = 2"), "targett", "target")
    yield bad("unknown-network", below("[network]", "agent = 4"), "network.agent", "agents")
    yield bad(
        "unknown-exception",
        exception('arcs = [[1, 2]]\nh = "2*y"\narc = 1'),
        "coupling.exceptions[0].arc",
        "arcs",
    )
    yield bad("unknown-exosystem", below("[exosystem]", "B = [[1]]"), "exosystem.B", "unknown")
    yield bad("unknown-table", end("[noise]\nlevel = 1"), "noise", "unknown")
    yield bad("unknown-key-with-markup", top('"<b>target</b>" = 1'), "<b>target</b>", "unknown")


UNKNOWN_KEYS = list(_unknown_keys())


def _groups_and_kinds() -> Iterator[BadFile]:
    yield bad(
        "group-without-matrices", group('agents = ["1"]'), "exosystem.groups[0].A", "required"
    )
    yield bad(
        "group-without-agents",
        group("A = [[0]]\nC = [[1]]"),
        "exosystem.groups[0].agents",
        "required",
    )
    yield bad(
        "group-of-nobody", group(f"agents = []\n{ONE}"), "exosystem.groups[0].agents", "labels"
    )
    yield bad(
        "group-of-a-stranger",
        group(f"agents = [1, 9]\n{ONE}"),
        f"{GROUPS}[0].agents[1]",
        "no agent",
    )
    yield bad(
        "groups-share-an-agent",
        group(f"agents = [1]\n{ONE}", f"agents = [2, 1]\n{ONE}"),
        f"{GROUPS}[1].agents[1]",
        "exosystem.groups[0] already",
    )
    yield bad(
        "group-of-everybody-beside-a-rest",
        group(f"agents = [1, 2, 3, 4]\n{ONE}"),
        "exosystem.A",
        "apply to no agent",
    )
    yield bad(
        "group-with-a-wrong-w",
        group(f"agents = [1]\n{ONE}\nW = [[1, 2]]"),
        f"{GROUPS}[0].W",
        "shape",
    )
    yield bad(
        "group-without-the-p-of-others",
        group(f"agents = [1]\n{ONE}\nW = [[1]]"),
        "exosystem.groups",
        "tested",
    )
    yield bad(
        "groups-as-a-table",
        end("[exosystem.groups]\nagents = [1]"),
        "exosystem.groups",
        "list of tables",
    )
    yield bad(
        "xi0-of-groups-in-one-row",
        group(f"agents = [1]\n{ONE}\nW = [[1]]\nP = [[1]]"),
        "simulation.xi0",
        "row",
    )
    yield bad(
        "kind-beside-matrices",
        below("[exosystem]", 'kind = "constant"'),
        "exosystem.kind",
        "only one of them",
    )
    yield bad(
        "kind-without-frequencies", kind('kind = "harmonics"'), "exosystem.frequencies", "required"
    )
    yield bad(
        "frequencies-alone",
        below("[exosystem]", "frequencies = [2]"),
        "exosystem.frequencies",
        "only one of them",
    )


def _missing_or_of_a_wrong_kind() -> Iterator[BadFile]:
    yield bad(
        "no-network",
        VALID[: VALID.index("[network]")] + VALID[VALID.index("[coupling]") :],
        "network",
    )
    yield bad("no-modes", swap(MODES, ""), "network.modes")
    yield bad("no-h", without(H), "coupling.h")
    yield bad("no-exosystem", swap(EXOSYSTEM, ""), "observer", "exosystem")
    yield bad("no-W-beside-P", without(W), "observer.P", "w")
    yield bad(
        "no-initial-disturbance", without("initial_disturbance = 0.5"), "region.initial_disturbance"
    )
    yield bad("no-signal", without('signal = "random"'), "switching.signal")
    yield bad("notes-of-2000-letters", top(f"notes = ['{'n' * 2000}']"), "notes[0]", "1000")
    yield bad("network-is-text", 'network = "ring"\n[coupling]\nh = "y"\n', "network", "table")
    yield bad(
        "coupling-is-text",
        'coupling = "y"\n' + VALID[: VALID.index("[coupling]")],
        "coupling",
        "table",
    )
    yield bad(
        "exceptions-is-table",
        swap("[[coupling.exceptions]]", "[coupling.exceptions]"),
        "coupling.exceptions",
    )
    yield bad(
        "pinning-is-number",
        top("pinning = 5").replace(f"[pinning]\n{GAINS}\n", ""),
        "pinning",
        "table",
    )
    yield bad(
        "formation-is-list",
        swap(OFFSETS, "offsets = [0, 1.5, 0, -1.5]"),
        "formation.offsets",
        "table",
    )


def _network() -> Iterator[BadFile]:
    yield bad("agents-huge", agents("1000000000000"), "network.agents")
    yield bad("labels-twice", agents("[1, 2, 3, 4, 2]"), "network.agents", "2")
    yield bad(
        "modes-is-list",
        swap(MODES, "modes = [[1, 2], [2, 3]]\n"),
        "network.modes",
    )
    yield bad("agents-of-5000-hexadecimal-digits", agents("0x" + "f" * 5000), "network.agents")
    yield bad("arc-twice", mode("[[1, 2], [2, 3], [1, 2]]"), "network.modes.Ga[2]", "duplicate")
    yield bad(
        "arc-twice-mixed-labels", mode('[[1, 2], [2, 3], ["1", "2", 3]]'), "network.modes.Ga[2]"
    )
    yield bad("arc-unknown-agent", mode("[[1, 2], [2, 3], [3, 11]]"), "network.modes.Ga[2]", "11")


def _expressions() -> Iterator[BadFile]:
    yield expression("syntax", "exp(y) - 1 +")
    yield expression("unclosed", "exp(y - 1")
    yield expression("attribute", "y.__class__")
    yield expression("caret", "y^3", "**")
    yield expression("too-long", "y + " * 600 + "y", "2000")
    yield expression("too-deep", "(" * 60 + "y" + ")" * 60, "50")
    yield expression("does-not-vanish", "exp(y) + y", "vanish")
    yield expression("constant", "1", "vanish")
    yield expression("undefined-log", "log(y)", "0")
    yield expression("undefined-to-the-left", "sqrt(y)")
    yield bad("h-number", swap(H, "h = 2"), "coupling.h")
    yield bad("h-table", swap(H, 'h = { y = "y" }'), "coupling.h")
    yield bad(
        "exception-h-does-not-vanish",
        swap('h = "2*y"', 'h = "2*y + 1"'),
        "coupling.exceptions[0].h",
        "vanish",
    )
    yield bad(
        "exception-h-of-the-second-table",
        swap(EXCEPTION, f'{SECOND}arcs = [[3, 4]]\nh = "foo(y)"\n'),
        "coupling.exceptions[1].h",
        "foo",
    )
    yield bad(
        "exception-wrong-way-round",
        exception('arcs = [[3, 1]]\nh = "2*y"'),
        "coupling.exceptions[0].arcs[0]",
    )
    yield bad(
        "exception-stranger",
        exception('arcs = [[1, 2], [2, 11]]\nh = "2*y"'),
        "coupling.exceptions[0].arcs[1]",
        "11",
    )
    yield bad(
        "exception-arc-twice",
        exception('arcs = [[1, 2], [1, 2]]\nh = "y"'),
        "coupling.exceptions[0].arcs[1]",
    )
    yield bad(
        "exception-arc-in-two-tables",
        swap(EXCEPTION, f'{SECOND}arcs = [[3, 4], [2, 3]]\nh = "3*y"\n'),
        "coupling.exceptions[1].arcs[1]",
    )


def _numbers() -> Iterator[BadFile]:
    yield number("text", '"one"', "one")
    yield number("over-zero", '"1/0"', "0")
    yield number("nan", "nan", "nan")
    yield number("exponent-of-a-million-digits", '"1e' + "9" * 1_000_000 + '"')
    yield bad("number-5000-digits", target("7" * 5000), "")
    yield bad("number-leading-zero", target("007"), "", "toml")
    yield bad("number-5000-hexadecimal-digits", target("0x" + "f" * 5000), "target", "200")
    yield bad(
        "target-of-600",
        target(str([0] * 600)).replace(f"[exosystem]\n{A}\n{C}\n", ""),
        "target",
        "100",
    )


def _matrices() -> Iterator[BadFile]:
    yield bad("A-not-square", swap(A, "A = [[0, 2, 0], [-2, 0, 0]]"), "exosystem.A", "square")
    yield bad("A-empty-rows", swap(A, "A = [[], []]"), "exosystem.A[0]")
    yield bad(
        "C-of-two-rows-and-W-of-one-column", swap(C, "C = [[1, 0], [0, 1]]"), "observer.W", "shape"
    )
    yield bad("W-lying", swap(W, 'W = [["16/5", "12/5"]]'), "observer.W", "shape")


def _pins_and_formation() -> Iterator[BadFile]:
    yield gains("gain-negative", "1 = 5, 3 = -1", "3", "-1")
    yield gains("gain-matrix-negative", '1 = [["-1/9"]]', "1")
    yield gains("gain-matrix-too-large", "1 = [[1, 0], [0, 1]]", "1", "shape")
    yield bad(
        "gain-of-a-megabyte",
        swap(GAINS, "gains = { " + "x" * 1_000_000 + " = 5 }"),
        f"pinning.gains.{'x' * 57}...",
        "agent",
    )
    yield bad(
        "gain-of-escape-sequence",
        swap(GAINS, r'gains = { "\u001b[31m" = 5 }'),
        r"pinning.gains.\x1b[31m",
        "agent",
    )


def _switching() -> Iterator[BadFile]:
    yield switching("radius-twice", "mobile", "radius = 1; neighbours = 2", "neighbours", "radius")
    yield switching("neighbours-fraction", "mobile", "neighbours = 1.5", "neighbours", "1.5")
    yield switching(
        "hysteresis-negative", "mobile", "radius = 1; hysteresis = -0.1", "hysteresis", "-1/10"
    )
    yield bad("schedule-missing", signal("schedule"), "switching.schedule", "missing")
    yield switching(
        "schedule-backwards",
        "schedule",
        'schedule = [[0, "Ga"], [2, "Gb"], [1, "Ga"]]',
        "schedule[2][0]",
        "increase",
    )
    yield switching(
        "schedule-unknown-mode",
        "schedule",
        'schedule = [[0, "Ga"], [1, "Gx"]]',
        "schedule[1][1]",
        "gx",
        "ga, gb",
    )
    yield switching("sequence-empty", "periodic", "sequence = []", "sequence", "list")
    yield switching("period-and-dwell", "periodic", "period = 1; dwell = 1", "period", "dwell")
    yield bad(
        "period-too-short", signal("periodic", ROUND, "period = 2"), "switching.period", "> 2 s"
    )
    yield bad("round-without-end", signal("periodic", ROUND), "switching.period", "missing")
    yield bad(
        "generator-of-three",
        signal("markov", f"generator = {[[0] * 3] * 3}"),
        "switching.generator",
        "2 rows",
    )
    yield switching(
        "generator-sum", "markov", "generator = [[-1, 0.9], [1, -1]]", "generator[0]", "-1/10"
    )
    yield switching(
        "generator-negative", "markov", "generator = [[1, -1], [1, -1]]", "generator[0][1]", ">= 0"
    )
    yield switching(
        "generator-twice",
        "markov",
        "generator = [[-1, 1], [1, -1]]; dwell = 1",
        "dwell",
        "generator",
    )
    yield guaranteed(
        "guarantee-unknown", "never", "dwell = 1", "guarantee", "arbitrary, dwell, sequence"
    )
    yield switching("guarantee-number", "random", "guarantee = 1", "guarantee", "one of")
    yield bad("guarantee-without-dwell", guarantee("dwell"), "switching.dwell", "missing")
    yield guaranteed(
        "longest-below-dwell", "dwell", "dwell = 2; longest = 1", "longest", ">=", "2 s"
    )
    yield guaranteed("longest-zero", "dwell", "dwell = 2; longest = 0", "longest", "> 0")
    yield switching("longest-of-any-signal", "random", "dwell = 1; longest = 2", "longest", "dwell")
    yield sequence("longest-of-a-sequence", "dwell = 1; longest = 2", "longest", "no meaning")
    yield bad(
        "sequence-without-times", guarantee("sequence", TURNS), "switching.guarantee", "how long"
    )
    yield guaranteed(
        "sequence-of-random", "sequence", 'signal = "random"; dwell = 1', "guarantee", "order"
    )
    yield sequence("dwell-of-three", "dwell = [1, 2, 3]", "dwell", "2 numbers", "3")
    yield sequence("dwell-with-a-zero", "dwell = [1, 0]", "dwell[1]", "> 0")
    yield guaranteed(
        "dwell-list-of-nothing", "sequence", "dwell = [1, 2]", "sequence", "list of modes"
    )
    yield guaranteed("dwell-list-of-random", "dwell", "dwell = [1, 2]", "dwell")
    yield sequence("dwell-list-beside-a-period", "dwell = [1, 2]; period = 9", "period", "dwell")


def _starts() -> Iterator[BadFile]:
    yield bad(
        "x0-of-three", below("[simulation]", "x0 = [1, 2, 3]"), "simulation.x0", "4 numbers", "3"
    )
    yield bad("x0-rows", below("[simulation]", "x0 = [[1], [2]]"), "simulation.x0", "4 rows")
    yield bad("x0-text", below("[simulation]", 'x0 = [1, 2, "far", 4]'), "simulation.x0[2]", "far")
    yield bad(
        "seed-of-5000-hexadecimal-digits",
        swap("seed = 0", "seed = 0x" + "f" * 5000),
        "simulation.seed",
    )
    yield bad(
        "xi0-too-few-rows", swap(XI0, "xi0 = [[1, 0], [1, 0], [1, 0]]"), "simulation.xi0", "4"
    )
    yield bad(
        "xi0-row-too-short", swap(XI0, "xi0 = [[1, 0], [1], [1, 0], [1, 0]]"), "simulation.xi0[1]"
    )


def _arc_files() -> Iterator[BadFile]:
    yield arcs_file("missing", None, "arcs.csv")
    yield bad(
        "arcs-file-no-folder", mode('{ file = "no/such/arcs.csv" }'), FILE, "no/such/arcs.csv"
    )
    yield bad("arcs-file-is-a-folder", mode('{ file = "data" }'), FILE, files=BELOW)
    yield bad("arcs-file-above", mode('{ file = "../x.csv" }'), FILE, "folder")
    yield bad(
        "arcs-file-above-by-a-detour",
        mode('{ file = "data/../../x.csv" }'),
        FILE,
        "folder",
        files=BELOW,
    )
    yield bad(
        "arcs-file-linked-outside", FROM_CSV, FILE, "arcs.csv", links={"arcs.csv": "/etc/passwd"}
    )
    yield bad(
        "arcs-file-linked-to-itself", FROM_CSV, FILE, "arcs.csv", links={"arcs.csv": "arcs.csv"}
    )
    yield bad("arcs-file-with-nul", mode(r'{ file = "arcs.csv\u0000" }'), FILE)
    yield bad(
        "arcs-file-two-keys",
        mode('{ file = "arcs.csv", weight = 2 }'),
        "network.modes.Ga",
        files={"arcs.csv": CSV},
    )
    yield arcs_file("of-unknown-kind", CSV, "arcs.xlsx", name="arcs.xlsx")
    yield arcs_file("empty", b"", "arcs.csv")
    yield arcs_file("one-column", b"1,2\n2\n3,4\n", "line 2")
    yield arcs_file("weight-empty", b"1,2,1\n2,3,\n", "line 2")
    yield arcs_file("weight-zero", b"1,2,1\n2,3,0\n", "weight")
    yield arcs_file("header-in-the-middle", b"1,2\nfrom,to\n2,3\n", "line 2")
    yield arcs_file("arc-twice", b"1,2\n2,3\n1,2\n", "duplicate")
    yield arcs_file("latin-1", "1,2\n2,Zürich\n".encode("latin-1"), "utf-8")
    yield arcs_file("nul-byte", b"1,2\n2,3\x00\n", "line 2")
    yield arcs_file("open-quote", b'1,2\n"2,3\n3,4\n')
    yield arcs_file("field-of-a-megabyte", b"1," + b"2" * 1_000_000 + b"\n")
    yield arcs_file("not-graphml", b"<graphml><graph>", "graphml", name="arcs.graphml")
    yield arcs_file(
        "graphml-with-entities",
        b'<!DOCTYPE g [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;&a;">]><graphml>&b;</graphml>',
        name="arcs.graphml",
    )
    yield arcs_file(
        "graphml-without-arcs",
        b'<graphml xmlns="http://graphml.graphdrawing.org/xmlns"><graph '
        b'edgedefault="directed"/></graphml>',
        "arcs.graphml",
        name="arcs.graphml",
    )


BOTH = f"{A}\n{C}"
FOUR_ROWS = "[[0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1], [1, 0, 0, 0]]"


def _slips() -> Iterator[BadFile]:
    """What people write who know another notation, or another program: each is one mistake, which
    is told once, with its cure."""
    yield bad(
        "slip-A-and-C-exchanged",
        swap(BOTH, "A = [[1, 0]]\nC = [[0, 2], [-2, 0]]"),
        "exosystem.A",
        "a and c look exchanged",
    )
    yield bad("slip-dwell-alone", without('signal = "random"'), "switching.signal", "guarantee =")
    yield bad(
        "slip-label-twice-below-numbered-arcs",
        agents('["a", "b", "a"]'),
        "network.agents",
        "'a' appears twice",
    )
    yield bad(
        "slip-key-below-the-last-table",
        without("target = 1.0") + "target = 1.0\n",
        "simulation.target",
        "above the first table",
    )
    yield bad(
        "slip-key-below-the-modes",
        swap(GB, f"{GB}\ntarget = 2").replace("target = 1.0\n", ""),
        "network.modes.target",
        "above the first table",
    )
    yield bad(
        "slip-table-in-a-table",
        end("[network.pinning]\ngains = { 1 = 1 }"),
        "network.pinning",
        "write [pinning]",
    )
    yield bad(
        "slip-adjacency-matrix",
        mode(FOUR_ROWS),
        "network.modes.Ga",
        "4 rows of 4 numbers",
        "from_sparse",
    )
    yield bad(
        "slip-adjacency-matrix-of-another-size",
        mode("[[0, 1, 0], [1, 0, 1], [0, 1, 0]]"),
        "network.modes.Ga",
        "3 rows of 3 numbers",
    )
    yield bad("slip-hz-0", kind("hz = 0"), "exosystem.hz", "constant = true")
    yield bad("slip-percent", end('[uncertainty]\nweights = "5%"'), "uncertainty.weights", "0.05.")
    yield bad("slip-hz-with-its-unit", kind('hz = "0.5 Hz"'), "exosystem.hz", "write 0.5,")
    yield bad("slip-khz", kind('hz = "2 KHZ"'), "exosystem.hz", "write 2000,", "in hz")
    yield gains("slip-gain-with-its-unit", '1 = "2/s"', "1", "write 2,", "in 1/s")
    yield bad("slip-rate-with-its-unit", observer('rate = "2 1/s"'), "observer.rate", "write 2,")
    yield bad("slip-rate-with-a-comma", observer('rate = "2,5"'), "observer.rate", "write 2.5.")
    yield bad(
        "slip-time-in-ms", swap("t_final = 20.0", 't_final = "20ms"'), "simulation.t_final", "0.02,"
    )
    yield expression("slip-sat", "sat(y)", "did you mean", "clip(y, -1, 1)")
    yield expression("slip-shifted", "2*tanh(y-1)", "about -1.52", "offsets")
    yield expression("slip-minus-of-a-text", "2*tanh(y) \u2212 y/10", "2*tanh(y) - y/10")
    yield expression("slip-x-for-y", "tanh(x)", "is called y here", "tanh(y)")
    yield expression("slip-both-states", "2*tanh(xj - xi)", "write y for it")
    yield bad(
        "slip-region-of-one-number",
        swap("initial_states = [0, 5]", "initial_states = 5"),
        "region.initial_states",
        "every start from",
    )
    yield bad(
        "slip-region-backwards",
        swap("initial_states = [0, 5]", "initial_states = [5, 0]"),
        "region.initial_states",
        "exchange",
    )
    yield bad("slip-gains-in-a-list", swap(GAINS, "gains = [2, 2]"), "pinning.gains", "whose")
    yield bad(
        "slip-pins-and-a-gain",
        swap(GAINS, "agents = [1, 2]\nk = 2"),
        "pinning.agents",
        "gains = { 1 =",
    )
    yield bad("slip-no-arrow", without('arrow = "listens_to"'), "network.arrow", "listens_to")
    yield bad(
        "slip-frequency-below-0", kind("frequencies = [-2]"), "exosystem.frequencies[0]", "write 2:"
    )


SLIPS = list(_slips())


def _bad_files() -> Iterator[BadFile]:
    yield from _toml_and_bytes()
    yield from UNKNOWN_KEYS
    yield from _groups_and_kinds()
    yield from _missing_or_of_a_wrong_kind()
    yield from _network()
    yield from _expressions()
    yield from _numbers()
    yield from _matrices()
    yield from _pins_and_formation()
    yield from _switching()
    yield from _starts()
    yield from _arc_files()
    yield from SLIPS


BAD_FILES = list(_bad_files())


def labels(*last: str) -> str:
    return agents(f"[1, 2, 3, 4, {', '.join(last)}]")


def _valid_but_nasty() -> Iterator[BadFile]:
    yield bad("plain", VALID)
    yield bad("label-script", labels('"<script>alert(1)</script>"'))
    yield bad("label-image", labels("""'"><img src=x onerror="alert(1)">'"""))
    yield bad("label-latex", labels(r"'$\frac{'", r"'\input{x}'", "'a_b^c%'"))
    yield bad("label-markdown", labels('"[x](javascript:alert(1))"', '"| a | b |"', '"`code`"'))
    yield bad("label-dotted", labels('"a.b"', '"a[0]"', '" spaced "'))
    yield bad("label-unicode", labels('"Zürich"', '"東京"', '"🛰"', '"e\u0301"', '"\u00f6"'))
    yield bad("label-of-200-letters", labels('"' + "x" * 200 + '"'))
    yield bad("mode-markup", swap(GB, GB.replace("Gb", '"<b>G & b</b>"')))
    yield bad("mode-without-arcs", swap(GB, "Gb = []"))
    yield bad("name-markup", swap("four-agents", "<script>alert(1)</script>"))
    yield bad(
        "switching-in-rounds", signal("periodic", 'sequence = ["Gb", "Ga", "Gb"]', "period = 1.5")
    )
    yield bad(
        "switching-in-uneven-rounds",
        signal("periodic", 'schedule = [[0, "Gb"], ["1/3", "Ga"]]', "period = 1"),
    )
    yield bad("switching-markov", signal("markov", 'generator = [["-1/3", "1/3"], [0, 0]]'))
    yield bad("switching-schedule", signal("schedule", 'schedule = [[0, "Ga"], [1e-3, "Gb"]]'))
    yield bad("switching-mobile", signal("mobile", "radius = 2.5", "hysteresis = 0"))
    yield bad("switching-nearest", signal("mobile", "neighbours = 2", "dwell = 1"))
    yield bad("guarantee-arbitrary", guarantee("arbitrary"))
    yield bad("guarantee-dwell", guarantee("dwell", "dwell = 0.5", 'longest = "1/2"'))
    yield bad("guarantee-dwell-of-a-chain", guarantee("dwell", 'signal = "markov"', "dwell = 0.5"))
    yield bad(
        "guarantee-sequence",
        guarantee("sequence", 'sequence = ["Gb", "Ga", "Gb"]', "dwell = [1, 2, 0.5]"),
    )
    yield bad("guarantee-sequence-of-all", guarantee("sequence", "dwell = 0.5"))
    yield bad("x0-for-all", below("[simulation]", "x0 = [2]"))
    yield bad("x0-each-a-row", below("[simulation]", "x0 = [[1], [2], [3], [4]]"))
    yield bad("line-ends-of-windows", VALID.replace("\n", "\r\n"))
    yield bad("byte-order-mark", b"\xef\xbb\xbf" + VALID.encode())
    yield bad("quotes-at-the-end-of-a-long-text", top('notes = ["""a"""", "b"]'))
    yield bad("brackets-in-text-and-comments", top("# " + "[" * 200 + "'\"") + "# '''" + "{" * 200)
    yield bad("number-negative-zero", target("-0.0"))
    yield bad("number-underscores", target("1_000.000_5"))
    yield bad("number-of-150-digits", target('"1.' + "3" * 150 + '"'))
    yield bad("number-below-every-float", target('"1e-399"'))
    yield bad("number-above-every-float", target('"1e399"'))
    yield bad("weights-far-apart", mode("[[1, 2, 1e-20], [2, 3, 1e20], [3, 4], [4, 1]]"))
    yield bad("labels-mixed-in-arcs", mode('[["1", 2], [2, "3"], [3, 4], [4, 1]]'))
    yield bad("gain-zero", swap(GAINS, "gains = { 1 = 0, 3 = 5 }"))
    yield bad("gain-matrix", swap(GAINS, "gains = { 1 = [[5]] }"))
    yield bad("h-with-kinks", coupling("clip(y, -1, 1) + abs(y)/2 + max(y, 0)"))
    yield bad("h-vanishes-by-a-hair", coupling("(exp(y) - exp(-y))/3 + sin(y)**2"))
    yield bad("h-of-2000-characters", coupling("y" + " " * 1997 + "+y"))
    yield bad("h-depth-40", coupling("tanh(" * 40 + "y" + ")" * 40))
    yield bad("h-of-two-lines", swap(H, 'h = """\nexp(y) - 1\n  + y"""'))
    yield bad("P-not-definite", swap(P, "P = [[1, 2], [2, 1]]"))
    yield bad("rate-beside-W", swap(P, "rate = 1"))
    yield bad("arcs-file-below", mode('{ file = "data/arcs.csv" }'), files=BELOW)
    yield bad(
        "arcs-file-detour",
        mode('{ file = "data/../arcs.csv" }'),
        files={"arcs.csv": CSV, "data/other.csv": CSV},
    )
    yield bad(
        "arcs-file-of-windows",
        FROM_CSV,
        files={"arcs.csv": b"\xef\xbb\xbf" + CSV.replace(b"\n", b"\r\n")},
    )
    yield bad("arcs-file-quoted", FROM_CSV, files={"arcs.csv": b'"1","2"\n\n"2","3"\n3 , 4\n4,1\n'})
    yield bad(
        "arcs-file-exact-weights",
        FROM_CSV,
        files={"arcs.csv": b"1,2,9/16\n2,3,1e-3\n3,4,0.1\n4,1,2\n"},
    )


VALID_BUT_NASTY: list[BadFile] = list(_valid_but_nasty())


def write_case(case: BadFile, folder: Path) -> Path:
    """Write a case and the files beside it.  Raises OSError where links cannot be made
    (Windows)."""
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
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))
