"""Certified final bounds against the exact L-infinity gain of random linear loops, and against
bang-bang runs."""

import numpy as np
from evidence.row import Row
from stated_tables import exact_gain, final_errors

from dobc_design import Problem, certify, load_problem, verify
from dobc_design.conditions.accuracy.decide import Accuracy

MEDIAN = 2.2  # how many times the exact gain a bound may be, in the median
CURVED = {"disturbance": "1/10", "drift": "1/100", "measurement": "1/1000"}


def run(count: int, seed: int) -> Row:
    """Every bound is at least what some input reaches; 100 random problems, and paper-fixed with
    its own coupling."""
    failures: list[str] = []
    ratios: list[float] = []
    shares: list[float] = []
    for number in range(seed, seed + count):
        problem, gain = exact_gain(number)
        bounds = _bounds(problem)
        if bounds is None:
            failures.append(f"seed {number}: not proved and confirmed by both programs")
            continue
        ratios += (bounds / gain).tolist()
        reached = final_errors(problem, seed=number, runs=1)
        shares.append(float(np.max(reached / bounds)))
        if np.any(bounds < gain) or np.any(reached > bounds):
            failures.append(f"seed {number}: bounds {bounds}, reached {gain} and {reached}")
    problem = load_problem("paper-fixed").replace(region=None, uncertainty=CURVED)
    bounds = _bounds(problem)
    reached = final_errors(problem, seed=seed, runs=10)
    if bounds is None or np.any(reached > bounds):
        failures.append(f"paper-fixed: bounds {bounds}, reached {reached}")
    else:
        shares.append(float(np.max(reached / bounds)))
    median = float(np.median(ratios))
    if median > MEDIAN:
        failures.append(f"in the median a bound is {median:.3f} times the exact gain")
    notes = [
        f"bound / exact gain: least {min(ratios):.4f}, median {median:.3f}, largest "
        f"{max(ratios):.3f}"
    ]
    notes.append(
        f"bang-bang runs reach {min(shares):.3f} to {max(shares):.3f} of a bound; "
        f"paper-fixed {shares[-1]:.3f}"
    )
    return Row(
        "final bounds of |e_i| against exact gains and bang-bang runs", count, failures, notes
    )


def _bounds(problem: Problem) -> np.ndarray | None:
    certificate = certify(problem)
    claim = next(check for check in certificate.checks if check.id == "accuracy").claim
    if not isinstance(claim, Accuracy) or not verify(certificate, problem).holds:
        return None
    return np.array([float(claim.bounds[label]) for label in problem.network.labels])
