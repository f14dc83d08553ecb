"""`make bench`: certified radii of small directed cycles, beside what other tools give for the same
networks.

Agent i listens to agent i + 1, no exosystem; all agents or one pinned with gain 3.  The package's
radii are proved (``certify`` with ``everything``); what reaches ``LARGEST`` is not looked at
further.  A second table has, beside the Lur'e ball, one that the same V cannot exceed, because a
point with V' >= 0 was found.  drake and immrax run in processes of their own: by the Python that
runs this, or where PEERS_PYTHON names another; what is not installed says so.  dReal is not run:
its radii are quoted.  `docs/comparison.md` holds these tables as they are printed.
"""

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from scipy import optimize

from dobc_design import Check, Dynamics, Network, Problem, certify

COUPLINGS = ("exp(y) - 1 + y", "y + y**3")
SIZES = (2, 3, 4, 6, 10)
LARGEST = 10.0
GAIN = 3
PATIENCE = 300  # s of wall clock for one case of a peer
# dReal 4.21, V = e'e, exp(y) - 1 + y: V' < 0 between a small ball and these |e|; (agents, pinned).
DREAL = {(2, 2): 6.0, (3, 3): 6.0, (4, 4): 6.0, (2, 1): 3.75, (3, 1): 3.63, (4, 1): 3.63}
RAYS, STEPS, CLIMBS = 4000, 120, 12  # of the search for points with V' >= 0
HEAD = (
    "| h | n | pinned | box, max-separable | ball, arc-wise | ball, Lur'e | dReal, V = e'e"
    " | drake, V = e'e | immrax, mean value | immrax, embedding |"
)
CLOSER = "| h | n | pinned | ball, Lur'e | V' >= 0 found from | CPU s of all proofs |"
HERE = Path(__file__).parent


def peer_table() -> Iterator[str]:
    """The table, line by line, as Markdown."""
    versions = {name: peer_version(name) for name in ("drake", "immrax")}
    yield f"drake {versions['drake']}, immrax {versions['immrax']}; dReal's radii are quoted."
    yield ""
    closer = ["", CLOSER, "|---" * (CLOSER.count("|") - 1) + "|"]
    yield HEAD
    yield "|---" * (HEAD.count("|") - 1) + "|"
    for coupling in COUPLINGS:
        for n in SIZES:
            for pinned in (n, 1):
                start = time.process_time()
                found = certify(cycle(n, coupling, pinned), everything=True).checks
                seconds = f"{time.process_time() - start:.1f}"
                names = ("max-separable", "arc-wise", "lure")
                box, by_arcs, ball = (reached(name, found) for name in names)
                quadratic = next((check.exact for check in found if check.id == "lure"), None)
                if quadratic is None:
                    rise = None
                else:
                    rise = nearest_rise(cycle(n, coupling, pinned), quadratic["P_e"])
                theirs = [
                    *peer("drake", n, coupling, pinned, versions),
                    *peer("immrax", n, coupling, pinned, versions),
                ]
                quoted = DREAL.get((n, pinned)) if coupling == COUPLINGS[0] else None
                case = [coupling, str(n), str(pinned)]
                ours = map(shown, (box, by_arcs, ball, quoted))
                cells = [*case, *ours, *theirs]
                yield f"| {' | '.join(cells)} |"
                closer.append(
                    f"| {' | '.join([*case, shown(ball), shown(rise, up=True), seconds])} |"
                )
    yield from closer
    yield from (
        "",
        "| pendulums, n | ball, Lur'e | CPU s of all proofs | drake, V = e'Pe | wall s |",
        "|---" * 5 + "|",
    )
    for n in (2, 3, 4):
        start = time.process_time()
        ball = reached("lure", certify(pendulums(n)).checks)
        seconds = time.process_time() - start
        begun = time.perf_counter()
        (theirs,) = peer("drake", n, "pendulums", 1, versions)
        yield (
            f"| {n} | {shown(ball)} | {seconds:.1f} | {theirs} | "
            f"{time.perf_counter() - begun:.1f} |"
        )


def pendulums(n: int) -> Problem:
    """x'' = -x + x^3/6 - x'/2 on a directed cycle: sin as far as its third power, for drake knows
    polynomials only."""
    arcs = [[i, i % n + 1] for i in range(1, n + 1)]
    nodes = ["x2", "-x1 + x1**3/6 - x2/2"]
    return Problem(
        network=Network.from_arcs(arcs, arrow="listens_to", agents=n),
        coupling="y1/4 + y2/2",
        gains={1: 2},
        dynamics=Dynamics(f=nodes, B=[[0], [1]]),
        region={"initial_states": [-1, 1]},
    )


