"""Bad inputs of exported C code: the code, watched by the sanitizers, against a loop in NumPy that
misses them.

``Missing`` is written from docs/deployment.md: None stands for what was missed.
"""

from __future__ import annotations

import csv
import io
import os
import re
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
from c_code import SANITIZED, STRICT, planar, write_all
from random_problems import random_problem

import dobc_design as dd
from dobc_design.errors import SpecError
from dobc_design.exact.matrix import to_float
from dobc_design.export.rounding_bound import Erring, ErringAlgebra, with_errors
from dobc_design.problem.load import load_problem

BUILT_IN = (
    "paper-fixed",
    "paper-switching",
    "clock-sync",
    "karate-club",
    "uav-swarm",
    "microgrid-ieee14",
)
KINDS = (np.nan, -np.nan, np.inf, -np.inf, 1e30, -1e30)
GOOD = 50  # samples after a bad one, of every case
EACH = 10  # cases of one program
HARNESS = r"""
#include <stdio.h>
#include "dobc_agent.h"

static double next(void)
{
    double value = 0;
    return fread(&value, sizeof value, 1, stdin) == 1 ? value : 0;
}

static void take(dobc_real *values, int count)
{
    int c;
    for (c = 0; c < count; c++) {
        values[c] = (dobc_real)next();
    }
}

/* Standard input, as doubles: agent, samples; for every sample mode, packets, x, whether u was
   limited, u. */
int main(void)
{
    int place = (int)next(), samples = (int)next(), k, j, c;
    dobc_real values[DOBC_COMPONENTS];
    dobc_agent agent;
    dobc_output output;

    while (samples > 0) {
        dobc_init(&agent, &dobc_agents[place]);
        for (k = 0; k < samples; k++) {
            dobc_set_mode(&agent, (int)next());
            for (j = 0; j < dobc_agents[place].neighbour_count; j++) {
                take(values, DOBC_PACKET);
                dobc_receive(&agent, j, values);
            }
            take(values, DOBC_MEASURED);
            dobc_step(&agent, values, &output);
            c = next() > 0;
            take(values, DOBC_INPUTS);
            if (c) {
                dobc_applied(&agent, values);
            }
            for (c = 0; c < 3 * DOBC_INPUTS; c++) {
                double found = (double)(c < DOBC_INPUTS ? output.u
                                        : c < 2 * DOBC_INPUTS ? output.v : output.dhat)[c %
                                        DOBC_INPUTS];
                fwrite(&found, sizeof found, 1, stdout);
            }
            {
                double skipped = (double)agent.skipped;
                fwrite(&skipped, sizeof skipped, 1, stdout);
            }
        }
        place = (int)next();
        samples = (int)next();
    }
    return 0;
}
"""


class Program:
    """The code of an agent, compiled, with its recorded samples: mode (S,), heard (S, J, m), x (S,
    m)."""

    def __init__(self, problem: Any, folder: Path, *, period: str, precision: str) -> None:
        self.code = dd.export.to_c(problem, period=period, precision=precision)
        write_all(self.code.files, folder)
        (folder / "harness.c").write_text(HARNESS)
        command = [
            "gcc",
            *STRICT,
            "-O0",
            *SANITIZED,
            "dobc_agent.c",
            "harness.c",
            "-o",
            "harness",
            "-lm",
        ]
        subprocess.run(command, cwd=folder, check=True, timeout=120)
        self.folder = folder
        self.m = problem.m
        self.p = problem.inputs
        header = self.code.files["vectors.h"]
        found = re.search(rb"VECTOR_AGENT (\d+)", header)
        self.place = int(found[1])
        self.agent = self.code.controller.agents[self.place]
        vectors = self.code.files["vectors.csv"]
        table_text = io.StringIO(vectors.decode())
        rows = list(csv.reader(table_text))[1:]
        table = np.array(rows, dtype=float)
        if precision == "float":  # what the code is given
            table = np.float32(table).astype(float)
        first = 2 + (len(self.code.controller.outputs) or self.m)
        felt = len(self.agent.goal)
        end = first + felt * len(self.agent.neighbours)
        self.mode = table[:, 1].astype(int)
        self.x = table[:, 2:first]
        heard = table[:, first:end]
        neighbours = len(self.agent.neighbours)
        self.heard = heard.reshape(len(table), neighbours, felt)
        self.u, self.dhat = (table[:, table.shape[1] - k * self.p :][:, : self.p] for k in (3, 1))

    def run(self, cases: list[Case]) -> list[Any]:
        """u, v, dhat and the count of skipped inputs of every case, (S, 3 p + 1)."""
        case_rows = map(self.rows, cases)
        given = b"".join(
            np.concatenate([[self.place, len(self.x)], each.ravel()]).tobytes()
            for each in case_rows
        )
        quiet = os.environ | {"ASAN_OPTIONS": "detect_leaks=0"}
        command = [str(self.folder / "harness")]
        done = subprocess.run(
            command,
            input=given,
            capture_output=True,
            check=False,
            timeout=120,
            env=quiet,
        )
        if done.returncode:
            raise AssertionError(done.stderr.decode()[-2000:])
        numbers = np.frombuffer(done.stdout)
        return list(numbers.reshape(len(cases), len(self.x), -1))

    def rows(self, case: Case) -> Any:
        x = self.x.copy()
        heard = self.heard.copy()
        limited = np.zeros((len(self.x), 1))
        u = self.u * 0.5
        case.spoil(x, heard, limited, u)
        mode = self.mode[:, None]
        packets = heard.reshape(len(x), -1)
        columns = [mode, packets, x, limited, u]
        return np.hstack(columns)

    def missing(self, case: Case) -> Any:
        """The same by the loop that misses them."""
        loop = Missing(self)
        rows = []
        limited = case.where == "u"
        for k in range(len(self.x)):
            bad = case.first <= k < case.first + case.length
            heard = []
            for j, y in enumerate(self.heard[k]):
                heard.append(None if bad and case.where == "heard" and case.neighbour == j else y)
            mode = int(self.mode[k])
            outcome = loop.step(mode, heard, None if bad and case.where == "x" else self.x[k])
            rows.append(outcome)
            if limited and not bad:
                loop.held = loop.felt + self.u[k] * 0.5
        return np.array(rows)


