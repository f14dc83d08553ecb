"""The exosystem and the observer error (17), decided: observability, detectability, A - WC
Hurwitz."""

import math
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from functools import partial

from dobc_design.conditions.check import Check, Fix, Values, Witness, differs
from dobc_design.conditions.domain import EVERYWHERE
from dobc_design.conditions.numbers import claimed, largest_proved, text_below
from dobc_design.exact.interval import (
    Interval,
    exp,
    interval_characteristic_polynomial,
    interval_routh,
)
from dobc_design.exact.matrix import Matrix, add, identity, multiply, scale, subtract, transpose
from dobc_design.exact.number import ONE, ZERO, number_text, root_above, typed_number
from dobc_design.exact.observability import (
    decide_detectable,
    decide_observable,
    observable_reduction,
)
from dobc_design.exact.polynomial import decide_hurwitz, decide_images, disk_image
from dobc_design.exact.reading import Document, some
from dobc_design.loop.loop import Loop
from dobc_design.loop.timing import Timing, sampled
from dobc_design.problem.changes import typed_matrix
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.groups import Group, blocks_of, join
from dobc_design.verdict import Verdict

_check = partial(Check, domain=EVERYWHERE)
#: Seventh power of the order times squared bits up to which (A, C) is decided; plain Python takes
#: about 10^-12 s each.
MOST_WORK = 5 * 10**13


def too_large(exosystem: Exosystem) -> str | None:
    """Why exact arithmetic with (A, C) is left out: its numbers would fill the memory; None where
    they do not."""
    numbers = [x for row in (*exosystem.A, *exosystem.C) for x in row]
    common = math.lcm(*(x.denominator for x in numbers))
    largest = max(map(abs, numbers), default=ZERO)
    bits = common.bit_length() + math.ceil(largest).bit_length()
    if exosystem.order**7 * bits**2 <= MOST_WORK:
        return None
    return (
        "left out, because exact arithmetic takes long with an exosystem of order "
        f"{exosystem.order} and numbers of {bits} bits over a common denominator; "
        "fewer digits or a lower order would help."
    )


def observability_check(exosystem: Exosystem, loop: Loop | None = None) -> Check:
    """Decide whether (A, C) is observable.  Here and below the cure projects what the ``loop``
    says of states."""
    found = decide_observable(exosystem.A, exosystem.C)
    q = exosystem.order
    check = partial(_check, id="observability", claim=Values({"rank": str(found.rank)}))
    if found.is_proved:
        reason = f"(A, C) is observable: its observability matrix has rank {found.rank} of {q}."
        return check(verdict=Verdict.PROVED, reason=reason)
    return check(
        verdict=Verdict.REFUTED,
        reason=f"(A, C) is not observable: rank {found.rank} of {q}; the states shown do not "
        "appear in d.",
        witness=Witness(kind="vector", values=tuple(map(number_text, found.unobservable[0]))),
        fix=_reduction(exosystem, loop),
    )


def detectability_check(
    exosystem: Exosystem, loop: Loop | None = None, timing: Timing | None = None
) -> Check:
    """Decide whether (A, C) is detectable: what C never sees has to die out by itself; sampled
    every T, the same, since exp(A T) has no eigenvalue twice for rational A and T that A has
    once."""
    found = decide_detectable(exosystem.A, exosystem.C)
    polynomial = found.unobservable_text
    values = Values({"unobservable_polynomial": polynomial})
    check = partial(_check, id="detectability", claim=values)
    decays = found.is_proved
    if timing is not None and timing.steps:
        decays = _is_inside(found.unobservable_polynomial)
    if decays:
        hidden = "no part is unobservable"
        if polynomial != "1":
            hidden = f"the unobservable part {polynomial} decays"
        return check(verdict=Verdict.PROVED, reason=f"(A, C) is detectable: {hidden}.")
    return check(
        verdict=Verdict.REFUTED,
        reason="(A, C) is not detectable: the modes of the exosystem with the characteristic "
        f"polynomial {polynomial} do not appear in d = C xi and do not decay, so no gain W can "
        "estimate them. They do not act on the agents either: leave them out.",
        witness=Witness(kind="polynomial", values=(polynomial,)),
        fix=_reduction(exosystem, loop),
    )


