"""What `safety` and `markov` claim, and its JSON (theory, sections 5, 6 and 11).

safety: V = max |e_ic| + kappa E never grows while V <= rho, for every graph, also one that moves;
or decays at a rate.

markov, of the Markov chain of [switching] and whatever its first mode; A_p = J_p - K, g its
generator:

almost sure   V as above never grows, and modes that the chain does not leave reach every agent:
              all errors decay.
mean          w_p > 0 for every mode, A_p'w_p + sum_q g_pq w_q <= -rate w_p, A_p with what the
              gains hold at least: E[sum w_i |e_i|] decays at the rate (up to what the estimation
              error adds, which decays faster).
mean square   P_p > 0 for every mode, A_p'P_p + P_p A_p + sum_q g_pq P_q + 2 rate P_p < 0:
              E[e'P e] at twice the rate.
"""

from collections.abc import Mapping
from fractions import Fraction
from functools import partial

from dobc_design._checks import noun
from dobc_design.conditions.check import Check, Values, read_parts
from dobc_design.conditions.numbers import (
    fields_to_json,
    form_from_json,
    rational_or_none,
    read_rational,
    vector_from_json,
    vector_to_json,
)
from dobc_design.conditions.schedule.claim import Cycles
from dobc_design.conditions.separable.claim import error_of, observed_in
from dobc_design.exact.matrix import Matrix, Vector
from dobc_design.exact.reading import Document
from dobc_design.exact.symmetric import Doubles
from dobc_design.loop.loop import Loop
from dobc_design.verdict import Verdict

SURE = "almost sure"
MEAN = "mean"
SQUARE = "mean square"
HOW = {SURE: "almost surely", MEAN: "in the mean", SQUARE: "in mean square"}


@noun
class Kept:
    """A claim as above: ``kind`` "" for safety; ``box`` has rho and the observer's part; ``w`` or
    ``P`` by mode."""

    kind: str = ""
    rate: Fraction | None = None
    box: Cycles | None = None
    w: Mapping[str, Vector | Doubles] | None = None
    P: Mapping[str, Matrix] | None = None

    def to_json(self) -> Document:
        values: Document = {}
        if self.kind:
            values["kind"] = self.kind
        if self.box is not None:
            values |= self.box.to_json()
            # v = 1 throughout, and the rate is the one below.
            del values["phases"]
            del values["rate"]
        if self.kind != SURE:
            values |= fields_to_json(self, "rate")
        if self.w is not None:
            values["w"] = {mode: vector_to_json(v) for mode, v in self.w.items()}
        if self.P is not None:
            values |= fields_to_json(self, "P")
        return values


def read_claim(check: Check, loop: Loop, W: Matrix | None) -> Kept | Values:
    """What a check of this topic claims, for this problem; a refutation: modes that are never
    left."""
    exact = check.exact or {}
    if check.verdict is Verdict.REFUTED:
        return Values(exact)
    kind = "" if check.kind.role == "safety" else exact["kind"]
    if kind in ("", SURE):
        return _box_from_json(exact, kind, loop)
    own = {MEAN: ("w", partial(vector_from_json, size=loop.n)), SQUARE: ("P", form_from_json)}
    name, shape = own[kind]
    each = dict.fromkeys(loop.modes, shape)
    return Kept(**read_parts(exact, {"kind": None, "rate": read_rational, name: each}))


def _box_from_json(data: object, kind: str, loop: Loop) -> Kept:
    """A claim with v = 1, which has a rate only for safety."""
    own = {"kind": None} if kind else {"rate": rational_or_none}
    values = read_parts(data, {"rho": rational_or_none} | own | observed_in(loop))
    box = Cycles(phases=(), rate=None, rho=values.pop("rho"), error=error_of(values))
    return Kept(kind=kind, rate=values.get("rate"), box=box)


def signals_in_words(loop: Loop, check: Check) -> str:
    """For which signals a proof holds, and in which sense: "for ..."; nothing where there is one
    graph."""
    if check.id == "schedule" and loop.guarantee.phases:
        return f"for {loop.guarantee.in_words()}"
    if check.id == "markov":
        kind = str((check.exact or {}).get("kind"))
        return f"{HOW.get(kind, HOW[SURE])} for the Markov signal, whatever its first mode"
    if check.kind.role == "safety":
        return "for every graph and every motion"
    return "under arbitrary switching of the modes" if loop.switches else ""
