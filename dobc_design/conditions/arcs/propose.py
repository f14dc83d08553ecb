"""Proposes d and the shares of arcs: a linear program whose rows are directions (theory, section
20).

In a and b all conditions are linear for fixed d.  Each direction of an arc is a row; those that the
last answer violates are added until none is.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import csr_matrix

from dobc_design.conditions.separable.large import gain_table
from dobc_design.loop.arcs import coupling_places
from dobc_design.loop.loop import Loop

DIRECTIONS = 800
FIRST = 24
ROUNDS = 40
