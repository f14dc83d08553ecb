"""Arc-wise certificates: runs from the boundaries of their sets, and claims just beyond true.

Runs are integrated here, arc by arc in NumPy; what an arc takes is sampled on its disc.
"""

import json
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from random import Random
from typing import Any

import numpy as np
from arc_wise import Motion, motion, searched
from certified import consensus_claims
from checker_files.files import Document
from checker_files.separable import UNDECIDED, ball, claim, claimed_in
from evidence.row import Row
from networks import floats, linked, random_arcs

from dobc_design import Exosystem, Observer, Problem
from dobc_design.certificate.text import certificate_bytes
from dobc_design.checker.examine import examine
from dobc_design.conditions.arcs.claim import ArcWise
from dobc_design.conditions.arcs.decide import why_not
from dobc_design.conditions.kinds import KINDS
from dobc_design.loop.make import loop_of
from dobc_design.problem.canonical import canonical_bytes

F = Fraction
COUPLINGS = ("sin(y)", "tanh(y) - y/4", "y + y**3")
SETS = 30
STEPS = 300  # of a run
STEP = 0.1  # of the fastest time constant
EXCESS = 1e-7  # of V, for the integration
GAIN = ((F(16, 5),), (F(12, 5),))
SEEN = {
    "exosystem": Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]]),
    "observer": Observer(W=[["16/5"], ["12/5"]]),
}
Array = np.ndarray


def some_problem(number: int) -> Problem:
    """2 to 8 agents, arcs with weights; every second has two modes, every third an observer."""
    r = Random(f"arc-wise {number}")
    n = r.randint(2, 8)
    arcs = {}
    for mode in "GH"[: 1 + number % 2]:
        found = random_arcs(r, n, r.choice((0.25, 0.5)), lambda: r.choice((1, "1/2", 2)))
        arcs[mode] = found or [[1, 2, 1]]
    gains = {i: r.choice((3, 5, "15/2")) for i in range(1, n + 1) if r.random() < 0.8}
    given: dict[str, Any] = {"gains": gains or {1: 3}}
    if number % 3 == 2:
        given |= SEEN
        given["gains"] = dict.fromkeys(range(1, n + 1), 6)
        given["region"] = {"initial_states": ["-1/2", "1/2"], "initial_disturbance": "1/20"}
    return linked(arcs, n, COUPLINGS[number % 5 % 3], **given)


def proved(first: int) -> Iterator[tuple[int, Problem, Any]]:
    """Problems from a number on that have an arc-wise certificate, with its check."""
    number = first
    while True:
        problem = some_problem(number)
        check = searched(problem, GAIN if problem.exosystem is not None else None)
        if check.is_proved:
            yield number, problem, check
        number += 1


