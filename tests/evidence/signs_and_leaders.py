"""Random signed graphs against balanced sets, and random networks between fixed nodes against
-L_FF^-1 L_FL: set by set, and in fractions; no code of the package is an oracle here."""

from collections.abc import Iterator
from fractions import Fraction
from itertools import product
from random import Random
from statistics import median
from typing import Any

import numpy as np
from evidence.row import Row

from dobc_design import Certificate, Network, Problem, Verdict, certify
from dobc_design.certificate.text import certificate_bytes
from dobc_design.checker.examine import examine
from dobc_design.loop.limits import mean_weights
from dobc_design.problem.canonical import canonical_bytes

F = Fraction
Arcs = list[list[Any]]
MOST = 8  # agents
CURVED = ("tanh(y)", "exp(y) - 1 + y", "y + y**3")
#: Two pairs that do not hear each other, each with one sign -1.
PAIRS: Arcs = [[1, 2, 1], [2, 1, -1], [3, 4, 1], [4, 3, -1]]


def confirmed(certificate: Certificate) -> Iterator[str]:
    """What the second program does not confirm."""
    problem = canonical_bytes(certificate.problem)
    for holds, text in examine(certificate_bytes(certificate.claims), problem):
        if not holds:
            yield text


def closed_sets(arcs: Arcs, n: int) -> Iterator[tuple[set[int], Arcs]]:
    """Every nonempty set of agents that hears nobody outside, with its arcs."""
    for mask in range(1, 2**n):
        members = {i + 1 for i in range(n) if mask >> i & 1}
        inner = [arc for arc in arcs if arc[0] in members]
        if all(arc[1] in members for arc in inner):
            yield members, inner


def has_two_sides(members: set[int], inner: Arcs) -> bool:
    """Whether some division into two sides fits every sign, of all that there are."""
    agents = sorted(members)
    for sides in product((1, -1), repeat=len(agents)):
        side = dict(zip(agents, sides, strict=True))
        if all(side[i] * side[j] * w > 0 for i, j, w in inner):
            return True
    return False


def some_arcs(r: Random, n: int, signs: tuple[int, ...]) -> Arcs:
    """Arcs between agents; few, so that often a set hears nobody outside."""
    share = r.choice((0.15, 0.3, 0.5))
    arcs = []
    for i, j in product(range(1, n + 1), repeat=2):
        if i != j and r.random() < share:
            arcs.append([i, j, F(r.randint(1, 6), 2) * r.choice(signs)])
    return arcs


def signs(count: int, seed: int) -> Row:
    """Refuted iff a balanced set without a pin hears nobody outside; else proved, and no faster
    than the signed Laplacian."""
    failures = []
    verdicts = dict.fromkeys(Verdict, 0)
    shares = []
    curved = 0
    for number in range(seed, seed + count):
        r = Random(f"signs {number}")
        n = r.randint(2, MOST)
        arcs = PAIRS if number == seed else some_arcs(r, n, (1, 1, -1))
        n = 4 if number == seed else n
        if all(w > 0 for _, _, w in arcs):
            arcs = [*(arc for arc in arcs if arc[:2] != [1, 2]), [1, 2, -1]]
        pins = sorted(r.sample(range(1, n + 1), r.choice((0, 0, 1, 2))))
        given: dict[str, Any] = {"coupling": "y", "gains": dict.fromkeys(pins, 1)}
        bent = number % 3 == 1
        if bent:
            given |= {"coupling": r.choice(CURVED), "region": {"initial_states": [-1, 1]}}
        network = Network.from_arcs(arcs, arrow="listens_to", agents=n, negative="opposes")
        certificate = certify(Problem(network=network, **given))
        verdicts[certificate.verdict] += 1
        free = [each for each in closed_sets(arcs, n) if not each[0] & {*pins}]
        wanted = Verdict.PROVED
        if any(has_two_sides(*each) for each in free):
            wanted = Verdict.REFUTED
        L = np.diag([1.0 if i in pins else 0.0 for i in range(1, n + 1)])
        for i, j, w in arcs:
            L[i - 1, i - 1] += abs(w)
            L[i - 1, j - 1] -= w
        rate = float(np.linalg.eigvals(L).real.min())
        if certificate.verdict is not wanted or (rate > 1e-9) != (wanted is Verdict.PROVED):
            failures.append(f"{number}: {certificate.verdict}, wanted {wanted}, rate {rate}")
        failures += [f"{number}: {text}" for text in confirmed(certificate)]
        if not bent and certificate.rate is not None:
            shares.append(certificate.rate / rate)
            if certificate.rate > rate * (1 + 1e-9):
                failures.append(f"{number}: {certificate.rate} is faster than {rate}")
        curved += bent
    listed = ", ".join(f"{many} {verdict.value}" for verdict, many in verdicts.items())
    note = f"{listed}; {curved} of them from a region, with curved couplings"
    slow = f"certified rate over that of the signed Laplacian: median {median(shares):.6f}, "
    slow += f"least {min(shares):.6f}"
    return Row("signed graphs: balanced sets, and eigenvalues", count, failures, [note, slow])


