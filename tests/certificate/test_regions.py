"""Certified regions side by side: every number follows from the claims and is rounded towards the
weaker one.

The claims are made by hand, so that the expected numbers are those of a pencil and a sheet of
paper.
"""

import dataclasses
import json
import math
from fractions import Fraction
from typing import Any

import pytest

from dobc_design import Certificate, Exosystem, Network, Observer, Problem, Region, Verdict
from dobc_design.certificate.claims import Claims
from dobc_design.certificate.regions import AgentBound, RegionClaim, Regions
from dobc_design.conditions.check import Check, Values, Witness
from dobc_design.conditions.domain import EVERYWHERE, NEAR_TARGET, Ball, Box
from dobc_design.conditions.numbers import claimed
from dobc_design.conditions.quadratic.claim import Lure
from dobc_design.conditions.reason import Reason
from dobc_design.errors import CertificateError
from dobc_design.exact.symmetric import SparseSymmetric


def chain(n: int = 2, **changes: Any) -> Problem:
    """Agents in a row behind the pinned first one, about the target 1."""
    arcs_of_mode = [(i + 1, i) for i in range(1, n)]
    arcs = {"G": arcs_of_mode}
    settings: dict[str, Any] = {"name": "chain", "target": 1}
    settings["network"] = Network.from_arcs(arcs, arrow="listens_to", agents=n)
    settings |= {"coupling": "sin(y)", "gains": {1: 2}}
    return Problem(**settings | changes)


def asking(interval: list[Any]) -> Region:
    return Region(initial_states=[interval], initial_disturbance=None)


def regions(problem: Problem, *checks: Check, verdict: Verdict = Verdict.UNDECIDED) -> Regions:
    claims = Claims(
        problem_name=problem.name,
        problem_sha256="0" * 64,
        verdict=verdict,
        why=Reason(head="Here is why."),
        checks=checks,
        rate=None,
        covered_by=None,
        W=None,
        gain_source=None,
        P=None,
        Q=None,
        notes=(),
        version="0",
    )
    return Certificate(problem=problem, claims=claims).regions


def only(found: Regions) -> RegionClaim:
    (claim,) = found.claims
    return claim


def max_separable(
    *, radius: float = 1.0, disturbance: float = 0.0, rate: float = 0.5, **exact: Any
) -> Check:
    claim = Values({"v": ["1", "2"], "alpha": "1/2", "rho": "1", **exact})
    return Check(
        id="max-separable",
        verdict=Verdict.PROVED,
        rate=rate,
        domain=Box(radius, disturbance),
        reason="from every start V decays. The box stops there.",
        claim=claim,
    )


def lure(*, radius: float, P_e: list[list[Any]], level: str = "1", rate: float = 1.0) -> Check:
    size = 1 + max(j for _, j, _ in P_e)
    entries = {(i, j): Fraction(x) for i, j, x in P_e}
    form = SparseSymmetric(size, entries)
    one = Fraction(1)
    claim = Lure(P_e=form, ranges=(), radius=one, level=Fraction(level), rate=one)
    return Check(
        id="lure",
        verdict=Verdict.PROVED,
        rate=rate,
        domain=Ball(radius, 0.0),
        reason="from every start in a ball V decays.",
        claim=claim,
    )


def local(id: str, reason: str, **more: Any) -> Check:
    """A check about the target itself, proved unless more is said."""
    known: dict[str, Any] = {"verdict": Verdict.PROVED, "domain": NEAR_TARGET}
    return Check(id=id, reason=reason, **known | more)


def test_a_ball_holds_a_box_that_is_smaller_by_the_root_of_its_dimension():
    """The corner (b, ..., b) of the box has the norm b sqrt(n m)."""
    unit = [[i, i, "1"] for i in range(4)]
    ball = lure(radius=2.0, P_e=unit)
    claims = regions(chain(4), ball)
    claim = only(claims)
    assert claim.kind == "ball"
    assert claim.box == 1.0
    assert claim.ball == 2.0
    assert claim.variant == "P_e diagonal"


