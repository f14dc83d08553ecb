"""Proofs about motions for Coq: problems, coqc, and certificates and files that are wrong in one
place each.

A forged certificate is as consistent as a forger could make it: the file is made from it by the
package's own template, with the pieces of the honest file where none can be found, so that Coq
refuses what is false in it and nothing else.
"""

import os
import re
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pytest
from certified import made_once
from networks import linked, network_of

from dobc_design import Certificate, Exosystem, Group, Network, Problem, certify
from dobc_design.certification import certify as certification
from dobc_design.conditions.separable import stage as separable_room
from dobc_design.errors import SpecError
from dobc_design.export.rocq import motions
from dobc_design.export.rocq.motions import Part, Row, Rows, motions_proof
from dobc_design.problem.canonical import problem_sha256


def bare(text: str) -> str:
    """The text without its comments."""
    out: list[str] = []
    depth = place = 0
    for mark in re.finditer(r"\(\*|\*\)", text):
        out += [text[place : mark.start()]] if depth == 0 else []
        depth = depth + (1 if mark[0] == "(*" else -1)
        place = mark.end()
        assert depth >= 0
    assert depth == 0
    return "".join([*out, text[place:]])


COQC = shutil.which("coqc")
SINE = Exosystem(A=((0, 1), (-1, 0)), C=((1, 0),))
AXIOMS = (
    r"ClassicalDedekindReals\.\w+|FunctionalExtensionality\.functional_extensionality_dep"
    r"|Classical_Prop\.classic"
)
PART_2 = "(* ==== 2. This network"
#: What stands before part 2 where part 1 is compiled once, as Base.v.
AFTER_BASE = """From Coquelicot Require Import Coquelicot.
From Interval Require Import Specific_ops Specific_stdz.
From Interval Require Tactic.
Require Import Reals List Lra Lia Base.
Import ListNotations Base.Bounds.
Open Scope R_scope.
"""


def listens(arcs: Any, n: int) -> Network:
    return network_of(arcs, n)


RISING = "exp(y) - 1 + y"


@cache
def problems() -> dict[str, Problem]:
    two = {"a": [[2, 1, "2/3"], [3, 2]], "b": [[2, 3, "1/2"], [3, 1, "7/5"]]}
    pair = {"a": [[2, 1], [1, 2, "1/2"]], "b": [[2, 1, 2]]}
    A = ((0, 1), (-1, 0))
    C = ((1, 0), (0, 1))
    plane = Exosystem(A=A, C=C)
    line = Exosystem(A=((0,),), C=((1,), ("1/2",)))
    starts = {"initial_states": [-1, 1], "initial_disturbance": "1/2"}
    made: dict[str, Problem] = {}
    # the one that is changed
    small = {"a": [[2, 1], [3, 2]], "b": [[2, 1, 2], [3, 1]]}
    gains = {1: 3, 2: 1}
    held = {"gains": gains, "exosystem": SINE, "region": starts}
    made["small"] = linked(small, 3, RISING, **held)
    # m = 2, matrix gains, a formation, weights, groups
    exceptions = {(2, 0): "atan(2*y)"}
    given: dict[str, Any] = {"exceptions": exceptions, "target": ["1/2", -1]}
    gain = [[3, "1/2"], [-1, 4]]
    given["gains"] = {1: gain, 2: 2, 3: 1}
    given["offsets"] = {2: [1, "-3/2"], 3: ["1/3", 0]}
    first_group = Group(agents=[1, 3], exosystem=plane)
    second_group = Group(agents=[2], exosystem=line)
    given["groups"] = [first_group, second_group]
    made["rich"] = linked(two, 3, RISING, **given, region=starts)
    # no exosystem; arcs that rise, fall, have a peak and are bounded on a piece
    falls = {(0, 1): "-tanh(y)/4"}
    region = {"initial_states": [-2, 2]}
    given = {"gains": {1: 3, 2: "1/2"}, "region": region}
    made["turning"] = linked(pair, 2, "y/(1 + y**2/9)", exceptions=falls, **given)
    # the same kinds of arcs, in few pieces
    given = {"gains": {1: 3, 2: 3, 3: 2}, "region": {"initial_states": [-3, 3]}}
    given["exceptions"] = falls | {(2, 1): "y/(1 + y**2/9)"}
    three = [[2, 1], [1, 2, "1/2"], [3, 2]]
    made["bent"] = linked(three, 3, "y*exp((1 - y**2)/2)", **given)
    # estimates that start exact: a bound of 0 on the estimation error
    exosystem = Exosystem(A=((0,),), C=((1,),))
    given = {"gains": {1: 2}, "exosystem": exosystem}
    given["region"] = starts | {"initial_disturbance": 0}
    made["exact"] = linked([[2, 1]], 2, "tanh(y)", **given)
    return made


