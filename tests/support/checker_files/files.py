"""Certificates and problems for the lone checker: good ones, and bad ones that are wrong in one
place each.

Every bad one is as consistent as a forger could make it: but for that one place nothing in it is
wrong, so that it is accepted by a checker that leaves the check of this place out.
"""

import base64
import hashlib
import json
import shutil
import struct
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, partial, wraps
from pathlib import Path
from typing import Any

import sympy as sp
from certified import certified, consensus_claims, without_region
from texts import matrix, vector

from dobc_design import Exosystem, Network, Observer, Problem
from dobc_design.certificate.text import certificate_bytes
from dobc_design.certification.recheck import recheck
from dobc_design.checker import examine as checker
from dobc_design.checker.files import Problem as Stated
from dobc_design.checker.loop import Loop
from dobc_design.errors import CertificateError, SpecError
from dobc_design.problem.canonical import canonical_bytes, problem_from_canonical

Document = dict[str, Any]
HOLDS, FAILS, UNREADABLE = 0, 1, 2
GONE = object()
EACH_OTHER = [[1, 2], [2, 1]]
NOTHING: Document = {
    "verdict": "undecided",
    "margin": None,
    "rate": None,
    "exact": GONE,
    "witness": GONE,
}
NOTHING |= {"factor": GONE}
OPEN: Document = {"verdict": "undecided", "rate": None, "factor": None, "covered_by": None}
SAYS_NOTHING: Document = {}
LEFT_OPEN = ("", OPEN)
OPEN_THEOREM = ("theorem1", NOTHING)
OPTIONAL = ("theorem1-weighted", "tolerance")
NO_PAIR = {"P": None, "Q": None}
NO_GAIN = ("observer", dict.fromkeys(("W", "source", "P", "Q")))


def second_loop(problem: Problem) -> Loop:
    """The loop of a problem, as the second program makes it of its file."""
    return Loop(Stated(canonical_bytes(problem)))


@dataclass(frozen=True)
class Case:
    """What is handed to the checker, and the exit code it has to give."""

    name: str
    certificate: bytes
    problem: bytes
    code: int


def outcome(certificate: bytes, problem: bytes) -> int:
    """The exit code that the lone checker has for these files."""
    try:
        if all(holds for holds, _ in checker.examine(certificate, problem)):
            return HOLDS
        return FAILS
    except checker.Refused:
        return UNREADABLE


def accepted_by(document: dict[str, object], problem: Problem) -> tuple[bool, bool]:
    """Whether the package and the lone checker accept; what cannot be read is refused."""
    data = json.dumps(document).encode()
    package = False
    with suppress(CertificateError):
        package = recheck(data, problem).holds
    return package, outcome(data, canonical_bytes(problem)) == HOLDS


@cache
def _read(problem: bytes) -> Problem:
    return problem_from_canonical(problem)


def accepted_by_package(case: Case) -> bool:
    with suppress(CertificateError, SpecError):
        return recheck(case.certificate, _read(case.problem)).holds
    return False


#: What a check may carry beside ``exact``, and need not.
BESIDE_EXACT = ("factor", "fix", "group", "mode", "witness")


def changed(check: Document, **changes: Any) -> Document:
    """The check with changes of it or of ``exact``; ``own`` is the rate in there."""
    copied: Document = json.loads(json.dumps(check))
    exact = copied.get("exact", {})
    for key, value in changes.items():
        if key == "own":
            exact["rate"] = value
        elif key in check or (key in BESIDE_EXACT and key not in exact):
            bend(copied, {key: value})
        else:
            bend(exact, {key: value})
    return copied


@dataclass(frozen=True)
class Forger:
    """Makes the cases of a file of problems that have names.

    ``make`` takes a name, an exit code, what is special and the checks that are put into the
    certificate; words beside these are put into the whole.  ``change`` gives a check with some
    places changed, and ``title`` says what stands before them in the name of a case.
    """

    make: Callable[..., Case]
    change: Callable[..., Document] = changed
    title: Callable[[Document], str] = lambda check: "with"

    def holds(self, name: str, what: str, *checks: Document | None, **overall: Any) -> Case:
        return self.make(name, HOLDS, what, *checks, **overall)

    def fails(self, name: str, what: str, *checks: Document | None, **overall: Any) -> Case:
        return self.make(name, FAILS, what, *checks, **overall)

    def wrong(
        self,
        name: str,
        check: Document,
        what: str = "",
        *,
        beside: Sequence[Document] = (),
        says: Document = SAYS_NOTHING,
        **changes: Any,
    ) -> Case:
        """The check after those of ``beside``, false by these changes."""
        what = what or f"{self.title(check)} {str(changes)[:60]}"
        return self.fails(name, what, *beside, self.change(check, **changes), **says)

    def each_wrong(
        self,
        name: str,
        check: Document,
        *,
        beside: Sequence[Document] = (),
        says: Document = SAYS_NOTHING,
        **values: Any,
    ) -> Iterator[Case]:
        """The check with one of the values at a time, of which none holds."""
        for key, some in values.items():
            for value in some:
                yield self.wrong(name, check, beside=beside, says=says, **{key: value})


