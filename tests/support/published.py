"""Problems from the literature, what was published about them, and what is to be found."""

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from agents import second_order
from networks import network_of

from dobc_design import Dynamics, Network, Observer, Problem, Switching, exosystems, load_problem

CYCLE10 = 1.399166
PENDULUM = Dynamics(f=["x2", "-sin(x1) - x2/2"], B=[[0], [1]])
CUBIC_CHUA = Dynamics(f=["10*(x2 - (2*x1**3 - x1)/7)", "x1 - x2 + x3", "-100/7*x2"])
LORENZ = Dynamics(f=["10*(x2 - x1)", "28*x1 - x2 - x1*x3", "x1*x2 - 8/3*x3"])
DAMPED = Dynamics(A=[[0, 1], [0, -1]], B=[[0], [1]])
#: The three generators of MATPOWER's case9: K_ij/M_i in 1/s^2 and the angles in rad, x_d' = 0.0608,
#: 0.1198, 0.1813 and H = 23.64, 6.4, 3.01 s (P. M. Anderson and A. A. Fouad), loads as impedances,
#: transfer conductances left out.
IEEE9_WEIGHTS = {
    (1, 2): "12.5",
    (1, 3): "9.84",
    (2, 1): "46.18",
    (2, 3): "33.01",
    (3, 1): "77.28",
    (3, 2): "70.2",
}
IEEE9_ANGLES = (0.0431, 0.3584, 0.2372)


@dataclass(frozen=True)
class Published:
    """A problem, what was published, and the verdict that is to be found."""

    name: str
    published: str
    build: Callable[[], Problem]
    verdict: str = "proved"


def ring(n: int) -> Network:
    agents = range(1, n + 1)
    arcs = [[i, i % n + 1] for i in agents]
    return network_of(arcs, n)


def swing9(reach: str, speed: str) -> Problem:
    """IEEE 9 buses about its operating point, generator 1 controlled; damping 1/s is assumed."""
    arcs = [[i, j, w] for (i, j), w in IEEE9_WEIGHTS.items()]
    network = network_of(arcs, 3)
    texts = {}
    for i, j in IEEE9_WEIGHTS:
        x = IEEE9_ANGLES[j - 1] - IEEE9_ANGLES[i - 1]
        texts[i - 1, j - 1] = f"{math.cos(x):.4f}*sin(y1) + ({math.sin(x):.4f})*(cos(y1) - 1)"
    states = [[f"-{reach}", reach], [f"-{speed}", speed]]
    gains = {1: [[10, 5]]}
    given: dict[str, Any] = {
        "exceptions": texts,
        "gains": gains,
        "region": {"initial_states": states},
    }
    return Problem(network=network, coupling="sin(y1)", dynamics=DAMPED, target=[0, 0], **given)


def oscillators(*, reached: bool) -> Problem:
    """x'' = -x + sum (v_j - v_i), a path that hears a leader at one end; or the same with the last
    agent left out."""
    arcs = []
    for i in range(1, 5 if reached else 4):
        arcs.append([i + 1, i])
    network = network_of(arcs, 5)
    A = [[0, 1], [-1, 0]]
    B = [[0], [1]]
    dynamics = Dynamics(A=A, B=B)
    return Problem(network=network, coupling="y2", gains={1: 1}, dynamics=dynamics, target=[0, 0])


def nodes(dynamics: Dynamics, gain: Any, reach: str, **given: Any) -> Problem:
    """A ring of three whose agents all are pinned."""
    states = {"initial_states": [f"-{reach}", reach]}
    target = [0] * dynamics.dimension
    parts = {"coupling": "20*y", "gains": gain, "region": states, "target": target} | given
    return Problem(network=ring(3), dynamics=dynamics, **parts)


def kuramoto(reach: str) -> Problem:
    """theta_i' = omega_i + 3 sum sin(theta_j - theta_i) + u_i: omega_i is a constant that nobody
    knows."""
    region = {"initial_states": [f"-{reach}", reach], "initial_disturbance": "1/10"}
    observed = {"exosystem": exosystems.constant(), "observer": Observer(rate=2), "region": region}
    gains = {1: 2, 4: 2}
    return Problem(network=ring(6), coupling="3*sin(y)", gains=gains, **observed)


