"""The FMU of one agent, simulated by FMPy, is that agent of the simulated loop."""

import ctypes
import io
import re
import shutil
import subprocess
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

import dobc_design as dd
from dobc_design import Exosystem, Network, Observer, Problem
from dobc_design.errors import SolverError
from dobc_design.export import fmu
from dobc_design.export.c_text import template

pytestmark = pytest.mark.usefixtures("recorded_briefly")
no_compiler = not any(map(shutil.which, fmu.COMPILERS))
needs_compiler = pytest.mark.skipif(
    no_compiler,
    reason="no C compiler is installed (Debian: apt install gcc)",
)


def fmpy():
    return pytest.importorskip(
        "fmpy", reason='FMPy is not installed: pip install "dobc_design[fmu]"'
    )


def moving() -> Problem:
    """m = 2, two modes that alternate, labels that XML has to escape."""
    modes = {"one": [["<a>", "b&"], ["b&", 'c"']], "two": [["<a>", 'c"'], ["b&", "<a>"]]}
    network = Network.from_arcs(modes, arrow="listens_to", agents=["<a>", "b&", 'c"'])
    exosystem = Exosystem(A=[[0, 1, 0], [-1, 0, 0], [0, 0, 0]], C=[[1, 0, 1], [0, 1, 0]])
    return Problem(
        network=network,
        coupling="2*tanh(y)",
        target=[1, -2],
        gains={"<a>": 1, 'c"': 2},
        offsets={"<a>": [1, 0]},
        exosystem=exosystem,
        observer=Observer(W=[[2, 0], [0, 2], [1, 0]]),
        name="<moving> & 'more'",
    )


def simulated(
    problem: Problem, *, agent: str, period: float, seconds: float, path: Path, signal=None
):
    """FMPy's answer and the loop's, at the samples."""
    count = round(seconds / period)
    times = [k * period for k in range(count + 1)]
    sampled = dd.Stress(period=period)
    run = dd.simulate(problem, t_final=times[-1], samples=times, signal=signal, stress=sampled)
    made = dd.export.to_fmu(problem, period=repr(period), agent=agent)
    made.save(path)
    index = problem.network.labels.index(agent)
    found = fmpy().read_model_description(str(path))
    inputs = [each.name for each in found.modelVariables if each.causality == "input"]
    columns = [("time", float), *((name, int if name == "mode" else float) for name in inputs)]
    table = np.zeros(count + 1, dtype=columns)
    table["time"] = times
    if run.switches is not None:
        table["mode"] = run.switches.at(run.times)
    for name in inputs:
        word = re.fullmatch(r"(x|heard\[(.*?)\])(?:\[(\d)\])?", name)
        if word:
            c = int(word[3] or 1) - 1
            who = index if word[1] == "x" else problem.network.labels.index(word[2])
            goal = 0.0 if word[1] == "x" else run.goal[who, c]
            table[name] = run.x[:, who, c] - goal
    outputs = [each.name for each in found.modelVariables if each.causality == "output"]
    steps = {
        "start_time": 0,
        "stop_time": times[-1],
        "step_size": period,
        "output_interval": period,
    }
    answer = fmpy().simulate_fmu(str(path), input=table, output=outputs, **steps)
    return run, answer, index


@pytest.mark.slow
@needs_compiler
def test_fmpy_simulates_the_agent_equal_to_the_loop_for_10_s(tmp_path):
    """What FMPy records at the end of a step is what was held during it."""
    problem = dd.load_problem("paper-fixed")
    run, answer, index = simulated(
        problem, agent="6", period=0.05, seconds=10, path=tmp_path / "agent.fmu"
    )
    assert len(answer) == 201
    for name in ("u", "dhat"):
        found = answer[name][1:]
        expected = getattr(run, name)[:-1, index, 0]
        assert np.abs(found - expected).max() <= 1e-6
    difference = answer["u"][0] - run.u[0, index, 0]
    assert np.abs(difference) <= 1e-6
    saturated = answer["v"] - answer["u"]
    assert np.abs(saturated).max() > 1
    changes = np.diff(answer["dhat"])
    assert np.abs(changes).max() > 1e-3


@pytest.mark.slow
@needs_compiler
def test_fmpy_simulates_an_input_that_saturates_as_the_loop_does(tmp_path):
    problem = dd.load_problem("paper-fixed").replace(
        actuators={"limit": "3/2", "saturates": True, "amplitude": 1},
        region={"initial_states": [0, 5], "initial_disturbance": 0.5},
    )
    run, answer, index = simulated(
        problem, agent="6", period=0.05, seconds=5, path=tmp_path / "agent.fmu"
    )
    assert np.abs(run.u).max() == 1.5
    for name in ("u", "dhat"):
        difference = answer[name][1:] - getattr(run, name)[:-1, index, 0]
        assert np.abs(difference).max() <= 1e-6


