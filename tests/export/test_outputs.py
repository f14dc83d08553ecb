"""Exports of agents that measure y = H x, against the whole loop as ``support/measured.py`` writes
it out, runs, and the recursion of samples written out here (theory, section 18)."""

import re

import control
import numpy as np
import pytest
from c_code import CompiledAgents, compile_and_test, needs_gcc, write_all
from loaded_fmu import LoadedFmu
from measured import CARTS, by_agent, estimates_at_start, floats, whole_loop
from scipy.linalg import block_diag, expm

import dobc_design as dd
from dobc_design.conditions.observer.propose import with_observer
from dobc_design.errors import SpecError
from dobc_design.export import to_control

pytestmark = pytest.mark.usefixtures("recorded_briefly")
TIGHT = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-12}


@pytest.mark.parametrize("name", ["estimates", "outputs"])
def test_python_control_has_the_spectrum_of_the_whole_loop(name):
    """Of x, xhat and xi - xihat; the disturbances beside it are free."""
    problem = with_observer(CARTS[name])
    system = to_control(problem)
    found = np.poly(system.linearize(np.zeros(system.nstates), np.zeros(3)).poles())
    free = [np.linalg.eigvals(A) for A, _, _ in by_agent(problem)]
    wanted = np.concatenate([np.linalg.eigvals(whole_loop(problem, "G")), *free])
    np.testing.assert_allclose(found, np.poly(wanted), rtol=1e-4, atol=1e-3)


@pytest.mark.parametrize("name", ["outputs", "curved", "leader"])
def test_python_control_reproduces_the_trajectory_from_its_estimates(name):
    problem = CARTS[name]
    system = to_control(problem)
    run = dd.simulate(problem, t_final=2, samples=21)
    xhat = run.x[0] - estimates_at_start(with_observer(problem), 2)
    start = system.start_of(run, xhat)
    found = control.input_output_response(system, run.times, 0, start, solve_ivp_kwargs=TIGHT)
    wanted = np.hstack([part.reshape(21, -1) for part in (run.x, run.dhat, run.u)])
    np.testing.assert_allclose(found.outputs.T, wanted, atol=1e-6)
    # By default the estimates of states are right.
    assert np.array_equal(system.start_of(run), system.start_of(run, run.x[0]))
    assert not np.array_equal(system.start_of(run), start)


def test_a_disturbance_beside_the_model_moves_the_states_and_not_the_estimates():
    """w acts on the speed of one cart, as an input does."""
    system = to_control(CARTS["estimates"])
    state = np.linspace(0, 1, system.nstates)
    moved = system.dynamics(0.0, state, [0, 0.7, 0]) - system.dynamics(0.0, state, np.zeros(3))
    assert moved[3] == pytest.approx(0.7)
    assert not np.delete(moved, 3).any()


def test_the_observer_of_one_agent_has_the_outputs_and_the_input_alone():
    """Poles: those of A - W H; driven by y and v of a run it finds the disturbance."""
    problem = with_observer(CARTS["outputs"])
    system = to_control(problem)
    assert system.observer.input_labels == ["y[1]", "v[1]"]
    np.testing.assert_allclose(np.sort_complex(system.exosystem.poles()), [-2j, 2j], atol=1e-12)
    run = dd.simulate(problem, t_final=20, samples=20_001)
    last = run.x[:, 2]
    v = run.u[:, 2, 0] + 2 * (run.x[:, 1, 0] - last[:, 0])
    both = np.stack([last[:, 0], v])
    found = control.forced_response(system.observer, run.times, both, np.zeros(4))
    assert np.abs(found.outputs[0] - run.d[:, 2, 0])[-1000:].max() < 1e-4
    assert np.abs(run.d[:, 2, 0])[-1000:].max() > 0.1


def test_the_python_file_is_refused_by_name():
    with pytest.raises(SpecError, match=r"^dynamics\.H: the Python file does not know outputs"):
        dd.export.python_script(CARTS["outputs"])