def collected(cases: Callable[[], Iterator[Case]]) -> Callable[[], list[Case]]:
    """A decorator: all cases in a list, made when it is asked for first."""

    @cache
    @wraps(cases)
    def made() -> list[Case]:
        return list(cases())

    return made


def misjudged(cases: list[Case]) -> list[str]:
    """The names of the cases that get another exit code."""
    found = []
    for case in cases:
        if outcome(case.certificate, case.problem) != case.code:
            found.append(case.name)
    return found


def alone(folder: Path, certificate: bytes, problem: bytes) -> subprocess.CompletedProcess[str]:
    """Run a copy of the checker's folder by another name, without site packages and without the
    package."""
    package = Path(checker.__file__).parent
    shutil.copytree(package, folder / "lone", ignore=shutil.ignore_patterns("__pycache__"))
    (folder / "certificate.json").write_bytes(certificate)
    (folder / "problem.json").write_bytes(problem)
    command = [sys.executable, "-I", "-S", "lone", "certificate.json", "problem.json"]
    return subprocess.run(
        command, cwd=folder, capture_output=True, text=True, check=False, timeout=120
    )


def network(arcs: Any = EACH_OTHER, agents: Any = None) -> Network:
    return Network.from_arcs(arcs, arrow="listens_to", agents=agents)


def scalar(a: Any, c: Any = 1) -> Exosystem:
    return Exosystem(A=[[a]], C=[[c]])


@cache
def problems() -> dict[str, Problem]:
    """One problem for every rule of the format page."""
    pair = network()
    line = network([[2, 1]])
    chain = [[i + 1, i] for i in range(1, 25)]

    def held(coupling: Any = "y", gains: Any = 1, network: Network = pair, **more: Any) -> Problem:
        return Problem(network=network, coupling=coupling, gains=gains, **more)

    def observed(W: Any, P: Any = None, exosystem: Exosystem | None = None, **more: Any) -> Problem:
        observer = Observer(W=W, P=P)
        return held(exosystem=exosystem or scalar(0), observer=observer, **more)

    def asked(gain: Any, *states: list[int]) -> Problem:
        region = {"initial_states": list(states)}
        return held("y", {1: gain}, line, target=[0, 0], region=region)

    half = {1: "1/2", 2: "1/2"}
    made: dict[str, Problem] = {}
    made["paper"] = without_region("paper-fixed")
    made["plain"] = held("2*y", {1: 3}, notes=["a note"])
    made["curved"] = held("exp(y) - 1 + y", {1: 3, 2: 3})
    made["designed"] = held(exosystem=scalar(0))
    made["given"] = observed([[2]])
    made["good P"] = observed([[2]], [[1]])
    made["small P"] = observed([[2]], [["1/100"]])
    made["negative P"] = observed([[2]], [[-1]])
    made["wrong P"] = observed(
        matrix("16/5; 12/5"),
        [[1, 0], [0, 100]],
        Exosystem(A=matrix("0 2; -2 0"), C=matrix("1 0")),
    )
    made["bad W"] = observed([[-1]])
    made["hidden"] = observed([[1]], exosystem=scalar(0, 0))
    faint = Exosystem(A=matrix("0 1 0; 0 0 0; 0 0 1"), C=matrix("0 1 0"))
    made["faint"] = held(exosystem=faint)
    calm = {"initial_states": [-1, 1], "initial_disturbance": 0}
    made["calm bad W"] = observed([[-1]], coupling="tanh(y)", region=calm)
    made["loose"] = held("2*y", None)
    chain_of_three = network([[2, 1], [3, 2]])
    made["far"] = held(gains={2: 1}, network=chain_of_three)
    first_component = [[1, 0], [0, 0]]
    made["far, two components"] = asked(first_component, [-1, 1], [-1, 1])
    slanting = [[1, -1], [-1, 1]]
    beside_it = [-2, -1]
    made["slanted"] = asked(slanting, [1, 2], beside_it)
    made["beside"] = asked([[1, 0], [0, 0]], [1, 2], [-1, 1])
    made["only 0"] = asked([[1, 0], [0, 0]], [-1, 1], [0, 0])
    one_sided = {"initial_states": [-1, 1]}
    made["empty box"] = held(gains=None, offsets={2: 5}, region=one_sided)
    one_point = {"initial_states": [0, 0]}
    made["point box"] = held(gains=None, region=one_point)
    made["unstable"] = held("-y", half)
    made["unstable, elsewhere"] = held("-y", half, region={"initial_states": [0, 1]})
    made["unstable, irrational"] = held("-exp(1)*y", half)
    many = network([], agents=61)
    made["unstable, large"] = held(gains={1: 1}, network=many)
    wide_ring = network([[i + 1, (i + k) % 61 + 1] for i in range(61) for k in (1, 60)])
    repelled = {(0, 1): "-3*y", (1, 0): "-3*y"}
    made["repelled, large"] = held(network=wide_ring, exceptions=repelled)
    two_arcs = network([[2, 1], [3, 2]])
    made["not normal"] = held("5*y", {1: "1/2"}, two_arcs)
    made["kinked"] = held("abs(y)")
    made["regional"] = held("tanh(y)", region={"initial_states": [-1, 1]})
    one_arc = [[2, 1]]
    two_modes = network({"A": EACH_OTHER, "B": one_arc})
    made["two modes"] = held(gains={1: 4}, network=two_modes)
    ring_arcs = [[i + 1, (i + k) % 25 + 1] for i in range(25) for k in (1, 24)]
    made["ring"] = held(gains={1: 1}, network=network(ring_arcs))
    all_held = dict.fromkeys(range(1, 26), 5)
    made["large"] = held("sqrt(2)*y", all_held, network(chain))
    all_weakly_held = dict.fromkeys(range(1, 26), 1)
    made["long"] = held("y", all_weakly_held, network(chain))
    return made