def solved(rows: list[list[Fraction]], right: list[list[Fraction]]) -> list[list[Fraction]]:
    """The X of rows X = right, by Gauss and Jordan in fractions."""
    n = len(rows)
    work = [[*own, *other] for own, other in zip(rows, right, strict=True)]
    for k in range(n):
        pivot = next(i for i in range(k, n) if work[i][k])
        work[k], work[pivot] = work[pivot], work[k]
        work[k] = [x / work[k][k] for x in work[k]]
        for i in range(n):
            if i != k:
                work[i] = [x - work[i][k] * y for x, y in zip(work[i], work[k], strict=True)]
    return [row[n:] for row in work]


def reached(arcs: Arcs, n: int) -> set[int]:
    """The agents that hear a fixed node, directly or through others."""
    found: set[int] = set()
    for _ in range(n):
        found |= {i for i, j, _ in arcs if isinstance(j, str) or j in found}
    return found


def containment(count: int, seed: int) -> Row:
    """Proved iff every agent hears a fixed node, directly or through others; then they end at
    -L_FF^-1 L_FL of these, and no rate is above the least eigenvalue of L_FF."""
    failures = []
    verdicts = dict.fromkeys(Verdict, 0)
    shares = []
    for number in range(seed, seed + count):
        r = Random(f"containment {number}")
        n = r.randint(1, MOST)
        names = ["a", "b", "c", "d"][: r.randint(2, 4)]
        arcs = some_arcs(r, n, (1,))
        for i, name in product(range(1, n + 1), names):
            if r.random() < 0.25:
                arcs.append([i, name, F(r.randint(1, 6), 3)])
        values = dict(zip(names, r.sample(range(-9, 10), len(names)), strict=True))
        network = Network.from_arcs(arcs, arrow="listens_to", agents=n, fixed=names)
        slope = F(r.randint(1, 5), 2)
        problem = Problem(
            network=network, coupling=f"({slope})*y", goal="containment", fixed=values
        )
        certificate = certify(problem)
        verdicts[certificate.verdict] += 1
        failures += [f"{number}: {text}" for text in confirmed(certificate)]
        wanted = Verdict.PROVED if len(reached(arcs, n)) == n else Verdict.REFUTED
        if certificate.verdict is not wanted:
            failures.append(f"{number}: {certificate.verdict}, wanted {wanted}")
        weights = mean_weights(problem)
        if wanted is Verdict.REFUTED:
            failures += [f"{number}: weights of agents that are adrift"] if weights else []
            continue
        among = [[F(0)] * n for _ in range(n)]
        heard = [[F(0)] * len(names) for _ in range(n)]
        for i, j, w in arcs:
            among[i - 1][i - 1] += slope * w
            if isinstance(j, str):
                heard[i - 1][names.index(j)] += slope * w
            else:
                among[i - 1][j - 1] -= slope * w
        exact = solved(among, heard)
        if weights is None or [list(row) for row in weights] != exact:
            failures.append(f"{number}: other weights than {exact}")
        rate = float(np.linalg.eigvals(np.array(among, dtype=float)).real.min())
        shares.append((certificate.rate or 0) / rate)
        if not 0 < shares[-1] <= 1 + 1e-9:
            failures.append(f"{number}: {certificate.rate} is faster than {rate}")
    listed = ", ".join(f"{many} {verdict.value}" for verdict, many in verdicts.items())
    slow = f"certified rate over the least eigenvalue of L_FF: median {median(shares):.6f}, "
    slow += f"least {min(shares):.6f}"
    what = "between fixed nodes: -L_FF^-1 L_FL in fractions"
    return Row(what, count, failures, [listed, slow])
