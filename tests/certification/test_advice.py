"""What people write who mean something else: the message names it, and the cure works as the
message writes it."""

import json
import re
from fractions import Fraction

import numpy as np
import pytest
from certified import certified

from dobc_design import certify
from dobc_design.coupling.coupling import make_coupling
from dobc_design.description.meaning import remarks
from dobc_design.description.words import describe
from dobc_design.errors import SpecError
from dobc_design.loop.arrays import pinning_matrix
from dobc_design.loop.make import loop_of
from dobc_design.loop.matrices import consensus_jacobian
from dobc_design.problem.load import read_problem_text
from dobc_design.problem.problem import Problem
from dobc_design.problem.signs import signs_of, turned_text
from dobc_design.report.words import shown_notes
from dobc_design.verdict import Verdict


def read(text: str) -> Problem:
    return read_problem_text(text.encode(), folder=None)


def message_of(text: str) -> str:
    with pytest.raises(SpecError) as caught:
        read(text)
    return str(caught.value)


def closed_loop(problem: Problem) -> np.ndarray:
    (mode,) = problem.network.modes
    return (consensus_jacobian(loop_of(problem), mode) - pinning_matrix(problem)).toarray()


SIGNED = """\
name = "signed"
target = 1
[network]
agents = 4
arrow = "listens_to"
[network.modes]
g = [[1,2,1],[2,1,1],[2,3,-2],[3,2,-2],[3,4,1],[4,3,1],[4,1,-1],[1,4,-1]]
[coupling]
h = "y"
[pinning]
gains = { 1 = 1 }
"""
unsigned = SIGNED.replace("-2", "2")
OPPOSED = unsigned.replace("-1", "1").replace(
    "[pinning]",
    '[[coupling.exceptions]]\narcs = [[2, 3], [3, 2], [4, 1], [1, 4]]\nh = "-y"\n[pinning]',
)


def signed_loop() -> np.ndarray:
    """x_i' = sum |w| (sign x_j - x_i) - k_i x_i, written down by hand."""
    weights = np.zeros((4, 4))
    second = (2, 3, -2)
    third = (3, 2, -2)
    fourth = (4, 1, -1)
    for i, j, w in (
        (1, 2, 1),
        (2, 1, 1),
        second,
        third,
        (3, 4, 1),
        (4, 3, 1),
        fourth,
        (1, 4, -1),
    ):
        weights[i - 1, j - 1] = w
    degrees = np.diag(np.abs(weights).sum(axis=1))
    pinned = np.diag([1, 0, 0, 0])
    return weights - degrees - pinned


def test_a_negative_weight_asks_what_it_means_and_opposing_has_the_eigenvalues_of_the_signed_loop():
    """Agents 1 and 2 end at 1, agents 3 and 4 at -1; the signed loop decays at 0.188 1/s."""
    message = message_of(SIGNED)
    assert "2 listens to 3 with -2" in message
    assert '"opposes": 2 follows -x of 3' in message
    assert '"repels": 2 moves away from 3' in message
    opposing = read(SIGNED.replace("[network.modes]", 'negative = "opposes"\n[network.modes]'))
    true = np.sort(np.linalg.eigvals(signed_loop()).real)
    found = np.linalg.eigvals(closed_loop(opposing)).real
    assert np.allclose(np.sort(found), true)
    certificate = certify(opposing)
    assert certificate.verdict is Verdict.PROVED
    assert -true[-1] == pytest.approx(0.188, abs=1e-3)
    assert certificate.rate == pytest.approx(-true[-1], rel=1e-3)
    assert [opposing.goal_of(agent)[0] for agent in range(4)] == [1, 1, -1, -1]


def test_a_sign_in_h_on_some_arcs_is_told_from_a_signed_graph():
    (remark,) = remarks(read(OPPOSED))
    assert "pushes neighbours apart" in remark
    assert 'give these arcs h = "y" and a negative weight, and write negative = "opposes"' in remark
    assert certify(read(OPPOSED)).verdict is Verdict.REFUTED


def test_the_other_meaning_of_a_negative_weight_is_a_coupling_that_repels():
    """Agent 3 moves away from agent 2, weakly enough to be held."""
    text = SIGNED.replace("-1", "1").replace("[2,3,-2],[3,2,-2]", "[2,3,-0.1],[3,2,2]")
    repelled = read(text.replace("[network.modes]", 'negative = "repels"\n[network.modes]'))
    written = text.replace("-0.1", "0.1").replace(
        "[pinning]", '[[coupling.exceptions]]\narcs = [[2, 3]]\nh = "-y"\n[pinning]'
    )
    assert np.allclose(closed_loop(repelled), closed_loop(read(written)))
    assert certify(repelled).verdict is Verdict.PROVED


