"""The folder of ``dobc export --c``: code, a usage example that tests itself, test vectors, and
README.txt.

Test vectors are one agent's samples in the simulated loop: measured states and received packets go
in; u, v and dhat have to come out, within a bound derived for the precision.
"""

import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dobc_design import __version__
from dobc_design._checks import noun
from dobc_design._show.cards import Card, Headed
from dobc_design._show.text import significant
from dobc_design.certificate.files import write_folder
from dobc_design.conditions.statement import Statement
from dobc_design.errors import refused
from dobc_design.exact.matrix import Array
from dobc_design.exact.reading import counted
from dobc_design.loop.arrays import Gain
from dobc_design.problem.dynamics import expressions_of
from dobc_design.problem.problem import Problem
from dobc_design.simulation.execution import run_once
from dobc_design.simulation.setting import make_setting
from dobc_design.simulation.signals import Mobile, signal_of
from dobc_design.simulation.stress import Stress
from dobc_design.simulation.trajectory import Trajectory
from dobc_design.verdict import Verdict

from .c_controller import (
    AgentNumbers,
    Controller,
    Hearing,
    make_controller,
)
from .c_text import (
    CAlgebra,
    array,
    bare,
    comment,
    function,
    rounded,
    row,
    string,
    template,
)
from .c_text import literal as c_literal
from .rounding_bound import Recorded, estimated, felt_with_error, rounding_bound

SECONDS = 10.0
MOST_SAMPLES = 400
# relative tolerance where agents have to be integrated: the code is compared at the states recorded
COARSE = 1e-6


class Recorder:
    """Simulates the sampled loop of a controller over 10 s (at most 400 samples), and remembers the
    last one.  ``gain`` and ``sampled_gain`` as in ``make_controller``.  A signal that depends
    on the states is left out: the first mode then holds.  Where the agent whose samples are
    recorded has a limit, all inputs are cut off there."""

    def __init__(
        self, problem: Problem, *, gain: Gain | None = None, sampled_gain: Gain | None = None
    ) -> None:
        self.problem = problem
        self.gain = gain
        self.sampled_gain = sampled_gain
        signal = signal_of(problem)[0]
        self.signal = None if isinstance(signal, Mobile) else signal
        self.sampled = None
        if sampled_gain is not None:
            # The simulation computes in floats.
            self.sampled = tuple(tuple(map(float, row)) for row in sampled_gain)
        self.last: tuple[Fraction, Trajectory] | None = None

    def controller(
        self, period: Any, *, agents: Sequence[Any] | None, precision: str = "double"
    ) -> Controller:
        """The controller of these agents, of whose simulation nothing speaks against the period."""
        return make_controller(
            self.problem,
            period=period,
            precision=precision,
            agents=agents,
            gain=self.gain,
            sampled_gain=self.sampled_gain,
            objection=self.objection,
        )

    def objection(self, controller: Controller) -> str:
        """Why this period does not do in a simulation, or "".  Raises: SpecError where none
        does."""
        run = self.run(controller)
        if not run.diverged:
            return ""
        if self.problem.processor is not None:
            return f"in a simulation {run.reason}."
        # Would it converge if nothing were sampled?
        free = self.simulated(controller, None)
        if free.diverged:
            raise refused(
                "simulation",
                f"in a simulation {free.reason}, although nothing is sampled: no period helps.",
                "Give starts from which the loop converges: simulation.x0, or a [region].",
            )
        return f"in a simulation {run.reason}."

    def run(self, controller: Controller) -> Trajectory:
        """The sampled loop at the controller's period."""
        # Asked for twice: by the search for a period, and for the test vectors.
        if self.last is None or self.last[0] != controller.period:
            given = _limits(controller).get(_recorded_agent(controller).label)
            limit = None if given is None else float(rounded(given, "double"))
            period = float(controller.period)
            stress = Stress(period=period, sampled_gain=self.sampled, saturation=limit)
            if self.problem.processor is not None:  # which says both
                stress = Stress(saturation=limit)
            self.last = controller.period, self.simulated(controller, stress)
        return self.last[1]

    def simulated(self, controller: Controller, stress: Stress | None) -> Trajectory:
        """The loop at the multiples of the period."""
        period = float(controller.period)
        # At least two samples, so that one of them has a past.
        count = max(2, min(MOST_SAMPLES, int(SECONDS / period)) + 1) + controller.late
        times = [k * period for k in range(count)]
        mode = None
        if self.signal is None:
            mode = next(iter(controller.problem.network.modes))
        # Packets of the vectors are those that arrive at once.
        prompt = controller.problem.replace(readings=None)
        setting = make_setting(
            prompt,
            mode=mode,
            signal=self.signal,
            t_final=times[-1],
            samples=times,
            tolerance=COARSE,
            gain=self.gain,
            stress=stress,
        )
        return run_once(setting)

    def recorded(self, controller: Controller) -> Recorded:
        """What one agent measures, hears and does: the first of the table that is pinned, else the
        first.  Raises: SpecError when the simulated loop diverges."""
        why = self.objection(controller)
        if why:
            raise refused("--period", f"there are no test vectors: {why}", "Take a shorter period.")
        run = self.run(controller)
        agent = _recorded_agent(controller)
        i = agent.index
        # In the order in which the code numbers them.
        others = list(agent.neighbours)
        # what acts ``late`` samples after it is computed
        late = controller.late
        asked = slice(len(run.x) - late)
        x = run.x[asked]
        u = run.u[late:, i]
        measured = Recorded(
            controller=controller,
            agent=agent,
            modes=_modes_in_code(controller, run)[asked],
            x=x[:, i],
            heard=x[:, others] - run.goal[others],
            xihat=run.xihat[asked, i, controller.states],
            dhat=run.dhat[late:, i],
            u=u,
            v=u,
        )
        if controller.outputs:
            return estimated(measured)
        e = x[:, i] - run.goal[i]
        # v is what an agent does in all: its couplings, which no simulation records, and u.
        exact = np.zeros_like(e)
        felt = felt_with_error(measured, e, exact, 0.0)
        return replace(measured, v=felt.value + u)


