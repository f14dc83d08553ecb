"""Diagnostics of a problem: observability, spectrum, graphs, eigenvalues at the consensus.

Everything here is floating point (but for the graphs) and explains; verdicts come from ``verify``.
"""

from collections import defaultdict
from collections.abc import Sequence
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import linalg, sparse
from scipy.sparse.csgraph import connected_components

from dobc_design._checks import noun, require_shape, require_square
from dobc_design._show.cards import Card, Headed
from dobc_design.conditions.consensus.claim import state_theorems
from dobc_design.conditions.reason import Reason
from dobc_design.conditions.weighted.network import Network as Alike
from dobc_design.conditions.weighted.network import network_of
from dobc_design.errors import wrong
from dobc_design.exact.interval import UndefinedError
from dobc_design.exact.matrix import Array, Matrix, multiply, subtract, to_float
from dobc_design.exact.reading import Texts
from dobc_design.loop.arcs import closed_groups, split_by, unreached
from dobc_design.loop.arrays import Gain, chosen_gain
from dobc_design.loop.loop import Loop
from dobc_design.loop.make import loop_of
from dobc_design.loop.matrices import consensus_jacobian, pull_matrix
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.groups import group_numbers
from dobc_design.problem.problem import Problem


@noun
class SpectrumResult:
    """Eigenvalues of A - W C, slowest first, and the decay rate they give; both in 1/s."""

    eigenvalues: tuple[complex, ...]
    rate: float

    def __str__(self) -> str:
        word = "decays at" if self.rate > 0 else "does not decay: rate"
        return f"the estimation error {word} {self.rate:.4g} 1/s"


def check_spectrum(A: Matrix, C: Matrix, W: Matrix) -> SpectrumResult:
    """Eigenvalues of A - W C (17), A (q, q), C (m, q), W (q, m), and the rate -max Re in 1/s.
    Raises: ShapeError."""
    m, q = _require_pair(A, C)
    because = "one row per exosystem state, one column per disturbance component"
    require_shape(W, (q, m), name="W", because=because)
    # Exact as long as possible: only the difference is rounded.
    dynamics = to_float(subtract(A, multiply(W, C)))
    poles = _slowest_first(np.linalg.eigvals(dynamics))
    return SpectrumResult(eigenvalues=poles, rate=-poles[0].real)


def _require_pair(A: Matrix, C: Matrix) -> tuple[int, int]:
    """The shape (m, q) of C, beside A (q, q).  Raises: ShapeError."""
    q = require_square(A, "A")
    return require_shape(C, (None, q), name="C", because="one column per exosystem state")


def _slowest_first(eigenvalues: ArrayLike) -> tuple[complex, ...]:
    values = map(complex, np.ravel(eigenvalues))
    return tuple(sorted(values, key=lambda s: (-s.real, s.imag)))


@noun
class ModeMargin:
    """An eigenvalue of A (1/s) and the smallest singular value of [A - eigenvalue I; C]; 0 means
    unseen."""

    eigenvalue: complex
    margin: float


@noun
class ObservabilityResult:
    """Rank and singular values of the observability matrix, and the Popov-Belevitch-Hautus margin
    of each mode. ``rank`` is numerical (NumPy's default tolerance), None if the matrix overflows;
    ``order`` is q."""

    order: int
    rank: int | None
    singular_values: tuple[float, ...]
    modes: tuple[ModeMargin, ...]

    @property
    def margin(self) -> float:
        return min(mode.margin for mode in self.modes)

    def __str__(self) -> str:
        rank = "unknown" if self.rank is None else self.rank
        return f"rank {rank} of {self.order}, smallest mode margin {self.margin:.4g}"


def check_observability(A: Matrix, C: Matrix) -> ObservabilityResult:
    """Rank, singular values and mode margins of the pair A (q, q), C (m, q) of (12).  Raises:
    ShapeError."""
    _, q = _require_pair(A, C)
    dynamics, output = to_float(A), to_float(C)
    rank: int | None = None
    values: tuple[float, ...] = ()
    # C, C A, ..., C A^(q-1), one below the other: what `control.obsv` gives, whose import takes
    # half a second.
    blocks = [output]
    with np.errstate(all="ignore"):
        for _ in range(1, q):
            blocks.append(blocks[-1] @ dynamics)
    matrix = np.vstack(blocks)
    if np.isfinite(matrix).all():  # powers of A may overflow; the margins do not need them
        rank = int(np.linalg.matrix_rank(matrix))
        values = tuple(np.linalg.svd(matrix, compute_uv=False).tolist())
    modes = []
    for s in map(complex, np.linalg.eigvals(dynamics)):
        # The rank drops at s if that mode never shows in the output.
        pencil = np.vstack([dynamics - s * np.eye(q), output])
        smallest = np.linalg.svd(pencil, compute_uv=False)[-1]
        modes.append(ModeMargin(eigenvalue=s, margin=float(smallest)))
    return ObservabilityResult(order=q, rank=rank, singular_values=values, modes=tuple(modes))


