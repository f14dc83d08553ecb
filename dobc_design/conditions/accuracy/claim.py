"""Final bounds of the error under [uncertainty]: what a proved ``accuracy`` claims (theory, section 12).

The plant is x_i' = sum_j w h_ij(x_j - x_i) + u_i + d_i + w_i with |w_i| <= omega, xi_i' = A xi_i + g_i with |g_i| <=
gamma, and every measured state may be off by nubar (by component, all).  Then every start of the domain ends with
|e_i| <= bounds_i, for arbitrary switching, and no start of it leaves the box |e_i| <= rho v_i of the first stage.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Final

from dobc_design.conditions.check import Check, read_object
from dobc_design.conditions.numbers import read_rational, vector_from_json, vector_to_json
from dobc_design.conditions.separable.claim import ErrorBound, separable_from_json
from dobc_design.exact.matrix import Matrix, Vector
from dobc_design.exact.number import number_text
from dobc_design.exact.symmetric import Doubles, least
from dobc_design.problem.canonical import matrix_text
from dobc_design.problem.problem import Problem

MOST_STAGES: Final = 30
ERROR: Final = ("P", "beta", "kappa", "size")


@dataclass(frozen=True, slots=True, kw_only=True)
class Level:
    """One stage: for all s in [level, rho] the box |e_i| <= s v_i shrinks, N = max |e_i|/v_i falling at least at the
    rate alpha.  ``rho`` None: for all s >= level (linear couplings).  All numbers > 0."""

    v: Vector | Doubles
    alpha: Fraction
    level: Fraction
    rho: Fraction | None

    def to_json(self) -> dict[str, Any]:
        """The exact values as text."""
        numbers = {name: number_text(getattr(self, name)) for name in ("alpha", "level")}
        return {"v": vector_to_json(self.v), **numbers, "rho": None if self.rho is None else number_text(self.rho)}


@dataclass(frozen=True, slots=True, kw_only=True)
class Peaks:
    """How far the observer passes on what the model leaves out, F = A - WC: upper bounds of the integrals of
    |C exp(F t) W| (``disturbance``), |C exp(F t)| (``drift``), and of |C exp(F t) F W|, plus |C W| (``measurement``),
    row sums, in every group of agents.  Shown in ``steps`` steps of ``step`` (s)."""

    disturbance: Fraction
    drift: Fraction
    measurement: Fraction
    step: Fraction
    steps: int

    def to_json(self) -> dict[str, Any]:
        """The exact values as text."""
        names = ("disturbance", "drift", "measurement", "step")
        return {**{name: number_text(getattr(self, name)) for name in names}, "steps": self.steps}


@dataclass(frozen=True, slots=True, kw_only=True)
class Accuracy:
    """Stages from the outside inwards, and ``bounds``: label -> final bound of |e_i|.  ``peaks``: with an exosystem;
    ``error``: with one, where the couplings are not linear."""

    stages: tuple[Level, ...]
    bounds: Mapping[str, Fraction]
    peaks: Peaks | None = None
    error: ErrorBound | None = None

    def to_json(self) -> dict[str, Any]:
        """The exact values of a proved check."""
        values: dict[str, Any] = {"stages": [stage.to_json() for stage in self.stages]}
        values["bounds"] = {label: number_text(bound) for label, bound in self.bounds.items()}
        if self.peaks is not None:
            values["peaks"] = self.peaks.to_json()
        if self.error is not None:
            values["P"] = matrix_text(self.error.P)
            values |= {name: number_text(getattr(self.error, name)) for name in ERROR[1:]}
        return values


def read_claim(check: Check, problem: Problem, W: Matrix | None) -> Accuracy:
    """What a proved check claims, for this problem; the gain ``W`` (q, m) is not needed.  Raises what a malformed claim
    raises: KeyError, TypeError, ValueError or a DobcError."""
    curved = bool(problem.groups) and not problem.is_linear
    names = ("stages", "bounds", *(("peaks",) if problem.groups else ()), *(ERROR if curved else ()))
    values = read_object(check.exact, names)
    if not isinstance(values["stages"], list) or not 1 <= len(values["stages"]) <= MOST_STAGES:
        raise ValueError(f"it needs between 1 and {MOST_STAGES} stages")
    stages = tuple(_read_level(each, problem) for each in values["stages"])
    bounds = read_object(values["bounds"], problem.network.labels)
    peaks = error = None
    if problem.groups:
        found = read_object(values["peaks"], ("disturbance", "drift", "measurement", "step", "steps"))
        if type(found["steps"]) is not int:
            raise TypeError("steps must be an integer")
        numbers = {name: read_rational(found[name]) for name in found if name != "steps"}
        peaks = Peaks(**numbers, steps=found["steps"])
    if curved:  # as it stands beside v, alpha and rho in a max-separable check
        first = {**{name: values["stages"][0][name] for name in ("v", "alpha", "rho")}, **{x: values[x] for x in ERROR}}
        error = separable_from_json(first, problem).error
    return Accuracy(
        stages=stages,
        bounds={label: read_rational(bounds[label]) for label in problem.network.labels},
        peaks=peaks,
        error=error,
    )


def _read_level(data: object, problem: Problem) -> Level:
    values = read_object(data, ("v", "alpha", "level", "rho"))
    if (values["rho"] is None) != problem.is_linear:
        raise ValueError("rho must be null exactly where every coupling is linear")
    rho = None if values["rho"] is None else read_rational(values["rho"])
    v = vector_from_json(values["v"], problem.n)
    stage = Level(v=v, alpha=read_rational(values["alpha"]), level=read_rational(values["level"]), rho=rho)
    if min(stage.alpha, stage.level, least(v)) <= 0 or (rho is not None and rho < stage.level):
        raise ValueError("v, alpha and level must be > 0, and rho at least level")
    return stage
