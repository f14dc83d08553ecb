"""How a check of each topic is read from a certificate and confirmed: one row per topic of
``conditions/``.  Which ids belong to a topic says ``conditions/kinds.toml``.

What looks for a proof has no column here: a certificate is confirmed without it, and stages import
solvers.  Their order stands in ``certification/certify.py``.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace

from dobc_design._checks import noun
from dobc_design.conditions.accuracy import decide as accuracy
from dobc_design.conditions.arcs import decide as arcs
from dobc_design.conditions.case import Case
from dobc_design.conditions.check import Check, Claim, same_witness
from dobc_design.conditions.consensus import claim as theorems
from dobc_design.conditions.consensus import decide as consensus
from dobc_design.conditions.consensus.claim import Pair, Statements
from dobc_design.conditions.equilibrium import decide as equilibrium
from dobc_design.conditions.graphs import claim as graphs_claimed
from dobc_design.conditions.graphs import decide as graphs
from dobc_design.conditions.kinds import MAX_SEPARABLE
from dobc_design.conditions.linearisation import decide as linearisation
from dobc_design.conditions.margins import decide as margins
from dobc_design.conditions.observer import decide as observer
from dobc_design.conditions.quadratic import decide as quadratic
from dobc_design.conditions.reason import gap_obstacle
from dobc_design.conditions.schedule import checks as schedule
from dobc_design.conditions.separable import checks as separable
from dobc_design.conditions.separable import claim as rows
from dobc_design.conditions.stated import ACCURACY, LIMIT
from dobc_design.conditions.weighted import checks as weighted
from dobc_design.exact.matrix import Matrix
from dobc_design.loop.loop import Loop
from dobc_design.loop.pairs import gain_of_rows, required_rows
from dobc_design.verdict import Verdict


@noun(eq=False)
class Trusted(Case):
    """What a check is confirmed against: the case, with the theorems stated for its loop and the
    pair (P, Q) of the certificate.  The ``checks`` are those of the certificate, not yet read."""

    statements: Statements
    pair: Pair | None


Confirm = Callable[[Check, Trusted], str | None]
Read = Callable[[Check, Loop, Matrix | None], Claim | None]


@noun
class Topic:
    """``confirm`` gives None if a proof or refutation holds, else what does not.  ``read`` turns
    the values of a check into the noun of the topic; None where they stay values.  Both raise
    what a malformed claim raises.  ``of_rows``: it is about the loop whose errors rows bound
    (``loop.pairs``), not about the agents themselves.  ``of_gaps``: it knows errors that are
    distances to where fixed nodes are.  ``of_roots``: it knows agents of which there are too many
    pairs."""

    confirm: Confirm
    read: Read | None = None
    of_rows: bool = True
    of_gaps: bool = False
    of_roots: bool = False

    def about(self, id: str, loop: Loop, W: Matrix | None) -> tuple[Loop, Matrix | None]:
        """The loop that a check is about, and its gain.  Raises: ValueError where it has too many
        nodes."""
        # Inputs are those of agents.
        if not self.of_rows or (loop.agrees and id == LIMIT):
            return loop, W
        rows = required_rows(loop, W)
        if rows.goal == "roots" and not self.of_roots:
            raise ValueError(f"{loop.n} agents have more pairs than are looked at")
        return rows, gain_of_rows(loop, W)

    def confirmed(self, check: Check, trusted: Trusted) -> str | None:
        """None if a check is confirmed for the loop that its topic is about, else why not."""
        if not self.of_gaps and (reason := gap_obstacle(trusted.loop)) is not None:
            return reason
        loop, W = self.about(check.id, trusted.loop, trusted.W)
        return self.confirm(check, replace(trusted, loop=loop, W=W))


def _consensus(check: Check, trusted: Trusted) -> str | None:
    """Reachability, Lemma 1 and the theorems, which an observer that fails refutes as well."""
    is_theorem = check.kind.is_theorem and check.verdict is Verdict.REFUTED
    if is_theorem and (check.exact or {}).get("block") in ("detectability", "hurwitz"):
        return _confirm_obstacle(check, trusted)
    return consensus.confirm(check, trusted.statements, trusted.pair)


def _confirm_obstacle(check: Check, trusted: Trusted) -> str | None:
    """A theorem that is refuted because the observer of one group fails for every pair."""
    if trusted.statements.inapplicable is not None:
        return "the theorems do not apply to this coupling"
    if check.rate is not None or check.margin is not None:
        return "a refuted check must claim no rate and no positive margin"
    exact = check.exact or {}
    block, group = exact["block"], exact.get("group")
    exosystem, W = observer.group_of(group, trusted.loop, trusted.W)
    if block == "detectability":
        own = observer.detectability_check(exosystem)
    else:
        own = observer.hurwitz_check(exosystem, W)
    if own.verdict is not Verdict.REFUTED:
        return f"{block} is {own.verdict.value}"
    given = any(
        group in (each.name, None) and each.observer.W is not None for each in trusted.loop.groups
    )
    if block == "hurwitz" and not given:
        return "another W can be designed, so no pair is ruled out"
    named = {"block": block}
    if group is not None:
        named["group"] = group
    if exact != named or not same_witness(check.witness, own.witness):
        return f"it claims more than that {block} fails"
    return None


def _beside(confirm: Callable[[Check, Case], str | None], *ids: str) -> Confirm:
    """Confirms a check that rests on proofs with these ids, which are read for the loop."""

    def confirmed(check: Check, trusted: Trusted) -> str | None:
        proofs = []
        # Of agents that agree no input rests on a proof of their differences.
        for id in () if trusted.loop.agrees else ids:
            proof = trusted.named(id)
            if proof is None or id == check.id or not proof.is_proved:
                continue
            read = TOPICS[proof.kind.topic].read
            if read is not None:
                proofs.append(replace(proof, claim=read(proof, trusted.loop, trusted.W)))
        return confirm(check, replace(trusted, checks=tuple(proofs)))

    return confirmed


TOPICS: Mapping[str, Topic] = {
    "observer": Topic(
        confirm=lambda check, case: observer.confirm(check, case.loop, case.W),
        of_rows=False,
        of_gaps=True,
    ),
    "consensus": Topic(confirm=_consensus, read=theorems.read_claim, of_rows=False, of_gaps=True),
    "weighted": Topic(
        confirm=lambda check, case: weighted.confirm(
            check, case.loop, case.W, statements=weighted.weighing(case.statements)
        ),
        read=weighted.read_claim,
        of_rows=False,
    ),
    "linearisation": Topic(
        confirm=lambda check, case: linearisation.confirm(check, case.statements, case.W),
        read=theorems.read_claim,
        of_rows=False,
    ),
    "separable": Topic(
        confirm=_beside(separable.confirm, MAX_SEPARABLE), read=rows.read_claim, of_gaps=True
    ),
    "margins": Topic(
        confirm=_beside(margins.confirm, MAX_SEPARABLE, ACCURACY), read=margins.read_claim
    ),
    "arcs": Topic(confirm=arcs.confirm, read=arcs.read_claim),
    "quadratic": Topic(confirm=quadratic.confirm, read=quadratic.read_claim),
    "schedule": Topic(
        confirm=schedule.confirm, read=schedule.read_claim, of_gaps=True, of_roots=True
    ),
    "graphs": Topic(confirm=graphs.confirm, read=graphs_claimed.read_claim, of_roots=True),
    "accuracy": Topic(confirm=accuracy.confirm, read=accuracy.read_claim),
    "equilibrium": Topic(confirm=equilibrium.confirm, read=equilibrium.read_claim),
}