def _modes_in_code(controller: Controller, run: Trajectory) -> NDArray[np.int64]:
    """The place of the active mode among those of the problem, sample by sample."""
    names = list(controller.problem.network.modes)
    places = np.array([names.index(name) for name in run.switches.names])
    return places[run.mode_index]


def _recorded_agent(controller: Controller) -> AgentNumbers:
    """The first that is pinned, else the first."""
    for agent in controller.agents:
        if any(map(any, agent.gain)):
            return agent
    return controller.agents[0]


def _limits(controller: Controller) -> dict[str, Fraction]:
    """label -> largest |u| of a component, for the agents of the code that have a limit in
    [actuators]."""
    table = controller.problem.actuators
    found: dict[str, Fraction] = {}
    for agent in controller.agents:
        limit = None if table is None else table.limit_of(agent.label)
        if limit is not None:
            found[agent.label] = limit
    return found


def _limits_text(controller: Controller) -> str:
    """The limits for a comment: one number where all agents have the same, else agent by agent."""
    limits = _limits(controller)
    values = set(limits.values())
    if len(limits) == len(controller.agents) and len(values) == 1:
        return significant(values.pop(), 6)
    texts = [f"{significant(limit, 6)} (agent {label})" for label, limit in limits.items()]
    if len(texts) > 12:
        texts = [*texts[:12], "..."]
    return ", ".join(texts)


def vectors_csv(recorded: Recorded) -> str:
    """The samples as CSV: time, mode, x, heard values, u, v, dhat; numbers in full double
    precision."""
    problem = recorded.controller.problem
    p = range(1, problem.inputs + 1)
    head = ["time", "mode", *(f"x{c + 1}" for c in range(recorded.x.shape[1]))]
    for j in range(len(recorded.agent.neighbours)):
        head += [f"heard{j}_{c + 1}" for c in range(recorded.heard.shape[2])]
    for name in ("u", "v", "dhat"):
        head += [f"{name}{c}" for c in p]
    lines = [",".join(head)]
    heard = recorded.heard.reshape(len(recorded.x), -1)
    # One row a sample, in the order of the head.
    numbers = np.hstack([recorded.x, heard, recorded.u, recorded.v, recorded.dhat])
    for k, row_of_sample in enumerate(numbers.tolist()):
        time = repr(k * float(recorded.controller.period))
        mode = str(int(recorded.modes[k]))
        lines.append(",".join([time, mode, *map(repr, row_of_sample)]))
    return "\n".join(lines) + "\n"


