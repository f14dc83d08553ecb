"""A problem with some keys of its file set anew or removed: what a cure proposes, before anyone writes it.

Key paths are those of the problem file ("pinning.gains", "observer.W"); the value None removes the key.
"exosystem.groups.W" is the gains of all groups of agents at once, by the name of the group; what P they have goes.
``toml_writing`` makes the same changes to the text of a file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from dobc_design.errors import SpecError
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.reading import shown
from dobc_design.problem.exosystem import Exosystem
from dobc_design.problem.groups import Group, gains_of
from dobc_design.problem.observer import Observer
from dobc_design.problem.problem import Problem
from dobc_design.problem.typed import typed_matrix

#: The key paths that a change may name.
CHANGEABLE = (
    "target",
    "pinning.gains",
    "exosystem",
    "exosystem.A",
    "exosystem.C",
    "observer",
    "observer.W",
    "observer.P",
    "observer.rate",
    "region.initial_disturbance",
    "simulation.xi0",
    "exosystem.groups.W",
)
GROUP_GAINS = "exosystem.groups.W"


def gain_changes(problem: Problem, W: Matrix | None) -> dict[str, Any]:
    """The changes that make W (q, m) the observer gain, None that one is to be designed; P is removed.

    Where agents have different exosystems, W is block diagonal with one block per group.
    """
    if not problem.is_grouped:
        return {"observer.W": None if W is None else typed_matrix(W), "observer.P": None}
    if W is None:
        return {GROUP_GAINS: None}
    gains = zip(problem.groups, gains_of(problem.groups, W), strict=True)
    return {GROUP_GAINS: {group.name: typed_matrix(gain) for group, gain in gains}}


def changed_problem(problem: Problem, changes: Mapping[str, Any]) -> Problem:
    """Return the problem with these keys set, everything else as it was.

    ``changes``: key path -> value as it would stand in the file, None to remove the key.
    Raises: SpecError for a key path that cannot be changed here, and for values that the problem refuses.
    """
    for key in changes:
        if key not in CHANGEABLE:
            raise SpecError(
                f"{shown(key)} is no key that a change may set.", key=key, cure=f"One of {', '.join(CHANGEABLE)}."
            )
    remake, (given,) = problem.__reduce__()  # everything that makes the problem, for a copy
    if problem.is_grouped:
        _require_no_key_of_all(changes)
        if GROUP_GAINS in changes:
            given["groups"] = _regrouped(problem, changes[GROUP_GAINS] or {})
    else:
        exosystem = _exosystem(problem, changes)
        given["exosystem"] = exosystem
        given["observer"] = None if exosystem is None else _observer(problem.observer, changes)
    given["target"] = changes.get("target", problem.target)
    given["gains"] = changes.get("pinning.gains", problem.pinning)
    if "simulation.xi0" in changes:
        own = problem.simulation
        given["simulation"] = {"t_final": own.t_final, "seed": own.seed, "xi0": changes["simulation.xi0"], "x0": own.x0}
    if "region.initial_disturbance" in changes and problem.region is not None:
        given["region"] = {
            "initial_states": problem.region.initial_states,
            "initial_disturbance": changes["region.initial_disturbance"],
        }
    changed: Problem = remake(given)
    return changed


def _require_no_key_of_all(changes: Mapping[str, Any]) -> None:
    if any(key.startswith(("exosystem", "observer")) and key != GROUP_GAINS for key in changes):
        raise SpecError(
            "exosystem and observer cannot be changed by key where agents have different ones.",
            key="exosystem.groups",
            cure="Make the problem anew with other groups.",
        )


def _regrouped(problem: Problem, gains: Mapping[str, Any]) -> list[Group]:
    """The groups with these W, by name; a group without one gets its W designed."""
    return [
        Group(
            agents=group.agents,
            exosystem=group.exosystem,
            observer=Observer(W=gains.get(group.name), rate=group.observer.rate),
        )
        for group in problem.groups
    ]


def _exosystem(problem: Problem, changes: Mapping[str, Any]) -> Exosystem | None:
    own = problem.exosystem
    if own is None or ("exosystem" in changes and changes["exosystem"] is None):
        return None
    if not {"exosystem.A", "exosystem.C"} & set(changes):
        return own
    return Exosystem(A=changes.get("exosystem.A", own.A), C=changes.get("exosystem.C", own.C))


def _observer(own: Observer, changes: Mapping[str, Any]) -> Observer:
    if "observer" in changes and changes["observer"] is None:
        return Observer()
    kept: dict[str, Any] = {each.name: getattr(own, each.name) for each in fields(own)}
    return Observer(**{name: changes.get(f"observer.{name}", value) for name, value in kept.items()})
