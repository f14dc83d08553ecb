"""Exported C code: compiled without warnings, it is the sampled loop of the simulation."""

import re
import shutil
import subprocess
from fractions import Fraction

import numpy as np
import pytest
from c_code import EVERY, CompiledAgents, compile_and_test, needs_gcc, planar, write_all
from published import clocks
from scipy.linalg import expm

import dobc_design as dd
from dobc_design import Exosystem, Network, Observer, Problem, Verdict, load_problem
from dobc_design.coupling.coupling import make_coupling
from dobc_design.errors import SpecError
from dobc_design.exact.matrix import to_float
from dobc_design.export.c_controller import make_controller
from dobc_design.export.c_folder import FILES, source_text
from dobc_design.export.rounding_bound import Erring, ErringAlgebra, with_errors
from dobc_design.simulation.agents import LOSS


def alone(k: object, *, h: str = "y") -> Problem:
    """Agent 2 is pinned with k, agent 1 hears it; no disturbance."""
    pair = Network.from_arcs([[1, 2]], arrow="listens_to")
    return Problem(network=pair, coupling=h, gains={"2": k})


def seen(theta: float = 1.0, W: float = 2.0) -> Problem:
    """One agent with k = 1 and a harmonic disturbance."""
    network = Network.from_arcs([[1, 2]], arrow="listens_to", agents=2)
    A = [[0, theta], [-theta, 0]]
    C = [[1, 0]]
    exosystem = Exosystem(A=A, C=C)
    observer = Observer(W=[[W], [0]])
    gains = {"1": "1/100", "2": "1/100"}
    return Problem(
        network=network,
        coupling="y/100",
        gains=gains,
        exosystem=exosystem,
        observer=observer,
    )


def opposed() -> Problem:
    """Signs that balance, a coupling that is not odd, and a formation."""
    arcs = [[1, 2, -1], [2, 1, "-1/2"], [2, 3], [3, 2, 2], [1, 3, "-3/2"]]
    return Problem(
        network=dd.Network.from_arcs(arcs, arrow="listens_to", agents=3, negative="opposes"),
        coupling="exp(y) - 1 + y",
        gains={1: 2},
        target=1,
        offsets={3: "1/4"},
        exosystem=dd.Exosystem(A=[[0, 1], [-1, 0]], C=[[1, 0]]),
        observer=dd.Observer(W=[[3], [1]]),
        simulation={"x0": ["1/2", -1, "1/4"], "xi0": [1, 0]},
    )


def problem_named(name: str) -> Problem:
    made_here = {
        "planar": planar,
        "alone": lambda: alone(3),
        "clocks": clocks,
        "opposed": opposed,
    }
    return made_here[name]() if name in made_here else load_problem(name)


def closed_loop(problem: Problem, run, agents: CompiledAgents, *, period: float, **options):
    """x, u, dhat at the samples of ``run``, with the plant x' = v + C xi, xi' = A xi integrated by
    expm."""
    names = list(problem.network.modes)
    modes = [0] * len(run.times)
    if run.switches:
        active = run.switches.at(run.times)
        modes = []
        for i in active:
            modes.append(names.index(run.switches.names[i]))
    A = to_float(problem.exosystem.A)
    C = to_float(problem.exosystem.C)
    q = len(A)
    block = np.zeros((2 * q, 2 * q))
    block[:q, :q], block[:q, q:] = A, np.eye(q)
    both = expm(block * period)
    x = run.x[0].copy()
    xi = run.xi[0].copy()
    found = []
    arrivals = options.pop("arrivals", None)
    for k in range(len(run.times)):
        arrived = None if arrivals is None else arrivals[k]
        u, v, dhat = agents(modes[k], x, arrived=arrived, **options)
        found.append((x, u, dhat))
        disturbance = xi @ both[:q, q:].T
        x = x + period * v + disturbance @ C.T
        xi = xi @ both[:q, :q].T
    arrays = []
    for part in zip(*found, strict=True):
        arrays.append(np.array(part))
    return arrays


def run_of(problem: Problem, *, period: float, seed: int | None = None, **stress):
    """Ten seconds."""
    times = [k * period for k in range(round(10 / period) + 1)]
    sampled = dd.Stress(period=period, **stress)
    return dd.simulate(problem, t_final=times[-1], samples=times, seed=seed, stress=sampled)


SLOW = pytest.mark.slow