def jointly_connected() -> Problem:
    """Four agents, two graphs of which neither is connected, in turn for 1 s each."""
    odd = [[1, 2], [2, 1], [3, 4], [4, 3]]
    even = [[2, 3], [3, 2]]
    modes = {"odd": odd, "even": even}
    network = network_of(modes, 4)
    switching = Switching(guarantee="sequence", sequence=["odd", "even"], dwell=1)
    return Problem(network=network, coupling="y", gains={1: 1}, switching=switching)


def path_between_leaders() -> Problem:
    """Three agents on a path between two leaders, one of which moves."""
    arcs = [[1, "a"], [1, 2], [2, 1], [2, 3], [3, 2], [3, "b"]]
    network = Network.from_arcs(arcs, arrow="listens_to", fixed=("a", "b"))
    fixed = {"a": 0, "b": {"between": [3, 4]}}
    return Problem(network=network, coupling="y", goal="containment", fixed=fixed)


def leaders_in_turn() -> Problem:
    """Three agents; the first always hears both leaders, the third the second for 1 s, then this
    one the first for 1 s."""
    always = [[1, "a", "1/2"], [1, "b", "1/2"]]
    modes = {"A": [*always, [3, 2]], "B": [*always, [2, 1]]}
    network = Network.from_arcs(modes, arrow="listens_to", fixed=("a", "b"))
    fixed = {"a": 0, "b": {"between": [3, 5]}}
    turns = Switching(guarantee="sequence", sequence=["A", "B"], dwell=1)
    return Problem(network=network, coupling="y", goal="containment", fixed=fixed, switching=turns)


def saturating() -> Problem:
    """Seven agents with constant disturbances and inputs that saturate: |d| and |C eps| take 1/2
    each of the limit 2, so that 1 is left; from |e| <= 4 nothing is faster than min(2, 1/4)."""
    return Problem(
        network=ring(7),
        coupling="exp(y) - 1 + y",
        gains=2,
        exosystem=exosystems.constant(),
        observer=Observer(W=[[2]]),
        actuators={"limit": 2, "amplitude": "1/2", "saturates": True},
        region={"initial_states": [-4, 4], "initial_disturbance": "1/2"},
    )


#: The influences that Friedkin and Johnsen measured in a group of four, and its first opinions.
INFLUENCES = ((220, 120, 360, 300), (147, 215, 344, 294), (0, 0, 1000, 0), (90, 178, 446, 286))
FIRST = (25, 25, 75, 85)


def opinions() -> Problem:
    """Each agent is drawn to others by w_ij (1 - w_ii), and to its own first opinion, which is a
    fixed node, by w_ii."""
    arcs: list[list[Any]] = []
    for i, row in enumerate(INFLUENCES):
        own = Fraction(row[i], 1000)
        arcs.append([i + 1, f"first {i + 1}", own])
        for j, w in enumerate(row):
            if j != i and w and own < 1:
                arcs.append([i + 1, j + 1, (1 - own) * Fraction(w, 1000)])
    fixed = {f"first {i + 1}": x for i, x in enumerate(FIRST)}
    network = Network.from_arcs(arcs, arrow="listens_to", agents=4, fixed=tuple(fixed))
    return Problem(network=network, coupling="y", goal="containment", fixed=fixed)


def signed_ring(balanced: bool, coupling: str = "y", **more: Any) -> Problem:
    """Four agents in a ring, each with its two neighbours; one pair, or two, of antagonists."""
    signs = (1, -1, 1, -1) if balanced else (1, -1, 1, 1)
    arcs: list[list[Any]] = []
    for i, w in enumerate(signs):
        other = (i + 1) % 4
        arcs += [[i + 1, other + 1, w], [other + 1, i + 1, w]]
    network = Network.from_arcs(arcs, arrow="listens_to", agents=4, negative="opposes")
    return Problem(network=network, coupling=coupling, goal="agreement", **more)


