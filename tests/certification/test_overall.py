"""The overall verdict, by the rules of the contract ("Overall verdict"), with and without a
region."""

from dataclasses import replace
from fractions import Fraction

import pytest
from certified import at_the_consensus, consensus_claims
from networks import linked

from dobc_design import Certificate, Check, Exosystem, Observer, Verdict, certify, verify
from dobc_design.certification.overall import decide_overall
from dobc_design.conditions.consensus.claim import Unstable
from dobc_design.conditions.coverage import asked_radius, covers
from dobc_design.conditions.domain import domain_from_json
from dobc_design.loop.make import loop_of

PROVED, REFUTED, UNDECIDED = Verdict.PROVED, Verdict.REFUTED, Verdict.UNDECIDED
PAIR = [[1, 2], [2, 1]]
CONSTANT = Exosystem(A=[[0]], C=[[1]])


def problem(arcs=PAIR, h="y", gains=1, **more):
    return linked(arcs, coupling=h, gains=gains, **more)


def consensus(each):
    """The certificate of network, observer, theorems and linearisation alone."""
    return Certificate(problem=each, claims=consensus_claims(each))


def verdict(*args, **more):
    """The verdict from these."""
    each = problem(*args, **more)
    claims = consensus_claims(each)
    assert verify(claims, each).holds
    return claims.verdict


def searched(*args, **more):
    """The verdict once proofs for the region were looked for as well."""
    each = problem(*args, **more)
    certificate = certify(each)
    assert verify(certificate, each).holds
    return certificate.verdict


def region(lo, hi, disturbance=None):
    asked = {"initial_states": [lo, hi]}
    if disturbance is not None:
        asked["initial_disturbance"] = disturbance
    return asked


def overall(each, checks, W=None):
    """The verdict of these checks."""
    return decide_overall(loop_of(each), checks, W).verdict


def test_lemma_1_takes_the_place_of_theorem_1_without_an_exosystem():
    certificate = consensus(problem())
    assert certificate.verdict is PROVED
    assert certificate.covered_by == "lemma1"
    # with one it proves nothing alone: W given and bad
    growing = Observer(W=[[-1]])
    unstable = problem(exosystem=CONSTANT, observer=growing)
    certificate = consensus(unstable)
    assert certificate.check("lemma1").verdict is PROVED
    assert certificate.verdict is REFUTED
    decaying = Observer(W=[[1]])
    stable = problem(exosystem=CONSTANT, observer=decaying)
    certificate = consensus(stable)
    # at a better rate than theorem1, which is proved as well
    assert certificate.covered_by == "theorem1-weighted"
    assert certificate.check("theorem1").verdict is PROVED


def test_lemma_1_has_to_hold_in_every_mode_and_the_slowest_speaks():
    """One V = e'e for all modes, at the rate of the slowest; one V = e'De is faster; a mode that
    fails spoils e'e."""
    two = {"a": PAIR, "b": [[1, 2]]}
    certificate = consensus(problem(two, gains={1: 2, 2: 2}))
    assert certificate.verdict is PROVED
    plain = min(certificate.check("lemma1", mode).rate for mode in two)
    assert certificate.covered_by == "theorem2-weighted"
    # the eigenvalues are 2 and 4, 2 and 3
    assert plain < certificate.rate <= 2
    strong = [[1, 2, 50]]
    modes = {"a": PAIR, "b": strong}
    failing = consensus(problem(modes, gains=1))
    assert failing.check("lemma1", "a").verdict is PROVED
    assert failing.check("lemma1", "b").verdict is REFUTED
    assert failing.covered_by == "theorem2-weighted"


def test_a_local_proof_never_covers_a_region():
    """Domain "consensus" names no radius, however small the region; only proofs for the region
    do."""
    assert verdict(h="tanh(y)") is PROVED
    large = region(-1, 1)
    for asked in (large, region("-1/1000000", "1/1000000"), region(0, 0)):
        assert verdict(h="tanh(y)", region=asked) is UNDECIDED
        assert searched(h="tanh(y)", region=asked) is PROVED


def test_a_global_proof_covers_every_region():
    """Exactly linear couplings: J does not depend on e.  One nonlinear exception makes the proof
    local."""
    assert verdict(region=region(-(10**9), 10**9)) is PROVED
    assert verdict(h="y*exp(1)", region=region(0, 5)) is PROVED
    assert verdict(exosystem=CONSTANT, region=region(0, 5, 100)) is PROVED
    assert verdict(exceptions={(0, 1): "sin(y)"}) is PROVED
    exceptions = {(0, 1): "sin(y)"}
    assert verdict(exceptions=exceptions, region=region(0, 1)) is UNDECIDED


