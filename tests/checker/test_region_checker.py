"""The lone checker's part about regions: accepts what is proved, refuses what just fails; random
problems."""

import json
import math
import random
import time
from collections.abc import Callable
from fractions import Fraction

import mpmath
import pytest
from campaigns.known_regions import equilibrium_campaign, linear_campaign
from campaigns.regions import (
    change_region,
    region_mutant_campaign,
    region_problem,
    region_recheck_campaign,
)
from certified import certified, certify_once, consensus_claims
from checker_files.files import FAILS, HOLDS, changed, doubles, outcome, second_loop
from checker_files.separable import BENT, PAIR, SINE, certificate, claim, problems
from oracles.theorems import Oracle

from dobc_design import Network, Problem
from dobc_design.certificate.text import certificate_bytes
from dobc_design.certification.recheck import recheck
from dobc_design.checker import separable
from dobc_design.checker.consensus import lower_form
from dobc_design.checker.curves import Curve, both_faces, supremum
from dobc_design.checker.expressions import read_coupling
from dobc_design.checker.intervals import added
from dobc_design.checker.separable import EXACT, Heard, Row, curved_row, mean_slope
from dobc_design.problem.canonical import canonical_bytes


# --- Known answers: the largest alpha by closed forms and by sampling the rows
# --------------------------------------
def sampled_rate(h: Callable[[float], float], v: list[float], k: list[float], rho: float) -> float:
    """The largest alpha of agents in a line, from 100 values of s and suprema over 100 points."""
    rates = []
    for step in range(100):
        s = rho * (step + 1) / 100
        for i, own in enumerate(v):
            low = 0.0
            high = 0.0
            if i:  # the first agent hears nobody
                low = -s * (own + v[i - 1])
                high = s * (v[i - 1] - own)
            points = []
            for part in range(101):
                points.append(low + (high - low) * part / 100)
            for face in (1, -1):
                top = max(face * h(face * y) for y in points)
                rates.append(k[i] - top / (s * own))
    return min(rates)


ROWS = {
    "sin(y)": math.sin,
    "exp(y) - 1 + y": lambda y: math.exp(y) - 1 + y,
    "y - y**3/5": lambda y: y - y**3 / 5,
    "max(-1, min(2*y, y + 1/4))": lambda y: max(-1, min(2 * y, y + 1 / 4)),
    "y*cos(2*y)": lambda y: y * math.cos(2 * y),
    "abs(y)/2 + atan(y)": lambda y: abs(y) / 2 + math.atan(y),
}


@pytest.mark.parametrize("h", sorted(ROWS))
def test_rows_are_accepted_below_the_sampled_rate_and_refused_above(h):
    """Three agents in a line, the first pinned more; also couplings that are not monotone, or have
    kinks."""
    v = [1.0, 1.5, 1.75]
    k = [6.0, 5.0, 6.0]
    exact = {"v": ["1", "3/2", "7/4"], "rho": "1"}
    arcs = [[2, 1], [3, 2]]
    network = Network.from_arcs(arcs, arrow="listens_to", agents=3)
    gains = {1: 6, 2: 5, 3: 6}
    problem = Problem(network=network, coupling=h, gains=gains)
    best = sampled_rate(ROWS[h], v, k, 1.0)
    frame = json.loads(certificate_bytes(consensus_claims(problem)))
    box = {"kind": "box", "radius": 0.5, "disturbance": 0}
    for room, code in ((-5e-3, HOLDS), (5e-3, FAILS)):
        alpha = best + room
        check = claim("max-separable", box, None, exact)
        check["exact"]["alpha"] = f"{alpha:.9f}"
        check["rate"] = round(alpha / 2, 9)
        checks = {"checks": [*frame["checks"], check]}
        read = json.dumps(frame | checks)
        data = read.encode()
        assert outcome(data, canonical_bytes(problem)) == code