def test_a_box_holds_the_ball_of_its_radius_and_the_box_in_a_ball_is_rounded_down():
    P_e = [[0, 0, "1"], [1, 1, "1"]]
    ball = lure(radius=1.0, P_e=P_e)
    claim = only(regions(chain(2), ball))
    assert claim.box is not None
    box = claimed(claim.box)
    assert 2 * box**2 <= 1
    assert 2 * (box + Fraction(1, 10**6)) ** 2 > 1
    claim = only(regions(chain(), max_separable(radius=0.75)))
    assert claim.kind == "box"
    assert claim.box == claim.ball == 0.75


def test_what_is_asked_is_rounded_up():
    """x in [0, 5] about 1 is |e| <= 4; ten agents need a ball of sqrt(160) = 12.649110640673..."""
    found = regions(chain(10, region=asking([0, 5])))
    asked = found.asked
    assert asked is not None
    assert asked.box == 4.0
    assert asked.interval == (0.0, 5.0)
    ball = claimed(asked.ball)
    assert ball**2 >= 160
    assert (ball - Fraction(2, 10**7)) ** 2 < 160


def test_every_agent_has_its_share_of_the_box_after_what_the_observer_takes():
    """rho = 3, kappa s sqrt(size) = 1 * 1/2 * 2 = 1, so |e_i| <= 2 v_i."""
    exosystem = Exosystem(A=[[0]], C=[[1]])
    observer = Observer(W=[[4]])
    problem = chain(exosystem=exosystem, observer=observer)
    part = {"P": [["4"]], "beta": "3", "kappa": "1", "size": "4"}
    check = max_separable(radius=1.5, disturbance=0.5, rho="3", **part)
    first, second = regions(problem, check).agents
    assert first == AgentBound(label="1", bound=2.0, pinned=True, goal=1.0)
    assert second == AgentBound(label="2", bound=4.0, pinned=False, goal=1.0)


def test_the_time_of_a_box_is_the_least_that_the_rate_proves():
    """|e_2| starts at 1 = v_2 / 2 at most, V at 1; 0.01 / 2 is reached after ln(200) / 0.5 =
    10.5966 s."""
    claim = only(regions(chain(), max_separable()))
    assert claim.time is not None
    assert 2 * math.exp(-0.5 * claim.time) <= 0.01
    assert 2 * math.exp(-0.5 * (claim.time - 0.02)) > 0.01


def test_the_time_of_a_ball_takes_the_softest_direction_of_its_weights():
    """e'P_e e <= 4 with P_e = diag(4, 1) allows |e_2| = 2; the tolerance is 1 % of the radius 1."""
    P_e = [[0, 0, "4"], [1, 1, "1"]]
    ball = lure(radius=1.0, P_e=P_e, level="4")
    claim = only(regions(chain(), ball))
    assert claim.time is not None
    assert 2 * math.exp(-claim.time) <= 0.01
    assert 2 * math.exp(-(claim.time - 0.02)) > 0.01
    assert claim.variant == "P_e diagonal"


def test_times_of_all_methods_are_about_one_tolerance():
    box = max_separable()
    P_e = [[0, 0, "1"], [1, 1, "1"]]
    ball = lure(radius=0.5, P_e=P_e)
    assert regions(chain(), box, ball).tolerance == 0.005
    asked = chain(region=asking([0, 2]))
    assert regions(asked, box, ball).tolerance == 0.01


@pytest.mark.parametrize(("low", "covers"), [("0", True), ("-0.001", False)])
def test_a_box_covers_what_fits_into_it_and_nothing_more(low: str, covers: bool):
    problem = chain(region=asking([low, 1]))
    claim = only(regions(problem, max_separable()))
    assert claim.covers is covers
    assert (claim.limit == "") is covers


def test_the_reason_for_a_limit_names_a_coupling_that_falls():
    """sin falls beyond pi/2; in a box of 1 with v = (1, 2), rho = 1, two agents may differ by 3."""
    problem = chain(region=asking([-4, 4]))
    limit = only(regions(problem, max_separable())).limit
    assert limit.startswith("The box stops there. Two agents in this box may differ by 3,")
    assert "sin(y) does not rise" in limit
    rising = chain(region=asking([-4, 4]), coupling="tanh(y)")
    assert only(regions(rising, max_separable())).limit == "The box stops there."


