"""What `make evidence` counts, and how much of it."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from evidence import (
    accuracy,
    agreement,
    arcs,
    bad_samples,
    bands,
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
    other_networks,
    outputs,
    pinning,
    published,
    readings,
    robustness,
    rocq,
    same_bytes,
    saturation,
    schedules,
    signs_and_leaders,
    simulations,
    stated,
    sweeps,
    times,
)
from evidence.row import Row
from published import PUBLISHED

FUZZ = "fuzz"


@dataclass(frozen=True)
class Item:
    """``run(count, seed)`` gives a Row; the same seed gives the same cases.  CI runs one case in
    ``share``, 0: none."""

    name: str
    run: Callable[[int, int], Row]
    count: int
    seed: int
    share: int = 10


def _items() -> Iterator[Item]:
    yield Item("bad-samples", bad_samples.run, 800, 4100, share=40)
    yield Item("recheck", certificates.recheck, 500, 6000, share=100)
    yield Item("mutants", certificates.mutants, 10_000, 6000, share=0)
    yield Item("groups-recheck", certificates.groups_recheck, 200, 6000, share=80)
    yield Item("groups-mutants", certificates.groups_mutants, 4000, 6000, share=80)
    yield Item("removals", certificates.removals, 300, 0, share=300)
    yield Item("region-recheck", certificates.region_recheck, 60, 0, share=60)
    yield Item("region-mutants", certificates.region_mutants, 2000, 3, share=100)
    yield Item("known-regions", certificates.regions, 100, 0, share=50)
    yield Item("whole-psi", certificates.whole_psi, 100, 6000, share=20)
    yield Item("decision", certificates.decision, 200, 6000, share=20)
    # a fast test runs 60
    yield Item("outside", certificates.outside, 300, 6000, share=0)
    yield Item("accuracy", accuracy.run, 100, 0, share=100)
    yield Item("sines", bands.run, 100, 100)
    yield Item("tolerances", margins.tolerances, 1000, 12_000)
    yield Item("inputs", margins.inputs, 10_000, 12_000)
    yield Item("stated-broken", stated.not_kept, 60, 0, share=20)
    yield Item("stated-kept", stated.kept_ones, 40, 0, share=20)
    yield Item("saturated", saturation.saturated_loops, 60, 0, share=60)
    yield Item("values", other_networks.values, 60, 0, share=30)
    yield Item("value-formulas", other_networks.formulas, 200, 0)
    # the count is networks of each of seven kinds
    yield Item("other-forgeries", other_networks.forgeries, 15, 0, share=15)
    yield Item("signed-graphs", signs_and_leaders.signs, 300, 0, share=30)
    yield Item("containment", signs_and_leaders.containment, 100, 0)
    # the count is starts
    yield Item("arc-wise-starts", arcs.starts, 10_000, 0, share=200)
    yield Item("arc-wise-beyond", arcs.beyond, 300, 0, share=30)
    # CI kills writers, and interrupts
    yield Item("kills", robustness.kills, 200, 8000, share=0)
    yield Item("writers", robustness.writers, 200, 8000, share=20)
    # slow tests interrupt 4 times
    yield Item("interrupts", robustness.interrupts, 30, 8000, share=0)
    # the count is seconds of CPU time
    yield Item(FUZZ, robustness.fuzz, 60, 8000, share=60)
    yield Item("agreement", agreement.run, 400, 8500, share=100)
    yield Item("cures", certificates.cures, 500, 8000, share=100)
    yield Item("local", local.digraphs, 1000, 9200, share=50)
    yield Item("times", times.times, len(times.names()), 0, share=20)
    yield Item("linear-agents", local.linear_agents, 300, 0, share=60)
    yield Item("outputs", outputs.run, 200, 0, share=40)
    yield Item("published", published.table, len(PUBLISHED), 0, share=10)
    # the count is runs, of 48 side by side
    yield Item("late-runs", readings.run, 10_000, 7, share=100)
    yield Item("late-beyond", readings.beyond, 30, 0)
    yield Item("late-margins", readings.margins, 30, 0)
    # the count is samples
    yield Item("processor-code", readings.code, 1_000_000, 1)
    # the count is starts
    yield Item("dynamic-regions", published.regions, 10_000, 0, share=0)
    yield Item("decided", certificates.decided, 500, 9000, share=80)
    yield Item("enclosures", enclosures.run, 1_000_000, 8100, share=200)  # points
    # the count is starts
    yield Item("falsified", falsified.run, 10_000, 8600, share=400)
    yield Item("pins", pinning.choices, 100, 9500, share=25)
    yield Item("designs", designs.requests, 100, 9900, share=25)
    yield Item("true-rate-designs", designs.true_rate, 200, 9950, share=100)
    yield Item("built-in-designs", designs.built_in, 6, 0)
    yield Item("hadamard", hadamard.run, 240, 7000, share=40)
    yield Item("hostile", hostile.run, 250, 9800, share=25)
    yield Item("linear-runs", simulations.linear, 200, 9100, share=40)
    yield Item("sampled-runs", simulations.sampled, 300, 9200, share=50)
    yield Item("stressed-runs", simulations.stressed, 300, 9300, share=50)
    yield Item("bounded-runs", simulations.bounded, 60, 9400, share=60)
    yield Item("schedules", schedules.verdicts, 500, 0, share=500)
    # the first problem is one that takes a second
    yield Item("schedule-runs", schedules.runs, 10_000, 32, share=1000)
    yield Item("sweep", sweeps.run, 2000, 0, share=100)
    yield Item("same-bytes", same_bytes.run, len(same_bytes.NAMES), 0, share=12)
    yield Item("rocq", rocq.files, 15, 0, share=0)  # the slow tests check small ones
    # and four changes
    yield Item("rocq-changes", rocq.changes, rocq.CHANGES, 0, share=0)
    yield Item("long-tests", long_tests.run, 25, 0, share=0)  # eight more with coqc
    # the tests of ten minutes are its base
    yield Item("mutation", mutation.run, 40, 20261122, share=0)


ITEMS = tuple(_items())
