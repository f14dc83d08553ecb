"""The tables and keys of the problem file, as pydantic models: one place for the reader and the
JSON Schema.

They check which keys exist.  Values are read by the nouns; numbers stay as they were typed until
then.
"""

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, WithJsonSchema

from dobc_design.exact.reading import Document

from .bands import KEYS
from .dynamics import ACTS_ON
from .exosystems import KINDS, PARTS
from .network import ARROWS, LONGEST_LABEL, MOST_AGENTS
from .readings import TIMES
from .region import GOALS, LONGEST_UNIT
from .signs import NEGATIVE
from .switching import GUARANTEES, SIGNALS

SCHEMA_VERSION = 1

_NUMBER = {
    "description": "An exact number: 3.2 means 16/5; fractions are written in quotes.",
    "anyOf": [
        {"type": "number"},
        {"type": "string", "pattern": r"^[+-]?[0-9.eE+/-]+$", "maxLength": 200},
    ],
}


def _any_list_of(items: Document) -> Document:
    """A list, which may be empty."""
    return {"type": "array", "items": items}


def _list_of(items: Document) -> Document:
    """A list of at least one item."""
    return _any_list_of(items) | {"minItems": 1}


def _pair_of(items: Document) -> Document:
    """A list of two items."""
    return _any_list_of(items) | {"minItems": 2, "maxItems": 2}


def _either(*choices: Document) -> Document:
    """One of several forms."""
    return {"anyOf": list(choices)}


def _table_of(*values: Document) -> Document:
    """A table with any keys."""
    return {"type": "object", "additionalProperties": _either(*values)}


_TEXT = {"type": "string"}
_NUMBERS, _INTERVAL = _list_of(_NUMBER), _pair_of(_NUMBER)
_MATRIX = _list_of(_NUMBERS)
_LABEL = _either(
    {"type": "string", "minLength": 1, "maxLength": LONGEST_LABEL}, {"type": "integer"}
)
_ARC = {
    "type": "array",
    "minItems": 2,
    "maxItems": 3,
    "description": "[a, b] or [a, b, weight]; network.arrow says who listens.",
    "prefixItems": [_LABEL, _LABEL, _NUMBER],
}
_FILE = {
    "type": "object",
    "properties": {
        "file": _TEXT,
        "merge": {"const": "sum", "description": "Add the weights of parallel arcs."},
        "drop_loops": {"type": "boolean", "description": "Leave out arcs from an agent to itself."},
    },
    "required": ["file"],
    "additionalProperties": False,
}
_ARCS = _either(_any_list_of(_ARC), _FILE)
_OPTIONAL = {
    "type": "object",
    "properties": {"arcs": _ARCS, "optional": _ARCS},
    "required": ["arcs", "optional"],
    "additionalProperties": False,
    "description": "optional: arcs that come and go at any time.",
}
_INSTANT = {"type": "array", "minItems": 2, "maxItems": 2, "prefixItems": [_NUMBER, _TEXT]}
_UNIT = {"type": "string", "minLength": 1, "maxLength": LONGEST_UNIT}
_NOTE = {"type": "string", "maxLength": 1000}


def _optional(description: str) -> Any:
    """A key that may be left out."""
    return Field(default=None, description=description)