@needs_gcc
@pytest.mark.parametrize(
    ("precision", "level"),
    [
        ("float", "-O0"),
        ("double", "-O0"),
        *(pytest.param(each, "-O2", marks=SLOW) for each in ("float", "double")),
    ],
)
@pytest.mark.parametrize(
    "name",
    ["planar", *(pytest.param(each, marks=SLOW) for each in ("alone", "opposed", "paper-fixed"))],
)
def test_the_code_compiles_without_a_warning_and_passes_its_own_vectors(
    name: str, precision: str, level: str, tmp_path
):
    found = dd.export.to_c(problem_named(name), period="1/20", precision=precision)
    assert tuple(found.files) == FILES
    done = compile_and_test(write_all(found.files, tmp_path), level=level)
    assert done.returncode == 0, done.stdout
    largest = float(re.search(r"difference ([0-9.e+-]+)", done.stdout)[1])
    assert largest <= found.tolerance
    assert largest <= (1e-12 if precision == "double" else 1e-4)
    assert found.tolerance <= (1e-9 if precision == "double" else 1.0)


PERIODS = {
    "paper-fixed": 0.05,
    "paper-switching": 0.05,
    "clock-sync": 0.1,
    "karate-club": 0.1,
    "uav-swarm": 0.1,
}
PERIODS["microgrid-ieee14"] = 0.01


@needs_gcc
@pytest.mark.parametrize(
    ("name", "period"),
    [
        ("planar", 0.05),
        ("clocks", 0.1),
        ("opposed", 0.05),
        *(pytest.param(*each, marks=SLOW) for each in PERIODS.items()),
    ],
)
def test_all_agents_in_c_are_the_simulated_loop_to_1e_12_over_10_s(
    name: str, period: float, tmp_path
):
    """Equations (1), (12), (13), (19), sampled: C agents and an exact plant against
    ``simulate``."""
    problem = problem_named(name)
    run = run_of(problem, period=period)
    code = dd.export.to_c(problem, period=str(period))
    agents = CompiledAgents(code.files, tmp_path, n=problem.n, m=problem.m)
    x, u, dhat = closed_loop(problem, run, agents, period=period)
    states = (x, run.x)
    inputs = (u, run.u)
    for found, wanted in (states, inputs, (dhat, run.dhat)):
        difference = np.abs(found - wanted).max()
        allowed = 1e-12 * max(1.0, np.abs(wanted).max())
        assert difference <= allowed


@SLOW
@needs_gcc
@pytest.mark.skipif(
    shutil.which("g++") is None, reason="g++ is not installed (Debian: apt install g++)"
)
def test_a_program_in_c_plus_plus_calls_the_same_code(tmp_path):
    code = dd.export.to_c(alone(3), period="1/50")
    folder = write_all(code.files, tmp_path)
    for command in (
        "gcc -std=c99 -c dobc_agent.c",
        "g++ -Wall -Werror -x c++ main.c -x none dobc_agent.o -o selftest",
    ):
        subprocess.run(command.split(), cwd=folder, check=True, timeout=120)
    done = subprocess.run(["./selftest"], cwd=folder, check=False, timeout=60)
    assert done.returncode == 0


@SLOW
@needs_gcc
def test_limited_actuators_and_lost_packets_are_those_of_the_simulation(tmp_path):
    """dobc_applied tells the observer the applied input; dobc_receive is not called for a lost
    packet."""
    problem = load_problem("paper-fixed")
    period = 0.05
    limit = 1.5
    loss = 0.3
    seed = 7
    run = run_of(problem, period=period, seed=seed, saturation=limit, loss=loss)
    arcs = problem.network.modes["Ga"]
    rng = np.random.default_rng([seed, LOSS])
    arrivals = []
    for _ in run.times:
        arrived = np.zeros((10, 10), dtype=bool)
        drawn = rng.random(len(arcs))
        arrived[arcs.listeners, arcs.speakers] = drawn >= loss
        arrivals.append(arrived)
    code = dd.export.to_c(problem, period=str(period))
    agents = CompiledAgents(code.files, tmp_path, n=10, m=1)
    x, _, dhat = closed_loop(problem, run, agents, period=period, limit=limit, arrivals=arrivals)
    assert np.abs(run.u).max() == limit
    assert np.abs(x - run.x).max() <= 1e-12
    assert np.abs(dhat - run.dhat).max() <= 1e-12