def test_a_local_proof_has_no_radius_and_one_for_every_start_needs_none():
    check = local("lemma1", "yes.", mode="G", rate=0.1)
    claims = regions(chain(), check)
    claim = only(claims)
    assert claim.kind == "near"
    assert claim.box is None
    assert claim.time is None
    assert "states no radius" in claim.limit
    linear = chain(coupling="2*y", region=asking([0, 2]))
    everywhere = dataclasses.replace(max_separable(rho=None), domain=EVERYWHERE)
    claim = only(regions(linear, everywhere))
    assert claim.kind == "everywhere"
    assert claim.box is None
    assert claim.covers
    assert claim.limit == ""
    assert claim.time is not None
    assert 2 * math.exp(-0.5 * claim.time) <= 0.01


def test_lemma_1_of_several_modes_is_one_row_of_the_slowest_or_of_the_one_that_fails():
    modes = {"G": [(2, 1)], "H": [(2, 1)]}
    problem = chain(network=Network.from_arcs(modes, arrow="listens_to", agents=2))
    slow = local("lemma1", "slow.", mode="G", rate=0.1)
    fast = local("lemma1", "fast.", mode="H", rate=0.2)
    fails = local("lemma1", "it fails.", mode="H", verdict=Verdict.REFUTED)
    assert only(regions(problem, slow, fast)).rate == 0.1
    assert only(regions(problem, slow, fails)).limit == "it fails."


def test_with_a_disturbance_lemma_1_and_the_printed_matrix_are_left_to_the_list_of_checks():
    exosystem = Exosystem(A=[[0]], C=[[1]])
    observer = Observer(W=[[4]])
    problem = chain(exosystem=exosystem, observer=observer)
    lemma = local("lemma1", "yes.", mode="G")
    printed = local("theorem1-printed", "yes.")
    theorem = local("theorem1", "yes.")
    found = regions(problem, lemma, printed, theorem)
    assert [claim.id for claim in found.claims] == ["theorem1"]
    assert not found.tried
    assert not found.sized


UNREADABLE: list[dict[str, Any]] = [{"v": ["1"]}, {"v": ["1", "0"]}, {"v": 7}]
UNREADABLE += [{"rho": "none"}, {"alpha": None}, {"extra": "1"}]


@pytest.mark.parametrize("exact", UNREADABLE)
def test_claims_that_cannot_be_read_are_a_certificate_error(exact: dict[str, Any]):
    """A certificate file may come from anybody, and nobody has verified it yet."""
    told = "a regional check of this certificate cannot be read"
    with pytest.raises(CertificateError, match=told):
        regions(chain(), max_separable(**exact))


def test_another_equilibrium_is_told_by_its_distance():
    witness = Witness(kind="start", values=("-33/20", "8/5"))
    check = local("equilibrium", "it rests.", verdict=Verdict.REFUTED, witness=witness)
    assert regions(chain(), check).rest == 1.65
    undecided = local("equilibrium", "none found.", verdict=Verdict.UNDECIDED)
    assert regions(chain(), undecided).rest is None
    assert regions(chain()).rest is None


def test_the_text_and_the_table_say_the_same_as_the_json():
    asked = chain(region=asking([0, 2]))
    found = regions(asked, max_separable(), verdict=Verdict.PROVED)
    document = json.loads(json.dumps(found.to_json(), allow_nan=False))
    assert document["asked"] == {"box": 1.0, "ball": 1.41421357, "disturbance": 0.0}
    assert document["regions"][0]["box"] == 1.0
    assert document["agents"][1] == {"label": "2", "bound": 2.0, "pinned": False}
    assert "chain: PROVED. Here is why." in str(found)
    assert "max-separable" in str(found)
    page = found._repr_html_()
    assert "<td>max-separable</td>" in page
    assert "<td>yes</td>" in page
    assert "<b>x" not in regions(chain(name="<b>x"))._repr_html_().replace("<p><b>", "")