#: Whose certificates say all that `certify` says; those of the others speak of the consensus alone.
WHOLE = ("paper", "regional")


@cache
def _originals() -> dict[str, tuple[bytes, bytes]]:
    found = {}
    for name, problem in problems().items():
        claims = certified(problem).claims if name in WHOLE else consensus_claims(problem)
        found[name] = certificate_bytes(claims), canonical_bytes(problem)
    return found


@cache
def cases() -> list[Case]:
    """All of them, the good ones first; those that take long come last."""
    good = []
    for name, (data, problem) in _originals().items():
        good.append(Case(name, data, problem, HOLDS))
    return [*good, *_bent_claims(), *_bent_frames(), *_bent_problems(), *_other_bytes()]


def document(name: str) -> Document:
    return dict(json.loads(_originals()[name][0]))


def check_of(document: Document, id: str) -> Document:
    """The first check of that id."""
    return next(each for each in document["checks"] if each["id"] == id)


def bend(holder: Document, changes: Document) -> None:
    for key, value in changes.items():
        if value is GONE:
            holder.pop(key, None)
        else:
            holder[key] = value


def fastest_proof(document: Document, ids: Sequence[str]) -> Document | None:
    """The proved check with the largest rate among these ids, the first of several."""
    proofs = [
        each for each in document["checks"] if each["id"] in ids and each["verdict"] == "proved"
    ]
    return max(proofs, key=lambda each: each["rate"] or 0, default=None)


def conclude(document: Document, proof: Document | None, *, refuted: bool) -> None:
    """The verdict that this proof gives, or without one that somebody has ``refuted`` it."""
    document |= {"verdict": "undecided", "rate": None, "covered_by": None}
    if proof is not None:
        document |= {"verdict": "proved", "rate": proof["rate"], "covered_by": proof["id"]}
    elif refuted:
        document["verdict"] = "refuted"


def bare(document: Document) -> Document:
    """Without the optional checks, each of which would fail, or decide, by itself."""
    kept = [each for each in document["checks"] if each["id"] not in OPTIONAL]
    return document | {"checks": kept}


def bent(
    name: str,
    *changes: tuple[str, Document],
    code: int = FAILS,
    what: str = "",
    optional: bool = True,
) -> Case:
    """The certificate of a problem with changes: of a check by its id, of "observer", or of the
    whole ("")."""
    copied = document(name)
    if not optional:
        copied = bare(copied)
    titles = []
    for place, values in changes:
        if place == "":
            holder = copied
        elif place == "observer":
            holder = copied["observer"]
        else:
            holder = check_of(copied, place)
        bend(holder, values)
        titles.append(f"{place}: {', '.join(values)}")
    title = what or " and ".join(titles)
    copied_text = json.dumps(copied).encode()
    problem_bytes = _originals()[name][1]
    return Case(f"{name}: {title}", copied_text, problem_bytes, code)


def forged(name: str, place: str, what: str = "", *, code: int = FAILS, **changes: Any) -> Case:
    """The certificate of a problem with changes in this one place."""
    return bent(name, (place, changes), code=code, what=what)


def without_proof(name: str, *changes: tuple[str, Document], what: str) -> Case:
    """The certificate without its optional checks, which says that the question is open."""
    return bent(name, *changes, LEFT_OPEN, what=what, optional=False)


def _witness(values: str, labels: str | None = None, kind: str = "vector") -> Document:
    """Texts of numbers and of labels."""
    if labels is None:
        return {"kind": kind, "values": vector(values)}
    return {"kind": kind, "labels": vector(labels), "values": vector(values)}


def doubles(*numbers: float) -> Document:
    """A vector as a certificate holds many of them."""
    packed = struct.pack(f"<{len(numbers)}d", *numbers)
    return {"float64": base64.b64encode(packed).decode()}


def _bent_claims() -> Iterator[Case]:
    yield from _bent_facts()
    yield from _bent_proofs()
    yield from _bent_pairs()
    yield from _forged_pairs()
    yield from _bent_refutations()
    yield from _bent_refutations_of_theorems()