@SLOW
@needs_gcc
def test_inputs_that_saturate_by_the_file_are_those_of_the_simulation(tmp_path):
    """dobc_step itself cuts u, agent by agent, and its observer counts on what is left."""
    limits = {"1": "1.5", "6": 2}
    problem = load_problem("paper-fixed").replace(
        actuators={"limit": limits, "saturates": True, "amplitude": 1},
        region={"initial_states": [0, 5], "initial_disturbance": 0.5},
    )
    period = 0.05
    run = run_of(problem, period=period, seed=7)
    code = dd.export.to_c(problem, period=str(period))
    agents = CompiledAgents(code.files, tmp_path, n=10, m=1)
    x, u, dhat = closed_loop(problem, run, agents, period=period)
    assert np.abs(run.u[:, 0]).max() == 1.5
    assert np.abs(u - run.u).max() <= 1e-12
    assert np.abs(x - run.x).max() <= 1e-12
    assert np.abs(dhat - run.dhat).max() <= 1e-12


@SLOW
@needs_gcc
def test_a_number_that_is_off_in_the_fifth_digit_fails_the_self_test(tmp_path):
    files = dict(dd.export.to_c("paper-fixed", period="1/50").files)
    source = files["dobc_agent.c"].decode()
    first = r"correction\[DOBC_ORDER\]\[DOBC_INPUTS\] = \{\n    \{([0-9.]+)\}"
    number = re.search(first, source)[1]
    other = repr(float(number) * 1.0001)
    changed = source.replace(number, other)
    files["dobc_agent.c"] = changed.encode()
    done = compile_and_test(write_all(files, tmp_path))
    assert done.returncode == 1
    assert "FAILED" in done.stdout


@SLOW
@needs_gcc
def test_a_polynomial_coupling_needs_no_mathematical_library(tmp_path):
    own = alone(3, h="y + y**3")
    found = dd.export.to_c(own, period="1/50")
    assert b"math.h" not in found.files["dobc_agent.c"]
    assert compile_and_test(write_all(found.files, tmp_path), library=False).returncode == 0
    exponential = dd.export.to_c("paper-fixed", period="1/50", agents=["1"])
    assert b"#include <math.h>" in exponential.files["dobc_agent.c"]


def test_the_code_uses_no_heap_and_no_file_but_math_h():
    for problem in (load_problem("paper-fixed"), planar()):
        source = source_text(make_controller(problem, period="1/50"))
        assert not re.search(r"\b(malloc|calloc|realloc|free|alloca)\b", source)
        assert set(re.findall(r"#include (\S+)", source)) <= {'"dobc_agent.h"', "<math.h>"}


def test_the_numbers_are_the_exact_discretisation_rounded():
    """Against SciPy's exponential; a constant: Ad = 1, Cd = 1, L = 1 - exp(-W T) over 1 s."""
    problem = load_problem("paper-fixed")
    made = make_controller(problem, period="1/20")
    A = to_float(problem.exosystem.A)
    C = to_float(problem.exosystem.C)
    W = to_float(problem.observer.W)
    np.testing.assert_allclose(to_float(made.Ad), expm(A / 20), rtol=1e-14)
    steps = np.linspace(0, 1 / 20, 201)
    motions = [expm((A - W @ C) * s) for s in steps]
    mean = np.trapezoid(motions, steps, axis=0) @ W
    np.testing.assert_allclose(to_float(made.L), mean, rtol=1e-6)
    constantly = dd.exosystems.constant()
    observer = Observer(W=[[3]])
    constant = alone(1).replace(exosystem=constantly, observer=observer)
    slow = make_controller(constant, period="1/2")
    assert slow.Ad == ((1,),)
    assert slow.Cd == ((1,),)
    gain = float(slow.L[0][0])
    expected = 1 - np.exp(-1.5)
    assert gain == pytest.approx(expected, rel=1e-15)


def test_a_network_that_is_sampled_too_seldom_is_refused_with_a_period_that_works():
    """e' = -4 e, held: |1 - 4 T| < 1 iff T < 1/2."""
    for each in make_controller(alone(4), period="0.4999").statements:
        assert each.verdict is Verdict.PROVED
    sampled = make_controller(alone(4), period="1/2")
    assert sampled.statements[0].verdict is Verdict.UNDECIDED
    with pytest.raises(SpecError, match=r"too long.*--period 0\.(4[89]|5)"):
        make_controller(alone(4), period="0.5001")


def test_an_observer_that_cannot_see_the_disturbance_at_this_period_is_refused():
    """Over 2 pi s the mean of a harmonic with 1 rad/s vanishes: Cd = 0 and the error stays; a bit
    less works."""
    with pytest.raises(SpecError, match=r"observer.*\(period 6\.283 s\).*--period"):
        make_controller(seen(), period="6.283")
    for period in ("0.5", "1", "1.5"):
        made = make_controller(seen(), period=period)
        injected = to_float(made.L) @ to_float(made.Cd)
        error = to_float(made.Ad) - injected
        assert np.abs(np.linalg.eigvals(error)).max() < 1
        assert made.statements[0].verdict is Verdict.PROVED