@cache
def certified(name: str) -> Certificate:
    return certify(problems()[name])


def certify_motions(problem: Problem, **options: Any) -> Certificate:
    """What ``certify`` claims that a file about motions is made of: the box, and no delay,
    sampling, margin or cure."""
    with pytest.MonkeyPatch.context() as own:
        for stage in (
            "weighted_stage",
            "linearisation_stage",
            "margins_stage",
            "accuracy_stage",
            "inputs_stage",
        ):
            own.setattr(certification, stage, lambda *arguments, **options: [])
        own.setattr(certification, "STAGES", (separable_room.separable_stage,))
        own.setattr(separable_room, "_timing", lambda *arguments: [])
        own.setattr(certification, "with_cures", lambda problem, found, **options: found.checks)
        own.setattr(certification, "agreed", lambda claims, problem: claims)
        return certify(problem, **options)


@cache
def boxed(name: str) -> Certificate:
    """The certificate of a problem with what a file about motions is made of."""
    return made_once(f"motions of {name}", lambda: certify_motions(problems()[name]))


@cache
def text_of(name: str) -> str:
    return made_once(f"text about motions of {name}", lambda: motions_proof(boxed(name)))


@dataclass(frozen=True)
class Ran:
    """What coqc said, how long it took, and the memory it had at most, in MB."""

    code: int
    out: str
    err: str
    seconds: float
    megabytes: float

    @property
    def axioms(self) -> list[str]:
        """Those that ``Print Assumptions`` lists."""
        listed = self.out.split("Axioms:\n", 1)[1]
        found = re.findall(r"^(\S+)\s*:?(?:\s.*)?$", listed, flags=re.MULTILINE)
        return [each for each in found if each != "Axioms:"]


def coqc(folder: Path, name: str, text: str, *options: str) -> Ran:
    """Compile the text as NAME.v in the folder."""
    (folder / f"{name}.v").write_text(text, encoding="ascii")
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        began = time.perf_counter()
        command = [COQC or "coqc", "-q", *options, f"{name}.v"]
        process = subprocess.Popen(command, cwd=folder, stdout=out, stderr=err)
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        seconds = time.perf_counter() - began
        out.seek(0)
        err.seek(0)
        return Ran(process.returncode, out.read(), err.read(), seconds, used.ru_maxrss / 1024)


@cache
def missing() -> str | None:
    """Why proofs about motions cannot be checked here."""
    if COQC is None:
        return "coqc is not installed (Debian package coq)"
    with tempfile.TemporaryDirectory() as folder:
        for library, package in (
            ("Coquelicot.Coquelicot", "libcoq-coquelicot"),
            ("Interval.Tactic", "libcoq-interval"),
        ):
            if coqc(Path(folder), "found", f"Require {library}.\n").code:
                return f"{library} is not installed (Debian package {package})"
    return None


def base(folder: Path) -> Path:
    """The folder, with part 1 of every file compiled as Base."""
    ran = coqc(folder, "Base", text_of("small").split(PART_2)[0])
    assert ran.code == 0, ran.err[-2000:]
    return folder


def parts_2_to_4(text: str, *, assumptions: bool = False) -> str:
    """The text for a folder that has a Base; to print assumptions takes as long as to check a small
    file."""
    rest = AFTER_BASE + PART_2 + text.split(PART_2)[1]
    return rest if assumptions else rest.replace("Print Assumptions", "Check")


def refused_in(ran: Ran, text: str) -> str:
    """The lemma, theorem or definition in which coqc stopped."""
    lines = text.splitlines()[
        : int(re.findall(r"line (\d+), characters.*\n(?=Error)", ran.err)[-1])
    ]
    named = []
    for line in lines:
        if found := re.match(r"(?:Lemma|Theorem|Definition) (\w+'?)", line):
            named.append(found[1])
    return named[-1]