def _bent_facts() -> Iterator[Case]:
    nobody = {"kind": "agents", "labels": []}
    yield forged("paper", "observability", exact={"rank": "1"})
    yield forged("paper", "observability", margin=0)
    yield forged("paper", "observability", rate=1)
    yield forged("paper", "observability", domain="consensus")
    yield forged("paper", "observability", witness=_witness("1 0"))
    for rate in (1.7, -1, 0):
        yield forged("paper", "hurwitz", rate=rate)
    yield forged("paper", "hurwitz", exact={"routh": vector("1 16/5")})
    yield forged("paper", "hurwitz", exact=GONE)
    yield forged("paper", "detectability", exact={"unobservable_polynomial": "1.0"})
    yield forged("paper", "reachability", verdict="refuted", witness=nobody)
    yield forged("hidden", "observability", verdict="proved")
    yield forged("hidden", "observability", witness=_witness("0"))
    yield forged("hidden", "detectability", witness=GONE)
    yield forged("bad W", "hurwitz", rate=1)
    yield forged("far", "reachability", verdict="perhaps")
    yield forged("far", "reachability", witness=nobody)
    yield forged("designed", "hurwitz", **NOTHING | {"rate": 1})
    yield forged("designed", "hurwitz", **NOTHING | {"margin": 1})
    yield forged("designed", "hurwitz", **NOTHING | {"exact": {}})
    yield without_proof("designed", OPEN_THEOREM, NO_GAIN, what="hurwitz without W")
    title = "no W where the problem has one"
    yield without_proof("given", ("hurwitz", NOTHING), OPEN_THEOREM, NO_GAIN, what=title)


def _bent_proofs() -> Iterator[Case]:
    yield forged("plain", "lemma1", exact={})
    yield forged("plain", "lemma1", witness=_witness("1 0", "1"))
    yield forged("plain", "lemma1", margin=None)
    for rate in (0, -1):
        change = {"rate": rate}
        yield bent("plain", ("lemma1", change), ("", change), optional=False)
    yield bent("plain", ("lemma1", {"rate": 5}), ("", {"rate": 5}))
    yield forged("plain", "lemma1", margin=50)
    # The eigenvector of the least eigenvalue of -Lambda = [[10, -4], [-4, 4]] shows all of it; (1,
    # 1) shows nothing.
    own = {"v": doubles(1, 2)}
    yield forged("plain", "lemma1", "lemma1: its vector", exact=own, code=HOLDS)
    yield forged("plain", "lemma1", "lemma1: too much for v", exact=own, margin=2.1)
    yield forged("plain", "lemma1", "lemma1: another vector", exact={"v": doubles(1, 1)})
    yield forged("plain", "lemma1", "lemma1: a negative vector", exact={"v": doubles(-1, -2)})
    yield forged("plain", "lemma1", "lemma1: a long vector", exact={"v": doubles(1, 2, 3)})
    yield forged("plain", "lemma1", "lemma1: a vector of texts", exact={"v": vector("1 2")})
    yield forged("plain", "lemma1", "lemma1: another value", exact=own | {"w": "1"})
    of_ten = {"v": doubles(*[1] * 10)}
    yield forged("paper", "lemma1", "lemma1: a vector for theorem1 too", exact=of_ten)
    yield forged("plain", "lemma1", domain="consensus")
    yield forged("curved", "lemma1", domain="global")
    yield forged("large", "lemma1", margin=10.1)
    yield forged("large", "lemma1", margin=100)
    proof: Document = {"verdict": "proved", "margin": 0, "rate": None}
    proof |= {"exact": GONE, "witness": GONE}
    covering = ("", {"verdict": "proved", "covered_by": "lemma1"})
    yield bent("kinked", ("lemma1", proof), covering)
    yield bent("loose", ("lemma1", proof | {"margin": -1}), covering, what="margin")
    yield forged("paper", "theorem1", margin=0.6)
    yield bent("paper", ("theorem1", {"rate": 0.3}), ("", {"rate": 0.3}))


def _bent_pairs() -> Iterator[Case]:
    exact = check_of(document("paper"), "theorem1")["exact"]
    for key in ("P", "Q", "S", "bound", "block"):
        yield forged("paper", "theorem1", f"another {key}", exact=exact | {key: "1"})
        less = dict(exact)
        less.pop(key, None)
        yield forged("paper", "theorem1", f"no {key}", exact=GONE if key == "block" else less)
    own = check_of(document("good P"), "theorem1-printed")["exact"]
    yield forged("good P", "theorem1-printed", "P is text", exact=own | {"P": "1"})
    longer = [*exact["P"], vector("0 0")]
    yield forged("paper", "theorem1", "P has three rows", exact=exact | {"P": longer})
    yield forged("paper", "observer", Q=matrix("0; 0"))
    yield forged("paper", "observer", Q=None)
    yield without_proof("paper", OPEN_THEOREM, what="a pair without a proof")
    no_gain = ("observer", {"W": None, "source": None})
    yield bent("designed", ("hurwitz", NOTHING), no_gain, what="a pair without W")
    yield forged("given", "observer", source="designed")
    yield forged("designed", "observer", source="given")
    # Lambda <= -2 by the vector (1, 1), and S = 25 of P = 1/100.
    listed = {"P": [["1/100"]], "Q": [["1/50"]], "S": [["25"]], "bound": "-25"}
    pair = {"verdict": "proved", "exact": listed, "margin": 0, "rate": None, "witness": GONE}
    singled = ("lemma1", {"exact": {"v": doubles(1, 1)}})
    yield bent("small P", singled, code=HOLDS, what="lemma1: its vector")
    title = "a pair with too large an S beside a vector"
    yield bent("small P", singled, ("theorem1-printed", pair), what=title)