# Any value will do here: the nouns read it and name the key.
Number = Annotated[Any, WithJsonSchema(_NUMBER)]
NumberMatrix = Annotated[Any, WithJsonSchema(_MATRIX)]
NumberOrList = Annotated[Any, WithJsonSchema(_either(_NUMBER, _NUMBERS))]
_COUPLING = {"description": "In y, applied by component; or a list of m expressions in y1..ym."}
CouplingText = Annotated[Any, WithJsonSchema(_COUPLING | _either(_TEXT, _list_of(_TEXT)))]
ArcList = Annotated[Any, WithJsonSchema(_list_of(_pair_of(_LABEL)))]
Texts = Annotated[Any, WithJsonSchema(_either(_NOTE, _any_list_of(_NOTE)))]
Units = Annotated[Any, WithJsonSchema(_either(_UNIT, _list_of(_UNIT)))]
Name = Annotated[Any, WithJsonSchema({"type": "string", "minLength": 1, "maxLength": 100})]
Version = Annotated[Any, WithJsonSchema({"type": "integer", "const": SCHEMA_VERSION})]
Seed = Annotated[Any, WithJsonSchema({"type": "integer", "minimum": 0, "maximum": 2**63 - 1})]
Arrow = Annotated[Any, WithJsonSchema({"enum": list(ARROWS)})]
Negative = Annotated[Any, WithJsonSchema({"enum": list(NEGATIVE)})]
Signal = Annotated[Any, WithJsonSchema({"enum": list(SIGNALS)})]
Guarantee = Annotated[Any, WithJsonSchema({"enum": list(GUARANTEES)})]
_COUNT = {"type": "integer", "minimum": 1, "maximum": MOST_AGENTS}
Agents = Annotated[Any, WithJsonSchema(_either(_COUNT, _list_of(_LABEL)))]
Pairs = Annotated[Any, WithJsonSchema(_either(_INTERVAL, _any_list_of(_INTERVAL)))]
Bands = Annotated[Any, WithJsonSchema(_any_list_of(_INTERVAL))]
Box = Annotated[Any, WithJsonSchema(_either(_NUMBER, _list_of(_either(_NUMBER, _INTERVAL))))]
Rows = Annotated[Any, WithJsonSchema(_either(_NUMBERS, _any_list_of(_NUMBERS)))]
ModeNames = Annotated[Any, WithJsonSchema(_list_of(_TEXT))]
Instants = Annotated[Any, WithJsonSchema(_list_of(_INSTANT))]
Count = Annotated[Any, WithJsonSchema({"type": "integer", "minimum": 1})]
Modes = Annotated[
    Document,
    WithJsonSchema(_table_of(_any_list_of(_ARC), _FILE, _OPTIONAL) | {"minProperties": 1}),
]
Gains = Annotated[Any, WithJsonSchema(_either(_NUMBER, _table_of(_NUMBER, _MATRIX)))]
GainsOfModes = Annotated[Document, WithJsonSchema(_table_of(_table_of(_NUMBER, _MATRIX)))]
Fixed = Annotated[
    Document,
    WithJsonSchema(
        _table_of(
            _NUMBER,
            _NUMBERS,
            {
                "type": "object",
                "properties": {"between": _either(_INTERVAL, _any_list_of(_INTERVAL))},
                "required": ["between"],
                "additionalProperties": False,
            },
        )
    ),
]
Goal = Annotated[Any, WithJsonSchema({"enum": list(GOALS)})]
ActsOn = Annotated[Any, WithJsonSchema({"enum": list(ACTS_ON)})]
Time = Annotated[Any, WithJsonSchema({"enum": list(TIMES)})]
Kind = Annotated[Any, WithJsonSchema({"enum": list(KINDS)})]
Flag = Annotated[Any, WithJsonSchema({"type": "boolean"})]
Members = Annotated[Any, WithJsonSchema(_list_of(_LABEL))]
Limits = Annotated[Any, WithJsonSchema(_either(_NUMBER, _table_of(_NUMBER)))]
Offsets = Annotated[Document, WithJsonSchema(_table_of(_NUMBER, _NUMBERS))]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)


class NetworkTable(_Table):
    """[network]: who is there and who listens to whom."""

    agents: Agents = Field(description="A count (labels 1..n) or a list of labels.")
    arrow: Arrow = Field(
        description="What [a, b] means: a hears b, or a is heard by b. There is no default."
    )
    modes: Modes = Field(description="At least one; several mean switching.")
    negative: Negative = _optional(
        "What a negative weight w means: |w| h(-x_j - x_i), or w h(x_j - x_i)."
    )


class ExceptionTable(_Table):
    """[[coupling.exceptions]]: another h on some arcs, in every mode that has them."""

    arcs: ArcList
    h: CouplingText


class CouplingTable(_Table):
    """[coupling]: the function h that every arc applies to x_j - x_i."""

    h: CouplingText
    exceptions: list[ExceptionTable] = []


