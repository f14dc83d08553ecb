"""What the tables [actuators] and [uncertainty] of a file state, and which proved checks are about
that plant.

The verdict is about the plant that the file states.  A limit is answered by a proved ``actuators``,
relative errors of weights and gains by ``tolerance``, and a disturbance, drift or noise that no
exosystem generates by ``accuracy``, each for all starts that are asked for.  Separate checks prove
nothing together: accuracy has the errors of weights and gains in its rows, and actuators bounds the
inputs under all that is stated: in a box of its own, or where errors are all, in that of
max-separable, whose rows ``tolerance`` has proved.  Terms of ``arc-wise`` have these errors, too.
"""

from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction

from dobc_design._checks import noun
from dobc_design.loop.loop import Loop
from dobc_design.loop.timing import timing_words
from dobc_design.problem.bands import band_words
from dobc_design.problem.uncertainty import ABSOLUTE, RELATIVE
from dobc_design.verdict import Verdict

from .check import Check
from .coverage import holds_region, is_box_near
from .domain import EVERYWHERE, NEAR_TARGET, Around
from .kinds import MAX_SEPARABLE, READINGS

LIMIT = "actuators"
TOLERANCE = "tolerance"
ACCURACY = "accuracy"
ARC_WISE = "arc-wise"
#: How a reason ends where the disturbance takes all that an actuator can give.
NO_ROOM = "so that no region and no gain would do."


@noun
class Stated:
    """Whether the file states a limit of an input, relative errors of weights or gains,
    something that acts on the plant and that no exosystem generates (a drift is one only where
    there is an exosystem), and readings that are ``late`` or held."""

    limit: bool
    relative: bool
    absolute: bool
    late: bool = False

    def __bool__(self) -> bool:
        return self.limit or self.relative or self.absolute or self.late

    @property
    def wanted(self) -> tuple[str, ...]:
        """The ids of the checks that have to be proved; the last one of them that is about
        [uncertainty] carries the verdict."""
        answers = (ACCURACY,) if self.absolute else (TOLERANCE,) if self.relative else ()
        # Readings count errors of weights and gains, and say why where more is stated.
        if self.late:
            answers = (READINGS,)
        return (*((LIMIT,) if self.limit else ()), *answers)


@noun
class Gap:
    """A table without an answer: the check that would be one, the table in words, and why there is
    none."""

    id: str
    table: str
    reason: str
    cure: str


def stated_in(loop: Loop) -> Stated:
    """What the two tables of the problem state."""
    table = loop.uncertainty
    actuators = loop.actuators
    acts = [] if table is None else [name for name in ABSOLUTE if getattr(table, name)]
    return Stated(
        limit=actuators is not None and bool(actuators.limit),
        relative=table is not None and any(getattr(table, name) for name in RELATIVE),
        absolute=any(name not in ("drift", "bands") or loop.groups for name in acts),
        late=loop.timing is not None,
    )


def is_felt_by_arcs_alone(loop: Loop) -> bool:
    """Whether errors of weights and gains leave the estimates as they are."""
    table = loop.uncertainty
    return table is None or table.known_to_agents or not loop.groups


def knows_readings(check: Check) -> bool:
    """Whether a proof is about the readings that the file states, and not about those of the same
    instant."""
    return check.id == READINGS or "late" in (check.exact or {})


def answer_of(loop: Loop, checks: Sequence[Check], id: str) -> Check | None:
    """The proved check ``id``, if it holds for all starts that are asked for; for the tolerance an
    arc-wise one that has the errors in its terms, too, and for readings late weights that move."""
    ids = [id]
    if id == TOLERANCE and is_felt_by_arcs_alone(loop):
        ids.append(ARC_WISE)
    for name in ids:
        for check in checks:
            answers = check.id == name or (name == READINGS and knows_readings(check))
            if answers and check.is_proved and holds_asked(loop, check):
                return check
    return None


def gaps(loop: Loop, checks: Sequence[Check]) -> Iterator[Gap]:
    """The tables that no proved check answers."""
    stated = stated_in(loop)
    for id in stated.wanted:
        reason = None
        if answer_of(loop, checks, id) is None:
            reason = _why(loop, _first(checks, id))
        elif id == LIMIT and stated.relative and not stated.absolute and _are_apart(loop, checks):
            reason = "errors of weights and gains are counted at the target, and inputs in a box."
        if reason is not None:
            table = table_words(loop, id)
            yield Gap(id=id, table=table, reason=reason, cure=_cure(loop, checks, id))


def _first(checks: Sequence[Check], id: str) -> Check | None:
    return next((check for check in checks if check.id == id), None)


