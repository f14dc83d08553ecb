"""The body of ``dobc explain``: conditions in words."""

from __future__ import annotations

from dataclasses import asdict
from difflib import get_close_matches

from dobc_design.cli.output import print_json, say
from dobc_design.conditions.explanations import EXPLANATIONS
from dobc_design.errors import SpecError


def run_explain(id: str | None, *, as_json: bool) -> int:
    """Explain one condition, or without ``id`` name all of them.  Raises: SpecError for an id that is not known."""
    if id is None:
        if as_json:
            print_json({"conditions": [{"id": each, "title": text.title} for each, text in EXPLANATIONS.items()]})
        else:
            width = max(map(len, EXPLANATIONS))
            say("\n".join(f"{each:<{width}}  {text.title}" for each, text in EXPLANATIONS.items()))
        return 0
    text = EXPLANATIONS.get(id)
    if text is None:
        near = get_close_matches(id[:40], EXPLANATIONS, n=1)
        hint = f"Did you mean {near[0]}? " if near else ""
        raise SpecError(f"{id[:40]!r} is not known.", key="id", cure=f"{hint}One of {', '.join(EXPLANATIONS)}.")
    if as_json:
        print_json({"id": id, **asdict(text)})
        return 0
    say(f"{text.title}\n\n  {text.plain}\n\n{text.meaning}")
    say(f"Proved:  {text.proved}\nRefuted: {text.refuted}\nSource:  {text.source}")
    return 0
