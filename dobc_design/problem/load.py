"""Problem files and built-in problems: TOML in, a Problem out; every mistake named by its key, all
at once.

Nothing from the file is ever executed; numbers are read from their text.  Whatever the bytes are,
the time is linear in their number: strings are skipped without backtracking, and nesting is counted
before the TOML parser, which is recursive and quadratic in it, sees the text.
"""

import os
import re
import stat
import tomllib
from collections.abc import Callable, Set
from contextlib import suppress
from difflib import get_close_matches
from functools import partial
from importlib.resources import files
from itertools import takewhile
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar

from dobc_design._files import own_text
from dobc_design.coupling.coupling import Coupling, make_coupling
from dobc_design.errors import Mistakes, SpecError, about, refused, wrong
from dobc_design.exact.reading import (
    Document,
    NumberText,
    Table,
    Texts,
    is_list,
    is_text,
    named,
    shown,
)
from dobc_design.problem import arcs_file

from .canonical import problem_from_canonical
from .disturbances import read_exosystem
from .dynamics import Dynamics
from .exosystems import Exosystem
from .fixed import length_of
from .groups import Observer
from .network import (
    Arc,
    Arcs,
    Index,
    Network,
    arcs_from_pairs,
    check_arrow,
    joined,
    labels_of,
    one_form,
)
from .problem import Problem, dimension_of, is_name
from .schema import known_keys
from .schema_errors import Given, tables_of
from .switching import Switching

MAX_BYTES = 16 * 1024 * 1024
MAX_NESTING = 50
PROBLEM = "problem file"
SCHEMA_VERSION = 1
T = TypeVar("T")

# Strings and comments; possessive, so that no byte is looked at twice. A string that is not closed
# reaches to the end (of the line): the parser stops there anyway.
_TEXTS = re.compile(
    rb'"""(?:[^"\\]++|\\.|"(?!""))*+(?:"{3,5}|\Z)'
    rb"|'''(?:[^']++|'(?!''))*+(?:'{3,5}|\Z)"
    rb'|"(?:[^"\\\n]++|\\.)*+"?'
    rb"|'[^'\n]*+'?"
    rb"|#[^\n]*+",
    re.DOTALL,
)
_DOTTED_KEY = re.compile(rb"[A-Za-z0-9_\-' \t.]++")
_BRACKET = re.compile(rb"[\[\]{}]")
_KINDS = {stat.S_IFREG: "", stat.S_IFDIR: "folder", stat.S_IFIFO: "pipe"}


def read_bytes(path: Path, *, limit: int = MAX_BYTES, what: str = PROBLEM) -> bytes:
    """Read a regular file of at most ``limit`` bytes; ``what`` it ought to be is for messages.
    Raises: SpecError that names the file.  Pipes and devices are refused: they may never end, or
    never begin."""
    name = shown(path.name)
    try:
        state = path.stat()
        kind = _KINDS.get(stat.S_IFMT(state.st_mode), "device")
        data = b"" if kind or state.st_size > limit else path.read_bytes()
    except FileNotFoundError:
        known = " and no built-in problem of that name" if what == PROBLEM else ""
        cure = "`dobc problems` lists the built-in ones." if known else "Check the path."
        raise refused(path.name, f"there is no file {name}{known}.", cure) from None
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        reason = getattr(error, "strerror", None) or error
        raise refused(path.name, f"{name} cannot be read: {reason}.", "Check the path.") from None
    if kind:
        cure = "Name the file in it." if kind == "folder" else "Write it to a file first."
        raise refused(path.name, f"{shown(str(path))} is a {kind}, not a {what}.", cure)
    if max(state.st_size, len(data)) > limit:
        raise _too_large(limit, what)
    return data


