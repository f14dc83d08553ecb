"""Signals that keep a guarantee: random schedules whose truth is computed apart, by matrix
exponentials and graphs.

No mode reaches every agent alone, but where a mode may stay on for ever.  True rates: of a
sequence, from the spectral radius of its exact flow over one period; of dwell times, an upper
bound: the slowest of all allowed rounds of up to three modes that are on for their shortest or
longest time.  Rising couplings converge iff the graphs of every cycle reach every agent, and no
faster than their linearisation.
"""

import math
from collections import Counter
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from itertools import combinations, pairwise, product
from random import Random
from typing import Any

import numpy as np
from evidence.row import Row
from networks import linked
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.sparse.csgraph import breadth_first_order

from dobc_design import Problem, Region, Switching, Verdict, certify
from dobc_design.conditions.schedule.claim import Cycles

KINDS = (
    "sequence, equal",
    "sequence, uneven",
    "sequence, repeated",
    "dwell, longest",
    "dwell, no longest",
)
SLOPES = {"y": 1.0, "exp(y) - 1 + y": 2.0, "y + y**3": 1.0, "atan(y)": 1.0, "y + 2*tanh(y)": 3.0}
FUNCTIONS: dict[str, Any] = {
    "exp(y) - 1 + y": lambda y: np.expm1(y) + y,
    "y + y**3": lambda y: y + y**3,
    "atan(y)": np.arctan,
    "y + 2*tanh(y)": lambda y: y + 2 * np.tanh(y),
}
PER_PROBLEM, PER_NONLINEAR = 60, 8  # runs
SLACK, SLACK_INTEGRATED = 1e-9, 1e-6


@dataclass(frozen=True, kw_only=True)
class Case:
    """A problem, its parts as arrays, and the order of its modes (None: any other may follow)."""

    problem: Problem
    weights: dict[str, Any]  # of each mode: (n, n), what the row hears from the column
    gains: Any
    shortest: tuple[float, ...]  # of each place of ``order``, or of each mode
    longest: float | None
    order: tuple[str, ...] | None
    coupling: str

    def matrix(self, mode: str) -> Any:
        """The linearisation e' = M e."""
        heard = SLOPES[self.coupling] * self.weights[mode]
        return heard - np.diag(heard.sum(axis=1) + self.gains)

    def reaches(self, modes: tuple[str, ...]) -> bool:
        n = len(self.gains)
        links = np.zeros((n + 1, n + 1))
        links[:n, :n] = np.sum([self.weights[mode] > 0 for mode in modes], axis=0).T
        links[n, :n] = self.gains > 0
        return len(breadth_first_order(links, n, return_predecessors=False)) == n + 1

    @property
    def converges(self) -> bool:
        """By the graphs alone."""
        if self.order is not None:
            return self.reaches(self.order)
        alone = [] if self.longest is not None else [(mode,) for mode in self.weights]
        return all(self.reaches(modes) for modes in (*alone, *combinations(self.weights, 2)))

    @cache  # noqa: B019 - as long as the case
    def rate(self) -> float:
        """No signal class decays faster (1/s): exact flows of rounds, of the linearisation."""
        if self.order is not None:
            steps = zip(self.order, self.shortest, strict=True)
            return decay([(expm(self.matrix(mode) * t), t) for mode, t in steps])
        longest = 4 * self.shortest[0] if self.longest is None else self.longest
        lengths = (self.shortest[0], longest)
        flows = {(mode, t): expm(self.matrix(mode) * t) for mode in self.weights for t in lengths}
        rates = [-float(np.linalg.eigvals(self.matrix(mode)).real.max()) for mode in self.weights]
        found = [] if self.longest is not None else rates
        for length in (2, 3):
            for turn in product(flows, repeat=length):
                if all(a[0] != b[0] for a, b in pairwise((*turn, turn[0]))):
                    found.append(decay([(flows[each], each[1]) for each in turn]))
        return min(found)

    def __hash__(self) -> int:
        return id(self)


def decay(flows: list[tuple[Any, float]]) -> float:
    if len(flows) > 1:
        whole = np.linalg.multi_dot([each for each, _ in flows[::-1]])
    else:
        whole = flows[0][0]
    return -math.log(max(np.abs(np.linalg.eigvals(whole)).max(), 1e-300)) / sum(t for _, t in flows)


def case(seed: int) -> Case:
    """Every fifth is meant to miss an agent; what is true is computed, not meant."""
    r = Random(seed)
    kind = KINDS[seed % len(KINDS)]
    linear = seed // 5 % 2 == 0
    missing = seed // 10 % 5 == 0
    coupling = "y" if linear else r.choice(sorted(FUNCTIONS))
    while True:
        found = _drawn(r, kind, coupling, missing)
        alone = [found.reaches((mode,)) for mode in found.weights]
        if (kind == KINDS[4] and not missing) or not any(alone):
            return found


