"""Slips of users as one list: valid files that mean something else, files that are refused, and
commands.

``tests/test_slips.py`` counts them and shows that none passes without a word; the tests of their
topics hold the words.
"""

from dataclasses import dataclass
from typing import Any

from bad_files import BAD_FILES, SLIPS
from networks import network_of

from dobc_design import Exosystem, Network, Observer, Problem, Switching, exosystems


@dataclass(frozen=True)
class Remarked:
    """A valid problem, ``changes`` of the sound one, about which a remark says ``words``."""

    id: str
    changes: dict[str, Any]
    words: str


TURNING = [[0, 2], [-2, 0]]
SINE = Exosystem(A=TURNING, C=[[1, 0]])
DAMPED = Exosystem(A=[[-1, 2], [-2, -1]], C=[[1, 0]])
UNSEEN = Exosystem(A=TURNING, C=[[0, 0]])
CONSTANT = exosystems.constant()
CHAIN = [(1, 2), (2, 3), (3, 4)]


def heard(arcs: Any, n: int = 4) -> dict[str, Any]:
    return {"network": network_of(arcs, n)}


def region(*states: int, error: Any = "1/2") -> dict[str, Any]:
    return {"initial_states": list(states), "initial_disturbance": error}


SOUND: dict[str, Any] = heard(CHAIN)
SOUND["coupling"] = "tanh(y)"
SOUND["gains"] = {4: 2}
SOUND["target"] = 1
SOUND["exosystem"] = SINE
SOUND["region"] = region(0, 2)


def sound(**changes: Any) -> Problem:
    return Problem(**SOUND | changes)


WIDE = region(-180, 180)
WITH_SHORTCUT = [*CHAIN, (1, 3)]
TWO_MODES = network_of({"a": CHAIN, "b": WITH_SHORTCUT}, 4)
REMARKED: list[Remarked] = []


def slip(name: str, words: str, /, **changes: Any) -> None:
    """With these changes of the sound problem a remark has these words."""
    REMARKED.append(Remarked(name, changes, words))


def disturbed(name: str, words: str, A: Any, *C: Any) -> None:
    slip(name, words, exosystem=Exosystem(A=A, C=C))


def run(name: str, words: str, **simulation: Any) -> None:
    slip(name, words, simulation=simulation)


