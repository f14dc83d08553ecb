"""Small problems with a [switching], and certificates of them with one claim more, written by
hand."""

import hashlib
import json
from functools import cache
from typing import Any

import pytest
from certified import claimed_afresh, consensus_claims

from checker_files.files import Case, Document
from dobc_design import Problem, Switching
from dobc_design.certificate.claims import Claims
from dobc_design.certificate.text import certificate_bytes
from dobc_design.certification import certify as certification
from dobc_design.problem.canonical import canonical_bytes


@cache
def unweighted(problem: Problem) -> Claims:
    """What is claimed of the consensus, without searching for weights of agents."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(certification, "weighted_stage", lambda *given, **options: [])
        return claimed_afresh(problem)


class Frames:
    """``settings``: by name a problem and its [switching]; ``known``: ids of what is kept of the
    rest."""

    def __init__(
        self, settings: dict[str, tuple[Document, Document]], known: tuple[str, ...]
    ) -> None:
        self._settings = settings
        self._known = known
        self.frame, self.problem = cache(self._frame), cache(self._problem)

    def _frame(self, name: str) -> bytes:
        """What is found without the [switching], less what it says of regions."""
        problem = Problem(**self._settings[name][0])
        weighted = any(each.endswith("weighted") for each in self._known)
        document = json.loads(
            certificate_bytes((consensus_claims if weighted else unweighted)(problem))
        )
        document["checks"] = [each for each in document["checks"] if each["id"] in self._known]
        if document["verdict"] == "proved" and document["covered_by"] not in self._known:
            document |= {"verdict": "undecided", "rate": None, "covered_by": None}
        return json.dumps(document).encode()

    def _problem(self, name: str) -> bytes:
        own, turns = self._settings[name]
        return canonical_bytes(Problem(**own, switching=Switching(**turns)))

    def certificate(
        self, name: str, check: Document | None, data: bytes | None = None, **overall: Any
    ) -> tuple[bytes, bytes]:
        """With that check, which decides where it is a faster proof of consensus; and the problem
        file."""
        document = json.loads(self.frame(name))
        data = data or self.problem(name)
        document["problem_sha256"] = hashlib.sha256(data).hexdigest()
        if check is not None:
            document["checks"].append(check)
            decides = check["verdict"] == "proved" and (
                check["id"] != "safety" or check["rate"] is not None
            )
            if decides and (
                document["verdict"] != "proved" or (check["rate"] or 0) > (document["rate"] or 0)
            ):
                document |= {"verdict": "proved", "rate": check["rate"], "covered_by": check["id"]}
        return json.dumps(document | overall).encode(), data

    def case(
        self,
        name: str,
        code: int,
        what: str,
        check: Document | None,
        data: bytes | None = None,
        **overall: Any,
    ) -> Case:
        return Case(f"{name}: {what}", *self.certificate(name, check, data, **overall), code)
