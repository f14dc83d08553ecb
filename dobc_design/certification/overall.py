"""The overall verdict.  Proved iff a consensus proof covers what is asked, and the checks of the
tables [actuators] and [uncertainty] do, where the file states something there
(``conditions.stated``).  Refuted iff consensus itself is proved to fail: agents out of reach of
every pin in all modes together, an estimation error that reaches the agents and does not decay, or
an unstable linearisation.  A theorem that does not apply never refutes."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction

from dobc_design._show.text import capitalize_first, significant_away_from_zero
from dobc_design.certificate.claims import Claims, Overall
from dobc_design.conditions.check import Check, Checks
from dobc_design.conditions.consensus.agreement import agreement_words
from dobc_design.conditions.consensus.claim import Unstable
from dobc_design.conditions.consensus.network import (
    apart_in_words,
    cure_in_words,
    name_agents,
    resting_words,
    unheld_groups,
)
from dobc_design.conditions.coverage import asked_ball, asked_radius, covering
from dobc_design.conditions.domain import NEAR_TARGET, Around, Ball
from dobc_design.conditions.graphs.claim import signals_in_words
from dobc_design.conditions.graphs.decide import absorbing
from dobc_design.conditions.kinds import REACHABILITY, READINGS
from dobc_design.conditions.numbers import read_rational, rounded_up, text_below
from dobc_design.conditions.observer.decide import observable_part_decays, too_large
from dobc_design.conditions.reason import Reason, open_reason
from dobc_design.conditions.schedule.cycles import cycles_of
from dobc_design.conditions.stated import (
    ACCURACY,
    CURES,
    LIMIT,
    TOLERANCE,
    answer_of,
    gaps,
    knows_readings,
    stated_in,
    table_words,
)
from dobc_design.exact.matrix import Matrix, Vector, find_in_nullspace
from dobc_design.exact.number import number_text
from dobc_design.exact.observability import decide_detectable
from dobc_design.exact.polynomial import decide_hurwitz
from dobc_design.exact.reading import Names, some
from dobc_design.exact.work import out_of_time, time_limit
from dobc_design.loop.arcs import closed_groups, unreached
from dobc_design.loop.loop import Loop
from dobc_design.loop.pairs import are_pairs, rows_of
from dobc_design.loop.words import said_of
from dobc_design.problem.network import Arcs
from dobc_design.problem.uncertainty import BOUNDS
from dobc_design.verdict import Verdict

SHOWN = 6  # fixed nodes that a sentence names
MOST_PHASES = 40  # of a guarantee, of which cycles are examined
MOST = Fraction(10) ** 300  # what a sentence can show of a number
#: Whose reason is given where nothing is proved or refuted, the most telling first.
SPEAKING = (
    READINGS,
    "detectability",
    "hurwitz",
    "theorem2-weighted",
    "theorem2",
    "theorem1",
    "lemma1",
)
ALONE = "Without [region] the verdict is about the consensus alone."
HELD_ALWAYS = (
    "An arc that is always there would help as well: in this mode or, with a guarantee in "
    '[switching] on time (such as "dwell"), in another one that comes often enough.'
)


def with_verdict(claims: Claims, overall: Overall) -> Claims:
    """The claims with this verdict."""
    return replace(
        claims,
        verdict=overall.verdict,
        why=overall.why,
        rate=overall.rate,
        factor=overall.factor,
        covered_by=overall.covered_by,
        value=claims.value if overall.verdict is Verdict.PROVED else None,
    )


def decide_overall(loop: Loop, checks: Checks, W: Matrix | None) -> Overall:
    """Combine checks decided for the gain W.  Of these only verdicts, domains, rates and proved
    instabilities enter, never a text; the rest is exact facts of ``problem``.  A designed W that
    fails says nothing against the problem."""
    found = _decided(loop, checks, W)
    return replace(found, why=found.why.turned(said_of(loop)))


def _decided(loop: Loop, checks: Checks, W: Matrix | None) -> Overall:
    stated = stated_in(loop)
    # A proof that covers what is asked ends the question; whatever else fails is only a method.
    rows = rows_of(loop, W) or loop
    proofs = covering(rows, checks)
    proofs = [check for check in proofs if knows_readings(check)] or proofs
    if stated:  # the checks of the tables are about the graphs of the modes, not about every graph
        proofs = [check for check in proofs if check.kind.role != "safety"]
    # States converge where their estimates do and the errors of these decay.
    if loop.sensed and any(x.id == "hurwitz" and not x.is_proved for x in checks):
        proofs = []
    # The model without late readings may converge all the same.
    diverges = any(x.id == READINGS and x.verdict is Verdict.REFUTED for x in checks)
    if proofs and not diverges:
        return _proved(rows, checks, min(proofs, key=_preference))
    refuted = refutation(loop, checks, W)
    if refuted is not None:
        return Overall(verdict=Verdict.REFUTED, why=Reason(head=refuted))
    why = _undecided_reason(loop, checks).followed_by(_moving_words(loop, checks, None))
    return Overall(verdict=Verdict.UNDECIDED, why=why)


def refutation(loop: Loop, checks: Checks, W: Matrix | None) -> str | None:
    """Why consensus itself fails, where that is proved and none of these checks, decided for the
    gain W, covers what is asked; None where it is not."""
    if loop.gap:  # the rest is about one target
        return _apart_reason(loop)
    found = _apart_reason(loop) or _adrift_reason(loop) or _hidden_reason(loop)
    return found or _refuted_reason(loop, checks, W)


def _proved(loop: Loop, checks: Checks, best: Check) -> Overall:
    """The verdict about the plant that the file states, where ``best`` proves what is asked of the
    model alone."""
    stated, open_tables = stated_in(loop), list(gaps(loop, checks))
    if open_tables:
        without = " and ".join(_name_of(loop, id) for id in stated.wanted)
        arrival = _arrival(loop, best, pace=best).replace("All", "all", 1)
        told = f"without {without} {arrival}"
        reasons = dict.fromkeys(gap.reason for gap in open_tables)
        for reason in reasons:
            tables = " and with ".join(gap.table for gap in open_tables if gap.reason == reason)
            told += f"; with {tables} it is not proved: {reason.removesuffix('.')}"
        cures = "; ".join(dict.fromkeys(gap.cure for gap in open_tables))
        why = open_reason(f"{told}.", f"{cures}.")
        return Overall(verdict=Verdict.UNDECIDED, why=why)
    # The rate is that of the plant with all that is stated, not that of the model alone.
    # Without tables the proof carries the verdict itself.
    carrier = best
    for id in (READINGS, ACCURACY, TOLERANCE):
        if id in stated.wanted:
            carrier = answer_of(loop, checks, id) or best
    late = f", with {table_words(loop, READINGS)}" if stated.late else ""
    final = carrier if carrier.id == ACCURACY else None
    reason = _arrival(loop, best, pace=carrier, final=final, late=late)
    if not late and (carrier is not best or stated.relative):
        reason += f", with {table_words(loop, carrier.id)}"
    if loop.saturates:
        reason += f", with inputs that saturate at {table_words(loop, LIMIT)}"
    elif stated.limit:
        reason += (
            f", and no {_limited(loop)} exceeds "
            f"{table_words(loop, LIMIT)}{_limited_starts(loop, checks)}"
        )
    reason += f".{_local_words(carrier)}{_moving_words(loop, checks, best)}"
    return Overall(
        verdict=Verdict.PROVED,
        rate=carrier.rate,
        factor=carrier.factor,
        covered_by=carrier.id,
        why=Reason(head=reason),
    )


def _limited(loop: Loop) -> str:
    """Which inputs the limits are about."""
    limits = None if loop.actuators is None else loop.actuators.limit
    if isinstance(limits, Mapping) and len(limits) != loop.n:
        return "input of an agent with a limit"
    return "input"


def _limited_starts(loop: Loop, checks: Checks) -> str:
    """From where no limit is reached.  Without a region that is a box, whatever the domain of the
    consensus is."""
    held = answer_of(loop, checks, LIMIT)
    if loop.starts is not None or held is None or not isinstance(held.domain, Around):
        return ""
    starts = f"|e_i| <= {held.domain.radius:.6g}"
    if loop.groups:
        starts += f" and |eps_i| <= {held.domain.disturbance:.6g}"
    return f" from starts with {starts}"


_NAMES = {
    LIMIT: "the actuator limit",
    TOLERANCE: "[uncertainty]",
    ACCURACY: "[uncertainty]",
    READINGS: "late readings",
}


def _name_of(loop: Loop, id: str) -> str:
    """The table that a check answers for."""
    table = loop.uncertainty
    if id == ACCURACY and loop.bands and not any(getattr(table, name) for name in BOUNDS):
        return "the sines of exosystem.bands"
    return _NAMES[id]


def _preference(check: Check) -> tuple[bool, float, float]:
    """Less is better: what holds for every signal, then the least certified time to one percent,
    then the rate."""
    return check.kind.signals == "some", check.time_to_one_percent, -(check.rate or 0.0)


def _moving_words(loop: Loop, checks: Checks, best: Check | None) -> str:
    """What is proved of graphs that move, beside the proof that carries the verdict."""
    words = ""
    if not loop.guarantee.moves:
        return words
    if best is not None and best.kind.role != "safety":
        words = " This is about the graphs of the declared modes"
        # A row of a pair has the neighbours of both in one mode.
        if best.kind.topic == "separable" and not are_pairs(loop):
            words += (
                " and every mix of their neighbour sets: each agent may take its neighbours "
                "from any mode"
            )
        words += ". Graphs that the modes do not list are not covered."
    for check in checks:
        is_safe = check.kind.role == "safety" and check.is_proved
        if is_safe and check is not best:
            words += f" {capitalize_first(check.reason)}"
    return words


def _refuted_reason(loop: Loop, checks: Checks, W: Matrix | None) -> str | None:
    """What a given W or a refuted check says against consensus itself."""
    region = loop.starts
    if region is None or (region.disturbance or 0) > 0:
        failing = _failing_gain(loop, W)
        if failing is not None:
            return failing
    refuting = [check for check in checks if check.verdict is Verdict.REFUTED]
    if region is None or _target_is_interior(loop):
        for check in refuting:
            reason = _instability(loop, check)
            if reason is not None:
                return reason
    # Without a region the question is about every neighbourhood of the target, and an equilibrium
    # is some way off.
    if region is None:
        return None
    return next((check.reason for check in refuting if check.kind.role == "rest"), None)


def _failing_gain(loop: Loop, W: Matrix | None) -> str | None:
    """That an error of the estimates does not decay with a W that was given.  A designed one says
    nothing against the problem."""
    # Of measured outputs nothing is said: where estimates diverge states need not.
    for group in () if loop.sensed else loop.groups:
        own = group.observer.W
        is_given = own is not None and (loop.is_grouped or own == W)
        if not is_given or own is None or too_large(group.exosystem) is not None:
            continue
        if not observable_part_decays(group.exosystem, own, loop.timing):
            whose = f" of the group of agent {group.name}" if loop.is_grouped else ""
            return (
                f"Consensus fails: with this W{whose} the estimation error does not decay, and "
                "it reaches the agents. Choose another W, or leave W out to have one designed."
            )
    return None


def _instability(loop: Loop, check: Check) -> str | None:
    """What a refuted check says against close starts: an unstable linearisation in a mode that may
    stay on, or growth under the guarantee."""
    stays = loop.may_stay(check.mode or next(iter(loop.modes)))
    if check.id == READINGS:
        return f"Consensus fails: {check.reason}"
    # What grows in the flow need not do so from one tick to the next, without couplings or with
    # dynamics that go on.
    held = loop.timing is not None and loop.timing.period > 0
    if held and (loop.drift is not None or check.kind.topic == "schedule"):
        return None
    if isinstance(check.claim, Unstable) and check.claim.roots and stays:
        where = "" if check.mode is None else f"in mode {check.mode} "
        return (
            f"Consensus fails: {where}the linearisation at the target is unstable "
            f"({check.claim.roots} eigenvalue(s) with positive real part)."
        )
    if check.kind.topic == "schedule":
        return f"Consensus fails: {check.reason}"
    return None


def _apart_reason(loop: Loop) -> str | None:
    """Agents that nothing pulls to the target, always, in a cycle of modes, or in modes that a
    Markov chain never leaves, if the region lets them start so."""
    phases = loop.guarantee.phases
    # what no gain and no slope of f acts on, f itself may still pull: x' = -x**3
    if loop.drift_place is not None:
        return None
    cycles = cycles_of(phases) if len(phases) <= MOST_PHASES else []
    for cycle in ((), *cycles, *absorbing(loop)):
        reason = _apart_in(loop, cycle)
        if reason is not None:
            return reason
    return None


def _apart_in(loop: Loop, cycle: Names) -> str | None:
    """The same for these modes, or for all with every arc there; what an allowed signal may leave
    out is left out."""
    arcs = [loop.modes[mode] for mode in cycle]
    if not arcs:
        arcs = [each.present for each in loop.modes.values()]
    if loop.has_roots:
        return _disagreement_in(loop, cycle, arcs)
    # A group listens to nobody outside it, so a common error that no gain there acts on stays.
    apart = unreached(loop, arcs)
    for group, free in unheld_groups(loop, arcs):
        c = _start_apart(loop, group, free)
        if c is None:
            continue
        if set(group) <= set(apart):
            return _unreached_words(loop, cycle, arcs, apart)
        own = "the gains" if loop.drift is None else "the gains and the dynamics"
        who = name_agents(tuple(loop.labels[i] for i in group))
        direction = ", ".join(number_text(x) for x in c)
        return (
            f"Consensus fails: {own} of {who} leave the direction ({direction}) free, and no other "
            "agent acts on it: an error in this direction never decays. Give one of them a gain k "
            "with k c != 0 for that direction c."
        )
    return None


def _disagreement_in(loop: Loop, cycle: Names, arcs: Sequence[Arcs]) -> str | None:
    """Two groups that hear nobody outside, if the region lets them start with different values."""
    starts = loop.starts
    if len(closed_groups(loop, arcs)) < 2:
        return None
    wide = [lo < hi for lo, hi in starts.exact] if starts is not None else [True]
    if not any(wide):
        return None
    # What agents do by themselves may bring them together.
    if loop.slopes and (not all(wide) or decide_hurwitz(loop.slopes).is_proved):
        return None
    return f"Agreement fails: {_when(loop, cycle)}{apart_in_words(loop, arcs)}"


def _unreached_words(loop: Loop, cycle: Names, arcs: Sequence[Arcs], apart: Sequence[int]) -> str:
    """That no pinned agent reaches the agents ``apart`` by these arcs, those of a cycle of modes or
    of all modes."""
    who = name_agents(tuple(loop.labels[i] for i in apart))
    if loop.gap:
        text = f"Containment fails: {_when(loop, cycle)}no path of arcs leads from a fixed node to"
        return f"{text} {who}. {cure_in_words(loop, arcs)}"
    if loop.signed:
        why = resting_words([loop.labels[i] for i in apart])
        return f"Consensus fails: {_when(loop, cycle)}{why}. {cure_in_words(loop, arcs)}"
    if not loop.is_pulled:
        text = f"The target is not reached: no agent is pinned, so nothing pulls {who} to it."
        sentences = (text, agreement_words(loop), cure_in_words(loop, arcs))
        return " ".join(filter(None, sentences))
    them = "it" if len(apart) == 1 else "them"
    sure = " by arcs that are always there" if any(each.optional for each in arcs) else ""
    pins = f"no pinned agent reaches {who}{sure}"
    if len(cycle) in (0, len(loop.modes)):
        pins += f", in any mode, so nothing pulls {them}"
    else:
        pins = f"{_while_on(loop, cycle)}, {pins}, so nothing pulls {them}"
    return f"Consensus fails: {pins} to the target. {cure_in_words(loop, arcs)}"


def _when(loop: Loop, cycle: Names) -> str:
    """When these modes are on, if they are not all."""
    return f"{_while_on(loop, cycle)}, " if 0 < len(cycle) < len(loop.modes) else ""


def _while_on(loop: Loop, cycle: Names) -> str:
    """When only these modes are on."""
    if loop.guarantee.generator is not None:
        on = f"mode {cycle[0]}" if len(cycle) == 1 else f"modes {', '.join(cycle)}"
        return f"once the Markov signal is in {on}, which it never leaves"
    turns = f"mode {cycle[0]} stays"
    if len(cycle) > 1:
        turns = f"modes {' and '.join(cycle)} are"
    return f"while {turns} on, as the guarantee allows"


def _hidden_reason(loop: Loop) -> str | None:
    """States that differ for ever although outputs are the same: no W and no gains tell them
    apart."""
    starts = loop.starts
    if starts is not None:
        wide = all(lo < hi for lo, hi in starts.exact)
        if not wide or not starts.disturbance:
            return None
    # Within a bound for what acts for ever they may end all the same; one agent agrees with itself.
    if stated_in(loop).absolute or (loop.agrees and loop.n == 1):
        return None
    m = loop.m
    for group in loop.sensed:
        pair = group.exosystem
        if too_large(pair) is not None or decide_detectable(pair.A, pair.C).is_proved:
            continue
        # What never moves a state is hidden in the exosystem alone.
        A = tuple(row[m:] for row in pair.A[m:])
        felt = tuple(row[m:] for row in pair.A[:m])
        if decide_detectable(A, felt).is_proved:
            return (
                f"Consensus fails: two starts of agent {group.name} give the same y = H x and "
                "states that differ for ever, whatever W and the gains are. Measure more: see "
                "detectability."
            )
    return None


def _adrift_reason(loop: Loop) -> str | None:
    """Agents that no pin reaches, in any mode, have e' = A e if they start alike."""
    # A common error obeys e' = A e only where the dynamics of an agent are linear.
    A = loop.slopes
    # Agents that agree may move on together.
    if not A or loop.agrees or loop.drift_place is not None or not _target_is_interior(loop):
        return None
    arcs = [each.present for each in loop.modes.values()]
    pinned = set(loop.pins.nodes)
    alone = [group for group in closed_groups(loop, arcs) if not pinned & set(group)]
    if not alone or decide_hurwitz(A).verdict is not Verdict.REFUTED:
        return None
    who = name_agents([loop.labels[i] for i in alone[0]])
    text = (
        f"Consensus fails: no pinned agent reaches {who}, in any mode, and a common error "
        "there does not decay:"
    )
    return f"{text} A is not Hurwitz. {cure_in_words(loop, arcs)}"