class Case:
    """Which input is bad, from which sample on, how long, in which component, and what stands
    there."""

    def __init__(self, rng: np.random.Generator, program: Program) -> None:
        self.where = str(rng.choice(["x", "x", "heard", "u"]))
        most = max(1, program.heard.shape[1])
        neighbour = int(rng.integers(most))
        self.neighbour, self.component = (neighbour, int(rng.integers(program.m)))
        self.where = "x" if self.where == "heard" and not program.heard.shape[1] else self.where
        lengths = [1, 1, 2, 3, 7]
        self.length = int(rng.choice(lengths))
        last = len(program.x) - GOOD - self.length
        firsts = rng.choice([0, 1, rng.integers(2, last)])
        self.first = int(firsts)
        self.value = float(rng.choice(KINDS))

    def __str__(self) -> str:
        return f"{self.where} = {self.value} at {self.first}, {self.length} times"

    def spoil(self, x: Any, heard: Any, limited: Any, u: Any) -> None:
        bad = slice(self.first, self.first + self.length)
        limited[:] = self.where == "u"
        if self.where == "heard":
            heard[bad, self.neighbour, self.component] = self.value
        else:
            (x if self.where == "x" else u)[bad, self.component] = self.value


class Missing:
    """(13) and (19), sampled, of one agent; packets and states may be None."""

    def __init__(self, program: Program) -> None:
        controller = program.code.controller
        agent = program.agent
        self.couplings = controller.problem.couplings
        self.arcs = agent.modes
        self.T = float(controller.period)
        self.m = program.m
        self.q = controller.q
        self.Ad, self.Cd, self.L = (
            (to_float(each) for each in (controller.Ad, controller.Cd, controller.L))
            if self.q
            else (None,) * 3
        )
        goal = to_float((agent.goal,))[0]
        self.goal, self.gain = goal, to_float(agent.gain)
        self.packets: dict[int, Any] = {}
        xihat = np.zeros(self.q)
        self.mode, self.gap, self.x, self.xihat = 0, 0, None, xihat
        self.held = self.felt = np.zeros(self.m)

    def step(self, mode: int, heard: list[Any], x: Any) -> Any:
        if mode != self.mode:
            kept = {arc.neighbour for arc in self.arcs[mode]}
            packets = self.packets.items()
            self.packets = {j: y for j, y in packets if j in kept}
            self.mode = mode
        self.packets |= {j: y for j, y in enumerate(heard) if y is not None}
        if x is None and self.x is None:
            return np.zeros(3 * self.m)
        dhat = self.Cd @ self.xihat if self.q else np.zeros(self.m)
        self.gap += 1
        if self.x is not None:
            expected = self.x + self.T * (self.held + dhat)
            x, mean = (
                (expected, 0 * expected) if x is None else (x, (x - expected) / self.T / self.gap)
            )
            self.gap = self.gap if x is expected else 0
            self.xihat = self.Ad @ self.xihat + self.L @ mean if self.q else self.xihat
        else:
            self.gap = 0
        self.x = x
        e = x - self.goal
        dhat = self.Cd @ self.xihat if self.q else np.zeros(self.m)
        self.felt = np.zeros(self.m)
        for arc in self.arcs[mode]:
            if arc.neighbour in self.packets:
                y = (self.packets[arc.neighbour] - e)[None]
                components = self.couplings[arc.coupling].components
                errors = with_errors(components, Erring(y, 0 * y), ErringAlgebra(0.0))
                h = errors.value[0]
                self.felt = self.felt + float(arc.weight) * h
        u = -self.gain @ e - dhat
        self.held = self.felt + u
        return np.concatenate([u, self.held, dhat])


def programs(folder: Path, seed: int) -> Any:
    """Programs of built-in problems, of one with everything, and of random ones, in both
    precisions."""
    number = 0
    problems = [planar(), *map(load_problem, BUILT_IN)]
    while True:
        problem = problems.pop(0) if problems else random_problem(seed + number)
        for precision in ("double", "float"):
            number += 1
            try:
                yield (
                    f"{problem.name}, {precision}",
                    Program(problem, folder / str(number), period="1/50", precision=precision),
                )
            except SpecError:  # this period is too long, or the loop diverges
                break


def wrong_cases(name: str, program: Program, rng: np.random.Generator, count: int) -> list[str]:
    """The cases whose answers are not those of the loop that missed what was bad."""
    cases = [Case(rng, program) for _ in range(count)]
    failures = []
    for case, found in zip(cases, program.run(cases), strict=True):
        wanted = program.missing(case)
        apart = np.abs(found[:, :-1] - wanted)
        single = 1e-6 * (program.code.controller.precision == "float")
        largest = np.abs(wanted).max()
        rounding = single * largest
        allowed = 4 * program.code.tolerance + rounding
        not_finite = not np.isfinite(found).all()
        bad = not_finite or apart[case.first + case.length + GOOD :].max(initial=0.0) > allowed
        if bad or apart.max() > allowed or found[-1, -1] != case.length:
            failures.append(
                f"{name}: {case}: {apart.max():.3g} > {allowed:.3g}, skipped {found[-1, -1]}"
            )
    return failures
