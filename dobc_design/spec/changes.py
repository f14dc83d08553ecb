"""A problem with some keys of its file set anew or removed: what a cure proposes, before anyone writes it.

Key paths are those of the problem file ("pinning.gains", "observer.W"); the value None removes the key.
``spec.toml_writing`` makes the same changes to the text of a file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from dobc_design.errors import SpecError
from dobc_design.spec.exosystem import Exosystem
from dobc_design.spec.observer import Observer
from dobc_design.spec.problem import Problem
from dobc_design.spec.reading import shown

#: The key paths that a change may name.
CHANGEABLE = (
    "target", "pinning.gains", "exosystem", "exosystem.A", "exosystem.C", "observer", "observer.W", "observer.P",
    "observer.rate", "region.initial_disturbance", "simulation.xi0",
)  # fmt: skip


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
    if not problem.is_grouped:
        exosystem = _exosystem(problem, changes)
        given["exosystem"] = exosystem
        given["observer"] = None if exosystem is None else _observer(problem.observer, changes)
    elif any(key.startswith(("exosystem", "observer")) for key in changes):
        raise SpecError(
            "exosystem and observer cannot be changed by key where agents have different ones.", key="exosystem.groups",
            cure="Make the problem anew with other groups.",
        )  # fmt: skip
    given["target"] = changes.get("target", problem.target)
    given["gains"] = changes.get("pinning.gains", problem.pinning)
    if "simulation.xi0" in changes:
        own = problem.simulation
        given["simulation"] = {
            "t_final": own.t_final, "seed": own.seed, "xi0": changes["simulation.xi0"], "x0": own.x0,
        }  # fmt: skip
    if "region.initial_disturbance" in changes and problem.region is not None:
        given["region"] = {
            "initial_states": problem.region.initial_states,
            "initial_disturbance": changes["region.initial_disturbance"],
        }
    changed: Problem = remake(given)
    return changed


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
