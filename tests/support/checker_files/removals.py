"""One check of the lone checker taken away at a time, and the case that notices it."""

from collections.abc import Callable, Iterator
from functools import cache

from checker_files.accuracy import accuracy_cases
from checker_files.agreement import agreement_cases
from checker_files.arcs import arcs_cases
from checker_files.bands import bands_cases
from checker_files.containment import containment_cases
from checker_files.dynamics import dynamics_cases
from checker_files.files import FAILS, HOLDS, UNREADABLE, Case, cases
from checker_files.graphs import graphs_cases
from checker_files.groups import groups_cases
from checker_files.margins import margins_cases
from checker_files.mutants import FILES, Removal, Watched, removals, without
from checker_files.outputs import outputs_cases
from checker_files.quadratic import quadratic_cases
from checker_files.readings import readings_cases
from checker_files.schedules import cycles_cases
from checker_files.separable import region_cases
from checker_files.settling import tube_cases
from checker_files.weighted import weighted_cases

EVERY = (
    cases,
    region_cases,
    quadratic_cases,
    arcs_cases,
    groups_cases,
    tube_cases,
    weighted_cases,
    margins_cases,
    accuracy_cases,
    cycles_cases,
    graphs_cases,
    dynamics_cases,
    agreement_cases,
    containment_cases,
    readings_cases,
    bands_cases,
    outputs_cases,
)
#: The cases to try first.
FIRST: dict[str, tuple[Callable[[], list[Case]], ...]] = {}
FIRST["files"] = dynamics_cases, agreement_cases, containment_cases, outputs_cases
FIRST["pairs"] = (agreement_cases,)
FIRST["loop"] = (dynamics_cases,)
FIRST["guarantee"] = cycles_cases, graphs_cases
FIRST["consensus"] = dynamics_cases, cases
FIRST["separable"] = region_cases, readings_cases
FIRST["sampled"] = (readings_cases,)
FIRST["margins"] = margins_cases, dynamics_cases, agreement_cases
FIRST["accuracy"] = accuracy_cases, bands_cases
FIRST["bands"] = (bands_cases,)
FIRST["quadratic"] = (quadratic_cases,)
FIRST["arcs"] = (arcs_cases,)
FIRST["schedule"] = tube_cases, cycles_cases
FIRST["cycles"] = cycles_cases, agreement_cases
FIRST["graphs"] = graphs_cases, agreement_cases
FIRST["coordinates"] = dynamics_cases, region_cases, containment_cases
FIRST["verdict"] = dynamics_cases, cases, agreement_cases
FIRST["examine"] = dynamics_cases, cases
#: Of these checks the cases that notice them, wherever they stand.
NOTICE = {"not case.gap": (containment_cases,)}
NOTICE["case.timing is None"] = (readings_cases,)
NOTICE["case.timing is None or not instant"] = (readings_cases,)
NOTICE["bool(claim.late) == (case.timing is not None)"] = (readings_cases,)
NOTICE["not case.matched or exact.weights == 0"] = (agreement_cases,)
NOTICE["not (case.agrees or case.gap)"] = (agreement_cases,)
#: Removals that no case can notice, each with the reason.
EQUIVALENT: dict[str, str] = {}
EQUIVALENT["not min(whole) > 0"] = (
    "conjugate gradients stop at the first direction of curvature <= 0; as long as they run, M is "
    "positive on all they have seen, so that a v with M v > 0 comes out positive but for rounding "
    "errors."
)
EQUIVALENT["math.isfinite(found)"] = (
    "every operation on intervals refuses a result that is not below LARGEST, so that no slope is "
    "infinite."
)
EQUIVALENT["done > PIECES or b - a <= rho * SHORTEST or (not a < middle < b)"] = (
    "it ends the search: without it a row that is not shown is cut for ever."
)
EQUIVALENT["size <= EQUATIONS"] = "it bounds the work; what is shown beyond it is true."
EQUIVALENT["pivots == [*range(m)]"] = (
    "the rows of a singular T are dependent, so that no T X S dominates on its diagonal."
)
EQUIVALENT["min(form[0], form[-1]) < 0"] = (
    "it ends the search: a part on which the polynomial is negative is halved for ever."
)
EQUIVALENT["not halvings"] = (
    "it ends the search: without it a part, or a box, that is not shown is halved for ever."
)
EQUIVALENT["rate * each.times[-1] <= LONGEST"] = (
    "it bounds the work: the weights would have to fall as far."
)
EQUIVALENT["norm(whole.entries) >> LARGEST == 0"] = "it bounds the work: the ball is as true."
EQUIVALENT["low == high"] = (
    "f less an end of an interval is not shown to vanish at the target, which the reader asks."
)
EQUIVALENT |= dict.fromkeys(
    (
        "size <= ROWS",
        "case.size <= MOST",
        "len(X) <= 20",
        "case.n <= AGENTS",
        "m <= MOST",
        "0 < len(turns) <= ROUND and size <= ROWS",
        "grown <= GROWTH",
        "len(G) <= MODES",
    ),
    "it bounds the work.",
)


def outcome(examine: object, refused: type[Exception], case: Case) -> int | str:
    try:
        findings = examine(case.certificate, case.problem)  # type: ignore[operator]
    except refused:
        return UNREADABLE
    except Exception as error:  # noqa: BLE001 - whatever it is, it is no clean refusal
        return repr(error)
    if all(holds for holds, _ in findings):
        return HOLDS
    return FAILS


@cache
def _watched() -> Watched:
    return Watched()


#: Of each file of cases those that were watched: the checks that do not pass.
_SEEN: dict[Callable[[], list[Case]], list[set[tuple[str, int]]]] = {}


def _failing(cases: Callable[[], list[Case]], place: tuple[str, int]) -> Iterator[Case]:
    """The cases in which this check does not pass: no other case can notice that it is gone.  Each
    is watched once, and not before it is asked for."""
    seen = _SEEN.setdefault(cases, [])
    for k, case in enumerate(cases()):
        if k == len(seen):
            outcome(_watched().module.examine, _watched().module.Refused, case)
            seen.append(_watched().failed())
        if place in seen[k]:
            yield case


def noticed_by(removal: Removal) -> str | None:
    """The first case that comes out differently: accepted, with another exit code, or with a
    traceback."""
    module = without(removal)
    own_first = (*NOTICE.get(removal.text, ()), *FIRST.get(removal.file, ()))
    tried_values = (*own_first, *EVERY)
    for some in dict.fromkeys(tried_values):
        for case in _failing(some, (removal.file, removal.place)):
            if outcome(module.examine, module.Refused, case) != case.code:
                return case.name
    return None


def unnoticed(count: int) -> tuple[int, list[str]]:
    """How many removals were tried, evenly spread over the files (at most ``count``), and which no
    case notices."""
    every = []
    for file in FILES:
        for each in removals(file):
            if each.text not in EQUIVALENT:
                every.append(each)
    tried = every[:: max(1, len(every) // max(1, count))]
    return len(tried), [str(each) for each in tried if noticed_by(each) is None]
