"""The matrices of a problem, with those of its certificate, by name: exact, in NumPy, in SymPy, in
LaTeX.

    A, C, W, P, Q   exosystem, observer gain, Lyapunov matrix, P W       K   pinning gains, (n p, n
    m), p = m Ax, B, H   of agents with [dynamics]: A, or the slopes of f at the target, B and H L
    Laplacian of the weights, (n, n)      Lambda   J + J' - (K + K') at the consensus, where slopes
    are rational xbar   the target, (m, 1)

With several modes L and Lambda stand once for each, as L_MODE and Lambda_MODE, and K where modes
have pins of their own.

The inequality of Lemma 1, Theorem 1 or 2 in SDPA's sparse format: minimise t subject to Psi_mode(P,
Q) <= t I for every mode, I <= P <= rho I, |Q| <= r.  Unknowns: the upper triangle of P row by row,
Q row by row, t; solvers read minimise c'x subject to x_1 F_1 + ... + x_k F_k - F_0 >= 0.  t* < 0
proposes a pair (P, Q); t* >= 0 alone says nothing, because rho and r bound the search (theory,
section 2); where there is a proved pair both are taken from it.
"""

import math
from collections.abc import Iterator, Mapping
from fractions import Fraction
from typing import Any

import numpy as np

from dobc_design import __version__
from dobc_design._checks import noun
from dobc_design._show.text import latex_matrix, latex_rows, latex_text
from dobc_design.conditions.consensus.claim import Statements, state_theorems
from dobc_design.errors import SpecError, refused
from dobc_design.exact.matrix import Matrix, to_float
from dobc_design.exact.number import ONE, ZERO
from dobc_design.exact.pencil import Pencil, Place, below, positive
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.loop.make import loop_of
from dobc_design.problem.network import Arcs
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

MOST_ROWS = 500  # of a dense matrix
_LATEX_NAMES = {"xbar": r"\bar{x}", "Lambda": r"\Lambda", "Ax": "A_x"}


def exact_matrices(
    problem: Problem, *, W: Matrix | None, P: Matrix | None, Q: Matrix | None = None
) -> dict[str, Matrix]:
    """All matrices by name, as rationals; W, P and Q are those of the problem or certificate, where
    there are any.
    Raises: SpecError for more than 500 rows."""
    n, m = problem.n, problem.m
    if n * m > MOST_ROWS:
        raise refused(
            "problem",
            f"dense matrices are written for at most {MOST_ROWS} rows; this problem has {n * m}.",
            "model.arrays has them as SciPy sparse matrices.",
        )
    found: dict[str, Matrix] = {}
    exosystem = problem.joint_exosystem  # of several groups: block diagonal, as in certificates
    if exosystem is not None:
        found["A"], found["C"] = exosystem.A, exosystem.C
    dynamics = problem.dynamics
    if dynamics is not None:
        found["Ax"] = dynamics.about(problem.target)[0]
        found["B"] = dynamics.B
        if dynamics.H is not None:
            found["H"] = dynamics.H
    for name, each in (("W", W), ("P", P), ("Q", Q)):
        if each is not None:
            found[name] = each
    own = problem.pinning.modes
    if not own:
        found["K"] = _gains(problem)
    found["xbar"] = tuple((x,) for x in problem.target)
    several = len(problem.network.modes) > 1
    for mode, arcs in problem.network.modes.items():
        if own:
            found[f"K_{mode}" if several else "K"] = _gains(problem, mode)
        found[f"L_{mode}" if several else "L"] = _laplacian(n, arcs)
    for mode, pencil in state_theorems(loop_of(problem)).lambdas.items():
        # Slopes that are not rational have no exact matrix: nothing stands for it.
        if isinstance(pencil.constant, SparseSymmetric) and not pencil.deviations:
            found[f"Lambda_{mode}" if several else "Lambda"] = pencil.constant.to_dense()
    return found


def _gains(problem: Problem, mode: str | None = None) -> Matrix:
    """K, (n p, n m), the gains of the agents along its diagonal, with those of one mode."""
    n, m, p = problem.n, problem.m, problem.inputs
    K = [[ZERO] * (n * m) for _ in range(n * p)]
    for agent, gain in problem.pinning.of(mode).items():
        own = gain if problem.dynamics is None else problem.dynamics.on_states(gain)
        for c in range(p):
            K[agent * p + c][agent * m : agent * m + m] = own[c]
    return tuple(map(tuple, K))


