"""The problem files that ``golden.py`` records: random ones of every kind and others.

Every file is written as TOML text here, from its own seed, and nothing of the program is imported:
the same files reach every version of it.  What a kind is about stands in the docstring of its
function; most kinds mix problems that are proved, refuted and left open.
"""

import json
import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import partial
from pathlib import Path
from random import Random
from typing import Any

Table = dict[str, Any]

RISING = ("exp(y) - 1 + y", "tanh(y)", "y + y**3", "y", "3*y/2", "atan(2*y)", "y + sin(y)/2")
TURNING = ("sin(y)", "y/(1 + y**2)", "y - y**3/9")
WEIGHTS = (1, 1, 2, "1/2", "7/5", 3)
SINE: Table = {"A": [[0, 2], [-2, 0]], "C": [[1, 0]]}
SINE_GAIN = [["16/5"], ["12/5"]]
SEEN: Table = {"exosystem": SINE, "observer": {"W": SINE_GAIN}}
STEADY: Table = {"exosystem": {"constant": True}, "observer": {"W": [[2]]}}
#: Agent 2 has no disturbance.
SPARED: Table = SINE | {"groups": [{"agents": [2], "none": True}]}
COLUMN = [[0], [1]]


@dataclass(frozen=True, kw_only=True)
class Input:
    """A problem file (``text`` is empty for a built-in problem) and what is asked about it.

    ``options``: of ``dobc certify``.  ``files``: name -> what writes a file beside it.  ``number``:
    its place in its kind, by which a share of each kind is also designed, simulated or exported.
    ``long``: takes minutes, and is recorded last.
    """

    name: str
    kind: str
    number: int
    text: str = ""
    options: tuple[str, ...] = ()
    files: Mapping[str, Callable[[], str]] = field(default_factory=dict)
    long: bool = False

    @property
    def source(self) -> str:
        """What the program is told to read."""
        if self.text:
            return "problem.toml"
        return self.name.removeprefix("builtin-")


# ---- TOML ----------------------------------------------------------------------------------------


def toml_value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Fraction):
        return f'"{value}"'
    if isinstance(value, list | tuple):
        return "[" + ", ".join(toml_value(each) for each in value) + "]"
    if isinstance(value, dict):
        items = (f"{json.dumps(str(key))} = {toml_value(each)}" for key, each in value.items())
        return "{ " + ", ".join(items) + " }"
    return json.dumps(value)


def toml_text(document: Table) -> str:
    """Values first, then one table for each entry that is a dict; deeper tables stand in one
    line."""
    lines = []
    for key, value in document.items():
        if not isinstance(value, dict):
            lines.append(f"{key} = {toml_value(value)}")
    for key, value in document.items():
        if isinstance(value, dict):
            lines.append(f"\n[{key}]")
            for name, each in value.items():
                lines.append(f"{name} = {toml_value(each)}")
    return "\n".join(lines) + "\n"


# ---- Parts ---------------------------------------------------------------------------------------


def tree(
    r: Random, n: int, *, extra: float = 0.15, weights: tuple[Any, ...] = WEIGHTS
) -> list[Any]:
    """Arcs in which every agent hears one with a smaller number, and some others."""
    arcs = [[i, r.randint(1, i - 1), r.choice(weights)] for i in range(2, n + 1)]
    known = {(i, j) for i, j, _ in arcs}
    for i in range(1, n + 1):
        for j in range(1, n + 1):
            if i != j and (i, j) not in known and r.random() < extra:
                arcs.append([i, j, r.choice(weights)])
    return arcs


def problem(arcs: Any, h: Any, gains: Any, *, n: int, **tables: Any) -> Table:
    """``arcs`` of one mode, or mode -> arcs."""
    modes = arcs if isinstance(arcs, dict) else {"G": arcs}
    parts: Table = {"network": {"agents": n, "arrow": "listens_to", "modes": modes}}
    parts["coupling"] = h if isinstance(h, dict) else {"h": h}
    if gains is not None:
        parts["pinning"] = {"gains": gains}
    return {**tables, **parts}


def held(
    r: Random, *, couplings: tuple[str, ...] = RISING, least: int = 2, most: int = 6, **tables: Any
) -> Table:
    """A random tree whose first agent is pinned, and perhaps others."""
    n = r.randint(least, most)
    gains: Table = {"1": r.choice((1, 3, 5, "9/2"))}
    for i in range(2, n + 1):
        if r.random() < 0.25:
            gains[str(i)] = r.choice((1, 2, "5/3"))
    return problem(tree(r, n), r.choice(couplings), gains, n=n, **tables)


def within(radius: Any, *errors: Any) -> Table:
    """Starts that far from 0; ``errors``: how far estimates may be off at first."""
    below = f"-{radius}" if isinstance(radius, str) else -radius
    found: Table = {"initial_states": [below, radius]}
    if errors:
        found["initial_disturbance"] = errors[0]
    return found


def in_turn(*modes: str, dwell: Any = 1) -> Table:
    return {"guarantee": "sequence", "sequence": list(modes), "dwell": dwell}


def lasting(dwell: Any, longest: Any = None) -> Table:
    """How long a mode lasts at least, and at most."""
    found: Table = {"guarantee": "dwell", "dwell": dwell}
    if longest is not None:
        found["longest"] = longest
    return found


def dragged(drag: int) -> Table:
    """Double integrators with drag."""
    return {"A": [[0, 1], [0, -drag]], "B": COLUMN}


def forced(f: str) -> Table:
    """x1'' = f and an input."""
    return {"f": ["x2", f], "B": COLUMN}


def box(r: Random, *errors: Any) -> Table:
    radius = r.choice(("1/2", 1, 2))
    return within(radius, *errors) | {"initial_states": [f"-{radius}", radius]}


# ---- Kinds: agents that are integrators ----------------------------------------------------------


def plain(r: Random, k: int) -> Table:
    """No disturbance, no region: every coupling in turn, pins few or many, with and without
    weights."""
    return held(r, couplings=((*RISING, *TURNING)[k % 10],), most=8)


