"""Rows of `make bench` on large networks: time in sparse products, and the peak memory of a fresh
process.

The unit is one product of the n x n matrix of the arcs (CSR) with a vector, measured in the same
run.
"""

import json
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from random import Random
from typing import Any
from unittest.mock import patch

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree
from simulation import cpu

from dobc_design import Exosystem, Network, Observer, Problem, Region, certify
from dobc_design.certification import recheck
from dobc_design.conditions.consensus.claim import state_theorems
from dobc_design.conditions.consensus.decide import enclosed_lambda
from dobc_design.conditions.consensus.network import shown_bound
from dobc_design.conditions.consensus.propose import (
    Dominating,
    _first_answer,
    _work,
    dominating_vector,
    float_lambda,
)
from dobc_design.conditions.separable import stage
from dobc_design.exact.zmatrix import float_rows
from dobc_design.loop.make import loop_of

SIZE = 100_000
MILLION = 1_000_000
DEGREE = 12.0  # of the geometric network, on average; few agents are then alone
LOOSE_DEGREE = 7.07  # more are alone: 704,568 arcs of 1e5 agents
GAIN = 3
DISTURBED = """initial_disturbance = 0.5
[exosystem]
A = [[0, 2], [-2, 0]]
C = [[1, 0]]
[observer]
W = [["16/5"], ["12/5"]]
"""
DISTURBANCE = Fraction(1, 2)
KINDS = ("ring", "small world", "scale free", "geometric")
# The whole way in a fresh process each: a problem file with its arcs in a CSV file, certify, write,
# read, check again.
WHOLE = """
import json, resource, subprocess, sys, tempfile, time
from pathlib import Path
sys.path[:0] = {folders!r}
from large import write_problem

def step(*arguments):
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, "-m", "dobc_design", *arguments, "--json"]
    done = subprocess.run(command, check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return json.loads(done.stdout), seconds

with tempfile.TemporaryDirectory() as folder:
    code = "import sys; sys.path[:0] = {folders!r}; from large import write_problem;"
    code += f"write_problem({kind!r}, {n}, {{folder!r}})"
    subprocess.run([sys.executable, "-c", code], check=True)
    problem, out = str(Path(folder, "problem.toml")), str(Path(folder, "out"))
    certified, first = step("certify", problem, "--out", out, "--no-report")
    checked, second = step("verify", out, "--problem", str(Path(out, "problem.json")))
unit = 1 if sys.platform == "darwin" else 1024
peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * unit
print(certified["verdict"], certified["covered_by"], checked["holds"], first, second, peak)
"""
# One condition in a fresh process: found and decided, decided again, and the peak of its memory
# beyond the problem's.
ALONE = """
import json, resource, sys, time
sys.path[:0] = {folders!r}
from large import large
from dobc_design.conditions.consensus import decide as plain
from dobc_design.conditions.consensus.claim import state_theorems
from dobc_design.conditions.consensus.propose import lambda_tops
from dobc_design.conditions.weighted.checks import confirm
from dobc_design.conditions.weighted.stage import weighted_stage

def peak():
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 2**30

problem = large({kind!r}, {n})
statements, W, before = state_theorems(problem), problem.observer.W, peak()
started = time.process_time()
if {what!r} == "weighted":
    (check,) = weighted_stage(statements, W)
else:
    top = lambda_tops(statements)["G"]
    proposal = plain.Proposal(margin=-top.value, vectors=[top.vector.tolist()])
    check = plain.lemma1_check(statements, "G", proposal)
decided, started = time.process_time() - started, time.process_time()
if {what!r} == "weighted" and check.verdict.value != "proved":
    raise RuntimeError(check.reason)
if {what!r} == "weighted":
    wrong = confirm(check, problem, W, statements=statements)
else:
    wrong = plain.confirm(check, statements, None)  # proved, or refuted as the star is
if wrong is not None:
    raise RuntimeError(wrong)
again = time.process_time() - started
print(json.dumps(dict(decided=decided, again=again, peak=peak() - before, rate=check.rate or 0)))
"""
WEIGHTED = ("ring", "chain", "star", "scale free", "geometric")
WEIGHTED_HEADER = (
    f"{'network':<12} {'n':>8} {'Lemma 1':>10} {'weighted':>10} {'ratio':>7} {'again':>10} "
    f"{'memory':>9} {'memory':>9}"
)
LAMBDA_HEADER = (
    f"{'network':<12} {'n':>8} {'arcs':>8} {'Lambda < 0':>11} {'rate':>6} {'-1 %':>6} "
    f"{'+1 %':>6} {'ready':>7}"
    f" {'re-check':>9} {'certify':>9} {'verify':>8} {'peak':>9}  verdict"
)