def _start_apart(loop: Loop, group: Sequence[int], free: Sequence[Vector]) -> Vector | None:
    """A c != 0 for which the region allows e_S = c and no gain of the group acts on c; None if
    there is none."""
    if loop.starts is None:
        return free[0]
    box = _room(loop, group)
    # With different offsets a common error may not exist at all.
    if any(lo > hi for lo, hi in box):
        return None
    box = [
        (lo - last, hi - first)
        for (lo, hi), (first, last) in zip(box, loop.goals.starts, strict=True)
    ]
    return find_in_nullspace(tuple(row for i in group for row in loop.pulls.gains.get(i, ())), box)


def _target_is_interior(loop: Loop) -> bool:
    """Whether all agents may start beside their goals, in every direction; with a leader, for one
    of its starts."""
    # no room is asked for without a region
    rooms = zip(_room(loop, range(loop.n)), loop.goals.starts, strict=False)
    if loop.agrees:  # anywhere
        return all(lo < hi for (lo, hi), _ in rooms)
    return all(lo < hi and lo < last and first < hi for (lo, hi), (first, last) in rooms)


def _room(loop: Loop, group: Sequence[int]) -> list[tuple[Fraction, Fraction]]:
    """By component, where x_i - goal_i may start for all agents of a group alike."""
    pairs = loop.starts.exact if loop.starts is not None else ()
    goals = {loop.goals.of(agent) for agent in group} if loop.goals.offsets else {loop.goals.target}
    return [
        (max(lo - goal[c] for goal in goals), min(hi - goal[c] for goal in goals))
        for c, (lo, hi) in enumerate(pairs)
    ]