@pytest.mark.slow
@needs_compiler
def test_fmpy_simulates_an_agent_without_a_pin_that_agrees_with_others(tmp_path):
    problem = Problem(
        network=Network.from_arcs([[1, 2], [2, 3], [3, 1], [1, 3]], arrow="listens_to"),
        coupling="tanh(y)",
        goal="agreement",
        exosystem=dd.exosystems.constant(),
        observer=Observer(W=[[2]]),
    )
    run, answer, index = simulated(
        problem, agent="1", period=0.05, seconds=5, path=tmp_path / "agent.fmu"
    )
    for name in ("u", "dhat"):
        difference = answer[name][1:] - getattr(run, name)[:-1, index, 0]
        assert np.abs(difference).max() <= 1e-6
    assert run.error()[-1] < 0.1 * run.error()[0]


@pytest.mark.slow
@needs_compiler
def test_an_agent_with_two_components_follows_the_switches(tmp_path):
    problem = moving()
    signal = dd.signals.Periodic(dwell=0.5, order=("one", "two"))
    run, answer, index = simulated(
        problem, agent="<a>", period=0.02, seconds=4, path=tmp_path / "agent.fmu", signal=signal
    )
    assert len(run.switches) == 8
    for c in (0, 1):
        for name in ("u", "dhat"):
            found_part = answer[f"{name}[{c + 1}]"][1:]
            found = found_part
            wanted = getattr(run, name)[:-1, index, c]
            assert np.abs(found - wanted).max() <= 1e-6
        missed = answer[f"y[{c + 1}]"][1:-1] - (run.x[:-2, index, c] - run.goal[index, c])
        assert np.abs(missed).max() <= 1e-6


@pytest.mark.slow
@needs_compiler
def test_fmpy_finds_nothing_to_complain_of(tmp_path):
    has_validation = hasattr(fmpy(), "validation")
    validation = fmpy().validation if has_validation else pytest.importorskip("fmpy.validation")
    of_the_paper = (dd.load_problem("paper-switching"), "1")
    of_three = (moving(), 'c"')
    for problem, agent in (of_the_paper, of_three):
        archive = dd.export.to_fmu(problem, period="1/50", agent=agent)
        archive.save(tmp_path / "agent.fmu")
        assert validation.validate_fmu(str(tmp_path / "agent.fmu")) == []


@pytest.mark.slow
@needs_compiler
def test_the_sources_compile_without_a_warning(tmp_path):
    made = dd.export.to_fmu(moving(), period="1/50", agent='c"')
    with zipfile.ZipFile(io.BytesIO(made.data)) as archive:
        archive.extractall(tmp_path)
    strict = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wshadow"]
    for name in ("dobc_agent.c", "fmi3_agent.c"):
        command = ["cc", *strict, "-c", name, "-o", "out.o"]
        done = subprocess.run(
            command, cwd=tmp_path / "sources", capture_output=True, check=False, text=True
        )
        assert done.returncode == 0, done.stderr


@pytest.mark.slow
@needs_compiler
def test_a_step_of_several_periods_takes_all_samples_in_it_and_a_state_can_be_restored(tmp_path):
    """Three steps of one period and one of three give the same; after a restore the same step gives
    the same."""
    archive = dd.export.to_fmu("paper-fixed", period="1/20", agent="1")
    path = archive.save(tmp_path / "agent.fmu")
    fmi3 = pytest.importorskip(
        "fmpy.fmi3", reason='FMPy is not installed: pip install "dobc_design[fmu]"'
    )
    description = fmpy().read_model_description(str(path))
    folder = fmpy().extract(str(path), unzipdir=str(tmp_path / "unzipped"))
    numbers = {each.name: each.valueReference for each in description.modelVariables}

    def begun():
        slave = fmi3.FMU3Slave(
            guid=description.guid,
            unzipDirectory=folder,
            modelIdentifier="dobc_agent",
            instanceName="a",
        )
        slave.instantiate()
        slave.enterInitializationMode(startTime=0.0)
        slave.setFloat64([numbers["x"], numbers["heard[2]"]], [3.0, 1.5])
        slave.exitInitializationMode()
        return slave

    def read(slave) -> list[float]:
        values = [numbers[name] for name in ("u", "v", "dhat")]
        return list(slave.getFloat64(values))

    first, second = begun(), begun()
    for k in range(3):
        first.doStep(currentCommunicationPoint=k / 20, communicationStepSize=0.05)
    second.doStep(currentCommunicationPoint=0.0, communicationStepSize=0.15)
    assert read(first) == read(second)
    state = first.getFMUState()
    first.doStep(currentCommunicationPoint=0.15, communicationStepSize=0.05)
    after = read(first)
    assert after != read(second)
    first.setFMUState(state)
    assert read(first) == read(second)
    first.doStep(currentCommunicationPoint=0.15, communicationStepSize=0.05)
    assert read(first) == after
    first.freeFMUState(state)
    for slave in (first, second):
        slave.terminate()
        slave.freeInstance()