def curved_ring() -> Problem:
    """The ring with one pair of antagonists, couplings that rise, and a region."""
    return signed_ring(False, "tanh(y)", region={"initial_states": [-2, 2]})


def both_ways(arcs: list[list[Any]]) -> list[list[Any]]:
    return arcs + [[j, i, *w] for i, j, *w in arcs]


def average() -> Problem:
    """Ten agents on an undirected ring."""
    arcs = both_ways([[i, i % 10 + 1] for i in range(1, 11)])
    region = {"initial_states": [0, 1]}
    return Problem(network=network_of(arcs, 10), coupling="y", goal="agreement", region=region)


def followers(**given: Any) -> Problem:
    """Ten agents on an undirected ring, each of which hears the target as well: the largest
    eigenvalue of L + I is 5."""
    arcs = both_ways([[i, i % 10 + 1] for i in range(1, 11)])
    return Problem(network=network_of(arcs, 10), coupling="y", gains=1, **given)


def in_steps() -> Problem:
    """Three agents that take means of what they and others were two steps ago, one of them of a
    leader's state as well."""
    arcs = [[1, 2, "1/2"], [2, 1, "1/4"], [2, 3, "1/4"], [3, 2, "1/2"]]
    network = network_of(arcs, 3)
    return Problem(
        network=network, coupling="y", gains={"1": "1/4"}, time="discrete", readings={"delay": 2}
    )


def jointly_rooted() -> Problem:
    """Four agents, three graphs of one arc each in turn for 1 s: together a chain from agent 1."""
    modes = {"a": [[2, 1]], "b": [[3, 2]], "c": [[4, 3]]}
    switching = Switching(guarantee="sequence", sequence=["a", "b", "c"], dwell=1)
    network = network_of(modes, 4)
    return Problem(network=network, coupling="y", goal="agreement", switching=switching)


def leaderless() -> Problem:
    """Five double integrators on a directed ring, each with a constant disturbance at its input."""
    return Problem(
        network=ring(5),
        coupling="y1 + 2*y2",
        goal="agreement",
        dynamics=Dynamics(A=[[0, 1], [0, 0]], B=[[0], [1]]),
        exosystem=exosystems.constant(),
        observer=Observer(rate=2),
    )


def clocks() -> Problem:
    """Four clocks on a path, of which nobody is the master, with unknown skews."""
    arcs = both_ways([[1, 2], [2, 3], [3, 4]])
    region = {"initial_states": [-1, 1], "initial_disturbance": "1/10"}
    observed = {"exosystem": exosystems.constant(), "observer": Observer(W=[[2]]), "region": region}
    return Problem(network=network_of(arcs, 4), coupling="y", goal="agreement", **observed)


def sharing() -> Problem:
    """Loads of three converters in parts of their ratings 1, 2, 3: c_i x_i' = sum (x_j - x_i)."""
    arcs = [[i, j, Fraction(1, i)] for i in (1, 2, 3) for j in (1, 2, 3) if i != j]
    region = {"initial_states": [0, 1]}
    return Problem(network=network_of(arcs, 3), coupling="y", goal="agreement", region=region)


def headings() -> Problem:
    """Five headings within 1.4 rad, less than half a turn; all hear each other."""
    arcs = [[i, j] for i in range(1, 6) for j in range(1, 6) if i != j]
    region = {"initial_states": ["-0.7", "0.7"]}
    return Problem(network=network_of(arcs, 5), coupling="sin(y)", goal="agreement", region=region)


def banded(low: Any, high: Any, amplitude: Any) -> dict[str, Any]:
    """A sine of a frequency in a band, rad/s."""
    return {"bands": [[low, high, amplitude]]}