def _local_words(check: Check) -> str:
    return " The proof is local: it states no radius." if check.domain == NEAR_TARGET else ""


def _arrival(
    loop: Loop, check: Check, *, pace: Check, final: Check | None = None, late: str = ""
) -> str:
    """Who arrives where, from which starts and how fast, without a full stop.  ``pace``: the check
    whose rate counts; ``final``: a proved ``accuracy``; ``late``: what is said of readings."""
    switching = f" {signals_in_words(loop, check)}".rstrip()
    shown = check if final is None else final
    elsewhere = " in the region"
    if loop.starts is None:
        elsewhere = f" with {_domain_in_words(shown, loop.unit)}"
    which = {"global": "", "consensus": " close enough to it"}.get(str(shown.domain), elsewhere)
    if final is not None:
        goal = "the target" if not loop.goals.moves else "the leader"
        goal += " plus their offset" if loop.goals.offsets else ""
        goal += ", in every component," if loop.m > 1 else ""
        # The largest final bound, rounded up.
        bounds: list[Fraction] = []
        for each in (final.exact or {}).get("bounds", {}).values():
            bounds += map(read_rational, each if isinstance(each, list) else [each])
        within = f"{float(rounded_up(max(bounds), digits=4)):.6g} {loop.unit}".rstrip()
        return f"All agents end within {within} of {goal} from every start{which}{switching}"
    arrive = "reach the target" if not loop.goals.moves else "follow the leader"
    if loop.gap:
        arrive = f"end between the fixed nodes {some(loop.fixed, SHOWN)}"
    starts = f"{which}{switching}{late}"
    return f"All agents {arrive} from every start{starts}{_pace_in_words(loop, pace)}"


