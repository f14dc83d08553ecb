"""The arc-wise certificate of the region asked for, or of the largest ball that it proves."""

from collections.abc import Iterable, Iterator
from itertools import chain

import numpy as np

from dobc_design.conditions.check import Check, cut_check, surviving, undecided_check
from dobc_design.conditions.coverage import Asked, Progress
from dobc_design.conditions.domain import Ball, Box
from dobc_design.conditions.numbers import claimed, decimal_below, last_found, shorten, text_below
from dobc_design.conditions.weighted.propose import even_weights, stiffnesses
from dobc_design.exact.interval import UndefinedError
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.symmetric import Doubles
from dobc_design.exact.work import STAGE, WorkLimitError, at_most, exhausted
from dobc_design.loop.loop import Loop
from dobc_design.verdict import Verdict

from .claim import ArcWise
from .decide import errors_of_arcs, holds_starts, obstacle, why_not
from .propose import Search

ID = "arc-wise"
IN_HAND = 1e-6  # of a level, for the rounding of its parts
FIRST = 4.0  # balls are that much smaller until one is found
FALLS = 10
CLOSE = 2e-3  # of the radius of the largest ball
SMALLER = (0.997, 0.99, 0.97, 0.9, 0.7)  # parts of it, where its numbers are not proved
EVEN = 1.01  # weights that differ by less are the same
FEW_KINDS = 500  # arcs of different kinds, up to which weights are told apart closely
MOST_WEIGHED = 10_000  # arcs up to which weights other than 1 are tried
Found = tuple[ArcWise, Ball | Box]


def arcs_stage(asked: Asked, report: Progress) -> list[Check]:
    """The arc-wise certificate: of the box asked for, else of the largest ball."""
    reason = obstacle(asked.loop, asked.W)
    if reason is not None:
        return [undecided_check(ID, asked.domain, reason, applies=False)]
    report("deciding the region (arc-wise)")
    with at_most(STAGE):
        found = _found(asked)
        cut = exhausted()
    if found is None and cut is not None:
        return [cut_check(ID, asked.domain, cut)]
    if found is None:
        beside = f" with |eps_i| <= {asked.disturbance:.6g}" if asked.disturbance else ""
        reason = f"no a and b of the arcs are found, not even near the target{beside}."
        return [undecided_check(ID, asked.domain, reason)]
    return [_check(asked, *found)]


def claims_in(loop: Loop, W: Matrix | None, box: Box) -> Iterator[ArcWise]:
    """Proved claims that hold all starts of a box."""
    if obstacle(loop, W) is None:
        for search in _searches(loop, W, box.disturbance):
            found = _fastest(search, box)
            if found is not None:
                yield found[0]


def _searches(loop: Loop, W: Matrix | None, disturbance: float) -> Iterator[Search]:
    for d in _weights(loop):
        yield Search(
            loop=loop,
            W=W,
            d=d,
            disturbance=claimed(disturbance),
            known={},
        )


def _fastest(search: Search, box: Box) -> Found | None:
    fastest = sorted(_claims(search, box), key=lambda claim: -claim.rate)
    return _first_proved(search.loop, [(claim, box) for claim in fastest])


def _found(asked: Asked) -> Found | None:
    """A proved claim with its domain: the box asked for, else the largest ball."""
    box = Box(asked.radius, asked.disturbance)
    searches = []
    for search in _searches(asked.loop, asked.W, asked.disturbance):
        searches.append(search)
        # Other weights are looked for only where these do not do.
        found = _fastest(search, box) if asked.wanted else None
        if found is not None:
            return found
    balls = [_largest(asked, search) for search in searches]
    known = [each for each in balls if each is not None]
    return max(known, key=lambda each: each[1].radius, default=None)


def _weights(loop: Loop) -> Iterator[Doubles]:
    """Weights d that are tried: all 1, then those of the linear couplings near the target, between
    all modes."""
    yield Doubles(np.ones(loop.n))
    if loop.arc_count > MOST_WEIGHED:
        return
    # Of many arcs few kinds are made: each has a hull of its own.
    steps = 256 if loop.arc_count <= FEW_KINDS else 2
    found = None
    with surviving("no weights for arcs", WorkLimitError):
        tables = stiffnesses(loop)
        found = None if tables is None else even_weights(tables, 0.0)
    if found is not None and found.max() > EVEN * found.min():
        d = found.reshape(loop.n, loop.m).mean(axis=1)
        # Of few digits, as powers of two leave them.
        part, exponent = np.frexp(d / d.max())
        yield Doubles(np.ldexp(np.ceil(part * steps) / steps, exponent))


def _largest(asked: Asked, search: Search) -> Found | None:
    """The largest ball that is found, proved."""

    def at(radius: float, _: object = None) -> Found | None:
        ball = Ball(shorten(radius, digits=6), asked.disturbance)
        claim = next(_claims(search, ball), None)
        return None if claim is None else (claim, ball)

    radius = asked.ball
    found = at(radius)
    for _ in range(FALLS):
        if found is not None:
            break
        radius /= FIRST
        found = at(radius)
    if found is None:
        return None
    known: Found = found
    if radius < asked.ball:
        radius, known = last_found(at, known, radius, FIRST * radius, close=_are_close)
    smaller = (at(part * radius) for part in SMALLER)
    return _first_proved(search.loop, chain([known], filter(None, smaller)))


def _are_close(low: float, high: float) -> bool:
    return high - low < CLOSE * low


def _claims(search: Search, domain: Ball | Box) -> Iterator[ArcWise]:
    """Those that seem to cover a domain."""
    d = search.d.array
    weight = search.loop.m * d.sum() if isinstance(domain, Box) else d.max()
    with surviving("no arc-wise proposal", UndefinedError, WorkLimitError):
        yield from search.claims(float(domain.radius) ** 2 * weight * (1 + IN_HAND))


def _first_proved(loop: Loop, found: Iterable[Found]) -> Found | None:
    with surviving("no arc-wise proof", WorkLimitError):
        for claim, domain in found:
            if holds_starts(loop, claim, domain) and why_not(loop, claim) is None:
                return claim, domain
    return None


def _check(asked: Asked, claim: ArcWise, domain: Ball | Box) -> Check:
    loop = asked.loop
    norm = "|e_i|" if isinstance(domain, Box) else "|e|"
    starts = f"{norm} <= {float(domain.radius):.6g}"
    if loop.groups:
        starts += f" and |eps_i| <= {asked.disturbance:.6g}"
    V = "sum d_i |e_i|^2" + ("" if claim.P is None else " + sum eps_i'P eps_i")
    where = ", in every mode" if len(loop.modes) > 1 else ""
    if any(errors_of_arcs(loop)):
        where += ", for all weights and gains within the stated errors"
    remark = ""
    if isinstance(domain, Ball):
        needs = f"the region needs {asked.ball:.6g}" if asked.wanted else "no region is asked for"
        remark = (
            f" The ball reaches |e| <= {float(domain.radius):.6g} (all errors together), {needs}: "
            "beyond, no a and b of the arcs are found."
        )
        if asked.wanted:
            remark += " With a settling time (--settling) a box that moves may lead into it."
    return Check(
        id=ID,
        verdict=Verdict.PROVED,
        domain=domain,
        rate=decimal_below(claim.rate),
        claim=claim,
        reason=f"from every start with {starts}, V = {V} decreases at least like exp(-2 "
        f"({text_below(claim.rate)}) t): what each arc adds at most is paid for by its two "
        f"agents{where}.{remark}",
    )