@needs_compiler
def test_bad_inputs_are_skipped_as_the_c_code_skips_them(tmp_path):
    """NaN and infinity as a state and as a packet: the same outputs as dobc_agent.c itself, and
    then it goes on."""
    made = dd.export.to_fmu("paper-fixed", period="1/20", agent="1")
    with zipfile.ZipFile(io.BytesIO(made.data)) as archive:
        archive.extractall(tmp_path)
    description = ElementTree.parse(tmp_path / "modelDescription.xml").getroot()
    token = description.get("instantiationToken").encode()
    (library,) = (tmp_path / "binaries").glob("*/dobc_agent.*")
    fmi = ctypes.CDLL(str(library))
    fmi.fmi3InstantiateCoSimulation.restype = ctypes.c_void_p
    instance = fmi.fmi3InstantiateCoSimulation(b"a", token, *[None] * 10)
    own = ctypes.c_void_p(instance)
    fmi.fmi3EnterInitializationMode(
        own, 0, ctypes.c_double(0), ctypes.c_double(0), 0, ctypes.c_double(0)
    )

    command = ["cc", "-std=c99", "-O2", "-shared", "-fPIC", "dobc_agent.c", "-o", "plain.so", "-lm"]
    subprocess.run(command, cwd=tmp_path / "sources", check=True)
    plain = ctypes.CDLL(str(tmp_path / "sources" / "plain.so"))
    agent = ctypes.create_string_buffer(1 << 16)
    memory = ctypes.c_char.in_dll(plain, "dobc_agents")
    plain.dobc_init(agent, ctypes.byref(memory))

    references = (ctypes.c_uint * 2)(2, 7)  # x, heard[2]
    nan, inf = float("nan"), float("inf")
    answers = []
    samples = [(3.0, 1.5), (nan, 1.4), (2.8, nan), (inf, -inf), (2.7, 1.2)]
    for k, (x, packet) in enumerate(samples):
        values = (ctypes.c_double * 2)(x, packet)
        status = fmi.fmi3SetFloat64(own, references, ctypes.c_size_t(2), values, ctypes.c_size_t(2))
        assert status == 0
        now = ctypes.c_double(k / 20)
        step = (now, ctypes.c_double(0.05), 1)
        outcome = []
        for _ in range(3):
            outcome.append(ctypes.byref(ctypes.c_bool()))
        last = ctypes.byref(ctypes.c_double())
        assert fmi.fmi3DoStep(own, *step, *outcome, last) == 0
        wanted = (ctypes.c_uint * 3)(4, 5, 6)  # u, v, dhat
        found = (ctypes.c_double * 3)()
        assert fmi.fmi3GetFloat64(own, wanted, ctypes.c_size_t(3), found, ctypes.c_size_t(3)) == 0
        packets = (ctypes.c_double * 1)(packet)
        heard = plain.dobc_receive(agent, 0, packets)
        assert heard == (0 if abs(packet) < inf else -1)
        output = (ctypes.c_double * 4)()  # felt, dhat, u, v
        plain.dobc_step(agent, (ctypes.c_double * 1)(x), output)
        shown = [output[2], output[3], output[1]]
        assert list(found) == shown
        assert np.isfinite(list(found)).all()
        answers.append(tuple(found))
    assert len(set(answers)) == len(answers)
    fmi.fmi3FreeInstance(own)


def test_every_function_of_the_standard_is_there():
    """FMI 3.0 names 84 functions besides the version; those not served answer with an error."""
    templates = Path(fmu.__file__).parent / "templates"
    agent = (templates / "fmi3_agent.c").read_text("utf-8")
    served = set(re.findall(r"FMI3_EXPORT [^(]*?\bfmi3(\w+)\(", agent))
    types = (
        "Float32 Float64 Int8 UInt8 Int16 UInt16 Int32 UInt32 Int64 UInt64 Boolean String "
        "Binary Clock"
    )
    kinds = []
    for kind in types.split(" "):
        for verb in ("Get", "Set"):
            kinds.append(f"{verb}{kind}")
    stubbed = set(re.findall(r"\bfmi3(\w+)\(fmi3", template("fmi3_stubs.c.j2").render()))
    assert set(kinds) <= served | stubbed
    assert not served & stubbed


def test_without_a_compiler_the_fmu_holds_sources_only(monkeypatch):
    monkeypatch.setattr(fmu.shutil, "which", lambda name: None)
    made = dd.export.to_fmu("paper-fixed", period="1/50")
    assert made.platform is None
    with zipfile.ZipFile(io.BytesIO(made.data)) as archive:
        names = archive.namelist()
        root = ElementTree.fromstring(archive.read("modelDescription.xml"))
    assert not [name for name in names if name.startswith("binaries")]
    assert {"sources/dobc_agent.c", "sources/fmi3_agent.c", "sources/buildDescription.xml"} <= set(
        names
    )
    assert root.get("modelName") == "paper-fixed: agent 1"
    assert root.find("CoSimulation").get("fixedInternalStepSize") == "0.02"


def test_a_compiler_that_refuses_is_the_machines_failure(monkeypatch, tmp_path):
    broken = tmp_path / "cc"
    broken.write_text("#!/bin/sh\necho 'no room' >&2\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setattr(fmu.shutil, "which", lambda name: str(broken))
    with pytest.raises(SolverError, match="refused the FMU's code: no room"):
        dd.export.to_fmu("paper-fixed", period="1/50")
