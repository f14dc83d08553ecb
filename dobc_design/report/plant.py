"""Model error, noise and input limits: what was assumed, final bounds, largest inputs and the
tolerance."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from fractions import Fraction
from typing import Any

from dobc_design._show.text import significant_away_from_zero, significant_towards_zero, typeset
from dobc_design.certificate.certificate import Certificate
from dobc_design.conditions.check import Check
from dobc_design.conditions.numbers import read_rational
from dobc_design.exact.reading import counted
from dobc_design.problem.problem import Problem
from dobc_design.report import document as doc
from dobc_design.report import words
from dobc_design.verdict import Verdict

MOST_ROWS = 8
_NAMES = {"accuracy": "Accuracy", "actuators": "Inputs", "tolerance": "Tolerance"}
_RELATIVE = (("weights", "error of every arc weight"), ("gains", "error of every pinning gain"))
_ABSOLUTE = (
    ("disturbance", "unmodelled disturbance"),
    ("drift", "drift |ξᵢ′ − Aξᵢ|"),
    ("measurement", "error of every measured state"),
)


def plant_section(certificate: Certificate) -> Iterator[doc.Section]:
    """What is proved under [uncertainty] and [actuators]; nothing where the problem has neither."""
    problem = certificate.problem
    assumed = list(_assumed(problem))
    told = [
        _told(problem, check) for id in _NAMES for check in certificate.checks if check.id == id
    ]
    if (problem.uncertainty is None and problem.actuators is None) or not (assumed or told):
        return
    given = doc.table_of(
        "Assumed about the plant",
        assumed,
        doc.Column("assumed by component", lambda row: row[0]),
        doc.Column("at most", lambda row: row[1], style="number"),
    )
    nothing = doc.Text(
        "Nothing is proved about this, because the conditions that it would rest on fail."
    )
    blocks = (
        *([given] if assumed else []),
        doc.Beside([(each,) for each in told]) if told else nothing,
    )
    yield doc.Section("Model error, noise and input limits", blocks, "plant", "Plant")


def plant_numbers(certificate: Certificate) -> list[str]:
    """In a few words each: the largest input, the largest final bound, the tolerance, as far as
    proved."""
    proved = {
        check.id: check
        for check in certificate.checks
        if check.verdict is Verdict.PROVED and check.exact
    }
    told = []
    for id, key, what in (
        ("actuators", "inputs", "largest |u|"),
        ("accuracy", "bounds", "largest final |e|"),
    ):
        if id in proved and (values := _numbers(proved[id], key)):
            label = max(values, key=values.__getitem__)
            told.append(f"{what} ≤ {significant_away_from_zero(values[label])} (agent {label})")
    if "tolerance" in proved:
        exact = proved["tolerance"].exact or {}
        weights, gains = (
            significant_towards_zero(100 * read_rational(exact[key]))
            for key in ("weights", "gains")
        )
        told.append(f"weights may be off by {weights} %, gains by {gains} %")
    return told


def _assumed(problem: Problem) -> Iterator[tuple[str, str]]:
    """Names and bounds of what the two tables of the problem give."""
    table, actuators = problem.uncertainty, problem.actuators
    if table is not None:
        yield from (
            (name, words.decimal(x)) for key, name in _ABSOLUTE if (x := getattr(table, key))
        )
        yield from (
            (name, f"{words.decimal(100 * x)} %")
            for key, name in _RELATIVE
            if (x := getattr(table, key))
        )
        if not table.known_to_agents:
            yield "weights in the observers", "as uncertain"
    if actuators is not None:
        if actuators.amplitude is not None:
            yield "disturbance |dᵢ|", words.decimal(actuators.amplitude)
        if isinstance(actuators.limit, Mapping) and actuators.limit:
            ends = (words.decimal(end(actuators.limit.values())) for end in (min, max))
            yield (
                f"inputs |uᵢ| of {counted(len(actuators.limit), 'agent')}",
                " to ".join(dict.fromkeys(ends)),
            )
        elif isinstance(actuators.limit, Fraction):
            yield "inputs |uᵢ|", words.decimal(actuators.limit)


def _told(problem: Problem, check: Check) -> doc.Section:
    """What one of the checks says, where it is proved with its numbers."""
    text, table, proved = check.reason, tuple[doc.Block, ...](), check.verdict is Verdict.PROVED
    if proved and check.id == "accuracy":
        text = words.TEXTS["fixed"]["accuracy"]
        table = _worst(_numbers(check, "bounds"), "final |eᵢ| ≤", {})
    elif proved and check.id == "actuators":
        inputs = _numbers(check, "inputs")
        limits = (
            {label: problem.actuators.limit_of(label) for label in inputs}
            if problem.actuators
            else {}
        )
        text = "No component of an input is ever larger than this"
        text += ", so no actuator with a limit saturates." if any(limits.values()) else "."
        table = _worst(inputs, "|uᵢ| ≤", limits)
    where = f"{'' if check.domain == 'consensus' else ' for'} {words.domain_words(check.domain)}"
    head = f"{check.verdict.value.capitalize()}{where if proved else ''}"
    return doc.Section(_NAMES[check.id], (doc.Text(f"{head}. {words.sentence(text)}"), *table))


def _numbers(check: Check, key: str) -> dict[str, Fraction]:
    """One number for each agent, or for each component of each."""
    found = dict[str, Any]()
    for label, given in (check.exact or {})[key].items():
        listed = (
            {f"{label}, component {c}": x for c, x in enumerate(given, 1)}
            if isinstance(given, list)
            else {}
        )
        found |= listed or {label: given}
    return {name: read_rational(x) for name, x in found.items()}


def _worst(
    values: Mapping[str, Fraction], head: str, limits: Mapping[str, Fraction | None]
) -> tuple[doc.Block, ...]:
    """The agents with the largest values, rounded up, closest to their limits first; equal ones
    share a row."""
    worst = sorted(
        values,
        key=lambda x: (limits.get(x) is not None, values[x] / (limits.get(x) or 1)),
        reverse=True,
    )
    rows: dict[tuple[str, str], list[str]] = {}
    for label in worst:
        limit = limits.get(label)
        shown = (
            typeset(significant_away_from_zero(values[label])),
            "–" if limit is None else words.decimal(limit),
        )
        rows.setdefault(shown, []).append(label)
    first = list(rows.items())[:MOST_ROWS]
    more = len(values) - sum(len(labels) for _, labels in first)
    table = doc.table_of(
        head,
        first,
        doc.Column("agents", lambda row: words.names_in_words(row[1], 6)),
        doc.Column(head, lambda row: row[0][0], style="number"),
        doc.Column(
            "limit",
            lambda row: row[0][1],
            style="number",
            only=doc.EVERY if any(limits.values()) else (),
        ),
    )
    rest = doc.Text(f"And {more} more, with less; certificate.json has them all.", "caption")
    return (table, rest) if more else (table,)