def of_outputs(check: Check, group: Group, states: int) -> Check:
    """The same check of a pair whose outputs are measured (``loop.outputs``), in its words: what is
    hidden is a state of the agent or of the exosystem, which no other exosystem cures."""
    pair = group.exosystem
    own = replace(check, fix=None)
    if check.id == "hurwitz":
        return replace(
            own, reason=check.reason.replace("A - WC", "F = A - W H").replace(" (given W)", "")
        )
    found = decide_observable(pair.A, pair.C)
    if check.id == "observability" and found.is_proved:
        told = "of states and exosystem together"
        return replace(own, reason=f"the output y = H x shows all {pair.order} numbers {told}.")
    if check.is_proved:
        return replace(own, reason="what y = H x does not show, if anything, decays.")
    names = [f"x{c + 1}" for c in range(states)]
    names += [f"xi{c + 1}" for c in range(pair.order - states)]
    hidden = [n for n, *each in zip(names, *found.unobservable, strict=True) if any(each)]
    what = f"the state {hidden[0]} does"
    if len(hidden) > 1:
        what = f"some common change of {some(hidden, 6)} does"
    reason = f"{what} not show in y = H x"
    if check.id == "detectability":
        polynomial = (check.exact or {})["unobservable_polynomial"]
        reason += (
            f" and need not decay (characteristic polynomial {polynomial}), so that no gain W "
            "estimates all states and the disturbance. Measure more, or leave out of [exosystem] "
            "what cannot be told from a state"
        )
    return replace(own, reason=f"{reason}.")


def _is_inside(polynomial: Sequence[Fraction]) -> bool:
    """Whether all roots lie inside the unit disk: exact."""
    image = disk_image(polynomial, centre=ZERO, radius=ONE)
    return decide_images([image], degree=len(polynomial) - 1)[1]


def hurwitz_check(
    exosystem: Exosystem,
    W: Matrix | None,
    *,
    estimate: float = 0.0,
    source: str = "given",
    loop: Loop | None = None,
    key: str = "observer.W",
    timing: Timing | None = None,
) -> Check:
    """Decide whether A - WC is Hurwitz (Routh), with a rate near ``estimate`` (1/s); sampled,
    whether all eigenvalues of Ad - W C Gamma lie inside the unit disk.  ``key``: where W is
    given."""
    if W is None:
        return _no_gain(exosystem, loop, key)
    if timing is not None and timing.sampled:
        return _sampled_check(exosystem, W, timing, estimate=estimate, source=source)
    error = error_matrix(exosystem, W)
    # Routh's table ends at the first entry of its first column that is not positive.
    decided = decide_hurwitz(error)
    routh = tuple(map(number_text, decided.first_column))
    if decided.is_proved:
        rate = largest_proved(estimate, lambda a: hurwitz_with_rate(error, a))
        decay = f" at least like exp(-{text_below(rate)} t)" if rate else ""
        return _check(
            id="hurwitz",
            verdict=Verdict.PROVED,
            rate=rate or None,
            reason=f"A - WC is Hurwitz ({source} W): the estimation error decays{decay}.",
            claim=Values({"routh": list(routh)}),
        )
    if _has_gains(exosystem):
        advice = "Choose another W, or leave W out to have one designed."
        fix = _designed_instead(loop)
    else:
        advice = "No W does: see detectability."
        fix = _reduction(exosystem, loop)
    return _check(
        id="hurwitz",
        verdict=Verdict.REFUTED,
        reason=f"A - WC is not Hurwitz: entry {len(routh)} of the first column of Routh's table is"
        f" not positive, so the estimation error does not decay. {advice}",
        witness=Witness(kind="routh_row", values=routh),
        fix=fix,
    )