def cycle(n: int, coupling: str, pinned: int) -> Problem:
    arcs = [[i, i % n + 1] for i in range(1, n + 1)]
    return Problem(
        network=Network.from_arcs(arcs, arrow="listens_to", agents=n),
        coupling=coupling,
        gains=dict.fromkeys(range(1, pinned + 1), GAIN),
        name=f"cycle-{n}",
    )


def reached(id: str, checks: Sequence[Check]) -> float | None:
    """The proved radius of a method; None where it proves nothing."""
    domains = (check.domain for check in checks if check.id == id)
    return next((float(domain.radius) for domain in domains if isinstance(domain, dict)), None)


def nearest_rise(problem: Problem, entries: Sequence[Any]) -> float | None:
    """The least ball found that no level set of V = e'P_e e can hold, because V' >= 0 at a point of
    it; no proof.

    None where no ball up to LARGEST has such a point: rays in random directions, then descent along
    V' = 0.
    """
    n = problem.n
    (arcs,) = problem.network.modes.values()
    P = np.zeros((n, n))
    for a, b, value in entries:
        P[a, b] = P[b, a] = float(Fraction(value))
    h = problem.coupling.numpy_function()
    top = float(np.linalg.eigvalsh(P)[-1])

    def rise(e: Any) -> Any:
        total = -e * np.array(
            [
                float(problem.pinning.gains[i][0][0]) if i in problem.pinning.gains else 0.0
                for i in range(n)
            ]
        )
        for i, j, w in arcs:
            total[..., i] += float(w) * h((e[..., j] - e[..., i])[..., None])[..., 0]
        return np.sum((e @ P) * total, axis=-1)

    rays = np.random.default_rng(0).standard_normal((RAYS, n))
    rays *= LARGEST * np.sqrt(top / np.einsum("ri,ij,rj->r", rays, P, rays))[:, None]
    shares = np.geomspace(1e-2, 1, STEPS)
    with np.errstate(all="ignore"):
        rising = np.array([rise(share * rays) >= 0 for share in shares])
    first = np.where(rising.any(axis=0), shares[rising.argmax(axis=0)], np.inf)
    starts = []
    for k in np.argsort(first)[:CLIMBS]:
        if first[k] < np.inf:
            starts.append(first[k] * rays[k])
    levels = [start @ P @ start for start in starts]
    for start in starts:
        found = optimize.minimize(
            lambda e: e @ P @ e,
            start,
            jac=lambda e: 2 * P @ e,
            method="SLSQP",
            constraints={"type": "ineq", "fun": lambda e: rise(e) / (e @ P @ e + 1e-300)},
        )
        if (
            found.success
            and rise(found.x) >= -1e-9 * (found.x @ P @ found.x)
            and found.x @ P @ found.x > 1e-6 * top
        ):
            levels.append(found.x @ P @ found.x)
    if levels:
        return float(np.sqrt(min(levels) / top))
    return None


def peer_version(name: str) -> str:
    code = f"from importlib.metadata import version; print(version({name!r}))"
    asked = subprocess.run([python(), "-c", code], capture_output=True, text=True, check=False)
    if asked.returncode == 0:
        return asked.stdout.strip()
    return "not installed"


def peer(name: str, n: int, coupling: str, pinned: int, versions: dict[str, str]) -> list[str]:
    """The cells of one peer: one of drake, two of immrax."""
    width = 1 if name == "drake" else 2
    if versions[name] == "not installed":
        return ["not installed"] * width
    if name == "drake" and "exp" in coupling:
        return ["no polynomial"]
    call = [
        python(),
        str(HERE / f"peer_{name}.py"),
        str(n),
        coupling,
        str(pinned),
        str(GAIN),
        str(LARGEST),
    ]
    try:
        answer = subprocess.run(call, capture_output=True, text=True, check=True, timeout=PATIENCE)
    except subprocess.TimeoutExpired:
        return [f"> {PATIENCE} s"] * width
    radii: Any = json.loads(answer.stdout.splitlines()[-1])
    return [shown(radius) for radius in radii]


def python() -> str:
    return os.environ.get("PEERS_PYTHON", sys.executable)


def shown(radius: float | None, *, up: bool = False) -> str:
    """Two decimals, down: a radius is never made larger; ``up`` where smaller would claim more."""
    if radius is None:
        return "-"
    return f">= {LARGEST:g}" if radius >= LARGEST else f"{int(radius * 100 + up) / 100:.2f}"


if __name__ == "__main__":
    for line in peer_table():
        print(line, flush=True)
