"""What the checks tolerance and actuators claim (theory, section 12).

Tolerance.  For all weights and gains within relative errors the rows of the max-separable certificate beside it hold
at a rate alpha > 0; each row takes the worse ends.  Observers whose model of the weights is off by as much add

    eps' = (A - W C) eps - W sum_j dw h(y),   |dw| <= delta w,   so   D+ E <= -beta E + eta N,
    eta = max |W|_P delta sum_j w (v_i + v_j) sup |h(y)/y|,   |W|_P = sum of sqrt(c'Pc) over the columns c of W,

and V = N + kappa E decreases where kappa eta < alpha.  A claim with a v of its own is about the slopes at the target.

Actuators.  u_i = -k_i e_i - d_i + C eps_i, so on {N + kappa E <= rho} every |u_ic| is at most
rho max(|k_i|_1 v_i, 1/kappa) + max |d_i|, where |k_i|_1 is the largest row sum of sizes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from dobc_design.conditions.check import Check, Claim, read_object
from dobc_design.conditions.numbers import read_rational, vector_from_json, vector_to_json
from dobc_design.conditions.separable.claim import Errors
from dobc_design.exact.matrix import Matrix, Vector
from dobc_design.exact.number import number_text
from dobc_design.exact.symmetric import Doubles
from dobc_design.problem.problem import Problem


@dataclass(frozen=True, slots=True, kw_only=True)
class Tolerance:
    """The rows hold at the rate ``alpha`` (1/s) for all ``errors``.  ``v``: one entry per agent, for the slopes at the
    target; None for the rows of the certificate beside it.  ``eta`` (1/s): where observers do not know the errors."""

    errors: Errors
    alpha: Fraction
    eta: Fraction | None = None
    v: Vector | Doubles | None = None

    def to_json(self) -> dict[str, Any]:
        """The exact values of a proved check."""
        numbers = {"weights": self.errors.weights, "gains": self.errors.gains, "alpha": self.alpha, "eta": self.eta}
        values: dict[str, Any] = {name: number_text(x) for name, x in numbers.items() if x is not None}
        return values if self.v is None else {**values, "v": vector_to_json(self.v)}


@dataclass(frozen=True, slots=True, kw_only=True)
class Inputs:
    """On {V <= rho}, which holds all starts of the check, every component of u_i is at most ``inputs[label]``."""

    rho: Fraction
    inputs: Mapping[str, Fraction]

    def to_json(self) -> dict[str, Any]:
        """The exact values of a proved check."""
        inputs = {label: number_text(most) for label, most in self.inputs.items()}
        return {"rho": number_text(self.rho), "inputs": inputs}


def read_claim(check: Check, problem: Problem, W: Matrix | None) -> Claim:
    """What a proved check of this topic claims; the gain ``W`` is not needed.  Raises: KeyError, TypeError, ValueError
    or SpecError for anything that cannot be such a claim."""
    if check.id == "actuators":
        values = read_object(check.exact, ("rho", "inputs"))
        found = read_object(values["inputs"], problem.network.labels)
        inputs = {label: read_rational(found[label]) for label in problem.network.labels}
        return Inputs(rho=read_rational(values["rho"]), inputs=inputs)
    optional = [name for name in ("eta", "v") if name in (check.exact or {})]
    values = read_object(check.exact, ("weights", "gains", "alpha", *optional))
    weights, gains, alpha = (read_rational(values[name]) for name in ("weights", "gains", "alpha"))
    if not (0 <= weights < 1 and 0 <= gains < 1 and alpha > 0):
        raise ValueError("errors must be >= 0 and < 1, alpha > 0")
    eta = read_rational(values["eta"]) if "eta" in optional else None
    v = vector_from_json(values["v"], problem.n) if "v" in optional else None
    return Tolerance(errors=Errors(weights, gains), alpha=alpha, eta=eta, v=v)
