"""Exported C code compiled and driven from Python: all agents in one library, the plant integrated
exactly outside."""

import ctypes
import os
import shutil
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from networks import linked

from dobc_design import Exosystem, Observer, Problem

_WARNINGS = (
    "-std=c99 -O2 -Wall -Wextra -Werror -pedantic -Wshadow -Wconversion -Wdouble-promotion "
    "-Wstrict-prototypes"
    " -Wmissing-prototypes"
)
STRICT = _WARNINGS.split(" ")
SANITIZED = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
needs_gcc = pytest.mark.skipif(
    shutil.which("gcc") is None, reason="gcc is not installed (Debian: apt install gcc)"
)

HARNESS = r"""
#include <string.h>
#include "dobc_agent.h"

static dobc_agent agents[DOBC_AGENTS];

void start(void);
void settle(int mode, const double *x, const unsigned char *arrived, double limit, double *u,
double *v, double *dhat);
unsigned long skipped(int agent);

void start(void)
{
    int i;
    for (i = 0; i < DOBC_AGENTS; i++) {
        dobc_init(&agents[i], &dobc_agents[i]);
    }
}

unsigned long skipped(int agent)
{
    return agents[agent].skipped;
}

static int find(const char *label)
{
    int i;
    for (i = 0; i < DOBC_AGENTS; i++) {
        if (strcmp(dobc_agents[i].label, label) == 0) {
            return i;
        }
    }
    return -1;
}

/* arrived[i * DOBC_AGENTS + j]: whether i gets the packet of j now; limit: bound on the components
   of u. */
void settle(int mode, const double *x, const unsigned char *arrived, double limit, double *u,
double *v, double *dhat)
{
    dobc_real own[DOBC_AGENTS][DOBC_MEASURED], y[DOBC_AGENTS][DOBC_PACKET];
    dobc_output output;
    int i, j, c;

    for (i = 0; i < DOBC_AGENTS; i++) {
        for (c = 0; c < DOBC_MEASURED; c++) {
            own[i][c] = (dobc_real)x[i * DOBC_MEASURED + c];
        }
        dobc_packet(&agents[i], own[i], y[i]);
    }
    for (i = 0; i < DOBC_AGENTS; i++) {
        dobc_real applied[DOBC_INPUTS];
        dobc_set_mode(&agents[i], mode);
        for (j = 0; j < dobc_agents[i].neighbour_count; j++) {
            int speaker = find(dobc_agents[i].neighbours[j]);
            if (arrived[i * DOBC_AGENTS + speaker]) {
                dobc_receive(&agents[i], j, y[speaker]);
            }
        }
        dobc_step(&agents[i], own[i], &output);
        for (c = 0; c < DOBC_INPUTS; c++) {
            applied[c] = output.u[c];
            if (limit > 0) {
                applied[c] = applied[c] > (dobc_real)limit ? (dobc_real)limit : applied[c];
                applied[c] = applied[c] < (dobc_real)-limit ? (dobc_real)-limit : applied[c];
            }
            u[i * DOBC_INPUTS + c] = (double)applied[c];
            v[i * DOBC_INPUTS + c] = (double)(output.felt[c] + applied[c]);
            dhat[i * DOBC_INPUTS + c] = (double)output.dhat[c];
        }
        dobc_applied(&agents[i], applied);
    }
}
"""


SMOOTH = "exp(y1) + log(y2**2 + 2) + sin(y1)*cos(y1) + atan(y2) + cosh(y1) + asinh(y2)"
EVERY = f"2*tanh(y1) + min(y2, 0, y1) + y2/3 + 0*({SMOOTH})"
OTHER = (
    "y2**3 + clip(y2, -1, 1) - y1/3 - abs(0.25*y1) + sqrt(4 + y1**2) - 2 + max(y1, y2)*0 + "
    "tan(y1/9) - sinh(0*y1)"
)


