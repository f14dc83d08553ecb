"""Model error, noise and input limits: what was assumed, final bounds, largest inputs and the
tolerance."""

from collections.abc import Iterable, Iterator, Mapping
from fractions import Fraction

from dobc_design._show.text import significant_away_from_zero, significant_towards_zero, typeset
from dobc_design.certificate.certificate import Certificate
from dobc_design.conditions.check import Check
from dobc_design.conditions.domain import NEAR_TARGET
from dobc_design.conditions.numbers import read_rational
from dobc_design.exact.reading import counted
from dobc_design.problem.problem import Problem

from .document import EVERY, Beside, Block, Blocks, Column, Fact, Section, Text, section, table_of
from .findings import Findings
from .words import FIXED, decimal, domain_words, names_in_words, sentence

MOST_ROWS = 8
_NAMES = {"accuracy": "Accuracy", "actuators": "Inputs", "tolerance": "Tolerance"}
_RELATIVE = (("weights", "error of every arc weight"), ("gains", "error of every pinning gain"))
_ABSOLUTE = (
    ("disturbance", "unmodelled disturbance"),
    ("drift", "drift |ξᵢ′ − Aξᵢ|"),
    ("measurement", "error of every measured state"),
)
_LARGEST = (("actuators", "inputs", "largest |u|"), ("accuracy", "bounds", "largest final |e|"))

Values = Mapping[str, Fraction]  # by the name of an agent, or of one of its components


@section("Model error, noise and input limits", "plant", "Plant")
def plant_section(found: Findings) -> Blocks:
    """What is proved under [uncertainty] and [actuators]; nothing where the problem has neither."""
    problem = found.problem
    if problem.uncertainty is None and problem.actuators is None:
        return
    assumed = list(_assumed(problem))
    told: list[tuple[Block, ...]] = []
    for id in _NAMES:
        told += [(_told(problem, check),) for check in found.certificate.checks if check.id == id]
    if not (assumed or told):
        return
    if assumed:
        yield table_of(
            "Assumed about the plant",
            assumed,
            Column("assumed by component", lambda row: row[0]),
            Column("at most", lambda row: row[1], style="number"),
        )
    if told:
        yield Beside(told)
    else:
        nothing = "Nothing is proved about this, because the conditions that it would rest on fail."
        yield Text(nothing)


def plant_numbers(certificate: Certificate) -> list[str]:
    """In a few words each: the largest input, the largest final bound, the tolerance, as far as
    proved."""
    proved: dict[str, Check] = {}
    for check in certificate.checks:
        if check.is_proved and check.exact:
            proved[check.id] = check
    told = []
    for id, key, what in _LARGEST:
        values: Values = {}
        shown = what
        if id in proved and "rooms" in (proved[id].exact or {}):
            values = _compensation(certificate.problem, proved[id])
            shown = "largest |d̂|"
        elif id in proved:
            values = numbers_of(proved[id], key)
        if values:
            # the agent that needs most decides what is to be bought
            label = max(values, key=values.__getitem__)
            told.append(f"{shown} ≤ {significant_away_from_zero(values[label])} (agent {label})")
    if "tolerance" in proved:
        exact = proved["tolerance"].exact or {}
        # rounded down: no larger error is proved to be tolerated
        parts = (100 * read_rational(exact[key]) for key in ("weights", "gains"))
        weights, gains = map(significant_towards_zero, parts)
        told.append(f"weights may be off by {weights} %, gains by {gains} %")
    return told


def _assumed(problem: Problem) -> Iterator[Fact]:
    """Names and bounds of what the two tables of the problem give."""
    table, actuators = problem.uncertainty, problem.actuators
    if table is not None:
        for key, name in _ABSOLUTE:
            bound = getattr(table, key)
            if bound:
                yield name, decimal(bound)
        for band in table.bands or ():
            ends = f"{decimal(band.low)} to {decimal(band.high)} rad/s"
            yield f"sine of one frequency in {ends}", decimal(band.amplitude)
        for key, name in _RELATIVE:
            part = getattr(table, key)
            if part:
                yield name, f"{decimal(100 * part)} %"
        if not table.known_to_agents:
            yield "weights in the observers", "as uncertain"
    if actuators is None:
        return
    if actuators.amplitude is not None:
        yield "disturbance |dᵢ|", decimal(actuators.amplitude)
    limit = actuators.limit
    if isinstance(limit, Fraction):
        yield "inputs |uᵢ|", decimal(limit)
    elif isinstance(limit, Mapping) and limit:
        # A limit of its own for each agent: the range says enough here.
        least, most = decimal(min(limit.values())), decimal(max(limit.values()))
        shown = least if least == most else f"{least} to {most}"
        yield f"inputs |uᵢ| of {counted(len(limit), 'agent')}", shown