def _are_apart(loop: Loop, checks: Sequence[Check]) -> bool:
    """Whether the tolerance has weights of its own, and the inputs are bounded in the box of
    max-separable."""
    own = {check.id for check in checks if {"v", "rooms", "d"} & (check.exact or {}).keys()}
    answer = answer_of(loop, checks, TOLERANCE)
    return answer is not None and answer.id in own and LIMIT not in own


CURES = {
    LIMIT: "a larger limit or, where the disturbance leaves room, a smaller [region] or smaller "
    "gains",
    TOLERANCE: "smaller errors, larger gains or more pinned agents",
    ACCURACY: "a smaller [region], smaller bounds in [uncertainty], larger gains or more pinned "
    "agents",
    READINGS: "a smaller [region], shorter times in [readings] and [processor], or smaller gains",
}
#: The same where there is no region.
_CURES_NEAR = {
    LIMIT: "a larger limit or, where the disturbance leaves room, smaller gains",
    TOLERANCE: CURES[TOLERANCE],
    ACCURACY: "smaller bounds in [uncertainty], larger gains or more pinned agents",
    READINGS: "shorter times in [readings] and [processor], or smaller gains",
}


def _cure(loop: Loop, checks: Sequence[Check], id: str) -> str:
    """What would help; final bounds of linear couplings scale with the bounds of [uncertainty], and
    hold everywhere."""
    # Where no common weights exist, no margin of theirs does.
    if any(check.id == MAX_SEPARABLE and check.verdict is Verdict.REFUTED for check in checks):
        return "pins or arcs by which every agent is reached in every mode"
    found = _first(checks, id)
    # Inputs of agents that agree depend neither on a region nor on gains.
    if id == LIMIT and found is not None and (loop.is_apart or found.reason.endswith(NO_ROOM)):
        return "a larger limit"
    if id == READINGS and loop.is_apart and loop.timing is not None and loop.timing.is_late:
        return "a target with pins, or readings at the ticks of a period without delays"
    # Smaller bounds would only scale what is proved.
    if id == ACCURACY and loop.is_linear:
        return "larger gains or more pinned agents"
    cure = CURES[id] if loop.starts is not None else _CURES_NEAR[id]
    if id == ACCURACY and loop.bands:
        cure = cure.replace(
            "smaller bounds", "a faster observer, more poles in bands, smaller bounds"
        )
    return cure


def holds_asked(loop: Loop, check: Check) -> bool:
    """Whether a check is about all starts that are asked for."""
    if loop.starts is not None:
        return holds_region(loop, check.domain)
    return (
        check.domain == EVERYWHERE or is_box_near(loop, check.domain) or check.domain == NEAR_TARGET
    )


def _why(loop: Loop, check: Check | None) -> str:
    if check is None:
        return "nothing is proved about it."
    if not check.is_proved:
        return check.reason
    if not isinstance(check.domain, Around):
        return "this is proved near the target only, and a region is asked for."
    starts = f"|e_i| <= {check.domain.radius:.6g}"
    if loop.groups:
        starts += f" and |eps_i| <= {check.domain.disturbance:.6g}"
    if loop.starts is None:
        return (
            f"this is proved only from {starts}, so not for all estimates close to the true values."
        )
    return f"this is proved only from {starts}, and the region is larger."


def table_words(loop: Loop, id: str) -> str:
    """What the file states and the check ``id`` answers, with its numbers."""
    if id == LIMIT:
        return _limit_words(loop)
    table = loop.uncertainty
    if table is None:
        return timing_words(loop.timing) if id == READINGS else ""
    relative = [
        f"{name} off by up to {_number(100 * x)} %"
        for name in RELATIVE
        if (x := getattr(table, name))
    ]
    names = {"disturbance": "a disturbance", "drift": "a drift", "measurement": "measurement noise"}
    given = ((name, getattr(table, name)) for name in names if name != "drift" or loop.groups)
    absolute = [f"{names[name]} of up to {_number(x)}" for name, x in given if x]
    absolute += map(band_words, loop.bands)
    parts = relative + absolute if id == ACCURACY else relative
    if id == READINGS:
        parts = [*relative, timing_words(loop.timing)]
    if relative and not table.known_to_agents:
        parts.append("observers that do not know the weights")
    return ", ".join(parts[:-1]) + (" and " if len(parts) > 1 else "") + parts[-1]


def _limit_words(loop: Loop) -> str:
    limit = None if loop.actuators is None else loop.actuators.limit
    if not isinstance(limit, Mapping):
        return f"the limit of {_number(limit or Fraction(0))}"
    ends = [min(limit.values()), max(limit.values())]
    if ends[0] == ends[1]:
        return f"the limit of {_number(ends[0])}"
    return f"limits of {_number(ends[0])} to {_number(ends[1])}"


def _number(x: Fraction) -> str:
    return f"{float(x):.6g}"