def test_the_period_that_is_offered_is_close_to_the_true_limit():
    """paper-fixed: the largest eigenvalue of K - J gives T < 2 / lambda for real ones."""
    problem = load_problem("paper-fixed")
    forward = np.roll(np.eye(10), 1, axis=1)
    J = forward * 2 - 2 * np.eye(10)
    gains = []
    for i in range(10):
        gains.append(5.0 if i in (0, 5) else 0.0)
    K = np.diag(gains)
    poles = np.linalg.eigvals(J - K)
    limit = min(-2 * pole.real / abs(pole) ** 2 for pole in poles)
    with pytest.raises(SpecError) as caught:
        make_controller(problem, period=1)
    words = str(caught.value).rsplit(" ", 1)
    offered = float(words[1].rstrip("."))
    assert 0.98 * limit <= offered < limit
    make_controller(problem, period=offered)


@pytest.mark.usefixtures("recorded_briefly")
def test_only_the_agents_that_are_asked_for_are_in_the_table():
    found = dd.export.to_c("paper-fixed", period="1/50", agents=["3", 6])
    assert [agent.label for agent in found.controller.agents] == ["3", "6"]
    assert b"#define DOBC_AGENTS 2" in found.files["dobc_agent.h"]
    one = dd.export.to_c("paper-fixed", period="1/50", agents="10").controller
    assert [agent.label for agent in one.agents] == ["10"]
    with pytest.raises(SpecError, match="no agent '33'"):
        dd.export.to_c("paper-fixed", period="1/50", agents=["33"])


def test_too_many_agents_for_one_table_are_refused_and_one_of_them_is_not():
    arcs = [[i, i % 201 + 1] for i in range(1, 202)]
    ring = Network.from_arcs(arcs, arrow="listens_to", agents=201)
    problem = Problem(network=ring, coupling="y", gains={"1": 1})
    with pytest.raises(SpecError, match="at most 200 agents"):
        make_controller(problem, period="1/10")
    made = make_controller(problem, period="1/10", agents=["7"])
    assert [agent.neighbours for agent in made.agents] == [(7,)]
    assert made.statements[0].verdict is Verdict.UNDECIDED


def grouped() -> Problem:
    """Agents 1 and 3 feel a sine, agent 2 a constant."""
    A = [[0, 2], [-2, 0]]
    C = [[1, 0]]
    harmonic = Exosystem(A=A, C=C)
    for_the_sine = Observer(W=[[3], [2]])
    sine = dd.Group(agents=[1, 3], exosystem=harmonic, observer=for_the_sine)
    still = Exosystem(A=[[0]], C=[[1]])
    for_the_constant = Observer(W=[[2]])
    constant = dd.Group(agents=[2], exosystem=still, observer=for_the_constant)
    arcs = [[1, 2], [2, 3], [3, 1]]
    network = Network.from_arcs(arcs, arrow="listens_to")
    xi0 = [[1, "1/2"], [2], [-1, 2]]
    simulation = {"xi0": xi0}
    gains = {1: 3, 2: 1}
    return Problem(
        network=network,
        coupling="tanh(y) + y",
        gains=gains,
        groups=[sine, constant],
        simulation=simulation,
    )


@pytest.mark.parametrize("label", [1, 2])
def test_the_code_of_a_group_is_that_of_a_network_with_its_exosystem_alone(label: int):
    problem = grouped()
    own = next(group for group in problem.groups if str(label) in group.agents)
    gains = {1: 3, 2: 1}
    loop = {"network": problem.network, "coupling": "tanh(y) + y", "gains": gains}
    single = Problem(**loop, exosystem=own.exosystem, observer=own.observer)
    made, wanted = (
        make_controller(each, period="1/50", agents=[label]) for each in (problem, single)
    )
    assert made.Ad == wanted.Ad
    assert made.Cd == wanted.Cd
    assert made.L == wanted.L
    assert source_text(made) == source_text(wanted)


@needs_gcc
@pytest.mark.parametrize("label", [pytest.param(1, marks=SLOW), pytest.param(2, marks=SLOW)])
def test_the_code_of_every_group_passes_its_vectors_in_the_whole_loop(label: int, tmp_path):
    found = dd.export.to_c(grouped(), period="1/50", agents=[label])
    done = compile_and_test(write_all(found.files, tmp_path))
    assert done.returncode == 0, done.stdout
    assert float(re.search(r"difference ([0-9.e+-]+)", done.stdout)[1]) <= 1e-12


