"""The folder of ``dobc export --c``: code, a usage example that tests itself, test vectors, and README.txt."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

from dobc_design import __version__
from dobc_design._show.cards import Card, Shown
from dobc_design.certificate.files import make_folder, write_together
from dobc_design.conditions.statement import Statement
from dobc_design.errors import SpecError
from dobc_design.export.c_code import header_text, source_text
from dobc_design.export.c_controller import Controller
from dobc_design.export.c_vectors import labels_of_neighbours, vectors_csv, vectors_header
from dobc_design.export.rounding_bound import Recorded, rounding_bound

FILES = ("dobc_agent.h", "dobc_agent.c", "main.c", "vectors.h", "vectors.csv", "README.txt")
WIDTH = 100
COMPILE = "gcc -std=c99 -O2 -Wall -Wextra -Werror -pedantic dobc_agent.c main.c -o selftest -lm && ./selftest"

MAIN = """\
/* Usage example and self-test: feeds the test vectors to one agent and compares what it answers.
 *
 *     {compile}
 *
 * Replace the vectors by your sensor, your radio and your actuator, and call dobc_step every DOBC_PERIOD.
 */
#include <stdio.h>

#include "dobc_agent.h"
#include "vectors.h"

static double difference(const dobc_real *found, const dobc_real *wanted)
{{
    double worst = 0.0;
    int c;

    for (c = 0; c < DOBC_COMPONENTS; c++) {{
        double apart = (double)found[c] - (double)wanted[c];

        if (!(apart <= worst && -apart <= worst)) {{
            worst = apart < 0.0 ? -apart : apart;
        }}
    }}
    return worst;
}}

int main(void)
{{
    dobc_agent agent; /* all the memory it needs */
    dobc_output output;
    double worst = 0.0;
    int k, j;

    dobc_init(&agent, &dobc_agents[VECTOR_AGENT]);
    for (k = 0; k < VECTOR_SAMPLES; k++) {{
        double apart[3];

        dobc_set_mode(&agent, vector_mode[k]);                   /* which graph holds now */
        for (j = 0; j < VECTOR_NEIGHBOURS; j++) {{
            dobc_receive(&agent, j, vector_heard[k][j]);         /* packets that have arrived */
        }}
        dobc_step(&agent, vector_x[k], &output);                 /* the measured state; then command output.u */
        apart[0] = difference(output.u, vector_u[k]);
        apart[1] = difference(output.v, vector_v[k]);
        apart[2] = difference(output.dhat, vector_dhat[k]);
        for (j = 0; j < 3; j++) {{
            if (!(apart[j] <= worst)) {{
                worst = apart[j];
            }}
        }}
    }}
    printf("agent %s, %d samples: largest difference %.3e, allowed %.3e: %s\\n", dobc_agents[VECTOR_AGENT].label,
           VECTOR_SAMPLES, worst, VECTOR_TOLERANCE, worst <= VECTOR_TOLERANCE ? "passed" : "FAILED");
    return worst <= VECTOR_TOLERANCE ? 0 : 1;
}}
"""

README = """\
{name}: observer and controller of one agent in C99
{rule}

{intro}

Files
  dobc_agent.h    types and functions; read it first
  dobc_agent.c    the code and the numbers of {who}
  main.c          usage example; compares the code with the test vectors
  vectors.h/.csv  {samples} samples of agent {agent} in the simulated loop
                  its neighbours 0, 1, ...: {neighbours}

Compile and test
  {compile}

Every {period} s, on every agent
  1. measure x (relative to the frame of the target); y = x - goal, see dobc_packet, goes to those who listen
  2. dobc_receive what has arrived; a packet counts until the next one, an arc that never got one adds nothing
  3. dobc_step; hold its answer until the next sample
  4. dobc_applied, if the actuator could not do what it was told

Which command
  output.u  where the couplings are physical (power lines, springs): they act by themselves, and the code
            computes them from the packets only so that the observer can subtract them
  output.v  where the couplings are computed: v = couplings + u is the whole command