# ---- Changes of what is claimed ----


@cache
def honest_parts() -> dict[tuple[int, int], list[Part]]:
    certificate = boxed("small")
    claim = separable(certificate).claim
    found = {}
    for row in Rows(certificate.problem, claim, claim.rho).all():
        found[row.agent, row.face] = row.parts
    return found


def separable(certificate: Certificate) -> Any:
    return next(check for check in certificate.checks if check.id == "max-separable")


def forged_proof(certificate: Certificate) -> str:
    """The file of a certificate that may claim what is false."""
    found = honest_parts()  # before the search is patched
    searched = Row.__dict__["parts"].func
    squares = motions._squares
    honest = separable(boxed("small")).claim.rho

    def parts(self: Row) -> list[Part]:
        scale = self.rows.rho / honest
        segments = found[self.agent, self.face]
        ends = ((each.low * scale, each.high * scale) for each in segments)
        return searched(self) or [self._part(*each) for each in ends]

    def any_squares(M: Any) -> list[str]:
        try:
            return squares(M)
        except SpecError:
            return []

    with (
        patch.object(Row, "parts", property(parts)),
        patch.object(motions, "_squares", any_squares),
    ):
        return motions_proof(certificate)


Forgery = Callable[[Certificate], Certificate]


def claims(certificate: Certificate, **values: Any) -> Certificate:
    """With other values in the max-separable check: of the check itself, its claim, or its
    observer's part."""
    check = separable(certificate)
    claim = check.claim
    own = {name: values.pop(name) for name in ("rate", "domain") if name in values}
    names = ("P", "beta", "kappa", "size")
    observed = {name: values.pop(name) for name in names if name in values}
    error = replace(claim.error, **observed)
    changed = replace(claim, **values, error=error)
    new = replace(check, **own, claim=changed)
    checks = tuple(new if each is check else each for each in certificate.claims.checks)
    return replace(certificate, claims=replace(certificate.claims, checks=checks))


def box(radius: float, disturbance: float) -> dict[str, Any]:
    return {"domain": {"kind": "box", "radius": radius, "disturbance": disturbance}}


def about(certificate: Certificate, **values: Any) -> Certificate:
    """The same claims about a problem that differs."""
    problem = certificate.problem.replace(**values)
    return replace(
        certificate,
        problem=problem,
        claims=replace(certificate.claims, problem_sha256=problem_sha256(problem)),
    )


def with_gain(certificate: Certificate, W: Any) -> Certificate:
    rows = tuple(tuple(map(Fraction, row)) for row in W)
    return replace(certificate, claims=replace(certificate.claims, W=rows))


def arcs(
    a: Sequence[Any] = ((2, 1), (3, 2)), b: Sequence[Any] = ((2, 1, 2), (3, 1)), **more: Any
) -> Network:
    arcs_of_a = [list(x) for x in a]
    arcs_of_b = [list(x) for x in b]
    modes = {"a": arcs_of_a, "b": arcs_of_b, **more}
    return listens(modes, 3)


def scaled(claim: Any, name: str, factor: Any) -> Any:
    return getattr(claim, name) * Fraction(factor)