@noun
class GraphFacts:
    """Facts of one mode, agents by label in the order of the network.  ``unreached``: agents that
    no pinned agent reaches.  ``components``: the strongly connected components, ordered by their
    first agent.  ``sources``: those of them that hear nobody outside; unless each has a pinned
    agent, somebody is unreached.  ``balanced``: every agent hears as much weight as it sends,
    exactly. ``heard`` and ``hearing`` count, per agent, whom it hears and who hears it."""

    mode: str
    arcs: int
    unreached: Texts
    components: tuple[Texts, ...]
    sources: tuple[Texts, ...]
    balanced: bool
    heard: tuple[int, ...]
    hearing: tuple[int, ...]

    @property
    def is_strongly_connected(self) -> bool:
        return len(self.components) == 1

    def __str__(self) -> str:
        reached = "all agents reached"
        if self.unreached:
            reached = f"not reached: {', '.join(self.unreached[:10])}"
        if len(self.unreached) > 10:
            reached += f" and {len(self.unreached) - 10} more"
        parts = f"{len(self.components)} strongly connected component(s)"
        balance = "balanced" if self.balanced else "not balanced"
        return f'mode "{self.mode}": {self.arcs} arcs, {parts}, {balance}, {reached}'


def graph_facts(problem: Problem, mode: str) -> GraphFacts:
    """Collect the graph facts of one mode; an agent counts as pinned if its gain is not zero.
    Raises: KeyError."""
    arcs, labels, n = problem.network.modes[mode], problem.network.labels, problem.n
    # The matrix of who is heard by whom: strong components do not ask for weights.
    between = arcs.where(arcs.speakers < n)
    ends = (between.speakers, between.listeners)
    hearing = sparse.csr_array((np.ones(len(between)), ends), shape=(n, n))
    _, numbers = connected_components(hearing, directed=True, connection="strong")
    components = sorted(part.tolist() for _, part in split_by(numbers.astype(np.int64)))
    loop = loop_of(problem)
    own = [loop.modes[mode]]  # with its pins
    closed = set(closed_groups(loop, own))
    surplus: dict[int, Fraction] = defaultdict(Fraction)  # weight heard less weight sent
    for listener, speaker, weight in arcs:
        surplus[listener] += abs(weight)
        surplus[speaker] -= abs(weight)

    def named(agents: Sequence[int]) -> Texts:
        return tuple(labels[agent] for agent in agents)

    return GraphFacts(
        mode=mode,
        arcs=len(arcs),
        unreached=named(unreached(loop, own, pins=loop.pins)),
        components=tuple(map(named, components)),
        sources=tuple(named(part) for part in components if tuple(part) in closed),
        balanced=not any(surplus[agent] for agent in range(n)),
        heard=tuple(np.bincount(arcs.listeners, minlength=n).tolist()),
        hearing=tuple(np.bincount(between.speakers, minlength=n).tolist()),
    )


MAX_DENSE = 2000  # rows of the largest matrix whose eigenvalues are computed


class SecondOrder(NamedTuple):
    """Double integrators that feel alpha p + beta p' of each other: beta^2/alpha, and what that has
    to exceed, max Im(mu)^2/(Re(mu) |mu|^2) over the eigenvalues mu of L + K (Yu, Chen and Cao,
    2010)."""

    ratio: float
    least: float

    def __str__(self) -> str:
        return f"double integrators: beta^2/alpha = {self.ratio:.4g} has to exceed {self.least:.4g}"


