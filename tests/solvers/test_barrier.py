"""The barrier: derivatives by finite differences, optima in closed form."""

import numpy as np
import pytest
from regional_problems import cycle, random_problem
from scipy import linalg

from dobc_design.conditions.quadratic.propose_program import (
    centring,
    covering,
    float_system,
    make_templates,
    sample_gains,
)
from dobc_design.loop.make import loop_of
from dobc_design.solvers.barrier import Block, Inequalities, centre, make_basis, minimise

SHAPES = ("diagonal", "full")


def programs(shape: str) -> list[tuple[Inequalities, np.ndarray]]:
    """The three kinds of program, with a point inside each: three agents, four arcs, an observer's
    border."""
    problem = random_problem(3, coupling="y + y**3/10")
    gains = sample_gains(loop_of(problem), 0.5)
    templates = make_templates(loop_of(problem))
    S = np.array([[0.3]])
    loop = float_system(templates, gains, radius=0.5, S=S, rate=0.01)
    basis = make_basis(loop.size, shape)
    plain = centring(loop, basis)
    shifted = centring(loop, basis, shift=True)
    wide = covering(loop, basis, disturbance=0.01, condition=100.0)
    Y = 0.02 * np.eye(loop.size)
    t = [0.3] * loop.multipliers
    # theta makes the first two feasible whatever the numbers are; the third is checked where it
    # happens to be.
    by_plain = (plain, [0.02])
    by_shifted = (shifted, [0.02, 5.0])
    by_wide = (wide, [0.02, 0.01, 0.001, 0.9])
    tails = [by_plain, by_shifted, by_wide]
    found = []
    for program, tail in tails:
        point = program.join(Y, [*t, *tail])
        if program.holds(point):
            found.append((program, point))
    return found


@pytest.mark.parametrize("shape", SHAPES)
def test_gradient_and_hessian_are_the_differences_of_the_barrier(shape):
    found = programs(shape)
    assert found
    for program, point in found:
        gradient, hessian = program.derivatives(point)
        step = 1e-6 * np.eye(len(point))
        slopes = []
        curves = []
        for e in step:
            ahead = program.barrier(point + e)
            change = ahead - program.barrier(point - e)
            slopes.append(change / 2e-6)
            after = program.derivatives(point + e)[0]
            before = program.derivatives(point - e)[0]
            curves.append((after - before) / 2e-6)
        allowed_gradient = 1e-6 * np.max(np.abs(gradient))
        assert np.allclose(gradient, slopes, atol=allowed_gradient)
        allowed_hessian = 1e-6 * np.max(np.abs(hessian))
        assert np.allclose(hessian, curves, atol=allowed_hessian)


@pytest.mark.parametrize("shape", SHAPES)
def test_the_centre_of_a_box_of_matrices_is_its_middle(shape):
    """0 < Y < I: the centre is I/2."""
    basis = make_basis(3, shape)
    below = Block(constant=np.eye(3), plain=-1.0)
    above = Block(constant=np.zeros((3, 3)), plain=1.0)
    program = Inequalities(basis=basis, blocks=(below, above), count=0)
    start_matrix = 0.1 * np.eye(3)
    start = program.join(start_matrix, [])
    found = centre(program, start)
    centre_found = program.split(found)[0]
    half = np.eye(3) / 2
    assert np.allclose(centre_found, half, atol=1e-2)


def test_the_smallest_trace_above_a_matrix_is_its_own():
    """Minimise tr Y subject to Y > M: Y = M."""
    M = np.array([[2.0, 1.0], [1.0, 3.0]])
    basis = make_basis(2, "full")
    block = Block(constant=-M, plain=1.0)
    program = Inequalities(basis=basis, blocks=(block,), count=0)
    cost = basis.traces(np.eye(2))
    start_matrix = 9 * np.eye(2)
    start = program.join(start_matrix, [])
    found = minimise(program, start, cost, accuracy=1e-7)
    assert np.allclose(program.split(found)[0], M, atol=1e-5)


def test_hopeless_programs_are_left_early():
    """The smallest theta with theta I > M is 3; whoever needs it below 1 can stop."""
    basis = make_basis(1, "full")
    constant = -np.diag([1.0, 3.0])
    dense = {0: np.eye(2)}
    block = Block(constant=constant, dense=dense)
    program = Inequalities(basis=basis, blocks=(block,), count=1)
    start = np.array([0.0, 50.0])
    cost = np.array([0.0, 1.0])
    early = minimise(program, start, cost, hopeless=1.0)
    late = minimise(program, start, cost, accuracy=1e-6)
    assert late[1] == pytest.approx(3, abs=1e-4)
    assert early[1] > late[1] + 1e-3


def test_a_lyapunov_equation_lies_inside_without_channels():
    """Linear couplings: the program is A Y + Y A' < 0, which the Lyapunov equation solves."""
    problem = cycle(4, {1: 2}, coupling="2*y")
    gains = sample_gains(loop_of(problem), 1.0)
    templates = make_templates(loop_of(problem))
    loop = float_system(templates, gains, radius=None, S=None, rate=0.0)
    program = centring(loop, make_basis(4, "full"))
    A = loop.modes[0].A
    right = -np.eye(4)
    Y = linalg.solve_continuous_lyapunov(A, right)
    size = np.linalg.norm(Y, 2)
    start = Y / (2 * size)
    assert program.holds(program.join(start, []))
    assert not program.holds(program.join(-Y, []))