def test_sides_fit_every_sign_or_there_are_none():
    rng = np.random.default_rng(7)
    balanced = 0
    for _ in range(200):
        n = int(rng.integers(2, 6))
        pairs = []
        for i in range(n):
            for j in range(n):
                if i != j and rng.random() < 0.4:
                    pairs.append((i, j))
        arcs = []
        for i, j in pairs:
            arcs.append((i, j, Fraction(-1 if rng.random() < 0.4 else 1)))
        fits = any(
            all(((side >> i & 1) != (side >> j & 1)) == (w < 0) for i, j, w in arcs)
            for side in range(2**n)
        )
        pins = sorted(rng.choice(n, size=1).tolist())
        found = signs_of(n, arcs, pins)
        assert (found.sides is not None) == fits
        assert (found.breaks is None) == fits
        if found.sides is not None:
            balanced += 1
            assert found.sides[pins[0]] == 1
            for i, j, weight in arcs:
                assert found.sides[i] * found.sides[j] == weight
    assert 20 < balanced < 180


@pytest.mark.parametrize(
    ("text", "turned"),
    [
        ("-y", "y"),
        ("-2*tanh(y)", "2*tanh(y)"),
        ("-y - y**3", "-(-y - y**3)"),
        ("-1e-3*y", "1e-3*y"),
        ("(-y)", "-((-y))"),
        ("-(y + y**3)", "(y + y**3)"),
    ],
)
def test_an_expression_is_turned_round(text: str, turned: str):
    assert turned_text(text) == turned
    y = np.array([[0.7]])
    value, opposite = (
        make_coupling(each, dimension=1, outputs=1, key="h").value(y) for each in (text, turned)
    )
    assert opposite == pytest.approx(-value)


LEADERLESS = """\
name = "leaderless"
[network]
agents = 5
arrow = "listens_to"
[network.modes]
ring = [[1,2],[2,3],[3,4],[4,5],[5,1],[2,1,0.5]]
[coupling]
h = "4*y"
[exosystem]
constant = true
"""


ALONE = """\
name = "alone"
network = { agents = 1, arrow = "listens_to", modes = { G = [] } }
coupling = { h = "y" }
exosystem = { constant = true }
"""


def test_an_agent_alone_is_not_advised_to_agree():
    (remark,) = remarks(read(ALONE))
    assert remark.endswith("For the target give an agent a gain in [pinning].")


def test_agents_without_pins_agree_and_what_is_not_reached_is_the_target():
    certificate = certify(read(LEADERLESS))
    assert certificate.verdict is Verdict.REFUTED
    assert certificate.reason.startswith("The target is not reached: no agent is pinned")
    agreement = "The agents do agree with each other, because agent 1 is heard by all others"
    assert agreement in certificate.reason
    assert "Pin agent 1" in certificate.reason
    (remark,) = remarks(read(LEADERLESS))
    assert agreement in remark
    assert remark.endswith('goal = "agreement" asks whether they agree.')
    matrix = closed_loop(read(LEADERLESS))
    eigenvalue = np.linalg.eigvals(matrix)
    eigenvalues = np.sort(eigenvalue.real)
    assert eigenvalues[-1] == pytest.approx(0, abs=1e-9)
    assert eigenvalues[-2] < -0.1
    pinned = LEADERLESS + "[pinning]\ngains = { 1 = 1 }\n"
    assert certify(read(pinned)).verdict is Verdict.PROVED


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("[5,1],", ""), "agent 5 is heard by all others"),
        (
            ("[2,3],[3,4],[4,5],[5,1],", "[3,4],[4,5],[5,3],"),
            "no arc lets agents 1, 2 hear anybody else, and none lets agents 3, 4, 5.",
        ),
        (('"4*y"', '"4*y + y**3"'), "agree with each other, from close enough starts, because"),
        (('"4*y"', '"y**3"'), ""),
        (("constant = true", "constant = true\n[observer]\nW = [[-1]]"), ""),
        (("ring = ", "ring = [[1,2],[3,4]]\nrest = "), ""),
        (
            ("ring = ", "ring = [[1,5],[2,5],[3,2],[4,3]]\nrest = "),
            "agent 5 is heard by all others",
        ),
        (("[exosystem]", "[uncertainty]\ndisturbance = 1\n[exosystem]"), ""),
    ],
)
def test_agreement_is_said_only_where_it_holds(change: tuple[str, str], words: str):
    """A chain, two groups, a nonlinear coupling, one that hardly attracts, an observer whose error
    grows, a mode without a root and one with it, a disturbance that no observer knows."""
    text = LEADERLESS.replace(*change)
    assert text != LEADERLESS
    found = [remark for remark in remarks(read(text)) if "No agent is pinned" in remark]
    assert len(found) == 1
    assert (words or "The group can drift as a whole.") in found[0]
    assert ("with each other" in found[0]) == bool(words)