def made_up(domain, **more):
    """A proof of a region; ``domain`` as a certificate has it."""
    where = domain_from_json(domain)
    return Check(id="lure", verdict=PROVED, domain=where, reason="", margin=0.0, rate=1.0, **more)


#: Domains as a certificate has them, and whether they hold what is asked below.
DOMAINS = []


def domain(answer, kind, radius, disturbance=None):
    """One more domain."""
    found = {"kind": kind, "radius": radius}
    if disturbance is not None:
        found["disturbance"] = disturbance
    DOMAINS.append((found, answer))


domain(True, "box", 4.0, 0.5)
domain(False, "box", 3.999, 0.5)
domain(False, "box", 4.0, 0.4999)
domain(False, "box", 4.0)
# 16 * 2 agents, sqrt(32) = 5.65685...
domain(True, "ball", 5.6569, 1)
domain(False, "ball", 5.6568, 1)
domain(False, "ball", -5.6569, 1)
domain(False, "cube", 100.0, 1)
DOMAINS.append(({"radius": 100.0, "disturbance": 1}, False))
DOMAINS.append(("consensus", False))
DOMAINS.append(("global", True))


@pytest.mark.parametrize(("domain", "answer"), DOMAINS)
def test_coverage_is_compared_exactly(domain, answer):
    """R_c = max |lo - xbar|, |hi - xbar| = 4; a ball needs R^2 >= n sum R_c^2."""
    start = region(0, 5, 0.5)
    asked = problem(h="tanh(y)", exosystem=CONSTANT, target=1, region=start)
    check = made_up(domain)
    assert covers(loop_of(asked), check, [check]) is answer
    assert overall(asked, [check]) is (PROVED if answer else UNDECIDED)


def test_a_radius_that_is_a_decimal_is_read_as_its_text():
    """0.1 + 0.2 is 0.30000000000000004 as it is written, and 0.1 is 1/10."""
    asked = problem(h="tanh(y)", region=region(0, "1/10"))
    box = {"kind": "box", "disturbance": 0.0}
    enough = made_up(box | {"radius": 0.1})
    assert covers(loop_of(asked), enough, [])
    less = made_up(box | {"radius": 0.09999999999999999})
    assert not covers(loop_of(asked), less, [])
    # formation offsets enlarge the radius that is asked for
    asked = problem(h="tanh(y)", target=1, offsets={2: -3}, region=region(0, 5))
    assert asked_radius(loop_of(asked)) == (Fraction(7),)


def test_agents_out_of_reach_in_all_modes_refute():
    assert verdict(gains=None) is REFUTED
    two_pairs = [[1, 2], [2, 1], [3, 4], [4, 3]]
    assert verdict(two_pairs, gains={1: 1}) is REFUTED
    assert verdict(two_pairs, gains={1: 1, 4: 1}) is PROVED
    # h(0) = 0 is enough: together they stay
    assert verdict(h="clip(y, -1, 1)", gains=None) is REFUTED
    assert verdict(h="clip(y, -1, 1)", gains={1: 1}) is UNDECIDED


def test_agents_out_of_reach_in_one_mode_only_leave_the_whole_undecided():
    """Mode a: 3 hears 2; mode b: 2 hears the pinned 1. In alternation they converge."""
    modes = {"a": [[3, 2]], "b": [[2, 1]]}
    asked = problem(modes, gains={1: 1})
    certificate = consensus(asked)
    assert certificate.verdict is UNDECIDED
    # texts never decide
    silent = [replace(check, reason="") for check in certificate.checks]
    assert overall(asked, silent) is UNDECIDED
    for mode in modes:
        assert certificate.check("reachability", mode).verdict is REFUTED
    # 2 is heard, but hears nobody
    one_mode = {"a": [[3, 2]]}
    assert verdict(one_mode, gains={3: 1}) is REFUTED
    assert consensus(linked([], 1, gains=1)).verdict is PROVED
    assert consensus(linked([], 1)).verdict is REFUTED


def test_agents_out_of_reach_refute_a_region_only_if_it_lets_them_start_apart():
    """e_S = c needs one c != 0 that every agent of S may start with."""
    assert verdict(gains=None, region=region(0, 5)) is REFUTED
    # they start at the target
    assert searched(gains=None, target=1, region=region(1, 1)) is UNDECIDED
    assert verdict(gains=None, target=1, region=region(2, 2)) is REFUTED
    # With offsets 0 and 3 and starts in [0, 1] the agents cannot be apart by one common c.
    assert searched(gains=None, offsets={2: 3}, region=region(0, 1)) is UNDECIDED
    assert verdict(gains=None, offsets={2: "1/2"}, region=region(0, 1)) is REFUTED


