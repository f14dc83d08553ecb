"""Clarabel, asked in one place: linear objectives over cones, and the programs of pencils, one
after the other.

Whatever a solver answers is a proposal that exact arithmetic decides about: a wrong answer costs
time and nothing else. A solver that breaks (raises, runs out of time, answers with something that
is no point) is not asked again.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, Final, Literal

import numpy as np
from scipy import sparse

from dobc_design._checks import positional
from dobc_design.exact.matrix import Array
from dobc_design.exact.pencil import Pencil, Place, positive
from dobc_design.exact.symmetric import Symmetric
from dobc_design.exact.work import seconds_left, spend

from .program import FAILED, Program, Solution, assemble, is_solver_failure

ROOT2: Final = math.sqrt(2.0)
ROW: Final = 5  # steps of work for a row of the cones
TIME_LIMIT: Final = 20.0  # seconds for one program; those of an observer take milliseconds


@positional(eq=False)
class Cone:
    """``right`` - ``rows`` x is the svec of a matrix >= 0, or nonnegative; rows (r, k), right
    (r,)."""

    kind: Literal["semidefinite", "nonnegative"]
    rows: Any
    right: Array


def affine_cone(units: Sequence[Array], right: Array) -> Cone:
    """The sum of x_k units_k, and ``right``, is >= 0: of units that are not symmetric the symmetric
    part."""
    even = [(each + each.T) / 2 for each in units]
    return Cone("semidefinite", np.column_stack([-svec(each) for each in even]), svec(right))


def solve_cones(
    cost: Array,
    cones: Sequence[Cone],
    *,
    squares: Array | None = None,
    time_limit: float = math.inf,
    accuracy: float | None = None,
) -> Solution:
    """Minimise cost'x + x'diag(squares)x / 2 over x (k,) in all ``cones``, by Clarabel;
    ``time_limit`` in s.  Returns: an answer without values where the solver fails in any way; it
    never raises for that."""
    import clarabel

    spend(ROW * sum(len(cone.right) for cone in cones))
    size = len(cost)
    dense = all(isinstance(each.rows, np.ndarray) for each in cones)
    stack = np.vstack if dense else sparse.vstack
    try:
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.time_limit = seconds_left(time_limit)
        # The default, "clique_graph", takes all memory for some small sparse programs (Clarabel
        # 0.11.1).
        settings.chordal_decomposition_merge_method = "parent_child"
        if accuracy is not None:
            settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = accuracy
        curvature = _diagonal(np.zeros(size) if squares is None else squares)
        rows = sparse.csc_matrix(stack([each.rows for each in cones]))
        right = np.concatenate([each.right for each in cones])
        # The cones in Clarabel's words.
        kinds = list[Any]()
        for each in cones:
            length = len(each.right)
            if each.kind == "nonnegative":
                kinds.append(clarabel.NonnegativeConeT(length))
            else:
                kinds.append(clarabel.PSDTriangleConeT(_order(length)))
        solver = clarabel.DefaultSolver(curvature, cost, rows, right, kinds, settings)
        return _read(solver.solve(), size)
    # Clarabel panics with pyo3's PanicException, which is no Exception
    except BaseException as error:
        if not is_solver_failure(error):
            raise
        return Solution(status=f"{FAILED}{type(error).__name__}")


def _diagonal(entries: Array) -> Any:
    """The diagonal matrix of these entries, those that are 0 left out."""
    size = len(entries)
    kept = np.flatnonzero(entries)
    starts = np.searchsorted(kept, np.arange(size + 1))
    return sparse.csc_matrix((entries[kept], kept, starts), shape=(size, size))


def _read(answer: Any, size: int) -> Solution:
    """What the solver answered.  Raises what comes of it if that is no point at all."""
    status = str(answer.status)
    objective = float(answer.obj_val)
    x = np.asarray(answer.x, dtype=np.float64).ravel()
    multipliers = np.asarray(answer.z, dtype=np.float64).ravel()
    finite = np.all(np.isfinite(x)) and math.isfinite(objective)
    # The x of an infeasible or unbounded problem is the ray that shows it, not a point.
    if "Infeasible" in status or not finite:
        return Solution(status=status)
    if len(x) < size:
        raise ValueError(f"a solver answered with {len(x)} numbers, not {size}")
    return Solution(status=status, x=x, multipliers=multipliers, objective=objective)


def svec(matrix: Any) -> Array:
    """The upper triangle (n (n + 1)/2,) of a NumPy or SciPy array (n, n), column by column, others
    times sqrt 2."""
    dense = matrix if isinstance(matrix, np.ndarray) else matrix.toarray()
    i, j, weights = _triangle(len(dense))
    return np.asarray(weights * dense[i, j])


def svec_exact(matrix: Symmetric) -> Array:
    """``svec`` of an exact matrix, from its entries.  Raises: OverflowError beyond the floats."""
    result = np.zeros(matrix.size * (matrix.size + 1) // 2)
    # Entries above the diagonal stand for two, so that inner products stay those of matrices.
    for (i, j), entry in matrix.entries.items():
        weight = 1.0 if i == j else ROOT2
        result[j * (j + 1) // 2 + i] = float(entry) * weight
    return result


@lru_cache(maxsize=8)
def _triangle(size: int) -> tuple[Any, Any, Array]:
    """Rows and columns of the upper triangle of an (n, n) matrix, column by column, and the weight
    of each entry."""
    j, i = np.tril_indices(size)
    return i, j, np.where(i == j, 1.0, ROOT2)


def smat(vector: Array) -> Array:
    """The symmetric matrix (n, n) that ``svec`` writes as ``vector`` (n (n + 1)/2,)."""
    size = _order(len(vector))
    i, j, weights = _triangle(size)
    result = np.zeros((size, size))
    result[i, j] = result[j, i] = vector / weights
    return result


def _order(length: int) -> int:
    """n of a vector of n (n + 1)/2."""
    return (math.isqrt(8 * length + 1) - 1) // 2


def svec_diagonal(size: int) -> Any:
    """Where ``svec`` puts the diagonal of an (n, n) matrix, (n,)."""
    j = np.arange(size)
    return j * (j + 3) // 2


def symmetric_basis(size: int) -> list[Array]:
    """The symmetric matrices (n, n) with one entry 1 in the upper triangle, column by column."""
    vectors = np.eye(size * (size + 1) // 2)
    return [
        np.where(smat(vector) > 0, 1.0, 0.0) for vector in vectors
    ]  # without the weights of ``svec``


def solve_directly(program: Program, *, time_limit: float = 60.0) -> Solution:
    """Solve a Program by Clarabel, without a modelling layer.  A failure is a Solution without
    values."""
    first = program.pencils[0]
    places = [place for unknown in first.unknowns for place in unknown.places()]
    cost = np.array([float(name == "P" and i == j) for name, i, j in places])
    # |Q|^2 keeps W = P^-1 Q small; half of x'diag(squares)x is minimised, hence 2.
    squares = np.array([2.0 * (name == "Q") for name, _, _ in places])
    floor = positive(first.unknowns[0], floor=program.floor)
    try:
        cones = [_cone_of(each, places) for each in (*program.pencils, floor)]
    except (ArithmeticError, ValueError) as error:  # a number beyond the floats
        return Solution(status=f"{FAILED}{type(error).__name__}")
    answer = solve_cones(cost, cones, squares=squares, time_limit=time_limit)
    if not answer.found:
        return answer
    return replace(answer, values=assemble(first, answer.x.tolist()))


def _cone_of(pencil: Pencil, places: Sequence[Place]) -> Cone:
    """-F(x) >= 0, for the unknowns at these places."""
    rows = np.zeros((pencil.size * (pencil.size + 1) // 2, len(places)))
    for k, place in enumerate(places):
        if place in pencil.coefficients:
            rows[:, k] = svec_exact(pencil.coefficients[place])
    return Cone("semidefinite", rows, -svec_exact(pencil.constant))


def solve_in_turn(programs: Iterable[Program]) -> Iterator[Solution]:
    """Solve one after the other by Clarabel, until it breaks: asking it again would be no
    better."""
    for program in programs:
        answer = solve_directly(program, time_limit=TIME_LIMIT)
        yield answer
        if answer.broken:
            return
