"""The tables and keys of the problem file, as pydantic models: one place for the reader and the JSON Schema.

The models check which keys exist and of what kind their values are.  What the values mean together is
checked by the nouns (``spec.problem``); numbers stay as they were typed until ``parse_number`` reads them.
"""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, PlainValidator, WithJsonSchema

SCHEMA_VERSION = 1

_NUMBER = {
    "description": "An exact number: 3.2 means 16/5; fractions are written in quotes.",
    "anyOf": [{"type": "number"}, {"type": "string", "pattern": r"^[+-]?[0-9.eE+/-]+$", "maxLength": 200}],
}
_MATRIX = {"type": "array", "items": {"type": "array", "items": _NUMBER, "minItems": 1}, "minItems": 1}
_LABEL = {"anyOf": [{"type": "string"}, {"type": "integer"}]}
_ARC = {
    "type": "array", "minItems": 2, "maxItems": 3,
    "description": "[a, b] or [a, b, weight]; network.arrow says who listens.",
    "items": {"anyOf": [{"type": "string"}, {"type": "number"}]},
}  # fmt: skip
_COUPLING = {
    "description": "In y, applied by component; or a list of m expressions in y1..ym.",
    "anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}, "minItems": 1}],
}


def _any(schema: dict[str, Any]) -> Any:
    """Accept any value here and describe it by ``schema``; the nouns read it and name the key."""
    return Annotated[Any, PlainValidator(lambda value: value), WithJsonSchema(schema)]


def _table(value: Any) -> Any:
    if not isinstance(value, dict):
        raise ValueError(f"must be a table; got {str(value)[:60]}")
    return value


Number = _any(_NUMBER)
NumberMatrix = _any(_MATRIX)
CouplingText = _any(_COUPLING)
Agents = _any({"anyOf": [{"type": "integer", "minimum": 1}, {"type": "array", "items": _LABEL, "minItems": 1}]})
NumberOrList = _any({"anyOf": [_NUMBER, {"type": "array", "items": _NUMBER, "minItems": 1}]})
Modes = Annotated[
    Any,
    PlainValidator(_table),
    WithJsonSchema(
        {
            "type": "object", "minProperties": 1,
            "additionalProperties": {
                "anyOf": [
                    {"type": "array", "items": _ARC},
                    {"type": "object", "properties": {"file": {"type": "string"}}, "required": ["file"],
                     "additionalProperties": False},
                ]
            },
        }  # fmt: skip
    ),
]
Gains = _any({"anyOf": [_NUMBER, {"type": "object", "additionalProperties": {"anyOf": [_NUMBER, _MATRIX]}}]})
Offsets = Annotated[
    Any,
    PlainValidator(_table),
    WithJsonSchema(
        {"type": "object", "additionalProperties": {"anyOf": [_NUMBER, {"type": "array", "items": _NUMBER}]}}
    ),
]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)


class NetworkTable(_Table):
    """[network]: who is there and who listens to whom."""

    agents: Agents = Field(description="A count (labels 1..n) or a list of labels.")
    arrow: Annotated[
        Any,
        PlainValidator(lambda value: value),
        WithJsonSchema({"enum": ["listens_to", "sends_to"], "description": "What [a, b] means."}),
    ]
    modes: Modes = Field(description="At least one; several mean switching.")


class ExceptionTable(_Table):
    """[[coupling.exceptions]]: another h on some arcs, in every mode that has them."""

    arcs: Annotated[
        Any, PlainValidator(lambda value: value), WithJsonSchema({"type": "array", "items": _ARC, "minItems": 1})
    ]
    h: CouplingText


class CouplingTable(_Table):
    """[coupling]: the function h that every arc applies to x_j - x_i."""

    h: CouplingText
    exceptions: list[ExceptionTable] = []


class PinningTable(_Table):
    """[pinning]: the gains k_i."""

    gains: Gains = Field(default=None, description="Label -> k, or one number for all agents.")


class ExosystemTable(_Table):
    """[exosystem]: xi' = A xi, d = C xi."""

    A: NumberMatrix
    C: NumberMatrix


class ObserverTable(_Table):
    """[observer]: W (and P, to be tested as it is), or the rate asked of a designed W."""

    W: NumberMatrix = None
    P: NumberMatrix = None
    rate: Number = None


class FormationTable(_Table):
    """[formation]: agent i goes to target + offset_i."""

    offsets: Offsets = {}


class RegionTable(_Table):
    """[region]: what the certificate has to cover."""

    initial_states: _any(  # type: ignore[valid-type]
        {"type": "array", "description": "[lo, hi] for every component, or m such pairs."}
    )
    initial_disturbance: Number = None


class SwitchingTable(_Table):
    """[switching]: the signal that drives the modes."""

    signal: Annotated[
        Any,
        PlainValidator(lambda value: value),
        WithJsonSchema({"enum": ["random", "periodic", "markov", "schedule", "mobile"]}),
    ]
    dwell: Number = Field(default=None, description="s")


class SimulationTable(_Table):
    """[simulation]: settings of simulations; they never enter a proof."""

    t_final: Number = Field(default=None, description="s")
    seed: Annotated[Any, PlainValidator(lambda v: v), WithJsonSchema({"type": "integer", "minimum": 0})] = None
    xi0: _any({"type": "array"}) = None  # type: ignore[valid-type]


class ProblemFile(_Table):
    """A dobc_design problem file."""

    schema_: Annotated[
        Any, PlainValidator(lambda v: v), WithJsonSchema({"type": "integer", "const": SCHEMA_VERSION})
    ] = Field(default=SCHEMA_VERSION, alias="schema")
    name: Annotated[Any, PlainValidator(lambda v: v), WithJsonSchema({"type": "string", "maxLength": 100})] = None
    notes: Annotated[
        Any, PlainValidator(lambda v: v), WithJsonSchema({"type": "array", "items": {"type": "string"}})
    ] = Field(default=(), description="What is assumed or stands in; shown wherever a result is shown.")
    target: NumberOrList = Field(default=0, description="xbar: a number, or m numbers.")
    network: NetworkTable
    coupling: CouplingTable
    pinning: PinningTable | None = None
    exosystem: ExosystemTable | None = None
    observer: ObserverTable | None = None
    formation: FormationTable | None = None
    region: RegionTable | None = None
    switching: SwitchingTable | None = None
    simulation: SimulationTable | None = None


RESERVED = {
    "exosystem.groups", "exosystem.kind", "switching.sequence", "switching.period", "switching.generator",
    "switching.schedule", "switching.radius", "switching.neighbours", "switching.hysteresis", "simulation.x0",
    "dynamics", "delays",
}  # fmt: skip


def json_schema() -> dict[str, Any]:
    """The JSON Schema of the problem file, for editors and for `dobc schema`."""
    schema = ProblemFile.model_json_schema(by_alias=True)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}
