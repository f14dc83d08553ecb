"""The folder of ``dobc export --c``: code, a usage example that tests itself, test vectors, and
README.txt.

Test vectors are one agent's samples in the simulated loop: measured states and received packets go
in; u, v and dhat have to come out, within a bound derived for the precision.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from os import PathLike
from pathlib import Path

import numpy as np

from dobc_design import __version__
from dobc_design._show.cards import Card, Headed
from dobc_design._show.text import significant
from dobc_design.certificate.files import make_folder, write_together
from dobc_design.conditions.statement import Statement
from dobc_design.errors import SpecError
from dobc_design.export.c_controller import AgentNumbers, Controller
from dobc_design.export.c_text import (
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
from dobc_design.export.c_text import literal as c_literal
from dobc_design.export.rounding_bound import Array, Recorded, felt_with_error, rounding_bound
from dobc_design.problem.arrays import Gain
from dobc_design.problem.dynamics import expressions_of
from dobc_design.simulation.runs import run_once
from dobc_design.simulation.setting import Stress, make_setting
from dobc_design.simulation.signals import Mobile, Signal
from dobc_design.simulation.trajectory import Trajectory

SECONDS = 10.0
MOST_SAMPLES = 400
# relative tolerance where agents have to be integrated: the code is compared at the states recorded
COARSE = 1e-6


class Recorder:
    """Simulates the sampled loop of a controller over 10 s (at most 400 samples), and remembers the
    last one.  ``gain`` and ``sampled_gain`` as in ``make_controller``.  A ``signal`` that depends
    on the states is left out: the first mode then holds.  Where the agent whose samples are
    recorded has a limit, all inputs are cut off there."""

    def __init__(
        self,
        *,
        gain: Gain | None = None,
        sampled_gain: Gain | None = None,
        signal: Signal | None = None,
    ) -> None:
        self.gain, self.signal = gain, None if isinstance(signal, Mobile) else signal
        self.sampled = (
            None if sampled_gain is None else tuple(tuple(map(float, row)) for row in sampled_gain)
        )
        self.last: tuple[Fraction, Trajectory] | None = None

    def objection(self, controller: Controller) -> str:
        """Why this period does not do in a simulation, or "".  Raises: SpecError where none
        does."""
        run = self.run(controller)
        if run.diverged and (free := self.simulated(controller, None)).diverged:
            message = (
                f"in a simulation {free.reason}, although nothing is sampled: no period helps."
            )
            cure = "Give starts from which the loop converges: simulation.x0, or a [region]."
            raise SpecError(message, key="simulation", cure=cure)
        return f"in a simulation {run.reason}." if run.diverged else ""

    def run(self, controller: Controller) -> Trajectory:
        """The sampled loop at the controller's period."""
        if self.last is None or self.last[0] != controller.period:
            given = _limits(controller).get(_recorded_agent(controller).label)
            limit = None if given is None else float(rounded(given, "double"))
            stress = Stress(
                period=float(controller.period), sampled_gain=self.sampled, saturation=limit
            )
            self.last = controller.period, self.simulated(controller, stress)
        return self.last[1]

    def simulated(self, controller: Controller, stress: Stress | None) -> Trajectory:
        """The loop at the multiples of the period."""
        period = float(controller.period)
        times = [k * period for k in range(max(2, min(MOST_SAMPLES, int(SECONDS / period)) + 1))]
        setting = make_setting(
            controller.problem,
            mode=next(iter(controller.problem.network.modes)) if self.signal is None else None,
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
            raise SpecError(
                f"there are no test vectors: {why}", key="--period", cure="Take a shorter period."
            )
        run = self.run(controller)
        agent = _recorded_agent(controller)
        i, others, names = (
            agent.index,
            list(agent.neighbours),
            list(controller.problem.network.modes),
        )
        modes = np.array([names.index(name) for name in run.switches.names])[run.mode_index]
        heard = run.x[:, others] - run.goal[others]
        u, own = (
            run.u[:, i],
            {"x": run.x[:, i], "dhat": run.dhat[:, i], "xihat": run.xihat[:, i, controller.states]},
        )
        bare = Recorded(agent=agent, modes=modes, heard=heard, u=u, v=u, **own)
        e = run.x[:, i] - run.goal[i]
        return replace(bare, v=felt_with_error(controller, bare, e, np.zeros_like(e), 0.0)[0] + u)


def _recorded_agent(controller: Controller) -> AgentNumbers:
    return next(
        (each for each in controller.agents if any(map(any, each.gain))), controller.agents[0]
    )


def _limits(controller: Controller) -> dict[str, Fraction]:
    """label -> largest |u| of a component, for the agents of the code that have a limit in
    [actuators]."""
    table, labels = controller.problem.actuators, [agent.label for agent in controller.agents]
    found = {label: None if table is None else table.limit_of(label) for label in labels}
    return {label: limit for label, limit in found.items() if limit is not None}


def _limits_text(controller: Controller) -> str:
    """The limits for a comment: one number where all agents have the same, else agent by agent."""
    limits = _limits(controller)
    if len(limits) == len(controller.agents) and len(set(limits.values())) == 1:
        return significant(next(iter(limits.values())), 6)
    first = [
        f"{significant(limit, 6)} (agent {label})" for label, limit in list(limits.items())[:12]
    ]
    return ", ".join([*first, *(["..."] if len(limits) > 12 else [])])


def vectors_csv(controller: Controller, recorded: Recorded) -> str:
    """The samples as CSV: time, mode, x, heard values, u, v, dhat; numbers in full double
    precision."""
    problem, agent = controller.problem, recorded.agent
    m, p, neighbours = (
        range(1, problem.m + 1),
        range(1, problem.inputs + 1),
        range(len(agent.neighbours)),
    )
    head = [
        "time",
        "mode",
        *(f"x{c}" for c in m),
        *(f"heard{j}_{c}" for j in neighbours for c in m),
    ]
    head += [f"{name}{c}" for name in ("u", "v", "dhat") for c in p]
    lines = [",".join(head)]
    for k in range(len(recorded.x)):
        numbers = [
            recorded.x[k],
            recorded.heard[k].ravel(),
            recorded.u[k],
            recorded.v[k],
            recorded.dhat[k],
        ]
        texts = [repr(float(value)) for part in numbers for value in part]
        lines.append(
            ",".join([repr(k * float(controller.period)), str(int(recorded.modes[k])), *texts])
        )
    return "\n".join(lines) + "\n"


def vectors_header(controller: Controller, recorded: Recorded) -> str:
    """vectors.h: the same as constant arrays, with the tolerance that is derived for this
    precision."""
    problem, agent = controller.problem, recorded.agent
    place = next(i for i, each in enumerate(controller.agents) if each.index == agent.index)
    count = len(recorded.x)
    heard = recorded.heard if agent.neighbours else np.zeros((count, 1, problem.m))
    tolerance = rounding_bound(controller, recorded)
    if not np.isfinite(tolerance):
        message = (
            "the rounding errors of the test vectors have no finite bound: a coupling is near "
            "a singularity."
        )
        raise SpecError(
            message,
            key="export",
            cure="Simulate from other starts ([region]), or use --precision double.",
        )

    def entries(values: Array) -> str:
        return ", ".join(bare(Fraction(float(value)), controller.precision) for value in values)

    return template("vectors.h.j2").render(
        label=comment(agent.label),
        place=place,
        count=count,
        neighbours=len(agent.neighbours),
        tolerance=f"{tolerance:.3e}",
        precision=controller.precision,
        modes=", ".join(str(int(mode)) for mode in recorded.modes),
        vectors={"x": recorded.x, "u": recorded.u, "v": recorded.v, "dhat": recorded.dhat},
        heard=heard,
        entries=entries,
    )


FILES = ("dobc_agent.h", "dobc_agent.c", "main.c", "vectors.h", "vectors.csv", "README.txt")
WIDTH = 100
COMPILE = (
    "gcc -std=c99 -O2 -Wall -Wextra -Werror -pedantic dobc_agent.c main.c -o selftest -lm && "
    "./selftest"
)


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
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
        make_folder(target)
        write_together({target / name: data for name, data in self.files.items()})
        return [target / name for name in self.files]

    def _card(self) -> Card:
        return Card(
            title="C99 code",
            text=str(self).partition("\n")[0],
            lines=[str(each) for each in self.statements],
            heads=("file", "bytes"),
            rows=[(name, len(data)) for name, data in self.files.items()],
        )

    def __str__(self) -> str:
        controller, count = self.controller, len(self.controller.agents)
        head = (
            f"C99 of {count} agent{'s' if count != 1 else ''} of {controller.problem.name}, "
            f"{controller.precision}"
        )
        head += f", every {float(controller.period):g} s"
        return "\n".join([head, *(f"  {each}" for each in self.statements)])


def check_free(folder: Path, *, force: bool) -> None:
    """Refuse a folder that is none, or that holds one of the files already.  Raises: SpecError."""
    if folder.exists() and not folder.is_dir():
        raise SpecError(f"{str(folder)!r} is not a folder.", key="--c", cure="Choose another.")
    there = [name for name in FILES if (folder / name).exists()]
    if there and not force:
        cure = "Add --force to replace it, or choose another folder."
        raise SpecError(f"{str(folder / there[0])!r} exists already.", key="--c", cure=cure)


def header_text(controller: Controller) -> str:
    """dobc_agent.h."""
    problem = controller.problem
    return template("agent.h.j2").render(
        controller=controller,
        problem=problem,
        title=comment(problem.name),
        period=f"{float(controller.period):.10g}",
        version=__version__,
        literal=c_literal(controller.period, controller.precision),
        names=comment(", ".join(list(problem.network.modes)[:12])),
        estimate="\n    dobc_real estimate[DOBC_ORDER]; /* xihat */" if controller.q else "",
        neighbours=max(1, *(len(agent.neighbours) for agent in controller.agents)),
        limits=comment(_limits_text(controller)),
    )


def source_text(controller: Controller) -> str:
    """dobc_agent.c."""
    problem, precision = controller.problem, controller.precision
    algebra = CAlgebra(precision)
    own, made = problem.dynamics, partial(function, algebra=algebra, m=problem.m)
    couplings = [
        made(f"coupling_{number}(y, h)", each.components, each.texts, size="DOBC_INPUTS")
        for number, each in enumerate(problem.couplings)
    ]
    drift = (
        own and own.f and made("drift(x, f)", expressions_of(own), own.f, size="DOBC_COMPONENTS")
    )
    return template("agent.c.j2").render(
        title=comment(problem.name),
        uses_math=algebra.library,
        q=controller.q,
        plant=own,
        drift=drift,
        motion=array(controller.motion, precision),
        push=array(controller.push, precision),
        watch=array(controller.watch, precision),
        Ad=array(controller.Ad, precision),
        Cd=array(controller.Cd, precision),
        L=array(controller.L, precision),
        tables="".join(_tables(controller)),
        used=algebra.used,
        functions=couplings,
        couplings=len(couplings),
        limited=bool(_limits(controller)),
    )


def _tables(controller: Controller) -> Iterator[str]:
    """Arcs and neighbours of every agent, then the table of agents."""
    precision, labels, limits = (
        controller.precision,
        controller.problem.network.labels,
        _limits(controller),
    )
    for place, agent in enumerate(controller.agents):
        for mode, hearings in enumerate(agent.modes):
            if hearings:
                arcs = ", ".join(
                    f"{{{arc.neighbour}, {arc.coupling}, {c_literal(arc.weight, precision)}}}"
                    for arc in hearings
                )
                yield f"static const dobc_arc arcs_{place}_{mode}[] = {{{arcs}}};\n"
        if agent.neighbours:
            names = ", ".join(string(labels[index]) for index in agent.neighbours)
            yield f"static const char *const neighbours_{place}[] = {{{names}}};\n"
    yield "\nconst dobc_config dobc_agents[DOBC_AGENTS] = {\n"
    rows = (_config(place, agent, precision) for place, agent in enumerate(controller.agents))
    if limits:  # -1 stands for no limit
        ends = (
            bare(limits.get(agent.label, Fraction(-1)), precision) for agent in controller.agents
        )
        rows = (f"{row[:-1]}, {end}}}" for row, end in zip(rows, ends, strict=True))
    yield ",\n".join(rows)
    yield "\n};\n"


def _config(place: int, agent: AgentNumbers, precision: str) -> str:
    counts = ", ".join(str(len(hearings)) for hearings in agent.modes)
    arcs = ", ".join(
        f"arcs_{place}_{mode}" if hearings else "0" for mode, hearings in enumerate(agent.modes)
    )
    gain = ", ".join(row(each, precision) for each in agent.gain)
    neighbours = f"neighbours_{place}" if agent.neighbours else "0"
    rest = "" if agent.rest is None else f" {row(agent.rest, precision)},"
    text = (
        f"    {{{string(agent.label)}, {row(agent.goal, precision)}, {{{gain}}},{rest} "
        f"{len(agent.neighbours)},"
    )
    return text + f" {neighbours}, {{{counts}}}, {{{arcs}}}}}"


def c_code(
    controller: Controller, recorded: Recorded, *, certified: Statement | None = None
) -> CCode:
    """All files.  ``certified``: what a certificate says about the sampling period."""
    statements = (*controller.statements, *([] if certified is None else [certified]))
    texts = {
        "dobc_agent.h": header_text(controller),
        "dobc_agent.c": source_text(controller),
        "main.c": template("main.c.j2").render(compile=COMPILE),
        "vectors.h": vectors_header(controller, recorded),
        "vectors.csv": vectors_csv(controller, recorded),
        "README.txt": readme(controller, recorded, statements),
    }
    return CCode(
        files={name: texts[name].encode("utf-8") for name in FILES},
        controller=controller,
        statements=statements,
        tolerance=rounding_bound(controller, recorded),
    )


def readme(controller: Controller, recorded: Recorded, statements: Sequence[Statement]) -> str:
    """README.txt."""
    problem, agents = controller.problem, controller.agents
    labels = [agent.label for agent in agents]
    names = ", ".join(labels[:8]) + (", ..." if len(labels) > 8 else "")
    proved = [each.text for each in statements if each.verdict.value == "proved"]
    undecided = [each.text for each in statements if each.verdict.value == "undecided"]
    certified = any(each.kind == "certified-sampling" for each in statements)
    return template("README.txt.j2").render(
        name=problem.name,
        rule="=" * (len(problem.name) + 45),
        who=f"{len(labels)} agent{'s' if len(labels) != 1 else ''} ({names})",
        samples=len(recorded.x),
        agent=recorded.agent.label,
        neighbours=", ".join(problem.network.labels[index] for index in recorded.agent.neighbours)
        or "none",
        compile=COMPILE,
        period=f"{float(controller.period):.6g}",
        observes=controller.q > 0,
        plant=problem.dynamics,
        drift=problem.dynamics and problem.dynamics.f,
        proved=proved or ["nothing"],
        undecided=undecided,
        certified=certified,
        limits=_limits_text(controller),
        items=_items,
        fill=partial(textwrap.fill, width=WIDTH),
        precision=controller.precision,
        bound=f"{rounding_bound(controller, recorded):.1e}",
        version=__version__,
    )


def _items(sentences: Sequence[str]) -> str:
    return "\n".join(
        textwrap.fill(each, WIDTH, initial_indent="  - ", subsequent_indent="    ")
        for each in sentences
    )
