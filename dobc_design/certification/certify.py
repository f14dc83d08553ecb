"""From a problem to a certificate, and back to the claims in it: the order of the topics.

certify: network and Lemma 1, the observer, the theorem; then cures, the stages of the region
cheapest first, a settling time, another equilibrium.  Every stage proposes in floating point and
decides exactly.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import partial
from itertools import zip_longest

from dobc_design import __version__
from dobc_design._checks import noun
from dobc_design._show.progress import Reports, report_to, shows_progress
from dobc_design._show.text import capitalize_first
from dobc_design.certificate.certificate import Certificate
from dobc_design.certificate.claims import Claims, Overall
from dobc_design.certificate.factors import with_factors
from dobc_design.certificate.text import writable
from dobc_design.conditions.accuracy.stage import accuracy_stage, propose_peaks
from dobc_design.conditions.accuracy.value import (
    Agreed,
    above,
    interval_of,
    shifts_of,
    weights_of,
)
from dobc_design.conditions.arcs.stage import arcs_stage
from dobc_design.conditions.case import Case
from dobc_design.conditions.check import Check, Checks, cut_check, surviving, undecided_check
from dobc_design.conditions.consensus import decide as consensus
from dobc_design.conditions.consensus import propose as estimates
from dobc_design.conditions.consensus.claim import Pair, Statements, state_theorems
from dobc_design.conditions.consensus.decide import Proposal
from dobc_design.conditions.consensus.network import reachability_check
from dobc_design.conditions.consensus.propose import Top, decay_rate
from dobc_design.conditions.coverage import NEAR, Asked, Progress, covering, read_region
from dobc_design.conditions.domain import EVERYWHERE, Domain
from dobc_design.conditions.graphs.stage import markov_stage, safety_stage
from dobc_design.conditions.kinds import LEMMA, ids_in
from dobc_design.conditions.linearisation.stage import linearisation_stage
from dobc_design.conditions.margins.stage import inputs_stage, is_asked, margins_stage
from dobc_design.conditions.numbers import claimed, is_writable
from dobc_design.conditions.observer.decide import (
    detectability_check,
    hurwitz_check,
    observability_check,
    of_outputs,
    too_large,
)
from dobc_design.conditions.observer.propose import (
    GainDesign,
    chosen_gains,
    decay_of_error,
    design_gains,
    propose_pairs,
    with_observer,
)
from dobc_design.conditions.quadratic.stage import SMALL_ROWS, quadratic_stage
from dobc_design.conditions.schedule.propose import Asked as SettlingStarts
from dobc_design.conditions.schedule.stage import (
    read_tolerance,
    schedule_stage,
    settling_stage,
    starts_given,
)
from dobc_design.conditions.separable.claim import Separable
from dobc_design.conditions.separable.stage import readings_stage, separable_stage
from dobc_design.conditions.stated import ACCURACY, LIMIT, TOLERANCE, stated_in
from dobc_design.conditions.weighted.checks import weighing
from dobc_design.conditions.weighted.stage import weighted_stage
from dobc_design.errors import DobcError
from dobc_design.exact.matrix import Matrix, multiply, to_float
from dobc_design.exact.number import Number, number_text, typed_number
from dobc_design.exact.reading import Texts, counted, positive_number
from dobc_design.exact.work import WorkLimitError, out_of_time, read_time_limit, until
from dobc_design.loop.loop import Loop
from dobc_design.loop.make import loop_of
from dobc_design.loop.pairs import are_pairs
from dobc_design.loop.timing import Timing
from dobc_design.loop.words import Said, said_of
from dobc_design.problem.canonical import problem_sha256
from dobc_design.problem.exosystems import Exosystem, block_diagonal
from dobc_design.problem.groups import Group, join, name_some
from dobc_design.problem.load import Source, load_problem
from dobc_design.problem.problem import Problem
from dobc_design.problem.signs import signs_words
from dobc_design.verdict import Verdict

from .cures import Decided, with_arcs, with_cures
from .overall import decide_overall, refutation
from .recheck import Recheck, agreed, verify_twice

OBSTACLES = ("detectability", "hurwitz")  # refuted, they rule out every pair
MOST_SEARCHED = 200  # modes in which directions of few agents are looked for
DOUBT = 1e-9  # an estimate of lambda_max above minus this calls for a witness
Stage = Callable[[Asked, Progress], list[Check]]
#: What looks for a region, cheapest first; how such checks are confirmed: certificate/topics.py.
STAGES: tuple[Stage, ...] = (
    separable_stage,
    arcs_stage,
    quadratic_stage,
    schedule_stage,
    markov_stage,
)
#: Of these where fixed nodes differ or move; the others are about errors from one target.
OF_GAPS = (separable_stage, schedule_stage)
#: Of these where there are too many pairs for rows.
BY_GRAPHS = STAGES[-2:]


@shows_progress
def certify(
    problem: Source,
    *,
    everything: bool = False,
    settling: Number | None = None,
    settling_radius: Number | None = None,
    settling_disturbance: Number | None = None,
    rate: Number | None = None,
    time_limit: Number | None = None,
    progress: Reports[str] = None,
) -> Certificate:
    """Run every condition that applies and decide each exactly.

    ``problem`` is a Problem, a path or a built-in name.  The region asked for is examined cheapest
    first, until a proof covers it; ``everything``: all of it, also where no region is asked for.
    ``settling``: a tolerance in the unit of x; the time after which |e(t)|_inf stays below it is
    proved as well (with ``everything`` and a region a hundredth of its radius by default), from the
    [region], or from |e(0)|_inf <= ``settling_radius`` and, with an exosystem, |eps_i(0)| <=
    ``settling_disturbance``.  The proved time and a bound on the way: ``Certificate.settling``.
    ``time_limit`` (s): stages that would begin later are left out, and long ones cut off; without
    one every stage has a limit that is counted, so that the same input gives the same claims.
    ``rate`` (1/s): proofs with at least this rate are looked for; without it those with the least
    time to one percent. ``progress``: True for a bar, or a function of the name of each stage.
    Returns: a Certificate; its verdict is PROVED, REFUTED or UNDECIDED.
    Raises: SpecError for a wrong problem.  A numerical library that breaks down costs at most a
    shorter proof.
    Source: Lemma 1, Theorems 1 and 2; theory, sections 1 to 5.
    Example:
        >>> certificate = dd.certify("clock-sync")
        >>> certificate.verdict.value, certificate.covered_by
        ('proved', 'theorem1-weighted')
    """
    stated = with_observer(load_problem(problem))
    if settling is not None:
        stated.require("a settling time")
    loop = loop_of(stated)
    options = _Options(
        everything=everything,
        settling=None if settling is None else read_tolerance(settling),
        settling_starts=starts_given(
            loop, tolerance=settling, radius=settling_radius, disturbance=settling_disturbance
        ),
        rate=None if rate is None else positive_number(rate, "rate", "1/s"),
        time_limit=None if time_limit is None else read_time_limit(time_limit),
    )
    seconds = None if options.time_limit is None else float(options.time_limit)
    with until(seconds):
        return _Certification(
            problem=stated, loop=loop, options=options, report=report_to(progress)
        ).run()


@noun
class _Options:
    """What ``certify`` was asked beside the problem; numbers as they were given.
    ``settling_starts``: None unless the settling time is about other starts than the region."""

    everything: bool
    settling: Fraction | None
    settling_starts: SettlingStarts | None
    rate: Fraction | None
    time_limit: Fraction | None

    @property
    def least_rate(self) -> float:
        """The rate (1/s) that proofs have to have; 0 where none is asked for."""
        return float(self.rate or 0)

    @property
    def as_typed(self) -> Texts:
        """The options of `dobc certify` that ask the same."""
        typed = ["--all"] if self.everything else []
        if self.settling is not None:
            typed.append(f"--settling {number_text(self.settling)}")
        if self.settling_starts is not None:
            starts = self.settling_starts
            typed.append(f"--settling-radius {number_text(starts.radius)}")
            typed.append(f"--settling-disturbance {number_text(starts.disturbance)}")
        if self.rate is not None:
            typed.append(f"--rate {typed_number(self.rate)}")
        if self.time_limit is not None:
            typed.append(f"--time-limit {number_text(self.time_limit)}")
        return tuple(typed)


@noun
class _Certification:
    """One run of ``certify``: the problem, its loop, and what was asked."""

    problem: Problem
    loop: Loop
    options: _Options
    report: Progress

    def run(self) -> Certificate:
        """All checks in their order, what follows from them, and what the second checker says."""
        loop = self.loop
        found = decide(loop, self.report, rate=self.options.least_rate)
        case = self._with_stages(found)
        said = said_of(loop)
        written = tuple(_written(check, case.domain, said) for check in case.checks)
        checks = with_factors(replace(case, checks=written))
        overall = decide_overall(loop, checks, found.W)
        # With several groups one designed block is enough.
        source = None
        if found.W is not None:
            source = "designed" if any(found.designs) else "given"
        notes = [
            *notes_of(self.problem, found.designs, found.how),
            *_asked_rate(loop, checks, overall, self.options.rate),
        ]
        claims = Claims(
            problem_name=loop.name,
            problem_sha256=problem_sha256(self.problem),
            verdict=overall.verdict,
            why=overall.why,
            rate=overall.rate,
            factor=overall.factor,
            covered_by=overall.covered_by,
            checks=checks,
            W=found.W,
            gain_source=source,
            P=None if found.pair is None else found.pair.P,
            Q=None if found.pair is None else found.pair.Q,
            notes=tuple(notes),
            version=__version__,
            options=self.options.as_typed,
            value=_value(loop, found.W) if overall.verdict is Verdict.PROVED else None,
        )
        # Last of all, because it reads the certificate as it will be written.
        self.report("asking the second checker")
        return Certificate(problem=self.problem, claims=agreed(claims, self.problem))

    def _with_stages(self, found: Decided) -> Case:
        """The checks that are ``found``, with cures, and those of every later stage in turn."""
        loop, report = self.loop, self.report
        everything, tolerance = self.options.everything, self.options.settling
        # In this order, because each stage may rest on what those before it have proved.
        agents = Case(
            loop=loop,
            W=found.W,
            domain=found.statements.domain,
            checks=self._with_cures_and_regions(found),
        )
        case = agents.of_rows
        if case is None:
            return agents
        loop = case.loop
        asked = read_region(loop, case.W, domain=case.domain, everything=everything)
        if loop.is_sampled and loop.saturates:
            case = case.and_(inputs_stage(asked, case.checks, report))
        if loop.is_sampled:  # what rests in the flow rests at the ticks
            case = case.and_(other_equilibria(self.problem, case, report=report))
        if loop.goal == "roots" or loop.is_sampled:
            return replace(agents, checks=case.checks)
        # All but weights that move, and boxes, are about one target.
        if not loop.gap:
            case = case.and_(safety_stage(asked, report))
        if tolerance is not None or (everything and loop.starts is not None):
            starts = self.options.settling_starts
            settled = settling_stage(case, tolerance=tolerance, starts=starts, report=report)
            case = case.and_([settled])
        if loop.gap:
            return replace(agents, checks=case.checks)
        # Inputs may rest on the final box, so they come after it.
        case = case.and_(_ending(ACCURACY, case, partial(accuracy_stage, case, report)))
        if agents.loop.agrees:  # on inputs, which are those of agents
            asked = replace(asked, loop=agents.loop, W=agents.W)
        inputs = partial(inputs_stage, asked, case.checks, report)
        case = case.and_(_ending(LIMIT, case, inputs))
        case = case.and_(other_equilibria(self.problem, case, report=report))
        return replace(agents, checks=case.checks)

    def _with_cures_and_regions(self, found: Decided) -> tuple[Check, ...]:
        """Cures of what failed, then the region; under a guarantee the region first, because it may
        need no cure of single modes."""
        loop, checks = self.loop, found.checks
        regions = partial(
            region_checks,
            everything=self.options.everything,
            report=self.report,
            rate=self.options.least_rate,
        )
        agents = Case(loop=loop, W=found.W, domain=found.statements.domain, checks=checks)
        case = agents.of_rows
        if case is None:
            return checks
        first = loop.guarantee.is_given
        own = tuple(regions(case)) if first else ()
        # Cures name gains of integrators, and take the time of further decisions.
        known = not (loop.agrees or loop.gap or self.problem.signs)
        curable = known and loop.drift is None and out_of_time() is None
        if curable and not covering(loop, own):
            checks = with_cures(self.problem, found, progress=self.report, decide=_decide_quietly)
        if loop.agrees and not covering(case.loop, own):
            checks = with_arcs(self.problem, checks)
        if first:
            return checks + own
        return checks + tuple(regions(replace(case, checks=checks)))


def _value(loop: Loop, W: Matrix | None) -> Agreed | None:
    """What is known of the value on which agents agree, where they do; None if nothing."""
    peaks, ends = None, None
    if loop.timing is not None:  # sums over ticks are no integrals of the estimation error
        return None
    weights = weights_of(loop)
    with surviving("the value agreed upon"):
        if loop.agrees and loop.starts is not None and loop.starts.disturbance and W is not None:
            peaks = propose_peaks(loop, W)
        ends = interval_of(loop, peaks)
    if weights is None and ends is None:
        return None
    found = Agreed(weights=weights, shifts=shifts_of(loop, W) if weights else ())
    if ends is None:
        return found
    low = tuple(0.0 - above(-lo) for lo, _ in ends)  # 0.0, not -0.0
    return replace(found, lo=low, hi=tuple(above(hi) for _, hi in ends), peaks=peaks)


def _written(check: Check, domain: Domain, said: Said) -> Check:
    """A check as a certificate has it, in the words of its problem."""
    found = writable(check, domain)
    return replace(found, reason=said(found.reason))


def _decide_quietly(problem: Problem) -> Decided:
    """What is decided of a cured problem."""
    return decide(loop_of(problem), lambda stage: None)


def _asked_rate(
    loop: Loop, checks: Checks, overall: Overall, wanted: Fraction | None
) -> Iterator[str]:
    """What became of a rate that was asked for, where the verdict does not have it."""
    if wanted is None or claimed(overall.rate or 0.0) >= wanted:
        return
    asked = f"A rate of at least {float(wanted):.6g} 1/s was asked for"
    for check in covering(loop, checks):
        if check.rate is not None and claimed(check.rate) >= wanted:
            yield f"{asked}: {check.title} proves it. The verdict rests on another condition."
            return
    yield f"{asked} and is not proved. `dobc design FILE --rate` looks for gains that have it."


def verify(certificate: Certificate | Claims | bytes, problem: Source) -> Recheck:
    """Check every claim of a certificate exactly, against the problem, which is trusted and never
    taken from it.

    Two programs written apart decide, the package's own exact arithmetic and ``checker/``.
    Returns: a Recheck; ``holds`` is True iff both find that every claim holds and the verdict
    follows from them.
    Raises: CertificateError if the certificate cannot be read.
    Example:
        >>> dd.verify(dd.certify("clock-sync"), "clock-sync").holds
        True
    """
    claims = certificate.claims if isinstance(certificate, Certificate) else certificate
    return verify_twice(claims, with_observer(load_problem(problem)))


def region_checks(case: Case, *, everything: bool, report: Progress, rate: float) -> list[Check]:
    """Examine the region, or with ``everything`` the largest box where none is asked for.

    Nothing is examined where the checks of the case cover the region already, unless ``everything``
    is wanted.  Of linear couplings the same holds from every start, which may decide a question
    without a region.  Last, what errors of weights and gains it leaves room for.
    """
    loop = case.loop
    asked = read_region(loop, case.W, domain=case.domain, everything=everything, rate=rate)
    if loop.is_sampled:
        return _as_stated(asked, report)
    late = _as_stated(asked, report)
    known = bool(covering(loop, case.checks))
    if loop.starts is None and not known:
        # No check at one point speaks of all close starts, where the slopes of f move.
        if loop.slopes_move:
            return late + _near_a_moving_target(asked, report)
        known = refutation(loop, case.checks, case.W) is not None
        several = loop.switches or loop.drift is not None or loop.gap > 0 or loop.is_apart
        if several and not (known or everything or case.domain == EVERYWHERE):
            return late + _near_the_target(asked, report)
        known = known or case.domain != EVERYWHERE
    stages = OF_GAPS if loop.gap else STAGES
    if known and not everything:
        # What the tables of the file ask may still rest on the box that the first stage finds.
        stages = STAGES[:1] if is_asked(asked) or (loop.starts and are_pairs(loop)) else ()
    if loop.goal == "roots":
        stages = () if known else BY_GRAPHS
    found = _in_turn(asked, stages, report)
    if loop.gap or loop.goal == "roots":
        return late + found
    return late + found + _ending(TOLERANCE, case, partial(margins_stage, asked, found, report))


def _as_stated(asked: Asked, report: Progress) -> list[Check]:
    """With the readings and the processor of the file; where no region is asked for, of a small
    box; weights that move follow where constant ones do not do."""
    if asked.loop.starts is None and not asked.everything and asked.domain != EVERYWHERE:
        asked = replace(asked, radius=NEAR, disturbance=0.0 if asked.W is None else NEAR)
    loop = asked.loop
    found = readings_stage(asked, report)
    flows = loop.timing is not None and not loop.is_sampled
    if flows and not any(check.is_proved for check in found):
        found += schedule_stage(asked, report)
    return found


def _near_a_moving_target(asked: Asked, report: Progress) -> list[Check]:
    """A ball of starts close to a leader: the largest one with ``everything``, else a small one."""
    least = 0.0 if asked.W is None else NEAR
    if asked.everything:
        asked = replace(asked, disturbance=max(asked.disturbance, least))
    else:
        asked = replace(asked, radius=NEAR, ball=NEAR, disturbance=least)
    return _in_turn(asked, (arcs_stage, quadratic_stage), report)


def _near_the_target(asked: Asked, report: Progress) -> list[Check]:
    """A small box of starts, which answers the local question for several modes, or for agents with
    dynamics, where no check at the target itself does."""
    asked = replace(asked, radius=NEAR, disturbance=0.0 if asked.W is None else NEAR)
    if asked.loop.goal == "roots":
        return _in_turn(asked, BY_GRAPHS, report)
    found = separable_stage(asked, report)
    if not covering(asked.loop, found):
        if asked.loop.timing is None:
            found += schedule_stage(asked, report)
        if not asked.loop.gap:
            found += markov_stage(asked, report)
    if stated_in(asked.loop).relative:
        found += margins_stage(asked, found, report)
    return found


def _in_turn(asked: Asked, stages: Sequence[Stage], report: Progress) -> list[Check]:
    """What these stages find, until a proof covers what is asked, or all with ``everything``."""
    loop = asked.loop
    found: list[Check] = []
    for stage in stages:
        if stage is schedule_stage and loop.timing is not None:
            continue
        found += stage(asked, report)
        proofs = covering(loop, found)
        # Boxes in coordinates T x are found fast, but few decay as fast as a ball of a small
        # problem.
        small = stage in (separable_stage, arcs_stage) and loop.size <= SMALL_ROWS
        claims = [check.claim for check in proofs]
        slow = small and all(isinstance(each, Separable) and each.T for each in claims)
        if not asked.everything and proofs and not slow:
            break
    return found


def _ending(id: str, case: Case, stage: Callable[[], list[Check]]) -> list[Check]:
    """What a stage finds, or a check that says why it did not end."""
    try:
        return stage()
    except WorkLimitError as limit:
        return [cut_check(id, case.domain, str(limit))]


def other_equilibria(problem: Problem, case: Case, *, report: Progress) -> Iterator[Check]:
    """The check that refutes a region with a second equilibrium, where nothing is proved or refuted
    so far."""
    loop, checks = case.loop, case.checks
    # Without W there is no loop that could rest.
    has_loop = (case.W is not None or not loop.groups) and not loop.saturates
    # Agents without a target may rest anywhere.
    has_loop = has_loop and not loop.agrees
    if loop.starts is None or not has_loop or out_of_time() is not None or problem.signs:
        return
    if covering(loop, checks):
        return
    if refutation(loop, checks, case.W) is None:
        # It simulates, which nothing else here does.
        from .equilibria import equilibrium_check

        report("looking for another equilibrium")
        found = equilibrium_check(problem)
        if found is not None:
            yield found


def decide(loop: Loop, report: Progress, *, rate: float = 0.0) -> Decided:
    """Run every condition that applies; no cures.  ``rate``: as in ``certify``."""
    report("stating the theorems")
    statements = state_theorems(loop)
    # Without estimates everything is still decided, with poorer proposals.
    tops: dict[str, Top] = {}
    with surviving("eigenvalue estimate failed"):
        if loop.goal == "target":  # which Lemma 1 is about
            tops = estimates.lambda_tops(statements)
    shows = {mode: top.shows for mode, top in tops.items() if top.shows is not None}
    statements = consensus.with_vectors(statements, shows)
    run = _Run(loop=loop, statements=statements, tops=tops, found={})
    report("deciding network and Lemma 1")
    lemmas = run.lemmas()
    checks = (*(reachability_check(loop, mode) for mode in loop.modes), *lemmas)
    exosystem = loop.joint_exosystem
    if exosystem is None:
        checks += tuple(weighted_stage(weighing(statements), None, rate=rate))
        checks += tuple(linearisation_stage(loop, statements, checks, None))
        return Decided(checks=checks, statements=statements, directions=run.found)
    report("deciding the observer")
    designs = design_gains(loop)
    gains = chosen_gains(loop, designs)
    first = run.observer_checks(gains)
    report("deciding the theorem")
    theorems, pair, how = run.theorem_checks(exosystem, gains, lemmas, first)
    checks = (
        *first,
        *checks,
        *theorems,
        *weighted_stage(weighing(statements), join(gains), rate=rate),
    )
    return Decided(
        checks=(*checks, *linearisation_stage(loop, statements, checks, join(gains))),
        statements=statements,
        directions=run.found,
        designs=designs,
        W=join(gains),
        pair=pair,
        how=how,
    )


@noun
class _Run:
    """One certification: the problem, its conditions, floating-point estimates to propose from.
    ``found``: directions of few agents, filled in for the modes where Lambda < 0 looks doubtful."""

    loop: Loop
    statements: Statements
    tops: dict[str, Top]
    found: dict[str, list[Sequence[float]]]

    def lemmas(self) -> list[Check]:
        """Lemma 1, mode by mode."""
        checks = []
        for mode in self.loop.modes:
            late = out_of_time()
            if late is not None:
                checks.append(cut_check(LEMMA, self.statements.domain, late, mode=mode))
                continue
            top = self.tops.get(mode)
            # Few agents along which V grows are a witness that a reader can follow.
            known = self.loop.goal != "target" or (top is not None and top.value < -DOUBT)
            if not known:
                self.found[mode] = []
                with surviving("no small directions"):
                    if len(self.found) <= MOST_SEARCHED:
                        self.found[mode] = estimates.witness_directions(self.loop, mode)
            vectors = [*self.found.get(mode, ())]
            margin = 0.0
            if top is not None:
                vectors.append(top.vector.tolist())
                margin = -top.value
            proposal = Proposal(margin=margin, vectors=vectors)
            checks.append(consensus.lemma1_check(self.statements, mode, proposal))
        return checks

    def observer_checks(self, gains: Sequence[Matrix | None]) -> list[Check]:
        """Observability, detectability, Hurwitz, for every group of agents."""
        groups = self.loop.observers
        if self.loop.sensed:
            gains = [group.observer.W for group in groups]
        if not self.loop.is_grouped:
            found = _checks_of(groups[0], gains[0], self.loop, timing=self.loop.timing)
            return self.in_words(found, groups[0])
        lacking = next((g for g, W in zip(groups, gains, strict=True) if W is None), None)
        checks = []
        for group, W in zip(groups, gains, strict=True):
            known = None if lacking is not None else W
            own = self.in_words(_checks_of(group, known, None, timing=self.loop.timing), group)
            if W is not None and lacking is not None:  # a certificate holds all gains or none
                reason = (
                    f"it is left open, because the group of agent {lacking.name} has no gain W."
                )
                own[-1] = undecided_check("hurwitz", EVERYWHERE, reason)
            who = f"Of {name_some(group.agents)}: "
            for check in own:
                # Without its fix, which names keys that all agents share.
                named = replace(check, group=group.name, fix=None, reason=who + check.reason)
                checks.append(named)
        return checks

    def in_words(self, checks: list[Check], group: Group) -> list[Check]:
        """The checks of a group as they are said of its observer."""
        if not self.loop.sensed:
            return checks
        return [of_outputs(check, group, self.loop.m) for check in checks]

    def theorem_checks(
        self,
        exosystem: Exosystem,
        gains: Sequence[Matrix | None],
        lemmas: Checks,
        observer: Checks,
    ) -> tuple[list[Check], Pair | None, str]:
        """The printed P where there is one, then the theorem with a P of our own; how that came
        about."""
        name = "theorem2" if self.loop.switches else "theorem1"
        check = partial(consensus.theorem_check, statements=self.statements, lemmas=lemmas)
        checks = []
        own = self.loop.joint_observer
        if own.P is not None and own.W is not None:
            given = Pair(P=own.P, Q=multiply(own.P, own.W))
            tried = self.proposal(given, exosystem)
            printed = check(
                f"{name}-printed", pair=given, proposal=tried, obstacle=None, printed=True
            )
            checks.append(printed)
        failing = (each for each in observer if each.id in OBSTACLES)
        obstacle = next((each for each in failing if each.verdict is Verdict.REFUTED), None)
        # Psi < 0 needs Lambda < 0 in every mode, and a W in every group.
        known = [W for W in gains if W is not None]
        unproved = any(not lemma.is_proved for lemma in lemmas)
        blocked = obstacle is not None or unproved or len(known) < len(gains)
        large = next(filter(None, (too_large(group.exosystem) for group in self.loop.groups)), None)
        # Time is asked for where a search would begin, and nowhere else.
        late = large
        if late is None and not blocked:
            late = out_of_time()
        pair: Pair | None = None
        how = ""
        if not blocked and late is None:
            pair, how = self.find_pair(exosystem, known)
        proposal = Proposal() if pair is None else self.proposal(pair, exosystem)
        theorem = check(name, pair=pair, proposal=proposal, obstacle=obstacle)
        if pair is None and theorem.verdict is Verdict.UNDECIDED:
            # Time that ended is a reason only where the search had a chance to begin.
            started = not blocked or any(lemma.cut for lemma in lemmas)
            why = late or (out_of_time() if started else None)
            if why is not None:
                theorem = replace(theorem, reason=why, cut=large is None)
        return [*checks, theorem], pair, how

    def find_pair(self, exosystem: Exosystem, gains: Sequence[Matrix]) -> tuple[Pair | None, str]:
        """The first proposed pair for which Psi < 0 is proved, and a sentence if it did not come
        the usual way."""
        bound = max((top.value for top in self.tops.values()), default=math.nan)
        for P, Q, how in _proposed_pairs(self.loop.groups, gains, bound=bound):
            pair = Pair(P=P, Q=Q)
            S = consensus.schur_block(pair, exosystem)
            # What no certificate can hold is no proof for anybody else.
            written = S is not None and is_writable(P, Q, S)
            if written and consensus.psi_is_negative(self.statements, exosystem, pair):
                return pair, how
            if out_of_time() is not None:
                break
        return None, ""

    def proposal(self, pair: Pair, exosystem: Exosystem) -> Proposal:
        """Margin, rate and directions to try for a pair."""
        if not self.tops:
            return Proposal()
        try:
            P, Q = to_float(pair.P), to_float(pair.Q)
        except DobcError:  # entries too large for floats: the exact side does without
            return Proposal()
        slowest_first = sorted(self.tops.values(), key=lambda top: -top.value)
        return Proposal(
            margin=estimates.pair_margin(self.tops, P, Q, exosystem),
            rate=estimates.pair_rate(self.tops, P, Q, exosystem),
            vectors=[top.vector.tolist() for top in slowest_first],
        )


def _checks_of(
    group: Group, W: Matrix | None, loop: Loop | None, *, timing: Timing | None
) -> list[Check]:
    """The checks of one exosystem and its gain; ``loop`` where cures may change the keys of its
    problem."""
    exosystem = group.exosystem
    reason = too_large(exosystem)
    if reason is not None:
        return [undecided_check(id, EVERYWHERE, reason) for id in ids_in("observer")]
    source = "given" if group.observer.W is not None else "designed"
    estimate = 0.0 if W is None else decay_of_error(exosystem, W, timing)
    key = "W of the group" if loop is None else "observer.W"
    return [
        observability_check(exosystem, loop),
        detectability_check(exosystem, loop, timing),
        hurwitz_check(
            exosystem, W, estimate=estimate, source=source, loop=loop, key=key, timing=timing
        ),
    ]


def _proposed_pairs(
    groups: Sequence[Group], gains: Sequence[Matrix], *, bound: float
) -> Iterator[tuple[Matrix, Matrix, str]]:
    """Pairs in turn, block diagonal; the last of a group, which must do, stands in when its others
    are used up."""
    # What one group needs says nothing of the others: each has proposals of its own.
    each = []
    for group, W in zip(groups, gains, strict=True):
        decay = decay_rate(group.exosystem, W)
        each.append(propose_pairs(group.exosystem, W, bound=bound, decay=decay))
    last: list[tuple[Matrix, Matrix, str] | None] = [None] * len(each)
    # Each group has its own list, of its own length.
    for found in zip_longest(*each):
        last = [new or old for new, old in zip(found, last, strict=True)]
        known = [pair for pair in last if pair is not None]
        if len(known) < len(each):  # a group without any proposal
            continue
        words = dict.fromkeys(how for _, _, how in known if how)
        P = block_diagonal([P for P, _, _ in known])
        Q = block_diagonal([Q for _, Q, _ in known])
        yield P, Q, " ".join(words)


def notes_of(problem: Problem, designs: Sequence[GainDesign | None], how: str) -> Iterator[str]:
    """What was given, assumed and designed, in sentences; ``how`` the pair came about, if not the
    usual way."""
    loop = loop_of(problem)
    yield from problem.notes
    if problem.signs is not None:
        yield f"{capitalize_first(signs_words(problem.signs, problem.network.labels))}."
    yield from _observer_notes(problem, loop, designs)
    if how:
        yield how
    if loop.estimated:
        yield (
            "Outputs are measured: an error is that of the estimated state. The states follow as "
            "the estimation errors of states and disturbance decay."
        )
    if not loop.is_pulled and not loop.agrees:
        yield "No agent is pinned."
    own = loop.joint_observer
    if own.W is not None and own.rate is not None:
        yield "observer.rate is not used, because W was given."
    if loop.starts is None and not loop.is_linear:
        local = "the verdict is about the consensus itself, from close enough starts."
        yield f"No region was asked for: {local}"
    if len(loop.modes) > 1 and not loop.guarantee.phases and loop.guarantee.generator is None:
        yield "The modes may switch in any way, so one V has to serve them all."
    loose = [name for name, arcs in loop.modes.items() if arcs.optional]
    if loose:
        yield (
            f"The optional arcs of mode {', '.join(loose)} may come and go at any time, "
            "also while the mode lasts."
        )
    if loop.is_linear:
        told = "Every coupling is exactly linear: what holds near the target holds everywhere."
        yield said_of(loop)(told)
    if problem.exceptions:
        yield f"{counted(len(problem.exceptions), 'arc')} with a coupling of their own."
    if loop.goals.offsets:
        goal = "Agents go to the target plus their formation offset"
        if loop.agrees:
            goal = "Agents agree on x - offset: they keep their formation, wherever it is"
        yield f"{goal}; couplings act on x - offset."
    why = out_of_time()
    if why is not None:
        yield (
            f"What was not decided in time was {why} On another machine, or with more time, "
            "more may be proved."
        )


def _observer_notes(
    problem: Problem, loop: Loop, designs: Sequence[GainDesign | None]
) -> Iterator[str]:
    """Of the exosystem and of each gain W."""
    if not loop.groups:
        yield "No exosystem was given: there is no disturbance and no observer."
    if loop.is_grouped:
        yield (
            "Agents differ in their exosystem: W, P and Q hold one block for each group, in "
            "this order."
        )
    if problem.undisturbed:
        who = name_some(problem.undisturbed)
        has = "has" if len(problem.undisturbed) == 1 else "have"
        yield f"{capitalize_first(who)} {has} no disturbance and no observer."
    for group, design in zip(loop.groups, designs, strict=True):
        who = ""
        if loop.is_grouped:
            who = f"Group of agent {group.name} ({name_some(group.agents)}): "
        if design is None and not any(note.startswith("No W was given") for note in problem.notes):
            yield f"{who}The observer gain W was given."
        elif design is not None:
            yield f"{who}No W was given. {capitalize_first(design.note)}"