def _told(problem: Problem, check: Check) -> Section:
    """What one of the checks says, where it is proved with its numbers."""
    text, table = check.reason, list[Block]()
    where = ""
    if check.is_proved:
        where = f" {domain_words(check.domain, problem.unit)}"
        if check.domain != NEAR_TARGET:
            where = f" for{where}"
        if check.id == "accuracy":
            text = FIXED["accuracy"]
            table = _worst(numbers_of(check, "bounds"), "final |eᵢ| ≤", {})
        elif check.id == "actuators" and "rooms" in (check.exact or {}):
            taken = _compensation(problem, check)
            text = FIXED["saturates"]
            table = _worst(taken, "|d̂ᵢ| ≤", _limits(problem, taken))
        elif check.id == "actuators":
            inputs = numbers_of(check, "inputs")
            limits = _limits(problem, inputs)
            text = "No component of an input is ever larger than this"
            text += ", so no actuator with a limit saturates." if limits else "."
            table = _worst(inputs, "|uᵢ| ≤", limits)
    told = Text(f"{check.verdict.value.capitalize()}{where}. {sentence(text)}")
    return Section(_NAMES[check.id], (told, *table))


def _limits(problem: Problem, labels: Iterable[str]) -> dict[str, Fraction]:
    """The limits of those agents whose actuators have one."""
    limits: dict[str, Fraction] = {}
    if problem.actuators is not None:
        for label in labels:
            limit = problem.actuators.limit_of(label)
            if limit is not None:
                limits[label] = limit
    return limits


def _compensation(problem: Problem, check: Check) -> dict[str, Fraction]:
    """What the compensation of the disturbance may take of the limits of agents."""
    rooms = numbers_of(check, "rooms")
    return {label: limit - rooms[label] for label, limit in _limits(problem, rooms).items()}


def numbers_of(check: Check, key: str) -> dict[str, Fraction]:
    """One number for each agent, or for each component of each."""
    found: dict[str, Fraction] = {}
    for label, given in (check.exact or {})[key].items():
        # An agent with no components keeps its own name, as one that has a number does.
        if isinstance(given, list) and given:
            for component, value in enumerate(given, 1):
                found[f"{label}, component {component}"] = read_rational(value)
        else:
            found[label] = read_rational(given)
    return found


def _worst(values: Values, head: str, limits: Values) -> list[Block]:
    """The agents with the largest values, rounded up, closest to their limits first; equal ones
    share a row."""

    def closeness(label: str) -> tuple[bool, Fraction]:
        limit = limits.get(label)
        return limit is not None, values[label] / (limit or 1)

    rows: dict[Fact, list[str]] = {}
    for label in sorted(values, key=closeness, reverse=True):
        # rounded up, because it is a bound from above
        value = typeset(significant_away_from_zero(values[label]))
        limit = limits.get(label)
        shown = "–" if limit is None else decimal(limit)
        rows.setdefault((value, shown), []).append(label)
    first = list(rows.items())[:MOST_ROWS]
    table = table_of(
        head,
        first,
        Column("agents", lambda row: names_in_words(row[1], 6)),
        Column(head, lambda row: row[0][0], style="number"),
        Column(
            "limit",
            lambda row: row[0][1],
            style="number",
            only=EVERY if limits else (),
        ),
    )
    more = len(values) - sum(len(labels) for _, labels in first)
    if not more:
        return [table]
    rest = f"And {more} more, with less; certificate.json has them all."
    return [table, Text(rest, "caption")]
