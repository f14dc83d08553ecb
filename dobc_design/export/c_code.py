"""The C99 of a sampled controller: dobc_agent.h and dobc_agent.c.  No heap, no globals that change, no recursion.

One struct holds all memory of an agent; all agents of a table share the code.  The order of operations is that of
``simulation.sampled``: observe, compute the couplings with what was received last, command, hold.
"""

from __future__ import annotations

from collections.abc import Iterator

from dobc_design import __version__
from dobc_design.export.c_controller import AgentNumbers, Controller
from dobc_design.export.c_text import HELPERS, CAlgebra, array, comment, coupling_function, literal, row, string

HEADER = """\
/* {title}
 *
 * Observer (13) and control law (19) of one agent, computed every {period} s and held in between.
 * Written by dobc_design {version}; plain C99, no heap, one struct of memory an agent.
 */
#ifndef DOBC_AGENT_H
#define DOBC_AGENT_H

#ifdef __cplusplus
extern "C" {{
#endif

typedef {precision} dobc_real;

#define DOBC_PERIOD {literal} /* s from one sample to the next */
#define DOBC_COMPONENTS {m} /* components of a state */
#define DOBC_ORDER {q} /* states of the disturbance model */
#define DOBC_AGENTS {agents} /* agents in dobc_agents[] */
#define DOBC_MODES {modes} /* graphs: {names} */
#define DOBC_NEIGHBOURS {neighbours} /* room for neighbours of one agent, over all modes */

/* One arc: which neighbour is heard, through which coupling, how strongly. */
typedef struct {{
    int neighbour;
    int coupling;
    dobc_real weight;
}} dobc_arc;

/* The constant numbers of one agent. */
typedef struct {{
    const char *label;
    dobc_real goal[DOBC_COMPONENTS];                  /* target plus formation offset */
    dobc_real gain[DOBC_COMPONENTS][DOBC_COMPONENTS]; /* k, 1/s; 0 where it is not pinned */
    int neighbour_count;
    const char *const *neighbours; /* whose packets go to dobc_receive as 0, 1, ... */
    int arc_counts[DOBC_MODES];
    const dobc_arc *arcs[DOBC_MODES];
}} dobc_config;

/* All memory of one agent. */
typedef struct {{
    const dobc_config *config;
    int mode;
    int started;
    unsigned char heard[DOBC_NEIGHBOURS]; /* whether values[] holds a packet */
    dobc_real values[DOBC_NEIGHBOURS][DOBC_COMPONENTS];
    dobc_real before[DOBC_COMPONENTS]; /* state at the last sample */
    dobc_real felt[DOBC_COMPONENTS];   /* couplings held since then */
    dobc_real held[DOBC_COMPONENTS];   /* couplings plus input held since then */{estimate}
}} dobc_agent;

/* What holds until the next sample, in units of the state per second. */
typedef struct {{
    dobc_real felt[DOBC_COMPONENTS]; /* couplings: sum of weight * h(y_j - e) */
    dobc_real dhat[DOBC_COMPONENTS]; /* estimated disturbance, mean over the period */
    dobc_real u[DOBC_COMPONENTS];    /* input (19): -k (x - goal) - dhat */
    dobc_real v[DOBC_COMPONENTS];    /* felt + u: the command where couplings are computed, not physical */
}} dobc_output;

extern const dobc_config dobc_agents[DOBC_AGENTS];

/* Start an agent in mode 0, without packets, with the estimate 0. */
void dobc_init(dobc_agent *agent, const dobc_config *config);

/* Change the graph; packets of neighbours that are not heard in it are forgotten.  Returns 0, or -1 for no mode. */
int dobc_set_mode(dobc_agent *agent, int mode);

/* What to send to the others: y = x - goal. */
void dobc_packet(const dobc_agent *agent, const dobc_real x[DOBC_COMPONENTS], dobc_real y[DOBC_COMPONENTS]);

/* Take in a packet of a neighbour; it counts until the next one.  Returns 0, or -1 for no neighbour. */
int dobc_receive(dobc_agent *agent, int neighbour, const dobc_real y[DOBC_COMPONENTS]);

/* Forget a neighbour that has fallen silent for good: the arc then adds nothing.  Returns 0 or -1. */
int dobc_forget(dobc_agent *agent, int neighbour);

/* One sample: call it every DOBC_PERIOD with the measured state, after the packets of this instant. */
void dobc_step(dobc_agent *agent, const dobc_real x[DOBC_COMPONENTS], dobc_output *output);

/* Tell the observer which input was applied instead of output->u, when an actuator has limits; after dobc_step. */
void dobc_applied(dobc_agent *agent, const dobc_real u[DOBC_COMPONENTS]);

#ifdef __cplusplus
}}
#endif

#endif
"""