def whole_bars() -> Iterator[dict[str, Any]]:
    """`certify` as a whole, CPU time: a small grid beside a large one, per arc; a refused network
    beside half of it.

    A large grid is asked about no delays and sampling and is not decided twice; the bar is about
    the same questions for both, and the note says what each costs as it comes.
    """
    grids = [(grid(n, edges), 2 * edges) for n, edges in ((118, 179), (4941, 6594))]
    usual = [cpu(lambda given=given: certify(given), repeats=1)[0] / arcs for given, arcs in grids]
    with patch.object(stage, "TIMED_ARCS", 10**6), patch.object(recheck, "PROMPT_ARCS", 0):
        alike = [
            cpu(lambda given=given: certify(given), repeats=1)[0] / arcs for given, arcs in grids
        ]
    shown = [
        f"{1e3 * times[0]:.3g} ms / {1e3 * times[1]:.3g} ms per arc" for times in (alike, usual)
    ]
    yield {
        "what": "certify of a grid, 358 arcs vs 13,188, per arc",
        "bar": 1,
        "ratio": alike[0] / alike[1],
        "note": f"{shown[0]}, both with delays and sampling; as it comes {shown[1]}",
    }
    half, whole = (cpu(lambda n=n: certify(clustered(n)), repeats=1)[0] for n in (SIZE // 2, SIZE))
    note = f"{whole:.3g} s / {half:.3g} s"
    yield {
        "what": "refused, 500 unreached clusters, 1e5 agents vs 5e4",
        "bar": 2.4,
        "ratio": whole / half,
        "note": note,
    }


def size_bars() -> Iterator[dict[str, Any]]:
    """`certify` as a process, CPU time with the start of Python: geometric networks, refused and
    proved, of 1e5 agents in seconds and beside half as many; and what the report of a small problem
    costs beside its proof."""
    for word, seconds, growth in (("refused", 25, 2.4), ("proved", 20, 2.2)):
        with tempfile.TemporaryDirectory() as folder:
            half, whole = (
                certify_seconds(geometric_file(n, folder, refused=word == "refused"))
                for n in (SIZE // 2, SIZE)
            )
        what, note = f"certify, geometric, tanh, {word}", f"{whole:.3g} s / {half:.3g} s"
        yield {
            "what": f"{what}, 1e5 agents vs 5e4",
            "bar": growth,
            "ratio": whole / half,
            "note": note,
        }
        yield {"what": f"{what}, 1e5 agents, CPU in s", "bar": seconds, "ratio": whole}
    alone = min(certify_seconds("clock-sync") for _ in range(5))
    both = min(certify_seconds("clock-sync", report=True) for _ in range(5))
    note = f"{both:.3g} s - {alone:.3g} s"
    yield {
        "what": "the report of clock-sync, CPU in s",
        "bar": 2,
        "ratio": both - alone,
        "note": note,
    }


def agreement_bars(size: int = SIZE) -> Iterator[dict[str, Any]]:
    """`certify` of agents that agree, CPU time: all pairs of 100 in seconds; many with one that
    hears nobody, and with none, beside as many that a pin on the same agents leads."""
    pairs, _ = cpu(lambda: certify(agreeing(100, led=False)), repeats=1)
    yield {"what": "agreement, pairs of 100 agents, CPU in s", "bar": 20, "ratio": pairs}
    pinned, _ = cpu(lambda: certify(agreeing(size, led=True, pinned=True)), repeats=1)
    for word, led in (("one root", True), ("by the graph", False)):
        own, _ = cpu(lambda led=led: certify(agreeing(size, led=led)), repeats=1)
        yield {
            "what": f"agreement, {word}, {size} agents vs pinned",
            "bar": 1.5,
            "ratio": own / pinned,
            "note": f"{own:.3g} s / {pinned:.3g} s",
        }


def agreeing(n: int, *, led: bool, pinned: bool = False) -> Problem:
    """Every agent hears the next one on a ring and two more that are near, a region; one in ten
    hears one more that hears nobody, or is pinned instead."""
    r = Random(n)
    near = [k for k in range(-6, 5) if k not in (-1, 0)]  # the agent, and the next one
    arcs = {(i, (i + k) % n + 1) for i in range(1, n + 1) for k in (0, *r.sample(near, 2))}
    tenth = range(1, n + 1, 10)
    led = led and not pinned
    if led:
        arcs |= {(i, n + 1) for i in tenth}
    network = Network.from_arcs(sorted(arcs), arrow="listens_to", agents=n + led)
    return Problem(
        network=network,
        coupling="exp(y) - 1 + y",
        goal=None if pinned else "agreement",
        gains=dict.fromkeys(tenth, 1) if pinned else None,
        region=Region(initial_states=[-1, 1], initial_disturbance=None),
    )


def certify_seconds(problem: str, *, report: bool = False) -> float:
    """CPU time of `dobc certify` in a process of its own."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with tempfile.TemporaryDirectory() as out:
        command = [
            "certify",
            problem,
            "--out",
            out,
            "--quiet",
            *([] if report else ["--no-report"]),
        ]
        subprocess.run(
            [sys.executable, "-m", "dobc_design", *command], check=False, capture_output=True
        )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def geometric_file(n: int, folder: str, *, refused: bool) -> str:
    """A problem file, one agent in ten pinned; ``refused``: also where that leaves some unreached,
    and with a disturbance, so that a cure of the theorem is looked for."""
    listeners, speakers = geometric(n, degree=LOOSE_DEGREE)
    graph = sp.csr_array((np.ones(len(listeners)), (listeners, speakers)), shape=(n, n))
    pinned = set(np.random.default_rng(n).choice(n, n // 10, replace=False).tolist())
    pinned |= set() if refused else set(_first_agents(graph))
    pairs = zip(listeners.tolist(), speakers.tolist(), strict=True)
    Path(folder, "arcs.csv").write_text(
        "from,to\n" + "".join(f"{i + 1},{j + 1}\n" for i, j in pairs), "utf-8"
    )
    pins = "".join(f"{i + 1} = {GAIN}\n" for i in sorted(pinned))
    file = Path(folder, f"{n}.toml")
    file.write_text(
        f'name = "geometric"\ntarget = 0\n[network]\nagents = {n}\narrow = '
        '"listens_to"\n[network.modes]\n'
        'G = { file = "arcs.csv" }\n[coupling]\nh = "tanh(y)"\n[region]\ninitial_states = [-1, 1]\n'
        f"{DISTURBED if refused else ''}[pinning.gains]\n{pins}",
        "utf-8",
    )
    return str(file)


def grid(n: int, edges: int) -> Problem:
    """A power grid's size: a ring with chords, h = sin(y), one agent in ten pinned, a region."""
    r = Random(n)
    pairs = {(i, (i + 1) % n) for i in range(n)}
    while len(pairs) < edges:
        i = r.randrange(n)
        step = r.randrange(2, 9)
        pairs.add((i, (i + step) % n))
    arcs = sorted({(i + 1, j + 1) for i, j in pairs} | {(j + 1, i + 1) for i, j in pairs})
    return Problem(
        network=Network.from_arcs(arcs, arrow="listens_to", agents=n),
        coupling="sin(y)",
        target=0,
        gains=dict.fromkeys(range(1, n + 1, 10), GAIN),
        region=Region(initial_states=[Fraction(-1, 2), Fraction(1, 2)], initial_disturbance=None),
    )


def clustered(n: int, *, clusters: int = 500) -> Problem:
    """Equal rings with chords that do not hear each other; the first has the only pin, so one is
    left over."""
    size = n // (clusters + 1)
    r = Random(n)
    arcs = []
    for first in range(1, n + 1, size):
        last = min(first + size, n + 1)
        for i in range(first, last):
            ends = {i + 1 if i + 1 < last else first, r.randrange(first, last)} - {i}
            arcs += [(i, j) for j in ends] + [(j, i) for j in ends]
    network = Network.from_arcs(sorted(set(arcs)), arrow="listens_to", agents=n)
    return Problem(network=network, coupling="y", gains={1: GAIN})


def lambda_rows() -> Iterator[str]:
    """Lambda < 0 of large networks in products (at most 250, 500 at 1 %, a re-check in the time of
    3), the whole way in seconds of CPU time, its peak memory (at most 2 GiB)."""
    yield LAMBDA_HEADER
    for kind in KINDS:
        yield f"{_lambda_row(kind, SIZE)} {_whole_way(kind, SIZE)}"
    yield f"{_lambda_row('ring', MILLION)} {_whole_way('ring', MILLION)}"


def _lambda_row(kind: str, n: int) -> str:
    """Products until Lambda < 0 is seen, with a rate, at a shift 1 % below and above the least
    eigenvalue; then the times, in products, of making the exact matrix ready in floats and of
    checking the stored vector with it."""
    problem = large(kind, n)
    table = float_lambda(loop_of(problem), "G").tocsr()
    found = dominating_vector(table)
    if found is None or not found.least > 0:
        raise RuntimeError(f"{kind}, n = {n}: no v is found")
    matrix = enclosed_lambda(state_theorems(loop_of(problem)), "G")
    v = found.vector
    if not shown_bound(matrix, v) < 0:
        raise RuntimeError(f"{kind}, n = {n}: nothing is proved")
    product, _ = cpu(lambda: [table @ v for _ in range(20)], repeats=5)
    ready = float_rows(matrix.middle)
    making, _ = cpu(lambda: [float_rows(matrix.middle) for _ in range(5)], repeats=5)
    recheck, _ = cpu(lambda: [ready.bound(v) for _ in range(20)], repeats=5)
    low = found.least
    high = float(v @ -(table @ v)) / float(v @ v)

    def answer_at(shift: float) -> Dominating:
        return _first_answer(_work(table + shift * sp.eye_array(table.shape[0])))

    while high - low > 2e-3 * low:  # where 1 % is, which is not counted
        middle = (low + high) / 2
        low, high = (middle, high) if answer_at(middle).least >= 0 else (low, middle)
    sides = [answer_at(shift) for shift in (0.99 * low, 1.01 * high)]
    if not (sides[0].least >= 0 > sides[1].least):
        raise RuntimeError(f"{kind}, n = {n}: not decided at 1 %")
    return (
        f"{kind:<12} {n:>8} {table.nnz - n:>8} {found.first:>11} {found.products:>6} "
        f"{sides[0].products:>6}"
        f" {sides[1].products:>6} {4 * making / product:>6.1f}x {recheck / product:>8.1f}x"
    )


def _fresh(script: str, **values: Any) -> str:
    """What a fresh process prints that runs the script with these values."""
    here = Path(__file__).resolve().parent
    text = script.format(folders=[str(here), str(here.parent / "support")], **values)
    return subprocess.run(
        [sys.executable, "-c", text], check=True, capture_output=True, text=True
    ).stdout


def _whole_way(kind: str, n: int) -> str:
    answer = _fresh(WHOLE, kind=kind, n=n)
    verdict, covered_by, holds, first, second, peak = answer.split()
    said = f"{verdict} by {covered_by}, re-checked: {holds}"
    return f"{float(first):>7.1f} s {float(second):>6.1f} s {int(peak) / 2**30:>5.2f} GiB  {said}"


def weighted_rows() -> Iterator[str]:
    """The weighted theorem beside Lemma 1, each alone in a fresh process: seconds of CPU time to
    propose and decide (at most 3 times those of Lemma 1), and to decide again; peak memory."""
    yield WEIGHTED_HEADER
    for kind, n in (*((kind, SIZE) for kind in WEIGHTED), ("ring", MILLION)):
        one, both = (_alone(kind, n, what) for what in ("lemma1", "weighted"))
        ratio = both["decided"] / one["decided"]
        yield (
            f"{kind:<12} {n:>8} {one['decided']:>8.1f} s {both['decided']:>8.1f} s {ratio:>6.1f}x"
            f" {both['again']:>8.1f} s {one['peak']:>5.2f} GiB {both['peak']:>5.2f} GiB"
            f"  rate {one['rate']:.4g} -> {both['rate']:.4g}"
        )


def _alone(kind: str, n: int, what: str) -> dict[str, float]:
    answer = _fresh(ALONE, kind=kind, n=n, what=what)
    found: dict[str, float] = json.loads(answer)
    return found


def write_problem(kind: str, n: int, folder: str) -> None:
    """The problem of ``large`` as a file, its arcs beside it."""
    problem = large(kind, n)
    arcs = problem.network.modes["G"]
    pairs = zip(arcs.listeners.tolist(), arcs.speakers.tolist(), strict=True)
    Path(folder, "arcs.csv").write_text(
        "from,to\n" + "".join(f"{i + 1},{j + 1}\n" for i, j in pairs), "utf-8"
    )
    pins = "".join(f"{i + 1} = {GAIN}\n" for i in problem.pinning.agents)
    Path(folder, "problem.toml").write_text(
        f'name = "large"\ntarget = 1\n[network]\nagents = {n}\narrow = '
        '"listens_to"\n[network.modes]\n'
        'G = { file = "arcs.csv" }\n[coupling]\nh = "exp(y) - 1 + y"\n[exosystem]\nA = '
        "[[0, 2], [-2, 0]]\n"
        'C = [[1, 0]]\n[observer]\nW = [["16/5"], ["12/5"]]\n[region]\ninitial_states = [0, 2]\n'
        f"initial_disturbance = 0.5\n[pinning.gains]\n{pins}",
        "utf-8",
    )


def large(kind: str, n: int) -> Problem:
    """The paper's coupling, exosystem and W; one agent in ten pinned, and every start in [0, 2]
    asked for."""
    listeners, speakers = GRAPHS[kind](n)
    graph = sp.csr_array((np.ones(len(listeners)), (listeners, speakers)), shape=(n, n))
    rng = np.random.default_rng(n)
    pinned = set(rng.choice(n, n // 10, replace=False).tolist()) | set(_first_agents(graph))
    return Problem(
        network=Network.from_sparse({"G": graph}, arrow="listens_to"),
        coupling="exp(y) - 1 + y",
        target=1,
        gains=dict.fromkeys(sorted(i + 1 for i in pinned), GAIN),
        exosystem=Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]]),
        observer=Observer(W=[["16/5"], ["12/5"]]),
        region=Region(initial_states=[0, 2], initial_disturbance=DISTURBANCE),
    )


def _first_agents(graph: Any) -> list[int]:
    """One agent of every part of the network, so that each hears a pinned one."""
    _, part = sp.csgraph.connected_components(graph, directed=False)
    return [int(agent) for agent in np.unique(part, return_index=True)[1]]


def ring(n: int) -> tuple[Any, Any]:
    agents = np.arange(n)
    return np.concatenate([agents, agents]), np.concatenate([(agents + 1) % n, (agents - 1) % n])


def small_world(n: int) -> tuple[Any, Any]:
    """Two neighbours on either side; one arc in ten leads somewhere else."""
    rng = np.random.default_rng(n)
    first = np.tile(np.arange(n), 2)
    second = np.concatenate([(np.arange(n) + 1) % n, (np.arange(n) + 2) % n])
    second = np.where(rng.random(2 * n) < 0.1, rng.integers(0, n, 2 * n), second)
    return _both_ways(first, second, n)


def geometric(n: int, *, degree: float = DEGREE) -> tuple[Any, Any]:
    """Agents in the unit square that hear each other within one distance."""
    pairs = cKDTree(np.random.default_rng(n).random((n, 2))).query_pairs(
        np.sqrt(degree / (np.pi * n)), output_type="ndarray"
    )
    return _both_ways(pairs[:, 0], pairs[:, 1], n)


def scale_free(n: int, *, links: int = 3) -> tuple[Any, Any]:
    """Every new agent joins ``links`` old ones, those with many neighbours more often."""
    r = Random(n)
    ends = list(range(links))
    first, second = [], []
    for agent in range(links, n):
        chosen: set[int] = set()
        while len(chosen) < links:
            chosen.add(ends[r.randrange(len(ends))])
        first += [agent] * links
        second += sorted(chosen)
        ends += [agent] * links + sorted(chosen)
    return _both_ways(np.array(first), np.array(second), n)


def _both_ways(first: Any, second: Any, n: int) -> tuple[Any, Any]:
    low = np.minimum(first, second)
    high = np.maximum(first, second)
    codes = np.unique((low * n + high)[low < high])
    low = codes // n
    high = codes % n
    return np.concatenate([low, high]), np.concatenate([high, low])


def chain(n: int) -> tuple[Any, Any]:
    """Everyone hears the one before: one way."""
    return np.arange(1, n), np.arange(n - 1)


def star(n: int) -> tuple[Any, Any]:
    """Everyone hears the first agent, one way: Lemma 1 is refuted there."""
    return np.arange(1, n), np.zeros(n - 1, dtype=int)


GRAPHS = {
    "chain": chain,
    "star": star,
    "ring": ring,
    "small world": small_world,
    "scale free": scale_free,
    "geometric": geometric,
}


if __name__ == "__main__":
    if len(sys.argv) > 1:  # another size
        SIZE = MILLION = int(sys.argv[1])
    for row in lambda_rows() if len(sys.argv) < 3 else weighted_rows():
        print(row, flush=True)