def vectors_header(recorded: Recorded, tolerance: float) -> str:
    """vectors.h: the same as constant arrays, with the tolerance that is derived for this
    precision."""
    controller, agent = recorded.controller, recorded.agent
    place = next(i for i, each in enumerate(controller.agents) if each.index == agent.index)
    # Derived and not measured: the test must not fail on another processor.
    if not np.isfinite(tolerance):
        raise refused(
            "export",
            "the rounding errors of the test vectors have no finite bound: a coupling is "
            "near a singularity.",
            "Simulate from other starts ([region]), or use --precision double.",
        )

    def entries(values: Array) -> str:
        texts = [bare(Fraction(float(value)), controller.precision) for value in values]
        return ", ".join(texts)

    return template("vectors.h.j2").render(
        label=comment(agent.label),
        place=place,
        tolerance=f"{tolerance:.3e}",
        recorded=recorded,
        entries=entries,
    )


FILES = ("dobc_agent.h", "dobc_agent.c", "main.c", "vectors.h", "vectors.csv", "README.txt")
WIDTH = 100
COMPILE = (
    "gcc -std=c99 -O2 -Wall -Wextra -Werror -pedantic dobc_agent.c main.c -o selftest -lm && "
    "./selftest"
)


@noun
class CCode(Headed):
    """C99 of a sampled controller: the files by name, the numbers in them, and what is decided
    about them. ``tolerance``: how far u, v and dhat may be from the double-precision loop along the
    test vectors."""

    files: Mapping[str, bytes]
    controller: Controller
    statements: tuple[Statement, ...]
    tolerance: float

    def save(self, folder: str | PathLike[str], *, force: bool = True) -> list[Path]:
        """Write the files into ``folder``.  Raises: SpecError if one of them is there already,
        unless ``force``."""
        target = Path(folder)
        check_free(target, force=force)
        return write_folder(target, self.files)

    def _card(self) -> Card:
        return Card(
            title="C99 code",
            text=str(self).partition("\n")[0],
            lines=[str(each) for each in self.statements],
            heads=("file", "bytes"),
            rows=[(name, len(data)) for name, data in self.files.items()],
        )

    def __str__(self) -> str:
        controller = self.controller
        agents = counted(len(controller.agents), "agent")
        head = f"C99 of {agents} of {controller.problem.name}, {controller.precision}"
        head += f", every {float(controller.period):g} s"
        return "\n".join([head, *(f"  {each}" for each in self.statements)])


def check_free(folder: Path, *, force: bool) -> None:
    """Refuse a folder that is none, or that holds one of the files already.  Raises: SpecError."""
    if folder.exists() and not folder.is_dir():
        raise refused("--c", f"{str(folder)!r} is not a folder.", "Choose another.")
    there = [name for name in FILES if (folder / name).exists()]
    if there and not force:
        raise refused(
            "--c",
            f"{str(folder / there[0])!r} exists already.",
            "Add --force to replace it, or choose another folder.",
        )


def header_text(controller: Controller) -> str:
    """dobc_agent.h."""
    problem = controller.problem
    modes = list(problem.network.modes)
    return template("agent.h.j2").render(
        controller=controller,
        problem=problem,
        title=comment(problem.name),
        period=f"{float(controller.period):.10g}",
        version=__version__,
        literal=c_literal(controller.period, controller.precision),
        names=comment(", ".join(modes[:12])),
        neighbours=max(1, *(len(agent.neighbours) for agent in controller.agents)),
        limits=comment(_limits_text(controller)),
    )


def source_text(controller: Controller) -> str:
    """dobc_agent.c."""
    problem, precision = controller.problem, controller.precision
    # It notes on the way which helpers and headers the expressions need.
    algebra = CAlgebra(precision)
    made = partial(function, algebra=algebra, m=controller.felt)
    couplings = []
    for number, each in enumerate(problem.couplings):
        head = f"coupling_{number}(y, h)"
        couplings.append(made(head, each.components, each.texts))
    plant = problem.dynamics
    drift = None
    if plant is not None and plant.f:
        expressions = expressions_of(plant)
        drift = made("drift(x, f)", expressions, plant.f)
    return template("agent.c.j2").render(
        controller=controller,
        array=partial(array, precision=precision),
        title=comment(problem.name),
        uses_math=algebra.library,
        plant=plant,
        drift=drift,
        tables="".join(_tables(controller)),
        used=algebra.used,
        couplings=couplings,
        limited=bool(_limits(controller)),
    )