def _bent_refutations() -> Iterator[Case]:
    one_root = {"unstable_roots": "1"}
    yield forged("loose", "lemma1", rate=1)
    yield forged("loose", "lemma1", margin=0.5)
    yield forged("loose", "lemma1", witness=GONE)
    yield forged("loose", "lemma1", exact=GONE)
    yield forged("loose", "lemma1", exact={"unstable_roots": "0", "value": "1/1000"})
    for roots in ("1", "-1", "1/2"):
        yield forged("loose", "lemma1", exact={"unstable_roots": roots})
    yield forged("loose", "lemma1", witness=_witness("1 -1", "1 2"))
    yield forged("loose", "lemma1", witness=_witness("0 0", ""))
    yield forged("loose", "lemma1", witness=_witness("1 1", "1"))
    yield forged("loose", "lemma1", witness=_witness("1 1", "1 2", "agents"))
    yield forged("loose", "lemma1", witness=_witness("1 1 0", "1 2"))
    yield forged("loose", "lemma1", witness=_witness("1 1", "1 2"), margin=-1)
    yield forged("unstable", "lemma1", margin=-9, exact=one_root)
    refuted = ("", {"verdict": "refuted"})
    yield bent("unstable, irrational", ("lemma1", {"exact": one_root}), refuted)
    yield bent("not normal", ("lemma1", {"exact": one_root}), refuted)
    yield bent("not normal", refuted)
    half_a_root = {"unstable_roots": "1/2"}
    yield bent("not normal", ("lemma1", {"exact": half_a_root}), refuted)
    # Symmetric J - K of 61 rows: a vector with v'Lambda v > 0 shows one unstable root, one with 0
    # shows none.
    assert check_of(document("repelled, large"), "lemma1")["exact"]["unstable_roots"] == "1"
    yield forged("repelled, large", "lemma1", exact={"unstable_roots": "2"})
    yield forged("unstable, large", "lemma1", exact=one_root)
    digits = _decimal(10**5000 + 7)
    long = ("observer", NO_PAIR | {"W": [[f"1/{digits}"]]})
    title = "W with a long denominator"
    changes = ("hurwitz", NOTHING), OPEN_THEOREM, LEFT_OPEN, long
    yield bent("designed", *changes, code=UNREADABLE, what=title)
    yield _too_large_to_count()
    yield _long_denominators()


def _bent_refutations_of_theorems() -> Iterator[Case]:
    theorem = check_of(document("bad W"), "theorem1")
    assert theorem["exact"] == {"block": "hurwitz"}
    yield forged("bad W", "theorem1", exact={"block": "hurwitz", "mode": "G"})
    yield forged("bad W", "theorem1", margin=-1)
    yield forged("bad W", "theorem1", exact={"block": "closed"})
    yield forged("bad W", "theorem1", exact={"block": "observable"})
    yield forged("bad W", "theorem1", witness=GONE)
    yield forged("bad W", "theorem1", exact=GONE)
    refuted = {"verdict": "refuted", "margin": None, "rate": None}

    def claimed(what: str, witness: Document, **exact: str) -> Case:
        claim = ("theorem1", refuted | {"exact": exact, "witness": witness})
        return without_proof("given", claim, ("observer", NO_PAIR), what=what)

    yield claimed("detectable", _witness("1", kind="polynomial"), block="detectability")
    ones = ("theorem1", refuted | {"witness": _witness("1 1", "1 2")})
    for what, mode in (("Lambda", "G"), ("Lambda of no mode", "Gx")):
        of_mode = ("theorem1", {"exact": {"block": "Lambda", "mode": mode}})
        yield without_proof("given", ones, of_mode, ("observer", NO_PAIR), what=what)
    unstable = refuted | {"witness": _witness("1 -1", kind="routh_row")}
    gain = ("hurwitz", unstable | {"exact": GONE})
    theorem = ("theorem1", unstable | {"exact": {"block": "hurwitz"}})
    pushing = ("observer", NO_PAIR | {"W": [["-1"]]})
    yield without_proof("designed", gain, theorem, pushing, what="a designed W refutes")
    yield from _bent_printed_pairs(refuted)


def _bent_printed_pairs(refuted: Document) -> Iterator[Case]:
    id = "theorem1-printed"
    printed = check_of(document("small P"), id)
    assert printed["verdict"] == "refuted"
    yield forged("small P", id, witness=printed["witness"] | {"kind": "agents"})
    exact = printed["exact"]
    yield forged("small P", id, exact=exact | {"mode": "Gx"})
    yield forged("small P", id, exact=exact | {"mode": ["G"]})
    yield forged("small P", id, exact=exact | {"S": [["26"]]})
    yield forged("small P", id, margin=-90)
    yield bent("good P", (id, refuted | printed), ("", {"covered_by": "theorem1"}))
    for name, block in (("negative P", "P"), ("wrong P", "Omega0")):
        own = check_of(document(name), id)
        assert own["exact"] == {"block": block}
        values = own["witness"]["values"]
        yield forged(name, id, margin=-1)
        yield forged(name, id, witness={"kind": "agents", "values": values})
        yield forged(name, id, witness={"kind": "vector", "values": ["0"] * len(values)})
        yield forged(name, id, exact={"block": "Q"})
    yield forged("wrong P", id, witness=_witness("1 0"))
    claim = refuted | {"exact": {"block": "P"}, "witness": _witness("1")}
    yield forged("good P", id, "P > 0 is refuted", **claim)


