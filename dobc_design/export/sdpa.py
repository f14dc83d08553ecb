"""The matrix inequality of Lemma 1, Theorem 1 or Theorem 2 as a file in SDPA's sparse format, for any SDP solver.

    minimise t   subject to   Psi_mode(P, Q) <= t I for every mode,   I <= P <= rho I,   |Q| <= r

Solvers read it as: minimise c'x subject to x_1 F_1 + ... + x_k F_k - F_0 >= 0.  The unknowns are the upper triangle of
P row by row, then Q row by row, then t.  t* < 0 proposes a pair (P, Q); t* >= 0 alone says nothing, because rho and r
bound the search (theory, section 2).  Where there is a proved pair both are taken from it, so that t* < 0 is then sure.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from dobc_design import __version__
from dobc_design.conditions.consensus.claim import Statements, state_theorems
from dobc_design.errors import SpecError
from dobc_design.exact.matrix import Matrix, to_float
from dobc_design.exact.pencil import Pencil, Place, below, positive
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

MOST_ROWS = 4000
DEFAULT = Fraction(100)  # rho and r where no pair is known
ROOM = 2  # rho and r beyond what a proved pair needs


@dataclass(frozen=True, slots=True, kw_only=True)
class Normalisation:
    """I <= P <= ratio I and |Q| <= radius (Frobenius); ``why`` says where they come from."""

    ratio: Fraction
    radius: Fraction
    why: str


def sdpa_text(problem: Problem, *, pair: tuple[Matrix, Matrix] | None = None, verdict: Verdict | None = None) -> str:
    """The file's text.  ``pair``: a proved (P, Q); ``verdict``: what was decided exactly, for the file's first lines.

    Raises: SpecError where the theorems say nothing (couplings that are not C1), and above 4000 rows.
    """
    rows = problem.n * (problem.m + problem.q) * len(problem.network.modes)
    if rows > MOST_ROWS:
        raise _too_large(rows, "rows")
    statements = state_theorems(problem)
    if statements.inapplicable is not None:
        message = f"there is no linear matrix inequality to write: {statements.inapplicable}"
        cure = "The max-separable certificate has linear rows instead: see `dobc certify`."
        raise SpecError(message, key="--sdpa", cure=cure)
    if any(not isinstance(each.constant, SparseSymmetric) for each in statements.lambdas.values()):
        raise _too_large(len(problem.network.labels), "agents with so many arcs")
    pencils = tuple(statements.lambdas.values()) if problem.exosystem is None else statements.psi()
    limits = normalisation(pair)
    places = [place for unknown in pencils[0].unknowns for place in unknown.places()]
    blocks = list(_blocks(pencils, limits, places))
    lines = [f'"{line}' for line in _remarks(problem, statements, limits, verdict)]
    lines += [f"{len(places) + 1}", f"{len(blocks)}", " ".join(str(size) for size, _ in blocks)]
    lines.append(" ".join(["0.0"] * len(places) + ["1.0"]))
    for number, (_, entries) in enumerate(blocks, start=1):
        for (variable, i, j), value in sorted(entries.items()):
            if value:
                lines.append(f"{variable} {number} {i + 1} {j + 1} {float(value)!r}")
    return "\n".join([*lines, ""])


def _too_large(count: int, what: str) -> SpecError:
    return SpecError(
        f"a file of at most {MOST_ROWS} rows is written, because no SDP solver takes more; this has {count} {what}.",
        key="--sdpa",
        cure="`dobc certify` decides large networks without an SDP.",
    )


def normalisation(pair: tuple[Matrix, Matrix] | None) -> Normalisation:
    """Bounds that leave room for a pair, scaled up until P >= I; a hundred without one."""
    if pair is not None:
        P, Q = (to_float(each) for each in pair)
        with np.errstate(all="ignore"):
            eigenvalues = np.linalg.eigvalsh(P)
            scale = max(1.0, 1.0 / float(eigenvalues[0])) if eigenvalues[0] > 0 else math.inf
            ratio, radius = ROOM * scale * float(eigenvalues[-1]), ROOM * scale * float(np.linalg.norm(Q))
        if math.isfinite(ratio) and math.isfinite(radius):
            return Normalisation(ratio=_above(ratio), radius=_above(radius), why="twice what the proved pair needs")
    return Normalisation(ratio=DEFAULT, radius=DEFAULT, why="chosen; no pair is known")


def _above(value: float) -> Fraction:
    """A power of ten or twice or five times one, not below ``value``."""
    exponent = math.floor(math.log10(max(value, 1.0)))
    return next(
        bound
        for factor in (1, 2, 5, 10, 20)
        if (bound := factor * Fraction(10) ** exponent) >= Fraction(max(value, 1.0))
    )


Entries = dict[tuple[int, int, int], Fraction]  # number of F, row, column (upper triangle)


def _blocks(pencils: tuple[Pencil, ...], limits: Normalisation, places: list[Place]) -> Iterator[tuple[int, Entries]]:
    """Size and entries of every block; F_0 has the number 0."""
    last = len(places) + 1
    for pencil in pencils:
        entries = _negated(pencil, places)
        entries |= {(last, i, i): Fraction(1) for i in range(pencil.size)}
        yield pencil.size, entries
    if not pencils[0].unknowns:
        return
    P = pencils[0].unknowns[0]
    for pencil in (positive(P, floor=Fraction(1)), below(P, ceiling=limits.ratio)):
        yield pencil.size, _negated(pencil, places)
    gains = [number for number, place in enumerate(places, start=1) if place[0] == "Q"]
    size = len(gains) + 1
    ball: Entries = {(0, i, i): -limits.radius for i in range(size)}
    ball |= {(number, 0, k): Fraction(1) for k, number in enumerate(gains, start=1)}
    yield size, ball


def _negated(pencil: Pencil, places: list[Place]) -> Entries:
    """-F(x) >= 0 of a pencil F(x) <= 0: F_0 is its constant, every F_k minus its coefficient."""
    constant = pencil.constant
    entries = {(0, i, j): x for (i, j), x in constant.entries.items()} if isinstance(constant, SparseSymmetric) else {}
    for number, place in enumerate(places, start=1):
        coefficient = pencil.coefficients.get(place, SparseSymmetric(pencil.size, {}))
        entries |= {(number, i, j): -value for (i, j), value in coefficient.entries.items()}
    return entries


def _remarks(problem: Problem, statements: Statements, limits: Normalisation, verdict: Verdict | None) -> Iterator[str]:
    modes = len(problem.network.modes)
    name = "Lemma 1" if problem.exosystem is None else "Theorem 1" if modes == 1 else "Theorem 2"
    title = "".join(each if 32 <= ord(each) < 127 and each != '"' else "?" for each in problem.name)
    yield f"{title}: {name} ({statements.domain}), written by dobc_design {__version__}"
    if problem.exosystem is None:
        yield "minimise t subject to Lambda(J) <= t I in every mode; holds iff t* < 0"
    else:
        yield "minimise t subject to Psi(J) <= t I in every mode, I <= P <= rho I, |Q| <= r; x = P (upper), Q, t"
        yield f"rho = {float(limits.ratio):g}, r = {float(limits.radius):g} ({limits.why})"
        yield "t* < 0 proposes a pair (P, Q); t* >= 0 alone says nothing, because rho and r bound the search"
    if any(each.deviations for each in statements.lambdas.values()):
        yield "slopes of the coupling are irrational: midpoints of their enclosures stand here"
    if verdict is not None:
        yield f"decided exactly by dobc_design: {verdict.value}"
