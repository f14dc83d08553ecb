"""Late, held, lost, triggered and quantised readings at the bounds that are certified: no run of
a simulator that shares no code with the package leaves its box, or is slower than certified.

Each network is given ages, periods, losses and thresholds that are made smaller until there is a
certificate, so that many are close to what rows, slopes or the observer allow.  Runs start on the
border of the certified set, in corners of the box and with the observer error that fits.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from itertools import islice
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from evidence.row import Row
from networks import float_gains, floats, linked, loop_by_hand
from oracles.late import (
    AGES,
    MARKS,
    Bounds,
    Plant,
    continuous,
    held_error,
    late_runs,
    on_ticks,
    sampled_error,
)
from processor_code import differences

from dobc_design import Exosystem, Observer, Problem
from dobc_design.conditions.observer.propose import design_gain, design_sampled_gain
from dobc_design.conditions.separable.claim import Separable
from dobc_design.conditions.separable.propose_readings import Search
from dobc_design.conditions.separable.timing import verify_readings
from dobc_design.loop.make import errors_of, timing_of
from dobc_design.loop.timing import Timing

NETWORKS = 30
PER_HABIT = 48  # runs side by side
LONGEST = 1500  # steps
SLACK, SLACK_INTEGRATED = 1e-9, 1e-6
KINDS = ("continuous", "held", "processor", "late processor", "steps")
COUPLINGS: dict[str, tuple[Callable[[Any], Any], Callable[[float], float]]] = {
    # with the largest slope on |y| <= reach
    "y": (lambda y: y, lambda reach: 1.0),
    "tanh(y)": (np.tanh, lambda reach: 1.0),
    "y + y**3": (lambda y: y + y**3, lambda reach: 1 + 3 * reach**2),
    "exp(y) - 1": (np.expm1, math.exp),
}
BOXES = (Fraction(1, 10), Fraction(1, 2))
SMALLER = Fraction(9, 10)
PARTS = (Fraction(1), Fraction(9, 10), Fraction(1, 2))
EVENTS = (Fraction(0), Fraction(0), Fraction(1, 20), Fraction(1, 5))


@dataclass(frozen=True, kw_only=True)
class Case:
    """A problem, one of the functions ``COUPLINGS``, and a claim that is proved for it."""

    seed: int
    problem: Problem
    kind: str
    h: str
    claim: Separable
    W: Any

    @property
    def timing(self) -> Timing:
        found = timing_of(self.problem)
        assert found is not None
        return found

    def bounds(self) -> Bounds:
        own = self.timing
        late = (float(own.delay), float(own.own_delay))
        event = float(own.event)
        if own.period:
            return on_ticks(float(own.period), *late, own.lost, event)
        fastest = self.steepest()
        if self.W is not None:
            A, C = self.pair()
            fastest = max(fastest, float(np.abs(np.linalg.eigvals(A - floats(self.W) @ C)).max()))
        return continuous(*late, event, fastest=fastest)

    def steepest(self) -> float:
        event = 1 + float(self.timing.event)
        reach = 2 * event * float(max(self.claim.v) * (self.claim.rho or 1))
        return steepest(self.problem, COUPLINGS[self.h][1](reach))

    def pair(self) -> tuple[Any, Any]:
        exosystem = self.problem.exosystem
        assert exosystem is not None
        return floats(exosystem.A), floats(exosystem.C)

    def plant(self) -> Plant:
        problem = self.problem
        modes = [{(i, j): w for i, j, w in own} for own in problem.network.modes.values()]
        arcs = sorted(set().union(*modes))
        F = C = None
        if self.W is not None:
            A, C = self.pair()
            W = floats(self.W)
            F = A - W @ C
            period = float(self.timing.period)
            if self.timing.sampled and not self.timing.steps:
                F, C = sampled_error(A, C, W, period)
            elif period and not self.timing.steps:
                F, C = held_error(F, C, period)
        return Plant(
            arcs=arcs,
            weights=np.array([[float(own.get(arc, 0)) for arc in arcs] for own in modes]),
            h=COUPLINGS[self.h][0],
            gains=float_gains(problem)[:, None],
            F=F,
            C=C,
        )


def steepest(problem: Problem, slope: float) -> float:
    """The largest sum of w L and gain of an agent."""
    most = 0.0
    for own in problem.network.modes.values():
        sums = float_gains(problem).copy()
        for i, _, w in own:
            sums[i] += slope * float(w)
        most = max(most, float(sums.max()))
    return most


def cases() -> Iterator[Case]:
    """From the first on; a network for which nothing is found is passed by."""
    seed = 0
    while True:
        found = case(seed)
        if found is not None:
            yield found
        seed += 1


def case(seed: int) -> Case | None:
    r = Random(seed)
    kind = KINDS[seed % len(KINDS)]
    h = sorted(COUPLINGS)[seed // len(KINDS) % len(COUPLINGS)]
    observed = seed % 2 == 0
    make = partial(_drawn, r.randrange(1 << 30), h, observed)
    part = Fraction(1)
    slope = COUPLINGS[h][1](0.3)  # too little for large boxes, to come close to the limit
    ask = _asked(r, kind)
    for _ in range(30):
        own = ask(part, steepest(make(), slope))
        shrink = own.pop("shrink", Fraction(1))
        problem = make(shrink=shrink, **own)
        found = _proved(seed, problem, kind, h)
        if found is not None:
            return found
        part *= SMALLER
    return None


def _asked(r: Random, kind: str) -> Callable[[Fraction, float], dict[str, Any]]:
    """What is stated, by how much of it and the steepest sum of slopes."""
    delay = r.choice((Fraction(0), Fraction(1, 4), Fraction(2)))
    event = r.choice(EVENTS)
    d = r.choice((1, 2, 3)) if kind in ("late processor", "steps") else 0
    ticks = r.choice((0, 1, 4))
    lost = r.choice((0, 1, 3))
    near = r.choice(PARTS)
    own = r.choice((Fraction(0), *PARTS))

    def stated(part: Fraction, steep: float) -> dict[str, Any]:
        most = Fraction(d**d, (d + 1) ** (d + 1)) / Fraction(steep)
        size = _short(part * near * most)
        readings: dict[str, Any] = {"event": _short(part * event)}
        if kind == "continuous":
            readings["own_delay"] = _short(own * part / (Fraction(272, 100) * Fraction(steep)))
            return {"readings": readings | {"delay": _short(part * delay)}}
        if kind == "steps":
            # agents are made slow enough for steps
            readings |= {"delay": ticks, "own_delay": d, "lost": lost}
            return {"readings": readings, "time": "discrete", "shrink": size}
        readings |= {"delay": size * ticks, "lost": lost, "own_delay": size * d}
        if kind == "held":
            return {"readings": readings | {"period": size}}
        return {"readings": readings, "processor": {"period": size}}

    return stated


def _short(x: Fraction) -> Fraction:
    return Fraction(int(x * 10**6), 10**6)


def _drawn(
    seed: int, h: str, observed: bool, *, shrink: Fraction = Fraction(1), **stated: Any
) -> Problem:
    r = Random(seed)
    n = r.randint(2, 7)
    order = r.sample(range(1, n + 1), n)
    pinned = order[: r.randint(1, max(1, n // 2))]
    gains = {i: shrink * Fraction(r.randint(5, 40), 10) for i in pinned}
    tree = [(i, r.choice(order[:k])) for k, i in enumerate(order) if i not in pinned]
    modes = {}
    for name in "AB"[: r.randint(1, 2)]:
        more = [(i, j) for i in order for j in order if i != j and r.random() < 1.0 / n]
        arcs = dict.fromkeys(tree + more)
        modes[name] = [[i, j, shrink * Fraction(r.randint(5, 30), 10)] for i, j in arcs]
    given: dict[str, Any] = {}
    if observed:
        w = Fraction(r.randint(5, 20), 10) * (shrink if "time" in stated else 1)
        A = [[0, w], [-w, 0]]
        if "time" in stated:
            # a turn whose sine and cosine are rational
            size = 1 + w * w
            A = [[(1 - w * w) / size, 2 * w / size], [-2 * w / size, (1 - w * w) / size]]
        given["exosystem"] = Exosystem(A=A, C=[[1, 0]])
    return linked(modes, n, h, gains=gains, **given, **stated)


def _proved(seed: int, problem: Problem, kind: str, h: str) -> Case | None:
    """The fastest of the claims that are found for the first box."""
    timing = timing_of(problem)
    W = None
    if problem.exosystem is not None:
        if timing is not None and timing.sampled:
            W = design_sampled_gain(problem.exosystem, timing).W
        else:
            W = design_gain(problem.exosystem).W
        if W is None:
            return None
        problem = problem.replace(observer=Observer(W=W))
    loop = errors_of(problem)
    for radius in BOXES[seed % 2 :]:
        everywhere = h == "y"
        search = Search(
            loop=loop, W=W, radius=radius, disturbance=radius / 10, everywhere=everywhere
        )
        proved = []
        for claim in islice(search.claims(), 9):
            if verify_readings(loop, W, claim).wrong is None:
                proved.append(claim)
        if proved:
            best = max(proved, key=lambda claim: claim.alpha)
            return Case(seed=seed, problem=problem, kind=kind, h=h, claim=best, W=W)
    return None


def starts(case: Case, rng: np.random.Generator) -> tuple[Any, Any]:
    """e (n, 1, R) and eps (n, q, R) on the border of the certified set."""
    claim = case.claim
    n = case.problem.n
    v = np.array([float(x) for x in claim.v])[:, None, None]
    rho = float(claim.rho or 1)
    eps = np.zeros((n, 0, PER_HABIT))
    size = np.full(PER_HABIT, rho)
    if claim.error is not None:
        q = len(claim.error.P)
        root = np.linalg.cholesky(floats(claim.error.P)).T
        raw = rng.standard_normal((n, q, PER_HABIT))
        # all agents in one direction, or each in its own
        raw[..., ::2] = raw[:1, :, ::2]
        raw = raw / np.sqrt(np.sum(raw**2, axis=1, keepdims=True))
        part = rng.choice([0.0, 0.5, 0.999], PER_HABIT)
        eps = np.einsum("ij,ajr->air", np.linalg.inv(root), raw)
        eps = eps * (part * rho / float(claim.error.kappa))
        size = (1 - part) * rho
    signs = rng.choice([-1.0, 1.0], (n, 1, PER_HABIT))
    signs[..., ::3] = 1.0
    inner = np.where(rng.random((n, 1, PER_HABIT)) < 0.2, rng.random((n, 1, PER_HABIT)), 1.0)
    return v * size * signs * inner, eps


def worst_ratio(
    case: Case, habit: tuple[str, str], rng: np.random.Generator, *, more: float = 0.0
) -> float:
    """The largest (N + kappa E) / (rho exp(-rate t)) in a stack of runs, or the same at ticks;
    with readings that are wrong by ``more`` than stated."""
    claim = case.claim
    bounds = case.bounds()
    bounds = replace(bounds, event=bounds.event + more)
    v = np.array([float(x) for x in claim.v])[:, None, None]
    rho = float(claim.rho or 1)
    rate = float(claim.alpha)
    kept = 1 - bounds.step * rate if bounds.ticks else np.exp(-bounds.step * rate)
    steps = min(LONGEST, int(np.log(1e-5) / np.log(kept)))
    P = None if claim.error is None else floats(claim.error.P)
    worst = 0.0
    runs = late_runs(case.plant(), bounds, *starts(case, rng), habit, rng)
    for k, (_, e, eps) in enumerate(islice(runs, steps)):
        value = np.max(np.abs(e) / v, axis=(0, 1))
        if P is not None:
            E = np.sqrt(np.max(np.einsum("air,ij,ajr->ar", eps, P, eps), axis=0))
            value = value + float(claim.error.kappa) * E
        worst = max(worst, float(np.max(value)) / (rho * kept**k))
    return worst


def run(count: int, seed: int) -> Row:
    """``count`` runs, spread over the networks."""
    rng = np.random.default_rng(seed)
    networks = list(islice(cases(), min(NETWORKS, -(-count // PER_HABIT))))
    failures = []
    done = 0
    kinds = Counter(case.kind for case in networks)
    most: dict[str, float] = {}
    number = 0
    while done < count:
        case = networks[number % len(networks)]
        turn = number // len(networks)
        habit = (AGES[turn % len(AGES)], MARKS[(turn + number) % len(MARKS)])
        ratio = worst_ratio(case, habit, rng)
        most[case.kind] = max(most.get(case.kind, 0.0), ratio)
        slack = SLACK if case.timing.period else SLACK_INTEGRATED
        if not ratio <= 1 + slack:
            failures.append(f"seed {case.seed} {case.kind} {case.h} {habit}: {ratio:.9g}")
        done += PER_HABIT
        number += 1
    reached = ", ".join(f"{kind} {ratio:.9f}" for kind, ratio in most.items())
    drawn = ", ".join(f"{count} {kind}" for kind, count in kinds.items())
    return Row(
        what="runs with late, held, lost and triggered readings within what is certified",
        count=done,
        failures=failures,
        notes=[f"Networks: {drawn}.", f"Largest N + kappa E over its bound: {reached}."],
        least=count,
    )


def beyond(count: int, seed: int) -> Row:
    """The same runs are no harmless ones: readings that are wrong by a tenth more, or rates that
    are a third faster, are found out in most networks."""
    rng = np.random.default_rng(seed)
    found = []
    for case in islice(cases(), count):
        faster = replace(case, claim=replace(case.claim, alpha=case.claim.alpha * Fraction(4, 3)))
        wrong = worst_ratio(case, ("outward", "outward"), rng, more=0.1) > 1 + SLACK_INTEGRATED
        slow = worst_ratio(faster, ("outward", "outward"), rng) > 1 + SLACK_INTEGRATED
        found += [wrong, slow]
    return Row(
        what="networks whose runs show that a claim is too large",
        count=len(found),
        failures=[] if sum(found) > 0.8 * len(found) else [f"{sum(found)} of {len(found)}"],
        notes=[f"{sum(found)} of {len(found)} claims beyond what is certified are seen to be."],
    )


# --- How far from the truth
def margins(count: int, seed: int) -> Row:
    """Certified over exact: the common constant delay of linear loops, and what is left per tick
    of a sampled one, which is never less than the spectral radius."""
    failures = []
    ratios = []
    speeds = []
    number = seed
    while len(ratios) < count:
        number += 1
        make = partial(_drawn, number, "y", False)
        eigenvalues = np.linalg.eigvals(-loop_by_hand(make()))
        if len(make().network.modes) > 1:
            continue
        exact = float(np.min((np.pi / 2 - np.abs(np.angle(eigenvalues))) / np.abs(eigenvalues)))
        tau = _short(1 / (Fraction(272, 100) * Fraction(steepest(make(), 1.0))))
        late = make(readings={"delay": tau, "own_delay": tau})
        if _proved(number, late, "continuous", "y") is None:
            failures.append(f"{number}: nothing is proved up to 1/(e Q)")
        ratios.append(float(tau) / exact)
        if ratios[-1] >= 1:
            failures.append(f"{number}: certified {float(tau)}, exact {exact}")
        period = _short(Fraction(1, 2) / Fraction(steepest(make(), 1.0)))
        sampled = partial(_drawn, number, "y", True)(processor={"period": period})
        found = _proved(number, sampled, "processor", "y")
        if found is None:
            failures.append(f"{number}: nothing is proved at half the longest period")
            continue
        F, _ = sampled_error(*found.pair(), floats(found.W), float(period))
        step = np.eye(sampled.n) + float(period) * loop_by_hand(sampled)
        radius = max(np.abs(np.linalg.eigvals(M)).max() for M in (F, step))
        kept = 1 - float(period * found.claim.alpha)
        speeds.append(np.log(kept) / np.log(radius))
        if kept < radius * (1 - SLACK):
            failures.append(f"{number}: certified {kept} a tick, spectral radius {radius}")
    notes = [
        f"Certified common delay over the exact margin: {_spread(ratios)}.",
        f"Certified rate of a sampled loop over that of its spectral radius: {_spread(speeds)}.",
    ]
    return Row(
        what="certified delays and sampled rates below the exact ones",
        count=len(ratios),
        failures=failures,
        notes=notes,
        least=count,
    )


def _spread(values: list[float]) -> str:
    return f"{min(values):.3f} to {max(values):.3f}, median {np.median(values):.3f}"


# --- The code
def code(count: int, seed: int) -> Row:
    """``count`` samples of the exported C with sanitizers, against the recursion in long double."""
    failures = []
    notes = []
    kinds = (("saturated", 2.0, False), ("late", 0.0, False), ("measured", 0.0, True))
    for name, limit, clean in kinds:
        with TemporaryDirectory() as folder:
            found = differences(Path(folder), steps=count, seed=seed, limit=limit, clean=clean)
        worst = max(found.u, found.estimate)
        if not worst <= 1e-12:
            failures.append(f"{name}: {found}")
        notes.append(f"{name}: {worst:.1e}, {found.skipped} bad and {found.late} late inputs.")
    return Row(
        what="samples of C code on a processor, within 1e-12 of the recursion",
        count=len(kinds) * count,
        failures=failures,
        notes=notes,
    )