FUNCTIONS = """\
void dobc_init(dobc_agent *agent, const dobc_config *config)
{
    int i, c;

    agent->config = config;
    agent->mode = 0;
    agent->started = 0;
    for (i = 0; i < DOBC_NEIGHBOURS; i++) {
        agent->heard[i] = 0;
        for (c = 0; c < DOBC_COMPONENTS; c++) {
            agent->values[i][c] = 0;
        }
    }
    for (c = 0; c < DOBC_COMPONENTS; c++) {
        agent->before[c] = 0;
        agent->felt[c] = 0;
        agent->held[c] = 0;
    }
@INIT@}

int dobc_set_mode(dobc_agent *agent, int mode)
{
    int i, a;

    if (mode < 0 || mode >= DOBC_MODES) {
        return -1;
    }
    if (mode != agent->mode) {
        for (i = 0; i < DOBC_NEIGHBOURS; i++) {
            unsigned char kept = 0;

            for (a = 0; a < agent->config->arc_counts[mode]; a++) {
                if (agent->config->arcs[mode][a].neighbour == i) {
                    kept = agent->heard[i];
                }
            }
            agent->heard[i] = kept;
        }
        agent->mode = mode;
    }
    return 0;
}

void dobc_packet(const dobc_agent *agent, const dobc_real x[DOBC_COMPONENTS], dobc_real y[DOBC_COMPONENTS])
{
    int c;

    for (c = 0; c < DOBC_COMPONENTS; c++) {
        y[c] = x[c] - agent->config->goal[c];
    }
}

int dobc_receive(dobc_agent *agent, int neighbour, const dobc_real y[DOBC_COMPONENTS])
{
    int c;

    if (neighbour < 0 || neighbour >= agent->config->neighbour_count) {
        return -1;
    }
    for (c = 0; c < DOBC_COMPONENTS; c++) {
        agent->values[neighbour][c] = y[c];
    }
    agent->heard[neighbour] = 1;
    return 0;
}

int dobc_forget(dobc_agent *agent, int neighbour)
{
    if (neighbour < 0 || neighbour >= agent->config->neighbour_count) {
        return -1;
    }
    agent->heard[neighbour] = 0;
    return 0;
}

void dobc_step(dobc_agent *agent, const dobc_real x[DOBC_COMPONENTS], dobc_output *output)
{
    const dobc_config *config = agent->config;
    dobc_real e[DOBC_COMPONENTS], y[DOBC_COMPONENTS], h[DOBC_COMPONENTS];
    int a, c, d;

@OBSERVE@    for (c = 0; c < DOBC_COMPONENTS; c++) {
        e[c] = x[c] - config->goal[c];
        output->felt[c] = 0;
@DHAT@    }
    for (a = 0; a < config->arc_counts[agent->mode]; a++) {
        const dobc_arc *arc = &config->arcs[agent->mode][a];

        if (agent->heard[arc->neighbour]) {
            for (c = 0; c < DOBC_COMPONENTS; c++) {
                y[c] = agent->values[arc->neighbour][c] - e[c];
            }
            couple(arc->coupling, y, h);
            for (c = 0; c < DOBC_COMPONENTS; c++) {
                output->felt[c] += arc->weight * h[c];
            }
        }
    }
    for (c = 0; c < DOBC_COMPONENTS; c++) {
        dobc_real pull = 0;

        for (d = 0; d < DOBC_COMPONENTS; d++) {
            pull += config->gain[c][d] * e[d];
        }
        output->u[c] = -pull - output->dhat[c];
        output->v[c] = output->felt[c] + output->u[c];
        agent->felt[c] = output->felt[c];
        agent->held[c] = output->v[c];
        agent->before[c] = x[c];
    }
    agent->started = 1;
}

void dobc_applied(dobc_agent *agent, const dobc_real u[DOBC_COMPONENTS])
{
    int c;

    for (c = 0; c < DOBC_COMPONENTS; c++) {
        agent->held[c] = agent->felt[c] + u[c];
    }
}
"""