@noun
class ModeSpectrum:
    """Eigenvalues at the consensus in 1/s: of Lambda(J(0)), ascending, and of J(0) - K, slowest
    first; or None. ``second_order``: of double integrators."""

    mode: str
    lambda_eigenvalues: tuple[float, ...] | None
    loop_eigenvalues: tuple[complex, ...] | None
    second_order: SecondOrder | None = None

    @property
    def lambda_max(self) -> float | None:
        """The largest eigenvalue of Lambda(J(0)); below 0 the network part of (18) is met at the
        consensus."""
        return self.lambda_eigenvalues[-1] if self.lambda_eigenvalues else None

    @property
    def decay_rate(self) -> float | None:
        """-max Re of the eigenvalues of J(0) - K, the decay of small errors when the disturbance is
        known."""
        return -self.loop_eigenvalues[0].real if self.loop_eigenvalues else None

    def __str__(self) -> str:
        said = []
        if self.lambda_max is not None:
            said.append(f"lambda_max(Lambda) = {self.lambda_max:.4g}")
        if self.decay_rate is not None:
            said.append(f"small errors decay at {self.decay_rate:.4g} 1/s")
        if self.second_order is not None:
            said.append(str(self.second_order))
        text = ", ".join(said) or "eigenvalues at the consensus not computed"
        return f'mode "{self.mode}": {text}'


@noun
class Analysis(Headed):
    """Diagnostics of a problem, one entry per mode in ``graphs`` and ``modes``.

    ``observability`` is None without an exosystem, ``spectrum`` also without an observer gain.
    ``obsv``, ``poles``, ``observer`` and ``error_system`` are for going on with NumPy and
    python-control.
    """

    loop: Loop
    W: Matrix | None
    name: str
    observability: ObservabilityResult | None
    spectrum: SpectrumResult | None
    graphs: tuple[GraphFacts, ...]
    modes: tuple[ModeSpectrum, ...]

    @property
    def obsv(self) -> Array:
        """The observability matrix of (A, C): C, C A, ..., C A^(q-1), (m q, q).  Raises: SpecError
        without an exosystem."""
        import control

        exosystem = self._exosystem()
        return np.asarray(control.obsv(to_float(exosystem.A), to_float(exosystem.C)))

    @property
    def poles(self) -> NDArray[np.complex128]:
        """The eigenvalues of A - W C (q,), slowest first, in 1/s.  Raises: SpecError without a
        gain."""
        self._gain()
        return np.array(self.spectrum.eigenvalues if self.spectrum else ())

    @property
    def observer(self) -> Any:
        """The observer (13) of one agent as a control.StateSpace: z' = (A - W C)(z + W x) - W v,
        dhat = C (z + W x); inputs x and v (the couplings and u), m each.

        Where agents differ in their exosystem it holds all groups side by side.  Raises: SpecError
        without a gain.
        """
        import control

        exosystem = self._exosystem()
        A, C, W = (to_float(each) for each in (exosystem.A, exosystem.C, self._gain()))
        F = A - W @ C
        direct = np.hstack([C @ W, np.zeros((len(C), W.shape[1]))])
        return control.ss(F, np.hstack([F @ W, -W]), C, direct)

    def error_system(self, mode: str | None = None) -> Any:
        """The error system (22) at the consensus as a control.StateSpace: states e (n m) and eps of
        all agents; the input w (n m) adds to e', the output is e.

        ``mode``: by default the first.  Raises: SpecError without a gain, KeyError for a mode that
        does not exist, and UndefinedError where a coupling has no slope at 0.
        Example:
            >>> system = dd.analyse("paper-fixed").error_system()
            >>> system.nstates, bool(max(system.poles().real) < 0)
            (30, True)
        """
        import control

        loop = self.loop
        jacobian = consensus_jacobian(loop, mode or next(iter(loop.modes)))
        if jacobian is None:
            raise UndefinedError("a coupling has no slope at 0, so there is no linearisation")
        network = (jacobian - pull_matrix(loop)).toarray()
        residuals = self._residuals()
        inside = linalg.block_diag(*(F for F, _ in residuals))
        acting = linalg.block_diag(*(C for _, C in residuals))
        rows, columns = inside.shape[0], network.shape[0]
        A = np.block([[network, acting], [np.zeros((rows, columns)), inside]])
        eye = np.eye(columns, columns + rows)
        return control.ss(A, eye.T, eye, np.zeros((columns, columns)))

    def _residuals(self) -> list[tuple[Array, Array]]:
        """A - W C and C of every agent; without rows where it has no disturbance."""
        loop = self.loop
        nothing = np.zeros((0, 0)), np.zeros((loop.m, 0))
        kinds = []
        for place, group in enumerate(loop.groups):
            A, C = to_float(group.exosystem.A), to_float(group.exosystem.C)
            W = group.observer.W if loop.is_grouped else self._gain()
            if W is None:
                raise wrong("observer.W", f"of group {place + 1} is missing.", "Give every W.")
            kinds.append((A - to_float(W) @ C, C))
        return [[*kinds, nothing][k] for k in group_numbers(loop.groups, loop.labels)]

    def _exosystem(self) -> Exosystem:
        exosystem = self.loop.joint_exosystem
        if exosystem is None:
            raise wrong("exosystem", "is missing: there is no disturbance to observe.")
        return exosystem

    def _gain(self) -> Matrix:
        if self.W is None:
            cure = "Give observer.W, or take the one that certify designs: certificate.W_exact."
            raise wrong("observer.W", "is missing.", cure)
        return self.W

    @property
    def lines(self) -> Texts:
        """The facts in words, one line each."""
        found: list[str] = []
        if self.observability is not None:
            found.append(f"observability of (A, C): {self.observability}")
        if self.spectrum is not None:
            found.append(str(self.spectrum))
        return (*found, *map(str, self.graphs), *map(str, self.modes))

    def _card(self) -> Card:
        return Card(title=self.name, text="diagnostics, not proofs", lines=self.lines)