class Sampled:
    """The loop from sample to sample: all agents hear each other's packets, and inputs are held.  y
    is measured; ``bad`` (k, n) says where it is not."""

    def __init__(self, problem: dd.Problem, period: float) -> None:
        self.problem = problem
        own = problem.dynamics
        A, B, self.H = floats(own.A), floats(own.B), floats(own.H)
        self.m = len(A)
        p = len(B[0])
        self.on_outputs = own.acts_on == "outputs"
        self.seen = self.H if self.on_outputs else np.eye(self.m)
        self.goal = floats([problem.target])[0]
        self.u0 = floats([problem.input_at(problem.target)])[0]
        self.K = {i: floats(gain) for i, gain in problem.pinning.gains.items()}
        self.slopes = floats(
            [[g.midpoint for g in row] for row in problem.coupling.jacobian_at_zero()]
        )
        self.curved = problem.coupling.texts[0].startswith("tanh")
        self.parts = []
        for A_xi, C, W in by_agent(problem):
            q = len(A_xi)
            pair = np.block([[A, B @ C], [np.zeros((q, self.m)), A_xi]])
            held = np.zeros((self.m + q + p, self.m + q + p))
            held[: self.m + q, : self.m + q] = pair
            held[: self.m, self.m + q :] = B
            flow = expm(period * held)
            Ad, G = flow[: self.m + q, : self.m + q], flow[: self.m + q, self.m + q :]
            seen = np.hstack([self.H, np.zeros((len(self.H), q))])
            error = block_diag(pair - W @ seen, np.zeros((len(self.H), len(self.H))))
            error[: self.m + q, self.m + q :] = W
            L = expm(period * error)[: self.m + q, self.m + q :]
            # The input that moves a state as the disturbance does, as B sees it.
            left = np.linalg.pinv(B)
            Cd = np.linalg.solve(left @ G[: self.m], left @ Ad[: self.m, self.m :])
            self.parts.append((Ad, G, seen, L, np.hstack([np.zeros((p, self.m)), Cd])))

    def run(self, x, xi, count, bad=()):
        """x, u, v, dhat, and y, nan where it is bad, (S, n, ...)."""
        z = [np.concatenate(each) for each in zip(x, xi, strict=True)]
        zhat = [None] * len(z)
        v = [None] * len(z)
        packets = [None] * len(z)
        missed = [None] * len(z)
        found = []
        for k in range(count):
            y, known = [], []
            for i, (Ad, G, seen, L, _) in enumerate(self.parts):
                good = (k, i) not in bad
                y.append(seen @ z[i] if good else np.full(len(seen), np.nan))
                if zhat[i] is not None:
                    zhat[i] = Ad @ zhat[i] + G @ v[i] + L @ missed[i]
                elif good:
                    zhat[i] = np.concatenate([np.linalg.pinv(self.H) @ y[i], 0 * xi[i]])
                missed[i] = y[i] - seen @ zhat[i] if good else np.zeros(len(seen))
                if zhat[i] is None:
                    known.append(None)
                elif self.on_outputs:
                    known.append((y[i] if good else seen @ zhat[i]) - self.H @ self.goal)
                else:
                    known.append(zhat[i][: self.m] - self.goal)
            for i, e in enumerate(known):
                # Packets of bad outputs are skipped, those of estimates come all the same.
                if e is not None and not (self.on_outputs and (k, i) in bad):
                    packets[i] = e
            u, dhat = [], []
            for i, (*_, Cd) in enumerate(self.parts):
                estimate = np.zeros(len(Cd))
                command, felt = 0 * estimate, 0 * estimate
                if zhat[i] is not None:
                    estimate = Cd @ zhat[i]
                    command = self.u0 - estimate
                    if i in self.K:
                        command = command - self.K[i] @ known[i]
                    for listener, speaker, w in self.problem.network.modes["G"]:
                        if listener == i and packets[speaker] is not None:
                            h = self.slopes @ (packets[speaker] - known[i])
                            felt = felt + float(w) * (np.tanh(h) if self.curved else h)
                v[i] = felt + command
                u.append(command)
                dhat.append(estimate)
            found.append(([each[: self.m] for each in z], u, dhat, y, v.copy()))
            z = [
                Ad @ each + G @ own
                for each, own, (Ad, G, _, _, _) in zip(z, v, self.parts, strict=True)
            ]
        names = ("x", "u", "dhat", "y", "v")
        return {
            name: np.array(part) for name, part in zip(names, zip(*found, strict=True), strict=True)
        }


X = np.array([[2.0, 0.3], [-1.0, 0.5], [0.5, -1.0]])


def xi_of(problem: dd.Problem) -> list[np.ndarray]:
    return [floats([row])[0] for row in problem.simulation.xi0]


def in_c(problem: dd.Problem, folder, period: str) -> CompiledAgents:
    files = dd.export.to_c(problem, period=period).files
    return CompiledAgents(files, folder, n=3, m=2, p=1)


def close(found, wanted) -> None:
    """To 1e-12 of the largest number."""
    difference = np.abs(np.asarray(found) - wanted).max()
    assert difference <= 1e-12 * np.abs(wanted).max()


@needs_gcc
@pytest.mark.parametrize("name", ["estimates", "outputs", "curved", "curved outputs"])
def test_agents_in_c_are_the_recursion_of_samples(name, tmp_path):
    """Fed with y alone, over 10 s, to 1e-12; disturbances are estimated and agents reach the
    target."""
    problem = with_observer(CARTS[name])
    run = Sampled(problem, 0.05).run(X, xi_of(problem), 201)
    agents = in_c(problem, tmp_path, "1/20")
    answers = [agents(0, y) for y in run["y"]]
    for place, part in enumerate(("u", "v", "dhat")):
        close([each[place] for each in answers], run[part])
    assert np.abs(run["x"][-1] - [1, 0]).max() < 0.2 * np.abs(X - [1, 0]).max()
    assert np.abs(run["dhat"]).max() > 0.5


