"""From a request and a region to a PinningDesign: the smallest gains for every start of the region.

Their max-separable certificate is proved by ``conditions.separable``.
"""

from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from typing import Any

from dobc_design._checks import noun
from dobc_design.conditions.consensus.network import name_agents
from dobc_design.conditions.coverage import asked_radius
from dobc_design.conditions.numbers import claimed, shorten
from dobc_design.conditions.separable import decide as separable
from dobc_design.conditions.separable.claim import Separable, acts_by_component, stuck_agents
from dobc_design.conditions.separable.propose_observer import propose_error_bound, radius_needed
from dobc_design.conditions.statement import Statement, proved, refuted, undecided
from dobc_design.errors import refused, wrong
from dobc_design.exact.interval import UndefinedError
from dobc_design.exact.number import ONE, ZERO, number_text
from dobc_design.exact.reading import shown_number
from dobc_design.loop.make import loop_of
from dobc_design.problem.changes import changed_problem
from dobc_design.problem.problem import Problem
from dobc_design.synthesis.observer.claim import read_positive
from dobc_design.synthesis.pinning import decide

from .claim import (
    FEWEST,
    AgentSet,
    Gains,
    PinningDesign,
    PinningRequest,
    Region,
    Structure,
    holding,
    typed_gains,
    with_gains,
    without_gains,
)
from .propose import slow_directions
from .propose_regions import propose_for_box

# rates faster than asked
BOX_TILTS = (Fraction(1, 10**7), Fraction(1, 10**5), Fraction(1, 1000), Fraction(1, 50))
SLOWER = 6  # halvings of the rate that are tried for the nearest request
SMALLEST = Fraction(1, 10**9)  # radius of a box
LISTED = 50  # agents that a statement writes out
REACHES = "the max-separable certificate reaches the rate"
ONLY_BY_COMPONENT = (
    "the max-separable certificate is for couplings that act on each state component by itself."
)


@noun
class Task:
    """One request over a region, of a problem without gains."""

    bare: Problem
    request: PinningRequest
    region: Region
    structure: Structure

    def fails(self, obstacle: Statement) -> PinningDesign:
        """No gains, because of the obstacle."""
        return without_gains(self.request, self.structure, obstacle, region=self.region)


def search_region(problem: Problem, request: PinningRequest, region: Any) -> PinningDesign:
    """Decide a request over a radius, or [region] (True); with a slower one.  Raises: SpecError for
    another region."""
    if region is True:
        asked = _file_region(problem, request)
    else:
        cure = "Give the largest |e_i| of a start, or True for the problem's [region]."
        radius = read_positive(region, "region", why=", because it is a radius", cure=cure)
        asked = Region(radius=radius, rho=None if problem.is_linear else radius)
    design = _attempt(problem, request, asked)
    kind = None if design.obstacle is None else design.obstacle.kind
    # A slower rate cures no other obstacle.
    if kind not in ("gains", "rate", "max_gain"):
        return design
    for halvings in range(1, SLOWER + 1):
        rate = claimed(shorten(request.rate / 2**halvings, digits=3))
        nearest = _attempt(problem, replace(request, rate=rate), asked)
        if nearest.is_proved:
            return replace(design, nearest=nearest)
    return design


def _file_region(problem: Problem, request: PinningRequest) -> Region:
    """The [region] of the problem, with room for its observer."""
    if problem.region is None:
        raise refused(
            "region",
            "region = True means the [region] of the problem, and there is none.",
            "Give a radius, or a [region].",
        )
    radius = max(*asked_radius(loop_of(problem)), SMALLEST)
    disturbance = problem.region.initial_disturbance or ZERO
    exosystem = problem.joint_exosystem
    if not disturbance or exosystem is None:
        return Region(radius=radius, rho=None if problem.is_linear else radius)
    W = problem.joint_observer.W
    # The observer's error is in the certificate: V = N + kappa E.
    if W is None:
        raise wrong(
            "observer.W",
            "is needed, because the [region] has an initial_disturbance.",
            "Design W first, with design_observer.",
        )
    error = propose_error_bound(exosystem, W, rate=float(request.rate))
    if error is None:
        why = "because V = N + kappa E is to reach it"
        got = shown_number(request.rate)
        raise wrong(
            "rate",
            f"must be below the decay rate of the observer, {why}; got {got}.",
            "Ask for less, or for a faster W.",
        )
    rho = None if problem.is_linear else radius_needed(radius, error, disturbance)
    return Region(radius=radius, rho=rho, disturbance=disturbance, error=error, W=W)


def _attempt(problem: Problem, request: PinningRequest, region: Region) -> PinningDesign:
    """Decide one request."""
    task = Task(
        bare=changed_problem(problem, {"pinning.gains": None}),
        request=request,
        region=region,
        structure=decide.structure_of(problem, request.allowed),
    )
    obstacle = (
        decide.structural_obstacle(problem, request.pins, task.structure)
        or _unordered(task)
        or decide.too_fast(problem, request, slow_directions)
    )
    if obstacle is not None:
        return task.fails(obstacle)
    found = _on(task, request.allowed)
    most = request.pins
    if not found.is_proved or most is None:
        return found
    if most == FEWEST:
        return _with_fewest(task, found)
    if len(found.gains) <= int(most):
        return found
    fewer = _on(task, _heaviest(task, found, int(most)))
    if fewer.is_proved:
        return fewer
    none = f"no {most} of the allowed agents were found with which {REACHES}"
    rate = shown_number(request.rate)
    text = f"{none} {rate} over the region; {len(found.gains)} agents do."
    return task.fails(undecided("pins", text))


