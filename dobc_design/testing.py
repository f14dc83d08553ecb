"""Assertions about theorem conditions, for unit tests of your own; any test runner will do.

    from dobc_design.testing import assert_proved

    def test_the_fleet_reaches_its_target():
        assert_proved("fleet.toml", rate=0.5)

A failure is an AssertionError that says which condition failed, why, with which witness, and what
would cure it.  What passes is decided exactly, as by ``certify``; nothing is compared in floats.
"""

from collections.abc import Iterable, Iterator, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from .certificate.certificate import Certificate
from .certification.certify import certify, verify
from .conditions.check import Check, Witness
from .conditions.kinds import KINDS
from .conditions.numbers import claimed
from .errors import SpecError
from .exact.number import Number, parse_number
from .problem.changes import change_lines
from .problem.load import Source, load_problem
from .problem.region import Region
from .verdict import Verdict

__all__ = ["assert_condition", "assert_proved", "assert_refuted", "assert_verified"]


def assert_proved(
    problem: Source,
    *,
    rate: Number | None = None,
    region: Region | Mapping[str, Any] | None = None,
) -> Certificate:
    """The verdict of ``certify`` is proved, with at least ``rate`` (1/s), from ``region``.

    ``problem``: a Problem, a path or a built-in name; ``region`` takes the place of its own.
    Returns: the certificate.  Raises: AssertionError with reasons, witnesses and cures otherwise;
    SpecError for a wrong problem or a rate <= 0.
    Example:
        >>> from dobc_design.testing import assert_proved
        >>> assert_proved("clock-sync").covered_by
        'theorem1-weighted'
    """
    __tracebackhide__ = True
    stated = load_problem(problem)
    if region is not None:
        stated = stated.replace(region=region)
    certificate = certify(stated, rate=rate)
    if certificate.verdict is not Verdict.PROVED:
        raise AssertionError(_told(certificate, Verdict.PROVED))
    _require("rate", stated.name, certificate.rate, rate, [f"  Reason: {certificate.reason}"])
    return certificate


def assert_refuted(problem: Source) -> Certificate:
    """The verdict of ``certify`` is refuted: there is a proof that consensus fails.

    Returns: the certificate.  Raises: AssertionError with the reason otherwise.
    Example:
        >>> from dobc_design.testing import assert_refuted
        >>> problem = dd.load_problem("paper-fixed")
        >>> assert_refuted(problem.replace(gains={})).verdict.value
        'refuted'
    """
    __tracebackhide__ = True
    certificate = certify(problem)
    if certificate.verdict is not Verdict.REFUTED:
        raise AssertionError(_told(certificate, Verdict.REFUTED))
    return certificate


def assert_condition(
    problem: Source,
    condition: str,
    *,
    mode: str | None = None,
    verdict: Verdict = Verdict.PROVED,
    rate: Number | None = None,
    margin: Number | None = None,
) -> Check:
    """One condition has this verdict: "lemma1", "theorem1", "hurwitz", "max-separable", ...

    ``condition``: an id as `dobc explain` lists them; ``mode``: of a condition that is decided for
    each mode, by default all of them; ``rate`` (1/s) and ``margin``: at least that is proved.
    Returns: the check, the last one of several modes.
    Raises: AssertionError otherwise; SpecError for an id that does not exist.
    Example:
        >>> from dobc_design.testing import assert_condition
        >>> assert_condition("paper-fixed", "hurwitz", rate=1).id
        'hurwitz'
    """
    __tracebackhide__ = True
    if condition not in KINDS:
        near = ", ".join(get_close_matches(condition, KINDS, n=2))
        cure = f"Did you mean {near}?" if near else f"They are {', '.join(KINDS)}."
        raise SpecError(f"There is no condition {condition!r}.", key="condition", cure=cure)
    stated = load_problem(problem)
    certificate = certify(stated)
    same = _checks(certificate, condition)
    if not same:  # a condition that was not needed for the verdict
        certificate = certify(stated, everything=True)
        same = _checks(certificate, condition)
    if not same:
        present = ", ".join(dict.fromkeys(check.title for check in certificate.checks))
        raise AssertionError(f"{condition} was not examined here. There are {present}.")
    chosen = [check for check in same if mode in (None, check.mode)]
    if not chosen:
        modes = ", ".join(check.mode for check in same if check.mode is not None)
        raise AssertionError(f"{condition} has no mode {mode!r}; its modes are {modes or 'none'}.")
    for check in chosen:
        if check.verdict is not verdict:
            words = f"{check.title} is {check.verdict.value}, not {verdict.value}."
            raise AssertionError("\n".join([words, *_about(check)]))
        _require("rate", check.title, check.rate, rate, _about(check))
        _require("margin", check.title, check.margin, margin, _about(check))
    return chosen[-1]


def _checks(certificate: Certificate, condition: str) -> list[Check]:
    """The checks of this id, in all modes."""
    return [check for check in certificate.checks if check.id == condition]


def assert_verified(folder: str | Path, problem: Source) -> None:
    """The certificate in ``folder`` holds for ``problem``, in both programs.

    Raises: AssertionError naming the claims that fail; CertificateError where it cannot be read.
    Example:
        >>> from dobc_design.testing import assert_verified
        >>> certificate = dd.certify("clock-sync")
        >>> paths = certificate.save("clock-sync-certificate")
        >>> assert_verified("clock-sync-certificate", "clock-sync")
    """
    __tracebackhide__ = True
    data = (Path(folder) / "certificate.json").read_bytes()
    found = verify(data, problem)
    if not found.holds:
        raise AssertionError(f"The certificate in {folder} does not hold.\n{found}")


def _require(
    name: str, who: str, proved: float | None, wanted: Number | None, why: Iterable[str]
) -> None:
    """Raises: AssertionError unless the proved number reaches a wanted one, exactly."""
    __tracebackhide__ = True  # so that pytest shows the test, and not these lines
    if wanted is None:
        return
    least = parse_number(wanted, key=name)
    if proved is not None and claimed(proved) >= least:
        return
    told = f"the proved {name} is {proved}, less than the {float(least):.6g} asked."
    if proved is None:
        told = f"proved without a {name}; {float(least):.6g} is asked."
    lines = [f"{who}: {told}", *why]
    if name == "rate":
        lines.append("  Cure: dd.design looks for gains with this rate, dd.design_observer for W.")
    raise AssertionError("\n".join(lines))


def _told(certificate: Certificate, wanted: Verdict) -> str:
    """Why the verdict is not the wanted one, check by check."""
    lines = [
        f"{certificate.problem.name} is {certificate.verdict.value}, not {wanted.value}.",
        certificate.reason,
    ]
    for check in certificate.checks:
        if check.verdict is not Verdict.PROVED and check.applies:
            lines.append(f"{check.title} is {check.verdict.value}.")
            # One cure may serve several checks.
            lines += [line for line in _about(check) if line not in lines]
    return "\n".join(lines)


def _about(check: Check) -> Iterator[str]:
    """Reason, witness and cure of a check, a line each."""
    yield f"  Reason: {check.reason}"
    if check.witness is not None:
        yield f"  Witness: {_witness_words(check.witness)}"
    if check.fix is not None:
        yield f"  Cure: {check.fix.text}"
        yield from (f"    {line}" for line in change_lines(check.fix.set))


def _witness_words(witness: Witness) -> str:
    told = []
    for kind, values in (("agents", witness.labels), (witness.kind, witness.values)):
        if values:
            more = f" and {len(values) - 12} more" if len(values) > 12 else ""
            told.append(f"{kind} {', '.join(values[:12])}{more}")
    return "; ".join(told)
