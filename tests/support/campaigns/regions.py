"""Random problems that ask for a region, their certificates, and changes of what these say about
regions."""

import json
from collections.abc import Iterable
from fractions import Fraction
from random import Random
from typing import Any

import networks
from oracles.regions import IDS
from oracles.theorems import Oracle
from random_problems import random_problem

from campaigns.certificates import Tally, judge_mutant
from campaigns.known_regions import two_agents
from dobc_design import Exosystem, Observer, Problem, certify, verify
from dobc_design.certificate.text import certificate_bytes
from dobc_design.problem.canonical import canonical_document, problem_from_canonical

COUPLINGS = (
    *networks.MONOTONE,
    *networks.TURNING,
    "clip(y, -1, 1)",
    "y + abs(y)/3",
)
WIDE = ("", "-", "0", "1", "-1", "1/0", "NaN", None, [], {}, True, 0, -1, 1e308)
NEAR = tuple(
    Fraction(x)
    for x in (
        "1.001",
        "0.999",
        "1.000001",
        "0.999999",
        "1.0000000001",
        "2",
        "0.5",
        "-1",
        "0",
        "1.1",
    )
)


def region_problem(seed: int) -> Problem:
    """Half of them held by their pins, with couplings that act by component; two agents; any
    kind."""
    r = Random(f"regions {seed}")
    reach = r.choice(("1/4", "1/2", 1, 2, 4))
    if seed % 4 == 3:
        return two_agents(seed).problem
    if seed % 4 == 1:
        document = canonical_document(random_problem(seed))
        states = [[str(-Fraction(reach)), str(Fraction(reach))]] * document["dimension"]
        quiet = None if document["exosystem"] is None else r.choice(("0", "1/2", "1/10"))
        document["region"] = {"initial_states": states, "initial_disturbance": quiet}
        return problem_from_canonical(json.dumps(document).encode())
    noisy = r.random() < 0.5
    region: dict[str, Any] = {"initial_states": [-Fraction(reach), Fraction(reach)]}
    if noisy:
        region["initial_disturbance"] = r.choice((0, "1/10", "1/2"))
    return networks.random_problem(
        seed,
        couplings=COUPLINGS,
        n=r.randint(2, 4),
        modes=r.choice((1, 1, 2)),
        held=True,
        region=region,
        exosystem=Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]]) if noisy else None,
        observer=Observer(W=[["16/5"], ["12/5"]]) if noisy else None,
    )


def region_recheck_campaign(seeds: Iterable[int]) -> Tally:
    """Both checkers accept every certificate, and the oracle finds nothing false in it."""
    tally = Tally()
    for seed in seeds:
        problem = region_problem(seed)
        certificate = certify(problem)
        data = certificate_bytes(certificate.claims)
        tally.wrong += [f"{seed}: {failure}" for failure in verify(data, problem).failures]
        tally.wrong += [
            f"{seed}: not true: {what}" for what in Oracle(problem).false_claims(json.loads(data))
        ]
        tally.counts[f"region {certificate.verdict.value}"] += 1
        for check in certificate.checks:
            if check.id in IDS and check.verdict.value != "undecided":
                tally.counts[f"{check.id} {check.verdict.value}"] += 1
    return tally


def region_mutant_campaign(seeds: Iterable[int], *, each: int) -> Tally:
    """Changed regional claims: both checkers agree, and the oracle contradicts nothing that they
    accept."""
    tally = Tally()
    for seed in seeds:
        problem = region_problem(seed)
        certificate = certify(problem, everything=seed % 4 == 3)
        document = json.loads(certificate_bytes(certificate.claims))
        oracle = Oracle(problem)
        if not any(
            check["id"] in IDS and check["verdict"] != "undecided" for check in document["checks"]
        ):
            tally.counts["nothing to change"] += each
            continue
        for k in range(each):
            changed = change_region(document, seed * 100_000 + k)
            judge_mutant(tally, f"{seed}, {k}", changed, document, problem, oracle)
    return tally


def change_region(document: dict[str, Any], seed: int) -> dict[str, Any]:
    """A copy in which one number (or text) of one regional check is another: a radius, a rate, an
    entry."""
    r = Random(seed)
    copy: dict[str, Any] = json.loads(json.dumps(document))
    checks = [
        check for check in copy["checks"] if check["id"] in IDS and check["verdict"] != "undecided"
    ]
    check = r.choice(checks)
    if isinstance(check["domain"], dict) and r.random() < 0.25:
        parts = [check["domain"]]
    else:
        parts = [check.get("exact") or {}]
    places = [place for part in parts for place in _leaves(part)] or [(check, "rate")]
    if r.random() < 0.1:
        places = [(check, "rate"), (check, "verdict"), (check, "domain")]
    if r.random() < 0.2:
        names = {name for _, name in places}
        one = r.choice(sorted(names, key=str))
        places = [place for place in places if place[1] == one]
    holder, name = r.choice(places)
    holder[name] = _other(holder[name], r)
    return copy


def _leaves(tree: Any) -> list[tuple[Any, Any]]:
    keys = (
        list(tree) if isinstance(tree, dict) else range(len(tree)) if isinstance(tree, list) else []
    )
    below = [(tree, name) for name in keys if not isinstance(tree[name], (dict, list))]
    return below + [
        place
        for name in keys
        if isinstance(tree[name], (dict, list))
        for place in _leaves(tree[name])
    ]


def _other(value: Any, r: Random) -> Any:
    if r.random() < 0.1:
        return r.choice(WIDE)
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return r.choice((float(value * r.choice(NEAR)), -value, 0.0, value + 1))
    try:
        number = Fraction(value)
    except (TypeError, ValueError, ZeroDivisionError):
        return r.choice(WIDE)
    return str(
        r.choice(
            (
                number * r.choice(NEAR),
                number * r.choice(NEAR),
                number + Fraction(1, 10**30),
                -number,
            )
        )
    )