def test_agents_of_different_groups_do_not_share_a_folder():
    controller = make_controller(grouped(), period="1/50", agents=[1, 3])
    assert controller.q == 2
    with pytest.raises(SpecError, match="agents with one exosystem") as caught:
        make_controller(grouped(), period="1/50")
    assert "begin with agent 1, 2" in str(caught.value)
    with pytest.raises(SpecError, match="sampled_gain is one gain for all"):
        dd.export.to_c(grouped(), period="1/50", agents=[2], sampled_gain=[[1]])


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"period": None}, "a period must be given"),
        ({"period": 0}, "positive number of seconds"),
        ({"period": "soon"}, "--period must be a number"),
        ({"period": "1/50", "precision": "half"}, "double or float"),
        ({"period": "1/50", "sampled_gain": [[1]]}, r"shape \(2, 1\)"),
    ],
)
def test_a_wrong_argument_is_named(options, match: str):
    with pytest.raises(SpecError, match=match):
        dd.export.to_c("paper-fixed", **options)


@pytest.mark.usefixtures("recorded_briefly")
def test_numbers_that_a_float_cannot_hold_are_refused():
    network = Network.from_arcs([[1, 2]], arrow="listens_to")
    far = Problem(network=network, coupling="y", target="1e39")
    with pytest.raises(SpecError, match="fit into a float"):
        dd.export.to_c(far, period="1e-3", precision="float")


@pytest.mark.usefixtures("recorded_briefly")
def test_a_sampled_gain_takes_the_place_of_the_discretised_one():
    design = dd.design_observer("paper-fixed", period="1/20", rate=1)
    found = dd.export.to_c("paper-fixed", period="1/20", sampled_gain=design.W)
    rounded = tuple(tuple(Fraction(float(x)) for x in row) for row in design.W)
    assert rounded == found.controller.L
    assert found.statements[0].verdict is Verdict.PROVED


@pytest.mark.parametrize(
    "h",
    [EVERY, "exp(y1) - 1 + y2*y1**5/(2 + y1**2)", "sqrt(4 + y1*y2) - 2", "tan(y1)*(1 + y2)**-3"],
)
def test_the_error_bound_of_a_coupling_holds_for_single_precision(h: str):
    """float32 arithmetic against float64, at 400 random points: below the bound, and not by more
    than 10^4."""
    rng = np.random.default_rng(1)
    y = rng.uniform(-1.4, 1.4, size=(400, 2))
    y[:, 1] = np.abs(y[:, 1])
    coupling = make_coupling([h, "y2"], dimension=2)
    input_error = Erring(y, np.abs(y) * 2.0**-24)
    algebra = ErringAlgebra(2.0**-24)
    bound = with_errors(coupling.components, input_error, algebra)
    rounded = single_precision(coupling, y.astype(np.float32))
    difference = np.abs(rounded - coupling.value(y))
    assert (difference <= 2 * bound.error).all()
    largest = bound.error[:, 0].max()
    assert largest <= 1e4 * max(difference[:, 0].max(), 1e-9)


def single_precision(coupling, y: np.ndarray) -> np.ndarray:
    from dobc_design.coupling.tree import NumpyAlgebra, evaluate

    class Single(NumpyAlgebra):
        def constant(self, value):
            return np.asarray(np.float32(float(value)))

        def pi(self):
            return np.asarray(np.float32(np.pi))

    parts = []
    for each in coupling.components:
        components = [y[:, 0], y[:, 1]]
        parts.append(evaluate(each.node, components, Single()))
    columns = [np.broadcast_to(part, len(y)) for part in parts]
    stacked = np.stack(columns, axis=1)
    return stacked.astype(float)


@pytest.mark.usefixtures("recorded_briefly")
def test_the_folder_is_not_overwritten_unless_forced(tmp_path):
    found = dd.export.to_c(alone(3), period="1/50", agents=["1"])
    paths = found.save(tmp_path / "code")
    assert [path.name for path in paths] == list(FILES)
    with pytest.raises(SpecError, match="exists already"):
        found.save(tmp_path / "code", force=False)
    found.save(tmp_path / "code")
    (tmp_path / "file").write_text("")
    with pytest.raises(SpecError, match="not a folder"):
        found.save(tmp_path / "file")


@SLOW
def test_the_same_problem_gives_the_same_bytes():
    first = dd.export.to_c("paper-switching", period="1/50").files
    again = dd.export.to_c("paper-switching", period="1/50").files
    assert first == again