def test_a_given_gain_refutes_where_its_error_reaches_the_agents_and_a_designed_one_never():
    """The second state is hidden from C and grows; with W = (1, 0) the visible error decays."""
    for w, answer in ((-1, REFUTED), (0, REFUTED), (1, PROVED)):
        observer = Observer(W=[[w]])
        assert verdict(exosystem=CONSTANT, observer=observer) is answer
    A = [[0, 0], [0, 1]]
    C = [[1, 0]]
    exosystem = Exosystem(A=A, C=C)
    for w, answer in ((1, UNDECIDED), (-1, REFUTED)):
        assert verdict(exosystem=exosystem, observer=Observer(W=[[w], [0]])) is answer
    # initial_disturbance = 0: xihat(0) = xi(0) is known.
    bad = {"exosystem": CONSTANT, "observer": Observer(W=[[-1]])}
    assert verdict(**bad, region=region(0, 5, 0)) is UNDECIDED
    assert verdict(**bad, region=region(0, 5, "1/1000")) is REFUTED
    # Only the W of the problem refutes: another one can be designed.
    W = ((Fraction(-1),),)
    free = problem(h="abs(y)", exosystem=CONSTANT)
    assert overall(free, [], W) is UNDECIDED
    given = problem(h="abs(y)", **bad)
    assert overall(given, [], W) is REFUTED


def test_an_unstable_linearisation_refutes_and_enough_pinning_cures_it():
    """h = -y on two arcs: J - K has the eigenvalues 2 - k and -k."""
    slight = {"h": "-y", "gains": "1/2"}
    assert verdict(**slight) is REFUTED
    # eigenvalue 0: neither
    assert verdict(h="-y", gains=2) is UNDECIDED
    assert verdict(h="-y", gains=3) is PROVED
    assert verdict(h="-sin(y)", gains="1/2") is REFUTED
    # one mode among several is enough: all the time in it is allowed
    arcs = [[1, 2]]
    modes = {"good": [], "bad": PAIR, "other": arcs}
    assert consensus(problem(modes, **slight)).verdict is REFUTED
    good = linked({"good": [], "other": []}, 2, coupling="-y", gains="1/2")
    assert consensus(good).verdict is PROVED
    # it is about starts near the target
    assert verdict(**slight, region=region(-1, 1)) is REFUTED
    assert verdict(**slight, region=region(1, 2)) is UNDECIDED
    # every start there has e_1 >= 0 in one component, so those near the target are not all allowed
    half = {"initial_states": [[0, 1], [-1, 1]]}
    assert verdict(**slight, target=[0, 0], region=half) is UNDECIDED
    # slopes that turn: J - K = -(L (x) R) - K with complex eigenvalues
    cycle = [[1, 2], [2, 3], [3, 1]]
    turned = ["y2", "-y1"]
    for gains, answer in (("1/10", REFUTED), (5, PROVED)):
        assert verdict(cycle, turned, gains=gains, target=[0, 0]) is answer


@pytest.mark.parametrize("kind", [PROVED, UNDECIDED])
def test_instability_is_believed_of_a_refuted_lemma_only(kind):
    """A certificate that says "unstable_roots" anywhere else must not turn the verdict."""
    asked = problem(h="tanh(y)", region=region(-1, 1))
    checks = []
    for check in at_the_consensus(consensus(asked).checks):
        bent = replace(check, claim=Unstable(roots=1), verdict=kind)
        checks.append(bent if check.id == "lemma1" else check)
    assert overall(asked, checks) is UNDECIDED


def test_a_gain_that_leaves_a_direction_free_refutes_and_a_skew_one_does_not():
    """k c = 0 for one c on a set that hears nobody else: e_S = c is an equilibrium (theory, section
    2)."""
    first = [[1, 0], [0, 0]]
    for gain in (first, [[1, -1], [-1, 1]]):
        assert verdict(gains={1: gain}, target=[0, 0]) is REFUTED
    both = {1: first, 2: [[0, 0], [0, 1]]}
    assert verdict(gains=both, target=[0, 0]) is not REFUTED
    # by lure: e stays in no kernel of k
    gains = {1: [[0, 1], [-1, 0]]}
    assert searched(gains=gains, target=[0, 0]) is PROVED
    # a region only if it can be started along
    along = {"initial_states": [[-1, 1], [-1, 1]]}
    assert verdict(gains={1: first}, target=[0, 0], region=along) is REFUTED
    across = {"initial_states": [[-1, 1], [0, 0]]}
    assert verdict(gains={1: first}, target=[0, 0], region=across) is not REFUTED
    spiral = [[1, 1], [-1, 1]]
    gains_of_both = {1: spiral, 2: 1}
    assert verdict(gains=gains_of_both, target=[0, 0]) is PROVED