def planar() -> Problem:
    """m = 2, q = 3, every function of the grammar, matrix gains, a formation, two modes, names that
    need care."""
    first = [["a.b", "c??/"], ["c??/", 'd"\\', 2], ['d"\\', "a.b"]]
    mode_two = [["a.b", 'd"\\'], ["c??/", "a.b"]]
    modes = {'mode "one" */': first, "two' \\": mode_two}
    offsets = {"c??/": [1, 0]}
    given: dict[str, Any] = {"target": [1, -2], "offsets": offsets}
    gain = [[2, 1], [-1, 2]]
    given["gains"] = {"a.b": 3, 'd"\\': gain}
    given["exceptions"] = {(0, 1): ["y1", "2*y2"]}
    A = [[0, 1, 0], [-1, 0, 0], [0, 0, 0]]
    C = [[1, 0, 1], [0, 1, 0]]
    given["exosystem"] = Exosystem(A=A, C=C)
    W = [[2, 0], [0, 2], [1, 0]]
    given["observer"] = Observer(W=W)
    given["name"] = 'trouble */ *\\ """ here ???/ \\'
    starts = [[1, 0, 2], [0, 1, -1], [3, 0, 0]]
    given["simulation"] = {"t_final": 4, "seed": 3, "xi0": starts}
    return linked(modes, None, [EVERY, OTHER], **given)


def write_all(files: Mapping[str, bytes], folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for name, data in files.items():
        (folder / name).write_bytes(data)
    return folder


def compile_and_test(
    folder: Path, *, library: bool = True, level: str = "-O0"
) -> subprocess.CompletedProcess[str]:
    """Compile the folder of an export under strict warnings and run its self-test, all accesses
    watched."""
    options = [*STRICT, level, *SANITIZED]
    command = [
        "gcc",
        *options,
        "dobc_agent.c",
        "main.c",
        "-o",
        "selftest",
        *(["-lm"] if library else []),
    ]
    done = subprocess.run(
        command, cwd=folder, capture_output=True, check=False, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    # looking for leaks needs ptrace, and there is no heap
    quiet = os.environ | {"ASAN_OPTIONS": "detect_leaks=0"}
    how = {"cwd": folder, "capture_output": True, "text": True, "timeout": 60, "env": quiet}
    return subprocess.run(["./selftest"], check=False, **how)


class CompiledAgents:
    """All agents of an export behind one call a sample."""

    def __init__(
        self, files: Mapping[str, bytes], folder: Path, *, n: int, m: int, p: int | None = None
    ) -> None:
        write_all(files, folder)
        (folder / "harness.c").write_text(HARNESS)
        command = [
            "gcc",
            *STRICT,
            "-shared",
            "-fPIC",
            "dobc_agent.c",
            "harness.c",
            "-o",
            "agents.so",
            "-lm",
        ]
        done = subprocess.run(
            command, cwd=folder, capture_output=True, check=False, text=True, timeout=120
        )
        assert done.returncode == 0, done.stderr
        self.library = ctypes.CDLL(str(folder / "agents.so"))
        self.n = n
        self.p = p or m
        self.library.start()

    def __call__(
        self, mode: int, x: np.ndarray, *, arrived: np.ndarray | None = None, limit: float = 0.0
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """u, v and dhat (n, p) for what is measured, x (n, m) or outputs (n, r)."""
        if arrived is None:
            flags = np.ones((self.n, self.n), dtype=np.uint8)
        else:
            flags = arrived.astype(np.uint8)
        out = []
        for _ in range(3):
            out.append(np.zeros((self.n, self.p)))
        double = ctypes.POINTER(ctypes.c_double)
        given = np.ascontiguousarray(x, dtype=float)
        values = given.ctypes.data_as(double)
        pointer = ctypes.POINTER(ctypes.c_ubyte)
        taken = flags.ctypes.data_as(pointer)
        self.library.settle(
            ctypes.c_int(mode),
            values,
            taken,
            ctypes.c_double(limit),
            *(each.ctypes.data_as(double) for each in out),
        )
        return out[0], out[1], out[2]
