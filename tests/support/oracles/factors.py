"""The least factor that follows from what a proved check claims, by NumPy in floating point."""

import math
from typing import Any

import numpy as np

from dobc_design.conditions.numbers import vector_from_json

Array = Any
CLOSE = 1e-9
OF_THE_PAPER = ("lemma1", "theorem1", "theorem2", "theorem1-printed", "theorem2-printed", "safety")


def numbers(values: Any) -> Array:
    """Rationals as floats, a vector or a matrix."""
    if isinstance(values, dict):
        size = len(values["float64"]) * 3 // 32  # of base64 with at most two bytes of padding
        return np.array([float(x) for x in vector_from_json(values, size)])
    if values and isinstance(values[0], list):
        return np.array([[_number(x) for x in row] for row in values])
    return np.array([_number(x) for x in values])


def _number(text: str) -> float:
    top, _, bottom = text.partition("/")
    return float(top) / float(bottom or "1")


def condition(*forms: Array) -> float:
    """lambda_max of any of them over lambda_min of any."""
    values = np.concatenate([np.linalg.eigvalsh(form) for form in forms])
    return float(values.max() / values.min())


def of_weights(exact: dict[str, Any]) -> float:
    """Of max |(T e_i)_c| / v_ic."""
    v = numbers(exact["v"])
    if "T" not in exact:
        return float(v.max() / v.min())
    T = numbers(exact["T"])
    by_agent = v.reshape(-1, len(T))
    into = max(float((np.abs(T).sum(axis=1) / own).max()) for own in by_agent)
    back = max(float((np.abs(np.linalg.inv(T)) @ own).max()) for own in by_agent)
    return into * back


def of_phases(exact: dict[str, Any], first: list[int]) -> float:
    """Of max |e_i| / v_i(t), without T: v(0) of a first phase, and the largest v(t) exp(rate t) on
    a fine grid."""
    rate = _number(exact["rate"])
    begun = math.inf
    highest = 0.0
    for place, phase in enumerate(exact["phases"]):
        times = numbers(phase["times"])
        v = numbers(phase["v"])
        if place in first:
            begun = min(begun, float(v[0].min()))
        fine = np.linspace(0, times[-1], 400)
        interpolated = [np.interp(fine, times, column) for column in v.T]
        moving = np.array(interpolated)
        weighted_boxes = moving * np.exp(rate * fine)
        top = weighted_boxes.max()
        highest = max(highest, float(top))
    return highest / begun


def of_entries(entries: list[list[Any]], size: int) -> float:
    """The condition of P_e, which is listed by its entries."""
    P_e = np.zeros((size, size))
    for i, j, value in entries:
        P_e[i, j] = P_e[j, i] = _number(value)
    return condition(P_e)


def least_factor(check: dict[str, Any], checks: list[dict[str, Any]]) -> float | None:
    """The factor that follows; None where none does (and for a schedule, which needs the
    phases)."""
    id = check["id"]
    exact = check.get("exact") or {}
    if id in OF_THE_PAPER:
        return 1.0
    if id.endswith("weighted"):
        D = numbers(exact["D"])
        form = condition(numbers(exact["R"])) if "R" in exact else 1.0
        return math.sqrt(float(D.max() / D.min()) * form)
    if id == "max-separable" or (id == "tolerance" and "v" in exact):
        return of_weights(exact)
    if id in ("delay", "tolerance"):
        return of_weights(next(each["exact"] for each in checks if each["id"] == "max-separable"))
    if id == "lure":
        size = 1 + max(j for _, j, _ in exact["P_e"])
        entries = of_entries(exact["P_e"], size)
        return math.sqrt(entries)
    if id == "markov" and exact["kind"] == "mean square":
        matrices = map(numbers, exact["P"].values())
        return math.sqrt(condition(*matrices))
    if id == "markov" and exact["kind"] == "mean":
        w = np.array([numbers(each) for each in exact["w"].values()])
        return float(w.sum(axis=1).max() / w.min())
    return None


def false_factor(check: dict[str, Any], checks: list[dict[str, Any]]) -> list[str]:
    """Why the factor of a check is too small; empty if it is not, or claims nothing."""
    factor = check.get("factor")
    if factor is None:
        return []
    if check["verdict"] == "proved" and check["rate"] is not None:
        least = least_factor(check, checks)
    else:
        least = None
    if least is not None and factor >= max(1.0, least * (1 - CLOSE)):
        return []
    return ["factor"]
