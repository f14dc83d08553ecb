"""What a user is told when the tables of a problem file are not those of the schema."""

from __future__ import annotations

import difflib
import re
from functools import cache
from itertools import islice
from typing import Any

from pydantic import ValidationError

from dobc_design.errors import SpecError
from dobc_design.exact.reading import MOST_ERRORS, named, shown
from dobc_design.problem.schema import RESERVED, ProblemFile

Location = tuple[int | str, ...]

_EXAMPLES = {
    "network": "[network] with agents, arrow and, below it, [network.modes]",
    "network.agents": "agents = 10",
    "network.arrow": 'arrow = "listens_to" when [a, b] means that a hears b, else arrow = "sends_to"',
    "network.modes": "[network.modes] and below it Ga = [[1, 2], [2, 3]]",
    "coupling": '[coupling] and below it h = "exp(y) - 1 + y"',
    "coupling.h": 'h = "exp(y) - 1 + y"',
    "coupling.exceptions": '[[coupling.exceptions]] and below it arcs = [[1, 2]] and h = "2*y"',
    "coupling.exceptions.arcs": "arcs = [[1, 2]]",
    "coupling.exceptions.h": 'h = "2*y"',
    "pinning": "[pinning] and below it gains = { 1 = 5.0, 6 = 2 }",
    "exosystem": "[exosystem] and below it A = [[0, 2], [-2, 0]] and C = [[1, 0]]",
    "exosystem.A": "A = [[0, 2], [-2, 0]]",
    "exosystem.C": "C = [[1, 0]]",
    "exosystem.groups": "[[exosystem.groups]] and below it agents = [1, 2], A = [[0]] and C = [[1]]",
    "exosystem.groups.agents": "agents = [1, 2]",
    "formation.offsets": "offsets = { 2 = 1.5, 3 = -1.5 }",
    "region.initial_states": "initial_states = [0, 5]",
    "switching.signal": 'signal = "random"',
}


def explain(error: ValidationError) -> SpecError:
    """Turn what pydantic found into one error that names every key (the first twenty)."""
    items = error.errors(include_url=False)
    return SpecError.several([_explain(item) for item in islice(items, MOST_ERRORS)])


def _explain(item: Any) -> SpecError:
    location, value = item["loc"], item["input"]
    key = key_text(location)
    if item["type"] == "extra_forbidden":
        return _unknown_key(key, location)
    if item["type"] == "missing":
        return SpecError(f"{key} is required and missing.", key=key, cure=f"Write {_example(key)}.")
    if item["type"] == "list_type":
        return SpecError(
            f"{key} must be a list of tables; got {shown(value)}.", key=key, cure=f"Write {_example(key)}."
        )
    return SpecError(f"{key} must be a table; got {shown(value)}.", key=key, cure=f"Write {_example(key)}.")


def key_text(location: Location) -> str:
    """Write a location as the user would: tables dotted, places in a list as [0]."""
    text = ""
    for part in location:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            name = named(part)
            text += f".{name}" if text else name
    return text


def _example(key: str) -> str:
    return _EXAMPLES.get(_without_places(key), f"[{key}] and its keys below")


def _without_places(key: str) -> str:
    return re.sub(r"\[\d+\]", "", key)


def _unknown_key(key: str, location: Location) -> SpecError:
    table, name = key_text(location[:-1]), str(location[-1])
    place = f" in [{table}]" if table else ""
    if _without_places(key) in RESERVED:
        return SpecError(
            f"{key} is an unknown key{place}: it is reserved for a later version.", key=key, cure="Remove it for now."
        )
    known = known_keys(_without_places(table))
    near = [other for other in known if other.lower() == name.lower()]
    near += difflib.get_close_matches(name[:100], known, n=1, cutoff=0.7)
    homes = [f"[{home}]" for home in _tables() if home and name in known_keys(home)]
    if near:
        hint = f'; did you mean "{near[0]}"?'
    elif homes:
        hint = f"; it belongs in {' or '.join(homes)}."
    else:
        hint = "."
    return SpecError(f"{key} is an unknown key{place}{hint}", key=key, cure=f"Known keys{place}: {', '.join(known)}.")


@cache
def _tables() -> dict[str, tuple[str, ...]]:
    """The keys of every table, by its name; "" is the top of the file."""
    schema = ProblemFile.model_json_schema(by_alias=True)
    tables: dict[str, tuple[str, ...]] = {}

    def walk(name: str, properties: dict[str, Any]) -> None:
        tables[name] = tuple(properties)
        for key, node in properties.items():
            items = node.get("items", {})
            for choice in (node, items, *node.get("anyOf", ())):
                if "$ref" in choice:
                    child = schema["$defs"][choice["$ref"].rsplit("/", 1)[1]]
                    walk(f"{name}.{key}" if name else key, child["properties"])

    walk("", schema["properties"])
    return tables


def known_keys(table: str) -> tuple[str, ...]:
    """The keys that a table may have; "" is the top of the file."""
    return _tables().get(table, ())