def humming() -> Problem:
    """Four agents in a chain, mains of 50 Hz within 0.2 Hz, amplitude 1.  A has 50 Hz, and A - W C
    both poles at -100 pi: (50^2 - 49.8^2)/(49.8^2 + 50^2) of the hum is left, for each agent."""
    hertz = Fraction("6.28318530718")
    mains = exosystems.harmonics([50 * hertz])
    return Problem(
        network=network_of([[2, 1], [3, 2], [4, 3]], 4),
        coupling="y",
        gains={1: 1},
        exosystem=mains,
        observer=Observer(W=[[100 * hertz], [0]]),
        uncertainty=banded(Fraction("49.8") * hertz, Fraction("50.2") * hertz, 1),
    )


def second_order_sines(exosystem: Any, band: dict[str, Any]) -> Problem:
    """Three double integrators in a ring, one of them pinned."""
    return Problem(
        network=network_of([[2, 1], [3, 2], [1, 3]], 3),
        coupling="y1 + 2*y2",
        gains={1: [[1, 2]]},
        target=[0, 0],
        dynamics=Dynamics(A=[[0, 1], [0, 0]], B=[[0], [1]]),
        exosystem=exosystem,
        uncertainty=band,
    )


def position_alone(arcs: list[list[int]], n: int, observer: Observer | None) -> Problem:
    """Double integrators with y = x1 and a force of 2 rad/s; agent 1 is pinned."""
    return Problem(
        network=network_of(arcs, n),
        coupling="2*y1 + 3*y2",
        gains={1: [[4, 4]]},
        target=[0, 0],
        dynamics=Dynamics(A=[[0, 1], [0, 0]], B=[[0], [1]], H=[[1, 0]]),
        exosystem=exosystems.harmonics([2]),
        observer=observer,
    )


def motors(A: Any, B: Any, H: Any, coupling: str) -> Problem:
    """DC motors of which H is measured, in a ring, one of them pinned; their supplies are off."""
    return Problem(
        network=network_of([[2, 1], [3, 2], [1, 3]], 3),
        coupling=coupling,
        gains={1: 1},
        target=[0] * len(A),
        dynamics=Dynamics(A=A, B=B, H=H),
        exosystem=exosystems.constant(),
    )


