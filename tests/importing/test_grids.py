"""Power grids: MATPOWER cases and pandapower networks, against the susceptances of a load flow."""

from fractions import Fraction

import numpy as np
import pytest
from broken_input import LIMIT as ALONE
from broken_input import time_limit
from networks import loop_by_hand, tables

import dobc_design as dd
from dobc_design.errors import SpecError
from dobc_design.importing.grids import read_matpower
from dobc_design.verdict import Verdict

CASE = """
function mpc = three
%THREE  a small case; [brackets] = in a comment
mpc.version = '2';
mpc.baseMVA = 100;
mpc.bus = [   % bus_i type Pd ...
\t10\t3\t0\t0;
\t20\t1\t50\t10;
\t30\t2\t0\t0;
\t40\t4\t0\t0;   % isolated
];
mpc.gen = [
\t10 0 0 Inf -Inf 1 100 1;
\t20 0 0 9 -9 1 100 0;
\t30 0 0 9 -9 1 100 1
];
mpc.branch = [
\t10\t20\t.01\t0.05\t0\t0\t0\t0\t0\t0\t1;
\t20\t10\t0\t0.1\t0\t0\t0\t0\t0.5\t0\t1;
\t20, 30, 0.0, 4e-1, 0, 0, 0, 0, ...
\t0, 0, 1;
\t10\t30\t0\t0.2\t0\t0\t0\t0\t0\t0\t0;
\t30\t40\t0\t0.2\t0\t0\t0\t0\t0\t0\t1;
];
mpc.gencost = [ 2 0 0 3 0.01 40 0 ];
"""


def imported(tmp_path, text: str):
    (tmp_path / "three.m").write_text(text)
    return dd.problem_from_file(tmp_path / "three.m")


def test_a_matpower_case_becomes_angles_with_exact_susceptances(tmp_path):
    """Parallel branches add up: 1/0.05 + 1/(0.1 * 0.5) = 40; out of service and isolated ones are
    left out."""
    problem = imported(tmp_path, CASE)
    assert problem.network.labels == ("10", "20", "30")
    half = Fraction(5, 2)
    found = sorted(problem.network.modes["grid"])
    expected = [(0, 1, 40), (1, 0, 40), (1, 2, half), (2, 1, half)]
    assert found == expected
    assert problem.coupling.texts == ("sin(y)",)
    assert problem.pinning.agents == (0, 2)
    assert problem.name == "three"
    assert "generators at bus 10, 30" in problem.notes[0]
    assert any("Stand-ins" in note for note in problem.notes)
    assert dd.certify(problem).verdict is Verdict.PROVED


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ("mpc.branch = [", "mpc.lines = [", "must hold the table mpc.branch"),
        (
            "4e-1",
            "1/3+0.1",
            r"three.m, line 20: mpc.branch\(3,4\) must be a number, because nothing .* "
            r"computed; got",
        ),
        ("4e-1", "1/3", r"line 20: mpc.branch\(3,4\) must be a number"),
        ("\t1\t50\t10;", "\t1\t12 / 3;", r"line 8: mpc.bus\(2,4\) must be a number"),
        ("\t10\t3\t0\t0;", "\t10\t3\t0\tf(3);", r"line 7: mpc.bus\(1,4\) must be a number"),
        ("\t0\t1;\n];", "\t0\t1;\n]';", r"line 17: mpc.branch must end in \];"),
        (
            "mpc.gencost",
            "mpc.branch(:, 4) = mpc.branch(:, 4) / 2;\nx",
            r"line 25 changes the tables.*savecase",
        ),
        ("mpc.gencost", "if 1, mpc.branch(a == b, BR_X) = 2; end\nx", "line 25 changes the tables"),
        ("mpc.gencost", "mpc = scale_load(2, mpc);\nx", "line 25 changes the tables"),
        ("20, 30", "20, 31", "line 20: mpc.branch row 3 names bus 31, which is not there"),
        ("20, 30", "20, 20", "from bus 20 to itself"),
        ("\t40\t4\t0\t0;", "\t40\t;\n", "at least 2 columns; row 4 has 1"),
        (
            "\t10\t3\t0\t0;",
            "\t1.5\t3\t0\t0;",
            "line 7: mpc.bus row 1 must name a bus by a whole number",
        ),
        (
            "\t10\t30\t0\t0.2\t0\t0\t0\t0\t0\t0\t0;",
            "\t10\t30\t0;",
            "at least 11 columns; row 4 has 3",
        ),
    ],
)
def test_a_wrong_table_is_named(old: str, new: str, match: str, tmp_path):
    text = CASE.replace(old, new)
    assert text != CASE
    with pytest.raises(SpecError, match=match):
        imported(tmp_path, text)