def _pace_in_words(loop: Loop, check: Check) -> str:
    """The rate with its factor, and what they say together."""
    if not check.rate:
        return ""
    pace = f", at a rate of at least {text_below(check.rate)} 1/s"
    if check.factor is None:
        return pace
    factor = significant_away_from_zero(check.factor)
    time = significant_away_from_zero(check.time_to_one_percent, 3)
    beside = ", up to what the estimation error adds" if loop.groups else ""
    return (
        f"{pace} with a factor of {factor}: {check.norm} falls to one percent within {time} "
        f"s{beside}"
    )


def _reached(loop: Loop, checks: Checks) -> Reason | None:
    """How far the regional proofs reach, and what would help; None if none was tried or applies."""
    # Those that are not about such a problem at all would only distract.
    tried = [check for check in checks if check.kind.role == "region" and check.applies]
    proved = [check for check in tried if check.is_proved]
    if not tried:
        return None
    if tried[0].verdict is Verdict.REFUTED and not proved:
        signals = " Consensus may still hold for some signals." if loop.switches else ""
        advice = "more pinned agents"
        if loop.switches and not loop.guarantee.is_given:
            advice += ', or a guarantee on the signal in [switching] (such as "dwell")'
        return open_reason(f"{tried[0].reason}{signals}", f"{advice}.")
    near = proved or any(check.kind.is_consensus and check.is_proved for check in checks)
    smaller = "more pinned agents, larger gains"
    if near:
        smaller = "a smaller [region], larger gains or more pinned agents"
    if loop.is_sampled:  # larger gains overshoot sooner
        smaller = CURES[READINGS]
    advice = f"{smaller}. {ALONE}"
    if not proved:
        head = f"no proof reaches the region asked for: {tried[0].reason}"
        return open_reason(head, advice)
    reach = ", ".join(_domain_in_words(check, loop.unit) for check in proved)
    if loop.agrees:  # starts apart, not starts
        loop = rows_of(loop, None) or loop
    radius = asked_radius(loop)
    asked = f"|e_i| <= {float(min(max(radius), MOST)):.6g} {loop.unit}".rstrip()
    asked += " for every agent"
    if loop.starts is not None and loop.starts.disturbance:
        asked += f" and |eps_i| <= {float(min(loop.starts.disturbance, MOST)):.6g}"
    if any(isinstance(check.domain, Ball) for check in proved):
        asked += f"; a ball that holds these needs |e| <= {asked_ball(loop, radius):.6g}"
    head = f"consensus is proved from {reach}; the region asks for {asked}."
    return open_reason(head, advice)


