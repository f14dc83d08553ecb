"""problem.json: the one text of a problem that a certificate is about, and its hash.

Arcs are [listener, speaker, weight] with indices from 0, whatever ``arrow`` the user wrote; numbers are
rationals as strings; couplings are their canonical text.  The bytes are a function of the Problem alone.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from dobc_design.errors import SpecError
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.number import number_text, parse_number
from dobc_design.spec.coupling import Coupling
from dobc_design.spec.exosystem import Exosystem
from dobc_design.spec.network import Arcs, Network
from dobc_design.spec.observer import Observer
from dobc_design.spec.problem import Problem
from dobc_design.spec.settings import Switching

FORMAT = "dobc-problem"
VERSION = 1


def canonical_bytes(problem: Problem) -> bytes:
    """The UTF-8 bytes of problem.json."""
    text = json.dumps(canonical_document(problem), sort_keys=True, ensure_ascii=False, separators=(",", ":"))
    return text.encode("utf-8") + b"\n"


def problem_sha256(problem: Problem) -> str:
    """SHA-256 of ``canonical_bytes``, as hexadecimal text."""
    return hashlib.sha256(canonical_bytes(problem)).hexdigest()


def matrix_text(matrix: Matrix) -> list[list[str]]:
    """A rational matrix as rows of strings."""
    return [[number_text(entry) for entry in row] for row in matrix]


def canonical_document(problem: Problem) -> dict[str, Any]:
    """The document behind problem.json: JSON types only."""
    return {
        "format": FORMAT,
        "version": VERSION,
        "name": problem.name,
        "notes": list(problem.notes),
        "labels": list(problem.network.labels),
        "dimension": problem.m,
        "target": _vector(problem.target),
        "modes": [
            {"name": name, "arcs": [[i, j, number_text(w)] for i, j, w in arcs]}
            for name, arcs in problem.network.modes.items()
        ],
        "coupling": {
            "h": _coupling(problem.coupling),
            "exceptions": [
                {"arc": [i, j], "h": _coupling(coupling)} for (i, j), coupling in sorted(problem.exceptions.items())
            ],
        },
        "gains": [[i, matrix_text(k)] for i, k in problem.pinning.gains.items()],
        "exosystem": None
        if problem.exosystem is None
        else {"A": matrix_text(problem.exosystem.A), "C": matrix_text(problem.exosystem.C)},
        "observer": {
            "W": None if problem.observer.W is None else matrix_text(problem.observer.W),
            "P": None if problem.observer.P is None else matrix_text(problem.observer.P),
            "rate": _number(problem.observer.rate),
        },
        "offsets": [[i, _vector(offset)] for i, offset in problem.offsets.items()],
        "region": None
        if problem.region is None
        else {
            "initial_states": [_vector(pair) for pair in problem.region.initial_states],
            "initial_disturbance": _number(problem.region.initial_disturbance),
        },
        "switching": None
        if problem.switching is None
        else {"signal": problem.switching.signal, "dwell": _number(problem.switching.dwell)},
        "simulation": {
            "t_final": _number(problem.simulation.t_final),
            "seed": problem.simulation.seed,
            "xi0": None if problem.simulation.xi0 is None else [_vector(row) for row in problem.simulation.xi0],
        },
    }


def _vector(values: Sequence[Fraction]) -> list[str]:
    return [number_text(value) for value in values]


def _number(value: Fraction | None) -> str | None:
    return None if value is None else number_text(value)


def _coupling(coupling: Coupling) -> str | list[str]:
    return coupling.texts[0] if coupling.by_component else list(coupling.texts)


def problem_from_canonical(data: bytes) -> Problem:
    """Read problem.json back.  Raises SpecError for anything that is not one."""
    document = _load(data)
    try:
        return _problem(document)
    except (KeyError, TypeError, AttributeError, IndexError) as error:
        raise SpecError(
            f"problem.json: something is missing or of the wrong kind ({type(error).__name__}: {error}).",
            key="problem.json", cure="Write it again with `dobc check FILE --canonical OUT`.",
        ) from None  # fmt: skip


def _load(data: bytes) -> dict[str, Any]:
    try:
        document = json.loads(data.decode("utf-8"), object_pairs_hook=_no_duplicates)
    except SpecError:
        raise
    except (UnicodeDecodeError, ValueError, RecursionError) as error:
        raise SpecError(
            f"problem.json is not valid JSON ({str(error)[:80]}).", key="problem.json",
            cure="Write it again with `dobc check FILE --canonical OUT`.",
        ) from None  # fmt: skip
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise SpecError(
            f'problem.json must hold an object with "format": "{FORMAT}".', key="format",
            cure="Write it again with `dobc check FILE --canonical OUT`.",
        )  # fmt: skip
    if document.get("version") != VERSION:
        raise SpecError(
            f"problem.json has version {document.get('version')!r}; this program knows {VERSION}.", key="version",
            cure="Update dobc_design, or write the file again.",
        )  # fmt: skip
    return document


def _no_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    result = dict(pairs)
    if len(result) != len(pairs):
        raise SpecError("problem.json holds a key twice.", key="problem.json", cure="Write it again.")
    return result


def _problem(document: Mapping[str, Any]) -> Problem:
    labels = tuple(document["labels"])
    modes = {mode["name"]: _arcs(mode["arcs"], key=f"network.modes.{mode['name']}") for mode in document["modes"]}
    exosystem, observer = document["exosystem"], document["observer"]
    switching = document["switching"]
    return Problem(
        name=document["name"],
        notes=document["notes"],
        network=Network(labels=labels, modes=modes),
        coupling=document["coupling"]["h"],
        exceptions={(item["arc"][0], item["arc"][1]): item["h"] for item in document["coupling"]["exceptions"]},
        target=document["target"],
        gains={labels[i]: gain for i, gain in document["gains"]},
        exosystem=None if exosystem is None else Exosystem(A=exosystem["A"], C=exosystem["C"]),
        observer=None if exosystem is None else Observer(W=observer["W"], P=observer["P"], rate=observer["rate"]),
        offsets={labels[i]: offset for i, offset in document["offsets"]},
        region=document["region"],
        switching=None if switching is None else Switching(signal=switching["signal"], dwell=switching["dwell"]),
        simulation=document["simulation"],
    )


def _arcs(rows: Sequence[Sequence[Any]], *, key: str) -> Arcs:
    known: dict[str, Fraction] = {}
    listeners, speakers, weights = [], [], []
    for position, (i, j, weight) in enumerate(rows):
        if isinstance(i, bool) or isinstance(j, bool) or not isinstance(i, int) or not isinstance(j, int):
            raise SpecError(f"{key}[{position}]: indices must be whole numbers.", key=key, cure="Write it again.")
        if weight not in known:
            known[weight] = parse_number(weight, key=f"{key}[{position}][2]")
        listeners.append(i)
        speakers.append(j)
        weights.append(known[weight])
    try:
        pair = np.array(listeners, dtype=np.int64), np.array(speakers, dtype=np.int64)
    except OverflowError:
        raise SpecError(f"{key}: an index is too large.", key=key, cure="Write it again.") from None
    return Arcs(*pair, tuple(weights))