def _sampled_check(
    exosystem: Exosystem, W: Matrix, timing: Timing, *, estimate: float, source: str
) -> Check:
    """The same for the recursion of a processor, or of agents that move in steps."""
    check = partial(_check, id="hurwitz")
    found = sampled_verdict(exosystem, W, timing)
    ticks = "step" if timing.steps else f"{float(timing.period):.6g} s"
    what = f"A_d - W C Gamma ({source} W, {ticks})"
    if found is Verdict.PROVED:
        rate = largest_proved(
            estimate, lambda a: sampled_verdict(exosystem, W, timing, a) is Verdict.PROVED
        )
        decay = f" at least like exp(-{text_below(rate)} t)" if rate else ""
        reason = f"all eigenvalues of {what} lie inside the unit disk: the estimation error decays"
        return check(verdict=found, rate=rate or None, reason=f"{reason}{decay}.")
    advice = "Choose another W, or leave W out to have one designed."
    if found is Verdict.REFUTED:
        reason = f"an eigenvalue of {what} lies outside the unit disk. {advice}"
        return check(verdict=found, reason=reason, fix=_designed_instead(None))
    reason = f"it is not decided whether {what} has all its eigenvalues inside the unit disk."
    return check(verdict=found, reason=reason)


def sampled_verdict(
    exosystem: Exosystem, W: Matrix, timing: Timing, rate: Fraction = ZERO
) -> Verdict:
    """Whether every eigenvalue of Ad - W C Gamma is smaller than exp(-rate T) in size; REFUTED: not
    every one is inside the unit disk.  Close to the border it is UNDECIDED."""
    F = sampled(exosystem, timing).error(W, timing.period)
    polynomial = interval_characteristic_polynomial(F)
    radius = exp(Interval.point(-rate * timing.period)).lo
    return interval_routh(disk_image(polynomial, centre=ZERO, radius=radius))


def _has_gains(exosystem: Exosystem) -> bool:
    """Whether some W makes A - WC Hurwitz."""
    return decide_detectable(exosystem.A, exosystem.C).is_proved


def _no_gain(exosystem: Exosystem, loop: Loop | None, key: str) -> Check:
    """The check where there is no W, undecided."""
    none = "exists for this exosystem."
    fix = None
    if _has_gains(exosystem):
        none = f"was found; give one as {key}."
    else:
        fix = _reduction(exosystem, loop)
    reason = f"there is no observer gain W to test: none was given, and none {none}"
    return _check(id="hurwitz", verdict=Verdict.UNDECIDED, reason=reason, fix=fix)


def _designed_instead(loop: Loop | None) -> Fix:
    """The removal of W and of the P that belongs to it."""
    removal: Document = {"observer.W": None}
    if loop is not None and loop.observer.P is not None:
        removal["observer.P"] = None
    text = "Remove observer.W (and P, if given): a gain is then designed."
    return Fix(kind="gain", set=removal, text=text)


def confirm(check: Check, loop: Loop, W: Matrix | None) -> str | None:
    """None if everything that a proved or refuted check of this topic claims is confirmed, else
    what is not."""
    # Exact and quick: all of it is decided once more, and compared.
    exosystem, own_gain = group_of(check.group, loop, W)
    if check.id == "observability":
        own = observability_check(exosystem)
    elif check.id == "detectability":
        own = detectability_check(exosystem, timing=loop.timing)
    else:
        own = hurwitz_check(exosystem, own_gain, timing=loop.timing)
    wrong = differs(check, own)
    if wrong is not None:
        return wrong
    if check.margin is not None or (check.rate is not None and check.id != "hurwitz"):
        return "it claims a number that this check does not have"
    if check.rate is None:
        return None
    if own_gain is None or not check.is_proved or check.rate <= 0:
        return "it claims a rate without ground"
    rate = claimed(check.rate)
    if loop.timing is not None and loop.is_sampled:
        verdict = sampled_verdict(exosystem, own_gain, loop.timing, rate)
        reached = verdict is Verdict.PROVED
    else:
        reached = hurwitz_with_rate(error_matrix(exosystem, own_gain), rate)
    return None if reached else f"the rate {check.rate} is not reached"