def _heaviest(task: Task, found: PinningDesign, pins: int) -> list[int]:
    """The agents that carry most of the gains without the limit; each group needs one."""
    gains = [found.gains.get(label, 0) for label in task.bare.network.labels]
    order = sorted(task.request.allowed, key=lambda i: (-gains[i], i))
    chosen = list[int]()
    # an agent of every group, then one by one
    for group in (*task.structure.groups, *([i] for i in order)):
        if not set(group) & set(chosen):
            chosen.append(next(i for i in order if i in group))
    return chosen[:pins]


def _with_fewest(task: Task, found: PinningDesign) -> PinningDesign:
    """The design with as few of the heaviest agents as do, by bisection, and what is known of
    fewer."""
    low = max(1, task.structure.least)
    while low < len(found.gains):
        middle = (low + len(found.gains)) // 2
        fewer = _on(task, _heaviest(task, found, middle))
        if fewer.is_proved:
            found = fewer
        else:
            low = middle + 1
    known = decide.fewest(len(found.gains), max(1, task.structure.least))
    return replace(found, statements=(*found.statements, known))


def _unordered(task: Task) -> Statement | None:
    """A proof that no v exists for any radius, whatever the gains: agents that no order serves."""
    bare = task.bare
    if not acts_by_component(loop_of(bare)):
        return None
    # Which order serves depends on who has a gain, not on how large it is.
    held = holding(bare, dict.fromkeys(task.request.allowed, ONE))
    stuck = stuck_agents(loop_of(held))
    if not stuck:
        return None
    labels = bare.network.labels
    names = [labels[i] for i in stuck]
    modes = ""
    if len(bare.network.modes) > 1:
        modes = f" ({', '.join(dict.fromkeys(stuck.values()))})"
    none = "no gains on the allowed agents have a max-separable certificate, of any radius"
    hears = f"in one of the modes hears nobody but these{modes}"
    return refuted(
        "ordering",
        f"{none}: each of {name_agents(names)} may not be pinned and {hears}.",
        agents=", ".join(names[:LISTED]),
    )


def _on(task: Task, agents: AgentSet) -> PinningDesign:
    """Cheap gains on these agents with a certificate of the whole region, for every switching; or
    why not."""
    bare = task.bare
    request = task.request
    rho = task.region.rho
    if not acts_by_component(loop_of(bare)):
        text = f"does not apply: {ONLY_BY_COMPONENT}"
        return task.fails(undecided("method", text))
    try:  # whatever v is, |e_j - e_i| reaches 2 rho at least
        separable.coupling_profiles(loop_of(bare), (ONE,) * bare.n, rho=rho)
    except UndefinedError as error:
        return task.fails(undecided("method", f"does not apply: {error}"))
    for claim, gains in _proposed(task, agents):
        held = holding(bare, gains)
        if gains and _is_proved(task, held, claim):
            return _covered(task, gains, held, claim)
    where = "" if rho is None else f" over |e_i| <= {shown_number(rho)}"
    none = f"no gains on the allowed agents were found with which {REACHES}"
    rate = shown_number(request.rate)
    text = f"{none} {rate}{where}, and no proof that there are none."
    return task.fails(undecided("gains", text))


def _proposed(task: Task, agents: AgentSet) -> Iterator[tuple[Separable, Gains]]:
    """Certificates of the rows, and gains on these agents, for rates a little faster than asked."""
    rho = task.region.rho
    request = replace(task.request, allowed=tuple(sorted(agents)))
    for tilt in BOX_TILTS:
        faster = float(request.rate * (1 + tilt))
        for v, proposed in propose_for_box(task.bare, request, rho=rho, rate=faster):
            gains = typed_gains(dict(enumerate(proposed.tolist())), request)
            claim = Separable(v=v, alpha=request.rate, rho=rho, error=task.region.error)
            yield claim, gains


def _is_proved(task: Task, held: Problem, claim: Separable) -> bool:
    """Whether rows and the observer's part are proved, at the rate, in a box that holds the
    region."""
    region = task.region
    loop = loop_of(held)
    if claim.error is None:  # eps = 0
        found = separable.verify_separable(loop, claim)
    else:
        found = separable.verify_composite(loop, region.W, claim)
    if found.wrong is not None:
        return False
    reaches = separable.covers(claim, radius=region.radius, disturbance=region.disturbance)
    return reaches and separable.composite_rate(claim) >= task.request.rate


def _covered(task: Task, gains: Gains, held: Problem, claim: Separable) -> PinningDesign:
    """The design whose certificate is proved, in words."""
    request = task.request
    region = task.region
    design = with_gains(request, task.structure, gains, held)
    rate = number_text(request.rate)
    part, still = " plus the observer's part", ""
    if region.error is None:
        part, still = "", ", with eps = 0"
    norm = f"max_i |e_i|/v_i (v from 1 to {float(max(claim.v)):.4g}){part}"
    starts = f"decays from every start {region}{still}"
    text = f"{norm} {starts}, at the rate {rate}, for the gains as they are written."
    decays = proved("region", text, rate=rate, radius=number_text(region.radius))
    return replace(design, statements=(decays,), certificate=claim, region=region)