# --- Runs
class Runs:
    """V and the motion of errors and estimation errors (..., n + n q) of a problem, by modes."""

    def __init__(self, problem: Problem, claim: ArcWise) -> None:
        self.n = problem.n
        self.d = np.array([float(x) for x in claim.d])
        self.P = None if claim.P is None else floats(claim.P)
        self.motions = [motion(problem, mode) for mode in problem.network.modes]
        self.closed = np.array([[-3.2, 2.0], [-4.4, 0.0]])  # A - W C

    def eps(self, z: Array) -> Array:
        return z[..., self.n :].reshape(len(z), self.n, 2)

    def value(self, z: Array) -> Array:
        e = z[..., : self.n]
        value = np.sum(self.d * e * e, axis=-1)
        if self.P is not None:
            eps = self.eps(z)
            value = value + np.einsum("...ik,kl,...il->...", eps, self.P, eps)
        return value

    def rise(self, z: Array, moved: Motion) -> Array:
        change = moved(z[..., : self.n])
        if self.P is None:
            return change
        eps = self.eps(z)
        return np.concatenate(
            [change + eps[..., 0], (eps @ self.closed.T).reshape(len(z), 2 * self.n)], axis=-1
        )

    def slope(self, z: Array, moved: Motion) -> Array:
        """V'."""
        change = self.rise(z, moved)
        value = 2 * np.sum(self.d * z[..., : self.n] * change[..., : self.n], axis=-1)
        if self.P is not None:
            value = value + 2 * np.einsum(
                "...ik,kl,...il->...", self.eps(z), self.P, self.eps(change)
            )
        return value

    def after(self, z: Array, h: float) -> Array:
        """One Runge-Kutta step in the modes that are worst at its beginning."""
        slopes = np.array([self.slope(z, moved) for moved in self.motions]).argmax(axis=0)
        ends = np.empty_like(z)
        for k, moved in enumerate(self.motions):
            mine = slopes == k
            x = z[mine]
            k1 = self.rise(x, moved)
            k2 = self.rise(x + h / 2 * k1, moved)
            k3 = self.rise(x + h / 2 * k2, moved)
            k4 = self.rise(x + h * k3, moved)
            ends[mine] = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        return ends

    def starts(self, level: float, count: int, rng: np.random.Generator) -> Array:
        """On the boundary: a half in random directions, a half of few agents; the worst of four,
        by V'."""
        width = self.n if self.P is None else 3 * self.n
        z = rng.standard_normal((4 * count, width))
        few = rng.random(z.shape) < min(1.0, 2.5 / self.n)
        few[np.arange(len(z)), rng.integers(self.n, size=len(z))] = True
        z[::2] *= few[::2]
        z *= np.sqrt(level / self.value(z))[:, None]
        slopes = np.max([self.slope(z, moved) for moved in self.motions], axis=0)
        order = np.argsort(-slopes[: 2 * count])[: count // 2]
        return np.concatenate([z[order], z[2 * count :][: count - len(order)]])


def starts(count: int, seed: int) -> Row:
    """``count`` starts on the boundaries of SETS sets; modes change to where V rises most."""
    failures = []
    tried = 0
    kinds: dict[str, int] = {"two modes": 0, "observers": 0} | dict.fromkeys(COUPLINGS, 0)
    slowest = np.inf
    each = max(10, -(-count // SETS))
    for number, problem, check in proved(seed):
        runs = Runs(problem, check.claim)
        level, rate = float(check.claim.level), float(check.claim.rate)
        z = runs.starts(level, each, np.random.default_rng(number))
        # V' <= -2 rate V on the boundary itself
        steepest = max(float(np.max(runs.slope(z, moved))) for moved in runs.motions)
        if steepest > -2 * rate * level * (1 - 1e-9):
            failures.append(f"{number}: V' = {steepest} on the boundary")
        slowest = min(slowest, -steepest / level / 2 / rate)
        t = 0.0
        for _ in range(STEPS):
            h = STEP / fastest(problem, float(np.max(np.abs(z))))
            z, t = runs.after(z, h), t + h
            bound = level * np.exp(-2 * rate * t)
            if np.any(runs.value(z) > bound * (1 + EXCESS)):
                failures.append(f"{number}: V = {runs.value(z).max()} at t = {t}, > {bound}")
                break
        tried += each
        kinds["two modes"] += len(runs.motions) > 1
        kinds["observers"] += runs.P is not None
        kinds[problem.coupling.texts[0]] += 1
        if tried >= count:
            break
    notes = [
        ", ".join(f"{name}: {k}" for name, k in kinds.items()),
        f"-V' at a start was at least {slowest:.3f} times 2 rate V",
    ]
    what = "arc-wise sets: starts on the boundary, worst modes; none leaves, none is slower"
    return Row(what, tried, failures, notes, least=count)


def fastest(problem: Problem, reach: float) -> float:
    """About the largest slope of e', 1/s."""
    y = np.linspace(-2 * reach, 2 * reach, 401)
    h = problem.coupling.numpy_function()(y[:, None])[:, 0]
    slope = np.abs(np.gradient(h, y)).max()
    most = 5.0
    for arcs in problem.network.modes.values():
        into = np.zeros(problem.n)
        for i, _, w in arcs:
            into[i] += float(w)
        most = max(most, 2 * slope * into.max() + 8)
    return most


# --- Claims just beyond true
ANGLE, RADIUS = np.meshgrid(np.linspace(0, 2 * np.pi, 2881), np.linspace(0.005, 1, 80))


def disc(level: float, own: float, other: float) -> tuple[Array, Array]:
    """Points of d_i x^2 + d_j y^2 <= level."""
    rho = np.sqrt(level)
    x = rho * RADIUS * np.cos(ANGLE) / np.sqrt(own)
    return x, rho * RADIUS * np.sin(ANGLE) / np.sqrt(other)


def needed(problem: Problem, claim: ArcWise, mode: str, arc: int, name: str) -> float:
    """The least a for the b of an arc, or b for its a, that holds on a grid; -inf where more of
    it does not help."""
    i, j, w = list(problem.network.modes[mode])[arc]
    x, y = disc(float(claim.level), float(claim.d[i]), float(claim.d[j]))
    h = problem.coupling.numpy_function()
    taken = 2 * float(claim.d[i]) * float(w) * x * h((y - x)[..., None])[..., 0]
    mine, others = (x, y) if name == "a" else (y, x)
    given = claim.b if name == "a" else claim.a
    rest = taken - float(given[mode][arc]) * others * others
    # near an axis the other number alone decides
    far = np.abs(mine) > 1e-2 * np.abs(others)
    return float(np.max(rest[far] / mine[far] ** 2))


def moved(claim: ArcWise, mode: str, arc: int, name: str, value: F) -> ArcWise:
    numbers = dict(getattr(claim, name))
    some = list(numbers[mode])
    some[arc] = value
    numbers[mode] = tuple(some)
    return replace(claim, **{name: numbers})


def slack(problem: Problem, claim: ArcWise) -> F:
    """The least that an agent is left, over 2 d_i, exactly; no observer."""
    least = []
    for mode, arcs in problem.network.modes.items():
        left = []
        for i, d in enumerate(claim.d):
            gain = problem.pinning.gains.get(i)
            left.append(2 * d * ((gain[0][0] if gain is not None else 0) - claim.rate))
        for (i, j, _), a, b in zip(arcs, claim.a[mode], claim.b[mode], strict=True):
            left[i] -= a
            left[j] -= b
        least += [each / (2 * d) for each, d in zip(left, claim.d, strict=True)]
    return min(least)


def beyond_true(r: Random, problem: Problem, claim: ArcWise) -> tuple[str, ArcWise]:
    """One number too small by a part in a thousand of what is taken, a level at which a grid
    shows that an arc takes more, or a rate that an agent misses by a billionth."""
    what = r.choice(("a", "b", "level", "rate"))
    mode = r.choice(list(problem.network.modes))
    arc = r.randrange(len(problem.network.modes[mode]))
    i, _, w = list(problem.network.modes[mode])[arc]
    if what in ("a", "b"):
        value = needed(problem, claim, mode, arc, what) - 1e-3 * float(w * claim.d[i])
        return what, moved(claim, mode, arc, what, F(value))
    if what == "level":
        for step in range(1, 40):
            level = claim.level * F(11, 10) ** step
            more = replace(claim, level=level)
            if needed(problem, more, mode, arc, "a") > float(claim.a[mode][arc]) + 1e-6:
                return what, more
    return "rate", replace(claim, rate=claim.rate + slack(problem, claim) + F(1, 10**9))


class Second:
    """The second program, about claims of one problem."""

    def __init__(self, problem: Problem) -> None:
        self.problem = canonical_bytes(problem)
        document = json.loads(certificate_bytes(consensus_claims(problem))) | UNDECIDED
        document["checks"] = [
            check for check in document["checks"] if KINDS[check["id"]].role != "region"
        ]
        self.frame = json.dumps(document).encode()

    def accepts(self, some: ArcWise, radius: float) -> bool:
        """Whether it holds, whatever follows from it."""
        exact: Document = {k: v for k, v in some.to_json().items() if v is not None}
        rate = round(float(some.rate) * 0.999, 12)
        check = claim("arc-wise", ball(radius), rate, exact)
        found = examine(claimed_in(self.frame, check, **UNDECIDED), self.problem)
        (mine,) = [holds for holds, text in found if text.startswith("arc-wise")]
        return mine


def beyond(count: int, seed: int) -> Row:
    """Claims that a grid, or a sum of fractions, shows to be false: both programs refuse them; the
    honest ones they were made of are accepted."""
    failures = []
    seen: dict[str, int] = {}
    tried = 0
    r = Random(f"beyond true {seed}")
    for number, problem, check in proved(seed):
        if problem.exosystem is not None:
            continue
        loop = loop_of(problem)
        second = Second(problem)
        # of a smaller ball, so that what lies beyond is about this number alone
        radius = 0.1 * float(check.domain.radius)
        if not second.accepts(check.claim, radius):
            failures.append(f"{number}: the honest claim is refused by the second program")
        for _ in range(10):
            what, false = beyond_true(r, problem, check.claim)
            seen[what] = seen.get(what, 0) + 1
            if why_not(loop, false) is None:
                failures.append(f"{number}, {what}: decide accepts {false.to_json()}")
            if second.accepts(false, radius):
                failures.append(f"{number}, {what}: the second program accepts")
            tried += 1
        if tried >= count:
            break
    notes = [", ".join(f"{name}: {k}" for name, k in sorted(seen.items()))]
    what = "arc-wise claims just beyond true: both programs refuse them"
    return Row(what, tried, failures, notes, least=count)