def _domain_in_words(check: Check, unit: str) -> str:
    if not isinstance(check.domain, Around):
        return f"every start ({check.id})"
    told = f"<= {check.domain.radius} {unit}".rstrip()
    if isinstance(check.domain, Ball):
        told = f"the ball |e| {told} of all errors together"
    else:
        told = f"|e_i| {told} for every agent"
    if check.domain.disturbance:
        told += f" and |eps_i| <= {check.domain.disturbance}"
    return f"{told} ({check.id})"


def _cut_reason(checks: Checks, unit: str) -> Reason | None:
    """What was not decided, because time or work ran out, where that might have decided; None if
    nothing.  ``unit``: of the states."""
    cut = [
        check
        for check in checks
        if check.cut and (check.kind.is_consensus or check.kind.role == "safety")
    ]
    if not cut:
        return None
    # Lemma 1 stands there once for every mode.
    names = list(dict.fromkeys(check.id for check in cut))
    listed = names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
    seconds = time_limit()
    if seconds is not None and out_of_time() is not None:
        limit = f"The time limit of {seconds:g} s ended before {listed} could be decided"
        told = f"time ran out. {limit}; with more time more may be proved."
    else:
        told = (
            f"work ran out. {listed} would take too long for a problem of this "
            "size, so that nothing is"
        )
        told += " known of what would be proved. Fewer agents, states, modes or phases would help."
        told += (
            " `dobc certify --all` searches longer." if any(check.longer for check in cut) else ""
        )
    regions = [check for check in checks if check.kind.role == "region" and check.is_proved]
    reach = [_domain_in_words(check, unit) for check in regions]
    if reach:
        told = f"{told} So far consensus is proved from {', '.join(reach)}."
    return open_reason(told)


