"""Exported C of one agent on a processor, driven by a program that knows the recursion from the
theory alone: a plant and a controller in long double, with packets that are late, lost, too old or
no numbers, and measurements that fail."""

import subprocess
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from c_code import SANITIZED
from oracles.late import sampled_error
from scipy.linalg import expm

from dobc_design import Problem, load_problem
from dobc_design.exact.matrix import to_float
from dobc_design.export import to_c

A = np.array([[0.0, 2.0], [-2.0, 0.0]])
C = np.array([[1.0, 0.0]])
W = np.array([[3.2], [2.4]])

OLDEST = 4  # samples that a packet may be old

DRIVER = r"""
#include <math.h>
#include <stdio.h>
#include "dobc_agent.h"
#include "numbers.h"

#define PAST 64

static unsigned long long state = SEED;

static double chance(void)
{
    state = state * 6364136223846793005ULL + 1442695040888963407ULL;
    return (double)(state >> 11) / 9007199254740992.0;
}

static long double h(long double y)
{
    return expm1l(y) + y;
}

int main(void)
{
    static double said[PAST];
    static long double sent[DELAY + 1];
    int waiting;
    long double xi[2] = {0.4L, 0.3L}, eps[2] = {0.4L, 0.3L}, xhat[2] = {0, 0};
    long double x = 1.5L, before = 0, held = 0, heard = 0, worst = 0, apart = 0;
    long k, missed = 0, made = -1, skipped = 0, late = 0;
    dobc_agent agent;
    dobc_output output;

    dobc_init(&agent, &dobc_agents[0]);
    for (k = 0; k < STEPS; k++) {
        const double roll = chance();
        const int age = (int)(chance() * (OLDEST + 3));
        double measured = (double)x, packet;
        long double felt, u, next[2];

        said[k % PAST] = 0.3 * sin(0.7 * (double)k) + 0.2 * chance();
        if (roll < 0.6 && age <= k) { /* else it is lost */
            packet = roll < 0.05 ? NAN : said[(k - age) % PAST];
            dobc_receive_aged(&agent, 0, &packet, (unsigned long)age);
            if (age > OLDEST) {
                late++;
            } else if (made >= 0 && k - age < made) {
                /* there is a younger one */
            } else if (packet != packet) {
                skipped++;
            } else {
                heard = packet;
                made = k - age;
            }
        }
        late += made >= 0 && k - made > OLDEST;
        if (!CLEAN && k > 0 && chance() < 0.02) {
            measured = NAN;
            skipped++;
        }
        /* the recursion; without a measurement, its model */
        if (k > 0) {
            long double expected = before + PERIOD * held + CG[0] * xhat[0] + CG[1] * xhat[1];
            long double own = measured == measured ? measured : expected;
            long double surprise = (own - expected) / (long double)(missed + 1);

            next[0] = AD[0][0] * xhat[0] + AD[0][1] * xhat[1] + W[0] * surprise;
            next[1] = AD[1][0] * xhat[0] + AD[1][1] * xhat[1] + W[1] * surprise;
            xhat[0] = next[0];
            xhat[1] = next[1];
            before = own;
        } else {
            before = measured;
        }
        missed = measured == measured ? 0 : missed + 1;
        felt = made < 0 ? 0 : h(heard - (before - TARGET));
        u = -GAIN * (before - TARGET) - (CP[0] * xhat[0] + CP[1] * xhat[1]) / PERIOD;
        dobc_step(&agent, &measured, &output);
        worst = fmaxl(worst, fabsl(output.u[0] - u) / fmaxl(1, fabsl(u)));
        u = output.u[0]; /* what is applied */
        if (LIMIT > 0 && fabsl(u) > LIMIT) { /* an actuator that saturates, and says so */
            const double applied = u > 0 ? LIMIT : -LIMIT;

            u = applied;
            dobc_applied(&agent, &applied);
        }
        for (waiting = DELAY; waiting > 0; waiting--) {
            sent[waiting] = sent[waiting - 1];
        }
        sent[0] = felt + u;
        held = sent[DELAY]; /* what acts up to the next sample */
        /* eps+ = (Ad - W C Gamma) eps, where every sample is measured */
        if (CLEAN) {
            apart = fmaxl(apart, fabsl(xi[0] - agent.estimate[0] - eps[0]));
            apart = fmaxl(apart, fabsl(xi[1] - agent.estimate[1] - eps[1]));
        }
        x += PERIOD * held + CG[0] * xi[0] + CG[1] * xi[1];
        next[0] = AD[0][0] * xi[0] + AD[0][1] * xi[1];
        next[1] = AD[1][0] * xi[0] + AD[1][1] * xi[1];
        xi[0] = next[0];
        xi[1] = next[1];
        felt = CG[0] * eps[0] + CG[1] * eps[1];
        next[0] = AD[0][0] * eps[0] + AD[0][1] * eps[1] - W[0] * felt;
        next[1] = AD[1][0] * eps[0] + AD[1][1] * eps[1] - W[1] * felt;
        eps[0] = next[0];
        eps[1] = next[1];
    }
    printf("%.3Le %.3Le %ld %ld\n", worst, apart, skipped, late);
    return skipped == (long)agent.skipped && late == (long)agent.late ? 0 : 4;
}
"""


