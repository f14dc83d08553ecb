"""The C99 of a sampled controller: dobc_agent.h and dobc_agent.c.  No heap, no globals that change, no recursion.

One struct holds all memory of an agent; all agents of a table share the code.  The order of operations is that of
``simulation.sampled``: observe, compute the couplings with what was received last, command, hold.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib.resources import files

from jinja2 import Template

from dobc_design import __version__
from dobc_design.export.c_controller import AgentNumbers, Controller
from dobc_design.export.c_text import HELPERS, CAlgebra, array, comment, coupling_function, literal, row, string


def header_text(controller: Controller) -> str:
    """dobc_agent.h."""
    problem = controller.problem
    return template("agent.h.j2").render(
        title=comment(problem.name),
        period=f"{float(controller.period):.10g}",
        version=__version__,
        precision=controller.precision,
        literal=literal(controller.period, controller.precision),
        m=problem.m,
        q=controller.q,
        agents=len(controller.agents),
        modes=len(problem.network.modes),
        names=comment(", ".join(list(problem.network.modes)[:12])),
        estimate="\n    dobc_real estimate[DOBC_ORDER]; /* xihat */" if controller.q else "",
        neighbours=max(1, *(len(agent.neighbours) for agent in controller.agents)),
    )


def source_text(controller: Controller) -> str:
    """dobc_agent.c."""
    problem, precision = controller.problem, controller.precision
    algebra = CAlgebra(precision)
    couplings = [coupling_function(each, number, algebra) for number, each in enumerate(problem.couplings)]
    return template("agent.c.j2").render(
        title=comment(problem.name),
        uses_math=algebra.library,
        q=controller.q,
        Ad=array(controller.Ad, precision),
        Cd=array(controller.Cd, precision),
        L=array(controller.L, precision),
        tables="".join(_tables(controller)),
        functions=[*(text for name, text in HELPERS.items() if name in algebra.used), *couplings],
        couplings=len(couplings),
    )


def template(name: str) -> Template:
    """A file of ``templates/``: text with places for text that is C already: nothing is escaped here."""
    text = (files("dobc_design.export") / "templates" / name).read_text("utf-8")
    made: Template = Template(text, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True)
    return made


def _tables(controller: Controller) -> Iterator[str]:
    """Arcs and neighbours of every agent, then the table of agents."""
    precision, labels = controller.precision, controller.problem.network.labels
    for place, agent in enumerate(controller.agents):
        for mode, hearings in enumerate(agent.modes):
            if hearings:
                arcs = ", ".join(
                    f"{{{arc.neighbour}, {arc.coupling}, {literal(arc.weight, precision)}}}" for arc in hearings
                )
                yield f"static const dobc_arc arcs_{place}_{mode}[] = {{{arcs}}};\n"
        if agent.neighbours:
            names = ", ".join(string(labels[index]) for index in agent.neighbours)
            yield f"static const char *const neighbours_{place}[] = {{{names}}};\n"
    yield "\nconst dobc_config dobc_agents[DOBC_AGENTS] = {\n"
    yield ",\n".join(_config(place, agent, precision) for place, agent in enumerate(controller.agents))
    yield "\n};\n"


def _config(place: int, agent: AgentNumbers, precision: str) -> str:
    counts = ", ".join(str(len(hearings)) for hearings in agent.modes)
    arcs = ", ".join(f"arcs_{place}_{mode}" if hearings else "0" for mode, hearings in enumerate(agent.modes))
    gain = ", ".join(row(each, precision) for each in agent.gain)
    neighbours = f"neighbours_{place}" if agent.neighbours else "0"
    return (
        f"    {{{string(agent.label)}, {row(agent.goal, precision)}, {{{gain}}}, {len(agent.neighbours)},"
        f" {neighbours}, {{{counts}}}, {{{arcs}}}}}"
    )