def _laplacian(n: int, arcs: Arcs) -> Matrix:
    L = [[ZERO] * n for _ in range(n)]
    for listener, speaker, weight in arcs:
        L[listener][speaker] -= weight
        L[listener][listener] += weight
    return tuple(map(tuple, L))


def sympy_matrices(found: Mapping[str, Matrix], problem: Problem) -> dict[str, Any]:
    """The same as SymPy matrices of rationals, and the default coupling "h" as a column in y, or y1
    to ym."""
    import sympy

    from dobc_design.model.algebras import to_sympy

    def rationals(M: Matrix) -> Any:
        rows = [[sympy.Rational(x.numerator, x.denominator) for x in row] for row in M]
        return sympy.Matrix(rows)

    result = {name: rationals(each) for name, each in found.items()}
    result["h"] = sympy.Matrix([to_sympy(each)[0] for each in problem.coupling.components])
    return result


def latex_of(found: Mapping[str, Matrix], problem: Problem) -> str:
    """h and the matrices as displayed LaTeX equations, one after the other; above 12 rows only
    their size.  Rationals of more than 12 digits are rounded to four."""
    h = problem.coupling.latex
    column = h[0] if problem.coupling.by_component else latex_rows(h)
    lines = [f"h(y) = {column}"]
    for name, each in found.items():
        head, _, mode = name.partition("_")
        shown = _LATEX_NAMES.get(head, head)
        if mode:
            shown += rf"_{{{latex_text(mode)}}}"
        entries = latex_matrix(each)
        if entries is None:  # too large to be shown
            lines.append(rf"{shown} \in \mathbb{{R}}^{{{len(each)} \times {len(each[0])}}}")
        else:
            lines.append(f"{shown} = {entries}")
    return "\n".join(f"\\[ {line} \\]" for line in lines) + "\n"


MOST_SDPA_ROWS = 4000
DEFAULT = Fraction(100)  # rho and r where no pair is known
ROOM = 2  # rho and r beyond what a proved pair needs


@noun
class Normalisation:
    """I <= P <= ratio I and |Q| <= radius (Frobenius); ``why`` says where they come from."""

    ratio: Fraction
    radius: Fraction
    why: str


def sdpa_text(
    problem: Problem, *, pair: tuple[Matrix, Matrix] | None = None, verdict: Verdict | None = None
) -> str:
    """The file's text.  ``pair``: a proved (P, Q); ``verdict``: what was decided exactly, for the
    file's first lines.
    Raises: SpecError where the theorems say nothing (couplings that are not C1), and above 4000
    rows."""
    rows = problem.n * (problem.m + problem.q) * len(problem.network.modes)
    if rows > MOST_SDPA_ROWS:
        raise _too_large(rows, "rows")
    statements = state_theorems(loop_of(problem))
    if statements.inapplicable is not None:
        raise refused(
            "--sdpa",
            f"there is no linear matrix inequality to write: {statements.inapplicable}",
            "The max-separable certificate has linear rows instead: see `dobc certify`.",
        )
    lambdas = tuple(statements.lambdas.values())
    if any(not isinstance(each.constant, SparseSymmetric) for each in lambdas):
        raise _too_large(problem.n, "agents with so many arcs")
    pencils = lambdas if problem.exosystem is None else statements.psi()
    limits = normalisation(pair)
    places = [place for unknown in pencils[0].unknowns for place in unknown.places()]
    blocks = list(_blocks(pencils, limits, places))
    lines = [f'"{line}' for line in _remarks(problem, statements, limits, verdict)]
    lines += [str(len(places) + 1), str(len(blocks))]
    lines.append(" ".join(str(block.size) for block in blocks))
    lines.append(" ".join(["0.0"] * len(places) + ["1.0"]))  # of all unknowns t is minimised
    for number, block in enumerate(blocks, start=1):
        for (variable, i, j), value in sorted(block.entries.items()):
            if value:
                lines.append(f"{variable} {number} {i + 1} {j + 1} {float(value)!r}")
    return "\n".join([*lines, ""])


def _too_large(count: int, what: str) -> SpecError:
    return refused(
        "--sdpa",
        f"a file of at most {MOST_SDPA_ROWS} rows is written, because no SDP solver takes more"
        f"; this has {count} {what}.",
        "`dobc certify` decides large networks without an SDP.",
    )


