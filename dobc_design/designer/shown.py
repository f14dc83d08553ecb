"""What the page shows of a certificate: the verdict, whether inputs keep their limit, and the
proved bound that is drawn against the run.

Nothing is decided here.
"""

from collections.abc import Sequence
from dataclasses import asdict
from fractions import Fraction

from dobc_design._checks import noun
from dobc_design._show.text import significant_away_from_zero, significant_towards_zero
from dobc_design.certificate.bounds import is_inside, keeps_guarantee, starts_of
from dobc_design.certificate.certificate import Certificate
from dobc_design.conditions.separable.propose_readings import varied
from dobc_design.conditions.stated import (
    ACCURACY,
    LIMIT,
    Gap,
    gaps,
    stated_in,
    table_words,
)
from dobc_design.errors import SpecError
from dobc_design.exact.number import float_above
from dobc_design.exact.reading import Document
from dobc_design.loop.make import loop_of
from dobc_design.loop.pairs import are_pairs, required_rows
from dobc_design.problem.problem import Problem
from dobc_design.report.plant import numbers_of, plant_numbers
from dobc_design.report.readings import TIMES, varied_rates
from dobc_design.report.words import said_here, sentence
from dobc_design.verdict import Verdict


@noun
class Bound:
    """What is drawn against the run: ``tube``, a proved bound of |e(t)|_inf at the run's times, or
    ``level``, one proved number.  ``text`` says what it is, or why there is none."""

    text: str
    tube: Sequence[float] = ()
    level: float | None = None


def shown(certificate: Certificate, times: Sequence[float], radius: Fraction) -> Document:
    """The verdict as the page shows it: a rate rounded down, its factor rounded up.

    ``times`` of the run in s, ``radius`` of its start |e|_inf, in the unit of x.
    """
    rate, factor = certificate.rate, certificate.factor
    claims = certificate.regions.claims
    proved = [claim.method for claim in claims if claim.verdict is Verdict.PROVED]
    text = sentence(certificate.reason)
    problem = certificate.problem
    return {
        "verdict": certificate.verdict.value,
        "text": said_here(problem)(text) if problem.agrees else text,
        "rate": None if rate is None else significant_towards_zero(rate),
        "factor": None if factor is None else significant_away_from_zero(factor),
        "conditions": list(dict.fromkeys(proved)),
        "plant": plant_numbers(certificate),
        "limit": _limit_state(certificate),
        "bound": asdict(_bound(certificate, times, radius)),
    }


def shown_rates(certificate: Certificate) -> Document:
    """Proved rates (1/s) with shorter and longer readings than stated, as points and in words; {}
    where there are none."""
    points = [[time, rate] for time, rate in varied_rates(certificate).items()]
    timing = loop_of(certificate.problem).timing
    if not points or timing is None:
        return {}
    longest = max((time for time, rate in points if rate > 0), default=0.0)
    unit = "steps" if timing.steps else "s"
    text = f"proved up to {significant_towards_zero(longest)} {unit}: {TIMES[varied(timing)]}"
    return {"points": points, "text": text, "unit": unit}


def limit_words(problem: Problem) -> str:
    """The limit of inputs that the file states; "" without one, and where inputs saturate, which
    the verdict says."""
    loop = loop_of(problem)
    asks = stated_in(loop).limit and not loop.saturates
    return table_words(loop, LIMIT) if asks else ""


def _limit_state(certificate: Certificate) -> Document | None:
    """Whether it is proved that no input exceeds its limit, and why not; None without a limit."""
    if not limit_words(certificate.problem):
        return None
    gap = _limit_gap(certificate)
    why = ""
    # Where the verdict hangs on the limit it has said why.
    if gap is not None and gap.reason not in certificate.reason:
        why = sentence(gap.reason)
    return {"kept": gap is None, "why": why}


def _limit_gap(certificate: Certificate) -> Gap | None:
    """Why the limit is not proved to be kept; None where it is, or where there is none."""
    found = gaps(loop_of(certificate.problem), certificate.checks)
    return next((gap for gap in found if gap.id == LIMIT), None)


def _bound(certificate: Certificate, times: Sequence[float], radius: Fraction) -> Bound:
    loop = loop_of(certificate.problem)
    # The run stays in one mode, which a guarantee need not allow.
    if not keeps_guarantee(loop, {"signal": "fixed"}):
        return Bound(
            text="No proved bound is drawn: the run does not keep the switching guarantee."
        )
    if loop.agrees and not are_pairs(required_rows(loop, certificate.claims.W)):
        return Bound(text="No proved bound is drawn: it is about differences to one agent.")
    try:
        tube = certificate.bound(times, radius=radius, disturbance=0)
    except SpecError as error:
        return _level(certificate, radius) or Bound(text=f"No proved bound is drawn: {error.cure}.")
    return Bound(text="proved: from these starts no agent is ever above it", tube=tube.tolist())


def _level(certificate: Certificate, radius: Fraction) -> Bound | None:
    """What is left in the end where something acts for ever, or the largest proved box of
    starts."""
    loop = loop_of(certificate.problem)
    starts = starts_of(loop, radius, 0)
    for check in certificate.checks:
        if check.id == ACCURACY and check.is_proved and is_inside(check.domain, starts):
            level = float_above(max(numbers_of(check, "bounds").values()))
            text = "proved bound of the final error"
            if _limit_gap(certificate) is not None:
                text += f", without {limit_words(certificate.problem)}"
            return Bound(text=text, level=level)
    # Regions are about the model alone.
    if stated_in(loop):
        return None
    boxes = [claim.box for claim in certificate.regions.claims if claim.box is not None]
    if not boxes:
        return None
    what = "difference" if loop.agrees else "distance"
    return Bound(text=f"largest {what} of starts that is proved", level=max(boxes))
