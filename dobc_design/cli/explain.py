"""The body of ``dobc explain``: conditions in words."""

from __future__ import annotations

from difflib import get_close_matches

from dobc_design.cli.output import print_json, say
from dobc_design.conditions.kinds import KINDS
from dobc_design.errors import SpecError

TOLD = ("title", "statement", "plain", "meaning", "proved", "refuted", "source")


def run_explain(id: str | None, *, as_json: bool) -> int:
    """Explain one condition, or without ``id`` name all of them.  Raises: SpecError for an id that is not known."""
    if id is None:
        if as_json:
            print_json({"conditions": [{"id": each, "title": text.title} for each, text in KINDS.items()]})
        else:
            width = max(map(len, KINDS))
            say("\n".join(f"{each:<{width}}  {text.title}" for each, text in KINDS.items()))
        return 0
    text = KINDS.get(id)
    if text is None:
        near = get_close_matches(id[:40], KINDS, n=1)
        hint = f"Did you mean {near[0]}? " if near else ""
        raise SpecError(f"{id[:40]!r} is not known.", key="id", cure=f"{hint}One of {', '.join(KINDS)}.")
    if as_json:
        print_json({"id": id, **{name: getattr(text, name) for name in TOLD}})
        return 0
    say(f"{text.title}\n\n  {text.plain}\n\n{text.meaning}")
    say(f"Proved:  {text.proved}\nRefuted: {text.refuted}\nSource:  {text.source}")
    return 0