def parse_toml(data: bytes) -> Document:
    """Parse TOML; numbers with a point or an exponent stay text.  Raises SpecError."""
    if len(data) > MAX_BYTES:
        raise _too_large(MAX_BYTES)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise SpecError(
            f"the problem file must be UTF-8 text; byte {error.start} is not.",
            cure="Save it as UTF-8.",
        ) from None
    if not text.strip():
        raise refused(
            "network",
            "the problem file is empty.",
            "Copy a built-in one to start from: `dobc problems`.",
        )
    _check_nesting(data)
    try:
        document = tomllib.loads(text, parse_float=NumberText)
    except RecursionError:
        raise _too_deep() from None
    except tomllib.TOMLDecodeError as error:
        raise SpecError(
            f"the problem file is not valid TOML: {error}.",
            cure="Check that line for a missing quote or bracket, a comma before }, a repeated "
            "key, or yes for true.",
        ) from None
    except ValueError:  # Python refuses to read a whole number of more than 4300 digits
        raise SpecError(
            "the problem file holds a whole number of thousands of digits.",
            cure="Numbers have at most 200 digits.",
        ) from None
    _check_depth(document)
    return document


def _check_nesting(data: bytes) -> None:
    """Refuse brackets, and dotted keys, that are nested too deeply for the parser."""
    # Brackets inside strings and comments do not nest.
    bare = _TEXTS.sub(b"''", data)
    depth = 0
    for match in _BRACKET.finditer(bare):
        depth = depth + 1 if match.group() in b"[{" else max(0, depth - 1)
        if depth > MAX_NESTING:
            raise _too_deep()
    if any(match.group().count(b".") >= MAX_NESTING for match in _DOTTED_KEY.finditer(bare)):
        raise _too_deep()


def _check_depth(document: Table) -> None:
    """Refuse tables that are nested too deeply, however they were written."""
    # Level by level, without recursion: this looks for what is too deep for it.
    level = [document]
    for _ in range(MAX_NESTING + 1):
        deeper: list[Any] = []
        for value in level:
            children = value.values() if isinstance(value, dict) else value
            deeper.extend(child for child in children if isinstance(child, (dict, list)))
        if not deeper:
            return
        level = deeper
    raise _too_deep()


def _too_large(limit: int, what: str = PROBLEM) -> SpecError:
    arcs = 'Keep long lists of arcs in a CSV file: Ga = { file = "arcs.csv" }.'
    cure = arcs if what == PROBLEM else "dobc_design writes no such file."
    return SpecError(f"the {what} is too large: at most {limit} bytes are read.", cure=cure)


def _too_deep() -> SpecError:
    return SpecError(
        f"the problem file is nested too deeply: at most {MAX_NESTING} levels are read.",
        cure="Flatten it.",
    )


def read_problem_file(path: Path) -> Problem:
    """Read a problem from a TOML file, or from a canonical problem.json.  Raises: SpecError naming
    key and cure."""
    suffix = path.suffix.lower()
    if suffix == ".json":  # it holds the arcs, too
        return problem_from_canonical(read_bytes(path, limit=arcs_file.MAX_BYTES), name=path.name)
    # a .txt may hold TOML
    if suffix in (*arcs_file.READERS, ".m") and suffix != ".txt" and path.is_file():
        kind, arrow = "a file of arcs", " --arrow listens_to (or sends_to)"
        if suffix == ".m":
            kind, arrow = "a MATPOWER case", ""
        raise refused(
            path.name,
            f"{shown(path.name)} is {kind}, not a problem file.",
            f"`dobc new NAME --from FILE{arrow}` makes a problem of it; in Python "
            "problem_from_file does.",
        )
    return read_problem_text(read_bytes(path), folder=path.resolve().parent, default_name=path.stem)


def read_problem_text(
    data: bytes, *, folder: Path | None, default_name: str = "problem"
) -> Problem:
    """Read a problem from the bytes of a TOML file; ``folder`` is where ``file = `` may look."""
    return read_problem_tables(parse_toml(data), folder=folder, default_name=default_name)


def read_problem_tables(document: Table, *, folder: Path | None, default_name: str) -> Problem:
    """Read a problem from the tables of a TOML file, as ``parse_toml`` gives them."""
    _check_version(document)
    tables = tables_of(document)
    # A file may be called in ways in which no problem may be.
    name = default_name if is_name(default_name) else "problem"
    if tables.name is not None:
        name = tables.name
    return _build(tables, folder=folder, name=name)