class PinningTable(_Table):
    """[pinning]: the gains k_i."""

    gains: Gains = _optional("Label -> k, or one number for all agents.")
    modes: GainsOfModes = _optional("Mode -> label -> k: pins of single modes.")


_WAYS: Any = [{"required": list(keys)} for keys in (("A", "C"), *((part,) for part in PARTS))]

_BANDS: Any = [{"required": [key, "amplitude"]} for key in KEYS]


class _Disturbance(_Table):
    A: NumberMatrix = None
    C: NumberMatrix = None
    constant: Flag = _optional("In place of A and C: a constant part.")
    ramp: Flag = _optional("A constant and a ramp.")
    hz: NumberOrList = _optional("Sines, in Hz (cycles per second).")
    frequencies: NumberOrList = _optional("Sines, in rad/s.")
    kind: Kind = _optional("A single part by its name.")


class GroupTable(_Disturbance):
    """[[exosystem.groups]]: agents with an exosystem and an observer of their own."""

    model_config = ConfigDict(json_schema_extra={"anyOf": [*_WAYS, {"required": ["none"]}]})

    agents: Members = Field(description="Labels; an agent is in one group at most.")
    none: Flag = _optional("True, in place of all else: these agents have no disturbance.")
    W: NumberMatrix = _optional("Without it W is designed, for observer.rate.")
    P: NumberMatrix = _optional("Beside W, for every group or none; tested as it is.")


class ExosystemTable(_Disturbance):
    """[exosystem]: xi' = A xi, d = C xi, of the agents that are in no group; without A, C or a part
    they have none."""

    model_config = ConfigDict(
        json_schema_extra={"anyOf": [*_WAYS, *_BANDS, {"required": ["groups"]}]}
    )

    groups: list[GroupTable] = []
    bands: Bands = _optional("rad/s: sines of a frequency somewhere in each band.")
    bands_hz: Bands = _optional("The same in Hz.")
    amplitude: NumberOrList = _optional("Of the sines in the bands, at most: for all, or for each.")
    pairs: Count = _optional("Pairs of poles that A is given for each band; 1 by default.")


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

    initial_states: Pairs = Field(description="[lo, hi] for every component, or m such pairs.")
    initial_disturbance: Number = None


class SwitchingTable(_Table):
    """[switching]: the signal that drives the modes."""

    model_config = ConfigDict(
        json_schema_extra={"anyOf": [{"required": ["signal"]}, {"required": ["guarantee"]}]}
    )

    signal: Signal = _optional("Required, unless there is a guarantee.")
    guarantee: Guarantee = _optional("What proofs may assume of the signal.")
    dwell: NumberOrList = _optional(
        "s; the mean stay where signal is markov; sequence: one for each."
    )
    longest: Number = _optional("s; guarantee dwell: a mode lasts at most that.")
    sequence: ModeNames = _optional("periodic: the modes of one round.")
    period: Number = _optional("periodic: s of one round, in place of dwell.")
    generator: NumberMatrix = _optional("markov: rates in 1/s, rows adding up to 0.")
    schedule: Instants = _optional("schedule: [instant in s, mode]; periodic: of one round.")
    radius: Number = _optional("mobile: how far an agent hears, in the unit of x.")
    neighbours: Count = _optional("mobile: how many of the nearest it hears, instead of radius.")
    hysteresis: Number = _optional("mobile: a link made at one distance breaks this much later.")


class SimulationTable(_Table):
    """[simulation]: settings of simulations; they never enter a proof."""

    t_final: Number = _optional("s")
    seed: Seed = None
    xi0: Rows = _optional("q numbers for all agents, or n rows.")
    x0: Rows = _optional("m numbers for all agents, or n rows; with m = 1 also n numbers.")


