"""Agents that measure y = H x only: one observer of states and disturbance together (theory,
section 18).

With the pair A = [[A_x, B C], [0, A_xi]], H = [H, 0] and a gain W (m + q, r) of the file, the
estimation errors eps_i = (x_i - xhat_i, xi_i - xihat_i) obey

    eps_i' = F eps_i,    F = A - W H,

because the observer knows what it feels and applies.  Where couplings and pins act on estimated
states, errors are those of the estimates, e_i = xhat_i - goal_i, and W_x, the first rows of W,
takes the residual into them; x = xhat + (first part of eps):

    e_i' = A_x e_i + B (sum_j w h(e_j - e_i) - K e_i) + W_x [H, 0] eps_i.

Where they act on outputs, e_i = x_i - goal_i:

    e_i' = A_x e_i + B (sum_j w h(H (e_j - e_i)) - K H e_i) + B [0, C] eps_i.

Either is a residual E eps_i, so that a loop has the exosystem (F, E) and the gain 0; the pair and
its gain are kept beside for what is said of the observer.
"""

import re

from dobc_design.coupling.tree import variable_names
from dobc_design.errors import wrong
from dobc_design.exact.matrix import Matrix, multiply, subtract, zeros
from dobc_design.exact.number import number_text
from dobc_design.exact.reading import Texts
from dobc_design.problem.dynamics import Dynamics
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.groups import Group, Observer


def sensed(group: Group, dynamics: Dynamics) -> Group:
    """A group with the pair that its observer works with, (m + q, m + q) and (r, m + q)."""
    C = group.exosystem.C
    H = dynamics.H or ()
    q = group.exosystem.order
    m = dynamics.dimension
    above = zip(dynamics.A or (), multiply(dynamics.B, C), strict=True)
    below = zip(zeros(q, m), group.exosystem.A, strict=True)
    A = tuple((*left, *right) for left, right in (*above, *below))
    outputs = tuple((*row, *zeros(1, q)[0]) for row in H)
    return Group(agents=group.agents, exosystem=Exosystem(A=A, C=outputs), observer=group.observer)


def residual(group: Group, dynamics: Dynamics) -> Group:
    """The group as proofs see it: what its observer leaves acts on the states.  Raises: SpecError
    without a gain."""
    pair = sensed(group, dynamics)
    W = group.observer.W
    if W is None:
        what = "is required with dynamics.H: what acts on the agents depends on it."
        cure = "dd.design_observer(problem).W is one; certify and simulate design it themselves."
        raise wrong("observer.W", what, cure)
    A = pair.exosystem.A
    m = dynamics.dimension
    F = subtract(A, multiply(W, pair.exosystem.C))
    if dynamics.acts_on:
        C = multiply(dynamics.B, group.exosystem.C)
        enters = tuple((*zeros(1, m)[0], *row) for row in C)
    else:
        enters = multiply(W[:m], pair.exosystem.C)
    none = zeros(len(A), m)
    observer = Observer(W=none, P=group.observer.P, rate=group.observer.rate)
    return Group(agents=group.agents, exosystem=Exosystem(A=F, C=enters), observer=observer)


def through(H: Matrix, texts: Texts) -> Texts:
    """Expressions of H y, in y1..ym (y for one), in place of those of y1..yr (y for one)."""
    names = variable_names(len(H[0]))
    sums = {}
    for name, row in zip(variable_names(len(H)), H, strict=True):
        parts = [f"({number_text(x)})*{state}" for x, state in zip(row, names, strict=True) if x]
        sums[name] = f"({' + '.join(parts)})"
    return tuple(re.sub(r"\by[0-9]*\b", lambda found: sums[found[0]], text) for text in texts)