def normalisation(pair: tuple[Matrix, Matrix] | None) -> Normalisation:
    """Bounds that leave room for a pair, scaled up until P >= I; a hundred without one."""
    if pair is not None:
        P, Q = (to_float(each) for each in pair)
        with np.errstate(all="ignore"):
            eigenvalues = np.linalg.eigvalsh(P)
            least, largest = float(eigenvalues[0]), float(eigenvalues[-1])
            # So much larger P has to be for P >= I; the pair may be scaled as a whole.
            scale = max(1.0, 1.0 / least) if least > 0 else math.inf
            ratio = ROOM * scale * largest
            radius = ROOM * scale * float(np.linalg.norm(Q))
        if math.isfinite(ratio) and math.isfinite(radius):
            why = "twice what the proved pair needs"
            return Normalisation(ratio=_above(ratio), radius=_above(radius), why=why)
    return Normalisation(ratio=DEFAULT, radius=DEFAULT, why="chosen; no pair is known")


def _above(value: float) -> Fraction:
    """A power of ten or twice or five times one, not below ``value``."""
    least = max(value, 1.0)
    decade = Fraction(10) ** math.floor(math.log10(least))
    bounds = (factor * decade for factor in (1, 2, 5, 10, 20))
    return next(bound for bound in bounds if bound >= Fraction(least))


Entries = dict[tuple[int, int, int], Fraction]  # number of F, row, column (upper triangle)


@noun
class _Block:
    """A block along the diagonal of every F; F_0 has the number 0."""

    size: int
    entries: Entries


def _blocks(
    pencils: tuple[Pencil, ...], limits: Normalisation, places: list[Place]
) -> Iterator[_Block]:
    last = len(places) + 1
    for pencil in pencils:
        entries = _negated(pencil, places)
        for i in range(pencil.size):  # t I - Psi >= 0
            entries[last, i, i] = ONE
        yield _Block(size=pencil.size, entries=entries)
    if not pencils[0].unknowns:
        return
    P = pencils[0].unknowns[0]
    for pencil in (positive(P, floor=ONE), below(P, ceiling=limits.ratio)):
        yield _Block(size=pencil.size, entries=_negated(pencil, places))
    # |Q| <= r: the entries of Q beside r I, an arrow that is positive semidefinite.
    gains = [number for number, place in enumerate(places, start=1) if place[0] == "Q"]
    size = len(gains) + 1
    # F_0 is subtracted, so that r I enters with a minus sign.
    ball: Entries = {(0, i, i): -limits.radius for i in range(size)}
    for k, number in enumerate(gains, start=1):
        ball[number, 0, k] = ONE
    yield _Block(size=size, entries=ball)


def _negated(pencil: Pencil, places: list[Place]) -> Entries:
    """-F(x) >= 0 of a pencil F(x) <= 0: F_0 is its constant, every F_k minus its coefficient."""
    entries: Entries = {}
    if isinstance(pencil.constant, SparseSymmetric):
        for (i, j), x in pencil.constant.entries.items():
            entries[0, i, j] = x
    for number, place in enumerate(places, start=1):
        coefficient = pencil.coefficients.get(place)
        if coefficient is not None:
            for (i, j), x in coefficient.entries.items():
                entries[number, i, j] = -x
    return entries


def _remarks(
    problem: Problem, statements: Statements, limits: Normalisation, verdict: Verdict | None
) -> Iterator[str]:
    modes = len(problem.network.modes)
    name = "Theorem 1" if modes == 1 else "Theorem 2"
    if problem.exosystem is None:
        name = "Lemma 1"
    # A line of the file has to stay one, whatever the name is.
    title = "".join(each if 32 <= ord(each) < 127 and each != '"' else "?" for each in problem.name)
    yield f"{title}: {name} ({statements.domain}), written by dobc_design {__version__}"
    if problem.exosystem is None:
        yield "minimise t subject to Lambda(J) <= t I in every mode; holds iff t* < 0"
    else:
        goal = "minimise t subject to Psi(J) <= t I in every mode, I <= P <= rho I, |Q| <= r"
        yield f"{goal}; x = P (upper), Q, t"
        yield f"rho = {float(limits.ratio):g}, r = {float(limits.radius):g} ({limits.why})"
        alone = "t* >= 0 alone says nothing, because rho and r bound the search"
        yield f"t* < 0 proposes a pair (P, Q); {alone}"
    if any(each.deviations for each in statements.lambdas.values()):
        yield "slopes of the coupling are irrational: midpoints of their enclosures stand here"
    if verdict is not None:
        yield f"decided exactly by dobc_design: {verdict.value}"
