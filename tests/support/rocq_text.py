"""The text of Coq files as tests read it."""

import re


def bare(text: str) -> str:
    """The text without its comments."""
    out: list[str] = []
    depth = place = 0
    for mark in re.finditer(r"\(\*|\*\)", text):
        out += [text[place : mark.start()]] if depth == 0 else []
        depth, place = depth + (1 if mark[0] == "(*" else -1), mark.end()
        assert depth >= 0
    assert depth == 0
    return "".join([*out, text[place:]])
