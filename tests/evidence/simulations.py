"""Random loops, simulated: against matrix exponentials and powers of matrices, under stress, below
certified bounds."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from evidence.row import Row
from networks import linked, random_arcs
from scipy.linalg import expm
from simulated_runs import simulate, simulate_many

from dobc_design import Exosystem, Failure, Observer, Problem, Stress, certify
from dobc_design.loop.arrays import pinning_matrix
from dobc_design.loop.make import loop_of
from dobc_design.loop.matrices import consensus_jacobian
from dobc_design.simulation.runs import simulate as simulate_problem
from dobc_design.simulation.signals import Periodic, RandomDwell

CLOSE = 1e-9
HORIZON = 2.0


def loop(rng: np.random.Generator, *, coupling: list[str] | str | None = None) -> Problem:
    """Two random digraphs on 2 to 7 agents, m = 1 to 3, q = 0 to 3; entries are small dyadic
    numbers."""
    n, m, q = (int(rng.integers(low, high)) for low, high in ((2, 8), (1, 4), (0, 4)))

    def dyadic(*shape: int) -> Any:
        return (rng.integers(-8, 9, size=shape) / 8).tolist()

    def graph() -> list[list[Any]]:
        pairs = random_arcs(rng, n, 0.5) or [[1, 2]]
        found = []
        for i, j in pairs:
            found.append([i, j, int(rng.integers(1, 5)) / 4])
        return found

    rows = dyadic(m, m)
    linear = [" + ".join(f"({a})*y{c + 1}" for c, a in enumerate(row)) for row in rows]
    h = linear if m > 1 else linear[0].replace("y1", "y")
    modes = {"a": graph(), "b": graph()}
    given: dict[str, Any] = {"target": dyadic(m)}
    given["gains"] = {str(i + 1): 2 for i in range(0, n, 2)}
    if q:
        given["exosystem"] = Exosystem(A=dyadic(q, q), C=dyadic(m, q))
        given["observer"] = Observer(W=dyadic(q, m))
    return linked(modes, n, h if coupling is None else coupling, **given)


def start_of(problem: Problem, rng: np.random.Generator) -> dict[str, Any]:
    n = problem.n
    m = problem.m
    q = problem.q
    sizes = {"x": m, "xi": q, "xihat": q}
    return {name: rng.normal(size=(n, size)) for name, size in sizes.items()}


def matrices(problem: Problem, mode: str) -> tuple[Any, ...]:
    """J - K, A, C, W as floats."""
    J = consensus_jacobian(loop_of(problem), mode).toarray() - pinning_matrix(problem).toarray()
    if problem.q == 0:
        return J, np.zeros((0, 0)), np.zeros((problem.m, 0)), np.zeros((0, problem.m))
    return J, *(
        np.array(M, float) for M in (problem.exosystem.A, problem.exosystem.C, problem.observer.W)
    )


def errors_of(run: Any) -> Any:
    parts = [
        (run.x - run.goal).reshape(len(run.times), -1),
        (run.xi - run.xihat).reshape(len(run.times), -1),
    ]
    return np.concatenate(parts, axis=1)


def compared(
    what: str, count: int, seed: int, case: Callable[[np.random.Generator, int], tuple[Any, Any]]
) -> Row:
    """``case`` gives the errors of a run and what they have to be."""
    failures, worst = [], 0.0
    for number in range(count):
        found, wanted = case(np.random.default_rng([seed, number]), number)
        gap = float(np.abs(found - wanted).max() / max(1.0, np.abs(wanted).max()))
        worst = max(worst, gap)
        if not gap < CLOSE:
            failures.append(f"seed [{seed}, {number}]: {gap:.1e} apart")
    return Row(what, count, failures, [f"largest difference {worst:.1e}"], least=count)


def linear(count: int, seed: int) -> Row:
    """Switched linear loops by both routes (odd numbers: the full loop) against the product of
    their exponentials."""

    def case(rng: np.random.Generator, number: int) -> tuple[Any, Any]:
        problem = loop(rng)
        dwell = float(rng.uniform(0.1, 0.9))
        start = start_of(problem, rng)
        route = ("closed-form", "full-loop")[number % 2]
        run = simulate(
            problem,
            signal=Periodic(dwell=dwell),
            start=start,
            t_final=HORIZON,
            samples=9,
            observer=route,
            tolerance=1e-12,
        )
        n = problem.n
        wanted = errors_of(run)[:1]
        for t in run.times[1:]:
            state = wanted[0]
            now = 0.0
            for stretch in range(int(t / dwell) + 1):
                J, A, C, W = matrices(problem, "ab"[stretch % 2])
                end = min(t, (stretch + 1) * dwell)
                none = np.zeros((n * len(A), len(J)))
                first = [J, np.kron(np.eye(n), C)]
                second = [none, np.kron(np.eye(n), A - W @ C)]
                block = np.block([first, second])
                state = expm(block * (end - now)) @ state
                now = end
            wanted = np.concatenate([wanted, state[None]])
        return errors_of(run), wanted

    return compared(
        "switched linear loops, both routes, against matrix exponentials", count, seed, case
    )


def sampled(count: int, seed: int) -> Row:
    """Sampled linear loops against the powers of their matrices; Ad, Cd and L by Gauss
    quadrature."""
    nodes, weights = np.polynomial.legendre.leggauss(16)

    def case(rng: np.random.Generator, number: int) -> tuple[Any, Any]:
        problem = loop(rng)
        period = float(rng.choice([1 / 4, 1 / 8, 1 / 16, 1 / 32]))
        run = simulate(
            problem,
            mode="a",
            start=start_of(problem, rng),
            t_final=HORIZON,
            samples=int(HORIZON / period) + 1,
            stress=Stress(period=period),
        )
        J, A, C, W = matrices(problem, "a")
        n = problem.n
        F = A - W @ C
        spots = list(zip(period * (nodes + 1) / 2, weights / 2, strict=True))
        Cd = C @ sum((w * expm(A * s) for s, w in spots), np.zeros_like(A))
        L = period * sum((w * expm(F * s) for s, w in spots), np.zeros_like(A)) @ W
        none = np.zeros((n * len(A), len(J)))
        first = [np.eye(len(J)) + period * J, period * np.kron(np.eye(n), Cd)]
        second = [none, np.kron(np.eye(n), expm(A * period) - L @ Cd)]
        block = np.block([first, second])
        found = errors_of(run)
        wanted = [found[0]]
        for _ in found[1:]:
            wanted.append(block @ wanted[-1])
        return found, np.array(wanted)

    return compared("sampled linear loops against powers of their matrices", count, seed, case)


def stressed(count: int, seed: int) -> Row:
    """Random stresses in any combination, two runs side by side: the same as one by one, where all
    is integrated; the single runs keep their bounds and are valid where they end."""
    failures = []
    worst = 0.0
    alone = 0
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        problem = loop(rng, coupling="exp(y) - 1 + y" if number % 2 else "2*tanh(y/2)")
        stress = random_stress(rng, problem)
        given = {
            "signal": RandomDwell(dwell=0.11),
            "start": start_of(problem, rng),
            "t_final": 1.0,
            "samples": 14,
        }
        many = simulate_many(problem, runs=2, seed=number, stress=stress, **given)
        alone += "side by side" not in many.method
        for row in range(2):
            run = simulate(problem, seed=number + row, stress=stress, **given)
            kept = int(np.searchsorted(many.times, run.times[-1], side="right"))
            error = np.abs(many.error[row, :kept] - run.error()[:kept]).max()
            estimates = run.estimation_error()[:kept]
            off = np.abs(many.estimation_error[row, :kept] - estimates).max()
            gap = max(error / (1 + np.abs(run.x).max()), off / (1 + np.abs(run.d).max()))
            worst = max(worst, float(gap))
            wrong = list(broken(run, stress))
            alike = many.diverged[row] == run.diverged
            alike = alike and many.switches[row] == len(run.switches) - 1
            if not (gap < 1e-5 and alike):
                wrong.append(f"{gap:.1e} apart")
            failures += [f"seed [{seed}, {number}], {stress}: {each}" for each in wrong]
    if 4 * alone > count:  # else the runs would have been held against themselves
        failures.append(f"{alone} of {count} ensembles were made one by one")
    what = "random stresses, side by side against one by one"
    return Row(what, count, failures, [f"largest difference {worst:.1e}"], least=count)


def broken(run: Any, stress: Stress) -> Iterator[str]:
    """What a run under stress must not do."""
    if not all(np.isfinite(part).all() for part in (run.x, run.u, run.dhat)):
        yield "not finite"
    if stress.saturation is not None and not np.abs(run.u).max() <= stress.saturation:
        yield "u beyond its bound"
    for each in stress.failures:
        late = run.u[run.times >= each.time + (stress.period or 0.0), int(each.agent) - 1]
        if late.size and (np.ptp(late, axis=0).any() if each.kind == "freeze" else late.any()):
            yield f"agent {each.agent} still acts"


def random_stress(rng: np.random.Generator, problem: Problem) -> Stress:
    """Each option with probability 1/2; at least one."""
    chosen = rng.random(6) < 0.5
    chosen[rng.integers(6)] = True
    failing = rng.permutation(problem.n)[: rng.integers(1, problem.n)] if chosen[5] else []
    failures = []
    for i in failing:
        time = float(rng.choice([0.0, 0.25, 0.8]))
        kind = str(rng.choice(["vanish", "freeze"]))
        failures.append(Failure(agent=str(i + 1), time=time, kind=kind))
    return Stress(
        noise=0.05 * chosen[0],
        disturbance=0.5 * chosen[1],
        frequency=float(rng.choice([0.0, 1.0, 9.0])),
        saturation=1.5 if chosen[2] else None,
        period=0.0625 if chosen[3] else None,
        loss=0.4 * chosen[4],
        failures=tuple(failures),
    )


def bounded(count: int, seed: int) -> Row:
    """Random problems with a region: no simulated run crosses the bound that its certificate
    gives."""
    failures = []
    drawn = 0
    closest = 0.0
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        problem = regional(rng)
        certificate = certify(problem)
        many = simulate_problem(
            problem,
            runs=50,
            signal=Periodic(dwell=float(rng.uniform(0.1, 0.9))),
            t_final=5.0,
            samples=101,
        )
        bound = certificate.envelope(many)
        if not bound.sources:
            continue
        drawn += 1
        large = (bound(many.times) > 1e-3 * bound(0.0)) & (many.times > 0)
        closest = max(closest, float(np.nanmax((many.error / bound(many.times))[:, large])))
        integrated = CLOSE * bound(0.0)  # the error of the integration
        if many.diverged.any() or not (many.error <= bound(many.times) + integrated).all():
            failures.append(
                f"seed [{seed}, {number}]: a run crosses the bound of {', '.join(bound.sources)}"
            )
    if 4 * drawn < count:  # else the runs would have been held against nothing
        failures.append(f"only {drawn} of {count} certificates bound their runs")
    what = "certified bounds of |e(t)| against 50 simulated runs each"
    return Row(
        what,
        count,
        failures,
        [f"{drawn} with a bound; a run came to {closest:.0%} of it"],
        least=count,
    )


def regional(rng: np.random.Generator) -> Problem:
    """Two random digraphs on 2 to 6 agents, most of them pinned, with starts to be covered."""
    n = int(rng.integers(2, 7))

    pins = {}
    for i in range(1, n + 1):
        if rng.random() < 0.8:
            pins[str(i)] = float(rng.choice([1.0, 2.5, 5.0]))
    region: dict[str, Any] = {"initial_states": [0, 2]}
    given: dict[str, Any] = {"gains": pins or {"1": 3.0}, "target": 1, "region": region}
    if rng.random() < 0.6:
        region["initial_disturbance"] = "1/4"
        given["exosystem"] = Exosystem(A=[[0, 1], [-1, 0]], C=[[1, 0]])
        given["observer"] = Observer(W=[[3], [2]])
    modes = {name: random_arcs(rng, n, 0.4) for name in "ab"}
    coupling = str(rng.choice(["exp(y) - 1 + y", "tanh(y)", "y", "y + y**3", "2*sin(y)"]))
    return linked(modes, n, coupling, **given)