def problem(period: str = "1/50", delay: int = 0) -> Problem:
    """Agent 1 of the paper on a processor, whose commands act ``delay`` samples late."""
    return load_problem("paper-fixed").replace(
        processor={"period": period},
        readings={"delay": Fraction(period) * 2, "lost": 2},
        actuators={"delay": Fraction(period) * delay},
    )


def _rows(name: str, values: Any) -> str:
    array = np.atleast_1d(values)
    sizes = "".join(f"[{n}]" for n in array.shape)

    def text(part: Any) -> str:
        if np.ndim(part) == 0:
            return f"{float(part)!r}L"
        return "{" + ", ".join(map(text, part)) + "}"

    return f"static const long double {name}{sizes} = {text(array)};\n"


@dataclass(frozen=True)
class Differences:
    """The largest of u, relative to max(1, |u|), and of the estimation error; bad inputs and late
    ones that both sides counted."""

    u: float
    estimate: float
    skipped: int
    late: int


def differences(
    folder: Path, *, steps: int, seed: int, limit: float = 0.0, clean: bool = False, delay: int = 0
) -> Differences:
    """Compile with sanitizers, and run; ``clean``: every sample is measured; commands act ``delay``
    samples late.  Raises: AssertionError with what the program says."""
    code = to_c(problem(delay=delay), agents=["1"])
    code.save(folder)
    controller = code.controller
    T = float(controller.period)
    Ad = to_float(controller.Ad)
    CG = T * to_float(controller.Cd)
    assert np.allclose(to_float(controller.L), T * W)
    F, added = sampled_error(A, C, W, T)
    assert np.allclose(F, Ad - W @ CG, atol=1e-15)
    assert np.allclose(added, CG, atol=1e-15)
    numbers = f"#define STEPS {steps}L\n#define SEED {seed}ULL\n#define CLEAN {int(clean)}\n"
    numbers += f"#define PERIOD {T!r}L\n#define TARGET 1.0L\n#define GAIN 5.0L\n"
    numbers += f"#define LIMIT {limit!r}\n#define OLDEST {OLDEST}\n"
    numbers += f"#define DELAY {delay}\n" + _rows("CP", CG[0] @ expm(A * T * delay))
    numbers += _rows("AD", Ad) + _rows("CG", CG[0]) + _rows("W", W[:, 0])
    (folder / "numbers.h").write_text(numbers)
    (folder / "driver.c").write_text(DRIVER)
    files = ["dobc_agent.c", "driver.c", "-o", "driver", "-lm"]
    compiled = ["gcc", "-std=gnu99", "-O2", *SANITIZED, *files]
    subprocess.run(compiled, cwd=folder, check=True)
    ran = subprocess.run(["./driver"], cwd=folder, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, (ran.returncode, ran.stdout, ran.stderr)
    u, estimate, skipped, late = ran.stdout.split()
    return Differences(float(u), float(estimate), int(skipped), int(late))