def test_two_agents_that_hear_each_other_keep_their_alpha_to_nine_digits():
    """-|y|, both pinned with 5, v = 1: alpha = 3 exactly; sin on [-5/2 s, -s/2]: sin 3 / 1.8 at s =
    6/5."""
    sharp = mpmath.sin(3) / mpmath.mpf("1.8")
    bent = ("bent", BENT, 3.0)
    sine = ("sine", SINE, float(sharp))
    cases = (bent, sine)
    for name, check, alpha in cases:
        for factor, code in ((1 - 1e-9, HOLDS), (1 + 1e-9, FAILS)):
            claimed = f"{alpha * factor:.15f}"
            data = certificate(name, changed(check, alpha=claimed))
            assert outcome(data, canonical_bytes(problems()[name])) == code


# --- Parts
# --------------------------------------------------------------------------------------------------
def test_a_maximum_on_the_edge_of_two_cells_counts_and_a_slope_that_touches_0():
    """2 y - y^2 on [-s, 2 s] is 1 from s = 1/2 on, and less at both ends."""
    coupling = read_coupling(("1 - (1 - y)**2",), 1)
    curve = Curve(coupling, False, -1.0, 2.0)
    expected = [(1.0, 1), (2.0, -1)]
    last_cells = curve.table[-2:]
    assert [(cell.hi, cell.way) for cell in last_cells] == expected
    bound = supremum(curve, (1.0, 1.0), (2.0, 2.0), 0.75, 1.0)
    for s in (0.75, 0.8, 1.0):
        assert 1 <= bound.at(s) < 1 + 1e-9
    # h' = 1 - sin(y) >= 0, since sin(y) <= 1.
    coupling = read_coupling(("cos(y) - 1 + y",), 1)
    curve = Curve(coupling, False, -7.0, 7.0)
    assert {cell.way for cell in curve.table} == {1}


def test_slopes_of_a_coupling_that_also_falls_are_taken_from_the_whole_interval():
    """h' = (1 - y) exp(-y)/2 - 1/4 falls; v_i = v_j: the supremum on [-2, 2 x] is h'(-2), whatever
    x."""
    h = "y*exp(-y)/2 - y/4"
    steepest = 3 * math.exp(2) / 2 - 1 / 4
    coupling = read_coupling((h,), 1)
    curve = Curve(coupling, False, -2.0, 2.0)
    for closely, room in ((False, 3), (True, 1.001)):
        mean = mean_slope(curve, 1.0, (1, 1, 1), closely)
        assert steepest <= mean < room * steepest


def test_forces_and_their_slopes_hold_random_points():
    """Three agents of two components, matrix gains, one arc with another coupling: h(e) - K e by
    mpmath at 100 bits."""
    r = random.Random(5)
    exceptions = {(2, 0): ["y1 + y2**2", "atan(y1*y2) + y2"]}
    arcs = [[1, 2, 2], [2, 3], [3, 1]]
    network = Network.from_arcs(arcs, arrow="listens_to", agents=3)
    gains = {1: [[2, 1], [-1, 3]], 3: [[1, 0], [0, 5]]}
    problem = Problem(
        network=network,
        coupling=["sin(y1)", "2*sin(y2)"],
        exceptions=exceptions,
        gains=gains,
        target=[0, 0],
    )
    loop = second_loop(problem)
    (mode,) = loop.modes

    def h(a: int, b: int) -> mpmath.mpf:
        return [mpmath.sin(a), 2 * mpmath.sin(b)]

    def forces(*e: mpmath.mpf) -> list[mpmath.mpf]:
        x = [e[0:2], e[2:4], e[4:6]]
        y = []
        for i, j in ((0, 1), (1, 2), (2, 0)):
            difference = [b - a for a, b in zip(x[i], x[j], strict=True)]
            y.append(difference)
        first = [2 * f for f in h(*y[0])]
        second = h(*y[1])
        y1, y2 = y[2]
        last = mpmath.atan(y1 * y2) + y2
        third = [y1 + y2**2, last]
        pulled = [*first, *second, *third]
        first_entry = 2 * e[0] + e[1]
        second_entry = -e[0] + 3 * e[1]
        held = [first_entry, second_entry, 0, 0, e[4], 5 * e[5]]
        return [f - k for f, k in zip(pulled, held, strict=True)]

    for _ in range(10):
        ends = [sorted((r.uniform(-2, 2), r.uniform(-2, 2))) for _ in range(6)]
        box = [[Fraction(lo), Fraction(hi)] for lo, hi in ends]
        values, slopes = separable.forces(loop, mode, box)
        with mpmath.workprec(100):
            e = [mpmath.mpf(r.uniform(lo, hi)) for lo, hi in ends]
            for (lo, hi), force in zip(values, forces(*e), strict=True):
                assert lo <= force <= hi
            for a in range(6):
                for b in range(6):
                    lo, hi = slopes[a].get(b, (0, 0))
                    # The first partial derivative by e_b.
                    orders = [0] * 6
                    orders[b] = 1
                    slope = mpmath.diff(lambda *x, a=a: forces(*x)[a], tuple(e), tuple(orders))
                    assert lo - 1e-9 <= slope <= hi + 1e-9