def _forged_pairs() -> Iterator[Case]:
    """q = 1, A - W C = 1: for P = -1 Omega = -2 < 0, and for P = 1 S = -1/2; both make Lambda + S <
    0."""
    proof: Document = {"verdict": "proved", "margin": 0, "rate": None, "witness": GONE}
    whole = ("", {"verdict": "proved", "covered_by": "theorem1"})
    first_pair = ("-1", "1", "1/2", "-1/2")
    second_pair = ("1", "-1", "-1/2", "1/2")
    for P, Q, S, bound in (first_pair, second_pair):
        pair = {"P": [[P]], "Q": [[Q]]}
        exact = pair | {"S": [[S]], "bound": bound}
        claim = ("theorem1", proof | {"exact": exact})
        yield bent("bad W", claim, ("observer", pair), whole, what=f"P = {P}")
    given = document("given")
    proofs = []
    for id in ("hurwitz", "theorem1"):
        proofs.append((id, {"witness": GONE} | check_of(given, id)))
    overall = ("", {key: given[key] for key in OPEN})
    yield bent("bad W", *proofs, ("observer", given["observer"]), overall, what="a better W")
    yield _asymmetric_pair()


def _asymmetric_pair() -> Case:
    """P is not symmetric, and everything else is as it would follow from it."""
    problem = problems()["paper"]
    claims = certified(problem).claims
    assert claims.P is not None
    assert problem.exosystem is not None
    assert problem.observer.W is not None
    matrices = (problem.exosystem.A, problem.exosystem.C, problem.observer.W)
    A, C, W = (as_rationals(M) for M in matrices)
    P = as_rationals(claims.P)
    P[0, 1] += sp.Rational(1, 1000)
    half = P * (A - W * C)
    S = C * (-half - half.T).inv() * C.T
    pair = {"P": as_texts(P), "Q": as_texts(P * W)}
    bound = str(-S[0, 0])
    exact = pair | {"S": as_texts(S), "bound": bound}
    claim = ("theorem1", {"exact": exact, "margin": 0.1, "rate": None})
    whole = ("", {"rate": None, "covered_by": "theorem1"})
    title = "P is not symmetric"
    return bent("paper", claim, ("observer", pair), whole, what=title, optional=False)


def as_rationals(rows: Any) -> sp.Matrix:
    """Of numbers or of their texts."""
    entries = [[sp.Rational(str(x)) for x in row] for row in rows]
    return sp.Matrix(entries)


def as_texts(M: sp.Matrix) -> list[list[str]]:
    return [[str(x) for x in row] for row in M.tolist()]


def _too_large_to_count() -> Case:
    """61 agents with one arc and one pin: with k = -1 J - K has an unstable root, which nobody
    counts; it is not symmetric, and so v'Lambda v > 0 alone shows none."""
    name = "unstable, large"
    problem = problem_of(name)
    problem["gains"] = [[0, [["-1"]]]]
    problem["modes"][0]["arcs"] = [[1, 2, "1"]]
    copied = document(name)
    exact = {"unstable_roots": "1", "value": "2"}
    values = ["1"] + ["0"] * 60
    witness = {"kind": "vector", "labels": ["1"], "values": values}
    changes = {"exact": exact, "witness": witness, "margin": None}
    bend(check_of(copied, "lemma1"), changes)
    return about(problem, copied, name="61 rows", code=FAILS)


def _long_denominators() -> Case:
    """A true witness whose entries have denominators of 33 000 bits each."""
    near = [f"1/{_decimal(10**9980 + k)}" for k in (1, 3, 7)]
    copied = document("far")
    lemma = check_of(copied, "lemma1")
    bend(lemma, {"margin": None, "exact": {"unstable_roots": "0"}})
    problem = problem_of("far")
    problem["gains"] = []
    witness = {"kind": "vector", "labels": problem["labels"], "values": near}
    bend(lemma, {"witness": witness})
    problem["modes"][0]["arcs"] = []
    bend(copied, {"verdict": "refuted", "rate": None, "covered_by": None})
    alone = {"verdict": "refuted", "witness": {"kind": "agents", "labels": problem["labels"]}}
    bend(check_of(copied, "reachability"), alone)
    return about(problem, copied, name="long denominators", code=FAILS)


def _decimal(number: int) -> str:
    """Python prints at most 4300 digits at once."""
    high, low = divmod(number, 10**4000)
    return f"{_decimal(high)}{low:04000}" if high else str(low)