def _drawn(r: Random, kind: str, coupling: str, missing: bool) -> Case:
    n = r.randint(3, 20)
    names = "ABCDE"[: r.randint(2, 5)]
    order = r.sample(range(1, n + 1), n)
    pins = {i: Fraction(r.randint(5, 40), 10) for i in order[: r.randint(1, max(1, n // 4))]}
    tree = [(i, r.choice(order[:k])) for k, i in enumerate(order) if i not in pins]
    more = [(i, j) for i in order for j in order if i != j and r.random() < 1.0 / n]
    lost = order[-1] if missing else None
    modes: dict[str, dict[tuple[int, int], Fraction]] = {mode: {} for mode in names}
    for arc in dict.fromkeys(tree + more):
        if kind.startswith("sequence"):
            own = set(r.sample(names, r.choice((1, 1, 2))))
        elif kind == KINDS[3] or missing:
            own = set(names) - {r.choice(names)}
        elif arc in tree:
            own = set(names)
        else:
            own = set(r.sample(names, 1))
        own = own & {names[0]} if arc[0] == lost else own
        for mode in sorted(own):
            modes[mode][arc] = Fraction(r.randint(20, 300), 100)
    turns, shortest, longest, sequence = _turns(r, kind, names, missing)
    radius = r.choice((Fraction(1, 10), Fraction(1, 2), Fraction(1), Fraction(2)))
    if coupling == "y":
        reach = {}
    else:
        reach = {"region": Region(initial_states=[-radius, radius], initial_disturbance=None)}
    arcs = {mode: [[i, j, w] for (i, j), w in own.items()] for mode, own in modes.items()}
    weights = {mode: np.zeros((n, n)) for mode in names}
    for mode, own in modes.items():
        for (i, j), w in own.items():
            weights[mode][i - 1, j - 1] = float(w)
    switching = Switching(**turns)
    return Case(
        problem=linked(arcs, n, coupling, gains=pins, switching=switching, **reach),
        weights=weights,
        gains=np.array([float(pins.get(i, 0)) for i in range(1, n + 1)]),
        shortest=shortest,
        longest=longest,
        order=sequence,
        coupling=coupling,
    )


def _turns(r: Random, kind: str, names: str, missing: bool) -> tuple[dict[str, Any], Any, Any, Any]:
    """[switching], then shortest times, longest time and order as in ``Case``."""
    short = Fraction(r.randint(2, 15), 10)
    if kind.startswith("dwell"):
        longest = short * Fraction(r.randint(5, 12), 4) if kind == KINDS[3] else None
        return (
            {"guarantee": "dwell", "dwell": short, "longest": longest},
            (float(short),),
            longest and float(longest),
            None,
        )
    order = r.sample(names, len(names))
    order = order[:-1] if missing and len(order) > 2 else order
    if kind == KINDS[2]:
        order += r.sample(order[:-1], r.randint(1, len(order) - 1))
    times = []
    for _ in order:
        times.append(short if kind == KINDS[0] else Fraction(r.randint(2, 20), 10))
    turns = {
        "guarantee": "sequence",
        "sequence": order,
        "dwell": short if kind == KINDS[0] else times,
    }
    return turns, tuple(float(t) for t in times), None, tuple(order)


@dataclass(frozen=True, kw_only=True)
class Answer:
    verdict: Verdict
    rate: float | None
    claim: Any


@cache
def answer(seed: int) -> tuple[Case, Answer]:
    drawn = case(seed)
    found = certify(drawn.problem)
    claim = next((each.claim for each in found.claims.checks if each.id == "schedule"), None)
    return drawn, Answer(
        verdict=found.verdict,
        rate=None if found.rate is None else float(found.rate),
        claim=claim if isinstance(claim, Cycles) else None,
    )


def verdicts(count: int, seed: int) -> Row:
    """Verdicts and rates of random problems against the truth."""
    failures = list[str]()
    found = Counter[str]()
    ratios = list[float]()
    for number in range(seed, seed + count):
        drawn, own = answer(number)
        bad = Verdict.REFUTED if drawn.converges else Verdict.PROVED
        if own.verdict is bad:
            failures.append(
                f"{number}: {own.verdict.value}, but it "
                f"{'does' if drawn.converges else 'need not'} converge"
            )
        if own.rate is not None and own.rate > drawn.rate() * (1 + 1e-9):
            failures.append(
                f"{number}: rate {own.rate:.9g}, but at most {drawn.rate():.9g} is true"
            )
        if drawn.coupling == "y" and drawn.converges is not (drawn.rate() > 1e-9):
            failures.append(f"{number}: graphs and flows disagree on the truth")
        found[own.verdict.value] += 1
        ratios += [own.rate / drawn.rate()] if own.rate else []
    notes = [", ".join(f"{many} {verdict}" for verdict, many in sorted(found.items()))]
    notes += (
        [f"rate / truth: median {np.median(ratios):.3f}, least {min(ratios):.3f}"] if ratios else []
    )
    return Row(
        "schedules: verdicts and rates against exact flows and graphs", count, failures, notes
    )


def runs(count: int, seed: int) -> Row:
    """Runs from corners, at the edge of the guarantee, against the weights: none may leave its
    box."""
    failures = list[str]()
    done = 0
    problems = 0
    number = seed
    closest = 0.0
    while done < count:
        drawn, own = answer(number)
        if own.claim is not None and own.claim.phases:
            many = min(count - done, PER_PROBLEM if drawn.coupling == "y" else PER_NONLINEAR)
            worst = _follow(drawn, own.claim, Random(number), many)
            if worst > 1 + (SLACK if drawn.coupling == "y" else SLACK_INTEGRATED):
                failures.append(f"{number}: a run leaves its box or falls too slowly, {worst:.9g}")
            done = done + many
            problems = problems + 1
            closest = max(closest, worst)
        number += 1
    what = (
        "schedules: runs at the edge of the guarantee stay in their boxes, which shrink at the rate"
    )
    return Row(
        what, done, failures, [f"{problems} problems; as a part of the box at most {closest:.9f}"]
    )


def _follow(drawn: Case, claim: Cycles, r: Random, many: int) -> float:
    """The largest |e_i| / (v_i V) and V' exp(rate t) / V of ``many`` runs of two rounds or more,
    each with its own signal: they begin in corners, and phases end as soon or as late as they
    may."""
    names = drawn.order or tuple(drawn.weights)
    ways = [_way(drawn, claim, p) for p in range(len(names))]
    if drawn.coupling != "y":
        flows = {}
    else:
        flows = {
            p: expm(drawn.matrix(names[p]) * way[0][:, None, None]) for p, way in enumerate(ways)
        }
    worst = 0.0
    for _ in range(many):
        p = 0 if drawn.order else r.randrange(len(names))
        v = ways[p][1][0]
        top = 1.0 if claim.rho is None else float(claim.rho) * r.choice((1.0, 1.0, 0.3))
        e = top * v * [r.choice((-1, 1, 1)) for _ in v] if r.random() < 0.8 else top * v
        for _ in range(2 * len(names) + 1):
            times, weights, ends = ways[p]
            end = r.choice(ends)
            if flows:
                path = flows[p][: end + 1] @ e
            else:
                path = _integrated(drawn, names[p], times[: end + 1], e)
            before = np.max(np.abs(e) / weights[0])
            if before < 1e-250:
                break
            worst = max(worst, float(np.max(np.abs(path) / weights[: end + 1])) / before)
            e = path[-1]
            if drawn.order:
                q = (p + 1) % len(names)
            else:
                q = r.choice([q for q in range(len(names)) if q != p])
            after = np.max(np.abs(e) / ways[q][1][0])
            worst = max(worst, float(after / before * math.exp(float(claim.rate) * times[end])))
            p = q
    return worst


def _way(drawn: Case, claim: Cycles, p: int) -> tuple[Any, Any, list[int]]:
    """Times at and between the nodes of a phase, the weights there, and the places at which it may
    end: at its shortest and longest time and one between; a phase without a longest is followed
    beyond its last node."""
    each = claim.phases[p]
    nodes = np.array(each.times, dtype=float)
    v = np.array([[float(x) for x in row] for row in each.v])
    times = np.unique(np.concatenate([nodes, (nodes[1:] + nodes[:-1]) / 2]))
    weights = np.stack([np.interp(times, nodes, column) for column in v.T], axis=1)
    shortest = drawn.shortest[p if drawn.order else 0]
    first = int(np.argmin(np.abs(times - shortest)))
    ends = sorted({first, (first + len(times) - 1) // 2, len(times) - 1})
    if drawn.order is None and drawn.longest is None:
        later = nodes[-1] + shortest * np.array([0.5, 1.0, 3.0])
        falls = np.exp(-float(claim.rate) * (later - nodes[-1]))
        times = np.append(times, later)
        weights = np.concatenate([weights, falls[:, None] * v[-1]])
        ends += [len(times) - 3, len(times) - 1]
    return times, weights, ends


def _integrated(drawn: Case, mode: str, times: Any, start: Any) -> Any:
    heard = drawn.weights[mode]
    h = FUNCTIONS[drawn.coupling]
    size = float(np.max(np.abs(start)))

    def slope(_: float, e: Any) -> Any:
        return np.sum(heard * h(e[None, :] - e[:, None]), axis=1) - drawn.gains * e

    found = solve_ivp(
        slope, (0.0, times[-1]), start, "DOP853", t_eval=times, rtol=1e-10, atol=1e-13 * size
    )
    return found.y.T