def forgeries() -> dict[str, Forgery]:
    """Single changes of the certificate of "small", or of the problem that it is about."""
    claim = separable(boxed("small")).claim
    v = claim.v
    error = claim.error
    P = error.P

    def own(**values: Any) -> Forgery:
        return lambda certificate: claims(certificate, **values)

    def other(**values: Any) -> Forgery:
        return lambda certificate: about(certificate, **values)

    def observed(W: Any) -> Forgery:
        return lambda certificate: with_gain(certificate, W)

    def weights(i: int, factor: Any) -> Forgery:
        changed = tuple(x * Fraction(factor) if k == i else x for k, x in enumerate(v))
        return own(v=changed)

    def by(factor: Any) -> Any:
        return tuple(tuple(x * Fraction(factor) for x in row) for row in P)

    made: dict[str, Forgery] = {}
    made["rate: 1 % larger"] = own(rate=0.5075)
    made["rate: that of alpha"] = own(rate=0.687431)
    made["alpha: 1 % larger"] = own(alpha=scaled(claim, "alpha", "101/100"))
    made["alpha: twice"] = own(alpha=scaled(claim, "alpha", 2))
    made["alpha: below the rate"] = own(alpha=Fraction(1, 2))
    made["v_1: twice"] = weights(0, 2)
    made["v_1: half"] = weights(0, "1/2")
    made["v_2: ten times"] = weights(1, 10)
    made["v_2: half"] = weights(1, "1/2")
    made["v_3: a third"] = weights(2, "1/3")
    made["rho: 1 % larger"] = own(rho=scaled(claim, "rho", "101/100"))
    made["rho: three times"] = own(rho=scaled(claim, "rho", 3))
    made["rho: 1 % smaller"] = own(rho=scaled(claim, "rho", "99/100"))
    made["kappa: 1 % larger"] = own(kappa=scaled(error, "kappa", "101/100"))
    made["kappa: half"] = own(kappa=scaled(error, "kappa", "1/2"))
    made["beta: 1 % larger"] = own(beta=scaled(error, "beta", "101/100"))
    made["beta: below the rate"] = own(beta=Fraction(1, 2))
    made["size: 1 % smaller"] = own(size=scaled(error, "size", "99/100"))
    made["size: twice"] = own(size=scaled(error, "size", 2))
    made["P: 1 % larger"] = own(P=by("101/100"))
    made["P: half"] = own(P=by("1/2"))
    made["P: another sign"] = own(P=((P[0][0], -P[0][1]), (-P[1][0], P[1][1])))
    made["P: another diagonal"] = own(P=((P[1][1], P[0][1]), (P[1][0], P[0][0])))
    made["start radius: 1 % larger"] = own(**box(1.01, 0.5))
    made["start radius: 40"] = own(**box(40.0, 0.5))
    made["estimation error: 1 % larger"] = own(**box(1.0, 0.505))
    made["estimation error: 5"] = own(**box(1.0, 5.0))
    made["pin 1: a sixth"] = other(gains={1: "1/2", 2: 1})
    made["pin 2: half"] = other(gains={1: 3, 2: "1/2"})
    made["pin 2: none"] = other(gains={1: 3})
    made["pin 1: moved to agent 3"] = other(gains={3: 3, 2: 1})
    made["arc 3 to 2: removed"] = other(network=arcs(a=[(2, 1)]))
    made["arc 3 to 2: turned round"] = other(network=arcs(a=[(2, 1), (2, 3)]))
    made["arc 3 to 1: moved to 1 to 3"] = other(network=arcs(b=[(2, 1, 2), (1, 3)]))
    made["arc 1 to 3: added"] = other(network=arcs(a=[(2, 1), (3, 2), (1, 3)]))
    made["weight of 3 to 1: a tenth"] = other(network=arcs(b=[(2, 1, 2), (3, 1, "1/10")]))
    made["weight of 3 to 2: half"] = other(network=arcs(a=[(2, 1), (3, 2, "1/2")]))
    made["mode b: no arcs"] = other(network=arcs(b=[]))
    made["a third mode without arcs"] = other(network=arcs(c=[]))
    made["h: y with another sign"] = other(coupling="exp(y) - 1 - y")
    made["h: exp with another sign"] = other(coupling="1 - exp(y) + y")
    made["h: negative"] = other(coupling="-(exp(y) - 1 + y)")
    made["h: half"] = other(coupling="(exp(y) - 1 + y)/2")
    made["W: another sign"] = observed([["-26/25"], ["37/100"]])
    made["W: 0"] = observed([[0], [0]])
    made["W: 5 % smaller"] = observed([["247/250"], ["37/100"]])
    made["A: a rotation that grows"] = other(exosystem=Exosystem(A=((0, 1), (1, 0)), C=((1, 0),)))
    made["A: 1 at [0][0]"] = other(exosystem=Exosystem(A=((1, 1), (-1, 0)), C=((1, 0),)))
    made["C: another sign"] = other(exosystem=Exosystem(A=SINE.A, C=((-1, 0),)))
    made["C: the other state"] = other(exosystem=Exosystem(A=SINE.A, C=((0, 1),)))
    made["C: twice"] = other(exosystem=Exosystem(A=SINE.A, C=((2, 0),)))
    return made


# ---- Changes of the file alone ----


def edited(text: str, pattern: str, new: str) -> str:
    """With the first match replaced."""
    found, count = re.subn(pattern, new, text, count=1, flags=re.MULTILINE)
    assert count == 1, pattern
    assert found != text, pattern
    return found


