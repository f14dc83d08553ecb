"""Late, held and lost readings, and the processor: what was asked, what is proved, and the rate
with shorter and longer times."""

import math
from collections.abc import Mapping
from fractions import Fraction

from dobc_design._show.text import significant_towards_zero
from dobc_design.certificate.certificate import Certificate
from dobc_design.certificate.claims import claim_of
from dobc_design.certificate.topics import TOPICS
from dobc_design.conditions.kinds import READINGS
from dobc_design.conditions.separable.claim import ReadingsBound
from dobc_design.conditions.separable.propose_readings import rates_around, varied
from dobc_design.conditions.separable.timing import shortest_gap
from dobc_design.conditions.stated import answer_of
from dobc_design.exact.reading import counted
from dobc_design.loop.make import loop_of
from dobc_design.loop.timing import Timing, timing_words

from .document import Blocks, Column, Picture, Pictures, Text, on_pages, section, table_of
from .figures import plot_rates
from .findings import Findings
from .words import FIXED, domain_words, number, sentence

MOST_VARIED = 60  # agents of a network of which other times are tried
TIMES = {
    "period": "computed and held over",
    "ahead": "delay of what acts",
    "delay": "age of readings of neighbours",
    "own_delay": "age of own readings",
    "lost": "readings lost in a row",
    "event": "relative error of readings",
}
_TICK = {True: "step", False: "sample"}
_UNITS = {"lost": "", "event": ""}


@section("Late and held readings", "readings", "Readings")
def readings_section(found: Findings) -> Blocks:
    """What [readings] and [processor] state, and what is proved with it; nothing without them."""
    agents = loop_of(found.problem)
    timing = agents.timing
    if timing is None:
        return
    checks = found.certificate.checks
    undecided = (each for each in checks if each.id == READINGS)
    check = answer_of(agents, checks, READINGS) or next(undecided, None)
    told = f"Nothing is proved about {timing_words(timing)}."
    yield Text(told if check is None else sentence(check.reason))
    if check is None or not check.is_proved:
        return
    if timing.period and check.factor is not None:
        kept = -math.log1p(-float(timing.period) * (check.rate or 0.0))
        samples = math.ceil(math.log(100 * check.factor) / kept)
        yield Text(f"One percent is reached within {counted(samples, _TICK[timing.steps])}.")
    loop, W = TOPICS[check.kind.topic].about(check.id, agents, found.certificate.claims.W)
    claim = claim_of(check, loop, W)
    gap = shortest_gap(loop, claim.rows) if isinstance(claim, ReadingsBound) else None
    if gap is not None:
        yield Text(
            "An agent that broadcasts when it has moved by the event's part of the bound on it, "
            f"which falls in time, does so at most once in {significant_towards_zero(float(gap))} "
            "s."
        )
    rates = varied_rates(found.certificate)
    asked = [name for name in TIMES if getattr(timing, name)]
    if timing.steps:
        asked.remove("period")
    # which both ages count
    for name in ("delay", "own_delay") if timing.ahead else ():
        if getattr(timing, name) == timing.ahead:
            asked.remove(name)
    if asked:
        yield table_of(
            "What was asked",
            asked,
            Column("what", lambda name: TIMES[name]),
            Column("proved", lambda name: _shown(name, getattr(timing, name)), style="number"),
            Column("tried, proved up to", lambda name: _tried(name, rates, timing), style="number"),
        )
    if rates:
        where = domain_words(check.domain, agents.unit)
        yield on_pages(Pictures((_picture(rates, timing, where),)))


def varied_rates(certificate: Certificate) -> Mapping[float, float]:
    """Proved rates (1/s) by the stated time that is varied (s); none where the network is large, or
    nothing is proved with readings."""
    check = next((each for each in certificate.checks if each.id == READINGS), None)
    loop = loop_of(certificate.problem)
    if check is None or not check.is_proved or loop.n > MOST_VARIED:
        return {}
    return {} if varied(loop.timing or Timing()) == "event" else rates_around(loop, check.domain)


def _shown(name: str, value: Fraction | float) -> str:
    return f"{number(float(value))}{_UNITS.get(name, ' s')}"


def _tried(name: str, rates: Mapping[float, float], timing: Timing) -> str:
    proved = [time for time, rate in rates.items() if rate > 0]
    return _shown(name, max(proved)) if proved and name == varied(timing) else "—"


def _picture(rates: Mapping[float, float], timing: Timing, where: str) -> Picture:
    name = varied(timing)
    pairs = "; ".join(f"{number(time)}: {number(rate)}" for time, rate in rates.items())
    return Picture(
        "readings",
        f"Proved rate over the time: {TIMES[name]}",
        caption=f"It holds for {where}. {FIXED['readings']}",
        alt=f"Proved rates in 1/s over times in s. {pairs}.",
        draw=lambda ax: plot_rates(ax, rates, stated=float(getattr(timing, name))),
    )
