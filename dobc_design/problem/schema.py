"""The tables and keys of the problem file, as ``keys.toml`` lists them: for the reader, its
messages and the JSON Schema."""

from dobc_design._files import own_table
from dobc_design.exact.reading import Document, Texts

from .dynamics import ACTS_ON
from .exosystems import KINDS
from .network import ARROWS
from .readings import TIMES
from .region import GOALS
from .signs import NEGATIVE
from .switching import GUARANTEES, SIGNALS

_KEYS = own_table("problem/keys.toml")
TABLES: Document = _KEYS["tables"]
EXAMPLES: dict[str, str] = _KEYS["examples"]
_NAMES = {
    "acts_on": ACTS_ON,
    "arrow": ARROWS,
    "goal": GOALS,
    "guarantee": GUARANTEES,
    "kind": KINDS,
    "negative": NEGATIVE,
    "signal": SIGNALS,
    "time": TIMES,
}
FORMS: Document = _KEYS["forms"] | {name: {"enum": [*each]} for name, each in _NAMES.items()}


def known_keys(table: str) -> Texts:
    """The keys that a table may have; "" is the top of the file."""
    return tuple(TABLES.get(table, {"keys": ()})["keys"])


def below(table: str, key: str) -> str:
    """The name of a key, or of the table under it: network.agents."""
    return f"{table}.{key}" if table else key


def json_schema() -> Document:
    """The JSON Schema of the problem file, for editors and for `dobc schema`."""
    tables = {name: _table_schema(name) for name in TABLES}
    top = tables.pop("")
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **top,
        "$defs": {**FORMS, **tables},
    }


def _table_schema(name: str) -> Document:
    table = TABLES[name]
    schema = {
        "type": "object",
        "description": table["says"],
        "properties": {
            key: _key_schema(below(name, key), *each) for key, each in table["keys"].items()
        },
        "required": table.get("needed", []),
        "additionalProperties": False,
    }
    if "ways" in table:
        schema["anyOf"] = [{"required": keys} for keys in table["ways"]]
    return schema


def _key_schema(name: str, form: str, says: str = "") -> Document:
    own = {"$ref": f"#/$defs/{name}"}
    schema: Document = {"table": own, "tables": {"type": "array", "items": own}, **FORMS}[form]
    return schema | {"description": says} if says else schema
