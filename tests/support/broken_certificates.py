"""Random single changes of a certificate's JSON: what a forger, a bad disk or a bug would do."""

import json
from fractions import Fraction
from random import Random
from typing import Any

NAMES = """proved refuted undecided global consensus lemma1 theorem1 theorem2 theorem1-printed
theorem2-printed hurwitz
observability detectability reachability lure max-separable ball interval vertices vector agents
Lambda P
Omega0 given designed G0 G1 NaN Infinity"""
WORDS = (*NAMES.split(), "", "0", "1", "-1")
FIELDS = ("evidence", "extra", "margin", "rate", "exact", "witness", "mode", "labels", "bound")
NUMBERS: tuple[Any, ...] = (0, -0.0, 1, -1, 1e-9, 1e9, 5e-324, 1.7e308, True, None, "0.5", [], {})


def mutate(document: dict[str, Any], seed: int, *, other: dict[str, Any]) -> dict[str, Any]:
    """A copy with one random change; ``other`` is another certificate, to borrow parts from."""
    r = Random(seed)
    copy = json.loads(json.dumps(document))
    holder, name = r.choice(
        [place for place in _places(copy) if place[1] != "reason" or r.random() < 0.1]
    )
    value = holder[name]
    change = r.random()
    if change < 0.08:
        del holder[name]
    elif change < 0.14 and isinstance(holder, list):
        holder.insert(r.randrange(len(holder) + 1), value)
    elif change < 0.14:
        holder[r.choice(FIELDS)] = value
    elif change < 0.24:
        holder[name] = _borrowed(name, other, r)
    elif change < 0.30 and isinstance(holder, list) and len(holder) > 1:
        k = r.randrange(len(holder))
        holder[name], holder[k] = holder[k], holder[name]
    elif change < 0.45 and name == "checks":
        check = r.choice(value)
        check[r.choice(list(check))] = r.choice(WORDS)
    else:
        holder[name] = _changed(value, r)
    return copy


def claim(document: dict[str, Any], seed: int) -> dict[str, Any]:
    """Several changes that belong together: another overall verdict, and checks bent to support
    it."""
    r = Random(seed)
    copy = json.loads(json.dumps(document))
    copy["verdict"] = r.choice(("proved", "refuted", "undecided"))
    if copy["verdict"] != "proved":
        copy["rate"] = copy["covered_by"] = None
    count = len(copy["checks"])
    for check in r.sample(copy["checks"], r.randint(1, count)):
        check["verdict"] = r.choice(("proved", "refuted", "undecided", check["verdict"]))
        if check["verdict"] == "undecided":
            check["margin"] = check["rate"] = None
            for part in ("exact", "witness"):
                if r.random() < 0.8:
                    check.pop(part, None)
        if check["id"] == "lemma1" and r.random() < 0.5:
            check["exact"] = {"unstable_roots": "1"}
    if copy["observer"]["source"] == "designed" and r.random() < 0.5:
        W = copy["observer"]["W"]
        copy["observer"]["W"] = [[str(r.randint(-3, 3)) for _ in row] for row in W]
        if r.random() < 0.5:
            copy["observer"]["P"] = copy["observer"]["Q"] = None
    return copy


def _places(tree: Any) -> list[tuple[Any, Any]]:
    found: list[tuple[Any, Any]] = []
    keys = (
        list(tree) if isinstance(tree, dict) else range(len(tree)) if isinstance(tree, list) else []
    )
    for name in keys:
        found.append((tree, name))
        found += _places(tree[name])
    return found


def _borrowed(name: Any, other: dict[str, Any], r: Random) -> Any:
    same = [holder[key] for holder, key in _places(other) if key == name and isinstance(name, str)]
    anything = [holder[key] for holder, key in _places(other)]
    return r.choice(same or anything)


def _changed(value: Any, r: Random) -> Any:
    if isinstance(value, bool) or value is None:
        return r.choice(NUMBERS)
    if isinstance(value, (int, float)):
        near_values = (
            value * 1.001,
            value * 0.999,
            value / 2,
            -value,
            value * 2,
            value + 1,
            value * (1 + 1e-12),
            *NUMBERS,
        )
        return r.choice(near_values)
    if isinstance(value, str):
        return _changed_text(value, r)
    if isinstance(value, list):
        backwards = value[::-1]
        longer = value + value[:1]
        others = (backwards, value[1:], longer, [], None, "NaN", {})
        return r.choice(others)
    entries = list(value.items())
    all_but_one = dict(entries[1:])
    return r.choice(({}, None, [], "NaN", all_but_one))


def _changed_text(value: str, r: Random) -> Any:
    try:
        number = Fraction(value)
    except (ValueError, ZeroDivisionError):
        return r.choice(WORDS)
    slightly_more = number * Fraction(1001, 1000)
    barely_more = number + Fraction(1, 10**30)
    near = (-number, number + 1, slightly_more, barely_more, number / 2, Fraction(0))
    capped = float(min(number, 10**300))
    spelt = (value + "0", "+" + value, " " + value, "1/0", capped)
    return r.choice((*map(str, near), *spelt, *WORDS))
