"""``certify`` and the second program on random problems of every kind: they agree on every claim
that is made."""

from collections import Counter
from collections.abc import Iterator
from random import Random
from typing import Any

import numpy as np
from evidence.row import Row
from networks import linked
from random_problems import random_problem

from dobc_design import Exosystem, Group, Problem, certify, verify
from dobc_design.certificate.text import certificate_bytes
from dobc_design.conditions.coverage import asked_radius
from dobc_design.loop.make import loop_of

SMOOTH = (
    "y",
    "2*y",
    "tanh(y)",
    "sin(y)",
    "y + y**3/4",
    "exp(y) - 1 + y",
    "atan(2*y)",
    "y/(1 + y**2)",
    "sinh(y)/2",
)
EDGES = (
    "sqrt(1 + y) - 1",
    "log(1 + y)",
    "y/(2 - y)",
    "tan(y)",
    "1 - sqrt(1 - y)",
    "y + log(1 - y/2)",
)
KINKS = (
    "max(y, 0)",
    "min(y, 2*y)",
    "clip(y, -1, 1)",
    "y + abs(y)/2",
    "max(y - 1/4, 0) + min(y + 1/4, 0)",
    "y**2",
    "0*y",
)
LISTS = (
    ["tanh(y1)", "tanh(y2)"],
    ["y1", "2*y2"],
    ["y1 + y2/4", "y2 - y1/4"],
    ["tanh(y1)", "2*y2"],
    ["sin(y1) + y2/4", "y2"],
    ["log(1 + y1)", "y2 + y1*y2/4"],
    ["sqrt(1 + y1) - 1", "sqrt(1 + y2) - 1"],
)
EXOSYSTEMS = ([[0]], [[0, 1], [0, 0]], [[0, 2], [-2, 0]], [[-1]])


VERDICTS = ("proved", "refuted", "undecided")
KINDS = (
    *(
        "vector states",
        "couplings by list",
        "groups",
        "exosystems",
        "matrix gains",
        "kinks",
        "several modes",
    ),
    *("no region", "regions just inside where h is defined", "regions beyond where h is defined"),
    "plants beside the model",
)
MANY = 200  # problems among which every kind occurs


def run(count: int, seed: int) -> Row:
    """No claim that is made is refused by the second program, and none had to be withdrawn because
    of it."""
    failures = []
    verdicts = Counter()
    claims = Counter()
    for number in range(seed, seed + count):
        problem = any_problem(number)
        certificate = certify(problem)
        verdicts.update((kind, certificate.verdict.value) for kind in ("", *kinds(problem)))
        claims.update(check.verdict.value for check in certificate.checks)
        failures += [
            f"{number}: {c.reason}" for c in certificate.checks if "second checker" in c.reason
        ]
        failures += [
            f"{number}: {text}"
            for text in verify(certificate_bytes(certificate.claims), problem).failures
        ]
        failures += (
            [f"{number}: {certificate.claims.reason}"]
            if "second checker" in certificate.claims.reason
            else []
        )
    notes = [f"single claims: {', '.join(f'{claims[verdict]} {verdict}' for verdict in VERDICTS)}"]
    for kind in ("", *KINDS):
        many = [verdicts[kind, verdict] for verdict in VERDICTS]
        listed = ", ".join(
            f"{number} {verdict}" for number, verdict in zip(many, VERDICTS, strict=True)
        )
        notes.append(f"{kind or 'problems'}, {sum(many)}: {listed}")
        failures += [f"no problem has {kind}"] if count >= MANY and not sum(many) else []
    return Row(
        "certify and the second program: problems of every kind on which they agree",
        count,
        failures,
        notes,
    )


def kinds(problem: Problem) -> Iterator[str]:
    """Those of KINDS that a problem is of."""
    edged = problem.region is not None and any(problem.network.modes.values())
    found = [problem.m > 1]
    found.append(any(not h.by_component for h in problem.couplings))
    found.append(problem.is_grouped)
    found.append(bool(problem.groups))
    found.append(not all(map(_is_scalar, problem.pinning.gains.values())))
    found.append(any(h.nonsmooth for h in problem.couplings))
    found.append(len(problem.network.modes) > 1)
    found.append(problem.region is None)
    found.append(edged and _defined(problem, 1) and not _defined(problem, 2))
    found.append(edged and not _defined(problem, 1))
    found.append(problem.uncertainty is not None)
    for kind, true in zip(KINDS, found, strict=True):
        if true:
            yield kind