OBSERVE = """\
/* xihat at this sample from the one before: the measured mean of the disturbance against the expected one. */
static void observe(dobc_agent *agent, const dobc_real x[DOBC_COMPONENTS])
{
    dobc_real surprise[DOBC_COMPONENTS], next[DOBC_ORDER];
    int c, k, l;

    for (c = 0; c < DOBC_COMPONENTS; c++) {
        surprise[c] = (x[c] - agent->before[c]) / DOBC_PERIOD - agent->held[c];
        for (k = 0; k < DOBC_ORDER; k++) {
            surprise[c] -= output_matrix[c][k] * agent->estimate[k];
        }
    }
    for (k = 0; k < DOBC_ORDER; k++) {
        next[k] = 0;
        for (l = 0; l < DOBC_ORDER; l++) {
            next[k] += transition[k][l] * agent->estimate[l];
        }
        for (c = 0; c < DOBC_COMPONENTS; c++) {
            next[k] += correction[k][c] * surprise[c];
        }
    }
    for (k = 0; k < DOBC_ORDER; k++) {
        agent->estimate[k] = next[k];
    }
}

"""

CALL_OBSERVE = """\
    if (agent->started) {
        observe(agent, x);
    }
"""
SUM_DHAT = """\
        output->dhat[c] = 0;
        for (k = 0; k < DOBC_ORDER; k++) {
            output->dhat[c] += output_matrix[c][k] * agent->estimate[k];
        }
"""


def header_text(controller: Controller) -> str:
    """dobc_agent.h."""
    problem = controller.problem
    estimate = "\n    dobc_real estimate[DOBC_ORDER]; /* xihat */" if controller.q else ""
    return HEADER.format(
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
        estimate=estimate,
        neighbours=max(1, *(len(agent.neighbours) for agent in controller.agents)),
    )


def source_text(controller: Controller) -> str:
    """dobc_agent.c."""
    problem, precision = controller.problem, controller.precision
    algebra = CAlgebra(precision)
    couplings = [coupling_function(each, number, algebra) for number, each in enumerate(problem.couplings)]
    parts = [f"/* {comment(problem.name)}: see dobc_agent.h. */\n", '#include "dobc_agent.h"\n']
    if algebra.library:
        parts.append("#include <math.h>\n")
    if controller.q:
        parts += [
            f"\n/* Ad = exp(A T) */\nstatic const dobc_real transition[DOBC_ORDER][DOBC_ORDER] = "
            f"{array(controller.Ad, precision)};\n",
            f"\n/* Cd = C (1/T) int_0^T exp(A s) ds */\nstatic const dobc_real "
            f"output_matrix[DOBC_COMPONENTS][DOBC_ORDER] = {array(controller.Cd, precision)};\n",
            f"\n/* L: what the estimate learns from a sample */\nstatic const dobc_real "
            f"correction[DOBC_ORDER][DOBC_COMPONENTS] = {array(controller.L, precision)};\n",
        ]
    parts += ["\n", *_tables(controller), "\n"]
    parts += [f"{text}\n" for name, text in HELPERS.items() if name in algebra.used]
    parts += [f"{text}\n" for text in couplings]
    parts.append(_dispatch(len(couplings)))
    parts += [OBSERVE] if controller.q else []
    start = "    for (c = 0; c < DOBC_ORDER; c++) {\n        agent->estimate[c] = 0;\n    }\n" if controller.q else ""
    functions = FUNCTIONS.replace("@INIT@", start)
    functions = functions.replace("@DHAT@", SUM_DHAT if controller.q else "        output->dhat[c] = 0;\n")
    counters = "int a, c, d, k;" if controller.q else "int a, c, d;"
    functions = functions.replace("int a, c, d;\n\n@OBSERVE@", f"{counters}\n\n{CALL_OBSERVE if controller.q else ''}")
    return "".join([*parts, functions])


def _dispatch(count: int) -> str:
    head = "static void couple(int which, const dobc_real y[DOBC_COMPONENTS], dobc_real h[DOBC_COMPONENTS])\n{\n"
    if count == 1:
        return f"{head}    (void)which;\n    coupling_0(y, h);\n}}\n\n"
    cases = "".join(f"    case {i}:\n        coupling_{i}(y, h);\n        break;\n" for i in range(count - 1))
    return f"{head}    switch (which) {{\n{cases}    default:\n        coupling_{count - 1}(y, h);\n    }}\n}}\n\n"


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