@pytest.mark.parametrize("name", ["estimates", "curved outputs"])
def test_the_recursion_is_that_of_sampled_runs(name):
    """Where these begin with the smallest state that shows y, to 1e-12."""
    problem = with_observer(CARTS[name])
    xi = xi_of(problem)
    eps = np.hstack([X * [0, 1], xi])
    times = [0.05 * k for k in range(101)]
    run = dd.simulate(
        problem,
        t_final=times[-1],
        samples=times,
        start={"x": X, "xi": eps},
        stress=dd.Stress(period=0.05),
    )
    wanted = Sampled(problem, 0.05).run(X, xi, 101)
    for part in ("x", "u", "dhat"):
        close(getattr(run, part), wanted[part])


@needs_gcc
@pytest.mark.parametrize(
    ("name", "precision", "agent"),
    [
        ("curved", "double", None),
        ("outputs", "float", None),
        pytest.param("estimates", "float", None, marks=pytest.mark.slow),
        pytest.param("curved outputs", "double", None, marks=pytest.mark.slow),
        pytest.param("groups", "double", "1", marks=pytest.mark.slow),
        pytest.param("groups", "double", "2", marks=pytest.mark.slow),
    ],
)
def test_code_passes_its_own_vectors_with_the_sanitizers_watching(name, precision, agent, tmp_path):
    """The tolerance is derived; observer and network of samples are proved to converge."""
    code = dd.export.to_c(CARTS[name], period="1/20", precision=precision, agents=agent)
    done = compile_and_test(write_all(code.files, tmp_path))
    assert done.returncode == 0, done.stdout
    assert code.tolerance <= (1e-12 if precision == "double" else 1e-3)
    assert all(each.verdict is dd.Verdict.PROVED for each in code.statements)


@needs_gcc
def test_a_number_that_is_off_in_the_sixth_digit_fails_the_self_test(tmp_path):
    files = dict(dd.export.to_c(CARTS["curved"], period="1/20").files)
    head, mark, rows = files["vectors.h"].decode().partition("vector_estimate")
    number = re.findall(r"[0-9]\.[0-9]{6,}", rows)[2]
    other = rows.replace(number, repr(float(number) * (1 + 1e-6)), 1)
    files["vectors.h"] = (head + mark + other).encode()
    assert compile_and_test(write_all(files, tmp_path)).returncode == 1


@needs_gcc
@pytest.mark.parametrize("name", ["curved", "outputs"])
def test_a_bad_measurement_is_replaced_by_what_the_model_expects(name, tmp_path):
    """Also where it is the first, of an agent that others hear; bad ones are counted."""
    problem = with_observer(CARTS[name])
    bad = {(0, 1), (40, 1), (41, 1), (42, 1), (42, 0), (60, 2)}
    run = Sampled(problem, 0.05).run(X, xi_of(problem), 80, bad)
    agents = in_c(problem, tmp_path, "1/20")
    answers = [agents(0, y) for y in run["y"]]
    for place, part in enumerate(("u", "v", "dhat")):
        close([each[place] for each in answers], run[part])
    assert run["u"][0, 1] == 0
    # Whoever hears an agent whose packet is bad counts it, too.
    packets = {0: [1, 4, 2], 1: [1, 5, 5]}
    skipped = [agents.library.skipped(i) for i in range(3)]
    assert skipped == packets[int(name == "outputs")]


@needs_gcc
@pytest.mark.parametrize("name", ["curved", "outputs"])
def test_an_fmu_takes_y_and_answers_like_the_recursion(name, tmp_path):
    """The packet of estimated states is that of the last sample."""
    problem = with_observer(CARTS[name])
    sampled = Sampled(problem, 0.05)
    run = sampled.run(X, xi_of(problem), 21)
    agent = LoadedFmu(dd.export.to_fmu(problem, period="1/20"), tmp_path)
    packet = ["y"] if name == "outputs" else ["y[1]", "y[2]"]
    assert agent.inputs == ["mode", "x"]
    K = sampled.K[0]
    for k in range(21):
        given = {"x": run["y"][k, 0, 0]}
        u, v, dhat, *y = agent(0.05 * k, 0.05, given, ["u", "v", "dhat", *packet])
        close([u, v, dhat], [run[part][k, 0, 0] for part in ("u", "v", "dhat")])
        assert sampled.u0 - dhat - K @ y == pytest.approx(u, abs=1e-12)
    agent.close()
