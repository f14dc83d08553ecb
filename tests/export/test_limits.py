"""Limits of actuators in exported C code: u is cut off there, the observer knows it, the samples
are counted."""

import subprocess
from functools import cache

import numpy as np
import pytest
from c_code import STRICT, CompiledAgents, compile_and_test, needs_gcc, planar, write_all

import dobc_design as dd
from dobc_design.errors import SpecError
from dobc_design.problem.load import load_problem

pytestmark = pytest.mark.usefixtures("recorded_briefly")

#: Agents at x = goal + 1 with k = 5 and no observer: u is -5, twice, then 0.  Counts follow.
COUNT = r"""
#include <stdio.h>
#include "dobc_agent.h"

int main(void)
{
    dobc_agent agent;
    dobc_output output;
    dobc_real x[DOBC_COMPONENTS];
    int i, k;

    for (i = 0; i < DOBC_AGENTS; i++) {
        dobc_init(&agent, &dobc_agents[i]);
        for (k = 0; k < 3; k++) {
            x[0] = k < 2 ? 2.0 : 1.0;
            dobc_step(&agent, x, &output);
            printf("%g ", (double)output.u[0]);
        }
        printf("%lu %lu\n", agent.limited, agent.skipped);
    }
    return 0;
}
"""


def exported(problem: dd.Problem, precision: str = "double") -> dict[str, bytes]:
    code = dd.export.to_c(problem, period="1/50", precision=precision)
    return dict(code.files)


@cache
def plain_files() -> dict[str, bytes]:
    return exported(load_problem("paper-fixed"))


@pytest.mark.parametrize("limit", [None, {}])
def test_without_limits_the_files_are_as_they_were(limit: object):
    plain = load_problem("paper-fixed")
    table = {"limit": limit, "amplitude": 1}
    changed = plain.replace(actuators=table)
    assert exported(changed) == plain_files()


def test_a_limit_beyond_all_doubles_is_refused():
    with pytest.raises(SpecError, match="every number of the code must fit into a double"):
        exported(load_problem("paper-fixed").replace(actuators={"limit": "1e400"}))


@needs_gcc
def test_a_larger_input_is_cut_off_and_counted_and_one_at_the_limit_is_not(tmp_path):
    """Agents 1 and 2, with the same gain."""
    arcs = [[2, 1]]
    limits_table = {"limit": {"1": "4.99", "2": "5"}}
    network = dd.Network.from_arcs(arcs, arrow="listens_to", agents=2)
    limits = limits_table
    problem = dd.Problem(network=network, coupling="y", target=1, gains=5, actuators=limits)
    write_all(exported(problem), tmp_path)
    (tmp_path / "main.c").write_text(COUNT)
    command = ["gcc", *STRICT, "dobc_agent.c", "main.c", "-o", "count", "-lm"]
    done = subprocess.run(
        command, cwd=tmp_path, capture_output=True, check=False, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    counted = subprocess.run(
        ["./count"], cwd=tmp_path, capture_output=True, check=True, text=True, timeout=60
    )
    assert counted.stdout.splitlines() == ["-4.99 -4.99 -0 2 0", "-5 -5 -0 0 0"]


@pytest.mark.slow
@needs_gcc
@pytest.mark.parametrize("precision", ["double", "float"])
def test_the_loop_is_that_of_code_without_limits_whose_inputs_are_cut_off_outside(
    precision: str, tmp_path
):
    """The oracle cuts u off itself and tells the observer by dobc_applied; two components, matrix
    gains, two modes."""
    problem = planar()
    limit = 1.5
    rng = np.random.default_rng(7)
    inside_case = ("inside", problem.replace(actuators={"limit": "3/2"}))
    agents = [
        CompiledAgents(exported(each, precision), tmp_path / name, n=problem.n, m=problem.m)
        for name, each in (
            inside_case,
            ("outside", problem),
        )
    ]
    largest = 0.0
    for k in range(200):
        shape = (problem.n, problem.m)
        noise = rng.normal(size=shape) * 0.98**k
        x = np.array(problem.target, dtype=float) + noise
        both = zip(agents, (0.0, limit), strict=True)
        (inside, outside) = (each(k // 50 % 2, x, limit=own) for each, own in both)
        for one, other in zip(inside, outside, strict=True):
            np.testing.assert_array_equal(one, other)
        largest = max(largest, np.abs(inside[0]).max())
    assert largest == limit


@pytest.mark.slow
@needs_gcc
@pytest.mark.parametrize("precision", ["double", "float"])
@pytest.mark.parametrize("limit", ["5", {"1": "5", "6": "8"}])
def test_the_test_vectors_are_those_of_the_limited_loop_and_the_files_name_the_limit(
    limit, precision: str, tmp_path
):
    limited = load_problem("paper-fixed").replace(actuators={"limit": limit})
    files = exported(limited, precision)
    done = compile_and_test(write_all(files, tmp_path))
    assert done.returncode == 0, done.stdout
    table = np.loadtxt(tmp_path / "vectors.csv", delimiter=",", skiprows=1)
    u = table[:, -3]
    assert np.abs(u).max() == 5
    named = "5." if limit == "5" else "5 (agent 1), 8 (agent 6)."
    assert f"of every component of u: {named}" in files["dobc_agent.h"].decode()
    assert "  - 5" in files["README.txt"].decode()
