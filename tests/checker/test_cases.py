"""All cases written by hand: the exit codes of the lone checker, what the package says, and who
misses a check."""

from collections.abc import Callable

import pytest
from checker_files.accuracy import accuracy_cases
from checker_files.agreement import agreement_cases
from checker_files.arcs import arcs_cases
from checker_files.bands import bands_cases
from checker_files.containment import containment_cases
from checker_files.dynamics import dynamics_cases
from checker_files.files import (
    FAILS,
    HOLDS,
    UNREADABLE,
    Case,
    accepted_by_package,
    cases,
    misjudged,
)
from checker_files.graphs import graphs_cases
from checker_files.groups import groups_cases
from checker_files.margins import margins_cases
from checker_files.mutants import FILES, Removal, removals, with_slip
from checker_files.outputs import outputs_cases
from checker_files.quadratic import quadratic_cases
from checker_files.readings import readings_cases
from checker_files.removals import EQUIVALENT, noticed_by, outcome
from checker_files.schedules import cycles_cases
from checker_files.separable import region_cases
from checker_files.settling import tube_cases
from checker_files.weighted import problems, weighted_cases

#: How many there are at least: true ones, false ones, and those that cannot be read.
COUNTS: dict[Callable[[], list[Case]], tuple[int, int, int]] = {
    cases: (26, 26, 26),
    region_cases: (26, 101, 0),
    quadratic_cases: (6, 13, 0),
    arcs_cases: (26, 53, 0),
    tube_cases: (17, 109, 0),
    cycles_cases: (18, 81, 0),
    graphs_cases: (20, 101, 0),
    groups_cases: (13, 25, 10),
    weighted_cases: (1, 1, 0),
    accuracy_cases: (1, 1, 0),
    margins_cases: (1, 1, 0),
    dynamics_cases: (20, 55, 20),
    agreement_cases: (29, 50, 7),
    containment_cases: (6, 9, 15),
    readings_cases: (60, 120, 15),
    bands_cases: (5, 20, 8),
    outputs_cases: (8, 17, 15),
}


SLOW = (margins_cases, containment_cases)


@pytest.mark.parametrize(
    ("some", "least"),
    [
        pytest.param(some, least, marks=pytest.mark.slow if some in SLOW else [])
        for some, least in COUNTS.items()
    ],
)
def test_every_case_gets_its_exit_code(some: Callable[[], list[Case]], least: tuple[int, int, int]):
    """Claims whose truth is known, and twins that just fail in one place each."""
    assert misjudged(some()) == []
    for code, count in zip((HOLDS, FAILS, UNREADABLE), least, strict=True):
        assert sum(case.code == code for case in some()) >= count


def test_every_problem_of_the_weighted_cases_is_used():
    names = {case.name.partition(":")[0] for case in weighted_cases()}
    assert names == set(problems())


FINE = [pytest.param(some, True, marks=pytest.mark.slow) for some in (tube_cases, cycles_cases)]


#: Of the others the package's own tests say most.
QUICK = (cases, agreement_cases, graphs_cases, groups_cases, bands_cases, outputs_cases)
BY_PACKAGE = [
    pytest.param(some, False, marks=[] if some in QUICK else pytest.mark.slow) for some in COUNTS
]


@pytest.mark.parametrize(("some", "fine"), [*BY_PACKAGE, *FINE])
def test_the_package_says_the_same(
    some: Callable[[], list[Case]], fine: bool, monkeypatch: pytest.MonkeyPatch
):
    """Its bounds on boxes are wider where V is not sharp, it has no limit on the size of a file,
    and it writes the numbers of the problem anew before it takes the hash.  No row has so little
    room here that it takes fine tables or many halves of a segment."""
    if not fine:
        monkeypatch.setattr("dobc_design.conditions.schedule.rows.CELLS", 128)
        monkeypatch.setattr("dobc_design.conditions.schedule.rows.HALVINGS", 6)
    wider = []
    for case in some():
        if accepted_by_package(case) != (case.code == HOLDS):
            wider.append(case)
    apart = (
        "too large",
        "problem: another spelling of a number",
        "problem: a number that is no text",
    )
    assert all(
        (case.code == HOLDS and case.name.startswith("wavy")) or case.name in apart
        for case in wider
    )


