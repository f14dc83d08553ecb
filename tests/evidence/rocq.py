"""Coq's proofs about motions: accepted for built-in and random problems, refused after every single
change.

Every change of a certificate or problem is made to the file as a forger would make it, and judged
by the package and the lone checker too; a change of the file alone has a meaning for Coq only.
"""

import json
import logging
import re
import tempfile
from pathlib import Path
from random import Random

from checker_files.files import accepted_by
from evidence.row import Row
from networks import random_problem
from rocq_files import (
    AXIOMS,
    EDITS,
    Ran,
    base,
    coqc,
    edited,
    forged_proof,
    forgeries,
    missing,
    parts_2_to_4,
    refused_in,
    text_of,
)
from rocq_files import certified as small_certified

from dobc_design import Certificate, Exosystem, Verdict, certify
from dobc_design.certificate.text import certificate_bytes
from dobc_design.errors import SpecError
from dobc_design.export.rocq.motions import motions_proof

BUILT_IN = ("paper-fixed", "paper-switching", "clock-sync", "uav-swarm", "microgrid-ieee14")
COUPLINGS = (
    "exp(y) - 1 + y",
    "sin(y)",
    "tanh(y)",
    "atan(2*y)",
    "y + y**3/4",
    "y/(1 + y**2/9)",
    "sinh(y)/2",
    "log((1 + exp(y))/2) + y/2",
    "y*exp((1 - y**2)/2)",
    "2*y - 3*y**2/20",
    "sqrt(4 + 2*y) - 2 + y/2",
    "tan(y/4) + y",
    "cosh(y) - 1 + 2*y",
    "y + sin(3*y)/4",
)
EXOSYSTEMS = (
    None,
    Exosystem(A=((0,),), C=((1,),)),
    Exosystem(A=((0, 2), (-2, 0)), C=((1, 0),)),
    Exosystem(A=((0, 1), (0, 0)), C=((1, "1/2"),)),
)
CHANGES = 82
TRIES = 60  # random problems, of which most are certified


def random_certified(seed: int) -> Certificate | None:
    """A problem with a max-separable proof; None where there is none."""
    r = Random(f"rocq {seed}")
    exosystem = EXOSYSTEMS[seed % len(EXOSYSTEMS)]
    region = {"initial_states": [-r.choice((0.5, 1)), r.choice((0.5, 1))]}
    certificate = certify(
        random_problem(
            seed,
            couplings=r.sample(COUPLINGS, 3),
            modes=1 + seed % 3,
            held=True,
            exosystem=exosystem,
            region=region | ({"initial_disturbance": 0.25} if exosystem else {}),
        )
    )
    proved = any(
        check.id == "max-separable" and check.verdict is Verdict.PROVED
        for check in certificate.checks
    )
    return certificate if proved else None


def wrong(ran: Ran) -> str | None:
    """What is wrong with what coqc said about a true claim."""
    if ran.code:
        return ran.err[-400:]
    found = [each for each in ran.axioms if not re.fullmatch(AXIOMS, each)]
    return f"unknown axioms: {found}" if found else None


def files(count: int, seed: int) -> Row:
    """Files of the built-in problems, and of random ones up to ``count`` files."""
    what = "proofs about motions from the equations up: Coq accepts, on its usual axioms alone"
    if reason := missing():
        return Row(what, 0, [reason])
    failures = []
    notes = []
    done = 0
    with tempfile.TemporaryDirectory() as folder:

        def check(name: str, text: str) -> None:
            ran = coqc(Path(folder), "proof", text)
            notes.append(
                f"{name}: {len(text) // 1000} kB, {ran.seconds:.0f} s, {ran.megabytes:.0f} MB"
            )
            logging.info(notes[-1])
            failures.extend([f"{name}: {bad}"] if (bad := wrong(ran)) else [])

        for name in BUILT_IN[:count]:
            check(name, motions_proof(certify(name, everything=name == "clock-sync")))
            done += 1
        for each in range(seed, seed + TRIES):
            certificate = random_certified(each) if done < count else None
            if certificate is None:
                continue
            h = "; ".join(coupling.texts[0] for coupling in certificate.problem.couplings)
            name = (
                f"seed {each} ({certificate.problem.n} agents, "
                f"{len(certificate.problem.network.modes)} modes, {h})"
            )
            try:
                text = motions_proof(certificate)
            except SpecError as refusal:
                notes.append(f"{name}: no file: {refusal}")
                logging.info(notes[-1])
                continue
            check(name, text)
            done += 1
    return Row(what, done, failures, notes, least=count)


def changes(count: int, seed: int) -> Row:
    """The first ``count`` changes: of the certificate or problem, then of the file."""
    del seed
    what = (
        "single changes of a proof about motions: Coq refuses, and both programs where they "
        "see the change"
    )
    if reason := missing():
        return Row(what, 0, [reason])
    failures = []
    notes = [f"{'change':<40}{'Coq stops in':<28}{'package':<10}second program"]
    done = 0
    words = {True: "ACCEPTS", False: "refuses"}
    cases = [*forgeries().items(), *EDITS.items()]
    with tempfile.TemporaryDirectory() as temporary:
        folder = base(Path(temporary))
        if coqc(folder, "proof", parts_2_to_4(text_of("small"))).code:
            failures.append("the file that is not changed is refused")
        for name, change in cases[:count]:
            if isinstance(change, tuple):
                text = edited(parts_2_to_4(text_of("small")), *change)
                programs = ()
            else:
                forged = change(small_certified("small"))
                text = parts_2_to_4(forged_proof(forged))
                programs = accepted_by(json.loads(certificate_bytes(forged.claims)), forged.problem)
            ran = coqc(folder, "proof", text)
            coq = "ACCEPTS" if ran.code == 0 else refused_in(ran, text)
            said = [coq, *(words[each] for each in programs)]
            notes.append(f"{name:<40}{coq:<28}" + "".join(f"{each:<10}" for each in said[1:]))
            logging.info("%s  %.0f s", notes[-1], ran.seconds)
            failures += [f"{name}: {said}"] if "ACCEPTS" in said else []
            done += 1
    return Row(what, done, failures, notes, least=min(count, len(cases)))