SWITCHING_PINS = """\
name = "switch-pins"
[network]
agents = 4
arrow = "listens_to"
[network.modes]
G1 = [[2,1],[3,1],[4,1]]
G2 = [[1,2],[3,1],[4,1]]
G3 = [[3,1],[4,1]]
[dynamics]
A = [[-4, 1], [0, -1]]
B = [[1], [0]]
[coupling]
h = "y1 + y2"
[pinning.gains]
G1 = { 1 = 1 }
G2 = { 2 = 1 }
G3 = { 2 = 1 }
"""


def test_pins_of_modes_are_told_where_they_are_written():
    message = message_of(SWITCHING_PINS)
    assert "pinning.gains.G1: G1 is a mode" in message
    assert "below [pinning.modes]: G1 = { 1 = 1 }." in message
    cured = read(SWITCHING_PINS.replace("[pinning.gains]", "[pinning.modes]"))
    assert cured.pinning.agents == (0, 1)
    assert certify(cured).verdict is Verdict.PROVED


def test_pins_of_modes_are_arcs_to_an_agent_that_stands_for_the_target():
    """The network of older files, in which an agent that alone is pinned stands for the target, is
    proved too."""
    head, _, _ = SWITCHING_PINS.partition("[pinning.gains]")
    cured = head.replace("agents = 4", 'agents = ["1", "2", "3", "4", "target"]')
    for mode, agent in (("G1", 1), ("G2", 2), ("G3", 2)):
        cured = cured.replace(f"{mode} = [", f'{mode} = [[{agent}, "target", 1], ')
    assert certify(read(f"{cured}[pinning]\ngains = {{ target = 1 }}\n")).verdict is Verdict.PROVED


def test_pins_of_modes_of_integrators_have_their_gains_in_their_modes():
    """The loop of each mode is that of its pins: x_1' = ... - 3 x_1."""
    given = """\
name = "switch-pins"
[network]
agents = 2
arrow = "listens_to"
[network.modes]
a = [[2, 1]]
b = [[1, 2]]
[coupling]
h = "2*tanh(y)"
[pinning.modes]
a = { 1 = 3 }
b = { 2 = "1/2" }
"""
    problem = read(given)
    wanted = {"a": [[-3, 0], [2, -2]], "b": [[-2, 2], [0, -0.5]]}
    for mode, matrix in wanted.items():
        assert np.allclose(consensus_jacobian(loop_of(problem), mode).toarray(), matrix)
    assert certify(problem).verdict is Verdict.PROVED


MOVING = """\
name = "platoon5-moving"
[network]
agents = 5
arrow = "listens_to"
[network.modes]
all = [[1,2],[2,3],[3,4],[4,5]]
[coupling]
h = "10*y"
[pinning]
gains = { 5 = 1 }
[leader]
initial = [[0, 0], [0, 0]]
"""


def test_a_target_at_constant_speed_has_its_speed_as_a_state():
    message = message_of(MOVING)
    assert message.startswith("leader needs [dynamics]")
    written = (
        "A = [[0, 1], [0, 0]]",
        "B = [[0], [1]]",
        'h = "10*y1 + 10*y2"',
        "initial = [[0, 0], [1, 1]]",
    )
    assert all(each in message for each in written)
    A, B, h, initial = written
    cured = MOVING.replace('h = "10*y"', h).replace("initial = [[0, 0], [0, 0]]", initial)
    certificate = certify(read(f"{cured}[dynamics]\n{A}\n{B}\n"))
    assert certificate.verdict is Verdict.PROVED
    assert "follow the leader" in certificate.reason
    still = MOVING.partition("[leader]")[0]
    assert "write target in place of [leader]" in message
    assert certify(read(f"target = 3\n{still}")).verdict is Verdict.PROVED