What is proved about these numbers, exactly
{proved}

What is not
{open}

Numbers: {precision}; Ad, Cd and L are the exact discretisation of (13) over {period} s, enclosed by interval
arithmetic and rounded once. u, v and dhat may differ from the double-precision simulation by {bound:.1e} (derived:
one unit roundoff an operation, four for a function of the C library, carried along the vectors).
Written by dobc_design {version}.
"""


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class CCode(Shown):
    """C99 of a sampled controller: the files by name, the numbers in them, and what is decided about them.

    ``tolerance``: how far u, v and dhat may be from the double-precision loop along the test vectors.
    """

    files: Mapping[str, bytes]
    controller: Controller
    statements: tuple[Statement, ...]
    tolerance: float

    def save(self, folder: str | PathLike[str], *, force: bool = False) -> list[Path]:
        """Write the files into ``folder``.  Raises: SpecError if one of them is there already, unless ``force``."""
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

    def __repr__(self) -> str:
        return f"<CCode: {str(self).partition(chr(10))[0]}>"

    def __str__(self) -> str:
        count = len(self.controller.agents)
        controller = self.controller
        head = f"C99 of {count} agent{'s' if count != 1 else ''} of {controller.problem.name}, {controller.precision}"
        head += f", every {float(controller.period):g} s"
        return "\n".join([head, *(f"  {each}" for each in self.statements)])


def check_free(folder: Path, *, force: bool) -> None:
    """Refuse a folder that is none, or that holds one of the files already.  Raises: SpecError."""
    if folder.exists() and not folder.is_dir():
        raise SpecError(f"{str(folder)!r} is not a folder.", key="--c", cure="Choose another.")
    there = [name for name in FILES if (folder / name).exists()]
    if there and not force:
        raise SpecError(
            f"{str(folder / there[0])!r} exists already.",
            key="--c",
            cure="Add --force to replace it, or choose another folder.",
        )


def c_code(controller: Controller, recorded: Recorded, *, certified: Statement | None = None) -> CCode:
    """All files.  ``certified``: what a certificate says about the sampling period."""
    statements = (*controller.statements, *([] if certified is None else [certified]))
    texts = {
        "dobc_agent.h": header_text(controller),
        "dobc_agent.c": source_text(controller),
        "main.c": MAIN.format(compile=COMPILE),
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
    held = (
        "anything for physical couplings between samples: code and statements hold couplings over a period, so choose"
        " it so short that they hardly change in it."
    )
    floor = "anything about ranges, overflow and timing on the target; the vectors are a test, not a proof."
    far = "convergence from far away with couplings held; a certificate's check `sampling` states how long they may be."
    return README.format(
        name=problem.name,
        rule="=" * (len(problem.name) + 45),
        intro=textwrap.fill(
            f"Equations (13) and (19), sampled every {float(controller.period):.6g} s. No heap, no global that changes,"
            " and of <math.h> only what the coupling needs. One struct dobc_agent holds all memory of an agent."
            f"{'' if controller.q else ' Without an exosystem there is no observer.'}",
            WIDTH,
        ),
        who=f"{len(labels)} agent{'s' if len(labels) != 1 else ''} ({names})",
        samples=len(recorded.x),
        agent=recorded.agent.label,
        neighbours=", ".join(labels_of_neighbours(problem, recorded)) or "none",
        compile=COMPILE,
        period=f"{float(controller.period):.6g}",
        proved=_items(proved or ["nothing"]),
        open=_items([*undecided, *([] if certified else [far]), held, floor]),
        precision=controller.precision,
        bound=rounding_bound(controller, recorded),
        version=__version__,
    )


def _items(sentences: Sequence[str]) -> str:
    return "\n".join(textwrap.fill(each, WIDTH, initial_indent="  - ", subsequent_indent="    ") for each in sentences)