def disturbed(r: Random, k: int) -> Table:
    """An exosystem and an observer: W given, W and P, a rate, or nothing but the exosystem."""
    observers: tuple[Table, ...] = (
        {"W": SINE_GAIN},
        {"W": SINE_GAIN, "P": [["1/2", "-1/4"], ["-1/4", "1/3"]]},
        {"W": SINE_GAIN, "P": [[30, -10], [-10, 30]]},
        {"rate": "3/2"},
        {},
    )
    return held(r, exosystem=SINE, observer=observers[k % 5], target=r.choice((0, 1)))


def exosystems(r: Random, k: int) -> Table:
    """The short forms of an exosystem, and random matrices."""
    A = []
    for _ in range(3):
        A.append([Fraction(r.randint(-4, 4), 2) for _ in range(3)])
    forms: tuple[Table, ...] = (
        {"constant": True},
        {"ramp": True},
        {"hz": [0.2, 0.5], "constant": True},
        {"frequencies": 2},
        {"kind": "harmonics", "frequencies": [1, 3]},
        {"A": A, "C": [[1, 0, 1]]},
    )
    return held(r, exosystem=forms[k % 6])


def bad_observers(r: Random, k: int) -> Table:
    """W with which the error grows, an exosystem that C does not see, stable or not, W with a slow
    error."""
    hidden = [[0, 0], [0, (-1, 0, 1)[k // 4 % 3]]]
    cases: tuple[Table, ...] = (
        {"exosystem": SINE, "observer": {"W": [[-1], [2]]}},
        {"exosystem": {"A": hidden, "C": [[1, 0]]}},
        {"exosystem": {"A": [[0]], "C": [[1]]}, "observer": {"W": [["1/100"]]}},
        {"exosystem": {"A": [["1/2"]], "C": [[0]]}},
    )
    return held(r, **cases[k % 4])


def unreached(r: Random, k: int) -> Table:
    """Agents that no pin reaches: nobody is pinned, one agent alone, or two groups."""
    if k % 3 == 0:
        return held(r) | {"pinning": {"gains": {}}}
    n = r.randint(3, 6)
    arcs = tree(r, n - 1) if k % 3 == 1 else [[2, 1], *([i, i + 1] for i in range(3, n))]
    return problem(arcs, r.choice(RISING), {"1": 2}, n=n)


def several_modes(r: Random, k: int) -> Table:
    """Modes that switch arbitrarily; in every third problem one agent is lost in one of them."""
    n = r.randint(3, 6)
    number = r.randint(2, 4)
    modes = {f"G{i}": tree(r, n) for i in range(number)}
    if k % 3 == 2:
        modes["G0"] = [arc for arc in modes["G0"] if arc[0] != n]
    gains = {"1": r.choice((3, 5)), str(n - 1): 1}
    more = SEEN if k % 2 else {}
    return problem(modes, r.choice(RISING), gains, n=n, **more)


PLANE = (
    ["y1 + y2/2", "y2 - y1/2"],
    ["2*y1 + y2", "y1 + y2"],
    ["sin(y1) + y2/4", "3*y2"],
    ["y1 - y2/4", "tanh(y2)"],
)


def planar(r: Random, k: int) -> Table:
    """m = 2: lists in y1, y2 and couplings by component, gains that are matrices, skew and singular
    ones too."""
    gains = ([[2, 1], [-1, 2]], [[3, 0], [0, 0]], [[0, 1], [-1, 0]], 4, [[2, "1/2"], ["1/2", 1]])
    h = (*PLANE, "tanh(y)", "y + y**3")[k % 6]
    n = r.randint(2, 4)
    more: Table = (
        {"exosystem": {"A": [[0, 1], [-1, 0]], "C": [[1, 0], [0, 1]]}} if k % 3 == 1 else {}
    )
    return problem(tree(r, n), h, {"1": gains[k % 5]}, n=n, target=[1, -1], **more)


def spatial(r: Random, k: int) -> Table:
    """m = 3, in a list or by component, with an exosystem in every second problem."""
    h = (["y1 + y2/3", "y2 - y1/3", "y3"], "y", ["2*y1", "y2 + y3/2", "y3 - y2/2"], "tanh(y)")[
        k % 4
    ]
    n = r.randint(2, 4)
    more: Table = {"exosystem": {"constant": True}} if k % 2 else {}
    return problem(tree(r, n), h, {"1": 3}, n=n, target=[0, 1, 2], **more)


def exceptions(r: Random, k: int) -> Table:
    """Arcs with couplings of their own, rising or falling."""
    found = held(r, least=3)
    first, second = found["network"]["modes"]["G"][:2]
    h = (*RISING, "-y/8", "sin(y)")[k % 9]
    found["coupling"]["exceptions"] = [
        {"arcs": [first[:2]], "h": h},
        {"arcs": [second[:2]], "h": "2*y"},
    ]
    return found


def formations(r: Random, k: int) -> Table:
    """Offsets, for numbers and in the plane."""
    if k % 2:
        found = problem(tree(r, 4), "tanh(y)", {"1": 2}, n=4, target=[0, 0])
        return found | {"formation": {"offsets": {"2": [1, 0], "3": [0, "-3/2"]}}}
    found = held(r, least=3, region=box(r))
    return found | {"formation": {"offsets": {"2": 1, "3": "-3/2"}}}


def badly_scaled(r: Random, k: int) -> Table:
    """Tiny and huge gains and weights, irrational slopes, kinks, and slopes of 0 at the target."""
    h = ("y", "sin(pi*y)", "abs(y)", "y**3", "exp(1)*y", "clip(y, -1, 1)", "-y", "log(1 + y*pi)")[
        k % 8
    ]
    weights = (1, "1/1000000", 1000000) if k % 2 else (1, 2)
    n = r.randint(2, 4)
    return problem(tree(r, n, weights=weights), h, {"1": r.choice(("1/1000", 2, 100000))}, n=n)


def matrix_gains(r: Random, k: int) -> Table:
    """All agents pinned, by one number or one each."""
    n = r.randint(2, 6)
    gains: Any = (
        r.choice((1, "9/16", 3)) if k % 2 else {str(i): r.randint(1, 5) for i in range(1, n + 1)}
    )
    return problem(tree(r, n, extra=0.4), r.choice((*RISING, "sin(y)")), gains, n=n)


def one_agent(r: Random, k: int) -> Table:
    """One agent alone, with an observer."""
    more = SEEN
    return problem([], r.choice(RISING), {"1": r.choice((0, 2))} if k % 2 else None, n=1, **more)


def labelled(r: Random, k: int) -> Table:
    """Agents with names, arrows that send, notes."""
    names = ["nose", "left wing", "right_wing", "tail|1"]
    arcs = [["nose", "left wing"], ["nose", "right_wing", 2], ["left wing", "tail|1"]]
    network = {"agents": names, "arrow": "sends_to", "modes": {"a b": arcs}}
    found = {
        "notes": ["A note with *marks* and |bars|."],
        "network": network,
        "coupling": {"h": r.choice(RISING)},
    }
    return found | {"pinning": {"gains": {"nose" if k % 2 == 0 else "tail|1": 2}}}


# ---- Kinds: regions, settling times, searches ----------------------------------------------------


def regions(r: Random, k: int) -> Table:
    """Boxes of starts for every coupling, with and without errors of the estimate; some are too
    large."""
    h = (*RISING, *TURNING, *TURNING)[k % 13]
    if k % 3 == 1:
        more: Table = {"exosystem": SINE, "observer": {"W": SINE_GAIN}, "region": box(r, "1/10")}
        return held(r, couplings=(h,), most=5, **more)
    wide = within(5) if k % 3 == 2 else box(r)
    return held(r, couplings=(h,), most=5, region=wide)


def second_equilibria(r: Random, k: int) -> Table:
    """Two agents coupled by sines and weakly pinned: another equilibrium lies among the starts, or
    beyond them."""
    region = {"initial_states": [-(1, 5, 8)[k % 3], (1, 5, 8)[k % 3]]}
    return problem([[1, 2], [2, 1]], "sin(y)", r.choice(("1/10", "1/5")), n=2, region=region)


def planar_regions(r: Random, k: int) -> Table:
    """Boxes in the plane and in space."""
    if k % 3 == 2:
        return problem(
            tree(r, 3),
            "tanh(y)",
            {"1": 3},
            n=3,
            target=[0, 0, 0],
            region=within(1),
        )
    h = (*PLANE, "sin(y)", ["y1*y2 + y1", "y2"])[k % 6]
    region = {"initial_states": [["-1/2", "1/2"], ["-1/4", "1/4"]]}
    return problem(tree(r, 3), h, {"1": 4}, n=3, target=[0, 0], region=region)


def region_modes(r: Random, k: int) -> Table:
    """Boxes under modes that switch arbitrarily."""
    found = several_modes(r, 0) | {"region": box(r)}
    return found | {"coupling": {"h": ("tanh(y)", "sin(y)", "exp(y) - 1 + y")[k % 3]}}


# ---- Kinds: guarantees on time, optional arcs ----------------------------------------------------


def scattered(r: Random, n: int, number: int) -> Table:
    """Modes of which none reaches every agent alone: each arc of a tree is in one of them."""
    modes: Table = {f"M{i}": [] for i in range(number)}
    for place, arc in enumerate(tree(r, n, extra=0)):
        modes[f"M{place % number}"].append(arc)
    return modes


def sequences(r: Random, k: int) -> Table:
    """Modes in a known order, equal or uneven, repeated, by a period; one that misses an agent."""
    n = r.randint(3, 5)
    modes = scattered(r, n, 2)
    turns: tuple[Table, ...] = (
        {"sequence": ["M0", "M1"], "dwell": 1},
        {"sequence": ["M0", "M1", "M0"], "dwell": [1, 2, "1/2"]},
        {"schedule": [[0, "M0"], ["1/3", "M1"]], "period": 1, "signal": "periodic"},
        {"sequence": ["M1"], "dwell": 1},
        {"dwell": "1/2"},
    )
    found = problem(modes, r.choice((*RISING, "y", "y")), {"1": 3}, n=n)
    if found["coupling"]["h"] not in ("y", "3*y/2") and k % 2:
        found["region"] = box(r)
    if k % 4 == 3:
        found |= STEADY
        if "region" in found:
            found["region"]["initial_disturbance"] = "1/10"
    return found | {"switching": {"guarantee": "sequence"} | turns[k % 5]}


def dwell_times(r: Random, k: int) -> Table:
    """A mode lasts at least, and in every second problem at most, so long."""
    n = r.randint(3, 5)
    modes = scattered(r, n, 2) if k % 2 else {f"M{i}": tree(r, n, extra=0.1) for i in range(2)}
    turns = lasting(r.choice((1, "1/2", 2)), 3 if k % 2 else None)
    found = problem(modes, ("y", "tanh(y)", "y", "exp(y) - 1 + y", "-y")[k % 5], {"1": 2}, n=n)
    if k % 3 == 1:
        found["region"] = within(1)
    return found | {"switching": turns}


def guarantees_broken(r: Random, k: int) -> Table:
    """Modes that pull apart in turn, arcs that never reach an agent, gains that are too small for
    the round."""
    pair: Table = {"A": [[1, 2]], "B": [[2, 1]]}
    gain = ("1/2", "11/10", "1/10")[k % 3]
    turns = in_turn("A", "B", dwell=3)
    if k % 2:
        turns = lasting(1, 2)
    return problem(pair, "-y", gain, n=2, switching=turns)


def arbitrary(r: Random, k: int) -> Table:
    """Any signal, said so."""
    return several_modes(r, k) | {"switching": {"guarantee": "arbitrary"}}


def markov(r: Random, k: int) -> Table:
    """Chains of two and three modes, absorbing ones, unstable modes that the chain leaves soon
    enough or not."""
    if k % 4 == 3:
        pair: Table = {"A": [[1, 2]], "B": [[2, 1]]}
        rate = (9, 1)[k // 4 % 2]
        turns = {"guarantee": "markov", "generator": [[-rate, rate], [1, -1]]}
        return problem(pair, "-y", {"1": "1/2", "2": 3}, n=2, switching=turns)
    number = 2 + k % 2
    generator = []
    for i in range(number):
        generator.append([1 if i != j else 1 - number for j in range(number)])
    if k % 4 == 2:
        generator[0] = [0] * number  # once there, the chain stays
    n = r.randint(3, 5)
    found = problem(scattered(r, n, number), ("y", "tanh(y)", "2*y")[k % 3], {"1": 2}, n=n)
    if k % 3 == 1:
        found["region"] = within(1)
    return found | {"switching": {"guarantee": "markov", "generator": generator}}


def mobile(r: Random, k: int) -> Table:
    """Graphs from positions: all pinned, or one; couplings that rise, or turn."""
    signal: Table = {"signal": "mobile", "radius": 2.5, "hysteresis": "1/10"}
    if k % 2:
        signal = {"signal": "mobile", "neighbours": 2, "dwell": 1}
    n = 4
    gains: Any = 2 if k % 3 != 2 else {"1": 2}
    plane = {"target": [0, 0]} if k % 4 == 1 else {}
    found = problem(tree(r, n), ("tanh(y)", "y", "tanh(y)", "sin(y)")[k % 4], gains, n=n, **plane)
    return found | {"switching": signal, "region": within(1)}


def optional_arcs(r: Random, k: int) -> Table:
    """Arcs that come and go; in every third problem an agent depends on one."""
    n = r.randint(3, 5)
    arcs = tree(r, n, extra=0)
    more = [[1, n], [2, n, "1/2"]]
    if k % 3 == 2:
        more.append(arcs.pop())
    more = [arc for arc in more if arc[:2] not in [each[:2] for each in arcs]]
    modes: Table = {"G": {"arcs": arcs, "optional": more}}
    found = problem(
        modes, ("tanh(y)", "y", "sin(y)", "exp(y) - 1 + y")[k % 4], {"1": 3, str(n): 1}, n=n
    )
    if k % 2:
        found["region"] = within("1/2")
    if k % 5 == 4:
        modes["H"] = [list(arc) for arc in tree(r, n)]
        found["switching"] = lasting(1)
    return found


# ---- Kinds: groups -------------------------------------------------------------------------------


def groups(r: Random, k: int) -> Table:
    """Exosystems of their own: W given or designed, P for all, with a region, a bad W."""
    found = held(r, least=3, most=5, couplings=("tanh(y)", "y", "exp(y) - 1 + y"))
    own: Table = {"agents": [2], "A": [[0]], "C": [[1]], "W": [[2]]}
    if k % 5 == 1:
        del own["W"]
    if k % 5 == 2:
        own["W"] = [[-1]]
    exosystem: Table = SINE | {"groups": [own]}
    observer: Table = {"W": SINE_GAIN} if k % 2 else {}
    if k % 5 == 3:
        own["P"] = [[1]]
        observer = {"W": SINE_GAIN, "P": [[30, -10], [-10, 30]]}
    if k % 5 == 4:
        found["region"] = within(1, "1/10")
    return found | {"exosystem": exosystem, "observer": observer}


def groups_none(r: Random, k: int) -> Table:
    """Agents without a disturbance: a group with ``none = true``, or groups without an exosystem
    for the rest."""
    found = held(r, least=3, most=5, couplings=("tanh(y)", "y", "sin(y)"))
    if k % 2:
        exosystem: Table = {"groups": [{"agents": [1, 2], "A": [[0]], "C": [[1]], "W": [[2]]}]}
    else:
        exosystem = SPARED
        found["observer"] = {"W": SINE_GAIN}
    if k % 3 == 1:
        found["region"] = within("1/2", "1/20")
    if k % 4 == 3:
        found["uncertainty"] = {"disturbance": "1/100"}
    return found | {"exosystem": exosystem}


# ---- Kinds: [uncertainty] and [actuators] --------------------------------------------------------


def tolerances(r: Random, k: int) -> Table:
    """Relative errors of weights and gains, small or too large, for all agents or for a pair that
    pulls apart."""
    if k % 4 == 3:
        found = problem([[1, 2, "1/2"], [2, 1, "1/2"]], "-y", 2, n=2)
        return found | {"uncertainty": {"weights": ("1/2", "1/10")[k // 4 % 2], "gains": "1/10"}}
    found = held(r, couplings=("tanh(y)", "y", "exp(y) - 1 + y"), most=5)
    if k % 2:
        found["region"] = within(1)
    return found | {"uncertainty": {"weights": ("1/50", "1/5", "9/10")[k % 3], "gains": "1/20"}}


def accuracies(r: Random, k: int) -> Table:
    """Disturbance, drift and noise, with and without an observer and a region; too much for a
    coupling."""
    if k % 5 == 4:
        found = problem([[2, 1, 1]], "tanh(y)", {"1": 20}, n=2, region=within(1))
        return found | {"uncertainty": {"disturbance": "6/5"}}
    found = held(r, couplings=("tanh(y)", "y", "y + y**3/10"), most=5)
    noise: Table = {"disturbance": "1/50", "measurement": r.choice((0, "1/500"))}
    if k % 2:
        found |= SEEN | {"uncertainty": noise | {"drift": "1/100"}}
        if k % 3 == 1:
            found["region"] = within(1, "1/10")
        return found
    if k % 3:
        found["region"] = within(1)
    return found | {"uncertainty": noise}


def accuracies_and_tolerances(r: Random, k: int) -> Table:
    """Both together, and observers that do not know the true weights."""
    found = held(r, couplings=("tanh(y)", "y"), most=4)
    stated: Table = {"weights": "1/100", "gains": "1/100", "disturbance": "1/50"}
    if k % 2:
        found |= STEADY
        stated["known_to_agents"] = False
        if k % 4 == 3:
            found["region"] = within("1/2", "1/20")
    return found | {"uncertainty": stated}


def actuators(r: Random, k: int) -> Table:
    """Limits that hold, for all or for one agent, limits that the start or the disturbance alone
    exceeds."""
    found = held(r, couplings=("tanh(y)", "y", "sin(y)"), most=4)
    found["region"] = within(1)
    limit: Any = (30, 1, {"1": 30})[k % 3]
    table: Table = {"limit": limit}
    if k % 2:
        found |= SEEN
        found["region"]["initial_disturbance"] = "1/10"
        table["amplitude"] = ("1/2", 2)[k // 2 % 2]
    if k % 4 == 2:
        found["uncertainty"] = {"gains": "1/20"}
    if k % 5 == 4:
        found.pop("region")
    return found | {"actuators": table}


# ---- Kinds: agents with dynamics -----------------------------------------------------------------


DOUBLE: Table = {"A": [[0, 1], [0, 0]], "B": COLUMN}


def dynamics_linear(r: Random, k: int) -> Table:
    """p = m: stable, unstable and resonant agents, of one and two states."""
    if k % 2:
        a = ("1/2", -1, 1, "-1/4")[k // 2 % 4]
        n = r.randint(2, 5)
        gains: Table = {"1": r.choice((2, 4))}
        return problem(
            tree(r, n), r.choice(("y", "tanh(y)", "2*y")), gains, n=n, dynamics={"A": [[a]]}
        )
    A = ([[0, 1], [-1, 0]], [[-1, "1/2"], [0, -2]], [["1/4", 1], [-1, 0]])[k // 2 % 3]
    n = r.randint(2, 4)
    return problem(tree(r, n), "2*y", {"1": 3}, n=n, dynamics={"A": A}, target=[0, 0])


def dynamics_inputs(r: Random, k: int) -> Table:
    """p < m: double integrators, triple ones, drag, gains that are rows, a disturbance of the
    input."""
    n = r.randint(2, 5)
    if k % 5 == 4:
        chain: Table = {"A": [[0, 1, 0], [0, 0, 1], [0, 0, 0]], "B": [[0], [0], [1]]}
        return problem(tree(r, n, extra=0), "y1 + 3*y2 + 3*y3", {"1": 2}, n=n, dynamics=chain)
    h = ("y1 + 2*y2", "y1 + y2/4", "y1 + 3*y2")[k % 3]
    gains: Table = {"1": [[2, 3]]} if k % 2 else {"1": 3}
    more: Table = {}
    if k % 3 == 2:
        more = {"exosystem": {"constant": True, "hz": 0.5}}
    if k % 4 == 1:
        more = SEEN
    return problem(tree(r, n), h, gains, n=n, dynamics=DOUBLE, target=[1, 0], **more)


def dynamics_overdamped(r: Random, k: int) -> Table:
    """Drag in place of speeds in the coupling: coordinates in which the largest weighted error
    falls."""
    n = r.randint(2, 5)
    drag = r.choice((4, 6, 9))
    if k % 4 == 1:
        n = 2  # a region is decided by semidefinite programs
    found = problem(tree(r, n, extra=0), ("y1", "tanh(y1)", "sin(y1)")[k % 3], {"1": [[1, 0]]}, n=n)
    found["dynamics"] = dragged(drag)
    if k % 4 == 1:
        found["region"] = {"initial_states": [["-1/2", "1/2"], ["-1/4", "1/4"]]}
    if k % 4 == 2:
        found |= STEADY
    if k % 4 == 3:
        found["uncertainty"] = {"disturbance": "1/20"}
    return found


def dynamics_f(r: Random, k: int) -> Table:
    """Pendulums, cubic and bistable agents, with and without a region; targets that attract or
    repel."""
    n = r.randint(2, 4) if k < 6 else 2  # regions are decided by semidefinite programs
    cases: tuple[tuple[Table, Any, Any], ...] = (
        (forced("-sin(x1) - 3*x2"), "y1", {"1": [[1, 0]]}),
        (forced("-x1**3 - x2/2"), "y1 + 2*y2", {"1": 3}),
        ({"f": ["-x - x**3"]}, "tanh(y)", {"1": 1}),
        ({"f": ["x - x**3"]}, "3*y", {"1": 4}),
        ({"f": ["2*x + x**2"]}, "y", {"1": 1}),
        (forced("sin(x1) - x2/4"), "y1 + 2*y2", {"1": 1}),
    )
    dynamics, h, gains = cases[k % 6]
    found = problem(tree(r, n), h, gains, n=n, dynamics=dynamics)
    if k // 6 % 2:
        states = [["-1/4", "1/4"], ["-1/4", "1/4"]] if "B" in dynamics else ["-1/4", "1/4"]
        found["region"] = {"initial_states": states}
    return found


def dynamics_regions(r: Random, k: int) -> Table:
    """Boxes for linear agents with curved couplings."""
    found = problem([[2, 1]], "", {}, n=2, dynamics=DOUBLE)
    found["coupling"] = {"h": ("tanh(y1 + 2*y2)", "sin(y1) + 2*y2", "y1 + 2*y2")[k % 3]}
    found["pinning"] = {"gains": {"1": [[2, r.randint(2, 4)]]}}
    return found | {"region": {"initial_states": [["-1/2", "1/2"], ["-1/4", "1/4"]]}}


def dynamics_modes(r: Random, k: int) -> Table:
    """Modes, optional arcs and guarantees for agents with dynamics."""
    n = 3
    modes: Table = {f"M{i}": tree(r, n, extra=0, weights=(1,)) for i in range(2)}
    if k % 2:
        modes["M0"] = {"arcs": [[2, 1], [3, 2]], "optional": [[3, 1, "1/4"]]}
    drag = dragged(6)
    found = problem(modes, "y1", {"1": [[1, 0]]}, n=n, dynamics=drag if k % 3 else DOUBLE)
    if k % 3 == 0:
        found["coupling"] = {"h": "y1 + 2*y2"}
        found["pinning"] = {"gains": {"1": 1}}
    if k % 4 == 2:
        found["switching"] = lasting(1, 3)
    if k % 4 == 3:
        found["switching"] = in_turn("M0", "M1")
    return found


def dynamics_scattered(r: Random, k: int) -> Table:
    """Guarantees under which no mode alone reaches every agent."""
    n = r.randint(3, 4)
    found = problem(scattered(r, n, 2), "y1", {"1": [[1, 0]]}, n=n)
    found["dynamics"] = dragged(6)
    turns = in_turn("M0", "M1")
    if k % 3 == 1:
        turns = lasting(1, 2)
    if k % 3 == 2:
        turns = {"guarantee": "markov", "generator": [[-1, 1], [1, -1]]}
    return found | {"switching": turns}


def dynamics_groups(r: Random, k: int) -> Table:
    """Disturbances of inputs that differ between agents."""
    found = dynamics_overdamped(r, 0)
    own: Table = {"agents": [2], "A": [[0]], "C": [[1]], "W": [[2]]}
    if k % 2:
        return found | {"exosystem": {"groups": [own]}}
    return found | {"exosystem": SPARED}


def leader_linear(r: Random, k: int) -> Table:
    """The target is a solution of linear dynamics: oscillators, ramps, growing ones; with boxes of
    starts."""
    n = r.randint(2, 4)
    if k % 3 == 0:
        found = problem(tree(r, n), "2*y", {"1": 3}, n=n, dynamics={"A": [[0, 1], [-1, 0]]})
        return found | {"leader": {"initial": [[-1, 1], [0, "1/2"]]}}
    if k % 3 == 1:
        found = problem(tree(r, n), "y1 + 2*y2", {"1": 3}, n=n, dynamics=DOUBLE)
        return found | {"leader": {"initial": [0, 1]}}
    a = ("1/2", -1, 1)[k // 3 % 3]
    found = problem(tree(r, n), r.choice(("y", "tanh(y)")), {"1": 4}, n=n, dynamics={"A": [[a]]})
    found["leader"] = {"initial": [[-1, 1]]}
    if k % 2:
        found["region"] = within(1)
    return found


def leader_f(r: Random, k: int) -> Table:
    """The target is a solution of s' = f(s): bistable, excitable and swinging ones, with and
    without ``stays_in``."""
    n = r.randint(2, 3)
    if k % 3 == 0:
        found = problem(tree(r, n), "3*y", {"1": 4}, n=n, dynamics={"f": ["x - x**3"]})
        found["leader"] = {"initial": [["-1/2", "1/2"]]} | (
            {"stays_in": [[-1, 1]]} if k % 2 else {}
        )
        if k % 4 == 3:
            found["region"] = within("1/4")
        return found
    if k % 3 == 1:
        excitable: Table = {
            "f": ["x1 - x1**3/3 - x2 + 1/2", "0.08*(x1 + 0.7 - 0.8*x2)"],
            "B": [[1], [0]],
        }
        found = problem(tree(r, n), "4*y1", {"1": [[6, 0]]}, n=n, dynamics=excitable)
        return found | {"leader": {"initial": [[-1, 1], [0, "1/2"]]}}
    swing: Table = forced("-sin(x1) - 3*x2")
    found = problem(tree(r, n), "y1 + y2", {"1": [[2, 1]]}, n=n, dynamics=swing)
    return found | {"leader": {"initial": [["-1/4", "1/4"], ["-1/4", "1/4"]]}}


# ---- Kinds: what is refuted on purpose -----------------------------------------------------------


def lost(r: Random, k: int) -> Table:
    """A problem of each kind in which nobody is pinned."""
    makers = [disturbed, several_modes, spatial, exceptions, formations, regions, planar_regions]
    makers += [sequences, mobile, optional_arcs, groups, groups_none]
    makers += [tolerances, accuracies, actuators]
    return makers[k](r, 0) | {"pinning": {"gains": {}}}


def lost_optional(r: Random, k: int) -> Table:
    """An agent that only an optional arc reaches, in one mode or by turns."""
    found = problem({"G": {"arcs": [[2, 1]], "optional": [[3, 2]]}}, "tanh(y)", {"1": 2}, n=3)
    if k:
        found["network"]["modes"]["H"] = [[2, 1], [1, 2]]
        found["switching"] = in_turn("G", "H")
    return found


def not_kept(r: Random, k: int) -> Table:
    """Tables that state more than the loop withstands, for a reason in closed form."""
    box_of_one: Table = within(1)
    if k == 0:  # the disturbance alone needs more
        found = held(r, couplings=("y",), exosystem=SINE, observer={"W": SINE_GAIN})
        found["region"] = box_of_one | {"initial_disturbance": "1/10"}
        return found | {"actuators": {"limit": "1/2", "amplitude": 1}}
    if k == 1:  # agent 1 needs k R at its start
        found = problem([[2, 1]], "tanh(y)", {"1": 3}, n=2, region=box_of_one)
        return found | {"actuators": {"limit": {"1": 2}}}
    if k == 2:  # e_1 - e_2 grows where 2 w (1 + error) > k (1 - error)
        found = problem([[1, 2, "1/2"], [2, 1, "1/2"]], "-y", 2, n=2)
        return found | {"uncertainty": {"weights": "9/10", "gains": "1/10"}}
    if k == 3:  # a gain [[1, c], [c, 1]] is indefinite where 1 - error < c (1 + error)
        found = problem([], "y", {"1": [[1, "1/2"], ["1/2", 1]]}, n=1, target=[0, 0])
        return found | {"uncertainty": {"gains": "1/2"}}
    # the coupling gives less than what acts
    found = problem([[2, 1, 1]], "tanh(y)", {"1": 20}, n=2, region=box_of_one)
    if k == 4:
        return found | {"uncertainty": {"disturbance": "6/5"}}
    return found | {"uncertainty": {"disturbance": "3/4", "weights": "2/5"}}


def dynamics_unstable(r: Random, k: int) -> Table:
    """Gains of the wrong sign, agents that grow faster than their gains hold."""
    if k % 4 == 0:
        return problem(tree(r, 3), "y", {"1": 2}, n=3, dynamics={"A": [[3]]})
    if k % 4 == 1:
        return problem(tree(r, 3), "y1 + 2*y2", {"1": [[-1, 1]]}, n=3, dynamics=DOUBLE)
    drag = dragged(6)
    found = problem(tree(r, 3), "y1", {"1": [[-1, 0]]}, n=3, dynamics=drag)
    if k % 4 == 2:
        found["uncertainty"] = {"disturbance": "1/20"}
    if k % 4 == 3:
        found["dynamics"] = forced("sin(x1) - x2")
    if k > 3:
        found["exosystem"] = SPARED
    return found


def leader_unstable(r: Random, k: int) -> Table:
    """Followers that leave a growing leader, and some that nobody tells where it is."""
    if k:
        found = problem([[2, 1]], "y", {"1": 4}, n=3, dynamics={"A": [["1/2"]]})
    else:
        found = problem(tree(r, 3), "y", {"1": 2}, n=3, dynamics={"A": [[3]]})
    return found | {"leader": {"initial": [[-1, 1]]}}


# ---- Kinds: large networks -----------------------------------------------------------------------


def ring(n: int) -> list[Any]:
    found: list[Any] = []
    for i in range(1, n + 1):
        found += [[i, i % n + 1], [i % n + 1, i]]
    return found


def geometric(r: Random, n: int) -> list[Any]:
    """Points in the unit square, those closer than a radius coupled, beside a chain that connects
    all."""
    radius = (6 / (3.14159 * n)) ** 0.5
    points = sorted((r.random(), r.random()) for _ in range(n))
    found: list[Any] = []
    for i, (x, y) in enumerate(points):
        for j in range(i + 1, n):
            if points[j][0] - x > radius:
                break
            if j == i + 1 or (points[j][0] - x) ** 2 + (points[j][1] - y) ** 2 < radius**2:
                found += [[i + 1, j + 1], [j + 1, i + 1]]
    return found


LARGE_SIZES = (2500, 3000, 2200, 5000, 2100, 2400, 2300, 2600)


def large_arcs(k: int) -> str:
    """The text of the arcs of a ring or a geometric graph."""
    n = LARGE_SIZES[k]
    arcs = geometric(Random(f"golden large {k}"), n) if k % 2 else ring(n)
    return "".join(",".join(map(str, arc)) + "\n" for arc in arcs)


def large(k: int) -> Table:
    """Rings and geometric graphs, all of more than the 2,000 agents where sparse methods begin."""
    n = LARGE_SIZES[k]
    pins = {str(i): 2 for i in range(1, n + 1, 10)}
    h = ("tanh(y)", "exp(y) - 1 + y", "y", "tanh(y)", "y1", "y", "tanh(y)", "y")[k]
    found = problem({"G": {"file": "arcs.csv"}}, h, pins, n=n)
    if k in (0, 1, 3, 6):
        found["region"] = within(1)
    if k in (1, 2):
        found |= SEEN
        if k == 1:
            found["region"]["initial_disturbance"] = "1/10"
    if k == 4:
        found["dynamics"] = dragged(9)
        found["pinning"] = {"gains": {label: [[2, 0]] for label in pins}}
    if k == 5:
        found["pinning"] = {"gains": {}}
    if k == 6:
        found["uncertainty"] = {"weights": "1/100", "gains": "1/100"}
    if k == 7:
        found["uncertainty"] = {"disturbance": "1/50"}
    return found


# ---- Malformed files -----------------------------------------------------------------------------

VALID = """\
name = "four"
target = 1
[network]
agents = 4
arrow = "listens_to"
[network.modes]
G = [[1, 2], [2, 3], [3, 4], [4, 1, 0.5]]
H = [[1, 2], [2, 1], [3, 2], [4, 3]]
[coupling]
h = "exp(y) - 1 + y"
[pinning]
gains = { 1 = 5.0, 3 = "9/16" }
[exosystem]
A = [[0, 2], [-2, 0]]
C = [[1, 0]]
[observer]
W = [["16/5"], ["12/5"]]
[region]
initial_states = [0, 5]
initial_disturbance = 0.5
[switching]
signal = "random"
dwell = 0.5
"""
#: What replaces what, once.
MISTAKES: dict[str, tuple[str, str]] = {}
MISTAKES["not-toml"] = "[coupling]", "[coupling"
MISTAKES["unknown-key"] = "[pinning]", "[pinning]\ngain = 3"
MISTAKES["unknown-agent"] = "[1, 2], [2, 3]", "[1, 9], [2, 3]"
MISTAKES["arc-twice"] = "[1, 2], [2, 3]", "[1, 2], [1, 2]"
MISTAKES["loop"] = "[1, 2], [2, 3]", "[1, 1], [2, 3]"
MISTAKES["h-not-zero"] = "exp(y) - 1 + y", "exp(y) + y"
MISTAKES["h-unknown-function"] = "exp(y) - 1 + y", "foo(y)"
MISTAKES["h-unknown-name"] = "exp(y) - 1 + y", "z"
MISTAKES["shape-of-C"] = "C = [[1, 0]]", "C = [[1, 0, 3]]"
MISTAKES["shape-of-W"] = 'W = [["16/5"], ["12/5"]]', 'W = [["16/5"]]'
MISTAKES["gain-negative"] = "1 = 5.0", "1 = -5.0"
MISTAKES["weight-zero"] = "[4, 1, 0.5]", "[4, 1, 0]"
MISTAKES["region-backwards"] = "[0, 5]", "[5, 0]"
MISTAKES["region-without-disturbance"] = "initial_disturbance = 0.5\n", ""
MISTAKES["signal-unknown"] = '"random"', '"often"'
MISTAKES["guarantee-without-times"] = 'signal = "random"\ndwell = 0.5', 'guarantee = "dwell"'
MISTAKES["generator-sum"] = (
    'signal = "random"\ndwell = 0.5',
    'guarantee = "markov"\ngenerator = [[-1, 0.9], [1, -1]]',
)
MISTAKES["several-at-once"] = "agents = 4", 'agents = 4\nweights = 3\nlabels = ["a"]'
MISTAKES["dynamics-without-A"] = "[region]", "[dynamics]\nB = [[1]]\n[region]"
MISTAKES["uncertainty-too-large"] = "[region]", "[uncertainty]\nweights = 1.5\n[region]"
MISTAKES["actuators-of-nobody"] = "[region]", "[actuators]\nlimit = { 7 = 3 }\n[region]"
MISTAKES["arcs-file-missing"] = "H = [[1, 2], [2, 1], [3, 2], [4, 3]]", 'H = { file = "no.csv" }'
MISTAKES["no-agents"] = "agents = 4\n", ""
MISTAKES["number-too-long"] = "target = 1", f'target = "1.{"3" * 300}"'


# ---- All of them ---------------------------------------------------------------------------------

Maker = Callable[[Random, int], Table]
#: Kind -> how many, and what makes one.
KINDS: dict[str, tuple[int, Maker]] = {}
KINDS["plain"] = 10, plain
KINDS["disturbed"] = 10, disturbed
KINDS["exosystem"] = 6, exosystems
KINDS["bad-observer"] = 8, bad_observers
KINDS["unreached"] = 6, unreached
KINDS["modes"] = 6, several_modes
KINDS["planar"] = 10, planar
KINDS["spatial"] = 4, spatial
KINDS["exceptions"] = 6, exceptions
KINDS["formation"] = 4, formations
KINDS["badly-scaled"] = 8, badly_scaled
KINDS["all-pinned"] = 4, matrix_gains
KINDS["one-agent"] = 2, one_agent
KINDS["labelled"] = 2, labelled
KINDS["region"] = 13, regions
KINDS["second-equilibrium"] = 3, second_equilibria
KINDS["region-planar"] = 6, planar_regions
KINDS["region-modes"] = 3, region_modes
KINDS["sequence"] = 10, sequences
KINDS["dwell"] = 10, dwell_times
KINDS["guarantee-broken"] = 6, guarantees_broken
KINDS["arbitrary"] = 3, arbitrary
KINDS["markov"] = 8, markov
KINDS["mobile"] = 6, mobile
KINDS["optional"] = 10, optional_arcs
KINDS["groups"] = 10, groups
KINDS["groups-none"] = 6, groups_none
KINDS["tolerance"] = 8, tolerances
KINDS["accuracy"] = 10, accuracies
KINDS["accuracy-tolerance"] = 4, accuracies_and_tolerances
KINDS["actuators"] = 10, actuators
KINDS["dynamics-A"] = 8, dynamics_linear
KINDS["dynamics-inputs"] = 10, dynamics_inputs
KINDS["dynamics-overdamped"] = 8, dynamics_overdamped
KINDS["dynamics-f"] = 12, dynamics_f
KINDS["dynamics-region"] = 3, dynamics_regions
KINDS["dynamics-modes"] = 6, dynamics_modes
KINDS["dynamics-scattered"] = 3, dynamics_scattered
KINDS["dynamics-groups"] = 2, dynamics_groups
KINDS["leader-A"] = 8, leader_linear
KINDS["leader-f"] = 6, leader_f
KINDS["lost"] = 15, lost
KINDS["lost-optional"] = 2, lost_optional
KINDS["not-kept"] = 6, not_kept
KINDS["dynamics-unstable"] = 8, dynamics_unstable
KINDS["leader-unstable"] = 2, leader_unstable
#: Kind -> whose problems, and what ``certify`` is asked beside them.
ASKED: dict[str, tuple[str, tuple[str, ...]]] = {}
ASKED["option-all"] = "region", ("--all",)
ASKED["option-settling"] = "region", ("--settling", "1/25")
ASKED["option-settling-sequence"] = "sequence", ("--settling", "1/25")
ASKED["option-rate"] = "disturbed", ("--rate", "1/4")
ASKED["option-search"] = "second-equilibrium", ("--search",)
ASKED["option-theorem"] = "disturbed", ("--theorem", "theorem1")
ASKED["option-fix"] = "unreached", ("--apply-fix", "cured.toml")
ASKED["option-search-stated"] = "not-kept", ("--search",)
#: Of these, one problem goes through the commands that take long or say much (see ``golden.py``).
THOROUGH = (
    "disturbed",
    "region",
    "planar",
    "sequence",
    "accuracy",
    "dynamics-inputs",
    "dynamics-overdamped",
    "leader-A",
)
#: The first of each, so many.
ASKED_COUNT = 3
BUILTIN = (
    "paper-fixed",
    "paper-switching",
    "clock-sync",
    "karate-club",
    "microgrid-ieee14",
    "neurons",
    "platoon",
    "swing-ieee39",
    "uav-swarm",
)
LONG = {
    "builtin-karate-club",
    "builtin-microgrid-ieee14",
    "builtin-swing-ieee39",
    "builtin-uav-swarm",
    "dynamics-overdamped-01",
    "dynamics-overdamped-05",
    "dynamics-overdamped-07",
    "dynamics-region-00",
    "dynamics-region-01",
    "dynamics-region-02",
}
FOUND = Path(__file__).resolve().parents[1] / "found"


def text_of(kind: str, number: int) -> str:
    """The file of a random problem; the same for the same kind and number, whatever is added
    elsewhere."""
    made = KINDS[kind][1](Random(f"golden {kind} {number}"), number)
    return toml_text({"name": f"{kind}-{number:02}", **made})


def inputs() -> list[Input]:
    """All of them, the long ones last."""
    found = [*_random(), *_asked(), *_thorough(), *_malformed(), *_kept(), *_builtin(), *_large()]
    found = [replace(each, long=each.name in LONG) for each in found]
    return sorted(found, key=lambda each: each.long)


def _random() -> Iterator[Input]:
    for kind, (count, _) in KINDS.items():
        for number in range(count):
            yield Input(
                name=f"{kind}-{number:02}", kind=kind, number=number, text=text_of(kind, number)
            )


def _asked() -> Iterator[Input]:
    for kind, (whose, options) in ASKED.items():
        for number in range(KINDS[whose][0] if whose == "not-kept" else ASKED_COUNT):
            text = text_of(whose, number)
            yield Input(
                name=f"{kind}-{number:02}", kind=kind, number=number, text=text, options=options
            )


def _thorough() -> Iterator[Input]:
    for number, whose in enumerate(THOROUGH):
        name = f"thorough-{whose}"
        yield Input(name=name, kind="thorough", number=number, text=text_of(whose, 0))


def _large() -> Iterator[Input]:
    for number in range(len(LARGE_SIZES)):
        name = f"large-{number:02}"
        text = toml_text({"name": name, **large(number)})
        arcs = {"arcs.csv": partial(large_arcs, number)}
        yield Input(name=name, kind="large", number=number, text=text, files=arcs)


def _malformed() -> Iterator[Input]:
    tomllib.loads(VALID)
    for number, (name, (old, new)) in enumerate(MISTAKES.items()):
        if VALID.count(old) != 1:
            raise ValueError(
                f"{old!r} stands {VALID.count(old)} times in VALID; it must stand there once"
            )
        yield Input(
            name=f"malformed-{name}", kind="malformed", number=number, text=VALID.replace(old, new)
        )


def _kept() -> Iterator[Input]:
    """The files beside the tests."""
    for number, path in enumerate(sorted(FOUND.glob("*.toml"))):
        yield Input(
            name=f"found-{path.stem}", kind="found", number=number, text=path.read_text("utf-8")
        )


def _builtin() -> Iterator[Input]:
    for number, name in enumerate(BUILTIN):
        yield Input(name=f"builtin-{name}", kind="builtin", number=number)
