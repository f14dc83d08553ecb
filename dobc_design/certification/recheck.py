"""Every claim of a certificate decided again, from the trusted problem, by two programs written
apart: ``recheck`` with the package's exact arithmetic, and the lone checker; that they disagree is
itself a failure.  Not checked, because no verdict depends on them: sentences, notes beyond those of
the problem, the program's version, and the advice."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from dobc_design._checks import noun
from dobc_design._show.cards import Card, Shown
from dobc_design.certificate.claims import Claims, Overall, claim_of, failing_words
from dobc_design.certificate.factors import factor_obstacle
from dobc_design.certificate.files import another_problem
from dobc_design.certificate.text import certificate_bytes, read_claims
from dobc_design.certificate.topics import TOPICS, Trusted
from dobc_design.checker import examine as checker
from dobc_design.conditions.accuracy.value import wrong_value
from dobc_design.conditions.check import Check, Checks, withdrawn
from dobc_design.conditions.consensus import decide as consensus
from dobc_design.conditions.consensus.claim import Pair, state_theorems
from dobc_design.conditions.domain import EVERYWHERE, Domain
from dobc_design.conditions.kinds import READINGS, ids_in
from dobc_design.conditions.numbers import MATRIX_BITS, doubles_from_json, is_short
from dobc_design.conditions.reason import open_reason
from dobc_design.conditions.stated import LIMIT
from dobc_design.errors import CertificateError, DobcError, reason_of
from dobc_design.exact.matrix import is_symmetric, multiply
from dobc_design.exact.reading import Texts, shown
from dobc_design.exact.work import last_call
from dobc_design.loop.loop import Loop
from dobc_design.loop.make import loop_of
from dobc_design.loop.pairs import rows_of
from dobc_design.problem.canonical import canonical_bytes, problem_sha256
from dobc_design.problem.groups import blocks_of
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

from .overall import decide_overall, with_verdict

#: Arcs of all modes together (of pairs, where agents agree), and matrix rows, up to which
#: ``verify`` waits for the lone checker, plain Python.
LONE_ARCS, LONE_ROWS = 100_000, 50_000
#: The same, up to which ``certify`` asks it before it writes; and what comes before the checks in
#: its findings.
PROMPT_ARCS = 2000
FIRST = 3
DISAGREE = "it is {} here, but the second checker does not confirm it ({}). {}"
# How the second checker says that it met a limit, not that a claim is wrong.
UNSURE = (
    "not shown",
    "followed here",
    "too many",
    "too large",
    "too long",
    "more than",
    "may be none",
)
#: What a malformed claim raises where it is read or decided.
MALFORMED = (
    DobcError,
    ArithmeticError,
    ValueError,
    TypeError,
    KeyError,
    IndexError,
    AttributeError,
)
#: What the second checker calls the value that agents agree on.
VALUE = "the value agreed upon"
#: Whether a claim holds, and which it is or why it fails.
Finding = tuple[bool, str]
HOW = "python -I -S dobc_design/checker certificate.json problem.json"


@noun
class Recheck(Shown):
    """The outcome of checking a certificate.  ``verdict`` is what the certificate claims; it counts
    if it ``holds``: every claim holds and the verdict follows. ``confirmed`` and ``failures`` list
    the checks by title, the failures with what is wrong.  ``lone_checker`` says what the lone
    checker found."""

    verdict: Verdict
    confirmed: Texts
    failures: Texts
    lone_checker: str = "it was not asked"

    @property
    def holds(self) -> bool:
        """Whether nothing failed."""
        return not self.failures

    def _card(self) -> Card:
        failed = [(text, "NOT confirmed") for text in self.failures]
        confirmed = [(title, "confirmed") for title in self.confirmed]
        text = "Every claim holds."
        if failed:
            text = f"{failing_words(self.failures)}."
        return Card(
            title="Recheck",
            verdict=self.verdict.value if self.holds else None,
            text=text,
            heads=("claim", "outcome"),
            rows=[*failed, *confirmed],
            lines=(f"Second checker: {self.lone_checker}",),
        )

    def __str__(self) -> str:
        head = f"{failing_words(self.failures)}; no verdict is confirmed."
        if self.holds:
            head = f"every claim holds; verdict {self.verdict.value}."
        rows = [head]
        rows += [f"  confirmed: {title}" for title in self.confirmed]
        rows += [f"  NOT confirmed: {text}" for text in self.failures]
        return "\n".join([*rows, f"  second checker: {self.lone_checker}"])


def verify_twice(certificate: Claims | bytes, problem: Problem) -> Recheck:
    """Confirm the claims with ``recheck`` and with the lone checker; both have to accept.  Raises:
    CertificateError if the bytes are no certificate; where only one program can read them the lone
    checker says so, if it is asked."""
    unreadable: CertificateError | None = None
    try:
        own = recheck(certificate, problem)
    except CertificateError as error:
        unreadable = error
        own = Recheck(verdict=Verdict.UNDECIDED, confirmed=(), failures=(str(error),))
    data = certificate if isinstance(certificate, bytes) else certificate_bytes(certificate)
    document = canonical_bytes(problem)
    left_out = _why_not_asked(problem, data, document)
    if left_out is not None:
        if unreadable is not None:
            raise unreadable
        return replace(own, lone_checker=left_out)
    try:
        refusals = [text for holds, text in checker.examine(data, document) if not holds]
    except checker.Refused as error:
        # What neither program can read is no certificate, unless it is about another problem.
        foreign = unreadable is None and read_claims(data).problem_sha256 != problem_sha256(problem)
        if not own.holds and not foreign:
            raise unreadable or CertificateError(
                f"the certificate cannot be read: {error}."
            ) from error
        refusals = [f"it cannot read the files: {error}"]
        if foreign:
            refusals = ["the files do not belong together"]
    said = f"it refuses the certificate; {refusals[0]}" if refusals else "it accepts every claim"
    if own.holds is not bool(refusals):
        return replace(own, lone_checker=said)
    view = "the package refuses, the second checker accepts"
    if refusals:
        view = f"the package accepts, the second checker refuses ({refusals[0]})"
    told = f"two programs that decide the same claims disagree: {view}."
    failure = f"{told} {_what_follows(*refusals)}"
    return replace(own, failures=(*own.failures, failure), lone_checker=said)


def _why_not_asked(problem: Problem, data: bytes, document: bytes) -> str | None:
    """Why the lone checker is not asked about these two files; None if it is."""
    arcs, size = _work_of(loop_of(problem))
    if arcs > LONE_ARCS or size > LONE_ROWS:
        return f"left to you, because it takes long with {arcs} arcs: {HOW}"
    if max(len(data), len(document)) > checker.MAX_BYTES:
        return f"it reads files of at most {checker.MAX_BYTES} bytes, these are larger"
    return None


def _work_of(loop: Loop) -> tuple[int, int]:
    """Arcs of all modes together, and rows; of pairs, where agents agree."""
    if loop.agrees:
        loop = rows_of(loop, None) or loop
    return loop.arc_count, loop.size


def _what_follows(*refusals: str) -> str:
    if refusals and all(any(words in text for words in UNSURE) for text in refusals):
        return "The second checker reached its limits; the claim may still be true."
    return "One of them is wrong; please report it."


def agreed(claims: Claims, problem: Problem) -> Claims:
    """What both programs confirm of claims just made: what the lone checker refuses becomes
    undecided."""
    loop = loop_of(problem)
    if max(_work_of(loop)) > PROMPT_ARCS:
        return claims
    document, domain = canonical_bytes(problem), state_theorems(loop).domain
    while True:  # what rests on a check that is withdrawn falls in the next round
        data = certificate_bytes(claims)
        if max(len(data), len(document)) > checker.MAX_BYTES:
            return claims
        found = _second_findings(data, document)
        # What it says of each check, of fewer where its time ran out; where it refuses the files
        # as a whole, that.
        whole = _first_refusal(found[:FIRST])
        count = len(claims.checks)
        said = [(False, whole)] * count if whole else found[FIRST : FIRST + count]
        checks = _without_refused(claims.checks, said, domain)
        if checks is None:
            break
        # P and Q belong to a proof, and go with it.
        pair = _theorem_is_proved(checks)
        claims = replace(
            claims, checks=checks, P=claims.P if pair else None, Q=claims.Q if pair else None
        )
        claims = with_verdict(claims, decide_overall(loop, checks, claims.W))
    left = [each for each in claims.checks[len(said) :] if each.verdict is not Verdict.UNDECIDED]
    if left:
        names = dict.fromkeys(check.id for check in left)
        told = f"Time ran out before the second checker was asked about {', '.join(names)}"
        note = f"{told}: `dobc verify` asks it about the whole certificate."
        claims = replace(claims, notes=(*claims.notes, note))
    # No check is refused by now; what is left is about the file or the verdict as a whole.
    lacking = _first_refusal(found)
    if lacking is not None and lacking.startswith(VALUE):  # the last claim: all others hold
        return replace(claims, value=None)
    if lacking is None or claims.verdict is Verdict.UNDECIDED:
        return claims
    why = open_reason(_disagrees(claims.verdict, lacking))
    return with_verdict(claims, Overall(verdict=Verdict.UNDECIDED, why=why))


def _second_findings(data: bytes, document: bytes) -> list[Finding]:
    """What the second checker says, as far as the time goes."""
    try:
        return checker.examine(data, document, until=last_call() or math.inf)
    except checker.Refused as error:
        return [(False, f"it cannot read the files: {error}")]


def _first_refusal(found: Sequence[Finding]) -> str | None:
    """What the second checker refuses first, in words."""
    return next((text for holds, text in found if not holds), None)


def _without_refused(
    checks: Checks, said: Sequence[Finding], domain: Domain
) -> tuple[Check, ...] | None:
    """The checks, decided ones that are refused as undecided; None if that is none of them."""
    kept = list(checks)
    refused = False
    for place, (holds, text) in enumerate(said):
        check = checks[place]
        if not holds and check.verdict is not Verdict.UNDECIDED:
            kept[place] = withdrawn(check, domain, _disagrees(check.verdict, text))
            refused = True
    return tuple(kept) if refused else None


def _disagrees(verdict: Verdict, refusal: str) -> str:
    return DISAGREE.format(verdict.value, refusal, _what_follows(refusal))


def _theorem_is_proved(checks: Iterable[Check]) -> bool:
    """Whether the pair (P, Q) of a certificate belongs to a proof."""
    return any(check.kind.is_theorem and check.is_proved for check in checks)


def recheck(certificate: Claims | bytes, problem: Problem) -> Recheck:
    """Confirm the claims one by one, then that the verdict follows from those confirmed.  Raises:
    CertificateError."""
    loop = loop_of(problem)
    claims = read_claims(certificate) if isinstance(certificate, bytes) else certificate
    failures = _foreign_parts(claims, problem)
    if not failures:
        failures += _matrix_failures(claims, loop)
    confirmed: list[Check] = []
    if not failures:
        trusted = trust(claims, loop)
        for check in claims.checks:
            try:
                reason = confirm(check, trusted) or factor_obstacle(check, trusted)
                if reason is None:
                    confirmed.append(replace(check, claim=claim_of(check, loop, claims.W)))
            except MALFORMED as error:
                reason = f"it cannot be evaluated ({reason_of(error)[:120]})"
            if reason is not None:
                failures.append(f"{check.title}: {reason}")
        failures += _overall_failures(claims, loop, confirmed)
        failures += _value_failures(claims, loop)
    return Recheck(
        verdict=claims.verdict,
        confirmed=tuple(check.title for check in confirmed),
        failures=tuple(failures),
    )


def _value_failures(claims: Claims, loop: Loop) -> Iterator[str]:
    """What is wrong with the value that agents agree on."""
    if claims.value is None:
        return
    reason: str | None = "agreement is not proved"
    if claims.verdict is Verdict.PROVED:
        try:
            reason = wrong_value(loop, claims.W, claims.value)
        except MALFORMED as error:
            reason = f"it cannot be evaluated ({reason_of(error)[:120]})"
    if reason is not None:
        yield f"{VALUE}: {reason}"


def _foreign_parts(claims: Claims, problem: Problem) -> list[str]:
    """What is not about this problem, or stands there twice."""
    failures = []
    if claims.problem_sha256 != problem_sha256(problem):
        names = another_problem(claims.problem_name, problem.name)
        if claims.problem_name != problem.name:
            names += f", and not about {shown(problem.name)}"
        # All that follows would differ for this one reason.
        cure = "give the problem that it was made for"
        return [f"problem: the certificate is about {names} (its hash differs); {cure}"]
    if claims.problem_name != problem.name:
        failures.append("problem: its name is not what it says")
    if claims.notes[: len(problem.notes)] != problem.notes:
        failures.append("notes: those of the problem are missing or changed")
    found = [(check.id, check.mode, check.group) for check in claims.checks]
    if len(set(found)) != len(found):  # one that is expensive could stand there a thousand times
        failures.append("checks: a check stands there twice")
    return failures


def trust(claims: Claims, loop: Loop) -> Trusted:
    """What the claims are confirmed against, with the vectors v > 0 that proved checks of Lemma 1
    bring."""
    pair = None if claims.P is None or claims.Q is None else Pair(P=claims.P, Q=claims.Q)
    # Nothing is believed of a vector: it only says where to look, and is multiplied out.
    statements = state_theorems(loop)
    vectors = {}
    for check in claims.checks:
        if not check.kind.is_lemma or not check.is_proved:
            continue
        exact = check.exact
        if exact is not None and set(exact) == {"v"}:
            try:
                vector = doubles_from_json(exact["v"])
            except (TypeError, ValueError):
                continue
            if len(vector) == loop.n * loop.m and check.mode in statements.lambdas:
                vectors[str(check.mode)] = vector
    statements = consensus.with_vectors(statements, vectors)
    return Trusted(
        loop=loop,
        W=claims.W,
        domain=statements.domain,
        checks=claims.checks,
        statements=statements,
        pair=pair,
    )


def expected_checks(loop: Loop) -> tuple[tuple[str, str | None, str | None], ...]:
    """The (id, mode, group) of the checks that every complete certificate holds; regional ones may
    stand beside."""
    modes, observer_ids = tuple(loop.modes), ids_in("observer")
    theorem = "theorem2" if loop.switches else "theorem1"
    theorems = [f"{theorem}-printed", theorem] if loop.joint_observer.P is not None else [theorem]
    names = [group.name if loop.is_grouped else None for group in loop.groups]
    return (
        *((id, None, name) for name in names for id in observer_ids),
        *((id, mode, None) for id in ("reachability", "lemma1") for mode in modes),
        *((id, None, None) for id in theorems if loop.groups),
    )


def confirm(check: Check, trusted: Trusted) -> str | None:
    """None if everything the check claims is confirmed, else what is not.  Raises what a malformed
    claim raises. Nothing is believed: matrices are rebuilt, witnesses multiplied out, margins and
    rates proved as they are written. A proof may claim less than is true (a smaller margin or rate,
    "undecided"), never more."""
    loop, domain = trusted.loop, trusted.domain
    expected = (check.id, check.mode, check.group) in expected_checks(loop)
    if not expected and (check.group is not None or check.kind.topic in ("observer", "consensus")):
        return f"{check.title} does not belong to this problem"
    if not expected and (check.mode is not None or check.margin is not None):
        return "a regional check has no mode and no margin"
    wanted = EVERYWHERE if check.kind.role == "part" else domain
    if (expected or not check.is_proved) and check.domain != wanted:
        # a proof for a region names its starts; every other domain is known
        return f"the domain must be '{wanted}'"
    # What nobody decided has nothing that others could rest on.
    if check.verdict is Verdict.UNDECIDED:
        claims = (check.margin, check.rate, check.factor, check.claim, check.witness)
        if any(part is not None for part in claims):
            return "an undecided check must claim nothing"
        return None
    known = (READINGS, LIMIT if loop.saturates else "equilibrium")
    if loop.is_sampled and check.kind.role != "part" and check.id not in known:
        return "everything is computed from samples, and it is about a flow"
    return TOPICS[check.kind.topic].confirmed(check, trusted)


def _matrix_failures(claims: Claims, loop: Loop) -> list[str]:
    """W must be the problem's own where it has one, P symmetric, and Q = P W; of several groups,
    block diagonal."""
    failures = _size_failures(claims, loop)
    if failures:
        return failures
    # Another W than the file's would be a proof about another loop.
    own = loop.joint_observer.W
    if own not in (None, claims.W):
        failures.append("W: not the gain of the problem")
    if loop.is_grouped:
        failures += _block_failures(claims, loop)
    source = None
    if claims.W is not None:
        source = "designed" if own is None else "given"
    if claims.gain_source != source:
        failures.append("W: its source is not what it says")
    if (claims.P is None) != (claims.Q is None):
        failures.append("P, Q: one of them is missing")
    elif claims.P is not None and claims.Q is not None:
        if not is_symmetric(claims.P):
            failures.append("P: not symmetric")
        elif claims.W is None or multiply(claims.P, claims.W) != claims.Q:
            failures.append("Q: not equal to P W")
    return failures


def _size_failures(claims: Claims, loop: Loop) -> list[str]:
    """Shapes that do not fit; else the first matrix whose entries take too long to decide about."""
    q, outputs = loop.q, loop.m * max(1, len(loop.groups))
    shapes = {"W": (claims.W, (q, outputs)), "P": (claims.P, (q, q)), "Q": (claims.Q, (q, outputs))}
    failures = []
    # Shapes first: what follows multiplies these matrices.
    for name, (matrix, shape) in shapes.items():
        if matrix is not None and (len(matrix), len(matrix[0])) != shape:
            failures.append(f"{name}: expected shape {shape}")
    if failures:
        return failures
    designed = claims.W if loop.joint_observer.W is None else None
    for name, matrix in (("P", claims.P), ("W", designed)):
        if matrix is not None and not is_short(matrix):
            return [
                f"{name}: its entries need a common denominator of more than {MATRIX_BITS} bits"
            ]
    return []


def _block_failures(claims: Claims, loop: Loop) -> list[str]:
    """Where agents have different exosystems: P and W have a block for each group, and a gain that
    is given stands in its block."""
    # An entry between two groups would let one observer read the states of another.
    orders = [group.exosystem.order for group in loop.groups]
    failures = []
    if claims.P is not None and blocks_of(claims.P, [(each, each) for each in orders]) is None:
        failures.append("P: not block diagonal")
    if claims.W is None:
        return failures
    blocks = blocks_of(claims.W, [(each, loop.m) for each in orders])
    if blocks is None:
        return [*failures, "W: not block diagonal"]
    for group, block in zip(loop.groups, blocks, strict=True):
        if group.observer.W not in (None, block):
            return [*failures, "W: not the gains of the problem"]
    return failures


def _overall_failures(claims: Claims, loop: Loop, confirmed: Checks) -> list[str]:
    found = [(check.id, check.mode, check.group) for check in claims.checks]
    lacking = [each for each in expected_checks(loop) if each not in found]
    missing = [
        f"{id} ({mode or f'group of {group}'})" if mode or group else id
        for id, mode, group in lacking
    ]
    if missing:
        return [f"verdict: the certificate lacks {', '.join(missing)}"]
    failures = []
    if claims.P is not None and not _theorem_is_proved(claims.checks):
        failures.append("P, Q: they belong to no proof")
    # Only what was confirmed counts, so that a forged proof cannot carry the verdict.
    overall = decide_overall(loop, confirmed, claims.W)
    if overall.verdict is not claims.verdict:
        failures.append(
            f"verdict: {claims.verdict.value} does not follow from the confirmed checks "
            f"({overall.verdict.value} does)"
        )
    if (overall.rate, overall.factor, overall.covered_by) != (
        claims.rate,
        claims.factor,
        claims.covered_by,
    ):
        failures.append("rate, factor, covered_by: not what the confirmed checks give")
    return failures
