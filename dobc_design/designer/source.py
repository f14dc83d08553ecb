"""A problem as the Python that builds it: numbers as somebody would type them, exact ones as
text."""

from collections.abc import Mapping
from dataclasses import fields
from fractions import Fraction
from pprint import pformat
from textwrap import indent
from typing import Any

from dobc_design._checks import positional
from dobc_design.coupling.coupling import Coupling
from dobc_design.exact.number import typed_number
from dobc_design.exact.reading import Document, Table
from dobc_design.problem.changes import gain_table
from dobc_design.problem.dynamics import Dynamics
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.groups import Group, Observer
from dobc_design.problem.leader import Leader
from dobc_design.problem.network import Network, labels_of
from dobc_design.problem.problem import Problem
from dobc_design.problem.readings import Processor, Readings
from dobc_design.problem.region import Region
from dobc_design.problem.simulation import Simulation
from dobc_design.problem.switching import Switching
from dobc_design.problem.uncertainty import Actuators, Uncertainty

WIDTH = 100


def python_source(problem: Problem) -> str:
    """A script whose ``problem`` equals this one."""
    problem.require("a script of the Designer")
    given = problem.__reduce__()[0].keywords  # the arguments of its constructor
    given["gains"] = gain_table(problem.pinning.gains, problem.network.labels)
    said = {name: _plain(value) for name, value in given.items()}
    needed = {name: value for name, value in said.items() if value not in (None, {}, [])}
    written = _text(_Call("Problem", needed))
    return f"import dobc_design as dd\n\nproblem = {written}\n"


@positional
class _Call:
    name: str
    arguments: Table

    def __repr__(self) -> str:
        arguments = ", ".join(f"{name}={value!r}" for name, value in self.arguments.items())
        return f"dd.{self.name}({arguments})"


def _plain(value: Any) -> Any:
    """Numbers, texts, lists and tables in place of nouns, and calls of those that have to be
    built."""
    match value:
        case Fraction():
            return typed_number(value)
        case Coupling():
            return value.texts[0] if value.by_component else list(value.texts)
        case Network():
            return _Call("Network.from_arcs", _of_network(value))
        case Exosystem() | Observer() | Group() | Switching():
            return _Call(type(value).__name__, _fields(value))
        case Region() | Simulation() | Uncertainty() | Actuators() | Readings() | Processor():
            return _fields(value)
        case Dynamics() | Leader():
            return _fields(value)
        case Mapping():
            return {key: _plain(each) for key, each in value.items()}
        case list() | tuple():
            return [_plain(each) for each in value]
        case _:
            return value


def _of_network(network: Network) -> Document:
    """The arguments that make it, with labels where they are more than counting."""
    names: Any = network.labels
    agents: Any = list(network.labels)
    if network.labels == labels_of(network.size):  # 1 and "1" are one label
        names = range(1, network.size + 1)
        agents = network.size
    arcs: Document = {mode: [] for mode in network.modes}
    for mode, each in network.modes.items():
        for i, j, weight in each:
            arc = [names[i], names[j]]
            arcs[mode].append(arc if weight == 1 else [*arc, typed_number(weight)])
    return {"arcs": arcs, "arrow": "listens_to", "agents": agents}


def _fields(noun: Any) -> Document:
    found = {each.name: getattr(noun, each.name) for each in fields(noun)}
    return {name: _plain(value) for name, value in found.items() if value is not None}


def _text(value: Any) -> str:
    if not isinstance(value, _Call) or len(repr(value)) <= WIDTH:
        return pformat(value, width=WIDTH, compact=True, sort_dicts=False)
    inside = "".join(f"{name}={_text(each)},\n" for name, each in value.arguments.items())
    return f"dd.{value.name}(\n{indent(inside, '    ')})"
