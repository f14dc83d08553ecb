"""A power grid as a consensus problem: voltage angles, coupled by the sines of their differences.

    theta_i' = sum_j (1/D) b_ij sin(theta_j - theta_i) + u_i + d_i,        b_ij = 1 / (x_ij tap_ij)

Lossless lines, voltages of 1 p.u., first order (droop-controlled inverters, or machines whose inertia is left out),
flat schedule: all angles agree at the target 0.  The weights b_ij are exact; everything else is said in the notes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from dobc_design.errors import SpecError
from dobc_design.exact.reading import named, shown_number
from dobc_design.problem.exosystems import constant
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem

NOTES = (
    "Imported from {source}: {buses} buses, {branches} branches in service, generators at {generators}.",
    "Model: voltage angles in rad with h = sin(y) and the weights 1/(x tap) in p.u.; voltages are 1 p.u., resistances,"
    " shunts, phase shifts, inertia and the schedule of powers are left out, and the droop 1/D is 1 rad/s per p.u.",
    "Stand-ins: every generator bus is pinned with the gain {gain} 1/s, and the disturbance is an unknown constant (a"
    " load that was not scheduled). Choose your own, for example with design_pinning(allowed=...).",
)
SHOWN = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class Branch:
    """A line or transformer: its two buses, its reactance x times the tap ratio in p.u., and its place in the file."""

    ends: tuple[str, str]
    reactance: Fraction
    place: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Grid:
    """What is read of a grid: bus labels, branches in service, buses with a generator in service, where it is from."""

    buses: tuple[str, ...]
    branches: tuple[Branch, ...]
    generators: tuple[str, ...]
    source: str


def grid_problem(grid: Grid, *, name: str, gain: Any = 1) -> Problem:
    """The consensus problem of a grid; generators are pinned with ``gain`` (1/s).

    Raises: SpecError for a branch that leaves the grid, or whose reactance is not positive: it would push angles apart.
    """
    known = set(grid.buses)
    weights: dict[tuple[str, str], Fraction] = {}
    for branch in grid.branches:
        a, b = branch.ends
        for end in branch.ends:
            if end not in known:
                raise SpecError(
                    f"{branch.place} names bus {named(end)}, which is not there.",
                    key=branch.place,
                    cure="Add the bus, or take the branch out of service.",
                )
        if a == b:
            raise SpecError(f"{branch.place} leads from bus {named(a)} to itself.", key=branch.place)
        if branch.reactance <= 0:
            raise SpecError(
                f"{branch.place} (bus {named(a)} to {named(b)}) must have a reactance > 0;"
                f" got {shown_number(branch.reactance)}.",
                key=branch.place,
                cure="Take it out of service, or merge the star point of its transformer.",
            )
        ends = (a, b) if (b, a) not in weights else (b, a)
        weights[ends] = weights.get(ends, Fraction(0)) + 1 / branch.reactance
    if not weights:
        raise SpecError(f"{grid.source} has no branch in service.", key="branch", cure="A grid needs lines.")
    arcs = [arc for (a, b), w in weights.items() for arc in ([a, b, w], [b, a, w])]
    generators = tuple(dict.fromkeys(bus for bus in grid.generators if bus in known))
    shown = ", ".join(generators[:SHOWN]) + (f" and {len(generators) - SHOWN} more" if len(generators) > SHOWN else "")
    notes = [
        note.format(
            source=grid.source,
            buses=len(grid.buses),
            branches=len(grid.branches),
            gain=gain,
            generators=f"bus {shown}" if generators else "no bus",
        )
        for note in NOTES
    ]
    return Problem(
        name=name,
        network=Network.from_arcs({"grid": arcs}, arrow="listens_to", agents=list(grid.buses)),
        coupling="sin(y)",
        target=0,
        gains=dict.fromkeys(generators, gain),
        exosystem=constant(),
        notes=notes,
    )


def merged(labels: Sequence[str], pairs: Sequence[tuple[str, str]]) -> dict[str, str]:
    """Label -> the label it becomes when these pairs are joined (closed bus couplers): the first of its group."""
    parent = {label: label for label in labels}

    def root(label: str) -> str:
        while parent[label] != label:
            label = parent[label]
        return label

    order = {label: place for place, label in enumerate(labels)}
    for a, b in pairs:
        first, second = sorted((root(a), root(b)), key=order.__getitem__)
        parent[second] = first
    return {label: root(label) for label in labels}