def test_a_negative_reactance_repels_and_one_of_0_joins_its_buses(tmp_path):
    """1/(-0.4) between buses 20 and 30: w = 5/2 with h = -sin(y), the same slope at 0."""
    problem = imported(tmp_path, CASE.replace("4e-1", "-0.4"))
    assert problem.network.modes["grid"] == imported(tmp_path, CASE).network.modes["grid"]
    texts = {arc: h.texts for arc, h in problem.exceptions.items()}
    expected_texts = dict.fromkeys([(1, 2), (2, 1)], ("-sin(y)",))
    assert texts == expected_texts
    assert "between buses 20 and 30 is negative" in problem.notes[-1]
    joined = imported(tmp_path, CASE.replace("4e-1", "0"))
    assert joined.network.labels == ("10", "20")
    assert joined.pinning.agents == (0, 1)
    found = sorted(joined.network.modes["grid"])
    expected = [(0, 1, 40), (1, 0, 40)]
    assert found == expected
    assert "30 into 20" in joined.notes[-1]


OHM = """mpc.baseMVA = 50;
Vbase = mpc.bus(1, BASE_KV) * 1e3;      %% in Volts
Sbase = mpc.baseMVA * 1e6;
mpc.branch(:, [BR_R BR_X]) = mpc.branch(:, [BR_R BR_X]) / (Vbase^2 / Sbase);
mpc.bus(:, [PD, QD]) = mpc.bus(:, [PD, QD]) / 1e3;
mpc.gen(k, PMAX) = mpc.gen(k, PG);
"""


def test_reactances_that_the_case_turns_from_ohms_into_per_unit_are(tmp_path):
    """x / (10^2 / 50): half of what is written; anything else in place of that statement is
    refused."""
    wide = CASE.replace("\t0\t0;\n\t20", "\t0\t0\t0\t0\t1\t1\t0\t10.0\t12/sqrt(3);\n\t20")
    plain = imported(tmp_path, wide)
    ohm = imported(tmp_path, wide + OHM)
    weights = [w for _, _, w in ohm.network.modes["grid"]]
    expected = [2 * w for _, _, w in plain.network.modes["grid"]]
    assert weights == expected
    for old, new in (("* 1e6", "* 1e3"), ("Vbase^2", "Vbase^3"), ("(1, BASE_KV)", "(2, BASE_KV)")):
        with pytest.raises(SpecError, match="line 29 changes the tables"):
            imported(tmp_path, wide + OHM.replace(old, new))


def test_a_block_comment_is_no_table_and_nothing_is_executed(tmp_path):
    hidden = CASE + "%{\nmpc.branch = [ 10 20 0 9 0 0 0 0 0 0 1 ];\n %}\n"
    assert imported(tmp_path, hidden).network == imported(tmp_path, CASE).network
    hostile = CASE.replace(
        "4e-1", "__import__('os').system('touch " + str(tmp_path / "hacked") + "')"
    )
    with pytest.raises(SpecError, match=r"mpc.branch\(3,4\) must be a number"):
        imported(tmp_path, hostile)
    assert not (tmp_path / "hacked").exists()


WHOLE = "mpc.bus = [1 3;2 1];mpc.branch=[1 2 0 .1 0 0 0 0 0 0 1];\n"


@pytest.mark.parametrize(
    "text",
    [
        "mpc.bus = [" * 50_000,
        "'" * 300_000,
        "mpc.bus = [" + "9" * 300_000 + "x 2];",
        WHOLE + "[" + " " * 300_000 + "=1; mpc = 1",
        WHOLE + "mpc.bus(" * 100_000 + "=1",
        WHOLE + "mpc.bus(:," + "PD," * 100_000 + "=1",
    ],
)
def test_a_long_run_of_one_thing_is_read_in_linear_time(text: str):
    """Quadratic time would be minutes."""
    with time_limit(ALONE), pytest.raises(SpecError, match=r"mpc\.bus|changes the tables"):
        read_matpower(text, name="bomb.m")


def pandapower():
    return pytest.importorskip(
        "pandapower", reason='pandapower is not installed: pip install "dobc_design[grid]"'
    )