def analyse(problem: Problem, *, gain: Gain | None = None) -> Analysis:
    """Collect the diagnostics; ``gain`` (q, m) takes the place of problem.observer.W.  Of agents
    with [dynamics] Lambda and J - K are those of their errors.  Raises: SpecError."""
    loop = loop_of(problem)
    # A gain that is handed in takes the place of the file's, for this diagnosis only.
    W = chosen_gain(loop, gain)
    exosystem = loop.joint_exosystem
    observability, spectrum = None, None
    if exosystem is not None:
        observability = check_observability(exosystem.A, exosystem.C)
        if W is not None and not loop.is_sampled:
            spectrum = check_spectrum(exosystem.A, exosystem.C, W)
    # Where they feel their neighbours alike, the eigenvalues of the network alone are enough.
    alike = None
    if problem.dynamics is not None and problem.n <= MAX_DENSE and problem.has_target:
        alike = network_of(state_theorems(loop))
    modes = tuple(problem.network.modes)
    return Analysis(
        loop=loop,
        W=W,
        name=problem.name,
        observability=observability,
        spectrum=spectrum,
        graphs=tuple(graph_facts(problem, mode) for mode in modes),
        modes=tuple(mode_spectrum(loop, mode, alike) for mode in modes),
    )


def mode_spectrum(loop: Loop, mode: str, alike: Alike | Reason | None = None) -> ModeSpectrum:
    """Compute the eigenvalues of Lambda(J(0)) and of J(0) - K of one mode, up to 2000 rows; up to
    2000 agents that feel their neighbours ``alike``: then those are of A - mu G, with mu of the
    network alone."""
    ascending = found = second_order = None
    if loop.size <= MAX_DENSE:
        jacobian = consensus_jacobian(loop, mode)
        if jacobian is not None:
            found = (jacobian - pull_matrix(loop)).toarray()
            ascending = tuple(np.linalg.eigvalsh(found + found.T).tolist())
    if isinstance(alike, Alike):
        alone = alike.statements.loop
        jacobian = consensus_jacobian(alone, mode)
        # None where couplings of the network have a kink
        if jacobian is not None:
            # The eigenvalues of L + K of the network alone.
            mu = np.linalg.eigvals((pull_matrix(alone) - jacobian).toarray())
            A, G = to_float(alike.A), to_float(alike.G)
            found = A - mu[:, None, None] * G
            second_order = _second_order(A, G, mu)
    return ModeSpectrum(
        mode=mode,
        lambda_eigenvalues=ascending,
        loop_eigenvalues=None if found is None else _slowest_first(np.linalg.eigvals(found)),
        second_order=second_order,
    )


def _second_order(A: Array, G: Array, mu: NDArray[np.complex128]) -> SecondOrder | None:
    """The condition of Yu, Chen and Cao; None of agents that are no such double integrators."""
    are_double_integrators = np.array_equal(A, [[0, 1], [0, 0]]) and not G[0].any()
    if not are_double_integrators or min(G[1]) <= 0 or min(mu.real) <= 0:
        return None
    alpha, beta = G[1]
    least = np.max(mu.imag**2 / (mu.real * np.abs(mu) ** 2))
    return SecondOrder(ratio=float(beta**2 / alpha), least=float(least))