def _is_scalar(K: Any) -> bool:
    """Whether a gain is a number times the identity."""
    return bool((np.array(K) == K[0][0] * np.eye(len(K), dtype=int)).all())


def _defined(problem: Problem, times: int) -> bool:
    """Does every h have values at differences of ``times`` the largest between two agents?"""
    largest = 2 * times * float(max(asked_radius(loop_of(problem))))
    y = np.linspace(-largest, largest, 401)[:, np.newaxis] * np.ones(problem.m)
    with np.errstate(all="ignore"):
        return all(np.isfinite(h.value(y)).all() for h in problem.couplings)


def any_problem(seed: int) -> Problem:
    """Up to five agents, two components and two modes, some with an exosystem or several, matrix
    gains, a region."""
    r = Random(seed)
    if r.random() < 0.2:
        return random_problem(seed)
    n = r.randint(1, 5)
    m = r.choice((1, 2))
    chain = [(i, r.randint(1, i - 1)) for i in range(2, n + 1) if r.random() < 0.9]
    modes: dict[str, list[Any]] = {}
    for mode in ("a", "b")[: r.choice((1, 1, 2))]:
        modes[mode] = []
        for i in range(1, n + 1):
            for j in range(1, n + 1):
                if i != j and ((i, j) in chain or r.random() < 0.25):
                    modes[mode].append([i, j, r.choice(("1", "1/2", "5/4"))])
    gains = {i: _gain(r, m) for i in range(1, n + 1) if i == 1 or r.random() < 0.3}
    given: dict[str, Any] = {"gains": gains}
    kind = r.random()
    if kind < 0.2 and n > 1:
        rest = tuple(str(i) for i in range(2, n + 1))
        first = Group(agents=("1",), exosystem=_exosystem(r, m))
        given["groups"] = [first, Group(agents=rest, exosystem=_exosystem(r, m))]
    elif kind < 0.4:
        given["exosystem"] = _exosystem(r, m)
    if r.random() < 0.8:
        ends = []
        for _ in range(m):
            ends.append(sorted(r.choice((-1, 1)) * r.choice((0, 1, 2, 3, 5, 8)) for _ in "ab"))
        unit = r.choice((5, 10))
        states = [[f"{lo}/{unit}", f"{hi}/{unit}"] for lo, hi in ends]
        given["region"] = {"initial_states": states}
        if kind < 0.4 and len(given) > 2:
            given["region"]["initial_disturbance"] = r.choice(("0", "1/10", "1/2"))
    listed = m == 2 and r.random() < 0.5
    if r.random() < 0.5:
        names = r.sample(("weights", "gains", "disturbance", "drift", "measurement"), 2)
        given["uncertainty"] = {name: r.choice(("1/100", "1/20", "0")) for name in names}
        given["uncertainty"] |= {"known_to_agents": r.random() < 0.7}
        given["actuators"] = {"amplitude": r.choice(("0", "1/2")), "limit": r.choice((2, 10, None))}
    coupling = r.choice(LISTS if listed else r.choice((SMOOTH, EDGES, KINKS)))
    target = [r.choice(("0", "0", "0", "1/5")) for _ in range(m)]
    return linked(modes, n, coupling, target=target, **given)


MATRICES = (
    [[1, 0], [0, 0]],
    [[1, -1], [-1, 1]],
    [[2, 1], [-1, 2]],
    [[0, 0], [0, 3]],
    [[1, 1], [1, 1]],
)


def _gain(r: Random, m: int) -> Any:
    if m == 1 or r.random() < 0.4:
        return r.choice(("1/10", "1", "2", "5"))
    return r.choice(MATRICES)


def _exosystem(r: Random, m: int) -> Exosystem:
    A = r.choice(EXOSYSTEMS)
    return Exosystem(A=A, C=[[r.choice((1, 1, 0, -1)) for _ in A] for _ in range(m)])
