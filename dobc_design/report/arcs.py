"""Which arcs and agents of an arc-wise certificate have little left, in words and as a picture; in
floats, since nothing rests on it."""

from collections.abc import Sequence

from dobc_design._show.text import lower
from dobc_design.certificate.claims import claim_of
from dobc_design.certificate.topics import TOPICS
from dobc_design.conditions.arcs.claim import ArcWise
from dobc_design.conditions.arcs.shares import shares_of
from dobc_design.loop.loop import Loop
from dobc_design.loop.make import loop_of
from dobc_design.loop.pairs import are_pairs

from .document import Blocks, Column, Picture, Pictures, Text, on_pages, section, table_of
from .figures import Taken, plot_shares
from .findings import Findings
from .words import FIXED, domain_words, number

MOST_ROWS = 6
MOST_DRAWN = 30
MOST_ARCS = 20_000  # of all modes, that are looked at


@section("Arc by arc: who takes and who gives", "arcs", "Arcs")
def arcs_section(found: Findings) -> Blocks:
    """What arcs take from agents in the arc-wise certificate, and where least is left; nothing
    without one."""
    W = found.certificate.claims.W
    agents = loop_of(found.problem)
    for check in found.certificate.checks:
        if check.id != "arc-wise" or not check.is_proved:
            continue
        loop, _ = TOPICS["arcs"].about(check.id, agents, W)
        claim = claim_of(check, agents, W)
        if isinstance(claim, ArcWise) and loop.arc_count <= MOST_ARCS:
            yield from _told(loop, claim, domain_words(check.domain, found.problem.unit))


def _told(loop: Loop, claim: ArcWise, where: str) -> Blocks:
    arcs = list[Taken]()
    left = list[tuple[float, str]]()
    for mode in loop.modes:
        within = f", mode {mode}" if len(loop.modes) > 1 else ""
        shares = shares_of(loop, claim, mode)
        left += [(each, loop.labels[i] + within) for i, each in enumerate(shares.left.tolist())]
        ends = zip(shares.listeners.tolist(), shares.speakers.tolist(), strict=True)
        for k, (i, j) in enumerate(ends):
            name = f"{loop.labels[i]} hears {loop.labels[j]}{within}"
            own, other, room = shares.own[k], shares.other[k], shares.room[k]
            arcs.append(Taken(name, own=own, other=other, room=room))
    least, agent = min(left)
    who = "pair" if are_pairs(loop) else "agent"
    told = (
        f"{FIXED['arcs']} The rate takes {number(2 * float(claim.rate))} 1/s from every {who}. "
        f"Least is left to {who} {agent}: {lower(least)} 1/s."
    )
    if not arcs:
        yield Text(told)
        return
    tight = sorted(range(len(arcs)), key=lambda k: arcs[k].room)
    drawn = [arcs[k] for k in sorted(tight[:MOST_DRAWN])]
    closest = [arcs[k] for k in tight[:MOST_ROWS]]
    narrow = closest[0]
    yield Text(
        f"{told} The arc that leaves least of its numbers: {narrow.name}, about "
        f"{number(narrow.room)} 1/s."
    )
    yield on_pages(Pictures((_picture(drawn, len(arcs), where),)))
    yield table_of(
        "The arcs that leave least of their numbers, in 1/s",
        closest,
        Column("arc", lambda arc: arc.name),
        Column("takes from who hears, 1/s", lambda arc: number(arc.own), style="number"),
        Column("from who is heard", lambda arc: number(arc.other), style="number"),
        Column("leaves, about", lambda arc: number(arc.room), style="number"),
    )


def _picture(arcs: Sequence[Taken], count: int, where: str) -> Picture:
    some = f" The {len(arcs)} of {count} arcs that leave least are drawn." * (len(arcs) < count)
    told = "; ".join(f"{a.name}: {number(a.own)} and {number(a.other)}" for a in arcs)
    return Picture(
        "arcs",
        "What each arc takes from its two agents",
        caption=f"It holds for {where}. Left of 0: the arc pulls this agent back, and gives.{some}",
        alt=f"What arcs take at most from who hears and from who is heard, in 1/s. {told}.",
        draw=lambda ax: plot_shares(ax, arcs),
        height=1.3 + 0.26 * len(arcs),
    )