class UncertaintyTable(_Table):
    """[uncertainty]: how far the plant may be from the model."""

    weights: Number = _optional("Largest relative error of every arc weight.")
    gains: Number = _optional("Largest relative error of every pinning gain.")
    known_to_agents: Flag = _optional("false: the agents' model of the couplings is off as much.")
    disturbance: Number = _optional("|w_i|: the part of d_i the exosystem does not generate.")
    drift: Number = _optional("|xi' - A xi|")
    measurement: Number = _optional("|noise| of every measured state, in the unit of x.")


class DynamicsTable(_Table):
    """[dynamics]: x_i' = A x_i + B (couplings + u_i + d_i) of every agent."""

    A: NumberMatrix = _optional("m x m, in 1/s.")
    f: Annotated[Any, WithJsonSchema(_list_of(_TEXT))] = _optional(
        "In place of A: m expressions in x1..xm, x_i' = f(x_i) + ..."
    )
    B: NumberMatrix = _optional("m x p with full column rank; by default the identity.")
    H: NumberMatrix = _optional("r x m with full row rank: y = H x is measured; by default x.")
    acts_on: ActsOn = _optional("Couplings and pins act on estimated states, or on the outputs y.")
    time: Time = _optional('"discrete", alone: x_i+ = x_i + couplings + u_i + d_i, xi+ = A xi.')


class LeaderTable(_Table):
    """[leader]: the target is a solution of s' = A s, or f(s)."""

    initial: Box = Field(description="s(0): m pairs [lo, hi], or numbers.")
    stays_in: Box = _optional("With f: a box that s never leaves; else one is looked for.")


class ActuatorsTable(_Table):
    """[actuators]: what the actuators can give."""

    limit: Limits = _optional("|u_i| per component: for all agents, or label -> number.")
    amplitude: Number = _optional("Bound on |d_i|; by default from simulation.xi0.")
    saturates: Flag = _optional("Inputs saturate at the limit, and proofs count what is left.")


class ReadingsTable(_Table):
    """[readings]: how late and how often agents know what they use."""

    delay: Number = _optional("s (steps): how old readings of neighbours may be.")
    own_delay: Number = _optional("s (steps): how old readings of oneself may be.")
    period: Number = _optional("s: couplings and pins are computed so often, and held in between.")
    lost: Count = _optional("With a period: readings of a neighbour in a row that may be lost.")
    event: Number = _optional("Relative threshold of an event trigger or logarithmic quantiser.")


class ProcessorTable(_Table):
    """[processor]: everything that an agent does is computed from samples and held."""

    period: Number = Field(description="s, between two samples.")


class ProblemFile(_Table):
    """A dobc_design problem file."""

    schema_: Version = Field(default=SCHEMA_VERSION, alias="schema")
    name: Name = None
    notes: Texts = Field(
        default=(), description="What is assumed or stands in; shown wherever a result is shown."
    )
    goal: Goal = _optional(
        '"target" (default): all reach it. "agreement": a value that nobody prescribes. '
        '"containment": between the nodes in [fixed].'
    )
    target: NumberOrList = Field(default=0, description="xbar: a number, or m numbers.")
    units: Units = _optional('Of the states, for words and figures: "m/s", or m such texts.')
    fixed: Fixed | None = Field(
        default=None,
        description="Nodes that listen to nobody: label -> value, or { between = [lo, hi] }.",
    )
    network: NetworkTable
    coupling: CouplingTable
    pinning: PinningTable | None = None
    exosystem: ExosystemTable | None = None
    observer: ObserverTable | None = None
    formation: FormationTable | None = None
    region: RegionTable | None = None
    switching: SwitchingTable | None = None
    simulation: SimulationTable | None = None
    uncertainty: UncertaintyTable | None = None
    actuators: ActuatorsTable | None = None
    dynamics: DynamicsTable | None = None
    leader: LeaderTable | None = None
    readings: ReadingsTable | None = None
    processor: ProcessorTable | None = None


def json_schema() -> Document:
    """The JSON Schema of the problem file, for editors and for `dobc schema`."""
    schema = ProblemFile.model_json_schema(by_alias=True)
    # Descriptions are docstrings, whose lines end where those of the source do.
    for table in schema["$defs"].values():
        table["description"] = " ".join(table["description"].split())
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}
