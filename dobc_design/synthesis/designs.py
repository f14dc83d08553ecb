"""Observer gain, pinned agents and gains on request, each proved, and one limit of a design in terms of another."""

from __future__ import annotations

from os import PathLike
from typing import Any

from dobc_design.conditions.coverage import Progress
from dobc_design.errors import SpecError
from dobc_design.problem.load import load_problem
from dobc_design.problem.problem import Problem
from dobc_design.synthesis.joint.claim import Design, TradeOff, read_design_request
from dobc_design.synthesis.joint.search import search_design, trade_off_of
from dobc_design.synthesis.observer.claim import ObserverDesign, read_observer_request
from dobc_design.synthesis.observer.search import search_groups
from dobc_design.synthesis.pinning.claim import PinningDesign, read_request
from dobc_design.synthesis.pinning.search import search_pinning, search_region


def design_observer(
    problem: Problem | str | PathLike[str],
    *,
    rate: Any = None,
    region: Any = None,
    noise: Any = None,
    digits: int = 4,
    period: Any = None,
) -> ObserverDesign:
    """Design the observer gain W and prove that the rounded W does what was asked.

    ``rate`` (1/s); ``region``: HalfPlane, Disk, Cone or a list; ``noise``: bound on the H-infinity norm from
    measurement noise to dhat, or NoiseLimit; ``digits`` of W; ``period`` (s) of a sampled observer.  Where agents have
    different exosystems, the W of every group has to do it.
    Returns: an ObserverDesign: PROVED; REFUTED with the reason; UNDECIDED. The last two with the nearest request.
    Raises: SpecError for a wrong request or a problem without [exosystem].
    Example:
        >>> dd.design_observer("paper-fixed", rate=2).verdict.value
        'proved'
        >>> dd.design_observer("paper-fixed", noise="3/2").verdict.value
        'refuted'
    """
    problem = load_problem(problem)
    if not problem.groups:
        text = "exosystem must be given to design an observer, because it says what W estimates; got none."
        raise SpecError(text, key="exosystem", cure="dobc_design.exosystems has common shapes, constant() among them.")
    rate = problem.joint_observer.rate if rate is None else rate
    request = read_observer_request(rate=rate, region=region, noise=noise, digits=digits, period=period)
    return search_groups(problem.groups, request)


def design_pinning(
    problem: Problem | str | PathLike[str],
    *,
    rate: Any,
    allowed: Any = None,
    cost: Any = None,
    max_gain: Any = None,
    pins: Any = None,
    digits: int = 4,
    region: Any = None,
    progress: Progress | None = None,
) -> PinningDesign:
    """Design the cheapest pinning gains for a decay rate, and prove what is said of them.

    ``rate`` (1/s): at the consensus Lambda < -2 rate I in every mode, so V = e'e of (22) with eps = 0 decays at it.
    ``region``: a radius of |e_i|, or True for the problem's [region]; the gains then come with a max-separable
    certificate that covers it, and with no lower bound of their cost.  ``allowed``: labels of agents that may be pinned
    (default all).  ``cost``: c_i > 0, a number or label -> number, of sum c_i k_i.  ``max_gain`` (1/s): cap of every
    gain, likewise.  ``pins``: at most so many agents, or "fewest".  ``digits`` of the gains, which are rounded up.
    ``progress`` is called with what is being done.  Gains that the problem has are not looked at.
    Returns: a PinningDesign: PROVED; REFUTED with the reason; UNDECIDED.  The last two with the nearest request.
    Raises: SpecError for a wrong request, or couplings without a derivative at the consensus.
    Source: theory, sections 4, 5 and 7.
    Example:
        >>> found = dd.design_pinning("clock-sync", rate="1/20", allowed=["gateway"])
        >>> found.verdict.value, list(found.gains)
        ('proved', ['gateway'])
    """
    problem = load_problem(problem)
    limits = {"allowed": allowed, "cost": cost, "max_gain": max_gain, "pins": pins, "digits": digits}
    request = read_request(problem.network.labels, rate=rate, **limits)
    progress = progress or (lambda stage: None)
    if region is None:
        return search_pinning(problem, request, progress)
    progress("looking for gains that do over the region")
    return search_region(problem, request, region)


def design(
    problem: Problem | str | PathLike[str],
    *,
    rate: Any = None,
    pins: Any = None,
    max_gain: Any = None,
    allowed: Any = None,
    noise: Any = None,
    digits: int = 3,
    reduce: bool = True,
    progress: Progress | None = None,
) -> Design:
    """Design observer gain, pinned agents and gains together, so that ``certify`` proves what the problem asks.

    W, P and gains that the problem has are not looked at.  ``rate`` (1/s): the certified rate has to be at least that;
    without it half of the fastest that the pins allow is aimed at.  ``pins``: at most so many agents, by default as few
    as it takes.  ``max_gain`` (1/s): cap of every gain, a number or label -> number.  ``allowed``: labels of agents
    that may be pinned.  ``noise``: bound on the H-infinity norm from measurement noise to dhat, or NoiseLimit.
    ``digits`` of W and of the gains: what is certified are the rounded numbers.  ``reduce``: an exosystem with a part
    that C does not see and that does not decay is replaced by its observable part.  ``progress`` is called with what
    is being done.
    Returns: a Design: PROVED, with ``problem`` and ``certificate``; REFUTED with the reason; UNDECIDED.  The last two
    with the nearest possible request.  Raises: SpecError for a wrong argument.
    """
    problem = load_problem(problem)
    limits = {"rate": rate, "pins": pins, "max_gain": max_gain, "allowed": allowed, "noise": noise}
    request = read_design_request(problem.network.labels, digits=digits, reduce=reduce, **limits)
    return search_design(problem, request, progress or (lambda stage: None))


def trade_off(
    problem: Problem | str | PathLike[str],
    *,
    curve: str = "gain",
    design: Design | None = None,
    pins: Any = None,
    max_gain: Any = None,
    allowed: Any = None,
    points: int = 10,
    digits: int = 3,
    progress: Progress | None = None,
) -> TradeOff:
    """One limit of a design in terms of another, as a curve.

    ``curve``: "gain", the sum of the gains of proved designs against the rate asked, with the pins of ``design``, or
    those that ``design()`` would begin with; "pins", the rate that gains approach over the [region], or next to the
    consensus, against the number of pinned agents, as floating point sees it; "noise", the gain from measurement noise
    to dhat against the decay of the estimate's error.  ``design``: one of this problem, whose point is marked and whose
    W is used.  ``points``: how many are tried.  ``pins``, ``max_gain``, ``allowed``, ``digits`` and ``progress`` are as
    in ``design``; gains that the problem has are not looked at.
    Returns: a TradeOff with ``points``, ``plot()`` and ``to_pandas()``.  Raises: SpecError for a wrong argument.
    """
    problem = load_problem(problem)
    request = read_design_request(problem.network.labels, pins=pins, max_gain=max_gain, allowed=allowed, digits=digits)
    return trade_off_of(
        problem, request, curve, design=design, points=points, progress=progress or (lambda stage: None)
    )
