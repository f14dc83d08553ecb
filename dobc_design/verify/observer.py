"""The exosystem and the observer error (17), decided: observability, detectability, A - WC Hurwitz."""

from __future__ import annotations

from fractions import Fraction

from dobc_design.exact.matrix import Matrix, add, identity, multiply, scale, subtract
from dobc_design.exact.number import number_text
from dobc_design.exact.observability import decide_detectable, decide_observable, observable_reduction
from dobc_design.exact.polynomial import decide_hurwitz
from dobc_design.spec.canonical import matrix_text
from dobc_design.spec.exosystem import Exosystem
from dobc_design.verdict import Verdict
from dobc_design.verify.check import Check, Fix, Witness
from dobc_design.verify.numbers import largest_proved, shorten


def observability_check(exosystem: Exosystem) -> Check:
    """Decide whether (A, C) is observable.  A gain of any speed exists iff it is."""
    found = decide_observable(exosystem.A, exosystem.C)
    q = exosystem.order
    if found.verdict is Verdict.PROVED:
        return Check(
            id="observability", verdict=Verdict.PROVED, domain="global",
            reason=f"(A, C) is observable: its observability matrix has rank {found.rank} of {q}.",
            exact={"rank": str(found.rank)},
        )  # fmt: skip
    direction = found.unobservable[0]
    return Check(
        id="observability", verdict=Verdict.REFUTED, domain="global",
        reason=f"(A, C) is not observable: rank {found.rank} of {q}; the states shown never reach the disturbance.",
        exact={"rank": str(found.rank)},
        witness=Witness(kind="vector", values=tuple(number_text(x) for x in direction)),
        fix=_reduction(exosystem),
    )  # fmt: skip


def detectability_check(exosystem: Exosystem) -> Check:
    """Decide whether (A, C) is detectable: what C never sees has to die out by itself."""
    found = decide_detectable(exosystem.A, exosystem.C)
    polynomial = found.unobservable_text
    if found.verdict is Verdict.PROVED:
        hidden = "nothing is hidden from C" if polynomial == "1" else f"the hidden part {polynomial} decays"
        return Check(
            id="detectability", verdict=Verdict.PROVED, domain="global", reason=f"(A, C) is detectable: {hidden}.",
            exact={"unobservable_polynomial": polynomial},
        )  # fmt: skip
    return Check(
        id="detectability", verdict=Verdict.REFUTED, domain="global",
        reason=f"(A, C) is not detectable: the part {polynomial} of the exosystem never reaches d = C xi and does"
        " not decay, so no gain W can estimate it. It does not act on the agents either: leave it out.",
        exact={"unobservable_polynomial": polynomial},
        witness=Witness(kind="polynomial", values=(polynomial,)),
        fix=_reduction(exosystem),
    )  # fmt: skip


def hurwitz_check(exosystem: Exosystem, W: Matrix | None, *, estimate: float = 0.0, source: str = "given") -> Check:
    """Decide whether A - WC is Hurwitz (Routh over the rationals) and certify a decay rate.

    ``estimate`` (1/s) is a proposed rate from floating point; the exact test decides.
    """
    if W is None:
        exists = decide_detectable(exosystem.A, exosystem.C).verdict is Verdict.PROVED
        return Check(
            id="hurwitz", verdict=Verdict.UNDECIDED, domain="global",
            reason="there is no observer gain W to test: none was given, and none "
            + ("was found; give one as observer.W." if exists else "exists for this exosystem."),
            fix=None if exists else _reduction(exosystem),
        )  # fmt: skip
    error = subtract(exosystem.A, multiply(W, exosystem.C))
    table = decide_hurwitz(error)
    if table.verdict is not Verdict.PROVED:
        return Check(
            id="hurwitz", verdict=Verdict.REFUTED, domain="global",
            reason=f"A - WC is not Hurwitz: row {table.failing_row} of Routh's table is not positive, so the"
            " estimation error does not decay. Choose another W, or leave W out to have one designed.",
            witness=Witness(kind="routh_row", values=tuple(number_text(x) for x in table.first_column)),
            fix=Fix(kind="gain", set={"observer.W": None}, text="Remove observer.W: a gain is then designed."),
        )  # fmt: skip
    rate = largest_proved(estimate, lambda a: hurwitz_with_rate(error, a))
    return Check(
        id="hurwitz", verdict=Verdict.PROVED, domain="global", rate=rate or None,
        reason=f"A - WC is Hurwitz ({source} W): the estimation error decays"
        + (f" at least like exp(-{shorten(rate, digits=4):.4g} t)." if rate else "."),
        exact={"routh": [number_text(x) for x in table.first_column]},
    )  # fmt: skip


def hurwitz_with_rate(error: Matrix, rate: Fraction) -> bool:
    """Whether every eigenvalue of A - WC has real part < -rate: exact."""
    return decide_hurwitz(add(error, scale(rate, identity(len(error))))).verdict is Verdict.PROVED


def observable_part_is_hurwitz(exosystem: Exosystem, W: Matrix) -> bool:
    """Whether the part of A - WC that reaches the agents decays: exact (theory, section 2)."""
    A_o, C_o, T = observable_reduction(exosystem.A, exosystem.C)
    if not A_o:
        return True
    return decide_hurwitz(subtract(A_o, multiply(multiply(T, W), C_o))).verdict is Verdict.PROVED


def _reduction(exosystem: Exosystem) -> Fix:
    A_o, C_o, _ = observable_reduction(exosystem.A, exosystem.C)
    if not A_o:
        return Fix(
            kind="exosystem", set={"exosystem": None},
            text="Remove [exosystem]: C sees nothing of it, so there is no disturbance.",
        )  # fmt: skip
    return Fix(
        kind="exosystem", set={"exosystem.A": matrix_text(A_o), "exosystem.C": matrix_text(C_o)},
        text=f"Use the observable part of the exosystem (order {len(A_o)} instead of {exosystem.order}):"
        " it generates the same disturbances.",
    )  # fmt: skip