def about(problem: Document, certificate: Document, *, name: str, code: int) -> Case:
    """A certificate that is about this problem file."""
    data = as_written(problem)
    certificate = certificate | {"problem_sha256": hashlib.sha256(data).hexdigest()}
    return Case(name, json.dumps(certificate).encode(), data, code)


def as_written(problem: Document) -> bytes:
    """The bytes of problem.json that are hashed."""
    text = json.dumps(problem, sort_keys=True, ensure_ascii=False, separators=(",", ":"))
    return f"{text}\n".encode("utf-8", "surrogatepass")


def _bent_frames() -> Iterator[Case]:
    yield forged("plain", "", problem="another")
    yield forged("plain", "", problem_sha256="0" * 64)
    yield forged("plain", "", notes=[])
    yield forged("plain", "", verdict="refuted", rate=None, covered_by=None)
    yield forged("plain", "", **OPEN)
    yield forged("plain", "", rate=0.001)
    yield forged("plain", "", covered_by="theorem1")
    yield forged("plain", "observer", W=[], source="designed")
    yield forged("good P", "", covered_by="lemma1")
    rate = check_of(document("regional"), "lemma1")["rate"]
    yield forged("regional", "", verdict="proved", covered_by="lemma1", rate=rate)
    yield forged("calm bad W", "", verdict="refuted")
    yield forged("unstable, elsewhere", "", verdict="refuted")
    for name in ("beside", "only 0", "empty box", "point box"):
        yield forged(name, "", **OPEN | {"verdict": "refuted"})
    checks = document("paper")["checks"]
    others = checks[1:]
    lure = {"id": "lure", "domain": "global", "reason": "", "verdict": "undecided"}
    lure |= {"margin": None, "rate": None}
    yield forged("paper", "", "no checks", checks=[])
    yield forged("paper", "", "one is missing", checks=others)
    yield forged("paper", "", "one stands there twice", checks=[others[0], *others])
    other = lure | {"domain": "consensus"}
    yield forged("paper", "", "another one in its place", checks=[other, *others])
    yield forged("paper", "", "one more", checks=[lure, *checks])
    lemmas = []
    swapped = []
    for each in document("two modes")["checks"]:
        if each["id"] == "lemma1":
            lemmas.append(each)
            swapped.append(each | {"mode": "B"})
        else:
            swapped.append(each)
    assert len(lemmas) == 2
    yield forged("two modes", "", "one mode twice", checks=swapped)
    larger = max(each["rate"] for each in lemmas)
    yield forged("two modes", "", "the larger rate", rate=larger)
    yield from _unreadable()


def _unreadable() -> Iterator[Case]:
    unreadable = partial(forged, code=UNREADABLE)
    yield unreadable("plain", "", extra=1)
    yield unreadable("plain", "", reason=GONE)
    yield unreadable("plain", "", reason=5)
    yield unreadable("loose", "", notes="text")
    yield unreadable("plain", "", observer=[])
    yield unreadable("plain", "", rate="0.5")
    yield unreadable("plain", "", rate=True)
    yield unreadable("plain", "", format="dobc-problem")
    for version in (True, 1.0, 2, "1"):
        yield unreadable("plain", "", f"version {version}", version=version)
    yield unreadable("plain", "lemma1", mode=None)
    yield unreadable("plain", "lemma1", exact="text")
    yield unreadable("plain", "lemma1", fix={"kind": "x"})
    long = "1." + "0" * 10_000
    for number in (1, "0x1", "1/0", "nan", "Infinity", "1e401", long, " 2", "1_0", "\u0662"):
        shown = str(number)[:10]
        yield unreadable("given", "observer", f"W = {shown}", W=[[number]])
    yield unreadable("given", "observer", W=matrix("2 0"))


#: Nothing that the reader of expressions takes.
NO_COUPLINGS = """\
y + 1; y/(1 - 1); foo(y); max(y); sin(y, y); y # + 1; z; y**99; y**65; y**y; y**-1; \
((9**64)**64)**64*y; exp(16385)*y; log(0)*y; log(-1)*y; sqrt(-1)*y; sin(1e300)*y; sqrt(y); cos(y); \
y if y else y; y or y; +y; y.real; (); y); 1.*y; 1e401*y; ...; exp(y=y); max(*y); \
exp(y + 1) - exp(1); tan(pi/2)*y; 1/pi(y); exp; E; y // 1"""


def problem_of(name: str) -> Document:
    """The problem file of a certificate, as a document."""
    return dict(json.loads(_originals()[name][1]))