@pytest.mark.slow
@pytest.mark.parametrize("case", ["case9", "case14", "case39"])
def test_pandapower_networks_have_the_susceptances_of_their_own_load_flow(case: str, tmp_path):
    """The matrix of pandapower's direct-current load flow, built by itself."""
    pp = pandapower()
    from pandapower import networks

    net = getattr(networks, case)()
    problem = dd.from_pandapower(net)
    pp.rundcpp(net)
    B = net._ppc["internal"]["Bbus"].toarray()
    found = -dd.export.to_numpy(problem)["L"]
    off = ~np.eye(len(found), dtype=bool)
    buses = [int(label) for label in problem.network.labels]
    order = net._pd2ppc_lookups["bus"][buses]
    wanted = -B[np.ix_(order, order)]
    np.testing.assert_allclose(found[off], wanted[off], rtol=1e-6, atol=1e-9)
    pp.to_json(net, str(tmp_path / "net.json"))
    again = dd.problem_from_file(tmp_path / "net.json")
    assert again.network == problem.network
    assert again.pinning == problem.pinning


@pytest.mark.slow
def test_the_ieee_14_bus_network_is_that_of_the_built_in_problem():
    """Lines and pins of microgrid-ieee14 were typed in by hand; pandapower has taps besides, on
    three transformers."""
    pandapower()
    from pandapower import networks

    found = dd.from_pandapower(networks.case14())
    known = dd.load_problem("microgrid-ieee14")
    found_pins = [i + 1 for i in found.pinning.agents]
    known_pins = [i + 1 for i in known.pinning.agents]
    assert found_pins == known_pins == [1, 2, 3, 6, 8]
    lines = {(i, j): float(w) for i, j, w in known.network.modes["grid"]}
    same = {(i, j): float(w) for i, j, w in found.network.modes["grid"]}
    assert set(lines) == set(same)
    taps = {frozenset(pair) for pair in ((3, 6), (3, 8), (4, 5))}
    for pair, w in lines.items():
        if frozenset(pair) not in taps:
            assert same[pair] == pytest.approx(w, rel=1e-6)


@pytest.mark.slow
def test_the_300_bus_network_with_its_negative_reactance_is_refuted():
    """One branch between buses 244 and 98 repels: NumPy, too, finds one eigenvalue of J - K with
    positive real part."""
    pandapower()
    from pandapower import networks

    problem = dd.from_pandapower(networks.case300())
    loop = loop_by_hand(problem)
    for i, j in problem.exceptions:  # h = -sin(y) instead of sin(y)
        arcs = problem.network.modes["grid"]
        weight = next(w for a, b, w in arcs if (a, b) == (i, j))
        w = float(weight)
        loop[i, j] -= 2 * w
        loop[i, i] += 2 * w
    assert np.sum(np.linalg.eigvals(loop).real > 1e-9) == 1
    certificate = dd.certify(problem)
    assert certificate.verdict is Verdict.REFUTED
    assert "1 eigenvalue(s) with positive real part" in certificate.reason
    assert dd.verify(certificate, problem).lone_checker == "it accepts every claim"


def net_of(tmp_path, data: bytes):
    (tmp_path / "net.json").write_bytes(data)
    return dd.problem_from_file(tmp_path / "net.json")


def test_the_json_of_pandapower_is_read_without_pandapower(tmp_path):
    """x = 5 Ohm in total on 10 kV and 1 MVA is 0.05 p.u."""
    problem = net_of(tmp_path, tables())
    arcs = problem.network.modes["grid"]
    weights = {(i, j): w for i, j, w in arcs}
    assert weights[0, 1] == 20
    assert problem.pinning.agents == (0,)


def test_a_closed_bus_coupler_joins_two_buses_and_an_open_line_switch_opens_the_line(tmp_path):
    switch = ["bus", "element", "et", "closed"]
    row = [1, 2, "b", True]
    rows = (switch, [row])
    joined = net_of(tmp_path, tables(switch=rows))
    assert joined.network.labels == ("0", "1")
    first = [1, 0, "l", False]
    second = [1, 1, "l", False]
    with pytest.raises(SpecError, match="no branch"):
        net_of(tmp_path, tables(switch=(switch, [first, second])))


def test_three_winding_transformers_and_broken_files_are_refused(tmp_path):
    with pytest.raises(SpecError, match="three-winding"):
        net_of(tmp_path, tables(trafo3w=(["in_service"], [[True]])))
    with pytest.raises(SpecError, match="cannot be read"):
        net_of(tmp_path, b'{"_module": "pandapower.auxiliary", "_object": {"bus": 3}}')
    with pytest.raises(SpecError, match="must be a pandapower network"):
        dd.from_pandapower(object())