def _published() -> Iterator[Published]:
    # Yu, Chen and Cao, Automatica 46 (2010)
    yield Published(
        "second order, directed 10-cycle, 1 % above the threshold",
        "stable iff b^2/a > 1.3992",
        lambda: second_order({1: 3}, 2, 1.01 * CYCLE10),
    )
    yield Published(
        "the same, 1 % below",
        "unstable",
        lambda: second_order({1: 3}, 2, 0.99 * CYCLE10),
        "refuted",
    )
    # Ren, Automatica 44 (2008)
    yield Published(
        "coupled harmonic oscillators, a path",
        "agree iff the leader reaches all",
        lambda: oscillators(reached=True),
    )
    yield Published(
        "the same, one agent hears nobody",
        "does not agree",
        lambda: oscillators(reached=False),
        "refuted",
    )
    # built-in `platoon`; double integrators as in Ren and Atkins (2007)
    yield Published("trucks in formation, gusts", "-", lambda: load_problem("platoon"))
    # Lorenz (1963); pinning as in Chen, Liu and Lu (2007)
    yield Published(
        "Lorenz nodes, k = 12 on each",
        "origin: k > (sqrt(1201) - 11)/2 = 11.83",
        lambda: nodes(LORENZ, 12, "1/10"),
    )
    # Lorenz (1963)
    yield Published(
        "Lorenz nodes, k = 11.7", "unstable", lambda: nodes(LORENZ, "11.7", "1/10"), "refuted"
    )
    # Hartley (1989)
    yield Published("Chua nodes with a cubic, k = 10", "-", lambda: nodes(CUBIC_CHUA, 10, "1/5"))
    # built-in `neurons`; FitzHugh (1961)
    yield Published(
        "FitzHugh-Nagumo nodes at rest", "alone they fire", lambda: load_problem("neurons")
    )
    # MATPOWER case9; Anderson and Fouad
    yield Published("swing equations, IEEE 9 buses", "-", lambda: swing9("0.05", "0.1"))
    # built-in `swing-ieee39`; Athay, Podmore and Virmani (1979)
    yield Published("swing equations, IEEE 39 buses", "-", lambda: load_problem("swing-ieee39"))
    # Jadbabaie, Motee and Barahona (2004); Doerfler and Bullo (2014)
    yield Published("Kuramoto, unknown frequencies", "angles within pi/2", lambda: kuramoto("0.6"))
    # built-in `microgrid-ieee14`; Simpson-Porco, Doerfler and Bullo (2013)
    yield Published(
        "droop-controlled microgrid, IEEE 14 buses",
        "angles within pi/2",
        lambda: load_problem("microgrid-ieee14"),
    )
    # Jadbabaie, Lin and Morse, IEEE TAC 48 (2003)
    yield Published("joint connectivity, period 2 s", "agree, no rate", jointly_connected)
    # arXiv 1312.7447
    yield Published(
        "containment, a path between two leaders, one moves", "end between", path_between_leaders
    )
    # Cao, Ren and Egerstedt, Automatica 48 (2012)
    yield Published("containment, graphs in turn, one leader moves", "end between", leaders_in_turn)
    # Friedkin and Johnsen (1999)
    yield Published("opinions with stubborn agents", "end at 60, 60, 75, 75", opinions)
    # Altafini, IEEE TAC 58 (2013)
    yield Published(
        "antagonists in a ring, signs balance", "agree up to signs", lambda: signed_ring(True)
    )
    yield Published("the same, one pair less", "all go to 0", lambda: signed_ring(False))
    yield Published("the same, curved couplings", "all go to 0", curved_ring)
    # Olfati-Saber and Murray, IEEE TAC 49 (2004)
    yield Published("average consensus on a ring of ten", "mean, 0.381966", average)
    # Moreau, IEEE TAC 50 (2005); Ren and Beard, IEEE TAC 50 (2005)
    yield Published("graphs with a root together, no leader", "agree, no rate", jointly_rooted)
    # Yang and Mei (2017)
    yield Published("leaderless double integrators, disturbances", "agree", leaderless)
    # Schenato and Fiorentin, Automatica 47 (2011)
    yield Published("clocks without a master", "agree", clocks)
    # Nasirian, Moayedi, Davoudi and Lewis, IEEE TPEL 30 (2015)
    yield Published("DC microgrid, loads shared by rating", "weights 1/6, 1/3, 1/2", sharing)
    # Jadbabaie, Lin and Morse (2003); Moreau (2005)
    yield Published("headings within half a turn", "agree", headings)
    # arXiv 1709.00951
    yield Published("inputs that saturate, constant disturbances", "rate at most 1/4", saturating)
    # Olfati-Saber and Murray, IEEE TAC 49 (2004)
    late = {"delay": "0.12", "own_delay": "0.12"}
    yield Published("a ring late in everything", "below pi/10 s", lambda: followers(readings=late))
    too_late = {"delay": "0.315", "own_delay": "0.315"}
    yield Published(
        "the same above pi/10", "diverges", lambda: followers(readings=too_late), verdict="refuted"
    )
    # Xie, Liu, Wang and Jia, American Control Conference (2009)
    yield Published(
        "a ring, sampled", "below 2/5 s", lambda: followers(processor={"period": "0.33"})
    )
    yield Published(
        "the same above 2/5",
        "does not converge",
        lambda: followers(processor={"period": "0.41"}),
        verdict="refuted",
    )
    # Dimarogonas, Frazzoli and Johansson, IEEE TAC 57 (2012)
    yield Published(
        "a ring that broadcasts on events of 20 %",
        "reach it",
        lambda: followers(readings={"event": "0.2"}),
    )
    # Guo and Dimarogonas, Automatica 49 (2013): logarithmic quantisers of what is sent
    yield Published(
        "the same sampled, quantised by 10 %",
        "reach it",
        lambda: followers(readings={"event": "0.1"}, processor={"period": "0.2"}),
    )
    # Xiao and Wang, IEEE TAC 53 (2008): bounded delays and losses
    lossy = {"period": "0.1", "lost": 3, "delay": "0.05"}
    yield Published("a ring, three packets lost", "reach it", lambda: followers(readings=lossy))
    # DeGroot, JASA 69 (1974), with a leader and delays
    yield Published("means of what was two steps ago", "reach it", in_steps)
    # ENTSO-E, Operation Handbook: 49.8 to 50.2 Hz in normal operation
    yield Published("hum of the mains, 50 Hz within 0.2 Hz", "0.00401 of it is left", humming)
    # Zhang, Zhu and Liu, Entropy 18 (2016), 423: adaptive, so that it vanishes
    yield Published(
        "double integrators, a sine of unknown frequency",
        "agree, by adaptation",
        lambda: second_order_sines(exosystems.harmonics([2]), banded("1.8", "2.2", "1/2")),
    )
    # Fossen, Handbook of Marine Craft (2011): periods of waves
    waves = exosystems.harmonics(["0.45", "1.19"])
    yield Published(
        "ships in waves of 5 to 20 s",
        "-",
        lambda: second_order_sines(waves, banded("0.314", "1.257", "1/10")),
    )
    # Ren, IEEE TAC 53 (2008): double integrators without measured speeds
    tree = [[2, 1], [3, 1], [4, 2], [5, 2], [6, 3]]
    placed = Observer(W=[[8], [20], [0], [-32]])
    yield Published(
        "double integrators, a tree, positions alone",
        "(s + 1)(s + 2), (s + 2)^2 and (s + 2)^4: rate 1",
        lambda: position_alone(tree, 6, placed),
    )
    yield Published("the same, W designed", "rate 1", lambda: position_alone(tree, 6, None))
    # Messner and Tilbury, Control Tutorials: J = 0.01, b = 0.1, K = 0.01, R = 1, L = 0.5
    yield Published(
        "DC motors, speeds alone",
        "alone s^2 + 12 s + 20.02",
        lambda: motors([[-10, 1], ["-0.02", -2]], [[0], [2]], [[1, 0]], "y1"),
    )
    angles = [[0, 1, 0], [0, -10, 1], [0, "-0.02", -2]]
    yield Published(
        "the same, angles are to agree",
        "an angle does not show in the speed",
        lambda: motors(angles, [[0], [0], [2]], [[0, 1, 0]], "y1"),
        "undecided",
    )
    # the paper's A, C and W
    yield Published(
        "Example 1 of the paper, the frequency off by 10 %",
        "0.103995 of it is left",
        lambda: load_problem("paper-fixed").replace(uncertainty=banded("1.8", "2.2", "1/2")),
    )
    # built-in `paper-fixed`
    yield Published("Example 1 of the paper", "agree, no rate", lambda: load_problem("paper-fixed"))


PUBLISHED = tuple(_published())


def regional(number: int) -> Problem:
    """One of twenty problems of agents with nonlinear dynamics or couplings that ask for a
    region."""
    k = number // 5
    kind = number % 5
    if kind == 0:
        pinned = (1, 2, 3)
        gains = {i: [[2 + k, 2]] for i in pinned}
        return nodes(PENDULUM, gains, "1/4", coupling="2*y1 + 3*y2")
    if kind == 1:
        return nodes(LORENZ, 20 + 10 * k, "1/5")
    if kind == 2:
        return nodes(CUBIC_CHUA, 12 + 4 * k, "1/5")
    if kind == 3:
        return swing9(str(Fraction(1 + k, 50)), "1/20")
    scalar = Dynamics(f=[("x - x**3", "sin(x)", "x**2/2", "x/2 - tanh(x)")[k]])
    return nodes(scalar, 3, "1/3", coupling="tanh(y)", target=0)


def stated(problem: Problem) -> str:
    """n and m, for the table."""
    sizes = json.dumps([problem.n, problem.m])
    return sizes[1:-1].replace(", ", " x ")