def group_of(name: object, loop: Loop, W: Matrix | None) -> tuple[Exosystem, Matrix | None]:
    """Exosystem and gain of the group (None: the only one).  Raises: ValueError if there is none,
    or W mixes groups."""
    groups = loop.observers
    if loop.sensed:
        # Its gain is that of the file; W is 0, and says nothing of it.
        W = join([group.observer.W for group in groups])
    if not loop.is_grouped:
        if name is not None or not groups:
            raise ValueError("there are no groups" if groups else "there is no exosystem")
        return groups[0].exosystem, W
    # W of all groups is block diagonal, in their order.
    place = [group.name for group in groups].index(str(name))
    system = groups[place].exosystem
    if W is None:
        return system, None
    blocks = blocks_of(W, [(group.exosystem.order, system.outputs) for group in groups])
    if blocks is None:
        raise ValueError("W is not block diagonal")
    return system, blocks[place]


def error_matrix(exosystem: Exosystem, W: Matrix) -> Matrix:
    """A - WC, (q, q): the dynamics of the observer error (17)."""
    return subtract(exosystem.A, multiply(W, exosystem.C))


def hurwitz_with_rate(error: Matrix, rate: Fraction) -> bool:
    """Whether every eigenvalue of A - WC has real part < -rate: exact."""
    return decide_hurwitz(add(error, scale(rate, identity(len(error))))).is_proved


def observable_part_decays(exosystem: Exosystem, W: Matrix, timing: Timing | None) -> bool:
    """Whether the part of A - WC that reaches the agents decays: exact (theory, section 2); of the
    recursion where it is sampled, True as well where that is not decided."""
    A_o, C_o, T = observable_reduction(exosystem.A, exosystem.C)
    if not A_o:
        return True
    if timing is not None and timing.sampled:
        seen = Exosystem(A=A_o, C=C_o)
        return sampled_verdict(seen, multiply(T, W), timing) is not Verdict.REFUTED
    return decide_hurwitz(subtract(A_o, multiply(multiply(T, W), C_o))).is_proved


def _reduction(exosystem: Exosystem, loop: Loop | None) -> Fix:
    """The observable part in place of the exosystem; what the problem says of the old states is
    projected along."""
    A_o, C_o, T = observable_reduction(exosystem.A, exosystem.C)
    if not A_o:
        text = "Remove [exosystem]: C sees nothing of it, so there is no disturbance."
        return Fix(kind="exosystem", set=_without_exosystem(loop), text=text)
    change: Document = {"exosystem.A": typed_matrix(A_o), "exosystem.C": typed_matrix(C_o)}
    if loop is not None:
        change |= _projected(loop, T)
    order = f"order {len(A_o)} instead of {exosystem.order}"
    text = (
        f"Use the observable part of the exosystem ({order}): it generates the same disturbances."
    )
    return Fix(kind="exosystem", set=change, text=text)


def _without_exosystem(loop: Loop | None) -> Document:
    """The keys that change where a problem has no exosystem any more."""
    change: Document = {"exosystem": None}
    if loop is None:
        return change
    observer = loop.observer
    if observer.W or observer.P or observer.rate:
        change["observer"] = None
    if loop.xi0 is not None:
        change["simulation.xi0"] = None
    if loop.starts is not None and loop.starts.disturbance is not None:
        change["region.initial_disturbance"] = None
    if loop.m > 1:  # C no longer says how many components there are
        change["target"] = [typed_number(x) for x in loop.goals.target]
    return change


def _projected(loop: Loop, T: Matrix) -> Document:
    """What a problem says of the states xi, said of T xi."""
    change: Document = {}
    observer = loop.observer
    # A W for the old states acts on the new ones as T W; a P has no such image.
    if observer.W is not None:
        change["observer.W"] = typed_matrix(multiply(T, observer.W))
    if observer.P is not None:
        change["observer.P"] = None
    if loop.xi0 is not None:
        rows = typed_matrix(tuple(tuple(row) for row in multiply(loop.xi0, transpose(T))))
        change["simulation.xi0"] = rows[0] if len(rows) == 1 else rows
    if loop.starts is not None and loop.starts.disturbance:
        # |T| to six decimals, rounded up
        squares = sum((x * x for row in T for x in row), ZERO)
        norm = root_above(squares, unit=10**6)
        change["region.initial_disturbance"] = typed_number(loop.starts.disturbance * norm)
    return change
