"""The JSON Schema: what `dobc schema` prints agrees with the reader and with the contract."""

import json
import re
import tomllib
from functools import cache
from typing import Any

import pytest
from bad_files import BAD_FILES, UNKNOWN_KEYS, VALID, VALID_BUT_NASTY

from dobc_design.problem.exosystems import PARTS
from dobc_design.problem.load import SCHEMA_VERSION, builtin_names, builtin_text
from dobc_design.problem.network import ARROWS, LONGEST_LABEL, MOST_AGENTS
from dobc_design.problem.region import LONGEST_UNIT
from dobc_design.problem.schema import json_schema, known_keys
from dobc_design.problem.switching import GUARANTEES, KEYS, SIGNALS

TABLES = (
    "network",
    "coupling",
    "pinning",
    "exosystem",
    "observer",
    "formation",
    "region",
    "switching",
    "simulation",
)
TABLES += ("uncertainty", "actuators", "dynamics", "leader", "readings", "processor")
CONTRACT = {
    "": {"schema", "name", "notes", "target", "units", "goal", "fixed", *TABLES},
    "network": {"agents", "arrow", "modes", "negative"},
    "coupling": {"h", "exceptions"},
    "coupling.exceptions": {"arcs", "h"},
    "pinning": {"gains", "modes"},
    "exosystem": {"A", "C", "groups", "bands", "bands_hz", "amplitude", "pairs", *PARTS},
    "exosystem.groups": {"agents", "none", "A", "C", "W", "P", *PARTS},
    "observer": {"W", "P", "rate"},
    "formation": {"offsets"},
    "region": {"initial_states", "initial_disturbance"},
    "switching": {
        "signal",
        "guarantee",
        "dwell",
        "longest",
        *(key for keys in KEYS.values() for key in keys),
    },
    "simulation": {"t_final", "seed", "xi0", "x0"},
    "uncertainty": {
        "weights",
        "gains",
        "known_to_agents",
        "disturbance",
        "drift",
        "measurement",
    },
    "actuators": {"limit", "amplitude", "saturates", "delay"},
    "dynamics": {"A", "f", "B", "H", "acts_on", "time"},
    "readings": {"delay", "own_delay", "period", "lost", "event"},
    "processor": {"period"},
    "leader": {"initial", "stays_in"},
}


def table(schema: dict[str, Any], path: str) -> dict[str, Any]:
    node = schema
    for part in filter(None, path.split(".")):
        node = node["properties"][part]
        items = node.get("items", {})
        choices = (node, items, *node.get("anyOf", ()))
        reference = next(choice["$ref"] for choice in choices if "$ref" in choice)
        node = schema["$defs"][reference.removeprefix("#/$defs/")]
    return node


@pytest.mark.parametrize("path", sorted(CONTRACT))
def test_every_table_has_the_keys_of_the_contract_and_no_other(path):
    node = table(json_schema(), path)
    assert set(node["properties"]) == CONTRACT[path]
    assert set(known_keys(path)) == CONTRACT[path]
    assert node["additionalProperties"] is False


REQUIRED = {"": {"network", "coupling"}, "network": {"agents", "arrow", "modes"}}
REQUIRED |= {"processor": {"period"}, "coupling": {"h"}, "coupling.exceptions": {"arcs", "h"}}
REQUIRED |= {"exosystem.groups": {"agents"}, "region": {"initial_states"}, "leader": {"initial"}}


def test_what_must_be_there_is_required():
    schema = json_schema()
    for path in CONTRACT:
        required = table(schema, path).get("required", ())
        assert set(required) == REQUIRED.get(path, set())


WORDS = [{part} for part in PARTS]
BANDS = [{key, "amplitude"} for key in ("bands", "bands_hz")]
WAYS = [("exosystem", [{"A", "C"}, *WORDS, *BANDS, {"groups"}])]
WAYS.append(("exosystem.groups", [{"A", "C"}, *WORDS, {"none"}]))


@pytest.mark.parametrize(("path", "ways"), WAYS)
def test_an_exosystem_is_given_by_matrices_in_words_or_by_groups(path, ways):
    alternatives = table(json_schema(), path)["anyOf"]
    assert [set(way["required"]) for way in alternatives] == ways


def test_words_to_choose_from_are_those_of_the_reader():
    ways = [set(way["required"]) for way in table(json_schema(), "switching")["anyOf"]]
    assert ways == [{"signal"}, {"guarantee"}]
    schema = json_schema()
    assert table(schema, "network")["properties"]["arrow"]["enum"] == list(ARROWS)
    assert table(schema, "switching")["properties"]["signal"]["enum"] == list(SIGNALS)
    assert table(schema, "switching")["properties"]["guarantee"]["enum"] == list(GUARANTEES)


def test_limits_of_the_schema_are_those_of_the_reader():
    forms = json_schema()["$defs"]
    assert forms["version"]["const"] == SCHEMA_VERSION
    assert forms["agents"]["anyOf"][0]["maximum"] == MOST_AGENTS
    assert forms["label"]["anyOf"][0]["maxLength"] == LONGEST_LABEL
    assert forms["unit"]["maxLength"] == LONGEST_UNIT


def test_the_schema_is_plain_json_that_names_its_dialect():
    schema = json_schema()
    assert json.loads(json.dumps(schema)) == schema
    assert schema["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    assert json_schema() is not schema


@cache
def validator() -> Any:
    jsonschema = pytest.importorskip("jsonschema")
    schema = json_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


@pytest.mark.parametrize("name", builtin_names())
def test_built_in_problems_are_valid_by_the_schema(name):
    validator().validate(tomllib.loads(builtin_text(name)))


def test_valid_files_are_valid_by_the_schema():
    check = validator()
    for case in VALID_BUT_NASTY:
        check.validate(tomllib.loads(case.data().decode("utf-8-sig")))


@pytest.mark.parametrize("case", UNKNOWN_KEYS, ids=lambda case: case.id)
def test_unknown_keys_are_invalid_by_the_schema(case):
    document = tomllib.loads(case.data().decode("utf-8"))
    assert not validator().is_valid(document)


def test_most_mistakes_of_kind_are_invalid_by_the_schema():
    """A schema cannot know labels or shapes; it can know tables, lists, texts, numbers and missing
    keys."""
    check = validator()
    wanted = re.compile(
        r"^no-(network|agents|arrow|modes|coupling|h|A|C|initial-states|signal)$|^(name|schema|notes)-n"
        r"|^(agents|arrow|seed|gain)-(boolean|text|list|zero)|^h-(number|table)|^xi0-number|^A-(flat|text)"
    )
    tried = 0
    for case in BAD_FILES:
        if wanted.search(case.id):
            tried += 1
            document = tomllib.loads(case.data().decode("utf-8"))
            assert not check.is_valid(document), case.id
    assert tried > 4
    check.validate(tomllib.loads(VALID))