def _bent_problems() -> Iterator[Case]:
    for h in NO_COUPLINGS.split("; "):
        yield _with("plain", "coupling.h", h, f"h = {h[:20]}")
    yield _with("plain", "coupling.h", "", "h = ")
    deep = "(" * 300 + "y" + ")" * 300
    for h in (deep, "y" * 2001, "y" + " + 0*y" * 400):
        yield _with("plain", "coupling.h", h, f"h = {h[:20]}")
    yield _with("plain", "coupling.h", ["y1", "y2"])
    yield _with("plain", "labels", ["1", "1"])
    yield _with("plain", "labels", [])
    yield _with("plain", "modes", [])
    yield _with("plain", "modes", problem_of("plain")["modes"] * 2, "a mode twice")
    for agent in (True, 1.0, -1, 2, "1"):
        yield _with("plain", "gains", [[agent, [["3"]]]], f"gain of {agent}")
    yield _with("good P", "observer.W", None)
    yield _with("plain", "dimension", 0)
    yield _with("plain", "dimension", "1")
    changes = {"dimension": 101, "target": ["0"] * 101, "gains": []}
    wide = problem_of("plain") | changes
    yield about(wide, document("plain"), name="101 components", code=UNREADABLE)
    yield _with("plain", "extra", 1)
    yield _with("plain", "version", True)
    # A polynomial with a coefficient of 5000 digits, more than Python writes.
    long = problem_of("hidden")
    long["exosystem"]["A"] = [["-" + "9" * 5000]]
    yield about(long, document("hidden"), name="hidden: a long polynomial", code=FAILS)
    # An agent that is pushed away: -Lambda < 0.
    outward = [[0, [["-1"]]], [1, [["-1"]]]]
    pushed = problem_of("plain") | {"gains": outward, "notes": []}
    pushed["modes"][0]["arcs"] = []
    claims = document("plain")
    bend(check_of(claims, "lemma1"), {"margin": 0, "rate": None})
    bend(claims, {"rate": None})
    yield about(pushed, claims, name="pushed away", code=FAILS)
    # One agent of a large network is pushed away: the vector that is found fails in a row, or is
    # none. Where all repel each other, M = circ(2, 2, 0, ..., 0, 2) has M 1 = 6 > 0, but its other
    # entries are not <= 0: it has the eigenvalue 2 + 4 cos(24 pi/25) < 0.
    yield _pushed("long", "-1")
    yield _pushed("long", "-20")
    yield _pushed("ring", "-1/5")
    yield _pushed("ring", "-1/2")
    apart = {"h": "-y", "exceptions": []}
    yield _pushed("ring", "3", coupling=apart, gains=[[i, [["3"]]] for i in range(25)])


def _pushed(name: str, gain: str, **changes: Any) -> Case:
    """Agent 13 of a large network with another gain, unless ``changes`` give the gains of all."""
    problem = problem_of(name)
    others = [[i, k] for i, k in problem["gains"] if i != 12]
    problem["gains"] = [*others, [12, [[gain]]]]
    claims = bare(document(name))
    bend(check_of(claims, "lemma1"), {"margin": 0, "rate": None, "exact": GONE})
    bend(claims, {"rate": None, "covered_by": "lemma1"})
    title = f"{name}: agent 13 has k = {gain}"
    return about(problem | changes, claims, name=title, code=FAILS)


def _with(name: str, path: str, value: Any, what: str = "") -> Case:
    """The certificate beside a problem file that cannot be read."""
    problem = problem_of(name)
    *places, last = path.split(".")
    holder = problem
    for place in places:
        holder = holder[place]
    holder[last] = value
    return about(problem, document(name), name=f"{name}: {what or last}", code=UNREADABLE)


def _other_bytes() -> Iterator[Case]:
    data, problem = _originals()["plain"]
    yield from _no_file("nothing", b"")
    yield from _no_file("a list", b"[]")
    yield from _no_file("cut", data[:-3])
    yield from _no_file("not UTF-8", b"\xff" + data)
    yield from _no_file("UTF-16", data.decode().encode("utf-16"))
    yield from _no_file("NaN", data.replace(b'"rate": ', b'"rate": NaN, "x": ', 1))
    yield from _no_file("deep", b"[" * 100_000)
    twice = data.replace(b'"verdict"', b'"verdict": "refuted", "verdict"', 1)
    yield from _no_file("a key twice", twice)
    huge = data.replace(b'"version": 1', b'"version": ' + b"1" * 5000, 1)
    yield from _no_file("a huge integer", huge)
    exponent = data.replace(b'"margin": ', b'"margin": 1e999999999, "x": ', 1)
    yield from _no_file("a huge exponent", exponent)

    def beside(what: str, other: bytes, code: int) -> Case:
        assert other != problem
        return Case(f"problem: {what}", data, other, code)

    source = json.loads(problem)
    backwards = {key: source[key] for key in sorted(source, reverse=True)}
    yield beside("other blanks", json.dumps(source, indent=2).encode(), HOLDS)
    yield beside("keys in another order", json.dumps(backwards).encode(), HOLDS)
    escaped = problem.replace(b"plain", b"pl\\u0061in").replace(b'"name"', b'"n\\u0061me"')
    yield beside("escapes", escaped, HOLDS)
    spelt = problem.replace(b'"target":["0"]', b'"target":["0.0"]')
    yield beside("another spelling of a number", spelt, FAILS)
    number = problem.replace(b'"t_final":"20"', b'"t_final":20.0')
    yield beside("a number that is no text", number, UNREADABLE)
    yield Case("too large", data + b" " * 2**24, problem, UNREADABLE)


def _no_file(name: str, other: bytes) -> Iterator[Case]:
    """Bytes that are no certificate, and no problem file."""
    data, problem = _originals()["plain"]
    yield Case(name, other, problem, UNREADABLE)
    yield Case(f"problem: {name}", data, other, UNREADABLE)