LIMITED = """\
name = "limited"
target = [10, 0]
[network]
agents = 3
arrow = "listens_to"
[network.modes]
g = [[1,2],[2,1],[2,3],[3,1]]
[dynamics]
A = [[0, 1], [-0.1, -0.2]]
B = [[0], [1]]
[coupling]
h = "20*y1 + 10*y2"
[pinning]
gains = { 1 = 1 }
[actuators]
limit = { 1 = 5, 2 = 7 }
[simulation]
t_final = 2
"""


def written_command(message: str) -> list[str]:
    """The command between the first `dobc` and the end of its sentence, without the program's
    name."""
    return re.search(r"dobc (stress FILE --\w+ [\d.]*\d)", message)[1].split()


def test_limits_of_agents_with_dynamics_are_tried_in_runs(command_line, tmp_path):
    message = message_of(LIMITED)
    assert message.startswith("actuators is not known for agents with [dynamics]")
    command = written_command(message)
    assert command == ["stress", "FILE", "--saturation", "5"]
    removed = LIMITED.replace("[actuators]\nlimit = { 1 = 5, 2 = 7 }\n", "")
    assert certify(read(removed)).verdict is Verdict.PROVED
    (tmp_path / "file.toml").write_text(removed, "utf-8")
    arguments = [tmp_path / "file.toml" if word == "FILE" else word for word in command]
    code, out, _ = command_line(*arguments)
    assert code == 0
    assert "Stress: |u| at most 5." in out


def test_delays_of_agents_with_dynamics_are_said_to_be_open_and_are_tried_by_sampling(
    command_line, tmp_path
):
    """Double integrators: proved, without a row on delays; the run with a period of 0.03 s
    converges."""
    text = LIMITED.replace("A = [[0, 1], [-0.1, -0.2]]", "A = [[0, 1], [0, 0]]")
    text = text.replace("[actuators]\nlimit = { 1 = 5, 2 = 7 }\n", "").replace(
        "t_final = 2", "t_final = 20"
    )
    certificate = certify(read(text))
    assert certificate.verdict is Verdict.PROVED
    for check in certificate.checks:
        assert check.id != "delay"
    (note,) = (
        note for note in shown_notes(certificate) if note.startswith("No delay is certified")
    )
    assert note not in certificate.claims.notes
    command = written_command(note)
    assert command == ["stress", "FILE", "--period", "0.03"]
    (tmp_path / "file.toml").write_text(text, "utf-8")
    words = [tmp_path / "file.toml" if word == "FILE" else word for word in command]
    code, out, _ = command_line(*words, "--json")
    document = json.loads(out)
    assert code == 0
    assert "Stress: sampled every 0.03 s." in document["notes"]
    assert document["final_error"]["max"] < 0.01


def test_the_note_on_delays_names_no_command_that_refuses_a_leader():
    text = LIMITED.replace("target = [10, 0]\n", "").replace("[-0.1, -0.2]", "[0, 0]")
    text = text.replace(
        "[actuators]\nlimit = { 1 = 5, 2 = 7 }\n", "[leader]\ninitial = [[0, 0], [1, 2]]\n"
    )
    note = shown_notes(certify(read(text)))[-1]
    assert note.startswith("No delay is certified")
    assert "dobc stress" not in note


def test_a_note_on_delays_is_shown_by_no_proof_that_has_them():
    assert shown_notes(certified("platoon"))[-1].startswith("No delay is certified")
    assert not any(
        "No delay" in note
        for name in ("clock-sync", "paper-fixed")
        for note in shown_notes(certified(name))
    )


ONE_DISTURBED = """\
name = "one-disturbed"
[network]
agents = 3
arrow = "listens_to"
[network.modes]
g = [[1,2],[2,1],[2,3],[3,2]]
[coupling]
h = "4*y"
[pinning]
gains = { 1 = 1 }
[exosystem]
[[exosystem.groups]]
agents = [2]
frequencies = 1
"""


def test_agents_in_no_group_have_no_disturbance_and_the_words_say_so():
    problem = read(ONE_DISTURBED)
    assert "Disturbance of 2: sine of 1 rad/s" in describe(problem)
    assert "Disturbance of 1, 3: none." in describe(problem)
    assert "disturbance of 1, 3" in problem._repr_html_()
    assert certify(problem).verdict is Verdict.PROVED
