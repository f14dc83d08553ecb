"""Observer gain, pinned agents and gains on request, each proved, and one limit of a design in
terms of another."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from typing import Literal, TypeVar

from dobc_design._show.progress import Reports, report_to, shows_progress
from dobc_design.certificate.certificate import Certificate
from dobc_design.certification.certify import certify
from dobc_design.errors import SpecError, wrong
from dobc_design.exact.number import Number
from dobc_design.exact.reading import flag, whole_number
from dobc_design.loop.make import timing_of
from dobc_design.problem.load import Source, load_problem
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

from .joint.claim import (
    AskedDesign,
    Design,
    TradeOff,
    TradePoint,
    read_design_request,
)
from .joint.search import (
    further_pins,
    no_slower,
    search_agents,
    search_design,
)
from .joint.trade_off import trade_off_of
from .observer.claim import (
    NoiseLimit,
    ObserverDesign,
    SpectralRegion,
    read_observer_request,
)
from .observer.search import search_groups
from .pinning.claim import (
    AskedGains,
    PinningDesign,
    read_request,
)
from .pinning.search import search_pinning
from .pinning.search_regions import search_region

Each = Number | Mapping[str | int, Number]  # one for all agents, or by label
Labels = Collection[str | int]
Noise = Number | NoiseLimit | Sequence[NoiseLimit]
Pins = int | Literal["fewest"] | None
Found = TypeVar("Found", Design, PinningDesign)


#: Kinds of statements that are about arbitrary switching.
OF_ALL_SIGNALS = {"structure", "pins", "rate", "max_gain"}


def _under_guarantee(problem: Problem, found: Found) -> Found:
    """Designs ignore the guarantee: what arbitrary switching forbids may do under it, so nothing is
    refuted."""
    if found.verdict is not Verdict.REFUTED or len(problem.network.modes) < 2:
        return found
    if problem.switching is None or not problem.switching.is_guaranteed:
        return found
    kinds = {each.kind for each in found.statements}
    if not kinds & OF_ALL_SIGNALS:
        return found
    # The nearest request is not offered: a weaker one may not be needed at all.
    return replace(
        found, verdict=Verdict.UNDECIDED, under_guarantee=True, statements=(), nearest=None
    )


def _given_gains(problem: Problem, report: Callable[[str], None]) -> Certificate | None:
    """The certificate of the problem's own gains, which tell a user what a design buys; None
    without gains."""
    if not problem.pinning.agents:
        return None
    report("certifying the gains of the problem")
    return certify(problem)


def _further(
    problem: Problem, found: Design, most: int, report: Callable[[str], None]
) -> tuple[TradePoint, ...]:
    """The prices of up to ``most`` further pins."""
    points = list[TradePoint]()
    for each in further_pins(problem, found, most, report):
        cost = float(each.cost or 0)
        point = TradePoint(x=each.rate or 0.0, y=cost, pinned=tuple(each.gains), proved=True)
        points.append(point)
    return tuple(points)


def _check(problem: Problem, *, coupling: bool, others: bool) -> None:
    """``coupling`` is for agents with [dynamics], ``others`` (a limit that is asked for) for those
    without."""
    problem.require("a design")
    flag(coupling, "coupling", "True asks for a coupling, too.")
    if coupling:
        problem.require("a design of couplings")
    if coupling and problem.dynamics is None:
        text = "coupling can be designed for agents with [dynamics] only."
        raise SpecError(text, key="coupling")
    if others:
        problem.require("a design with cost, region, noise or conservative, or a trade-off")


def design_observer(
    problem: Source,
    *,
    rate: Number | None = None,
    region: SpectralRegion | Sequence[SpectralRegion] | None = None,
    noise: Noise | None = None,
    digits: int = 4,
    period: Number | None = None,
) -> ObserverDesign:
    """Design the observer gain W and prove that the rounded W does what was asked.

    ``rate`` (1/s); ``region``: HalfPlane, Disk, Cone or a list; ``noise``: bound on the H-infinity
    norm from measurement noise to dhat, or NoiseLimit; ``digits`` of W; ``period`` (s) of a sampled
    observer, whose gain per sample W is; with [processor] W is the one of the file.  Where agents
    have different exosystems, the W of every group has to do it.  With [dynamics] noise and period
    are not known.
    Returns: an ObserverDesign: PROVED; REFUTED with the reason; UNDECIDED. The last two with the
    nearest request.
    Raises: SpecError for a wrong request or a problem without [exosystem].
    Example:
        >>> dd.design_observer("paper-fixed", rate=2).verdict.value
        'proved'
        >>> dd.design_observer("paper-fixed", noise="3/2").verdict.value
        'refuted'
    """
    problem = load_problem(problem)
    if not problem.groups:
        must = "exosystem must be given to design an observer"
        text = f"{must}, because it says what W estimates; got none."
        cure = "dobc_design.exosystems has common shapes, constant() among them."
        raise SpecError(text, key="exosystem", cure=cure)
    if rate is None:
        rate = problem.joint_observer.rate
    timing = timing_of(problem)
    if period is not None and timing is not None and timing.sampled:
        message = "is that of [processor] or of a step; leave it out."
        raise wrong("period", message, "Change the problem for another one.")
    request = read_observer_request(
        rate=rate, region=region, noise=noise, digits=digits, period=period
    )
    if problem.dynamics is None:
        return search_groups(problem, request)
    if request.noise or request.period:
        # With dynamics noise passes through x to dhat in another way, and a sampled C depends on A.
        problem.require("the design of an observer with noise or a period")
    return search_groups(problem, replace(request, norms=False))


@shows_progress
def design_pinning(
    problem: Source,
    *,
    rate: Number,
    allowed: Labels | None = None,
    cost: Each | None = None,
    max_gain: Each | None = None,
    pins: Pins = None,
    digits: int = 4,
    region: Number | bool | None = None,
    conservative: bool = False,
    coupling: bool = False,
    progress: Reports[str] = None,
) -> PinningDesign:
    """Design the cheapest pinning gains for a decay rate, and prove what is said of them.

    ``rate`` (1/s): near the target every error decays at it (eps = 0).  One mode: the true local
    rate, with V = e'De; several: with weights D common to all.  ``conservative``: with V = e'e,
    Lambda < -2 rate I in every mode; such gains come with a lower bound of their cost (those of one
    undirected network always do). ``region``: a radius of |e_i|, or True for the problem's
    [region]; the gains then come with a max-separable certificate that covers it, and with no lower
    bound of their cost.  ``allowed``: labels of agents that may be pinned (default all).  ``cost``:
    c_i > 0, a number or label -> number, of sum c_i k_i.  ``max_gain`` (1/s): cap of every gain,
    likewise.  ``pins``: at most so many agents, or "fewest".  ``digits`` of the gains, which are
    rounded up. ``progress``: True for a bar, or a function of what is being done.  Gains that the
    problem has are not looked at. With [dynamics] V = e'(D (x) R)e decides, gains are multiples of
    the coupling; ``coupling``: h of every arc is designed, too.  With [readings] or [processor]
    max-separable rows decide, which count them.  With any of these ``cost``, ``region`` and
    ``conservative`` are not known.  Where outputs are measured W is designed along.
    Returns: a PinningDesign: PROVED; REFUTED with the reason; UNDECIDED.  The last two with the
    nearest request.
    Raises: SpecError for a wrong request, or couplings without a derivative at the consensus.
    Source: theory, sections 4, 5 and 7.
    Example:
        >>> found = dd.design_pinning("clock-sync", rate="1/20", allowed=["gateway"])
        >>> found.verdict.value, list(found.gains)
        ('proved', ['gateway'])
    """
    problem = load_problem(problem)
    others = conservative or cost is not None or region is not None
    problem.require("a design of pins")
    _check(problem, coupling=coupling, others=others)
    asked = AskedGains(
        rate=rate,
        allowed=allowed,
        cost=cost,
        max_gain=max_gain,
        pins=pins,
        digits=digits,
        conservative=conservative,
    )
    request = read_request(problem.network.labels, asked)
    report = report_to(progress)
    # What readings allow is decided for whole designs only.
    if problem.dynamics is not None or timing_of(problem) is not None:
        found = search_agents(problem, request, report, coupling=coupling)
        return _under_guarantee(problem, found)
    if region is None:
        found = search_pinning(problem, request, report)
        return _under_guarantee(problem, found)
    problem.require("a design of gains alone for a region")
    report("looking for gains for the whole region")
    return search_region(problem, request, region)


@shows_progress
def design(
    problem: Source,
    *,
    rate: Number | None = None,
    pins: Pins = None,
    max_gain: Each | None = None,
    allowed: Labels | None = None,
    noise: Noise | None = None,
    digits: int = 3,
    reduce: bool = True,
    conservative: bool = False,
    coupling: bool = False,
    further: int = 0,
    progress: Reports[str] = None,
) -> Design:
    """Design observer gain, pinned agents and gains together, so that ``certify`` proves what the
    problem asks.

    ``rate`` (1/s): the certified rate has to be at least that; without it, that of the problem's
    own gains where they are proved and a design is found, else half of the fastest that the pins
    allow is aimed at.  Nothing else is taken from W, P and gains that the problem has.  ``pins``:
    at most so many agents, by default as few as it takes.  ``max_gain`` (1/s): cap of every gain, a
    number or label -> number.  ``allowed``: labels of agents that may be pinned.  ``noise``: bound
    on the H-infinity norm from measurement noise to dhat, or NoiseLimit. ``digits`` of W and of the
    gains: what is certified are the rounded numbers.  ``reduce``: an exosystem with a part that C
    does not see and that does not decay is replaced by its observable part.  ``conservative``:
    without a [region], gains for V = e'e in place of the true local rate.  ``coupling``: the
    coupling of agents with [dynamics] is designed, too; their gains are multiples of it.
    ``further``: up to so many pins more get a price (each a design of its own), where ``pins`` is
    not given.  ``progress``: as in ``certify``.
    Returns: a Design: PROVED, with ``problem`` and ``certificate``; REFUTED with the reason;
    UNDECIDED.  The last two with the nearest possible request.  Raises: SpecError for a wrong
    argument.
    Example:
        >>> dd.design("clock-sync", rate="1/20", allowed=["gateway"]).verdict.value
        'proved'
    """
    problem = load_problem(problem)
    others = conservative or noise is not None
    _check(problem, coupling=coupling, others=others)
    if pins is not None or max_gain is not None or allowed is not None:
        problem.require("a design of pins")
    asked = AskedDesign(
        rate=rate,
        pins=pins,
        max_gain=max_gain,
        allowed=allowed,
        noise=noise,
        digits=digits,
        reduce=reduce,
        conservative=conservative,
        coupling=coupling,
    )
    request = read_design_request(problem.network.labels, asked)
    whole_number(further, "further", least=0, most=20, cure="Three are a good choice.")
    report = report_to(progress)
    # An explicit rate overrules that of the own gains.
    given = None if request.rate is not None else _given_gains(problem, report)
    found = None if given is None else no_slower(problem, request, given, report)
    if found is None:
        found = _under_guarantee(problem, search_design(problem, request, report))
    if not found.is_proved:
        return found
    if given is None:
        given = _given_gains(problem, report)
    return replace(found, given=given, further=_further(problem, found, further, report))


@shows_progress
def trade_off(
    problem: Source,
    *,
    curve: str = "gain",
    design: Design | None = None,
    pins: Pins = None,
    max_gain: Each | None = None,
    allowed: Labels | None = None,
    points: int = 10,
    digits: int = 3,
    progress: Reports[str] = None,
) -> TradeOff:
    """One limit of a design in terms of another, as a curve.

    ``curve``: "gain", the sum of the gains of proved designs against the rate asked, with the pins
    of ``design``, or those that ``design()`` would begin with; "pins", the rate that gains approach
    over the [region], or next to the consensus, against the number of pinned agents, as floating
    point sees it; "noise", the gain from measurement noise to dhat against the decay of the
    estimate's error.  ``design``: one of this problem, whose point is marked and whose W is used.
    ``points``: how many are tried.  ``pins``, ``max_gain``, ``allowed``, ``digits`` and
    ``progress`` are as in ``design``; gains that the problem has are not looked at.
    Returns: a TradeOff with ``points``, ``plot(ax=...)`` and ``to_pandas()``.  Raises: SpecError
    for a wrong argument.
    Example:
        >>> dd.trade_off("clock-sync", pins=1, points=3).y_name
        'sum of the gains, 1/s'
    """
    problem = load_problem(problem)
    problem.require("a design of pins")
    _check(problem, coupling=False, others=True)
    asked = AskedDesign(pins=pins, max_gain=max_gain, allowed=allowed, digits=digits)
    request = read_design_request(problem.network.labels, asked)
    report = report_to(progress)
    return trade_off_of(problem, request, curve, design=design, points=points, progress=report)
