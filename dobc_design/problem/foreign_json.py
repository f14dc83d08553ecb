"""JSON that is no problem: what it is, by the keys that its program writes, and what to do with
it."""

import re
from collections.abc import Mapping
from typing import Any

from dobc_design._files import own_table
from dobc_design.errors import SpecError, refused
from dobc_design.exact.reading import Table, named

PROBLEM, CERTIFICATE = "a problem", "a certificate"
_WANTED = {
    PROBLEM: "A problem is a .toml file, or the problem.json that dobc_design writes.",
    CERTIFICATE: "A certificate is the certificate.json that `dobc certify` writes.",
}

_KINDS = own_table("problem/foreign.toml")["kinds"]


def not_a(wanted: str, document: Any, *, name: str) -> SpecError:
    """The error that ``document``, read of the file ``name``, is not ``wanted``, and what it is."""
    only = _WANTED[wanted]
    if not isinstance(document, Mapping):
        kind = "a list" if isinstance(document, list) else "a single value"
        return refused("format", f"{named(name)} is not {wanted}: it holds {kind}.", only)
    for kind in _KINDS:
        if _fits(document, kind):
            what = f"{named(name)} is not {wanted} but {kind['what']}."
            return refused("format", what, kind.get("cure", only))
    keys = ", ".join(named(str(key)) for key in list(document)[:4]) or "none"
    what = f'{named(name)} is not {wanted}: it has no "format" of dobc_design; its keys are {keys}'
    return refused("format", f"{what}{', ...' if len(document) > 4 else ''}.", only)


def _fits(document: Table, kind: Table) -> bool:
    """Whether JSON has the keys of a kind, and the texts."""
    texts = kind.get("texts", {}).items()
    if not all(re.search(form, str(document.get(key, ""))) for key, form in texts):
        return False
    return all(any(_has(document, x) for x in each.split("|")) for each in kind.get("has", ()))


def _has(document: Any, path: str) -> bool:
    """Whether something stands under a key, or below another one."""
    key, _, rest = path.partition(".")
    there = isinstance(document, Mapping) and key in document
    return there and (not rest or _has(document[key], rest))