def _undecided_reason(loop: Loop, checks: Checks) -> Reason:
    """Why nothing is decided: what ran out, an agent out of reach, how far proofs reach, or the
    first condition that is not met."""
    # Nothing else may be blamed while some check had no time.
    cut = _cut_reason(checks, loop.unit)
    if cut is not None:
        return cut
    proved = [check for check in checks if check.is_proved]
    somewhere = any(check.kind.role == "region" for check in proved)
    if loop.switches and not somewhere:
        for check in checks:
            # In one of several modes no pinned agent reaches some agent.
            if check.id == REACHABILITY and check.verdict is Verdict.REFUTED:
                rest = "Consensus may still hold for signals that leave that mode often enough."
                if loop.modes[str(check.mode)].optional:
                    rest = HELD_ALWAYS
                text = f"in mode {check.mode} {check.reason}"
                return open_reason(f"{text} {rest}")
    reached = None if loop.starts is None else _reached(loop, checks)
    if reached is not None:
        return reached
    # Lemma 1 says nothing about the disturbance.
    local = [
        check
        for check in proved
        if check.kind.is_consensus and not (loop.groups and check.kind.is_lemma)
    ]
    if loop.starts is not None and any(check.domain == NEAR_TARGET for check in local):
        near = "consensus is proved near the target only, and the region asked for is larger."
        return open_reason(f"{near} {ALONE}")
    ids = ("lure", *SPEAKING) if loop.slopes_move else SPEAKING
    if loop.agrees:  # linear agents with dynamics: the theorem that is for them
        ids = ("theorem1-weighted", *SPEAKING)
    if loop.timing is not None:
        ids = (READINGS, *SPEAKING)
    unproved = [check for check in checks if not check.is_proved]
    speaking = [check for check in unproved if check.id in ids]
    first = min(speaking, key=lambda check: ids.index(check.id), default=None)
    if first is None:
        return open_reason("no condition that applies covers what is asked.")
    return open_reason(first.reason)