def _check_version(document: Table) -> None:
    """Refuse a file that a later version of the program wrote."""
    version = document.get("schema", SCHEMA_VERSION)
    if type(version) is not int or version < 1:
        raise wrong(
            "schema",
            f"must be the whole number {SCHEMA_VERSION}; got {shown(version)}.",
            f"Write schema = {SCHEMA_VERSION}.",
        )
    if version > SCHEMA_VERSION:
        raise wrong(
            "schema",
            f"must be at most {SCHEMA_VERSION}, the newest this program knows; got "
            f"{shown(version)}.",
            "Update dobc_design.",
        )


def _given(value: Any) -> Any:
    """A table as a dict; what is no table as it is."""
    return vars(value) if isinstance(value, Given) else value


def _noun(kind: Callable[..., T], table: Given | None) -> T | None:
    """The noun that a table states; None without the table."""
    return None if table is None else kind(**vars(table))


#: What is made into a noun here.  All else of a file is an argument of Problem, which reads it: a
#: key of that kind needs no line in this module.
_READ_HERE = (
    "schema",
    "name",
    "network",
    "coupling",
    "pinning",
    "exosystem",
    "observer",
    "formation",
    "switching",
    "dynamics",
)


def _build(tables: Given, *, folder: Path | None, name: str) -> Problem:
    """The nouns of all tables, and the Problem of them.  Raises: SpecError with every mistake."""
    errors = Mistakes()
    own = {} if tables.dynamics is None else dict(vars(tables.dynamics))
    time = own.pop("time", None)
    # The time alone says nothing about A and B.
    alone = time is not None and not any(own.values())
    dynamics = None if not own or alone else Dynamics(**own)

    def inputs(exosystem: Exosystem | None) -> int:
        if dynamics is not None:
            return dynamics.inputs
        states = tables.target or length_of(tables.fixed)
        return dimension_of(exosystem, states, tables.coupling.h)

    # What can be read is read, so that all mistakes of a file show at once.
    read = errors.tried(_network, tables, folder)
    given = errors.tried(read_exosystem, tables, inputs)
    observer = errors.tried(_noun, Observer, tables.observer)
    switching = errors.tried(_noun, Switching, tables.switching)
    if given is None:
        raise SpecError.several(errors)
    p = errors.tried(inputs, given.first)
    # Without arcs the mistakes of the other tables show all the same.
    network = _without_arcs(tables) if read is None else read
    if network is None or p is None:
        raise SpecError.several(errors)
    # With [dynamics] couplings take m states to p inputs; else both are the same.
    felt = p if dynamics is None else dynamics.felt
    divided = errors.tried(given.divided, network.labels, observer, dynamics)
    if divided is None:
        raise SpecError.several(errors)
    # W and P are those of the last group now
    if divided is not given and observer is not None:
        observer = None if observer.rate is None else Observer(rate=observer.rate)
    made = partial(make_coupling, dimension=felt, outputs=p)
    exceptions = None if read is None else errors.tried(_exceptions, tables, read, made)
    others = {
        key: _given(value)
        for key, value in vars(tables).items()
        if value is not None and key not in _READ_HERE
    }
    if given.bands:
        # What no exosystem generates is bounded with the rest of that kind.
        others["uncertainty"] = others.get("uncertainty", {}) | {"bands": given.bands}
    problem = errors.tried(
        Problem,
        name=name,
        network=network,
        coupling=tables.coupling.h,
        exceptions=exceptions,
        gains=None if tables.pinning is None else tables.pinning.gains,
        mode_gains=None if tables.pinning is None else tables.pinning.modes,
        exosystem=divided.exosystem,
        observer=observer,
        groups=divided.groups,
        offsets=None if tables.formation is None else tables.formation.offsets,
        switching=switching,
        dynamics=dynamics,
        time=time,
        **others,
    )
    if problem is None or errors:
        raise SpecError.several(errors)
    return problem


def _without_arcs(tables: Given) -> Network | None:
    """The agents and modes of a network whose arcs cannot be read; None where these cannot."""
    table = tables.network
    with suppress(SpecError):
        bare = dict.fromkeys(table.modes, ())
        fixed = tuple(tables.fixed or ())
        return Network.from_arcs(bare, arrow="listens_to", agents=table.agents, fixed=fixed)
    return None


