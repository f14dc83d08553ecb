"""What `make evidence` counts, and how much of it."""

from collections.abc import Callable
from dataclasses import dataclass

from evidence import (
    accuracy,
    agreement,
    bad_samples,
    certificates,
    designs,
    enclosures,
    falsified,
    hadamard,
    hostile,
    local,
    long_tests,
    margins,
    mutation,
    notebooks,
    pinning,
    published,
    robustness,
    rocq,
    same_bytes,
    schedules,
    simulations,
    stated,
    sweeps,
    times,
)
from evidence.row import Row
from notebook_runs import NOTEBOOKS
from published import PUBLISHED

FUZZ = "fuzz"


@dataclass(frozen=True, kw_only=True)
class Item:
    """``run(count, seed)`` gives a Row; the same seed gives the same cases.  CI runs one case in
    ``share``, 0: none."""

    name: str
    run: Callable[[int, int], Row]
    count: int
    seed: int
    share: int = 10


ITEMS = (
    Item(name="bad-samples", run=bad_samples.run, count=800, seed=4100, share=40),
    Item(name="recheck", run=certificates.recheck, count=500, seed=6000, share=100),
    Item(name="mutants", run=certificates.mutants, count=10_000, seed=6000, share=0),
    Item(name="groups-recheck", run=certificates.groups_recheck, count=200, seed=6000, share=80),
    Item(name="groups-mutants", run=certificates.groups_mutants, count=4000, seed=6000, share=80),
    Item(name="removals", run=certificates.removals, count=300, seed=0, share=300),
    Item(name="region-recheck", run=certificates.region_recheck, count=60, seed=0, share=60),
    Item(name="region-mutants", run=certificates.region_mutants, count=2000, seed=3, share=100),
    Item(name="known-regions", run=certificates.regions, count=100, seed=0, share=50),
    Item(name="whole-psi", run=certificates.whole_psi, count=100, seed=6000, share=20),
    Item(name="decision", run=certificates.decision, count=200, seed=6000, share=10),
    # a fast test runs 60
    Item(name="outside", run=certificates.outside, count=300, seed=6000, share=0),
    Item(name="accuracy", run=accuracy.run, count=100, seed=0, share=100),
    Item(name="tolerances", run=margins.tolerances, count=1000, seed=12_000),
    Item(name="inputs", run=margins.inputs, count=10_000, seed=12_000),
    Item(name="stated-broken", run=stated.not_kept, count=60, seed=0, share=10),
    Item(name="stated-kept", run=stated.kept_ones, count=40, seed=0, share=10),
    # CI kills writers, and interrupts
    Item(name="kills", run=robustness.kills, count=200, seed=8000, share=0),
    Item(name="writers", run=robustness.writers, count=200, seed=8000, share=20),
    # slow tests interrupt 4 times
    Item(name="interrupts", run=robustness.interrupts, count=30, seed=8000, share=0),
    # the count is seconds of CPU time
    Item(name=FUZZ, run=robustness.fuzz, count=60, seed=8000, share=60),
    Item(name="agreement", run=agreement.run, count=400, seed=8500, share=80),
    Item(name="cures", run=certificates.cures, count=500, seed=8000, share=50),
    Item(name="local", run=local.digraphs, count=1000, seed=9200, share=50),
    Item(name="times", run=times.times, count=len(times.names()), seed=0, share=20),
    Item(name="linear-agents", run=local.linear_agents, count=300, seed=0, share=30),
    Item(name="published", run=published.table, count=len(PUBLISHED), seed=0, share=5),
    # the count is starts
    Item(name="dynamic-regions", run=published.regions, count=10_000, seed=0, share=0),
    Item(name="decided", run=certificates.decided, count=500, seed=9000, share=40),
    Item(name="enclosures", run=enclosures.run, count=1_000_000, seed=8100, share=100),  # points
    # the count is starts
    Item(name="falsified", run=falsified.run, count=10_000, seed=8600, share=400),
    Item(name="pins", run=pinning.choices, count=100, seed=9500),
    Item(name="designs", run=designs.requests, count=100, seed=9900),
    Item(name="true-rate-designs", run=designs.true_rate, count=200, seed=9950, share=40),
    Item(name="built-in-designs", run=designs.built_in, count=6, seed=0),
    Item(name="hadamard", run=hadamard.run, count=240, seed=7000, share=20),
    Item(name="hostile", run=hostile.run, count=250, seed=9800, share=12),
    Item(name="linear-runs", run=simulations.linear, count=200, seed=9100, share=20),
    Item(name="sampled-runs", run=simulations.sampled, count=300, seed=9200, share=20),
    Item(name="stressed-runs", run=simulations.stressed, count=300, seed=9300, share=20),
    Item(name="bounded-runs", run=simulations.bounded, count=60, seed=9400, share=60),
    Item(name="schedules", run=schedules.verdicts, count=500, seed=0, share=500),
    Item(name="schedule-runs", run=schedules.runs, count=10_000, seed=0, share=1000),
    Item(name="sweep", run=sweeps.run, count=2000, seed=0, share=100),
    Item(name="same-bytes", run=same_bytes.run, count=len(same_bytes.NAMES), seed=0, share=6),
    Item(name="rocq", run=rocq.files, count=15, seed=0, share=0),  # the slow tests check small ones
    # and four changes
    Item(name="rocq-changes", run=rocq.changes, count=rocq.CHANGES, seed=0, share=0),
    # slow tests run some
    Item(name="notebooks", run=notebooks.run, count=len(NOTEBOOKS), seed=0, share=0),
    Item(name="long-tests", run=long_tests.run, count=25, seed=0, share=0),  # eight more with coqc
    # the tests of ten minutes are its base
    Item(name="mutation", run=mutation.run, count=40, seed=20261122, share=0),
)
