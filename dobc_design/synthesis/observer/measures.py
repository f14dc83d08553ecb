"""What a proved gain W is worth, in numbers that are proved: each is rounded towards the weaker claim.

Estimates come from outside; only what exact arithmetic confirms is reported. A number that could not be confirmed is
left out. ``peak_seen`` alone is an observation (a grid in time), as its name says.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from fractions import Fraction
from math import inf

from dobc_design.conditions.numbers import claimed, largest_proved
from dobc_design.exact.matrix import Matrix
from dobc_design.problem.exosystems import Exosystem
from dobc_design.synthesis.observer.design import gain_squared
from dobc_design.synthesis.observer.norms import channel, h2_squared, hinf_below, root_above
from dobc_design.synthesis.observer.request import CHANNELS
from dobc_design.synthesis.observer.spectrum import damping_holds, error_matrix, rate_holds

WIDENINGS = (1e-9, 1e-7, 1e-5, 1e-3)
LARGEST_ORDER = 12  # beyond it exact norms take too long to be had by the way


def proved_measures(exosystem: Exosystem, W: Matrix, estimates: Mapping[str, float]) -> dict[str, float]:
    """Gain, rate (1/s), damping and the norms of the three channels, "hinf measurement" and so on, for W (q, m)."""
    F = error_matrix(exosystem, W)
    result = {"gain": root_above(gain_squared(W))}
    for name, holds in (("rate", rate_holds), ("damping", damping_holds)):
        proved = _largest(estimates.get(name, 0.0), lambda x, holds=holds: holds(F, x))  # type: ignore[misc]
        if proved:
            result[name] = proved
    if "peak" in estimates:
        result["peak_seen"] = estimates["peak"]
    if exosystem.order <= LARGEST_ORDER:
        for name in CHANNELS:
            result |= _norms(exosystem, W, name, estimates)
    return result


def _largest(estimate: float, holds: Callable[[Fraction], bool]) -> float | None:
    """The estimate to nine digits if that is true, border included, else a little less."""
    if 0 < estimate < inf:
        short = float(f"{estimate:.9g}")
        if holds(claimed(short)):
            return short
    return largest_proved(estimate, lambda x: x == 0 or holds(x))


def _norms(exosystem: Exosystem, W: Matrix, name: str, estimates: Mapping[str, float]) -> dict[str, float]:
    system = channel(exosystem, W, name)
    square = h2_squared(system)
    result = {f"h2 {name}": inf if square is None else root_above(square)}
    estimate = estimates.get(f"hinf {name}", inf)
    for widening in WIDENINGS:
        bound = estimate * (1 + widening)
        if 0 < bound < inf and hinf_below(system, claimed(bound)):
            result[f"hinf {name}"] = bound
            break
    return result