def _network(tables: Given, folder: Path | None) -> Network:
    """[network]: labels, and the arcs of every mode.  Raises: SpecError with every mistake."""
    table = tables.network
    errors = Mistakes()
    errors.tried(check_arrow, table.arrow)
    labels = errors.tried(labels_of, table.agents)
    if labels is None or errors:
        raise SpecError.several(errors)
    fixed = tuple(map(one_form, tables.fixed or ()))
    index = {label: i for i, label in enumerate((*labels, *fixed))}
    read = partial(_mode, index=index, arrow=table.arrow, folder=folder)
    modes = {}
    for name, value in errors.few(table.modes.items()):
        with errors:
            modes[name] = _with_optional(value, read, key=f"network.modes.{named(name)}")
    if errors and not modes:
        raise SpecError.several(errors)
    # With what can be read, so that further mistakes show at once.
    network = errors.tried(
        Network, labels=labels, modes=modes, fixed=fixed, negative=table.negative
    )
    if network is None or errors:
        raise SpecError.several(errors)
    return network


def _with_optional(value: Any, read: Callable[..., Arcs], *, key: str) -> Arcs:
    """A mode; of one with optional arcs these are the last."""
    if not isinstance(value, dict) or "optional" not in value:
        return read(value, key=key)
    if set(value) != {"arcs", "optional"}:
        keys = ", ".join(map(shown, value))
        raise wrong(
            key,
            f"must have the keys arcs and optional, and no other; got {keys}.",
            "For example arcs = [[1, 2]] and optional = [[2, 3]].",
        )
    always = read(value["arcs"], key=f"{key}.arcs")
    return joined(always, read(value["optional"], key=f"{key}.optional"))


def _mode(value: Any, *, index: Index, arrow: str, key: str, folder: Path | None) -> Arcs:
    """The arcs of one list, or of the file that is named in its place."""
    if is_list(value):
        return arcs_from_pairs(value, index=index, arrow=arrow, key=key)
    known = isinstance(value, dict) and set(value) <= {"file", "merge", "drop_loops"}
    if not known or not is_text(value.get("file")):
        wanted = 'a list of arcs, { file = "arcs.csv" } or a table with arcs and optional'
        cure = 'For example [[1, 2], [2, 3]]; beside file may stand merge = "sum" and drop_loops '
        cure += "= true."
        name = key.rpartition(".")[2]
        if name in known_keys(""):  # a key of the top that stands below the last table
            cure = f"If {name} is no mode, write it above the first table."
        raise refused(key, f"{key} must be {wanted}; got {shown(value)}.", cure)
    repairs = {name: value[name] for name in ("merge", "drop_loops") if name in value}
    found = arcs_file.read_arcs_file(
        value["file"], folder=folder, index=index, arrow=arrow, key=f"{key}.file", **repairs
    )
    return found.arcs


def _exceptions(
    tables: Given, network: Network, made: Callable[..., Coupling]
) -> dict[Arc, Coupling]:
    """The couplings of single arcs; ``made`` makes one of its text."""
    given = tables.coupling.exceptions
    if not given:
        return {}
    # Numbers in place of pairs: a network may have a million arcs.
    codes = network.arc_codes()
    index = {label: node for node, label in enumerate(network.names)}
    result: dict[Arc, Coupling] = {}
    errors = Mistakes()
    for position, table in errors.few(enumerate(given)):
        key = f"coupling.exceptions[{position}]"
        pairs = []
        with errors:
            pairs = _exception_arcs(
                table.arcs, key=f"{key}.arcs", index=index, arrow=tables.network.arrow
            )
            seen = set()
            for place, arc in enumerate(pairs):
                taken = arc in result or arc in seen
                _check_exception(arc, network, codes, taken=taken, key=f"{key}.arcs[{place}]")
                seen.add(arc)
        with errors:
            result |= dict.fromkeys(pairs, made(table.h, key=f"{key}.h"))
    errors.raise_all()
    return result


