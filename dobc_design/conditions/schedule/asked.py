"""What a settling time is asked for: from which starts, down to which tolerance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from dobc_design.conditions.check import Check
from dobc_design.conditions.coverage import asked_radius
from dobc_design.conditions.numbers import claimed, decimal_above
from dobc_design.errors import SpecError
from dobc_design.exact.number import parse_number
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

ZERO = Fraction(0)
#: A start counts as settled, where no tolerance is named, when every |e_ic| is below this part of the radius.
SETTLED = Fraction(1, 100)


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """Starts |e|_inf <= radius, |eps_i| <= disturbance, and the tolerance to be kept from some time on."""

    radius: Fraction
    disturbance: Fraction
    tolerance: Fraction


def asked_of(problem: Problem, *, tolerance: Any, radius: Any = None, disturbance: Any = None) -> Asked:
    """Read the numbers; what is None comes from the [region].

    Raises: SpecError for a number that is wrong, or missing where there is no region to take it from.
    """
    region = problem.region
    missing = [("radius", radius)] + ([("disturbance", disturbance)] if problem.groups else [])
    for key, value in missing:
        if value is None and region is None:
            raise SpecError(
                f"{key} must be given, because the problem has no [region] that says where it starts.",
                key=key,
                cure="Give radius, the largest |e(0)|_inf, and with an [exosystem] disturbance, the largest"
                " |xi_i(0) - xihat_i(0)|; or add a [region].",
            )
    reach = max(asked_radius(problem)) if radius is None else parse_number(radius, key="radius")
    error = ZERO if region is None else region.initial_disturbance or ZERO
    error = error if disturbance is None else parse_number(disturbance, key="disturbance")
    limit = parse_number(tolerance, key="tolerance")
    for key, number in (("radius", reach), ("tolerance", limit)):
        if number <= 0:
            raise SpecError(f"{key} must be > 0; got {float(number):.6g}.", key=key)
    if error < 0 or (error and not problem.groups):
        why = "it is a length" if error < 0 else "without an [exosystem] there is no observer error"
        raise SpecError(f"disturbance must be {'>= 0' if error < 0 else '0'}, because {why}.", key="disturbance")
    return Asked(radius=reach, disturbance=error, tolerance=limit)


def read_tolerance(value: Any, *, key: str = "settling") -> Fraction:
    """A tolerance > 0 in the unit of x.  Raises: SpecError with ``key`` for anything else."""
    limit = parse_number(value, key=key)
    if limit <= 0:
        raise SpecError(
            f"{key} must be > 0, because |e(t)| only comes close to 0; got {float(limit):.6g}.",
            key=key,
            cure="Name how far every state may still be from its goal, for example 1/100.",
        )
    return limit


def asked_beside(problem: Problem, checks: Sequence[Check], *, tolerance: Fraction | None) -> Asked | str:
    """The starts whose settling time a certificate with these ``checks`` shows, or why there are none.

    They are the region asked for, or where a max-separable proof reaches less far, or no region is asked for, its
    box.  Without a ``tolerance`` it is a hundredth of the radius.
    """
    box = _proved_box(checks)
    if isinstance(box, str):
        return box
    if problem.region is not None:
        error = problem.region.initial_disturbance or ZERO
        wanted = claimed(decimal_above(max(asked_radius(problem)))), claimed(decimal_above(error))
        box = wanted if box is None else min(box, wanted)
    if box is None:
        return "left out, because nothing says where the agents start: add a [region], or have every condition run."
    radius, disturbance = box
    if not radius:
        return "left out, because the region asked for is the target alone."
    return Asked(radius=radius, disturbance=disturbance, tolerance=tolerance or radius * SETTLED)


def _proved_box(checks: Sequence[Check]) -> tuple[Fraction, Fraction] | str | None:
    """Radius and disturbance of the max-separable box; None where all starts are proved, or nothing was tried."""
    found = next((check for check in checks if check.id == "max-separable"), None)
    if found is None:
        return None
    if found.verdict is not Verdict.PROVED:
        prefix = "" if found.applies else "does not apply: "
        return f"{prefix}stages begin with a max-separable certificate, and there is none."
    if not isinstance(found.domain, Mapping):
        return None
    return claimed(found.domain["radius"]), claimed(found.domain["disturbance"])