def test_a_force_at_a_point_that_no_float_is_lies_between_its_bounds():
    """e_2 - e_1 = 1/3, and -1/3 for the other agent."""
    listed = [[1, 2], [2, 1]]
    arcs = Network.from_arcs(listed, arrow="listens_to", agents=2)
    problem = Problem(network=arcs, coupling="y", gains={})
    loop = second_loop(problem)
    third = [Fraction(1, 3)] * 2
    point = [[Fraction(0)] * 2, third]
    values, _ = separable.forces(loop, *loop.modes, point)
    minus_third = Fraction(-1, 3)
    for (lo, hi), truth in zip(values, (Fraction(1, 3), minus_third), strict=True):
        assert Fraction(lo) <= truth <= Fraction(hi)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("y", [(0.0, 0.7), (-0.7, 0.0), (-0.7, 0.7), (0.7, 0.7)])
@pytest.mark.parametrize("x", [(0.0, 0.1), (-0.1, 0.0), (-0.1, 0.1), (0.1, 0.1)])
def test_the_exact_ends_of_a_sum_lie_between_its_bounds(x, y, sign: int):
    x = tuple(sorted(sign * end for end in x))
    y = tuple(sorted(sign * end for end in y))
    lo, hi = added(x, y)
    lowest = Fraction(x[0])
    assert Fraction(lo) <= lowest + Fraction(y[0])
    assert Fraction(x[1]) + Fraction(y[1]) <= Fraction(hi)


def test_a_lower_bound_of_the_form_takes_the_lower_slope_for_every_positive_weight():
    """v'Lambda v = 2 v_a (v_b - v_c) g with g from 1 to 2: weights 1/2 and -1/2."""
    segment = (Fraction(1), Fraction(2))
    terms = [(0, 1, 2, segment)]
    v = [Fraction(1, 2), Fraction(1, 2), Fraction(0)]
    assert lower_form(terms, v) == Fraction(1, 2)
    found = lower_form(terms, [-v[0], *v[1:]])
    assert found == -1


# --- Hostile claims
# -------------------------------------------------------------------------------------------------
VECTORS = [{"float64": text} for text in ("AAAA", "A" * 100_000, "")]
VECTORS += [doubles(float("nan"), 1.0), doubles(5e-324, 1.7e308), {"float32": "AAAA"}]
VECTORS += [["1", "1" * 9999], ["1", "\u0661"], ["1e400", "1e-400"], ["1e-400", "1e-400"]]
VECTORS += [[1, 1], "11", [["1"], ["1"]], None]
HOSTILE = [{"v": v} for v in VECTORS]
HOSTILE += [{"rho": rho} for rho in ("1e400", 1, "1/0", "nan", "1" * 9999)]
HOSTILE += [{"alpha": alpha} for alpha in ("1e400", "-1e400", ["1"], "1/" + "3" * 9000)]


