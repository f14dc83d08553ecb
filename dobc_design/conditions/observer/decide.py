"""The exosystem and the observer error (17), decided: observability, detectability, A - WC Hurwitz."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

from dobc_design.conditions.check import Check, Fix, Values, Witness, differs
from dobc_design.conditions.numbers import claimed, largest_proved, shorten
from dobc_design.exact.matrix import Matrix, add, identity, multiply, scale, subtract, transpose
from dobc_design.exact.number import number_text, root_above
from dobc_design.exact.observability import decide_detectable, decide_observable, observable_reduction
from dobc_design.exact.polynomial import decide_hurwitz
from dobc_design.problem.changes import typed_matrix, typed_number
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.groups import blocks_of
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict


def observability_check(exosystem: Exosystem, problem: Problem | None = None) -> Check:
    """Decide whether (A, C) is observable.  A gain of any speed exists iff it is.

    ``problem``, here and below, lets the cure project what it says of the exosystem's states.
    """
    found = decide_observable(exosystem.A, exosystem.C)
    q = exosystem.order
    if found.verdict is Verdict.PROVED:
        return Check(
            id="observability",
            verdict=Verdict.PROVED,
            domain="global",
            reason=f"(A, C) is observable: its observability matrix has rank {found.rank} of {q}.",
            claim=Values({"rank": str(found.rank)}),
        )
    direction = found.unobservable[0]
    return Check(
        id="observability",
        verdict=Verdict.REFUTED,
        domain="global",
        reason=f"(A, C) is not observable: rank {found.rank} of {q}; the states shown never reach the disturbance.",
        claim=Values({"rank": str(found.rank)}),
        witness=Witness(kind="vector", values=tuple(number_text(x) for x in direction)),
        fix=_reduction(exosystem, problem),
    )


def detectability_check(exosystem: Exosystem, problem: Problem | None = None) -> Check:
    """Decide whether (A, C) is detectable: what C never sees has to die out by itself."""
    found = decide_detectable(exosystem.A, exosystem.C)
    polynomial = found.unobservable_text
    if found.verdict is Verdict.PROVED:
        hidden = "nothing is hidden from C" if polynomial == "1" else f"the hidden part {polynomial} decays"
        return Check(
            id="detectability",
            verdict=Verdict.PROVED,
            domain="global",
            reason=f"(A, C) is detectable: {hidden}.",
            claim=Values({"unobservable_polynomial": polynomial}),
        )
    return Check(
        id="detectability",
        verdict=Verdict.REFUTED,
        domain="global",
        reason=f"(A, C) is not detectable: the part {polynomial} of the exosystem never reaches d = C xi and does"
        " not decay, so no gain W can estimate it. It does not act on the agents either: leave it out.",
        claim=Values({"unobservable_polynomial": polynomial}),
        witness=Witness(kind="polynomial", values=(polynomial,)),
        fix=_reduction(exosystem, problem),
    )


def hurwitz_check(
    exosystem: Exosystem,
    W: Matrix | None,
    *,
    estimate: float = 0.0,
    source: str = "given",
    problem: Problem | None = None,
    key: str = "observer.W",
) -> Check:
    """Decide whether A - WC is Hurwitz (Routh over the rationals) and certify a decay rate.

    ``estimate`` (1/s) is a proposed rate from floating point; the exact test decides.  ``key``: where W is given.
    """
    if W is None:
        exists = decide_detectable(exosystem.A, exosystem.C).verdict is Verdict.PROVED
        return Check(
            id="hurwitz",
            verdict=Verdict.UNDECIDED,
            domain="global",
            reason="there is no observer gain W to test: none was given, and none "
            + (f"was found; give one as {key}." if exists else "exists for this exosystem."),
            fix=None if exists else _reduction(exosystem, problem),
        )
    error = error_matrix(exosystem, W)
    table = decide_hurwitz(error)
    if table.verdict is not Verdict.PROVED:
        exists = decide_detectable(exosystem.A, exosystem.C).verdict is Verdict.PROVED
        advice = "Choose another W, or leave W out to have one designed." if exists else "No W does: see detectability."
        given_p = problem is not None and problem.observer.P is not None
        removal = {"observer.W": None} | ({"observer.P": None} if given_p else {})
        return Check(
            id="hurwitz",
            verdict=Verdict.REFUTED,
            domain="global",
            reason=f"A - WC is not Hurwitz: entry {len(table.first_column)} of the first column of Routh's table is"
            f" not positive, so the estimation error does not decay. {advice}",
            witness=Witness(kind="routh_row", values=tuple(number_text(x) for x in table.first_column)),
            fix=Fix(kind="gain", set=removal, text="Remove observer.W (and P, if given): a gain is then designed.")
            if exists
            else _reduction(exosystem, problem),
        )
    rate = largest_proved(estimate, lambda a: hurwitz_with_rate(error, a))
    return Check(
        id="hurwitz",
        verdict=Verdict.PROVED,
        domain="global",
        rate=rate or None,
        reason=f"A - WC is Hurwitz ({source} W): the estimation error decays"
        + (f" at least like exp(-{shorten(rate, digits=4):.4g} t)." if rate else "."),
        claim=Values({"routh": [number_text(x) for x in table.first_column]}),
    )


def confirm(check: Check, problem: Problem, W: Matrix | None) -> str | None:
    """None if everything that a proved or refuted check of the observer claims is confirmed, else what is not.

    ``W`` (q, m): that of all groups.  Raises: ValueError for a group that is not there; what malformed numbers raise.
    """
    exosystem, own_gain = group_of(check.group, problem, W)
    own = {"observability": observability_check, "detectability": detectability_check}.get(check.id)
    wrong = differs(check, hurwitz_check(exosystem, own_gain) if own is None else own(exosystem))
    if wrong is not None:
        return wrong
    if check.margin is not None or (check.rate is not None and check.id != "hurwitz"):
        return "it claims a number that this check does not have"
    if check.rate is None:
        return None
    if own_gain is None or check.verdict is not Verdict.PROVED or check.rate <= 0:
        return "it claims a rate without ground"
    reached = hurwitz_with_rate(error_matrix(exosystem, own_gain), claimed(check.rate))
    return None if reached else f"the rate {check.rate} is not reached"


def group_of(name: object, problem: Problem, W: Matrix | None) -> tuple[Exosystem, Matrix | None]:
    """The exosystem and the gain of the group with this name; of the only one without a name.

    Raises: ValueError if there is none, or if W is not block diagonal.
    """
    groups = problem.groups
    if not problem.is_grouped:
        if name is not None or not groups:
            raise ValueError("there are no groups" if groups else "there is no exosystem")
        return groups[0].exosystem, W
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
    return decide_hurwitz(add(error, scale(rate, identity(len(error))))).verdict is Verdict.PROVED


def observable_part_is_hurwitz(exosystem: Exosystem, W: Matrix) -> bool:
    """Whether the part of A - WC that reaches the agents decays: exact (theory, section 2)."""
    A_o, C_o, T = observable_reduction(exosystem.A, exosystem.C)
    if not A_o:
        return True
    return decide_hurwitz(subtract(A_o, multiply(multiply(T, W), C_o))).verdict is Verdict.PROVED


def _reduction(exosystem: Exosystem, problem: Problem | None) -> Fix:
    """The observable part in place of the exosystem; what the problem says of the old states is projected along."""
    A_o, C_o, T = observable_reduction(exosystem.A, exosystem.C)
    observer = None if problem is None else problem.observer
    xi0 = None if problem is None else problem.simulation.xi0
    change: dict[str, Any] = {}
    if not A_o:
        change["exosystem"] = None
        if observer is not None and (observer.W or observer.P or observer.rate):
            change["observer"] = None
        if xi0 is not None:
            change["simulation.xi0"] = None
        if problem is not None and problem.region is not None and problem.region.initial_disturbance is not None:
            change["region.initial_disturbance"] = None
        if problem is not None and problem.m > 1:  # C no longer says how many components there are
            change["target"] = [typed_number(x) for x in problem.target]
        return Fix(
            kind="exosystem", set=change, text="Remove [exosystem]: C sees nothing of it, so there is no disturbance."
        )
    change |= {"exosystem.A": typed_matrix(A_o), "exosystem.C": typed_matrix(C_o)}
    if observer is not None and observer.W is not None:
        change["observer.W"] = typed_matrix(multiply(T, observer.W))
    if observer is not None and observer.P is not None:
        change["observer.P"] = None
    if xi0 is not None:
        rows = typed_matrix(tuple(tuple(row) for row in multiply(xi0, transpose(T))))
        change["simulation.xi0"] = rows[0] if len(rows) == 1 else rows
    if problem is not None and problem.region is not None and problem.region.initial_disturbance:
        change["region.initial_disturbance"] = typed_number(problem.region.initial_disturbance * _norm_above(T))
    return Fix(
        kind="exosystem",
        set=change,
        text=f"Use the observable part of the exosystem (order {len(A_o)} instead of {exosystem.order}):"
        " it generates the same disturbances.",
    )


def _norm_above(T: Matrix) -> Fraction:
    """A rational number of six decimals that |T| does not exceed: the root of the sum of squares, rounded up."""
    squares = sum((x * x for row in T for x in row), Fraction(0))
    return root_above(squares, unit=10**6)