#: Of the other files a few: the evidence tries them all.
FEW = {
    "cycles": ("left >= 0", "len(found) == loop.n", "slope > 0 or flat", "shown"),
    "margins": (
        "largest <= most",
        "most <= limit",
        "not case.matched or exact.weights == 0",
        "0 < rational(claimed[label]) <= room",
    ),
    "accuracy": (
        "by_component",
        "case.B is None",
        "all((h.single for h in case.functions))",
        "disturbed_only",
        "ball.rate > 0",
        "ball.d == after.d",
        "felt",
        "everywhere",
        "case.domain == 'global'",
        "not case.switches",
        "bound >= end",
        "any_shape + sum(left) > 0",
        "left[0] < 1",
        "(each.rho is not None) == curved",
    ),
    "loop": ("self.own is None",),
    "verdict": (
        "loop.own is not None",
        "loop.agrees or loop.drift is None or loop.own is not None or stable(loop.drift)",
        "not (any(wide) and kept)",
    ),
    "consensus": (
        "product(P, W) == Q",
        "semidefinite(RG)",
        "not case.kinked",
        "not (case.agrees or case.gap)",
    ),
    "files": (
        "len(echelon(dynamics.B)[0]) == columns",
        "self.n > 1",
        "free",
        "linear",
        "observed",
        "independent",
        "dynamics.A is not None",
        "not measured or group.W is not None",
    ),
    "examine": ("claims.problem_sha256 == case.problem.sha256",),
    "separable": (
        "left >= 0",
        "min(exact.delay, own, event) >= 0",
        "T * claim.alpha < 1",
        "seen",
        "together or not timing.late",
        "alone",
        "held",
        "straight",
        "integrators and (not apart)",
        "turn > 0",
    ),
    "quadratic": ("claim.level > 0",),
}
REMOVED = list(removals("schedule"))
for file in ("graphs", "coordinates", "arcs", "sampled", "bands"):
    REMOVED += (each for each in removals(file) if each.text not in EQUIVALENT)
for file, some in FEW.items():
    REMOVED += (each for each in removals(file) if each.text in some)


@pytest.mark.slow  # what each case shows is among the fast ones
@pytest.mark.parametrize("removal", REMOVED, ids=str)
def test_the_removal_of_a_check_is_noticed(removal: Removal):
    assert noticed_by(removal) is not None


#: Slips that accept what is false.
SLIPS = (
    ("saturation", "z[k] == -w", "z[k] == w", margins_cases),
    ("accuracy", "bottom) + self.noise)[1]", "bottom) - self.noise)[1]", accuracy_cases),
    ("accuracy", "coupling, self.v[i] + self", "coupling, self.v[i] - self", accuracy_cases),
    ("separable", "(1 + timing.event) * few", "few", readings_cases),
    ("separable", "timing.lost if T", "0 if T", readings_cases),
    ("separable", "(d + 1) ** (d + 1)) / T", "(d + 1) ** d) / T", readings_cases),
    ("separable", "decay = (1 - growth(-beta * T)) / T", "decay = beta", readings_cases),
    ("separable", "Fraction(min(most, left / since))", "most", readings_cases),
    ("loop", "-(-age // self.period)", "age // self.period", readings_cases),
    ("separable", "composite(case, claim, timing.ahead)", "composite(case, claim)", readings_cases),
    ("saturation", "max(length(rows))", "min(length(rows))", readings_cases),
    ("sampled", "plus(identity(size, 0), part**2, P)", "plus(P, 0, P)", readings_cases),
    ("bands", "(rest, low * low", "(rest, high * high", bands_cases),
    ("accuracy", "amplitude * sum(row, ZERO)", "amplitude * row[0]", bands_cases),
    ("loop", "[lo - off, hi + off]", "[lo, hi]", outputs_cases),
    ("separable", "case.exact_region", "case.region", outputs_cases),
)


@pytest.mark.parametrize(
    ("file", "text", "slip", "some"),
    [pytest.param(*each, marks=pytest.mark.slow if each[-1] in SLOW else []) for each in SLIPS],
)
def test_a_slip_in_a_row_is_noticed(
    file: str, text: str, slip: str, some: Callable[[], list[Case]]
):
    module = with_slip(file, text, slip)
    assert any(
        outcome(module.examine, module.Refused, case) == HOLDS
        for case in some()
        if case.code == FAILS
    )


def test_the_checks_are_found():
    texts = {file: [each.text for each in removals(file)] for file in FILES}
    assert sum(map(len, texts.values())) > 250
    long_ones = ("reading", "consensus", "separable", "quadratic", "schedule")
    assert all(len(texts[file]) > 25 for file in long_ones)
    assert set(EQUIVALENT) <= {text for found in texts.values() for text in found}
    for file, some in FEW.items():
        assert set(some) <= set(texts[file])
