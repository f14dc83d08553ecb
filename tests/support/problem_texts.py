"""Small problem files that several tests change and certify."""

import re

from dobc_design.problem.load import builtin_text

CHAIN = """\
name = "chain"
[network]
agents = 3
arrow = "listens_to"
[network.modes]
G = [[1, 2], [2, 3]]
[coupling]
h = "y"
[pinning]
gains = { 3 = 5 }
"""

_PAIR = """\
name = "listening-pair"
[network]
agents = 2
arrow = "listens_to"
[network.modes]
G = [[1, 2], [2, 1]]
[coupling]
h = "sin(y)"
[pinning]
gains = 0.1
[region]
initial_states = [-REACH, REACH]
"""


def listening_pair_text(reach: int) -> str:
    """Two agents coupled by sines, k = 1/10, from [-reach, reach]; from 5 a second equilibrium is
    among the starts."""
    return _PAIR.replace("REACH", str(reach))


def without_region_text(name: str) -> str:
    """The file of a built-in problem without its [region], whose proof takes seconds."""
    text = builtin_text(name)
    shorter = re.sub(r"^\[region\].*?^\n", "", text, flags=re.MULTILINE | re.DOTALL)
    assert shorter != text
    return shorter


#: ring.toml: three agents in a circle, all pinned, with a region.
RING = """\
name = "ring"
target = 1
[network]
agents = 3
arrow = "listens_to"
[network.modes]
G = [[1, 2], [2, 3], [3, 1]]
[coupling]
h = "exp(y) - 1 + y"
[pinning]
gains = 3
[region]
initial_states = [0, 2]
"""