def _tables(controller: Controller) -> Iterator[str]:
    """Arcs and neighbours of every agent, then the table of agents."""
    labels = controller.problem.network.labels
    precision = controller.precision
    for place, agent in enumerate(controller.agents):
        for mode, hearings in enumerate(agent.modes):
            if hearings:
                arcs = ", ".join(_arc(arc, precision) for arc in hearings)
                yield f"static const dobc_arc arcs_{place}_{mode}[] = {{{arcs}}};\n"
        # An empty array is not C.
        if agent.neighbours:
            names = ", ".join(string(labels[index]) for index in agent.neighbours)
            yield f"static const char *const neighbours_{place}[] = {{{names}}};\n"
    yield "\nconst dobc_config dobc_agents[DOBC_AGENTS] = {\n"
    limits = _limits(controller)
    rows = []
    for place, agent in enumerate(controller.agents):
        fields = _config(place, agent, precision)
        if limits:
            no_limit = Fraction(-1)  # which no limit is
            fields += f", {bare(limits.get(agent.label, no_limit), precision)}"
        rows.append(f"    {{{fields}}}")
    yield ",\n".join(rows)
    yield "\n};\n"


def _arc(arc: Hearing, precision: str) -> str:
    return f"{{{arc.neighbour}, {arc.coupling}, {c_literal(arc.weight, precision)}}}"


def _config(place: int, agent: AgentNumbers, precision: str) -> str:
    """The fields of an agent's row in the table."""
    gain = ", ".join(row(each, precision) for each in agent.gain)
    counts = ", ".join(str(len(hearings)) for hearings in agent.modes)
    arcs = []
    for mode, hearings in enumerate(agent.modes):
        arcs.append(f"arcs_{place}_{mode}" if hearings else "0")
    fields = [string(agent.label), row(agent.goal, precision), f"{{{gain}}}"]
    if agent.rest is not None:
        fields.append(row(agent.rest, precision))
    fields.append(str(len(agent.neighbours)))
    fields.append(f"neighbours_{place}" if agent.neighbours else "0")
    return ", ".join([*fields, f"{{{counts}}}", f"{{{', '.join(arcs)}}}"])


def c_code(recorded: Recorded, *, certified: Statement | None = None) -> CCode:
    """All files.  ``certified``: what a certificate says about the sampling period."""
    controller = recorded.controller
    tolerance = rounding_bound(recorded)
    statements = controller.statements
    if certified is not None:
        statements = (*statements, certified)
    texts = {
        "dobc_agent.h": header_text(controller),
        "dobc_agent.c": source_text(controller),
        "main.c": template("main.c.j2").render(compile=COMPILE, controller=controller),
        "vectors.h": vectors_header(recorded, tolerance),
        "vectors.csv": vectors_csv(recorded),
        "README.txt": readme(recorded, statements, tolerance),
    }
    return CCode(
        files={name: text.encode("utf-8") for name, text in texts.items()},
        controller=controller,
        statements=statements,
        tolerance=tolerance,
    )


def readme(recorded: Recorded, statements: Sequence[Statement], tolerance: float) -> str:
    """README.txt."""
    controller = recorded.controller
    problem = controller.problem
    labels = [agent.label for agent in controller.agents]
    heard = [problem.network.labels[index] for index in recorded.agent.neighbours]
    names = ", ".join(labels[:8])
    if len(labels) > 8:
        names += ", ..."
    agents = counted(len(labels), "agent")
    proved = [each.text for each in statements if each.is_proved]
    undecided = [each.text for each in statements if each.verdict is Verdict.UNDECIDED]
    return template("README.txt.j2").render(
        controller=controller,
        problem=problem,
        who=f"{agents} ({names})",
        recorded=recorded,
        neighbours=", ".join(heard) or "none",
        compile=COMPILE,
        period=f"{float(controller.period):.6g}",
        proved=proved or ["nothing"],
        undecided=undecided,
        certified=any(each.kind == "certified-sampling" for each in statements),
        limits=_limits_text(controller),
        items=_items,
        fill=partial(textwrap.fill, width=WIDTH),
        bound=f"{tolerance:.1e}",
        version=__version__,
    )


def _items(sentences: Sequence[str]) -> str:
    wrapper = textwrap.TextWrapper(WIDTH, initial_indent="  - ", subsequent_indent="    ")
    return "\n".join(wrapper.fill(each) for each in sentences)
