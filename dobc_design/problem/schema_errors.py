"""What pydantic finds wrong with the tables of a problem file, said of the file: which key, what it
must be, and a line to copy.
"""

import re
from collections.abc import Iterable, Iterator
from difflib import get_close_matches
from functools import cache
from itertools import islice
from typing import Any

from pydantic import ValidationError

from dobc_design.errors import MOST_ERRORS, SpecError, wrong
from dobc_design.exact.reading import Document, Texts, named, shown

from .schema import ProblemFile

Location = tuple[int | str, ...]

EXAMPLES = {
    "network": "[network] with agents, arrow and, below it, [network.modes]",
    "network.agents": 'agents = 10, or agents = ["lead", "wing"]',
    "network.arrow": 'arrow = "listens_to" when [a, b] means that a hears b, else arrow = '
    '"sends_to"',
    "network.modes": "[network.modes] and below it Ga = [[1, 2], [2, 3]]",
    "coupling": '[coupling] and below it h = "exp(y) - 1 + y"',
    "coupling.h": 'h = "exp(y) - 1 + y"',
    "coupling.exceptions": '[[coupling.exceptions]] and below it arcs = [[1, 2]] and h = "2*y"',
    "coupling.exceptions.arcs": "arcs = [[1, 2]]",
    "coupling.exceptions.h": 'h = "2*y"',
    "pinning": "[pinning] and below it gains = { 1 = 5.0, 6 = 2 }",
    "pinning.gains": "gains = { 1 = 5.0, 6 = 2 }: the label of an agent, and its gain",
    "exosystem": "[exosystem] and below it A = [[0, 2], [-2, 0]] and C = [[1, 0]]",
    "exosystem.A": "A = [[0, 2], [-2, 0]]",
    "exosystem.C": "C = [[1, 0]]",
    "exosystem.groups": "[[exosystem.groups]] and below it agents = [1, 2], A = [[0]] and "
    "C = [[1]]",
    "exosystem.groups.agents": "agents = [1, 2]",
    "formation.offsets": "offsets = { 2 = 1.5, 3 = -1.5 }",
    "region.initial_states": "initial_states = [0, 5]",
    "leader.initial": "initial = [[0, 1], [-1, 1]]",
    "readings": "[readings] and below it delay = 0.1",
    "processor": "[processor] and below it period = 0.02",
    "processor.period": "period = 0.02",
}


def explain(error: ValidationError) -> SpecError:
    """Turn what pydantic found into one error that names every key (the first twenty)."""
    items = _causes(error.errors(include_url=False))
    return SpecError.several([_explain(item) for item in islice(items, MOST_ERRORS)])


def _causes(items: Iterable[Any]) -> Iterator[Any]:
    """What pydantic found, once for each cause: all that stands in a table in place of its main key
    is one mistake."""
    told = set()
    for item in items:
        table = _without_places(key_text(item["loc"][:-1]))
        if table not in told:
            yield item
        if _main_key(table) is not None:
            told.add(table)


def _explain(item: Any) -> SpecError:
    """One mistake, said of its key."""
    location, value = item["loc"], item["input"]
    key = key_text(location)
    if item["type"] == "extra_forbidden":
        return _unknown_key(key, location)
    example = f"Write {EXAMPLES.get(_without_places(key), f'[{key}] and its keys below')}."
    if item["type"] == "missing":
        return wrong(key, "is required and missing.", example)
    kind = "list of tables" if item["type"] == "list_type" else "table"
    return wrong(key, f"must be a {kind}; got {shown(value)}.", example)


def key_text(location: Location) -> str:
    """Write a location as the user would: tables dotted, places in a list as [0]."""
    text = ""
    for part in location:
        if isinstance(part, int):
            text += f"[{part}]"
        elif text:
            text += f".{named(part)}"
        else:
            text = named(part)
    return text


def _without_places(key: str) -> str:
    """The key without the places in lists: exosystem.groups.A."""
    return re.sub(r"\[\d+\]", "", key)


def _unknown_key(key: str, location: Location) -> SpecError:
    """Says which key may be meant, or in which table it belongs."""
    table, name = key_text(location[:-1]), str(location[-1])
    what = f"is an unknown key in [{table}]" if table else "is an unknown key"
    known = known_keys(_without_places(table))
    place = f" in [{table}]" if table else ""
    cure = f"Known keys{place}: {', '.join(known)}."
    if name in known_keys(""):
        head = f"Write [{name}] as the head of a table of its own."
        cure = head if name in _tables() else "Write it above the first table."
        return wrong(key, f"{what}; it belongs to the top of the file.", cure)
    # Other capitals first: for difflib "a" and "A" have nothing in common.
    near = [other for other in known if other.lower() == name.lower()]
    near += get_close_matches(name[:100], known, n=1, cutoff=0.7)
    if near:
        return wrong(key, f'{what}; did you mean "{near[0]}"?', cure)
    main = _main_key(_without_places(table))
    if main is not None:
        cure = f"Write {EXAMPLES.get(f'{table}.{main}', main)}."
        return wrong(key, f"{what}, where {main} is written.", cure)
    homes = [f"[{home}]" for home in _tables() if home and name in known_keys(home)]
    if homes:
        return wrong(key, f"{what}; it belongs in {' or '.join(homes)}.", cure)
    return wrong(key, f"{what}.", cure)


def _main_key(table: str) -> str | None:
    """What is meant by other keys of a table; None where it may be one of several."""
    known = known_keys(table)
    return known[0] if len(known) == 1 or table == "pinning" else None


@cache
def _tables() -> dict[str, Texts]:
    """The keys of every table, by its name; "" is the top of the file."""
    # From the schema, so that no table is listed twice.
    schema = ProblemFile.model_json_schema(by_alias=True)
    tables = {}

    def walk(name: str, properties: Document) -> None:
        tables[name] = tuple(properties)
        for key, node in properties.items():
            items = node.get("items", {})
            for choice in (node, items, *node.get("anyOf", ())):
                if "$ref" in choice:
                    child = schema["$defs"][choice["$ref"].rsplit("/", 1)[1]]
                    walk(f"{name}.{key}" if name else key, child["properties"])

    walk("", schema["properties"])
    return tables


def known_keys(table: str) -> Texts:
    """The keys that a table may have; "" is the top of the file."""
    return _tables().get(table, ())