def _check_exception(arc: Arc, network: Network, codes: Set[int], *, taken: bool, key: str) -> None:
    """Refuse an arc that is not there, or is taken: it has an exception.  Raises: SpecError."""
    listener, speaker = arc
    labels = network.names
    names = f"{named(labels[listener])} listens to {named(labels[speaker])}"
    if listener * len(labels) + speaker not in codes:
        turned = speaker * len(labels) + listener in codes
        end = "; it is there the other way round." if turned else "."
        raise about(
            key,
            f"no mode has the arc in which {names}{end}",
            "Correct the arc, or remove the exception.",
        )
    if taken:
        raise about(key, f"the arc in which {names} has an exception already.", "Keep one of them.")


def _exception_arcs(value: Any, *, key: str, index: Index, arrow: str) -> list[Arc]:
    """The arcs of [[coupling.exceptions]] as pairs (listener, speaker)."""
    if not is_list(value) or not value:
        raise wrong(
            key, f"must be a list of arcs; got {shown(value)}.", "For example [[1, 2], [2, 3]]."
        )
    # A weight here would be ignored, which nobody would notice.
    for place, arc in enumerate(value):
        if is_list(arc) and len(arc) == 3:
            raise wrong(
                f"{key}[{place}]",
                "must be [a, b]; the weight stands with the arc in its mode.",
                "Drop the third entry.",
            )
    arcs = arcs_from_pairs(value, index=index, arrow=arrow, key=key)
    return list(zip(arcs.listeners.tolist(), arcs.speakers.tolist(), strict=True))


SUFFIX = ".toml"


def builtin_names() -> Texts:
    """Names of the built-in problems, in the order they are best read."""
    folder = files("dobc_design.problems")
    # The examples of the paper come first, all others by name.
    names = sorted(
        item.name[: -len(SUFFIX)] for item in folder.iterdir() if item.name.endswith(SUFFIX)
    )
    return tuple(sorted(names, key=lambda name: name not in ("paper-fixed", "paper-switching")))


def builtin_text(name: str) -> str:
    """The problem file of that name, as text."""
    return own_text(f"problems/{name}{SUFFIX}")


def builtin_summary(name: str) -> str:
    """The first sentence of the comment a built-in problem opens with."""
    lines = takewhile(lambda line: line.startswith("#"), builtin_text(name).splitlines())
    return " ".join(line.lstrip("# ").strip() for line in lines).split(". ", 1)[0].rstrip(".") + "."


Source = Problem | str | PathLike[str]


def load_problem(source: Source) -> Problem:
    """Read a problem file (TOML, or a canonical problem.json), or a built-in problem by its name.

    A file of that name in the current folder wins over a built-in problem; a Problem is returned as
    it is.
    Returns: a Problem.  Raises: SpecError that names every wrong key and its cure.
    Example:
        >>> dd.load_problem("paper-fixed").n
        10
    """
    if isinstance(source, Problem):
        return source
    _require_source(source)
    path = Path(source)
    if isinstance(source, str) and not os.path.isfile(source):  # unlike Path, it takes any text
        if source in builtin_names():
            return read_problem_text(
                builtin_text(source).encode("utf-8"), folder=None, default_name=source
            )
        near = get_close_matches(source[:100], builtin_names(), n=1)
        if near and not os.path.exists(source):
            raise refused(
                path.name,
                f"there is no file {shown(source)} and no built-in problem of that name.",
                f"did you mean {near[0]}?",
            )
    return read_problem_file(path)


def _require_source(source: object) -> None:
    """Raises: TypeError for what is neither a path nor a name."""
    if not isinstance(source, str | PathLike):
        cure = " From a dict: Problem(**arguments)." if isinstance(source, dict) else ""
        raise TypeError(
            "a problem is a Problem, the path of a problem file or the name of a built-in problem; "
            f"got {type(source).__name__}.{cure}"
        )


def source_text(source: str | PathLike[str]) -> str | None:
    """The TOML that ``load_problem`` reads for this source; None for a problem.json.  Raises:
    SpecError."""
    path = Path(source)
    if isinstance(source, str) and not os.path.isfile(source) and source in builtin_names():
        return builtin_text(source)
    return None if path.suffix.lower() == ".json" else read_bytes(path).decode("utf-8-sig")