disturbed("a sign in A", "grows like exp(2 t). A sign missing", [[0, 2], [2, 0]], [1, 0])
TWO_SINES = [[0, 2, 1, 0], [-2, 0, 0, 1], [0, 0, 0, 2], [0, 0, -2, 0]]
disturbed("two equal sines", "grows without limit", TWO_SINES, [1, 0, 0, 0])
slip("a degree too much", "grows without limit", exosystem=exosystems.polynomial(3))
SINE_AND_CONSTANT = [[0, 2, 0], [-2, 0, 0], [0, 0, 0]]
disturbed("C misses a part", "The constant does not appear in d", SINE_AND_CONSTANT, [1, 0, 0])
slip("C is zero", "does not appear in d", exosystem=UNSEEN)
disturbed("what fades", "decays by itself", [[-1]], [1])
slip("nobody pinned", "No agent is pinned", gains={})
TURNED = Network.from_arcs(CHAIN, arrow="sends_to", agents=4)
slip("arrows turned round", "with the other network.arrow", network=TURNED)
# In the cycle everybody is reached both ways round, in the chain one way only.
IN_ONE_MODE = Network.from_arcs({"a": [*CHAIN, (4, 1)], "b": CHAIN}, arrow="sends_to", agents=4)
slip(
    "arrows turned round in one of two modes",
    "In mode b not every agent is reached from a pinned one; with the other network.arrow",
    network=IN_ONE_MODE,
)
slip("a deaf pin", "Agent 1 is pinned, but nobody listens to it", gains={1: 2})
slip("an empty mode", "In mode b nobody listens", **heard({"a": CHAIN, "b": []}))
slip("a mode twice", "Modes a and b have the same arcs", **heard({"a": CHAIN, "b": CHAIN}))
HEAVY = [(1, 2), (2, 3), (3, 4, 5_000_000)]
slip("a weight in another unit", "weights of the arcs differ", **heard(HEAVY))
LARGE = {4: 2, 3: 3_000_000}
slip("a gain in another unit", "gains differ by more than a factor of a million", gains=LARGE)
slip("a sign in h", "repels near 0", coupling="-tanh(y)")
slip("a cube", "vanishes to first order", coupling="y**3")
slip("a logarithm", "is not defined for y <= -1", coupling="log(1 + y)")
slip("a pole", "pushes neighbours apart for |y| > 1.6 (about)", coupling="tan(y)")
slip("a sine too far", "falls, so that agents pull less for |y| > 1.6 (about)", coupling="sin(y)")
slip("degrees", "sin, cos and tan take radians", coupling="sin(y)", region=WIDE)
slip("an even coupling", "pushes neighbours apart for y < 0", coupling="abs(y)")
slip("one side only", "is 0, so that agents do not react for y < 0", coupling="max(y, 0)")
ALLOWED = "over the region; the region allows"
slip("an exponential too far", ALLOWED, coupling="exp(y) - 1", region=WIDE)
LOW = "saturates: it never exceeds 0.1"
slip("a saturation too low", LOW, coupling="tanh(50*y)/10", region=WIDE)
slip("a target outside", "The target 5 is outside region.initial_states [0, 2]", target=5)
slip("one start only", "single point 1", region=region(1, 1, error=1))
slip("an offset outside", "The goal (target + offset) of 2 is outside", offsets={2: 7})
slip("no error allowed", "only if every observer starts", region=region(0, 2, error=0))
slip("a sign in W", "estimation error does not decay", observer=Observer(W=[[-3], [1]]))
run("a start outside", "simulation.x0 is outside", x0=[9])
run("a run at rest", "the simulated runs have no disturbance", xi0=[0, 0])
LONG = Switching(signal="random", dwell=50)
LONGER = "switching.dwell = 50 s is longer"
slip("one mode for ever", LONGER, switching=LONG, simulation={"t_final": 20})
FADING = exosystems.stacked(CONSTANT, DAMPED)
slip("a damped sine", "decays by itself: sine of 2 rad/s", exosystem=FADING)
PLANE = Exosystem(A=TURNING, C=[[1, 0], [0, 0]])
slip("a row of zeros in C", "acts on state component 2", exosystem=PLANE, target=[1, 1])
slip("an agent too many", "without any arc: 5", **heard(CHAIN, 5))
slip("two chains", "No path of arcs leads from a pinned agent to 1, 2", **heard([(1, 2), (3, 4)]))
slip("an offset forgotten", "2, 3 have the same goal", offsets={2: "1/2", 3: "1/2"})
FAR = region(0, 2, error=5000)
slip("an error in another unit", "initial_disturbance = 5000 and the width 2", region=FAR)
run("a disturbance larger than asked", "simulation.xi0 has length 5, more than", xi0=[3, 4])
INDEFINITE = Observer(W=[[3], [1]], P=[[1, 2], [2, 1]])
slip("a sign in P", "P is not positive definite", observer=INDEFINITE)
GIVEN_TWICE = Observer(W=[[3], [1]], rate=2)
slip("a rate beside W", "observer.rate has no effect", observer=GIVEN_TWICE)
FAST = Observer(W=[[40001], [19998]])
FASTER = "The observer (2.5e-05 s) is more than 1000 times faster"
slip("one pole of W too fast", FASTER, observer=FAST)
slip("rad per ms", "Hz, or rad per ms, in place of rad/s?", exosystem=exosystems.harmonics(31416))
slip("Hz for rad/s", "needs 628 s for a period", exosystem=exosystems.harmonics("0.01"))
slip("a gain in micro", "Is a gain, a rate or a frequency in another unit?", gains={4: "1/1000000"})
run("a run too short", "is shorter than the slowest time constant, 1 s", t_final="1/10")
run("a run too long", "more than 10000 times the slowest time constant", t_final=100_000)
QUIET: dict[str, Any] = {"exosystem": None, "region": None}
slip("nothing happens", "in the runs nothing happens", **QUIET, simulation={"x0": [1]})
SHORT = Switching(signal="random", dwell="1/100000")
slip("a dwell time in ms", "far below every time scale", switching=SHORT)
slip("switching alone", "There is one mode only", switching=Switching(signal="random", dwell=1))
ONE_OF_TWO = Switching(signal="periodic", dwell=1, sequence=["a"])
slip("a mode left out", "never makes b active", network=TWO_MODES, switching=ONE_OF_TWO)
STOPPING = Switching(signal="markov", generator=[[-1, 1], [0, 0]])
slip("a chain that stops", "never leaves b", network=TWO_MODES, switching=STOPPING)

#: A command, the option that is refused, and the cure.
TYPED = [
    ("export paper-fixed --c code --period 20ms", "--period", "Write 0.02, without the unit"),
    ("simulate paper-fixed --t-final 10s", "--t-final", "Write 10, without the unit"),
    ("simulate paper-fixed --t-final 2,5", "--t-final", "Write 2.5."),
    ("stress paper-fixed --loss 5%", "--loss", "Write 0.05."),
    ("certify paper-fixed --time-limit 1min", "--time-limit", "Write 60, without the unit"),
]

#: Among the files with one mistake those that a hasty user writes, not an attacker.
_HASTY = [
    "unknown-top",
    "unknown-network",
    "unknown-exception",
    "unknown-exosystem",
    "unknown-table",
    "duplicate-key",
    "labels-twice",
    "arc-twice",
    "arc-unknown-agent",
    "expression-caret",
    "expression-does-not-vanish",
    "gain-negative",
    "period-and-dwell",
    "number-leading-zero",
    "A-not-square",
]
REFUSED = [*SLIPS, *(case for case in BAD_FILES if case.id in _HASTY)]