@pytest.mark.parametrize("change", HOSTILE)
def test_hostile_numbers_are_refused_at_once(change):
    data = certificate("pair", changed(PAIR, **change))
    problem = canonical_bytes(problems()["pair"])
    start = time.process_time()
    assert outcome(data, problem) == FAILS
    assert time.process_time() - start < 10


QUICK = 8  # a seed with a region that max-separable covers, in well under a second
FAST_PAIR = 3


@pytest.fixture
def certified_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("campaigns.regions.certify", certify_once)


@pytest.mark.usefixtures("certified_once")
def test_a_region_of_a_random_problem_is_confirmed_by_both_checkers_and_the_oracle():
    tally = region_recheck_campaign([QUICK])
    assert not tally.wrong, tally.wrong
    assert tally.counts["max-separable proved"] == 1


@pytest.mark.usefixtures("certified_once")
def test_changed_regional_claims_are_refused_or_true():
    tally = region_mutant_campaign([QUICK], each=15)
    assert not tally.wrong, tally.wrong
    assert tally.counts["refused"] + tally.counts["unreadable"] >= 5


@pytest.mark.parametrize("sign", [0, -1])
@pytest.mark.parametrize("name", ["radius", "rate"])
def test_a_radius_or_a_rate_that_is_not_positive_is_refused_and_false(name: str, sign: int):
    """A max-separable claim with 0 or less for what has to be above 0."""
    problem = region_problem(QUICK)
    document = json.loads(certificate_bytes(certified(problem).claims))
    oracle = Oracle(problem)
    assert recheck(json.dumps(document).encode(), problem).holds
    assert oracle.false_claims(document) == []
    check = next(each for each in document["checks"] if each["id"] == "max-separable")
    holder = check["domain"] if name == "radius" else check
    holder[name] = sign * holder[name]
    assert not recheck(json.dumps(document).encode(), problem).holds
    said = oracle.false_claims(document)
    assert any(text.startswith("max-separable") for text in said)


def test_random_changes_of_regional_claims_reach_the_domain_and_every_exact_value():
    domain = {"kind": "box", "radius": 1.0, "disturbance": 0.5}
    exact = {"v": ["1", "2"], "alpha": "1/2", "rho": "3"}
    check = {
        "id": "max-separable",
        "verdict": "proved",
        "domain": domain,
        "rate": 0.25,
        "exact": exact,
    }
    reached = set()
    for seed in range(300):
        changed = change_region({"checks": [check]}, seed)["checks"][0]
        reached |= {name for name in ("verdict", "rate") if changed[name] != check[name]}
        if isinstance(changed["domain"], dict):
            reached |= {name for name in domain if changed["domain"].get(name) != domain[name]}
        reached |= {name for name in exact if changed["exact"].get(name) != exact[name]}
    assert reached == {"verdict", "rate", *domain, *exact}


def test_no_region_of_two_agents_holds_another_equilibrium():
    tally = equilibrium_campaign([FAST_PAIR])
    assert not tally.wrong, tally.wrong
    assert sum(map(len, tally.ratios.values())) >= 1


def test_linear_networks_are_proved_where_the_eigenvalues_are_stable_and_never_too_fast():
    tally = linear_campaign(range(6))
    assert not tally.wrong, tally.wrong
    found = {name.rpartition(":")[0] for name in tally.counts}
    assert found == {
        "linear stable",
        "linear not stable",
    }


@pytest.mark.parametrize(("c", "holds"), [(1815, True), (1814, False)])
def test_a_row_without_room_at_the_target_is_seen_exactly(c, holds):
    """tanh(0.712 s) + tanh(1.103 s) < 1.815 s for s > 0, and the slopes at 0 are equal."""
    h = read_coupling(("tanh(y)",), 1, 2000)
    arcs = (Heard(h, Fraction(1), 1712, False), Heard(h, Fraction(1), 2103, False))
    curves = both_faces([h], -1.0, 1.0)
    row = Row(1000, Fraction(c), arcs)
    assert curved_row(row, 1000, Fraction(1, 5), curves, EXACT) is holds
