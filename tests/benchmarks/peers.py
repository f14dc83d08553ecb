"""`make bench`: certified radii of small directed cycles, beside what other tools give for the same networks.

Agent i listens to agent i + 1, no exosystem; all agents or one pinned with gain 3.  The package's radii are proved
(``certify`` with ``everything``); what reaches ``LARGEST`` is not looked at further.  drake and immrax run in their own
processes: by the Python that runs this, or where PEERS_PYTHON names another; what is not installed says so.
dReal is not run: its radii are quoted.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from dobc_design.spec.network import Network
from dobc_design.spec.problem import Problem
from dobc_design.workflow import certify

COUPLINGS = ("exp(y) - 1 + y", "y + y**3")
SIZES = (2, 3, 4, 6, 10)
LARGEST = 10.0
GAIN = 3
PATIENCE = 300  # s of wall clock for one case of a peer
# dReal 4.21, V = e'e, exp(y) - 1 + y: V' < 0 between a small ball and these |e|; (agents, pinned).
DREAL = {(2, 2): 6.0, (3, 3): 6.0, (4, 4): 6.0, (2, 1): 3.75, (3, 1): 3.63, (4, 1): 3.63}
CHECKS = ("max-separable", "lure", "exhaustive")
HERE = Path(__file__).parent


def peer_table() -> Iterator[str]:
    """The table, line by line, as Markdown."""
    versions = {name: peer_version(name) for name in ("drake", "immrax")}
    yield f"drake {versions['drake']}, immrax {versions['immrax']}; dReal's radii are quoted."
    yield ""
    yield (
        "| h | n | pinned | box, max-separable | ball, Lur'e | ball, exhaustive | s | dReal, V = e'e"
        " | drake, V = e'e | immrax, mean value | immrax, embedding |"
    )
    yield "|---|---|---|---|---|---|---|---|---|---|---|"
    for coupling in COUPLINGS:
        for n in SIZES:
            for pinned in (n, 1):
                start = time.process_time()
                own = [reached(n, coupling, pinned)[name] for name in CHECKS]
                seconds = f"{time.process_time() - start:.1f}"
                theirs = [*peer("drake", n, coupling, pinned, versions), *peer("immrax", n, coupling, pinned, versions)]
                quoted = DREAL.get((n, pinned)) if coupling == COUPLINGS[0] else None
                cells = [coupling, str(n), str(pinned), *map(shown, own), seconds, shown(quoted), *theirs]
                yield f"| {' | '.join(cells)} |"


def cycle(n: int, coupling: str, pinned: int) -> Problem:
    arcs = [[i, i % n + 1] for i in range(1, n + 1)]
    return Problem(
        network=Network.from_arcs(arcs, arrow="listens_to", agents=n), coupling=coupling,
        gains=dict.fromkeys(range(1, pinned + 1), GAIN), name=f"cycle-{n}",
    )  # fmt: skip


def reached(n: int, coupling: str, pinned: int) -> dict[str, float | None]:
    """The proved radius of every method; None where it proves nothing."""
    everything = certify(cycle(n, coupling, pinned), everything=True).checks
    found: dict[str, float | None] = dict.fromkeys(CHECKS)
    for check in everything:
        if check.id in found and isinstance(check.domain, dict):
            found[check.id] = float(check.domain["radius"])
    return found


def peer_version(name: str) -> str:
    code = f"from importlib.metadata import version; print(version({name!r}))"
    asked = subprocess.run([python(), "-c", code], capture_output=True, text=True, check=False)
    return asked.stdout.strip() if asked.returncode == 0 else "not installed"


def peer(name: str, n: int, coupling: str, pinned: int, versions: dict[str, str]) -> list[str]:
    """The cells of one peer: one of drake, two of immrax."""
    width = 1 if name == "drake" else 2
    if versions[name] == "not installed":
        return ["not installed"] * width
    if name == "drake" and "exp" in coupling:
        return ["no polynomial"]
    call = [python(), str(HERE / f"peer_{name}.py"), str(n), coupling, str(pinned), str(GAIN), str(LARGEST)]
    try:
        answer = subprocess.run(call, capture_output=True, text=True, check=True, timeout=PATIENCE)
    except subprocess.TimeoutExpired:
        return [f"> {PATIENCE} s"] * width
    radii: Any = json.loads(answer.stdout.splitlines()[-1])
    return [shown(radius) for radius in radii]


def python() -> str:
    return os.environ.get("PEERS_PYTHON", sys.executable)


def shown(radius: float | None) -> str:
    """Three digits, down: a radius is never made larger."""
    if radius is None:
        return "-"
    return f">= {LARGEST:g}" if radius >= LARGEST else f"{int(radius * 100) / 100:.2f}"


if __name__ == "__main__":
    for line in peer_table():
        print(line, flush=True)
