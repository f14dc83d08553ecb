"""Enclosures of h, h' and h(y)/y against random points at 200 bits, for every function and compositions."""

from collections.abc import Callable
from fractions import Fraction
from random import Random

from evidence.row import Row
from random_couplings import OUTER, coupling_text, near_kink, true_values

from dobc_design.coupling.enclosures import Curve, jet, secant, secant_range, slope_form, tight_range, value_form
from dobc_design.coupling.expression import parse_expression
from dobc_design.coupling.functions import FUNCTIONS
from dobc_design.exact.interval import Interval, UndefinedError

PER_COUPLING = 1000  # points on one random interval of one random coupling
NAMES = ("h", "h'", "h(y)/y")
CLOSE = Fraction(1, 100)
SLACK = Fraction(1, 10**45)  # of the 200 bits


def run(count: int, seed: int) -> Row:
    failures: list[str] = []
    done = turn = 0
    used: set[str] = set()
    while done < count:
        text = coupling_text(seed + turn)
        used |= {name for name in FUNCTIONS if f"{name}(" in text}
        points, wrong = _compare(text, Random(f"{seed} {turn}"), min(PER_COUPLING, count - done))
        failures += [f"turn {turn}: {each}" for each in wrong]
        done += points
        turn += 1
    missing = set(FUNCTIONS) - used
    if missing and turn >= 3 * len(OUTER):
        failures.append(f"never used: {sorted(missing)}")
    what = "enclosures of h, h' and the secant gain contain the values at random points (200 bits)"
    return Row(what, done, failures, [f"{turn} couplings, {len(used)} of {len(FUNCTIONS)} functions"])


def _compare(text: str, r: Random, points: int) -> tuple[int, list[str]]:
    curve = Curve(parse_expression(text))
    start = Fraction(r.randint(-2000, 1500), 1000)
    Y = Interval(start, min(start + Fraction(r.randint(1, 9), 3) / 10 ** r.choice((0, 0, 1, 3)), Fraction(2)))
    enclosures = (
        (*_tried(lambda: value_form(curve, Y)), tight_range(curve, value_form, Y, tolerance=CLOSE)),
        (*_tried(lambda: jet(curve, Y).slope), tight_range(curve, slope_form, Y, tolerance=CLOSE)),
        (*_tried(lambda: secant(curve, Y).value), secant_range(curve, Y, tolerance=CLOSE)),
    )
    wrong = []
    for _ in range(points):
        y = Y.lo + Y.width * Fraction(r.getrandbits(48) | 1, 2**48)
        values = true_values(text, y)
        for name, known, value in zip(NAMES, enclosures, values, strict=True):
            slack = SLACK * (1 + abs(value))
            inside = all(each.lo - slack <= value <= each.hi + slack for each in known)
            if not inside and not (name == NAMES[1] and near_kink(text, y)):
                wrong.append(f"{name} of {text} at {y} on {Y}")
    return points, wrong


def _tried(form: Callable[[], Interval]) -> tuple[Interval, ...]:
    """One evaluation on a wide interval may not see that a function is defined; the ranges subdivide."""
    try:
        return (form(),)
    except UndefinedError:
        return ()
