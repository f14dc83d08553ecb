"""Joint designs: what is proved is proved again, what is refused is impossible for random gains,
built-in problems."""

from fractions import Fraction
from itertools import permutations
from random import Random

import numpy as np
from evidence.row import Row
from networks import loop_by_hand, network_of

import dobc_design as dd
from dobc_design import Problem, Verdict

BUILT_IN = (
    "paper-fixed",
    "paper-switching",
    "clock-sync",
    "karate-club",
    "microgrid-ieee14",
    "uav-swarm",
)
MOST_PINS = {"paper-fixed": 2}
TRIALS = 200
LEAST_SAVED = 0.2  # of the total gain, in the median


def built_in(count: int, seed: int) -> Row:
    """The built-in problems without their gains and W: designed, certified, decided again by both
    checkers."""
    failures, notes = [], []
    names = BUILT_IN[:count]
    for name in names:
        found = dd.design(name)
        if (
            found.verdict is not Verdict.PROVED
            or found.problem is None
            or found.certificate is None
        ):
            failures.append(f"{name}: {found.verdict.value}, {found.reason}")
            continue
        again = dd.verify(dd.certify(found.problem), found.problem)
        if (
            not again.holds
            or again.verdict is not Verdict.PROVED
            or len(found.gains) > MOST_PINS.get(name, 99)
        ):
            failures.append(f"{name}: {again.verdict.value}, pins {', '.join(found.gains)}")
        notes.append(f"{name}: {len(found.gains)} pins, rate {found.rate or 0:.3g} 1/s")
    return Row("built-in problems designed and proved", len(names), failures, notes)


def requests(count: int, seed: int) -> Row:
    """Random linear networks and requests: proofs hold, and no random gains do what was refused."""
    failures = []
    counts = dict.fromkeys(Verdict, 0)
    for number in range(count):
        r = Random(seed + number)
        problem, asked = _case(r)
        found = dd.design(problem, **asked)
        counts[found.verdict] += 1
        if found.verdict is Verdict.PROVED:
            if found.certificate is None or found.problem is None or not _keeps(found, asked):
                failures.append(f"{seed + number}: a limit is broken")
            elif not dd.verify(found.certificate, found.problem).holds:
                failures.append(f"{seed + number}: the certificate does not hold")
        elif found.verdict is Verdict.REFUTED and _found_one(r, problem, asked):
            failures.append(f"{seed + number}: refused, yet possible")
    notes = (", ".join(f"{n} {verdict.value}" for verdict, n in counts.items()),)
    return Row("random requests for a design", count, failures, notes)


def _case(r: Random) -> tuple[Problem, dict]:
    n = r.randint(2, 5)
    pairs = permutations(range(1, n + 1), 2)
    arcs = [[i, j, round(r.uniform(0.2, 2), 1)] for i, j in pairs if r.random() < 0.5] or [[1, 2]]
    network = network_of(arcs, n)
    problem = Problem(network=network, coupling="y", region={"initial_states": [-1, 1]})
    labels = list(network.labels)
    asked: dict = {}
    if r.random() < 0.7:
        asked["rate"] = round(10 ** r.uniform(-2, 0.5), 3)
    if r.random() < 0.5:
        asked["pins"] = r.randint(1, n)
    if r.random() < 0.5:
        asked["allowed"] = r.sample(labels, r.randint(1, n))
    if r.random() < 0.4:
        asked["max_gain"] = round(r.uniform(0.1, 3), 2)
    return problem, asked


def _keeps(found: dd.Design, asked: dict) -> bool:
    return (
        len(found.gains) <= asked.get("pins", 99)
        and set(found.gains) <= set(asked.get("allowed", found.gains))
        and max(found.gains.values()) <= Fraction(str(asked.get("max_gain", 10**9)))
        and (found.rate or 0) >= asked.get("rate", 0)
    )


def _found_one(r: Random, problem: Problem, asked: dict) -> bool:
    """Random gains within the limits whose linear loop decays at the rate asked (at all, if none
    was)."""
    J = loop_by_hand(problem)
    allowed = [
        problem.network.index[label] for label in asked.get("allowed", problem.network.labels)
    ]
    for _ in range(TRIALS):
        K = np.zeros(problem.n)
        for i in r.sample(allowed, min(len(allowed), asked.get("pins", problem.n))):
            if r.random() < 0.7:
                drawn = min(10 ** r.uniform(-2, 4), asked.get("max_gain", 1e9))
            else:
                drawn = None
            K[i] = asked.get("max_gain", 1e6) if drawn is None else drawn
        if -np.max(np.linalg.eigvals(J - np.diag(K)).real) > asked.get("rate", 0) + 1e-9:
            return True
    return False


def true_rate(count: int, seed: int) -> Row:
    """Random digraphs without a region: the gain needed for a rate with weights of V against V =
    e'e, both proved."""
    failures = []
    savings = list[float]()
    alone = 0
    for number in range(count):
        r = Random(seed + number)
        n = r.randint(4, 16)
        pairs = [pair for pair in permutations(range(1, n + 1), 2) if r.random() < 2.5 / n]
        arcs = [[*pair, round(r.uniform(0.2, 3), 2)] for pair in pairs]
        arcs = arcs or [[1, 2, 1]]
        problem = Problem(network=network_of(arcs, n), coupling="y")
        rate = Fraction(r.randint(5, 40), 100)
        weighted, plain = (
            dd.design(problem, rate=rate, conservative=which) for which in (False, True)
        )
        if (
            weighted.verdict is not Verdict.PROVED
            or weighted.problem is None
            or weighted.certificate is None
        ):
            failures.append(f"{seed + number}: {weighted.verdict.value}, {weighted.reason}")
            continue
        K = np.diag([float(weighted.gains.get(label, 0)) for label in problem.network.labels])
        slowest = float(np.linalg.eigvals(loop_by_hand(problem) - K).real.max())
        if not dd.verify(weighted.certificate, weighted.problem).holds or -slowest < float(rate):
            failures.append(f"{seed + number}: rate {-slowest:.6g}, asked {float(rate):.6g}")
        if plain.verdict is not Verdict.PROVED:
            alone += 1
            continue
        gain, before = (float(each.cost or 0) for each in (weighted, plain))
        savings.append(1 - gain / before)
        if gain > before:
            failures.append(f"{seed + number}: total gain {gain:.6g}, with V = e'e {before:.6g}")
    saved = float(np.median(savings)) if savings else 0.0
    if saved < LEAST_SAVED:
        failures.append(f"median saving {saved:.1%}")
    note = (
        f"median saving of gain {saved:.0%}, least {min(savings, default=0):.0%}; {alone} "
        "proved with weights only"
    )
    return Row("designs for the true local rate against V = e'e", count, failures, [note])
