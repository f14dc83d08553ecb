"""The pages of the certificate's format: the certificate made by hand, and lines that fit on a
page."""

import json
import re
from pathlib import Path
from typing import Any

import pytest

import dobc_design as dd
from dobc_design.checker.examine import examine

DOCS = Path(__file__).resolve().parents[2] / "docs"
FORMAT, CLAIMS, BY_HAND = (
    (DOCS / f"certificate-{name}.md").read_text("utf-8") for name in ("format", "claims", "by-hand")
)
PROBLEM, CERTIFICATE = re.findall(r"^```json\n(.*?)^```$", BY_HAND, re.MULTILINE | re.DOTALL)
PROBLEM = PROBLEM.replace("\n", "") + "\n"


def held(certificate: str, folder: Path) -> tuple[bool, bool]:
    """Whether the package and the lone checker confirm it."""
    (folder / "problem.json").write_text(PROBLEM, "utf-8")
    own = dd.verify(certificate.encode(), str(folder / "problem.json")).holds
    findings = examine(certificate.encode(), PROBLEM.encode())
    return own, all(holds for holds, _ in findings)


def test_both_programs_confirm_the_certificate_made_by_hand(tmp_path: Path):
    assert held(CERTIFICATE, tmp_path) == (True, True)


@pytest.mark.parametrize(
    ("check", "change"),
    [
        ("hurwitz", {"rate": 2.01}),
        ("lemma1", {"margin": 1.6}),
        ("lemma1", {"rate": 0.8}),
        ("theorem1", {"margin": 1.34}),
        ("theorem1", {"exact": {"P": [["1"]], "Q": [["2"]], "S": [["1/5"]], "bound": "-1/5"}}),
        ("max-separable", {"rate": 0.51}),
        ("max-separable", {"domain": {"kind": "box", "radius": 1, "disturbance": 0.51}}),
    ],
)
def test_neither_confirms_a_little_more(check: str, change: dict[str, Any], tmp_path: Path):
    claims = json.loads(CERTIFICATE)
    named = next(each for each in claims["checks"] if each["id"] == check)
    named.update(change)
    assert held(json.dumps(claims), tmp_path) == (False, False)


def test_no_line_is_longer_than_140_characters():
    assert max(map(len, (FORMAT + CLAIMS + BY_HAND).splitlines())) <= 140
