"""Checks of weighted Theorems 1 and 2: from a claim to a check of a certificate, and back."""

from functools import partial

from dobc_design.conditions.check import Check, Claim, read_parts, undecided_check
from dobc_design.conditions.consensus.claim import Statements, state_theorems
from dobc_design.conditions.numbers import (
    claimed,
    form_from_json,
    read_rational,
    text_below,
    vector_from_json,
)
from dobc_design.conditions.reason import Reason
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.reading import Document
from dobc_design.loop.loop import Loop
from dobc_design.loop.pairs import required_rows
from dobc_design.verdict import Verdict

from .decide import Weighted, why_not
from .network import Alike, network_of


def id_for(loop: Loop) -> str:
    """The id of the check: one mode, or several."""
    return "theorem2-weighted" if loop.switches else "theorem1-weighted"


def read_claim(check: Check, loop: Loop, W: Matrix | None) -> Claim:
    """What a proved check of this topic claims, for this problem."""
    alike = "R" in (check.exact or {})
    # With R the weights are those of a network with one component.
    vector = partial(vector_from_json, size=loop.n if alike else loop.n * loop.m)
    # One D serves all modes, each has a w of its own.
    shape: Document = {"D": vector, "w": dict.fromkeys(loop.modes, vector)}
    if alike and (loop.agrees or loop.is_apart):
        shape = {}
    if alike:
        shape |= {"c": read_rational, "R": form_from_json}
    elif loop.groups:
        shape["P"] = form_from_json
    values = read_parts(check.exact, shape)
    if not alike:
        return Weighted(**{"P": None} | values)
    strength, R = values.pop("c"), values.pop("R")
    weights = Weighted(P=None, **values) if values else None
    return Alike(weights=weights, strength=strength, R=R)


def weighted_check(
    statements: Statements, W: Matrix | None, claim: Weighted | Alike | None, *, rate: float
) -> Check:
    """The check of a proposed claim at a proposed rate (1/s, as it is written): proved, or
    undecided."""
    id = id_for(statements.loop)
    undecided = partial(undecided_check, id, statements.domain)
    reason = why_not(statements)
    # Agents with dynamics that feel their neighbours alike may still have the other form.
    alike = isinstance(claim, Alike)
    if reason is not None and not alike and isinstance(network_of(statements), Reason):
        return undecided(reason, applies=False)
    if claim is None or not claim.holds(statements, W, rate=claimed(rate)):
        form = "form R was" if statements.loop.agrees else "weights D were"
        return undecided(f"no {form} found for which the condition is proved.")
    V = "e'(D (x) R)e" if alike else "e'De"
    if statements.loop.agrees:
        V = "e'((D - pi pi') (x) R)e"
    if statements.loop.groups:
        V += " + sum eps_i' P eps_i"
    pace = f", V' <= -2 ({text_below(rate)}) V" if rate else ""
    return Check(
        id=id,
        verdict=Verdict.PROVED,
        domain=statements.domain,
        rate=rate or None,
        claim=claim,
        reason=f"V = {V} with a weight for each agent decreases {statements.where}{pace}.",
    )


def weighing(statements: Statements) -> Statements:
    """What weights are proved for: with signs the rows, since e'D M e with signs is at least that
    of |e| without."""
    loop = statements.loop
    return state_theorems(required_rows(loop, None)) if loop.signed else statements


def confirm(check: Check, loop: Loop, W: Matrix | None, *, statements: Statements) -> str | None:
    """None if the claim of a proved check holds, else what does not.  Raises what a malformed claim
    raises."""
    claim = read_claim(check, loop, W)
    if not check.is_proved or check.witness is not None:
        return "this check is proved or undecided, without a witness"
    if check.id != id_for(loop):
        return f"with these modes the theorem is {id_for(loop)}"
    if check.domain != statements.domain:
        return f"the domain must be {str(statements.domain)!r}"
    if check.rate is not None and check.rate <= 0:
        return "a rate must be > 0"
    if not isinstance(claim, Alike):
        reason = why_not(statements)
        if reason is not None:
            return reason
    rate = claimed(check.rate or 0.0)
    if not isinstance(claim, Weighted | Alike) or not claim.holds(statements, W, rate=rate):
        return "the rows N w > 0 do not hold with that rate"
    return None