#: Regular expression and what it becomes; numbers of claims, and steps of the proof.
EDITS: dict[str, tuple[str, str]] = {
    "file: v_3 half": (r"^(Definition v .*; )\((\d+) / (\d+)\)(\] 0\.)", r"\1(\2 / (2 * \3))\4"),
    "file: alpha twice": (r"^(Definition alpha : R := )(.*)\.$", r"\g<1>(2 * \2)."),
    "file: beta twice": (r"^(Definition beta : R := )(.*)\.$", r"\g<1>(2 * \2)."),
    "file: P[0][0] 1 larger": (r"^(Definition P [\s\S]*?matrix \[\[)(\([^)]*\))", r"\1(1 + \2)"),
    "file: the sign in h": (r"(exp y - 1) \+ y", r"\1 - y"),
    "file: an arc turned round": (r"Arc 2 1 h1", "Arc 1 2 h1"),
    "file: an arc removed": (r"; Arc 2 1 h1\]", "]"),
    "file: the weight of an arc": (r"Arc 2 1 h1", "Arc 2 1 (fun y => 1 / 2 * h1 y)"),
    "file: a mode's graph": (r"^    \[Arc 1 0 \(fun y => 2.*\]$", "    []"),
    "file: a third mode": (r"Loop 3 1 2 graph", "Loop 3 1 3 graph"),
    "file: a gain of a pin": (r"\| 1 => matrix \[\[1\]\]", "| 1 => matrix [[1 / 2]]"),
    "file: A": (r"matrix \[\[0; 1\]; \[\(- \(1\)\); 0\]\]", "matrix [[0; 1]; [1; 0]]"),
    "file: C": (r"matrix \[\[1; 0\]\]", "matrix [[0; 1]]"),
    "file: W": (r"matrix \[\[\(26 / 25\)\]", "matrix [[0]"),
    "file: the goal": (r"^(Definition goal .*)\[0\] 0", r"\1[5] 0"),
    "file: who is heard": (r"\[Heard 1 1 h1", "[Heard 0 1 h1"),
    "file: the weight of what is heard": (r"\[Heard 1 1 h1", "[Heard 1 2 h1"),
    "file: a coupling that is heard not": (r"^    \[Heard 1 1 h1 .*\]\)\.", "    [])."),
    "file: the bound of what is heard": (
        r"(\[Heard 1 1 h1 \(fun s => )(.*)\)\]\)\.",
        r"\1\2 - s / 100)]).",
    ),
    "file: the step of a term": (r"Term 1 h1 h1' \(- \(", "Term 1 h1 h1' (- (1 + "),
    "file: the end of a piece": (r"^(Lemma upper_0_2_1 .* 0 )(\(.*\))\.$", r"\1(2 * \2)."),
    "file: a gap between pieces": (
        r"^(Lemma upper_0_2_2 .*alpha 0 2 )(\([^)]*\))",
        r"\1(1 / 100 + \2)",
    ),
    "file: the room of a row": (r"(\(k 2 - alpha\) \* s \* v 2\) with \(\()(- )", r"\1"),
    "file: a row of another agent": (
        r"exact upper_0_1\|exact upper_0_2",
        "exact upper_0_2|exact upper_0_1",
    ),
    "file: a square": (
        r"(assert \(S1 : 0 <= \(\d+ / \d+\) \* \(a 0%nat \+ )\(- (\(\d+ / \d+\))\)",
        r"\1\2",
    ),
    "file: what the observer injects": (r"(kappa size )(\(.*\))$", r"\1(\2 / 2)"),
    "file: the radius of the theorem": (r"^  converges network 1 ", "  converges network 2 "),
    "file: the rate of the theorem": (
        r"^(  converges network .*v i\) )(\(.*\))\.$",
        r"\1(1 / 100 + \2).",
    ),
    "file: the bound of the theorem": (
        r"^(  converges network .*\(fun i => )(.*) \* v i",
        r"\1\2 / 2 * v i",
    ),
    "file: the estimates of the theorem": (
        r"^  converges network 1 \(1 / 2\)",
        "  converges network 1 1",
    ),
    "file: the states of the theorem": (
        r"converges_from_states network \(- \(1\)\) 1",
        "converges_from_states network (- (2)) 1",
    ),
}
